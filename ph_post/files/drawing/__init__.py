"""Drawings (DXF, SVG) as path files: read, chain, order, write."""
