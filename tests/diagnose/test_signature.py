"""Signatures of residuals that were made by a formula."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.residuals import MM, UM, circles, decaying, irregular, moved, sweeps, to_and_fro, white

from ph_post.diagnose.residual_features import best_period, by_direction, by_rotation, by_speed, drift
from ph_post.identify.linear_drive import motion_of


def test_a_size_that_goes_with_the_square_root_of_the_feed() -> None:
    m = moved(sweeps(40.0, 0.02, 0.06), np.zeros(40_000))
    motion = motion_of(m.log, m.machine, "X")
    size = np.where(m.t < 20.0, math.sqrt(0.02), math.sqrt(0.06))
    found = by_speed(size * UM * decaying(m.v, 0.02), motion, 0.03, m.counted)
    assert found.feeds[:: len(found.feeds) - 1] == pytest.approx((0.02, 0.06), rel=0.02)
    assert found.sizes[-1] / found.sizes[0] == pytest.approx(math.sqrt(3.0), rel=0.03)
    assert found.exponent == pytest.approx(0.5, abs=0.03)


def test_one_feed_has_no_exponent() -> None:
    m = circles(9.0)
    found = by_speed(np.full(m.x.size, UM), motion_of(m.log, m.machine, "X"), 0.1, m.counted)
    assert len(found.feeds) == 1
    assert found.sizes == pytest.approx((UM,))
    assert found.exponent is None


def test_sizes_by_direction() -> None:
    m = irregular()
    motion = motion_of(m.log, m.machine, "X")
    plus, minus = by_direction(np.where(m.v > 0.0, 3.0 * UM, -UM), motion, 0.05, m.counted) or (0.0, 0.0)
    assert plus == pytest.approx(3.0 * UM, rel=0.03)
    assert minus == pytest.approx(UM, rel=0.1)
    assert by_direction(m.v, motion, 0.05, m.counted & (m.v > 0.0) & (motion.since > 0.01)) is None


def test_sizes_by_rotation() -> None:
    m = circles()
    motion = motion_of(m.log, m.machine, "X")
    counter = (m.t // 3.0).astype(np.int64) % 2 == 0
    found = by_rotation(np.where(counter, UM, 4.0 * UM), motion, m.counted)
    assert found == pytest.approx((4.0 * UM, UM), rel=0.06)  # the drive is late by a little
    assert by_rotation(np.ones(m.x.size), motion, m.counted & counter) is None


@pytest.mark.parametrize("period", [0.7 * MM, 5.0 * MM, 11.3 * MM])
@pytest.mark.thinned(4)
def test_a_period_its_amplitude_and_phase(period: float) -> None:
    m = to_and_fro()
    wave = 2.0 * UM * np.sin(2.0 * np.pi * m.x / period + 0.8)
    found = best_period(wave + 1e-3 * m.x + white(m.x.size, UM, 3), m.x, m.counted)
    assert found is not None
    assert found.period == pytest.approx(period, rel=2e-3)
    assert found.amplitude == pytest.approx(2.0 * UM, rel=0.03)
    at = np.linspace(-15.0, 15.0, 50) * MM
    again = found.amplitude * np.sin(2.0 * np.pi * at / found.period + found.phase)
    np.testing.assert_allclose(again, 2.0 * UM * np.sin(2.0 * np.pi * at / period + 0.8), atol=0.3 * UM)
    assert found.share == pytest.approx(2.0 / 3.0, abs=0.04)


def test_there_is_no_period_without_motion_or_residual() -> None:
    every = np.ones(100, dtype=np.bool_)
    assert best_period(np.arange(100.0), np.zeros(100), every) is None
    assert best_period(np.zeros(100), np.arange(100.0), every) is None


def test_a_drift_its_size_and_its_half_time() -> None:
    t = 1e-3 * np.arange(60_000)
    course = 10.0 * UM * (1.0 - np.exp(-t / 20.0))
    found = drift(course + white(t.size, UM, 4), t, t >= 0.0)
    change = 10.0 * UM * (1.0 - math.exp(-3.0))
    assert found.change == pytest.approx(change, rel=0.03)
    assert found.half == pytest.approx(-20.0 * math.log(1.0 - 0.5 * (1.0 - math.exp(-3.0))), abs=1.5)
    assert found.share == pytest.approx(np.var(course) / (np.mean(course**2) + UM**2), abs=0.02)
    assert drift(np.zeros(0), np.zeros(0), np.zeros(0, dtype=np.bool_)).change == 0.0
