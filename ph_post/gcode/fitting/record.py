"""What a polyline is fitted with."""

from __future__ import annotations

import msgspec

from ph_post.types import Array, IntArray

STRAIGHT, ROUND, SMOOTH = range(3)
"""Kind of a piece: a line; an arc in the plane of the first two axes; a Hermite interpolant."""


class Fit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Pieces through the vertices of a polyline, p of them, each from vertex `first` to vertex `last`.

    `circle` (p, 4) of arcs: centre [m], radius [m] and sense, 1 from the first axis to the second. `control`
    (p, 6, 3) [m]: the control points of quintics; those of a cubic are the first four. `speed` (p, 5) [m]
    the Bernstein coefficients of ds/du of PH quintics. `degree` (p,) 1 of lines, 0 of arcs, 3 or 5 (then PH)
    of Hermite interpolants. `foot` (n,): the parameter in [0, 1] of its piece at which each vertex is
    nearest; a vertex where pieces meet counts to the later one, 0, and the last is 1.
    """

    kind: IntArray
    first: IntArray
    last: IntArray
    circle: Array
    degree: IntArray
    control: Array
    speed: Array
    foot: Array
