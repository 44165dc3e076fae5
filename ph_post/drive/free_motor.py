"""Closed-form response of the free motor in the gap to simple forcings, without loss of digits.

In the gap the motor obeys ω̇ + βω = C f(t) (Eq. 16). For f = 1, t, sin Ωt, 1 - cos Ωt and t - sin(Ωt)/Ω the
solutions from rest are convolutions with exp(-βt) (speed) and (1 - exp(-βt))/β (angle). Eqs. (21), (22) of
[1]_ give them as differences of large terms; here they stand as

    φ_k(-y) = Σ (-y)^n / (n + k)!            and    S_k(y, w) = Σ (-w²)^n φ_{k+2n}(-y)

with y = βt and w = Ωt, each evaluated by the recurrence that loses nothing at that y and w. The array form
evaluates every branch inside its range and picks the right one.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 4.1.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from ph_post.types import Array

DAMPED: Final = 3.0
"""y above which the forward recurrences in 1/y lose less than the backward ones (both at most 1 digit)."""

SWUNG: Final = 2.0
"""w above which dividing by w² loses less than summing the series in w² (which then needs few terms)."""

TERMS: Final = 11
"""Terms of the series in w² for w <= SWUNG: the first one dropped is 2^22 · 2!/24! < 2e-17 of the sum."""

TOP: Final = 5
"""Highest order k asked for."""

_HIGHEST: Final = TOP + 2 * TERMS

RUN_IN: Final = 3
"""Orders above the highest at which the backward recurrence starts from nothing. The error of that start
shrinks by y^n k!/(k + n)! on its way down n orders: for y <= DAMPED it is 4e-19 at k = TOP, and below 1e-20
of the sum in every term of the series in w²."""

_INVERSE_FACTORIALS: Final = [1.0 / math.factorial(k) for k in range(_HIGHEST + RUN_IN + 1)]

SPEED: Final = 1
"""Order of the response for the motor's speed: one integration of the forcing."""

ANGLE: Final = 2
"""Order of the response for the motor's angle: two integrations of the forcing."""


class Response(NamedTuple):
    """Responses at time t to 1, t, sin Ωt, 1 - cos Ωt and t - sin(Ωt)/Ω; times C, rad/s or rad."""

    step: float
    ramp: float
    sine: float
    versine: float
    lagging: float


def free_motor_response(order: int, beta: float, omega: float, t: float) -> Response:
    """Respond to the five forcings after `t` seconds from rest.

    Parameters
    ----------
    order : int
        `SPEED` for ω/C, `ANGLE` for θ/C.
    beta, omega : float
        β and Ω [1/s], not negative.
    t : float
        Time since the gap opened [s], not negative.

    Returns
    -------
    Response

    Notes
    -----
    Implements the integrals in Eqs. (15) and (17) of [1]_ for Eq. (18).

    Examples
    --------
    >>> round(free_motor_response(ANGLE, 0.0, 1.0, 2.0).step, 12)  # t² / 2
    2.0
    """
    y, w = beta * t, omega * t
    phi = phi_functions(y)
    first, second, third = _swing_sums(order + 1, y, w, phi)
    power = t**order
    return Response(
        step=power * phi[order],
        ramp=power * t * phi[order + 1],
        sine=power * w * first,
        versine=power * w * w * second,
        lagging=power * t * w * w * third,
    )


def phi_functions(y: float) -> list[float]:
    """Return φ_0(-y), φ_1(-y) … for y >= 0, up to TOP at least.

    Forward, φ_{k+1} = (1/k! - φ_k) / y, for large y; backward from far above TOP for small y.
    """
    if y > DAMPED:
        values = [math.exp(-y), -math.expm1(-y) / y]
        for k in range(1, TOP):
            values.append((_INVERSE_FACTORIALS[k] - values[k]) / y)
        return values
    value = 0.0
    values = []
    for inverse_factorial in reversed(_INVERSE_FACTORIALS):
        value = inverse_factorial - y * value
        values.append(value)
    values.reverse()
    values[:2] = (math.exp(-y), -math.expm1(-y) / y if y else 1.0)
    return values


def _swing_sums(k: int, y: float, w: float, phi: list[float]) -> list[float]:
    """S_k, S_{k+1}, S_{k+2} for k = 2 or 3."""
    if w > SWUNG:
        return _swing_far(y, w, phi)[k : k + 3]
    if y > DAMPED:
        return _swing_damped(y, w)[k : k + 3]
    return [_alternating(phi[first::2], w) for first in range(k, k + 3)]


def _alternating(coefficients: list[float], w: float) -> float:
    """Σ (-w²)^n coefficients[n] by Horner's rule, TERMS terms."""
    total, square = 0.0, w * w
    for value in reversed(coefficients[:TERMS]):
        total = value - square * total
    return total


def _swing_damped(y: float, w: float) -> list[float]:
    """S_k by index for y > DAMPED, w <= SWUNG: S_{k+1} = (c_k - S_k) / y with c_k = Σ (-w²)^n / (k + 2n)!."""
    values = [0.0, 0.0, _second_sum(y, w)]
    for k in range(2, TOP):
        values.append((_alternating(_INVERSE_FACTORIALS[k::2], w) - values[k]) / y)
    return values


def _swing_far(y: float, w: float, phi: list[float]) -> list[float]:
    """S_k by index for w > SWUNG: S_{k+2} = (φ_k - S_k) / w²."""
    first = (y * math.cos(w) + w * math.sin(w) - y * math.exp(-y)) / (y * y + w * w)
    second = _second_sum(y, w)
    third = (phi[1] - first) / (w * w)
    fourth = (phi[2] - second) / (w * w)
    return [0.0, first, second, third, fourth, (phi[3] - third) / (w * w)]


def _second_sum(y: float, w: float) -> float:
    """S_2 in closed form, for y > DAMPED or w > SWUNG where its terms do not cancel."""
    sinc = math.sin(w) / w if w else 1.0
    return (y * sinc - math.cos(w) + math.exp(-y)) / (y * y + w * w)


class Responses(NamedTuple):
    """Responses to 1, t, sin t, 1 - cos t and t - sin t, as in :class:`ph_post.drive.free_motor.Response`."""

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
        `SPEED` or `ANGLE` of :mod:`ph_post.drive.free_motor`.
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
    first, second, third = _swing_sums_grid(order + 1, y, w, phi, small)
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


def _swing_sums_grid(k: int, y: Array, w: Array, phi: list[Array], small: list[Array]) -> list[Array]:
    """S_k, S_{k+1}, S_{k+2} for k = 2 or 3."""
    swung, damped = w > SWUNG, y > DAMPED
    slow = np.minimum(w, SWUNG)
    far = _swing_far_grid(y, np.maximum(w, SWUNG), phi)
    dull = _swing_damped_grid(np.maximum(y, DAMPED), slow)
    return [
        np.where(swung, far[i], np.where(damped, dull[i], _alternating_grid(small[i::2], slow)))
        for i in range(k, k + 3)
    ]


def _alternating_grid(coefficients: Sequence[Array | float], w: Array) -> Array:
    """Σ (-w²)^n coefficients[n] by Horner's rule, TERMS terms."""
    total, square = np.zeros_like(w), w * w
    for value in reversed(coefficients[:TERMS]):
        total = value - square * total
    return total


def _swing_damped_grid(y: Array, w: Array) -> list[Array]:
    """S_k by index: S_{k+1} = (c_k - S_k) / y with c_k = Σ (-w²)^n / (k + 2n)!."""
    nothing = np.zeros_like(y)
    values = [nothing, nothing, _second_sum_grid(y, w)]
    for k in range(2, TOP):
        values.append((_alternating_grid(_INVERSE_FACTORIALS[k::2], w) - values[k]) / y)
    return values


def _swing_far_grid(y: Array, w: Array, phi: list[Array]) -> list[Array]:
    """S_k by index: S_{k+2} = (φ_k - S_k) / w²."""
    square = w * w
    first = (y * np.cos(w) + w * np.sin(w) - y * np.exp(-y)) / (y * y + square)
    second = _second_sum_grid(y, w)
    third, fourth = (phi[1] - first) / square, (phi[2] - second) / square
    return [np.zeros_like(y), first, second, third, fourth, (phi[3] - third) / square]


def _second_sum_grid(y: Array, w: Array) -> Array:
    """S_2 in closed form."""
    return np.asarray((y * np.sinc(w / np.pi) - np.cos(w) + np.exp(-y)) / (y * y + w * w))
