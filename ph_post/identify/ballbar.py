"""Lost motion, squareness, scale and servo mismatch from ball-bar arcs, by linear least squares.

A ball bar measures the distance of the spindle from a point on the table while the axes go round it. With θ the
angle from the first axis, s = +1 counterclockwise and -1 clockwise, R the radius, to first order::

    r - R = r_s + a cosθ + b sinθ                      radius each way, centre of the bar off the centre
          + R (ε_1 - ε_2)/2 cos2θ + R α/2 sin2θ        scale mismatch, squareness
          + s v (T_1 - T_2)/2 sin2θ                    servo mismatch: lag of the first axis less the second's
          + s (L_1/2) cosθ sgn(sinθ) - s (L_2/2) sinθ sgn(cosθ)    lost motions

Readings close to a reversal, where an axis crosses its backlash, are left out. The classic names are those of
ball-bar reports and of ISO 230-4, whose circular deviation G is the largest radius less the smallest about the
centre of the fitted circle.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.errors import InputError
from ph_post.identify.handreadings import LinearFit, Sure, fit_rows, resolution
from ph_post.types import Array, BoolArray
from ph_post.types.readings import BallBarTrace
from ph_post.units import DEGREE, MICROMETRE, MM

_NEAR: Final = 5.0 * DEGREE
"""Angle to either side of a reversal that is left out at least [rad]."""

_ROUNDS: Final = 3
_WRONG_SIGN: Final = 4.0
_ALIKE: Final = 10.0 * MICROMETRE
"""What lost motions of two arcs may differ by beside their errors [m]."""

_ALIKE_SHARE: Final = 0.3
"""The same in parts of the larger one."""


_NAMES: Final = ("ccw", "cw", "a", "b", "mismatch", "square", "servo", "first", "second")
"""Parameters of the fit."""

_FADED: Final = 0.05
"""Correlation of residuals at which they count as independent."""


class BallBarResult(msgspec.Struct, frozen=True, kw_only=True):
    """What the arcs of one plane say; None: they do not show it.

    `lost_motion` [m] by axis; `squareness` [rad]; `mismatch` is the scale error of the first axis less the second's,
    `scale` the mean of both, which a calibrated bar shows; `servo` [m] the lag of the first axis less the second's
    at the feed of the arcs; `centre` [m] off the fitted circle. `deviation` [m] is the circular deviation G of each
    arc, and `radius` [m] the fitted one. `scatter` [m] is what no parameter explains.
    """

    plane: tuple[str, str]
    lost_motion: tuple[Sure | None, Sure | None]
    squareness: Sure | None
    mismatch: Sure | None
    scale: Sure | None
    servo: Sure | None
    feed: float | None
    deviation: tuple[tuple[int, float], ...]
    radius: float
    scatter: float


def read_arcs(traces: Sequence[BallBarTrace]) -> BallBarResult:
    """Return what the arcs of one plane say; both ways together separate squareness from servo mismatch.

    Raises
    ------
    InputError
        Where a lost motion comes out below 0: angle or direction are the other way; where arcs contradict each
        other; or where one is given twice.
    """
    _check_once(traces)
    angle = np.concatenate([one.angle for one in traces])
    turn = np.concatenate([np.full(one.angle.size, one.turn) for one in traces])
    radius = np.concatenate([one.radius for one in traces])
    typical = float(np.median(radius))
    rows, right = _rows(angle, turn, typical), radius - typical
    used = _away(angle, _NEAR)
    for _ in range(_ROUNDS):
        fit = _fit(rows[used], right[used])
        widest = max(0.0, *(fit.values[-2:]))
        crossing = math.acos(max(0.0, 1.0 - widest / typical))
        used = _away(angle, min(max(_NEAR, 1.2 * crossing), 30.0 * DEGREE))
    _check_alike(traces, used, rows, right)
    lost = (fit.get({"first": 1.0}), fit.get({"second": 1.0}))
    for axis, one in zip(traces[0].plane, lost, strict=True):
        if one is not None and one.value < -max(_WRONG_SIGN * one.error, 5.0 * MICROMETRE):
            what = f"the lost motion of {axis} comes out below 0: the angle or the direction is the other way"
            expected = f"angles from {traces[0].plane[0]} towards {traces[0].plane[1]}"
            raise InputError(traces[0].name, what, expected=expected, got=f"{one.value / MM:.3g} mm")
    ways = [name for name, sign in (("ccw", 1), ("cw", -1)) if np.any(turn == sign)]
    base = fit.get(dict.fromkeys(ways, 1.0 / len(ways)))
    nominal = traces[0].nominal
    scale = None
    if base is not None and nominal is not None:
        scale = Sure(value=(typical + base.value - nominal) / nominal, error=base.error / nominal)
    square, mismatch = fit.get({"square": 1.0}), fit.get({"mismatch": 1.0})
    servo = fit.get({"servo": 1.0})
    return BallBarResult(
        plane=traces[0].plane,
        lost_motion=lost,
        squareness=square,
        mismatch=mismatch,
        scale=scale,
        servo=servo,
        feed=traces[0].feed,
        deviation=tuple((one.turn, _deviation(one)) for one in traces),
        radius=typical if base is None else typical + base.value,
        scatter=fit.scatter,
    )


def _check_once(traces: Sequence[BallBarTrace]) -> None:
    """Refuse an arc that is there twice: it would count as measured again, and be surer than it is."""
    for first, second in combinations(traces, 2):
        alike = np.array_equal(first.radius, second.radius) and np.array_equal(first.angle, second.angle)
        if alike and first.turn == second.turn:
            what = f"holds the same readings as {first.name}" if first.name != second.name else "the arc is given twice"
            raise InputError(second.name, what, expected="each arc once, and the one in the other direction beside it")


def _check_alike(traces: Sequence[BallBarTrace], used: BoolArray, rows: Array, right: Array) -> None:
    """Refuse arcs whose lost motions, each by itself, are not those of one machine.

    Both together would make squareness, or a lag, of what they differ by.
    """
    seen: list[tuple[BallBarTrace, LinearFit]] = []
    for trace, end in zip(traces, np.cumsum([one.angle.size for one in traces]).tolist(), strict=True):
        own = np.zeros(used.size, dtype=bool)
        own[end - trace.angle.size : end] = True
        own &= used
        if np.count_nonzero(own) > len(_NAMES):
            seen.append((trace, _fit(rows[own], right[own])))
    for (first, one), (second, other) in combinations(seen, 2):
        for axis, name in zip(first.plane, ("first", "second"), strict=True):
            a, b = one.get({name: 1.0}), other.get({name: 1.0})
            if a is None or b is None:
                continue
            beside = max(_ALIKE, _ALIKE_SHARE * max(a.value, b.value))
            if a.differs(b, _WRONG_SIGN, beside):
                what = f"the lost motion of {axis} contradicts that by {first.name}"
                expected = "arcs of one machine in one state: take both again, or leave one out"
                got = f"{b.value / MM:.3g} mm and {a.value / MM:.3g} mm"
                raise InputError(second.name, what, expected=expected, got=got)


def _rows(angle: Array, turn: Array, radius: float) -> Array:
    """Return by how much each parameter makes each radius larger, (n, 9)."""
    cos, sin = np.cos(angle), np.sin(angle)
    return np.column_stack(
        [
            (turn > 0).astype(float),
            (turn < 0).astype(float),
            cos,
            sin,
            0.5 * radius * np.cos(2.0 * angle),
            0.5 * radius * np.sin(2.0 * angle),
            0.5 * turn * np.sin(2.0 * angle),
            0.5 * turn * cos * np.sign(sin),
            -0.5 * turn * sin * np.sign(cos),
        ]
    )


def _away(angle: Array, near: float) -> BoolArray:
    """Mark the readings that are further from every reversal than `near` [rad]."""
    quarter = 0.5 * math.pi
    off = np.abs(np.mod(angle + 0.5 * quarter, quarter) - 0.5 * quarter)
    marked: BoolArray = off > near
    return marked


def _fit(rows: Array, right: Array) -> LinearFit:
    """Fit, and widen the errors by as much as residuals hang together along the arc."""
    fit = fit_rows(_NAMES, rows, right, resolution(right.tolist()))
    left = fit.left - np.mean(fit.left)
    power, together = float(left @ left), 1.0
    for lag in range(1, left.size // 10):
        share = float(left[:-lag] @ left[lag:]) / power if power > 0.0 else 0.0
        if share < _FADED:
            break
        together += 2.0 * share
    return replace(fit, inflation=together)


def _deviation(trace: BallBarTrace) -> float:
    """Return the circular deviation of an arc about the centre of its fitted circle [m]."""
    cos, sin = np.cos(trace.angle), np.sin(trace.angle)
    rows = np.column_stack([np.ones_like(cos), cos, sin])
    values, *_ = np.linalg.lstsq(rows, trace.radius, rcond=None)
    left = trace.radius - rows[:, 1:] @ values[1:]
    return float(np.ptp(left))
