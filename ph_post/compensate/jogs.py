"""Jogs: crossings of the gap that a part program can carry.

Between two dwells, while the path stands still, one axis makes a short move of its own. Controllers without a
limit of jerk run such a move with straight ramps, which is what is written here.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ph_post.types import Array, Axis, Gap, Jog, Plan, frozen
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

LEAST_SEAT: Final = 0.1 * MM
"""An axis is approached over at least this far [m]: the play of a worn router, so that a machine file that
knows of no lost motion does not leave the flank to chance."""

LOST_MOTIONS: Final = 2.0
"""The approach covers the lost motion so many times: the gap is taken up wherever in it the axis stood, with
as much again for what the machine file does not know."""

SEAT_FEED: Final = 300.0 * MM_PER_MIN
"""Feed of the approach [m/s], or the path's where that is less: the shortest offset then lasts 20 ms, several
times a servo's response, and no drive lags by more than a part of it."""


def make_jog(axis: Axis, travel: float, start: float, feed: float = math.inf) -> Jog:
    """Return the jog of an axis by `travel` [m] at `start` [s], no faster than `feed` [m/s].

    It is given no more velocity than its ramps reach, so that a controller with a higher acceleration does
    not run it much faster.

    Examples
    --------
    >>> from ph_post.io.machinefile import read_machine
    >>> jog = make_jog(read_machine("stepper").axes["X"], 20e-6, 0.0)
    >>> jog.velocity == (jog.acceleration * 20e-6) ** 0.5
    True
    """
    acceleration = PART * axis.limits.acceleration
    reached = math.sqrt(abs(travel) * acceleration)
    return Jog(
        axis=axis.name, start=start, travel=travel, velocity=min(reached, axis.limits.velocity, feed),
        acceleration=acceleration,
    )  # fmt: skip


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
    >>> from ph_post.io.machinefile import read_machine
    >>> [round(corner_pause(read_machine(name).axes["X"]), 6) for name in ("stepper", "router")]
    [0.01, 0.0501]
    """
    return max(DWELL, SETTLED * axis.servo.c)


def carries_offset(axis: Axis) -> bool:
    """Whether a program gives an axis a lasting offset: behind its loop, where the gap is worth a jog."""
    return axis.feedback != "load" and axis.gap.lost_motion >= LEAST


def seat_distance(gap: Gap) -> float:
    """How far before the start of a cut an axis is approached from [m]."""
    return max(LOST_MOTIONS * gap.lost_motion, LEAST_SEAT)


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
