"""Time in corners, exact and rounded, against a direct transcription of the tests' own."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from support.least_time import Jet, least_time

from ph_post.analysis.path_analysis import analyse
from ph_post.api.corners import with_rounded_corners
from ph_post.api.inputs import read_machine
from ph_post.compensate.motion import MotionLaw
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.geometry.curves import Arc, Bezier, Line
from ph_post.geometry.track import Track
from ph_post.types import Machine, Path, Plan

Floats = NDArray[np.float64]
MM = 1e-3
WITHIN = 0.05
"""How much longer than the least time a plan may take."""


class Side(NamedTuple):
    """A side of a corner: the curve, its length [m], and r_s, r_ss, r_sss of the test's own."""

    curve: Line | Arc | Bezier
    length: float
    jet: Jet


def straight(*points: Sequence[float]) -> Side:
    ends = MM * np.array(points, dtype=float)
    length = float(np.linalg.norm(ends[1] - ends[0]))
    tangent = (ends[1] - ends[0]) / length

    def jet(s: Floats) -> Floats:
        found = np.zeros((3, s.size, tangent.size))
        found[0] = tangent
        return found

    return Side(Line(ends), length, jet)


def round_side(center: Sequence[float], radius: float, first: float, last: float) -> Side:
    """Arc from one angle to another [degrees], ccw where it rises."""
    r, a0, a1 = MM * radius, math.radians(first), math.radians(last)
    sense = math.copysign(1.0, a1 - a0)
    middle = MM * np.array(center, dtype=float)

    def jet(s: Floats) -> Floats:
        angle = a0 + sense * s / r
        normal = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        tangent = sense * np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        return np.stack([tangent, -normal / r, -tangent / r**2])

    ends = [middle + r * np.array([math.cos(a), math.sin(a)]) for a in (a0, a1)]
    return Side(Arc(*ends, middle, "ccw" if sense > 0.0 else "cw"), r * abs(a1 - a0), jet)


def bent(points: Sequence[Sequence[float]]) -> Side:
    """Bézier curve [mm]."""
    p = MM * np.array(points, dtype=float)
    length, jet = jet_of(p)
    return Side(Bezier(p), length, jet)


def jet_of(control: Floats) -> tuple[float, Jet]:
    """Length of a Bézier curve, and its derivatives by arc length from those by its parameter."""
    n = len(control) - 1
    power = [
        math.comb(n, k) * sum((-1) ** (k - i) * math.comb(k, i) * control[i] for i in range(k + 1))
        for k in range(n + 1)
    ]

    def derivative(u: Floats, order: int) -> Floats:
        rows = [math.perm(k, order) * power[k] * (u ** max(k - order, 0))[:, None] for k in range(n + 1)]
        return np.sum(rows, axis=0)

    fine = np.linspace(0.0, 1.0, 20_001)
    speed = np.linalg.norm(derivative(fine, 1), axis=1)
    way = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(fine))])

    def jet(s: Floats) -> Floats:
        u = np.interp(s, way, fine)
        d1, d2, d3 = (derivative(u, k) for k in (1, 2, 3))
        q = np.sum(d1 * d1, axis=1)
        q1, q2 = 2.0 * np.sum(d1 * d2, axis=1), 2.0 * np.sum(d2 * d2 + d1 * d3, axis=1)
        # du/ds is q to the power -1/2; its first and second derivative by s follow from those of q by u.
        u1, u2 = q**-0.5, -0.5 * q1 / q**2
        u3 = (-0.5 * q2 / q**2 + q1**2 / q**3) * u1
        return np.stack(
            [
                d1 * u1[:, None],
                d2 * (u1**2)[:, None] + d1 * u2[:, None],
                d3 * (u1**3)[:, None] + 3.0 * d2 * (u1 * u2)[:, None] + d1 * u3[:, None],
            ]
        )

    return float(way[-1]), jet


def turned(angle: float, by: float, length: float = 6.0) -> tuple[Side, Side]:
    a, b = math.radians(by), math.radians(by + angle)
    return (
        straight([-length * math.cos(a), -length * math.sin(a)], [0, 0]),
        straight([0, 0], [length * math.cos(b), length * math.sin(b)]),
    )


CORNERS: dict[str, tuple[Callable[[], tuple[Side, Side]], str, float]] = {
    "90°": (lambda: turned(90, 0), "router", 800),
    "90°, sides too short for the feed": (lambda: turned(90, 0, 2.0), "mill", 3000),
    "30°, across the axes": (lambda: turned(30, 17), "router", 3000),
    "135°": (lambda: turned(135, -30), "mill", 1500),
    "175°": (lambda: turned(175, 5), "router", 1500),
    "in space": (lambda: (straight([-5, 0, 2], [0, 0, 0]), straight([0, 0, 0], [1, 4, 3])), "router", 1200),
    "line and arc": (lambda: (straight([-6, 0], [0, 0]), round_side([0, -20], 20, 90, 130)), "router", 1500),
    "arc and line": (lambda: (round_side([0, 12], 12, 190, 270), straight([0, 0], [-4, 5])), "mill", 1200),
    "two arcs": (lambda: (round_side([0, 10], 10, 200, 270), round_side([10, 0], 10, 180, 120)), "router", 1200),
    "spline and line": (lambda: (bent([[0, 0], [4, 6], [10, 6], [14, 0]]), straight([14, 0], [20, 4])), "mill", 1200),
}


def job(name: str) -> tuple[tuple[Side, Side], Machine, Path]:
    make, machine, feed = CORNERS[name]
    sides = make()
    return (
        sides,
        read_machine(machine),
        replace(Track.from_curves([one.curve for one in sides]).path, feed=feed * MM / 60),
    )


def limits_of(machine: Machine, path: Path) -> list[list[float]]:
    drives = [machine.axes[name].limits for name in path.axes]
    return [[getattr(one, what) for one in drives] for what in ("velocity", "acceleration", "jerk")]


def planned(path: Path, machine: Machine) -> Plan:
    return make_plan(analyse(path, machine, 5e-6), PlanOptions(strategy="none"))


@pytest.mark.parametrize("name", CORNERS)
@pytest.mark.thinned(12)
def test_an_exact_corner_takes_nearly_the_least_time(name: str) -> None:
    sides, machine, path = job(name)
    plan = planned(path, machine)
    # Two sides of different directions only join where speed and acceleration are zero: each is a motion of its own.
    least = sum(least_time(side.jet, side.length, limits_of(machine, path), path.feed, 100)[0] for side in sides)
    taken = MotionLaw.from_phases(plan.phases).end
    assert 0.995 * least <= taken <= (1.0 + WITHIN) * least


ROUNDED = [
    ("90°", 0.01),
    ("90°", 0.02),
    ("90°", 0.1),
    ("90°, sides too short for the feed", 0.02),
    ("30°, across the axes", 0.02),
    ("30°, across the axes", 0.1),
    ("135°", 0.02),
    ("135°", 0.1),
    ("in space", 0.02),
    ("in space", 0.1),
]


def chained(path: Path) -> tuple[float, Jet, list[float]]:
    """Length of a path of Bézier curves, the derivatives along it, and where its curves begin and end."""
    parts = [jet_of(one.curve.pieces[0].control) for one in path.segments]
    starts = [0.0, *np.cumsum([length for length, _ in parts]).tolist()]

    def jet(s: Floats) -> Floats:
        number = np.clip(np.searchsorted(starts, s, side="right") - 1, 0, len(parts) - 1)
        found = np.zeros((3, s.size, len(path.axes)))
        for k, (_, own) in enumerate(parts):
            found[:, number == k] = own(s[number == k] - starts[k])
        return found

    return starts[-1], jet, starts


@pytest.mark.parametrize(("name", "within"), ROUNDED)
@pytest.mark.thinned(12)
def test_a_rounded_corner_is_run_in_nearly_the_least_time_without_a_stop(name: str, within: float) -> None:
    _, machine, path = job(name)
    rounded = with_rounded_corners(path, within * MM)
    plan = planned(rounded, machine)
    length, jet, starts = chained(rounded)
    limits = limits_of(machine, path)
    least = least_time(jet, length, limits, path.feed, 160, [(starts[1], starts[2])])[0]
    motion = MotionLaw.from_phases(plan.phases)
    exact = MotionLaw.from_phases(planned(path, machine).phases).end
    assert 0.99 * least <= motion.end <= (1.0 + WITHIN) * least
    assert motion.end < exact, "rounding saves time"
    s, feed = motion.place_and_feed(np.linspace(0.0, motion.end, 2001))
    assert feed[(s > 0.5 * starts[1]) & (s < 0.5 * (starts[2] + length))].min() > 0.0, "it does not stop"
    assert not plan.warnings, "nothing had to be slowed down"
    track, period = Track(rounded), machine.servo_period
    s, _ = motion.place_and_feed(np.arange(0.0, motion.end, period))
    rows = track.derivatives(*track.locate(s))[0]
    for order, limit in enumerate(limits, start=1):
        rate = np.abs(np.diff(rows, order, axis=0)) / period**order
        assert (rate <= np.array(limit) * (1.0 + 1e-6)).all(), order


def test_corners_that_are_alike_are_solved_once() -> None:
    points = 40.0 * MM * np.array([[k // 2, (k + 1) // 2] for k in range(40)], dtype=float)
    path = replace(Track.from_curves([Line(pair) for pair in pairwise(points)]).path, feed=0.025)
    machine = read_machine("router")
    slow = MotionLaw.from_phases(planned(path, machine).phases).end
    plan = planned(with_rounded_corners(path, 2e-5), machine)
    assert MotionLaw.from_phases(plan.phases).end < slow - 38 * 0.02


@pytest.mark.parametrize("seed", range(9))
@pytest.mark.thinned(4)
def test_random_polygons_are_run_faster_around_their_corners_within_the_limits(seed: int) -> None:
    rng = np.random.default_rng(seed)
    machine = read_machine(("router", "mill", "stepper")[seed % 3])
    headings = np.cumsum(rng.uniform(0.1, 3.0, 7) * rng.choice([-1.0, 1.0], 7))
    sides = rng.choice([0.3, 1.0, 4.0]) * rng.uniform(1.0, 4.0, 7) * MM
    steps = sides[:, None] * np.stack([np.cos(headings), np.sin(headings)], axis=1)
    points = np.concatenate([np.zeros((1, 2)), np.cumsum(steps, axis=0)])
    feed, within = rng.choice([300.0, 1000.0, 3000.0]) * MM / 60.0, rng.choice([0.005, 0.02, 0.1]) * MM
    path = replace(Track.from_curves([Line(np.stack(pair)) for pair in pairwise(points)]).path, feed=float(feed))
    rounded = with_rounded_corners(path, float(within))
    motion = MotionLaw.from_phases(planned(rounded, machine).phases)
    assert motion.end < MotionLaw.from_phases(planned(path, machine).phases).end
    track = Track(rounded)
    s, _ = motion.place_and_feed(np.arange(0.0, motion.end, machine.servo_period))
    rows = track.derivatives(*track.locate(s))[0]
    for order, limit in enumerate(limits_of(machine, path), start=1):
        rate = np.abs(np.diff(rows, order, axis=0)) / machine.servo_period**order
        assert (rate <= np.array(limit) * (1.0 + 1e-6)).all(), order
