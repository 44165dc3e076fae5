"""Evidence of forces on an axis: how they go with speed, direction, position and the path."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ph_post.diagnose.evidence.exhibit import (
    Exhibit,
    Level,
    against,
    alike,
    between_ways,
    correlation,
    effort_parts,
    level_words,
    settled,
    slopes,
)
from ph_post.diagnose.evidence.waves import wave_words
from ph_post.diagnose.sentences import length, percent
from ph_post.types import Array
from ph_post.units import MS


def coulomb(exhibit: Exhibit) -> Iterator[str]:
    """Yield what friction shows that does not know the speed: lags alike, a force that steps."""
    levels = _levels(exhibit)
    if levels:
        agrees = alike(levels[0].half, levels[-1].half)
        yield against("Coulomb friction does not grow with speed", _where(exhibit, levels), agrees)
    yield from _step_of_effort(exhibit)
    yield from _both_sides(exhibit)


def stribeck(exhibit: Exhibit) -> Iterator[str]:
    """Yield whether friction is larger at slow speeds."""
    levels = _levels(exhibit, 5)
    if len(levels) > 2:
        shown = (levels[0], levels[len(levels) // 2], levels[-1])
        agrees = abs(shown[0].half) > abs(shown[-1].half)
        yield against("Stribeck friction is larger at slow speeds", _where(exhibit, shown), agrees)
    elif levels:
        yield (
            "Stribeck friction is larger at slow speeds; the record has one speed only, "
            f"{_where(exhibit, levels)}"
        )
    yield from _step_of_effort(exhibit)


def viscous(exhibit: Exhibit) -> Iterator[str]:
    """Yield whether friction is in proportion to speed."""
    levels = _levels(exhibit)
    if len(levels) > 1 and levels[0].half != 0.0:
        times, faster = levels[-1].half / levels[0].half, levels[-1].speed / levels[0].speed
        numbers = f"{_where(exhibit, levels)}: {times:.2g} times as much at {faster:.2g} times the speed"
        yield against("viscous friction grows in proportion to speed", numbers, alike(times, faster))
    motion, use = exhibit.motion, exhibit.use()
    way = motion.direction.astype(np.float64)
    per_speed, step, *_ = slopes(_before(exhibit), use, motion.velocity, way, motion.acceleration)
    yield against(
        "it is nothing at standstill",
        f"{exhibit.reading} is late by {-per_speed / MS:.3g} ms times the speed, with {length(abs(step))} of "
        "either direction beside it",
    )


def asymmetry(exhibit: Exhibit) -> Iterator[str]:
    """Yield the lag in proportion to speed each way."""
    motion, residual = exhibit.motion, _before(exhibit)
    found = []
    for way in (1, -1):
        use = exhibit.use() & (motion.direction == way)
        if np.count_nonzero(use) < 100:
            return
        found.append(-slopes(residual, use, motion.velocity, motion.acceleration)[0] / MS)
    numbers = (
        f"{exhibit.reading} is late by {found[0]:.3g} ms times the speed to plus, {found[1]:.3g} ms to minus"
    )
    yield against(
        "friction that differs by direction lags by another factor each way", numbers,
        not alike(found[0], found[1]),
    )  # fmt: skip


def load(exhibit: Exhibit) -> Iterator[str]:
    """Yield what a constant force shows: the mean of both directions, at standstill too."""
    parts = effort_parts(exhibit)
    if parts is None:
        yield "no force was recorded in both directions: a load cannot be told apart from a shifted origin"
    else:
        numbers = f"the mean {exhibit.effort_name} of both directions is {exhibit.effort(parts[1])}"
        still = _standing(exhibit)
        if still is not None:
            numbers += f", at standstill {exhibit.effort(still)}"
        yield against("a constant load is held by the motor all the time", numbers)
    shift = float(np.mean(_before(exhibit)[exhibit.use()]))
    if abs(shift) > exhibit.noise(exhibit.channel):
        yield against("it pushes the axis off its place", f"{exhibit.reading} is off by {length(shift)}")


def cogging(exhibit: Exhibit) -> Iterator[str]:
    """Yield what shows a force over and over along the travel."""
    yield from wave_words(exhibit, "cogging comes again with the motor's magnets and changes with the feed")
    if exhibit.has("force"):
        motion, use = exhibit.motion, exhibit.use("force") & (exhibit.motion.direction != 0)
        angle = 2.0 * np.pi * motion.position / exhibit.values["period"]
        columns = (motion.direction.astype(np.float64), motion.velocity, motion.acceleration)
        sine, cosine, *_ = slopes(exhibit.values_of("force"), use, np.sin(angle), np.cos(angle), *columns)
        size = exhibit.effort(float(np.hypot(sine, cosine)))
        yield against("the motor works against it", f"the {exhibit.effort_name} has {size} of that period")


def cutting(exhibit: Exhibit) -> Iterator[str]:
    """Yield whether the residual goes with the direction of the path, not with that of the axis alone."""
    problem, residual, use = exhibit.problem, _before(exhibit), exhibit.use()
    path = np.sqrt(np.sum(problem.velocity**2, axis=1))
    along = np.divide(problem.speed, path, out=np.zeros(path.size), where=path > 1e-6)
    by_path, by_sign = (correlation(residual, use, one) for one in (along, np.sign(along)))
    size = slopes(residual, use, along)[0]
    numbers = (
        f"{exhibit.reading} is {length(abs(size))} {'behind' if size < 0.0 else 'ahead'} along the path; the "
        f"path's direction explains {percent(by_path)} of the residual, the sign of {exhibit.axis} alone "
        f"{percent(by_sign)}"
    )
    yield against("a cutting force acts along the path, on each axis by its part of it", numbers,
                  by_path > by_sign)  # fmt: skip
    if exhibit.too:
        yield f"it acts on all axes that cut; here on {', '.join(exhibit.too)} too"
    else:
        yield "it acts on all axes that cut; here it was found on this axis alone"


def _before(exhibit: Exhibit) -> Array:
    return exhibit.before[exhibit.channel]


def _levels(exhibit: Exhibit, groups: int = 2) -> tuple[Level, ...]:
    return settled(exhibit, _before(exhibit), exhibit.use(), groups)


def _where(exhibit: Exhibit, levels: tuple[Level, ...]) -> str:
    return f"{exhibit.reading} is {level_words(levels)}"


def _step_of_effort(exhibit: Exhibit) -> Iterator[str]:
    parts = effort_parts(exhibit)
    if parts is not None:
        step = exhibit.effort(2.0 * parts[0])
        yield against(
            "the motor must overcome friction", f"the {exhibit.effort_name} channel steps by {step} where "
            f"{exhibit.axis} reverses",
        )  # fmt: skip


def _both_sides(exhibit: Exhibit) -> Iterator[str]:
    """Yield whether motor and table are both held back."""
    if exhibit.has("motor") and exhibit.has("act"):
        motor = between_ways(exhibit, exhibit.before["motor"], exhibit.use("motor"))
        table = between_ways(exhibit, exhibit.before["act"], exhibit.use("act"))
        if motor is not None and table is not None:
            yield against(
                "friction holds the motor's side back like the table's, a gap the table's only",
                f"the directions differ by {length(abs(motor))} on the motor's side, "
                f"{length(abs(table))} on the table's", alike(motor, table),
            )  # fmt: skip
    elif exhibit.problem.side == "unknown":
        yield "the record does not say on which side the position was read: a gap would look much the same"
    elif not exhibit.has("force"):
        yield "neither a second position nor a force was recorded that could confirm it"


def _standing(exhibit: Exhibit) -> float | None:
    """Mean effort at standstill."""
    still = exhibit.use("force") & (np.abs(exhibit.problem.speed) < 1e-6)
    still &= np.abs(exhibit.motion.velocity) < 1e-3 * np.max(np.abs(exhibit.motion.velocity))
    if np.count_nonzero(still) < 100:
        return None
    return float(np.mean(exhibit.values_of("force")[still]))
