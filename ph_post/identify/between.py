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
from typing import Final, NamedTuple

import numpy as np

from ph_post.types import Array, sealed
from ph_post.units import MS

FINE: Final = 1.0 * MS
"""Period of what is laid between rows, at most [s]."""

STRAIGHT: Final = 1.5 * MS
"""Period up to which the command is taken as straight between rows [s]."""

STEPS_LATE: Final = 0.5
"""Rows by which a command in steps is late."""

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
    >>> refined(np.array([0.0, 1.0, 8.0, 27.0, 64.0, 125.0]), 2)[4:7]
    array([ 8.   , 15.625, 27.   ])
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


class CourseBetween(NamedTuple):
    """What a drive may make of a command between its rows: `rows` (n,) to go straight between, `late` by so many."""

    rows: Array
    late: float


def courses_between(command: Array) -> tuple[CourseBetween, ...]:
    """Return a command as a drive may follow it between its rows: along straight lines, a smooth curve, in steps.

    A smooth curve lies h² Ẍ/12 below the lines through its rows, in the mean over the time h from row to row: so much
    lower are rows to go straight between. Steps are half a row late, and half as far from the curve as the lines.

    Examples
    --------
    >>> [course.rows[3:5] for course in courses_between(6.0 * np.arange(8.0) ** 2)]
    [array([54., 96.]), array([53., 95.]), array([37., 73.])]
    """
    below = np.zeros_like(command)
    below[1:-1] = np.diff(command, 2) / 12.0
    steps = delayed(command - 0.5 * below, STEPS_LATE)
    return (
        CourseBetween(command, 0.0),
        CourseBetween(sealed(command - below), 0.0),
        CourseBetween(sealed(steps), STEPS_LATE),
    )


def delayed(values: Array, samples: float) -> Array:
    """Return values as they were so many samples before, by cubics through four neighbours.

    Straight lines between samples would cut the corners of a delay that is a part of a sample by more than
    good sensors read. Before the first there is the first.
    """
    if samples == 0.0:
        return values
    whole = int(np.floor(samples))
    u = 1.0 - (samples - whole)
    # Of the samples whole + 2, whole + 1, whole and whole - 1 before, u from the second to the third.
    weights = (
        -u * (u - 1.0) * (u - 2.0) / 6.0,
        (u * u - 1.0) * (u - 2.0) / 2.0,
        -u * (u + 1.0) * (u - 2.0) / 2.0,
        u * (u * u - 1.0) / 6.0,
    )
    rows = np.arange(values.size)
    found = np.zeros(values.size)
    for back, weight in zip((2, 1, 0, -1), weights, strict=True):
        found += weight * values[np.clip(rows - whole - back, 0, values.size - 1)]
    return found


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
