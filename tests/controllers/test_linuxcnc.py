"""What the runner says where LinuxCNC refuses a program, does not come to an end, or is not there."""

from __future__ import annotations

import shutil

import pytest
from support.rehearsing import HERE, WHY_NOT

from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.rehearse.linuxcnc import NotInstalledError, run_on_linuxcnc

needs_linuxcnc = pytest.mark.skipif(not HERE, reason=WHY_NOT)


def test_where_it_is_missing_it_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda *_words, **_more: None)
    with pytest.raises(NotInstalledError, match="apt-get install linuxcnc-uspace"):
        run_on_linuxcnc(b"M2\n", "part.ngc", read_machine("mill"))


@needs_linuxcnc
def test_a_refused_program_is_told_by_its_line() -> None:
    text = b"G21 G90\nG0 X10 Y0\nG3 X0 Y10 I-10 J1 F1200\nM2\n"
    with pytest.raises(InputError, match=r"part\.ngc:3: LinuxCNC refuses the program; got Radius to end of arc"):
        run_on_linuxcnc(text, "part.ngc", read_machine("mill"))


@pytest.mark.slow
@needs_linuxcnc
def test_a_program_that_takes_too_long_is_given_up() -> None:
    text = b"G21 G90\nG0 X1\nG1 X1000 F1\nM2\n"
    with pytest.raises(InputError, match="did not come to the end within 1 s"):
        run_on_linuxcnc(text, "part.ngc", read_machine("mill"), limit=1.0)


@needs_linuxcnc
def test_a_program_that_does_not_move_is_refused() -> None:
    with pytest.raises(InputError, match="the program moves nothing"):
        run_on_linuxcnc(b"G21\nM2\n", "part.ngc", read_machine("mill"))


@needs_linuxcnc
def test_its_own_compensation_follows_the_direction_of_travel() -> None:
    """A gap of 0.02 mm: half of it ahead, on the side the axis goes to."""
    text = b"G21 G90 G61.1\nG1 X10 F600\nG1 X0\nM2\n"
    found = run_on_linuxcnc(text, "part.ngc", read_machine("mill"), backlash={"X": 20e-6})
    ahead = found.motor[:, 0] - found.position[:, 0]
    way = found.position[:, 0]
    top = int(way.argmax())
    assert ahead[top - 100] == pytest.approx(10e-6, abs=1e-9)
    assert ahead[-1] == pytest.approx(-10e-6, abs=1e-6)
