"""Feeds and times along two paths, and where they differ."""

from __future__ import annotations

from typing import Final, Literal

import msgspec
import numpy as np

from ph_post.diff.curves import CurveTable
from ph_post.diff.paths import ComparedPaths, PathSamples, Span
from ph_post.gcode.program import RAPID, PartProgram, runs
from ph_post.types import Array, IntArray

SAME_FEED: Final = 1e-9
"""Feeds that differ by no more, relatively, are the same."""

CLEAR: Final = 4.0
"""A motion runs beside another where they go together for this many times their distance."""

SAME_TIME: Final = 1e-9
"""Times that differ by no more are the same [s]."""

SAME_PERIODS: Final = 0.01
"""The same as a controller runs it [s]: where it does not stop, a motion ends in one period or another."""


class FeedChange(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch on which the feeds differ: lowest and highest of both [m/s], and of their ratio b to a.

    None for rapid moves and without an F.
    """

    a: Span
    b: Span
    s_a: tuple[float, float]
    feed_a: tuple[float, float] | None
    feed_b: tuple[float, float] | None
    ratio: tuple[float, float] | None


class TimeChange(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch that takes another time [s]."""

    a: Span
    b: Span
    time_a: float
    time_b: float


class Timing(msgspec.Struct, frozen=True, kw_only=True):
    """The time that a program takes [s].

    `model` says how that was found. `rapids` is None where their speed is not known and they do not count.
    """

    total: float
    cutting: float
    dwells: float
    rapids: float | None
    model: Literal["controller", "length over feed"]


class PathTiming(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Speeds and times of a program along its path.

    `speed` (m,) [m/s] as programmed, infinite in rapid moves, NaN where it is not known; `time` (m,) [s] of
    every motion, `pause` (m + 1,) [s] what it dwells before each, and behind the last. `timing` is the sum.
    """

    speed: Array
    time: Array
    pause: Array
    timing: Timing


def programmed_timing(program: PartProgram, outline: CurveTable) -> PathTiming:
    """Work out speeds and times from lengths and feeds; rapid moves, whose speed is not known, take none."""
    motions, lengths = program.motions, outline.lengths()
    rapid = motions.kind == RAPID
    timed = motions.duration > 0.0
    with np.errstate(divide="ignore", invalid="ignore"):
        speed = np.where(timed, lengths / motions.duration, motions.feed)
        speed = np.where(rapid, np.inf, speed)
        time = np.where(lengths > 0.0, lengths / speed, 0.0)
    time = np.where(timed & ~rapid, motions.duration, time)
    time = np.where(np.isfinite(time), time, 0.0)
    lines, seconds = program.dwells()
    pause = np.zeros(program.motions.block.size + 1)
    np.add.at(pause, np.searchsorted(program.motions.block, lines, side="right"), np.nan_to_num(seconds))
    cutting, dwells = float(time[~rapid].sum()), float(pause.sum())
    timing = Timing(total=cutting + dwells, cutting=cutting, dwells=dwells, rapids=None, model="length over feed")
    return PathTiming(speed=speed, time=time, pause=pause, timing=timing)


def compare_feeds(
    travel: ComparedPaths, programs: tuple[PartProgram, PartProgram], paces: tuple[PathTiming, PathTiming]
) -> tuple[FeedChange, ...]:
    """Return the stretches on which the programmed feeds differ, wherever the two paths belong together."""
    here = np.flatnonzero(travel.found >= 0)
    pairs = [np.stack([here, travel.found[here]], axis=1)]
    if travel.sides is not None:
        pairs += [_beside(travel.sides[0], travel.outlines[1])]
        pairs += [_beside(travel.sides[1], travel.outlines[0])[:, ::-1]]
    both = np.unique(np.concatenate(pairs), axis=0)
    speeds = [paces[k].speed[both[:, k]] for k in (0, 1)]
    moving = [travel.outlines[k].lengths()[both[:, k]] > 0.0 for k in (0, 1)]
    with np.errstate(invalid="ignore"):
        near = np.abs(speeds[0] - speeds[1]) <= SAME_FEED * np.maximum(*np.abs(speeds))
    alike = near | (speeds[0] == speeds[1]) | (np.isnan(speeds[0]) & np.isnan(speeds[1]))
    differs = ~alike & moving[0] & moving[1]
    spans = zip(*(ends.tolist() for ends in runs(differs)), strict=True)
    return tuple(
        _feed_change(travel, programs, both[first:end], [speed[first:end] for speed in speeds]) for first, end in spans
    )


def _beside(side: PathSamples, other: CurveTable) -> IntArray:
    """Motions of one path, and those of the other beside which they run for longer than they are apart."""
    piece, mine = side.samples.piece, side.motion()
    advance = np.diff(side.closest_ways)
    along = np.flatnonzero((piece[1:] == piece[:-1]) & (advance > 0.0))
    middle = side.closest_ways[along] + 0.5 * advance[along]
    there = np.clip(np.searchsorted(other.s, middle, side="right") - 1, 0, len(other.table) - 1)
    pairs, number = np.unique(np.stack([mine[along], other.motion[there]], axis=1), axis=0, return_inverse=True)
    together = np.bincount(number, advance[along], minlength=len(pairs))
    apart = np.zeros(len(pairs))
    np.maximum.at(apart, number, side.deviation[along])
    return np.asarray(pairs[together > CLEAR * apart])


def _feed_change(
    travel: ComparedPaths, programs: tuple[PartProgram, PartProgram], pairs: IntArray, speeds: list[Array]
) -> FeedChange:
    a, b = speeds
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = b / a
    outline = travel.outlines[0]
    motions = [(int(pairs[:, k].min()), int(pairs[:, k].max())) for k in (0, 1)]
    return FeedChange(
        a=_span(programs[0], *motions[0]),
        b=_span(programs[1], *motions[1]),
        s_a=(float(outline.way(motions[0][0])), float(outline.way(motions[0][1] + 1))),
        feed_a=_range(a),
        feed_b=_range(b),
        ratio=_range(ratio[np.isfinite(a) & np.isfinite(b) & (a > 0.0)]),
    )


def _range(values: Array) -> tuple[float, float] | None:
    kept = values[np.isfinite(values)]
    return (float(kept.min()), float(kept.max())) if kept.size else None


def _span(program: PartProgram, first: int, last: int) -> Span:
    return int(program.motions.block[first]), int(program.motions.block[last])


def compare_times(
    travel: ComparedPaths, programs: tuple[PartProgram, PartProgram], paces: tuple[PathTiming, PathTiming]
) -> tuple[TimeChange, ...]:
    """Return the stretches that take another time, neighbours together."""
    rows = paired_motions(travel)
    clocks = [np.concatenate([[0.0], np.cumsum(np.append(pace.time, 0.0) + pace.pause)]) for pace in paces]
    times = [clocks[k][rows[:, 2 * k + 1]] - clocks[k][rows[:, 2 * k]] for k in (0, 1)]
    least = SAME_TIME if paces[0].timing.model == "length over feed" else SAME_PERIODS
    differs = np.abs(times[0] - times[1]) > least * np.maximum(1.0, times[0])
    spans = zip(*(ends.tolist() for ends in runs(differs)), strict=True)
    return tuple(
        TimeChange(
            a=_block_span(programs[0], int(rows[first, 0]), int(rows[end - 1, 1])),
            b=_block_span(programs[1], int(rows[first, 2]), int(rows[end - 1, 3])),
            time_a=float(times[0][first:end].sum()),
            time_b=float(times[1][first:end].sum()),
        )
        for first, end in spans
    )


def paired_motions(travel: ComparedPaths) -> IntArray:
    """Return in order the pairs of same motions, and the gaps: rows (n, 4) as of the gaps.

    The last row stands for what follows all motions.
    """
    here = np.flatnonzero(travel.found >= 0)
    there = travel.found[here]
    rows = np.concatenate([np.stack([here, here + 1, there, there + 1], axis=1), travel.gaps])
    counts = [outline.first.size - 1 for outline in travel.outlines]
    tail = [[counts[0], counts[0] + 1, counts[1], counts[1] + 1]]
    return np.concatenate([rows[np.lexsort((rows[:, 2], rows[:, 0]))], tail])


def _block_span(program: PartProgram, first: int, end: int) -> Span:
    """Blocks of the motions `first` to `end`; of what lies behind the last one, the last blocks."""
    block, count = program.motions.block, program.motions.block.size
    start = int(block[first]) if first < count else program.blocks - 1
    if end <= first:
        return start, start - 1
    return start, int(block[end - 1]) if end - 1 < count else program.blocks - 1
