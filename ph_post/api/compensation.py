"""Compensate paths and part programs, and take a compensation back."""

from __future__ import annotations

import os
from collections.abc import Sequence
from typing import Literal, get_args

from ph_post.api.expansion import before_expansion
from ph_post.api.inputs import Job, Source, raw_job
from ph_post.api.options import CompensateOptions, require_word
from ph_post.api.outcomes import Compensation
from ph_post.api.path_compensation import compensated_path
from ph_post.api.program_compensation import ProgramCompensation
from ph_post.compensate.options import PlanOutput
from ph_post.dialects.declaration import read_declaration
from ph_post.drive.intervals import IntervalTable
from ph_post.edit import undo as edit_undo
from ph_post.edit.edits import TOLERANCE
from ph_post.errors import InputError
from ph_post.expand.writing import EXPANDED, SHIFTED
from ph_post.files.storage import SourceBytes, is_program, or_shipped, read_raw
from ph_post.gcode.program import PartProgram
from ph_post.post.options import BLOCK_TIME, CHORD_TOLERANCE, FeedMode
from ph_post.progress import Progress, no_progress
from ph_post.types import Machine, Path


def compensated(
    job: Job,
    machine: Machine | Source,
    options: CompensateOptions,
    output: PlanOutput = "program",
    progress: Progress = no_progress,
) -> Compensation:
    """Compensate a job by a record of options; see :func:`compensate`."""
    require_word("output", output, get_args(PlanOutput))
    raw: Path | PartProgram | SourceBytes = job if isinstance(job, PartProgram) else raw_job(job)
    result: Compensation
    if isinstance(raw, PartProgram) or (isinstance(raw, SourceBytes) and is_program(raw)):
        result = ProgramCompensation(raw, machine, options, output, progress)
    else:
        options.check_for_path()
        result = compensated_path(raw, machine, options, output, progress)
    if options.require_all:
        result.check_all()
    return result


def compensate(
    job: Job,
    machine: Machine | Source,
    *,
    output: PlanOutput = "program",
    strategy: str | None = None,
    tolerance: float = TOLERANCE,
    feed: float | None = None,
    corner_tolerance: float | None = None,
    dialect: str | None = None,
    start: Literal["rest", "moving"] = "rest",
    ratio: float | None = None,
    degree: int | None = None,
    t_star: float | None = None,
    coefficients: tuple[float, ...] | None = None,
    allow_retrograde: bool = False,
    min_feed: float | None = None,
    max_slowdown: float = 0.1,
    max_standstill: float | None = None,
    feed_only: bool = False,
    no_inverse_dynamics: bool = False,
    effort: float = 1.0,
    interval_table: Source | IntervalTable | None = None,
    feed_mode: FeedMode = "per-minute",
    chord_tolerance: float = CHORD_TOLERANCE,
    block_time: float = BLOCK_TIME,
    safe_z: float | None = None,
    depth: float | None = None,
    position_from: Literal["+", "-"] | None = None,
    overshoot: float | None = None,
    part_side: Literal["left", "right"] | None = None,
    strict: bool = False,
    force: bool = False,
    require_all: bool = False,
    lead_program: bool = False,
    expand: bool = False,
    subprograms: Sequence[Source] = (),
    parameters: Source | None = None,
    tool_table: Source | None = None,
    controller_units: Literal["mm", "inch"] = "mm",
    peck_clearance: float | None = None,
    controller_version: str | None = None,
    progress: Progress = no_progress,
) -> Compensation:
    """Compensate a path or a part program for the backlash of a machine.

    The method is that of [1]_, and the choice among its variants is made by simulation. A path is planned and
    written anew. Of a part program only what has to change is changed, and the result is verified before it
    is returned.

    Parameters
    ----------
    job : Path, PartProgram, str or path
        A file name may be that of a shipped path.
    machine : Machine, str or path
        A file name may be that of a shipped machine.
    output : {"program", "table"}
        Output that `before` and `after` of the result belong to; both can be written.
    strategy : str, optional
        Method of compensation: "auto" by default, "suppress" where a profile is described by `ratio`,
        `degree`, `t_star` or `coefficients`.
    tolerance : float
        Largest distance of the osculating circle from the path inside a window [m].
    feed : float, optional
        Feed in place of the path's [m/s].
    corner_tolerance : float, optional
        Round the sharp corners of a path by curves of continuous curvature, which are run without a stop; neither
        has a point farther from the other [m].
    dialect : str, optional
        Controller dialect in place of the machine's.
    start : {"rest", "moving"}
        Begin and end at rest and stop in sharp corners, or hold the feed from end to end.
    ratio : float, optional
        Feed in the middle of every profile, V(½) / V_c.
    degree : int, optional
        Degree of every profile, n of Eq. (26) of [1]_, even.
    t_star : float, optional
        Half duration of every profile [s].
    coefficients : tuple of float, optional
        All V_k / V_c of Eq. (26) of [1]_.
    allow_retrograde : bool
        Let the feed become negative.
    min_feed : float, optional
        Lowest feed while cutting [m/s].
    max_slowdown : float
        Largest growth of the time, relative.
    max_standstill : float, optional
        How much longer than the plain motion's the tool may stand or creep on the contour of a path, in all [s].
    feed_only : bool
        Leave the path as it is: nothing is added to its positions.
    no_inverse_dynamics : bool
        Do not lead a table's path by what the servos lag behind it.
    effort : float
        Effort of the search: 1 for some ten seconds.
    interval_table : IntervalTable, str or path, optional
        Table of :func:`ph_post.sweep` in which backlash intervals are looked up, in place of solving for them.
    feed_mode : {"per-minute", "inverse-time"}
        Form of F words.
    chord_tolerance : float
        Largest distance of a chord from the path [m].
    block_time : float
        Longest block in ramps and dips [s].
    safe_z, depth : float, optional
        Height at which a path is approached and left, and at which a planar path is cut [m].
    position_from : {"+", "-"}, optional
        Side from which X and Y of a part program come to places at which they rest while the tool cuts, as holes.
    overshoot : float, optional
        From how far beyond its place an axis comes in the air [m]; by default twice its lost motion.
    part_side : {"left", "right"}, optional
        Side of the path of a part program, seen along it, on which the part is: crossings leave it proud, not cut into.
    strict : bool
        Refuse a part program with commands that are not understood.
    force : bool
        Compensate a part program anew that was compensated otherwise before.
    require_all : bool
        Refuse a result in which a reversal at which the tool cuts is not compensated.
    lead_program : bool
        Write the lead of the servos into the path of the program, as chords; it holds at 100 % feed override.
    expand : bool
        Write a part program out first: parameters, loops, subprograms, cycles and cutter compensation become
        plain motions.
    subprograms : sequence of str or path
        Folders of subprograms that are files of their own, besides that of the program.
    parameters : str or path, optional
        The controller's file of parameters, for programs that read them.
    tool_table : str or path, optional
        The controller's table of tools, for cutter compensation by G41 and G42.
    controller_units : "mm" or "inch"
        Units of the controller's files.
    peck_clearance : float, optional
        How far G73 and G83 back off [m] on a control of Fanuc, as its parameters 5114 and 5115 say.
    controller_version : str, optional
        Version of LinuxCNC, as "2.9.4", for turning cycles in which its versions differ.
    progress : callable, optional
        Called with the name of every stage.

    Returns
    -------
    Compensation

    Raises
    ------
    InputError
        Where the job, the machine or an option is bad.
    PhPostError
        Where a compensated program does not pass its own check, or, with `require_all`, leaves a reversal.

    References
    ----------
    .. [1] Real-time compensation of backlash positional errors in CNC machines by localized feedrate
       modulation, Int. J. Adv. Manuf. Technol. 119 (2022), doi:10.1007/s00170-021-08515-z.

    Examples
    --------
    >>> import ph_post as ph
    >>> result = ph.compensate("circle", "paper", output="table", strategy="suppress")
    >>> result.reversals
    ReversalCount(compensated=3, all=3)
    >>> result.after.error_gap.max < result.before.error_gap.max
    True
    """
    # Each option of the signature is one of the record, by the same name.
    given = {name: value for name, value in locals().items() if name in CompensateOptions.__struct_fields__}
    given["subprograms"] = tuple(os.fspath(folder) for folder in subprograms)
    return compensated(job, machine, CompensateOptions(**given), output, progress)


def undo(program: PartProgram | SourceBytes | Source) -> bytes:
    r"""Return the original of a compensated part program, byte for byte; of one that was written out, from before that.

    Parameters
    ----------
    program : PartProgram, str or path

    Returns
    -------
    bytes

    Raises
    ------
    InputError
        Where the program was not compensated, or was changed after that.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import ph_post as ph
    >>> original = b"G21 G90\nG0 X0 Y0\nG1 X10 F600\nY10\nX0\nY0\nM2\n"
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "part.ngc")
    ...     _ = file.write_bytes(original)
    ...     ph.compensate(ph.read_program(file), "router", max_slowdown=10.0).write(file)
    ...     file.read_bytes() == original, ph.undo(file) == original
    (False, True)
    """
    raw = program if isinstance(program, PartProgram | SourceBytes) else read_raw(or_shipped("paths", program))
    if read_declaration(raw.data) is None and max(EXPANDED.first(raw.data), SHIFTED.first(raw.data)) >= 0:
        return _before_changes(raw.data, raw.name)
    data = edit_undo.undo(raw.data, raw.name)
    try:
        return _before_changes(data, raw.name)
    except InputError:
        # It was changed by hand before it was compensated: that is the program that was given.
        return data


def _before_changes(data: bytes, name: str) -> bytes:
    """Return what a program was before it was written out, and its further axes compensated."""
    shifted = SHIFTED.read(data, name)
    data = data if shifted is None else shifted.original
    return before_expansion(data, name) or data
