"""The modulated feedrate of section 5: polynomials in Bernstein form on the interval [-t_star, t_star].

Coefficients are relative to the feed around the profile, V_k / V_c, unless a function says otherwise.

References
----------
.. [1] Real-time compensation of backlash positional errors in CNC machines by localized feedrate
   modulation, Int. J. Adv. Manuf. Technol. 119 (2022), doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ph_post.errors import InputError
from ph_post.geometry.bernstein import evaluate, integrate, subdivide
from ph_post.types import Array, FeedProfile

LEAST_DEGREE = 4
"""V_0 = V_1 = V_{n-1} = V_n = V_c leave a free coefficient from this degree on."""

_HALVINGS = 64
"""More than enough: the distance between control polygon and graph falls fourfold each time."""


def middle_weight(degree: int) -> float:
    """Weight C(n, n/2) / 2^n of the middle coefficient in V(½).

    Examples
    --------
    >>> middle_weight(4) * 8, middle_weight(10) * 256
    (3.0, 63.0)
    """
    check_degree(degree)
    return float(math.comb(degree, degree // 2) / 2.0**degree)


def check_degree(degree: int) -> None:
    """Refuse degrees that Eq. (26) cannot have.

    Raises
    ------
    InputError
        Unless `degree` is even and at least 4.
    """
    if degree < LEAST_DEGREE or degree % 2:
        raise InputError("--degree", "not a degree of Eq. (26)", expected="even, 4 or more", got=str(degree))


def middle_factor(ratio: float, degree: int) -> float:
    """Factor f = V_{n/2} / V_c for a given V(½) / V_c, all other coefficients being V_c; section 6 of [1]_.

    Examples
    --------
    >>> middle_factor(0.25, 10) == (256 * 0.25 - 193) / 63
    True
    """
    return 1.0 + (ratio - 1.0) / middle_weight(degree)


def coefficients_from_ratio(ratio: float, degree: int) -> Array:
    """V_k / V_c of the profile whose middle coefficient alone differs from 1.

    Implements Eq. (26) of [1]_ as section 6 uses it.

    Parameters
    ----------
    ratio : float
        V(½) / V_c.
    degree : int
        n, even and at least 4.

    Returns
    -------
    Array, shape (n + 1,)

    Examples
    --------
    >>> coefficients_from_ratio(0.25, 4).tolist()
    [1.0, 1.0, -1.0, 1.0, 1.0]
    """
    factor = middle_factor(ratio, degree)
    coefficients = np.ones(degree + 1)
    coefficients[degree // 2] = factor
    return coefficients


def explicit_coefficients(values: Sequence[float]) -> Array:
    """Check V_k / V_c given one by one.

    Raises
    ------
    InputError
        Unless the degree is even and at least 4 and V_0 = V_1 = V_{n-1} = V_n = V_c, without which feed and
        acceleration would jump where the profile meets the constant feed.
    """
    coefficients = np.array(values, dtype=np.float64)
    check_degree(coefficients.size - 1)
    if not np.all(np.isfinite(coefficients)):
        raise InputError("--coefficients", "not a number", expected="finite numbers", got=str(list(values)))
    ends = coefficients[[0, 1, -2, -1]]
    if np.any(ends != 1.0):
        raise InputError(
            "--coefficients", "feed or acceleration would jump at the ends of the profile",
            expected="the first two and the last two equal to 1", got=", ".join(f"{end:g}" for end in ends),
        )  # fmt: skip
    return coefficients


def soften(coefficients: Array, amount: float) -> Array:
    """Move a profile towards constant feed: 0 leaves it, 1 gives V = V_c."""
    if amount == 0.0:
        return coefficients
    softened: Array = 1.0 - (1.0 - amount) * (1.0 - coefficients)
    return softened


def mean(coefficients: Array) -> float:
    """Mean of V / V_c over the profile, the sum of the coefficients over n + 1."""
    return math.fsum(coefficients) / coefficients.size


def middle_ratio(coefficients: Array) -> float:
    """V(½) / V_c."""
    return float(evaluate(coefficients, 0.5))


def half_length(coefficients: Array, cruise: float, t_star: float) -> float:
    """s_star [m], half the length of path that a profile takes.

    Implements Eq. (27) of [1]_.

    Examples
    --------
    >>> half_length(np.array([1.0, 1.0, -1.5, 1.0, 1.0]), cruise=0.1, t_star=2.0)
    0.1
    """
    return mean(coefficients) * cruise * t_star


def half_duration(coefficients: Array, cruise: float, s_star: float) -> float:
    """t_star [s] for a given s_star [m]: Eq. (27) of [1]_ the other way round."""
    return s_star / (mean(coefficients) * cruise)


def traversal_factor(factor: float, degree: int) -> float:
    """How many times as long as constant feed the profile takes: (n + 1) / (n + f), section 5.1 of [1]_."""
    return (degree + 1) / (degree + factor)


def normalised_time(t: Array, t_star: float) -> Array:
    """τ of Eq. (24) of [1]_."""
    tau: Array = (np.asarray(t, dtype=np.float64) + t_star) / (2.0 * t_star)
    return tau


def feed(profile: FeedProfile, t: Array) -> Array:
    """V(t) [m/s], t [s] counted from the turning point; V_c outside the profile.

    Implements Eq. (26) of [1]_.
    """
    tau = normalised_time(t, profile.t_star)
    inside = (tau >= 0.0) & (tau <= 1.0)
    values: Array = profile.cruise * np.where(
        inside, evaluate(profile.coefficients, np.clip(tau, 0.0, 1.0)), 1.0
    )
    return values


def acceleration(profile: FeedProfile, t: Array) -> Array:
    """dV/dt [m/s²] by Eq. (25) of [1]_; 0 outside the profile."""
    n = profile.coefficients.size - 1
    tau = normalised_time(t, profile.t_star)
    inside = (tau >= 0.0) & (tau <= 1.0)
    slope = evaluate(n * np.diff(profile.coefficients), np.clip(tau, 0.0, 1.0)) / (2.0 * profile.t_star)
    values: Array = profile.cruise * np.where(inside, slope, 0.0)
    return values


def distance_coefficients(coefficients: Array) -> Array:
    """S_0 … S_{n+1} of S(τ) = ∫ V dτ, which vanishes at τ = 0.

    Implements Eq. (28) of [1]_.
    """
    # ERRATA: Eq. (28) prints (1 - τ)^(n-k); a basis of degree n + 1 has the exponent n + 1 - k.
    return integrate(coefficients)


def travelled(profile: FeedProfile, t: Array) -> Array:
    """Path length from the turning point [m] at time t [s]: ρ_0 Θ(t) of Eq. (29) of [1]_, at V_c outside."""
    t = np.asarray(t, dtype=np.float64)
    S = evaluate(
        distance_coefficients(profile.coefficients), np.clip(normalised_time(t, profile.t_star), 0.0, 1.0)
    )
    # ERRATA: section 5.3 lets V_c (t - t_star) hold from the end of the backlash; it holds from t_star on.
    beyond = t - np.clip(t, -profile.t_star, profile.t_star)
    distance: Array = -profile.s_star + profile.cruise * (2.0 * profile.t_star * S + beyond)
    return distance


def commanded_angle(profile: FeedProfile, radius: float, t: Array) -> Array:
    """Θ(t) [rad] on the osculating circle of `radius` [m], 0 at the turning point.

    Implements Eq. (29) of [1]_, and the lead-in and lead-out of section 5.2 at constant feed.
    """
    angle: Array = travelled(profile, t) / radius
    return angle


def commanded_position(profile: FeedProfile, radius: float, t: Array) -> tuple[Array, Array]:
    """X(t), Y(t) [m] on the osculating circle, the turning point being the origin.

    Implements Eq. (30) of [1]_.
    """
    angle = commanded_angle(profile, radius, t)
    # 1 - cos in the form that keeps its digits near the turning point.
    return -2.0 * radius * np.sin(0.5 * angle) ** 2, radius * np.sin(angle)


def lead_duration(profile: FeedProfile, radius: float, angle: float) -> float:
    """T_star [s] for a lead-in from -Θ_star = -`angle` [rad]; section 5.2 of [1]_."""
    return profile.t_star + (radius * angle - profile.s_star) / profile.cruise


def lowest(coefficients: Array) -> float:
    """Smallest value of a polynomial in Bernstein form on [0, 1], to rounding.

    The control polygon bounds the graph; pieces that cannot hold the minimum are dropped, the others halved.

    Examples
    --------
    >>> lowest(np.array([1.0, -1.0, 1.0]))
    0.0
    """
    pieces = np.atleast_2d(np.asarray(coefficients, dtype=np.float64))
    slack = rounding(coefficients)
    best = float(pieces[:, [0, -1]].min())
    for _ in range(_HALVINGS):
        pieces = pieces[pieces.min(axis=-1) < best - slack]
        if not pieces.size:
            break
        pieces = np.concatenate(subdivide(pieces))
        best = min(best, float(pieces[:, [0, -1]].min()))
    return best


def extremes(coefficients: Array) -> tuple[float, float]:
    """Smallest and largest value of a polynomial in Bernstein form on [0, 1], to rounding.

    Examples
    --------
    >>> extremes(np.array([1.0, 1.0, -1.0, 1.0, 1.0]))
    (0.25, 1.0)
    """
    return lowest(coefficients), -lowest(-np.asarray(coefficients))


def is_non_negative(coefficients: Array) -> bool:
    """Whether V >= 0 on the whole profile, but for rounding in the last digits.

    A look at the coefficients alone would be too strict: V_{n/2} may be far below 0 while V is not.
    """
    return lowest(coefficients) >= -rounding(coefficients)


def rounding(coefficients: Array) -> float:
    """How far rounding may move a value: n + 1 products of no more than the largest coefficient."""
    return float(np.finfo(np.float64).eps * coefficients.size * np.abs(coefficients).max())
