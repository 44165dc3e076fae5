"""Explain a diagnosis: places, evidence, remaining residual, notes and the next experiment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.evidence import evidence_of
from ph_post.diagnose.evidence.base import Evidence
from ph_post.diagnose.findings import AxisDiagnosis, FittedEffect
from ph_post.diagnose.fit import plant_at, residuals_of
from ph_post.diagnose.hypotheses import barred
from ph_post.diagnose.hypotheses.base import LogReason
from ph_post.diagnose.residual_features import is_structured
from ph_post.diagnose.residual_places import locate, spectral_line
from ph_post.diagnose.search import has_structure, without_part
from ph_post.diagnose.sentences import best_phrase, length
from ph_post.drive.plant import base_value
from ph_post.identify.free_run import ObservedChannel, correlation_inflation, mean_square, residuals
from ph_post.identify.linear_drive import AxisMotion, motion_of
from ph_post.testprograms.experiments import next_experiment
from ph_post.types import Array, Log, Machine
from ph_post.types.diagnosis import Channel, Experiment, Finding, LogQuality, ResidualPlace, Verdict
from ph_post.units import MM, MS

MOVED: Final = 0.5
"""Standard errors of the file by which a base value must have moved to be named."""

SURE: Final = 5.0
"""Standard errors from which a shifted origin is named."""

FIELDS: Final = {
    "b": "b",
    "c": "c",
    "gap": "the lost motion",
    "eta": "the motor's part of the inertia",
    "beta": "the motor's rate 1 / motor_time_constant_s",
}
"""Base values as a sentence names them."""


class Explanation(NamedTuple):
    """Phrases and evidence of what was found on one axis, by label."""

    where: Mapping[str, str]
    evidence: Mapping[str, tuple[str, ...]]


def explain(
    log: Log, machine: Machine, quality: LogQuality, outcomes: Sequence[AxisDiagnosis]
) -> tuple[Explanation, ...]:
    """Say where each effect shows and what speaks for it, axis by axis."""
    return tuple(_explain_axis(log, machine, quality, outcome, outcomes) for outcome in outcomes)


def _explain_axis(
    log: Log, machine: Machine, quality: LogQuality, outcome: AxisDiagnosis, outcomes: Sequence[AxisDiagnosis]
) -> Explanation:
    where: dict[str, str] = {}
    sentences: dict[str, tuple[str, ...]] = {}
    if not outcome.found:
        return Explanation(where, sentences)
    name = outcome.problem.axis.name
    motion = motion_of(log, machine, name)
    for number, found in enumerate(outcome.found):
        label, effect = found.part.hypothesis.label, found.part.hypothesis.name
        evidence = _evidence_for(log, quality, outcome, number, motion)
        too = [
            one.problem.axis.name
            for one in outcomes
            if one is not outcome and any(other.part.hypothesis.name == effect for other in one.found)
        ]
        sentences[label] = evidence_of(effect, replace(evidence, too=tuple(too)))
        where[label] = _where(log, machine, evidence, found)
    return Explanation(where, sentences)


def _evidence_for(log: Log, quality: LogQuality, outcome: AxisDiagnosis, number: int, motion: AxisMotion) -> Evidence:
    """Lay out the log without one of the parts, all else being what it is in the end."""
    problem, model, found = outcome.problem, outcome.fitted.model, outcome.found[number]
    axis = problem.axis.name
    shifts = {one.channel: one.shift for one in quality.channels if one.axis == axis and one.channel != "force"}
    return Evidence(
        problem=problem,
        motion=motion,
        before=residuals_of(problem, without_part(model, number, restored=True)),
        after=outcome.fitted.left,
        values=found.values,
        errors=found.errors,
        effort_unit=log.axes[axis].effort_unit,
        shift=shifts.get("act", shifts.get("motor")),
    )


def _where(log: Log, machine: Machine, evidence: Evidence, found: FittedEffect) -> str:
    """Say in a phrase where an effect shows: in what it adds to the readings, on its own."""
    added = evidence.residual - evidence.after[evidence.channel]
    places = locate(log, evidence.axis, added, evidence.use(), evidence.noise(evidence.channel), machine)
    return best_phrase(found.part.hypothesis.name, evidence.axis, places, evidence.values)


def locate_residuals(
    log: Log, machine: Machine, outcomes: Sequence[AxisDiagnosis], lefts: Sequence[Mapping[Channel, Array]]
) -> tuple[ResidualPlace, ...]:
    """Find where what models leave of the positions lies, the axis with most of it first.

    Parameters
    ----------
    log : Log
    machine : Machine
    outcomes : sequence of AxisDiagnosis
    lefts : sequence of mapping
        By outcome: residuals (n,) by channel [m].
    """
    found = []
    for outcome, left in zip(outcomes, lefts, strict=True):
        problem, one = outcome.problem, _position(outcome)
        use = problem.counted & one.ok
        excess = mean_square(left[one.channel], use) - one.noise**2
        name = problem.axis.name
        places = locate(log, name, left[one.channel], use, one.noise, machine)
        if not places and is_structured(left[one.channel], use, one.noise)[0]:
            places = tuple(spectral_line(name, left[one.channel], use, one.noise, log.period))
        found.append((excess, places))
    found.sort(key=lambda one: -one[0])
    return tuple(place for _, places in found for place in places)


def _position(outcome: AxisDiagnosis) -> ObservedChannel:
    """Return the position that is looked at: the table's where there is one."""
    return min(outcome.problem.positions, key=lambda one: one.channel != "act")


def diagnosis_notes(
    log: Log, outcomes: Sequence[AxisDiagnosis], remaining: Sequence[ResidualPlace], verdict: Verdict
) -> tuple[str, ...]:
    """Say what else a person should know: base values, origins, what is left, what could not show."""
    known = () if verdict == "unknown" else outcomes
    said = [sentence for one in known if one.found for sentence in _left(log, one, remaining)]
    said += [sentence for one in known for sentence in (*_moved(one), *_not_written(one))]
    said = [*map(_of_a_far_servo, (one for one in outcomes if one.choice.far is not None)), *said]
    said = [*map(_of_another_structure, (one for one in outcomes if one.early)), *said]
    shifted = [words for one in outcomes for words in _shifted(one)]
    if shifted:
        listed = ", ".join(shifted)
        said.append(f"readings with another origin than the command, which was left free: {listed}")
    return (*said, *_could_not_show(outcomes))


def _of_another_structure(outcome: AxisDiagnosis) -> str:
    """Say that a log is none of a single loop, and what helps."""
    name, c = outcome.problem.axis.name, outcome.problem.plant.c
    return (
        f"{name} answers {outcome.early / MS:.2g} ms earlier than the single loop of the file, of c = {c / MS:.3g} ms: "
        "its speed is fed forward, as in a cascade, whose numbers ph-post identify finds from this log without a file"
    )


def _of_a_far_servo(outcome: AxisDiagnosis) -> str:
    """Say that the gains of a log are far from the file's, and what helps where they are not named."""
    name, near, filed = outcome.problem.axis.name, outcome.choice.far, outcome.problem.plant
    assert near is not None
    gain, file = (base_value(one, "position_gain") for one in (near, filed))
    said = f"the servo of {name} is far from the file's: K_v is about {gain:.2g} 1/s by the log, {file:.3g} by the file"
    if outcome.choice.fitted.model.parts:
        return said
    return f"{said}; run ph-post identify on this log without a file first, and diagnose with the file that it writes"


def _moved(outcome: AxisDiagnosis) -> Iterator[str]:
    """Yield in a sentence the base values that the log puts elsewhere than the file."""
    model, said = outcome.fitted.model, []
    for k in model.free:
        prior, off = model.priors[k], model.off[k]
        if prior.least > prior.error * base_value(outcome.problem.plant, prior.field):
            if abs(off) > 1.0:
                late = prior.moved(0.0, off) / MS
                said.append(f"{prior.field.replace('_', ' ')} is {abs(late):.2g} ms {'more' if late > 0.0 else 'less'}")
        elif abs(off) >= MOVED:
            name, word = FIELDS.get(prior.field, prior.field.replace("_", " ")), "larger" if off > 0.0 else "smaller"
            file = f"{100.0 * prior.error:g} % of the file"
            far = f"within the {file}" if abs(off) <= 1.0 else f"{abs(off):.2g} times the {file}"
            said.append(f"{name} is {100.0 * prior.error * abs(off):.2g} % {word}, {far}")
    if said:
        yield f"base values of {outcome.problem.axis.name} by the log: {'; '.join(said)}"


def _not_written(outcome: AxisDiagnosis) -> Iterator[str]:
    """Yield in a sentence a backlash that is named and left out of the file, and why."""
    axis, sides = outcome.problem.axis, outcome.sides
    if sides is not None and not sides.holds(axis.limits.acceleration):
        slows, safe = (float(f"{part * sides.slows / MM:.2g}") for part in (1.0, 0.9))
        yield (
            f"the backlash of {axis.name} is not written to the machine file: the table runs on across it where the "
            f"motor brakes harder than {slows:g} mm/s², and compensation, which counts on friction, would make parts "
            f"worse; with max_acceleration_mm_s2 = {safe:g} or less, in the controller too, it would be written"
        )


def _shifted(outcome: AxisDiagnosis) -> Iterator[str]:
    """Yield readings whose origin is not that of the command, and by how much."""
    problem, model = outcome.problem, outcome.fitted.model
    if not model.origin_free:
        return
    held = residuals(problem, plant_at(problem, model), False)
    for one in problem.positions:
        use = problem.counted & one.ok
        shift = float(np.mean(held[one.channel][use]))
        left: dict[Channel, Array] = {one.channel: held[one.channel] - shift}
        worth = np.count_nonzero(use) / correlation_inflation(replace(outcome.problem, observed=(one,)), left, use)
        error = float(np.sqrt(mean_square(left[one.channel], use) / worth))
        if abs(shift) > max(SURE * error, 0.5 * one.noise):
            yield f"{problem.axis.name}_{one.channel} by {length(shift)}"


def _left(log: Log, outcome: AxisDiagnosis, remaining: Sequence[ResidualPlace]) -> Iterator[str]:
    """Say what is left after the last effect, where that is more than noise."""
    problem = outcome.problem
    if not has_structure(problem, outcome.fitted):
        return
    one = _position(outcome)
    size = float(np.sqrt(mean_square(outcome.fitted.left[one.channel], problem.counted & one.ok)))
    column = f"{problem.axis.name}_{one.channel}"
    if size > 1.2 * one.noise > 0.0:
        first = next((place for place in remaining if place.axis == problem.axis.name), None)
        where = f": {first.sentence}" if first is not None else ""
        yield f"what is left of {column}, {length(size)} rms, is {size / one.noise:.2g} times its noise{where}"
        return
    for other in problem.observed:
        size = float(np.sqrt(mean_square(outcome.fitted.left[other.channel], problem.counted & other.ok)))
        if other.channel == "force" and size > 1.2 * other.noise > 0.0:
            unit = log.axes[problem.axis.name].effort_unit
            yield (
                f"what is left of {problem.axis.name}_force, {size:.3g} {unit} rms, is "
                f"{size / other.noise:.2g} times its noise"
            )


def _could_not_show(outcomes: Sequence[AxisDiagnosis]) -> Iterator[str]:
    """Name what the log could not have shown on any axis, by reason."""
    by_axis = [barred(outcome.problem) for outcome in outcomes]
    reasons: dict[str, list[str]] = {}
    for name, why in (by_axis[0] if by_axis else {}).items():
        if all(isinstance(one.get(name), LogReason) for one in by_axis):
            reasons.setdefault(why, []).append(name)
    if reasons:
        listed = "; ".join(f"{', '.join(names).replace('_', ' ')} ({why})" for why, names in reasons.items())
        yield f"this log could not have shown: {listed}"


def propose_experiment(
    log: Log,
    machine: Machine,
    verdict: Verdict,
    findings: Sequence[Finding],
    places: Sequence[ResidualPlace] = (),
) -> Experiment | None:
    """Write what should be run next: what separates names that are as good, or excites everything.

    Parameters
    ----------
    log : Log
    machine : Machine
    verdict : Verdict
    findings : sequence of Finding
    places : sequence of ResidualPlace
        Where the residual lies: the axis of the first is the one that is moved.
    """
    doubtful = [one for one in findings if one.ambiguous_with]
    if doubtful:
        first = min(doubtful, key=lambda one: one.confidence)
        return next_experiment([first.name, *first.ambiguous_with], first.axis, log, machine)
    if verdict not in ("unknown", "not-identifiable"):
        return None
    for axis in dict.fromkeys([*(place.axis for place in places), *log.axes]):
        found = next_experiment([], axis, log, machine)
        if found is not None:
            return found
    return None
