"""Sites: the stretches of a path that have a profile on them.

A site begins and ends at the feed V_c, which is the lowest that the plain plan has on it, so that a plateau of that
feed can be had there without going any faster.
"""

from __future__ import annotations

from collections.abc import Sequence

import msgspec
import numpy as np

from ph_post.compensate import shapes
from ph_post.compensate.limit_curve import AxisLimits
from ph_post.compensate.motion import STEADY, FeedAlong, MotionLaw
from ph_post.compensate.nominal import SAME_PLACE, Schedule
from ph_post.compensate.strategies.base import ProfileRequest
from ph_post.geometry.numeric import largest
from ph_post.geometry.track import Track
from ph_post.types import Array, IntArray, Phase, ProfileShape, Window, frozen
from ph_post.units import MM, MS

SLOWEST = 0.5
"""Part of the feed at a turning point to which the feed may fall on its site where no steadier one is long enough."""


class Site(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A profile's place: 2 `half` [m] of path with `s` [m] inside, entered and left at `cruise` [m/s].

    `window` is the index of its window; `shape` is the one wanted; `request` is what the strategy asked for, the
    share of the way before the turning point included; `notes` say what was cut off.
    """

    window: int
    s: float
    half: float
    cruise: float
    shape: ProfileShape
    request: ProfileRequest
    notes: tuple[str, ...] = ()

    @property
    def ends(self) -> tuple[float, float]:
        """Its beginning and end along the path [m]; over the seam of a closed one it counts on."""
        turn = self.request.turn
        return self.s - 2.0 * turn * self.half, self.s + 2.0 * (1.0 - turn) * self.half


class SiteSpan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Part of a site that lies on the path without a break: [s0, s1] [m] and the profile's part there.

    `ahead` and `behind` [m] is constant feed before and behind it.
    """

    site: int
    s0: float
    s1: float
    cruise: float
    shape: ProfileShape
    ahead: float = 0.0
    behind: float = 0.0

    def phases(self, cruise: float, window: int = -1) -> list[Phase]:
        """Phases of the stretch, one a piece, where it is entered at `cruise` [m/s] and at 0 s."""
        duration = (self.s1 - self.s0) / (cruise * shapes.mean(self.shape))
        found = []
        t, s = 0.0, self.s0
        for piece in self.shape.pieces:
            speed = cruise * piece.coefficients
            part = duration * piece.share
            found.append(Phase(start=t, duration=part, s=s, speed=speed, window=window))
            t, s = t + part, s + part * float(speed.mean())
        return found


def find_site(index: int, window: Window, request: ProfileRequest, feed: FeedAlong, room: float) -> Site | str:
    """Fit a request into its window.

    Parameters
    ----------
    index : int
        Index of the window.
    window : Window
    request : ProfileRequest
        With a shape.
    feed : FeedAlong
    room : float
        Half the distance to the next window with a profile [m].

    Returns
    -------
    Site or str
        The site, or the reason why there is none.
    """
    assert request.shape is not None
    cruise = feed.at(window.s)
    if cruise <= 0.0:
        return "the motion stops here"
    mean = shapes.mean(request.shape)
    room = max(min(room, window.s - feed.first, feed.last - window.s), 0.0)
    # What a side may take is what the longer one takes; in the middle of the way both are alike.
    longer = 2.0 * max(request.turn, 1.0 - request.turn)
    wanted = longer * cruise * mean * request.t_star
    most = wanted if request.may_leave_window else min(wanted, window.half_length)
    side = feed.steady_half(window.s, min(most, room), STEADY * cruise)
    needed = min(most, longer * cruise * mean * request.least)
    if side < needed * (1.0 - 1e-9):
        # Where the feed changes quickly a lower plateau is better than none.
        side = min(needed, room)
        if side < needed or feed.lowest(window.s, side) < SLOWEST * cruise:
            return f"no room: {needed / MM:.3g} mm of steady feed on either side are needed"
    lowest, half = feed.lowest(window.s, side), side / longer
    if side <= SAME_PLACE or lowest < SLOWEST * cruise:
        return "no room for it: the path starts or ends here, or the motion stops"
    notes = tuple(_notes(window, request, side, most, half / (lowest * mean)))
    return Site(window=index, s=window.s, half=half, cruise=lowest, shape=request.shape, request=request, notes=notes)


def _notes(window: Window, request: ProfileRequest, side: float, most: float, t_star: float) -> list[str]:
    notes = [request.note] if request.note else []
    if side < most * (1.0 - 1e-6):
        notes.append(
            f"profile shortened from {most / MM:.4g} mm to {side / MM:.4g} mm on either side, where the feed "
            "changes, the path ends or the next profile begins"
        )
    if side > window.half_length * (1.0 + 1e-9):
        notes.append("the profile is longer than the window in which the osculating circle stands for the path")
    if t_star < request.least * (1.0 - 1e-9):
        notes.append(
            f"the window holds t* = {t_star / MS:.4g} ms only, less than the backlash interval of "
            f"{request.least / MS:.4g} ms"
        )
    return notes


def site_spans(number: int, site: Site, shape: ProfileShape, length: float) -> list[SiteSpan] | str:
    """Lay a site's profile on the path, in two parts where it runs over the seam of a closed one.

    Returns
    -------
    list of SiteSpan or str
        The stretches, or the reason why the profile cannot be had.
    """
    s0, s1 = site.ends
    for turn in (-length, 0.0, length):
        if s0 + turn >= -SAME_PLACE and s1 + turn <= length + SAME_PLACE:
            low, high = max(s0 + turn, 0.0), min(s1 + turn, length)
            return [SiteSpan(site=number, s0=low, s1=high, cruise=site.cruise, shape=shape)]
    seam = length if s1 > length else 0.0
    first, second = shapes.split(shape, (seam - s0) / (s1 - s0), SAME_PLACE / (s1 - s0))
    if not (shapes.is_non_negative(first) and shapes.is_non_negative(second)):
        return "the feed would become negative on the seam of the path, where the motion begins"
    return [
        SiteSpan(site=number, s0=s0 - seam + length, s1=length, cruise=site.cruise, shape=first),
        SiteSpan(site=number, s0=0.0, s1=s1 - seam, cruise=site.cruise, shape=second),
    ]


_PHASES = 4
"""Sampling phases looked at: which one the samples will have is not known before the whole plan is."""

_LEAST_SAMPLES = 12
"""Periods on a stretch; where the servo period is too long for that many, shorter differences stand in."""


def stretch_usage(track: Track, limits: AxisLimits, parts: Sequence[SiteSpan]) -> Array:
    """Largest ratio of what the axes do to what they may, on each stretch, shape (stretches,)."""
    if not parts:
        return np.zeros(0)
    motion, first_phase = _one_after_the_other(parts)
    start, duration = motion.start[first_phase], np.add.reduceat(motion.duration, first_phase)
    step = np.minimum(limits.period, duration / _LEAST_SAMPLES) / _PHASES
    counts = np.floor(duration / step * (1.0 - 1e-6)).astype(np.int64) + 1
    number = np.repeat(np.arange(len(parts)), counts)
    within = np.arange(number.size) - np.repeat(np.cumsum(counts) - counts, counts)
    s, _ = motion.place_and_feed(start[number] + within * step[number])
    position = track.derivatives(*track.locate(s), 0)[0]
    worst = np.zeros(len(parts))
    difference = position
    for order in (1, 2, 3):
        difference = difference[_PHASES:] - difference[:-_PHASES]
        first, last = number[: len(difference)], number[order * _PHASES :]
        period = _PHASES * step[first]
        ratio = largest(np.abs(difference) / limits.of_order(order)) / period**order
        whole = first == last
        np.maximum.at(worst, first[whole], ratio[whole])
    return worst


def _one_after_the_other(parts: Sequence[SiteSpan]) -> tuple[MotionLaw, IntArray]:
    """Make one motion of the stretches, which jumps from each to the next; also where each of them begins."""
    phases: list[Phase] = []
    first = np.zeros(len(parts), dtype=np.int64)
    for number, part in enumerate(parts):
        first[number] = len(phases)
        phases += part.phases(part.cruise)
    return MotionLaw.from_phases(phases), first


def assemble(schedule: Schedule, sites: tuple[Site, ...], laid: list[SiteSpan]) -> MotionLaw:
    """Replace the plateaus of a schedule by the profiles laid on them, a phase for every piece."""
    plateaus = np.flatnonzero(schedule.window >= 0)
    parts = [laid[number] for number in schedule.window[plateaus].tolist()]
    levels = schedule.speed[plateaus, 0].tolist()
    laid_out = [_with_calm(part, level) for part, level in zip(parts, levels, strict=True)]
    count = np.ones(schedule.s.size, dtype=np.int64)
    count[plateaus] = [len(phases) for phases in laid_out]
    # Constant speed is of degree 0, so that it is recognised and evaluated without rounding.
    group = 1 * np.all(schedule.speed == schedule.speed[:, :1], axis=1)
    row = np.where(group == 1, np.cumsum(group), np.cumsum(1 - group)) - 1
    speeds = [schedule.speed[group == 0], schedule.speed[group == 1][:, :1]]
    source = np.repeat(np.arange(count.size), count)
    duration, s, group, row = schedule.duration[source], schedule.s[source], group[source], row[source]
    window = np.full(source.size, -1)
    tables: dict[int, list[Array]] = {}
    first = (np.cumsum(count) - count)[plateaus].tolist()
    for part, phases, begin in zip(parts, laid_out, first, strict=True):
        for i, phase in enumerate(phases, begin):
            table = tables.setdefault(phase.speed.size, [])
            duration[i], s[i] = phase.duration, phase.s
            window[i] = sites[part.site].window if phase.window >= 0 else -1
            group[i], row[i] = len(speeds) + list(tables).index(phase.speed.size), len(table)
            table.append(phase.speed)
    speeds += [np.array(table) for table in tables.values()]
    return MotionLaw(duration, s, speeds, group, row, window)


def _with_calm(part: SiteSpan, level: float) -> list[Phase]:
    """Phases of a profile, and the constant feed before and behind it."""
    own = part.phases(level, window=0)
    ways = ((part.s0 - part.ahead, part.ahead), (part.s1, part.behind))
    ahead, behind = (
        [Phase(start=0.0, duration=way / level, s=s, speed=frozen([level]))] if way > 0.0 else [] for s, way in ways
    )
    return [*ahead, *own, *behind]
