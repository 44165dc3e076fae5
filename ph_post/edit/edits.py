"""The edits of a part program: offset shifts, stops and dips at its motions, and the options.

Two sets of edits are merged here, and put in the order in which they are written.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby, pairwise

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.gcode.motion_parts import part_length
from ph_post.gcode.program import Motions
from ph_post.post.options import BLOCK_TIME, CHORD_TOLERANCE
from ph_post.types import Array, IntArray, sealed
from ph_post.units import MM


class OffsetShift(msgspec.Struct, frozen=True, kw_only=True):
    """A short move of one axis while the path stands still, by `travel` [m], signed, with F `velocity` [m/s].

    After it the axis rests for `pause` [s]. It is `whole` where it leads from one side of the backlash to the other.
    """

    axis: str
    travel: float
    velocity: float
    pause: float
    whole: bool = False


class StopEdit(msgspec.Struct, frozen=True, kw_only=True):
    """The path stops at the `share` (0 to 1) of a motion, rests for `pause` [s], and axes are shifted.

    Shifts that change :attr:`Edits.offset` stay; those of a backlash take-up move add up to zero. An `approach`
    comes from beyond: the rapid before it ends there; at a `restart` all axes do that need it. It is written `behind`
    that line where it is not None, as a beam is off there, and else behind the motion's own. Its moves are `rapid`
    where a laser would be on in others.
    """

    motion: int
    share: float
    pause: float
    shifts: tuple[OffsetShift, ...]
    approach: bool = False
    restart: bool = False
    rapid: bool = False
    behind: int | None = None

    @property
    def rests(self) -> bool:
        """True where the path rests for a dwell."""
        return self.pause > 0.0 or any(shift.pause > 0.0 for shift in self.shifts)

    @property
    def crosses(self) -> bool:
        """True where nothing but backlash is crossed, without a dwell: a crossing in a corner."""
        return not (self.rests or self.approach) and all(shift.whole for shift in self.shifts)

    @property
    def moves(self) -> list[tuple[OffsetShift, ...]]:
        """The shifts that are one move each: axes that cross their backlash at one place do so together."""
        together = self.crosses and len({shift.axis for shift in self.shifts}) == len(self.shifts)
        return [self.shifts] if together and self.shifts else [(shift,) for shift in self.shifts]

    def crosses_in(self, axis: str) -> bool:
        """Return whether it takes an axis through all of its backlash without a dwell, whatever the others do."""
        return not (self.rests or self.approach) and any(one.axis == axis and one.whole for one in self.shifts)


class CrossingPart(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A part of a crossing, which lies on one `motion`, between two shares of it.

    A `line` is a straight block in place of that part of the path, anything else the part itself. `added` (3,) [m]
    is what the axes have beside the path at its end, `feed` [m/s] the speed along the block, None for the program's.
    """

    motion: int
    low: float
    high: float
    line: bool
    added: Array
    feed: float | None


class CrossingEdit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A crossing of the backlash on the fly: a stretch of path on which an axis gets its other offset.

    `parts` in the order of travel; `length` of the stretch and largest `error` of the table [m]; `behind` a corner.
    """

    axis: str
    sign: int
    parts: tuple[CrossingPart, ...]
    length: float
    error: float
    behind: bool = False


class DipEdit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A stretch that is cut into blocks of a known time each: the feed in a window.

    `motion` (k + 1,) and `share` (k + 1,) are the ends of the blocks, in the order of travel, places on the
    program's own motions; `duration` (k,) [s]. Where a crossing is in it, a `lasting` one stays beside that.
    """

    motion: IntArray
    share: Array
    duration: Array
    lasting: bool = False


class Edits(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All edits of one program.

    `offset` (m, 3) [m] is added to X, Y and Z at the end of every motion, on the grid of the dialect's
    decimals in the program's units. A rapid goes from the offset before it to its own; a cutting motion has
    one offset, unless a stop or a crossing on it changes that: where it ends within a crossing its offset is what is
    added to the path there. At the end of every chain the offset is zero, where need be
    by a stop behind the last motion. `stops`, `dips` and `crossings` are in the order of travel. `amplitude` [m] by
    axis: the offset is plus or minus this, or zero, or of a `one_sided` axis zero or this to its side, +1 or -1;
    `pulse` [m] by axis: the largest backlash take-up move. `followed` are the axes whose reversals were planned: one
    that is exact on the side of its zero may need no offset.
    `joints` are shares at which motions with crossings are divided besides, by motion.
    `kept` [m/s]: speed that is kept in what crossings leave of a motion, where that is less than its feed.
    `rounding` [m]: to which joints of crossings are rounded on motions at whose ends the controller stops, 0 for not.
    `slowdown` is what stops and crossings are reckoned to cost, relative; `short` says that more, or finer crossings,
    would have cost more than is allowed; `warnings` name what is not compensated.
    """

    offset: Array
    stops: tuple[StopEdit, ...] = ()
    dips: tuple[DipEdit, ...] = ()
    crossings: tuple[CrossingEdit, ...] = ()
    amplitude: Mapping[str, float] = {}
    one_sided: Mapping[str, int] = {}
    followed: tuple[str, ...] = ()
    pulse: Mapping[str, float] = {}
    joints: Mapping[int, Sequence[float]] = {}
    kept: Mapping[int, float] = {}
    rounding: float = 0.0
    slowdown: float = 0.0
    short: bool = False
    warnings: tuple[str, ...] = ()

    @property
    def empty(self) -> bool:
        """No change at all."""
        return not (self.stops or self.dips or self.crossings or np.any(self.offset))


def merge_edits(a: Edits, b: Edits) -> Edits:
    """Return the edits of both; stops at the same place become one.

    Raises
    ------
    ValueError
        Where both offset one axis, or dips of both overlap.
    """
    shared = sorted(set(a.amplitude) & set(b.amplitude))
    if shared:
        raise ValueError(f"both sets of edits offset axis {shared[0]}")
    ordered = sorted((*a.stops, *b.stops), key=_stop_place)
    return Edits(
        offset=a.offset if a.offset is b.offset and not a.offset.any() else sealed(a.offset + b.offset),
        stops=tuple(join_stops(list(found)) for _, found in groupby(ordered, _stop_place)),
        dips=_merged_dips((*a.dips, *b.dips)),
        crossings=(*a.crossings, *b.crossings),
        amplitude={**a.amplitude, **b.amplitude},
        one_sided={**a.one_sided, **b.one_sided},
        followed=tuple(dict.fromkeys((*a.followed, *b.followed))),
        pulse={axis: max(a.pulse.get(axis, 0.0), b.pulse.get(axis, 0.0)) for axis in sorted({*a.pulse, *b.pulse})},
        joints={**a.joints, **b.joints},
        kept={**a.kept, **b.kept},
        rounding=max(a.rounding, b.rounding),
        slowdown=a.slowdown + b.slowdown,
        short=a.short or b.short,
        warnings=tuple(dict.fromkeys((*a.warnings, *b.warnings))),
    )


def _stop_place(stop: StopEdit) -> tuple[int, float]:
    return stop.motion, stop.share


def join_stops(stops: Sequence[StopEdit]) -> StopEdit:
    """Make one stop of stops at one place: the longest of their pauses, their shifts one after the other.

    In the air the axes wait for their motors together, when all have been shifted. Elsewhere, where one of them rests
    between its moves, so do the others, and what only crosses its backlash comes last.
    """
    first = stops[0]
    if all(one.approach for one in stops):
        longest = max(one.shifts[-1].pause for one in stops)
        waits = [0.0] * (len(stops) - 1) + [longest]
        stops = [
            replace(one, shifts=(*one.shifts[:-1], replace(one.shifts[-1], pause=rest)))
            for one, rest in zip(stops, waits, strict=True)
        ]
    shifts = tuple(shift for stop in stops for shift in stop.shifts)
    rests = [shift.pause for shift in shifts if shift.pause > 0.0]
    if rests and not any(one.approach for one in stops):
        ordered = sorted(shifts, key=lambda shift: shift.whole)
        shifts = tuple(replace(shift, pause=max(shift.pause, min(rests))) for shift in ordered)
    return StopEdit(
        motion=first.motion,
        share=first.share,
        pause=max(one.pause for one in stops),
        shifts=shifts,
        approach=any(one.approach for one in stops),
        restart=any(one.restart for one in stops),
        rapid=any(one.rapid for one in stops),
        behind=max((one.behind for one in stops if one.behind is not None), default=None),
    )


def _merged_dips(dips: tuple[DipEdit, ...]) -> tuple[DipEdit, ...]:
    ordered = sorted(dips, key=lambda dip: (int(dip.motion[0]), float(dip.share[0])))
    for before, after in pairwise(ordered):
        end, start = ((int(dip.motion[at]), float(dip.share[at])) for dip, at in ((before, -1), (after, 0)))
        if start < end and sum(start) < sum(end):
            raise ValueError(f"two feed dips overlap in motion {start[0]}")
    return tuple(ordered)


TOLERANCE = 5e-3 * MM
"""Default ε of the windows [m]; a move of an axis below it is not worth a stop either."""


class EditOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options of a program's compensation; lengths in m, times in s.

    Parameters
    ----------
    tolerance : float
        ε of the windows; smaller moves of an axis are ignored.
    max_slowdown : float
        Largest growth of the program's time, relative.
    chord_tolerance : float
        Largest rounding of a joint where blocks of known time stand in an exact-stop program.
    block_time : float
        Longest block in ramps and dips.
    left : frozenset of int
        Sections in which no axis gets an offset, see :func:`~ph_post.edit.reversals.section_spans`.
    stretches : tuple of (int, int)
        First motion, and the one behind the last, of parts of sections in which no axis gets an offset either.
    cycle : float
        Time of the program as its controller runs it [s], 0 where that is not known.
    pace : float
        Time that a plan took on its controller for each second that was reckoned for it; what is said of time is that.
    largest_first : bool
        Where the time is short spend it on what gains most, in place of what gains most for its time.
    in_parts : bool
        Where the time is short compensate all axes up to a place in a section, in place of some axes in all of it.
    plain_corners : bool
        No crossing lies behind a corner, however slowly the path leaves it.
    standing : frozenset of int
        Motions beside which axes cross in moves of their own: a crossing on the fly there did not pass the check.
    position_from : {0, 1, -1}
        Side from which axes come to places to which a rapid brings them, and at which they rest while the tool cuts;
        0 for either.
    overshoot : float, optional
        From how far beyond its place an axis comes in the air; by default twice its lost motion.
    part_side : {0, 1, -1}
        1 where the part is on the left of the path, -1 where on its right: crossings of steppers leave it proud there;
        0 where that is not known.
    """

    tolerance: float = TOLERANCE
    max_slowdown: float = 0.1
    chord_tolerance: float = CHORD_TOLERANCE
    block_time: float = BLOCK_TIME
    left: frozenset[int] = frozenset()
    stretches: tuple[tuple[int, int], ...] = ()
    cycle: float = 0.0
    pace: float = 1.0
    largest_first: bool = False
    in_parts: bool = False
    plain_corners: bool = False
    standing: frozenset[int] = frozenset()
    position_from: int = 0
    overshoot: float | None = None
    part_side: int = 0


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
