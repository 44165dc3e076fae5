"""Units of the shop in SI.

Files and the command line use mm, mm/min and degrees; inside, everything is SI. Multiply by a constant on the
way in (``20 * MM``), divide on the way out (``x / MM``).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from fractions import Fraction
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

PERCENT: Final = 1e-2
"""One in a hundred."""

DEGREE: Final = math.pi / 180.0
"""One degree in radians."""

LEAD: Final = MM / math.tau
"""A screw's lead of one millimetre a turn in metres a radian."""

LENGTHS: Final[Mapping[str, Fraction]] = {
    "mm": Fraction(1, 1000),
    "cm": Fraction(1, 100),
    "m": Fraction(1),
    "um": Fraction(1, 1_000_000),
    "inch": Fraction(254, 10_000),
    "ft": Fraction(3048, 10_000),
    "mil": Fraction(254, 10_000_000),
    "px": Fraction(254, 960_000),
    "pt": Fraction(254, 720_000),
}
"""Length units by name, exactly [m]; px and pt as CSS has them, 96 and 72 to the inch."""


def lengths_in(unit: str, names: Iterable[str]) -> dict[str, float]:
    """Return the sizes of length units, by name, in another one, each correctly rounded.

    Examples
    --------
    >>> lengths_in("mm", ("m", "inch"))
    {'m': 1000.0, 'inch': 25.4}
    """
    return {name: float(LENGTHS[name] / LENGTHS[unit]) for name in names}
