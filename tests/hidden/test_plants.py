"""The hidden plants against what is known in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from tests.support.cascade_plant import Drive, motor_of, two_bodies
from tests.support.plants.axis import Forces, Hidden, Plant
from tests.support.plants.loops import Motion, _Body, follow
from tests.support.plants.tracks import Track

RAMP = Track().rest(0.1).move((0.04, 0.0), 0.02, 0.2).move((-0.04, 0.0), 0.02, 0.2).rest(0.5)
CUT = 8e-6 * 2**0.5
UP, DOWN = 1000, 3100
"""Samples amid the two cruises at 20 mm/s."""


def offset(motion: Motion, at: int) -> float:
    return float(motion.command[at] - motion.table[at])


class Sine:
    """The paper's command, §4.2."""

    end = 14.0
    amplitude, rate = 0.25, math.pi / 6.0

    def command(self, axis: int):  # type: ignore[no-untyped-def]
        return lambda t: self.amplitude * math.sin(self.rate * t)

    def rows(self, axis: int, times: np.ndarray) -> tuple[np.ndarray, ...]:
        size, rate, turned = self.amplitude, self.rate, self.rate * times
        return size * np.sin(turned), size * rate * np.cos(turned), -size * rate * rate * np.sin(turned)


def test_the_paper_s_example() -> None:
    plant = Plant("load", 5e-4, 5e-3, gap=0.125664 / 25, eta=0.35, beta=1.0)
    sine = Sine()
    body = _Body(plant, Forces(plant, sine, 0), np.arange(14001) * 1e-3)  # type: ignore[arg-type]
    body.v = sine.amplitude * sine.rate
    mode = lambda: body._slip(1)  # noqa: E731
    while mode is not None:
        mode = mode()
    opened = [t for t, kind in body.events if kind == "open"]
    picked = [t for t, kind in body.events if kind == "pickup"]
    assert opened[0] - 3.0 == pytest.approx(0.005000546, abs=5e-10)
    assert opened[1] - 9.0 == pytest.approx(0.005000674, abs=5e-10)
    assert picked[1] - opened[1] == pytest.approx(0.11874297, abs=1e-8)


def test_it_goes_where_scipy_takes_it() -> None:
    """Eq. (9) with all that resists a table which never rests, and what is left of the motor's force at its limit."""
    b, c, size, period = 5e-5, 4e-3, 3e-6, 2e-3
    track = Track().move((0.01, 0.0), 0.03, 0.6).move((-0.01, 0.0), 0.03, 0.6).rest(0.1)
    hidden = (
        Hidden("load_offset", {"force": 4e-6}),
        Hidden("viscous_friction", {"coefficient": 5e-4}),
        Hidden("friction_asymmetry", {"plus": 3e-4, "minus": -1e-4}),
        Hidden("cogging", {"force": size, "period": period, "phase": 0.4}),
        Hidden("stiffening", {"force": 6e-6, "at": 0.01}),
        Hidden("air_drag", {"force": 5e-6, "at": 0.03}),
        Hidden("hum", {"force": 2e-6, "frequency": 31.0}),
        Hidden("loading", {"share": 0.4, "over": 0.7}),
        Hidden("torque_saturation", {"limit": 1.4e-4}),
    )
    motion, command = follow(Plant("load", b, c, effects=hidden), track), track.command(0)
    assert np.max(np.abs(motion.command - motion.table)) > 1.4e-4

    def rate(t: float, y: np.ndarray) -> tuple[float, float]:
        x, v = y
        force = min(max(command(t) - x, -1.4e-4), 1.4e-4) - 4e-6 - (c + 5e-4 + (3e-4 if v > 0.0 else -1e-4)) * v
        force -= size * math.sin(math.tau / period * x + 0.4) + 6e-6 * (x / 0.01) ** 3 + 5e-6 * v * abs(v) / 0.03**2
        force -= 2e-6 * math.sin(math.tau * 31.0 * t)
        return v, force / (b * (1.0 + 0.4 * min(t / 0.7, 1.0)))

    start = (motion.table[0], 0.0)
    run = solve_ivp(rate, (0.0, motion.t[-1]), start, "DOP853", motion.t, rtol=1e-10, atol=1e-14, max_step=1e-3)
    assert np.allclose(motion.table, run.y[0], rtol=0.0, atol=1e-9)
    assert np.allclose(motion.velocity, run.y[1], rtol=0.0, atol=1e-7)


@pytest.mark.parametrize("feedback", ["load", "motor"])
def test_a_settled_axis_lags_by_c_v(feedback: str) -> None:
    motion = follow(Plant(feedback, 1e-4, 6e-3), RAMP)
    assert offset(motion, UP) == pytest.approx(6e-3 * 0.02, abs=1e-9)
    assert offset(motion, DOWN) == pytest.approx(-6e-3 * 0.02, abs=1e-9)


@pytest.mark.parametrize("feedback", ["load", "motor"])
@pytest.mark.parametrize(
    ("effect", "up", "down"),
    [
        (Hidden("coulomb_friction", {"force": 5e-6}), 5e-6, -5e-6),
        (Hidden("viscous_friction", {"coefficient": 1e-3}), 2e-5, -2e-5),
        (Hidden("friction_asymmetry", {"plus": 1e-3, "minus": -5e-4}), 2e-5, 1e-5),
        (Hidden("load_offset", {"force": 3e-6}), 3e-6, 3e-6),
        (Hidden("cutting_force", {"force": 8e-6, "feed": 0.01, "exponent": 0.5}), CUT, -CUT),
        (Hidden("transport_delay", {"delay": 1e-3}), 2e-5, -2e-5),
        (
            Hidden("stribeck_friction", {"force": 5e-6, "static_force": 9e-6, "stribeck_velocity": 0.01}),
            5e-6 + 4e-6 * math.exp(-4.0),
            -5e-6 - 4e-6 * math.exp(-4.0),
        ),
    ],
    ids=lambda value: value.name if isinstance(value, Hidden) else "",
)
def test_what_a_force_adds_to_the_lag(feedback: str, effect: Hidden, up: float, down: float) -> None:
    motion = follow(Plant(feedback, 1e-4, 6e-3, effects=(effect,)), RAMP)
    assert offset(motion, UP) - 1.2e-4 == pytest.approx(up, abs=1e-9)
    assert offset(motion, DOWN) + 1.2e-4 == pytest.approx(down, abs=1e-9)


def test_a_play_behind_the_loop_is_half_a_gap_on_either_side() -> None:
    motion = follow(Plant("motor", 1e-4, 6e-3, gap=3e-5), RAMP)
    behind = motion.motor - motion.table
    assert behind[UP] == pytest.approx(1.5e-5, abs=1e-12)
    assert behind[DOWN] == pytest.approx(-1.5e-5, abs=1e-12)


def test_a_gap_inside_the_loop_shows_at_the_motor() -> None:
    motion = follow(Plant("load", 1e-4, 6e-3, gap=3e-5), RAMP)
    behind = motion.motor - motion.table
    assert behind[UP] == pytest.approx(1.5e-5, abs=1e-12)
    assert behind[DOWN] == pytest.approx(-1.5e-5, abs=1e-12)


@pytest.mark.parametrize("kept", [0.0, 0.5, 1.0])
def test_a_pick_up_keeps_what_it_is_told(kept: float) -> None:
    """Between the pick-up and the next sample the table speeds up by no more than e / b."""
    plant = Plant("load", 5e-4, 6e-3, gap=3e-5, eta=0.4, kept=kept)
    motion = follow(plant, RAMP)
    at = motion.times("pickup")[0]
    before = int(at / 1e-3)
    push = float(motion.drive[before])
    w = (motion.motor[before] - motion.motor[before - 1]) / 1e-3 + push / (0.4 * 5e-4) * (at - (before - 0.5) * 1e-3)
    since = (before + 1) * 1e-3 - at
    expected = kept * 0.4 * w + (push - 6e-3 * kept * 0.4 * w) / 5e-4 * since
    assert float(motion.velocity[before + 1]) == pytest.approx(expected, rel=0.02)


@pytest.mark.parametrize("feedback", ["load", "motor"])
def test_a_spring_gives_way_to_inertia(feedback: str) -> None:
    """At a steady acceleration a the table hangs back by a / ω²."""

    class Parabola(Track):
        def command(self, axis: int):  # type: ignore[no-untyped-def]
            return lambda t: 0.5 * t * t

        def rows(self, axis: int, times: np.ndarray) -> tuple[np.ndarray, ...]:
            return 0.5 * times * times, times, np.ones_like(times)

    track = Parabola().rest(1.5)
    hidden = Hidden("elastic_windup", {"resonance": 600.0, "damping_ratio": 0.1})
    motion = follow(Plant(feedback, 1e-4, 6e-3, beta=0.0, effects=(hidden,)), track)
    hang = float(motion.motor[-1] - motion.table[-1])
    # The table's own friction c v stretches the spring too, and the damper takes its share of that.
    slow = 6e-3 / (0.5 * 1e-4 * 600.0**2) if feedback == "load" else 0.0
    drag = slow * (float(motion.velocity[-1]) - 2.0 * 0.1 / 600.0)
    assert hang == pytest.approx(1.0 / 600.0**2 + drag, abs=4e-9)


def test_a_torque_limit_holds_the_table_back() -> None:
    track = Track().rest(0.1).move((0.04, 0.0), 0.05, 1.0).rest(0.5)
    hidden = Hidden("torque_saturation", {"limit": 2.8e-4})
    free, held = (follow(Plant("motor", 1e-4, 6e-3, effects=e), track) for e in ((), (hidden,)))
    assert float(np.max(free.drive)) > 3e-4
    assert float(np.max(held.drive)) == pytest.approx(2.8e-4, abs=1e-15)
    # What is limited below c v cannot keep up: the table's speed is the limit over c.
    assert float(np.max(held.velocity)) == pytest.approx(2.8e-4 / 6e-3, rel=0.02)


def test_cogging_answers_as_the_loop_does() -> None:
    """Amplitude of the table's ripple at a steady speed: A / |1 - b w² + i c w|, w = 2 π v / p."""
    hidden = Hidden("cogging", {"force": 4e-6, "period": 1e-3})
    plain, ripple = (follow(Plant("motor", 1e-4, 6e-3, effects=e), RAMP) for e in ((), (hidden,)))
    cruise = slice(UP - 500, UP + 500)
    w = 2.0 * math.pi * 0.02 / 1e-3
    expected = 4e-6 / abs(1.0 - 1e-4 * w * w + 1j * 6e-3 * w)
    size = math.sqrt(2.0) * float(np.std((ripple.table - plain.table)[cruise]))
    assert size == pytest.approx(expected, rel=2e-3)


def test_circles_and_moves_are_smooth() -> None:
    track = Track().move((0.01, 0.02), 0.05, 1.0).circle(0.01, 0.05, 1.0, 0.1).circle(-0.01, 0.05, 1.0, 0.1, 1.0)
    t = np.linspace(0.0, track.end, 20001)
    for axis in (0, 1):
        place = np.array([track.command(axis)(each) for each in t])
        velocity, acceleration = np.array([track.motion(axis, each) for each in t]).T
        assert np.max(np.abs(np.gradient(place, t) - velocity)) < 5e-6
        assert np.max(np.abs(np.gradient(velocity, t) - acceleration)) < 2e-3
        assert np.max(np.abs(np.diff(acceleration))) < 0.02


TO_AND_FRO = Track().rest(0.1).move((0.02, 0.0), 0.05, 1.0).rest(0.05).move((-0.02, 0.0), 0.05, 1.0).rest(0.1)
CASCADE = Drive(tn=12e-3, velocity=0.95, current=5e-4)
STEADY = 1.0 / (CASCADE.kv * CASCADE.wv)


def test_a_cascade_with_friction_is_that_of_plain_steps() -> None:
    dry = Hidden("coulomb_friction", {"force": 5e-6})
    motion = follow(Plant("motor", STEADY, 1.0 / CASCADE.kv, effects=(dry,), drive=CASCADE), TO_AND_FRO)
    stepped = motor_of(CASCADE, motion.command, 5e-6 / STEADY, fine=50)
    assert np.max(np.abs(motion.motor - stepped)) < 1e-6
    assert np.max(np.abs(motion.command - motion.motor)) > 5e-5


@pytest.mark.parametrize("side", ["motor", "load"])
def test_a_cascade_around_a_gap_is_that_of_plain_steps(side: str) -> None:
    eta, beta = 0.4, 3.0
    c = 1.0 / CASCADE.kv + eta * beta * STEADY
    plant = Plant("load", STEADY, c, gap=3e-5, eta=eta, beta=beta, drive=CASCADE, fast_side=side)
    motion = follow(plant, TO_AND_FRO)
    stepped = two_bodies(CASCADE, motion.command, 3e-5, eta, beta, eta * beta, "standstill", side)
    assert np.sqrt(np.mean((motion.table - stepped) ** 2)) < 3e-7
    assert motion.times("pickup")
