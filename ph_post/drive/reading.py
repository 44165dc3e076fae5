"""What an independent gauge reads of a table: screw, scale and growth lie outside of the loop.

The parts add up, each of the true position: their order in the machine file makes no difference.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ph_post.drive.plant import Plant, Reading
from ph_post.types import Array

TRUE = Reading()
"""The reading of a table that is read as it stands."""


def read_table(plant: Plant, t: Array, table: Array, others: Mapping[str, Array]) -> Array:
    """Return what is read of a table, x (1 + ε) + Σ A sin(2π x/p + φ) + Σ G (1 - exp(-t/τ)) + Σ α y.

    Parameters
    ----------
    plant : Plant
        Of which only `reading` counts; its delay is that of :func:`ph_post.simulate.machine.run_plant`.
    t : Array, shape (n,)
        Time since the beginning of the motion [s].
    table : Array, shape (n,)
        x, where the table is [m].
    others : mapping of str to Array, shape (n,)
        y, where the tables of other axes are [m]. An axis that is not among them counts as 0.

    Returns
    -------
    Array, shape (n,)
        [m]; `table` itself where nothing is set.

    Examples
    --------
    >>> from ph_post.drive.plant import Plant, Reading
    >>> plant = Plant(feedback="load", b=5e-4, c=5e-3, reading=Reading(scale=1e-3, others=(("Y", 2e-3),)))
    >>> read_table(plant, np.zeros(1), np.array([0.5]), {"Y": np.array([0.25])})
    array([0.501])
    """
    reading = plant.reading
    if reading == TRUE:
        return table
    wrong = reading.scale * table
    for amplitude, period, phase in reading.cycles:
        wrong = wrong + amplitude * np.sin(2.0 * np.pi * table / period + phase)
    for growth, time_constant in reading.growths:
        wrong = wrong - growth * np.expm1(-t / time_constant)
    for name, angle in reading.others:
        if name in others:
            wrong = wrong + angle * others[name]
    return table + wrong
