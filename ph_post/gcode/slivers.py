"""Blocks too short for the controller, given to a neighbour."""

from __future__ import annotations

import msgspec
import numpy as np

from ph_post.gcode.record import DWELL, Blocks
from ph_post.gcode.shape import LINE, SNAP, Shape
from ph_post.types import BoolArray

_ROUNDING = 1.0 - 1e-9
"""A block that lasts a servo period but for rounding is long enough."""


def without_slivers(blocks: Blocks, shape: Shape, period: float, block_time: float) -> Blocks:
    """Join blocks shorter than a servo period to a neighbour, where one can take them.

    They come from stretches that are hardly any, and from pieces of a path that are passed in less than a
    period. LinuxCNC spends a period on each, and nearly stops where rounding has turned its direction.

    A neighbour takes `block_time` of them at most, nothing across a wall or a reversal, and only what lies on
    its own piece unless it is a chord: those are checked and cut afterwards.
    """
    merger = _Merger(blocks, shape, block_time)
    short = (blocks.end - blocks.start < period * _ROUNDING) & (blocks.kind != DWELL)
    for i in np.flatnonzero(short).tolist():
        if merger.duration(i) < period * _ROUNDING:
            merger.give_away(i)
    return merger.result()


class _Merger:
    """Blocks of which some have gone into others; each is known by the number it had."""

    def __init__(self, blocks: Blocks, shape: Shape, most: float) -> None:
        self.blocks = blocks
        self.most = most
        self.piece = shape.piece_at(0.5 * (blocks.s0 + blocks.s1))
        self.open = _open_boundaries(blocks, shape)
        self.first = np.arange(blocks.kind.size)
        self.last = self.first.copy()
        self.owner = self.first.copy()
        self.gained = np.zeros(blocks.kind.size)

    def duration(self, i: int) -> float:
        """Time that a block has by now."""
        return float(self.blocks.end[self.last[i]] - self.blocks.start[self.first[i]])

    def give_away(self, i: int) -> None:
        """Join a block to the one before it, or else to the one after it, or leave it."""
        before, after = self.first[i] - 1, self.last[i] + 1
        if before >= 0 and self.open[before] and self._takes(self.owner[before], i):
            taker = self.owner[before]
            self.last[taker] = self.last[i]
        elif after < self.owner.size and self.open[after - 1] and self._takes(after, i):
            taker = after
            self.first[taker] = self.first[i]
        else:
            return
        self.gained[taker] += self.duration(i)
        self.owner[self.first[i] : self.last[i] + 1] = taker

    def _takes(self, taker: int, i: int) -> bool:
        fits = self.blocks.kind[taker] == LINE or self.piece[taker] == self.piece[i]
        return bool(fits) and self.gained[taker] + self.duration(i) <= self.most

    def result(self) -> Blocks:
        """Return the blocks that are left, with what they have taken."""
        left = np.flatnonzero(self.owner == np.arange(self.owner.size))
        first, last = self.first[left], self.last[left]
        rows = {name: getattr(self.blocks, name)[left] for name in Blocks.__struct_fields__}
        return msgspec.structs.replace(
            Blocks(**rows),
            start=self.blocks.start[first],
            end=self.blocks.end[last],
            s0=self.blocks.s0[first],
            s1=self.blocks.s1[last],
        )


def _open_boundaries(blocks: Blocks, shape: Shape) -> BoolArray:
    """Tell where a block and the next may be one: no wall, reversal, dwell or end of rapids between them."""
    way = np.sign(blocks.s1 - blocks.s0)
    place = shape.wrapped(blocks.s1[:-1])
    near = np.searchsorted(shape.walls, [place - SNAP, place + SNAP])
    dwells = blocks.kind == DWELL
    alike = (way[:-1] == way[1:]) & (blocks.rapid[:-1] == blocks.rapid[1:])
    return np.asarray(alike & (near[0] == near[1]) & ~dwells[:-1] & ~dwells[1:])
