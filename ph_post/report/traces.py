"""A motion as it is drawn: where the table is, how far off the path, at what feed; and what turns where.

There is one form of it, whether it was planned along a path or read from a program.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.analysis import Analysis
from ph_post.compensate.comparison import plain
from ph_post.compensate.offsets import command_of
from ph_post.geometry.track import Track
from ph_post.report.views import View, strategy_at, turning_point_views, window_number, windows_by_point
from ph_post.simulate.assess import assess
from ph_post.simulate.contour import ContourError, Nominal, TurningError
from ph_post.types import Array, BoolArray, Command, IntArray, Machine, Plan, Run, Scenario

Points = Callable[[Array], Array]
"""Points of a path (n, dimension) [m] at places along it (n,) [m]."""

SAME: Final = 1e-9
"""Commands that are no farther apart [m] are the same."""

CHORDS: Final = 64
"""Points that a piece of a path, or a full turn of a program, is drawn with at least."""


class Trace(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One motion along the path, a row a servo period, SI units.

    `s` (n,) is the place along the path that is commanded, `foot` (n, dimension) the point of the path next
    to the table, `away` (n, dimension) from there to the table, `error` (n,) its length, in a plane positive
    to the left. `counted` (n,) tells the rows whose error counts; `line` (n,) those of the program, None of a
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
    """A turning point: its place along the path [m], the window there [m], and what is told of it.

    `view` is its entry in ``inspect --json`` with `strategy`, and of a program `line`; `point` [m].
    """

    s: float
    window: tuple[float, float] | None
    view: View
    point: tuple[float, ...]


class Picture(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What a page shows of a path or a program: its shape, what turns where, and how it is run.

    `traces` are the plain motion and, where there is another, the compensated one.
    """

    name: str
    kind: str
    axes: tuple[str, ...]
    length: float
    closed: bool
    points: Points
    joints: Array
    marks: tuple[Mark, ...]
    traces: tuple[Trace, ...]
    machine: Machine
    strategy: str
    warnings: tuple[str, ...]
    rapids: tuple[tuple[float, float], ...] = ()

    @property
    def windows(self) -> list[tuple[float, float]]:
        """The windows of all turning points that have one: first and last place along the path [m]."""
        return [mark.window for mark in self.marks if mark.window is not None]

    def inside(self, s: Array) -> BoolArray:
        """Whether places along the path (n,) [m] lie in a window."""
        found = np.zeros(s.size, dtype=bool)
        order = np.argsort(s, kind="stable")
        for window in self.windows:
            low, high = np.searchsorted(s, window, sorter=order)
            found[order[low:high]] = True
        return found


def path_picture(analysis: Analysis, plan: Plan, warnings: Sequence[str] = ()) -> Picture:
    """Run a path as it is and as planned, and gather what is to be seen."""
    track, period = analysis.track, plan.machine.servo_period
    nominal = Nominal(track)
    before, after = (command_of(one, track, period) for one in (plain(plan), plan))
    named = [("as it is", before), *([] if _alike(before, after) else [("compensated", after)])]
    traces = [_path_trace(name, command, analysis, plan.machine, nominal) for name, command in named]
    return Picture(
        name=analysis.path.name, kind="path", axes=analysis.path.axes, length=track.length,
        closed=track.closed, points=nominal.places, joints=_path_joints(track),
        marks=_path_marks(analysis, plan, nominal), traces=tuple(traces), machine=plan.machine,
        strategy=plan.strategy, warnings=(*plan.warnings, *warnings), rapids=_rapid_segments(analysis),
    )  # fmt: skip


def _alike(one: Command, other: Command) -> bool:
    """Whether two motions are the same in every sample, but for rounding."""
    a, b = one.position, other.position
    return a.shape == b.shape and bool((np.abs(a - b) < SAME).all())


def _path_trace(name: str, command: Command, analysis: Analysis, machine: Machine, nominal: Nominal) -> Trace:
    found = assess(command, machine, nominal, analysis.turning_points)
    foot = nominal.places(found.nearest.s)
    return Trace(
        name=name, t=command.t, s=command.s, feed=command.feed, foot=foot, away=found.run.executed - foot,
        error=found.nearest.error, counted=np.arange(command.t.size) >= found.first, size=found.error,
        worst=found.error_worst, worst_scenario=found.worst, run=found.run, turning=found.turning,
    )  # fmt: skip


def _path_marks(analysis: Analysis, plan: Plan, nominal: Nominal) -> tuple[Mark, ...]:
    windows = windows_by_point(analysis.windows)
    marks = []
    places = nominal.places(np.array([point.s for point in analysis.turning_points]))
    views = turning_point_views(analysis)
    for view, point, place in zip(views, analysis.turning_points, places.tolist(), strict=True):
        window, number = windows.get(point.index), window_number(plan, point)
        profile = None if number is None else plan.profiles[number]
        told = {
            **view, "strategy": strategy_at(plan, point),
            "ratio": None if profile is None else profile.ratio,
            "notes": () if profile is None else profile.notes,
        }  # fmt: skip
        span = None if window is None else (window.s - window.half_length, window.s + window.half_length)
        marks.append(Mark(s=point.s, window=span, view=told, point=tuple(place)))
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
