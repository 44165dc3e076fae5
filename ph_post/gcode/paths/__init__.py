"""Paths of part programs: what a program moves along, and where on its motions each place is."""
