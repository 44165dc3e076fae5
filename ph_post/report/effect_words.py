"""Names and sentences for effects, verdicts, and parameters with their standard errors."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from ph_post.quantities import measured_words, micrometres
from ph_post.types.diagnosis import Diagnosis, Estimate, Finding

LARGE: Final = 1e5
"""Multiples of a noise floor from which on the power of ten says enough."""

EFFECTS: Final = {
    "backlash": "backlash",
    "coulomb_friction": "Coulomb friction",
    "stribeck_friction": "Stribeck friction",
    "viscous_friction": "viscous friction",
    "friction_asymmetry": "friction that depends on direction",
    "load_offset": "a constant load",
    "elastic_windup": "wind-up between motor and table",
    "engagement_impact": "an impact as the backlash closes",
    "position_dependent_backlash": "backlash that depends on position",
    "cyclic_error": "a cyclic error",
    "scale_error": "a scale error",
    "thermal_growth": "thermal growth",
    "squareness": "a squareness error",
    "servo_mismatch": "other servo parameters than in the file",
    "command_filter": "a filter of the command",
    "transport_delay": "a transport delay",
    "torque_saturation": "a limit of the motor torque",
    "cogging": "cogging of the motor",
    "cutting_force": "a cutting force",
}
"""Names of effects inside a sentence."""

FORCES: Final = ("force", "static_force")
"""Parameters that are forces."""

_SENTENCES: Final = {
    "backlash": "The backlash of {axis} differs from the file",
    "position_dependent_backlash": "The backlash of {axis} depends on position",
    "servo_mismatch": "The servo of {axis} differs from the file",
    "engagement_impact": "The table of {axis} is hit, not picked up at rest, as the backlash closes",
    "scale_error": "The scale of {axis} is off",
    "thermal_growth": "{axis} grows with time",
    "squareness": "{axis} is out of square",
    "command_filter": "The command of {axis} passes a longer filter than the file has",
    "transport_delay": "{axis} has a delay that the file does not have",
    "torque_saturation": "The motor of {axis} reaches its torque limit",
}
"""Sentences of effects for which "is missing from" would be wrong."""


def label_words(label: str, axis: str = "") -> str:
    """Name an effect given as ``effect:axis``, or as ``effect`` with the axis apart.

    Examples
    --------
    >>> label_words("coulomb_friction:X"), label_words("load_offset", "Z")
    ('Coulomb friction (X)', 'a constant load (Z)')
    """
    name, _, own = label.partition(":")
    return f"{_plain(name)} ({own or axis})"


def finding_name(found: Finding) -> str:
    """Name a finding as a heading.

    Such as ``Coulomb friction (X)``.
    """
    name = label_words(found.name, found.axis)
    return f"{name[0].upper()}{name[1:]}"


def _plain(name: str) -> str:
    """Name an effect; an added one keeps its own name."""
    return EFFECTS.get(name, name.replace("_", " "))


def estimate_words(one: Estimate) -> str:
    """Write a value with its standard error, both to the last digit of the error.

    Examples
    --------
    >>> estimate_words(Estimate(value=20.4123, stderr=0.1, unit="N"))
    '20.4 ± 0.1 N'
    >>> estimate_words(Estimate(value=0.031234, stderr=0.00134, unit="mm"))
    '0.0312 ± 0.0013 mm'
    >>> estimate_words(Estimate(value=12.3456, stderr=None, unit="N"))
    '12.35 N'
    """
    return measured_words(one.value, one.stderr, "" if one.unit == "1" else one.unit)


def parameter_words(key: str, one: Estimate) -> str:
    """Write a parameter of an effect; a force in mm is what it adds to the following error.

    Examples
    --------
    >>> parameter_words("force", Estimate(value=0.0201, stderr=0.0003, unit="mm"))
    '0.0201 ± 0.0003 mm of following error'
    """
    following = " of following error" if key in FORCES and one.unit == "mm" else ""
    following = " mm per mm" if key == "slope" and one.unit == "1" else following
    return f"{estimate_words(one)}{following}"


def finding_sentence(found: Finding) -> str:
    """Describe a finding in a sentence, with its leading parameter."""
    words = _plain(found.name)
    usual = f"{words[0].upper()}{words[1:]} is missing from {{axis}}"
    sentence = _SENTENCES.get(found.name, usual).format(axis=found.axis)
    leading = next(iter(found.parameters.items()), None)
    if leading is None:
        return f"{sentence}."
    key, value = leading
    # Numbers of a servo say nothing without their name, a force does.
    named = f"{key.replace('_', ' ')} = " if found.name in ("servo_mismatch", "command_filter") else ""
    return f"{sentence}: {named}{parameter_words(key, value)}."


MUCH: Final = 2.0
"""Times the noise floor from which on what remains is said with the names."""


def verdict_sentences(diagnosis: Diagnosis) -> list[str]:
    """Describe the findings in plain sentences, certain ones first."""
    if diagnosis.verdict == "nothing-missing":
        what = "machine file and log differ by no more than the noise of the log"
        return [f"Nothing is missing: {what} ({gap_words(diagnosis)})."]
    if diagnosis.verdict == "not-identifiable":
        return [_cannot_show(diagnosis)]
    rivals = _rivals(diagnosis)
    doubted = {label for group in rivals for label in group}
    sentences = [finding_sentence(one) for one in diagnosis.findings if _label(one) not in doubted]
    sentences += [_cannot_tell(group, diagnosis) for group in rivals]
    if diagnosis.verdict == "unknown":
        sentences.append(_not_explained(diagnosis, also=bool(sentences)))
    elif diagnosis.steps[1:] and diagnosis.steps[-1].holdout_rms > MUCH * diagnosis.noise_floor > 0.0:
        sentences.append(_remains(diagnosis))
    sentences += [f"Dropped: {label_words(f'{one.name}:{one.axis}')}, as {one.why}." for one in diagnosis.dropped]
    return sentences


def _remains(diagnosis: Diagnosis) -> str:
    """Say what is left behind names: how much, and mostly where."""
    last, floor = diagnosis.steps[-1].holdout_rms, diagnosis.noise_floor
    most = max(diagnosis.remaining, key=lambda place: place.share, default=None)
    where = "" if most is None else f", mostly of {most.axis}: {most.sentence.rstrip('.')}"
    return f"{micrometres(last)} µm rms remain, {multiple(last, floor)} times the noise floor{where}."


def gap_words(diagnosis: Diagnosis) -> str:
    """Describe the last residual: in µm, and in multiples of the noise floor."""
    if not diagnosis.steps or not math.isfinite(diagnosis.steps[-1].holdout_rms):
        return "the residual was not measured"
    last, floor = diagnosis.steps[-1].holdout_rms, diagnosis.noise_floor
    times = f", {multiple(last, floor)} times the noise floor of {micrometres(floor)} µm" if floor > 0.0 else ""
    return f"residual {micrometres(last)} µm rms on held-out data{times}"


def multiple(length: float, floor: float) -> str:
    """Write a length as a multiple of a noise floor."""
    times = length / floor
    return f"{times:.1f}" if times < LARGE else f"{times:.0e}"


def _cannot_show(diagnosis: Diagnosis) -> str:
    reasons = diagnosis.quality.faults or diagnosis.notes
    why = "; ".join(reason.rstrip(".") for reason in reasons)
    return f"This log cannot show it: {why}." if why else "This log cannot show it."


def _not_explained(diagnosis: Diagnosis, *, also: bool) -> str:
    places = diagnosis.remaining or diagnosis.places
    first = places[0].axis if places else ""
    most = max((one for one in places if one.axis == first), key=lambda place: place.share, default=None)
    whose = f" {first}:" if len({one.axis for one in places}) > 1 else ""
    where = f"{whose} {most.sentence.rstrip('.')}." if most is not None else ""
    what = "the rest" if also else "it"
    return f"No known effect explains {what}: {gap_words(diagnosis)}.{where}"


def _cannot_tell(group: Sequence[str], diagnosis: Diagnosis) -> str:
    rivals = ", or ".join(label_words(label) for label in group)
    following = diagnosis.next_experiment
    what_to_do = "" if following is None else f"; run {following.name} to separate them"
    return f"This log cannot separate: {rivals}{what_to_do}."


def _rivals(diagnosis: Diagnosis) -> list[list[str]]:
    """Return the sets of effects that explain the log equally well, each once."""
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
