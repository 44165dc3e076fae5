"""``ph-post calibrate``: a folder of programs and a plan, whole or not at all."""

import json
import shlex
from pathlib import Path

import pytest
from support import front_door

from ph_post.cli.main import main
from ph_post.gcode.read import read_program

NAMES = [
    "mix",
    "ladder_x",
    "sweep_x",
    "speed_x",
    "fast_x",
    "ladder_y",
    "sweep_y",
    "speed_y",
    "fast_y",
    "circles_xy",
    "diagonals_xy",
    "warm_up",
]


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    return front_door.run(capsys, "calibrate", *arguments)


def test_it_writes_programs_and_a_plan(capsys, tmp_path):
    folder = tmp_path / "kit"
    status, out, err = run(capsys, "-m", "mill", "-o", str(folder))
    assert status == 0
    assert err == f"wrote 12 programs and {folder / 'plan.md'}: read that first\n"
    assert [line.split(":")[0] for line in out.splitlines()] == [str(folder / f"{name}.ngc") for name in NAMES]
    assert sorted(place.name for place in folder.iterdir()) == sorted([*(f"{n}.ngc" for n in NAMES), "plan.md"])
    for name in NAMES:
        read_program((folder / f"{name}.ngc").read_bytes(), name, strict=True)


def test_the_plan_has_a_line_that_judges_each_log(capsys, tmp_path):
    folder = tmp_path / "my kit"
    run(capsys, "-m", "mill", "-o", str(folder))
    plan = (folder / "plan.md").read_text()
    for name in NAMES:
        assert f"### {name}.ngc" in plan
        assert f"ph-post diagnose '{folder / name}.txt' -m mill --column" in plan
    assert plan.count("--column X_cmd=2:mm") == 8
    # Where the line above is typed, diagnose finds the log: it was written beside the kit, not into it.
    written = [
        shlex.split(line.strip("- `"))[-1] for line in plan.splitlines() if line.startswith("- `halsampler -t -n ")
    ]
    assert written == [str(folder / f"{name}.txt") for name in NAMES]
    assert "Coast-down (X, Y, Z)" in plan
    assert "BACKLASH" in plan


def test_programs_have_the_ending_of_their_dialect(capsys, tmp_path):
    machine = tmp_path / "other.toml"
    assert main(["machines", "--copy", "mill", str(machine)]) == 0
    machine.write_text(machine.read_text().replace('dialect = "linuxcnc"', 'dialect = "fanuc"'))
    capsys.readouterr()
    status, _, _ = run(capsys, "-m", str(machine), "-o", str(tmp_path / "kit"))
    assert status == 0
    assert sorted(place.suffix for place in (tmp_path / "kit").iterdir()) == [".md", *[".nc"] * len(NAMES)]
    assert "`mix.nc` alone is a good beginning" in (tmp_path / "kit" / "plan.md").read_text()


def test_a_controller_without_a_recorder_gets_the_program_beside_the_log(capsys, tmp_path):
    folder = tmp_path / "kit"
    run(capsys, "-m", "stepper", "-o", str(folder))
    plan = (folder / "plan.md").read_text()
    line = f"ph-post diagnose {folder / 'mix.csv'} -m stepper --program {folder / 'mix.ngc'}"
    assert f"{line} -o {folder / 'better_mix.toml'}" in plan
    assert "halsampler" not in plan
    assert "Coast-down" not in plan


def test_json_tells_what_the_plan_tells(capsys, tmp_path):
    status, out, _ = run(capsys, "-m", "router", "-o", str(tmp_path / "kit"), "--json")
    assert status == 0
    view = json.loads(out)
    assert (view["folder"], view["plan"]) == (str(tmp_path / "kit"), "plan.md")
    assert [(one["name"], one["file"]) for one in view["programs"]] == [(name, f"{name}.ngc") for name in NAMES]
    assert all(one["why"] and one["record"] for one in view["programs"])


def test_room_and_feeds_are_those_asked_for(capsys, tmp_path):
    where = (
        "--axes",
        "x,z",
        "--centre",
        "150,-40",
        "--travel",
        "120,30",
        "--radius",
        "12",
        "--feeds",
        "900,300",
    )
    status, _, _ = run(capsys, "-m", "mill", "-o", str(tmp_path), *where)
    assert status == 0
    text = (tmp_path / "circles_xz.ngc").read_text()
    assert "moves X from 90 to 210, Z from -55 to -25 mm" in " ".join(text.split()).replace(") ( ", " ")
    assert "G2 X162 Z-40 I-12 K0 F300" in text
    assert "F900" in text


def test_the_same_again_changes_nothing_and_others_are_kept(capsys, tmp_path):
    arguments = ("-m", "mill", "-o", str(tmp_path))
    run(capsys, *arguments)
    before = {place.name: place.read_bytes() for place in tmp_path.iterdir()}
    assert run(capsys, *arguments)[0] == 0
    (tmp_path / "fast_y.ngc").write_text("my own\n")
    status, out, err = run(capsys, *arguments, "--centre", "5,5")
    assert (status, out) == (2, "")
    told = "is there already and holds something else; expected --force, or another folder"
    assert err == f"ph-post: {tmp_path / 'mix.ngc'}: {told}\n"
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == {**before, "fast_y.ngc": b"my own\n"}
    assert run(capsys, *arguments, "--force")[0] == 0
    assert {p.name: p.read_bytes() for p in tmp_path.iterdir()} == before


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (
            ("--radius", "60"),
            "--radius: the circles leave the travel; expected 0.5 mm up to 50 mm, half of the travel; got 60 mm",
        ),
        (
            ("--feeds", "600,9000"),
            "--feeds: the feed exceeds the machine's limit; expected up to 6000 mm/min; got 9000 mm/min",
        ),
        (("--axes", "X,A"), "--axes: the machine has no such axis; expected X or Y or Z; got 'A'"),
        (
            ("--centre", "1,b"),
            "Invalid value for '--centre': expected numbers separated by commas; got '1,b';"
            " see ph-post calibrate --help",
        ),
        (("--warm-up", "0"), "--warm-up: the warm-up time is out of range; expected minutes, above 0 up to 120; got 0"),
        (("-o", "-"), "-o takes a folder; got '-'; see ph-post calibrate --help"),
    ],
)
def test_bad_options_are_one_line_and_write_nothing(capsys, tmp_path, monkeypatch, words, expected):
    monkeypatch.chdir(tmp_path)
    assert run(capsys, "-m", "mill", *words) == (2, "", f"ph-post: {expected}\n")
    assert list(tmp_path.iterdir()) == []


def test_a_file_where_the_folder_should_be_is_told(capsys, tmp_path):
    (tmp_path / "kit").write_text("")
    status, _, err = run(capsys, "-m", "mill", "-o", str(tmp_path / "kit"))
    assert status == 2
    assert err == f"ph-post: {tmp_path / 'kit'}: the folder cannot be made: file exists\n"
    assert Path(tmp_path / "kit").read_text() == ""
