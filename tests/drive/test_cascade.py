"""The cascade as a linear system: its inverse on a plant of the tests' own, its response, its stability."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from support.cascade_plant import DRIVES, PERIOD, Drive, motor_of, two_bodies

from ph_post.compensate.inverse import lead_of_crossing, lead_of_force, lead_of_motion, lead_when_steady
from ph_post.drive.cascade import is_stable, loop_response, most_position_gain, way_of_motor
from ph_post.drive.command_filters import arriving, mean_delay
from ph_post.drive.intervals import backlash_interval
from ph_post.types import Array, Axis, Cascade, Feedback, Gap, Limits, Servo

FILTERS = {
    "none": {},
    "dead time and average": {"dead_time": 2e-3, "moving_average": 12e-3},
    "exponential and shaper": {"exponential": 4e-3, "shaper_frequency": 2.0 * math.pi * 35.0, "shaper_damping": 0.05},
}


def axis_of(cascade: Cascade, feedback: Feedback = "motor", damping: float = 0.0, gap: Gap | None = None) -> Axis:
    b = 1.0 / (cascade.velocity_gain * cascade.position_gain)
    return Axis(
        name="X",
        feedback=feedback,
        servo=Servo(b=b, c=1.0 / cascade.position_gain + damping * b, cascade=cascade),
        gap=gap or Gap(lost_motion=2e-5),
        limits=Limits(velocity=1.0, acceleration=10.0, jerk=1e3),
    )


def there_and_back() -> Array:
    """Smooth, and at rest at both ends."""
    u = np.clip((PERIOD * np.arange(900) - 0.15) / 0.25, 0.0, 2.0)
    u = np.minimum(u, 2.0 - u)
    return np.asarray(0.01 * u**5 * (126.0 - 420.0 * u + 540.0 * u**2 - 315.0 * u**3 + 70.0 * u**4))


def rates(path: Array) -> tuple[Array, Array]:
    speed = np.gradient(path, PERIOD)
    return speed, np.gradient(speed, PERIOD)


@pytest.mark.parametrize("filters", FILTERS)
@pytest.mark.parametrize("name", [name for name in DRIVES if name != "limited"])
@pytest.mark.thinned(12)
def test_led_motion_on_a_plant_of_its_own(name: str, filters: str) -> None:
    """What the fine steps leave is 0.1 µm, what a chord of a period leaves as much."""
    drive, path = replace_deadband(DRIVES[name]), there_and_back()
    cascade = drive.cascade(**FILTERS[filters])
    led = path + lead_of_motion(axis_of(cascade), *rates(path), PERIOD)
    off = motor_of(drive, arriving(cascade, led, 0.0, PERIOD).position) - path
    plain = motor_of(drive, arriving(cascade, path, 0.0, PERIOD).position) - path
    assert np.abs(off).max() < 1e-6
    assert np.abs(off).max() < 0.02 * np.abs(plain).max() or name == "100 %"


def test_nothing_rings_behind_a_motion() -> None:
    """Of a polynomial from rest to rest the inverse is one, v/K_v + b (a + T_i j), and nothing behind its end.

    Every other row was off there by 0.07 nm, 0.5 m/s³, which threw away plans that use all of a limit of 50.
    """
    cascade = Cascade(position_gain=40.0, velocity_gain=230.0, current_time=2e-4)
    axis, way, last = axis_of(cascade), 4.2e-5, 0.077
    t = PERIOD * np.arange(400)
    u = np.clip((t - 0.1) / last, 0.0, 1.0)
    speed = way / last * 140.0 * u**3 * (1.0 - u) ** 3
    acceleration = way / last**2 * 420.0 * u**2 * (1.0 - u) ** 2 * (1.0 - 2.0 * u)
    jerk = way / last**3 * 840.0 * u * (1.0 - u) * (1.0 - 5.0 * u + 5.0 * u**2)
    exact = speed / 40.0 + axis.servo.b * (acceleration + 2e-4 * jerk)
    off = lead_of_motion(axis, speed, acceleration, PERIOD) - exact
    assert np.abs(off).max() < 2.5e-9
    behind = off[t > 0.1 + last + 0.02]
    assert np.abs(np.diff(behind, 3)).max() / PERIOD**3 < 0.03


def replace_deadband(drive: Drive) -> Drive:
    """A deadband is not led."""
    return Drive(**{**drive.__dict__, "deadband": 0.0})


def test_dead_time_of_an_even_motion() -> None:
    cascade = DRIVES["70 %"].cascade(dead_time=3e-3, moving_average=8e-3)
    speed, zeros = np.full(300, 0.05), np.zeros(300)
    expected = 0.05 * (0.3 / 40.0 + 3e-3 + 4e-3)
    np.testing.assert_allclose(lead_of_motion(axis_of(cascade), speed, zeros, PERIOD), expected, rtol=1e-9)
    np.testing.assert_allclose(lead_when_steady(axis_of(cascade), speed, zeros), expected, rtol=1e-9)


def test_force_that_is_led() -> None:
    """A motor at rest, on which a force grows and stays, does not move: the integrator takes it over."""
    drive, t = DRIVES["95 %"], PERIOD * np.arange(600)
    force = 0.5 * np.clip((t - 0.1) / 0.05, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip((t - 0.1) / 0.05, 0.0, 1.0))
    unit = drive.kv * drive.wv
    added = lead_of_force(axis_of(drive.cascade()), force / unit, PERIOD)
    pushed = motor_of(drive, added, against=force)
    assert np.abs(pushed).max() < 2e-6
    assert np.abs(motor_of(drive, 0.0 * added, against=force)).max() > 1e-5
    assert abs(added[-1]) < 1e-9


@pytest.mark.parametrize("side", ["motor", "load"])
def test_crossing_a_gap_inside_the_loop(side: str) -> None:
    """The table rests meanwhile, and then follows as one without a gap does."""
    drive, gap, eta, beta = DRIVES["95 %"], 4e-5, 0.4, 3.0
    t = PERIOD * np.arange(220)

    def step(begin: float, size: float) -> Array:
        u = np.clip((t - begin) / 0.04, 0.0, 1.0)
        return np.asarray(size * u**4 * (35.0 - 84.0 * u + 70.0 * u**2 - 20.0 * u**3))

    cascade = replace(drive.cascade(), velocity_feedback=side)
    axis = axis_of(cascade, "load", 0.0, Gap(lost_motion=gap, inertia_fraction=eta, beta=beta))
    crossing = lead_of_crossing(axis, *rates(step(0.05, -gap)), None, PERIOD)

    def table(command: Array, flank: int, gap: float = gap) -> Array:
        return flank * two_bodies(drive, flank * command, gap, eta, beta, eta * beta, "standstill", side)

    assert np.abs(table(crossing, 1)).max() < 1e-6
    moved = step(0.1, -3e-4)
    follows = table(moved, -1)
    assert np.abs(table(crossing + moved, 1) - follows).max() < 2e-6
    assert np.abs(table(moved, 1) - follows).max() > 1.5e-5


@pytest.mark.parametrize("name", ["P, P", "70 %", "100 %"])
def test_response_and_settled_orbit(name: str) -> None:
    """Swing and delay of a motor on a circle, and how long the table behind it stands."""
    drive, omega, amplitude, gap = DRIVES[name], 8.0, 5e-3, 1e-4
    cascade = drive.cascade(moving_average=10e-3)
    t = PERIOD * np.arange(1600)
    motor = motor_of(drive, arriving(cascade, amplitude * np.sin(omega * t), 0.0, PERIOD).position)[800:]
    columns = np.stack([np.sin(omega * t), np.cos(omega * t)], axis=1)[800:]
    found = complex(*np.linalg.lstsq(columns, motor, rcond=None)[0]) / amplitude
    expected = complex(loop_response(axis_of(cascade).servo, np.array([omega]))[0])
    assert abs(found - expected) < 1e-4
    interval, note = backlash_interval(axis_of(cascade, gap=Gap(lost_motion=gap)), amplitude, omega)
    assert interval is not None
    assert note == ""
    assert interval.duration == pytest.approx(math.acos(1.0 - gap / (amplitude * abs(found))) / omega, rel=1e-3)
    assert interval.lag == pytest.approx(-math.atan2(found.imag, found.real) / omega, rel=0.02, abs=2e-5)


def test_step_of_a_motor() -> None:
    drive = Drive(tn=12e-3, velocity=0.9, current=1e-3)
    command = np.clip((PERIOD * np.arange(300) - 0.02) / 0.01, 0.0, 1.0) * 1e-4
    way = way_of_motor(axis_of(drive.cascade()).servo, command, PERIOD)
    assert np.abs(way - motor_of(drive, command)).max() < 1e-6
    single = way_of_motor(Servo(b=1e-4, c=0.025), command, PERIOD)
    assert np.abs(single - motor_of(Drive(), command)).max() < 1e-6


def test_stability_by_hurwitz() -> None:
    """Without a current loop s³ + ω s² + ω (K + 1/T) s + ω K / T; with one, and no T, T_i s³ + s² + ω s + ω K."""
    for gain, rate, omega in ((400.0, 300.0, 150.0), (400.0, 300.0, 180.0), (50.0, 30.0, 10.0), (50.0, 20.0, 20.0)):
        cascade = Cascade(position_gain=gain, velocity_gain=omega, integral_rate=rate)
        assert is_stable(axis_of(cascade).servo) == (omega * (gain + rate) > gain * rate)
    quick = Cascade(position_gain=90.0, velocity_gain=300.0, current_time=10e-3)
    assert is_stable(axis_of(quick).servo)
    assert not is_stable(axis_of(replace(quick, position_gain=110.0)).servo)
    assert most_position_gain(axis_of(replace(quick, position_gain=900.0)).servo) == pytest.approx(100.0, rel=0.02)


def test_mean_delay_is_that_of_a_ramp() -> None:
    cascade = DRIVES["P, P"].cascade(**FILTERS["exponential and shaper"], dead_time=1e-3, moving_average=5e-3)
    ramp = 0.1 * PERIOD * np.arange(400)
    late = arriving(cascade, np.concatenate([np.zeros(50), ramp]), 0.0, PERIOD).position[-1]
    assert (ramp[-1] - late) / 0.1 == pytest.approx(mean_delay(cascade), rel=1e-6)


@pytest.mark.parametrize("late", [0.02, 0.3, 0.5, 1.0, 2.3])
def test_a_step_of_force_is_led_before_a_dead_time_without_ringing(late: float) -> None:
    """A part of a row shifts what is between two rows, and no row beside them: its mean is early by the dead time."""
    period, size = 1e-3, 2e-5
    force = np.where(np.arange(400) < 200, -size, size)
    cascade = Cascade(position_gain=60.0, velocity_gain=300.0)
    prompt = lead_of_force(axis_of(cascade), force, period)
    early = lead_of_force(axis_of(replace(cascade, dead_time=late * period)), force, period)
    assert np.sum(early - prompt) == pytest.approx(2.0 * size * late, rel=1e-3)
    assert np.abs(np.diff(early, 3)).max() < 1.02 * np.abs(np.diff(prompt, 3)).max()
    far = np.abs(np.arange(400) - 200) > 6
    assert np.abs((early - prompt)[far]).max() < 1e-3 * size
