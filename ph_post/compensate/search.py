"""Find the best design at a turning point by simulating many.

The score of a design weighs two things: how much it shrinks the error on the machine as the file has it, up
to a hundredfold, and how much in the worst of all cases. A design that is worse than the plain motion in any
case, breaks a limit or takes longer than it may is no candidate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate import shapes
from ph_post.compensate.families import Case, Family
from ph_post.compensate.trial import Design, Outcome, Trial
from ph_post.simulate.machine import patience
from ph_post.types import Array

ENOUGH: Final = 0.01
"""Part of the plain error on the machine as the file has it below which less is no better."""

FLOOR: Final = 1e-9
"""An error of this size [m] is none: the smallest that ratios are formed with."""

WEIGHT: Final = 2.0
"""Weight of the machine as the file has it against the worst case."""

FINE: Final = 50.0
"""How steeply the score of what is not allowed rises, so that the search finds back."""

ROOM: Final = 1.0 + 1e-9
"""Rounding allowed where a bound is met exactly."""


class Found(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The best design found: its family and place there, what it does, and whether it is allowed."""

    family: Family
    x: Array
    design: Design
    outcome: Outcome
    score: float
    allowed: bool


class Bounds(msgspec.Struct, frozen=True, kw_only=True):
    """What a design may take: longest time added [s], slowest speed and lowest speed [m/s]."""

    longer: float
    slowest: float
    retrograde: bool = False


class Search:
    """The search at one turning point.

    Parameters
    ----------
    trial : Trial
    case : Case
    bounds : Bounds
    nominal : int
        How many of the trial's scenarios, the first ones, are the machine as the file has it.
    """

    def __init__(self, trial: Trial, case: Case, bounds: Bounds, nominal: int) -> None:
        self.trial, self.case, self.bounds, self.nominal = trial, case, bounds, nominal
        with patience():
            self.plain = trial.run(Design())
        self.calls = 0

    def best(
        self, families: Sequence[Family], calls: int, known: Sequence[tuple[Family, Array]] = ()
    ) -> Found | None:
        """Try all seeds of the families, and refine the best ones.

        Parameters
        ----------
        families : sequence of Family
        calls : int
            Designs that may be tried, seeds included.
        known : sequence of (Family, Array)
            What was best at other turning points.

        Returns
        -------
        Found or None
            None where nothing allowed was found that is better than the plain motion.
        """
        starts = [self.look(family, x) for family, x in known if family in families]
        starts += [self.look(family, seed) for family in families for seed in family.seeds]
        starts.sort(key=lambda found: found.score)
        chosen = _spread(starts)
        rest = max(calls - self.calls, 0)
        found = [*starts, *(self._refine(start, rest // len(chosen)) for start in chosen)] if rest else starts
        allowed = [one for one in found if one.allowed]
        return min(allowed, key=lambda one: one.score, default=None)

    def look(self, family: Family, x: Array) -> Found:
        """Try one design."""
        self.calls += 1
        x = np.clip(x, family.low, family.high)
        design = family.make(x, self.case)
        outcome = self.trial.run(design)
        excess = self._excess(design, outcome)
        score = self._gain(outcome) + FINE * excess
        better = self._gain(outcome) < 0.0
        return Found(
            family=family, x=x, design=design, outcome=outcome, score=score, allowed=excess == 0.0 and better
        )

    def _ratios(self, outcome: Outcome) -> Array:
        return np.asarray((outcome.error + FLOOR) / (self.plain.error + FLOOR))

    def _gain(self, outcome: Outcome) -> float:
        """Logarithm of what is left of the error; the smaller the better."""
        ratios = self._ratios(outcome)
        as_filed = float(ratios[: self.nominal].max())
        return WEIGHT * math.log(max(as_filed, ENOUGH)) + math.log(float(ratios.max()))

    def _excess(self, design: Design, outcome: Outcome) -> float:
        """By how much a design is not allowed; 0 where it is."""
        ratios = self._ratios(outcome)
        sides = self._sides(design) / self.case.place.room
        slow = 0.0
        if self.bounds.slowest > 0.0:
            slow = max(0.0, self.bounds.slowest - outcome.slowest) / self.bounds.slowest
        if not self.bounds.retrograde:
            slow += max(0.0, -outcome.slowest / self.case.place.cruise - 1e-9)
        parts = (
            float(np.maximum(ratios - ROOM, 0.0).sum()),
            max(0.0, outcome.use - 1.0),
            max(0.0, outcome.longer / self.bounds.longer - ROOM) if self.bounds.longer > 0.0 else 1.0,
            max(0.0, sides - ROOM),
            slow,
        )
        return sum(parts)

    def _sides(self, design: Design) -> float:
        """Way that a profile takes on its longer side [m]."""
        if design.shape is None:
            return 0.0
        way = 2.0 * shapes.mean(design.shape) * self.case.place.cruise * design.t_star
        return max(way * max(design.turn, 1.0 - design.turn), 0.0)

    def _refine(self, start: Found, calls: int) -> Found:
        """Improve a design by the simplex method of Nelder and Mead."""
        from scipy.optimize import minimize

        family = start.family
        if calls <= family.low.size + 1:
            return start
        best = [start]

        def score(x: Array) -> float:
            found = self.look(family, x)
            if (not found.allowed, found.score) < (not best[0].allowed, best[0].score):
                best[0] = found
            return found.score

        span = 0.12 * (family.high - family.low)
        step = np.where(start.x + span <= family.high, span, -span)
        simplex = np.vstack([start.x, start.x + np.diag(step)])
        options = {"maxfev": calls, "initial_simplex": simplex, "xatol": 1e-4, "fatol": 1e-3}
        bounds = list(zip(family.low.tolist(), family.high.tolist(), strict=True))
        minimize(score, start.x, method="Nelder-Mead", bounds=bounds, options=options)  # type: ignore[call-overload]
        return best[0]


def _spread(starts: Sequence[Found], most: int = 3) -> list[Found]:
    """Return the best start of every family, and the second best of the best family."""
    chosen: list[Found] = []
    for start in starts:
        taken = sum(start.family is other.family for other in chosen)
        if taken < 1 or (len(chosen) < most and taken < 2):
            chosen.append(start)
        if len(chosen) == most:
            break
    return chosen
