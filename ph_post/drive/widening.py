"""A gap that is not the same everywhere: a screw that is worn where it works most."""

from __future__ import annotations

from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.drive.plant import Plant, Widening
from ph_post.types import Array

SETTLED: Final = 60
"""Most rounds in which the table is found behind a gap: each brings it nearer by half at least."""


def gap_at(plant: Plant, table: Array) -> Array:
    """Return the gap [m] at places of the table [m], gap + slope (x - reference) + the bump, never below 0.

    Examples
    --------
    >>> from ph_post.drive.plant import Plant, Widening
    >>> worn = Widening(bump=2e-5, centre=0.1, width=0.05)
    >>> plant = Plant(feedback="motor", b=5e-4, c=5e-3, gap=3e-5, widening=worn)
    >>> [round(float(gap), 9) for gap in gap_at(plant, np.array([0.1, 0.15, 9.0]))]
    [5e-05, 4.2131e-05, 3e-05]
    """
    worn = plant.widening
    if worn is None:
        return np.full(np.shape(table), plant.gap)
    off = (table - worn.centre) / worn.width
    wider = worn.slope * (table - worn.reference) + worn.bump * np.exp(-0.5 * off * off)
    return np.asarray(np.maximum(plant.gap + wider, 0.0))


def widened(worn: Widening, factor: float) -> Widening | None:
    """Multiply what a gap has from place to place; None where nothing is left of it."""
    if factor == 0.0:
        return None
    return replace(worn, slope=worn.slope * factor, bump=worn.bump * factor)


def table_behind(plant: Plant, motor: Array, flank: int) -> Array:
    """Return where the table is [m] that a motor at m [m] touches on flank f (1, -1): x = m - f gap(x)/2."""
    table = np.asarray(motor, dtype=np.float64)
    if plant.widening is None:
        return np.asarray(table - 0.5 * flank * plant.gap)
    for _ in range(SETTLED):
        before, table = table, motor - 0.5 * flank * gap_at(plant, table)
        if np.array_equal(before, table):
            break
    return table
