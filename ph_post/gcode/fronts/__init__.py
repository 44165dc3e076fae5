"""Readers of part programs whose words are not those of RS274, one file each."""
