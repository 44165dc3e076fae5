"""Take the gap up: the reversing axis is commanded through it while the path slows down or stops.

With a scale on the table the motor is driven across the gap by a short command that the table does not
follow, and met by the path on the other side. Without one the command is shifted by the gap, and stays
shifted until the next reversal. A part program does both by short moves of one axis at full stops.
"""

from __future__ import annotations

from collections.abc import Sequence

from ph_post.compensate.choose import choose
from ph_post.compensate.families import (
    BARE,
    CARRIED,
    CARRIED_THROUGH,
    CROSSING,
    JOG,
    OFFSET,
    PULSE,
    RUBBING,
    TURN,
    DesignFamily,
    ReversalCase,
)
from ph_post.compensate.offsets import may_shift
from ph_post.compensate.strategies.base import PlanningTask, StrategyResult, StrategyTraits
from ph_post.compensate.strategies.feed import refuse_options
from ph_post.errors import InputError
from ph_post.types import EVERY_LOOP


class TakeUp:
    """Stop or slow down, and command the reversing axis through its gap."""

    name = "takeup"
    summary = "the reversing axis is commanded through its backlash while the path slows down or stops"
    feedbacks = EVERY_LOOP
    traits = StrategyTraits(shifts_axes=True)

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Search for the crossing that is best in simulation at every turning point."""
        refuse_options(task.options, self.name, "ratio", "degree", "coefficients", "t_star")
        refuse_feed_only(task, self.name)
        if task.options.writes_program:
            return choose(task, jog_families, offsets=True, lead=False)
        return choose(task, crossing_families, offsets=True, lead=task.options.inverse_dynamics)


def refuse_feed_only(task: PlanningTask, name: str) -> None:
    """Refuse a strategy that adds to the path where nothing may be.

    Raises
    ------
    InputError
        With --feed-only.
    """
    if task.options.feed_only:
        raise InputError("--feed-only", f"strategy {name} modifies the path", expected="no --feed-only")


def refuse_offsets(task: PlanningTask, name: str) -> None:
    """Refuse a strategy that adds to the path where nothing may be, or can be.

    Raises
    ------
    InputError
        With --feed-only, and for a part program.
    """
    refuse_feed_only(task, name)
    if task.options.writes_program:
        raise InputError(
            "--strategy",
            f"{name} shifts single samples, which a part program cannot",
            expected="--table",
        )


def crossing_families(task: PlanningTask, case: ReversalCase) -> Sequence[DesignFamily]:
    """Return the families that cross the backlash; those that stop are left out where a least feed forbids it."""
    if not case.inside_loop:
        return (TURN, BARE, OFFSET) if case.rubbing else (BARE, OFFSET)
    # Where a P loop's motor has no friction to hold against, what it does behind a step has to be searched.
    cascade = any(axis.servo.cascade is not None for axis, _ in case.reversing)
    rests = any(one.start_of(0.0) is not None for one in case.rests.values())
    carried = ((CARRIED_THROUGH,) if cascade or rests else ()) + ((CARRIED,) if cascade else ())
    turning = (*carried, *((TURN, RUBBING) if case.rubbing else ()))
    return turning if task.options.min_feed else (*turning, CROSSING)


def jog_families(task: PlanningTask, case: ReversalCase) -> Sequence[DesignFamily]:
    """Return the families that a part program can carry; all of them stop, which a least feed forbids."""
    if task.options.min_feed:
        return ()
    if case.inside_loop:
        return (PULSE,)
    return (JOG,) if any(may_shift(axis) for axis, _ in case.reversing) else ()


STRATEGY = TakeUp()
