"""Select the effects missing from one axis: forward selection, backward check, and exchange of each part.

A hypothesis is judged by samples that it was not fitted to. Its score is its gain there in nats, counted by
independent samples, less a price for each of its numbers.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.consistency import MOST as MOST_UNLIKE
from ph_post.diagnose.consistency import disagreement
from ph_post.diagnose.fit import (
    FittedModel,
    Model,
    ModelPart,
    base_model,
    fit_model,
    log_likelihood,
    plant_at,
    residuals_of,
)
from ph_post.diagnose.hypotheses import hypotheses
from ph_post.diagnose.hypotheses.base import Hypothesis, Numbers
from ph_post.diagnose.hypotheses.drives import BACKLASH, FILTERS, far_servo, numbers_to
from ph_post.diagnose.hypotheses.forces import (
    CUTTING_BY_FEED,
    CUTTING_NEARLY_VISCOUS,
    NEARLY_BY_SPEED,
    REFERENCE_FEED,
    STRIBECK,
)
from ph_post.diagnose.hypotheses.readings import LATE_COMMAND
from ph_post.diagnose.search import (
    BENT,
    FLOOR,
    PRICE,
    HypothesisSearch,
    ScoredHypothesis,
    at_file,
    at_floor,
    does_enough,
    explains,
    gain_over,
    has_structure,
    rank,
    score_over,
    shows,
    with_noise,
    with_part,
    without_part,
)
from ph_post.diagnose.sides import gap_between
from ph_post.drive.plant import Plant, base_value
from ph_post.identify.between import courses_between
from ph_post.identify.cascade_fit import roughly_fitted
from ph_post.identify.drive_fit import position_rms
from ph_post.identify.free_run import AxisProblem, correlation_inflation, residuals, split_evenly, with_known_side
from ph_post.progress import Progress

EARNS: Final = 8.0
"""Nats above that from which an effect is believed."""

EQUAL: Final = 5.0
"""Nats within which two hypotheses explain a log equally."""

CLOSE: Final = 2e-4
"""Part of a score within which two are equal as well. Where both explain a path all but exactly it has tens of
thousands of nats, some of which go with the file's numbers, fitted within their priors, and with the command's course
between rows."""

BLUR: Final = 0.15
"""Part of a score within which two are equal, for models that leave more than noise."""

LOYAL: Final = 0.4
"""Part of a score that a special case may lack and still be taken, for models that leave more than noise."""

TIMING: Final = frozenset(("transport_delay", "command_filter"))
"""Names that make a command late."""

LATE: Final = {"moving_average": 0.5}
"""By how much of its length a filter makes a command late, where that is not all of it."""

TOLD: Final = 0.5
"""Square of rows by which a filter smears a command that is told from a delay by most logs: three times what straight
lines between rows do (1/6), as nobody knows what a drive does there."""

TOLD_LAID: Final = 4.0 / 3.0
"""The same that it has to where rows are farther apart than those of a drive, and the command is laid between them."""

NEAR_ROWS: Final = 4.0 * TOLD
"""The same from which on it does not matter what a drive does between its rows."""

LEAST_LATE: Final = 0.1
"""Rows by which a filter makes a command late at least that a fit is begun from."""

MISSED: Final = 10.0
"""Times the noise that a file leaves whose servo may be far off."""

FAR: Final = math.log(2.0)
"""Most change of K_v or ω_v, as a logarithm, that is left to the search for names."""

NEARER: Final = 0.2
"""Part of what the file's servo leaves that another one leaves at most in whose place it stands."""

NEAR_END: Final = 0.1
"""Parts of a number's scale within which it has come to its end."""

MOST: Final = 4
"""Effects that are looked for on one axis."""


class PartConfidence(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Standing of a part of a model among the other names that could take its place.

    `rivals` explain the log as well; `confidence` is the part's weight among all that were tried, nothing
    included; `better` is the fit with another name in its place, where that is better; `kinds` are parts of the
    same name, as the other filter of a command, that explain it as well.
    """

    rivals: tuple[str, ...]
    confidence: float
    kinds: tuple[ModelPart, ...] = ()
    better: FittedModel | None = None


class ModelChoice(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Model that was chosen for one axis.

    `stages` are the fits after nothing, one, two, … effects, the first at the file's values refitted within
    their priors; `standings` has one entry a part. `far` is a plant near the log where the servo of
    the file is far from it: that is the first part, or where no model left noise alone, there is none.
    """

    problem: AxisProblem
    stages: tuple[FittedModel, ...]
    standings: tuple[PartConfidence, ...]
    far: Plant | None = None

    @property
    def fitted(self) -> FittedModel:
        """The last stage."""
        return self.stages[-1]


def choose(problem: AxisProblem, progress: Progress) -> ModelChoice:
    """Find what is missing from one axis."""
    problem = with_known_side(problem)
    found = _as_told_between_rows(_choose_there(problem, progress))
    if problem.side != "unknown" or not problem.has("act") or not found.fitted.model.parts:
        return found
    # The side was decided without what is missing: a long filter hides a backlash from it, and then needs it as a name.
    other = _as_told_between_rows(_choose_there(replace(problem, at_motor=not problem.at_motor), progress))
    return _leaner(found, other)


def _leaner(found: ModelChoice, other: ModelChoice) -> ModelChoice:
    """Return another choice where noise alone is left and a first leaves more, or needs more names for it."""
    return max(found, other, key=_leanness)


def _leanness(choice: ModelChoice) -> tuple[bool, bool, int]:
    """Return whether a choice leaves noise alone, whether of the positions, and by how few names the whole."""
    settled = _settled(choice)
    return settled, at_floor(choice.problem, choice.fitted), -len(choice.fitted.model.parts) if settled else 0


def _choose_there(problem: AxisProblem, progress: Progress) -> ModelChoice:
    """Find what is missing where it is decided on which side a position was read."""
    base = _base(problem)
    again = split_evenly(problem, base.left)
    if not np.array_equal(again.fit, problem.fit):
        problem, base = again, _base(again)
    nearer = _nearer_servo(problem, base, progress)
    far = None if nearer is None else _from_nearer(problem, base, nearer, progress)
    if far is not None and _settled(far):
        return far
    found = _beside_file(problem, base, progress)
    # What no name explains, beside the file's servo or another, is a matter of that servo first.
    return found if far is None or _settled(found) else far


def _beside_file(problem: AxisProblem, base: FittedModel, progress: Progress) -> ModelChoice:
    """Search beside the servo of the file."""
    found = _with_seen_gap(problem, base, progress) or _choose_from(problem, base, progress)
    if base.model.origin_free or (_settled(found) and len(found.fitted.model.parts) < 2):
        return found
    # The origin was held because a load would explain its shift: that was wrong if a free one needs less.
    return _leaner(found, _choose_from(problem, fit_model(problem, base_model(problem), problem.fit), progress))


def _nearer_servo(problem: AxisProblem, base: FittedModel, progress: Progress) -> Numbers | None:
    """Return the numbers of a servo far from the file's that leaves a small part of what the file's does.

    Beside the file's every name would be tried for minutes, and none would explain the log. None where the file's
    gains are not far off, or the log is not fitted that much better by others.
    """
    off = position_rms(problem, base.left, problem.held)
    if problem.plant.cascade is None or off < MISSED * problem.noise_floor:
        return None
    progress(f"axis {problem.axis.name}: looking whether another servo is nearer")
    sides = gap_between(problem)
    rough = roughly_fitted(problem, problem.plant.gap if sides is None else sides.width, off)
    if rough is None:
        return None
    far = max(
        abs(math.log(base_value(rough, name) / base_value(problem.plant, name)))
        for name in ("position_gain", "velocity_gain")
    )
    left = position_rms(problem, residuals(problem, rough), problem.held)
    known = problem if sides is None else replace(problem, plant=replace(problem.plant, gap=sides.width))
    # A filter, of one number, that leaves noise alone is no worse than a servo of five that leaves a little less.
    if far < FAR or left > NEARER * off or _left_by_filters(known, base) < max(left, FLOOR * problem.noise_floor):
        return None
    return numbers_to(problem, rough)


def _left_by_filters(problem: AxisProblem, base: FittedModel) -> float:
    """Return the least that a filter of the command beside the file's servo leaves of the positions [m].

    A long one looks like a slow servo from afar.
    """
    least = math.inf
    for one in FILTERS:
        tried = [with_part(at_file(base.model), one, start) for start in one.starts(problem, base.left)]
        lefts = [position_rms(problem, residuals_of(problem, model), problem.fit) for model in tried]
        fitted = fit_model(problem, tried[int(np.argmin(lefts))], problem.fit, rounds=1)
        least = min(least, position_rms(problem, fitted.left, problem.held))
    return least


def _from_nearer(problem: AxisProblem, base: FittedModel, numbers: Numbers, progress: Progress) -> ModelChoice:
    """Search beside another servo than the file's, and name that servo with what is found.

    Where more than noise is left beside it, nothing is named.
    """
    servo = far_servo(problem)
    known = replace(problem, plant=servo.apply(problem.plant, numbers))
    found = _base(known)
    seen = _with_seen_gap(known, found, progress) or _choose_from(known, found, progress)
    fitted, of_servo = seen.fitted.model, {*servo.replaces}
    rest = tuple(one for one in fitted.parts if one.hypothesis.name != servo.name)
    gains = tuple(one for one in fitted.parts if one.hypothesis.name == servo.name)
    nearest = plant_at(known, replace(fitted, parts=gains))
    off = {prior.field: x for prior, x in zip(fitted.priors, fitted.off, strict=True) if prior.field not in of_servo}
    model = replace(
        base.model,
        off=tuple(off.get(prior.field, 0.0) for prior in base.model.priors),
        parts=(ModelPart(hypothesis=servo, numbers=numbers_to(problem, nearest)), *rest),
        origin_free=fitted.origin_free,
    )
    problem = with_noise(problem, seen.fitted)
    stages = _restage(problem, fit_model(problem, model, problem.fit), base)
    standings = tuple(
        one for one, part in zip(seen.standings, fitted.parts, strict=True) if part.hypothesis.name != servo.name
    )
    sure = PartConfidence(rivals=(), confidence=1.0)
    choice = ModelChoice(problem=problem, stages=tuple(stages), standings=(sure, *standings), far=nearest)
    return choice if _settled(choice) else replace(choice, stages=choice.stages[:1], standings=())


def _with_seen_gap(problem: AxisProblem, base: FittedModel, progress: Progress) -> ModelChoice | None:
    """Search beside the backlash that both sides show, where the file's values leave more than noise.

    Friction inside a loop shows only beside the right backlash, and that only beside the friction: where each of them
    alone explains little, none would be added. None where the sides show no other backlash than the file's, where
    its size does not stand, or where more than noise is left beside it: then nothing is taken for granted.
    """
    sides = gap_between(problem) if has_structure(problem, base) else None
    if sides is None or sides.is_like(problem.plant.gap):
        return None
    known = replace(problem, plant=replace(problem.plant, gap=sides.width))
    plausible: set[str] = set()
    seen = _choose_from(known, _base(known), progress, plausible)
    parts = seen.fitted.model.parts
    if not _settled(seen) or any("gap" in one.hypothesis.replaces for one in parts):
        return None
    gap = ModelPart(hypothesis=BACKLASH, numbers=(sides.width - problem.plant.gap,))
    off = {prior.field: x for prior, x in zip(seen.fitted.model.priors, seen.fitted.model.off, strict=True)}
    priors = tuple(off[prior.field] for prior in base.model.priors)
    origin_free = seen.fitted.model.origin_free
    model = replace(base.model, off=priors, parts=(gap, *parts), origin_free=origin_free)
    problem = with_noise(problem, base)
    plausible |= {one.label for one in hypotheses(problem) if BACKLASH.name in one.within}
    search = HypothesisSearch(problem, plausible)
    stages = _restage(problem, fit_model(problem, model, problem.fit), base)
    stages, standings = _exchange(search, stages)
    found = ModelChoice(problem=problem, stages=tuple(stages), standings=standings)
    return found if _settled(found) else None


def without(choice: ModelChoice, number: int) -> ModelChoice:
    """Return a choice with a part less, its parts added one after the other anew."""
    standings = choice.standings[:number] + choice.standings[number + 1 :]
    return _anew(choice, without_part(choice.fitted.model, number, restored=True), standings)


def instead(choice: ModelChoice, number: int, part: ModelPart) -> ModelChoice:
    """Return a choice with a special case of a part in its place."""
    parts, standings = list(choice.fitted.model.parts), list(choice.standings)
    parts[number], was = part, standings[number]
    rivals = tuple(name for name in was.rivals if name != part.hypothesis.name)
    standings[number] = PartConfidence(rivals=rivals, confidence=was.confidence)
    return _anew(choice, replace(choice.fitted.model, parts=tuple(parts)), tuple(standings))


def _anew(choice: ModelChoice, model: Model, standings: tuple[PartConfidence, ...]) -> ModelChoice:
    """Return a choice of another model, whose parts are added one after the other anew."""
    last = fit_model(choice.problem, model, choice.problem.fit)
    return replace(choice, stages=tuple(_restage(choice.problem, last, choice.stages[0])), standings=standings)


def _settled(choice: ModelChoice) -> bool:
    """Return whether a choice leaves no more than noise of any channel."""
    return at_floor(choice.problem, choice.fitted) and not has_structure(choice.problem, choice.fitted)


def _choose_from(
    problem: AxisProblem, base: FittedModel, progress: Progress, plausible: set[str] | None = None
) -> ModelChoice:
    """Add one effect after the other to the file's values, as long as each earns its place.

    `plausible` takes the labels of those that come near one that is added.
    """
    name = problem.axis.name
    problem = with_noise(problem, base)
    search = HypothesisSearch(problem, plausible)
    stages = [base]
    for _ in range(2 * MOST):
        if len(stages) > MOST or not _wants_a_name(problem, stages):
            break
        progress(f"axis {name}: looking for {'a first' if len(stages) == 1 else 'another'} effect")
        worthy = [
            one
            for one in search.ranked(stages[-1])
            if one.score > EARNS
            and (explains(problem, stages[-1], one.fitted) or _stands(problem, stages[-1], one.fitted))
            and does_enough(problem, one.fitted)
            and not _refines(problem, stages[-1].model, one)
        ]
        if not worthy:
            break
        best = _simplest(problem, worthy)
        stages = _settle(search, [*stages, best.fitted])
    progress(f"axis {name}: comparing names")
    stages, standings = _exchange(search, stages)
    return ModelChoice(problem=problem, stages=tuple(stages), standings=standings)


def _wants_a_name(problem: AxisProblem, stages: Sequence[FittedModel]) -> bool:
    """Return whether more than noise is left; without a name also if a little is, or base values gave way."""
    if stages[1:]:
        return has_structure(problem, stages[-1])
    bent = max(map(abs, stages[0].model.off), default=0.0) > BENT
    return bent or has_structure(problem, stages[0], 0.0)


def _stands(problem: AxisProblem, before: FittedModel, after: FittedModel) -> bool:
    """Return whether a name that explains less than half of what others leave has one size in every regime.

    What only resembles what is missing has another size in slow motion than in quick.
    """
    if not before.model.parts or not shows(problem, before, after):
        return False
    whole = fit_model(problem, after.model, problem.counted)
    return abs(disagreement(problem, whole, len(whole.model.parts) - 1).factor - 1.0) <= MOST_UNLIKE


def _margin(problem: AxisProblem, fitted: FittedModel, score: float) -> float:
    """Nats within which others are as good: more where the model leaves more than noise."""
    return max(EQUAL, (CLOSE if at_floor(problem, fitted) else BLUR) * score)


def _refines(problem: AxisProblem, model: Model, one: ScoredHypothesis) -> bool:
    """Return whether a name would refine one that is there, in a model that leaves more than noise anyway."""
    there = {part.hypothesis.name for part in model.parts}
    return bool(there & set(one.hypothesis.within)) and not at_floor(problem, one.fitted)


def _simplest(problem: AxisProblem, worthy: Sequence[ScoredHypothesis]) -> ScoredHypothesis:
    """Return the best, or in its stead a special case of it that is as good."""
    best = worthy[0]
    margin = EQUAL if at_floor(problem, best.fitted) else max(EQUAL, LOYAL * best.score)
    special = (one for one in worthy if one is not best and one.hypothesis.name in best.hypothesis.within)
    return next((one for one in special if one.score > best.score - margin), best)


def _base(problem: AxisProblem) -> FittedModel:
    """Fit the file's values within their priors, and say whether the origin of the readings is the file's.

    A load shifts the positions and the effort, an origin the positions alone: if a load explains the shift as
    well, or there is none, the origin is held from then on.
    """
    model = base_model(problem)
    free = fit_model(problem, model, problem.fit)
    load = next((one for one in hypotheses(problem) if one.name == "load_offset"), None)
    if load is None or not problem.has("force"):
        return free
    held = replace(free.model, origin_free=False)
    start = with_part(held, load, (0.0,))
    loaded = fit_model(problem, start, problem.fit)
    if gain_over(problem, free, loaded) < -EQUAL * correlation_inflation(problem, free.left, problem.held):
        return free
    return fit_model(problem, held, problem.fit)


def _settle(search: HypothesisSearch, stages: list[FittedModel]) -> list[FittedModel]:
    """Take out what is no longer needed.

    Beside others that holds for the last part, too: it may have done no more than to lead the fit to better numbers of
    theirs, which are as good without it.
    """
    problem, last = search.problem, stages[-1]
    for number in range(len(last.model.parts) if stages[2:] else 0):
        less = search.without(last, number)
        needed = explains(problem, less, last) or not at_floor(problem, last)
        if score_over(problem, less, last) <= 0.0 or not needed:
            return _restage(problem, less, stages[0])
    return stages


def _restage(problem: AxisProblem, last: FittedModel, base: FittedModel) -> list[FittedModel]:
    """Make the stages up to a model: its parts one after the other, in their order."""
    stages = [base]
    for count in range(1, len(last.model.parts) + 1):
        model = replace(last.model, parts=last.model.parts[:count])
        fitted = last if count == len(last.model.parts) else fit_model(problem, model, problem.fit)
        stages.append(fitted)
    return stages


def _exchange(
    search: HypothesisSearch, stages: list[FittedModel]
) -> tuple[list[FittedModel], tuple[PartConfidence, ...]]:
    """Try every other name in the place of each part, and keep what is better; list what is as good."""
    problem = search.problem
    standings: list[PartConfidence] = []
    for _ in range(3):
        last = stages[-1]
        standings = [_stand(search, stages, number) for number in range(len(last.model.parts))]
        better = next((one.better for one in standings if one.better is not None), None)
        if better is None:
            break
        stages = _settle(search, _restage(problem, better, stages[0]))
    else:
        standings = [_stand(search, stages, number) for number in range(len(stages[-1].model.parts))]
    return stages, tuple(standings)


def _stand(search: HypothesisSearch, stages: list[FittedModel], number: int) -> PartConfidence:
    """Hold one part of the last model against every other name."""
    problem, last = search.problem, stages[-1]
    part = last.model.parts[number]
    alone = len(last.model.parts) == 1
    less = stages[0] if alone else search.without(last, number)
    others = [
        one
        for one in search.tried(less, every=alone)
        if explains(problem, less, one[1]) and not (alone and one[0].label == part.hypothesis.label)
    ]
    others += [one for one in _as_late(problem, last, number) if explains(problem, less, one[1])]
    others += _as_stribeck(problem, last, number)
    cutting = _as_cutting(problem, last, number)
    others += [one for one in cutting if one[0] is CUTTING_BY_FEED]
    ranking = rank(problem, less, [(part.hypothesis, last), *others])
    mine = next(one.score for one in ranking if one.fitted is last)
    best = _simplest(problem, ranking)
    equal = _equals(problem, last, part, mine, ranking)
    scores = [
        one.score
        for one in ranking
        if one.hypothesis.label != part.hypothesis.label and part.hypothesis.name not in one.hypothesis.within
    ]
    margin = _margin(problem, last, mine)
    nearly = next((fitted for one, fitted in cutting if one is CUTTING_NEARLY_VISCOUS), None)
    if nearly is not None and gain_over(problem, last, nearly) > -margin * correlation_inflation(
        problem, last.left, problem.held
    ):
        equal = tuple(dict.fromkeys((*equal, CUTTING_NEARLY_VISCOUS.name)))
    if _is_like_a_delay(part) and any(
        one.hypothesis.label == LATE_COMMAND.label and not has_structure(problem, one.fitted) for one in ranking
    ):
        equal = tuple(dict.fromkeys((*equal, LATE_COMMAND.name)))
    if part.hypothesis.name in TIMING and _lateness(part) < LEAST_LATE * problem.period / problem.parts:
        # So little may be what a drive does between its rows, beside whatever else explains the log.
        quiet = [one.hypothesis for one in ranking if not has_structure(problem, one.fitted)]
        equal = tuple(dict.fromkeys((*equal, *(one.name for one in quiet if one.name != part.hypothesis.name))))
    kinds = [
        one.fitted.model.parts[-1]
        for one in ranking
        if one.hypothesis.name == part.hypothesis.name not in one.hypothesis.within
        and one.hypothesis.label != part.hypothesis.label
        and one.score > mine - margin
    ]
    weights = [np.exp(min(score - mine, 50.0)) for score in (mine, 0.0, *scores)]
    return PartConfidence(
        rivals=equal,
        confidence=float(1.0 / np.sum(weights)),
        better=best.fitted if best.score > mine + max(PRICE, 0.5 * margin) else None,
        kinds=tuple(kinds),
    )


def _is_like_a_delay(part: ModelPart) -> bool:
    """Whether a part is a force that goes about by the commanded speed: what it takes is what a late command takes.

    What is left between both goes with b and with the command's course between rows.
    """
    return part.hypothesis.label == CUTTING_BY_FEED.label and part.numbers[1] > NEARLY_BY_SPEED


def _as_late(problem: AxisProblem, last: FittedModel, number: int) -> list[tuple[Hypothesis, FittedModel]]:
    """Fit in the place of a delay or a filter the others of them from a length that is as late.

    From the few lengths that all are begun from, a fit may end beside the best where the table hunts in its backlash.
    """
    part = last.model.parts[number]
    if part.hypothesis.name not in TIMING:
        return []
    late = _lateness(part)
    less = without_part(last.model, number)
    found = []
    for one in hypotheses(problem):
        if one.name not in TIMING or one.label == part.hypothesis.label:
            continue
        tried = [with_part(base, one, (late / LATE.get(one.variant, 1.0),)) for base in (less, at_file(less))]
        start = min(tried, key=lambda model: position_rms(problem, residuals_of(problem, model), problem.fit))
        found.append((one, fit_model(problem, start, problem.fit)))
    return found


def _as_stribeck(problem: AxisProblem, last: FittedModel, number: int) -> list[tuple[Hypothesis, FittedModel]]:
    """Fit Stribeck friction in the place of a Coulomb friction that leaves no structure.

    There the search has not tried what contains it; it may leave less all the same. One whose speed has come to its end
    is no friction at rest: it makes up for a little of anything.
    """
    part = last.model.parts[number]
    if part.hypothesis.name not in STRIBECK.within or STRIBECK.bars(problem) or has_structure(problem, last):
        return []
    less = without_part(last.model, number)
    tried = [with_part(less, STRIBECK, (part.numbers[0], *more)) for _, *more in STRIBECK.starts(problem, last.left)]
    start = min(tried, key=lambda model: position_rms(problem, residuals_of(problem, model), problem.fit))
    fitted, speed = fit_model(problem, start, problem.fit), STRIBECK.numbers[-1]
    ended = fitted.model.parts[-1].numbers[-1] > speed.high - NEAR_END * speed.scale
    return [] if ended else [(STRIBECK, fitted)]


def _as_cutting(problem: AxisProblem, last: FittedModel, number: int) -> list[tuple[Hypothesis, FittedModel]]:
    """Fit in the place of a viscous friction the cutting forces that come near it, from one as large.

    Where the friction leaves no structure, the search has not tried what contains it.
    """
    part = last.model.parts[number]
    there = {one.hypothesis.name for one in last.model.parts}
    if part.hypothesis.name != "viscous_friction" or CUTTING_BY_FEED.name in there or CUTTING_BY_FEED.bars(problem):
        return []
    less, force = without_part(last.model, number), part.numbers[0] * REFERENCE_FEED
    starts = ((CUTTING_BY_FEED, (force, NEARLY_BY_SPEED)), (CUTTING_NEARLY_VISCOUS, (force,)))
    return [(one, fit_model(problem, with_part(less, one, numbers), problem.fit)) for one, numbers in starts]


def _smear(part: ModelPart) -> float:
    """Return the variance of the impulse response by which a filter differs from a delay [s²].

    T² of an exponential one, T²/12 of a moving average. A delay could be a moving average of twice its length, of whose
    variance, a third of the delay's square, the loop's gains may take up half.
    """
    square = part.numbers[0] ** 2
    return {"moving_average": square / 12.0, "exponential_filter": square}.get(part.hypothesis.variant, square / 6.0)


def _as_told_between_rows(choice: ModelChoice) -> ModelChoice:
    """Hold a short delay or filter against the others, each with what suits it best between the rows of the command.

    Lines, a smooth curve and steps smear a command as a filter of a row or two does. Nobody knows which of them a drive
    makes, so that a name has to explain the log better than every other by whichever, and each is sized by its own.
    """
    problem, parts, choosable = choice.problem, choice.fitted.model.parts, 0
    number = next((k for k, part in enumerate(parts) if _rests_on_rows(problem, part)), None)
    names = {one.name for one in hypotheses(problem)} & TIMING
    if number is None or len(names) < 2:
        return choice
    part, was = parts[number], choice.standings[number]
    labels = {LATE_COMMAND.label, part.hypothesis.label, *(one.label for one in FILTERS)}
    tried = [one for one in hypotheses(problem) if one.label in labels]
    fits: list[tuple[AxisProblem, FittedModel]] = []
    for course in courses_between(problem.command):
        laid, late = replace(problem, fine=course.rows), _lateness(part) - course.late * problem.period
        fits += [(laid, _made_late(laid, choice.fitted.model, number, one, late)) for one in tried]
        if not course.late:  # of one that is late no file would say so: it is allowed for, and not chosen
            choosable = len(fits)
    gains = [log_likelihood(problem, fitted.left, problem.held) for _, fitted in fits]
    best = int(np.argmax(gains[:choosable]))
    laid, fitted = fits[best]
    best_part = fitted.model.parts[number]
    base = fit_model(laid, choice.stages[0].model, problem.fit)
    less = base if len(parts) == 1 else fit_model(laid, without_part(fitted.model, number), problem.fit)
    worth = correlation_inflation(problem, fitted.left, problem.held)
    margin = _margin(laid, fitted, score_over(laid, less, fitted)) * worth
    equal = [one.model.parts[number] for (_, one), gain in zip(fits, gains, strict=True) if gain > gains[best] - margin]
    rivals = [*(one.hypothesis.name for one in equal), *(one for one in was.rivals if one not in TIMING)]
    kinds = {one.hypothesis.label: one for one in reversed(equal) if one.hypothesis.name == best_part.hypothesis.name}
    kinds.pop(best_part.hypothesis.label)
    standing = replace(
        was,
        rivals=tuple(one for one in dict.fromkeys(rivals) if one != best_part.hypothesis.name),
        kinds=tuple(kinds.values()),
        better=None,
    )
    return replace(
        choice,
        problem=laid,
        stages=tuple(_restage(laid, fitted, base)),
        standings=(*choice.standings[:number], standing, *choice.standings[number + 1 :]),
    )


def _lateness(part: ModelPart) -> float:
    """Return by how much a delay or a filter makes a command late [s]."""
    return part.numbers[0] * LATE.get(part.hypothesis.variant, 1.0)


def _made_late(problem: AxisProblem, model: Model, number: int, one: Hypothesis, late: float) -> FittedModel:
    """Fit a delay or a filter in the place of a part of a model, begun from one that is so late [s].

    The base values begin as they are or as the file has them, whichever leave less.
    """
    part = ModelPart(hypothesis=one, numbers=(max(late, LEAST_LATE * problem.period) / LATE.get(one.variant, 1.0),))
    put = replace(model, parts=(*model.parts[:number], part, *model.parts[number + 1 :]))
    start = min((put, at_file(put)), key=lambda model: position_rms(problem, residuals_of(problem, model), problem.fit))
    return fit_model(problem, start, problem.fit)


def _rests_on_rows(problem: AxisProblem, part: ModelPart) -> bool:
    """Return whether what a delay or a filter is called may rest on what a drive does between the rows of a log."""
    return part.hypothesis.name in TIMING and problem.parts == 1 and _smear(part) <= NEAR_ROWS * problem.period**2


def is_short(problem: AxisProblem, part: ModelPart) -> bool:
    """Return whether a delay or a filter is so short that most logs do not tell which it is.

    It rests on what a drive does between the rows of its command, or on what is laid between rows that are far apart.
    """
    if part.hypothesis.name not in TIMING:
        return False
    return _smear(part) <= (TOLD if problem.parts == 1 else TOLD_LAID) * (problem.period / problem.parts) ** 2


def rows_to_tell(part: ModelPart) -> float:
    """Return how many rows a second tell a delay and a filter apart that are as long as a part of a model [1/s]."""
    return math.sqrt(TOLD / _smear(part))


def _equals(
    problem: AxisProblem, last: FittedModel, part: ModelPart, mine: float, ranking: Sequence[ScoredHypothesis]
) -> tuple[str, ...]:
    """Names whose score is that of a part, but for those that merely contain it."""
    name = part.hypothesis.name
    margin = _margin(problem, last, mine)
    found = [
        one.hypothesis.name
        for one in ranking
        if one.score > mine - margin and one.hypothesis.name != name and name not in one.hypothesis.within
    ]
    if problem.parts > 1 and is_short(problem, part):
        found += [one.name for one in hypotheses(problem) if one.name in TIMING and one.name != name]
    return tuple(dict.fromkeys(found))
