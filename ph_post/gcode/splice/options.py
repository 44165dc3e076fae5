"""What a user may ask of the compensation of an existing program."""

from __future__ import annotations

import msgspec

from ph_post.gcode.options import BLOCK_TIME, CHORD_TOLERANCE
from ph_post.units import MM

TOLERANCE = 5e-3 * MM
"""Default ε of the windows [m]; an excursion of an axis below it is not worth a stop either."""


class SpliceOptions(msgspec.Struct, frozen=True, kw_only=True):
    """How a program is compensated; lengths in m, times in s.

    Parameters
    ----------
    tolerance : float
        ε of the windows, and the least excursion of an axis that is followed with a lasting offset.
    max_slowdown : float
        How much the program's time may grow, relative.
    chord_tolerance : float
        How far a joint may be rounded where blocks of known time stand in an exact-stop program.
    block_time : float
        Longest block in ramps and dips.
    """

    tolerance: float = TOLERANCE
    max_slowdown: float = 0.1
    chord_tolerance: float = CHORD_TOLERANCE
    block_time: float = BLOCK_TIME
