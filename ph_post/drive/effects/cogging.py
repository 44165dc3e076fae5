"""Cogging: the motor's magnets pull it to and fro as it turns."""

from __future__ import annotations

from msgspec.structs import replace

from ph_post.drive.effects.base import (
    DEGREES,
    FEED_DRIVES,
    MILLIMETRE,
    NEWTON,
    POSITIVE,
    Effect,
    Parameter,
    Unit,
    Values,
)
from ph_post.drive.plant import Plant
from ph_post.types import Axis
from ph_post.units import DEGREE


def _per_motor_angle(axis: Axis) -> float | None:
    """Travel [m] of one degree of the motor, r/N a radian."""
    gap = axis.gap
    if gap.gear_ratio is None or gap.travel_per_rad is None:
        return None
    return DEGREE * gap.travel_per_rad / gap.gear_ratio


def _apply(plant: Plant, values: Values) -> Plant:
    if values["force"] == 0.0:
        return plant
    wave = (values["force"], values["period"], values["phase"])
    return replace(plant, cogging=(*plant.cogging, wave))


_OF_MOTOR = Unit(symbol="degrees of the motor", scale=_per_motor_angle, needs="gear_ratio and the travel")

EFFECT = Effect(
    name="cogging",
    kind="force",
    summary="a force A sin(2π m/p + φ) that resists the motor at m, its own side of the backlash; several add up",
    source=FEED_DRIVES,
    parameters=(
        Parameter(name="force_n", gives="force", unit=NEWTON, meaning="A, where positive towards minus"),
        Parameter(name="following_error_mm", gives="force", unit=MILLIMETRE, meaning="A/K"),
        Parameter(
            name="period_mm",
            gives="period",
            unit=MILLIMETRE,
            bounds=POSITIVE,
            meaning="p, travel of the axis from one crest to the next",
        ),
        Parameter(
            name="period_motor_deg",
            gives="period",
            unit=_OF_MOTOR,
            bounds=POSITIVE,
            meaning="that travel in degrees of the motor",
        ),
        Parameter(name="phase_deg", gives="phase", unit=DEGREES, default=0.0, meaning="φ, at position 0"),
    ),
    apply=_apply,
)
