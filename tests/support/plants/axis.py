"""One hidden axis: its constants, and the forces that its effects make, in metres of following error."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from tests.support.cascade_plant import Drive
from tests.support.plants.tracks import Track

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Hidden:
    """An effect of an axis: its name and its parameters, SI."""

    name: str
    parameters: Mapping[str, float] = field(default_factory=dict)

    def __getitem__(self, key: str) -> float:
        return self.parameters[key]

    def get(self, key: str, default: float = 0.0) -> float:
        return self.parameters.get(key, default)


@dataclass(frozen=True)
class Plant:
    """Constants of Eqs. (9) and (16), lost motion `gap` [m], servo stiffness K [N/m], and the hidden effects.

    `electronic` [s] is the share of c that the drive makes itself; `kept` the part of the motor's momentum
    that survives a pick-up, 0 for Eq. (14); `flank` the side that the motor touches at first. With a `drive` the
    axis is in a cascade: b is 1 / (ω_v K_v), c is 1 / K_v and its own damping, and its speed is read at `fast_side`.
    """

    feedback: str
    b: float
    c: float
    gap: float = 0.0
    eta: float = 0.5
    beta: float = 1.0
    kept: float = 0.0
    stiffness: float = 1e6
    electronic: float = 0.0
    flank: int = 1
    effects: tuple[Hidden, ...] = ()
    drive: Drive | None = None
    fast_side: str = "motor"

    def effect(self, name: str) -> Hidden | None:
        return next((each for each in self.effects if each.name == name), None)

    def width(self, place: float) -> float:
        """The gap where the table stands."""
        varied = self.effect("position_dependent_backlash")
        if varied is None:
            return self.gap
        off = (place - varied.get("centre")) / varied.get("width", 1.0)
        slope = varied.get("slope") * (place - varied.get("reference"))
        return max(self.gap + slope + varied.get("bump") * math.exp(-0.5 * off * off), 0.0)


class Forces:
    """What acts on an axis, in metres of following error; towards minus where positive.

    `rigid` are smooth forces on the table by time, place and velocity, and `loads` those of them that go by time
    alone, at many times; `cogged` the motor's by its place;
    `dry` is friction in motion by speed, `held` what friction holds at rest; `drag` adds to c by direction.
    `asked` is the command as given, `command` as it arrives.
    """

    def __init__(self, plant: Plant, track: Track, axis: int) -> None:
        self.plant, self.track, self.axis = plant, track, axis
        self.load, self.cubic, self.square = 0.0, 0.0, 0.0
        self.timed: list[tuple[Callable[[float], float], Callable[[Floats], Floats]]] = []
        self.coulomb, self.breakaway, self.fade = 0.0, 0.0, 1.0
        self.drag = (0.0, 0.0)
        self.teeth: list[tuple[float, float, float]] = []
        self.limit = math.inf
        self.late = 0.0
        self.heavier: tuple[float, float] | None = None
        for effect in plant.effects:
            known = getattr(self, "_" + effect.name, None)
            if known is not None:
                known(effect)
        self.asked = track.command(axis)
        late = self.late
        self.command = (lambda t: self.asked(t - late)) if late else self.asked

    def _coulomb_friction(self, of: Hidden) -> None:
        self.coulomb += of["force"]

    def _stribeck_friction(self, of: Hidden) -> None:
        self.coulomb += of["force"]
        self.breakaway, self.fade = of["static_force"] - of["force"], of["stribeck_velocity"]

    def _viscous_friction(self, of: Hidden) -> None:
        self.drag = (self.drag[0] + of["coefficient"], self.drag[1] + of["coefficient"])

    def _friction_asymmetry(self, of: Hidden) -> None:
        self.drag = (self.drag[0] + of["plus"], self.drag[1] + of["minus"])

    def _load_offset(self, of: Hidden) -> None:
        self.load += of["force"]

    def _cutting_force(self, of: Hidden) -> None:
        force, feed, exponent = of["force"], of["feed"], of["exponent"]

        def cut(t: float) -> float:
            speed = self.track.feed(t)
            if speed < 1e-9:
                return 0.0
            return force * (speed / feed) ** exponent * self.track.motion(self.axis, t)[0] / speed

        def cuts(times: Floats) -> Floats:
            own, other = (self.track.rows(axis, times)[1] for axis in (self.axis, 1 - self.axis))
            speed = np.hypot(own, other)
            moves = np.maximum(speed, 1e-9)
            return np.where(speed < 1e-9, 0.0, force * (moves / feed) ** exponent * own / moves)

        self.timed.append((cut, cuts))

    def _cogging(self, of: Hidden) -> None:
        self.teeth.append((of["force"], 2.0 * math.pi / of["period"], of.get("phase")))

    def _torque_saturation(self, of: Hidden) -> None:
        self.limit = min(self.limit, of["limit"])

    def _transport_delay(self, of: Hidden) -> None:
        if not of.get("reading"):
            self.late += of["delay"]

    # What no catalogue knows.

    def _hum(self, of: Hidden) -> None:
        force, rate, phase = of["force"], 2.0 * math.pi * of["frequency"], of.get("phase")
        self.timed.append((lambda t: force * math.sin(rate * t + phase), lambda t: force * np.sin(rate * t + phase)))

    def _stiffening(self, of: Hidden) -> None:
        self.cubic += of["force"] / of["at"] ** 3

    def _air_drag(self, of: Hidden) -> None:
        self.square += of["force"] / of["at"] ** 2

    def _cross_talk(self, of: Hidden) -> None:
        share, other = of["share"] * self.plant.b, 1 - self.axis
        track = self.track
        self.timed.append((lambda t: share * track.motion(other, t)[1], lambda t: share * track.rows(other, t)[2]))

    def _loading(self, of: Hidden) -> None:
        self.heavier = (of["share"], of["over"])

    def rigid(self, t: float, x: float, v: float) -> float:
        total = (self.drag[0] if v > 0.0 else self.drag[1]) * v + self.load
        total += self.cubic * x * x * x + self.square * v * abs(v)
        for force, _ in self.timed:
            total += force(t)
        return total

    def loads(self, times: Floats) -> Floats:
        return sum((forces(times) for _, forces in self.timed), np.full(len(times), self.load))

    def cogged(self, place: float) -> float:
        return sum(force * math.sin(rate * place + phase) for force, rate, phase in self.teeth)

    def dry(self, speed: float) -> float:
        if not self.breakaway:
            return self.coulomb
        ratio = speed / self.fade
        return self.coulomb + self.breakaway * math.exp(-ratio * ratio)

    @property
    def held(self) -> float:
        return self.coulomb + self.breakaway

    def drive(self, error: float) -> float:
        """What the motor gives for a following error."""
        return min(max(error, -self.limit), self.limit)

    def inertia(self, t: float) -> float:
        if self.heavier is None:
            return self.plant.b
        share, over = self.heavier
        return self.plant.b * (1.0 + share * min(max(t / over, 0.0), 1.0))
