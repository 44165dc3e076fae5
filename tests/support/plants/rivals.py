"""What else an effect could be taken for: each name of the catalogue as a plant with a few free numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

from tests.support.plants.axis import Hidden, Plant
from tests.support.plants.courses import Pace
from tests.support.plants.sizes import steady, with_effect

Make = Callable[[Plant, Sequence[float]], Plant]


@dataclass(frozen=True)
class Rival:
    """`make` gives a plant for free numbers of about 1, which begin at `start`."""

    name: str
    make: Make
    start: tuple[float, ...]


@dataclass(frozen=True)
class Scene:
    """What rivals are sized by: `size` [m] of the signature, the paces of both axes, and so on."""

    size: float
    pace: Pace
    other: Pace | None
    duration: float
    peak: float
    reading_seen: bool
    truth: Hidden | None


def rivals(base: Plant, of: Scene) -> Iterator[Rival]:
    """Every name that an axis could show, with one or several ways to begin."""
    yield from _frictions(of)
    yield from _drives(base, of)
    yield from _gaps(base, of)
    yield from _readings(of)
    if of.truth is not None and of.truth.name in ("cyclic_error", "cogging"):
        yield _waves("cogging", "force", 1.8 * of.size, of.truth["period"])


def _linear(name: str, leading: str, unit: float, lowest: float = -math.inf) -> Rival:
    def make(plant: Plant, free: Sequence[float]) -> Plant:
        value = max(unit * free[0], lowest) if unit > 0.0 else unit * free[0]
        return with_effect(plant, name, **{leading: value}) if value else plant

    return Rival(name, make, (1.0,))


def _frictions(of: Scene) -> Iterator[Rival]:
    size, speed = of.size, of.pace.velocity
    yield _linear("coulomb_friction", "force", size, 0.0)

    def stribeck(plant: Plant, free: Sequence[float]) -> Plant:
        force, more = (max(value, 0.0) * size for value in free)
        fade = max(4e-3, 0.9 * more / plant.c)
        return with_effect(
            plant, "stribeck_friction", force=force, static_force=force + more, stribeck_velocity=fade
        )

    yield Rival("stribeck_friction", stribeck, (1.0, 0.5))
    yield _linear("viscous_friction", "coefficient", size / speed, 0.0)

    def asymmetry(plant: Plant, free: Sequence[float]) -> Plant:
        plus, minus = (max(value * size / speed, -0.8 * plant.c) for value in free)
        return with_effect(plant, "friction_asymmetry", plus=plus, minus=minus)

    yield Rival("friction_asymmetry", asymmetry, (1.0, -1.0))
    yield _linear("load_offset", "force", size)

    def cutting(plant: Plant, free: Sequence[float]) -> Plant:
        exponent = min(max(free[1], 0.02), 2.0)
        return with_effect(plant, "cutting_force", force=size * free[0], feed=speed, exponent=exponent)

    yield Rival("cutting_force", cutting, (1.0, 0.15))
    yield Rival("cutting_force", cutting, (1.0, 1.0))


def _drives(base: Plant, of: Scene) -> Iterator[Rival]:
    size, pace = of.size, of.pace

    def servo(plant: Plant, free: Sequence[float]) -> Plant:
        b, c = (min(max(1.0 + 0.05 * value, 0.3), 3.0) for value in free)
        return replace(plant, b=plant.b * b, c=plant.c * c)

    yield Rival("servo_mismatch", servo, (1.0, 1.0))

    def windup(plant: Plant, free: Sequence[float]) -> Plant:
        if free[0] <= 1e-3:
            return plant
        resonance = math.sqrt(pace.acceleration / (size * free[0]))
        while plant.feedback == "load" and not steady(plant, resonance, 0.1):
            resonance *= 1.1
        return with_effect(plant, "elastic_windup", resonance=resonance, damping_ratio=0.1)

    if base.feedback != "load" or not (base.gap or Forced.of(base)):
        yield Rival("elastic_windup", windup, (1.0,))

    def delay(reading: float) -> Make:
        def make(plant: Plant, free: Sequence[float]) -> Plant:
            late = max(free[0], 0.0) * size / pace.velocity
            return with_effect(plant, "transport_delay", delay=late, reading=reading)

        return make

    yield Rival("transport_delay", delay(0.0), (1.0,))
    if of.reading_seen:
        yield Rival("transport_delay", delay(1.0), (1.0,))

    def saturation(plant: Plant, free: Sequence[float]) -> Plant:
        held = min(max(3.0 * size * free[0], 0.0), 0.6 * of.peak)
        return with_effect(plant, "torque_saturation", limit=of.peak - held)

    yield Rival("torque_saturation", saturation, (1.0,))


class Forced:
    """Whether an axis has friction that holds it: two masses are not followed with it."""

    @staticmethod
    def of(plant: Plant) -> bool:
        return any(effect.name in ("coulomb_friction", "stribeck_friction") for effect in plant.effects)


def _gaps(base: Plant, of: Scene) -> Iterator[Rival]:
    unit = of.size * (2.0 if base.feedback != "load" else 20.0)
    windup = base.feedback == "load" and base.effect("elastic_windup") is not None
    if not windup:
        yield Rival(
            "backlash", lambda plant, free: replace(plant, gap=max(plant.gap + unit * free[0], 0.0)), (1.0,)
        )
    if base.gap <= 0.0:
        return
    if base.feedback == "load":
        yield Rival(
            "engagement_impact", lambda plant, free: replace(plant, kept=min(max(free[0], 0.0), 1.0)), (0.5,)
        )
    most = base.gap / of.pace.place

    def position(plant: Plant, free: Sequence[float]) -> Plant:
        slope = min(max(unit / of.pace.place * free[0], -most), most)
        return with_effect(plant, "position_dependent_backlash", slope=slope, reference=of.pace.middle)

    if base.effect("position_dependent_backlash") is None:
        yield Rival("position_dependent_backlash", position, (1.0,))


def _readings(of: Scene) -> Iterator[Rival]:
    if not of.reading_seen:
        return
    yield _linear("scale_error", "error", of.size / of.pace.place)
    for share in (0.15, 0.4, 1.2):
        yield _thermal(of.size, share * of.duration)
    periods = {2.5e-3, 5e-3, 10e-3, 20e-3}
    if of.truth is not None and of.truth.name in ("cyclic_error", "cogging"):
        periods |= {of.truth["period"]}
    for period in sorted(periods):
        yield _waves("cyclic_error", "amplitude", 1.4 * of.size, period)
    if of.other is not None:
        yield _linear("squareness", "angle", of.size / of.other.place)


def _thermal(size: float, constant: float) -> Rival:
    def make(plant: Plant, free: Sequence[float]) -> Plant:
        return with_effect(plant, "thermal_growth", growth=3.0 * size * free[0], time_constant=constant)

    return Rival("thermal_growth", make, (1.0,))


def _waves(name: str, leading: str, unit: float, period: float) -> Rival:
    def make(plant: Plant, free: Sequence[float]) -> Plant:
        size, phase = unit * math.hypot(*free), math.atan2(free[1], free[0])
        return with_effect(plant, name, **{leading: size, "period": period, "phase": phase})

    return Rival(name, make, (1.0, 1.0))
