"""Motions to be drawn: executed path, error and feed, of planned paths and of part programs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import PurePath
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.analysis.path_analysis import Analysis
from ph_post.api.compensated_program import CompensatedProgram
from ph_post.api.further_axes import ShiftedJob
from ph_post.api.path_compensation import PathCompensation
from ph_post.api.results import PlannedMotion, ProgramMotion
from ph_post.api.reversals import ProgramReversal
from ph_post.bounds import check_places
from ph_post.compensate.comparison import strategy_at, window_number
from ph_post.compensate.motion import without_strategy
from ph_post.edit.cutter_contours import CutterContours
from ph_post.geometry.track import Track
from ph_post.progress import Progress, no_progress
from ph_post.report.programs import window_views
from ph_post.report.result_line import ResultSummary, summarize, summarize_program
from ph_post.report.views import View, turning_point_views, windows_by_point
from ph_post.simulate.contour import ContourError, Nominal, TurningError, turning_errors
from ph_post.simulate.controllers.cut_path import CutPath
from ph_post.simulate.controllers.deviation import cut_error
from ph_post.simulate.controllers.unknown import unknown_lines, unknown_motions
from ph_post.types import Array, BoolArray, Command, IntArray, Machine, Plan, Run, Scenario, TurningPoint
from ph_post.units import MM

Points = Callable[[Array], Array]
"""Points of a path (n, dimension) [m] at places along it (n,) [m]."""

SAME: Final = 1e-9
"""Commands that are no farther apart [m] are the same."""

CHORDS: Final = 64
"""Points that a piece of a path, or a full turn of a program, is drawn with at least."""


class DrawnMotion(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One motion along the path, a row a servo period, SI units.

    `s` (n,) is the place along the path that is commanded, `foot` (n, dimension) the point of the path next
    to the table, `away` (n, dimension) from there to the table, `error` (n,) its length, in a plane positive
    to the left. `counted` (n,) marks the rows whose error counts; `line` (n,) those of the program, None of a
    path. `turning` has one entry a turning point.
    """

    name: str
    t: Array
    s: Array
    feed: Array
    foot: Array
    away: Array
    error: Array
    counted: BoolArray
    size: ContourError | None
    worst: ContourError | None
    worst_scenario: Scenario | None
    run: Run
    turning: tuple[TurningError | None, ...]
    line: IntArray | None = None

    @property
    def time(self) -> float:
        """Cycle time [s]."""
        return float(self.t[-1]) if self.t.size else 0.0


class Mark(msgspec.Struct, frozen=True, kw_only=True):
    """A turning point: its place along the path [m], the window there [m], and its entry on the page.

    `view` is its entry in ``inspect --json`` with `strategy`, and of a program `line`; `point` [m].
    """

    s: float
    window: tuple[float, float] | None
    view: View
    point: tuple[float, ...]


class Picture(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What a page shows of a path or a program: its shape, what turns where, and how it is run.

    `traces` are the plain motion and, where there is another, the compensated one; `summary` is the line of the
    result.
    """

    name: str
    kind: str
    axes: tuple[str, ...]
    length: float
    closed: bool
    points: Points
    joints: Array
    marks: tuple[Mark, ...]
    traces: tuple[DrawnMotion, ...]
    machine: Machine
    strategy: str
    warnings: tuple[str, ...]
    summary: ResultSummary
    rapids: tuple[tuple[float, float], ...] = ()
    unknown: tuple[tuple[float, float], ...] = ()
    notes: tuple[str, ...] = ()

    def known(self, s: Array) -> BoolArray:
        """Return whether places along the path (n,) [m] are drawn."""
        ends = np.array(self.unknown).ravel()  # ascending, the begin and the end of each
        return np.asarray(np.searchsorted(ends, s, side="right") % 2 == 0)

    @property
    def windows(self) -> list[tuple[float, float]]:
        """The windows of all turning points that have one: first and last place along the path [m]."""
        return [mark.window for mark in self.marks if mark.window is not None]

    @property
    def windowed(self) -> bool:
        """Return whether windows say anything here: where a feed dips in one, or backlash lies inside a loop."""
        loops = {name: axis.loop.encloses_backlash for name, axis in self.machine.axes.items()}
        return any(loops[mark.view["axis"]] or mark.view["ratio"] is not None for mark in self.marks)

    def inside(self, s: Array) -> BoolArray:
        """Return whether places along the path (n,) [m] lie in a window."""
        found = np.zeros(s.size, dtype=bool)
        order = np.argsort(s, kind="stable")
        for window in self.windows:
            low, high = np.searchsorted(s, window, sorter=order)
            found[order[low:high]] = True
        return found


def path_picture(result: PathCompensation) -> Picture:
    """Gather the original and the compensated motion of a path."""
    crossed = result.crossed_for(result.output)
    if crossed is not None:
        strategy = result.options.chosen_strategy
        made = program_picture(crossed.edited, crossed.machine, strategy, crossed.reversals)
        return replace(made, warnings=crossed.warnings, summary=summarize(result))
    analysis, plan, after = result.analysis, result.plan(result.output), result.planned(result.output)
    track, before = analysis.track, PlannedMotion(analysis, without_strategy(plan))
    nominal = Nominal(track)
    named = [("original", before), *([] if _alike(before.command, after.command) else [("compensated", after)])]
    return Picture(
        name=analysis.path.name,
        kind="path",
        axes=analysis.path.axes,
        length=track.length,
        closed=track.closed,
        points=nominal.places,
        joints=_path_joints(track),
        marks=_path_marks(analysis, plan, nominal),
        traces=tuple(_path_trace(name, motion, nominal) for name, motion in named),
        machine=plan.machine,
        strategy=plan.strategy,
        warnings=plan.warnings,
        summary=summarize(result),
        rapids=_rapid_segments(analysis),
    )


def _alike(one: Command, other: Command) -> bool:
    """Return whether two motions are the same in every sample, but for rounding."""
    a, b = one.position, other.position
    return a.shape == b.shape and bool((np.abs(a - b) < SAME).all())


def _path_trace(name: str, motion: PlannedMotion, nominal: Nominal) -> DrawnMotion:
    command, found = motion.command, motion.assessment
    foot = nominal.places(found.nearest.s)
    return DrawnMotion(
        name=name,
        t=command.t,
        s=command.s,
        feed=command.feed,
        foot=foot,
        away=found.run.executed - foot,
        error=found.nearest.error,
        counted=np.arange(command.t.size) >= found.first,
        size=found.error,
        worst=found.error_worst,
        worst_scenario=found.worst,
        run=found.run,
        turning=found.turning,
    )


def _path_marks(analysis: Analysis, plan: Plan, nominal: Nominal) -> tuple[Mark, ...]:
    windows = windows_by_point(analysis.windows)
    marks = []
    places = nominal.places(np.array([point.s for point in analysis.turning_points]))
    views = turning_point_views(analysis)
    for view, point, place in zip(views, analysis.turning_points, places.tolist(), strict=True):
        window, number = windows.get(point.index), window_number(plan, point)
        profile = None if number is None else plan.profiles[number]
        entry = {
            **view,
            "strategy": strategy_at(plan, point),
            "ratio": None if profile is None else profile.ratio,
            "notes": () if profile is None else profile.notes,
        }
        span = None if window is None else (window.s - window.half_length, window.s + window.half_length)
        marks.append(Mark(s=point.s, window=span, view=entry, point=tuple(place)))
    return tuple(marks)


def _path_joints(track: Track) -> Array:
    """Return the places [m] between which a path is drawn with straight lines."""
    share = np.arange(CHORDS) / CHORDS
    lengths = np.diff(track.starts)
    return np.append((track.starts[:-1, None] + lengths[:, None] * share).ravel(), track.length)


def _rapid_segments(analysis: Analysis) -> tuple[tuple[float, float], ...]:
    """Stretches of a path that are run in rapid [m]."""
    track = analysis.track
    return tuple(
        (float(track.starts[k]), float(track.starts[k + 1]))
        for k, number in enumerate(track.segment.tolist())
        if analysis.path.segments[number].rapid
    )


def program_picture(
    delivery: CompensatedProgram,
    machine: Machine,
    strategy: str,
    turns: Sequence[ProgramReversal],
    progress: Progress = no_progress,
    shifted: ShiftedJob | None = None,
) -> Picture:
    """Run a program as it was and as compensated on the models of controller and drives.

    `turns` are its reversals, and `shifted` has what was compensated before X, Y and Z.
    """
    original = delivery.before
    before, after = delivery.run_on(machine, progress)
    path = before.cut.path
    places = [_places_of(one, path) for one in turns]
    points = [replace(one.point, s=s, index=k) for k, (one, (s, *_)) in enumerate(zip(turns, places, strict=True))]
    both = [("original", before)]
    if delivery.after.data != original.data:
        both.append(("compensated", after))
    traces = [_program_trace(name, motion, path, points) for name, motion in both]
    axes = traces[0].run.axes
    at = path.points(np.array([point.s for point in points]), axes).tolist()
    marks = tuple(
        _program_mark(*one, delivery.done)
        for one in zip(turns, window_views(turns), places, map(tuple, at), strict=True)
    )
    rapid = np.flatnonzero(path.legs.rapid == 1.0)
    unknown = np.flatnonzero(unknown_motions(original)[path.legs.motion.astype(np.int64)])
    return Picture(
        name=PurePath(original.name).name,
        kind="program",
        axes=axes,
        closed=False,
        length=float(path.starts[-1]),
        points=lambda s: path.points(s, axes),
        joints=_joints(path, original.name),
        marks=marks,
        traces=tuple(traces),
        machine=machine,
        strategy=strategy,
        warnings=(*(() if shifted is None else shifted.warnings), *delivery.warnings),
        summary=summarize_program(delivery, both[0][1], both[-1][1], turns, shifted),
        rapids=tuple((float(path.starts[k]), float(path.starts[k + 1])) for k in rapid.tolist()),
        unknown=tuple((float(path.starts[k]), float(path.starts[k + 1])) for k in unknown.tolist()),
        notes=(
            *(["G92 or the like moves the zero: places are those from the first one"] if path.renames else []),
            *(
                f"{original.line_words(*lines)}: where the axes are is not known; nothing is drawn, and no"
                " number is given"
                for lines in unknown_lines(original)
            ),
            *(
                f"{lines}: the contour is drawn; the tool goes beside it by its radius"
                for lines in CutterContours(original).lines()
            ),
        ),
    )


def _places_of(turn: ProgramReversal, path: CutPath) -> tuple[float, float, float]:
    """Place a turning point on the program, and the ends of its window, if it has one [m]."""
    window = turn.window
    reach = 0.0 if window is None else window.half_length
    middle = turn.point.s if window is None else window.s
    wanted = np.array([turn.point.s, middle - reach, middle + reach])
    s, low, high = path.place_of(*turn.path.to_motions(wanted)).tolist()
    return s, low, high


def _program_mark(
    turn: ProgramReversal, view: View, places: tuple[float, float, float], point: tuple[float, ...], done: bool
) -> Mark:
    """Describe a reversal; of a program compensated before nobody knows what was done where."""
    s, low, high = places
    profile = view["profile"]
    entry = {
        **view,
        "s": s / MM,
        "ratio": None if profile is None else profile["ratio"],
        "notes": _little_done(turn) if profile is None else profile["notes"],
        **({"strategy": "compensated before"} if done else {}),
    }
    return Mark(s=s, window=None if turn.window is None else (low, high), view=entry, point=point)


def _little_done(turn: ProgramReversal) -> tuple[str, ...]:
    if turn.coarse:
        return ("crossed so coarsely that more than a fifth of the error is left",)
    return ("too small to count: there and back within the tolerance",) if turn.slight and not turn.compensated else ()


def _program_trace(name: str, motion: ProgramMotion, path: CutPath, points: Sequence[TurningPoint]) -> DrawnMotion:
    command = motion.command
    found = motion.assessment or cut_error(motion.cut)
    _, place = path.closest_points(found.run, found.place)
    foot = path.points(place, found.run.axes)
    rows = found.counted
    return DrawnMotion(
        name=name,
        t=command.t,
        s=found.place,
        feed=command.feed,
        foot=foot,
        away=found.run.executed - foot,
        error=found.distance,
        counted=rows,
        size=found.error,
        worst=found.error_worst,
        worst_scenario=found.worst,
        run=found.run,
        turning=turning_errors(found.distance[rows], found.place[rows], points),
        line=motion.original.line_numbers(found.motion),
    )


def _joints(path: CutPath, name: str) -> Array:
    """Places between which a program is drawn with straight lines: ends of legs, and points on arcs."""
    turns = np.abs(path.legs.sweep) / (2.0 * np.pi)
    parts = np.where(path.legs.radius > 0.0, np.ceil(CHORDS * turns), 1.0).astype(np.int64)
    check_places(name, "the path has too many turns to be drawn", float(parts.sum()), "fewer turns")
    leg = np.repeat(np.arange(parts.size), parts)
    share = (np.arange(leg.size) - (np.cumsum(parts) - parts)[leg]) / parts[leg]
    return np.append(path.starts[leg] + share * path.legs.length[leg], path.starts[-1])
