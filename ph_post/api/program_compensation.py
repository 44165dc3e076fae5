"""Compensate a part program: only what has to change of it is changed."""

from __future__ import annotations

from copy import copy
from functools import cached_property

import msgspec

from ph_post.api.compensated_program import CompensatedProgram, ProgramRequest
from ph_post.api.expansion import expanded_job
from ph_post.api.further_axes import ShiftedJob, shifted_job
from ph_post.api.inputs import Source, machine_named, program_in, raw_job
from ph_post.api.options import CompensateOptions
from ph_post.api.outcomes import Compensation, left_words, passed_through, units_notes
from ph_post.api.path_compensation import PathCompensation, compensated_path
from ph_post.api.programs import compensate_program
from ph_post.api.results import AxisReversals, MotionResult, ProgramMotion
from ph_post.api.reversals import ProgramReversal, coarse_words, count_program_reversals, program_reversals
from ph_post.compensate.options import PlanOutput
from ph_post.dialects.planners import planner_notes
from ph_post.dialects.registry import find_dialect
from ph_post.drive.axes import gravity_notes
from ph_post.edit.preconditions import reckoned_feeds
from ph_post.files.storage import SourceBytes
from ph_post.gcode.program import PartProgram
from ph_post.progress import Progress
from ph_post.simulate.controllers.moves import moved_axes
from ph_post.types import Command, Machine
from ph_post.verify.verdict import Verdict


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
            lead=options.lead_program,
        )

    @cached_property
    def expansion(self) -> tuple[PartProgram | SourceBytes, tuple[str, ...]]:
        """The job, written out where that was asked for, and what has to be known of it."""
        return expanded_job(self._job, self.machine.dialect, self.options)

    @cached_property
    def shifted(self) -> ShiftedJob:
        """The job with its axes beside X, Y and Z compensated, as far as the machine has such, and its holes."""
        how = self.options
        return shifted_job(self.expansion[0], self.machine, self.request, strict=how.strict, holes=how.expand)

    @property
    def expanded(self) -> bool:
        """Return whether the program was written out."""
        return self.expansion[0] is not self._job

    @cached_property
    def edited(self) -> CompensatedProgram:
        """The program before and after, with the changes."""
        self.options.check_for_program()
        program = program_in(self.shifted.job, self.machine.dialect, strict=self.options.strict)
        found = compensate_program(program, self.machine, self.request, self._progress)
        return msgspec.structs.replace(found, before=self.shifted.told(found.before)) if found.done else found

    @property
    def original(self) -> PartProgram:
        """The original program, recovered where the job was compensated before."""
        return self.edited.before

    @property
    def unchanged(self) -> bool:
        """True where nothing had to change."""
        return self.edited.after.data == self.edited.before.data and not self.shifted.changed

    @property
    def already_compensated(self) -> bool:
        """True where the job was this very compensation already."""
        return self.edited.done or (self.shifted.done and self.unchanged)

    @property
    def verdict(self) -> Verdict | None:
        """Verdict of :func:`ph_post.verify` on the result; None where nothing was changed."""
        return self.edited.verdict

    @cached_property
    def _motions(self) -> tuple[MotionResult, MotionResult]:
        before, after = self.edited.run_on(self.machine, self._progress)
        original = self.shifted.original
        if original is not None and any(plan.added for plan in self.shifted.plans):
            # What axes beside X, Y and Z do more is in the program before, but not in the original.
            before = copy(before) if before is after else before
            plain = reckoned_feeds(original, self.machine)
            before.time = ProgramMotion(plain, plain, self.machine, "original", self._progress).time
        return before, after

    @property
    def before(self) -> MotionResult:
        """The plain motion, without compensation."""
        return self.longest.before if self.output == "table" else self._motions[0]

    @property
    def after(self) -> MotionResult:
        """The compensated motion."""
        return self.longest.after if self.output == "table" else self._motions[1]

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings: what was passed through, reduced or not compensated, a sentence each."""
        if self.output == "table":
            return self.longest.warnings
        said = (*gravity_notes(self.machine, moved_axes(self.original)), *planner_notes(self.machine))
        units = () if self.unchanged else units_notes(self.original, find_dialect(self.machine.dialect))
        found = (*self.expansion[1], *self.shifted.warnings, *self.edited.warnings, *units, *said)
        return tuple(dict.fromkeys(found))

    @property
    def axis_reversals(self) -> tuple[AxisReversals, ...]:
        """Numbers of reversals of every axis with backlash."""
        if self.output == "table":
            return self.longest.axis_reversals
        return self.shifted.with_reversals(count_program_reversals(self.places, self.machine))

    @property
    def not_compensated(self) -> str:
        """What is not compensated, why, and what would change that; empty where all is."""
        if self.output == "table":
            return self.longest.not_compensated
        return left_words(self.axis_reversals, self.reasons, self.passed_through, self.options.chosen_strategy)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why reversals of the program are not compensated, or not enough: sentences, with others among them."""
        return (*self.planned.warnings, *self.shifted.warnings, *coarse_words(self.places, self.planned.edits))

    @property
    def passed_through(self) -> tuple[str, ...]:
        """The stretches that are passed through, and what would help."""
        return passed_through(self.original, self.machine.dialect, expand=self.options.expand)

    @cached_property
    def planned(self) -> CompensatedProgram:
        """The program with its changes, found again where the job was compensated before."""
        if not self.edited.done:
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
