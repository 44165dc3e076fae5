"""Cuts for a real LinuxCNC, one after the other in a program, and how far a table behind its motors is from each.

Nothing here shares code with the project: shapes, lag, play, and distances are the tests' own.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace
from numba import njit
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter

from ph_post.drive.machinefile import read_machine
from ph_post.types import Machine
from support.ideal_play import distances

Floats = NDArray[np.float64]

PERIOD = 1e-3
"""Servo period [s]."""

STEP = 0.004
"""Distance of the points of a path between which it counts as straight [mm]."""


class Cut(NamedTuple):
    """A path at Z0: its shape, feed [mm/min], turn to the left or not, radius of circles [mm]."""

    shape: str
    feed: float
    left: bool = True
    radius: float = 0.0


class Measured(NamedTuple):
    """Largest and rms distance from the path [µm], from all initial sides of the backlash, and the time [s]."""

    largest: float
    rms: float
    time: float


def program(cuts: Sequence[Cut], within: float = 0.002) -> bytes:
    """Write the cuts as a program, corners rounded by `within` [mm] at most."""
    lines = [f"G21 G90 G17 G64 P{within}"]
    for cut in cuts:
        points, moves = _moves(cut)
        lines += [f"G0 X{points[0]:.4f} Y{points[1]:.4f} Z5", f"G1 Z0 F{cut.feed:g}", *moves, "G0 Z5"]
    return "\n".join([*lines, "M2", ""]).encode()


def stopping(cut: Cut, lost: float, within: float = 0.002) -> bytes:
    """Write a circle with a dwell and a move of one axis at each reversal, as a shop does by hand."""
    r, turn = cut.radius, 1 if cut.left else -1
    start = 0.25 * math.pi
    at = [start, *(turn * 0.5 * math.pi * k + (0.0 if turn > 0 else 0.5 * math.pi) for k in range(1, 5))]
    ends = [*at[1:], start + turn * 2.0 * math.pi]

    def offset(angle: float) -> tuple[float, float]:
        return (
            math.copysign(0.5 * lost, -turn * math.sin(angle)),
            math.copysign(0.5 * lost, turn * math.cos(angle)),
        )

    x, y = offset(start + 0.01 * turn)
    near = [r * math.cos(start) + x - 4.0 * x, r * math.sin(start) + y - 4.0 * y]
    lines = [f"G21 G90 G17 G64 P{within}", f"G0 X{near[0]:.6f} Y{near[1]:.6f} Z5"]
    lines += [f"G1 X{near[0] + 4.0 * x:.6f} Y{near[1] + 4.0 * y:.6f} F300", f"G1 Z0 F{cut.feed:g}"]
    for begin, end in zip(at, ends, strict=True):
        new = offset(0.5 * (begin + end))
        if begin != start:
            place = [r * f(begin) + one for f, one in zip((math.cos, math.sin), new, strict=True)]
            lines += ["G4 P0.02", f"G1 X{place[0]:.6f} Y{place[1]:.6f} F300", "G4 P0.02"]
        to = [r * f(end) + one for f, one in zip((math.cos, math.sin), new, strict=True)]
        back = [-r * f(begin) for f in (math.cos, math.sin)]
        word = "G3" if cut.left else "G2"
        lines.append(f"{word} X{to[0]:.6f} Y{to[1]:.6f} I{back[0]:.6f} J{back[1]:.6f} F{cut.feed:g}")
    return "\n".join([*lines, "G0 Z5", "M2", ""]).encode()


def _moves(cut: Cut) -> tuple[tuple[float, float], list[str]]:
    """Return where a cut begins, and its lines."""
    if cut.shape == "circle":
        # Not on a reversal.
        at = cut.radius * math.sqrt(0.5)
        word = "G3" if cut.left else "G2"
        return (at, at), [f"{word} X{at:.4f} Y{at:.4f} I{-at:.6f} J{-at:.6f}"]
    if cut.shape == "pocket":
        return _pocket(cut.left)
    if cut.shape == "engraving":
        return _engraving(cut.left)
    points = _ellipse() if cut.shape == "ellipse" else _spline()
    points = points if cut.left else points[::-1]
    return (points[0][0], points[0][1]), [f"G1 X{x:.4f} Y{y:.4f}" for x, y in points[1:]]


def _pocket(left: bool) -> tuple[tuple[float, float], list[str]]:
    """Two rings with round corners, and one with sharp ones; mirrored to turn right."""
    word, side, lines = "G3" if left else "G2", 1.0 if left else -1.0, []
    for a, b, r in ((12.0, 8.0, 3.0), (9.0, 5.0, 1.5), (6.0, 2.5, 0.0)):
        corners = [(a, b), (-a, b), (-a, -b), (a, -b)]
        ways = [(0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 0.0)]
        lines.append(f"G1 X{a} Y0")
        for (x, y), way, turned in zip(corners, ways, ways[1:] + ways[:1], strict=True):
            lines.append(f"G1 X{x - r * way[0]:g} Y{side * (y - r * way[1]):g}")
            if r:
                i, j = r * turned[0], r * turned[1]
                lines.append(f"{word} X{x + i:g} Y{side * (y + j):g} I{i:g} J{side * j:g}")
        lines.append(f"G1 X{a} Y0")
    return (12.0, 0.0), lines[1:]


def _engraving(left: bool) -> tuple[tuple[float, float], list[str]]:
    """Sharp strokes, and bows of 0.9 to 2 mm."""
    word, other, side = ("G3", "G2", 1.0) if left else ("G2", "G3", -1.0)
    lines, x = [], 0.0
    for r in (2.0, 1.5, 0.9):
        y = [side * one for one in (4.0, 0.5, 3.0, 0.0)]
        lines += [f"G1 X{x + 0.4:g} Y{y[0]:g}", f"G1 X{x + 1.6:g} Y{y[1]:g}"]
        lines += [f"{word} X{x + 1.6 + 2 * r:g} Y{y[1]:g} I{r:g} J0", f"G1 X{x + 1.6 + 2 * r:g} Y{y[2]:g}"]
        lines += [f"{other} X{x + 1.6 + 4 * r:g} Y{y[2]:g} I{r:g} J0", f"G1 X{x + 2.2 + 4 * r:g} Y{y[3]:g}"]
        x += 2.2 + 4 * r
    return (0.0, 0.0), lines


def _ellipse(count: int = 720) -> list[tuple[float, float]]:
    t = 0.3 + math.tau * np.arange(count + 1) / count
    return [(20.0 * math.cos(one), 10.0 * math.sin(one)) for one in t.tolist()]


def _spline(count: int = 900) -> list[tuple[float, float]]:
    knots = [[0, 0], [14, 9], [22, -3], [33, 6], [30, 20], [16, 17], [8, 26], [-8, 20], [-3, 8], [0, 0]]
    curve = CubicSpline(np.arange(10.0), np.array(knots, dtype=float), bc_type="periodic")
    points = np.round(curve(0.4 + 9.0 * np.arange(count + 1) / count), 4)
    return [(x, y) for x, y in points.tolist()]


def _path(cut: Cut) -> Floats:
    """Points of a cut, :data:`STEP` apart [mm]."""
    (x, y), moves = _moves(cut)
    found = []
    for line in moves:
        word, values = line.split()[0], {one[0]: float(one[1:]) for one in line.split()[1:]}
        to = values["X"], values["Y"]
        if word == "G1":
            count = max(int(math.dist((x, y), to) / STEP), 1)
            share = np.arange(count + 1) / count
            found.append(np.stack([x + share * (to[0] - x), y + share * (to[1] - y)], axis=1))
        else:
            center = x + values["I"], y + values["J"]
            begin, end = (math.atan2(q - center[1], p - center[0]) for p, q in ((x, y), to))
            swept = (end - begin) % math.tau if word == "G3" else -((begin - end) % math.tau)
            swept = swept if abs(swept) > 1e-9 else math.copysign(math.tau, swept if word == "G3" else -1.0)
            radius = math.dist((x, y), center)
            angle = begin + swept * np.linspace(0.0, 1.0, max(int(radius * abs(swept) / STEP), 2))
            found.append(np.stack([center[0] + radius * np.cos(angle), center[1] + radius * np.sin(angle)], axis=1))
        x, y = to
    return np.concatenate(found)


def outline(seed: int) -> list[tuple[float, float]]:
    """Corners of a walk [mm] of short and long lines that turns by 20 to 90 degrees, as outlines of copper do."""
    drawn, corners, way = np.random.default_rng(seed), [(0.0, 0.0)], 0.0
    for _ in range(24):
        way += math.radians(drawn.choice([-90, -45, -20, 20, 45, 90]))
        length = drawn.choice([0.25, 0.4, 0.7, 2.0, 4.0])
        x, y = corners[-1]
        corners.append((round(x + length * math.cos(way), 3), round(y + length * math.sin(way), 3)))
    return corners


def bench(lost: float, push: float, lag: float) -> Machine:
    """The shipped stepper on LinuxCNC with lost motion [mm], acceleration [mm/s²] and a lag of its motors [s]."""
    found = read_machine("stepper")
    axes = {
        name: replace(
            axis,
            feedback="motor" if lag else "none",
            gap=axis.gap.with_lost_motion(lost * 1e-3),
            servo=replace(axis.servo, c=lag),
            limits=replace(axis.limits, velocity=0.1, acceleration=push * 1e-3),
        )
        for name, axis in found.axes.items()
    }
    return replace(found, axes=axes, dialect="linuxcnc", servo_period=1e-3)


@njit(cache=True)
def behind(motor: Floats, half: float, side: float) -> Floats:
    """Table behind a motor with backlash of so much to either side, from one side (-1, 1) of it."""
    found = np.empty_like(motor)
    table = motor[0] + side * half
    for row in range(motor.size):
        table = min(max(table, motor[row] - half), motor[row] + half)
        found[row] = table
    return found


def lagging(column: Floats, lag: float) -> Floats:
    """First-order lag, exact for a command that is straight between periods."""
    if lag == 0.0:
        return column
    a = math.exp(-PERIOD / lag)
    kept = 1.0 - lag * (1.0 - a) / PERIOD
    found = lfilter([kept, 1.0 - a - kept], [1.0, -a], column - column[0])
    return np.asarray(found + column[0])


def measure(rows: Floats, cuts: Sequence[Cut], lost: float, lag: float = 0.0) -> list[Measured]:
    """Measure a recording (n, 3) [m] of a program of some cuts, behind motors with a lag [s] and backlash [mm]."""
    down = rows[:, 2] < 0.5e-3
    down[: int(np.argmax(rows[:, 2] > 4.9e-3))] = False
    edges = np.flatnonzero(np.diff(down.astype(np.int64)))
    spans = [(first + 1, last + 1) for first, last in zip(edges[::2], edges[1::2], strict=True)]
    assert len(spans) == len(cuts)
    motors = [lagging(rows[:, axis], lag) * 1e3 for axis in range(2)]
    tables = [{side: behind(motor, 0.5 * lost, side) for side in (-1.0, 1.0)} for motor in motors]
    found = []
    for cut, (first, last) in zip(cuts, spans, strict=True):
        path, worst = _path(cut), (0.0, 0.0)
        for one, other in itertools.product((-1.0, 1.0), repeat=2):
            points = np.stack([tables[0][one][first:last], tables[1][other][first:last]], axis=1)
            away = 1e3 * distances(points, path)
            worst = max(worst[0], float(away.max())), max(worst[1], float(np.sqrt((away**2).mean())))
        found.append(Measured(*worst, float((last - first) * PERIOD)))
    return found
