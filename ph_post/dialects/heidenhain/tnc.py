"""The part that both languages of Heidenhain's TNC share: translation to RS274 lines.

Each line becomes one line; places are written absolutely.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from decimal import Decimal
from typing import Final, NamedTuple

from ph_post.dialects.reading import FORGOTTEN, NOT_UNDERSTOOD, Remark
from ph_post.gcode.program import AXES, CENTERS, PLANE_AXES

NUMBER: Final = r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)"
"""A number, with a point or a comma."""

PLANES: Final[Mapping[str, tuple[str, str]]] = {AXES[c]: (AXES[a], AXES[b]) for a, b, c in PLANE_AXES.values()}
"""Axes of the working plane, by the tool's axis."""

_PLANE_WORDS: Final[Mapping[str, str]] = {AXES[c]: f"G{number}" for number, (_, _, c) in PLANE_AXES.items()}
_FUNCTIONS: Final[Mapping[int, str]] = {
    0: "M0",
    1: "M1",
    2: "M2",
    3: "M3",
    4: "M4",
    5: "M5",
    6: "M6",
    8: "M8",
    9: "M9",
    13: "M3 M8",
    14: "M4 M8",
    19: "M19",
    30: "M30",
}
_RESTING: Final = frozenset((90, 94, 107, 108, 111, 116, 117, 126, 127, 134, 135, 138, 141, 148, 149))
"""M functions that move nothing, and change neither where X, Y and Z go nor F along their way (iTNC 530, User's Manual,
Conversational, 7 and 11, "Miscellaneous Functions"; TNC 640, 11): the speed in corners (M90), the display of rotary
axes (M94), their feed (M116,
M117), their way round (M126, M127) and which of them swivel (M138), spare tools that are too large (M107, M108), F at
the tool's centre again (M111), stops where rotary axes turn (M134, M135), the touch probe (M141), and what happens at
a stop (M148, M149)."""

_TIPS: Final[Mapping[int, int]] = {128: 129, 114: 115, 144: 145}
"""M functions with which X, Y and Z may be those of a table that has turned, and those that end them: rotary axes about
the tool's tip, corrected for them, and the kinematics in the positions (iTNC 530, Conversational, 11)."""
FUNCTION: Final = re.compile(r"(?<!PG)M\s*(\d{1,4})(?!\d)")
"""An M function, and not the number of a program (CALL PGM 128)."""
_FEEDS_A_TURN: Final[Mapping[int, str]] = {136: "G95", 137: "G94"}

_WHOLE: Final = 1e-9
"""Angles [rad] that differ from whole turns by less are whole turns."""

_MACHINE: Final = frozenset((91, 92))
"""M functions with which the positions of a block are the machine's."""
KLARTEXT_POLAR: Final = re.compile(r"/?\s*(?:C?[CLT]P\b|C\b|(?:APPR|DEP)\s+P)")
"""What uses the pole in conversational programs."""

_MOVES: Final = re.compile(r"(?:^| )G[0-3] ")
"""A translated line that moves."""

_FEED_WORD: Final = re.compile(r"(?<!\S)F\S+")

_STEP: Final[Mapping[str, Decimal]] = {"G21": Decimal("0.0001"), "G20": Decimal("0.00001")}
"""Ends that follow from angles are rounded to what a program can say: blocks behind them name the same places."""

UNKNOWN_FEED: Final = "F#1"
"""A feed that only the control knows, in RS274."""

_CALLS: Final = frozenset((89, 99))
_MODAL_CALL: Final = re.compile(r"M\s*0*89(?!\d)")
"""What calls a cycle at each move behind it, whatever else is in its block."""

_PLANE_UPRIGHT: Final = re.compile(
    r"PLANE\s+(?:RESET\b|SPATIAL\s+(?:SP[ABC]\s*[-+]?0*\.?0*(?![\d.])\s*){3}.*\bTABLE\s+ROT\b)"
)
"""A plane that is the machine's. Spatial angles, of which none turns it, are those from the machine's fixed coordinates
(iTNC 530, User's Manual, "PLANE SPATIAL"). The table is free then to turn about the tool: with TABLE ROT it goes to the
angle that is said, and X and Y are the axes; with COORD ROT, on some controls, they turn with the table (TNC7, "COORD
ROT and TABLE ROT")."""
_TCPM: Final = re.compile(r"FUNCTION\s+(RESET\s+)?TCPM\b")
"""Rotary axes about the tool's tip, as M128 has them (TNC 640, User's Manual, Conversational, 12, "FUNCTION TCPM")."""
_TRANS: Final = re.compile(r"TRANS\s+(DATUM|ROTATION|MIRROR|SCALE)\b(.*\bRESET\b)?")
"""Shifts and turns of the frame (TNC7, User's Manual, Programming, "Functions for coordinate transformation")."""
_PARALLEL: Final = re.compile(r"FUNCTION\s+(PARAXMODE|PARAXCOMP(?!.*\bDISPLAY\b))\b(.*\bOFF\b)?")
"""Parallel axes in the place of X, Y and Z, or with them (TNC 640, User's Manual, "FUNCTION PARAXMODE")."""
_DATUM: Final = "DATUM"


Turns = tuple[tuple[str, bool], ...]
"""Ways in which the frame is turned, mirrored, scaled or tilted, and whether it is so or no longer."""


def frame_change(text: str) -> tuple[str, bool] | None:
    """Return which way a block changes the frame, and whether it turns it or ends that; None where it does neither.

    Examples
    --------
    >>> frame_change("PLANE RESET STAY"), frame_change("TRANS ROTATION ROT+45"), frame_change("L X+5")
    (('PLANE', False), ('TRANS ROTATION', True), None)
    """
    if re.match(r"PLANE\b", text):
        return "PLANE", _PLANE_UPRIGHT.match(text) is None
    if tip := _TCPM.match(text):
        return "TCPM", tip[1] is None
    if parallel := _PARALLEL.match(text):
        return parallel[1], parallel[2] is None
    if trans := _TRANS.match(text):
        return (_DATUM, True) if trans[1] == _DATUM else (f"TRANS {trans[1]}", trans[2] is None)
    return None


def frame_turns(text: str) -> Turns:
    """Return how a block turns the frame, or ends that; a shift of the datum does neither."""
    change = frame_change(text)
    return () if change is None or change[0] == _DATUM else (change,)


Places = dict[str, tuple[bool, Decimal | None]]
"""By axis: whether it is incremental, and the number, None where that is computed."""


class StaysInForce(NamedTuple):
    """What a block leaves in force, whatever else is in it, or a call.

    Its feed as it stands there, empty for none; the word of the side on which the cutter is (G40, G41 or G42), None
    where it says none; whether it names a circle's centre; and the ways in which it turns the frame, or ends that.
    """

    feed: str = ""
    side: str | None = None
    pole: bool = False
    turns: Turns = ()

    def if_skipped(self) -> StaysInForce:
        """Return what it leaves in force where it may not run: an unknown feed, and an end of neither side nor turn."""
        feed, side = "AUTO" if self.feed else "", None if self.side == "G40" else self.side
        return StaysInForce(feed, side, self.pole, tuple((way, on) for way, on in self.turns if on))


def tips_in(functions: Iterable[int]) -> Turns:
    """Return how M functions let X, Y and Z be those of a table that has turned, or end that.

    Examples
    --------
    >>> tips_in([3, 129])
    (('M128', False),)
    """
    own = {number: (f"M{begins}", number == begins) for begins, ends in _TIPS.items() for number in (begins, ends)}
    return tuple(own[number] for number in functions if number in own)


class NotFollowed(Exception):  # noqa: N818 - nothing is wrong with the program
    """Something that is not understood: what, and the text that says so."""

    def __init__(self, what: str, text: str = "") -> None:
        super().__init__(f"{what}: {text}" if text else what)
        self.text = text


def number_of(text: str) -> Decimal | None:
    """Read a number with a point or a comma, None of one that is computed, and of MAX.

    Examples
    --------
    >>> number_of("+5,5"), number_of("-Q3")
    (Decimal('5.5'), None)
    """
    return None if "Q" in text or text == "MAX" else Decimal(text.replace(",", "."))


def joined(*words: str) -> str:
    """Put words into a line; empty ones are left out."""
    return " ".join(word for word in words if word)


class Tnc:
    """The state of the control while a program is followed, and the RS274 lines that it comes to.

    Parameters
    ----------
    units : str
        G20 or G21.
    in_force : callable
        ``in_force(line)``: what a line that is passed through leaves in force.
    polar : pattern
        What may use the pole, of what is passed through.
    resting : frozenset of int
        M functions of the machine that move nothing.

    Attributes
    ----------
    texts : list of str
        A line for each line of the program.
    remarks : dict
        What is not understood, by line.
    poles : dict
        Centres that lines set.
    arcs, users : dict
        By the line of an arc, and of what is passed through and uses the centre too, the line that sets it.
    parameters : dict
        Q parameters that have a number.
    feeds : dict
        By line the feed that a parameter gives it.
    side : str
        G40, or G41 or G42 where the cutter is beside the contour.
    """

    def __init__(
        self,
        units: str,
        in_force: Callable[[str], StaysInForce],
        polar: re.Pattern[str] = KLARTEXT_POLAR,
        resting: frozenset[int] = frozenset(),
    ) -> None:
        self._in_force, self._polar, self._resting = in_force, polar, _RESTING | resting
        self.texts: list[str] = []
        self.remarks: dict[int, Remark] = {}
        self.tool_axis = "Z"
        self._units = units
        # F counts tenths of an inch a minute in programs in inches, and is taken for unknown there, as one a turn is.
        self._feeds = "G94" if units == "G21" else "G95"
        self._at: dict[str, Decimal | None] = dict.fromkeys(AXES)
        self._pole: dict[str, Decimal | None] = dict.fromkeys(AXES)
        self._turned: set[str] = set()
        self._moved: int | None = None
        self._pole_line: int | None = None
        self._pole_axes: tuple[str, ...] = ()
        self._plane_word = ""
        self.parameters: dict[str, Decimal] = {}
        self.feeds: dict[int, Decimal] = {}
        self._cut = False
        self._called = False
        self._plane_moved = 0
        self.poles: dict[int, tuple[float | None, ...]] = {}
        self.arcs: dict[int, int] = {}
        self.users: dict[int, int] = {}
        self._states: list[str] = []
        self.side = "G40"
        self._frame = ""
        self._ended = False

    def line(self, source: str, follow: Callable[[], str]) -> None:
        """Follow a line; what is not understood gets a note, and the position is forgotten."""
        try:
            text = follow()
        except NotFollowed as found:
            self.forget(AXES)
            self._called = self._called or _MODAL_CALL.search(source) is not None
            if self._pole_line is not None and self._polar.match(source):
                self.arcs.pop(len(self.texts), None)
                self.users[len(self.texts)] = self._pole_line
            column = source.find(found.text) + 1 if found.text else 1
            self.remarks[len(self.texts)] = Remark(what=str(found), column=max(column, 1))
            feed = self._left_in_force(source)
            text = joined(feed, self._frame, FORGOTTEN)
        self._frame = ""
        self.add(text)

    def _left_in_force(self, source: str) -> str:
        """Take the side that a line leaves in force which is passed through, and return the word of its feed."""
        feed, side, pole, turns = self._in_force(source)
        self.side = self.side if side is None else side
        for way, on in turns if source.startswith("/") else ():
            self._frame = self.turned(way, on)
        if pole:
            self._pole, self._pole_line = dict.fromkeys(AXES), None
        for number in map(int, FUNCTION.findall(source)):
            self._per_turn(number)
            if not source.startswith("/"):
                self._frame = self._tipped(number) or self._frame
        return self.feed_word(feed)

    def feed_word(self, feed: str) -> str:
        """Return the word of a feed as it stands in a block, empty for none."""
        if feed in self.parameters:
            self.feeds[len(self.texts)] = self.parameters[feed]
            return f"F{self.parameters[feed]}"
        plain = re.fullmatch(NUMBER, feed)
        return f"F{number_of(feed)}" if plain else UNKNOWN_FEED if feed else ""

    def add(self, text: str) -> None:
        """Add the translation of a line."""
        if self._ended and text and not text.endswith(NOT_UNDERSTOOD):
            # A line behind which nothing is known ends no frame: the next one says it.
            text, self._ended = joined("G69", text), False
        plane, self._plane_word = self._plane_word or _PLANE_WORDS[self.tool_axis], ""
        self._states.append(f"{self._units} G90 {plane} G90.1 {self._feeds} {self.side}")
        self.texts.append(text)

    def lose(self, what: str, text: str, left: StaysInForce | None = None) -> None:
        """Write a line after which nothing is known: a call, a jump; `left` is what it leaves in force of the rest."""
        turned = bool(self._turned)
        if left is not None:
            self.side = left.side or self.side
            for way, on in left.turns:
                self.turned(way, on)
        self.forget(AXES)
        self.remarks[len(self.texts)] = Remark(what=f"{what}: {text}" if text else what)
        self.add(joined("G68" if self._turned else "", NOT_UNDERSTOOD))
        self._ended = turned and not self._turned
        self._pole = dict.fromkeys(AXES)
        self._pole_line = None
        self.parameters.clear()

    def forget(self, axes: Iterable[str]) -> None:
        """Take positions for unknown."""
        self._at |= dict.fromkeys(axes)

    def straight(self, places: Places, *, rapid: bool, feed: str, functions: list[int], why: str = "") -> str:
        """Write a straight move, or what else its line says where it moves nothing.

        `why` says why it is passed through, although its end is known; empty where it is not.
        """
        if why:
            self.remarks[len(self.texts)] = Remark(what=why)
        words = self._functions(functions)
        if not places:
            return joined(feed, *words)
        if _MACHINE & set(functions):
            self.forget(places)
            return joined("G53 G0", *(f"{axis}0" for axis in places if axis in AXES), feed, *words)
        ends = self._ends(places)
        self._moved = len(self.texts)
        if why and self._pole_line is not None:
            self.users[len(self.texts)] = self._pole_line
        return joined("G0" if rapid else "G1", "A0" if why else "", *ends, feed, *words)

    def arc(self, places: Places, *, left: bool, radius: Decimal | None, feed: str, functions: list[int]) -> str:
        """Write an arc about the pole, or with a radius."""
        if _MACHINE & set(functions):
            raise NotFollowed("arc in machine coordinates")
        plane = PLANES[self.tool_axis]
        ends = self._ends({**{axis: (True, Decimal(0)) for axis in plane}, **places})
        if radius is not None:
            ends.append(f"R{radius}")
        else:
            pole = {axis: self._pole[axis] for axis in plane}
            if None in pole.values():
                raise NotFollowed("arc about a centre that is not known")
            ends += [CENTERS[axis] + format(value or 0, "f") for axis, value in pole.items()]
            if self._pole_line is not None:
                self.arcs[len(self.texts)] = self._pole_line
        self._moved = len(self.texts)
        return joined("G3" if left else "G2", *ends, feed, *self._functions(functions))

    def polar(self, places: Places, angle: Decimal, *, steps: bool, left: bool, feed: str, functions: list[int]) -> str:
        """Write a circle or a helix about the pole, up to a direction or by an angle [deg]."""
        axes = {*self._pole_axes} if len(self._pole_axes) == len(PLANES[self.tool_axis]) else {*PLANES[self.tool_axis]}
        third = next(axis for axis in AXES if axis not in axes)
        first, second = PLANES[third]
        known = [self._at[first], self._at[second], self._pole[first], self._pole[second]]
        if None in known or axes & {*places}:
            raise NotFollowed("circle about a pole that is not known, or from an unknown place")
        a, b, p, q = (float(value) for value in known if value is not None)
        begin, way = math.atan2(b - q, a - p), math.radians(float(angle))
        swept = way if steps else (way - begin) % math.tau - (0.0 if left else math.tau)
        if swept == 0.0 or (swept > 0.0) != left:
            raise NotFollowed("circle whose angle and sense differ")
        rise = self._ends(places)
        radius, end = math.hypot(a - p, b - q), begin + swept
        whole = abs(math.remainder(swept, math.tau)) < _WHOLE
        ends = (a, b) if whole else (p + radius * math.cos(end), q + radius * math.sin(end))
        step = _STEP[self._units]
        for axis, value in zip((first, second), ends, strict=True):
            self._at[axis] = Decimal(repr(value)).quantize(step)
        self._moved = len(self.texts)
        self._plane_moved = len(self.texts)
        self._plane_word = _PLANE_WORDS[third]
        words = [f"{axis}{format(self._at[axis] or 0, 'f')}" for axis in (first, second)] + rise
        more = self._functions(functions)
        if self._pole_line is not None:
            self.arcs[len(self.texts)] = self._pole_line
        words += [f"{CENTERS[axis]}{format(self._pole[axis] or 0, 'f')}" for axis in (first, second)]
        turns = math.ceil(abs(swept) / math.tau - _WHOLE)
        words += [f"P{turns}"] if turns > 1 else []
        return joined("G3" if left else "G2", *words, feed, *more)

    def pole(self, places: Places) -> str:
        """Set the pole, or the axes of it that are named; without any it is where the tool stands."""
        if not places:
            self._pole |= {axis: self._at[axis] for axis in PLANES[self.tool_axis]}
        for axis, (incremental, number) in places.items():
            base = self._at[axis] if incremental else Decimal(0)
            self._pole[axis] = None if number is None or base is None else base + number
        self._pole_line = len(self.texts)
        plane = PLANES[self.tool_axis]
        self._pole_axes = tuple(places) if len(places) == len(plane) else plane
        self.poles[self._pole_line] = tuple(
            None if value is None or axis not in self._pole_axes else float(value) for axis, value in self._pole.items()
        )
        return ""

    def _ends(self, places: Places) -> list[str]:
        """Words of the places that a move goes to; it is followed."""
        if self._cut:
            # What is put between the two moves of a corner would be its second one.
            self._cut = False
            raise NotFollowed("move behind a rounded or chamfered corner")
        if self._called:
            raise NotFollowed("move behind which M89 calls a cycle")
        words = []
        for axis, (incremental, number) in places.items():
            base = self._at.get(axis) if incremental else Decimal(0)
            if number is None or (base is None and axis in AXES):
                raise NotFollowed("place that is computed" if number is None else "increment of an unknown place", axis)
            place = number + (base or Decimal(0))
            words.append(axis + format(place, "f"))
            if axis in AXES:
                self._at[axis] = place
        if {*places} & {*PLANES[self.tool_axis]}:
            self._plane_moved = len(self.texts)
        if {*places} - {*AXES}:
            self.forget(AXES)
        return words

    def _functions(self, functions: list[int]) -> list[str]:
        """Words of M functions."""
        for number in functions:
            if number in _CALLS:
                self._called = False
                raise NotFollowed("call of a cycle", f"M{number}")
            if tipped := self._tipped(number):
                self._frame = tipped
                raise NotFollowed("rotary axes about the tool's tip", f"M{number}")
            self._per_turn(number)
            if number not in (*_FEEDS_A_TURN, *_FUNCTIONS, *_MACHINE, *self._resting, *_TIPS.values()):
                raise NotFollowed("unknown M function", f"M{number}")
        return [_FUNCTIONS[number] for number in functions if number in _FUNCTIONS]

    def _per_turn(self, number: int) -> None:
        """Follow an M function with which F is for a turn of the spindle, or for a minute again."""
        if number in _FEEDS_A_TURN and self._units == "G21":
            self._feeds = _FEEDS_A_TURN[number]

    def _tipped(self, number: int) -> str:
        """Follow an M function of the frame; empty where it is none, or ends what is not on."""
        changes = [self.turned(way, on) for way, on in tips_in([number]) if on or self.is_turned(way)]
        return "".join(changes)

    def frame(self, text: str) -> str | None:
        """Follow a block that turns or shifts the frame, or ends that; None where it does neither."""
        change = frame_change(text)
        return None if change is None else self.shifted() if change[0] == _DATUM else self.turned(*change)

    def framed(self) -> list[bool]:
        """Return by line whether the frame is turned behind it."""
        found, on = list[bool](), False
        for text in self.texts:
            on = "G68" in text or (on and "G69" not in text)
            found.append(on)
        return found

    def pass_through(self, numbers: Sequence[int], *, turned: bool) -> None:
        """Take for unknown what lines leave that run more than once, or perhaps not; the frame may be `turned` then."""
        for number in numbers:
            kept = self.texts[number] == f"G68 {NOT_UNDERSTOOD}"
            self.texts[number] = joined("G68" if kept or (turned and number == numbers[-1]) else "", NOT_UNDERSTOOD)

    def doubt_side(self, first: int, last: int) -> None:
        """Let the cutter be beside a contour in lines of which nobody knows whether it is."""
        for number in range(first, last + 1):
            self._states[number] = f"{self._states[number].rpartition(' ')[0]} G41"

    def side_in(self, number: int) -> str:
        """Return the side behind a line, from 0; at first there is none."""
        return self._states[number].rpartition(" ")[2] if number >= 0 else "G40"

    def tool(self, axis: str | None, number: str | None, rest: str) -> str:
        """Call a tool, or change its axis or speed."""
        self.tool_axis = axis or self.tool_axis
        call = [] if number is None else ["M6"] if not number.isdecimal() else [f"T{number}", "M6"]
        if call:
            self.forget(AXES)
        return joined(*call, rest)

    def shifted(self) -> str:
        """Note that the datum is another from here on."""
        self.forget(AXES)
        self._pole = dict.fromkeys(AXES)
        self._pole_line = None
        return "G52"

    def turned(self, way: str, on: bool) -> str:
        """Note that the frame is turned, mirrored, scaled or tilted from here on, or no longer."""
        self.forget(AXES)
        (self._turned.add if on else self._turned.discard)(way)
        return "G68" if self._turned else "G69"

    def is_turned(self, way: str) -> bool:
        """Return whether the frame is turned in a way."""
        return way in self._turned

    def with_modes(self) -> list[str]:
        """Return the lines, each with the modes of RS274 wherever they are others, or may be lost."""
        texts, before = [], ""
        for text, state in zip(self.texts, self._states, strict=True):
            line = text
            if text.endswith(NOT_UNDERSTOOD):
                before = ""
            elif text and text != FORGOTTEN and state != before:
                line, before = f"{state} {text}", state
            texts.append(line)
        return texts

    def tangent(self, text: str) -> None:
        """Pass the moves before through that a tangential one goes on from: what stood between would be one of them."""
        for number in range(self._plane_moved, len(self.texts)):
            if _MOVES.search(self.texts[number]) and number not in self.remarks:
                self.remarks[number] = Remark(what=f"move from which a tangential one goes on: {text}")
                self._forget_line(number)
        self._plane_moved = len(self.texts)

    def corner(self, text: str) -> None:
        """Forget the end of the move before, which is rounded or chamfered."""
        if self._moved is not None and self._moved not in self.remarks:
            self.remarks[self._moved] = Remark(what=f"move whose end is cut off: {text}")
            self._forget_line(self._moved)
        self._cut = True
        raise NotFollowed("rounded or chamfered corner", text)

    def _forget_line(self, number: int) -> None:
        """Pass a line through that was followed; its feed stays in force."""
        feed = _FEED_WORD.search(self.texts[number])
        self.texts[number] = joined("" if feed is None else feed[0], FORGOTTEN)
