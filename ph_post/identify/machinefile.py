"""Write what identification or diagnosis found into a machine file: a person's own, or a new one.

A person's text is kept but for the numbers, in the keys that it uses; beside them stand their standard errors
and the log they come from.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, Final

from msgspec.structs import astuple, replace

from ph_post.consistency import same
from ph_post.drive.machinefile import machine_of
from ph_post.errors import InputError, SolveError
from ph_post.files.machine_text import AxisChange, EffectChange, Row, edit_axes, machine_document
from ph_post.files.storage import SourceText, source_of
from ph_post.identify.cascade_numbers import cascade_values
from ph_post.identify.estimates import KEYS
from ph_post.quantities import measured_words, with_error
from ph_post.types import USUAL_REFERENCE, Axis, Cascade, EffectSetting, Log, Machine, Uncertainty
from ph_post.types.diagnosis import PRODUCT, Diagnosis, Estimate, Finding, Identification, IdentifiedDrive
from ph_post.units import MICROMETRE, MM, MS

_OTHERWISE: Final = {
    "backlash_motor_rad": "lost_motion_mm",
    "J": "b",
    "inertia_kg_m2": "b",
    "B": "c",
    "damping_kg_m2_s": "c",
    "k_p": "servo_stiffness_n_per_mm",
    "position_gain_v_per_m": "servo_stiffness_n_per_mm",
}
"""Keys that give in another way what a diagnosis calls by the usual one."""


def axis_change(
    before: Axis,
    after: Axis,
    original: SourceText,
    *,
    parameters: Mapping[str, Estimate],
    above: Sequence[str],
    effects: Mapping[str, EffectChange],
) -> AxisChange | None:
    """Return what makes one axis into another, None where it is nothing.

    Parameters
    ----------
    before, after : Axis
    original : SourceText
        The machine file of `before`.
    parameters : mapping of str to Estimate
        Standard errors to stand behind the numbers.
    above : sequence of str
        Lines to stand above the first number that changes.
    effects : mapping of str to EffectChange
        Comments of effects that are new or change, by the effect's name.
    """
    table: dict[str, Any] = tomllib.loads(original.text)["axes"][before.name]
    given = table | {f"control.{key}": value for key, value in table.get("control", {}).items()}
    keys = axis_keys(before, after, given)
    changed = effect_changes(before.effects, after.effects, effects)
    if not keys and not changed:
        return None
    comments = _error_comments(keys, parameters)
    return AxisChange(axis=before.name, keys=keys, comments=comments, above=tuple(above), effects=changed)


_OF_SINGLE: Final = (
    *("b", "c", "J", "inertia_kg_m2", "B", "damping_kg_m2_s", "k_p", "position_gain_v_per_m"),
    *("k_a", "amplifier_gain_a_per_v", "k_t", "torque_constant_n_m_per_a", "max_motor_acceleration_rad_s2"),
)
"""Keys that an axis with a cascade has not; the motor's acceleration is not checked with one."""


_OTHER_UNITS: Final = {"position_gain": "control.position_gain_m_per_min_mm"}
"""Other keys of numbers of a cascade."""


def axis_keys(before: Axis, after: Axis, given: Mapping[str, Any]) -> dict[str, float | str | None]:
    """Return the keys of ``[axes.AXIS]`` that make one axis into another, in the way the file gives them.

    Parameters
    ----------
    before, after : Axis
    given : mapping
        The keys of the file, with their values.
    """
    keys: dict[str, float | str | None] = {}
    for one, other, ways in _quantities(before, after, given):
        if not same(one, other):
            known = {key: value for key, value in ways.items() if key in given}
            keys |= known or dict(list(ways.items())[:1])
    if after.servo.cascade is not None:
        keys = {key: value for key, value in keys.items() if key not in _OF_SINGLE} | dict.fromkeys(
            key for key in _OF_SINGLE if key in given
        )
        keys |= dict(_cascade_keys(before.servo.cascade, after.servo.cascade, given))
    stiffer = _ratio(after.servo.stiffness, before.servo.stiffness)
    if not same(stiffer, 1.0):  # J and B keep b and c where k_p changes
        for key in ("J", "inertia_kg_m2", "B", "damping_kg_m2_s"):
            if key in given:
                number = keys.get(key, given[key])
                keys[key] = float(number if isinstance(number, int | float) else given[key]) * stiffer
    return keys


def _cascade_keys(
    before: Cascade | None, after: Cascade, given: Mapping[str, Any]
) -> Iterator[tuple[str, float | str | None]]:
    """Yield the keys of a cascade that changes, and what they become: all of them where it was a single loop."""
    values = cascade_values(after)
    earlier = {} if before is None else cascade_values(before)
    if before is None:
        yield "control.structure", "cascade"
    for name in dict.fromkeys((*values, *earlier)):
        was, value = earlier.get(name), values.get(name)
        if same(was, value):
            continue
        other = _OTHER_UNITS.get(name, "")
        if other in given and was is not None and value is not None:
            yield other, given[other] * value / was
        else:
            yield KEYS[name], value


def effect_changes(
    before: Sequence[EffectSetting], after: Sequence[EffectSetting], describe: Mapping[str, EffectChange]
) -> tuple[EffectChange, ...]:
    """Return the changes that make one list of effects into another, in its order, with comments by name.

    What is to stand behind another effect than before is taken out and added anew.
    """
    changes: list[tuple[int | None, EffectSetting | None]] = []
    reached = 0
    for place, setting in enumerate(before):
        if reached == len(after) or after[reached].name != setting.name:
            changes.append((place, None))
            continue
        if not same(dict(setting.parameters), dict(after[reached].parameters)):
            changes.append((place, after[reached]))
        reached += 1
    changes += [(None, setting) for setting in after[reached:]]
    plain = EffectChange(place=None, setting=None)
    return tuple(
        replace(plain if setting is None else describe.get(setting.name, plain), place=place, setting=setting)
        for place, setting in changes
    )


def error_words(key: str, value: float, parameters: Mapping[str, Estimate]) -> str:
    """Return the standard error of a key in words, nothing where none is known.

    A parameter is known by its name or by its value; a key that gives it in another unit has it in per cent.

    Examples
    --------
    >>> error_words("force_n", 20.4, {"force": Estimate(value=20.4, stderr=0.1, unit="N")})
    '+- 0.1 N'
    """
    keys = (key, _OTHERWISE.get(key, key))
    found = [one for name, one in parameters.items() for way in keys if f"{way}_".startswith(f"{name}_")]
    found += [one for one in parameters.values() if math.isclose(one.value, value, rel_tol=1e-4)]
    if not found or found[0].stderr is None:
        return ""
    estimate = found[0]
    if math.isclose(estimate.value, value, rel_tol=1e-4):
        return _error_of(estimate)
    share = with_error(100.0, 100.0 * found[0].stderr / abs(estimate.value))[1] if estimate.value else None
    return "" if share is None else f"+- {share} %"


def _error_of(estimate: Estimate) -> str:
    """Return a standard error in words with its unit, nothing where none is known."""
    error = with_error(estimate.value, estimate.stderr)[1]
    return "" if error is None else f"+- {error} {estimate.unit}".rstrip()


def _error_comments(values: Mapping[str, Any], parameters: Mapping[str, Estimate]) -> dict[str, str]:
    """Return the standard errors in words, by key, of the numbers that have them."""
    words = {
        key: error_words(key, value, parameters) for key, value in values.items() if isinstance(value, int | float)
    }
    return {key: text for key, text in words.items() if text}


def _quantities(
    before: Axis, after: Axis, given: Mapping[str, Any]
) -> Iterator[tuple[Any, Any, dict[str, float | str | None]]]:
    """Yield what may change: before, after, and the keys that it may stand under, the usual one first."""
    servo, gap = after.servo, after.gap
    angle = None
    if gap.travel_per_rad is not None and gap.gear_ratio is not None:
        angle = gap.lost_motion * gap.gear_ratio / gap.travel_per_rad
    lost: dict[str, float | str | None] = {"lost_motion_mm": gap.lost_motion / MM, "backlash_motor_rad": angle}
    yield before.gap.lost_motion, gap.lost_motion, lost
    b, c = _ratio(servo.b, before.servo.b), _ratio(servo.c, before.servo.c)
    stiffer = _ratio(servo.stiffness, before.servo.stiffness)
    yield before.servo.b, servo.b, {"b": servo.b, **_scaled(given, b, "J", "inertia_kg_m2")}
    yield before.servo.c, servo.c, {"c": servo.c, **_scaled(given, c, "B", "damping_kg_m2_s")}
    stiffness = None if servo.stiffness is None else servo.stiffness * MM
    gains = {"servo_stiffness_n_per_mm": stiffness, **_scaled(given, stiffer, "k_p", "position_gain_v_per_m")}
    yield before.servo.stiffness, servo.stiffness, gains
    for key, one, other in (
        ("control.ki_over_kp_per_s", before.servo.ki_over_kp, servo.ki_over_kp),
        ("control.kd_over_kp_s", before.servo.kd_over_kp, servo.kd_over_kp),
        ("inertia_fraction", before.gap.inertia_fraction, gap.inertia_fraction),
        ("pickup", before.gap.pickup, gap.pickup),
        ("initial_flank", before.gap.initial_flank, gap.initial_flank),
        ("reference_direction", before.reference_direction, after.reference_direction),
        ("gravity_side", before.gravity_side, after.gravity_side),
        ("backlash_uncertainty", before.uncertainty.backlash, after.uncertainty.backlash),
        ("beta_uncertainty", before.uncertainty.beta, after.uncertainty.beta),
        ("gain_uncertainty", before.uncertainty.gain, after.uncertainty.gain),
        ("friction_uncertainty", before.uncertainty.friction, after.uncertainty.friction),
    ):
        yield one, other, {key: other}
    tau = None if gap.beta is None else 1.0 / gap.beta
    yield before.gap.beta, gap.beta, {"motor_time_constant_s": tau}


def _scaled(given: Mapping[str, Any], ratio: float, *keys: str) -> dict[str, float | str | None]:
    return {key: given[key] * ratio for key in keys if key in given}


def _ratio(one: float | None, other: float | None) -> float:
    """Return the factor from `other` to `one`; 1 where there is none, as what it scales is not given then."""
    return one / other if one and other else 1.0


def diagnosed_machine(original: SourceText, diagnosis: Diagnosis, log: Log) -> str:
    """Return a machine file with what a diagnosis added to the machine.

    What a person gave in other keys is changed there: the backlash as an angle of the motor, b and c as inertia
    and damping. Above each change stands which log it comes from, and by how much the residual on
    held-out data fell; behind each number its standard error.

    Parameters
    ----------
    original : SourceText
        The text of the machine file that the diagnosis began with.
    diagnosis : Diagnosis
    log : Log

    Returns
    -------
    str
        A machine file that reads back as `diagnosis.machine`.

    Raises
    ------
    InputError
        Where the machine of the diagnosis cannot stand in a file.
    SolveError
        Where it differs from the file in what no diagnosis changes.
    """
    axes = machine_of(original).axes.values()
    changes = (_change(axis, diagnosis, log, original) for axis in axes)
    return changed_machine(original, changes, diagnosis.machine)


def changed_machine(original: SourceText, changes: Iterable[AxisChange | None], wanted: Machine) -> str:
    """Return a machine file with changes of its axes, None where one has none; it reads back as `wanted`.

    Raises
    ------
    InputError
        Where it contradicts itself.
    SolveError
        Where it is another machine's.
    """
    found = [change for change in changes if change is not None]
    text = edit_axes(original.text, found) if found else original.text
    require_same(machine_of(source_of(text, original.name, original.stem)), wanted)
    return text


def require_same(read: Machine, wanted: Machine) -> None:
    """Check that two machines have the same drives.

    Raises
    ------
    SolveError
        With the axis.
    """
    for name, axis in wanted.axes.items():
        if name not in read.axes or not same(_acting(read.axes[name]), _acting(axis)):
            raise SolveError(f"axis {name}: the machine file would not be that of the diagnosis")


def _change(axis: Axis, diagnosis: Diagnosis, log: Log, original: SourceText) -> AxisChange | None:
    """Return what a diagnosis changes of one axis, None where it is nothing."""
    findings = [finding for finding in diagnosis.findings if finding.axis == axis.name]
    effects = {
        finding.setting.name: EffectChange(
            place=None,
            setting=finding.setting,
            comments=_error_comments(finding.setting.parameters, finding.parameters),
            above=tuple(_provenance(finding, diagnosis, log)),
        )
        for finding in findings
        if finding.setting is not None
    }
    numbers = [finding for finding in findings if finding.setting is None]
    above = [line for finding in numbers for line in _provenance(finding, diagnosis, log)]
    return axis_change(
        axis,
        diagnosis.machine.axes[axis.name],
        original,
        parameters={name: one for finding in numbers for name, one in finding.parameters.items()},
        above=above or [f"fitted to {log_words(log)}"],
        effects=effects,
    )


def _provenance(finding: Finding, diagnosis: Diagnosis, log: Log) -> Iterator[str]:
    """Yield the log that a change comes from, and what it did to the residual."""
    yield f"{finding.name}, diagnosed from {log_words(log)}"
    for last, step in zip(diagnosis.steps, diagnosis.steps[1:], strict=False):
        if step.added == f"{finding.name}:{finding.axis}":
            yield (
                f"residual on held-out data {last.holdout_rms / MICROMETRE:.3g} ->"
                f" {step.holdout_rms / MICROMETRE:.3g} um"
            )


def log_words(log: Log) -> str:
    """Name a log and the hash of its bytes."""
    name = " ".join(log.name.split())
    return f"{name} (sha256 {log.digest})" if log.digest else name


def _acting(axis: Axis) -> list[Any]:
    """Return what of an axis acts."""
    servo, gap, spread = axis.servo, axis.gap, axis.uncertainty
    return [
        axis.feedback,
        servo.b,
        servo.c,
        servo.ki_over_kp,
        servo.kd_over_kp,
        servo.stiffness,
        [] if servo.cascade is None else list(astuple(servo.cascade)),
        gap.lost_motion,
        gap.inertia_fraction,
        gap.beta,
        gap.pickup,
        gap.initial_flank,
        axis.reference_direction,
        axis.gravity_side,
        spread.backlash,
        spread.beta,
        spread.gain,
        spread.friction,
        [(effect.name, dict(effect.parameters)) for effect in axis.effects],
    ]


_ASSUMED: Final = "assumed: not visible in the log"


def identified_machine(original: SourceText | None, found: Identification, log: Log) -> str:
    """Return a machine file with what was identified.

    Parameters
    ----------
    original : SourceText, optional
        The machine file that the identification began with; its text is kept but for the numbers. Without
        one the file is new.
    found : Identification
    log : Log

    Returns
    -------
    str
        A machine file that reads back as `found.machine`.

    Raises
    ------
    InputError
        If the file needs a value that neither log nor options give.
    """
    if original is None:
        return _new_file(found, log)
    before = machine_of(original)
    changes = (
        axis_change(
            before.axes[name],
            found.machine.axes[name],
            original,
            parameters=drive.parameters,
            above=[f"identified from {log_words(log)}"],
            effects={},
        )
        for name, drive in found.drives.items()
    )
    return changed_machine(original, changes, found.machine)


def require_writable(machine: Machine, name: str) -> None:
    """Check that a new file can say all that its axes need.

    Raises
    ------
    InputError
        Where a `load` loop lacks its transmission.
    """
    for axis in machine.axes.values():
        if axis.loop.encloses_backlash and (axis.gap.gear_ratio is None or axis.gap.travel_per_rad is None):
            raise InputError(
                f"{name}: {axis.name}",
                'a machine file with feedback "load" needs gear ratio and travel',
                expected="--gear-ratio and --screw-lead, or a machine file with -m",
            )


def _new_file(found: Identification, log: Log) -> str:
    """Write a file of its own; limits are the largest values in the log."""
    machine = found.machine
    require_writable(machine, log.name)
    for name, drive in found.drives.items():
        for key in ("b", "c") if machine.axes[name].servo.cascade is None else ():
            if drive.origins[key] == "assumed" and getattr(machine.axes[name].servo, key) > 0.0:
                raise InputError(
                    f"{log.name}: {name}",
                    f"the log does not show {key}, and a machine file needs it",
                    expected="a log with more speed and acceleration, or a machine file with -m",
                )
    controller = (
        Row("dialect", machine.dialect, "put yours here"),
        Row("servo_period_ms", machine.servo_period / MS, "the log's"),
    )
    head = (f"Identified from {log_words(log)}.", "+- is the standard error.")
    axes = {name: tuple(_axis_rows(machine.axes[name], drive)) for name, drive in found.drives.items()}
    text = machine_document(head, machine.name, controller, axes)
    require_same(machine_of(source_of(text, "-", machine.name)), machine)
    return text


def _axis_rows(axis: Axis, drive: IdentifiedDrive) -> Iterator[Row | str]:
    """Yield the notes and keys of an axis."""
    yield from drive.notes
    servo, gap, limits = axis.servo, axis.gap, axis.limits
    yield Row("feedback", axis.feedback)
    values = {"b": servo.b, "c": servo.c}
    if servo.cascade is not None:
        yield Row("control.structure", "cascade")
        values = cascade_values(servo.cascade)
    values["lost_motion"] = gap.lost_motion / MM
    if gap.inertia_fraction is not None:
        values["inertia_fraction"] = gap.inertia_fraction
    if gap.beta is not None:
        values["motor_time_constant"] = 1.0 / gap.beta
    for name, value in values.items():
        yield Row(KEYS[name], value, _words(name, drive))
    if servo.stiffness is not None:
        yield Row("servo_stiffness_n_per_mm", servo.stiffness * MM, _words("servo_stiffness", drive))
    if gap.gear_ratio is not None and gap.travel_per_rad is not None:
        yield Row("gear_ratio", gap.gear_ratio)
        yield Row("screw_lead_mm", gap.travel_per_rad * math.tau / MM)
    usual, uncertainty = Uncertainty(), axis.uncertainty
    for name in ("backlash", "beta", "gain", "friction"):
        if getattr(uncertainty, name) != getattr(usual, name):
            yield Row(f"{name}_uncertainty", getattr(uncertainty, name))
    if axis.reference_direction != USUAL_REFERENCE[axis.name]:
        yield Row("reference_direction", axis.reference_direction)
    yield "limits: the largest values in the log; replace them by the machine's"
    yield Row("max_velocity_mm_s", limits.velocity / MM)
    yield Row("max_acceleration_mm_s2", limits.acceleration / MM)
    yield Row("max_jerk_mm_s3", limits.jerk / MM)


def _words(name: str, drive: IdentifiedDrive) -> str:
    """Return the comment behind a number: its standard error, or that nobody measured it."""
    estimate = drive.parameters.get(name)
    if estimate is None:
        return _ASSUMED
    if estimate.stderr is not None:
        return _error_of(estimate)
    product = drive.parameters.get(PRODUCT)
    if product is None or product.stderr is None:
        return ""
    return f"times inertia_fraction {measured_words(product.value, product.stderr, 'mm', '+-')}: only that shows"
