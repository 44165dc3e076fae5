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
from ph_post.diagnose.sentences import UM, length, velocity
from ph_post.identify.free_run import PRIOR
from ph_post.types import Array
from ph_post.units import MM, MS

AFTER: Final = 0.06
"""Time after a reversal in which a gap is crossed [s]."""

MOST: Final = 3
"""Places at which a gap is given."""


def backlash(exhibit: Evidence) -> Iterator[str]:
    """Yield what a gap shows: travel lost between the sides, whatever the speed."""
    yield from _between_sides(exhibit)
    if exhibit.problem.plant.loop.encloses_backlash:
        yield from _crossing(exhibit)
        return
    levels = settled_levels(exhibit, _before(exhibit), exhibit.use())
    if levels:
        words = ", ".join(f"{length(-2.0 * one.half)} at {velocity(one.speed)}" for one in levels)
        yield compared(
            "backlash is the same at every speed",
            f"{exhibit.reading} differs between the directions by {words}{_beside(exhibit)}",
            similar_sizes(levels[0].half, levels[-1].half),
        )
    if not exhibit.has("motor"):
        yield "the motor's side was not recorded: only the shape of the lag says that the table alone lags"


def by_place(exhibit: Evidence) -> Iterator[str]:
    """Yield what shows that a gap is another at every place."""
    found = _at_places(exhibit)
    if len(found) > 1:
        sizes = [size for _, size in found]
        words = ", ".join(f"{length(size)} at {x / MM:.3g} mm" for x, size in found)
        what = (
            f"the error behind reversals of {exhibit.axis} is"
            if exhibit.problem.plant.loop.encloses_backlash
            else f"the backlash that {exhibit.reading} shows is"
        )
        yield compared(
            "this backlash depends on the position", f"{what} {words}", not similar_sizes(min(sizes), max(sizes))
        )
    else:
        yield "the axis passes too few places in both directions to give the backlash of each"


def servo(exhibit: Evidence) -> Iterator[str]:
    """Yield by how much b and c left the file, and how the residual goes with the motion."""
    plant = exhibit.problem.plant
    said = []
    for name in ("c", "b"):
        ratio = exhibit.values[name] / getattr(plant, name) - 1.0
        if abs(ratio) < 0.1 * PRIOR:
            said.append(f"{name} is that of the file")
            continue
        word = "larger" if ratio > 0.0 else "smaller"
        said.append(f"{name} is {100.0 * abs(ratio):.3g} % {word}, {abs(ratio) / PRIOR:.2g} times that")
    yield compared(f"the file's values are good to {100.0 * PRIOR:g} %", " and ".join(said))
    motion = exhibit.motion
    late, bend, _ = slopes(_before(exhibit), exhibit.use(), motion.velocity, motion.acceleration)
    yield compared(
        "a wrong c shows with the velocity, a wrong b with the acceleration",
        f"{exhibit.reading} {lag_words(late, bend)}",
    )


def windup(exhibit: Evidence) -> Iterator[str]:
    """Yield what a spring between motor and table shows: it gives way by the acceleration."""
    gives = 1.0 / exhibit.values["resonance"] ** 2
    physics = f"a spring of this resonance gives way by the acceleration, {gives / UM:.3g} µm per m/s²"
    motion = exhibit.motion
    if exhibit.has("motor") and exhibit.has("act"):
        apart = exhibit.values_of("motor") - exhibit.values_of("act")
        use = exhibit.use("motor", "act")
        way = motion.direction.astype(np.float64)
        slope = slopes(apart, use, motion.acceleration, motion.velocity, way)[0]
        yield compared(physics, f"motor and table part by {slope / UM:.3g} µm per m/s²")
        return
    slope = -slopes(_before(exhibit), exhibit.use(), motion.acceleration, motion.velocity)[0]
    yield compared(physics, f"{exhibit.reading} lags by {slope / UM:.3g} µm per m/s²")
    yield f"only {exhibit.reading} was recorded: motor and table cannot be compared"


def impact(exhibit: Evidence) -> Iterator[str]:
    """Yield what shows that the table jumps ahead once the backlash is crossed."""
    motion, use, residual = exhibit.motion, exhibit.use(), _before(exhibit)
    near = use & (motion.since < AFTER)
    inside, outside = rms(residual, near), rms(residual, use & ~near)
    if inside is not None and outside is not None:
        yield compared(
            "a pick-up with momentum shows behind reversals only, once the backlash is crossed",
            f"{length(inside)} rms within {AFTER / MS:g} ms after reversals of {exhibit.axis}, "
            f"{length(outside)} elsewhere",
            inside > 1.5 * outside,
        )
    if inside is not None:
        ahead = float(np.mean(residual[near] * motion.direction[near]))
        yield compared(
            "the table runs ahead of one that starts from standstill",
            f"{exhibit.reading} is {lag_or_lead(ahead)} there on average",
            ahead > 0.0,
        )


def saturation(exhibit: Evidence) -> Iterator[str]:
    """Yield whether the error is only where the motor would have to do more than it can."""
    problem, residual, use = exhibit.problem, _before(exhibit), exhibit.use()
    asked = np.abs(problem.plant.c * exhibit.motion.velocity + problem.plant.b * exhibit.motion.acceleration)
    limit = exhibit.values["limit"]
    above, below = rms(residual, use & (asked > limit)), rms(residual, use & (asked <= limit))
    numbers = (
        f"the command asks for up to {length(float(np.max(asked[use])))} of following error, the limit found "
        f"is {length(limit)}"
    )
    if above is not None and below is not None:
        numbers += f": {length(above)} rms where it asks for more, {length(below)} elsewhere"
    agrees = above is None or below is None or above > 1.5 * below
    yield compared("a limit shows only where the motor would have to do more", numbers, agrees)
    if exhibit.has("force"):
        effort = np.abs(exhibit.values_of("force")[exhibit.use("force")])
        top = float(np.max(effort))
        near = float(np.mean(effort > 0.97 * top))
        yield (
            f"the {exhibit.effort_name} never exceeds {exhibit.effort(top)}, and is within 3 % of that in "
            f"{100.0 * near:.2g} % of the samples"
        )


def _beside(exhibit: Evidence) -> str:
    """Say what of a gap the file knows."""
    gap = exhibit.problem.plant.gap
    return f", beside the {length(gap)} that the file has" if gap > 0.0 else ""


def _before(exhibit: Evidence) -> Array:
    return exhibit.before[exhibit.channel]


def _between_sides(exhibit: Evidence) -> Iterator[str]:
    """Yield what is between the readings of both sides."""
    if not (exhibit.has("motor") and exhibit.has("act")):
        return
    apart = exhibit.values_of("motor") - exhibit.values_of("act")
    gap = between_ways(exhibit, apart, exhibit.use("motor", "act"))
    if gap is not None:
        yield compared(
            "backlash lies between motor and table",
            f"{exhibit.column('motor')} less {exhibit.column('act')} differs by {length(gap)} between the directions",
            gap > 0.0,
        )
    if exhibit.problem.plant.loop.encloses_backlash:
        return
    sides = [between_ways(exhibit, exhibit.before[one], exhibit.use(one)) for one in ("motor", "act")]
    if sides[0] is not None and sides[1] is not None:
        yield compared(
            "the motor does not feel it",
            f"the motor's side shows a step of {length(abs(sides[0]))} where the table's shows {length(abs(sides[1]))}",
            abs(sides[0]) < 0.5 * abs(sides[1]),
        )


def _crossing(exhibit: Evidence) -> Iterator[str]:
    """Yield how a gap shows behind a loop over the table: while it is crossed."""
    motion, use, residual = exhibit.motion, exhibit.use(), _before(exhibit)
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


def _at_places(exhibit: Evidence) -> list[tuple[float, float]]:
    """Places along the travel [m], and the size of what goes with the direction there [m]."""
    motion, use, residual = exhibit.motion, exhibit.use(), _before(exhibit)
    if exhibit.problem.plant.loop.encloses_backlash:
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
            gap = exhibit.problem.plant.gap - 2.0 * half_between(residual, motion, inside)
            found.append((float(np.mean(motion.position[inside])), gap))
    return found
