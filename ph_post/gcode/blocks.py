"""Blocks of a program before they are written, and the pieces of a path sorted by the blocks they become."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from ph_post.geometry.joints import find_joints
from ph_post.geometry.piecewise import MEETS, Piece
from ph_post.geometry.track import Track
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
        """Return the feed [m/s] at shares of the way.

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


LINE, ARC, SPLINE, CURVE, POLYNOMIAL = range(5)
"""What a piece is to the writer: one G1, G2 or G3, one or more G5, many chords, or polynomials of it."""


class TrackShape(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The pieces of a track, grouped for the writer.

    `kind` and `rapid` per piece. `kind_changes` [m]: where a block has to end while the speed is constant, because
    the kind changes there; `stops` [m]: where a block has to end in any case (sharp corners, beginnings and
    ends of rapid segments). `center` (m, 2) [m], `radius` (m,) [m] and `turn` (m,) of arcs: +1 from the first
    axis towards the second, -1 the other way, 0 where the piece is no arc.
    """

    track: Track
    kind: IntArray
    rapid: IntArray
    kind_changes: Array
    stops: Array
    center: Array
    radius: Array
    turn: IntArray

    def wrap(self, s: Array) -> Array:
        """Bring places along the motion onto the track: another round on a closed path, else its end."""
        length = self.track.length
        if not self.track.closed:
            return np.clip(s, 0.0, length)
        return np.where((s < 0.0) | (s > length), np.mod(s, length), s)

    def snap(self, s: Array) -> Array:
        """Move places next to a joint, or an end, onto it: sums of a motion's phases are off.

        Otherwise the end of a block that is a polynomial would lie beside its own piece.
        """
        length = self.track.length
        base = np.floor(s / length) * length if self.track.closed else np.zeros(s.size)
        joints = np.concatenate([[0.0], self.kind_changes, [length]])
        place = s - base
        after = np.clip(np.searchsorted(joints, place), 1, joints.size - 1)
        nearer = place - joints[after - 1] < joints[after] - place
        joint = np.where(nearer, joints[after - 1], joints[after])
        return np.where(np.abs(place - joint) <= MEETS, base + joint, s)

    def piece_at(self, s: Array) -> IntArray:
        """Return the number of the piece at each place."""
        number = np.searchsorted(self.track.starts, self.wrap(s), side="right") - 1
        return np.asarray(np.clip(number, 0, self.kind.size - 1), dtype=np.int64)

    def positions(self, s: Array) -> Array:
        """Return points of the path [m], shape (n, dimension)."""
        piece, u = self.track.locate(self.wrap(s))
        return np.asarray(self.track.derivatives(piece, u, 0)[0])

    def parameter_on(self, piece: IntArray, s: Array) -> Array:
        """Return the parameters u of places [m] on their pieces, the ends of the pieces included."""
        starts = self.track.starts
        wrapped = self.wrap(s)
        found, u = self.track.locate(np.clip(wrapped, starts[piece], starts[piece + 1]))
        return np.where(found == piece, u, (found > piece).astype(np.float64))


def read_shape(track: Track, *, arcs: bool, splines: bool, degree: int = 1) -> TrackShape:
    """Sort the pieces of a track by what they become.

    Arcs and cubics become chords where not wanted, and so does what is of a higher `degree` than polynomials
    may have; pieces of degree 1 are lines whatever it is.
    """
    splines = splines and track.dimension == 2
    kind = np.array([_kind(piece, arcs, splines, degree) for piece in track.pieces], dtype=np.int64)
    rapid = _rapid(track)
    joints = find_joints(track)
    sharp = joints.s[joints.sharp]
    before, after = kind[:-1], kind[1:]
    changes = track.starts[1:-1][(before != after) | (before != CURVE)]
    switches = track.starts[1:-1][np.diff(rapid) != 0]
    stops = np.unique(np.concatenate([sharp, switches]))
    center, radius, turn = _circles(track)
    return TrackShape(
        track=track,
        kind=kind,
        rapid=rapid,
        kind_changes=np.unique(np.concatenate([changes, stops])),
        stops=stops,
        center=center,
        radius=radius,
        turn=turn,
    )


def between(shape: TrackShape, marks: Array, s0: float, s1: float) -> Array:
    """Select the marks [m] between two places [m] of the motion, in the order of travel, on any round of a loop."""
    low, high = min(s0, s1), max(s0, s1)
    if shape.track.closed:
        length = shape.track.length
        marks = np.append(marks, length) if high > length + MEETS or low < -MEETS else marks
        rounds = np.arange(np.floor(low / length), np.ceil(high / length) + 1)
        marks = (marks[None, :] + length * rounds[:, None]).ravel()
    inside = np.sort(marks[(marks > low + MEETS) & (marks < high - MEETS)])
    return inside if s1 > s0 else inside[::-1]


def _kind(piece: Piece, arcs: bool, splines: bool, highest: int) -> int:
    if piece.kind == "arc":
        return ARC if arcs else CURVE
    degree = piece.control.shape[0] - 1
    if degree == 1:
        return LINE
    if degree <= highest:
        return POLYNOMIAL
    return SPLINE if splines and piece.kind == "polynomial" and degree <= 3 else CURVE


def _rapid(track: Track) -> IntArray:
    segments = np.array([segment.rapid for segment in track.path.segments], dtype=np.int64)
    return segments[track.segment]


def _circles(track: Track) -> tuple[Array, Array, IntArray]:
    """Centres, radii and senses of the arcs; zeros, infinity and 0 elsewhere."""
    m = len(track.pieces)
    center, radius, turn = np.zeros((m, 2)), np.full(m, np.inf), np.zeros(m, dtype=np.int64)
    for group in track.groups:
        if group.kind == "arc":
            center[group.index] = group.control[:, 0, :2]
            radius[group.index] = group.control[:, 1, 0]
            turn[group.index] = np.sign(group.control[:, 2, 0])
    return center, radius, turn
