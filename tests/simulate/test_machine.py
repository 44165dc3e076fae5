"""The whole machine in simulation, against an independent integration of the same equations."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from msgspec.structs import replace
from support.circle import circle
from support.drives import AMPLITUDE, OMEGA, PAPER_GAP
from support.drives import axis as paper_axis
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
    random_axis,
    random_command,
    reference,
)
from support.reference_machine import Motion

from ph_post.simulate.machine import simulate
from ph_post.types import EffectSetting, Feedback, Pickup, Run, Scenario


def run_case(case: Case, moving: bool = False) -> Run:
    machine = make_machine([case.axis], case.period)
    return simulate(make_command(case.command[:, None], case.period, moving), machine)


def assert_same(run: Run, expected: Motion, within: float = 1e-9) -> None:
    theirs = contacts(expected.events)
    ours = contacts_of(run, "X")
    assert [kind for _, kind in ours] == [kind for _, kind in theirs]
    assert [t for t, _ in ours] == pytest.approx([t for t, _ in theirs], abs=1e-7 + 100.0 * (within - 1e-9))
    assert run.executed[:, 0] == pytest.approx(expected.table, abs=within)
    assert run.motor[:, 0] == pytest.approx(expected.motor, abs=within)


PICKUPS = ("standstill", "momentum", "contact")
LOAD_LOOPS = list(product(("P", "PI", "PID"), PICKUPS, ("sines", "trapezoids", "circle")))


@pytest.mark.thinned(16)
@pytest.mark.parametrize(("control", "pickup", "kind"), LOAD_LOOPS)
def test_load_loops(control: str, pickup: Pickup, kind: str) -> None:
    rng = np.random.default_rng([len(control), len(pickup), len(kind)])
    case = Case(random_axis(rng, "load", pickup, control, 0.25), random_command(rng, kind, 0.25, T), PERIOD)
    assert_same(run_case(case), reference(case))


@pytest.mark.parametrize("feedback", ["motor", "none"])
@pytest.mark.parametrize("flank", [1, -1])
def test_gap_outside_the_loop(feedback: Feedback, flank: int) -> None:
    case = Case(make_axis(feedback, **SOFT, flank=flank), WAVES, PERIOD)
    run = run_case(case)
    assert_same(run, reference(case))
    assert np.abs(run.executed - run.motor).max() == pytest.approx(2e-4, abs=1e-12)


@pytest.mark.parametrize("flank", [1, -1])
def test_ideal_stepper(flank: int) -> None:
    case = Case(make_axis("none", 0.0, 0.0, 4e-4, flank=flank), WAVES, PERIOD)
    run = run_case(case)
    assert_same(run, reference(case))
    assert run.motor[:, 0] == pytest.approx(WAVES, abs=1e-15)


EFFECTS = {
    "coulomb": [effect("coulomb_friction", following_error_mm=0.2)],
    "sticks at once": [
        effect(
            "stribeck_friction",
            following_error_mm=0.1,
            static_following_error_mm=0.3,
            stribeck_velocity_mm_s=0.0,
        )
    ],
    "viscous": [effect("viscous_friction", following_error_s=0.01)],
    "asymmetric": [effect("friction_asymmetry", plus_following_error_s=0.01, minus_following_error_s=-0.006)],
    "asymmetric and dry": [
        effect("viscous_friction", following_error_s=0.002),
        effect("friction_asymmetry", plus_following_error_s=-0.004, minus_following_error_s=0.003),
        effect("coulomb_friction", following_error_mm=0.1),
    ],
    "asymmetric, even at a speed": [
        effect("load_offset", following_error_mm=0.1),
        effect("friction_asymmetry", plus_following_error_s=0.01, minus_following_error_s=-0.006, even_at_mm_s=25.0),
    ],
    "load towards minus": [effect("load_offset", following_error_mm=0.3)],
    "load towards plus": [effect("load_offset", following_error_mm=-0.3)],
    "load beyond friction": [
        effect("coulomb_friction", following_error_mm=0.1),
        effect("load_offset", following_error_mm=0.15),
    ],
    "friction beyond load": [
        effect("coulomb_friction", following_error_mm=0.15),
        effect("load_offset", following_error_mm=-0.1),
    ],
    "weak motor": [effect("torque_saturation", following_error_mm=2.0)],
    "late": [effect("transport_delay", delay_ms=6.0)],
    "half impact": [effect("engagement_impact", kept=0.5)],
    "everything": [
        effect("coulomb_friction", following_error_mm=0.05),
        effect("viscous_friction", following_error_s=0.004),
        effect("load_offset", following_error_mm=0.1),
        effect("torque_saturation", following_error_mm=2.5),
        effect("transport_delay", delay_ms=4.0),
    ],
}


@pytest.mark.thinned(18)
@pytest.mark.parametrize(("flank", "pickup", "name"), list(product((1, -1), PICKUPS, EFFECTS)))
def test_effects_inside_the_loop(name: str, pickup: Pickup, flank: int) -> None:
    axis = make_axis("load", **SOFT, pickup=pickup, flank=flank, effects=EFFECTS[name])
    case = Case(axis, WAVES, PERIOD)
    assert_same(run_case(case), reference(case))


OUTSIDE = [name for name in EFFECTS if name != "half impact"]
# The other way round on the other side: so each of them is among one in two.
BOTH_SIDES = [*product(OUTSIDE, [1]), *(pytest.param(name, -1, marks=pytest.mark.slow) for name in reversed(OUTSIDE))]


@pytest.mark.parametrize(("name", "flank"), BOTH_SIDES)
@pytest.mark.thinned(12)
def test_effects_with_the_gap_outside(name: str, flank: int) -> None:
    case = Case(make_axis("motor", **SOFT, flank=flank, effects=EFFECTS[name]), WAVES, PERIOD)
    assert_same(run_case(case), reference(case))


def test_stribeck_friction_converges() -> None:
    """The engine takes it as linear over an eighth of a sample, which is wrong by the square of that."""
    friction = effect(
        "stribeck_friction",
        following_error_mm=0.1,
        static_following_error_mm=0.3,
        stribeck_velocity_mm_s=20.0,
    )
    errors = []
    for parts in (1, 2, 4):
        period = PERIOD / parts
        t = period * np.arange(100 * parts + 1)
        case = Case(make_axis("load", **SOFT, effects=[friction]), np.interp(t, T, WAVES), period)
        run, expected = run_case(case), reference(case)
        assert len(contacts(expected.events)) == len(contacts_of(run, "X"))
        errors.append(np.abs(run.executed[:, 0] - expected.table).max())
    assert errors[0] < 1e-7
    assert errors[1] < errors[0] / 3.0
    assert errors[2] < errors[1] / 3.0


def test_delay_between_two_samples() -> None:
    """The engine takes the delayed command as linear between samples too: wrong by some chords, Ẍ h² / 8."""
    case = Case(make_axis("load", **SOFT, effects=[effect("transport_delay", delay_ms=1.0)]), WAVES, PERIOD)
    chord = np.abs(np.diff(WAVES, 2)).max() / 8.0
    run, expected = run_case(case), reference(case)
    assert run.executed[:, 0] == pytest.approx(expected.table, abs=3.0 * chord)


def test_load_pushes_the_table_after_a_motor_that_gives_way() -> None:
    """At rest, where the controller pulls back less than the load pushes: they stay in touch."""
    axis = make_axis(
        "load",
        2.7e-3,
        0.094,
        8.7e-5,
        eta=0.87,
        beta=28.0,
        effects=[effect("load_offset", following_error_mm=3.0)],
    )
    case = Case(axis, -0.07 + 0.02 * np.cos(12.0 * T), PERIOD)
    run = run_case(case)
    assert all(event.kind != "chatters" for event in run.events)
    assert_same(run, reference(case))


def test_load_keeps_a_play_on_its_flank_from_the_start() -> None:
    """Whatever flank the file says: a table that hangs on the motor starts there."""
    hanging = effect("load_offset", following_error_mm=0.3)
    ends = []
    for flank in (1, -1):
        case = Case(make_axis("motor", **SOFT, flank=flank, effects=[hanging]), WAVES, PERIOD)
        run = run_case(case)
        assert run.motor - run.executed == pytest.approx(2e-4, abs=1e-12)
        ends.append(run.executed[-1, 0])
    assert ends[0] == ends[1]


def test_motor_that_swings_back_within_a_sample() -> None:
    """A jump of the command's slope, a motor at its limit: off the flank, back, and off again in 1 ms."""
    slow, fine = (_jumping(period) for period in (2e-3, 2.5e-4))
    assert_same(run_case(slow), reference(slow))
    assert run_case(slow).executed[-1, 0] == pytest.approx(run_case(fine).executed[-1, 0], abs=1e-9)


def _jumping(period: float) -> Case:
    axis = make_axis(
        "load",
        4e-4,
        0.01,
        2e-4,
        eta=0.3,
        beta=2.0,
        kd=8e-3,
        ki=2.0,
        pickup="contact",
        effects=[effect("torque_saturation", following_error_mm=1.0)],
    )
    t = period * np.arange(round(0.4 / period) + 1)
    coarse = 2e-3 * np.arange(201)
    return Case(axis, np.interp(t, coarse, 0.01 * np.sign(np.sin(31.0 * coarse)) * np.sin(31.0 * coarse) ** 2), period)


@pytest.mark.parametrize("pickup", ["standstill", "momentum", "contact"])
@pytest.mark.thinned(2)
def test_axes_do_not_know_of_each_other(pickup: Pickup) -> None:
    """Three axes with drives of their own, each as if it were alone; the events are sorted."""
    rng = np.random.default_rng(3)
    axes = [replace(random_axis(rng, "load", pickup, "P", 0.05), name=name) for name in "XYZ"]
    position = np.stack([random_command(rng, "sines", 0.05, T) for _ in axes], axis=1)
    run = simulate(make_command(position, PERIOD), make_machine(axes, PERIOD))
    for k, axis in enumerate(axes):
        expected = reference(Case(axis, position[:, k], PERIOD))
        assert run.executed[:, k] == pytest.approx(expected.table, abs=1e-9)
        assert len(contacts_of(run, axis.name)) == len(contacts(expected.events))
    times = [event.t for event in run.events]
    assert times == sorted(times)


@pytest.mark.parametrize("feedback", ["load", "motor"])
def test_motion_that_has_begun_before_the_first_sample(feedback: Feedback) -> None:
    """It starts with the path's speed (five samples give it to 1e-7), on the flank that pushes that way."""
    t = PERIOD * np.arange(201)
    case = Case(make_axis(feedback, **SOFT, flank=1), 0.01 * np.cos(4.0 * t + 1.0), PERIOD)
    expected = reference(case, speed=-0.04 * np.sin(1.0))
    assert_same(run_case(case, moving=True), expected, within=2e-9)


def test_scenario_stands_in_place_of_the_file() -> None:
    """Factors on gap, β and C, and the rule, as if the file had them."""
    plain = make_axis("load", **SOFT)
    other = make_axis("load", **{**SOFT, "gap": 6e-4, "beta": 6.0, "eta": 0.4 / 1.25}, pickup="contact", flank=-1)
    open_file = replace(plain, gap=replace(plain.gap, initial_flank="unknown", pickup=None))
    scenario = Scenario(pickup="contact", flank="-", gap=1.5, beta=1.5, gain=1.25)
    command = make_command(WAVES[:, None], PERIOD)
    run = simulate(command, make_machine([open_file], PERIOD), scenario)
    assert_same(run, reference(Case(other, WAVES, PERIOD)))


def test_events_count_time_as_the_command_does() -> None:
    """A command may begin at any time; nothing else depends on when."""
    machine = make_machine([make_axis("load", **SOFT)], PERIOD)
    command = make_command(WAVES[:, None], PERIOD)
    at_zero, later = simulate(command, machine), simulate(replace(command, t=command.t - 3.0), machine)
    assert [event.kind for event in later.events] == [event.kind for event in at_zero.events]
    assert [event.t + 3.0 for event in later.events] == pytest.approx([event.t for event in at_zero.events])
    assert np.array_equal(later.executed, at_zero.executed)


def test_worked_example() -> None:
    """Section 4.2: lag and duration of the settled reversal, by chords of 1 ms."""
    t = 1e-3 * np.arange(15_201)
    machine = make_machine([paper_axis(gap=PAPER_GAP)], 1e-3)
    run = simulate(make_command(AMPLITUDE * np.sin(OMEGA * t)[:, None], 1e-3, moving=True), machine)
    times = np.array([event.t for event in run.events])
    assert [event.kind for event in run.events] == ["opens", "picks up"] * 3
    assert times[::2] - [3.0, 9.0, 15.0] == pytest.approx([0.005000546, 0.005000674, 0.005000674], abs=1e-7)
    assert np.diff(times)[::2] == pytest.approx([0.11874297] * 3, abs=2e-7)
    assert run.executed[9_050, 0] == pytest.approx(-0.25003341707, abs=1e-8)


@pytest.mark.parametrize(
    ("ratio", "largest"),
    [(1.0, 2.19e-3), (0.25, 1.36e-3), (-0.3, 1.05e-3), (-0.4, 2.09e-3), (-0.45, 2.76e-3)],
)
def test_every_reversal_of_the_circle_of_section_6(ratio: float, largest: float) -> None:
    command = circle(ratio, 1e-3)
    axes = [replace(paper_axis(gap=PAPER_GAP), name=name) for name in "XY"]
    position = np.stack([command.X, command.Y], axis=1)
    run = simulate(make_command(position, 1e-3, moving=True), make_machine(axes, 1e-3))
    assert np.abs(command.error(*run.executed.T)).max() == pytest.approx(largest, rel=0.03)


def test_an_asymmetry_of_nothing_is_none() -> None:
    """And one of the same both ways is viscous friction."""

    def run(*effects: EffectSetting) -> Run:
        return run_case(Case(make_axis("load", **SOFT, effects=effects), WAVES, PERIOD))

    none = effect("friction_asymmetry", plus_following_error_s=0.0, minus_following_error_s=0.0)
    both = effect("friction_asymmetry", plus_following_error_s=0.004, minus_following_error_s=0.004)
    assert np.array_equal(run(none).executed, run().executed)
    same = run(effect("viscous_friction", following_error_s=0.004))
    assert np.array_equal(run(both).executed, same.executed)


@pytest.mark.parametrize("way", [1, -1])
def test_an_axis_that_moved_down_last_stands_above_its_motor(way: int) -> None:
    run = run_case(Case(make_axis("motor", **SOFT, flank=way), np.zeros(50), PERIOD))
    assert run.motor - run.executed == pytest.approx(way * 2e-4, abs=1e-12)
