"""Scale error: a screw or scale that is too long or too short."""

from __future__ import annotations

from msgspec import Meta
from msgspec.structs import replace

from ph_post.drive.effects.base import ONE, POSITIONING, Effect, Parameter, Values
from ph_post.drive.plant import Plant


def _apply(plant: Plant, values: Values) -> Plant:
    return replace(plant, reading=replace(plant.reading, scale=plant.reading.scale + values["error"]))


EFFECT = Effect(
    name="scale_error",
    kind="reading",
    summary="the table's reading is 1 + ε times its position; several add up",
    source=POSITIONING,
    parameters=(
        Parameter(name="error", gives="error", unit=ONE, bounds=Meta(gt=-1, lt=1), meaning="ε, 1e-5 is 10 µm/m"),
    ),
    apply=_apply,
)
