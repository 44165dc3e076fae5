"""Compensate a part program, and verify the result before anyone gets it."""

from __future__ import annotations

from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.analysis.path_analysis import Analysis
from ph_post.api.compensated_program import CompensatedProgram, ProgramRequest, cycle_time
from ph_post.api.expansion import in_own_lines
from ph_post.api.guard import LEAST
from ph_post.api.lead_work import LeadWork
from ph_post.api.led_programs import require_lead
from ph_post.api.plan_search import EditPlanner, PlanSearch
from ph_post.api.results import ProgramMotion
from ph_post.compensate.friction import friction_of_machine
from ph_post.compensate.plan_warnings import doubtful_values
from ph_post.compensate.strategies.registry import PLAIN, find_traits
from ph_post.dialects.declaration import CORRECTED, THREADS, read_declaration
from ph_post.dialects.registry import find_dialect
from ph_post.drive.axes import check_axes, has_backlash
from ph_post.edit.cutter_contours import LEFT
from ph_post.edit.preconditions import (
    reckoned_feeds,
    require_tool,
    require_words,
    warn_centres,
    warn_dwells,
    warn_reckoned,
)
from ph_post.edit.threads import THREAD_LEFT, Threads
from ph_post.edit.undo import original_of
from ph_post.edit.window_plans import shifts_axes
from ph_post.errors import InputError
from ph_post.gcode.paths import ProgramPath
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import with_contours
from ph_post.post.options import check_block_time
from ph_post.progress import Progress, no_progress
from ph_post.simulate.controllers.moves import moved_axes
from ph_post.simulate.controllers.path_modes import chord_warnings, path_mode_warnings
from ph_post.types import Machine
from ph_post.version import package_version

BOTH: Final = 2
"""Programs that are compared."""


def compensate_program(
    program: PartProgram,
    machine: Machine,
    request: ProgramRequest,
    progress: Progress = no_progress,
    path: tuple[ProgramPath, Analysis] | None = None,
) -> CompensatedProgram:
    """Compensate a part program for a machine.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
        Its dialect gives the words of new lines.
    request : ProgramRequest
    progress : Progress, optional
        Called with what is being done.
    path : ProgramPath and Analysis, optional
        Path of which the program was made; a lead is planned on it.

    Returns
    -------
    CompensatedProgram

    Raises
    ------
    InputError
        Where the machine lacks an axis that the program moves, the program was compensated for something else
        before, or a change cannot be written.
    PhPostError
        Where the outcome does not pass :func:`ph_post.verify.verify.verify`: nothing is to be written then.
    """
    dialect = find_dialect(machine.dialect)
    if request.lead:
        require_lead(machine, dialect, [name for name in moved_axes(program) if name in machine.axes])
    check_block_time(request.edit.block_time, machine.servo_period)
    original = _original(program, machine, request)
    original.source.let_go()
    require_words(original)
    require_tool(original, machine)
    head = read_declaration(program.data)
    if head is not None and not request.force:
        if head.corrected:
            original, program = with_contours(original), with_contours(program)
        return CompensatedProgram(before=original, after=program, done=True)
    check_axes(moved_axes(original), "program", machine, f"machine {machine.name}")
    if request.lead:
        return _best_lead(original, machine, request, progress, path)
    contoured = with_contours(original) if _on_contours(original, machine, request) else original
    found = _planned(contoured, machine, request, progress)
    if contoured is original or found.edits is None:
        return found
    said = found.edits.warnings
    if any(word.startswith((CORRECTED, THREADS)) for word in said):
        return found
    # No contour or thread is shifted: the program is read as one in which they are passed through.
    left = tuple(word for word in said if LEFT in word or THREAD_LEFT in word)
    left = (*left, *Threads(contoured).words_of_none(left))
    return _planned(original, machine, request, progress, left)


def _planned(
    original: PartProgram,
    machine: Machine,
    request: ProgramRequest,
    progress: Progress,
    said: tuple[str, ...] = (),
) -> CompensatedProgram:
    """Plan, write and judge a program until it is good; `said` is added to its warnings."""
    dialect = find_dialect(machine.dialect)
    reckoned = reckoned_feeds(original, machine)
    planner = EditPlanner(reckoned, machine, dialect, request, progress)
    before = ProgramMotion(reckoned, reckoned, machine, "original", progress)
    options = replace(request.edit, cycle=cycle_time(before))
    # While nothing else is as large as the program: fitting takes as much as the program itself.
    paths = planner.paths
    original.source.let_go()
    paths_said = path_mode_warnings(original, machine, dialect)
    rounds = bool(paths_said) and dialect.syntax.path_mode is not None
    paths_said += chord_warnings(original, machine, dialect, options.tolerance)
    paths_said += [*doubtful_values(machine, moved_axes(original)), *warn_reckoned(original, reckoned), *said]
    paths_said += warn_centres(original) + warn_dwells(original)
    paths_said += _friction_left(original, machine, request)
    found = PlanSearch(original, planner, before, request, tuple(paths_said), rounds, progress).run(options)
    return replace(found, paths=paths)


def _friction_left(program: PartProgram, machine: Machine, request: ProgramRequest) -> list[str]:
    """Say that a program without the lead leaves the friction of its axes in the part."""
    moved = [name for name in moved_axes(program) if name in machine.axes]
    names = [name for name, one in friction_of_machine(machine, moved).items() if one.turns]
    if request.lead or request.lead_left or not names:
        return []
    foreign = find_dialect(machine.dialect).language.read is not None
    option = "--table leads it" if foreign else "--lead-program or --table leads it"
    return [f"the friction of {' and '.join(names)} stays in the part, behind each reversal; {option}"]


def _on_contours(program: PartProgram, machine: Machine, request: ProgramRequest) -> bool:
    """Return whether all axes that move and have backlash are shifted, so that contours can be shifted with them."""
    axes = [machine.axes[name] for name in moved_axes(program) if has_backlash(machine.axes[name])]
    return shifts_axes(request.plan) and not any(axis.loop.encloses_backlash for axis in axes)


def _best_lead(
    program: PartProgram,
    machine: Machine,
    request: ProgramRequest,
    progress: Progress,
    path: tuple[ProgramPath, Analysis] | None,
) -> CompensatedProgram:
    """Return the program with the lead, by the strategy's plan or alone, or without it where the part is better so."""
    dialect = find_dialect(machine.dialect)
    found = LeadWork(program, machine, dialect, request, progress).made(path)
    if find_traits(request.plan.strategy).chooses:
        alone = replace(request, plan=replace(request.plan, strategy=PLAIN))
        digest = request.digest(machine.dialect)
        found = _better(found, LeadWork(program, machine, dialect, alone, progress, digest).made(path))
    if not EditPlanner(program, machine, dialect, request, progress).offsets_axes:
        return found
    without = compensate_program(program, machine, replace(request, lead=False, lead_left=True), progress)
    if _better(found, without) is found or without.edits is None:
        return found
    said = "no lead is written: the part is better with its backlash compensated on the fly"
    return replace(without, edits=replace(without.edits, warnings=(said, *without.edits.warnings)))


def _better(one: CompensatedProgram, other: CompensatedProgram) -> CompensatedProgram:
    """Return the program with the smaller error by all causes, the first where they are not known."""
    motions = [found.motions[1] for found in (one, other) if found.motions is not None]
    if len(motions) < BOTH:
        return other if one.motions is None and other.motions is not None else one
    sizes = [(found.error, found.error_worst) for found in motions]
    errors = [[size for own in pair if own is not None for size in (own.max, own.rms)] for pair in sizes]
    if not errors[0] or len(errors[0]) != len(errors[1]):
        return one
    ratio = np.array(errors[1]) / np.maximum(errors[0], LEAST)
    return other if float(ratio.mean()) < 1.0 else one


def _original(program: PartProgram, machine: Machine, request: ProgramRequest) -> PartProgram:
    """Return the program before any compensation: the input itself where there was none."""
    found = read_declaration(program.data)
    if found is None:
        return in_own_lines(program)
    asked = (package_version(), machine.digest, request.digest(machine.dialect))
    had = (found.version, found.machine_digest, found.options_digest)
    same = had[0] == asked[0] and all(new.startswith(old) for old, new in zip(had, asked, strict=True))
    if not same and not request.force:
        raise InputError(
            program.name,
            f"compensated before, by ph-post {found.version} for {found.machine}",
            expected="the original, or --force to begin again from it, or --undo",
        )
    return in_own_lines(original_of(program) or program)
