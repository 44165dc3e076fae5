"""Viscous friction: a force against the motion that grows with its speed."""

from __future__ import annotations

from msgspec.structs import replace

from ph_post.drive.effects.base import FRICTION, N_S_PER_MM, NOT_NEGATIVE, SECOND, Effect, Parameter, Values
from ph_post.drive.plant import Plant


def _apply(plant: Plant, values: Values) -> Plant:
    lag = values["coefficient"]
    return replace(plant, viscous_plus=plant.viscous_plus + lag, viscous_minus=plant.viscous_minus + lag)


EFFECT = Effect(
    name="viscous_friction",
    kind="force",
    summary="a force against the motion by its speed, beyond what is in c; several add up",
    source=FRICTION,
    parameters=(
        Parameter(
            name="coefficient_n_s_per_mm",
            gives="coefficient",
            unit=N_S_PER_MM,
            bounds=NOT_NEGATIVE,
            meaning="force over speed",
        ),
        Parameter(
            name="following_error_s",
            gives="coefficient",
            unit=SECOND,
            bounds=NOT_NEGATIVE,
            meaning="following error over speed, which adds to c",
        ),
    ),
    apply=_apply,
)
