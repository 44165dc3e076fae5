"""Records of a machine: axes with drive and limits, abilities of a controller, scenarios of what a file leaves open."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any, Final, Generic, Literal, TypeVar, get_args

import msgspec

from ph_post.types.loops import LOOPS, Feedback, Loop
from ph_post.types.planner import PlannerSettings

AxisName = Literal["X", "Y", "Z"]
MACHINE_AXES: Final[tuple[str, ...]] = get_args(AxisName)
"""The linear axes that files of machines, paths, logs and tables may have."""

ROTARY_AXES: Final = ("A", "B", "C")
FURTHER_AXES: Final = (*ROTARY_AXES, "U", "V", "W")
"""Axes that only machine files and part programs have."""

Flank = Literal["+", "-", "unknown"]
Pickup = Literal["standstill", "momentum", "contact"]
ReferenceDirection = Literal["+", "-", "both"]
GravitySide = Literal["+", "-"]
Tool = Literal["cutter", "laser", "plasma", "extruder", "pen"]
USUAL_REFERENCE: Final[Mapping[str, ReferenceDirection]] = MappingProxyType({"X": "both", "Y": "both", "Z": "-"})
"""From which side the zero of an axis is taken where its file does not say it: tools are touched off downwards."""


class Cascade(msgspec.Struct, frozen=True, kw_only=True):
    """A P position loop around a PI velocity loop, with feed-forward, a current loop and filters of the command.

    The velocity loop asks for an acceleration ω_v (n + ∫n / T_n) + a_f Ẍ, where n = K_v e + k_f Ẋ + l Ẍ - w, of the
    whole inertia. In units of the position error, as F/K with K = J ω_v K_v, that is u = p + ∫p / T_n + b a_f Ẍ, with
    p = n / K_v and b = 1 / (ω_v K_v).

    Parameters
    ----------
    position_gain : float
        K_v [1/s].
    velocity_gain : float
        ω_v, gain of the velocity loop by the inertia [1/s]: its bandwidth.
    integral_rate : float
        1 / T_n [1/s]; 0 is a P velocity loop.
    velocity_feedforward, acceleration_feedforward : float
        k_f and a_f; 1 is all of it.
    acceleration_lead : float
        l, acceleration fed forward to the velocity loop [s], as FF2 of LinuxCNC's pid does.
    velocity_feedback : {"motor", "load"}
        The side that w is the speed of. With a scale on the table "motor" is a dual loop.
    current_time : float
        Time constant of the current loop [s]; 0: the torque follows at once.
    deadband : float
        Position errors up to this are none, and greater ones less by it [m].
    dead_time : float
        By which the command reaches the loop late [s].
    moving_average, exponential : float
        Length of a moving average of the command, and time constant of a filter of the first order [s]; 0: none.
    shaper_frequency, shaper_damping : float
        Of a zero-vibration shaper of the command [rad/s, ratio]; frequency 0: none.
    """

    position_gain: float
    velocity_gain: float
    integral_rate: float = 0.0
    velocity_feedforward: float = 0.0
    acceleration_feedforward: float = 0.0
    acceleration_lead: float = 0.0
    velocity_feedback: Literal["motor", "load"] = "motor"
    current_time: float = 0.0
    deadband: float = 0.0
    dead_time: float = 0.0
    moving_average: float = 0.0
    exponential: float = 0.0
    shaper_frequency: float = 0.0
    shaper_damping: float = 0.0


class Servo(msgspec.Struct, frozen=True, kw_only=True):
    """Closed loop of one axis: b [s²] and c [s] of Eq. (9), and the PI/PID gains relative to k_p.

    `stiffness` [N/m] is the force on the table that a P loop answers with a position error of one metre,
    k_p k_a k_t N / r; None where the file does not tell it.

    With a `cascade` b and c are those of its P loops without feed-forward: 1 / (ω_v K_v), and 1 / K_v with what
    friction of the motor adds to it.
    """

    b: float
    c: float
    ki_over_kp: float = 0.0
    kd_over_kp: float = 0.0
    stiffness: float | None = None
    cascade: Cascade | None = None

    @property
    def damping(self) -> float:
        """Damping of the axis itself [s]: c, less what a cascade's velocity loop has of it."""
        return self.c if self.cascade is None else max(self.c - 1.0 / self.cascade.position_gain, 0.0)


class Gap(msgspec.Struct, frozen=True, kw_only=True):
    """Backlash of one axis.

    `lost_motion` [m] is what a dial indicator shows, r Δθ_m / N. The other fields are None where a
    `motor` or `none` axis does not need them: `motor_angle` Δθ_m [rad], `gear_ratio` N,
    `travel_per_rad` r [m/rad], `inertia_fraction` η, `beta` 1/τ [1/s].
    `initial_flank` is the way in which the axis moved last before the start, on whose side its motor pushes.
    """

    lost_motion: float
    motor_angle: float | None = None
    gear_ratio: float | None = None
    travel_per_rad: float | None = None
    inertia_fraction: float | None = None
    beta: float | None = None
    pickup: Pickup | None = None
    initial_flank: Flank = "unknown"

    def with_lost_motion(self, lost_motion: float) -> Gap:
        """Return a gap of another lost motion [m], at the motor too where its transmission is known."""
        angle = self.motor_angle
        if self.gear_ratio is not None and self.travel_per_rad is not None:
            angle = lost_motion * self.gear_ratio / self.travel_per_rad
        return msgspec.structs.replace(self, lost_motion=lost_motion, motor_angle=angle)


class Limits(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of one axis [m/s, m/s², m/s³, rad/s²]; `motor_acceleration` is None where not given."""

    velocity: float
    acceleration: float
    jerk: float
    motor_acceleration: float | None = None


T = TypeVar("T")


class ByAxis(msgspec.Struct, Generic[T], frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A table of a file with a key for each axis that has something; see :data:`MACHINE_AXES`.

    A further linear axis is a line here and a name in :data:`AxisName`.
    """

    X: T | None = None
    Y: T | None = None
    Z: T | None = None

    def given(self) -> dict[str, T]:
        """Return what is given, by axis."""
        found = {axis: getattr(self, axis) for axis in MACHINE_AXES}
        return {axis: value for axis, value in found.items() if value is not None}


class EffectSetting(msgspec.Struct, frozen=True, kw_only=True):
    """A physical effect switched on in the machine file: its name and its parameters, as they stand there."""

    name: str
    parameters: Mapping[str, Any]


class Uncertainty(msgspec.Struct, frozen=True, kw_only=True):
    """Relative uncertainties of one axis' drive parameters."""

    backlash: float = 0.2
    beta: float = 0.2
    gain: float = 0.2
    friction: float = 0.2


class Axis(msgspec.Struct, frozen=True, kw_only=True):
    """One axis of a machine: its drive and its limits.

    `reference_direction` is the direction of motion in which its zero was taken: positions are referred to that
    side of the backlash, with "both" to its middle. `gravity_side` is the side to which gravity pulls the axis, so
    that its backlash never opens; None where it does not.
    """

    name: str
    feedback: Feedback
    servo: Servo
    gap: Gap
    limits: Limits
    uncertainty: Uncertainty = Uncertainty()
    effects: tuple[EffectSetting, ...] = ()
    reference_direction: ReferenceDirection = "both"
    gravity_side: GravitySide | None = None

    @property
    def loop(self) -> Loop:
        """The loop by the name that `feedback` gives it."""
        return LOOPS[self.feedback]

    @property
    def reference_side(self) -> int:
        """Side to which positions are referred (1, -1), 0 for the middle; a scale on the table knows no other."""
        if self.loop.encloses_backlash:
            return 0
        return {"+": 1, "-": -1, "both": 0}[self.reference_direction]


class Machine(msgspec.Struct, frozen=True, kw_only=True):
    """A machine: axes by name, controller dialect and servo period [s], and what the file says of its planner.

    `tool` is what works there, None where the file does not say it. `own_correction` is the part of the backlash that
    the controller corrects by itself outside of our programs (F of Marlin's M425), None where the file does not say it.
    `further` are its axes beside X, Y and Z, of :data:`FURTHER_AXES`, which part programs alone move; A, B and C turn,
    and have rad in the place of m.
    """

    name: str
    dialect: str
    servo_period: float
    axes: Mapping[str, Axis]
    planner: PlannerSettings = PlannerSettings()
    tool: Tool | None = None
    own_correction: float | None = None
    further: Mapping[str, Axis] = {}
    digest: str = ""


class Scenario(msgspec.Struct, frozen=True, kw_only=True):
    """One of the machines that a machine file leaves possible.

    `pickup` and `flank` stand in place of what the file leaves open (None: standstill, and the flank "+"); the
    axes in `opposite` stand on the other flank. `gap`, `beta`, `gain` and `friction` are factors on the file's values.
    A gap of 0 is the machine without backlash. With `spread` the backlash of each axis is larger by so many times its
    own uncertainty, smaller where that is negative. Tables behind their motors stay in their backlash where nothing
    pushes them; with `runs_on` they run on, slowed by so many times the friction of the file.
    """

    pickup: Pickup | None = None
    flank: Literal["+", "-"] | None = None
    opposite: tuple[str, ...] = ()
    gap: float = 1.0
    beta: float = 1.0
    gain: float = 1.0
    friction: float = 1.0
    spread: float = 0.0
    runs_on: float | None = None

    def gap_factor(self, uncertainty: float) -> float:
        """Return the factor on the backlash of an axis with a relative uncertainty of it."""
        return self.gap * max(1.0 + self.spread * uncertainty, 0.0)

    @property
    def without_backlash(self) -> Scenario:
        """The same machine without backlash."""
        return msgspec.structs.replace(self, gap=0.0, spread=0.0)
