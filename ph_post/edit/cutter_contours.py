"""Contours that are cut with cutter compensation (G41, G42): where an offset may change on them, for which radii.

The control moves the tool's centre beside the contour, by a radius that the program does not say. Straight lines of
both are parallel, and its arcs about outer corners turn by the angle between two lines: while the contour is shifted
as a whole so is the tool's path, and each axis moves in it in the directions of the contour. An offset may therefore
change where an axis rests along a straight line in the midst of the contour, whatever the radius: the line becomes
one that is slanted by a part of it, within which the table waits. On an arc, beside which the tool turns at the same
angle, it may change on a chord over the place at which the axis turns, where :mod:`ph_post.edit.cutter_offsets` finds
the table near the tool's path for every radius that the contour may have. Elsewhere no block may be added. How the
tool comes to the contour and leaves it depends on the radius: the directions of its first and last move hold up to one.

On a lathe (G18) the path is that of the tip of a tool whose nose is round: beside the centre's, by a radius or none in
each axis, as the control's table has it. Between two blocks that is the same, but with the first and the last one it
moves an axis by up to a radius to either side. Behind the first, often a rapid, an axis is on its side again where the
contour moves it further than that and its backlash.
"""

from __future__ import annotations

import math
from bisect import bisect_left, bisect_right
from collections.abc import Collection, Mapping, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.dialects.declaration import CORRECTED
from ph_post.edit.crossings import ERROR, FINE, PART
from ph_post.edit.cutter_offsets import crossing_fits, safe_chord
from ph_post.edit.edits import CrossingEdit, StopEdit
from ph_post.edit.reversals import CARRIED, CHAIN, FIRST, LAST, MOTION, SHARE, SHARE0, SHARE1, SIGN
from ph_post.gcode.program import ARC, AXES, LINE, PLANE_AXES, RAPID, Motions, PartProgram
from ph_post.types import Array
from ph_post.units import MM

SLANTED: Final = 2.0 * MM
"""Length of the slanted part of a line, or a quarter of the line where that is less [m]."""

QUARTER: Final = 0.25

LEAST_PART: Final = 0.5
"""A radius is to be possible up to this part of the length of the moves onto the contour and off it, and of what
leaves anything of a line between two inner corners."""

_LETTERS: Final = frozenset(map(ord, "NGXYZIJKRFDH"))
"""Letters of words that may stand in such a contour."""

_CODES: Final = (0.0, 1.0, 2.0, 3.0, 17.0, 18.0, 20.0, 21.0, 40.0, 41.0, 41.1, 42.0, 42.1, 70.0, 71.0, 90.0, 94.0)
"""G words that may stand in it."""

_NOTHING: Final = 1e-9
"""Ways [m] that are none."""

STEEP: Final = 20.0 * MM
"""A slanted part is to be no steeper than for half of this radius [m]."""

NOSE: Final = 1.6 * MM
"""Radius of a large nose of a lathe's tool."""

_UPRIGHT: Final = ("heidenhain", "siemens")
"""Languages whose controls bring the tool upright onto the contour's first block (iTNC 530, Conversational, 5.3; NORM
of SINUMERIK); others take the first move's own normal, or go by both."""

LEFT: Final = "cutter compensation, left as it is"
"""What the warning of a contour that cannot be shifted says."""

_TURNED: Final = PLANE_AXES[18][:2]

ENTRY: Final = 2.0
"""No cutter's radius is more than so many times the length of the move onto its contour, which is to be longer."""

_TURNS: Final = "an axis turns in it where it rests along no straight line, and on no arc that suits all cutters"


def _side(word: str | None) -> int:
    """Return 1 for a cutter on the left of its contour, -1 for one on the right, 0 for none."""
    return 0 if word is None else 1 if word.startswith("G41") else -1 if word.startswith("G42") else 0


def tangent_of(motions: Motions, k: int, *, last: bool = False, columns: Sequence[int] = (0, 1)) -> Array:
    """Return the direction of a line or an arc at its start, or at its end, in the axes of a plane."""
    own = list(columns)
    if motions.kind[k] == ARC:
        beside = (motions.end if last else motions.start)[k, own] - motions.center[k]
        way = math.copysign(1.0, motions.angle[k]) * np.array([-beside[1], beside[0]])
    else:
        way = motions.end[k, own] - motions.start[k, own]
    return np.asarray(way / max(float(np.linalg.norm(way)), _NOTHING))


def path_turn(motions: Motions, before: int, behind: int, columns: Sequence[int] = (0, 1)) -> float:
    """Return the angle [rad] by which the path turns to the left between two motions."""
    one, other = tangent_of(motions, before, last=True, columns=columns), tangent_of(motions, behind, columns=columns)
    return math.atan2(one[0] * other[1] - one[1] * other[0], float(one @ other))


def _sign_at(rows: Array, motion: int) -> int:
    """Return the direction for which an axis is shifted where a motion begins, 0 for none."""
    before = rows[rows[:, MOTION] + rows[:, SHARE] <= motion]
    return int(before[-1, SIGN]) if len(before) else 0


def _put(row: Array, place: float) -> None:
    """Let a change happen at the end of a motion, the number of the one behind it, and nowhere else."""
    row[[FIRST, MOTION, LAST]] = place - 1.0
    row[[SHARE0, SHARE, SHARE1]] = 1.0


def _ends_of(crossing: CrossingEdit) -> tuple[float, float]:
    """Return where a crossing begins and ends, as the number of a motion and a share of it."""
    return crossing.parts[0].motion + crossing.parts[0].low, crossing.parts[-1].motion + crossing.parts[-1].high


def _middle(low: float, high: float) -> float:
    """Return a place between two, on one motion of both where they share one."""
    return 0.5 * (low + high) if math.floor(low) == math.ceil(high) - 1 else float(math.floor(low) + 1)


def _allowed(gap: float) -> float:
    """Error that a crossing on an arc has at most [m], for a backlash."""
    return max(FINE * ERROR, PART * gap)


class CutterContour(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch of motions with cutter compensation: from `first`, onto the contour, to `last`; `side` +1 is left.

    `why` it is left as it is, empty where it need not be; `columns` are the axes of its plane.
    """

    first: int
    last: int
    side: int
    why: str
    columns: tuple[int, int] = (0, 1)

    @property
    def turned(self) -> bool:
        """Whether it is one of a lathe's tool."""
        return self.columns == _TURNED


class CutterContours:
    """The contours of a program that are cut with cutter compensation.

    Attributes
    ----------
    contours : tuple of CutterContour
    number : IntArray, shape (m,)
        Which of them each motion belongs to; −1 where none.
    """

    def __init__(self, program: PartProgram) -> None:
        self._program = program
        motions = program.motions
        sides = np.array([_side(modal.compensation) for modal in program.modal], dtype=np.int8)
        side = sides[program.state[motions.block]]
        ends = np.flatnonzero(np.diff(side, prepend=np.int8(0), append=np.int8(0)) != 0)
        self.contours = tuple(
            CutterContour(
                first=low,
                last=high - 1,
                side=int(side[low]),
                why=self._why(low, high - 1),
                columns=_TURNED if motions.plane[low] == 18 else (0, 1),
            )
            for low, high in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)
            if side[low] != 0
        )
        self._chords: dict[tuple[float, bool, float, float], float] = {}
        # Of a program without contours they take the memory of one number.
        nothing = np.broadcast_to(np.int32(-1), motions.kind.shape)
        self.number = nothing.copy() if self.contours else nothing
        for n, one in enumerate(self.contours):
            self.number[one.first : one.last + 1] = n

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self.contours)

    def _why(self, first: int, last: int) -> str:  # noqa: PLR0911
        """Return why a stretch cannot be shifted, empty where it can."""
        motions, program = self._program.motions, self._program
        if first == 0 or last in (first, motions.kind.size - 1):
            return "it does not begin and end in the program"
        if np.ptp(motions.chain[first - 1 : last + 2]):
            return "not all of it is understood"
        planes = {program.modal_after(int(block)).plane for block in motions.block[first : last + 2]}
        onto = (LINE, RAPID) if planes == {18} else (LINE,)
        own = motions.kind[first : last + 1]
        if motions.kind[first] not in onto or not np.isin(own, (*onto, ARC)).all():
            return "it has moves that are neither lines nor arcs"
        if motions.exact[first : last + 2].any():
            return "the path is exact there (G61, G9)"
        ended = _side(program.modal_after(int(motions.block[last + 1])).compensation) == 0
        if motions.kind[last + 1] not in (LINE, RAPID) or not ended:
            return "how it ends is not understood"
        if planes not in ({17}, {18}):
            return "it is neither in G17 nor in G18"
        own_axes = list(_TURNED if planes == {18} else (0, 1))
        places = np.stack([motions.start[first : last + 2, own_axes], motions.end[first : last + 2, own_axes]])
        if np.isnan(places).any() or (places[0] == places[1]).all(axis=1)[[0, -1]].any():
            return "where it begins and ends is not known"
        rows = program.words.rows(self._line_of(first), int(motions.block[last + 1]) + 1)
        letter, value = program.words.letter[rows], program.words.value[rows]
        known = np.isin(letter, list(_LETTERS)) & ~((letter == ord("G")) & ~np.isin(value, _CODES))
        return "" if known.all() else "it holds other words than of its moves"

    def straight_rest(self, row: Array, column: int, rest: Array, along: Array) -> int | None:
        """Return the longest line in the midst of a contour along which an axis rests, None where there is none."""
        own = self.number[int(row[MOTION])]
        found = self.contours[own]
        if own < 0 or column not in found.columns or (int(row[MOTION]) == found.first and row[SHARE] < 1.0):
            return None
        motions, best, longest, other = self._program.motions, None, 0.0, sum(found.columns) - column
        for k in range(found.first + 1, found.last + 1):
            way = np.abs(motions.end[k] - motions.start[k])
            still = way[column] <= _NOTHING and way[other] > _NOTHING and motions.kind[k] == LINE
            within = along[k] >= rest[0] - _NOTHING and along[k + 1] <= rest[1] + _NOTHING
            if still and within and along[k + 1] - along[k] > longest:
                best, longest = k, float(along[k + 1] - along[k])
        return best

    def beside_contours(self, rows: Array, column: int, gap: float) -> Array:
        """Return an axis' changes, without those in the corners where the tool comes onto a contour and leaves it.

        Whether the axis turns there depends on the radius. It has its offset already on the move onto an arc that leads
        to the contour, and keeps it on the move off it: neither cuts anything of the contour. On the way the table
        waits where it is, or comes behind. A change of an axis beside a contour's plane that lies in its midst is made
        ahead of it, or behind.

        Parameters
        ----------
        rows : Array, shape (n, 11)
            Changes.
        column : int
            Their axis.
        gap : float
            Its backlash [m].
        """
        place, found, keep = rows[:, MOTION] + rows[:, SHARE], rows.copy(), np.ones(len(rows), dtype=np.bool_)
        begins, ends = (rows[:, at] + rows[:, share] for at, share in ((FIRST, SHARE0), (LAST, SHARE1)))
        for n in range(1, len(rows)):
            one = self._contour_at(float(place[n]))
            if one is None or rows[n, CHAIN] != rows[n - 1, CHAIN] or rows[n, SIGN] == 0.0 or not keep[n]:
                continue
            last = n + 1 == len(rows) or rows[n + 1, CHAIN] != rows[n, CHAIN]
            if column not in one.columns:
                if begins[n] <= one.first < place[n]:
                    _put(found[n], one.first)
                elif ends[n] >= one.last + 2.0:
                    _put(found[n], one.last + 2.0)
            elif place[n] == begins[n] == one.last + 1.0:
                if not last and place[n + 1] <= one.last + 2.0:
                    keep[n : n + 2] = False, rows[n + 1, SIGN] != rows[n - 1, SIGN]
                    continue
                _put(found[n], one.last + 2.0)
            elif (
                place[n] == begins[n] == one.first + 1.0 and place[n - 1] < one.first and self._leads(one, column, gap)
            ):
                _put(found[n], one.first)
        return found[keep]

    def _contour_at(self, place: float) -> CutterContour | None:
        """Return the contour of a place, the number of a motion and a share of it, that may be shifted."""
        motion = math.ceil(place) - 1
        one = self.contours[self.number[motion]] if motion >= 0 and self.number[motion] >= 0 else None
        return None if one is None or one.turned or one.why else one

    def _leads(self, one: CutterContour, column: int, gap: float) -> bool:
        """Return whether an arc leads to a contour along an axis: a table that lags stays on the path.

        The tool may go round it on nearly nothing, so that the axis comes behind by all of its backlash.
        """
        motions, k = self._program.motions, one.first + 1
        inner = motions.kind[k] == ARC and one.side * motions.angle[k] > 0.0
        across = abs(float(tangent_of(motions, k, last=True)[1 - column]))
        return bool(inner and k < one.last and across * gap <= _allowed(gap))

    def _largest_radius(self, one: CutterContour) -> float:
        """Return the largest radius that a contour's cutter may have [m]: it fits into all of its arcs."""
        motions, own = self._program.motions, np.arange(one.first + 1, one.last + 1)
        arcs = own[(motions.kind[own] == ARC) & (one.side * motions.angle[own] > 0.0)]
        radii = np.linalg.norm(motions.start[arcs, :2] - motions.center[arcs], axis=1)
        entry = ENTRY * float(np.linalg.norm((motions.end - motions.start)[one.first, :2]))
        return float(min(STEEP, entry, radii.min(initial=math.inf)))

    def chord(self, row: Array, gap: float) -> float:
        """Return how long a chord on a contour's arc is on which all cutters cross at a change [m], 0 for none.

        Parameters
        ----------
        row : Array
            Of a change.
        gap : float
            Backlash of its axis [m].
        """
        motions, k = self._program.motions, int(row[MOTION])
        at = [k, k + 1] if row[SHARE] == 1.0 else [k]
        one = self.contours[self.number[k]]
        if not self._on_arcs(one, at):
            return 0.0
        radii = np.linalg.norm(motions.start[at, :2] - motions.center[at], axis=1)
        least, inner = float(radii.min()), bool(one.side * motions.angle[at[int(radii.argmin())]] > 0.0)
        # The radii of arcs that are the same differ by their rounding.
        key = (round(least / MM, 2) * MM, inner, gap, round(self._largest_radius(one) / MM, 2) * MM)
        if key not in self._chords:
            self._chords[key] = safe_chord(*key, _allowed(gap)) if key[0] > 0.0 else 0.0
        return self._chords[key]

    def _on_arcs(self, one: CutterContour, own: Sequence[int]) -> bool:
        """Return whether motions are arcs in the midst of a contour."""
        inside = min(own) > one.first and max(own) <= one.last and not one.turned
        return bool(inside and (self._program.motions.kind[list(own)] == ARC).all())

    def _suits_all(
        self, crossing: CrossingEdit, places: Sequence[float], sides: Mapping[str, tuple[float, float]]
    ) -> bool:
        """Return whether a crossing on a contour's arcs leaves the table near the path of every cutter.

        `places` are where crossings begin and end, as the number of a motion and a share of it.
        """
        parts, column = crossing.parts, AXES.index(crossing.axis)
        one = self.contours[self.number[parts[0].motion]]
        if not self._on_arcs(one, [part.motion for part in parts]):
            return False
        begin, end = _ends_of(crossing)
        low, high = bisect_left(places, begin) - 1, bisect_right(places, end)
        # What lies between two crossings is one half each.
        lowest = _middle(places[low], begin) if low >= 0 else -math.inf
        highest = _middle(end, places[high]) if high < len(places) else math.inf
        around = (
            max(lowest, parts[0].motion - 1.0, one.first + 1.0),
            min(highest, parts[-1].motion + 2.0, one.last + 1.0),
        )
        minus, plus = sides[crossing.axis]
        before = parts[-1].added[:2].copy()
        before[column] = minus if crossing.sign > 0 else plus
        largest = self._largest_radius(one)
        error = crossing_fits(self._program.motions, crossing, around, before, one.side, column, largest)
        return bool(error <= _allowed(plus - minus))

    def _within(self, motion: int, share: float) -> bool:
        """Return whether a place is where no block may be added: from where the tool comes on to where it has left."""
        at = self.number[motion]
        if at >= 0:
            alone = int(self._program.motions.block[motion]) != self._line_of(self.contours[at].first)
            return not (motion == self.contours[at].first and share == 0.0 and not alone)
        behind_last = motion > 0 and self.number[motion - 1] >= 0
        return bool(behind_last and share < 1.0)

    def _line_of(self, first: int) -> int:
        """Return the line of the G41 or G42 of a contour's first motion, or of the first of several."""
        begin = int(self._program.motions.block[first])
        while begin > 0 and _side(self._program.modal_after(begin - 1).compensation) != 0:
            begin -= 1
        return begin

    def left(self) -> dict[int, str]:
        """Return why contours are left as they are, whatever the plan, by number."""
        return {n: one.why for n, one in enumerate(self.contours) if one.why}

    def refused(
        self,
        changes: Mapping[str, Array],
        stops: Collection[StopEdit],
        crossings: Collection[CrossingEdit],
        sides: Mapping[str, tuple[float, float]],
    ) -> tuple[dict[int, str], dict[int, float]]:
        """Judge a plan: why contours cannot have it, and up to which radius [m] the others can, by number."""
        why, said = self.left(), changes
        changes = {
            name: self.beside_contours(rows, AXES.index(name), float(np.ptp(sides[name])))
            for name, rows in said.items()
        }
        for stop in stops:
            if self._within(stop.motion, stop.share):
                why.setdefault(self._near(stop.motion), _TURNS)
        on_arcs = self._judged(crossings, sides, why)
        for name, rows in changes.items():
            carried = rows[rows[:, CARRIED] == 1.0]
            for motion, sign in carried[:, [MOTION, SIGN]].astype(np.int64).tolist():
                if self._carries(motion, AXES.index(name), sign):
                    why.setdefault(int(self.number[motion]), _TURNS)
        radii: dict[int, float] = {}
        for n, one in enumerate(self.contours):
            if n in why:
                continue
            ways = self._turned_ways(one, changes, sides) if one.turned else self._ways(one, changes, said)
            bounds = [*ways, *self._rooms(one, crossings, sides)]
            bounds += [(on_arcs[n], on_arcs[n])] if n in on_arcs else []
            radius = min((bound for bound, _ in bounds), default=math.inf)
            if any(bound < LEAST_PART * natural for bound, natural in bounds):
                why[n] = f"its directions would hold for cutters of a radius up to {max(0.0, radius) / MM:.3g} mm alone"
            else:
                radii[n] = radius
        return why, radii

    def _judged(
        self, crossings: Collection[CrossingEdit], sides: Mapping[str, tuple[float, float]], why: dict[int, str]
    ) -> dict[int, float]:
        """Return the radii [m] of contours that are crossed on arcs; add to `why` which others cannot be, by number."""
        places = sorted(place for crossing in crossings for place in _ends_of(crossing))
        found: dict[int, float] = {}
        for crossing in crossings:
            within = [part.motion for part in crossing.parts if self._within(part.motion, part.low)]
            if all(self._still(motion, crossing) for motion in within):
                continue
            own = int(self.number[within[0]])
            if own >= 0 and self._suits_all(crossing, places, sides):
                found[own] = self._largest_radius(self.contours[own])
                continue
            for motion in within:
                why.setdefault(self._near(motion), _TURNS)
        return found

    def _carries(self, motion: int, column: int, sign: int) -> bool:
        """Return whether a rapid changes an offset where a contour is cut behind it.

        The one that comes onto it may, and the last ones may take the offset of the axis that they move alone back.
        """
        own, motions = int(self.number[motion]), self._program.motions
        if own < 0 or motion == self.contours[own].first:
            return False
        moved = np.flatnonzero(np.abs(motions.end[motion] - motions.start[motion]) > _NOTHING).tolist()
        cuts = bool((motions.kind[motion : self.contours[own].last + 1] != RAPID).any())
        return sign != 0 or cuts or moved != [column]

    def _near(self, motion: int) -> int:
        return int(max(self.number[motion], self.number[max(motion - 1, 0)]))

    def _still(self, motion: int, crossing: CrossingEdit) -> bool:
        """Return whether a part of a crossing lies on a line in the midst of a contour on which its axis rests."""
        motions, column, own = self._program.motions, AXES.index(crossing.axis), self.number[motion]
        inside = own >= 0 and motion > self.contours[own].first
        return bool(
            inside
            and motions.kind[motion] == LINE
            and motions.start[motion, column] == motions.end[motion, column]
            and len(crossing.parts) == 1
        )

    def _ways(
        self, one: CutterContour, changes: Mapping[str, Array], said: Mapping[str, Array]
    ) -> list[tuple[float, float]]:
        """Radii [m] up to which axes move on the way onto a contour and off it as said, and the lengths of the ways.

        On both an axis may turn that has another offset, as `changes` have it and what was `said` does not.
        """
        motions = self._program.motions
        tangents = [tangent_of(motions, k) for k in (one.first, one.first + 1)] + [
            tangent_of(motions, one.last, last=True)
        ]
        left = [one.side * np.array([-tangent[1], tangent[0]]) for tangent in tangents]
        found = []
        onto = left[1:2] if self._program.language.name.startswith(_UPRIGHT) else left[:2]
        for column, name in enumerate(AXES[:2]):
            for motion, normals in ((one.first, onto), (one.last + 1, [-left[2]])):
                sign = _sign_at(changes[name], motion) if name in changes else 0
                if name in said and sign != _sign_at(said[name], motion):
                    continue
                way = motions.end[motion, :2] - motions.start[motion, :2]
                across = min(float(normal[column]) * sign for normal in normals)
                if across < -_NOTHING:
                    found.append((float(way[column]) * sign / -across, float(np.linalg.norm(way))))
        return found

    def _turned_ways(
        self, one: CutterContour, changes: Mapping[str, Array], sides: Mapping[str, tuple[float, float]]
    ) -> list[tuple[float, float]]:
        """Return the same for the tool of a lathe, whose tip may be off its centre by a radius in each axis."""
        motions, found = self._program.motions, []
        for column in one.columns:
            name = AXES[column]
            for motion in (one.first, one.last + 1):
                sign = _sign_at(changes[name], motion) if name in changes else 0
                way = float(motions.end[motion, column] - motions.start[motion, column])
                # An axis that has no side yet is taken to one by the move onto the contour.
                sign = int(np.sign(way)) if sign == 0 and motion == one.first else sign
                way *= sign
                if sign == 0 or (motion > one.last and self._goes_on(motion, column)):
                    continue
                # Either the move itself has the direction that is said, or what follows it in that direction is long.
                run = self._run(one, column, sign) if motion == one.first else 0.0
                gap = float(np.ptp(sides[name]))
                found.append((max(0.5 * way, 0.5 * (run - gap)), NOSE))
        return found

    def _run(self, one: CutterContour, column: int, sign: int) -> float:
        """How far a contour moves an axis in a direction [m] before it moves it in the other."""
        ways = sign * (self._program.motions.end - self._program.motions.start)[one.first + 1 : one.last + 1, column]
        back = np.flatnonzero(ways < -_NOTHING)
        return float(ways[: back[0] if back.size else None].sum())

    def _goes_on(self, motion: int, column: int) -> bool:
        """Return whether nothing is cut behind the move off a contour before its axis has moved again in a rapid."""
        motions = self._program.motions
        behind = np.arange(motion, motions.kind.size)
        behind = behind[motions.chain[behind] == motions.chain[motion]]
        cuts, moves = motions.kind[behind] != RAPID, motions.start[behind, column] != motions.end[behind, column]
        first = int(np.argmax(cuts)) if cuts.any() else behind.size
        return not cuts.any() or bool(moves[1:first].any())

    def _rooms(
        self, one: CutterContour, crossings: Collection[CrossingEdit], sides: Mapping[str, tuple[float, float]]
    ) -> list[tuple[float, float]]:
        """Radii [m] up to which crossings have room on lines between inner corners, and up to which the lines have."""
        motions, found = self._program.motions, []
        for crossing in crossings:
            k = crossing.parts[0].motion
            if not one.first < k <= one.last or motions.kind[k] == ARC:
                continue
            own = list(one.columns)
            length = float(np.linalg.norm(motions.end[k, own] - motions.start[k, own]))
            slant = math.tan(0.5 * float(np.ptp(sides[crossing.axis])) / crossing.length)
            corners = [(before, before + 1) for before in (k - 1, k) if one.first < before + 1 <= one.last]
            turns = [one.side * path_turn(motions, *pair, one.columns) for pair in corners]
            inner = [math.tan(0.5 * turn) for turn in turns if turn > _NOTHING]
            steep = NOSE if one.turned else STEEP
            natural = min(length / sum(inner), steep) if inner else steep
            found.append((crossing.length / slant, natural))
            if inner:
                found.append((0.5 * (length - crossing.length) / (max(inner) + slant), natural))
        return found

    def spans(self, numbers: Collection[int]) -> list[tuple[int, int]]:
        """Return the first motion of contours, and the one behind the move that leaves them."""
        return [(self.contours[n].first, self.contours[n].last + 2) for n in sorted(numbers)]

    def lines(self) -> list[str]:
        """Return the lines of each contour in words."""
        block = self._program.motions.block
        return [self._program.line_words(int(block[one.first]), int(block[one.last])) for one in self.contours]

    def words(self, why: Mapping[int, str], radii: Mapping[int, float], offset: Array) -> list[str]:
        """Return warnings of contours that are left, and what holds for those with an offset (m, 3)."""
        own = {n: (self.contours[n].first, self.contours[n].last + 1) for n in radii}
        radii = {
            n: radius for n, radius in radii.items() if offset[slice(*own[n]), list(self.contours[n].columns)].any()
        }
        lines = self.lines()
        found = [f"{lines[n]}: {LEFT}: {why[n]}" for n in sorted(why)]
        if not radii:
            return found
        radius = min(radii.values())
        which = f"radii up to {math.floor(100.0 * radius / MM) / 100.0:g} mm" if math.isfinite(radius) else "all radii"
        more = f" and {len(radii) - 1} more contours" if len(radii) > 1 else ""
        return [*found, f"{CORRECTED} {which}, in {lines[min(radii)]}{more}"]
