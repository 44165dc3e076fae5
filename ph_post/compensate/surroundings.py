"""What is around a window: the feed there, the path that may be used, and where every axis comes from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from ph_post.analysis import Analysis
from ph_post.compensate.feedalong import FeedAlong
from ph_post.geometry.track import Track
from ph_post.types import TurningPoint, Window, frozen

STEADY = 0.95
"""Part of the feed at the turning point that counts as the same feed."""

REACH = 5.0
"""How far one looks on either side, in seconds at the feed of the place."""

SAME_PLACE = 1e-9
"""Places along the path less than this [m] apart are one."""

SIDEWAYS = 1e-9
"""An axis whose part of the tangent is less than this does not move at a place."""


class Surroundings(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The surroundings of a window.

    `s` [m] is the turning point's, `cruise` [m/s] the feed of the plain plan there. `room` [m] is half the
    way to the next window, as far as the feed is steady: what a profile may take on either side. `before`
    and `behind` [m] are the path that is run at about that feed. `flanks` has the direction (1, -1) in which
    each axis moved before.
    """

    s: float
    cruise: float
    room: float
    before: float
    behind: float
    flanks: Mapping[str, int]


def find_surroundings(analysis: Analysis, feed: FeedAlong, looped: bool) -> tuple[Surroundings | None, ...]:
    """Look around every window; None where the motion begins, ends or rests."""
    windows = analysis.windows
    length = analysis.track.length
    rooms = half_distances([window.s for window in windows], length, looped)
    found: list[Surroundings | None] = []
    for window, half in zip(windows, rooms, strict=True):
        cruise = feed.at(window.s)
        sides = feed.steady_sides(window.s, REACH * cruise, STEADY * cruise) if cruise > 0.0 else (0.0, 0.0)
        if min(*sides, half) <= 0.0:
            found.append(None)
            continue
        flanks = {name: _flank(analysis, window, k) for k, name in enumerate(analysis.path.axes)}
        room = min(*sides, half)
        cruise = feed.lowest(window.s, room)
        around = Surroundings(
            s=window.s, cruise=cruise, room=room, before=sides[0], behind=sides[1],
            flanks=flanks,
        )  # fmt: skip
        found.append(around)
    return tuple(found)


def half_distances(places: Sequence[float], length: float, looped: bool) -> list[float]:
    """Half the distance from every place to the nearest other one [m]; the places ascend."""
    s = frozen(places)
    if s.size == 0 or (s.size == 1 and not looped):
        return [np.inf] * s.size
    gap = np.diff(np.concatenate([[s[-1] - length], s, [s[0] + length]]))
    if not looped:
        gap[[0, -1]] = np.inf
    rooms: list[float] = (0.5 * np.minimum(gap[:-1], gap[1:])).tolist()
    return rooms


def flanks_before(analysis: Analysis) -> dict[str, int]:
    """Side on which each axis was pushed before the beginning of a path that is run as a loop."""
    names = analysis.path.axes
    seam = {point.axis: point for point in analysis.turning_points if point.s <= SAME_PLACE}
    return {
        name: came_from(seam[name]) if name in seam else heading(analysis.track, 0.0, number)
        for number, name in enumerate(names)
    }


def _flank(analysis: Analysis, window: Window, number: int) -> int:
    """Direction in which an axis moved before a window's turning point."""
    name = analysis.path.axes[number]
    own = [point for index in window.members if (point := analysis.turning_points[index]).axis == name]
    return came_from(own[0]) if own else heading(analysis.track, window.s, number)


def came_from(point: TurningPoint) -> int:
    """Direction in which the axis of a turning point moved before it: up to a maximum, down to a minimum."""
    return 1 if point.sense == "max" else -1


def heading(track: Track, s: float, number: int) -> int:
    """Direction (1, -1) in which an axis moves at a place; 0 where it does not."""
    tangent = track.arc_derivatives(*track.locate(np.array([s])), 1)[1, 0, number]
    return 0 if abs(tangent) < SIDEWAYS else int(np.sign(tangent))
