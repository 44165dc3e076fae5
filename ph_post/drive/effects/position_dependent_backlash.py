"""Backlash by position: a screw that is worn where it works most, or whose pitch tapers."""

from __future__ import annotations

import math

from msgspec.structs import replace

from ph_post.drive.effects.base import (
    MILLIMETRE,
    ONE,
    POSITIONING,
    POSITIVE,
    Effect,
    EffectFault,
    Parameter,
    Values,
)
from ph_post.drive.plant import GapProfile, Plant
from ph_post.types import Axis

STEEPEST = 1.0
"""Change of the gap for each metre of travel at which a table could no longer follow its motor's flank."""


def _apply(plant: Plant, values: Values) -> Plant:
    if values["slope"] == 0.0 and values["bump"] == 0.0:
        return plant
    return replace(plant, widening=GapProfile(**values))


def _fault(_axis: Axis, values: Values) -> EffectFault | None:
    bump = abs(values["bump"]) * math.exp(-0.5) / values["width"]
    if abs(values["slope"]) + bump < STEEPEST:
        return None
    gives = "slope" if abs(values["slope"]) >= bump else "bump"
    return EffectFault(
        gives=gives, what="the backlash changes as much as the axis travels", expected="a flatter backlash"
    )


EFFECT = Effect(
    name="position_dependent_backlash",
    kind="state",
    summary="the backlash is that of the axis + slope (x - x_0) + bump exp(-((x - x_c)/w)²/2), never below 0",
    source=POSITIONING,
    parameters=(
        Parameter(name="slope_mm_per_mm", gives="slope", unit=ONE, default=0.0, meaning="wider for each mm to plus"),
        Parameter(
            name="reference_mm",
            gives="reference",
            unit=MILLIMETRE,
            default=0.0,
            meaning="x_0, where the slope adds nothing",
        ),
        Parameter(name="bump_mm", gives="bump", unit=MILLIMETRE, default=0.0, meaning="wider in the worn place"),
        Parameter(name="centre_mm", gives="centre", unit=MILLIMETRE, default=0.0, meaning="x_c, the worn place"),
        Parameter(
            name="width_mm",
            gives="width",
            unit=MILLIMETRE,
            bounds=POSITIVE,
            default=100.0,
            meaning="w, about a third of the worn place's reach to either side",
        ),
    ),
    apply=_apply,
    fault=_fault,
    once=True,
)
