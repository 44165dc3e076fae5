"""Logs as recorders write them, column by column."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ph_post.errors import InputError
from ph_post.identify.logprogram import read_log
from ph_post.types import Log

K = np.arange(300)
T = 0.002 * K
AT = 10.0 * np.sin(2.0 * T)
LATE = 10.0 * np.sin(2.0 * (T - 0.006))


def table(head: str, rows: list[list[float]], between: str = ",", ends: str = "") -> str:
    body = "\n".join(between.join(f"{cell:.9f}" for cell in row) for row in rows)
    return f"{head}\n{body}\n{ends}"


def columns(*values: object) -> list[list[float]]:
    return [list(map(float, row)) for row in zip(*values, strict=True)]


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        (tmp_path / "run.csv").write_text(text, encoding="utf-8")
        return tmp_path / "run.csv"

    return write


def is_that_motion(log: Log, axis: str = "X", side: str = "table") -> None:
    assert log.period == pytest.approx(0.002)
    one = log.axes[axis]
    assert one.command == pytest.approx(AT / 1e3, abs=1e-9)
    assert getattr(one, side) == pytest.approx(LATE / 1e3, abs=1e-9)


def test_pins_of_linuxcnc_are_recognized(written: Callable[[str], Path]) -> None:
    head = "time,joint.0.motor-pos-cmd,joint.0.motor-pos-fb,joint.2.motor-pos-cmd,joint.2.motor-pos-fb,spindle.0.speed"
    log = read_log(written(table(head, columns(T, AT, LATE, -AT, -LATE, K))))
    is_that_motion(log)
    assert log.axes["Y"].command == pytest.approx(-AT / 1e3, abs=1e-9)
    assert any("joint.0.motor-pos-cmd" in words for words in log.warnings)
    assert any("--side X=motor" in words for words in log.warnings)


@pytest.mark.parametrize("between", ["\t", ";"])
@pytest.mark.parametrize("shared", [False, True])
def test_exports_of_twincat_scope_are_read(written: Callable[[str], Path], between: str, shared: bool) -> None:
    def pairs(key: str, first: str, second: str) -> str:
        return between.join([key, first, second] if shared else [key, first, key, second])

    head = "\n".join(
        [
            between.join(["Name", "Scope Project"]),
            between.join(["File", "C:\\scope.tcscopex"]),
            between.join(["Starttime of export", "132960561840000000", "2. Mai 2022", "13:56:24"]),
            "",
            pairs("Name", "SetPos", "ActPos"),
            pairs("SampleTime[ms]", "2", "2"),
            pairs("SymbolName", "Axes.Axis 1.NcToPlc.SetPos", "Axes.Axis 1.NcToPlc.ActPos"),
            "",
        ]
    )
    rows = columns(1e3 * T, AT, LATE) if shared else columns(1e3 * T, AT, 1e3 * T, LATE)
    is_that_motion(read_log(written(table(head, rows, between, "EOF\n").replace(".0", ",0"))))


def test_measuring_systems_of_siemens_are_motor_and_table(written: Callable[[str], Path]) -> None:
    head = "Time [ms];X1 Position setpoint [mm];X1 Position actual value measuring system 1 [mm];"
    head += "X1 Position actual value measuring system 2 [mm]"
    log = read_log(written(table(head, columns(1e3 * T, AT, LATE, LATE), ";")), columns=["recorder=siemens"])
    is_that_motion(log)
    is_that_motion(log, side="motor")


def test_an_odrive_counts_turns(written: Callable[[str], Path]) -> None:
    text = table("time,axis0.controller.pos_setpoint,axis0.encoder.pos_estimate", columns(T, AT / 5.0, LATE / 5.0))
    is_that_motion(read_log(written(text), columns=["recorder=odrive*5"]), side="motor")
    with pytest.raises(InputError, match=r"the travel of one is needed; expected --column recorder=odrive\*5"):
        read_log(written(text))
    with pytest.raises(InputError, match=r"turns need the travel of one \[mm\]"):
        read_log(written(text), columns=["recorder=odrive"])


def test_what_is_given_goes_before_what_a_recorder_has(written: Callable[[str], Path]) -> None:
    text = table("time,pid.x.command,pid.x.feedback,scale", columns(T, AT, 0.0 * AT, LATE))
    is_that_motion(read_log(written(text), columns=["recorder=linuxcnc", "X_act=scale:mm"]))


def test_unknown_recorders_and_columns_are_refused(written: Callable[[str], Path]) -> None:
    text = written(table("t,a,b", columns(T, AT, LATE)))
    with pytest.raises(InputError, match='no recorder; expected twincat; got "twinkat"'):
        read_log(text, columns=["recorder=twinkat"])
    with pytest.raises(InputError, match="no commands or positions of twincat among the columns; got t, a, b"):
        read_log(text, columns=["recorder=twincat"])
