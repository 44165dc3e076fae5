"""Check and compare part programs: verify, diff, and the rehearsal on LinuxCNC."""

from __future__ import annotations

from typing import Final

import msgspec

from ph_post.api.expansion import in_own_lines, written_out
from ph_post.api.further_axes import shifted_original
from ph_post.api.inputs import Source, any_machine
from ph_post.api.options import require_number
from ph_post.dialects.reading import read_program_file, read_program_pair
from ph_post.dialects.registry import find_dialect
from ph_post.diff import compare
from ph_post.diff.compare import Comparison
from ph_post.drive.axes import check_axes
from ph_post.edit.edits import TOLERANCE
from ph_post.edit.undo import original_of
from ph_post.errors import InputError
from ph_post.gcode.language import RS274
from ph_post.gcode.program import PartProgram
from ph_post.post.remarks import is_shifted
from ph_post.progress import Progress, no_progress
from ph_post.rehearse import rehearse as rehearsing
from ph_post.rehearse.linuxcnc import TIME_LIMIT
from ph_post.rehearse.rehearse import Rehearsal
from ph_post.simulate.controllers.moves import moved_axes
from ph_post.types import Machine
from ph_post.verify import verify as verifying
from ph_post.verify.shifted import verify_shifted
from ph_post.verify.verdict import Verdict

SAME_PATH: Final = compare.TOLERANCE
"""Tool paths that are no farther apart [m] are the same."""


def verify(
    original: PartProgram | Source,
    compensated: PartProgram | Source,
    machine: Machine | Source | None = None,
    *,
    tolerance: float = TOLERANCE,
    dialect: str | None = None,
    progress: Progress = no_progress,
) -> Verdict:
    r"""Prove that a compensated program is its original but for what its header declares.

    Parameters
    ----------
    original, compensated : PartProgram, str or path
    machine : Machine, str or path, optional
        The shifts are held to its limits, and the declaration to its lost motion.
    tolerance : float, optional
        Largest deviation of the path in changed stretches [m]; that of the compensation.
    dialect : str, optional
        Controller dialect by whose words both programs are read, in place of what they declare or the
        machine's.
    progress : callable, optional
        Called with the name of every stage.

    Returns
    -------
    Verdict
        `ok`, and the `failures`.

    Raises
    ------
    InputError
        Where a program or the machine file cannot be read.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import ph_post as ph
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "part.ngc")
    ...     _ = file.write_text("G21 G90 G1 X10 F600\nX0\nM2\n")
    ...     ph.verify(file, file).ok
    True
    """
    require_number("tolerance", tolerance)
    progress("reading")
    drives = None if machine is None else any_machine(machine)[0]
    programs = read_program_pair(original, compensated, drives, dialect)
    shifted = shifted_original(programs[1])
    progress("comparing")
    plain = written_out(programs[0], programs[1] if shifted is None else shifted[1])
    if shifted is not None:
        first = verify_shifted(plain, shifted[0], drives)
        if not first.ok:
            return _in_lines_of(plain, first)
        plain = in_own_lines(shifted[0])
    return _in_lines_of(plain, verifying.verify(plain, programs[1], tolerance=tolerance, machine=drives))


def _in_lines_of(program: PartProgram, found: Verdict) -> Verdict:
    """Return a verdict on a program whose lines of the original are those that people know."""
    named = [
        one if one.original is None else msgspec.structs.replace(one, original=program.line_number(one.original - 1))
        for one in found.failures
    ]
    return msgspec.structs.replace(found, failures=tuple(named))


def diff(
    a: PartProgram | Source,
    b: PartProgram | Source,
    machine: Machine | Source | None = None,
    *,
    tolerance: float = SAME_PATH,
    dialect: str | None = None,
    progress: Progress = no_progress,
) -> Comparison:
    r"""Compare what two programs do: tool path, feed, time, and everything beside moving.

    Parameters
    ----------
    a, b : PartProgram, str or path
    machine : Machine, str or path, optional
        Rapid moves count in the times, and the contour errors on this machine are predicted.
    tolerance : float, optional
        Tool paths that are no farther apart than this [m] are the same.
    dialect : str, optional
        Controller dialect by whose words both are read, in place of what they declare or the machine's.
    progress : callable, optional
        Called with the name of every stage.

    Returns
    -------
    Comparison
        `same` says whether a machine does the same with both.

    Raises
    ------
    InputError
        Where a program or the machine file cannot be read, or the machine lacks an axis of a program.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import ph_post as ph
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     one, other = pathlib.Path(folder, "a.ngc"), pathlib.Path(folder, "b.ngc")
    ...     _ = one.write_text("G21 G90 G1 X10 F600\nX0\nM2\n")
    ...     _ = other.write_text("G21 G90 G1 X10.5 F600\nX0\nM2\n")
    ...     found = ph.diff(one, other)
    >>> found.same, round(found.max_deviation, 6)
    (False, 0.0005)
    """
    require_number("tolerance", tolerance)
    progress("reading")
    drives, name = (None, "") if machine is None else any_machine(machine)
    programs = read_program_pair(a, b, drives, dialect)
    if drives is not None:
        for program in programs:
            check_axes(moved_axes(program), "program", drives, name)
    progress("comparing")
    return compare.compare_programs(*programs, tolerance, drives)


def rehearse(
    program: PartProgram | Source,
    machine: Machine | Source,
    *,
    original: PartProgram | Source | None = None,
    backlash: bool = False,
    limit: float = TIME_LIMIT,
    progress: Progress = no_progress,
) -> Rehearsal:
    """Run a program on a real LinuxCNC installed here, and its commands through the machine's drives.

    Parameters
    ----------
    program : PartProgram, str or path
    machine : Machine, str or path
        With a drive for every axis that the program moves; its dialect is one of LinuxCNC.
    original : PartProgram, str or path, optional
        The program that `program` was made of; of an edited program it is recovered. Of one that was made from a
        path it is the plain program of that path (strategy "none"); without it no error is known where offsets
        shift the path.
    backlash : bool, optional
        Also run the original with LinuxCNC's own compensation of the machine's lost motion.
    limit : float, optional
        Time on the wall that each run on LinuxCNC may take [s].
    progress : callable, optional
        Called with the name of every stage.

    Returns
    -------
    Rehearsal

    Raises
    ------
    InputError
        Where an input cannot be read, the machine is for another controller or lacks an axis, or LinuxCNC
        refuses a program.
    NotInstalledError
        Where there is no LinuxCNC.

    Examples
    --------
    >>> import ph_post as ph
    >>> found = ph.rehearse("part_compensated.ngc", "router")  # doctest: +SKIP
    >>> found.real.error.error.max  # doctest: +SKIP
    1.2e-05
    """
    progress("reading")
    drives, name = any_machine(machine)
    spoken = find_dialect(drives.dialect).language
    if (spoken.name, spoken.read) != (RS274.name, RS274.read):
        what = "LinuxCNC runs programs in RS274's words, not in those of another controller"
        raise InputError(name, what, expected="a machine file for LinuxCNC", got=drives.dialect)
    part = _read(program)
    before = original_of(part, f"original of {part.name}") if original is None else _read(original)
    check_axes(moved_axes(part), "program", drives, name)
    return rehearsing.rehearse(
        part,
        drives,
        original=before,
        nominal=before is not None or not is_shifted(part.data),
        backlash=backlash,
        limit=limit,
        progress=progress,
    )


def _read(program: PartProgram | Source) -> PartProgram:
    return program if isinstance(program, PartProgram) else read_program_file(program)
