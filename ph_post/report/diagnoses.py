"""Text and JSON of the results of ``diagnose`` and ``identify``."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Final

from ph_post.quantities import NOTHING, micrometres, with_error
from ph_post.report.effect_words import (
    finding_name,
    label_words,
    multiple,
    parameter_words,
    verdict_sentences,
)
from ph_post.report.tables import format_table
from ph_post.types import Log
from ph_post.types.diagnosis import (
    Channel,
    ChannelQuality,
    Diagnosis,
    Estimate,
    Experiment,
    Finding,
    Identification,
    LogQuality,
    ResidualPlace,
    ResidualStep,
    Sensitivity,
)
from ph_post.units import MICROMETRE, MM, MS

PLACES_SHOWN: Final = 4
"""Places of an axis that the terminal shows, those with the largest shares."""

SHARE_SHOWN: Final = 0.05
"""Places with a smaller share of the excess are only in the JSON object."""

SHORT: Final = 20
"""Characters up to which an item to log is the name of a column."""

JITTER: Final = 1e-3
"""Jitter below this part of the period is not shown on the terminal."""


def effort_units(log: Log) -> dict[str, str]:
    """Return the units of a log's force or current channels, by axis."""
    return {name: axis.effort_unit for name, axis in log.axes.items() if axis.effort is not None}


def channel_scale(axis: str, channel: Channel, efforts: Mapping[str, str]) -> tuple[str, float]:
    """Return the unit that a channel is shown in, and its size in the units of the log."""
    return (efforts.get(axis, ""), 1.0) if channel == "force" else ("mm", MM)


def diagnosis_view(diagnosis: Diagnosis, efforts: Mapping[str, str] | None = None) -> dict[str, Any]:
    """Return a diagnosis as a JSON object; what is not known is None.

    Parameters
    ----------
    diagnosis : Diagnosis
    efforts : mapping, optional
        Units of the force channels by axis, see :func:`effort_units`.
    """
    following = diagnosis.next_experiment
    return {
        "verdict": diagnosis.verdict,
        "effects": [_finding_view(one) for one in diagnosis.findings],
        "gap": {
            "unit": "mm",
            "noise_floor": _finite(diagnosis.noise_floor, MM),
            "steps": [_step_view(step) for step in diagnosis.steps],
        },
        "next_experiment": None if following is None else _experiment_view(following),
        "words": verdict_sentences(diagnosis),
        "places": [_place_view(place) for place in diagnosis.places],
        "remaining": [_place_view(place) for place in diagnosis.remaining],
        "quality": _quality_view(diagnosis.quality, efforts or {}),
        "dropped": [{"name": one.name, "axis": one.axis, "why": one.why} for one in diagnosis.dropped],
        "notes": list(diagnosis.notes),
        "warnings": [],
    }


def _finding_view(found: Finding) -> dict[str, Any]:
    return {
        "name": found.name,
        "axis": found.axis,
        "parameters": {name: estimate_view(one) for name, one in found.parameters.items()},
        "where": found.where,
        "confidence": _finite(found.confidence),
        "ambiguous_with": list(found.ambiguous_with),
        "evidence": list(found.evidence),
    }


def estimate_view(one: Estimate) -> dict[str, Any]:
    """Return a value with its standard error and unit; what is not known is None."""
    stderr = None if one.stderr is None else _finite(one.stderr)
    return {"value": _finite(one.value), "stderr": stderr, "unit": one.unit}


def _step_view(step: ResidualStep) -> dict[str, Any]:
    return {
        "added": step.added,
        "fit_rms": _finite(step.fit_rms, MM),
        "holdout_rms": _finite(step.holdout_rms, MM),
    }


def _experiment_view(one: Experiment) -> dict[str, Any]:
    return {"name": one.name, "why": one.why, "record": list(one.record), "program": one.program}


def _place_view(place: ResidualPlace) -> dict[str, Any]:
    """Return a place; the meaning of its value depends on the split, and the sentence has it in shop units."""
    return {
        "axis": place.axis,
        "by": place.by,
        "share": _finite(place.share),
        "value_si": _finite(place.value),
        "sentence": place.sentence,
    }


def _quality_view(quality: LogQuality, efforts: Mapping[str, str]) -> dict[str, Any]:
    return {
        "period": _finite(quality.period),
        "jitter": _finite(quality.jitter),
        "first": quality.first,
        "channels": [_channel_view(one, efforts) for one in quality.channels],
        "faults": list(quality.faults),
        "notes": list(quality.notes),
    }


def _channel_view(one: ChannelQuality, efforts: Mapping[str, str]) -> dict[str, Any]:
    unit, size = channel_scale(one.axis, one.channel, efforts)
    return {
        "axis": one.axis,
        "channel": one.channel,
        "unit": unit,
        "resolution": _finite(one.resolution, size),
        "noise": _finite(one.noise, size),
        "noise_from": one.noise_from,
        "missing": one.missing,
        "shift": None if one.shift is None else _finite(one.shift),
    }


def _finite(value: float, size: float = 1.0) -> float | None:
    return value / size if math.isfinite(value) else None


def diagnosis_lines(
    diagnosis: Diagnosis, efforts: Mapping[str, str] | None = None, given: Collection[str] = ()
) -> list[str]:
    """Describe the findings, their evidence, and what to do next.

    Parameters
    ----------
    diagnosis : Diagnosis
    efforts : mapping, optional
        As of :func:`diagnosis_view`.
    given : collection of str
        Options among ``-o`` and ``--next`` that were given, and are not suggested.
    """
    return [
        *verdict_sentences(diagnosis),
        *(f"fault: {fault}" for fault in diagnosis.quality.faults if diagnosis.verdict != "not-identifiable"),
        *_quality_lines(diagnosis.quality, efforts or {}),
        *_place_lines("Where machine file and log differ by more than noise, the excess:", diagnosis.places),
        *_gap_lines(diagnosis),
        *(line for found in diagnosis.findings for line in _finding_lines(found)),
        *(_place_lines("What remains:", diagnosis.remaining) if len(diagnosis.steps) > 1 else ()),
        *(f"note: {note}" for note in diagnosis.notes),
        *_next_lines(diagnosis, given),
    ]


def _quality_lines(quality: LogQuality, efforts: Mapping[str, str]) -> Iterator[str]:
    period = f"The log: a sample every {quality.period / MS:.4g} ms"
    jitter = f" (jitter up to {quality.jitter / MS:.2g} ms)" if quality.jitter > JITTER * quality.period else ""
    start = f"; the first {quality.first * quality.period:.3g} s are ignored" if quality.first else ""
    yield f"{period}{jitter}{start}"
    for one in quality.channels:
        yield f"  {_channel_words(one, efforts)}"
    for note in quality.notes:
        yield f"  {note}"


def _channel_words(one: ChannelQuality, efforts: Mapping[str, str]) -> str:
    effort = one.channel == "force"
    unit = efforts.get(one.axis, "") if effort else "µm"
    size = 1.0 if effort else MICROMETRE
    words = [f"noise {one.noise / size:.3g} {unit}".rstrip() + f" (from {one.noise_from})"]
    words += [f"steps of {one.resolution / size:.3g} {unit}".rstrip()] if one.resolution > 0.0 else []
    words += [f"{one.missing} missing"] if one.missing else []
    if one.shift is not None and one.shift != 0.0:
        words.append(f"{abs(one.shift) / MS:.3g} ms {'late' if one.shift > 0.0 else 'early'}")
    return f"{one.axis}_{one.channel}: {', '.join(words)}"


def _place_lines(title: str, places: tuple[ResidualPlace, ...]) -> list[str]:
    axes = list(dict.fromkeys(one.axis for one in places))
    lines = []
    for axis in axes:
        mine = [one for one in places if one.axis == axis and one.share >= SHARE_SHOWN]
        mine.sort(key=lambda one: -one.share)
        whose = f"{axis}: " if len(axes) > 1 else ""
        lines += [f"  {whose}{one.sentence}" for one in mine[:PLACES_SHOWN]]
    return [title, *lines] if lines else []


def _gap_lines(diagnosis: Diagnosis) -> list[str]:
    if not diagnosis.steps:
        return []
    floor = diagnosis.noise_floor
    rows = []
    for step in diagnosis.steps:
        known = floor > 0.0 and math.isfinite(step.holdout_rms)
        times = multiple(step.holdout_rms, floor) if known else NOTHING
        added = "original machine file" if step.added is None else f"+ {label_words(step.added)}"
        rows.append((added, micrometres(step.fit_rms), micrometres(step.holdout_rms), times))
    header = ("step", "fitted µm", "held out µm", "× noise floor")
    title = f"Residual between log and model, rms (noise floor {micrometres(floor)} µm):"
    return [title, *format_table(header, rows).splitlines()]


def _finding_lines(found: Finding) -> Iterator[str]:
    sure = f", {100.0 * found.confidence:.0f} % sure" if math.isfinite(found.confidence) else ""
    where = f": {found.where}" if found.where else ""
    yield f"{finding_name(found)}{where}{sure}"
    for key, one in found.parameters.items():
        doubt = "" if one.stderr is not None else " (standard error unknown)"
        yield f"  {key} = {parameter_words(key, one)}{doubt}"
    for sentence in found.evidence:
        yield f"  evidence: {sentence}"
    if found.ambiguous_with:
        rivals = ", ".join(label_words(label, found.axis) for label in found.ambiguous_with)
        yield f"  not separable from: {rivals}"


def _next_lines(diagnosis: Diagnosis, given: Collection[str]) -> Iterator[str]:
    following = diagnosis.next_experiment
    if following is not None:
        how = "" if "--next" in given else "; --next FILE writes the program"
        yield f"Next: run {following.name}: {following.why}"
        if max(map(len, following.record), default=0) > SHORT:
            yield f"  log, by these lines{how}:"
            yield from (f"    {line}" for line in following.record)
        else:
            yield f"  log {', '.join(following.record)}{how}"
    if len(diagnosis.steps) > 1 and diagnosis.verdict == "ambiguous":
        yield "The better machine file assumes the first effect of each doubtful set."
    if len(diagnosis.steps) > 1 and "-o" not in given:
        yield "-o FILE writes the better machine file, for convert and simulate."


Parameters = Mapping[str, Mapping[str, Estimate]]
"""Parameters of every axis, by name."""


def identification_view(axes: Parameters, notes: Sequence[str] = ()) -> dict[str, Any]:
    """Return the parameters as a JSON object; what is not known is None.

    Parameters
    ----------
    axes : mapping
        By axis and name.
    notes : sequence of str
        Parameters that the log could not separate, and other notes for a person.
    """
    return {
        "axes": {
            axis: {name: estimate_view(one) for name, one in parameters.items()} for axis, parameters in axes.items()
        },
        "notes": list(notes),
    }


def identification_lines(axes: Parameters, notes: Sequence[str] = ()) -> list[str]:
    """List the parameters, and how well the log shows them.

    Parameters are those of :func:`identification_view`.
    """
    rows = [(axis, name, *_cells(one)) for axis, parameters in axes.items() for name, one in parameters.items()]
    header = ("axis", "parameter", "value", "standard error", "unit")
    table = format_table(header, rows).splitlines() if rows else ["This log shows no parameter."]
    return [*table, *(f"note: {note}" for note in notes)]


_GAINS: Final = ("b", "c", "position_gain", "velocity_gain")
"""Parameters without which nobody knows how an axis moves."""


def unshown_words(axes: Parameters) -> tuple[str, ...]:
    """Name the gains that are less than their standard errors: the log does not show them, though they were fitted.

    Examples
    --------
    >>> unshown_words({"X": {"c": Estimate(value=0.01, stderr=0.3, unit="s")}})
    ('this log does not show c of X, which may be anything: a machine file has it all the same, do not compensate by \
it; record quicker and slower motion, as the programs of ph-post calibrate have',)
    """
    said = []
    for axis, parameters in axes.items():
        names = [
            name.replace("_", " ")
            for name, one in parameters.items()
            if name in _GAINS and one.stderr is not None and not one.stderr < abs(one.value)
        ]
        if names:
            said.append(
                f"this log does not show {' and '.join(names)} of {axis}, which may be anything: a machine file has"
                f" {'it' if len(names) == 1 else 'them'} all the same, do not compensate by it; record quicker and"
                " slower motion, as the programs of ph-post calibrate have"
            )
    return tuple(said)


def _cells(one: Estimate) -> tuple[str, str, str]:
    value, error = with_error(one.value, one.stderr)
    return value, "unknown" if error is None else f"± {error}", one.unit or NOTHING


def fit_view(found: Identification) -> dict[str, Any]:
    """Return the rms of the free run and the separable parameters of every axis as JSON."""
    return {
        "fit": {
            name: {"unit": "mm", "rms": drive.rms / MM, "noise_floor": drive.noise / MM}
            for name, drive in found.drives.items()
        },
        "identifiability": {name: _sensitivity_view(drive.sensitivity) for name, drive in found.drives.items()},
    }


def _sensitivity_view(sensitivity: Sensitivity) -> dict[str, Any]:
    condition = sensitivity.condition
    return {
        "parameters": list(sensitivity.names),
        "singular_values": list(sensitivity.singular_values),
        "rank": sensitivity.rank,
        "condition": condition if math.isfinite(condition) else None,
        "not_separated": [dict(direction) for direction in sensitivity.weak],
    }
