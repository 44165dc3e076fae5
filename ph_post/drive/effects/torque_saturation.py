"""Torque saturation: the motor gives no more than it can, however large the controller's output."""

from __future__ import annotations

from msgspec.structs import replace

from ph_post.drive.effects.base import (
    FEED_DRIVES,
    MILLIMETRE,
    POSITIVE,
    STIFFNESS,
    Effect,
    Parameter,
    Unit,
    Values,
)
from ph_post.drive.plant import Plant
from ph_post.types import CONTROLLED_LOOPS, Axis


def _per_torque(axis: Axis) -> float | None:
    """1 / (k_p k_a k_t), the output that calls for one N m at the motor, from K = k_p k_a k_t N / r."""
    gap, stiffness = axis.gap, axis.servo.stiffness
    if stiffness is None or gap.gear_ratio is None or gap.travel_per_rad is None:
        return None
    return gap.gear_ratio / (gap.travel_per_rad * stiffness)


def _per_acceleration(axis: Axis) -> float | None:
    """η b r / N = 1 / C, the output that the free motor answers with one rad/s² (Eq. 16)."""
    gap, b = axis.gap, axis.servo.b
    if b == 0.0 or gap.inertia_fraction is None or gap.gear_ratio is None or gap.travel_per_rad is None:
        return None
    return gap.inertia_fraction * b * gap.travel_per_rad / gap.gear_ratio


def _apply(plant: Plant, values: Values) -> Plant:
    return replace(plant, saturation=min(plant.saturation, values["limit"]))


_NEWTON_METRE = Unit(symbol="N m", scale=_per_torque, needs=f"gear_ratio, the travel and the stiffness ({STIFFNESS})")
_RAD_PER_S2 = Unit(symbol="rad/s²", scale=_per_acceleration, needs="b > 0, gear_ratio, the travel and inertia_fraction")

EFFECT = Effect(
    name="torque_saturation",
    kind="state",
    summary="the motor's torque is limited; of several limits the smallest holds",
    source=FEED_DRIVES,
    parameters=(
        Parameter(
            name="torque_n_m",
            gives="limit",
            unit=_NEWTON_METRE,
            bounds=POSITIVE,
            meaning="largest torque at the motor",
        ),
        Parameter(
            name="following_error_mm",
            gives="limit",
            unit=MILLIMETRE,
            bounds=POSITIVE,
            meaning="position error at which a P loop reaches it",
        ),
        Parameter(
            name="motor_acceleration_rad_s2",
            gives="limit",
            unit=_RAD_PER_S2,
            bounds=POSITIVE,
            meaning="of the motor alone at that torque",
        ),
    ),
    apply=_apply,
    feedbacks=CONTROLLED_LOOPS,
)
