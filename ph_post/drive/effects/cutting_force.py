"""Cutting force: the tool's resistance along the path, by the feed."""

from __future__ import annotations

from msgspec.structs import replace

from ph_post.drive.effects.base import (
    CUTTING,
    FEED,
    MILLIMETRE,
    NEWTON,
    NOT_NEGATIVE,
    ONE,
    POSITIVE,
    Effect,
    Parameter,
    Values,
)
from ph_post.drive.plant import Plant


def _apply(plant: Plant, values: Values) -> Plant:
    if values["force"] == 0.0:
        return plant
    cut = (values["force"], values["feed"], values["exponent"])
    return replace(plant, cutting=(*plant.cutting, cut))


EFFECT = Effect(
    name="cutting_force",
    kind="across axes",
    summary="resists the motion along the path by F (v/v_0)^k, rapids included; several add up",
    source=CUTTING,
    parameters=(
        Parameter(
            name="force_n",
            gives="force",
            unit=NEWTON,
            meaning="F, at that feed; negative pulls, as climb milling can",
        ),
        Parameter(name="following_error_mm", gives="force", unit=MILLIMETRE, meaning="F/K, signed likewise"),
        Parameter(
            name="feed_mm_min",
            gives="feed",
            unit=FEED,
            bounds=POSITIVE,
            default=1000.0,
            meaning="v_0, the feed along the path at which it is F",
        ),
        Parameter(
            name="exponent",
            gives="exponent",
            unit=ONE,
            bounds=NOT_NEGATIVE,
            default=0.0,
            meaning="k; 0 is one force at any feed",
        ),
    ),
    apply=_apply,
)
