"""Is there room for inverse dynamics: where the command that leads a motion breaks a limit, and what would help."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ph_post.compensate.friction import friction_of_machine, friction_share
from ph_post.compensate.inverse import lead_memory, lead_of_force, lead_of_motion, lead_when_steady, remembers
from ph_post.compensate.lead import END, LETTING_GO, LeadWindow, let_go, memory_of_lead, smoothed
from ph_post.compensate.limit_curve import AxisLimits
from ph_post.compensate.motion import MotionLaw, row_times
from ph_post.compensate.offsets import axis_motion
from ph_post.compensate.smooth_motion import CELLS, rest_at_stops, smooth_motion
from ph_post.compensate.violations import ViolationSpans, at_rest_before_and_after, rounding, slower_by
from ph_post.geometry.numeric import runs
from ph_post.geometry.track import Track
from ph_post.types import Array, Axis, BoolArray, Machine

_REACH = 3
"""Rows that the third difference reaches beyond its first."""

_AROUND = 4
"""Rows on either side of a place that are looked at for what constant speed asks for."""

_WIDE = 4.0
"""Windows and cells on either side of a stretch that is looked at again."""

_STILL = 1e-9
"""Speed of an axis [m/s] below which it has no direction."""

_FADED = 5.0
"""Time constants after which little is left of a step in a lead."""

_STRICTER = np.array([0.999, 0.97, 0.97])
"""Parts of speed, acceleration and jerk that room is made for: in the end rows, and the cells of the speed, lie at
other places, which the speed hardly feels."""

_MOSTLY = 0.97
"""Part of the speed that constant speed may keep by which it, and not its change, breaks a limit."""


_GONE = 20.0
"""Time constants after which nothing is left of a lead that shows (e^-20)."""


def unwinding_time(machine: Machine, track: Track, motion: MotionLaw, window: LeadWindow) -> float:
    """Return how long a led motion is to rest behind its end until what a servo remembers of it has died away [s].

    That is until the lead is less than END, and no less than what letting it go takes; 0 where nothing is remembered.
    """
    axes = [machine.axes[name] for name in track.path.axes]
    memory = max(memory_of_lead(axis.servo) for axis in axes)
    if memory == 0.0 or not motion.ends_at_rest:
        return 0.0
    period = machine.servo_period
    rows = math.ceil(_GONE * memory / period)
    t = motion.end - period * np.arange(rows, -1.0, -1.0)
    t = t[t >= 0.0]
    s, feed = motion.place_and_feed(t)
    s[-1] = track.length
    moved = axis_motion(track, s, feed, motion.acceleration(t))[1:]
    speed, acceleration = (np.concatenate([one, np.zeros((rows, len(axes)))]) for one in moved)
    longest = LETTING_GO * window.half * period - CELLS * window.spacing
    for k, axis in enumerate(axes):
        left = np.abs(lead_of_motion(axis, speed[:, k], acceleration[:, k], period)[t.size :]) > END
        longest = max(longest, period * (np.flatnonzero(left)[-1:] + 1.0).sum())
    return float(longest)


class LeadSpans(NamedTuple):
    """Stretches on which a led command breaks a limit; `steady` says where it would at constant speed as well."""

    spans: ViolationSpans
    steady: BoolArray


class LeadRoom:
    """The room that a motion leaves for its lead.

    Parameters
    ----------
    track : Track
    machine : Machine
    limits : AxisLimits
        Of the machine, which the rows of the command have to keep.
    window : LeadWindow
    stops : Array
        Arc lengths at which the motion rests [m].
    part : float
        Part of the lead that the command has.
    tail : float
        Rest behind the end [s], in which integrators unwind.
    """

    def __init__(
        self,
        track: Track,
        machine: Machine,
        limits: AxisLimits,
        window: LeadWindow,
        stops: Array,
        part: float,
        tail: float,
    ) -> None:
        self.track, self.limits, self.window, self.part, self.tail = track, limits, window, part, tail
        self._strict = AxisLimits(values=_STRICTER[:, np.newaxis] * limits.values, period=limits.period)
        self.stops = np.unique(np.concatenate([[0.0], stops, [track.length]]))
        self.friction = friction_of_machine(machine, track.path.axes)
        self.drives: tuple[Axis, ...] = tuple(machine.axes[name] for name in track.path.axes)

    @property
    def reach(self) -> float:
        """Time from which a command is worked out, to either side [s]."""
        return self.window.half * self.limits.period

    def smooth(self, motion: MotionLaw) -> MotionLaw:
        """Smooth the speed of a motion, which rests a little at its stops for that."""
        spacing = self.window.spacing
        return smooth_motion(rest_at_stops(motion, CELLS * spacing, self.tail), spacing)

    def violations(self, motion: MotionLaw, near: ViolationSpans | None = None, *, strict: bool = True) -> LeadSpans:
        """Find where the command that leads a motion breaks a limit; in profiles, the one that does not lead it.

        With `near` only around these places; but an integrator remembers the whole motion. Where it is not `strict`
        all of a limit may be used.
        """
        rows = _Rows(motion, self._instants(motion, near), self.limits.period)
        s, feed, half = rows.s, rows.feed, self.window.half
        if rows.whole and motion.ends_at_rest:
            s[-1] = self.track.length
        phase = motion.phase_at(rows.t)
        position, speed, acceleration = axis_motion(self.track, s, feed, motion.acceleration(rows.t))
        friction, turns = self._friction(speed)
        plain, speed, acceleration = (smoothed(one, half, rows.calm) for one in (position, speed, acceleration))
        lead = self._lead(speed, acceleration)
        if rows.whole and rows.rests[1]:
            lead *= let_go([axis.servo for axis in self.drives], self.window, s.size)[:, np.newaxis]
        led = plain + lead
        noise = rounding(float(np.abs(led).max()), self.track.length, motion.end, float(np.abs(feed).max()))
        limits = self._strict if strict else self.limits
        factor = slower_by(at_rest_before_and_after(led, *rows.rests), limits, noise)
        if self.friction:
            rubbing = slower_by(at_rest_before_and_after(led + friction, *rows.rests), limits, noise)
        shift = _REACH if rows.rests[0] else 0
        row = np.clip(np.arange(factor.size) - shift, 0, s.size - 1)
        in_profile = _around(motion.window[phase] >= 0, half + _REACH)[row]
        if self.friction:
            # Where an axis turns round its friction is led by a change of its own.
            factor = np.where(turns[row], factor, np.minimum(factor, rubbing))
        if in_profile.any():
            without = slower_by(at_rest_before_and_after(plain, *rows.rests), limits, noise)
            factor = np.where(in_profile, without, factor)
        factor[~rows.inside(half + _REACH)[row]] = 1.0
        stretch = runs(np.flatnonzero(factor < 1.0))
        edges = np.array([(one[0], one[-1] + _REACH) for one in stretch], dtype=np.int64).reshape(-1, 2) - shift
        # What breaks a limit began half a window before, and ends half a window behind.
        i, j = np.clip(edges + np.array([-(half // 2), half // 2]), 0, s.size - 1).T
        worst = np.array([factor[one].min() for one in stretch])
        middle = np.array([one[np.argmin(factor[one])] for one in stretch], dtype=np.int64) + _REACH // 2
        at = np.clip(middle - shift, 0, s.size - 1)
        spans = ViolationSpans(np.minimum(s[i], s[j]), np.maximum(s[i], s[j]), rows.t[i], rows.t[j], worst)
        return LeadSpans(spans, self._steady(s[at], np.abs(feed[at])) * worst > _MOSTLY)

    def _instants(self, motion: MotionLaw, near: ViolationSpans | None) -> list[tuple[int, int]]:
        """First and last row of the stretches to look at; `near` are places where the motion was."""
        period = self.limits.period
        last = row_times(motion, period).size - 1
        if near is None or any(remembers(axis.servo) for axis in self.drives):
            return [(0, last)]
        margin = _WIDE * (self.window.half * period + self.window.spacing)
        places = np.maximum.accumulate(motion.s)
        begin = np.interp(near.s0, places, motion.start) - margin
        behind = np.interp(near.s1, places, motion.start + motion.duration) + margin
        rows = np.clip(np.stack([np.floor(begin / period), np.ceil(behind / period)], axis=1), 0, last).astype(np.int64)
        found: list[tuple[int, int]] = []
        for first, end in rows[np.argsort(rows[:, 0])].tolist():
            if found and first <= found[-1][1] + 1:
                found[-1] = (found[-1][0], max(found[-1][1], end))
            else:
                found.append((first, end))
        return found

    def _friction(self, speed: Array) -> tuple[Array, BoolArray]:
        """Share of friction (n, dim) in the command by the direction of motion, and the rows in which that turns.

        Of a cascade they last until the step has died away in its lead.
        """
        share, turns = np.zeros_like(speed), np.zeros(len(speed), dtype=np.bool_)
        for k, axis in enumerate(self.drives):
            moves = np.flatnonzero(np.abs(speed[:, k]) > _STILL)
            if axis.name in self.friction and moves.size:
                last = moves[np.clip(np.searchsorted(moves, np.arange(len(speed)), side="right") - 1, 0, None)]
                turned = np.sign(speed[last, k])
                own = friction_share(self.friction[axis.name], turned, speed[:, k])
                share[:, k] = lead_of_force(axis, own, self.limits.period)
                reach = 2 * _REACH + math.ceil(_FADED * lead_memory(axis.servo) / self.limits.period)
                turns |= _around(np.diff(turned, prepend=turned[:1]) != 0.0, reach)
        return share, turns

    def _lead(self, speed: Array, acceleration: Array) -> Array:
        """Position errors that make the servos move so, arrays (n, dim)."""
        columns = [
            lead_of_motion(axis, speed[:, k], acceleration[:, k], self.limits.period)
            for k, axis in enumerate(self.drives)
        ]
        return np.asarray(self.part * np.stack(columns, axis=1))

    def _steady(self, s: Array, feed: Array) -> Array:
        """Largest use of a limit around places (n,) at constant feed, as the factor by which that is too fast.

        0 near stops, where the feed cannot be constant.
        """
        found = np.zeros(s.size)
        reach = (self.window.half + _AROUND) * self.limits.period * feed
        near = np.searchsorted(self.stops, s - reach) != np.searchsorted(self.stops, s + reach, side="right")
        rows = np.flatnonzero(~near & (feed > 0.0))
        if rows.size:
            found[rows] = self._at_constant_feed(s[rows], feed[rows])
        return found

    def _at_constant_feed(self, s: Array, feed: Array) -> Array:
        half = self.window.half
        tau = np.arange(-half - _AROUND, half + _AROUND + 1) * self.limits.period
        places = np.clip(s[:, None] + feed[:, None] * tau, 0.0, self.track.length).ravel()
        paces = np.repeat(feed, tau.size)
        position, speed, acceleration = axis_motion(self.track, places, paces, np.zeros(places.size))
        lead = [lead_when_steady(axis, speed[:, k], acceleration[:, k]) for k, axis in enumerate(self.drives)]
        command = (position + self.part * np.stack(lead, axis=1)).reshape(s.size, tau.size, -1)
        seen = smoothed(np.moveaxis(command, 1, 0).reshape(tau.size, -1), half)[half:-half]
        worst = np.zeros(s.size)
        for order in (1, 2, 3):
            wide = np.tile(self.limits.of_order(order), s.size)
            ratio = np.abs(np.diff(seen, order, axis=0)) / self.limits.period**order / wide
            worst = np.maximum(worst, ratio.max(axis=0).reshape(s.size, -1).max(axis=1) ** (1.0 / order))
        return worst


class _Rows:
    """Rows of a motion in some stretches, one after the other."""

    def __init__(self, motion: MotionLaw, stretches: Sequence[tuple[int, int]], period: float) -> None:
        last = row_times(motion, period).size - 1
        self.t = np.concatenate([np.arange(first, end + 1) for first, end in stretches]) * period
        self.s, self.feed = motion.place_and_feed(self.t)
        self.whole = list(stretches) == [(0, last)]
        starts, ends = stretches[0][0] == 0, stretches[-1][1] == last
        self.rests = starts and motion.begins_at_rest, ends and motion.ends_at_rest
        # Where a stretch ends and the motion does not, the window sees too little, and rows there do not count.
        self.calm = not starts or motion.begins_at_rest, not ends or motion.ends_at_rest
        self._sizes = [end + 1 - first for first, end in stretches]
        self._true = starts, ends

    def inside(self, reach: int) -> BoolArray:
        """Return which rows are more than `reach` from the ends of their stretch, unless the motion ends there too."""
        within = [np.minimum(np.arange(size), np.arange(size)[::-1]) >= reach for size in self._sizes]
        if self._true[0]:
            within[0][:reach] = True
        if self._true[1]:
            within[-1][-reach:] = True
        return np.concatenate(within)


def _around(rows: BoolArray, reach: int) -> BoolArray:
    """Rows marked, and those up to `reach` beside them."""
    from scipy.ndimage import maximum_filter1d

    return np.asarray(maximum_filter1d(rows, 2 * reach + 1, mode="constant"))
