"""A plan's motion, from the Bernstein coefficients of its phases alone."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np
from scipy.interpolate import BPoly, PPoly

from ph_post.types import Phase

NOISE = 1e-15
"""Sums of phases are off by so much [m], and so a dwell moves a little."""


class Planned:
    """Place and speed of phases as functions of time; `rests` are the places where it stands. SI units."""

    def __init__(self, phases: Sequence[Phase]) -> None:
        degree = max(phase.speed.size for phase in phases) - 1
        edges = np.cumsum([0.0, *(phase.duration for phase in phases)])
        self.end = float(edges[-1])
        columns = np.column_stack([_elevated(np.asarray(phase.speed), degree) for phase in phases])
        self.speed = BPoly(columns, edges)
        self.place = self.speed.antiderivative()
        turns = PPoly.from_bernstein_basis(self.speed.derivative()).roots(extrapolate=False)
        times = np.concatenate([edges, turns[np.isfinite(turns)]])
        still = np.abs(self.speed(times)) <= 1e-6 * np.abs(columns).max()
        self.rests = self.place(times[still])

    def times_at(self, s: np.ndarray, *, late: bool) -> np.ndarray:
        """When the motion passes places, counted from its start; at a rest the last moment or the first."""
        low, high = np.zeros(s.size), np.full(s.size, self.end)
        for _ in range(80):
            middle = 0.5 * (low + high)
            before = self.place(middle) <= s + NOISE if late else self.place(middle) < s - NOISE
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        return high


def _elevated(coefficients: np.ndarray, degree: int) -> np.ndarray:
    n = coefficients.size - 1
    matrix = np.zeros((degree + 1, n + 1))
    for i in range(degree + 1):
        for j in range(max(0, i - degree + n), min(n, i) + 1):
            matrix[i, j] = comb(n, j) * comb(degree - n, i - j) / comb(degree, i)
    return matrix @ coefficients
