"""The modulated feedrate of section 5: polynomials in Bernstein form on the interval [-t_star, t_star].

A shape is V / V_c, the feed relative to the one around the profile: one polynomial as in Eq. (26), or several
pieces one after the other. This module makes shapes, and derives what a profile commands from them.

References
----------
.. [1] Real-time compensation of backlash positional errors in CNC machines by localized feedrate
   modulation, Int. J. Adv. Manuf. Technol. 119 (2022), doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ph_post.compensate import shapes
from ph_post.errors import InputError
from ph_post.types import Array, FeedProfile, ProfilePiece, ProfileShape, frozen

LEAST_DEGREE = 4
"""V_0 = V_1 = V_{n-1} = V_n = V_c leave a free coefficient from this degree on."""

MOST_DEGREE = 100
"""Binomial coefficients of higher degrees are beyond what doubles resolve."""


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
        Unless `degree` is even, at least 4 and at most 100.
    """
    if not isinstance(degree, int) or not LEAST_DEGREE <= degree <= MOST_DEGREE or degree % 2:
        raise InputError(
            "--degree",
            "not a degree of Eq. (26)",
            expected=f"even, 4 or more and at most {MOST_DEGREE}",
            got=str(degree),
        )


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
            "--coefficients",
            "feed or acceleration would jump at the ends of the profile",
            expected="the first two and the last two equal to 1",
            got=", ".join(f"{end:g}" for end in ends),
        )
    return coefficients


def dip(ratio: float, degree: int) -> ProfileShape:
    """Eq. (26) of [1]_ with a given V(½) / V_c, all coefficients but the middle one being V_c.

    Examples
    --------
    >>> dip(0.25, 4).pieces[0].coefficients.tolist()
    [1.0, 1.0, -1.0, 1.0, 1.0]
    """
    return shapes.single(coefficients_from_ratio(ratio, degree))


def plateau(ramp_down: float, hold: float, ramp_up: float, floor: float, order: int) -> ProfileShape:
    """Deceleration, constant feed and acceleration: the composite that section 7 of [1]_ proposes.

    At the four junctions all derivatives of V up to the `order` vanish. For 0 the ramps are straight.

    Parameters
    ----------
    ramp_down, hold, ramp_up : float
        Durations in any unit; only their ratios matter. Without a `hold` the ramps meet.
    floor : float
        V / V_c between the ramps.
    order : int
        k; a ramp is of degree 2 k + 1.

    Returns
    -------
    ProfileShape

    Examples
    --------
    >>> [piece.share for piece in plateau(1.0, 2.0, 1.0, floor=0.5, order=3).pieces]
    [0.25, 0.5, 0.25]
    """
    down = [1.0] * (order + 1) + [floor] * (order + 1)
    parts = [(ramp_down, down), (hold, [floor]), (ramp_up, down[::-1])]
    total = math.fsum((ramp_down, hold, ramp_up))
    return ProfileShape(
        pieces=tuple(
            ProfilePiece(share=part / total, coefficients=frozen(values)) for part, values in parts if part > 0.0
        )
    )


def stop(ramp: float, hold: float, order: int) -> ProfileShape:
    """Deceleration to a standstill, `hold` as long in the unit of `ramp`, and acceleration; see `plateau`."""
    return plateau(ramp, hold, ramp, 0.0, order)


def ramp_duration(change: float, acceleration: float, jerk: float, order: int) -> float:
    """Shortest duration [s] of a ramp of `plateau` that keeps an acceleration and a jerk.

    Its speed has the derivative (2k + 1) C(2k, k) (τ (1 - τ))^k, largest in the middle, whose own derivative
    is largest where (1 - 2τ)² = 1 / (2k - 1).

    Parameters
    ----------
    change : float
        By how much the speed changes [m/s].
    acceleration, jerk : float
        [m/s²], [m/s³].
    order : int
        k, at least 1: the acceleration of straight ramps jumps.

    Returns
    -------
    float
        [s].

    Examples
    --------
    >>> ramp_duration(1.0, 1.5, math.inf, order=1), ramp_duration(1.0, math.inf, 6.0, order=1)
    (1.0, 1.0)
    """
    k, peak = order, (2 * order + 1) * math.comb(2 * order, order)
    u = math.sqrt(1.0 / (2 * k - 1))
    steepest, bent = peak / 4.0**k, peak * k / 4.0 ** (k - 1) * u * (1.0 - u * u) ** (k - 1)
    return max(change * steepest / acceleration, math.sqrt(change * bent / jerk))


def traversal_factor(factor: float, degree: int) -> float:
    """Ratio of the profile's time to that of constant feed: (n + 1) / (n + f), section 5.1 of [1]_."""
    return (degree + 1) / (degree + factor)


def normalised_time(t: Array, t_star: float) -> Array:
    """τ of Eq. (24) of [1]_."""
    tau: Array = (np.asarray(t, dtype=np.float64) + t_star) / (2.0 * t_star)
    return tau


def feed(profile: FeedProfile, t: Array) -> Array:
    """V(t) [m/s], t [s] counted from the middle of the profile; V_c outside the profile.

    Implements Eq. (26) of [1]_.
    """
    tau = normalised_time(t, profile.t_star)
    inside = (tau >= 0.0) & (tau <= 1.0)
    values: Array = profile.cruise * np.where(inside, shapes.value(profile.shape, tau), 1.0)
    return values


def acceleration(profile: FeedProfile, t: Array) -> Array:
    """dV/dt [m/s²] by Eq. (25) of [1]_; 0 outside the profile."""
    tau = normalised_time(t, profile.t_star)
    inside = (tau >= 0.0) & (tau <= 1.0)
    rate = shapes.slope(profile.shape, tau) / (2.0 * profile.t_star)
    values: Array = profile.cruise * np.where(inside, rate, 0.0)
    return values


def travelled(profile: FeedProfile, t: Array) -> Array:
    """Path length from the turning point [m], ρ_0 Θ(t) of Eq. (29) of [1]_; outside the profile at V_c.

    Time is that of `feed`. Of coefficients that are not symmetric s_star is the way on either side, so that
    the turning point lies in the middle of the way, not of the time; a `turn` of its own puts it elsewhere.
    """
    t = np.asarray(t, dtype=np.float64)
    S = shapes.way(profile.shape, normalised_time(t, profile.t_star))
    # ERRATA: section 5.3 lets V_c (t - t_star) hold from the end of the backlash; it holds from t_star on.
    beyond = t - np.clip(t, -profile.t_star, profile.t_star)
    before = 2.0 * profile.turn * profile.s_star
    distance: Array = -before + profile.cruise * (2.0 * profile.t_star * S + beyond)
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
    return profile.t_star + (radius * angle - 2.0 * profile.turn * profile.s_star) / profile.cruise
