"""Coast-downs: what is an exponential and what is none."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ph_post.identify.direct_readings import CoastDown, find_coast_downs, pooled_rate
from ph_post.types import AxisLog

Array = NDArray[np.float64]
PERIOD = 1e-3
NOISE = 3e-7
MEMORY = 0.01


def noisy(values: Array, seed: int = 1) -> Array:
    return values + NOISE * np.random.default_rng(seed).standard_normal(values.size)


def after_motion(coast: Array) -> tuple[Array, Array]:
    """Half a second at 50 mm/s, then the command stands and the motor goes its own way."""
    run = 0.05 * np.arange(500) * PERIOD
    command = np.concatenate([run, np.full(coast.size, run[-1])])
    return command, np.concatenate([run, run[-1] + coast])


def test_an_exponential_is_found_with_its_rate() -> None:
    t = np.arange(1, 1501) * PERIOD
    rates = []
    for seed in range(20):
        command, motor = after_motion(0.05 / 3.0 * (1.0 - np.exp(-3.0 * t)))
        record = AxisLog(command=command, motor=noisy(motor, seed), table=noisy(0.0 * motor, seed + 50))
        (found,) = find_coast_downs(record, PERIOD, NOISE, 0.0, MEMORY)
        assert not found.coupled
        rates.append((found.rate - 3.0) / found.error)
    assert 0.4 < np.mean(np.square(rates)) < 2.2  # chi-square of 20, at 0.1 % either side


def test_dry_friction_slows_a_motor_evenly_and_gives_no_rate() -> None:
    t = np.arange(1, 1501) * PERIOD
    stop = 0.5
    way = np.where(t < stop, 0.05 * t * (1.0 - 0.5 * t / stop), 0.5 * 0.05 * stop)
    command, motor = after_motion(way)
    record = AxisLog(command=command, motor=noisy(motor))
    assert find_coast_downs(record, PERIOD, NOISE, 0.0, MEMORY) == []


def test_the_servos_own_settling_is_no_coast_down() -> None:
    t = np.arange(1, 1501) * PERIOD
    command, motor = after_motion(0.05 * MEMORY * (1.0 - np.exp(-t / MEMORY)))
    record = AxisLog(command=command, motor=noisy(motor))
    assert find_coast_downs(record, PERIOD, NOISE, 0.0, MEMORY) == []


def test_without_effort_the_command_may_go_on() -> None:
    t = np.arange(1, 1501) * PERIOD
    command, motor = after_motion(0.05 / 3.0 * (1.0 - np.exp(-3.0 * t)))
    command = 0.05 * np.arange(command.size) * PERIOD
    effort = np.where(np.arange(command.size) < 500, 20.0, 0.0)
    effort = effort + 0.1 * np.random.default_rng(2).standard_normal(effort.size)
    record = AxisLog(command=command, motor=noisy(motor), effort=effort)
    found = find_coast_downs(record, PERIOD, NOISE, 0.12, MEMORY)
    assert found
    assert max(found, key=lambda one: one.stop - one.start).rate == pytest.approx(3.0, rel=1e-3)


def test_a_table_that_goes_along_or_is_all_that_was_read_is_said_to() -> None:
    t = np.arange(1, 1501) * PERIOD
    command, motor = after_motion(0.05 / 3.0 * (1.0 - np.exp(-3.0 * t)))
    both = AxisLog(command=command, motor=noisy(motor), table=noisy(motor, 2))
    alone = AxisLog(command=command, table=noisy(motor))
    for record in (both, alone):
        (found,) = find_coast_downs(record, PERIOD, NOISE, 0.0, MEMORY)
        assert found.coupled


def test_several_are_pooled_by_their_errors() -> None:
    first = CoastDown(0, 1, 2.0, 0.1, False)
    second = CoastDown(2, 3, 4.0, 0.2, False)
    rate, error = pooled_rate([first, second])
    assert rate == pytest.approx((2.0 * 100.0 + 4.0 * 25.0) / 125.0)
    assert error == pytest.approx(125.0**-0.5)
