"""Dialects by name."""

from __future__ import annotations

import subprocess
import sys
from importlib.metadata import EntryPoint
from pathlib import Path

import numpy as np
import pytest

from ph_post.cli.main import main
from ph_post.dialects import grbl, grblhal, linuxcnc, registry
from ph_post.dialects.reading import read_as
from ph_post.errors import InputError
from ph_post.files.storage import PROGRAM_ENDINGS


def test_the_built_in_dialects() -> None:
    assert registry.find_dialect("linuxcnc") is linuxcnc.DIALECT
    assert registry.find_dialect("grbl") is grbl.DIALECT
    assert registry.find_dialect("grblhal") is grblhal.DIALECT


def test_without_installed_metadata_the_built_in_ones_remain(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: ())
    assert registry.dialect_names() == tuple(sorted(registry.BUILT_IN))
    for name in registry.BUILT_IN:
        assert registry.find_dialect(name).name == name
    assert registry.find_dialect("grbl") is grbl.DIALECT


@pytest.mark.parametrize("name", registry.BUILT_IN)
def test_files_of_every_dialect_are_taken_for_programs(name: str) -> None:
    assert registry.find_dialect(name).ending in PROGRAM_ENDINGS


def test_an_unknown_name_lists_those_that_exist(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: ())
    with pytest.raises(InputError) as error:
        registry.find_dialect("nobody's", "mill.toml: controller.dialect")
    known = " or ".join(sorted(registry.BUILT_IN))
    expected = f'mill.toml: controller.dialect: no such dialect; expected {known}; got "nobody\'s"'
    assert str(error.value) == expected


def test_what_a_machine_has_besides_is_named_behind_plus_signs() -> None:
    found = registry.find_dialect("fanuc+nurbs+isc")
    assert found.name == "fanuc+nurbs+isc"
    assert (found.abilities.writes_splines("G17"), found.numbers.decimals) == (True, 4)
    assert found.options == {"ai", "nurbs", "isc"}
    assert not registry.find_dialect("fanuc").abilities.writes_splines("G17")
    with pytest.raises(InputError) as error:
        registry.find_dialect("fanuc+nurb", "--dialect")
    assert str(error.value) == (
        "--dialect: the dialect fanuc has no such variant;"
        " expected ai or calculator or inverse or isc or lathe or nurbs or an M word that moves nothing, as m103;"
        " got 'nurb'"
    )
    with pytest.raises(InputError, match="grbl has no such variant; expected an M word that moves nothing, as m103;"):
        registry.find_dialect("grbl+nurbs")


BODIES = {
    "heidenhain": ("0 BEGIN PGM A MM", "1 L X+1 Y+1 F100", "2 M581", "3 L X+2", "4 END PGM A MM"),
    "heidenhain-iso": ("%A G71 *", "G01 X+1 Y+1 F100 *", "M581 *", "G01 X+2 *", "N99999999 %A G71 *"),
    "siemens": ("G90", "G1 X1 Y1 F100", "M581", "G1 X2", "M30"),
}
"""A move to (1, 1), an M word that is no controller's, and a move of X to 2."""

COMMON = ("G90", "G1 X1. Y1. F100.", "M581", "G1 X2.")


@pytest.mark.parametrize("name", sorted(registry.BUILT_IN))
def test_an_m_word_that_moves_nothing_is_named_behind_a_plus_sign(name: str) -> None:
    text = "\n".join([*BODIES.get(name, COMMON), ""]).encode()
    plain, told = (read_as(dialect, text, "a") for dialect in (name, f"{name}+m581"))
    assert [one.kind for one in plain.breaks].count("not understood") == 1
    assert np.isnan(plain.motions.start[-1, :2]).all()
    assert [one.kind for one in told.breaks] == ["beginning", "end"]
    assert told.motions.start[-1, :2].tolist() == [1e-3, 1e-3]
    # Another word of its kind is not meant, nor a line with another command.
    for other in (text.replace(b"M581", b"M58"), text.replace(b"M581", b"M581 M582")):
        assert "not understood" in [one.kind for one in read_as(f"{name}+m581", other, "a").breaks]


MACROS = (
    "PRINTING_FEATURE_ON\nG90\nG1 X1 Y1 F600\nPRINTING_FEATURE TYPE=Skirt ; G1 X9\n"
    "  printing_feature\nG1 X2\nM581\nG1 X3\n"
)


def test_a_macro_of_klipper_that_moves_nothing_is_named_behind_a_plus_sign() -> None:
    text = MACROS.encode()
    plain, told = (read_as(f"klipper{more}", text, "a") for more in ("", "+m581+Printing_Feature"))
    assert [note.first for note in plain.notes if note.what.startswith("line for")] == [0, 3, 6]
    # The macro whose name begins so is another.
    assert [note.first for note in told.notes] == [0]
    assert told.motions.chain.tolist() == [1, 1, 1]
    assert told.motions.start[1:, :2].tolist() == [[1e-3, 1e-3], [2e-3, 1e-3]]


@pytest.mark.parametrize("name", ["klipper+g28", "klipper+t1", "klipper+x-y", "grbl+printing_feature"])
def test_no_command_is_a_macro(name: str) -> None:
    with pytest.raises(InputError, match="has no such variant"):
        registry.find_dialect(name)


@pytest.mark.parametrize("word", ["m6", "m3", "m30", "m98", "m99", "m1581"])
def test_an_m_word_with_a_meaning_of_its_own_cannot_move_nothing(word: str) -> None:
    with pytest.raises(InputError, match=f"M{word[1:]} has a meaning of its own"):
        registry.find_dialect(f"fanuc+{word}", "--dialect")


def test_others_register_by_entry_point(monkeypatch: pytest.MonkeyPatch) -> None:
    points = (
        EntryPoint("mine", "ph_post.dialects.grbl:DIALECT", registry.GROUP),
        EntryPoint("wrong", "ph_post.dialects.grbl:_MAX_LINE", registry.GROUP),
    )
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: points)
    assert registry.dialect_names() == tuple(sorted([*registry.BUILT_IN, "mine", "wrong"]))
    assert registry.find_dialect("mine") is grbl.DIALECT
    with pytest.raises(InputError, match="expected a Dialect record; got int"):
        registry.find_dialect("wrong")


def test_what_others_register_is_looked_for_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is a file of every installed package that is read for that."""
    looked: list[str] = []
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: looked.append(group) or ())
    assert registry.dialect_names() == registry.dialect_names() == tuple(sorted(registry.BUILT_IN))
    assert not registry.is_dialect("nobody")
    assert looked == [registry.GROUP]


@pytest.mark.parametrize("source", ["samples/programs/pocket.ngc", "paths/circle.json"])
def test_a_dialect_that_a_machine_file_misspells_is_told_with_the_file(
    source: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = Path(__file__).resolve().parents[2]
    machine = tmp_path / "mill.toml"
    text = (root / "samples/machines/stepper.toml").read_text()
    machine.write_text(text.replace('"grbl"', '"grbll"'))
    arguments = ["convert", str(root / source), "-o", str(tmp_path / "x.ngc")]
    assert main([*arguments, "-m", str(machine)]) == 2
    assert f"ph-post: {machine}: controller.dialect: no such dialect;" in capsys.readouterr().err
    assert main([*arguments, "-m", "stepper", "--dialect", "nobody"]) == 2
    assert "ph-post: --dialect: no such dialect;" in capsys.readouterr().err
    assert not (tmp_path / "x.ngc").exists()


def test_the_signs_of_files_name_dialects_of_this_package() -> None:
    assert {*registry.ENDINGS.values(), *(one.dialect for one in registry.SIGNATURES)} <= {*registry.BUILT_IN}


@pytest.mark.slow
def test_reading_by_shared_words_loads_no_dialect() -> None:
    code = (
        "import sys; from ph_post.dialects.reading import read_as;"
        " read_as('', b'G21 G90\\nG0 X1\\nM2\\n', 'a.ngc');"
        " print(*(name for name in sys.modules if name.startswith('ph_post')))"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded = {*found.stdout.split()}
    assert "ph_post.dialects.reading" in loaded
    assert not loaded & {place.partition(":")[0] for place in registry.BUILT_IN.values()}
