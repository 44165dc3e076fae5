"""Friction asymmetry: more viscous friction one way than the other."""

from __future__ import annotations

from msgspec.structs import replace

from ph_post.drive.effects.base import (
    FRICTION,
    MM_PER_S,
    N_S_PER_MM,
    NOT_NEGATIVE,
    SECOND,
    Effect,
    EffectFault,
    Parameter,
    Values,
)
from ph_post.drive.plant import Plant
from ph_post.types import Axis


def _apply(plant: Plant, values: Values) -> Plant:
    # What differs at the speed at which it is even is the same force both ways: a load of as much less.
    return replace(
        plant,
        load=plant.load - 0.5 * (values["plus"] - values["minus"]) * values["even_at"],
        viscous_plus=plant.viscous_plus + values["plus"],
        viscous_minus=plant.viscous_minus + values["minus"],
    )


def _fault(axis: Axis, values: Values) -> EffectFault | None:
    """Refuse what would drive the axis, or its table alone, instead of braking it."""
    b, c = axis.servo.b, axis.servo.c
    fraction, beta = axis.gap.inertia_fraction, axis.gap.beta
    own = 0.0
    if axis.loop.encloses_backlash and fraction is not None and beta is not None:
        own = fraction * beta * b
    for gives in ("plus", "minus"):
        coefficient = values[gives]
        if coefficient >= 0.0:
            continue
        if c + coefficient <= 0.0:
            return EffectFault(gives=gives, what="the axis would have no damping", expected=f"> -c = {-c:g} s")
        if c + coefficient < own:
            least = f">= b * inertia_fraction / motor_time_constant_s - c = {own - c:g} s"
            return EffectFault(gives=gives, what="the load would have negative damping", expected=least)
    return None


EFFECT = Effect(
    name="friction_asymmetry",
    kind="force",
    summary="friction by speed, beyond what is in c, that differs with the direction; may be negative",
    source=FRICTION,
    parameters=(
        Parameter(name="plus_n_s_per_mm", gives="plus", unit=N_S_PER_MM, meaning="force over speed, moving to plus"),
        Parameter(
            name="plus_following_error_s",
            gives="plus",
            unit=SECOND,
            meaning="following error over speed, which adds to c",
        ),
        Parameter(
            name="minus_n_s_per_mm",
            gives="minus",
            unit=N_S_PER_MM,
            meaning="force over speed, moving to minus",
        ),
        Parameter(
            name="minus_following_error_s",
            gives="minus",
            unit=SECOND,
            meaning="following error over speed, which adds to c",
        ),
        Parameter(
            name="even_at_mm_s",
            gives="even_at",
            unit=MM_PER_S,
            bounds=NOT_NEGATIVE,
            default=0.0,
            meaning="speed at which both directions are braked alike: a load_offset is the load there",
        ),
    ),
    apply=_apply,
    fault=_fault,
    once=True,
)
