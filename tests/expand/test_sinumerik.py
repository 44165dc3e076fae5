"""Siemens programs that are written out, beside the same ones in Python's own loops and choices."""

import math
import random
import re

import pytest
from support.sinumerik_player import SinumerikPlayer

from ph_post.api.expansion import before_expansion
from ph_post.expand.expand import ExpandError, expand


def lines_of(text):
    data = expand(text.encode(), "a.mpf", language="siemens").data
    return [line for line in data.decode().splitlines() if not line.startswith("; ph-post-expand")]


def test_lines_keep_their_characters_but_for_values_and_flow():
    text = """%_N_PART_MPF
;$PATH=/_N_WKS_DIR
N10 G71 G90 G17
N20 R1=5 R2=3 ; the part
ROW: G91 G1 X=R1 F=100*R2
Y=IC(R2/2) ; up
REPEAT ROW P=2
N50 FOR R3=1 TO 2
/X=R3*2+SIN(30)
ENDFOR
IF R1>4
X1
ELSE
X2
ENDIF
WHILE (R2>1) AND (R1==5)
Y=R2
R2=R2-1
ENDWHILE
REPEATB ROW
N90 R1=R1-1
IF R1>=4 GOTOB N90
GOTOF DONE
X99
DONE: Z=R1*2
MSG("R1=R2") CR=R1 CYCLE81(R1,2)
X=R9
M30
after R1
"""
    assert lines_of(text) == [
        *("%_N_PART_MPF", ";$PATH=/_N_WKS_DIR", "N10 G71 G90 G17", "N20 R1=5 R2=3 ; the part"),
        *("ROW: G91 G1 X=5 F=300", "Y=IC(1.5) ; up", *["G91 G1 X=5 F=300", "Y=IC(1.5) ; up"] * 2),
        *("R3=1", "/X=2.5", "R3=2", "/X=4.5", "R3=3", "X1", "Y=3", "R2=2", "Y=2", "R2=1", "G91 G1 X=5 F=100"),
        *("N90 R1=4", "R1=3", "DONE: Z=6", 'MSG("R1=R2") CR=3 CYCLE81(R1,2)', "X=R9", "M30", "after R1"),
    ]
    data = expand(text.encode(), "a.mpf", language="siemens").data
    assert data.startswith(b"%_N_PART_MPF\n;$PATH=/_N_WKS_DIR\n; ph-post-expand: ")
    assert before_expansion(data, "a.mpf") == text.encode()
    assert expand(data, "a.mpf", language="siemens").data == data


def test_a_program_that_computes_nothing_is_itself():
    for text in (b"G90 G1 X5 F100\nM30\n", b"ROW: X1 ; REPEAT\nM30\n", b"R1=5\nG1 X5 Y=2\nM30\n"):
        assert expand(text, "a.mpf", language="siemens").data == text


def test_what_needs_a_parameter_of_its_own_line_stays() -> None:
    """As the reader has it: nobody says here which of them a control works out first."""
    text = "R1=5 R2=3\nR1=7 G1 X=R1 Y=R2\nX=R1\nR1=4\nR1=R1+1 R3=R1 R4=R2\nX=R1 Y=R3 Z=R4\nM30\n"
    kept = ["R1=5 R2=3", "R1=7 G1 X=R1 Y=3", "X=R1", "R1=4", "R1=5 R3=R1 R4=3", "X=5 Y=R3 Z=3", "M30"]
    assert lines_of(text) == kept


@pytest.mark.parametrize(
    "line",
    ["R[5]=7", "X0 R[R2]=7", "R5=7 R[5]=8", "UP", "UP1 P2", "UP1(R5)", "L70", "MCALL L70\nX1\nMCALL", "$R5=7"],
)
def test_parameters_that_a_line_may_have_set_are_not_known(line) -> None:
    kept = lines_of(f"R5=1 R2=5\nX=R5\n{line}\nX=R5\nM30\n")
    assert kept == ["R5=1 R2=5", "X=1", *line.split("\n"), "X=R5", "M30"]


@pytest.mark.parametrize("line", ["Y=R[5]", "MCALL CYCLE81(1,2)\nX1\nMCALL", "CYCLE81(1,2)", "ROT Z5", "M8", "STOPRE"])
def test_parameters_that_a_line_does_not_set_stay_known(line) -> None:
    assert lines_of(f"R5=1\n{line}\nX=R5\nM30\n") == ["R5=1", *line.split("\n"), "X=1", "M30"]


@pytest.mark.parametrize(
    "line", ["IDS=1 WHENEVER R5==1 DO X=R5", "N7 WHEN TRUE DO $R5=2", "ID=1WHEN $A_IN[1]==1 DO M8", "DO Y=R5"]
)
def test_synchronized_actions_keep_every_character_and_may_set_parameters(line) -> None:
    assert lines_of(f"R5=1\nX=R5\n{line}\nX=R5\nM30\n") == ["R5=1", "X=1", line, "X=R5", "M30"]


def test_a_synchronized_action_that_runs_again_has_no_second_number() -> None:
    text = "AA:\nN7 WHEN TRUE DO X=R5\nX1\nENDLABEL:\nREPEAT AA P=1\nM30\n"
    assert lines_of(text) == ["AA:", "N7 WHEN TRUE DO X=R5", "X1", "ENDLABEL:", "WHEN TRUE DO X=R5", "X1", "M30"]


class Writer:
    """Writes a random program, and runs it at the same time in Python."""

    def __init__(self, seed):
        self.rng = random.Random(seed)
        self.text, self.ran, self.r = [], [], {1: 2.0, 2: 3.5}
        self.labels = 0

    def value(self):
        a, b = self.rng.choice([1, 2]), self.rng.randint(1, 9)
        return self.rng.choice(
            [
                (f"R{a}*{b}", lambda: self.r[a] * b),
                (f"({b}-R{a})/4+R1", lambda: (b - self.r[a]) / 4 + self.r[1]),
                (f"-R{a}+SQRT({b})*COS(60)", lambda: -self.r[a] + math.sqrt(b) * 0.5),
                (f"POT(R{a})-{b} MOD 4", lambda: self.r[a] ** 2 - b % 4),
            ]
        )

    def part(self, depth, runs):
        """Write a part; `runs` are the times that it runs, one function after the other."""
        steps = []
        for _ in range(self.rng.randint(1, 3)):
            kind = self.rng.random() if depth else 0.0
            if kind < 0.5:
                text, value = self.value()
                self.text.append(f"G1 X={text} Y=IC({text})")
                steps.append(lambda value=value: self.ran.append((value(), value())))
            elif kind < 0.6:
                key, step = self.rng.choice([1, 2]), self.rng.randint(-2, 2)
                self.text.append(f"R{key}=R{key}+{step}")
                steps.append(lambda key=key, step=step: self.r.update({key: self.r[key] + step}))
            elif kind < 0.75:
                begin, end = self.rng.randint(0, 2), self.rng.randint(0, 3)
                counter = 10 + depth
                self.text.append(f"FOR R{counter}={begin} TO {end}")
                inner = self.part(depth - 1, runs)
                self.text.append("ENDFOR")
                steps.append(lambda n=end - begin + 1, inner=inner: [inner() for _ in range(n)])
            elif kind < 0.9:
                limit = self.rng.randint(-3, 6)
                self.text.append(f"IF R1>{limit}")
                yes = self.part(depth - 1, runs)
                self.text.append("ELSE")
                no = self.part(depth - 1, runs)
                self.text.append("ENDIF")
                steps.append(lambda limit=limit, yes=yes, no=no: yes() if self.r[1] > limit else no())
            else:
                self.labels += 1
                times = self.rng.randint(1, 3)
                self.text.append(f"L_{self.labels}: X0 Y=IC(0)")
                inner = self.part(0, runs)
                self.text.append(f"REPEAT L_{self.labels} P={times}" if depth else "")
                steps.append(
                    lambda times=times, inner=inner: [(self.ran.append((0.0, 0.0)), inner()) for _ in range(times + 1)]
                )

        def run():
            for step in steps:
                step()

        return run


@pytest.mark.parametrize("seed", range(40))
def test_random_programs_run_as_python_runs_them(seed):
    writer = Writer(seed)
    run = writer.part(3, [])
    text = "\n".join(["G71 G90", "R1=2 R2=3.5", *writer.text, "M30", ""])
    run()
    found = [line for line in lines_of(text) if "Y=IC" in line]
    assert not any("R" in line for line in found)
    numbers = [re.findall(r"X=?(-?[\d.]+) Y=IC\((-?[\d.]+)\)", line)[0] for line in found]
    assert [tuple(map(float, pair)) for pair in numbers] == [pytest.approx(one, abs=1e-8) for one in writer.ran]


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        ("WHILE 1>0\nX1\nENDWHILE\n", 1, "never ends"),
        ("LOOP\nX1\nENDLOOP\n", 3, "never ends"),
        ("AA: X1\nGOTOB AA\n", 2, "never ends"),
        ("R1=0\nREPEAT\nX1\nUNTIL R1>5\n", 4, "never ends"),
        ("IF $P_EP[X]>1 GOTOF AA\nAA: X1\n", 1, "a condition depends on what only the machine knows"),
        ("IF R1>1 GOTOF AA\nAA: X1\n", 1, "R1"),
        ("GOTOF AA\nX1\n", 1, "is not there"),
        ('R1=1\nCALL "SUB"\nIF R1>0\nX1\nENDIF\n', 3, "R1"),
        ("R1=1\nDRILL_IT(5)\nIF R1>0\nX1\nENDIF\n", 3, "R1"),
        ("REPEAT AA P=2\n", 1, "is not there"),
        ("AA: X1\nREPEAT AA P=R5\n", 2, "P depends"),
        ("IF 1>0\nX1\n", 1, "IF without its end"),
        ("R1=1\nENDFOR\n", 2, "ENDFOR without its beginning"),
        ("FOR I=1 TO 3\nX1\nENDFOR\n", 1, "counts neither an R parameter nor a variable"),
        ("CASE R1 OF 1 GOTOF AA\nAA: X1\n", 1, "not followed: CASE R1 OF 1 GOTOF AA"),
        ("/GOTOF AA\nAA: X1\n", 1, "slash"),
        ("R1=1/0\nX=R1\n", 1, "division by zero"),
        ("AA: X1\nIF 1>0 GOTOF BB\nBB: X2\nREPEAT AA BB P=2\n", 2, "a jump in a part that is repeated"),
    ],
)
def test_what_cannot_be_written_out_is_named_with_its_line(text, line, what):
    with pytest.raises(ExpandError) as found:
        expand(f"{text}M30\n".encode(), "a.mpf", language="siemens")
    assert what in str(found.value.what)
    assert found.value.file == "a.mpf"
    assert found.value.line == line


def test_variables_that_the_program_defines_have_values_as_r_parameters_do() -> None:
    """840D sl, Programming Manual, Job Planning, 1.1: DEF, of 0 where no value is given; INT is rounded."""
    text = (
        "N10 DEF REAL HEIGHT=5.5, DEPTH=-2*1.5 ; two\nDEF INT COUNT, TURN_NR=2\nG0 Z=HEIGHT+R1\nG1 Z=DEPTH F=9*COUNT\n"
        "FOR COUNT=1 TO 2\nIF COUNT==2\nX=IC(20*COUNT)\nELSE\nX=HEIGHT\nENDIF\nENDFOR\nHEIGHT=HEIGHT+10 R5=COUNT\n"
        "WHILE TURN_NR>0\nX=TURN_NR*10\nTURN_NR=TURN_NR-1\nENDWHILE\nCOUNT=7/2\nX=COUNT\nCOUNT=-7/2\nX=COUNT\n"
        "L77\nZ=HEIGHT\nM30\n"
    )
    assert lines_of(text) == [
        *("N10 DEF REAL HEIGHT=5.5, DEPTH=-2*1.5 ; two", "DEF INT COUNT, TURN_NR=2", "G0 Z=HEIGHT+R1", "G1 Z=-3 F=0"),
        *("COUNT=1", "X=5.5", "COUNT=2", "X=IC(40)", "COUNT=3", "HEIGHT=15.5 R5=3", "X=20", "TURN_NR=1", "X=10"),
        *("TURN_NR=0", "COUNT=7/2", "X=4", "COUNT=-7/2", "X=COUNT", "L77", "Z=HEIGHT", "M30"),
    ]


@pytest.mark.parametrize("line", ["DEF REAL A[3]=5", "DEF STRING[9] NAME", "DEF BOOL A=TRUE", "DEF AXIS A"])
def test_other_variables_are_not_followed(line: str) -> None:
    assert "X=A" in lines_of(f"{line}\nDEF REAL B=1\nX=A\nX=B\nM30\n")


SHAPE = """G0 X0 Y0
G41 G1 X0 Y-4 Z=AC(-1) F300
G3 X4 Y-8 I4 J0
G1 X30 F900
Y10
G2 X20 Y20 CR=10
G91 G1 X-2.5
G3 X-3 Y-1 I=AC(17.5) J-1
G90 X=IC(-2) Y17 I-1 J-1
G40 G1 Y5
G0 Z5
"""
FRAMES = ("ROT RPL=30", "AROT RPL=-17.25", "AROT Z90", "MIRROR X0", "AMIRROR Y=0", "AMIRROR X0 Y0", "TRANS X3.5 Y-2")
FRAMES += ("ATRANS X1.25 Z0.5", "ROT", "TRANS", "MIRROR")


def framed(*parts):
    return (
        "G17 G90\nG0 X-5 Y-5 Z5\n" + "".join(part if part.endswith("\n") else f"{part}\n" for part in parts) + "M30\n"
    )


def assert_led_the_same(text):
    expected = SinumerikPlayer(re.sub(r"(ROT) Z", r"\1 RPL=", text)).events
    found = SinumerikPlayer(expand(text.encode(), "a.mpf", language="siemens").data.decode()).events
    assert len(found) == len(expected)
    for one, other in zip(found, expected, strict=True):
        assert one == pytest.approx(other, abs=2e-5), (one, other)


@pytest.mark.parametrize("frame", FRAMES[:6])
@pytest.mark.parametrize("before", ["", "TRANS X7 Y3 Z1"])
def test_turned_and_mirrored_coordinates_lead_as_the_player_has_them(frame, before):
    text = framed(before, frame, SHAPE, "ROT", SHAPE)
    assert_led_the_same(text)
    found = lines_of(text)
    assert not [line for line in found if re.match(r"A?(?:ROT|MIRROR) \S", line)]
    assert ("TRANS X7 Y3 Z1" in found) == bool(before)


@pytest.mark.parametrize("seed", range(60))
def test_random_frames_lead_as_the_player_has_them(seed):
    rng, parts = random.Random(seed), []
    for _ in range(rng.randint(2, 8)):
        parts += rng.choices(FRAMES, k=rng.randint(0, 2))
        parts += [
            "G0 X1 Y2",
            *rng.sample([SHAPE, "G91 G1 X-1 F200\nG90\n", "G1 X=IC(3)", "Y4", "G0 Z2"], rng.randint(1, 4)),
        ]
    text = framed(*parts)
    assert_led_the_same(text)
    assert not expand(text.encode(), "a.mpf", language="siemens").notes


def test_an_arc_by_its_centre_and_angle_keeps_both_and_has_no_end():
    found = lines_of(framed("ROT RPL=90", "G0 X5 Y5", "G2 I5 J0 AR=90 F100", "G1 X50 Y0", "ROT"))
    assert found[4:6] == ["G2 I0 J5 AR=90 F100", "G1 X0 Y50"]
    found = lines_of(framed("MIRROR X0", "G0 X5 Y5", "G2 I=AC(10) J0 AR=90 F100", "G1 X50 Y0", "MIRROR"))
    assert found[4:6] == ["G3 I-5 J0 AR=90 F100", "G1 X-50 Y0"]


def test_a_frame_behind_the_end_of_a_modal_call_is_written_out():
    for call, modes, out in (("CYCLE81(1)", "M8", True), ("L20", "M8", False), ("L20", "G17 G90", True)):
        text = framed(f"MCALL {call}", "G0 X5 Y5", "MCALL", modes, "ROT RPL=90", "G0 X5 Y0", "ROT")
        assert ("G0 X0 Y5" in lines_of(text)) == out


@pytest.mark.parametrize(
    ("parts", "why"),
    [
        (["ROT RPL=30", "G1 X5 F200"], "the first move is not straight to X and Y"),
        (["ROT RPL=30", "G0 X5 Y5", "ROT", "G1 X=IC(5) F200"], "the first move behind it"),
        (["ROT RPL=30", "G0 X5 Y5", "L10"], "not followed"),
        (["ROT RPL=30", "G0 X5 Y5", "CYCLE81(10,0,2,-5)"], "not followed"),
        (["ROT RPL=30", "G0 X5 Y5", "G110 X0 Y0"], "not followed"),
        (["ROT RPL=30", "G0 X5 Y5", "CYCLE800(0)"], "another frame"),
        (["ROT RPL=30", "G0 X5 Y5", "/G1 X7"], "not followed"),
        (["ROT RPL=30", "G0 X5 Y5", "G0 SUPA Z0"], "not followed"),
        (["ROT X30", "G0 X5 Y5"], "does not turn in the plane"),
        (["MIRROR Z0", "G0 X5 Y5"], "not in the plane"),
        (["SCALE X2 Y2", "AROT RPL=30", "G0 X5 Y5"], "scaled"),
        (["ROT RPL=30", "G0 X5 Y5", "ASCALE X2", "G0 X1 Y1"], "on top of it"),
        (["ROT RPL=30", "G41 G0 X5 Y5", "ROT", "G40 G0 X5 Y5"], "begins beside the contour"),
        (["ROT RPL=R7", "G0 X5 Y5"], "not known"),
        (["DIAMON", "ROT RPL=30", "G0 X5 Y5"], "diameters"),
        (["G18", "ROT RPL=30", "G0 X5 Y5"], "no G17"),
        (["G91", "/G90", "ROT RPL=30", "G0 X5 Y5"], "no G90 or G91"),
        (["/G18", "ROT RPL=30", "G0 X5 Y5"], "no G17"),
        (["G41 G1 X0 Y0 F100", "/G40", "ROT RPL=30", "G0 X5 Y5"], "beside the contour"),
        (["SIDE_2", "G17", "ROT RPL=30", "G0 X5 Y5"], "no G90 or G91"),
        (["ROT RPL=30", "G0 X5 Y5", "R1=5 L20"], "not followed"),
        (["MCALL L20", "G0 X5 Y5", "AROT RPL=30", "G0 X1 Y2", "AROT RPL=30", "G0 X1 Y2", "ROT"], "MCALL"),
        (["MCALL CYCLE81(10,0,2,-5)", "/MCALL", "ROT RPL=30", "G0 X5 Y5"], "MCALL"),
        (["ROT RPL=30", "G0 X5 Y5", "MCALL L20", "G0 X1 Y2", "MCALL", "ROT"], "not followed"),
        (["ROT RPL=30", "G0 X5 Y5", "G2 I5 J0 AR=90 F100", "G1 X50"], "first move"),
        (["MIRROR X0", "G0 X5 Y5", "G2 X9 I5 J0 AR=90 F100", "G1 X50 Y0"], "has an end, too"),
    ],
)
def test_frames_that_stay_are_named(parts, why):
    text = framed(*parts)
    found = expand(text.encode(), "a.mpf", language="siemens")
    assert [note for note in found.notes if why in note and " stays as it is: " in note]
    assert found.data.decode() == text


def test_a_line_that_may_be_skipped_and_runs_again_keeps_its_level():
    found = lines_of("G90\nA1:\nN5 X1\n/2 N6 Z-3\n/ Z-4\nA2:\nREPEAT A1 A2 P=1\nM30\n")
    assert found == ["G90", "A1:", "N5 X1", "/2 N6 Z-3", "/ Z-4", "A2:", "X1", "/2 Z-3", "/Z-4", "M30"]


def test_a_line_with_a_slash_ends_no_modal_call():
    """The subprogram may set R1 behind each block."""
    for end, value in (("MCALL", "X=3"), ("/MCALL", "X=R1")):
        assert f"G1 {value}" in lines_of(f"G90\nMCALL L20\n{end}\nR1=3\nG1 X5\nG1 X=R1\nR2=R1\nM30\n")
