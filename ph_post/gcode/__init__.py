"""Part programs: dialects and the writer."""
