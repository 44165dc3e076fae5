"""The functions that check programs say what the commands print."""

from pathlib import Path

import pytest
from support.front_door import printed

import ph_post as ph
from ph_post.report.diffs import diff_view, verdict_view

PART = "G21 G90 G94\nG0 X0 Y0\nG1 X10 F600\nY10\nX0\nY0\nM2\n"
OTHER = PART.replace("X10 F600", "X10.01 F500")


@pytest.fixture
def programs(tmp_path):
    one, other = tmp_path / "a.ngc", tmp_path / "b.ngc"
    one.write_text(PART)
    other.write_text(OTHER)
    return one, other


def test_verify_is_the_command(capsys, programs):
    found = ph.verify(*programs, "router")
    assert not found.ok
    assert printed(capsys, "verify", *programs, "-m", "router", status=1) == verdict_view(found)


def test_diff_is_the_command(capsys, programs):
    found = ph.diff(*programs, "router")
    assert not found.same
    assert printed(capsys, "diff", *programs, "-m", "router", status=1) == diff_view(found)


def test_programs_and_machines_may_be_objects(programs):
    one, other = (ph.read_program(name) for name in programs)
    machine = ph.read_machine("router")
    by_name, by_object = ph.diff(*programs, "router"), ph.diff(one, other, machine)
    assert diff_view(by_name) == diff_view(by_object)
    assert [program.data for program in by_object.programs] == [one.data, other.data]
    assert ph.verify(one, str(programs[0]), machine).ok


def test_two_programs_are_read_in_one_language(tmp_path):
    turned = tmp_path / "part.txt"
    turned.write_text("G17 G90\nG1 X10 F600\nX0\nM30\n")
    one = ph.read_program(turned)
    found = ph.diff(one, turned, dialect="siemens")
    first, second = (program.language for program in found.programs)
    assert first == second != one.language


def test_a_machine_without_the_axis_is_refused(programs, tmp_path):
    lathe = tmp_path / "lathe.toml"
    text = Path(ph.api.inputs.or_shipped("machines", "stepper")).read_text()
    lathe.write_text(text[: text.index("[axes.Y]")])
    with pytest.raises(ph.InputError, match="Y"):
        ph.diff(*programs, lathe)


def test_linuxcnc_runs_its_own_words_alone(programs, tmp_path):
    machine = tmp_path / "siemens.toml"
    text = Path(ph.api.inputs.or_shipped("machines", "router")).read_text()
    machine.write_text(text.replace('dialect = "linuxcnc"', 'dialect = "siemens"'))
    with pytest.raises(ph.InputError, match="a machine file for LinuxCNC"):
        ph.rehearse(programs[0], machine)
