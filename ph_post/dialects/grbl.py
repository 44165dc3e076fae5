"""Grbl 1.1 (grblHAL takes all of it too): an eight-bit controller, fed line by line through a serial port.

Where the facts are from, in the repository "grbl" of gnea. README.md lists the words; `grbl/gcode.c` takes
G93 and G94, G61 but no G61.1, G91.1 as it is that way anyhow, G40 as there is no other, and F, I, J, K, L, N,
P, R, S, T, X, Y, Z each once a line; it refuses G5, G64, G90.1, G43 but for G43.1, and Q. `grbl/protocol.h`
has a line buffer of 80 characters with the end, in which blanks and comments are not kept; `grbl/serial.h`
and `config.h` have a receive buffer of 128 and 115,200 baud. `planner.c` has the rule of corners and a ring of
16 blocks, one of them empty and one under way; `motion_control.c` the chords of an arc; `defaults.h` $11 (0.01 mm)
and $12 (0.002 mm); `nuts_bolts.c` and `config.h` dwells in steps of 50 ms, always rounded up, and a least feed of
1 mm/min.
"""

from __future__ import annotations

from collections.abc import Sequence

from ph_post.dialects.base import (
    Abilities,
    Dialect,
    Notices,
    NumberFormat,
    Recording,
    StreamLimit,
    Syntax,
    metric_opening,
)
from ph_post.dialects.printers import STILL
from ph_post.gcode import codes
from ph_post.gcode.language import Language
from ph_post.types import ExactPath, GrblChords, GrblCorner, Machine
from ph_post.units import MM, MM_PER_MIN, MS

_DECIMALS = 4
"""0.1 µm. Grbl computes in single precision, which has no more at the size of such machines, and a shorter
line is a faster one."""

_MAX_LINE = 70
"""Grbl's line buffer holds 80 characters with the end; senders and offshoots leave less."""

_STREAM_RATE = 11_520.0
"""115,200 baud, ten bits a byte."""

_PLANNER_BLOCKS = 16
"""Moves that Grbl holds in its planner."""


PLANNER = ExactPath(
    corner=GrblCorner(deviation=0.01 * MM),
    chords=GrblChords(tolerance=0.002 * MM),
    blocks=_PLANNER_BLOCKS - 2,
    least_feed=1.0 * MM_PER_MIN,
    dwell_step=50.0 * MS,
)
"""Grbl's planner, by its generic defaults."""


REFUSING = Language(effects=dict.fromkeys(sorted(int(word[1:]) for word in STILL), codes.STAYS))
"""Grbl refuses M words that it does not know (error 20), and builds that move a pen or a fan with them move no axis by
those of printer firmware that move none there."""


def status_reports(_machine: Machine, axes: Sequence[str], _seconds: float, name: str, _gauge: bool) -> list[str]:
    """Say that the controller's own reports of its positions are too few for a log."""
    commands = ", ".join(f"{axis}_cmd" for axis in axes)
    return [
        "the controller reports positions some ten times a second, which is too few: record with a scale"
        f" or an encoder that has a logger of its own, and give {name}.ngc beside the log in place of"
        f" {commands}"
    ]


DIALECT = Dialect(
    name="grbl",
    syntax=Syntax(opening=metric_opening, closing=("M2",), max_line=_MAX_LINE, counts_comments=False, terse=True),
    abilities=Abilities(
        # Under G93 Grbl 1.1 breaks an arc into chords, multiplies F by their number and then takes it for mm/min
        # (mc_arc in its motion_control.c): only straight moves keep their time.
        inverse_time=frozenset(("line",)),
        stream=StreamLimit(rate=_STREAM_RATE, window=_PLANNER_BLOCKS),
        feed_along_all=True,
    ),
    numbers=NumberFormat(decimals=_DECIMALS, feed_digits=6, least_feed=PLANNER.least_feed / MM_PER_MIN),
    notices=Notices(arc_setting="$12"),
    recording=Recording(lines=status_reports),
    language=REFUSING,
    planner=PLANNER,
)
"""The Grbl dialect."""
