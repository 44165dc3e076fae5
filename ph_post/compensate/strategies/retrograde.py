"""Retrograde motion, section 6 of the paper: a dip so deep that the tool moves back for a while.

References
----------
.. [1] Real-time compensation of backlash positional errors in CNC machines by localized feedrate
   modulation, Int. J. Adv. Manuf. Technol. 119 (2022), doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

from ph_post.compensate import shapes
from ph_post.compensate.strategies import feed
from ph_post.compensate.strategies.base import PlanningTask, StrategyResult, StrategyTraits
from ph_post.errors import InputError
from ph_post.types import EVERY_LOOP

RATIO = -0.3
"""V(½) / V_c by default. Where the gap opens once only, as [1]_ simulates it, the error is least near -0.4;
where it opens at every reversal of either axis the error is half as large at -0.3 as there."""


class Retrograde:
    """Move back and forth about every turning point whose axis has a gap."""

    name = "retrograde"
    summary = "a feed dip below zero: the tool moves back for a while; needs --allow-retrograde"
    feedbacks = EVERY_LOOP
    traits = StrategyTraits(moves_back=True)

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Want the same profile in every window in which an axis crosses its gap.

        Raises
        ------
        InputError
            Unless the options allow retrograde motion, and for a profile whose feed stays positive.
        """
        options = task.options
        if not options.allow_retrograde:
            what = "retrograde makes the feed negative"
            raise InputError("--strategy", what, expected="--allow-retrograde beside it, or another strategy")
        shape = feed.chosen_shape(options, RATIO)
        if shapes.is_non_negative(shape):
            where = "--ratio" if options.coefficients is None else "--coefficients"
            got = f"V >= {shapes.lowest(shape):.6g} V_c"
            raise InputError(where, "nothing retrograde", expected="V < 0, or --strategy suppress", got=got)
        return feed.propose(task, lambda _, longest: feed.request_in_intervals(task, shape, longest))


STRATEGY = Retrograde()
