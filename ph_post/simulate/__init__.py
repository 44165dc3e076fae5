"""The whole machine in simulation: commanded motion in, executed motion and contour error out."""
