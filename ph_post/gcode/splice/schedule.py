"""What has to be written at each motion: its parts, their times, and the stops between them."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import pairwise

import msgspec

from ph_post.gcode.reader.record import Motions
from ph_post.gcode.splice.parts import part_length
from ph_post.gcode.splice.record import Dip, Edits, Stop

_LEAST_STEPS = 4
"""A part is at least so many steps of the last decimal long: rounding could turn a shorter arc about."""


class Part(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a motion between two shares; `duration` [s] is None where the feed is the program's."""

    low: float
    high: float
    duration: float | None = None


_WHOLE = Part(low=0.0, high=1.0)


class Task(msgspec.Struct, frozen=True, kw_only=True):
    """What is done at one motion: `parts` in order, and `stops` by the share at which they stand."""

    motion: int
    parts: tuple[Part, ...]
    stops: dict[float, Stop]

    @property
    def whole(self) -> bool:
        """Whether the motion itself stays as it is."""
        return len(self.parts) == 1 and self.parts[0].duration is None


def schedule(edits: Edits, motions: Motions, step: float) -> list[Task]:
    """Gather the changes by motion; `step` [m] is one of the last decimal."""
    timed: dict[int, list[Part]] = {}
    for dip in edits.dips:
        for motion, part in _pieces(dip, motions):
            timed.setdefault(motion, []).append(part)
    stops: dict[int, list[Stop]] = {}
    for stop in edits.stops:
        stops.setdefault(stop.motion, []).append(stop)
    return [
        _task(motion, timed.get(motion, []), stops.get(motion, []), motions, step)
        for motion in sorted({*timed, *stops})
    ]


def stops_written(tasks: Iterable[Task], motions: Motions) -> tuple[int, list[Stop]]:
    """Count the places at which the path stands, and return what is written there, in order.

    Stops that came to one seat are one already. One at the end of a motion and one at the start of the next
    line's are one standstill as well.
    """
    placed = [(task.motion, share, task.stops[share]) for task in tasks for share in sorted(task.stops)]
    shared = sum(
        (a[1], b[:2]) == (1.0, (a[0] + 1, 0.0)) and motions.block[b[0]] == motions.block[a[0]] + 1
        for a, b in pairwise(placed)
    )
    return len(placed) - int(shared), [stop for _, _, stop in placed]


def _pieces(dip: Dip, motions: Motions) -> Iterable[tuple[int, Part]]:
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
                yield k, Part(low=low, high=high, duration=duration * length / sum(lengths))


def _task(motion: int, timed: list[Part], stops: list[Stop], motions: Motions, step: float) -> Task:
    if not timed and all(stop.share in (0.0, 1.0) for stop in stops):
        return Task(motion=motion, parts=(_WHOLE,), stops=_placed(stops, {0.0: 0.0, 1.0: 1.0}))
    wanted = sorted({0.0, 1.0, *(stop.share for stop in stops), *(e for p in timed for e in (p.low, p.high))})
    length = part_length(motions, motion, 0.0, 1.0)
    least = _LEAST_STEPS * step / length if length > 0.0 else 2.0
    seat = _seats(wanted, least)
    edges = sorted(set(seat.values()))
    parts = tuple(_part(low, high, timed, seat) for low, high in pairwise(edges))
    return Task(motion=motion, parts=parts, stops=_placed(stops, seat))


def _placed(stops: list[Stop], seat: dict[float, float]) -> dict[float, Stop]:
    """Gather stops by the share at which they come to stand; those at one place become one."""
    placed: dict[float, Stop] = {}
    for stop in stops:
        at = seat[stop.share]
        held = placed.get(at)
        placed[at] = stop if held is None else _joined(held, stop)
    return placed


def _seats(wanted: list[float], least: float) -> dict[float, float]:
    """Where each place comes to lie, so that no part is shorter than `least`."""
    seat, last = {0.0: 0.0, 1.0: 1.0}, 0.0
    for share in wanted[1:-1]:
        if 1.0 - share < least:
            seat[share] = 1.0
        else:
            last = share if share - last >= least else last
            seat[share] = last
    return seat


def _part(low: float, high: float, timed: list[Part], seat: dict[float, float]) -> Part:
    """Tell the time of a part from the piece it lies in."""
    for piece in timed:
        first, last = seat[piece.low], seat[piece.high]
        if first <= low and high <= last and piece.duration is not None:
            return Part(low=low, high=high, duration=piece.duration * (high - low) / (last - first))
    return Part(low=low, high=high)


def _joined(a: Stop, b: Stop) -> Stop:
    return Stop(motion=a.motion, share=a.share, pause=max(a.pause, b.pause), shifts=(*a.shifts, *b.shifts))
