"""Plan the windows of a program, on the paths that its motions form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from itertools import pairwise
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.analysis.path_analysis import Analysis, analyse
from ph_post.compensate.motion import cycle_time
from ph_post.compensate.offsets import plan_time
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.strategies.registry import find_traits
from ph_post.drive.axes import has_backlash, with_gap
from ph_post.edit.edits import DipEdit, EditOptions, Edits, StopEdit, no_offsets
from ph_post.edit.preconditions import why_blocked, why_kept_whole, why_not_editable
from ph_post.edit.reversals import section_spans
from ph_post.edit.window_edits import UnchangedWindow, place_plan
from ph_post.errors import TooLargeError
from ph_post.files.check import in_words
from ph_post.gcode.paths import ProgramPath
from ph_post.gcode.program import PartProgram
from ph_post.geometry.curves import Composite
from ph_post.geometry.joints import find_stops
from ph_post.geometry.piecewise import MEETS
from ph_post.geometry.track import Track
from ph_post.progress import Progress, no_progress, prefixed
from ph_post.types import Array, IntArray, Machine, Path, Plan, Segment


def divide(path: ProgramPath, track: Track, places: Array, most: int) -> tuple[ProgramPath, ...]:
    """Divide a path at sharp corners and ends of rapids, as soon as a part holds enough.

    Parameters
    ----------
    path : ProgramPath
    track : Track
        Of its path.
    places : Array, shape (n,)
        Arc lengths [m] of the windows.
    most : int
        A part ends at the first rest behind so many of them.

    Returns
    -------
    tuple of ProgramPath
        Parts in order, which together are the path.
    """
    cuts = _chosen(_rests(path, track), np.sort(places), most)
    return tuple(_part(path, track, first, last) for first, last in pairwise([0, *cuts, len(track.pieces)]))


def _rests(path: ProgramPath, track: Track) -> tuple[IntArray, Array]:
    """Pieces before which the motion rests, at the end of a motion, and where that is."""
    corners, _, rapids = find_stops(track)
    s = np.unique(np.concatenate([corners, rapids]))
    piece = np.searchsorted(track.starts, s)
    segment = track.segment[piece]
    apart = track.segment[piece - 1] != segment
    curves = [isinstance(one.curve, Composite) for one in track.path.segments]
    row = np.clip(np.searchsorted(path.s, s - MEETS), 0, path.s.size - 1)
    good = (apart | np.array(curves, dtype=np.bool_)[segment]) & (np.abs(path.s[row] - s) <= MEETS)
    return piece[good], s[good]


def _chosen(rests: tuple[IntArray, Array], places: Array, most: int) -> list[int]:
    cuts: list[int] = []
    held = 0
    for piece, count in zip(rests[0].tolist(), np.searchsorted(places, rests[1]).tolist(), strict=True):
        if count - held >= most:
            cuts.append(piece)
            held = count
    return cuts


def _part(path: ProgramPath, track: Track, first: int, last: int) -> ProgramPath:
    """Cut out the pieces from `first` to before `last`."""
    if (first, last) == (0, len(track.pieces)):
        return path
    low, high = np.searchsorted(path.s, track.starts[[first, last]] - MEETS).tolist()
    segments = tuple(
        _within(track, number, first, last)
        for number in range(int(track.segment[first]), int(track.segment[last - 1]) + 1)
    )
    return replace(
        path,
        path=replace(path.path, segments=segments),
        motion=path.motion[low:high],
        s=path.s[low : high + 1] - path.s[low],
        cubics={row - low: curve for row, curve in path.cubics.items() if low <= row < high},
    )


def _within(track: Track, number: int, first: int, last: int) -> Segment:
    """Return the part of a segment between two pieces."""
    segment = track.path.segments[number]
    low, high = np.searchsorted(track.segment, [number, number + 1]).tolist()
    if first <= low and high <= last:
        return segment
    return replace(segment, curve=Composite(track.pieces[max(low, first) : min(high, last)]))


WINDOWS: Final = 10
"""Windows of a part, which ends at the next rest: a plan that a simulation proves worse than the plain program is
given up for its part alone, and no part is long to simulate."""


class WindowPlan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The plan of a path of a program, or of a part of one between two rests."""

    path: ProgramPath
    analysis: Analysis
    plan: Plan


class PlannedWindows(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The plans of a program's windows, part by part, and warnings: what is not compensated."""

    plans: tuple[WindowPlan, ...] = ()
    warnings: tuple[str, ...] = ()


class WindowEdits(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The edits of a program's windows, and the plans that they were made of."""

    edits: Edits
    plans: tuple[WindowPlan, ...] = ()


def plan_windows(
    program: PartProgram,
    paths: Sequence[ProgramPath],
    machine: Machine,
    options: PlanOptions,
    tolerance: float,
    progress: Progress = no_progress,
) -> PlannedWindows:
    """Plan the windows of a program.

    Parameters
    ----------
    program : PartProgram
    paths : sequence of ProgramPath
        Of :func:`ph_post.gcode.paths.paths_of`.
    machine : Machine
    options : PlanOptions
        The strategy and its bounds. Long paths are planned in parts, from rest to rest; a search and the time
        that may be added are shared out among them by their windows.
    tolerance : float
        ε of the windows [m].
    progress : Progress, optional
        Called with what is being done.
    """
    troubles = why_not_editable(program)
    if troubles:
        return PlannedWindows(warnings=tuple(f"windows not compensated: {trouble}" for trouble in troubles))
    reasons, said = why_blocked(program), []
    parts: list[_Part] = []
    for one in paths:
        found = _parts(one, planned_machine(machine, one.path, options), tolerance)
        if found and one.chain in reasons:
            said.append(f"{_where(program, one)}: windows not compensated: {reasons[one.chain]}")
        else:
            parts += found
    plans: list[WindowPlan] = []
    for part, chosen in zip(parts, _shared_out(options, parts), strict=True):
        where = _where(program, part.path)
        report = prefixed(progress, where)
        analysis = analyse(part.path.path, part.machine, tolerance)
        report("planning")
        try:
            plan = make_plan(analysis, chosen, report)
        except TooLargeError as error:
            said.append(f"{where}: windows not compensated: {error}")
            continue
        plans.append(WindowPlan(path=part.path, analysis=analysis, plan=plan))
    return PlannedWindows(plans=tuple(plans), warnings=tuple(said))


def edit_windows(program: PartProgram, planned: PlannedWindows, options: EditOptions) -> WindowEdits:
    """Turn the plans of windows into edits of a program's motions.

    A full stop of a plan becomes a stop at its turning point, with a backlash take-up move; the controller ramps to it
    by itself. A dip becomes blocks of a known time each. Where nothing is modulated, nothing is changed. Rapids stay
    unchanged.

    Parameters
    ----------
    program : PartProgram
    planned : PlannedWindows
    options : EditOptions
        Plans in sections that are to be `left` make no edits.

    Returns
    -------
    WindowEdits
        `edits.warnings` name what is not compensated.
    """
    low, high = section_spans(program.motions)
    left = sorted(options.left)
    kept = [one for one in planned.plans if not _touches(one.path, low[left], high[left])]
    said = list(planned.warnings)
    # Their bound is a part of the plain motions' time as it is planned.
    plain = sum(cycle_time(one.plan.nominal) for one in planned.plans)
    added = sum(plan_time(one.plan) - cycle_time(one.plan.nominal) for one in kept)
    stops: list[StopEdit] = []
    dips: list[DipEdit] = []
    for made in kept:
        whole = partial(why_kept_whole, program, shared=False)
        done = place_plan(program.motions, made.path, made.plan, options.block_time, whole)
        stops += done.stops
        dips += done.dips
        said += [f"{_where(program, made.path)}: {word}" for word in made.plan.warnings]
        said += [_words(program, made, left) for left in done.left]
    edits = Edits(
        runs=no_offsets(program.motions.kind.size),
        stops=tuple(stops),
        dips=tuple(dips),
        pulse=_pulses(stops),
        slowdown=added / plain if plain > 0.0 else 0.0,
        warnings=tuple(dict.fromkeys(said)),
    )
    return WindowEdits(edits=edits, plans=tuple(kept))


def _touches(path: ProgramPath, low: IntArray, high: IntArray) -> bool:
    """Return whether a path has a motion in one of the spans from `low` to before `high`."""
    motion = path.motion[:, None]
    return bool(((motion >= low) & (motion < high)).any())


class _Part(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A part of a path that is planned by itself, on its machine: its windows' number, its time [s]."""

    path: ProgramPath
    machine: Machine
    windows: int
    time: float


def _parts(path: ProgramPath, machine: Machine, tolerance: float) -> list[_Part]:
    """Divide a path, and leave out parts without a window at which backlash is crossed."""
    if not any(has_backlash(machine.axes[name]) for name in path.path.axes):
        return []
    found = analyse(path.path, None, tolerance)
    points = found.turning_points
    s = np.array(
        [
            window.s
            for window in found.windows
            if any(has_backlash(machine.axes[points[k].axis]) for k in window.members)
        ]
    )
    parts, begin = [], 0.0
    for one in divide(path, found.track, s, WINDOWS):
        end = begin + float(one.s[-1])
        count = int(((s >= begin) & (s <= end)).sum())
        if count:
            parts.append(_Part(path=one, machine=machine, windows=count, time=_time(one.path, machine)))
        begin = end
    return parts


def _time(path: Path, machine: Machine) -> float:
    """Time [s] of a path at its feeds, rapids as fast as the slowest axis may go."""
    track = Track(path)
    rapid = min(machine.axes[name].limits.velocity for name in path.axes)
    feeds = [rapid if one.rapid else one.feed or path.feed for one in path.segments]
    return float((np.diff(track.starts) / np.array(feeds)[track.segment]).sum())


def _shared_out(options: PlanOptions, parts: Sequence[_Part]) -> list[PlanOptions]:
    """Options of every part: it begins and ends at rest, and effort and time are shared out by windows."""
    windows, time = sum(part.windows for part in parts), sum(part.time for part in parts)
    return [
        replace(
            options,
            carrier="program",
            start="rest",
            inverse_dynamics=False,
            effort=options.effort * part.windows / windows,
            max_slowdown=options.max_slowdown * (part.windows / windows) * (time / part.time),
            max_standstill=None if options.max_standstill is None else options.max_standstill * part.windows / windows,
        )
        for part in parts
    ]


def _where(program: PartProgram, path: ProgramPath) -> str:
    first, last = program.motions.block[path.motion[[0, -1]]].tolist()
    return program.line_words(first, last)


def shifts_axes(options: PlanOptions) -> bool:
    """Return true where axes whose backlash is outside the loop get an offset."""
    return find_traits(options.strategy).shifts_axes and not options.feed_only


def planned_machine(machine: Machine, path: Path, options: PlanOptions) -> Machine:
    """Return the machine to plan windows for.

    Where offsets compensate the axes whose backlash is outside the loop, those of the path have none any more.
    """
    if not shifts_axes(options):
        return machine
    axes = {
        name: axis if axis.loop.encloses_backlash or name not in path.axes else with_gap(axis, 0.0)
        for name, axis in machine.axes.items()
    }
    return replace(machine, axes=axes)


def _pulses(stops: Sequence[StopEdit]) -> Mapping[str, float]:
    """Largest shift of each axis."""
    largest: dict[str, float] = {}
    for stop in stops:
        for shift in stop.shifts:
            largest[shift.axis] = max(largest.get(shift.axis, 0.0), abs(shift.travel))
    return largest


def _words(program: PartProgram, made: WindowPlan, left: UnchangedWindow) -> str:
    points = [made.plan.turning_points[k] for k in made.plan.windows[left.window].members]
    axes = in_words(list(dict.fromkeys(point.axis for point in points)))
    return f"{program.line_words(program.motions.block[left.motion])}: {axes} reversal not compensated: {left.why}"
