"""Controller dialects, one file each."""
