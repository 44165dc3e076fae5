"""What sensors show of an axis: effects on the reading, noise and quantisation."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tests.support.plants.axis import Hidden, Plant
from tests.support.plants.loops import Motion, follow
from tests.support.plants.tracks import Track

Floats = NDArray[np.float64]
Readings = dict[str, Floats]
"""By column, "X_act" and so on: metres, and forces over K in metres."""

NAMES = ("X", "Y")


def _late(t: Floats, table: Floats, of: Hidden) -> Floats:
    if not of.get("reading"):
        return table
    from scipy.interpolate import CubicSpline

    return np.asarray(CubicSpline(t, table)(np.maximum(t - of["delay"], 0.0)))


def _stuck(t: Floats, table: Floats, of: Hidden) -> Floats:
    """Now and then the reading stands for a while."""
    shown = table.copy()
    rng = np.random.default_rng(int(of["seed"]))
    for begin in rng.integers(0, len(t) - 100, int(of["times"])).tolist():
        last = begin + max(round(of["duration"] / 1e-3), 1)
        shown[begin:last] = shown[begin]
    return shown


def _wander(t: Floats, table: Floats, of: Hidden) -> Floats:
    steps = np.random.default_rng(int(of["seed"])).standard_normal(len(t))
    return table + of["rate"] * np.cumsum(steps) * np.sqrt(1e-3)


ON_READING: Mapping[str, Callable[[Floats, Floats, Hidden], Floats]] = {
    "cyclic_error": lambda t, x, of: x + of["amplitude"] * np.sin(2.0 * np.pi * x / of["period"] + of.get("phase")),
    "scale_error": lambda t, x, of: x * (1.0 + of["error"]),
    "thermal_growth": lambda t, x, of: x + of["growth"] * (1.0 - np.exp(-t / of["time_constant"])),
    "transport_delay": _late,
    "lost_steps": lambda t, x, of: x + of["jump"] * (t >= of["at"]),
    "sticking_encoder": _stuck,
    "random_walk": _wander,
}
"""What acts on the table's reading alone; squareness is done where both axes are known."""


def outside(effect: Hidden) -> bool:
    """Whether an effect acts outside of the loop, so that the motion does not know it."""
    if effect.name == "transport_delay":
        return bool(effect.get("reading"))
    return effect.name in ON_READING or effect.name == "squareness"


class Observer:
    """Readings of plants without noise; motions that were computed before are not computed again."""

    def __init__(self, track: Track) -> None:
        self.track = track
        self.known: dict[str, Motion] = {}

    def motion(self, plant: Plant, axis: int) -> Motion:
        inner = replace(plant, effects=tuple(e for e in plant.effects if not outside(e)))
        key = f"{axis} {inner!r}"
        if key not in self.known:
            self.known[key] = follow(inner, self.track, axis)
        return self.known[key]

    def __call__(self, plants: Sequence[Plant]) -> Readings:
        motions = [self.motion(plant, axis) for axis, plant in enumerate(plants)]
        shown: Readings = {}
        for axis, (plant, motion) in enumerate(zip(plants, motions, strict=True)):
            table = motion.table
            for effect in plant.effects:
                if effect.name in ON_READING:
                    table = ON_READING[effect.name](motion.t, table, effect)
                if effect.name == "squareness":
                    table = table + effect["angle"] * motions[1 - axis].table
            name = NAMES[axis]
            shown |= {f"{name}_act": table, f"{name}_motor": motion.motor, f"{name}_force": motion.drive}
        return shown

    def command(self, plants: Sequence[Plant]) -> list[Floats]:
        return [self.motion(plant, axis).command for axis, plant in enumerate(plants)]


@dataclass(frozen=True)
class Sensor:
    """Noise and step of a reading [m], and where its zero lies."""

    noise: float
    step: float
    zero: float = 0.0

    @property
    def floor(self) -> float:
        """Root mean square of what it adds."""
        return float(np.sqrt(self.noise**2 + self.step**2 / 12.0))

    def read(self, true: Floats, rng: np.random.Generator) -> Floats:
        return self.step * np.round((true + self.zero + self.noise * rng.standard_normal(len(true))) / self.step)
