"""Axis drives with backlash: the servo loop, the gap and the closed forms on a circle (sections 3 and 4)."""
