"""Compensate paths and part programs, and take a compensation back."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Literal

import msgspec
import numpy as np

from ph_post.analysis.path_analysis import Analysis
from ph_post.api.inputs import (
    Job,
    Source,
    analyse_job,
    machine_named,
    machine_warnings,
    program_in,
    raw_job,
)
from ph_post.api.options import CompensateOptions
from ph_post.api.programs import CompensatedProgram, ProgramRequest, compensate_program
from ph_post.api.results import (
    AxisReversals,
    MotionResult,
    PlannedMotion,
    ProgramMotion,
    ReversalCount,
    count_reversals,
)
from ph_post.api.reversals import ProgramReversal, program_reversals
from ph_post.compensate.comparison import strategy_at
from ph_post.compensate.motion import without_strategy
from ph_post.compensate.offsets import lead_in
from ph_post.compensate.options import PlanOutput
from ph_post.compensate.plan import make_plan
from ph_post.compensate.strategies.registry import PLAIN, find_traits
from ph_post.dialects.planners import planner_notes
from ph_post.dialects.registry import find_dialect
from ph_post.drive.axes import gravity_notes
from ph_post.drive.intervals import IntervalTable
from ph_post.edit import undo as edit_undo
from ph_post.edit.edits import TOLERANCE
from ph_post.errors import InputError, NotCompensatedError
from ph_post.files.check import counted
from ph_post.files.storage import SourceBytes, is_program, or_shipped, read_raw, write_atomically
from ph_post.files.table import table_content
from ph_post.gcode.program import PartProgram
from ph_post.geometry.piecewise import MEETS
from ph_post.post.moves import check_jogs, read_jogs
from ph_post.post.options import BLOCK_TIME, CHORD_TOLERANCE, FeedMode
from ph_post.post.program import make_program
from ph_post.progress import Progress, no_progress
from ph_post.simulate.controllers.run import moved_axes
from ph_post.types import Command, Machine, Path, Plan, TurningPoint, frozen
from ph_post.verify.verdict import Verdict


class Compensation(ABC):
    """Result of :func:`compensate`: the motion before and after, and the outputs to write.

    `machine` and `options` are those of the request; `before` and `after` are motions of the `output`, program or
    table. The other output is planned when it is first used.
    """

    machine: Machine
    options: CompensateOptions
    output: PlanOutput

    @property
    @abstractmethod
    def before(self) -> MotionResult:
        """The plain motion, without compensation."""

    @property
    @abstractmethod
    def after(self) -> MotionResult:
        """The compensated motion."""

    @property
    @abstractmethod
    def warnings(self) -> tuple[str, ...]:
        """Warnings: what was reduced or not compensated, a sentence each."""

    @property
    @abstractmethod
    def axis_reversals(self) -> tuple[AxisReversals, ...]:
        """Numbers of reversals of every axis with backlash."""

    @property
    def reversals(self) -> ReversalCount:
        """Numbers of compensated reversals and of all, of axes with backlash."""
        rows = self.axis_reversals
        return ReversalCount(compensated=sum(row.compensated for row in rows), all=sum(row.all for row in rows))

    @property
    def axes(self) -> tuple[str, ...]:
        """Axes with a compensated reversal."""
        return tuple(row.axis for row in self.axis_reversals if row.compensated)

    def check_all(self) -> None:
        """Refuse a result in which a reversal at which the tool cuts is not compensated.

        Raises
        ------
        NotCompensatedError
        """
        require_all_compensated(self.axis_reversals, self.warnings)

    @abstractmethod
    def program(self) -> bytes:
        """Return the compensated part program.

        Raises
        ------
        InputError
            Where the dialect cannot write it, or an option does not fit.
        """

    @abstractmethod
    def table(self) -> Command:
        """Return the rows of the interpolator table; of a part program it is that of its longest path."""

    def write(self, target: Source) -> None:
        """Write the compensated part program to a file, whole or not at all.

        Parameters
        ----------
        target : str or path
            A file name, or ``-`` for standard output.

        Raises
        ------
        InputError
            As :meth:`program`, and where the file cannot be written.
        """
        write_atomically({os.fspath(target): self.program()})

    def write_table(self, target: Source) -> None:
        """Write the interpolator table to a file, whole or not at all.

        Parameters
        ----------
        target : str or path
            A name that ends with ``.csv``, ``.npz`` or ``.parquet``, or ``-`` for CSV on standard output.

        Raises
        ------
        InputError
            As :meth:`table`, and where the file cannot be written.
        """
        name = os.fspath(target)
        write_atomically({name: table_content(self.table(), name)})


class PathCompensation(Compensation):
    """A compensated path.

    Parameters
    ----------
    analysis : Analysis
        With a machine.
    notes : tuple of str
        Parts of a part program that the path does not show.
    options : CompensateOptions
    output : "program" or "table"
        Output that is planned at once.
    progress : callable
    """

    def __init__(
        self,
        analysis: Analysis,
        notes: tuple[str, ...],
        options: CompensateOptions,
        output: PlanOutput,
        progress: Progress,
    ) -> None:
        assert analysis.machine is not None
        self.analysis, self.machine, self.options, self.output = analysis, analysis.machine, options, output
        self.notes = notes
        self._progress = progress
        self._plans: dict[PlanOutput, Plan] = {}
        self._texts: dict[PlanOutput, bytes] = {}
        self._motions: dict[PlanOutput, PlannedMotion] = {}
        self._written: set[PlanOutput] = set()
        plan = self.plan(output)
        self._plans[output] = with_warnings(plan, *machine_warnings(self.machine, analysis.path.axes))

    @property
    def plans(self) -> Mapping[PlanOutput, Plan]:
        """The plans that were made so far, by output, with their warnings."""
        return self._plans

    def plan(self, output: PlanOutput) -> Plan:
        """Return the plan for an output."""
        if output not in self._plans:
            self._progress(f"planning the {output}")
            found = make_plan(self.analysis, self.options.plan(output), self._progress)
            if output == "program" and find_traits(found.strategy).chooses:
                found = self._writable(found)
            self._plans[output] = found
        return self._plans[output]

    def _writable(self, plan: Plan) -> Plan:
        """Return the plan, or one of feeds alone where the dialect cannot write what it adds to the path."""
        try:
            check_jogs(read_jogs(plan).jogs, find_dialect(plan.machine.dialect))
        except InputError as error:
            self._progress("planning the program once more, by feeds alone")
            feeds = make_plan(self.analysis, self.options.plan("program", feed_only=True), self._progress)
            reason = str(error).removeprefix("--dialect: ")
            return with_warnings(feeds, f"nothing is added to the path: {reason}")
        return plan

    def motion(self, output: PlanOutput) -> PlannedMotion:
        """Return the compensated motion of an output."""
        if output not in self._motions:
            self._motions[output] = PlannedMotion(self.analysis, self.plan(output))
        return self._motions[output]

    @cached_property
    def before(self) -> PlannedMotion:
        """The plain motion, without compensation."""
        return PlannedMotion(self.analysis, without_strategy(self.plan(self.output)))

    @property
    def after(self) -> PlannedMotion:
        """The compensated motion."""
        return self.motion(self.output)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: what was reduced or not compensated, a sentence each."""
        if self.output == "program":
            self.program()
        said = (word for plan in self._plans.values() for word in plan.warnings)
        return tuple(dict.fromkeys((*self.notes, *said)))

    @property
    def axis_reversals(self) -> tuple[AxisReversals, ...]:
        """Numbers of reversals of every axis with backlash."""
        return self.count(self.output)

    def count(self, output: PlanOutput) -> tuple[AxisReversals, ...]:
        """Count the reversals in the plan of an output by axis; none is at the rest with which a motion begins."""
        plan = self.plan(output)
        rests = bool(plan.phases) and plan.phases[0].speed[0] == 0.0
        length = self.analysis.track.length
        points = [one for one in plan.turning_points if not rests or MEETS < one.s < length - MEETS]
        cuts = [not plan.path.segments[segment].rapid for segment in self._segments_behind(points)]
        rows = ((point.axis, strategy_at(plan, point) != PLAIN, cut) for point, cut in zip(points, cuts, strict=True))
        return count_reversals(rows, plan.machine)

    def _segments_behind(self, points: Sequence[TurningPoint]) -> list[int]:
        """Numbers of the segments that begin at, or hold, turning points."""
        track = self.analysis.track
        s = np.array([point.s for point in points]) + MEETS
        s = np.where(s > track.length, s - track.length if track.closed else track.length, s)
        return [int(track.segment[piece]) for piece in track.locate(s)[0].tolist()]

    def program(self) -> bytes:
        """Return the compensated part program."""
        if "program" not in self._texts:
            plan = self.plan("program")
            self._progress("writing the program")
            dialect = find_dialect(plan.machine.dialect)
            made = make_program(plan, self.analysis.track, dialect, self.options.writing)
            plan = self._plans["program"] = with_warnings(plan, *made.warnings)
            notes = plan.warnings if self.options.notes_in_header else ()
            head = [line for word in notes for line in dialect.comment(f"warning: {word}")]
            self._texts["program"] = "".join([*(f"{line}\n" for line in head), made.text]).encode()
            self._compare("program")
        return self._texts["program"]

    def table(self) -> Command:
        """Return the rows of the interpolator table; those before the path begins have negative times."""
        rows = self.motion("table")
        self._progress("sampling the interpolator table")
        if "table" not in self._written:
            self._compare("table")
        plan = self.plan("table")
        begin = lead_in(plan.phases, plan.crossings)
        return msgspec.structs.replace(rows.command, t=frozen(rows.command.t - begin)) if begin else rows.command

    def _compare(self, written: PlanOutput) -> None:
        """Say what the table holds that the program beside it cannot, once both are made."""
        self._written.add(written)
        if len(self._written) < 2:
            return
        table, program = self._plans["table"], self._plans["program"]
        held = ["inverse dynamics"] if table.inverse_dynamics else []
        held += ["crossings of the gap"] if table.crossings and not program.crossings else []
        if held:
            caveat = f"the program cannot carry the {' and '.join(held)} of the table"
            self._plans["program"] = with_warnings(program, caveat)


class ProgramCompensation(Compensation):
    """A compensated part program: only what has to change of it is changed.

    Parameters
    ----------
    job : PartProgram or SourceBytes
    machine : Machine, str or path
    options : CompensateOptions
    output : "program" or "table"
        Output that is made at once; the table is that of the program's longest path.
    progress : callable
    """

    def __init__(
        self,
        job: PartProgram | SourceBytes,
        machine: Machine | Source,
        options: CompensateOptions,
        output: PlanOutput,
        progress: Progress,
    ) -> None:
        self.options, self.output, self._progress = options, output, progress
        self._job, self._named = job, machine
        if output == "table":
            self.machine = self.longest.machine
            return
        options.check_for_program()
        progress("reading")
        self.machine, _ = machine_named(machine, options.dialect)
        assert self.edited is not None

    @cached_property
    def longest(self) -> PathCompensation:
        """The compensation of the program's longest path."""
        machine = self._named if self.output == "table" else self.machine
        return compensated_path(raw_job(self._job), machine, self.options, "table", self._progress)

    @cached_property
    def request(self) -> ProgramRequest:
        """Request to compensate the program itself."""
        options = self.options
        return ProgramRequest(
            plan=options.plan("program"),
            edit=options.editing,
            force=options.force,
            noted=options.notes_in_header,
        )

    @cached_property
    def edited(self) -> CompensatedProgram:
        """The program before and after, with the changes."""
        self.options.check_for_program()
        program = program_in(self._job, self.machine.dialect, strict=self.options.strict)
        return compensate_program(program, self.machine, self.request, self._progress)

    @property
    def original(self) -> PartProgram:
        """The original program, recovered where the job was compensated before."""
        return self.edited.before

    @property
    def unchanged(self) -> bool:
        """True where nothing had to change."""
        return self.edited.after.data == self.edited.before.data

    @property
    def already_compensated(self) -> bool:
        """True where the job was this very compensation already."""
        return self.edited.done

    @property
    def verdict(self) -> Verdict | None:
        """Verdict of :func:`ph_post.verify` on the result; None where nothing was changed."""
        return self.edited.verdict

    @cached_property
    def before(self) -> MotionResult:
        """The plain motion, without compensation."""
        if self.output == "table":
            return self.longest.before
        if self.edited.motions is not None:
            return self.edited.motions[0]
        return ProgramMotion(self.original, self.original, self.machine, "original", self._progress)

    @cached_property
    def after(self) -> MotionResult:
        """The compensated motion."""
        if self.output == "table":
            return self.longest.after
        if self.unchanged:
            return self.before
        if self.edited.motions is not None:
            return self.edited.motions[1]
        assert isinstance(self.before, ProgramMotion)
        name = "compensated program"
        return ProgramMotion(self.edited.after, self.original, self.machine, name, self._progress, self.before)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: what was passed through, reduced or not compensated, a sentence each."""
        if self.output == "table":
            return self.longest.warnings
        said = (*gravity_notes(self.machine, moved_axes(self.original)), *planner_notes(self.machine))
        return (*self.edited.warnings, *said)

    @property
    def axis_reversals(self) -> tuple[AxisReversals, ...]:
        """Numbers of reversals of every axis with backlash."""
        if self.output == "table":
            return self.longest.axis_reversals
        rows = ((one.point.axis, one.strategy != PLAIN, one.cut) for one in self.places)
        return count_reversals(rows, self.machine)

    @cached_property
    def planned(self) -> CompensatedProgram:
        """The program with its changes, found again where the job was compensated before."""
        if not self.already_compensated:
            return self.edited
        anew = msgspec.structs.replace(self.request, force=True)
        return compensate_program(self.original, self.machine, anew, self._progress)

    @cached_property
    def places(self) -> list[ProgramReversal]:
        """The reversals of the program, and what is done at each."""
        return program_reversals(self.planned, self.machine, self.options.tolerance)

    def program(self) -> bytes:
        """Return the compensated part program."""
        return self.edited.after.data

    def table(self) -> Command:
        """Return the rows of the interpolator table of the program's longest path."""
        return self.longest.table()


def require_all_compensated(rows: Sequence[AxisReversals], warnings: Sequence[str]) -> None:
    """Refuse reversals at which the tool cuts and which are not compensated.

    Raises
    ------
    NotCompensatedError
        With the axes, and the first of the warnings that says why.
    """
    left = [row for row in rows if row.cut]
    if left:
        what = ", ".join(f"{row.axis} at {row.cut} of {counted(row.all, 'reversal')}" for row in left)
        why = next((f"; {word}" for word in warnings if "not compensated" in word), "")
        raise NotCompensatedError(f"--require-all: not compensated: {what}{why}; nothing was written")


def with_warnings(plan: Plan, *more: str) -> Plan:
    """Add warnings to a plan's own."""
    return msgspec.structs.replace(plan, warnings=(*plan.warnings, *more))


def compensated_path(
    job: Path | SourceBytes,
    machine: Machine | Source,
    options: CompensateOptions,
    output: PlanOutput,
    progress: Progress,
) -> PathCompensation:
    """Compensate a path, or the longest path of a part program."""
    analysis, notes = analyse_job(
        job,
        machine,
        tolerance=options.tolerance,
        feed=options.feed,
        dialect=options.dialect,
        interval_table=options.interval_table,
        progress=progress,
    )
    return PathCompensation(analysis, notes, options, output, progress)


def compensated(
    job: Job,
    machine: Machine | Source,
    options: CompensateOptions,
    output: PlanOutput = "program",
    progress: Progress = no_progress,
) -> Compensation:
    """Compensate a job by a record of options; see :func:`compensate`."""
    raw: Path | PartProgram | SourceBytes = job if isinstance(job, PartProgram) else raw_job(job)
    result: Compensation
    if isinstance(raw, PartProgram) or (isinstance(raw, SourceBytes) and is_program(raw)):
        result = ProgramCompensation(raw, machine, options, output, progress)
    else:
        result = compensated_path(raw, machine, options, output, progress)
    if options.require_all:
        result.check_all()
    return result


def compensate(
    job: Job,
    machine: Machine | Source,
    *,
    output: PlanOutput = "program",
    strategy: str | None = None,
    tolerance: float = TOLERANCE,
    feed: float | None = None,
    dialect: str | None = None,
    start: Literal["rest", "moving"] = "rest",
    ratio: float | None = None,
    degree: int | None = None,
    t_star: float | None = None,
    coefficients: tuple[float, ...] | None = None,
    allow_retrograde: bool = False,
    min_feed: float | None = None,
    max_slowdown: float = 0.1,
    feed_only: bool = False,
    no_inverse_dynamics: bool = False,
    effort: float = 1.0,
    interval_table: Source | IntervalTable | None = None,
    feed_mode: FeedMode = "per-minute",
    chord_tolerance: float = CHORD_TOLERANCE,
    block_time: float = BLOCK_TIME,
    safe_z: float | None = None,
    depth: float | None = None,
    strict: bool = False,
    force: bool = False,
    require_all: bool = False,
    progress: Progress = no_progress,
) -> Compensation:
    """Compensate a path or a part program for the backlash of a machine.

    The method is that of [1]_, and the choice among its variants is made by simulation. A path is planned and
    written anew. Of a part program only what has to change is changed, and the result is verified before it
    is returned.

    Parameters
    ----------
    job : Path, PartProgram, str or path
        A file name may be that of a shipped path.
    machine : Machine, str or path
        A file name may be that of a shipped machine.
    output : {"program", "table"}
        Output that `before` and `after` of the result belong to; both can be written.
    strategy : str, optional
        Method of compensation: "auto" by default, "suppress" where a profile is described by `ratio`,
        `degree`, `t_star` or `coefficients`.
    tolerance : float
        Largest distance of the osculating circle from the path inside a window [m].
    feed : float, optional
        Feed in place of the path's [m/s].
    dialect : str, optional
        Controller dialect in place of the machine's.
    start : {"rest", "moving"}
        Begin and end at rest and stop in sharp corners, or hold the feed from end to end.
    ratio : float, optional
        Feed in the middle of every profile, V(½) / V_c.
    degree : int, optional
        Degree of every profile, n of Eq. (26) of [1]_, even.
    t_star : float, optional
        Half duration of every profile [s].
    coefficients : tuple of float, optional
        All V_k / V_c of Eq. (26) of [1]_.
    allow_retrograde : bool
        Let the feed become negative.
    min_feed : float, optional
        Lowest feed while cutting [m/s].
    max_slowdown : float
        Largest growth of the time, relative.
    feed_only : bool
        Leave the path as it is: nothing is added to its positions.
    no_inverse_dynamics : bool
        Do not lead a table's path by what the servos lag behind it.
    effort : float
        Effort of the search: 1 for some ten seconds.
    interval_table : IntervalTable, str or path, optional
        Table of :func:`ph_post.sweep` in which backlash intervals are looked up, in place of solving for them.
    feed_mode : {"per-minute", "inverse-time"}
        Form of F words.
    chord_tolerance : float
        Largest distance of a chord from the path [m].
    block_time : float
        Longest block in ramps and dips [s].
    safe_z, depth : float, optional
        Height at which a path is approached and left, and at which a planar path is cut [m].
    strict : bool
        Refuse a part program with commands that are not understood.
    force : bool
        Compensate a part program anew that was compensated otherwise before.
    require_all : bool
        Refuse a result in which a reversal at which the tool cuts is not compensated.
    progress : callable, optional
        Called with the name of every stage.

    Returns
    -------
    Compensation

    Raises
    ------
    InputError
        Where the job, the machine or an option is bad.
    PhPostError
        Where a compensated program does not pass its own check, or, with `require_all`, leaves a reversal.

    References
    ----------
    .. [1] Real-time compensation of backlash positional errors in CNC machines by localized feedrate
       modulation, Int. J. Adv. Manuf. Technol. 119 (2022), doi:10.1007/s00170-021-08515-z.

    Examples
    --------
    >>> import ph_post as ph
    >>> result = ph.compensate("circle", "paper", output="table", strategy="suppress")
    >>> result.reversals
    ReversalCount(compensated=3, all=3)
    >>> result.after.error_gap.max < result.before.error_gap.max
    True
    """
    options = CompensateOptions(
        strategy=strategy,
        tolerance=tolerance,
        feed=feed,
        dialect=dialect,
        start=start,
        ratio=ratio,
        degree=degree,
        t_star=t_star,
        coefficients=coefficients,
        allow_retrograde=allow_retrograde,
        min_feed=min_feed,
        max_slowdown=max_slowdown,
        feed_only=feed_only,
        no_inverse_dynamics=no_inverse_dynamics,
        effort=effort,
        interval_table=interval_table,
        feed_mode=feed_mode,
        chord_tolerance=chord_tolerance,
        block_time=block_time,
        safe_z=safe_z,
        depth=depth,
        strict=strict,
        force=force,
        require_all=require_all,
    )
    return compensated(job, machine, options, output, progress)


def undo(program: PartProgram | SourceBytes | Source) -> bytes:
    r"""Return the original of a compensated part program, byte for byte.

    Parameters
    ----------
    program : PartProgram, str or path

    Returns
    -------
    bytes

    Raises
    ------
    InputError
        Where the program was not compensated, or was changed after that.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import ph_post as ph
    >>> original = b"G21 G90\nG0 X0 Y0\nG1 X10 F600\nY10\nX0\nY0\nM2\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "part.ngc")
    ...     _ = file.write_bytes(original)
    ...     ph.compensate(ph.read_program(file), "router", max_slowdown=10.0).write(file)
    ...     file.read_bytes() == original, ph.undo(file) == original
    (False, True)
    """
    if isinstance(program, PartProgram | SourceBytes):
        return edit_undo.undo(program.data, program.name)
    raw = read_raw(or_shipped("paths", program))
    return edit_undo.undo(raw.data, raw.name)
