"""What a motion is cut into."""

from __future__ import annotations

import msgspec

from ph_post.types import Array, IntArray

DWELL = -1
"""Kind of a block that moves nothing. The others are JOG, LINE (also for chords), ARC and SPLINE."""

JOG = -2
"""Kind of a block in which the path stands still, and an axis moves to another offset from it."""


class Blocks(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Blocks in the order of the motion, all arrays of shape (n,).

    `kind`; `start`, `end` [s]; `s0`, `s1` places along the motion [m]; `rapid` 1 for G0; `stretch` the number
    of the stretch a block belongs to; `timed` 1 where a block's ends follow from the time, in ramps and
    dips, 0 where they follow from the geometry.
    """

    kind: IntArray
    start: Array
    end: Array
    s0: Array
    s1: Array
    rapid: IntArray
    stretch: IntArray
    timed: IntArray
