"""Elastic windup: screw and coupling are a spring between motor and table."""

from __future__ import annotations

from msgspec import Meta
from msgspec.structs import replace

from ph_post.drive.effects.base import FEED_DRIVES, HZ, ONE, POSITIVE, Effect, Parameter, Values
from ph_post.drive.plant import Plant


def _apply(plant: Plant, values: Values) -> Plant:
    return replace(plant, windup_frequency=values["resonance"], windup_damping=values["damping_ratio"])


EFFECT = Effect(
    name="elastic_windup",
    kind="state",
    summary="the table hangs on the motor by a spring",
    source=FEED_DRIVES,
    parameters=(
        Parameter(
            name="resonance_hz",
            gives="resonance",
            unit=HZ,
            bounds=POSITIVE,
            meaning="natural frequency of the table against the locked motor",
        ),
        Parameter(
            name="damping_ratio",
            gives="damping_ratio",
            unit=ONE,
            bounds=Meta(ge=0, lt=1),
            meaning="of that oscillation, to critical",
        ),
    ),
    apply=_apply,
    once=True,
)
