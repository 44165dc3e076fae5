"""Moves of a CAM program that were sampled from a known curve, and the curve written in their place."""
