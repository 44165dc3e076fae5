"""Blocks on the grid of the dialect's decimals, each with its time; jogs and the offsets between them.

An arc whose points are all shifted is still an arc; an offset changes only where the path stands still, between
two dwells, so that no move spans a change and no blending can swallow one.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np

from ph_post.compensate.motion import MotionLaw
from ph_post.dialects.base import Dialect
from ph_post.errors import InputError
from ph_post.gcode.arcs import swept_angle
from ph_post.gcode.blocks import ARC, DWELL, JOG, POLYNOMIAL, SPLINE, Blocks, Moves, TrackShape
from ph_post.gcode.numbers import to_counts
from ph_post.gcode.polynomials import cubic_control, polynomial_words
from ph_post.post.feeds import FeedSchedule, schedule_feeds
from ph_post.types import Array, IntArray, Jog, Phase, Plan, take
from ph_post.units import MM, MM_PER_MIN

FINEST = 20
"""Steps of a dialect's last decimal in the smallest jog that is written: rounding then takes 5 % at most."""


class CarriedOffset(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Offset added to blocks: `offset` (n + 1, dim) [m] at the start and at the end of each.

    `feed` (n,) [m/s] is the speed of jogs, 0 for all other blocks.
    """

    offset: Array
    feed: Array


class Jogs(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The jogs of a plan that are written, in the order of time, and the `phases` in which they lie.

    `first` (dim,) [m] is the offset with which the path begins. The jogs by which a plan comes onto it are not
    among them: they are the program's approach.
    """

    phases: tuple[Phase, ...]
    jogs: tuple[Jog, ...]
    first: Array


def read_jogs(plan: Plan) -> Jogs:
    """Take the jogs out of a plan; a plan for a table has none, and its path is written as it is."""
    axes = plan.path.axes
    jogs = tuple(one for one in plan.crossings if isinstance(one, Jog))
    first = np.array([plan.bias.get(axis, 0.0) if jogs else 0.0 for axis in axes])
    approach = [jog for jog in jogs if jog.start == 0.0]
    if not approach:
        return Jogs(phases=plan.phases, jogs=jogs, first=first)
    for jog in approach:
        first[axes.index(jog.axis)] += jog.travel
    past = plan.phases[0].duration
    return Jogs(
        phases=tuple(msgspec.structs.replace(one, start=one.start - past) for one in plan.phases[1:]),
        jogs=tuple(msgspec.structs.replace(one, start=one.start - past) for one in jogs[len(approach) :]),
        first=first,
    )


def check_jogs(jogs: Sequence[Jog], dialect: Dialect) -> None:
    """Refuse jogs that a dialect cannot carry.

    Raises
    ------
    InputError
        Where its decimals are too few for them, or the axes do not stand still in its dwells.
    """
    if not jogs:
        return
    if not dialect.abilities.dwells:
        what = f"the dialect {dialect.name} has no dwell in which the axes stand still, as an offset needs it"
        raise InputError("--dialect", what, expected="another dialect, or --feed-only", got=dialect.name)
    least = FINEST * dialect.numbers.quantum
    smallest = min(jogs, key=lambda jog: abs(jog.travel))
    if abs(smallest.travel) < least:
        raise InputError(
            "--dialect",
            f"the decimals of {dialect.name} are too few for an offset of axis {smallest.axis}",
            expected=f">= {least / MM:g} mm",
            got=f"{abs(smallest.travel) / MM:.3g} mm",
        )


def with_jogs(blocks: Blocks, found: Jogs, axes: Sequence[str]) -> tuple[Blocks, CarriedOffset]:
    """Cut dwells at the jogs in them, and find the offset that is carried at every end of a block."""
    begins = np.array([jog.start for jog in found.jogs])
    ends = np.array([jog.end for jog in found.jogs])
    rows: list[tuple[int, float, float, int]] = []
    for number, (kind, start, end) in enumerate(
        zip(blocks.kind.tolist(), blocks.start.tolist(), blocks.end.tolist(), strict=True)
    ):
        inside = np.flatnonzero((begins >= start) & (ends <= end)).tolist() if kind == DWELL else []
        edges = [start, *(edge for jog in inside for edge in (begins[jog], ends[jog])), end]
        jogs = [which for jog in inside for which in (-1, jog)] + [-1]
        rows += [(number, a, b, jog) for (a, b), jog in zip(pairwise(edges), jogs, strict=True)]
    source = np.array([row[0] for row in rows])
    which = np.array([row[3] for row in rows])
    cut = msgspec.structs.replace(
        take(blocks, source),
        start=np.array([row[1] for row in rows]),
        end=np.array([row[2] for row in rows]),
        kind=np.where(which >= 0, JOG, blocks.kind[source]),
    )
    return cut, _carried(found, which.tolist(), axes)


def _carried(found: Jogs, which: Sequence[int], axes: Sequence[str]) -> CarriedOffset:
    """Add the jogs up; `which` is the number of the jog that a block is, -1 for others."""
    missing = sorted(set(range(len(found.jogs))) - set(which))
    if missing:
        jog = found.jogs[missing[0]]
        what = f"the jog of axis {jog.axis} does not lie in a rest of the path"
        raise InputError("plan", what, expected="a plan made for a program", got=f"{jog.start:.6g} s")
    offset, feed = np.tile(found.first, (len(which) + 1, 1)), np.zeros(len(which))
    for row, number in enumerate(which):
        if number >= 0:
            jog = found.jogs[number]
            offset[row + 1 :, axes.index(jog.axis)] += jog.travel
            feed[row] = jog.velocity
    # What is out and back again leaves nothing but rounding.
    return CarriedOffset(offset=np.where(np.abs(offset) < _NOTHING, 0.0, offset), feed=feed)


_NOTHING = 1e-12
"""Offsets [m] smaller than this are rounding."""


LEAST_MOVE = 1e-3 * MM
"""Blocks of a ramp that are shorter along the path [m] join a neighbour: 1 µm is about a step of most machines' axes,
and no more than a chord may be off the path."""

FEED_DIGITS = 5
"""Significant digits of feeds in mm/min: the feed of a block is off by 5e-5 of itself at most, a hundredth of what a
real planner is off the plan in a ramp."""

_FEED_ROUNDING = 1e-4
"""A feed that differs from the planned one by no more than this part is written as that: a tenth of what the
time may err."""


def join_short_blocks(blocks: Blocks, shape: TrackShape, carried: CarriedOffset) -> tuple[Blocks, CarriedOffset]:
    """Join blocks of ramps that are shorter than `LEAST_MOVE` to a neighbour; the times add up.

    Only blocks of one kind on one piece of the path are joined, inside one stretch and in one direction, so that
    every place where the motion stops, turns back or changes its offset stays the end of a block.
    """
    length = blocks.s1 - blocks.s0
    piece = shape.piece_at(0.5 * (blocks.s0 + blocks.s1))
    able = (blocks.timed == 1) & (blocks.rapid == 0) & ~np.isin(blocks.kind, (DWELL, JOG)) & (length != 0.0)
    same = able[1:] & able[:-1]
    for column in (blocks.stretch, piece, blocks.kind, np.sign(length)):
        same &= column[1:] == column[:-1]
    begins = np.append(0, 1 + np.flatnonzero(~same))
    short = np.logical_or.reduceat(able & (np.abs(length) < LEAST_MOVE), begins)
    first = np.arange(length.size)
    for begin, end in zip(begins[short].tolist(), np.append(begins[1:], length.size)[short].tolist(), strict=True):
        first[begin:end] = _joined(np.abs(length[begin:end])) + begin
    last = np.flatnonzero(np.append(first[1:] != first[:-1], True))
    joined = msgspec.structs.replace(take(blocks, last), start=blocks.start[first[last]], s0=blocks.s0[first[last]])
    return joined, CarriedOffset(offset=carried.offset[np.append(0, last + 1)], feed=carried.feed[last])


def _joined(length: Array) -> IntArray:
    """Return the first block (n,) of the group that each of some neighbours belongs to, none shorter than allowed.

    Examples
    --------
    >>> _joined(np.array([1e-9, 4e-7, 8e-7, 3e-6, 5e-7])).tolist()
    [0, 0, 0, 3, 3]
    """
    first, begin, sofar = [], 0, 0.0
    for number, size in enumerate(length.tolist()):
        if sofar >= LEAST_MOVE:
            begin, sofar = number, 0.0
        first.append(begin)
        sofar += size
    found = np.array(first, dtype=np.int64)
    if sofar < LEAST_MOVE and begin > 0:
        found[begin:] = found[begin - 1]
    return found


def _readable(feed: Array, digits: int) -> Array:
    """Round feeds [m/s] to so many significant digits in mm/min; 0 stays 0.

    Examples
    --------
    >>> (_readable(np.array([216.705, 1200.0, 0.0]) * MM_PER_MIN, 4) / MM_PER_MIN).round(9).tolist()
    [216.7, 1200.0, 0.0]
    """
    value = feed / MM_PER_MIN
    step = 10.0 ** (np.floor(np.log10(np.where(value > 0.0, value, 1.0))) + 1.0 - digits)
    return np.asarray(np.round(value / step) * step * MM_PER_MIN)


def round_blocks(
    blocks: Blocks, shape: TrackShape, dialect: Dialect, carried: CarriedOffset, phases: Sequence[Phase]
) -> Moves:
    """Put blocks on the grid; those that come out with no length give their time to a neighbour.

    All points of one circle share one centre, so that radii at the start and at the end of an arc differ by
    no more than the rounding of the two points. `phases` are the phases of the motion, for dialects whose feed
    can change within a block.
    """
    if not dialect.abilities.feed_degree:
        blocks, carried = join_short_blocks(blocks, shape, carried)
    decimals = dialect.numbers.decimals
    path = shape.positions(np.append(blocks.s0[:1], blocks.s1))
    points = to_counts(path + carried.offset, decimals)
    moving = (np.diff(points, axis=0) != 0).any(axis=1) | (blocks.kind == DWELL)
    duration = _inherited(blocks.end - blocks.start, moving)
    kept = np.flatnonzero(moving)
    blocks = take(blocks, kept)
    points, offset = points[np.append(0, kept + 1)], carried.offset[kept + 1]
    piece = shape.piece_at(0.5 * (blocks.s0 + blocks.s1))
    center = to_counts(shape.center[piece] + offset[:, :2], decimals)
    way = np.sign(blocks.s1 - blocks.s0).astype(np.int64)
    turn = np.where(blocks.kind == ARC, shape.turn[piece] * way, 0)
    length = _lengths(blocks, points, center, turn, decimals)
    cuts = _readable(_feeds(blocks, length, duration), FEED_DIGITS)
    feed = np.where(blocks.kind == JOG, _readable(carried.feed[kept], FEED_DIGITS + 1), cuts)
    course = FeedSchedule(feed=feed, profiles={}, off={})
    if dialect.abilities.feed_degree:
        course = schedule_feeds(blocks, MotionLaw.from_phases(phases), feed, dialect.numbers.feed_digits)
    return Moves(
        kind=blocks.kind,
        points=points,
        plain=to_counts(path[-1], decimals),
        center=center,
        turn=turn,
        inner=_inner_points(blocks, shape, piece, offset, decimals),
        duration=duration,
        length=length,
        feed=course.feed,
        rapid=blocks.rapid,
        s0=blocks.s0,
        s1=blocks.s1,
        polynomials=polynomial_words(blocks, shape, piece, offset, decimals),
        profiles=course.profiles,
        off=course.off,
    )


def _inherited(duration: Array, moving: Array) -> Array:
    """Give the times of the blocks that do not move to those that do.

    A block without length gives its time to the next one that moves, so that a start from rest stays slow;
    at the end to the last one.
    """
    count = int(moving.sum())
    heir = np.minimum(np.cumsum(moving) - moving, max(count - 1, 0))
    return np.asarray(np.bincount(heir, duration, count)[:count], dtype=np.float64)


def _inner_points(blocks: Blocks, shape: TrackShape, piece: IntArray, offset: Array, decimals: int) -> IntArray:
    inner = np.zeros((piece.size, 2, 2), dtype=np.int64)
    spline = np.flatnonzero(blocks.kind == SPLINE)
    of = piece[spline]
    u0, u1 = shape.parameter_on(of, blocks.s0[spline]), shape.parameter_on(of, blocks.s1[spline])
    control = cubic_control(shape, of, u0, u1)[:, 1:3]
    inner[spline] = to_counts(control + offset[spline, np.newaxis, :2], decimals)
    return inner


def _lengths(blocks: Blocks, points: IntArray, center: IntArray, turn: IntArray, decimals: int) -> Array:
    """Length [m] of every move as it is written; that of a spline or a polynomial is the path's own."""
    chord = np.diff(points, axis=0).astype(np.float64)
    length = np.sqrt((chord * chord).sum(axis=1))
    arc = blocks.kind == ARC
    start = (points[:-1, :2] - center)[arc].astype(np.float64)
    end = (points[1:, :2] - center)[arc].astype(np.float64)
    length[arc] = 0.5 * (np.hypot(*start.T) + np.hypot(*end.T)) * swept_angle(start, end, turn[arc])
    length *= MM * 10.0**-decimals
    own = np.isin(blocks.kind, (SPLINE, POLYNOMIAL))
    length[own] = np.abs(blocks.s1 - blocks.s0)[own]
    return np.asarray(length)


def _feeds(blocks: Blocks, length: Array, duration: Array) -> Array:
    """Length over time; one feed for all moves of a constant-speed stretch, so that it is written once.

    There it is the planned one, unless chords are so much shorter than what they span that it shows.
    """
    works = (blocks.rapid == 0) & (blocks.kind != DWELL)
    feed = np.where(works, length / duration, 0.0)
    held = np.flatnonzero(works & (blocks.timed == 0))
    of = np.unique(blocks.stretch[held], return_inverse=True)[1]
    time = np.bincount(of, duration[held])
    written = np.bincount(of, length[held]) / time
    planned = np.bincount(of, np.abs(blocks.s1 - blocks.s0)[held]) / time
    feed[held] = np.where(np.abs(written - planned) <= _FEED_ROUNDING * planned, planned, written)[of]
    return np.asarray(feed)
