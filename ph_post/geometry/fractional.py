"""Bernstein forms in exact numbers: tuples of Fractions, for what is built or certified exactly."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from itertools import accumulate
from typing import Any

from ph_post.types import Array, frozen

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
