"""Compare two programs as a whole, with what they declare and what a machine would make of them."""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.diff.blocks import compare_blocks, compare_commands
from ph_post.diff.curves import curve_table
from ph_post.diff.feeds import PathTiming, compare_feeds, compare_times, programmed_timing
from ph_post.diff.records import Comparison, Deviation, Span, Timing
from ph_post.diff.travel import ComparedPaths, compare_paths, largest_deviation, refine_deviations
from ph_post.edit.header import Declaration, read_declaration
from ph_post.edit.undo import undo
from ph_post.errors import InputError
from ph_post.gcode.program import RAPID, PartProgram
from ph_post.gcode.read import reread
from ph_post.simulate.assess import resting_axes, scenarios
from ph_post.simulate.contour import ContourError
from ph_post.simulate.controllers.deviation import moving_axes, program_error
from ph_post.simulate.controllers.run import run_program
from ph_post.types import Array, BoolArray, Command, IntArray, Machine
from ph_post.units import MINUTE, MM

Programs = tuple[PartProgram, PartProgram]


class DeclaredProgram:
    """What one program declares, and the program it was made from.

    Attributes
    ----------
    words : tuple of str
        What is declared, in sentences; empty where nothing is.
    original : PartProgram
        The program without it; the program itself where nothing is declared or it cannot be taken back.
    taken_back : bool
        Whether `original` is another program.
    """

    def __init__(self, program: PartProgram) -> None:
        self.original, self.taken_back = program, False
        declaration = read_declaration(program.data)
        if declaration is None:
            self.words: tuple[str, ...] = ()
            return
        words = describe_declaration(declaration)
        try:
            self.original = reread(program, undo(program.data, program.name))
            self.taken_back = True
        except InputError as error:
            words.append(f"what it declares cannot be taken off: {error}")
        self.words = tuple(words)


def describe_declaration(one: Declaration) -> list[str]:
    """Say what a declaration says."""
    found = [f"compensated by ph-post {one.version} for {one.machine}, from sha256 {one.digest[:16]}"]
    found += [
        f"{axis} is commanded {size / MM:.4g} mm ahead in the direction it moves"
        for axis, size in sorted(one.offset.items())
    ]
    found += [
        f"{axis} is moved out and back by up to {size / MM:.4g} mm at stops" for axis, size in sorted(one.pulse.items())
    ]
    if one.stops or one.dips:
        found.append(f"{one.stops} stops, {one.dips} feed dips")
    return found


def deviation_of_originals(declared: tuple[DeclaredProgram, DeclaredProgram]) -> float | None:
    """Return how far the tool paths are apart without what is declared [m]; None where nothing is."""
    if not any(one.taken_back for one in declared):
        return None
    a, b = (curve_table(one.original.motions) for one in declared)
    return largest_deviation(compare_paths(a, b))


LONGEST: Final = 60.0 * MINUTE
"""No contour error is predicted of what runs longer [s]: time and memory of a simulation grow with it."""


class PredictedRun(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """How a controller runs a program, and what the drives make of that.

    `error` is None where nothing is cut, or the program runs too long.
    """

    pace: PathTiming
    error: ContourError | None


def predict_run(program: PartProgram, original: PartProgram, programmed: PathTiming, machine: Machine) -> PredictedRun:
    """Run a program on the model of its controller and of the drives.

    Parameters
    ----------
    program : PartProgram
    original : PartProgram
        Whose path the table should follow: the program without what it declares.
    programmed : PathTiming
        What feeds and dwells ask for.
    machine : Machine
    """
    command = run_program(program, machine)
    pace = _controller_timing(command, program, programmed)
    if command.t.size == 0 or command.t[-1] > LONGEST:
        return PredictedRun(pace=pace, error=None)
    moving = moving_axes(command)
    tried = [one for one in scenarios(machine, moving.axes, resting_axes(moving)) if one.gap == 1.0]
    nominal = [one for one in tried if one.beta == one.gain == 1.0]
    return PredictedRun(pace=pace, error=program_error(command, machine, original, nominal).error)


def _controller_timing(command: Command, program: PartProgram, programmed: PathTiming) -> PathTiming:
    """Return the times of all motions, what is waited before or behind them included."""
    count = programmed.time.size
    rows = np.bincount(np.maximum(command.segment, 0), minlength=count)[:count]
    time = np.asarray(rows * command.period, dtype=np.float64)
    rapid = program.motions.kind == RAPID
    timing = Timing(
        total=float(command.t[-1]),
        cutting=float(time[~rapid].sum()),
        rapids=float(time[rapid].sum()),
        dwells=programmed.timing.dwells,
        model="controller",
    )
    return PathTiming(speed=programmed.speed, time=time, pause=np.zeros(count + 1), timing=timing)


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
    declared = (DeclaredProgram(a), DeclaredProgram(b))
    travel = compare_paths(curve_table(a.motions), curve_table(b.motions))
    asked = (programmed_timing(a, travel.outlines[0]), programmed_timing(b, travel.outlines[1]))
    expected = None if machine is None else _predict_both(programs, declared, asked, machine)
    paces = asked if expected is None else (expected[0].pace, expected[1].pace)
    deviations = list_deviations(travel, programs, tolerance)
    most = largest_deviation(travel)
    if deviations:
        most = max(one.amount for one in deviations)
    apart = np.inf if most is None else max(tolerance, SLACK * most)
    return Comparison(
        programs=programs,
        identical=a.data == b.data,
        tolerance=tolerance,
        blocks=compare_blocks(a, b),
        travel=travel,
        max_deviation=most,
        deviations=deviations,
        feeds=compare_feeds(travel, programs, asked),
        timing=(paces[0].timing, paces[1].timing),
        times=compare_times(travel, programs, paces),
        retimed=bool(compare_times(travel, programs, asked)),
        orders=compare_commands(a, b, travel, apart),
        declared=(declared[0].words, declared[1].words),
        undone=deviation_of_originals(declared),
        errors=None if expected is None else (expected[0].error, expected[1].error),
        notes=_notes(programs),
    )


def _predict_both(
    programs: tuple[PartProgram, PartProgram],
    declared: tuple[DeclaredProgram, DeclaredProgram],
    paces: tuple[PathTiming, PathTiming],
    machine: Machine,
) -> tuple[PredictedRun, PredictedRun]:
    a, b = (
        predict_run(program, one.original, pace, machine)
        for program, one, pace in zip(programs, declared, paces, strict=True)
    )
    return a, b


def list_deviations(
    travel: ComparedPaths, programs: tuple[PartProgram, PartProgram], tolerance: float
) -> tuple[Deviation, ...]:
    """Return the stretches on which either path is farther from the other than the tolerance, in order."""
    if travel.sides is None:
        return ()
    spans = _stretches(travel, tolerance)
    if len(spans) == 0:
        return ()
    rows = [_worst(travel.sides[k].deviation, spans[:, 2 * k : 2 * k + 2]) for k in (0, 1)]
    found = [refine_deviations(travel, k, rows[k]) for k in (0, 1)]
    worst = np.argmax([found[0][0], found[1][0]], axis=0)
    return tuple(
        _deviation(travel, programs, span, (int(rows[k][n]), k, float(found[k][0][n]), found[k][1][n]))
        for n, (span, k) in enumerate(zip(spans.tolist(), worst.tolist(), strict=True))
    )


def _stretches(travel: ComparedPaths, tolerance: float) -> IntArray:
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
    travel: ComparedPaths,
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
