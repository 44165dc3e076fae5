"""Choose a design for every window, by search on the simulated machine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from ph_post.compensate.families import Case, Family, shortest_crossing, whole_crossing
from ph_post.compensate.jogs import whole_jog
from ph_post.compensate.layout import reversing
from ph_post.compensate.search import Bounds, Found, Search
from ph_post.compensate.strategies.base import Proposal, Task, Wish
from ph_post.compensate.surroundings import Surroundings, find_surroundings
from ph_post.compensate.trial import Trial
from ph_post.simulate.assess import PICKUPS
from ph_post.simulate.contour import Nominal
from ph_post.types import Axis, Crossing, Jog, Machine, Scenario

WORK: Final = 3.0e7
"""Samples of one axis that may be simulated for a job: some ten seconds."""

FEWEST, MOST = 40, 500
"""Designs tried at a turning point, at least and at most."""

KEPT: Final = 3
"""Designs remembered as starts for the next turning point."""

AS_GOOD: Final = 0.05
"""Difference of scores by which a remembered design may fall short before a new search is made."""

SPARE: Final = 0.97
"""Part of the time allowed that is given to the turning points; the rest is for rounding."""

STANDS: Final = "the motion begins, ends or rests here"

Drives = tuple[tuple[Axis, int], ...]
"""Axes that reverse, each with the direction it goes on in."""

Choice = Callable[[Task, Case], Sequence[Family]]
"""The families to search at a turning point."""


def choose(task: Task, choice: Choice, *, offsets: bool, lead: bool) -> Proposal:
    """Search every window for its best design.

    Parameters
    ----------
    task : Task
    choice : callable
        Families to search there.
    offsets : bool
        Whether axes that are not closed over the table get a lasting offset.
    lead : bool
        Whether designs include inverse dynamics.

    Returns
    -------
    Proposal
        To be proven.
    """
    return _Chooser(task, choice, offsets=offsets, lead=lead).propose()


def searched(machine: Machine, axes: Sequence[str]) -> tuple[tuple[Scenario, ...], int]:
    """Return scenarios to search with, and how many of them are the machine as the file has it."""
    drives = [machine.axes[name] for name in axes]
    inside = [axis for axis in drives if axis.feedback == "load"]
    rules = PICKUPS if any(axis.gap.pickup is None for axis in inside) else (None,)
    spread = max(axis.uncertainty.backlash for axis in drives)
    gaps = (1.0,) if spread == 0.0 else (1.0, 1.0 - spread, 1.0 + spread)
    return tuple(Scenario(pickup=rule, gap=gap) for gap in gaps for rule in rules), len(rules)


class _Chooser:
    """The search over all windows of a job."""

    def __init__(self, task: Task, choice: Choice, *, offsets: bool, lead: bool) -> None:
        self.task, self.choice, self.offsets, self.lead = task, choice, offsets, lead
        self.written = task.options.carrier == "program"
        self.track, self.period = task.analysis.track, task.machine.servo_period
        self.nominal = Nominal(self.track)
        self.scenarios, self.as_filed = searched(task.machine, task.path.axes)
        self.known: list[Found] = []
        self.places = find_surroundings(task.analysis, task.feed, task.looped)
        self.reversing = [
            reversing(task.machine, [task.turning_points[k] for k in window.members])
            for window in task.windows
        ]
        pairs = zip(self.places, self.reversing, strict=True)
        self.active = max(sum(place is not None and bool(drives) for place, drives in pairs), 1)

    def propose(self) -> Proposal:
        """Search window by window."""
        wishes = tuple(map(self._wish, self.places, self.reversing))
        return Proposal(wishes=wishes, proven=True)

    def _wish(self, place: Surroundings | None, drives: Drives) -> Wish:
        if not drives:
            return Wish(shape=None, note="no axis with a gap reverses here")
        bare = self._bare(drives)
        found = None if place is None else self._search(self._case(place, drives))
        if found is None:
            why = STANDS if place is None else "nothing that was tried is better in every case"
            return Wish(shape=None, crossings=bare, note="" if bare else why)
        design = found.design
        return Wish(
            shape=design.shape, t_star=design.t_star, turn=design.turn, may_leave=True,
            crossings=design.crossings or bare, strategy=found.family.name,
        )  # fmt: skip

    def _bare(self, drives: Drives) -> tuple[Crossing | Jog, ...]:
        """Crossings of the lasting offsets that are needed in any case."""
        if not self.offsets:
            return ()
        open_loops = ((axis, direction) for axis, direction in drives if axis.feedback != "load")
        if self.written:
            return tuple(whole_jog(axis, direction, 0.0) for axis, direction in open_loops)
        return tuple(
            whole_crossing(axis, direction, 0.0, shortest_crossing(axis, self.lead, self.period))
            for axis, direction in open_loops
        )

    def _case(self, place: Surroundings, drives: Drives) -> Case:
        """Share the time allowed out equally."""
        budget = SPARE * self.task.options.max_slowdown * self.task.duration / self.active
        shortest = {axis.name: shortest_crossing(axis, self.lead, self.period) for axis, _ in drives}
        return Case(
            place=place, budget=max(budget, self.period), reversing=drives, shortest=shortest,
            lead=self.lead, crosses=self.offsets and not self.written,
        )  # fmt: skip

    def _search(self, case: Case) -> Found | None:
        """Search a window: first what was best elsewhere, and all else where that is not as good here."""
        options = self.task.options
        families = self.choice(self.task, case)
        trial = Trial(self.nominal, self.track, case.place, self.task.machine, self.scenarios)
        bounds = Bounds(
            longer=case.budget, slowest=options.min_feed or 0.0, retrograde=options.allow_retrograde
        )
        search = Search(trial, case, bounds, self.as_filed)
        for other in self.known:
            if other.family in families:
                again = search.look(other.family, other.x)
                if again.allowed and again.score <= other.score + AS_GOOD:
                    return again
        known = [(other.family, other.x) for other in self.known]
        calls = WORK / (self.active * trial.rows * len(trial.axes) * len(self.scenarios))
        found = search.best(families, int(np.clip(calls, FEWEST, MOST)), known)
        if found is not None:
            self.known = [found, *self.known][:KEPT]
        return found
