"""Compare two programs as a whole, their declarations, and their run on a machine."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.bounds import HOUR, LONGEST_SIMULATED
from ph_post.dialects.declaration import Declaration, read_declaration
from ph_post.diff.blocks import BlockChange, CommandChange, compare_blocks, compare_commands
from ph_post.diff.curves import curve_table
from ph_post.diff.feeds import (
    FeedChange,
    PathTiming,
    TimeChange,
    Timing,
    compare_feeds,
    compare_times,
    programmed_timing,
)
from ph_post.diff.paths import ComparedPaths, Span, compare_paths, largest_deviation, refine_deviations
from ph_post.drive.axes import backlash_uncertainties
from ph_post.edit.undo import original_of
from ph_post.errors import InputError, TooLargeError
from ph_post.gcode.program import RAPID, PartProgram, runs
from ph_post.simulate.assess import backlash_scenarios, is_nominal
from ph_post.simulate.contour import ContourError
from ph_post.simulate.controllers.deviation import (
    cut_error,
    follow_cut,
    moving_axes,
)
from ph_post.simulate.controllers.gap_error import program_gap_error
from ph_post.simulate.controllers.run import run_program
from ph_post.types import Array, Command, IntArray, Machine
from ph_post.units import MM


class Deviation(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch on which the tool paths are apart: blocks, way travelled, how far [m], where [m].

    `worst` says on which of the paths the place `where` is, 0 or 1, and `block` the block there.
    """

    a: Span
    b: Span
    s_a: tuple[float, float]
    s_b: tuple[float, float]
    amount: float
    worst: int
    block: int
    where: tuple[float, float, float]


class PredictedErrors(msgspec.Struct, frozen=True, kw_only=True):
    """Predicted contour errors of two programs, by all causes and by backlash; None where they were not found.

    `gap_worst` is the largest that backlash causes in the second if it is off by its `uncertainty`, of each
    axis that moves. An error is measured from the path of the original that a program declares; where B
    declares none, from that of A.
    """

    errors: tuple[ContourError | None, ContourError | None]
    gaps: tuple[ContourError | None, ContourError | None]
    gap_worst: ContourError | None
    uncertainty: Mapping[str, float]


class Comparison(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Two programs compared, `programs`.

    `identical` byte for byte; `travel` the paths, `deviations`, `feeds`, `times`, `orders` what differs along
    them, `retimed` whether feeds and dwells ask for other times. `max_deviation` [m] is None where one of the
    programs has no motion. `declared` says what the programs say of their own compensation; `undone` [m] how
    far they are apart without it, None where none is declared. `predicted` are the contour errors, None where
    they were not asked for.
    """

    programs: tuple[PartProgram, PartProgram]
    identical: bool
    tolerance: float
    blocks: tuple[BlockChange, ...]
    travel: ComparedPaths
    max_deviation: float | None
    deviations: tuple[Deviation, ...]
    feeds: tuple[FeedChange, ...]
    timing: tuple[Timing, Timing]
    times: tuple[TimeChange, ...]
    retimed: bool
    orders: tuple[CommandChange, ...]
    declared: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    undone: float | None = None
    predicted: PredictedErrors | None = None
    notes: tuple[str, ...] = ()

    @property
    def same(self) -> bool:
        """True where a machine does the same with both: path, feed, time, and everything beside them."""
        apart = self.max_deviation is None and len(self.travel.gaps) > 0
        return not (apart or self.deviations or self.feeds or self.retimed or self.orders)


class DeclaredProgram(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The declaration of a program's compensation, in sentences, and its original.

    `original` is None where nothing is declared, or where the compensation cannot be undone.
    """

    words: tuple[str, ...]
    original: PartProgram | None


def read_declared_program(program: PartProgram) -> DeclaredProgram:
    """Read the declaration of a program, and restore its original."""
    declaration = read_declaration(program.data)
    if declaration is None:
        return DeclaredProgram(words=(), original=None)
    words = describe_declaration(declaration)
    try:
        return DeclaredProgram(words=tuple(words), original=original_of(program))
    except InputError as error:
        return DeclaredProgram(words=(*words, f"its compensation cannot be undone: {error}"), original=None)


def describe_declaration(one: Declaration) -> list[str]:
    """Describe a declaration in sentences."""
    found = [f"compensated by ph-post {one.version} for {one.machine}, from sha256 {one.digest[:16]}"]
    found += [
        f"{axis} is commanded {size / MM:.4g} mm ahead in the direction it moves"
        for axis, size in sorted(one.offset.items())
    ]
    found += [
        f"{axis} makes backlash take-up moves of up to {size / MM:.4g} mm at stops"
        for axis, size in sorted(one.pulse.items())
    ]
    if one.stops or one.dips:
        found.append(f"{one.stops} stops, {one.dips} feed dips")
    return found


class PredictedRun(NamedTuple):
    """Times of a program on a machine, the command of its controller, and why that is not simulated.

    `command` is None where the program is too long to be run.
    """

    timing: PathTiming
    command: Command | None
    trouble: str = ""


def predict_run(program: PartProgram, programmed: PathTiming, machine: Machine) -> PredictedRun:
    """Run a program on the model of its controller.

    Parameters
    ----------
    program : PartProgram
    programmed : PathTiming
        Times as feeds and dwells give them.
    machine : Machine

    Returns
    -------
    PredictedRun
        The times are those of the controller, or as programmed where the program is too long to be run.
    """
    try:
        command = run_program(program, machine, meet_turns=True)
    except TooLargeError as error:
        return PredictedRun(programmed, None, f"no times of the controller and no error are predicted: {error}")
    timing = _controller_timing(command, program, programmed)
    if command.t.size and command.t[-1] > LONGEST_SIMULATED:
        hours = f"{command.t[-1] / HOUR:.3g} h, more than {LONGEST_SIMULATED / HOUR:g} h"
        return PredictedRun(timing, command, f"{program.name}: no error is predicted: it runs for {hours}")
    return PredictedRun(timing, command)


def predict_errors(
    programs: tuple[PartProgram, PartProgram],
    declared: tuple[PartProgram | None, PartProgram | None],
    runs: tuple[PredictedRun, PredictedRun],
    machine: Machine,
) -> PredictedErrors:
    """Run the commands of two programs on the model of the drives, and measure how far the tables leave the path.

    Parameters
    ----------
    programs : (PartProgram, PartProgram)
    declared : (PartProgram or None, PartProgram or None)
        The originals that the programs declare.
    runs : (PredictedRun, PredictedRun)
        As the model of the controller runs them.
    machine : Machine
    """
    nominal = declared[0] or programs[0]
    targets = (nominal, declared[1] or nominal)
    plain = {programs[0].data: runs[0].command} if runs[0].command is not None else {}
    found = [_predicted(runs[k], programs[k], targets[k], machine, plain, worst=k == 1) for k in (0, 1)]
    moved = {name for one in runs if one.command is not None for name in moving_axes(one.command).axes}
    return PredictedErrors(
        errors=(found[0][0], found[1][0]),
        gaps=(found[0][1], found[1][1]),
        gap_worst=found[1][2],
        uncertainty=backlash_uncertainties(machine, moved),
    )


def _predicted(
    run: PredictedRun,
    program: PartProgram,
    target: PartProgram,
    machine: Machine,
    plain: dict[bytes, Command],
    *,
    worst: bool,
) -> tuple[ContourError | None, ContourError | None, ContourError | None]:
    """Error of a program's run from the path of a target: by all causes, by backlash, and that at worst if asked for.

    `plain` are the commands of programs that were run already, by their bytes.
    """
    command = run.command
    if command is None or command.t.size == 0 or run.trouble:
        return None, None, None
    cut = follow_cut(command, machine, target, moved_by=program)
    known = backlash_scenarios(cut.scenarios())
    found = cut_error(cut, [one for one in known if is_nominal(one)])
    original = cut
    if target.data != program.data:
        if target.data not in plain:
            plain[target.data] = run_program(target, machine, meet_turns=True)
        original = follow_cut(plain[target.data], machine, target, moved_by=target)
    own = program_gap_error(cut, original, (found.run.scenario,))
    return found.error, own, program_gap_error(cut, original, known) if worst else None


def _controller_timing(command: Command, program: PartProgram, programmed: PathTiming) -> PathTiming:
    """Return the times of all motions, what is waited before or behind them included."""
    count = programmed.time.size
    rows = np.bincount(np.maximum(command.segment, 0), minlength=count)[:count]
    time = np.asarray(rows * command.period, dtype=np.float64)
    rapid = program.motions.kind == RAPID
    timing = Timing(
        total=float(command.t[-1]) if command.t.size else 0.0,
        cutting=float(time[~rapid].sum()),
        rapids=float(time[rapid].sum()),
        dwells=programmed.timing.dwells,
        model="controller",
    )
    return PathTiming(speed=programmed.speed, time=time, pause=np.zeros(count + 1), timing=timing)


TOLERANCE: Final = 1e-6 * MM
"""Paths no farther apart are the same [m]: less than a controller's last decimal, more than rounding."""

SLACK: Final = 4.0
"""A command may be this much farther from its counterpart than the paths are: offsets add up over axes."""


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
    declared = (read_declared_program(a), read_declared_program(b))
    originals = (declared[0].original or a, declared[1].original or b)
    travel = compare_paths(curve_table(a.motions), curve_table(b.motions))
    asked = (programmed_timing(a, travel.outlines[0]), programmed_timing(b, travel.outlines[1]))
    timings, errors, troubles = asked, None, ("", "")
    if machine is not None:
        first, second = (predict_run(programs[k], asked[k], machine) for k in (0, 1))
        timings, troubles = (first.timing, second.timing), (first.trouble, second.trouble)
        errors = predict_errors(programs, (declared[0].original, declared[1].original), (first, second), machine)
    undone = None
    if originals != programs:
        undone = largest_deviation(compare_paths(*(curve_table(one.motions) for one in originals)))
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
        timing=(timings[0].timing, timings[1].timing),
        times=compare_times(travel, programs, timings),
        retimed=bool(compare_times(travel, programs, asked)),
        orders=compare_commands(a, b, travel, apart),
        declared=(declared[0].words, declared[1].words),
        undone=undone,
        predicted=errors,
        notes=(
            *filter(None, troubles),
            *(
                f"{program.name}:{note.first + 1}: {note.what}: compared as text"
                for program in programs
                for note in program.notes
            ),
        ),
    )


def list_deviations(
    travel: ComparedPaths, programs: tuple[PartProgram, PartProgram], tolerance: float
) -> tuple[Deviation, ...]:
    """Return in order the stretches on which the paths are farther apart than the tolerance [m]."""
    if travel.sides is None:
        return ()
    spans = _stretches(travel, tolerance)
    if len(spans) == 0:
        return ()
    rows = [
        np.array([first + int(np.argmax(side.deviation[first : last + 1])) for first, last in spans[:, pair].tolist()])
        for side, pair in zip(travel.sides, (slice(0, 2), slice(2, 4)), strict=True)
    ]
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
    mine, theirs = (np.stack(runs(side.deviation > tolerance), axis=1) - [0, 1] for side in (a, b))
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
