"""Write a path as a part program that crosses backlash on the fly.

The plain program of the path is written first, and then changed as any part program is: there is one way for both, and
what undoes it gives the plain program back.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.analysis.path_analysis import Analysis
from ph_post.api.compensated_program import CompensatedProgram, ProgramRequest
from ph_post.api.led_programs import require_lead
from ph_post.api.options import CompensateOptions
from ph_post.api.programs import compensate_program
from ph_post.api.results import MotionResult
from ph_post.api.reversals import ProgramReversal, path_reversals, program_reversals
from ph_post.compensate.offsets import may_shift
from ph_post.compensate.plan import make_plan
from ph_post.compensate.strategies.registry import PLAIN, find_traits
from ph_post.dialects.planners import planner_notes
from ph_post.dialects.reading import read_as
from ph_post.dialects.registry import find_dialect
from ph_post.gcode.paths import ProgramPath
from ph_post.gcode.program import AXES, PartProgram
from ph_post.post.program import Program, make_program
from ph_post.progress import Progress, no_progress
from ph_post.types import Machine, Path, Plan

SAME: Final = 1e-9
"""Points that differ by no more [m] are the same."""


def crosses_on_the_fly(axes: Sequence[str], machine: Machine, options: CompensateOptions) -> bool:
    """Return whether the program of a path is its plain program, changed.

    That is where an axis of the path gets a lasting offset, programs of the dialect can be edited, and the machine has
    every axis that the program moves.
    """
    if options.lead_program:
        return True
    traits = find_traits(options.chosen_strategy)
    if options.feed_only or traits.is_baseline or not traits.shifts_axes:
        return False
    abilities = find_dialect(machine.dialect).abilities
    # Polynomials say more than straight moves and arcs, and a change could not divide them.
    editable = abilities.polynomial_degree == 1 and abilities.full_circles
    whole = options.safe_z is None or "Z" in machine.axes
    return editable and whole and any(may_shift(machine.axes[name]) for name in axes)


class CrossedPath:
    """The plain program of a path, and what it is compensated by crossings on the fly.

    Parameters
    ----------
    analysis : Analysis
        With a machine.
    options : CompensateOptions
    progress : callable, optional

    Raises
    ------
    InputError
        Where the dialect cannot write it, or its decimals are too few for an offset.
    """

    def __init__(self, analysis: Analysis, options: CompensateOptions, progress: Progress = no_progress) -> None:
        assert analysis.machine is not None
        self.analysis, self.machine = analysis, analysis.machine
        self._options, self._progress = options, progress
        dialect = find_dialect(self.machine.dialect)
        if options.lead_program:
            require_lead(self.machine, dialect, analysis.path.axes)
        progress("planning the plain program")
        plain = CompensateOptions(strategy=PLAIN, start=options.start, max_slowdown=options.max_slowdown)
        plan = make_plan(analysis, plain.plan("program"), progress)
        progress("writing the plain program")
        self._made: Program = make_program(plan, analysis.track, dialect, options.writing)
        self.plan: Plan = replace(plan, warnings=tuple(dict.fromkeys((*plan.warnings, *self._made.warnings))))
        original = read_as(dialect.name, self._made.text.encode(), analysis.path.name)
        request = ProgramRequest(
            plan=replace(options.plan("program"), start="rest", allow_retrograde=False),
            edit=options.editing,
            noted=options.notes_in_header,
            said=self.plan.warnings,
            lead=options.lead_program,
        )
        path = None
        if options.lead_program:
            own = path_on_program(original, analysis.path, self._made)
            path = None if own is None else (own, analysis)
        self.edited: CompensatedProgram = compensate_program(original, self.machine, request, progress, path)

    @property
    def before(self) -> MotionResult:
        """The motion of the plain program."""
        return self._motions[0]

    @property
    def after(self) -> MotionResult:
        """The motion of the compensated program."""
        return self._motions[1]

    @cached_property
    def _motions(self) -> tuple[MotionResult, MotionResult]:
        return self.edited.run_on(self.machine, self._progress)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: what was reduced or not compensated, a sentence each."""
        return tuple(dict.fromkeys((*self.plan.warnings, *self.edited.warnings, *planner_notes(self.machine))))

    @cached_property
    def reversals(self) -> list[ProgramReversal]:
        """The reversals of the path, and what is done at each."""
        found = path_on_program(self.edited.before, self.analysis.path, self._made)
        if found is None:
            return program_reversals(self.edited, self.machine, self._options.tolerance)
        return path_reversals(self.edited, found, self.analysis)


def path_on_program(program: PartProgram, path: Path, made: Program) -> ProgramPath | None:
    """Return where on a path the motions of the program are that was made of it; None where one is missing.

    The program's approach, lifts and retreat are left out.

    Parameters
    ----------
    program : PartProgram
    path : Path
    made : Program
        Its joints are places of `path`.
    """
    columns = [AXES.index(name) for name in path.axes]
    start, end = (points[:, columns] for points in (program.motions.start, program.motions.end))
    goes = np.flatnonzero(np.diff(made.places) > 0.0)
    found: list[int] = []
    for k in range(program.motions.kind.size):
        if len(found) == goes.size:
            break
        begin, finish = made.joints[goes[len(found)]], made.joints[goes[len(found)] + 1]
        if max(np.abs(start[k] - begin).max(), np.abs(end[k] - finish).max()) <= SAME:
            found.append(k)
    if len(found) < goes.size or not found:
        return None
    motion = np.array(found, dtype=np.int32)
    s = np.append(made.places[goes], made.places[-1])
    return ProgramPath(path=path, chain=int(program.motions.chain[motion[0]]), motion=motion, s=s)
