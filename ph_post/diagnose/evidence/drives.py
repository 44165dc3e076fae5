"""Evidence of backlash, servo and motor effects."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Final

import numpy as np

from ph_post.diagnose.evidence.base import (
    Evidence,
    between_ways,
    compared,
    half_between,
    lag_or_lead,
    lag_words,
    rms,
    settled_levels,
    similar_sizes,
    slopes,
)
from ph_post.diagnose.residual_features import by_speed, reversal_sizes
from ph_post.diagnose.sentences import length, velocity
from ph_post.identify.cascade_numbers import CASCADE_NUMBERS
from ph_post.identify.free_run import PRIOR
from ph_post.units import MICROMETRE, MM, MS

AFTER: Final = 0.06
"""Time after a reversal in which a gap is crossed [s]."""

MOST: Final = 3
"""Places at which a gap is given."""


def backlash(evidence: Evidence) -> Iterator[str]:
    """Yield what a gap shows: travel lost between the sides, whatever the speed."""
    yield from _between_sides(evidence)
    if evidence.problem.plant.loop.encloses_backlash:
        yield from _crossing(evidence)
        return
    levels = settled_levels(evidence, evidence.residual, evidence.use())
    if levels:
        words = ", ".join(f"{length(-2.0 * one.half)} at {velocity(one.speed)}" for one in levels)
        yield compared(
            "backlash is the same at every speed",
            f"{evidence.reading} differs between the directions by {words}{_beside(evidence)}",
            similar_sizes(levels[0].half, levels[-1].half),
        )
    if not evidence.has("motor"):
        yield "the motor's side was not recorded: only the shape of the lag says that the table alone lags"


def by_place(evidence: Evidence) -> Iterator[str]:
    """Yield what shows that a gap is another at every place."""
    found = _at_places(evidence)
    if len(found) > 1:
        sizes = [size for _, size in found]
        words = ", ".join(f"{length(size)} at {x / MM:.3g} mm" for x, size in found)
        what = (
            f"the error behind reversals of {evidence.axis} is"
            if evidence.problem.plant.loop.encloses_backlash
            else f"the backlash that {evidence.reading} shows is"
        )
        yield compared(
            "this backlash depends on the position", f"{what} {words}", not similar_sizes(min(sizes), max(sizes))
        )
    else:
        yield "the axis passes too few places in both directions to give the backlash of each"


def servo(evidence: Evidence) -> Iterator[str]:
    """Yield by how much the servo's numbers left the file, and how the residual goes with the motion."""
    plant = evidence.problem.plant
    filed: dict[str, float | None] = {"c": plant.c, "b": plant.b}
    if plant.cascade is not None:
        filed = {name: CASCADE_NUMBERS[name].of(plant.cascade) for name in evidence.values}
    said = []
    for name, was in ((name.replace("_", " "), value) for name, value in filed.items()):
        if not was:
            said.append(f"{name} is none in the file")
            continue
        ratio = evidence.values[name.replace(" ", "_")] / was - 1.0
        if abs(ratio) < 0.1 * PRIOR:
            said.append(f"{name} is that of the file")
            continue
        word = "larger" if ratio > 0.0 else "smaller"
        said.append(f"{name} is {100.0 * abs(ratio):.3g} % {word}, {abs(ratio) / PRIOR:.2g} times that")
    yield compared(f"the file's values are good to {100.0 * PRIOR:g} %", " and ".join(said))
    motion = evidence.motion
    late, bend, _ = slopes(evidence.residual, evidence.use(), motion.velocity, motion.acceleration)
    shows = "a wrong c shows with the velocity, a wrong b with the acceleration"
    if plant.cascade is not None:
        shows = "a wrong feed-forward or K_v shows with the velocity, a wrong velocity loop with the acceleration"
    yield compared(
        shows,
        f"{evidence.reading} {lag_words(late, bend)}",
    )


def command_filter(evidence: Evidence) -> Iterator[str]:
    """Yield what a filter of the command shows: its mean delay at any speed, and corners that it rounds."""
    motion = evidence.motion
    late, bend, _ = slopes(evidence.residual, evidence.use(), motion.velocity, motion.acceleration)
    yield compared(
        "a filter is late by one time at any speed, and rounds where the speed changes",
        f"{evidence.reading} {lag_words(late, bend)}",
    )


def windup(evidence: Evidence) -> Iterator[str]:
    """Yield what a spring between motor and table shows: it gives way by the acceleration."""
    gives = 1.0 / evidence.values["resonance"] ** 2
    physics = f"a spring of this resonance gives way by the acceleration, {gives / MICROMETRE:.3g} µm per m/s²"
    motion = evidence.motion
    if evidence.both_sides:
        apart = evidence.values_of("motor") - evidence.values_of("act")
        use = evidence.use("motor", "act")
        way = motion.direction.astype(np.float64)
        slope = slopes(apart, use, motion.acceleration, motion.velocity, way)[0]
        yield compared(physics, f"motor and table part by {slope / MICROMETRE:.3g} µm per m/s²")
        return
    slope = -slopes(evidence.residual, evidence.use(), motion.acceleration, motion.velocity)[0]
    yield compared(physics, f"{evidence.reading} lags by {slope / MICROMETRE:.3g} µm per m/s²")
    yield f"only {evidence.reading} was recorded: motor and table cannot be compared"


def impact(evidence: Evidence) -> Iterator[str]:
    """Yield what shows that the table jumps ahead once the backlash is crossed."""
    motion, use, residual = evidence.motion, evidence.use(), evidence.residual
    near = use & (motion.since < AFTER)
    inside, outside = rms(residual, near), rms(residual, use & ~near)
    if inside is not None and outside is not None:
        yield compared(
            "a pick-up with momentum shows behind reversals only, once the backlash is crossed",
            f"{length(inside)} rms within {AFTER / MS:g} ms after reversals of {evidence.axis}, "
            f"{length(outside)} elsewhere",
            inside > 1.5 * outside,
        )
    if inside is not None:
        ahead = float(np.mean(residual[near] * motion.direction[near]))
        yield compared(
            "the table runs ahead of one that starts from standstill",
            f"{evidence.reading} is {lag_or_lead(ahead)} there on average",
            ahead > 0.0,
        )


def saturation(evidence: Evidence) -> Iterator[str]:
    """Yield whether the error is only where the motor would have to do more than it can."""
    problem, residual, use = evidence.problem, evidence.residual, evidence.use()
    friction = problem.plant.c  # of a cascade the axis' own
    asked = np.abs(friction * evidence.motion.velocity + problem.plant.b * evidence.motion.acceleration)
    limit = evidence.values["limit"]
    above, below = rms(residual, use & (asked > limit)), rms(residual, use & (asked <= limit))
    numbers = (
        f"the command asks for up to {length(float(np.max(asked[use])))} of following error, the limit found "
        f"is {length(limit)}"
    )
    if above is not None and below is not None:
        numbers += f": {length(above)} rms where it asks for more, {length(below)} elsewhere"
    agrees = above is None or below is None or above > 1.5 * below
    yield compared("a limit shows only where the motor would have to do more", numbers, agrees)
    if evidence.has("force"):
        effort = np.abs(evidence.values_of("force")[evidence.use("force")])
        top = float(np.max(effort))
        near = float(np.mean(effort > 0.97 * top))
        yield (
            f"the {evidence.effort_name} never exceeds {evidence.effort(top)}, and is within 3 % of that in "
            f"{100.0 * near:.2g} % of the samples"
        )


def _beside(evidence: Evidence) -> str:
    """Say what of a gap the file knows."""
    gap = evidence.problem.plant.gap
    return f", beside the {length(gap)} that the file has" if gap > 0.0 else ""


def _between_sides(evidence: Evidence) -> Iterator[str]:
    """Yield what is between the readings of both sides."""
    if not evidence.both_sides:
        return
    apart = evidence.values_of("motor") - evidence.values_of("act")
    gap = between_ways(evidence, apart, evidence.use("motor", "act"))
    if gap is not None:
        yield compared(
            "backlash lies between motor and table",
            f"{evidence.column('motor')} less {evidence.column('act')} differs by {length(gap)} between the directions",
            gap > 0.0,
        )
    if evidence.problem.plant.loop.encloses_backlash:
        return
    sides = [between_ways(evidence, evidence.before[one], evidence.use(one)) for one in ("motor", "act")]
    if sides[0] is not None and sides[1] is not None:
        yield compared(
            "the motor does not feel it",
            f"the motor's side shows a step of {length(abs(sides[0]))} where the table's shows {length(abs(sides[1]))}",
            abs(sides[0]) < 0.5 * abs(sides[1]),
        )


def _crossing(evidence: Evidence) -> Iterator[str]:
    """Yield how a gap shows behind a loop over the table: while it is crossed."""
    motion, use, residual = evidence.motion, evidence.use(), evidence.residual
    near = use & (motion.since < AFTER)
    inside, outside = rms(residual, near), rms(residual, use & ~near)
    if inside is None or outside is None:
        return
    scaling = by_speed(residual, motion, AFTER, use)
    numbers = f"{length(inside)} rms within {AFTER / MS:g} ms after reversals, {length(outside)} elsewhere"
    if len(scaling.feeds) > 1:
        ends = ((scaling.feeds[k], scaling.sizes[k]) for k in (0, -1))
        numbers += "; " + ", ".join(f"{length(size)} at {velocity(feed)}" for feed, size in ends)
    yield compared(
        "a loop over the table takes backlash back: it shows while it is crossed",
        numbers,
        inside > 1.5 * outside,
    )


def _at_places(evidence: Evidence) -> list[tuple[float, float]]:
    """Places along the travel [m], and the size of what goes with the direction there [m]."""
    motion, use, residual = evidence.motion, evidence.use(), evidence.residual
    if evidence.problem.plant.loop.encloses_backlash:
        size, _, at, _ = reversal_sizes(residual, motion, AFTER, use)
        if at.size < 2 * MOST or np.ptp(at) < MM:
            return []
        groups = np.array_split(np.argsort(at, kind="stable"), MOST)
        return [(float(np.mean(at[g])), float(np.sqrt(np.mean(size[g] ** 2)))) for g in groups]
    edges = np.quantile(motion.position[use], np.linspace(0.0, 1.0, MOST + 1))
    found = []
    for low, high in pairwise(edges.tolist()):
        inside = use & (motion.position >= low) & (motion.position <= high)
        ways = [np.count_nonzero(inside & (motion.direction == way)) for way in (1, -1)]
        if min(ways) > 100:
            gap = evidence.problem.plant.gap - 2.0 * half_between(residual, motion, inside)
            found.append((float(np.mean(motion.position[inside])), gap))
    return found
