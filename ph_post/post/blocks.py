"""Cut the motion into blocks: each is one move of one kind with its share of the planned time.

Chords end so that the curve stays within the chord tolerance; blocks shorter than the servo period are joined
to a neighbour.
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.bounds import MOST_BLOCKS, check_blocks
from ph_post.compensate.motion import MotionLaw
from ph_post.dialects.base import CubicAbility, Dialect
from ph_post.gcode.blocks import (
    ARC,
    CURVE,
    DWELL,
    LINE,
    POLYNOMIAL,
    SPLINE,
    Blocks,
    TrackShape,
    read_shape,
)
from ph_post.gcode.polynomials import cut_cubics
from ph_post.gcode.program import plane_of
from ph_post.geometry.piecewise import MEETS
from ph_post.geometry.track import Track
from ph_post.post.feeds import cut_stretches, feed_blocks
from ph_post.post.options import ProgramOptions
from ph_post.post.timeline import BlockRuns, MotionStretch, find_runs, find_stretches
from ph_post.types import Array, BoolArray, IntArray, Plan, join_rows, take

_SAMPLES = 33
"""Places a piece at which the curvature is looked at, to begin with; the deviation is checked afterwards."""

_PROBES = np.linspace(0.0, 1.0, 9)[1:-1]
"""Places at which the distance of a curve from its chord is taken: among them the middle, where a short piece
has its largest; a largest distance elsewhere is missed by less than (1/8)² of itself."""

_RESERVE = 1.0 - 1.0 / 8**2
"""Part of the chord tolerance that the distances found may take, for what the probes miss."""

_AIM = 0.94
"""The part of the tolerance that the count of chords aims at. Where the curvature changes some come out
worse than counted, and each that fails the check is cut in two: on sine waves 0.94 gives the fewest."""


class ChordGauge:
    """Number of chords along the path, ∫ √(κ / 8δ) ds, as a chord of length h leaves a circle by κ h² / 8.

    Parameters
    ----------
    track : Track
    tolerance : float
        δ, how far the curve may leave a chord [m].
    """

    def __init__(self, track: Track, tolerance: float) -> None:
        m = len(track.pieces)
        u = np.tile(np.linspace(0.0, 1.0, _SAMPLES), m)
        piece = np.repeat(np.arange(m), _SAMPLES)
        self._s = np.maximum.accumulate(track.arc_length(piece, u))
        _, first, second = track.derivatives(piece, u, 2)
        speed = np.sqrt((first * first).sum(axis=1))
        square = (first * first).sum(axis=1) * (second * second).sum(axis=1)
        area = np.sqrt(np.maximum(square - (first * second).sum(axis=1) ** 2, 0.0))
        # √κ ds = √(|r' × r''| / |r'|) du; what a cusp makes of it the check puts right
        rate = np.sqrt(np.divide(area, speed, out=np.zeros_like(area), where=speed > 0.0))
        rate /= np.sqrt(8.0 * _AIM * tolerance)
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(u)
        steps[_SAMPLES - 1 :: _SAMPLES] = 0.0
        # one chord a kilometre besides: keeps the count strictly growing where the path is straight
        self._count = np.concatenate([[0.0], np.cumsum(steps + 1e-3 * np.diff(self._s))])

    def count(self, s: Array) -> Array:
        """Return the number of chords from the path's beginning to places on it [m]."""
        return np.asarray(np.interp(s, self._s, self._count))

    def place(self, count: Array) -> Array:
        """Return the places [m] up to which there are so many chords."""
        return np.asarray(np.interp(count, self._count, self._s))


def chord_counts(shape: TrackShape, s0: Array, s1: Array, tolerance: float) -> IntArray:
    """Count the parts into which chords have to be cut, 1 where a chord holds the tolerance.

    Parameters
    ----------
    shape : TrackShape
    s0, s1 : Array, shape (n,)
        Ends of the chords, as places along the motion [m].
    tolerance : float
        Largest distance of the path between them from the straight move [m].

    Returns
    -------
    IntArray, shape (n,)
    """
    ratio = deviation(shape, s0, s1) / (tolerance * _RESERVE)
    most = 2.0 * MOST_BLOCKS  # more than may be written anyway
    return np.where(ratio > 1.0, np.clip(np.ceil(np.sqrt(ratio)), 2, most), 1).astype(np.int64)


def deviation(shape: TrackShape, s0: Array, s1: Array) -> Array:
    """Return the largest distances [m] of the path from the straight moves between `s0` and `s1`, all (n,)."""
    start, end = shape.positions(s0), shape.positions(s1)
    inner = shape.positions((s0[:, None] + (s1 - s0)[:, None] * _PROBES).ravel())
    offset = inner.reshape(s0.size, _PROBES.size, -1) - start[:, None]
    chord = (end - start)[:, None]
    square = (chord * chord).sum(-1)
    along = np.divide((offset * chord).sum(-1), square, out=np.zeros(offset.shape[:2]), where=square > 0.0)
    foot = np.clip(along, 0.0, 1.0)[..., None] * chord
    return np.asarray(np.sqrt(((offset - foot) ** 2).sum(-1)).max(axis=1))


_ROUNDING = 1.0 - 1e-9
"""A block that lasts a servo period but for rounding is long enough."""


def join_short_blocks(blocks: Blocks, shape: TrackShape, period: float, block_time: float) -> Blocks:
    """Join blocks shorter than a servo `period` [s] to a neighbour, where one can take them.

    They come from very short stretches, and from pieces of a path that are passed in less than a period.
    LinuxCNC spends a period on each, and nearly stops where rounding has turned its direction.

    A neighbour takes `block_time` [s] of them at most, nothing across a stop or a reversal, and only what lies
    on its own piece unless it is a chord: chords are checked and cut afterwards.
    """
    merger = _BlockJoiner(blocks, shape, block_time)
    short = (blocks.end - blocks.start < period * _ROUNDING) & (blocks.kind != DWELL)
    for i in np.flatnonzero(short).tolist():
        if merger.duration(i) < period * _ROUNDING:
            merger.give_away(i)
    return merger.result()


class _BlockJoiner:
    """Blocks of which some have gone into others; each is known by the number it had."""

    def __init__(self, blocks: Blocks, shape: TrackShape, most: float) -> None:
        self.blocks = blocks
        self.most = most
        self.piece = shape.piece_at(0.5 * (blocks.s0 + blocks.s1))
        self.open = _open_boundaries(blocks, shape)
        self.first = np.arange(blocks.kind.size)
        self.last = self.first.copy()
        self.owner = self.first.copy()
        self.gained = np.zeros(blocks.kind.size)

    def duration(self, i: int) -> float:
        """Return the time [s] that a block has by now."""
        return float(self.blocks.end[self.last[i]] - self.blocks.start[self.first[i]])

    def give_away(self, i: int) -> None:
        """Join a block to the one before it, or else to the one after it, or leave it."""
        before, after = self.first[i] - 1, self.last[i] + 1
        if before >= 0 and self.open[before] and self._takes(self.owner[before], i):
            taker = self.owner[before]
            self.last[taker] = self.last[i]
        elif after < self.owner.size and self.open[after - 1] and self._takes(after, i):
            taker = after
            self.first[taker] = self.first[i]
        else:
            return
        self.gained[taker] += self.duration(i)
        self.owner[self.first[i] : self.last[i] + 1] = taker

    def _takes(self, taker: int, i: int) -> bool:
        fits = self.blocks.kind[taker] == LINE or self.piece[taker] == self.piece[i]
        return bool(fits) and self.gained[taker] + self.duration(i) <= self.most

    def result(self) -> Blocks:
        """Return the blocks that are left, with what they have taken."""
        left = np.flatnonzero(self.owner == np.arange(self.owner.size))
        first, last = self.first[left], self.last[left]
        return msgspec.structs.replace(
            take(self.blocks, left),
            start=self.blocks.start[first],
            end=self.blocks.end[last],
            s0=self.blocks.s0[first],
            s1=self.blocks.s1[last],
        )


def _open_boundaries(blocks: Blocks, shape: TrackShape) -> BoolArray:
    """Find where a block and the next may be one: no stop, reversal, dwell or end of rapids between them."""
    way = np.sign(blocks.s1 - blocks.s0)
    place = shape.wrap(blocks.s1[:-1])
    near = np.searchsorted(shape.stops, [place - MEETS, place + MEETS])
    dwells = blocks.kind == DWELL
    alike = (way[:-1] == way[1:]) & (blocks.rapid[:-1] == blocks.rapid[1:])
    return np.asarray(alike & (near[0] == near[1]) & ~dwells[:-1] & ~dwells[1:])


def cut_blocks(plan: Plan, track: Track, dialect: Dialect, options: ProgramOptions) -> tuple[Blocks, TrackShape]:
    """Cut a plan into blocks.

    Where the speed is constant a block is as long as the geometry allows: a line or an arc is one move (arcs
    up to half a turn), a cubic one G5 where the dialect's own rendering of it holds the chord tolerance, what
    the dialect has polynomials for is one of them, and the rest is chords within that tolerance. In ramps and
    dips a block lasts at most `options.block_time`, or as long as its feed can be a polynomial of the way.

    Returns
    -------
    Blocks, TrackShape
    """
    inverse = options.feed_mode == "inverse-time"
    abilities, plane = dialect.abilities, plane_of(plan.path.axes)[0]
    shape = read_shape(
        track,
        arcs=abilities.writes_arcs(plane, inverse=inverse),
        splines=abilities.writes_splines(plane, inverse=inverse),
        degree=abilities.polynomial_degree,
    )
    motion = MotionLaw.from_phases(plan.phases)
    period = plan.machine.servo_period
    stretches = find_stretches(plan.phases, shape)
    _check_count(stretches, shape, options)
    if abilities.feed_degree:
        cuts = cut_stretches(stretches, shape, motion, period)
        stretches, timed = [one.stretch for one in cuts], feed_blocks(cuts)
    else:
        timed = _by_time(stretches, options.block_time)
    runs = _with_splines(
        find_runs(stretches, shape), stretches, shape, abilities.cubic, period, options.chord_tolerance
    )
    blocks = join_rows([_by_geometry(runs, stretches, shape, options.chord_tolerance), timed])
    blocks = take(blocks, np.argsort(blocks.stretch, kind="stable"))
    blocks = _with_curves(_with_places(blocks, motion, shape), shape, dialect)
    blocks = join_short_blocks(blocks, shape, period, options.block_time)
    return _within_tolerance(blocks, motion, shape, options.chord_tolerance), shape


def _check_count(stretches: list[MotionStretch], shape: TrackShape, options: ProgramOptions) -> None:
    """Refuse a program whose chords, or blocks of equal time, would be too many."""
    timed = sum(one.end - one.start for one in stretches if not one.by_geometry and one.span.kind != "dwell")
    check_blocks(shape.track.path.name, timed / options.block_time, "a longer --block-time")
    curved = np.isin(shape.kind, (CURVE, POLYNOMIAL, SPLINE))
    if curved.any():
        ends = ChordGauge(shape.track, options.chord_tolerance).count(shape.track.starts)
        check_blocks(shape.track.path.name, float(np.diff(ends)[curved].sum()), COARSER)


COARSER: Final = "a larger --chord-tolerance"
"""What makes chords fewer."""


def _with_splines(
    runs: BlockRuns,
    stretches: list[MotionStretch],
    shape: TrackShape,
    ability: CubicAbility | None,
    period: float,
    tolerance: float,
) -> BlockRuns:
    """Decide what becomes G5; what cannot becomes curves."""
    rapid = np.array([stretch.rapid for stretch in stretches], dtype=bool)[runs.stretch]
    kind = np.where(rapid & (runs.kind != LINE), CURVE, runs.kind)
    cubic = np.flatnonzero(kind == SPLINE)
    if not cubic.size or ability is None:
        return msgspec.structs.replace(runs, kind=kind)
    speed = np.array([abs(one.s1 - one.s0) / (one.end - one.start) for one in stretches])[runs.stretch]
    parts = cut_cubics(
        shape,
        ability.deviation,
        runs.piece[cubic],
        (runs.s0 - runs.base)[cubic],
        (runs.s1 - runs.base)[cubic],
        least=ability.pieces * period * speed[cubic],
        tolerance=tolerance,
    )
    rest = np.flatnonzero(kind != SPLINE)
    source = np.concatenate([rest, cubic[parts.run]])
    order = np.argsort(source, kind="stable")
    source = source[order]
    base = runs.base[source]
    return BlockRuns(
        stretch=runs.stretch[source],
        s0=np.concatenate([runs.s0[rest], parts.s0 + runs.base[cubic[parts.run]]])[order],
        s1=np.concatenate([runs.s1[rest], parts.s1 + runs.base[cubic[parts.run]]])[order],
        kind=np.concatenate([kind[rest], np.where(parts.smooth, SPLINE, CURVE)])[order],
        piece=runs.piece[source],
        base=base,
    )


def _by_geometry(runs: BlockRuns, stretches: list[MotionStretch], shape: TrackShape, tolerance: float) -> Blocks:
    """Blocks as long as the geometry allows, in time as in place."""
    gauge = ChordGauge(shape.track, tolerance)
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


def _by_time(stretches: list[MotionStretch], block_time: float) -> Blocks:
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


def _with_places(blocks: Blocks, motion: MotionLaw, shape: TrackShape) -> Blocks:
    """Find the ends of the blocks in ramps from the times there; elsewhere they are given. Joints are met."""
    timed = np.flatnonzero(blocks.timed)
    s0, s1 = blocks.s0.copy(), blocks.s1.copy()
    s0[timed] = motion.place_and_feed(blocks.start[timed])[0]
    s1[timed] = motion.place_and_feed(blocks.end[timed])[0]
    return msgspec.structs.replace(blocks, s0=shape.snap(s0), s1=shape.snap(s1))


def _with_curves(blocks: Blocks, shape: TrackShape, dialect: Dialect) -> Blocks:
    """Make ramp blocks on one arc or polynomial that too, and lines of what rounds to lines.

    In ramps chords would hold the tolerance as well, but LinuxCNC slows down where a chord meets an arc
    (measured: from 40 to 20 mm/s at the ends of a dip on R 20 mm), while arcs run into arcs at full speed.
    """
    piece = shape.piece_at(0.5 * (blocks.s0 + blocks.s1))
    inwards = np.clip(0.5 * (blocks.s1 - blocks.s0), -MEETS, MEETS)  # so that a joint counts as either side
    same = (shape.piece_at(blocks.s0 + inwards) == piece) & (shape.piece_at(blocks.s1 - inwards) == piece)
    timed = (blocks.timed == 1) & (blocks.kind == LINE) & same
    quantum = dialect.numbers.quantum
    bent = (blocks.s1 - blocks.s0) ** 2 >= 8.0 * quantum * shape.radius[piece]
    round_ = (blocks.kind == ARC) | (timed & (shape.kind[piece] == ARC))
    kind = np.where(round_, np.where(bent, ARC, LINE), blocks.kind)
    kind = np.where(timed & (shape.kind[piece] == POLYNOMIAL), POLYNOMIAL, kind)
    return msgspec.structs.replace(blocks, kind=kind)


def _within_tolerance(blocks: Blocks, motion: MotionLaw, shape: TrackShape, tolerance: float) -> Blocks:
    """Cut chords that leave the path by more than the tolerance, in time, until none does."""
    first, last = shape.piece_at(blocks.s0), shape.piece_at(blocks.s1)
    straight = (first == last) & (shape.kind[first] == LINE)
    doubtful = (blocks.kind == LINE) & ~straight
    while doubtful.any():
        parts = np.ones(doubtful.size, dtype=np.int64)
        parts[doubtful] = chord_counts(shape, blocks.s0[doubtful], blocks.s1[doubtful], tolerance)
        check_blocks(shape.track.path.name, float(parts.sum()), COARSER)
        blocks = _with_places(_split(blocks, parts), motion, shape)
        doubtful = np.repeat(parts > 1, parts)
    return blocks


def _split(blocks: Blocks, parts: IntArray) -> Blocks:
    """Cut each block into so many parts, equal in time and, where the geometry decides, in length."""
    row, low, high = _shared(parts)
    cut = take(blocks, row)
    time, way = cut.end - cut.start, cut.s1 - cut.s0
    return msgspec.structs.replace(
        cut,
        start=cut.start + low * time,
        end=cut.start + high * time,
        s0=cut.s0 + low * way,
        s1=cut.s0 + high * way,
    )
