"""Text, JSON objects, figures and pages of results."""
