"""Where a motion stands or creeps on the contour: what may leave a mark of the tool."""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.compensate import shapes
from ph_post.compensate.motion import MotionLaw, row_times, without_strategy
from ph_post.errors import InputError
from ph_post.geometry.numeric import runs
from ph_post.geometry.track import Track
from ph_post.types import Plan, ProfileShape
from ph_post.units import MM

CREEP: Final = 0.02
"""Part of the programmed feed below which the tool creeps."""

POINTS: Final = 257
"""Instants at which a shape is looked at."""


class Standstill(msgspec.Struct, frozen=True, kw_only=True):
    """A place along the path [m] at which the tool stands or creeps, and how long [s]."""

    s: float
    time: float


def standstills(plan: Plan, track: Track) -> tuple[Standstill, ...]:
    """Find where a motion is below :data:`CREEP` of the programmed feed; its beginning, its end and rapids left out.

    Parameters
    ----------
    plan : Plan
    track : Track
        Of its path.

    Returns
    -------
    tuple of Standstill
        In the order of time, whole servo periods each.
    """
    motion, period = MotionLaw.from_phases(plan.phases), plan.machine.servo_period
    s, feed = motion.place_and_feed(row_times(motion, period))
    segment, _ = track.to_xi(*track.locate(np.clip(s, 0.0, track.length)))
    asked = np.array([0.0 if one.rapid else one.feed or plan.path.feed for one in plan.path.segments])[segment]
    found = runs(np.flatnonzero(np.abs(feed) < CREEP * asked))
    inner = [run for run in found if run[0] > 0 and run[-1] < s.size - 1]
    return tuple(Standstill(s=float(s[run].mean()), time=period * run.size) for run in inner)


def standing_time(plan: Plan, track: Track) -> float:
    """Time [s] that the tool stands or creeps on the contour in all."""
    return sum((one.time for one in standstills(plan, track)), start=0.0)


def added_standing(plan: Plan, track: Track) -> float:
    """Time [s] that the tool stands or creeps longer than in the plain motion."""
    return standing_time(plan, track) - standing_time(without_strategy(plan), track)


def creep_of_shape(shape: ProfileShape, t_star: float, part: float) -> float:
    """Time [s] that a profile is below a part of the feed around it.

    Examples
    --------
    >>> creep_of_shape(shapes.single([0.0, 0.0, 1.0]), 0.5, 0.02) > 0.1
    True
    """
    slow = np.abs(shapes.value(shape, np.linspace(0.0, 1.0, POINTS))) < part
    return 2.0 * t_star * float(np.mean(slow))


def check_standstill(plan: Plan, track: Track, most: float | None) -> None:
    """Refuse a plan that stands or creeps longer than it may.

    Raises
    ------
    InputError
        Naming the strategy, and how long it does.
    """
    if most is None:
        return
    added = added_standing(plan, track)
    if added > most + 2.0 * plan.machine.servo_period:
        raise InputError(
            "--max-standstill",
            f"strategy {plan.strategy} stands or creeps on the contour for longer",
            expected=f"at least {added:.3g} s, or --strategy auto",
            got=f"{most:g} s",
        )


def standstill_warning(plan: Plan, track: Track) -> str:
    """Say how long the tool stands or creeps on the contour, and where most; nothing where that is no longer."""
    found, period = standstills(plan, track), plan.machine.servo_period
    before = standing_time(without_strategy(plan), track)
    time = sum((one.time for one in found), start=0.0)
    if time <= before + 2.0 * period:
        return ""
    longest = max(found, key=lambda one: one.time)
    return (
        f"the tool stands or creeps on the contour for {time:.3g} s ({before:.3g} s before) at {len(found)} "
        f"place{'s' * (len(found) > 1)}, longest for {longest.time:.3g} s at {longest.s / MM:.6g} mm along the path; "
        "--max-standstill bounds it"
    )
