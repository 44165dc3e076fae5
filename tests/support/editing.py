"""Programs compensated with lasting offsets, from bytes to bytes."""

from __future__ import annotations

from dataclasses import dataclass

from ph_post.dialects.declaration import Declaration
from ph_post.dialects.reading import read_as
from ph_post.dialects.registry import find_dialect
from ph_post.edit.edits import EditOptions, Edits
from ph_post.edit.offset_edits import plan_offsets
from ph_post.edit.write import apply_edits, declare
from ph_post.gcode.program import PartProgram
from ph_post.types import Machine

ENOUGH = 1000.0
"""Times the program's time that may be added: all reversals are followed."""


@dataclass(frozen=True)
class Compensated:
    """A program, what is changed in it, and the text that comes of it."""

    program: PartProgram
    edits: Edits
    declaration: Declaration
    text: bytes


def compensate(
    data: bytes, machine: Machine, *, dialect: str = "linuxcnc", max_slowdown: float = ENOUGH, part_side: int = 0
) -> Compensated:
    """Read, plan and write."""
    program = read_as(dialect, data, "part.ngc")
    options = EditOptions(max_slowdown=max_slowdown, part_side=part_side)
    edits = plan_offsets(program, machine, find_dialect(dialect), options)
    return with_edits(program, edits, machine, dialect)


def with_edits(program: PartProgram, edits: Edits, machine: Machine, dialect: str) -> Compensated:
    """Write changes that are told beforehand."""
    declaration = declare(program, edits, machine, find_dialect(dialect), EditOptions(), options_digest="0" * 64)
    text = apply_edits(program, edits, find_dialect(dialect), declaration)
    return Compensated(program=program, edits=edits, declaration=declaration, text=text)
