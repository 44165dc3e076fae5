"""Drawings (DXF, SVG) as path files: read, chain, order, write; see :mod:`ph_post.io.drawing.convert`."""
