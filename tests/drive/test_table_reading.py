"""Effects on the reading: against their formulas, and that the drive knows nothing of them."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace
from support.engine_cases import ACROSS as Y
from support.engine_cases import PERIOD, SOFT, effect, make_axis, make_command, make_machine
from support.engine_cases import WAVES as X

from ph_post.api.inputs import machine_warnings
from ph_post.drive.effects.active import plant_of, unmoved_axes
from ph_post.drive.plant import Plant, TableReading, read_table
from ph_post.simulate.machine import axis_command, run_plant, simulate
from ph_post.types import EffectSetting, Feedback, Run, Scenario

CYCLE = effect("cyclic_error", amplitude_mm=0.003, period_mm=2.5, phase_deg=30.0)
FINE_CYCLE = effect("cyclic_error", amplitude_mm=0.001, period_mm=0.02)
SCALE = effect("scale_error", error=4e-5)
GROWTH = effect("thermal_growth", growth_mm=0.02, time_constant_s=0.3)
SQUARE = effect("squareness", angle_rad=2e-4)
ALL = (CYCLE, FINE_CYCLE, SCALE, GROWTH, SQUARE)


def run(*effects: EffectSetting, feedback: Feedback = "load", begin: float = 0.0) -> Run:
    """Both axes; the effects are those of X."""
    drives = [make_axis(feedback, **SOFT, effects=effects), make_axis(feedback, **SOFT, name="Y")]
    command = make_command(np.stack([X, Y], axis=1), PERIOD)
    return simulate(replace(command, t=command.t + begin), make_machine(drives, PERIOD))


@cache
def plain() -> Run:
    """Without effects; run where a test asks for it, so that whoever collects tests has nothing compiled."""
    return run()


def formula(k: int, x: float, y: float) -> float:
    """What all of them add to a sample, written out."""
    return (
        3e-6 * math.sin(2.0 * math.pi * x / 2.5e-3 + math.pi / 6.0)
        + 1e-6 * math.sin(2.0 * math.pi * x / 2e-5)
        + 4e-5 * x
        + 2e-5 * (1.0 - math.exp(-k * PERIOD / 0.3))
        + 2e-4 * y
    )


@pytest.mark.parametrize("begin", [0.0, 1e3])
def test_each_sample_is_read_by_the_formulas(begin: float) -> None:
    """Wherever the clock of the command begins."""
    read = run(*ALL, begin=begin).executed[:, 0]
    where = plain().executed
    expected = [x + formula(k, x, y) for k, (x, y) in enumerate(where.tolist())]
    assert read == pytest.approx(expected, abs=1e-17)
    assert np.abs(read - where[:, 0]).max() > 1e-5


@pytest.mark.parametrize("feedback", ["load", "motor", "none"])
def test_neither_the_motor_nor_the_other_axis_nor_the_events_know(feedback: Feedback) -> None:
    ours, bare = run(*ALL, feedback=feedback), run(feedback=feedback)
    assert np.array_equal(ours.motor, bare.motor)
    assert np.array_equal(ours.executed[:, 1], bare.executed[:, 1])
    assert ours.events == bare.events


def test_what_they_add_adds_up_in_any_order() -> None:
    parts = sum(run(one).executed - plain().executed for one in ALL)
    for order in (ALL, ALL[::-1]):
        assert run(*order).executed - plain().executed == pytest.approx(parts, abs=1e-16)


@pytest.mark.parametrize(
    "nothing",
    [
        effect("cyclic_error", amplitude_mm=0.0, period_mm=2.5),
        effect("scale_error", error=0.0),
        effect("thermal_growth", growth_mm=0.0, time_constant_s=0.3),
        effect("squareness", angle_rad=0.0),
    ],
)
def test_no_size_is_no_effect(nothing: EffectSetting) -> None:
    assert np.array_equal(run(nothing).executed, plain().executed)


def test_nothing_set_gives_the_table_itself() -> None:
    table = np.array([1.0, 2.0])
    assert read_table(Plant(feedback="load", b=1.0, c=1.0), table, table, {}) is table


def test_two_axes_that_read_each_other_do_so_where_they_are() -> None:
    """Not where they are read: the order of the axes is none of their business."""
    back = EffectSetting(name="squareness", parameters={"angle_rad": 1e-3, "other": "X"})
    drives = [
        make_axis("load", **SOFT, effects=[SQUARE, SCALE]),
        make_axis("load", **SOFT, name="Y", effects=[back]),
    ]
    found = simulate(make_command(np.stack([X, Y], axis=1), PERIOD), make_machine(drives, PERIOD)).executed
    x, y = plain().executed.T
    assert found[:, 0] == pytest.approx(x + 4e-5 * x + 2e-4 * y, abs=1e-17)
    assert found[:, 1] == pytest.approx(y + 1e-3 * x, abs=1e-17)


def test_a_late_reading_is_read_late() -> None:
    """The gauge sees the true table, and tells it later."""
    late = effect("transport_delay", delay_ms=4.0)
    late = EffectSetting(name=late.name, parameters={**late.parameters, "where": "reading"})
    found, table = run(late, SCALE).executed[:, 0], plain().executed[:, 0]
    assert found[2:] == pytest.approx((1.0 + 4e-5) * table[:-2], abs=1e-16)


def test_a_plant_runs_without_its_reading() -> None:
    command = make_command(X[:, None], PERIOD)
    plant = plant_of(make_axis("load", **SOFT, effects=ALL), Scenario())
    assert plant.reading != TableReading()
    table = run_plant(axis_command(command, 0), plant, 1, PERIOD)[0]
    assert np.array_equal(table, plain().executed[:, 0])


def test_an_axis_that_nothing_moves_counts_as_zero_and_is_told() -> None:
    axis = make_axis("load", **SOFT, effects=[SQUARE])
    alone = simulate(make_command(X[:, None], PERIOD), make_machine([axis], PERIOD))
    assert np.array_equal(alone.executed[:, 0], plain().executed[:, 0])
    assert unmoved_axes(axis, ("X",)) == ("Y",)
    machine = make_machine([axis, make_axis("load", **SOFT, name="Y")], PERIOD)
    said = "axis X: its squareness to Y does not show, because nothing moves Y"
    assert machine_warnings(machine, ("X",)) == (said,)
    assert machine_warnings(machine, ("X", "Y")) == ()
