"""A machine of the tests' own: axes of two masses with a gap, by Runge and Kutta in steps of some microseconds.

Written from section 3 of the paper (doi:10.1007/s00170-021-08515-z) and Eq. (9) with P, PI and PID control, and from
nothing in ph_post. In units of the table, with the controller's output u = e + k_i ∫e + k_d ė:

    together   b v̇ + c v = u
    apart      η b (ẇ + β w) = u        (the motor)
               (1 - η) b v̇ + (c - η β b) v = 0        (the table)

With the loop around the motor, or none, the motor alone obeys the first, and the table is a play behind it.

Friction f = ± (F + (S - F) exp(-(v/v_s)²)) + d v + L resists the table, that of a loop around the motor the motor: F
while it moves, S at rest, d by direction, L a constant load. A body at rest stays until what drives it exceeds S; it
rests again where its speed changes its sign. With F = S = 0 and no load nothing of this counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Floats = NDArray[np.float64]

FINE = 100
"""Steps of the integration between two rows, 10 µs at 1 kHz, in which bodies meet, part, rest and break away."""

COARSE = 5
"""So many of them are one where nothing of that happens."""

SMOOTH = 0.2
"""Most that a body may change by in such a step, relatively: Runge and Kutta are off by 3e-6 of what decays as fast."""

FAST = 7.0
"""Multiples of v_s from which less than 1e-21 of what friction at rest has more is left."""

SETTLED = 5.0
"""Servo time constants 2b/c that do not count at the beginning, as the contract of errors has it."""


class Body(NamedTuple):
    """One axis; `rule` is 0 where the pick-up stands still, 1 where momentum is kept, 2 by the contact force.

    `zero` is the direction in which its zero was taken, 0 where that is the middle of both.
    """

    feedback: str
    b: float
    c: float
    ki: float
    kd: float
    gap: float
    eta: float
    beta: float
    rule: int
    zero: int = 0
    friction: tuple[float, ...] = (0.0,) * 7


DRY = "coulomb_friction", "stribeck_friction"
"""Effects of a machine file that turn round with the motion."""


def friction_of(axis, factor: float = 1.0) -> tuple[float, ...]:
    """F moving to plus and to minus, S - F, v_s, d to plus and to minus, and L, from the words of a machine file."""

    def size(given, name: str) -> float:
        if f"{name}force_n" in given:
            return given[f"{name}force_n"] / axis.servo.stiffness
        return 1e-3 * given[f"{name}following_error_mm"]

    def damping(given, newton: str, second: str) -> float:
        return given[second] if second in given else 1e3 * given[newton] / axis.servo.stiffness

    dry = static = speed = plus = minus = load = 0.0
    for effect in axis.effects:
        given = effect.parameters
        if effect.name in DRY:
            dry += size(given, "")
        if effect.name == "stribeck_friction":
            static, speed = size(given, "static_") - size(given, ""), 1e-3 * given["stribeck_velocity_mm_s"]
        if effect.name == "viscous_friction":
            one = damping(given, "coefficient_n_s_per_mm", "following_error_s")
            plus, minus = plus + one, minus + one
        if effect.name == "friction_asymmetry":
            plus += damping(given, "plus_n_s_per_mm", "plus_following_error_s")
            minus += damping(given, "minus_n_s_per_mm", "minus_following_error_s")
            load -= 0.5 * (plus - minus) * 1e-3 * given.get("even_at_mm_s", 0.0)
        if effect.name == "load_offset":
            load += size(given, "")
    return (factor * dry, factor * dry, factor * static, speed, factor * plus, factor * minus, load)


NUMBERS = slice(1, 9)
"""What the equations of a body take."""


def body_of(axis, rule: str = "standstill", factor: float = 1.0, friction: float = 1.0) -> Body:
    """The numbers of an axis of a machine file; `factor` is one of its gap, `friction` one of its friction."""
    rules = ("standstill", "momentum", "contact")
    servo, gap = axis.servo, axis.gap
    return Body(
        feedback=axis.feedback,
        b=servo.b,
        c=servo.c,
        ki=servo.ki_over_kp,
        kd=servo.kd_over_kp,
        gap=factor * gap.lost_motion,
        eta=gap.inertia_fraction or 0.5,
        beta=gap.beta or 0.0,
        rule=rules.index(gap.pickup or rule),
        zero={"+": 1, "-": -1, "both": 0}[axis.reference_direction],
        friction=friction_of(axis, friction),
    )


def table_of(body: Body, command: Floats, period: float, side: int, place: float, speed: float = 0.0) -> Floats:
    """Where the table is in every row [m]; at first it stands on `side` of its gap, or moves at `speed`.

    Behind a loop its place is counted from where it stood when its motor came to 0 in the direction of its zero.
    """
    side = int(np.sign(speed)) or side
    if body.feedback == "load":
        return _two_masses(_plain(command), period, side, place, speed, *body[NUMBERS], body.friction)
    return behind(body, motor_of(body, command, period, speed), side)


def motor_of(body: Body, command: Floats, period: float, speed: float = 0.0) -> Floats:
    """Where a motor is in every row [m] whose own place is fed back, or none: it does not feel its gap."""
    if not body.b and not body.c:
        return command
    start = command[0] - body.c * speed * (body.ki == 0.0)
    rigid = body._replace(gap=0.0)
    side = int(np.sign(speed)) or 1
    return _two_masses(_plain(command), period, side, start, speed, *rigid[NUMBERS], body.friction)


def behind(body: Body, motor: Floats, side: int) -> Floats:
    """Where the table is in every row [m] behind such a motor."""
    half = 0.5 * body.gap
    zero = play(np.array([-1.0 * body.zero, 0.0]), half, 0)[-1]
    return play(motor, half, side) - zero


def play(motor: Floats, half: float, side: int) -> Floats:
    """The play operator: a table that stays until the motor has come to one of its sides."""
    return _play(_plain(motor), half, side)


def _plain(values) -> Floats:
    """The same numbers side by side: of every layout of arrays a function is compiled anew."""
    return np.array(values, dtype=float)


@numba.njit(cache=True)
def _play(motor, half, side):  # type: ignore[no-untyped-def]
    table, place = np.empty(motor.size), motor[0] - side * half
    for row, here in enumerate(motor):
        place = min(max(place, here - half), here + half)
        table[row] = place
    return table


@numba.njit(cache=True)
def _two_masses(command, period, side, place, speed, b, c, ki, kd, gap, eta, beta, rule, friction):  # type: ignore[no-untyped-def]
    half = 0.5 * gap
    numbers = (b, c, ki, kd, eta, beta)
    dry = friction[0] + friction[1] + friction[2] + abs(friction[6]) > 0.0
    table = np.empty(command.size)
    table[0] = place
    total = (c * speed + friction[6]) / ki if ki else 0.0
    y = (place, speed, place + side * half, speed, total)
    touch, h = side, period / FINE
    way = int(np.sign(speed)) if dry else 2
    light = b * (min(eta, 1.0 - eta) if gap > 0.0 else 1.0)
    steep = friction[2] / friction[3] if friction[3] > 0.0 else 0.0
    quick = (c + kd + steep) / light + 1.0 / np.sqrt(light)
    together = COARSE if COARSE * h * quick < SMOOTH else 1
    for row in range(command.size - 1):
        slope = (command[row + 1] - command[row]) / period
        for first in range(0, FINE, together):
            begin = command[row] + slope * h * first
            after = _advanced(y, together * h, begin, slope, touch, way, half, dry, numbers, friction, rule)
            if together == 1 or (after[1] == touch and after[2] == way):
                y, touch, way = after
                continue
            for step in range(first, first + together):
                begin = command[row] + slope * h * step
                y, touch, way = _advanced(y, h, begin, slope, touch, way, half, dry, numbers, friction, rule)
        table[row + 1] = y[0]
    return table


@numba.njit(cache=True)
def _advanced(y, h, begin, slope, touch, way, half, dry, numbers, friction, rule):  # type: ignore[no-untyped-def]
    """State, side that is touched and direction after a step, at whose end the last two may change."""
    before, after = y[1], begin + h * slope
    if touch:
        y = _together(y, h, begin, slope, way, numbers, friction)
    else:
        y = _stepped(y, h, begin, slope, touch, way, numbers, friction)
    if dry:
        y, way = _at_rest(y, way, touch)
    if half > 0.0 and touch:
        y, touch = _after_contact(y, before, after, slope, touch, way, numbers, friction, rule)
    elif half > 0.0 and abs(y[2] - y[0]) >= half:
        touch = 1 if y[2] > y[0] else -1
        y = _meet(y, half, touch, numbers[4], rule)
        way = int(np.sign(y[1])) if dry else 2
    if way == 0:
        way = _breaks_away(y, after, slope, touch, numbers, friction)
    return y, touch, way


@numba.njit(cache=True)
def _stepped(y, h, begin, slope, touch, way, numbers, friction):  # type: ignore[no-untyped-def]
    """One step of Runge and Kutta of the places and speeds of table and motor, and of the sum of the error."""
    half = begin + 0.5 * h * slope
    first = _rates(y, begin, slope, touch, way, numbers, friction)
    second = _rates(_along(y, first, 0.5 * h), half, slope, touch, way, numbers, friction)
    third = _rates(_along(y, second, 0.5 * h), half, slope, touch, way, numbers, friction)
    fourth = _rates(_along(y, third, h), begin + h * slope, slope, touch, way, numbers, friction)
    y = _along(_along(y, first, h / 6.0), second, h / 3.0)
    return _along(_along(y, third, h / 3.0), fourth, h / 6.0)


@numba.njit(cache=True)
def _together(y, h, begin, slope, way, numbers, friction):  # type: ignore[no-untyped-def]
    """The same step while both touch: the motor goes along with the table, whose place and speed are all there is."""
    b, c, ki, kd, _, _ = numbers
    x, v, total, middle, end = y[0], y[1], y[4], begin + 0.5 * h * slope, begin + h * slope
    if way == 0:
        return (x, v, y[2], y[3], total + h * (middle - x))
    light, half = 1.0 / b, 0.5 * h
    off = begin - x
    rate = light * (off + ki * total + kd * (slope - v) - c * v - _resisting(v, way, friction))
    speed, left = v + half * rate, middle - x - half * v
    asked = left + ki * (total + half * off)
    second = light * (asked + kd * (slope - speed) - c * speed - _resisting(speed, way, friction))
    pace, less = v + half * second, middle - x - half * speed
    asked = less + ki * (total + half * left)
    third = light * (asked + kd * (slope - pace) - c * pace - _resisting(pace, way, friction))
    last, least = v + h * third, end - x - h * pace
    asked = least + ki * (total + h * less)
    fourth = light * (asked + kd * (slope - last) - c * last - _resisting(last, way, friction))
    sixth = h / 6.0
    place = x + sixth * (v + 2.0 * (speed + pace) + last)
    speed = v + sixth * (rate + 2.0 * (second + third) + fourth)
    total += sixth * (off + 2.0 * (left + less) + least)
    return (place, speed, place + (y[2] - x), speed, total)


@numba.njit(cache=True)
def _along(y, rate, h):  # type: ignore[no-untyped-def]
    return (y[0] + h * rate[0], y[1] + h * rate[1], y[2] + h * rate[2], y[3] + h * rate[3], y[4] + h * rate[4])


@numba.njit(cache=True)
def _output(y, command, slope, numbers):  # type: ignore[no-untyped-def]
    """What the controller gives."""
    return command - y[0] + numbers[2] * y[4] + numbers[3] * (slope - y[1])


@numba.njit(cache=True)
def _resisting(speed, way, friction):  # type: ignore[no-untyped-def]
    """Friction and load of a body that moves in a direction; 2 is a body without dry friction."""
    plus, minus, static, scale, up, down, load = friction
    if way == 2:
        return (up if speed > 0.0 else down) * speed
    dry = plus if way > 0 else -minus
    ratio = speed / scale if scale > 0.0 else np.inf
    if abs(ratio) < FAST:
        dry += way * static * np.exp(-(ratio**2))
    return dry + (up if way > 0 else down) * speed + load


@numba.njit(cache=True)
def _rates(y, command, slope, touch, way, numbers, friction):  # type: ignore[no-untyped-def]
    b, c, _, _, eta, beta = numbers
    u = _output(y, command, slope, numbers)
    free = u / (eta * b) - beta * y[3]
    if way == 0:
        # The table stands, and with it a motor that pushes it in vain.
        if touch:
            return (0.0, 0.0, 0.0, 0.0, command - y[0])
        return (0.0, 0.0, y[3], free, command - y[0])
    resists = _resisting(y[1], way, friction)
    table = (u - c * y[1] - resists) / b
    if not touch:
        table = (-(c - eta * beta * b) * y[1] - resists) / ((1.0 - eta) * b)
    motor = table if touch else free
    return (y[1], table, y[3], motor, command - y[0])


@numba.njit(cache=True)
def _at_rest(y, way, touch):  # type: ignore[no-untyped-def]
    """State and direction, at rest where the table would turn round."""
    if way in (1, -1) and way * y[1] < 0.0:
        return (y[0], 0.0, y[2], 0.0 if touch else y[3], y[4]), 0
    return y, way


@numba.njit(cache=True)
def _breaks_away(y, command, slope, touch, numbers, friction):  # type: ignore[no-untyped-def]
    """Direction in which a table at rest is driven on; 0 where friction holds it."""
    drive = _output(y, command, slope, numbers) if touch else 0.0
    net = drive - friction[6]
    if net > friction[0] + friction[2]:
        return 1
    return -1 if net < -friction[1] - friction[2] else 0


@numba.njit(cache=True)
def _after_contact(y, before, command, slope, touch, way, numbers, friction, rule):  # type: ignore[no-untyped-def]
    """State, and the side that is still touched: none once the contact force, or else the speed, changes its sign."""
    b, c, _, _, eta, beta = numbers
    u = _output(y, command, slope, numbers)
    if way == 0:
        # At rest the motor leaves the side as soon as it is pulled.
        return y, (touch if touch * u >= 0.0 else 0)
    if rule == 2:
        own = eta * (c - beta * b) * y[1] + eta * _resisting(y[1], way, friction)
        return y, (touch if touch * ((1.0 - eta) * u + own) >= 0.0 else 0)
    if touch * y[1] < 0.0 and touch * before >= 0.0:
        return (y[0], 0.0, y[2], 0.0, y[4]), 0
    return y, touch


@numba.njit(cache=True)
def _meet(y, half, touch, eta, rule):  # type: ignore[no-untyped-def]
    """The motor has come to a side: both stand, or go on with their common momentum."""
    together = 0.0 if rule == 0 else y[1] + eta * (y[3] - y[1])
    if rule == 1 and touch * together < 0.0:
        together = 0.0
    return (y[0], together, y[0] + touch * half, together, y[4])


class Nominal:
    """Distance from a path that is known by many points of it."""

    def __init__(self, points: Floats) -> None:
        self.points = points
        self.tree = cKDTree(points)

    def distance(self, places: Floats) -> Floats:
        """Distance (n,) of places from the nearest of the straight lines between neighbouring points [m]."""
        nearest = self.tree.query(places)[1]
        last = len(self.points) - 1
        found = np.full(len(places), np.inf)
        for first in (np.maximum(nearest - 1, 0), np.minimum(nearest, last - 1)):
            begin, way = self.points[first], self.points[first + 1] - self.points[first]
            square = np.maximum((way * way).sum(axis=1), 1e-30)
            share = np.clip(((places - begin) * way).sum(axis=1) / square, 0.0, 1.0)
            found = np.minimum(found, np.linalg.norm(places - begin - share[:, None] * way, axis=1))
        return found


def settling(bodies) -> float:
    """Time at the beginning of a motion that does not count [s]."""
    return SETTLED * max(2.0 * one.b / one.c if one.c else 0.0 for one in bodies)
