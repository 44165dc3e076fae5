"""Marlin 2: firmware of 3D printers, and of routers and plotters that are built like them.

Where the facts are from, in the repository "Marlin" of MarlinFirmware. `src/gcode/gcode.cpp` lists the words
and the build options that they depend on: always there are G0, G1, G4, G21, G28, G90, G91 and G92; G2 and G3
with ARC_SUPPORT, which is on unless somebody takes it out. G17 to G19 (CNC_WORKSPACE_PLANES), G54 to G59
(CNC_COORDINATE_SYSTEMS), G80 (GCODE_MOTION_MODES), G20 (INCH_MODE_SUPPORT) and G5 (BEZIER_CURVE_SUPPORT) are
not; G40, G49, G61 as a path mode, G64, G91.1, G93, G94 and M2 are unknown, G61 and M30 mean other things (go
back to a saved place; delete a file). `src/gcode/parser.cpp` takes one command a line, whose G or M comes
first; comments are `;` only (parentheses with PAREN_COMMENTS), letters are capitals only. `G4.cpp`: P in
whole milliseconds, S in seconds. `G0_G1.cpp`: G0 moves at F as G1 does, unless G0_FEEDRATE is set.
`G2_G3.cpp`: I and J from the start, or R; P is the number of whole circles before, so none is written.
`M425.cpp` with BACKLASH_GCODE: `M425 F0` switches the firmware's own compensation off; firmware built without
it says that it does not know the word, and goes on. `src/module/planner.cpp` joins moves of fewer steps than
MIN_STEPS_PER_SEGMENT to the next one. `Configuration_adv.h`: a command has fewer than 96 characters
(MAX_CMD_SIZE), of which a host takes some for line number and checksum; arcs are drawn in chords of up to
MAX_ARC_SEGMENT_MM, 1 mm, at least MIN_CIRCLE_SEGMENTS, 72, a turn, and not below MIN_ARC_SEGMENT_MM, 0.1 mm.
`planner.cpp` has both rules of corners: junction deviation with JUNCTION_DEVIATION_MM, 0.013 mm, and
JD_HANDLE_SMALL_SEGMENTS (`Configuration.h`), or CLASSIC_JERK with 10 mm/s in X and Y and 0.3 in Z; `motion.cpp`
begins with 1500 mm/min.
"""

from __future__ import annotations

from typing import Final

from ph_post.dialects.base import Abilities, Dialect, DwellWords, Notices, NumberFormat, StreamLimit, Syntax
from ph_post.dialects.printers import reader_of, why_bound
from ph_post.gcode import codes
from ph_post.gcode.language import Language
from ph_post.gcode.numbers import SEMICOLON
from ph_post.types import ExactPath, MarlinChords, MarlinCorner
from ph_post.units import MM, MS

_DECIMALS: Final = 4
"""0.1 µm: single precision has no more at the size of such machines."""

_MAX_LINE: Final = 80
"""95 characters less a line number of seven digits and a checksum, which hosts add."""

_STREAM_RATE: Final = 25_000.0
"""250,000 baud, ten bits a byte: Marlin's own choice."""

_PLANNER_BLOCKS: Final = 16
"""Moves that its planner holds (BLOCK_BUFFER_SIZE)."""

_OWN_OFF: Final = "M425 F0"

_JOINED: Final = (
    "moves of fewer steps than MIN_STEPS_PER_SEGMENT, 6 in most builds and 1 in late ones, are joined to the"
    " next move: a small offset then comes with that"
)

_ASSUMED: Final = (
    "assumed: homed, origin and tool as set before, feed override 100 percent, no bed levelling that bends the path",
    "G2 and G3 are drawn by the firmware in chords of up to 1 mm, see MAX_ARC_SEGMENT_MM",
    _JOINED,
    "fan, spindle and heaters are not touched",
)

_STAYS_OFF: Final = (
    "; the firmware's own backlash compensation stays off, as nobody can tell",
    "; here whether it was on: M425 F1 switches it on",
)


def _opening(plane: str) -> tuple[str, ...]:
    """One command a line; XY is the only plane of firmware that knows no word for planes."""
    del plane
    return ("G21", "G90")


DIALECT = Dialect(
    name="marlin",
    syntax=Syntax(
        opening=_opening,
        closing=(),
        max_line=_MAX_LINE,
        counts_comments=False,
        comments=SEMICOLON,
        dwell=DwellWords(unit=MS, decimals=0),
        modal_motion=False,
        rapid_feed=True,
    ),
    # G5 depends on a build option, and how finely it is drawn on another one: no cubics.
    abilities=Abilities(
        arc_planes=("G17",),
        stream=StreamLimit(rate=_STREAM_RATE, window=_PLANNER_BLOCKS),
    ),
    numbers=NumberFormat(decimals=_DECIMALS, feed_digits=6),
    notices=Notices(
        assumed=_ASSUMED,
        cautions=(_JOINED,),
        guard=(_OWN_OFF,),
        restored="M425 F",
        stays_off=_STAYS_OFF,
        own_compensation="the firmware's own backlash compensation, F of M425,",
        arc_setting="MAX_ARC_SEGMENT_MM in the firmware",
    ),
    planner=ExactPath(
        corner=MarlinCorner(deviation=0.013 * MM),
        chords=MarlinChords(longest=1.0 * MM, shortest=0.1 * MM, per_turn=72),
        blocks=_PLANNER_BLOCKS - 2,
        rapid_feed=25.0 * MM,
    ),
    ending=".gcode",
    language=Language(
        name="marlin",
        hide=reader_of(b"XYZIJREFS", b"$@", small=False),
        dwell=(("P", MS), ("S", 1.0)),
        fixed={codes.FEED_MODE: 94.0, codes.ARC_ABSOLUTE: 0.0},
        feed_known=False,
        bound=why_bound,
    ),
)
"""The Marlin dialect."""
