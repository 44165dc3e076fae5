"""Findings of a fitted model: parameters in shop units, machine-file settings, and the improved axis."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.consistency import MOST, disagreement, sides_factor, sizes_of_part, spread_of
from ph_post.diagnose.fit import FittedModel, ModelPart, covariance, fit_model, plant_at
from ph_post.diagnose.hypotheses import OF_THE_AXIS
from ph_post.diagnose.hypotheses.drives import BACKLASH
from ph_post.diagnose.search import has_structure, with_noise
from ph_post.diagnose.selection import (
    TIMING,
    ModelChoice,
    PartConfidence,
    instead,
    is_short,
    rows_to_tell,
    without,
)
from ph_post.diagnose.sides import HELD, SidesGap, gap_between
from ph_post.drive.axes import backlash_varies
from ph_post.drive.effects.base import Effect, Parameter
from ph_post.drive.effects.registry import find_effect
from ph_post.drive.plant import base_value
from ph_post.identify.cascade_numbers import CASCADE_NUMBERS, NAMES, cascade_values
from ph_post.identify.estimates import KEYS, relative_uncertainty, with_keys
from ph_post.identify.free_run import AxisProblem, mean_square, predict, residuals
from ph_post.quantities import micrometres
from ph_post.types import Array, Axis, EffectSetting
from ph_post.types.diagnosis import Channel, DroppedName, Estimate, Finding
from ph_post.units import MM

MOVED: Final = 0.1
"""Standard errors by which a base value must have moved within its prior to be written."""

DERIVED: Final = {"difference": "plus"}
"""Values that follow from the others, and whose unit they have; a machine file does not hold them."""

_SHOP: Final = {
    **{name: (one.unit, one.size) for name, one in CASCADE_NUMBERS.items()},
    "lost_motion": ("mm", MM),
    "b": ("s²", 1.0),
    "c": ("s", 1.0),
}
"""Unit and its size of numbers of the axis itself."""


LEFT: Final = 2.0
"""Times the noise above which what is left at the end is looked at."""

VARYING: Final = "position_dependent_backlash"
"""Name beside which one width says nothing."""

MOST_BETWEEN: Final = 0.5
"""Part by which the size of an effect between motor and table may differ from what both readings show there."""

EXPLAINED: Final = 0.92
"""Part of the excess that names explain together, from which on each is taken to be right."""

SLOPE: Final = 2.0
"""Standard errors from which on a backlash changes along the travel."""

SEPARATE: Final = 1.0
"""Standard errors by which some number of a name differs from nothing at least, or from what the file says."""


AT_END: Final = 0.01
"""Parts of a number's scale within which it has come to its end."""

EARLY: Final = 0.2
"""Part of a single loop's c by which a log that it misses is early where its speed is fed forward."""


class FittedEffect(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A part of the final model: values [SI] by name, leading first, and their standard errors."""

    part: ModelPart
    values: Mapping[str, float]
    errors: Mapping[str, float]


class AxisDiagnosis(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The final model of one axis, fitted to all samples that count, and what was found in it.

    `early` [s] is by how much the log is earlier than the single loop of the file, where none answers so early; else 0.
    """

    choice: ModelChoice
    fitted: FittedModel
    found: tuple[FittedEffect, ...]
    dropped: tuple[DroppedName, ...] = ()
    sides: SidesGap | None = None
    early: float = 0.0
    gain: float | None
    """K as the file has it, or as the effort shows it, in the effort's unit over metres."""

    @property
    def problem(self) -> AxisProblem:
        """The axis and its log."""
        return self.choice.problem


def fit_chosen_model(choice: ModelChoice, early: float = 0.0) -> AxisDiagnosis:
    """Fit the chosen model to every sample that counts, drop what does not agree with itself, and size the rest.

    `early` [s] is by how much the log is earlier than the drive of the file.
    """
    choice, fitted = _with_even_gap(choice, fit_model(choice.problem, choice.fitted.model, choice.problem.counted))
    dropped: list[DroppedName] = []
    if not _is_fed_forward(choice.problem, fitted, early):
        early = 0.0
    elif fitted.model.parts:
        why = "a single loop is none that feeds its speed forward, whatever is added to it"
        names = dict.fromkeys(part.hypothesis.name for part in fitted.model.parts)
        dropped = [DroppedName(name=name, axis=choice.problem.axis.name, why=why) for name in names]
        choice = replace(choice, stages=choice.stages[:1], standings=())
        fitted = fit_model(choice.problem, choice.fitted.model, choice.problem.counted)
    between = gap_between(choice.problem) if _misses(choice.problem, fitted) else None
    while (
        off := _not_separate(choice, fitted) or _at_an_end(choice.problem, fitted) or _doubtful(choice, fitted, between)
    ) is not None:
        number, words = off
        name = fitted.model.parts[number].hypothesis.name
        dropped.append(DroppedName(name=name, axis=choice.problem.axis.name, why=words))
        choice = without(choice, number)
        fitted = fit_model(choice.problem, choice.fitted.model, choice.problem.counted)
    problem = with_noise(choice.problem, fitted)
    choice = replace(choice, problem=problem)
    found = _sized(problem, fitted)
    if _misses(problem, fitted):
        found = [_with_spread(problem, fitted, number, one) for number, one in enumerate(found)]
    sides, left = _between_sides(problem, fitted, between)
    if sides is not None:
        dropped = [one for one in dropped if one.name != "backlash"]  # named after all, by another size
    return AxisDiagnosis(
        choice=choice,
        fitted=replace(fitted, left=left),
        found=tuple(found),
        dropped=tuple(dropped),
        sides=sides,
        early=early,
        gain=_gain(problem, fitted),
    )


def _is_fed_forward(problem: AxisProblem, fitted: FittedModel, early: float) -> bool:
    """Return whether a log that a single loop misses is so early that its speed must be fed forward."""
    plant = problem.plant
    single = plant.loop.has_controller and plant.cascade is None
    return single and early > EARLY * plant.c and _misses(problem, fitted)


def _with_even_gap(choice: ModelChoice, fitted: FittedModel) -> tuple[ModelChoice, FittedModel]:
    """Put one width in the place of a backlash whose slope along the travel is within its error."""
    for number, one in enumerate(_sized(with_noise(choice.problem, fitted), fitted)):
        sloped = one.part.hypothesis.name == VARYING and "slope" in one.values
        if sloped and abs(one.values["slope"]) < SLOPE * one.errors["slope"]:
            even = ModelPart(hypothesis=BACKLASH, numbers=one.part.numbers[1:])
            choice = instead(choice, number, even)
            return choice, fit_model(choice.problem, choice.fitted.model, choice.problem.counted)
    return choice, fitted


def _not_separate(choice: ModelChoice, fitted: FittedModel) -> tuple[int, str] | None:
    """Return the last part whose size is not separate from nothing, and why; None where there is none.

    Of a servo none of the numbers is separate from the file's.
    """
    filed = _filed(choice.problem)
    for number, one in reversed(list(enumerate(_sized(with_noise(choice.problem, fitted), fitted)))):
        name = one.part.hypothesis.name
        nothing = filed if name in OF_THE_AXIS else {}
        if all(abs(one.values[key] - nothing.get(key, 0.0)) < SEPARATE * one.errors[key] for key in _size_keys(one)):
            said = "its numbers differ from the file's" if name == "servo_mismatch" else "its size differs from nothing"
            return number, f"{said} by less than the standard error"
    return None


def _at_an_end(problem: AxisProblem, fitted: FittedModel) -> tuple[int, str] | None:
    """Return a part one of whose numbers has come to its end, and why, where more than noise is left."""
    if not has_structure(problem, fitted):
        return None
    for number, part in enumerate(fitted.model.parts):
        for size, one in zip(part.numbers, part.hypothesis.numbers, strict=True):
            if one.ends and size > one.high - AT_END * one.scale:
                return number, f"its {one.name} has come to {one.high:g}, the most it has, and more than noise is left"
    return None


def _filed(problem: AxisProblem) -> dict[str, float]:
    """Return the numbers of an axis as the file has them [SI], by the names of a finding's values."""
    plant = problem.plant
    filed = {"lost_motion": plant.gap, "b": plant.b, "c": plant.c}
    if plant.cascade is not None:
        filed |= {name: number.of(plant.cascade) or 0.0 for name, number in CASCADE_NUMBERS.items()}
    return filed


def _misses(problem: AxisProblem, fitted: FittedModel) -> bool:
    """Return whether a model leaves much more than noise of a position."""
    return any(
        mean_square(fitted.left[one.channel], problem.counted & one.ok) > (LEFT * one.noise) ** 2
        for one in problem.positions
    )


def _between_sides(
    problem: AxisProblem, fitted: FittedModel, sides: SidesGap | None
) -> tuple[SidesGap | None, Mapping[Channel, Array]]:
    """Return the backlash that both sides show where a model misses them, and what is left with it in the model."""
    plant, names = plant_at(problem, fitted.model), {part.hypothesis.name for part in fitted.model.parts}
    if VARYING in names or not _misses(problem, fitted):
        return None, fitted.left
    # What else is missing may have bent the file's own backlash within its error.
    gaps = (plant.gap,) if "backlash" in names else (plant.gap, problem.plant.gap)
    if sides is None or any(map(sides.is_like, gaps)):
        return None, fitted.left
    with_gap = residuals(problem, replace(plant, gap=sides.width), fitted.model.origin_free)
    use = problem.counted & problem.channel("act").ok
    better = mean_square(with_gap["act"], use) < mean_square(fitted.left["act"], use)
    return sides, with_gap if better else fitted.left


def _doubtful(choice: ModelChoice, fitted: FittedModel, sides: SidesGap | None) -> tuple[int, str] | None:
    """Return the part of a model that agrees least with itself, and why, where much is left; None where none does.

    `sides` is the backlash that both sides show: it is none of a spring's, nor of an error's of a reading.
    """
    parts = fitted.model.parts
    problem, gap = choice.problem, None
    left = [one for one in _squares(choice, fitted) if one.after > LEFT**2 * one.noise]
    if not parts or not left:
        return None
    if sides is not None and not {"backlash", VARYING} & {part.hypothesis.name for part in parts}:
        gap = sides.beyond(plant_at(problem, fitted.model).gap, problem.period)
    for number in range(len(parts)):
        factor = sides_factor(problem, fitted, number, gap)
        if factor is not None and abs(factor - 1.0) > MOST_BETWEEN:
            return number, f"between motor and table the log shows {factor:.2g} times as much of it as the model"
    if all(one.after - one.noise <= (1.0 - EXPLAINED) * (one.before - one.noise) for one in left):
        return None
    found = [disagreement(problem, fitted, number) for number in range(len(parts))]
    worst = max(range(len(parts)), key=lambda number: abs(found[number].factor - 1.0))
    if abs(found[worst].factor - 1.0) <= MOST:
        return None
    return worst, f"{found[worst].regime} the log shows {found[worst].factor:.2g} times as much of it as all in all"


class Squares(NamedTuple):
    """Mean squares of a reading, or sums of some: what the file leaves, what the model leaves, and the noise."""

    before: float
    after: float
    noise: float


def _squares(choice: ModelChoice, fitted: FittedModel) -> list[Squares]:
    """Return the squares of the positions together, and those of a force where there is one."""
    problem = choice.problem
    found = []
    for some in (problem.positions, [one for one in problem.observed if one.channel == "force"]):
        squares = np.zeros(3)
        for one in some:
            use = problem.counted & one.ok
            before, after = (mean_square(left[one.channel], use) for left in (choice.stages[0].left, fitted.left))
            squares += before, after, one.noise**2
        found.append(Squares(*map(float, squares)))
    return found


def _sized(problem: AxisProblem, fitted: FittedModel) -> list[FittedEffect]:
    """Return the parts of a model with the standard errors of their values."""
    spread = covariance(problem, fitted, problem.counted)
    at, found = len(fitted.model.free), []
    for part in fitted.model.parts:
        count = len(part.numbers)
        found.append(_found(problem, part, spread[at : at + count, at : at + count]))
        at += count
    return found


def _with_spread(problem: AxisProblem, fitted: FittedModel, number: int, one: FittedEffect) -> FittedEffect:
    """Widen the error of a size, in a model that misses its log, by how it differs from regime to regime.

    A servo that is not the file's bends all of a log alike: leaving out one part of it after the other shows nothing.
    """
    spread, filed = spread_of(sizes_of_part(problem, fitted, number)), {}
    if one.part.hypothesis.name in OF_THE_AXIS:
        filed = _filed(problem)
    keys = _size_keys(one)
    wider = {key: math.hypot(one.errors[key], spread * (one.values[key] - filed.get(key, 0.0))) for key in keys}
    return replace(one, errors={**one.errors, **wider})


def _size_keys(one: FittedEffect) -> list[str]:
    """Return the names of the values that are a part's size.

    All of a servo's; of a Stribeck friction its force in motion and at rest, which may be all that it has; of others
    the leading one.
    """
    keys, name = list(one.values), one.part.hypothesis.name
    return keys if name == "servo_mismatch" else keys[: 2 if name == "stribeck_friction" else 1]


def _found(problem: AxisProblem, part: ModelPart, spread: Array) -> FittedEffect:
    """Carry the covariance of a part's numbers over to its values, by differences."""
    hypothesis = part.hypothesis
    values = hypothesis.values(problem, part.numbers)
    here = np.array(list(values.values()))
    slopes = np.empty((here.size, len(part.numbers)))
    for k, number in enumerate(hypothesis.numbers):
        step = 1e-4 * max(abs(part.numbers[k]), number.scale)
        moved = [*part.numbers[:k], part.numbers[k] + step, *part.numbers[k + 1 :]]
        there = np.array(list(hypothesis.values(problem, tuple(moved)).values()))
        slopes[:, k] = (there - here) / step
    errors = np.sqrt(np.maximum(np.diag(slopes @ spread @ slopes.T), 0.0))
    return FittedEffect(part=part, values=values, errors=dict(zip(values, map(float, errors), strict=True)))


def _gain(problem: AxisProblem, fitted: FittedModel) -> float | None:
    if not problem.has("force"):
        return None
    if problem.axis.servo.stiffness is not None and problem.effort_unit == "N":
        return problem.axis.servo.stiffness
    columns = predict(problem, plant_at(problem, fitted.model))["force"]
    effort = problem.channel("force")
    use = problem.counted & effort.ok
    return float(np.linalg.lstsq(columns[use], effort.values[use], rcond=None)[0][0])


def findings_of(
    outcome: AxisDiagnosis, where: Mapping[str, str], evidence: Mapping[str, tuple[str, ...]]
) -> tuple[Finding, ...]:
    """Put what was found on one axis into findings; `where` and `evidence` are by label."""
    problem = outcome.problem
    findings = []
    for number, (found, standing) in enumerate(zip(outcome.found, outcome.choice.standings, strict=True)):
        label = found.part.hypothesis.label
        keys = _own_keys(found) | (_prior_keys(outcome) if number == 0 else {})
        findings.append(
            Finding(
                name=found.part.hypothesis.name,
                axis=problem.axis.name,
                parameters=_estimates(outcome, found),
                where=where.get(label, ""),
                evidence=(
                    *evidence.get(label, ()),
                    *_too_short(problem, found.part, standing),
                    *_other_kinds(problem, standing.kinds),
                ),
                confidence=min(standing.confidence, 0.999),
                ambiguous_with=standing.rivals,
                setting=_setting(outcome, found),
                keys=keys,
            )
        )
    if outcome.sides is not None:
        keys = {key: value for one in findings if one.name == "backlash" for key, value in one.keys.items()}
        findings = [one for one in findings if one.name != "backlash"]
        findings.append(_sides_finding(problem, outcome.sides, keys))
    return tuple(findings)


def _too_short(problem: AxisProblem, part: ModelPart, standing: PartConfidence) -> Iterator[str]:
    """Yield that a delay or a filter is too short for the rows of a log to tell which it is, and how many would."""
    if is_short(problem, part) and not TIMING.isdisjoint(standing.rivals):
        rows, needed = round(1.0 / problem.period), float(f"{1.1 * rows_to_tell(part):.2g}")
        yield (
            f"{rows:,} rows a second do not tell a filter and a delay apart that are so short, whatever the drive does"
            f" between them: {needed:,.0f} would"
        )


def _other_kinds(problem: AxisProblem, kinds: Sequence[ModelPart]) -> Iterator[str]:
    """Yield parts of the same name, of numbers of the axis itself, that explain the log as well."""
    for part in kinds:
        if part.hypothesis.name in OF_THE_AXIS:
            for gives, value in part.hypothesis.values(problem, part.numbers).items():
                unit, size = _SHOP[gives]
                yield f"{gives.replace('_', ' ')} = {value / size:.2g} {unit} in its place explains the log as well"


def _sides_finding(problem: AxisProblem, sides: SidesGap, others: Mapping[str, float]) -> Finding:
    """Put a backlash that both sides show into a finding; `others` are keys that go with it.

    No file says that a table runs on, and offsets are wrong where it does: the backlash is named, and not written.
    """
    name = problem.axis.name
    explains = f"{micrometres(sides.before)} µm rms of their difference without it, {micrometres(sides.after)} with it"
    evidence: tuple[str, ...] = (
        f"both sides show it without a model of the servo: {explains}",
        "the model of the servo misses this log, so that its size is from the two readings alone",
    )
    if sides.slows < HELD:
        harder = f"where the motor brakes harder than {float(f'{sides.slows / MM:.2g}'):g} mm/s²"
        evidence += (f"{harder} friction does not hold the table: it runs on to the other side of its backlash",)
    key = KEYS["lost_motion"]
    keys = {one: value for one, value in others.items() if one != key}
    if sides.holds(problem.axis.limits.acceleration):
        keys[key] = float(f"{sides.width / MM:.7g}")
    return Finding(
        name="backlash",
        axis=name,
        parameters={"lost_motion": Estimate(value=sides.width / MM, stderr=sides.error / MM, unit="mm")},
        where=f"in {name}_motor less {name}_act, whatever the servo does",
        evidence=evidence,
        confidence=0.99,
        keys=keys,
    )


def _ways(effect: Effect, gives: str, axis: Axis) -> tuple[Parameter, float | None]:
    """Return the key that a value is written under, the first whose unit the axis knows, and its size."""
    for parameter in effect.ways()[DERIVED.get(gives, gives)]:
        if parameter.unit is None:
            return parameter, None
        scale = parameter.unit.scale(axis)
        if scale is not None:
            return parameter, scale
    raise AssertionError(gives)


def _is_force(effect: Effect, gives: str) -> bool:
    ways = effect.ways()[DERIVED.get(gives, gives)]
    return any(one.unit is not None and one.unit.symbol == "N" for one in ways)


def _estimates(outcome: AxisDiagnosis, found: FittedEffect) -> dict[str, Estimate]:
    """Return values in the units of the shop; a force in that of the effort where one was recorded."""
    name, axis = found.part.hypothesis.name, outcome.problem.axis
    estimates: dict[str, Estimate] = {}
    for gives, value in found.values.items():
        error = found.errors[gives]
        if name in OF_THE_AXIS:
            unit, size = _SHOP[gives]
        else:
            effect = find_effect(name)
            if outcome.gain is not None and _is_force(effect, gives):
                unit, size = outcome.problem.effort_unit, 1.0 / outcome.gain
            else:
                parameter, scale = _ways(effect, gives, axis)
                if scale is None or parameter.unit is None:
                    continue
                unit, size = parameter.unit.symbol or "1", scale
        stderr = error / size if math.isfinite(error) else None
        estimates[gives] = Estimate(value=value / size, stderr=stderr, unit=unit)
    return _leading_first(outcome, name, estimates)


def _leading_first(outcome: AxisDiagnosis, name: str, estimates: dict[str, Estimate]) -> dict[str, Estimate]:
    """Of a servo's numbers put the one first that is known best to be off; others are in order already."""
    if name != "servo_mismatch":
        return estimates
    cascade = outcome.problem.plant.cascade
    filed = {} if cascade is None else cascade_values(cascade)

    def doubt(one: tuple[str, Estimate]) -> float:
        key, found = one
        return (found.stderr or 0.0) / max(abs(found.value - filed.get(key, 0.0)), 1e-300)

    return dict(sorted(estimates.items(), key=doubt))


def _setting(outcome: AxisDiagnosis, found: FittedEffect) -> EffectSetting | None:
    """Return the effect as the machine file has it."""
    name, axis = found.part.hypothesis.name, outcome.problem.axis
    if name in OF_THE_AXIS:
        return None
    effect = find_effect(name)
    parameters: dict[str, Any] = {}
    for gives, value in found.values.items():
        if gives in DERIVED:
            continue
        parameter, scale = _ways(effect, gives, axis)
        if scale is None:
            parameters[parameter.name] = parameter.choices[int(value)]
        else:
            parameters[parameter.name] = float(f"{value / scale:.7g}")
    return EffectSetting(name=name, parameters=parameters)


def _own_keys(found: FittedEffect) -> dict[str, float]:
    if found.part.hypothesis.name not in OF_THE_AXIS:
        return {}
    return {KEYS[gives]: float(f"{value / _SHOP[gives][1]:.7g}") for gives, value in found.values.items()}


def _prior_keys(outcome: AxisDiagnosis) -> dict[str, float]:
    """Return the base values that moved within their priors: the effect was sized with them."""
    model, axis = outcome.fitted.model, outcome.problem.axis
    keys: dict[str, float] = {}
    for k in model.free:
        prior = model.priors[k]
        factor = 1.0 + prior.error * model.off[k]
        may_be_none = prior.least > prior.error * base_value(outcome.problem.plant, prior.field)
        if abs(model.off[k]) < (1.0 if may_be_none else MOVED):
            continue
        if prior.field in ("b", "c") and axis.servo.cascade is None:
            keys[prior.field] = float(f"{getattr(axis.servo, prior.field) * factor:.7g}")
        elif prior.field in NAMES and axis.servo.cascade is not None:
            name = NAMES[prior.field]
            value = max(prior.moved(getattr(axis.servo.cascade, prior.field), model.off[k]), 0.0)
            moved = CASCADE_NUMBERS[name].of(replace(axis.servo.cascade, **{prior.field: value}))
            if moved is not None:
                keys[KEYS[name]] = float(f"{moved / CASCADE_NUMBERS[name].size:.7g}")
        elif prior.field == "gap":
            keys["lost_motion_mm"] = float(f"{axis.gap.lost_motion * factor / MM:.7g}")
        elif prior.field == "eta" and axis.gap.inertia_fraction is not None:
            keys["inertia_fraction"] = float(f"{axis.gap.inertia_fraction * factor:.7g}")
        elif prior.field == "beta" and axis.gap.beta:
            keys["motor_time_constant_s"] = float(f"{1.0 / (axis.gap.beta * factor):.7g}")
    return keys


DRY_FRICTION: Final = ("coulomb_friction", "stribeck_friction")
"""Effects whose force is the friction that turns round with the motion."""


def improved_axis(axis: Axis, findings: tuple[Finding, ...]) -> Axis:
    """Return an axis with what was found in it."""
    for one in findings:
        axis = with_keys(axis, one.keys)
        if one.setting is not None:
            axis = replace(axis, effects=(*axis.effects, one.setting))
            if backlash_varies(replace(axis, gravity_side=None)):
                axis = replace(axis, gravity_side=None)  # what widens opens
        if one.name == "backlash" and KEYS["lost_motion"] in one.keys:
            surer = relative_uncertainty(one.parameters["lost_motion"])
            if surer is not None:
                axis = replace(axis, uncertainty=replace(axis.uncertainty, backlash=surer))
        if one.name in DRY_FRICTION:
            surer = relative_uncertainty(one.parameters.get("force"))
            if surer is not None:
                axis = replace(axis, uncertainty=replace(axis.uncertainty, friction=surer))
    return axis
