"""What is changed in a part program, told on its motions; splicing writes it into the text."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec

from ph_post.types import Array, IntArray


class Shift(msgspec.Struct, frozen=True, kw_only=True):
    """A short move of one axis while the path stands still, by `travel` [m], signed, with F `velocity` [m/s].

    After it the axis rests for `pause` [s].
    """

    axis: str
    travel: float
    velocity: float
    pause: float


class Stop(msgspec.Struct, frozen=True, kw_only=True):
    """The path stands still at the `share` (0 to 1) of a motion, rests for `pause` [s], and axes are shifted.

    Lasting shifts are those that :attr:`Edits.offset` has too; of others (out and back) the sum is zero.
    """

    motion: int
    share: float
    pause: float
    shifts: tuple[Shift, ...]


class Dip(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A stretch that is cut into blocks of a known time each: the feed in a window.

    `motion` (k + 1,) and `share` (k + 1,) are the ends of the blocks, in the order of travel, places on the
    program's own motions; `duration` (k,) [s].
    """

    motion: IntArray
    share: Array
    duration: Array


class Edits(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """All changes to one program.

    `offset` (m, 3) [m]: what X, Y and Z carry at the end of every motion, on the grid of the dialect's
    decimals in the program's units. A rapid goes from the offset before it to its own; a cutting motion
    carries one offset, unless a stop on it changes that. At the end of every chain it is zero, where need be
    by a stop behind the last motion. `stops` and `dips` in order of travel. `amplitude` [m] by axis: the
    lasting offset, which is + or - this or zero; `pulse` [m] by axis: the largest shift out and back.
    `warnings` name what was left alone.
    """

    offset: Array
    stops: tuple[Stop, ...] = ()
    dips: tuple[Dip, ...] = ()
    amplitude: Mapping[str, float] = {}
    pulse: Mapping[str, float] = {}
    warnings: tuple[str, ...] = ()
