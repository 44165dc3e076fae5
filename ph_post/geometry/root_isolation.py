"""Real roots of many polynomials at once, in Bernstein form on [0, 1].

The number of sign changes among the Bernstein coefficients bounds the number of roots in (0, 1), and is
exact where it is 0 or 1 (Descartes' rule in Bernstein form [1]_). Every coefficient carries a bound on its
error, so a sign is either certain or doubtful; a row on which doubt remains is handed back as undecided and
belongs to :mod:`ph_post.geometry.exact_polynomials`. Nothing is decided by a tolerance.

References
----------
.. [1] Lane, Riesenfeld, Bounds on a polynomial, BIT 21 (1981) 112-117.
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.types import Array, BoolArray, IntArray

EPS: Final = float(np.finfo(np.float64).eps)

MAX_DEPTH: Final = 48
"""Halvings before a row is undecided: an interval is then about as short as doubles can tell from a point."""

NEWTON_STEPS: Final = 20
"""Newton takes about six on a simple root; what takes longer is a cluster, whose error bound says so."""

SPLITS: Final = (0.5, 0.4375)
"""Places at which an interval is cut: the middle, or beside it where the middle may be a root (dyadic: exact)."""


class Roots(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Simple roots in (0, 1), ordered by row and place, and the rows on which nothing is decided.

    `row` and `u` have one entry a root, `error` bounds |u - root| (infinite where Newton did not settle),
    `low` and `high` enclose it. `undecided` are row numbers, ascending; no root of theirs is listed.
    """

    row: IntArray
    u: Array
    error: Array
    low: Array
    high: Array
    undecided: IntArray


class _Subintervals(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Polynomials on their intervals [low, high]: `c` and its error bounds `e`, both (n + 1, k).

    The coefficient's number comes first here: every operation then runs along contiguous memory.
    """

    row: IntArray
    low: Array
    high: Array
    c: Array
    e: Array

    def take(self, which: BoolArray | IntArray) -> _Subintervals:
        return _Subintervals(
            row=self.row[which],
            low=self.low[which],
            high=self.high[which],
            c=self.c[:, which],
            e=self.e[:, which],
        )


def find_roots(coefficients: Array, error: Array) -> Roots:
    """Find every root in (0, 1) of every row.

    Parameters
    ----------
    coefficients : Array, shape (m, n + 1)
        Bernstein coefficients, a polynomial a row.
    error : Array, shape (m, n + 1) or (m, 1)
        Bounds on their errors; zero says that a coefficient is exact. An exact zero at an end is a root at
        that end, which is not listed.

    Returns
    -------
    Roots

    Examples
    --------
    >>> found = find_roots(np.array([[1.0, -3.0, 1.0], [1.0, 2.0, 1.0]]), np.zeros((2, 1)))
    >>> found.row.tolist(), found.u.round(3).tolist()
    ([0, 0], [0.146, 0.854])
    """
    c, e = np.ascontiguousarray(coefficients.T), np.broadcast_to(error, coefficients.shape).T
    row = np.flatnonzero(~(((c - e).min(axis=0) > 0.0) | ((c + e).max(axis=0) < 0.0)))
    c, e = c[:, row], e[:, row]
    work = _Subintervals(row=np.arange(row.size), low=np.zeros(row.size), high=np.ones(row.size), c=c, e=e)
    single, undecided = _bracket(work)
    single = single.take(np.lexsort((single.low, single.row)))
    u, bound = _polish(c[:, single.row], e[:, single.row], single)
    return Roots(row=row[single.row], u=u, error=bound, low=single.low, high=single.high, undecided=row[undecided])


def _bracket(work: _Subintervals) -> tuple[_Subintervals, IntArray]:
    """Cut until every interval holds no root or one; return the latter and the undecided rows."""
    singles: list[_Subintervals] = []
    undecided: list[IntArray] = []
    for _ in range(MAX_DEPTH):
        changes, certain = sign_changes(work.c, work.e)
        singles.append(work.take(certain & (changes == 1)))
        work = work.take(~(certain & (changes <= 1)))
        if work.row.size == 0:
            break
        work, lost = _cut(work)
        undecided.append(lost)
        if lost.size:
            work = work.take(~np.isin(work.row, lost))
    undecided.append(work.row)
    rows = np.unique(np.concatenate(undecided))
    single = _join(singles)
    return (single.take(~np.isin(single.row, rows)) if rows.size else single), rows


def _join(parts: list[_Subintervals]) -> _Subintervals:
    return _Subintervals(
        row=np.concatenate([part.row for part in parts]),
        low=np.concatenate([part.low for part in parts]),
        high=np.concatenate([part.high for part in parts]),
        c=np.concatenate([part.c for part in parts], axis=1),
        e=np.concatenate([part.e for part in parts], axis=1),
    )


def sign_changes(c: Array, e: Array) -> tuple[IntArray, BoolArray]:
    """Count the sign changes along the first axis, zeros left out, and tell whether the count is certain.

    A doubtful coefficient between two of opposite sign changes nothing whatever it is; anywhere else it may.
    """
    doubtful = (np.abs(c) <= e) & (e > 0.0)
    sign = np.where(doubtful, np.int8(0), np.sign(c).astype(np.int8))
    before, after = np.zeros_like(sign), np.zeros_like(sign)
    changes = np.zeros(sign.shape[1], dtype=np.int64)
    for j in range(1, sign.shape[0]):
        before[j] = np.where(sign[j - 1] != 0, sign[j - 1], before[j - 1])
        after[-1 - j] = np.where(sign[-j] != 0, sign[-j], after[-j])
        changes += sign[j] * before[j] < 0
    certain: BoolArray = ~np.any(doubtful & (before * after >= 0), axis=0)
    return changes, certain


def _cut(work: _Subintervals) -> tuple[_Subintervals, IntArray]:
    """Halve every interval; return the halves and the rows where no cut has a certain sign.

    The ends must be certain too: cutting again would not make them so.
    """
    known = np.all((np.abs(work.c[[0, -1]]) > work.e[[0, -1]]) | (work.e[[0, -1]] == 0.0), axis=0)
    lost = [work.row[~known]]
    work = work.take(known)
    halves: list[_Subintervals] = []
    for at in SPLITS:
        left, right = _split(work, at)
        good = np.abs(right.c[0]) > right.e[0]
        halves += [left.take(good), right.take(good)]
        work = work.take(~good)
    lost.append(work.row)
    return _join(halves), np.unique(np.concatenate(lost))


def _split(work: _Subintervals, at: float) -> tuple[_Subintervals, _Subintervals]:
    """Cut at the fraction `at` by de Casteljau's rule, with the errors this adds."""
    left, right, rest = np.empty_like(work.c), np.empty_like(work.c), work.c
    n = rest.shape[0] - 1
    for j in range(n):
        left[j], right[n - j] = rest[0], rest[-1]
        rest = (1.0 - at) * rest[:-1] + at * rest[1:]
    left[n] = right[0] = rest[0]
    # A step rounds two products and a sum of numbers no larger than max |c|: 1.5 eps of it, n steps.
    grown = work.e.max(axis=0) + 1.5 * n * EPS * np.abs(work.c).max(axis=0)
    left_e, right_e = np.tile(grown, (n + 1, 1)), np.tile(grown, (n + 1, 1))
    left_e[0], right_e[n] = work.e[0], work.e[n]
    middle = work.low + at * (work.high - work.low)
    return (
        _Subintervals(row=work.row, low=work.low, high=middle, c=left, e=left_e),
        _Subintervals(row=work.row, low=middle, high=work.high, c=right, e=right_e),
    )


def _polish(c: Array, e: Array, single: _Subintervals) -> tuple[Array, Array]:
    """Newton's method inside the bracket, on the coefficients over [0, 1]; return u and its error bound."""
    if single.row.size == 0:
        return np.empty(0), np.empty(0)
    low, high = single.low.copy(), single.high.copy()
    rising = -_first_sign(single.c)
    u = low + _polygon_root(single.c) * (high - low)
    step = high - low
    on = np.arange(u.size)
    for _ in range(NEWTON_STEPS):
        part = c if on.size == u.size else c[:, on]
        new, low[on], high[on] = _newton(part, rising[on], u[on], low[on], high[on])
        step[on], u[on] = np.abs(new - u[on]), new
        on = on[step[on] > EPS]
        if on.size == 0:
            break
    bound = _error_bound(c, e, u)
    return u, np.where(step <= np.maximum(bound, 4.0 * EPS), bound, np.inf)


def _newton(c: Array, rising: Array, u: Array, low: Array, high: Array) -> tuple[Array, Array, Array]:
    """One step of Newton's method, or of bisection where it leaves the bracket; return u and the bracket."""
    value, slope = _value_and_slope(c, u)
    above, below = value * rising > 0.0, value * rising < 0.0
    high, low = np.where(above, u, high), np.where(below, u, low)
    new = u - value / np.where(slope == 0.0, np.inf, slope)
    inside = (new >= low) & (new <= high) & (slope != 0.0)
    new = np.where(inside, new, 0.5 * (low + high))
    return np.where(above | below, new, u), low, high


def _error_bound(c: Array, e: Array, u: Array) -> Array:
    """Bound on the error of a simple root: that of the polynomial there, over its slope."""
    _, slope = _value_and_slope(c, u)
    doubt, _ = _value_and_slope(np.abs(c) * (1.5 * (c.shape[0] - 1) * EPS) + e, u)
    bound = np.full(u.size, np.inf)
    np.divide(doubt, np.abs(slope), out=bound, where=slope != 0.0)
    return bound + 0.5 * EPS


def _first_sign(c: Array) -> Array:
    """Sign of each polynomial just right of 0: that of its first coefficient that is not zero."""
    first = np.argmax(c != 0.0, axis=0)
    sign: Array = np.sign(c[first, np.arange(c.shape[1])])
    return sign


def _polygon_root(c: Array) -> Array:
    """Return the zero of the control polygon of each row with one sign change: Newton's starting value."""
    rows, n = np.arange(c.shape[1]), c.shape[0] - 1
    after = np.argmax(c * _first_sign(c) < 0.0, axis=0)
    before = np.maximum(after - 1, 0)
    fall = c[before, rows] - c[after, rows]
    part = np.clip(c[before, rows] / np.where(fall == 0.0, 1.0, fall), 0.0, 1.0)
    return np.asarray((before + part) / n, dtype=np.float64)


def _value_and_slope(c: Array, u: Array) -> tuple[Array, Array]:
    """Value and derivative of each polynomial at its own u, by de Casteljau's rule."""
    n = c.shape[0] - 1
    rest, other = c, 1.0 - u
    for _ in range(n - 1):
        rest = other * rest[:-1] + u * rest[1:]
    return other * rest[0] + u * rest[1], n * (rest[1] - rest[0])
