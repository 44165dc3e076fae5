"""Hidden effects of any size: each takes a plant and a size, about 1 per metre that the residual grows by."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from tests.support.plants.axis import Hidden, Plant
from tests.support.plants.courses import Pace

Change = Callable[[Plant, float], Plant]


@dataclass(frozen=True)
class Setting:
    """What an effect is drawn for; `peak` [m] is the largest force of the motor without it."""

    pace: Pace
    other: Pace
    duration: float
    plant: Plant
    table_seen: bool
    peak: float


Draw = Callable[[np.random.Generator, Setting], Change]

LEADING: Mapping[str, str] = {
    "backlash": "gap",
    "coulomb_friction": "force",
    "stribeck_friction": "force",
    "viscous_friction": "coefficient",
    "friction_asymmetry": "difference",
    "load_offset": "force",
    "elastic_windup": "resonance",
    "engagement_impact": "kept",
    "position_dependent_backlash": "slope",
    "cyclic_error": "amplitude",
    "scale_error": "error",
    "thermal_growth": "growth",
    "squareness": "angle",
    "servo_mismatch": "b or c",
    "transport_delay": "delay",
    "torque_saturation": "limit",
    "cogging": "force",
    "cutting_force": "force",
    "command_filter": "length",
}
MISMATCHED = {"velocity": "velocity_feedforward", "kv": "position_gain", "wv": "velocity_gain"}
"""Numbers of a cascade that may be off, by what a diagnosis calls them."""

OUTSIDE = (
    "hum",
    "stiffening",
    "air_drag",
    "cross_talk",
    "loading",
    "lost_steps",
    "sticking_encoder",
    "random_walk",
)
NEEDS_TWO = ("squareness", "cross_talk", "cutting_force")
NEEDS_GAP = ("engagement_impact", "position_dependent_backlash")
NEEDS_TABLE = ("cyclic_error", "scale_error", "thermal_growth", "squareness", *OUTSIDE[5:])


LENGTHS = (math.log(1e-3), math.log(20e-3))
"""Logarithms of the shortest and the longest command filter [s]."""


def with_effect(plant: Plant, name: str, **parameters: float) -> Plant:
    return replace(plant, effects=(*plant.effects, Hidden(name, parameters)))


def _sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def _simple(name: str, leading: str, unit: Callable[[Setting], float], signed: bool = False) -> Draw:
    def draw(rng: np.random.Generator, of: Setting) -> Change:
        share = unit(of) * (_sign(rng) if signed else 1.0)
        return lambda plant, size: with_effect(plant, name, **{leading: share * size})

    return draw


def _stribeck(rng: np.random.Generator, of: Setting) -> Change:
    more, fade = float(rng.uniform(1.5, 2.5)), float(rng.uniform(2e-3, 8e-3))

    def change(plant: Plant, size: float) -> Plant:
        # Steeper than this the table would hop at slow feeds.
        slow = max(fade, 0.9 * (more - 1.0) * size / plant.c)
        return with_effect(plant, "stribeck_friction", force=size, static_force=more * size, stribeck_velocity=slow)

    return change


def _asymmetry(rng: np.random.Generator, of: Setting) -> Change:
    share, split, unit = _sign(rng), float(rng.uniform(0.0, 1.0)), 2.0 / of.pace.velocity

    def change(plant: Plant, size: float) -> Plant:
        whole = share * unit * size
        plus, minus = split * whole, (split - 1.0) * whole
        lowest = -0.7 * plant.c
        return with_effect(plant, "friction_asymmetry", plus=max(plus, lowest), minus=max(minus, lowest))

    return change


def _viscous(rng: np.random.Generator, of: Setting) -> Change:
    def change(plant: Plant, size: float) -> Plant:
        return with_effect(plant, "viscous_friction", coefficient=max(size / of.pace.velocity, 0.08 * plant.c))

    return change


def _gain_off(rng: np.random.Generator, of: Setting) -> Change:
    """Of a cascade: what is fed forward, K_v, or ω_v; a gain only where it shows in what is left to the loop."""
    drive = of.plant.drive
    assert drive is not None
    which, way = str(rng.choice(["velocity", "kv", "wv"])), _sign(rng)

    def change(plant: Plant, size: float) -> Plant:
        share = {
            "velocity": drive.kv * size / of.pace.velocity,
            "kv": drive.kv * size / of.pace.velocity / max(1.0 - drive.velocity, 0.1),
            "wv": drive.kv * drive.wv * size / of.pace.acceleration,
        }[which]
        if which == "velocity":
            off = float(np.clip(share, 0.03, 0.45))
            up = way > 0.0 and drive.velocity + off <= 1.0
            there = drive.velocity + off if up or drive.velocity < off else drive.velocity - off
            return replace(plant, drive=replace(drive, velocity=there))
        times = 1.0 + way * float(np.clip(share, 0.08, 0.45))
        # What brakes the axis itself stays the same force: in following errors it is less as K is more.
        own = (plant.c - 1.0 / drive.kv) / times
        quicker = replace(drive, **{which: getattr(drive, which) * times})
        return replace(plant, b=plant.b / times, c=own + 1.0 / quicker.kv, drive=quicker)

    return change


def _command_filter(rng: np.random.Generator, of: Setting) -> Change:
    """As long as filters of drives are, 1 to 20 ms, however much that shows."""
    name, length = str(rng.choice(["moving_average", "exponential_filter"])), float(np.exp(rng.uniform(*LENGTHS)))
    return lambda plant, size: with_effect(plant, "command_filter", **{name: length})


def _mismatch(rng: np.random.Generator, of: Setting) -> Change:
    if of.plant.drive is not None:
        return _gain_off(rng, of)
    which, way = str(rng.choice(["b", "c"])), _sign(rng)
    unit = of.pace.acceleration if which == "b" else of.pace.velocity

    def change(plant: Plant, size: float) -> Plant:
        share = float(np.clip(size / unit / getattr(plant, which), 0.08, 0.45))
        return replace(plant, **{which: getattr(plant, which) * (1.0 + way * share)})

    return change


def _backlash(rng: np.random.Generator, of: Setting) -> Change:
    """More than the file says, or less where there is enough of it."""
    way = _sign(rng)

    def change(plant: Plant, size: float) -> Plant:
        # Less than a tenth would be what nobody measures more closely than that.
        by = max(2.0 * size if plant.feedback != "load" else 20.0 * size, 0.1 * plant.gap)
        lower = way < 0.0 and plant.gap > 1.2 * by
        return replace(plant, gap=plant.gap - by if lower else plant.gap + by)

    return change


def _windup(rng: np.random.Generator, of: Setting) -> Change:
    damping = float(rng.uniform(0.05, 0.25))

    def change(plant: Plant, size: float) -> Plant:
        resonance = math.sqrt(of.pace.acceleration / size)
        if plant.feedback == "load":
            while not steady(plant, resonance, damping):
                resonance *= 1.1
        return with_effect(plant, "elastic_windup", resonance=resonance, damping_ratio=damping)

    return change


def steady(plant: Plant, resonance: float, damping: float) -> bool:
    """Whether two masses in a loop over the table come to rest: the roots of their polynomial."""
    light, heavy = plant.eta * plant.b, (1.0 - plant.eta) * plant.b
    own, other = light * plant.beta, plant.c - light * plant.beta
    link = np.array([2.0 * damping * resonance * heavy, heavy * resonance**2])
    motor = np.polyadd([light, own, 0.0], link)
    table = np.polyadd([heavy, other, 0.0], link)
    whole = np.polyadd(np.polysub(np.polymul(motor, table), np.polymul(link, link)), link)
    return bool(np.max(np.roots(whole).real) < -4.0)


def _impact(rng: np.random.Generator, of: Setting) -> Change:
    kept = float(rng.uniform(0.4, 1.0))
    return lambda plant, size: replace(plant, kept=kept)


def _position(rng: np.random.Generator, of: Setting) -> Change:
    way = _sign(rng)
    unit = 2.0 if of.plant.feedback != "load" else 20.0

    def change(plant: Plant, size: float) -> Plant:
        slope = min(unit * size / of.pace.place, plant.gap / (3.0 * of.pace.place))
        return with_effect(plant, "position_dependent_backlash", slope=way * slope, reference=round(of.pace.middle, 4))

    return change


def _cyclic(rng: np.random.Generator, of: Setting) -> Change:
    period = float(rng.choice([1e-3, 2e-3, 2.5e-3, 4e-3, 5e-3, 6e-3, 10e-3]))
    phase = float(rng.uniform(-math.pi, math.pi))
    return lambda plant, size: with_effect(plant, "cyclic_error", amplitude=1.4 * size, period=period, phase=phase)


def _cogging(rng: np.random.Generator, of: Setting) -> Change:
    period, phase = (
        float(rng.choice([5e-4, 1e-3, 1.25e-3, 2e-3, 2.5e-3])),
        float(rng.uniform(-math.pi, math.pi)),
    )
    return lambda plant, size: with_effect(plant, "cogging", force=1.8 * size, period=period, phase=phase)


def _thermal(rng: np.random.Generator, of: Setting) -> Change:
    way, constant = _sign(rng), float(rng.uniform(0.15, 1.2)) * of.duration
    share = 1.5 / (1.0 - math.exp(-of.duration / constant))
    return lambda plant, size: with_effect(plant, "thermal_growth", growth=way * share * size, time_constant=constant)


def _delay(rng: np.random.Generator, of: Setting) -> Change:
    reading = float(of.table_seen and rng.random() < 0.5)
    return lambda plant, size: with_effect(plant, "transport_delay", delay=size / of.pace.velocity, reading=reading)


def _saturation(rng: np.random.Generator, of: Setting) -> Change:
    """A limit that the largest following error of the course passes by some per cent."""
    return lambda plant, size: with_effect(
        plant, "torque_saturation", limit=of.peak - min(max(3.0 * size, 5e-7), 0.5 * of.peak)
    )


def _cutting(rng: np.random.Generator, of: Setting) -> Change:
    exponent, feed, way = (
        float(rng.uniform(0.5, 1.0)),
        1000.0 / 60e3,
        _sign(rng) if rng.random() < 0.3 else 1.0,
    )
    share = way * (feed / of.pace.velocity) ** exponent
    return lambda plant, size: with_effect(plant, "cutting_force", force=share * size, feed=feed, exponent=exponent)


def _hum(rng: np.random.Generator, of: Setting) -> Change:
    frequency, phase = float(rng.uniform(3.0, 40.0)), float(rng.uniform(-math.pi, math.pi))
    return lambda plant, size: with_effect(plant, "hum", force=1.4 * size, frequency=frequency, phase=phase)


def _seeded(name: str, leading: str, unit: float, **more: float) -> Draw:
    def draw(rng: np.random.Generator, of: Setting) -> Change:
        seed = float(rng.integers(1 << 30))
        return lambda plant, size: with_effect(plant, name, seed=seed, **{leading: unit * size}, **more)

    return draw


def _sticking(rng: np.random.Generator, of: Setting) -> Change:
    seed = float(rng.integers(1 << 30))

    def change(plant: Plant, size: float) -> Plant:
        duration = min(max((size / of.pace.velocity) * 4.0, 2e-3), 0.03)
        return with_effect(plant, "sticking_encoder", seed=seed, times=60.0, duration=duration)

    return change


def _jump(rng: np.random.Generator, of: Setting) -> Change:
    way, at = _sign(rng), float(rng.uniform(0.3, 0.7)) * of.duration
    return lambda plant, size: with_effect(plant, "lost_steps", jump=2.0 * way * size, at=at)


DRAWS: Mapping[str, Draw] = {
    "backlash": _backlash,
    "coulomb_friction": _simple("coulomb_friction", "force", lambda of: 1.0),
    "stribeck_friction": _stribeck,
    "viscous_friction": _viscous,
    "friction_asymmetry": _asymmetry,
    "load_offset": _simple("load_offset", "force", lambda of: 1.0, signed=True),
    "elastic_windup": _windup,
    "engagement_impact": _impact,
    "position_dependent_backlash": _position,
    "cyclic_error": _cyclic,
    "scale_error": _simple("scale_error", "error", lambda of: 1.0 / of.pace.place, signed=True),
    "thermal_growth": _thermal,
    "squareness": _simple("squareness", "angle", lambda of: 1.0 / of.other.place, signed=True),
    "servo_mismatch": _mismatch,
    "transport_delay": _delay,
    "torque_saturation": _saturation,
    "cogging": _cogging,
    "cutting_force": _cutting,
    "command_filter": _command_filter,
    "hum": _hum,
    "stiffening": lambda rng, of: (
        lambda plant, size: with_effect(plant, "stiffening", force=2.0 * size, at=1.5 * of.pace.place)
    ),
    "air_drag": lambda rng, of: (
        lambda plant, size: with_effect(plant, "air_drag", force=size, at=1.5 * of.pace.velocity)
    ),
    "cross_talk": lambda rng, of: (
        lambda plant, size: with_effect(plant, "cross_talk", share=size / (plant.b * of.other.acceleration))
    ),
    "loading": lambda rng, of: (
        lambda plant, size: with_effect(
            plant, "loading", share=2.0 * size / (plant.b * of.pace.acceleration), over=of.duration
        )
    ),
    "lost_steps": _jump,
    "sticking_encoder": _sticking,
    "random_walk": _seeded("random_walk", "rate", 0.5),
}
"""By name; the last eight are in no catalogue."""
