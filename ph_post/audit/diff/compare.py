"""The whole comparison of two programs."""

from __future__ import annotations

from typing import Final

import numpy as np

from ph_post.audit.diff.declared import Declared, apart_without
from ph_post.audit.diff.forecast import Forecast, forecast
from ph_post.audit.diff.orders import compare_orders
from ph_post.audit.diff.outline import outline_of
from ph_post.audit.diff.pace import Pace, compare_feeds, compare_times, pace_of
from ph_post.audit.diff.record import Comparison, Deviation, Span
from ph_post.audit.diff.text import compare_blocks
from ph_post.audit.diff.travel import Travel, compare_paths, farthest, largest_deviation
from ph_post.gcode.reader.record import PartProgram
from ph_post.types import Array, BoolArray, IntArray, Machine
from ph_post.units import MM

TOLERANCE: Final = 1e-6 * MM
"""Paths no farther apart are the same [m]: less than a controller's last decimal, more than rounding."""

SLACK: Final = 4.0
"""How much farther apart than the paths the places of one order may be: offsets add up over axes."""


def compare_programs(
    a: PartProgram, b: PartProgram, tolerance: float = TOLERANCE, machine: Machine | None = None
) -> Comparison:
    """Compare two programs: blocks, tool paths, feeds, times, and what they do beside moving.

    Parameters
    ----------
    a, b : PartProgram
    tolerance : float, optional
        Paths no farther apart than this are the same [m].
    machine : Machine, optional
        On whose controller and drives both are run.
    """
    programs = (a, b)
    declared = (Declared(a), Declared(b))
    travel = compare_paths(outline_of(a.motions), outline_of(b.motions))
    asked = (pace_of(a, travel.outlines[0]), pace_of(b, travel.outlines[1]))
    expected = None if machine is None else _forecasts(programs, declared, asked, machine)
    paces = asked if expected is None else (expected[0].pace, expected[1].pace)
    deviations = list_deviations(travel, programs, tolerance)
    most = largest_deviation(travel)
    if deviations:
        most = max(one.amount for one in deviations)
    apart = np.inf if most is None else max(tolerance, SLACK * most)
    return Comparison(
        identical=a.data == b.data, tolerance=tolerance, blocks=compare_blocks(a, b), travel=travel,
        max_deviation=most, deviations=deviations, feeds=compare_feeds(travel, programs, asked),
        timing=(paces[0].timing, paces[1].timing), times=compare_times(travel, programs, paces),
        retimed=bool(compare_times(travel, programs, asked)),
        orders=compare_orders(a, b, travel, apart),
        declared=(declared[0].words, declared[1].words), undone=apart_without(declared),
        errors=None if expected is None else (expected[0].error, expected[1].error), notes=_notes(programs),
    )  # fmt: skip


def _forecasts(
    programs: tuple[PartProgram, PartProgram],
    declared: tuple[Declared, Declared],
    paces: tuple[Pace, Pace],
    machine: Machine,
) -> tuple[Forecast, Forecast]:
    a, b = (
        forecast(program, one.original, pace, machine)
        for program, one, pace in zip(programs, declared, paces, strict=True)
    )
    return a, b


def list_deviations(
    travel: Travel, programs: tuple[PartProgram, PartProgram], tolerance: float
) -> tuple[Deviation, ...]:
    """Return the stretches on which either path is farther from the other than the tolerance, in order."""
    if travel.sides is None:
        return ()
    spans = _stretches(travel, tolerance)
    if len(spans) == 0:
        return ()
    rows = [_worst(travel.sides[k].deviation, spans[:, 2 * k : 2 * k + 2]) for k in (0, 1)]
    found = [farthest(travel, k, rows[k]) for k in (0, 1)]
    worst = np.argmax([found[0][0], found[1][0]], axis=0)
    return tuple(
        _deviation(travel, programs, span, (int(rows[k][n]), k, float(found[k][0][n]), found[k][1][n]))
        for n, (span, k) in enumerate(zip(spans.tolist(), worst.tolist(), strict=True))
    )


def _stretches(travel: Travel, tolerance: float) -> IntArray:
    """First and last samples (a, a, b, b) of every stretch that is off, whichever path shows it."""
    assert travel.sides is not None
    a, b = travel.sides
    mine = _runs(a.deviation > tolerance)
    theirs = _runs(b.deviation > tolerance)
    from_b = np.stack([b.other[theirs[:, 0], 0], b.other[theirs[:, 1], 1]], axis=1)
    spans = np.concatenate([mine, from_b])
    if len(spans) == 0:
        return np.zeros((0, 4), dtype=np.int64)
    spans = spans[np.argsort(spans[:, 0], kind="stable")]
    reach = np.maximum.accumulate(spans[:, 1])
    heads = np.flatnonzero(np.append(True, spans[1:, 0] > reach[:-1]))
    merged = np.stack([spans[heads, 0], np.maximum.reduceat(spans[:, 1], heads)], axis=1)
    across = np.stack([a.other[merged[:, 0], 0], a.other[merged[:, 1], 1]], axis=1)
    return np.concatenate([merged, across], axis=1)


def _runs(flags: BoolArray) -> IntArray:
    """First and last of every run that is true, shape (k, 2)."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]])))
    return np.stack([edges[::2], edges[1::2] - 1], axis=1)


def _worst(values: Array, spans: IntArray) -> IntArray:
    """Return the row of the largest value in every span."""
    return np.array([first + int(np.argmax(values[first : last + 1])) for first, last in spans.tolist()])


def _deviation(
    travel: Travel,
    programs: tuple[PartProgram, PartProgram],
    span: list[int],
    worst: tuple[int, int, float, Array],
) -> Deviation:
    assert travel.sides is not None
    row, side, amount, where = worst
    blocks, ways = [], []
    for k in (0, 1):
        first, last = span[2 * k], span[2 * k + 1]
        one = travel.sides[k]
        block = programs[k].motions.block
        blocks.append((int(block[one.motion(first)]), int(block[one.motion(last)])))
        ways.append((float(one.samples.ways[first]), float(one.samples.ways[last])))
    at = int(programs[side].motions.block[travel.sides[side].motion(row)])
    x, y, z = (float(value) for value in where)
    spans: tuple[Span, Span] = (blocks[0], blocks[1])
    return Deviation(
        a=spans[0], b=spans[1], s_a=ways[0], s_b=ways[1], amount=amount, worst=side, block=at, where=(x, y, z)
    )


def _notes(programs: tuple[PartProgram, PartProgram]) -> tuple[str, ...]:
    """Say what was not compared as geometry."""
    return tuple(
        f"{program.name}:{note.first + 1}: {note.what}: compared as text"
        for program in programs
        for note in program.notes
    )
