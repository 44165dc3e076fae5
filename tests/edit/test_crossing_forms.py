"""Closed forms of crossings on the fly against an integration of the motion and of the drive."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp
from scipy.optimize import linprog, minimize_scalar
from support.reference_player import play

from ph_post.drive.machinefile import read_machine
from ph_post.edit.crossing_shapes import OUTER, CrossingShape, crossing_shape, stair
from ph_post.edit.crossings import exaggeration
from ph_post.edit.lagging_crossings import BEYOND, RESIDUE, CrossingArcs, bent_line, fastest_arcs, lead_time
from ph_post.types import Axis, Servo

GAP = 0.05
"""Backlash [mm]."""

SMALL = [(20.0, 20.0, 0.02), (5.0, 20.0, 0.01), (20.0, 50.0, 0.014), (2.0, 10.0, 0.02)]
"""Radius [mm], speed [mm/s] and time of a crossing [s]."""


def executed(s: np.ndarray, motor: np.ndarray, radius: float) -> float:
    """Largest distance from a circle whose turning point is at s = 0, x = 0, of a table dragged behind a motor."""
    table = play(motor, GAP, -1.0)
    return float(np.abs(np.hypot(table + radius, s) - radius).max())


def command(s: np.ndarray, places: list[float], added: list[float], radius: float) -> np.ndarray:
    """Axis over the other one: the circle with what is added, straight between the first and the last place."""
    circle = np.sqrt(radius**2 - s**2) - radius
    ends = [math.sqrt(radius**2 - place**2) - radius + more for place, more in zip(places, added, strict=True)]
    outside = circle + np.where(s < 0.0, added[0], added[-1])
    inside = (s > places[0]) & (s < places[-1])
    return np.where(inside, np.interp(s, places, ends), outside)


@pytest.mark.parametrize(("radius", "speed", "time"), SMALL)
def test_a_one_sided_crossing_leaves_an_eighth(radius: float, speed: float, time: float) -> None:
    s = np.linspace(-4.0 * speed * time, 4.0 * speed * time, 200_001)
    half = 0.5 * speed * time
    motor = command(s, [-half, half], [-GAP / 2, GAP / 2][::-1], radius)
    # The motor pushes outwards, X+, until the turning point, and then pulls.
    expected = (speed * time) ** 2 / (8.0 * radius)
    assert executed(s, motor, radius) == pytest.approx(expected, rel=half**2 / radius**2 + 1e-4)


@pytest.mark.parametrize(("radius", "speed", "time"), SMALL)
@pytest.mark.thinned(8)
def test_a_balanced_crossing_leaves_a_sixteenth_and_is_left_on_tangents(
    radius: float, speed: float, time: float
) -> None:
    error = (speed * time) ** 2 / (16.0 * radius)
    half, begin = 2.0 * math.sqrt(radius * error), (2.0 + math.sqrt(2.0)) * math.sqrt(radius * error)
    assert half == pytest.approx(0.5 * speed * time, rel=1e-12)
    assert begin == pytest.approx(OUTER * half, rel=1e-12)
    s = np.linspace(-4.0 * half, 4.0 * half, 100_001)

    def out(outward: float) -> float:
        """Largest error with the ends of the chord by so much out of the path."""
        added = [GAP / 2, GAP / 2 + outward, -GAP / 2 + outward, -GAP / 2]
        return executed(s, command(s, [-begin, -half, half, begin], added, radius), radius)

    small = half**2 / radius**2 + 1e-3
    assert out(error) == pytest.approx(error, rel=5.0 * small)
    # No other bulge is better, and none at all twice as bad.
    best = minimize_scalar(out, bounds=(0.0, 3.0 * error), method="bounded", options={"xatol": 1e-4 * error})
    assert best.x == pytest.approx(error, rel=0.02 + 5.0 * small)
    assert out(0.0) == pytest.approx(2.0 * error, rel=5.0 * small)


@pytest.mark.parametrize("radius", [2.0, 20.0])
def test_the_tangent_through_the_end_of_the_chord_touches_the_path(radius: float) -> None:
    # Nearer, the block cuts the path; farther, it leaves it outwards by more than it has to.
    error = 1e-3
    half = 2.0 * math.sqrt(radius * error)
    share = np.linspace(0.0, 1.0, 20_001)

    def inside(begin: float) -> float:
        """Largest distance within the path of the block from `begin` to the chord's end."""
        first = math.sqrt(radius**2 - begin**2) - radius
        last = math.sqrt(radius**2 - half**2) - radius + error
        x, y = first + share * (last - first), begin + share * (half - begin)
        return float((radius - np.hypot(x + radius, y)).max())

    begin = (2.0 + math.sqrt(2.0)) * math.sqrt(radius * error)
    assert inside(begin) < 2e-3 * error
    assert inside(1.5 * begin) > 0.05 * error


@pytest.mark.parametrize("radius", [2.0, 5.0, 20.0])
@pytest.mark.parametrize("time", [0.01, 0.02])
def test_the_speed_at_which_a_crossing_keeps_an_error(radius: float, time: float) -> None:
    error = 1.5e-3
    speed = 4.0 / time * math.sqrt(radius * error)
    half = 0.5 * speed * time
    begin = OUTER * half
    s = np.linspace(-2.0 * begin, 2.0 * begin, 200_001)
    added = [GAP / 2, GAP / 2 + error, -GAP / 2 + error, -GAP / 2]
    found = executed(s, command(s, [-begin, -half, half, begin], added, radius), radius)
    assert found == pytest.approx(error, rel=5.0 * half**2 / radius**2 + 2e-3)


def lagging(lag: float, b: float, first: float, beyond: float, until: float) -> np.ndarray:
    """Motor behind b x'' + c x' + x = u [parts of the backlash], crossed in `first`; from the end of that on."""

    def wanted(t: float) -> float:
        rise, back = min(t / first, 1.0), min(max(t / first - 1.0, 0.0), 1.0)
        return (1.0 + beyond) * rise - beyond * back

    def slope(t: float, state: np.ndarray) -> list[float]:
        if b == 0.0:
            return [(wanted(t) - state[0]) / lag, 0.0]
        return [state[1], (wanted(t) - state[0] - lag * state[1]) / b]

    state, found = np.zeros(2), []
    for start, end in ((0.0, first), (first, 2.0 * first), (2.0 * first, until)):
        part = solve_ivp(slope, (start, end), state, rtol=1e-10, atol=1e-13, t_eval=np.linspace(start, end, 400))
        state = part.y[:, -1]
        found.append(part.y[0])
    return np.concatenate(found[2:])


@pytest.mark.parametrize("lag", [0.005, 0.01, 0.025])
@pytest.mark.parametrize("ratio", [0.5, 1.3, 3.0])
def test_what_goes_beyond_brings_a_lagging_motor_there_in_time(lag: float, ratio: float) -> None:
    first = ratio * lag
    beyond = 1.0 / math.expm1(first / lag)
    after = lagging(lag, 0.0, first, beyond, 2.0 * first + 5.0 * lag)
    assert np.abs(after - 1.0).max() < 1e-7
    assert np.abs(lagging(lag, 0.0, first, 0.9 * beyond, 2.0 * first + lag) - 1.0).max() > 1e-3


@pytest.mark.parametrize("ratio", [0.5, 1.3, 3.0])
@pytest.mark.parametrize("left", [0.1, 0.01])
def test_a_plain_crossing_behind_a_lag_is_late(ratio: float, left: float) -> None:
    lag = 0.01
    first = ratio * lag
    late = first + lag * math.log(lag / (left * first) * -math.expm1(-first / lag))
    assert late <= first + lag * math.log(1.0 / left)
    if late > 2.0 * first:
        after = lagging(lag, 0.0, first, 0.0, late)
        assert 1.0 - after[-1] == pytest.approx(left, rel=1e-5)


@pytest.mark.parametrize("lag", [0.005, 0.01, 0.025])
@pytest.mark.parametrize("ratio", [0.1, 0.5, 1.0, 4.0])
def test_a_lagging_motor_is_as_far_off_at_the_end_of_its_longer_lead(lag: float, ratio: float) -> None:
    time = ratio * lag
    until = lead_time(time, lag)
    way = solve_ivp(lambda t, x: [(t * t - x[0]) / lag], (0.0, until), [0.0], rtol=1e-11, atol=1e-16).y[0, -1]
    assert way == pytest.approx(time * time, rel=1e-6)
    assert time < until < time + 3.0 * lag


def lagging_axis(lag: float, b: float) -> Axis:
    axis = read_machine("stepper").axes["X"]
    return replace(axis, feedback="motor", servo=replace(axis.servo, b=b, c=lag), gap=axis.gap.with_lost_motion(5e-5))


@pytest.mark.parametrize("lag", [0.005, 0.01, 0.025])
@pytest.mark.parametrize("first", [0.01, 0.0141, 0.03])
@pytest.mark.parametrize("share", [0.0, 0.1, 0.25])
@pytest.mark.thinned(12)
def test_the_shape_that_is_chosen_brings_the_motor_there(lag: float, first: float, share: float) -> None:
    # b is a share of c²: at a quarter the loop is critically damped.
    b = share * lag**2
    shape = crossing_shape(lagging_axis(lag, b), first, 0.0)
    assert shape.wait == pytest.approx(2.0 * shape.first)
    assert shape.first >= first * (1.0 - 1e-9)
    after = lagging(lag, b, shape.first, shape.beyond, shape.wait + 5.0 * lag)
    assert np.abs(after - 1.0).max() * 5e-5 <= 1.05 * RESIDUE
    if b == 0.0 and shape.beyond < 0.39:
        assert shape.beyond == pytest.approx(1.0 / math.expm1(shape.first / lag), rel=1e-3)


def behind_arcs(servo: Servo, arcs: CrossingArcs, until: float) -> tuple[np.ndarray, np.ndarray]:
    """Command and the motor [parts of the backlash] behind b x'' + c x' + x = u, which is integrated arc by arc."""
    push = 1.0 / arcs.way
    lag, state, found = servo.c, np.zeros(4), []
    ends = np.cumsum([0.0, arcs.rise, arcs.fall, arcs.last, until])
    for sign, start, end in zip((1.0, -1.0, 1.0, 0.0), ends, ends[1:], strict=False):

        def slope(_: float, x: np.ndarray, sign: float = sign) -> list[float]:
            missing = x[0] - x[2]
            motor = [missing / lag, 0.0] if servo.b == 0.0 else [x[3], (missing - lag * x[3]) / servo.b]
            return [x[1], sign * push, *motor]

        part = solve_ivp(slope, (start, end), state, rtol=1e-10, atol=1e-13, t_eval=np.linspace(start, end, 200))
        state = part.y[:, -1]
        found.append(part.y[[0, 2]])
    return np.concatenate([one[0] for one in found]), found[-1][1]


@pytest.mark.parametrize("lag", [0.01, 0.025])
@pytest.mark.parametrize("share", [0.0, 0.25])
@pytest.mark.parametrize("most", [BEYOND, 0.2])
def test_arcs_of_one_acceleration_bring_a_lagging_motor_there(lag: float, share: float, most: float) -> None:
    servo, lost, push = lagging_axis(lag, share * lag**2).servo, 5e-5, 0.375
    arcs = fastest_arcs(servo, lost, push, 0.2, most)
    assert arcs is not None
    command, motor = behind_arcs(servo, arcs, 5.0 * lag)
    assert np.abs(motor - 1.0).max() * lost <= 1.05 * RESIDUE
    assert command.max() - 1.0 == pytest.approx(arcs.beyond, abs=1e-4)
    assert arcs.beyond <= most * (1.0 + 1e-9)
    assert lost / arcs.way <= push * (1.0 + 1e-9)
    if share == 0.0:
        assert lost / arcs.way == pytest.approx(push, rel=0.05) or arcs.beyond == pytest.approx(most, rel=0.05)


def arrives(time: float, lag: float, lost: float, push: float) -> bool:
    """Whether any command from rest to rest with an acceleration up to `push` has the motor arrive in `time`."""
    ends = np.linspace(0.0, time, 121)

    def all_of(response: np.ndarray) -> np.ndarray:
        return response[:-1] - response[1:]

    left = time - ends
    # Of the speed, the way and the motor's way at the end, what each piece of constant acceleration gives.
    rows = [
        all_of(left),
        all_of(0.5 * left**2),
        all_of(0.5 * left**2 - lag * left - lag**2 * np.exp(-left / lag)),
    ]
    scale = np.array([push * time, lost, lost])[:, None]
    wanted = np.array([0.0, 1.0, 1.0])
    found = linprog(np.zeros(120), A_eq=push * np.array(rows) / scale, b_eq=wanted, bounds=(-1.0, 1.0))
    return bool(found.status == 0)


@pytest.mark.parametrize(("lag", "lost", "push"), [(0.01, 1e-4, 0.375), (0.025, 1e-4, 0.375), (0.01, 5e-5, 1.5)])
def test_no_other_command_of_that_acceleration_has_the_motor_there_sooner(lag: float, lost: float, push: float) -> None:
    arcs = fastest_arcs(lagging_axis(lag, 0.0).servo, lost, push, 0.2, 10.0)
    assert arcs is not None
    assert arrives(1.01 * arcs.wait, lag, lost, push)
    assert not arrives(0.97 * arcs.wait, lag, lost, push)


@pytest.mark.parametrize("moved", [0.0, 0.2, 0.45])
def test_a_line_bent_beside_its_arcs_has_the_motor_there_all_the_same(moved: float) -> None:
    lag, lost, speed = 0.025, 1e-4, 0.01
    arcs = fastest_arcs(lagging_axis(lag, 0.0).servo, lost, 0.375, 0.2, BEYOND)
    assert arcs is not None
    arcs = replace(arcs, ramp=0.007)
    times = arcs.joints(0.002)[0]
    rng = np.random.default_rng(15)
    times = times + moved * np.diff(times).min() * rng.uniform(-1.0, 1.0, times.size)
    s = np.array([-0.02, 0.0, arcs.wait, arcs.wait + 0.02]) * speed
    # Tangents of a curved path, which the lag leaves by as much in the end as on the path itself.
    motor = np.array([-6e-7, 0.0, lost, lost - 6e-7])
    line = bent_line(arcs, s, motor, lag, times * speed, 0.002)
    places = np.concatenate([s[:1] / speed, times, s[3:] / speed])
    slopes = np.diff(np.concatenate([motor[:1], line, motor[3:]])) / np.diff(places)
    assert line[0] == pytest.approx(motor[0] + (motor[1] - motor[0]) * (times[0] + 0.02) / 0.02, abs=1e-12)
    assert slopes[-1] == pytest.approx((motor[3] - motor[2]) / 0.02, rel=1e-6)
    changes = np.diff(slopes)
    left = arcs.wait - times
    # Of each change c (1 − exp(−t/c)) is still to come.
    missing = lag * (changes * np.exp(-left / lag)).sum()
    assert abs(missing) < 1.2 * RESIDUE


def test_a_stepper_goes_straight_across() -> None:
    axis = read_machine("stepper").axes["X"]
    shape = crossing_shape(axis, 0.014, 0.003)
    assert (shape.first, shape.wait, shape.beyond) == (0.014, pytest.approx(0.017), 0.0)


@pytest.mark.parametrize(("before", "after"), [(0.0, 0.0), (-0.3, 0.3), (-0.5, 0.1)])
@pytest.mark.parametrize(("up", "down"), [(1, 1), (3, 3), (3, 1), (2, 4)])
def test_rounded_joints_of_a_crossing_touch_each_other_at_one_acceleration(
    up: int, down: int, before: float, after: float
) -> None:
    places, travelled = stair(up, down, 1.0, before, after)
    assert (places[0], travelled[0]) == (0.0, 0.0)
    assert (places[-1], travelled[-1]) == pytest.approx((1.0, 1.0), abs=1e-12)
    pieces = np.diff(places)
    changes = np.diff(np.concatenate([[before], np.diff(travelled) / pieces, [after]]))
    assert changes[:up] == pytest.approx(np.full(up, changes[0]))
    assert changes[up:] == pytest.approx(np.full(down, changes[-1]))
    assert changes[0] > 0.0 > changes[-1]
    # A joint takes |change|/push, half before it and half behind.
    push = (0.5 * (np.abs(changes[1:]) + np.abs(changes[:-1])) / pieces).mean()
    lasts = np.abs(changes) / push
    assert 0.5 * (lasts[1:] + lasts[:-1]) == pytest.approx(pieces)
    t = np.linspace(-0.5 * lasts[0], 1.0 + 0.5 * lasts[-1], 200_001)
    turns = t < places[up - 1] + 0.5 * lasts[up - 1]
    speed = before + np.concatenate([[0.0], np.cumsum(np.where(turns, push, -push)[1:] * np.diff(t))])
    way = float(np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(t)))
    assert speed[-1] == pytest.approx(after, abs=1e-3)
    assert way - 0.5 * (before * lasts[0] + after * lasts[-1]) == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize(("up", "down"), [(1, 1), (3, 1), (2, 4)])
@pytest.mark.parametrize("slope", [0.0, 0.25])
def test_a_motor_that_keeps_its_slope_goes_straight(up: int, down: int, slope: float) -> None:
    places, travelled = stair(up, down, slope, slope, slope)
    assert travelled == pytest.approx(slope * np.array(places))
    assert (np.diff(places) > 0.0).all()
    assert places[-1] == pytest.approx(1.0)


@pytest.mark.parametrize("part", [0.75, 0.85, 1.0])
@pytest.mark.parametrize(("radius", "speed", "time"), SMALL[:2])
def test_how_much_farther_a_table_without_lag_goes_where_the_motor_crosses_in_a_part_of_the_time(
    radius: float, speed: float, time: float, part: float
) -> None:
    half = 0.5 * speed * time
    error, out, ahead = half**2 / (4.0 * radius), (OUTER - 1.0) * half, (1.0 - part) * half
    bulge = error * ((out + ahead) / out) ** 2
    s = np.linspace(-4.0 * half, 4.0 * half, 100_001)
    places = [-half - out, ahead - half, half - ahead, half + out]
    # On the tangents, which go on to the ends of the motor's block.
    ends = [math.sqrt(radius**2 - place**2) - radius for place in places]
    added = [GAP / 2, GAP / 2 + bulge, -GAP / 2 + bulge, -GAP / 2]
    circle = np.sqrt(radius**2 - s**2) - radius
    motor = circle + np.where(s < 0.0, added[0], added[-1])
    inside = (s > places[0]) & (s < places[-1])
    motor[inside] = np.interp(s[inside], places, np.add(ends, added))
    shape = CrossingShape(first=part * time, wait=time)
    assert executed(s, motor, radius) == pytest.approx(exaggeration(shape, 0.0) * error, rel=0.02)
