"""Check that every byte outside of changes is the original's, but for numbers that an offset shifts exactly."""

from __future__ import annotations

from decimal import Decimal
from functools import reduce
from itertools import product
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.compiling import compiled
from ph_post.gcode.program import (
    ARC,
    RAPID,
    CodeArray,
    PartProgram,
    PlaceArray,
    WordTable,
    span_of,
)
from ph_post.types import BoolArray, IntArray
from ph_post.units import MM
from ph_post.verify.declared import DeclaredLength
from ph_post.verify.line_pairs import NO_CHANGE, VerifyCase, as_mask
from ph_post.verify.verdict import quoted

_AXES = b"XYZ"
_CENTRES = b"IJK"
_POWERS = 18
"""The largest power of ten that an int64 holds."""

_TENS: IntArray = 10 ** np.arange(_POWERS + 1)
"""Powers of ten, as working them out takes long."""

_ROUNDED = 9
"""Decimals that are left of a number with so many that nothing can be added to them."""

_MOST = 1 << 61
"""Scaled numbers below this fit an int64 with room for their difference."""


EXACT = 1e-9
"""Lengths [m] that differ by no more are the same number."""

_DWELL = 4.0
"""G word of a dwell."""

_LINES = 20_000
"""So many pairs of lines are compared at a time, so that only what is known of their words is held."""


class _Side(NamedTuple):
    """Kind of the motion on each line of a program, -1 where there is none; where its comments begin.

    `centres` is true for lines on which the centre of an arc is a place.
    """

    kind: CodeArray
    comments: PlaceArray
    centres: BoolArray

    @classmethod
    def of(cls, program: PartProgram) -> _Side:
        """Look at a program."""
        kind = np.full(program.blocks, -1, dtype=np.int8)
        kind[program.motions.block] = program.motions.kind
        for line, arc in program.centre_lines.items():
            kind[line] = kind[arc]
        comments = np.flatnonzero(np.frombuffer(program.data, dtype=np.uint8) == ord("("))
        comments = comments if program.language.parentheses else comments[:0]
        return cls(kind, comments.astype(np.int32), program.absolute_centres())


class _Pairs(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Words of the lines that belong together, one to one: their rows among some words of each program."""

    one: WordTable
    other: WordTable
    old: IntArray
    new: IntArray

    def take(self, rows: IntArray | BoolArray) -> _Pairs:
        """Return some of the pairs."""
        return _Pairs(one=self.one, other=self.other, old=self.old[rows], new=self.new[rows])


def check_text(case: VerifyCase) -> tuple[WordTable, WordTable]:
    """Compare the lines outside changes, byte for byte, and numbers that differ with the declared offsets.

    Returns
    -------
    tuple of WordTable
        The words of both programs that other checks look at: those in changes, dwells, and words of further axes.
    """
    original, compensated, lines = case.original, case.compensated, case.lines
    sides = _Side.of(original), _Side.of(compensated)
    changes = lines.old_change, lines.new_change
    old, new = lines.outside()
    shifted, parts = 0, range(0, max(old.size, 1), _LINES)
    ends = [(0, 0), *((int(old[low]), int(new[low])) for low in parts[1:])]
    found: list[list[WordTable]] = [[], []]
    for low, first, last in zip(parts, ends, [*ends[1:], (original.blocks, compensated.blocks)], strict=True):
        words = original.source.part(first[0], last[0]), compensated.source.part(first[1], last[1])
        for own, program, part, change in zip(found, (original, compensated), words, changes, strict=True):
            own.append(part.take(_looked_at(program, part, change)))
        if old.size:
            shifted += _check_part(case, sides, (old[low : low + _LINES], new[low : low + _LINES]), words)
    case.findings.count("lines", old.size)
    case.findings.count("shifted words", shifted)
    foreign = compensated.data.find(b"\r") if b"\r" not in original.data else -1
    if foreign >= 0:
        line = int(np.searchsorted(compensated.lines, foreign, side="right")) - 1
        case.findings.add("text", "the line ends in another way than the original's", compensated=line)
    one, other = (reduce(WordTable.joined, own) for own in found)
    return one, other


def _looked_at(program: PartProgram, words: WordTable, change: NDArray[Any]) -> IntArray:
    """Return the rows of the words in changes, of lines with dwells, and of further axes."""
    dwells = words.block[words.g_words(_DWELL)]
    further = np.isin(np.arange(256), [ord(letter) for letter in program.language.further])
    found = (change[words.block] != NO_CHANGE) | further[words.letter]
    return np.flatnonzero(found | np.isin(words.block, dwells) if dwells.size else found)


def _check_part(
    case: VerifyCase,
    sides: tuple[_Side, _Side],
    lines: tuple[PlaceArray, PlaceArray],
    words: tuple[WordTable, WordTable],
) -> int:
    """Compare some pairs of lines, of which the words are given; returns how many of those are shifted."""
    original, compensated = case.original, case.compensated
    old, new = lines
    pairs = _shifted(case, sides, _pair_words(*words, old, new))
    _check_amounts(case, sides, pairs)
    chosen = zip(words, (pairs.old, pairs.new), strict=True)
    spans = tuple((own.start[rows] + np.int32(1), own.end[rows]) for own, rows in chosen)
    for place in _differing(case, lines, spans).tolist():
        first, second = int(old[place]), int(new[place])
        case.findings.add(
            "text",
            "the line differs outside what is declared",
            original=first,
            compensated=second,
            expected=quoted(original.text(first)),
            got=quoted(compensated.text(second)),
        )
    return pairs.old.size


def _pair_words(one: WordTable, other: WordTable, old_lines: PlaceArray, new_lines: PlaceArray) -> _Pairs:
    """Words of lines with the same letters; other lines are compared by their bytes."""
    both = ((one.block, old_lines), (other.block, new_lines))
    spans = [(span_of(block, lines[0])[0], span_of(block, lines[-1])[1]) for block, lines in both]
    own = [block[low:high] - lines[0] for (block, lines), (low, high) in zip(both, spans, strict=True)]
    chosen = [lines - lines[0] for _, lines in both]
    many = [np.bincount(block, minlength=lines[-1] + 1)[lines] for block, lines in zip(own, chosen, strict=True)]
    alike = many[0] == many[1]
    old, new = (
        low + np.flatnonzero(as_mask(int(lines[-1]) + 1, lines[alike])[block])
        for block, lines, (low, _) in zip(own, chosen, spans, strict=True)
    )
    return _Pairs(one=one, other=other, old=old, new=new)


def _changed(case: VerifyCase, sides: tuple[_Side, _Side], pairs: _Pairs) -> _Pairs:
    """Pairs of words of declared axes whose numbers are plain in both programs and differ (1.0 and 1. do not)."""
    one, other, axes = pairs.one, pairs.other, case.declared.offsets
    may = np.isin(np.arange(256), [ord(letter) for name in axes for letter in (name, chr(_centre(name)))])
    # These decide on most words, and the rest is looked up for few.
    letter = other.letter[pairs.new]
    different = one.value[pairs.old] != other.value[pairs.new]
    pairs = pairs.take(np.flatnonzero(may[letter] & (one.letter[pairs.old] == letter) & different))
    plain = (one.decimals[pairs.old] >= 0) & (other.decimals[pairs.new] >= 0)
    commented = _has_comment(sides[0], one, pairs.old) | _has_comment(sides[1], other, pairs.new)
    return pairs.take(np.flatnonzero(plain & ~commented))


def _shifted(case: VerifyCase, sides: tuple[_Side, _Side], pairs: _Pairs) -> _Pairs:
    """Pairs of words that an offset may have changed: those of declared axes, in blocks of motion."""
    pairs = _changed(case, sides, pairs)
    kind = sides[0].kind[pairs.one.block[pairs.old]]
    block, letter = pairs.other.block[pairs.new], pairs.other.letter[pairs.new]
    absolute, centres = _modes(case.compensated, "absolute", block), sides[1].centres[block]
    axis = np.isin(letter, [ord(name) for name in case.declared.offsets])
    centre = ~axis & centres & (kind == ARC)
    moving = (kind >= 0) & (sides[1].kind[block] >= 0)
    return pairs.take(np.flatnonzero(moving & ((axis & (absolute | (kind == RAPID))) | centre)))


def _centre(axis: str) -> int:
    """Letter of an arc's centre in the direction of an axis."""
    return _CENTRES[_AXES.index(ord(axis))]


def _modes(program: PartProgram, name: str, lines: PlaceArray) -> Any:
    """One mode after each of some lines."""
    return np.array([getattr(modal, name) for modal in program.modal])[program.state[lines]]


def _has_comment(side: _Side, words: WordTable, chosen: IntArray) -> BoolArray:
    """Mask of words with a comment between their letter and their digits."""
    if not side.comments.size:
        return np.zeros(chosen.size, dtype=np.bool_)
    first, last = (np.searchsorted(side.comments, ends[chosen]) for ends in (words.start, words.end))
    return np.asarray(first != last)


def _check_amounts(case: VerifyCase, sides: tuple[_Side, _Side], pairs: _Pairs) -> None:
    """Demand that each word differs by the declared offset, exactly; under G91 by a change of it.

    A rapid may end beyond its place by as much as a take-up move; the shift that it leaves, and the approach
    behind it, are checked with the motions.
    """
    letters, block = pairs.other.letter[pairs.new], pairs.other.block[pairs.new]
    units, absolute = (_modes(case.compensated, name, block) for name in ("units", "absolute"))
    diameters = case.compensated.language.diameters
    way = np.abs(pairs.other.value[pairs.new] - pairs.one.value[pairs.old]) * units
    way = np.where(diameters & (letters == ord("X")), 0.5 * way, way)
    rapid = sides[1].kind[block] == RAPID
    for axis, amount in case.declared.offsets.items():
        own = np.isin(letters, [ord(axis), _centre(axis)])
        if pulse := case.declared.pulses.get(axis):
            own &= ~(rapid & (way <= pulse.metres + 2.0 * amount.metres + EXACT))
        twice = 2 if diameters and axis == "X" else 1
        multiples = (((twice,), True), ((twice, 2 * twice), False))
        for unit, (steps, mode) in product(np.unique(units[own]).tolist(), multiples):
            which = np.flatnonzero(own & (units == unit) & (absolute == mode))
            chosen = pairs.take(which)
            for place in np.flatnonzero(~_differ_by(case, chosen, amount, steps, unit)).tolist():
                _report_word(case, chosen, place, amount)


def _differ_by(
    case: VerifyCase, pairs: _Pairs, amount: DeclaredLength, steps: tuple[int, ...], unit: float
) -> BoolArray:
    """Mask of words that differ by one of the multiples of the amount, to the last digit, or the last that is left."""
    one, other = pairs.one, pairs.other
    if unit != amount.unit:
        grid = 0.5 * 10.0 ** -(case.declared.decimals or 0) * max(unit, MM)
        way = np.abs(other.value[pairs.new] - one.value[pairs.old]) * unit
        return np.asarray(np.any([np.abs(way - step * amount.metres) <= grid for step in steps], axis=0))
    number, places = _as_integer(amount.number)
    before, after = one.decimals[pairs.old], other.decimals[pairs.new]
    numbers = one.digits_of(pairs.old), other.digits_of(pairs.new)
    largest = np.maximum(np.abs(one.value[pairs.old]), np.abs(other.value[pairs.new])) + float(amount.number)
    right, fits = _differ_exactly(*numbers, before, after, largest, np.array(steps), min(number, _MOST), places)
    for place in np.flatnonzero(~fits).tolist():
        way_there = abs(_difference(case, pairs, place))
        most = Decimal(5).scaleb(-_ROUNDED - 1) if before[place] > _ROUNDED and after[place] == _ROUNDED else 0
        right[place] = min(abs(way_there - step * amount.number) for step in steps) <= most
    return np.asarray(right)


@compiled
def _differ_exactly(
    one: Any, other: Any, before: Any, after: Any, largest: Any, steps: Any, number: int, places: int
) -> Any:
    """Masks (n,) of the numbers that differ by one of the steps of another, and of those that integers can say it of.

    `one` and `other` are digits with `before` and `after` decimals, `number` those of a step, with `places`; `largest`
    is no less than any of them. Of a number with so many decimals that they were rounded half the last one is spare.
    """
    right, fits = np.zeros(one.size, np.bool_), np.zeros(one.size, np.bool_)
    for n in range(one.size):
        scale: Any = np.int64(max(before[n], after[n], places))
        fits[n] = scale <= _POWERS and largest[n] * _TENS[min(scale, _POWERS)] < _MOST
        if not fits[n]:
            continue
        way = abs(other[n] * _TENS[scale - after[n]] - one[n] * _TENS[scale - before[n]])
        spare = _TENS[scale - _ROUNDED] // 2 if before[n] > _ROUNDED and after[n] == _ROUNDED else 0
        for step in steps:
            right[n] |= abs(way - step * number * _TENS[scale - places]) <= spare
    return right, fits


def _as_integer(number: Decimal) -> tuple[int, int]:
    """Return a decimal as digits and number of decimals."""
    places = max(0, -int(number.as_tuple().exponent))
    return int(number.scaleb(places)), places


def _difference(case: VerifyCase, pairs: _Pairs, place: int) -> Decimal:
    """Return what a number was changed by, however long it is, from its bytes."""
    sides = ((case.original, pairs.one, pairs.old), (case.compensated, pairs.other, pairs.new))
    before, after = (
        Decimal(b"".join(program.data[words.start[rows[place]] + 1 : words.end[rows[place]]].split()).decode())
        for program, words, rows in sides
    )
    return after - before


def _report_word(case: VerifyCase, pairs: _Pairs, place: int, amount: DeclaredLength) -> None:
    old, new = int(pairs.old[place]), int(pairs.new[place])
    letter = chr(pairs.other.letter[new])
    case.findings.add(
        "offset",
        f"{letter} is shifted by something other than the declared offset",
        original=int(pairs.one.block[old]),
        compensated=int(pairs.other.block[new]),
        expected=f"+ or - {amount.number}",
        got=f"{_difference(case, pairs, place)}",
    )


def _differing(
    case: VerifyCase, lines: tuple[PlaceArray, PlaceArray], spans: tuple[tuple[PlaceArray, PlaceArray], ...]
) -> IntArray:
    """Pairs of lines, by place among them, that are not the same but for the numbers at `spans`."""
    programs = case.original, case.compensated
    (one, first), (other, second) = (
        (np.frombuffer(program.data, dtype=np.uint8), np.column_stack([program.lines[own], program.lines[own + 1]]))
        for program, own in zip(programs, lines, strict=True)
    )
    if case.lines.ends and lines[0][-1] == case.original.blocks - 1:
        text = case.compensated.text(int(lines[1][-1]))
        second[-1, 1] -= len(text) - len(text.rstrip(b"\r\n"))
    return np.flatnonzero(_differ(one, first, *spans[0], other, second, *spans[1]))


@compiled
def _differ(
    one: Any, first: Any, starts: Any, ends: Any, other: Any, second: Any, other_starts: Any, other_ends: Any
) -> Any:
    """Mask (n,) of the pairs of lines, each from a byte to before another, that differ outside spans in order."""
    found = np.zeros(first.shape[0], np.bool_)
    p, q = 0, 0
    for line in range(first.shape[0]):
        i, j = np.int64(first[line, 0]), np.int64(second[line, 0])
        last, other_last = np.int64(first[line, 1]), np.int64(second[line, 1])
        while p < starts.size and starts[p] < i:
            p += 1
        while q < other_starts.size and other_starts[q] < j:
            q += 1
        while True:
            if p < starts.size and i == starts[p]:
                i, p = np.int64(ends[p]), p + 1
            elif q < other_starts.size and j == other_starts[q]:
                j, q = np.int64(other_ends[q]), q + 1
            elif i < last and j < other_last and one[i] == other[j]:
                i, j = i + 1, j + 1
            else:
                break
        found[line] = i < last or j < other_last
    return found
