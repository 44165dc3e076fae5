"""Cross backlash on the fly: the offset changes around each reversal without a stop.

The feed is left alone, or dips where the curvature asks for it, as the table waits in its backlash while the motor
crosses it: v² g / (4 a R) from the path at best, see :mod:`ph_post.edit.crossing_shapes`. For axes whose backlash is
outside the loop. A table changes the offset smoothly; in a part program straight blocks do it.
"""

from __future__ import annotations

import math
from typing import Final

from ph_post.compensate import profile
from ph_post.compensate.crossing_times import (
    MOST,
    crossing_at_turn,
    rest_before,
    shortest_crossing,
    turning_acceleration,
    turning_error,
)
from ph_post.compensate.layout import reversing_axes
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult, StrategyTraits
from ph_post.compensate.strategies.feed import refuse_options
from ph_post.compensate.strategies.takeup import refuse_feed_only
from ph_post.errors import InputError
from ph_post.geometry.numeric import bisect
from ph_post.types import ENCLOSING_LOOPS, EVERY_LOOP, Crossing, Window
from ph_post.units import MM

ERROR: Final = 1.9e-3 * MM
"""The feed dips where the table would be farther from the path [m]."""

LOWEST: Final = 0.2
"""Lowest V / V_c of a dip."""

PART: Final = 0.5
"""Part of the limits of the axes that the ramps of a dip take."""

STEEPEST: Final = 15.0 / 8.0
BENT: Final = 10.0 / math.sqrt(3.0)
"""Largest first and second derivative of a step with two vanishing derivatives at its ends."""


class OnTheFly:
    """Change the offset of an axis around each reversal without a stop."""

    name = "fly"
    summary = "the offset changes around each reversal without a stop, with a dip in the feed where need be"
    feedbacks = EVERY_LOOP - ENCLOSING_LOOPS
    traits = StrategyTraits(shifts_axes=True)

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Request a crossing around every reversal, and a dip where its curvature asks for one.

        Raises
        ------
        InputError
            For an option that describes a profile, with --feed-only, and for a program: there lines are replaced.
        """
        refuse_options(task.options, self.name, "ratio", "degree", "coefficients", "t_star")
        refuse_feed_only(task, self.name)
        requests = tuple(self._request(task, window) for window in task.windows)
        if task.options.writes_program and any(one.crossings for one in requests):
            raise InputError(
                "--strategy",
                f"programs of {task.machine.dialect} cannot be changed by lines, and cross backlash at stops",
                expected="--strategy takeup",
                got=self.name,
            )
        return StrategyResult(requests=requests, rests=False)

    def _request(self, task: PlanningTask, window: Window) -> ProfileRequest:
        lead, period = task.options.inverse_dynamics, task.machine.servo_period
        points, speed = [task.turning_points[k] for k in window.members], task.feed.at(window.s)
        drives = reversing_axes(task.sized, points)
        lasts = {axis.name: shortest_crossing(axis, lead, period, MOST) for axis, _ in drives}
        bends = {point.axis: turning_acceleration(point, 1.0) for point in points}
        rests = {one.axis: rest_before(task.analysis.track, one, task.machine.axes[one.axis], lead) for one in points}
        own = [(axis, sign) for axis, sign in drives if axis.feedback in self.feedbacks]

        def crossed(feed: float) -> tuple[Crossing, ...]:
            return tuple(
                crossing_at_turn(axis, sign, lasts[axis.name], bends[axis.name] * feed**2, rests[axis.name])
                for axis, sign in own
            )

        def is_close(ratio: float) -> bool:
            feed = ratio * speed
            return all(
                rests[axis.name].start_of(lasts[axis.name]) is not None
                or turning_error(axis, lasts[axis.name], bends[axis.name] * feed**2) <= ERROR
                for axis, _ in own
            )

        if is_close(1.0):
            return ProfileRequest(shape=None, crossings=crossed(speed))
        ratio = bisect(is_close, LOWEST, 1.0)[0] if is_close(LOWEST) else LOWEST
        crossings = crossed(ratio * speed)
        # What is late is late by less than a crossing begins early.
        hold = 2.0 * max(one.end for one in crossings)
        push = min(axis.limits.acceleration for axis in task.machine.axes.values())
        jerk = min(axis.limits.jerk for axis in task.machine.axes.values())
        lost = (1.0 - ratio) * speed
        ramp = max(STEEPEST * lost / push, math.sqrt(BENT * lost / jerk)) / PART
        shape = profile.plateau(ramp, hold, ramp, ratio, order=2)
        return ProfileRequest(shape=shape, t_star=0.5 * hold + ramp, may_leave_window=True, crossings=crossings)


STRATEGY = OnTheFly()
