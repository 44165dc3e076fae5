"""Heidenhain's conversational language, read as far as motion goes.

Followed are L, CC, C, CR with X, Y, Z and their increments (IX), CP with PA or IPA, F, FMAX, a Q parameter that is set
to a number as a feed, R0, RL, RR, TOOL CALL, STOP, M functions that are the same on every machine, cycles 9 (dwell)
and 32 (tolerance), and definitions of cycles that are called, which move nothing; datum shifts and turned frames are
noticed (cycles 7, 8, 10, 11, 19, 26, 247, PLANE). Everything else is named and passed through: tangential arcs, other
polar coordinates, free contours, roundings and chamfers (with the move before them, whose end they cut off), other Q
parameters, calls of cycles and labels, moves behind M89, which calls a cycle at each, and what a jump or a
repeat may run twice. What the words mean stands in :mod:`ph_post.dialects.heidenhain.dialect`.
"""

from __future__ import annotations

import re
from decimal import Decimal
from typing import Final

from ph_post.dialects.heidenhain.table import KlartextRows
from ph_post.dialects.heidenhain.tnc import (
    FUNCTION,
    NUMBER,
    NotFollowed,
    Places,
    StaysInForce,
    Tnc,
    Turns,
    frame_turns,
    joined,
    number_of,
    tips_in,
)
from ph_post.dialects.heidenhain.tnc_source import JUMPED, REPEATED, TncLanguage, TncSource
from ph_post.dialects.reading import Remark
from ph_post.expand.klartext_lines import OWN_FEED, SIDE
from ph_post.gcode.program import PartProgram

_PLACE: Final = re.compile(rf"(?<![A-Z])(I?)([XYZABCUVW])\s*({NUMBER}|[-+]?Q[LRS]?\d+)")
_FEED: Final = re.compile(rf"F\s*(MAX|AUTO|[ZTU]?\s*{NUMBER}|[ZTU]?\s*Q[LRS]?\d+)?")
_SIDES: Final = {"0": "G40", "L": "G41", "R": "G42"}
_PATH: Final = re.compile(r"(?!LBL|CALL|CYCL|CHF|CC(?![A-Z]))(?:L|C|F[LC]|APPR|DEP|SPL)")
"""A block of a path."""
_SPACE: Final = re.compile(r"[RFM](?=\s|$)|\s+")
_RADIUS: Final = re.compile(rf"R\s*({NUMBER}|[-+]?Q[LRS]?\d+)")
_ANGLE: Final = re.compile(rf"(I?)PA\s*({NUMBER}|[-+]?Q[LRS]?\d+)")
_SET: Final = re.compile(rf"(?:FN\s*0\s*:\s*)?(Q[LRS]?\d+)\s*=\s*({NUMBER})\s*")
_VALUE: Final = re.compile(r"Q[LRS]?\d+\s*=")
_STILL: Final = re.compile(r"FN\s*(?:[0-8]|13|15|16|18)\s*:")
"""Functions that compute, read or print, and move nothing."""
_NAMED: Final = {"18": "value that only the machine knows", "15": "output", "16": "output"}
_SENSE: Final = re.compile(r"DR\s*([-+])")
_CYCLE: Final = re.compile(r"CYCL\s+DEF\s+(\d+)(?:\.(\d+))?(.*)")
_LAST_NUMBER: Final = re.compile(rf"({NUMBER})\s*$")
_TOOL: Final = re.compile(r"TOOL\s+CALL\b\s*(\"[^\"]*\"|Q[LRS]?\d+|\d+(?:\.\d+)?)?\s*([XYZ])?(.*)")
_QUIET: Final = ("BLK FORM", "TOOL DEF", "BEGIN PGM")
_TURNS: Final = frozenset((8, 10, 11, 19, 26))
_SHIFTS: Final = frozenset((7, 247))
_CALLED: Final = frozenset((*range(1, 7), 17, 18, *range(200, 210), 240, 241, *range(251, 255), *range(262, 268)))
"""Cycles that move when they are called, and not where they are defined."""
_OTHERS: Final = re.compile(r"CTP|CT|LP|LCT|LN|FPOL|FLT|FL|FCT|FC|APPR|DEP|SPL")
_RETRACTION: Final = re.compile(r"M\s*140\s+MB\s*MAX(?![A-Z])")
"""Back along the tool's axis to the end of its travel (iTNC 530, User's Manual, Conversational, 7, "Retraction from the
contour in the tool-axis direction"); by a length it may have a feed of its own."""
_TANGENTIAL: Final = re.compile(r"CTP?$|FCT$|FLT$|DEP$")


def in_force(line: str) -> StaysInForce:
    """Return what a block leaves in force, whatever else it does.

    DEP ends the compensation of the radius (iTNC 530, User's Manual, Conversational, 6.3, "Approaching and departing").
    A block with a slash may be skipped: it may change the feed, bring the cutter to a side, and turn the frame.

    Examples
    --------
    >>> in_force("APPR LT X+5 Y+5 LEN10 RL F300")[:2], in_force("DEP LT LEN10 F1000")[:2], in_force("RND R5 F100")[:2]
    (('300', 'G41'), ('1000', 'G40'), ('', None))
    """
    text = re.sub(r"\"[^\"]*\"", " ", line.lstrip("/ "))
    if line.startswith("/"):
        found, tool = in_force(text).if_skipped(), _TOOL.match(text)
        other = tool is not None and tool[2] not in (None, "Z")
        return found._replace(turns=(*found.turns, ("TOOL CALL", True))) if other else found
    path, turns = _PATH.match(text), _turns(text)
    if path is None and _TOOL.match(text) is None:
        return StaysInForce(pole=re.match(r"CC(?![A-Z])", text) is not None, turns=turns)
    bare = FUNCTION.sub(" ", _FEED.sub(" ", text))
    sides = [_SIDES[side] for side in SIDE.findall(bare) if path] or ["G40"] * text.startswith("DEP")
    return StaysInForce(_last_feed(OWN_FEED.sub(" ", text)), sides[-1] if sides else None, turns=turns)


def _last_feed(text: str) -> str:
    """Return the last feed of a text that is no rapid traverse, empty where it has none."""
    feeds = [found[1] for found in _FEED.finditer(text) if found[1] not in (None, "MAX")]
    return feeds[-1] if feeds else ""


def _turns(text: str) -> Turns:
    """Return how a block turns the frame, or ends that."""
    found, cycle = list(frame_turns(text)), _CYCLE.match(text)
    if cycle is not None and int(cycle[1]) in _TURNS:
        found.append((f"cycle {int(cycle[1])}", _turns_by(int(cycle[1]), cycle[2], cycle[3])))
    return (*found, *tips_in(map(int, FUNCTION.findall(text))))


def _turns_by(number: int, part: str | None, rest: str) -> bool:
    """Return True if a cycle turns the frame, False if it ends that."""
    if part in (None, "0"):
        return True
    numbers = [number_of(found) for found in re.findall(NUMBER, rest)]
    plain = Decimal(1) if number in (11, 26) else Decimal(0)
    return "Q" in rest or bool(re.search(r"[XYZ]", rest)) or any(value != plain for value in numbers)


def _plain(line: str) -> str:
    """Return a line without its number and its comment."""
    text = re.sub(r"^\s*\d+(?=\s|$)", "", line)
    return text.partition(";")[0].replace("~", " ").strip()


_NAME: Final = r"(\"[^\"]*\"|Q[LRS]?\d+|\d+)"
"""Of a label; one by a parameter is computed."""

_LANGUAGE: Final = TncLanguage(
    plain=_plain,
    head=re.compile(r"BEGIN\s+PGM\s+(.*?)\s*(MM|INCH|IN$)"),
    refusal="not a conversational program",
    expected_head="0 BEGIN PGM, a name, and MM or INCH",
    label=re.compile(r"^LBL\s*(\"[^\"]*\"|\d+)"),
    calls={
        REPEATED: re.compile(rf"^/?\s*CALL\s+LBL\s*{_NAME}\s+REP\s*[\dQ]"),
        JUMPED: re.compile(r"GOTO\s+LBL\s*(\S+)"),
    },
    called=re.compile(r"^/?\s*CALL\s+LBL\s*(\"[^\"]*\"|\d+)(?:\s+REP)?$"),
    computed=re.compile(r"CALL\s+LBL|GOTO\s+LBL"),
    ends=re.compile(r"^LBL\s*0$"),
    in_force=in_force,
    rows=KlartextRows,
)


_FLOW: Final = re.compile(r"/?\s*(?:CALL\s+LBL|FN\s*\d+\s*:\s*IF)")
_PROGRAMS: Final = re.compile(r"/?\s*(?:CALL\s+(?:SELECTED\s+)?PGM|SEL\s|%)")
_CYCLE_CALL: Final = re.compile(r"CYCL\s+CALL|(?<![A-Z])M\s*0*(?:89|99)(?!\d)")
_PROGRAM_CYCLE: Final = 12
"""The cycle that is a program, which CYCL CALL calls (TNC 620, User's Manual for Cycle Programming, 12)."""

_MOVES: Final = re.compile(r"L\s+I?[XYZ]")
"""A move: text with one is conversational, if perhaps a part of a program that says elsewhere whether it is in mm."""


def read_klartext(
    data: bytes, name: str, *, contours: bool = False, resting: frozenset[int] = frozenset()
) -> PartProgram:
    """Read a conversational program; `contours` as of :meth:`~ph_post.gcode.language.Language.contoured`.

    `resting` are M functions of the machine that move nothing.

    Raises
    ------
    InputError
        Where the text is no such program.
    """
    source = TncSource(data, name, _LANGUAGE)
    if any(_MOVES.match(text) for text in source.texts) and not any(map(_LANGUAGE.head.match, source.texts)):
        begin, units = len(source.texts), "MM"
    else:
        begin, head = source.head()
        units = head[2]
    follower = _KlartextFollower(Tnc("G21" if units == "MM" else "G20", in_force, resting=resting))
    for text in source.texts[:begin]:
        if text:
            follower.tnc.lose("outside BEGIN PGM and END PGM", "")
        else:
            follower.tnc.add("")
    for number in range(begin, len(source.texts)):
        follower.line(source.texts[number], source.left_by(number))
    return source.program(follower.tnc, contours=contours)


class _KlartextFollower:
    """Follows a program line by line."""

    def __init__(self, tnc: Tnc) -> None:
        self.tnc = tnc
        self._remark = ""
        self._values = self._program = False

    def line(self, source: str, left: StaysInForce | None) -> None:
        """Follow one line; `left` as of :meth:`TncSource.left_by`."""
        programs = _PROGRAMS.match(source) or (self._program and _CYCLE_CALL.search(source))
        if programs or _FLOW.match(source):
            self.tnc.lose("missing program" if programs else "call or jump", source, left)
            return
        self.tnc.line(source, lambda: self._translated(source))

    def _translated(self, source: str) -> str:
        for found in re.finditer(r"(Q[LRS]?\d+)\s*=", source):
            self.tnc.parameters.pop(found[1], None)
        cycle = _CYCLE.match(source)
        if cycle is not None:
            self._values = int(cycle[1]) in _CALLED
            return self._cycle(int(cycle[1]), cycle[2], cycle[3], source)
        self._values = self._values and bool(_VALUE.match(source))
        if self._sets(source) or not source or source.startswith(("*", *_QUIET)) or re.match(r"LBL\s*[\d\"]", source):
            return ""
        if source.startswith("END PGM"):
            return "M2"
        word = source.split(maxsplit=1)[0]
        if word == "L" or re.match(r"L(?=[IXYZ][-+\d.XYZ])", source):
            return self._straight(source[1:])
        if word in ("C", "CR", "CC", "CP"):
            return self._polar(source) if word == "CP" else self._curve(word, source[len(word) :])
        return self._other(word, source)

    def _sets(self, source: str) -> bool:
        """Take the number that a Q parameter is set to; return False where a line sets none."""
        given = _SET.fullmatch(source)
        if given is not None and (source.startswith("FN") or not self._remark):
            self.tnc.parameters[given[1]] = Decimal(given[2].replace(",", "."))
            return True
        if self._values:
            return True
        if _STILL.match(source) or (_VALUE.match(source) and not self._remark):
            number = re.match(r"FN\s*(\d+)", source)
            what = _NAMED.get(number[1] if number else "", "Q parameter")
            self.tnc.remarks[len(self.tnc.texts)] = Remark(what=f"{what}: {source}")
            return True
        if _VALUE.match(source):
            # parameters of a cycle stand on lines of their own; the cycle has its note already
            raise NotFollowed(self._remark or "Q parameter", source)
        return False

    def _other(self, word: str, source: str) -> str:
        tool = _TOOL.match(source)
        if tool is not None:
            return self._tool(tool[1], tool[2], tool[3])
        bare = source.lstrip("/ ")
        if re.match(r"(?:RND|CHF)(?![A-Z])", bare):
            self.tnc.corner(source)
        change = self.tnc.frame(source)
        if change is not None:
            return change
        if word == "STOP" or re.fullmatch(r"(?:M\s*\d+\s*)+", source):
            functions = [int(number) for number in FUNCTION.findall(source)]
            text = self.tnc.straight({}, rapid=False, feed="", functions=functions)
            return joined("M0" if word == "STOP" else "", text)
        if _TANGENTIAL.match(bare.split(maxsplit=1)[0] if bare else ""):
            self.tnc.tangent(source)
        if not _PATH.match(bare):
            self.tnc.parameters.clear()
        what = "path function" if _OTHERS.fullmatch(word) else "block delete" if word[0] == "/" else "unknown word"
        raise NotFollowed(what, source)

    def _straight(self, text: str) -> str:
        if _RETRACTION.search(text):
            return self._retracted(_RETRACTION.sub(" ", text))
        rest, places = self._places(text)
        rest, feed, rapid = self._feed(rest)
        rest, functions = self._functions(rest)
        rest = self._side(rest)
        self._nothing_left(rest)
        return self.tnc.straight(places, rapid=rapid, feed=feed, functions=functions)

    def _retracted(self, text: str) -> str:
        """Take the tool to the end of its axis, which is in the machine's coordinates."""
        rest, functions = self._functions(text)
        self._nothing_left(rest)
        end: Places = {self.tnc.tool_axis: (False, Decimal(0))}
        return self.tnc.straight(end, rapid=True, feed="", functions=[*functions, 91])

    def _curve(self, word: str, text: str) -> str:
        rest, places = self._places(text)
        if word == "CC":
            self._nothing_left(rest)
            return self.tnc.pole(places)
        sense = _SENSE.search(rest)
        if sense is None:
            raise NotFollowed("arc without a sense", text.strip())
        rest, radius = _SENSE.sub(" ", rest), None
        if word == "CR":
            found = _RADIUS.search(rest)
            if found is None or (radius := number_of(found[1])) is None:
                raise NotFollowed("radius that is missing or computed", text.strip())
            rest = rest.replace(found[0], " ", 1)
        rest, feed, rapid = self._feed(rest)
        if rapid:
            raise NotFollowed("arc at rapid traverse", text.strip())
        rest, functions = self._functions(rest)
        rest = self._side(rest)
        self._nothing_left(rest)
        return self.tnc.arc(places, left=sense[1] == "+", radius=radius, feed=feed, functions=functions)

    def _polar(self, source: str) -> str:
        rest, places = self._places(source[len("CP") :])
        angle, sense = _ANGLE.search(rest), _SENSE.search(rest)
        number = None if angle is None else number_of(angle[2])
        if angle is None or number is None or sense is None:
            raise NotFollowed("path function", source)
        rest, feed, rapid = self._feed(_SENSE.sub(" ", _ANGLE.sub(" ", rest)))
        rest, functions = self._functions(rest)
        rest = self._side(rest)
        self._nothing_left(rest)
        if rapid:
            raise NotFollowed("arc at rapid traverse", source)
        left = sense[1] == "+"
        return self.tnc.polar(places, number, steps=bool(angle[1]), left=left, feed=feed, functions=functions)

    @staticmethod
    def _places(text: str) -> tuple[str, Places]:
        places: Places = {}
        for incremental, axis, number in _PLACE.findall(text):
            if axis in places:
                raise NotFollowed("the same axis twice", axis + number)
            places[axis] = bool(incremental), number_of(number)
        return _PLACE.sub(" ", text), places

    def _feed(self, text: str) -> tuple[str, str, bool]:
        """Take the feed out of a line: what is left, its F word, and whether it is a rapid."""
        found = _FEED.search(text)
        if found is None or found[1] is None:
            return _FEED.sub(" ", text), "", False
        rest = _FEED.sub(" ", text, count=1)
        if found[1] == "MAX":
            return rest, "", True
        number = None if found[1][0] in "AZTU" else number_of(found[1])
        if number is None and found[1] in self.tnc.parameters:
            number = self.tnc.feeds[len(self.tnc.texts)] = self.tnc.parameters[found[1]]
        if number is None:
            raise NotFollowed("feed by the tool, or computed", found[0])
        return rest, f"F{number}", False

    @staticmethod
    def _functions(text: str) -> tuple[str, list[int]]:
        return FUNCTION.sub(" ", text), [int(number) for number in FUNCTION.findall(text)]

    def _side(self, text: str) -> str:
        """Take the radius compensation out of a line."""
        found = SIDE.search(text)
        if found is not None:
            self.tnc.side = _SIDES[found[1]]
        return SIDE.sub(" ", text)

    @staticmethod
    def _nothing_left(text: str) -> None:
        left = _SPACE.sub("", text)
        if left:
            raise NotFollowed("unknown word", left)

    def _cycle(self, number: int, part: str | None, rest: str, source: str) -> str:
        """Follow the definition of a cycle."""
        self._remark = ""
        self._program = number == _PROGRAM_CYCLE or (self._program and number not in _CALLED)
        last = _LAST_NUMBER.search(rest)
        if number == 9:
            if part in (None, "0"):
                return ""
            time = None if last is None else number_of(last[1])
            if time is None:
                raise NotFollowed("dwell without a time", source)
            return f"G4 P{time}"
        if number == 32 or number in _CALLED:
            return ""
        if number in _SHIFTS:
            self._remark = "datum"
            return self.tnc.shifted()
        if number in _TURNS:
            steps = re.search(r"I\s*ROT", rest) is not None  # which add nothing where they are 0
            way, on = f"cycle {number}", _turns_by(number, part, rest)
            return self.tnc.turned(way, on or (steps and self.tnc.is_turned(way)))
        self._remark = "cycle"
        self.tnc.parameters.clear()
        raise NotFollowed("cycle", source)

    def _tool(self, number: str | None, axis: str | None, rest: str) -> str:
        speed = re.search(rf"S\s*({NUMBER})", rest)
        turns = f"S{number_of(speed[1])}" if speed else ""
        return self.tnc.tool(axis, number, joined(turns, self.tnc.feed_word(_last_feed(rest))))
