"""How much of an excess a place or a rule accounts for, judged on data that did not choose it."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np

from ph_post.types import Array, BoolArray, IntArray

TINY: Final = 1e-12
"""Relative size below which a column says nothing new."""


class Excess(NamedTuple):
    """Counted samples of a residual, (n,) [m], the half each is in, and the excess over the noise [m²].

    `energy` is each sample's part of the excess: r² - noise².
    """

    residual: Array
    half: BoolArray
    energy: Array
    total: float


class Window(NamedTuple):
    """A stretch of a quantity: its share of the excess, and what chance gives it, its share of samples."""

    low: float
    high: float
    share: float
    chance: float


def excess_of(residual: Array, half: BoolArray, noise: float) -> Excess:
    """Lay out what a residual has more than noise."""
    energy = residual**2 - noise**2
    return Excess(residual, half, energy, float(np.sum(energy)))


def follows(excess: Excess, columns: Array, constant: bool = True) -> float:
    """Share of the excess that follows columns, beyond a constant: fitted on one half, counted on the other.

    Parameters
    ----------
    excess : Excess
    columns : Array, shape (n, k)
    constant : bool, optional
        Whether a constant is fitted beside them (and does not count).

    Returns
    -------
    float
        At most 1; nothing or less where they do not help to foretell the other half.
    """
    gain = 0.0
    ones = np.ones((columns.shape[0], 1))
    full = np.hstack((ones, columns)) if constant else columns
    for fitted in (excess.half, ~excess.half):
        r, other = excess.residual[fitted], excess.residual[~fitted]
        if r.size == 0 or other.size == 0:
            return 0.0
        left = other - full[~fitted] @ solve(full[fitted], r)
        before = other - np.mean(r) if constant else other
        gain += float(before @ before - left @ left)
    return min(gain / excess.total, 1.0)


def solve(columns: Array, values: Array) -> Array:
    """Least squares by the normal equations of scaled columns."""
    scale = np.sqrt(np.mean(columns**2, axis=0))
    scale[scale == 0.0] = 1.0
    scaled = columns / scale
    found = np.linalg.lstsq(scaled.T @ scaled, scaled.T @ values, rcond=TINY)[0]
    return np.asarray(found / scale, dtype=np.float64)


def window_from_zero(excess: Excess, quantity: Array) -> Window:
    """Find up to which value of a quantity the excess is denser than on average; infinite is beyond."""
    order = np.argsort(quantity, kind="stable")
    grown = np.cumsum(excess.energy[order]) / excess.total
    chance = np.arange(1, order.size + 1) / order.size
    lift = np.where(np.isfinite(quantity[order]), grown - chance, -np.inf)
    at = int(np.argmax(lift))
    return Window(0.0, float(quantity[order[at]]), min(float(grown[at]), 1.0), float(chance[at]))


def window_within(excess: Excess, number: IntArray, edges: Array, across: bool = True) -> Window:
    """Find the stretch of bins in which the excess is densest.

    Parameters
    ----------
    excess : Excess
    number : IntArray, shape (n,)
        Bin of each sample.
    edges : Array, shape (bins + 1,)
    across : bool, optional
        Whether the stretch is chosen on one half and counted on the other; else on all of the record, for a
        quantity that the halves do not share.
    """
    size = edges.size - 1
    if not across:
        start, stop = _densest(excess.energy, number, size)
        return _window(excess, number, edges, start, stop)
    found = []
    for chosen in (excess.half, ~excess.half):
        start, stop = _densest(excess.energy[chosen], number[chosen], size)
        inside = (number >= start) & (number < stop) & ~chosen
        found.append((float(np.sum(excess.energy[inside])), int(np.count_nonzero(inside))))
    start, stop = _densest(excess.energy, number, size)
    share = sum(part[0] for part in found) / excess.total
    chance = sum(part[1] for part in found) / excess.energy.size
    return Window(float(edges[start]), float(edges[stop]), min(share, 1.0), chance)


def share_of(excess: Excess, inside: BoolArray) -> float:
    """Share of the excess in samples."""
    return float(np.sum(excess.energy[inside])) / excess.total


def bins_of(quantity: Array, count: int) -> tuple[IntArray, Array]:
    """Bins of equal width over the range of a quantity: number of each sample, and the edges."""
    edges = np.linspace(float(np.min(quantity)), float(np.max(quantity)), count + 1)
    width = edges[1] - edges[0]
    if width <= 0.0:
        return np.zeros(quantity.size, dtype=np.int64), edges
    number = np.minimum(((quantity - edges[0]) / width).astype(np.int64), count - 1)
    return number, edges


def _window(excess: Excess, number: IntArray, edges: Array, start: int, stop: int) -> Window:
    """Count a stretch of bins on all of the record."""
    inside = (number >= start) & (number < stop)
    share = min(share_of(excess, inside), 1.0)
    return Window(float(edges[start]), float(edges[stop]), share, float(np.mean(inside)))


def _densest(energy: Array, number: IntArray, size: int) -> tuple[int, int]:
    """First and one past the last bin of the stretch with most energy beyond its share of samples."""
    total = float(np.sum(energy))
    if total <= 0.0:
        return 0, 0
    density = np.bincount(number, energy, size) / total - np.bincount(number, minlength=size) / energy.size
    grown = np.concatenate(([0.0], np.cumsum(density)))
    lowest = np.minimum.accumulate(grown)
    stop = int(np.argmax(grown - lowest))
    return int(np.argmin(grown[: stop + 1])), stop
