"""Compensate a part program, and verify the result before anyone gets it."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Sequence
from functools import cached_property
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.analysis.path_analysis import Analysis
from ph_post.api.guard import LEAST, ROUNDS, SLACK, compare_motions, otherwise, tightened, with_neighbours
from ph_post.api.led_programs import (
    CHORD_BLOCKS,
    HOLDS,
    LeadPlan,
    OverrideError,
    lead_note,
    override_errors,
    plan_lead,
    require_lead,
)
from ph_post.api.results import ProgramMotion
from ph_post.bounds import LONGEST_SIMULATED
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan_warnings import doubtful_values
from ph_post.compensate.strategies.registry import PLAIN, find_traits
from ph_post.dialects.base import Dialect
from ph_post.dialects.declaration import Declaration, line_origins, read_declaration
from ph_post.dialects.registry import find_dialect
from ph_post.drive.axes import check_axes, has_backlash
from ph_post.edit.changes import Change
from ph_post.edit.edits import EditOptions, Edits, merge_edits
from ph_post.edit.lead_edits import LABEL, LeadStretch, LeadWriter
from ph_post.edit.offset_edits import plan_offsets, section_words
from ph_post.edit.preconditions import require_tool
from ph_post.edit.reversals import section_spans
from ph_post.edit.undo import original_of
from ph_post.edit.window_plans import WindowEdits, WindowPlan, plan_windows, shifts_axes
from ph_post.edit.write import apply_changes, apply_edits, declare
from ph_post.errors import InputError, PhPostError
from ph_post.gcode.paths import FIT_TOLERANCE, ProgramPath, line_words, paths_of
from ph_post.gcode.program import RAPID, PartProgram
from ph_post.gcode.read import reread
from ph_post.post.options import check_block_time
from ph_post.progress import Progress, no_progress
from ph_post.simulate.controllers.path_modes import chord_warnings, path_mode_warnings
from ph_post.simulate.controllers.run import moved_axes
from ph_post.types import Machine, frozen
from ph_post.units import MM
from ph_post.verify.verdict import Verdict
from ph_post.verify.verify import verify
from ph_post.version import package_version

BOTH: Final = 2
"""Programs that are compared."""

SHOWN: Final = 3
"""Failures that the error names where a program does not pass its check."""

_LINE: Final = re.compile(r":(\d+)(?::\d+)?$")

NOTED: Final = 20
"""Warnings that the head of a program holds, where it is to hold them."""


class ProgramRequest(msgspec.Struct, frozen=True, kw_only=True):
    """A request to compensate a program.

    `plan` has the strategy and its limits, `edit` the options of what is written; with `force` a program that was
    compensated otherwise before is taken back to its original first. With `noted` the head of the program
    holds the warnings too, for those who see nothing but the program; `said` are such from before. With `lead` the
    lead of the servos is written into the path of the program; `lead_left` says that it was asked for and left out.
    """

    plan: PlanOptions
    edit: EditOptions
    force: bool = False
    noted: bool = False
    said: tuple[str, ...] = ()
    lead: bool = False
    lead_left: bool = False

    def digest(self, dialect: str) -> str:
        """Hash of all that decides what is written, but the program and the machine's own file."""
        edit = msgspec.json.decode(msgspec.json.encode(self.edit))
        del edit["cycle"], edit["largest_first"]
        for name in ("position_from", "overshoot", "part_side"):
            # Programs that were compensated before these options were known are still recognized.
            if not edit[name]:
                del edit[name]
        decided = [self.plan, edit, dialect, *(["lead"] if self.lead or self.lead_left else [])]
        return hashlib.sha256(msgspec.json.encode(decided)).hexdigest()


class CompensatedProgram(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A part program before and after.

    `before` is the original, recovered where the input was compensated before; `after` what is to be
    written, the same where nothing is changed. `declaration` is the one in its header, `edits` are the
    changes and `windows` the plans behind those of axes inside their loops; `verdict` is the checker's, None
    where nothing was changed. `done` says that the input was this very compensation already. `overrides` are the
    errors of a program with the lead of the servos at feed overrides.
    """

    before: PartProgram
    after: PartProgram
    declaration: Declaration | None = None
    edits: Edits | None = None
    windows: tuple[WindowPlan, ...] = ()
    verdict: Verdict | None = None
    motions: tuple[ProgramMotion, ProgramMotion] | None = None
    done: bool = False
    overrides: tuple[OverrideError, ...] = ()

    def run_on(self, machine: Machine, progress: Progress = no_progress) -> tuple[ProgramMotion, ProgramMotion]:
        """Return the motions before and after on models of controller and drives; one twice where nothing changed."""
        if self.motions is not None:
            return self.motions
        before = ProgramMotion(self.before, self.before, machine, "original", progress)
        if self.after.data == self.before.data:
            return before, before
        name, declared = "compensated program", self.declaration or read_declaration(self.after.data)
        if declared is not None and declared.led:
            return before, ProgramMotion(self.after, self.before, machine, name, progress, led=True)
        return before, ProgramMotion(self.after, self.before, machine, name, progress, before)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings, a sentence each; stretches that are passed through come first."""
        name, edits = self.before.name, () if self.edits is None else self.edits.warnings
        notes = self.before.notes
        lines = [f"{note.first + 1}" + (f" to {note.last + 1}" if note.last > note.first else "") for note in notes]
        passed = (
            f"{name}:{line}: {note.what}: passed through unchanged" for line, note in zip(lines, notes, strict=True)
        )
        return (*passed, *(_lead_notes(self.after) if self.done else ()), *edits)


def _lead_notes(program: PartProgram) -> tuple[str, ...]:
    """Return the notes in the head of a program that say at which feed override its lead holds."""
    declared = read_declaration(program.data)
    return () if declared is None else tuple(note for note in declared.notes if note.startswith(HOLDS))


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
    dialect.require_editable(program.name)
    check_block_time(request.edit.block_time, machine.servo_period)
    original = _original(program, machine, request)
    require_tool(original, machine)
    if original is not program and not request.force:
        return CompensatedProgram(before=original, after=program, done=True)
    check_axes(moved_axes(original), "program", machine, f"machine {machine.name}")
    if request.lead:
        return _best_lead(original, machine, request, progress, path)
    planner = _EditPlanner(original, machine, dialect, request, progress)
    before = ProgramMotion(original, original, machine, "original", progress)
    options = replace(request.edit, cycle=_cycle(before))
    paths_said = path_mode_warnings(original, machine, dialect)
    paths_said += chord_warnings(original, machine, dialect, options.tolerance)
    paths_said += doubtful_values(machine, moved_axes(original))
    return _PlanSearch(planner, before, request, tuple(paths_said), progress).run(options)


def _verified(
    original: PartProgram, after: PartProgram, request: ProgramRequest, machine: Machine
) -> tuple[Verdict | None, frozenset[int]]:
    """Check a program; None where a controller would refuse one of its lines, with the section of that line."""
    try:
        return verify(original, after, tolerance=request.edit.tolerance, machine=machine), frozenset()
    except InputError as error:
        place, origins = _LINE.search(error.where), line_origins(after, original)
        if place is None or origins is None or not 0 < int(place[1]) <= after.blocks:
            raise
        low, _ = section_spans(original.motions)
        motions = np.searchsorted(original.motions.block, np.int32(origins.first[int(place[1]) - 1]))
        return None, frozenset({max(int(np.searchsorted(low, motions, side="right")) - 1, 0)})


def _best_lead(
    program: PartProgram,
    machine: Machine,
    request: ProgramRequest,
    progress: Progress,
    path: tuple[ProgramPath, Analysis] | None,
) -> CompensatedProgram:
    """Return the program with the lead, by the strategy's plan or alone, or without it where the part is better so."""
    dialect = find_dialect(machine.dialect)
    found = _LeadWork(program, machine, dialect, request, progress).made(path)
    if find_traits(request.plan.strategy).chooses:
        alone = replace(request, plan=replace(request.plan, strategy=PLAIN))
        digest = request.digest(machine.dialect)
        found = _better(found, _LeadWork(program, machine, dialect, alone, progress, digest).made(path))
    if not _EditPlanner(program, machine, dialect, request, progress).offsets_axes:
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


class _LeadWork:
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
        asked, time = self._request.plan, _cycle(self._before)
        options, left = asked, frozenset[int]()
        plan = self._plan(options, time, path)
        for _ in range(ROUNDS):
            if not plan.stretches:
                break
            declared, after, verdict = self._written(plan)
            motion = self._motion(after)
            found = compare_motions(self._before, motion, 0.0)
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
        nothing = Edits(offset=frozen(np.zeros((self._program.motions.kind.size, 3))))
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
            Edits(offset=frozen(np.zeros((program.motions.kind.size, 3)))),
            self._machine,
            self._dialect,
            edit,
            options_digest=self._digest,
            notes=(*notes, *(_notes(program, (*self._request.said, *plan.warnings)) if self._request.noted else ())),
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
            raise _refusal(program.name, verdict)
        return declared, after, verdict

    def _result(
        self, plan: LeadPlan, declared: Declaration, after: PartProgram, verdict: Verdict, motion: ProgramMotion
    ) -> CompensatedProgram:
        self._progress("running it at other feed overrides")
        errors = override_errors(self._program, after, self._machine) if _cycle(motion) <= LONGEST_SIMULATED else ()
        if errors:
            declared, after, verdict = self._written(plan, (lead_note(errors),))
        edits = Edits(offset=frozen(np.zeros((self._program.motions.kind.size, 3))))
        bare = reread(self._program, apply_changes(self._program, self._changes(plan.free), self._dialect, declared))
        plain = ProgramMotion(bare, self._program, self._machine, "program with the lead alone", self._progress)
        motion = self._motion(after, plain)
        return CompensatedProgram(
            before=self._program,
            after=after,
            declaration=declared,
            edits=replace(edits, warnings=(lead_note(errors) if errors else HOLDS, *plan.warnings)),
            windows=plan.plans,
            verdict=verdict,
            motions=(self._before, motion),
            overrides=errors,
        )


def _cycle(motion: ProgramMotion) -> float:
    """Return the time of a program on its controller [s], 0 where it is not known."""
    try:
        return motion.time
    except (PhPostError, MemoryError):
        return 0.0


def _nothing_gained(program: PartProgram, edits: Edits) -> Edits:
    """Return no edits, with the reason why those that were planned are not written."""
    nothing = Edits(offset=frozen(np.zeros((program.motions.kind.size, 3))))
    said = "not compensated: no plan within the time allowed makes the part better; a larger --max-slowdown may"
    return replace(nothing, warnings=(*edits.warnings, said))


def _original(program: PartProgram, machine: Machine, request: ProgramRequest) -> PartProgram:
    """Return the program before any compensation: the input itself where there was none."""
    found = read_declaration(program.data)
    if found is None:
        return program
    asked = (package_version(), machine.digest, request.digest(machine.dialect))
    had = (found.version, found.machine_digest, found.options_digest)
    same = had[0] == asked[0] and all(new.startswith(old) for old, new in zip(had, asked, strict=True))
    if not same and not request.force:
        raise InputError(
            program.name,
            f"compensated before, by ph-post {found.version} for {found.machine}",
            expected="the original, or --force to begin again from it, or --undo",
        )
    return original_of(program) or program


class _EditPlanner:
    """Plans the offsets of axes with backlash outside the loop, and the windows of the others, which stay.

    They share the time allowed by the number of their axes.
    """

    def __init__(
        self, program: PartProgram, machine: Machine, dialect: Dialect, request: ProgramRequest, progress: Progress
    ) -> None:
        self._program, self.machine, self.dialect = program, machine, dialect
        self._request, self._progress = request, progress
        loops = [machine.axes[name].loop for name in moved_axes(program) if has_backlash(machine.axes[name])]
        if not find_traits(request.plan.strategy).compensates:
            loops = []
        behind = sum(not loop.encloses_backlash for loop in loops) if shifts_axes(request.plan) else 0
        self.offsets_axes = behind > 0
        self._share = behind / max(len(loops), 1)
        self._has_windows = behind < len(loops)

    @cached_property
    def _window_edits(self) -> WindowEdits | None:
        if not self._has_windows:
            return None
        self._progress("fitting the path")
        edit, plan = self._request.edit, self._request.plan
        return plan_windows(
            self._program,
            paths_of(self._program),
            self.machine,
            replace(plan, max_slowdown=plan.max_slowdown * (1.0 - self._share)),
            edit.tolerance,
            self._progress,
            edit.block_time,
        )

    @property
    def windows(self) -> tuple[WindowPlan, ...]:
        """The plans of axes with backlash inside the loop."""
        return () if self._window_edits is None else self._window_edits.plans

    def plan(self, options: EditOptions) -> Edits:
        """Return the edits; `options` bound those of the offsets."""
        edits = Edits(offset=frozen(np.zeros((self._program.motions.kind.size, 3))))
        if self.offsets_axes:
            self._progress("planning offsets")
            share = replace(options, max_slowdown=options.max_slowdown * self._share)
            edits = plan_offsets(self._program, self.machine, self.dialect, share)
        return edits if self._window_edits is None else merge_edits(edits, self._window_edits.edits)


class _PlanSearch:
    """Plans, writes and judges a program until it is good, and once more, otherwise, where the time was short.

    Parameters
    ----------
    planner : _EditPlanner
    before : ProgramMotion
        Of the original.
    request : ProgramRequest
    warnings : tuple of str
        Said of every plan.
    progress : Progress
    """

    def __init__(
        self,
        planner: _EditPlanner,
        before: ProgramMotion,
        request: ProgramRequest,
        warnings: tuple[str, ...],
        progress: Progress,
    ) -> None:
        self._planner, self._before, self._request = planner, before, request
        self._warnings, self._progress = warnings, progress
        self._original = before.original
        self._count = section_spans(self._original.motions)[0].size
        self._said: tuple[str, ...] = ()
        self._best: CompensatedProgram | None = None
        self._rms = 0.0

    def run(self, options: EditOptions) -> CompensatedProgram:
        """Return the best plan; the program itself where none is good."""
        for _ in range(ROUNDS):
            edits = self._planner.plan(options)
            edits = replace(edits, warnings=(*edits.warnings, *self._warnings))
            if edits.empty:
                break
            again = self._judge(*self._written(edits), options)
            if again is None:
                break
            options = again
        if self._best is not None:
            return self._best
        original = self._original
        said = replace(edits, warnings=(*edits.warnings, *self._said))
        edits = said if edits.empty else _nothing_gained(original, edits)
        return CompensatedProgram(before=original, after=original, edits=edits, windows=self._planner.windows)

    def _written(self, edits: Edits) -> tuple[CompensatedProgram, frozenset[int]]:
        """Write a plan, and check it: with no verdict the sections are known whose lines no controller would take."""
        original, request, planner = self._original, self._request, self._planner
        self._progress("writing")
        declaration = _declaration(original, edits, planner.machine, planner.dialect, request)
        data = apply_edits(original, edits, planner.dialect, declaration)
        self._progress("verifying")
        after = reread(original, data)
        verdict, refused = _verified(original, after, request, planner.machine)
        motion = ProgramMotion(after, original, planner.machine, "compensated program", self._progress, self._before)
        made = CompensatedProgram(
            before=original,
            after=after,
            declaration=declaration,
            edits=replace(edits, warnings=(*edits.warnings, *self._said)),
            windows=planner.windows,
            verdict=verdict,
            motions=(self._before, motion),
        )
        return made, refused

    def _judge(self, made: CompensatedProgram, refused: frozenset[int], options: EditOptions) -> EditOptions | None:
        """Keep a plan that is good, and better than the one before it; return the options of another to be tried."""
        assert made.edits is not None
        assert made.motions is not None
        if made.verdict is None or not made.verdict.ok:
            return None if self._best is not None else self._without_failed(made, refused, options)
        judged = compare_motions(*made.motions, made.edits.slowdown) if self._planner.offsets_axes else None
        if judged is None:
            self._best = self._best or made
            return None
        allowed = self._request.edit.max_slowdown
        tighter = tightened(options, judged, allowed, self._count)
        if self._best is not None:
            self._best = made if tighter is None and judged.rms < self._rms else self._best
            return None
        if tighter is not None:
            if tighter.left:
                where = section_words(self._original, tighter.left)
                self._said = (f"not compensated in {where}: the part would be no better",)
            return tighter
        self._best, self._rms = made, judged.rms
        return otherwise(options, judged, allowed) if made.edits.short else None

    def _without_failed(self, made: CompensatedProgram, refused: frozenset[int], options: EditOptions) -> EditOptions:
        """Leave what does not pass the check as it is."""
        verdict = made.verdict
        sections = refused if verdict is None else _failed_sections(self._original, made.after, verdict)
        failed = with_neighbours(sections, options.left, self._count) - options.left
        if not failed and verdict is not None:
            raise _refusal(self._original.name, verdict)
        failed = failed or frozenset(range(self._count)) - options.left
        options = replace(options, left=options.left | failed)
        where = section_words(self._original, options.left)
        self._said = (f"not compensated in {where}: a change would not pass the check",)
        return options


def _declaration(
    program: PartProgram, edits: Edits, machine: Machine, dialect: Dialect, request: ProgramRequest
) -> Declaration:
    path_mode = dialect.syntax.path_mode
    mode = path_mode(request.edit.chord_tolerance) if edits.dips and path_mode is not None else ""
    return declare(
        program,
        edits,
        machine,
        dialect,
        request.edit,
        options_digest=request.digest(machine.dialect),
        path_mode=mode,
        notes=(
            *_side_notes(request.edit),
            *(_notes(program, (*request.said, *edits.warnings)) if request.noted else ()),
        ),
    )


def _side_notes(options: EditOptions) -> tuple[str, ...]:
    """Say in the head of a program on which side of the path the part was said to be."""
    side = {1: "left", -1: "right"}.get(options.part_side)
    return () if side is None else (f"the part is on the {side} of the path",)


def _notes(program: PartProgram, warnings: Sequence[str]) -> tuple[str, ...]:
    """Warnings for the head of a program; beyond the first ones their number."""
    passed = (f"{line_words(note.first, note.last)}: {note.what}: passed through unchanged" for note in program.notes)
    words = [f"warning: {word}" for word in (*passed, *warnings)]
    more = [f"{len(words) - NOTED} more warnings"] if len(words) > NOTED else []
    return (*words[:NOTED], *more)


def _failed_sections(program: PartProgram, after: PartProgram, verdict: Verdict) -> frozenset[int]:
    """Return the sections in which a checker found a failure, all where it lists but some of its failures.

    None are returned where a failure is not within the lines of a section: leaving any alone would not mend that.
    """
    motions = program.motions
    low, _ = section_spans(motions)
    rapids, of_after = (np.flatnonzero(one.motions.kind == RAPID) for one in (program, after))
    found: set[int] = set()
    for one in verdict.failures:
        if one.original is None and one.compensated is not None and rapids.size == of_after.size:
            # Rapids stand for each other one to one: the failure is between two of them.
            ahead = int(np.searchsorted(after.motions.block[of_after], one.compensated - 1, side="right"))
            beside = np.clip([ahead - 1, ahead], 0, max(rapids.size - 1, 0))
            places = rapids[beside] if rapids.size else np.zeros(1, dtype=np.int64)
        else:
            line = -1 if one.original is None else one.original - 1
            last = int(np.searchsorted(motions.block, line, side="right")) - 1
            behind = int(np.searchsorted(motions.block, line))
            if last < 0 or behind == motions.block.size or motions.chain[last] != motions.chain[behind]:
                return frozenset()
            places = np.array([last, behind])
        found.update((np.searchsorted(low, places, side="right") - 1).tolist())
    return frozenset(range(low.size) if verdict.found > len(verdict.failures) else found)


def _refusal(name: str, verdict: Verdict) -> PhPostError:
    first = "; ".join(one.sentence() for one in verdict.failures[:SHOWN])
    more = f" and {verdict.found - SHOWN} more" if verdict.found > SHOWN else ""
    return PhPostError(
        f"{name}: the compensated program does not pass its own check, and is not written: {first}{more}"
    )
