"""Look at a motion without writing it: inspect its reversals, and simulate it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import PurePath
from typing import Any, Final, get_args

import msgspec
from msgspec.structs import replace

from ph_post.analysis.certification import Certificate
from ph_post.analysis.certification import certify as certify_turning_points
from ph_post.analysis.path_analysis import AnalysedPath, Analysis
from ph_post.api.crossed_paths import crosses_on_the_fly
from ph_post.api.inputs import Job, Source, analyse_job, analysed_job, any_machine, machine_warnings
from ph_post.api.options import CompensateOptions, require_number, require_word
from ph_post.api.results import AssessedMotion, PlannedMotion
from ph_post.compensate.comparison import describe_violation
from ph_post.compensate.options import PlanOutput
from ph_post.compensate.plan import make_plan
from ph_post.compensate.violations import Violation, check_command
from ph_post.drive.axes import check_axes, gravity_notes
from ph_post.drive.intervals import IntervalTable
from ph_post.edit.edits import TOLERANCE
from ph_post.errors import OptionsError
from ph_post.files.storage import write_atomically
from ph_post.files.table import FORMATS, log_content, read_table, require_path
from ph_post.progress import Progress, no_progress
from ph_post.simulate import machine as simulated
from ph_post.simulate.assess import Assessment, assess, scenario_words, scenarios
from ph_post.simulate.contour import ContourError, Nominal, settling_time
from ph_post.types import (
    Command,
    Event,
    Flank,
    Machine,
    Path,
    Pickup,
    Run,
    TurningPoint,
)
from ph_post.version import package_version

_STOPS: Final = (
    "the plan stops where an axis reverses; the programs that `convert` writes for this machine do not: "
    "`compare --carrier program` runs them"
)


class Inspection(msgspec.Struct, AnalysedPath, frozen=True, kw_only=True, eq=False):
    """The reversals of a path, as :func:`inspect` finds them.

    `certificate` is the exact count of the turning points, None where it was not asked for; `warnings` say
    what of a part program is not in its path.
    """

    analysis: Analysis
    certificate: Certificate | None = None
    warnings: tuple[str, ...] = ()


def inspect(
    job: Job,
    machine: Machine | Source | None = None,
    *,
    tolerance: float = TOLERANCE,
    feed: float | None = None,
    dialect: str | None = None,
    certify: bool = False,
    interval_table: Source | IntervalTable | None = None,
    progress: Progress = no_progress,
) -> Inspection:
    """List the reversals of a path, their windows and, with a machine, their backlash.

    Parameters
    ----------
    job : Path, PartProgram, str or path
        Of a part program the longest path.
    machine : Machine, str or path, optional
    tolerance : float, optional
        Largest distance of the osculating circle from the path inside a window, ε [m].
    feed : float, optional
        Feed [m/s] in place of the path's; segments with a feed of their own keep it.
    dialect : str, optional
        Controller dialect in place of the machine's; a program is read by its words.
    certify : bool, optional
        Also count and isolate the turning points in exact rational arithmetic.
    interval_table : IntervalTable, str or path, optional
        Table in which backlash intervals are looked up, in place of solving for them.
    progress : callable, optional
        Called with the name of every stage.

    Returns
    -------
    Inspection

    Raises
    ------
    InputError
        Where an input is bad, or the machine lacks an axis of the path.

    Examples
    --------
    >>> import ph_post as ph
    >>> found = ph.inspect("circle", "paper")
    >>> [(point.axis, point.sense) for point in found.turning_points]
    [('X', 'max'), ('Y', 'max'), ('X', 'min'), ('Y', 'min')]
    """
    require_number("tolerance", tolerance)
    require_number("feed", feed)
    analysis, notes = analyse_job(
        job,
        machine,
        tolerance=tolerance,
        feed=feed,
        dialect=dialect,
        interval_table=interval_table,
        progress=progress,
    )
    certificate = None
    if certify:
        progress("counting roots in exact rational arithmetic")
        certificate = certify_turning_points(analysis.track)
    if analysis.machine is not None:
        notes += gravity_notes(analysis.machine, analysis.path.axes)
    return Inspection(analysis=analysis, certificate=certificate, warnings=notes)


class NotedResult(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What has to be known of a result: `notes` say what of a part program is not in its path, `caveats` all else."""

    notes: tuple[str, ...] = ()
    caveats: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """All that has to be known, a sentence each."""
        return (*self.notes, *self.caveats)


class Simulation(NotedResult, AssessedMotion, frozen=True, kw_only=True, eq=False):
    """A command on a machine, as :func:`simulate` runs it.

    `analysis` and `assessment` are None where the path is not known. `run` is the run that `error` belongs to.
    `motion` is that of the plan, None of a table.
    """

    name: str
    command: Command
    machine: Machine
    analysis: Analysis | None
    run: Run
    assessment: Assessment | None
    motion: PlannedMotion | None = None

    @property
    def time(self) -> float:
        """Duration of the motion [s]."""
        return float(self.run.t[-1])

    @property
    def error_gap(self) -> ContourError | None:
        """Contour error that backlash adds to the same run without any [m]."""
        return None if self.assessment is None else self.assessment.error_gap

    @property
    def events(self) -> tuple[Event, ...]:
        """Events inside the axes, in order of time."""
        return self.run.events

    @property
    def turning_points(self) -> tuple[TurningPoint, ...]:
        """Turning points of the path, none where it is not known."""
        return () if self.analysis is None else self.analysis.turning_points

    def log(self) -> bytes:
        """Return commanded and executed motion as a log (CSV) that ``read_log`` reads."""
        digest = f", sha256 {self.machine.digest}" if self.machine.digest else ""
        remarks = {
            "made by": f"ph-post {package_version()} simulate",
            "motion": self.name,
            "machine": self.machine.name + digest,
            "assumed": scenario_words(self.run.scenario),
            "units": "s, mm; X_act is the table, X_motor the motor in units of the table",
        }
        if self.analysis is not None:
            remarks["path"] = f"{self.analysis.path.name}, sha256 {self.analysis.path.digest}"
        return log_content(self.run, remarks)

    def write_log(self, target: Source) -> None:
        """Write :meth:`log` to a file; ``-`` is standard output."""
        write_atomically({os.fspath(target): self.log()})


def simulate(
    job: Job | Command,
    machine: Machine | Source,
    *,
    path: Path | Source | None = None,
    strategy: str = "none",
    output: PlanOutput = "table",
    pickup: Pickup | None = None,
    initial_flank: Flank | None = None,
    progress: Progress = no_progress,
    **planning: Any,
) -> Simulation:
    """Run a path or an interpolator table on a machine, and measure how far the table leaves the path.

    What the machine file leaves open is tried: the flank on which an axis stands at first, the pick-up rule,
    and gap, beta and gain off by their uncertainties.

    Parameters
    ----------
    job : Path, PartProgram, Command, str or path
        A path, which is planned first, or the rows of an interpolator table or a file of one (``.csv``,
        ``.npz``, ``.parquet``).
    machine : Machine, str or path
    path : Path, str or path, optional
        The path that a table was made for; without it there is no contour error.
    strategy : str, optional
        Strategy at each turning point of a path.
    output : {"table", "program"}, optional
        Plan as for an interpolator table, or as for a part program.
    pickup : {"standstill", "momentum", "contact"}, optional
        Pick-up rule of all axes, in place of the machine's.
    initial_flank : {"+", "-"}, optional
        Flank on which all axes stand at first, in place of the machine's.
    progress : callable, optional
        Called with the name of every stage.
    **planning
        `tolerance`, `feed`, `corner_tolerance`, `dialect`, `start`, `ratio`, `degree`, `t_star`, `coefficients`,
        `allow_retrograde`, `min_feed`, `max_slowdown`, `max_standstill`, `feed_only`, `no_inverse_dynamics`,
        `effort` and `interval_table` of :func:`ph_post.compensate`.

    Returns
    -------
    Simulation

    Raises
    ------
    InputError
        Where an input is bad, the machine lacks an axis, or a table belongs to another path.
    PhPostError
        Where the strategy finds no motion inside the limits.

    Examples
    --------
    >>> import ph_post as ph
    >>> run = ph.simulate("circle", "router")
    >>> run.error.max > run.error_gap.rms > 0.0
    True
    """
    how = CompensateOptions(strategy=strategy, **planning)
    require_word("output", output, get_args(PlanOutput))
    require_word("pickup", pickup, (None, *get_args(Pickup)))
    require_word("initial_flank", initial_flank, (None, "+", "-"))
    rules = partial(_with_rules, pickup=pickup, flank=initial_flank)
    progress("reading")
    table = _table_of(job)
    if table is not None:
        found = _from_table(table, path, machine, how, progress)
        found = replace(found, machine=rules(found.machine))
    elif path is not None:
        raise OptionsError("--path goes with an interpolator table; a path file is its own path")
    else:
        assert not isinstance(job, Command)
        found = _from_plan(job, machine, how, output, rules, progress)
    caveats = (*found.caveats, *_caveats(found.command, found.machine))
    progress("simulating")
    run, assessment = _run(found)
    if assessment is not None and assessment.error is None:
        seconds = settling_time(found.machine, found.command.axes)
        late = f"the motion is over before its contour error counts, {seconds:.3g} s after its start"
        caveats = (*caveats, late)
    return Simulation(
        name=found.name,
        command=found.command,
        machine=found.machine,
        analysis=found.analysis,
        run=run,
        assessment=assessment,
        motion=found.motion,
        notes=found.notes,
        caveats=caveats,
    )


class _Commanded(NotedResult, frozen=True, kw_only=True, eq=False):
    """A command that is to be run, and where it comes from: a table, whose path may not be known, or a plan."""

    name: str
    command: Command
    machine: Machine
    analysis: Analysis | None = None
    motion: PlannedMotion | None = None


def _from_table(
    table: tuple[Command, str, str],
    path: Path | Source | None,
    machine: Machine | Source,
    how: CompensateOptions,
    progress: Progress,
) -> _Commanded:
    """Take the rows of a table, as :func:`_table_of` returns them, for a path where that is known."""
    command, name, file = table
    if path is None:
        drives, machine_name = any_machine(machine)
        check_axes(command.axes, "table", drives, machine_name)
        unknown = "without --path the path is not known, and so no contour error"
        return _Commanded(name=name, command=command, machine=drives, caveats=(unknown,))
    analysis, notes = analysed_job(path, machine, how, progress)
    command = require_path(command, analysis.track, file)
    return _Commanded(name=name, command=command, machine=machine_of(analysis), analysis=analysis, notes=notes)


def _from_plan(
    job: Job,
    machine: Machine | Source,
    how: CompensateOptions,
    output: PlanOutput,
    rules: Callable[[Machine], Machine],
    progress: Progress,
) -> _Commanded:
    """Plan a path, and take the plan's command, for a machine with other `rules` than the plan's."""
    analysis, notes = analysed_job(job, machine, how, progress)
    progress("planning the feed")
    plan = make_plan(analysis, how.plan(output), progress)
    caveats = (*analysis.path.remarks, *plan.warnings)
    if output == "program" and crosses_on_the_fly(analysis.path.axes, plan.machine, how):
        caveats = (*caveats, _STOPS)
    motion = PlannedMotion(analysis, replace(plan, machine=rules(plan.machine)))
    return _Commanded(
        name=f"{analysis.path.name}, strategy {plan.strategy}",
        command=motion.command,
        machine=motion.plan.machine,
        analysis=analysis,
        motion=motion,
        notes=notes,
        caveats=caveats,
    )


def _run(found: _Commanded) -> tuple[Run, Assessment | None]:
    """Run a command on its machine; without a path there is no assessment."""
    if found.analysis is None:
        scenario = scenarios(found.machine, found.command.axes)[0]
        return simulated.simulate(found.command, found.machine, scenario), None
    if found.motion is not None:
        assessment = found.motion.assessment
    else:
        nominal = Nominal(found.analysis.track)
        assessment = assess(found.command, found.machine, nominal, found.analysis.turning_points)
    return assessment.run, assessment


def _table_of(job: Job | Command) -> tuple[Command, str, str] | None:
    """Return the rows of an interpolator table, its short and its full name; None for a path."""
    if isinstance(job, Command):
        return job, "interpolator table", "interpolator table"
    if isinstance(job, str | os.PathLike) and PurePath(job).suffix.lower() in FORMATS:
        return read_table(job), PurePath(job).name, os.fspath(job)
    return None


def machine_of(analysis: Analysis) -> Machine:
    """Return the machine of a job that was analysed on one."""
    assert analysis.machine is not None
    return analysis.machine


def _with_rules(machine: Machine, pickup: Pickup | None, flank: Flank | None) -> Machine:
    """Put a pick-up rule and a first flank, where given, in place of those of every axis."""
    axes = {}
    for name, axis in machine.axes.items():
        gap = replace(axis.gap, pickup=pickup or axis.gap.pickup, initial_flank=flank or axis.gap.initial_flank)
        axes[name] = replace(axis, gap=gap)
    return replace(machine, axes=axes)


def _caveats(command: Command, machine: Machine) -> Iterator[str]:
    """Name the effects that do not act, and the limits that the command breaks, the worst place of each."""
    yield from machine_warnings(machine, command.axes)
    worst: dict[tuple[str, str], Violation] = {}
    for broken in check_command(command, machine):
        known = worst.get((broken.axis, broken.quantity))
        if known is None or broken.value > known.value:
            worst[broken.axis, broken.quantity] = broken
    yield from (f"the command {describe_violation(broken)}" for broken in worst.values())
