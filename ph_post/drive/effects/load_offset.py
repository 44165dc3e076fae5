"""A constant force on the table: gravity, or a counterweight that is too heavy or too light."""

from __future__ import annotations

from msgspec.structs import replace

from ph_post.drive.effects.base import FEED_DRIVES, MILLIMETRE, NEWTON, Effect, Parameter, Values
from ph_post.drive.plant import Plant


def _apply(plant: Plant, values: Values) -> Plant:
    return replace(plant, load=plant.load + values["force"])


EFFECT = Effect(
    name="load_offset",
    kind="force",
    summary="a constant force, such as a weight; positive pushes towards minus; several add up",
    source=FEED_DRIVES,
    parameters=(
        Parameter(name="force_n", gives="force", unit=NEWTON, meaning="the force, positive against plus motion"),
        Parameter(name="following_error_mm", gives="force", unit=MILLIMETRE, meaning="F/K, signed likewise"),
    ),
    apply=_apply,
)
