"""Axes beside X, Y and Z: which lines move them, from where and to where."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np

from ph_post.gcode import codes
from ph_post.gcode.codes import QUIET, takes_axes
from ph_post.gcode.program import RAPID, PartProgram, PlaceArray
from ph_post.types import ROTARY_AXES, Array, BoolArray, IntArray, sealed
from ph_post.units import DEGREE

_FRAMES: Final = (92.1, 92.2, 92.3)
"""G words that move the zeros of all axes, whichever their line names."""

_HOMES: Final = (28.0, 30.0)
"""G words that move all axes where their line names none."""

_TOOLS: Final = (6.0, 60.0, 61.0)
"""M words that may move anything."""


_NAMED: Final = (
    codes.COMPENSATED,
    codes.CYCLE,
    codes.ARC_FROM_NOWHERE,
    codes.SPLINE_FROM_NOWHERE,
    codes.THREAD,
    codes.STAYING_G,
    codes.STAYING_M,
)
"""Why lines are passed through that move no axis that they do not name, and change no mode."""


class FurtherMoves(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The moves of one axis beside X, Y and Z, n of them, in order. SI units: rad of A, B and C, m of U, V and W.

    `block` the line of each; `word` its word; `start`, `end` its places, NaN where not known; `absolute` under G90;
    `rapid`; `alone` where the line moves nothing else. `chain` is the number of the stretch of lines in which the axis
    goes from place to place: `ends` (c,) is for each the line before which nothing that was added may last, and
    `placed` (c,) false where it moves by increments alone, from anywhere: its places are counted from there then.
    """

    block: IntArray
    word: IntArray
    start: Array
    end: Array
    absolute: BoolArray
    rapid: BoolArray
    alone: BoolArray
    chain: IntArray
    ends: IntArray
    placed: BoolArray


def unit_of(letter: str, units: float) -> float:
    """Return the SI unit of the words of an axis: a degree [rad], or the program's unit of lengths [m]."""
    return DEGREE if letter in ROTARY_AXES else units


@lru_cache(maxsize=4)
def further_words(program: PartProgram) -> IntArray:
    """Return the numbers of the words of the axes beside X, Y and Z that a program's language has."""
    letters = [ord(letter) for letter in program.language.further]
    if not np.isin(program.commands.letter, letters).any():
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(np.isin(program.words.letter, letters))


@lru_cache(maxsize=4)
def further_lines(program: PartProgram) -> Mapping[int, str]:
    r"""Return the lines whose motion moves axes beside X, Y and Z as well, with the letters of those.

    Examples
    --------
    >>> from ph_post.gcode.read import read_program
    >>> dict(further_lines(read_program(b"G0 A90\nG1 X5 A0 F100\nM2\n", "a.ngc")))
    {1: 'A'}
    """
    found = further_words(program)
    if not found.size:
        return {}
    words = program.words
    own = found[np.isin(words.block[found], program.motions.block)]
    letters: dict[int, str] = {}
    for word in own.tolist():
        letters[int(words.block[word])] = letters.get(int(words.block[word]), "") + chr(words.letter[word])
    return letters


@lru_cache(maxsize=4)
def further_moves(program: PartProgram) -> Mapping[str, FurtherMoves]:
    r"""Return the moves of all axes beside X, Y and Z, by letter.

    Examples
    --------
    >>> from ph_post.gcode.read import read_program
    >>> moves = further_moves(read_program(b"G0 A90\nG1 X5 A45 F100\nM2\n", "a.ngc"))["A"]
    >>> moves.block.tolist(), moves.alone.tolist(), (moves.end / DEGREE).round(9).tolist()
    ([0, 1], [True, False], [90.0, 45.0])
    """
    found = further_words(program)
    if not found.size:
        return {}
    words = program.words
    bounds = _bounds(program)
    return {
        chr(letter): _moves_of(program, chr(letter), found[words.letter[found] == letter], bounds)
        for letter in np.unique(words.letter[found]).tolist()
    }


def _moves_of(program: PartProgram, letter: str, found: PlaceArray, lost: IntArray) -> FurtherMoves:
    words, motions, last = program.words, program.motions, program.breaks[-1].block
    found = found[words.block[found] < max(last, 1)] if last < program.blocks else found
    blocks = words.block[found]
    cuts = np.isin(blocks, motions.block)
    moves = cuts | _lone(program, blocks)
    bounds = np.unique(np.concatenate([lost, blocks[~moves], [last]])).astype(np.int64)
    block, word, beside = blocks[moves].astype(np.int64), found[moves].astype(np.int64), cuts[moves]
    modal = [program.modal[n] for n in program.state[block].tolist()]
    chain = np.searchsorted(bounds, block, side="right")
    absolute = np.array([one.absolute for one in modal], dtype=np.bool_)
    rapid = np.array([one.motion == "G0" for one in modal], dtype=np.bool_)
    rapid[beside] = motions.kind[np.searchsorted(motions.block, block[beside].astype(np.int32))] == RAPID
    units = np.array([unit_of(letter, one.units) for one in modal])
    start, end = _places(words.value[word] * units, absolute, chain)
    every = words.block[further_words(program)]
    chains = np.unique(chain)
    several = np.bincount(every, minlength=program.blocks)[block] > 1
    return FurtherMoves(
        block=sealed(block),
        word=sealed(word),
        start=sealed(start),
        end=sealed(end),
        absolute=sealed(absolute),
        rapid=sealed(rapid),
        alone=sealed(~beside & ~several),
        chain=sealed(np.searchsorted(chains, chain)),
        ends=sealed(bounds[chains]),
        placed=sealed(np.isin(chains, chain[absolute])),
    )


def _lone(program: PartProgram, blocks: PlaceArray) -> BoolArray:
    """Mask of the lines, of those that name an axis, on which X, Y and Z rest and nothing else takes the word."""
    found = np.array([program.modal[n].motion in ("G0", "G1") for n in program.state[blocks].tolist()], dtype=np.bool_)
    for note in program.notes:
        if note.why < QUIET:
            found &= (blocks < note.first) | (blocks > note.last)
    words = program.words
    taking = np.flatnonzero(words.letter == ord("G"))
    values = np.unique(words.value[taking])
    odd = [value for value in values.tolist() if takes_axes(value) or value == 53.0]
    return found & ~np.isin(blocks, words.block[taking[np.isin(words.value[taking], odd)]])


def _bounds(program: PartProgram) -> IntArray:
    """Lines at which the place of every further axis may change, or be called something else."""
    words = program.words
    g, m = words.letter == ord("G"), words.letter == ord("M")
    found = [words.block[(m & np.isin(words.value, _TOOLS)) | (g & np.isin(words.value, _FRAMES))]]
    named = np.isin(words.letter, [ord(letter) for letter in "XYZABCUVW"])
    homes = words.block[g & np.isin(words.value, _HOMES)]
    found.append(homes[~np.isin(homes, words.block[named])])
    system = np.array([modal.system or "" for modal in program.modal])[program.state]
    found.append(np.flatnonzero(system[1:] != system[:-1]) + 1)
    passed = [np.arange(one.first, one.last + 1) for one in program.notes if one.why not in _NAMED and one.why < QUIET]
    return np.concatenate([*found, *passed]).astype(np.int64)


def _places(value: Array, absolute: BoolArray, chain: IntArray) -> tuple[Array, Array]:
    """Places before and behind each move; a chain of increments alone begins anywhere."""
    start, end, at, number = np.empty(value.size), np.empty(value.size), np.nan, -1
    placed = set(chain[absolute].tolist())
    for n in range(value.size):
        if chain[n] != number:
            number = int(chain[n])
            at = np.nan if number in placed else 0.0
        start[n] = at
        at = value[n] if absolute[n] else at + value[n]
        end[n] = at
    return start, end
