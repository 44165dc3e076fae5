"""Curves through the short straight moves that sample them: our own mathematics, array by array."""
