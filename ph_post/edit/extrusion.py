"""Divide the filament of a line between the parts of its motion, in proportion to the original way.

Where E words stand for the place of the filament (M82) and where for a step of it (M83) has to be known for certain,
as one taken for the other would push out a spool. G90 and G91 set E too in Marlin, and none in Klipper but that E is a
step wherever G91 is (`gcode.cpp` of Marlin, `gcode_move.py` of Klipper): so a line is divided only where its mode was
named by M82 or M83 behind the last G90 or G91, or where G90 stands behind it without changing it in either. A program
that names none shows that E words are places where as steps they would be no print: see :func:`shows_places`.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np

from ph_post.dialects.printers import returns
from ph_post.gcode.motion_parts import chord_lengths
from ph_post.gcode.numbers import decimal_text
from ph_post.gcode.program import PartProgram
from ph_post.units import MM

DECIMALS: Final = 5
"""Least decimals of a divided E: 10 nm of filament."""

BEADS: Final = 20
"""Lines that extrude and move from which on their E words show what they are."""

RISING: Final = 0.95
"""Part of those lines that change E by which it grows, where E words are places."""

SPOOLED: Final = 5.0
"""Filament for a way [mm/mm] that no bead has: of 1.75 mm it is one of 12 mm²."""

_NUMBER: Final = rb"[-+]?(?:\d+\.?\d*|\.\d+)"
_ROOM: Final = 100
"""Characters of the longest number that is divided."""

_WORD: Final = re.compile(rb"[Ee][ \t]*(" + _NUMBER + rb")")
_NAMES_MODE: Final = re.compile(rb"^[ \t]*(?:[Nn]\d+[ \t]*)?[Mm]0*8[23](?![\d.])", re.MULTILINE)
_COMMAND: Final = re.compile(
    rb"^[ \t]*(?:[Nn]\d+[ \t]*)?([Gg]0*(?:[0-3]|9[012])|[Mm]0*8[23])(?![\d.])([^\r\n;]*)", re.MULTILINE
)


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


def shows_places(program: PartProgram) -> bool:
    """Return whether the E words of a program that names no mode can only be places.

    They rise from bead to bead, and as steps they would push out far more filament than any bead has.
    """
    if _NAMES_MODE.search(program.data):
        return False
    way = np.zeros(program.blocks)
    np.add.at(way, program.motions.block, chord_lengths(program.motions))
    before, total, path, rises, count = -math.inf, 0.0, 0.0, 0, 0
    starts, line = program.lines.tolist(), 0
    for match in _COMMAND.finditer(program.data):
        word = _WORD.search(match[2])
        if word is None or len(word[1]) > _ROOM:
            continue
        while starts[line + 1] <= match.start():
            line += 1
        value = float(word[1])
        # Ways through the air may name the place at which the filament is.
        if _name(match[1]) != "G92" and way[line] > 0.0 and value != before:
            rises, count = rises + (value > before), count + 1
            total, path = total + max(value, 0.0), path + float(way[line]) / MM
        before = value
    return count >= BEADS and rises >= RISING * count and total > SPOOLED * path


@lru_cache(maxsize=2)
def filament_of(program: PartProgram) -> Mapping[int, Filament]:
    """Return what can be divided of the filament of a program's lines, by line."""
    found: dict[int, Filament] = {}
    if program.language.bound is None:
        return found
    places, keeps = shows_places(program), program.language.name.startswith("marlin")
    mode = _Mode(relative=False if places else None, places=places)
    passed = iter(sorted((note.last, note.first) for note in program.notes))
    nothing = program.blocks, program.blocks
    unknown, first = next(passed, nothing)
    starts, line = program.lines.tolist(), 0
    for match in _COMMAND.finditer(program.data):
        while starts[line + 1] <= match.start():
            line += 1
        # What is not understood may have changed everything: in Klipper it is often a macro. Marlin's words change no
        # mode of E, but perhaps where it is.
        while line > unknown:
            mode.at = None
            if not (keeps or all(returns(program.text(one)) for one in range(first, unknown + 1))):
                mode = _Mode()
            unknown, first = next(passed, nothing)
        name, word = _name(match[1]), _WORD.search(match[2])
        if name[:1] == "M" or name in ("G90", "G91"):
            mode.set(name)
        elif word is not None or not match[2].strip():
            if name != "G92" and word is not None:
                _take(found, mode, line, word[1])
            certain = word is not None and (name == "G92" or mode.relative is False)
            mode.at = word[1] if certain and word is not None else None
    return found


def _name(command: bytes) -> str:
    """Name of a command without leading zeros."""
    return f"{chr(command[0]).upper()}{command[1:].decode().lstrip('0') or '0'}"


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
