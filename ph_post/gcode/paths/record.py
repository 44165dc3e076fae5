"""A path that was read from a part program."""

from __future__ import annotations

from collections.abc import Mapping

import msgspec
import numpy as np

from ph_post.geometry.base import PiecewiseCurve
from ph_post.types import Array, IntArray, Path
from ph_post.units import MM

SAME_PLACE = 1e-6 * MM
"""Places closer than this along the path [m] are one: an end of a motion counts to the earlier motion."""


class ProgramPath(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The path of one chain of a program, and where on it each motion is.

    `motion` (k,) are the numbers of the chain's motions that go anywhere, in order; `s` (k + 1,) [m] the arc
    length of the path at the beginning of each, and at the end of the last. Where moves were fitted, that is
    the place on the curve nearest to the end of the move. `cubics` are the curves of G5 and G5.1 by row: of
    those a share is a part of the parameter, of other motions one of the length (of arcs the angle).
    `warnings` say what of the chain was left out.
    """

    path: Path
    chain: int
    motion: IntArray
    s: Array
    cubics: Mapping[int, PiecewiseCurve] = {}
    warnings: tuple[str, ...] = ()

    def to_motions(self, s: Array) -> tuple[IntArray, Array]:
        """Motions and shares (0 to 1) of them at arc lengths `s` [m], shape (n,).

        At a joint the earlier motion answers, with share 1.
        """
        s = np.clip(np.asarray(s, dtype=np.float64), self.s[0], self.s[-1])
        row = np.clip(np.searchsorted(self.s, s - SAME_PLACE, side="right") - 1, 0, self.motion.size - 1)
        share = (s - self.s[row]) / (self.s[row + 1] - self.s[row])
        near = np.abs(s - self.s[row + 1]) <= SAME_PLACE
        share = np.where(near, 1.0, np.clip(share, 0.0, 1.0))
        for number, curve in self._on_cubics(row):
            on = (row == number) & ~near
            share[on] = curve.parameter(share[on] * curve.length)
        return self.motion[row], share

    def to_path(self, motion: IntArray, share: Array) -> Array:
        """Arc lengths [m] of shares of motions; of a motion that goes nowhere, the end of the one before."""
        row = np.searchsorted(self.motion, motion)
        found = (row < self.motion.size) & (self.motion[np.minimum(row, self.motion.size - 1)] == motion)
        share = np.array(share, dtype=np.float64)
        for number, curve in self._on_cubics(row):
            on = row == number
            share[on] = curve.arc_length(share[on]) / curve.length
        low, high = self.s[row], self.s[np.minimum(row + 1, self.motion.size)]
        return np.where(found, low + share * (high - low), low)

    def _on_cubics(self, row: IntArray) -> list[tuple[int, PiecewiseCurve]]:
        """Curves of those rows that are cubics."""
        return [(number, self.cubics[number]) for number in sorted(set(self.cubics) & set(row.tolist()))]
