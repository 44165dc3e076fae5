"""The recipes of CONTRIBUTING.md, followed: each toy is one file, registered as an entry point, and works."""

from __future__ import annotations

import json
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

from ph_post.cli.main import main
from ph_post.files.storage import shipped

CONTRIBUTING = Path(__file__).resolve().parents[2] / "CONTRIBUTING.md"

TOYS = {
    "ph_post.dialects": EntryPoint("toy", "support.toys.dialect:DIALECT", "ph_post.dialects"),
    "ph_post.effects": EntryPoint("toy_spring", "support.toys.effect:EFFECT", "ph_post.effects"),
    "ph_post.strategies": EntryPoint("toy_half", "support.toys.strategy:STRATEGY", "ph_post.strategies"),
}


@pytest.fixture(autouse=True)
def registered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: [TOYS[group]] if group in TOYS else [])


def output_of(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    assert main(list(words)) == 0, capsys.readouterr().err
    return capsys.readouterr().out


def test_a_dialect_is_one_file(capsys: pytest.CaptureFixture[str]) -> None:
    text = output_of(capsys, "convert", "circle", "-m", "paper", "--strategy", "suppress", "--dialect", "toy")
    assert "G1 " in text
    assert "G2 " not in text
    assert "G3 " not in text
    assert text.rstrip().splitlines()[-1] == "M30"
    assert "spindle and coolant are not touched until M30, which switches them off" in text


def test_an_effect_is_one_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine = tmp_path / "machine.toml"
    text = shipped("machines", "paper").read_text(encoding="utf-8")
    machine.write_text(f'{text}\n[[axes.X.effects]]\nname = "toy_spring"\npull_mm = 0.3\n', encoding="utf-8")
    errors = [
        json.loads(output_of(capsys, "simulate", "circle", "-m", str(file), "--json"))["error"]["max"]
        for file in (shipped("machines", "paper"), machine)
    ]
    assert abs(errors[1] - errors[0]) > 0.05


def test_a_strategy_is_one_file(capsys: pytest.CaptureFixture[str]) -> None:
    words = ("circle", "-m", "paper", "--strategy", "toy_half", "--start", "moving", "--json", "--no-simulation")
    view = json.loads(output_of(capsys, "convert", *words, "--max-slowdown", "1"))
    assert view["strategy"] == "toy_half"
    assert len(view["windows"]) == 4


def test_the_recipes_name_files_that_are_there() -> None:
    import re

    root = CONTRIBUTING.parent
    named = re.findall(r"`((?:ph_post|tests|docs)/[\w/.]+\.(?:py|md))`", CONTRIBUTING.read_text(encoding="utf-8"))
    assert len(named) > 10
    assert [name for name in named if not (root / name).exists() and "/mine." not in name] == []
