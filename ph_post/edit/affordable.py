"""Choose the reversals of a program that are worth their time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import chain, groupby, pairwise
from operator import itemgetter
from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.compensate.plan_warnings import round_up
from ph_post.edit.crossings import COARSER, FINE
from ph_post.edit.edits import EditOptions
from ph_post.edit.reversal_search import ReversalSearch, joined_spans
from ph_post.edit.reversals import MOTION, SIGN
from ph_post.gcode.program import AXES
from ph_post.types import Array, ExactPath, IntArray
from ph_post.units import MM

SPARE: Final = 3e-3
"""Part of a program's time that does not count as slower."""

TAKEN_BACK: Final = 6
"""Axes in sections, of those that were left, of which it is tried whether there is time for them after all."""

PARTS: Final = 100
"""Parts into which sections are divided where there is no time for all, by what crossings cost."""

MOSTLY: Final = 0.5
"""A section that has more than this part of what all gain is nearly the whole program."""

HARDLY: Final = 0.05
"""Crossings that take no more than this part longer than coarser ones leave the part better than those do."""

_HALVINGS: Final = 6
"""Halvings of the range of the dead band, and of the time for parts of sections, down to a sixtieth of it."""


_NAMED: Final = 0.005
"""Least cost of crossings that is said in words [s]."""


class AxisInSections(NamedTuple):
    """An axis in some sections: the time that its crossings there cost [s], and what they gain [m² s]."""

    sections: list[int]
    cost: float
    gain: float


class AffordedChanges(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Changes within the time allowed: by axis the rows of :func:`~ph_post.edit.reversals.find_reversals`.

    `coarser` is the largest error of crossings as a multiple of the least, `slowdown` what they cost, relative;
    `short` where that is too much for all of them, or for fine ones, and `spared` the parts that are left for that, as
    in :class:`~ph_post.edit.edits.EditOptions`.
    """

    changes: dict[str, Array]
    coarser: float
    slowdown: float
    warnings: list[str]
    short: bool = False
    spared: frozenset[tuple[str, int, int]] = frozenset()


def affordable_reversals(search: ReversalSearch, options: EditOptions) -> AffordedChanges:
    """Find the changes that keep within the allowed slowdown.

    The dead band begins with the tolerance, and crossings with their least error. Where that costs too much, crossings
    may be coarser; then sections are left alone whose crossings cost most for what they gain, and where there is but
    one, axes; last the dead band is raised, up to half the lost motion of each axis.
    """
    # Ramps and rapids take longer than the motions at their feeds.
    total = max(search.time, options.cycle, 1e-9)
    # What the planner takes is known to a few thousandths.
    allowed = (options.max_slowdown + SPARE) * total
    found = _search_raised(search, options, 0.0)
    while search.unsplit(found):
        found = _search_raised(search, options, 0.0)
    every = search.cost(found)
    need = round_up(options.pace * every / total)
    if options.spared:
        _leave_spared(search, options, need)
        found = _search_raised(search, options, 0.0)
        every = search.cost(found)
    costs: dict[float, float] = {}
    for coarser in (1.0, *COARSER):
        cost = costs[coarser] = every if coarser == 1.0 else search.cost(found, coarser)
        if cost <= allowed:
            if options.shave > 0.0:
                _shave(search, options, found, coarser, options.shave * total, need)
                found = _search_raised(search, options, 0.0)
                cost = search.cost(found, coarser)
            return AffordedChanges(
                changes=found,
                coarser=coarser,
                slowdown=cost / total,
                warnings=search.warnings,
                short=coarser >= FINE or bool(options.spared) or options.shave > 0.0,
                spared=options.spared,
            )
    coarser = _coarseness(search, costs)
    _leave_costly(search, options, coarser, allowed, need)
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if _fits(search, options, coarser, allowed, middle) else (middle, high)
    found = _search_raised(search, options, high)
    widest = max(_bands(search, options, high).values())
    said = [
        f"moves below {widest / MM:.4g} mm are ignored to keep within --max-slowdown:"
        f" --max-slowdown {need:g} would compensate all above {options.tolerance / MM:g} mm"
    ]
    return AffordedChanges(
        changes=found,
        coarser=coarser,
        slowdown=search.cost(found, coarser) / total,
        warnings=[*search.warnings, *(said if any(len(rows) for rows in found.values()) else [])],
        short=True,
        spared=options.spared | {(name, int(search.low[n]), int(search.high[n])) for name, n, _ in search.for_now},
    )


def _coarseness(search: ReversalSearch, costs: Mapping[float, float]) -> float:
    """Return the largest error of crossings as a multiple of the least, where there is no time for all of them.

    `costs` are what they take at each [s]. On an exact path it is the smallest coarser one that hardly takes longer
    than any other: what has to be left for it is little.
    """
    if not isinstance(search.crossings.ground.planner, ExactPath):
        return COARSER[-1]
    least = min(costs[coarser] for coarser in COARSER)
    return next(coarser for coarser in COARSER if costs[coarser] <= (1.0 + HARDLY) * least)


def _leave_spared(search: ReversalSearch, options: EditOptions, need: float) -> None:
    """Leave the parts again for which an earlier plan had no time: what it does elsewhere stays as it was."""
    spared = sorted(options.spared)
    for _, begin, end in spared:
        search.divided(begin, end)
    places = [(name, n) for name, begin, end in spared for n in search.divided(begin, end) if search.open[name][n]]
    costs = _section_costs(search, _search_raised(search, options, 1.0), COARSER[-1])
    price = dict.fromkeys(costs, 0.0)
    for name, n in places:
        price[name] += options.pace * float(costs[name][n])
    for name, n in places:
        search.give_up(name, n, too_costly(price[name], need))


def _shave(
    search: ReversalSearch, options: EditOptions, found: dict[str, Array], coarser: float, time: float, need: float
) -> None:
    """Leave all axes in the parts that gain least for their time, as many as take a time [s]."""
    gain = np.sum([search.gain(name, rows) for name, rows in found.items()], axis=0)
    parts = _SectionParts(search, found, gain, largest_first=False, coarser=coarser)
    why = {name: too_costly(options.pace * cost, need) for name, cost in parts.cost.items()}
    for begin, end in parts.left(max(sum(parts.cost.values()) - time, 0.0)):
        _give_up_between(search, begin, end, why)


def _give_up_between(
    search: ReversalSearch, begin: int, end: int, why: Mapping[str, str], *, for_now: bool = False
) -> None:
    """Leave axes from a motion on to before another, for the reason of each."""
    search.divided(end, end)
    for n in search.divided(begin, end):
        for name, reason in why.items():
            search.give_up(name, n, reason, for_now=for_now)


def _leave_costly(search: ReversalSearch, options: EditOptions, coarser: float, allowed: float, need: float) -> None:
    """Leave sections alone, or axes in them, until the widest dead band keeps within the time allowed.

    What is gained are the squares of the offsets for as long as an axis cuts with them. What is kept may cost more once
    its neighbours are gone: of that goes then what gains least for its time.
    """
    found = _search_raised(search, options, 1.0)
    cost = _section_costs(search, found, coarser)
    gain = {name: search.gain(name, rows) for name, rows in found.items()}
    every = np.sum(list(gain.values()), axis=0)
    # Of a print that is one section, or nearly so, no axis is left from its beginning to its end.
    whole = search.crossings.ground.beam.tends and every.max(initial=0.0) > MOSTLY * every.sum()
    if options.in_parts or whole:
        _leave_behind(search, options, coarser, allowed, need, found, every)
        if options.in_parts or any(rows.size for rows in _search_raised(search, options, 1.0).values()):
            return
        search.take_again(search.for_now)
    _leave_axes(search, options, coarser, allowed, need, cost, gain)
    _take_back(search, options, coarser, allowed)


def _leave_axes(
    search: ReversalSearch,
    options: EditOptions,
    coarser: float,
    allowed: float,
    need: float,
    cost: Mapping[str, Array],
    gain: Mapping[str, Array],
) -> None:
    """Leave axes in sections alone, by what they cost [s] and gain there (s,)."""
    places = {
        (name, own[0]): AxisInSections(own, float(cost[name][own].sum()), float(gain[name][own].sum()))
        for name in cost
        for own in _runs(np.flatnonzero(search.open[name]), gain[name])
    }
    if sum(place.cost for place in places.values()) <= allowed:
        return
    kept = worth_most(places, allowed, largest_first=options.largest_first)
    order = sorted(places, key=lambda one: (one in kept, _worth([places[one]], options.largest_first), one))

    def leave(count: int) -> None:
        search.take_again(search.for_now)
        price = dict.fromkeys(cost, 0.0)
        for place in order[:count]:
            price[place[0]] += options.pace * places[place].cost
        for place in reversed(order[:count]):
            why = too_costly(price[place[0]], need)
            for n in places[place].sections:
                search.give_up(place[0], n, why, for_now=True)

    low, high = len(places) - len(kept), len(places)
    leave(low)
    if _fits(search, options, coarser, allowed):
        return
    while high - low > 1:
        middle = (low + high) // 2
        leave(middle)
        low, high = (low, middle) if _fits(search, options, coarser, allowed) else (middle, high)
    leave(high)


def _leave_behind(
    search: ReversalSearch,
    options: EditOptions,
    coarser: float,
    allowed: float,
    need: float,
    found: dict[str, Array],
    gain: Array,
) -> None:
    """Leave all axes that reverse there from a place in a section on, and sections that gain less for their time.

    Where that is still too much, axes that do not reverse there are left too. `gain` (s,) is that of all axes.
    """
    parts = _SectionParts(search, found, gain, largest_first=options.largest_first, coarser=coarser)
    turns = {name: np.sort(rows[rows[:, SIGN] != 0.0, MOTION]) for name, rows in found.items()}
    why = {name: too_costly(options.pace * cost, need) for name, cost in parts.cost.items()}

    def leave(budget: float, *, resting: bool) -> None:
        search.take_again(search.for_now)
        for begin, end in parts.left(budget):
            names = found if resting else _turning(turns, begin, end)
            _give_up_between(search, begin, end, {name: why[name] for name in names}, for_now=True)

    # Where many cuts are left, the axes that keep their offset take it back so often that there is no time for that.
    for resting in (False, True):
        low, high = 0.0, allowed
        leave(high, resting=resting)
        if _fits(search, options, coarser, allowed):
            return
        # It costs something to begin and to end between two cuts.
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            leave(middle, resting=resting)
            low, high = (middle, high) if _fits(search, options, coarser, allowed) else (low, middle)
        leave(low, resting=resting)
        if low > 0.0 or _fits(search, options, coarser, allowed):
            return


def _turning(turns: Mapping[str, Array], begin: int, end: int) -> list[str]:
    """Return the axes that reverse from a motion on to before another: the others keep the offset that they have.

    `turns` are the motions (n,) in which each axis reverses, in order.
    """
    return [name for name, motions in turns.items() if np.less(*np.searchsorted(motions, (begin, end)))]


class _SectionParts:
    """The sections of a program in the order of what they gain for their time, all axes together.

    Where a nozzle or a beam is led through the air between its works, they are divided there: a print is one section,
    in which infill costs more for what it gains than walls.

    Parameters
    ----------
    search : ReversalSearch
    found : dict
        Changes by axis.
    gain : Array, shape (s,)
        Of all axes in each section.
    largest_first : bool
        The order is that of the gain alone.
    coarser : float
        Errors of the crossings, as a multiple of the least.
    """

    def __init__(
        self,
        search: ReversalSearch,
        found: dict[str, Array],
        gain: Array,
        *,
        largest_first: bool,
        coarser: float,
    ) -> None:
        spots, times = search.crossings.costs(found, coarser)
        motion = spots.rows[:, MOTION].astype(np.int64)
        self.cost = {name: float(times[spots.column == AXES.index(name)].sum()) for name in found}
        """Time [s] that all crossings of an axis take."""
        opened = np.any([search.open[name] for name in found], axis=0)
        runs = _runs(np.flatnonzero(opened), gain)
        self._begin = np.array([search.low[own[0]] for own in runs], dtype=np.int64)
        self._end = np.array([search.high[own[-1]] for own in runs], dtype=np.int64)
        self._whole = search.crossings.ground.beam.tends
        if self._whole and runs:
            self._divide(search, motion, times)
        part = np.searchsorted(self._begin, motion, side="right") - 1
        inside = (part >= 0) & (motion < self._end[part])
        part[~inside] = self._begin.size
        gain = np.sum([search.gain(name, rows, self._begin, self._end) for name, rows in found.items()], axis=0)
        cost = np.bincount(part, times, self._begin.size + 1)[:-1]
        self._order = np.argsort(-gain / (1.0 if largest_first else np.maximum(cost, 1e-12)), kind="stable").tolist()
        order = np.argsort(part, kind="stable")
        ends = np.searchsorted(part[order], np.arange(self._begin.size + 1))
        self._times, self._motion = times[order], motion[order]
        self._spans = [slice(first, end) for first, end in pairwise(ends.tolist())]
        """Which of the times and motions belong to each part."""

    def _divide(self, search: ReversalSearch, motion: IntArray, times: Array) -> None:
        """Divide the parts where the tool begins to work, into such that do not cost too little."""
        on = search.crossings.ground.beam.works.on
        starts = np.flatnonzero(on[1:] & ~on[:-1]) + 1
        part = np.searchsorted(self._begin, starts, side="right") - 1
        # What only leads to the first work of a part is none of its own: it could not be left without that.
        works = np.append(0, np.cumsum(on))
        starts = starts[(part >= 0) & (starts < self._end[part]) & (works[starts] > works[self._begin[part]])]
        order = np.argsort(motion, kind="stable")
        spent = np.append(0.0, np.cumsum(times[order]))[np.searchsorted(motion[order], starts)]
        kept = np.diff(np.floor(spent * (PARTS / max(float(times.sum()), 1e-12))), prepend=0.0) > 0.0
        begin = np.union1d(self._begin, starts[kept])
        self._end = np.minimum(
            np.append(begin[1:], self._end[-1]), self._end[np.searchsorted(self._begin, begin, side="right") - 1]
        )
        self._begin = begin

    def left(self, budget: float) -> list[tuple[int, int]]:
        """Return the motions, from one to before another, for which a time [s] is too short."""
        found: list[tuple[int, int]] = []
        for part in self._order:
            here = self._spans[part]
            spent = np.cumsum(self._times[here])
            cost = float(spent[-1]) if spent.size else 0.0
            if cost > budget:
                place = self._begin[part] if self._whole else self._motion[here][np.argmax(spent > budget)]
                found.append((int(place), int(self._end[part])))
                budget = budget if self._whole else 0.0
            else:
                budget -= cost
        return joined_spans(sorted(found))


def too_costly(price: float, need: float) -> str:
    """Return why crossings of an axis are left that take a time [s], and what share of it would allow them.

    >>> too_costly(0.2, 0.15)
    'its crossings would cost 0.2 s; --max-slowdown 0.15 would allow them'
    >>> too_costly(0.0, 0.15)
    'its crossings come with others, which would cost too much; --max-slowdown 0.15 would allow them'
    """
    cost = f"would cost {price:.2g} s" if price >= _NAMED else "come with others, which would cost too much"
    return f"its crossings {cost}; --max-slowdown {need:g} would allow them"


def _runs(sections: IntArray, gain: Array) -> list[list[int]]:
    """Return the sections in runs: one that gains something, and those behind it that gain nothing.

    Where an axis carries nothing it is no gain to leave it alone: it would be wound up once more behind that.
    """
    begins = np.flatnonzero(gain[sections] > 0.0)[1:]
    return [run.tolist() for run in np.split(sections, begins) if run.size]


def worth_most(
    places: Mapping[tuple[str, int], AxisInSections], allowed: float, *, largest_first: bool = False
) -> set[tuple[str, int]]:
    """Return the axes in sections that gain most in the time allowed [s].

    First come those that gain most for their time, or those that gain most where more is gained so, or where that is
    asked for. One of two axes alone may gain nothing: those of a section come first together where as much is gained
    so.

    Examples
    --------
    >>> places = {("X", 0): AxisInSections([0], cost=0.1, gain=2.0), ("Y", 0): AxisInSections([0], cost=0.9, gain=9.0)}
    >>> worth_most(places, 0.95)
    {('Y', 0)}
    """
    single = [[place] for place in places]
    whole = [list(own) for _, own in groupby(sorted(places, key=itemgetter(1, 0)), key=itemgetter(1))]

    def taken(units: list[list[list[tuple[str, int]]]], largest: bool) -> set[tuple[str, int]]:
        found: set[tuple[str, int]] = set()
        spent = 0.0
        ordered = (sorted(some, key=lambda one: -_worth([places[place] for place in one], largest)) for some in units)
        for unit in chain.from_iterable(ordered):
            cost = sum(places[place].cost for place in unit if place not in found)
            if spent + cost <= allowed:
                spent += cost
                found.update(unit)
        return found

    orders = (True,) if largest_first else (False, True)
    tried = [taken(units, largest) for units in ([whole, single], [single]) for largest in orders]
    return max(tried, key=lambda found: sum(places[place].gain for place in found))


def _worth(places: Sequence[AxisInSections], largest_first: bool) -> float:
    """Return what ranks some axes in sections among others: their gain, for its time where the largest is not first."""
    gain = sum(place.gain for place in places)
    return gain if largest_first else gain / max(sum(place.cost for place in places), 1e-12)


def _take_back(search: ReversalSearch, options: EditOptions, coarser: float, allowed: float) -> None:
    """Take again what costs no more than is left: axes that come to a place together wait there together."""
    for place in list(search.for_now[:TAKEN_BACK]):
        search.take_again([place])
        if not _fits(search, options, coarser, allowed):
            search.give_up(*place, for_now=True)


def _fits(search: ReversalSearch, options: EditOptions, coarser: float, allowed: float, raised: float = 1.0) -> bool:
    return search.cost(_search_raised(search, options, raised), coarser) <= allowed


def _section_costs(search: ReversalSearch, found: dict[str, Array], coarser: float) -> dict[str, Array]:
    """Time that the changes of each axis cost in every section [s], by axis (s,)."""
    spots, times = search.crossings.costs(found, coarser)
    costs = {name: np.zeros(search.low.size) for name in found}
    for name, cost in costs.items():
        own = spots.column == AXES.index(name)
        np.add.at(cost, search.section_of(spots.rows[own, MOTION]), times[own])
    return costs


def _search_raised(search: ReversalSearch, options: EditOptions, raised: float) -> dict[str, Array]:
    return search.changes(_bands(search, options, raised))


def _bands(search: ReversalSearch, options: EditOptions, raised: float) -> dict[str, float]:
    """Dead bands by axis [m]: `raised` from the tolerance (0) to half the lost motion (1)."""
    return {
        name: options.tolerance + raised * max(0.5 * (plus - minus) - options.tolerance, 0.0)
        for name, (minus, plus) in search.sides.items()
    }
