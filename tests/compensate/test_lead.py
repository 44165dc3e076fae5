"""Room for inverse dynamics: errors on a machine of the tests' own, limits on every row, and the least time."""

from __future__ import annotations

from itertools import product
from pathlib import Path as File

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.interpolate import BSpline
from scipy.optimize import linprog
from support.motions import look, make_path, worst_use, zigzag
from support.two_masses import Nominal, body_of, settling, table_of

from ph_post.compensate import plan as planning
from ph_post.compensate.lead import END, lead_window, memory_of_lead, smoothed, weights
from ph_post.compensate.motion import MotionLaw, cycle_time
from ph_post.compensate.offsets import command_of, plan_time
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import LEAD_SHARE, make_plan
from ph_post.compensate.room import unwinding_time
from ph_post.compensate.smooth_motion import rest_at_stops, smooth_motion
from ph_post.compensate.violations import check_command
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.files.storage import or_shipped
from ph_post.geometry.curves import Arc, Line
from ph_post.geometry.nurbs import Nurbs
from ph_post.types import Cascade, Crossing, Machine, Path, Phase, Plan

PATHS = File(__file__).parents[2] / "paths"
UM = 1e-6
RULES = ("standstill", "momentum", "contact")
ROUNDING = 1e-6


def plans(path: Path, machine: Machine, **options) -> tuple[Plan, Plan]:
    """The plain plan, and the one that is led."""
    analysis = look(path, machine)
    plain = make_plan(analysis, PlanOptions(strategy="none"))
    return plain, make_plan(analysis, PlanOptions(strategy="none", inverse_dynamics=True, **options))


def errors(plan: Plan, gap: float = 1.0) -> tuple[float, float]:
    """Largest error and largest root mean square [m] on axes of two masses, of all sides and rules."""
    track = look(plan.path, plan.machine).track
    command = command_of(plan, track, plan.machine.servo_period)
    axes = [plan.machine.axes[name] for name in command.axes]
    nominal = Nominal(track.derivatives(*track.locate(np.linspace(0.0, track.length, 100_001)))[0])
    begin = track.derivatives(*track.locate(np.zeros(1)))[0][0]
    first = int(settling([body_of(axis) for axis in axes]) / command.period)
    worst = np.zeros(2)
    for rule in RULES if gap else RULES[:1]:
        tables = [
            [
                table_of(body_of(axis, rule, gap), np.ascontiguousarray(own), command.period, side, place)
                for side in ((1, -1) if gap else (1,))
            ]
            for axis, own, place in zip(axes, command.position.T, begin.tolist(), strict=True)
        ]
        for chosen in product(*tables):
            error = nominal.distance(np.stack(chosen, axis=1))[first:]
            worst = np.maximum(worst, [error.max(), np.sqrt(np.mean(error**2))])
    return float(worst[0]), float(worst[1])


def keeps_limits(plan: Plan) -> bool:
    track = look(plan.path, plan.machine).track
    return max(worst_use(command_of(plan, track, plan.machine.servo_period), plan.machine)) <= 1.0 + ROUNDING


def with_servo(machine: Machine, **changed: float) -> Machine:
    axes = {name: replace(axis, servo=replace(axis.servo, **changed)) for name, axis in machine.axes.items()}
    return replace(machine, axes=axes)


def spline(seed: int, feed: float = 0.05) -> Path:
    """A random cubic with twelve control points, some 0.3 m long."""
    knots = np.concatenate([[0.0] * 4, np.linspace(0.0, 1.0, 10)[1:-1], [1.0] * 4])
    return make_path([Nurbs(3, knots, np.random.default_rng(seed).uniform(-0.05, 0.05, (12, 2)), np.ones(12))], feed)


def test_the_window_leaves_cubics_alone_and_rounds_a_step() -> None:
    x = np.arange(-40.0, 41.0)
    cubic = np.stack([1.0 - 2.0 * x + 0.3 * x**2 - 0.01 * x**3, x], axis=1)
    np.testing.assert_allclose(smoothed(cubic, 12)[12:-12], cubic[12:-12], atol=1e-11)
    step = smoothed((x > 0.0)[:, None].astype(float), 12)[:, 0]
    assert np.abs(np.diff(step)).max() == pytest.approx(weights(12).max(), rel=1e-12)
    assert (step[:28] == 0.0).all()
    assert step[53:] == pytest.approx(1.0, abs=1e-14)


def test_rows_of_a_motion_that_does_not_rest_stay_as_they_are_at_its_ends() -> None:
    rows = np.random.default_rng(1).normal(size=(200, 2))
    seen = smoothed(rows, 10, (False, True))
    assert (seen[:11] == rows[:11]).all()
    np.testing.assert_allclose(seen[20:], smoothed(rows, 10)[20:], atol=1e-15)


def staircase() -> MotionLaw:
    """Constant speeds of 0, 2, 1 and 0 with a profile in the middle."""
    phases, t, s = [], 0.0, 0.0
    for duration, speed, window in [
        (0.4, [0.0], -1),
        (0.5, [0.0, 2.0], -1),
        (1.0, [2.0], -1),
        (0.6, [2.0, 0.0, 0.0, 1.0], 3),
        (0.7, [1.0], -1),
        (0.3, [1.0, 0.0], -1),
        (0.5, [0.0], -1),
    ]:
        phases.append(Phase(start=t, duration=duration, s=s, speed=np.array(speed), window=window))
        t, s = t + duration, s + duration * float(np.mean(speed))
    return MotionLaw.from_phases(phases)


def test_smoothed_speed_is_the_spline_of_its_means() -> None:
    # From rest to the profile: cells of 0.1 s, the spline of de Boor of their means.
    motion = staircase()
    smooth = smooth_motion(motion, 0.1)
    edges = np.linspace(0.0, 1.9, 20)
    mean = np.diff(motion.place_and_feed(edges)[0]) / 0.1
    coefficients = np.concatenate([[0.0] * 2, mean, [2.0] * 2])
    reference = BSpline(0.1 * np.arange(-4.0, 24.0), coefficients, 4)
    t = np.linspace(0.0, 1.9, 400)
    s, feed = smooth.place_and_feed(t)
    np.testing.assert_allclose(feed, reference(t), atol=1e-13)
    np.testing.assert_allclose(s, reference.antiderivative()(t), atol=1e-13)
    np.testing.assert_allclose(smooth.acceleration(t[1:-1]), reference.derivative()(t[1:-1]), atol=1e-10)


def test_profiles_and_what_they_begin_at_stay() -> None:
    motion = staircase()
    smooth = smooth_motion(motion, 0.1)
    assert smooth.end == pytest.approx(motion.end, abs=1e-14)
    t = np.linspace(1.75, 2.65, 200)
    for one, other in zip(smooth.place_and_feed(t), motion.place_and_feed(t), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-13)
    assert smooth.window[smooth.phase_at(np.array([2.0]))] == 3
    np.testing.assert_allclose(smooth.place_and_feed(np.array([9.0]))[0], motion.place_and_feed(np.array([9.0]))[0])


def test_a_motion_rests_at_its_stops() -> None:
    rise, fall = np.array([0.0, 1.0]), np.array([1.0, 0.0])
    law = [(0.0, rise), (0.5, fall), (1.0, rise), (1.5, fall)]
    motion = MotionLaw.from_phases([Phase(start=s, duration=1.0, s=s, speed=speed) for s, speed in law])
    rested = rest_at_stops(motion, 0.25, 0.5)
    assert rested.duration.tolist() == [0.25, 1.0, 1.0, 0.5, 1.0, 1.0, 0.75]
    assert rested.s.tolist() == [0.0, 0.0, 0.5, 1.0, 1.0, 1.5, 2.0]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "plain", "largest", "rms", "longer"),
    [("pocket", 37.0, 12.0, 1.2, 0.025), ("butterfly", 213.0, 32.0, 6.0, 0.03), ("oval", 52.0, 9.0, 0.8, 0.01)],
)
@pytest.mark.thinned(6)
def test_the_mill_is_led_for_little_time(name: str, plain: float, largest: float, rms: float, longer: float) -> None:
    # What is left is the backlash: without it the errors are below a micrometre.
    before, led = plans(read_path(PATHS / f"{name}.json"), read_machine("mill"))
    assert led.inverse_dynamics
    assert led.lead == 1.0
    assert plan_time(led) <= (1.0 + longer) * plan_time(before)
    assert errors(before)[0] >= plain * UM
    found = errors(led)
    assert found[0] <= largest * UM
    assert found[1] <= rms * UM
    assert errors(led, gap=0.0)[0] <= 0.8 * UM
    assert keeps_limits(led)


@pytest.mark.parametrize("seed", [3, 4])
@pytest.mark.parametrize(
    "servo",
    [{}, {"ki_over_kp": 8.0}, {"ki_over_kp": 8.0, "kd_over_kp": 0.005}, {"ki_over_kp": 12.0, "kd_over_kp": 0.03}],
    ids=["P", "PI", "PID", "PID that swings"],
)
@pytest.mark.thinned(8)
def test_all_controllers_are_inverted(servo: dict[str, float], seed: int) -> None:
    machine = with_servo(read_machine("mill"), **servo)
    before, led = plans(spline(seed), machine)
    assert plan_time(led) <= 1.1 * plan_time(before)
    plain, found = errors(before, gap=0.0), errors(led, gap=0.0)
    # What an integrator still holds when the time is up moves the table at the very end.
    assert found[1] <= (0.03 if servo else 0.01) * plain[1]
    assert found[0] <= 0.1 * plain[0]
    assert keeps_limits(led)


def test_a_servo_whose_c_is_short_beside_its_b_is_led() -> None:
    # c / b of 26 1/s where critical damping has 160.
    before, led = plans(spline(3), with_servo(read_machine("mill"), c=0.004))
    assert errors(led, gap=0.0)[0] <= 0.02 * errors(before, gap=0.0)[0]
    assert keeps_limits(led)


def meander(count: int = 12) -> Path:
    """Lines and half circles of 2 mm at 30 mm/s, where the mill's servos cannot follow by far."""
    curves: list = []
    x, y, way = 0.0, 0.0, 1
    for _ in range(count):
        curves.append(Line([(x, y), (x + 0.02 * way, y)]))
        x += 0.02 * way
        curves.append(
            Arc(np.array([x, y]), np.array([x, y + 0.004]), np.array([x, y + 0.002]), "ccw" if way > 0 else "cw")
        )
        y, way = y + 0.004, -way
    return make_path(curves, 0.03)


@pytest.mark.slow
def test_as_much_is_led_as_the_time_allows() -> None:
    errors_found, parts = [], []
    for allowed in (0.02, 0.3, 1.0):
        before, led = plans(meander(), read_machine("mill"), max_slowdown=allowed)
        assert plan_time(led) <= (1.0 + allowed) * plan_time(before)
        assert keeps_limits(led)
        errors_found.append(errors(led, gap=0.0)[0])
        parts.append(led.lead)
        said = [one for one in led.warnings if "of what the servo lags" in one]
        assert len(said) == (led.lead < 1.0)
    plain = errors(before, gap=0.0)[0]
    assert parts == sorted(parts)
    assert parts[-1] == 1.0
    assert errors_found[2] < errors_found[1] < errors_found[0] < plain
    assert errors_found[2] <= 0.15 * plain


def test_nearly_all_is_led_where_the_time_is_nearly_enough_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    # With sharper changes of the speed the time would be enough.
    monkeypatch.setattr(planning, "SHARPER", ())
    before, led = plans(meander(4), read_machine("mill"), max_slowdown=1.0)
    needed = plan_time(led) / plan_time(before) - 1.0
    _, less = plans(meander(4), read_machine("mill"), max_slowdown=0.9998 * needed / LEAD_SHARE)
    assert 0.9 < less.lead < 1.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("least", "words"), [(0.1, "of what the servo lags"), (0.9, "leaves no room for inverse dynamics")]
)
def test_what_a_warning_says_allows_all_of_the_lead(monkeypatch: pytest.MonkeyPatch, least: float, words: str) -> None:
    monkeypatch.setattr(planning, "LEAST_PART", least)
    _, led = plans(meander(4), read_machine("mill"))
    (said,) = (one for one in led.warnings if words in one)
    allowed = float(said.split("--max-slowdown ")[1].split()[0])
    assert plans(meander(4), read_machine("mill"), max_slowdown=allowed)[1].lead == 1.0


def test_no_lead_is_claimed_where_nothing_lags() -> None:
    path = make_path([Line([(0.0, 0.0), (0.05, 0.02)])])
    for machine in (read_machine("stepper"), with_servo(read_machine("mill"), b=1e-12, c=1e-8)):
        plain, led = plans(path, machine)
        assert not led.inverse_dynamics
        track = look(path, machine).track
        one, other = (command_of(plan, track, 1e-3) for plan in (plain, led))
        if machine.name == read_machine("stepper").name:
            np.testing.assert_array_equal(one.position, other.position)
            assert cycle_time(led.phases) == cycle_time(plain.phases)


def test_integrators_are_waited_for() -> None:
    # k_d s² + s + k_i has the zeros -8.35 and -191.65 for 8 and 0.005, and -2.5 ± 2.96 i for 3 and 0.2.
    mill = read_machine("mill")
    for ki, kd, rate in ((8.0, 0.005, 8.348486), (3.0, 0.2, 2.5)):
        machine = with_servo(mill, ki_over_kp=ki, kd_over_kp=kd, c=0.02)
        assert memory_of_lead(machine.axes["X"].servo) == pytest.approx(1.0 / rate, rel=1e-6)
    assert lead_window(with_servo(mill, b=4e-6, c=0.0), ("X", "Y")).half == 8


@pytest.mark.parametrize("braking", [0.04, 0.2])
def test_a_motion_rests_at_its_end_for_no_longer_than_its_lead_takes(braking: float) -> None:
    """With all of the speed fed forward e + ė/K_v = b a: braking at a for T leaves b a (1 - exp(-K_v T)) exp(-K_v t).

    For the first that is 0.112 s; c v, as of a motion that stops at once, would be 0.194 s.
    """
    gain, quick, feed = 30.0, 200.0, 0.02
    cascade = Cascade(position_gain=gain, velocity_gain=quick, velocity_feedforward=1.0)
    machine = with_servo(read_machine("mill"), b=1.0 / (gain * quick), c=1.0 / gain, cascade=cascade)
    steady = Phase(start=0.0, duration=1.0, s=0.0, speed=np.array([feed]))
    brakes = Phase(start=1.0, duration=braking, s=feed, speed=np.array([feed, 0.0]))
    path = make_path([Line([(0.0, 0.0), (feed * (1.0 + 0.5 * braking), 0.0)])])
    window = lead_window(machine, ("X", "Y"))
    found = unwinding_time(
        machine, look(path, machine).track, MotionLaw.from_phases([steady, brakes]), replace(window, half=0)
    )
    left = feed / braking / (gain * quick) * (1.0 - np.exp(-gain * braking))
    assert found == pytest.approx(np.log(left / END) / gain, abs=2e-3)


def least_rows(length: float, axis, period: float) -> int:
    """Fewest rows in which a command moves an axis without backlash from rest to rest, by linear programs.

    The unknowns are the places of the command; the table's are linear in them, by the exact solution of
    b ẍ + c ẋ + x = X with X linear between rows. Speed, acceleration and jerk of the command are bounded, and at
    the end both rest.
    """
    b, c = axis.servo.b, axis.servo.c
    from scipy.linalg import expm

    matrix = np.zeros((4, 4))
    matrix[:2] = [[0.0, 1.0, 0.0, 0.0], [-1.0 / b, -c / b, 1.0 / b, 0.0]]
    matrix[2, 3] = 1.0
    whole = expm(matrix * period)
    step, by_place, by_slope = whole[:2, :2], whole[:2, 2], whole[:2, 3]

    def possible(rows: int) -> bool:
        response = np.zeros((2, rows))
        for k in range(rows - 1):
            response = step @ response
            response[:, k] += by_place - by_slope / period
            response[:, k + 1] += by_slope / period
        padded = np.concatenate([np.zeros((3, rows)), np.eye(rows), np.tile(np.eye(rows)[-1:], (3, 1))])
        limits = axis.limits
        above = [
            np.diff(padded, order, axis=0) / period**order / limit
            for order, limit in ((1, limits.velocity), (2, limits.acceleration), (3, limits.jerk))
        ]
        bound = np.concatenate(above)
        equal = np.concatenate([np.eye(rows)[:1], np.eye(rows)[-1:], response / np.array([[1.0], [0.01]])])
        found = linprog(
            np.zeros(rows),
            A_ub=np.concatenate([bound, -bound]) * 1e3,
            b_ub=np.full(2 * len(bound), 1e3),
            A_eq=equal * 1e3,
            b_eq=np.array([0.0, length, length, 0.0]) * 1e3,
            bounds=(None, None),
        )
        return bool(found.status == 0)

    low, high = 16, 512
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if possible(middle) else (middle, high)
    return high


def test_a_line_takes_little_more_than_the_least_time() -> None:
    axis = read_machine("mill").axes["X"]
    least = least_rows(0.005, axis, 1e-3) * 1e-3
    plain, led = plans(make_path([Line([(0.0, 0.0), (0.005, 0.0)])], feed=0.1), read_machine("mill"), max_slowdown=2.0)
    assert led.lead == 1.0
    assert cycle_time(plain.phases) <= least * 1.05
    assert cycle_time(led.phases) <= 1.45 * least


def test_profiles_that_leave_no_room_for_the_lead_are_given_up() -> None:
    """Beside them the speed cannot be smooth, however slowly it changes: the plan crept on to no end."""
    analysis = look(make_path(zigzag(8, 1), feed=0.02), read_machine("mill"))
    plan = make_plan(analysis, PlanOptions(strategy="dwell", inverse_dynamics=True, max_slowdown=1.0))
    assert any("leaves no room beside it" in words for words in plan.warnings)
    assert plan_time(plan) <= 2.0 * cycle_time(plan.nominal)
    assert not check_command(command_of(plan, analysis.track, 1e-3), plan.machine)


def test_what_breaks_a_limit_in_one_place_takes_the_lead_nowhere_else() -> None:
    analysis = look(read_path(or_shipped("paths", "oval")), read_machine("mill"))
    plan = make_plan(analysis, PlanOptions(strategy="none", inverse_dynamics=True))
    middle = 0.5 * plan_time(plan)
    wild = Crossing(axis="X", start=middle, duration=0.02, travel=3e-5, order=4)
    one, other = (command_of(each, analysis.track, 1e-3) for each in (plan, replace(plan, crossings=(wild,))))
    assert max(worst_use(one, plan.machine)) <= 1.0 < max(worst_use(other, plan.machine))
    apart = np.abs(one.t - middle) > 1.0
    np.testing.assert_array_equal(one.offset[apart], other.offset[apart])
    assert np.abs(one.offset[apart]).max() > 1e-4
