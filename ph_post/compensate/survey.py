"""Search the windows of a job together: those that are alike once, and all within the work that is allowed.

Windows are alike where feed, drives and the errors of the plain motion in all scenarios are, which follow from the
curvature, the feed and the axes. The one that is least like those that were searched is searched next. What was found
is tried again in the windows that are left, and improved there with the work that is left.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.families import DesignFamily
from ph_post.compensate.friction import friction_of
from ph_post.compensate.search import FLOOR, DesignSearch, TriedDesign
from ph_post.progress import Progress
from ph_post.types import Array, Axis

WORK: Final = 1e7
"""Samples of one axis that may be simulated for a job of many windows: some five seconds."""

FEW: Final = 2.0
"""Times that work for a job of no more than :data:`FIRST` windows, whose plans are soon run."""

OVERHEAD: Final = 8e3
"""What a design takes beside them, in samples."""

FEWEST, MOST = 40, 250
"""Designs tried in a window that is searched, at least and at most."""

THOROUGH: Final = 0.7
"""Part of the work that goes to the windows searched first, if there are others."""

FIRST: Final = 12
"""Windows that share that work at least."""

KNOWN: Final = 2
"""Windows whose designs are tried in another one."""

LOOKS: Final = 4
"""Designs of each that are at most, and two at least."""

SAME: Final = 1e-3
"""Difference of logarithms of feeds and errors up to which two windows are one."""

ALIKE: Final = 0.1
"""The same up to which they are alike."""

AS_GOOD: Final = 1.1
"""Ratio by which a design that was found elsewhere may be worse here before it is improved."""

ROOMIER: Final = 1.01
"""Ratio of the room up to which nothing is searched where nothing was found before."""

PROLONGED: Final = 1
"""Windows at most in which more time is tried in vain."""

LONGER: Final = (4.0, 16.0)
"""Shares of the time that are tried where nothing is found in one."""

Drives = tuple[tuple[Axis, int], ...]
"""Axes that reverse, each with the direction it goes on in."""


class SearchSite(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A window to search: its number, and the axes that reverse there."""

    number: int
    drives: Drives
    search: DesignSearch

    @property
    def features(self) -> Array:
        """Logarithms of the feed and of the errors of the plain motion."""
        plain = self.search.plain
        sizes = np.concatenate([plain.error, plain.rms]) + FLOOR
        return np.asarray(np.log(np.append(sizes, self.search.case.place.cruise)))

    def distance(self, other: SearchSite) -> float:
        """Return how unlike two windows are; infinite where the drives that reverse are others."""
        kinds = [
            [(axis.feedback, axis.servo, axis.gap, friction_of(axis)) for axis, _ in own.drives]
            for own in (self, other)
        ]
        if kinds[0] != kinds[1]:
            return math.inf
        return float(np.abs(self.features - other.features).max())

    @property
    def room(self) -> float:
        """Way that a profile may take on either side [m]."""
        return self.search.case.place.room


def search_sites(
    sites: Sequence[SearchSite],
    families: Sequence[Sequence[DesignFamily]],
    effort: float,
    progress: Progress,
) -> dict[int, list[TriedDesign]]:
    """Search windows.

    Parameters
    ----------
    sites : sequence of SearchSite
    families : sequence of sequence of DesignFamily
        Those of each.
    effort : float
        Part of :data:`WORK` that may be taken.
    progress : Progress

    Returns
    -------
    dict
        The candidates of each window by its number, by the time they add.
    """
    return _Survey(sites, families, effort, progress).search() if sites else {}


class _Survey:
    """One search over all windows of a job."""

    def __init__(
        self,
        sites: Sequence[SearchSite],
        families: Sequence[Sequence[DesignFamily]],
        effort: float,
        progress: Progress,
    ) -> None:
        self.sites, self.families, self.progress = sites, families, progress
        samples = [_samples(site.search) for site in sites]
        work = WORK * (FEW if len(sites) <= FIRST else 1.0)
        self.calls = effort * work / float(np.mean(samples))
        self.found: dict[int, list[TriedDesign]] = {}
        self.searched: list[int] = []
        self.in_vain = 0

    def search(self) -> dict[int, list[TriedDesign]]:
        """Search those least alike first, and try what they found in the others."""
        count = len(self.sites)
        share = self.calls * (1.0 if count <= FIRST else THOROUGH) / min(count, FIRST)
        calls = int(np.clip(share, FEWEST, MOST))
        most = max(int(self.calls * THOROUGH) // calls, min(count, FIRST) if share >= FEWEST else 1)
        apart = np.full(count, np.inf)
        next_one = int(np.argmax([site.search.plain.error.max() for site in self.sites]))
        while len(self.searched) < min(most, count) and apart[next_one] > ALIKE:
            self._explore(next_one, calls)
            own = [site.distance(self.sites[next_one]) for site in self.sites]
            apart = np.minimum(apart, own)
            apart[self.searched] = 0.0
            next_one = int(np.argmax(apart))
        left = [number for number in range(count) if number not in self.searched]
        spent = sum(self.sites[number].search.calls for number in self.searched)
        each = int(max(self.calls - spent, 0) / max(len(left), 1))
        for number in left:
            self._reuse(number, each)
        return {self.sites[number].number: own for number, own in self.found.items()}

    def _explore(self, number: int, calls: int) -> None:
        """Search a window; where nothing is found in its share of the time, in more time."""
        self.searched.append(number)
        self.progress(f"searching the best for turning points: {len(self.searched)} of at most {len(self.sites)}")
        search, families = self.sites[number].search, self.families[number]
        seeds = next((own for own in self.found.values() if own), [])
        found = search.explore(families, calls, seeds)
        if not found and search.case.inside_loop and search.case.may_take_longer and self.in_vain < PROLONGED:
            found = search.prolong(families, LONGER)
            self.in_vain += not found
        self.found[number] = found

    def _reuse(self, number: int, calls: int) -> None:
        """Try in a window what was found in those that are most alike."""
        site = self.sites[number]
        near = sorted(self.searched, key=lambda other: site.distance(self.sites[other]))
        near = [other for other in near if site.distance(self.sites[other]) < math.inf][:KNOWN]
        if not near:
            # The first of its kind is known to the others of it.
            self.searched.append(number)
            self.found[number] = site.search.explore(self.families[number], FEWEST)
            return
        known, closest = self.found[near[0]], self.sites[near[0]]
        apart = site.distance(closest)
        fits = max((one.side for one in known), default=0.0) <= site.room
        if apart <= SAME and (fits if known else site.room <= ROOMIER * closest.room):
            self.found[number] = [site.search.adopt(one) for one in known]
            return
        if not known and apart <= ALIKE and site.room <= ROOMIER * closest.room:
            self.found[number] = []
            return
        chosen = _chosen(known, max(calls, 2))
        looks = [site.search.look(one.family, one.x, one.budget) for one in chosen]
        pairs = zip(looks, chosen, strict=True)
        serves = all(one.allowed and one.merit <= AS_GOOD * own.merit for one, own in pairs)
        if not (looks and serves):
            others = [one for other in near[1:] for one in _chosen(self.found[other], calls - len(looks))]
            looks += [site.search.look(one.family, one.x, one.budget) for one in others]
            if looks:
                site.search.polish(looks, calls - len(looks))
        self.found[number] = site.search.candidates()


def _samples(search: DesignSearch) -> float:
    """Work of one design, in samples."""
    trial = search.trial
    rows = trial.rows + 2.0 * search.case.budget / trial.period
    return rows * len(trial.axes) * len(trial.scenarios) + OVERHEAD


def _chosen(known: Sequence[TriedDesign], calls: int) -> list[TriedDesign]:
    """Choose some of the designs known, from the quickest to the best; rests are none."""
    moving = [one for one in known if not one.design.stop]
    most = max(min(calls, LOOKS), 0)
    if len(moving) <= most:
        return moving
    return [moving[k] for k in np.linspace(0, len(moving) - 1, most).round().astype(int).tolist()]
