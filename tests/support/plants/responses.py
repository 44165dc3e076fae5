"""What a small force or a small error of the reading adds to the channels: a loop's linear answer.

An estimate, by which the plants themselves are tried where it says that this is worth the while.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import cont2discrete, lfilter

from tests.support.plants.axis import Plant
from tests.support.plants.loops import PERIOD, Motion
from tests.support.plants.stepping import Floats
from tests.support.plants.tracks import Track

Added = dict[str, Floats]
"""By channel, "act", "motor" and "force": what is added to it [m]."""

STANDING = 2e-5
"""[m/s] Slower than this an axis stands, and friction keeps the direction in which it came."""


@dataclass(frozen=True)
class Ground:
    """An axis as it moves without the effect, and the table of the other axis where there is one."""

    plant: Plant
    motion: Motion
    track: Track
    axis: int
    other: Floats | None

    @property
    def way(self) -> Floats:
        """Direction of motion, 1 or -1, kept while the axis stands."""
        moving = np.where(np.abs(self.motion.velocity) > STANDING, np.sign(self.motion.velocity), 0.0)
        last = np.maximum.accumulate(np.where(moving != 0.0, np.arange(len(moving)), 0))
        return np.asarray(moving[last])

    @property
    def acceleration(self) -> Floats:
        return np.asarray(np.gradient(self.motion.velocity, PERIOD))

    def pushed(self, force: Floats) -> Added:
        """A force towards minus: b δ̈ + c δ̇ + δ = -force."""
        system = ([1.0], [self.plant.b, self.plant.c, 1.0])
        numerator, denominator, _ = cont2discrete(system, PERIOD, "foh")
        moved = -np.asarray(lfilter(np.ravel(numerator), denominator, force))
        drive = -moved - self.plant.electronic * np.gradient(moved, PERIOD)
        return {"act": moved, "motor": moved, "force": drive}

    def read(self, error: Floats) -> Added:
        """An error of the table's reading alone."""
        none = np.zeros_like(error)
        return {"act": error, "motor": none, "force": none}

    def late(self, time: float) -> Added:
        """Everything later by a time."""
        motion = self.motion
        return {
            name: -time * np.gradient(values, PERIOD)
            for name, values in (("act", motion.table), ("motor", motion.motor), ("force", motion.drive))
        }

    def held(self, limit: float) -> Added:
        """The motor gives no more than a limit."""
        over = self.motion.drive - np.clip(self.motion.drive, -limit, limit)
        answer = self.pushed(over)
        return answer | {"force": answer["force"] - over}

    def cut(self, force: float, feed: float, exponent: float) -> list[Added]:
        """A force along the path by feed, and how it changes with the exponent."""
        speeds = np.array([self.track.feed(t) for t in self.motion.t.tolist()])
        along = np.array([self.track.motion(self.axis, t)[0] for t in self.motion.t.tolist()])
        share = np.maximum(speeds, 1e-9) / feed
        push = force * share**exponent * along / np.maximum(speeds, 1e-9)
        return [self.pushed(push), self.pushed(push * np.log(share))]
