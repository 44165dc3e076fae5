"""A cascade with a gap and friction, recorded by the recorders that people have: the answer is that of our own layout.

The layouts are written by these tests: Siemens' trace as SINUMERIK Operate and its German version head the columns; the
text export of TwinCAT Scope, a time column for each channel, whose channels begin at times of their own; an ODrive's
single precision, in turns.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ph_post.diagnose.diagnose import diagnose
from ph_post.errors import InputError
from ph_post.identify.logprogram import read_log
from ph_post.types import Log
from tests.support.cascade_plant import Drive
from tests.support.cascade_records import machine_of, record

DRIVE, GAP, FRICTION = Drive(kv=30.0, wv=180.0, tn=16e-3, velocity=0.7), 3e-5, 0.3
TURN = 5.0
"""Travel of a turn [mm]."""

WRITTEN = 3e-9
"""[m] What six decimals of a millimetre leave, or two roundings of eight turns of 5 mm to single precision."""


@pytest.fixture(scope="module")
def log() -> Log:
    return record(DRIVE, GAP, coulomb=FRICTION)


def channels(log: Log) -> list[list[float]]:
    """Time [s], command, motor and table [mm], a row a sample."""
    axis = log.axes["X"]
    assert axis.motor is not None
    assert axis.table is not None
    return np.column_stack([log.t, *(1e3 * one for one in (axis.command, axis.motor, axis.table))]).tolist()


def siemens(log: Log) -> str:
    head = (
        "Time,Position setpoint X1 [mm],Position actual value encoder 1 X1 [mm],Position actual value encoder 2 X1 [mm]"
    )
    return "\n".join([head, *(f"{t:.6f},{c:.6f},{m:.6f},{a:.6f}" for t, c, m, a in channels(log))])


def german(log: Log) -> str:
    head = "Zeit [ms];X1 Lagesollwert [mm];X1 Lageistwert Messsystem 1 [mm];X1 Lageistwert Messsystem 2 [mm]"
    rows = (f"{1e3 * t:.3f};{c:.6f};{m:.6f};{a:.6f}".replace(".", ",") for t, c, m, a in channels(log))
    return "\n".join([head, *rows])


def twincat(log: Log) -> str:
    """The reading's channel begins 2 ms late, and so ends 2 ms before the other."""
    names, late, rows = ("SetPos", "ActPos"), 2, channels(log)
    lines = ["Name\tScope Project", "File\tC:\\run.svdx", "Starttime of export\t132959733843760000", "", ""]
    for key, told in (("Name", "{}"), ("SymbolName", "Axes.Axis 1.NcToPlc.{}"), ("SampleTime[ms]", "1")):
        lines.append("\t".join(f"{key}\t{told.format(name)}" for name in names))
    lines.append("")
    for k, row in enumerate(rows):
        there = k + late < len(rows)
        cells = (f"{k}", f"{row[1]:.6f}", f"{k + late}" if there else "", f"{rows[k + late][3]:.6f}" if there else "")
        lines.append("\t".join(cells).replace(".", ","))
    return "\r\n".join([*lines, "EOF", ""])


def odrive(log: Log) -> str:
    rows = (f"{t:.6f},{np.float32(c / TURN)!s},{np.float32(m / TURN)!s}" for t, c, m, _ in channels(log))
    return "\n".join(["time,axis0.controller.pos_setpoint,axis0.encoder.pos_estimate", *rows])


LAYOUTS: dict[str, tuple[Callable[[Log], str], list[str], tuple[str, ...]]] = {
    "siemens": (siemens, [], ("motor", "table")),
    "siemens, German": (german, [], ("motor", "table")),
    "twincat": (twincat, [], ("table",)),
    "odrive": (odrive, [f"recorder=odrive*{TURN:g}"], ("motor",)),
}


def reread(log: Log, name: str, folder: Path) -> Log:
    write, columns, _ = LAYOUTS[name]
    (folder / "run.csv").write_text(write(log), encoding="utf-8")
    return read_log(folder / "run.csv", columns=columns)


@pytest.mark.parametrize("name", LAYOUTS)
def test_a_recorder_gives_what_was_recorded(log: Log, name: str, tmp_path: Path) -> None:
    read, true = reread(log, name, tmp_path).axes["X"], log.axes["X"]
    count = read.command.size
    assert count >= log.t.size - 2
    for side in ("motor", "table"):
        found = getattr(read, side)
        if side not in LAYOUTS[name][2]:
            assert found is None
            continue
        assert np.max(np.abs(read.command - true.command[-count:])) < WRITTEN
        assert np.max(np.abs(found - getattr(true, side)[-count:])) < WRITTEN


def test_the_only_encoder_of_a_siemens_trace_is_the_one_that_its_name_says(log: Log, tmp_path: Path) -> None:
    """The 1 of X1 was taken for that of encoder 1, and the table for the motor."""
    rows = [line.split(",") for line in siemens(log).split("\n")]
    (tmp_path / "run.csv").write_text("\n".join(",".join((*row[:2], row[3])) for row in rows))
    read = read_log(tmp_path / "run.csv").axes["X"]
    assert read.motor is None
    assert read.table is not None
    assert np.max(np.abs(read.table - log.axes["X"].table)) < WRITTEN


def test_a_polled_drive_is_refused_in_a_line(log: Log, tmp_path: Path) -> None:
    """A host that asks as often as it can reads at times that nobody can put right."""
    lines = odrive(log).split("\n")
    rng = np.random.default_rng(1)
    rows = [line.split(",", 1) for line in lines[1:]]
    polled = [f"{float(t) + 3e-4 * rng.uniform(-1.0, 1.0):.6f},{rest}" for t, rest in rows]
    (tmp_path / "run.csv").write_text("\n".join([lines[0], *polled]))
    with pytest.raises(InputError, match="the sampling period is not constant") as refused:
        read_log(tmp_path / "run.csv", columns=[f"recorder=odrive*{TURN:g}"])
    assert "\n" not in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["siemens, German", "twincat", "odrive"])
def test_what_is_missing_is_found_behind_every_recorder(log: Log, name: str, tmp_path: Path) -> None:
    sides = LAYOUTS[name][2]
    found = {one.name: one.parameters for one in diagnose(reread(log, name, tmp_path), machine_of(DRIVE)).findings}
    assert set(found) == {"coulomb_friction", *(["backlash"] if "table" in sides else [])}
    friction = FRICTION / (DRIVE.kv * DRIVE.wv)
    assert found["coulomb_friction"]["force"].value == pytest.approx(1e3 * friction, rel=0.03)
    if "table" in sides:
        assert found["backlash"]["lost_motion"].value == pytest.approx(1e3 * GAP, rel=0.03)
