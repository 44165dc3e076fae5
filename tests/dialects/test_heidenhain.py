"""Heidenhain programs read, conversational and ISO: the same part in both, and what is named."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.in_place import ISO

from ph_post.dialects.heidenhain.iso import why_iso_stays
from ph_post.dialects.reading import read_as
from ph_post.edit.preconditions import why_not_editable
from ph_post.errors import InputError
from ph_post.gcode.program import ARC
from ph_post.units import MM, MM_PER_MIN

DIALECTS = ("heidenhain", "heidenhain-iso")


def klartext(*blocks: str, units: str = "MM"):
    """Read blocks between a beginning and an end."""
    lines = [f"BEGIN PGM A {units}", *blocks, f"END PGM A {units}"]
    text = "".join(f"{number} {line}\n" for number, line in enumerate(lines))
    return read_as("heidenhain", text.encode(), "a.h")


def iso(*blocks: str, units: str = "G71"):
    lines = [f"{'/' * line.startswith('/')}N{10 * n} {line.lstrip('/')} *" for n, line in enumerate(blocks, 1)]
    text = "\n".join([f"%A {units} *", *lines, f"N99999999 %A {units} *", ""])
    return read_as("heidenhain-iso", text.encode(), "a.i")


def read(dialect: str, both: dict[str, tuple[str, ...]]):
    return klartext(*both[dialect]) if dialect == "heidenhain" else iso(*both[dialect])


PART = {
    "heidenhain": (
        "BLK FORM 0.1 Z X+0 Y+0 Z-20",
        "BLK FORM 0.2 X+100 Y+100 Z+0",
        "TOOL CALL 5 Z S4000",
        "L  Z+100 R0 FMAX M3",
        "L X-20 Y+50 R0 F MAX M8 ; go there",
        "L Z-5 F200",
        "L X+0 F500",
        "CC X+50 Y+50",
        "C X+100 DR-",
        "C X+0 Y+50 DR-",
        "CR X+50 Y+100 R+50 DR+",
        "CR X+0 Y+50 R-50 DR-",
        "L IX+10 IY-5,5",
        "CC IX+5 IY+0",
        "C IX+10 IY+0 DR+ F300",
        "CC",
        "L IX+3",
        "C X+23 Y+44.5 DR+",
        "CYCL DEF 9.0 V.ZEIT",
        "CYCL DEF 9.1 V.ZEIT 1.5",
        "CYCL DEF 32.0 TOLERANCE",
        "CYCL DEF 32.1 T0.02",
        "* - structure",
        "L Z+100 R0 FMAX M30",
    ),
    "heidenhain-iso": (
        "G30 G17 X+0 Y+0 Z-20",
        "G31 G90 X+100 Y+100 Z+0",
        "T5 G17 S4000",
        "G00 G40 G90 Z+100 M3",
        "X-20 Y+50 M8",
        "G01 Z-5 F200",
        "X+0 F500",
        "I+50 J+50",
        "G02 X+100",
        "X+0 Y+50",
        "G03 X+50 Y+100 R+50",
        "G02 X+0 Y+50 R-50",
        "G01 G91 X+10 Y-5.5",
        "I+5 J+0",
        "G03 X+10 G90 Y+44.5 F300",
        "G29",
        "G01 G91 X+3",
        "G03 X+0 Y+0",
        "G04 F1.5",
        "G62 T0.02",
        "G90",
        "G00 Z+100 M30",
    ),
}
ENDS = [
    (-20, 50, 100),
    (-20, 50, -5),
    (0, 50, -5),
    (100, 50, -5),
    (0, 50, -5),
    (50, 100, -5),
    (0, 50, -5),
    (10, 44.5, -5),
    (20, 44.5, -5),
    (23, 44.5, -5),
    (23, 44.5, -5),
    (23, 44.5, 100),
]
ARCS = {
    3: ((50, 50), -180),
    4: ((50, 50), -180),
    5: ((0, 100), 90),
    6: ((50, 50), -270),
    8: ((15, 44.5), 180),
    10: ((20, 44.5), 360),
}
FEEDS = [0, 200, 500, 500, 500, 500, 500, 500, 300, 300, 300, 0]


@pytest.mark.parametrize("dialect", DIALECTS)
def test_the_same_part_in_both_languages(dialect: str) -> None:
    program = read(dialect, PART)
    motions = program.motions
    assert program.notes == ()
    assert np.allclose(motions.end[1:] / MM, ENDS, rtol=0.0, atol=1e-9)
    assert np.array_equal(motions.start[2:], motions.end[1:-1])
    assert np.allclose(motions.feed[1:] / MM_PER_MIN, FEEDS, rtol=1e-12)
    arcs = {row - 1: row for row in np.flatnonzero(motions.kind == ARC).tolist()}
    assert arcs.keys() == ARCS.keys()
    for number, (center, degrees) in ARCS.items():
        row = arcs[number]
        assert np.allclose(motions.center[row] / MM, center, rtol=0.0, atol=1e-9)
        assert abs(math.degrees(motions.angle[row]) - degrees) <= 1e-9
    assert [one.kind for one in program.breaks] == ["beginning", "tool change", "end"]
    assert program.modal_after(program.blocks - 2).spindle == "M3"


NAMED = {
    "heidenhain": [
        ("L X+9 RL F200", "cutter compensation: 1 L X+9 RL F200"),
        ("CT X+5 Y+5", "path function: CT X+5 Y+5"),
        ("LP PR+20 PA+45", "path function: LP PR+20 PA+45"),
        ("FC DR+ R15", "path function: FC DR+ R15"),
        ("APPR LT X+5 Y+5 LEN5 R0", "path function: APPR LT X+5 Y+5 LEN5 R0"),
        ("L X+Q1", "place that is computed: X"),
        ("L X+9 FQ10", "feed by the tool, or computed: FQ10"),
        ("L X+9 FU0.1", "feed by the tool, or computed: FU0.1"),
        ("L X+9 M99", "call of a cycle: M99"),
        ("L X+9 M81", "unknown M function: M81"),
        ("L X+9 M128", "rotary axes about the tool's tip: M128"),
        ("CYCL DEF 220 PATTERN", "cycle: CYCL DEF 220 PATTERN"),
        ("CALL LBL 1", "call or jump: CALL LBL 1"),
        ("CALL PGM B", "missing program: CALL PGM B"),
        ("/L X+9", "block delete: /L X+9"),
        ("L A+30", "axis other than X, Y and Z: 1 L A+30"),
        ("CR X+9 Y+9 DR+", "radius that is missing or computed: X+9 Y+9 DR+"),
        ("C X+9 Y+9", "arc without a sense: X+9 Y+9"),
        ("C X+9 Y+9 DR+", "arc about a centre that is not known"),
        ("L IX+5", "increment of an unknown place: X"),
    ],
    "heidenhain-iso": [
        ("G01 G41 X+9 F200", "cutter compensation: N10 G01 G41 X+9 F200 *"),
        ("G06 X+5 Y+5", "path function: G06"),
        ("G11 R+20 H+45", "path function: G11"),
        ("G05 X+5 Y+5", "path function: G05"),
        ("G01 X+Q1", "place that is computed: X"),
        ("G01 X+9 FQ10", "feed that is computed: FQ10"),
        ("G01 XMAX", "place that is computed: X"),
        ("GMAX X+9", "unknown word: GMAX"),
        ("G1,5 X+9", "unknown word: G1,5"),
        ("GQ5 X+9", "unknown word: GQ5"),
        ("G01 X+9 F100 MQ3", "unknown word: MQ3"),
        ("G04 FMAX", "dwell without a time: G04"),
        ("D00 Q5 P01 +3", "Q parameter: N10 D00 Q5 P01 +3"),
        ("G01 X+9 F100 M99", "call of a cycle: M99"),
        ("G200 Q200=+2", "unknown G word: G200"),
        ("L1,0", "call or jump: L1,0"),
        ("%B", "call of a program: %B"),
        ("G03 X+9 Y+9 F100", "arc about a centre that is not known"),
        ("G01 G91 X+5 F100", "increment of an unknown place: X"),
    ],
}


@pytest.mark.parametrize(
    ("dialect", "block", "told"), [(name, *case) for name, cases in NAMED.items() for case in cases]
)
def test_what_is_not_followed_is_named(dialect: str, block: str, told: str) -> None:
    program = (klartext if dialect == "heidenhain" else iso)(block)
    assert [(note.first, note.what) for note in program.notes] == [(1, told)]
    assert program.motions.kind.size == 0


@pytest.mark.parametrize(
    ("block", "told"),
    [
        ("Q5 = Q6 + 3", "Q parameter: Q5 = Q6 + 3"),
        ("FN 1: Q5 = +Q6 + +3", "Q parameter: FN 1: Q5 = +Q6 + +3"),
        ("FN 18: SYSREAD Q5 = ID270 NR1 IDX1", "value that only the machine knows: FN 18: SYSREAD Q5 = ID270 NR1 IDX1"),
        ("FN 16: F-PRINT A / B", "output: FN 16: F-PRINT A / B"),
    ],
)
def test_what_computes_is_named_and_moves_nothing(block: str, told: str) -> None:
    """An increment behind it counts from the place before it."""
    program = klartext(f"L X+3 Y+4 F100\n{block}\nL IX+5")
    assert [note.what for note in program.notes] == [told]
    assert (program.motions.end[-1, :2] / MM).tolist() == [8.0, 4.0]


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("number", [90, 94, 107, 108, 111, 116, 117, 126, 127, 129, 134, 135, 138, 141, 148, 149])
def test_m_functions_of_the_manual_that_move_nothing(dialect: str, number: int) -> None:
    both = {
        "heidenhain": ("L X+0 Y+0 F100", f"L M{number}", "L X+10"),
        "heidenhain-iso": ("G01 X+0 Y+0 F100", f"M{number}", "G01 X+10"),
    }
    program = read(dialect, both)
    assert not program.notes
    assert (program.motions.start[-1, :2] / MM).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(
    ("on", "off"), [("L M128", "L M129"), ("FUNCTION TCPM F TCP AXIS POS PATHCTRL AXIS", "FUNCTION RESET TCPM")]
)
def test_where_rotary_axes_turn_about_the_tip_places_may_be_those_of_a_turned_table(on: str, off: str) -> None:
    program = klartext(f"L X+3 Y+4 F100\n{on}\nL X+5\nL X+6 Y+7\n{off}\nL X+8 Y+9\nL X+9")
    assert program.motions.block.tolist() == [1, 6, 7]
    assert np.isnan(program.motions.start[1]).all()


def test_a_feed_for_a_turn_is_none_for_a_minute() -> None:
    program = klartext("L X+3 Y+4 F100\nL M136\nL X+5 F0.2\nL X+6 M137 F100\nL X+7")
    assert np.isnan(program.motions.feed).tolist() == [False, True, False, False]


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_rounding_takes_the_moves_before_and_behind_it_with_it(dialect: str) -> None:
    both = {
        "heidenhain": ("L X+0 Y+0 F100", "L X+10", "RND R2", "L Y+10", "L X+5"),
        "heidenhain-iso": ("G01 X+0 Y+0 F100", "X+10", "G25 R2", "Y+10", "X+5"),
    }
    program = read(dialect, both)
    assert program.motions.block.tolist() == [1, 5]
    assert np.isnan(program.motions.start[1]).all()
    assert [note.first for note in program.notes] == [2, 3, 4]


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_repeated_part_is_passed_through_and_nothing_is_known_behind_it(dialect: str) -> None:
    both = {
        "heidenhain": ("L X+0 Y+0 F100", "LBL 1", "L IX+1", "CALL LBL 1 REP 3/3", "L X+9 Y+9", "L X+8"),
        "heidenhain-iso": ("G01 X+0 Y+0 F100", "G98 L1", "G91 X+1", "L1,3", "G01 G90 X+9 Y+9", "X+8"),
    }
    program = read(dialect, both)
    assert [(note.first, note.last, note.what) for note in program.notes] == [(2, 4, "repeated part")]
    assert program.motions.block.tolist() == [1, 5, 6]
    assert np.isnan(program.motions.start[1]).all()
    assert np.isnan(program.motions.feed[1:]).all()


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_turned_frame_is_not_followed_until_it_ends(dialect: str) -> None:
    both = {
        "heidenhain": (
            "CYCL DEF 10.0 ROTATION",
            "CYCL DEF 10.1 ROT+45",
            "L X+1 Y+1 F100",
            "CYCL DEF 10.0 ROTATION",
            "CYCL DEF 10.1 ROT+0",
            "L X+2 Y+2",
        ),
        "heidenhain-iso": ("G73 G90 H+45", "G01 X+1 Y+1 F100", "G73 H+0", "G01 X+2 Y+2"),
    }
    program = read(dialect, both)
    assert (program.motions.end[:, :2] / MM).tolist() == [[2.0, 2.0]]
    assert len(program.notes) == 1


@pytest.mark.parametrize("dialect", DIALECTS)
def test_a_datum_shift_separates_what_lies_before_and_behind(dialect: str) -> None:
    both = {
        "heidenhain": ("L X+0 Y+0 F100", "CYCL DEF 7.0 DATUM", "CYCL DEF 7.1 X+10", "L X+5 Y+0", "L X+6"),
        "heidenhain-iso": ("G01 X+0 Y+0 F100", "G54 X+10", "G01 X+5 Y+0", "X+6"),
    }
    program = read(dialect, both)
    assert program.notes == ()
    assert program.motions.chain.tolist() == [0, 1, 1]
    assert np.isnan(program.motions.start[1]).all()


def test_a_retraction_to_the_end_of_the_travel_leaves_the_other_axes_where_they_are() -> None:
    """Before every tool CAM systems write it (iTNC 530, "Retraction from the contour in the tool-axis direction")."""
    program = klartext("L X+1 Y+2 Z+3 FMAX", "L M140 MB MAX M5", "L IX+4 F100", "L Z+5", "L IZ-1")
    assert not program.notes
    np.testing.assert_allclose(1e3 * program.motions.end[-3:], [[5.0, 2.0, np.nan], [5.0, 2.0, 5.0], [5.0, 2.0, 4.0]])
    for block in ("L X+7 M140 MB MAX", "L M140 MB 50 F750", "L M140 MB MAXX"):
        assert klartext("L X+1 Y+2 Z+3 FMAX", block).notes, block


def test_the_working_plane_follows_the_tool_s_axis() -> None:
    program = klartext("TOOL CALL 1 Y", "L X+10 Y+0 Z+0 F100", "CC Z+0 X+0", "C Z+10 X+0 DR+")
    motions = program.motions
    assert (int(motions.plane[1]), round(math.degrees(motions.angle[1]), 9)) == (18, 270.0)
    assert np.allclose(motions.center[1], 0.0)


def test_inches_are_inches() -> None:
    assert klartext("L X+1 Y+2 F10", units="IN").motions.end[0, :2].tolist() == [0.0254, 0.0508]
    assert klartext("L X+1 Y+2 F10", units="INCH").motions.end[0, :2].tolist() == [0.0254, 0.0508]
    assert iso("G01 X+1 Y+2 F10", units="G70").motions.end[0, :2].tolist() == [0.0254, 0.0508]


def test_what_f_is_in_inches_is_not_known() -> None:
    """It counts tenths of an inch a minute: as inches a minute new feeds would be those of ten times the speed."""
    for program in (klartext("L X+1 F10", units="INCH"), iso("G01 X+1 F10", units="G70")):
        assert np.isnan(program.motions.feed).all()
    assert klartext("L X+1 F600").motions.feed.tolist() == [0.01]


def test_rapid_traverse_holds_for_its_block_alone() -> None:
    program = klartext("L X+0 Y+0 F700", "L X+1 FMAX", "L X+2")
    assert (program.motions.feed / MM_PER_MIN).round(6).tolist() == [700.0, 0.0, 700.0]


@pytest.mark.parametrize(
    ("blocks", "why"),
    [
        (("G01 X+0 Y+0 Z-1 F100", "X+9", "X+0", "G91 X+5"), "line 5 counts in increments (G91)"),
        (("G01 X+0 Y+0 Z-1 F100", "X+9", "X+0", "G02 X+0 Y+2 I+0 J+1"), "line 5 moves, and has a centre"),
    ],
)
def test_an_iso_program_whose_words_hang_together_stays_with_a_reason(blocks: tuple[str, ...], why: str) -> None:
    program = iso(*blocks)
    found = ISO.compensate(program.data)
    assert found.text == program.data
    assert why in " ".join(why_not_editable(program))


def test_a_mode_that_was_set_on_a_line_that_is_passed_through_is_not_relied_on() -> None:
    program = iso("G01 X+0 Y+0 F100", "G00 X+5 M99", "X+6", "G01 X+7", "X+8")
    assert [note.what for note in program.notes] == [
        "call of a cycle: M99",
        "move in a mode that was set on a line that is passed through: N30 X+6",
    ]
    assert program.motions.end[-2:, 0].tolist() == [0.007, 0.008]


def test_behind_another_program_nothing_counts_before_g90_or_g91() -> None:
    program = iso("G01 X+0 Y+0 F100", "%OTHER", "G01 X+6", "G90 G01 X+7")
    assert [note.what.partition(":")[0] for note in program.notes] == [
        "call of a program",
        "move behind a program that may have ended in G90 or G91",
    ]
    assert program.motions.end[-1, 0] == 0.007


@pytest.mark.parametrize(
    ("dialect", "block"),
    [
        *(
            ("heidenhain", one)
            for one in ("CR X+Q5 Y+5 R+9 DR+ M89", "CT X+5 Y+5 M89", "L X+5 FAUTOM89", "/L X+5 M089")
        ),
        *(("heidenhain-iso", one) for one in ("G02 X+Q5 Y+5 R+9 M89", "G06 X+5 M89", "G01 X+Q5 M 89")),
    ],
)
def test_cycles_are_called_at_each_move_behind_m89_whatever_else_is_in_its_block(dialect: str, block: str) -> None:
    program = (
        klartext("L Z+0 F100", block, "L X+1", "L X+2")
        if dialect == "heidenhain"
        else iso("G01 Z+0 F100", block, "G01 X+1", "G01 X+2")
    )
    assert program.notes[-1].what == "move behind which M89 calls a cycle"
    assert not np.isin(program.motions.block, (3, 4)).any()


TANGENTIAL = {
    "heidenhain": ("L X+0 Y+0 Z+0 F100", "L X+5 Y+9", "L Z-1", "CT X+9 Y+20", "CT X+20 Y+9", "L X+30 Y+0", "L X+20"),
    "heidenhain-iso": (
        "G01 X+0 Y+0 Z+0 F100",
        "X+5 Y+9 S900",
        "Z-1",
        "G06 X+9 Y+20",
        "G06 X+20 Y+9",
        "G01 X+30 Y+0",
        "X+20",
    ),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_nothing_comes_between_a_tangential_move_and_the_ones_before_it(dialect: str) -> None:
    """A short move there would be the one that its direction goes on from."""
    program = read(dialect, TANGENTIAL)
    assert program.notes[0].what.startswith("move from which a tangential one goes on")
    assert program.notes[1].what.startswith("path function")
    assert program.motions.block.tolist() == [1, 6, 7]


CALLED = {
    "heidenhain": ("L X+0 Y+0 F100", "LBL1", "L X+9", "L X+1", "LBL 0", "L X+2", "CALL LBL 1", "L X+5 Y+5", "L X+6"),
    "heidenhain-iso": (
        *("G01 X+0 Y+0 F100", "G98 L1", "G01 X+9", "X+1", "G98 L0", "G01 X+2", "L1,0", "G01 X+5 Y+5", "X+6"),
    ),
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_what_runs_on_its_way_and_is_called_again_is_passed_through(dialect: str) -> None:
    program = read(dialect, CALLED)
    assert (program.notes[0].first, program.notes[0].last) == (2, 5)
    assert program.notes[0].what == "part that is called from elsewhere"
    assert program.motions.end[program.motions.block >= 8, 0].tolist() == [0.005, 0.006]
    assert not np.isin(program.motions.block, range(2, 6)).any()


def test_a_jump_to_a_label_without_a_blank_is_a_jump() -> None:
    program = klartext("L X+0 Y+0 F100", "LBL1", "L IX+1", "FN9: IF +Q1 LT +9 GOTO LBL1", "L X+9 Y+9")
    assert [(note.first, note.last, note.what) for note in program.notes] == [
        (2, 4, "part that is jumped over or back to")
    ]


@pytest.mark.parametrize("block", ["L X+10 \x85R0", "L X+10\xa0R0", "L X+1\uff11 R0", f"L X+1 M{5000 * '1'}"])
def test_blanks_and_digits_that_no_control_knows_are_not_read_as_its_own(block: str) -> None:
    program = klartext("L X+0 Y+0 R0 F500", block, "L X+20 Y+5")
    assert [note.first for note in program.notes] == [2]


def test_a_number_of_5000_digits_is_named() -> None:
    assert [note.first for note in iso("G01 X+0 F500", f"G01 X+1 M{5000 * '1'}", f"G{5000 * '1'} X+2").notes] == [2, 3]


def test_lines_of_an_iso_program_are_counted_as_everywhere_else() -> None:
    blocks = "%A G71 *\nN10 G01 X+1 F500 ; a\x0bb\x85c *\nN20 G91 X+5 *\n"
    assert why_iso_stays(blocks.encode()) == "line 3 counts in increments (G91)"


def test_a_refusal_shows_no_control_characters() -> None:
    with pytest.raises(InputError) as found:
        read_as("heidenhain-iso", b"N10 \x0bG30 X1\n", "a.i")
    assert len(str(found.value).splitlines()) == 1


@pytest.mark.parametrize("call", ["CALL LBL 1", "CALL LBL 1 REP"])
def test_a_part_that_is_called_again_is_left_as_it_is(call: str) -> None:
    """It moves from another place then; REP without a number calls it as well."""
    part = "LBL 1\nL Z-4 R0 F100\nL X+12 F200\nL X+2\nLBL 0\n"
    text = f"BEGIN PGM A MM\nL X+0 Y+0 Z+2 R0 FMAX M3\n{part}L X+40 Y+9 FMAX\n{call}\nL Z+2 FMAX M30\nEND PGM A MM\n"
    found = read_as("heidenhain", text.encode(), "a.h").notes
    assert [(note.first, note.last) for note in found] == [(2, 6), (8, 8)]


IN_FORCE = {
    "heidenhain": ("L X+0 Y+0 R0 FMAX", "L Z-1 F100"),
    "heidenhain-iso": ("G00 G40 G90 X+0 Y+0", "G01 Z-1 F100"),
}
BEHIND = {
    "heidenhain": ("L X+10 Y+5", "L X+60", "L Y+40"),
    "heidenhain-iso": ("G01 X+10 Y+5", "X+60", "Y+40"),
}


def behind(dialect: str, *blocks: str):
    """Return the motions behind blocks: feeds [mm/min] and sides."""
    both = {dialect: (*IN_FORCE[dialect], *blocks, *BEHIND[dialect])}
    program, first = read(dialect, both), len(IN_FORCE[dialect]) + len(blocks) + 1
    rows = program.motions.block >= first
    feeds = np.round(program.motions.feed[rows] / MM_PER_MIN, 9).tolist()
    return feeds, [program.modal_after(int(block)).compensation for block in program.motions.block[rows]]


@pytest.mark.parametrize(
    ("dialect", "blocks", "feed"),
    [
        ("heidenhain", ("L X+5 Y+5 FQ10",), math.nan),
        ("heidenhain", ("L X+5 Y+5 FAUTO",), math.nan),
        ("heidenhain", ("L X+5 Y+5 FZ0.1",), math.nan),
        ("heidenhain", ("/L X+5 F300",), math.nan),
        ("heidenhain", ("Q10 = +400", "L X+Q3 Y+5 FQ10"), 400.0),
        ("heidenhain", ("APPR LCT X+5 Y+5 R5 R0 F300",), 300.0),
        ("heidenhain", ("L X+5 Y+5", "DEP LT LEN10 F1000"), 1000.0),
        ("heidenhain", ("FL X+5 F250",), 250.0),
        ("heidenhain", ("L X+5 Y+5 FMAX M99",), 100.0),
        ("heidenhain", ("L X+5 F500", "RND R2 F50", "L Y+9"), 500.0),
        ("heidenhain", ("L X+5 Y+3 F500", "CT X+9 Y+9"), 500.0),
        ("heidenhain", ("L Z-2 F50 M91",), 50.0),
        ("heidenhain", ("TOOL CALL 2 Z S900 F70",), 70.0),
        ("heidenhain", ("TOOL CALL 2 Z S900 FQ5",), math.nan),
        ("heidenhain", ("TOOL CALL 2 Z S900 FU0.5",), math.nan),
        ("heidenhain", ("/TOOL CALL 2 Z S900 F50",), math.nan),
        ("heidenhain", ("L X+20 Y+50 R0 F500 M103 F20",), 500.0),
        ("heidenhain", ("Q1 = +300", "/FN 0: Q1 = 50", "L X+5 Y+5 FQ1"), math.nan),
        ("heidenhain", ("Q1 = +300", "FN 18: SYSREAD Q1 = ID50 NR1 IDX0", "L X+5 Y+5 FQ1"), math.nan),
        ("heidenhain", ("CALL SELECTED PGM",), math.nan),
        ("heidenhain", ("CYCL DEF 12.0 PGM CALL", "CYCL DEF 12.1 PGM SUB", "CYCL CALL"), math.nan),
        ("heidenhain", ("/CALL LBL 7",), math.nan),
        ("heidenhain-iso", ("G01 Z-2 F50 M91",), 50.0),
        ("heidenhain-iso", ("T2 G17 S900 F70", "G01"), 70.0),
        ("heidenhain-iso", ("G01 X+5 FQ10",), math.nan),
        ("heidenhain-iso", ("G01 X+Q5 F300",), 300.0),
        ("heidenhain-iso", ("G01 X+5 F500", "G25 R2 F50", "G01 Y+9"), 500.0),
    ],
)
def test_the_feed_of_what_is_passed_through_stays_in_force(dialect: str, blocks: tuple[str, ...], feed: float) -> None:
    feeds, sides = behind(dialect, *blocks)
    assert len(feeds) == 3
    np.testing.assert_equal(feeds, [feed] * len(feeds))
    assert set(sides) == {"G40"}


@pytest.mark.parametrize(
    ("dialect", "blocks"),
    [
        ("heidenhain", ("L X+5 Y+5 RL FQ10",)),
        ("heidenhain", ("/L X+5 Y+5 RL",)),
        ("heidenhain", ("L X+1 Y+1 RL", "/L X+5 Y+5 R0")),
        ("heidenhain", ("APPR LT X+5 Y+5 LEN10 RR F300",)),
        ("heidenhain", ("LP PR+5 PA+3 RL",)),
        ("heidenhain", ("CALL LBL 4",)),
        ("heidenhain", ("CALL LBL 5",)),
        ("heidenhain", ("/CALL LBL 4",)),
        ("heidenhain", ("L X+5 Y+5 RL", "/CALL LBL 6")),
        ("heidenhain", ("L X+5 Y+5 RL", "FN 9: IF +Q5 EQU +1 GOTO LBL 9", "CALL LBL 6", "LBL 9")),
        ("heidenhain", ("APPR LT X+5 Y+20 LEN10 RLF300",)),
        ("heidenhain", ("LN X+5 Y+2 Z+0 NX+0 NY+0 NZ+1 RRF300M3",)),
        ("heidenhain", ("L X+5 Y+5 RL", "FC DR+ R0.5")),
        ("heidenhain", ("L X+5 Y+5 RL", "LP PR0.5 PA+20")),
        ("heidenhain", ("L X+5 Y+5 RL", "FN 9: IF +Q5 EQU +1 GOTO LBL 9", "L X+3 R0", "LBL 9")),
        ("heidenhain-iso", ("G01 G41 X+5 YQ1",)),
        ("heidenhain-iso", ("/G01 G41 X+5",)),
        ("heidenhain-iso", ("L4,0",)),
    ],
)
def test_a_cutter_beside_its_contour_stays_there_whatever_brought_it(dialect: str, blocks: tuple[str, ...]) -> None:
    labels = {
        "heidenhain": (
            *("M30", "LBL 4", "APPR LT X+5 Y+5 LEN10 RL", "LBL 0", "LBL 5", "CALL LBL 4", "LBL 0"),
            *("LBL 6", "L Y+6 R0", "LBL 0"),
        ),
        "heidenhain-iso": ("M30", "G98 L4", "G01 G41 X+5 Y+5", "G98 L0"),
    }
    both = {dialect: (*IN_FORCE[dialect], *blocks, *BEHIND[dialect], *labels[dialect])}
    program, first = read(dialect, both), len(IN_FORCE[dialect]) + len(blocks) + 1
    assert not (program.motions.block >= first).any()


@pytest.mark.parametrize(
    ("dialect", "blocks"),
    [
        ("heidenhain", ("APPR LT X+5 Y+5 LEN10 RL F300", "DEP LT LEN5 F100")),
        ("heidenhain", ("CALL LBL 6",)),
        ("heidenhain-iso", ("G01 G41 X+5 Y+5", "G01 G40 X+Q7")),
    ],
)
def test_a_cutter_has_left_its_contour_whatever_took_it_away(dialect: str, blocks: tuple[str, ...]) -> None:
    labels = {"heidenhain": ("M30", "LBL 6", "L X+1 RL", "L X+9 R0", "LBL 0"), "heidenhain-iso": ("M30",)}
    both = {dialect: (*IN_FORCE[dialect], *blocks, *BEHIND[dialect], *labels[dialect])}
    program, first = read(dialect, both), len(IN_FORCE[dialect]) + len(blocks) + 1
    assert (program.motions.block >= first).sum() >= 2


def test_a_centre_on_a_line_that_is_passed_through_is_not_relied_on() -> None:
    program = klartext("L X+0 Y+0 R0 F100", "CC X+10 Y+0", "/CC X+20 Y+0", "C X+20 Y+0 DR+")
    assert (program.motions.kind != ARC).all()
    assert any(note.what.startswith("arc about a centre that is not known") for note in program.notes)


@pytest.mark.parametrize(
    ("dialect", "block"),
    [
        ("heidenhain", "/PLANE SPATIAL SPA+0 SPB+45 SPC+0 TURN FMAX"),
        ("heidenhain", "/CYCL DEF 10.1 ROT+35"),
        ("heidenhain", "/L X+1 M128"),
        ("heidenhain", "/ FUNCTION TCPM F TCP AXIS POS"),
        ("heidenhain-iso", "/G73 G90 H+35"),
        ("heidenhain-iso", "/M128"),
    ],
)
def test_a_frame_that_may_be_turned_is_not_followed(dialect: str, block: str) -> None:
    assert behind(dialect, block) == ([], [])
    assert behind(dialect, "/M9")[0]


@pytest.mark.parametrize(
    ("on", "off"),
    [
        (("TRANS ROTATION ROT+45",), ("TRANS ROTATION RESET",)),
        (("TRANS MIRROR AXIS X",), ("TRANS MIRROR RESET",)),
        (("FUNCTION PARAXMODE X Y W", "FUNCTION PARAXCOMP OFF Z"), ("FUNCTION PARAXMODE OFF",)),
        (("M128", "CALL PGM 129"), ("M129",)),
        (("PLANE SPATIAL SPA+0 SPB+9 SPC+0 STAY", "/CALL LBL 7"), ("PLANE RESET STAY",)),
        (
            *(
                (
                    *("LBL 1", "CYCL DEF 10.0 ROT", "CYCL DEF 10.1 ROT+45", "FN 9: IF +Q1 EQU +1 GOTO LBL 2"),
                    *("CYCL DEF 10.0 ROT", "CYCL DEF 10.1 ROT+0", "LBL 2", "CALL LBL 1 REP 2"),
                ),
                ("CYCL DEF 10.0 ROT", "CYCL DEF 10.1 ROT+0"),
            ),
        ),
        (("M114",), ("M115",)),
        (("M144",), ("M145",)),
        (("M128 F1000",), ("M129",)),
        (("LN X+50 Y+40 Z-1 NX+0 NY+0 NZ+1 F200 M128",), ("M129",)),
        (("L X+5 Y+5 FAUTO M128",), ("M129",)),
        (("APPR LT X+40 Y+50 LEN10 R0 F200 M128",), ("L X+0 M129",)),
        (("CALL LBL 5",), ("CYCL DEF 10.0 ROT", "CYCL DEF 10.1 ROT+0")),
        (("LBL 3", "CYCL DEF 10.0 ROT", "CYCL DEF 10.1 IROT+30", "CALL LBL 3 REP 5"), ("CYCL DEF 10.1 ROT+0",)),
        (("FN 9: IF +Q1 EQU +0 GOTO LBL 6", "PLANE SPATIAL SPA+0 SPB+9 SPC+0 STAY", "LBL 6"), ("PLANE RESET STAY",)),
        (("CYCL DEF 10.0 ROT", "CYCL DEF 10.1 ROT+Q1", "CYCL DEF 10.1 IROT+0"), ("CYCL DEF 10.1 ROT+0",)),
    ],
)
def test_a_turned_frame_is_seen_wherever_it_stands(on: tuple[str, ...], off: tuple[str, ...]) -> None:
    sub = ("M30", "LBL 5", "CYCL DEF 10.0 ROTATION", "CYCL DEF 10.1 ROT+45", "LBL 0", "LBL 7", "PLANE RESET", "LBL 0")
    for blocks, known in ((on, 0), ((*on, *off), 3)):
        first = len(IN_FORCE["heidenhain"]) + len(blocks) + 1
        program = klartext(*IN_FORCE["heidenhain"], *blocks, *BEHIND["heidenhain"], *sub)
        assert (program.motions.block >= first).sum() == known


@pytest.mark.parametrize(
    "body",
    [
        ("CYCL DEF 10.1 ROT+45", "L X+1", "CYCL DEF 10.1 ROT+0"),
        ("TRANS DATUM AXIS X+5",),
        ("CALL PGM 128",),
        ("FUNCTION PARAXCOMP DISPLAY W",),
    ],
)
def test_a_subprogram_that_leaves_the_frame_does_so(body: tuple[str, ...]) -> None:
    program = klartext(*IN_FORCE["heidenhain"], "CALL LBL 5", *BEHIND["heidenhain"], "M30", "LBL 5", *body, "LBL 0")
    assert (program.motions.block >= 4).sum() == 3


def test_a_call_ends_a_turn() -> None:
    blocks = ("M128", "CALL LBL 5", *BEHIND["heidenhain"], "M30", "LBL 5", "M129", "LBL 0")
    assert (klartext(*IN_FORCE["heidenhain"], *blocks).motions.block >= 5).sum() == 3


@pytest.mark.parametrize(
    "call", ["/CALL LBL 3 REP 5", "CALL LBL 3 REP Q5", "CALL LBL QS1 REP 5", "FN 12: IF +Q1 LT +5 GOTO LBL QS1"]
)
def test_what_any_call_may_repeat_is_passed_through(call: str) -> None:
    program = klartext("L X+50 Y+50 R0 F200", "LBL 3", "L IX-10", "L IX+5", call, "L X+0 Y+0", "L X+9")
    assert not np.isin(program.motions.block, (2, 3, 4, 5)).any()


@pytest.mark.parametrize(
    ("dialect", "corner"), [("heidenhain", "/RND R5"), ("heidenhain", "/ CHF 5"), ("heidenhain-iso", "/G25 R5")]
)
def test_a_corner_that_may_be_skipped_takes_the_moves_beside_it_with_it(dialect: str, corner: str) -> None:
    blocks = {
        "heidenhain": ("L X+0 Y+0 R0 F200", "L X+50", corner, "L Y+40", "L X+0 Y+9"),
        "heidenhain-iso": ("G01 G90 G40 X+0 Y+0 F200", "G01 X+50", corner, "G01 Y+40", "G01 X+0 Y+9"),
    }
    assert not np.isin(read(dialect, blocks).motions.block, (2, 3, 4)).any()


@pytest.mark.parametrize(
    "user",
    [
        "CTP PR+30 PA+90",
        "APPR PLT PR+10 PA+0 LEN10 RL F200",
        "DEP PLCT PR+80 PA+0 R5",
        "/C X+20 Y+50 DR+",
        "LP PR+3 PA+1",
    ],
)
def test_what_is_passed_through_uses_the_pole(user: str) -> None:
    program = klartext("L X+50 Y+20 R0 F400", "CC X+20 Y+20", "C X+20 Y+50 DR+", "L X+10 Y+50", user)
    assert program.centre_users[5] == (2, False)
