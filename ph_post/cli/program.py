"""Reading part programs for the commands that take one."""

from __future__ import annotations

from ph_post.gcode.reader.read import read_program
from ph_post.gcode.reader.record import PartProgram
from ph_post.io.source import read_bytes


def read_part_program(source: str) -> PartProgram:
    """Read a part program from a file, or from standard input for ``-``.

    Raises
    ------
    InputError
        Where it cannot be read, or is no program.
    """
    name, data = read_bytes(source)
    return read_program(data, name)
