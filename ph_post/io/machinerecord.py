"""What a machine file holds, key by key and in the shop's units; see :mod:`ph_post.io.machinefile`."""

from __future__ import annotations

from typing import Annotated, Any, Literal

import msgspec

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Fraction01 = Annotated[float, msgspec.Meta(gt=0, lt=1)]
Relative = Annotated[float, msgspec.Meta(ge=0, lt=1)]


class Record(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of the tables of a machine file: a key that is not known is refused."""


class ControllerRecord(Record, frozen=True, kw_only=True):
    """``[controller]``."""

    dialect: str
    servo_period_ms: Annotated[float, msgspec.Meta(ge=0.001, le=1000)]


class ControlRecord(Record, frozen=True, kw_only=True):
    """``[axes.X.control]``: the gains of a PI or PID loop, relative to the proportional gain."""

    ki_over_kp_per_s: NotNegative = 0.0
    kd_over_kp_s: NotNegative = 0.0


class AxisRecord(Record, frozen=True, kw_only=True):
    """``[axes.X]``.

    Physical constants may be given under a name that carries the unit or, in SI units, under the paper's
    symbol: J, B, k_p, k_a, k_t, N, r. The rest has one name.
    """

    feedback: Literal["load", "motor", "none"]
    # Eq. (9), or the physical constants it is made of
    b: NotNegative | None = None
    c: NotNegative | None = None
    inertia_kg_m2: Positive | None = None
    J: Positive | None = None
    damping_kg_m2_s: Positive | None = None
    B: Positive | None = None
    position_gain_v_per_m: Positive | None = None
    k_p: Positive | None = None
    amplifier_gain_a_per_v: Positive | None = None
    k_a: Positive | None = None
    torque_constant_n_m_per_a: Positive | None = None
    k_t: Positive | None = None
    servo_stiffness_n_per_mm: Positive | None = None
    # transmission
    gear_ratio: Positive | None = None
    N: Positive | None = None
    travel_per_rad_mm: Positive | None = None
    screw_lead_mm: Positive | None = None
    r: Positive | None = None
    # the gap, and the motor alone in it
    backlash_motor_rad: NotNegative | None = None
    lost_motion_mm: NotNegative | None = None
    inertia_fraction: Fraction01 | None = None
    motor_time_constant_s: Positive | None = None
    pickup: Literal["standstill", "momentum", "contact"] | None = None
    initial_flank: Literal["+", "-", "unknown"] = "unknown"
    backlash_uncertainty: Relative = 0.2
    beta_uncertainty: Relative = 0.2
    gain_uncertainty: Relative = 0.2
    # limits
    max_velocity_mm_s: Positive
    max_acceleration_mm_s2: Positive
    max_jerk_mm_s3: Positive
    max_motor_acceleration_rad_s2: Positive | None = None
    control: ControlRecord | None = None
    effects: list[dict[str, Any]] = []


class AxesRecord(Record, frozen=True, kw_only=True):
    """``[axes]``: the drives by axis."""

    X: AxisRecord | None = None
    Y: AxisRecord | None = None
    Z: AxisRecord | None = None


class MachineRecord(Record, frozen=True, kw_only=True):
    """The whole file."""

    name: str | None = None
    controller: ControllerRecord
    axes: AxesRecord
