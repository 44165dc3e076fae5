"""Compensate a path: by a plan of its own for each output, or a program that crosses backlash on the fly."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property

import msgspec

from ph_post.analysis.path_analysis import Analysis
from ph_post.api.crossed_paths import CrossedPath, crosses_on_the_fly
from ph_post.api.inputs import Source, analysed_job, machine_warnings
from ph_post.api.options import CompensateOptions
from ph_post.api.outcomes import Compensation, left_words
from ph_post.api.results import AxisReversals, MotionResult, PlannedMotion, plan_reversals
from ph_post.api.reversals import coarse_words
from ph_post.compensate.motion import without_strategy
from ph_post.compensate.offsets import lead_in
from ph_post.compensate.options import PlanOutput
from ph_post.compensate.plan import make_plan
from ph_post.compensate.standstill import standstill_warning
from ph_post.compensate.strategies.registry import find_traits
from ph_post.dialects.registry import find_dialect
from ph_post.errors import InputError
from ph_post.files.storage import SourceBytes
from ph_post.post.moves import check_jogs, read_jogs
from ph_post.post.program import make_program
from ph_post.progress import Progress
from ph_post.types import Command, Machine, Path, Plan, frozen


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
        if analysis.machine is None:
            raise InputError("", "a plan needs a machine")
        self.analysis, self.machine, self.options, self.output = analysis, analysis.machine, options, output
        self.notes = notes
        self._progress = progress
        self._plans: dict[PlanOutput, Plan] = {}
        self._texts: dict[PlanOutput, bytes] = {}
        self._motions: dict[PlanOutput, PlannedMotion] = {}
        self._written: set[PlanOutput] = set()
        plan = self.plan(output)
        self._plans[output] = with_warnings(
            plan, *analysis.path.remarks, *machine_warnings(self.machine, analysis.path.axes)
        )

    @cached_property
    def crossed(self) -> CrossedPath | None:
        """The program of the path where it crosses backlash on the fly; None where it is that of its plan."""
        if not crosses_on_the_fly(self.analysis.path.axes, self.machine, self.options):
            return None
        try:
            return CrossedPath(self.analysis, self.options, self._progress)
        except InputError as error:
            if not find_traits(self.options.chosen_strategy).chooses or error.where != "--dialect":
                raise
            return None

    def crossed_for(self, output: PlanOutput) -> CrossedPath | None:
        """Return :attr:`crossed` where that is what an output is."""
        return self.crossed if output == "program" else None

    @property
    def plans(self) -> Mapping[PlanOutput, Plan]:
        """The plans that were made so far, by output, with their warnings."""
        return self._plans

    def plan(self, output: PlanOutput) -> Plan:
        """Return the plan for an output; of a program that crosses on the fly the plain one, which it is made of."""
        if output not in self._plans and (crossed := self.crossed_for(output)) is not None:
            self._plans[output] = msgspec.structs.replace(crossed.plan, warnings=crossed.warnings)
        if output not in self._plans:
            self._progress(f"planning the {output}")
            found = make_plan(self.analysis, self.options.plan(output), self._progress)
            if output == "program" and find_traits(found.strategy).chooses:
                found = self._writable(found)
            said = standstill_warning(found, self.analysis.track)
            self._plans[output] = with_warnings(found, said) if said else found
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

    def planned(self, output: PlanOutput) -> PlannedMotion:
        """Return the motion of the plan for an output."""
        if output not in self._motions:
            self._motions[output] = PlannedMotion(self.analysis, self.plan(output))
        return self._motions[output]

    def motions(self, output: PlanOutput) -> tuple[MotionResult, MotionResult]:
        """Return the plain and the compensated motion of an output."""
        crossed = self.crossed_for(output)
        if crossed is not None:
            return crossed.before, crossed.after
        return PlannedMotion(self.analysis, without_strategy(self.plan(output))), self.planned(output)

    @cached_property
    def before(self) -> MotionResult:
        """The plain motion, without compensation."""
        return self.motions(self.output)[0]

    @property
    def after(self) -> MotionResult:
        """The compensated motion."""
        return self.motions(self.output)[1]

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

    @property
    def not_compensated(self) -> str:
        """What is not compensated, why, and what would change that; empty where all is."""
        return left_words(self.axis_reversals, self.reasons(self.output), self.notes, self.options.chosen_strategy)

    def reasons(self, output: PlanOutput) -> tuple[str, ...]:
        """Say why reversals are not compensated in an output, or not enough: sentences, with others among them."""
        crossed = self.crossed_for(output)
        coarse = [] if crossed is None else coarse_words(crossed.reversals, crossed.edited.edits)
        return (*self.plan(output).warnings, *coarse)

    def count(self, output: PlanOutput) -> tuple[AxisReversals, ...]:
        """Count the reversals in the plan of an output by axis; none is at the rest with which a motion begins."""
        crossed = self.crossed_for(output)
        done = None if crossed is None else {one.point.index for one in crossed.reversals if one.compensated}
        return plan_reversals(self.analysis.track, self.plan(output), done)

    def program(self) -> bytes:
        """Return the compensated part program."""
        if "program" not in self._texts and self.crossed is not None:
            self.plan("program")
            self._texts["program"] = self.crossed.edited.after.data
            self._compare("program")
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
        rows = self.planned("table")
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
        crosses = bool(program.crossings) or self.crossed is not None
        held += ["crossings of the backlash"] if table.crossings and not crosses else []
        if held:
            caveat = f"the program cannot carry the {' and '.join(held)} of the table"
            self._plans["program"] = with_warnings(program, caveat)


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
    analysis, notes = analysed_job(job, machine, options, progress)
    return PathCompensation(analysis, notes, options, output, progress)
