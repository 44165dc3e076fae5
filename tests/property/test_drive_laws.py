"""Laws of the backlash interval that hold for every drive: scaling, bounds, and a word for every refusal."""

from __future__ import annotations

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.drives import axis, gap_of, run_drive

from ph_post.drive.backlash import motor_gain
from ph_post.drive.intervals import backlash_interval
from ph_post.drive.steady_state import find_orbit
from ph_post.types import BacklashInterval, Feedback, Gap, Servo

EPS = 2.0**-52


def log_uniform(low: float, high: float) -> st.SearchStrategy[float]:
    """Positive floats whose logarithm is spread over the range."""
    return st.floats(math.log(low), math.log(high)).map(math.exp)


positive = st.floats(min_value=0.0, exclude_min=True, allow_nan=False)
"""Any positive float, subnormal, huge and infinite ones included."""

natural = log_uniform(1.0, 1e4)
damping = log_uniform(0.02, 50.0)
beta = st.one_of(st.just(0.0), log_uniform(1e-3, 1e4))


@st.composite
def drives(draw: st.DrawFn) -> tuple[Servo, Gap, float, float]:
    """Draw a plausible machine: loop, gap, amplitude, angular frequency, and a gap that can be crossed."""
    frequency = draw(natural)
    servo = Servo(b=frequency**-2, c=2.0 * draw(damping) / frequency)
    amplitude, omega = draw(log_uniform(1e-4, 1.0)), draw(log_uniform(1e-2, 1e2))
    gain = draw(log_uniform(1e2, 1e7))
    size = draw(log_uniform(1e-8, 0.5)) * gain * amplitude / omega**2
    return servo, gap_of(gain, draw(beta), size, servo.b), amplitude, omega


def check(interval: BacklashInterval | None, note: str, amplitude: float, omega: float) -> None:
    """What every answer owes: no NaN, less than half a period, or else a word."""
    if interval is None:
        assert note
        return
    assert all(map(math.isfinite, (interval.lag, interval.duration, interval.position, interval.residual)))
    assert 0.0 <= interval.duration <= math.pi / omega * (1.0 + 4 * EPS)
    assert abs(interval.lag) <= 2.0 * math.pi / omega
    assert interval.position >= 0.0


@settings(deadline=None)
@given(
    feedback=st.sampled_from(["load", "motor", "none"]),
    b=positive,
    c=positive,
    ki=st.one_of(st.just(0.0), positive),
    kd=st.one_of(st.just(0.0), positive),
    angle=st.floats(min_value=0.0, allow_nan=False),
    gear=positive,
    travel=positive,
    fraction=st.floats(1e-6, 1.0, exclude_max=True),
    rate=st.one_of(st.just(0.0), positive),
    amplitude=positive,
    omega=positive,
)
def test_anything_positive_gets_an_answer(
    feedback: Feedback,
    b: float,
    c: float,
    ki: float,
    kd: float,
    angle: float,
    gear: float,
    travel: float,
    fraction: float,
    rate: float,
    amplitude: float,
    omega: float,
) -> None:
    gap = Gap(
        lost_motion=angle,
        motor_angle=angle,
        gear_ratio=gear,
        travel_per_rad=travel,
        inertia_fraction=fraction,
        beta=rate,
    )
    drive = axis(Servo(b=b, c=c, ki_over_kp=ki, kd_over_kp=kd), gap, feedback)
    interval, note = backlash_interval(drive, amplitude, omega)
    check(interval, note, amplitude, omega)


@settings(deadline=None)
@given(drives(), st.sampled_from([0.0, 0.1, 0.9]), st.sampled_from([0.0, 0.5, 5.0]))
def test_plausible_drives(drive: tuple[Servo, Gap, float, float], ki: float, kd: float) -> None:
    """`ki` as a fraction of the limit of stability, `kd` as one of c."""
    servo, gap, amplitude, omega = drive
    servo = replace(servo, kd_over_kp=kd * servo.c)
    servo = replace(servo, ki_over_kp=ki * (servo.c + servo.kd_over_kp) / servo.b)
    interval, note = find_orbit(servo, gap, amplitude, omega)
    check(interval, note, amplitude, omega)
    if interval is not None:
        scale = gap.motor_angle or 0.0
        assert abs(interval.residual) <= 1e-9 * scale


@settings(deadline=None)
@given(drives(), st.integers(-20, 20))
def test_lengths_scale(drive: tuple[Servo, Gap, float, float], power: int) -> None:
    """Amplitude and gap times k: the same times, and the place times k (k a power of 2: exactly)."""
    servo, gap, amplitude, omega = drive
    k = 2.0**power
    assert gap.motor_angle is not None
    larger = replace(gap, motor_angle=k * gap.motor_angle, lost_motion=k * gap.lost_motion)
    for feedback in ("load", "motor"):
        one, _ = backlash_interval(axis(servo, gap, feedback), amplitude, omega)
        other, _ = backlash_interval(axis(servo, larger, feedback), k * amplitude, omega)
        if one is None:
            assert other is None
            continue
        assert other is not None
        assert (other.lag, other.duration, other.position) == (one.lag, one.duration, k * one.position)


@settings(deadline=None)
@given(drives(), st.integers(-10, 10))
def test_times_scale(drive: tuple[Servo, Gap, float, float], power: int) -> None:
    """Times k-fold (b by k², c by k, β, Ω by 1/k, C by 1/k²): the interval too (k a power of 2: exactly)."""
    servo, gap, amplitude, omega = drive
    k = 2.0**power
    slower = Servo(b=k * k * servo.b, c=k * servo.c)
    later = replace(gap, beta=(gap.beta or 0.0) / k)
    one, note = find_orbit(servo, gap, amplitude, omega)
    other, other_note = find_orbit(slower, later, amplitude, omega / k)
    assert note == other_note
    if one is not None:
        assert other is not None
        assert (other.lag, other.duration, other.position) == (k * one.lag, k * one.duration, one.position)


@settings(deadline=None)
@given(drives(), st.floats(1.0, 10.0), st.floats(1e-4, 1e-2), st.floats(1.01, 3.0))
def test_wider_gap_takes_longer(
    drive: tuple[Servo, Gap, float, float], damping: float, delay: float, factor: float
) -> None:
    """On a loop that has settled before the next reversal; where it still rings, the orbit may jump."""
    _, gap, amplitude, omega = drive
    servo = Servo(b=0.25 * (delay / omega / damping) ** 2, c=delay / omega)
    assert gap.motor_angle is not None
    narrow, _ = find_orbit(servo, gap, amplitude, omega)
    wide, _ = find_orbit(servo, replace(gap, motor_angle=factor * gap.motor_angle), amplitude, omega)
    if narrow is not None and wide is not None:
        assert wide.duration > narrow.duration


@pytest.mark.parametrize(("zeta", "ki"), [(0.6, 0.0), (2.5, 0.0), (1.0, 1.5)])
def test_orbits_are_where_integration_settles(zeta: float, ki: float) -> None:
    """Drives without ringing, P and PI, from rest by scipy's DOP853."""
    servo = Servo(b=1e-3, c=2.0 * zeta * math.sqrt(1e-3), ki_over_kp=ki)
    gap = gap_of(gain=3e4, beta=2.0, motor_angle=0.05, b=servo.b)
    orbit, note = find_orbit(servo, gap, 0.1, 1.5)
    assert orbit is not None
    assert note == ""
    run = run_drive(servo, motor_gain(servo, gap), 2.0, 0.05, 0.1, 1.5, count=10)[-1]
    assert (run.lag, run.duration) == pytest.approx((orbit.lag, orbit.duration), abs=2e-8)
    assert run.position == pytest.approx(orbit.position, abs=1e-9)
