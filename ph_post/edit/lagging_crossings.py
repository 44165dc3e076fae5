"""Crossings whose motor lags behind its command: what of a command has the motor arrive, and no later than need be.

With the loop closed at the motor, the motor follows the command with the lag c. A command that crosses in t, goes
beyond by the part k of the backlash and comes back in t has the motor arrive at 2 t exactly where b = 0 and
k = 1/(exp(t/c) - 1); the table waits for 2 t in place of at most t + c ln(g/r), after which r of a plain crossing is
left.

Where a controller rounds the joints of a path that command turns back in one sharp joint, at which the path all but
stops. In its place the command's speed rises, falls and rises again at one acceleration, so that it ends at rest where
the motor has arrived: the fastest course that an acceleration allows. Its three arcs are broken lines with joints that
the controller passes.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np

from ph_post.drive.cascade import response_time, way_of_motor
from ph_post.types import Array, Servo
from ph_post.units import MM

BEYOND: Final = 0.4
"""Part of the backlash by which a crossing goes beyond: with the feed held there the error is no larger than the plain
program's."""

SHORT_LAG: Final = 1e-3
"""Lags below this [s] are those of a stepper."""

TRIALS: Final = 60
"""Durations of a crossing that are tried behind a lag."""

RESIDUE: Final = 0.5e-3 * MM
"""Rest of a crossing [m] at which it counts as done where the motor lags behind."""

FINER: Final = 2
"""Samples of a motor's way in the shortest crossing in arcs that is tried, beside :data:`TRIALS`."""

SETTLED: Final = 6.0
"""So many lags behind a crossing nothing of it is left."""

HALVINGS: Final = 40
"""Halvings of a range by which the arcs are found at whose end a motor has arrived."""

NEWTON: Final = 8
"""Steps of Newton's method, which is monotonic here."""


def lead_time(time: float, lag: float) -> float:
    """Return how long a command follows its tangent until a motor with a lag is where one without is after `time` [s].

    Of a way off that grows with the square of time, t², the motor has gone t² − 2 c t + 2 c² (1 − exp(−t/c)).

    Examples
    --------
    >>> lead_time(0.024, 0.0), round(lead_time(0.024, 0.025), 4)
    (0.024, 0.0395)
    """
    if lag == 0.0:
        return time
    longer = time + lag
    for _ in range(NEWTON):
        left = math.exp(-longer / lag)
        gone = longer * longer - 2.0 * lag * longer + 2.0 * lag * lag * (1.0 - left)
        longer -= (gone - time * time) / (2.0 * longer - 2.0 * lag * (1.0 - left))
    return longer


@lru_cache(maxsize=64)
def out_and_back(servo: Servo, lost: float, first: float) -> tuple[float, float]:
    """Return how long the offset changes [s], and by which part it goes beyond; a program is planned several times."""
    lag = response_time(servo)
    for part in np.geomspace(max(first, 0.5 * lag), max(first, 0.5 * lag) + 8.0 * lag, TRIALS):
        t = np.linspace(0.0, 2.0 * part + SETTLED * lag, 4 * TRIALS)
        out, back = (way_of_motor(servo, np.clip((t - begin) / part, 0.0, 1.0), t[1]) for begin in (0.0, part))
        behind = t >= 2.0 * part
        rest, way = 1.0 - out[behind], (out - back)[behind]
        beyond = float(np.clip((rest * way).sum() / max((way * way).sum(), 1e-30), 0.0, BEYOND))
        if np.abs(rest - beyond * way).max() * lost <= RESIDUE and part >= (1.0 + 2.0 * beyond) * first:
            break
    return float(part), beyond


class CrossingArcs(msgspec.Struct, frozen=True, kw_only=True):
    """The course of a crossing in arcs: for how long the command's speed rises, falls and rises again to rest [s].

    `ramp` [s] is how far apart joints are by which a controller plays an arc within its tolerance.
    """

    rise: float
    fall: float
    last: float
    ramp: float = math.inf

    @property
    def wait(self) -> float:
        """Time until the motor has arrived [s]."""
        return self.rise + self.fall + self.last

    @property
    def way(self) -> float:
        """Way [m] of the command at an acceleration of 1 m/s²."""
        return 2.0 * self.rise * self.fall - self.fall**2

    @property
    def beyond(self) -> float:
        """Part of its way by which the command goes beyond."""
        return self.last**2 / self.way

    def joints(self, least: float) -> tuple[Array, Array, Array]:
        """Return joints that stand for the arcs, n of them, `least` [s] apart or more where an arc is that long.

        Each is in the middle of a part of an arc: its time [s], the change of speed [1/s] there for a way of 1, and how
        long its part is [s].

        Examples
        --------
        >>> CrossingArcs(rise=0.01, fall=0.01, last=0.0).joints(0.005)[0].tolist()
        [0.005, 0.015]
        """
        arcs = np.array([self.rise, self.fall, self.last])
        count = np.maximum(np.minimum(np.ceil(arcs / self.ramp), np.floor(arcs / least)), arcs > 0.0).astype(np.int64)
        part = np.repeat(arcs / np.maximum(count, 1), count)
        return np.cumsum(part) - 0.5 * part, part * np.repeat([1.0, -1.0, 1.0], count) / self.way, part


@lru_cache(maxsize=64)
def fastest_arcs(servo: Servo, lost: float, push: float, most: float, beyond: float) -> CrossingArcs | None:
    """Return the shortest course with an acceleration up to `push` [m/s²]; None where it takes longer than `most` [s].

    It leaves no more than :data:`RESIDUE`, and goes no farther `beyond`.
    """
    shortest = 2.0 * math.sqrt(lost / push)
    step = shortest / (FINER * TRIALS)
    t = step * np.arange(math.ceil((most + SETTLED * response_time(servo)) / step) + 1)
    way = way_of_motor(servo, 0.5 * t * t, step)

    def late(rise: float, fall: float) -> tuple[float, float]:
        """Mean and largest rest behind the crossing, in parts of the backlash; what is missing is positive."""
        arcs = CrossingArcs(rise=rise, fall=fall, last=fall - rise)
        behind = np.linspace(arcs.wait, t[-1], TRIALS)
        turns = ((0.0, 1.0), (arcs.rise, -2.0), (arcs.rise + arcs.fall, 2.0), (arcs.wait, -1.0))
        rest = 1.0 - sum(change * np.interp(behind - at, t, way) for at, change in turns) / arcs.way
        return float(np.mean(rest)), float(np.abs(rest).max())

    least = 1.0 + beyond - math.sqrt(beyond * (1.0 + beyond))
    for half in (0.5 * np.geomspace(shortest, max(most, shortest), 2 * TRIALS)).tolist():
        # Were the rise shorter, the way would take more acceleration, or go farther beyond.
        low, high = max(0.5 * (half + lost / (push * half)), least * half), half
        if late(low, half)[0] > 0.0:
            continue
        for _ in range(HALVINGS):
            middle = 0.5 * (low + high)
            low, high = (low, middle) if late(middle, half)[0] > 0.0 else (middle, high)
        if late(low, half)[1] * lost <= RESIDUE:
            return CrossingArcs(rise=low, fall=half, last=half - low)
    return None


def bent_line(arcs: CrossingArcs, s: Array, motor: Array, lag: float, places: Array, least: float) -> Array:
    """Return where the motor of a crossing in arcs is commanded at its joints.

    Between the tangents, which end at the second and the third of four places, the motor's speed changes as in the arcs
    and for the curve of the path. Joints beside those of the arcs take over what is next to them: the way, the speed
    behind it, and what the lag leaves then are the same.

    Parameters
    ----------
    arcs : CrossingArcs
    s : Array, shape (4,)
        Ends of the tangents along the path [m].
    motor : Array, shape (4,)
        Of the motor there [m].
    lag : float
        [s]
    places : Array, shape (n,)
        Of the joints along the path [m].
    least : float
        Time between joints [s].

    Returns
    -------
    Array, shape (n,)
        [m].
    """
    speed = (s[2] - s[1]) / arcs.wait
    into, across, out = np.diff(motor) / np.diff(s) * speed
    wanted, changes, parts = arcs.joints(least)
    turned = (out - into) * parts / arcs.wait
    turned += changes * ((across - into) * arcs.wait - (turned * (arcs.wait - wanted)).sum())
    times = (places - s[1]) / speed

    def moments(at: Array) -> Array:
        left = arcs.wait - at
        return np.stack([np.ones(at.size), left, np.exp(-left / lag)])

    kept = np.stack([np.interp(wanted, times, one) for one in np.eye(times.size)]) @ turned
    kept += np.linalg.lstsq(moments(times), moments(wanted) @ turned - moments(times) @ kept, rcond=None)[0]
    since = np.maximum(times[:, None] - times, 0.0)
    return np.asarray(motor[1] + into * times + since @ kept)
