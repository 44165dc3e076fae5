"""Offsets added to the points of the path: inverse dynamics, crossings of the gap, jogs, and lasting offsets.

The command is worked out backwards. The table is to be on the path; this and the crossings give the motion of
the motor, and that by the inverse of the servo (:mod:`ph_post.compensate.inverse`) what is added to the position.

A jog is a crossing that a part program can carry: between two dwells, while the path stands still, one axis
makes a short move of its own. Controllers without a limit of jerk run such a move with straight ramps, which
is what is written here.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.friction import FrictionLead, friction_of_machine
from ph_post.compensate.inverse import lead_of_crossing, lead_of_force, lead_of_motion
from ph_post.compensate.lead import END, lead_window, let_go, memory_of_lead, smoothed
from ph_post.compensate.limit_curve import axis_limits
from ph_post.compensate.motion import MotionLaw, cycle_time, sample
from ph_post.compensate.violations import at_rest_around, command_noise, usage
from ph_post.drive.cascade import response_time
from ph_post.geometry.bernstein import derivative, evaluate
from ph_post.geometry.track import Track
from ph_post.types import Array, Axis, BoolArray, Command, Crossing, Gap, Jog, Machine, Phase, Plan, frozen
from ph_post.units import MM, MM_PER_MIN, MS

DWELL: Final = 10.0 * MS
"""Least dwell [s] before and after a jog: LinuxCNC, with a period of 1 ms, has been seen to stand still at
both ends of jogs so separated, and to keep the time between them within 1 ms."""

SETTLED: Final = 3.0
"""After so many of its time constants c an axis has made 95 % of a crossing that was commanded."""

LEAST: Final = 2.5e-3 * MM
"""Shortest jog [m]: shorter ones drown in the decimals of serial controllers and in the steps of motors. A
smaller gap behind its loop is left alone."""

PART: Final = 0.5
"""Part of an axis' acceleration that a jog takes. LinuxCNC under G64 keeps the other half for blends, whether
there are any or not (seen: 126 of 250 mm/s²); who runs a jog quicker does no harm, as the path rests."""

LEAST_APPROACH: Final = 0.1 * MM
"""An axis is approached over at least this far [m]: the play of a worn router, so that a machine file that
knows of no lost motion does not leave the flank to chance."""

LOST_MOTIONS: Final = 2.0
"""The approach covers the lost motion so many times: the gap is taken up wherever in it the axis stood, with
as much again for what the machine file does not know."""

APPROACH_FEED: Final = 300.0 * MM_PER_MIN
"""Feed of the approach [m/s], or the path's where that is less: the shortest offset then lasts 20 ms, several
times a servo's response, and no drive lags by more than a part of it."""


def make_jog(axis: Axis, travel: float, start: float, feed: float = math.inf) -> Jog:
    """Return the jog of an axis by `travel` [m] at `start` [s], no faster than `feed` [m/s].

    It is given no more velocity than its ramps reach, so that a controller with a higher acceleration does
    not run it much faster.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> jog = make_jog(read_machine("stepper").axes["X"], 20e-6, 0.0)
    >>> jog.velocity == (jog.acceleration * 20e-6) ** 0.5
    True
    """
    acceleration = PART * axis.limits.acceleration
    reached = math.sqrt(abs(travel) * acceleration)
    return Jog(
        axis=axis.name,
        start=start,
        travel=travel,
        velocity=min(reached, axis.limits.velocity, feed),
        acceleration=acceleration,
    )


def whole_jog(axis: Axis, direction: int, start: float) -> Jog:
    """Cross the whole gap once, beginning at `start` [s]."""
    return make_jog(axis, axis.gap.lost_motion * direction, start)


def corner_pause(axis: Axis) -> float:
    """Return how long the path rests before and behind a jog in a corner, of an axis with its gap behind [s].

    An earlier jog would call the motor back before the table has come to the corner, and going on earlier
    would begin with the motor still in the gap. Where an axis turns smoothly neither shows, as it hardly
    moves there.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> [round(corner_pause(read_machine(name).axes["X"]), 6) for name in ("stepper", "router")]
    [0.01, 0.0501]
    """
    return max(DWELL, SETTLED * response_time(axis.servo))


def may_shift(axis: Axis) -> bool:
    """Return whether a program gives an axis a lasting offset: behind its loop, where the gap is worth a jog."""
    return not axis.loop.encloses_backlash and axis.gravity_side is None and axis.gap.lost_motion >= LEAST


def approach_distance(gap: Gap) -> float:
    """Distance before the start of a cut from which an axis approaches it [m]."""
    return max(LOST_MOTIONS * gap.lost_motion, LEAST_APPROACH)


def jog_travel(jog: Jog, t: Array) -> Array:
    """Way [m] that a jog has covered at `t` [s], shape (n,), signed.

    Examples
    --------
    >>> jog = Jog(axis="X", start=1.0, travel=-3.0, velocity=1.0, acceleration=1.0)
    >>> jog_travel(jog, np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0])).tolist()
    [0.0, 0.0, -0.5, -1.5, -2.5, -3.0, -3.0]
    """
    duration, way = jog.duration, abs(jog.travel)
    since = np.clip(t - jog.start, 0.0, duration)
    ramp = min(jog.velocity / jog.acceleration, 0.5 * duration)
    peak = jog.acceleration * ramp
    rising = 0.5 * jog.acceleration * np.minimum(since, ramp) ** 2
    left = np.minimum(duration - since, ramp)
    level = peak * np.clip(since - ramp, 0.0, duration - 2.0 * ramp)
    falling = np.where(since > duration - ramp, 0.5 * peak * ramp - 0.5 * jog.acceleration * left**2, 0.0)
    covered = np.where(since >= duration, way, rising + level + falling)
    return np.asarray(covered if jog.travel > 0.0 else 0.0 - covered)


def jogged(jogs: Sequence[Jog], axes: Sequence[str], t: Array) -> Array:
    """Sum of jogs at `t` [s] by axis [m], shape (n, dim)."""
    moved = np.zeros((t.size, len(axes)))
    for jog in jogs:
        moved[:, axes.index(jog.axis)] += jog_travel(jog, t)
    return frozen(moved)


def approach_time(plan: Plan) -> float:
    """Time [s] at the beginning of a plan that belongs to the program's approach, which any program has."""
    seats = any(isinstance(one, Jog) and one.start == 0.0 for one in plan.crossings)
    return plan.phases[0].duration if seats else 0.0


def plan_time(plan: Plan) -> float:
    """Time [s] that a plan takes: without a program's approach, which any has, but with what a table begins with."""
    return cycle_time(plan.phases) - approach_time(plan)


def lead_in(phases: Sequence[Phase], crossings: Sequence[Crossing | Jog]) -> float:
    """Time [s] at the beginning of a motion for a table in which axes are brought onto their sides, before the path.

    The tool is to be off the part meanwhile: until an axis is on its side it is up to half its backlash away from the
    start. In the table these rows have negative times.
    """
    shifts = any(isinstance(one, Crossing) and one.start == 0.0 for one in crossings)
    still = phases[0].s == 0.0 and not phases[0].speed.any()
    return phases[0].duration if shifts and still else 0.0


EDGE = 0.3
"""Part of a push that it takes to rise, and to fall."""

FADE = 4.0
"""Duration of the shortest fade of the inverse dynamics, in units of the servo's √b; each next one is twice as long."""

DEPTHS = (0.05, 0.1, 0.2, 0.35, 0.6, 1.0)
"""Parts of what is left of the inverse dynamics that are faded out in turn, until the limits are kept."""

LEAST_FADE = 16
"""Samples that a fade lasts at least."""


class Offsets(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Offsets that are added to a path.

    `bias` [m] is the lasting offset at the beginning by axis; `lead` adds inverse dynamics, `part` of it, with `fade`
    only where the command keeps the limits, through a window of `width` times the usual one. `friction` is what is led
    of that.
    """

    crossings: tuple[Crossing | Jog, ...] = ()
    bias: Mapping[str, float] = {}
    lead: bool = True
    fade: bool = True
    friction: FrictionLead = FrictionLead()
    part: float = 1.0
    width: float = 1.0


def command_of(plan: Plan, track: Track, period: float, *, fade: bool = True) -> Command:
    """Sample a plan with everything that its strategy adds to the path, one row a servo period.

    Inverse dynamics is faded out where the command that includes it would break a limit.

    Parameters
    ----------
    plan : Plan
    track : Track
        Of the plan's path.
    period : float
        Servo period [s].
    fade : bool, optional
        False to keep all of the inverse dynamics, limits or not.

    Returns
    -------
    Command
    """
    plain = sample(plan, track, period)
    if not (plan.inverse_dynamics or plan.crossings or any(plan.bias.values())):
        return plain
    rate = MotionLaw.from_phases(plan.phases).acceleration(plain.t)
    speed, acceleration = path_derivatives(plain, track, rate)
    friction, lead = _friction_lead(plan, speed), plan.inverse_dynamics
    offsets = Offsets(
        crossings=plan.crossings,
        bias=plan.bias,
        lead=lead,
        fade=fade,
        part=plan.lead,
        width=plan.lead_width,
        friction=friction,
    )
    return add_offsets(plain, speed, acceleration, plan.machine, offsets)


def _friction_lead(plan: Plan, speed: Array) -> FrictionLead:
    """Return what a plan leads of the friction; a motion that does not begin at rest begins with all of it."""
    if not (plan.inverse_dynamics and plan.friction_part):
        return FrictionLead()
    axes = friction_of_machine(plan.machine, plan.path.axes)
    initial = {} if not speed[0].any() else dict(zip(plan.path.axes, np.sign(speed[0]).astype(int), strict=True))
    return FrictionLead(axes=axes, part=plan.friction_part, initial=initial, changes=plan.friction)


def path_derivatives(command: Command, track: Track, rate: Array) -> tuple[Array, Array]:
    """Velocity and acceleration of the axes [m/s, m/s²], shape (n, dim); `rate` (n,) is dV/dt along the path.

    Where the path has no derivatives by arc length, at a cusp where the motion rests, they count as zero.
    """
    return axis_motion(track, command.s, command.feed, rate)[1:]


def axis_motion(track: Track, s: Array, feed: Array, rate: Array) -> tuple[Array, Array, Array]:
    """Place, velocity and acceleration of the axes [m, m/s, m/s²], (n, dim), at arc lengths `s` (n,) [m] of a path.

    `feed` [m/s] is the speed along it and `rate` [m/s²] its change. Where the path has no derivatives they count as 0.
    """
    with np.errstate(all="ignore"):
        place, tangent, bend = track.arc_derivatives(*track.locate(s), 2)
    for rows in (tangent, bend):
        rows[~np.isfinite(rows)] = 0.0
    pace = feed[:, np.newaxis]
    return place, tangent * pace, bend * pace**2 + tangent * rate[:, np.newaxis]


def add_offsets(command: Command, speed: Array, acceleration: Array, machine: Machine, offsets: Offsets) -> Command:
    """Add lasting offsets, crossings and inverse dynamics to a command on the path.

    Parameters
    ----------
    command : Command
        On the path.
    speed, acceleration : Array, shape (n, dim)
        Of the path's points [m/s, m/s²].
    machine : Machine
    offsets : Offsets

    Returns
    -------
    Command
        With what was added as its `offset`.
    """
    fixed, dynamic, led = np.empty_like(speed), np.empty_like(speed), [speed, acceleration]
    window = lead_window(machine, command.axes, offsets.width) if offsets.lead else None
    rests = bool(command.feed[0] == 0.0), bool(command.feed[-1] == 0.0)
    if window is not None:
        shift = smoothed(command.position, window.half, rests) - command.position
        led = [offsets.part * smoothed(rows, window.half, rests) for rows in (speed, acceleration)]
    kept = None
    if window is not None and rests[1]:
        kept = let_go([machine.axes[name].servo for name in command.axes], window, len(speed))
    for number, name in enumerate(command.axes):
        fixed[:, number], dynamic[:, number] = _one_axis(
            command, speed[:, number], [rows[:, number] for rows in led], machine.axes[name], offsets, kept
        )
    if window is not None:
        if kept is not None:
            dynamic *= kept[:, np.newaxis]
        fixed += _faded(command, machine, fixed, (shift, dynamic)) if offsets.fade else shift + dynamic
    jogs = [one for one in offsets.crossings if isinstance(one, Jog)]
    moved = jogged(jogs, command.axes, command.t) if jogs else None
    if moved is not None:
        fixed += moved
    return msgspec.structs.replace(
        command, position=frozen(command.position + fixed), offset=frozen(fixed), jogged=moved
    )


def _one_axis(
    command: Command, speed: Array, led: Sequence[Array], axis: Axis, offsets: Offsets, kept: Array | None
) -> tuple[Array, Array]:
    """Offsets of one axis: what must be there, and what inverse dynamics adds [m], shape (n,) each.

    `led` are the speed and acceleration that are led, through the window; `kept` is the part of the lead that rows of a
    motion which ends at rest have, see :func:`let_go`.
    """
    t, period = command.t, command.period
    mine = [one for one in offsets.crossings if isinstance(one, Crossing) and one.axis == axis.name]
    motor, fixed = np.zeros((3, t.size)), np.zeros(t.size)
    for one in mine:
        # Before it there is nothing, and behind it the travel is all that is left.
        begin, met, end = np.searchsorted(t, [one.start, one.start + one.duration, one.end]).tolist()
        motor[:, begin:met] += travelled(one, t[begin:met])
        motor[0, met:] += one.travel
        fixed[met:end] += pushed(one, t[met:end])
    inside, force = axis.loop.encloses_backlash, None
    if offsets.lead and axis.name in offsets.friction.axes:
        # Behind the loop friction is the motor's, which crosses the backlash beside the path.
        force = offsets.friction.share(axis.name, speed if inside else speed + motor[1], t)
    if not inside:
        fixed = fixed + offsets.bias.get(axis.name, 0.0) + motor[0]
    if inside or offsets.lead:
        # What leads a crossing stays where the path's own lead fades, or it would arrive late.
        fixed = fixed + lead_of_crossing(axis, motor[1], motor[2], force, period)
        if kept is not None and force is not None and memory_of_lead(axis.servo):
            # What an integrator has not yet taken over of friction would be cut off at the end, by any jerk.
            asked = lead_of_force(axis, force, period)
            if abs(asked[-1]) > END:
                fixed -= (1.0 - kept) * asked
    return fixed, lead_of_motion(axis, led[0], led[1], period) if offsets.lead else np.zeros(t.size)


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


def _faded(command: Command, machine: Machine, fixed: Array, added: Sequence[Array]) -> Array:
    """Fade the inverse dynamics out around samples on which the command with it breaks a limit.

    `added` are the path as the lead's window shows it, less the path, and the lead. All axes fade together: where one
    follows without lag and another does not, the path is lost. No more is faded out than need be, place by place: of
    the lead alone, or of both where the path through the window breaks a limit by itself. What breaks a limit with
    neither is no matter of theirs.
    """
    shift, dynamic = added
    if not _broken(command, machine, fixed + shift + dynamic).any():
        return np.asarray(shift + dynamic)
    alone = _broken(command, machine, fixed + shift)
    hopeless = alone & _broken(command, machine, fixed) if alone.any() else alone

    def broken(offset: Array) -> BoolArray:
        return _broken(command, machine, fixed + offset) & ~hopeless

    unit = max(np.sqrt(machine.axes[name].servo.b) for name in command.axes)
    shortest = max(int(np.ceil(FADE * unit / command.period)), LEAST_FADE)
    both = _faded_until(lambda weight: broken(weight * shift), np.ones(command.t.size), shortest)
    lead = _faded_until(lambda weight: broken(both[:, np.newaxis] * shift + weight * dynamic), both, shortest)
    return np.asarray(both[:, np.newaxis] * shift + lead[:, np.newaxis] * dynamic)


def _faded_until(broken: Callable[[Array], BoolArray], weight: Array, samples: int) -> Array:
    """Lower a weight (n,) around samples that are `broken` with it (n, 1), further and wider until none is.

    `samples` is the duration of the shortest fade; one that is longer than the whole is the last.
    """
    from scipy.ndimage import maximum_filter1d

    weight, found = weight.copy(), broken(weight[:, np.newaxis])
    while found.any():
        if samples > 2 * weight.size:
            return np.zeros_like(weight)
        for depth in DEPTHS:
            out = maximum_filter1d(found, 2 * (samples // 4) + 1, mode="constant")
            weight *= 1.0 - depth * (1.0 - _weight(out, samples))
            found = broken(weight[:, np.newaxis])
            if not found.any():
                break
        samples *= 2
    return weight


def _broken(command: Command, machine: Machine, offset: Array) -> BoolArray:
    """Return which samples take part in a difference that breaks a limit."""
    position = command.position + offset
    padded = at_rest_around(command, position)
    limits = axis_limits(command.axes, machine, command.period)
    noise = command_noise(command, position)
    found = np.zeros(len(padded), dtype=np.bool_)
    for order in (1, 2, 3):
        rows = np.flatnonzero((usage(padded, limits, order, noise) > 1.0).any(axis=1))
        for shift in range(order + 1):
            found[rows + shift] = True
    first = 3 if command.feed[0] == 0.0 else 0
    return np.asarray(found[first : first + len(position)])


def _weight(out: BoolArray, samples: int) -> Array:
    """0 on the samples marked, 1 that many samples away from them, smooth in between."""
    rows = np.arange(out.size)
    marked = np.flatnonzero(out)
    right = np.searchsorted(marked, rows)
    before = np.where(right > 0, rows - marked[np.maximum(right - 1, 0)], out.size)
    after = np.where(right < marked.size, marked[np.minimum(right, marked.size - 1)] - rows, out.size)
    distance = np.minimum(before, after) / samples
    weight, near = np.ones(out.size), distance < 1.0
    weight[near] = evaluate(smoothstep(3)[0], distance[near])
    return weight
