"""Ramps smooth enough to be led: in place of an S-curve a polynomial over the same time and way.

Inverse dynamics adds c and b times the next two derivatives to a command. An S-curve's jerk jumps, so that
its command would break every limit; a polynomial ramp whose derivatives up to the third vanish at its ends
takes the same time over the same way, and asks for more acceleration in its middle. So the motion is planned
with a part of the limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.compensate.offsets import peaks, smoothstep
from ph_post.types import Limits, Machine, Phase, frozen

ORDER: Final = 3
"""Derivatives of the speed that vanish at the ends of a ramp."""

PARTS: Final = (1.0, 0.7, 0.5, 0.35, 0.25, 0.17, 0.12, 0.08, 0.055, 0.04, 0.025, 0.015)
"""Parts of acceleration and jerk that are tried for the planning."""

SHARE: Final = 0.9
"""Part of a limit that a ramp with its lead may take; the rest is for the bend of the path."""

ATTEMPTS: Final = 4
"""Times that ramps are given up before all are."""

FLAT: Final = 1e-9
"""Part of the steepest slope of a ramp below which a slope is none."""


def reduced(machine: Machine, feed: float) -> Machine | None:
    """Return the machine with the part of its limits with which ramps up to `feed` [m/s] can be led.

    None where even the smallest part is too much, or there is nothing to lead.
    """
    if not any(axis.servo.b or axis.servo.c for axis in machine.axes.values()):
        return None
    for part in PARTS:
        if all(_can_lead(machine, name, feed, part) for name in machine.axes):
            axes = machine.axes.items()
            slower = {name: replace(axis, limits=_scaled(axis.limits, part)) for name, axis in axes}
            return replace(machine, axes=slower)
    return None


def _scaled(limits: Limits, part: float) -> Limits:
    return replace(limits, acceleration=part * limits.acceleration, jerk=part * limits.jerk)


def _can_lead(machine: Machine, name: str, feed: float, part: float) -> bool:
    """Whether a polynomial ramp over the time of the S-curve keeps an axis' limits with its lead."""
    axis = machine.axes[name]
    whole, limits = axis.limits, _scaled(axis.limits, part)
    if feed * limits.jerk <= limits.acceleration**2:
        duration = 2.0 * math.sqrt(feed / limits.jerk)
    else:
        duration = feed / limits.acceleration + limits.acceleration / limits.jerk
    rate = [feed * peak / duration**order for order, peak in enumerate(peaks(ORDER))]
    b, c = axis.servo.b, axis.servo.c
    acceleration = rate[1] + c * rate[2] + b * rate[3]
    jerk = rate[2] + c * rate[3] + b * rate[4]
    return acceleration <= SHARE * whole.acceleration and jerk <= SHARE * whole.jerk


def smooth_ramps(
    phases: Sequence[Phase], breaks: Callable[[tuple[Phase, ...]], tuple[float, ...]]
) -> tuple[Phase, ...]:
    """Replace S-curves outside windows by one polynomial each over the same time and way.

    Ramps that are not symmetric, as where the path's bend bounds the speed, are left as they are; so are
    those that would break a limit.

    Parameters
    ----------
    phases : sequence of Phase
    breaks : callable
        The instants [s] at which phases break a limit.
    """
    ramps = _find_ramps(phases)
    for _ in range(ATTEMPTS):
        smooth = _with_ramps(phases, ramps)
        broken = breaks(smooth)
        if not broken:
            return smooth
        ramps = [ramp for ramp in ramps if not _holds(phases, ramp, broken)]
    return tuple(phases)


def _find_ramps(phases: Sequence[Phase]) -> list[tuple[int, int]]:
    """Rows of the ramps that can be replaced, from the first to behind the last."""
    found: list[tuple[int, int]] = []
    number = 0
    while number < len(phases):
        behind = _ramp_from(phases, number)
        if behind is not None:
            found.append((number, behind))
        number = behind or number + 1
    return found


def _with_ramps(phases: Sequence[Phase], ramps: Sequence[tuple[int, int]]) -> tuple[Phase, ...]:
    found: list[Phase] = []
    done = 0
    for first, behind in ramps:
        found += [*phases[done:first], _joined(phases[first:behind])]
        done = behind
    return (*found, *phases[done:])


def _holds(phases: Sequence[Phase], ramp: tuple[int, int], instants: Sequence[float]) -> bool:
    """Whether one of the instants lies in a ramp, or within its length beside it."""
    start, last = phases[ramp[0]].start, phases[ramp[1] - 1]
    end = last.start + last.duration
    near = end - start
    return any(start - near <= t <= end + near for t in instants)


def _ramp_from(phases: Sequence[Phase], first: int) -> int | None:
    """Row behind the ramp that begins with phase `first`, None where there is none to be replaced."""
    if not _changes(phases[first]):
        return None
    rising = phases[first].speed[-1] > phases[first].speed[0]
    steepest = 0.0
    for last in range(first, len(phases)):
        phase = phases[last]
        if not _changes(phase) or (phase.speed[-1] > phase.speed[0]) != rising:
            return None
        slopes = np.abs(np.diff(phase.speed)) * (phase.speed.size - 1) / phase.duration
        steepest = max(steepest, float(slopes.max()))
        if slopes[-1] <= FLAT * steepest:
            return last + 1 if _is_symmetric(phases[first : last + 1]) else None
    return None


def _changes(phase: Phase) -> bool:
    return phase.window < 0 and bool(phase.speed[0] != phase.speed[-1])


def _is_symmetric(ramp: Sequence[Phase]) -> bool:
    """Whether the mean speed is the mean of the ends, as that of the polynomial is."""
    time = math.fsum(phase.duration for phase in ramp)
    way = math.fsum(phase.duration * float(phase.speed.mean()) for phase in ramp)
    mean = 0.5 * float(ramp[0].speed[0] + ramp[-1].speed[-1])
    return abs(way - mean * time) <= FLAT * mean * time


def _joined(ramp: Sequence[Phase]) -> Phase:
    v0, v1 = float(ramp[0].speed[0]), float(ramp[-1].speed[-1])
    return Phase(
        start=ramp[0].start, duration=math.fsum(phase.duration for phase in ramp), s=ramp[0].s,
        speed=frozen(v0 + (v1 - v0) * smoothstep(ORDER)[0]),
    )  # fmt: skip
