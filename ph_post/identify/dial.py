"""Lost motion from a dial indicator: rows of readings at places, from minus and from plus."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Final

import msgspec
import numpy as np
from scipy import stats

from ph_post.errors import InputError
from ph_post.identify.handreadings import COARSEST_DIAL, Sure, resolution, rounding_error, widened
from ph_post.types import Array
from ph_post.types.readings import STEPS, DialRow
from ph_post.units import INCH, MICROMETRE, MM

SLIPPED: Final = 0.3
"""Part of the swing by which repeated readings may differ before the indicator has slipped."""

MOST_LOST: Final = 0.9
"""Part of the swing from which on the table hardly moves: the lost motion may be anything above."""

NEAR: Final = 10.0 * MICROMETRE
"""How far off a lost motion may be in 90 of 100 cases; where it may be more, more readings are asked for."""

WELL_KNOWN: Final = NEAR / 1.645
"""Standard error of such a lost motion."""

COARSEST: Final = 20.0 * MICROMETRE
"""Standard error of the coarsest readings of a dial that are reckoned with [m]."""

_BY_CHANCE: Final = 1e-3
"""Chance that readings of one axis which agree are refused, of errors that are normally distributed."""

_WRONG_SIGN: Final = 3.0
"""Errors by which a lost motion may be below 0."""

_UNITS: Final = (
    (MM / INCH, "the dial counts inches", 'unit = "inch"'),
    (INCH / MM, "the dial counts mm", 'unit = "mm"'),
    (1000.0, "the dial counts micrometres", 'unit = "um"'),
    (0.001, "the dial counts mm", 'unit = "mm"'),
    (25400.0, "the dial counts inches in micrometres", 'unit = "um"'),
)


class DialPlaceResult(msgspec.Struct, frozen=True, kw_only=True):
    """Lost motion of one row [m], its place [m] and feed [m/s], None where they are not known."""

    lost_motion: float
    place: float | None
    feed: float | None


class DialResult(msgspec.Struct, frozen=True, kw_only=True):
    """Lost motion of an axis by a dial indicator [m].

    `scatter` is the standard error of one reading, `along` the standard deviation of the lost motion along the
    axis beyond what the readings scatter, both [m]; None where it was read at one place alone. `repeats` is how often
    each place has to be read from either side for a lost motion within :data:`NEAR` in 90 of 100 cases: 0 where it is
    known as well as that, None where the steps of the dial do not let it.
    """

    axis: str
    lost_motion: Sure
    scatter: float
    along: float | None
    repeats: int | None
    rows: tuple[DialPlaceResult, ...]


def read_dial(rows: Sequence[DialRow], swing: float) -> dict[str, DialResult]:
    """Return the lost motion of every axis with rows.

    Parameters
    ----------
    rows : sequence of DialRow
    swing : float
        Way that the table went on beyond each place [m].

    Raises
    ------
    InputError
        Where readings contradict the swing, each other or a lost motion above 0; or are too few to say how sure.
    """
    by_axis: dict[str, list[DialRow]] = {}
    for row in rows:
        by_axis.setdefault(row.axis, []).append(row)
    return {axis: _axis(axis, group, swing) for axis, group in by_axis.items()}


def _axis(axis: str, rows: Sequence[DialRow], swing: float) -> DialResult:
    _check_swing(axis, rows, swing)
    lost = np.array([_check_row(row, swing) for row in rows])
    _check_repeats(rows)
    _check_ways(rows, lost)
    _check_same_places(rows, lost)
    scatter, freedom = _scatter(rows, lost)
    if freedom == 0:
        what = "one reading from either side does not say how far it is off"
        raise InputError(f"{rows[0].where}, {axis}", what, expected="another row, or more readings in this one")
    grain = _grain(rows)
    noise, rounding = _mean_noise(rows, scatter, freedom), rounding_error(grain, scatter)
    found = Sure(value=float(np.mean(lost)), error=math.hypot(noise, rounding))
    if found.value < -max(_WRONG_SIGN * found.error, 5.0 * MICROMETRE):
        what = f"the lost motion of {axis} comes out below 0: readings from minus and from plus are swapped"
        raise InputError(rows[0].where, what, expected="more where the axis comes from plus", got=_mm(found.value))
    return DialResult(
        axis=axis,
        lost_motion=found,
        scatter=scatter,
        along=_along(rows, lost, scatter),
        repeats=_repeats(rows, noise, rounding),
        rows=tuple(
            DialPlaceResult(lost_motion=float(one), place=row.place, feed=row.feed)
            for one, row in zip(lost, rows, strict=True)
        ),
    )


def _sides(row: DialRow) -> tuple[Array, Array]:
    """Return the readings from minus, and from plus."""
    readings = row.readings
    return np.array([readings[0], *readings[3::2]]), np.array([readings[2], *readings[4::2]])


def _lost(row: DialRow) -> float:
    minus, plus = _sides(row)
    return float(np.mean(plus) - np.mean(minus))


def _beyond(row: DialRow) -> float:
    return row.readings[1] - row.readings[0]


def _check_swing(axis: str, rows: Sequence[DialRow], swing: float) -> None:
    """Refuse readings in another unit or with the other sign: the swing is known."""
    shares = [_beyond(row) / swing for row in rows]
    typical = float(np.median(shares))
    where = rows[int(np.argmin(np.abs(np.array(shares) - typical)))].where
    expected, got = f"{_mm(swing)} more beyond than from minus", _mm(typical * swing)
    if -1.3 < typical < -0.7:
        what = f"the dial counts down while {axis} counts up"
        raise InputError(where, what, expected=f"{expected}: every reading with the other sign", got=got)
    for ratio, what, instead in _UNITS:
        if 0.75 < abs(typical) / ratio < 1.3:
            raise InputError(where, what, expected=f"{instead}, {expected}", got=got)


def _check_row(row: DialRow, swing: float) -> float:
    """Return the lost motion of a row whose readings agree with each other."""
    for side, name in zip(_sides(row), ("minus", "plus"), strict=True):
        if np.ptp(side) > SLIPPED * swing:
            listed = ", ".join(f"{one / MM:.4g}" for one in side)
            what = f"readings from {name} contradict each other: the indicator slipped"
            raise InputError(row.where, what, expected=f"within {SLIPPED * swing / MM:.3g} mm", got=listed)
    lost = _lost(row)
    if lost > MOST_LOST * swing:
        what = f"the lost motion of {row.axis} is as large as the swing, and may be larger"
        raise InputError(row.where, what, expected="the test again with a larger --swing", got=_mm(lost))
    if abs(_beyond(row) / swing - 1.0) > SLIPPED:
        what = f"{row.axis} went on by {_mm(swing)}, and the dial shows another way"
        raise InputError(row.where, what, expected=f"about {_mm(swing)} more than from minus", got=_mm(_beyond(row)))
    return lost


def _check_repeats(rows: Sequence[DialRow]) -> None:
    """Refuse a reading that is farther from the same one taken again than all others' scatter lets it be.

    Where others are few they let it be anywhere, and readings as coarse as any are the limit.
    """
    sides = [
        (row, name, side) for row in rows for name, side in zip(STEPS[::2], _sides(row), strict=True) if side.size > 1
    ]
    freedom = sum(side.size - 1 for _, _, side in sides) - 1
    tests = max(sum(side.size for _, _, side in sides), 1)
    most, widest = _times(freedom, tests) if freedom else math.inf, float(stats.norm.isf(0.5 * _BY_CHANCE / tests))
    squares = sum(float(np.sum((side - np.mean(side)) ** 2)) for _, _, side in sides)
    grain = _grain(rows)
    worst, found = 1.0, None
    for row, name, side in sides:
        for k, reading in enumerate(side):
            others = np.delete(side, k)
            off, share = abs(reading - np.mean(others)), (side.size - 1) / side.size
            scatter = math.sqrt(max(squares - share * off**2, 0.0) / max(freedom, 1))
            by_others = most * max(scatter, grain / math.sqrt(12.0), 1e-9)
            limit = max(min(by_others, widest * COARSEST) / math.sqrt(share), NEAR + grain)
            if off / limit > worst:
                worst, found = off / limit, (row, name, reading, others, limit)
    if found is not None:
        row, name, reading, others, limit = found
        again = ", ".join(f"{one / MM:.4g}" for one in others)
        what = f"{name}, {reading / MM:.4g} mm contradicts {again} mm, read there again"
        expected = f"within {limit / MM:.2g} mm, by how far the others scatter: read this row again, or leave it out"
        raise InputError(row.where, what, expected=expected, got=f"{_mm(abs(reading - np.mean(others)))} apart")


def _check_ways(rows: Sequence[DialRow], lost: Array) -> None:
    """Refuse a row whose way beyond is not that of the other rows, as far as they scatter: the indicator slipped."""
    ways, rounding = np.array([_beyond(row) for row in rows]), _grain(rows) / math.sqrt(12.0)
    for k, row in enumerate(rows):
        others = np.delete(ways, k)
        scatter, freedom = _scatter([*rows[:k], *rows[k + 1 :]], np.delete(lost, k))
        if freedom == 0 or others.size < 2:
            continue
        scatter = max(scatter, rounding)
        limit = _times(freedom, len(rows)) * scatter * math.sqrt(2.0 + 2.0 / others.size) + NEAR
        if abs(ways[k] - np.mean(others)) > limit:
            what = "its way beyond contradicts that of the other rows: the indicator slipped, or a reading is wrong"
            expected = f"{_mm(float(np.mean(others)))} within {limit / MM:.2g} mm: read this row again, or leave it out"
            raise InputError(row.where, what, expected=expected, got=_mm(float(ways[k])))


def _check_same_places(rows: Sequence[DialRow], lost: Array) -> None:
    """Refuse rows of one place whose lost motions differ by more than readings scatter that were taken again.

    Rows without a place count as one: their mean would be as sure as their readings, wherever they were taken.
    """
    scatter, freedom = _scatter(rows, lost)
    if freedom == 0 or all(len(row.readings) == len(STEPS) for row in rows):
        return
    scatter = max(scatter, _grain(rows) / math.sqrt(12.0))
    nowhere = [(row, one) for row, one in zip(rows, lost.tolist(), strict=True) if row.place is None]
    pairs = [pair for group in (*_by_place(rows, lost).values(), nowhere) for pair in combinations(group, 2)]
    most = _times(freedom, max(len(pairs), 1))
    for (one, first), (other, second) in pairs:
        error = scatter * math.sqrt(sum(1.0 / side.size for row in (one, other) for side in _sides(row)))
        limit = most * error + NEAR
        if abs(first - second) > limit:
            first_row = one.where.rpartition(": ")[2]
            where = (
                f"at the same place of {one.axis}" if one.place is not None else f"and no place of {one.axis} is given"
            )
            what = f"its lost motion contradicts that of {first_row}, {where}"
            within = f"within {limit / MM:.2g} mm, by how far readings scatter"
            again = "read both again, or leave the wrong one out"
            if one.place is None:
                again = f"place_mm of each row of a file where it differs along the axis, else {again}"
            expected = f"{within}: {again}"
            raise InputError(other.where, what, expected=expected, got=f"{_mm(first)} and {_mm(second)}")


def _times(freedom: int, tests: int) -> float:
    """Return how many standard errors, from `freedom` degrees of freedom, the largest of `tests` errors has."""
    return float(stats.t.isf(0.5 * _BY_CHANCE / tests, freedom))


def _grain(rows: Sequence[DialRow]) -> float:
    return resolution([one for row in rows for one in row.readings], COARSEST_DIAL)


def _scatter(rows: Sequence[DialRow], lost: Array) -> tuple[float, int]:
    """Return the standard error of one reading, by repeats of the same, else between rows; and its freedom."""
    sides = [side for row in rows for side in _sides(row)]
    freedom = sum(side.size - 1 for side in sides)
    if freedom > 0:
        return math.sqrt(sum(float(np.sum((side - np.mean(side)) ** 2)) for side in sides) / freedom), freedom
    if len(rows) > 1:
        return float(np.std(lost, ddof=1)) / math.sqrt(2.0), len(rows) - 1
    return 0.0, 0


def _mean_noise(rows: Sequence[DialRow], scatter: float, freedom: int) -> float:
    """Return what the scatter of readings makes of the mean of the rows' lost motions [m]."""
    variance = sum(1.0 / side.size for row in rows for side in _sides(row)) / len(rows) ** 2
    return widened(freedom) * scatter * math.sqrt(variance)


def _repeats(rows: Sequence[DialRow], noise: float, rounding: float) -> int | None:
    """Return how often a place has to be read; as :class:`DialResult` has it."""
    if math.hypot(noise, rounding) <= WELL_KNOWN:
        return 0
    if rounding >= WELL_KNOWN:
        return None
    read = float(np.mean([side.size for row in rows for side in _sides(row)]))
    return math.ceil(read * noise**2 / (WELL_KNOWN**2 - rounding**2))


def _along(rows: Sequence[DialRow], lost: Array, scatter: float) -> float | None:
    """Return the standard deviation of the lost motion between places, less what the readings make of it [m]."""
    places = _by_place(rows, lost)
    if len(places) < 2:
        return None
    means = [float(np.mean([one for _, one in group])) for group in places.values()]
    noise = [
        scatter**2 * sum(1.0 / side.size for row, _ in group for side in _sides(row)) / len(group) ** 2
        for group in places.values()
    ]
    return math.sqrt(max(0.0, float(np.var(means, ddof=1)) - float(np.mean(noise))))


def _by_place(rows: Sequence[DialRow], lost: Array) -> Mapping[float, list[tuple[DialRow, float]]]:
    places: dict[float, list[tuple[DialRow, float]]] = {}
    for row, one in zip(rows, lost.tolist(), strict=True):
        if row.place is not None:
            places.setdefault(row.place, []).append((row, one))
    return places


def _mm(length: float) -> str:
    return f"{length / MM:.3g} mm"
