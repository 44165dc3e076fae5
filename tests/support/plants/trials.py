"""Which cases are tried, and where they are kept once they were drawn."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from tests.support.plants.cases import Case, load, save
from tests.support.plants.draw import CHANNEL_SETS, draw_case
from tests.support.plants.sizes import LEADING, NEEDS_TABLE, OUTSIDE

Kind = Literal["nothing", "single", "pair", "outside"]

SINGLE_LOOPS = ("motor", "load")
CASCADES = ("cascade", "cascade-load")
LOOPS = (*SINGLE_LOOPS, *CASCADES)
PAIRS: tuple[tuple[str, str], ...] = (
    ("coulomb_friction", "load_offset"),
    ("coulomb_friction", "backlash"),
    ("coulomb_friction", "cyclic_error"),
    ("coulomb_friction", "scale_error"),
    ("coulomb_friction", "thermal_growth"),
    ("coulomb_friction", "cogging"),
    ("backlash", "cyclic_error"),
    ("backlash", "scale_error"),
    ("backlash", "squareness"),
    ("stribeck_friction", "scale_error"),
    ("friction_asymmetry", "coulomb_friction"),
    ("backlash", "thermal_growth"),
    ("cyclic_error", "scale_error"),
    ("cyclic_error", "thermal_growth"),
    ("squareness", "scale_error"),
    ("transport_delay", "coulomb_friction"),
    ("cogging", "scale_error"),
    ("load_offset", "cyclic_error"),
    ("servo_mismatch", "coulomb_friction"),
    ("servo_mismatch", "scale_error"),
    ("coulomb_friction", "squareness"),
)
PAIR_CHANNELS = (("act", "motor", "force"), ("act", "motor"), ("act", "force"))


@dataclass(frozen=True)
class Trial:
    """A case to be drawn: what is hidden, what is recorded, the loop and the seed."""

    kind: Kind
    effects: tuple[str, ...]
    channels: tuple[str, ...]
    feedback: str
    seed: int

    @property
    def key(self) -> str:
        effects, channels = "+".join(self.effects) or "nothing", "+".join(self.channels)
        return f"{self.kind}.{effects}.{channels}.{self.feedback}.{self.seed}"

    def case(self, folder: Path | None) -> Case:
        """The case, from the folder where it is there, else drawn and put there."""
        path = None if folder is None else folder / f"{self.key}.npz"
        if path is not None and path.exists():
            return load(path)
        case = draw_case(self.effects, self.channels, self.feedback, self.seed)
        if path is not None:
            path.parent.mkdir(parents=True, exist_ok=True)
            save(case, path)
        return case


def shows(name: str, channels: Sequence[str], feedback: str) -> bool:
    """Whether an effect is there at all with that loop and can reach one of those channels."""
    loop, _, side = feedback.partition("-")
    inside = "load" in (loop, side)
    bars = {
        "engagement_impact": not inside,
        "command_filter": loop != "cascade",
        # Two masses in a cascade are not stepped here.
        "elastic_windup": loop == "cascade" and inside,
    }
    if bars.get(name):
        return False
    # A constant force moves the positions of a P loop by a constant, which an origin does too.
    if name == "load_offset" and "force" not in channels:
        return False
    if channels[0] in ("act", "unknown"):
        return True
    if name in NEEDS_TABLE:
        return False
    # What hangs behind the motor is not seen by it, where the loop is closed over it.
    return inside or name not in ("backlash", "elastic_windup", "position_dependent_backlash")


def singles(
    seeds: int,
    effects: Sequence[str] = tuple(LEADING),
    channel_sets: Sequence[tuple[str, ...]] = CHANNEL_SETS,
    loops: Sequence[str] = LOOPS,
    first: int = 0,
) -> Iterator[Trial]:
    """One hidden effect, seed by seed, so that the first part of the list is a small matrix already."""
    every = range(first, first + seeds)
    for seed, channels, name, feedback in itertools.product(every, channel_sets, effects, loops):
        if shows(name, channels, feedback):
            yield Trial("single", (name,), channels, feedback, seed)


def nothings(count: int, loops: Sequence[str] = SINGLE_LOOPS, first: int = 0) -> Iterator[Trial]:
    for seed in range(first, first + count):
        yield Trial("nothing", (), CHANNEL_SETS[seed % len(CHANNEL_SETS)], loops[seed // 7 % len(loops)], seed)


def outsiders(count: int, loops: Sequence[str] = SINGLE_LOOPS, first: int = 0) -> Iterator[Trial]:
    """An effect that no catalogue knows."""
    channel_sets = (("act",), ("act", "motor"), ("act", "force"), ("act", "motor", "force"))
    for seed in range(first, first + count):
        name, channels = OUTSIDE[seed % len(OUTSIDE)], channel_sets[seed // 8 % 4]
        yield Trial("outside", (name,), channels, loops[(seed + seed // 8) % len(loops)], seed)


def pairs(count: int, loops: Sequence[str] = SINGLE_LOOPS, first: int = 0) -> Iterator[Trial]:
    for seed in range(first, first + count):
        effects = PAIRS[seed % len(PAIRS)]
        yield Trial("pair", effects, PAIR_CHANNELS[seed % 3], loops[seed // 3 % len(loops)], seed)
