"""The straight dip of the literature: the feed falls and rises linearly in time. A baseline.

Its acceleration jumps at both ends and at the turning point, so that on a machine with a jerk limit most of
it is softened away. After [1]_.

References
----------
.. [1] M. Warnecke, M. Jouaneh, Backlash compensation in gear trains by means of open-loop modification of the
   input trajectory, J. Mech. Design 125 (2003) 620-624.
"""

from __future__ import annotations

from ph_post.compensate import profile
from ph_post.compensate.strategies import feed
from ph_post.compensate.strategies.base import PlanningTask, StrategyResult, StrategyTraits
from ph_post.types import EVERY_LOOP

RATIO = 0.25
"""V / V_c at the turning point by default, as of `suppress`."""


class LinearDip:
    """Slow down and speed up again linearly about every turning point whose axis has a gap."""

    name = "linear"
    summary = "a piecewise linear feed dip about every turning point, a baseline"
    feedbacks = EVERY_LOOP
    traits = StrategyTraits(is_baseline=True)

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Want the same profile in every window in which an axis crosses its gap."""
        options = task.options
        feed.refuse_options(options, self.name, "degree", "coefficients")
        ratio = RATIO if options.ratio is None else options.ratio
        shape = feed.passable(profile.plateau(1.0, 0.0, 1.0, ratio, order=0), "--ratio", options)
        return feed.propose(task, lambda _, longest: feed.request_in_intervals(task, shape, longest))


STRATEGY = LinearDip()
