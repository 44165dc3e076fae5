"""Plan the feed along one path on one machine so that every sample keeps the limits."""

from __future__ import annotations

import math
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.bounds import check_samples
from ph_post.compensate.corner_speeds import RoundedCorners
from ph_post.compensate.lead import lead_window
from ph_post.compensate.limit_curve import AxisLimits, LimitCurve, axis_limits, build_limit_curve
from ph_post.compensate.motion import MotionLaw
from ph_post.compensate.nominal import add_plateaus, first_nodes, plan_feed
from ph_post.compensate.room import LeadRoom
from ph_post.compensate.shapes import soften
from ph_post.compensate.sites import Site, SiteSpan, assemble, site_spans, stretch_usage
from ph_post.compensate.violations import ViolationSpans, find_violations, rounding
from ph_post.errors import LimitError
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, IntArray, Machine, frozen

FLAT = 0.03
"""A profile softened to less than this part of its depth is left out."""

_MARGIN = 2e-3
"""Part of every limit that the plan leaves unused, for what changes between the places it looks at."""

_MOST_FOR_ROUNDING = 0.1
"""The plan leaves no more than this part of a limit to the rounding of the samples."""

_SLOWER = 0.98
"""Beyond what the samples ask for, a stretch is slowed by this: the next plan meets it at other phases."""

_SLOWEST_STEP = 0.3
"""No stretch is slowed by more than this factor at once."""

_ROUNDS = 60
"""Rounds of planning, checking and slowing; one or two are usual."""

_PATIENCE = 12
"""Rounds after which everything is slowed, not only the stretches that break a limit."""

_LED_ROUNDS = 40
"""Rounds in which room is made for inverse dynamics; what has none then is left to be reduced there."""

_LITTLE = 0.01
"""Beyond what a led command asks for, a stretch is slowed by this part, and by more after every few rounds."""

_LEAST_EASE = 0.25
"""Part of its usual change below which the speed need not change slower for a lead: that is not what it lacks."""

_LARGEST_STEP = 0.5
"""No stretch is slowed by more than this factor at once for the sake of a led command."""

_MOST_POINTS = 200_000
"""Points along a path between which feeds are lowered for a led command, about."""

CALM = 2.0
"""Cells of the smoothed speed for which it is constant before and behind a profile."""

PASSING = 2.0
"""Cells of the smoothed speed for which it is low behind a turning point that is passed slower."""

_HALVINGS = 8
"""Bisections of a profile's depth: to 1/256 of it."""


REMEDY = "a higher feed, higher limits of the axes or a longer controller.servo_period_ms"
"""What makes a motion shorter."""


class ValidMotion(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A motion that keeps the limits.

    `sites` are those it was planned for, with V_c as it came out; `depth` (sites,) is how much of each
    profile was kept: 1 all of it, 0 none; `refused` holds the reason why a profile was left out, by its number;
    `factor` how much slower than the caps allow the motion is, at their points.
    """

    motion: MotionLaw
    sites: tuple[Site, ...]
    depth: Array
    refused: dict[int, str]
    factor: Array


class _Candidate(NamedTuple):
    """A motion not yet known to keep the limits."""

    motion: MotionLaw
    sites: tuple[Site, ...]


class FeedPlanner:
    """Plans motions along one path on one machine; what it learns about its limits it keeps.

    Parameters
    ----------
    track : Track
    machine : Machine
    stops : Array
        Arc lengths at which the motion stops [m].
    moving : bool
        Whether the motion begins and ends at feed; at a rapid segment it rests all the same.
    lead : float
        Part of the inverse dynamics for which the motion leaves room: the limits hold for the command with it.
    tail : float
        Rest behind the end of such a motion [s].
    jerk : float
        Times the limits of the jerk that it is planned with before it is smoothed, which takes the peaks off.
    width : float
        Times the usual width of the window through which the lead sees the path.

    Attributes
    ----------
    looped : bool
        Whether the motion runs through the seam of a closed path.
    factor : Array
        How much slower than the caps allow the motion has to be, at their points, as far as is known.
    ease : Array
        How much slower its speed has to change.
    """

    def __init__(
        self,
        track: Track,
        machine: Machine,
        stops: Array,
        moving: bool,
        lead: float = 0.0,
        tail: float = 0.0,
        jerk: float = 1.0,
        width: float = 1.0,
    ) -> None:
        self.track = track
        self.limits = axis_limits(track.path.axes, machine, machine.servo_period)
        _check_feeds(track, self.limits)
        window = lead_window(machine, track.path.axes, width) if lead > 0.0 else None
        self.room = LeadRoom(track, machine, self.limits, window, stops, lead, tail) if window else None
        inside = _planned(self.limits, track, jerk if window else 1.0)
        caps = build_limit_curve(track, inside, rounded=self.room is not None)
        # Speeds of least time around rounded corners leave no room for a lead.
        self._corners = RoundedCorners(track, inside, caps) if self.room is None else None
        self.caps = self._corners.expect(caps) if self._corners is not None else caps
        if self.room is not None:
            self.caps = self.caps.refined(self._fine(self.room.window.spacing))
        self.factor, self.ease = np.ones(self.caps.s.size), np.ones(self.caps.s.size)
        segments = track.path.segments
        first, last = moving and not segments[0].rapid, moving and not segments[-1].rapid
        self.looped = first and last and track.closed
        nodes = first_nodes(track.length, stops, (first, last))
        self._nodes = self._corners.add_nodes(nodes) if self._corners is not None else nodes

    def _fine(self, spacing: float) -> float:
        """Distance of the points at which a stretch may be slowed for its lead: two cells at the usual feed [m]."""
        usual = float(np.median(np.minimum(self.caps.programmed, float(self.limits.velocity.max()))))
        return max(CALM * spacing * usual, self.track.length / _MOST_POINTS)

    def learn(self, other: FeedPlanner, power: float = 1.0) -> None:
        """Take over how much slower another planner of the same path had to be, or a power of it."""
        self.factor, self.ease = other.factor**power, other.ease**power

    def pass_slower(self, s: Array, speed: Array) -> None:
        """Keep to speeds (k,) [m/s] from some places (k,) [m] on, as long as a servo takes to answer."""
        assert self.room is not None
        slow = np.full(self.caps.s.size, np.inf)
        for points, most in zip(self._points(s, s + PASSING * self.room.window.spacing * speed), speed, strict=True):
            slow[points] = np.minimum(slow[points], most)
        soft, hard = np.minimum(self.caps.soft, slow), np.minimum(self.caps.hard, slow)
        self.caps = replace(self.caps, soft=soft, hard=hard)

    def settle(self, sites: tuple[Site, ...] = (), depth: Array | None = None) -> ValidMotion:
        """Plan a motion with a profile on every site, each `depth` (sites,) times as deep as requested.

        Where samples break a limit the feed is lowered, or the profile softened, and all is planned again; as
        a last resort everything is slowed down.

        Raises
        ------
        LimitError
            If no motion was found; not known to happen.
        TooLargeError
            Where it takes too many servo periods.
        """
        depth = np.ones(len(sites)) if depth is None else depth.copy()
        refused: dict[int, str] = {}
        near: ViolationSpans | None = None
        ease, changed = self.ease.copy(), True
        for attempt in range(_ROUNDS):
            candidate = self._candidate(sites, depth, refused)
            check_samples(self.track.path.name, candidate.motion.end, self.limits.period, REMEDY)
            if self.room is not None:
                broken, steady = self.room.violations(candidate.motion, near)
                if near is not None and not broken.factor.size:
                    # Where the motion was changed it keeps the limits: does it everywhere?
                    broken, steady = self.room.violations(candidate.motion, strict=False)
                near = broken
            else:
                broken = find_violations(self.track, self.limits, candidate.motion)
            if not broken.factor.size or (self.room is not None and (attempt >= _LED_ROUNDS or not changed)):
                return ValidMotion(
                    motion=candidate.motion,
                    sites=candidate.sites,
                    depth=depth,
                    refused=refused,
                    factor=self.factor.copy(),
                )
            guilty, elsewhere = self._guilty(candidate, broken, depth)
            self._soften(candidate, guilty, depth, refused)
            if self.room is not None:
                eased, steady = broken.where(elsewhere), steady[elsewhere]
                in_vain = self._eased_in_vain(eased) & ~steady
                self._make_room(eased.where(~in_vain), steady[~in_vain], 1.0 - _LITTLE * (1 + attempt // 4))
                given_up = self._give_up(eased.where(in_vain), candidate.sites, depth, refused, ease)
                changed = bool(guilty.size or given_up or not np.all(in_vain))
            else:
                self._slow(broken.where(elsewhere), everything=attempt > _PATIENCE)
        left = f"{broken.factor.size} stretches of samples still break one"
        raise LimitError(f"no motion keeps the limits of the axes: {left}")

    def _candidate(self, sites: tuple[Site, ...], depth: Array, refused: dict[int, str]) -> _Candidate:
        """Plan the feed with a plateau for every profile, and put the profiles on them."""
        laid: list[SiteSpan] = []
        for number in np.flatnonzero(depth).tolist():
            parts = self._lay(number, sites[number], depth[number])
            if isinstance(parts, str):
                refused[number], depth[number] = parts, 0.0
            else:
                laid += parts
        s0, s1, level = np.array([(part.s0, part.s1, part.cruise) for part in laid]).reshape(-1, 3).T
        caps = self.caps.slowed(self.factor)
        if self.room is not None:
            caps = caps.eased(self.ease)
            ahead, behind = self._calm(caps, s0, s1, level)
            laid = [replace(part, ahead=a, behind=b) for part, a, b in zip(laid, ahead, behind, strict=True)]
            s0, s1 = s0 - ahead, s1 + behind
        nodes = add_plateaus(self._nodes, s0, s1, level, np.arange(len(laid)))
        schedule = plan_feed(caps, nodes)
        cruise = {number: site.cruise for number, site in enumerate(sites)}
        for row in np.flatnonzero(schedule.window >= 0).tolist():
            cruise[laid[schedule.window[row]].site] = float(schedule.speed[row, 0])
        planned = (msgspec.structs.replace(site, cruise=cruise[k]) for k, site in enumerate(sites))
        motion = assemble(schedule, sites, laid)
        if self.room is not None:
            motion = self.room.smooth(motion)
        elif self._corners is not None:
            motion = self._corners.quicken(motion, self.factor)
        return _Candidate(motion, tuple(planned))

    def _calm(self, caps: LimitCurve, s0: Array, s1: Array, level: Array) -> tuple[list[float], list[float]]:
        """Way of constant feed [m] before and behind profiles, as far as caps and neighbours allow."""
        assert self.room is not None
        wanted = CALM * self.room.window.spacing * level
        order = np.argsort(s0)
        edges = np.concatenate([[-np.inf], np.stack([s0[order], s1[order]], axis=1).ravel(), [np.inf]])
        free = np.empty((2, s0.size))
        free[0, order], free[1, order] = np.diff(edges)[::2][:-1], np.diff(edges)[::2][1:]
        free[0], free[1] = np.minimum(0.5 * free[0], s0), np.minimum(0.5 * free[1], self.track.length - s1)
        for number in range(s0.size):
            low = np.flatnonzero(caps.soft < level[number] * (1.0 - 1e-9))
            before, after = caps.s[low[caps.s[low] < s0[number]]], caps.s[low[caps.s[low] > s1[number]]]
            free[0, number] = min(free[0, number], s0[number] - before[-1] if before.size else np.inf)
            free[1, number] = min(free[1, number], after[0] - s1[number] if after.size else np.inf)
        ahead, behind = np.clip(np.minimum(free, wanted), 0.0, None).tolist()
        return ahead, behind

    def _make_room(self, broken: ViolationSpans, steady: BoolArray, beyond: float) -> None:
        """Lower the feed where it is too fast by itself, and let it change slower where only that asks for too much."""
        for slower, which in ((self.factor, steady), (self.ease, ~steady)):
            once = np.ones(self.caps.s.size)
            spans = broken.where(which)
            for points, factor in zip(self._points(spans.s0, spans.s1), spans.factor, strict=True):
                once[points] = np.minimum(once[points], max(beyond * factor, _LARGEST_STEP))
            np.multiply(slower, once, out=slower)

    def _points(self, s0: Array, s1: Array) -> list[slice]:
        """Return the points of the caps that stretches [s0, s1] [m] lie between, arrays (k,)."""
        s = self.caps.s
        first = np.maximum(np.searchsorted(s, s0, side="right") - 1, 0)
        last = np.minimum(np.searchsorted(s, s1, side="left"), s.size - 1)
        return [slice(min(i, j), max(i, j) + 1) for i, j in zip(first.tolist(), last.tolist(), strict=True)]

    def _eased_in_vain(self, broken: ViolationSpans) -> BoolArray:
        """Return on which stretches the speed changes as slowly as it may, which has not helped."""
        return np.array(
            [self.ease[points].max() < _LEAST_EASE for points in self._points(broken.s0, broken.s1)], dtype=np.bool_
        )

    def _give_up(
        self, broken: ViolationSpans, sites: tuple[Site, ...], depth: Array, refused: dict[int, str], ease: Array
    ) -> bool:
        """Leave out a profile beside the stretches that it leaves no room on, where the speed may change as before.

        Returns
        -------
        bool
            Whether there was any.
        """
        ends = np.array([site.ends for site in sites]).reshape(-1, 2)
        away = [np.maximum(ends[:, 0] - s1, s0 - ends[:, 1]) for s0, s1 in zip(broken.s0, broken.s1, strict=True)]
        beside = {int(np.argmin(np.where(depth > 0.0, one, np.inf))) for one in away} if np.any(depth) else set()
        for number in beside:
            depth[number], refused[number] = 0.0, "it leaves no room beside it for the inverse dynamics"
        for points in self._points(broken.s0, broken.s1):
            self.ease[points] = ease[points]
        return bool(beside)

    def _lay(self, number: int, site: Site, depth: float) -> list[SiteSpan] | str:
        """Put a profile on the path so deep, or say why that cannot be done."""
        return site_spans(number, site, soften(site.shape, 1.0 - depth), self.track.length)

    def _guilty(self, candidate: _Candidate, broken: ViolationSpans, depth: Array) -> tuple[IntArray, BoolArray]:
        """Find the profiles that cause the violations.

        Returns
        -------
        guilty : IntArray
            Numbers of the sites whose profiles break limits that a constant feed in their place would keep.
        elsewhere : BoolArray
            Which of the broken stretches no such profile has a part in.
        """
        motion = candidate.motion
        first, last = motion.phase_at(broken.t0), motion.phase_at(broken.t1)
        between = [set(motion.window[i : j + 1].tolist()) for i, j in zip(first, last, strict=True)]
        suspects = set().union(*between) - {-1}
        rows = [k for k, site in enumerate(candidate.sites) if site.window in suspects and depth[k] > 0.0]
        numbers = np.array(rows, dtype=np.int64)
        guilty = numbers[self._usage(candidate, numbers, np.zeros(depth.size)) <= 1.0]
        windows = {candidate.sites[k].window for k in guilty.tolist()}
        return guilty, np.array([not windows & found for found in between], dtype=np.bool_)

    def _usage(self, candidate: _Candidate, numbers: IntArray, depth: Array) -> Array:
        """Largest use of a limit on each of the sites `numbers`, were their profiles of that depth."""
        parts: list[SiteSpan] = []
        for number in numbers.tolist():
            found = self._lay(number, candidate.sites[number], depth[number])
            parts += [] if isinstance(found, str) else found
        worst = np.zeros(len(candidate.sites))
        np.maximum.at(worst, [part.site for part in parts], stretch_usage(self.track, self.limits, parts))
        return np.asarray(worst[numbers])

    def _soften(self, candidate: _Candidate, guilty: IntArray, depth: Array, refused: dict[int, str]) -> None:
        """Make guilty profiles as shallow as the limits ask for, by bisection on dense samples."""
        if not guilty.size:
            return
        low, high = np.zeros(depth.size), depth.copy()
        for _ in range(_HALVINGS):
            middle = 0.5 * (low + high)
            fits = np.zeros(depth.size, dtype=np.bool_)
            fits[guilty] = self._usage(candidate, guilty, middle) <= 1.0
            low, high = np.where(fits, middle, low), np.where(fits, high, middle)
        # What looked right on dense samples and broke a limit all the same is made a little shallower.
        depth[guilty] = np.minimum(low[guilty], 0.9 * depth[guilty])
        for number in guilty[depth[guilty] < FLAT].tolist():
            depth[number] = 0.0
            refused[number] = "every profile worth having breaks a limit of the axes"

    def _slow(self, broken: ViolationSpans, everything: bool) -> None:
        """Lower the caps on the stretches, and a little everywhere if nothing else helped."""
        for points, factor in zip(self._points(broken.s0, broken.s1), broken.factor, strict=True):
            self.factor[points] *= max(_SLOWER * factor, _SLOWEST_STEP)
        if everything:
            self.factor *= _SLOWER * max(float(broken.factor.min(initial=1.0)), _SLOWEST_STEP)


def _check_feeds(track: Track, limits: AxisLimits) -> None:
    """Refuse a path that takes too many servo periods at its feeds, or at the velocities of the axes."""
    fastest = math.hypot(*limits.velocity)
    asked = [fastest if one.rapid else one.feed or track.path.feed for one in track.path.segments]
    feeds = np.minimum(asked, fastest)[track.segment]
    check_samples(track.path.name, float((np.diff(track.starts) / feeds).sum()), limits.period, REMEDY)


def _planned(limits: AxisLimits, track: Track, jerk: float) -> AxisLimits:
    """Limits for the planner, a little inside those of the machine, but of the jerk some times that."""
    feeds = [track.path.feed if one.feed is None else one.feed for one in track.path.segments]
    every = np.arange(len(track.pieces))
    extent = float(np.abs(track.derivatives(every, np.zeros(every.size))).max())
    # The duration is not known yet; a few times the one at the lowest feed will not be far off.
    noise = rounding(extent, track.length, 4.0 * track.length / min(feeds), max(feeds))
    planned = []
    for order, limit in enumerate(limits.values, start=1):
        shown = np.minimum(noise * (2.0 / limits.period) ** order, _MOST_FOR_ROUNDING * limit)
        planned.append((1.0 - _MARGIN) * limit - shown)
    planned[2] = jerk * planned[2]
    return AxisLimits(values=frozen(planned), period=limits.period)
