"""The linear drive of an axis: its response to a command, its motion, and the delay of a reading.

The loop b ẍ + c ẋ = e + (k_i/k_p) ∫e + (k_d/k_p) ė, or the cascade of :mod:`ph_post.drive.cascade`, has no backlash,
friction or other effect. A log is compared with it before anything is simulated.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace
from scipy import signal

from ph_post.drive.cascade import loop_polynomials, time_constant, with_cascade
from ph_post.drive.command_filters import arriving
from ph_post.identify.between import parts_between, refined
from ph_post.types import Array, Axis, BoolArray, IntArray, Log, Machine, Servo

TIME_CONSTANTS: Final = 10.0
"""Servo time constants after which the start is forgotten: e^-10 of it is left."""


def linear_response(command: Array, servo: Servo, period: float) -> Array:
    """Answer of the linear servo to a command that is linear between its samples.

    Parameters
    ----------
    command : Array, shape (n,)
        [m]; the axis rests at its first value before the log begins.
    servo : Servo
    period : float
        [s].

    Returns
    -------
    Array, shape (n,)
        [m].
    """
    if servo.b <= 0.0 and servo.c <= 0.0:
        return command.copy()
    start = command[0]
    if servo.cascade is not None:
        command = arriving(servo.cascade, command, 0.0, period).position
    return np.asarray(_passed(_loop(servo, period), command - start) + start)


def force_response(force: Array, servo: Servo, period: float) -> Array:
    """Return by how much a force, F/K [m], keeps the linear servo back, shape (n,) [m]; 0 for an ideal stepper."""
    if servo.b <= 0.0 and servo.c <= 0.0:
        return np.zeros_like(force)
    if servo.cascade is None:
        top = _stripped([1.0, 0.0] if servo.ki_over_kp else [1.0])
        return _passed((top, _loop(servo, period)[1]), force)
    loop = loop_polynomials(servo)
    return _passed((_per_sample(loop.resisted, period), _per_sample(loop.taken, period)), force)


def _passed(transfer: tuple[Array, Array], values: Array) -> Array:
    """Pass what is linear between samples through a transfer function in units of the period."""
    b, a, _ = signal.cont2discrete(transfer, 1.0, method="foh")
    return np.asarray(signal.lfilter(np.ravel(b), a, values), dtype=np.float64)


def _per_sample(polynomial: Array, period: float) -> Array:
    """Return a polynomial in s [1/s] as one in 1 / period."""
    return np.asarray(polynomial / period ** np.arange(polynomial.size - 1, -1, -1))


def drive_response(command: Array, servo: Servo, period: float) -> Array:
    """Answer of the linear servo at the rows (n,) of a log to a command that is smooth where these are far apart."""
    parts = parts_between(period)
    return linear_response(refined(command, parts), servo, period / parts)[::parts]


def servo_memory(servo: Servo) -> float:
    """Time constant of the servo's slowest answer, the larger of 2 b/c and c, or that of a cascade [s]."""
    if servo.cascade is not None:
        return time_constant(servo)
    return max(2.0 * servo.b / servo.c, servo.c) if servo.c > 0.0 else 0.0


def settling_time(axis: Axis) -> float:
    """Time after which an axis has forgotten how it started [s]."""
    return TIME_CONSTANTS * servo_memory(axis.servo)


def taken_up(command: Array, travel: float) -> int:
    """First sample by which a command has swept so much [m]: from there its past does not matter to a play.

    The last sample where it never does, or all of what it sweeps where that is less; 0 where it never moves.
    """
    swept = np.maximum.accumulate(command) - np.minimum.accumulate(command)
    return int(np.argmax(swept >= min(travel, float(swept[-1])))) if swept[-1] > 0.0 else 0


def _loop(servo: Servo, period: float) -> tuple[Array, Array]:
    """Transfer function of the closed loop in units of the period, numerator and denominator."""
    if servo.cascade is not None:
        loop = loop_polynomials(servo)
        return _per_sample(loop.given, period), _per_sample(loop.taken, period)
    b, c = servo.b / period**2, servo.c / period
    ki, kd = servo.ki_over_kp * period, servo.kd_over_kp / period
    integral = [ki] if ki else []
    return _stripped([kd, 1.0, *integral]), _stripped([b, c + kd, 1.0, *integral])


def _stripped(coefficients: list[float]) -> Array:
    """Coefficients from the first that is not zero on."""
    first = next(number for number, value in enumerate(coefficients) if value != 0.0)
    return np.array(coefficients[first:])


RESTING: Final = 1e-3
"""Speeds below this part of the largest one are rest: they have no direction of their own."""


class AxisMotion(NamedTuple):
    """The motion of one axis, all of shape (n,).

    `t` [s], `position` [m], `velocity` [m/s] and `acceleration` [m/s²] are those of the linear drive.
    `direction` is the last one it moved in (0 before it first moves); `since` [s] and `travel` [m] are what
    went by since it last reversed, `until` [s] and `left` [m] are what is left to the next reversal, infinite
    where there is none; `stroke` counts reversals. `others` are the positions of the other axes [m] by name,
    `path_speed` [m/s] that of all axes together. `turn` is 1 counterclockwise in the plane of this axis and
    the other that moves most, -1 clockwise, 0 where the path does not bend.
    """

    t: Array
    position: Array
    velocity: Array
    acceleration: Array
    direction: IntArray
    since: Array
    travel: Array
    until: Array
    left: Array
    stroke: IntArray
    others: dict[str, Array]
    path_speed: Array
    turn: IntArray


def motion_of(log: Log, machine: Machine, name: str) -> AxisMotion:
    """Lay out the motion of an axis and what goes with it."""
    position = {axis: linear_position(log, machine, axis) for axis in log.axes}
    velocity = {axis: np.gradient(values, log.period) for axis, values in position.items()}
    acceleration = np.gradient(velocity[name], log.period)
    direction = directions(velocity[name])
    since, travel, until, left, stroke = _strokes(position[name], direction, log.period)
    square = np.zeros(log.t.size)
    for values in velocity.values():
        square += values**2
    return AxisMotion(
        t=log.t,
        position=position[name],
        velocity=velocity[name],
        acceleration=acceleration,
        direction=direction,
        since=since,
        travel=travel,
        until=until,
        left=left,
        stroke=stroke,
        others={axis: values for axis, values in position.items() if axis != name},
        path_speed=np.sqrt(square),
        turn=_turn(velocity, name, log.period),
    )


def directions(velocity: Array) -> IntArray:
    """Direction of motion, 1 or -1; at rest the last one, 0 before the first motion; shape (n,)."""
    largest = float(np.max(np.abs(velocity)))
    sign = np.where(np.abs(velocity) > RESTING * largest, np.sign(velocity), 0.0).astype(np.int64)
    last = np.maximum.accumulate(np.where(sign != 0, np.arange(sign.size), -1))
    return np.where(last >= 0, sign[last], 0)


def linear_position(log: Log, machine: Machine, name: str) -> Array:
    """Return where the linear drive of an axis alone goes by its command [m], (n,)."""
    command, drive = log.axes[name].command, machine.axes.get(name)
    return command if drive is None else drive_response(command, drive.servo, log.period)


def _strokes(position: Array, direction: IntArray, period: float) -> tuple[Array, Array, Array, Array, IntArray]:
    """Time and travel since the last reversal, both to the next, number of reversals before; each (n,)."""
    rows = np.arange(position.size)
    turned = np.concatenate(([False], (np.diff(direction) != 0) & (direction[:-1] != 0)))
    stroke = np.cumsum(turned)
    at = np.flatnonzero(turned)
    begin = np.concatenate(([0], at))[stroke]
    end = np.concatenate((at, [position.size]))[stroke]
    since = np.where(stroke > 0, (rows - begin) * period, np.inf)
    travel = np.where(stroke > 0, np.abs(position - position[begin]), np.inf)
    until = np.where(end < position.size, (end - rows) * period, np.inf)
    left = np.where(end < position.size, np.abs(position[end - 1] - position), np.inf)
    return since, travel, until, left, stroke


def _turn(velocity: dict[str, Array], name: str, period: float) -> IntArray:
    """Return which way the path bends in the plane of this axis and the other that moves most, by name."""
    others = {axis: float(np.ptp(values)) for axis, values in velocity.items() if axis != name}
    still = np.zeros(velocity[name].size, dtype=np.int64)
    if not others or max(others.values()) == 0.0:
        return still
    other = max(others, key=lambda axis: others[axis])
    first, second = sorted((name, other))
    u, v = velocity[first], velocity[second]
    bend = u * np.gradient(v, period) - v * np.gradient(u, period)
    speed = np.hypot(u, v)
    bent = np.abs(bend) > 1e-3 * float(np.max(np.abs(bend)))
    return np.where(bent & (speed > RESTING * np.max(speed)), np.sign(bend), 0.0).astype(np.int64)


def halves(motion: AxisMotion) -> BoolArray:
    """Split a log into two halves that both see all of the motion: strokes by pairs, or pieces of time."""
    if motion.stroke[-1] >= 7:
        return np.asarray(motion.stroke // 2 % 2 == 0)
    return np.asarray(np.arange(motion.t.size) * 24 // motion.t.size % 2 == 0)


PRIOR: Final = 0.02
"""Relative standard error of b and c, or of gains, where the machine file gives none."""

UNKNOWN: Final = 5
"""Coefficients of which nothing is known beforehand; those behind them are relative changes of the drive's numbers."""

PLAIN: Final = 0.7
"""Mean square that a shift must leave at most, as a part of what is left without one."""

CLEAR: Final = 3.0
"""Standard errors by which a shift must differ from zero to be one."""

ROUNDS: Final = 4
"""Steps of Newton: a shift of a few samples is not small against the curvature of a motion."""

INDISTINCT: Final = 1e-9
"""Part of a column's square below which it is made of the others."""

SIZES: Final = 1e-3
"""Relative step of the numerical derivatives by the drive's numbers."""


def find_shift(log: Log, machine: Machine, name: str, reading: Array, first: int) -> float | None:
    """Find the delay of a reading by least squares against the linear drive [s].

    Beside the delay the drive's b and c may be off by what the file leaves open, and there may be an offset,
    a scale and a force that changes sign with the velocity: a delay is what they do not explain.

    Returns
    -------
    float or None
        0 where a shift of a sample would be seen and is not there; None where the log does not show it:
        the error of the shift is as large, or other parameters explain the log about as well.
    """
    drive = machine.axes.get(name)
    if drive is None or np.ptp(log.axes[name].command) == 0.0:
        return None
    columns, model = _columns(log, name, drive.servo)
    known = np.isfinite(reading)
    known[:first] = False
    if np.count_nonzero(known) < 10 * columns.shape[1]:
        return None
    residual = (reading - model)[known]
    prior = np.where(np.arange(columns.shape[1]) < UNKNOWN, 0.0, 1.0 / PRIOR)
    without = _least_squares(columns[known, 1:], residual, prior[1:])
    shift, found = 0.0, without
    rows = np.arange(reading.size, dtype=np.float64)
    for _ in range(ROUNDS):
        late = rows - shift / log.period
        expected = np.interp(late, rows, model)
        moved = np.column_stack([np.interp(late, rows, column) for column in columns.T])
        found = _least_squares(moved[known], (reading - expected)[known], prior)
        shift += found.value
    if abs(shift) <= CLEAR * found.error:
        return 0.0 if found.error < 0.5 * log.period else None
    return shift if found.square < PLAIN * without.square else None


def _columns(log: Log, name: str, servo: Servo) -> tuple[Array, Array]:
    """Differentiate the model by shift, offset, scale, play, friction and the drive's numbers; and the model."""
    command, period = log.axes[name].command, log.period
    model = drive_response(command, servo, period)
    speed = np.gradient(model, period)
    by_number = [(drive_response(command, other, period) - model) / SIZES for other in _others(servo)]
    ones = np.ones_like(model)
    way = -np.sign(speed)
    friction = force_response(way, servo, period)
    return np.column_stack((-speed, ones, model - model.mean(), way, friction, *by_number)), model


def _others(servo: Servo) -> tuple[Servo, ...]:
    """Return servos that differ a little in one of their numbers each."""
    if servo.cascade is None:
        return tuple(replace(servo, **{name: getattr(servo, name) * (1.0 + SIZES)}) for name in ("c", "b"))
    names = ("position_gain", "velocity_gain", "velocity_feedforward")
    moved = (replace(servo.cascade, **{name: getattr(servo.cascade, name) * (1.0 + SIZES)}) for name in names)
    return tuple(with_cascade(servo, one) for one in moved)


class ShiftFit(NamedTuple):
    """First coefficient, its standard error, and the mean square that is left."""

    value: float
    error: float
    square: float


def _least_squares(columns: Array, residual: Array, prior: Array) -> ShiftFit:
    """Fit columns whose coefficients are 0 with a weight; neighbouring residuals may go together."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scale[scale == 0.0] = 1.0
    q = columns / scale
    spread = float(np.std(residual)) or 1.0
    for _ in range(2):
        weight = (spread * prior / scale) ** 2
        inverse = np.linalg.pinv(q.T @ q + np.diag(weight))
        found = inverse @ (q.T @ residual)
        left = residual - q @ found
        spread = math.sqrt(float(np.mean(left**2)) * _together(left)) or 1e-300
    others = np.linalg.lstsq(q[:, 1:], q[:, 0], rcond=None)[0]
    own = float(np.mean((q[:, 0] - q[:, 1:] @ others) ** 2))
    shows = own > INDISTINCT and inverse[0, 0] > 0.0
    error = float(spread * math.sqrt(inverse[0, 0]) / scale[0]) if shows else math.inf
    return ShiftFit(float(found[0] / scale[0]), error, float(np.mean(left**2)))


def _together(residual: Array) -> float:
    """Count the samples that say one thing: 1 + 2 Σ of the autocorrelation, to where it is below 0.05."""
    size = 1 << (2 * residual.size - 1).bit_length()
    power = np.abs(np.fft.rfft(residual - residual.mean(), size)) ** 2
    correlation = np.fft.irfft(power, size)[: residual.size]
    if correlation[0] <= 0.0:
        return 1.0
    correlation = correlation / correlation[0]
    end = int(np.argmax(correlation < 0.05)) or correlation.size
    return max(1.0, 1.0 + 2.0 * float(np.sum(correlation[1:end])))
