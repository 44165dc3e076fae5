"""The time of a log: one constant period, and the samples that are missing from it."""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.io.logsheet import Sheet
from ph_post.types import Array, IntArray

JITTER: Final = 0.1
"""Part of the period by which a sample may be early or late."""

HOLES: Final = 0.05
"""Part of the rows that may be missing."""

DECIMALS: Final = 9
"""Times are looked at for rounding to so many decimals of a second at most."""


class Clock(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The time of rows: `place` (n,) is the sample that each is, `jitter` [s] how far one is off at most."""

    start: float
    period: float
    place: IntArray
    jitter: float


def clock_of(t: Array, sheet: Sheet) -> Clock:
    """Find the constant period of times [s], shape (n,).

    Times may have been rounded to few decimals, coarser than the period even. Holes are whole periods.

    Raises
    ------
    InputError
        Where time repeats or runs backwards, a sample is early or late by more than a tenth of the period, or
        too many are missing; with the line.
    """
    exact = _fitted(t, 0.0)
    if isinstance(exact, Clock) and not _too_many(exact):
        return exact
    rounding = _rounding(t)
    rounded = _fitted(t, rounding) if rounding > 0.0 else exact
    if isinstance(rounded, Clock) and not _too_many(rounded):
        return rounded
    raise _with_holes(exact, sheet) if isinstance(exact, Clock) else _refusal(t, exact, sheet)


class _Wrong(msgspec.Struct, frozen=True, kw_only=True):
    """The row at which time goes wrong, and the period and the time that were expected there."""

    row: int
    period: float
    expected: float


def _fitted(t: Array, rounding: float) -> Clock | _Wrong:
    """Lay a constant period through times that were rounded to multiples of `rounding`."""
    steps = np.diff(t)
    period = _typical(steps, rounding)
    if not period > 0.0:
        return _Wrong(row=1, period=period, expected=float(t[0]))
    room = 2.0 * JITTER * period + rounding
    count = np.rint(steps / period).astype(np.int64)
    if rounding >= 0.5 * period:  # holes cannot be told from rounding
        count = np.ones(count.size, dtype=np.int64)
    count = np.maximum(count, 1)
    off = np.flatnonzero((np.abs(steps - count * period) > room) | ((steps <= 0.0) & (rounding == 0.0)))
    if off.size:
        row = int(off[0]) + 1
        return _Wrong(row=row, period=period, expected=float(t[row - 1] + count[row - 1] * period))
    place = np.concatenate([[0], np.cumsum(count)]).astype(np.int64)
    start, period, error = _line(t, place)
    parts = period / rounding if rounding > 0.0 else 0.0
    if abs(parts - round(parts)) * t.size < 0.5:  # a whole number of them: rounding moves nothing
        rounding = 0.0
    row = int(np.argmax(np.abs(error)))
    if abs(error[row]) > JITTER * period + 0.5 * rounding:
        return _Wrong(row=row, period=period, expected=float(t[row] - error[row]))
    return Clock(start=start, period=period, place=place, jitter=float(np.abs(error).max()))


def _typical(steps: Array, rounding: float) -> float:
    """Return the period: the median of the steps, and the mean of all that are none of a hole."""
    median = float(np.median(steps))
    if rounding == 0.0 and median > 0.0:
        return median
    near = steps[steps <= 1.5 * max(median, rounding)]
    return float(near.mean()) if near.size else rounding


def _line(t: Array, place: IntArray) -> tuple[float, float, Array]:
    """Fit start and period, and how far each time is off; a round period is taken where it fits as well."""
    k = place - place.mean()
    period = float((k @ (t - t.mean())) / (k @ k))
    start = float(t.mean() - period * place.mean())
    error = t - (start + period * place)
    plain = float(f"{period:.4g}")
    other = t - plain * place
    other_start = float(other.mean())
    if plain > 0.0 and _size(other - other_start) <= 1.05 * _size(error) + 1e-12 * float(np.abs(t).max()):
        start, period, error = other_start, plain, other - other_start
    if abs(start - t[0]) <= float(np.abs(error).max()):
        start = float(t[0])
    return start, period, error


def _size(error: Array) -> float:
    return float(np.sqrt(np.mean(error * error)))


def _rounding(t: Array) -> float:
    """Return what all times are multiples of [s], a power of ten; 0 where they have many decimals."""
    for decimals in range(DECIMALS + 1):
        scaled = t * 10.0**decimals
        if np.all(np.abs(scaled - np.rint(scaled)) <= 1e-4):
            return float(10.0**-decimals)
    return 0.0


def _refusal(t: Array, wrong: _Wrong, sheet: Sheet) -> InputError:
    back = np.flatnonzero(np.diff(t) < 0.0)
    still = np.flatnonzero(np.diff(t) == 0.0)
    if back.size or still.size:
        row = int((back if back.size else still)[0]) + 1
        what = "time runs backwards" if back.size else "time repeats"
        return InputError(
            sheet.where(row), what, expected=f"t > {t[row - 1] + 0.0:.9g} s", got=f"{t[row]:.9g} s"
        )
    return InputError(
        sheet.where(wrong.row), "the sampling period is not constant",
        expected=f"t = {wrong.expected:.9g} s, at a period of {wrong.period:.6g} s",
        got=f"{t[wrong.row]:.9g} s",
    )  # fmt: skip


def _too_many(clock: Clock) -> bool:
    """Whether there are too many holes."""
    rows = int(clock.place[-1]) + 1
    return rows - clock.place.size > HOLES * rows


def _with_holes(clock: Clock, sheet: Sheet) -> InputError:
    rows = int(clock.place[-1]) + 1
    return InputError(
        sheet.where(int(np.argmax(np.diff(clock.place) > 1)) + 1),
        "too many samples are missing, here the first",
        expected=f"at most {HOLES:.0%} of the rows at a period of {clock.period:.6g} s",
        got=f"{rows - clock.place.size} of {rows}",
    )  # fmt: skip
