"""What the reference simulation knows of a drive, of its command and of events."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

TINY = 1e-15
"""[m, m/s, m of error] by which an event function begins off zero where a mode begins on it; rounding of
places of 0.25 m is some 1e-16."""

JUMP = 1e-12
"""[m] of error by which a jump of the output counts as one."""


class Engaged(IntEnum):
    """Flank that the motor touches."""

    PLUS = 1
    NONE = 0
    MINUS = -1


class Ramp(NamedTuple):
    """A straight piece of the command from t on: value [m] there, and slope [m/s]."""

    t: float
    value: float
    slope: float

    def at(self, t: float) -> float:
        return self.value + self.slope * (t - self.t)


@dataclass(frozen=True, kw_only=True)
class Drive:
    """One axis: constants of Eq. (9), η, β = 1/τ, lost motion [m], and effects in metres of following error.

    `rule` is "standstill", "momentum", "contact", or "once": the paper's own simulation, where the gap is
    opened by hand at the time `opening` [s], the motor leaves to whichever side it is driven, and nothing
    opens later. `coulomb` and `viscous` hold the values for moving up and down; `static` is what friction has
    more at rest. `load` acts towards minus. `kept` is the part of the motor's momentum relative to the table
    that a plastic pick-up keeps. `waves` (amplitude, period, phase) resist the motor by its place; `wider` is
    what the gap has at a place of the table beyond `gap`.
    """

    b: float
    c: float
    gap: float
    feedback: str = "load"
    rule: str = "standstill"
    eta: float = 0.5
    beta: float = 0.0
    ki: float = 0.0
    kd: float = 0.0
    opening: float = math.inf
    kept: float = 1.0
    coulomb: tuple[float, float] = (0.0, 0.0)
    static: float = 0.0
    stribeck_speed: float = 0.0
    viscous: tuple[float, float] = (0.0, 0.0)
    load: float = 0.0
    saturation: float = math.inf
    delay: float = 0.0
    waves: tuple[tuple[float, float, float], ...] = ()
    wider: Callable[[float], float] | None = None

    @classmethod
    def from_constants(
        cls, b: float, c: float, N: float, r: float, eta: float, tau: float, motor_gap: float, **more: Any
    ) -> Drive:
        """From the paper's constants; `motor_gap` [rad] is Δθ_m."""
        return cls(b=b, c=c, gap=motor_gap * r / N, eta=eta, beta=1.0 / tau, **more)

    def half(self, x: float) -> float:
        """Half the gap with the table at x."""
        return 0.5 * max(self.gap + (self.wider(x) if self.wider else 0.0), 0.0)

    def cogging(self, m: float) -> float:
        """What resists the motor at m."""
        return sum(size * math.sin(math.tau * m / period + phase) for size, period, phase in self.waves)

    def friction(self, way: int, v: float) -> float:
        """Dry friction while moving in the direction `way`."""
        dry = self.coulomb[0 if way > 0 else 1]
        extra = self.static * math.exp(-((v / self.stribeck_speed) ** 2)) if self.stribeck_speed else 0.0
        return dry + extra

    def held(self, way: int) -> float:
        """What pushes the table at rest into the direction `way`, at most without moving it."""
        return self.coulomb[0 if way > 0 else 1] + self.static

    def resistance(self, way: int, v: float) -> float:
        """What resists beyond c v: g."""
        return self.load + way * self.friction(way, v) + self.viscous[0 if way > 0 else 1] * v


class Mode(NamedTuple):
    """The event functions of a mode, each with what to do when it strikes."""

    functions: list[Callable[[float, NDArray[np.float64]], float]]
    actions: list[tuple[str, int]]


def watch(function: Callable[[float, NDArray[np.float64]], float], direction: int) -> Any:
    """Make an event of scipy's of a function that passes zero upwards (1) or downwards (-1)."""

    def event(t: float, y: NDArray[np.float64]) -> float:
        return function(t, y)

    event.terminal, event.direction = True, direction  # type: ignore[attr-defined]
    return event
