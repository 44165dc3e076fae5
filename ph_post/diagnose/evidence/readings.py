"""Evidence of reading errors: screw, scale, temperature, squareness and delay."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ph_post.diagnose.evidence.base import FEWEST, Evidence, compared, lag_words, similar_sizes, slopes
from ph_post.diagnose.evidence.forces import amplitude, wave_words
from ph_post.diagnose.residual_features import by_rotation, drift
from ph_post.diagnose.sentences import length
from ph_post.types import MACHINE_AXES
from ph_post.units import MM, MS

SPAN = 100.0 * MM
"""Travel over which a slope is given [m]."""


def cyclic(evidence: Evidence) -> Iterator[str]:
    """Yield what an error of the screw shows: its period, whatever the feed."""
    yield from wave_words(evidence, "a cyclic error repeats with the screw, the same at every feed", True)
    if evidence.both_sides:
        period, x = evidence.values["period"], evidence.motion.position
        sides = (amplitude(evidence.before[one], x, period, evidence.use(one)) for one in ("motor", "act"))
        motor, table = sides
        yield compared(
            "it lies behind the motor",
            f"{length(motor)} of that period on the motor's side, {length(table)} on the table's",
            motor < 0.5 * table,
        )


def scale(evidence: Evidence) -> Iterator[str]:
    """Yield whether an error is in proportion to the position."""
    x, use, residual = evidence.motion.position, evidence.use("act"), evidence.before["act"]
    middle = 0.5 * float(np.min(x[use]) + np.max(x[use]))
    whole = slopes(residual, use, x)[0] * SPAN
    numbers = f"{evidence.column('act')} gains {length(whole)} in 100 mm"
    parts = [use & (x <= middle), use & (x > middle)]
    agrees = True
    if all(np.count_nonzero(part) > FEWEST and np.ptp(x[part]) > 0.0 for part in parts):
        low, high = (slopes(residual, part, x)[0] * SPAN for part in parts)
        numbers += f", {length(low)} in the lower half of the travel and {length(high)} in the upper"
        agrees = similar_sizes(low, high)
    yield compared("a scale error is in proportion to the position", numbers, agrees)
    if evidence.has("motor"):
        motor = slopes(evidence.before["motor"], evidence.use("motor"), x)[0] * SPAN
        yield compared(
            "the motor's side does not see it",
            f"{evidence.column('motor')} gains {length(motor)} in 100 mm",
            abs(motor) < 0.5 * abs(whole),
        )


def thermal(evidence: Evidence) -> Iterator[str]:
    """Yield the course of a slow drift that levels out."""
    t, use = evidence.motion.t, evidence.use("act")
    found = drift(evidence.before["act"], t, use)
    lasts = float(np.ptp(t[use]))
    yield compared(
        "thermal growth is slow and levels out",
        f"{evidence.column('act')} drifts by {length(found.change)} in {lasts:.3g} s, half of it after "
        f"{found.half:.3g} s",
    )
    constant = evidence.values["time_constant"]
    if constant > lasts:
        yield (
            f"the log of {lasts:.3g} s is shorter than the time constant of {constant:.3g} s: it does not separate"
            " growth and time constant, and shows only their course"
        )


def squareness(evidence: Evidence) -> Iterator[str]:
    """Yield whether an error goes with the position of another axis, both ways round."""
    other = MACHINE_AXES[int(evidence.values["other"])]
    y, use, residual = evidence.motion.others[other], evidence.use("act"), evidence.before["act"]
    slope = slopes(residual, use, y)[0] * SPAN
    yield compared(
        f"out of square, {evidence.axis} goes with the position of {other}, at any feed",
        f"{evidence.column('act')} goes off by {length(slope)} in 100 mm of {other}",
    )
    if by_rotation(residual, evidence.motion, use) is not None:
        sides = [slopes(residual, use & (evidence.motion.turn == way), y)[0] * SPAN for way in (-1, 1)]
        yield compared(
            "it is the same both ways round",
            f"{length(sides[0])} in 100 mm clockwise, {length(sides[1])} counterclockwise",
            similar_sizes(*sides),
        )


def delay(evidence: Evidence) -> Iterator[str]:
    """Yield whether the lag is one time at any speed and acceleration."""
    motion, use = evidence.motion, evidence.use()
    late, bend, _ = slopes(evidence.residual, use, motion.velocity, motion.acceleration)
    yield compared(
        "a delay is a lag in proportion to the velocity, hardly to the acceleration",
        f"{evidence.reading} {lag_words(late, bend)}",
    )
    if evidence.shift is not None:
        way = "late" if evidence.shift >= 0.0 else "early"
        yield f"{evidence.reading} as a whole is {abs(evidence.shift) / MS:.3g} ms {way} against its drive"
