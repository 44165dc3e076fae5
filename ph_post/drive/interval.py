"""The backlash interval of an axis on a circle, whichever way its loop is closed.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 4.
"""

from __future__ import annotations

import cmath
import math
from functools import lru_cache
from typing import Final

from ph_post.drive.servo import harmonic_response, is_stable
from ph_post.drive.settled import OUT_OF_RANGE, UNDAMPED, find_orbit, is_computable
from ph_post.types import Axis, BacklashInterval, Feedback, Gap, Servo

REMEMBERED: Final = 8192
"""Intervals kept: paths repeat their radii, and thousands of turning points ask for the same few."""

SMALLER_THAN_GAP: Final = (
    "the axis swings by less than its lost motion, so that the table does not follow it at all"
)
NO_SWING: Final = "there is no swing to follow: amplitude and feed must be positive"
NO_INERTIA: Final = "b is zero: without inertia the motor crosses the gap at once"


def backlash_interval(axis: Axis, amplitude: float, omega: float) -> tuple[BacklashInterval | None, str]:
    """Return the backlash interval an axis settles to at each reversal of X = a sin Ωt.

    With feedback from the table (`load`) it is that of section 4 of [1]_. With feedback from the motor, or
    none, the gap lies behind the loop: the motor side follows the command as if there were no gap, and the
    table stands from its reversal until it has come back by the lost motion (a play operator, closed form).

    Parameters
    ----------
    axis : Axis
    amplitude : float
        a [m], of the axis' swing on the osculating circle.
    omega : float
        Ω [1/s], feed times curvature.

    Returns
    -------
    interval : BacklashInterval or None
        None where no such orbit exists.
    note : str
        Why there is none, or what was left out; empty otherwise.

    Examples
    --------
    >>> from ph_post.types import Axis, Gap, Limits, Servo
    >>> stepper = Axis(name="X", feedback="none", servo=Servo(b=0.0, c=0.0), gap=Gap(lost_motion=1e-4),
    ...                limits=Limits(velocity=0.1, acceleration=1.0, jerk=100.0))
    >>> interval, note = backlash_interval(stepper, amplitude=0.02, omega=1.0)
    >>> round(interval.duration, 6)  # arccos(1 - 0.1 / 20)
    0.100042
    """
    return _interval(axis.feedback, axis.servo, axis.gap, amplitude, omega)


@lru_cache(maxsize=REMEMBERED)
def _interval(
    feedback: Feedback, servo: Servo, gap: Gap, amplitude: float, omega: float
) -> tuple[BacklashInterval | None, str]:
    """Dispatch on the feedback (an Axis itself cannot be hashed: its effects hold mappings)."""
    if not (0.0 < amplitude < math.inf and 0.0 < omega < math.inf):
        return None, NO_SWING
    if not is_computable(servo, gap, amplitude, omega):
        return None, OUT_OF_RANGE
    if feedback != "load":
        return play_interval(servo, gap, amplitude, omega)
    if servo.b == 0.0:
        interval, note = play_interval(servo, Gap(lost_motion=0.0), amplitude, omega)
        return interval, note or NO_INERTIA
    return find_orbit(servo, gap, amplitude, omega)


def play_interval(
    servo: Servo, gap: Gap, amplitude: float, omega: float
) -> tuple[BacklashInterval | None, str]:
    """Return the interval of a table that hangs on the motor side by a play of the lost motion L.

    The motor side settles to a swing G = a |x/X| behind the command (Eq. 8 of [1]_, or Eq. 7); the table
    stands while that returns from G to G - L, thus for ΩΔt = arccos(1 - L/G). `position` is the table's,
    half the lost motion short of the motor's.
    """
    ideal = servo.b == 0.0 and servo.c == 0.0
    if not (ideal or is_stable(servo)):
        return None, UNDAMPED
    response, _ = harmonic_response(servo, omega)
    swing = amplitude * abs(response)
    if gap.lost_motion > 2.0 * swing:
        return None, SMALLER_THAN_GAP
    angle = 2.0 * math.asin(math.sqrt(0.5 * gap.lost_motion / swing)) if gap.lost_motion else 0.0
    lag = -cmath.phase(response) / omega
    return BacklashInterval(lag=lag, duration=angle / omega, position=swing - 0.5 * gap.lost_motion), ""
