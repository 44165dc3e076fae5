"""A path that was read from a part program."""

from __future__ import annotations

import msgspec
import numpy as np

from ph_post.types import Array, IntArray, Path
from ph_post.units import MM

SAME_PLACE = 1e-6 * MM
"""Places closer than this along the path [m] are one: an end of a motion counts to the earlier motion."""


class ProgramPath(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The path of one chain of a program, and where on it each motion is.

    `motion` (k,) are the numbers of the chain's motions that go anywhere, in order; `s` (k + 1,) [m] the arc
    length of the path at the beginning of each, and at the end of the last. Where moves were fitted, that is
    the place on the curve nearest to the end of the move. `warnings` say what of the chain was left out.
    """

    path: Path
    chain: int
    motion: IntArray
    s: Array
    warnings: tuple[str, ...] = ()

    def to_motions(self, s: Array) -> tuple[IntArray, Array]:
        """Motions and shares (0 to 1) of them at arc lengths `s` [m], shape (n,).

        A share of a motion's length; at a joint the earlier motion answers, with share 1.
        """
        s = np.clip(np.asarray(s, dtype=np.float64), self.s[0], self.s[-1])
        row = np.clip(np.searchsorted(self.s, s - SAME_PLACE, side="right") - 1, 0, self.motion.size - 1)
        share = (s - self.s[row]) / (self.s[row + 1] - self.s[row])
        near = np.abs(s - self.s[row + 1]) <= SAME_PLACE
        return self.motion[row], np.where(near, 1.0, np.clip(share, 0.0, 1.0))

    def to_path(self, motion: IntArray, share: Array) -> Array:
        """Arc lengths [m] of shares of motions; of a motion that goes nowhere, the end of the one before."""
        row = np.searchsorted(self.motion, motion)
        found = (row < self.motion.size) & (self.motion[np.minimum(row, self.motion.size - 1)] == motion)
        low, high = self.s[row], self.s[np.minimum(row + 1, self.motion.size)]
        return np.where(found, low + share * (high - low), low)
