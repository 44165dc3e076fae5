"""Compare the strategies by the part programs that they write, as a model of the controller runs them."""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
from msgspec.structs import replace

from ph_post.api.compensation import compensated
from ph_post.api.inputs import Source
from ph_post.api.options import CompensateOptions
from ph_post.api.outcomes import Compensation
from ph_post.api.path_compensation import PathCompensation
from ph_post.api.program_compensation import ProgramCompensation
from ph_post.api.results import ProgramMotion
from ph_post.compensate.comparison import (
    Contender,
    MotionCost,
    chosen_in_order,
    in_order,
    peak_acceleration,
    slowest_feed,
)
from ph_post.compensate.standstill import CREEP
from ph_post.compensate.strategies.registry import PLAIN, find_traits, strategy_names
from ph_post.dialects.reading import read_as
from ph_post.errors import PhPostError, TooLargeError
from ph_post.files.storage import SourceBytes
from ph_post.progress import Progress, prefixed
from ph_post.simulate.contour import ContourError
from ph_post.simulate.controllers.deviation import cut_error
from ph_post.types import Machine, Path, Scenario


class ComparedPrograms(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The programs of all strategies, as :func:`compare_programs` runs them.

    `error_without_gap` [m] is the plain program's contour error without any backlash, `written` what the strategy that
    chooses makes, None where it refused; `warnings` are those of the plain program, which the others do not repeat.
    """

    contenders: tuple[Contender, ...]
    error_without_gap: ContourError | None
    written: Compensation | None
    warnings: tuple[str, ...]


def compare_programs(
    job: Path | SourceBytes, machine: Machine | Source, options: CompensateOptions, progress: Progress
) -> ComparedPrograms:
    """Write the program of every strategy, and run each on the model of its controller.

    Parameters
    ----------
    job : Path or SourceBytes
    machine : Machine, str or path
    options : CompensateOptions
        Those of every strategy, whose name is put in.
    progress : callable

    Raises
    ------
    InputError
        Where an input is bad, so that there is no plain program either.
    """

    def make(name: str) -> Compensation:
        progress(f"writing the program of {name}")
        made = compensated(job, machine, replace(options, strategy=name), "program", prefixed(progress, name))
        made.program()
        return made

    first = make(PLAIN)
    plain = motion_of_program(first, progress)
    found = [_contender(PLAIN, first, plain)]
    written: Compensation | None = None
    for name in in_order(strategy_names())[1:]:
        try:
            made = make(name)
            found.append(_contender(name, made, motion_of_program(made, progress, plain), first.warnings))
        except TooLargeError:
            raise
        except PhPostError as refusal:
            found.append(Contender(name=name, ok=False, reason=" ".join(str(refusal).split())))
            continue
        written = made if find_traits(name).chooses else written
    return ComparedPrograms(
        contenders=tuple(found),
        error_without_gap=error_without_backlash(plain),
        written=written,
        warnings=first.warnings,
    )


def motion_of_program(made: Compensation, progress: Progress, plain: ProgramMotion | None = None) -> ProgramMotion:
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


def error_without_backlash(motion: ProgramMotion) -> ContourError | None:
    """Return the contour error of a motion on the machine without any backlash [m]."""
    return None if motion.assessment is None else cut_error(motion.cut, (Scenario(gap=0.0),)).error


def program_cost(motion: ProgramMotion) -> MotionCost:
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
        pace=program_cost(motion),
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
