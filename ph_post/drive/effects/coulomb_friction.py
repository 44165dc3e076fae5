"""Coulomb friction: a force of one size against the motion, whatever its speed."""

from __future__ import annotations

from msgspec.structs import replace

from ph_post.drive.effects.base import FRICTION, MILLIMETRE, NEWTON, NOT_NEGATIVE, Effect, Parameter, Values
from ph_post.drive.plant import Plant


def _apply(plant: Plant, values: Values) -> Plant:
    force = values["force"]
    return replace(plant, coulomb_plus=plant.coulomb_plus + force, coulomb_minus=plant.coulomb_minus + force)


EFFECT = Effect(
    name="coulomb_friction",
    kind="force",
    summary="a force of one size against the motion; several add up",
    source=FRICTION,
    parameters=(
        Parameter(name="force_n", gives="force", unit=NEWTON, bounds=NOT_NEGATIVE, meaning="size of the force"),
        Parameter(
            name="following_error_mm",
            gives="force",
            unit=MILLIMETRE,
            bounds=NOT_NEGATIVE,
            meaning="F/K, that force's error",
        ),
    ),
    apply=_apply,
)
