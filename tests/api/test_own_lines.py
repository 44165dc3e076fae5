"""Lines that are named of programs that were written out, or have further axes or holes: those of the person's file."""

import json
import re

import pytest

import ph_post as ph
from ph_post.api.options import CompensateOptions
from ph_post.api.program_compensation import ProgramCompensation
from ph_post.cli.main import main
from ph_post.dialects.declaration import is_written_here
from ph_post.drive.machinefile import machine_of
from ph_post.files.storage import SourceText
from ph_post.progress import no_progress

AXIS = (
    '[axes.{name}]\nfeedback = "none"\nb = 0\nc = 0\nlost_motion_mm = 0.05\nmax_velocity_mm_s = 80\n'
    "max_acceleration_mm_s2 = 800\nmax_jerk_mm_s3 = 20000\n"
)
TURNING = (
    '[axes.A]\nfeedback = "none"\nlost_motion_deg = 0.05\nmax_velocity_deg_s = 60\nmax_acceleration_deg_s2 = 600\n'
)
HEAD = 'name = "four"\n[controller]\ndialect = "{dialect}"\nservo_period_ms = 1.0\n'

FOUR = (
    "G21 G90 G61\nG0 X0 Y0 Z5\nG0 A0\nG1 Z-1 F300\n"
    "G1 X50 A90 F600\nG1 X0 A180.5\nG1 Y8 A170\nG1 X50 A9\nG1 X0 A0\nG1 Y0 A5\n"
    "#1=5\nG1 X#1\nG1 X0 Y10 Z-1\nG1 X50\nG1 X0\nG0 Z5\nM2\n"
)
"""X goes back behind lines 5, 7, 8 and 14, Y behind line 9."""

DRILLED = (
    "%\nO1000\nG21 G90 G17\nG0 X7. Y7.\nG43 Z25. H1\nG82 R2.5 Z-3.4 P200 F200.\nX39.\nY45.\nX7.\nG80\nG0 Z25.\n"
    "G0 X0. Y0.\nG1 Z-1. F100.\nG1 X20. F600.\nG1 X0.\nG1 Y20.\nM98 P77\nG1 Z-1. F600.\nG1 X20. Y5.\nG1 X0.\nM30\n%\n"
)
"""Line 17 calls a program that is nowhere."""

CASES = {"axes": (FOUR, "linuxcnc", "#1=5"), "holes": (DRILLED, "fanuc", "M98")}


def machine_text(dialect):
    return HEAD.format(dialect=dialect) + "".join(AXIS.format(name=name) for name in "XYZ") + TURNING


def machine(dialect):
    text = machine_text(dialect)
    return machine_of(SourceText(name="four.toml", stem="four", text=text, digest="5" * 64))


def named(words, file):
    """Numbers of all lines that a sentence names."""
    found = re.findall(rf"(?:\blines? |{re.escape(file)}:)(\d+)(?: to (\d+))?", words)
    return [int(number) for pair in found for number in pair if number]


@pytest.fixture(params=CASES)
def case(request, tmp_path):
    text, dialect, left = CASES[request.param]
    file = tmp_path / "part.ngc"
    file.write_text(text)
    line = next(n for n, own in enumerate(text.splitlines(), 1) if left in own)
    return file, text, dialect, left, line


def test_warnings_name_lines_of_the_file_that_was_given(case):
    file, text, dialect, left, line = case
    result = ph.compensate(file, machine(dialect), expand=dialect == "fanuc")
    assert result.shifted.changed
    words = [word for word in (*result.warnings, result.not_compensated) if left in word]
    assert len(words) > 1
    assert all(named(word, file.name)[0] == line for word in words)
    assert all(number <= text.count("\n") for word in result.warnings for number in named(word, file.name))
    again = file.with_name("again.ngc")
    again.write_bytes(result.program())
    found = ph.compensate(again, machine(dialect), expand=dialect == "fanuc")
    assert found.already_compensated
    assert [named(word, again.name)[0] for word in found.warnings if left in word] == [
        named(word, file.name)[0] for word in result.warnings if left in word
    ]


def test_the_head_of_a_program_names_lines_of_the_file_that_was_given(tmp_path):
    file = tmp_path / "part.ngc"
    file.write_text(FOUR)
    options = CompensateOptions(notes_in_header=True)
    text = ProgramCompensation(ph.read_program(file), machine("linuxcnc"), options, "program", no_progress)
    text = text.program().decode()
    (word,) = re.findall(r"note warning: line (\d+): parameter", text)
    assert int(word) == 11


def test_reversals_are_listed_at_lines_of_the_file_that_was_given(tmp_path, capsys):
    (tmp_path / "four.toml").write_text(machine_text("linuxcnc"))
    (tmp_path / "part.ngc").write_text(FOUR)
    arguments = ["convert", str(tmp_path / "part.ngc"), "-m", str(tmp_path / "four.toml"), "--json"]
    assert main([*arguments, "-o", str(tmp_path / "out.ngc")]) == 0
    view = json.loads(capsys.readouterr().out)
    turns = {(one["axis"], one["line"]) for one in view["windows"]}
    assert turns == {("X", 5), ("X", 7), ("X", 8), ("Y", 9), ("X", 14)}


def test_a_page_names_lines_of_the_file_that_was_given(tmp_path):
    (tmp_path / "four.toml").write_text(machine_text("linuxcnc"))
    (tmp_path / "part.ngc").write_text(FOUR)
    page = tmp_path / "part.html"
    assert main(["report", str(tmp_path / "part.ngc"), "-m", str(tmp_path / "four.toml"), "-o", str(page)]) == 0
    text = page.read_text()
    traces = [set(json.loads(found)) for found in re.findall(r'"line": ?(\[[^]]*\])', text)]
    assert traces
    cuts = {n for n, own in enumerate(FOUR.splitlines(), 1) if own.startswith(("G0", "G1")) and "#" not in own}
    assert all(lines <= cuts and {5, 14} <= lines for lines in traces)
    assert "part.ngc:11: parameter" in text


def test_a_page_has_the_axes_beside_x_y_and_z_in_its_line(tmp_path, capsys):
    (tmp_path / "four.toml").write_text(machine_text("linuxcnc"))
    (tmp_path / "part.ngc").write_text(FOUR)
    lines = []
    for command, out in (("convert", "out.ngc"), ("report", "out.html")):
        arguments = [command, str(tmp_path / "part.ngc"), "-m", str(tmp_path / "four.toml"), "--json"]
        assert main([*arguments, "-o", str(tmp_path / out)]) == 0
        lines.append(json.loads(capsys.readouterr().out)["result_line"])
    # 0.05 deg of backlash leave half of it to either side, and A turns back behind lines 6 and 9.
    assert "A 0.025 → 0 deg max" in lines[0]
    # Z never reverses, and carries an offset.
    assert "(ph-post: offset Z " in (tmp_path / "out.ngc").read_text()
    assert "X, Y, Z, A compensated" in lines[0]
    assert lines[1] == lines[0]


def test_a_check_names_lines_of_the_original(tmp_path):
    file, made = tmp_path / "part.ngc", tmp_path / "made.ngc"
    file.write_text(FOUR)
    text = ph.compensate(file, machine("linuxcnc")).program().decode()
    # A feed is left in force behind the crossing where line 7 ends, of which line 8 has none of its own.
    assert "G1 Y7.975 F379.4\nF600\n" in text
    made.write_text(text.replace("G1 Y7.975 F379.4\nF600\n", "G1 Y7.975 F379.4\nF900\n"))
    verdict = ph.verify(file, made, machine("linuxcnc"))
    assert {one.kind: one.original for one in verdict.failures} == {"state": 7, "feed": 8}


COMPUTED = {
    "linuxcnc": (
        "ngc",
        "G21 G90 G17 G61 F600\no100 sub\nG1 X[#1*2] Y#1\nG1 X0\nY0\no100 endsub\nG0 X0 Y0\n"
        "o1 repeat [4]\no100 call [10]\no1 endrepeat\nG1 X30\nX5\nM450\nG1 X40 Y0\nG1 X0\nM2\n",
        "M450",
        {("X", 3), ("Y", 4), ("X", 5), ("Y", 5), ("X", 11)},
    ),
    "fanuc": (
        "nc",
        "%\nO1000\nG21 G90 G17\nG0 X0. Y0.\nM98 P2 L4\nG1 X30. F600.\nX5.\nM98 P77\nG1 X40. Y0.\nG1 X0.\nM30\n"
        "O2\nG1 X20. Y10. F600.\nX0.\nY0.\nM99\n%\n",
        "M98 P77",
        {("X", 13), ("Y", 14), ("X", 15), ("Y", 15), ("X", 6)},
    ),
    "siemens": (
        "mpf",
        "G71 G90 G17 F600\nR1=0\nA1:\nG1 X=20+R1 Y10\nX0\nY0\nR1=R1+1\nIF R1<4 GOTOB A1\nG1 X30\nX5\n"
        "MYCALL(3)\nG1 X40 Y0\nG1 X0\nM30\n",
        "MYCALL(3)",
        {("X", 4), ("Y", 5), ("X", 6), ("Y", 6), ("X", 9)},
    ),
    "heidenhain": (
        "h",
        "0 BEGIN PGM A MM\n1 TOOL CALL 1 Z S1000\n2 L X+0 Y+0 R0 FMAX\n3 LBL 1\n4 L X+20 Y+10 F600\n5 L X+0\n"
        "6 L Y+0\n7 CALL LBL 1 REP3\n8 L X+30\n9 L X+5\n10 CALL PGM B\n11 L X+40 Y+0 F600\n12 L X+0\n13 M30\n"
        "14 END PGM A MM\n",
        "CALL PGM B",
        {("X", 5), ("Y", 6), ("X", 7), ("Y", 7), ("X", 9)},
    ),
}
"""Programs with a part that runs four times, a line that stays, and the lines behind which axes go back."""


@pytest.fixture(params=COMPUTED)
def computed(request, tmp_path):
    ending, text, left, turns = COMPUTED[request.param]
    file = tmp_path / f"part.{ending}"
    file.write_text(text)
    return request.param, file, left, turns


def line_with(text, words):
    return next(n for n, own in enumerate(text.splitlines(), 1) if words in own)


def test_warnings_of_a_program_that_was_written_out_name_lines_of_the_file_that_was_given(computed):
    dialect, file, left, turns = computed
    line = line_with(file.read_text(), left)
    result = ph.compensate(file, machine(dialect), expand=True)
    assert result.expanded
    assert named(next(word for word in result.warnings if "passed through" in word), file.name) == [line]
    assert named(result.not_compensated, file.name) == [line]
    assert {(one.point.axis, one.line) for one in result.places} == turns
    again = file.with_name(f"again{file.suffix}")
    again.write_bytes(result.program())
    found = ph.compensate(again, machine(dialect), expand=True)
    assert found.already_compensated
    assert found.not_compensated == result.not_compensated
    assert {(one.point.axis, one.line) for one in found.places} == turns


def test_a_check_of_a_program_that_was_written_out_names_lines_of_the_original(computed):
    dialect, file, _, _ = computed
    made, text = file.with_name(f"made{file.suffix}"), file.read_text()
    written = ph.compensate(file, machine(dialect), expand=True).program().decode()
    # The feed that is in force again behind the crossing where the line to X30 ends.
    before, behind = written.split("4.975", 1)
    made.write_text("F900".join(before.rsplit("F600", 1)) + "4.975" + behind)
    verdict = ph.verify(file, made, machine(dialect))
    states = {one.kind: one.original for one in verdict.failures}
    assert states == {"state": line_with(text, "30"), "feed": line_with(text, "30") + 1}


def test_what_was_only_written_out_is_compensated_with_lines_of_the_file_from_before(computed):
    dialect, file, left, turns = computed
    made = file.with_name(f"made{file.suffix}")
    result = ph.compensate(file, machine(dialect), expand=True, strategy="none")
    assert not any(row.compensated for row in result.axis_reversals)
    assert is_written_here(result.program())
    made.write_bytes(result.program())
    found = ph.compensate(made, machine(dialect))
    assert not found.already_compensated
    assert all(row.compensated == row.all > 0 for row in found.axis_reversals if row.axis in "XY")
    assert {(one.point.axis, one.line) for one in found.places} == turns
    assert named(found.not_compensated, made.name) == [line_with(file.read_text(), left)]
