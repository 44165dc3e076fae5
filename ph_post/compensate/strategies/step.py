"""Backlash compensation as controllers do it: shift the axis by its gap as soon as its command turns back.

The axis moves by half the gap either way at no more than half its acceleration limit, beginning at the
commanded reversal, whatever the feed. LinuxCNC's BACKLASH is of this kind. A baseline.
"""

from __future__ import annotations

import math

from ph_post.compensate.crossing_times import whole_crossing
from ph_post.compensate.layout import reversing_axes
from ph_post.compensate.offsets import smoothstep
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult, StrategyTraits
from ph_post.compensate.strategies.feed import refuse_options
from ph_post.compensate.strategies.takeup import refuse_offsets
from ph_post.errors import InputError
from ph_post.geometry.bernstein import evaluate
from ph_post.types import ENCLOSING_LOOPS, EVERY_LOOP, Axis, Crossing

PART = 0.5
"""Part of the acceleration limit that the shift may take."""

DEGREE = 3
"""Degree of the shift in time; 5 and 7 are smoother and take longer."""


class StepCompensation:
    """Shift every axis that is not closed over the table by its gap, behind each reversal."""

    name = "step"
    summary = "the position step that controllers add at a reversal; a baseline"
    feedbacks = EVERY_LOOP - ENCLOSING_LOOPS
    traits = StrategyTraits(is_baseline=True)

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Want a shift in every window, and no profile."""
        refuse_options(task.options, self.name, "ratio", "coefficients", "t_star")
        refuse_offsets(task, self.name)
        degree = task.options.degree or DEGREE
        if degree % 2 == 0:
            raise InputError("--degree", "not a degree of a shift", expected="3, 5 or 7", got=str(degree))
        sized = task.sized
        drives = [reversing_axes(sized, [task.turning_points[k] for k in window.members]) for window in task.windows]
        order = (degree - 1) // 2
        return StrategyResult(
            requests=tuple(
                ProfileRequest(
                    shape=None,
                    crossings=tuple(_shift(axis, sign, order) for axis, sign in own if axis.feedback in self.feedbacks),
                )
                for own in drives
            )
        )


def _shift(axis: Axis, direction: int, order: int) -> Crossing:
    """Begin at the commanded reversal; the acceleration is largest where the second derivative is."""
    steepest = max(abs(float(evaluate(smoothstep(order)[2], k / 64))) for k in range(65))
    duration = math.sqrt(steepest * axis.gap.lost_motion / (PART * axis.limits.acceleration))
    crossing = whole_crossing(axis, direction, 0.5 * duration, duration)
    return Crossing(axis=crossing.axis, start=0.0, duration=duration, travel=crossing.travel, order=order)


STRATEGY = StepCompensation()
