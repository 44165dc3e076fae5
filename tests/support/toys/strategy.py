"""A strategy by the recipe: half the feed in every window."""

from ph_post.compensate import profile
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult
from ph_post.types import EVERY_LOOP


class HalfFeed:
    """Pass every window at half the feed."""

    name = "toy_half"
    summary = "half the feed in every window"
    feedbacks = EVERY_LOOP

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Request the same dip everywhere."""
        half = profile.dip(0.5, 4)
        return StrategyResult(requests=tuple(ProfileRequest(shape=half) for _ in task.windows))


STRATEGY = HalfFeed()
