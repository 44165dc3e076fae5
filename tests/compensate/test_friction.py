"""Friction that is led: its share against the words of the effects, and plans on two masses of the tests' own."""

from __future__ import annotations

import mpmath
import numpy as np
import pytest
from long.claims import Sizes, run_table
from msgspec.structs import replace
from support.motions import look, make_machine, make_path
from support.two_masses import Body, table_of
from support.two_masses import friction_of as words_of

from ph_post.compensate.comparison import strategy_at
from ph_post.compensate.friction import (
    FrictionLead,
    direct_change,
    friction_of,
    friction_share,
    held_change,
    level,
    shortest_step,
    step,
)
from ph_post.compensate.friction_layout import STILL, find_turns
from ph_post.compensate.inverse import lead_of_force
from ph_post.compensate.motion import cycle_time, without_strategy
from ph_post.compensate.offsets import command_of, plan_time
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.prove import little_friction
from ph_post.compensate.violations import check_command
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.files.storage import or_shipped
from ph_post.geometry.curves import Arc
from ph_post.types import Cascade, Command, EffectSetting, FrictionChange, Servo

pytestmark = pytest.mark.drawn(4)

UM = 1e-6


def effect(name: str, **parameters: float) -> EffectSetting:
    return EffectSetting(name=name, parameters=parameters)


COULOMB = effect("coulomb_friction", following_error_mm=0.03)
STRIBECK = effect(
    "stribeck_friction",
    following_error_mm=0.02,
    static_following_error_mm=0.03,
    stribeck_velocity_mm_s=3.0,
)
DIRECTED = (
    COULOMB,
    effect("viscous_friction", following_error_s=0.002),
    effect("friction_asymmetry", plus_following_error_s=0.001, minus_following_error_s=-0.001),
    effect("load_offset", following_error_mm=0.02),
)


def test_a_step_has_a_third_derivative_of_one_size():
    def s(u: float) -> mpmath.mpf:
        # Four cubics: jerk +32, -32, -32, +32, each over a quarter, integrated three times.
        jerks = [32, -32, -32, 32]
        place = speed = rate = mpmath.mpf(0)
        for number, jerk in enumerate(jerks):
            h = min(max(mpmath.mpf(u) - mpmath.mpf(number) / 4, 0), mpmath.mpf(1) / 4)
            place += speed * h + rate * h**2 / 2 + jerk * h**3 / 6
            speed += rate * h + jerk * h**2 / 2
            rate += jerk * h
        return place

    u = np.linspace(0.0, 1.0, 41)
    assert np.abs(step(u) - np.array([float(s(one)) for one in u])).max() < 1e-15


def test_the_level_goes_from_one_direction_to_the_other_in_three_steps():
    change = FrictionChange(axis="X", start=1.0, release=0.2, hold=0.3, take=0.4, held=0.25, before=1, after=-1)
    t = np.array([0.0, 1.0, 1.1, 1.2, 1.35, 1.5, 1.7, 1.9, 3.0])
    assert level([change], 1.0, t) == pytest.approx([1, 1, 0.375, -0.25, -0.25, -0.25, -0.625, -1, -1])
    # And back again, before the first has ended: what both add adds up.
    back = replace(change, start=1.9, before=-1, after=1)
    assert level([change, back], 1.0, np.array([2.1, 2.8])) == pytest.approx([0.25, 1.0])


@pytest.mark.parametrize("effects", [(COULOMB,), (STRIBECK,), DIRECTED])
@pytest.mark.parametrize("way", [1, -1])
def test_the_share_is_the_force_that_the_words_of_the_file_make(effects, way):
    axis = replace(make_machine().axes["X"], effects=effects)
    speed = way * np.linspace(1e-4, 0.03, 50)
    plus, minus, static, scale, up, down, load = words_of(axis)
    dry = way * ((plus if way > 0 else minus) + (static * np.exp(-((speed / scale) ** 2)) if scale else 0.0))
    force = dry + (up if way > 0 else down) * speed
    found = friction_of(axis)
    assert found is not None
    assert friction_share(found, np.full(50, float(way)), speed) == pytest.approx(force, rel=1e-12)
    lead = FrictionLead(axes={"X": found}, part=0.5, initial={"X": way})
    assert lead.share("X", speed, np.arange(50.0)) == pytest.approx(load + 0.5 * force, rel=1e-12)


@pytest.mark.parametrize("size", [2e-6, 40e-6, 1e-3])
def test_the_shortest_step_keeps_nine_tenths_of_a_limit_and_takes_it(size):
    axis, period = make_machine(acceleration=0.5, jerk=12.0).axes["X"], 1e-5
    duration = shortest_step(axis, size, period)
    t = np.arange(0.0, duration + period, period)
    x = size * step(t / duration)
    used = [
        np.abs(np.diff(x, order)).max() / period**order / limit
        for order, limit in ((1, axis.limits.velocity), (2, axis.limits.acceleration), (3, axis.limits.jerk))
    ]
    assert max(used) == pytest.approx(0.9, rel=0.01)


@pytest.mark.parametrize(("integral_time", "current_time"), [(0.017, 0.0005), (0.008, 0.0), (np.inf, 0.0008)])
@pytest.mark.parametrize("size", [20e-6, 150e-6])
def test_the_shortest_step_leaves_the_command_of_a_cascade_within_its_limits(size, integral_time, current_time):
    """Wherever it begins between two rows; what the current loop takes jerks more than the friction's share.

    A plan was thrown away whole for 54.9 m/s³ where 50 are allowed: 58 µm stayed of a circle for 19.
    """
    rate = 1.0 / integral_time
    cascade = Cascade(position_gain=54.0, velocity_gain=332.0, integral_rate=rate, current_time=current_time)
    axis, period = make_machine(acceleration=1.0, jerk=50.0).axes["X"], 1e-3
    axis = replace(axis, servo=replace(axis.servo, b=1.0 / (54.0 * 332.0), c=1.0 / 54.0, cascade=cascade))
    duration, used = shortest_step(axis, size, period), []
    for begin in np.linspace(0.02, 0.021, 9):
        t = period * np.arange(round((duration + 0.05) / period))
        command = lead_of_force(axis, size * step((t - begin) / duration), period)
        used += [
            np.abs(np.diff(command, order)).max() / period**order / limit
            for order, limit in ((1, axis.limits.velocity), (2, axis.limits.acceleration), (3, axis.limits.jerk))
        ]
    assert 0.75 < max(used) < 0.95


def test_a_motor_comes_through_its_backlash_while_the_change_is_held():
    axis = read_machine("old_mill").axes["Y"]
    friction = friction_of(axis)
    assert friction is not None
    change = held_change(axis, friction, 1, -1, 0.25, 1e-3)
    # Under a quarter of 0.06 mm a motor alone of 0.45 of the inertia makes its 0.08 mm in that time.
    assert 0.5 * 0.25 * 60 * UM / (0.45 * 0.00025) * change.hold**2 == pytest.approx(80 * UM)
    quick = direct_change(axis, friction, 1, -1, 2.0, 1e-3)
    assert (quick.end - 2.0, quick.duration) == pytest.approx(
        (0.5 * quick.duration, shortest_step(axis, 120 * UM, 1e-3))
    )


@pytest.mark.parametrize("eta", [0.3, 0.6])
@pytest.mark.parametrize("held", [0.1, 0.25, 0.5])
def test_the_knock_of_a_motor_is_what_its_energy_leaves(held, eta):
    # A motor on its + side is let go: its command falls to -held F at once. Without c and β all energy is left.
    dry, gap, period = 50 * UM, 60 * UM, 1e-4
    command = np.full(6000, -held * dry)
    body = Body("load", 2e-4, 0.0, 0.0, 0.0, gap, eta, 0.0, 1, friction=(dry, dry, 0.0, 0.0, 0.0, 0.0, 0.0))
    knock = -table_of(body, command, period, 1, 0.0).min()
    left = (1.0 - held) * dry
    bound = np.sqrt(left**2 + 2.0 * eta * held * dry * gap) - left
    assert knock == pytest.approx(bound, rel=0.02)
    assert bound < eta * gap * held / (1.0 - held)
    damped = body._replace(c=0.02, beta=2.0)
    assert -table_of(damped, command, period, 1, 0.0).min() < bound
    assert table_of(body._replace(rule=0), command, period, 1, 0.0).min() == 0.0


def test_turns_are_where_the_axis_rests():
    t = np.arange(0.0, 3.0, 1e-3)
    swing, omega = 0.02, 4.0
    x = swing * np.cos(omega * t)
    turns = find_turns(t, x, moving=False)
    assert [(one.before, one.after) for one in turns] == [(0, -1), (-1, 1), (1, -1), (-1, 1)]
    # Within a distance d of its end a swing A cos(ωt) is for 2 √(2 d / A) / ω.
    near = 2.0 * np.sqrt(2.0 * STILL / swing) / omega
    for number, one in enumerate(turns[1:], start=1):
        assert 0.5 * (one.begin + one.end) == pytest.approx(number * np.pi / omega, abs=1e-3)
        assert one.end - one.begin == pytest.approx(near, abs=2e-3)
    assert len(find_turns(t, x, moving=True)) == 3
    assert find_turns(t, 0.4 * STILL * np.cos(omega * t), moving=False) == []
    rests = np.interp(t, [0.0, 0.5, 1.0, 2.0, 2.5, 3.0], [0.0, 0.0, 0.01, 0.01, 0.0, 0.0])
    assert [(one.before, one.after) for one in find_turns(t, rests, moving=False)] == [(0, 1), (1, -1)]
    assert find_turns(t, rests, moving=False)[1].begin == pytest.approx(1.0, abs=2e-3)
    assert find_turns(t, rests, moving=False)[1].end == pytest.approx(2.0, abs=2e-3)


def planned(path, machine, **options):
    analysis = look(path, machine)
    given = {"strategy": "auto", "carrier": "table", "inverse_dynamics": True, **options}
    plan = make_plan(analysis, PlanOptions(**given))
    return (
        analysis.track,
        plan,
        *(command_of(one, analysis.track, machine.servo_period) for one in (plan, without_strategy(plan))),
    )


RADIUS = 0.02
START = RADIUS * np.sqrt(0.5)


def rubbing(effects, *, gap=True, **axis):
    """A bench whose axes have friction, and a circle that begins beside its quadrants."""
    machine = make_machine(acceleration=1.0, jerk=30.0, effects=effects, **axis)
    if not gap:
        axes = {name: replace(one, gap=one.gap.with_lost_motion(0.0)) for name, one in machine.axes.items()}
        machine = replace(machine, axes=axes)
    circle = Arc(start=(START, START), end=(START, START), center=(0.0, 0.0), turn="ccw")
    return make_path([circle], feed=0.02, closed=True), machine


CASES = {
    "Coulomb": ((COULOMB,), {}, (3.0, 10.0)),
    "Stribeck": ((STRIBECK,), {}, (3.0, 6.0)),
    "by direction, and a load": (DIRECTED, {}, (5.0, 10.0)),
    "no backlash": ((COULOMB,), {"gap": False}, (8.0, 10.0)),
    "around the motor": ((COULOMB,), {"feedback": "motor"}, (4.0, 10.0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
@pytest.mark.thinned(4)
def test_what_is_led_does_no_harm_with_half_of_it(case):
    effects, axis, gain = CASES[case]
    path, machine = rubbing(effects, **axis)
    track, plan, command, plain = planned(path, machine, effort=0.1)
    assert not check_command(command, machine)
    assert plan_time(plan) <= 1.1 * cycle_time(plan.nominal) + machine.servo_period
    turned = [plan.turning_points[plan.windows[one.window].turning_point] for one in plan.friction if one.window >= 0]
    assert "none" not in {strategy_at(plan, point) for point in turned}
    for part in (1.0, 0.8, 1.2, 0.5):
        before, after = (run_table(one, machine, track, friction=part) for one in (plain, command))
        assert after.max <= before.max + 0.05 * UM, (part, before, after)
        assert after.rms <= 1.005 * before.rms, (part, before, after)
        if part == 1.0:
            assert after.max <= before.max / gain[0], (before, after)
            assert after.rms <= before.rms / gain[1], (before, after)


@pytest.mark.slow
def test_an_oval_on_an_old_mill_is_within_ten_micrometres():
    machine = read_machine("old_mill")
    track, plan, command, plain = planned(read_path(or_shipped("paths", "oval")), machine)
    assert not check_command(command, machine)
    assert plan_time(plan) <= 1.1 * cycle_time(plan.nominal)

    def sizes(one: Command, **parts: float) -> Sizes:
        return run_table(one, machine, track, **parts)

    before, after = sizes(plain), sizes(command)
    assert before.max > 60.0 * UM
    assert after.max < 10.0 * UM
    assert after.rms < 2.0 * UM
    for part in (0.8, 1.2):
        assert sizes(command, friction=part).max < 15.0 * UM
        assert sizes(command, gap=part).max < 10.0 * UM
    before, after = sizes(plain, friction=0.5), sizes(command, friction=0.5)
    assert all(own <= other for own, other in zip(after, before, strict=True))


@pytest.mark.slow
def test_less_is_led_where_half_of_the_friction_would_do_harm():
    # Straight edges: the plain program's lag does not show, so that half of the friction led too much would.
    machine = read_machine("old_mill")
    track, plan, command, plain = planned(read_path(or_shipped("paths", "pocket")), machine, effort=0.2)
    assert 0.5 < plan.friction_part < 1.0
    assert any(f"{100.0 * plan.friction_part:.0f} % of the friction is led" in one for one in plan.warnings)
    for part in (1.0, 0.5):
        before, after = (run_table(one, machine, track, friction=part) for one in (plain, command))
        assert all(own <= 1.005 * other for own, other in zip(after, before, strict=True))


@pytest.mark.slow
def test_all_of_a_friction_that_was_measured_is_led():
    """It was known within half a percent, and 92 % of it were led, as if half of it could be missing."""
    machine = read_machine("old_mill")
    surer = replace(machine.axes["X"].uncertainty, friction=0.005)
    machine = replace(machine, axes={name: replace(one, uncertainty=surer) for name, one in machine.axes.items()})
    track, plan, command, plain = planned(read_path(or_shipped("paths", "pocket")), machine, effort=0.2)
    assert plan.friction_part == 1.0
    for part, times in ((1.0, 10.0), (0.995, 10.0), (0.75, 2.0), (1.25, 2.0)):
        before, after = (run_table(one, machine, track, friction=part) for one in (plain, command))
        assert all(own <= other / times for own, other in zip(after, before, strict=True)), (part, before, after)


@pytest.mark.parametrize(("uncertainty", "left"), [(0.005, 0.75), (0.1, 0.75), (0.16, 0.6), (0.2, 0.5), (0.4, 0.5)])
def test_how_much_friction_may_be_missing_follows_from_how_well_it_is_known(uncertainty, left):
    axes = read_machine("old_mill").axes
    known = replace(axes["X"], uncertainty=replace(axes["X"].uncertainty, friction=uncertainty))
    assert little_friction([known]) == pytest.approx(left, abs=1e-12)
    assert little_friction([known, axes["Y"]]) == 0.5


@pytest.mark.slow
def test_without_inverse_dynamics_or_friction_nothing_of_it_is_led():
    path, machine = rubbing((COULOMB,))
    for other, lead in ((machine, False), (make_machine(acceleration=1.0, jerk=30.0), True)):
        _, plan, _, _ = planned(path, other, inverse_dynamics=lead, effort=0.02)
        assert (plan.friction_part, plan.friction) == (0.0, ())


def test_an_integrator_needs_no_constant_share():
    load = effect("load_offset", following_error_mm=0.02)
    for servo, share in ((Servo(b=2e-4, c=0.02, ki_over_kp=5.0), 0.0), (Servo(b=2e-4, c=0.02), 20 * UM)):
        path, machine = rubbing((load,), servo=servo)
        track, plan, _, _ = planned(path, machine, strategy="suppress")
        plan = replace(plan, friction_part=1.0)
        axes = {name: replace(one, effects=()) for name, one in machine.axes.items()}
        bare = replace(plan, machine=replace(machine, axes=axes))
        own, other = (command_of(one, track, machine.servo_period).position for one in (plan, bare))
        assert own - other == pytest.approx(share * np.ones(own.shape), abs=1e-12)
