"""Polynomials in Bernstein form, as plain array functions.

Coefficients stand on the last axis, ``(..., n + 1)``, for a scalar polynomial of degree n on [0, 1]; leading
axes are a batch. Control points ``(n + 1, dim)`` are passed transposed. See Farouki, The Bernstein polynomial
basis: a centennial retrospective, CAGD 29 (2012) 379-419.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from ph_post.types import Array, frozen

UNIT = (0.0, 1.0)
"""The interval on which Bernstein polynomials live unless another domain is given."""


@lru_cache(maxsize=128)
def binomials(n: int) -> Array:
    """Return the row C(n, 0) … C(n, n) of Pascal's triangle."""
    return frozen([math.comb(n, k) for k in range(n + 1)])


def basis(n: int, u: ArrayLike) -> Array:
    """Evaluate the Bernstein polynomials of degree `n` at `u`; Eq. (25) of [1]_ for a profile.

    Returns
    -------
    Array, shape (*u.shape, n + 1)

    Examples
    --------
    >>> basis(2, 0.5).tolist()
    [0.25, 0.5, 0.25]
    """
    u = np.asarray(u, dtype=np.float64)
    k = np.arange(n + 1)
    # 0.0 ** 0 is 1, so that the ends come out exactly.
    values: Array = binomials(n) * u[..., None] ** k * (1.0 - u[..., None]) ** k[::-1]
    return values


def evaluate(coefficients: ArrayLike, u: ArrayLike) -> Array:
    """Evaluate at `u`, which broadcasts against the leading axes of `coefficients`.

    Examples
    --------
    >>> evaluate([0.0, 0.0, 1.0], [0.0, 0.5, 1.0]).tolist()
    [0.0, 0.25, 1.0]
    """
    c = np.asarray(coefficients, dtype=np.float64)
    values: Array = np.sum(basis(c.shape[-1] - 1, u) * c, axis=-1)
    return values


def derivative(coefficients: ArrayLike, order: int = 1) -> Array:
    """Return the coefficients of a derivative with respect to u; a constant's is [0].

    Examples
    --------
    >>> derivative([0.0, 0.0, 1.0]).tolist()
    [0.0, 2.0]
    """
    c = np.asarray(coefficients, dtype=np.float64)
    for _ in range(order):
        n = c.shape[-1] - 1
        c = n * np.diff(c, axis=-1) if n > 0 else np.zeros_like(c)
    return c


def product(a: ArrayLike, b: ArrayLike) -> Array:
    """Multiply two polynomials; the degrees add.

    Examples
    --------
    >>> product([0.0, 1.0], [1.0, 0.0]).tolist()
    [0.0, 0.5, 0.0]
    """
    a, b = np.asarray(a, dtype=np.float64), np.asarray(b, dtype=np.float64)
    m, n = a.shape[-1] - 1, b.shape[-1] - 1
    scaled_a, scaled_b = a * binomials(m), b * binomials(n)
    shape = np.broadcast_shapes(a.shape[:-1], b.shape[:-1])
    c = np.zeros((*shape, m + n + 1))
    for i in range(m + 1):
        c[..., i : i + n + 1] += scaled_a[..., i, None] * scaled_b
    c /= binomials(m + n)
    return c


def integrate(coefficients: ArrayLike) -> Array:
    """Return the coefficients of the antiderivative that vanishes at u = 0.

    Implements Eq. (28) of [1]_ with the exponent n + 1 - k.

    Examples
    --------
    >>> integrate([0.0, 2.0]).tolist()
    [0.0, 0.0, 1.0]
    """
    c = np.asarray(coefficients, dtype=np.float64)
    n = c.shape[-1] - 1
    sums = np.zeros((*c.shape[:-1], n + 2))
    np.cumsum(c, axis=-1, out=sums[..., 1:])
    sums /= n + 1
    return sums


def subdivide(coefficients: ArrayLike, at: ArrayLike = 0.5) -> tuple[Array, Array]:
    """Split at u = `at` by de Casteljau's rule; each half lives on [0, 1] again.

    `at` broadcasts against the leading axes.

    Examples
    --------
    >>> left, right = subdivide([0.0, 0.0, 1.0])
    >>> left.tolist(), right.tolist()
    ([0.0, 0.0, 0.25], [0.25, 0.5, 1.0])
    """
    c = np.asarray(coefficients, dtype=np.float64)
    t = np.asarray(at, dtype=np.float64)[..., None]
    c = np.broadcast_to(c, np.broadcast_shapes(c.shape, (*t.shape[:-1], 1))).copy()
    n = c.shape[-1] - 1
    left, right = np.empty_like(c), np.empty_like(c)
    for k in range(n + 1):
        left[..., k], right[..., n - k] = c[..., 0], c[..., -1]
        c = (1.0 - t) * c[..., :-1] + t * c[..., 1:]
    return left, right


def restrict(coefficients: ArrayLike, u0: ArrayLike, u1: ArrayLike) -> Array:
    """Return the coefficients of the parts from `u0` to `u1`, which run backwards where `u1` < `u0`.

    `u0` and `u1` are numbers, or broadcast against the leading axes of `coefficients`.

    Examples
    --------
    >>> restrict([[0.0, 0.0, 1.0]], 1.0, 0.5).tolist()
    [[1.0, 0.5, 0.25]]
    """
    u0, u1 = np.asarray(u0, dtype=np.float64), np.asarray(u1, dtype=np.float64)
    low, high = np.minimum(u0, u1), np.maximum(u0, u1)
    # `high` as seen from [low, 1]; nothing is left to see where low = 1, but then high is 1 too
    at = np.divide(high - low, 1.0 - low, out=np.ones_like(high), where=low < 1.0)
    part = subdivide(subdivide(coefficients, low)[1], at)[0]
    return np.where((u1 < u0)[..., None], part[..., ::-1], part)


def elevate(coefficients: ArrayLike, times: int = 1) -> Array:
    """Raise the degree without changing the polynomial.

    Examples
    --------
    >>> elevate([0.0, 1.0]).tolist()
    [0.0, 0.5, 1.0]
    """
    return product(coefficients, np.ones(times + 1))


def from_power(coefficients: ArrayLike, domain: tuple[float, float] = UNIT) -> Array:
    """Convert power coefficients in x (lowest first) to Bernstein form on x in `domain`.

    Examples
    --------
    >>> from_power([0.0, 0.0, 1.0], (1.0, 3.0)).tolist()
    [1.0, 3.0, 9.0]
    """
    p = np.asarray(coefficients, dtype=np.float64)
    n = p.shape[-1] - 1
    a, b = domain
    # x = a (1 - u) + b u has the Bernstein coefficients [a, b]; Horner's scheme in Bernstein form.
    c = p[..., n, None]
    for k in range(n - 1, -1, -1):
        c = product(c, np.array([a, b])) + p[..., k, None]
    return c


def to_power(coefficients: ArrayLike, domain: tuple[float, float] = UNIT) -> Array:
    """Convert Bernstein coefficients on x in `domain` to power coefficients in x, lowest first.

    Examples
    --------
    >>> to_power([1.0, 3.0, 9.0], (1.0, 3.0)).tolist()
    [0.0, 0.0, 1.0]
    """
    c = np.asarray(coefficients, dtype=np.float64)
    n = c.shape[-1] - 1
    a, b = domain
    scaled = [np.diff(c, n=k, axis=-1)[..., 0] * math.comb(n, k) / (b - a) ** k for k in range(n + 1)]
    power = np.zeros_like(c)
    for term in reversed(scaled):  # Horner's scheme in x - a
        power[..., 1:] = power[..., :-1] - a * power[..., 1:]
        power[..., 0] = term - a * power[..., 0]
    return power


_HALVINGS = 64
"""More than enough: the distance between control polygon and graph falls fourfold each time."""


def lowest_value(coefficients: Array) -> float:
    """Smallest value on [0, 1], to rounding.

    The control polygon bounds the graph; pieces that cannot hold the minimum are dropped, the others halved.

    Examples
    --------
    >>> lowest_value(np.array([1.0, -1.0, 1.0]))
    0.0
    """
    pieces = np.atleast_2d(np.asarray(coefficients, dtype=np.float64))
    slack = value_rounding(coefficients)
    best = float(pieces[:, [0, -1]].min())
    for _ in range(_HALVINGS):
        pieces = pieces[pieces.min(axis=-1) < best - slack]
        if not pieces.size:
            break
        pieces = np.concatenate(subdivide(pieces))
        best = min(best, float(pieces[:, [0, -1]].min()))
    return best


def value_rounding(coefficients: Array) -> float:
    """Return a bound of the rounding error of a value, in its unit: n + 1 products with the largest coefficient."""
    return float(np.finfo(np.float64).eps * coefficients.size * np.abs(coefficients).max())
