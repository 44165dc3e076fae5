"""`machines` and `machine new`: what they list, ask, refuse and write; broken interviews lose nothing."""

from __future__ import annotations

import io
import json
import os
import pty
import select
import signal
import subprocess
import sys
import tomllib
from itertools import product
from pathlib import Path

import pytest
from support.front_door import answered, run
from support.pipelines import PATIENCE, heeding_interrupts

from ph_post.cli.questions import QUESTIONS
from ph_post.dialects.registry import dialect_names
from ph_post.files.storage import shipped, shipped_names

KEYS = [question.key for question in QUESTIONS if not question.silent]
NEW = ("machine", "new")


# --- machines ---


def test_machines_are_listed_a_line_each(capsys):
    status, out, err = run(capsys, "machines")
    assert status == 0
    assert [line.split()[0] for line in out.splitlines()] == ["name", *shipped_names("machines")]
    stepper = next(line for line in out.splitlines() if line.startswith("stepper"))
    assert " ".join(stepper.split()) == "stepper none grbl X 0.060 Y 0.080 Z 0.030 stepper router"
    assert str(shipped("machines", "mill").parent) in err


def test_machines_in_json_say_what_the_files_say(capsys):
    status, out, _ = run(capsys, "machines", "--json")
    assert status == 0
    for one in json.loads(out)["machines"]:
        file = tomllib.loads(Path(one["file"]).read_text())
        assert (one["title"], one["dialect"]) == (file["name"], file["controller"]["dialect"])
        assert one["servo_period"] == file["controller"]["servo_period_ms"]
        for axis, keys in file["axes"].items():
            told = one["axes"][axis]
            assert told["feedback"] == keys["feedback"]
            assert told["max_velocity"] == pytest.approx(keys["max_velocity_mm_s"] * 60)
            assert told["max_acceleration"] == keys["max_acceleration_mm_s2"]
            if "lost_motion_mm" in keys:
                assert told["lost_motion"] == keys["lost_motion_mm"]


def test_a_copy_is_the_file_byte_for_byte_and_replaces_nothing(capsys, tmp_path):
    file = tmp_path / "mine.toml"
    assert run(capsys, "machines", "--copy", "router", str(file))[0] == 0
    assert file.read_bytes() == shipped("machines", "router").read_bytes()
    status, out, err = run(capsys, "machines", "--copy", "mill", str(file))
    assert (status, out) == (2, "")
    assert err == f"ph-post: {file}: is there already; expected --force, or another name\n"
    assert file.read_bytes() == shipped("machines", "router").read_bytes()
    assert run(capsys, "machines", "--copy", "mill", str(file), "--force")[0] == 0
    assert file.read_bytes() == shipped("machines", "mill").read_bytes()


def test_a_copy_of_nothing_names_what_there_is(capsys, tmp_path):
    status, _, err = run(capsys, "machines", "--copy", "roter", str(tmp_path / "a.toml"))
    assert (status, list(tmp_path.iterdir())) == (2, [])
    assert err == "ph-post: roter: no such file, and none of the shipped machines; expected router\n"


# --- machine new ---


def test_machine_alone_says_what_is_missing(capsys):
    status, out, err = run(capsys, "machine")
    assert (status, out, err) == (2, "", "ph-post: Missing command; see ph-post machine --help\n")


def test_defaults_give_a_machine_that_compensates_nothing_and_says_so(capsys, tmp_path):
    file = tmp_path / "mine.toml"
    status, out, err = run(capsys, *NEW, str(file), "--yes")
    assert (status, out) == (0, "")
    made = tomllib.loads(file.read_text())
    stepper = tomllib.loads(shipped("machines", "stepper").read_text())
    for axis in "XYZ":
        assert made["axes"][axis]["lost_motion_mm"] == 0
        for key in ("max_velocity_mm_s", "max_acceleration_mm_s2", "max_jerk_mm_s3", "b", "c"):
            assert made["axes"][axis][key] == stepper["axes"][axis][key]
    assert "warning: no lost motion of X, Y, Z" in err


def test_every_line_has_a_comment(capsys):
    for loop in ("load", "motor", "none"):
        _, out, _ = run(capsys, *NEW, "--yes", "--loop", loop)
        bare = [line for line in out.splitlines() if " = " in line and "#" not in line]
        assert bare == ['name = "my machine"']
        assert max(map(len, out.splitlines())) < 130


def test_what_a_pipe_answers_is_in_the_file(capsys, monkeypatch):
    answered(
        monkeypatch,
        "the old one",
        "x z",
        "scale",
        "linuxcnc",
        "0.002in 0.02",
        "5tpi; 5",
        "40:20 1",
        "200in/min 50mm/s",
        "500",
        "0.5 at 1000 30/s",
        "1kHz",
    )
    status, out, _ = run(capsys, *NEW)
    assert status == 0
    made = tomllib.loads(out)
    assert made["name"] == "the old one"
    assert made["controller"] == {"dialect": "linuxcnc", "servo_period_ms": 1.0}
    assert list(made["axes"]) == ["X", "Z"]
    X, Z = made["axes"]["X"], made["axes"]["Z"]
    assert (X["feedback"], Z["feedback"]) == ("load", "load")
    assert (X["lost_motion_mm"], Z["lost_motion_mm"]) == (0.0508, 0.02)
    assert (X["screw_lead_mm"], Z["screw_lead_mm"]) == (5.08, 5.0)
    assert (X["gear_ratio"], Z["gear_ratio"]) == (2.0, 1.0)
    assert X["max_velocity_mm_s"] == pytest.approx(200 * 25.4 / 60, rel=1e-6)
    assert Z["max_velocity_mm_s"] == 50.0
    assert (X["max_acceleration_mm_s2"], Z["max_acceleration_mm_s2"]) == (500.0, 500.0)
    # c = e / v: 0.5 mm at 1000/60 mm/s; and one over the gain
    assert X["c"] == pytest.approx(0.5 / (1000 / 60), rel=1e-6)
    assert Z["c"] == pytest.approx(1 / 30, rel=1e-6)
    # critically damped as the shipped mill: b = c²/4
    assert X["b"] == pytest.approx(X["c"] ** 2 / 4, rel=1e-6)


def test_questions_that_do_not_apply_are_not_asked(capsys, monkeypatch):
    answered(monkeypatch, "n", "X", "stepper", "", "0.1", "40mm/s", "250", "")
    status, out, _ = run(capsys, *NEW)
    assert status == 0
    made = tomllib.loads(out)
    planner = {"junction_deviation_mm": 0.01, "arc_tolerance_mm": 0.002}
    assert made["controller"] == {"dialect": "grbl", "servo_period_ms": 2.0, **planner}
    assert made["axes"]["X"]["lost_motion_mm"] == 0.1


def test_options_come_before_the_file_of_answers(capsys, tmp_path):
    file = tmp_path / "answers.toml"
    file.write_text(
        'axes = "XY"\nloop = "motor"\nlost_motion = {X = 0.1, Y = "4thou"}\nspeed = ["50mm/s", "3000mm/min"]\n'
    )
    status, out, _ = run(capsys, *NEW, "--yes", "--answers", str(file), "--loop", "Y=none X=motor", "--json")
    assert status == 0
    view = json.loads(out)
    axes = view["machine"]["axes"]
    assert [axes[axis]["feedback"] for axis in "XY"] == ["motor", "none"]
    assert [axes[axis]["lost_motion"] for axis in "XY"] == [0.1, 0.1016]
    assert [axes[axis]["max_velocity"] for axis in "XY"] == [3000.0, 3000.0]
    assert tomllib.loads(view["text"])["axes"]["Y"]["lost_motion_mm"] == 0.1016
    assert "lost_motion_mm" not in view["assumed"]["X"]
    assert "c" in view["assumed"]["X"]
    assert view["file"] is None
    # how far it lags behind, and how hard it accelerates
    assert len(view["warnings"]) == 2


def test_answers_may_be_standard_input(capsys, monkeypatch):
    stream = io.TextIOWrapper(io.BytesIO(b"lost_motion = 0.07\n"))
    monkeypatch.setattr(sys, "stdin", stream)
    status, out, _ = run(capsys, *NEW, "--yes", "--answers", "-")
    assert status == 0
    assert tomllib.loads(out)["axes"]["Z"]["lost_motion_mm"] == 0.07


# --- the controller's own settings ---

GRBL = """\
Grbl 1.1h ['$' for help]
$0=10
$13=0
$100=250.000
$110=2400.000
$111=1800.000
$112=600.000
$120=250.000
$121=200.000
$122=100.000
$130=300.000
ok
"""

LINUXCNC = """\
[EMC]
MACHINE = mill
[TRAJ]
COORDINATES = X Y Z
LINEAR_UNITS = inch
MAX_LINEAR_VELOCITY = 9
[EMCMOT]
SERVO_PERIOD = 500000   # half a millisecond
[HAL]
HALFILE = one.hal
HALFILE = two.hal
[AXIS_X]
MAX_VELOCITY = 4.0
MAX_ACCELERATION = 30.0
[JOINT_0]
MAX_VELOCITY = 3.5
MAX_ACCELERATION = 35.0
BACKLASH = 0.002
[JOINT_1]
MAX_VELOCITY = 2
MAX_ACCELERATION = 20
[JOINT_2]
max_velocity = 1
MAX_ACCELERATION = 10
"""


def test_grbls_settings_are_defaults_in_its_units(capsys, tmp_path):
    file = tmp_path / "settings.txt"
    file.write_text(GRBL)
    status, out, _ = run(capsys, *NEW, "--yes", "--settings", str(file), "--lost-motion", "0.1", "--axes", "XZ")
    assert status == 0
    made = tomllib.loads(out)
    assert made["controller"]["dialect"] == "grbl"
    assert {axis: keys["max_velocity_mm_s"] for axis, keys in made["axes"].items()} == {"X": 40.0, "Z": 10.0}
    assert [keys["max_acceleration_mm_s2"] for keys in made["axes"].values()] == [250.0, 100.0]
    line = next(line for line in out.splitlines() if line.startswith("max_velocity"))
    assert "assumed" not in line
    # an answer comes before a setting
    status, out, _ = run(capsys, *NEW, "--yes", "--settings", str(file), "--speed", "X=50mm/s Y=1mm/s Z=1mm/s")
    assert tomllib.loads(out)["axes"]["X"]["max_velocity_mm_s"] == 50.0


def test_linuxcncs_settings_are_defaults_in_its_units(capsys, monkeypatch, tmp_path):
    file = tmp_path / "mill.ini"
    file.write_text(LINUXCNC)
    answered(monkeypatch, "", "", "motor", *[""] * 7)
    status, out, err = run(capsys, *NEW, "--settings", str(file))
    assert status == 0
    made = tomllib.loads(out)
    assert made["controller"] == {"dialect": "linuxcnc", "servo_period_ms": 0.5}
    # the smaller one of axis and joint, in inches
    assert [keys["max_velocity_mm_s"] for keys in made["axes"].values()] == [88.9, 50.8, 25.4]
    assert [keys["max_acceleration_mm_s2"] for keys in made["axes"].values()] == [762.0, 508.0, 254.0]
    # backlash is said for one axis alone: that of the others is not guessed
    assert made["axes"]["X"]["lost_motion_mm"] == 0
    assert "no lost motion of X, Y, Z" in err
    status, out, err = run(capsys, *NEW, "--settings", str(file), "--axes", "X", "--yes")
    assert tomllib.loads(out)["axes"]["X"]["lost_motion_mm"] == 0.0508
    assert "no lost motion" not in err
    assert f"warning: {file} has BACKLASH of X: the controller compensates too; set it to 0 there" in err


def test_an_axis_without_gains_in_the_settings_is_named(capsys, tmp_path):
    # The INI of a retrofit whose second joint was forgotten: Y got the gains of a shipped machine.
    file = tmp_path / "mill.ini"
    joints = "".join(f"[AXIS_{axis}]\nMAX_VELOCITY = 50\nMAX_ACCELERATION = 500\n" for axis in "XYZ")
    gains = "".join(f"[JOINT_{number}]\nP = 60\nFF1 = 1\n" for number in (0, 2))
    file.write_text(f"[TRAJ]\nCOORDINATES = XYZ\nLINEAR_UNITS = mm\n{joints}{gains}")
    _, out, err = run(capsys, *NEW, "--yes", "--loop", "motor", "--settings", str(file))
    assert [("b" in keys) for keys in tomllib.loads(out)["axes"].values()] == [False, True, False]
    assert "warning: nobody said how far Y lags behind: b and c there are those of another machine" in err


def test_what_decides_and_was_assumed_is_said(capsys):
    # A Marlin printer got the 40 mm/s of a router without a word, a cascade with feed-forward a loop that overshoots.
    limits = ("--speed", "200mm/s", "--acceleration", "1000")
    _, _, err = run(capsys, *NEW, "--yes", "--loop", "none", "--dialect", "marlin")
    assert "warning: nobody said how fast X, Y, Z may move and accelerate" in err
    _, _, err = run(capsys, *NEW, "--yes", "--loop", "none", "--dialect", "marlin", *limits)
    assert "nobody said how" not in err
    drive = ("--loop", "motor", "--position-gain", "2m/min/mm", "--feedforward", "90%", *limits)
    _, _, err = run(capsys, *NEW, "--yes", *drive)
    assert "warning: nobody said how quick the velocity loop of X, Y, Z is" in err
    assert "deadband" not in err
    # Of a drive without one, whose INI file has DEADBAND = 0.001, diagnose named K_v 390/s for 60.
    _, _, err = run(capsys, *NEW, "--yes", *drive, "--deadband", "0.001mm")
    assert "warning: the deadband of X, Y, Z counts as certain" in err
    _, _, err = run(capsys, *NEW, "--yes", *drive, "--velocity-gain", "250/s")
    assert "nobody said how" not in err


def test_the_planner_is_that_of_the_settings_or_else_the_firmwares(capsys, tmp_path):
    def controller(*arguments, text=""):
        file = tmp_path / "settings.txt"
        file.write_text(text)
        _, out, _ = run(capsys, *NEW, "--yes", *(["--settings", str(file)] if text else []), *arguments)
        return {key: value for key, value in tomllib.loads(out)["controller"].items() if key.count("_mm")}

    grbl = GRBL.replace("$13=0", "$11=0.020\n$12=0.005\n$13=0")
    assert controller(text=grbl) == {"junction_deviation_mm": 0.02, "arc_tolerance_mm": 0.005}
    assert controller(text=GRBL) == {"junction_deviation_mm": 0.01, "arc_tolerance_mm": 0.002}
    assert controller("--dialect", "marlin", text=grbl) == {"junction_deviation_mm": 0.013, "arc_segment_mm": 1.0}
    assert controller("--dialect", "klipper") == {"square_corner_velocity_mm_s": 5.0, "arc_resolution_mm": 1.0}
    startup = LINUXCNC.replace("[HAL]", "[RS274NGC]\nRS274NGC_STARTUP_CODE = G20 G64 P0.001\n[HAL]")
    assert controller(text=startup) == {"path_tolerance_mm": 0.0254}
    assert controller(text=LINUXCNC) == {}


def test_the_axes_are_those_of_the_settings(capsys, tmp_path):
    # a lathe, and a gantry with two motors on Y, whose Z is its fourth joint
    for coordinates, axes in (("XZC", {"X": 5.0, "Z": 4.0}), ("X Y Y Z", {"X": 5.0, "Y": 4.0, "Z": 2.0})):
        file = tmp_path / "machine.ini"
        joints = "".join(
            f"[JOINT_{joint}]\nMAX_VELOCITY = {5 - joint}\nMAX_ACCELERATION = {50 - joint}\n"
            for joint in range(len(coordinates.replace(" ", "")))
        )
        file.write_text(f"[TRAJ]\nCOORDINATES = {coordinates}\nLINEAR_UNITS = mm\n{joints}")
        _, out, _ = run(capsys, *NEW, "--yes", "--settings", str(file))
        made = tomllib.loads(out)["axes"]
        assert {axis: keys["max_velocity_mm_s"] for axis, keys in made.items()} == axes


@pytest.mark.parametrize(
    ("text", "line"),
    [
        (
            "#INCLUDE other.inc\n[FILTER]\nngc = cat",
            "no settings of a controller; expected a listing of Grbl's $$, or LinuxCNC's .ini or .hal file; "
            "got a file that includes others, which are not read",
        ),
        ("G1 X1", "no settings of a controller; expected a listing of Grbl's $$, or LinuxCNC's .ini or .hal file"),
        ("$110=1.2.3", "$110: no number; expected a number; got '1.2.3'"),
        (
            "[TRAJ]\nCOORDINATES = X\n[AXIS_X]\nMAX_VELOCITY = fast",
            "[AXIS_X] MAX_VELOCITY: no number; expected a number; got 'fast'",
        ),
        (
            "[TRAJ]\nCOORDINATES = X\n[JOINT_0]\nP = 1\n[EMCMOT]\nSERVO_PERIOD = nan",
            "[EMCMOT] SERVO_PERIOD: no number; expected a number; got 'nan'",
        ),
        (
            "[TRAJ]\nCOORDINATES = XY\n[JOINT_0]\nMAX_VELOCITY = 5\nMAX_ACCELERATION = 50",
            "no [JOINT_1] and no [AXIS_Y], which Y needs; expected one of them, with MAX_VELOCITY and "
            "MAX_ACCELERATION, or [TRAJ] COORDINATES without Y",
        ),
        (
            "#INCLUDE joints.inc\n[EMCMOT]\nSERVO_PERIOD = 1000000",
            "no [JOINT_0] and no [AXIS_X], which X needs; expected one of them, with MAX_VELOCITY and "
            "MAX_ACCELERATION, or [TRAJ] COORDINATES without X; got a file that includes others, which are not read",
        ),
    ],
)
def test_bad_settings_name_the_place(capsys, tmp_path, text, line):
    file = tmp_path / "settings.txt"
    file.write_text(text)
    status, out, err = run(capsys, *NEW, "--yes", "--settings", str(file))
    assert (status, out, err) == (2, "", f"ph-post: {file}: {line}\n")


def test_a_setting_out_of_bounds_is_refused_like_an_answer(capsys, tmp_path):
    file = tmp_path / "settings.txt"
    file.write_text(GRBL.replace("$110=2400.000", "$110=0"))
    status, out, err = run(capsys, *NEW, "--yes", "--settings", str(file))
    assert (status, out) == (2, "")
    assert err.startswith("ph-post: --settings, speed: out of range; expected a speed with its unit")


# --- broken interviews ---

BAD = {
    "axes": ["A", "XX", "XYZU", "12"],
    "loop": ["glas", "load load", "1", "X=load"],
    "dialect": ["gerbl", "linuxcnc grbl"],
    "lost_motion": [
        "-0.1",
        "eleven",
        "11",
        "0,03",
        "nan",
        "inf",
        "1e999",
        "0.1 0.1",
        "X=1",
        "5 kg",
        "A=1 Y=1 Z=1",
        "=",
    ],
    "lead": ["-5", "0", "0.01", "5 tip", "1e6", "five"],
    "gear": ["-2", "0", "2:0", "1:2:3", "two"],
    "speed": ["100", "-5mm/s", "0mm/s", "1e9mm/s", "fast", "10 mph"],
    "acceleration": ["0", "-1", "1e9", "hard"],
    "following_error": ["0.4", "0.4 at", "0 at 1000", "-0.4 at 1000", "100 at 1", "0/s", "-40/s"],
    "servo_period": ["0", "-1", "1e6", "often", "1 2"],
}


@pytest.mark.parametrize(("key", "text"), [(key, text) for key, texts in BAD.items() for text in texts])
def test_a_bad_answer_is_one_line_and_writes_nothing(capsys, monkeypatch, tmp_path, key, text):
    file = tmp_path / "mine.toml"
    option = "--" + key.replace("_", "-")
    loop = () if key == "loop" else ("--loop", "load")
    status, out, err = run(capsys, *NEW, str(file), "--yes", *loop, option, text)
    assert (status, out, list(tmp_path.iterdir())) == (2, "", [])
    assert err.startswith(f"ph-post: {option}: ")
    assert "; expected " in err
    assert "; got " in err
    assert err.count("\n") == 1
    # the same as a line of a pipe
    lines = ["", "", "load" if key != "loop" else text][: KEYS.index(key)]
    lines += [""] * (KEYS.index(key) - len(lines))
    answered(monkeypatch, *lines, text)
    status, out, err = run(capsys, *NEW, str(file))
    assert (status, out, list(tmp_path.iterdir())) == (2, "", [])
    assert err.startswith(f"ph-post: standard input, {key}: ")
    assert err.count("\n") == 1


@pytest.mark.parametrize("count", range(len(KEYS)))
def test_an_input_that_ends_early_is_told_and_writes_nothing(capsys, monkeypatch, tmp_path, count):
    lines = ["", "", "load", *[""] * len(KEYS)][:count]
    answered(monkeypatch, *lines)
    status, out, err = run(capsys, *NEW, str(tmp_path / "mine.toml"))
    assert (status, out, list(tmp_path.iterdir())) == (2, "", [])
    assert err == (
        f"ph-post: standard input, {KEYS[count]}: no answer; expected a line, or --yes for defaults; "
        "got the end of the input\n"
    )


def test_an_answer_that_is_no_text_is_told(capsys, monkeypatch):
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(b"\xff\n"), encoding="utf-8"))
    status, out, err = run(capsys, *NEW)
    assert (status, out) == (2, "")
    assert err == "ph-post: standard input, name: not text; expected UTF-8; got byte 0xff\n"


def test_the_answer_to_a_question_of_another_machine_is_refused(capsys):
    status, _, err = run(capsys, *NEW, "--yes", "--loop", "none", "--lead", "5")
    assert (status, err) == (
        2,
        "ph-post: --lead: not used by a machine with these loops; expected it left out; got '5'\n",
    )


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("lostmotion = 1", "lostmotion: no such question; expected lost_motion"),
        (
            "lost_motion = true",
            "lost_motion: wrong type; expected a text, a number, or one by axis; got bool",
        ),
        ("lost_motion = {}", "lost_motion: not understood; expected a length from 0 to 10 mm; got ''"),
        ("lost_motion = []", "lost_motion: not understood; expected a length from 0 to 10 mm; got ''"),
        ("lost_motion = nan", "lost_motion: not understood; expected a length from 0 to 10 mm; got 'nan'"),
        ("lost_motion", "not valid TOML: "),
        ("", "the file is empty"),
    ],
)
def test_a_bad_file_of_answers_names_the_place(capsys, tmp_path, text, line):
    file = tmp_path / "answers.toml"
    file.write_text(text)
    status, out, err = run(capsys, *NEW, "--yes", "--answers", str(file))
    assert (status, out) == (2, "")
    assert err.startswith(f"ph-post: {file}: {line}")
    assert err.count("\n") == 1


def test_a_file_that_is_there_stays_and_nobody_is_asked(capsys, monkeypatch, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text("precious")
    monkeypatch.setattr(sys, "stdin", None)
    status, _, err = run(capsys, *NEW, str(file))
    assert (status, err) == (2, f"ph-post: {file}: is there already; expected --force, or another name\n")
    assert file.read_text() == "precious"
    assert run(capsys, *NEW, str(file), "--yes", "--force")[0] == 0
    assert file.read_text() != "precious"


@pytest.mark.parametrize("name", ["no/such/folder/mine.toml", ".", ""])
def test_a_place_that_cannot_be_written_is_told_before_any_question(capsys, monkeypatch, tmp_path, name):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "stdin", None)
    status, out, err = run(capsys, *NEW, name)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert "cannot be written" in err or "no file to write" in err or "is there already" in err
    assert list(tmp_path.iterdir()) == []


# --- at a terminal ---


class Terminal:
    """The command at a terminal of its own: what is typed there, and what stands on it."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.master, slave = pty.openpty()
        with heeding_interrupts():
            self.process = subprocess.Popen(
                [sys.executable, "-m", "ph_post", *NEW, *arguments],
                stdin=slave,
                stdout=subprocess.PIPE,
                stderr=slave,
                cwd=folder,
                start_new_session=True,
                env={**os.environ, "PYTHONPATH": str(Path(__file__).resolve().parents[2])},
            )
        os.close(slave)
        self.screen = ""

    def wait_for(self, text: str, since: int = 0) -> None:
        """Read until `text` stands on the screen."""
        while text not in self.screen[since:]:
            ready, _, _ = select.select([self.master], [], [], PATIENCE)
            assert ready, f"{text!r} did not come: {self.screen!r}"
            try:
                read = os.read(self.master, 4096)
            except OSError:
                read = b""
            assert read, f"{text!r} never came: {self.screen!r}"
            self.screen += read.decode()

    def answer(self, text: str, then: str) -> None:
        """Type a line, and wait for what follows."""
        since = len(self.screen)
        os.write(self.master, f"{text}\n".encode())
        self.wait_for(then, since)

    def end(self) -> tuple[int, str]:
        """Return exit status and standard output."""
        out, _ = self.process.communicate(timeout=60)
        os.close(self.master)
        return self.process.returncode, out.decode()


def test_at_a_terminal_a_bad_answer_is_asked_again(tmp_path):
    terminal = Terminal(tmp_path, "mine.toml")
    terminal.wait_for("[my machine]")
    assert "Ctrl-C writes nothing" in terminal.screen
    terminal.answer("shop router", "[XYZ]")
    terminal.answer("Q", "axes: no such axes; expected one to three of X, Y, Z; got 'Q'")
    terminal.wait_for("[XYZ] ", terminal.screen.index("got 'Q'"))
    terminal.answer("XY", "[none]")
    terminal.answer("glass scale maybe", "[none]")
    terminal.answer("motor", "[linuxcnc]")
    terminal.answer("", "Dial indicator")
    terminal.answer("a lot", "expected a length from 0 to 10 mm")
    terminal.answer("0.12 0.003in", "MAX_VELOCITY")
    terminal.answer("120", "the unit is missing")
    terminal.answer("120mm/s", "MAX_ACCELERATION")
    terminal.answer("", "f-error")
    terminal.answer("0.28 at 1000", "[1ms]")
    terminal.answer("", "wrote mine.toml")
    assert terminal.end() == (0, "")
    made = tomllib.loads((tmp_path / "mine.toml").read_text())
    assert made["name"] == "shop router"
    assert [made["axes"][axis]["lost_motion_mm"] for axis in "XY"] == [0.12, 0.0762]
    assert made["axes"]["X"]["c"] == pytest.approx(0.28 / (1000 / 60), rel=1e-6)


def test_the_end_of_a_terminal_writes_nothing(tmp_path):
    terminal = Terminal(tmp_path, "mine.toml")
    terminal.wait_for("[my machine]")
    terminal.answer("", "[XYZ]")
    os.write(terminal.master, b"\x04")
    terminal.wait_for("got the end of the input")
    assert "[XYZ] \r\nph-post: standard input, axes: no answer" in terminal.screen
    assert terminal.end() == (2, "")
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_writes_nothing(tmp_path):
    terminal = Terminal(tmp_path, "mine.toml")
    terminal.wait_for("[my machine]")
    terminal.answer("", "[XYZ]")
    terminal.process.send_signal(signal.SIGINT)
    terminal.wait_for("interrupted; nothing more was written")
    assert terminal.end() == (130, "")
    assert list(tmp_path.iterdir()) == []


def test_a_file_that_comes_up_meanwhile_stays_and_no_answer_is_lost(tmp_path):
    terminal = Terminal(tmp_path, "mine.toml", "--axes", "X", "--loop", "none", "--dialect", "grbl")
    terminal.wait_for("[my machine]")
    (tmp_path / "mine.toml").write_text("precious")
    terminal.answer("the only one", "Dial indicator")
    terminal.answer("0.0712", "$110")
    terminal.answer("", "$120")
    terminal.answer("", "[2ms]")
    terminal.answer("", "is there already")
    status, out = terminal.end()
    assert status == 2
    assert (tmp_path / "mine.toml").read_text() == "precious"
    assert tomllib.loads(out)["axes"]["X"]["lost_motion_mm"] == 0.0712


# --- the machine that was written works at once ---


@pytest.mark.thinned(28)
@pytest.mark.parametrize(("dialect", "loop"), list(product(dialect_names(), ("load", "motor", "none"))))
def test_a_new_machine_works_at_once(capsys, tmp_path, loop, dialect):
    file, program = str(tmp_path / "mine.toml"), tmp_path / "oval.ngc"
    described = ("--loop", loop, "--dialect", dialect, "--lost-motion", "0.05")
    assert run(capsys, *NEW, file, "--yes", *described)[0] == 0
    assert run(capsys, "inspect", "oval", "-m", file)[0] == 0
    suppress = ("--strategy", "suppress")
    status, _, err = run(capsys, "convert", "oval", "-m", file, *suppress, "-o", str(program))
    assert status == 0, err
    assert program.stat().st_size > 0
    status, out, _ = run(capsys, "simulate", "oval", "-m", file, *suppress, "--json")
    assert status == 0
    assert 0 < json.loads(out)["error"]["max"] < 0.2
    assert run(capsys, "calibrate", "-m", file, "-o", str(tmp_path / "kit"))[0] == 0
    assert (tmp_path / "kit" / "plan.md").is_file()


def test_an_axis_that_shall_not_be_compensated_is_named_and_has_no_lost_motion(tmp_path, capsys):
    part = tmp_path / "part.ngc"
    part.write_text("G21 G90 G61\nG0 X0 Y0 Z5\nG1 Z-1 F300\nG1 X20 F600\nG1 Y20\nG1 X0\nG1 Y0\nG0 Z5\nM2\n")
    (question,) = [one for one in QUESTIONS if one.key == "axes"]
    # Who leaves Z out as it needs no compensation has a file for which no program with Z is compensated.
    assert "move" in question.ask
    assert "without lost motion is left alone" in question.hint
    for axes, lost, status in (("XY", "0.1 0.06", 2), ("XYZ", "0.1 0.06 0", 0)):
        file = tmp_path / f"{axes}.toml"
        asked = ["--yes", "--loop", "none", "--dialect", "linuxcnc", "--axes", axes, "--lost-motion", lost]
        assert run(capsys, "machine", "new", file, *asked)[0] == 0
        found, _, err = run(capsys, "convert", part, "-m", file, "-o", tmp_path / "out.ngc")
        assert found == status
    assert "X, Y compensated" in err
    lines = (tmp_path / "out.ngc").read_text().splitlines()
    words = [word for line in lines if not line.startswith("(") for word in line.split()]
    assert {word for word in words if word[0] == "Z"} == {"Z5", "Z-1"}
