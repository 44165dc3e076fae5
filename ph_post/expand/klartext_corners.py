"""RND, CHF, LP and CT of Heidenhain's conversational programs, written out as arcs and lines.

HEIDENHAIN, iTNC 530 User's Manual, Conversational (340 49x), 6.4: RND is an arc that touches the contour elements
before and behind, CHF cuts its length off both of two straight lines; their feed is theirs alone. 6.5: LP goes to a
radius and an angle about the pole, which stay those of the LP before where they are not named. 6.4: CT is an
arc that goes on in the direction of the element before it.
"""

from __future__ import annotations

import cmath
import math
import re
from collections.abc import Sequence
from typing import Final

from ph_post.expand.corner_follower import CornerFollower, OpenCorner
from ph_post.expand.corners import Corner, Element, arc_by_radius
from ph_post.expand.faults import NotExpandableError
from ph_post.expand.klartext_lines import NUMBER, KlartextBlock, read_blocks, tnc_number, tnc_value
from ph_post.expand.klartext_moves import AT_THE_BEGIN, AT_THE_END, DECIMALS, KlartextMove, center_words, read_move
from ph_post.expand.progress import WrittenLines

_CORNER: Final = re.compile(rf"(RND|CHF)\s*(?:R\s*)?({NUMBER})(?:\s*F\s*({NUMBER}))?$")
_CENTER: Final = re.compile(r"CC(?![A-Z])")
_ABSOLUTE_CENTER: Final = re.compile(rf"CC\s*X\s*{NUMBER}\s*Y\s*{NUMBER}$")
"""A centre that is the same wherever the corner before it ends."""
_STILL: Final = re.compile(
    r"\*|BLK\s+FORM|TOOL\s+DEF|BEGIN\s+PGM|STOP\b|(?:M\s*0*(?:3|4|5|8|9|13|14)\s*)+$|CYCL\s+DEF\s+(?:9|32)\b"
    r"|(?:FN\s*(?:[0-8]|13)\s*:\s*)?Q[LRS]?\d+\s*="
)
"""Blocks that leave tool, centre and feed as they are."""
_TOOL: Final = re.compile(r"TOOL\s+CALL\b.*?\b([XYZ])\b")
_SCALE: Final = re.compile(r"CYCL\s+DEF\s+(?:11|26)\b")
_LEAST_TURN: Final = 1.0
_AMBIGUOUS: Final = 10.0
"""Angles [deg] within which of a half or a whole turn an arc hangs on the last digit of its radius."""


class KlartextCorners(CornerFollower[KlartextMove]):
    """Follows blocks in the plane of X and Y, and writes their corners out.

    Parameters
    ----------
    lines : sequence of str
        Of a program that runs from the first to the last, with plain numbers.

    Attributes
    ----------
    notes : dict of str to int
        Corners that stay as they are, and why, with the first line of each kind, from 1.
    """

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__()
        self._blocks = read_blocks(lines)
        self._pole: complex | None = None
        self._polar: tuple[float, float] | None = None
        self._last: tuple[int, KlartextMove] | None = None

    def _read_in(self, row: int) -> tuple[int, int]:
        block = self._blocks[row]
        return block.first, len(block.lines)

    def written(self) -> WrittenLines:
        """Return the lines, and which of those that were read each comes of."""
        for block in self._blocks:
            self._out.append(block.lines)
            if block.words.startswith("END PGM"):
                self._close("no move behind it")
                behind = block.first + len(block.lines)
                self._out += [one.lines for one in self._blocks if one.first >= behind]
                break
            if block.words:
                self._follow(len(self._out) - 1, block)
        return self._written()

    def _follow(self, index: int, block: KlartextBlock) -> None:
        corner = _CORNER.match(block.words)
        if corner is not None:
            self._close("no move behind it")
            if self._last is None:
                self._stays(corner[0], "the move before it is not known", index)
            else:
                row, before = self._last
                self._open = OpenCorner(
                    words=corner[0],
                    kind="radius" if corner[1] == "RND" else "legs",
                    size=tnc_value(corner[2]),
                    own_feed=corner[3] or "",
                    before=before,
                    move_row=row,
                    row=index,
                )
            self._last = None
            return
        move = None if block.slash else read_move(block)
        if move is not None and move.word != "CP":
            self._move(index, move)
            return
        center = _CENTER.match(block.words) is not None and not block.slash
        if not (center and _ABSOLUTE_CENTER.match(block.words)):
            self._close("no move behind it")
        self._last = None
        if center:
            self._pole, self._polar = self._center(block.words), None
        elif not _STILL.match(block.words):
            tool = _TOOL.match(block.words)
            self._plane = self._plane if tool is None else tool[1] == "Z"
            self._scaled |= _SCALE.match(block.words) is not None
            self._at, self._pole, self._feed, self._polar = {}, None, "", None

    def _center(self, words: str) -> complex | None:
        here = self._place()
        places: dict[str, float] = {}
        for step, axis, number in center_words(words):
            places[axis] = tnc_value(number) + (self._at.get(axis, math.nan) if step else 0.0)
        if not places:
            return here
        had = complex(math.nan, math.nan) if self._pole is None else self._pole
        found = complex(places.get("X", had.real), places.get("Y", had.imag))
        return None if "Z" in places or "Q" in words or math.isnan(abs(found)) else found

    def _move(self, index: int, move: KlartextMove) -> None:
        to = self._from_polar(move) if move.word == "LP" else None
        if {91, 92, 89, 99} & set(move.functions) or (to is None and {"PR", "PA"} & move.places.keys()):
            self._close("no move behind it")
            self._at, self._last, self._polar = {}, None, None
            return
        self._polar = to if to is not None or {"X", "Y"} & move.places.keys() or move.word != "L" else self._polar
        if to is not None:
            self._out[index] = move.block.with_words(move.text())
        ends = {axis: tnc_value(number) for axis, (_, number) in move.places.items()}
        way = self._go(ends, steps=[axis for axis, (step, _) in move.places.items() if step])
        if move.word == "CT":
            if self._open is not None or way is None or not self._tangential(move, *way):
                self._at, self._last = {}, None
                self._close("a tangential move behind it")
                return
            self._out[index] = move.block.with_words(move.text())
        elif way is not None and move.feed != "MAX":
            move.element = self._element(move, *way)
        if self._finish(move):
            self._out[index] = move.block.with_words(move.text())
        self._feed = self._feed if move.feed in ("", "MAX") else move.feed
        self._last = index, move

    def _tangential(self, move: KlartextMove, start: complex, end: complex) -> bool:
        """Write an arc that goes on in the direction of the move before it as one with a radius; False if it cannot."""
        before = None if self._last is None else self._last[1].element
        if before is None or not self._plane or move.feed == "MAX" or "Z" in move.places or move.functions:
            return False
        heading, way = before.heading(before.end), end - start
        turned = cmath.phase(way / heading) if way else 0.0
        swept = math.degrees(2.0 * abs(turned))
        if not (_LEAST_TURN <= swept <= 180.0 - _AMBIGUOUS or 180.0 + _AMBIGUOUS <= swept <= 360.0 - _AMBIGUOUS):
            return False
        left, radius = turned > 0.0, 0.5 * abs(way) / math.sin(abs(turned))
        center = start + heading * (1j if left else -1j) * radius
        move.word, move.sense = "CR", "+" if left else "-"
        move.radius = tnc_number(radius if swept < 180.0 else -radius, DECIMALS, sign=True)
        move.goes_to(end)
        move.element = Element(start=start, end=end, center=center, left=left) if swept < 180.0 else None
        return True

    def _from_polar(self, move: KlartextMove) -> tuple[float, float] | None:
        """Write an end by radius and angle [deg] about the pole as a place; None where that is not known."""
        had: dict[str, float] = {} if self._polar is None else dict(zip(("PR", "PA"), self._polar, strict=True))
        for name, (step, number) in move.places.items():
            if name in ("PR", "PA"):
                had[name] = tnc_value(number) + (had.get(name, math.nan) if step else 0.0)
        radius, angle = had.get("PR", math.nan), had.get("PA", math.nan)
        if self._pole is None or not self._plane or math.isnan(radius + angle) or {"X", "Y"} & move.places.keys():
            return None
        move.word = "L"
        move.places = {axis: place for axis, place in move.places.items() if axis == "Z"}
        move.goes_to(self._pole + cmath.rect(radius, math.radians(angle)))
        return radius, angle

    def _element(self, move: KlartextMove, start: complex, end: complex) -> Element | None:
        if move.word == "L":
            return None if start == end else Element(start=start, end=end)
        left = move.sense == "+"
        if not move.sense or start == end:
            return None
        if move.word == "CR":
            return arc_by_radius(start, end, tnc_value(move.radius) if move.radius else 0.0, left=left)
        return None if self._pole is None else Element(start=start, end=end, center=self._pole, left=left)

    def _write(self, opened: OpenCorner[KlartextMove], after: KlartextMove) -> None:
        before = opened.before
        if not set(before.functions) <= AT_THE_BEGIN or not set(after.functions) <= AT_THE_BEGIN | AT_THE_END:
            raise NotExpandableError("an M function beside it")
        found = self._cut(opened, after)
        before.goes_to(found.begin)
        self._out[opened.move_row] = before.block.with_words(before.text())
        corner = read_blocks(self._out[opened.row])[0]
        self._out[opened.row] = corner.with_words(_corner_text(found, opened.own_feed))
        assert after.element is not None
        after.goes_to(after.element.end)
        if opened.own_feed and not after.feed:
            after.feed = self._feed


def _corner_text(found: Corner, feed: str) -> str:
    x, y = (tnc_number(value, DECIMALS, sign=True) for value in (found.end.real, found.end.imag))
    text = f"L X{x} Y{y}"
    if found.radius:
        radius = tnc_number(found.radius, DECIMALS, sign=True)
        text = f"CR X{x} Y{y} R{radius} DR{'+' if found.left else '-'}"
    return f"{text} F{feed}" if feed else text
