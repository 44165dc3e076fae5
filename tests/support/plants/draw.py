"""Cases at random: axes, courses, sensors and effects of a size that shows, the same for the same seed."""

from __future__ import annotations

import math
import zlib
from collections.abc import Sequence
from dataclasses import asdict, replace

import numpy as np

from tests.support.cascade_plant import Drive
from tests.support.plants.axis import Plant
from tests.support.plants.cases import Case, Truth
from tests.support.plants.courses import draw_course, pace
from tests.support.plants.readings import NAMES, Floats, Observer, Readings, Sensor
from tests.support.plants.sizes import DRAWS, LEADING, MISMATCHED, NEEDS_GAP, NEEDS_TWO, Change, Setting

LEAST, MOST = 3.0, 100.0
"""Noise floors that a hidden effect shall add to the recorded channels."""

CHANNEL_SETS: tuple[tuple[str, ...], ...] = (
    ("act",),
    ("act", "motor"),
    ("act", "force"),
    ("act", "motor", "force"),
    ("motor",),
    ("motor", "force"),
    ("unknown",),
)
OFF = (0.0, 0.01, 0.02)
"""By how much the file's b, c and gap are off at most; drawn from these where it is not given."""


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def draw_plant(rng: np.random.Generator, feedback: str, effects: Sequence[str], flank: int) -> Plant:
    """An axis without effects. Weakly damped ones are left out: nobody would run them."""
    while True:
        b, c = _log_uniform(rng, 2e-5, 5e-4), float(rng.uniform(3e-3, 1e-2))
        if c / (2.0 * math.sqrt(b)) >= 0.15:
            break
    gapped = bool(rng.random() < 0.6) or any(name in NEEDS_GAP for name in effects)
    # With a gap both are a matter of convention: where the spring is, and what holds the table in between.
    if "elastic_windup" in effects or ("load_offset" in effects and feedback == "motor"):
        gapped = False
    gap = _log_uniform(rng, 1e-5, 8e-5) if gapped else 0.0
    electronic = float(rng.uniform(0.2, 0.9) * c) if rng.random() < 0.5 else 0.0
    return Plant(
        feedback,
        b,
        c,
        gap=gap,
        eta=float(rng.uniform(0.3, 0.7)),
        beta=float(rng.uniform(0.5, 5.0)),
        stiffness=_log_uniform(rng, 3e5, 3e6),
        flank=flank,
        electronic=0.0 if "torque_saturation" in effects else electronic,
    )


WEIGHTS = (0.0, 0.7, 0.95, 1.0)
"""Speed fed forward, by seed."""


def in_cascade(rng: np.random.Generator, plant: Plant, weight: float) -> Plant:
    """The same axis in a cascade: K_v from 15 to 100 1/s, a velocity loop 4 to 8 times as fast, most with T_n."""
    kv = _log_uniform(rng, 15.0, 100.0)
    wv = kv * float(rng.uniform(4.0, 8.0))
    tn = float(rng.uniform(3.0, 6.0)) / wv if rng.random() < 0.75 else math.inf
    current = float(rng.choice([0.0, 2e-4, 5e-4]))
    drive = Drive(kv=kv, wv=wv, tn=tn, velocity=weight, current=current)
    b = 1.0 / (kv * wv)
    own = plant.eta * plant.beta * b if plant.feedback == "load" else 0.0
    side = str(rng.choice(["motor", "load"])) if plant.feedback == "load" else "motor"
    return replace(plant, b=b, c=1.0 / kv + own, drive=drive, fast_side=side)


def draw_sensor(rng: np.random.Generator, force: bool, shifted: bool) -> Sensor:
    noise = float(rng.uniform(1e-7, 5e-7))
    step = float(rng.choice([5e-8, 1e-7, 2e-7, 5e-7]))
    zero = float(rng.uniform(-2e-5, 2e-5)) if shifted and not force else 0.0
    return Sensor(noise, min(step, 2.0 * noise), zero)


def columns(channels: Sequence[str], axes: Sequence[str]) -> list[str]:
    return [f"{axis}_{'act' if name == 'unknown' else name}" for axis in axes for name in channels]


def shown(observer: Observer, plants: Sequence[Plant], wanted: Sequence[str], at_motor: bool) -> Readings:
    """What the recorded channels show without noise; of unknown side perhaps the motor's."""
    all_of_it = observer(plants)
    return {name: all_of_it[name.replace("_act", "_motor") if at_motor else name] for name in wanted}


def excess(a: Readings, b: Readings, floors: dict[str, float]) -> float:
    """Root mean square of what two records differ by, in noise floors, but for their zeros."""
    total = [np.var((a[name] - b[name]) / floors[name]) for name in a if not name.endswith("_force")]
    total += [np.mean(((a[name] - b[name]) / floors[name]) ** 2) for name in a if name.endswith("_force")]
    return float(np.sqrt(np.mean(total)))


class _Drawing:
    """One case while it is being drawn."""

    def __init__(self, effects: Sequence[str], channels: Sequence[str], feedback: str, seed: int) -> None:
        tag = zlib.crc32("|".join([*effects, "/", *channels, "/", feedback]).encode())
        self.rng = rng = np.random.default_rng([seed, tag])
        self.effects, self.channels = effects, channels
        two = any(name in NEEDS_TWO for name in effects) or bool(rng.random() < 0.25)
        self.track = draw_course(rng, two)
        self.known_flank = bool(rng.random() < 0.5)
        flank = int(rng.choice([-1, 1]))
        count = 2 if two else 1
        loop, _, side = feedback.partition("-")
        own = (side or "motor") if loop == "cascade" else loop
        self.bases = tuple(draw_plant(rng, own, effects, flank) for _ in range(count))
        if loop == "cascade":
            weight = WEIGHTS[seed % len(WEIGHTS)]
            self.bases = tuple(in_cascade(rng, base, weight) for base in self.bases)
        shifted = bool(rng.random() < 0.5)
        self.wanted = columns(channels, NAMES[:count])
        self.sensors = {name: draw_sensor(rng, name.endswith("_force"), shifted) for name in self.wanted}
        self.floors = {name: sensor.floor for name, sensor in self.sensors.items()}
        self.at_motor = channels[0] == "unknown" and self.bases[0].feedback == "motor" and bool(rng.random() < 0.5)
        self.observer = Observer(self.track)

    def hide(self, name: str, axis: int) -> tuple[Change, float, float]:
        """An effect that adds 4 to 80 noise floors, where that can be: its change, size and ratio."""
        paces = [pace(self.track, each) for each in range(len(self.bases))]
        seen = any(channel in ("act", "unknown") for channel in self.channels)
        base = self.bases[axis]
        peak = float(np.max(np.abs(self.observer.motion(base, axis).drive)))
        other = paces[1 - axis if len(paces) > 1 else axis]
        change = DRAWS[name](self.rng, Setting(paces[axis], other, self.track.end, base, seen, peak))
        target = _log_uniform(self.rng, 4.0, 80.0)
        plain = shown(self.observer, self.bases, self.wanted, self.at_motor)
        size = target * float(np.mean(list(self.floors.values())))
        best = (math.inf, size, 0.0)
        for _ in range(4):
            plants = list(self.bases)
            plants[axis] = change(base, size)
            ratio = excess(shown(self.observer, plants, self.wanted, self.at_motor), plain, self.floors)
            off = abs(math.log(max(ratio, 1e-6) / target))
            best = min(best, (off, size, ratio))
            if off < 0.5:
                break
            size *= float(np.clip(target / max(ratio, 1e-6), 0.05, 20.0))
            if size > 3e-4:
                break
        return change, best[1], best[2]


def draw_case(
    effects: Sequence[str], channels: Sequence[str], feedback: str, seed: int, off: float | None = None
) -> Case:
    """A log in which effects are hidden, of a machine whose file knows nothing of them.

    `off` is by how much the file's b, c and gap may be wrong, relative; None: drawn too.
    """
    drawing = _Drawing(effects, channels, feedback, seed)
    rng, bases = drawing.rng, drawing.bases
    plants, truths = list(bases), []
    for name in effects:
        axis = int(rng.integers(len(bases)))
        change, size, ratio = drawing.hide(name, axis)
        plants[axis] = change(plants[axis], size)
        parameter, value = _leading(name, plants[axis], bases[axis])
        truths.append(Truth(name, NAMES[axis], parameter, value, ratio))
    wrong = float(rng.choice(OFF)) if off is None else off
    files = tuple(_file(base, rng, wrong) for base in bases)
    true = shown(drawing.observer, plants, drawing.wanted, drawing.at_motor)
    readings = {name: drawing.sensors[name].read(values, rng) for name, values in true.items()}
    commands = tuple(drawing.observer.command(plants))
    return Case(
        effects=tuple(effects),
        channels=tuple(channels),
        feedback=feedback,
        seed=seed,
        truths=tuple(truths),
        plants=tuple(plants),
        bases=bases,
        files=files,
        known_flank=drawing.known_flank,
        track=drawing.track,
        t=np.arange(len(commands[0])) * 1e-3,
        commands=commands,
        readings=readings,
        floors=drawing.floors,
    )


def _file(base: Plant, rng: np.random.Generator, wrong: float) -> Plant:
    """What the file has of an axis, a little off; what is fed forward is a setting, and known."""
    b, c, gap = (float(1.0 + wrong * rng.uniform(-1.0, 1.0)) for _ in range(3))
    if base.drive is not None:
        drive = replace(base.drive, kv=base.drive.kv / c, wv=base.drive.wv * c / b)
        own = base.c - 1.0 / base.drive.kv
        return replace(base, b=base.b * b, c=1.0 / drive.kv + own * b, gap=base.gap * gap, drive=drive)
    return replace(base, b=base.b * b, c=base.c * c, gap=base.gap * gap)


def _leading(name: str, plant: Plant, base: Plant) -> tuple[str, float]:
    """The leading parameter of an effect and its value, SI; for asymmetry what the directions differ by."""
    if name in ("backlash", "engagement_impact"):
        return LEADING[name], plant.gap if name == "backlash" else plant.kept
    if name == "servo_mismatch":
        return _mismatched(plant, base)
    hidden = plant.effect(name)
    if hidden is None or name not in LEADING:
        return "", 0.0
    if name == "command_filter":
        return next(iter(hidden.parameters.items()))
    if name == "friction_asymmetry":
        return LEADING[name], hidden["plus"] - hidden["minus"]
    return LEADING[name], hidden[LEADING[name]]


def _mismatched(plant: Plant, base: Plant) -> tuple[str, float]:
    """The number of a servo that is not as it was."""
    if plant.drive is None or base.drive is None:
        which = "b" if plant.b != base.b else "c"
        return which, getattr(plant, which)
    was, now = asdict(base.drive), asdict(plant.drive)
    which = next(key for key in MISMATCHED if now[key] != was[key])
    return MISMATCHED[which], now[which]


def whiten(case: Case, readings: Readings) -> Floats:
    """Recorded channels one after the other, in noise floors."""
    return np.concatenate([readings[name] / case.floors[name] for name in case.floors])
