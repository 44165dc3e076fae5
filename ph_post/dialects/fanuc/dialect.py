"""Fanuc 30i, 31i, 32i and 0i, mills (M systems) and lathes (T systems): RS274 as most machine tools speak it.

Where the facts are from. FANUC Series 30i/31i/32i-MODEL B, Operator's Manual (Common to Lathe System and
Machining Center System), B-64484EN: program configuration (``%``, O number, comments in parentheses of
capitals), decimal point programming (lengths and feeds without a point count in increments, or in mm where
bit 0 of parameter 3401 is set), inch/metric conversion (G20 and G21 in a block of their own at the head),
dwell (G04 P in milliseconds, no decimal point; X and U in seconds), AI contour control (G05.1 Q1 and Q0,
alone in their blocks). The same, For Machining Center System, B-64484EN-2: inverse time feed G93. FANUC
Series 15i/150i-MA, Operator's Manual (Programming), B-63324EN/03, 4.17 NURBS interpolation: G06.2 P order
(2 to 4) K knot X Y Z R weight, as many knots as points and order together, order equal ones at both ends,
the first point where the tool stands, no other word in between; alarms PS1001 to PS1010, of which PS1006
forbids G93 and G41.

Options that a machine may have, behind plus signs: ``ai`` brackets the program in G05.1 Q1 and Q0;
``nurbs``, which needs that, writes polynomial cubics as G06.2; ``inverse`` allows G93, an option too;
``isc`` has increment system IS-C, 0.1 µm; ``calculator`` reads lengths without a decimal point as mm; ``lathe`` reads
every program as one of a lathe (B-64484EN-1), in G18 and with X in diameters, and not only those that have words of a
lathe. What is written has a point in every length and feed, and so means the same on all of them.

The words for tolerances of joints differ by machine and option (G05.1 Q1 R): the path mode is left as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from msgspec.structs import replace

from ph_post.dialects.base import (
    BUILT_PATH,
    PRECONDITIONS,
    Abilities,
    CubicAbility,
    Dialect,
    DwellWords,
    Notices,
    NumberFormat,
    Syntax,
    end_remark,
)
from ph_post.dialects.fanuc.reader import FURTHER, read_fanuc
from ph_post.dialects.lines import LineWriter
from ph_post.errors import InputError
from ph_post.gcode.blocks import Moves
from ph_post.gcode.language import Language
from ph_post.gcode.numbers import Comments
from ph_post.types import Array
from ph_post.units import MS

_DECIMALS: Final = 3
"""Increment system IS-B: 0.001 mm. IS-C has one more."""

_FEED_DECIMALS: Final = 2
"""0.01 mm/min, the least feed; F takes as many decimals. Not confirmed in a manual."""

_MAX_LINE: Final = 100
"""No manual bounds a block so tightly; it is what a screen shows."""

_ALLOWED: Final = frozenset("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789 .,:=+-*/_")
"""Characters of a comment: those of the ISO code that every control shows. No small letters."""

_ORDER: Final = 4
"""Of a cubic."""


class FanucLines(LineWriter):
    """Writes a cubic as G06.2: four control points, and four equal knots at both ends."""

    def write_spline(self, moves: Moves, i: int, body: list[str], feed: str) -> None:
        """Write move `i`; the blocks of its points, then those of the knots alone."""
        start, end = self._place(moves.points[i, :2]), body[:2]
        inner = [self._place(point) for point in moves.inner[i]]
        self.lines.append(" ".join(["G6.2", f"P{_ORDER}", "K0.", *start, *self._speed(feed)]))
        self.lines += [" ".join(["K0.", *point]) for point in (*inner, end)]
        self.lines += ["K1."] * _ORDER
        self._motion = "G6.2"


def opening(plane: str) -> tuple[str, ...]:
    """Open a program in mm, absolute and per minute, nothing compensated; G21 stands alone."""
    return ("G21", f"{plane} G90 G94 G40 G49 G80", "G54")


def finish(lines: Sequence[str], name: str) -> Sequence[str]:
    """Put a program between percent signs, with an O number: that of its name, or 1.

    Examples
    --------
    >>> finish(["M30"], "4711")
    ['%', 'O4711', 'M30', '%']
    """
    number = int(name) if name.isdecimal() and 0 < int(name) < 8000 else 1
    return ["%", f"O{number:04d}", *lines, "%"]


def spline_deviation(control: Array) -> Array:
    """Return the distances (m,) by which G06.2 leaves cubic Béziers (m, 4, 2): zero, it is the same curve."""
    return np.zeros(control.shape[0])


def _with_ai(dialect: Dialect) -> Dialect:
    if "ai" in dialect.options:
        return dialect
    words = dialect.syntax
    return replace(
        dialect,
        options=dialect.options | {"ai"},
        syntax=replace(
            words,
            opening=lambda plane: (*words.opening(plane), "G5.1 Q1"),
            closing=("G5.1 Q0", *words.closing),
        ),
    )


def _with_nurbs(dialect: Dialect) -> Dialect:
    cubic = CubicAbility(deviation=spline_deviation)
    return replace(_with_ai(dialect), abilities=replace(dialect.abilities, cubic=cubic))


def _with_inverse_time(dialect: Dialect) -> Dialect:
    return replace(
        dialect,
        abilities=replace(dialect.abilities, inverse_time=frozenset(("line", "arc"))),
        # the inverse of a long block's time needs digits, not decimals
        numbers=replace(dialect.numbers, feed_decimals=None),
    )


def _with_isc(dialect: Dialect) -> Dialect:
    finer = replace(dialect.numbers, decimals=_DECIMALS + 1)
    return replace(dialect, numbers=finer, language=_reading(dialect, decimals=_DECIMALS + 1))


def _with_lathe(dialect: Dialect) -> Dialect:
    words = replace(dialect.syntax, opening=_refuse_path)
    return replace(dialect, syntax=words, language=_reading(dialect, lathe=True))


def _refuse_path(plane: str) -> tuple[str, ...]:
    """Refuse to write a path: only part programs say where a lathe's axes are."""
    raise InputError("dialect", "fanuc+lathe writes no paths", expected="a part program, or fanuc", got=plane)


def _with_calculator(dialect: Dialect) -> Dialect:
    return replace(dialect, language=_reading(dialect, calculator=True))


def _reading(dialect: Dialect, **how: Any) -> Language:
    """Return the language of a dialect that is read with further options."""
    read: Any = dialect.language.read
    return Language(read=partial(read, **how), further=FURTHER, shortest=True)


_VARIANTS: Final[Mapping[str, Callable[[Dialect], Dialect]]] = {
    "ai": _with_ai,
    "calculator": _with_calculator,
    "inverse": _with_inverse_time,
    "isc": _with_isc,
    "lathe": _with_lathe,
    "nurbs": _with_nurbs,
}

DIALECT = Dialect(
    name="fanuc",
    syntax=Syntax(
        opening=opening,
        closing=("M30",),
        max_line=_MAX_LINE,
        comments=Comments(allowed=_ALLOWED, upper=True),
        dwell=DwellWords(letter="P", unit=MS, decimals=0),
        finish=finish,
    ),
    abilities=Abilities(feed_along_all=True, drills=True),
    numbers=NumberFormat(decimals=_DECIMALS, feed_digits=6, feed_decimals=_FEED_DECIMALS, point=True),
    language=Language(read=read_fanuc, further=FURTHER, shortest=True),
    notices=Notices(
        assumed=(PRECONDITIONS, end_remark("M30"), "the program number may be taken: change it"),
        units=(20, 21),
        signed_turns="bit 1 (RAB) of parameter 1008",
    ),
    planner=BUILT_PATH,
    writer=FanucLines,
    ending=".nc",
    variants=_VARIANTS,
)
"""The Fanuc dialect."""
