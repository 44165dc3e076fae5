"""Turned and mirrored coordinates of Siemens programs, written out as places of the frame that stands without them.

SINUMERIK 840D sl / 828D, Programming Manual, Fundamentals, 07/2010, 6FC5398-1BP40-2BA0, "Coordinate transformations
(frames)": TRANS, ROT, SCALE and MIRROR count from the settable zero offset and take away what the program made before;
ATRANS, AROT, ASCALE and AMIRROR come on top. Each has a block of its own. RPL is an angle in the plane. In a mirror the
control changes the sense of circles and the side of the cutter itself.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from ph_post.expand.faults import NotExpandableError
from ph_post.expand.frame_writer import FrameStandsError, FrameWriter
from ph_post.expand.frames import PlaneFrame, mirrored_in, turned_by
from ph_post.expand.sinumerik import calls_subprogram
from ph_post.expand.writing import number_text

_NUMBER: Final = r"[-+]?[ \t]*(?:\d+\.?\d*|\.\d+)"
_LEAD: Final = re.compile(r"[ \t]*(/\d?)?[ \t]*(?:[N:]\d+[ \t]*)?(?:[A-Z_]\w+[ \t]*:(?!=)[ \t]*)?")
_HIDDEN: Final = re.compile(r';.*|"[^"]*"')
_DEFINITION: Final = re.compile(r"(A?)(TRANS|ROT|MIRROR|SCALE)\b(.*)$")
_OTHER_FRAME: Final = re.compile(r"A?ROTS\b|CROTS\b|TOROT|TOFRAME|PAROT|CYCLE800\b|TRA(?:ORI|NSMIT|CYL|ANG)\b|G5[89]\b")
_VALUE: Final = re.compile(rf"\s*(RPL|[A-Z])\s*(?:=\s*)?({_NUMBER})")
_WORD: Final = re.compile(rf"\s*([A-Z]+)\s*(?:=\s*)?(?:(AC|IC)\s*\(\s*({_NUMBER})\s*\)|({_NUMBER})(?![\w=(*/+-]))")
_STILL: Final = re.compile(r"$|MSG\s*\(|R\d+\s*=|DEF\b|STOPRE$|G0*4(?!\d)")
"""Lines that no frame changes."""
_LONE_CALL: Final = re.compile(r"(?<![\w$])L\d|\bM?CALL\b")
"""A subprogram that is called beside other words."""
_DIAMETERS: Final = re.compile(r"\bDIAM(?:ON|90)\b")
_CODE: Final = re.compile(r"(?<![A-Z=])G\s*0*(\d+)(?!\d)")
_MODAL_CALL: Final = re.compile(r"\bMCALL\b\s*(.*)")
"""A subprogram that is called behind each block that moves, up to an MCALL alone, and runs in the frame there."""
_ENDS: Final = re.compile(r"\bM\s*0*(?:2|17|30)(?!\d)|^RET\b")
_MOTIONS: Final = frozenset((0, 1, 2, 3))
_ARCS: Final = {2: 3, 3: 2}
_NO_SIDE: Final = 40
_SIDES: Final = {41: 42, 42: 41}
_OFFSETS: Final = frozenset((54, 55, 56, 57, *range(505, 600)))
_KEPT_CODES: Final = frozenset((9, 17, 40, 41, 42, 60, 64, 90, 91, 94, *range(641, 647)))
_PLACES: Final = ("X", "Y")
_CENTERS: Final = {"I": "X", "J": "Y"}
_KEPT: Final = frozenset(("F", "S", "T", "D", "H", "M", "Z", "CR", "AR", "TURN", "RND", "CHF", "CHR", "FRC"))
_KEPT_ORDERS: Final = frozenset((0, 1, 2, 3, 4, 5, 7, 8, 9, 17, 30))
_DECIMALS: Final = 6


class _Word(msgspec.Struct, frozen=True, kw_only=True):
    """A word: its name, AC or IC where it says so, and its number."""

    name: str
    function: str
    number: float
    text: str


class SinumerikFrames(FrameWriter):
    """Writes out what moves in turned or mirrored coordinates of a Siemens program.

    Parameters
    ----------
    lines : sequence of str
        Of a program that runs from the first to the last, with plain numbers.
    """

    def __init__(self, lines: Sequence[str]) -> None:
        super().__init__()
        self._rows = [_SinumerikRow.of(line) for line in lines]

    @property
    def _first(self) -> int | None:
        definitions = ((row, _DEFINITION.match(one.rest)) for row, one in enumerate(self._rows))
        return next((row for row, found in definitions if found and found[2] in ("ROT", "MIRROR")), None)

    def _read(self) -> list[tuple[int, list[str]]]:
        return [(row, [one.text]) for row, one in enumerate(self._rows)]

    def _words(self, row: int) -> str:
        return self._rows[row].rest.strip()

    def _made(self, standing: set[int]) -> list[list[str]]:
        return _FrameWork(self._rows, standing).written()


class _SinumerikRow(msgspec.Struct, frozen=True, kw_only=True):
    """A line: its text, what stands before its words and behind them, these in capitals, and whether it has a slash."""

    text: str
    lead: str
    rest: str
    tail: str
    slash: bool

    @staticmethod
    def of(line: str) -> _SinumerikRow:
        """Read a line."""
        bare = _HIDDEN.sub(lambda found: " " * len(found[0]), line).upper()
        lead = _LEAD.match(bare)
        assert lead is not None
        end = max(len(bare.rstrip()), lead.end())
        return _SinumerikRow(
            text=line,
            lead=line[: lead.end()],
            rest=bare[lead.end() : end],
            tail=line[end:],
            slash=lead[1] is not None,
        )

    def with_words(self, text: str) -> str:
        """Return the line with other words."""
        return f"{self.lead}{text}{self.tail}"


class _FrameWork:
    """Goes through a program once, with the frames defined in `standing` rows left as they are."""

    def __init__(self, rows: Sequence[_SinumerikRow], standing: set[int]) -> None:
        self._rows, self._standing = rows, standing
        self._frame: PlaneFrame | None = None
        self._height = 0.0
        self._row = -1
        self._stands: int | None = None
        self._at: complex | None = None
        self._mode: int | None = None
        self._absolute: bool | None = True
        self._upright = False
        self._side = _NO_SIDE
        self._behind: int | None = None
        self._called = ""

    def written(self) -> list[list[str]]:
        """Return the lines of each row."""
        found = [[one.text] for one in self._rows]
        for row, one in enumerate(self._rows):
            if _DIAMETERS.search(one.rest):
                raise FrameStandsError(None, "places are diameters")
            modal = _MODAL_CALL.search(one.rest)
            if modal is not None:
                self._lose_called(self._called)
                self._called = modal[1] or (self._called if one.slash else "")
            definition = _DEFINITION.match(one.rest)
            if definition is not None:
                found[row] = self._defined(row, one, definition)
            elif self._frame is None:
                self._follow(one)
            else:
                try:
                    found[row] = [self._moved(one)]
                except NotExpandableError as error:
                    raise FrameStandsError(self._row, f"{error.what}: {one.rest.strip()[:40]}") from None
            if _ENDS.search(one.rest):
                break
        return found

    # ------------------------------------------------------------------ definitions

    def _defined(self, row: int, one: _SinumerikRow, definition: re.Match[str]) -> list[str]:
        """Follow a definition; return what is written for it."""
        added, word, values = bool(definition[1]), definition[2], _values_of(definition[3])
        above = self._frame
        if one.slash or values is None or (added and not values):
            raise FrameStandsError(None, "its numbers are not known, or it runs or not as a switch says")
        if above is not None and self._side != _NO_SIDE:
            raise FrameStandsError(self._row, "the next frame begins beside the contour")
        if not added:
            self._behind = self._behind if above is None else self._row
            self._frame = above = self._stands = None
        if not values or (word == "TRANS" and above is None):
            return [one.text]
        if self._stands is not None or row in self._standing:
            if above is not None:
                raise FrameStandsError(self._row, "a frame that stays comes on top of it")
            self._stands = row
            return [one.text]
        modal = "a subprogram is called behind each of its moves (MCALL)"
        why = modal if self._called else self._why_not(word, values)
        if why:
            raise FrameStandsError(row, why)
        frame = _frame_of(word, values)
        self._at = self._behind = None
        if above is not None:
            self._frame = above.within(frame)
            self._height += values.get("Z", 0.0) if word == "TRANS" else 0.0
            return []
        self._frame, self._height, self._row = frame, 0.0, row
        # What the program made before is taken away all the same, or stands below.
        return [] if added else [one.with_words(word)]

    def _why_not(self, word: str, values: dict[str, float]) -> str:
        if word == "SCALE":
            return "scaled coordinates are not written out"
        if not self._upright or self._absolute is None:
            return f"no {'G90 or G91' if self._upright else 'G17'} stands before it"
        if self._side != _NO_SIDE:
            return "it begins beside the contour"
        if word == "ROT" and set(values) not in ({"RPL"}, {"Z"}):
            return "it does not turn in the plane (RPL)"
        if word == "MIRROR" and set(values) - {"X", "Y"}:
            return "it is not in the plane of X and Y"
        return ""

    # ------------------------------------------------------------------ without a frame

    def _follow(self, one: _SinumerikRow) -> None:
        """Follow a line that stays, up to where the place from the frame before is gone."""
        words = _words_of(one.rest)
        before = self._mode, self._absolute, self._upright, self._side
        self._take_codes({int(code) for code in _CODE.findall(one.rest)})
        if one.slash:
            self._keep_same(*before)
        self._lose_called(one.rest.strip())
        if _STILL.match(one.rest) or words == []:
            return
        if words is None:
            self._mode = None
            if self._behind is not None and not re.match(r"[A-Z_]\w*\s*=\s*\"?\s*$", one.rest):
                raise FrameStandsError(self._behind, "what stands behind it is not followed")
            return
        if self._behind is None or not {word.name for word in words} & {*_PLACES, *_CENTERS, "CR", "AP", "RP"}:
            return
        if not self._names_both(words) or one.slash:
            raise FrameStandsError(self._behind, "the first move behind it is not straight to X and Y")
        self._behind = None

    def _lose_called(self, text: str) -> None:
        """Know no mode behind the call of a subprogram of the program's own, if a text is one."""
        if calls_subprogram(text):
            self._mode, self._absolute, self._upright = None, None, False

    def _keep_same(self, mode: int | None, absolute: bool | None, upright: bool, side: int) -> None:
        """Know of the modes only what is the same as before a line that may run or not."""
        self._mode = mode if mode == self._mode else None
        self._absolute = absolute if absolute == self._absolute else None
        self._upright = upright and self._upright
        self._side = side if self._side == _NO_SIDE else self._side

    def _take_codes(self, codes: set[int]) -> None:
        for code in codes:
            if code in _MOTIONS:
                self._mode = code
            elif code in (90, 91):
                self._absolute = code == 90
            elif code in (17, 18, 19):
                self._upright = code == 17
            elif code in (40, 41, 42):
                self._side = code

    def _is_place(self, word: _Word) -> bool:
        """Return whether a word of an axis says where it goes, and not how far."""
        return word.function == "AC" or (self._absolute is True and not word.function)

    def _names_both(self, words: Sequence[_Word]) -> bool:
        """Return whether a move is straight, to a place of which X and Y are said."""
        said = {word.name for word in words if self._is_place(word)}
        return self._mode in (0, 1) and set(_PLACES) <= said

    # ------------------------------------------------------------------ within a frame

    def _moved(self, one: _SinumerikRow) -> str:
        """Return a line without the frame."""
        frame, words = self._frame, _words_of(one.rest)
        assert frame is not None
        if _OTHER_FRAME.match(one.rest):
            raise NotExpandableError("another frame in it")
        if _STILL.match(one.rest) and _LONE_CALL.search(one.rest) is None:
            return one.text
        codes = {round(word.number) for word in words or () if word.name == "G"}
        orders = {round(word.number) for word in words or () if word.name == "M"}
        named = {word.name for word in words or ()}
        known = codes <= _MOTIONS | _KEPT_CODES | _OFFSETS and orders <= _KEPT_ORDERS
        if words is None or one.slash or not known or named - {"G", *_PLACES, *_CENTERS, *_KEPT}:
            raise NotExpandableError("a line that is not followed in turned or mirrored coordinates")
        self._take_codes(codes)
        self._at = None if codes & _OFFSETS else self._at
        moves = bool(named & {*_PLACES, *_CENTERS, "CR", "AR"})
        if moves and self._mode is None:
            raise NotExpandableError("a move without its G word")
        texts, ends = list[str](), self._place(words, frame) if moves else []
        for word in words:
            if word.name == "G":
                code = round(word.number)
                texts.append(f"G{_ARCS.get(code, _SIDES.get(code, code))}" if frame.flips else word.text)
            elif word.name == "Z" and self._height and self._is_place(word):
                height = _text(word.number + self._height)
                texts.append(f"Z=AC({height})" if word.function else f"Z{height}")
            elif word.name not in (*_PLACES, *_CENTERS):
                texts.append(word.text)
        place = next((k for k, text in enumerate(texts) if not text.startswith("G")), len(texts))
        texts[place:place] = ends
        return one.with_words(" ".join(texts))

    def _place(self, words: Sequence[_Word], frame: PlaneFrame) -> list[str]:
        """Follow a move in the plane, and return its words without the frame."""
        if self._at is None and not self._names_both(words):
            raise NotExpandableError("the first move is not straight to X and Y")
        start = 0j if self._at is None else self._at
        ends, centers = {"X": start.real, "Y": start.imag}, {"X": start.real, "Y": start.imag}
        for word in words:
            if word.name in ends:
                ends[word.name] = word.number + (0.0 if self._is_place(word) else ends[word.name])
            elif word.name in _CENTERS:
                axis = _CENTERS[word.name]
                centers[axis] = word.number + (0.0 if word.function == "AC" else centers[axis])
        end, had = complex(ends["X"], ends["Y"]), self._at
        self._at = end
        to = frame.apply(end)
        if not self._absolute and had is not None:
            to = frame.way(end - start)
        if _turns_by_angle(words):
            if {word.name for word in words} & set(_PLACES):
                raise NotExpandableError("an arc by its centre and its angle that has an end, too")
            texts = []
            # Where it ends the angle says, which is not worked out: the next move has to name both axes.
            self._at = None
        else:
            texts = [f"X{_text(to.real)}", f"Y{_text(to.imag)}"]
        if not self._absolute and had is None:
            texts = [f"X=AC({_text(to.real)})", f"Y=AC({_text(to.imag)})"]
        if any(word.name in _CENTERS for word in words):
            center = frame.way(complex(centers["X"], centers["Y"]) - start)
            texts += [f"I{_text(center.real)}", f"J{_text(center.imag)}"]
        return texts


def _turns_by_angle(words: Sequence[_Word]) -> bool:
    """Return whether an arc is given by its centre and its angle (AR), which leave no room for an end."""
    names = {word.name for word in words}
    return "AR" in names and bool(names & _CENTERS.keys())


def _values_of(rest: str) -> dict[str, float] | None:
    """Return the values of a definition by their letters, or RPL; None where one is computed."""
    values = dict[str, float]()
    while rest.strip():
        found = _VALUE.match(rest)
        if found is None:
            return None
        values[found[1]] = float(re.sub(r"\s", "", found[2]))
        rest = rest[found.end() :]
    return values


def _frame_of(word: str, values: Mapping[str, float]) -> PlaneFrame:
    if word == "TRANS":
        return PlaneFrame(shift=complex(values.get("X", 0.0), values.get("Y", 0.0)))
    # Turned in the plane of X and Y it is turned about Z.
    return turned_by(*values.values()) if word == "ROT" else mirrored_in("".join(values))


def _words_of(rest: str) -> list[_Word] | None:
    """Return the words of a line; None where it has something else."""
    found, at = list[_Word](), 0
    while rest[at:].strip():
        word = _WORD.match(rest, at)
        if word is None:
            return None
        number = float(re.sub(r"\s", "", word[3] or word[4]))
        found.append(_Word(name=word[1], function=word[2] or "", number=number, text=word[0].strip()))
        at = word.end()
    return found


def _text(value: float) -> str:
    return number_text(value, _DECIMALS)
