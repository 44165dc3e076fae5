"""Squareness: an axis that is not square to another is read along with it."""

from __future__ import annotations

from msgspec import Meta
from msgspec.structs import replace

from ph_post.drive.effects.base import RADIAN, TEST_CODE, Effect, EffectFault, Parameter, Values
from ph_post.drive.plant import Plant
from ph_post.types import MACHINE_AXES, Axis


def _apply(plant: Plant, values: Values) -> Plant:
    other = (MACHINE_AXES[int(values["other"])], values["angle"])
    return replace(plant, reading=replace(plant.reading, others=(*plant.reading.others, other)))


def _fault(axis: Axis, values: Values) -> EffectFault | None:
    if MACHINE_AXES[int(values["other"])] != axis.name:
        return None
    wanted = " or ".join(f'"{name}"' for name in MACHINE_AXES if name != axis.name)
    return EffectFault(gives="other", what="an axis is square to another one", expected=wanted)


EFFECT = Effect(
    name="squareness",
    kind="across axes",
    summary="the table's reading has α times the position of another axis in it; several add up",
    source=TEST_CODE,
    parameters=(
        Parameter(
            name="angle_rad",
            gives="angle",
            unit=RADIAN,
            bounds=Meta(gt=-1, lt=1),
            meaning="α, what the angle between both lacks of 90°",
        ),
        Parameter(name="other", gives="other", choices=MACHINE_AXES, default="Y", meaning="the other axis"),
    ),
    apply=_apply,
    fault=_fault,
)
