"""The loop closed: a hidden machine is compensated with a wrong file, measured, diagnosed, compensated again.

What counts is what the hidden machine executes, by its own equations, and how far that is from the path as it
is known on paper. Nothing here asks the simulator what it thinks of its own work.
"""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from ph_post.cli.main import main
from tests.support.plants.axis import Hidden, Plant
from tests.support.plants.courses import draw_course
from tests.support.plants.loops import follow
from tests.support.plants.readings import Floats, Observer, Sensor

MM = 1e3
RADIUS = 0.012
SETTLED = 0.5
"""[s] After that start-up is over."""

FRICTION = Hidden("coulomb_friction", {"force": 4e-6})
TRUE = (
    Plant("motor", 1e-4, 0.0167, gap=1.2e-4, effects=(FRICTION,)),
    Plant("motor", 1.2e-4, 0.018, gap=8e-5),
)
"""The hidden machine. The file knows of no friction, and of less than half the lost motion of X."""

AS_FILED = (replace(TRUE[0], gap=5e-5, effects=()), TRUE[1])
"""What the file takes it for."""

CIRCLE = {
    "format": "ph-post-path",
    "version": 1,
    "name": "circle",
    "source": "by hand",
    "units": "mm",
    "axes": ["X", "Y"],
    "feed": 1200,
    "closed": True,
    "segments": [{"type": "arc", "start": [12, 0], "end": [12, 0], "center": [0, 0], "turn": "ccw"}],
}

MACHINE = """\
name = "a router that nobody has measured for years"
[controller]
dialect = "linuxcnc"
servo_period_ms = 1.0
"""

AXIS = """\
[axes.{name}]
feedback = "motor"
b = {b}
c = {c}
lost_motion_mm = {gap}
max_velocity_mm_s = 120
max_acceleration_mm_s2 = 1500
max_jerk_mm_s3 = 40000
"""


def machine_text(*gaps: float) -> str:
    axes = zip("XY", TRUE, gaps, strict=True)
    return MACHINE + "".join(AXIS.format(name=n, b=p.b, c=p.c, gap=gap * MM) for n, p, gap in axes)


@dataclass(frozen=True)
class Table:
    """An interpolator table as a command: linear between its rows, at rest behind the last."""

    t: list[float]
    position: list[list[float]]

    @property
    def end(self) -> float:
        return self.t[-1] + 0.2

    def command(self, axis: int) -> Callable[[float], float]:
        values, period = [row[axis] for row in self.position], self.t[1] - self.t[0]

        def at(t: float) -> float:
            k = min(max(int(t / period), 0), len(values) - 2)
            share = min(max(t / period - k, 0.0), 1.0)
            return values[k] + share * (values[k + 1] - values[k])

        return at


def read_table(path: Path) -> Table:
    with path.open() as lines:
        rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    position = [[float(row[name]) / MM for name in "XY"] for row in rows]
    return Table([float(row["t"]) for row in rows], position)


def executed_error(table: Table, plants: tuple[Plant, ...]) -> float:
    """Largest distance [m] from the circle of what the plants do with a table, behind the start-up.

    A plant starts from rest at 0: it is given the command from where it stands.
    """
    begin = table.position[0]
    moved = replace(table, position=[[x - x0 for x, x0 in zip(row, begin, strict=True)] for row in table.position])
    x, y = (follow(p, moved, axis).table + begin[axis] for axis, p in enumerate(plants))  # type: ignore[arg-type]
    counted = np.arange(len(x)) * 1e-3 > SETTLED
    return float(np.max(np.abs(np.hypot(x, y) - RADIUS)[counted]))


def record(seed: int) -> tuple[list[str], Floats]:
    """Names and columns of a log of the hidden machine: noise of 0.3 µm, steps of 0.1 µm."""
    rng = np.random.default_rng(seed)
    observer = Observer(draw_course(rng, True))
    readings = {k: v for k, v in observer(TRUE).items() if not k.endswith("_force")}
    commands = observer.command(TRUE)
    sensor = Sensor(3e-7, 1e-7)
    names = ["t", "X_cmd", "Y_cmd", *readings]
    columns = [*commands, *(sensor.read(values, rng) for values in readings.values())]
    t = np.arange(len(commands[0])) * 1e-3
    return names, np.column_stack([t, *(one * MM for one in columns)])


def run(*arguments: object) -> None:
    assert main([str(one) for one in arguments]) == 0


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("loop")
    (folder / "circle.json").write_text(json.dumps(CIRCLE))
    (folder / "wrong.toml").write_text(machine_text(5e-5, 8e-5))
    (folder / "true.toml").write_text(
        machine_text(1.2e-4, 8e-5).replace(
            "[axes.Y]",
            '[[axes.X.effects]]\nname = "coulomb_friction"\nfollowing_error_mm = 0.004\n[axes.Y]',
        )
    )
    names, rows = record(5)
    np.savetxt(folder / "run.csv", rows, "%.7f", ",", header=",".join(names), comments="")
    return folder


def converted(folder: Path, machine: str) -> Table:
    table = folder / f"{machine}.csv"
    run("convert", folder / "circle.json", "-m", folder / f"{machine}.toml", "--table", table, "--effort", 0.1)
    return read_table(table)


def test_the_executed_error_falls_once_the_file_was_diagnosed(folder: Path) -> None:
    """To what the whole truth would give, and near what a machine gives that is as its file says."""
    first = converted(folder, "wrong")
    wrong, ideal = executed_error(first, TRUE), executed_error(first, AS_FILED)
    run("diagnose", folder / "run.csv", "-m", folder / "wrong.toml", "-o", folder / "better.toml")
    better = executed_error(converted(folder, "better"), TRUE)
    known = executed_error(converted(folder, "true"), TRUE)
    # How much worse the wrong file does is also a matter of how well its plan stands another backlash.
    assert better < wrong / 3.0
    assert better < 12.5e-6
    assert better < 1.1 * known
    assert better < ideal + 2.0 * FRICTION["force"]
