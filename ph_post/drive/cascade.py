"""A cascade as one linear system: its command on the way to the loop, its response, and what commands a motion.

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
.. [3] N. C. Singer, W. P. Seering: Preshaping command inputs to reduce system vibration, J. Dyn. Syst. Meas. Control
   112 (1990): the zero-vibration shaper.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

from ph_post.drive.linear_system import respond
from ph_post.types import Array, Cascade, Servo, frozen

ComplexArray = NDArray[np.complexfloating[Any, Any]]

FADED: Final = 20.0
"""Time constants after which nothing is left of a transient that shows (e^-20)."""

BLIND: Final = 0.2
"""Filters of the command are undone where this part or more of a frequency passes: a moving average has zeros."""

DEAF: Final = 0.05
"""Least part of a frequency that a loop is taken to hear of its command."""


def feeds_acceleration(cascade: Cascade) -> bool:
    """Return whether the acceleration of the command is fed forward."""
    return cascade.acceleration_feedforward != 0.0 or cascade.acceleration_lead != 0.0


class Arriving(NamedTuple):
    """What reaches a loop: the command (n,) [m], and its acceleration [m/s²], (0,) where that is not fed forward."""

    position: Array
    acceleration: Array


def arriving(cascade: Cascade, command: Array, slope: float, period: float) -> Arriving:
    """Return a command as it reaches the loop: late by the dead time, and filtered.

    Parameters
    ----------
    cascade : Cascade
    command : Array, shape (n,)
        As it was sent, linear between samples [m].
    slope : float
        Its speed before the first sample [m/s].
    period : float
        [s].

    Returns
    -------
    Arriving
        Exact at the samples. The acceleration is the second difference around them.

    Examples
    --------
    >>> late = Cascade(position_gain=50.0, velocity_gain=300.0, dead_time=1e-3)
    >>> arriving(late, np.array([0.0, 0.0, 1.0, 2.0]), 0.0, 1e-3).position
    array([0., 0., 0., 1.])
    """
    ramp = command[0] + slope * period * np.arange(command.size)
    off = _late(command - ramp, cascade.dead_time / period)
    off = _averaged(off, cascade.moving_average / period)
    off = _smoothed(off, cascade.exponential / period)
    if cascade.shaper_frequency:
        weight, delay = _impulses(cascade)
        off = weight * off + (1.0 - weight) * _late(off, delay / period)
    position = ramp - slope * mean_delay(cascade) + off
    if not feeds_acceleration(cascade):
        return Arriving(position, np.zeros(0))
    before, behind = position[0] - slope * period, 2.0 * position[-1] - position[-min(2, position.size)]
    return Arriving(position, np.diff(np.concatenate([[before], position, [behind]]), 2) / period**2)


def rates_of(place: Array, period: float) -> Array:
    """Return the speeds of places, shape (n,), of fourth order; beside a kink of the speed from the side without one.

    Examples
    --------
    >>> rates_of(np.array([0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0]), 1.0)
    array([1., 1., 1., 1., 0., 0., 0.])
    """
    steps = np.diff(place) / period
    if steps.size < 4:
        return np.asarray(np.gradient(place, period))
    bend = np.diff(steps)
    found = np.gradient(place, period)
    before, behind = steps[1:-2] + 0.5 * bend[:-2], steps[2:-1] - 0.5 * bend[2:]
    kinked = np.abs(before - behind) > 0.5 * np.abs(bend[1:-1])
    smooth = ~(kinked | np.append(kinked[1:], False) | np.append(False, kinked[:-1]))
    found[2:-2] -= np.where(smooth, (bend[2:] - bend[:-2]) / 12.0, 0.0)
    found[2:-2] = np.where(kinked, np.where(np.abs(bend[:-2]) < np.abs(bend[2:]), before, behind), found[2:-2])
    return np.asarray(found)


def _late(off: Array, samples: float) -> Array:
    """Delay what was 0 before the first sample."""
    if samples == 0.0:
        return off
    rows = np.arange(off.size, dtype=np.float64)
    return np.interp(rows - samples, rows, off, left=0.0)


def _averaged(off: Array, samples: float) -> Array:
    """Average over the samples before, of what is linear in between and was 0 before the first."""
    if samples == 0.0:
        return off
    whole = np.concatenate([[0.0], np.cumsum(0.5 * (off[1:] + off[:-1]))])
    begin = np.arange(off.size) - samples
    row = np.clip(np.floor(begin).astype(np.int64), 0, max(off.size - 2, 0))
    part = begin - row
    after = off[np.minimum(row + 1, off.size - 1)]
    until = whole[row] + part * (off[row] + 0.5 * part * (after - off[row]))
    return np.asarray((whole - np.where(begin > 0.0, until, 0.0)) / samples)


def _smoothed(off: Array, samples: float) -> Array:
    """Pass what is linear between samples, and was 0 before the first, through a lag of the first order."""
    if samples == 0.0:
        return off
    from scipy.signal import lfilter

    b, a = _lag(samples)
    return np.asarray(lfilter(b, a, off))


@lru_cache(maxsize=64)
def _lag(samples: float) -> tuple[Array, Array]:
    """Numerator and denominator of 1 / (1 + T s) for signals that are linear between samples."""
    kept = math.exp(-1.0 / samples)
    rest = -math.expm1(-1.0 / samples)
    return frozen([1.0 - samples * rest, samples * rest - kept]), frozen([1.0, -kept])


def _impulses(cascade: Cascade) -> tuple[float, float]:
    """Return the first impulse of a zero-vibration shaper, and by how much the second one is later [s]."""
    root = math.sqrt(1.0 - cascade.shaper_damping**2)
    overshoot = math.exp(-math.pi * cascade.shaper_damping / root)
    return 1.0 / (1.0 + overshoot), math.pi / (cascade.shaper_frequency * root)


def mean_delay(cascade: Cascade) -> float:
    """Time by which dead time and filters make a steady motion late [s].

    Examples
    --------
    >>> mean_delay(Cascade(position_gain=50.0, velocity_gain=300.0, dead_time=1e-3, moving_average=8e-3))
    0.005
    """
    late = cascade.dead_time + 0.5 * cascade.moving_average + cascade.exponential
    if cascade.shaper_frequency:
        weight, delay = _impulses(cascade)
        late += (1.0 - weight) * delay
    return late


def memory(cascade: Cascade) -> float:
    """Time that dead time and filters reach back [s]."""
    shaper = _impulses(cascade)[1] if cascade.shaper_frequency else 0.0
    return cascade.dead_time + cascade.moving_average + 5.0 * cascade.exponential + shaper


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
    >>> quick = Cascade(position_gain=400.0, velocity_gain=300.0, current_time=2e-3)
    >>> is_stable(Servo(b=1.0 / 120000.0, c=1.0 / 400.0, cascade=quick))
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


def filter_response(cascade: Cascade, omega: Array) -> ComplexArray:
    """Return what dead time and filters make of a harmonic command, complex, shape (n,); ω in rad/s.

    Examples
    --------
    >>> one = Cascade(position_gain=50.0, velocity_gain=300.0, exponential=1e-2)
    >>> complex(filter_response(one, np.array([100.0]))[0])
    (0.5-0.5j)
    """
    s = 1j * np.asarray(omega, dtype=np.float64)
    response = np.exp(-s * (cascade.dead_time + 0.5 * cascade.moving_average))
    response = response * np.sinc(0.5 * cascade.moving_average * omega / np.pi) / (1.0 + cascade.exponential * s)
    if cascade.shaper_frequency:
        weight, delay = _impulses(cascade)
        response = response * (weight + (1.0 - weight) * np.exp(-s * delay))
    return np.asarray(response)


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
    >>> offset_of_motion(cascade, MovedBody(1.0 / 15000.0, 0.0), np.full(100, 0.1), 1e-3).round(9)[0]
    0.0003
    """
    return _respond(lambda s: _motion_transfer(cascade, body, s), speed, period, _reach(cascade))


def offset_of_force(cascade: Cascade, force: Array, period: float) -> Array:
    """Return what a force on the motor [m], as F/K, adds to the command [m], shape (n,)."""

    def transfer(s: ComplexArray) -> ComplexArray:
        return np.asarray(_sums(cascade, s) / _bounded(_given(cascade, s)) * _unfiltered(cascade, s))

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
