"""Replace, add and remove words in the text of a block, and write the words of a part of a motion or of a jog."""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from typing import Final

import numpy as np

from ph_post.dialects.base import Dialect
from ph_post.edit.motion_edits import MotionPart
from ph_post.errors import InputError
from ph_post.gcode.codes import takes_axes
from ph_post.gcode.motion_parts import place, split_cubic
from ph_post.gcode.program import ARC, AXES, CENTERS, CUBIC, PLANE_AXES, Modal, PartProgram, number_text
from ph_post.types import Array, IntArray

_CANNED: Final = (73, 76, 80, 81, 82, 83, 84, 85, 86, 87, 88, 89)
_TURNING: Final = (70, 71, 71.1, 71.2, 72, 72.1, 72.2)
MOTION_WORDS: Final = {
    number: f"G{number:g}"
    for number in (0, 1, 2, 3, 5, 5.1, 5.2, 5.3, 33, 33.1, 38.2, 38.3, 38.4, 38.5, *_TURNING, *_CANNED)
}
"""Words that set the motion mode, by the number behind the G."""

_ENDING: Final = (2.0, 30.0)
"""M words after which nothing is read."""

COMMENT: Final = re.compile(r"\([^)]*\)|;.*")
"""A comment of a line, in parentheses or up to its end."""

MOTION_LETTERS: Final = "XYZABCUVWIJKR"
"""Letters of words that make a block move."""


def line_end(program: PartProgram) -> str:
    """Line end of a program: that of the first line that ends in LF, CR where none does, LF where no line has an end.

    A CR alone among them, as of a line that ends in CR CR LF, ends no comment for whoever reads up to the next LF.
    """
    first = program.data.find(b"\n")
    if first >= 0:
        return "\r\n" if program.data[first - 1 : first] == b"\r" else "\n"
    return "\r" if b"\r" in program.data else "\n"


def longest_line(program: PartProgram, dialect: Dialect) -> int:
    """Return how long a line with its end may be: as the dialect allows, or as the longest of the program is."""
    own = int(np.diff(program.lines).max())
    if not program.data.endswith((b"\n", b"\r")):
        own += len(line_end(program))
    return max(dialect.syntax.max_line + len("\r\n"), own)


def line_text(program: PartProgram, block: int) -> str:
    """Text of a line without its line end."""
    return program.text(block).rstrip(b"\r\n").decode("latin-1")


def words_by_letter(program: PartProgram, block: int) -> dict[str, int]:
    """Numbers of the words of a line by letter; of G and M words the last one."""
    return {chr(int(program.words.letter[word])): word for word in program.words_of(block)}


def motion_word(program: PartProgram, block: int) -> int | None:
    """Return the word of a line that sets the motion mode, if it has one."""
    for word in program.words_of(block):
        if program.words.letter[word] == ord("G") and float(program.words.value[word]) in MOTION_WORDS:
            return word
    return None


def words_after_motion(program: PartProgram, block: int) -> list[int]:
    """Words of a line that are executed after its motion."""
    words = program.words
    after = program.language.after_motion
    return [w for w in program.words_of(block) if words.letter[w] == ord("M") and float(words.value[w]) in after]


def text_after_motion(program: PartProgram, block: int) -> str:
    """Text of the words of a line that are executed after its motion."""
    text, base, words = line_text(program, block), program.lines[block], program.words
    last = words_after_motion(program, block)
    return " ".join(text[words.start[w] - base : words.end[w] - base] for w in last)


def ends_program(program: PartProgram, block: int) -> bool:
    """Return true where the program ends in this line."""
    return any(float(program.words.value[w]) in _ENDING for w in words_after_motion(program, block))


def exchange_words(
    program: PartProgram, block: int, new: Mapping[str, str], mode: str
) -> tuple[dict[int, str], list[str]]:
    """Return the words of a line to replace, by number, and the new words that it does not have yet."""
    own = words_by_letter(program, block)
    exchange = {own[letter]: text for letter, text in new.items() if letter in own}
    word = motion_word(program, block)
    if word is not None and float(program.words.value[word]) != float(mode[1:]):
        exchange[word] = mode
    return exchange, [text for letter, text in new.items() if letter not in own and text]


def relies_on_mode(program: PartProgram, block: int) -> bool:
    """Return true where a line moves without a motion word, so that the motion mode in force applies."""
    words, moves = program.words, False
    for word in program.words_of(block):
        letter, value = chr(int(words.letter[word])), float(words.value[word])
        if letter == "G" and (value in MOTION_WORDS or takes_axes(value)):
            return False
        moves |= letter in MOTION_LETTERS
    return moves


def next_relying(program: PartProgram, block: int) -> int | None:
    """Return the first line from `block` on that moves by the mode in force; none if it is set before."""
    if not program.language.modal:
        return None
    while block < program.blocks:
        if motion_word(program, block) is not None:
            return None
        if relies_on_mode(program, block):
            return block
        block += 1
    return None


def edited_line(
    program: PartProgram, block: int, exchange: Mapping[int, str], add: Sequence[str], *, first: str = ""
) -> str:
    """Return a line with other words.

    Parameters
    ----------
    program : PartProgram
    block : int
    exchange : mapping
        New text by word, empty for words that are left out.
    add : sequence of str
        Words that are added behind the last word that places the motion.
    first : str
        Word that is added before the first one of those.
    """
    words, base = program.words, int(program.lines[block])
    text, own = line_text(program, block), program.words_of(block)
    placed = [w for w in own if chr(int(words.letter[w])) in MOTION_LETTERS + "PQ"] or list(own)
    behind = max(placed) if placed else None
    gap = " " if " " in text.strip() or not placed else ""
    out, at = [], 0
    for word in own:
        low, high = int(words.start[word]) - base, int(words.end[word]) - base
        if program.language.whole is not None and not _is_number(exchange.get(word)):
            low, high = program.language.whole(text, low, high)
        out.append(text[at:low])
        if first and word == placed[0]:
            out.append(first + gap)
        out.append(exchange.get(word, text[low:high]))
        if word == behind:
            out += [gap + one for one in add]
        at = high
    return "".join(out) + text[at:]


def _is_number(text: str | None) -> bool:
    """Return True if a text stands in the place of a number alone, or nothing does."""
    return text is None or (text != "" and not text[0].isalpha())


class FeedWords:
    """The text of the F in force after every line: that of its word, or its number in other units set since then."""

    def __init__(self, program: PartProgram) -> None:
        words = program.words
        self._program = program
        rows = np.flatnonzero(words.letter == ord("F")).astype(np.int32)
        self._words = rows[words.decimals[rows] >= 0]
        self._blocks = words.block[self._words]

    def after(self, block: int) -> str | None:
        """Digits of the F word in force after a line, None where there is none."""
        feed = math.nan if block < 0 else self._program.feed_after(block)
        if math.isnan(feed):
            return None
        found = int(np.searchsorted(self._blocks, np.int32(block), side="right")) - 1
        if found < 0:
            return None
        word, words = self._words[found], self._program.words
        if words.value[word] != feed:
            return number_text(feed)
        text = self._program.data[words.start[word] + 1 : words.end[word]]
        return text.translate(None, b" \t").decode("latin-1")


_CENTERS: Final = tuple(CENTERS.values())
_FULL: Final = 1e-9
_MOST_DECIMALS: Final = 9
_DECIMALS_OF: Final = re.compile(rb"[.,](\d+)")
"""The decimals of a number."""

_PLACES: Final = np.frombuffer(b"XYZIJK", np.uint8)
"""Letters of words that name places."""

_ANGLE_DECIMALS: Final = 4
"""Of the angle [deg] of a helix in languages that write it in words of their own."""

_TRIED: Final = 5
"""Steps of its last decimal by which an angle is changed at most so that it ends at a place."""

_BESIDE: Final = 2
"""Steps by which its centre is moved for that at most, in each direction."""

_LARGEST: Final = 2.0**62
"""Steps of the last decimal that can be counted."""


def fine_decimals(program: PartProgram, decimals: int) -> int:
    """Decimals on which every position that a program names is exact, and those written too.

    In a language of its own an increment has no number in the table; the place to which it leads has its decimals.
    """
    found, data = [decimals], program.data
    for words in program.word_parts():
        placed = np.isin(words.letter, _PLACES)
        found.append(int(words.decimals[placed].max(initial=0)))
        if program.language.spelling is not None:
            steps = np.flatnonzero(placed & (words.decimals < 0)).tolist()
            texts = (data[words.start[word] : words.end[word]] for word in steps)
            found += [len(part) for text in texts for part in _DECIMALS_OF.findall(text)]
    return min(max(found), _MOST_DECIMALS)


def _turn(angle: float, start: IntArray, end: IntArray) -> tuple[float, IntArray]:
    """Return a turn [deg] and steps of its centre with which a helix from a place ends at another but for rounding.

    Both are from the centre, in whole steps. Its end follows from the angle, which has few decimals, and from the
    distance of its start: where no angle near its own leads there, a centre beside its own does.
    """
    step, rounded = 10.0**-_ANGLE_DECIMALS, round(angle, _ANGLE_DECIMALS)
    beside = sorted(itertools.product(range(-_BESIDE, _BESIDE + 1), repeat=2), key=lambda one: sum(map(abs, one)))
    for centre in np.array(beside, dtype=np.int64):
        (x, y), wanted = (start - centre).tolist(), (end - centre).tolist()
        begin, radius = math.atan2(y, x), math.hypot(x, y)
        for number in sorted(range(-_TRIED, _TRIED + 1), key=abs):
            turned = begin + math.radians(rounded + number * step)
            if [round(radius * math.cos(turned)), round(radius * math.sin(turned))] == wanted:
                return rounded + number * step, centre
    return rounded, np.zeros(2, dtype=np.int64)


class PartWords:
    """Writes the words of the parts of one motion, each relative to the part before it.

    Parameters
    ----------
    program : PartProgram
    motion : int
    modal : Modal
        Modes under which the motion's block is executed.
    decimals : int
        Of new places.
    fine : int
        Of places that the program names itself.
    length : callable
        ``length(count, decimals) -> text``: how the dialect writes lengths.
    """

    def __init__(
        self,
        program: PartProgram,
        motion: int,
        modal: Modal,
        decimals: int,
        fine: int,
        length: Callable[[int, int], str],
    ) -> None:
        self.program, self.motion, self.modal = program, motion, modal
        self._coarse, self._fine, self._length = decimals, fine, length
        self._factors = program.language.factors
        self._last = self._at = np.zeros(3, dtype=np.int64)
        self.block = int(program.motions.block[motion])

    @cached_property
    def _own(self) -> dict[str, int]:
        return words_by_letter(self.program, self.block)

    def begin(self, offset: IntArray) -> None:
        """Set the offset, in steps, with which the motion begins."""
        self._last = offset.copy()

    def _steps(self, length: Sequence[float], coarse: Sequence[bool]) -> IntArray:
        """Lengths [m] as whole steps of the finest decimal, those that are `coarse` of the other one."""
        found = []
        for one, few in zip(length, coarse, strict=True):  # one by one, as arrays of so few take longer
            decimals = self._coarse if few else self._fine
            count = 0.0 if math.isnan(one) else one / self.modal.units * 10.0**decimals
            if not abs(count) * 10.0 ** (self._fine - decimals) <= _LARGEST:
                where = f"{self.program.name}:{self.program.line_number(self.block)}"
                raise InputError(where, "a place that has too many digits to be written")
            found.append(round(count) * 10 ** (self._fine - decimals))
        return np.array(found, dtype=np.int64)

    def _point(self, share: float) -> IntArray:
        """Return a place of the motion; an axis that rests there is not rounded: no later part may name it again."""
        motions, k = self.program.motions, self.motion
        point = place(motions, k, share)
        rests = (point == motions.start[k]) & (point == motions.end[k])
        inside = 0.0 < share < 1.0
        return self._steps((point * self._factors).tolist(), [inside and not one for one in rests.tolist()])

    def _text(self, count: int) -> str:
        return self._length(int(count), self._fine)

    def jog(self, axis: int, offset: IntArray, share: float) -> str:
        """Word that moves an axis to an offset, in steps of the coarse decimals, at a place of the motion."""
        if self.modal.absolute:
            self._require(axis, place(self.program.motions, self.motion, share))
            return AXES[axis] + self._text((self._point(share) + self._written(offset))[axis])
        count = self._written(offset - self._last)[axis]
        self._last[axis] = offset[axis]
        return AXES[axis] + self._text(count)

    def _written(self, offset: IntArray) -> IntArray:
        """Return by how much words change for an offset in steps of the coarse decimals, in steps of the finest."""
        return np.asarray(offset * self._factors * 10 ** (self._fine - self._coarse))

    def part(self, part: MotionPart, offset: IntArray) -> dict[str, str]:
        """Words of a part by letter while an offset is carried; empty ones are not to be written."""
        if part.low == 0.0:
            self._at = self._point(0.0)
        end = self._point(part.high)
        shift = self._written(offset)
        if part.crossing is not None and part.crossing.line:
            return self._block(end, offset)
        kind = self.program.motions.kind[self.motion]
        for axis in self._axes(kind):
            self._require(axis, self.program.motions.start[self.motion], self.program.motions.end[self.motion])
        words = {AXES[axis]: self._end_word(axis, end, shift) for axis in self._axes(kind)}
        if kind == ARC:
            words |= self._arc_words(part, shift, end)
        elif kind == CUBIC:
            words |= self._cubic_words(part, end)
        self._at = end
        return words

    def _block(self, end: IntArray, offset: IntArray) -> dict[str, str]:
        """Words of a straight block of a crossing, which goes from the offset before it to its own."""
        way = end - self._at + self._written(offset - self._last)
        axes = sorted({*self._axes(self.program.motions.kind[self.motion]), *np.flatnonzero(way).tolist()})
        counts = end + self._written(offset) if self.modal.absolute else way
        self._at, self._last = end, offset.copy()
        left = {letter: "" for letter in (*CENTERS.values(), "R", "P", "Q") if letter in self._own}
        return left | {AXES[axis]: AXES[axis] + self._text(counts[axis]) for axis in axes}

    def _require(self, axis: int, *points: Array) -> None:
        """Refuse to write a place that follows from an unknown position."""
        if any(np.isnan(point[axis]) for point in points):
            where = f"{self.program.name}:{self.program.line_number(self.block)}"
            raise InputError(where, f"a place inside a motion that begins where {AXES[axis]} is not known")

    def _axes(self, kind: int) -> list[int]:
        """Axes that are written: those of the block, of curves those of the plane as well."""
        named = {axis for axis in range(3) if AXES[axis] in self._own}
        if kind in (ARC, CUBIC):
            named |= set(PLANE_AXES[int(self.program.motions.plane[self.motion])][:2])
        return sorted(named)

    def _end_word(self, axis: int, end: IntArray, shift: IntArray) -> str:
        if self.modal.absolute:
            return AXES[axis] + self._text(end[axis] + shift[axis])
        return AXES[axis] + self._text(end[axis] - self._at[axis])

    def _arc_words(self, part: MotionPart, shift: IntArray, end: IntArray) -> dict[str, str]:
        """Centre and turns; a radius is replaced by them, as half circles lose their digits with it."""
        motions, k = self.program.motions, self.motion
        a, b, c = PLANE_AXES[int(motions.plane[k])]
        center = self._steps(motions.center[k].tolist(), [not {*_CENTERS} & self._own.keys()] * 2)
        swept = float(motions.angle[k]) * (part.high - part.low)
        turns = math.ceil(abs(swept) / math.tau - _FULL)
        words = {}
        if self.program.language.spelling is not None and (turns > 1 or AXES[c] in self._own):
            plane = [a, b]
            angle, beside = _turn(math.degrees(swept), self._at[plane] - center, end[plane] - center)
            words["A"] = f"A{angle:+.{_ANGLE_DECIMALS}f}"
            center = center + beside
        for axis, count in ((a, center[0]), (b, center[1])):
            base = -shift[axis] if self.modal.arc_absolute else self._at[axis]
            # Where X is a diameter, I is none.
            words[_CENTERS[axis]] = _CENTERS[axis] + self._text(round(count - base / self._factors[axis]))
        own = self._own if self.program.language.whole is not None else {}
        spare = {letter: "" for letter in _CENTERS if letter in own and letter not in words}
        return {**words, **spare, "P": self.program.language.turns(turns) if turns > 1 else "", "R": ""}

    def _cubic_words(self, part: MotionPart, end: IntArray) -> dict[str, str]:
        control = split_cubic(self.program.motions.control[self.motion], [part.low, part.high])[0]
        inner = [self._steps(one, [True] * len(one)) for one in control[1:3].tolist()]
        return {
            "I": "I" + self._text(inner[0][0] - self._at[0]),
            "J": "J" + self._text(inner[0][1] - self._at[1]),
            "P": "P" + self._text(inner[1][0] - end[0]),
            "Q": "Q" + self._text(inner[1][1] - end[1]),
        }

    def radius(self, part: MotionPart) -> str:
        """Word of the radius of a part of an arc whose line gives one, and no centre; empty for others.

        Where lines of their own set centres, those would last beyond it.
        """
        kind, own = self.program.motions.kind[self.motion], self._own.get("R")
        if self.program.language.spelling is None or kind != ARC or own is None:
            return ""
        digits = self.program.data[self.program.words.start[own] + 1 : self.program.words.end[own]]
        turned = abs(float(self.program.motions.angle[self.motion])) * (part.high - part.low)
        return f"R{'-' if turned > math.pi else '+'}{digits.decode('latin-1').strip().lstrip('+-')}"

    @property
    def mode(self) -> str:
        """Word of the motion mode in which parts are written."""
        kind, motions = self.program.motions.kind[self.motion], self.program.motions
        if kind == ARC:
            return "G3" if motions.angle[self.motion] > 0.0 else "G2"
        return "G5" if kind == CUBIC else "G1"
