"""Fit the profiles that a strategy wants to the plain plan, its limits and the user's options."""

from __future__ import annotations

import msgspec
import numpy as np

from ph_post.compensate import plan_warnings
from ph_post.compensate.feed_planner import FLAT, FeedPlanner, ValidMotion
from ph_post.compensate.motion import FeedAlong
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.shapes import half_duration, half_length, lowest, mean, reported_ratio, soften
from ph_post.compensate.sites import Site, find_site
from ph_post.compensate.strategies.base import ProfileRequest
from ph_post.compensate.trial import half_distances
from ph_post.geometry.numeric import bisect
from ph_post.types import Array, BoolArray, FeedProfile, Window
from ph_post.units import MM_PER_MIN, MS

_ROUNDS = 8
"""Times that the profiles are fitted again after limits or options changed them; one or two are usual."""

_SAME = 1e-9
"""Relative differences below this are none."""


class FittedProfiles(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The valid motion, one profile or None a window, and warnings."""

    valid: ValidMotion
    profiles: tuple[FeedProfile | None, ...]
    warnings: tuple[str, ...]


class Fitter:
    """Fits profiles to one baseline.

    Parameters
    ----------
    feed_planner : FeedPlanner
    before : ValidMotion
        The plain plan.
    windows : tuple of Window
    requests : tuple of ProfileRequest
        One a window.
    options : PlanOptions
    feed : FeedAlong
        Of the plain plan.
    longest : float
        Longest cycle time allowed [s].
    """

    def __init__(
        self,
        feed_planner: FeedPlanner,
        before: ValidMotion,
        windows: tuple[Window, ...],
        requests: tuple[ProfileRequest, ...],
        options: PlanOptions,
        feed: FeedAlong,
        longest: float,
    ) -> None:
        self.longest = longest
        self.feed_planner, self.before, self.windows, self.requests = feed_planner, before, windows, requests
        self.options, self.feed = options, feed
        self._said: list[tuple[tuple[int, ...], str]] = []
        self._causes: dict[int, set[str]] = {}

    def fit(self) -> FittedProfiles:
        """Place the profiles, then soften and shorten them until everything holds at once."""
        sites = self._find_sites()
        valid = self.before
        depth = self._above_least_feed(sites, np.ones(len(sites)))
        for _ in range(_ROUNDS if sites else 0):
            valid = self.feed_planner.settle(sites, depth)
            self._blame(valid.depth < depth, "the limits of the axes")
            sites = tuple(map(self._resize, valid.sites, valid.depth.tolist()))
            depth = self._above_least_feed(sites, valid.depth * self._affordable(valid))
            if np.all(depth == valid.depth) and sites == valid.sites:
                break
        if not np.any(valid.depth):
            # Whatever was tried, without any profile the plain plan is the one to run.
            plain = self.before
            valid = msgspec.structs.replace(valid, motion=plain.motion, factor=plain.factor)
        profiles = self._profiles(valid)
        return FittedProfiles(valid=valid, profiles=profiles, warnings=tuple(plan_warnings.point_warnings(self._said)))

    def _find_sites(self) -> tuple[Site, ...]:
        """Place every profile that is requested; keep the reasons why others are left out."""
        track, looped = self.feed_planner.track, self.feed_planner.looped
        wanted = [k for k, request in enumerate(self.requests) if request.shape is not None]
        for k, request in enumerate(self.requests):
            if request.shape is None and request.note and request.slowed == 1.0:
                self._say(k, f"left alone: {request.note}")
        rooms = half_distances([self.windows[k].s for k in wanted], track.length, looped)
        sites = []
        for k, room in zip(wanted, rooms, strict=True):
            found = find_site(k, self.windows[k], self.requests[k], self.feed, room)
            if isinstance(found, str):
                self._say(k, f"left alone: {found}")
            else:
                sites.append(found)
        return tuple(sites)

    def _resize(self, site: Site, depth: float) -> Site:
        """Shorten a site where the user's own duration asks for it."""
        if self.options.t_star is None:
            return site
        wanted = half_length(soften(site.shape, 1.0 - depth), site.cruise, self.options.t_star)
        return msgspec.structs.replace(site, half=wanted) if wanted < site.half * (1.0 - _SAME) else site

    def _above_least_feed(self, sites: tuple[Site, ...], depth: Array) -> Array:
        """Depths at which no profile falls below the least feed."""
        if self.options.min_feed is None or not sites:
            return depth
        dip = np.array([1.0 - lowest(site.shape) for site in sites])
        room = np.array([1.0 - self.options.min_feed / site.cruise for site in sites])
        most = np.where(dip > 0.0, np.clip(room, 0.0, None) / np.where(dip > 0.0, dip, 1.0), np.inf)
        # Rounding must not take the feed below the one asked for.
        limited = np.minimum(depth, np.where(most < FLAT, 0.0, most * (1.0 - _SAME)))
        self._blame(limited < depth, "the least feed")
        return np.asarray(np.where(limited < depth * (1.0 - 2.0 * _SAME), limited, depth))

    def _affordable(self, valid: ValidMotion) -> float:
        """Part of their depth that all profiles may keep without the cycle time growing too much."""
        budget = self.longest
        if self.options.chosen_by_user or valid.motion.end <= budget * (1.0 + _SAME):
            return 1.0
        flat = np.array([2.0 * site.half / site.cruise for site in valid.sites])
        loss = valid.depth * np.array([1.0 - mean(site.shape) for site in valid.sites])

        def extra(part: float) -> float:
            return float(np.sum(flat * (1.0 / (1.0 - part * loss) - 1.0)))

        allowed = budget - (valid.motion.end - extra(1.0))
        kept = bisect(lambda part: extra(part) <= allowed, 0.0, 1.0)[0]
        cause = f"a cycle time at most {100.0 * self.options.max_slowdown:g} % longer"
        self._blame(valid.depth > 0.0, cause)
        return kept if kept * float(valid.depth.max()) >= FLAT else 0.0

    def _profiles(self, valid: ValidMotion) -> tuple[FeedProfile | None, ...]:
        profiles: list[FeedProfile | None] = [None] * len(self.windows)
        for number, (site, depth) in enumerate(zip(valid.sites, valid.depth.tolist(), strict=True)):
            if depth == 0.0:
                why = valid.refused.get(number) or f"nothing worth having is left by {self._why(number)}"
                self._say(site.window, f"left alone: {why}")
                continue
            notes = [*site.notes, *self._softened(number, site, depth)]
            for note in notes:
                self._say(site.window, note)
            profiles[site.window] = _profile(site, depth, notes)
        return tuple(profiles)

    def _softened(self, number: int, site: Site, depth: float) -> list[str]:
        """Return notes on what a profile has less than requested."""
        notes = []
        shape = soften(site.shape, 1.0 - depth)
        if depth < 1.0:
            what = "V(1/2)/V_c" if len(shape.pieces) == 1 else "lowest V/V_c"
            notes.append(
                f"softened for {self._why(number)}: {what} = {reported_ratio(shape):.3g} "
                f"in place of {reported_ratio(site.shape):.3g}"
            )
        t_star = half_duration(shape, site.cruise, site.half)
        wanted = self.options.t_star
        if wanted is not None and abs(t_star - wanted) > 1e-6 * wanted:
            notes.append(f"t* = {t_star / MS:.4g} ms in place of {wanted / MS:.4g} ms")
        if self.options.min_feed is not None and site.cruise < self.options.min_feed:
            notes.append(f"the feed around it, {site.cruise / MM_PER_MIN:.4g} mm/min, is below the least feed")
        return notes

    def _blame(self, which: BoolArray, cause: str) -> None:
        for number in np.flatnonzero(which).tolist():
            self._causes.setdefault(number, set()).add(cause)

    def _why(self, number: int) -> str:
        return " and ".join(sorted(self._causes.get(number, {"the limits of the axes"})))

    def _say(self, window: int, text: str) -> None:
        self._said.append((self.windows[window].members, text))


def _profile(site: Site, depth: float, notes: list[str]) -> FeedProfile:
    shape = soften(site.shape, 1.0 - depth)
    return FeedProfile(
        window=site.window,
        shape=shape,
        cruise=site.cruise,
        turn=site.request.turn,
        t_star=half_duration(shape, site.cruise, site.half),
        s_star=site.half,
        ratio=reported_ratio(shape),
        strategy=site.request.strategy,
        notes=tuple(notes),
    )
