"""The reversals of a compensated part program, and what is done at each."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.analysis.path_analysis import Analysis, analyse
from ph_post.api.compensated_program import CompensatedProgram
from ph_post.api.results import AxisReversals, count_reversals
from ph_post.bounds import give_memory_back, in_parts
from ph_post.compensate.comparison import PASSED, crossings_at, strategy_at, window_number
from ph_post.compensate.strategies.registry import PLAIN, TAKE_UP
from ph_post.edit.edits import Edits, leaves_much
from ph_post.edit.preconditions import reckoned_feeds
from ph_post.edit.window_plans import WindowPlan
from ph_post.files.check import counted
from ph_post.gcode.paths import ProgramPath, paths_of
from ph_post.gcode.program import AXES, LINE, RAPID, Motions
from ph_post.geometry.numeric import zigzag
from ph_post.types import (
    Array,
    BoolArray,
    Crossing,
    FeedProfile,
    IntArray,
    Jog,
    Machine,
    TurningPoint,
    Window,
    unwritten,
)

MILLION: Final = 10**6

STILL: Final = 1e-9
"""Places of an axis, or offsets, that differ by no more [m] are the same."""

Place = tuple[str, int, int]
"""Axis, motion, and its share to a millionth."""


class ReversalEdit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Changes at a reversal: strategy, profile, and crossings or jogs."""

    strategy: str = PLAIN
    profile: FeedProfile | None = None
    crossings: tuple[Crossing | Jog, ...] = ()


class ProgramReversal(ReversalEdit, frozen=True, kw_only=True, eq=False):
    """A reversal of a part program and what is done there.

    It is the turning `point` of an `analysis` of a `path` of the program, on a `line` (from 1). `strategy` is
    "none" where nothing is done, and "takeup" where the axis gets another lasting offset. `cut` says whether
    the tool cuts behind it, `slight` whether the axis goes there and back by no more than the tolerance, as roundings
    of centres and of lines along an axis have it, `coarse` whether what is done leaves more than a fifth of the error.
    """

    path: ProgramPath
    analysis: Analysis
    point: TurningPoint
    window: Window | None
    line: int
    cut: bool
    slight: bool
    coarse: bool = False

    @property
    def compensated(self) -> bool:
        """Return whether what is done there leaves no more than a fifth of the error."""
        return self.strategy != PLAIN and not self.coarse


def program_reversals(found: CompensatedProgram, machine: Machine, tolerance: float) -> list[ProgramReversal]:
    """Return every reversal of a program, path by path.

    Parameters
    ----------
    found : CompensatedProgram
    machine : Machine
    tolerance : float
        ε of the windows [m].
    """
    give_memory_back(found.before.blocks)
    done, edits = _done(found.windows), found.edits
    changes = None if edits is None or not edits.followed else _changes_of(edits)
    return [
        one
        for path in (paths_of(reckoned_feeds(found.before, machine)) if found.paths is None else found.paths)
        for one in _of_path(found, path, analyse(path.path, machine, tolerance), done, changes)
    ]


def path_reversals(found: CompensatedProgram, path: ProgramPath, analysis: Analysis) -> list[ProgramReversal]:
    """Return every reversal of a path of which a program was made.

    Parameters
    ----------
    found : CompensatedProgram
    path : ProgramPath
        Where on the path the motions of the program are.
    analysis : Analysis
        Of the path.
    """
    edits = found.edits
    changes = None if edits is None or not edits.followed else _changes_of(edits)
    return list(_of_path(found, path, analysis, _done(found.windows), changes))


def _reach(motions: Motions, path: ProgramPath, points: Sequence[TurningPoint]) -> Array:
    """Distances [m] from the turning points of a path within which its program may turn.

    A program of straight moves turns at the end of one of them.
    """
    s = np.array([point.s for point in points])
    row = np.searchsorted(path.motion, path.to_motions(s)[0])
    beside = row[:, None] + np.array([-1, 0, 1])
    inside = (beside >= 0) & (beside < path.motion.size)
    beside = np.where(inside, beside, 0)
    straight = inside & (motions.kind[path.motion[beside]] == LINE)
    near = np.where(straight, path.s[beside + 1] - path.s[beside], 0.0).max(axis=1)
    apart = np.full(len(points), np.inf)
    axes = np.array([point.axis for point in points])
    for axis in set(axes.tolist()):
        own = np.flatnonzero(axes == axis)
        own = own[np.argsort(s[own], kind="stable")]
        between = np.diff(s[own])
        apart[own[:-1]] = between
        apart[own[1:]] = np.minimum(apart[own[1:]], between)
    return np.asarray(np.minimum(near, 0.5 * apart))


def _done(plans: Sequence[WindowPlan]) -> dict[Place, ReversalEdit]:
    """Return what plans do at their reversals; a path may have been planned in parts."""
    found: dict[Place, ReversalEdit] = {}
    for made in plans:
        plan = made.plan
        for point, place in zip(plan.turning_points, _places(made.path, plan.turning_points), strict=True):
            number = window_number(plan, point)
            found[place] = ReversalEdit(
                strategy=strategy_at(plan, point),
                profile=None if number is None else plan.profiles[number],
                crossings=crossings_at(plan, point),
            )
    return found


def _places(path: ProgramPath, points: Sequence[TurningPoint]) -> list[Place]:
    """Return where points are on the program: axis, motion, and its share to a millionth."""
    motion, share = path.to_motions(np.array([point.s for point in points]))
    rows = zip(points, motion.tolist(), share.tolist(), strict=True)
    return [(point.axis, number, round(part * MILLION)) for point, number, part in rows]


class _Changes(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Places at which the lasting offsets of a program change.

    `motion` and `share` (n, 2) of the beginnings and the ends of the stretches on which it happens, the same place
    twice for a stop, and their `column` (n,), in order of travel; `square` (n,) the error that they leave, as
    :attr:`CrossingEdit.square`, and `amplitude` the largest offsets [m]; `carried` (m, 3) is true for motions, rapids,
    that change one on their way.
    """

    axes: tuple[str, ...]
    motion: IntArray
    share: Array
    column: IntArray
    square: Array
    amplitude: Mapping[str, float]
    carried: BoolArray


def _changes_of(edits: Edits) -> _Changes:
    runs = edits.runs
    # What is not written of it takes no memory.
    steps = unwritten((runs.count, len(AXES)))
    steps[runs.first] = runs.steps
    rows = []
    for stop in edits.stops:
        for shift in stop.shifts:
            column = AXES.index(shift.axis)
            rows.append((stop.motion, stop.share, stop.motion, stop.share, column, 0.0))
            steps[stop.motion, column] -= shift.travel
    for crossing in edits.crossings:
        column, first, last = AXES.index(crossing.axis), crossing.parts[0], crossing.parts[-1]
        rows.append((first.motion, first.low, last.motion, last.high, column, crossing.square))
        steps[first.motion : last.motion + 1, column] = 0.0
    found = np.array(sorted(rows), dtype=np.float64).reshape(-1, 6)
    return _Changes(
        axes=edits.followed,
        motion=found[:, [0, 2]].astype(np.int64),
        share=found[:, [1, 3]],
        column=found[:, 4].astype(np.int64),
        square=found[:, 5],
        amplitude=edits.amplitude,
        carried=(steps > STILL) | (steps < -STILL),
    )


def count_program_reversals(found: Iterable[ProgramReversal], machine: Machine) -> tuple[AxisReversals, ...]:
    """Count the reversals of a program by axis; slight ones that are left as they are do not count."""
    counted = (one for one in found if one.compensated or not one.slight)
    return count_reversals(((one.point.axis, one.compensated, one.cut) for one in counted), machine)


def coarse_words(found: Iterable[ProgramReversal], edits: Edits | None) -> list[str]:
    """Say of each axis at how many reversals it is crossed coarsely; where time was short more of it would help."""
    counts = Counter(one.point.axis for one in found if one.coarse and not one.slight)
    allows = "; a larger --max-slowdown allows finer ones" if edits is not None and edits.short else ""
    return [
        f"axis {axis} not compensated enough at {counted(count, 'reversal')}:"
        f" its crossings there are coarse, and leave more than a fifth of the error{allows}"
        for axis, count in sorted(counts.items())
    ]


def _of_path(
    found: CompensatedProgram,
    path: ProgramPath,
    analysis: Analysis,
    done: Mapping[Place, ReversalEdit],
    changes: _Changes | None,
) -> Iterator[ProgramReversal]:
    reach = _reach(found.before.motions, path, analysis.turning_points)
    places = _places(path, analysis.turning_points)
    motion = np.array([number for _, number, _ in places], dtype=np.int64)
    lines = found.before.line_numbers(motion)
    windows = {member: window for window in analysis.windows for member in window.members}
    slight = _slight(analysis, found.before.motions, motion)
    at_end = _at_end(found.before.motions, analysis, places, slight)
    shifted = _shifted(changes, found.before.motions, path, analysis, places, reach, at_end, slight)
    after = np.minimum(np.searchsorted(path.motion, motion) + at_end, path.motion.size - 1)
    rows = zip(
        analysis.turning_points,
        places,
        reach,
        lines.tolist(),
        shifted,
        path.motion[after].tolist(),
        slight,
        strict=True,
    )
    for point, place, near, line, (carried, coarse), behind, little in rows:
        edit = done.get(place) or _near(done, path, point, near)
        yield ProgramReversal(
            path=path,
            analysis=analysis,
            point=point,
            window=windows.get(point.index),
            line=line,
            cut=bool(found.before.motions.kind[behind] != RAPID),
            slight=little,
            coarse=coarse,
            strategy=TAKE_UP if carried else edit.strategy,
            profile=edit.profile,
            crossings=edit.crossings,
        )


def _at_end(motions: Motions, analysis: Analysis, places: Sequence[Place], slight: Sequence[bool]) -> BoolArray:
    """Mask of the turning points (n,) at the ends of their motions.

    But for `slight` ones the motion may go on by no more than the tolerance.
    """
    position = np.array([point.position for point in analysis.turning_points])
    motion = np.array([number for _, number, _ in places], dtype=np.int64)
    column = np.array([AXES.index(name) for name, *_ in places], dtype=np.int64)
    share = np.array([part for *_, part in places], dtype=np.int64)
    near = np.abs(motions.end[motion, column] - position) <= analysis.tolerance
    # An axis may have come to there before.
    return np.asarray((share == MILLION) | (near & (2 * share > MILLION) & ~np.array(slight, dtype=np.bool_)))


def _slight(analysis: Analysis, motions: Motions, motion: IntArray) -> list[bool]:
    """Say of the turning points of a path where the axis goes there and back by no more than the tolerance.

    They belong to motions (n,): straight ones go no farther than their ends, as the curve through those may.
    """
    track, points = analysis.track, analysis.turning_points
    s = np.array([0.0, *(point.s for point in points), track.length])
    places = track.derivatives(*track.locate(s))[0]
    found = [True] * len(points)
    straight = motions.kind[motion] == LINE
    for column, name in enumerate(analysis.path.axes):
        own = [number for number, point in enumerate(points) if point.axis == name]
        ends = np.sort([one[motion, AXES.index(name)] for one in (motions.start, motions.end)], axis=0)
        inside = places[1:-1, column]
        places[1:-1, column] = np.where(straight & ~np.isnan(ends[1]), np.clip(inside, *ends), inside)
        rows = [0, *(number + 1 for number in own), s.size - 1]
        for kept in zigzag(places[rows, column], analysis.tolerance)[0][1:].tolist():
            found[own[kept - 1]] = False
    return found


def _near(done: Mapping[Place, ReversalEdit], path: ProgramPath, point: TurningPoint, reach: float) -> ReversalEdit:
    """Return what is done nearest to a turning point, within its reach [m]."""
    nothing = ReversalEdit()
    own = [place for place in done if place[0] == point.axis] if reach > 0.0 else []
    if not own:
        return nothing
    at = path.to_path(np.array([motion for _, motion, _ in own]), np.array([share for *_, share in own]) / MILLION)
    nearest = int(np.argmin(np.abs(at - point.s)))
    return done[own[nearest]] if abs(at[nearest] - point.s) <= reach else nothing


def _shifted(
    changes: _Changes | None,
    motions: Motions,
    path: ProgramPath,
    analysis: Analysis,
    places: Sequence[Place],
    reach: Array,
    at_end: BoolArray,
    slight: Sequence[bool],
) -> list[tuple[bool, bool]]:
    """Say of turning points whether the lasting offset of the axis that turns changes there, and whether coarsely.

    Where the axis rests, the change may be anywhere in the rest, at whose end the turning point is listed. So it may
    where the axis goes on from its rest by no more than the tolerance before it turns, as a curve through the ends of
    straight moves does, and where it is no farther than that from its turn, as in a rest behind the extreme of an arc;
    but not for what is `slight`, beside which another reversal has the change.
    """
    points = analysis.turning_points
    if changes is None or not points:
        return [(False, False)] * len(points)
    own = slice(*np.searchsorted(changes.motion[:, 0], (path.motion[0], path.motion[-1] + 1)).tolist())
    begin_at, end_at = (path.to_path(changes.motion[own, k], changes.share[own, k]) for k in (0, 1))
    column = changes.column[own]
    begins, ends_at = (
        _places_in(motions, path, analysis, changes.motion[own, k], changes.share[own, k]) for k in (0, 1)
    )
    since, until = _between(points, slight)
    left_off: dict[str, dict[int, int]] = {}
    for name in changes.axes:
        asked = {place[1] - back for place in places if place[0] == name for back in (0, 1)}
        left_off[name] = _left_off(motions, path, AXES.index(name), asked)
    found = []
    count = motions.kind.size
    ways = _ways_behind(points, slight, analysis.track.length)
    rows = zip(points, places, reach, at_end.tolist(), slight, since, until, ways, strict=True)
    for point, (name, motion, _), near, ends, little, before, after, way in rows:
        if name not in changes.axes:
            found.append((False, False))
            continue
        axis, begin, low = AXES.index(name), motion, point.s
        dwells = point.kind == "dwell"
        near_start = abs(motions.start[motion, axis] - point.position) <= analysis.tolerance
        rest = motion if dwells else motion - 1
        if dwells or (near_start and rest in left_off[name]):
            begin = left_off[name][rest]
            low = float(path.to_path(np.array([begin]), np.ones(1))[0])
        stops = (column == axis) & (end_at > low - near - PASSED) & (begin_at < point.s + near + PASSED)
        about = slice(*np.searchsorted(begin_at, (before, after)).tolist())
        position, k = _within(motions, motion, axis, point.position), analysis.path.axes.index(name)
        stands = np.where(begin_at[about] < point.s, ends_at[about, k], begins[about, k])
        beside = (column[about] == axis) & (np.abs(stands - position) <= analysis.tolerance)
        stops = np.append(stops, beside & (not little))
        square = np.append(changes.square[own], changes.square[own][about])[stops].max(initial=0.0)
        leaves = motion + (2 if ends else 1)
        # A rapid that takes the axis away takes up its backlash on the way, as a plunge behind a rapid does in the air.
        while leaves < count and not little and abs(motions.end[leaves - 1, axis] - position) <= analysis.tolerance:
            leaves += 1
        away = motions.kind[min(leaves, count) - 1] == RAPID or (ends and motions.kind[motion] == RAPID)
        shifted = bool(away or stops.any() or changes.carried[begin + 1 : leaves, axis].any())
        found.append((shifted, leaves_much(float(square), way, changes.amplitude.get(name, 0.0))))
    return found


def _between(points: Sequence[TurningPoint], slight: Sequence[bool]) -> tuple[list[float], list[float]]:
    """Arc lengths [m] of the turning points of an axis before and behind each, those that are `slight` left out."""
    found = []
    for numbers, end in ((range(len(points)), -math.inf), (range(len(points) - 1, -1, -1), math.inf)):
        beside, last = [end] * len(points), dict.fromkeys(AXES, end)
        for number in numbers:
            beside[number] = last[points[number].axis]
            if not slight[number]:
                last[points[number].axis] = points[number].s
        found.append(beside)
    return found[0], found[1]


def _ways_behind(points: Sequence[TurningPoint], slight: Sequence[bool], length: float) -> list[float]:
    """Ways [m] behind the turning points of a path up to the next place at which an axis turns, `slight` ones apart."""
    s = np.array([point.s for point in points])
    ends = np.append(np.unique(s[~np.array(slight, dtype=np.bool_)]), length)
    behind = np.minimum(np.searchsorted(ends, s, side="right"), ends.size - 1)
    return np.maximum(ends[behind] - s, 0.0).tolist()  # type: ignore[no-any-return]


def _within(motions: Motions, motion: int, axis: int, position: float) -> float:
    """Return a position of an axis in a motion: a straight one goes no farther than its ends, as a curve may."""
    if motions.kind[motion] != LINE:
        return position
    low, high = sorted((float(motions.start[motion, axis]), float(motions.end[motion, axis])))
    return min(max(position, low), high)


def _places_in(motions: Motions, path: ProgramPath, analysis: Analysis, motion: IntArray, share: Array) -> Array:
    """Return where the axes of a path are (n, dim) at shares (n,) of motions: straight ones go straight."""
    columns = [AXES.index(name) for name in analysis.path.axes]
    start, end = (place[motion][:, columns] for place in (motions.start, motions.end))
    track = analysis.track
    curved = track.derivatives(*track.locate(path.to_path(motion, share)))[0]
    straight = (motions.kind[motion] == LINE)[:, None]
    return np.asarray(np.where(straight, start + share[:, None] * (end - start), curved))


def _left_off(motions: Motions, path: ProgramPath, column: int, asked: Collection[int]) -> dict[int, int]:
    """Tell of some motions, those of a path, which was the last up to there that moved an axis; maybe itself."""
    moving = np.empty(path.motion.size, dtype=np.bool_)
    for part in in_parts(moving.size):
        rows = path.motion[part]
        moving[part] = np.abs(motions.end[rows, column] - motions.start[rows, column]) > STILL
    moves = np.flatnonzero(moving)
    own = np.unique(np.array([*asked], dtype=path.motion.dtype))
    row = np.minimum(np.searchsorted(path.motion, own), path.motion.size - 1)
    own, row = own[path.motion[row] == own], row[path.motion[row] == own]
    last = np.searchsorted(moves, row, side="right") - 1
    found = path.motion[np.where(last >= 0, moves[last], 0)] if moves.size else np.full(own.size, path.motion[0])
    return dict(zip(own.tolist(), found.tolist(), strict=True))
