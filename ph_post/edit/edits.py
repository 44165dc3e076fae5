"""The edits of a part program: offset shifts, stops and dips at its motions, and the options.

Two sets of edits are merged here, and put in the order in which they are written.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import groupby, pairwise

import msgspec

from ph_post.errors import InputError
from ph_post.gcode.motion_parts import part_length
from ph_post.gcode.program import Motions
from ph_post.post.options import BLOCK_TIME, CHORD_TOLERANCE
from ph_post.types import Array, IntArray, sealed
from ph_post.units import MM


class OffsetShift(msgspec.Struct, frozen=True, kw_only=True):
    """A short move of one axis while the path stands still, by `travel` [m], signed, with F `velocity` [m/s].

    After it the axis rests for `pause` [s].
    """

    axis: str
    travel: float
    velocity: float
    pause: float


class StopEdit(msgspec.Struct, frozen=True, kw_only=True):
    """The path stands still at the `share` (0 to 1) of a motion, rests for `pause` [s], and axes are shifted.

    Lasting shifts are those that :attr:`Edits.offset` has too; of others (out and back) the sum is zero.
    """

    motion: int
    share: float
    pause: float
    shifts: tuple[OffsetShift, ...]


class DipEdit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A stretch that is cut into blocks of a known time each: the feed in a window.

    `motion` (k + 1,) and `share` (k + 1,) are the ends of the blocks, in the order of travel, places on the
    program's own motions; `duration` (k,) [s].
    """

    motion: IntArray
    share: Array
    duration: Array


class Edits(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All changes to one program.

    `offset` (m, 3) [m]: what X, Y and Z carry at the end of every motion, on the grid of the dialect's
    decimals in the program's units. A rapid goes from the offset before it to its own; a cutting motion
    carries one offset, unless a stop on it changes that. At the end of every chain it is zero, where need be
    by a stop behind the last motion. `stops` and `dips` in order of travel. `amplitude` [m] by axis: the
    lasting offset, which is + or - this or zero; `pulse` [m] by axis: the largest shift out and back.
    `warnings` name what was left alone.
    """

    offset: Array
    stops: tuple[StopEdit, ...] = ()
    dips: tuple[DipEdit, ...] = ()
    amplitude: Mapping[str, float] = {}
    pulse: Mapping[str, float] = {}
    warnings: tuple[str, ...] = ()


def merge_edits(a: Edits, b: Edits) -> Edits:
    """Return the changes of both; stops at the same place become one.

    Raises
    ------
    InputError
        Where both shift one axis for good, or both tell the feed of one stretch.
    """
    shared = sorted(set(a.amplitude) & set(b.amplitude))
    if shared:
        raise InputError("merge", f"both shift axis {shared[0]}", expected="axes apart", got=shared[0])
    return Edits(
        offset=a.offset if a.offset is b.offset and not a.offset.any() else sealed(a.offset + b.offset),
        stops=_merged_stops((*a.stops, *b.stops)),
        dips=_merged_dips((*a.dips, *b.dips)),
        amplitude={**a.amplitude, **b.amplitude},
        pulse={axis: max(a.pulse.get(axis, 0.0), b.pulse.get(axis, 0.0)) for axis in sorted({*a.pulse, *b.pulse})},
        warnings=tuple(dict.fromkeys((*a.warnings, *b.warnings))),
    )


def _stop_place(stop: StopEdit) -> tuple[int, float]:
    return stop.motion, stop.share


def _merged_stops(stops: tuple[StopEdit, ...]) -> tuple[StopEdit, ...]:
    """Order stops by place; the shifts of those at one place follow one another."""
    joined = []
    for (motion, share), group in groupby(sorted(stops, key=_stop_place), key=_stop_place):
        found = list(group)
        joined.append(
            StopEdit(
                motion=motion,
                share=share,
                pause=max(one.pause for one in found),
                shifts=tuple(shift for one in found for shift in one.shifts),
            )
        )
    return tuple(joined)


def _merged_dips(dips: tuple[DipEdit, ...]) -> tuple[DipEdit, ...]:
    ordered = sorted(dips, key=lambda dip: (int(dip.motion[0]), float(dip.share[0])))
    ends = [(int(dip.motion[-1]), float(dip.share[-1])) for dip in ordered]
    starts = [(int(dip.motion[0]), float(dip.share[0])) for dip in ordered]
    for end, start in zip(ends[:-1], starts[1:], strict=True):
        if start < end and sum(start) < sum(end):
            raise InputError("merge", f"two feeds for one stretch of motion {start[0]}", expected="one")
    return tuple(ordered)


TOLERANCE = 5e-3 * MM
"""Default ε of the windows [m]; an excursion of an axis below it is not worth a stop either."""


class EditOptions(msgspec.Struct, frozen=True, kw_only=True):
    """How a program is compensated; lengths in m, times in s.

    Parameters
    ----------
    tolerance : float
        ε of the windows, and the least excursion of an axis that is followed with a lasting offset.
    max_slowdown : float
        How much the program's time may grow, relative.
    chord_tolerance : float
        How far a joint may be rounded where blocks of known time stand in an exact-stop program.
    block_time : float
        Longest block in ramps and dips.
    """

    tolerance: float = TOLERANCE
    max_slowdown: float = 0.1
    chord_tolerance: float = CHORD_TOLERANCE
    block_time: float = BLOCK_TIME


_LEAST_STEPS = 4
"""A part is at least so many steps of the last decimal long: rounding could turn a shorter arc about."""


class MotionPart(msgspec.Struct, frozen=True, kw_only=True):
    """A part of a motion between two shares; `duration` [s] is None where the feed is the program's."""

    low: float
    high: float
    duration: float | None = None


_WHOLE = MotionPart(low=0.0, high=1.0)


class MotionEdit(msgspec.Struct, frozen=True, kw_only=True):
    """What is done at one motion: `parts` in order, and `stops` by the share at which they stand."""

    motion: int
    parts: tuple[MotionPart, ...]
    stops: dict[float, StopEdit]

    @property
    def whole(self) -> bool:
        """Whether the motion itself stays as it is."""
        return len(self.parts) == 1 and self.parts[0].duration is None


def schedule(edits: Edits, motions: Motions, step: float) -> list[MotionEdit]:
    """Gather the changes by motion; `step` [m] is one of the last decimal."""
    timed: dict[int, list[MotionPart]] = {}
    for dip in edits.dips:
        for motion, part in _pieces(dip, motions):
            timed.setdefault(motion, []).append(part)
    stops: dict[int, list[StopEdit]] = {}
    for stop in edits.stops:
        stops.setdefault(stop.motion, []).append(stop)
    return [
        _motion_edit(motion, timed.get(motion, []), stops.get(motion, []), motions, step)
        for motion in sorted({*timed, *stops})
    ]


def stops_written(tasks: Iterable[MotionEdit], motions: Motions) -> tuple[int, list[StopEdit]]:
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


def _motion_edit(
    motion: int, timed: list[MotionPart], stops: list[StopEdit], motions: Motions, step: float
) -> MotionEdit:
    if not timed and all(stop.share in (0.0, 1.0) for stop in stops):
        return MotionEdit(motion=motion, parts=(_WHOLE,), stops=_placed(stops, {0.0: 0.0, 1.0: 1.0}))
    wanted = sorted({0.0, 1.0, *(stop.share for stop in stops), *(e for p in timed for e in (p.low, p.high))})
    length = part_length(motions, motion, 0.0, 1.0)
    least = _LEAST_STEPS * step / length if length > 0.0 else 2.0
    seat = _snap_shares(wanted, least)
    edges = sorted(set(seat.values()))
    parts = tuple(_timed_part(low, high, timed, seat) for low, high in pairwise(edges))
    return MotionEdit(motion=motion, parts=parts, stops=_placed(stops, seat))


def _placed(stops: list[StopEdit], seat: dict[float, float]) -> dict[float, StopEdit]:
    """Gather stops by the share at which they come to stand; those at one place become one."""
    placed: dict[float, StopEdit] = {}
    for stop in stops:
        at = seat[stop.share]
        held = placed.get(at)
        placed[at] = stop if held is None else _join_two(held, stop)
    return placed


def _snap_shares(wanted: list[float], least: float) -> dict[float, float]:
    """Where each place comes to lie, so that no part is shorter than `least`."""
    seat, last = {0.0: 0.0, 1.0: 1.0}, 0.0
    for share in wanted[1:-1]:
        if 1.0 - share < least:
            seat[share] = 1.0
        else:
            last = share if share - last >= least else last
            seat[share] = last
    return seat


def _timed_part(low: float, high: float, timed: list[MotionPart], seat: dict[float, float]) -> MotionPart:
    """Tell the time of a part from the piece it lies in."""
    for piece in timed:
        first, last = seat[piece.low], seat[piece.high]
        if first <= low and high <= last and piece.duration is not None:
            return MotionPart(low=low, high=high, duration=piece.duration * (high - low) / (last - first))
    return MotionPart(low=low, high=high)


def _join_two(a: StopEdit, b: StopEdit) -> StopEdit:
    return StopEdit(motion=a.motion, share=a.share, pause=max(a.pause, b.pause), shifts=(*a.shifts, *b.shifts))
