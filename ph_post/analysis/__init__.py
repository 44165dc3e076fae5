"""Geometry and drives of a path together: turning points, osculating windows and backlash intervals."""
