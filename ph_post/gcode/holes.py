"""Holes of drilling cycles: the lines that bring X and Y to them, and where the axes come from.

A cycle that drills in Z goes to its hole in a rapid of X and Y alone, at the height at which the tool is or in the
plane R, and X and Y rest there until the next one (NIST's RS274/NGC interpreter, version 3, 3.5.16; FANUC B-64484EN-2,
"Canned cycle for drilling"). Whatever it does in Z, the words of X and Y mean a place at which the axes stand.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import msgspec
import numpy as np

from ph_post.gcode import codes
from ph_post.gcode.program import AXES, LINE, RAPID, PartProgram

ACROSS: Final = AXES[:2]
"""The axes that bring the tool over a hole."""

TAPS: Final = (74.0, 84.0)
"""Cycles that turn the spindle with Z."""

_CYCLES: Final = (73.0, 81.0, 82.0, 83.0, 85.0, 86.0, 89.0, *TAPS)
"""Cycles in which X and Y rest while the tool is in the hole; in G76 and G87 they do not, in G88 a person moves."""

_BESIDE: Final = (90.0, 98.0, 99.0)
_LETTERS: Final = frozenset("FGKLMNPQRSXYZ")
_QUIET_M: Final = (0.0, 1.0, 3.0, 4.0, 5.0, 7.0, 8.0, 9.0, 48.0, 49.0)
_ENDS: Final = (2.0, 30.0)
_FRAMES: Final = (7.0, 12.1, 16.0, 43.4, 43.5, 51.0, 51.1, 68.0, 68.2, 68.3, 68.4)
"""G words behind which X and Y may be no places of their axes."""

_PASSED: Final = (
    *(0.0, 1.0, 4.0, 17.0, 18.0, 19.0, 20.0, 21.0, 28.0, 30.0, 40.0, 43.0, 49.0, 53.0, 54.0, 55.0, 56.0, 57.0, 58.0),
    *(59.0, 61.0, 64.0, 80.0, 90.0, 91.0, 94.0, 95.0, 96.0, 97.0, 98.0, 99.0),
)
"""G words that take no place from where the axes are, but for a motion in increments."""

_HOMES: Final = (28.0, 30.0)
_PLACES: Final = (*_HOMES, 53.0)

_OTHER: Final = codes.PARAMETER
"""Stands for a reason without a number."""

_KEEP_MODES: Final = (
    *(codes.CYCLE, codes.COMPENSATED, codes.ARC_FROM_NOWHERE, codes.SPLINE_FROM_NOWHERE, codes.THREAD),
    *(codes.STAYING_G, codes.STAYING_M, codes.FURTHER_AXIS, codes.ROTARY_PAIR, codes.NO_MOTION_MODE),
)
"""Why lines are passed through behind which the modes are known."""


class Hole(msgspec.Struct, frozen=True, kw_only=True):
    """A line of a cycle that drills; `words` are the numbers of its words by letter, but G and M."""

    block: int
    words: Mapping[str, int]


class HoleRun(msgspec.Struct, frozen=True, kw_only=True):
    """Lines from `first` to `last` that drill holes, one after the other, with nothing between that moves.

    `cycle` is the number of the first one's G word, None where the line has none; `why` says why nothing may be changed
    in them; empty where it may.
    """

    first: int
    last: int
    cycle: float | None
    holes: tuple[Hole, ...]
    why: str = ""


def hole_runs(program: PartProgram) -> list[HoleRun]:
    r"""Return the runs of lines that drill, in order.

    Examples
    --------
    >>> from ph_post.gcode.read import read_program
    >>> text = b"G21 G90\nG0 X0 Y0 Z5\nG81 X1 Y1 Z-3 R2 F60\nM8\nX2\nG80\nM2\n"
    >>> [(one.first, one.last, len(one.holes), one.why) for one in hole_runs(read_program(text, "a.ngc"))]
    [(2, 4, 2, '')]
    """
    spans: list[list[int]] = []
    cycles = [note for note in program.notes if note.why == codes.CYCLE]
    if not cycles or program.language.diameters:
        # A lathe's cycles turn, and its holes are where X rests.
        return []
    lines = _Lines(program)
    for note in cycles:
        if spans and _rests(lines, spans[-1][1] + 1, note.first):
            spans[-1][1] = note.last
        else:
            spans.append([note.first, note.last])
    everywhere = ""
    if program.commands.g_words(*_FRAMES).any():
        everywhere = "a frame is turned, scaled or polar somewhere in the program"
    return [_run(lines, first, last, everywhere) for first, last in spans]


def place_before(program: PartProgram, block: int, axis: str) -> float:
    """Return where an axis is before a line [m]; NaN where that is not known."""
    motions = program.motions
    last = int(np.searchsorted(motions.block, np.int32(block))) - 1
    if last < 0 or any(one.motion == last + 1 and one.block < block for one in program.breaks):
        return float("nan")
    return float(motions.end[last, AXES.index(axis)])


def goes_on(program: PartProgram, last: int, axes: frozenset[str]) -> int | None:
    """Return the first line behind line `last` that goes on from where axes are; None where places come before.

    Behind it the axes may be anywhere: words of absolute places, home or the end of the program come first.
    """
    lines, left = _Lines(program), set(axes)
    # At the end of a program nothing moves any more.
    for block in range(last + 1, min(program.breaks[-1].block, program.blocks)):
        letters, g, m = lines.of(block)
        if not (letters or g or m):
            continue
        why = lines.why(block)
        named = left & letters
        odd = why not in (0, codes.CYCLE, codes.STAYING_G, codes.STAYING_M) and why < codes.QUIET
        passed = set(g) <= {*_PASSED, *(_CYCLES if why == codes.CYCLE else ())}
        if odd or not passed or not set(m) <= {*_QUIET_M, *_ENDS, 6.0} or letters & {"U", "V", "W"}:
            return block
        placed = bool(set(g) & {*_PLACES})
        moving = lines.motion(block)
        if set(g) & {*_HOMES} and not letters & set(AXES):
            named = set(left)
        elif named and not placed:
            if not program.modal_after(block).absolute or not (why == codes.CYCLE or moving in (RAPID, LINE)):
                return block
        elif moving not in (None, RAPID, LINE):
            return block
        left -= named
        if not left or set(m) & {*_ENDS}:
            return None
    return None


class _Lines:
    """The words of single lines, and why those are not understood."""

    def __init__(self, program: PartProgram) -> None:
        self.program = program
        # What a reader of a language of its own says has no number.
        self._why = np.zeros(program.blocks, dtype=np.int64)
        for note in program.notes:
            part = self._why[note.first : note.last + 1]
            np.maximum(part, note.why or _OTHER, out=part)

    def of(self, block: int) -> tuple[set[str], list[float], list[float]]:
        """Return the letters on a line, and the numbers of its G words and of its M words."""
        words = self.program.words
        rows = list(self.program.words_of(block))
        letters = [chr(words.letter[row]) for row in rows]
        values = [float(words.value[row]) for row in rows]
        g, m = (
            [value for letter, value in zip(letters, values, strict=True) if letter == wanted] for wanted in ("G", "M")
        )
        return set(letters), g, m

    def why(self, block: int) -> int:
        """Return why a line is not understood, 0 where it is."""
        return int(self._why[block])

    def motion(self, block: int) -> int | None:
        """Return the kind of a line's motion, None where it has none."""
        motions = self.program.motions
        low, high = np.searchsorted(motions.block, np.array([block, block + 1], dtype=np.int32)).tolist()
        return int(motions.kind[high - 1]) if high > low else None

    def said(self, block: int) -> bool:
        """Return whether a line says G90 behind all before this one that may have left it; so of G17, if one may."""
        unsure = np.flatnonzero((self._why[:block] < codes.QUIET) & ~np.isin(self._why[:block], (0, *_KEEP_MODES)))
        since = int(unsure.max(initial=-1))
        commands = self.program.commands
        after = (commands.block > since) & (commands.block <= block)
        if not (commands.g_words(90.0) & after).any():
            return False
        return since < 0 or bool((commands.g_words(17.0) & after).any())


def _rests(lines: _Lines, first: int, last: int) -> bool:
    """Return whether nothing moves, and no mode changes, on the lines from `first` to before `last`."""
    for block in range(first, last):
        letters, g, m = lines.of(block)
        if lines.why(block) or g or not letters <= set("FMNS") or not set(m) <= {*_QUIET_M}:
            return False
    return True


def _run(lines: _Lines, first: int, last: int, why: str) -> HoleRun:
    """Return a run of lines that drill, and why nothing may be changed in it."""
    program, holes, cycle = lines.program, list[Hole](), None
    words = program.words
    begun = False
    for block in range(first, last + 1):
        letters, g, m = lines.of(block)
        if not letters:
            continue
        why = why or _why_not(lines, block, letters, g, m)
        if not begun:
            cycle, begun = next((value for value in g if value in _CYCLES), None), True
            why = why or ("" if cycle is not None and {"R", "Z"} <= letters else "they begin without G word, Z or R")
        own = {chr(words.letter[row]): row for row in program.words_of(block) if words.letter[row] not in b"GM"}
        if letters & {*AXES, "R"}:
            holes.append(Hole(block=block, words=own))
        if any(words.decimals[own[letter]] < 0 for letter in own):
            why = why or "a word is computed"
        if any(not words.value[own[letter]] >= 1.0 for letter in {"K", "L"} & own.keys()):
            why = why or "nothing is drilled on a line (L0 or K0)"
    if not why and not lines.said(first):
        why = "no line says G90 since it may have been left"
    return HoleRun(first=first, last=last, cycle=cycle, holes=tuple(holes), why=why)


def _why_not(lines: _Lines, block: int, letters: set[str], g: list[float], m: list[float]) -> str:
    """Return why a line of a run stands in the way of changes; empty where it does not."""
    modal = lines.program.modal_after(block)
    if not modal.absolute:
        return "they are in increments (G91)"
    if modal.plane != 17:
        return "they are not drilled along Z"
    if set(g) & {76.0, 87.0, 88.0} or modal.motion in ("G76", "G87", "G88"):
        return "X and Y move in the hole (G76, G87), or a person moves them (G88)"
    odd = not set(g) <= {*_CYCLES, *_BESIDE} or not letters <= _LETTERS or not set(m) <= {*_QUIET_M}
    return f"{lines.program.line_words(block)} does more than to drill" if odd else ""
