"""Outside hunks every byte is the original's, but for numbers that an offset shifts, and those exactly."""

from __future__ import annotations

from decimal import Decimal
from itertools import product
from typing import Any

import msgspec
import numpy as np

from ph_post.audit.align import Alignment, as_mask
from ph_post.audit.case import Case
from ph_post.audit.declared import Amount
from ph_post.audit.verdict import shown
from ph_post.gcode.reader.record import ARC, RAPID, PartProgram
from ph_post.types import BoolArray, IntArray
from ph_post.units import MM

_AXES = b"XYZ"
_CENTRES = b"IJK"
_POWERS = 18
"""The largest power of ten that an int64 holds."""

_SAFE = 2.0**61
"""Scaled numbers below this fit an int64 with room for their difference."""


class _Pairs(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Words of the lines that belong together, one to one: their numbers in each program."""

    old: IntArray
    new: IntArray


def check_wording(case: Case) -> None:
    """Compare the lines outside hunks, byte for byte, and numbers that differ with the declared offsets."""
    original, compensated, lines = case.original, case.compensated, case.lines
    pairs = _pair_words(original, compensated, lines)
    shifted = _may_shift(case, pairs)
    pairs = _Pairs(old=pairs.old[shifted], new=pairs.new[shifted])
    case.findings.count("lines", lines.old.size)
    case.findings.count("shifted words", pairs.old.size)
    _check_amounts(case, pairs)
    old_kept = _kept(original, lines.old, pairs.old)
    new_kept = _kept(compensated, lines.new, pairs.new)
    if lines.ends and lines.new.size and lines.old[-1] == original.blocks - 1:
        text, stop = compensated.text(int(lines.new[-1])), int(compensated.lines[lines.new[-1] + 1])
        new_kept[stop - (len(text) - len(text.rstrip(b"\r\n"))) : stop] = False
    foreign = compensated.data.find(b"\r") if b"\r" not in original.data else -1
    if foreign >= 0:
        line = int(np.searchsorted(compensated.lines, foreign, side="right")) - 1
        case.findings.add("text", "the line ends in another way than the original's", compensated=line)
    for place in _differing(case, old_kept, new_kept).tolist():
        old, new = int(lines.old[place]), int(lines.new[place])
        case.findings.add(
            "text", "the line differs outside what is declared", original=old, compensated=new,
            expected=shown(original.text(old)), got=shown(compensated.text(new)),
        )  # fmt: skip


def _pair_words(original: PartProgram, compensated: PartProgram, lines: Alignment) -> _Pairs:
    """Words of lines with the same letters; the others are told by their bytes."""
    many = [
        np.bincount(program.words.block, minlength=program.blocks)[chosen]
        for program, chosen in ((original, lines.old), (compensated, lines.new))
    ]
    alike = many[0] == many[1]
    old = np.flatnonzero(as_mask(original.blocks, lines.old[alike])[original.words.block])
    new = np.flatnonzero(as_mask(compensated.blocks, lines.new[alike])[compensated.words.block])
    return _Pairs(old=old, new=new)


def _changed(original: PartProgram, compensated: PartProgram, pairs: _Pairs) -> BoolArray:
    """Words whose numbers are plain in both programs and differ (1.0 and 1. do not)."""
    one, other = original.words, compensated.words
    plain = (one.decimals[pairs.old] >= 0) & (other.decimals[pairs.new] >= 0)
    same_letter = one.letter[pairs.old] == other.letter[pairs.new]
    commented = _has_comment(original, pairs.old) | _has_comment(compensated, pairs.new)
    return np.asarray(plain & same_letter & ~commented & (one.value[pairs.old] != other.value[pairs.new]))


def _may_shift(case: Case, pairs: _Pairs) -> BoolArray:
    """Find the words that an offset may have changed: those of declared axes, in blocks of motion."""
    original, compensated = case.original, case.compensated
    kind = _kind_of_lines(original)[original.words.block[pairs.old]]
    block = compensated.words.block[pairs.new]
    letter = compensated.words.letter[pairs.new]
    absolute, centres = (_modes(compensated, name)[block] for name in ("absolute", "arc_absolute"))
    axis = np.isin(letter, [ord(name) for name in case.declared.offsets])
    centre = np.isin(letter, [_centre(name) for name in case.declared.offsets]) & centres & (kind == ARC)
    moving = (kind >= 0) & (_kind_of_lines(compensated)[block] >= 0)
    changed = _changed(original, compensated, pairs)
    return np.asarray(changed & moving & ((axis & (absolute | (kind == RAPID))) | centre))


def _centre(axis: str) -> int:
    """Letter of an arc's centre in the direction of an axis."""
    return _CENTRES[_AXES.index(ord(axis))]


def _modes(program: PartProgram, name: str) -> Any:
    """One mode after each line."""
    return np.array([getattr(modal, name) for modal in program.modal])[program.state]


def _has_comment(program: PartProgram, words: IntArray) -> BoolArray:
    """Words with a comment between their letter and their digits."""
    comments = np.flatnonzero(np.frombuffer(program.data, dtype=np.uint8) == ord("("))
    first, last = (
        np.searchsorted(comments, ends[words]) for ends in (program.words.start, program.words.end)
    )
    return np.asarray(first != last)


def _kind_of_lines(program: PartProgram) -> IntArray:
    """Kind of the motion on each line, -1 where there is none."""
    kind = np.full(program.blocks, -1, dtype=np.int64)
    kind[program.motions.block] = program.motions.kind
    return kind


def _check_amounts(case: Case, pairs: _Pairs) -> None:
    """Demand that each word differs by the declared offset, exactly; under G91 by a change of it."""
    letters = case.compensated.words.letter[pairs.new]
    block = case.compensated.words.block[pairs.new]
    units, absolute = (_modes(case.compensated, name)[block] for name in ("units", "absolute"))
    for axis, amount in case.declared.offsets.items():
        own = np.isin(letters, [ord(axis), _centre(axis)])
        for unit, (steps, mode) in product(np.unique(units[own]).tolist(), (((1,), True), ((1, 2), False))):
            which = np.flatnonzero(own & (units == unit) & (absolute == mode))
            chosen = _Pairs(old=pairs.old[which], new=pairs.new[which])
            for place in np.flatnonzero(~_differ_by(case, chosen, amount, steps, unit)).tolist():
                _tell_word(case, int(chosen.old[place]), int(chosen.new[place]), amount)


def _differ_by(case: Case, pairs: _Pairs, amount: Amount, steps: tuple[int, ...], unit: float) -> BoolArray:
    """Which words differ by one of the multiples of the amount, to the last digit."""
    one, other = case.original.words, case.compensated.words
    if unit != amount.unit:
        grid = 0.5 * 10.0 ** -(case.declared.decimals or 0) * max(unit, MM)
        way = np.abs(other.value[pairs.new] - one.value[pairs.old]) * unit
        return np.asarray(np.any([np.abs(way - step * amount.metres) <= grid for step in steps], axis=0))
    number, places = _as_integer(amount.number)
    decimals = np.maximum(np.maximum(one.decimals[pairs.old], other.decimals[pairs.new]), places)
    largest = np.maximum(np.abs(one.value[pairs.old]), np.abs(other.value[pairs.new])) + float(amount.number)
    fits = (decimals <= _POWERS) & (largest * 10.0 ** np.minimum(decimals, _POWERS) < _SAFE)
    scale = np.where(fits, decimals, _POWERS)
    with np.errstate(over="ignore"):
        way = other.digits[pairs.new] * 10 ** np.maximum(scale - other.decimals[pairs.new], 0)
        way = np.abs(way - one.digits[pairs.old] * 10 ** np.maximum(scale - one.decimals[pairs.old], 0))
        right = fits & np.any([way == step * number * 10 ** (scale - places) for step in steps], axis=0)
    for place in np.flatnonzero(~fits).tolist():
        way_there = _way(case, int(pairs.old[place]), int(pairs.new[place]))
        right[place] = abs(way_there) in [step * amount.number for step in steps]
    return np.asarray(right)


def _as_integer(number: Decimal) -> tuple[int, int]:
    """Return a decimal as digits and number of decimals."""
    places = max(0, -int(number.as_tuple().exponent))
    return int(number.scaleb(places)), places


def _way(case: Case, old: int, new: int) -> Decimal:
    """Return what a number was changed by, however long it is, from its bytes."""
    before, after = (
        Decimal(
            b"".join(program.data[program.words.start[word] + 1 : program.words.end[word]].split()).decode()
        )
        for program, word in ((case.original, old), (case.compensated, new))
    )
    return after - before


def _tell_word(case: Case, old: int, new: int, amount: Amount) -> None:
    letter = chr(case.compensated.words.letter[new])
    case.findings.add(
        "offset", f"{letter} is shifted by something else than the declared offset",
        original=int(case.original.words.block[old]), compensated=int(case.compensated.words.block[new]),
        expected=f"+ or - {amount.number}", got=f"{_way(case, old, new)}",
    )  # fmt: skip


def _kept(program: PartProgram, lines: IntArray, without: IntArray) -> BoolArray:
    """Mark the bytes of the lines, without the numbers of some words."""
    kept = np.repeat(as_mask(program.blocks, lines), np.diff(program.lines))
    if without.size:
        turns = np.zeros(kept.size + 1, dtype=np.int8)
        turns[program.words.start[without] + 1] += 1
        turns[program.words.end[without]] -= 1
        kept &= np.cumsum(turns[:-1], dtype=np.int8) == 0
    return kept


def _differing(case: Case, old_kept: BoolArray, new_kept: BoolArray) -> IntArray:
    """Pairs of lines whose kept bytes are not the same."""
    original, compensated, lines = case.original, case.compensated, case.lines
    one = np.frombuffer(original.data, dtype=np.uint8)[old_kept]
    other = np.frombuffer(compensated.data, dtype=np.uint8)[new_kept]
    old_size = np.add.reduceat(np.append(old_kept, False), original.lines[:-1], dtype=np.int64)[lines.old]
    new_size = np.add.reduceat(np.append(new_kept, False), compensated.lines[:-1], dtype=np.int64)[lines.new]
    if not old_size.size:
        return np.zeros(0, dtype=np.int64)
    alike = old_size == new_size
    one = one[np.repeat(alike, old_size)]
    other = other[np.repeat(alike, new_size)]
    begins = np.cumsum(old_size[alike]) - old_size[alike]
    wrong = np.unique(np.searchsorted(begins, np.flatnonzero(one != other), side="right") - 1)
    return np.union1d(np.flatnonzero(~alike), np.flatnonzero(alike)[wrong])
