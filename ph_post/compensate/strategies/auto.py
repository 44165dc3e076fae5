"""The best of all strategies at every turning point, by simulation of every machine that the file leaves possible."""

from __future__ import annotations

from collections.abc import Sequence

from ph_post.compensate.choose import choose
from ph_post.compensate.families import PLATEAU, DesignFamily, ReversalCase, dips
from ph_post.compensate.layout import lacks_stops
from ph_post.compensate.offsets import may_shift
from ph_post.compensate.strategies.base import PlanningTask, StrategyResult, StrategyTraits
from ph_post.compensate.strategies.feed import refuse_options
from ph_post.compensate.strategies.takeup import crossing_families, jog_families
from ph_post.types import EVERY_LOOP

DEGREES = (4, 6, 10)
"""Degrees of Eq. (26) that are searched where only the feed may be modulated."""

SIMPLE = 4
"""The degree that is searched beside other families."""

BACKWARDS = -1.0
"""Lowest V(1/2)/V_c of the starts where the tool may move back."""


class Automatic:
    """Search all families, and prove the choice against the plain program."""

    name = "auto"
    summary = "the best of all at every turning point, in simulation and within the limits"
    feedbacks = EVERY_LOOP
    traits = StrategyTraits(chooses=True, shifts_axes=True, default_for="job")

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Search for the best design at every turning point."""
        refuse_options(task.options, self.name, "ratio", "degree", "coefficients", "t_star")
        options = task.options
        if options.feed_only:
            return choose(task, _feed_families, offsets=False, lead=False, races=True)
        if not options.writes_program:
            return choose(task, crossing_families, _beside, offsets=True, lead=options.inverse_dynamics, races=True)
        result = choose(task, jog_families, _beside_jogs, offsets=True, lead=False, races=True)
        # Without a stop at every reversal there is no lasting offset, and the feed may be modulated instead.
        if lacks_stops(task, result):
            return choose(task, _feed_families, offsets=False, lead=False, races=True)
        return result


def _beside(task: PlanningTask, case: ReversalCase) -> Sequence[DesignFamily]:
    """Return what is tried beside crossings: a stop alone helps only inside a loop."""
    return (PLATEAU, *_dips(task, SIMPLE)) if case.inside_loop else ()


def _beside_jogs(task: PlanningTask, case: ReversalCase) -> Sequence[DesignFamily]:
    lasting = any(may_shift(axis) for axis, _ in case.reversing)
    return () if lasting else _feed_families(task, case)


def _feed_families(task: PlanningTask, _case: ReversalCase) -> Sequence[DesignFamily]:
    return (PLATEAU, *_dips(task, *DEGREES))


def _dips(task: PlanningTask, *degrees: int) -> list[DesignFamily]:
    lowest = BACKWARDS if task.options.allow_retrograde else 0.0
    return [dips(degree, lowest) for degree in degrees]


STRATEGY = Automatic()
