"""Conversational programs that are written out, beside a player of the tests' own that runs the originals."""

import random
import re

import pytest
from support.tnc_player import TncPlayer

from ph_post.api.expansion import before_expansion
from ph_post.dialects.reading import read_as
from ph_post.expand.expand import ExpandError, expand

CALCULATED = """0 BEGIN PGM PLATE MM
1 TOOL CALL 5 Z S1000 F300
2 FN 0: Q1 =+5
3 FN 1: Q2 =+Q1 + -1.5 ; up
4 FN 2: Q3 =-Q1 - +Q2
5 FN 3: Q4 =+Q3 * -2
6 FN 4: Q5 =+Q4 DIV +3
7 FN 5: Q6 =SQRT +Q4
8 FN 6: Q7 =SIN +Q4
9 FN 7: Q8 =COS -Q4
10 FN 8: Q9 =+Q1 LEN +12
11 FN 13: Q10 =-Q1 ANG -5
12 Q11 = ( Q1 + 3 ) * SQRT ( Q4 ^ 2 ) - SIN 30 * Q1
13 Q12 = SQ Q1 + NEG Q2 + INT 2.75 - FRAC -2.75 + ABS Q3 + ATAN 1 + EXP 1 + LN 2 + PI
14 L X+Q1 Y-Q2 Z+Q5 R0 FMAX M3
15 L IX+Q6 IY-Q7 FQ9 ; ( Q1 )
16 CC X+Q8 Y+Q10
17 Q13 = 2 * Q8 - Q1 - Q6
18 Q14 = 2 * Q10 + Q2 + Q7
19 C X+Q13 Y+Q14 DR-
20 CR IX+10 IY+Q1 R+Q9 DR+ F400
21 L X+Q11 Y+Q12
22 TOOL CALL Q1 Z SQ9
23 L Z+Q9 FMAX M30
24 END PGM PLATE MM
"""

FLOW = """0 BEGIN PGM FLOW MM
1 L X+0 Y+0 Z+5 R0 FMAX M3
2 FN 0: Q1 =+0
3 LBL 10
4 Q1 = Q1 + 1
5 L X+Q1 F500
6 CALL LBL "SIDE"
7 LBL 11
8 L IY+0.3333
9 CALL LBL 11 REP 2/2
10 CALL LBL 10 REP 3
11 LBL 12
12 Q1 = Q1 - 1
13 L X+Q1
14 FN 11: IF +Q1 GT +1 GOTO LBL 12
15 FN 9: IF +Q1 EQU +1 GOTO LBL 13
16 L X+99
17 LBL 13
18 FN 10: IF +Q1 NE +1 GOTO LBL 12
19 FN 12: IF +Q1 LT +1 GOTO LBL 12
20 L Z+50 FMAX M30
21 LBL "SIDE"
22 L IZ-0.1
23 CALL LBL 20
24 LBL 0
25 LBL 20
26 L IZ+0.1
27 LBL 0
28 END PGM FLOW MM
"""

HEAD = "0 BEGIN PGM HOLES MM\n1 TOOL CALL 5 Z S1000 F300\n2 L X+0 Y+0 Z+30 R0 FMAX M3\n"
DRILL = {
    "drilled": "200 A ~\n Q200=2 ;UP ~\n Q201=-5 ;DOWN ~\n Q206=150 ~\n Q202=5 ~\n Q210=0 ~\n Q203=+1 ~\n Q204=50 ~\n"
    " Q211=0.2",
    "pecked": "200 A ~\n Q200=2 ~\n Q201=-17.5 ~\n Q206=150 ~\n Q202=5 ~\n Q210=.5 ~\n Q203=-3 ~\n Q204=1 ~\n Q211=0",
    "reamed": "201 A ~\n Q200=2 ~\n Q201=-15 ~\n Q206=120 ~\n Q211=.25 ~\n Q208=250 ~\n Q203=+0 ~\n Q204=20",
    "reamed slowly": "201 A ~\n Q200=2 ~\n Q201=-15 ~\n Q206=120 ~\n Q211=0 ~\n Q208=0 ~\n Q203=+0 ~\n Q204=0",
    "less each time": "203 A ~\n Q200=2 ~\n Q201=-20 ~\n Q206=150 ~\n Q202=8 ~\n Q210=0 ~\n Q203=+0 ~\n Q204=30 ~\n"
    " Q212=3 ~\n Q213=0 ~\n Q205=2.5 ~\n Q211=.25 ~\n Q208=500 ~\n Q256=.2",
    "as fast as it can": "203 A ~\n Q200=2 ~\n Q201=-20 ~\n Q206=150 ~\n Q202=20 ~\n Q203=+0 ~\n Q213=3 ~\n Q208=MAX",
    "deep": "205 A ~\n Q200=2 ~\n Q201=-40 ~\n Q206=150 ~\n Q202=15 ~\n Q203=+0 ~\n Q204=30 ~\n Q212=.5 ~\n Q205=3 ~\n"
    " Q258=.5 ~\n Q259=.5 ~\n Q257=0 ~\n Q256=.2 ~\n Q211=.25 ~\n Q379=0 ~\n Q253=750 ~\n Q208=9999 ~\n Q395=0",
    "centred": "240 A ~\n Q200=2 ~\n Q343=0 ~\n Q201=-2 ~\n Q344=0 ~\n Q206=150 ~\n Q211=.1 ~\n Q203=+20 ~\n Q204=50",
    "old": "1.0 PECKING\n4 CYCL DEF 1.1 SET UP 2\n5 CYCL DEF 1.2 DEPTH -40\n6 CYCL DEF 1.3 PECKG 15\n"
    "7 CYCL DEF 1.4 DWELL 0.5\n8 CYCL DEF 1.5 F80",
}
CALLS = (
    "20 L X+10 Y+10 R0 FMAX M99 ; first\n21 L IX+5 M99\n22 L X+30 R0 FMAX\n23 CYCL CALL\n24 CYCL CALL M8\n25 L Y+7\n"
    "26 L Z+100 R0 FMAX M30\n27 END PGM HOLES MM\n"
)


def written(text: str) -> str:
    return expand(text.encode(), "a.h", language="heidenhain").data.decode()


def lines_of(text: str) -> list[str]:
    return [line for line in written(text).splitlines() if not line.startswith("; ph-post-expand")]


def assert_same(original: str, within: float = 1.01e-4) -> None:
    expected, found = TncPlayer(original).events, TncPlayer(written(original)).events
    assert [one[0] for one in found] == [one[0] for one in expected]
    for one, other in zip(found, expected, strict=True):
        for a, b in zip(one[1:], other[1:], strict=True):
            assert a == (pytest.approx(b, abs=within) if isinstance(b, float | dict) else b), (one, other)


@pytest.mark.parametrize("text", [CALCULATED, FLOW])
def test_a_program_that_computes_moves_as_the_player_has_it(text: str) -> None:
    assert_same(text)
    data = written(text).encode()
    end = data[: data.index(b"M30")].count(b"\n")
    assert all(note.first > end for note in read_as("heidenhain", data, "a.h").notes)
    assert not re.search(rb"CALL LBL|GOTO|[XYZRFS+-]Q\d", data.split(b"M30")[0])
    assert before_expansion(data, "a.h") == text.encode()
    assert expand(data, "a.h", language="heidenhain").data == data


def test_lines_keep_their_characters_but_for_values_and_flow() -> None:
    found = lines_of(FLOW)
    assert found[:8] == [
        *("0 BEGIN PGM FLOW MM", "1 L X+0 Y+0 Z+5 R0 FMAX M3", "2 FN 0: Q1 =+0", "4 FN 0: Q1 = +1", "5 L X+1 F500"),
        *("22 L IZ-0.1", "26 L IZ+0.1", "8 L IY+0.3333"),
    ]
    assert found[8:13] == ["L IY+0.3333"] * 2 + ["FN 0: Q1 = +2", "L X+2 F500", "L IZ-0.1"]
    assert found[-9:] == ["20 L Z+50 FMAX M30", *FLOW.splitlines()[21:]]
    assert lines_of(CALCULATED)[14:17] == ["14 L X+5 Y-3.5 Z+5.6667 R0 FMAX M3", *lines_of(CALCULATED)[15:17]]
    assert lines_of(CALCULATED)[15] == "15 L IX+4.1231 IY-0.2924 F13 ; ( Q1 )"


def test_rep_without_a_number_calls_a_subprogram() -> None:
    text = FLOW.replace("CALL LBL 20", "CALL LBL 20 REP")
    assert text != FLOW
    assert lines_of(text)[:21] == lines_of(FLOW)[:21]


def test_points_that_are_no_number_are_carried() -> None:
    """Old cycles in Spanish are named in abbreviations: CYCL DEF 1.0 TALADRADO PROF."""
    parts = ("0 {}", "1 DIST. +2", "2 PROF. -6", "3 APROX. +2", "4 T.ESPR 0", "5 F200")
    old = "\n".join(f"CYCL DEF 1.{part}" for part in parts)
    named, plain = (lines_of(f"{HEAD}{old.format(name)}\n{CALLS}") for name in ("TALADRADO PROF.", "PECKING"))
    assert [line.replace("TALADRADO PROF.", "PECKING") for line in named] == plain
    assert not any("CYCL CALL" in line for line in named)
    broken = lines_of(f"{HEAD}CYCL DEF 200 DRILLING Q200=2.. Q201=-6 Q206=150 Q202=2 Q203=+0\n{CALLS}")
    assert any("CYCL CALL" in line for line in broken)


@pytest.mark.parametrize("name", DRILL)
def test_cycles_move_as_the_player_has_them(name: str) -> None:
    text = f"{HEAD}3 CYCL DEF {DRILL[name]}\n{CALLS}"
    found = expand(text.encode(), "a.h", language="heidenhain")
    assert found.notes == ()
    assert_same(text)
    assert not re.search(rb"M99|CYCL CALL", found.data)
    assert read_as("heidenhain", found.data, "a.h").notes == ()
    assert len(TncPlayer(text).events) > 12


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (("200 A", "202 A"), "not one of those"),
        (("Q201=-17.5", "Q201=+17.5"), "not below the surface"),
        (("Q202=5", "Q202=0"), "do not come to its depth"),
        (("Q211=0", "Q211=.5"), "controls differ"),
        (("Q211=0", "Q211=0 ~\n Q395=1"), "Q395"),
        (("Q206=150", "Q206=AUTO"), "Q206 is not known"),
        (("Q203=-3", "Q203=+Q7"), "Q203 is not known"),
        (("20 L", "9 Q201 = -8\n20 L"), "set behind the definition"),
        (("20 L", "9 CYCL DEF 300 OWN\n20 L"), "no cycle is known"),
        (("R0 FMAX M99", "RL F100 M99"), "radius compensation"),
        (("FMAX M99", "FQ8 M99"), "feed"),
        (("FMAX M99", "FMAX M99 M5"), "at the end of the block"),
        (("FMAX M99", "FMAX M89"), "M89"),
        ((" MM\n", " INCH\n"), "inches"),
        (("3 CYCL DEF", "3 L F0.1 M136\n4 CYCL DEF"), "for a turn of the spindle"),
    ],
)
def test_calls_that_stay_are_named(change: tuple[str, str], why: str) -> None:
    text = f"{HEAD}3 CYCL DEF {DRILL['pecked']}\n{CALLS}".replace(*change)
    found = expand(text.encode(), "a.h", language="heidenhain")
    assert why in " ".join(found.notes)
    assert re.search(rb"M99|M89", found.data)
    again = read_as("heidenhain", found.data, "a.h")
    assert any("call of a cycle" in note.what for note in again.notes)


@pytest.mark.parametrize(
    "blocks",
    [
        "L X+0 Y+50 F700\nRND R5 F90\nL Y+10",
        "L X+0 F700 M103 F20",
        "L X+0 F700\nM128 F1000",
        "L X+0 F700\nCHF 2 F90\nL Y+9",
    ],
)
def test_behind_a_cycle_stands_the_feed_that_is_in_force(blocks: str) -> None:
    """F of a corner is its own, that of M103 a share, and that of M128 for following rotary axes."""
    text = f"{HEAD}3 CYCL DEF {DRILL['pecked']}\n{blocks}\nL Z+9 FMAX\nL X+9 Y+9 FMAX M99\nL X+0\nEND PGM A MM\n"
    lines = expand(text.encode(), "a.h", language="heidenhain").data.decode().splitlines()
    assert lines[lines.index("L X+0") - 1] == "L F700"


class Writer:
    """Writes a random program that ends."""

    def __init__(self, seed: int) -> None:
        self.rng, self.text, self.subs, self.labels = random.Random(seed), [], [], 0

    def part(self, depth: int) -> None:
        for _ in range(self.rng.randint(1, 3)):
            kind = self.rng.random() if depth else 0.0
            q, p, n = self.rng.randint(1, 3), self.rng.randint(1, 3), self.rng.randint(1, 9)
            if kind < 0.35:
                self.text.append(self.rng.choice([f"L X+Q{q} IY-Q{p} F{n}00", f"L IZ-Q{q}", f"L X-Q{q} Y+{n} FMAX"]))
            elif kind < 0.55:
                formula = self.rng.choice([f"Q{p} * 0.5 + {n}", f"{n} - Q{q} / 4", f"SQRT {n} * COS ( Q{p} * 10 )"])
                self.text.append(f"Q{q} = {formula}")
            elif kind < 0.7:
                self.labels += 1
                label = self.labels
                self.text.append(f"LBL {label}")
                self.part(depth - 1)
                self.text.append(f"CALL LBL {label} REP {self.rng.randint(1, 2)}")
            elif kind < 0.85:
                self.labels += 1
                label, sign = self.labels, self.rng.choice(["EQU", "NE", "GT", "LT"])
                self.text.append(f"FN 9: IF +Q{q} {sign} +{n} GOTO LBL {label}")
                self.part(depth - 1)
                self.text.append(f"LBL {label}")
            else:
                self.labels += 1
                label, main = self.labels, self.text
                self.text = [f"LBL {label}"]
                self.part(depth - 1)
                self.subs += [*self.text, "LBL 0"]
                self.text = [*main, f"CALL LBL {label}"]


@pytest.mark.parametrize("seed", range(40))
def test_random_programs_move_as_the_player_has_them(seed: int) -> None:
    writer = Writer(seed)
    writer.part(3)
    begin = ["BEGIN PGM A MM", "Q1 = 2", "Q2 = 3.5", "Q3 = -1", "L X+0 Y+0 Z+0 R0 F100 M3"]
    blocks = [*begin, *writer.text, "L Z+50 FMAX M30", *writer.subs, "END PGM A MM"]
    assert_same("".join(f"{number} {block}\n" for number, block in enumerate(blocks)))


@pytest.mark.parametrize(
    ("blocks", "line", "what"),
    [
        ("LBL 1|L X+1|FN 9: IF +1 EQU +1 GOTO LBL 1", 4, "never ends"),
        ("LBL 1|CALL LBL 1|LBL 0", 3, "more than 19 deep"),
        ("CALL LBL 7", 2, "the label is not there"),
        ("Q10005 = 1|CALL LBL 1|LBL 1|LBL 0", 2, "no such parameter"),
        ("FN 9: IF +1 EQU +1 GOTO LBL 7", 2, "the label is not there"),
        ("L X+1|Q1 = 5 / ( 3 - 3 )", 3, "division by zero"),
        ("FN 4: Q1 =+5 DIV +0", 2, "division by zero"),
        ("Q2 = SQRT -4", 2, "sqrt"),
        ("Q2 = -2 ^ 0.5", 2, "a power that is not whole"),
        ("Q2 = 0 ^ 0", 2, "0 to the power of 0"),
        ("Q2 = SQ 1" + 200 * "0", 2, "beyond all bounds"),
        ("FN 9: IF +Q5 EQU +1 GOTO LBL 1|LBL 1", 2, "Q5"),
        ("FN 18: SYSREAD Q5 = ID270 NR1|FN 9: IF +Q5 LT +1 GOTO LBL 1|LBL 1", 3, "Q5"),
        ("Q108 = 3|FN 9: IF +Q108 LT +1 GOTO LBL 1|LBL 1", 3, "Q108"),
        ("Q5 = 3|CALL PGM B|FN 9: IF +Q5 LT +1 GOTO LBL 1|LBL 1", 4, "Q5"),
        ("Q5 = 3|/Q5 = 4|FN 9: IF +Q5 LT +1 GOTO LBL 1|LBL 1", 4, "Q5"),
        ("/CALL LBL 1|LBL 1", 2, "slash"),
        ("CALL LBL 1 REP 2|LBL 1", 2, "a repeat of a part that is not whole"),
        ("CALL LBL Q1", 2, "a label that is computed"),
        ("FN 9: IF Q1 IS UNDEFINED GOTO LBL 1|LBL 1", 2, "not followed"),
        ("Q1 = 0.1 + 0.2|FN 9: IF +Q1 EQU +0.3 GOTO LBL 1|LBL 1", 3, "but for rounding"),
        ("CALL LBL 1|M30|LBL 1|L X+1", 6, "within a subprogram"),
    ],
)
def test_what_cannot_be_written_out_is_named_with_its_line(blocks: str, line: int, what: str) -> None:
    lines = ["BEGIN PGM A MM", *blocks.split("|"), "END PGM A MM"]
    text = "".join(f"{number} {block}\n" for number, block in enumerate(lines))
    with pytest.raises(ExpandError) as found:
        expand(text.encode(), "a.h", language="heidenhain")
    assert what in str(found.value.what) + found.value.got
    assert found.value.line == line


@pytest.mark.parametrize(
    "block", ["L X+Q5", "L X+Q150 Y+1", "Q1 = Q5 + 1", "Q1 = -2 ^ Q5", "Q1 = SGN 0", "Q1 = -5 % 3", "CYCL DEF 7.1 X+Q5"]
)
def test_what_is_not_known_stays(block: str) -> None:
    text = f"0 BEGIN PGM A MM\n1 {block}\n2 END PGM A MM\n"
    assert written(text) == text


SHAPE = """LBL 1
L X+0 Y+0 R0 FMAX
L Z-1 F200
L X+30 RR F900
L IY+10
CC X+30 Y+15
C X+25 Y+15 DR+
CR X+5 Y+14 R+20 DR-
CC IX+0 Y+4
CP IPA+120 IZ-0.5 DR+
L X+2.5 Y-1.25
L Z+5 R0 FMAX
LBL 0
"""


ROUNDED = 3e-4
"""An arc by an angle ends where its centre and its beginning lead, both of which are rounded to 0.0001 mm."""


def framed(*blocks: str) -> str:
    lines = ["BEGIN PGM A MM", "TOOL CALL 5 Z S1000", "L X-5 Y-5 Z+5 R0 FMAX M3", *blocks, "L X+0 Y+0 R0 FMAX"]
    lines += ["L Z+50 FMAX M30", *SHAPE.splitlines(), "END PGM A MM"]
    return "".join(f"{number} {block}\n" for number, block in enumerate(lines))


def turned(angle: str) -> list[str]:
    return ["CYCL DEF 10.0 ROTATION", f"CYCL DEF 10.1 {angle}"]


def mirrored(axes: str) -> list[str]:
    return ["CYCL DEF 8.0 MIRROR IMAGE", f"CYCL DEF 8.1 {axes}".rstrip()]


def frames_of(text: str) -> list[str]:
    return [found[0] for line in lines_of(text) if (found := re.search(r"CYCL DEF (?:8|10)\.1.*", line))]


@pytest.mark.parametrize(
    "frame", [turned("ROT+35"), turned("ROT-90"), turned("IROT+400"), mirrored("X"), mirrored("Y"), mirrored("X Y")]
)
def test_turned_and_mirrored_coordinates_lead_as_the_player_has_them(frame: list[str]) -> None:
    ends = turned("ROT+0") if "ROT" in frame[1] else mirrored("")
    text = framed(*frame, "CALL LBL 1", *ends, "CALL LBL 1")
    assert_same(text, ROUNDED)
    assert frames_of(text) == [ends[1].replace("8.1 ", "8.1")] * 2
    data = written(text).encode()
    end = data[: data.index(b"M30")].count(b"\n")
    notes = [note.what for note in read_as("heidenhain", data, "a.h").notes if note.first < end]
    assert all("cutter compensation" in what for what in notes)
    assert len(notes) == 2
    assert before_expansion(data, "a.h") == text.encode()


def test_a_part_is_turned_on_from_call_to_call() -> None:
    text = framed("LBL 2", "CALL LBL 1", *turned("IROT+72"), "CALL LBL 2 REP 4", *turned("ROT+0"), "CALL LBL 1")
    assert_same(text, ROUNDED)
    assert set(frames_of(text)) == {"CYCL DEF 10.1 ROT+0"}
    assert len(TncPlayer(text).events) > 55


@pytest.mark.parametrize("seed", range(40))
def test_random_frames_lead_as_the_player_has_them(seed: int) -> None:
    """Frames that cannot be written out stand among the others; the player knows what they do all the same."""
    rng, blocks = random.Random(seed), list[str]()
    for _ in range(rng.randint(2, 6)):
        kind, angle = rng.random(), rng.choice(["+30", "-17.25", "+180", "+0"])
        blocks += (
            turned(rng.choice(["ROT", "ROT", "IROT"]) + angle) if kind < 0.6 else mirrored(rng.choice(["X", "", "Y"]))
        )
        moves = [
            "CALL LBL 1",
            f"L X+{rng.randint(1, 9)} Y-3 F500",
            "L IX+2.5 IY-1",
            "L IX-4",
            "CYCL DEF 9.0 DWELL TIME",
        ]
        blocks += [f"L X+{rng.randint(0, 5)} Y+1 R0 FMAX", *rng.sample(moves, rng.randint(1, 4))]
    assert_same(framed(*blocks, *turned("ROT+0"), *mirrored("")), ROUNDED)


@pytest.mark.parametrize(
    ("blocks", "why"),
    [
        ([*turned("ROT+30"), "L X+5 F500", *turned("ROT+0")], "the first move does not name X and Y"),
        ([*turned("ROT+30"), "L X+5 Y+5 F500", *turned("ROT+0"), "L IX+5"], "the first move behind it"),
        ([*turned("ROT+30"), "L X+5 Y+5 F500", "CYCL DEF 7.0", "CYCL DEF 7.1 X+5", *turned("ROT+0")], "not followed"),
        ([*turned("ROT+30"), "L X+5 Y+5 F500", "CYCL CALL", *turned("ROT+0")], "not followed"),
        ([*turned("ROT+30"), *mirrored("X"), "CALL LBL 1", *turned("ROT+0"), *mirrored("")], "a rotation and a mirror"),
        (["CC X+1 Y+1", *turned("ROT+30"), "L X+5 Y+5", "C X-3 Y-3 DR+", *turned("ROT+0")], "a centre from before"),
        ([*turned("ROT+30"), "L X+5 Y+5", "CC X+0 Y+0", *turned("ROT+0"), "L X+5 Y+5", "C X-5 Y-5 DR+"], "behind it"),
        (["L X+5 Y+5 RL F500", *mirrored("X"), "CALL LBL 1", *mirrored("")], "it begins beside the contour"),
        ([*mirrored("X Z"), "CALL LBL 1", *mirrored("")], "not in the plane of X and Y"),
        ([*turned("ROT+Q5"), "CALL LBL 1", *turned("ROT+0")], "not known"),
        ([*turned("ROT+30"), "L X+5 Y+5", "/ L X+7", *turned("ROT+0")], "switch says"),
        ([*turned("ROT+30"), "L X+5 Y+5", "L X+7 M97", *turned("ROT+0")], "not followed"),
    ],
)
def test_frames_that_stay_are_named(blocks: list[str], why: str) -> None:
    text = framed(*blocks)
    found = expand(text.encode(), "a.h", language="heidenhain")
    assert [note for note in found.notes if why in note and " stays as it is: " in note]
    assert frames_of(text) == [block for block in blocks if re.search(r"CYCL DEF (?:8|10)\.1", block)]


def test_a_frame_behind_one_that_stays_is_written_out() -> None:
    blocks = ["L X+5 Y+5", "L X+7 M97"]
    text = framed(*turned("ROT+30"), "CALL LBL 1", *turned("IROT+10"), *blocks, *turned("IROT+5"), "CALL LBL 1")
    assert frames_of(text) == [f"CYCL DEF 10.1 ROT+{angle}" for angle in (0, 40, 0)]
