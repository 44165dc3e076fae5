"""Read machine files (TOML): check the physics, and convert to SI.

An axis names its servo either by `b` and `c` of Eq. (9) of [1]_ or by the physical constants they are made
of, and its backlash either at the motor (`backlash_motor_rad`) or as a dial indicator shows it
(`lost_motion_mm`). What is given twice must agree. The keys are listed in :class:`ph_post.files.machine.AxisRecord`.

References
----------
.. [1] Real-time compensation of backlash positional errors in CNC machines by localized feedrate modulation,
   Int. J. Adv. Manuf. Technol. 119 (2022), doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

import math
import os
from typing import Any, NamedTuple

from msgspec.structs import replace

from ph_post.consistency import consistent_value
from ph_post.dialects.planners import settings_of
from ph_post.dialects.registry import find_dialect, is_dialect
from ph_post.drive.cascade import is_stable, most_position_gain
from ph_post.drive.effect_settings import effect_settings
from ph_post.errors import InputError
from ph_post.files.check import checked, one_line, one_of, parse_toml, place, quoted
from ph_post.files.machine import (
    CASCADE_KEYS,
    MOST_LOST,
    PLANNER_KEYS,
    SINGLE_KEYS,
    AxisRecord,
    ControllerRecord,
    ControlRecord,
    MachineRecord,
    RotaryRecord,
    SlideRecord,
)
from ph_post.files.storage import SourceText, or_shipped, read_source
from ph_post.types import (
    MACHINE_AXES,
    USUAL_REFERENCE,
    Axis,
    Cascade,
    Gap,
    Limits,
    Machine,
    PlannerSettings,
    Servo,
    Tool,
    Uncertainty,
)
from ph_post.units import DEGREE, LEAD, MM, MS, PERCENT

_POSITION_GAINS = (("position_gain_per_s", 1.0), ("position_gain_m_per_min_mm", 1e3 / 60.0))
_MOTOR = (
    ("inertia_kg_m2", "J"),
    ("damping_kg_m2_s", "B"),
    ("position_gain_v_per_m", "k_p"),
    ("amplifier_gain_a_per_v", "k_a"),
    ("torque_constant_n_m_per_a", "k_t"),
)


def read_machine(source: str | os.PathLike[str]) -> Machine:
    """Read a machine file; ``-`` is standard input, and a bare name may be that of a shipped machine.

    Parameters
    ----------
    source : str or path
        A TOML file, ``-``, or a name such as ``paper`` where no file of that name exists.

    Returns
    -------
    Machine
        SI units; `digest` is the SHA-256 of the file's bytes.

    Raises
    ------
    InputError
        One line naming file, key, what was expected and what was found.

    Examples
    --------
    >>> read_machine("paper").axes["X"].servo.b
    0.0005
    """
    return machine_of(machine_source(source))


def machine_source(source: str | os.PathLike[str]) -> SourceText:
    """Read the text of a machine file, found as :func:`read_machine` does."""
    return read_source(or_shipped("machines", source))


def _parsed(text: SourceText) -> dict[str, Any]:
    """Decode TOML; of a file that is not even called so, as a controller's own, say where machine files come from."""
    try:
        return parse_toml(text.text, text.name)
    except InputError as error:
        if text.name.lower().endswith(".toml") or error.where == text.name:
            raise
        expected = "TOML, as ph-post machine new writes it; its --settings reads those of Grbl and LinuxCNC"
        got = quoted(text.text.lstrip().partition("\n")[0].strip())
        raise InputError(error.where, "not a machine file", expected=expected, got=got) from None


def machine_of(text: SourceText) -> Machine:
    """Return the machine of a text that was read already; raises as :func:`read_machine`."""
    record = checked(_parsed(text), MachineRecord, text.name)
    axes = {name: _axis(name, axis, text.name) for name, axis in record.axes.given().items()}
    if not axes:
        wanted = ", ".join(f"[axes.{name}]" for name in MACHINE_AXES)
        raise InputError(place(text.name, ("axes",)), "no axis", expected=f"at least one of {wanted}")
    return Machine(
        name=one_line(record.name or text.stem, text.name, ("name",)),
        dialect=one_line(record.controller.dialect, text.name, ("controller", "dialect")),
        servo_period=record.controller.servo_period_ms * MS,
        axes=axes,
        planner=_planner_settings(record.controller, text.name),
        tool=_tool(record.controller, text.name),
        own_correction=_own_correction(record.controller, text.name),
        further={name: _further_axis(name, axis) for name, axis in record.axes.further().items()},
        digest=text.digest,
    )


def _tool(record: ControllerRecord, file: str) -> Tool | None:
    """Take the tool; only printer firmware has words for an extruder."""
    extrudes = record.tool == "extruder" and is_dialect(record.dialect)
    if extrudes and find_dialect(record.dialect).language.bound is None:
        where = place(file, ("controller", "tool"))
        raise InputError(where, f"{record.dialect} has no words for an extruder", expected="marlin or klipper")
    return record.tool


def _own_correction(record: ControllerRecord, file: str) -> float | None:
    """Take what the controller corrects by itself, where its dialect has a word for that."""
    stated = record.own_backlash_correction is not None and is_dialect(record.dialect)
    if stated and not find_dialect(record.dialect).notices.guard:
        where = place(file, ("controller", "own_backlash_correction"))
        raise InputError(where, f"{record.dialect} has no word that switches its own compensation", expected="marlin")
    return record.own_backlash_correction


def _planner_settings(record: ControllerRecord, file: str) -> PlannerSettings:
    """Take the planner's settings, which have to be those of the dialect's; an unknown dialect may have any."""
    given = {
        name: value * unit for name, (key, unit) in PLANNER_KEYS.items() if (value := getattr(record, key)) is not None
    }
    if given and is_dialect(record.dialect):
        known = settings_of(find_dialect(record.dialect).planner)
        for name in given:
            if name not in known:
                where = place(file, ("controller", PLANNER_KEYS[name][0]))
                expected = one_of(PLANNER_KEYS[one][0] for one in known)
                raise InputError(where, f"the planner of {record.dialect} has no such setting", expected=expected)
    if "jerk" in given and "junction_deviation" in given:
        where = place(file, ("controller", PLANNER_KEYS["jerk"][0]))
        raise InputError(where, "a second rule of corners", expected="one of junction_deviation_mm, jerk_mm_s")
    return PlannerSettings(**given)


class _Given:
    """The keys of one axis as given, and the refusals that name them."""

    def __init__(self, name: str, record: AxisRecord, file: str) -> None:
        self.name = name
        self.record = record
        self.file = file

    def place(self, key: str) -> str:
        """Where a key stands."""
        return place(self.file, ("axes", self.name, *key.split(".")))

    def refuse(self, key: str, what: str, expected: str = "", got: str = "") -> InputError:
        """Make the refusal of one key."""
        return InputError(self.place(key), what, expected=expected, got=got)

    def missing(self, key: str, expected: str = "") -> InputError:
        """Make the refusal of an axis that lacks a key."""
        return InputError(place(self.file, ("axes", self.name)), f"key {quoted(key)} is missing", expected=expected)

    def present(self, symbol: str, value: float | None) -> float:
        """Return a physical constant, all of which are needed where one is given."""
        if value is None:
            raise self.missing(symbol, "all of J, B, k_p, k_a, k_t, N and r, or b and c alone")
        return value

    def agreed(self, *given: tuple[str, float | None]) -> float | None:
        """Return the first value given; whatever else gives the same thing must agree with it."""
        return consistent_value(given, self.place)

    def either(self, *keys: tuple[str, float]) -> float | None:
        """Return a value that may stand under several keys, each with its factor to SI."""
        values = ((key, getattr(self.record, key)) for key, _ in keys)
        factors = dict(keys)
        return self.agreed(*((key, None if value is None else value * factors[key]) for key, value in values))


def _axis(name: str, record: AxisRecord, file: str) -> Axis:
    given = _Given(name, record, file)
    ratio = given.either(("gear_ratio", 1.0), ("N", 1.0))
    travel = given.either(("travel_per_rad_mm", MM), ("screw_lead_mm", LEAD), ("r", 1.0))
    gap = _gap(given, ratio, travel)
    axis = Axis(
        name=name,
        feedback=record.feedback,
        servo=_loop(given, ratio, travel),
        gap=gap,
        limits=Limits(
            velocity=record.max_velocity_mm_s * MM,
            acceleration=record.max_acceleration_mm_s2 * MM,
            jerk=record.max_jerk_mm_s3 * MM,
            motor_acceleration=record.max_motor_acceleration_rad_s2,
        ),
        uncertainty=Uncertainty(
            backlash=record.backlash_uncertainty,
            beta=record.beta_uncertainty,
            gain=record.gain_uncertainty,
            friction=record.friction_uncertainty,
        ),
        reference_direction=record.reference_direction or USUAL_REFERENCE[name],
        gravity_side=record.gravity_side,
    )
    return replace(axis, effects=effect_settings(record.effects, axis, file, ("axes", name, "effects")))


def _further_axis(name: str, record: RotaryRecord | SlideRecord) -> Axis:
    """Make an axis beside X, Y and Z; one that turns has rad in the place of m."""
    if isinstance(record, RotaryRecord):
        unit, lost = DEGREE, record.lost_motion_deg
        limits = record.max_velocity_deg_s, record.max_acceleration_deg_s2, record.max_jerk_deg_s3
    else:
        unit, lost = MM, record.lost_motion_mm
        limits = record.max_velocity_mm_s, record.max_acceleration_mm_s2, record.max_jerk_mm_s3
    velocity, acceleration, jerk = (limit * unit for limit in limits)
    return Axis(
        name=name,
        feedback=record.feedback,
        servo=Servo(b=record.b, c=record.c),
        gap=Gap(lost_motion=lost * unit),
        limits=Limits(velocity=velocity, acceleration=acceleration, jerk=jerk),
        uncertainty=Uncertainty(backlash=record.backlash_uncertainty),
        reference_direction=record.reference_direction,
    )


class _MotorConstants(NamedTuple):
    """What the physical constants make: b [s²], c [s] and the stiffness [N/m], None where not given."""

    b: float | None = None
    c: float | None = None
    stiffness: float | None = None


def _motor(given: _Given, ratio: float | None, travel: float | None) -> _MotorConstants:
    """Take the physical constants, all or none. Implements Eq. (9) of [1]_, and K = k_p k_a k_t N / r."""
    direct = given.either(("servo_stiffness_n_per_mm", 1.0 / MM))
    motor = {symbol: given.either((key, 1.0), (symbol, 1.0)) for key, symbol in _MOTOR}
    if all(value is None for value in motor.values()):
        return _MotorConstants(stiffness=direct)
    constants = {**motor, "N": ratio, "r": travel}
    J, B, k_p, k_a, k_t, N, r = (given.present(symbol, value) for symbol, value in constants.items())
    gain = k_p * k_a * k_t
    stiffness = given.agreed(("k_p", gain * N / r), ("servo_stiffness_n_per_mm", direct))
    return _MotorConstants(N * J / (gain * r), N * B / (gain * r), stiffness)


def _coefficients(given: _Given, motor: _MotorConstants) -> tuple[float, float]:
    """Return b [s²] and c [s], given or made of the physical constants."""
    record = given.record
    b = given.agreed(("b", record.b), ("J", motor.b))
    c = given.agreed(("c", record.c), ("B", motor.c))
    if b is None or c is None:
        ideal = "" if record.loop.has_controller else "; 0 for an ideal stepper"
        wanted = f"b [s²] and c [s] of Eq. (9), or J, B, k_p, k_a, k_t, N and r{ideal}"
        raise given.missing("b" if b is None else "c", wanted)
    return b, c


def _loop(given: _Given, ratio: float | None, travel: float | None) -> Servo:
    """Take a single loop or a cascade; the keys of one have no place in the other."""
    control = given.record.control
    if control is not None and control.structure == "cascade":
        return _cascaded(given, control)
    default = ControlRecord()
    for key in CASCADE_KEYS if control is not None else ():
        if getattr(control, key) != getattr(default, key):
            raise given.refuse(f"control.{key}", "a single loop has no such key", 'structure = "cascade"')
    motor = _motor(given, ratio, travel)
    b, c = _coefficients(given, motor)
    _check_damping(given, b, c)
    return _servo(given, b, c, motor.stiffness)


_OF_SINGLE = ("b", "c", *(key for pair in _MOTOR for key in pair))


def _cascaded(given: _Given, control: ControlRecord) -> Servo:
    """Take the gains of a cascade, and check that it settles.

    b = 1 / (ω_v K_v) is the inertia in units of the position error, and the motor's own damping, η b / τ where the file
    has both, that of the axis.
    """
    record = given.record
    _refuse_single_loop(given, control)
    gains = {key: getattr(control, key) for key, _ in _POSITION_GAINS}
    units = dict(_POSITION_GAINS)
    position_gain = given.agreed(
        *((f"control.{key}", None if value is None else value * units[key]) for key, value in gains.items())
    )
    if position_gain is None:
        raise given.missing("control.position_gain_per_s", "K_v, in 1/s or as position_gain_m_per_min_mm")
    if control.velocity_gain_per_s is None:
        raise given.missing("control.velocity_gain_per_s", "gain of the velocity loop by the inertia: its bandwidth")
    cascade = _cascade(control, position_gain, control.velocity_gain_per_s)
    b = 1.0 / (cascade.velocity_gain * position_gain)
    tau = record.motor_time_constant_s
    damping = 0.0 if tau is None else (record.inertia_fraction or 1.0) * b / tau
    stiffness = given.either(("servo_stiffness_n_per_mm", 1.0 / MM))
    servo = Servo(b=b, c=damping + 1.0 / position_gain, stiffness=stiffness, cascade=cascade)
    if not is_stable(servo):
        key = next(key for key, value in gains.items() if value is not None)
        most = most_position_gain(servo) / units[key]
        lower = f"< {most:.4g}" if most > 0.0 else "a slower velocity_gain_per_s, or a quicker current_bandwidth_hz"
        raise given.refuse(f"control.{key}", "the cascade is unstable", lower, f"{position_gain / units[key]:g}")
    return servo


def _refuse_single_loop(given: _Given, control: ControlRecord) -> None:
    """Refuse what a cascade has not: no controller, the gains of a single loop, a reading where nothing reads."""
    record = given.record
    if not record.loop.has_controller:
        raise given.refuse("control", "an open loop has no controller", 'no such table, or feedback "load" or "motor"')
    if record.max_motor_acceleration_rad_s2 is not None and record.loop.encloses_backlash:
        raise given.refuse("max_motor_acceleration_rad_s2", "is not checked with a cascade yet", "no such key")
    for key in _OF_SINGLE:
        if getattr(record, key) is not None:
            raise given.refuse(key, "a cascade has its own gains", "[axes.X.control] alone".replace("X", given.name))
    for key in SINGLE_KEYS:
        if getattr(control, key):
            raise given.refuse(f"control.{key}", "a cascade has no such gain", "velocity_integral_time_ms")
    if not record.loop.encloses_backlash and control.velocity_feedback == "load":
        raise given.refuse("control.velocity_feedback", "nothing reads the table", '"motor"', '"load"')


def _cascade(control: ControlRecord, position_gain: float, velocity_gain: float) -> Cascade:
    """Take the numbers of a cascade in SI units; its gains are K_v and ω_v [1/s]."""
    integral_time, bandwidth = control.velocity_integral_time_ms, control.current_bandwidth_hz
    return Cascade(
        position_gain=position_gain,
        velocity_gain=velocity_gain,
        integral_rate=0.0 if integral_time is None else 1.0 / (integral_time * MS),
        velocity_feedforward=control.velocity_feedforward_percent * PERCENT,
        acceleration_feedforward=control.acceleration_feedforward_percent * PERCENT,
        acceleration_lead=control.acceleration_lead_ms * MS,
        velocity_feedback=control.velocity_feedback or "motor",
        current_time=0.0 if bandwidth is None else 1.0 / (math.tau * bandwidth),
        deadband=control.deadband_mm * MM,
        dead_time=control.dead_time_ms * MS,
        moving_average=control.moving_average_ms * MS,
        exponential=control.exponential_filter_ms * MS,
        shaper_frequency=0.0 if control.zv_frequency_hz is None else math.tau * control.zv_frequency_hz,
        shaper_damping=control.zv_damping,
    )


def _servo(given: _Given, b: float, c: float, stiffness: float | None) -> Servo:
    """Check that the closed loop settles, and take its gains."""
    record = given.record
    ideal = not record.loop.has_controller and b == c == 0
    for key, value in (("b", b), ("c", c)):
        if value == 0 and not ideal:
            both = "" if record.loop.has_controller else ", or b and c both 0"
            raise given.refuse(key, "a servo loop has inertia and damping", f"> 0{both}", "0")
    if record.control is None:
        return Servo(b=b, c=c, stiffness=stiffness)
    ki, kd = record.control.ki_over_kp_per_s, record.control.kd_over_kp_s
    if not record.loop.has_controller:
        raise given.refuse("control", "an open loop has no controller", 'no such table, or feedback "load" or "motor"')
    if ki * b >= c + kd:  # Routh, for b s³ + (c + kd) s² + s + ki
        most = f"< (c + kd) / b = {(c + kd) / b:.6g}"
        raise given.refuse("control.ki_over_kp_per_s", "the loop is unstable", most, f"{ki:g}")
    return Servo(b=b, c=c, ki_over_kp=ki, kd_over_kp=kd, stiffness=stiffness)


def _gap(given: _Given, ratio: float | None, travel: float | None) -> Gap:
    """Take the gap and what its crossing needs: everything on a `load` loop, else only what is given."""
    record = given.record
    angle = record.backlash_motor_rad
    _require_drive(given, ratio, travel)
    at_axis = angle * travel / ratio if angle is not None and travel is not None and ratio is not None else None
    in_metres = None if record.lost_motion_mm is None else record.lost_motion_mm * MM
    lost = given.agreed(("backlash_motor_rad", at_axis), ("lost_motion_mm", in_metres))
    if lost is None:
        raise given.missing("lost_motion_mm", "lost_motion_mm or backlash_motor_rad (0 if there is no backlash)")
    if lost > MOST_LOST * MM:
        got = f"{lost / MM:.6g} mm"
        raise given.refuse("backlash_motor_rad", "out of range", f"<= {MOST_LOST} mm at the axis", got)
    if record.gravity_side is not None:
        lost, angle = 0.0, None  # it never opens
    if angle is None and travel is not None and ratio is not None:
        angle = lost * ratio / travel
    tau = record.motor_time_constant_s
    return Gap(
        lost_motion=lost,
        motor_angle=angle,
        gear_ratio=ratio,
        travel_per_rad=travel,
        inertia_fraction=record.inertia_fraction,
        beta=None if tau is None else 1.0 / tau,
        pickup=record.pickup,
        initial_flank=record.initial_flank,
    )


def _require_drive(given: _Given, ratio: float | None, travel: float | None) -> None:
    """Refuse an axis that lacks what its feedback or its way of giving the gap needs."""
    record = given.record
    load = record.loop.encloses_backlash
    why = f'with feedback "{record.feedback}"' if load else "with backlash_motor_rad"
    if load or record.backlash_motor_rad is not None:
        if ratio is None:
            raise given.missing("gear_ratio", f"the gear ratio N, {why}")
        if travel is None:
            raise given.missing("travel_per_rad_mm", f"travel_per_rad_mm or screw_lead_mm, {why}")
    if load and record.inertia_fraction is None:
        raise given.missing("inertia_fraction", f"the motor's part of the inertia, {why}")
    if load and record.motor_time_constant_s is None:
        raise given.missing("motor_time_constant_s", f"the motor's own time constant, {why}")


def _check_damping(given: _Given, b: float, c: float) -> None:
    """Refuse constants that leave the load a negative damping.

    c/b = B/J by Eq. (9), and the motor alone has B_m = η J / τ, which is part of B.
    """
    fraction, tau = given.record.inertia_fraction, given.record.motor_time_constant_s
    if fraction is None or tau is None or c * tau >= b * fraction:
        return
    least = f"c >= b * inertia_fraction / motor_time_constant_s = {b * fraction / tau:.6g}"
    raise given.refuse("c", "the load would have negative damping", least, f"{c:g}")
