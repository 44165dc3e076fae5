"""Random machines with cascades, friction and backlash: measured, diagnosed, and what they then execute.

The machines are the tests' own plants (:mod:`tests.support.plants`), and so are the paths: nothing here asks the
simulator what it thinks of its own work. The commands of part programs are those of the package's model of LinuxCNC's
planner.
"""

from __future__ import annotations

import csv
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

import ph_post as ph
from ph_post.cli.main import main
from tests.support.plants.axis import Hidden, Plant
from tests.support.plants.courses import draw_course
from tests.support.plants.draw import WEIGHTS, in_cascade
from tests.support.plants.loops import PERIOD, follow
from tests.support.plants.readings import Floats, Observer, Sensor

MM = 1e3
LIMITS = {"max_velocity_mm_s": 200, "max_acceleration_mm_s2": 1000, "max_jerk_mm_s3": 50000}
DEPTH = -1.0
"""Z of the cut [mm]."""

EFFORT = 0.1
"""Part of the usual search."""

BESIDE = 0.3
"""Time at either end of a table that is not counted [s]: its axes come onto their sides there."""


@dataclass(frozen=True)
class Machine:
    """The true axes X and Y, and what a person would write down of them: gains, and neither backlash nor friction."""

    seed: int
    true: tuple[Plant, Plant]
    filed: tuple[Plant, Plant]


def _between(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(math.log(low), math.log(high))))


def draw_machine(seed: int, loop: str) -> Machine:
    """A machine of a maker: both axes with the same K_v and weight, each with its own friction and backlash.

    K_v is known, as a setting is; the acceleration for a unit of speed, which the inertia decides, to 5 %.
    """
    rng = np.random.default_rng([seed, 17])
    first = Plant(loop, 1e-4, 0.02, eta=float(rng.uniform(0.3, 0.7)), beta=float(rng.uniform(0.5, 5.0)))
    first = in_cascade(rng, first, WEIGHTS[seed % len(WEIGHTS)])
    assert first.drive is not None
    true, filed = [], []
    for _ in "XY":
        friction = Hidden("coulomb_friction", {"force": _between(rng, 0.3, 1.5) * first.b})
        plant = replace(first, gap=_between(rng, 1e-5, 8e-5), effects=(friction,), flank=int(rng.choice([-1, 1])))
        inertia = 1.0 + 0.05 * float(rng.uniform(-1.0, 1.0))
        said = replace(first.drive, wv=first.drive.wv * inertia)
        true.append(plant)
        filed.append(replace(first, b=first.b / inertia, drive=said))
    return Machine(seed, (true[0], true[1]), (filed[0], filed[1]))


def machine_text(plants: tuple[Plant, Plant], friction: bool = False) -> str:
    """A machine file with what these plants have; of a friction only where it is asked for."""
    lines = ['name = "with servos"', "[controller]", 'dialect = "linuxcnc"', "servo_period_ms = 1.0"]
    limits = [f"{key} = {value}" for key, value in LIMITS.items()]
    for name, plant in zip("XY", plants, strict=True):
        drive = plant.drive
        assert drive is not None
        lines += [f"[axes.{name}]", f'feedback = "{plant.feedback}"', f"lost_motion_mm = {plant.gap * MM:.9g}", *limits]
        if plant.feedback == "load":
            lines += ["gear_ratio = 2.0", "screw_lead_mm = 5.0", f"inertia_fraction = {plant.eta:.6g}"]
            lines += [f"motor_time_constant_s = {1.0 / plant.beta:.6g}", 'pickup = "standstill"']
        lines += [f"[axes.{name}.control]", 'structure = "cascade"', f"position_gain_per_s = {drive.kv:.9g}"]
        lines += [f"velocity_gain_per_s = {drive.wv:.9g}", f"velocity_feedforward_percent = {100 * drive.velocity:g}"]
        if plant.feedback == "load":
            lines += [f'velocity_feedback = "{plant.fast_side}"']
        if drive.tn < math.inf:
            lines += [f"velocity_integral_time_ms = {MM * drive.tn:.9g}"]
        if drive.current:
            lines += [f"current_bandwidth_hz = {0.5 / math.pi / drive.current:.9g}"]
        if friction:
            for of in plant.effects:
                force = MM * of["force"]
                lines += [f"[[axes.{name}.effects]]", f'name = "{of.name}"', f"following_error_mm = {force:.9g}"]
    lines += ["[axes.Z]", 'feedback = "none"', "b = 0", "c = 0", "lost_motion_mm = 0", *limits]
    return "\n".join(lines) + "\n"


def record(machine: Machine, out: Path) -> None:
    """Write a log of the machine, both sides read: noise of 0.3 µm, steps of 0.1 µm."""
    rng = np.random.default_rng([machine.seed, 18])
    observer = Observer(draw_course(rng, True))
    readings = {k: v for k, v in observer(machine.true).items() if not k.endswith("_force")}
    commands = observer.command(machine.true)
    sensor = Sensor(3e-7, 1e-7)
    columns = [*commands, *(sensor.read(values, rng) for values in readings.values())]
    t = np.arange(len(commands[0])) * PERIOD
    names = ["t", "X_cmd", "Y_cmd", *readings]
    rows = np.column_stack([t, *(one * MM for one in columns)])
    np.savetxt(out, rows, "%.7f", ",", header=",".join(names), comments="")


@dataclass(frozen=True, eq=False)
class Rows:
    """Commands at every period, straight in between, at rest behind the last; a plant's track."""

    position: Floats

    @property
    def end(self) -> float:
        return PERIOD * (len(self.position) - 1) + 0.2

    def command(self, axis: int) -> Callable[[float], float]:
        column, times = self.position[:, axis], PERIOD * np.arange(len(self.position))
        return lambda t: float(np.interp(t, times, column))

    def rows(self, axis: int, times: Floats) -> tuple[Floats, Floats, Floats]:
        """The command, its speed and its acceleration, which is not counted, at many times."""
        column, at = self.position[:, axis], times / PERIOD + 1e-9
        k = np.clip(np.floor(at).astype(int), 0, len(column) - 2)
        step = np.where((at >= 0.0) & (at < len(column) - 1), column[k + 1] - column[k], 0.0)
        return np.interp(times, PERIOD * np.arange(len(column)), column), step / PERIOD, np.zeros(len(times))


def followed(plants: tuple[Plant, Plant], position: Floats) -> Floats:
    """Where the table is at every row of commands (n, 2); a plant starts from rest where the first row is."""
    track: Any = Rows(position - position[0])
    tables = [follow(plant, track, axis).table for axis, plant in enumerate(plants)]
    return np.column_stack(tables)[: len(position)] + position[0]


Shape = list[dict[str, Any]]

CIRCLE: Shape = [{"type": "arc", "start": [12, 0], "end": [12, 0], "center": [0, 0], "turn": "ccw"}]
POCKET: Shape = [
    {"type": "line", "points": [[3, 0], [24, 0]]},
    {"type": "line", "points": [[24, 0], [24, 12]]},
    {"type": "arc", "start": [24, 12], "end": [21, 15], "center": [21, 12], "turn": "ccw"},
    {"type": "line", "points": [[21, 15], [8, 15]]},
    {"type": "line", "points": [[8, 15], [0, 9]]},
    {"type": "line", "points": [[0, 9], [0, 3]]},
    {"type": "arc", "start": [0, 3], "end": [3, 0], "center": [3, 3], "turn": "ccw"},
]
_K = 4.0 / 3.0 * (math.sqrt(2.0) - 1.0)
_QUARTERS = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0), (1.0, 0.0))
OVAL: Shape = [
    {
        "type": "bezier",
        "points": [
            [15 * a[0], 10 * a[1]],
            [15 * (a[0] + _K * b[0]), 10 * (a[1] + _K * b[1])],
            [15 * (b[0] + _K * a[0]), 10 * (b[1] + _K * a[1])],
            [15 * b[0], 10 * b[1]],
        ],
    }
    for a, b in pairwise(_QUARTERS)
]
SHAPES = {"circle": CIRCLE, "pocket": POCKET, "oval": OVAL}
FEED = 1200


def path_text(shape: str) -> str:
    told = {"format": "ph-post-path", "version": 1, "name": shape, "source": "by hand", "units": "mm"}
    return json.dumps(told | {"axes": ["X", "Y"], "feed": FEED, "closed": True, "segments": SHAPES[shape]})


def program_text(shape: str) -> str:
    """The same as a part program."""
    points = outline(shape) * MM
    lines = ["G21 G90 G17 G94 G64 P0.002", f"G0 X{points[0, 0]:.4f} Y{points[0, 1]:.4f}", "G0 Z2", f"G1 Z{DEPTH} F300"]
    for number, piece in enumerate(SHAPES[shape]):
        feed = f" F{FEED}" if number == 0 else ""
        if piece["type"] == "arc":
            (x, y), (u, v), (p, q) = piece["start"], piece["end"], piece["center"]
            lines.append(f"G3 X{u} Y{v} I{p - x} J{q - y}{feed}")
        elif piece["type"] == "line":
            lines.append("G1 X{} Y{}".format(*piece["points"][1]) + feed)
        else:
            a, b, c, d = np.array(piece["points"])
            lines.append("G5 I{:.5f} J{:.5f} P{:.5f} Q{:.5f} X{:.5f} Y{:.5f}".format(*(b - a), *(c - d), *d) + feed)
    return "\n".join([*lines, "G0 Z2", "M2", ""])


def outline(shape: str) -> Floats:
    """Points of a shape [m], about 3 µm apart."""
    found = []
    for piece in SHAPES[shape]:
        u = np.linspace(0.0, 1.0, 20001)[:-1, None]
        if piece["type"] == "arc":
            centre = np.array(piece["center"])
            first, last = np.array(piece["start"]) - centre, np.array(piece["end"]) - centre
            begin = math.atan2(first[1], first[0])
            turn = (math.atan2(last[1], last[0]) - begin) % math.tau or math.tau
            angle = begin + turn * u
            found.append(centre + math.hypot(*first) * np.hstack([np.cos(angle), np.sin(angle)]))
        elif piece["type"] == "line":
            a, b = np.array(piece["points"])
            found.append(a + u * (b - a))
        else:
            a, b, c, d = np.array(piece["points"])
            w = 1.0 - u
            found.append(w**3 * a + 3 * u * w**2 * b + 3 * u**2 * w * c + u**3 * d)
    return np.asarray(np.vstack(found) / MM)


def distances(places: Floats, points: Floats) -> Floats:
    """Distance [m] of places from the closed line through points."""
    tree = cKDTree(points)
    near = tree.query(places)[1]
    best = np.full(len(places), np.inf)
    for begin in (near - 1, near):
        a, b = points[begin], points[(begin + 1) % len(points)]
        along = b - a
        share = np.clip(np.sum((places - a) * along, axis=1) / np.sum(along**2, axis=1), 0.0, 1.0)
        best = np.minimum(best, np.hypot(*(places - a - share[:, None] * along).T))
    return best


class Executed(NamedTuple):
    """Distances from the path of what was executed [m], largest and root mean square; the time [s]; what was said."""

    largest: float
    rms: float
    time: float
    warnings: tuple[str, ...]


class Table(NamedTuple):
    """An interpolator table by a machine file: positions (n, 2) [m] at times [s], how long it takes, what was said."""

    position: Floats
    t: Floats
    time: float
    warnings: tuple[str, ...]


@lru_cache(maxsize=16)
def _planned(shape: str, machine: str, effort: float) -> Table:
    """Plan a table by the text of a machine file; one by which several plants are run is planned once."""
    with TemporaryDirectory() as folder:
        path, file, table = (Path(folder, name) for name in (f"{shape}.json", "machine.toml", f"{shape}.csv"))
        path.write_text(path_text(shape))
        file.write_text(machine)
        found = ph.compensate(ph.read_path(path), ph.read_machine(file), output="table", effort=effort)
        found.write_table(table)
        rows = list(csv.DictReader(one for one in table.read_text().splitlines() if not one.startswith("#")))
    position = np.array([[float(row[name]) / MM for name in "XY"] for row in rows])
    return Table(position, np.array([float(row["t"]) for row in rows]), found.after.time, found.warnings)


def of_table(_folder: Path, shape: str, file: Path, plants: tuple[Plant, Plant], effort: float = EFFORT) -> Executed:
    """What the plants make of the interpolator table by a machine file; called as :func:`of_program` is."""
    made = _planned(shape, file.read_text(), effort)
    counted = (made.t > BESIDE) & (made.t < made.t[-1] - BESIDE)
    return _executed(shape, plants, made.position, counted, made.time, made.warnings)


def of_program(
    folder: Path, shape: str, file: Path, plants: tuple[Plant, Plant], lead: bool = False, effort: float = EFFORT
) -> Executed:
    """What the plants make of the part program by a machine file: all of its cut."""
    program = folder / f"{shape}.ngc"
    program.write_text(program_text(shape))
    found = ph.compensate(ph.read_program(program), ph.read_machine(file), lead_program=lead, effort=effort)
    command = found.after.command.position
    cutting = np.flatnonzero(np.abs(command[:, 2] - DEPTH / MM) < 1e-9)
    counted = np.arange(len(command))
    counted = (counted >= cutting[0]) & (counted <= cutting[-1])
    return _executed(shape, plants, command[:, :2], counted, found.after.time, found.warnings)


def _executed(
    shape: str, plants: tuple[Plant, Plant], position: Floats, counted: Any, time: float, warnings: tuple[str, ...]
) -> Executed:
    off = distances(followed(plants, position)[counted], outline(shape))
    return Executed(float(np.max(off)), float(np.sqrt(np.mean(off**2))), time, warnings)


_DIAGNOSED: dict[str, str] = {}


def diagnosed(machine: Machine, folder: Path) -> tuple[Path, Path]:
    """Write the files before and after a diagnosis; what is there already is left.

    A machine's log is written and diagnosed once in a process.
    """
    wrong, better, log, key = folder / "wrong.toml", folder / "better.toml", folder / "run.csv", repr(machine)
    if not better.exists():
        wrong.write_text(machine_text(machine.filed))
        if key not in _DIAGNOSED:
            record(machine, log)
            assert main(["diagnose", str(log), "-m", str(wrong), "-o", str(better)]) == 0
            _DIAGNOSED[key] = better.read_text()
        better.write_text(_DIAGNOSED[key])
    return wrong, better


def advised(file: Path, said: tuple[str, ...]) -> Path | None:
    """Write a machine file with the accelerations [mm/s²] that were said to hold tables; None where none was."""
    text = file.read_text()
    found = re.findall(r"axis (\w) may run on.*?max_acceleration_mm_s2 = ([0-9.]+) or less", "\n".join(said))
    for name, most in found:
        before, own = text.split(f"[axes.{name}]\n", 1)
        own = re.sub(r"max_acceleration_mm_s2 = .*", f"max_acceleration_mm_s2 = {most}", own, count=1)
        text = f"{before}[axes.{name}]\n{own}"
    if not found:
        return None
    slower = file.with_name("slower.toml")
    slower.write_text(text)
    return slower
