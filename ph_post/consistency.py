"""Check that several ways of giving one quantity are consistent."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from ph_post.errors import InputError

AGREE = 1e-3
"""Relative difference up to which two ways of giving one thing agree: people round to three digits."""


def consistent_value(given: Iterable[tuple[str, float | None]], where: Callable[[str], str]) -> float | None:
    """Return the first value given; whatever else gives the same thing must agree with it.

    Parameters
    ----------
    given : iterable of (str, float or None)
        Keys and their values, all in one unit; None where a key is not given.
    where : callable
        Where a key stands, for the refusal.

    Raises
    ------
    InputError
        Where two of them contradict each other.

    Examples
    --------
    >>> consistent_value([("lead", None), ("travel", 1.0), ("r", 1.0001)], where=str)
    1.0
    """
    known = [(key, value) for key, value in given if value is not None]
    for key, value in known[1:]:
        if not math.isclose(value, known[0][1], rel_tol=AGREE):
            ratio = value / known[0][1] if known[0][1] else math.inf
            raise InputError(
                where(key),
                f"contradicts {known[0][0]}",
                expected="the same size",
                got=f"{ratio:.6g} times that",
            )
    return known[0][1] if known else None


SAME: Final = 1e-6
"""Relative difference of numbers that are the same: seven digits are written."""


def same(one: Any, other: Any) -> bool:
    """Return whether two values differ only in digits that are not written.

    Examples
    --------
    >>> same({"force_n": 20.0}, {"force_n": 20.00000001}), same([1.0], [1.1])
    (True, False)
    """
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(same(value, other[key]) for key, value in one.items())
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(same(*pair) for pair in zip(one, other, strict=True))
    if isinstance(one, int | float) and isinstance(other, int | float):
        return math.isclose(one, other, rel_tol=SAME)
    return bool(one == other)
