"""Random jobs for the choice of a strategy: short paths, open and closed, on machines of every kind."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ph_post.compensate.options import PlanOptions
from ph_post.geometry.curves import Arc, Bezier, Line
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.track import Track
from ph_post.types import Axis, Gap, Limits, Machine, Path, Servo, Uncertainty

from .motions import make_path, random_curves

OPEN = ("bezier", "nurbs", "ph", "cusp", "corners", "arcs")
CLOSED = ("circle", "loop", "slot", "polygon")
KINDS = (*OPEN, *CLOSED)

Random = np.random.Generator


class RandomJob(NamedTuple):
    """What `make_plan` needs, and what kind of path it is."""

    kind: str
    path: Path
    machine: Machine
    options: PlanOptions


def random_job(number: int, seed: int = 2024) -> RandomJob:
    """Job of a number: a path that takes about a second, a machine with an axis of its own kind each."""
    rng = np.random.default_rng([seed, number])
    kind = KINDS[number % len(KINDS)]
    curves = _closed_curves(rng, kind) if kind in CLOSED else random_curves(rng, kind)
    path = make_path(curves, closed=kind in CLOSED)
    feed = Track(path).length / 10.0 ** rng.uniform(-0.5, 0.3)
    path = make_path(curves, feed=feed, closed=kind in CLOSED)
    machine = random_machine(rng, feed)
    options = PlanOptions(
        strategy="auto",
        start="moving" if rng.random() < 0.5 else "rest",
        max_slowdown=float(rng.choice([0.02, 0.1, 0.3])),
        min_feed=0.3 * feed if rng.random() < 0.1 else None,
        feed_only=bool(rng.random() < 0.15),
        allow_retrograde=bool(rng.random() < 0.15),
        inverse_dynamics=bool(rng.random() < 0.8),
    )
    return RandomJob(kind, path, machine, options)


def _closed_curves(rng: Random, kind: str) -> list[Any]:
    size = 10.0 ** rng.uniform(-3.0, -1.0)
    match kind:
        case "circle":
            angle = rng.choice([0.0, rng.uniform(0.0, 2.0 * np.pi)])
            start = size * np.array([np.cos(angle), np.sin(angle)])
            return [Arc(start, start, np.zeros(2), str(rng.choice(["cw", "ccw"])))]
        case "loop":
            dimension = int(rng.choice([2, 2, 3]))
            points = rng.uniform(-1.0, 1.0, (6, dimension)) * size
            # The last leg goes on as the first began, so that the seam is smooth.
            points[-1], points[-2] = points[0], 2.0 * points[0] - points[1]
            if rng.random() < 0.5:
                return [Bezier(points)]
            return [Nurbs(3, np.array([0, 0, 0, 0, 0.3, 0.6, 1, 1, 1, 1.0]), points, np.ones(6))]
        case "slot":
            r, half = size * rng.uniform(0.1, 1.0), size
            return [
                Line([(-half, -r), (half, -r)]),
                Arc(np.array([half, -r]), np.array([half, r]), np.array([half, 0.0]), "ccw"),
                Line([(half, r), (-half, r)]),
                Arc(np.array([-half, r]), np.array([-half, -r]), np.array([-half, 0.0]), "ccw"),
            ]
        case "polygon":
            corners = rng.uniform(-1.0, 1.0, (4, 2)) * size
            return [Line(np.array([corners[k], corners[(k + 1) % 4]])) for k in range(4)]
    raise AssertionError(kind)


def random_machine(rng: Random, feed: float) -> Machine:
    """Three axes, each with a loop, a gap and limits of its own; some let the feed through, others do not."""
    period = float(rng.choice([1e-3, 2e-3]))
    axes = {name: _random_axis(rng, name, feed) for name in "XYZ"}
    return Machine(name="bench", dialect="linuxcnc", servo_period=period, axes=axes)


def _random_axis(rng: Random, name: str, feed: float) -> Axis:
    feedback = str(rng.choice(["load", "motor", "none"]))
    servo = _random_servo(rng, feedback)
    acceleration = feed * 10.0 ** rng.uniform(0.7, 2.5)
    jerk = acceleration * 10.0 ** rng.uniform(0.7, 2.5)
    spread = float(rng.choice([0.0, 0.2, rng.uniform(0.0, 0.5)]))
    return Axis(
        name=name,
        feedback=feedback,
        servo=servo,
        gap=_random_gap(rng, feedback, servo),
        limits=Limits(velocity=feed * 10.0 ** rng.uniform(-0.3, 0.7), acceleration=acceleration, jerk=jerk),
        uncertainty=Uncertainty(backlash=spread),
        # No number is drawn for it, so that the jobs stay those of their seeds.
        reference_direction={"X": "both", "Y": "+", "Z": "-"}[name],
    )


def _random_servo(rng: Random, feedback: str) -> Servo:
    """P, PI or PID; damping ratios from 0.25 to 1.6; of steppers some that follow at once."""
    if feedback == "none" and rng.random() < 0.5:
        return Servo(b=0.0, c=0.0)
    c = 10.0 ** rng.uniform(-2.5, -1.5)
    b = (0.5 * c / rng.uniform(0.25, 1.6)) ** 2
    if feedback == "none" or rng.random() < 0.6:
        return Servo(b=b, c=c)
    # Stable for ki < (c + kd) / b, and well damped far below that.
    kd = c * rng.uniform(0.0, 1.0) if rng.random() < 0.5 else 0.0
    return Servo(b=b, c=c, ki_over_kp=rng.uniform(0.02, 0.2) * (c + kd) / b, kd_over_kp=kd)


def _random_gap(rng: Random, feedback: str, servo: Servo) -> Gap:
    """From none to 0.2 mm; the motor loses less to its own damping than the whole axis does."""
    lost = 0.0 if rng.random() < 0.05 else 10.0 ** rng.uniform(-6.0, -3.7)
    flank = str(rng.choice(["+", "-", "unknown", "unknown"]))
    if feedback != "load":
        return Gap(lost_motion=lost, initial_flank=flank)
    eta, ratio, travel = rng.uniform(0.2, 0.8), rng.uniform(1.0, 25.0), 10.0 ** rng.uniform(-3.0, 0.0)
    pickup = rng.choice(["standstill", "momentum", "contact", None])
    return Gap(
        lost_motion=lost,
        motor_angle=lost * ratio / travel,
        gear_ratio=ratio,
        travel_per_rad=travel,
        inertia_fraction=eta,
        beta=rng.uniform(0.05, 0.9) * servo.c / (eta * servo.b),
        pickup=pickup,
        initial_flank=flank,
    )
