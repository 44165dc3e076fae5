"""Compensate axes beside X, Y and Z of a part program, and its holes, before all else, and say what comes of it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.api.compensated_program import ProgramRequest
from ph_post.api.expansion import in_own_lines
from ph_post.api.inputs import program_in
from ph_post.api.results import AxisReversals
from ph_post.compensate.strategies.registry import find_traits
from ph_post.dialects.declaration import comment_pattern, read_facts, shifted_origins
from ph_post.dialects.registry import find_dialect
from ph_post.edit.further_edits import FurtherAxisPlan, plan_further
from ph_post.edit.further_write import FurtherRequest, write_further
from ph_post.edit.hole_edits import HolePlan, plan_holes
from ph_post.edit.undo import original_of
from ph_post.edit.window_plans import shifts_axes
from ph_post.edit.write import LongLinesError
from ph_post.errors import InputError
from ph_post.expand.writing import SHIFTED
from ph_post.files.storage import SourceBytes
from ph_post.gcode.codes import CYCLE
from ph_post.gcode.holes import hole_runs
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import reread
from ph_post.simulate.contour import ContourError
from ph_post.types import Machine
from ph_post.verify.shifted import verify_shifted
from ph_post.version import package_version

_HEAD: Final = comment_pattern(f"{SHIFTED.mark}.*")
_VERSION: Final = re.compile(r"(\S+) compensated .*", re.IGNORECASE)
_HASH: Final = re.compile(r"(?:machine .*,|options) sha256 ?([0-9a-f]*)", re.IGNORECASE)


class FurtherError(msgspec.Struct, frozen=True, kw_only=True):
    """How far the table of an axis beside X, Y and Z is from where it should be while the tool works [rad or m].

    `before` and `after` at the values of the machine file, `after_worst` if the backlash is off by its uncertainty;
    `reversals` of the axis, and `done` of them.
    """

    axis: str
    before: ContourError
    after: ContourError
    after_worst: ContourError
    reversals: int
    done: int


class ShiftedJob(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A job of which axes beside X, Y and Z, and holes, are compensated, or the job itself.

    `changed` says that it was changed here, `done` that it was so before; `plans` are those of the axes, `original` the
    program before both.
    """

    job: PartProgram | SourceBytes
    plans: tuple[FurtherAxisPlan, ...] = ()
    holes: HolePlan = HolePlan()
    warnings: tuple[str, ...] = ()
    original: PartProgram | None = None
    changed: bool = False
    done: bool = False

    @property
    def errors(self) -> tuple[FurtherError, ...]:
        """What comes of each axis."""
        return tuple(_error(plan) for plan in self.plans)

    @property
    def hole_errors(self) -> tuple[FurtherError, ...]:
        """What comes of X and Y at holes, where they change there."""
        return tuple(_error(plan, (-1.0, 1.0)) for plan in self.holes.axes) if self.holes.changed else ()

    def told(self, program: PartProgram) -> PartProgram:
        """Return a program that was made here with the notes of what is passed through, but for holes that are not."""
        runs = hole_runs(self.original) if self.original is not None and self.holes.changed else []
        done = [(one.first, one.last) in self.holes.runs for one in runs]
        made = hole_runs(program) if any(done) else []
        spans = [(one.first, one.last) for one, whole in zip(made, done, strict=False) if whole]
        notes = tuple(
            note
            for note in program.notes
            if note.why != CYCLE or not any(first <= note.first <= last for first, last in spans)
        )
        return program if len(notes) == len(program.notes) else msgspec.structs.replace(program, notes=notes)

    def with_reversals(self, others: Iterable[AxisReversals]) -> tuple[AxisReversals, ...]:
        """Return the numbers of reversals of other axes, and of X and Y beside holes, with those that are shifted."""
        rows = {row.axis: row for row in others}
        for one in (*self.plans, *(hole for hole in self.holes.axes if hole.reversals)):
            left = one.reversals - one.done
            row = AxisReversals(axis=one.axis.name, compensated=one.done, all=one.reversals, cut=left)
            rows[row.axis] = rows[row.axis].with_more(row) if row.axis in rows else row
        return tuple(rows.values())


def shifted_job(
    job: PartProgram | SourceBytes,
    machine: Machine,
    request: ProgramRequest,
    *,
    strict: bool = False,
    holes: bool = False,
) -> ShiftedJob:
    """Compensate the axes beside X, Y and Z of a job that a machine has and the program moves, and its `holes`.

    Raises
    ------
    InputError
        Where it was compensated for something else before.
    """
    asked = find_traits(request.plan.strategy).compensates and shifts_axes(request.plan)
    program = program_in(job, machine.dialect, strict=strict) if asked else job
    if not (isinstance(program, PartProgram) and (machine.further or (holes and _drills(program, machine.dialect)))):
        return ShiftedJob(job=program)
    plain = original_of(program) or program
    kept = SHIFTED.read(plain.data, plain.name)
    wanted = FurtherRequest.of(machine, request.digest(machine.dialect))
    base = in_own_lines(plain if kept is None else reread(plain, kept.original))
    dialect = find_dialect(machine.dialect)
    same = kept is not None and _hashes(plain) == (package_version(), wanted.machine_digest, wanted.options_digest)
    if kept is not None and not same and not request.force:
        raise InputError(
            program.name,
            "axes beside X, Y and Z, or holes, were compensated before, otherwise or for another machine",
            expected="the original, or --force to begin again from it, or --undo",
        )
    if plain is not program and not request.force and kept is None:
        return ShiftedJob(job=program)
    plans, said = plan_further(base, machine, dialect, request.edit)
    drilled = plan_holes(base, machine, dialect, request.edit) if holes else HolePlan()
    said += drilled.left
    found = ShiftedJob(job=base, plans=tuple(plans), holes=drilled, warnings=tuple(said), original=base)
    if same and not request.force:
        return msgspec.structs.replace(found, job=program, done=True)
    try:
        data = write_further(base, plans, dialect, wanted, drilled)
    except LongLinesError:
        why = f"a line would be too long for {dialect.name}"
    else:
        if data == base.data:
            return found
        origins = shifted_origins(data, base.data)
        own = origins if origins is None or base.origins is None else base.origins[origins]
        after = msgspec.structs.replace(reread(base, data), origins=own)
        verdict = verify_shifted(base, after, machine)
        if verdict.ok:
            return msgspec.structs.replace(found, job=found.told(after), changed=True)
        why = f"the program does not pass its own check: {verdict.failures[0].sentence()}"
    names = ", ".join(plan.axis.name for plan in (*plans, *drilled.axes))
    return ShiftedJob(job=base, warnings=(*said, f"axes {names} not compensated: {why}"))


def _drills(program: PartProgram, dialect: str) -> bool:
    """Return whether a program has drilling cycles in which X and Y can be compensated."""
    return find_dialect(dialect).abilities.drills and any(note.why == CYCLE for note in program.notes)


def _hashes(program: PartProgram) -> tuple[str, ...]:
    """Return version and hashes in the head of a program."""
    head = _HEAD.search(program.data)
    facts = [] if head is None else read_facts(program.data, head.start(), SHIFTED.mark)
    versions = [found[1] for found in map(_VERSION.fullmatch, facts) if found]
    return (*versions, *(found[1].lower() for found in map(_HASH.fullmatch, facts) if found))


def shifted_original(compensated: PartProgram) -> tuple[PartProgram, PartProgram] | None:
    """Return a program before X, Y and Z were compensated, and before its other axes were; None if they were not."""
    try:
        plain = original_of(compensated) or compensated
        kept = SHIFTED.read(plain.data, plain.name)
    except InputError:
        return None
    return None if kept is None else (plain, reread(plain, kept.original))


def _error(plan: FurtherAxisPlan, sides: Sequence[float] = (0.0,)) -> FurtherError:
    """Return how far an axis is off, beginning on each of some sides of its backlash, 0 for the middle of it."""

    def played(factor: float, *, shifted: bool) -> ContourError:
        return _played(plan, sides, factor, shifted=shifted)

    unsure = plan.axis.uncertainty.backlash
    return FurtherError(
        axis=plan.axis.name,
        before=played(1.0, shifted=False),
        after=played(1.0, shifted=True),
        after_worst=max((played(1.0 + sign * unsure, shifted=True) for sign in (-1, 1)), key=lambda one: one.max),
        reversals=plan.reversals,
        done=plan.done,
    )


def _played(plan: FurtherAxisPlan, sides: Sequence[float], factor: float, *, shifted: bool) -> ContourError:
    """Let a table with backlash follow its motor, and compare where it stands while the tool works.

    Behind a place of the motor that is not known it begins anew.
    """
    half, errors = 0.5 * factor * plan.axis.gap.lost_motion, []
    for side in sides:
        table = np.nan
        for stand in plan.stands:
            motor = stand.motor if shifted else stand.place
            if np.isnan(stand.motor):
                table = np.nan
            elif not np.isnan(motor):
                begin = motor + side * half if np.isnan(table) else table
                table = min(max(begin, motor - half), motor + half)
            if stand.counts:
                errors.append(table + plan.axis.reference_side * half - stand.place)
    size = np.abs(np.array(errors or [0.0]))
    return ContourError(max=float(size.max()), rms=float(np.sqrt(np.mean(size**2))))
