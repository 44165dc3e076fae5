"""Names and sentences for effects, verdicts, and parameters with their standard errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from ph_post.types.diagnosis import Diagnosis, Estimate, Finding
from ph_post.units import MICROMETRE

SMALL: Final = 0.01 * MICROMETRE
"""What is smaller is no length that a machine shows, but may be one that a simulation does."""

LARGE: Final = 1e5
"""Multiples of a noise floor from which on the power of ten says enough."""

EFFECTS: Final = {
    "backlash": "backlash",
    "coulomb_friction": "Coulomb friction",
    "stribeck_friction": "Stribeck friction",
    "viscous_friction": "viscous friction",
    "friction_asymmetry": "friction that differs by direction",
    "load_offset": "a constant load",
    "elastic_windup": "wind-up between motor and table",
    "engagement_impact": "a pick-up that keeps momentum",
    "position_dependent_backlash": "backlash that depends on position",
    "cyclic_error": "a cyclic error",
    "scale_error": "a scale error",
    "thermal_growth": "thermal growth",
    "squareness": "an error of squareness",
    "servo_mismatch": "a servo that is not as the file says",
    "transport_delay": "a transport delay",
    "torque_saturation": "a limit of the motor's torque",
    "cogging": "cogging of the motor",
    "cutting_force": "a cutting force",
}
"""Effects as a sentence names them."""

FORCES: Final = ("force", "static_force")
"""Parameters that are forces."""

_SENTENCES: Final = {
    "backlash": "The backlash of {axis} is not what the file says",
    "position_dependent_backlash": "The backlash of {axis} depends on position",
    "servo_mismatch": "The servo of {axis} is not as the file says",
    "engagement_impact": "The table of {axis} is picked up with momentum",
    "scale_error": "The scale of {axis} is off",
    "thermal_growth": "{axis} grows as time goes on",
    "squareness": "{axis} is out of square",
    "transport_delay": "A delay is missing from {axis}",
    "torque_saturation": "The motor of {axis} comes to the limit of its torque",
}
"""Where "is missing from" is not how the shop would say it."""


def label_words(label: str, axis: str = "") -> str:
    """Name what stands as ``effect:axis``, or as ``effect`` where the axis is given.

    Examples
    --------
    >>> label_words("coulomb_friction:X"), label_words("load_offset", "Z")
    ('Coulomb friction (X)', 'a constant load (Z)')
    """
    name, _, own = label.partition(":")
    return f"{_plain(name)} ({own or axis})"


def finding_name(found: Finding) -> str:
    """Name what was found as a heading does.

    Such as ``Coulomb friction (X)``.
    """
    name = label_words(found.name, found.axis)
    return f"{name[0].upper()}{name[1:]}"


def _plain(name: str) -> str:
    """Name an effect, one that somebody added by its own name."""
    return EFFECTS.get(name, name.replace("_", " "))


def estimate_words(one: Estimate) -> str:
    """Write a value with its standard error, both to the digit that the error reaches.

    Examples
    --------
    >>> estimate_words(Estimate(value=20.4123, stderr=0.1, unit="N"))
    '20.4 ± 0.1 N'
    >>> estimate_words(Estimate(value=0.031234, stderr=0.00134, unit="mm"))
    '0.0312 ± 0.0013 mm'
    >>> estimate_words(Estimate(value=12.3456, stderr=None, unit="N"))
    '12.35 N'
    """
    value, error = number_words(one)
    unit = "" if one.unit in ("", "1") else f" {one.unit}"
    return f"{value}{unit}" if error is None else f"{value} ± {error}{unit}"


def parameter_words(key: str, one: Estimate) -> str:
    """Write a parameter of an effect: a force in mm is what it adds to the following error.

    Examples
    --------
    >>> parameter_words("force", Estimate(value=0.0201, stderr=0.0003, unit="mm"))
    '0.0201 ± 0.0003 mm of following error'
    """
    following = " of following error" if key in FORCES and one.unit == "mm" else ""
    following = " mm per mm" if key == "slope" and one.unit == "1" else following
    return f"{estimate_words(one)}{following}"


def number_words(one: Estimate) -> tuple[str, str | None]:
    """Write value and standard error, without their unit; None where no error is known."""
    if one.stderr is None or not math.isfinite(one.stderr) or one.stderr <= 0.0:
        return f"{one.value:.4g}", None
    # One digit tells most errors; where it is off by much, as 0.1 for 0.14, two do.
    short = float(f"{one.stderr:.0e}")
    digits = 1 if abs(short - one.stderr) <= 0.05 * one.stderr else 2
    exponent = math.floor(math.log10(float(f"{one.stderr:.{digits - 1}e}")))
    if abs(one.value) < 1e-3 and exponent < -5:
        return f"{one.value:.4g}", f"{one.stderr:.2g}"
    if abs(one.value) > 1e6 * one.stderr:
        return f"{one.value:.6g}", f"{one.stderr:.1g}"
    places = digits - 1 - exponent
    shown = max(places, 0)
    return f"{round(one.value, places):.{shown}f}", f"{round(one.stderr, places):.{shown}f}"


def finding_sentence(found: Finding) -> str:
    """Say in a sentence what is missing, and its leading parameter."""
    words = _plain(found.name)
    usual = f"{words[0].upper()}{words[1:]} is missing from {{axis}}"
    sentence = _SENTENCES.get(found.name, usual).format(axis=found.axis)
    leading = next(iter(found.parameters.items()), None)
    if leading is None:
        return f"{sentence}."
    key, value = leading
    # b and c say nothing without their name, a force does.
    named = f"{key} = " if found.name == "servo_mismatch" else ""
    return f"{sentence}: {named}{parameter_words(key, value)}."


def verdict_sentences(diagnosis: Diagnosis) -> list[str]:
    """Say what was found in plain sentences, what is certain first."""
    if diagnosis.verdict == "nothing-missing":
        what = "machine file and record are no farther apart than the record's own noise explains"
        return [f"Nothing is missing: {what} ({gap_words(diagnosis)})."]
    if diagnosis.verdict == "not-identifiable":
        return [_cannot_show(diagnosis)]
    rivals = _rivals(diagnosis)
    doubted = {label for group in rivals for label in group}
    sentences = [finding_sentence(one) for one in diagnosis.findings if _label(one) not in doubted]
    sentences += [_cannot_tell(group, diagnosis) for group in rivals]
    if diagnosis.verdict == "unknown":
        sentences.append(_not_explained(diagnosis, also=bool(sentences)))
    return sentences


def gap_words(diagnosis: Diagnosis) -> str:
    """Say how far model and record are apart in the end: in µm, and in times the noise floor."""
    if not diagnosis.steps or not math.isfinite(diagnosis.steps[-1].holdout_rms):
        return "the gap was not measured"
    last, floor = diagnosis.steps[-1].holdout_rms, diagnosis.noise_floor
    times = f", {multiple(last, floor)} times the noise floor of {micrometres(floor)} µm" if floor > 0.0 else ""
    return f"{micrometres(last)} µm rms on what was held out{times}"


def multiple(length: float, floor: float) -> str:
    """Write how many times a noise floor a length is."""
    times = length / floor
    return f"{times:.1f}" if times < LARGE else f"{times:.0e}"


def micrometres(length: float) -> str:
    """Write a length [m] in µm, to 0.01 µm or to two digits of what is smaller."""
    if not math.isfinite(length):
        return "-"
    return f"{length / MICROMETRE:.2f}" if length >= SMALL or length == 0.0 else f"{length / MICROMETRE:.1e}"


def _cannot_show(diagnosis: Diagnosis) -> str:
    reasons = diagnosis.quality.faults or diagnosis.notes
    why = "; ".join(reason.rstrip(".") for reason in reasons)
    return f"This record cannot show it: {why}." if why else "This record cannot show it."


def _not_explained(diagnosis: Diagnosis, *, also: bool) -> str:
    places = diagnosis.remaining or diagnosis.places
    first = places[0].axis if places else ""
    most = max((one for one in places if one.axis == first), key=lambda place: place.share, default=None)
    whose = f" {first}:" if len({one.axis for one in places}) > 1 else ""
    where = f"{whose} {most.sentence.rstrip('.')}." if most is not None else ""
    what = "the rest" if also else "it"
    return f"None of the effects that are known explains {what}: {gap_words(diagnosis)}.{where}"


def _cannot_tell(group: Sequence[str], diagnosis: Diagnosis) -> str:
    rivals = ", or ".join(label_words(label) for label in group)
    following = diagnosis.next_experiment
    what_to_do = "" if following is None else f"; run {following.name}, which tells them apart"
    return f"These cannot be told apart from this record: {rivals}{what_to_do}."


def _rivals(diagnosis: Diagnosis) -> list[list[str]]:
    """Return the sets of names that explain the record equally well, each once."""
    groups: dict[frozenset[str], list[str]] = {}
    for one in diagnosis.findings:
        if one.ambiguous_with:
            others = [label if ":" in label else f"{label}:{one.axis}" for label in one.ambiguous_with]
            labels = list(dict.fromkeys([_label(one), *others]))
            groups.setdefault(frozenset(labels), labels)
    if not groups and diagnosis.verdict == "ambiguous":
        return [[_label(one) for one in diagnosis.findings]]
    return list(groups.values())


def _label(found: Finding) -> str:
    return f"{found.name}:{found.axis}"
