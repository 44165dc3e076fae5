"""The command between the rows of a log: straight at the period of a drive, smooth where rows are farther apart.

A drive gets its command every millisecond or so. A log with a row every 2 to 20 ms holds some of these places, and
what it leaves out is no straight line: a model that runs along one lags behind by another amount than the drive,
which looks like another c, or a delay. Cubics whose slopes are those of the quartic through five rows [1]_ err by
the fourth power of the period; where three rows are the same the axis rests, and the slope is 0.

References
----------
.. [1] B. Fornberg: Generation of finite difference formulas on arbitrarily spaced grids, Math. Comp. 51 (1988).
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.types import Array, sealed
from ph_post.units import MS

FINE: Final = 1.0 * MS
"""Period of what is laid between rows, at most [s]."""

STRAIGHT: Final = 1.5 * MS
"""Period up to which the command is taken as straight between rows [s]."""

ORDERS: Final = (4.0, 16.0)
"""By how much an error falls at least, and at most, where the period is halved."""


def parts_between(period: float) -> int:
    """Return into how many parts the time from row to row is cut.

    Examples
    --------
    >>> [parts_between(period) for period in (0.001, 0.002, 0.01)]
    [1, 2, 10]
    """
    return math.ceil(period / FINE - 1e-6) if period > STRAIGHT else 1


def refined(command: Array, parts: int) -> Array:
    """Return a command with places between its rows.

    Parameters
    ----------
    command : Array, shape (n,)
    parts : int

    Returns
    -------
    Array, shape ((n - 1) parts + 1,)
        Every so many of them is a row.

    Examples
    --------
    >>> refined(np.array([0.0, 1.0, 8.0, 27.0, 64.0, 125.0]), 2)[3:8]
    array([ 3.375,  8.   , 15.625, 27.   , 42.75 ])
    """
    if parts == 1 or command.size < 2:
        return command
    slope = np.gradient(command)
    slope[2:-2] = (8.0 * (command[3:-1] - command[1:-3]) - (command[4:] - command[:-4])) / 12.0
    still = np.diff(command) == 0.0
    rests = np.flatnonzero(still[:-1] & still[1:])
    for row in (0, 1, 2):
        slope[rests + row] = 0.0
    u = np.arange(parts)[None, :] / parts
    step, first, last = (one[:, None] for one in (np.diff(command), slope[:-1], slope[1:]))
    cubic = command[:-1, None] + u * (first + u * ((3.0 * step - 2.0 * first - last) + u * (first + last - 2.0 * step)))
    return sealed(np.append(cubic, command[-1]))


def interpolation_error(command: Array, period: float) -> Array:
    """Return about how far a command that is laid between rows is off.

    Every second row is left out and laid again. That error falls as the period does, by a factor that leaving
    out three of four shows.

    Returns
    -------
    Array, shape (m,)
        In the unit of the command, at rows, but for a few at the end; zeros where the period is that of a drive.
    """
    coarse, coarser = (_left_out(command, every) for every in (2, 4))
    if parts_between(period) == 1 or coarser.size < 8:
        return np.zeros(command.size)
    fall = math.sqrt(float(np.mean(coarser**2)) / max(float(np.mean(coarse**2)), 1e-300))
    return np.asarray(coarse / min(max(fall, ORDERS[0]), ORDERS[1]))


def _left_out(command: Array, every: int) -> Array:
    """Return the error of laying all rows anew through every second or fourth."""
    whole = command[: (command.size - 1) // every * every + 1]
    return np.asarray(refined(whole[::every], every) - whole)
