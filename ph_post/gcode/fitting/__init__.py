"""Fit lines, arcs and Hermite interpolants to short straight moves."""
