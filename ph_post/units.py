"""Units of the shop in SI.

Files and the command line use mm, mm/min and degrees; inside, everything is SI. Multiply by a constant on the
way in (``20 * MM``), divide on the way out (``x / MM``).
"""

from __future__ import annotations

import math
from typing import Final

MM: Final = 1e-3
"""One millimetre in metres."""

MICROMETRE: Final = 1e-6
"""One micrometre in metres."""

INCH: Final = 25.4e-3
"""One inch in metres."""

MINUTE: Final = 60.0
"""One minute in seconds."""

MS: Final = 1e-3
"""One millisecond in seconds."""

MM_PER_MIN: Final = MM / MINUTE
"""One mm/min in m/s."""

HERTZ: Final = math.tau
"""One oscillation a second in rad/s."""

DEGREE: Final = math.pi / 180.0
"""One degree in radians."""

LEAD: Final = MM / math.tau
"""A screw's lead of one millimetre a turn in metres a radian."""

LENGTH_UNITS: Final = {"mm": MM, "m": 1.0, "inch": INCH}
"""Length units a path file may name, in metres."""
