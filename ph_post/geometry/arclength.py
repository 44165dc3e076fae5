"""Arc length of a chain of pieces, and its inverse."""

from __future__ import annotations

from typing import Final

import numpy as np

from ph_post.geometry.panels import Panels
from ph_post.geometry.piece import CHUNK
from ph_post.types import Array, IntArray, frozen

FAST_STEPS: Final = 3
"""Newton steps for all rows: enough from the monotone cubic guess wherever the speed does not vanish."""

SLOW_STEPS: Final = 80
"""Bracketed steps for the rows that remain, next to cusps: bisection alone would take 53."""

SETTLED: Final = 16.0 * float(np.finfo(np.float64).eps)
"""Residual, relative to the panel's length, below which nothing is left but rounding."""


class ArcLength:
    """The arc length s of a chain of pieces as a function of (piece, u), and back.

    Parameters
    ----------
    panels : Panels
        Ordered by piece and place.
    """

    def __init__(self, panels: Panels) -> None:
        self.panels = panels
        ends = np.zeros(panels.length.size + 1)
        ends[1:] = np.cumsum(panels.length, dtype=np.longdouble)
        self.ends = frozen(ends)
        """Arc length at the panels' ends [m], shape (panels + 1,)."""
        first_of_piece = np.flatnonzero(np.diff(panels.piece, prepend=-1))
        self.starts = frozen(np.append(self.ends[first_of_piece], self.ends[-1]))
        """Arc length at the pieces' ends [m], shape (pieces + 1,)."""
        self._first_panel = first_of_piece
        self._key = panels.piece + panels.first
        self._guess = _monotone_guess(panels)

    def at(self, piece: IntArray, u: Array) -> Array:
        """Arc length from the chain's beginning [m]."""
        panel = np.searchsorted(self._key, piece + u, side="right") - 1
        # The sum rounds u to the grain of the piece's number: set that right.
        panels = self.panels
        panel = np.where((panels.piece[panel] > piece) | (u < panels.first[panel]), panel - 1, panel)
        panel = np.maximum(panel, self._first_panel[piece])
        x = self._to_x(panel, u)
        value, _ = self._horner([row.take(panel) for row in panels.power], x)
        s: Array = self.ends[panel] + value
        return s

    def locate(self, s: Array) -> tuple[IntArray, Array]:
        """Piece and u at arc length `s` [m], clipped to the chain; the later piece answers at a joint."""
        s = np.clip(s, 0.0, self.ends[-1])
        piece, u = np.empty(s.size, dtype=np.int64), np.empty(s.size)
        for first in range(0, s.size, CHUNK):
            part = slice(first, first + CHUNK)
            panel = np.searchsorted(self.ends[1:-1], s[part], side="right")
            x = self._invert(panel, s[part] - self.ends[panel])
            piece[part], u[part] = self.panels.piece[panel], self._to_u(panel, x)
        return piece, u

    def _to_u(self, panel: IntArray, x: Array) -> Array:
        first, last = self.panels.first[panel], self.panels.last[panel]
        return np.where(x >= 1.0, last, first + 0.5 * (x + 1.0) * (last - first))

    def _to_x(self, panel: IntArray, u: Array) -> Array:
        first, last = self.panels.first[panel], self.panels.last[panel]
        return np.where(u >= last, 1.0, 2.0 * (u - first) / (last - first) - 1.0)

    def _invert(self, panel: IntArray, target: Array) -> Array:
        """Solve s(x) = target on each row's panel."""
        length = self.panels.length[panel]
        part = np.clip(target / length, 0.0, 1.0)
        a, b, c = (row.take(panel) for row in self._guess)
        x: Array = np.clip(part * (a + part * (b + part * c)) - 1.0, -1.0, 1.0)
        power = [row.take(panel) for row in self.panels.power]
        for _ in range(FAST_STEPS):
            value, slope = self._horner(power, x)
            value -= target
            np.divide(value, slope, out=value, where=slope > 0.0)
            x -= value
            np.clip(x, -1.0, 1.0, out=x)
        value, _ = self._horner(power, x)
        slow = np.flatnonzero(np.abs(value - target) > SETTLED * length)
        if slow.size:
            x[slow] = self._bracketed([row[slow] for row in power], target[slow], x[slow])
        x[part <= 0.0] = -1.0
        x[part >= 1.0] = 1.0
        return x

    def _bracketed(self, power: list[Array], target: Array, x: Array) -> Array:
        """Newton's method, by bisection wherever it leaves the bracket."""
        low, high = np.full(x.size, -1.0), np.full(x.size, 1.0)
        for _ in range(SLOW_STEPS):
            value, slope = self._horner(power, x)
            value -= target
            low, high = np.where(value <= 0.0, x, low), np.where(value >= 0.0, x, high)
            new = x - np.divide(value, slope, out=np.zeros_like(x), where=slope > 0.0)
            inside = (new > low) & (new < high) & (slope > 0.0)
            new = np.where(inside, new, 0.5 * (low + high))
            if np.array_equal(new, x):
                break
            x = new
        return x

    @staticmethod
    def _horner(power: list[Array], x: Array) -> tuple[Array, Array]:
        """Value and slope of the arc length on the panel."""
        value, slope = power[-1].copy(), np.zeros_like(x)
        for coefficient in reversed(power[:-1]):
            slope *= x
            slope += value
            value *= x
            value += coefficient
        return value, slope


def _monotone_guess(panels: Panels) -> Array:
    """Monotone cubic Hermite interpolant of x + 1 over the part of a panel's length, powers 1 to 3."""
    k = np.arange(len(panels.power))[:, None]
    slopes = k * panels.power / panels.length
    last = slopes.sum(axis=0)
    first = np.where(k % 2 == 1, slopes, -slopes).sum(axis=0)
    # dx/dpart = 1 / slope; three times the chord's (2) is as steep as a monotone cubic may be.
    a, b = (1.0 / np.maximum(slope, 1.0 / 6.0) for slope in (first, last))
    return np.stack([a, 6.0 - 2.0 * a - b, a + b - 4.0])
