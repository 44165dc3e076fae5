"""Where the profiles go: how much of a window has room for one, and at which feed.

A site is a stretch of path with one profile on it. It begins and ends at the feed V_c, which is the lowest
that the plain plan has on it, so that a plateau of that feed can be had there without going any faster.
"""

from __future__ import annotations

import msgspec

from ph_post.compensate import shapes
from ph_post.compensate.feedalong import FeedAlong
from ph_post.compensate.strategies.base import Wish
from ph_post.types import Phase, Shape, Window
from ph_post.units import MM, MS

STEADY = 0.95
"""Part of the feed at the turning point that the plain plan must keep all over a site."""

SLOWEST = 0.5
"""Likewise where a site would otherwise be too short for the backlash interval."""

SAME_PLACE = 1e-12
"""Lengths of path below this [m] are none."""


class Site(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A profile's place: 2 `half` [m] of path with `s` [m] inside, entered and left at `cruise` [m/s].

    `window` is the index of its window; `shape` is the one wanted; `wish` is what the strategy asked for, the
    share of the way before the turning point included; `notes` say what was cut off.
    """

    window: int
    s: float
    half: float
    cruise: float
    shape: Shape
    wish: Wish
    notes: tuple[str, ...] = ()

    @property
    def ends(self) -> tuple[float, float]:
        """Where it begins and ends along the path [m]; over the seam of a closed one it counts on."""
        turn = self.wish.turn
        return self.s - 2.0 * turn * self.half, self.s + 2.0 * (1.0 - turn) * self.half


class Stretch(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Part of a site that lies on the path without a break: [s0, s1] [m] and the profile's part there."""

    site: int
    s0: float
    s1: float
    cruise: float
    shape: Shape

    def phases(self, cruise: float, start: float = 0.0, window: int = -1) -> list[Phase]:
        """Phases of the stretch, one a piece, where it is entered at `cruise` [m/s] and at `start` [s]."""
        duration = (self.s1 - self.s0) / (cruise * shapes.mean(self.shape))
        found = []
        t, s = start, self.s0
        for piece in self.shape.pieces:
            speed = cruise * piece.coefficients
            part = duration * piece.share
            found.append(Phase(start=t, duration=part, s=s, speed=speed, window=window))
            t, s = t + part, s + part * float(speed.mean())
        return found


def find_site(index: int, window: Window, wish: Wish, feed: FeedAlong, room: float) -> Site | str:
    """Fit a wish into its window.

    Parameters
    ----------
    index : int
        Index of the window.
    window : Window
    wish : Wish
        With a shape.
    feed : FeedAlong
    room : float
        Half the distance to the next window with a profile [m].

    Returns
    -------
    Site or str
        The site, or the reason why there is none.
    """
    assert wish.shape is not None
    cruise = feed.at(window.s)
    if cruise <= 0.0:
        return "the motion stops here"
    mean = shapes.mean(wish.shape)
    room = max(min(room, window.s - feed.first, feed.last - window.s), 0.0)
    # What a side may take is what the longer one takes; in the middle of the way both are alike.
    longer = 2.0 * max(wish.turn, 1.0 - wish.turn)
    wanted = longer * cruise * mean * wish.t_star
    most = wanted if wish.may_leave else min(wanted, window.half_length)
    side = feed.steady_half(window.s, min(most, room), STEADY * cruise)
    needed = min(most, longer * cruise * mean * wish.least)
    if side < needed * (1.0 - 1e-9):
        # Where the feed changes quickly a lower plateau is better than none.
        side = min(needed, room)
        if side < needed or feed.lowest(window.s, side) < SLOWEST * cruise:
            return f"no room: {needed / MM:.3g} mm of steady feed on either side are needed"
    lowest, half = feed.lowest(window.s, side), side / longer
    if side <= SAME_PLACE or lowest < SLOWEST * cruise:
        return "no room for it: the path starts or ends here, or the motion stops"
    notes = tuple(_notes(window, wish, side, most, half / (lowest * mean)))
    return Site(window=index, s=window.s, half=half, cruise=lowest, shape=wish.shape, wish=wish, notes=notes)


def _notes(window: Window, wish: Wish, side: float, most: float, t_star: float) -> list[str]:
    notes = [wish.note] if wish.note else []
    if side < most * (1.0 - 1e-6):
        notes.append(
            f"profile shortened from {most / MM:.4g} mm to {side / MM:.4g} mm on either side, where the feed "
            "changes, the path ends or the next profile begins"
        )
    if side > window.half_length * (1.0 + 1e-9):
        notes.append(
            "the profile is longer than the window in which the osculating circle stands for the path"
        )
    if t_star < wish.least * (1.0 - 1e-9):
        notes.append(
            f"the window holds t* = {t_star / MS:.4g} ms only, less than the backlash interval of "
            f"{wish.least / MS:.4g} ms"
        )
    return notes


def stretches(number: int, site: Site, shape: Shape, length: float) -> list[Stretch] | str:
    """Lay a site's profile on the path, in two parts where it runs over the seam of a closed one.

    Returns
    -------
    list of Stretch or str
        The stretches, or the reason why the profile cannot be had.
    """
    s0, s1 = site.ends
    for turn in (-length, 0.0, length):
        if s0 + turn >= -SAME_PLACE and s1 + turn <= length + SAME_PLACE:
            low, high = max(s0 + turn, 0.0), min(s1 + turn, length)
            return [Stretch(site=number, s0=low, s1=high, cruise=site.cruise, shape=shape)]
    seam = length if s1 > length else 0.0
    first, second = shapes.split(shape, (seam - s0) / (s1 - s0), SAME_PLACE / (s1 - s0))
    if not (shapes.is_non_negative(first) and shapes.is_non_negative(second)):
        return "the feed would become negative on the seam of the path, where the motion begins"
    return [
        Stretch(site=number, s0=s0 - seam + length, s1=length, cruise=site.cruise, shape=first),
        Stretch(site=number, s0=0.0, s1=s1 - seam, cruise=site.cruise, shape=second),
    ]
