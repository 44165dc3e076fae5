"""Cross backlash on the fly: the offset changes around each reversal without a stop.

The feed is left alone, or dips where the curvature asks for it, as the table waits in its backlash while the motor
crosses it: v² g / (4 a R) from the path at best, see :mod:`ph_post.edit.crossings`. For axes whose backlash is outside
the loop. A table changes the offset smoothly; in a part program straight blocks do it.
"""

from __future__ import annotations

from collections.abc import Sequence

from ph_post.compensate.choose import choose
from ph_post.compensate.families import BARE, FLOWING, DesignFamily, ReversalCase
from ph_post.compensate.strategies.base import PlanningTask, StrategyResult, StrategyTraits
from ph_post.compensate.strategies.feed import refuse_options
from ph_post.compensate.strategies.takeup import refuse_feed_only
from ph_post.errors import InputError
from ph_post.types import ENCLOSING_LOOPS, EVERY_LOOP


class OnTheFly:
    """Change the offset of an axis around each reversal without a stop."""

    name = "fly"
    summary = "the offset changes around each reversal without a stop, with a dip in the feed where need be"
    feedbacks = EVERY_LOOP - ENCLOSING_LOOPS
    traits = StrategyTraits(shifts_axes=True)

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Search for the crossing without a stop that is best in simulation at every turning point.

        Raises
        ------
        InputError
            For an option that describes a profile, with --feed-only, and for the program of a path.
        """
        refuse_options(task.options, self.name, "ratio", "degree", "coefficients", "t_star")
        refuse_feed_only(task, self.name)
        if task.options.writes_program:
            raise InputError(
                "--strategy",
                "a program that is made from a path crosses backlash at stops",
                expected="--strategy takeup; or write the plain program (--strategy none), and convert that",
            )
        return choose(task, _families, offsets=True, lead=task.options.inverse_dynamics)


def _families(_task: PlanningTask, case: ReversalCase) -> Sequence[DesignFamily]:
    return () if case.inside_loop else (BARE, FLOWING)


STRATEGY = OnTheFly()
