"""Compare the strategies on a job: by their plans, or by the part programs that they write, run on a model."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from msgspec.structs import replace

from ph_post.analysis.path_analysis import Analysis
from ph_post.api.compensation import compensated
from ph_post.api.crossed_paths import crosses_on_the_fly
from ph_post.api.inputs import Job, Source, analysed_job, machine_warnings, raw_job
from ph_post.api.motion import NotedResult, machine_of
from ph_post.api.options import CompensateOptions
from ph_post.api.outcomes import Compensation
from ph_post.api.path_compensation import PathCompensation
from ph_post.api.program_compensation import ProgramCompensation
from ph_post.api.results import ProgramMotion
from ph_post.compensate.comparison import (
    Contender,
    MotionCost,
    chosen_in_order,
    compare_strategies,
    in_order,
    peak_acceleration,
    refused,
    slowest_feed,
    without_backlash,
)
from ph_post.compensate.options import PlanOutput
from ph_post.compensate.standstill import CREEP
from ph_post.compensate.strategies.registry import PLAIN, default_strategy, find_traits, strategy_names
from ph_post.dialects.reading import read_as
from ph_post.errors import PhPostError, TooLargeError
from ph_post.files.storage import SourceBytes, is_program
from ph_post.gcode.program import PartProgram
from ph_post.progress import Progress, no_progress, prefixed
from ph_post.simulate.contour import ContourError
from ph_post.simulate.controllers.deviation import cut_error
from ph_post.types import Machine, Path, Scenario


class StrategyComparison(NotedResult, frozen=True, kw_only=True, eq=False):
    """All strategies on one path and machine, as :func:`compare` runs them.

    `name` is that of the job. `strategies` begin with the plain program. `error_without_gap` [m] is the plain program's
    contour error without any backlash. Of plans of a path there is its `analysis`, of programs that were run on their
    controller what is `written` by the strategy that chooses.
    """

    name: str
    strategies: tuple[Contender, ...]
    error_without_gap: ContourError | None
    analysis: Analysis | None = None
    written: Compensation | None = None


def compare(
    job: Job,
    machine: Machine | Source,
    *,
    output: PlanOutput | None = None,
    progress: Progress = no_progress,
    **planning: Any,
) -> StrategyComparison:
    """Plan and simulate every strategy on a job, the plain program first.

    Parameters
    ----------
    job : Path, PartProgram, str or path
        A table is that of a part program's longest path.
    machine : Machine, str or path
    output : {"table", "program"}, optional
        What the strategies make: by default a part program of a part program, and of a path an interpolator table.
        Programs are what :func:`ph_post.compensate` writes; where axes cross their backlash on the fly, each is run on
        a model of its controller.
    progress : callable, optional
        Called with the name of every stage.
    **planning
        As of :func:`simulate`.

    Returns
    -------
    StrategyComparison
        A strategy that refuses the job, or breaks a limit, is listed with the reason.

    Raises
    ------
    InputError
        Where an input is bad, or the machine lacks an axis of the path.

    Examples
    --------
    >>> import ph_post as ph
    >>> found = ph.compare("circle", "router", output="program", effort=0.01)
    >>> plain, *others = found.strategies
    >>> plain.name, others[-1].name
    ('none', 'auto')
    """
    how = CompensateOptions(**planning)
    raw = raw_job(job)
    of_program = isinstance(job, PartProgram) or (isinstance(raw, SourceBytes) and is_program(raw))
    if of_program and output != "table":
        return _compare_programs(raw, machine, how, progress)
    analysis, notes = analysed_job(raw, machine, how, progress)
    drives, what = machine_of(analysis), output or "table"
    if what == "program":
        chooses = replace(how, strategy=default_strategy(described=False))
        if crosses_on_the_fly(analysis.path.axes, drives, chooses):
            return _compare_programs(raw, machine, how, progress)
    contenders = compare_strategies(analysis, lambda name: replace(how, strategy=name).plan(what), progress)
    return StrategyComparison(
        name=analysis.path.name,
        strategies=contenders,
        error_without_gap=without_backlash(analysis, contenders[0]),
        analysis=analysis,
        notes=notes,
        caveats=(*analysis.path.remarks, *machine_warnings(drives, analysis.path.axes)),
    )


def _compare_programs(
    job: Path | SourceBytes, machine: Machine | Source, options: CompensateOptions, progress: Progress
) -> StrategyComparison:
    """Write the program of every strategy, and run each on the model of its controller."""

    def make(name: str) -> Compensation:
        progress(f"writing the program of {name}")
        made = compensated(job, machine, replace(options, strategy=name), "program", prefixed(progress, name))
        made.program()
        return made

    first = make(PLAIN)
    plain = _motion_of_program(first, progress)
    found = [_contender(PLAIN, first, plain)]
    written: Compensation | None = None
    for name in in_order(strategy_names())[1:]:
        try:
            made = make(name)
            found.append(_contender(name, made, _motion_of_program(made, progress, plain), first.warnings))
        except TooLargeError:
            raise
        except PhPostError as refusal:
            found.append(refused(name, refusal))
            continue
        written = made if find_traits(name).chooses else written
    return StrategyComparison(
        name=job.name,
        strategies=tuple(found),
        error_without_gap=_error_without_backlash(plain),
        written=written,
        caveats=first.warnings,
    )


def _motion_of_program(made: Compensation, progress: Progress, plain: ProgramMotion | None = None) -> ProgramMotion:
    """Return the motion of what was written; of a planned path its program is read again.

    Parameters
    ----------
    made : Compensation
    progress : callable
    plain : ProgramMotion, optional
        The motion of the plain program, against whose path it is measured; left out where it is this one.
    """
    motion = made.after
    if isinstance(motion, ProgramMotion):
        return motion
    program = read_as(made.machine.dialect, made.program(), "program")
    original = program if plain is None else plain.original
    return ProgramMotion(program, original, made.machine, "program", progress, plain)


def _error_without_backlash(motion: ProgramMotion) -> ContourError | None:
    """Return the contour error of a motion on the machine without any backlash [m]."""
    return None if motion.assessment is None else cut_error(motion.cut, (Scenario(gap=0.0),)).error


def _program_cost(motion: ProgramMotion) -> MotionCost:
    """Measure a program on its controller; below `CREEP` of its highest feed while cutting it stands still."""
    command, counted, feed = motion.command, motion.cut.counted, motion.command.feed
    still = CREEP * float(feed[counted].max(initial=0.0))
    return MotionCost(
        cycle_time=motion.time,
        min_feed=slowest_feed(feed, counted, still),
        standstill_time=command.period * int((feed[counted] <= still).sum()),
        retrograde=False,
        peak_acceleration=peak_acceleration(command),
    )


def _contender(name: str, made: Compensation, motion: ProgramMotion, said: Sequence[str] = ()) -> Contender:
    return Contender(
        name=name,
        ok=True,
        pace=_program_cost(motion),
        assessment=motion.assessment,
        error_gap=motion.error_gap,
        chosen=_chosen(made),
        warnings=tuple(word for word in made.warnings if word not in said),
    )


def _chosen(made: Compensation) -> tuple[tuple[str, str], ...]:
    """Return the axis of every reversal, in order, and what is done there."""
    if isinstance(made, ProgramCompensation):
        return tuple((one.point.axis, one.strategy) for one in made.places)
    assert isinstance(made, PathCompensation)
    if made.crossed is not None:
        return tuple((one.point.axis, one.strategy) for one in made.crossed.reversals)
    return chosen_in_order(made.plan("program"))
