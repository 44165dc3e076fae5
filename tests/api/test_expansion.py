"""Programs that compute, from the file to the compensated program and back."""

import pytest

import ph_post as ph
from ph_post.api.outcomes import passed_through
from ph_post.cli.main import main
from ph_post.dialects.reading import read_as
from ph_post.errors import InputError

PROGRAM = """\
G21 G90 G17 G64 P0.01 F600
o100 sub
G1 X[#1*2] Y#1
G1 X0
Y0
o100 endsub
G0 X0 Y0
o1 repeat [2]
o100 call [10]
o1 endrepeat
M2
"""


@pytest.fixture
def file(tmp_path):
    file = tmp_path / "part.ngc"
    file.write_bytes(PROGRAM.encode().replace(b"\n", b"\r\n"))
    return file


def test_loops_are_compensated_and_taken_back(file, tmp_path):
    plain = ph.compensate(file, "stepper", dialect="linuxcnc")
    assert plain.reversals.compensated == 0
    result = ph.compensate(file, "stepper", dialect="linuxcnc", expand=True, max_slowdown=1.0)
    assert result.expanded
    assert result.reversals.compensated == result.reversals.all > 0
    out = tmp_path / "out.ngc"
    result.write(out)
    assert ph.verify(file, out).ok
    assert ph.undo(out) == file.read_bytes()
    again = ph.compensate(out, "stepper", dialect="linuxcnc", expand=True, max_slowdown=1.0)
    assert again.program() == out.read_bytes()


def test_what_was_written_out_alone_is_taken_back_too(file, tmp_path):
    out = tmp_path / "out.ngc"
    ph.compensate(file, "stepper", dialect="linuxcnc", expand=True, strategy="none").write(out)
    assert b"\r\nG1 X20 Y10\r\n" in out.read_bytes()
    assert b"repeat" not in out.read_bytes()
    assert ph.undo(out) == file.read_bytes()
    assert ph.verify(file, out).ok
    out.write_bytes(out.read_bytes().replace(b"G1 X20 Y10", b"G1 X21 Y10", 1))
    with pytest.raises(InputError, match="changed after it was written out"):
        ph.undo(out)
    assert not ph.verify(file, out).ok


def test_what_cannot_be_written_out_stays_and_is_named(file):
    file.write_bytes(b"G21 G90 F600\nG0 X0\n#1=1\no1 while [#1]\nG1 X5\nX0\no1 endwhile\nM2\n")
    result = ph.compensate(file, "stepper", dialect="linuxcnc", expand=True)
    assert not result.expanded
    assert "the loop never ends" in result.warnings[0]
    assert f"{file}:4:" in result.warnings[0]
    assert result.program() == file.read_bytes()
    with pytest.raises(InputError, match="the loop never ends"):
        ph.compensate(file, "stepper", dialect="linuxcnc", expand=True, strict=True)


def test_other_dialects_say_that_they_are_left(file):
    result = ph.compensate(file, "stepper", dialect="marlin", expand=True)
    assert "programs of marlin are taken as they are" in result.warnings[0]


def test_a_file_of_parameters_is_read(file, tmp_path):
    file.write_bytes(b"G21 G90 F600\nG0 X#31\nG1 X[#31+5]\nX#31\nM2\n")
    values = tmp_path / "linuxcnc.var"
    values.write_text("31\t2.500000\n5221 0.0\n")
    how = {"dialect": "linuxcnc", "expand": True, "strategy": "none", "parameters": values}
    assert b"G0 X2.5\nG1 X7.5\nX2.5\n" in ph.compensate(file, "stepper", **how).program()
    values.write_text("31 two\n")
    with pytest.raises(InputError, match=r"linuxcnc\.var:1: not a parameter; expected its number and its value"):
        assert ph.compensate(file, "stepper", **how).program()


def test_a_table_of_tools_gives_the_radius(file, tmp_path):
    file.write_bytes(b"G21 G90 F600\nG0 X0 Y0\nG42 D2 G1 X5\nY5\nX0\nG40 X-5\nM2\n")
    table = tmp_path / "tool.tbl"
    table.write_text("T1 P1 D6 Z-20 ; end mill\n\nT2 P2 D2\n")
    how = {"dialect": "linuxcnc", "expand": True, "strategy": "none"}
    out = tmp_path / "out.ngc"
    result = ph.compensate(file, "stepper", tool_table=table, **how)
    result.write(out)
    assert b"\nG1 X6 Y-1\n" not in out.read_bytes()
    assert b"\nG3 X6 Y0 I0 J1\n" in out.read_bytes()
    assert ph.undo(out) == file.read_bytes()
    assert ph.verify(file, out).ok
    inches = ph.compensate(file, "stepper", tool_table=table, controller_units="inch", **how)
    assert "the tool's radius" in inches.warnings[0]
    assert "the radius of tool 2 is not known" in ph.compensate(file, "stepper", **how).warnings[0]
    table.write_text("T1 P1 D6\nT2 five\n")
    with pytest.raises(InputError, match=r"tool\.tbl:2: not a tool; expected words as T1 P1 D6\.35; got T2 five"):
        ph.compensate(file, "stepper", tool_table=table, **how)


def test_a_version_of_the_controller_decides_turning_cycles(file, tmp_path):
    profile = b"o1 sub\nG0 X4\nG1 Z-3\nG2 X6 Z-5 R2\nG1 X7 Z-9\no1 endsub\n"
    file.write_bytes(b"G21 G90 G18 G8 F100\nG0 X9 Z1\n" + profile + b"G71 Q1 D0.3 I0.8 R0.2\nM2\n")
    how = {"dialect": "linuxcnc", "expand": True, "strategy": "none"}
    out, newer = tmp_path / "out.ngc", tmp_path / "newer.ngc"
    ph.compensate(file, "stepper", controller_version="2.9.2", **how).write(out)
    ph.compensate(file, "stepper", controller_version="2.9.4", **how).write(newer)
    assert out.read_bytes() != newer.read_bytes()
    for one in (out, newer):
        assert b"G71" not in one.read_bytes().split(b"undo 1/")[0]
        assert ph.undo(one) == file.read_bytes()
        assert ph.verify(file, one).ok
    plain = ph.compensate(file, "stepper", **how)
    assert "the turning cycle stays as it is" in plain.warnings[0]
    assert b"G71 Q1" in plain.program()
    with pytest.raises(InputError, match=r"--controller-version: not a version; expected 2\.9\.4; got two"):
        ph.compensate(file, "stepper", controller_version="two", **how)


def test_subprograms_and_macros_of_fanuc(file, tmp_path):
    text = "%\nO0001\nG21 G17 G90 F600.\nG0 X0 Y0\n#1=0\nWHILE[#1LT3]DO1\nM98 P2\n#1=#1+1\nEND1\nM30\n"
    file.write_text(text + "O0002\nG1 X[20.+#1]\nX0\nM99\n%\n")
    result = ph.compensate(file, "stepper", dialect="fanuc", expand=True, max_slowdown=1.0)
    assert result.expanded
    assert result.reversals.compensated == result.reversals.all > 4
    out = tmp_path / "out.nc"
    result.write(out)
    assert ph.undo(out) == file.read_bytes()
    assert ph.verify(file, out, dialect="fanuc").ok
    assert ph.compensate(out, "stepper", dialect="fanuc", expand=True, max_slowdown=1.0).program() == out.read_bytes()


def test_cycles_and_turned_coordinates_of_fanuc(file, tmp_path):
    holes = "G98 G83 X10. Y5. Z-3. R1. Q2. F90.\nX20.\nG80\n"
    text = (
        f"%\nO0001\nG21 G17 G90 F600.\nG0 X0. Y0. Z5.\n{holes}G68 X0. Y0. R90.\nG1 X5. Y1.\nG69\nG0 X0. Y0.\nM30\n%\n"
    )
    file.write_text(text)
    out = tmp_path / "out.nc"
    how = {"dialect": "fanuc", "expand": True, "strategy": "none"}
    result = ph.compensate(file, "stepper", peck_clearance=0.5e-3, **how)
    result.write(out)
    assert b"G0 Z-0.5\nG1 Z-3.\n" in out.read_bytes()
    assert b"G1 X-1. Y5.\n" in out.read_bytes()
    assert ph.undo(out) == file.read_bytes()
    assert ph.verify(file, out, dialect="fanuc").ok
    plain = ph.compensate(file, "stepper", **how)
    assert "part.ngc:5: cycle stays as it is: G83 depends on the control's settings" in plain.warnings[0]
    assert b"G83 X10." in plain.program()


@pytest.mark.slow
def test_repeats_and_parameters_of_siemens(file, tmp_path):
    source = tmp_path / "part.mpf"
    source.write_text("G71 G90 G17\nR1=20\nG0 X0 Y0\nROW: G1 X=R1 F600\nY=IC(2)\nX0\nR1=R1+1\nREPEAT ROW P=2\nM30\n")
    how = {"dialect": "siemens", "max_slowdown": 1.0}
    plain = ph.compensate(source, "stepper", **how)
    result = ph.compensate(source, "stepper", expand=True, **how)
    assert result.reversals.compensated == result.reversals.all > plain.reversals.compensated
    out = tmp_path / "out.mpf"
    result.write(out)
    assert ph.undo(out) == source.read_bytes()
    assert ph.verify(source, out).ok
    assert ph.compensate(out, "stepper", expand=True, **how).program() == out.read_bytes()


def test_repeats_parameters_and_cycles_of_heidenhain(tmp_path):
    source = tmp_path / "part.h"
    blocks = [
        *("BEGIN PGM PART MM", "TOOL CALL 5 Z S1000 F300", "FN 0: Q1 =+20", "L X+0 Y+0 Z+30 R0 FMAX M3", "L Z+0 F600"),
        *("LBL 1", "L X+Q1 F600", "L IY+2", "L X+0", "Q1 = Q1 + 1", "CALL LBL 1 REP 2", "L Z+30 R0 FMAX"),
        "CYCL DEF 200 DRILLING ~\n  Q200=+2 ~\n  Q201=-5 ~\n  Q206=+150 ~\n  Q202=+5 ~\n  Q203=+0 ;SURFACE",
        *("L X+10 Y+10 R0 FMAX M99", "L IX-5 R0 FMAX M99", "L Z+50 R0 FMAX M30", "END PGM PART MM"),
    ]
    source.write_text("".join(f"{number} {block}\n" for number, block in enumerate(blocks)))
    how = {"dialect": "heidenhain", "max_slowdown": 1.0}
    plain = ph.compensate(source, "stepper", **how)
    assert (
        "--expand writes it out as plain moves"
        in passed_through(read_as("heidenhain", source.read_bytes(), "a"), "heidenhain")[0]
    )
    result = ph.compensate(source, "stepper", expand=True, **how)
    assert result.reversals.compensated == result.reversals.all > plain.reversals.compensated
    out = tmp_path / "out.h"
    result.write(out)
    assert out.read_text().splitlines()[-1] == "16 END PGM PART MM"
    assert ph.undo(out) == source.read_bytes()
    assert ph.verify(source, out).ok
    assert ph.compensate(out, "stepper", expand=True, **how).program() == out.read_bytes()


def test_a_subprogram_that_heidenhain_turns_on_is_compensated_at_each_call(tmp_path):
    source = tmp_path / "part.h"
    blocks = [
        *("BEGIN PGM PART MM", "TOOL CALL 5 Z S1000 F300", "L X+0 Y+0 Z+30 R0 FMAX M3", "LBL 1", "L X+5 Y+1 R0 FMAX"),
        *(
            "L Z+0 F600",
            "L X+25",
            "L IY+6",
            "L X+5",
            "L Z+30 R0 FMAX",
            "CYCL DEF 10.0 ROTATION",
            "CYCL DEF 10.1 IROT+40",
        ),
        *(
            "CALL LBL 1 REP 3",
            "CYCL DEF 10.0 ROTATION",
            "CYCL DEF 10.1 ROT+0",
            "L X+0 Y+0 R0 FMAX M30",
            "END PGM PART MM",
        ),
    ]
    source.write_text("".join(f"{number} {block}\n" for number, block in enumerate(blocks)))
    how = {"dialect": "heidenhain", "max_slowdown": 1.0}
    (said,) = passed_through(read_as("heidenhain", source.read_bytes(), "a"), "heidenhain")
    assert said.endswith("--expand writes it out as plain moves)")
    result = ph.compensate(source, "stepper", expand=True, **how)
    assert result.reversals.compensated == result.reversals.all >= 8
    assert passed_through(result.edited.after, "heidenhain") == ()
    out = tmp_path / "out.h"
    result.write(out)
    assert ph.undo(out) == source.read_bytes()
    assert ph.verify(source, out).ok


@pytest.mark.parametrize(("line", "what"), [(b"G1\0X1", "zero byte"), (b"G1 X" + 20000 * b"0", "line is too long")])
def test_what_is_no_program_is_not_written_out(file, line, what):
    file.write_bytes(line + b"\n" + file.read_bytes())
    with pytest.raises(InputError, match=what):
        ph.compensate(file, "stepper", dialect="linuxcnc", expand=True)


def test_what_was_changed_by_hand_after_it_was_written_out_comes_back_as_it_was_given(file, tmp_path):
    plain = ph.compensate(file, "stepper", dialect="linuxcnc", expand=True, max_slowdown=1.0)
    by_hand = ph.undo(_written(plain, tmp_path / "once.ngc"))
    assert by_hand == file.read_bytes()
    expanded = plain.original.data.replace(b"X20", b"X21")
    file.write_bytes(expanded)
    again = ph.compensate(file, "stepper", dialect="linuxcnc", max_slowdown=1.0)
    assert ph.undo(_written(again, tmp_path / "twice.ngc")) == expanded


def _written(result, out):
    result.write(out)
    return out


@pytest.mark.parametrize(("expand", "said"), [((), "nothing to change"), (("--expand",), "written out")])
def test_a_program_that_was_only_written_out_is_not_said_to_be_unchanged(tmp_path, capsys, expand, said):
    part, out = tmp_path / "part.ngc", tmp_path / "out.ngc"
    part.write_text("G21 G90 G61\nG0 X0 Y0 Z5\n#1=5\nG0 X#1\nM2\n")
    assert main(["convert", str(part), "-m", "stepper", "--dialect", "linuxcnc", *expand, "-o", str(out)]) == 0
    assert (out.read_text() == part.read_text()) == (not expand)
    first = next(line for line in capsys.readouterr().err.splitlines() if line.startswith(str(part)))
    assert first == f"{part}: {said}"
