"""Fanuc programs that are written out, beside the same ones in LinuxCNC's language and its interpreter."""

import cmath
import math

import pytest
from support.canon import needs_rs274
from support.interpreted import difference, interpret

from ph_post.api.expansion import before_expansion
from ph_post.expand.expand import ExpandError, Folders, expand
from ph_post.expand.macro import FanucNumbers

HEAD = "G21 G17 G90 G40 G94 F600.\n"
TWINS = {
    "a bolt circle": (
        "#101=6\n#102=25.\n#1=0\nWHILE[#1LT#101]DO1\n#2=#1*360/#101\n"
        "G0 X[#102*COS[#2]] Y[#102*SIN[#2]]\n#1=#1+1\nEND1\n",
        "#101=6\n#102=25.\n#1=0\no1 while [#1 LT #101]\n#2=[#1*360/#101]\n"
        "G0 X[#102*COS[#2]] Y[#102*SIN[#2]]\n#1=[#1+1]\no1 endwhile\n",
    ),
    "jumps": (
        "#1=3\nN10 G1 X#1 Y-#1\n#1=#1-1\nIF[#1 GT 0]GOTO 10\nIF[#1EQ0]THEN#2=7.5\nGOTO20\nX99.\nN20 Y#2\n",
        "o1 repeat [3]\n#1=[3-#9]\nG1 X#1 Y-#1\n#9=[#9+1]\no1 endrepeat\nY7.5\n",
    ),
    "functions": (
        "#1=ATAN[1.]/[-1.]\n#2=SQRT[2.]+ABS[-3.]*2\n#3=FIX[-2.7]+FUP[-2.2]\n#4=17MOD5\n#5=ROUND[2.5]+[6AND3]\n"
        "G1 X#1 Y#2\nX#3 Y#4\nX#5 Y[ASIN[.5]-ACOS[.5]]\nX[LN[EXP[2.]]] Y[TAN[45.]]\n",
        "#1=[ATAN[1]/[-1]]\n#2=[SQRT[2]+ABS[-3]*2]\nG1 X#1 Y#2\nX-5 Y2\nX5 Y[ASIN[.5]-ACOS[.5]]\n"
        "X[LN[EXP[2]]] Y[TAN[45]]\n",
    ),
    "a macro with values": (
        "G65 P9010 A10. B-2.5\nG65 P9010 A[1.+1.]\nM30\nO9010\n#1=#1+1.\nG1 X#1 Y#2\nIF[#2EQ#0]GOTO5\nY0.\nN5 M99\n",
        "G1 X11 Y-2.5\nY0\nG1 X3\n",
    ),
    "an empty variable is no word": ("G1 X1. Y2.\nG1 X#1 Y5. Z-#2\nX3. Y[#1+4.]\n", "G1 X1 Y2\nY5\nX3 Y4\n"),
    "locals are those of the call": (
        "#1=5.\nM98 P100\nG1 X#1\nG65 P200 A1.\nX#1\nM30\nO100\n#1=#1*2\nM99\nO200\n#1=77.\nM99\n",
        "G1 X10\nX10\n",
    ),
    "loops within loops": (
        "#1=0\nWHILE[#1LT3]DO1\n#2=0\nWHILE[#2LE#1]DO2\nG91 G1 X[#1+1] Y[#2*.5]\n#2=#2+1\nEND2\n#1=#1+1\nEND1\nG90\n",
        "".join(f"G91 G1 X{i + 1} Y{j * 0.5}\n" for i in range(3) for j in range(i + 1)) + "G90\n",
    ),
}


def written(text, decimals=3, **how):
    return expand(text.encode(), "a.nc", language=FanucNumbers(decimals=decimals), **how).data


def lines_of(text, **how):
    return [line for line in written(text, **how).decode().splitlines() if "PH-POST-EXPAND" not in line]


@needs_rs274
@pytest.mark.parametrize("name", TWINS)
def test_what_a_program_comes_to_is_what_its_twin_does(name):
    fanuc, twin = TWINS[name]
    end = "" if "M30" in fanuc else "M30\n"
    # Digits that the control's increment of 0.1 µm does not have are left out in both.
    data = written(f"%\nO0001 (MAIN)\n{HEAD}{fanuc}{end}%\n", decimals=9)
    found, meant = interpret(data), interpret(f"{HEAD}{twin}M30\n".encode())
    assert (found.refusal, meant.refusal) == ("", "")
    assert difference(meant, found) == ""


@needs_rs274
def test_subprograms_come_to_what_linuxcnc_makes_of_them():
    text = f"O1\n{HEAD}G0 X0 Y0\nM98 P100 L3\nM98 P200\nG1 X9.\nM30\n"
    text += "O100\nG91 G1 X1.\nM98 P200\nG90\nM99\nO200\nG1 Y1.\nY0.\nM99\n"
    before, after = interpret(text.encode()), interpret(written(text))
    assert before.refusal == after.refusal == ""
    assert difference(before, after) == ""


def test_the_number_of_repeats_may_stand_before_the_program():
    assert lines_of("O1\nM98 P30002\nM30\nO2\nG91 X1.\nM99\n")[1:5] == ["G91 X1.", "G91 X1.", "G91 X1.", "M30"]


def test_increments_comments_and_what_stands_behind_stay():
    text = "%\nO1(A)\nN1 G21 X100 (AS IT IS)\n#1=2.\nX#1 Y100 (HALF)\nM98P5\nM30\nO5\n(SUB)\nG0 Z5. M99\n%\n"
    assert lines_of(text) == [
        *("%", "O1(A)", "N1 G21 X100 (AS IT IS)", "X2. Y100 (HALF)", "(SUB)", "G0 Z5."),
        *("M30", "O5", "(SUB)", "G0 Z5. M99", "%"),
    ]
    assert before_expansion(written(text), "a.nc") == text.encode()
    assert written(written(text).decode()) == written(text)


def test_numbers_have_the_digits_of_the_control():
    assert lines_of("O1\nG21\n#1=10./3\nX#1 F[#1*10] M#2 S[100*3]\nG20 X#1\nM30\n")[2:4] == [
        "X3.333 F33.33333 S300",
        "G20 X3.3333",
    ]


def test_subprograms_in_files(tmp_path):
    (tmp_path / "O0007.nc").write_text("%\nO0007\nG1 X#1\nM99\n%\n")
    assert lines_of("O1\nG21\n#1=4.\nM98 P7\nM30\n", folders=Folders((tmp_path,)))[2:4] == ["G1 X4.", "M30"]


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("N1 #1=1\nGOTO1\n", 3, "never ends"),
        ("G65 P1 A1. L2\n", 2, "repeats"),
        ("#1=0\nWHILE[#1LT1]DO1\nX1.\nEND1\n", 3, "never ends"),
        ("M98\n", 2, "without P"),
        ("M98 P1\n", 2, "deep"),
        ("#1=1/0\n", 2, "division by zero"),
        ("#1=5MOD0\n", 2, "division by zero"),
        ("GOTO 99\n", 2, "no such sequence number"),
        ("#1=1\nEND1\n", 3, "without its WHILE"),
        ("WHILE[0GT1]DO1\n", 2, "without its END1"),
        ("WHILE[1]\n", 2, "not whole"),
        ("#50=1\n", 2, "no such variable"),
        ("#0=1\n", 2, "always empty"),
        ("#1000=1\n", 2, "belongs to the control"),
        ("X#500\n", 2, "only the machine knows: #500"),
        ("IF[#5021GT0]GOTO1\n", 2, "only the machine knows: #5021"),
        ("#1=1.\nIF[#1EQ1.0000001]GOTO1\n", 3, "but for rounding"),
        ("X[ROUND[1.5]]\n", 2, "ROUND in a word"),
        ("G65 P1 A100\n", 2, "without a decimal point"),
        ("G66 P1\n#1=1\n", 2, "G66"),
        ("#1=1.\nM198 P2\nX#1\n", 3, "not followed: M198"),
        ("#1=1.\nM97 P2\nX#1\n", 3, "not followed: M97"),
        ("#1=198\nM#1 P1\n", 3, "computed"),
        ("#1=1.5\nS#1\n", 3, "whole number"),
        ("/#1=1\n", 2, "slash"),
        ("#1=1\nM99\n", 3, "never ends"),
        ("#1=98\nM#1 P1\n", 3, "computed"),
        ("#1=[2\n", 2, "not whole"),
        ("#1=1\nEND\xb2\n", 3, ""),
        ("WHILE[0GT1]DO\xb2\n", 2, "no number"),
        (f"#1=1\nM98P{5000 * '1'}\n", 3, "too long"),
        (f"#1=1\nN{5000 * '0'}1\n", 3, "too long"),
    ],
)
def test_what_cannot_be_written_out_is_named_with_its_line(text, line, what):
    with pytest.raises(ExpandError) as found:
        written(f"O1\n{text}M30\n")
    assert what in found.value.what
    assert found.value.file == "a.nc"
    if what != "deep" and "without an end" not in what:
        assert found.value.line == line


def turned(x, y):
    """Return the words of a place that is turned by 30 degrees about (10, 5)."""
    at = (complex(x, y) - (10 + 5j)) * cmath.rect(1.0, math.radians(30.0)) + (10 + 5j)
    return f"X{at.real:.9f} Y{at.imag:.9f}"


ARC = 3.0 * cmath.rect(1.0, math.radians(30.0))
PLAIN = "G0 X0. Y0. Z5.\n"
TURNED = {
    "holes": "G99 G81 X10. Y5. Z-3. R1. F90.\nX20.\nG98 Y9.\nG80\nG0 X0.\n",
    "holes in increments, repeated": "G91 G98 G81 X10. Y5. Z-3. R-4. K3 F90.\nX20.\nG80\nG90 G0 X0.\n",
    "holes with a dwell": "G99 G82 X10. Y5. Z-3. R1. P500 F90.\nX20. M8\nG80\n",
    "bored holes": "M3 S500\nG98 G85 X10. Y5. Z-3. R1. F90.\nG86 X20. Z-3. R1. P0\nX25.\nG80\n",
    "pecks": "G98 G83 X10. Y5. Z-3. R1. Q1.5 F90.\nG73 X20. Z-4. R1. Q1.5\nX25.\nG80\n",
    "back to G1": (
        "G1 X1.\nG98 G81 X10. Y5. Z-3. R1. F90.\nG80\nX30.\nZ4.\n",
        "G1 X1\nG98 G81 X10 Y5 Z-3 R1 F90\nG80\nG1 X30\nZ4\n",
    ),
    "bored with a dwell": (
        "G98 G89 X10. Z-3. R1. P300 F90.\nG80\n",
        "F90\nG0 X10 Y0\nG0 Z1\nG1 Z-3\nG4 P300\nG1 Z1\nG0 Z5\n",
    ),
    "turned": (
        "G68 X10. Y5. R30.\nG0 X12. Y6.\nG1 X20.\nG91 Y3.\nX-2. Y1.\nG90 G2 X21. Y13. I3.\nG3 X10. R8.\nG1 Z-1.\n"
        "G69\nG0 X0. Y0.\nX5.\n",
        f"G0 {turned(12, 6)}\nG1 {turned(20, 6)}\n{turned(20, 9)}\n{turned(18, 10)}\n"
        f"G2 {turned(21, 13)} I{ARC.real:.9f} J{ARC.imag:.9f}\nG3 {turned(10, 13)} R8\nG1 Z-1\nG0 X0 Y0\nX5\n",
    ),
    "turned holes": (
        "G68 X10. Y5. R30.\nG99 G81 X12. Y6. Z-2. R1. F90.\nX20.\nG80\nG69\nG90 G0 X0. Y0.\n",
        f"G99 G81 {turned(12, 6)} Z-2 R1 F90\n{turned(20, 6)}\nG80\nG0 X0 Y0\n",
    ),
    "mirrored": (
        "G51.1 X10.\nG1 X12. Y6.\nG2 X15. Y9. I3.\nX18. Y6. R3.\nG91 G1 X2.\nG50.1 X0\nG90 G1 X0. Y0.\n",
        "G1 X8 Y6\nG3 X5 Y9 I-3 J0\nX2 Y6 R3\nG1 X0\nG1 X0 Y0\n",
    ),
    "scaled": (
        "G51 X10. Y10. Z0. I2. J2. K1.\nG1 X12. Y6. Z1.\nG2 X15. Y9. I3.\nG50\nG1 X0. Y0. Z0.\n",
        "G1 X14 Y2 Z1\nG2 X20 Y8 I6 J0\nG1 X0 Y0 Z0\n",
    ),
}


@needs_rs274
@pytest.mark.parametrize("name", TURNED)
def test_cycles_and_turned_coordinates_are_what_linuxcnc_makes_of_plain_ones(name):
    texts = TURNED[name]
    fanuc, twin = texts if isinstance(texts, tuple) else (texts, texts.replace(" K3", " L3"))
    numbers = FanucNumbers(decimals=9, clearance=0.254)
    data = f"%\nO1\n{HEAD}{PLAIN}{fanuc}M30\n%\n".encode()
    found = expand(data, "a.nc", language=numbers)
    assert found.notes == ()
    after = interpret(found.data.replace(b"G9 ", b""))
    before = interpret(f"{HEAD}{PLAIN}{twin}M30\n".encode())
    assert (before.refusal, after.refusal) == ("", "")
    assert difference(before, after) == ""


def test_only_what_is_turned_loses_its_characters():
    text = f"O1\n{HEAD}{PLAIN}N5 G1  X10 (AS IT IS)\n"
    text += "G68 X0. Y0. R90.\nG0 X5. Y0. M8\nZ-1. (DOWN)\nG69 (BACK)\nG0 X0. Y0.\n"
    assert lines_of(text + "M30\n")[3:] == [
        *("N5 G1  X10 (AS IT IS)", "G0 M8 X0. Y5.", "Z-1. (DOWN)", "(BACK)", "G0 X0. Y0.", "M30")
    ]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("G98 G83 X10. Z-3. R1. Q1. F90.\nG80\n", "4: cycle stays as it is: G83 depends on the control's settings"),
        ("G98 G76 X10. Z-3. R1. Q1. F90.\nG80\n", "G76 depends on the control's settings"),
        ("G81 X10. Z-3. R1. F90.\nX20.\nG80\n", "neither G98 nor G99 was said (line 4)"),
        ("G98 G81 X10. R1. F90.\nG80\n", "G81 without R or Z (line 4)"),
        ("G98 G81 X10. Z-3. R9. F90.\nG80\n", "begins below its plane R (line 4)"),
        ("G98 G81 X10. Z-3. R1. F90.\nX20. M5\nG80\n", "does not belong to it (line 5)"),
        ("G98 G81 X10. Z-3. R1. F90.\nG84 X20.\nG80\n", "G84 depends on the control's settings"),
        ("G98 G86 X10. Z-3. R1. F90.\nG80\n", "not known to turn clockwise (line 4)"),
        ("G28 Z0.\nG98 G81 X10. Z-3. R1. F90.\nG80\n", "Z is not known where the cycle begins (line 5)"),
        ("G68 X0. Y0. R45\nG0 X1. Y1.\nG69\n", "G68 without its centre, or without an R with a decimal point"),
        ("G68 R45.\nG0 X1. Y1.\nG69\n", "G68 without its centre"),
        ("G68 X0. Y0. R45.\nG0 X1.\nG69\n", "names not all axes in G90 (line 5)"),
        ("G68 X0. Y0. R45.\nG0 X1. Y1.\nG69\nG91 X1.\n", "names not all axes in G90 (line 7)"),
        ("G68 X0. Y0. R45.\nG0 X1. Y1.\nG54 X2.\nG69\n", "G54 in turned, scaled or mirrored coordinates (line 6)"),
        ("G68 X0. Y0. R45.\nG68 X1. Y1. R5.\nG69\n", "a frame within another (line 5)"),
        ("G51 X0. Y0. Z0. P500\nX1. Y1.\nG50\n", "which axes P scales"),
        ("G51 X0. Y0. Z0. I2. J1. K1.\nG1 X1. Y1.\nG2 X3. R9.\nG50\n", "scaled differently (line 6)"),
        ("G51.1 X0.\nG1 X1. Y1.\nG41 D1 X2.\nG50.1 X0.\n", "cutter compensation in scaled or mirrored"),
        ("G68 X0. Y0. R45.\nG0 X1. Y1.\n/X2.\nG69\n", "a line with a slash"),
        ("G16\nG98 G81 X10. Z-3. R1. F90.\nG80\n", ""),
        ("G16\nG69\nG98 G81 X10. Z-3. R1. F90.\nG80\n", ""),
        ("G5.1 Q1 X0. Y0. Z9.\nG98 G81 X10. Z-3. R8. F90.\nG80\n", "below its plane R (line 5)"),
    ],
)
def test_what_the_control_decides_stays_and_is_named(text, why):
    data = f"O1\n{HEAD}{PLAIN}{text}M30\n".encode()
    found = expand(data, "a.nc", language=FanucNumbers())
    assert found.data == data
    assert why in " ".join(found.notes)
    assert bool(found.notes) == bool(why)


CYCLE = "G81 X1. Y1. Z-2. R1. F90.\nX2.\nG80\n"
DRILLED = ["F90.", *(f"G{word}" for at in "12" for word in (f"0 X{at}. Y1.", "0 Z1.", "1 Z-2.", "0 Z5.")), "G80"]


@pytest.mark.parametrize("call", ["M98 P5", "/M98 P2", "G65 P9010 A1.", "M198 P3", "M97 P3", "G0 X5./M98 P5"])
def test_a_call_that_is_not_followed_stays_and_nothing_is_known_behind_it(call):
    text = f"O1\n{HEAD}G98 G0 X0. Y0. Z5.\n{CYCLE}{call}\n{CYCLE}G17 G90 G98 G40 G0 X0. Y0. Z5.\n{CYCLE}M30\nO2\nM99\n"
    found = lines_of(text)
    assert found[3 : 4 + len(DRILLED)] == [*DRILLED, call]
    assert found[4 + len(DRILLED) : -2] == [
        *CYCLE.splitlines(),
        "G17 G90 G98 G40 G0 X0. Y0. Z5.",
        *DRILLED,
        "M30",
    ]
    notes = expand(text.encode(), "a.nc", language=FanucNumbers()).notes
    assert any("call stays as it is" in note for note in notes)
    assert any("cycle stays as it is" in note for note in notes)


def test_what_a_call_that_is_not_followed_may_use_stays_too():
    """A cycle in force is run at the places of the subprogram, and it reads what lines before it have set."""
    text = f"O1\n{HEAD}G98 G0 X0. Y0. Z5.\nG81 X1. Z-2. R1. F90.\nM98 P5\nG80\n"
    assert lines_of(f"{text}M30\n") == f"{text}M30".splitlines()
    for values in ("#1=1.\nM98 P5\n", "M98 P2\nM30\nO2\n#500=1.\nM98 P5\nM99\n", "G65 P2 A1.\nM30\nO2\nM98 P5\nM99\n"):
        with pytest.raises(ExpandError, match="not there"):
            written(f"O1\n{values}M30\n")


def test_the_motion_in_force_is_that_of_the_program_before_a_call():
    """The cycle was written as motions, of which the last one is a rapid."""
    text = f"O1\n{HEAD}G98 G0 Z5.\nG1 X0. Y0.\n{CYCLE}M98 P5\nM30\n"
    assert lines_of(text)[-3:] == ["G1", "M98 P5", "M30"]


@pytest.mark.parametrize("end", ["M99", "/M99\nM30"])
def test_a_subprogram_by_itself_is_written_out(end):
    text = f"O1\n{HEAD}G98 G0 X0. Y0. Z5.\n{CYCLE}{end}\n"
    assert lines_of(text)[3:] == [*DRILLED, *end.split("\n")]


def test_what_a_slash_within_a_block_leaves_out_is_not_known():
    text = f"O1\n{HEAD}G98 G0 X0. Y0. Z5.\nZ6./M8\n{CYCLE}G0 X0. Y0. Z5.\n{CYCLE}M30\n"
    assert lines_of(text)[3:] == ["Z6./M8", *CYCLE.splitlines(), "G0 X0. Y0. Z5.", *DRILLED, "M30"]


@pytest.mark.parametrize("call", ["M98 P5", "/M8", "G65 P9010"])
def test_corners_behind_a_call_wait_for_the_measure(call):
    corner = "G1 X10. ,R2.\nY10.\n"
    text = f"O1\n{HEAD}{call}\nG0 X0. Y0.\n{corner}G90 G17 G0 X0. Y0.\n{corner}M30\n"
    assert lines_of(text)[3:] == [
        *("G0 X0. Y0.", *corner.splitlines(), "G90 G17 G0 X0. Y0."),
        *("G1 X8. Y0.", "G3 X10. Y2. R2.", "G1 X10. Y10.", "M30"),
    ]
