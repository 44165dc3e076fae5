"""The findings of a comparison of two programs. SI units; blocks and motions are numbered from 0."""

from __future__ import annotations

from typing import Literal

import msgspec

from ph_post.diff.travel import ComparedPaths
from ph_post.gcode.program import PartProgram
from ph_post.simulate.contour import ContourError

BlockKind = Literal["changed", "added", "removed", "writing"]

Span = tuple[int, int]
"""First and last block; the last is before the first where there is none: it would stand before the first."""


class BlockChange(msgspec.Struct, frozen=True, kw_only=True):
    """Neighbouring blocks that differ; `writing` where only comments, blanks, N words or spelling do."""

    kind: BlockKind
    a: Span
    b: Span


class Deviation(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch on which the tool paths are apart: blocks, way travelled, how far [m], where [m].

    `worst` says on which of the paths the place `where` is, 0 or 1, and `block` the block there.
    """

    a: Span
    b: Span
    s_a: tuple[float, float]
    s_b: tuple[float, float]
    amount: float
    worst: int
    block: int
    where: tuple[float, float, float]


class FeedChange(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch on which the feeds differ: lowest and highest of both [m/s], and of their ratio b to a.

    None for rapid moves and without an F.
    """

    a: Span
    b: Span
    s_a: tuple[float, float]
    feed_a: tuple[float, float] | None
    feed_b: tuple[float, float] | None
    ratio: tuple[float, float] | None


class TimeChange(msgspec.Struct, frozen=True, kw_only=True):
    """A stretch that takes another time [s]."""

    a: Span
    b: Span
    time_a: float
    time_b: float


class CommandChange(msgspec.Struct, frozen=True, kw_only=True):
    """A command other than a motion that only one program has, or both at different places.

    `what` in words; `a` and `b` the block in either program, None where it is not there.
    """

    what: str
    a: int | None
    b: int | None


class Timing(msgspec.Struct, frozen=True, kw_only=True):
    """The time that a program takes [s].

    `model` says how that was found. `rapids` is None where their speed is not known and they do not count.
    """

    total: float
    cutting: float
    dwells: float
    rapids: float | None
    model: Literal["controller", "length over feed"]


class Comparison(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Two programs compared, `programs`.

    `identical` byte for byte; `travel` the paths, `deviations`, `feeds`, `times`, `orders` what differs along
    them, `retimed` whether feeds and dwells ask for other times. `max_deviation` [m] is None where one of the
    programs has no motion. `declared` says what the programs say of their own compensation; `undone` [m] how
    far they are apart without it, None where none is declared. `errors` are the predicted contour errors,
    None where they were not asked for or not found.
    """

    programs: tuple[PartProgram, PartProgram]
    identical: bool
    tolerance: float
    blocks: tuple[BlockChange, ...]
    travel: ComparedPaths
    max_deviation: float | None
    deviations: tuple[Deviation, ...]
    feeds: tuple[FeedChange, ...]
    timing: tuple[Timing, Timing]
    times: tuple[TimeChange, ...]
    retimed: bool
    orders: tuple[CommandChange, ...]
    declared: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    undone: float | None = None
    errors: tuple[ContourError | None, ContourError | None] | None = None
    notes: tuple[str, ...] = ()

    @property
    def same(self) -> bool:
        """True where a machine does the same with both: path, feed, time, and everything beside them."""
        apart = self.max_deviation is None and len(self.travel.gaps) > 0
        return not (apart or self.deviations or self.feeds or self.retimed or self.orders)
