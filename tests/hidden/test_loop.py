"""The loop closed: a hidden machine is compensated with a wrong file, measured, diagnosed, compensated again.

What counts is what the hidden machine executes, by its own equations, and how far that is from the path as it
is known on paper. Nothing here asks the simulator what it thinks of its own work.
"""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ph_post.cli.main import main
from tests.support.plants.axis import Hidden, Plant
from tests.support.plants.courses import draw_course
from tests.support.plants.readings import Floats, Observer, Sensor
from tests.support.two_masses import Body, table_of

MM = 1e3
PERIOD = 1e-3
"""[s] Between rows."""

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


def read_table(path: Path) -> Floats:
    """Rows (n, 2) [m] of an interpolator table a millisecond from each other, at rest at its end for 0.2 s."""
    with path.open() as lines:
        rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert np.allclose(np.diff([float(row["t"]) for row in rows]), PERIOD)
    position = np.array([[float(row[name]) / MM for name in "XY"] for row in rows])
    return np.pad(position, ((0, round(0.2 / PERIOD)), (0, 0)), "edge")


def executed_error(table: Floats, plants: tuple[Plant, ...]) -> float:
    """Largest distance [m] from the circle of what the plants do with a table, behind the start-up.

    A plant starts from rest at 0: it is given the command from where it stands.
    """
    begin = table[0]
    x, y = (table_of(body_of(p), table[:, k] - begin[k], PERIOD, p.flank, 0.0) + begin[k] for k, p in enumerate(plants))
    counted = np.arange(len(x)) * PERIOD > SETTLED
    return float(np.max(np.abs(np.hypot(x, y) - RADIUS)[counted]))


def body_of(plant: Plant) -> Body:
    """The same axis, of Coulomb friction at most, as one of the tests' two masses: they run a hundred times as fast."""
    dry = sum((each["force"] for each in plant.effects), 0.0)
    friction = (dry, dry, *(0.0,) * 5)
    return Body(plant.feedback, plant.b, plant.c, 0.0, 0.0, plant.gap, plant.eta, plant.beta, rule=0, friction=friction)


def record(seed: int) -> tuple[list[str], Floats]:
    """Names and columns of a log of the hidden machine: noise of 0.3 µm, steps of 0.1 µm."""
    rng = np.random.default_rng(seed)
    observer = Observer(draw_course(rng, True))
    readings = {k: v for k, v in observer(TRUE).items() if not k.endswith("_force")}
    commands = observer.command(TRUE)
    sensor = Sensor(3e-7, 1e-7)
    names = ["t", "X_cmd", "Y_cmd", *readings]
    columns = [*commands, *(sensor.read(values, rng) for values in readings.values())]
    t = np.arange(len(commands[0])) * PERIOD
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


def converted(folder: Path, machine: str) -> Floats:
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
