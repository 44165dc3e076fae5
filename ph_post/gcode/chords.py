"""Straight moves along a curve: where they have to end so that the curve stays within the chord tolerance."""

from __future__ import annotations

import numpy as np

from ph_post.gcode.shape import Shape
from ph_post.geometry.track import Track
from ph_post.types import Array, IntArray

_SAMPLES = 33
"""Places a piece at which the curvature is looked at, to begin with; the deviation is checked afterwards."""

_PROBES = np.linspace(0.0, 1.0, 9)[1:-1]
"""Where a curve's distance from its chord is taken. The middle is among them, where that of a short piece is
largest; where it is largest elsewhere they miss it by less than (1/8)² of itself."""

_RESERVE = 1.0 - 1.0 / 8**2
"""Part of the chord tolerance that the distances found may take, for what the probes miss."""

_AIM = 0.94
"""The part of the tolerance that the count of chords aims at. Where the curvature changes some come out
worse than counted, and each that fails the check is cut in two: on sine waves 0.94 gives the fewest."""


class Gauge:
    """Number of chords along the path, ∫ √(κ / 8δ) ds, as a chord of length h leaves a circle by κ h² / 8.

    Parameters
    ----------
    track : Track
    tolerance : float
        δ, how far the curve may leave a chord [m].
    """

    def __init__(self, track: Track, tolerance: float) -> None:
        m = len(track.pieces)
        u = np.tile(np.linspace(0.0, 1.0, _SAMPLES), m)
        piece = np.repeat(np.arange(m), _SAMPLES)
        self._s = np.maximum.accumulate(track.arc_length(piece, u))
        _, first, second = track.derivatives(piece, u, 2)
        speed = np.sqrt((first * first).sum(axis=1))
        square = (first * first).sum(axis=1) * (second * second).sum(axis=1)
        area = np.sqrt(np.maximum(square - (first * second).sum(axis=1) ** 2, 0.0))
        # √κ ds = √(|r' × r''| / |r'|) du; what a cusp makes of it the check puts right
        rate = np.sqrt(np.divide(area, speed, out=np.zeros_like(area), where=speed > 0.0))
        rate /= np.sqrt(8.0 * _AIM * tolerance)
        steps = 0.5 * (rate[1:] + rate[:-1]) * np.diff(u)
        steps[_SAMPLES - 1 :: _SAMPLES] = 0.0
        # one chord a kilometre besides: keeps the count strictly growing where the path is straight
        self._count = np.concatenate([[0.0], np.cumsum(steps + 1e-3 * np.diff(self._s))])

    def count(self, s: Array) -> Array:
        """Return the number of chords from the path's beginning to places on it [m]."""
        return np.asarray(np.interp(s, self._s, self._count))

    def place(self, count: Array) -> Array:
        """Return the places [m] up to which there are so many chords."""
        return np.asarray(np.interp(count, self._count, self._s))


def shares(shape: Shape, s0: Array, s1: Array, tolerance: float) -> IntArray:
    """Into how many parts the chords from `s0` to `s1` have to be cut, 1 where they hold the tolerance.

    Parameters
    ----------
    shape : Shape
    s0, s1 : Array, shape (n,)
        Ends of the chords, as places along the motion [m].
    tolerance : float
        Largest distance of the path between them from the straight move [m].
    """
    ratio = deviation(shape, s0, s1) / (tolerance * _RESERVE)
    return np.where(ratio > 1.0, np.maximum(2, np.ceil(np.sqrt(ratio))), 1).astype(np.int64)


def deviation(shape: Shape, s0: Array, s1: Array) -> Array:
    """Largest distance [m] of the path from the straight moves between `s0` and `s1`, shape (n,)."""
    start, end = shape.positions(s0), shape.positions(s1)
    inner = shape.positions((s0[:, None] + (s1 - s0)[:, None] * _PROBES).ravel())
    offset = inner.reshape(s0.size, _PROBES.size, -1) - start[:, None]
    chord = (end - start)[:, None]
    square = (chord * chord).sum(-1)
    along = np.divide((offset * chord).sum(-1), square, out=np.zeros(offset.shape[:2]), where=square > 0.0)
    foot = np.clip(along, 0.0, 1.0)[..., None] * chord
    return np.asarray(np.sqrt(((offset - foot) ** 2).sum(-1)).max(axis=1))
