"""Compensate a part program, and verify the result before anyone gets it."""

from __future__ import annotations

import hashlib
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.compensate.options import PlanOptions
from ph_post.compensate.strategies.registry import find_traits
from ph_post.dialects.base import Dialect
from ph_post.dialects.declaration import Declaration, read_declaration
from ph_post.dialects.registry import find_dialect
from ph_post.drive.axes import check_axes, has_backlash
from ph_post.edit.edits import EditOptions, Edits, merge_edits
from ph_post.edit.offset_edits import plan_offsets
from ph_post.edit.undo import original_of
from ph_post.edit.window_plans import WindowPlan, plan_windows, shifts_axes
from ph_post.edit.write import apply_edits, declare
from ph_post.errors import InputError, PhPostError
from ph_post.gcode.paths import line_words, paths_of
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import reread
from ph_post.post.options import check_block_time
from ph_post.progress import Progress, no_progress
from ph_post.simulate.controllers.path_modes import path_mode_warnings
from ph_post.simulate.controllers.run import moved_axes
from ph_post.types import Machine, frozen
from ph_post.verify.verdict import Verdict
from ph_post.verify.verify import verify
from ph_post.version import package_version

SHOWN: Final = 3
"""Failures that the error names where a program does not pass its check."""

NOTED: Final = 20
"""Warnings that the head of a program holds, where it is to hold them."""


class ProgramRequest(msgspec.Struct, frozen=True, kw_only=True):
    """A request to compensate a program.

    `plan` has the strategy and its limits, `edit` the options of what is written; with `force` a program that was
    compensated otherwise before is taken back to its original first. With `noted` the head of the program
    holds the warnings too, for those who see nothing but the program.
    """

    plan: PlanOptions
    edit: EditOptions
    force: bool = False
    noted: bool = False

    def digest(self, dialect: str) -> str:
        """Hash of all that decides what is written, but the program and the machine's own file."""
        return hashlib.sha256(msgspec.json.encode([self.plan, self.edit, dialect])).hexdigest()


class CompensatedProgram(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A part program before and after.

    `before` is the original, recovered where the input was compensated before; `after` what is to be
    written, the same where nothing is changed. `declaration` is the one in its header, `edits` are the
    changes and `windows` the plans behind those of axes inside their loops; `verdict` is the checker's, None
    where nothing was changed. `done` says that the input was this very compensation already.
    """

    before: PartProgram
    after: PartProgram
    declaration: Declaration | None = None
    edits: Edits | None = None
    windows: tuple[WindowPlan, ...] = ()
    verdict: Verdict | None = None
    done: bool = False

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings, a sentence each; stretches that are passed through come first."""
        name, edits = self.before.name, () if self.edits is None else self.edits.warnings
        notes = self.before.notes
        lines = [f"{note.first + 1}" + (f" to {note.last + 1}" if note.last > note.first else "") for note in notes]
        passed = (
            f"{name}:{line}: {note.what}: passed through unchanged" for line, note in zip(lines, notes, strict=True)
        )
        return (*passed, *edits)


def compensate_program(
    program: PartProgram, machine: Machine, request: ProgramRequest, progress: Progress = no_progress
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
    dialect.require_editable(program.name)
    check_block_time(request.edit.block_time, machine.servo_period)
    original = _original(program, machine, request)
    if original is not program and not request.force:
        return CompensatedProgram(before=original, after=program, done=True)
    check_axes(moved_axes(original), "program", machine, f"machine {machine.name}")
    edits, windows = _plan(original, machine, dialect, request, progress)
    edits = replace(edits, warnings=(*edits.warnings, *path_mode_warnings(original, machine, dialect)))
    if edits.empty:
        return CompensatedProgram(before=original, after=original, edits=edits, windows=windows)
    progress("writing")
    declaration = _declaration(original, edits, machine, dialect, request)
    data = apply_edits(original, edits, dialect, declaration)
    progress("verifying")
    after = reread(original, data)
    verdict = verify(original, after, tolerance=request.edit.tolerance, machine=machine)
    if not verdict.ok:
        raise _refusal(original.name, verdict)
    return CompensatedProgram(
        before=original, after=after, declaration=declaration, edits=edits, windows=windows, verdict=verdict
    )


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


def _plan(
    program: PartProgram, machine: Machine, dialect: Dialect, request: ProgramRequest, progress: Progress
) -> tuple[Edits, tuple[WindowPlan, ...]]:
    """Plan the offsets of axes with backlash outside the loop, then the windows of the others.

    They share the time allowed by the number of their axes.
    """
    offsets = Edits(offset=frozen(np.zeros((program.motions.kind.size, 3))))
    if not find_traits(request.plan.strategy).compensates:
        return offsets, ()
    drives = [machine.axes[name] for name in moved_axes(program)]
    gaps = [axis.loop for axis in drives if has_backlash(axis)]
    behind = sum(not loop.encloses_backlash for loop in gaps) if shifts_axes(request.plan) else 0
    if behind:
        progress("planning offsets")
        share = request.edit.max_slowdown * behind / len(gaps)
        options = replace(request.edit, max_slowdown=share)
        offsets = plan_offsets(program, machine, dialect, options)
    if behind == len(gaps):
        return offsets, ()
    share = request.plan.max_slowdown * (1.0 - behind / len(gaps))
    progress("fitting the path")
    found = plan_windows(
        program,
        paths_of(program),
        machine,
        replace(request.plan, max_slowdown=share),
        request.edit.tolerance,
        progress,
        request.edit.block_time,
    )
    return merge_edits(offsets, found.edits), found.plans


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
        notes=_notes(program, edits) if request.noted else (),
    )


def _notes(program: PartProgram, edits: Edits) -> tuple[str, ...]:
    """Warnings for the head of a program; beyond the first ones their number."""
    passed = (f"{line_words(note.first, note.last)}: {note.what}: passed through unchanged" for note in program.notes)
    words = [f"warning: {word}" for word in (*passed, *edits.warnings)]
    more = [f"{len(words) - NOTED} more warnings"] if len(words) > NOTED else []
    return (*words[:NOTED], *more)


def _refusal(name: str, verdict: Verdict) -> PhPostError:
    first = "; ".join(one.sentence() for one in verdict.failures[:SHOWN])
    more = f" and {verdict.found - SHOWN} more" if verdict.found > SHOWN else ""
    return PhPostError(
        f"{name}: the compensated program does not pass its own check, and is not written: {first}{more}"
    )
