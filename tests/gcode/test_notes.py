"""What is passed through is named once a stretch, and what it may have changed is not guessed."""

import numpy as np
import pytest

from ph_post.errors import InputError
from ph_post.gcode.read import read_program

HEAD = "G21 G90 G17 G94 F600\nG0 X0 Y0 Z0\n"
PLANE = "spline in another plane than G17"
COMPUTED = "value that is computed"
AXIS = "axis other than X, Y and Z"
PAIR = "cut in which several rotary axes turn, perhaps about the tip of the tool"
FRAME = "motion in a turned, scaled, polar or diameter frame, or under other kinematics"
OTHERS = " of other controllers, which moves nothing"
SPECIAL = "word of one controller, or of more digits than are kept"


def read(body, **options):
    return read_program((HEAD + body).encode(), "a.ngc", **options)


def notes(program):
    return [(note.first, note.last, note.column, note.what) for note in program.notes]


@pytest.mark.parametrize(
    ("body", "expected"),
    [
        ("#1=5\n#2=[#1+1]\nG1 X#1\n", [(2, 3, 1, "parameter: #1=5"), (4, 4, 4, f"{COMPUTED}: X#1")]),
        ("G1 X[1+2] Y5\n", [(2, 2, 4, "value that is computed: X[1+2]")]),
        ("G1 X-#5\nY SIN[30]\n", [(2, 3, 4, "value that is computed: X-#5")]),
        ("G5 X1 I1 P1 J1 Q1 A5\nM8\nG1 X2 B5 C1\n", [(2, 2, 19, f"{AXIS}: A5"), (4, 4, 7, f"{PAIR}: B5")]),
        ("G41 D1\nG1 X5\n\n(a)\nM8\nG1 X6\nG40\n", [(2, 7, 1, "cutter compensation: G41")]),
        ("G81 X1 Z-5 R1\nX2\n\nX3\nG80\n", [(2, 5, 1, "canned cycle: G81")]),
        ("G0 @5 ^30\n", [(2, 2, 1, "polar coordinates: G0 @5 ^30")]),
        ("/G1 X5\n/2 M8\n", [(2, 3, 1, "block delete: /G1 X5")]),
        ("M98 P100\n", [(2, 2, 1, "subprogram: M98")]),
        ("G187 M3\n", [(2, 2, 1, "unknown G word: G187")]),
        ("G-810 X1\n", [(2, 2, 1, "unknown G word: G-810")]),
        ("G1.05\nG100\n", [(2, 3, 1, "unknown G word: G1.05")]),
        ("M3 M150 S5\n", [(2, 2, 4, "unknown M word: M150")]),
        ("G9 G1 X5\n", [(2, 2, 1, f"G word{OTHERS}: G9")]),
        ("G65 P1\n", [(2, 2, 1, "subprogram: G65")]),
        ("M97 P1\n", [(2, 2, 1, "subprogram: M97")]),
        ("G1 X5 R2\n", [(2, 2, 7, "word that no other on the line uses: R2")]),
        ("P2\nH1\nM8 K0\n", [(2, 4, 1, "word that no other on the line uses: P2")]),
        ("G54\nG54 P3\n", [(3, 3, 5, "word that no other on the line uses: P3")]),
        ("G33 Z-5 K1\n", [(2, 2, 1, "motion tied to the spindle: G33")]),
        ("$H\n", [(2, 2, 1, "line for the controller itself: $H")]),
        ("G68 X0 Y0 R30\nG69\n", [(2, 2, 1, f"{FRAME}: G68 X0 Y0 R30")]),
        ("G1 X5,R2\n", [(2, 2, 1, f"{SPECIAL}: G1 X5,R2")]),
        ("G18 G5 X1 I1 P1 J1 Q1\n", [(2, 2, 1, f"{PLANE}: G18 G5 X1 I1 P1 J1 Q1")]),
        ("G5.3\n", [(2, 2, 1, "spline that is not whole: G5.3")]),
        ("G5 X1 Y1\n", [(2, 2, 1, "spline that is not whole: G5 X1 Y1")]),
        ("G4 X2\n", [(2, 2, 4, "dwell with axis words: X2")]),
        ("G80\nX5\n", [(3, 3, 1, "axis words without a motion mode: X5")]),
        ("G54\nG2 X5 I5\n", [(3, 3, 1, "arc from an unknown position: G2 X5 I5")]),
        ("o<a> call [1]\n", [(2, 2, 1, "O-word: o<a> call [1]")]),
        ("o1 sub\nG1 X5\no1 endsub\n", [(2, 4, 1, "O-word: o1 sub")]),
    ],
)
def test_a_stretch_is_named_by_the_word_it_is_for(body, expected):
    program = read(body)
    assert notes(program) == expected
    assert {one.kind for one in program.breaks[1:-1]} - {"frame"} == {"not understood"}
    assert all(program.text(note.first) for note in program.notes)


def test_strict_refuses_the_first_of_them_with_a_caret():
    with pytest.raises(InputError) as refusal:
        read("G1 X1\nG1 X2 A5 B1\nX#1\n", strict=True)
    assert str(refusal.value) == (
        f"a.ngc:4:7: not understood; expected a program that is understood throughout; got {PAIR}: A5"
    )
    assert refusal.value.excerpt == "    G1 X2 A5 B1\n          ^^"


def test_strict_reads_what_is_understood():
    assert read("G1 X1\nG2 X5 I2\nM2\n", strict=True).notes == ()


def test_a_fault_before_the_first_of_them_comes_first():
    with pytest.raises(InputError, match=r"a\.ngc:3:7: the same letter twice"):
        read("G1 X1 X2\nX#1\n", strict=True)


def last_end(program):
    return (program.motions.end[-1] * 1e3).round(9)


@pytest.mark.parametrize(
    ("stretch", "understood"),
    [
        ("o1 sub\nM8 S5\no1 endsub\no1 call\n", True),
        ("o1 sub\nG1 X5\no1 endsub\no1 call\nG1\n", True),
        ("o1 sub\nG91\no1 endsub\no1 call\n", False),
        ("o1 if [#1 GT 0]\nG20\no1 endif\n", False),
        ("o1 sub\nG#3\no1 endsub\n", False),
        ("o9 call\n", False),
        ("M98 P9\n", False),
        ("/G91\n", False),
        ("/M8\n", True),
        ("G#1\n", False),
        ("M72\n", False),
        ("G65 P9\n", False),
        ("M97 P9\n", False),
        ("G9 M106\n", True),
        ("G68.2 R5\n", False),
        ("G12.1\n", False),
        ("/G69\n", True),
        ("G68 R5\n/G69\n", False),
        ("G90 G91\n", False),
        ("G90 X&\n", True),
        ("G91 X&\n", False),
        ("G20 (open\n", False),
        ("G68 R5\n", False),
        ("G68 R5\nG69\n", True),
        ("G7\n", False),
        ("G7\nG8\n", True),
    ],
)
def test_a_mode_that_a_stretch_may_have_changed_is_not_relied_on(stretch, understood):
    program = read(f"G1 X1\n{stretch}G1 X7 Y8 Z9\n")
    assert (program.motions.block[-1] == program.blocks - 1) == understood


def test_modes_said_again_are_relied_on_again():
    program = read("o9 call\nG21 G90 G17 G94 G91.1 F100\nG1 X7 Y8 Z9\nG2 X9 I1\n")
    assert last_end(program).tolist() == [9, 8, 9]
    assert program.motions.feed[-1] == pytest.approx(0.1 / 60)


@pytest.mark.parametrize(
    "stretch",
    [
        "o1 while [#1 LT 5]\nG1 X5\no2 if [1]\no3 call\no2 endif\no1 endwhile\n",
        "o1 do\nG1 X5\no1 while [0]\n",
        "o<name> sub\no<name> return\no<name> endsub\n",
        "o1 repeat [5]\nX1 X2 (not looked at)\no1 endrepeat\n",
        "O 1 IF [1]\nX5\nO1 ELSE\nX6\nO1 ENDIF\n",
    ],
)
def test_a_body_is_passed_through_whole(stretch):
    program = read(stretch + "M2\n")
    count = stretch.count("\n")
    assert [(note.first, note.last) for note in program.notes] == [(2, 1 + count)]
    assert program.motions.block.tolist() == [1]


def test_a_body_without_an_end_goes_to_the_end():
    assert [(note.first, note.last) for note in read("o1 sub\nG1 X1\nG1 X2\n").notes] == [(2, 4)]


def test_a_number_of_a_program_is_no_stretch():
    program = read_program(b"%\nO1234 (a name)\nG21 G90\nG0 X1\nM30\n%\n", "a")
    assert program.notes == ()
    assert program.motions.block.tolist() == [3]


def test_one_place_is_known_again_by_words_behind_an_arc_from_nowhere():
    program = read("G54\nG2 X5 Y6 I5\nG1 X7\n")
    np.testing.assert_array_equal(program.motions.start[-1], [5e-3, 6e-3, np.nan])


def test_moves_in_a_plane_that_is_not_known_are_read() -> None:
    program = read_program(b"M98 P7\nG21 G90 G94\nG1 X1 Y2 F60\nG17\nG1 X3\n", "a.ngc")
    assert program.motions.plane.tolist() == [17, 17]


def test_a_line_for_the_controller_itself_resets_no_more_than_the_program_has_set() -> None:
    """Homing runs the lines with which Grbl starts (system.c); what was said since then is not known any more."""
    moves = "G1 X1 Y2 F60\nX3\n"
    assert read_program(f"$H\n$X\nG21 G90\n{moves}".encode(), "a.nc").motions.kind.size == 2
    assert read_program(f"G91\n$H\n{moves}".encode(), "a.nc").motions.kind.size == 0
    known = read_program(f"G91\n$H\nG90\n{moves}".encode(), "a.nc").motions
    np.testing.assert_array_equal(known.end[-1], [3e-3, 2e-3, np.nan])
