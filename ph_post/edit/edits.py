"""The edits of a part program: offset shifts, stops and dips at its motions, and the options.

Two sets of edits are merged here; :mod:`ph_post.edit.motion_edits` puts them in the order in which they are written.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import groupby, pairwise
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.post.options import BLOCK_TIME, CHORD_TOLERANCE
from ph_post.types import Array, IntArray, sealed
from ph_post.units import MM

SYNCHRONISED: Final = 1e-6
"""A rest [s] that is written as a dwell of no length: a controller that follows the path exactly waits for that until
all moves before it are done, and some round every other dwell up to many times what a move of an axis takes."""


LEFT: Final = 0.2
"""Part of the largest offset of its axis that a reversal which counts as compensated leaves at most: rms up to the next
reversal, of which the plain program has about half in a bend."""

LOBE: Final = 8.0 / 15.0
"""Mean square of a parabola between its zeros, as a part of its largest: so a table leaves its path in a crossing."""


def dwell_time(pause: float) -> float:
    """Return the time [s] that is written for a rest of `pause` [s].

    Examples
    --------
    >>> dwell_time(0.02), dwell_time(SYNCHRONISED)
    (0.02, 0.0)
    """
    return pause if pause > SYNCHRONISED else 0.0


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
        """The shifts that are one move each: axes that cross their backlash at one place do so together.

        So do those that are shifted by a part of it between two rests. Behind a rapid each has a move of its own.
        """
        apart = self.approach or any(shift.whole for shift in self.shifts)
        alike = self.crosses or (self.rests and not apart)
        together = alike and len({shift.axis for shift in self.shifts}) == len(self.shifts)
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

    `parts` in the order of travel; `length` of the stretch and largest `error` of the table [m], if its motor is not
    `late`; `behind` a corner in which a stop would do as well.
    """

    axis: str
    sign: int
    parts: tuple[CrossingPart, ...]
    length: float
    error: float
    late: bool = False
    behind: bool = False

    @property
    def square(self) -> float:
        """Square of the error of the table, summed along the path [m³]; 0 of one whose motor is late."""
        return 0.0 if self.late else LOBE * self.error**2 * self.length


def leaves_much(square: float, way: float, amplitude: float) -> bool:
    """Return whether a crossing leaves so much error at a reversal that this does not count as compensated.

    Parameters
    ----------
    square : float
        Of the crossing there, as :attr:`CrossingEdit.square` [m³].
    way : float
        Up to the next reversal [m].
    amplitude : float
        Largest offset of the axis [m]: the error of the plain program.

    Examples
    --------
    >>> made = CrossingEdit(axis="X", sign=1, parts=(), length=1e-3, error=20e-6)
    >>> leaves_much(made.square, 1e-3, 25e-6), leaves_much(made.square, 20e-3, 25e-6)
    (True, False)
    """
    return square > (LEFT * amplitude) ** 2 * way


class DipEdit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A stretch that is cut into blocks of a known time each: the feed in a window.

    `motion` (k + 1,) and `share` (k + 1,) are the ends of the blocks, in the order of travel, places on the
    program's own motions; `duration` (k,) [s]. Where a crossing is in it, a `lasting` one stays beside that.
    """

    motion: IntArray
    share: Array
    duration: Array
    lasting: bool = False


class OffsetRuns(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Offsets at the ends of `count` motions, by runs of motions that have the same: few, where there may be millions.

    `first` (r,) is the first motion of each run, `value` (r, 3) [m] what its motions have.
    """

    first: IntArray
    value: Array
    count: int

    @property
    def lengths(self) -> IntArray:
        """Number of motions of each run, shape (r,)."""
        return np.diff(self.first, append=self.count)

    @property
    def steps(self) -> Array:
        """Change of the offsets at the beginning of each run, shape (r, 3) [m]."""
        return np.diff(self.value, axis=0, prepend=np.zeros((1, 3)))


def runs_of(offset: Array) -> OffsetRuns:
    """Return the runs of offsets (m, 3) [m].

    Examples
    --------
    >>> runs = runs_of(np.array([[0.0, 0.0, 0.0], [1e-5, 0.0, 0.0], [1e-5, 0.0, 0.0]]))
    >>> runs.first.tolist(), runs.lengths.tolist()
    ([0, 1], [1, 2])
    """
    heads = np.zeros(len(offset), dtype=np.bool_)
    heads[:1] = True
    for column in offset.T:  # one by one: there may be a million motions
        heads[1:] |= column[1:] != column[:-1]
    first = np.flatnonzero(heads)
    return OffsetRuns(first=sealed(first), value=sealed(np.ascontiguousarray(offset[first])), count=len(offset))


def no_offsets(count: int) -> OffsetRuns:
    """Return the runs of so many motions without an offset."""
    first = np.zeros(min(count, 1), dtype=np.int64)
    return OffsetRuns(first=sealed(first), value=sealed(np.zeros((first.size, 3))), count=count)


class Edits(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All edits of one program.

    `offset` (m, 3) [m], kept as `runs`, is added to X, Y and Z at the end of every motion, on the grid of the dialect's
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
    would have cost more than is allowed, and `spared` where axes were left alone for that, as in :class:`EditOptions`;
    `warnings` name what is not compensated.
    """

    runs: OffsetRuns
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
    spared: frozenset[tuple[str, int, int]] = frozenset()
    warnings: tuple[str, ...] = ()

    @property
    def offset(self) -> Array:
        """Offset at the end of every motion, shape (m, 3) [m]."""
        return sealed(np.repeat(self.runs.value, self.runs.lengths, axis=0))

    @property
    def empty(self) -> bool:
        """No change at all."""
        return not (self.stops or self.dips or self.crossings or np.any(self.runs.value))


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
        runs=runs_of(a.offset + b.offset) if b.runs.value.any() else a.runs,
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
        spared=a.spared | b.spared,
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
    spared : frozenset of (str, int, int)
        Axes that an earlier plan had no time for, with the first motion of each such part and the one behind its last.
    shave : float
        Time, relative, that is taken off a plan which keeps to the time allowed: parts that gain least for theirs are
        left, and all else stays as it is.
    cycle : float
        Time of the program as its controller runs it [s], 0 where that is not known.
    pace : float
        Time that a plan took on its controller for each second that was reckoned for it; what is said of time is that.
    longer : float
        Time that a crossing near a turning point took on its controller beside what was reckoned for it [s].
    largest_first : bool
        Where the time is short spend it on what gains most, in place of what gains most for its time.
    in_parts : bool
        Where the time is short compensate all axes up to a place in a section, in place of some axes in all of it.
    plain_corners : bool
        No crossing lies behind a corner, however slowly the path leaves it.
    halts : frozenset of int
        Motions at whose ends the path stops, as the controller would round the corner there more than it did.
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
    spared: frozenset[tuple[str, int, int]] = frozenset()
    shave: float = 0.0
    cycle: float = 0.0
    pace: float = 1.0
    longer: float = 0.0
    largest_first: bool = False
    in_parts: bool = False
    plain_corners: bool = False
    halts: frozenset[int] = frozenset()
    standing: frozenset[int] = frozenset()
    position_from: int = 0
    overshoot: float | None = None
    part_side: int = 0
