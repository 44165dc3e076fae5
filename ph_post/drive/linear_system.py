"""The response of a linear system, given as polynomials, to a command that is linear between its samples."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from ph_post.compiling import compiled, read_only
from ph_post.types import Array, frozen


class _Steps(NamedTuple):
    """A system from sample to sample: z' = kept z + before u + after u', y = seen z + direct u."""

    kept: Array
    before: Array
    after: Array
    seen: Array
    direct: float


def respond(given: Array, taken: Array, command: Array, period: float) -> Array:
    """Return y from rest, shape (n,), where taken(s) y = given(s) u, exact at the samples of a command u.

    Parameters
    ----------
    given, taken : Array
        Polynomials in s, highest power first, that of `given` no higher.
    command : Array, shape (n,)
        u, linear between samples.
    period : float
        [s].

    Examples
    --------
    >>> respond(np.ones(1), np.array([1.0, 0.0]), np.array([0.0, 2.0, 2.0]), 0.5)
    array([0. , 0.5, 1.5])
    """
    return _stepped(*_steps(tuple(given.tolist()), tuple(taken.tolist()), period), read_only(command))


@lru_cache(maxsize=64)
def _steps(given: tuple[float, ...], taken: tuple[float, ...], period: float) -> _Steps:
    """Go over to samples: the exponential of the system and of its command, in periods of time."""
    order = len(taken) - 1
    powers = period ** -np.arange(order, -1.0, -1.0)
    a = powers * taken
    b = powers * np.concatenate([np.zeros(len(taken) - len(given)), given]) / a[0]
    a = a / a[0]
    rates = np.zeros((order + 2, order + 2))
    rates[:1, :order] = -a[1:]
    rates[np.arange(1, order), np.arange(order - 1)] = 1.0
    rates[0, order] = 1.0
    rates[order, order + 1] = 1.0
    grown = _exponential(rates)[:order]
    after = grown[:, order + 1]
    kept, before, seen = grown[:, :order], grown[:, order] - after, b[1:] - b[0] * a[1:]
    return _Steps(frozen(kept), frozen(before), frozen(after), frozen(seen), float(b[0]))


TERMS: Final = 16
"""Terms of the series of an exponential, at half a unit: what follows is below a bit."""


def _exponential(rates: Array) -> Array:
    """Return exp(A) of a small matrix: a series of A/2^k, and D(2t) = D(t)² + 2 D(t) with D = exp - 1.

    scipy's asks for several threads, which of so small a matrix only wait for each other: 8 ms in place of 0.1.
    """
    halvings = max(math.frexp(float(np.abs(rates).sum(axis=0).max()))[1] + 1, 0)
    small, unit = rates / 2.0**halvings, np.eye(len(rates))
    grown = small
    for term in range(TERMS, 1, -1):
        grown = small @ (unit + grown / term)
    for _ in range(halvings):
        grown = grown @ grown + 2.0 * grown
    return unit + grown


@compiled
def _stepped(kept: Array, before: Array, after: Array, seen: Array, direct: float, command: Array) -> Array:
    """Run a system from rest, shape (n,)."""
    order = seen.size
    state, old = np.zeros(order), np.zeros(order)
    found = np.empty(command.size)
    for k in range(command.size):
        if k:
            old[:] = state
            for row in range(order):
                state[row] = before[row] * command[k - 1] + after[row] * command[k]
                for column in range(order):
                    state[row] += kept[row, column] * old[column]
        found[k] = direct * command[k]
        for row in range(order):
            found[k] += seen[row] * state[row]
    return found
