"""Cogging against an independent integration of the same equations, and its laws."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from support.engine_cases import (
    PERIOD,
    SOFT,
    WAVES,
    Case,
    T,
    contacts,
    contacts_of,
    effect,
    make_axis,
    make_command,
    make_machine,
    reference,
)

from ph_post.drive.effects.active import plant_of
from ph_post.simulate import kernel, machine
from ph_post.simulate.machine import AxisCommand, run_plant, simulate
from ph_post.simulate.slow import level_for, modes_of, used_columns
from ph_post.types import EffectSetting, Feedback, Pickup, Run, Scenario

COGGING = effect("cogging", following_error_mm=0.1, period_mm=5.0, phase_deg=40.0)
FINE = effect("cogging", following_error_mm=0.02, period_mm=0.8, phase_deg=0.0)
DRY = effect("coulomb_friction", following_error_mm=0.2)
LOOPS = ("load", "motor", "none")


def run(
    *effects: EffectSetting,
    feedback: Feedback = "load",
    command: NDArray[np.float64] = WAVES,
    period: float = PERIOD,
    **more: float,
) -> Run:
    axis = make_axis(feedback, **{**SOFT, **more}, effects=effects)
    return simulate(make_command(command[:, None], period), make_machine([axis], period))


CASES = list(product([(COGGING,), (COGGING, FINE), (COGGING, DRY)], ["standstill", "momentum", "contact"], LOOPS))


@pytest.mark.thinned(12)
@pytest.mark.parametrize(("effects", "pickup", "feedback"), CASES)
def test_against_an_integration(effects: tuple[EffectSetting, ...], pickup: Pickup, feedback: Feedback) -> None:
    """A nanometre: what a part of a sample is wrong by is of its third power."""
    axis = make_axis(feedback, **SOFT, pickup=pickup, effects=effects)
    ours = simulate(make_command(WAVES[:, None], PERIOD), make_machine([axis], PERIOD))
    expected = reference(Case(axis, WAVES, PERIOD))
    assert [kind for _, kind in contacts_of(ours, "X")] == [kind for _, kind in contacts(expected.events)]
    assert ours.executed[:, 0] == pytest.approx(expected.table, abs=1e-9)
    assert ours.motor[:, 0] == pytest.approx(expected.motor, abs=1e-9)
    plain = run(*[one for one in effects if one is DRY], feedback=feedback)
    assert np.abs(ours.executed - plain.executed).max() > 1e-5


def test_on_the_flat_of_a_slow_motion_the_error_is_the_force() -> None:
    """Creeping at v the motor lags by c v + A sin(2π m/p + φ), but for b and c times its small changes."""
    t = PERIOD * np.arange(20001)
    found = run(COGGING, command=2e-4 * t, feedback="motor", gap=0.0, c=1e-3, b=1e-6).motor[5000:, 0]
    lag = 2e-4 * t[5000:] - found
    force = 1e-4 * np.sin(math.tau * found / 5e-3 + math.radians(40.0))
    assert lag == pytest.approx(1e-3 * 2e-4 + force, abs=3e-5 * 1e-3)


def test_no_size_is_no_effect() -> None:
    nothing = effect("cogging", following_error_mm=0.0, period_mm=5.0)
    assert np.array_equal(run(nothing).executed, run().executed)


def test_waves_add_up_in_any_order() -> None:
    one, other = run(COGGING, FINE), run(FINE, COGGING)
    assert one.executed == pytest.approx(other.executed, abs=1e-15)
    halves = [effect("cogging", following_error_mm=0.05, period_mm=5.0, phase_deg=40.0)] * 2
    assert run(*halves).executed == pytest.approx(run(COGGING).executed, abs=1e-14)


def test_a_period_in_degrees_of_the_motor() -> None:
    """N = 2 and r = 2 mm: 1 mm of travel a radian of the motor."""
    angle = effect("cogging", following_error_mm=0.1, period_motor_deg=math.degrees(5.0), phase_deg=40.0)
    assert run(angle).executed == pytest.approx(run(COGGING).executed, abs=1e-13)


def test_the_error_is_of_the_third_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without halving, on samples half, a quarter and an eighth as long."""
    monkeypatch.setattr(machine, "level_for", lambda plant, command: 0)
    axis = make_axis("motor", **{**SOFT, "gap": 0.0}, effects=[COGGING])
    expected = reference(Case(axis, WAVES, PERIOD)).motor
    plant = plant_of(axis, Scenario())
    errors = []
    for parts in (1, 2, 4, 8):
        t = PERIOD / parts * np.arange((T.size - 1) * parts + 1)
        trace = AxisCommand(np.interp(t, T, WAVES), 0.0, 0.0)
        errors.append(np.abs(run_plant(trace, plant, 1, PERIOD / parts)[1][::parts] - expected).max())
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx([3.0] * 3, abs=0.1)


def test_samples_are_cut_as_the_waves_need() -> None:
    def level(*effects: EffectSetting, travel: float) -> int:
        plant = plant_of(make_axis("load", **SOFT, effects=effects), Scenario())
        return level_for(plant, np.array([0.0, 0.0, -travel]))

    # 5 mm / 2π of travel are a radian of the wave; 0.1 rad is as far as one part goes.
    assert level(travel=1.0) == 0
    assert [level(COGGING, travel=5e-3 / math.tau * turn) for turn in (0.09, 0.11, 0.21, 0.79)] == [
        0,
        1,
        2,
        3,
    ]
    assert level(COGGING, FINE, travel=0.8e-3 / math.tau * 0.15) == 1
    assert level(COGGING, travel=1.0) == kernel.FINE


def test_steps_leave_out_columns_that_are_nothing() -> None:
    plants = [plant_of(make_axis("motor", **SOFT, effects=effects), Scenario()) for effects in ((), (COGGING,))]
    plain, cogged = ({*modes_of(plant, PERIOD).used.flat} - {-1} for plant in plants)
    force, command = {kernel.Column.Q, kernel.Column.Q_RATE}, {kernel.Column.COMMAND, kernel.Column.COMMAND_RATE}
    assert command < plain
    assert cogged == plain | force
    # A P loop has no integrator and no current loop, and nothing is fed forward; forces from outside may come.
    unused = {kernel.Column.INTEGRAL, kernel.Column.CURRENT, kernel.Column.FED, kernel.Column.FED_RATE}
    assert unused.isdisjoint(cogged)
    modes = modes_of(plants[0], PERIOD)
    pushed = {*used_columns(plants[0], modes.tables, pushed=True).flat} - {-1}
    assert pushed == plain | {kernel.Column.G, kernel.Column.G_RATE}


@pytest.mark.parametrize("feedback", ["load", "motor"])
def test_in_the_slow_engine(feedback: Feedback) -> None:
    """With a Python function that adds nothing."""
    plant = plant_of(make_axis(feedback, **SOFT, effects=[COGGING]), Scenario())
    slow = replace(plant, forces=(lambda t, x, v, way: 0.0,))
    ours, theirs = (run_plant(AxisCommand(WAVES, 0.0, 0.0), one, 1, PERIOD) for one in (plant, slow))
    assert theirs[0] == pytest.approx(ours[0], abs=1e-9)
    assert theirs[1] == pytest.approx(ours[1], abs=1e-9)


def test_an_integrator_begins_with_what_holds_the_motor() -> None:
    """At rest on the flank of a wave it stays there."""
    found = run(COGGING, command=np.full(51, 0.003), gap=0.0, ki=2.0)
    assert found.executed == pytest.approx(np.full((51, 1), 0.003), abs=1e-15)
