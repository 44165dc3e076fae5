"""A case: a log and a machine file as a person would hand them in, and apart from them what is true."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path

import numpy as np

from tests.support.cascade_plant import Drive
from tests.support.plants.axis import Hidden, Plant
from tests.support.plants.readings import NAMES, Floats, Readings
from tests.support.plants.tracks import Mirrored, Stretch, Track

MM = 1e3


@dataclass(frozen=True)
class Truth:
    """A hidden effect: its leading parameter in SI units, forces as F/K [m], and how much it shows.

    `ratio` is the root mean square of what it adds to the recorded channels over their noise.
    """

    name: str
    axis: str
    parameter: str
    value: float
    ratio: float


@dataclass(frozen=True)
class Case:
    """What was drawn. `readings` [m] are as recorded; `floors` [m] what noise and steps add to each.

    `plants` are the true axes, `bases` the true ones without any effect, `files` what the file says.
    """

    effects: tuple[str, ...]
    channels: tuple[str, ...]
    feedback: str
    seed: int
    truths: tuple[Truth, ...]
    plants: tuple[Plant, ...]
    bases: tuple[Plant, ...]
    files: tuple[Plant, ...]
    known_flank: bool
    track: Track
    t: Floats
    commands: tuple[Floats, ...]
    readings: Readings
    floors: Mapping[str, float]
    alike: Mapping[str, float] = field(default_factory=dict)

    @property
    def axes(self) -> tuple[str, ...]:
        return NAMES[: len(self.plants)]

    @property
    def ratio(self) -> float:
        """How much the least of its effects shows, noise floors."""
        return min((truth.ratio for truth in self.truths), default=0.0)

    @property
    def log(self) -> str:
        """The record as CSV, its first line a remark that tells nothing."""
        head, rows = ["t"], [self.t]
        forms = ["%.3f"]
        for axis, command in zip(self.axes, self.commands, strict=True):
            head.append(f"{axis}_cmd")
            rows.append(command * MM)
            forms.append("%.7f")
            plant = self.plants[self.axes.index(axis)]
            for name, values in self.readings.items():
                if name.startswith(axis + "_"):
                    force = name.endswith("_force")
                    head.append(name)
                    rows.append(values * (plant.stiffness if force else MM))
                    forms.append("%.4f" if force else "%.6f")
        text = io.StringIO()
        text.write("# machine: under test\n")
        if "unknown" in self.channels:
            text.writelines(f"# {axis}_act.side: unknown\n" for axis in self.axes)
        text.write(",".join(head) + "\n")
        np.savetxt(text, np.column_stack(rows), fmt=forms, delimiter=",")
        return text.getvalue()

    @property
    def machine(self) -> str:
        """The machine file, which knows nothing of the effects."""
        lines = ['name = "under test"', "[controller]", 'dialect = "linuxcnc"', "servo_period_ms = 1.0"]
        for name, plant in zip(self.axes, self.files, strict=True):
            lines += _axis(name, plant, self.known_flank)
        return "\n".join(lines) + "\n"


def thinned(case: Case, every: int) -> Case:
    """A case of which a slow recorder kept every so many rows."""
    readings = {name: values[::every] for name, values in case.readings.items()}
    return replace(case, t=case.t[::every], commands=tuple(one[::every] for one in case.commands), readings=readings)


def _axis(name: str, plant: Plant, known_flank: bool) -> list[str]:
    gains = [f"b = {plant.b:.9g}", f"c = {plant.c:.9g}"] if plant.drive is None else []
    lines = [
        f"[axes.{name}]",
        f'feedback = "{plant.feedback}"',
        *gains,
        f"lost_motion_mm = {plant.gap * MM:.9g}",
        f"servo_stiffness_n_per_mm = {plant.stiffness / MM:.9g}",
        "max_velocity_mm_s = 300",
        "max_acceleration_mm_s2 = 8000",
        "max_jerk_mm_s3 = 400000",
    ]
    if plant.feedback == "load":
        lines += [
            "gear_ratio = 2.0",
            "screw_lead_mm = 5.0",
            f"inertia_fraction = {plant.eta:.9g}",
            f"motor_time_constant_s = {1.0 / plant.beta:.9g}",
            'pickup = "standstill"',
        ]
    if known_flank:
        lines.append(f'initial_flank = "{"+" if plant.flank > 0 else "-"}"')
    if plant.drive is not None:
        lines += _control(name, plant, plant.drive)
    return lines


def _control(name: str, plant: Plant, drive: Drive) -> list[str]:
    lines = [
        f"[axes.{name}.control]",
        'structure = "cascade"',
        f"position_gain_per_s = {drive.kv:.9g}",
        f"velocity_gain_per_s = {drive.wv:.9g}",
        f"velocity_feedforward_percent = {100.0 * drive.velocity:.9g}",
    ]
    if plant.feedback == "load":
        lines.append(f'velocity_feedback = "{plant.fast_side}"')
    if drive.tn < math.inf:
        lines.append(f"velocity_integral_time_ms = {MM * drive.tn:.9g}")
    if drive.current:
        lines.append(f"current_bandwidth_hz = {0.5 / math.pi / drive.current:.9g}")
    return lines


def save(case: Case, path: Path) -> None:
    """Write a case whole or not at all."""
    told = {key: getattr(case, key) for key in ("effects", "channels", "feedback", "seed", "known_flank")} | {
        "truths": [asdict(each) for each in case.truths],
        "floors": dict(case.floors),
        "alike": dict(case.alike),
        "track": [[isinstance(s, Mirrored), asdict(s)] for s in case.track.stretches],
    }
    for key in ("plants", "bases", "files"):
        told[key] = [_told(plant) for plant in getattr(case, key)]
    arrays = {f"cmd {i}": values for i, values in enumerate(case.commands)}
    # A place beside, not in the folder's pattern: whoever reads along sees whole cases only.
    beside = path.with_suffix(".part")
    with beside.open("wb") as out:
        np.savez_compressed(out, told=np.array(json.dumps(told)), t=case.t, **arrays, **case.readings)
    beside.replace(path)


def _told(plant: Plant) -> dict[str, object]:
    return asdict(plant) | {"effects": [[e.name, dict(e.parameters)] for e in plant.effects]}


def load(path: Path) -> Case:
    with np.load(path) as held:
        told = json.loads(str(held["told"]))
        arrays = {key: held[key] for key in held.files if key != "told"}
    track = Track()
    for mirrored, piece in told.pop("track"):
        for key in ("origin", "direction"):
            piece[key] = None if piece[key] is None else tuple(piece[key])
        track._add((Mirrored if mirrored else Stretch)(**piece))
    for key in ("plants", "bases", "files"):
        told[key] = tuple(
            Plant(
                **plant
                | {"effects": tuple(Hidden(*pair) for pair in plant["effects"])}
                | {"drive": Drive(**plant["drive"]) if plant.get("drive") else None}
            )
            for plant in told[key]
        )
    t = arrays.pop("t")
    commands = tuple(arrays.pop(f"cmd {i}") for i in range(len(told["plants"])))
    return Case(
        **told
        | {
            "effects": tuple(told["effects"]),
            "channels": tuple(told["channels"]),
            "truths": tuple(Truth(**each) for each in told["truths"]),
        },
        track=track,
        t=t,
        commands=commands,
        readings=arrays,
    )
