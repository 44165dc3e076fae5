"""Diagnosis of a machine from a log: find, name and size the effects that its machine file lacks."""
