"""Keys of a machine file (TOML): their names, ranges and defaults.

The keys are in the shop's units; :mod:`ph_post.drive.machinefile` makes a machine of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Final, Literal

import msgspec

from ph_post.types import FURTHER_AXES, LOOPS, ByAxis, Feedback, GravitySide, Loop, ReferenceDirection, Tool
from ph_post.units import MM, MS

Positive = Annotated[float, msgspec.Meta(gt=0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0)]
Fraction01 = Annotated[float, msgspec.Meta(gt=0, lt=1)]
Relative = Annotated[float, msgspec.Meta(ge=0, lt=1)]

MOST_LOST: Final = 100
"""Largest lost motion of a linear axis [mm]."""


class MachineTableRecord(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of the tables of a machine file: a key that is not known is refused."""


class ControllerRecord(MachineTableRecord, frozen=True, kw_only=True):
    """``[controller]``: what it reads, how often it commands, and its planner's settings, each of some dialects."""

    dialect: str
    servo_period_ms: Annotated[float, msgspec.Meta(ge=0.001, le=1000)]
    junction_deviation_mm: NotNegative | None = None
    arc_tolerance_mm: Annotated[float, msgspec.Meta(ge=1e-6)] | None = None
    square_corner_velocity_mm_s: NotNegative | None = None
    arc_resolution_mm: Annotated[float, msgspec.Meta(ge=1e-3)] | None = None
    max_accel_to_decel: Positive | None = None  # mm/s², by Klipper's own name
    jerk_mm_s: Positive | None = None
    arc_segment_mm: Annotated[float, msgspec.Meta(ge=1e-3)] | None = None
    path_tolerance_mm: NotNegative | None = None
    dwell_step_ms: Annotated[float, msgspec.Meta(ge=0, le=10_000)] | None = None
    tool: Tool | None = None
    own_backlash_correction: Annotated[float, msgspec.Meta(ge=0, le=1)] | None = None


PLANNER_KEYS: Final[Mapping[str, tuple[str, float]]] = {
    "junction_deviation": ("junction_deviation_mm", MM),
    "arc_tolerance": ("arc_tolerance_mm", MM),
    "square_corner_velocity": ("square_corner_velocity_mm_s", MM),
    "arc_resolution": ("arc_resolution_mm", MM),
    "max_accel_to_decel": ("max_accel_to_decel", MM),
    "jerk": ("jerk_mm_s", MM),
    "arc_segment": ("arc_segment_mm", MM),
    "path_tolerance": ("path_tolerance_mm", MM),
    "dwell_step": ("dwell_step_ms", MS),
}
"""Key of ``[controller]`` and its unit in SI, by the field of :class:`ph_post.types.planner.PlannerSettings`."""


Bandwidth = Annotated[float, msgspec.Meta(gt=0, le=1e5)]
Weight = Annotated[float, msgspec.Meta(ge=0, le=200)]
Late = Annotated[float, msgspec.Meta(ge=0, le=1000)]


class ControlRecord(MachineTableRecord, frozen=True, kw_only=True):
    """``[axes.X.control]``: the gains of a PI or PID loop, relative to the proportional gain, or those of a cascade."""

    structure: Literal["single", "cascade"] = "single"
    ki_over_kp_per_s: NotNegative = 0.0
    kd_over_kp_s: NotNegative = 0.0
    # a cascade: its loops
    position_gain_per_s: Bandwidth | None = None
    position_gain_m_per_min_mm: Bandwidth | None = None
    velocity_gain_per_s: Bandwidth | None = None
    velocity_integral_time_ms: Annotated[float, msgspec.Meta(gt=0, le=1e5)] | None = None
    velocity_feedback: Literal["motor", "load"] | None = None
    current_bandwidth_hz: Annotated[float, msgspec.Meta(ge=1, le=1e5)] | None = None
    deadband_mm: NotNegative = 0.0
    # what goes before them
    velocity_feedforward_percent: Weight = 0.0
    acceleration_feedforward_percent: Weight = 0.0
    acceleration_lead_ms: Annotated[float, msgspec.Meta(ge=-1000, le=1000)] = 0.0
    dead_time_ms: Late = 0.0
    moving_average_ms: Late = 0.0
    exponential_filter_ms: Late = 0.0
    zv_frequency_hz: Annotated[float, msgspec.Meta(ge=0.5, le=1e4)] | None = None
    zv_damping: Annotated[float, msgspec.Meta(ge=0, lt=1)] = 0.0


SINGLE_KEYS: Final = ("ki_over_kp_per_s", "kd_over_kp_s")
"""Keys of ``[axes.X.control]`` that a cascade has not."""

CASCADE_KEYS: Final = tuple(name for name in ControlRecord.__struct_fields__ if name not in ("structure", *SINGLE_KEYS))
"""Keys of ``[axes.X.control]`` that only a cascade has."""


class AxisRecord(MachineTableRecord, frozen=True, kw_only=True):
    """``[axes.X]``.

    Physical constants may be given under a name that carries the unit or, in SI units, under the paper's
    symbol: J, B, k_p, k_a, k_t, N, r. The rest has one name.
    """

    feedback: Feedback
    # Eq. (9), or the physical constants it is made of
    b: Annotated[float, msgspec.Meta(ge=0, le=100)] | None = None
    c: Annotated[float, msgspec.Meta(ge=0, le=100)] | None = None
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
    lost_motion_mm: Annotated[float, msgspec.Meta(ge=0, le=MOST_LOST)] | None = None
    inertia_fraction: Fraction01 | None = None
    motor_time_constant_s: Positive | None = None
    pickup: Literal["standstill", "momentum", "contact"] | None = None
    initial_flank: Literal["+", "-", "unknown"] = "unknown"
    reference_direction: ReferenceDirection | None = None
    gravity_side: GravitySide | None = None
    backlash_uncertainty: Relative = 0.2
    beta_uncertainty: Relative = 0.2
    gain_uncertainty: Relative = 0.2
    friction_uncertainty: Relative = 0.2
    # limits
    max_velocity_mm_s: Annotated[float, msgspec.Meta(ge=1e-3, le=1e6)]
    max_acceleration_mm_s2: Annotated[float, msgspec.Meta(ge=1e-2, le=1e9)]
    max_jerk_mm_s3: Annotated[float, msgspec.Meta(ge=1e-2, le=1e12)]
    max_motor_acceleration_rad_s2: Positive | None = None
    control: ControlRecord | None = None
    effects: list[dict[str, Any]] = []

    @property
    def loop(self) -> Loop:
        """The loop by the name that `feedback` gives it."""
        return LOOPS[self.feedback]


class FurtherRecord(MachineTableRecord, frozen=True, kw_only=True):
    """What a rotary axis and a further linear one have in common."""

    feedback: Feedback
    b: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.0
    c: Annotated[float, msgspec.Meta(ge=0, le=100)] = 0.0
    reference_direction: ReferenceDirection = "both"
    backlash_uncertainty: Relative = 0.2


class RotaryRecord(FurtherRecord, frozen=True, kw_only=True):
    """``[axes.A]``, ``B`` and ``C``."""

    lost_motion_deg: Annotated[float, msgspec.Meta(ge=0, le=45)]
    max_velocity_deg_s: Annotated[float, msgspec.Meta(ge=1e-3, le=1e6)]
    max_acceleration_deg_s2: Annotated[float, msgspec.Meta(ge=1e-2, le=1e9)]
    max_jerk_deg_s3: Annotated[float, msgspec.Meta(ge=1e-2, le=1e12)] = 1e12


class SlideRecord(FurtherRecord, frozen=True, kw_only=True):
    """``[axes.U]``, ``V`` and ``W``."""

    lost_motion_mm: Annotated[float, msgspec.Meta(ge=0, le=MOST_LOST)]
    max_velocity_mm_s: Annotated[float, msgspec.Meta(ge=1e-3, le=1e6)]
    max_acceleration_mm_s2: Annotated[float, msgspec.Meta(ge=1e-2, le=1e9)]
    max_jerk_mm_s3: Annotated[float, msgspec.Meta(ge=1e-2, le=1e12)] = 1e12


class AxesRecord(ByAxis[AxisRecord], frozen=True, kw_only=True, forbid_unknown_fields=True):
    """``[axes]``."""

    A: RotaryRecord | None = None
    B: RotaryRecord | None = None
    C: RotaryRecord | None = None
    U: SlideRecord | None = None
    V: SlideRecord | None = None
    W: SlideRecord | None = None

    def further(self) -> dict[str, RotaryRecord | SlideRecord]:
        """Return the axes beside X, Y and Z that are given."""
        found = {axis: getattr(self, axis) for axis in FURTHER_AXES}
        return {axis: record for axis, record in found.items() if record is not None}


class MachineRecord(MachineTableRecord, frozen=True, kw_only=True):
    """The whole file."""

    name: str | None = None
    controller: ControllerRecord
    axes: AxesRecord
