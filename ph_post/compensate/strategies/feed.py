"""Shared parts of the strategies that only modulate the feed: the windows they act in, and the options they refuse."""

from __future__ import annotations

from collections.abc import Callable

from ph_post.compensate import profile, shapes
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult
from ph_post.drive.axes import axis_at
from ph_post.errors import InputError
from ph_post.types import ProfileShape, Window

DEGREE = 10
"""n of Eq. (26) by default, as in section 6."""

INTERVALS = 4.0
"""Half duration by default, in backlash intervals: section 6 has t_star = 0.5 s for 0.119 s."""


def propose(task: PlanningTask, want: Callable[[Window, float], ProfileRequest]) -> StrategyResult:
    """Ask for a profile in every window in which an axis crosses its gap.

    Parameters
    ----------
    task : PlanningTask
    want : callable
        The request in a window whose longest backlash interval is so many seconds; 0 where none is known, but
        the user has chosen a duration.

    Returns
    -------
    StrategyResult
        With a warning where a loop is not closed over the table.
    """
    requests = tuple(_request(task, window, want) for window in task.windows)
    return StrategyResult(requests=requests, warnings=_offset_warning(task, requests))


def request_in_intervals(task: PlanningTask, shape: ProfileShape, longest: float) -> ProfileRequest:
    """Want a shape for some backlash intervals, or as long as the user has it."""
    if task.options.t_star is not None:
        return ProfileRequest(shape=shape, t_star=task.options.t_star, may_leave_window=True)
    return ProfileRequest(shape=shape, t_star=INTERVALS * longest, least=longest)


def chosen_shape(options: PlanOptions, ratio: float) -> ProfileShape:
    """Eq. (26) as the options want it, with V(½) / V_c = `ratio` where they do not say.

    Raises
    ------
    InputError
        For options that contradict each other, a feed that becomes negative although that is not allowed, or
        one that is negative for so long that the tool would not get through the window.
    """
    if options.coefficients is None:
        ratio = ratio if options.ratio is None else options.ratio
        shape = profile.dip(ratio, DEGREE if options.degree is None else options.degree)
        return passable(shape, "--ratio", options)
    coefficients = profile.explicit_coefficients(options.coefficients)
    _refuse_both(options, coefficients.size - 1)
    return passable(shapes.single(coefficients), "--coefficients", options)


def passable(shape: ProfileShape, where: str, options: PlanOptions) -> ProfileShape:
    """Return a shape that gets the tool through its window, forwards all the way unless allowed otherwise.

    Raises
    ------
    InputError
        Naming the option `where` for any other shape.
    """
    if not options.allow_retrograde and not shapes.is_non_negative(shape):
        raise InputError(
            where,
            "the feed would become negative",
            expected="V >= 0, or --allow-retrograde",
            got=f"V = {shapes.lowest(shape):.6g} V_c",
        )
    if shapes.mean(shape) <= 0.0:
        raise InputError(
            where,
            "the tool would not get through the window",
            expected="a mean feed above 0",
            got=f"{shapes.mean(shape):.6g} V_c",
        )
    return shape


def refuse_options(options: PlanOptions, strategy: str, *names: str) -> None:
    """Refuse options of Eq. (26) that mean nothing to a strategy.

    Raises
    ------
    InputError
        Where one of the fields `names` is given.
    """
    for name in names:
        if getattr(options, name) is not None:
            option = f"--{name.replace('_', '-')}"
            raise InputError(option, f"strategy {strategy} does not take it", expected=f"no {option}")


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


def _request(task: PlanningTask, window: Window, want: Callable[[Window, float], ProfileRequest]) -> ProfileRequest:
    members = [task.turning_points[index] for index in window.members]
    drives = (axis_at(task.machine.axes[point.axis], point.position) for point in members)
    if not any(axis.gap.lost_motion for axis in drives):
        axes = " and ".join(sorted({point.axis for point in members}))
        return ProfileRequest(shape=None, note=f"no backlash on {axes}")
    durations = [found.duration for found in (task.intervals[p.index] for p in members) if found is not None]
    longest = max(durations, default=0.0)
    if longest == 0.0 and task.options.t_star is None:
        why = next((task.notes[p.index] for p in members if task.notes[p.index]), "no backlash interval")
        return ProfileRequest(shape=None, note=why)
    return want(window, longest)


def modulated_axes(task: PlanningTask, requests: tuple[ProfileRequest, ...]) -> list[str]:
    """Names of the axes that reverse in a window for which a profile is wanted."""
    pairs = zip(task.windows, requests, strict=True)
    modulated = {i for window, request in pairs if request.shape is not None for i in window.members}
    return sorted({task.turning_points[i].axis for i in modulated})


def _offset_warning(task: PlanningTask, requests: tuple[ProfileRequest, ...]) -> tuple[str, ...]:
    """Warn of axes that keep a lasting offset whatever the feed does."""
    axes = modulated_axes(task, requests)
    open_axes = [name for name in axes if not task.machine.axes[name].loop.encloses_backlash]
    if not open_axes:
        return ()
    who = f"axis {open_axes[0]} has" if len(open_axes) == 1 else f"axes {', '.join(open_axes)} have"
    return (
        f"{who} no scale on the table: after each reversal the backlash stays as an offset. A modulated feed "
        "does not shrink that, it only shortens the way travelled meanwhile",
    )
