"""Divide the filament of a line between the parts of its motion, in proportion to the original way.

Where E words stand for the place of the filament (M82) and where for a step of it (M83) has to be known for certain,
as one taken for the other would push out a spool. G90 and G91 set E too in Marlin, and none in Klipper but that E is a
step wherever G91 is (`gcode.cpp` of Marlin, `gcode_move.py` of Klipper): so a line is divided only where its mode was
named by M82 or M83 behind the last G90 or G91, or where G90 stands behind it without changing it in either. A program
that names none, and what stands behind a macro of Klipper, shows what E words are where as the other they would be no
print.
"""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Mapping
from functools import lru_cache
from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.dialects.printers import brought_back, returns
from ph_post.gcode.motion_parts import chord_lengths
from ph_post.gcode.numbers import LINE_START, decimal_text, line_fed
from ph_post.gcode.program import PartProgram
from ph_post.types import Array, IntArray
from ph_post.units import MM

DECIMALS: Final = 5
"""Least decimals of a divided E: 10 nm of filament."""

BEADS: Final = 20
"""Lines that extrude and move from which on their E words show what they are."""

RISING: Final = 0.95
"""Part of those lines that change E by which it grows, where E words are places."""

THINNEST: Final = 2e-3
"""Filament for a way [mm/mm] that is less than any bead has: of 1.75 mm it is one of 0.005 mm²."""

SPOOLED: Final = 5.0
"""Filament for a way [mm/mm] that no bead has: of 1.75 mm it is one of 12 mm²."""

_NUMBER: Final = rb"[-+]?(?:\d+\.?\d*|\.\d+)"
_ROOM: Final = 100
"""Characters of the longest number that is divided."""

_WORD: Final = re.compile(rb"[Ee][ \t]*(" + _NUMBER + rb")")
_MODES: Final = frozenset(("M82", "M83", "G90", "G91"))
_NAMES_MODE: Final = re.compile(LINE_START + rb"[Mm][ \t]*0*8[23](?![\d.])")
_COMMAND: Final = re.compile(LINE_START + rb"([Gg][ \t]*0*(?:[0-3]|9[012])|[Mm][ \t]*0*8[23])(?![\d.])([^\r\n;]*)")
_MODE_INSIDE: Final = re.compile(rb"(?:M[ \t]*0*8[23]|G[ \t]*0*9[01])(?![\d.])", re.IGNORECASE)
"""A word that may set what E words are, wherever it stands in a line."""


class Filament(msgspec.Struct, frozen=True, kw_only=True):
    """What one line extrudes: `digits` / 10^`decimals`, from `start` on; `relative` where it is a step."""

    start: int
    digits: int
    decimals: int
    relative: bool

    def word(self, low: float, high: float) -> str:
        """Return the E word of a part of the motion between two shares of its length.

        Examples
        --------
        >>> Filament(start=100000, digits=300000, decimals=5, relative=False).word(0.0, 0.25)
        'E1.5'
        >>> Filament(start=0, digits=30000, decimals=5, relative=True).word(0.25, 1.0)
        'E0.225'
        """
        if self.relative:
            return "E" + decimal_text(round(self.digits * high) - round(self.digits * low), self.decimals)
        return "E" + decimal_text(self.start + round((self.digits - self.start) * high), self.decimals)


class _Mode(msgspec.Struct, kw_only=True):
    """State of the extruder along a program: `relative` None where it is not certain, `at` None where unknown.

    `places` where the E words of a program that names no mode show that they are.
    """

    relative: bool | None = None
    places: bool = False
    named: bool | None = None
    steps: bool = False
    at: bytes | None = None

    def set(self, word: str) -> None:
        """Take a word of modes."""
        if word[0] == "M":
            self.named = word[-1] == "3"
            self.relative = None if self.steps and not self.named else self.named
            return
        self.steps = word[-1] == "1"
        # A mode that G90 or G91 leaves as it is in every firmware stays certain.
        self.relative = self.named if self.named is self.steps else None
        if self.named is not self.steps:
            self.named = None
        if self.places and not self.steps:
            self.relative = False


class _Words(NamedTuple):
    """The E words of a program: their lines, values [mm], and how far the lines move [mm], 0 where they set a place.

    `modes` are the lines that may name what E words are.
    """

    line: IntArray
    value: Array
    length: Array
    modes: IntArray

    def between(self, first: int, last: int) -> tuple[Array, Array]:
        """Values and lengths from one line to before another, or the next that names what they are."""
        end = min([last, *self.modes[np.searchsorted(self.modes, first) :][:1].tolist()])
        rows = slice(*np.searchsorted(self.line, [first, end]).tolist())
        return self.value[rows], self.length[rows]


@lru_cache(maxsize=2)
def _words_of(program: PartProgram) -> _Words:
    way = np.zeros(program.blocks)
    np.add.at(way, program.motions.block, chord_lengths(program.motions) / MM)
    places: list[int] = []
    values: list[float] = []
    sets: list[bool] = []
    modes: list[int] = []
    for match in _COMMAND.finditer(line_fed(program.data)):
        name, word = _name(match[1]), _WORD.search(match[2])
        if name in _MODES:
            modes.append(match.start())
        if word is not None and len(word[1]) <= _ROOM:
            places.append(match.start())
            values.append(float(word[1]))
            sets.append(name == "G92")
    line, mode = (np.searchsorted(program.lines, own, side="right") - 1 for own in (places, modes))
    return _Words(line=line, value=np.array(values), length=np.where(sets, 0.0, way[line]), modes=mode)


def _are_places(value: Array, length: Array) -> bool:
    """Return whether E words can only be places: they rise, and as steps they are more filament than any bead has."""
    before = np.append(-math.inf, value)[: value.size]
    # Ways through the air may name the place at which the filament is.
    beads = (length > 0.0) & (value != before)
    rises = (value > before)[beads].sum() >= RISING * beads.sum()
    too_much = np.maximum(value[beads], 0.0).sum() > SPOOLED * length[beads].sum()
    return bool(beads.sum() >= BEADS and rises and too_much)


def _are_steps(value: Array, length: Array) -> bool:
    """Return whether E words can only be steps: as places they are so near to each other that nothing is laid."""
    beads = (length > 0.0) & (value != 0.0)
    if beads.sum() < BEADS:
        return False
    least = THINNEST * length[beads].sum()
    return bool(np.ptp(value[beads]) < least <= value[beads].sum())


def _shown(program: PartProgram, first: int, last: int) -> _Mode:
    """Return the mode that the E words of lines show, from one to before another, or the next that names one."""
    own = _words_of(program).between(first, last)
    return _Mode(relative=False if _are_places(*own) else True if _are_steps(*own) else None)


def shows_places(program: PartProgram) -> bool:
    """Return whether the E words of a program that names no mode can only be places.

    They rise from bead to bead, and as steps they would push out far more filament than any bead has.
    """
    if _NAMES_MODE.search(line_fed(program.data)):
        return False
    words = _words_of(program)
    return _are_places(words.value, words.length)


@lru_cache(maxsize=2)
def filament_of(program: PartProgram) -> Mapping[int, Filament]:
    """Return what can be divided of the filament of a program's lines, by line."""
    found: dict[int, Filament] = {}
    if program.language.bound is None:
        return found
    places, keeps = shows_places(program), program.language.name.startswith("marlin")
    mode = _Mode(relative=False if places else None, places=places)
    # What is not understood may have changed everything: in Klipper it is often a macro. Marlin's words change no mode
    # of E, but perhaps where it is.
    passed = deque(sorted((note.last, note.first) for note in program.notes))
    macros = deque(own for own in passed if not (keeps or _all_return(program, own[1], own[0])))
    kept = [own.start() for own in brought_back(program.data)]
    back = (np.searchsorted(program.lines, kept, side="right") - 1).tolist()
    starts, line = program.lines.tolist(), 0
    for match in _COMMAND.finditer(line_fed(program.data)):
        while starts[line + 1] <= match.start():
            line += 1
        while passed and line > passed[0][0]:
            unknown = passed.popleft()
            mode.at = None
            if _may_set(program, unknown[1], unknown[0]) or any(unknown[1] <= own <= unknown[0] for own in back):
                mode = _Mode()
            if macros and unknown == macros[0]:
                macros.popleft()
                mode = _shown(program, unknown[0] + 1, macros[0][1] if macros else program.blocks)
        name, word = _name(match[1]), _WORD.search(match[2])
        if name[:1] == "M" or name in ("G90", "G91"):
            mode.set(name)
        elif word is not None or not match[2].strip():
            # Of two E words nobody knows which is obeyed: 1E-05 is two for a controller that knows no powers of ten.
            alone = word is not None and _WORD.search(match[2], word.end()) is None
            if name != "G92" and word is not None and alone:
                _take(found, mode, line, word[1])
            certain = alone and (name == "G92" or mode.relative is False)
            mode.at = word[1] if certain and word is not None else None
    return found


def _may_set(program: PartProgram, first: int, last: int) -> bool:
    """Return whether a line that is passed through names, behind another word, what E words are."""
    for line in range(first, last + 1):
        code = program.text(line).partition(b";")[0]
        command = _COMMAND.match(code)
        if _MODE_INSIDE.search(code, 0 if command is None else command.end(1)) is not None:
            return True
    return False


def _all_return(program: PartProgram, first: int, last: int) -> bool:
    """Return whether all lines from one to another are macros that leave all modes as they were."""
    return all(returns(program.text(line)) for line in range(first, last + 1))


def _name(command: bytes) -> str:
    """Name of a command without blanks and leading zeros."""
    return f"{chr(command[0]).upper()}{command[1:].decode().strip().lstrip('0') or '0'}"


def _take(found: dict[int, Filament], mode: _Mode, line: int, number: bytes) -> None:
    """Note what a line extrudes, where that is certain."""
    if mode.relative is None or (mode.at is None and not mode.relative):
        return
    start = b"0" if mode.relative or mode.at is None else mode.at
    if max(len(start), len(number)) > _ROOM:
        return
    decimals = max(DECIMALS, _decimals(number), _decimals(start))
    found[line] = Filament(
        start=_digits(start, decimals), digits=_digits(number, decimals), decimals=decimals, relative=mode.relative
    )


def _decimals(number: bytes) -> int:
    return len(number.partition(b".")[2])


def _digits(number: bytes, decimals: int) -> int:
    """Digits of a number with so many decimals.

    Examples
    --------
    >>> _digits(b"-.5", 5), _digits(b"+12", 2)
    (-50000, 1200)
    """
    whole, _, part = number.lstrip(b"+-").partition(b".")
    return (-1 if number.startswith(b"-") else 1) * int((whole or b"0") + part.ljust(decimals, b"0"))


def with_filament(program: PartProgram, block: int, text: str, low: float, high: float) -> str:
    """Return the text of a line with the E word of a part of its motion."""
    filament = filament_of(program).get(block)
    if filament is None:
        return text
    code, mark, comment = text.partition(";")
    return _WORD.sub(filament.word(low, high).encode(), code.encode("latin-1")).decode("latin-1") + mark + comment
