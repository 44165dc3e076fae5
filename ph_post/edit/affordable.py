"""Choose the reversals of a program that are worth their time."""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.plan_warnings import round_up
from ph_post.edit.crossings import COARSER
from ph_post.edit.edits import EditOptions
from ph_post.edit.reversal_search import ReversalSearch
from ph_post.edit.reversals import MOTION
from ph_post.gcode.program import AXES
from ph_post.types import Array
from ph_post.units import MM

SPARE: Final = 3e-3
"""Part of a program's time that does not count as slower."""

LEAVING_ROUNDS: Final = 6
"""Times that sections are chosen to be left alone before the dead band is raised."""

TIGHTER: Final = 0.98
"""Part of what should be enough that is allowed the next time."""

TAKEN_BACK: Final = 6
"""Axes in sections, of those that were left, of which it is tried whether there is time for them after all."""

_HALVINGS: Final = 6
"""Halvings of the range of the dead band, down to a sixtieth of it."""


class AffordedChanges(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Changes within the time allowed: by axis the rows of :func:`~ph_post.edit.reversals.find_reversals`.

    `coarser` is the largest error of crossings as a multiple of the least, `slowdown` what they cost, relative;
    `short` where that is too much for all of them.
    """

    changes: dict[str, Array]
    coarser: float
    slowdown: float
    warnings: list[str]
    short: bool = False


def affordable_reversals(search: ReversalSearch, options: EditOptions) -> AffordedChanges:
    """Find the changes that keep within the allowed slowdown.

    The dead band begins with the tolerance, and crossings with their least error. Where that costs too much, crossings
    may be coarser; then sections are left alone whose crossings cost most for what they gain, and where there is but
    one, axes; last the dead band is raised, up to half the lost motion of each axis.
    """
    # Ramps and rapids take longer than the motions at their feeds.
    total = max(float(search.times.sum()), options.cycle, 1e-9)
    # What the planner takes is known to a few thousandths.
    allowed = (options.max_slowdown + SPARE) * total
    found = _search_raised(search, options, 0.0)
    while search.unsplit(found):
        found = _search_raised(search, options, 0.0)
    every = search.cost(found)
    for coarser in (1.0, *COARSER):
        cost = every if coarser == 1.0 else search.cost(found, coarser)
        if cost <= allowed:
            return AffordedChanges(changes=found, coarser=coarser, slowdown=cost / total, warnings=search.warnings)
    budget = allowed
    for number in range(LEAVING_ROUNDS):
        if number:
            search.take_again(search.for_now)
        _leave_costly(search, options, budget, round_up(every / total))
        # What is left may cost more once its neighbours are gone.
        cost = search.cost(_search_raised(search, options, 1.0), COARSER[-1])
        if cost <= allowed:
            break
        budget *= TIGHTER * allowed / cost
    _take_back(search, options, allowed)
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        kept = search.cost(_search_raised(search, options, middle), COARSER[-1]) <= allowed
        low, high = (low, middle) if kept else (middle, high)
    found = _search_raised(search, options, high)
    widest = max(_bands(search, options, high).values())
    said = [
        f"moves below {widest / MM:.4g} mm are ignored to keep within --max-slowdown:"
        f" --max-slowdown {round_up(every / total):g} would compensate all above {options.tolerance / MM:g} mm"
    ]
    return AffordedChanges(
        changes=found,
        coarser=COARSER[-1],
        slowdown=search.cost(found, COARSER[-1]) / total,
        warnings=[*search.warnings, *(said if any(len(rows) for rows in found.values()) else [])],
        short=True,
    )


def _leave_costly(search: ReversalSearch, options: EditOptions, allowed: float, need: float) -> None:
    """Leave sections alone, or axes in them, until the widest dead band keeps within the time allowed.

    First go those that cost most for what they gain: the squares of the offsets for as long as they cut with them. What
    is cheap may leave too little time for what gains most: that can be asked for first.
    """
    found = _search_raised(search, options, 1.0)
    cost = _section_costs(search, found)
    total = sum(float(one.sum()) for one in cost.values())
    if total <= allowed:
        return
    gain = {name: search.gain(name, rows) for name, rows in found.items()}

    left = {(name, n) for name in cost for n in np.flatnonzero(cost[name]).tolist()}
    spent = 0.0
    for units in (
        [(set(cost), n) for n in range(search.low.size)],
        [({name}, n) for n in range(search.low.size) for name in cost],
    ):

        def worth(unit: tuple[set[str], int]) -> float:
            names, n = unit
            price = 1.0 if options.largest_first else sum(float(cost[name][n]) for name in names)
            return sum(float(gain[name][n]) for name in names) / max(price, 1e-12)

        for names, n in sorted(units, key=worth, reverse=True):
            wanted = [(name, n) for name in sorted(names) if (name, n) in left]
            price = sum(float(cost[name][n]) for name, _ in wanted)
            if wanted and spent + price <= allowed:
                spent += price
                left.difference_update(wanted)
    prices = {name: float(cost[name][[n for axis, n in left if axis == name]].sum()) for name in cost}
    for name, n in sorted(left, key=lambda one: (-worth(({one[0]}, one[1])), *one)):
        why = f"its crossings would cost {prices[name]:.2g} s; --max-slowdown {need:g} would allow them"
        search.give_up(name, n, why, for_now=True)


def _take_back(search: ReversalSearch, options: EditOptions, allowed: float) -> None:
    """Take again what costs no more than is left: axes that come to a place together wait there together."""
    for place in list(search.for_now[:TAKEN_BACK]):
        search.take_again([place])
        if search.cost(_search_raised(search, options, 1.0), COARSER[-1]) > allowed:
            search.give_up(*place, for_now=True)


def _section_costs(search: ReversalSearch, found: dict[str, Array]) -> dict[str, Array]:
    """Time that the changes of each axis cost in every section [s], by axis (s,)."""
    spots, times = search.crossings.costs(found, COARSER[-1])
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
        name: options.tolerance + raised * max(half - options.tolerance, 0.0) for name, half in search.amplitude.items()
    }
