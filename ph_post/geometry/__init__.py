"""Curves and paths: values, derivatives, curvature, arc length and reversals (section 2 of the paper)."""
