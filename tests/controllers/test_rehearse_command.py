"""``ph-post rehearse`` as a user calls it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.rehearsing import HERE, WHY_NOT
from support.shop import SLOT

from ph_post.cli.main import main

pytestmark = pytest.mark.skipif(not HERE, reason=WHY_NOT)


@pytest.fixture
def part(tmp_path: Path) -> Path:
    place = tmp_path / "slot.ngc"
    place.write_text(SLOT)
    return place


@pytest.mark.slow
def test_json_log_and_picture(part: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, picture = part.with_suffix(".csv"), part.with_suffix(".png")
    words = ["rehearse", str(part), "-m", "router", "--against", str(part), "--backlash"]
    assert main([*words, "--json", "--log", str(log), "--plot", str(picture)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert set(found) >= {"speed", "path", "time", "error"}
    assert found["error"]["after"] == found["error"]["before"]
    assert found["error"]["backlash"]["rms"] < found["error"]["before"]["rms"]
    assert found["time"]["controller"] == pytest.approx(found["time"]["plan"], rel=0.05)
    header = next(line for line in log.read_text().splitlines() if not line.startswith("#"))
    assert header.startswith("t,X_cmd,X_act,X_motor,Y_cmd")
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_text_says_how_it_went(part: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rehearse", str(part), "-m", "router"]) == 0
    said = capsys.readouterr().out
    assert "on LinuxCNC" in said
    assert "rms off the plan" in said
    assert "contour error  max µm" in said


@pytest.mark.slow
def test_a_machine_of_another_controller_is_named(part: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["rehearse", str(part), "-m", "router"]) == 0
    assert "the machine's controller" not in capsys.readouterr().err
    assert main(["rehearse", str(part), "-m", "stepper"]) == 0
    assert "warning: the machine's controller is grbl: LinuxCNC has its own speeds" in capsys.readouterr().err


def test_what_linuxcnc_refuses_is_told_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "bad.ngc"
    place.write_text("G21 G90\nG1 X1 F100\nM999\nM2\n")
    assert main(["rehearse", str(place), "-m", "router"]) == 2
    said = [line for line in capsys.readouterr().err.splitlines() if "refuses the program" in line]
    assert len(said) == 1
    assert "bad.ngc:3" in said[0]


@pytest.mark.slow
def test_a_shifted_path_has_no_error_of_its_own(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without the plain program nothing says where the table should be; with it the error is that from its path."""
    plain, offset = tmp_path / "plain.ngc", tmp_path / "offset.ngc"
    made = ["convert", "pocket", "-m", "router", "--no-simulation"]
    assert main([*made, "--strategy", "none", "-o", str(plain)]) == 0
    assert main([*made, "--strategy", "takeup", "--max-slowdown", "1", "-o", str(offset)]) == 0
    capsys.readouterr()
    # What undoes a program tells its original. Programs that stop at reversals, as version 0.1.0 wrote, have nothing.
    bare = tmp_path / "bare.ngc"
    bare.write_text("(axis X carries an offset of 0.06 mm)\n" + plain.read_text())
    assert main(["rehearse", str(bare), "-m", "router", "--json"]) == 0
    out, err = capsys.readouterr()
    alone = json.loads(out)
    assert alone["error"] == dict.fromkeys(alone["error"])
    assert alone["error_gap"] == {"before": None, "after": None, "after_worst": None}
    assert "--against" in err
    assert main(["rehearse", str(offset), "-m", "router", "--against", str(plain), "--json"]) == 0
    beside = json.loads(capsys.readouterr().out)
    for name in ("error", "error_gap"):
        assert beside[name]["after"]["rms"] < 0.5 * beside[name]["before"]["rms"]
        # The way from beyond to the first place is in the air.
        assert beside[name]["after"]["max"] < beside[name]["before"]["max"]
    assert main(["rehearse", str(offset), "-m", "router", "--against", str(plain)]) == 0
    assert capsys.readouterr().out.splitlines()[-1].startswith("backlash error ")


@pytest.mark.slow
def test_what_follows_a_cycle_is_not_compared(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    square = ["G0 X0 Y0", "G1 Z-1 F300", "G1 X20 F1200", "Y20", "X0", "Y0", "G0 Z5"]
    understood = ["G21 G90 G64 P0.01", "G0 X0 Y0 Z5", *square]
    cycle = ["G98 G81 X5 Y5 Z-3 R2 F100", "X15", "G80"]
    found = {}
    for name, lines in (("plain", understood), ("cycle", [*understood, *cycle, *square])):
        file = tmp_path / f"{name}.ngc"
        file.write_text("\n".join([*lines, "M2", ""]))
        assert main(["rehearse", str(file), "-m", "router", "--json"]) == 0
        streams = capsys.readouterr()
        found[name] = json.loads(streams.out)
    assert found["cycle"]["error"]["after"]["max"] == pytest.approx(found["plain"]["error"]["after"]["max"], rel=0.01)
    assert found["cycle"]["path"]["max"] == pytest.approx(found["plain"]["path"]["max"], rel=0.01)
    assert "compared up to line 9, as far as it is understood" in streams.err
