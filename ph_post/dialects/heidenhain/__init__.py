"""Heidenhain TNC for mills: dialects and readers of its conversational and its ISO language."""
