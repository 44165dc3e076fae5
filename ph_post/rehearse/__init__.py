"""Rehearse programs on a real LinuxCNC without a screen."""
