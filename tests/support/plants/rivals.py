"""What else an effect could be taken for: each name of the catalogue as a plant with a few free numbers."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tests.support.plants.axis import Hidden, Plant
from tests.support.plants.courses import Pace
from tests.support.plants.responses import Added, Ground
from tests.support.plants.sizes import steady, with_effect

Make = Callable[[Plant, Sequence[float]], Plant]
Columns = Callable[[Ground], list[Added]]


@dataclass(frozen=True)
class Rival:
    """`make` gives a plant for free numbers of about 1, which begin at `start`.

    `columns` are the linear answers to each number; None where only the plant itself can tell.
    """

    name: str
    make: Make
    start: tuple[float, ...]
    columns: Columns | None = None


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


def _linear(
    name: str, leading: str, unit: float, column: Callable[[Ground], Added], lowest: float = -math.inf
) -> Rival:
    def make(plant: Plant, free: Sequence[float]) -> Plant:
        value = max(unit * free[0], lowest)
        return with_effect(plant, name, **{leading: value}) if value else plant

    return Rival(name, make, (1.0,), lambda ground: [column(ground)])


def _frictions(of: Scene) -> Iterator[Rival]:
    size, speed = of.size, of.pace.velocity
    slow = size / speed
    yield _linear("coulomb_friction", "force", size, lambda g: g.pushed(size * g.way), 0.0)

    def fade(plant: Plant, more: float) -> float:
        return max(4e-3, 0.9 * more / plant.c)

    def stribeck(plant: Plant, free: Sequence[float]) -> Plant:
        force, more = (max(value, 0.0) * size for value in free)
        return with_effect(
            plant,
            "stribeck_friction",
            force=force,
            static_force=force + more,
            stribeck_velocity=fade(plant, more),
        )

    def extra(ground: Ground) -> Added:
        ratio = ground.motion.velocity / fade(ground.plant, size)
        return ground.pushed(size * ground.way * np.exp(-ratio * ratio))

    yield Rival("stribeck_friction", stribeck, (1.0, 0.5), lambda g: [g.pushed(size * g.way), extra(g)])
    yield _linear("viscous_friction", "coefficient", slow, lambda g: g.pushed(slow * g.motion.velocity), 0.0)

    def asymmetry(plant: Plant, free: Sequence[float]) -> Plant:
        plus, minus = (max(value * slow, -0.8 * plant.c) for value in free)
        return with_effect(plant, "friction_asymmetry", plus=plus, minus=minus)

    def directions(ground: Ground) -> list[Added]:
        v = slow * ground.motion.velocity
        return [ground.pushed(np.maximum(v, 0.0)), ground.pushed(np.minimum(v, 0.0))]

    yield Rival("friction_asymmetry", asymmetry, (1.0, -1.0), directions)
    yield _linear("load_offset", "force", size, lambda g: g.pushed(np.full(len(g.motion.t), size)))
    for exponent in (0.02, 0.3, 0.7, 1.0, 1.5):
        yield _cutting(size, speed, exponent)


def _cutting(size: float, feed: float, begun: float) -> Rival:
    """The second number is what the exponent changes by, times the first: so both act linearly."""

    def make(plant: Plant, free: Sequence[float]) -> Plant:
        changed = free[1] / free[0] if free[0] else 0.0
        exponent = min(max(begun + changed, 0.02), 2.0)
        return with_effect(plant, "cutting_force", force=size * free[0], feed=feed, exponent=exponent)

    return Rival("cutting_force", make, (1.0, 0.0), lambda ground: ground.cut(size, feed, begun))


def _drives(base: Plant, of: Scene) -> Iterator[Rival]:
    size, pace = of.size, of.pace

    def servo(plant: Plant, free: Sequence[float]) -> Plant:
        b, c = (min(max(1.0 + 0.05 * value, 0.3), 3.0) for value in free)
        return replace(plant, b=plant.b * b, c=plant.c * c)

    def both(ground: Ground) -> list[Added]:
        plant = ground.plant
        inert, viscous = plant.b * ground.acceleration, plant.c * ground.motion.velocity
        return [ground.pushed(0.05 * inert), ground.pushed(0.05 * viscous)]

    yield Rival("servo_mismatch", servo, (1.0, 1.0), both)

    def windup(plant: Plant, free: Sequence[float]) -> Plant:
        if free[0] <= 1e-3:
            return plant
        resonance = math.sqrt(pace.acceleration / (size * free[0]))
        while plant.feedback == "load" and not steady(plant, resonance, 0.1):
            resonance *= 1.1
        return with_effect(plant, "elastic_windup", resonance=resonance, damping_ratio=0.1)

    if base.feedback != "load":
        yield Rival("elastic_windup", windup, (1.0,), lambda g: [g.read(-size / pace.acceleration * g.acceleration)])
    elif base.drive is None and not base.gap and not Forced.of(base):
        yield Rival("elastic_windup", windup, (1.0,))
    yield from _delays(of)

    def saturation(plant: Plant, free: Sequence[float]) -> Plant:
        held = min(max(3.0 * size * free[0], 0.0), 0.6 * of.peak)
        return with_effect(plant, "torque_saturation", limit=of.peak - held)

    yield Rival("torque_saturation", saturation, (1.0,), lambda g: [g.held(max(of.peak - 3.0 * size, 0.4 * of.peak))])


def _delays(of: Scene) -> Iterator[Rival]:
    unit = of.size / of.pace.velocity

    def delay(reading: float) -> Make:
        def make(plant: Plant, free: Sequence[float]) -> Plant:
            return with_effect(plant, "transport_delay", delay=max(free[0], 0.0) * unit, reading=reading)

        return make

    yield Rival("transport_delay", delay(0.0), (1.0,), lambda g: [g.late(unit)])
    if of.reading_seen:
        yield Rival("transport_delay", delay(1.0), (1.0,), lambda g: [g.read(g.late(unit)["act"])])


class Forced:
    """Whether an axis has friction that holds it: two masses are not followed with it."""

    @staticmethod
    def of(plant: Plant) -> bool:
        return any(effect.name in ("coulomb_friction", "stribeck_friction") for effect in plant.effects)


def _gaps(base: Plant, of: Scene) -> Iterator[Rival]:
    inside = base.feedback == "load"
    unit = of.size * (20.0 if inside else 2.0)

    def gap(plant: Plant, free: Sequence[float]) -> Plant:
        return replace(plant, gap=max(plant.gap + unit * free[0], 0.0))

    if not inside or base.effect("elastic_windup") is None:
        yield Rival("backlash", gap, (1.0,), None if inside else lambda g: [g.read(-0.5 * unit * g.way)])
    if base.gap <= 0.0:
        return
    if inside:
        yield Rival("engagement_impact", lambda plant, free: replace(plant, kept=min(max(free[0], 0.0), 1.0)), (0.5,))
    slant, most = unit / of.pace.place, base.gap / of.pace.place

    def position(plant: Plant, free: Sequence[float]) -> Plant:
        slope = min(max(slant * free[0], -most), most)
        return with_effect(plant, "position_dependent_backlash", slope=slope, reference=of.pace.middle)

    def slanted(ground: Ground) -> list[Added]:
        return [ground.read(-0.5 * slant * ground.way * (ground.motion.table - of.pace.middle))]

    if base.effect("position_dependent_backlash") is None:
        yield Rival("position_dependent_backlash", position, (1.0,), None if inside else slanted)


def _readings(of: Scene) -> Iterator[Rival]:
    if not of.reading_seen:
        return
    longer = of.size / of.pace.place
    yield _linear("scale_error", "error", longer, lambda g: g.read(longer * g.motion.table))
    for share in (0.15, 0.4, 1.2):
        yield _thermal(of.size, share * of.duration)
    periods = {2.5e-3, 5e-3, 10e-3, 20e-3}
    if of.truth is not None and of.truth.name in ("cyclic_error", "cogging"):
        periods |= {of.truth["period"]}
    for period in sorted(periods):
        yield _waves("cyclic_error", "amplitude", 1.4 * of.size, period)
    if of.other is not None:
        angle = of.size / of.other.place
        yield _linear("squareness", "angle", angle, lambda g: g.read(angle * np.asarray(g.other)))


def _thermal(size: float, constant: float) -> Rival:
    def make(plant: Plant, free: Sequence[float]) -> Plant:
        return with_effect(plant, "thermal_growth", growth=3.0 * size * free[0], time_constant=constant)

    def column(ground: Ground) -> list[Added]:
        return [ground.read(3.0 * size * -np.expm1(-ground.motion.t / constant))]

    return Rival("thermal_growth", make, (1.0,), column)


def _waves(name: str, leading: str, unit: float, period: float) -> Rival:
    def make(plant: Plant, free: Sequence[float]) -> Plant:
        size, phase = unit * math.hypot(*free), math.atan2(free[1], free[0])
        return with_effect(plant, name, **{leading: size, "period": period, "phase": phase})

    def columns(ground: Ground) -> list[Added]:
        motion = ground.motion
        act = ground.pushed if leading == "force" else ground.read
        turned = 2.0 * np.pi / period * (motion.motor if leading == "force" else motion.table)
        return [act(unit * np.sin(turned)), act(unit * np.cos(turned))]

    return Rival(name, make, (1.0, 1.0), columns)
