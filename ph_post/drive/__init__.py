"""Axis drives with backlash: servo loops, closed forms on a circle, backlash intervals (sections 3 and 4)."""
