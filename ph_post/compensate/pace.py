"""What a planned motion costs: time, slowest feed, standstill, moving back, and peak acceleration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.limits import at_rest_before_and_after, differences, runs
from ph_post.compensate.motion import Motion
from ph_post.compensate.plan import cycle_time
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, Command, Phase, Plan

STILL: Final = 1e-9
"""Feeds up to this part of the highest are a standstill."""

POINTS: Final = 33
"""Instants at which every phase is looked at, an odd number: the middle of a dip is one of them."""


class Pace(msgspec.Struct, frozen=True, kw_only=True):
    """How a motion runs along its path.

    `min_feed` [m/s] is the lowest feed while cutting, negative while the tool moves back, None where nothing
    is cut. Rapid segments do not count, nor do standstills and the ramps from and to them, which pass every
    feed. `standstill_time` [s] is what is spent at feed zero; `peak_acceleration` [m/s²] the largest of all
    axes and samples, offsets included.
    """

    cycle_time: float
    min_feed: float | None
    standstill_time: float
    retrograde: bool
    peak_acceleration: float


def pace_of(plan: Plan, command: Command, track: Track) -> Pace:
    """Measure a plan, and the command that is written for it."""
    s, feed = _feed_along(plan.phases)
    still = STILL * float(np.abs(feed).max(initial=0.0))
    rapid = np.array([segment.rapid for segment in plan.path.segments])
    segment, _ = track.to_xi(*track.locate(np.clip(s, 0.0, track.length)))
    return Pace(
        cycle_time=cycle_time(plan.phases),
        min_feed=slowest_feed(feed, np.asarray(~rapid[segment]), still),
        standstill_time=sum(
            (phase.duration for phase in plan.phases if np.abs(phase.speed).max() <= still), start=0.0
        ),
        retrograde=bool((feed < -still).any()),
        peak_acceleration=peak_acceleration(command),
    )


def peak_acceleration(command: Command) -> float:
    """Largest second difference of all axes over the period's square [m/s²]."""
    before, after = bool(command.feed[0] == 0.0), bool(command.feed[-1] == 0.0)
    position = at_rest_before_and_after(command.position, before, after)
    return float(np.abs(differences(position, 2, command.period)).max(initial=0.0))


def slowest_feed(feed: Array, cutting: BoolArray, still: float = 0.0) -> float | None:
    """Lowest feed while cutting, without standstills and the ramps from and to them; None if none is left.

    A ramp lasts as long as the feed goes on rising from a standstill, or falling towards one.

    Examples
    --------
    >>> slowest_feed(np.array([0.0, 1.0, 3.0, 2.0, 3.0, 0.0]), np.ones(6, dtype=np.bool_))
    2.0
    """
    lowest: list[float] = []
    for run in runs(np.flatnonzero(np.abs(feed) > still)):
        first, last = int(run[0]), int(run[-1])
        if first > 0:
            first += _ramp(feed[first : last + 1])
        if last < feed.size - 1:
            last -= _ramp(feed[first : last + 1][::-1])
        counted = feed[first : last + 1][cutting[first : last + 1]]
        lowest += [float(counted.min())] if counted.size else []
    return min(lowest, default=None)


def _ramp(feed: Array) -> int:
    """Count the samples over which the feed goes on rising from the first."""
    falls = np.flatnonzero(np.diff(feed) <= 0.0)
    return int(falls[0]) if falls.size else feed.size - 1


def _feed_along(phases: Sequence[Phase]) -> tuple[Array, Array]:
    """Arc length [m] and feed [m/s] at points of every phase, both its ends included."""
    within = np.linspace(0.0, 1.0, POINTS)
    t = np.concatenate([phase.start + phase.duration * within for phase in phases])
    return Motion.from_phases(phases).place_and_feed(t)
