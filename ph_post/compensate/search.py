"""Find good designs at a turning point by simulating many.

The score of a design weighs two things: how much it shrinks the error on the machine as the file has it, up
to a hundredfold, and how much in the worst of all cases. Friction is known so much worse than all else that there the
worst case has the larger weight. A design that is worse than the plain motion in any
case, breaks a limit or takes longer than it may is no candidate. Kept are the candidates than which no other
is both better and quicker.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate import shapes
from ph_post.compensate.families import BARE, ONE, DesignFamily, ReversalCase, direct_changes, jogs_last, make_bare
from ph_post.compensate.speed_ramps import ramp_time
from ph_post.compensate.trial import Design, Trial, TrialResult
from ph_post.types import Array, Axis, Crossing, Jog

ENOUGH: Final = 0.01
"""Part of the plain error on the machine as the file has it below which less is no better."""

FLOOR: Final = 1e-9
"""An error of this size [m] is none: the smallest that ratios are formed with."""

WEIGHT: Final = 2.0
"""Weight of the machine as the file has it against the worst case."""

FINE: Final = 50.0
"""Slope of the score of designs that are not allowed, so that the search finds back."""

WORST: Final = 0.2
"""Part of the error in the worst case that counts to a design's merit."""

BETTER: Final = 0.97
"""Ratio by which a design must be better than a quicker one to be a candidate beside it."""


REST_PART: Final = 0.5
"""Part of the limits along the path with which a rest in the plain motion is reckoned."""

PROLONGED: Final = 60
"""Designs that refine one which takes more than its share of the time."""

ROOM: Final = 1.0 + 1e-9
"""Rounding allowed where a bound is met exactly."""


class TriedDesign(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A design that was tried: its family and place there, for what budget [s], and what it does.

    `side` [m] is the way that the profile takes on its longer side; `merit` [m] the error on the machine as
    the file has it, and a part of that in the worst case.
    """

    family: DesignFamily
    x: Array
    budget: float
    design: Design
    outcome: TrialResult
    side: float
    score: float
    merit: float
    allowed: bool

    @property
    def longer(self) -> float:
        """Time that it adds [s]."""
        return self.outcome.longer


class DesignBounds(msgspec.Struct, frozen=True, kw_only=True):
    """The bounds of a design: the slowest speed [m/s], and whether the tool may move back."""

    slowest: float
    retrograde: bool = False


class DesignSearch:
    """The search at one turning point.

    Parameters
    ----------
    trial : Trial
    case : ReversalCase
    bounds : DesignBounds
    nominal : int
        How many of the trial's scenarios, the first ones, are the machine as the file has it.
    """

    def __init__(self, trial: Trial, case: ReversalCase, bounds: DesignBounds, nominal: int) -> None:
        self.trial, self.case, self.bounds, self.nominal = trial, case, bounds, nominal
        self.plain = trial.run(Design())
        self.calls = 0
        self.tried: list[TriedDesign] = []

    def explore(
        self, families: Sequence[DesignFamily], calls: int, known: Sequence[TriedDesign] = ()
    ) -> list[TriedDesign]:
        """Try all seeds of the families for several budgets, and refine the best ones.

        Parameters
        ----------
        families : sequence of DesignFamily
        calls : int
            Designs that may be tried, seeds included.
        known : sequence of TriedDesign, optional
            What was good at another turning point.

        Returns
        -------
        list of TriedDesign
            The candidates, by the time they add.
        """
        starts = [
            self.look(family, seed, budget)
            for family in families
            for seed in family.seeds
            for budget in self._budgets(family.budgets)
        ]
        starts += [self.look(one.family, one.x, one.budget) for one in known if one.family in families]
        starts.sort(key=lambda found: found.score)
        chosen = _spread([start for start in starts if start.budget <= self.case.budget])
        share = max(calls - self.calls, 0) // max(len(chosen), 1)
        for start in chosen:
            self._refine(start, share)
        return self.candidates()

    def prolong(self, families: Sequence[DesignFamily], times: Sequence[float]) -> list[TriedDesign]:
        """Try the seeds for some times the budget, until one is better than the plain motion.

        Returns
        -------
        list of TriedDesign
            The candidates, by the time they add.
        """
        for budget in self._budgets(times):
            starts = [self.look(one, seed, budget) for one in families for seed in one.seeds]
            if any(start.allowed for start in starts):
                self._refine(min(starts, key=lambda found: found.score), PROLONGED)
                break
        return self.candidates()

    def _budgets(self, parts: Sequence[float]) -> list[float]:
        """Turn parts of the budget into times [s], none of them longer than is tried."""
        return list(dict.fromkeys(min(part * self.case.budget, self.case.longest) for part in parts))

    def polish(self, starts: Sequence[TriedDesign], calls: int) -> None:
        """Refine the best of some designs by a few calls."""
        self._refine(min(starts, key=lambda found: found.score), calls)

    def adopt(self, known: TriedDesign) -> TriedDesign:
        """Return a design of a turning point that is the same, made for this one."""
        if known.design.stop:
            own = [one for one in self.tried if one.design.stop]
            return own[0] if own else known
        case = msgspec.structs.replace(self.case, budget=known.budget)
        found = msgspec.structs.replace(known, design=known.family.make(known.x, case))
        self.tried.append(found)
        return found

    def candidates(self) -> list[TriedDesign]:
        """Return the designs allowed than which none is both better and quicker, by the time they add."""
        return best_of(self.tried)

    def add_rest(self, *, jogs: bool) -> None:
        """Take into account that the plain motion may rest here while the gaps behind the loop are crossed.

        With `jogs` they are crossed one after the other between dwells, as a part program does it.

        It is not simulated: the motion rests within the limits wherever it is planned to, and what is left is
        the part of the gap that is not known. The time is estimated from the limits of the slowest axis.
        """
        trial, case = self.trial, self.case
        drives = [trial.machine.axes[name] for name in trial.axes]
        crossing = jogs_last(case.reversing) if jogs else max(case.shortest.values())
        crossings = () if jogs else make_bare(ONE, case).crossings
        rest = rest_design(drives, case.place.cruise, case.reversing, crossings, crossing, case.lead)
        error = np.full(len(trial.scenarios), rest.outcome.error[-1])
        error[: self.nominal] = FLOOR
        outcome = msgspec.structs.replace(rest.outcome, error=error, rms=error)
        self.tried.append(
            msgspec.structs.replace(
                rest,
                budget=case.budget,
                outcome=outcome,
                score=self._gain(outcome),
                merit=self.merit(outcome),
                allowed=self.bounds.slowest == 0.0,
            )
        )

    def forget(self) -> None:
        """Forget what was tried."""
        self.tried, self.calls = [], 0

    def look(self, family: DesignFamily, x: Array, budget: float) -> TriedDesign:
        """Try one design."""
        self.calls += 1
        x = np.clip(x, family.low, family.high)
        case = msgspec.structs.replace(self.case, budget=budget)
        design = family.make(x, case)
        if design.lead and not design.friction:
            design = msgspec.structs.replace(design, friction=direct_changes(case))
        outcome = self.trial.run(design)
        excess, gain = self._excess(design, outcome, budget), self._gain(outcome)
        found = TriedDesign(
            family=family,
            x=x,
            budget=budget,
            design=design,
            outcome=outcome,
            side=self._side(design),
            score=gain + FINE * excess,
            merit=self.merit(outcome),
            allowed=excess == 0.0 and gain < 0.0,
        )
        self.tried.append(found)
        return found

    def merit(self, outcome: TrialResult) -> float:
        """Error on the machine as the file has it, and a part of the worst [m]; of friction, the other way round."""
        nominal, worst = outcome.error[: self.nominal].max(), outcome.error.max()
        return float(worst + WORST * nominal if self.case.rubbing else nominal + WORST * worst)

    def _ratios(self, outcome: TrialResult) -> Array:
        return np.asarray((outcome.error + FLOOR) / (self.plain.error + FLOOR))

    def _gain(self, outcome: TrialResult) -> float:
        """Logarithm of what is left of the error; the smaller the better."""
        ratios = self._ratios(outcome)
        nominal = float(ratios[: self.nominal].max())
        own, others = (1.0, WEIGHT) if self.case.rubbing else (WEIGHT, 1.0)
        return own * math.log(max(nominal, ENOUGH)) + others * math.log(float(ratios.max()))

    def _excess(self, design: Design, outcome: TrialResult, budget: float) -> float:
        """By how much a design is not allowed; 0 where it is."""
        ratios = self._ratios(outcome)
        sides = self._side(design) / self.case.place.room
        slow = 0.0
        if self.bounds.slowest > 0.0:
            slow = max(0.0, self.bounds.slowest - outcome.slowest) / self.bounds.slowest
        if not self.bounds.retrograde:
            slow += max(0.0, -outcome.slowest / self.case.place.cruise - 1e-9)
        fast = 0.0 if design.shape is None else max(0.0, shapes.extremes(design.shape)[1] - ROOM)
        parts = (
            fast,
            float(np.maximum(ratios - ROOM, 0.0).sum()),
            max(0.0, outcome.use - max(1.0, self.plain.use)),
            max(0.0, outcome.longer / budget - ROOM),
            max(0.0, sides - ROOM),
            slow,
        )
        return sum(parts)

    def _side(self, design: Design) -> float:
        """Way that a profile takes on its longer side [m]."""
        if design.shape is None:
            return 0.0
        way = 2.0 * shapes.mean(design.shape) * self.case.place.cruise * design.t_star
        return max(way * max(design.turn, 1.0 - design.turn), 0.0)

    def _refine(self, start: TriedDesign, calls: int) -> None:
        """Improve a design by the simplex method of Nelder and Mead."""
        from scipy.optimize import minimize

        family = start.family
        if calls <= family.low.size + 1:
            return

        def score(x: Array) -> float:
            return self.look(family, x, start.budget).score

        span = 0.12 * (family.high - family.low)
        step = np.where(start.x + span <= family.high, span, -span)
        simplex = np.vstack([start.x, start.x + np.diag(step)])
        options = {"maxfev": calls, "initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-3}
        bounds = list(zip(family.low.tolist(), family.high.tolist(), strict=True))
        minimize(score, start.x, method="Nelder-Mead", bounds=bounds, options=options)  # type: ignore[call-overload]


def best_of(tried: Sequence[TriedDesign]) -> list[TriedDesign]:
    """Return the designs allowed than which none is both better and quicker, by the time they add."""
    kept: list[TriedDesign] = []
    for found in sorted(tried, key=lambda one: (one.longer, one.merit)):
        if found.allowed and (not kept or found.merit < BETTER * kept[-1].merit):
            kept.append(found)
    return kept


def rest_design(
    drives: Sequence[Axis],
    cruise: float,
    reversing: Sequence[tuple[Axis, int]],
    crossings: tuple[Crossing | Jog, ...],
    crossing: float,
    lead: bool,
) -> TriedDesign:
    """Rest in the plain motion while gaps behind the loop are crossed.

    It is not simulated: the motion rests within the limits wherever it is planned to, and what is left is the part of
    the gap that is not known. The time is estimated from the limits of the slowest of `drives`, with the feed `cruise`
    [m/s] before and behind, and the time of the `crossing` [s].
    """
    ramps = time_to_stop(drives, cruise)
    error = np.array([FLOOR, max(axis.uncertainty.backlash * largest_lag(axis) for axis, _ in reversing)])
    return TriedDesign(
        family=BARE,
        x=ONE,
        budget=ramps + crossing,
        design=Design(crossings=crossings, lead=lead, stop=True),
        outcome=TrialResult(error=error, rms=error, use=1.0, longer=ramps + crossing, slowest=0.0),
        side=0.0,
        score=0.0,
        merit=FLOOR + WORST * float(error.max()),
        allowed=True,
    )


def time_to_stop(drives: Sequence[Axis], cruise: float) -> float:
    """Time that ramps from a feed [m/s] to rest and back add, within part of the limits of the slowest axis [s]."""
    acceleration = np.array([REST_PART * min(axis.limits.acceleration for axis in drives)])
    jerk = np.array([REST_PART * min(axis.limits.jerk for axis in drives)])
    return float(ramp_time(np.zeros(1), np.array([cruise]), acceleration, jerk)[0]) if cruise > 0.0 else 0.0


def largest_lag(axis: Axis) -> float:
    """Distance [m] by which the table is late without an offset, on the side where it is more."""
    return 0.5 * (1 + abs(axis.reference_side)) * axis.gap.lost_motion


def _spread(starts: Sequence[TriedDesign], most: int = 3) -> list[TriedDesign]:
    """Return the best start of every family, and the second best of the best family."""
    chosen: list[TriedDesign] = []
    for start in starts:
        taken = sum(start.family is other.family for other in chosen)
        if taken < 1 or (len(chosen) < most and taken < 2):
            chosen.append(start)
        if len(chosen) == most:
            break
    return chosen
