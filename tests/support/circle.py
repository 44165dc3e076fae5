"""The circle of section 6 of the paper as commanded motion, and its radial error."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BPoly

from .drives import AMPLITUDE as RADIUS
from .drives import OMEGA

T_STAR = 0.5
SPEED = RADIUS * OMEGA
"""V_c [m/s]."""


class Circle(NamedTuple):
    """Times [s] from the turning point of x, and both commands about the centre [m], at a constant period."""

    t: NDArray[np.float64]
    X: NDArray[np.float64]
    Y: NDArray[np.float64]

    def error(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
        """Fractional radial error on [-t*, t*], as Figure 11 has it."""
        inside = np.abs(self.t) <= T_STAR * (1.0 + 1e-9)
        return (np.hypot(x, y)[inside] - RADIUS) / RADIUS


def circle(ratio: float, period: float, end: float = T_STAR) -> Circle:
    """Eqs. (26)-(30): n = 10, t* = 0.5 s, V(½) = ratio V_c, from Θ = -π/2 until `end`; x turns at t = 0.

    The time of the first sample is chosen so that a sample falls on Θ = -π/2.
    """
    speed = np.ones(11)
    speed[5] = (256.0 * ratio - 193.0) / 63.0
    theta_star = OMEGA * T_STAR * speed.mean()
    start = -(T_STAR + (0.5 * math.pi - theta_star) / OMEGA)
    t = start + period * np.arange(math.floor((end - start) / period + 1e-9) + 1)
    travel = BPoly(speed[:, None], [-T_STAR, T_STAR]).antiderivative()
    outside = np.minimum(t + T_STAR, 0.0) + np.maximum(t - T_STAR, 0.0)
    theta = -theta_star + OMEGA * (travel(np.clip(t, -T_STAR, T_STAR)) + outside)
    return Circle(t, RADIUS * np.cos(theta), RADIUS * np.sin(theta))
