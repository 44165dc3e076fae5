"""Sentences and phrases that say where a residual lies, with numbers in shop units."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from ph_post.diagnose.residual_features import (
    Drift,
    ExcessWindow,
    Periodic,
    by_direction,
    by_speed,
    reversal_sizes,
)
from ph_post.identify.linear_drive import AxisMotion
from ph_post.types import Array, Axis
from ph_post.types.diagnosis import ResidualPlace
from ph_post.units import MICROMETRE, MM, MS

_LIES: Final = re.compile(r"lies (.+?)(?:, [^,]*% of the samples|$)")
"""A stretch in the sentence of a place."""

RULES: Final = {
    "offset": "everywhere, by the same amount",
    "direction": "wherever {axis} moves, by its direction",
    "acceleration": "everywhere in proportion to the acceleration of {axis}",
    "position": "everywhere in proportion to the position of {axis}",
    "period": "all along {axis}, again and again every {period:.3g} mm",
    "time": "slowly, throughout the log",
}
"""Phrases of the rules that a place may stand for."""

PLACES: Final[Mapping[str, tuple[tuple[str, ...], str]]] = {
    "backlash": (("reversal", "travel", "direction"), "after reversals of {axis}"),
    "position_dependent_backlash": (
        ("reversal", "travel", "position", "direction"),
        "after reversals of {axis}, by where they are",
    ),
    "coulomb_friction": (("reversal", "direction"), "after reversals of {axis}"),
    "stribeck_friction": (("reversal", "direction", "speed"), "after reversals of {axis} and at slow speeds"),
    "viscous_friction": (("speed",), "everywhere in proportion to the speed of {axis}"),
    "friction_asymmetry": (("speed", "direction"), "everywhere in proportion to the speed of {axis}, by its direction"),
    "load_offset": (("offset",), "everywhere, by the same amount"),
    "elastic_windup": (("acceleration", "reversal"), "where {axis} accelerates"),
    "engagement_impact": (("reversal", "travel"), "after reversals of {axis}"),
    "cyclic_error": (("period",), "all along {axis}, again and again"),
    "scale_error": (("position",), "everywhere in proportion to the position of {axis}"),
    "thermal_growth": (("time",), "slowly, throughout the log"),
    "squareness": (
        ("position of X", "position of Y", "position of Z"),
        "everywhere in proportion to the position of the other axis",
    ),
    "servo_mismatch": (("speed", "acceleration"), "wherever {axis} moves"),
    "command_filter": (("acceleration", "speed"), "wherever {axis} begins or ends a motion"),
    "transport_delay": (("speed",), "wherever {axis} moves"),
    "torque_saturation": (("acceleration", "speed", "reversal"), "where {axis} accelerates most"),
    "cogging": (("period", "speed"), "all along {axis}, again and again"),
    "cutting_force": (("direction", "speed"), "along the path, by its direction"),
}
"""Splits that show each effect itself, rather than where the log happened to go; and the place that physics
gives it, where the splits find none."""

WORTH: Final = 0.25
"""Least share of what an effect adds that a place must hold to stand for it."""


def best_phrase(name: str, axis: str, places: Sequence[ResidualPlace], values: Mapping[str, float]) -> str:
    """Say where an effect shows.

    Parameters
    ----------
    name : str
        Of the effect.
    axis : str
    places : sequence of ResidualPlace
        Of what it alone adds, that first which says most.
    values : mapping
        Of the effect's parameters by name [SI].
    """
    # A rule says more than a stretch.
    ordered = sorted(places, key=lambda place: _LIES.search(place.sentence) is not None)
    kinds, usual = PLACES.get(name, ((), "in {axis}"))
    for kind in kinds:
        for place in ordered:
            if place.by == kind and place.share >= WORTH and (words := phrase(place, values)):
                return words
    # When it happened says little about an effect that does not drift.
    if not kinds and places and places[0].by != "time":
        return phrase(places[0], values)
    return usual.format(axis=axis)


def phrase(place: ResidualPlace, values: Mapping[str, float] | None = None) -> str:
    """Shorten a place to a phrase; empty where it has none.

    Parameters
    ----------
    place : ResidualPlace
    values : mapping, optional
        Those of the effect by name [SI]: its period is better known than that of the place.

    Examples
    --------
    >>> phrase(ResidualPlace(axis="X", by="reversal", share=0.8, value=0.04,
    ...              sentence="82 % of the excess lies within 40 ms after X reversals, 12 % of the samples"))
    'within 40 ms after X reversals'
    """
    stretch = _LIES.search(place.sentence)
    if stretch is not None:
        return _about(stretch.group(1), place)
    by, _, other = place.by.partition(" of ")
    if by == "speed":
        each_way = ", differently each way" if "each way" in place.sentence else ""
        return f"everywhere in proportion to the speed of {place.axis}{each_way}"
    period = (values or {}).get("period", place.value)
    usual = RULES.get(by, "")
    return usual.format(axis=other or place.axis, period=period / MM)


def _about(stretch: str, place: ResidualPlace) -> str:
    """Name the middle of a stretch of position, the others as they are."""
    if place.by == "position":
        ends = re.findall(r"-?[\d.e+-]+(?= mm)", stretch)
        return f"at {place.axis} {ends[0]} to {ends[1]} mm" if len(ends) == 2 else stretch
    return stretch


EQUAL: Final = 1.25
"""Sizes within this factor are equal."""

GROWS: Final = 0.3
"""Power of the feed above which a size grows with it."""

BOUND: Final = 0.8
"""Correlation with the position above which a size goes with it."""


def percent(share: float) -> str:
    """Write a share in per cent."""
    return f"{100.0 * share:.0f} %"


def length(value: float) -> str:
    """Write the size of an error [m] in µm."""
    return f"{value / MICROMETRE:.3g} µm"


def place(value: float) -> str:
    """Write a position [m] in mm."""
    return f"{value / MM:.4g} mm"


def velocity(value: float) -> str:
    """Write a speed [m/s] in mm/s."""
    return f"{value / MM:.3g} mm/s"


def instant(value: float) -> str:
    """Write a time [s]."""
    return f"{value:.4g} s"


def after_reversals(by: str, name: str, window: ExcessWindow, residual: Array, motion: AxisMotion, noise: float) -> str:
    """Say how much lies behind reversals, and whether direction, place and feed matter."""
    within = f"{window.high / MS:.3g} ms" if by == "reversal" else f"{window.high / MM:.3g} mm of travel"
    said = [
        f"{percent(window.share)} of the excess lies within {within} after {name} reversals, "
        f"{percent(window.chance)} of the samples"
    ]
    span = window.high if by == "reversal" else _time_within(motion, window.high)
    return "; ".join([*said, *_reversal_details(span, residual, motion, noise)])


def one_speed(value: float) -> str:
    """Say that a residual is in proportion to the velocity."""
    late = "behind" if value < 0.0 else "ahead of"
    return f"is in proportion to the velocity: {abs(value) / MS:.3g} ms {late} the model"


def two_speeds(plus: float, minus: float) -> str:
    """Say that a residual is in proportion to the velocity, differently by direction."""
    up, down = (f"{round(value / MS, 4) + 0.0:g} ms" for value in (plus, minus))
    return f"is in proportion to the velocity, differently each way: {up} times it to plus, {down} to minus"


def acceleration(value: float) -> str:
    """Say that a residual is in proportion to the acceleration."""
    return f"is in proportion to the acceleration: {value / MICROMETRE:.3g} µm per m/s²"


def proportion(name: str, slope: float) -> str:
    """Say that a residual is in proportion to a position."""
    return f"is in proportion to the position of {name}: {slope * MM / MICROMETRE:.3g} µm per mm"


def stretch(window: ExcessWindow, word: str, unit: Callable[[float], str]) -> str:
    """Say how much lies in a stretch, against the samples in it."""
    slow = unit is velocity and window.low < 0.01 * window.high
    low = "up to" if slow else f"{unit(window.low)} to"
    return (
        f"{percent(window.share)} of the excess lies {word} {low} {unit(window.high)}, "
        f"{percent(window.chance)} of the samples"
    )


def periodic(found: Periodic, ways: list[float], drive: Axis | None) -> str:
    """Say that a residual repeats with the position, and whether the screw does too."""
    said = [f"repeats every {place(found.period)} of travel, amplitude {length(found.amplitude)}"]
    said += list(_turns(found.period, drive))
    if all(math.isfinite(way) for way in ways):
        said.append(_both_ways(ways[0], ways[1], "in both directions"))
    return "; ".join(said)


def drifts(found: Drift, lasts: float) -> str:
    """Say that a residual changes slowly."""
    return (
        f"is a drift over time: {length(found.change)} from beginning to end ({lasts:.3g} s), half of it "
        f"after {found.half:.3g} s"
    )


def rotation(share: float, chance: float, sides: tuple[float, float]) -> str:
    """Say that a residual depends on which way round."""
    word = "clockwise" if sides[0] > sides[1] else "counterclockwise"
    return (
        f"{percent(min(share, 1.0))} of the excess lies where the path runs {word}, {percent(chance)} of the "
        f"samples: {length(sides[0])} rms clockwise, {length(sides[1])} counterclockwise"
    )


def _turns(period: float, drive: Axis | None) -> Iterator[str]:
    """Yield how a period goes with the screw and the motor."""
    if drive is None or drive.gap.travel_per_rad is None:
        return
    lead = 2.0 * math.pi * drive.gap.travel_per_rad
    ratio = lead / period
    if ratio > 0.5 and abs(ratio - round(ratio)) < 0.02 * ratio:
        times = "once" if round(ratio) == 1 else f"{round(ratio)} times"
        yield f"{times} a turn of the screw (lead {place(lead)})"


def _time_within(motion: AxisMotion, travel: float) -> float:
    """Time by which most strokes have gone so far [s]."""
    inside = motion.since[motion.travel < travel]
    return float(np.quantile(inside, 0.9)) if inside.size else 0.0


def _reversal_details(span: float, residual: Array, motion: AxisMotion, noise: float) -> Iterator[str]:
    """Yield whether the size behind reversals goes with direction, position and feed."""
    counted = np.ones(residual.size, dtype=np.bool_)
    ways = by_direction(residual, motion, span, counted)
    if ways is not None:
        yield _both_ways(_less(ways[0], noise), _less(ways[1], noise), "in both directions")
    size, _, position, _ = reversal_sizes(residual, motion, span, counted)
    if size.size >= 6 and np.ptp(position) > 0.0 and np.unique(np.round(position, 4)).size >= 4:
        together = float(np.corrcoef(size, position)[0, 1]) if np.ptp(size) > 0.0 else 0.0
        even = float(np.std(size)) < 0.2 * float(np.mean(size))
        if even:
            yield "independent of position"
        elif abs(together) > BOUND:
            yield f"{'growing' if together > 0.0 else 'falling'} with the position"
    scaling = by_speed(residual, motion, span, counted)
    if scaling.exponent is not None and scaling.feeds[-1] > 1.5 * scaling.feeds[0]:
        same = abs(scaling.exponent) < GROWS
        yield "the same at all feeds" if same else f"as the feed to the power {scaling.exponent:.2g}"


def _less(size: float, noise: float) -> float:
    """Size without the noise in it."""
    return math.sqrt(max(size**2 - noise**2, 0.0))


def _both_ways(plus: float, minus: float, words: str) -> str:
    """Say whether two sizes are equal."""
    low, high = sorted((plus, minus))
    if high <= EQUAL * low:
        return f"equal {words}"
    more, less = ("plus", "minus") if plus > minus else ("minus", "plus")
    return f"{length(high)} towards {more}, {length(low)} towards {less}"
