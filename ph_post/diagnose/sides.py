"""What motor and table show of the backlash between them, whatever the servo does.

X_motor less X_act knows no servo, no following error and no feed-forward. Where the file's servo is not the one of
the log, a gap that both sides show plainly is lost in what the model misses: here it is judged on the difference
alone. A table that friction holds in a gap follows the motor that was read; one on easy guideways runs on across its
gap where the motor brakes harder than friction does. Beside it the difference may go with place, speed and
acceleration (a scale, a late reading, a spring).
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize_scalar

from ph_post.diagnose.consistency import MOST, sizes_by_regime, spread_of
from ph_post.drive.plant import coast
from ph_post.identify.errors import BLOCKS, block_covariance, rounding_of
from ph_post.identify.free_run import AxisProblem
from ph_post.types import Array, BoolArray

SMOOTHING: Final = 1.0
"""Standard deviation of the smoothing of the motor's reading, samples."""

CLEAR: Final = 5.0
"""Times the noise of the difference that a gap is at least."""

EXPLAINS: Final = 0.8
"""Part of what speed, place and acceleration leave of the difference that a gap explains at least."""

HELD: Final = np.inf
"""Deceleration by friction of a table that stops at once where nothing pushes it."""

SLOWS: Final = tuple(2.0 ** np.arange(2, -7, -1))
"""Decelerations by friction from which a search begins [m/s²]: less than a standstill holds nothing in a gap."""


SURE: Final = 5.0
"""Standard errors from which on a gap is another than the file's."""

SAME_GAP: Final = 0.05
"""Part by which it is another at least."""


class SidesGap(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Backlash that both sides of an axis show.

    `width` and its standard error [m]; `slows`, the deceleration by which friction slows the table [m/s²], infinite
    where it does not run on; `before` and `after`, rms of the difference [m]; `motor`, where it is, smoothed, (n,) [m].
    """

    width: float
    error: float
    slows: float
    before: float
    after: float
    motor: Array

    def holds(self, acceleration: float) -> bool:
        """Return whether friction holds the table in the backlash at all accelerations up to this [m/s²]."""
        return self.slows >= acceleration

    def is_like(self, gap: float) -> bool:
        """Return whether a backlash [m] is this one, as far as it is known."""
        return abs(self.width - gap) < max(SURE * self.error, SAME_GAP * self.width)

    def beyond(self, gap: float, period: float) -> Array:
        """Return what this backlash adds to motor less table beyond one of `gap` [m] that friction holds, (n,) [m]."""
        return np.asarray(coast(self.motor, gap, HELD, period) - coast(self.motor, self.width, self.slows, period))


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

    def left(width: float, slows: float) -> Array:
        rest = apart - (place - coast(place, width, slows, problem.period))[use]
        return np.asarray(rest - basis @ (basis.T @ rest))

    def square(width: float, slows: float) -> float:
        return float(np.mean(left(width, slows) ** 2))

    def stands(width: float, slows: float) -> bool:
        after = square(width, slows)
        explains = before - after >= EXPLAINS * (before - min(noise**2, after))
        rest = left(width, slows)
        return width >= CLEAR * noise and explains and _agrees(problem, none - rest, rest, use)

    def best_width(slows: float) -> float:
        return float(minimize_scalar(square, args=(slows,), bounds=(0.0, most), options={"xatol": 1e-9}).x)

    noise = float(np.hypot(table.noise, motor.noise))
    none = left(0.0, HELD)
    before = float(np.mean(none**2))
    most = 6.0 * float(np.std(none)) + 10.0 * noise
    width, slows = best_width(HELD), HELD
    if not stands(width, slows):
        start = min(SLOWS, key=lambda one: square(best_width(one), one))
        found = minimize_scalar(
            lambda one: square(best_width(one), one), bounds=(0.5 * start, 2.0 * start), options={"xatol": 0.01 * start}
        )
        slows = float(found.x)
        width = best_width(slows)
        if not stands(width, slows):
            return None
    rest = left(width, slows)
    after = square(width, slows)
    step = 0.02 * width
    slopes = [(left(width + step, slows) - left(width - step, slows)) / (2.0 * step)]
    if slows < HELD:
        slopes.append((left(width, 1.05 * slows) - left(width, slows / 1.05)) / 0.1)
    size = max(float(np.sqrt(after)), 1e-12)
    jacobian = np.column_stack([*slopes, basis * np.sqrt(rest.size)]) / size
    number = np.arange(rest.size) * BLOCKS // rest.size
    rounded = [rounding_of(one, problem.speed, use) for one in (table, motor)]
    rounded = [one._replace(size=one.size / size) for one in rounded]
    error = float(np.sqrt(block_covariance(jacobian, rest / size, number, rounded=rounded)[0, 0]))
    if slows < HELD:
        # A table slides less simply than it is reckoned to, in all blocks alike: what its parts of the motion ask for
        # differs by as much.
        error = float(np.hypot(error, width * spread_of(sizes_by_regime(problem, none - rest, rest, [use]))))
    return SidesGap(
        width=width,
        error=error,
        slows=slows,
        before=float(np.sqrt(before)),
        after=float(np.sqrt(after)),
        motor=place,
    )


def _agrees(problem: AxisProblem, adds: Array, rest: Array, use: BoolArray) -> bool:
    """Return whether the gap has one size in slow and quick motion, at all places and times."""
    return all(bool(np.all(np.abs(one.more) <= MOST)) for one in sizes_by_regime(problem, adds, rest, [use]))
