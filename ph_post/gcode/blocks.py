"""The motion cut into blocks: each one move of one kind with its share of the planned time."""

from __future__ import annotations

import msgspec
import numpy as np

from ph_post.compensate.motion import Motion
from ph_post.gcode.chords import Gauge, shares
from ph_post.gcode.dialect import Dialect, plane_of
from ph_post.gcode.feedcuts import cut_stretches, feed_blocks
from ph_post.gcode.options import ProgramOptions
from ph_post.gcode.record import DWELL, Blocks
from ph_post.gcode.shape import ARC, CURVE, LINE, POLYNOMIAL, SNAP, SPLINE, Shape, read_shape
from ph_post.gcode.slivers import without_slivers
from ph_post.gcode.splines import cut_cubics
from ph_post.gcode.stretches import Runs, Stretch, find_runs, find_stretches
from ph_post.geometry.track import Track
from ph_post.types import Array, IntArray, Plan
from ph_post.units import MM


def cut_blocks(plan: Plan, track: Track, dialect: Dialect, options: ProgramOptions) -> tuple[Blocks, Shape]:
    """Cut a plan into blocks.

    Where the speed is constant a block is as long as the geometry allows: a line or an arc is one move (arcs
    up to half a turn), a cubic one G5 where the dialect's own rendering of it holds the chord tolerance, what
    the dialect has polynomials for is one of them, and the rest is chords within that tolerance. In ramps and
    dips a block lasts at most `options.block_time`, or as long as its feed can be a polynomial of the way.

    Returns
    -------
    Blocks, Shape
    """
    inverse = options.feed_mode == "inverse-time"
    abilities, plane = dialect.capabilities, plane_of(plan.path.axes)[0]
    in_xy = plane == "G17"
    shape = read_shape(
        track,
        arcs=abilities.arcs and plane in dialect.arc_planes and (dialect.inverse_time_arcs or not inverse),
        splines=abilities.cubic_splines and in_xy and (dialect.inverse_time_splines or not inverse),
        degree=abilities.polynomial_degree,
    )
    motion = Motion.from_phases(plan.phases)
    period = plan.machine.servo_period
    stretches = find_stretches(plan.phases, shape)
    if abilities.feed_degree:
        cuts = cut_stretches(stretches, shape, motion, period)
        stretches, timed = [one.stretch for one in cuts], feed_blocks(cuts)
    else:
        timed = _by_time(stretches, options.block_time)
    runs = _with_splines(
        find_runs(stretches, shape), stretches, shape, dialect, period, options.chord_tolerance
    )
    blocks = _in_order(_by_geometry(runs, stretches, shape, options.chord_tolerance), timed)
    blocks = _with_curves(_with_places(blocks, motion, shape), shape, dialect)
    blocks = without_slivers(blocks, shape, period, options.block_time)
    return _within_tolerance(blocks, motion, shape, options.chord_tolerance), shape


def _with_splines(
    runs: Runs, stretches: list[Stretch], shape: Shape, dialect: Dialect, period: float, tolerance: float
) -> Runs:
    """Decide what becomes G5; what cannot becomes curves."""
    rapid = np.array([stretch.rapid for stretch in stretches], dtype=bool)[runs.stretch]
    kind = np.where(rapid & (runs.kind != LINE), CURVE, runs.kind)
    cubic = np.flatnonzero(kind == SPLINE)
    if not cubic.size or dialect.spline_deviation is None:
        return msgspec.structs.replace(runs, kind=kind)
    speed = np.array([abs(one.s1 - one.s0) / (one.end - one.start) for one in stretches])[runs.stretch]
    parts = cut_cubics(
        shape,
        dialect.spline_deviation,
        runs.piece[cubic],
        (runs.s0 - runs.base)[cubic],
        (runs.s1 - runs.base)[cubic],
        least=dialect.spline_pieces * period * speed[cubic],
        tolerance=tolerance,
    )
    rest = np.flatnonzero(kind != SPLINE)
    source = np.concatenate([rest, cubic[parts.run]])
    order = np.argsort(source, kind="stable")
    source = source[order]
    base = runs.base[source]
    return Runs(
        stretch=runs.stretch[source],
        s0=np.concatenate([runs.s0[rest], parts.s0 + runs.base[cubic[parts.run]]])[order],
        s1=np.concatenate([runs.s1[rest], parts.s1 + runs.base[cubic[parts.run]]])[order],
        kind=np.concatenate([kind[rest], np.where(parts.smooth, SPLINE, CURVE)])[order],
        piece=runs.piece[source],
        base=base,
    )


def _by_geometry(runs: Runs, stretches: list[Stretch], shape: Shape, tolerance: float) -> Blocks:
    """Blocks as long as the geometry allows, in time as in place."""
    gauge = Gauge(shape.track, tolerance)
    c0, c1 = gauge.count(runs.s0 - runs.base), gauge.count(runs.s1 - runs.base)
    # arcs of at most half a turn: the end of a longer one could be taken for its start
    halves = np.abs(runs.s1 - runs.s0) / shape.radius[runs.piece] / np.pi
    chords = np.where(runs.kind == CURVE, np.abs(c1 - c0), np.where(runs.kind == ARC, halves, 1.0))
    run, low, high = _shared(_ceil(chords))
    s0, s1, curved = runs.s0[run], runs.s1[run], runs.kind[run] == CURVE

    def places(share: Array) -> Array:
        s = s0 + share * (s1 - s0)
        inner = curved & (share > 0.0) & (share < 1.0)
        count = c0[run] + share * (c1 - c0)[run]
        s[inner] = gauge.place(count[inner]) + runs.base[run[inner]]
        return np.where(share < 1.0, s, s1)

    table = np.array([(one.start, one.end, one.s0, one.s1, one.rapid) for one in stretches])
    start, end, first, last, rapid = table[runs.stretch[run]].T
    a, b = places(low), places(high)
    extent = np.where(last != first, last - first, 1.0)  # where nothing moves any share of the time will do
    rate = (end - start) / extent
    return Blocks(
        kind=np.where(curved, LINE, runs.kind[run]),
        start=start + (a - first) * rate,
        end=start + (b - first) * rate,
        s0=a,
        s1=b,
        rapid=rapid.astype(np.int64),
        stretch=runs.stretch[run],
        timed=np.zeros(run.size, dtype=np.int64),
    )


def _by_time(stretches: list[Stretch], block_time: float) -> Blocks:
    """Blocks of equal time in ramps and dips, an even number in windows so that the middle ends a block."""
    timed = [(number, one) for number, one in enumerate(stretches) if not one.by_geometry]
    number = np.array([row[0] for row in timed], dtype=np.int64)
    start, end = (np.array([getattr(one, name) for _, one in timed]) for name in ("start", "end"))
    dwells = np.array([one.span.kind == "dwell" for _, one in timed], dtype=bool)
    count = np.where(dwells, 1, _ceil((end - start) / block_time))
    count += count % 2 * np.array([one.span.window >= 0 for _, one in timed], dtype=np.int64) * ~dwells
    row, low, high = _shared(count)
    extent = (end - start)[row]
    return Blocks(
        kind=np.where(dwells, DWELL, LINE)[row],
        start=start[row] + low * extent,
        end=start[row] + high * extent,
        s0=np.zeros(row.size),
        s1=np.zeros(row.size),
        rapid=np.zeros(row.size, dtype=np.int64),
        stretch=number[row],
        timed=np.ones(row.size, dtype=np.int64),
    )


def _ceil(count: Array) -> IntArray:
    """Next whole number, at least 1, unless rounding alone has made it one more."""
    return np.maximum(1, np.ceil(count * (1.0 - 1e-9))).astype(np.int64)


def _shared(parts: IntArray) -> tuple[IntArray, Array, Array]:
    """Rows each repeated so many times, and between which shares of its row each repetition lies."""
    row = np.repeat(np.arange(parts.size), parts)
    number = np.arange(row.size) - np.repeat(np.cumsum(parts) - parts, parts)
    return row, number / parts[row], (number + 1) / parts[row]


def _in_order(*groups: Blocks) -> Blocks:
    names = Blocks.__struct_fields__
    joined = {name: np.concatenate([getattr(group, name) for group in groups]) for name in names}
    order = np.argsort(joined["stretch"], kind="stable")
    return Blocks(**{name: values[order] for name, values in joined.items()})


def _with_places(blocks: Blocks, motion: Motion, shape: Shape) -> Blocks:
    """Find the ends of the blocks in ramps from the times there; elsewhere they are given. Joints are met."""
    timed = np.flatnonzero(blocks.timed)
    s0, s1 = blocks.s0.copy(), blocks.s1.copy()
    s0[timed] = motion.place_and_feed(blocks.start[timed])[0]
    s1[timed] = motion.place_and_feed(blocks.end[timed])[0]
    return msgspec.structs.replace(blocks, s0=shape.snapped(s0), s1=shape.snapped(s1))


def _with_curves(blocks: Blocks, shape: Shape, dialect: Dialect) -> Blocks:
    """Make ramp blocks on one arc or polynomial that too, and lines of what decimals cannot tell from lines.

    In ramps chords would hold the tolerance as well, but LinuxCNC slows down where a chord meets an arc
    (measured: from 40 to 20 mm/s at the ends of a dip on R 20 mm), while arcs run into arcs at full speed.
    """
    piece = shape.piece_at(0.5 * (blocks.s0 + blocks.s1))
    inwards = np.clip(0.5 * (blocks.s1 - blocks.s0), -SNAP, SNAP)  # so that a joint counts as either side
    same = (shape.piece_at(blocks.s0 + inwards) == piece) & (shape.piece_at(blocks.s1 - inwards) == piece)
    timed = (blocks.timed == 1) & (blocks.kind == LINE) & same
    quantum = MM * 10.0**-dialect.capabilities.decimals
    bent = (blocks.s1 - blocks.s0) ** 2 >= 8.0 * quantum * shape.radius[piece]
    round_ = (blocks.kind == ARC) | (timed & (shape.kind[piece] == ARC))
    kind = np.where(round_, np.where(bent, ARC, LINE), blocks.kind)
    kind = np.where(timed & (shape.kind[piece] == POLYNOMIAL), POLYNOMIAL, kind)
    return msgspec.structs.replace(blocks, kind=kind)


def _within_tolerance(blocks: Blocks, motion: Motion, shape: Shape, tolerance: float) -> Blocks:
    """Cut chords that leave the path by more than the tolerance, in time, until none does."""
    first, last = shape.piece_at(blocks.s0), shape.piece_at(blocks.s1)
    straight = (first == last) & (shape.kind[first] == LINE)
    doubtful = (blocks.kind == LINE) & ~straight
    while doubtful.any():
        parts = np.ones(doubtful.size, dtype=np.int64)
        parts[doubtful] = shares(shape, blocks.s0[doubtful], blocks.s1[doubtful], tolerance)
        blocks = _with_places(_split(blocks, parts), motion, shape)
        doubtful = np.repeat(parts > 1, parts)
    return blocks


def _split(blocks: Blocks, parts: IntArray) -> Blocks:
    """Cut each block into so many parts, equal in time and, where the geometry decides, in length."""
    row, low, high = _shared(parts)
    cut = {name: getattr(blocks, name)[row] for name in Blocks.__struct_fields__}
    for first, last in (("start", "end"), ("s0", "s1")):
        begin, extent = cut[first], cut[last] - cut[first]
        cut[first], cut[last] = begin + low * extent, begin + high * extent
    return Blocks(**cut)
