"""The plain program: nothing is modulated."""

from __future__ import annotations

from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult, StrategyTraits
from ph_post.types import EVERY_LOOP


class PlainFeed:
    """Leave every window alone."""

    name = "none"
    summary = "the plain program, nothing added"
    feedbacks = EVERY_LOOP
    traits = StrategyTraits(compensates=False, is_baseline=True)

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Want no profile anywhere, and have nothing to say about it."""
        return StrategyResult(requests=tuple(ProfileRequest(shape=None) for _ in task.windows))


STRATEGY = PlainFeed()
