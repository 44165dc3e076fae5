"""Whatever a record commanded: the next experiment stays inside it, and within the machine's limits."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.amount import examples
from support.testdrive import Drive

from ph_post.drive.machinefile import read_machine
from ph_post.gcode.read import read_program
from ph_post.testprograms.experiments import MOVED, SHOWN, next_experiment
from ph_post.types import AxisLog, Log

MM = 1e-3
MACHINES = {name: read_machine(name) for name in ("mill", "router", "stepper", "paper")}

spans = st.tuples(st.floats(-2.0, 2.0), st.floats(math.log(0.2 * MM), 0.0).map(math.exp))


def swing(span: tuple[float, float], t: np.ndarray, omega: float) -> AxisLog:
    """Return the record of an axis that swings over a span (middle, size) [m]."""
    middle, size = span
    command = middle + 0.5 * size * np.sin(omega * t)
    return AxisLog(command=command, table=command)


@settings(max_examples=examples(60), deadline=None)
@given(
    st.sampled_from(sorted(MACHINES)),
    st.sampled_from(["grbl", "grblhal", "linuxcnc"]),
    spans,
    spans,
    st.floats(0.5, 20.0),
    st.lists(st.sampled_from(sorted(SHOWN)), max_size=3),
    st.sampled_from("XY"),
)
def test_it_stays_inside_the_record_and_within_the_limits(
    name: str, dialect: str, x: tuple, y: tuple, omega: float, names: list[str], axis: str
) -> None:
    machine = replace(MACHINES[name], dialect=dialect)
    t = np.arange(8000) * 2e-3
    axes = {"X": swing(x, t, omega), "Y": swing(y, t, 1.3 * omega)}
    found = next_experiment(names, axis, Log(name="swing", t=t, period=2e-3, axes=axes), machine)
    assert found is not None
    read_program(found.program.encode(), found.name, strict=True)
    bounds = [(one.command.min() / MM, one.command.max() / MM) for one in axes.values()]
    assert all(high - low > MOVED / MM for low, high in bounds)
    start = next(line for line in found.program.splitlines() if line.startswith("G1"))
    words = dict(zip("XY", [0.0, 0.0], strict=True)) | {
        word[0]: float(word[1:]) for word in start.replace("X", " X").replace("Y", " Y").replace("F", " F").split()[1:]
    }
    drive = Drive(found.program, (words["X"], words["Y"], 0.0))
    for column, (low, high) in enumerate(bounds):
        places = drive.points[:, column]
        assert low <= places.min()
        assert places.max() <= high
    for one in drive.circles:
        limits = [machine.axes[axis].limits for axis in "XY"]
        assert (one.feed / 60.0) ** 2 / one.radius <= min(one.acceleration for one in limits) / MM
    feeds = [one.feed for one in drive.moves if one.feed is not None]
    assert max(feeds) / 60.0 <= max(machine.axes[axis].limits.velocity for axis in "XY") / MM * (1.0 + 1e-5)
