"""``identify`` on the command line: what it reads, writes and says, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from support.streams import without_progress

from ph_post.cli.main import main
from ph_post.drive.machinefile import read_machine
from ph_post.identify import identify as identifying
from tests.support.identifying import Recorder, to_and_fro
from tests.support.plants.axis import Plant

ROOT = Path(__file__).resolve().parents[2]
MILL = ROOT / "samples" / "machines" / "mill.toml"
LOAD = Plant("load", 1.5e-4, 8e-3, gap=3e-5, eta=0.55, beta=2.0)
MOTOR = Plant("motor", 1.5e-4, 8e-3, gap=3e-5)


def run(capsys, *arguments):
    status = main([str(one) for one in arguments])
    streams = capsys.readouterr()
    err = [line for line in without_progress(streams.err).splitlines() if "compiling" not in line]
    return status, streams.out, "\n".join(err)


def write(path: Path, plant: Plant, *channels: str) -> Path:
    rng = np.random.default_rng(1)
    log = Recorder(channels, rng).record(plant, to_and_fro(rng))
    axis = log.axes["X"]
    columns = {"t": log.t, "X_cmd": axis.command * 1e3}
    if axis.table is not None:
        columns["X_act"] = axis.table * 1e3
    if axis.motor is not None:
        columns["X_motor"] = axis.motor * 1e3
    np.savetxt(path, np.column_stack(list(columns.values())), "%.7f", ",", header=",".join(columns), comments="")
    return path


@pytest.fixture(scope="module")
def motor_log(tmp_path_factory):
    return write(tmp_path_factory.mktemp("motor") / "run.csv", MOTOR, "act", "motor")


@pytest.fixture(scope="module")
def load_log(tmp_path_factory):
    return write(tmp_path_factory.mktemp("load") / "run.csv", LOAD, "act")


def test_a_new_machine_file_reads_back(capsys, motor_log, tmp_path):
    made = tmp_path / "machine.toml"
    status, out, err = run(capsys, "identify", motor_log, "--feedback", "motor", "-o", made)
    assert (status, err) == (0, f"wrote {made}")
    assert out.splitlines()[1].split()[:2] == ["X", "b"]
    axis = read_machine(made).axes["X"]
    assert axis.feedback == "motor"
    assert axis.servo.b == pytest.approx(MOTOR.b, rel=0.01)
    assert axis.servo.c == pytest.approx(MOTOR.c, rel=0.01)
    assert axis.gap.lost_motion == pytest.approx(MOTOR.gap, rel=0.01)
    assert axis.uncertainty.backlash < 0.02
    lines = made.read_text(encoding="utf-8").splitlines()
    assert lines[0].startswith("# Identified from run (sha256 ")
    for key, unit in (("b", "s²"), ("c", "s"), ("lost_motion_mm", "mm")):
        row = next(line for line in lines if line.startswith(f"{key} = "))
        assert "  # +- " in row
        assert row.endswith(f" {unit}")
    assert "# limits: the largest values in the log; replace them by the machine's" in lines


def test_limits_of_a_new_file_are_what_the_command_reached(capsys, motor_log, tmp_path):
    made = tmp_path / "machine.toml"
    assert run(capsys, "identify", motor_log, "--feedback", "X=motor", "-o", made)[0] == 0
    command = np.loadtxt(motor_log, delimiter=",", skiprows=1)[:, 1] * 1e-3
    speed = np.max(np.abs(np.diff(command))) / 1e-3
    gain = np.max(np.abs(np.diff(command, 2))) / 1e-6
    limits = read_machine(made).axes["X"].limits
    assert limits.velocity == pytest.approx(speed, rel=0.01)
    assert limits.acceleration == pytest.approx(gain, rel=0.05)


def test_the_persons_file_keeps_its_words(capsys, load_log):
    status, out, err = run(capsys, "identify", load_log, "-m", MILL, "-o", "-")
    assert status == 0
    rows = out.splitlines()
    original = MILL.read_text(encoding="utf-8").splitlines()
    changed = [row for row in rows if row not in original]
    keys = {row.split(" = ")[0] for row in changed if not row.startswith("#")}
    assert (
        {"b", "c", "lost_motion_mm"}
        <= keys
        <= {
            "b",
            "c",
            "lost_motion_mm",
            "backlash_uncertainty",
            "gain_uncertainty",
        }
    )
    row = next(row for row in changed if row.startswith("lost_motion_mm"))
    assert "indicator against the scale" in row
    assert "+- " in row
    assert any(row.startswith("# identified from run (sha256 ") for row in changed)
    assert "η times the lost motion is 0.016" in err  # standard output takes the file
    assert "Y: nothing was identified" in err


def test_json_has_parameters_and_what_the_record_tells_apart(capsys, load_log):
    status, out, _ = run(capsys, "identify", load_log, "--feedback", "load", "--json")
    view = json.loads(out)
    assert status == 0
    assert view["axes"]["X"]["b"]["unit"] == "s²"
    assert view["axes"]["X"]["lost_motion"]["stderr"] is None
    seen = view["identifiability"]["X"]
    assert seen["parameters"] == ["b", "c", "gap", "eta", "beta"]
    assert seen["rank"] < len(seen["singular_values"]) == 5
    assert {"gap", "eta"} in [set(one) for one in seen["not_separated"]]
    assert view["fit"]["X"]["rms"] == pytest.approx(view["fit"]["X"]["noise_floor"], rel=0.2)
    assert view["warnings"] == []


def test_a_load_loop_needs_its_transmission_in_a_new_file(capsys, load_log, tmp_path, monkeypatch):
    made = tmp_path / "machine.toml"
    with monkeypatch.context() as unfitted:  # said before the work of half a minute, and not behind it
        unfitted.setattr(identifying, "_identify_axis", pytest.fail)
        status, out, err = run(capsys, "identify", load_log, "--feedback", "load", "-o", made)
    assert (status, out) == (2, "")
    assert err == (
        'ph-post: run: X: a machine file with feedback "load" needs gear ratio and travel; expected '
        "--gear-ratio and --screw-lead, or a machine file with -m"
    )
    assert not made.exists()
    given = ("--gear-ratio", 2, "--screw-lead", 5)
    assert run(capsys, "identify", load_log, "--feedback", "load", *given, "-o", made)[0] == 0
    gap = read_machine(made).axes["X"].gap
    assert gap.gear_ratio == 2.0
    assert gap.travel_per_rad == pytest.approx(5e-3 / (2.0 * np.pi), rel=1e-6)
    assert gap.inertia_fraction == 0.5
    assert gap.lost_motion * 0.5 == pytest.approx(LOAD.gap * LOAD.eta, rel=0.02)
    assert "only that shows" in made.read_text(encoding="utf-8")


LOOPS = "Invalid value for '--feedback': expected load, motor or none, or AXIS=one of them; got "


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (("--feedback", "table"), f"{LOOPS}'table'"),
        (("--feedback", "Q=load"), f"{LOOPS}'Q=load'"),
        (
            ("--feedback", "load", "--feedback", "motor"),
            "Invalid value for '--feedback': one feedback an axis; got two for all",
        ),
        (("--gear-ratio", "2"), "--gear-ratio and --screw-lead go together; got one of them"),
        (
            ("-m", MILL, "--gear-ratio", "2"),
            "with -m the machine file gives gear ratio and lead; got --gear-ratio",
        ),
    ],
)
def test_wrong_options_are_refused_in_one_line(capsys, load_log, given, words):
    status, out, err = run(capsys, "identify", load_log, *given)
    assert (status, out) == (2, "")
    assert err == f"ph-post: {words}; see ph-post identify --help"


def test_a_feedback_other_than_the_files_is_refused(capsys, load_log):
    status, _, err = run(capsys, "identify", load_log, "-m", MILL, "--feedback", "motor")
    assert status == 2
    assert err == "ph-post: --feedback X=motor: the machine file says another; expected load; got motor"


@pytest.mark.parametrize(
    ("readings", "words"),
    [
        (
            np.zeros(3000),
            "no reading changes from the first sample to the last: nothing was measured",
        ),
        (None, "no position was recorded; expected X_act or X_motor [mm]"),
    ],
)
def test_a_record_that_shows_nothing_is_refused(capsys, tmp_path, readings, words):
    t = np.arange(3000) * 1e-3
    columns = {"t": t, "X_cmd": 10.0 * np.sin(2.0 * np.pi * t)}
    if readings is not None:
        columns["X_act"] = readings
    file = tmp_path / "still.csv"
    np.savetxt(file, np.column_stack(list(columns.values())), "%.6f", ",", header=",".join(columns), comments="")
    status, out, err = run(capsys, "identify", file, "-o", tmp_path / "m.toml")
    assert (status, out) == (2, "")
    assert words in err
    assert not (tmp_path / "m.toml").exists()
