"""Run rounded corners of a path in nearly the least time.

The plan by nodes comes to a bend with no acceleration, and leaves it so; around a rounded corner, which is tight and
short, that costs more than a stop. From where the feed is steady before such a corner to where it is behind it, the
speeds of nearly the least time take its place.
"""

from __future__ import annotations

from typing import Final, NamedTuple
from weakref import WeakKeyDictionary

import msgspec
import numpy as np

from ph_post.compensate.bend_speeds import BendLimits, least_time_speeds, phases_between
from ph_post.compensate.limit_curve import UNBOUNDED, VELOCITY_SHARE, AxisLimits, LimitCurve
from ph_post.compensate.motion import MotionLaw
from ph_post.compensate.nominal import SAME_PLACE, Nodes, add_plateaus
from ph_post.compensate.speed_ramps import ramp_distance
from ph_post.geometry.joints import find_joints
from ph_post.geometry.track import Track
from ph_post.types import Array, Phase

CELL: Final = 2.5e-3
"""Time [s] between the places of a stretch."""

LEAST_PLACES: Final = 60
"""Places on a stretch at least."""

MOST_PLACES: Final = 900
"""Places on a stretch; one with more of them keeps the plan by nodes."""

FINEST_PLACES: Final = 900
"""Places on a stretch whose corners are passed quickly."""

ON_CORNER: Final = 12
"""Places on each corner, if they are not too many."""

MARGIN: Final = 0.985
"""Part of the limits that is used, for what changes between the places."""

LONG: Final = 0.02
"""Time [s] for which a feed that is steady below the programmed one ends a stretch."""

STEADY: Final = 0.95
"""Part of the programmed feed from which a steady feed ends a stretch."""

SLOWED: Final = 0.03
"""Part by which speeds are lower in the middle with which a solution begins: on other places they break limits."""

REST: Final = 1e-9
"""Part of the highest speed below which an end is at rest."""

ATTEMPTS: Final = 8
"""Solutions at most until no sample breaks a limit."""

LOCAL: Final = 4
"""The first of these solutions, of which only the places are corrected where samples break a limit."""

TIGHTER: Final = 1.015
"""How much more than what samples take too much of a limit is left unused there."""

TO_SAMPLES: Final = 0.996
"""Part of the limits that samples are to use."""

ENOUGH: Final = 1.003
"""How much more than that they may use."""

PHASES: Final = 4
"""Samples a servo period that are looked at: which of them the plan has is not known yet."""

REACH: Final = 1.5
"""Servo periods around a sample whose limits count for it: a third difference takes three."""

WIDEST: Final = 4
"""Places for which they stand at most."""

MOST_SOLVED: Final = 500
"""Corners that differ from each other for which speeds are sought, some 0.03 s each; others keep the plan by nodes."""


_SOLVED: WeakKeyDictionary[Track, dict[bytes, tuple[Array, Array] | None]] = WeakKeyDictionary()
"""Places and speeds that were found, by track and by what they follow from: every plan of a track finds the same."""


class _Stretch(NamedTuple):
    """Phases from `first` to before `behind`."""

    first: int
    behind: int


class RoundedCorners:
    """The rounded corners of a track, and the speeds that were found for them.

    Parameters
    ----------
    track : Track
    limits : AxisLimits
        Limits to plan with.
    caps : LimitCurve
        Of the same.
    """

    def __init__(self, track: Track, limits: AxisLimits, caps: LimitCurve) -> None:
        self._track, self._limits, self._caps = track, limits, caps
        segments = track.path.segments
        rounded = np.flatnonzero([segments[number].rounded for number in track.segment.tolist()])
        self._spans = [(float(track.starts[k]), float(track.starts[k + 1])) for k in rounded.tolist()]
        asked = [UNBOUNDED if one.rapid else one.feed or track.path.feed for one in segments]
        self._feeds = np.array(asked)[track.segment]
        joints = find_joints(track) if self._spans else None
        self._jumps = np.zeros(0) if joints is None else joints.s[_jumps(joints.curvature_jump, joints.tangent_jump)]
        self._known = _SOLVED.setdefault(track, {})

    def expect(self, caps: LimitCurve) -> LimitCurve:
        """Return caps that ask for no more than the limits allow on rounded corners: nothing is said of these."""
        on = np.zeros(caps.s.size, dtype=np.bool_)
        for s0, s1 in self._spans:
            on |= (caps.s >= s0) & (caps.s <= s1)
        return msgspec.structs.replace(
            caps, programmed=np.where(on, np.minimum(caps.programmed, caps.soft), caps.programmed)
        )

    def add_nodes(self, nodes: Nodes) -> Nodes:
        """Add nodes where the motion could stop before a rounded corner, and come from behind one, at full feed.

        What is planned beyond them is then not held down by the bend.
        """
        if not self._spans:
            return nodes
        starts, ends = np.array(self._spans).T
        ways = np.array([self._stopping_way(s) for s in starts.tolist()])
        others = np.concatenate([nodes.s0, starts, ends])
        before, behind = starts - ways, ends + ways
        for k, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
            before[k] = max(before[k], 0.5 * (start + float(others[others < start].max(initial=0.0))))
            behind[k] = min(behind[k], 0.5 * (end + float(others[others > end].min(initial=self._track.length))))
        s = np.unique(np.concatenate([before, behind]))
        inside = np.any((s[:, None] > starts) & (s[:, None] < ends), axis=1)
        s = s[~inside & (s > SAME_PLACE) & (s < self._track.length - SAME_PLACE)]
        s = s[np.diff(s, prepend=-1.0) > SAME_PLACE]
        return add_plateaus(nodes, s, s, np.full(s.size, np.inf), np.full(s.size, -1))

    def _stopping_way(self, s: float) -> float:
        """Way [m] on which the motion stops from the feed at a place, with the lowest limits of all axes."""
        v = min(self._feed(s), float(np.linalg.norm(self._limits.velocity)))
        a, j = float(self._limits.acceleration.min()), float(self._limits.jerk.min())
        return float(ramp_distance(np.array(0.0), np.array(v), np.array(a), np.array(j)))

    def quicken(self, motion: MotionLaw, factor: Array) -> MotionLaw:
        """Return a motion with speeds of nearly the least time around rounded corners where nothing else is planned.

        Parameters
        ----------
        motion : MotionLaw
        factor : Array
            How much slower than the limits allow the motion has to be, at the points of the caps.
        """
        if not self._spans:
            return motion
        phases = motion.phases()
        made: list[Phase] = []
        done, changed = 0, False
        for stretch in self._stretches(phases):
            made += phases[done : stretch.first]
            old = phases[stretch.first : stretch.behind]
            new = self._quickened(old, factor)
            changed = changed or new is not old
            made += new
            done = stretch.behind
        return MotionLaw.from_phases([*made, *phases[done:]]) if changed else motion

    def _stretches(self, phases: tuple[Phase, ...]) -> list[_Stretch]:
        """Find the phases around every corner, and join what overlaps; none that modulate a window are among them.

        They begin and end where the feed is steady, or at a rest; where that is too far, at the fastest place on the
        way.
        """
        found: list[_Stretch] = []
        for whole, spans in self._joined(phases, self._spans, peaks=False):
            fits = _places(phases, whole) <= MOST_PLACES
            found += [whole] if fits else [part for part, _ in self._joined(phases, spans, peaks=True)]
        return [one for one in found if all(phase.window < 0 for phase in phases[one.first : one.behind])]

    def _joined(
        self, phases: tuple[Phase, ...], spans: list[tuple[float, float]], *, peaks: bool
    ) -> list[tuple[_Stretch, list[tuple[float, float]]]]:
        """Find the stretches around corners, those that overlap as one, and the corners of each."""
        begins = np.array([phase.s for phase in phases])
        found: list[tuple[_Stretch, list[tuple[float, float]]]] = []
        for span in spans:
            first = int(np.searchsorted(begins, span[0], side="right")) - 1
            one = self._around(phases, first, int(np.searchsorted(begins, span[1], side="left")), peaks=peaks)
            if found and one.first < found[-1][0].behind:
                last, corners = found.pop()
                found.append((_Stretch(last.first, max(one.behind, last.behind)), [*corners, span]))
            else:
                found.append((one, [span]))
        return found

    def _around(self, phases: tuple[Phase, ...], first: int, behind: int, *, peaks: bool) -> _Stretch:
        """Widen a stretch of phases to where it may end."""
        while first > 0 and not self._ends(phases[first - 1], phases[first], 1.0, peaks):
            first -= 1
        while behind < len(phases) and not self._ends(phases[behind], phases[behind - 1], -1.0, peaks):
            behind += 1
        return _Stretch(first, behind)

    def _ends(self, outer: Phase, inner: Phase, sense: float, peaks: bool) -> bool:
        """Return whether a stretch ends between a phase outside of it and its own first or last one."""
        at = -1 if sense > 0.0 else 0
        speed = float(outer.speed[at])
        if outer.window >= 0 or speed == 0.0:
            return True
        change = float(outer.speed[-1] - outer.speed[0]) * sense
        if change == 0.0:
            steady = speed >= STEADY * self._feed(0.5 * (outer.s + inner.s))
            return steady or outer.duration >= LONG
        return peaks and change > 0.0

    def _feed(self, s: float) -> float:
        """Return the feed asked for at a place, at a joint that of the later piece [m/s]."""
        return float(self._feeds[np.searchsorted(self._track.starts[1:-1], s, side="right")])

    def _quickened(self, old: tuple[Phase, ...], factor: Array) -> tuple[Phase, ...]:
        """Return phases of nearly the least time over the same way, or the old ones."""
        places = _places(old, _Stretch(0, len(old)))
        if places > MOST_PLACES:
            return old
        motion = MotionLaw.from_phases(old)
        begin, way = old[0].s, old[-1].s + old[-1].duration * float(old[-1].speed.mean())
        s, v = _sampled(motion, places, begin, way)
        if np.any(v[1:-1] <= 0.0) or np.any(np.diff(s) <= 0.0):
            return old
        limits = self._bounds(s, factor)
        key = _key(limits, v)
        if key not in self._known:
            if len(self._known) >= MOST_SOLVED:
                return old
            self._known[key] = self._solve(limits, v, factor)
        known = self._known[key]
        if known is None:
            return old
        shift, v = known
        new = _law(begin + shift, v)
        return old if new.end >= motion.end else new.phases()

    def _solve(self, limits: BendLimits, v: Array, factor: Array) -> tuple[Array, Array] | None:
        """Places from the beginning of a stretch and speeds there, None where none keep the limits.

        The second solution has its places where the first is slow. Where samples of it break a limit, less of that is
        used beside them, until none does.
        """
        s, found = limits.s, least_time_speeds(limits, v)
        if found is None:
            return None
        motion = _law(s, found)
        s, v = _sampled(motion, self._places_for(motion, s), float(s[0]), float(s[-1]))
        limits = self._bounds(s, factor)
        share = np.ones(limits.values.shape)
        for attempt in range(ATTEMPTS):
            v *= 1.0 - SLOWED * np.sin(np.linspace(0.0, np.pi, v.size)) ** 2
            found = least_time_speeds(msgspec.structs.replace(limits, values=limits.values * share), v)
            if found is None:
                return None
            v = found
            used = self._used(_law(s, v), limits, s)
            if used.max() <= ENOUGH:
                return s - s[0], v
            # Here and there at first, then everywhere: limits that change from place to place may make others break.
            used = used if attempt < LOCAL else np.broadcast_to(used.max(axis=(1, 2), keepdims=True), used.shape)
            share = share / np.where(used > 1.0, used * TIGHTER, 1.0)
        return None

    def _places_for(self, motion: MotionLaw, s: Array) -> int:
        """Return how many places a motion needs, so that some lie on each of its corners."""
        inside = [span for span in self._spans if s[0] < span[0] and span[1] < s[-1]]
        passed = np.interp(np.array(inside), s, np.append(motion.start, motion.end))
        cell = min(CELL, float(np.diff(passed, axis=1).min()) / ON_CORNER) if inside else CELL
        return int(min(max(s.size - 1, motion.end / cell), FINEST_PLACES))

    def _used(self, motion: MotionLaw, limits: BendLimits, s: Array) -> Array:
        """Parts of the limits that samples use near the places of a motion, shape (3, n, d); speeds are left out."""
        from scipy.ndimage import maximum_filter1d

        period = self._limits.period
        t = np.arange(-3.0 * period, motion.end + 3.0 * period, period / PHASES)
        place, _ = motion.place_and_feed(t)
        # Outside of the stretch the motion goes on as it begins and ends.
        first, last = motion.speeds[0][0, 0], motion.speeds[-1][motion.row[-1], -1]
        place = np.where(t < 0.0, s[0] + t * first, np.where(t > motion.end, s[-1] + (t - motion.end) * last, place))
        difference = self._track.derivatives(*self._track.locate(place))[0]
        used = np.zeros(limits.values.shape)
        starts = np.append(motion.start, motion.end)
        for order in (1, 2, 3):
            difference = difference[PHASES:] - difference[:-PHASES]
            if order == 1:
                continue
            middle = t[: len(difference)] + 0.5 * order * period
            rate = np.abs(difference) / period**order / (limits.values[order - 1, 0] / MARGIN * TO_SAMPLES)
            number = np.searchsorted(starts, middle)
            reach = round(REACH * period / max(float(motion.duration.min()), REACH * period / WIDEST)) + 1
            own = np.zeros((starts.size + 1, rate.shape[1]))
            np.maximum.at(own, number, rate)
            near = maximum_filter1d(own, 2 * reach + 2, axis=0, mode="constant", origin=-1)
            used[order - 1] = near[: starts.size]
        return used

    def _bounds(self, s: Array, factor: Array) -> BendLimits:
        """Evaluate what bounds the motion at places [m] of the path."""
        piece, u = self._track.locate(s)
        jet = self._track.arc_derivatives(piece, u, 3)[1:]
        slower = np.interp(s, self._caps.s, factor)
        feed = self._feeds[piece]
        # Beside a joint the limits of what is joined count, with what the joint itself takes.
        step = np.max(np.diff(s))
        beside = np.any(np.abs(s[:, None] - self._jumps) <= 2.0 * step, axis=1)
        feed = np.where(beside, np.minimum(feed, np.interp(s, self._caps.s, self._caps.hard)), feed) * slower
        used = np.array([VELOCITY_SHARE, MARGIN, MARGIN])[:, None] * self._limits.values
        values = used[:, None] * np.stack([slower, slower**2, slower**3])[..., None]
        return BendLimits(s=s, jet=jet, feed=feed, values=values)


def _jumps(curvature: Array, tangent: Array) -> Array:
    """Joints at which the curvature or the tangent jumps by more than rounding."""
    bent = ~(np.linalg.norm(curvature, axis=1) < 1e-3)
    found: Array = bent | (np.linalg.norm(tangent, axis=1) > 1e-9)
    return found


def _places(phases: tuple[Phase, ...], stretch: _Stretch) -> int:
    """Return the number of places that a stretch needs."""
    time = sum(phase.duration for phase in phases[stretch.first : stretch.behind])
    return max(LEAST_PLACES, round(time / CELL))


def _law(s: Array, v: Array) -> MotionLaw:
    """Motion with speeds at places, from the instant 0."""
    duration, speed = phases_between(s, v)
    none = np.zeros(duration.size, dtype=np.int64)
    return MotionLaw(duration, s[:-1], [speed], none, np.arange(duration.size), none - 1)


def _sampled(motion: MotionLaw, places: int, begin: float, end: float) -> tuple[Array, Array]:
    """Places [m] and speeds [m/s] of a motion at instants that are equally far apart, its ends among them."""
    s, v = motion.place_and_feed(np.linspace(0.0, motion.end, places + 1))
    s[0], s[-1] = begin, end
    v[[0, -1]] = np.where(v[[0, -1]] > REST * v.max(), v[[0, -1]], 0.0)
    return s, v


def _key(limits: BendLimits, v: Array) -> bytes:
    """Digits by which stretches are told apart."""
    scale = np.abs(limits.jet).max(axis=(1, 2), keepdims=True)
    parts = (
        limits.s - limits.s[0],
        limits.feed,
        v,
        limits.values[:, 0],
        np.round(limits.jet / np.maximum(scale, 1e-12), 6),
    )
    rounded = [np.round(part / max(float(np.abs(part).max()), 1e-300), 6) + 0.0 for part in parts]
    sizes = [f"{float(np.abs(part).max()):.6e}" for part in (*parts, scale)]
    return b"".join([one.tobytes() for one in rounded]) + " ".join(sizes).encode()
