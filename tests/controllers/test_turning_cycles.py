"""Turning cycles that are written out, beside the canonical calls of LinuxCNC's interpreter."""

from pathlib import Path

import pytest
from support.canon import needs_rs274
from support.interpreted import difference, installed_version, interpret
from support.random_profiles import turned_program

from ph_post.expand.expand import expand

SHIPPED = Path("/usr/share/linuxcnc/ncfiles/lathe_g7x_quadrants.ngc")
STAYS = "the turning cycle stays as it is"


@needs_rs274
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.thinned(4)
def test_random_profiles_come_to_the_same_calls(seed):
    written = 0
    for number in range(25):
        data = turned_program(100 * seed + number).encode()
        made = [expand(data, "a.ngc", version=version) for version in (None, installed_version())]
        programs = [one.data for one in made if not one.notes]
        if not programs:
            continue
        before = interpret(data)
        assert before.refusal == ""
        for program in set(programs):
            assert b"o100 call" not in program
            assert difference(before, interpret(program)) == ""
        written += len(programs)
    assert written > 16


@needs_rs274
@pytest.mark.parametrize("version", [(2, 9, 4), (2, 10, 0)])
def test_newer_versions_end_a_profile_with_a_line(version):
    # They put it there themselves; the reference is run over a profile that has it already.
    profile = "o1 sub\nG0 X4\nG1 Z-3\nG2 X6 Z-5 R2\nG1 X7 Z-9\n{}o1 endsub\n"
    text = "G21 G90 G18 G8 F100\nG0 X9 Z1\n" + profile + "G71 Q1 D0.3 I0.8 R0.2\nM2\n"
    short, whole = (text.format(end).encode() for end in ("", "X9\n"))
    made, older = (expand(short, "a.ngc", version=one) for one in (version, (2, 9, 0)))
    assert made.notes == older.notes == ()
    assert difference(interpret(whole), interpret(made.data)) == ""
    assert older.data.split(b"undo 1/")[0] != made.data.split(b"undo 1/")[0]
    (note,) = expand(short, "a.ngc").notes
    assert "a.ngc:9: the turning cycle stays as it is: its profile ends on another level" in note


@needs_rs274
@pytest.mark.skipif(not SHIPPED.exists(), reason="LinuxCNC's programs are not installed")
def test_a_shipped_program_is_written_out_whole():
    data = SHIPPED.read_bytes()
    made = expand(data, SHIPPED.name, version=installed_version())
    assert made.notes == ()
    assert difference(interpret(data), interpret(made.data)) == ""


HEAD = "G21 G90 G18 G8 F100\n#100=1\no1 sub\nG0 X4\nG1 Z[-4*#1]\n{}X9 Z-7\no1 endsub\nG0 X9 Z1\n"
"""A subprogram's own parameters are 0 in it: its first line of the profile is level."""

CASES = {
    "values, loops and choices": HEAD.format("o2 repeat [3]\n#100=[#100+1]\nZ-[#100]\no2 endrepeat\n") + "G71 Q1\n",
    "the place in the profile": HEAD.format("X[#<_x>+1] Z[#<_z>-2]\n") + "G71 Q1 R0\n",
    "a motion behind it": HEAD.format("X5 Z-6\n") + "S200 G70 Q1 F80 (finish)\nX12 Z2\nG71 Q1 X9.5 Z2\nX20\n",
    "inches and diameters": "G20 G7\n" + HEAD.format("G3 X6 Z-1 K-1\nG1\n") + "G71 Q[1] I0.25\nG8\nG0 X12\n",
    "corners": HEAD.format("G1 X4.5 Z-4 A0.5\nX6 C0.3\nZ-5 A0.4\n") + "G71 Q1 D0.1 I0.7\nG70 Q1\n",
    "another dialect of arcs": "G90.1\n" + HEAD.format("G3 X5 Z-1 I4 K-1\nG1 X6 Z-6\n") + "G72 X9 Z1 Q1 I0.3\n",
    "blocks of no length": HEAD.format("X4 Z0\nG2 X4 Z0 I1\nG1 X5 Z-5 F1 S3\n") + "G71 Q1\n",
    "a feed a turn": "S500 M3\nG95\n" + HEAD.format("X5 Z-6\n") + "G71 Q1 F0.2\n",
    "increments behind it": HEAD.format("X5 Z-6\n") + "G71 Q1\nG91 G1 X1 Z1\nG90 G0 X[#<_x>+1]\n",
    "in a loop": HEAD.format("X5 Z-6\n") + "o3 repeat [3]\nG71 Q1 X9 Z1 I[1+#100]\n#100=[#100+0.3]\no3 endrepeat\n",
    "work offsets": "G10 L2 P1 X5 Z7\nG92 X3 Z4\n" + HEAD.format("X5 Z-6\n") + "G71 Q1\nG92.1\nG0 X1 Z1\n",
}


@needs_rs274
@pytest.mark.parametrize("name", CASES)
def test_programs_around_a_cycle_come_to_the_same_calls(name):
    data = (CASES[name] + "M2\n").replace("G21 G90 G18 G8", "G90 G18" if "G20" in CASES[name] else "G21 G90 G18")
    data = data.encode()
    made = expand(data, "a.ngc", parameters={}, version=installed_version())
    assert made.notes == ()
    assert b"sub" not in made.data.split(b"undo 1/")[0]
    before = interpret(data)
    assert before.refusal == ""
    assert difference(before, interpret(made.data)) == ""


PROFILE = "G0 X4 Z0\nG1 Z-4\nX9 Z-7\nX10"
STANDING = [
    ("G91\nG71 Q1", PROFILE, "under G91"),
    ("G17\nG71 Q1", PROFILE, "another plane"),
    ("G71 Q1 U1", PROFILE, "U on the line"),
    ("G71 Q1 P2", PROFILE, "P on the line"),
    ("G70 Q1 R1", PROFILE, "R on the line"),
    ("G70 Q1 P1.5", PROFILE, "a P that is not whole"),
    ("M8 G71 Q1", PROFILE, "M8 on the line"),
    ("G71 Q1 I0", PROFILE, "too small"),
    ("G53 G0 X0\nG71 Q1 Z1", PROFILE, "is not known"),
    ("G71 Q1", "G0 X4 Z0\nG1 Z-4 A1 C1\nX9 Z-7\nX10", "A and C together"),
    ("G71 Q1", "G0 X4 Z0\nG1 Z-4 A0\nX9 Z-7\nX10", "not above 0"),
    ("G71 Q1", "G0 X4 Z0\nG1 Z-4\nX9 Z-7\nX10 C1", "at the end of a profile"),
    ("G71 Q1", "G0 X4 Z0\nG1 Z-4\nG2 X5 Z-5 I1 C0.9\nG1 X10", "small beside"),
    ("G71 Q1", "G0 X4 Z0\nG1 Z-4\nU3\nX9 Z-7\nX10", "U in the profile"),
    ("G71 Q1", "G0 X4 Z0\nM8 G1 Z-4\nX9 Z-7\nX10", "M8 in the profile"),
    ("G71 Q1", "G0 X4 Z0\nG91 G1 Z-4\nX9 Z-7\nX10", "G91 in the profile"),
    ("G71 Q1", "G0 X4 Z0\nG1 Z-4\nG2 X5 Z-5\nX10", "without a centre"),
    ("G71 Q1", "G0 X4 Z0\nG1 Z-4\nG2 X5 Z-5 R0.5\nX10", "does not reach its end"),
    ("G71 Q1", "G0 X4 Z0\nG1 Z-4\nG2 X5 Z-5.1 I1\nX10", "not as far from its centre"),
    ("G71 Q1", "G0 X4 Z0\nG1 Z-4\nX5 Z-3\nX10", "runs back"),
    ("G71 Q1", "G0 X4 Z0\nG1 Z-4\nX4.0009\nX9 Z-7\nX10", "a small piece"),
    ("G71.1 Q1 D0.5", "G0 X4 Z0\nG1 Z-1\nX9.5 Z-5\nZ-7", "a level line"),
    ("G71 Q1 I0.000001", PROFILE, "do not end"),
    ("G71 Q1", "G0 X4 Z0", "less than two moves"),
    ("G71 Q1 D0.2", "G0 X4 Z0\nG1 Z-4\nZ-5\nX10", "in one direction"),
    ("G71 Q1 D0.2", "G0 X4 Z0\nG1 Z-4\nX4.1\nX9 Z-7\nX10", "vanishes"),
]


@pytest.mark.parametrize(("line", "profile", "why"), STANDING)
def test_what_is_not_certain_stays_and_is_named(line, profile, why):
    text = f"G21 G90 G18 G8 F100\nG0 X9 Z1\no1 sub\n{profile}\no1 endsub\n{line}\nG0 X20 Z20\nM2\n"
    made = expand(text.encode(), "a.ngc", version=(2, 9, 0))
    number = text[: text.index(line.splitlines()[-1])].count("\n") + 1
    (note,) = made.notes
    assert note.startswith(f"a.ngc:{number}: {STAYS}: ")
    assert why in note
    assert line.splitlines()[-1].replace(" ", "") in made.data.decode().replace(" ", "")
