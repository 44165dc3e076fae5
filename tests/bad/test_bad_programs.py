"""Bad part programs and the exact lines with which each is refused: ``NAME.error`` beside the program."""

import io
import os
from pathlib import Path

import pytest
from support.canon import needs_rs274, run_rs274

from ph_post.cli import main as command
from ph_post.dialects.reading import read_as, read_program_file
from ph_post.errors import InputError

HERE = Path(__file__).parent / "programs"
CASES = sorted(HERE.glob("*.error"))
ACCEPTED_BY_LINUXCNC = {"binary"}
"""It reads a zero byte as the end of the line."""


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_a_bad_program_is_refused_in_its_line_with_a_caret(case, monkeypatch):
    monkeypatch.chdir(HERE)
    with pytest.raises(InputError) as refusal:
        read_program_file(f"{case.stem}.ngc", strict=True)
    shown = "".join(f"{part}\n" for part in (str(refusal.value), refusal.value.excerpt) if part)
    assert shown == case.read_text(encoding="utf-8")


@needs_rs274
@pytest.mark.parametrize("case", CASES, ids=lambda case: case.stem)
def test_linuxcnc_refuses_it_too(case):
    refusal = run_rs274((HERE / f"{case.stem}.ngc").read_text(encoding="utf-8")).refusal
    assert bool(refusal) != (case.stem in ACCEPTED_BY_LINUXCNC)


def test_every_bad_program_has_its_lines():
    assert {file.stem for file in HERE.glob("*.ngc")} == {case.stem for case in CASES}


def test_the_command_prints_the_place_under_its_one_line(monkeypatch, capsys):
    def refuse(*arguments, **options):
        raise InputError("a.ngc:1:1", "no", excerpt="    G1\n    ^^")

    monkeypatch.setattr(command.cli, "main", refuse)
    assert command.main(["convert"]) == 2
    assert capsys.readouterr().err == "ph-post: a.ngc:1:1: no\n    G1\n    ^^\n"


class Endless(io.RawIOBase):
    """A stream of one line that never ends, and how much of it was read."""

    taken = 0

    def readable(self):
        return True

    def read(self, size=-1):
        assert size > 0
        self.taken += size
        return b"X" * size


def test_a_line_without_end_is_refused_after_a_small_part_of_it(monkeypatch):
    stream = Endless()
    monkeypatch.setattr("sys.stdin", type("Stdin", (), {"buffer": stream}))
    with pytest.raises(InputError) as refusal:
        read_program_file("-")
    assert str(refusal.value) == "stdin:1:1: line is too long; expected a line end within 16384 bytes"
    assert stream.taken < 10_000_000


def test_a_long_line_further_down_is_refused_with_its_place(tmp_path):
    file = tmp_path / "a.ngc"
    file.write_bytes(b"G21\n" * 9 + b"(" + b"a" * 20000 + b")\nM2\n")
    with pytest.raises(InputError) as refusal:
        read_program_file(file)
    assert str(refusal.value).startswith(f"{file}:10:1: line is too long; ")


def test_long_comments_of_slicers_are_carried(tmp_path):
    """Bambu Studio writes what begins a print behind one semicolon, 21,000 bytes of it; thumbnails are longer."""
    said = b"; machine_start_gcode = " + 3000 * b"M1006 A0 B10 L100\\n"
    file = tmp_path / "a.gcode"
    file.write_bytes(b"G21\nG90\n" + said + b"\nM117 " + said + b"\nG1 X5 F600\nG1 X0\n")
    program = read_as("marlin", file.read_bytes(), file.name)
    assert [program.motions.end[:, 0].tolist(), program.motions.block.tolist()] == [[5.0e-3, 0.0], [4, 5]]
    assert program.data == file.read_bytes()
    file.write_bytes(b"G21\nG90\n;" + 3_000_000 * b"a" + b"\nG1 X5 F600\n")
    with pytest.raises(InputError, match=":3:1: line is too long"):
        read_program_file(file)


@pytest.mark.parametrize("name", ["none.ngc", ".", "a\0b"])
def test_a_file_that_is_none_is_told_in_one_line(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(InputError) as refusal:
        read_program_file(name)
    assert len(str(refusal.value).splitlines()) == 1
    assert os.listdir(tmp_path) == []  # noqa: PTH208 - nothing is made
