"""Machines, paths and plans for the tests of the feed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ph_post.analysis.path_analysis import Analysis, analyse
from ph_post.compensate.violations import at_rest_before_and_after
from ph_post.geometry.curves import Arc, Bezier, Line, Polynomial
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.ph import PH, ph_hermite
from ph_post.types import Axis, Command, Gap, Limits, Machine, Path, Phase, Plan, Segment, Servo

MM = 1e-3


def make_machine(
    *, velocity: float = 0.5, acceleration: float = 5.0, jerk: float = 100.0, period: float = 1e-3, **axis
) -> Machine:
    """Three equal axes with scales and 0.02 mm of lost motion, unless `axis` says otherwise."""
    gap = Gap(
        lost_motion=20e-6,
        motor_angle=20e-6 / 0.8e-3,
        gear_ratio=1.0,
        travel_per_rad=0.8e-3,
        inertia_fraction=0.5,
        beta=5.0,
    )
    limits = Limits(velocity=velocity, acceleration=acceleration, jerk=jerk)
    given = {"feedback": "load", "servo": Servo(b=2e-4, c=0.02), "gap": gap, "limits": limits} | axis
    axes = {name: Axis(name=name, **given) for name in "XYZ"}
    return Machine(name="bench", dialect="linuxcnc", servo_period=period, axes=axes)


def make_path(
    curves: Sequence, feed: float = 0.02, closed: bool = False, rapid: Sequence[int] = (), feeds=None
) -> Path:
    """A path of curves; feed in m/s, `feeds` by segment number."""
    segments = tuple(
        Segment(curve=curve, rapid=number in rapid, feed=(feeds or {}).get(number))
        for number, curve in enumerate(curves)
    )
    axes = ("X", "Y", "Z")[: curves[0].dimension]
    return Path(name="part", source="a test", axes=axes, feed=feed, closed=closed, segments=segments)


def circle(radius: float, feed: float, closed: bool = True) -> Path:
    """A full circle about the origin from (radius, 0), counterclockwise."""
    start = np.array([radius, 0.0])
    return make_path([Arc(start, start, np.zeros(2), "ccw")], feed, closed)


def look(path: Path, machine: Machine, tolerance: float = 5e-6) -> Analysis:
    return analyse(path, machine, tolerance)


def worst_use(command: Command, machine: Machine) -> tuple[float, float, float]:
    """Largest |difference| over its limit for velocity, acceleration and jerk, with nothing allowed for."""
    still = command.feed[[0, -1]] == 0.0
    position = at_rest_before_and_after(command.position, bool(still[0]), bool(still[1]))
    worst = []
    for order, name in enumerate(("velocity", "acceleration", "jerk"), start=1):
        limit = np.array([getattr(machine.axes[axis].limits, name) for axis in command.axes])
        worst.append(float((np.abs(np.diff(position, order, axis=0)) / command.period**order / limit).max()))
    return worst[0], worst[1], worst[2]


def zigzag(count: int, seed: int, size: float = 0.02) -> list[PH]:
    """PH quintics to and fro through random places: no two reversals are alike, and some are near to each other."""
    rng, x, points = np.random.default_rng(seed), 0.0, []
    for k in range(count):
        points.append([x + rng.uniform(-0.3, 0.3) * size, k % 2 * size * rng.uniform(0.4, 1.4)])
        x += size * rng.uniform(0.1, 0.5)
    along = np.gradient(np.array(points), axis=0)
    return [ph_hermite(np.array(points[k : k + 2]), along[k : k + 2]) for k in range(count - 1)]


def assert_continuous(plan: Plan, length: float) -> None:
    """Phases follow each other from s = 0 to the end without a jump of place, speed or acceleration."""
    duration = np.array([phase.duration for phase in plan.phases])
    starts = np.array([phase.start for phase in plan.phases])
    s = np.array([phase.s for phase in plan.phases])
    mean = np.array([phase.speed.mean() for phase in plan.phases])
    assert (starts[0], s[0]) == (0.0, 0.0)
    # Each start is the sum of all durations before it.
    np.testing.assert_allclose(starts[1:], np.cumsum(duration)[:-1], rtol=1e-15 * len(starts))
    np.testing.assert_allclose(np.append(s[1:], length), s + duration * mean, rtol=0.0, atol=1e-12)
    ends = np.array([(phase.speed[0], phase.speed[-1]) for phase in plan.phases])
    np.testing.assert_allclose(ends[1:, 0], ends[:-1, 1], rtol=0.0, atol=1e-14)
    slopes = np.array([_end_slopes(phase) for phase in plan.phases])
    # A slope is n times a difference of speeds, right to an ulp of them each, over the duration.
    error = 64.0 * np.finfo(np.float64).eps * max(phase.speed.max() for phase in plan.phases) / duration
    assert np.all(np.abs(slopes[1:, 0] - slopes[:-1, 1]) <= 1e-9 * np.abs(slopes).max() + error[1:] + error[:-1])


def _end_slopes(phase: Phase) -> tuple[float, float]:
    v, n = phase.speed, phase.speed.size - 1
    return (0.0, 0.0) if n == 0 else (n * (v[1] - v[0]) / phase.duration, n * (v[-1] - v[-2]) / phase.duration)


def random_curves(rng: np.random.Generator, kind: str) -> list:
    """Short curves of many kinds; lengths between about 1 mm and 0.1 m."""
    size = 10.0 ** rng.uniform(-3.0, -1.0)
    dimension = 2 if rng.random() < 0.7 else 3
    match kind:
        case "bezier":
            return [Bezier(rng.uniform(-1.0, 1.0, (int(rng.integers(3, 9)), dimension)) * size)]
        case "nurbs":
            count = int(rng.integers(5, 9))
            knots = np.concatenate([[0.0] * 4, np.sort(rng.uniform(0.0, 1.0, count - 4)), [1.0] * 4])
            points = rng.uniform(-1.0, 1.0, (count, dimension)) * size
            return [Nurbs(3, knots, points, 10.0 ** rng.uniform(-0.7, 0.7, count))]
        case "ph":
            preimage = rng.uniform(-1.0, 1.0, (3, 2 if dimension == 2 else 4)) * np.sqrt(size)
            return [PH(np.zeros(dimension), preimage)]
        case "cusp":
            # (t², t³ + d t): a cusp for d = 0, nearly one else.
            d = 0.0 if rng.random() < 0.5 else 10.0 ** rng.uniform(-8.0, -1.0)
            return [Polynomial([[0.0, 0.0, size], [0.0, d * size, 0.0, size]], (-1.0, 1.0))]
        case "corners":
            points = np.cumsum(rng.uniform(-1.0, 1.0, (5, dimension)) * size, axis=0)
            return [Line(points[k : k + 2]) for k in range(4)]
        case "arcs":
            return _lines_and_arcs(rng, size)
    raise AssertionError(kind)


KINDS = ("bezier", "nurbs", "ph", "cusp", "corners", "arcs")


def _lines_and_arcs(rng: np.random.Generator, size: float) -> list:
    """A line, half a circle, a line back, and another with a kink that is too small for a corner."""
    radius = size * rng.uniform(0.05, 1.0)
    kink = 10.0 ** rng.uniform(-8.0, -3.01)
    top = 2.0 * radius
    end = (-size * np.cos(kink), top + size * np.sin(kink))
    return [
        Line([(0.0, 0.0), (size, 0.0)]),
        Arc(np.array([size, 0.0]), np.array([size, top]), np.array([size, radius]), "ccw"),
        Line([(size, top), (0.0, top)]),
        Line([(0.0, top), end]),
    ]
