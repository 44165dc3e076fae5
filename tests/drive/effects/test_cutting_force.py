"""Cutting forces: by hand, against an independent integration, and their laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from support.engine_cases import ACROSS as Y
from support.engine_cases import PERIOD, T, effect, make_axis, make_command, make_machine
from support.engine_cases import WAVES as X

from ph_post.drive.plant import Plant
from ph_post.simulate.machine import AxisCommand, cutting_force, path_velocity, run_plant, simulate
from ph_post.types import Command, EffectSetting, Feedback, Run

B, C, ETA, BETA, GAP = 4e-4, 0.02, 0.4, 4.0, 4e-4
SOFT = {"b": B, "c": C, "eta": ETA, "beta": BETA}
CUT = effect("cutting_force", following_error_mm=0.2, feed_mm_min=6000.0, exponent=0.8)
PULL = effect("cutting_force", following_error_mm=-0.05)


def run(*effects: EffectSetting, feedback: Feedback = "load", gap: float = 0.0, **more: float) -> Run:
    drives = [
        make_axis(feedback, **{**SOFT, **more}, gap=gap, effects=effects),
        make_axis(feedback, **SOFT, gap=gap, name="Y"),
    ]
    return simulate(make_command(np.stack([X, Y], axis=1), PERIOD), make_machine(drives, PERIOD))


def pushed() -> NDArray[np.float64]:
    """What resists X, sample by sample, written out."""
    dx, dy = np.gradient(X, PERIOD), np.gradient(Y, PERIOD)
    feed = np.hypot(dx, dy)
    return (2e-4 * (feed / 0.1) ** 0.8 - 5e-5) * dx / feed


def integrated(force: NDArray[np.float64]) -> NDArray[np.float64]:
    """An axis without a gap under a force that is linear between samples."""
    y, found = np.array([X[0], 0.0]), [X[0]]
    for k in range(T.size - 1):

        def rate(t: float, y: NDArray[np.float64], k: int = k) -> list[float]:
            part = (t - T[k]) / PERIOD
            u = X[k] + part * (X[k + 1] - X[k]) - y[0]
            return [y[1], (u - C * y[1] - force[k] - part * (force[k + 1] - force[k])) / B]

        y = solve_ivp(rate, (T[k], T[k + 1]), y, method="DOP853", rtol=1e-12, atol=1e-16).y[:, -1]
        found.append(y[0])
    return np.array(found)


@pytest.mark.parametrize("feedback", ["load", "motor", "none"])
def test_against_an_integration(feedback: Feedback) -> None:
    """Between samples the force is linear, and so exact."""
    expected = integrated(pushed())
    found = run(CUT, PULL, feedback=feedback)
    assert found.executed[:, 0] == pytest.approx(expected, abs=1e-12)
    assert np.array_equal(found.executed[:, 1], run(feedback=feedback).executed[:, 1])
    assert np.abs(expected - run(feedback=feedback).executed[:, 0]).max() > 1e-4


def test_behind_a_gap_outside_the_loop() -> None:
    """The motor feels it, gap or not."""
    found = run(CUT, PULL, feedback="motor", gap=GAP)
    assert found.motor[:, 0] == pytest.approx(integrated(pushed()), abs=1e-12)
    assert np.all(np.abs(found.motor - found.executed) <= 0.5 * GAP + 1e-15)


@pytest.mark.parametrize("pickup", ["standstill", "momentum", "contact"])
def test_inside_the_loop_as_a_python_function_of_time(pickup: str) -> None:
    """In the gap it is the table that feels it; friction holds that, or not."""
    force = pushed()
    plant = Plant(
        feedback="load",
        b=B,
        c=C,
        eta=ETA,
        beta=BETA,
        gap=GAP,
        pickup=pickup,
        coulomb_plus=8e-5,
        coulomb_minus=8e-5,
    )
    by_hand = replace(plant, forces=(lambda t, x, v, way: float(np.interp(t, T, force)),))
    given = run_plant(AxisCommand(X, 0.0, 0.0, force=force), plant, 1, PERIOD)
    called = run_plant(AxisCommand(X, 0.0, 0.0), by_hand, 1, PERIOD)
    assert given[0] == pytest.approx(called[0], abs=1e-10)
    assert given[1] == pytest.approx(called[1], abs=1e-10)
    assert given[2].log.tolist() == called[2].log.tolist()
    assert np.abs(given[0] - run_plant(AxisCommand(X, 0.0, 0.0), plant, 1, PERIOD)[0]).max() > 1e-4


def test_beside_a_python_function() -> None:
    """The slow engine takes it too."""
    plant = Plant(feedback="load", b=B, c=C)
    slow = replace(plant, forces=(lambda t, x, v, way: 0.0,))
    given = run_plant(AxisCommand(X, 0.0, 0.0, force=pushed()), plant, 1, PERIOD)[0]
    assert run_plant(AxisCommand(X, 0.0, 0.0, force=pushed()), slow, 1, PERIOD)[0] == pytest.approx(given, abs=1e-12)


def test_beside_stribeck_friction() -> None:
    """What is taken as linear over parts of a sample for the one is so for the other."""
    plant = Plant(feedback="load", b=B, c=C, coulomb_plus=1e-5, coulomb_minus=1e-5, static=2e-5, stribeck_speed=0.02)
    by_hand = replace(plant, forces=(lambda t, x, v, way: float(np.interp(t, T, pushed())),))
    given = run_plant(AxisCommand(X, 0.0, 0.0, force=pushed()), plant, 1, PERIOD)[0]
    assert given == pytest.approx(run_plant(AxisCommand(X, 0.0, 0.0), by_hand, 1, PERIOD)[0], abs=1e-8)


def test_by_hand() -> None:
    plant = Plant(feedback="load", b=B, c=C, cutting=((1e-4, 0.05, 0.5), (-2e-5, 0.01, 0.0)))
    velocity = np.array([[0.12, 0.16], [-0.03, 0.04], [0.0, 0.05], [0.0, 0.0], [1e-10, 0.0]])
    first = [0.6 * (2e-4 - 2e-5), -0.6 * (1e-4 - 2e-5), 0.0, 0.0, 0.0]
    second = [0.8 * (2e-4 - 2e-5), 0.8 * (1e-4 - 2e-5), 1e-4 - 2e-5, 0.0, 0.0]
    assert cutting_force(plant, velocity, 0) == pytest.approx(first, abs=1e-18)
    assert cutting_force(plant, velocity, 1) == pytest.approx(second, abs=1e-18)


def test_steady_cutting_adds_its_following_error() -> None:
    """On a straight line at 30° and one feed."""
    t = PERIOD * np.arange(501)
    way = np.stack([math.cos(math.pi / 6) * 0.05 * t, 0.5 * 0.05 * t], axis=1)
    cut = effect("cutting_force", following_error_mm=0.2, feed_mm_min=3000.0)
    drives = [make_axis("load", **SOFT, gap=0.0, effects=[cut], name=name) for name in "XY"]
    found = simulate(make_command(way, PERIOD, moving=True), make_machine(drives, PERIOD)).executed[-1]
    lag = way[-1] - found
    assert lag == pytest.approx((C * 0.05 + 2e-4) * np.array([math.cos(math.pi / 6), 0.5]), abs=1e-9)


def test_an_integrator_begins_with_what_it_needs() -> None:
    way = 0.05 * T[:, None]
    axis = make_axis("load", **SOFT, gap=0.0, ki=2.0, effects=[CUT])
    found = simulate(make_command(way, PERIOD, moving=True), make_machine([axis], PERIOD))
    assert found.executed == pytest.approx(way, abs=1e-12)


def test_what_is_added_to_the_path_does_not_cut() -> None:
    position = np.stack([X, Y], axis=1)
    offset = np.zeros_like(position)
    offset[100:, 0] = 3e-4
    plain: Command = make_command(position, PERIOD)
    jogged = replace(plain, position=position + offset, offset=offset)
    assert path_velocity(jogged) == pytest.approx(path_velocity(plain), abs=1e-13)


def test_no_size_is_no_effect() -> None:
    nothing = effect("cutting_force", following_error_mm=0.0)
    for feedback in ("load", "motor"):
        assert np.array_equal(
            run(nothing, feedback=feedback, gap=GAP).executed, run(feedback=feedback, gap=GAP).executed
        )


def test_forces_add_up_without_a_gap() -> None:
    """The drive is linear then."""
    plain = run().executed
    parts = sum(run(one).executed - plain for one in (CUT, PULL))
    assert run(CUT, PULL).executed - plain == pytest.approx(parts, abs=1e-13)
    assert run(PULL, CUT).executed == pytest.approx(run(CUT, PULL).executed, abs=1e-15)
