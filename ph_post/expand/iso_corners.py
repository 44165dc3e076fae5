"""Corners of Fanuc's (``,R ,C``) and Siemens's (RND, CHF, CHR) programs, written out as arcs and lines.

FANUC Series 30i/31i/32i-MODEL B, Operator's Manual for Machining Center System, B-64484EN-2, "Optional chamfering and
corner R": ``,C`` is the distance from the corner to where the chamfer begins and ends, ``,R`` the radius; the next
block moves in the plane too. SINUMERIK 840D sl / 828D, Programming Manual, Fundamentals, 6FC5398-1BP40-2BA0, "Chamfer,
rounding": CHF is the chamfer's own length, CHR its width in the direction of motion, FRC the feed of the corner alone;
whose feed it has otherwise is a setting.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

import msgspec

from ph_post.expand.corner_follower import CornerFollower, OpenCorner
from ph_post.expand.corners import Corner, Element, Kind, arc_by_radius
from ph_post.expand.faults import NotExpandableError
from ph_post.expand.macro import FanucNumbers, plain_value, word_text
from ph_post.expand.progress import WrittenLines
from ph_post.expand.sinumerik import calls_subprogram
from ph_post.expand.writing import number_text

_NUMBER: Final = r"([-+]?\s*(?:\d+\.?\d*|\.\d+))"
_FANUC: Final = re.compile(rf"\s*(,\s*[CR]|[A-Z])\s*{_NUMBER}")
_SIEMENS: Final = re.compile(rf"\s*(RNDM|RND|CHF|CHR|FRCM|FRC|CR|[A-Z])\s*(?:=\s*)?{_NUMBER}(?![\d=(])")
_LEAD: Final = re.compile(r"\s*(?:N\s*\d+\s*)?")
_KINDS: Final[dict[str, Kind]] = {",R": "radius", ",C": "legs", "RND": "radius", "CHR": "legs", "CHF": "length"}
_SHAPES: Final = frozenset(("X", "Y", "Z", "I", "J", "K", "R", "CR"))
_STILL: Final = frozenset((8.0, 9.0, 40.0, 41.0, 42.0, 60.0, 61.0, 64.0, 94.0, *(640.0 + n for n in range(1, 7))))
"""G words that leave all that is followed as it is."""
_STILL_ORDERS: Final = frozenset((0, 1, 3, 4, 5, 7, 8, 9))
_CALL: Final = re.compile(r"M\s*0*(?:9[78]|198)(?!\d)|G\s*65(?!\d)")
"""Calls of what is not followed here, which may leave other modes behind them."""
_SIEMENS_LEAD: Final = re.compile(r"\s*(/\d?)?\s*(?:[N:]\d+\s*)?(?:[A-Z_]\w+\s*:(?!=)\s*)?")
_CODE: Final = re.compile(r"(?<![A-Z_$=\d])G\s*0*(\d+)(?![\d.])")
_MODAL: Final = re.compile(r"\b(?:(MCALL)\b\s*(\S*)|(RNDM|FRCM)\s*=\s*(\S+))")
"""What is in force up to its own end: a subprogram behind each block, corners rounded behind each, and their feed."""
_OWN: Final = "subprogram"
"""Stands for that where a modal call is not of a cycle of the control, so that it may set any mode."""
_NOTHING: Final = re.compile(r"[-+]?0*\.?0*$")
_SCALE: Final = re.compile(r"\bA?SCALE\b")
_DECIMALS: Final = 6


class IsoMove(msgspec.Struct, kw_only=True):
    """A block that moves: what stands before and behind its words, these, and the motion that it makes.

    `wrote` is where it begins as that is written, rounded.
    """

    lead: str
    words: list[tuple[str, str]]
    tail: str
    mode: int
    absolute: bool
    element: Element | None = None
    wrote: complex | None = None

    @property
    def feed(self) -> str:
        """The number of its F word."""
        return self.number("F")

    def number(self, name: str) -> str:
        """Return the number of a word, empty where it has none."""
        return next((number for word, number in self.words if word == name), "")


class IsoCorners(CornerFollower[IsoMove]):
    """Follows blocks in the plane of X and Y, and writes their corners out.

    Parameters
    ----------
    lines : sequence of str
        Of a program that runs from the first to the last, with plain numbers.
    fanuc : FanucNumbers or None
        How a control of Fanuc counts; None for Siemens's language.

    Attributes
    ----------
    notes : dict of str to int
        Corners that stay as they are, and why, with the first line of each kind, from 1.
    """

    def __init__(self, lines: Sequence[str], fanuc: FanucNumbers | None) -> None:
        super().__init__()
        self._lines, self._fanuc = list(lines), fanuc
        self._mode: int | None = None
        self._absolute: bool | None = True
        self._units = 210
        self._modal = set[str]()

    def written(self) -> WrittenLines:
        """Return the lines, and which of those that were read each comes of."""
        ended = False
        for line in self._lines:
            self._out.append([line])
            bare = self._bare(line)
            if ended or not bare.strip() or bare.lstrip()[:1] in ("%", "O", ":"):
                continue
            ended = self._follow(line, bare)
        self._close("no move behind it")
        return self._written()

    def _bare(self, line: str) -> str:
        pattern = r";.*" if self._fanuc is None else r"\([^)]*\)?|;.*"
        return re.sub(pattern, lambda found: " " * len(found[0]), line).upper()

    def _follow(self, line: str, bare: str) -> bool:
        """Follow a line; return whether the program ends in it."""
        lead = _LEAD.match(bare)
        assert lead is not None
        at, words = lead.end(), list[tuple[str, str]]()
        pattern = _SIEMENS if self._fanuc is None else _FANUC
        while at < len(bare.rstrip()):
            found = pattern.match(bare, at)
            if found is None:
                self._scaled |= _SCALE.search(bare) is not None
                self._forget()
                self._lose_modes(bare)
                return False
            words.append((re.sub(r"\s", "", found[1]), re.sub(r"\s", "", found[2])))
            at = found.end()
        codes = {float(number) for name, number in words if name == "G"}
        orders = {float(number) for name, number in words if name == "M"}
        lost = {"L", "RNDM", "FRCM"} if self._fanuc is None else set[str]()
        if not self._modes(codes) or orders - _STILL_ORDERS or any(name in lost for name, _ in words):
            self._forget()
            self._lose_modes(bare)
            return bool(orders & {2, 17, 30, 99})
        moves = not codes & {4.0} and any(name in _SHAPES for name, _ in words)
        if moves and self._mode is not None and self._absolute is not None:
            move = IsoMove(
                lead=line[: lead.end()], words=words, tail=line[at:], mode=self._mode, absolute=self._absolute
            )
            self._move(move, still=bool(orders))
        else:
            self._close("no move behind it")
            self._take_feed(words)
            if moves and self._absolute is None:
                self._at = {}
        return False

    def _modes(self, codes: set[float]) -> bool:
        """Take modes; return False where a G word may change what is not followed."""
        for code in codes:
            if code in (0.0, 1.0, 2.0, 3.0):
                self._mode = int(code)
            elif code in (90.0, 91.0):
                self._absolute = code == 90.0
            elif code in (17.0, 18.0, 19.0):
                self._plane = code == 17.0
            elif code in (20.0, 21.0, 70.0, 71.0, 700.0, 710.0, 43.0, 49.0, *map(float, range(54, 60))):
                self._units = {20.0: 200, 21.0: 210}.get(code, self._units)
                self._at = {}
            elif code != 4.0 and code not in _STILL:
                self._scaled = {50.0: False, 51.0: True}.get(code, self._scaled)
                return False
        return True

    def _lose_modes(self, bare: str) -> None:
        """Know neither measure nor plane behind a line that calls, or may change them or not."""
        if self._fanuc is None:
            self._take_unread(bare)
        elif _CALL.search(bare) or "/" in bare:
            self._absolute, self._plane = None, False

    def _take_unread(self, bare: str) -> None:
        """Take in what a line of Siemens's sets that is not followed otherwise; with a slash it may run or not."""
        bare = re.sub(r'"[^"]*"', '""', bare)
        lead = _SIEMENS_LEAD.match(bare)
        slash, rest = (lead is not None and lead[1] is not None), bare[lead.end() if lead else 0 :].strip()
        for code in map(int, _CODE.findall(rest)):
            if code in (90, 91):
                self._absolute = (code == 90) if not slash or self._absolute is (code == 90) else None
            elif code in (17, 18, 19):
                self._plane = code == 17 and (self._plane or not slash)
        called = calls_subprogram(rest)
        for word, call, other, number in _MODAL.findall(rest):
            called |= word == "MCALL" and _OWN in self._modal
            if call or (other and not _NOTHING.match(number)):
                self._modal |= {word or other, *([_OWN] if calls_subprogram(call) else [])}
            elif not slash:
                self._modal -= {word or other, *([_OWN] if word else [])}
        if called:
            self._absolute, self._plane = None, False

    def _forget(self) -> None:
        self._close("no move behind it")
        self._at, self._mode, self._feed = {}, None, ""

    def _value(self, name: str, number: str) -> float:
        if self._fanuc is None:
            return float(number)
        return plain_value(name[-1].lower(), number.lstrip("+"), self._fanuc, self._units)

    def _text(self, name: str, value: float) -> str:
        if self._fanuc is None:
            return f"{name}{number_text(value, _DECIMALS)}"
        return word_text(name.lower(), value, self._fanuc.decimals + (self._units == 200))

    def _take_feed(self, words: list[tuple[str, str]]) -> None:
        self._feed = next((number for name, number in words if name == "F"), self._feed)

    def _move(self, move: IsoMove, *, still: bool) -> None:
        given = {name: self._value(name, number) for name, number in move.words if name not in ("N", "G", "M")}
        ends: dict[str, float] = {axis: given[axis] for axis in ("X", "Y", "Z") if axis in given}
        way = self._go(ends, steps=() if move.absolute else ends)
        if way is not None and not {"K", "A", "B", "C", "U", "V", "W", "P"} & given.keys():
            move.element = self._element(move, given, *way)
            move.wrote = way[0]
        self._finish(move)
        self._take_feed(move.words)
        kind = next((name for name in given if name in _KINDS), "")
        if kind:
            row = len(self._out) - 1
            self._open = OpenCorner(
                words=_joined(kind, next(number for name, number in move.words if name == kind)),
                kind=_KINDS[kind],
                size=given[kind],
                own_feed=move.number("FRC"),
                before=move,
                move_row=row,
                row=row,
            )
            if still:
                self._close("an M function beside it")

    def _element(self, move: IsoMove, given: dict[str, float], start: complex, end: complex) -> Element | None:
        if start == end or move.mode == 0:
            return None
        if move.mode == 1:
            return Element(start=start, end=end)
        left, radius = move.mode == 3, given.get("R", given.get("CR"))
        if radius is not None:
            return arc_by_radius(start, end, radius, left=left)
        center = start + complex(given.get("I", 0.0), given.get("J", 0.0))
        return Element(start=start, end=end, center=center, left=left)

    def _write(self, opened: OpenCorner[IsoMove], after: IsoMove) -> None:
        before = opened.before
        feed = before.feed or self._feed
        if "MCALL" in self._modal:
            raise NotExpandableError("a subprogram is called behind each block (MCALL)")
        if "RNDM" in self._modal:
            raise NotExpandableError("others are rounded as well (RNDM)")
        if "FRCM" in self._modal and not opened.own_feed:
            raise NotExpandableError("corners have a feed of their own (FRCM)")
        if self._fanuc is None and not opened.own_feed and after.feed not in ("", feed):
            raise NotExpandableError("the feed changes behind it, and a setting says which one it has")
        found = self._cut(opened, after)
        assert before.wrote is not None
        text, place = self._rewritten(before, before.wrote)
        corner, after.wrote = self._corner(before, found, place, opened.own_feed)
        self._out[opened.move_row][-1] = text
        if opened.own_feed and not after.feed:
            after.words.append(("F", feed))
        if not any(word == "G" and float(number) == after.mode for word, number in after.words):
            after.words.insert(0, ("G", str(after.mode)))
        self._out[-1] = [corner, self._rewritten(after, after.wrote, corner=True)[0]]

    def _ends(self, move: IsoMove, end: complex, wrote: complex) -> tuple[list[str], complex]:
        """Return the words of a place in the plane, and that place as it is written."""
        decimals = _DECIMALS if self._fanuc is None else self._fanuc.decimals + (self._units == 200)
        rounded = complex(round(end.real, decimals), round(end.imag, decimals))
        way = rounded - (0.0 if move.absolute else wrote)
        return [self._text("X", way.real), self._text("Y", way.imag)], rounded

    def _rewritten(self, move: IsoMove, wrote: complex, *, corner: bool = False) -> tuple[str, complex]:
        """Return the line of a move whose ends are others, and where it ends; it keeps its own `corner` word or not."""
        assert move.element is not None
        ends, place = self._ends(move, move.element.end, wrote)
        dropped = {"X", "Y", "I", "J"} | (set() if corner else {*_KINDS, "FRC"})
        radius = any(name in ("R", "CR") for name, _ in move.words)
        if move.element.center is not None and not radius:
            away = move.element.center - wrote
            ends += [self._text("I", away.real), self._text("J", away.imag)]
        first = [f"G{number}" for name, number in move.words if name == "G"]
        rest = [_joined(name, number) for name, number in move.words if name not in dropped and name != "G"]
        return move.lead + " ".join([*first, *ends, *rest]) + move.tail, place

    def _corner(self, before: IsoMove, found: Corner, wrote: complex, feed: str) -> tuple[str, complex]:
        ends, place = self._ends(before, found.end, wrote)
        word = "G1"
        if found.radius:
            word = "G3" if found.left else "G2"
            ends.append(f"CR={self._text('', found.radius)}" if self._fanuc is None else self._text("R", found.radius))
        return " ".join([word, *ends, *([f"F{feed}"] if feed else [])]), place


def _joined(name: str, number: str) -> str:
    return f"{name}={number}" if len(name) > 1 and name[0] != "," else f"{name}{number}"
