"""Corners of one angle, one behind the other, run four ways: times and distances from the drawn path.

Nothing here shares code with the project but the reading of the machine, what it writes, and LinuxCNC's start.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

import ph_post as ph
from ph_post.geometry.curves import Line
from ph_post.geometry.track import Track
from ph_post.rehearse.linuxcnc import run_on_linuxcnc
from ph_post.types import Limits, Machine, Path

Floats = NDArray[np.float64]

SIDE = 15.0
"""Length of the sides [mm]."""

COUNT = 3
"""Corners of a path."""

ACCELERATION, JERK = 1000.0, 50_000.0
"""Limits of both axes [mm/s²], [mm/s³]; LinuxCNC knows the first alone."""


NEAR = 5e-4
"""Distance within which a motion is at a place [mm]."""


class CornerRun(NamedTuple):
    """Time that a corner takes more than as long a straight line [ms]; distances [µm].

    `off` is the largest distance of the motion from the drawn path, `passed` that of the corners from the motion.
    """

    lost: float
    off: float
    passed: float


def machine() -> Machine:
    """Two axes without backlash and lag, on LinuxCNC."""
    found = ph.read_machine("stepper")
    limits = Limits(velocity=0.1, acceleration=1e-3 * ACCELERATION, jerk=1e-3 * JERK)
    axes = {
        name: replace(axis, feedback="none", gap=axis.gap.with_lost_motion(0.0), limits=limits, effects=())
        for name, axis in found.axes.items()
    }
    return replace(found, axes=axes, dialect="linuxcnc", servo_period=1e-3)


def vertices(angle: float) -> Floats:
    """Ends of the sides [mm]: the path turns to the left and to the right, and is straight where `angle` [°] is 0."""
    headings = 0.3 + math.radians(angle) * (np.arange(COUNT + 1) % 2)
    steps = SIDE * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    return np.round(np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)]), 4)


def path_of(angle: float, feed: float) -> Path:
    """Path with the corners, at a feed [mm/min]."""
    points = 1e-3 * vertices(angle)
    sides = [Line(np.stack(pair)) for pair in pairwise(points)]
    if angle == 0.0:
        sides = [Line(points[[0, -1]])]
    return replace(Track.from_curves(sides).path, feed=feed / 60_000.0, name="corners")


def drawn_program(angle: float, feed: float, mode: str) -> bytes:
    """Program of the same lines, in a path mode such as ``G64 P0.02``."""
    points = vertices(angle)
    moves = [f"G1 X{x:.4f} Y{y:.4f}" for x, y in (points[1:] if angle else points[-1:]).tolist()]
    return "\n".join([f"G21 G90 G17 {mode}", f"F{feed:g}", *moves, "M2", ""]).encode()


def planned_program(angle: float, feed: float, within: float | None) -> bytes:
    """Program of the path as it is converted, corners rounded within so many mm where given."""
    tolerance = None if within is None else 1e-3 * within
    return ph.compensate(path_of(angle, feed), machine(), strategy="none", corner_tolerance=tolerance).program()


def planned_rows(angle: float, feed: float, within: float | None) -> Floats:
    """Places [mm] of the interpolator table that is made of the path."""
    tolerance = None if within is None else 1e-3 * within
    made = ph.compensate(
        path_of(angle, feed), machine(), output="table", strategy="none", corner_tolerance=tolerance
    ).table()
    return 1e3 * np.asarray(made.position)


def run(program: bytes) -> Floats:
    """Places [mm] that a real LinuxCNC commands, one a servo period."""
    return 1e3 * np.asarray(run_on_linuxcnc(program, "corners", machine()).position[:, :2])


def duration(rows: Floats, angle: float) -> float:
    """Time from leaving the beginning to reaching the end [s]."""
    points = vertices(angle)
    return 1e-3 * float(np.argmax(np.linalg.norm(_inside(rows, points) - points[-1], axis=1) < NEAR))


def judged(rows: Floats, straight: Floats, angle: float) -> CornerRun:
    """Compare a motion with the drawn path, and its time with that along a straight line of the same length."""
    points = vertices(angle)
    lost = duration(rows, angle) - duration(straight, 0.0)
    return CornerRun(
        1e3 * lost / COUNT, 1e3 * from_polyline(_inside(rows, points), points).max(), 1e3 * _passed(rows, points)
    )


def _inside(rows: Floats, points: Floats) -> Floats:
    """Rows from the beginning of the path on, behind the approach to it."""
    first = np.flatnonzero(np.linalg.norm(rows - points[0], axis=1) < NEAR)[-1]
    return rows[first:]


def _passed(rows: Floats, points: Floats) -> float:
    return float(from_polyline(points[1:-1], _inside(rows, points)).max())


def from_polyline(places: Floats, line: Floats) -> Floats:
    """Distances of places from a polyline."""
    best = np.full(len(places), np.inf)
    for start, end in pairwise(line):
        chord = end - start
        square = max(float(chord @ chord), 1e-30)
        along = np.clip((places - start) @ chord / square, 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(places - start - along[:, None] * chord, axis=1))
    return best


def rates(rows: Floats) -> Sequence[float]:
    """Largest acceleration [mm/s²] and jerk [mm/s³] of an axis, as differences of samples."""
    return [float(np.abs(np.diff(rows, order, axis=0)).max()) * 1e3**order for order in (2, 3)]
