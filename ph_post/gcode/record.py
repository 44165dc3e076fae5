"""What a motion is cut into: blocks, and the moves that a controller reads of them."""

from __future__ import annotations

from collections.abc import Mapping

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


class Feed(msgspec.Struct, frozen=True, kw_only=True):
    """Feed over the share p of a block's way: start + (end - start - quad - cub) p + quad p² + cub p³ [m/s].

    `error` is the largest difference from the plan, as a part of the planned speed; 0 where there is none.
    """

    start: float
    end: float
    quad: float
    cub: float
    error: float = 0.0

    def at(self, p: Array) -> Array:
        """Feed [m/s] at shares of the way.

        Examples
        --------
        >>> Feed(start=2.0, end=4.0, quad=6.0, cub=-4.0).at(np.array([0.0, 0.5, 1.0])).tolist()
        [2.0, 3.0, 4.0]
        """
        linear = self.end - self.start - self.quad - self.cub
        return self.start + p * (linear + p * (self.quad + p * self.cub))


class Moves(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Moves, n of them; positions are whole numbers of the dialect's last decimal.

    `points` (n + 1, dim): the start and the end of every move. `center` (n, 2) and `turn` (n,) of arcs, +1
    from the first axis towards the second; `inner` (n, 2, 2) the middle control points of splines.
    `duration` (n,) [s], `length` (n,) [m] as the controller will find it, `feed` (n,) [m/s], 0 for rapids and
    dwells. `plain` (dim,) is the last point without the offset that is carried there. `kind`, `rapid`, `s0`
    and `s1` are those of the blocks. By move, `polynomials` are the coefficients of what is one (see
    :func:`ph_post.gcode.polynomials.polynomial_words`), `profiles` the feeds that change within one (`feed`
    then is the mean), and `off` how far a written feed is off the planned one where that changes, as a part
    of it; nothing beside a rest.
    """

    kind: IntArray
    points: IntArray
    plain: IntArray
    center: IntArray
    turn: IntArray
    inner: IntArray
    duration: Array
    length: Array
    feed: Array
    rapid: IntArray
    s0: Array
    s1: Array
    polynomials: Mapping[int, IntArray] = {}
    profiles: Mapping[int, Feed] = {}
    off: Mapping[int, float] = {}
