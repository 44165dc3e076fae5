"""Radii of tools, from the controller's table and from G10."""

from __future__ import annotations

import re
from typing import Final

import msgspec

_WORD: Final = re.compile(r"([A-Za-z])\s*([+-]?(?:\d+\.?\d*|\.\d+))")


class ToolShape(msgspec.Struct, frozen=True, kw_only=True):
    """A tool of the table: its diameter in the machine's units, and a lathe tool's orientation, 0 for a mill's."""

    diameter: float = 0.0
    orientation: int = 0


def tools_of_table(text: str) -> dict[int, ToolShape]:
    """Return the tools of a table of LinuxCNC by number: one on each line, words as ``T1 P1 D6.35 Z-20 ; end mill``.

    Raises
    ------
    ValueError
        With the number of the line (from 1) that is none.

    Examples
    --------
    >>> tools_of_table("T1 P1 D6.35 Z-20 ; end mill")[1].diameter
    6.35
    """
    found: dict[int, ToolShape] = {}
    for number, line in enumerate(text.splitlines(), 1):
        bare = line.split(";")[0].strip()
        if not bare:
            continue
        words = {letter.upper(): float(value) for letter, value in _WORD.findall(bare)}
        if _WORD.sub("", bare).strip() or "T" not in words:
            raise ValueError(number)
        found[round(words["T"])] = ToolShape(diameter=words.get("D", 0.0), orientation=round(words.get("Q", 0.0)))
    return found
