"""Read what the functions of :mod:`ph_post` take: machines, paths, part programs and logs.

Files may be named, or be those that are shipped (``oval``, ``mill``); ``-`` is standard input. A function that
takes a job or a machine takes what was read here, or the name of a file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import TYPE_CHECKING, Final

import msgspec

from ph_post.analysis.path_analysis import Analysis, IntervalSource, analyse
from ph_post.api.corners import with_rounded_corners
from ph_post.dialects.reading import dialect_of, read_again_as, read_as, read_program_file
from ph_post.dialects.registry import find_dialect
from ph_post.drive import machinefile
from ph_post.drive.axes import check_axes, gravity_notes
from ph_post.drive.effects.active import ignored_effects, unmoved_axes
from ph_post.drive.intervalfile import read_intervals
from ph_post.drive.intervals import IntervalTable, backlash_interval, look_up
from ph_post.edit.edits import TOLERANCE
from ph_post.edit.undo import original_of
from ph_post.errors import InputError
from ph_post.files.path import path_of
from ph_post.files.storage import SourceBytes, SourceText, decoded, is_program, or_shipped, read_raw
from ph_post.gcode.paths import main_path
from ph_post.gcode.program import PartProgram
from ph_post.progress import Progress, no_progress
from ph_post.types import Axis, BacklashInterval, Log, Machine, Path

if TYPE_CHECKING:
    from ph_post.api.options import CompensateOptions

COMPENSATED_BEFORE: Final = "compensated before"
"""What a note says of a program of which the original is taken."""

Source = str | os.PathLike[str]
"""The name of a file, of a shipped one, or ``-`` for standard input."""

Job = Path | PartProgram | SourceBytes | Source
"""Job to compensate: a path or a part program, read or by its name."""

_texts: dict[str, SourceText] = {}
"""Texts of the machine files that were read in this process, by their hash."""


def read_machine(source: Source, *, dialect: str | None = None) -> Machine:
    """Read a machine file.

    Parameters
    ----------
    source : str or path
        A TOML file, or the name of a shipped one.
    dialect : str, optional
        Controller dialect in place of the file's.

    Returns
    -------
    Machine
        In SI units.

    Raises
    ------
    InputError
        Where the file is bad, or its dialect is not registered.

    Examples
    --------
    >>> import ph_post as ph
    >>> ph.read_machine("mill").axes["X"].gap.lost_motion
    3e-05
    """
    machine, name = any_machine(source)
    if dialect is not None:
        find_dialect(dialect, "--dialect")
        return msgspec.structs.replace(machine, dialect=dialect)
    find_dialect(machine.dialect, f"{name}: controller.dialect")
    return machine


def any_machine(machine: Machine | Source) -> tuple[Machine, str]:
    """Return a machine, whether or not its dialect is registered, and its name for messages.

    Raises
    ------
    InputError
        Where its file is bad.
    """
    if isinstance(machine, Machine):
        return machine, f"machine {machine.name}"
    return machine_of_text(machinefile.machine_source(machine)), os.fspath(machine)


def machine_of_text(text: SourceText) -> Machine:
    """Return the machine of a file's text, which is kept for :func:`machine_text`; raises as :func:`any_machine`."""
    found = machinefile.machine_of(text)
    _texts[found.digest] = text
    return found


def machine_text(machine: Machine) -> SourceText | None:
    """Return the text of the file that a machine was read from; None where it was made without a file."""
    return _texts.get(machine.digest)


def source_of(machine: Machine, source: SourceText | None, what: str) -> SourceText:
    """Return the file of a machine, to which what was `what` ("found") is added.

    Raises
    ------
    InputError
        Where the machine was not read from a file.
    """
    if source is None:
        problem = f"was not read from a file, to which what was {what} could be added"
        raise InputError(f"machine {machine.name}", problem, expected="a machine of read_machine")
    return source


def machine_named(machine: Machine | Source, dialect: str | None = None) -> tuple[Machine, str]:
    """Return a machine, read where only its file is named, and its name for messages.

    Parameters
    ----------
    machine : Machine, str or path
    dialect : str, optional
        Controller dialect in place of the machine's.

    Raises
    ------
    InputError
        As :func:`read_machine`.
    """
    if not isinstance(machine, Machine):
        return read_machine(machine, dialect=dialect), os.fspath(machine)
    if dialect is not None:
        find_dialect(dialect, "--dialect")
        machine = msgspec.structs.replace(machine, dialect=dialect)
    return machine, f"machine {machine.name}"


def read_path(source: Source, *, feed: float | None = None) -> Path:
    """Read a path file.

    Parameters
    ----------
    source : str or path
        A JSON file in the format ``ph-post-path``, the name of a shipped one, or ``-``.
    feed : float, optional
        Feed [m/s] in place of the path's; segments with a feed of their own keep it.

    Returns
    -------
    Path
        In SI units.

    Raises
    ------
    InputError
        Where the file is bad.

    Examples
    --------
    >>> import ph_post as ph
    >>> path = ph.read_path("oval")
    >>> path.axes, len(path.segments)
    (('X', 'Y'), 4)
    """
    path = path_of(decoded(read_raw(or_shipped("paths", source))))
    return path if feed is None else msgspec.structs.replace(path, feed=feed)


def read_program(source: Source, *, dialect: str | None = None, strict: bool = False) -> PartProgram:
    r"""Read a part program.

    Parameters
    ----------
    source : str or path
        A file, or ``-``.
    dialect : str, optional
        Controller dialect; by default what the program itself declares, or else the words that most
        controllers share. A function that takes a program and a machine reads it again in the machine's.
    strict : bool, optional
        Refuse a program with commands that are not understood.

    Returns
    -------
    PartProgram

    Raises
    ------
    InputError
        Where the file is bad.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import ph_post as ph
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "part.ngc")
    ...     _ = file.write_text("G21 G90 G1 X10 F600\nX0\nM2\n")
    ...     ph.read_program(file).motions.kind.size
    2
    """
    return read_program_file(source, dialect=dialect, strict=strict)


def read_log(
    source: Source | SourceBytes,
    *,
    columns: Sequence[str] = (),
    sides: Mapping[str, str] | None = None,
    program: PartProgram | Source | None = None,
    machine: Machine | Source | None = None,
) -> Log:
    r"""Read a measured or simulated log: CSV, ``.mat``, ``.npz``, ``.parquet``, or LinuxCNC's ``halsampler``.

    Parameters
    ----------
    source : str or path
        A file, or ``-``.
    columns : sequence of str, optional
        Mappings ``NAME=SOURCE[*FACTOR]:UNIT`` of columns with other names, such as ``X_act=qm:m``.
    sides : mapping of str to str, optional
        By axis where `X_act` was read: "table", "motor" or "unknown".
    program : PartProgram, str or path, optional
        The program that ran: gives the commands that the log lacks, and must fit those that it has.
    machine : Machine, str or path, optional
        The machine that was measured: its servo period is that of rows without a time.

    Returns
    -------
    Log
        In SI units, at one constant period; missing samples are NaN.

    Raises
    ------
    InputError
        Where the file is bad, or belongs to another machine or program.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import ph_post as ph
    >>> rows = "".join(f"{k / 1000},{k / 500},{k / 500}\n" for k in range(300))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "run.csv")
    ...     _ = file.write_text("t,X_cmd,X_act\n" + rows)
    ...     ph.read_log(file).period
    0.001
    """
    from ph_post.identify import logprogram  # loads scipy.signal, slow: for logs alone

    drives = machine if isinstance(machine, Machine | None) else machinefile.read_machine(machine)
    if not isinstance(program, PartProgram | None):
        program = read_program_file(program, machine=drives)
    return logprogram.read_log(source, columns=columns, sides=sides, program=program, machine=drives)


def raw_job(job: Job) -> Path | SourceBytes:
    """Return a path as it is, a part program as its bytes, and what a file of that name holds."""
    if isinstance(job, Path | SourceBytes):
        return job
    if isinstance(job, PartProgram):
        return SourceBytes(name=job.name, stem=PurePath(job.name).stem, data=job.data)
    return read_raw(or_shipped("paths", job))


def program_in(job: PartProgram | SourceBytes, dialect: str, *, strict: bool = False) -> PartProgram:
    """Return a part program read by the words of a dialect; it is read again where its language is another.

    Raises
    ------
    InputError
        Where it is not understood, or `strict` and some of it is not.
    """
    if isinstance(job, PartProgram):
        return read_again_as(dialect, job, strict=strict)
    return read_as(dialect, job.data, job.name, strict=strict)


def path_of_job(
    job: Path | SourceBytes, machine: Machine | None = None, *, feed: float | None = None, dialect: str | None = None
) -> tuple[Path, tuple[str, ...]]:
    """Return a job's path, of a part program its longest one, and what of the program the path lacks.

    Parameters
    ----------
    job : Path or SourceBytes
    machine : Machine, optional
        Gives the language of a program that declares none.
    feed : float, optional
        Feed [m/s] in place of the path's; segments with a feed of their own keep it.
    dialect : str, optional
        Language of a program, in place of its own or the machine's.

    Raises
    ------
    InputError
        Where the job cannot be read.
    """
    path, notes = (job, ()) if isinstance(job, Path) else _read_path(job, machine, dialect)
    return (path if feed is None else msgspec.structs.replace(path, feed=feed)), notes


def _read_path(raw: SourceBytes, machine: Machine | None, dialect: str | None) -> tuple[Path, tuple[str, ...]]:
    """Read a path file, or the longest path of a part program, and what of the program it does not show."""
    if not is_program(raw):
        return path_of(decoded(raw)), ()
    program = read_as(dialect_of([raw.data], dialect, machine), raw.data, raw.name)
    program, past = _uncompensated(program)
    found, warnings = main_path(program)
    notes = (f"{program.line_words(note.first, note.last)}: {note.what}: not in the path" for note in program.notes)
    return found.path, (*past, *warnings, *notes)


def _uncompensated(program: PartProgram) -> tuple[PartProgram, tuple[str, ...]]:
    """Return the original of a compensated program, and that it is; another program as it is.

    The path that the part should have is the original's.
    """
    try:
        original = original_of(program, f"original of {program.name}")
    except InputError:
        said = "compensated, and changed since then: this is its path with the offsets, which the part has not"
        return program, (f"{program.name} was {said}",)
    if original is None:
        return program, ()
    said = "this is the path of its original; `report` or `diff -m` judge the program itself"
    return original, (f"{program.name} was {COMPENSATED_BEFORE}: {said}",)


def read_job(
    job: Job,
    machine: Machine | Source | None,
    *,
    feed: float | None = None,
    dialect: str | None = None,
    corner_tolerance: float | None = None,
) -> tuple[Path, Machine | None, tuple[str, ...]]:
    """Read a job and a machine that has a drive for each of its axes.

    Parameters
    ----------
    job : Path, PartProgram, SourceBytes, str or path
    machine : Machine, str, path or None
    feed : float, optional
        Feed [m/s] in place of the path's.
    dialect : str, optional
        Controller dialect in place of the machine's, and language of a program.
    corner_tolerance : float, optional
        Round sharp corners, by curves as far from the path at most [m].

    Returns
    -------
    path : Path
        Of a part program its longest path; its remarks say which corners are rounded.
    machine : Machine or None
    notes : tuple of str
        Parts of a part program that the path does not show.

    Raises
    ------
    InputError
        Where one of them is bad, or the machine has no drive for an axis of the path.
    """
    raw = raw_job(job)
    if machine is None:
        path, notes = path_of_job(raw, feed=feed, dialect=dialect)
        return with_rounded_corners(path, corner_tolerance), None, notes
    drives, name = machine_named(machine, dialect)
    path, notes = path_of_job(raw, drives, feed=feed, dialect=dialect)
    check_axes(path.axes, "path", drives, name)
    return with_rounded_corners(path, corner_tolerance), drives, notes


def analyse_job(
    job: Job,
    machine: Machine | Source | None,
    *,
    tolerance: float = TOLERANCE,
    feed: float | None = None,
    dialect: str | None = None,
    corner_tolerance: float | None = None,
    interval_table: Source | IntervalTable | None = None,
    progress: Progress = no_progress,
) -> tuple[Analysis, tuple[str, ...]]:
    """Read a job and a machine as :func:`read_job`, and analyse the path on it.

    Parameters
    ----------
    job, machine, feed, dialect, corner_tolerance
        As of :func:`read_job`.
    tolerance : float, optional
        ε of the windows [m].
    interval_table : IntervalTable, str or path, optional
        Table in which backlash intervals are looked up, in place of solving for them.
    progress : callable, optional

    Returns
    -------
    analysis : Analysis
    notes : tuple of str
        Parts of a part program that the path does not show.

    Raises
    ------
    InputError
        As :func:`read_job`, and where the table is bad.
    """
    progress("reading")
    path, drives, notes = read_job(job, machine, feed=feed, dialect=dialect, corner_tolerance=corner_tolerance)
    solve: IntervalSource = backlash_interval
    if interval_table is not None:
        table = interval_table if isinstance(interval_table, IntervalTable) else read_intervals(interval_table)
        solve = _look_up_in(table)
    progress("locating turning points, windows and backlash intervals")
    return analyse(path, drives, tolerance, solve), notes


def analysed_job(
    job: Job, machine: Machine | Source, how: CompensateOptions, progress: Progress
) -> tuple[Analysis, tuple[str, ...]]:
    """Analyse a job by a record of options; see :func:`analyse_job`."""
    return analyse_job(
        job,
        machine,
        tolerance=how.tolerance,
        feed=how.feed,
        dialect=how.dialect,
        corner_tolerance=how.corner_tolerance,
        interval_table=how.interval_table,
        progress=progress,
    )


def _look_up_in(table: IntervalTable) -> IntervalSource:
    """Look up what a table can hold; the gap of a loop that is not closed over the table has no β and C."""

    def solve(axis: Axis, amplitude: float, omega: float) -> tuple[BacklashInterval | None, str]:
        if not axis.loop.encloses_backlash:
            return backlash_interval(axis, amplitude, omega)
        return look_up(table, axis, amplitude, omega)

    return solve


def machine_warnings(machine: Machine, axes: Sequence[str]) -> tuple[str, ...]:
    """Name the axes that gravity holds, and effects that do not act in their simulation, or only in part."""
    ignored = (
        f"axis {name}: the effect {effect} of the machine file does not act in the simulation"
        for name in axes
        for effect in dict.fromkeys(ignored_effects(machine.axes[name]))
    )
    unmoved = (
        f"axis {name}: its squareness to {other} does not show, because nothing moves {other}"
        for name in axes
        for other in unmoved_axes(machine.axes[name], axes)
    )
    return (*gravity_notes(machine, axes), *ignored, *unmoved)
