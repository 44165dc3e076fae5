"""The options of a compensation, as one record in SI units; those of ``convert`` with ``_`` for ``-``."""

from __future__ import annotations

import math
import os
import re
from collections.abc import Mapping, Sequence
from numbers import Real
from typing import Any, Final, Literal, TypeVar, get_args

import msgspec

from ph_post.bounds import LEAST_CORNER_TOLERANCE, LEAST_TOLERANCE, MOST_EFFORT
from ph_post.compensate.options import PlanOptions, PlanOutput
from ph_post.compensate.profile import check_degree
from ph_post.compensate.strategies.registry import default_strategy, find_traits
from ph_post.drive.intervals import IntervalTable
from ph_post.edit.edits import TOLERANCE, EditOptions
from ph_post.errors import OptionsError, out_of_range, unknown_word
from ph_post.post.options import BLOCK_TIME, CHORD_TOLERANCE, FeedMode, ProgramOptions

T = TypeVar("T", PlanOptions, ProgramOptions, EditOptions)

_NUMBERS = (
    *("tolerance", "feed", "ratio", "t_star", "min_feed", "max_slowdown", "max_standstill"),
    *("effort", "chord_tolerance", "block_time", "safe_z", "depth", "overshoot", "corner_tolerance"),
    "peck_clearance",
)
"""Options that are numbers."""

_RANGES = {
    "tolerance": (LEAST_TOLERANCE, False, math.inf),
    **dict.fromkeys(("feed", "t_star", "min_feed"), (0.0, True, math.inf)),
    **dict.fromkeys(("chord_tolerance", "block_time", "overshoot", "peck_clearance"), (0.0, True, math.inf)),
    "corner_tolerance": (LEAST_CORNER_TOLERANCE, False, math.inf),
    "max_slowdown": (0.0, False, math.inf),
    "max_standstill": (0.0, False, math.inf),
    "effort": (0.0, True, MOST_EFFORT),
}
"""Smallest value, whether it is left out, and largest value."""

_VERSION: Final = re.compile(r"\d{1,3}\.\d{1,3}\.\d{1,3}", re.ASCII)

_WORDS = {
    "start": ("rest", "moving"),
    "feed_mode": get_args(FeedMode),
    "position_from": (None, "+", "-"),
    "part_side": (None, "left", "right"),
    "controller_units": ("mm", "inch"),
}
"""Words that an option may be; None where it need not be given."""


def require_number(name: str, value: Any) -> None:
    """Refuse what is no number of an option, or out of its range; None is none that was given.

    Raises
    ------
    InputError
        With the option's name as the command line has it.
    """
    if value is None:
        return
    low, positive, high = _RANGES.get(name, (-math.inf, False, math.inf))
    number = isinstance(value, Real) and math.isfinite(value)
    if not number or value < low or (positive and value == low) or value > high:
        raise out_of_range(_option(name), value, low, open_low=positive, high=high)


def require_word(name: str, value: object, known: Sequence[str | None]) -> None:
    """Refuse a word that an option does not know.

    Raises
    ------
    InputError
        With the option's name as the command line has it.
    """
    if value not in known:
        raise unknown_word(_option(name), value, [one for one in known if one is not None])


def _option(name: str) -> str:
    return f"--{name.replace('_', '-')}"


PATH_ONLY = ("feed", "corner_tolerance", "safe_z", "depth", "interval_table", "feed_mode")
"""Options that part programs leave out where one set of options serves path files too."""


WHERE_EXPANDED: Final[Mapping[str, Any]] = {
    "subprograms": (),
    "parameters": None,
    "tool_table": None,
    "peck_clearance": None,
    "controller_version": None,
}
"""Options that say how a program is written out, with what they are where they are not given."""


class CompensateOptions(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All options of :func:`ph_post.compensate`.

    Lengths in m, feeds in m/s, times in s. Without a `strategy` it is the default one. With `notes_in_header`
    the head of a program holds the warnings too, for those who see nothing but the program.
    """

    strategy: str | None = None
    tolerance: float = TOLERANCE
    feed: float | None = None
    corner_tolerance: float | None = None
    dialect: str | None = None
    start: Literal["rest", "moving"] = "rest"
    ratio: float | None = None
    degree: int | None = None
    t_star: float | None = None
    coefficients: tuple[float, ...] | None = None
    allow_retrograde: bool = False
    min_feed: float | None = None
    max_slowdown: float = 0.1
    max_standstill: float | None = None
    feed_only: bool = False
    no_inverse_dynamics: bool = False
    effort: float = 1.0
    interval_table: str | os.PathLike[str] | IntervalTable | None = None
    feed_mode: FeedMode = "per-minute"
    chord_tolerance: float = CHORD_TOLERANCE
    block_time: float = BLOCK_TIME
    safe_z: float | None = None
    depth: float | None = None
    position_from: Literal["+", "-"] | None = None
    overshoot: float | None = None
    part_side: Literal["left", "right"] | None = None
    strict: bool = False
    force: bool = False
    require_all: bool = False
    lead_program: bool = False
    expand: bool = False
    subprograms: tuple[str, ...] = ()
    parameters: str | os.PathLike[str] | None = None
    tool_table: str | os.PathLike[str] | None = None
    peck_clearance: float | None = None
    controller_units: Literal["mm", "inch"] = "mm"
    controller_version: str | None = None
    notes_in_header: bool = False

    def __post_init__(self) -> None:
        """Refuse numbers that are none, or out of range.

        Raises
        ------
        InputError
            With the option's name as the command line has it.
        """
        for name in _NUMBERS:
            require_number(name, getattr(self, name))
        for name, known in _WORDS.items():
            require_word(name, getattr(self, name), known)
        if self.controller_version is not None and not _VERSION.fullmatch(self.controller_version):
            raise OptionsError(f"--controller-version: not a version; expected 2.9.4; got {self.controller_version}")
        if self.degree is not None:
            check_degree(self.degree)
        if self.corner_tolerance is not None and self.feed_only:
            raise OptionsError("--corner-tolerance changes the path, and --feed-only leaves it as it is; leave one out")
        if self.lead_program and (self.feed_only or self.no_inverse_dynamics):
            other = "--feed-only" if self.feed_only else "--no-inverse-dynamics"
            raise OptionsError(f"--lead-program writes the lead, and {other} leaves it out; leave one out")
        unused = [name for name in WHERE_EXPANDED if getattr(self, name)]
        if unused and not self.expand:
            option = f"--{unused[0].replace('_', '-')}"
            raise OptionsError(f"{option} is for programs that are written out first; add --expand, or leave it out")

    @property
    def chosen_strategy(self) -> str:
        """Name of the strategy: the one that is asked for, or the default.

        Examples
        --------
        >>> CompensateOptions().chosen_strategy, CompensateOptions(ratio=0.3).chosen_strategy
        ('auto', 'suppress')
        """
        profile = (self.ratio, self.degree, self.t_star, self.coefficients)
        return self.strategy or default_strategy(described=any(one is not None for one in profile))

    def plan(self, output: PlanOutput, *, feed_only: bool = False) -> PlanOptions:
        """Return how to plan the feed for an output; with `feed_only` nothing is added to the path.

        Only a table can lead the path by what the servos lag behind it.
        """
        name = self.chosen_strategy
        leads = output == "table" and not self.no_inverse_dynamics and not find_traits(name).is_baseline
        feeds_only = self.feed_only or feed_only
        return self._as(PlanOptions, strategy=name, inverse_dynamics=leads, feed_only=feeds_only, carrier=output)

    @property
    def writing(self) -> ProgramOptions:
        """Options for writing the program of a path."""
        return self._as(ProgramOptions)

    @property
    def editing(self) -> EditOptions:
        """Options for editing an existing program."""
        return self._as(
            EditOptions,
            part_side={"left": 1, "right": -1}.get(self.part_side or "", 0),
            position_from=0 if self.position_from is None else int(f"{self.position_from}1"),
        )

    def _as(self, record: type[T], **own: object) -> T:
        """Return a record of the options that have the names of its fields, and of its `own`."""
        same = {name: value for name, value in msgspec.structs.asdict(self).items() if name in record.__struct_fields__}
        return record(**{**same, **own})

    def without_path_options(self) -> CompensateOptions:
        """Return the options that part programs have, where one set serves path files too.

        Examples
        --------
        >>> CompensateOptions(feed=0.02, max_slowdown=0.2).without_path_options().feed is None
        True
        """
        plain = CompensateOptions()
        return msgspec.structs.replace(self, **{name: getattr(plain, name) for name in PATH_ONLY})

    def without_expansion(self) -> CompensateOptions:
        """Return the options of a program that is not written out.

        Examples
        --------
        >>> CompensateOptions(expand=True, tool_table="tool.tbl").without_expansion().tool_table is None
        True
        """
        return msgspec.structs.replace(self, expand=False, **WHERE_EXPANDED)

    def check_for_path(self) -> None:
        """Refuse options that are for part programs alone.

        Raises
        ------
        InputError
            With the option's name as the command line has it.
        """
        given = {
            "--position-from": self.position_from is not None,
            "--overshoot": self.overshoot is not None,
            "--expand": self.expand,
        }
        refused = next((option for option, used in given.items() if used), None)
        if refused is not None:
            raise OptionsError(f"{refused} is for part programs")

    def check_for_program(self) -> None:
        """Refuse options that a part program, which has its own feeds and heights, has no use for.

        Raises
        ------
        InputError
            With the option's name as the command line has it.
        """
        given = {
            "--feed": self.feed is not None,
            "--corner-tolerance": self.corner_tolerance is not None,
            "--safe-z": self.safe_z is not None,
            "--depth": self.depth is not None,
            "--interval-table": self.interval_table is not None,
            "--feed-mode": self.feed_mode != "per-minute",
            "--start moving": self.start != "rest",
            f"--strategy {self.strategy}": self.strategy is not None and find_traits(self.strategy).moves_back,
            "--allow-retrograde": self.allow_retrograde,
        }
        refused = next((option for option, used in given.items() if used), None)
        if refused is not None:
            raise OptionsError(f"{refused} is for path files; a part program keeps its own")
