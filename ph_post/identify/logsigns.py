"""Columns of a log that were swapped, and signs that were turned, by what no drive does.

A reading that is rougher than a command follows it; a motor pushes its table, not the table the motor; what a
motor gives goes into acceleration and losses.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from ph_post.errors import InputError
from ph_post.files.check import counted
from ph_post.identify.noise import noise_of_differences
from ph_post.types import Array, AxisLog, BoolArray, Log
from ph_post.units import MICROMETRE, MM, MS

AHEAD: Final = 2.0 * MS
"""Lead of a reading over its command that no feed-forward makes [s]."""

ROUGHER: Final = 3.0
"""Times as rough as its reading that a column is no command."""

SLIGHTLY: Final = 0.3 * MS
"""Lead from which on a column is none where it is rougher by far: fed forward, a reading follows this closely [s]."""

BY_FAR: Final = 20.0
"""Times as rough as its reading: what a command computes has no noise."""

SMALL: Final = 0.2 * MM
"""Travel of a log below which its positions may be in metres, and were taken for mm."""

NANOMETRE: Final = 1e-3 * MICROMETRE

FINEST: Final = 5.0 * NANOMETRE
"""Noise from sample to sample that no encoder of a machine tool is below; a position in metres is, taken for mm."""

COPIED: Final = 3
"""Samples by which a copy may be late, less one: a loop without a drive returns its command so."""

SMOOTHING: Final = 5.0
"""Standard deviation of the smoothing before speeds are taken, samples."""

MOVES: Final = 0.02
"""Part of the largest speed from which an axis moves."""

LEADS: Final = 3.0 * MICROMETRE
"""Half of what the table would be ahead of the motor, in the direction of motion, to be noticed [m]."""

CLEAR: Final = 5.0
"""Standard errors that it must be."""

AGAINST: Final = 0.3
"""Correlation of an effort with acceleration, and with the direction, that a turned sign has at least."""

TOGETHER: Final = 200.0
"""Samples that say about one thing, where neighbours go together."""


def require_order(log: Log, header: str) -> tuple[str, ...]:
    """Refuse commands and readings that stand in each other's place, and efforts of the other sign.

    Returns
    -------
    tuple of str
        What may be wrong, to be said.

    Raises
    ------
    InputError
        With the mapping that puts it right.
    """
    said: list[str] = []
    for name, axis in log.axes.items():
        reading = axis.table if axis.table is not None else axis.motor
        if reading is None or np.ptp(axis.command) == 0.0 or np.count_nonzero(np.isfinite(reading)) < 200:
            continue
        column = f"{name}_act" if axis.table is not None else f"{name}_motor"
        said += _copies(name, axis)
        said += _small(name, column, axis.command, reading)
        said += _lead(name, column, axis.command, reading, log.period, header)
        _effort(name, axis, reading, log.period, header)
        said += _pushes(name, axis, log.period)
    return tuple(said)


def _copies(name: str, axis: AxisLog) -> Iterator[str]:
    """Yield that the table's reading is another column to the last digit, as no reading is.

    A motor without a loop may be taken to stand where it is commanded.
    """
    there = {"cmd": axis.command, "act": axis.table, "motor": axis.motor}
    for first, second in (("cmd", "act"), ("act", "motor")):
        one, other = there[first], there[second]
        if one is None or other is None:
            continue
        for late in range(COPIED):
            earlier, later = one[: one.size - late], other[late:]
            known = np.isfinite(earlier) & np.isfinite(later)
            if np.array_equal(earlier[known], later[known]) and np.any(later[known] != later[known][:1]):
                words = f", late by {counted(late, 'sample')}" if late else ""
                yield (
                    f"{name}_{second} is {name}_{first} to the last digit{words}: one value was recorded"
                    " twice, or nothing was measured; what is found by it means nothing"
                )
                break


def _small(name: str, column: str, command: Array, reading: Array) -> Iterator[str]:
    """Yield that an axis moves so little, and is read so finely, that its numbers may be metres."""
    travel, fine = float(np.ptp(command)), noise_of_differences(reading)
    if travel < SMALL and fine is not None and fine < FINEST:
        yield (
            f"{name}_cmd moves by {travel / MM:.3g} mm in all, and {column} is read to {fine / NANOMETRE:.2g} nm: are"
            f" these numbers metres? --column {name}_cmd={name}_cmd:m --column {column}={column}:m"
        )


def _lead(name: str, column: str, command: Array, reading: Array, period: float, header: str) -> Iterator[str]:
    """Refuse a command that follows its reading, or yield that it does."""
    known = np.isfinite(reading)
    speed = np.gradient(gaussian_filter1d(command, SMOOTHING), period)
    apart = (reading - command)[known]
    v = speed[known] - np.mean(speed[known])
    ahead = float(v @ (apart - np.mean(apart))) / max(float(v @ v), 1e-300)
    rough, fine = (noise_of_differences(one) or 0.0 for one in (command, reading))
    rougher = rough / max(fine, 1e-12)
    if ahead < max(AHEAD, period) and (ahead < SLIGHTLY or rougher < BY_FAR):
        return
    if rougher > ROUGHER:
        raise InputError(
            header,
            f"{column} runs {ahead / MS:.2g} ms ahead of {name}_cmd, which is rougher: the two are swapped",
            expected=f"--column {name}_cmd={column} --column {column}={name}_cmd",
        )
    yield f"{column} runs {ahead / MS:.2g} ms ahead of {name}_cmd: are the two swapped, or recorded at other times?"


def _effort(name: str, axis: AxisLog, reading: Array, period: float, header: str) -> None:
    """Refuse an effort that brakes what speeds up and drives what rubs."""
    if axis.effort is None:
        return
    known = np.isfinite(reading) & np.isfinite(axis.effort)
    place = np.interp(np.arange(reading.size), np.flatnonzero(known), reading[known]) if known.any() else reading
    speed = np.gradient(gaussian_filter1d(place, SMOOTHING), period)
    gain = np.gradient(speed, period)
    effort = gaussian_filter1d(np.where(known, axis.effort, 0.0), SMOOTHING)
    moves = known & _moves(speed)
    ends = int(4.0 * SMOOTHING) + 2  # where a log begins or ends in motion it is smoothed to a stop
    moves[:ends] = moves[-ends:] = False
    if np.count_nonzero(moves) < 200:
        return
    # A force that drives the table, as cutters do, hides what speeds up in what goes with the speed.
    losses = np.stack([np.sign(speed[moves]), speed[moves], np.ones(np.count_nonzero(moves))], axis=1)
    both = [_likeness(effort[moves], one[moves]) for one in (np.sign(speed), speed)]
    both.append(_likeness(_beside(effort[moves], losses), _beside(gain[moves], losses)))
    # One of three alone may be against by chance, as beside an effort that only grows.
    if min(both) < -AGAINST and max(both) < AGAINST / 3.0 and np.mean(both) < -0.5 * AGAINST:
        column = f"{name}_force" if axis.effort_unit == "N" else f"{name}_current"
        raise InputError(
            header,
            f"{column} brakes {name} where it speeds up and drives it where it rubs: its sign is turned",
            expected=f"--column {column}={column}*-1:{axis.effort_unit}",
        )


def _pushes(name: str, axis: AxisLog, period: float) -> Iterator[str]:
    """Yield that the table runs ahead of its motor in either direction."""
    if axis.table is None or axis.motor is None or axis.side == "unknown":
        return
    apart = axis.motor - axis.table
    speed = np.gradient(gaussian_filter1d(axis.command, SMOOTHING), period)
    use = np.isfinite(apart) & _moves(speed)
    if np.count_nonzero(use) < 200:
        return
    columns = np.stack([np.sign(speed[use]), speed[use], np.ones(np.count_nonzero(use))], axis=1)
    if np.ptp(columns[:, 0]) == 0.0:
        return
    size = np.sqrt(np.mean(columns**2, axis=0))
    found = np.linalg.lstsq(columns / size, apart[use], rcond=None)[0]
    left = apart[use] - columns / size @ found
    error = float(np.std(left)) * np.sqrt(TOGETHER / left.size)
    if found[0] < -LEADS and -found[0] > CLEAR * error:
        yield (
            f"{name}_act runs {-2.0 * found[0] / MICROMETRE:.3g} µm ahead of {name}_motor, by its direction, where a"
            f" motor pushes its table: are the two swapped? --column {name}_act={name}_motor"
            f" --column {name}_motor={name}_act"
        )


def _moves(speed: Array) -> BoolArray:
    size = np.abs(speed)
    return np.asarray(size > MOVES * np.max(size))


def _beside(values: Array, columns: Array) -> Array:
    """Return what of some values (n,) no sum of columns (n, k) gives."""
    size = np.sqrt(np.mean(columns**2, axis=0))
    return np.asarray(values - columns / size @ np.linalg.lstsq(columns / size, values, rcond=None)[0])


def _likeness(one: Array, other: Array) -> float:
    a, b = one - np.mean(one), other - np.mean(other)
    return float(a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-300)
