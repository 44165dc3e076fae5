"""Stribeck friction: more force at rest, which dies out as the speed grows."""

from __future__ import annotations

from msgspec.structs import replace

from ph_post.drive.effects.base import (
    FRICTION,
    MILLIMETRE,
    MM_PER_S,
    NEWTON,
    NOT_NEGATIVE,
    Effect,
    EffectFault,
    Parameter,
    Values,
)
from ph_post.drive.plant import Plant
from ph_post.types import Axis


def _apply(plant: Plant, values: Values) -> Plant:
    force = values["force"]
    return replace(
        plant,
        coulomb_plus=plant.coulomb_plus + force,
        coulomb_minus=plant.coulomb_minus + force,
        static=plant.static + values["static_force"] - force,
        stribeck_speed=values["stribeck_velocity"],
    )


def _fault(_axis: Axis, values: Values) -> EffectFault | None:
    if values["static_force"] >= values["force"]:
        return None
    return EffectFault(gives="static_force", what="less friction at rest than in motion", expected=">= the force")


EFFECT = Effect(
    name="stribeck_friction",
    kind="force",
    summary="Coulomb friction that is larger at rest: F + (F_s - F) exp(-(v/v_s)²)",
    source=f"{FRICTION}; the Gaussian form",
    parameters=(
        Parameter(name="force_n", gives="force", unit=NEWTON, bounds=NOT_NEGATIVE, meaning="F, far above v_s"),
        Parameter(name="following_error_mm", gives="force", unit=MILLIMETRE, bounds=NOT_NEGATIVE, meaning="F/K"),
        Parameter(
            name="static_force_n",
            gives="static_force",
            unit=NEWTON,
            bounds=NOT_NEGATIVE,
            meaning="F_s, at rest",
        ),
        Parameter(
            name="static_following_error_mm",
            gives="static_force",
            unit=MILLIMETRE,
            bounds=NOT_NEGATIVE,
            meaning="F_s/K",
        ),
        Parameter(
            name="stribeck_velocity_mm_s",
            gives="stribeck_velocity",
            unit=MM_PER_S,
            bounds=NOT_NEGATIVE,
            meaning="v_s; 0: F as soon as it moves",
        ),
    ),
    apply=_apply,
    fault=_fault,
    once=True,
)
