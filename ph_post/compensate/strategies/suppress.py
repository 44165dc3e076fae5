"""Feed suppression, section 5 of the paper: a smooth dip of the feed about every turning point."""

from __future__ import annotations

from ph_post.compensate.strategies import feed
from ph_post.compensate.strategies.base import PlanningTask, StrategyResult, StrategyTraits
from ph_post.types import EVERY_LOOP

RATIO = 0.25
"""V(½) / V_c by default: the shallow minimum of the error among profiles that keep V >= 0; section 6."""


class FeedSuppression:
    """Slow down about every turning point whose axis has a gap."""

    name = "suppress"
    summary = "a smooth feed dip about every turning point, never negative unless allowed"
    feedbacks = EVERY_LOOP
    traits = StrategyTraits(default_for="profile")

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Want the same profile in every window in which an axis crosses its gap."""
        shape = feed.chosen_shape(task.options, RATIO)
        return feed.propose(task, lambda _, longest: feed.request_in_intervals(task, shape, longest))


STRATEGY = FeedSuppression()
