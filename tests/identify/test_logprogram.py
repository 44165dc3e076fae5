"""Logs as they come from machines, recorders and simulations, read into one record."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.amount import examples

from ph_post.cli.main import main
from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.files.table import log_content
from ph_post.gcode.read import read_program
from ph_post.identify.logprogram import read_log
from ph_post.simulate.controllers.run import run_program
from ph_post.simulate.machine import simulate
from ph_post.types import Run, Scenario, frozen

ROOT = Path(__file__).parents[2]
MEASURED = [folder / "shared" / "data" / "emps" / "DATA_EMPS.mat" for folder in ROOT.parents]
K = np.arange(300)
X = np.round(10.0 * np.sin(2 * np.pi * K / 150), 4)
ROWS = tuple((f"{k * 0.002:.3f}", f"{x:.4f}", f"{x - 0.01:.4f}") for k, x in enumerate(X))
NAMES = ("t", "X_cmd", "X_act")


def text(rows=ROWS, names=NAMES, delimiter=",", end="\n", head=""):
    return (head + "".join(delimiter.join(row) + end for row in (names, *rows))).encode()


def put(tmp_path, data, name="run.csv"):
    file = tmp_path / name
    file.write_bytes(data if isinstance(data, bytes) else data.encode())
    return file


def recorded(log):
    """Check that a log is that of ROWS."""
    assert log.t == pytest.approx(0.002 * K, abs=1e-12)
    assert log.period == 0.002
    assert log.axes["X"].command == pytest.approx(X * 1e-3, abs=1e-12)
    assert log.axes["X"].table == pytest.approx((X - 0.01) * 1e-3, abs=1e-12)
    return log


@pytest.mark.parametrize("delimiter", [",", ";", "\t", " ", ", ", "   "])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_cells_may_be_separated_in_many_ways(tmp_path, delimiter, end):
    log = recorded(read_log(put(tmp_path, text(delimiter=delimiter, end=end))))
    assert (log.name, log.warnings, log.missing, log.axes["X"].side) == ("run", (), 0, "table")


def test_byte_order_mark_blank_lines_quotes_and_remarks(tmp_path):
    names = tuple(f'"{name}"' for name in NAMES)
    data = b"\xef\xbb\xbf" + text(names=names, head="# made by: hand: mine\n#just words\n\n") + b"\n# end: yes\n\n"
    assert recorded(read_log(put(tmp_path, data))).remarks == {"made by": "hand: mine", "end": "yes"}


def test_other_columns_may_hold_text_and_are_named(tmp_path):
    rows = tuple((*row, '"a, b"', "") for row in ROWS)
    log = recorded(read_log(put(tmp_path, text(rows, (*NAMES, "state", "")))))
    assert log.warnings == ("columns ignored: state",)


def test_names_units_and_scales_are_mapped(tmp_path):
    rows = tuple((f"{2 * k}", f"{x / 25.4:.12f}", f"{1e3 * (x - 0.01):.1f}", f"{k}") for k, x in enumerate(X))
    data = text(rows, ("time [ms]", "ref", "X_act", "volt"))
    columns = ["t=time [ms]:ms", "X_cmd = ref : inch", "X_act=X_act:um", "X_force=volt*-0.035:kN"]
    log = recorded(read_log(put(tmp_path, data), columns=columns))
    assert log.axes["X"].effort == pytest.approx(-35.0 * K)
    assert (log.axes["X"].effort_unit, log.warnings) == ("N", ())


def test_current_is_kept_in_ampere_and_force_goes_before_it(tmp_path):
    rows = tuple((*row, "1500") for row in ROWS)
    log = read_log(put(tmp_path, text(rows, (*NAMES, "i"))), columns=["X_current=i:mA"])
    assert (log.axes["X"].effort[0], log.axes["X"].effort_unit) == (1.5, "A")
    both = read_log(put(tmp_path, text(rows, (*NAMES, "i"))), columns=["X_current=i:mA", "X_force=i:N"])
    assert (both.axes["X"].effort[0], both.axes["X"].effort_unit) == (1500.0, "N")
    assert both.warnings == ("X_current is ignored because the log has X_force",)


def test_the_side_of_a_reading_comes_from_the_log_or_from_who_asks(tmp_path):
    file = put(tmp_path, text(head="# X_act.side: unknown\n"))
    assert read_log(file).axes["X"].side == "unknown"
    assert read_log(file, sides={"X": "table"}).axes["X"].side == "table"
    axis = read_log(file, sides={"X": "motor"}).axes["X"]
    assert axis.table is None
    assert axis.motor == pytest.approx((X - 0.01) * 1e-3, abs=1e-12)


def test_lost_rows_and_empty_cells_are_missing_samples(tmp_path):
    rows = [list(row) for row in ROWS]
    rows[50][2], rows[60][2] = "", "nan"
    del rows[100:103]
    log = read_log(put(tmp_path, text(rows)))
    assert np.flatnonzero(np.isnan(log.axes["X"].table)).tolist() == [50, 60, 100, 101, 102]
    line = X[99] + (X[103] - X[99]) * np.arange(1, 4) / 4
    assert log.axes["X"].command[100:103] == pytest.approx(line * 1e-3, abs=1e-12)
    assert log.t == pytest.approx(0.002 * K, abs=1e-12)
    assert log.missing == 3
    (warning,) = log.warnings
    assert warning.endswith(f"run.csv:{100 + 2}")
    assert warning.startswith("3 of 300 samples are missing, the first before ")


def halsampler(first=0, tag=True, rows=K):
    """Lines as sampler_usr.c prints them: the number with -t, floats as %f, a blank behind every pin."""
    return [(f"{first + k} " if tag else "") + f"{X[k]:f} {X[k] - 0.01:f} {int(k > 5)} \n" for k in rows]


def test_halsampler_with_numbered_samples_tells_what_was_lost(tmp_path):
    lines = halsampler(first=7)
    lines[150:154] = ["overrun\n"]
    file = put(tmp_path, "".join(["overrun\n", *lines]))
    log = read_log(file, columns=["X_cmd=2", "X_act=3:mm"], machine=read_machine("paper"))
    assert (log.period, log.missing, log.t.size) == (0.001, 4, 300)
    assert log.t[0] == pytest.approx(0.007)
    assert np.flatnonzero(np.isnan(log.axes["X"].table)).tolist() == [150, 151, 152, 153]
    words = "the first column numbers the samples; their period of 0.001 s is the machine's servo period"
    assert log.warnings[0] == words


def test_what_a_linuxcnc_recorded_is_read():
    """Eight pins of LinuxCNC 2.9 while it begins to move: commands of X, Y, Z, motors, line, in position."""
    file = Path(__file__).parent / "recorded" / "halsampler.txt"
    columns = ["X_cmd=2", "X_motor=5", "Y_cmd=3", "Y_motor=6"]
    log = read_log(file, columns=columns, machine=read_machine("mill"))
    rows = np.loadtxt(file)
    assert log.missing == 0
    assert log.t == pytest.approx(rows[:, 0] * 0.001, abs=1e-9)
    assert log.axes["X"].command == pytest.approx(rows[:, 1] * 1e-3, abs=1e-12)
    assert log.axes["Y"].motor == pytest.approx(rows[:, 5] * 1e-3, abs=1e-12)
    assert (log.axes["X"].table, np.ptp(rows[:, 1]) > 1.0) == (None, True)


def test_halsampler_without_numbers_takes_its_period_from_a_remark(tmp_path):
    file = put(tmp_path, "".join(["# period: 0.002\n", *halsampler(tag=False)]))
    log = recorded(read_log(file, columns=["X_cmd=1", "X_act=2"]))
    assert log.warnings == ("no column t; the period of 0.002 s is from the log",)


def test_rows_without_names_and_time_need_a_machine(tmp_path):
    file = put(tmp_path, "".join(halsampler(tag=False)))
    with pytest.raises(InputError, match=r'run\.csv:1: column "t" is missing; .* got columns 1 to 3, without names'):
        read_log(file, columns=["X_cmd=1", "X_act=2"])


def stored(tmp_path, ending):
    columns = {"t": 0.002 * K, "X_cmd": X, "X_act": X - 0.01}
    file = tmp_path / f"run{ending}"
    if ending == ".mat":
        from scipy.io import savemat

        shapes = {name: column.reshape(-1, 1) for name, column in columns.items()}
        savemat(file, {**shapes, "gain": 160.18, "note": "by hand", "other": np.zeros((2, 2))})
    elif ending == ".npz":
        np.savez(file, **columns, gain=160.18, note="by hand", other=np.zeros((2, 2)))
    else:
        pa = pytest.importorskip("pyarrow")
        from pyarrow import parquet

        parquet.write_table(pa.table({**columns, "other": ["a"] * K.size}), file)
    return file


@pytest.mark.parametrize("ending", [".mat", ".npz", ".parquet"])
def test_stored_arrays_are_columns_and_single_values_remarks(tmp_path, ending):
    log = recorded(read_log(stored(tmp_path, ending)))
    assert log.warnings == ("variables ignored, not columns of 300 rows: other",)
    if ending != ".parquet":
        assert log.remarks == {"gain": "160.18", "note": "by hand"}


def test_rows_of_stored_arrays_are_named_by_number(tmp_path):
    np.savez(tmp_path / "run.npz", t=0.002 * K, X_cmd=X, X_act=np.where(K == 41, 500.0, X))
    with pytest.raises(InputError, match=r"run\.npz: row 42: X_act is far from X_cmd"):
        read_log(tmp_path / "run.npz")


def test_a_real_drive_is_read_by_mapping_its_variables():
    file = next((file for file in MEASURED if file.exists()), None)
    if file is None:
        pytest.skip("the measured drive (shared/data/emps) is not here")
    columns = ["X_cmd=qg:m", "X_act=qm:m", "X_force=vir*35.15:N"]
    log = read_log(file, columns=columns, sides={"X": "motor"})
    axis = log.axes["X"]
    assert (log.t.size, log.missing, log.warnings) == (24841, 0, ())
    assert log.period == 0.001
    assert log.jitter < 1e-7
    assert axis.table is None
    # the loop's own law, vir = kp kv (qg - qm) - kv v, holds in SI units only
    kp, kv = float(log.remarks["kp"]), float(log.remarks["kv"])
    law = 35.15 * kv * (kp * (axis.command - axis.motor) - np.gradient(axis.motor, log.period))
    assert np.corrcoef(law, axis.effort)[0, 1] > 0.98
    assert np.std(law) == pytest.approx(np.std(axis.effort), rel=0.05)


places = st.floats(-0.09, 0.09).map(lambda x: round(x, 9))
positions = st.lists(st.lists(places, min_size=3, max_size=3), min_size=1, max_size=9)


@settings(max_examples=examples(20), deadline=None)
@given(table=positions, period=st.sampled_from([1e-3, 1 / 3000, 2.5e-4, 0.0123]))
def test_a_simulated_run_reads_back_as_it_was(tmp_path_factory, table, period):
    commanded = np.tile(np.array(table), (200, 1))
    t = period * np.arange(len(commanded))
    run = Run(
        axes=("X", "Y", "Z"),
        period=period,
        scenario=Scenario(),
        t=frozen(t),
        s=frozen(t),
        commanded=frozen(commanded),
        executed=frozen(commanded * 0.999),
        motor=frozen(commanded * 1.001),
        events=(),
    )
    file = tmp_path_factory.mktemp("logs") / "run.csv"
    file.write_bytes(log_content(run, {"machine": "mine"}))
    log = read_log(file)
    assert (log.remarks, log.warnings, log.missing) == ({"machine": "mine"}, (), 0)
    assert log.t == pytest.approx(t, abs=1e-12)
    for number, name in enumerate("XYZ"):
        axis = log.axes[name]
        for read, wrote in (
            (axis.command, run.commanded),
            (axis.table, run.executed),
            (axis.motor, run.motor),
        ):
            assert read == pytest.approx(wrote[:, number], abs=1e-15)


MACHINE = read_machine("mill")
PART = b"G21 G17 G90 G94 G64 P0.01\nG0 X0 Y0\nG1 X20 Y5 F1200\nG2 X30 Y15 I0 J10\nG1 X0 Y0\nM2\n"


@pytest.fixture(scope="module")
def program():
    """Read the program where a test asks for it: whoever collects tests has nothing compiled."""
    return read_program(PART, "part.ngc")


@pytest.fixture(scope="module")
def ran(program):
    """What the machine does with the program, as rows of text by name."""
    command = run_program(program, MACHINE)
    run = simulate(command, MACHINE, Scenario())
    lines = log_content(run, {}).decode().splitlines()
    return np.array([line.split(",") for line in lines])


def part(ran, names, skip=0):
    columns = [ran[0].tolist().index(name) for name in names]
    return "\n".join(",".join(row) for row in ran[np.r_[0, 1 + skip : len(ran)]][:, columns])


def test_a_log_of_the_program_belongs_to_it(tmp_path, ran, program):
    file = put(tmp_path, part(ran, ran[0]))
    assert read_log(file, program=program, machine=MACHINE).warnings == ()


def test_a_log_of_another_program_does_not(tmp_path, ran):
    file = put(tmp_path, part(ran, ran[0]))
    other = read_program(PART.replace(b"Y15 I0 J10", b"Y15 R10.2"), "other.ngc")
    with pytest.raises(InputError, match=r"run.csv:\d+: the commands leave the path of other.ngc"):
        read_log(file, program=other, machine=MACHINE)


@pytest.mark.parametrize("skip", [0, 333])
def test_commands_come_from_the_program_at_the_time_that_fits(tmp_path, ran, skip, program):
    names = ("t", "X_act", "Y_act")
    log = read_log(put(tmp_path, part(ran, names, skip)), program=program, machine=MACHINE)
    true = ran[1 + skip :, ran[0].tolist().index("X_cmd")].astype(float) * 1e-3
    speed = np.abs(np.diff(true)).max() / log.period
    # within half a period: the drives of X and Y lag differently
    assert np.abs(log.axes["X"].command - true).max() < 0.5 * log.period * speed
    (warning,) = log.warnings
    assert warning.startswith("X_cmd, Y_cmd: from part.ngc, which begins ")
    assert warning.endswith("a delay of the readings cannot be seen")


def test_a_recorded_command_tells_the_time_of_the_others_exactly(tmp_path, ran, program):
    names = ("t", "X_cmd", "X_act", "Y_act")
    log = read_log(put(tmp_path, part(ran, names, 100)), program=program, machine=MACHINE)
    true = ran[101:, ran[0].tolist().index("Y_cmd")].astype(float) * 1e-3
    assert log.axes["Y"].command == pytest.approx(true, abs=1e-7)


def test_axes_that_the_machine_does_not_have_are_refused(tmp_path, ran):
    file = put(tmp_path, part(ran, ran[0]))
    with pytest.raises(InputError) as refusal:
        read_log(file, machine=read_machine("paper"))
    words = "the machine has no axis Z; is it a log of another machine?; expected X, Y; got X, Y, Z"
    assert str(refusal.value) == f"{file}:1: {words}"


def test_without_a_machine_the_program_is_not_compared(tmp_path, program):
    log = recorded(read_log(put(tmp_path, text()), program=program))
    assert log.warnings == ("without a machine the commands cannot be compared with part.ngc",)


def test_a_column_that_is_mapped_is_not_taken_under_its_own_name_too(tmp_path):
    axis = read_log(put(tmp_path, text()), columns=["X_motor=X_act:mm"]).axes["X"]
    assert axis.table is None
    assert axis.motor == pytest.approx((X - 0.01) * 1e-3, abs=1e-12)


@pytest.mark.parametrize(
    ("reading", "words"),
    [
        (X * 1e-3, "has another scale than X_cmd: is it in another unit?; expected a travel of 19.9956 mm"),
        (np.where(K % 2, 5.0, -5.0), "does not follow X_cmd: is it the same axis, program and sign?"),
    ],
)
def test_a_reading_of_something_else_is_refused(tmp_path, reading, words):
    rows = [(a, b, f"{x:.7f}") for (a, b, _), x in zip(ROWS, reading, strict=True)]
    with pytest.raises(InputError) as refusal:
        read_log(put(tmp_path, text(rows)))
    assert words in str(refusal.value)


@pytest.mark.parametrize(
    "reading",
    [np.zeros(300), np.round(X / 4) * 4, 1e-3 * (K % 2), np.roll(X, 10) * 0.9 + 0.5, X + 0.01 * K],
    ids=["still", "coarse", "noise only", "late", "drifting"],
)
def test_what_a_poor_reading_shows_is_left_to_others(tmp_path, reading):
    rows = [(a, b, f"{x:.6f}") for (a, b, _), x in zip(ROWS, reading, strict=True)]
    assert read_log(put(tmp_path, text(rows))).warnings == ()


def test_what_is_before_and_after_the_program_is_told(tmp_path, ran, program):
    lines = part(ran, ("X_cmd", "X_act", "Y_cmd", "Y_act")).split("\n")
    away = ["60,60,60,60"] * 100
    rows = [f"{k * 0.001:.3f},{line}" for k, line in enumerate(away + lines[1:] + away)]
    file = put(tmp_path, "\n".join(["t," + lines[0], *rows]))
    log = read_log(file, program=program, machine=MACHINE)
    assert log.warnings == ("200 samples before and after the path of part.ngc are not of this program",)


def test_what_simulate_writes_is_read_as_it_is(tmp_path, capsys):
    file = tmp_path / "run.csv"
    assert main(["simulate", "circle", "-m", "stepper", "--log", str(file)]) == 0
    capsys.readouterr()
    log = read_log(file, machine=read_machine("stepper"))
    assert (log.warnings, log.missing, set(log.axes)) == ((), 0, {"X", "Y"})
    assert log.remarks["made by"].startswith("ph-post ")
    assert all(axis.motor is not None and axis.table is not None for axis in log.axes.values())
