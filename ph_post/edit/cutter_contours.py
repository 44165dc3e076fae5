"""Contours that are cut with cutter compensation (G41, G42): where an offset may change on them, for which radii.

The control moves the tool's centre beside the contour, by a radius that the program does not say. Straight lines of
both are parallel, and its arcs about outer corners turn by the angle between two lines: while the contour is shifted
as a whole so is the tool's path, and each axis moves in it in the directions of the contour. An offset may therefore
change where an axis rests along a straight line in the midst of the contour, whatever the radius: the line becomes
one that is slanted by a part of it, within which the table waits. Elsewhere no block may be added. How the tool
comes to the contour and leaves it depends on the radius: the directions of its first and last move hold up to one.

On a lathe (G18) the path is that of the tip of a tool whose nose is round: beside the centre's, by a radius or none in
each axis, as the control's table has it. Between two blocks that is the same, but with the first and the last one it
moves an axis by up to a radius to either side. Behind the first, often a rapid, an axis is on its side again where the
contour moves it further than that and its backlash.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.dialects.declaration import CORRECTED
from ph_post.edit.edits import CrossingEdit, StopEdit
from ph_post.edit.reversals import CARRIED, MOTION, SHARE, SIGN
from ph_post.gcode.paths import line_words
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

_TURNS: Final = "an axis turns in it where it rests along no straight line"


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
        ends = np.flatnonzero(np.diff(side, prepend=0, append=0) != 0)
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
        self.number = np.full(motions.kind.size, -1, dtype=np.int32)
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
        around = slice(first - 1, last + 2)
        if np.ptp(motions.chain[around]):
            return "not all of it is understood"
        planes = {program.modal_after(int(block)).plane for block in motions.block[around]}
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
        why = self.left()
        for stop in stops:
            if self._within(stop.motion, stop.share):
                why.setdefault(self._near(stop.motion), _TURNS)
        for crossing in crossings:
            for part in crossing.parts:
                if self._within(part.motion, part.low) and not self._still(part.motion, crossing):
                    why.setdefault(self._near(part.motion), _TURNS)
        for name, rows in changes.items():
            carried = rows[rows[:, CARRIED] == 1.0]
            for motion, sign in carried[:, [MOTION, SIGN]].astype(np.int64).tolist():
                if self._carries(motion, AXES.index(name), sign):
                    why.setdefault(int(self.number[motion]), _TURNS)
        radii: dict[int, float] = {}
        for n, one in enumerate(self.contours):
            if n in why:
                continue
            ways = self._turned_ways(one, changes, sides) if one.turned else self._ways(one, changes)
            bounds = [*ways, *self._rooms(one, crossings, sides)]
            radius = min((bound for bound, _ in bounds), default=math.inf)
            if any(bound < LEAST_PART * natural for bound, natural in bounds):
                why[n] = f"its directions would hold for cutters of a radius up to {max(radius, 0.0) / MM:.3g} mm alone"
            else:
                radii[n] = radius
        return why, radii

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

    def _ways(self, one: CutterContour, changes: Mapping[str, Array]) -> list[tuple[float, float]]:
        """Radii [m] up to which axes move on the way onto a contour and off it as said, and the lengths of the ways."""
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
            if not one.first < k <= one.last:
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
        return [line_words(int(block[one.first]), int(block[one.last])) for one in self.contours]

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
