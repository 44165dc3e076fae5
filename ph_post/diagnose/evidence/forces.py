"""Evidence of forces on an axis, and of errors that repeat along its travel."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy import optimize

from ph_post.diagnose.evidence.base import (
    FEWEST,
    Evidence,
    SpeedLevel,
    between_ways,
    compared,
    correlation,
    effort_parts,
    level_words,
    settled_levels,
    similar_sizes,
    slopes,
)
from ph_post.diagnose.residual_features import SAME_FEED, best_period
from ph_post.diagnose.sentences import length, percent, velocity
from ph_post.types import Array, BoolArray
from ph_post.units import MM, MS

NEAR: Final = (0.97, 1.03)
"""Parts of a period within which it is refined."""

APART: Final = 0.03
"""Part by which the period that stands out may differ from the fitted one."""


def wave_words(evidence: Evidence, physics: str, same: bool = False) -> Iterator[str]:
    """Yield the period that stands out, what turn it belongs to, and its size slow and fast.

    Parameters
    ----------
    evidence : Evidence
    physics : str
        What is predicted.
    same : bool
        Whether its size is predicted to be the same at all speeds.
    """
    residual, use, x = evidence.residual, evidence.use(), evidence.motion.position
    found = best_period(residual, x, use)
    if found is None:
        return
    period, fitted = _refined(residual, x, found.period, use), evidence.values["period"]
    named, share = "", found.share
    if abs(period - fitted) > APART * fitted:
        # What stands out may be another effect, or this one blurred by its own lag.
        angle = 2.0 * math.pi * x / fitted
        period, named = fitted, " by the fit"
        share = correlation(residual, use, np.sin(angle), np.cos(angle))
    size = length(amplitude(residual, x, period, use))
    numbers = f"{size} every {period / MM:.3g} mm{named} ({turns(evidence)}), {percent(share)} of the residual"
    sizes = _sizes(evidence, residual, use, period)
    agrees = True
    if sizes is not None:
        (slow, small), (fast, large) = sizes
        numbers += f"; {length(small)} at {velocity(slow)}, {length(large)} at {velocity(fast)}"
        agrees = not same or similar_sizes(small, large)
    yield compared(physics, numbers, agrees)


def turns(evidence: Evidence) -> str:
    """Lay a period beside the travel of a turn of screw and motor, where the file gives them."""
    gap = evidence.problem.axis.gap
    if gap.travel_per_rad is None:
        return "the file states no screw lead"
    lead = 2.0 * math.pi * gap.travel_per_rad
    words = f"the screw's lead is {lead / MM:.4g} mm"
    if gap.gear_ratio is not None and gap.gear_ratio != 1.0:
        words += f" and a turn of the motor {lead / gap.gear_ratio / MM:.4g} mm"
    return words


def _refined(residual: Array, position: Array, period: float, use: BoolArray) -> float:
    """Find the period near one that explains most beside a constant and a line, fitted together [m]."""

    def missed(share: float) -> float:
        angle = 2.0 * math.pi * position / (period * share)
        return -correlation(residual, use, np.sin(angle), np.cos(angle), position)

    found = optimize.minimize_scalar(missed, bounds=NEAR, method="bounded", options={"xatol": 1e-4})
    return period * float(found.x)


def amplitude(residual: Array, position: Array, period: float, use: BoolArray) -> float:
    """Amplitude of a sine of this period, beside a constant and a line."""
    angle = 2.0 * math.pi * position / period
    sine, cosine, *_ = slopes(residual, use, np.sin(angle), np.cos(angle), position)
    return math.hypot(sine, cosine)


def _sizes(
    evidence: Evidence, residual: Array, use: BoolArray, period: float
) -> tuple[tuple[float, float], tuple[float, float]] | None:
    """Mean speed and amplitude of the slower and of the faster half; None where the speed is one."""
    speed = np.abs(evidence.motion.velocity)
    moving = use & (speed > 1e-3 * float(np.max(speed)))
    if np.count_nonzero(moving) < 2 * FEWEST:
        return None
    middle = float(np.median(speed[moving]))
    found = []
    for inside in (moving & (speed <= middle), moving & (speed > middle)):
        x = evidence.motion.position[inside]
        if x.size < FEWEST or np.ptp(x) < period:
            return None
        size = amplitude(residual, evidence.motion.position, period, inside)
        found.append((float(np.mean(speed[inside])), size))
    return (found[0], found[1]) if found[1][0] > SAME_FEED * found[0][0] else None


def coulomb(evidence: Evidence) -> Iterator[str]:
    """Yield what friction shows that does not know the speed: lags alike, a force that steps."""
    levels = _levels(evidence)
    if levels:
        agrees = similar_sizes(levels[0].half, levels[-1].half)
        yield compared("Coulomb friction does not grow with speed", _where(evidence, levels), agrees)
    yield from _step_of_effort(evidence)
    yield from _both_sides(evidence)


def stribeck(evidence: Evidence) -> Iterator[str]:
    """Yield whether friction is larger at slow speeds."""
    levels = _levels(evidence, 5)
    if len(levels) > 2:
        shown = (levels[0], levels[len(levels) // 2], levels[-1])
        agrees = abs(shown[0].half) > abs(shown[-1].half)
        yield compared("Stribeck friction is larger at slow speeds", _where(evidence, shown), agrees)
    elif levels:
        yield (f"Stribeck friction is larger at slow speeds; the log has one speed only, {_where(evidence, levels)}")
    yield from _step_of_effort(evidence)


def viscous(evidence: Evidence) -> Iterator[str]:
    """Yield whether friction is in proportion to speed."""
    levels = _levels(evidence)
    if len(levels) > 1 and levels[0].half != 0.0:
        times, faster = levels[-1].half / levels[0].half, levels[-1].speed / levels[0].speed
        numbers = f"{_where(evidence, levels)}: {times:.2g} times as much at {faster:.2g} times the speed"
        yield compared("viscous friction grows in proportion to speed", numbers, similar_sizes(times, faster))
    motion, use = evidence.motion, evidence.use()
    way = motion.direction.astype(np.float64)
    per_speed, step, *_ = slopes(evidence.residual, use, motion.velocity, way, motion.acceleration)
    yield compared(
        "it is nothing at standstill",
        f"{evidence.reading} is late by {-per_speed / MS:.3g} ms times the speed, and {length(abs(step))} go "
        "with the direction alone",
    )


def asymmetry(evidence: Evidence) -> Iterator[str]:
    """Yield the lag in proportion to speed each way."""
    motion, residual = evidence.motion, evidence.residual
    found = []
    for way in (1, -1):
        use = evidence.use() & (motion.direction == way)
        if np.count_nonzero(use) < 100:
            return
        found.append(-slopes(residual, use, motion.velocity, motion.acceleration)[0] / MS)
    plus, minus = (f"{'lags' if late >= 0.0 else 'leads'} by {abs(late):.3g} ms" for late in found)
    numbers = f"{evidence.reading} {plus} times the speed to plus and {minus} times it to minus"
    yield compared(
        "friction that differs by direction lags by another factor each way",
        numbers,
        not similar_sizes(found[0], found[1]),
    )
    if "even_at" in evidence.values:
        yield f"both ways are braked alike at {velocity(evidence.values['even_at'])}: the constant load is that there"


def load(evidence: Evidence) -> Iterator[str]:
    """Yield what a constant force shows: the mean of both directions, at standstill too."""
    parts = effort_parts(evidence)
    if parts is None:
        yield "no force was recorded in both directions: a load cannot be distinguished from a shifted origin"
    else:
        numbers = f"the mean {evidence.effort_name} of both directions is {evidence.effort(parts[1])}"
        still = _standing(evidence)
        if still is not None:
            numbers += f", at standstill {evidence.effort(still)}"
        yield compared("a constant load is held by the motor all the time", numbers)
    shift = float(np.mean(evidence.residual[evidence.use()]))
    if abs(shift) > evidence.noise(evidence.channel):
        yield compared("it pushes the axis off its place", f"{evidence.reading} is off by {length(shift)}")


def cogging(evidence: Evidence) -> Iterator[str]:
    """Yield what shows a force over and over along the travel."""
    yield from wave_words(evidence, "cogging repeats with the motor's magnets and changes with the feed")
    if evidence.has("force"):
        motion, use = evidence.motion, evidence.use("force") & (evidence.motion.direction != 0)
        angle = 2.0 * np.pi * motion.position / evidence.values["period"]
        columns = (motion.direction.astype(np.float64), motion.velocity, motion.acceleration)
        sine, cosine, *_ = slopes(evidence.values_of("force"), use, np.sin(angle), np.cos(angle), *columns)
        size = evidence.effort(float(np.hypot(sine, cosine)))
        yield compared("the motor works against it", f"the {evidence.effort_name} has {size} of that period")


def cutting(evidence: Evidence) -> Iterator[str]:
    """Yield whether the residual goes with the direction of the path, not with that of the axis alone."""
    problem, residual, use = evidence.problem, evidence.residual, evidence.use()
    path = np.sqrt(np.sum(problem.velocity**2, axis=1))
    along = np.divide(problem.speed, path, out=np.zeros(path.size), where=path > 1e-6)
    by_path, by_sign = (correlation(residual, use, one) for one in (along, np.sign(along)))
    size = slopes(residual, use, along)[0]
    numbers = (
        f"{evidence.reading} is {length(abs(size))} {'behind' if size < 0.0 else 'ahead'} along the path; the "
        f"path's direction explains {percent(by_path)} of the residual, the sign of {evidence.axis} alone "
        f"{percent(by_sign)}"
    )
    yield compared("a cutting force acts along the path, on each axis by its part of it", numbers, by_path > by_sign)
    if evidence.too:
        yield f"it acts on all axes that cut; here on {', '.join(evidence.too)} too"
    else:
        yield "it acts on all axes that cut; here it was found on this axis alone"


def _levels(evidence: Evidence, groups: int = 2) -> tuple[SpeedLevel, ...]:
    return settled_levels(evidence, evidence.residual, evidence.use(), groups)


def _where(evidence: Evidence, levels: tuple[SpeedLevel, ...]) -> str:
    return f"{evidence.reading} is {level_words(levels)}"


def _step_of_effort(evidence: Evidence) -> Iterator[str]:
    parts = effort_parts(evidence)
    if parts is not None:
        step = evidence.effort(2.0 * parts[0])
        yield compared(
            "the motor must overcome friction",
            f"the {evidence.effort_name} channel steps by {step} where {evidence.axis} reverses",
        )


def _both_sides(evidence: Evidence) -> Iterator[str]:
    """Yield whether motor and table are both held back."""
    if evidence.both_sides:
        motor = between_ways(evidence, evidence.before["motor"], evidence.use("motor"))
        table = between_ways(evidence, evidence.before["act"], evidence.use("act"))
        if motor is not None and table is not None:
            yield compared(
                "friction holds the motor's side back like the table's, backlash the table's only",
                f"the directions differ by {length(abs(motor))} on the motor's side, "
                f"{length(abs(table))} on the table's",
                similar_sizes(motor, table),
            )
    elif evidence.problem.side == "unknown":
        yield "the log does not say on which side the position was read: backlash would look much the same"
    elif not evidence.has("force"):
        yield "neither a second position nor a force was recorded that could confirm it"


def _standing(evidence: Evidence) -> float | None:
    """Mean effort at standstill."""
    still = evidence.use("force") & (np.abs(evidence.problem.speed) < 1e-6)
    still &= np.abs(evidence.motion.velocity) < 1e-3 * np.max(np.abs(evidence.motion.velocity))
    if np.count_nonzero(still) < 100:
        return None
    return float(np.mean(evidence.values_of("force")[still]))
