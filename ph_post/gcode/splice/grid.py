"""Offsets on the grid of the decimals that a dialect writes, in the units of a program."""

from __future__ import annotations

from ph_post.errors import InputError
from ph_post.gcode.dialect import Dialect
from ph_post.gcode.jogs import FINEST
from ph_post.types import Axis
from ph_post.units import MM


def word_decimals(dialect: Dialect, units: float) -> int:
    """Decimals of a length in a program whose unit is so many metres.

    A dialect's decimals are those of a mm; of an inch, 25 times as long, one more is taken.

    Examples
    --------
    >>> from ph_post.gcode.registry import find_dialect
    >>> word_decimals(find_dialect("grbl"), 1e-3), word_decimals(find_dialect("grbl"), 25.4e-3)
    (4, 5)
    """
    return dialect.capabilities.decimals + (units > MM)


def half_gap(axis: Axis, dialect: Dialect, units: float) -> float:
    """Half the lost motion of an axis on that grid [m].

    Raises
    ------
    InputError
        Where the decimals are too few for it.
    """
    step = units * 10.0 ** -word_decimals(dialect, units)
    half = 0.5 * axis.gap.lost_motion
    rounded = float(round(half / step) * step)
    if rounded == 0.0 or abs(rounded - half) > axis.gap.lost_motion / FINEST:
        raise InputError(
            "--dialect", f"the decimals of {dialect.name} are too few for an offset of axis {axis.name}",
            expected=f">= {FINEST * step / MM:g} mm", got=f"{axis.gap.lost_motion / MM:.3g} mm",
        )  # fmt: skip
    return rounded
