"""A machine file with any effect of the catalogue goes through every command that reads machines."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from support.shop import HUMP

from ph_post.cli.main import main
from ph_post.drive.effects.registry import effect_names, find_effect
from ph_post.files.storage import shipped

PARAMETERS = {
    "coulomb_friction": "following_error_mm = 0.01",
    "stribeck_friction": """\
following_error_mm = 0.01
static_following_error_mm = 0.015
stribeck_velocity_mm_s = 5""",
    "viscous_friction": "following_error_s = 0.001",
    "friction_asymmetry": "plus_following_error_s = 0.002\nminus_following_error_s = -0.001",
    "load_offset": "following_error_mm = 0.01",
    "elastic_windup": "resonance_hz = 30\ndamping_ratio = 0.05",
    "engagement_impact": "kept = 0.5",
    "position_dependent_backlash": "bump_mm = 0.02\ncentre_mm = 2\nwidth_mm = 5",
    "cyclic_error": "amplitude_mm = 0.005\nperiod_mm = 5",
    "scale_error": "error = 0.002",
    "thermal_growth": "growth_mm = 0.02\ntime_constant_s = 0.5",
    "squareness": 'angle_rad = 0.002\nother = "X"',
    "transport_delay": "delay_ms = 2",
    "torque_saturation": "following_error_mm = 0.1",
    "cogging": "following_error_mm = 0.01\nperiod_mm = 2.5",
    "cutting_force": "following_error_mm = 0.02",
}
"""Of an effect on Y that shows in the error of the hump."""


OF_KIND = {find_effect(name).kind: name for name in reversed(PARAMETERS)}
"""One effect of every kind, for all; the others are for the slow tests."""

EACH = [pytest.param(name, marks=() if name in OF_KIND.values() else pytest.mark.slow) for name in PARAMETERS]


def test_every_effect_is_here():
    assert set(PARAMETERS) == set(effect_names())


@pytest.fixture
def hump(tmp_path: Path) -> Path:
    path = tmp_path / "hump.json"
    path.write_text(json.dumps(HUMP), encoding="utf-8")
    return path


def told(capsys: pytest.CaptureFixture[str], *arguments: object) -> dict:
    """Run a command that must do what it is asked, and return its object."""
    assert main([*map(str, arguments), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def machine_with(folder: Path, name: str) -> tuple[Path, Path]:
    """A shipped machine, and the same with an effect on Y; `engagement_impact` needs a scale and a rule."""
    loop = "mill" if name == "engagement_impact" else "router"
    plain = shipped("machines", loop).read_text(encoding="utf-8")
    plain = plain.replace('feedback = "load"', 'feedback = "load"\npickup = "standstill"')
    without, better = folder / "plain.toml", folder / "better.toml"
    without.write_text(plain, encoding="utf-8")
    effect = f'[[axes.Y.effects]]\nname = "{name}"\n{PARAMETERS[name]}\n[axes.Z]'
    better.write_text(plain.replace("[axes.Z]", effect), encoding="utf-8")
    return without, better


@pytest.mark.parametrize("name", EACH)
@pytest.mark.thinned(16)
def test_every_command_takes_it(hump, tmp_path, capsys, name):
    plain, better = machine_with(tmp_path, name)
    assert len(told(capsys, "inspect", hump, "-m", better)["turning_points"]) == 1
    errors = [told(capsys, "simulate", hump, "-m", one)["error"] for one in (plain, better)]
    assert errors[1]["max"] != pytest.approx(errors[0]["max"], rel=0.0, abs=1e-6)  # mm
    compared = told(capsys, "compare", hump, "-m", better, "--effort", 0.01)["strategies"]
    plainly, best = compared[0], next(one for one in compared if one["name"] == "auto")
    assert best["error_worst"]["max"] <= plainly["error_worst"]["max"] * (1.0 + 1e-9)
    table, program = tmp_path / "hump.csv", tmp_path / "hump.ngc"
    told(
        capsys,
        "convert",
        hump,
        "-m",
        better,
        "--table",
        table,
        "-o",
        program,
        "--effort",
        0.01,
        "--no-simulation",
    )
    assert len(table.read_text().splitlines()) > 400
    assert "F" in program.read_text()


def test_what_a_diagnosis_makes_sure_is_tried_no_wider(hump, tmp_path, capsys):
    """The worst machine has a gap of 0.08 mm and half its uncertainty more on either side."""
    text = shipped("machines", "router").read_text(encoding="utf-8")
    spread = {}
    for known in (0.3, 0.005):
        file = tmp_path / f"{known}.toml"
        file.write_text(text.replace("backlash_uncertainty = 0.3", f"backlash_uncertainty = {known}"))
        view = told(capsys, "simulate", hump, "-m", file)
        spread[known] = view["error_worst"]["max"] - view["error"]["max"]
    assert spread[0.005] < 0.03 * spread[0.3]
