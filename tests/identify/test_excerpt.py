"""Excerpts of long logs: of every kind of motion something, and nothing that a model has not settled from."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from support.engine_cases import make_axis, make_machine
from support.linear_response import response

from ph_post.identify.excerpt import KEPT, MOST, excerpt
from ph_post.identify.free_run import problem_of, residuals, split_evenly
from ph_post.identify.log_quality import examine
from ph_post.types import AxisLog, Log

Array = NDArray[np.float64]
B, C, GAP = 7e-5, 6.4e-3, 20e-6
MM, UM = 1e-3, 1e-6


def shop_floor(seconds: float, period: float = 1e-3) -> Array:
    """Slow work that goes on and on; once a quick one, once far out, once a rest."""
    t = period * np.arange(round(seconds / period))
    # Time itself stops for two seconds, and goes on.
    away = np.clip(2.0 - np.abs(t - 0.9 * seconds - 1.0), 0.0, 1.0)
    t = period * np.cumsum(1.0 - away * away * (3.0 - 2.0 * away))
    at = 4.0 * MM * np.sin(2.0 * np.pi * 0.31 * t) + 2.0 * MM * np.sin(2.0 * np.pi * 0.173 * t)
    for middle, size, rate in ((0.31, 5.0 * MM, 2.5), (0.72, 40.0 * MM, 0.2)):
        near = np.exp(-(((t - middle * seconds) / 1.2) ** 2))
        at += size * near * np.sin(2.0 * np.pi * rate * t)
    return np.asarray(at - at[0])


def play(motor: Array, gap: float) -> Array:
    """A table that friction holds in its gap, sample by sample."""
    table, out = motor[0], np.empty_like(motor)
    for k, at in enumerate(motor.tolist()):
        table = min(max(table, at - 0.5 * gap), at + 0.5 * gap)
        out[k] = table
    return out


@cache
def logged(seconds: float, period: float = 1e-3) -> Log:
    command = shop_floor(seconds, period)
    a = np.array([[0.0, 1.0], [-1.0 / B, -C / B]])
    t = period * np.arange(command.size)
    motor = response((a, [[0.0], [1.0 / B]], [[1.0, 0.0]], 0.0), command, t)
    axes = {"X": AxisLog(command=command, table=play(motor, GAP), motor=motor)}
    return Log(name="shop", t=t, period=period, axes=axes)


def until(log: Log, seconds: float) -> Log:
    """Cut a log off, as before the rest with which work ends."""
    rows = round(seconds / log.period)
    axes = {
        name: AxisLog(
            command=axis.command[:rows],
            table=None if axis.table is None else axis.table[:rows],
            motor=None if axis.motor is None else axis.motor[:rows],
        )
        for name, axis in log.axes.items()
    }
    return replace(log, t=log.t[:rows], axes=axes)


MACHINE = make_machine([make_axis("motor", B, C, GAP)], 1e-3)


def test_a_short_log_is_taken_whole() -> None:
    log = until(logged(20.0), 18.0)
    assert excerpt(log, MACHINE) is log


def test_of_quick_rows_as_many_are_taken_as_there_may_be() -> None:
    """Filters of the command are told from delays by rows closer together than those of a drive."""
    log = logged(9.0, 1e-4)
    short = excerpt(log, MACHINE)
    assert short.period == pytest.approx(3e-4)
    assert short.t.size == MOST
    assert np.array_equal(short.axes["X"].command, log.axes["X"].command[::3])
    assert short.counted is None


@pytest.mark.parametrize("period", [1e-3, 5e-4])
@pytest.mark.thinned(8)
def test_an_excerpt_shows_what_is_rare_and_is_no_longer_than_it_may(period: float) -> None:
    seconds = 150.0
    log = logged(seconds, period)
    short = excerpt(log, MACHINE)
    assert short.period == pytest.approx(1e-3)
    assert short.t.size < 1.3 * KEPT * MOST
    assert short.counted is not None
    assert np.all(np.diff(short.t) > 0.0)
    for middle in (0.31, 0.72, 0.915):  # the rest is at 0.907 to 0.92
        assert any(start - 1.0 < middle * seconds < stop for start, stop in short.windows)


def test_the_command_of_an_excerpt_is_one_motion_no_quicker_than_the_log() -> None:
    log = logged(150.0)
    short = excerpt(log, MACHINE)
    for order in (1, 2):
        whole, part = (np.max(np.abs(np.diff(one.axes["X"].command, order))) for one in (log, short))
        assert part <= 1.25 * whole


def test_the_true_plant_runs_through_an_excerpt_and_leaves_nothing_where_it_counts() -> None:
    log = logged(150.0)
    short = excerpt(log, MACHINE)
    quality = examine(short, MACHINE)
    assert [one.missing for one in quality.channels] == [0, 0]
    problem = problem_of(short, "X", MACHINE.axes["X"], quality)
    assert problem is not None
    left = residuals(problem, problem.plant)
    for one in problem.observed:
        assert np.count_nonzero(problem.counted & one.ok) > 0.6 * KEPT * MOST
        assert np.max(np.abs(left[one.channel][problem.counted])) < 0.05 * UM
    again = split_evenly(problem, left)
    assert not np.any(again.counted & ~problem.counted)
    wrong = residuals(problem, replace(problem.plant, gap=0.0))
    assert math.sqrt(np.mean(wrong["act"][problem.counted] ** 2)) > 0.4 * GAP


def rested(log: Log, before: float, after: float, creep: float = 0.0) -> Log:
    """Put rests around a log that begins and ends in rest, with noise of their own; the last one creeps [m]."""
    rng = np.random.default_rng(3)
    head, tail = (round(seconds / log.period) for seconds in (before, after))

    def around(values: Array, noise: float, by: float) -> Array:
        ends = (np.full(head, values[0]), values[-1] + by * np.linspace(0.0, 1.0, tail))
        return np.concatenate(
            [ends[0] + noise * rng.standard_normal(head), values, ends[1] + noise * rng.standard_normal(tail)]
        )

    axes = {
        name: AxisLog(
            command=around(axis.command, 0.0, 0.0),
            table=None if axis.table is None else around(axis.table, 0.2 * UM, creep),
            motor=None if axis.motor is None else around(axis.motor, 0.2 * UM, creep),
        )
        for name, axis in log.axes.items()
    }
    return replace(log, t=log.period * np.arange(log.t.size + head + tail), axes=axes)


def test_long_rests_at_both_ends_are_left_out() -> None:
    log = until(logged(8.0), 7.0)
    long = excerpt(rested(log, 20.0, 40.0), MACHINE)
    short = excerpt(rested(log, 1.5, 1.5), MACHINE)
    assert long.t.size == short.t.size
    assert long.t[0] == pytest.approx(19.0, abs=0.01)
    for found in (long, short):
        assert found.windows == ()
        assert np.array_equal(found.axes["X"].command[1000:-1000], log.axes["X"].command)


def test_a_rest_in_which_something_creeps_stays() -> None:
    crept = excerpt(rested(until(logged(8.0), 7.0), 1.5, 10.0, creep=5.0 * UM), MACHINE)
    assert crept.t[-1] == pytest.approx(18.5, abs=0.01)
