"""The profile that a turning cycle cuts: its lines and arcs, how it is turned for the passes, and its allowance.

LinuxCNC's manual, "G70 Lathe finishing cycle" and "G71 G72 Lathe roughing cycles", and what the interpreter of LinuxCNC
2.9 does. Places are complex numbers, z + i·x, in radii and units of the program. A profile begins with the way from
where the cycle begins to its first point.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Final

import msgspec

from ph_post.expand.faults import NotExpandableError

NEAR: Final = 1e-6
"""How near LinuxCNC takes two places of a profile to be one, in units of the program."""

_UNSURE: Final = 1e-9
"""Below this the last digits decide, which are not those of the controller."""

_ALIKE: Final = 1e-7
"""How far from each other two crossings may be for one to stand for the other."""

_TANGENT: Final = 1e-3
_LEVEL: Final = 1e-6
"""Sines of the angle between two arcs, and of that to a level line, below which rounding decides which goes up."""

_SLACK: Final = 1e-3
"""How far a profile may run backwards, and the length below which LinuxCNC leaves a piece out."""

_GAP: Final = 1e-2
"""A gap along the profile from which LinuxCNC puts an arc into it."""

_MOST_STEPS: Final = 1000


class RefusedProfileError(NotExpandableError):
    """A profile that LinuxCNC refuses."""


def is_below(a: float, b: float) -> bool:
    """Return whether a number is below another one.

    Raises
    ------
    NotExpandableError
        Where rounding decides.

    Examples
    --------
    >>> is_below(1.0, 1.0), is_below(1.0, 1.1)
    (False, True)
    """
    if 0.0 < abs(a - b) < _UNSURE:
        raise NotExpandableError("a pass or a corner that rounding moves to one side or the other")
    return a < b


def _is_surely_below(a: float, b: float) -> bool:
    """Return as :func:`is_below`, and refuse equal ones too."""
    return is_below(a, b if a != b else b + 0.5 * _UNSURE)


class Piece(msgspec.Struct):
    """A line, or an arc about its `center`, of which `turn` is 1 counterclockwise (from z to x) and -1 clockwise.

    A corner that is still to be finished has a `finish`: the radius that rounds it where it `rounds`, or how far the
    line that breaks it lies inside.
    """

    start: complex
    end: complex
    center: complex = 0j
    turn: int = 0
    finish: float = 0.0
    rounds: bool = False

    @property
    def radius(self) -> float:
        """Radius of an arc."""
        return abs(self.start - self.center)

    @property
    def size(self) -> float:
        """What LinuxCNC takes for its size: the chord, and of an arc at most the radius."""
        chord = abs(self.start - self.end)
        return min(chord, self.radius) if self.turn else chord

    @property
    def runs_on(self) -> bool:
        """Whether it runs to lower z only, and as an arc stays on one side of its centre, where it can be roughed."""
        step = (self.end - self.start).real
        if not self.turn:
            return not is_below(_SLACK, step)
        inside = all(not is_below(self.turn * (one - self.center).imag, -_SLACK) for one in (self.start, self.end))
        return inside and not is_below(-_SLACK, step)

    def crossings(self, level: float) -> list[float]:
        """Return z where it has a height x: of an arc the higher z first, of a level line both ends."""
        low, high = sorted((self.start.imag, self.end.imag))
        if self.turn:
            return self._arc_crossings(level)
        if is_below(level + NEAR, low) or is_below(high, level - NEAR):
            return []
        if is_below(high - low, NEAR):
            return [self.start.real, self.end.real]
        share = (level - self.start.imag) / (self.end.imag - self.start.imag)
        return [share * (self.end.real - self.start.real) + self.start.real]

    def _arc_crossings(self, level: float) -> list[float]:
        radius, height = self.radius, level - self.center.imag
        square = (radius - height) * (radius + height)
        if is_below(square, -NEAR):
            return []
        half = math.sqrt(max(square, 0.0))
        places = (complex(self.center.real + half, level), complex(self.center.real - half, level))
        return [place.real for place in places if self._holds(place)]

    def _holds(self, place: complex) -> bool:
        to = place - self.center
        behind_start = self.turn * ((self.start - self.center).conjugate() * to).imag
        behind_end = self.turn * ((self.end - self.center).conjugate() * to).imag
        return not is_below(behind_start, -NEAR) and not is_below(NEAR, behind_end)

    def shift(self, distance: float) -> None:
        """Move it to its left in the sense of lower z, as an allowance does."""
        if self.turn:
            factor = (self.radius + self.turn * distance) / self.radius
            self.start, self.end = (factor * (one - self.center) + self.center for one in (self.start, self.end))
            return
        step = 1j * distance * (self.start - self.end) / abs(self.start - self.end)
        self.start, self.end = self.start + step, self.end + step


class Frame(msgspec.Struct):
    """How a profile is turned so that it runs to lower z and, from its first point to its last, to higher x."""

    turned: bool = False
    across: bool = False
    along: bool = False

    def into(self, place: complex) -> complex:
        """Return a place of the program in the frame."""
        return self._mirror(-1j * place if self.turned else place)

    def back(self, place: complex) -> complex:
        """Return a place of the frame in the program."""
        place = self._mirror(place)
        return 1j * place if self.turned else place

    def _mirror(self, place: complex) -> complex:
        return complex(-place.real if self.along else place.real, -place.imag if self.across else place.imag)

    def sense(self, turn: int) -> int:
        """Return the sense of an arc in the other one."""
        return -turn if self.across != self.along else turn

    def pieces(self, pieces: list[Piece]) -> list[Piece]:
        """Return a profile of the program in the frame."""
        into = self.into
        return [
            msgspec.structs.replace(
                one, start=into(one.start), end=into(one.end), center=into(one.center), turn=self.sense(one.turn)
            )
            for one in pieces
        ]


def frame_of(pieces: list[Piece], *, turned: bool) -> Frame:
    """Return the frame of a profile; `turned` exchanges z and x."""
    frame = Frame(turned=turned)
    way = frame.into(pieces[0].end) - frame.into(pieces[-1].end)
    return Frame(turned=turned, across=is_below(0.0, way.imag), along=is_below(way.real, 0.0))


def check_profile(pieces: list[Piece]) -> None:
    """Finish the corners of a profile, begin it above its first point, and refuse one that runs back.

    Raises
    ------
    NotExpandableError
        Where LinuxCNC refuses it, or leaves a piece out.
    """
    _finish(pieces)
    first = pieces[0]
    if any(is_below(piece.size, _SLACK) for piece in pieces):
        raise NotExpandableError("a profile of which LinuxCNC leaves a small piece out")
    if is_below(first.start.real, first.end.real):
        first.start = complex(first.end.real, first.start.imag)
    if not all(piece.runs_on for piece in pieces):
        raise RefusedProfileError("a profile that runs back, which LinuxCNC refuses")


def _finish(pieces: list[Piece]) -> None:
    """Round and break the corners that are to be."""
    for index, corner in enumerate(pieces):
        if not corner.finish:
            continue
        if index in (0, len(pieces) - 1):
            raise NotExpandableError("a corner at the end of a profile")
        before, after = pieces[index - 1], pieces[index + 1]
        one, other = _shifted(before, after, corner.finish)
        inside = corner.finish
        if is_below(_GAP, (one.end - other.start).real):
            inside = -inside
            one, other = _shifted(before, after, inside)
            if is_below(_GAP, (one.end - other.start).real):
                raise RefusedProfileError("a corner that LinuxCNC cannot finish")
        _join(one, other)
        corner.center = (one.end + other.start) / 2.0
        for piece in (one, other):
            _check_size(piece)
            piece.shift(-inside)
        corner.start = before.end = one.end
        corner.end = after.start = other.start
        if corner.rounds:
            above = any(is_below(0.0, (end - corner.center).imag) for end in (corner.start, corner.end))
            corner.turn = 1 if above else -1
        corner.finish = 0.0


def _shifted(one: Piece, after: Piece, distance: float) -> list[Piece]:
    found = [msgspec.structs.replace(piece) for piece in (one, after)]
    for piece in found:
        if piece.turn and is_below(piece.radius, 2.0 * abs(distance)):
            raise NotExpandableError("a corner at an arc that is small beside what it is finished with")
        _check_size(piece)
        piece.shift(distance)
    return found


def allow(pieces: list[Piece], distance: float) -> None:
    """Move a profile away by an allowance, to the side from which the cycle comes.

    LinuxCNC does it in steps of half its smallest piece, and joins the pieces behind each.

    Raises
    ------
    NotExpandableError
        Where it is not certain what that comes to.
    """
    first, rest = pieces[0], pieces[1:]
    far = rest[-1].start - first.start
    if distance and far == 0j:
        raise NotExpandableError("an allowance of a profile that ends where it begins")
    if distance and is_below(((first.end - first.start) / far).imag, 0.0):
        distance = -distance
    done = 0.0
    for _ in range(_MOST_STEPS):
        if done == distance:
            break
        step = min(*(piece.size / 2.0 for piece in rest), abs(distance - done))
        step = math.copysign(step, distance)
        rest = _stepped(rest, step)
        done += step
    else:
        raise NotExpandableError("an allowance that a piece of the profile is too small for")
    for one, after in pairwise(rest):
        one.end = after.start = (one.end + after.start) / 2.0
    first.end = rest[0].start
    pieces[:] = [first, *rest]


def _stepped(pieces: list[Piece], step: float) -> list[Piece]:
    """Return a profile that has moved by a step."""
    corners = [(one.end + after.start) / 2.0 for one, after in pairwise(pieces)]
    for piece in pieces:
        _check_size(piece)
        piece.shift(step)
        _check_size(piece)
    found = [pieces[0]]
    for corner, piece in zip(corners, pieces[1:], strict=True):
        before = found[-1]
        if is_below(_GAP, (before.end - piece.start).real):
            found.append(Piece(before.end, piece.start, corner, 1 if step > 0.0 else -1))
        found.append(piece)
    for one, after in pairwise(found):
        if not one.runs_on:
            raise NotExpandableError("an allowance in which a piece of the profile vanishes")
        _check_size(one)
        _join(one, after)
    return found


def _check_size(piece: Piece) -> None:
    if is_below(piece.size, 2.0 * _SLACK):  # LinuxCNC may leave it out
        raise NotExpandableError("an allowance in which a piece of the profile vanishes")


def _join(one: Piece, after: Piece) -> None:
    """Let two pieces meet."""
    if not one.turn and not after.turn:
        place = _crossing_of_lines(one, after)
    elif one.turn and after.turn:
        place = _crossing_of_arcs(one, after)
    elif is_below(abs(after.start - one.end), NEAR):
        return
    else:
        line, arc = (after, one) if one.turn else (one, after)
        place = _crossing_of_both(line, arc, after.start)
    one.end = after.start = place


def _crossing_of_lines(one: Piece, after: Piece) -> complex:
    along, across = after.end - after.start, one.end - one.start
    area = (across.conjugate() * along).imag
    if abs(area) < _UNSURE * abs(along) * abs(across):
        raise RefusedProfileError("an allowance of lines in one direction, one behind the other")
    return one.start + across * ((after.start - one.start).conjugate() * along).imag / area


def _crossing_of_both(line: Piece, arc: Piece, near: complex) -> complex:
    """Return where a line and an arc cross, near a place; the nearest place where they do not."""
    unit = (line.end - line.start) / abs(line.end - line.start)
    to = (arc.center - line.start) * unit.conjugate()
    half = math.sqrt(max(abs(arc.end - arc.center) ** 2 - to.imag**2, 0.0))
    one, other = (line.start + unit * (to.real + sign * half) for sign in (1.0, -1.0))
    if half < _ALIKE:
        return one
    return one if _is_surely_below(abs(near - one), abs(near - other)) else other


def _crossing_of_arcs(one: Piece, after: Piece) -> complex:
    """Return where two arcs cross; of the two places that to the left, from the second centre to the first."""
    way = one.center - after.center
    apart, radius, other = abs(way), after.radius, one.radius
    if is_below(apart, NEAR):
        raise NotExpandableError("an allowance of two arcs about one centre")
    cosine = (apart * apart + radius * radius - other * other) / 2.0 / apart / radius
    sine = math.sqrt(1.0 - min(cosine * cosine, 1.0))
    place = complex(cosine, sine) * way / apart * radius + after.center
    level = min(abs((place - piece.center).real) / piece.radius for piece in (one, after))
    if sine < _TANGENT and level < _LEVEL:  # the place is known to the root of the last digit
        raise NotExpandableError("an allowance of two arcs of which one goes on level as the other")
    return place
