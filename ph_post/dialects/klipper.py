"""Klipper: firmware of 3D printers whose planner runs in double precision on a small computer.

Where the facts are from, in the repository "klipper" of Klipper3d. `docs/G-Codes.md` lists the words: G0, G1,
G4, G28, G90, G91, G92, M82 and M83, M204, M220, M400 and some more; `klippy/extras/gcode_move.py` adds G21,
which does nothing, and refuses G20. G2, G3 and G17 to G19 are there only where the configuration has a
section [gcode_arcs], which few have and which draws them in chords of its `resolution`, 1 mm
(`klippy/extras/gcode_arcs.py`, which takes no R and no arcs under G91): so curves are written as chords
within the tolerance asked for. G5, G40, G49, G54, G61, G64, G80, G91.1, G93, G94 and M2 are unknown, and F
would be mm/min whatever they say. `klippy/gcode.py` takes one command a line, which a line feed alone ends,
and only `;` begins a comment.
G4 (`klippy/toolhead.py`): P in milliseconds, no S; the axes stand still in it. G0 is G1: it moves at F, which
has to be positive. `Move` and `LookAheadQueue` there have the rule of corners and the look-ahead, `ToolHead` the
defaults: square corner velocity 5 mm/s, half of the acceleration as accel-to-decel; one velocity and acceleration
for X and Y (`kinematics/cartesian.py` has others of Z); `gcode_move.py` begins with 25 mm/s. Klipper has no
compensation of backlash of its own. M0 is unknown; PAUSE waits, but the macros that most people put in its place
also lift and park the head.
"""

from __future__ import annotations

import re
from typing import Final

from ph_post.dialects.base import Abilities, Dialect, DwellWords, Notices, NumberFormat, Syntax
from ph_post.dialects.printers import reader_of, why_bound
from ph_post.gcode import codes
from ph_post.gcode.language import Language
from ph_post.gcode.numbers import SEMICOLON
from ph_post.types import ExactPath, KlipperChords, KlipperCorner
from ph_post.units import MM, MS

_DECIMALS: Final = 5
"""10 nm: far below a microstep, and in the deepest dips still a small part of a block."""

_ASSUMED: Final = (
    "assumed: homed, origin and tool as set before, speed factor M220 100 percent, no bed mesh or skew"
    " correction that bends the path",
    "fan, spindle and heaters are not touched",
)


_LONE: Final = re.compile(rb"\r(?=[^\r\n])")


def _why_it_stays(data: bytes) -> str:
    r"""Return why no line of a program can be changed, in words; empty where lines can be.

    Examples
    --------
    >>> _why_it_stays(b"G90\rM83\n"), _why_it_stays(b"G90\r\r\nM83\r\n")
    ('line 1 ends in a carriage return alone, behind which Klipper reads on as in the same line', '')
    """
    found = _LONE.search(data)
    if found is None:
        return ""
    number = data.count(b"\n", 0, found.start()) + 1
    return f"line {number} ends in a carriage return alone, behind which Klipper reads on as in the same line"


def _opening(plane: str) -> tuple[str, ...]:
    """One command a line; nothing is written that a plane could matter to."""
    del plane
    return ("G21", "G90")


DIALECT = Dialect(
    name="klipper",
    syntax=Syntax(
        opening=_opening,
        closing=(),
        max_line=255,
        comments=SEMICOLON,
        dwell=DwellWords(unit=MS),
        modal_motion=False,
        rapid_feed=True,
        stop=None,
    ),
    abilities=Abilities(arc_planes=()),
    numbers=NumberFormat(decimals=_DECIMALS, feed_digits=7),
    notices=Notices(assumed=_ASSUMED, arc_setting="resolution in [gcode_arcs]"),
    planner=ExactPath(
        corner=KlipperCorner(velocity=5.0 * MM),
        chords=KlipperChords(length=1.0 * MM),
        rapid_feed=25.0 * MM,
        shared_limits=True,
    ),
    ending=".gcode",
    language=Language(
        name="klipper",
        hide=reader_of(b"XYZIJEF", b"$", small=True),
        dwell=(("P", MS),),
        fixed={codes.UNITS: MM, codes.FEED_MODE: 94.0, codes.ARC_ABSOLUTE: 0.0},
        feed_known=False,
        bound=why_bound,
        macros=True,
        stays=_why_it_stays,
    ),
)
"""The Klipper dialect."""
