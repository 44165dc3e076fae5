"""Edits motion by motion, in the order in which they are written: the parts of each, and the stops between them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from itertools import pairwise

import msgspec
from msgspec.structs import replace

from ph_post.edit.edits import CrossingPart, DipEdit, Edits, StopEdit, join_stops
from ph_post.gcode.motion_parts import part_length
from ph_post.gcode.program import Motions

_LEAST_STEPS = 4
"""A part is at least so many steps of the last decimal long: rounding could turn a shorter arc about."""


class MotionPart(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A part of a motion between two shares; `duration` [s] is None where the feed is the program's, or at most `feed`.

    `crossing` says of a part of a crossing how it is written.
    """

    low: float
    high: float
    duration: float | None = None
    crossing: CrossingPart | None = None
    feed: float = math.inf


_WHOLE = MotionPart(low=0.0, high=1.0)


class MotionEdit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The edits of one motion: `parts` in order, `stops` by share, and `labels` of the crossings that begin on it."""

    motion: int
    parts: tuple[MotionPart, ...]
    stops: dict[float, StopEdit]
    labels: tuple[str, ...] = ()

    @property
    def whole(self) -> bool:
        """True where the motion itself stays unchanged."""
        return len(self.parts) == 1 and self.parts[0].duration is None and self.parts[0].crossing is None

    @property
    def crossed(self) -> bool:
        """True where a part of it is one of a crossing."""
        return any(part.crossing is not None for part in self.parts)


def schedule(edits: Edits, motions: Motions, step: float) -> list[MotionEdit]:
    """Gather the edits by motion; `step` [m] is one of the last decimal."""
    timed: dict[int, list[MotionPart]] = {}
    lasting: dict[int, list[MotionPart]] = {}
    for dip in edits.dips:
        for motion, part in _pieces(dip, motions):
            timed.setdefault(motion, []).append(part)
            if dip.lasting:
                lasting.setdefault(motion, []).append(part)
    stops: dict[int, list[StopEdit]] = {}
    for stop in edits.stops:
        stops.setdefault(stop.motion, []).append(stop)
    crossed: dict[int, list[CrossingPart]] = {}
    labels: dict[int, list[str]] = {}
    for crossing in edits.crossings:
        for piece in crossing.parts:
            crossed.setdefault(piece.motion, []).append(piece)
        named = f"crossing {crossing.axis}{'+' if crossing.sign > 0 else '-'}"
        labels.setdefault(crossing.parts[0].motion, []).append(named)
    return [
        _crossed_motion(
            motion,
            crossed[motion],
            lasting.get(motion, []),
            stops.get(motion, []),
            labels.get(motion, []),
            edits.joints.get(motion, ()),
            edits.kept.get(motion, math.inf),
            _least_share(motions, motion, step),
        )
        if motion in crossed
        else _motion_edit(motion, timed.get(motion, []), stops.get(motion, []), motions, step)
        for motion in sorted({*timed, *stops, *crossed})
    ]


def stops_written(tasks: Iterable[MotionEdit], motions: Motions) -> tuple[int, list[StopEdit]]:
    """Count the stops that are more than crossings in a corner, and return what is written there, in order.

    Stops at one share of a motion are one already; a stop at the end of a motion and one at the start of the
    next line's are one standstill as well.
    """
    placed = [
        (task.motion, share, task.stops[share])
        for task in tasks
        for share in sorted(task.stops)
        if not task.stops[share].crosses
    ]
    shared = sum(
        (a[1], b[:2]) == (1.0, (a[0] + 1, 0.0)) and motions.block[b[0]] == motions.block[a[0]] + 1
        for a, b in pairwise(placed)
    )
    return len(placed) - int(shared), [stop for _, _, stop in placed]


def _pieces(dip: DipEdit, motions: Motions) -> Iterable[tuple[int, MotionPart]]:
    """Cut the blocks of a dip at the ends of motions; their time goes by length."""
    places = zip(dip.motion.tolist(), dip.share.tolist(), strict=True)
    for (before, after), duration in zip(pairwise(places), dip.duration.tolist(), strict=True):
        spans = [
            (k, before[1] if k == before[0] else 0.0, after[1] if k == after[0] else 1.0)
            for k in range(before[0], after[0] + 1)
        ]
        lengths = [part_length(motions, *span) for span in spans]
        for (k, low, high), length in zip(spans, lengths, strict=True):
            if high > low and length > 0.0:
                yield k, MotionPart(low=low, high=high, duration=duration * length / sum(lengths))


def _least_share(motions: Motions, motion: int, step: float) -> float:
    """Return the share of a motion below which a part is nothing: its ends could be the same when they are written."""
    length = part_length(motions, motion, 0.0, 1.0)
    return _LEAST_STEPS * step / length if length > 0.0 else 2.0


def _apart(timed: list[MotionPart], crossed: list[CrossingPart], least: float) -> list[MotionPart]:
    """Return the blocks of known time; none where an end is so near to a crossing's that a part would be nothing."""
    edges = [end for part in crossed for end in (part.low, part.high)]
    ends = [end for part in timed for end in (part.low, part.high) if 0.0 < end < 1.0]
    near = any(0.0 < abs(end - edge) < least for end in ends for edge in edges)
    return [] if near else timed


def _crossed_motion(
    motion: int,
    crossed: list[CrossingPart],
    timed: list[MotionPart],
    stops: list[StopEdit],
    labels: list[str],
    joints: Sequence[float],
    feed: float,
    least: float,
) -> MotionEdit:
    """Put the parts of crossings on a motion between those that stay as they are, or are `timed`.

    Next to a part of a crossing there is no part below the share `least`: what is left there belongs to the crossing.
    Written down, such a part of an arc could end where it begins, which is a full circle.
    """
    timed = _apart(timed, crossed, least)
    parts: list[MotionPart] = []
    at = 0.0
    shares = {*(stop.share for stop in stops), *joints, *(end for one in timed for end in (one.low, one.high))}
    for part in (*_joined(crossed, shares, least), None):
        until = 1.0 if part is None else part.low
        between = sorted(share for share in shares if at < share < until)
        for low, high in pairwise((at, *between, until)):
            if high > low:
                known = _timed_part(low, high, timed, {end: end for one in timed for end in (one.low, one.high)})
                parts.append(replace(known, feed=feed))
        if part is not None:
            parts.append(MotionPart(low=part.low, high=part.high, crossing=part))
            at = part.high
    ends = {part.high: part.high for part in parts} | {0.0: 0.0}
    placed = _placed([stop for stop in stops if stop.share in ends], ends)
    return MotionEdit(motion=motion, parts=tuple(parts), stops=placed, labels=tuple(labels))


def _joined(crossed: list[CrossingPart], shares: set[float], least: float) -> list[CrossingPart]:
    """Return the parts of crossings in order, each up to the one before it, and to the ends of the motion, if near."""
    found: list[CrossingPart] = []
    at = 0.0
    for part in sorted(crossed, key=lambda one: one.low):
        near = 0.0 < part.low - at < least and not any(at <= share <= part.low for share in shares - {0.0})
        found.append(replace(part, low=at) if near else part)
        at = part.high
    if 0.0 < 1.0 - at < least and not any(at <= share < 1.0 for share in shares):
        found[-1] = replace(found[-1], high=1.0)
    return found


def _motion_edit(
    motion: int, timed: list[MotionPart], stops: list[StopEdit], motions: Motions, step: float
) -> MotionEdit:
    if not timed and all(stop.share in (0.0, 1.0) for stop in stops):
        return MotionEdit(motion=motion, parts=(_WHOLE,), stops=_placed(stops, {0.0: 0.0, 1.0: 1.0}))
    wanted = sorted({0.0, 1.0, *(stop.share for stop in stops), *(e for p in timed for e in (p.low, p.high))})
    least = _least_share(motions, motion, step)
    snapped = _snap_shares(wanted, least)
    edges = sorted(set(snapped.values()))
    parts = tuple(_timed_part(low, high, timed, snapped) for low, high in pairwise(edges))
    return MotionEdit(motion=motion, parts=parts, stops=_placed(stops, snapped))


def _placed(stops: list[StopEdit], snapped: dict[float, float]) -> dict[float, StopEdit]:
    """Gather stops by the share at which they come to stand; those at one place become one."""
    placed: dict[float, StopEdit] = {}
    for stop in stops:
        at = snapped[stop.share]
        held = placed.get(at)
        placed[at] = stop if held is None else join_stops((held, stop))
    return placed


def _snap_shares(wanted: list[float], least: float) -> dict[float, float]:
    """Move shares together so that no part is shorter than `least`; new share by old."""
    snapped, last = {0.0: 0.0, 1.0: 1.0}, 0.0
    for share in wanted[1:-1]:
        if 1.0 - share < least:
            snapped[share] = 1.0
        else:
            last = share if share - last >= least else last
            snapped[share] = last
    return snapped


def _timed_part(low: float, high: float, timed: list[MotionPart], snapped: dict[float, float]) -> MotionPart:
    """Give a part its share of the time of the piece that it lies in."""
    for piece in timed:
        first, last = snapped[piece.low], snapped[piece.high]
        if first <= low and high <= last and piece.duration is not None:
            return MotionPart(low=low, high=high, duration=piece.duration * (high - low) / (last - first))
    return MotionPart(low=low, high=high)
