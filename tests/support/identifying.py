"""Records of hidden plants whose drive is to be identified, and coast-downs in closed form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ph_post.types import AxisLog, Log
from ph_post.types.diagnosis import Estimate
from tests.support.plants.axis import Plant
from tests.support.plants.loops import PERIOD, follow
from tests.support.plants.tracks import Track

Floats = NDArray[np.float64]


def to_and_fro(rng: np.random.Generator, rounds: int = 3) -> Track:
    """Moves there and back, each of another length, speed and acceleration, between two rests."""
    track = Track().rest(0.25)
    for way in np.geomspace(0.02, 0.002, rounds).tolist():
        speed, gain = float(rng.uniform(0.4, 0.8)) * way**0.5 * 0.5, float(rng.uniform(0.6, 2.0))
        track.move((way, 0.0), speed, gain).move((-way, 0.0), speed, gain)
    return track.rest(0.2)


def one_way() -> Track:
    return Track().rest(0.2).move((0.02, 0.0), 0.05, 1.0).rest(0.2)


@dataclass
class Recorder:
    """Reads the channels of a plant with white noise [m]; efforts in N with as much, times K."""

    channels: tuple[str, ...]
    rng: np.random.Generator
    noise: float = 3e-7
    side: str = "table"

    def record(self, plant: Plant, track: Track) -> Log:
        motion = follow(plant, track)
        return self.log(
            motion.command,
            {"act": motion.table, "motor": motion.motor, "force": motion.drive},
            plant.stiffness,
        )

    def coasting(self, plant: Plant, track: Track, seconds: float, table_too: bool) -> Log:
        """The drive is taken away at the end of the track, in motion: the motor runs out, v = v0 exp(-βt)."""
        motion = follow(plant, track)
        t = np.arange(1, round(seconds / PERIOD) + 1) * PERIOD
        speed = (motion.motor[-1] - motion.motor[-2]) / PERIOD
        way = speed / plant.beta * (1.0 - np.exp(-plant.beta * t))
        later = {"command": 0.0 * t, "motor": way, "act": way if table_too else 0.0 * t}
        before = {"command": motion.command, "motor": motion.motor, "act": motion.table}
        on = {name: np.concatenate([before[name], before[name][-1] + later[name]]) for name in later}
        return self.log(on.pop("command"), on, plant.stiffness)

    def log(self, command: Floats, true: dict[str, Floats], stiffness: float) -> Log:
        def read(name: str) -> Floats | None:
            if name not in self.channels:
                return None
            size = stiffness if name == "force" else 1.0
            return size * (true[name] + self.noise * self.rng.standard_normal(command.size))

        axis = AxisLog(command=command, table=read("act"), motor=read("motor"), effort=read("force"), side=self.side)
        t = np.arange(command.size) * PERIOD
        return Log(name="hidden", t=t, period=PERIOD, axes={"X": axis})


def truth(plant: Plant) -> dict[str, float]:
    """What is to be found, in the units of a machine file."""
    return {
        "b": plant.b,
        "c": plant.c,
        "lost_motion": plant.gap * 1e3,
        "inertia_fraction": plant.eta,
        "motor_time_constant": 1.0 / plant.beta,
        "servo_stiffness": plant.stiffness * 1e-3,
        "lost_motion_times_inertia_fraction": plant.eta * plant.gap * 1e3,
    }


def off(estimate: Estimate, value: float) -> float:
    """By how many standard errors an estimate is off."""
    assert estimate.stderr is not None
    return (estimate.value - value) / estimate.stderr
