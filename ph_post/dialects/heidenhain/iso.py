"""Heidenhain's ISO language, read as far as motion goes.

Followed are G00 to G03 with X, Y, Z under G90 and G91, the circle's centre I, J, K, which lasts and is
absolute, R, F, G29, G40 to G42, tools, M functions that are the same on every machine, G04 (dwell) and G62
(tolerance). Datum shifts and turned frames are noticed (G53, G54, G28, G72, G73, G80, G247). Everything else
is named and passed through, as in :mod:`ph_post.dialects.heidenhain.klartext`; so are moves by a mode that was set on
such a line.
"""

from __future__ import annotations

import re
from decimal import Decimal
from typing import Final

from ph_post.dialects.heidenhain.iso_table import ISO_WORD, PLAIN, IsoRows
from ph_post.dialects.heidenhain.tnc import (
    NotFollowed,
    Places,
    StaysInForce,
    Tnc,
    frame_change,
    frame_turns,
    joined,
    number_of,
    tips_in,
)
from ph_post.dialects.heidenhain.tnc_source import JUMPED, REPEATED, TncLanguage, TncSource
from ph_post.expand.klartext_lines import OWN_FEED
from ph_post.gcode.program import AXES, CENTERS, PLANE_AXES, PartProgram

_ANY: Final = re.compile("")
"""What may turn about the centre: I and J last."""
_IF: Final = r"D\s*(?:09|9|10|11|12)(?!\d)"
_CALL: Final = re.compile(rf"(?<![A-Z])L\s*Q?\w+\s*,\s*\d|{_IF}")
_CENTRES: Final = {letter: axis for axis, letter in CENTERS.items()}
_SIDES: Final = frozenset((40, 41, 42))
_CORNERS: Final = frozenset((24, 25, 26, 27))
_SHIFTS: Final = frozenset((53, 54, 247))
_TURNS: Final = frozenset((28, 72, 73, 80))
_MIRROR, _SCALING = 28, 72
_MOTIONS: Final = frozenset((0, 1, 2, 3))
_CUTS: Final = frozenset((5, 6, 7, 10, 11, 12, 13, 15, 16))
"""Arcs without a sense, tangential and polar moves: named."""
_TANGENTIAL: Final = frozenset((6, 16))
_FOLLOWED: Final = frozenset((4, 17, 18, 19, 29, 30, 31, 38, 40, 41, 42, 51, 62, 70, 71, 90, 91, 98, 99))


def _plain(line: str) -> str:
    """Return a line without its comment and the asterisk that ends it."""
    return re.sub(r"\s*\*\s*$", "", line.partition(";")[0].rstrip()).strip()


def in_force(line: str) -> StaysInForce:
    """Return what a block leaves in force, whatever else it does.

    The feed of a corner is its own. A block with a slash may be skipped.

    Examples
    --------
    >>> in_force("N10 G01 G41 X+5 YQ1 F300")[:2], in_force("/N20 G40 X+1")[:2]
    (('300', 'G41'), ('', None))
    """
    if line.startswith("/"):
        return in_force(line.lstrip("/ ")).if_skipped()
    text = re.sub(r"^N\s*\d+\s*", "", line)
    if frame_change(text) is not None:
        return StaysInForce(turns=frame_turns(text))
    block = _Block(OWN_FEED.sub(" ", text))
    codes = set(block.codes)
    feed = "" if codes & (_CORNERS | {4}) or block.value("F") in (None, "MAX") else block.value("F") or ""
    side = next((f"G{code}" for code in reversed(block.codes) if code in _SIDES), None)
    pole = any(letter in _CENTRES for letter, _ in block.words)
    turns = (*((f"G{code}", _turns_by(code, block)) for code in sorted(codes & _TURNS)), *tips_in(block.functions))
    return StaysInForce(feed, side, pole, turns)


_LANGUAGE: Final = TncLanguage(
    plain=_plain,
    head=re.compile(r"%\s*(\S+)\s+G(70|71)\s*\*?\s*$"),
    refusal="not an ISO program of Heidenhain",
    expected_head="%, a name, and G71 or G70",
    label=re.compile(r"G98\s*L\s*(\d+)"),
    calls={
        REPEATED: re.compile(r"(?<![A-Z])L\s*(\d+)\s*,\s*[1-9]"),
        JUMPED: re.compile(rf"{_IF}.*P03\s*(\+*(\S+))"),
    },
    called=re.compile(r"(?<![A-Z])L\s*(\d+)\s*,\s*0"),
    computed=re.compile(rf"{_IF}|(?<![A-Z])L\s*Q\w+\s*,"),
    ends=re.compile(r"G98\s*L\s*0(?!\d)"),
    in_force=in_force,
    rows=IsoRows,
)


def read_tnc_iso(
    data: bytes, name: str, *, contours: bool = False, resting: frozenset[int] = frozenset()
) -> PartProgram:
    """Read a program in Heidenhain's ISO language; `contours` as of `Language.contoured`.

    `resting` are M functions of the machine that move nothing.

    Raises
    ------
    InputError
        Where the text is no such program, or repeats a label that is not in it.
    """
    source = TncSource(data, name, _LANGUAGE)
    first, head = source.head()
    follower = _IsoFollower(Tnc("G21" if head[2] == "71" else "G20", in_force, _ANY, resting))
    for number, text in enumerate(source.texts):
        follower.line(text, source.left_by(number), begins=number == first)
    return source.program(follower.tnc, contours=contours)


def why_iso_stays(data: bytes) -> str:
    r"""Return why no line of a program can be changed, in words; empty where lines can be.

    Examples
    --------
    >>> why_iso_stays(b"%A G71 *\nN10 G91 X+5 *\n")
    'line 2 counts in increments (G91)'
    """
    for number, line in enumerate(data.splitlines(), 1):
        block = _Block(_plain(line.upper().decode("latin-1")))
        if 91 in block.codes:
            return f"line {number} counts in increments (G91)"
        letters = {letter for letter, _ in block.words}
        moves = bool(letters & {*AXES}) and not {*block.codes} & (_SHIFTS | _TURNS | {30, 31})
        if moves and (letters & {*_CENTRES} or ({*block.codes} & _FOLLOWED) - PLAIN):
            return f"line {number} moves, and has a centre or another G word besides"
    return ""


class _Block:
    """The words of one line, in order."""

    def __init__(self, source: str) -> None:
        bare = re.sub(r"^N\s*\d+", "", source).strip()
        self.words = [(letter, number) for letter, number in ISO_WORD.findall(bare)]
        self.codes, self.functions = self._plain("G"), self._plain("M")
        strange = [letter + text for letter, text in self.words if letter in "GM" and not text.isdecimal()]
        self.odd = ISO_WORD.sub("", bare).strip() or "".join(strange[:1])

    def _plain(self, letter: str) -> list[int]:
        return [int(number) for one, number in self.words if one == letter and number.isdecimal()]

    def value(self, letter: str) -> str | None:
        """Return the number of a word as it stands there, None where it does not."""
        return next((number for one, number in self.words if one == letter), None)

    def speed(self) -> str:
        """Return the word of the spindle's speed, empty where there is none, or a computed one."""
        given = self.value("S")
        number = None if given is None else number_of(given)
        return "" if number is None else f"S{number}"


def _turns_by(code: int, block: _Block) -> bool:
    """Return True if a word turns, mirrors, scales or tilts the frame, False if it ends that."""
    plain = Decimal(1) if code == _SCALING else Decimal(0)
    numbers = [number_of(number) for letter, number in block.words if letter not in "GN"]
    mirrors = code == _MIRROR and any(letter in AXES for letter, _ in block.words)
    return mirrors or any(number != plain for number in numbers)


class _IsoFollower:
    """Follows a program line by line."""

    def __init__(self, tnc: Tnc) -> None:
        self.tnc = tnc
        self._motion: int | None = None
        self._incremental: bool | None = False
        self._lost = False

    def line(self, source: str, left: StaysInForce | None, *, begins: bool) -> None:
        """Follow one line; `left` as of :meth:`TncSource.left_by`."""
        bare = re.sub(r"^N\s*\d+\s*", "", source)
        if _CALL.search(source) and "G98" not in source:
            self._lost = True
            self.tnc.lose("call or jump", bare, left)
        elif bare.startswith("%"):
            if begins:
                self.tnc.add("")
            elif re.match(r"N\s*9999", source):
                self.tnc.add("M2")
            else:
                self._lost, self._incremental = True, None
                self.tnc.lose("call of a program", bare)
        else:
            number, block = len(self.tnc.texts), _Block(source)
            self.tnc.line(source, lambda: self._translated(block, source))
            if _MOTIONS & set(block.codes):
                self._lost = number in self.tnc.remarks

    def _translated(self, block: _Block, source: str) -> str:
        codes = block.codes
        if _CORNERS & set(codes):
            self.tnc.corner(source)
        if _TANGENTIAL & set(codes):
            self.tnc.tangent(f"G{min(_TANGENTIAL & set(codes)):02d}")
        if source.startswith("/"):
            raise NotFollowed("block delete", source)
        change = self.tnc.frame(re.sub(r"^N\s*\d+\s*", "", source))
        if change is not None:
            return change
        if re.match(r"(?:N\s*\d+\s*)?D\s*\d+", source):
            raise NotFollowed("Q parameter", source)
        if {30, 31} & set(codes) or 98 in codes or 99 in codes:
            return ""
        self._states(codes)
        unknown = [code for code in codes if code not in _FOLLOWED | _MOTIONS | _SHIFTS | _TURNS]
        if unknown:
            if unknown[0] in _CUTS:
                self._motion = unknown[0]
            raise NotFollowed("path function" if unknown[0] in _CUTS else "unknown G word", f"G{unknown[0]:02d}")
        if block.odd:
            raise NotFollowed("unknown word", block.odd)
        return self._special(block) if {4, 38, 62} & set(codes) else self._followed(block, source)

    def _states(self, codes: list[int]) -> None:
        """Take the modes that a line sets."""
        for code in codes:
            if code in _MOTIONS:
                self._motion = code
            if code in _SIDES:
                self.tnc.side = f"G{code}"

    def _special(self, block: _Block) -> str:
        if 38 in block.codes:
            return "M0"
        if 62 in block.codes:
            return ""
        time = block.value("F")
        if time is None or number_of(time) is None:
            raise NotFollowed("dwell without a time", "G04")
        return f"G4 P{number_of(time)}"

    def _followed(self, block: _Block, source: str) -> str:
        """Follow a tool, a shift, a turn, a pole and a move, whichever a line has."""
        if block.value("T") is not None:
            return self._tool(block)
        places, centres = self._places(block)
        if (places or centres) and self._incremental is None:
            raise NotFollowed("move behind a program that may have ended in G90 or G91", source)
        if _SHIFTS & set(block.codes):
            return self.tnc.shifted()
        for code in sorted(_TURNS & set(block.codes)):
            return self.tnc.turned(f"G{code}", _turns_by(code, block))
        if 29 in block.codes:
            self.tnc.pole({})
        if centres:
            self.tnc.pole(centres)
        return self._move(block, places, source)

    def _places(self, block: _Block) -> tuple[Places, Places]:
        """Places of a line, and of its pole; G90 and G91 are for the words behind them."""
        places: Places = {}
        centres: Places = {}
        for letter, number in block.words:
            if letter == "G" and number.lstrip("0") in ("90", "91"):
                self._incremental = number.lstrip("0") == "91"
            elif letter in (*AXES, "A", "B", "C", "U", "V", "W"):
                places[letter] = bool(self._incremental), number_of(number)
            elif letter in _CENTRES:
                centres[_CENTRES[letter]] = bool(self._incremental), number_of(number)
        return places, centres

    def _move(self, block: _Block, places: Places, source: str) -> str:
        given = block.value("F")
        feed, rapid = "", self._motion == 0
        if given is not None:
            number = number_of(given)
            if given == "MAX":
                rapid = True
            elif number is None:
                raise NotFollowed("feed that is computed", f"F{given}")
            else:
                feed = f"F{number}"
        speed = block.speed()
        if places and self._motion not in _MOTIONS:
            raise NotFollowed("move in a mode that is not followed", source)
        explicit = {2, 3} & set(block.codes)
        lost = bool(places) and self._lost and not _MOTIONS & set(block.codes)
        if self._motion in (2, 3) and (places or explicit) and not lost:
            return joined(speed, self._arc(block, places, feed))
        why = f"move in a mode that was set on a line that is passed through: {source}" if lost else ""
        return joined(speed, self.tnc.straight(places, rapid=rapid, feed=feed, functions=block.functions, why=why))

    def _arc(self, block: _Block, places: Places, feed: str) -> str:
        given = block.value("R")
        radius = None if given is None else number_of(given)
        if given is not None and radius is None:
            raise NotFollowed("radius that is computed", f"R{given}")
        return self.tnc.arc(
            places,
            left=self._motion == 3,
            radius=radius,
            feed=feed,
            functions=block.functions,
        )

    def _tool(self, block: _Block) -> str:
        axis = next((AXES[PLANE_AXES[code][2]] for code in block.codes if code in PLANE_AXES), None)
        feed = block.value("F") or ""
        return self.tnc.tool(axis, block.value("T"), joined(block.speed(), self.tnc.feed_word(feed)))
