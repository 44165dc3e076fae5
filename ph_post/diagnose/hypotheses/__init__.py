"""The hypotheses of a diagnosis: the effects that may be missing from an axis."""

from __future__ import annotations

from typing import Final

from ph_post.diagnose.hypotheses.base import Hypothesis
from ph_post.diagnose.hypotheses.drives import drive_hypotheses
from ph_post.diagnose.hypotheses.forces import force_hypotheses
from ph_post.diagnose.hypotheses.readings import reading_hypotheses
from ph_post.drive.effects.registry import is_effect
from ph_post.identify.free_run import AxisProblem

OF_THE_AXIS: Final = frozenset(("backlash", "servo_mismatch", "command_filter"))
"""Effects that are numbers of the axis itself, and not registered as effects."""


def hypotheses(problem: AxisProblem) -> tuple[Hypothesis, ...]:
    """List what may be missing from an axis and could show in its log."""
    return tuple(one for one in every_hypothesis(problem) if not why_not(problem, one))


def every_hypothesis(problem: AxisProblem) -> tuple[Hypothesis, ...]:
    """List all hypotheses, whether or not they can act on an axis."""
    return (*drive_hypotheses(problem), *force_hypotheses(problem), *reading_hypotheses(problem))


def why_not(problem: AxisProblem, hypothesis: Hypothesis) -> str:
    """Say why a hypothesis cannot act on an axis or show in its log; empty where it can."""
    name = hypothesis.name
    if name not in OF_THE_AXIS and not is_effect(name):
        return "nothing acts under that name"
    return hypothesis.bars(problem)


def barred(problem: AxisProblem) -> dict[str, str]:
    """Return the names that cannot act on an axis or show in its log, and why."""
    reasons: dict[str, list[str]] = {}
    for one in every_hypothesis(problem):
        reasons.setdefault(one.name, []).append(why_not(problem, one))
    return {name: found[0] for name, found in reasons.items() if all(found)}
