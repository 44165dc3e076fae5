"""A stop at every turning point: the composite profile that section 7 of the paper leaves to a later study.

Deceleration, dwell and acceleration join with all derivatives of the feed up to the third.
"""

from __future__ import annotations

import math

import msgspec

from ph_post.analysis.path_analysis import feed_at
from ph_post.compensate import profile
from ph_post.compensate.strategies import feed
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult
from ph_post.types import EVERY_LOOP, Window

ORDER = 3
"""Derivatives of the feed that vanish at the junctions: jerk and its rate are continuous along the path."""

SHARE = 0.5
"""Part of the acceleration and jerk limits that a ramp may take; the rest is for the bend of the path."""


class DwellAtReversals:
    """Stop at every turning point whose axis has a gap, for as long as its backlash interval."""

    name = "dwell"
    summary = "a smooth stop at every turning point for the length of its backlash interval"
    feedbacks = EVERY_LOOP

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Want a stop in every window in which an axis crosses its gap, and warn of what a stop does not do."""
        feed.refuse_options(task.options, self.name, "ratio", "degree", "coefficients")
        result = feed.propose(task, lambda window, longest: _request(task, window, longest))
        axes = feed.modulated_axes(task, result.requests)
        inside = [name for name in axes if task.machine.axes[name].loop.encloses_backlash]
        if not inside:
            return result
        warning = (
            f"a stop does not take up all backlash of {' and '.join(inside)}: the motor crosses it only "
            "under a position error. What is left when the tool goes on is crossed then"
        )
        return msgspec.structs.replace(result, warnings=(*result.warnings, warning))


def _request(task: PlanningTask, window: Window, longest: float) -> ProfileRequest:
    """Hold for the backlash interval; the ramps are as long as limits ask for and the window has room for."""
    t_star = task.options.t_star
    if t_star is not None:
        hold = min(longest, t_star)
        shape = profile.stop(t_star - 0.5 * hold, hold, ORDER)
        return ProfileRequest(shape=shape, t_star=t_star, may_leave_window=True)
    speed = _feed_around(task, window)
    limits = [task.machine.axes[name].limits for name in task.path.axes]
    acceleration, jerk = min(one.acceleration for one in limits), min(one.jerk for one in limits)
    quickest = profile.ramp_duration(speed, SHARE * acceleration, SHARE * jerk, ORDER)
    # Over a ramp the mean feed is half the feed around it.
    ramp = min(max(quickest, longest), 2.0 * window.half_length / speed)
    return ProfileRequest(shape=profile.stop(ramp, longest, ORDER), t_star=ramp + 0.5 * longest, least=longest)


def _feed_around(task: PlanningTask, window: Window) -> float:
    """Highest feed [m/s] that the tool can have at the turning point, where one axis stands still."""
    point = task.turning_points[window.turning_point]
    others = [task.machine.axes[name].limits.velocity for name in task.path.axes if name != point.axis]
    return min(feed_at(task.path, point), math.hypot(*others))


STRATEGY = DwellAtReversals()
