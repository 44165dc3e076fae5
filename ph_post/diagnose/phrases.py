"""Plain phrases for where an effect shows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

from ph_post.diagnose.record import Place
from ph_post.units import MM

_LIES: Final = re.compile(r"lies (.+?)(?:, [^,]*% of the samples|$)")
"""A stretch in the sentence of a place."""

RULES: Final = {
    "offset": "everywhere, by the same amount",
    "direction": "wherever {axis} moves, by its direction",
    "acceleration": "everywhere in proportion to the acceleration of {axis}",
    "position": "everywhere in proportion to the position of {axis}",
    "period": "all along {axis}, again and again every {period:.3g} mm",
    "time": "slowly, all along the record",
}
"""Phrases of the rules that a place may stand for."""

USUAL: Final = {
    "backlash": "after reversals of {axis}",
    "position_dependent_backlash": "after reversals of {axis}, by where they are",
    "coulomb_friction": "after reversals of {axis}",
    "stribeck_friction": "after reversals of {axis} and at slow speeds",
    "viscous_friction": "everywhere in proportion to the speed of {axis}",
    "friction_asymmetry": "everywhere in proportion to the speed of {axis}, by its direction",
    "load_offset": "everywhere, by the same amount",
    "elastic_windup": "where {axis} accelerates",
    "engagement_impact": "after reversals of {axis}",
    "cyclic_error": "all along {axis}, again and again",
    "scale_error": "everywhere in proportion to the position of {axis}",
    "thermal_growth": "slowly, all along the record",
    "squareness": "everywhere in proportion to the position of the other axis",
    "servo_mismatch": "wherever {axis} moves",
    "transport_delay": "wherever {axis} moves",
    "torque_saturation": "where {axis} accelerates most",
    "cogging": "all along {axis}, again and again",
    "cutting_force": "along the path, by its direction",
}
"""Where physics puts an effect, for what the splits find no place of."""


KINDS: Final = {
    "backlash": ("reversal", "travel", "direction"),
    "position_dependent_backlash": ("reversal", "travel", "position", "direction"),
    "coulomb_friction": ("reversal", "direction"),
    "stribeck_friction": ("reversal", "direction", "speed"),
    "viscous_friction": ("speed",),
    "friction_asymmetry": ("speed", "direction"),
    "load_offset": ("offset",),
    "elastic_windup": ("acceleration", "reversal"),
    "engagement_impact": ("reversal", "travel"),
    "cyclic_error": ("period",),
    "scale_error": ("position",),
    "thermal_growth": ("time",),
    "squareness": ("position of X", "position of Y", "position of Z"),
    "servo_mismatch": ("speed", "acceleration"),
    "transport_delay": ("speed",),
    "torque_saturation": ("acceleration", "speed", "reversal"),
    "cogging": ("period", "speed"),
    "cutting_force": ("direction", "speed"),
}
"""Splits that speak of what an effect does, rather than of where the record happened to go."""

WORTH: Final = 0.25
"""Least share of what an effect adds that a place must hold to stand for it."""


def best_phrase(name: str, axis: str, places: Sequence[Place], values: Mapping[str, float]) -> str:
    """Say where an effect shows.

    Parameters
    ----------
    name : str
        Of the effect.
    axis : str
    places : sequence of Place
        Of what it alone adds, that first which says most.
    values : mapping
        Of the effect's parameters by name [SI].
    """
    # A rule says more than a stretch.
    ordered = sorted(places, key=lambda place: _LIES.search(place.sentence) is not None)
    for kind in KINDS.get(name, ()):
        for place in ordered:
            if place.by == kind and place.share >= WORTH and (words := phrase(place, values)):
                return words
    # When it happened says little about an effect that does not drift.
    if name not in KINDS and places and places[0].by != "time":
        return phrase(places[0], values)
    return usual_phrase(name, axis)


def phrase(place: Place, values: Mapping[str, float] | None = None) -> str:
    """Shorten a place to a phrase; empty where it has none.

    Parameters
    ----------
    place : Place
    values : mapping, optional
        Those of the effect by name [SI]: its period is better known than that of the place.

    Examples
    --------
    >>> phrase(Place(axis="X", by="reversal", share=0.8, value=0.04,
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


def _about(stretch: str, place: Place) -> str:
    """Name the middle of a stretch of position, the others as they are told."""
    if place.by == "position":
        ends = re.findall(r"-?[\d.e+-]+(?= mm)", stretch)
        return f"at {place.axis} {ends[0]} to {ends[1]} mm" if len(ends) == 2 else stretch
    return stretch


def usual_phrase(name: str, axis: str) -> str:
    """Say where physics puts an effect."""
    return USUAL.get(name, "in {axis}").format(axis=axis)
