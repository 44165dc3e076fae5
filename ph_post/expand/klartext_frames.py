"""Turned and mirrored coordinates of Heidenhain's conversational programs, written out as places of the datum.

HEIDENHAIN, iTNC 530 (340 49x) and TNC 620 (81760x), User's Manuals for Cycle Programming, "Coordinate Transformations":
cycle 10 turns about the datum in force, by an angle from X or from the one before (IROT), and takes the radius
compensation off; both axes of the plane have to move then before all is turned. Cycle 8 mirrors about the datum; where
that is one axis, arcs go round the other way, and the cutter is on the other side. An angle of 0 and a mirror without
axes end it. Which of them comes first where both are in force, and what a datum shift within does, stays with the
control.
"""

from __future__ import annotations

import cmath
import math
import re
from collections.abc import Sequence
from typing import Final

from ph_post.expand.faults import NotExpandableError
from ph_post.expand.frame_writer import FrameStandsError, FrameWriter
from ph_post.expand.frames import PlaneFrame, mirrored_in, turned_by
from ph_post.expand.klartext_cycles import OF_THEIR_OWN
from ph_post.expand.klartext_lines import (
    ENDS,
    IN_INCHES,
    NUMBER,
    SIDE,
    KlartextBlock,
    read_blocks,
    tnc_number,
    tnc_value,
)
from ph_post.expand.klartext_moves import (
    AT_THE_BEGIN,
    AT_THE_END,
    DECIMALS,
    KlartextMove,
    center_words,
    read_move,
)

_ROTATION: Final = re.compile(rf"CYCL\s+DEF\s+10\.1\s+(I?)ROT\s*({NUMBER})$")
_MIRROR: Final = re.compile(r"CYCL\s+DEF\s+8\.1\b\s*([A-Z\s]*)$")
_FRAME: Final = re.compile(r"CYCL\s+DEF\s+(?:8|10)\.(?!0)")
_NAMED: Final = re.compile(r"CYCL\s+DEF\s+(?:8|10)\.0\b")
_STILL: Final = re.compile(
    r"$|\*|BLK\s+FORM|TOOL\s+DEF|BEGIN\s+PGM|STOP\b|(?:M\s*0*(?:[0-9]|13|14|30)\s*)+$|CYCL\s+DEF\s+(?:9|32)\b|(?:RND|CHF)\s*(?:R\s*)?[\d.,]"
    r"|(?:FN\s*(?:[0-8]|13)\s*:\s*)?Q[LRS]?\d+\s*="
)
"""Blocks that no frame changes: what is rounded or chamfered off a corner is as long in any."""
_DEFINED: Final = re.compile(r"CYCL\s+DEF\s+(1(?=\.)|[2-6](?=\.)|17|18|2\d\d)")
_TOOL: Final = re.compile(r"TOOL\s+CALL\b(?!.*\b[XY]\b)")
_OTHER_TOOL: Final = re.compile(r"TOOL\s+CALL\b.*\b[XY]\b")
_PLANE_MOVE: Final = re.compile(
    r"(?!CC|CYCL\s+DEF|FN\s*\d|FUNCTION)(?:APPR|DEP|L|C|F)[A-Z]*\s*.*?(?<![A-Z])(?:I?[XY]|I?P[AR])\s*[-+\d.Q]"
    r"|CYCL\s+CALL|CALL\b"
)
_ABOUT_POLE: Final = re.compile(r"(?:[CL]P|C|APPR|DEP)(?![A-Z])")
_MACHINE: Final = frozenset((91, 92))
_OTHER_SENSE: Final = {"+": "-", "-": "+"}
_OTHER_SIDE: Final = {"L": "R", "R": "L"}


class KlartextFrames(FrameWriter):
    """Writes out what moves in turned or mirrored coordinates of a conversational program.

    Parameters
    ----------
    lines : sequence of str
        Of a program that runs from the first to the last, with plain numbers.
    """

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__()
        self._blocks = read_blocks(lines)

    @property
    def _first(self) -> int | None:
        return next((row for row, block in enumerate(self._blocks) if _FRAME.match(block.words)), None)

    def _read(self) -> list[tuple[int, list[str]]]:
        return [(block.first, block.lines) for block in self._blocks]

    def _words(self, row: int) -> str:
        return self._blocks[row].words

    def _made(self, standing: set[int]) -> list[list[str]]:
        return _FrameWork(self._blocks, standing).written()


class _FrameWork:
    """Goes through a program once, with the frames defined in `standing` rows left as they are."""

    def __init__(self, blocks: Sequence[KlartextBlock], standing: set[int]) -> None:
        self._blocks, self._standing = blocks, standing
        self._angle, self._axes = 0.0, ""
        self._turned_by = self._mirrored_by = -1
        self._frame: PlaneFrame | None = None
        self._row = 0
        self._at: complex | None = None
        self._pole: complex | None = None
        self._side, self._upright = "0", True
        self._behind: int | None = None
        self._old_pole: int | None = None

    def written(self) -> list[list[str]]:
        """Return the lines of each block."""
        rows = [block.lines for block in self._blocks]
        for row, block in enumerate(self._blocks):
            if IN_INCHES.match(block.words):
                raise FrameStandsError(None, "the program is in inches")
            if _FRAME.match(block.words):
                text = self._defined(row, block)
                rows[row] = block.lines if text is None else block.with_words(text)
            elif self._frame is None:
                self._follow(block)
            elif not _NAMED.match(block.words):
                try:
                    text = self._moved(block)
                except NotExpandableError as error:
                    raise FrameStandsError(self._row, f"{error.what}: {block.words[:40]}") from None
                rows[row] = block.lines if text is None else block.with_words(text)
            if ENDS.search(block.words):
                break
        return rows

    # ------------------------------------------------------------------ definitions

    def _defined(self, row: int, block: KlartextBlock) -> str | None:
        """Follow a definition; return what is written for it, None where it stays."""
        rotation, mirror = _ROTATION.match(block.words), _MIRROR.match(block.words)
        if block.slash or (rotation is None and mirror is None):
            raise FrameStandsError(None, "its numbers are not known, or it runs or not as a switch says")
        if rotation is not None:
            self._angle, self._turned_by = tnc_value(rotation[2]) + (self._angle if rotation[1] else 0.0), row
        elif mirror is not None:
            self._axes, self._mirrored_by = "".join(mirror[1].split()), row
        turns, mirrors = bool(math.fmod(self._angle, 360.0)), bool(self._axes)
        own = self._turned_by if turns else self._mirrored_by
        if self._frame is not None and own == self._row and turns != mirrors:
            return None  # no more than an end of what was not in force
        if self._frame is not None:
            if self._side != "0":
                raise FrameStandsError(self._row, "the next frame begins beside the contour")
            self._behind = self._old_pole = self._row
        self._frame = None
        if turns and mirrors:
            self._stand_both(row)
        if not (turns or mirrors) or {own, row} & self._standing:
            absolute = f"CYCL DEF 10.1 ROT{_signed(math.fmod(self._angle, 360.0))}"
            return absolute if rotation is not None and rotation[1] else None
        if self._side != "0":
            raise FrameStandsError(row, "it begins beside the contour")
        if not self._upright or set(self._axes) - set("XY"):
            raise FrameStandsError(row, "it is not in the plane of X and Y")
        self._frame, self._row = turned_by(self._angle) if turns else mirrored_in(self._axes), row
        self._at = self._pole = self._behind = None
        return "CYCL DEF 10.1 ROT+0" if turns else "CYCL DEF 8.1"

    def _stand_both(self, row: int) -> None:
        """Leave a rotation and a mirror that are in force at a time, of which `row` defines the second."""
        for one in (self._turned_by, self._mirrored_by):
            if one != row and one not in self._standing:
                raise FrameStandsError(one, "a rotation and a mirror at a time")
        self._standing.add(row)

    # ------------------------------------------------------------------ without a frame

    def _follow(self, block: KlartextBlock) -> None:
        """Follow a block that stays, up to where the place and the centre from the frame before are gone."""
        words = block.words
        side = SIDE.search(words) if words[:1] in "LC" else None
        self._side = side[1] if side else self._side
        self._upright = not _OTHER_TOOL.match(words) and (self._upright or _TOOL.match(words) is not None)
        if self._old_pole is not None and words.startswith("CC"):
            places = center_words(words)
            if len(places) == 1 and not places[0][0]:
                raise FrameStandsError(self._old_pole, "a centre behind it that has one axis")
            self._old_pole = None
        if self._old_pole is not None and _ABOUT_POLE.match(words):
            raise FrameStandsError(self._old_pole, "a centre in it counts behind it")
        if self._behind is None or not _PLANE_MOVE.match(words):
            return
        move = None if block.slash else read_move(block)
        if move is None or not _names_both(move):
            raise FrameStandsError(self._behind, "the first move behind it does not name X and Y")
        self._behind = None if not _MACHINE & set(move.functions) else self._behind

    # ------------------------------------------------------------------ within a frame

    def _moved(self, block: KlartextBlock) -> str | None:
        """Return a block without the frame, None where it is the same."""
        words = block.words
        if block.slash and words:
            raise NotExpandableError("a line that runs or not as the control's switch says")
        defined = _DEFINED.match(words)
        if _STILL.match(words) or (defined is not None and int(defined[1]) not in OF_THEIR_OWN):
            return None
        if _TOOL.match(words):
            self._at = None
            return None
        if words.startswith("CC"):
            return self._center(words)
        move = read_move(block)
        if move is None or not set(move.functions) <= {*AT_THE_BEGIN, *AT_THE_END, *_MACHINE, 6}:
            raise NotExpandableError("a block that is not followed in turned or mirrored coordinates")
        return self._without(move)

    def _center(self, words: str) -> str:
        places = center_words(words)
        had = complex(math.nan, math.nan) if self._pole is None else self._pole
        here = complex(math.nan, math.nan) if self._at is None else self._at
        ends = {"X": had.real, "Y": had.imag} if places else {"X": here.real, "Y": here.imag}
        for step, axis, number in places:
            ends[axis] = tnc_value(number) + ({"X": here.real, "Y": here.imag}.get(axis, math.nan) if step else 0.0)
        pole = complex(ends["X"], ends["Y"])
        if cmath.isnan(pole) or len(ends) > 2 or "Q" in words:
            raise NotExpandableError("a centre that is not known")
        self._pole = pole
        found = self._applied(pole)
        return f"CC X{_signed(found.real)} Y{_signed(found.imag)}"

    def _without(self, move: KlartextMove) -> str | None:
        frame = self._frame
        assert frame is not None
        changed = frame.flips and move.side in _OTHER_SIDE
        self._side = move.side or self._side
        move.side = _OTHER_SIDE.get(move.side, move.side) if frame.flips else move.side
        in_plane = {"X", "Y", "PA", "PR"} & move.places.keys()
        if _MACHINE & set(move.functions):
            self._at = None if in_plane else self._at
            return None
        if move.word == "CP":
            self._turn(move, frame)
        elif in_plane or move.word != "L":
            if move.word not in ("L", "C", "CR") or {"PA", "PR"} & in_plane:
                raise NotExpandableError("a path that is not followed in turned or mirrored coordinates")
            if move.word == "C" and self._pole is None:
                raise NotExpandableError("an arc about a centre from before")
            move.goes_to(self._applied(self._end(move)))
        elif not changed:
            return None
        if frame.flips:
            move.sense = _OTHER_SENSE.get(move.sense, move.sense)
        return move.text()

    def _end(self, move: KlartextMove) -> complex:
        """Return where a move ends in the frame."""
        if self._at is None and not _names_both(move):
            raise NotExpandableError("the first move does not name X and Y")
        here = 0j if self._at is None else self._at
        ends = {"X": here.real, "Y": here.imag}
        for axis, (step, number) in move.places.items():
            if axis in ends:
                ends[axis] = tnc_value(number) + (ends[axis] if step else 0.0)
        self._at = complex(ends["X"], ends["Y"])
        return self._at

    def _turn(self, move: KlartextMove, frame: PlaneFrame) -> None:
        """Write the angle of a circle or a helix about the pole, and follow it."""
        step, number = move.places.get("PA", ("", ""))
        if self._at is None or self._pole is None or not number or set(move.places) - {"PA", "Z"}:
            raise NotExpandableError("a circle about a centre from before, or from a place that is not known")
        angle, away = tnc_value(number), self._at - self._pole
        heading = cmath.phase(away) + math.radians(angle) if step else math.radians(angle)
        self._at = self._pole + cmath.rect(abs(away), heading)
        turned = math.degrees(cmath.phase(frame.apply(cmath.rect(1.0, math.radians(angle)))))
        if step:
            turned = -angle if frame.flips else angle
        move.places = {**move.places, "PA": (step, _signed(turned))}

    def _applied(self, place: complex) -> complex:
        assert self._frame is not None
        return self._frame.apply(place)


def _names_both(move: KlartextMove) -> bool:
    """Return whether a move is straight, to a place of which X and Y are said."""
    return move.word == "L" and all(move.places.get(axis, ("I", ""))[0] == "" for axis in "XY")


def _signed(value: float) -> str:
    return tnc_number(value, DECIMALS, sign=True)
