"""Limit curve of the axes along the path: speed, and the tangential acceleration and jerk that are left.

With r_s, r_ss, r_sss the derivatives of the path by arc length, axis i of a motion s(t) of speed v moves with

    v r_s,    v² r_ss + a r_s,    v³ r_sss + 3 v a r_ss + j r_s.

Where r_ss jumps by Δ the sampled jerk gains up to ¾ v² |Δ| / dt: the third difference is the mean of the
jerk under a quadratic B-spline three periods dt wide and ¾ / dt high. A kink Δt of the tangent gains
v |Δt| / dt in the second difference and v |Δt| / dt² in the third. The grid is fine where the limits change.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import msgspec
import numpy as np

from ph_post.bounds import check_places
from ph_post.geometry import frenet
from ph_post.geometry.joints import SHARP_CORNER_RAD, find_joints
from ph_post.geometry.numeric import largest, norm, smallest
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, IntArray, Machine, frozen

_CELLS = 8
"""Cells a curved piece begins with; each is looked at in its middle as well."""

_CHANGE = 0.1
"""Relative change of the speed cap across half a cell that asks for finer cells."""

_TURN = 0.1
"""Turn of the tangent [rad] across half a cell that asks for finer cells: directions are right to 1e-3."""

_ROUNDS = 14
"""Halvings of a cell: to 1 / 131072 of a piece, where a cusp rounded by 1e-5 of it shows."""

_STILL = 1e-6
"""Parametric speed, relative to the piece's largest, below which d/ds is not worth evaluating."""

_LEAST = np.finfo(np.float64).tiny


def fastest_speeds(track: Track) -> Array:
    """Largest parametric speed of every piece [m], as seen at a few points, shape (pieces,)."""
    piece, u = _first_points(track)
    fastest = np.zeros(len(track.pieces))
    np.maximum.at(fastest, piece, norm(track.derivatives(piece, u, 1)[1]))
    return fastest


def build_grid(track: Track, fastest: Array, cap: Callable[[IntArray, Array], Array]) -> tuple[IntArray, Array]:
    """Choose the points at which the limits are evaluated.

    Parameters
    ----------
    track : Track
    fastest : Array
        See :func:`fastest_speeds`.
    cap : callable
        Speed cap [m/s] at ``(piece, u)``, finite; cells are halved until it is nearly the same all over them.

    Returns
    -------
    piece : IntArray, shape (n,)
    u : Array, shape (n,)
        In the order of the path, both ends of every piece among them where the path is regular there.
    """
    look = _Look(track, fastest, cap)
    points = [look.at(*_first_points(track))]
    inner = np.flatnonzero(points[0].piece[1:] == points[0].piece[:-1])
    cells = _Cells(points[0].take(inner), points[0].take(inner + 1))
    for _ in range(_ROUNDS):
        if not cells.low.piece.size:
            break
        check_places(track.path.name, "the path bends too often to be planned", cells.low.piece.size, "a simpler path")
        middle = look.at(cells.low.piece, 0.5 * (cells.low.u + cells.high.u))
        points.append(middle)
        # What cannot be evaluated is NaN and compares as false: its neighbourhood is refined.
        rough = np.flatnonzero(~(_alike(cells.low, middle) & _alike(middle, cells.high)))
        low, middle, high = cells.low.take(rough), middle.take(rough), cells.high.take(rough)
        cells = _Cells(_join(low, middle), _join(middle, high))
    found = _join(*points)
    good = np.flatnonzero(np.isfinite(found.value))
    order = good[np.lexsort((found.u[good], found.piece[good]))]
    return found.piece[order], found.u[order]


class _Points(NamedTuple):
    """Points on the path: logarithm of the cap and unit tangent, NaN where the path is not regular."""

    piece: IntArray
    u: Array
    value: Array
    tangent: Array

    def take(self, which: IntArray) -> _Points:
        return _Points(self.piece[which], self.u[which], self.value[which], self.tangent[which])


class _Cells(NamedTuple):
    low: _Points
    high: _Points


class _Look:
    """Looks at the path."""

    def __init__(self, track: Track, fastest: Array, cap: Callable[[IntArray, Array], Array]) -> None:
        self.track, self.fastest, self.cap = track, fastest, cap

    def at(self, piece: IntArray, u: Array) -> _Points:
        velocity = self.track.derivatives(piece, u, 1)[1]
        speed = norm(velocity)
        value, tangent = np.full(u.size, np.nan), np.full(velocity.shape, np.nan)
        good = np.flatnonzero(speed > _STILL * self.fastest[piece])
        value[good] = np.log(np.maximum(self.cap(piece[good], u[good]), _LEAST))
        tangent[good] = velocity[good] / speed[good, None]
        return _Points(piece, u, value, tangent)


def _first_points(track: Track) -> tuple[IntArray, Array]:
    """Points a piece begins with: of a straight one its ends, which joints may hold down, and its middle."""
    straight = [piece.kind == "polynomial" and len(piece.control) == 2 for piece in track.pieces]
    counts = np.where(straight, 3, _CELLS + 1)
    piece = np.repeat(np.arange(counts.size), counts)
    first = np.cumsum(counts) - counts
    return piece, (np.arange(piece.size) - first[piece]) / (counts[piece] - 1.0)


def _alike(a: _Points, b: _Points) -> BoolArray:
    turn = largest(np.abs(a.tangent - b.tangent))
    alike: BoolArray = (np.abs(a.value - b.value) < _CHANGE) & (turn < _TURN)
    return alike


def _join(*points: _Points) -> _Points:
    piece, u, value, tangent = zip(*points, strict=True)
    return _Points(np.concatenate(piece), np.concatenate(u), np.concatenate(value), np.concatenate(tangent))


NORMAL_SHARE = 0.7
"""Part of the acceleration limit that v² r_ss may take; the rest stays for speeding up and slowing down."""

BEND_SHARE = 0.4
"""Part of the jerk limit that v³ r_sss may take."""

CROSS_SHARE = 0.25
"""Part of the jerk limit that 3 v a r_ss may take."""

JUMP_SHARE = 0.5
"""Part of the jerk limit that a jump of the curvature may take on the samples."""

KINK_SHARE = 0.2
"""Part of the acceleration and jerk limits that a kink within the tolerance for corners may take."""

VELOCITY_SHARE = 0.995
"""Part of the velocity limit that is used; the rest covers what changes between the points looked at."""

AIM = 0.95
"""Where a cap bends the plan aims at this part of it, so that it may rise between the places where it does:
without that a ramp would have to follow the cap node by node."""

UNBOUNDED = 1e9
"""A speed [m/s] in place of infinity."""

_ROUNDING = 16.0 * np.finfo(np.float64).eps
"""Relative error of sums and products of a dozen terms."""

_LEAST_NORM = 1e-200
"""Kept in denominators that may vanish."""


class AxisLimits(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Limits of the axes that a path moves, in their order, for motion sampled every `period` [s].

    `values` (3, dim): velocity [m/s], acceleration [m/s²], jerk [m/s³].
    """

    values: Array
    period: float

    @property
    def velocity(self) -> Array:
        """Shape (dim,)."""
        return self.of_order(1)

    @property
    def acceleration(self) -> Array:
        """Shape (dim,)."""
        return self.of_order(2)

    @property
    def jerk(self) -> Array:
        """Shape (dim,)."""
        return self.of_order(3)

    def of_order(self, order: int) -> Array:
        """Limit of the derivative of that order, shape (dim,)."""
        limit: Array = self.values[order - 1]
        return limit


class LimitCurve(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Limits at the grid's points, in the order of the path; a joint stands there twice.

    `s` [m]; `hard` the speed [m/s] that may not be exceeded, `soft` the one to aim at; `acceleration` [m/s²]
    what is left along the path at that speed, `cross` the less that the term 3 v a r_ss leaves of it; `jerk`
    [m/s³] what is left along the path. `tangent`, `normal`, `bend` (n, dim) are |r_s|, |r_ss|, |r_sss|,
    `room_a` and `room_j` (n, dim) what joints leave of the axes' limits. `programmed` is the feed asked for.
    """

    s: Array
    programmed: Array
    hard: Array
    soft: Array
    acceleration: Array
    cross: Array
    jerk: Array
    tangent: Array
    normal: Array
    bend: Array
    room_a: Array
    room_j: Array

    def slowed(self, factor: Array) -> LimitCurve:
        """Stretch time by 1 / `factor` (n,): speed goes with it, acceleration and jerk with its powers."""
        f, f2, f3 = factor, factor**2, factor**3
        return msgspec.structs.replace(
            self,
            hard=self.hard * f,
            soft=self.soft * f,
            acceleration=self.acceleration * f2,
            cross=self.cross * f2,
            jerk=self.jerk * f3,
            room_a=self.room_a * f2[:, None],
            room_j=self.room_j * f3[:, None],
        )

    def eased(self, factor: Array) -> LimitCurve:
        """Let changes of the speed take 1 / `factor` (n,) of the time: acceleration and jerk go with its powers."""
        f2, f3 = factor**2, factor**3
        return msgspec.structs.replace(
            self, acceleration=self.acceleration * f2, cross=self.cross * f2, jerk=self.jerk * f3
        )

    def refined(self, spacing: float) -> LimitCurve:
        """Add points where neighbours are farther apart than `spacing` [m], so that each stretch can be slowed alone.

        Between two points everything changes evenly. On a straight line it is as free as at the freer of them: only
        joints bind there.
        """
        step = np.diff(self.s)
        count = np.ceil(step / spacing).astype(np.int64)
        cells = np.flatnonzero(count > 1)
        more = count[cells] - 1
        at = np.repeat(cells, more)
        part = (np.arange(at.size) - np.repeat(np.cumsum(more) - more, more) + 1.0) / count[at]
        straight = (largest(self.normal[at]) == 0.0) & (largest(self.normal[at + 1]) == 0.0)

        def between(values: Array, freest: np.ufunc) -> Array:
            low, high = values[at], values[at + 1]
            free, share = (one if values.ndim == 1 else one[:, None] for one in (straight, part))
            even = low * (1.0 - share) + high * share
            return np.insert(values, at + 1, np.where(free, freest(low, high), even), axis=0)

        allowed = {name: between(getattr(self, name), np.maximum) for name in _ALLOWED}
        taken = {name: between(getattr(self, name), np.minimum) for name in _TAKEN}
        place = np.insert(self.s, at + 1, self.s[at] + part * step[at])
        return LimitCurve(s=place, **allowed, **taken)


_ALLOWED = ("programmed", "hard", "soft", "acceleration", "cross", "jerk", "room_a", "room_j")
"""What a limit curve allows."""

_TAKEN = ("tangent", "normal", "bend")
"""What the path takes of it."""


def axis_limits(axes: tuple[str, ...], machine: Machine, period: float) -> AxisLimits:
    """Limits of `axes` in their order."""
    limits = [machine.axes[name].limits for name in axes]
    values = [
        [one.velocity for one in limits],
        [one.acceleration for one in limits],
        [one.jerk for one in limits],
    ]
    return AxisLimits(values=frozen(values), period=period)


def build_limit_curve(track: Track, limits: AxisLimits, *, rounded: bool = False) -> LimitCurve:
    """Evaluate the limits along the path on a grid that is fine where they change.

    With `rounded` jumps of the curvature ask for nothing: the command goes over them smoothly.
    """
    feeds = np.array([_feed(track, int(segment)) for segment in track.segment])
    fastest = fastest_speeds(track)

    def cap(piece: IntArray, u: Array) -> Array:
        shape = _shape(track, fastest, piece, u)
        kinematic = np.minimum(_velocity_cap(shape, limits), _bend_cap(shape, limits, limits.jerk))
        # Far above the programmed feed nothing binds, so nothing needs to be resolved there.
        return np.minimum(kinematic, 1.5 * feeds[piece])

    piece, u = build_grid(track, fastest, cap)
    shape = _shape(track, fastest, piece, u)
    joint, room_a, room_j = _joint_room(track, limits, piece, feeds[piece], rounded)
    velocity, bend = _velocity_cap(shape, limits), _bend_cap(shape, limits, room_j)
    # Between two points neither of their caps may be exceeded.
    smooth = _lowest_around(np.minimum(velocity, bend), piece)
    aim = np.maximum(AIM * smooth, _lowest_around(smooth, piece))
    hard, soft = np.minimum(smooth, joint), np.minimum(aim, joint)
    # Both sides of a joint keep the lower cap of the two.
    hard, soft, feed = (_lower_at_joints(values, piece) for values in (hard, soft, feeds[piece]))
    hard = np.minimum(hard, feed)
    acceleration, cross, jerk = _left_over(shape, hard, room_a, room_j)
    s = np.where(u == 1.0, track.starts[piece + 1], track.arc_length(piece, u))
    return LimitCurve(
        s=np.where(u == 0.0, track.starts[piece], s),
        programmed=feed,
        hard=hard,
        soft=np.minimum(soft, feed),
        acceleration=acceleration,
        cross=cross,
        jerk=jerk,
        tangent=shape[0],
        normal=shape[1],
        bend=shape[2],
        room_a=room_a,
        room_j=room_j,
    )


def _feed(track: Track, segment: int) -> float:
    one = track.path.segments[segment]
    if one.rapid:
        return UNBOUNDED
    return track.path.feed if one.feed is None else one.feed


def _shape(track: Track, fastest: Array, piece: IntArray, u: Array) -> Array:
    """|r_s|, |r_ss|, |r_sss| by axis, shape (3, n, dim), less what may be rounding.

    Where the parametric speed σ is small they are differences of terms like |r_uu| / σ² in r_ss, |r_uuu| / σ³
    and |r_uu|² / σ⁴ in r_sss, right to rounding times how far σ is below its largest value. A line drawn as
    a cubic with coincident control points at its ends would else seem to bend there.
    """
    d = track.derivatives(piece, u, 3)
    shape: Array = np.abs(frenet.arc_derivatives(d)[1:])
    speed, second, third = (norm(values) for values in d[1:])
    error = _ROUNDING * (1.0 + fastest[piece] / speed)
    shape[1] -= (error * second / speed**2)[:, None]
    shape[2] -= (error * (third / speed**3 + 10.0 * second**2 / speed**4))[:, None]
    return np.maximum(shape, 0.0)


def _velocity_cap(shape: Array, limits: AxisLimits) -> Array:
    """Speed cap (n,) from the velocities of the axes."""
    caps = VELOCITY_SHARE * limits.velocity / np.maximum(shape[0], _LEAST_NORM)
    return smallest(np.minimum(caps, UNBOUNDED))


def _bend_cap(shape: Array, limits: AxisLimits, room_j: Array) -> Array:
    """Speed cap (n,) from what bending the path takes of acceleration and jerk."""
    _, normal, bend = np.maximum(shape, _LEAST_NORM)
    caps = np.minimum(np.sqrt(NORMAL_SHARE * limits.acceleration / normal), np.cbrt(BEND_SHARE * room_j / bend))
    return smallest(np.minimum(caps, UNBOUNDED))


def _joint_room(
    track: Track, limits: AxisLimits, piece: IntArray, feed: Array, rounded: bool
) -> tuple[Array, Array, Array]:
    """Speed cap (n,) at joints, and what they leave (n, dim) of acceleration and jerk at that speed."""
    cap = np.full(piece.size, UNBOUNDED)
    room_a = np.tile(limits.acceleration, (piece.size, 1))
    room_j = np.tile(limits.jerk, (piece.size, 1))
    joints = find_joints(track)
    # Run through are joints but for corners, the seam, and infinite curvature.
    smooth = (joints.angle <= SHARP_CORNER_RAD) & np.all(np.isfinite(joints.curvature_jump), axis=1)
    passed = np.flatnonzero(smooth & (joints.after != 0))
    if not passed.size:
        return cap, room_a, room_j
    jump, kink = np.abs(joints.curvature_jump[passed]), np.abs(joints.tangent_jump[passed])
    if rounded:
        jump = np.zeros_like(jump)
    first = np.searchsorted(piece, joints.after[passed])
    last = first - 1
    v = _jump_cap(jump, kink, limits)
    at = np.minimum(v, np.maximum(feed[first], feed[last]))[:, None]
    less_a = at * kink / limits.period
    less_j = 0.75 * at**2 * jump / limits.period + at * kink / limits.period**2
    for index in (first, last):
        cap[index] = np.minimum(cap[index], v)
        room_a[index] -= less_a
        room_j[index] -= less_j
    # A piece of one cell has a joint at either end, but each at a point of its own: nothing is taken twice.
    return cap, room_a, room_j


def _jump_cap(jump: Array, kink: Array, limits: AxisLimits) -> Array:
    """Speed cap (m,) from jumps of the curvature and kinks of the tangent (m, dim)."""
    dt = limits.period
    by_jump = np.sqrt(JUMP_SHARE * limits.jerk * dt / np.maximum(0.75 * jump, _LEAST_NORM))
    steps = np.minimum(limits.acceleration * dt, limits.jerk * dt * dt)
    by_kink = KINK_SHARE * steps / np.maximum(kink, _LEAST_NORM)
    return smallest(np.minimum(np.minimum(by_jump, by_kink), UNBOUNDED))


def _lowest_around(values: Array, piece: IntArray) -> Array:
    """Lowest of every value and its neighbours on the same piece."""
    lowest = values.copy()
    same = np.flatnonzero(piece[1:] == piece[:-1])
    lowest[same] = np.minimum(lowest[same], values[same + 1])
    lowest[same + 1] = np.minimum(lowest[same + 1], values[same])
    return lowest


def _lower_at_joints(values: Array, piece: IntArray) -> Array:
    lower = values.copy()
    joint = np.flatnonzero(np.diff(piece))
    lower[joint] = lower[joint + 1] = np.minimum(values[joint], values[joint + 1])
    return lower


def _left_over(shape: Array, v: Array, room_a: Array, room_j: Array) -> tuple[Array, Array, Array]:
    """Acceleration along the path, the same with its cross term, and jerk along the path, (n,) each."""
    tangent, normal, bend = np.maximum(shape, _LEAST_NORM)
    v = v[:, None]
    acceleration = (room_a - normal * v**2) / tangent
    across = CROSS_SHARE * room_j / np.maximum(3.0 * normal * v, _LEAST_NORM)
    free = smallest(acceleration)
    crossed = np.minimum(free, smallest(across))
    cross_jerk = np.minimum(CROSS_SHARE * room_j, 3.0 * normal * v * free[:, None])
    jerk = (room_j - bend * v**3 - cross_jerk) / tangent
    return free, crossed, smallest(jerk)
