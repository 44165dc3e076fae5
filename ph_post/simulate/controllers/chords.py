"""The straight blocks that an exact-path controller gets of a program: lines, chords of arcs and of splines.

The counts of chords are those of the firmware: Grbl's `mc_arc`, Klipper's `planArc` (`gcode_arcs.py`), Marlin's
`plan_arc` (`G2_G3.cpp`), and for G5 grblHAL's `mc_cubic_b_spline`, which Marlin has too. The last chord of each
ends where the program says.
"""

from __future__ import annotations

import math
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ph_post.bounds import check_places, give_memory_back
from ph_post.gcode.curves import curves_of
from ph_post.gcode.program import ARC, CUBIC, NURBS, RAPID, Motions, PartProgram
from ph_post.simulate.controllers.legs import NURBS_SPANS, SHORTEST, Legs
from ph_post.simulate.controllers.unknown import known_ends
from ph_post.types import Array, BoolArray, ExactPath, GrblChords, IntArray, KlipperChords, sealed, unwritten
from ph_post.units import MINUTE

_WIDEST: Final = 0.1
"""Steps of the parameter of a cubic that are made longer only once."""

_NARROWEST: Final = 0.002
"""Steps of the parameter of a cubic that are not halved any more."""

_FLAT: Final = 1e-4
"""Sum of the distances in X and Y [m] at which the middle of a step is still on its chord."""

_WHOLE: Final = 1e-9
"""What a whole number of chords may lack by rounding."""


_BEFORE_TRIM: Final = 32
"""Parts that are joined before the memory of their columns is given back."""

_COUNTABLE: Final = 1e15
"""Chords of one arc that are counted; far fewer are run."""


_NOTHING: Final = sealed(np.zeros(0))


class StraightBlocks(NamedTuple):
    """Straight blocks, n of them, in the order of travel. SI units.

    `start`, `end`, `unit` (n, 3); `length`, `speed` [m/s] and `push`, the acceleration [m/s²] (n,). `motion` is the
    program's motion that each is part of, from `share0` to `share1` of it. `joined` is false where a block begins at
    rest, after the axes waited for `pause` [s]. Of a program of which no row is wanted `start`, `end`, `unit`, `share0`
    and `share1` are empty, and `corner` (n,) has what corners allow where blocks begin [m²/s²], as if all were joined.
    """

    start: Array
    end: Array
    unit: Array
    length: Array
    speed: Array
    push: Array
    motion: NDArray[np.int32]
    share0: Array
    share1: Array
    joined: BoolArray
    pause: Array
    corner: Array = _NOTHING


def straight_blocks(
    program: PartProgram, legs: Legs, limits: Array, planner: ExactPath, begin: Array | None = None
) -> StraightBlocks:
    """Return the blocks that a controller makes of a program.

    Parameters
    ----------
    program : PartProgram
    legs : Legs
        Its motions, one each, in which splines are straight.
    limits : Array, shape (3, 2)
        Velocity [m/s] and acceleration [m/s²] of the axes.
    planner : ExactPath
    begin : Array, shape (3,), optional
        Place where it begins, if that is known [m].

    Returns
    -------
    StraightBlocks
        Those that have a length.
    """
    motions = program.motions
    splines = np.flatnonzero(np.isin(motions.kind, (CUBIC, NURBS))).tolist()
    played = {k: _spline_points(motions, k) for k in splines}
    count = _counts(legs, motions, planner)
    count[splines] = [share.size - 1 for share, _ in played.values()]
    check_places(program.name, "its arcs have too many chords to be run", count.sum(dtype=np.float64), "fewer turns")
    row = np.repeat(np.arange(count.size), count)
    number = np.arange(row.size) - (np.cumsum(count) - count)[row]
    share0, share1 = number / count[row], (number + 1) / count[row]
    start, end = _arc_points(legs, row, share0), _arc_points(legs, row, share1)
    whole = known_ends(program) if begin is None else known_ends(program, begin)
    first, last = number == 0, number + 1 == count[row]
    start[first], end[last] = whole[0][row[first]], whole[1][row[last]]
    for k, (places, points) in played.items():
        here = np.flatnonzero(row == k)
        start[here], end[here] = points[:-1], points[1:]
        share0[here], share1[here] = places[:-1], places[1:]
    way = end - start
    length = np.sqrt((way * way).sum(axis=1))
    kept = np.flatnonzero(length > SHORTEST)
    row, length = row[kept], length[kept]
    unit = way[kept] / length[:, None]
    fast, push = limits_along(unit, limits, shared=planner.shared_limits)
    pause, joined = rests_before(legs.pause, legs.drains, row, planner)
    return StraightBlocks(
        start=start[kept],
        end=end[kept],
        unit=np.ascontiguousarray(unit),
        length=length,
        speed=np.minimum(_asked(program, legs, planner)[row], fast),
        push=push,
        motion=row.astype(np.int32),
        share0=share0[kept],
        share1=share1[kept],
        joined=joined,
        pause=pause,
    )


def _counts(legs: Legs, motions: Motions, planner: ExactPath) -> IntArray:
    """Count the blocks of every motion, one for a spline."""
    count = np.ones(legs.length.size, dtype=np.int64)
    arcs = np.flatnonzero(motions.kind == ARC)
    count[arcs] = chord_counts(planner, legs.radius[arcs], legs.sweep[arcs], legs.length[arcs])
    return count


def chord_counts(planner: ExactPath, radius: Array, sweep: Array, length: Array) -> IntArray:
    """Return the numbers of chords of arcs.

    Parameters
    ----------
    planner : ExactPath
    radius, sweep, length : Array, shape (n,)
        Radius [m], angle [rad], and length with the rise [m].

    Examples
    --------
    >>> from ph_post.dialects.grbl import PLANNER
    >>> circle = np.array([0.02]), np.array([math.tau]), np.array([math.tau * 0.02])
    >>> chord_counts(PLANNER, *circle).tolist()
    [222]
    """
    chords, turn = planner.chords, np.abs(sweep)
    if isinstance(chords, GrblChords):
        tolerance = np.minimum(chords.tolerance, radius)
        found = 0.5 * turn * radius / np.sqrt(tolerance * (2.0 * radius - tolerance))
    elif isinstance(chords, KlipperChords):
        found = length / chords.length
    else:
        flat = radius * turn
        least = np.ceil(chords.per_turn * turn / math.tau - _WHOLE)
        found = np.maximum(np.floor(flat / chords.longest + _WHOLE), least)
        size = flat / np.maximum(found, 1.0)
        few, many = np.ceil(flat / chords.longest - _WHOLE), np.floor(flat / chords.shortest + _WHOLE)
        found = np.where(size > chords.longest, few, np.where(size < chords.shortest, many, found))
    return np.clip(np.floor(found + _WHOLE), 1.0, _COUNTABLE).astype(np.int64)


def chord_errors(planner: ExactPath, radius: Array, sweep: Array, length: Array) -> Array:
    """Return how far the chords of arcs are off them [m], towards their centres, shape (n,).

    Parameters
    ----------
    planner : ExactPath
    radius, sweep, length : Array, shape (n,)
        As of :func:`chord_counts`.

    Examples
    --------
    >>> from ph_post.dialects.klipper import DIALECT
    >>> circle = np.array([0.02]), np.array([math.tau]), np.array([math.tau * 0.02])
    >>> f"{chord_errors(DIALECT.planner, *circle)[0] * 1e6:.2f} µm"
    '6.32 µm'
    """
    half = 0.5 * np.abs(sweep) / chord_counts(planner, radius, sweep, length)
    return np.asarray(2.0 * radius * np.sin(0.5 * half) ** 2)


def _arc_points(legs: Legs, row: IntArray, share: Array) -> Array:
    """Return points of arcs and helices at shares of them; of lines, any point."""
    angle = (legs.sweep[row] * share)[:, None]
    ray = np.cos(angle) * legs.first[row] + np.sin(angle) * legs.second[row]
    return np.asarray(legs.origin[row] + legs.radius[row, None] * ray + share[:, None] * legs.rise[row])


def _spline_points(motions: Motions, number: int) -> tuple[Array, Array]:
    """Return shares of a spline between 0 and 1, and the points there (k, 3) [m]; Z stays where it is."""
    curve = curves_of(motions, number, (0, 1))[0]
    low, high = curve.domain
    if motions.kind[number] == CUBIC:
        share = _cubic_shares(motions.control[number][:, :2])
    else:
        share = np.linspace(0.0, 1.0, 2 * NURBS_SPANS * len(motions.nurbs[number][1]) + 1)
    points = np.zeros((share.size, 3))
    points[:, :2] = curve.derivatives(low + share * (high - low), 0)[0]
    points[:, 2] = np.nan_to_num(motions.start[number, 2])
    return share, points


def _cubic_shares(control: Array) -> Array:
    """Return parameters between which a cubic (4, 2) is played as straight moves."""

    def at(u: float) -> Array:
        v = 1.0 - u
        return np.asarray(np.array([v**3, 3.0 * u * v**2, 3.0 * u**2 * v, u**3]) @ control)

    def is_flat(one: float, middle: float, two: float) -> bool:
        return float(np.abs(at(middle) - 0.5 * (at(one) + at(two))).sum()) <= _FLAT

    found, step = [0.0], _WIDEST
    while (done := found[-1]) < 1.0:
        new = min(done + step, 1.0)
        halved = False
        while new - done >= _NARROWEST and not is_flat(done, 0.5 * (done + new), new):
            new, halved = 0.5 * (done + new), True
        while not halved and new - done <= _WIDEST and (wider := done + 2.0 * (new - done)) < 1.0:
            if not is_flat(done, new, wider):
                break
            new = wider
        step = new - done
        found.append(new)
    return np.array(found)


def limits_along(unit: Array, limits: Array, *, shared: bool = False) -> tuple[Array, Array]:
    """Return speed [m/s] and acceleration [m/s²] that the axes can in these directions (n, 3).

    Where they are `shared`, X and Y have one limit, that of the motion along the path.
    """
    with np.errstate(divide="ignore"):
        found = np.array([limits[:, column] / np.abs(unit) for column in (0, 1)])
    if shared:
        found[:, :, :2] = limits[:2].min(axis=0)[:, None, None]
    fast, push = found.min(axis=2)
    return fast, push


def _asked(program: PartProgram, legs: Legs, planner: ExactPath) -> Array:
    """Return the speed that the program asks for, by motion [m/s]."""
    motions = program.motions
    timed = motions.duration > 0.0
    asked = np.where(timed, legs.length / np.where(timed, motions.duration, 1.0), motions.feed)
    free = (motions.kind == RAPID) | ~(asked > 0.0)
    others = np.full(asked.size, math.inf)
    if planner.rapid_feed is not None:
        units = np.array([state.units for state in program.modal] or [1.0])[program.state[motions.block]]
        words = program.feeds.of(motions.block) * units / MINUTE
        others = np.where(words > 0.0, words, planner.rapid_feed)
    return np.asarray(np.maximum(np.where(free, others, asked), planner.least_feed))


def rests_before(
    pauses: Array, drains: Array, row: IntArray | NDArray[np.int32], planner: ExactPath
) -> tuple[Array, BoolArray]:
    """Return how long the axes rest before each block [s], and true where the planner does not run dry before it.

    What is asked for before a motion that has no block comes before the next that has.

    Parameters
    ----------
    pauses, drains : Array, shape (motions,)
        Rests asked for before motions [s], and 1 where the planner runs dry before them.
    row : IntArray, shape (n,)
        Motion of each block.
    planner : ExactPath
    """
    asked = np.flatnonzero((pauses != 0.0) | (drains != 0.0))
    at = np.searchsorted(row, asked.astype(row.dtype))
    asked, at = asked[at < row.size], at[at < row.size]
    pause, joined = unwritten(row.size), np.ones(row.size, dtype=np.bool_)
    np.add.at(pause, at, planner.dwell(pauses[asked]))
    joined[at[drains[asked] > 0.0]] = False
    joined[:1], pause[:1] = False, 0.0
    return pause, joined


def without_rests(blocks: StraightBlocks) -> StraightBlocks:
    """Return blocks of a part of a program, without their rests, which :func:`rests_before` finds for all of it."""
    return blocks._replace(joined=np.zeros(0, dtype=np.bool_), pause=np.zeros(0))


def without_places(blocks: StraightBlocks, corner: Array) -> StraightBlocks:
    """Return blocks of which no row is wanted, with what corners allow [m²/s²]."""
    place = np.zeros((0, 3))
    return blocks._replace(start=place, end=place, unit=place, share0=_NOTHING, share1=_NOTHING, corner=corner)


def join_blocks(parts: list[StraightBlocks]) -> StraightBlocks:
    """Put the blocks of parts of a program, at least one, one behind the other; the list is emptied."""
    # Column by column and part by part, so that the parts and the whole are not both there.
    columns = [list(column) for column in zip(*parts, strict=True)]
    parts.clear()
    return StraightBlocks(*(_joined(columns.pop(0)) for _ in StraightBlocks._fields))


def _joined(parts: list[Any]) -> Any:
    """Put parts one behind the other; the list is emptied."""
    at = sum(map(len, parts))
    whole = np.empty((at, *parts[0].shape[1:]), dtype=np.result_type(*parts))
    while parts:
        part = parts.pop()
        whole[at - len(part) : at] = part
        at -= len(part)
        if len(parts) % _BEFORE_TRIM == 0:
            del part
            give_memory_back(len(whole))
    return whole
