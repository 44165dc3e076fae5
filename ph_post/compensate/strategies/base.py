"""The contract of a strategy.

A strategy requests a profile for every window. It knows the windows, the backlash
intervals, the drives and the user's options; it knows nothing of the limits: a profile that does not fit is
shortened or softened by the planner, and the plan says so.

To add one: write a class with the members of :class:`Strategy`, make one instance of it, and register that as
entry point of the group ``ph_post.strategies``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable
from typing import Literal, Protocol, runtime_checkable

import msgspec

from ph_post.analysis.path_analysis import AnalysedPath, Analysis
from ph_post.compensate.motion import FeedAlong
from ph_post.compensate.options import PlanOptions
from ph_post.drive.axes import sized_machine
from ph_post.errors import InputError
from ph_post.progress import Progress, no_progress
from ph_post.types import (
    Crossing,
    Feedback,
    FrictionChange,
    Jog,
    Machine,
    Path,
    ProfileShape,
)


class PlanningTask(msgspec.Struct, AnalysedPath, frozen=True, kw_only=True, eq=False):
    """The job that a strategy answers: path, machine, options, and the time allowed.

    `feed` is the feed of the plain plan along the path, `looped` whether that runs through the seam,
    `duration` [s] how long it takes; `allowed` [s] is the time that may be added to it. `progress` is called with
    what a long search is doing.
    """

    analysis: Analysis
    feed: FeedAlong
    looped: bool
    duration: float
    allowed: float
    machine: Machine
    options: PlanOptions
    progress: Progress = no_progress

    @property
    def sized(self) -> Machine:
        """The machine to size crossings of the gap by."""
        return sized_machine(self.machine, self.turning_points)

    @property
    def path(self) -> Path:
        """The path."""
        return self.analysis.path

    @property
    def notes(self) -> tuple[str, ...]:
        """One word about every turning point."""
        return self.analysis.notes


class ProfileRequest(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The profile wanted in one window.

    `shape` is V / V_c, None to leave the window alone; `t_star` [s] is the half duration wanted,
    infinite for as long as the window; `least` [s] the half duration below which the profile is of less use.
    `turn` is the share of the profile's way that lies before the turning point. The default is the middle of
    the way, as Eq. (29) of the paper places coefficients that are not symmetric either: s_* of Eq. (27) is
    measured both ways, and the turning point is not passed in the middle of the time then. `shapes.share_of_way`
    returns the share for another instant τ, as of a hold. It stays where
    the profile is softened, while the instant moves a little.
    `crossings` are those of the gap, their start counted from the middle of the profile's time; where there
    is none, a lasting offset is changed all the same, around the turning point. `friction` are changes of the
    direction in which friction is led, counted likewise; others are made as quickly as may be.
    `may_leave_window` lets it leave the window in which the osculating circle stands for the path. `note` says why
    the window is left alone, or whatever else the user should know. `stop` has the plain motion rest at the
    turning point, for a crossing there. `slowed` is the part of its feed with which the plain motion passes the turning
    point, where there is neither profile nor stop. `strategy` names what was chosen where a strategy chooses among
    others.
    """

    shape: ProfileShape | None
    t_star: float = math.inf
    least: float = 0.0
    turn: float = 0.5
    may_leave_window: bool = False
    crossings: tuple[Crossing | Jog, ...] = ()
    friction: tuple[FrictionChange, ...] = ()
    stop: bool = False
    slowed: float = 1.0
    strategy: str = ""
    note: str = ""


class StrategyResult(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A strategy's answer: one request a window, and warnings about the job as a whole.

    `proven` asks for a proof by simulation: changes that make any error larger than the plain program's are removed.
    `friction_part` is how much of the axes' friction the command leads, where it has inverse dynamics,
    and `friction_first` [s] how long the path waits for that at its start.
    `shorter` makes a result that takes about a part of the time that this one adds, `longer_at` one that takes more of
    it at some windows, where what this one asks for cannot be had. `shifted` are axes that
    carry a lasting offset even if no request crosses their gap, as on a path whose turns are all corners; a part
    program can only if the motion stops at each of their reversals. `crosses_by` names the strategy by which
    crossings are made where no profile names one; by default it is the one that answers. Without `winds_up` no time
    is spent on bringing axes onto their sides before the path of a table begins; with `pushes_first` axes whose gap is
    inside their loop are pushed onto theirs, too; where it `carries`, they cross it while they rest, wherever they do.
    """

    requests: tuple[ProfileRequest, ...]
    proven: bool = False
    shorter: Callable[[float], StrategyResult] | None = None
    longer_at: Callable[[Collection[int]], StrategyResult] | None = None
    shifted: tuple[str, ...] = ()
    crosses_by: str = ""
    winds_up: bool = True
    pushes_first: bool = False
    carries: bool = False
    rests: bool = True
    rivals: tuple[StrategyResult, ...] = ()
    friction_part: float = 0.0
    friction_first: float = 0.0
    warnings: tuple[str, ...] = ()


class StrategyTraits(msgspec.Struct, frozen=True, kw_only=True):
    """Properties of a strategy on which rules elsewhere depend, with the values of most strategies.

    `compensates` is false for the plain program alone. `is_baseline` marks what machines do today, which is
    planned without inverse dynamics. `chooses` marks a strategy that chooses among others at every turning
    point, `shifts_axes` one that gives axes behind their loop a lasting offset, `moves_back` one whose feed
    becomes negative. `default_for` is what the strategy is taken for where nobody names one: any job, or a
    described profile.
    """

    compensates: bool = True
    is_baseline: bool = False
    chooses: bool = False
    shifts_axes: bool = False
    moves_back: bool = False
    default_for: Literal["", "job", "profile"] = ""


@runtime_checkable
class Strategy(Protocol):
    """A compensation strategy: what a user names and what the planner asks.

    1. `name` is what the user types; `summary` one line about it.
    2. `feedbacks` are the feedback loops whose backlash it can shrink. On a path none of whose axes has one
       of them it is refused, see :func:`require_loop`.
    3. `profiles` returns exactly one request a window, in their order. It raises InputError for options that
       contradict each other, and is otherwise a pure function of the task.
    4. `traits`, which may be left out, is a :class:`StrategyTraits`, see :func:`traits_of`.
    """

    @property
    def name(self) -> str:
        """The name that the user types."""

    @property
    def summary(self) -> str:
        """One line about it."""

    @property
    def feedbacks(self) -> frozenset[Feedback]:
        """Feedback loops whose backlash it can shrink."""

    def profiles(self, task: PlanningTask) -> StrategyResult:
        """Return the profile wanted in every window."""


def traits_of(strategy: Strategy) -> StrategyTraits:
    """Return the traits of a strategy, the usual ones where it has none of its own."""
    return getattr(strategy, "traits", StrategyTraits())


def require_loop(strategy: Strategy, axes: Iterable[str], machine: Machine) -> None:
    """Refuse a strategy that fits the feedback loop of none of the axes.

    Raises
    ------
    InputError
    """
    loops = {name: machine.axes[name].feedback for name in axes}
    if not strategy.feedbacks.intersection(loops.values()):
        raise InputError(
            "--strategy",
            f"{strategy.name} does not compensate axes with these feedback loops",
            expected=f"feedback {' or '.join(sorted(strategy.feedbacks))}",
            got=", ".join(f"{axis}: {loop}" for axis, loop in loops.items()),
        )
