"""Bad inputs and the exact line with which each is refused: ``NAME.error`` beside the input."""

from pathlib import Path

import pytest
from support.streams import without_progress

from ph_post.cli.main import main
from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.files.path import read_path

HERE = Path(__file__).parent
CIRCLE = HERE.parents[1] / "paths" / "circle.json"
READERS = {"paths": (read_path, ".json"), "machines": (read_machine, ".toml")}
CASES = sorted(case for folder in READERS for case in HERE.glob(f"{folder}/*.error"))


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.parent.name}/{case.stem}")
def test_a_bad_file_is_refused_in_its_one_line(case, monkeypatch):
    read, ending = READERS[case.parent.name]
    monkeypatch.chdir(case.parent)
    with pytest.raises(InputError) as refusal:
        read(case.stem + ending)
    assert f"{refusal.value}\n" == case.read_text(encoding="utf-8")


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.parent.name}/{case.stem}")
def test_the_command_says_that_line_writes_nothing_and_exits_with_2(case, monkeypatch, capsys, tmp_path):
    monkeypatch.chdir(case.parent)
    path, machine = str(CIRCLE), "paper"
    if case.parent.name == "paths":
        path = f"{case.stem}.json"
    else:
        machine = f"{case.stem}.toml"
    status = main(["convert", path, "-m", machine, "-o", str(tmp_path / "out.ngc")])
    streams = capsys.readouterr()
    assert (status, streams.out) == (2, "")
    assert without_progress(streams.err) == "ph-post: " + case.read_text(encoding="utf-8")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("folder", READERS)
def test_every_bad_file_has_its_line(folder):
    inputs = {file.stem for file in (HERE / folder).glob(f"*{READERS[folder][1]}")}
    lines = {file.stem for file in (HERE / folder).glob("*.error")}
    assert inputs | {"no-such-file"} == lines


PAGE = "<!DOCTYPE html>\n<html><head><title>404 Not Found</title></head>\n<p>G1 X10 was not found.</p></html>\n"
LETTER = "Hello, this is the drawing.\nRegards\nBob\n"


@pytest.mark.parametrize(
    ("text", "dialects", "got"),
    [
        (PAGE, ("linuxcnc", "grbl", "grblhal", "marlin", "klipper", "fanuc", "siemens"), "<!DOCTYPE html>"),
        ("\n" + LETTER, ("linuxcnc", "grbl", "grblhal", "fanuc"), "Hello, this is the drawing."),
        ('{"a": 1}\n', ("linuxcnc", "grbl"), '{"a": 1}'),
    ],
)
def test_a_text_of_which_no_line_is_understood_is_not_copied_as_a_program(tmp_path, capsys, text, dialects, got):
    source, out = tmp_path / "part.ngc", tmp_path / "out.ngc"
    source.write_text(text)
    line = next(n for n, own in enumerate(text.splitlines(), 1) if own)
    for dialect in dialects:
        assert main(["convert", str(source), "-m", "stepper", "--dialect", dialect, "-o", str(out)]) == 2
        said = capsys.readouterr().err
        assert said == (
            f"ph-post: {source}:{line}: not a part program, as no line of it is understood; "
            f"expected words, such as G1 X10; got {got}\n"
        )
        assert not out.exists()


@pytest.mark.parametrize(
    ("text", "dialect"),
    [
        ("M2\n", "linuxcnc"),
        ("(nothing yet)\n", "linuxcnc"),
        ("#1=5\nG1 X#1\n", "linuxcnc"),
        ("Program made by hand\nM30\n", "linuxcnc"),
        ("START_PRINT BED=60\nEND_PRINT\n", "klipper"),
        ("ROUGHING\nFINISHING\n", "siemens"),
    ],
)
def test_a_program_that_only_the_controller_understands_is_passed_through(tmp_path, text, dialect):
    source, out = tmp_path / "part.ngc", tmp_path / "out.ngc"
    source.write_text(text)
    assert main(["convert", str(source), "-m", "stepper", "--dialect", dialect, "-o", str(out)]) == 0
    assert out.read_text() == text


def test_a_file_of_another_kind_is_named_as_what_it_is_not(tmp_path, capsys):
    # An INI file behind -m was "not valid TOML: invalid value", a log in place of a program "not valid JSON".
    ini, log, out = tmp_path / "mill.ini", tmp_path / "run.csv", tmp_path / "out.ngc"
    ini.write_text("[EMC]\nMACHINE = retrofit\n")
    log.write_text("t,X_cmd,X_act\n0.000,0.0,0.0\n")
    assert main(["convert", str(CIRCLE), "-m", str(ini), "-o", str(out)]) == 2
    assert without_progress(capsys.readouterr().err) == (
        f"ph-post: {ini}:2:11: not a machine file; expected TOML, as ph-post machine new writes it; its --settings"
        ' reads those of Grbl and LinuxCNC; got "[EMC]"\n'
    )
    assert main(["convert", str(log), "-m", "stepper", "-o", str(out)]) == 2
    assert without_progress(capsys.readouterr().err) == (
        f"ph-post: {log}: neither a part program nor a path file; expected blocks, such as G1 X10, or a path in braces;"
        ' got "t,X_cmd,X_act"\n'
    )
    assert not out.exists()


def test_text_in_two_bytes_a_letter_is_named(tmp_path, capsys):
    # What an editor of Windows saves as "Unicode" was said to have a zero byte, or a byte 0xff.
    part, machine = tmp_path / "part.nc", tmp_path / "mill.toml"
    part.write_bytes("G1 X10 F100\n".encode("utf-16"))
    machine.write_bytes('name = "mill"\n'.encode("utf-16"))
    assert main(["convert", str(part), "-m", "stepper"]) == 2
    said = without_progress(capsys.readouterr().err)
    assert said.endswith(": not a part program; expected text as UTF-8 or ASCII; got UTF-16\n")
    assert main(["convert", str(CIRCLE), "-m", str(machine)]) == 2
    assert without_progress(capsys.readouterr().err).endswith(": not a text file; expected UTF-8; got UTF-16\n")
