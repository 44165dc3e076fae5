"""What a reader has to know of a controller's language beside RS274/NGC."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.gcode.reader import codes
from ph_post.types import Array, IntArray


class Language(msgspec.Struct, frozen=True, kw_only=True):
    """A language that is read as RS274/NGC, but for what is said here.

    Parameters
    ----------
    name : str
        Of the dialect that it belongs to; empty for RS274/NGC.
    hide : callable or None
        ``hide(data)``: the same text, every line as long as it was, with blanks in the place of what has no
        meaning for motion. What may move, and is not understood, becomes a line that begins with ``$``: after
        it no position is known, and no mode but `fixed`; or with ``$@``: after it the modes are what they
        were. It works line by line, on any part of a program.
    dwell : tuple of (str, float)
        Letters of the time of a G4, each with its unit [s].
    fixed : mapping of int to float
        Modes that no line changes, by column of a state (:mod:`ph_post.gcode.reader.codes`).
    feed_known : bool
        Whether a cut needs an F before it; if not, it is one whose feed the program does not tell.
    bound : callable or None
        ``bound(line)``: why the motion of a line cannot be divided, in words; empty where it can.
    """

    name: str = ""
    hide: Callable[[bytes], bytes] | None = None
    dwell: tuple[tuple[str, float], ...] = (("P", 1.0),)
    fixed: Mapping[int, float] = {}
    feed_known: bool = True
    bound: Callable[[bytes], str] | None = None

    def hidden(self, data: bytes) -> bytes:
        """Return a program's text as the reader of RS274/NGC is to have it."""
        return data if self.hide is None else self.hide(data)

    def start(self) -> Array:
        """State that no line changes, shape (STATE,), NaN where lines do; and whether F is known at first."""
        state = np.full(codes.STATE, np.nan)
        for column, value in self.fixed.items():
            state[column] = value
        state[codes.FEED_KNOWN] = 0.0 if self.feed_known else 2.0
        return state

    def dwells(self, letter: NDArray[np.uint8], value: Array) -> tuple[IntArray, Array]:
        """Rows of words that tell the time of a G4, where one stands beside them, and the times [s]."""
        units = np.full(256, np.nan)
        for name, unit in self.dwell:
            units[ord(name)] = unit
        rows = np.flatnonzero(np.isfinite(units)[letter])
        seconds = value[rows] * units[letter[rows]]
        plain = np.isfinite(seconds)
        return rows[plain], seconds[plain]


RS274 = Language()
"""RS274/NGC itself."""
