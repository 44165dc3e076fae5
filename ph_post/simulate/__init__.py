"""Simulation of the whole machine: commanded motion in, executed motion and contour error out."""
