"""Curves and paths: values, derivatives, curvature and arc length (section 2 of the paper)."""
