"""What is added to a path: a table under inverse dynamics follows it, integrated by scipy for itself."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from support.motions import circle, look, make_machine, make_path
from support.reference_drive import Drive
from support.reference_machine import simulate_axis

from ph_post.compensate.offsets import command_of, pushed, travelled
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.geometry.ph import PH
from ph_post.geometry.track import Track
from ph_post.types import Command, Crossing, Path, Servo

SERVOS = {
    "P": Servo(b=2e-4, c=0.02),
    "PI": Servo(b=2e-4, c=0.02, ki_over_kp=10.0),
    "PD": Servo(b=2e-4, c=0.02, kd_over_kp=0.01),
    "PID": Servo(b=2e-4, c=0.02, ki_over_kp=10.0, kd_over_kp=0.01),
}
LARGE = {"velocity": 1e3, "acceleration": 1e6, "jerk": 1e9}


def lead(path: Path, servo: Servo, period: float) -> Command:
    """The plain motion at the programmed feed, with inverse dynamics."""
    gap = replace(make_machine().axes["X"].gap, lost_motion=0.0, motor_angle=0.0)
    machine = make_machine(servo=servo, gap=gap, period=period, **LARGE)
    plan = make_plan(look(path, machine), PlanOptions(strategy="none", start="moving"))
    return command_of(replace(plan, inverse_dynamics=True), Track(path), period)


def largest_error(command: Command, servo: Servo, begin: list) -> float:
    """Distance of the table from the point of the path that is commanded, at any time."""
    path = command.position - command.offset
    executed = np.empty_like(path)
    for number, (speed, acceleration) in enumerate(begin):
        drive = Drive(b=servo.b, c=servo.c, gap=0.0, ki=servo.ki_over_kp, kd=servo.kd_over_kp)
        held = servo.b * acceleration + servo.c * speed
        motion = simulate_axis(
            drive,
            command.position[:, number],
            command.period,
            position=path[0, number],
            speed=speed,
            integral=held / servo.ki_over_kp if servo.ki_over_kp else 0.0,
        )
        executed[:, number] = motion.table
    return float(np.linalg.norm(executed - path, axis=1).max())


@pytest.mark.parametrize("kind", SERVOS)
@pytest.mark.thinned(2)
def test_a_table_that_is_led_follows_a_circle(kind: str) -> None:
    radius, feed, period = 0.01, 0.1, 1e-3
    servo, omega = SERVOS[kind], feed / radius
    command = lead(circle(radius, feed), servo, period)
    begin = [(0.0, -radius * omega**2), (feed, 0.0)]
    # Between samples the command is linear: inside the circle by up to a h² / 8.
    chord = radius * omega**2 * period**2 / 8.0
    assert largest_error(command, servo, begin) <= 2.0 * chord
    assert np.abs(command.offset).max() > 10.0 * chord


@pytest.mark.parametrize("kind", SERVOS)
@pytest.mark.thinned(4)
def test_a_table_that_is_led_follows_a_ph_curve(kind: str) -> None:
    period = 1e-3
    curve = PH(np.zeros(2), np.sqrt(1e-3) * np.array([[7.5, 2.5], [5.0, 5.0], [2.5, 7.5]]) / 2.5)
    servo, feed = SERVOS[kind], 0.02
    command = lead(make_path([curve], feed), servo, period)
    _, first, second = curve.derivatives(np.zeros(1), 2)[:, 0]
    size = np.linalg.norm(first)
    tangent = first / size
    bend = (second - (second @ tangent) * tangent) / size**2
    begin = list(zip(feed * tangent, feed**2 * bend, strict=True))
    chord = feed**2 * np.linalg.norm(curve_bends(curve), axis=1).max() * period**2 / 8.0
    assert largest_error(command, servo, begin) <= 2.0 * chord + 1e-12


def curve_bends(curve: PH) -> np.ndarray:
    """Curvature vectors along a curve."""
    _, first, second = curve.derivatives(np.linspace(0.0, 1.0, 501), 2)
    size = np.linalg.norm(first, axis=1)[:, None]
    tangent = first / size
    return (second - (second * tangent).sum(1)[:, None] * tangent) / size**2


def test_a_crossing_travels_as_the_smoothest_polynomial_of_its_order() -> None:
    crossing = Crossing(axis="X", start=0.1, duration=0.2, travel=3e-5, order=2)
    t = np.linspace(0.0, 0.4, 401)
    u = np.clip((t - 0.1) / 0.2, 0.0, 1.0)
    place = 3e-5 * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    speed = 3e-5 * 30.0 * u**2 * (1.0 - u) ** 2 / 0.2
    acceleration = 3e-5 * 60.0 * u * (1.0 - u) * (1.0 - 2.0 * u) / 0.2**2
    np.testing.assert_allclose(travelled(crossing, t), [place, speed, acceleration], rtol=1e-9, atol=1e-16)


def test_a_push_is_held_between_smooth_edges_and_gone_outside() -> None:
    crossing = Crossing(axis="X", start=0.0, duration=0.1, travel=0.0, push=2e-4, push_duration=0.2)
    t = np.array([0.0, 0.1, 0.2, 0.25, 0.3, 0.5])
    push = pushed(crossing, t)
    np.testing.assert_allclose(push[[0, 1, 4, 5]], 0.0, atol=1e-18)
    assert push[2] == 2e-4
    assert 0.0 < push[3] <= 2e-4
    assert math.isclose(push[3], 2e-4 * rises((0.3 - 0.25) / 0.2 / 0.3), rel_tol=1e-9)


def rises(u: float) -> float:
    """The step of order 3."""
    return u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3)
