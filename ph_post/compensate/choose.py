"""Choose a design for every window, by search on the simulated machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.families import BARE, DesignFamily, ReversalCase, shortest_crossing, whole_crossing
from ph_post.compensate.layout import approached_way, first_direction, reversing_axes
from ph_post.compensate.offsets import may_shift, whole_jog
from ph_post.compensate.search import FLOOR, DesignBounds, DesignSearch, TriedDesign
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult
from ph_post.compensate.trial import Surroundings, Trial, direction_at, find_surroundings
from ph_post.simulate.assess import PICKUPS
from ph_post.simulate.contour import Nominal
from ph_post.types import Array, Axis, Crossing, Jog, Machine, Scenario

WORK: Final = 2.0e7
"""Samples of one axis that may be simulated for a job: some ten seconds."""

FEWEST, MOST = 40, 250
"""Designs tried at a turning point, at least and at most."""

ALIKE: Final = 0.1
"""Difference of the logarithms of two feeds that are alike."""

KEPT: Final = 6
"""Turning points whose designs are remembered for the next one."""

AS_GOOD: Final = 1.1
"""Ratio by which a remembered design may be worse here before a new search is made; where nothing was found, the
ratio by which the error of the plain motion may differ."""

ROOMIER: Final = 1.01
"""Ratio of the room up to which nothing is searched where nothing was found before."""

MOST_APPROACH: Final = 0.5
"""Part of the time allowed that may be spent before the path begins."""

SPARE: Final = 0.97
"""Part of the time allowed that is given to the turning points; the rest is for rounding."""

STANDS: Final = "the motion begins, ends or rests here"

Drives = tuple[tuple[Axis, int], ...]
"""Axes that reverse, each with the direction it goes on in."""

Choice = Callable[[PlanningTask, ReversalCase], Sequence[DesignFamily]]
"""The families to search at a turning point."""


def choose(task: PlanningTask, choice: Choice, *, offsets: bool, lead: bool) -> StrategyResult:
    """Search every window for its best design.

    Parameters
    ----------
    task : PlanningTask
    choice : callable
        Families to search there.
    offsets : bool
        Whether axes that are not closed over the table get a lasting offset.
    lead : bool
        Whether designs include inverse dynamics.

    Returns
    -------
    StrategyResult
        To be proven.
    """
    return _Chooser(task, choice, offsets=offsets, lead=lead).propose()


def search_scenarios(machine: Machine, axes: Sequence[str]) -> tuple[tuple[Scenario, ...], int]:
    """Return the scenarios to search with, and how many of them are nominal.

    The nominal ones have the backlash of the machine file and come first; the others have it smaller and larger
    by its uncertainty. Each has one of the pick-up rules that the file leaves open.
    """
    drives = [machine.axes[name] for name in axes]
    inside = [axis for axis in drives if axis.loop.encloses_backlash]
    rules = PICKUPS if any(axis.gap.pickup is None for axis in inside) else (None,)
    spread = max(axis.uncertainty.backlash for axis in drives)
    gaps = (1.0,) if spread == 0.0 else (1.0, 1.0 - spread, 1.0 + spread)
    return tuple(Scenario(pickup=rule, gap=gap) for gap in gaps for rule in rules), len(rules)


class ReversalDesigns(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Designs found at a turning point, or none where the plain motion is best.

    `plain` (scenarios,) are the errors of that [m].
    """

    place: Surroundings
    drives: Drives
    plain: Array
    found: Sequence[TriedDesign]

    def likens(self, place: Surroundings, drives: Drives) -> bool:
        """Return whether another turning point is alike: in feed, in room, and in the drives that reverse."""
        same_feed = abs(np.log(place.cruise / self.place.cruise)) < ALIKE
        enough = place.room >= min(self.place.room, max((one.side for one in self.found), default=0.0))
        kinds = [[(axis.feedback, axis.servo, axis.gap) for axis, _ in own] for own in (drives, self.drives)]
        return bool(same_feed and enough and kinds[0] == kinds[1])


class _Chooser:
    """The search over all windows of a job."""

    def __init__(self, task: PlanningTask, choice: Choice, *, offsets: bool, lead: bool) -> None:
        self.task, self.choice, self.offsets, self.lead = task, choice, offsets, lead
        self.written = task.options.writes_program
        self.track, self.period = task.analysis.track, task.machine.servo_period
        self.nominal = Nominal(self.track)
        self.sized = task.sized
        self.scenarios, self.nominal_count = search_scenarios(task.machine, task.path.axes)
        self.known: list[ReversalDesigns] = []
        self.reached = 0
        self.places = find_surroundings(task.analysis, task.feed, task.looped)
        self.reversing = [
            reversing_axes(self.sized, [task.turning_points[k] for k in window.members]) for window in task.windows
        ]
        self.approach = self._approach()
        pairs = zip(self.places, self.reversing, strict=True)
        self.active = max(sum(place is not None and bool(drives) for place, drives in pairs), 1)

    def _approach(self) -> float:
        """Time that it takes at most to bring axes behind the loop to their first flank [s].

        Every part program has an approach that does it. Where it would take most of the time allowed nothing is
        spent on it.
        """
        if not self.offsets or self.written or self.task.options.start == "moving":
            return 0.0
        drives = [self.sized.axes[name] for name in self.task.path.axes]
        times = [
            shortest_crossing(axis, self.lead, self.period) * (2.0 + axis.uncertainty.backlash)
            for axis in drives
            if not axis.loop.encloses_backlash and axis.gap.lost_motion > 0.0
        ]
        longest = max(times, default=0.0)
        return longest if longest <= MOST_APPROACH * self.task.allowed else 0.0

    def propose(self) -> StrategyResult:
        """Search window by window, and share the time out where it does most."""
        found = list(map(self._candidates, self.places, self.reversing))
        return self._proposal(found, 1.0)

    def _proposal(self, found: Sequence[Sequence[TriedDesign]], part: float) -> StrategyResult:
        """Pick candidates for a part of the time allowed."""
        time = SPARE * part * self.task.allowed - self.approach
        picks = iter(allocate([own for own in found if own], time))
        requests = (
            self._request(next(picks) if own else None, place, drives)
            for own, place, drives in zip(found, self.places, self.reversing, strict=True)
        )
        return StrategyResult(
            requests=tuple(requests),
            proven=True,
            shorter=lambda less: self._proposal(found, less),
            shifted=self._behind(),
            winds_up=self.approach > 0.0,
            crosses_by=BARE.name,
        )

    def _behind(self) -> tuple[str, ...]:
        """Axes whose gap is behind their loop, whether they turn back in windows, corners or nowhere."""
        if not self.offsets:
            return ()
        if self.written:
            axes = [axis for axis, _ in reversing_axes(self.sized, self.task.turning_points)]
            axes += [axis for name in self.task.path.axes if self._leaves_its_zero(axis := self.sized.axes[name])]
            if any(may_shift(axis) for axis in axes):
                # One axis alone may do harm where the lags of two cancel: those that never turn back come along.
                axes += [self.sized.axes[name] for name in self.task.path.axes]
            return tuple(sorted({axis.name for axis in axes if may_shift(axis)}))
        drives = [self.sized.axes[name] for name in self.task.path.axes]
        if self.task.options.start == "moving":
            # Nobody knows the flank of an axis that rests there, and there is no time to bring it to one.
            drives = [axis for number, axis in enumerate(drives) if direction_at(self.track, 0.0, number)]
        return tuple(axis.name for axis in drives if not axis.loop.encloses_backlash and axis.gap.lost_motion > 0.0)

    def _leaves_its_zero(self, axis: Axis) -> bool:
        """Return whether a program brings an axis to its start, or away from it, off the side of its zero."""
        side, direction = axis.reference_side, first_direction(self.track, self.task.turning_points, axis.name)
        return side * direction != 0 and {direction, approached_way(axis, direction)} != {side}

    def _request(self, found: TriedDesign | None, place: Surroundings | None, drives: Drives) -> ProfileRequest:
        if not drives:
            return ProfileRequest(shape=None, note="no axis with backlash reverses here")
        bare = self._bare(drives)
        if place is None and self._may_rest(drives):
            return ProfileRequest(shape=None, crossings=bare, stop=True)
        if found is None:
            why = STANDS if place is None else "nothing that was tried is better in every case"
            return ProfileRequest(shape=None, crossings=bare, note="" if bare else why)
        design = found.design
        return ProfileRequest(
            shape=design.shape,
            t_star=design.t_star,
            turn=design.turn,
            may_leave_window=True,
            crossings=design.crossings or bare,
            stop=design.stop,
            strategy=found.family.name,
        )

    def _bare(self, drives: Drives) -> tuple[Crossing | Jog, ...]:
        """Crossings of the lasting offsets that are needed in any case."""
        if not self.offsets:
            return ()
        if self.written:
            return tuple(whole_jog(axis, direction, 0.0) for axis, direction in drives if may_shift(axis))
        open_loops = ((axis, direction) for axis, direction in drives if not axis.loop.encloses_backlash)
        return tuple(
            whole_crossing(axis, direction, 0.0, shortest_crossing(axis, self.lead, self.period))
            for axis, direction in open_loops
        )

    def _candidates(self, place: Surroundings | None, drives: Drives) -> list[TriedDesign]:
        """Return the candidates of a window, by the time they add."""
        if place is None or not drives:
            return []
        self.reached += 1
        self.task.progress(f"searching the best for turning point {self.reached} of {self.active}")
        case = self._case(place, drives)
        families = self.choice(self.task, case)
        options, machine = self.task.options, self.task.machine
        trial = Trial(self.nominal, self.track, place, machine, self.scenarios, self.sized)
        bounds = DesignBounds(slowest=options.min_feed or 0.0, retrograde=options.allow_retrograde)
        search = DesignSearch(trial, case, bounds, self.nominal_count)
        if self._may_rest(drives):
            search.add_rest(jogs=self.written)
        for known in self.known:
            if known.likens(place, drives) and self._serves(search, known):
                return search.candidates()
        rows = trial.rows + 2.0 * case.budget / self.period
        calls = options.effort * WORK / (self.active * rows * len(trial.axes) * len(self.scenarios))
        seeds = next((known.found for known in self.known if known.found), ())
        found = search.explore(families, int(np.clip(calls, FEWEST, MOST)), seeds)
        own = ReversalDesigns(place=place, drives=drives, plain=search.plain.error, found=found)
        self.known = [own, *self.known][:KEPT]
        return found

    def _may_rest(self, drives: Drives) -> bool:
        """Return whether a rest in the plain motion will do: no backlash inside a loop is crossed there."""
        return self.offsets and not any(axis.loop.encloses_backlash for axis, _ in drives)

    @staticmethod
    def _serves(search: DesignSearch, known: ReversalDesigns) -> bool:
        """Return whether designs found elsewhere are as good here; or none, where there is no more room here."""
        if not known.found:
            errors = [np.log(one + FLOOR) for one in (search.plain.error, known.plain)]
            same = bool(np.abs(errors[0] - errors[1]).max() <= np.log(AS_GOOD))
            return same and search.case.place.room <= ROOMIER * known.place.room
        for one in known.found:
            if one.design.stop:
                continue
            again = search.look(one.family, one.x, one.budget)
            if not again.allowed or again.merit > AS_GOOD * one.merit + FLOOR:
                return False
        return True

    def _case(self, place: Surroundings, drives: Drives) -> ReversalCase:
        """Make the case of a window, with an equal share of the time."""
        budget = (SPARE * self.task.allowed - self.approach) / self.active
        shortest = {axis.name: shortest_crossing(axis, self.lead, self.period) for axis, _ in drives}
        return ReversalCase(
            place=place,
            budget=max(budget, self.period),
            reversing=drives,
            shortest=shortest,
            lead=self.lead,
            crosses=self.offsets and not self.written,
        )


def allocate(candidates: Sequence[Sequence[TriedDesign]], time: float) -> list[TriedDesign]:
    """Pick a candidate for every window so that the worst is as good as the time allows.

    Parameters
    ----------
    candidates : sequence of sequence of TriedDesign
        Of every window, by the time they add: each better than those before it.
    time : float
        What may be added in all [s].

    Returns
    -------
    list of TriedDesign
        The quickest ones that reach the best common merit that the time allows; where a window cannot reach
        it, its best.
    """

    def quickest(bound: float) -> list[TriedDesign]:
        return [next((one for one in own if one.merit <= bound), own[-1]) for own in candidates]

    bounds = sorted({one.merit for own in candidates for one in own})
    low, high = 0, len(bounds) - 1
    while low < high:
        middle = (low + high) // 2
        if sum(one.longer for one in quickest(bounds[middle])) <= time:
            high = middle
        else:
            low = middle + 1
    return quickest(bounds[low]) if bounds else []
