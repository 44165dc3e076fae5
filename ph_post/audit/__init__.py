"""Judges of what was written: verify, diff and rehearse, independent of the writer."""
