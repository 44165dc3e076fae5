"""grblHAL: Grbl's successor on 32-bit controllers, with longer lines, cubic splines and a larger planner.

Where the facts are from, in grblHAL's own repository "core": README.md lists the words (G5 and G5.1, G61,
G91.1 and no G90.1; G64 is there in gcode.c, but only with ENABLE_PATH_BLENDING, which config.h says not to
enable yet); protocol.h has a line buffer of 256 characters; motion_control.c computes in single precision,
breaks an arc into chords with F times their number under G93, as Grbl does, and a G5 into moves that each
would take the whole time of a G93; config.h has the steps of that, and a planner of 100 blocks; corners, chords
and dwells are Grbl's.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.dialects.base import (
    Abilities,
    CubicAbility,
    Dialect,
    Notices,
    NumberFormat,
    Recording,
    Syntax,
    metric_opening,
)
from ph_post.dialects.grbl import PLANNER, REFUSING, status_reports
from ph_post.types import Array
from ph_post.units import MM_PER_MIN

_DECIMALS: Final = 4
"""0.1 µm, as for Grbl: single precision has no more at the size of such machines."""

_MAX_LINE: Final = 255
"""One less than the line buffer holds."""

_PLANNER_BLOCKS: Final = 100
"""Moves that its planner holds (DEFAULT_PLANNER_BUFFER_BLOCKS)."""

_WIDEST_STEP: Final = 0.2
"""A G5 is played as straight moves over steps of the parameter, twice 0.1 wide at most. They are shortened
only where the middle is off by a tenth of a millimetre, which is no help: the widest step has to do."""

_STEPS: Final = 10
"""Moves of a G5 that is flat enough not to be shortened any further."""


def spline_deviation(control: Array) -> Array:
    """Return the largest distances [m], (m,), by which moves over the widest step leave cubic Béziers (m, 4, 2).

    A chord over a step h leaves a curve by no more than h² / 8 times its largest second derivative, which a
    cubic has at an end.
    """
    second = 6.0 * np.diff(control, n=2, axis=1)
    return np.asarray(_WIDEST_STEP**2 / 8.0 * np.sqrt((second * second).sum(axis=-1)).max(axis=1))


DIALECT = Dialect(
    name="grblhal",
    syntax=Syntax(opening=metric_opening, closing=("M2",), max_line=_MAX_LINE),
    abilities=Abilities(
        cubic=CubicAbility(deviation=spline_deviation, pieces=_STEPS),
        inverse_time=frozenset(("line",)),
        feed_along_all=True,
    ),
    numbers=NumberFormat(decimals=_DECIMALS, feed_digits=6, least_feed=PLANNER.least_feed / MM_PER_MIN),
    notices=Notices(
        own_compensation="the backlash settings of grblHAL ($160 on), where it was built with them,", arc_setting="$12"
    ),
    recording=Recording(lines=status_reports),
    language=REFUSING,
    planner=replace(PLANNER, blocks=_PLANNER_BLOCKS - 2),
)
"""The grblHAL dialect."""
