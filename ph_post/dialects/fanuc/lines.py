"""Edit lines of Fanuc programs in place so that the RS274 reader understands them."""

from __future__ import annotations

import re
from bisect import bisect_right
from collections.abc import Mapping
from typing import Final, Literal

import msgspec
import numpy as np

from ph_post.dialects.reading import NOT_UNDERSTOOD, Remark
from ph_post.gcode.program import PlaceArray

_WORD: Final = re.compile(rb"([A-Z])[ \t]*((?:[-+][ \t]*)?(?:\d+\.?\d*|\.\d+))")
MACRO: Final = rb"IF|WHILE|GOTO|END|DO[ \t]*\d|THEN|SETVN|POPEN|PCLOS|PRNT"
"""Pattern of the words of macro statements."""

_MACRO: Final = re.compile(MACRO)
_QUOTIENT: Final = re.compile(rb"[ \t]*(?:N[ \t]*\d+[ \t]*)?#[^=/]*=[^/]*/")
_BY_ZERO: Final = re.compile(rb"=.*/[ \t]*\[?[ \t]*(?:0+\.?0*|\.0+)(?![\d.])")
_LOOP: Final = re.compile(rb"(DO|END)[ \t]*(\d+)")
_JUMP: Final = re.compile(rb"(GOTO|M0*99[ \t]*P)[ \t]*(\d*)")
"""A jump, and an end that leads to a line: of the same program where that is the main one, else of its caller."""

_CYLINDERS: Final = (7.1, 107.0)
"""They begin with a radius, and end with C0 (B-64484EN, "Cylindrical interpolation")."""

_MODES: Final[Mapping[float, tuple[bytes, str]]] = {
    **dict.fromkeys(_CYLINDERS, (b"G12.1", "cylindrical interpolation")),
    12.1: (b"G12.1", "polar interpolation"),
    **dict.fromkeys((68.2, 68.3, 68.4), (b"G68", "tilted plane")),
    **dict.fromkeys((2.1, 3.1), (b"G33", "thread on a circle")),
    **dict.fromkeys((2.2, 3.2), (b"G33", "involute")),
    **dict.fromkeys((2.3, 3.3), (b"G33", "exponential interpolation")),
    **dict.fromkeys((2.4, 3.4), (b"G33", "arc in space")),
    6.1: (b"G33", "spline interpolation"),
    234.0: (b"G43.4", "tool centre point control"),
    **dict.fromkeys((50.3, 92.1), (b"G52", "")),
}
"""In the words of RS274's reader a turned frame, its end, another zero, or a motion that is not understood; and a name.

G92.1 (on lathes G50.3 too) brings the named axes' coordinates back to what they are without G92 and moves nothing
(B-64484EN, "Workpiece coordinate system preset"). G234 is Haas's and ends in G49 (Mill Operator's Manual, "G-codes").
"""

_FRAMES: Final[Mapping[float, tuple[float, bytes, bytes, str]]] = {
    14.0: (15.0, b"G51.1", b"G50.1", "secondary spindle"),
    51.1: (50.1, b"G51.1", b"G50.1", ""),
    101.0: (100.0, b"G51.1", b"G50.1", "mirror image"),
    112.0: (113.0, b"G12.1", b"G13.1", "polar interpolation"),
    254.0: (255.0, b"G7", b"G8", "dynamic work offset"),
    268.0: (269.0, b"G12.1", b"G13.1", "tilted plane"),
}
"""By the word with which a frame begins the one that ends it, both in words of RS274's reader, and a name.

Ends are others' words where nothing has begun: G100 changes the tool on Brother's. G101, G254 and G268 are Haas's (Mill
Operator's Manual, "G-codes"). Of lathes alone are G112 (B-64484EN-1, "Polar coordinate interpolation"; on Haas's
mills it is a work offset) and Haas's G14, which mirrors Z (Lathe Operator's Manual, "G14 Secondary Spindle Swap"). G7
and G12.1 stand for frames within which others begin and end, as G69 stands in the safe lines of many programs; of
Fanuc's words G7 is none.
"""
_OF_LATHES: Final = frozenset((14.0, 112.0))
_MIRRORS: Final = frozenset((50.1, 100.0))

_CALLS: Final = frozenset((65.0, 66.0, 66.1, 67.0, 72.1, 72.2))
"""Calls of macros, and of the subprogram whose figure G72.1 and G72.2 repeat (B-64484EN-2, "Figure copy")."""

TURNED: Final = rb"G0*(?:1[45]|3[24]|50|9[024589])(?!\d)|G7[0-6](?!\d)|T[ \t]*\d"
"""Pattern of the words that mean another thing on a lathe (G code system A) than in RS274."""

_TURNED: Final[Mapping[float, tuple[bytes, str]]] = {
    98.0: (b"G94", ""),
    99.0: (b"G95", ""),
    **dict.fromkeys((32.0, 34.0), (b"G33", "thread")),
    **dict.fromkeys((90.0, 92.0, 94.0), (b"G76", "turning cycle")),
    75.0: (b"G76", "turning cycle"),
}
"""In the words of RS274's reader, and a name of what is not understood."""

_TAPPING: Final = 95.0
"""A cycle of live tools on Haas's lathes (Lathe Operator's Manual, "G95 Live Tooling Rigid Tap (Face)").

In the G code systems B and C it is feeds a turn, and programs of theirs without G90 and G91 are not told from A's.
"""

_QUIET: Final = frozenset((5.0, 5.1, 8.0, 22.0, 23.0, 25.0, 26.0, 103.0, 187.0))
"""Look-ahead, contour control, limit checks, on Haas's smoothness (G187): they move nothing."""
_ARCS: Final = frozenset((2.0, 3.0))
_OTHER_PLACES: Final = frozenset((4.0, 10.0, 28.0, 30.0, 50.0, 53.0, 65.0, 92.0, 92.1))
"""G words beside which axis words are no places, or those of the machine."""

_SWITCHED: Final = re.compile(rb"(?<=[\d. \t])/[1-9]?[ \t]*((?:M[ \t]*\d+[ \t]*)+)\Z")
"""A slash within a block, and nothing but M words behind it."""
_RESTING: Final = frozenset((0.0, 1.0, 7.0, 8.0, 9.0))
"""Those of them that move nothing, whatever machine it is."""
_STAYS: Final = b"M10"
"""A word that stands for them: none of them changes how axes move."""

PROGRAM_END: Final = re.compile(rb"M[ \t]*0*(2|30|99)(?!\d)")
"""The end of a program, or of a subprogram."""


class PassedLines(msgspec.Struct, frozen=True, kw_only=True):
    """Lines that are passed through, and why."""

    first: int
    last: int
    what: str


def words_of(bare: bytes) -> list[tuple[bytes, bytes, int, int]]:
    """Return the words of a masked text: letter, number without blanks, and the places of begin and end.

    Examples
    --------
    >>> words_of(b"G1 X- 5.")
    [(b'G', b'1', 0, 2), (b'X', b'-5.', 3, 8)]
    """
    return [(found[1], found[2].translate(None, b" \t"), *found.span()) for found in _WORD.finditer(bare)]


_OPENING: Final = re.compile(
    rb"G[ \t]*0*(7\.1|107|12\.1|14|16|51(?:\.1)?|68(?:\.[234])?|43\.[45]|101|112|234|254|268)(?![\d.])"
)
"""Words with which a frame begins that is not the machine's."""


def frames_begun(bare: bytes, frames: dict[float, set[bytes]]) -> bytes:
    """Return the words, of RS274's reader, of frames that a line begins which is passed through; none ends there.

    `frames` are added to, as of :meth:`Editor.translate`.

    Examples
    --------
    >>> frames_begun(b"IF[#1EQ1] G68 X0 Y0 R45.", {}), frames_begun(b"G1 X5.", {})
    (b'G68 ', b'')
    """
    found = b""
    for code in map(float, _OPENING.findall(bare)):
        word = b"G%g" % code
        if code in _FRAMES:
            closing, word, _, _ = _FRAMES[code]
            frames.setdefault(closing, set())
        elif code in _MODES:
            word, _ = _MODES[code]
        found += word + b" "
    return found


class Editor:
    """One line in the making.

    Parameters
    ----------
    text, bare : bytes
        The line, and the same masked.
    calculator : bool
        Whether lengths without a decimal point are in millimetres.
    turned : bool
        Whether it is the line of a lathe's program.
    by_words : bool
        Whether that is of G code system A.

    Attributes
    ----------
    text : bytes
        Its translation, as long as the line but where a word of it has no room.
    remark : Remark or None
        What is not understood.
    dwell : int or None
        Of a dwell: which power of ten its P is divided by to be in seconds; -1 where nobody knows.
    calls, begins_nurbs : bool
        Whether it is a G66, or a G06.2.
    """

    def __init__(
        self, text: bytes, bare: bytes, *, calculator: bool, turned: bool = False, by_words: bool = False
    ) -> None:
        self._text, self._ahead = bytearray(text), b""
        self._bare = bare
        self._calculator, self._turned, self._by_words = calculator, turned, by_words
        self._words = words_of(bare)
        self._codes = {float(number): (start, end) for letter, number, start, end in self._words if letter == b"G"}
        self.remark: Remark | None = None
        self.dwell: int | None = None
        self.calls = 66.0 in self._codes or 66.1 in self._codes
        self.begins_nurbs = 6.2 in self._codes

    @property
    def text(self) -> bytes:
        """The line as it is now."""
        return self._ahead + bytes(self._text)

    def translate(self, frames: dict[float, set[bytes]]) -> None:
        """Change what has to be changed.

        Parameters
        ----------
        frames : dict
            The words that end what has begun on lines before, with the axes named there; they are kept up.
        """
        if _MACRO.search(self._bare):
            self._whole("macro statement")
            return
        if _QUOTIENT.match(self._bare):
            # Its slash skips no block, and it moves nothing.
            self._note("division by zero" if _BY_ZERO.search(self._bare) else "parameter", 0, len(self._bare))
            self._put(0, len(self._text))
            return
        if _CALLS & self._codes.keys() or self._has(b"M", 198):
            self._whole("call of a macro or subprogram")
            return
        self._switched()
        self._frame_words()
        self._modes()
        self._frames(frames)
        if self._turned or sum(letter == b"T" for letter, _, _, _ in self._words) > 1:
            self._turret()
        if self._by_words:
            self._turning_words()
        if 4.0 in self._codes:
            self._dwell()
        elif not self.begins_nurbs:
            self._lengths()

    def _has(self, letter: bytes, value: float) -> bool:
        return any(one == letter and float(number) == value for one, number, _, _ in self._words)

    def _whole(self, what: str) -> None:
        self._note(what, 0, len(self._bare))
        self._text[:] = NOT_UNDERSTOOD.encode().ljust(len(self._text))

    def _note(self, what: str, start: int, end: int) -> None:
        if self.remark is None:
            shown = self._bare[start:end].decode("ascii", "replace").strip()
            column = start + 1 + len(self._bare[start:end]) - len(self._bare[start:end].lstrip())
            self.remark = Remark(what=f"{what}: {shown}", column=column)

    def _put(self, start: int, end: int, new: bytes = b"") -> None:
        if len(new) > end - start:
            self._ahead, new = self._ahead + new + b" ", b""
        self._text[start:end] = new.ljust(end - start)

    def _switched(self) -> None:
        """Take the slash from M words behind it, which run or not: what is before it runs in any case.

        B-64484EN, "Optional block skip": from a slash elsewhere than at the head to the block's end.
        """
        found = _SWITCHED.search(self._bare)
        if found is None or not self._bare[: found.start()].strip():
            return
        self._note("block delete", *found.span())
        rest = all(float(number) in _RESTING for _, number, _, _ in words_of(found[1]))
        self._put(*(found.span() if rest else (found.start(), found.start(1))), _STAYS if rest else b"")

    def _frame_words(self) -> None:
        """``:1234`` is an O number, ``<NAME>`` a program's name."""
        number = re.match(rb"[ \t]*:", self._bare)
        if number is not None:
            self._put(number.end() - 1, number.end(), b"O")
        for found in re.finditer(rb"O?[ \t]*<[^>]*>", self._bare):
            self._put(*found.span())

    def _modes(self) -> None:
        """Hide what moves nothing, and what changes the meaning of the moves put in words that say so."""
        if {28.0, 30.0} & self._codes.keys() and {90.0, 91.0} <= self._codes.keys():
            # The last of two words of a group holds, and the places on the way to a reference do not matter.
            self._put(*min(self._codes[90.0], self._codes[91.0]))
        for code, (start, end) in self._codes.items():
            if code in _QUIET:
                self._quiet(code, start, end)
            elif code in _MODES:
                word, name = _MODES[code]
                ends = code in _CYLINDERS and self._has(b"C", 0.0)
                self._put(start, end, b"G13.1" if ends else word)
                if name and not ends:
                    self._note(name, start, end)

    def _frames(self, frames: dict[float, set[bytes]]) -> None:
        """Let frames begin and end; a mirror ends with its last axis, and what stands beside its end is no place."""
        places = [word for word in self._words if word[0] in b"XYZABCUVW"]
        axes = {letter for letter, _, _, _ in places}
        for code, (start, end) in self._codes.items():
            if code in _FRAMES and (self._turned or code not in _OF_LATHES):
                closing, word, _, name = _FRAMES[code]
                frames.setdefault(closing, set()).update(axes)
                self._put(start, end, word)
                if name:
                    self._note(name, start, end)
            elif code in frames:
                left = frames.pop(code) - axes if axes and code in _MIRRORS else set()
                begins, ends = next(words[1:3] for words in _FRAMES.values() if words[0] == code)
                self._put(start, end, begins if left else ends)
                if left:
                    frames[code] = left
                for _, _, first, last in places:
                    self._put(first, last)

    def _turret(self) -> None:
        """Let T, which turns the turret of a lathe and takes up another offset, be a change of the tool.

        On mills the first of two is the tool that M6 brings, and the second the one to be ready next (Mazatrol Matrix,
        Programming Manual EIA/ISO, "Tool functions").
        """
        tools = [(start, end) for letter, _, start, end in self._words if letter == b"T"]
        for number, (start, end) in enumerate(tools):
            if self._turned or number:
                self._put(start, end, b"M6" if number == 0 and not self._has(b"M", 6.0) else b"")

    def _turning_words(self) -> None:
        """Put the feeds, the cycles and the zero of a lathe in words that say so.

        Cycles last in RS274, and so all places behind one that are told without a motion of their own are passed
        through.
        """
        if 50.0 in self._codes:
            start, end = self._codes[50.0]
            placed = any(letter in b"XZUW" for letter, _, _, _ in self._words)
            self._put(start, end, b"G92" if placed else b"")
            for letter, _, first, last in self._words:
                if letter == b"S" and not placed:
                    self._put(first, last)
        placed = any(letter in b"XZUWC" for letter, _, _, _ in self._words)
        for code, (start, end) in self._codes.items():
            if code == _TAPPING and placed and not _MOTIONS & self._codes.keys():
                self._put(start, end, b"G76")
                self._note("tapping cycle", start, end)
            elif code in _TURNED:
                word, name = _TURNED[code]
                self._put(start, end, word)
                if name:
                    self._note(name, start, end)

    def _quiet(self, code: float, start: int, end: int) -> None:
        self._put(start, end)
        letters = b"PE" if code > 100.0 else b"PQR" if code == 5.0 else b"PQRXYZABC" if code == 5.1 else b"PXYZIJK"
        for letter, _, first, last in self._words:
            if letter in letters:
                self._put(first, last)
        self._words = [word for word in self._words if word[0] not in letters]

    def _dwell(self) -> None:
        """``X`` and ``U`` are seconds, ``P`` milliseconds; a whole X counts in unknown increments."""
        for letter, number, start, end in self._words:
            if letter == b"P":
                self.dwell = 3
            elif letter in (b"X", b"U"):
                self._put(start, start + 1, b"P")
                plain = b"." in number or float(number) == 0.0 or self._calculator
                self.dwell = 0 if plain else -1
                if not plain:
                    self._note("dwell without a decimal point", start, end)

    def _lengths(self) -> None:
        """Take the sense from arcs whose P means nothing here, and from L20, which sets a further work offset.

        That may be the one in force (``G54.1 P2``), as P0 says.
        """
        further = 10.0 in self._codes and self._has(b"L", 20.0)
        for letter, _, start, end in self._words:
            if further and letter in b"LP":
                self._put(start, end, b"L2" if letter == b"L" else b"P0")
        words = [word for word in self._words if word[0] == b"P"] if _ARCS & self._codes.keys() else []
        if not words or {10.0, 28.0, 30.0, 53.0} & self._codes.keys():
            return
        _, _, start, end = words[0]
        self._note("word that no other on the line uses", start, end)
        # A further axis is what makes the reader give the position up, whatever else the line says.
        present = {one[0] for one in self._words}
        spare = next((axis for axis in (b"U", b"V", b"W") if axis not in present), b"U")
        for _, _, first, last in words:
            self._put(first, last)
        self._put(start, end, spare + b"0")


def unmeasured(bare: bytes, lines: PlaceArray) -> int | None:
    r"""Return the first line with places of a subprogram that says neither G90 nor G91 before; None without one.

    What X, Y and Z mean in it is set by the program that calls it, which may be any.

    Parameters
    ----------
    bare : bytes
        The text, masked.
    lines : PlaceArray

    Examples
    --------
    >>> import numpy as np
    >>> unmeasured(b"O1\nG1 X1.\nM99\n", np.array([0, 3, 10, 14]))
    1
    """
    for number in range(lines.size - 1):
        words = words_of(bare[lines[number] : lines[number + 1]])
        codes = {float(value) for letter, value, _, _ in words if letter == b"G"}
        if codes & {90.0, 91.0}:
            return None
        if not codes & _OTHER_PLACES and any(letter in b"XYZUVW" for letter, _, _, _ in words):
            end = PROGRAM_END.search(bare, int(lines[number]))
            return number if end is not None and end[1] == b"99" else None
    return None


def jumps_and_loops(bares: Mapping[int, bytes], bare: bytes, lines: PlaceArray) -> list[PassedLines]:
    """Find what loops repeat and jumps repeat or skip: every line where a target is computed or is not there."""
    found: list[PassedLines] = []
    open_at: dict[bytes, int] = {}
    end = lines.size - 2
    for number, text in sorted(bares.items()):
        for word, label in _LOOP.findall(text):
            if word == b"DO":
                open_at.setdefault(label, number)
            elif label in open_at:
                found.append(PassedLines(first=open_at.pop(label), last=number, what="loop of a macro"))
        for word, label in _JUMP.findall(text):
            target = _target(label, bare)
            if target is None and label and word != b"GOTO":
                continue
            if target is None:
                shown = text.strip().decode("ascii", "replace")
                what = f"jump in line {number + 1} to a line that is not known: {shown}"
                return [PassedLines(first=0, last=end, what=what)]
            line = int(np.searchsorted(lines, target, "right")) - 1
            found.append(PassedLines(first=min(number, line), last=max(number, line), what="jump of a macro"))
    return found + [PassedLines(first=line, last=end, what="loop of a macro") for line in open_at.values()]


def _target(label: bytes, bare: bytes) -> int | None:
    """Place of the line with that N, None where there is none, or no number."""
    if not label:
        return None
    place = re.compile(rb"^[ \t]*/?[ \t]*N[ \t]*0*%s(?!\d)" % label.lstrip(b"0"), re.MULTILINE).search(bare)
    return None if place is None else place.end() - 1


class Corner(msgspec.Struct, frozen=True, kw_only=True):
    """A line whose end is rounded, chamfered or given by an angle, and the lines of the move behind it.

    These are the next that moves in any case, and those before it that may be skipped, if no corner before has them.

    `word` is the text of what says so without a comma, and `column` its place, from 1.
    """

    line: int
    behind: list[int]
    word: str = ""
    column: int = 1


_COMMA_CORNER: Final = re.compile(rb",[ \t]*[ACR]")
_PLAIN_CORNER: Final = re.compile(
    rb"[ACIKR][ \t]*[-+.\d]|G[ \t]*0*(?:[0-3]|3[234]|8\d|9[024]|7\.1|1[01][237]|1[23]\.1)(?![\d.])"
)
"""What may be a corner on a lathe, and the words that say whether it is."""
_MOTIONS: Final = frozenset((0.0, 1.0, 2.0, 3.0, 32.0, 33.0, 34.0, *map(float, range(80, 90))))
_TURNING: Final = frozenset((90.0, 92.0, 94.0))
_STRAIGHT: Final = frozenset((1.0, 80.0))
_APART: Final = _OTHER_PLACES | frozenset(map(float, range(70, 77)))
_MOVES: Final = re.compile(rb"[XYZIJKUVW][ \t]*[-+.\d#\[]")
_STILL: Final = re.compile(rb"G[ \t]*0*4(?![\d.])|^[ \t]*(?:N[ \t]*\d+[ \t]*)?#")


def corners_of(bare: bytes, lines: PlaceArray, *, lathe: bool, by_words: bool) -> list[Corner]:
    r"""Find the corners that the control makes between two moves, and needs both of them for.

    ``,R``, ``,C`` and ``,A`` (B-64484EN-2, "Optional chamfering and corner R"); on lathes also R, C, A, I and K without
    a comma beside a straight move (B-64484EN-1, "Chamfering and corner R", "Direct drawing dimension programming").

    Parameters
    ----------
    bare : bytes
        The text, masked.
    lines : PlaceArray
    lathe : bool
        Whether it is the program of a lathe.
    by_words : bool
        Whether that is of G code system A.

    Examples
    --------
    >>> import numpy as np
    >>> text, lines = b"G1 X5.\nZ-5. C1.\nM8\nX9.\n", np.array([0, 7, 16, 19, 23])
    >>> [(one.line, one.behind, one.word) for one in corners_of(text, lines, lathe=True, by_words=True)]
    [(1, [3], 'C1.')]
    >>> corners_of(text, lines, lathe=False, by_words=False)
    []
    """
    places = [found.start() for found in _COMMA_CORNER.finditer(bare)]
    found = dict.fromkeys((np.searchsorted(lines, places, "right") - 1).tolist(), ("", 1))
    if lathe:
        found = _plain_corners(bare, lines, by_words=by_words) | found
    if not found:
        return []
    moves, taken, corners = _moves_of(bare, lines), set[int](), list[Corner]()
    for line, (word, column) in sorted(found.items()):
        behind, at = list[int](), bisect_right(moves, line, key=lambda move: move[0])
        while at < len(moves) and moves[at][0] not in taken:
            number, what = moves[at]
            behind += [number] * (what != "end")
            taken |= {number} if what == "skipped" else set()
            at = at + 1 if what == "skipped" else len(moves)
        corners.append(Corner(line=line, behind=behind, word=word, column=column))
    return corners


def _plain_corners(bare: bytes, lines: PlaceArray, *, by_words: bool) -> dict[int, tuple[str, int]]:
    """Find corners without a comma: by line their word, and its column."""
    found: dict[int, tuple[str, int]] = {}
    motions = _MOTIONS | (_TURNING if by_words else frozenset())
    motion, inside = 1.0, False
    places = [word.start() for word in _PLAIN_CORNER.finditer(bare)]
    for line in np.unique(np.searchsorted(lines, places, "right") - 1).tolist():
        words = words_of(bare[lines[line] : lines[line + 1]])
        codes = {float(number) for letter, number, _, _ in words if letter == b"G"}
        if codes & {*_CYLINDERS, 12.1, 13.1, 112.0, 113.0}:
            ends = any(letter == b"C" and float(number) == 0.0 for letter, number, _, _ in words)
            inside = not (ends or codes & {13.1, 113.0})
            continue
        motion = next(iter(codes & motions), motion)
        moves = any(letter in b"XZUW" for letter, _, _, _ in words)
        corner = next((word for word in words if word[0] in (b"ACIKR" if moves else b"A")), None)
        if corner is not None and motion in _STRAIGHT and not inside and not codes & _APART - motions:
            start, end = corner[2:]
            text = bare[lines[line] + start : lines[line] + end]
            found[line] = (text.decode("ascii", "replace"), start + 1)
    return found


def _moves_of(bare: bytes, lines: PlaceArray) -> list[tuple[int, Literal["moves", "skipped", "end"]]]:
    """Return the lines that move, in any case or as a switch says, and those that end a program."""
    found: list[tuple[int, Literal["moves", "skipped", "end"]]] = []
    for number in range(lines.size - 1):
        text = bare[lines[number] : lines[number + 1]]
        if _MOVES.search(text) and not _STILL.search(text):
            found.append((number, "skipped" if text.lstrip().startswith(b"/") else "moves"))
        elif PROGRAM_END.search(text):
            found.append((number, "end"))
    return found
