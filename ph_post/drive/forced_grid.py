"""The responses of :mod:`ph_post.drive.forced` for whole arrays of β and t at once.

The same sums by the same recurrences. Where the scalar code branches on y = βt and w = Ωt, every branch is
evaluated inside the range in which it holds and the right one is picked: that costs three times the work of
one branch and none of Python's.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 4.1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from ph_post.drive.forced import DAMPED, RUN_IN, SWUNG, TERMS, TOP
from ph_post.types import Array

_HIGHEST: Final = TOP + 2 * TERMS
_INVERSE_FACTORIALS: Final = [1.0 / math.factorial(k) for k in range(_HIGHEST + RUN_IN + 1)]


class Responses(NamedTuple):
    """Responses to 1, t, sin t, 1 - cos t and t - sin t, as in :class:`ph_post.drive.forced.Response`."""

    step: Array
    ramp: Array
    sine: Array
    versine: Array
    lagging: Array


def free_motor_responses(order: int, beta: Array, t: Array) -> Responses:
    """Respond to the five forcings of unit angular frequency after `t` from rest.

    Parameters
    ----------
    order : int
        `SPEED` or `ANGLE` of :mod:`ph_post.drive.forced`.
    beta, t : ndarray
        β and t in units of Ω and 1/Ω, not negative; broadcast against each other.

    Notes
    -----
    Implements the integrals in Eqs. (15) and (17) of [1]_ for Eq. (18).
    """
    y, w = np.broadcast_arrays(beta * t, t)
    small = _phi_small(np.minimum(y, DAMPED))
    large = _phi_large(np.maximum(y, DAMPED))
    damped = y > DAMPED
    phi = [np.where(damped, far, near) for far, near in zip(large, small, strict=False)]
    first, second, third = _swing_sums(order + 1, y, w, phi, small)
    power = w**order
    return Responses(
        step=power * phi[order],
        ramp=power * w * phi[order + 1],
        sine=power * w * first,
        versine=power * w * w * second,
        lagging=power * w * w * w * third,
    )


def _phi_small(y: Array) -> list[Array]:
    """φ_k(-y) for y <= DAMPED, from far above backward."""
    value = np.zeros_like(y)
    values = []
    for inverse_factorial in reversed(_INVERSE_FACTORIALS):
        value = inverse_factorial - y * value
        values.append(value)
    values.reverse()
    values[0] = np.exp(-y)
    return values


def _phi_large(y: Array) -> list[Array]:
    """φ_k(-y) up to TOP for y >= DAMPED, forward."""
    values = [np.exp(-y), -np.expm1(-y) / y]
    for k in range(1, TOP):
        values.append((_INVERSE_FACTORIALS[k] - values[k]) / y)
    return values


def _swing_sums(k: int, y: Array, w: Array, phi: list[Array], small: list[Array]) -> list[Array]:
    """S_k, S_{k+1}, S_{k+2} for k = 2 or 3."""
    swung, damped = w > SWUNG, y > DAMPED
    slow = np.minimum(w, SWUNG)
    far = _swing_far(y, np.maximum(w, SWUNG), phi)
    dull = _swing_damped(np.maximum(y, DAMPED), slow)
    return [
        np.where(swung, far[i], np.where(damped, dull[i], _alternating(small[i::2], slow)))
        for i in range(k, k + 3)
    ]


def _alternating(coefficients: Sequence[Array | float], w: Array) -> Array:
    """Σ (-w²)^n coefficients[n] by Horner's rule, TERMS terms."""
    total, square = np.zeros_like(w), w * w
    for value in reversed(coefficients[:TERMS]):
        total = value - square * total
    return total


def _swing_damped(y: Array, w: Array) -> list[Array]:
    """S_k by index: S_{k+1} = (c_k - S_k) / y with c_k = Σ (-w²)^n / (k + 2n)!."""
    nothing = np.zeros_like(y)
    values = [nothing, nothing, _second_sum(y, w)]
    for k in range(2, TOP):
        values.append((_alternating(_INVERSE_FACTORIALS[k::2], w) - values[k]) / y)
    return values


def _swing_far(y: Array, w: Array, phi: list[Array]) -> list[Array]:
    """S_k by index: S_{k+2} = (φ_k - S_k) / w²."""
    square = w * w
    first = (y * np.cos(w) + w * np.sin(w) - y * np.exp(-y)) / (y * y + square)
    second = _second_sum(y, w)
    third, fourth = (phi[1] - first) / square, (phi[2] - second) / square
    return [np.zeros_like(y), first, second, third, fourth, (phi[3] - third) / square]


def _second_sum(y: Array, w: Array) -> Array:
    """S_2 in closed form."""
    return np.asarray((y * np.sinc(w / np.pi) - np.cos(w) + np.exp(-y)) / (y * y + w * w))
