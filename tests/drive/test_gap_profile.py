"""A gap that differs from place to place: against an independent integration, and its laws."""

from __future__ import annotations

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
from ph_post.drive.plant import GapProfile, Plant, gap_at, table_behind
from ph_post.simulate.assess import scenarios
from ph_post.simulate.machine import AxisCommand, run_plant, simulate
from ph_post.types import EffectSetting, Feedback, Run, Scenario


def worn(slope: float = 0.0, bump: float = 0.0, reference: float = 3.0) -> EffectSetting:
    return effect(
        "position_dependent_backlash",
        slope_mm_per_mm=slope,
        reference_mm=reference,
        bump_mm=bump,
        centre_mm=-8.0,
        width_mm=6.0,
    )


SLOPE, BUMP, BOTH = worn(slope=5e-3), worn(bump=0.3), worn(slope=-8e-3, bump=0.2)
CLOSED = worn(slope=0.04, reference=12.0)
"""0.04 (x - 12 mm) is as much as the gap at x = 2 mm: below that there is none."""
DRY = effect("coulomb_friction", following_error_mm=0.2)


def run(
    *effects: EffectSetting,
    feedback: Feedback = "load",
    command: NDArray[np.float64] = WAVES,
    period: float = PERIOD,
    **more: float,
) -> Run:
    axis = make_axis(feedback, **{**SOFT, **more}, effects=effects)
    return simulate(make_command(command[:, None], period), make_machine([axis], period))


@pytest.mark.parametrize("effects", [(SLOPE,), (BUMP,), (BOTH, DRY)], ids=["slope", "bump", "both"])
@pytest.mark.parametrize("feedback", ["load", "motor"])
@pytest.mark.parametrize("flank", [1, -1])
@pytest.mark.thinned(8)
def test_against_an_integration(effects: tuple[EffectSetting, ...], feedback: Feedback, flank: int) -> None:
    axis = make_axis(feedback, **SOFT, flank=flank, effects=effects)
    ours = simulate(make_command(WAVES[:, None], PERIOD), make_machine([axis], PERIOD))
    expected = reference(Case(axis, WAVES, PERIOD))
    assert [kind for _, kind in contacts_of(ours, "X")] == [kind for _, kind in contacts(expected.events)]
    assert [t for t, _ in contacts_of(ours, "X")] == pytest.approx([t for t, _ in contacts(expected.events)], abs=1e-7)
    assert ours.executed[:, 0] == pytest.approx(expected.table, abs=1e-9)
    assert ours.motor[:, 0] == pytest.approx(expected.motor, abs=1e-9)
    plain = run(*effects[1:], feedback=feedback)
    assert np.abs(ours.motor - plain.motor).max() + np.abs(ours.executed - plain.executed).max() > 2e-5


def test_a_table_that_is_picked_up_with_momentum() -> None:
    axis = make_axis("load", **SOFT, pickup="momentum", effects=[BOTH])
    ours = simulate(make_command(WAVES[:, None], PERIOD), make_machine([axis], PERIOD))
    expected = reference(Case(axis, WAVES, PERIOD))
    assert ours.executed[:, 0] == pytest.approx(expected.table, abs=1e-9)


def test_a_table_that_runs_on_in_the_gap_comes_out_of_it() -> None:
    """The gap is taken as it was where it opened: a flank cannot run away from the table and come back."""
    axis = make_axis("load", **SOFT, pickup="contact", effects=[BOTH])
    ours = simulate(make_command(WAVES[:, None], PERIOD), make_machine([axis], PERIOD))
    kinds = [event.kind for event in ours.events]
    assert kinds.count("picks up") > 2
    assert "chatters" not in kinds
    half = 0.5 * gap_at(plant_of(axis, Scenario()), ours.executed[:, 0])
    # Half a millimetre on in the gap, 8 µm a millimetre and the bump's 20 make a hundredth.
    assert np.all(np.abs(ours.motor - ours.executed)[:, 0] <= half + 1e-5)


@pytest.mark.parametrize("feedback", ["motor", "none"])
def test_a_play_is_solved_at_the_tables_place(feedback: Feedback) -> None:
    """The motor goes its way, and where it touches, x = m - f gap(x)/2."""
    found = run(BOTH, feedback=feedback)
    assert found.motor == pytest.approx(run(feedback=feedback).motor, abs=1e-15)
    x, m = found.executed[:, 0], found.motor[:, 0]
    plant = plant_of(make_axis(feedback, **SOFT, effects=[BOTH]), Scenario())
    half = 0.5 * gap_at(plant, x)
    assert np.all(np.abs(m - x) <= half + 1e-15)
    step = np.diff(x)
    for flank in (1, -1):
        goes = (flank * step[:-1] > 1e-9) & (flank * step[1:] > 1e-9)
        assert goes.sum() > 50
        assert flank * (m - x)[1:-1][goes] == pytest.approx(half[1:-1][goes], abs=1e-15)


@pytest.mark.parametrize("feedback", ["load", "motor", "none"])
def test_a_gap_that_closes_is_none(feedback: Feedback) -> None:
    """Where it is closed the table is where its motor is, and turns round with it."""
    found = run(CLOSED, feedback=feedback, command=-WAVES)
    x, m = found.executed[:, 0], found.motor[:, 0]
    shut = x < 1.99e-3
    assert shut.sum() > 100
    assert m[shut] == pytest.approx(x[shut], abs=1e-12)
    assert all(event.kind != "chatters" for event in found.events)
    assert np.abs(m - x).max() > 1e-4


@pytest.mark.parametrize("feedback", ["load", "motor"])
def test_a_spring_takes_the_gap_as_it_goes_along(feedback: Feedback) -> None:
    """Half the gap is set at each sample: one of one size is that gap, and shorter samples tell the same."""
    windup = effect("elastic_windup", resonance_hz=60.0, damping_ratio=0.1)
    flat = effect(
        "position_dependent_backlash",
        slope_mm_per_mm=0.0,
        reference_mm=0.0,
        bump_mm=0.1,
        centre_mm=0.0,
        width_mm=1e6,
    )
    wide, plain = run(windup, flat, feedback=feedback), run(windup, feedback=feedback, gap=5e-4)
    assert wide.executed == pytest.approx(plain.executed, abs=1e-9)
    sloping = run(windup, SLOPE, feedback=feedback).executed
    t = PERIOD / 8 * np.arange(8 * 250 + 1)
    finer = run(windup, SLOPE, feedback=feedback, command=np.interp(t, T, WAVES), period=PERIOD / 8).executed
    assert sloping == pytest.approx(finer[::8], abs=2e-6)
    assert np.abs(sloping - run(windup, feedback=feedback).executed).max() > 2e-5


@pytest.mark.parametrize("feedback", ["load", "motor", "none"])
def test_no_size_is_no_effect(feedback: Feedback) -> None:
    assert np.array_equal(run(worn(), feedback=feedback).executed, run(feedback=feedback).executed)


@pytest.mark.parametrize("feedback", ["load", "motor", "none"])
def test_a_wide_bump_is_a_wider_gap(feedback: Feedback) -> None:
    flat = effect(
        "position_dependent_backlash",
        slope_mm_per_mm=0.0,
        reference_mm=0.0,
        bump_mm=0.1,
        centre_mm=0.0,
        width_mm=1e6,
    )
    wide, plain = run(flat, feedback=feedback), run(feedback=feedback, gap=5e-4)
    assert wide.executed == pytest.approx(plain.executed, abs=1e-11)
    assert wide.motor == pytest.approx(plain.motor, abs=1e-11)
    assert [one.kind for one in wide.events] == [one.kind for one in plain.events]


def test_a_gap_that_is_only_a_bump_is_one() -> None:
    found = run(worn(bump=0.3), feedback="motor", gap=0.0)
    assert {"opens", "picks up"} <= {event.kind for event in found.events}


def test_the_gap_by_hand() -> None:
    plant = Plant(
        feedback="motor",
        b=1.0,
        c=1.0,
        gap=2e-5,
        widening=GapProfile(slope=1e-4, reference=0.1, bump=4e-5, centre=0.3, width=0.02),
    )
    places = np.array([0.1, 0.3, 0.32, -0.5])
    by_hand = [2e-5, 2e-5 + 2e-5 + 4e-5, 2e-5 + 2.2e-5 + 4e-5 * 0.6065306597126334, 0.0]
    assert gap_at(plant, places) == pytest.approx(by_hand, abs=1e-18)
    for flank in (1, -1):
        table = table_behind(plant, places, flank)
        assert table + 0.5 * flank * gap_at(plant, table) == pytest.approx(places, abs=1e-16)


def test_an_axis_whose_gap_is_a_bump_begins_on_either_flank() -> None:
    """Both are tried where the file does not say which."""
    axis = make_axis("motor", **{**SOFT, "gap": 0.0}, effects=[worn(bump=0.3)])
    axis = replace(axis, gap=replace(axis.gap, initial_flank="unknown"))
    flanks = {one.flank for one in scenarios(make_machine([axis], PERIOD), ("X",))}
    assert flanks == {"+", "-"}


@pytest.mark.parametrize("feedback", ["load", "motor"])
def test_a_scenario_multiplies_all_of_the_gap(feedback: Feedback) -> None:
    axis = make_axis(feedback, **SOFT, effects=[BOTH])
    command, machine = make_command(WAVES[:, None], PERIOD), make_machine([axis], PERIOD)
    larger = plant_of(axis, Scenario(gap=1.5))
    places = np.linspace(-0.02, 0.02, 41)
    assert gap_at(larger, places) == pytest.approx(1.5 * gap_at(plant_of(axis, Scenario()), places), abs=1e-18)
    none = simulate(command, machine, Scenario(gap=0.0))
    assert np.array_equal(none.executed, run(feedback=feedback, gap=0.0).executed)


def test_an_ideal_stepper_with_a_worn_screw() -> None:
    """Its motor is where the command is, and the table behind it (b = c = 0)."""
    axis = make_axis("none", 0.0, 0.0, 4e-4, effects=[BOTH])
    ours = simulate(make_command(WAVES[:, None], PERIOD), make_machine([axis], PERIOD))
    plant, x, expected = (
        plant_of(axis, Scenario()),
        float(table_behind(plant_of(axis, Scenario()), 0.0, 1)),
        [],
    )
    for m in WAVES:
        half = 0.5 * float(gap_at(plant, x))
        if not x - half <= m <= x + half:
            x = float(table_behind(plant, m, 1 if m > x else -1))
        expected.append(x)
    assert ours.executed[:, 0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("feedback", ["load", "motor"])
def test_in_the_slow_engine(feedback: Feedback) -> None:
    """With a Python function that adds nothing."""
    plant = plant_of(make_axis(feedback, **SOFT, effects=[BOTH]), Scenario())
    slow = replace(plant, forces=(lambda t, x, v, way: 0.0,))
    ours, theirs = (run_plant(AxisCommand(WAVES, 0.0, 0.0), one, 1, PERIOD) for one in (plant, slow))
    assert theirs[0] == pytest.approx(ours[0], abs=1e-12)
    assert theirs[1] == pytest.approx(ours[1], abs=1e-12)
