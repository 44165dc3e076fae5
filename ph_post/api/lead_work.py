"""Write a planned lead into a program, run it, and keep what makes the part better."""

from __future__ import annotations

from collections.abc import Sequence

from msgspec.structs import replace

from ph_post.analysis.path_analysis import Analysis
from ph_post.api.compensated_program import CompensatedProgram, ProgramRequest, cycle_time, head_notes, refusal
from ph_post.api.guard import ROUNDS, SLACK, Guard, with_neighbours
from ph_post.api.led_programs import (
    CHORD_BLOCKS,
    LeadPlan,
    lead_note,
    override_errors,
    plan_lead,
)
from ph_post.api.results import ProgramMotion
from ph_post.bounds import LONGEST_SIMULATED
from ph_post.compensate.options import PlanOptions
from ph_post.dialects.base import Dialect
from ph_post.dialects.declaration import Declaration
from ph_post.edit.changes import Change
from ph_post.edit.edits import Edits, no_offsets
from ph_post.edit.lead_edits import LABEL, LeadStretch, LeadWriter
from ph_post.edit.reversals import section_spans
from ph_post.edit.write import apply_changes, declare
from ph_post.gcode.paths import FIT_TOLERANCE, ProgramPath
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import reread
from ph_post.progress import Progress
from ph_post.types import Machine
from ph_post.units import MM
from ph_post.verify.verdict import Verdict
from ph_post.verify.verify import verify


class LeadWork:
    """Writes the lead of the servos into a program, and keeps what makes the part better."""

    def __init__(
        self,
        program: PartProgram,
        machine: Machine,
        dialect: Dialect,
        request: ProgramRequest,
        progress: Progress,
        digest: str = "",
    ) -> None:
        self._program, self._machine, self._dialect = program, machine, dialect
        self._request, self._progress = request, progress
        self._digest = digest or request.digest(machine.dialect)
        self._low = section_spans(program.motions)[0]
        self._before = ProgramMotion(program, program, machine, "original", progress)

    def made(self, path: tuple[ProgramPath, Analysis] | None) -> CompensatedProgram:
        """Return the program with the lead; `path` is the one of which it was made, None for its own."""
        asked, time = self._request.plan, cycle_time(self._before)
        options, left = asked, frozenset[int]()
        guard = Guard(self._before)
        plan = self._plan(options, time, path)
        for _ in range(ROUNDS):
            if not plan.stretches:
                break
            declared, after, verdict = self._written(plan)
            motion = self._motion(after)
            found = guard.compare(motion, 0.0)
            over = 0.0 if found is None else found.slowdown - asked.max_slowdown
            if over > SLACK and options.max_slowdown > 0.0:
                options = replace(options, max_slowdown=max(options.max_slowdown - over - SLACK, 0.0))
                plan = self._plan(options, time, path).leaving(left, self._low)
                continue
            worse = frozenset(range(self._low.size)) if over > SLACK else frozenset() if found is None else found.worse
            if not worse:
                return self._result(plan, declared, after, verdict, motion)
            left = left | with_neighbours(worse, left, self._low.size)
            plan = plan.leaving(left, self._low)
        nothing = Edits(runs=no_offsets(self._program.motions.kind.size))
        said = "no lead is written: none within the time allowed makes the part better"
        edits = replace(nothing, warnings=(*plan.warnings, said))
        return CompensatedProgram(before=self._program, after=self._program, edits=edits)

    def _plan(self, options: PlanOptions, time: float, path: tuple[ProgramPath, Analysis] | None) -> LeadPlan:
        tolerance = self._request.edit.tolerance
        return plan_lead(self._program, self._machine, options, tolerance, time, path, self._progress)

    def _motion(self, after: PartProgram, plain: ProgramMotion | None = None) -> ProgramMotion:
        name = "program with the lead"
        return ProgramMotion(after, self._program, self._machine, name, self._progress, plain, led=True)

    def _changes(self, stretches: Sequence[LeadStretch]) -> list[Change]:
        edit = self._request.edit
        longest = CHORD_BLOCKS * edit.block_time
        writer = LeadWriter(self._program, self._dialect, edit.chord_tolerance, edit.block_time, longest)
        return list(writer.changes(stretches))

    def _written(self, plan: LeadPlan, notes: tuple[str, ...] = ()) -> tuple[Declaration, PartProgram, Verdict]:
        """Write a plan, and verify it."""
        program, edit = self._program, self._request.edit
        self._progress("writing")
        declared = declare(
            program,
            Edits(runs=no_offsets(program.motions.kind.size)),
            self._machine,
            self._dialect,
            edit,
            options_digest=self._digest,
            notes=(
                *notes,
                *(head_notes(program, (*self._request.said, *plan.warnings)) if self._request.noted else ()),
            ),
        )
        changes = self._changes(plan.stretches)
        asked = [one.pause for one in plan.stretches for _ in range(one.pauses)]
        pauses = [self._dialect.syntax.dwell.written(one, self._dialect.numbers.feed_digits) for one in asked]
        declared = replace(
            declared,
            stops=len(pauses),
            led=sum(LABEL in change.label for change in changes),
            lead=plan.reach + FIT_TOLERANCE + 2.0 * edit.chord_tolerance + MM * 10.0**-declared.decimals,
            dwell=min(pauses, default=0.0),
            longest=max(pauses, default=0.0),
            dwelt=sum(pauses),
        )
        data = apply_changes(program, changes, self._dialect, declared)
        self._progress("verifying")
        after = reread(program, data)
        verdict = verify(program, after, tolerance=edit.tolerance, machine=self._machine)
        if not verdict.ok:
            raise refusal(program.name, verdict)
        return declared, after, verdict

    def _result(
        self, plan: LeadPlan, declared: Declaration, after: PartProgram, verdict: Verdict, motion: ProgramMotion
    ) -> CompensatedProgram:
        self._progress("running it at other feed overrides")
        errors = override_errors(self._program, after, self._machine) if cycle_time(motion) <= LONGEST_SIMULATED else ()
        note = lead_note(errors, plan.holds)
        declared, after, verdict = self._written(plan, (note,))
        edits = Edits(runs=no_offsets(self._program.motions.kind.size))
        bare = reread(self._program, apply_changes(self._program, self._changes(plan.free), self._dialect, declared))
        plain = ProgramMotion(bare, self._program, self._machine, "program with the lead alone", self._progress)
        motion = self._motion(after, plain)
        return CompensatedProgram(
            before=self._program,
            after=after,
            declaration=declared,
            edits=replace(edits, warnings=(note, *plan.warnings)),
            windows=plan.plans,
            verdict=verdict,
            motions=(self._before, motion),
            overrides=errors,
        )
