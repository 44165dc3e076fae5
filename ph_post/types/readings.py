"""Readings that a person takes by hand: of a dial indicator, of calipers on a test cut, of a ball bar. SI units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import msgspec

from ph_post.types.arrays import Array

STEPS: Final = ("from minus", "beyond", "from plus")
"""What the first three readings of a row are: at the place coming from minus, further on, at the place coming back."""

CUTS: Final[Mapping[str, tuple[str, ...]]] = {
    "circle_ccw": ("d0", "d45", "d90", "d135"),
    "circle_cw": ("d0", "d45", "d90", "d135"),
    "square_inside": ("x", "y"),
    "square_outside": ("x", "y"),
    "slot": ("width",),
}
"""Shapes of the test cut, and what is measured on each: diameters at angles from X towards Y, widths along an axis."""


class DialRow(msgspec.Struct, frozen=True, kw_only=True):
    """Readings of a dial indicator at one place of an axis, in the order of :data:`STEPS`, then again and again.

    `readings` [m] are plus where the table moved to plus: from minus, beyond by the swing, from plus, from minus,
    from plus, … `place` [m] and `feed` [m/s] are None where the person did not say them; `where` names the row.
    """

    axis: str
    readings: tuple[float, ...]
    where: str
    place: float | None = None
    feed: float | None = None


class CutWidths(msgspec.Struct, frozen=True, kw_only=True):
    """Widths of a test cut [m] by shape and direction, as :data:`CUTS` names them, several readings each.

    `size` is that of circles and squares, `tool` the cutter's diameter by its label [m].
    """

    size: float
    tool: float
    widths: Mapping[tuple[str, str], tuple[float, ...]]
    where: str


class BallBarTrace(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One arc of a ball bar: angles from the first axis of the plane to the second [rad] and radii [m], (n,).

    `turn` is +1 where the angle rises, counterclockwise, -1 where it falls. `feed` [m/s] is None where the file
    does not say it.
    """

    name: str
    plane: tuple[str, str]
    angle: Array
    radius: Array
    turn: int
    nominal: float | None = None
    feed: float | None = None


class Readings(msgspec.Struct, frozen=True, kw_only=True):
    """Everything that was read by hand, and by how much the dial test goes beyond its places, `swing` [m]."""

    name: str
    swing: float
    dial: Sequence[DialRow] = ()
    cut: CutWidths | None = None
    ball_bar: Sequence[BallBarTrace] = ()
