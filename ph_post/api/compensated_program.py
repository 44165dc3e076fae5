"""A request to compensate a part program, and the program that comes of it."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Final

import msgspec

from ph_post.api.led_programs import (
    CHORDS_HOLD,
    HOLDS,
    OverrideError,
)
from ph_post.api.results import ProgramMotion
from ph_post.compensate.options import PlanOptions
from ph_post.dialects.base import Dialect
from ph_post.dialects.declaration import CORRECTED, THREADS, Declaration, read_declaration
from ph_post.edit.edits import EditOptions, Edits
from ph_post.edit.preconditions import reckoned_feeds
from ph_post.edit.window_plans import WindowPlan
from ph_post.edit.write import declare
from ph_post.errors import PhPostError
from ph_post.files.check import counted
from ph_post.gcode.paths import ProgramPath
from ph_post.gcode.program import Note, PartProgram
from ph_post.progress import Progress, no_progress
from ph_post.types import Machine
from ph_post.verify.verdict import Verdict

SHOWN: Final = 3
"""Failures that the error names where a program does not pass its check."""

NOTED: Final = 20
"""Warnings that the head of a program holds, where it is to hold them, and places that are named of one cause."""

LISTED: Final = 60
"""Places that are named of all that is passed through: of more nobody reads any."""


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
        plan, edit = (msgspec.json.decode(msgspec.json.encode(one)) for one in (self.plan, self.edit))
        # What only tables have decides nothing here, nor does what the runs of one plan say for the next.
        del plan["pushes_first"]
        for name in ("cycle", "pace", "largest_first", "stretches", "in_parts", "plain_corners", "halts"):
            del edit[name]
        for name in ("position_from", "overshoot", "part_side"):
            # Programs that were compensated before these options were known are still recognized.
            if not edit[name]:
                del edit[name]
        decided = [plan, edit, dialect, *(["lead"] if self.lead or self.lead_left else [])]
        return hashlib.sha256(msgspec.json.encode(decided)).hexdigest()


class CompensatedProgram(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A part program before and after.

    `before` is the original, recovered where the input was compensated before; `after` what is to be
    written, the same where nothing is changed. `declaration` is the one in its header, `edits` are the
    changes and `windows` the plans behind those of axes inside their loops; `paths` are the original's, None where they
    were not fitted yet; `verdict` is the checker's, None where nothing was changed. `done` says that the input was this
    very compensation already. `overrides` are the errors of a program with the lead of the servos at feed overrides.
    """

    before: PartProgram
    after: PartProgram
    declaration: Declaration | None = None
    edits: Edits | None = None
    windows: tuple[WindowPlan, ...] = ()
    paths: tuple[ProgramPath, ...] | None = None
    verdict: Verdict | None = None
    motions: tuple[ProgramMotion, ProgramMotion] | None = None
    done: bool = False
    overrides: tuple[OverrideError, ...] = ()

    def run_on(self, machine: Machine, progress: Progress = no_progress) -> tuple[ProgramMotion, ProgramMotion]:
        """Return the motions before and after on models of controller and drives; one twice where nothing changed."""
        if self.motions is not None:
            return self.motions
        plain, made = (reckoned_feeds(program, machine) for program in (self.before, self.after))
        before = ProgramMotion(plain, plain, machine, "original", progress)
        if self.after.data == self.before.data:
            return before, before
        name, declared = "compensated program", self.declaration or read_declaration(self.after.data)
        if declared is not None and declared.led:
            return before, ProgramMotion(made, plain, machine, name, progress, led=True)
        return before, ProgramMotion(made, plain, machine, name, progress, before)

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings, a sentence each; stretches that are passed through come first, of each cause the first ones."""
        edits = () if self.edits is None else self.edits.warnings
        return (*_passed(self.before), *(_lead_notes(self.after) if self.done else ()), *edits)


def _passed(program: PartProgram) -> Iterator[str]:
    """Name the stretches that are passed through; of one cause a program may have thousands."""
    name, notes = program.name, program.notes
    whole, named = Counter(_cause(note) for note in notes), Counter[str]()
    # Each cause has as many places as all may have; where there are too many causes, the first ones have one each.
    most = next((k for k in range(NOTED, 1, -1) if sum(min(number, k) for number in whole.values()) <= LISTED), 1)
    for note in notes:
        cause = _cause(note)
        if named[cause] < most and named.total() < LISTED:
            named[cause] += 1
            first, last = program.line_range(note.first, note.last)
            lines = f"{first}" + (f" to {last}" if last > first else "")
            yield f"{name}:{lines}: {note.what}: passed through unchanged"
    for cause, number in named.items():
        if more := whole[cause] - number:
            yield f"{name}: {cause} in {more:,} more place{'s' if more > 1 else ''}: passed through unchanged"
    others = [number for cause, number in whole.items() if cause not in named]
    if others:
        places, causes = counted(sum(others), "more place"), counted(len(others), "other cause")
        yield f"{name}: {places} of {causes}: passed through unchanged"


def _cause(note: Note) -> str:
    return note.what.partition(":")[0]


def _lead_notes(program: PartProgram) -> tuple[str, ...]:
    """Return the notes in the head of a program that say at which feed override its lead holds."""
    declared = read_declaration(program.data)
    return () if declared is None else tuple(note for note in declared.notes if note.startswith((HOLDS, CHORDS_HOLD)))


def cycle_time(motion: ProgramMotion) -> float:
    """Return the time of a program on its controller [s], 0 where it is not known."""
    try:
        return motion.time
    except (PhPostError, MemoryError):
        return 0.0


def head_notes(program: PartProgram, warnings: Sequence[str]) -> tuple[str, ...]:
    """Warnings for the head of a program; beyond the first ones their number."""
    passed = (
        f"{program.line_words(note.first, note.last)}: {note.what}: passed through unchanged" for note in program.notes
    )
    words = [f"warning: {word}" for word in (*passed, *warnings)]
    more = [f"{len(words) - NOTED} more warnings"] if len(words) > NOTED else []
    return (*words[:NOTED], *more)


def declaration_of(
    program: PartProgram, edits: Edits, machine: Machine, dialect: Dialect, request: ProgramRequest
) -> Declaration:
    """Return what the head of a program says of the edits that it was compensated by."""
    path_mode = dialect.syntax.path_mode
    rounding = request.edit.chord_tolerance if edits.dips else edits.rounding
    mode = path_mode(rounding) if rounding > 0.0 and path_mode is not None else ""
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
            *(word for word in edits.warnings if word.startswith((CORRECTED, THREADS))),
            *(head_notes(program, (*request.said, *edits.warnings)) if request.noted else ()),
        ),
    )


def _side_notes(options: EditOptions) -> tuple[str, ...]:
    """Say in the head of a program on which side of the path the part was said to be."""
    side = {1: "left", -1: "right"}.get(options.part_side)
    return () if side is None else (f"the part is on the {side} of the path",)


def refusal(name: str, verdict: Verdict) -> PhPostError:
    """Return the error of a program that does not pass its check."""
    first = "; ".join(one.sentence() for one in verdict.failures[:SHOWN])
    more = f" and {verdict.found - SHOWN} more" if verdict.found > SHOWN else ""
    return PhPostError(
        f"{name}: the compensated program does not pass its own check, and is not written: {first}{more}"
    )
