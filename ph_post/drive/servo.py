"""The servo loop of one axis while the gap is closed: constants, free and harmonic response.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, sections 3.1, 3.2 and 4.
"""

from __future__ import annotations

import math
from fractions import Fraction
from functools import lru_cache
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ph_post.types import Array, Servo

WELL_CONDITIONED: Final = 1e3
"""Condition number of the modes up to which the third-order loop is propagated by them (losing three digits
at most); nearer to a double root the matrix exponential is taken, which is slower."""


EPSILON: Final = 2.0**-52

TINY: Final = 1e-300
"""Added to λt so that sin(λt)/λt is 1 at 0; it changes no float above 1e-284."""


def effective_damping(servo: Servo) -> float:
    """Return c + k_d/k_p [s], the factor of ẋ (of ẍ in Eq. (7) differentiated) in the loop's equation."""
    return servo.c + servo.kd_over_kp


def discriminant(servo: Servo) -> float:
    """Δ = c² - 4b [s²] (section 4 of [1]_), rounded once: its sign is exact. k_d/k_p counts to c."""
    return float(Fraction(effective_damping(servo)) ** 2 - 4 * Fraction(servo.b))


class Rates(NamedTuple):
    """γ, λ [1/s] of section 4, the two decay rates γ - λ, γ + λ (both γ where Δ < 0), and whether Δ < 0."""

    gamma: float
    lam: float
    slow: float
    fast: float
    oscillates: bool


@lru_cache(maxsize=256)
def rates(servo: Servo) -> Rates:
    """Return γ = c/2b, λ = √|Δ|/2b and γ ∓ λ; the slow one as 1/(b (γ + λ)), which does not cancel."""
    delta = discriminant(servo)
    gamma = effective_damping(servo) / (2.0 * servo.b)
    lam = math.sqrt(abs(delta)) / (2.0 * servo.b)
    if delta < 0.0:
        return Rates(gamma, lam, gamma, gamma, oscillates=True)
    return Rates(gamma, lam, 1.0 / (servo.b * (gamma + lam)), gamma + lam, oscillates=False)


def is_stable(servo: Servo) -> bool:
    """Return whether the loop's free motion dies out (Routh: c + k_d > b k_i, gains relative to k_p)."""
    return effective_damping(servo) > servo.b * servo.ki_over_kp


def free_motion(servo: Servo, t: Any, maths: Any = math) -> tuple[Any, Any, Any, Any]:
    """Propagate position and speed of the free second-order loop (k_i = 0) by `t`.

    The closed forms of Eq. (19) of [1]_ and of its derivative, for all three signs of Δ: written with
    sin(λt)/λ and its hyperbolic counterpart they pass through Δ = 0 without losing digits, and with the slow
    decay in front nothing overflows.

    Parameters
    ----------
    servo : Servo
        b > 0, c > 0.
    t : float or array_like
        Times [s], not negative.
    maths : module
        ``math`` for a float, ``numpy`` for an array.

    Returns
    -------
    tuple of float or ndarray, like t
        E_11, E_12, E_21, E_22 with (x, ẋ)(t) = E (x, ẋ)(0).
    """
    gamma, lam, slow, fast, oscillates = rates(servo)
    angle = lam * t + TINY
    if oscillates:
        decay = maths.exp(-gamma * t)
        cosine = decay * maths.cos(angle)
        sine = decay * t * (maths.sin(angle) / angle)
        last = cosine - gamma * sine
    else:
        decay = maths.exp(-slow * t)
        cosine = 0.5 * decay * (1.0 + maths.exp(-2.0 * angle))
        sine = decay * t * (-maths.expm1(-2.0 * angle) / (2.0 * angle))
        last = maths.exp(-fast * t) - slow * sine
    return cosine + gamma * sine, sine, -sine / servo.b, last


def free_response(servo: Servo, t: ArrayLike) -> Array:
    """Return the matrices E of :func:`free_motion`, shape (..., 2, 2) for times of shape (...)."""
    entries = free_motion(servo, np.asarray(t, dtype=np.float64), np)
    return np.stack(entries, axis=-1).reshape(*np.shape(t), 2, 2)


def propagate(servo: Servo, t: ArrayLike, condition: float = WELL_CONDITIONED) -> Array:
    """Propagate the free loop with any of its controllers.

    Implements the homogeneous Eq. (7) of [1]_ (corrected, see Notes): second order for P and PD, third order
    for PI and PID, where the integral of the error is the third state.

    Parameters
    ----------
    servo : Servo
    t : array_like, shape (...,)
        Times [s].
    condition : float
        Condition number of the third-order loop's modes up to which they are used.

    Returns
    -------
    ndarray, shape (..., n, n)
        n = 2: acts on (x, ẋ); n = 3: on (x, ẋ, ∫e).

    Notes
    -----
    Eq. (7) with its lost dots: b x⃛ + (c + k_d/k_p) ẍ + ẋ + (k_i/k_p) x = (k_d/k_p) Ẍ + Ẋ + (k_i/k_p) X.
    """
    # ERRATA: Eq. (7) is printed with one derivative too few, and its coefficients diverge as k_i goes to 0.
    if servo.ki_over_kp == 0.0:
        return free_response(servo, t)
    t = np.asarray(t, dtype=np.float64)
    unit = math.sqrt(servo.b)
    values, vectors, inverse, worst = _modes(servo)
    if worst > condition:
        from scipy.linalg import expm

        scaled = expm(_companion(servo) * (t / unit)[..., np.newaxis, np.newaxis])
    else:
        values = np.minimum(values.real, 0.0) + 1j * values.imag  # rounding must not make a stable loop grow
        growth = np.exp(values * (t / unit)[..., np.newaxis])
        scaled = np.real((vectors * growth[..., np.newaxis, :]) @ inverse)
    units = np.array([1.0, 1.0 / unit, unit])
    return np.asarray(scaled * units[:, np.newaxis] / units, dtype=np.float64)


def _companion(servo: Servo) -> Array:
    """System matrix for (x, ẋ√b, ∫e/√b) in the time t/√b, where its entries are all of order one."""
    unit = math.sqrt(servo.b)
    return np.array(
        [[0.0, 1.0, 0.0], [-1.0, -effective_damping(servo) / unit, servo.ki_over_kp * unit], [-1.0, 0.0, 0.0]]
    )


Modes = tuple[NDArray[np.complex128], NDArray[np.complex128], NDArray[np.complex128], float]


@lru_cache(maxsize=256)
def _modes(servo: Servo) -> Modes:
    """Eigenvalues, eigenvectors, their inverse and condition number (infinite where they are dependent)."""
    values, vectors = np.linalg.eig(_companion(servo).astype(np.complex128))
    condition = float(np.linalg.cond(vectors))
    inverse = np.linalg.inv(vectors) if condition * EPSILON < 1.0 else vectors
    return values, vectors, inverse, condition if condition * EPSILON < 1.0 else math.inf


def ringing(servo: Servo) -> tuple[float, float]:
    """Return angular frequency (0 where it does not ring) and decay rate [1/s] of the free loop."""
    if servo.ki_over_kp == 0.0:
        gamma, lam, slow, _, oscillates = rates(servo)
        return (lam, gamma) if oscillates else (0.0, slow)
    values = np.linalg.eigvals(_companion(servo)) / math.sqrt(servo.b)
    fastest = values[int(np.argmax(np.abs(values.imag)))]
    return float(abs(fastest.imag)), float(-fastest.real)


def harmonic_response(servo: Servo, omega: float) -> tuple[complex, complex]:
    """Return x/X and (X - x)/X in the harmonic steady state at Ω = `omega` [1/s].

    The second is not formed as a difference, so that a small following error keeps all its digits. For a P
    controller -x/X is p - iq of Eq. (20) of [1]_.

    Examples
    --------
    >>> response, error = harmonic_response(Servo(b=0.0005, c=0.005), 0.5235987755982988)
    >>> f"{-response.real:.6f} {-response.imag:.6f}"
    '-1.000130 0.002619'
    """
    controller = complex(1.0, servo.kd_over_kp * omega - servo.ki_over_kp / omega)
    plant = complex(-servo.b * omega * omega, servo.c * omega)
    closed = controller + plant
    return controller / closed, plant / closed
