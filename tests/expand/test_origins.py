"""Lines that written-out ones come of: some numbers of each program stand on one line alone, and tell it."""

import re

import pytest

from ph_post.expand.expand import Folders, expand
from ph_post.expand.macro import FanucNumbers

TAG = re.compile(r"\d+\.0\d")

PROGRAMS = {
    "linuxcnc": (
        "linuxcnc",
        "G21 G90 G17 F600\no1 sub\nG1 X1.01 Y[2*1]\nX1.02\no1 endsub\nG0 X1.03\no2 repeat [2]\no1 call\n"
        "o3 repeat [2]\nG1 X1.04\no3 endrepeat\no2 endrepeat\nG1 X1.05\nM2\n",
    ),
    "cycles": ("linuxcnc", "G21 G90 G17 G98 F60\nG0 X1.01 Y1 Z5\nG81 X1.02 Z-1 R1\nX1.03\nG80\nX1.04\nM2\n"),
    "cutter": (
        "linuxcnc",
        "G21 G90 G17\nG0 X-20 Y-20\nG41.1 D4\nG1 X0 Y0 F60.01\nX20 F60.02\nY20 F60.03\nX10 F60.04\n"
        "G3 X0 Y10 I0 J-10 F60.05\nG1 Y-9 F60.06\nG40\nG0 X-30 Y-30\nM2\n",
    ),
    "fanuc": (
        FanucNumbers(),
        "%\nO1\nG21 G90 G17\nG1 X1.01 F60.\nM98 P2 L3\nX1.02\nM30\nO2\n#1=1\nWHILE [#1LT3] DO1\nX1.03\nY#1\n"
        "#1=#1+1\nEND1\nX1.04\nM99\n%\n",
    ),
    "fanuc corners": (
        FanucNumbers(),
        "O1\nG21 G90 G17\nM98 P2 L2\nG1 X11. Y1. F60.01\nY5.,R1. F60.02\nX1. F60.03\nM30\nO2\nX1.04\nM99\n",
    ),
    "siemens": (
        "siemens",
        "G71 G90 G17 F600\nR1=0\nA1:\nG1 X1.01 Y=R1\nR1=R1+1\nIF R1<3 GOTOB A1\nX11 Y1 F60.02\nY5 RND=1\nX1.03\n"
        "M30\nX1.04\n",
    ),
    "heidenhain": (
        "heidenhain",
        "0 BEGIN PGM A MM\n1 TOOL CALL 1 Z S1000\n2 L X+1.01 Y+0 Z+5 R0 FMAX\n3 LBL 1\n4 L X+1.02 Y+10 F600\n"
        "5 CALL LBL 1 REP3\n6 CYCL DEF 251 RECTANGULAR ~\n Q215=1 ~\n Q218=61.03 ~\n Q219=62.04\n"
        "7 L X+11 Y+0 F60.05\n8 L Y+5 F60.06\n9 RND R1\n10 L X+1 F60.07\n11 M30\n12 END PGM A MM\n13 L X+1.08\n",
    ),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_numbers_stand_on_the_line_that_theirs_comes_of(name):
    language, text = PROGRAMS[name]
    found = expand(text.encode(), "a.ngc", language=language)
    own, made = text.splitlines(), found.data.decode().splitlines()
    assert len(found.origins) == len(made)
    tags, seen = set(TAG.findall(text)), set()
    for line, at in zip(made, found.origins, strict=True):
        there = tags & set(TAG.findall(line))
        assert there <= set(TAG.findall(own[at]))
        seen |= there
    assert seen == tags
    assert any(at != n for n, at in enumerate(found.origins[: len(own)]))


def test_lines_of_a_subprogram_in_another_file_come_of_the_line_that_calls_it():
    folders = Folders(known={"sub.ngc": b"o<sub> sub\nG1 X#1\nX7\no<sub> endsub\n"})
    found = expand(b"G21 G90 F60\no<sub> call [3]\nG1 X5\no<sub> call [4]\nM2\n", "a.ngc", folders)
    made = found.data.decode().splitlines()
    assert [found.origins[made.index(line)] for line in ("G21 G90 F60", "G1 X3", "G1 X5", "G1 X4", "M2")] == [
        0,
        1,
        2,
        3,
        4,
    ]
    assert [at for line, at in zip(made, found.origins, strict=True) if line == "X7"] == [1, 3]


def test_a_program_that_comes_to_nothing_has_lines_all_the_same():
    found = expand(b"o1 repeat [0]\nG1 X1 F60\no1 endrepeat\n", "a.ngc")
    assert len(found.origins) == found.data.count(b"\n") > 0


def test_a_corner_that_stays_is_named_with_the_line_of_the_program_itself():
    text = "G71 G90 G17 F600\nR1=0\nA1:\nG1 X=R1\nR1=R1+1\nIF R1<3 GOTOB A1\nG1 X9 Y1\nY5 RND=70\nX1\nM30\n"
    (note,) = expand(text.encode(), "a.mpf", language="siemens").notes
    assert note.startswith("a.mpf:8: RND=70 stays")
