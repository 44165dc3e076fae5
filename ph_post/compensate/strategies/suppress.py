"""Feed suppression, section 5 of the paper: a smooth dip of the feed about every turning point."""

from __future__ import annotations

from ph_post.compensate import profile
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.strategies.base import Proposal, Task, Wish
from ph_post.errors import InputError
from ph_post.types import Array, Feedback, TurningPoint, Window

RATIO = 0.25
"""V(½) / V_c by default: the shallow minimum of the error among profiles that keep V >= 0; section 6."""

DEGREE = 10
"""n by default, as in section 6."""

INTERVALS = 4.0
"""Half duration by default, in backlash intervals: section 6 has t_star = 0.5 s for 0.119 s."""


class FeedSuppression:
    """Slow down about every turning point whose axis has a gap."""

    name = "suppress"
    summary = "a smooth feed dip about every turning point, never negative unless allowed"
    feedbacks: frozenset[Feedback] = frozenset(("load", "motor", "none"))

    def profiles(self, task: Task) -> Proposal:
        """Want the same profile in every window in which an axis crosses its gap."""
        coefficients = chosen_coefficients(task.options)
        wishes = tuple(_wish(task, window, coefficients) for window in task.windows)
        return Proposal(wishes=wishes, warnings=_offset_warning(task, wishes))


def chosen_coefficients(options: PlanOptions) -> Array:
    """V_k / V_c as the options want them.

    Raises
    ------
    InputError
        For options that contradict each other, a feed that becomes negative although that is not allowed, or
        one that is negative for so long that the tool would not get through the window.
    """
    if options.coefficients is None:
        where, ratio = "--ratio", RATIO if options.ratio is None else options.ratio
        degree = DEGREE if options.degree is None else options.degree
        profile.check_degree(degree)
        coefficients = profile.coefficients_from_ratio(ratio, degree)
    else:
        where = "--coefficients"
        coefficients = profile.explicit_coefficients(options.coefficients)
        _refuse_both(options, coefficients.size - 1)
    lowest = profile.lowest(coefficients)
    if not options.allow_retrograde and not profile.is_non_negative(coefficients):
        raise InputError(
            where, "the feed would become negative", expected="V >= 0, or --allow-retrograde",
            got=f"V = {lowest:.6g} V_c",
        )  # fmt: skip
    if profile.mean(coefficients) <= 0.0:
        raise InputError(
            where, "the tool would not get through the window", expected="a mean feed above 0",
            got=f"{profile.mean(coefficients):.6g} V_c",
        )  # fmt: skip
    return coefficients


def _refuse_both(options: PlanOptions, degree: int) -> None:
    if options.ratio is not None:
        raise InputError("--coefficients", "the profile is given twice", expected="no --ratio beside them")
    if options.degree is not None and options.degree != degree:
        raise InputError(
            "--degree",
            "the coefficients are of another degree",
            expected=str(degree),
            got=str(options.degree),
        )


def _wish(task: Task, window: Window, coefficients: Array) -> Wish:
    members = [task.turning_points[index] for index in window.members]
    if not any(_lost_motion(task, point) for point in members):
        axes = " and ".join(sorted({point.axis for point in members}))
        return Wish(coefficients=None, note=f"no gap on {axes}")
    durations = [found.duration for found in (task.intervals[p.index] for p in members) if found is not None]
    longest = max(durations, default=0.0)
    if task.options.t_star is not None:
        return Wish(coefficients=coefficients, t_star=task.options.t_star, may_leave=True)
    if longest == 0.0:
        why = next((task.notes[p.index] for p in members if task.notes[p.index]), "no backlash interval")
        return Wish(coefficients=None, note=why)
    return Wish(coefficients=coefficients, t_star=INTERVALS * longest, least=longest)


def _lost_motion(task: Task, point: TurningPoint) -> float:
    return task.machine.axes[point.axis].gap.lost_motion


def _offset_warning(task: Task, wishes: tuple[Wish, ...]) -> tuple[str, ...]:
    """Say which axes keep a lasting offset whatever the feed does."""
    pairs = zip(task.windows, wishes, strict=True)
    modulated = {i for window, wish in pairs if wish.coefficients is not None for i in window.members}
    axes = sorted({task.turning_points[i].axis for i in modulated})
    open_axes = [name for name in axes if task.machine.axes[name].feedback != "load"]
    if not open_axes:
        return ()
    who = f"axis {open_axes[0]} has" if len(open_axes) == 1 else f"axes {', '.join(open_axes)} have"
    return (
        f"{who} no scale on the table: the gap is a lasting offset after each reversal there, which a "
        "modulated feed does not shrink; it only shortens the way travelled meanwhile",
    )


STRATEGY = FeedSuppression()
