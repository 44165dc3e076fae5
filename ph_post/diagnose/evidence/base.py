"""The readings of an axis against a model that lacks one effect, and the measures taken from them.

The numbers are means and least squares of a residual, reading minus model, by the motion of the axis. They
are measured, not fitted, so that they can be compared with the fitted ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.diagnose.residual_features import SAME_FEED, solve
from ph_post.diagnose.sentences import length, velocity
from ph_post.drive.cascade import time_constant
from ph_post.identify.free_run import AxisProblem
from ph_post.identify.linear_drive import RESTING, AxisMotion
from ph_post.types import Array, BoolArray
from ph_post.types.diagnosis import Channel
from ph_post.units import MICROMETRE, MS

SETTLING: Final = 5.0
"""Servo time constants behind a reversal, in which a lag is not yet what it will be."""

FEWEST: Final = 100
"""Samples below which no mean is given."""

LIKE: Final = 1.25
"""Sizes within this factor are alike."""


class Evidence(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One effect that was found, and the log without it.

    `before` (n,) by channel is reading minus the final model without this effect, `after` that of the whole
    model [m, or the effort's unit]; `values` [SI] and `errors` are the effect's, by name. `shift` [s] is by
    how much a position is late beyond what its drive explains, where the log shows it. `too` are the other
    axes on which the same effect was found.
    """

    problem: AxisProblem
    motion: AxisMotion
    before: Mapping[Channel, Array]
    after: Mapping[Channel, Array]
    values: Mapping[str, float]
    errors: Mapping[str, float]
    effort_unit: str = ""
    shift: float | None = None
    too: tuple[str, ...] = ()

    @property
    def axis(self) -> str:
        """Name of the axis."""
        return self.problem.axis.name

    @property
    def channel(self) -> Channel:
        """The position that is looked at: the table's where there is one."""
        return "act" if self.has("act") else "motor"

    @property
    def residual(self) -> Array:
        """Residual of that position without the effect, (n,) [m]."""
        return self.before[self.channel]

    @property
    def both_sides(self) -> bool:
        """True if both the motor and the table were read."""
        return self.has("motor") and self.has("act")

    @property
    def reading(self) -> str:
        """Column of that position."""
        return self.column(self.channel)

    @property
    def effort_name(self) -> str:
        """Name of the effort."""
        return "current" if self.effort_unit == "A" else "force"

    def column(self, channel: Channel) -> str:
        """Name of a channel's column."""
        return f"{self.axis}_{channel}"

    def has(self, channel: Channel) -> bool:
        """Return whether a channel was recorded."""
        return self.problem.has(channel)

    def values_of(self, channel: Channel) -> Array:
        """Return a channel as it was read, (n,)."""
        return self.problem.channel(channel).values

    def use(self, *channels: Channel) -> BoolArray:
        """Return the samples that count and where these channels were recorded; the main position if none."""
        wanted = channels or (self.channel,)
        use = self.problem.counted
        for one in self.problem.observed:
            if one.channel in wanted:
                use = use & one.ok
        return use

    def noise(self, channel: Channel) -> float:
        """Noise of a channel."""
        return self.problem.channel(channel).noise

    def effort(self, value: float) -> str:
        """Write an effort in its unit."""
        return f"{value + 0.0:.3g} {self.effort_unit}".rstrip()


class SpeedLevel(NamedTuple):
    """Speed [m/s], and half the difference of a residual between the directions there: < 0 lags behind."""

    speed: float
    half: float


def halves_by_speed(
    residual: Array, motion: AxisMotion, use: BoolArray, settle: float, groups: int = 2
) -> tuple[SpeedLevel, ...]:
    """Half the difference between directions, slow and fast; one group where there is one speed only.

    Parameters
    ----------
    residual : Array, shape (n,)
    motion : AxisMotion
    use : BoolArray, shape (n,)
    settle : float
        Time after a reversal that is left out, where the log is long enough for it [s].
    groups : int
        As many equal parts of the samples, by speed.
    """
    speed = np.abs(motion.velocity)
    moving = use & (speed > RESTING * float(np.max(speed, initial=0.0))) & (motion.direction != 0)
    late = moving & (motion.since > settle)
    moving = late if _both(late, motion) else moving
    if not _both(moving, motion):
        return ()
    edges = np.quantile(speed[moving], np.linspace(0.0, 1.0, groups + 1))
    levels = []
    for low, high in pairwise(edges.tolist()):
        inside = moving & (speed >= low) & (speed <= high)
        if _both(inside, motion):
            levels.append(SpeedLevel(float(np.mean(speed[inside])), half_between(residual, motion, inside)))
    if len(levels) > 1 and levels[-1].speed > SAME_FEED * levels[0].speed:
        return tuple(levels)
    return (SpeedLevel(float(np.mean(speed[moving])), half_between(residual, motion, moving)),)


def half_between(residual: Array, motion: AxisMotion, inside: BoolArray) -> float:
    """Half the difference of a residual's means between plus and minus."""
    plus, minus = (np.mean(residual[inside & (motion.direction == way)]) for way in (1, -1))
    return 0.5 * float(plus - minus)


def _both(inside: BoolArray, motion: AxisMotion) -> bool:
    ways = [np.count_nonzero(inside & (motion.direction == way)) for way in (1, -1)]
    return bool(min(ways) >= FEWEST)


def settled_after(evidence: Evidence) -> float:
    """Return the time behind a reversal after which a servo has settled [s]."""
    problem = evidence.problem
    return SETTLING * (problem.plant.c if problem.plant.cascade is None else time_constant(problem.axis.servo))


def settled_levels(evidence: Evidence, residual: Array, use: BoolArray, groups: int = 2) -> tuple[SpeedLevel, ...]:
    """Halves by speed, behind what the servo needs to settle."""
    return halves_by_speed(residual, evidence.motion, use, settled_after(evidence), groups)


def between_ways(evidence: Evidence, residual: Array, use: BoolArray) -> float | None:
    """Difference of a residual between the directions, plus less minus; None where it goes one way."""
    levels = settled_levels(evidence, residual, use, 1)
    return 2.0 * levels[0].half if levels else None


def slopes(residual: Array, use: BoolArray, *columns: Array) -> tuple[float, ...]:
    """Least squares on columns beside a constant, which comes last."""
    full = np.column_stack([*(column[use] for column in columns), np.ones(np.count_nonzero(use))])
    return tuple(float(one) for one in solve(full, residual[use]))


def correlation(residual: Array, use: BoolArray, *columns: Array) -> float:
    """Share of a residual's variance that follows columns."""
    found = slopes(residual, use, *columns)
    fit = sum(k * column[use] for k, column in zip(found, columns, strict=False))
    total = float(np.var(residual[use]))
    return 1.0 - float(np.var(residual[use] - fit)) / total if total > 0.0 else 0.0


def rms(residual: Array, use: BoolArray) -> float | None:
    """Root mean square; None of too few samples."""
    return float(np.sqrt(np.mean(residual[use] ** 2))) if np.count_nonzero(use) >= FEWEST else None


def effort_parts(evidence: Evidence) -> tuple[float, float] | None:
    """Parts of the effort: what steps where the axis reverses (half of it), and what is always there.

    Least squares of the effort as recorded on direction, speed and acceleration beside a constant, while the
    axis moves and behind what the servo needs to settle.
    """
    motion = evidence.motion
    if not evidence.has("force"):
        return None
    speed = np.abs(motion.velocity)
    use = evidence.use("force") & (motion.direction != 0) & (speed > RESTING * np.max(speed))
    late = use & (motion.since > settled_after(evidence))
    use = late if _both(late, motion) else use
    if not _both(use, motion):
        return None
    way = motion.direction.astype(np.float64)
    found = slopes(evidence.values_of("force"), use, way, motion.velocity, motion.acceleration)
    return found[0], found[-1]


def compared(physics: str, numbers: str, agrees: bool = True) -> str:
    """Lay what is predicted beside what was measured."""
    return f"{physics}; here {numbers}" if agrees else f"{physics}; here not quite so: {numbers}"


def similar_sizes(one: float, other: float) -> bool:
    """Return whether two sizes are alike."""
    low, high = sorted((abs(one), abs(other)))
    return one * other > 0.0 and high <= LIKE * low


def lag_or_lead(half: float) -> str:
    """Write a lag or a lead."""
    return f"{length(abs(half))} {'behind' if half <= 0.0 else 'ahead'}"


def lag_words(late: float, bend: float) -> str:
    """Write what goes with the velocity [s] and with the acceleration [s²]: < 0 lags."""
    ways = ["lags" if slope <= 0.0 else "leads" for slope in (late, bend)]
    lag, sag = abs(late) / MS, abs(bend) / MICROMETRE
    return f"{ways[0]} by {lag:.3g} ms times the velocity and {ways[1]} by {sag:.3g} µm per m/s²"


def level_words(levels: tuple[SpeedLevel, ...]) -> str:
    """Write sizes by speed."""
    return ", ".join(f"{lag_or_lead(one.half)} at {velocity(one.speed)}" for one in levels)
