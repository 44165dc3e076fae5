"""Engagement impact: the motor picks the table up with its momentum, instead of from standstill.

Motor, at w = ω_m r / N in the units of the table, and table, at v, go on together at v + kept η (w - v): with
all of it kept, the common speed after a plastic impact. Where the file says `standstill`, `momentum` holds
instead.
"""

from __future__ import annotations

from msgspec import Meta
from msgspec.structs import replace

from ph_post.drive.effects.base import ONE, Effect, Parameter, Values
from ph_post.drive.plant import Plant
from ph_post.types import ENCLOSING_LOOPS


def _apply(plant: Plant, values: Values) -> Plant:
    pickup = "momentum" if plant.pickup == "standstill" else plant.pickup
    return replace(plant, pickup=pickup, kept=values["kept"])


EFFECT = Effect(
    name="engagement_impact",
    kind="state",
    summary="pick-up with momentum: the table's speed v becomes v + kept η (ω_m r / N - v)",
    source="M. Nordin, P.-O. Gutman: Controlling mechanical systems with backlash - a survey, "
    "Automatica 38 (2002), doi:10.1016/S0005-1098(02)00047-X; plastic impact of the inertias of Eq. (12)",
    parameters=(
        Parameter(
            name="kept",
            gives="kept",
            unit=ONE,
            bounds=Meta(gt=0, le=1),
            default=1.0,
            meaning="part of the plastic impact's momentum that survives",
        ),
    ),
    apply=_apply,
    once=True,
    feedbacks=ENCLOSING_LOOPS,
)
