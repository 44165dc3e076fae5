"""Cutter compensation as LinuxCNC works it out: the path of the tool's centre beside the programmed contour.

A move is written when the next one has said where its end lies: in a concave corner both end where their offset paths
meet, around a convex one an arc about the corner joins them. Places of the plane are complex numbers. LinuxCNC's
manual, "Tool Compensation", and its canonical calls, to which the corners, the order and the refusals are those of
version 2.9.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Callable
from typing import Final

import msgspec

from ph_post.expand.faults import NotExpandableError

STRAIGHT_ON: Final = 0.05
"""Angle [rad] up to which a corner is none."""

_MORE_TURN: Final = 0.0254
"""By how much [rad] an arc may turn further than it was programmed, where its end is moved."""

_SAME: Final = 1e-7
"""Distance in program units below which the end of an arc is its start."""

_RADII: Final = 0.002
_RADII_SHARE: Final = 0.0005
"""How far the radii of an arc may be apart, in program units or as a share: less than LinuxCNC takes."""

PlaneMove = Callable[["CutterMove", complex], str]
"""Writes a move from a place."""


class CutterMove(msgspec.Struct, kw_only=True):
    """A move of the tool's centre: where it ends, and around what.

    `motion` is that of its G word, `turns` how often it goes around its `center` (clockwise below 0, 0 for a line).
    `along` and `sweep` are the programmed direction and angle, `words` those of the axes that are not in the plane, and
    `line` is where it is written.
    """

    motion: int
    end: complex
    center: complex = 0j
    turns: int = 0
    along: complex = 0j
    sweep: float = 0.0
    words: str = ""
    line: int = -1


def swept(start: complex, center: complex, turns: int, end: complex) -> float:
    """Return the angle [rad] of an arc, negative clockwise; a whole turn where it ends at its start."""
    angle = cmath.phase(end - center) - cmath.phase(start - center)
    if turns > 0:
        return (angle % math.tau or math.tau) + (turns - 1) * math.tau
    return -(-angle % math.tau or math.tau) + (turns + 1) * math.tau


def center_by_radius(start: complex, end: complex, radius: float, *, clockwise: bool) -> complex:
    """Return the centre of an arc that its radius tells, negative where it is more than half a turn."""
    chord = end - start
    height = math.sqrt(max(radius**2 - 0.25 * abs(chord) ** 2, 0.0)) / abs(chord)
    return start + chord * complex(0.5, -height if clockwise == (radius > 0.0) else height)


class CutterPath:
    """The path of the tool's centre, from G41 or G42 to G40.

    Parameters
    ----------
    lines : list of str
        Of the program that is written.
    text : callable
        Writes a move.
    start : complex
        Where the tool is.
    side : int
        1 for the left of the contour, -1 for the right.
    radius : float
        In program units.
    """

    def __init__(self, lines: list[str], text: PlaneMove, start: complex, side: int, radius: float) -> None:
        self._lines, self._text, self._side, self._radius = lines, text, side, radius
        self._tool = self._programmed = self._written = start
        self._clipped: complex | None = None
        self._queue: list[CutterMove] = []
        self.entered = False

    # ------------------------------------------------------------------ moves

    def straight(self, motion: int, to: complex, words: str, further: str) -> None:
        """Move along a line; `words` of all axes that are not in the plane, `further` of those but the one across it.

        Raises
        ------
        NotExpandableError
            Where LinuxCNC refuses it too, as the tool does not fit.
        """
        if not self.entered:
            self._enter_straight(motion, to, words)
            return
        if to == self._programmed:
            self._put(CutterMove(motion=motion, end=self._tool, words=words))
            return
        along = _unit(to - self._programmed)
        beta, front = self._corner(along), self._front
        convex_of_arc = front is not None and front.turns * self._side < 0
        if self._is_concave(beta) or (beta > math.pi - STRAIGHT_ON and convex_of_arc):
            self._end_at(self._meet_line(along, beta))
        elif beta > STRAIGHT_ON:
            corner = self._programmed + self._radius * self._normal(along)
            self._end_at(self._tool)
            self._round(corner, further, motion)
        else:
            self._release(self._tool)
        end = to + self._radius * self._normal(along)
        self._put(CutterMove(motion=motion, end=end, along=to - self._programmed, words=words))
        self._tool, self._programmed = end, to

    def arc(self, motion: int, to: complex, center: complex, turns: int, words: str, further: str) -> None:
        """Move along an arc of a `center`; else as :meth:`straight`."""
        inside, radius = turns * self._side > 0, abs(center - to)
        if inside and (radius if self.entered else abs(center - self._tool)) <= self._radius:
            raise NotExpandableError("the tool does not fit into the arc")
        outward = _unit(to - center) * (-1.0 if inside else 1.0)
        end = to + self._radius * outward
        if not self.entered:
            center, sweep = self._entry_center(to, center, end), 0.0
        else:
            begin, sense = self._programmed, math.copysign(1.0, turns)
            sweep = swept(begin, center, turns, to)
            beta = self._corner(_unit(begin - center) * 1j * sense)
            if self._is_concave(beta) or (abs(beta - math.pi) < STRAIGHT_ON and not inside):
                self._end_at(self._meet_arc(center, turns, radius, beta))
            elif beta > STRAIGHT_ON:
                self._release(self._tool)
                normal = _unit(begin - center) * (-1.0 if inside else 1.0)
                self._round(begin + self._radius * normal, further, 1)
            else:
                self._release(self._tool)
        self._put(CutterMove(motion=motion, end=end, center=center, turns=turns, sweep=sweep, words=words))
        self._tool, self._programmed, self.entered = end, to, True

    def stop(self) -> None:
        """Write what waits for its corner, as at a stop of the program, and at the end."""
        self._release(None)

    def finish(self) -> None:
        """Write what waits for its corner where the compensation ends."""
        self._end_at(self._tool)

    # ------------------------------------------------------------------ the first move

    def _enter_straight(self, motion: int, to: complex, words: str) -> None:
        if abs(to - self._tool) <= self._radius:
            raise NotExpandableError("the move onto the contour is not longer than the tool's radius")
        normal = self._normal(_unit(to - self._tool))
        self._clipped = self._tool
        end = to + self._radius * normal
        # Any direction to that side is right: the move is long enough never to turn about.
        self._put(CutterMove(motion=motion, end=end, along=normal, words=words))
        self._tool, self._programmed, self.entered = end, to, True

    def _entry_center(self, to: complex, center: complex, end: complex) -> complex:
        """Return the centre of an arc from the tool's place that ends as the programmed one does, beside it."""
        if abs(to - self._tool) <= self._radius:
            raise NotExpandableError("the arc onto the contour is not longer than the tool's radius")
        back, toward = self._tool - end, _unit(center - end)
        share = (back * toward.conjugate()).real
        if abs(share) < 1e-6 * abs(back):
            raise NotExpandableError("the arc onto the contour has no centre")
        return end + toward * 0.5 * abs(back) ** 2 / share

    # ------------------------------------------------------------------ corners

    def _normal(self, along: complex) -> complex:
        return self._side * 1j * along

    @property
    def _front(self) -> CutterMove | None:
        return self._queue[0] if self._queue else None

    def _corner(self, along: complex) -> float:
        """Return how far the contour turns away from the tool [rad]: convex above 0, concave below it and beyond π."""
        had = cmath.phase(self._tool - self._programmed)
        return (self._side * (had - cmath.phase(along))) % math.tau - 0.5 * math.pi

    @staticmethod
    def _is_concave(beta: float) -> bool:
        return beta < -STRAIGHT_ON or beta > math.pi + STRAIGHT_ON

    def _before(self) -> CutterMove:
        if self._front is None:
            raise NotExpandableError("a concave corner behind a stop of the program")
        return self._front

    def _meet_line(self, along: complex, beta: float) -> complex:
        """Return where the offset path of the move before meets that of a line."""
        before = self._before()
        if not before.turns:
            back = self._side * 1j * _unit(self._tool - self._programmed)
            return self._tool + back * self._radius / math.tan(0.5 * (beta + math.pi))
        radius, inside = abs(before.center - before.end), before.turns * self._side > 0
        left = 1j * along
        # The radius at the end counts, also where an arc's two radii differ a little.
        programmed = radius + self._radius if inside else radius - self._radius
        height = self._side * self._radius
        height -= programmed * (_unit(before.center - self._programmed) * left.conjugate()).real
        reach = _cathetus(radius, height)
        return before.center + height * left + (-reach if inside else reach) * along

    def _meet_arc(self, center: complex, turns: int, radius: float, beta: float) -> complex:
        """Return where the offset path of the move before meets that of an arc."""
        before, inside = self._before(), turns * self._side > 0
        offset = radius - self._radius if inside else radius + self._radius
        if not before.turns:
            along = -self._side * 1j * _unit(self._tool - self._programmed)
            side = math.copysign(1.0, turns)
            height = side * ((self._radius if inside else -self._radius) - radius * math.cos(beta))
            reach = _cathetus(offset, height)
            return center + height * 1j * along + (reach if inside else -reach) * along
        had = abs(before.center - before.end)
        apart = abs(center - before.center)
        if had == 0.0 or apart == 0.0:
            raise NotExpandableError("an arc behind one of the same centre")
        share = (had**2 + apart**2 - offset**2) / (2.0 * had * apart)
        if abs(share) > 1.0:
            raise NotExpandableError("the tool does not fit between two arcs")
        left = (before.turns * self._side > 0) == (turns > 0)
        angle = math.acos(share) * (1.0 if left else -1.0)
        return before.center + _unit(center - before.center) * cmath.rect(had, angle)

    def _round(self, corner: complex, further: str, motion: int) -> None:
        """Go around a convex corner: along an arc, or straight on where nothing is cut."""
        turns = -self._side if motion == 1 else 0
        word = motion if not turns else 2 if turns < 0 else 3
        move = CutterMove(motion=word, end=corner, center=self._programmed, turns=turns, words=further)
        self._lines.append(self._text(move, self._written))
        self._written = self._clipped = corner

    # ------------------------------------------------------------------ moves that wait for their corner

    def _put(self, move: CutterMove) -> None:
        move.line = len(self._lines)
        self._lines.append("")
        self._queue.append(move)

    def _end_at(self, place: complex) -> None:
        """Let the moves that wait end at a place, and write them."""
        if not self._queue:
            return
        for move in self._queue:
            self._check(move, place)
            move.end = place
        self._release(place)

    def _check(self, move: CutterMove, place: complex) -> None:
        if move.turns:
            if abs(abs(move.end - move.center) - abs(place - move.center)) > 0.01:
                raise NotExpandableError("the tool does not reach the corner behind an arc")
            if self._clipped is not None and move.sweep != 0.0:
                sweep = swept(self._clipped, move.center, move.turns, place)
                if abs(sweep) > abs(move.sweep) + _MORE_TURN:
                    raise NotExpandableError("the tool cuts into a concave corner at an arc")
        elif self._clipped is not None and (move.along * (place - self._clipped).conjugate()).real < 0.0:
            raise NotExpandableError("the tool cuts into a concave corner at a line")

    def _release(self, clipped: complex | None) -> None:
        """Write the moves that wait; behind them the next one begins at `clipped`, None where that is open."""
        for move in self._queue:
            if move.turns and abs(move.end - self._written) < _SAME:
                # Rounding must not make a whole turn of none, nor none of a whole one.
                if abs(move.sweep) > math.pi:
                    move.end = self._written
                else:
                    move.motion, move.turns = 1, 0
            if move.turns:
                radii = abs(move.end - move.center), abs(self._written - move.center)
                if abs(radii[0] - radii[1]) > max(_RADII, _RADII_SHARE * min(radii)):
                    raise NotExpandableError("an arc whose radii differ")
            self._lines[move.line] = self._text(move, self._written)
            self._written = move.end
        self._queue.clear()
        self._clipped = clipped


def _unit(of: complex) -> complex:
    return of / abs(of) if of else 1.0 + 0j


def _cathetus(longest: float, other: float) -> float:
    """Return the third side of a right triangle."""
    if abs(other) > longest:
        raise NotExpandableError("the tool does not fit into a concave corner at an arc")
    return math.sqrt(longest**2 - other**2)
