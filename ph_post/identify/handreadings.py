"""What readings by hand have in common: their resolution, linear least squares, and how sure a result is.

An error here is half of the interval that holds the truth in 68 of 100 cases: the standard error, times what
Student's distribution asks for where few readings tell how much they scatter, and with the rounding of the dial.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import msgspec
import numpy as np
from scipy import stats

from ph_post.types import Array
from ph_post.units import INCH, MM

_ONE_SIGMA: Final = 0.841344746
"""Share of a normal distribution below one standard deviation."""

_GRAINS: Final = tuple(
    step * unit
    for unit in (MM, INCH)
    for power in range(-1, -6, -1)
    for step in (5.0 * 10.0**power, 2.0 * 10.0**power, 10.0**power)
)
"""Steps in which dials and calipers are read [m]."""

_COARSEST: Final = 0.051 * MM
"""Coarsest step of calipers [m]."""

COARSEST_DIAL: Final = 0.026 * MM
"""Coarsest step of a dial, a thousandth of an inch [m]."""

_LEAST: Final = 1e-12
"""Error of what is known without one, so that it has a weight."""

_RANK: Final = 1e-9


class Sure(msgspec.Struct, frozen=True, kw_only=True):
    """A number and its error, the half of its 68 % interval, both in SI units."""

    value: float
    error: float

    def differs(self, other: Sure, times: float, beside: float = 0.0) -> bool:
        """Return whether two are further apart than `times` their common error, and `beside`."""
        return abs(self.value - other.value) > times * math.hypot(self.error, other.error) + beside


def resolution(readings: Sequence[float], most: float = _COARSEST) -> float:
    """Return the largest usual step up to `most` of which all readings are multiples [m], 0 where there is none.

    Examples
    --------
    >>> round(resolution([0.01e-3, 0.03e-3, 0.51e-3]) / 1e-6)
    10
    """
    values = np.array(readings)
    for grain in sorted(_GRAINS, reverse=True):
        if grain <= most and np.all(np.abs(values - grain * np.round(values / grain)) < 1e-3 * grain):
            return grain
    return 0.0


def rounding_error(grain: float, scatter: float) -> float:
    """Return the standard error that rounding leaves in a mean of many readings which scatter [m].

    Readings that scatter by more than half a step average their rounding out: the bias is a sine of the true
    value over the step whose amplitude falls as exp(-2 π² (scatter/step)²); without scatter it is step/√12.

    Examples
    --------
    >>> round(rounding_error(12.0, 0.0), 3)
    3.464
    """
    if grain == 0.0:
        return 0.0
    return grain / math.sqrt(12.0) * math.exp(-2.0 * (math.pi * scatter / grain) ** 2)


def widened(freedom: int) -> float:
    """Return by how much a standard error from `freedom` degrees of freedom has to be widened to hold 68 %.

    Examples
    --------
    >>> round(widened(1), 2), round(widened(10), 2)
    (1.84, 1.05)
    """
    return float(stats.t.ppf(_ONE_SIGMA, freedom))


def weighted_mean(numbers: Sequence[Sure]) -> Sure:
    """Return the mean of numbers that say the same, weighted by their errors.

    Examples
    --------
    >>> weighted_mean([Sure(value=1.0, error=1.0), Sure(value=2.0, error=1.0)]).value
    1.5
    """
    weights = np.array([max(one.error, _LEAST) ** -2 for one in numbers])
    mean = float(np.sum(weights * [one.value for one in numbers]) / np.sum(weights))
    return Sure(value=mean, error=1.0 / math.sqrt(float(np.sum(weights))))


class LinearFit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A linear least squares fit: values of the named parameters, as far as the rows show them.

    `scatter` is the standard error of a row, from `freedom` rows more than needed; `left` are the residuals (n,).
    `inflation` is the number by which variances are multiplied, for residuals that are not independent.
    """

    names: tuple[str, ...]
    values: Array
    inverse: Array
    shown: Array
    scatter: float
    freedom: int
    left: Array
    inflation: float = 1.0

    def get(self, combination: Mapping[str, float]) -> Sure | None:
        """Return a combination of parameters, None where the rows do not show it."""
        weights = np.array([combination.get(name, 0.0) for name in self.names])
        if np.linalg.norm(weights - self.shown @ weights) > 1e-6 * np.linalg.norm(weights):
            return None
        variance = float(weights @ self.inverse @ weights) * self.scatter**2 * self.inflation
        return Sure(value=float(weights @ self.values), error=widened(self.freedom) * math.sqrt(variance))


def fit_rows(names: Sequence[str], rows: Array, right: Array, grain: float = 0.0) -> LinearFit:
    """Fit parameters to rows (n, m) and right sides (n,), of the smallest norm where they are not all shown.

    Parameters
    ----------
    names : sequence of str
        Of the parameters (m).
    rows, right : ndarray
    grain : float, optional
        Resolution of the right sides, below which they are not known.
    """
    scale = np.sqrt(np.sum(rows**2, axis=0))
    scale[scale == 0.0] = 1.0
    _, sizes, directions = np.linalg.svd(rows / scale, full_matrices=False)
    kept = directions[sizes > _RANK * sizes[0]]
    basis, _ = np.linalg.qr((kept * scale).T)
    inverse = np.linalg.pinv(rows / scale, rcond=_RANK)
    values = inverse @ right / scale
    left = right - rows @ values
    freedom = rows.shape[0] - kept.shape[0]
    scatter = math.sqrt(float(left @ left) / freedom) if freedom > 0 else math.inf
    return LinearFit(
        names=tuple(names),
        values=values,
        inverse=inverse @ inverse.T / np.outer(scale, scale),
        shown=basis @ basis.T,
        scatter=max(scatter, grain / math.sqrt(12.0)),
        freedom=freedom,
        left=left,
    )
