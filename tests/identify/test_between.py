"""Commands between the rows of slow logs, by closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from ph_post.identify.between import courses_between, interpolation_error, parts_between, refined
from ph_post.identify.linear_drive import drive_response
from ph_post.types import Servo


def test_polynomials_to_the_third_degree_are_kept() -> None:
    u = np.linspace(-1.0, 1.0, 12)
    fine = np.linspace(-1.0, 1.0, 11 * 7 + 1)
    inner = slice(14, -14)  # the outermost slopes are differences of two rows
    for power in range(4):
        assert refined(u**power, 7)[inner] == pytest.approx(fine[inner] ** power, abs=1e-14)
        assert np.array_equal(refined(u**power, 7)[::7], u**power)


def test_a_rest_stays_a_rest() -> None:
    command = np.concatenate([np.zeros(6), np.arange(1.0, 7.0) ** 2, np.full(6, 36.0)])
    fine = refined(command, 10)
    assert np.all(fine[:51] == 0.0)
    assert np.all(fine[110:] == 36.0)
    assert np.all(np.diff(fine) >= 0.0)


def test_rows_of_a_drive_are_joined_by_straight_lines() -> None:
    command = np.array([0.0, 1.0, 4.0, 9.0, 16.0])
    assert parts_between(1e-3) == 1
    assert refined(command, 1) is command
    assert not np.any(interpolation_error(command, 1e-3))


@pytest.mark.parametrize("period", [2e-3, 4e-3, 1e-2])
def test_a_drive_answers_slow_rows_as_it_does_the_curve(period: float) -> None:
    b, c, rate, size = 1e-4, 6e-3, 2.0 * np.pi * 1.5, 0.01
    t = period * np.arange(round(3.0 / period))
    gain = 1.0 / (1.0 - b * rate**2 + 1j * c * rate)
    settled = t > 1.0
    found = drive_response(size * np.sin(rate * t), Servo(b=b, c=c), period)
    apart = (found - size * np.imag(gain * np.exp(1j * rate * t)))[settled][:-5]
    assert np.max(np.abs(apart)) < 3e-7
    # What is said of the error is about what it is.
    fine = period * np.arange(10 * (t.size - 1) + 1) / 10
    true = (refined(size * np.sin(rate * t), 10) - size * np.sin(rate * fine))[500:-500]
    said = interpolation_error(size * np.sin(rate * t), period)[50:-50]
    assert 0.3 * np.std(true) < np.std(said) < 5.0 * np.std(true)


def test_rows_stand_for_a_smooth_curve_and_for_steps_by_their_answers() -> None:
    """In cycles long beside a row: steps are the curve through a moving average of a row."""
    b, c, rate, size, period = 1e-4, 6e-3, 2.0 * np.pi * 8.0, 0.01, 1e-3
    t = period * np.arange(3000)
    gain = 1.0 / (1.0 - b * rate**2 + 1j * c * rate)
    late = np.sinc(0.5 * rate * period / np.pi) * np.exp(-0.5j * rate * period)
    lines, curve, steps = courses_between(size * np.sin(rate * t))
    for course, true in ((curve, gain), (steps, gain * late)):
        found = drive_response(course.rows, Servo(b=b, c=c), period)
        apart = (found - size * np.imag(true * np.exp(1j * rate * t)))[1000:-5]
        assert np.max(np.abs(apart)) < 5e-9
    assert lines.late == curve.late == 0.0
    assert steps.late == 0.5
    apart = drive_response(lines.rows, Servo(b=b, c=c), period) - size * np.imag(gain * np.exp(1j * rate * t))
    assert np.max(np.abs(apart[1000:-5])) == pytest.approx(size * abs(gain) * (rate * period) ** 2 / 12.0, rel=0.02)
