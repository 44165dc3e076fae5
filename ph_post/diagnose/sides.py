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
    difference = _Difference(problem, use)
    width, slows = difference.best_width(HELD), HELD
    if not difference.shows(width, slows):
        slows = difference.best_slowing()
        width = difference.best_width(slows)
        if not difference.shows(width, slows):
            return None
    return SidesGap(
        width=width,
        error=difference.error_of(width, slows),
        slows=slows,
        before=float(np.sqrt(difference.square(0.0, HELD))),
        after=float(np.sqrt(difference.square(width, slows))),
        motor=difference.motor,
    )


class _Difference:
    """Motor less table [m] of the samples `use` (n,), and what a backlash leaves of it beside place, speed and more.

    `motor` is where the motor is, smoothed, (n,) [m].
    """

    def __init__(self, problem: AxisProblem, use: BoolArray) -> None:
        self._problem, self._use = problem, use
        table, motor = problem.channel("act"), problem.channel("motor")
        known = np.flatnonzero(motor.ok)
        self.motor = gaussian_filter1d(np.interp(np.arange(use.size), known, motor.values[known]), SMOOTHING)
        self._apart = np.where(use, motor.values - table.values, 0.0)[use]
        speed = np.gradient(self.motor, problem.period)
        columns = [np.ones_like(speed), self.motor, speed, np.gradient(speed, problem.period)]
        beside = np.stack(columns, axis=1)[use]
        beside = beside / np.maximum(np.sqrt(np.mean(beside**2, axis=0)), 1e-300)
        self._basis = np.linalg.qr(beside)[0]
        self._noise = float(np.hypot(table.noise, motor.noise))
        self._none = self.left(0.0, HELD)

    def left(self, width: float, slows: float) -> Array:
        """Return what a backlash [m], of a table that friction slows [m/s²], leaves of the difference, (k,) [m]."""
        rest = self._apart - (self.motor - coast(self.motor, width, slows, self._problem.period))[self._use]
        return np.asarray(rest - self._basis @ (self._basis.T @ rest))

    def square(self, width: float, slows: float) -> float:
        """Return the mean square of what is left [m²]."""
        return float(np.mean(self.left(width, slows) ** 2))

    def best_width(self, slows: float) -> float:
        """Return the backlash that leaves least [m]."""
        most = 6.0 * float(np.std(self._none)) + 10.0 * self._noise
        return float(minimize_scalar(self.square, args=(slows,), bounds=(0.0, most), options={"xatol": 1e-9}).x)

    def best_slowing(self) -> float:
        """Return the deceleration by friction that, with its best backlash, leaves least [m/s²]."""

        def square(slows: float) -> float:
            return self.square(self.best_width(slows), slows)

        start = min(SLOWS, key=square)
        found = minimize_scalar(square, bounds=(0.5 * start, 2.0 * start), options={"xatol": 0.01 * start})
        return float(found.x)

    def shows(self, width: float, slows: float) -> bool:
        """Return whether a backlash is clear of the noise, explains the difference, and has one size."""
        left = self.left(width, slows)
        before, after = float(np.mean(self._none**2)), float(np.mean(left**2))
        explains = before - after >= EXPLAINS * (before - min(self._noise**2, after))
        return width >= CLEAR * self._noise and explains and _agrees(self._problem, self._none - left, left, self._use)

    def error_of(self, width: float, slows: float) -> float:
        """Return the standard error of a backlash [m]."""
        problem, left = self._problem, self.left(width, slows)
        step = 0.02 * width
        slopes = [(self.left(width + step, slows) - self.left(width - step, slows)) / (2.0 * step)]
        if slows < HELD:
            slopes.append((self.left(width, 1.05 * slows) - self.left(width, slows / 1.05)) / 0.1)
        size = max(float(np.sqrt(np.mean(left**2))), 1e-12)
        jacobian = np.column_stack([*slopes, self._basis * np.sqrt(left.size)]) / size
        number = np.arange(left.size) * BLOCKS // left.size
        channels = (problem.channel("act"), problem.channel("motor"))
        rounded = [rounding_of(one, problem.speed, self._use) for one in channels]
        rounded = [one._replace(size=one.size / size) for one in rounded]
        error = float(np.sqrt(block_covariance(jacobian, left / size, number, rounded=rounded)[0, 0]))
        if slows == HELD:
            return error
        # A table slides less simply than it is reckoned to, in all blocks alike: what its parts of the motion ask for
        # differs by as much.
        sizes = sizes_by_regime(problem, self._none - left, left, [self._use])
        return float(np.hypot(error, width * spread_of(sizes)))


def _agrees(problem: AxisProblem, adds: Array, rest: Array, use: BoolArray) -> bool:
    """Return whether the gap has one size in slow and quick motion, at all places and times."""
    return all(bool(np.all(np.abs(one.more) <= MOST)) for one in sizes_by_regime(problem, adds, rest, [use]))
