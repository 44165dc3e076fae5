"""A cascade as one linear system: its response, and what commands a motion.

In units of the position error, F/K with K = J ω_v K_v, engaged and without friction, the axis is

    (1 + T_i D) (b D² + d D) x = (1 + 1/(T_n D)) p + b a_f D² X,   p = X - x + (k_f D X + l D² X - D x) / K_v

where D is the time derivative, b = 1 / (ω_v K_v) and d the axis' own damping; X is the command behind dead time and
filters. Response, stability and the inverse are those of this equation; :mod:`ph_post.drive.automaton` holds it row by
row. Without feed-forward, T_n and T_i it is Eq. (9) of [1]_ with c = d + 1/K_v.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 3.
.. [2] H. Groß, J. Hamann, G. Wiegärtner: Elektrische Vorschubantriebe in der Automatisierungstechnik, Publicis 2006:
   the cascade, its gains and its feed-forward.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.drive.command_filters import ComplexArray, arriving, filter_response, mean_delay, memory
from ph_post.drive.linear_system import respond
from ph_post.types import Array, Cascade, Servo

FADED: Final = 20.0
"""Time constants after which nothing is left of a transient that shows (e^-20)."""

BLIND: Final = 0.2
"""Filters of the command are undone where this part or more of a frequency passes: a moving average has zeros."""

DEAF: Final = 0.05
"""Least part of a frequency that a loop is taken to hear of its command."""


def poles(servo: Servo) -> ComplexArray:
    """Return the poles of a cascade while motor and table move as one [1/s], complex, shape (n,)."""
    cascade = servo.cascade
    assert cascade is not None
    tau, rate, lag = 1.0 / cascade.position_gain, cascade.integral_rate, cascade.current_time
    b, d = servo.b, servo.damping
    rows = [lag * b, b + lag * d, d + tau, 1.0 + tau * rate, rate]
    return np.asarray(np.roots(np.trim_zeros(rows)))


def is_stable(servo: Servo) -> bool:
    """Return whether a cascade settles.

    Examples
    --------
    >>> quick = Cascade(position_gain=600.0, velocity_gain=300.0, current_time=2e-3)
    >>> is_stable(Servo(b=1.0 / 180000.0, c=1.0 / 600.0, cascade=quick))
    False
    """
    return bool(np.all(poles(servo).real < 0.0))


def with_cascade(servo: Servo, cascade: Cascade) -> Servo:
    """Return a servo with other gains: the axis' own damping in 1/s stays what it is."""
    b = 1.0 / (cascade.velocity_gain * cascade.position_gain)
    return replace(servo, b=b, c=servo.damping / servo.b * b + 1.0 / cascade.position_gain, cascade=cascade)


def most_position_gain(servo: Servo) -> float:
    """Return the position gain below which a cascade settles, all else left as it is [1/s]; 0 where none is."""
    assert servo.cascade is not None
    most = 0.0
    for gain in np.geomspace(1e-3, 1.0, 601) * servo.cascade.position_gain:
        if not is_stable(with_cascade(servo, replace(servo.cascade, position_gain=gain))):
            break
        most = float(gain)
    return most


def time_constant(servo: Servo) -> float:
    """Time constant 2b/c of a single loop [s], the slowest one of a cascade, with what its filters reach back.

    0 for an ideal stepper.
    """
    if servo.cascade is None:
        return 2.0 * servo.b / servo.c if servo.c > 0.0 else 0.0
    return float(1.0 / np.min(-poles(servo).real)) + memory(servo.cascade)


def response_time(servo: Servo) -> float:
    """Time in which a servo answers [s]: c, and of a cascade what dead time and filters add to it.

    Examples
    --------
    >>> response_time(Servo(b=1e-4, c=0.02))
    0.02
    """
    return servo.c if servo.cascade is None else servo.c + mean_delay(servo.cascade)


class MovedBody(NamedTuple):
    """What a motor moves, and what of it the loop sees.

    `inertia` [s²] and `damping` [s] are the body's own. Of its speed the velocity loop sees the part `speed`, and of
    its place the position loop, and the command, the part `place` (1 or 0 each).
    """

    inertia: float
    damping: float
    speed: float = 1.0
    place: float = 1.0


def engaged_body(servo: Servo) -> MovedBody:
    """Return motor and table as one body."""
    return MovedBody(servo.b, servo.damping)


def loop_response(servo: Servo, omega: Array) -> ComplexArray:
    """Return what a cascade makes of a harmonic command while motor and table move as one, complex, shape (n,).

    Examples
    --------
    >>> servo = Servo(b=1.0 / 15000.0, c=0.02, cascade=Cascade(position_gain=50.0, velocity_gain=300.0))
    >>> bool(abs(loop_response(servo, np.array([10.0])) - 1.0 / (1.0 - 100.0 / 15000.0 + 0.2j)) < 1e-15)
    True
    """
    assert servo.cascade is not None
    s = 1j * np.asarray(omega, dtype=np.float64)
    asked, given = _asked(servo.cascade, engaged_body(servo), s), _given(servo.cascade, s)
    return np.asarray(filter_response(servo.cascade, omega) / (1.0 + s * asked / given))


class LoopPolynomials(NamedTuple):
    """A loop as polynomials in s, highest power first: taken(s) x = given(s) X - resisted(s) f, f a force on it [m]."""

    given: Array
    taken: Array
    resisted: Array


def loop_polynomials(servo: Servo) -> LoopPolynomials:
    """Return a loop while motor and table move as one, a cascade's behind dead time and filters of its command.

    Of a single loop that is 1 / (b s² + c s + 1): its integral and derivative gains do not count.
    """
    cascade = servo.cascade
    if cascade is None:
        taken = np.array([servo.b, servo.c, 1.0] if servo.b > 0.0 else [servo.c, 1.0])
        return LoopPolynomials(np.ones(1), taken, np.ones(1))
    tau = 1.0 / cascade.position_gain
    forward = np.array([tau * cascade.acceleration_lead, tau * cascade.velocity_feedforward, 1.0])
    torque = np.array([cascade.acceleration_feedforward * servo.b, 0.0, 0.0])
    late = np.array([cascade.current_time, 1.0])
    moving = np.polymul(late, [servo.b, servo.damping, 0.0])
    seen = np.array([tau, 1.0])
    if cascade.integral_rate:
        integrating = np.array([1.0, cascade.integral_rate])
        forward, torque = np.polymul(integrating, forward), np.append(torque, 0.0)
        moving, seen, late = np.append(moving, 0.0), np.polymul(integrating, seen), np.append(late, 0.0)
    sums = (np.polyadd(*rows) for rows in ((forward, torque), (moving, seen)))
    return LoopPolynomials(*(np.trim_zeros(one, "f") for one in (*sums, late)))


def way_of_motor(servo: Servo, command: Array, period: float) -> Array:
    """Return the way of a motor from rest, without friction, under a command that is linear between samples [m], (n,).

    Gains of a single loop do not count: it is 1 / (b s² + c s + 1).
    """
    loop = loop_polynomials(servo)
    sent = command if servo.cascade is None else arriving(servo.cascade, command, 0.0, period).position
    return respond(loop.given, loop.taken, sent, period)


def _sums(cascade: Cascade, s: ComplexArray) -> ComplexArray:
    """Return D / (D + 1/T_n), by which an integrator lets steady quantities go."""
    return s / (s + cascade.integral_rate) if cascade.integral_rate else np.ones_like(s)


def _given(cascade: Cascade, s: ComplexArray) -> ComplexArray:
    """Return what a metre of command gives beside its position error, which counts as 1."""
    forward = (cascade.velocity_feedforward + cascade.acceleration_lead * s) * s / cascade.position_gain
    torque = cascade.acceleration_feedforward / (cascade.velocity_gain * cascade.position_gain) * s * s
    return np.asarray(1.0 + forward + _sums(cascade, s) * torque)


def _asked(cascade: Cascade, body: MovedBody, s: ComplexArray) -> ComplexArray:
    """Return what each m/s of a body asks for beyond what its place gives by itself [s]."""
    sums, tau = _sums(cascade, s), 1.0 / cascade.position_gain
    ahead = tau * (cascade.velocity_feedforward + cascade.acceleration_lead * s)
    torque = cascade.acceleration_feedforward / (cascade.velocity_gain * cascade.position_gain) * s
    moving = (1.0 + cascade.current_time * s) * (body.inertia * s + body.damping)
    return np.asarray(sums * (moving - body.place * torque) + tau * body.speed - body.place * ahead)


def offset_of_motion(cascade: Cascade, body: MovedBody, speed: Array, period: float) -> Array:
    """Return what the command of a body's motion is beyond its place [m], shape (n,): the inverse of the loop.

    Parameters
    ----------
    cascade : Cascade
    body : MovedBody
    speed : Array, shape (n,)
        Of the body [m/s], sampled; before the first and behind the last sample it stays what it is.
    period : float
        [s].

    Examples
    --------
    >>> cascade = Cascade(position_gain=50.0, velocity_gain=300.0, velocity_feedforward=0.9, dead_time=1e-3)
    >>> round(float(offset_of_motion(cascade, MovedBody(1.0 / 15000.0, 0.0), np.full(100, 0.1), 1e-3)[0]), 9)
    0.0003
    """

    def transfer(s: ComplexArray) -> ComplexArray:
        response = _motion_transfer(cascade, body, s)
        # At half the rate of the rows an odd response jumps, which would ring at every other row for hundreds of them.
        part = np.clip(np.abs(s.imag) * period * 2.0 / np.pi - 1.0, 0.0, 1.0)
        response.imag *= np.cos(0.5 * np.pi * part) ** 2
        return response

    return _respond(transfer, speed, period, _reach(cascade))


def offset_of_force(cascade: Cascade, force: Array, period: float) -> Array:
    """Return what a force on the motor [m], as F/K, adds to the command [m], shape (n,).

    A force may step. Against a dead time a part of a row is made up for along a line between two rows: the exact
    inverse would ring at every other row, more than a jerk may be, for a fiftieth of a row already.
    """
    early = cascade.dead_time / period
    whole, in_time = math.floor(early), replace(cascade, dead_time=0.0)

    def transfer(s: ComplexArray) -> ComplexArray:
        advance = np.exp(whole * period * s) * (1.0 + (early - whole) * (np.exp(period * s) - 1.0))
        return np.asarray(_sums(cascade, s) / _bounded(_given(cascade, s)) * _unfiltered(in_time, s) * advance)

    return _respond(transfer, force, period, _reach(cascade))


def steady_offset(cascade: Cascade, body: MovedBody) -> tuple[float, float]:
    """Return what each m/s [s] and each m/s² [s²] of an even motion adds to its command, the latter to first order."""
    transfer = _motion_transfer(cascade, body, np.array([0.0, 1j * _SLOW]))
    return float(transfer[0].real), float(transfer[1].imag) / _SLOW


_SLOW: Final = 1e-2
"""A frequency so low that a response is linear in it [rad/s]."""


def _motion_transfer(cascade: Cascade, body: MovedBody, s: ComplexArray) -> ComplexArray:
    unfiltered = _unfiltered(cascade, s)
    late = np.full_like(s, mean_delay(cascade))
    np.divide(unfiltered - 1.0, s, out=late, where=s != 0.0)
    return np.asarray(_asked(cascade, body, s) / _bounded(_given(cascade, s)) * unfiltered + body.place * late)


def _unfiltered(cascade: Cascade, s: ComplexArray) -> ComplexArray:
    """Return the inverse of dead time and filters, as far as it has one."""
    response = filter_response(cascade, np.asarray(s.imag, dtype=np.float64))
    power = np.abs(response) ** 2
    return np.asarray(response.conj() / (power + BLIND**2 * (1.0 - power) ** 4))


def _bounded(response: ComplexArray) -> ComplexArray:
    """Keep what is divided by away from 0: there the command says nothing about the motion."""
    size = np.abs(response)
    return np.where(size < DEAF, DEAF * response / np.where(size > 0.0, size, 1.0) + (size == 0.0) * DEAF, response)


def memory_of_inverse(cascade: Cascade) -> float:
    """Slowest time constant of the zeros of a response, in which the lead of a motion dies away [s]; 0 without zeros.

    Examples
    --------
    >>> ahead = Cascade(position_gain=50.0, velocity_gain=300.0, velocity_feedforward=1.0, integral_rate=40.0)
    >>> round(memory_of_inverse(ahead), 9)
    0.025
    """
    tau, rate = 1.0 / cascade.position_gain, cascade.integral_rate
    forward = np.array([tau * cascade.acceleration_lead, tau * cascade.velocity_feedforward, 1.0])
    torque = np.array([cascade.acceleration_feedforward * tau / cascade.velocity_gain, 0.0, 0.0])
    if rate:
        forward, torque = np.polymul(forward, [1.0, rate]), np.append(torque, 0.0)
    zeros = np.roots(np.trim_zeros(np.polyadd(forward, torque), "f"))
    slowest = np.abs(zeros.real).min(initial=math.inf)
    return float(min(1.0 / slowest, _LONGEST * tau)) if slowest > 0.0 else _LONGEST * tau


_LONGEST: Final = 20.0
"""In units of 1 / K_v, a time constant beyond which a zero is not undone."""


def _reach(cascade: Cascade) -> float:
    """Time over which the inverse sees a motion, to either side [s]."""
    return FADED * max(memory_of_inverse(cascade), 1.0 / cascade.position_gain) + memory(cascade)


def _respond(transfer: Callable[[ComplexArray], ComplexArray], rows: Array, period: float, reach: float) -> Array:
    """Apply a transfer function to samples that stay what they are at both ends."""
    from scipy.fft import irfft, next_fast_len, rfft

    margin = max(math.ceil(reach / period), 1)
    turn = 0.5 - 0.5 * np.cos(np.pi * (np.arange(2 * margin) + 0.5) / (2 * margin))
    length = next_fast_len(rows.size + 4 * margin, real=True)
    around = np.full(length, rows[0])
    around[margin : margin + rows.size] = rows
    around[margin + rows.size : 2 * margin + rows.size] = rows[-1]
    end = 2 * margin + rows.size
    around[end : end + turn.size] = rows[-1] + turn * (rows[0] - rows[-1])
    s = 2j * np.pi * np.arange(length // 2 + 1) / (length * period)
    found: Array = irfft(rfft(around) * transfer(s), length)
    return np.asarray(found[margin : margin + rows.size])
