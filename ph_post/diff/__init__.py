"""Compare two programs, whoever wrote them: text, tool path, feed, time and states."""
