"""What motor and table show of the backlash between them, whatever the servo does.

X_motor less X_act knows no servo, no following error and no feed-forward. Where the file's servo is not the one of
the log, a gap that both sides show plainly is lost in what the model misses: here it is judged on the difference
alone. A table that friction holds in a gap follows the motor that was read; beside it the difference may go with
place, speed and acceleration (a scale, a late reading, a spring).
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize_scalar

from ph_post.diagnose.consistency import MOST, regimes
from ph_post.identify.errors import BLOCKS, block_covariance, rounding_of
from ph_post.identify.free_run import AxisProblem
from ph_post.types import Array, BoolArray

SMOOTHING: Final = 1.0
"""Standard deviation of the smoothing of the motor's reading, samples."""

CLEAR: Final = 5.0
"""Times the noise of the difference that a gap is at least."""

EXPLAINS: Final = 0.8
"""Part of what speed, place and acceleration leave of the difference that a gap explains at least."""

LEAST: Final = 0.08
"""Part of what a gap does that a regime must hold to count."""


class SidesGap(msgspec.Struct, frozen=True, kw_only=True):
    """Backlash that both sides of an axis show: `width` and its standard error [m], `before` and `after` rms [m]."""

    width: float
    error: float
    before: float
    after: float


def gap_between(problem: AxisProblem) -> SidesGap | None:
    """Return the backlash in the difference of motor and table; None where it shows none of one size.

    Parameters
    ----------
    problem : AxisProblem
    """
    if problem.side != "table" or not (problem.has("act") and problem.has("motor")):
        return None
    table, motor = problem.channel("act"), problem.channel("motor")
    use = problem.counted & table.ok & motor.ok
    if np.count_nonzero(use) < 20 * BLOCKS:
        return None
    known = np.flatnonzero(motor.ok)
    place = gaussian_filter1d(np.interp(np.arange(use.size), known, motor.values[known]), SMOOTHING)
    apart = np.where(use, motor.values - table.values, 0.0)[use]
    speed = np.gradient(place, problem.period)
    columns = np.stack([np.ones_like(place), place, speed, np.gradient(speed, problem.period)], axis=1)[use]
    columns = columns / np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
    basis = np.linalg.qr(columns)[0]

    def left(width: float) -> Array:
        rest = apart - (place - play(place, width))[use]
        return np.asarray(rest - basis @ (basis.T @ rest))

    noise = float(np.hypot(table.noise, motor.noise))
    none = left(0.0)
    most = 6.0 * float(np.std(none)) + 10.0 * noise
    found = minimize_scalar(lambda width: float(np.mean(left(width) ** 2)), bounds=(0.0, most), options={"xatol": 1e-9})
    width = float(found.x)
    rest = left(width)
    before, after = float(np.mean(none**2)), float(np.mean(rest**2))
    if width < CLEAR * noise or before - after < EXPLAINS * (before - min(noise**2, after)):
        return None
    adds = none - rest
    if not _agrees(problem, adds, rest, use):
        return None
    step = 0.02 * width
    slope = (left(width + step) - left(width - step)) / (2.0 * step)
    size = max(float(np.sqrt(after)), 1e-12)
    jacobian = np.column_stack([slope, basis * np.sqrt(rest.size)]) / size
    number = np.arange(rest.size) * BLOCKS // rest.size
    rounded = [rounding_of(one, problem.speed, use) for one in (table, motor)]
    rounded = [one._replace(size=one.size / size) for one in rounded]
    error = float(np.sqrt(block_covariance(jacobian, rest / size, number, rounded=rounded)[0, 0]))
    return SidesGap(width=width, error=error, before=float(np.sqrt(before)), after=float(np.sqrt(after)))


def play(motor: Array, gap: float) -> Array:
    """Return the place of a table (n,) that friction holds in a gap behind a motor (n,), from its middle on.

    Examples
    --------
    >>> play(np.array([0.0, 2.0, 4.0, 3.0, 1.0]), 2.0)
    array([0., 1., 3., 3., 2.])
    """
    table, half = float(motor[0]), 0.5 * gap
    found = []
    for at in motor.tolist():
        table = min(max(table, at - half), at + half)
        found.append(table)
    return np.array(found)


def _agrees(problem: AxisProblem, adds: Array, rest: Array, use: BoolArray) -> bool:
    """Return whether the gap has one size in slow and quick motion, at all places and times."""
    total = float(adds @ adds)
    for names, kinds in regimes(problem):
        kind = kinds[use] + 1
        own = np.bincount(kind, weights=adds * adds, minlength=len(names) + 1)[1:]
        fits = np.bincount(kind, weights=adds * rest, minlength=len(names) + 1)[1:]
        if np.any(np.abs(fits[own > LEAST * total]) > MOST * own[own > LEAST * total]):
            return False
    return True
