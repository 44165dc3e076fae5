"""Compensation strategies, one file each."""
