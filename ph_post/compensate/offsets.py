"""What is added to the points of the path: inverse dynamics, crossings of the gap, and lasting offsets.

The command is worked out backwards. The table is to be on the path; that and the crossings tell how the
motor has to move, which tells the controller's output; and that tells the position error it takes, which is
added to the position. For a P controller it is X = x + c ẋ + b ẍ while a flank drives the table (Eq. 8 of
[1]_), and X = x_i + η b (m̈ + β ṁ) while the motor crosses the gap (Eq. 16, in units of the table).

References
----------
.. [1] doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import msgspec
import numpy as np

from ph_post.compensate.caps import axis_limits
from ph_post.compensate.jogs import jogged
from ph_post.compensate.limits import at_rest_before_and_after, rounding, usage
from ph_post.compensate.motion import Motion
from ph_post.compensate.sample import sample
from ph_post.geometry.bernstein import derivative, evaluate
from ph_post.geometry.track import Track
from ph_post.types import Array, Axis, BoolArray, Command, Crossing, Jog, Machine, Plan, Servo, frozen

EDGE = 0.3
"""Part of a push that it takes to rise, and to fall."""

FADES = (4.0, 4.0, 8.0, 8.0, 16.0, 32.0)
"""Durations of a fade of the inverse dynamics that are tried, in units of the servo's √b."""

DEPTHS = (0.1, 0.25, 0.5, 1.0)
"""Parts of the inverse dynamics that are faded out, until the limits are kept."""

LEAST_FADE = 16
"""Samples that a fade lasts at least."""


class Offsets(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What to add to a path.

    `bias` [m] is the lasting offset at the beginning by axis; `lead` adds inverse dynamics, with `fade` only
    where the command keeps the limits.
    """

    crossings: tuple[Crossing | Jog, ...] = ()
    bias: Mapping[str, float] = {}
    lead: bool = True
    fade: bool = True


def command_of(plan: Plan, track: Track, period: float) -> Command:
    """Sample a plan with everything that its strategy adds to the path, one row a servo period.

    Inverse dynamics is faded out where the command that includes it would break a limit.

    Parameters
    ----------
    plan : Plan
    track : Track
        Of the plan's path.
    period : float
        Servo period [s].
    """
    plain = sample(plan, track, period)
    if not (plan.inverse_dynamics or plan.crossings or any(plan.bias.values())):
        return plain
    rate = Motion.from_phases(plan.phases).acceleration(plain.t)
    speed, acceleration = path_derivatives(plain, track, rate)
    offsets = Offsets(crossings=plan.crossings, bias=plan.bias, lead=plan.inverse_dynamics)
    return add_offsets(plain, speed, acceleration, plan.machine, offsets)


def path_derivatives(command: Command, track: Track, rate: Array) -> tuple[Array, Array]:
    """Velocity and acceleration of the axes [m/s, m/s²], shape (n, dim); `rate` (n,) is dV/dt along the path.

    Where the path has no derivatives by arc length, at a cusp where the motion rests, they count as zero.
    """
    with np.errstate(all="ignore"):
        _, tangent, bend = track.arc_derivatives(*track.locate(command.s), 2)
    tangent, bend = (np.where(np.isfinite(rows), rows, 0.0) for rows in (tangent, bend))
    feed = command.feed[:, np.newaxis]
    return tangent * feed, bend * feed**2 + tangent * rate[:, np.newaxis]


def add_offsets(
    command: Command, speed: Array, acceleration: Array, machine: Machine, offsets: Offsets
) -> Command:
    """Add lasting offsets, crossings and inverse dynamics to a command on the path.

    Parameters
    ----------
    command : Command
        On the path.
    speed, acceleration : Array, shape (n, dim)
        Of the path's points [m/s, m/s²].
    machine : Machine
    offsets : Offsets
    """
    fixed, dynamic = np.empty_like(speed), np.empty_like(speed)
    for number, name in enumerate(command.axes):
        fixed[:, number], dynamic[:, number] = _one_axis(
            command, speed[:, number], acceleration[:, number], machine.axes[name], offsets
        )
    if offsets.lead:
        fixed += _faded(command, machine, fixed, dynamic) if offsets.fade else dynamic
    jogs = [one for one in offsets.crossings if isinstance(one, Jog)]
    moved = jogged(jogs, command.axes, command.t) if jogs else None
    if moved is not None:
        fixed += moved
    return msgspec.structs.replace(
        command, position=frozen(command.position + fixed), offset=frozen(fixed), jogged=moved
    )


def _one_axis(
    command: Command, speed: Array, acceleration: Array, axis: Axis, offsets: Offsets
) -> tuple[Array, Array]:
    """Offsets of one axis: what must be there, and what inverse dynamics adds [m], shape (n,) each."""
    t, servo, gap = command.t, axis.servo, axis.gap
    mine = [one for one in offsets.crossings if isinstance(one, Crossing) and one.axis == axis.name]
    motor = sum((travelled(crossing, t) for crossing in mine), np.zeros((3, t.size)))
    fixed = sum((pushed(crossing, t) for crossing in mine), np.zeros(t.size))
    if axis.feedback == "load":
        motor_inertia = (gap.inertia_fraction or 0.0) * servo.b
        crossing = motor_inertia * (motor[2] + (gap.beta or 0.0) * motor[1])
    else:
        # What leads a crossing stays where the path's own lead fades, or it would arrive late.
        crossing = offsets.lead * (servo.b * motor[2] + servo.c * motor[1])
        fixed = fixed + offsets.bias.get(axis.name, 0.0) + motor[0]
    fixed = fixed + error_for(servo, crossing, command.period)
    output = servo.b * acceleration + servo.c * speed
    return fixed, error_for(servo, output, command.period) if offsets.lead else np.zeros(t.size)


@lru_cache(maxsize=64)
def smoothstep(order: int) -> tuple[Array, Array, Array]:
    """Bernstein coefficients of a step from 0 to 1 with that many vanishing derivatives, and of two of those.

    Examples
    --------
    >>> smoothstep(1)[0].tolist()
    [0.0, 0.0, 1.0, 1.0]
    """
    step = np.array([0.0] * (order + 1) + [1.0] * (order + 1))
    return frozen(step), frozen(derivative(step)), frozen(derivative(step, 2))


@lru_cache(maxsize=8)
def peaks(order: int) -> tuple[float, ...]:
    """Return the largest size of the step of :func:`smoothstep` and of its derivatives up to the fifth."""
    step, u = smoothstep(order)[0], np.linspace(0.0, 1.0, 1001)
    rows = [step, *(derivative(step, k) for k in range(1, 6))]
    return tuple(float(np.abs(evaluate(row, u)).max()) for row in rows)


def travelled(crossing: Crossing, t: Array) -> Array:
    """Travel [m], speed [m/s] and acceleration [m/s²] of the motor at `t` [s], shape (3, n)."""
    u = np.clip((t - crossing.start) / crossing.duration, 0.0, 1.0)
    inside = (u > 0.0) & (u < 1.0)
    place, speed, acceleration = smoothstep(crossing.order)
    rows = np.zeros((3, t.size))
    rows[0] = u == 1.0
    rows[0, inside] = evaluate(place, u[inside])
    rows[1, inside] = evaluate(speed, u[inside]) / crossing.duration
    rows[2, inside] = evaluate(acceleration, u[inside]) / crossing.duration**2
    return np.asarray(crossing.travel * rows)


def pushed(crossing: Crossing, t: Array) -> Array:
    """Push at `t` [m]: up, held, and down again."""
    if crossing.push == 0.0 or crossing.push_duration == 0.0:
        return np.zeros(t.size)
    u = np.clip((t - crossing.start - crossing.duration) / crossing.push_duration, 0.0, 1.0)
    edge = np.clip(np.minimum(u, 1.0 - u) / EDGE, 0.0, 1.0)
    return np.asarray(crossing.push * evaluate(smoothstep(crossing.order)[0], edge))


def error_for(servo: Servo, output: Array, period: float) -> Array:
    """Position error that makes the controller give `output` [m], both sampled.

    Solves (k_d/k_p) ė + e + (k_i/k_p) ∫e = u for e, with u linear between samples; for a P controller e = u.
    """
    if servo.ki_over_kp == 0.0 and servo.kd_over_kp == 0.0:
        return output
    from scipy.signal import lfilter

    # Before the first sample there was steady motion: the integrator holds all of it, or the error does.
    steady = 0.0 if servo.ki_over_kp else output[0]
    return np.asarray(lfilter(*_error_filter(servo, period), output - output[0])) + steady


@lru_cache(maxsize=64)
def _error_filter(servo: Servo, period: float) -> tuple[Array, Array]:
    """Numerator and denominator of the filter that :func:`error_for` applies to samples."""
    from scipy.signal import cont2discrete

    numerator, denominator = [1.0, 0.0], [servo.kd_over_kp, 1.0, servo.ki_over_kp]
    if servo.ki_over_kp == 0.0:
        numerator, denominator = [1.0], [servo.kd_over_kp, 1.0]
    elif servo.kd_over_kp == 0.0:
        denominator = [1.0, servo.ki_over_kp]
    system: Any = (numerator, denominator)
    b, a, _ = cont2discrete(system, period, method="foh")
    return frozen(np.squeeze(b)), frozen(a)


def _faded(command: Command, machine: Machine, fixed: Array, dynamic: Array) -> Array:
    """Fade the inverse dynamics out around samples on which the command with it breaks a limit.

    All axes fade together: where one follows without lag and another does not, the path is lost. No more of
    it is faded out than need be.
    """
    broken = _broken(command, machine, fixed + dynamic)
    if not broken.any():
        return dynamic
    unit = max(np.sqrt(machine.axes[name].servo.b) for name in command.axes)
    for depth in DEPTHS:
        out, found = np.zeros(command.t.size, dtype=np.bool_), broken
        for fade in FADES:
            samples = max(int(np.ceil(fade * unit / command.period)), LEAST_FADE)
            out |= _widened(found, samples // 4)
            kept = (1.0 - depth * (1.0 - _weight(out, samples)))[:, np.newaxis] * dynamic
            found = _broken(command, machine, fixed + kept)
            if not found.any():
                return np.asarray(kept)
    return np.zeros_like(dynamic)


def _broken(command: Command, machine: Machine, offset: Array) -> BoolArray:
    """Which samples take part in a difference that breaks a limit."""
    position = command.position + offset
    before, after = bool(command.feed[0] == 0.0), bool(command.feed[-1] == 0.0)
    padded = at_rest_before_and_after(position, before, after)
    limits = axis_limits(command.axes, machine, command.period)
    speed = float(np.abs(command.feed).max())
    noise = rounding(float(np.abs(position).max()), float(command.s.max()), float(command.t[-1]), speed)
    found = np.zeros(len(padded), dtype=np.bool_)
    for order in (1, 2, 3):
        rows = np.flatnonzero((usage(padded, limits, order, noise) > 1.0).any(axis=1))
        for shift in range(order + 1):
            found[rows + shift] = True
    first = 3 if before else 0
    return np.asarray(found[first : first + len(position)])


def _widened(marked: BoolArray, samples: int) -> BoolArray:
    """Mark that many neighbours on either side too."""
    counts = np.cumsum(np.concatenate([[0], marked]))
    rows = np.arange(marked.size)
    low, high = np.maximum(rows - samples, 0), np.minimum(rows + samples + 1, marked.size)
    return np.asarray(counts[high] > counts[low])


def _weight(out: BoolArray, samples: int) -> Array:
    """0 on the samples marked, 1 that many samples away from them, smooth in between."""
    rows = np.arange(out.size)
    marked = np.flatnonzero(out)
    right = np.searchsorted(marked, rows)
    before = np.where(right > 0, rows - marked[np.maximum(right - 1, 0)], out.size)
    after = np.where(right < marked.size, marked[np.minimum(right, marked.size - 1)] - rows, out.size)
    distance = np.minimum(np.minimum(before, after) / samples, 1.0)
    return evaluate(smoothstep(3)[0], distance)
