"""SINUMERIK programs read: the manual's examples, this package's own programs, and what is passed through."""

from __future__ import annotations

import math
import time

import mpmath
import numpy as np
import pytest
from support.plans import make_machine, make_path, make_plan
from support.sinumerik import read_blocks

from ph_post.dialects.reading import read_as
from ph_post.dialects.siemens.dialect import DIALECT
from ph_post.dialects.siemens.reader import read_siemens
from ph_post.errors import InputError
from ph_post.gcode.curves import curves_of
from ph_post.gcode.paths import main_path
from ph_post.gcode.program import ARC, LINE, NURBS, PartProgram
from ph_post.geometry.curves import Arc, Line
from ph_post.geometry.ph import PH
from ph_post.geometry.track import Track
from ph_post.post.program import make_program
from ph_post.units import MM_PER_MIN

BEGIN = "G0 X0 Y0 Z0\nG1 F600\n"


def _read(text: str) -> PartProgram:
    return read_siemens(text.encode(), "part.mpf")


def _last(text: str, begin: str = BEGIN) -> tuple[PartProgram, int]:
    program = _read(f"{begin}{text}\nM30\n")
    return program, program.motions.kind.size - 1


def _points(program: PartProgram, row: int, u: np.ndarray) -> np.ndarray:
    (curve,) = curves_of(program.motions, row, (0, 1, 2))
    return 1e3 * curve.derivatives(u)[0]


def test_the_manual_s_quarter_of_a_circle() -> None:
    """Job Planning, denominator polynomial: 10 (1 - p²) / (1 + p²), 20 p / (1 + p²)."""
    program, row = _last("POLY G90 X10 Y0 F100\nPO[X]=(0,-10) PO[Y]=(10) PO[]=(2,1)", "G0 X10 Y0\n")
    p = np.linspace(0.0, 1.0, 9)
    expected = np.column_stack([10.0 * (1.0 - p * p), 20.0 * p, 0.0 * p]) / (1.0 + p * p)[:, None]
    assert np.allclose(_points(program, row, p), expected, rtol=0.0, atol=1e-12)


def test_the_manual_s_feed_profile() -> None:
    """Job Planning, feedrate response: F=FPO(4000, 6000, -4000) behind F2000 is level at both ends."""
    program = _read("F2000 FNORM G1 X0 Y0\nG1 X7 G91 G64\nX6 F=FPO(4000, 6000, -4000)\nX5\nM30\n")
    motions = program.motions
    rows = np.flatnonzero(motions.block == 2)
    share = (motions.end[rows, 0] - motions.end[rows[0] - 1, 0]) / 6e-3
    before = np.append(0.0, share[:-1])
    p = before[:, None] + (share - before)[:, None] * np.linspace(0.0, 1.0, 1001)
    slowness = np.trapezoid(1.0 / (2000.0 + 6000.0 * p**2 - 4000.0 * p**3), p, axis=1)
    assert rows.size > 10
    assert np.allclose(motions.feed[rows] * 6e4, (share - before) / slowness, rtol=1e-7)
    assert motions.feed[rows[-1] + 1] * 6e4 == pytest.approx(4000.0)
    assert program.breaks[-1].motion == motions.kind.size


@pytest.mark.parametrize(
    ("line", "points"),
    [
        (
            "POLY PO[X]=(1,2.5,0.7) PO[Y]=(0.3,1,3.2) PL=1.5",
            lambda p: [
                (1 - 2.5 * 2.25 - 0.7 * 3.375) / 1.5 * p + 2.5 * p**2 + 0.7 * p**3,
                (0.3 - 2.25 - 3.2 * 3.375) / 1.5 * p + p**2 + 3.2 * p**3,
                0 * p,
            ],
        ),
        ("POLY X=PO(1,,0,0,5) Z=PO(-2,1)", lambda p: [5 * p**5 - 4 * p, 0 * p, p**2 - 3 * p]),
        ("N10 POLY PO[X] = ( 10 , 2.5 ) Y4 ; comment", lambda p: [2.5 * p**2 + 7.5 * p, 4 * p, 0 * p]),
        ("POLY PO[X]=(1EX1,.5) PO[Y]=(-1)", lambda p: [0.5 * p**2 + 9.5 * p, -p, 0 * p]),
    ],
)
def test_polynomials(line: str, points) -> None:
    program, row = _last(line)
    length = 1.5 if "PL" in line else 1.0
    assert program.motions.kind[row] == NURBS
    u = np.linspace(0.0, 1.0, 7)
    assert np.allclose(_points(program, row, u), np.column_stack(points(length * u)), rtol=0.0, atol=1e-12)
    assert not program.notes


def test_polynomials_stay_in_force_and_may_be_incremental() -> None:
    program = _read(BEGIN + "POLY PO[X]=(1,1)\nPO[X]=(3,-1) Y2\nG91 PO[X]=(1,4)\nX5\nG1 X1\nM30\n")
    motions = program.motions
    assert motions.kind.tolist() == [0, NURBS, NURBS, NURBS, LINE, LINE]
    assert (motions.end[1:, 0] * 1e3).round(9).tolist() == [1, 3, 4, 9, 10]
    assert np.allclose(_points(program, 3, np.array([0.5])), [[3.0 + (1 - 4) * 0.5 + 4 * 0.25, 2.0, 0.0]])


@pytest.mark.parametrize(
    ("line", "center", "angle"),
    [
        ("G2 X10 Y10 I10 J0", (10, 0), -math.pi / 2),
        ("G3 X10 Y10 I=AC(0) J=AC(10)", (0, 10), math.pi / 2),
        ("G3 X10 Y10 CR=10", (0, 10), math.pi / 2),
        ("G3 X10 Y10 CR=-10", (10, 0), 3 * math.pi / 2),
        ("G3 X=IC(10) Y=IC(10) I0 J10", (0, 10), math.pi / 2),
        ("G2 X0 Y0 I5 J0 TURN=2", (5, 0), -6 * math.pi),
        ("CIP X10 Y10 I1=AC(10) J1=AC(0)", (5, 5), math.pi),
        ("CIP X10 Y10 I1=0 J1=10", (5, 5), -math.pi),
        ("G91 CIP X10 Y0 I1=5 J1=-5", (5, 0), math.pi),
    ],
)
def test_arcs(line: str, center: tuple[float, float], angle: float) -> None:
    program, row = _last(line)
    assert program.motions.kind[row] == ARC
    assert program.motions.center[row] * 1e3 == pytest.approx(center)
    assert program.motions.angle[row] == pytest.approx(angle)
    assert not program.notes


def test_an_arc_of_more_turns_than_a_number_holds_is_named() -> None:
    program, _ = _last(f"G2 X0 Y0 I5 J0 TURN={400 * '9'}")
    assert [note.what[:28] for note in program.notes] == ["word of one controller, or o"]


@pytest.mark.parametrize(
    "line",
    [
        "; words",
        "N30",
        'MSG("a; b (c)")',
        "COMPOF SPATH FNORM",
        "G641 ADIS=0.005",
        "G60",
        "M8 S1000 M3",
        'T="MILL 8" D1',
        "SOFT FFWON",
        "G4 F2.5",
        "G4 S10",
        "CYCLE832(0.01,1,1)",
        "FGROUP(X,Y,Z)",
        "R1=0.5",
        "STOPRE",
        "G17 G90 G40",
        "%_N_PART_MPF",
        "DEF REAL DEPTH=5",
        "SPOS=0",
        "G26 X100 S500",
    ],
)
def test_what_moves_nothing(line: str) -> None:
    """The motion behind it begins where the one before it ended, at its feed."""
    program, row = _last(f"X10\n{line}\nX20")
    motions = program.motions
    assert motions.start[row] * 1e3 == pytest.approx([10, 0, 0])
    assert motions.feed[row] == pytest.approx(0.01)


@pytest.mark.parametrize(
    ("turned", "ended", "known"),
    [
        ("ROT RPL=30", "ROT", True),
        ("AROT RPL=30", "MIRROR", True),
        ("MIRROR X0", "SCALE", True),
        ("ROT RPL=30", "ROT RPL=0", False),
        ("ROT RPL=30", "AROT", False),
        ("TRAORI", "ROT", False),
        ("ROT RPL=30", "TRANS X5", True),
        ("TRAORI", "TRANS X5", False),
        ('CYCLE800(1,"",0,57,0,0,0,0,30,0,0,0,0)', "TRANS", False),
        ("TOFRAME", "TRANS Y5", False),
    ],
)
def test_a_frame_of_the_program_ends_with_its_word_alone(turned: str, ended: str, known: bool) -> None:
    program = _read(f"{BEGIN}{turned}\nG1 X5 Y5 F100\n{ended}\nG1 X20 Y0 F100\nX30\nM30\n")
    assert not (program.motions.block == 3).any()
    assert bool((program.motions.block == 6).any()) is known


@pytest.mark.parametrize(
    ("line", "note"),
    [
        ("X=R1 Y5", "X=R1"),
        ("G1 X=R1+2*(3 + 4)", "X=R1+2*(3 + 4)"),
        ("CYCLE81(10,0,2,-5)", "CYCLE81(10,0,2,-5)"),
        ("M88", "M88"),
        ("F=R2", "F=R2"),
        ("TRANS X5", "TRANS"),
        ("ROT RPL=45", "ROT"),
        ("G1 AP=30 RP=5", "AP=30"),
        ("G1 X5 RND=2", "RND=2"),
        ("X5 A10", "A10"),
        ("BSPLINE X5 Y5", "BSPLINE"),
        ("SIDE_2", "unknown word or subprogram: SIDE_2"),
        ("L100", "missing subprogram: L100"),
        ("G33 Z-5 K2", "G33"),
        ("UPATH", "unknown word or subprogram: UPATH"),
        ("TRAORI", "TRAORI"),
        ("G91 X=AC(5)", "X=AC(5)"),
        ("G3 X5 Y5 I=AC(1) J0", "I=AC(1)"),
        ("POLY PO[X]=(1,2,3,4,5,6)", "PO[X]=(1,2,3,4,5,6)"),
        ("$P_PFRAME=CTRANS(X,5)", "$P_PFRAME=CTRANS(X,5)"),
    ],
)
def test_what_is_passed_through_is_named_and_ends_the_motion(line: str, note: str) -> None:
    program = _read(f"{BEGIN}X10\n{line}\nG90 G94 G21 G1 X20 F100\nM30\n".replace(" G21", " G71"))
    assert [(one.first, one.what) for one in program.notes if one.first == 3] == [(3, note)]
    assert any(one.block == 3 and one.kind in ("not understood", "frame") for one in program.breaks)
    behind = np.flatnonzero(program.motions.block == 4)
    assert np.isnan(program.motions.start[behind]).all()


@pytest.mark.parametrize("line", ["F=R2", "X5 F=R2+1", "X5 FZ=0.1"])
def test_behind_a_feed_that_nobody_knows_places_are_known_and_the_feed_is_not(line: str) -> None:
    program = _read(f"{BEGIN}X10 F100\n{line}\nX20 Y0\nX30\nX40 F200\nM30\n")
    rows = program.motions.block >= 4
    np.testing.assert_allclose(program.motions.end[rows, 0], [0.02, 0.03, 0.04])
    np.testing.assert_allclose(program.motions.feed[rows] / MM_PER_MIN, [math.nan, math.nan, 200.0])


@pytest.mark.parametrize("line", ["CUT2D", "LIMS=2500"])
def test_settings_of_cutter_and_spindle_move_nothing(line: str) -> None:
    program = _read(f"DIAMOF\n{BEGIN}X10\n{line}\nX20\nM30\n")
    assert not program.notes
    assert program.motions.start[-1, 0] == pytest.approx(0.01)


def test_what_is_conditional_is_passed_through() -> None:
    program = _read(BEGIN + "X10\nIF R1>5\nX20\nELSE\nX30\nENDIF\nX40\nM30\n")
    note = program.notes[0]
    assert (note.first, note.last, note.what) == (3, 7, "IF")
    assert not np.isin(program.motions.block, range(3, 8)).any()


def test_modal_calls_end_with_their_end() -> None:
    program = _read(BEGIN + "X10\nMCALL CYCLE81(10)\nX20\nX30\nMCALL\nG1 X40\nX50\nM30\n")
    assert not np.isin(program.motions.block, (4, 5)).any()
    assert program.motions.start[-1, 0] == pytest.approx(0.04)


@pytest.mark.parametrize(
    ("text", "note", "lines"),
    [
        ("X1\nGOTOB L1", "lines of a jump: GOTOB L1", (0, 4)),
        ("X1\nIF R1==1 GOTOF E1\nX2\nE1: X3", "lines of a jump: GOTOF E1", (3, 5)),
        ("N30 X1\nX2\nGOTOB N30", "lines of a jump: GOTOB N30", (2, 4)),
        ("N30 X1\nX2\nN40 @126 R1 K0 K-30", "program with branches of CL 800: @126", (0, 5)),
        ("B1:\nX2\nREPEAT B1 P=3", "repeated part", (2, 4)),
        ("B1: X2\nX3\nREPEATB B1 P=2", "repeated part", (2, 2)),
        ("B1: X2\nE1: X3\nREPEAT B1 E1 P=2", "repeated part", (2, 4)),
        ("WHILE R1<5\nX1", "WHILE", (2, 4)),
        ("REPEAT\nX1\nUNTIL R1==5", "REPEAT", (2, 4)),
        ('EXTCALL("B")', "call of another program", (2, 2)),
        ("CIP X5 Y5 Z2 I1=1 J1=4", "circle in space, or from an unknown posi...", (2, 2)),
        ("POLY PO[X]=(5) PO[]=(1,9)", "denominator with a zero: POLY PO[X]=(5) ...", (2, 2)),
        ("X5 F=FPO(600,3000,0)", "feed that falls to zero: X5 F=FPO(600,30...", (2, 2)),
    ],
)
def test_what_may_not_run_once_or_cannot_be_followed_is_passed_through(text: str, note: str, lines) -> None:
    program = _read(f"{BEGIN}{text}\nM30\n")
    # The REPEATB behind the block that it repeats is named as well.
    again = [(4, 4)] if "REPEATB" in text else []
    assert [(one.first, one.last) for one in program.notes if one.what == note] == [lines, *again]
    assert not np.isin(program.motions.block, range(lines[0], lines[1] + 1)).any()
    with pytest.raises(InputError, match="expected a program that is understood throughout"):
        read_as("siemens", f"{BEGIN}{text}\nM30\n".encode(), "part.mpf", strict=True)


def test_a_radius_that_does_not_reach_is_refused_where_strict() -> None:
    with pytest.raises(InputError, match="radius too small to reach the arc's end"):
        read_as("siemens", f"{BEGIN}G2 X5 Y5 CR=1\nM30\n".encode(), "part.mpf", strict=True)


def test_parameters_are_worked_out_where_lines_run_in_their_order() -> None:
    program = _read(BEGIN + "R1=5 R2=.5\nR3=(R1+1)*R2-R1/2\nX=R3 Y=R1\nR1=R1+1\nY=R1 F=R1*100\nR1=2 Y=R1\nM30\n")
    ends = program.motions.end[1:] * 1e3
    assert ends[0, :2].tolist() == pytest.approx([0.5, 5.0])
    assert ends[1, 1] == pytest.approx(6.0)
    assert program.motions.feed[2] == pytest.approx(0.01)
    assert [note.first for note in program.notes] == [7]
    jumps = _read(BEGIN + "R1=5\nX=R1\nIF R1>3\nX2\nENDIF\nM30\n")
    assert 3 in [note.first for note in jumps.notes]


def test_nothing_comes_between_a_tangential_block_and_the_one_before_it() -> None:
    """A short move there would be the one that its direction goes on from."""
    program = read_siemens(b"G90 G71 F100\nG1 X0 Y0\nX5\nX10 Y10\nCT X20 Y20\nX30 Y10\nG1 X40\nX50\nM30\n", "a.mpf")
    assert program.notes[0].what == "block before a tangential one"
    assert program.motions.block.tolist() == [1, 2, 6, 7]
    program = read_siemens(b"G90 G71 F100\nG1 X0 Y0\nX5\nX10 Y10\n/X12\nCT X20 Y20\nX30 Y10\nG1 X40\nM30\n", "a.mpf")
    assert program.motions.block.tolist() == [1, 2, 7]


@pytest.mark.parametrize(
    "line", ["WHEN $AA_IM[X]>10 DO M8", "N7 IDS=1 WHENEVER $A_IN[1]==1 DO POS[Z]=5", "ID=1 DO $AC_OVR=50"]
)
def test_synchronized_actions_are_named_and_the_block_behind_stays_the_next_one(line: str) -> None:
    modes = "G90 G71 G17 G40 G94 G64 G54 F100"
    text = f"{modes}\nG1 X0 Y0\nX5\n{line}\n{modes} G1 X10 Y10\nG1 X40 Y10\nX50\nM30\n"
    program = read_siemens(text.encode(), "a.mpf")
    assert program.notes[0].what.startswith("synchronized action: ")
    assert program.motions.block.tolist() == [1, 2, 5, 6]


def test_a_rounded_corner_ends_the_motion_on_both_sides() -> None:
    """What is put between the two blocks of a corner would be its next block."""
    program = _read(BEGIN + "X10 RND=2\nY10\nX20\nRNDM=1\nX30\nY20\nRNDM=0\nX40\nM30\n")
    assert program.motions.block[1:].tolist() == [4, 9]
    assert np.isnan(program.motions.start[1:, 0]).all()


CURVES = [
    Line([[0, 0], [0.01, 0]]),
    PH([0.01, 0], [[0.2, 0.0], [0.16, -0.1], [0.05, 0.2]]),
    Arc([0.02, 0.0], [0.0, 0.0], [0.01, 0.0], "cw"),
]


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.thinned(4)
def test_own_programs_are_read_back(curve) -> None:
    """Motions against an independent reading of the same text in exact numbers: places, and times."""
    track = Track(make_path([curve]))
    plan = make_plan(track, dips=[(0.5 * track.length, 0.1, 0.05)], machine=make_machine())
    text = make_program(plan, track, DIALECT).text
    program = read_as("siemens", text.encode(), "part.mpf")
    assert not program.notes
    motions = program.motions
    ends = text.index("G641"), text.rindex("M30")
    first = np.searchsorted(motions.block, [text[:end].count("\n") for end in ends])
    blocks = list(read_blocks(text))
    blocks = blocks[len(list(read_blocks(text[: text.index("G641")]))) :]
    lines = np.unique(motions.block[first[0] : first[1]])
    assert lines.size == len(blocks)
    for line, block in zip(lines.tolist(), blocks, strict=True):
        rows = np.flatnonzero(motions.block == line)
        length, time = 0.0, 0.0
        for row in rows.tolist():
            way = sum(one.length for one in curves_of(motions, row, (0, 1)))
            length, time = length + way, time + way / motions.feed[row]
        assert motions.end[rows[-1], :2] * 1e3 == pytest.approx([float(block.end[a]) for a in "XY"], abs=1e-12)
        assert 1e3 * length == pytest.approx(float(block.length()), rel=1e-9)
        with mpmath.workdps(15):
            passed = mpmath.quad(lambda p, one=block: 1 / one.feed_at(p), [0, 1]) * block.length() * 60
        assert time == pytest.approx(float(passed), rel=1e-6)
    path, warnings = main_path(program)
    assert not warnings
    assert path.s[-1] == pytest.approx(track.length, abs=5e-4)


def test_blanks_take_no_longer_than_other_text() -> None:
    """They took minutes when a line was read in every way in which they can be shared among its parts."""
    line = 12_000 * " " + "x"
    begun = time.process_time()
    assert len(_read("\n".join(["G71", *8 * [line], ""])).notes) >= 1
    assert time.process_time() - begun < 5.0


@pytest.mark.parametrize("end", ["M17", "RET", "N90 M17", "M30"])
@pytest.mark.parametrize("measure", ["", "G90 ", "G91 "])
def test_a_subprogram_that_leaves_g90_and_g91_to_its_caller_moves_nobody_knows_where(measure: str, end: str) -> None:
    """A call keeps modes: the same lines are places for one caller and increments for another."""
    program = _read(f"F500\n{measure}G1 X10 Y0\nX20 Y10\nX0\n{end}\n")
    unknown = measure == "" and end != "M30"
    assert any("G90 or G91" in note.what for note in program.notes) == unknown
    assert bool(program.motions.kind.size) != unknown


def test_variables_that_the_program_defines_are_worked_out_in_place() -> None:
    program = _read(
        "DEF REAL HGT=5.5, DPT=-2\nG71 G90\nG0 X1 Y1 Z=HGT+1\nG1 X=DPT F100\nHGT=3\nZ=HGT*2\n"
        "DPT=HGT+SIN(3)\nX=DPT\nM30\n"
    )
    assert [note.what for note in program.notes] == ["parameter: DPT=HGT+SIN(3)", "X=DPT"]
    assert (1e3 * program.motions.end).round(9).tolist()[:3] == [[1, 1, 6.5], [-2, 1, 6.5], [-2, 1, 6]]


@pytest.mark.parametrize("said", ["", "DIAMOF ", "DIAMON "])
@pytest.mark.parametrize("turned", ["G95 G96 S200 LIMS=2500", "G95 S900\nCYCLE97(1.5)", "S900"])
def test_a_lathe_s_x_is_followed_where_the_program_says_what_it_is(turned: str, said: str) -> None:
    """A setting of the control decides otherwise, and an offset would be half of what it is to be."""
    program = _read(f"{said}G18 G90\n{turned}\nG0 X40 Z2\nG1 Z-10 F0.2\nX50\nG1 X40\nM30\n")
    assert bool(program.motions.kind.size) == (said != "")
    assert any("X may be a diameter" in note.what for note in program.notes) == (said == "")
    if said:
        assert program.motions.end[-1, 0] * 1e3 == (20.0 if said == "DIAMON " else 40.0)
    assert np.isnan(program.motions.feed[program.motions.kind == LINE]).all()


def test_the_time_of_a_rest_is_no_feed_a_turn() -> None:
    program = _read("G90 G71\nG0 X0 Y0 Z0\nG1 X10\nG4 F0.01\nG1 X20\nM30\n")
    assert {state.feed_mode for state in program.modal} <= {None, 94}


def test_a_mill_s_x_is_none() -> None:
    program = _read("G17 G90 G94\nG0 X40 Y2\nG1 Y-10 F200\nX50\nM30\n")
    assert program.motions.kind.size == 3
    assert program.notes == ()


def test_a_swivelled_plane_ends_where_cycle800_has_no_values() -> None:
    swivel = 'CYCLE800(1,"A",0,57,0,0,0,30,0,0,0,0,0,1)'
    program = _read(
        f"G17 G90 G94 F100\nCYCLE800()\nG1 X1 Y0\nX2\n{swivel}\nG1 X3 Y0\nX4\nCYCLE800()\nG1 X5 Y0\nX6\nM30\n"
    )
    ends = (1e3 * program.motions.end[:, 0]).round(9).tolist()
    assert ends == [1.0, 2.0, 5.0, 6.0]
    turned = _read(f"G17 G90 G94 F100\nROT Z30\n{swivel}\nCYCLE800()\nG1 X5 Y0\nX6\nM30\n")
    assert not turned.motions.kind.size


def test_under_g70_lengths_are_inches_and_f_counts_as_the_control_is_set() -> None:
    """Programming Manual, Fundamentals, "Inch or metric dimensions": G700 changes F too, G70 does not."""
    program = _read("G70 G90\nG0 X1 Y2\nG1 X2 F100\nG94 X3\nM30\n")
    assert (program.motions.end[:, 0] / 25.4e-3).round(9).tolist() == [1.0, 2.0, 3.0]
    assert np.isnan(program.motions.feed[1:]).all()
    program = _read("G700 G90\nG1 X2 F100\nG710\nX30 F600\nM30\n")
    assert program.motions.end[:, 0].round(9).tolist() == [0.0508, 0.03]
    assert (60e3 * program.motions.feed).round(9).tolist() == [2540.0, 600.0]
    program = _read("G70\nG0 X1\nG71\nG1 X5 F600\nM30\n")
    assert (60e3 * program.motions.feed[1:]).round(9).tolist() == [600.0]


def test_a_tool_s_length_in_iso_words_moves_z_alone() -> None:
    program = _read("G71 G90 G17\nG0 X1 Y2 Z3\nG43 H1\nG1 X5 F100\nG49\nM30\n")
    assert np.array_equal(program.motions.end[-1], [0.005, 0.002, np.nan], equal_nan=True)


SAFE = "G71 G17 G90 G94 G40 G54 G64"


def _ends_behind(program: PartProgram, line: int) -> np.ndarray:
    """X and Y [mm] at the ends of the motions of a line and those behind it."""
    return (1e3 * program.motions.end[program.motions.block >= line, :2]).round(9)


@pytest.mark.parametrize(
    ("call", "under", "behind", "ends"),
    [
        ("CYCLE81(10,0,2,-5)", "G90 G0 X5 Y5 F700", "G1 X20 Y20\nX40", [[20, 20], [40, 20]]),
        ("CYCLE81(10,0,2,-5)", "ROT RPL=30", "G1 X20 Y20\nX40", []),
        ("CYCLE81(10,0,2,-5)", "G41 X5", "G1 X20 Y20\nX40", []),
        ("CYCLE81(10,0,2,-5)", "R1=20", "G1 X=R1 Y20\nX40", [[20, 20], [40, 20]]),
        ("L10", "X5 Y5", "G1 X20 Y20\nX40", []),
        ("L10", "X5 Y5", f"{SAFE}\nG1 X=R1 Y20 F100\nX40", [[40, math.nan]]),
        ("SLOT_MEIN(5)", "X5 Y5", "G1 X20 Y20\nX40", []),
    ],
)
def test_what_blocks_under_a_modal_call_set_stays(call: str, under: str, behind: str, ends) -> None:
    """A subprogram may set any mode and parameter besides; a cycle of the control brings them back."""
    program = _read(f"{SAFE}\n{BEGIN}R1=10\nMCALL {call}\n{under}\nMCALL\n{behind}\nM30\n")
    assert not np.isin(program.motions.block, (4, 5, 6)).any()
    np.testing.assert_allclose(_ends_behind(program, 7), np.reshape(ends, (-1, 2)))


def test_the_feed_and_the_measure_of_blocks_under_a_modal_call_stay() -> None:
    program = _read(f"{SAFE}\n{BEGIN}MCALL CYCLE81(10)\nG1 X5 F700\nMCALL\nX20\nX30\nM30\n")
    assert (program.motions.feed[-1] / MM_PER_MIN).round(9) == 700.0
    program = _read(f"{SAFE}\n{BEGIN}MCALL CYCLE81(10)\nG91 X5\nMCALL\nX20\nX30\nM30\n")
    assert (1e3 * np.diff(program.motions.end[-2:, 0])).round(9) == 30.0
    program = _read(f"{SAFE}\n{BEGIN}MCALL CYCLE81(10)\nX5\nM30\nX20 Y20\n")
    assert program.breaks[-1].block == 5


def test_a_subprogram_whose_name_begins_as_a_cycle_s_does_may_set_anything() -> None:
    program = _read(f"{SAFE}\n{BEGIN}R1=10\nSLOT_MEIN(5)\nG1 X=R1 Y20\nX40\nM30\n")
    assert program.motions.block.max() < 4
    program = _read(f"{SAFE}\n{BEGIN}R1=10\nSLOT1(5)\nG1 X=R1 Y20\nX40\nM30\n")
    assert _ends_behind(program, 5).tolist() == [[10, 20], [40, 20]]


@pytest.mark.parametrize(
    ("before", "slashed", "behind", "blocks"),
    [
        ("X0 Y0", "X10", "X=IC(5)\nX20\nX=IC(5)", [6, 7]),
        ("R1=30", "R1=50", "X=R1\nX20\nR1=2\nX=R1", [6, 8]),
        ("G91 X5 Y5", "G90", "X20 Y20\nX40\nG90 X30\nX20", [7, 8]),
        ("MCALL CYCLE81(10)", "MCALL", "G1 X20 Y20\nX40\nMCALL\nG1 X10", [8]),
        ("X1", "MCALL CYCLE81(10)", "G1 X20 Y20\nX40\nMCALL\nG1 X10", [8]),
        ("RNDM=3", "RNDM=0", "G1 X20 Y20\nX40\nRNDM=0\nG1 X10", [8]),
        ("CT X30 Y20", "G1", "X20 Y20\nX40\nG1 X10", [7]),
        ("X1", "FLIN", "X20 F100\nX40\nFNORM F100\nG1 X10", [8]),
        ("X1", "SIDE_2", "G71 G17 G94 G40 G54\nG1 X10 F100\nG90\nG1 X10", [8]),
    ],
)
def test_what_a_line_with_a_slash_sets_may_be_so_or_not(before: str, slashed: str, behind: str, blocks) -> None:
    """Only what stands behind its end, or what does not need it, is followed."""
    program = _read(f"{SAFE}\n{BEGIN}{before}\n/{slashed}\n{behind}\nM30\n")
    rows = program.motions.block
    assert rows[rows >= 5].tolist() == blocks


@pytest.mark.parametrize("line", ["SIDE_2", "IF R1==1\nG91\nENDIF"])
def test_behind_a_subprogram_the_measure_is_that_which_the_program_says(line: str) -> None:
    text = f"{SAFE}\n{BEGIN}{line}\nG71 G17 G94 G40 G54 G64\nG1 X10 Y10 F100\nX20\nG90 X30 Y0\nX40\nM30\n"
    program = _read(text)
    first = text[: text.index("G90 X30")].count("\n")
    assert program.motions.block[program.motions.block > 2].tolist() == [first, first + 1]


@pytest.mark.parametrize(
    ("set_within", "known", "ended"),
    [
        ("X5", True, ""),
        ("CYCLE800(1)", False, ""),
        ("TRAORI", False, ""),
        ("ROT RPL=30", False, "ROT"),
        ("MIRROR X0", False, "SCALE"),
        ("TRANS X5", True, ""),
        ("$P_PFRAME=CROT(Z,45)", False, "ROT"),
        ("$P_UIFR[1,X,TR]=5", True, ""),
        ("MCALL CYCLE81(10)", False, "MCALL"),
        ("RNDM=2", False, "RNDM=0"),
        ("DIAMON", False, ""),
        ("FLIN", False, "FNORM"),
        ("G291", False, "G290"),
    ],
)
def test_what_lines_that_may_not_run_leave_in_force_lasts_to_its_end(set_within: str, known: bool, ended: str) -> None:
    """A line that says all modes anew ends none of these."""
    begin = f"{SAFE}\n{BEGIN}IF R1==1\n{set_within}\nENDIF\n{SAFE}\n"
    program = _read(f"{begin}G1 X20 Y20 F500\nX40\nM30\n")
    assert (program.motions.block > 6).any() == known
    if ended:
        program = _read(f"{begin}{ended}\n{SAFE}\nG1 X20 Y20 F500\nX40\nM30\n")
        assert (program.motions.block > 8).any()


@pytest.mark.parametrize(
    "line", ["$P_PFRAME=CROT(Z,45)", "$P_UIFR[1]=CTRANS(X,5):CROT(Z,5)", "$P_CHBFRAME[0]=$P_IFRAME", "G258 RPL=45"]
)
def test_frames_that_are_turned_by_other_words_stay_turned(line: str) -> None:
    program = _read(f"{SAFE}\n{BEGIN}{line}\n{SAFE}\nG1 X20 Y20 F500\nX40\nM30\n")
    assert program.motions.block.max() < 3


def test_iso_mode_is_passed_through_and_what_it_turns_stays_turned() -> None:
    iso = f"{SAFE}\n{BEGIN}G291\nG90 G1 X5 (words)\n{{}}{SAFE} G1 X6\nG290\n{SAFE}\nG1 X20 Y20 F500\nX40\nM30\n"
    assert _ends_behind(_read(iso.format("")), 3).tolist() == [[20, 20], [40, 20]]
    assert not _ends_behind(_read(iso.format("G68 X0 Y0 R45\n")), 3).size
    assert _read(iso.format("N9M30\n")).breaks[-1].block == 5


def test_an_offset_that_is_set_as_a_variable_keeps_no_frame_of_the_program() -> None:
    begin = f"{SAFE}\n{BEGIN}$P_UIFR[1,X,TR]=5\n{SAFE}\nROT RPL=30\nG1 X1 F100\nROT\n"
    assert _ends_behind(_read(f"{begin}G1 X20 Y20 F500\nX40\nM30\n"), 5).tolist() == [[20, 20], [40, 20]]


@pytest.mark.parametrize("line", ["G[14]=2", "G=R1"])
def test_behind_g_words_of_computed_numbers_no_mode_is_known(line: str) -> None:
    program = _read(f"{SAFE}\n{BEGIN}{line}\nG1 X20 Y20\nX40\n{SAFE}\nG1 X5 F100\nM30\n")
    assert program.motions.block[1:].tolist() == [7]


def test_under_fcub_no_feed_is_constant() -> None:
    program = _read(f"{SAFE}\n{BEGIN}FLIN\nFCUB\n{SAFE}\nG1 X20 Y20 F500\nX40\nFNORM\nX50 F300\nX60\nM30\n")
    assert program.motions.block[1:].tolist() == [9, 10]
    assert (program.motions.feed[-2:] / MM_PER_MIN).round(9).tolist() == [300.0, 300.0]


@pytest.mark.parametrize("feed", ["F=R1", "FZ=0.1"])
@pytest.mark.parametrize("modes", ["G93", "FLIN", "FCUB"])
def test_where_blocks_need_the_feed_nothing_is_known_behind_one_that_nobody_knows(modes: str, feed: str) -> None:
    program = _read(f"{SAFE}\n{BEGIN}X10 F500\n{modes}\nX20 {feed}\nX0\nY20 F400\nX0 F300\nM30\n")
    assert program.motions.block.max() == 3
    program = _read(f"{SAFE}\n{BEGIN}X10 F500\nG93 X20 {feed}\nX0\nX30\nM30\n")
    assert program.motions.block.max() == 3


@pytest.mark.parametrize("line", ["X20 A5 F300", f"X=R1 F=R1\n{SAFE} G1"])
def test_a_feed_that_changes_on_an_unknown_way_or_from_an_unknown_one_is_passed_through(line: str) -> None:
    program = _read(f"{SAFE}\n{BEGIN}X10 F500\nFLIN\n{line}\nY20 F400\nX0 F300\nX10\nX20 F200\nX30\nM30\n")
    named = [note for note in program.notes if note.what.startswith("feed of an unknown course")]
    assert [program.text(note.first).strip() for note in named] == [b"Y20 F400", b"X0 F300"]
    behind = program.motions.block > named[-1].last
    assert program.motions.feed[behind][[0, -1]] / MM_PER_MIN == pytest.approx([300.0, 200.0])


@pytest.mark.parametrize("line", ["X20 F200", "X=IC(0) F200", "G0 X20 F200\nG1"])
def test_a_block_that_stays_where_it_is_changes_the_feed_alone(line: str) -> None:
    program = _read(f"{SAFE}\n{BEGIN}X10 F500\nFLIN\nX20 F300\n{line}\nX60 F100\nFNORM X70\nM30\n")
    assert not program.notes
    first = program.motions.block == program.motions.block[-1] - 1
    assert program.motions.feed[first][[0, -1]] / MM_PER_MIN == pytest.approx([200.0, 100.0], abs=2.0)
    assert program.motions.feed[-1] / MM_PER_MIN == pytest.approx(100.0)
