"""Logs as recorders write them, column by column."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from ph_post.drive.machinefile import read_machine
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


def test_what_a_loop_reads_is_on_the_side_where_the_machine_file_closes_it(written: Callable[[str], Path]) -> None:
    # As a reading of the table it showed "no backlash", and identify put 0 in place of what a dial had measured.
    text = written(table("time,joint.0.pos-cmd,joint.0.pos-fb", columns(T, AT, LATE)))
    for name, side in (("router", "motor"), ("stepper", "motor"), ("mill", "table")):
        log = read_log(text, machine=read_machine(name))
        is_that_motion(log, side=side)
        assert any("what the loop reads" in words for words in log.warnings) == (side == "motor")
    is_that_motion(read_log(text, machine=read_machine("router"), sides={"X": "table"}))
    both = written(table("time,joint.0.pos-cmd,joint.0.pos-fb,enc", columns(T, AT, AT, LATE)))
    log = read_log(both, machine=read_machine("router"), columns=["recorder=linuxcnc", "X_motor=enc:mm"])
    is_that_motion(log, side="motor")


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


def test_what_a_message_advises_takes_the_columns_of_a_recorder(written: Callable[[str], Path]) -> None:
    # "--column X_cmd=X_act --column X_act=X_cmd" was advised, and then refused as no column of the file.
    text = written(table("time,joint.0.pos-cmd,joint.0.pos-fb", columns(T, LATE, AT)))
    is_that_motion(read_log(text, columns=["X_cmd=X_act", "X_act=X_cmd"]))
    router = read_machine("router")
    is_that_motion(read_log(text, columns=["X_cmd=X_motor", "X_motor=X_cmd"], machine=router), side="motor")
    assert read_log(text, columns=["X_cmd=X_motor", "X_motor=X_cmd"], machine=router).axes["X"].table is None
    metres = written(table("time,joint.0.pos-cmd,joint.0.pos-fb", columns(T, AT / 1e3, LATE / -1e3)))
    is_that_motion(read_log(metres, columns=["X_cmd=X_cmd:m", "X_act=X_act*-1:m"]))
    turns = written(
        table("time,axis0.controller.pos_setpoint,axis0.encoder.pos_estimate", columns(T, AT / 5, LATE / -5))
    )
    mapped = ["recorder=odrive*5", "X_motor=X_motor*-1"]
    is_that_motion(read_log(turns, columns=mapped), side="motor")


def test_unknown_recorders_and_columns_are_refused(written: Callable[[str], Path]) -> None:
    text = written(table("t,a,b", columns(T, AT, LATE)))
    with pytest.raises(InputError, match='no recorder; expected twincat; got "twinkat"'):
        read_log(text, columns=["recorder=twinkat"])
    with pytest.raises(InputError, match="no commands or positions of twincat among the columns; got t, a, b"):
        read_log(text, columns=["recorder=twincat"])


def scope(groups: list[tuple[str, float, float, np.ndarray]], unit: str = "(None)") -> str:
    """Write channels (name, sampling time, first time [ms], values) as TwinCAT Scope 3.4 does with a German Windows."""
    keys = {"Name": 0, "SampleTime[ms]": 1, "Unit": None}
    lines = ["Name\tScope Project", "File\tC:\\run.svdx", "Starttime of export\t132959733843760000", "", ""]
    for key, place in keys.items():
        lines.append("\t".join(f"{key}\t{unit if place is None else one[place]}" for one in groups))
    lines.append("")
    for row in range(max(one[3].size for one in groups)):
        cells = [(one[2] + one[1] * row, one[3][row]) if row < one[3].size else ("", "") for one in groups]
        lines.append("\t".join(f"{time}\t{value}" for time, value in cells).replace(".", ","))
    return "\n".join([*lines, "EOF", ""])


def test_channels_of_twincat_have_times_of_their_own(written: Callable[[str], Path]) -> None:
    """Taken row by row a reading that was begun 4 ms later, or sampled twice as often, would belong to another time."""
    fine = 10.0 * np.sin(2.0 * (0.001 * np.arange(600) - 0.006))
    groups = [("Axis 1.SetPos", 2, 0, AT), ("Axis 1.ActPos", 1, 0, fine)]
    is_that_motion(read_log(written(scope(groups))))
    log = read_log(written(scope([groups[0], ("Axis 1.ActPos", 2, 4, LATE[2:])])))
    assert log.axes["X"].table == pytest.approx(LATE[2:] / 1e3, abs=1e-9)
    assert log.axes["X"].command == pytest.approx(AT[2:] / 1e3, abs=1e-9)
    with pytest.raises(InputError, match="channels that were not sampled at the same times"):
        read_log(written(scope([groups[0], ("Axis 1.ActPos", 2, 1, LATE)])))


@pytest.mark.parametrize("later", [0, 20])
def test_times_of_twincat_may_count_from_1601(written: Callable[[str], Path], later: int) -> None:
    """Counts of 100 ns; of channels with times of their own, too, they had been taken for 1000 times as long."""
    rows = [
        (132959733843760000 + 20000 * k, AT[k], 132959733843760000 + 20000 * k + later, LATE[k]) for k in range(300)
    ]
    head = "Name\tScope\nStarttime of export\t1\n\nName\tAxis 1.SetPos\tName\tAxis 1.ActPos"
    text = "\n".join([head, *("\t".join(map(str, row)) for row in rows), "EOF", ""])
    if later:
        with pytest.raises(InputError, match="channels that were not sampled at the same times"):
            read_log(written(text))
    else:
        is_that_motion(read_log(written(text)))


@pytest.mark.parametrize(
    ("cells", "words"),
    [
        ("", 'run.csv:160: no number where the other rows have one; got ""'),
        ("100,0", "run.csv:160: time runs backwards; expected one recording a file, or t > 298 ms; got 100 ms"),
    ],
)
def test_a_channel_of_twincat_that_goes_on_elsewhere_is_refused(
    written: Callable[[str], Path], cells: str, words: str
) -> None:
    """What stands behind a hole had been left out, and of two recordings parts of both had been taken."""
    lines = scope([("Axis 1.SetPos", 2, 0, AT), ("Axis 1.ActPos", 2, 0, LATE)]).split("\n")
    first = next(k for k, line in enumerate(lines) if line.startswith("0"))
    *others, _, value = lines[first + 150].split("\t")
    lines[first + 150] = "\t".join([*others, cells, value if cells else ""])
    with pytest.raises(InputError) as found:
        read_log(written("\n".join(lines)))
    assert str(found.value).endswith(words)


@pytest.mark.parametrize(("rows", "words"), [(0, "channels that were not sampled at the same times"), (9, "too few")])
def test_a_channel_of_twincat_with_few_samples_is_refused(
    written: Callable[[str], Path], rows: int, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        read_log(written(scope([("Axis 1.SetPos", 2, 0, AT), ("Axis 1.ActPos", 2, 0, LATE[:rows])])))


def test_units_of_twincat_hold(written: Callable[[str], Path]) -> None:
    groups = [("Axis 1.SetPos", 2, 0, AT / 1e3), ("Axis 1.ActPos", 2, 0, LATE / 1e3)]
    is_that_motion(read_log(written(scope(groups, "m (Distance)"))))


def test_an_export_of_twincat_with_names_alone(written: Callable[[str], Path]) -> None:
    head = "Name,Scope\nFile,a.svdx\nStarttime of export,132959733843760000\n\nName,Axis 1 SetPos,Name,Axis 1 ActPos\n"
    is_that_motion(read_log(written(table(head, columns(1e3 * T, AT, 1e3 * T, LATE)))))


@pytest.mark.parametrize("comma", [False, True])
def test_what_halscope_saves(written: Callable[[str], Path], comma: bool) -> None:
    """Of LinuxCNC 2.9: the numbers are those of the locale, and lines of settings follow the names."""
    rows = "\n".join(f"{one:.14f};{late:.14f}" for one, late in zip(AT, LATE, strict=True))
    head = "# Sampling period is 2000000 ns\njoint.0.motor-pos-cmd;joint.0.motor-pos-fb\n# Position: 0.5;0.5\n"
    is_that_motion(read_log(written(head + (rows.replace(".", ",") if comma else rows))))


def test_what_halscope_saved_before(written: Callable[[str], Path]) -> None:
    """Each value stood behind its name, and behind the last sample one that was none."""
    rows = [
        f"joint.0.motor-pos-cmd {one:+.14f} joint.0.motor-pos-fb {late:+.14f} "
        for one, late in zip([*AT, 99.0], [*LATE, -99.0], strict=True)
    ]
    is_that_motion(read_log(written("Sampling period is 2000000 ns \n\n" + "\n".join(rows))))


@pytest.mark.parametrize("coding", ["utf-8", "utf-16", "cp1252"])
def test_what_a_german_office_saves(tmp_path: Path, coding: str) -> None:
    rows = "\n".join(
        f"{one:.4f};{at:.9f};{late:.9f}".replace(".", ",") for one, at, late in zip(T, AT, LATE, strict=True)
    )
    (tmp_path / "run.csv").write_text(f"# Maß: Tisch\nt [s];X_cmd [mm];X_act [mm]\n{rows}\n", encoding=coding)
    is_that_motion(read_log(tmp_path / "run.csv"))


def test_units_behind_names(written: Callable[[str], Path]) -> None:
    text = table("t [ms],X_cmd [inch],X_act [inch]", columns(1e3 * T, AT / 25.4, LATE / 25.4))
    is_that_motion(read_log(written(text)))
    with pytest.raises(InputError, match=r'not a unit of X_cmd; expected .*; got "X_cmd \[A\]"'):
        read_log(written(text.replace("X_cmd [inch]", "X_cmd [A]")))
