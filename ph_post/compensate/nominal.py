"""The nominal feed along the path: jerk-limited ramps between speeds that fit.

A plan is a chain of nodes: places at which the speed is known and the acceleration zero. Between neighbours
the speed ramps up, stays and ramps down. It begins with the ends, the stops and the plateaus asked for;
wherever the speed then breaks a limit a node is added, and nodes are lowered until each can be reached from
its neighbours.
"""

from __future__ import annotations

from typing import NamedTuple

import msgspec
import numpy as np

from ph_post.compensate import speed_ramps
from ph_post.compensate.limit_curve import LimitCurve
from ph_post.errors import SolveError
from ph_post.geometry.numeric import largest
from ph_post.types import Array, BoolArray, IntArray

_ROUNDS = 1000
"""Rounds of adding nodes; each adds one to every stretch that breaks a limit, a dozen is usual."""

_ROUNDING = 1e-9
"""Relative excess over a limit that counts as rounding while planning; the samples are checked afterwards."""

_TIES = 1.0 - 1e-6
"""Points of a stretch that are worse than this part of its worst count as equally bad: a plateau."""

_SHORT = 2
"""Cells of the grid in a span that is too short for nodes inside to help."""

SAME_PLACE = 1e-12
"""Stops nearer to each other along the path than this [m] are one, and shorter lengths none."""


class Nodes(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Nodes in their order: on [s0, s1] [m] the speed is `level` [m/s]; most are points, s0 = s1.

    `window` is the index of the window whose profile this plateau is for, -1 elsewhere.
    """

    s0: Array
    s1: Array
    level: Array
    window: IntArray


class Schedule(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Phases as arrays (m,): `s` [m] at the start, `duration` [s], `speed` (m, 3) in Bernstein form [m/s].

    `window` is the window's index on its plateau, -1 elsewhere.
    """

    s: Array
    duration: Array
    speed: Array
    window: IntArray


class _Spans(NamedTuple):
    """Stretches between nodes, arrays (m,): where they begin, their length, what the grid says of them."""

    s: Array
    distance: Array
    first: IntArray
    last: IntArray
    ceiling: Array
    floor: Array
    a: Array
    cross: Array
    j: Array


class _Curves(NamedTuple):
    """Speeds at the ends of the spans and between them, arrays (m,)."""

    v0: Array
    peak: Array
    v1: Array


def first_nodes(length: float, stops: Array, moving: tuple[bool, bool]) -> Nodes:
    """Nodes at both ends of a path and at its stops [m]; each end is at rest unless `moving`."""
    inside = np.unique(stops[(stops > SAME_PLACE) & (stops < length - SAME_PLACE)])
    inside = inside[np.diff(inside, prepend=-1.0) > SAME_PLACE]
    s = np.concatenate([[0.0], inside, [length]])
    level = np.zeros(s.size)
    level[[0, -1]] = np.where(moving, np.inf, 0.0)
    return Nodes(s0=s, s1=s, level=level, window=np.full(s.size, -1))


def add_plateaus(nodes: Nodes, s0: Array, s1: Array, level: Array, window: IntArray) -> Nodes:
    """Add plateaus between `s0` and `s1` [m] at `level` [m/s]; point nodes that lie on one give way to it."""
    covered = np.zeros(nodes.s0.size, dtype=bool)
    for low, high in zip(s0, s1, strict=True):
        covered |= (nodes.s0 >= low) & (nodes.s1 <= high)
    old = [part[~covered] for part in (nodes.s0, nodes.s1, nodes.level, nodes.window)]
    merged = [np.concatenate(pair) for pair in zip(old, (s0, s1, level, window), strict=True)]
    order = np.argsort(merged[0], kind="stable")
    return Nodes(s0=merged[0][order], s1=merged[1][order], level=merged[2][order], window=merged[3][order])


def plan_feed(caps: LimitCurve, nodes: Nodes) -> Schedule:
    """Plan the feed through `nodes` as fast as ramps between nodes allow, inside the caps.

    Parameters
    ----------
    caps : LimitCurve
    nodes : Nodes
        Ends, stops and plateaus; levels are lowered where the caps or the distance to a neighbour ask for it.

    Returns
    -------
    Schedule

    Raises
    ------
    SolveError
        If limits are still broken after many rounds (not known to happen).
    """
    nodes = msgspec.structs.replace(nodes, level=np.minimum(nodes.level, _on_nodes(caps, nodes)))
    found_good = np.full((2, nodes.level.size), np.nan)
    for _ in range(_ROUNDS):
        spans = _measure(caps, nodes)
        level = _lower(nodes.level, spans)
        v0, v1 = level[:-1], level[1:]
        peak = speed_ramps.peak_speed(v0, v1, spans.ceiling, spans.distance, spans.a, spans.j)
        curves = _Curves(v0, peak, v1)
        # What was found good with these speeds at its ends need not be looked at again.
        changed = (v0 != found_good[0, :-1]) | (v1 != found_good[1, :-1])
        worst = _find_worst(caps, spans, curves, changed)
        if not worst.size:
            return _schedule(msgspec.structs.replace(nodes, level=level), spans, curves)
        found_good[:, :-1] = v0, v1
        nodes, found_good = _insert(caps, nodes, worst, found_good)
    raise SolveError(f"the feed plan breaks limits at {worst.size} places after {_ROUNDS} rounds")


def _on_nodes(caps: LimitCurve, nodes: Nodes) -> Array:
    """Lowest cap on every node."""
    above = np.searchsorted(caps.s, nodes.s0, side="right") - 1
    below = np.searchsorted(caps.s, nodes.s1, side="left")
    first, last = _inside(caps, np.minimum(above, below), np.maximum(above, below))
    return _over(np.minimum, caps.soft, first, last)


def _inside(caps: LimitCurve, first: IntArray, last: IntArray) -> tuple[IntArray, IntArray]:
    return np.maximum(first, 0), np.minimum(last, caps.s.size - 1)


def _over(function: np.ufunc, values: Array, first: IntArray, last: IntArray) -> Array:
    """Reduce `values` over the index ranges [first, last]."""
    edges = np.stack([first, last + 1], axis=1).ravel()
    reduced: Array = function.reduceat(np.append(values, values[-1]), edges)[::2]
    return reduced


def _measure(caps: LimitCurve, nodes: Nodes) -> _Spans:
    """Look up what the caps say between neighbouring nodes."""
    s, end = nodes.s1[:-1], nodes.s0[1:]
    first, last = _inside(caps, np.searchsorted(caps.s, s, side="right") - 1, np.searchsorted(caps.s, end, side="left"))
    # Two plateaus that touch at a joint leave nothing between them.
    first, last = np.minimum(first, last), np.maximum(first, last)
    cross = _over(np.minimum, caps.cross, first, last)
    # The cross term falls off steeply beside a tight bend. Where it binds nodes are added, until only the
    # bend's own neighbourhood has to go by its worst.
    a = np.where(last - first > _SHORT, _over(np.minimum, caps.acceleration, first, last), cross)
    return _Spans(
        s,
        np.maximum(end - s, 0.0),
        first,
        last,
        _over(np.maximum, caps.soft, first, last),
        _over(np.minimum, caps.hard, first, last),
        a,
        cross,
        _over(np.minimum, caps.jerk, first, last),
    )


def _lower(level: Array, spans: _Spans) -> Array:
    """Lower nodes that cannot be reached from a neighbour: forward for speeding up, backward for braking."""
    level = level.copy()
    _forward(level, spans.distance, spans.a, spans.j)
    _forward(level[::-1], spans.distance[::-1], spans.a[::-1], spans.j[::-1])
    return level


def _forward(level: Array, distance: Array, a: Array, j: Array) -> None:
    finite = np.where(np.isinf(level), 0.0, level)
    far = speed_ramps.ramp_distance(finite[:-1], finite[1:], a, j) > distance
    for start in np.flatnonzero(far & (level[1:] > level[:-1])).tolist():
        k = start
        while k < distance.size and level[k + 1] > level[k]:
            most = speed_ramps.reachable(float(level[k]), float(distance[k]), float(a[k]), float(j[k]))
            if most >= level[k + 1]:
                break
            level[k + 1] = most
            k += 1


def _find_worst(caps: LimitCurve, spans: _Spans, curves: _Curves, changed: BoolArray) -> IntArray:
    """Grid indices at which nodes are needed: the worst points of every stretch that breaks a limit."""
    ramps = (curves.peak > curves.v0) | (curves.peak > curves.v1)
    suspect = (curves.peak > spans.floor * (1.0 + _ROUNDING)) | (ramps & (spans.a > spans.cross))
    rows = np.flatnonzero(suspect & changed)
    if not rows.size:
        return rows
    counts = spans.last[rows] - spans.first[rows] + 1
    row = np.repeat(rows, counts)
    index = np.arange(row.size) + np.repeat(spans.first[rows] - (np.cumsum(counts) - counts), counts)
    x = caps.s[index] - spans.s[row]
    inside = (x > 0.0) & (x < spans.distance[row])
    row, index, x = row[inside], index[inside], x[inside]
    excess = _excess(caps, index, _Spans(*(part[row] for part in spans)), _Curves(*(p[row] for p in curves)), x)
    broken = excess > 1.0 + _ROUNDING
    return _worst_of_stretches(row[broken], index[broken], excess[broken])


def _excess(caps: LimitCurve, index: IntArray, spans: _Spans, curves: _Curves, x: Array) -> Array:
    """Largest ratio of what is used to what is allowed at the distance `x` into spans, all arrays (n,)."""
    v0, peak, v1 = curves
    up = x < speed_ramps.ramp_distance(v0, peak, spans.a, spans.j)
    back = spans.distance - x
    down = ~up & (back < speed_ramps.ramp_distance(v1, peak, spans.a, spans.j))
    speed, acceleration = peak.copy(), np.zeros(x.size)
    for on, low, along in ((up, v0, x), (down, v1, back)):
        state = speed_ramps.state_on_ramp(low[on], peak[on], along[on], spans.a[on], spans.j[on])
        speed[on], acceleration[on] = state
    v, a = speed[:, None], acceleration[:, None]
    j = np.where(up | down, spans.j, 0.0)[:, None]
    tangent, normal, bend = caps.tangent[index], caps.normal[index], caps.bend[index]
    used_a = (normal * v**2 + tangent * a) / caps.room_a[index]
    used_j = (bend * v**3 + 3.0 * normal * v * a + tangent * j) / caps.room_j[index]
    excess: Array = np.maximum(largest(np.maximum(used_a, used_j)), speed / caps.hard[index])
    return excess


def _worst_of_stretches(row: IntArray, index: IntArray, excess: Array) -> IntArray:
    """First and last of the worst points in every run of neighbouring indices within one span."""
    if not index.size:
        return index
    new = np.concatenate([[True], (np.diff(index) != 1) | (np.diff(row) != 0)])
    stretch = np.cumsum(new) - 1
    worst = np.maximum.reduceat(excess, np.flatnonzero(new))
    tied = np.flatnonzero(excess >= _TIES * worst[stretch])
    _, first = np.unique(stretch[tied], return_index=True)
    _, last = np.unique(stretch[tied][::-1], return_index=True)
    return np.unique(np.concatenate([index[tied[first]], index[tied[::-1][last]]]))


def _insert(caps: LimitCurve, nodes: Nodes, index: IntArray, found_good: Array) -> tuple[Nodes, Array]:
    """Add point nodes at grid points; the two sides of a joint are one place."""
    index = index[np.diff(caps.s[index], prepend=-1.0) > 0.0]
    s = caps.s[index]
    at = np.searchsorted(nodes.s1, s)
    found_good[:, at - 1] = np.nan
    more = Nodes(
        s0=np.insert(nodes.s0, at, s),
        s1=np.insert(nodes.s1, at, s),
        level=np.insert(nodes.level, at, caps.soft[index]),
        window=np.insert(nodes.window, at, -1),
    )
    return more, np.insert(found_good, at, np.nan, axis=1)


def _schedule(nodes: Nodes, spans: _Spans, curves: _Curves) -> Schedule:
    """Lay plateaus and ramps one after the other; each begins where its node is, so that nothing adds up."""
    times, speeds = speed_ramps.curve_phases(curves.v0, curves.peak, curves.v1, spans.distance, spans.a, spans.j)
    m = nodes.level.size
    duration, speed, s = np.zeros((m, 8)), np.zeros((m, 8, 3)), np.zeros((m, 8))
    length = nodes.s1 - nodes.s0
    duration[:, 0] = length / np.where(length > 0.0, nodes.level, 1.0)
    speed[:, 0], s[:, 0] = nodes.level[:, None], nodes.s0
    duration[:-1, 1:], speed[:-1, 1:] = times, speeds
    travelled = np.cumsum(times * speeds.mean(axis=2), axis=1)
    s[:-1, 1] = spans.s
    s[:-1, 2:] = spans.s[:, None] + travelled[:, :-1]
    window = np.full((m, 8), -1)
    window[:, 0] = nodes.window
    kept = duration > 0.0
    return Schedule(s=s[kept], duration=duration[kept], speed=speed[kept], window=window[kept])
