"""Bernstein forms in exact rational numbers, and their real roots.

Curves are built and certified with tuples of Fractions. Roots are isolated in rational arithmetic where
floating point cannot decide (multiple and nearly multiple roots, roots at the very ends) or is not sharp
enough, and to certify the roots that floating point found.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from functools import cache
from itertools import accumulate, pairwise
from typing import Any, Final

import msgspec

from ph_post.types import Array, frozen

WIDTH: Final = Fraction(1, 2**64)
"""Isolating intervals are refined to this: below the rounding of any double in [0, 1] that is not tiny."""

BITS: Final = 80
"""Newton's method runs on multiples of 2**-BITS."""

REACH: Final = 1 << (BITS - 56)
"""Half the interval in which the exact polynomial must change its sign: 2**-56 of the piece."""

NEWTON_STEPS: Final = 5
"""From the ten digits that floating point gives, quadratic convergence needs two."""

Rational = tuple[Fraction, ...]


class ExactRoot(msgspec.Struct, frozen=True, kw_only=True):
    """One real root in [low, high] and how often it counts; low = high where it is rational and was met."""

    low: Fraction
    high: Fraction
    multiplicity: int

    @property
    def middle(self) -> float:
        """Middle of the interval, rounded once."""
        return float((self.low + self.high) / 2)


def derivative(control: Sequence[Rational], axis: int, *, rational: bool) -> Rational:
    """Bernstein coefficients of an axis' velocity, up to a positive factor.

    Parameters
    ----------
    control : sequence of tuples of Fraction
        Control points; of a rational curve homogeneous, (w P, w).
    axis : int
        Number of the coordinate.
    rational : bool
        The last entry of a control point is its weight. Then the numerator X'w - Xw' of (X / w)' is
        returned, of degree 2n - 2, and w is taken to be positive.

    Examples
    --------
    >>> derivative([(Fraction(0),), (Fraction(1, 2),), (Fraction(0),)], 0, rational=False)
    (Fraction(1, 2), Fraction(-1, 2))
    """
    x = [point[axis] for point in control]
    if not rational:
        return tuple(after - before for before, after in pairwise(x))
    w = [point[-1] for point in control]
    total = [Fraction(0)] * max(2 * len(x) - 3, 1)
    for k, i, j, factor in numerator_terms(len(x) - 1):
        total[k] += factor * (x[j] * w[i] - x[i] * w[j])
    return tuple(total)


@cache
def numerator_terms(n: int) -> tuple[tuple[int, int, int, Fraction], ...]:
    """Terms (k, i, j, factor) of the numerator of a rational derivative, k = i + j - 1, i < j.

    X'w - Xw' = n Σ_k D_k B_k^(2n-2), n D_k = Σ factor (X_j w_i - X_i w_j).
    """
    choose = math.comb
    return tuple(
        (i + j - 1, i, j, Fraction((j - i) * choose(n, i) * choose(n, j), choose(2 * n - 2, i + j - 1)))
        for i in range(n)
        for j in range(i + 1, n + 1)
    )


def rounded_derivative(control: Sequence[Rational], axis: int, *, rational: bool) -> list[float]:
    """Round the coefficients of :func:`derivative`, each once."""
    if rational:
        return [value.numerator / value.denominator for value in derivative(control, axis, rational=True)]
    # Differences as quotients of integers: their common factors need not be sought.
    ratios = [point[axis].as_integer_ratio() for point in control]
    return [(p * b - a * q) / (q * b) for (a, b), (p, q) in pairwise(ratios)]


def integers(coefficients: Rational) -> list[int]:
    """Scaled Bernstein coefficients, common denominator cleared: f(u) ~ Σ a_k u^k (1 - u)^(n - k)."""
    n = len(coefficients) - 1
    common = math.lcm(*(value.denominator for value in coefficients))
    return [math.comb(n, k) * value.numerator * (common // value.denominator) for k, value in enumerate(coefficients)]


def value_at(scaled: Sequence[int], numerator: int, denominator: int) -> int:
    """Integer with the sign of f at numerator / denominator, times denominator**n."""
    other, total, power = denominator - numerator, 0, 1
    for k, coefficient in enumerate(scaled):
        total = total * other + coefficient * power if k else coefficient
        power *= numerator
    return total


def sharpen(coefficients: Rational, u: float) -> float | None:
    """Improve a simple root by Newton's method on the exact polynomial.

    Parameters
    ----------
    coefficients : tuple of Fraction
        Bernstein coefficients.
    u : float
        Root, roughly.

    Returns
    -------
    float or None
        None where the exact polynomial does not change its sign within REACH of the result: the root is not
        as simple as it looked.
    """
    scaled = integers(coefficients)
    n = len(scaled) - 1
    one, place = 1 << BITS, round(u * (1 << 60)) << (BITS - 60)
    slopes = [(k + 1) * scaled[k + 1] - (n - k) * scaled[k] for k in range(n)]
    for _ in range(NEWTON_STEPS):
        slope = value_at(slopes, place, one)
        if slope == 0:
            return None
        step = value_at(scaled, place, one) // slope
        place -= step
        if abs(step) < REACH:
            break
    left, right = value_at(scaled, place - REACH, one), value_at(scaled, place + REACH, one)
    return place / one if (left < 0) != (right < 0) else None


def isolate(coefficients: Rational) -> tuple[ExactRoot, ...]:
    """Count and isolate the roots in [0, 1] exactly.

    Parameters
    ----------
    coefficients : tuple of Fraction
        Bernstein coefficients. The zero polynomial has no roots here: the axis stands still.

    Examples
    --------
    >>> root, = isolate((Fraction(1), Fraction(-1), Fraction(1)))
    >>> root.low, root.high, root.multiplicity
    (Fraction(1, 2), Fraction(1, 2), 2)
    """
    if not any(coefficients):
        return ()
    scaled = integers(coefficients)
    at_start = next(k for k, value in enumerate(scaled) if value)
    at_end = next(k for k, value in enumerate(reversed(scaled)) if value)
    inner = scaled[at_start : len(scaled) - at_end]
    roots = [ExactRoot(low=low, high=high, multiplicity=m) for low, high, m in _inner_roots(inner)]
    if at_start:
        roots.insert(0, ExactRoot(low=Fraction(0), high=Fraction(0), multiplicity=at_start))
    if at_end:
        roots.append(ExactRoot(low=Fraction(1), high=Fraction(1), multiplicity=at_end))
    return tuple(roots)


def sign_changes(scaled: Sequence[int]) -> int:
    """Count the sign changes, zeros left out: a bound on the roots in (0, 1), exact below 2 (Descartes)."""
    signs = [value > 0 for value in scaled if value]
    return sum(a != b for a, b in pairwise(signs))


def _inner_roots(scaled: Sequence[int]) -> list[tuple[Fraction, Fraction, int]]:
    """Roots in the open interval of a polynomial that vanishes at neither end."""
    if sign_changes(scaled) == 0:
        return []
    import sympy

    u = sympy.Symbol("u")
    polynomial: Any = sympy.Poly(_power(scaled), u, domain="ZZ")
    eps = sympy.Rational(WIDTH.numerator, WIDTH.denominator)
    found = polynomial.intervals(eps=eps, inf=0, sup=1)
    return [(Fraction(int(a.p), int(a.q)), Fraction(int(b.p), int(b.q)), int(m)) for (a, b), m in found]


def _power(scaled: Sequence[int]) -> list[int]:
    """Power coefficients, highest first, of Σ a_k u^k (1 - u)^(n - k)."""
    n = len(scaled) - 1
    power = [0] * (n + 1)
    for k, value in enumerate(scaled):
        for j in range(n - k + 1):
            power[k + j] += value * math.comb(n - k, j) * (-1) ** j
    return power[::-1]


ZERO = Fraction(0)
Fractions = tuple[Fraction, ...]
FractionRows = tuple[Fractions, ...]


def rows(values: Any) -> FractionRows:
    """Turn rows of floats or Fractions into the Fractions that they are.

    Examples
    --------
    >>> rows([[0.5, 1]])
    ((Fraction(1, 2), Fraction(1, 1)),)
    """
    return tuple(tuple(x if isinstance(x, Fraction) else Fraction(float(x)) for x in row) for row in values)


def columns(table: Sequence[Fractions]) -> FractionRows:
    """Exchange rows and columns."""
    return tuple(zip(*table, strict=True))


def floats(values: FractionRows) -> Array:
    """Round to float64, each number correctly."""
    return frozen([[x.numerator / x.denominator for x in row] for row in values])


def product(a: Fractions, b: Fractions) -> Fractions:
    """Multiply two Bernstein forms.

    Examples
    --------
    >>> [str(c) for c in product((Fraction(0), Fraction(1)), (Fraction(1), Fraction(0)))]
    ['0', '1/2', '0']
    """
    m, n = len(a) - 1, len(b) - 1
    total = [Fraction(0)] * (m + n + 1)
    for i, x in enumerate(a):
        for j, y in enumerate(b):
            total[i + j] += math.comb(m, i) * math.comb(n, j) * x * y
    return tuple(x / math.comb(m + n, k) for k, x in enumerate(total))


def combine(*terms: tuple[int, Fractions]) -> Fractions:
    """Add up forms of one degree, each with its factor."""
    return tuple(
        sum((factor * x for (factor, _), x in zip(terms, column, strict=True)), Fraction(0))
        for column in zip(*(form for _, form in terms), strict=True)
    )


def integrate(c: Fractions, first: Fraction) -> Fractions:
    """Antiderivative that begins at `first`."""
    return tuple(accumulate((x / len(c) for x in c), initial=first))


def from_power(power: Fractions, domain: tuple[Fraction, Fraction]) -> Fractions:
    """Convert power coefficients, lowest first, to Bernstein form on `domain`."""
    a, b = domain
    n = len(power) - 1
    local = list(power)
    for k in range(n):  # Horner's scheme, repeated: the Taylor coefficients at a
        for j in range(n - 1, k - 1, -1):
            local[j] += a * local[j + 1]
    scaled = [x * (b - a) ** j / math.comb(n, j) for j, x in enumerate(local)]
    return tuple(sum((math.comb(k, j) * scaled[j] for j in range(k + 1)), Fraction(0)) for k in range(n + 1))
