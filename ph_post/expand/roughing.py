"""LinuxCNC's turning cycles G70, G71 and G72 as plain motions, in the order in which it makes them.

LinuxCNC's manual, "G70 Lathe finishing cycle" and "G71 G72 Lathe roughing cycles", and what the interpreter of LinuxCNC
2.9 does. G71 cuts level passes that begin on the way to the profile's first point, and goes down this way by its depth
of cut. At the bottom it follows the profile up to where that falls again, a pocket, and cuts levels there. G71.1 cuts
no pockets, and G71.2 nothing but pockets. G72 does the same with Z and X exchanged. G70 goes along the profile.
"""

from __future__ import annotations

import bisect
import math
from typing import Final

import msgspec

from ph_post.expand.faults import NotExpandableError
from ph_post.expand.machine import Version
from ph_post.expand.profiles import NEAR, Frame, Piece, RefusedProfileError, allow, check_profile, frame_of, is_below

TURNING: Final = (700, 710, 711, 712, 720, 721, 722)
"""Ten times the numbers of the cycles."""

_SHORT: Final = 1e-3
"""An arc of the profile that is not longer is not followed."""

_STILL: Final = 1e-4
"""Arcs that end no farther away in Z and X are no motions."""

_UNLIKE: Final = 1e-3
"""By how much the radii of an arc at its two ends may differ; LinuxCNC refuses 0.0028."""

_DEEP: Final = -1e9
_MOST_MOVES: Final = 200_000

_CHANGED: Final[list[Version]] = [(2, 9, 3), (2, 9, 4)]
"""Versions that end a profile in another way than those before."""

_UNENDING: Final = "a profile at which the passes of LinuxCNC do not end"


class TurningWords(msgspec.Struct, frozen=True, kw_only=True):
    """Words of a cycle, in radii and units of the program, with LinuxCNC's values for what is not said.

    `begin` is where it begins, `allowance` D and `last` E, `step` the depth of cut I, `lift` R, and `passes` P.
    """

    begin: complex
    allowance: float = 0.0
    last: float = 0.0
    step: float = 1.0
    lift: float = 0.5
    passes: int = 1


class TurningMove(msgspec.Struct, frozen=True):
    """A motion: 0 rapid, 1 straight, 2 and 3 arcs about `center`."""

    motion: int
    end: complex
    center: complex = 0j


class _Path:
    """Motions in a frame, written down as those of the program."""

    def __init__(self, frame: Frame, at: complex) -> None:
        self._frame, self.at = frame, at
        self.moves: list[TurningMove] = []

    def _add(self, move: TurningMove) -> None:
        if len(self.moves) == _MOST_MOVES:
            raise NotExpandableError(_UNENDING)
        self.moves.append(move)

    def straight(self, end: complex, *, rapid: bool = False) -> None:
        """Go straight."""
        self._add(TurningMove(0 if rapid else 1, self._frame.back(end)))

    def arc(self, piece: Piece, end: complex) -> None:
        """Go along an arc."""
        to, had = self._frame.back(end), self.moves[-1].end
        if is_below(abs(to.real - had.real), _STILL) and is_below(abs(to.imag - had.imag), _STILL):
            return
        motion, center = 3 if self._frame.sense(piece.turn) > 0 else 2, self._frame.back(piece.center)
        if is_below(_UNLIKE, abs(abs(to - center) - abs(had - center))):
            raise NotExpandableError("a profile that LinuxCNC cannot follow")
        self._add(TurningMove(motion, to, center))

    def along(self, piece: Piece) -> None:
        """Go along a piece to its end."""
        if piece.turn:
            self.arc(piece, piece.end)
        else:
            self.straight(piece.end)


class _Roughing:
    """Passes over a profile in its frame. `at` is the place of the tool."""

    def __init__(self, pieces: list[Piece], frame: Frame, words: TurningWords) -> None:
        self._pieces, self._words = pieces, words
        self._path = _Path(frame, pieces[0].start)
        self._at = pieces[0].start

    def run(self, kind: int) -> list[TurningMove]:
        """Return the motions of a cycle: `kind` 1 leaves pockets, 2 cuts nothing else."""
        pieces = self._pieces
        top = pieces[0].start.imag
        self._path.straight(self._at, rapid=True)
        at, level, rim = 0, top, -math.inf
        if kind == 2:  # the way down to the bottom was cut by G71.1
            while at < len(pieces) and self._sinks(at, _DEEP):
                at += 1
        step = max(self._words.step, 2.0 * NEAR)
        if not (top - min(piece.end.imag for piece in pieces)) / step < _MOST_MOVES:
            raise NotExpandableError(_UNENDING)
        while at < len(pieces):
            while is_below(self._at.imag, level - NEAR):
                level -= step
            if self._sinks(at, level):
                after = self._next(at, level)
                level -= step if after == at else 0.0
                at = after
                continue
            if kind == 1:
                self._follow_all(pieces[at:])
                break
            while at < len(pieces) and self._climbs(pieces[at]):
                at += 1
            if kind == 2:  # of pockets alone the levels begin at the highest rim
                rim = max(rim, self._at.imag)
            level = top if kind == 0 else rim
        return self._path.moves

    def _sinks(self, at: int, level: float) -> bool:
        """Go down along a piece as far as a level, at which it may already be; False where the piece goes up."""
        piece, fast = self._pieces[at], at == 0
        if piece.turn:
            return self._sinks_round(piece, level)
        if not is_below(piece.end.imag + NEAR, piece.start.imag):
            return False
        to = piece.end
        if level >= piece.end.imag:
            crossings = piece.crossings(level)
            if not crossings:
                raise NotExpandableError("a pass that LinuxCNC refuses")
            to = complex(crossings[0], level)
        self._path.straight(to, rapid=fast)
        self._at = to
        return True

    def _sinks_round(self, piece: Piece, level: float) -> bool:
        if is_below(abs(self._at - piece.end), NEAR) or not is_below(NEAR, (self._at - piece.end).real):
            self._at = piece.end
            return True
        middle = piece.center.real
        crossings = piece.crossings(level) or piece.crossings(level - NEAR)
        if piece.turn > 0:  # up to its top, and down behind it
            if is_below(middle, self._at.real - NEAR):
                return False
            to = piece.end if not crossings or is_below(middle, crossings[-1]) else complex(crossings[-1], level)
        else:  # down to its bottom, and up behind it
            if not is_below(middle, self._at.real):
                return False
            if crossings and is_below(crossings[0], middle):
                return True
            to = complex(crossings[0], level) if crossings else piece.end
        self._path.arc(piece, to)
        self._at = to
        return True

    def _next(self, at: int, level: float) -> int:
        """Cut a pass where the tool is at its level, and return the piece that is next: the same one behind a pass."""
        pieces, here = self._pieces, self._at
        if at == len(pieces) - 1:
            raise NotExpandableError("a profile that ends going down, of which versions of LinuxCNC differ")
        if is_below(NEAR, abs(here.imag - level)):
            return at + 1
        index, to = self._meets(at)
        length = abs(to - here.real)
        still = is_below(length, NEAR)
        if still and is_below(abs(here - pieces[index].start), NEAR):
            return index
        if is_below(abs(here - pieces[at].end), NEAR):
            raise NotExpandableError("a corner at the depth of a pass, of which versions of LinuxCNC differ")
        if not still:
            self._pass(to, length, fast=at == 0)
        return at

    def _meets(self, at: int) -> tuple[int, float]:
        """Return the piece that a pass from a piece runs into, and z there."""
        z, x = self._at.real, self._at.imag
        for index in range(at, len(self._pieces)):
            crossings = self._pieces[index].crossings(x)
            if not crossings:
                continue
            to = crossings[0] if index != at else crossings[-1]
            if not is_below(z, to - NEAR) and (index != at or not is_below(abs(to - z), NEAR)):
                return index, to
        raise NotExpandableError(_UNENDING)

    def _pass(self, to: float, length: float, *, fast: bool) -> None:
        """Cut level to z, and come back above the pass."""
        here, lift = self._at, self._words.lift
        if lift:
            lift *= min(1.0, length / 2.0 / lift)
        self._path.straight(complex(to, here.imag))
        self._path.straight(complex(to + lift, here.imag + lift), rapid=True)
        self._path.straight(complex(here.real - lift, here.imag + lift), rapid=True)
        self._path.straight(here, rapid=fast)

    def _climbs(self, piece: Piece) -> bool:
        """Follow a piece up; False where it falls, of an arc up to its top and no farther."""
        to, middle = piece.end, piece.center.real
        if not piece.turn:
            if is_below(piece.end.imag + NEAR, piece.start.imag):
                return False
            if is_below(NEAR, abs(self._at - piece.start)):
                raise NotExpandableError("a profile that LinuxCNC cannot follow")
            self._path.straight(to)
        elif piece.turn < 0:
            if is_below(middle, self._at.real):
                return False
            self._round(piece, to)
        else:
            if self._at.real < middle:
                return False
            to = self._top(piece)
            self._round(piece, to)
        self._at = to
        return piece.turn <= 0

    def _follow_all(self, pieces: list[Piece]) -> None:
        """Follow what goes up of a profile, and pass over its pockets."""
        doubt = False
        for piece in pieces:
            begins = is_below(abs(self._at - piece.start), NEAR)
            followed = self._clean(piece)
            if self._words.allowance and not piece.turn and abs((piece.end - piece.start).imag) < NEAR:
                # Rounding decides whether a level line counts as one that falls, and is gone along with the next piece.
                doubt = True
                if begins:
                    continue
            if doubt and not (followed and begins):
                break
            doubt = False
        if doubt:
            raise NotExpandableError("a level line at the end of the profile or beside a pocket, with an allowance")

    def _clean(self, piece: Piece) -> bool:
        """Go level to a piece that goes up, and follow it; False where it does not."""
        crossings = piece.crossings(self._at.imag)
        if (not piece.turn and piece.end.imag < piece.start.imag) or not crossings:
            return False
        middle, to = piece.center.real, piece.end
        begin = crossings[0] if piece.turn >= 0 else crossings[-1]
        if piece.turn and is_below(0.0, piece.turn * (middle - begin)):
            return False
        self._at = complex(begin, self._at.imag)
        self._path.straight(self._at)
        if piece.turn:
            to = self._top(piece) if piece.turn > 0 else to
            self._round(piece, to)
        else:
            self._path.straight(to)
        self._at = to
        return True

    def _round(self, piece: Piece, to: complex) -> None:
        if is_below(_SHORT, abs(self._at - to)):
            self._path.arc(piece, to)

    @staticmethod
    def _top(piece: Piece) -> complex:
        """Return the end of a counterclockwise arc, or its top where it falls behind that."""
        if piece.end.real < piece.center.real:
            return complex(piece.center.real, piece.center.imag + piece.radius)
        return piece.end


def turning_moves(
    cycle: int, pieces: list[Piece], words: TurningWords, version: Version | None = None
) -> list[TurningMove]:
    """Return the motions of a cycle behind the rapid to where it begins.

    Parameters
    ----------
    cycle : int
        Ten times the number of its G word.
    pieces : list of Piece
        The profile as the program has it, from where the cycle begins.
    words : TurningWords
    version : tuple of int, optional
        Of LinuxCNC; without it only what all versions do alike is certain.

    Raises
    ------
    NotExpandableError
        Where LinuxCNC refuses it, its versions differ, or rounding decides.
    """
    if len(pieces) < 2:
        raise NotExpandableError("a profile of less than two moves")
    if words.step <= 0.0 or words.lift < 0.0 or words.passes < 1:
        raise NotExpandableError("a turning cycle with an I, R or P that is too small")
    if cycle == 700:
        return _finished(pieces, words)
    turned = cycle >= 720
    ends = _ends(pieces, words.begin, turned=turned)
    if version is not None:
        ends = [ends[bisect.bisect(_CHANGED, version)]]
    found = _roughed(cycle, [*_copied(pieces), *ends[0]], words, turned=turned)
    others = []
    for number, end in enumerate(ends[1:], 1):
        if end in ends[:number]:
            continue
        try:
            others.append(_roughed(cycle, [*_copied(pieces), *end], words, turned=turned))
        except RefusedProfileError:
            if end == ends[-1]:
                raise
            # LinuxCNC 2.9.3 alone puts the line there, and refuses what it comes to
    if any(other != found for other in others):
        raise NotExpandableError(
            "its profile ends on another level than it begins, of which versions of LinuxCNC differ; "
            "--controller-version says which it is"
        )
    return found


def _copied(pieces: list[Piece]) -> list[Piece]:
    return [msgspec.structs.replace(piece) for piece in pieces]


def _ends(pieces: list[Piece], begin: complex, *, turned: bool) -> list[list[Piece]]:
    """Return what versions of LinuxCNC put behind a profile, in the order of `_CHANGED`: a line to its first level."""
    turn = Frame(turned=turned)
    first, last = (turn.into(one.end) - turn.into(one.start) for one in (pieces[0], pieces[-1]))
    end, to = turn.into(pieces[-1].end), turn.into(begin)
    line = Piece(pieces[-1].end, turn.back(complex(end.real, to.imag)))
    below = last.real != 0.0 and first.imag * (to.imag - end.imag) < 0.0
    return [[], [line] if to.imag != end.imag else [], [line] if below else []]


def _roughed(cycle: int, pieces: list[Piece], words: TurningWords, *, turned: bool) -> list[TurningMove]:
    frame = frame_of(pieces, turned=turned)
    pieces = frame.pieces(pieces)
    check_profile(pieces)
    allow(pieces, words.allowance)
    end, top = pieces[-1].end, pieces[0].start.imag
    if is_below(end.imag, top):
        pieces.append(Piece(end, complex(end.real, top)))
    return _Roughing(pieces, frame, words).run(cycle % 10)


def _runs_on(pieces: list[Piece], *, turned: bool) -> bool:
    return all(piece.runs_on for piece in frame_of(pieces, turned=turned).pieces(pieces))


def _finished(pieces: list[Piece], words: TurningWords) -> list[TurningMove]:
    """Return the motions of G70: the profile from its largest allowance to the last."""
    rest = pieces[1:]
    turned = not _runs_on(rest, turned=False)
    if turned and not _runs_on(rest, turned=True):  # older versions of LinuxCNC refuse it
        raise RefusedProfileError("a profile that runs back, which LinuxCNC refuses")
    frame = frame_of(pieces, turned=turned)
    pieces = frame.pieces(pieces)
    check_profile(pieces)
    path = _Path(frame, pieces[0].start)
    for left in range(words.passes - 1, -1, -1):
        one = _copied(pieces)
        allow(one, left * (words.allowance - words.last) / words.passes + words.last)
        path.straight(one[0].start, rapid=True)
        path.straight(one[0].end, rapid=True)
        for piece in one[1:]:
            path.along(piece)
    return path.moves
