"""Modal states, breaks and positions that get lost, against what the words mean by the book."""

import math
import re
from decimal import Decimal

import numpy as np
import pytest

from ph_post.dialects.registry import find_dialect
from ph_post.errors import InputError
from ph_post.gcode.read import read_program

HEAD = "G21 G90 G17 G94 F600\nG0 X0 Y0 Z0\n"


def read(body, head=HEAD, **options):
    return read_program((head + body).encode(), "a.ngc", **options)


def ends(program, place="end"):
    """Ends, or starts, of the motions behind the head [mm]."""
    return (getattr(program.motions, place)[1:] * 1e3).round(9).tolist()


def kinds(program):
    return [(one.kind, one.block, one.motion) for one in program.breaks[1:-1]]


def test_a_program_begins_in_millimetres_and_in_the_plane_of_x_and_y():
    modal = read_program(b"(nothing)\n", "a").modal_after(0)
    assert (modal.plane, modal.units, modal.absolute, modal.feed_mode) == (17, 1e-3, True, 94)
    assert modal.motion is modal.system is modal.path is modal.spindle is modal.tool is None


def test_every_group_keeps_its_last_word():
    program = read("G18 G20 G91 G90.1 G93 G40 G49 G98 G64 P0.01 Q0 G59.3 T3 S1200 M4 M7 M8\nM6\nM5 M9\nG61.1 G43 H1\n")
    first, changed, quiet, last = (program.modal_after(block) for block in range(2, 6))
    assert (first.plane, first.units, first.absolute, first.arc_absolute) == (18, 0.0254, False, True)
    assert (first.feed_mode, first.compensation, first.length, first.retract) == (93, "G40", "G49", "G98")
    assert (first.path, first.system, first.prepared, first.tool) == ("G64 P0.01 Q0", "G59.3", 3.0, None)
    assert (first.speed, first.spindle, first.mist, first.flood) == (1200.0, "M4", True, True)
    assert (changed.tool, quiet.spindle, quiet.mist, quiet.flood) == (3.0, "M5", False, False)
    assert (last.path, last.length, last.motion) == ("G61.1", "G43", "G0")


def test_a_tool_is_prepared_before_it_is_changed_wherever_it_stands():
    program = read("T1\nM6 T2\nM6\nM61 Q7\nM61 Q#1\n")
    tools = [program.modal_after(block) for block in range(2, 7)]
    assert [(modal.tool, modal.prepared) for modal in tools] == [(None, 1), (2, 2), (2, 2), (7, 2), (None, 2)]


def test_states_that_are_the_same_are_kept_once():
    program = read("M8\nM9\n" * 500)
    assert len(program.modal) < 10
    assert program.state[3::2].tolist() == program.state[3:4].tolist() * 500


def test_more_states_than_there_was_room_for_are_all_kept():
    program = read("".join(f"S{number}\n" for number in range(1000)))
    assert [program.modal_after(2 + number).speed for number in range(1000)] == [float(n) for n in range(1000)]


def test_feed_is_kept_as_written_and_changes_its_number_with_the_units():
    program = read("G20\nG1 X1\nF10\nG21\n")
    assert program.feed_word.tolist() == pytest.approx([600, 600, 600 / 25.4, 600 / 25.4, 10, 254])
    assert program.motions.feed[1] == pytest.approx(0.01)


def test_feed_beside_other_units_is_not_guessed():
    program = read("G20 F10\nG1 X1\n")
    assert math.isnan(program.motions.feed[1])


def test_a_motion_under_g93_has_its_time():
    program = read("G93 G1 X5 F2\nG94 F100\n")
    assert program.motions.duration.tolist() == [0.0, 30.0]
    assert math.isnan(program.motions.feed[1])


def test_a_feed_per_revolution_is_not_told():
    assert math.isnan(read("S100 M3\nG95 F0.1 G1 X5\n").motions.feed[1])


@pytest.mark.parametrize(("word", "exact"), [("G61", 1), ("G61.1", 1), ("G64", 0), ("G64 P0.1", 0)])
def test_exact_stop_is_told(word, exact):
    assert read(f"{word}\nG1 X1\n").motions.exact.tolist() == [0, exact]


def test_increments_add_up_and_a_single_axis_leaves_the_others():
    program = read("G91 G1 X1 Y2\nZ-1\nX1\nG90 X0\n")
    assert ends(program) == [[1, 2, 0], [1, 2, -1], [2, 2, -1], [0, 2, -1]]


@pytest.mark.parametrize("words", ["G80 G0", "G0 G80"])
def test_a_cycle_is_ended_beside_another_motion(words):
    program = read(f"G81 X1 Z-1 R1\n{words} X5\nX6\n")
    np.testing.assert_array_equal(program.motions.end[1:, 0], [5e-3, 6e-3])
    assert program.modal_after(3).motion == "G0"


def test_inches_are_inches():
    np.testing.assert_allclose(read("G20 G1 X1 Y-0.5\n").motions.end[1], [0.0254, -0.0127, 0.0], rtol=1e-15)


@pytest.mark.parametrize("words", ["M106 S255", "M10 P1", "M41", "G9", "M31", "M29 S500"])
def test_a_word_that_moves_nothing_ends_no_chain(words):
    program = read(f"G1 X1\n{words}\nG91 G1 X7\n")
    assert [one.kind for one in program.breaks] == ["beginning", "end"]
    assert program.motions.chain.tolist() == [0, 0, 0]
    assert program.motions.end[-1].tolist() == [8e-3, 0.0, 0.0]
    (note,) = program.notes
    assert note.what == f"{words[0]} word of other controllers, which moves nothing: {words.split()[0]}"


@pytest.mark.parametrize(
    ("words", "kind", "lost"),
    [
        ("T1 M6", "tool change", "XYZ"),
        ("M61 Q1", "tool change", "XYZ"),
        ("G28", "home", "XYZ"),
        ("G28 X5 Y0", "home", "XY"),
        ("G91 G28 Z0", "home", "Z"),
        ("G30 Z5", "home", "Z"),
        ("G28 A0", "home", ""),
        ("G38.2 Z-5 F10", "probe", "Z"),
        ("G54", "frame", "XYZ"),
        ("G43 H1", "frame", "Z"),
        ("G43.1 X1", "frame", "XZ"),
        ("G18 G43 H1", "frame", "XYZ"),
        ("G49", "frame", "Z"),
        ("G10 L2 P1 X0", "frame", "X"),
        ("G10 L2 P1 X0 R5", "frame", "XYZ"),
        ("G10 L20 P1 Y0", "frame", "Y"),
        ("G10 L20 P0 Y0", "frame", ""),
        ("G10 L1 P1 Z5", "frame", "Z"),
        ("G10 L50", "frame", "XYZ"),
        ("G52 X5", "frame", "X"),
        ("G92.1", "frame", "XYZ"),
        ("G92.3", "frame", "XYZ"),
        ("G53 G0 Z0 A5", "machine coordinates", "Z"),
        ("G2 A90", "not understood", "XYZ"),
        ("G1 X1 A90 B5", "not understood", ""),
        ("G1 U90 V2 C3 A5 X1", "not understood", "XYZ"),
        ("G81 X1 Z-5 R1", "not understood", "XYZ"),
        ("G1 X#5", "not understood", "XYZ"),
        ("M98 P5", "not understood", "XYZ"),
        ("G9 G1 Y0", "not understood", ""),
        ("M150", "not understood", "XYZ"),
        ("G187", "not understood", "XYZ"),
    ],
)
def test_behind_a_break_the_place_of_what_may_have_moved_is_known_by_absolute_words_only(words, kind, lost):
    program = read(f"G1 X1\n{words}\nG90 G0 X7\n")
    assert kinds(program) == [(kind, 3, 2)]
    if words == "M98 P5":  # a subprogram may leave any mode behind, so nothing is known of what follows
        assert program.motions.block.size == 2
        return
    assert program.motions.chain.tolist() == [0, 0, 1]
    before = np.where([axis in lost for axis in "XYZ"], np.nan, [1e-3, 0.0, 0.0])
    np.testing.assert_array_equal(program.motions.start[-1], before)
    np.testing.assert_array_equal(program.motions.end[-1], [7e-3, *before[1:]])


def test_a_further_axis_beside_the_others_leaves_them_where_the_line_says():
    program = read("G1 X1 A90\nG91 Y1 A90\nG90 G1 X7 U3\nG2 X9 I1 C5\nG0 X8 B3 C4\n")
    assert kinds(program) == []
    assert ends(program) == [[1, 0, 0], [1, 1, 0], [7, 1, 0], [9, 1, 0], [8, 1, 0]]


@pytest.mark.parametrize("words", ["G1 A90", "G0 A90 B5", "G1 U5 V5 W5 C3", "G91 A5"])
def test_while_further_axes_move_alone_the_others_rest(words):
    program = read(f"G1 X1\n{words}\nG90 G1 X7\n")
    assert kinds(program) == []
    assert ends(program) == [[1, 0, 0], [7, 0, 0]]


def test_two_rotary_axes_in_one_cut_are_passed_through_and_named():
    program = read("G1 X1\nG1 X2 A5 B5\nG1 X7\n")
    assert [note.what for note in program.notes] == [
        "cut in which several rotary axes turn, perhaps about the tip of the tool: A5"
    ]
    assert ends(program, "start")[-1] == [2, 0, 0]


@pytest.mark.parametrize(
    ("begin", "cut"),
    [("G0 X1 A5 B5", "G1 X2 A5 B5"), ("G0 X1 A5 B5", "G1 X2 A7 B5"), ("G0 X1 A5\nB5", "G2 X2 I0.5 A5 B5 C1")],
)
def test_rotary_axes_that_stand_where_a_cut_has_them_do_not_turn(begin, cut):
    program = read(f"{begin}\n{cut}\nG1 X7\n")
    assert program.notes == ()
    assert ends(program)[-2:] == [[2, 0, 0], [7, 0, 0]]


@pytest.mark.parametrize(
    "between",
    ["G92 B0", "G28 B0", "G91 G0 B1\nG90", "T1 M6", "G54", "M150", "G10 L2 P1 B1", "/G0 B7", "G0 B#5", "G53 G0 B5"],
)
def test_where_a_rotary_axis_stands_is_not_guessed(between):
    program = read(f"G0 X1 A5 B5\n{between}\nG1 X2 A6 B5\n")
    assert program.notes[-1].what.startswith("cut in which several rotary axes turn")


@pytest.mark.parametrize(("begin", "end"), [("G43.4 H1", "G49"), ("G12.1", "G13.1")])
def test_where_a_rotary_axis_may_move_the_others_nothing_is_understood(begin, end):
    program = read(f"G1 X1\n{begin}\nG1 X2 C5\nG1 C9\nG1 X3\n{end}\nG0 X5\nG1 X6 C1\n")
    assert [place[0] for place in ends(program)] == [1, 5, 6]


def test_a_work_offset_that_is_not_in_force_moves_nothing():
    program = read("G55 G0 X0 Y0 Z0\nG10 L2 P1 X5\nG10 L20 P2 X5\nG1 X6\n")
    assert ends(program, "start")[-1] == [5, 0, 0]


@pytest.mark.parametrize(
    "words",
    [
        "G91 G0 X1 Y1\nG1 X5 Y2\nG2 X2 Y2 I2\n",
        "G90 G2 I5 J5\n",
        "G91 G1 X5\nG1 Y5\nG28\nG1 X-2 Y1\n",
        "G91 G1 X5 Y5 Z1\nG92 X0\nG90 G1 X2\nG91 Y5\n",
    ],
)
def test_increments_need_no_place_to_begin_at(words):
    motions = read_program(f"G21 G17 F600\n{words}M2\n".encode(), "a").motions
    assert motions.block.size == len(re.findall(r"G2 |G0 |G1 |G91 Y", words))
    assert np.isfinite(motions.start[:, :2]).all()
    assert np.isfinite(motions.end[:, :2]).all()


def test_an_axis_that_a_word_places_later_is_not_known_before():
    motions = read_program(b"G21 G91 F600\nG1 X1 Y1\nG1 X1 Y1\nG90 G1 X5\nM2\n", "a").motions
    np.testing.assert_array_equal(motions.end[:, 0], [np.nan, np.nan, 5e-3])
    np.testing.assert_array_equal(motions.end[:, 1], [1e-3, 2e-3, 2e-3])


def test_an_arc_about_an_absolute_centre_needs_a_place():
    program = read_program(b"G21 G17 G90.1 F600\nG2 I5 J5\nM2\n", "a")
    assert [note.what for note in program.notes] == ["arc from an unknown position: G2 I5 J5"]


def test_what_is_seen_through_breaks_nothing():
    users = "M64 P1\nM19 R90\nM68 E0 Q5\nG96 D100 S5\nG97 S1\n"
    between = f"(a)\n\nM3 S1\n{users}M8\nF100\nG4 P1\nG64\nM0\nG17\nG91.1\nT5\n;\nM48\nG40\nG80\n"
    program = read(f"G1 X1\n{between}G1 X2\n")
    assert kinds(program) == []
    assert program.motions.chain.tolist() == [0, 0, 0]


def test_machine_coordinates_lose_the_axes_that_they_name():
    program = read("G53 G0 Z0\nG0 X5\n")
    assert kinds(program) == [("machine coordinates", 2, 1)]
    np.testing.assert_array_equal(program.motions.end[1:], [[5e-3, 0.0, np.nan]])


def test_a_work_system_that_is_active_changes_nothing():
    assert kinds(read("G54\nG1 X1\nG54\nG1 X2\n")) == [("frame", 2, 1)]


def test_g92_gives_the_place_another_name():
    program = read("G1 X1 Y2\nG92 X10\nG91 G1 X1 Y1\n")
    assert kinds(program) == [("frame", 3, 2)]
    assert ends(program)[-1] == [11, 3, 0]


def test_a_break_stands_before_the_motion_on_its_line_and_the_end_behind_it():
    program = read("T1 M6 G43 G0 Z5\nG0 Z10 M30\nG1 X99 X98\n")
    assert kinds(program) == [("tool change", 2, 1)]
    assert (program.breaks[-1].kind, program.breaks[-1].block, program.breaks[-1].motion) == ("end", 3, 3)
    assert program.motions.chain.tolist() == [0, 1, 1]


@pytest.mark.parametrize("end", ["M2", "M30", "%"])
def test_behind_the_end_nothing_is_read(end):
    program = read_program(f"%\n{HEAD}G1 X1\n{end}\nX1 X2 (\n".encode(), "a")
    assert program.motions.block.tolist() == [2, 3]
    assert program.breaks[-1].block == 4
    assert program.state.size == program.feed_word.size == program.blocks == 6
    assert program.feed_word[-1] == 600.0


def test_a_full_circle_goes_on_for_its_turns():
    motions = read("G3 I5 P3\nG2 X10 I5 P2\n").motions
    np.testing.assert_allclose(motions.angle[1:], [6 * math.pi, -3 * math.pi])


@pytest.mark.parametrize(
    ("plane", "words", "center", "angle"),
    [
        ("G17", "G3 X-5 Y5 I-5 J0", (-5, 0), math.pi / 2),
        ("G18", "G3 Z-5 X5 K-5 I0", (-5, 0), math.pi / 2),
        ("G19", "G2 Y-5 Z5 J-5", (-5, 0), -3 * math.pi / 2),
        ("G17", "G2 X3 Y-1 R5", None, None),
        ("G18", "G3 X3 Z-1 R-5", None, None),
    ],
)
def test_arcs_turn_in_the_sense_of_their_plane(plane, words, center, angle):
    motions = read(f"{plane} {words}\n").motions
    axes = {"G17": [0, 1], "G18": [2, 0], "G19": [1, 2]}[plane]
    start, end, middle = motions.start[1, axes], motions.end[1, axes], motions.center[1]
    if center is None:
        radius, long = 5e-3, "R-" in words
        np.testing.assert_allclose(np.linalg.norm([start - middle, end - middle], axis=1), radius, rtol=1e-12)
        assert (abs(motions.angle[1]) > math.pi) == long
        assert (motions.angle[1] > 0) == words.startswith("G3")
    else:
        np.testing.assert_allclose(middle * 1e3, center, atol=1e-12)
        assert motions.angle[1] == pytest.approx(angle)
    turn = motions.angle[1]
    rotation = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
    np.testing.assert_allclose(middle + rotation @ (start - middle), end, atol=1e-15)


def test_an_arc_of_almost_nothing_is_no_circle():
    motions = read("G1 X0 Y0\nG3 X0 Y0.0001 I-1000\nG2 X0 Y0.0001 I-1000\n").motions
    assert motions.angle[2] == pytest.approx(1e-7, rel=1e-6)
    assert motions.angle[3] == -math.tau


def test_radii_may_differ_as_linuxcnc_lets_them():
    read("G2 X10.02 Y0 I5 J0\n")
    read("G2 X1000.4 Y0 I500 J0\n")
    with pytest.raises(InputError, match="radii of the arc differ"):
        read("G2 X10.06 Y0 I5 J0\n", strict=True)


def test_splines_have_their_control_points():
    program = read("G5 X10 Y0 I1 J2 P-3 Q4\nG5 X20 Y0 P-1 Q-1\nG5.1 X30 Y0 I6 J3\n")
    control = {row: (points[:, :2] * 1e3).round(9).tolist() for row, points in program.motions.control.items()}
    assert control[1] == [[0, 0], [1, 2], [7, 4], [10, 0]]
    assert control[2] == [[10, 0], [13, -4], [19, -1], [20, 0]]
    assert control[3] == [[20, 0], [24, 2], pytest.approx([82 / 3, 2]), [30, 0]]


def test_a_nurbs_has_its_points_and_weights():
    program = read("G5.2 P2 L4\nX1 Y1 P1\nX2 Y1 P3\nX3 Y0 P1\nG5.3\nG1 X9\n")
    order, points, weights = program.motions.nurbs[1]
    assert order == 4
    assert (points * 1e3).round(9).tolist() == [[0, 0, 0], [1, 1, 0], [2, 1, 0], [3, 0, 0]]
    assert weights.tolist() == [2, 1, 3, 1]
    assert program.motions.kind.tolist() == [0, 4, 1]
    assert program.motions.start[2].tolist() == program.motions.end[1].tolist()


def test_numbers_are_kept_exactly_with_blanks_signs_and_without_digits_on_one_side():
    words = read_program(b"g0 x +1 0.2 50 y-.5 z5. f-0\n", "a").words
    assert words.letter.tobytes() == b"GXYZF"
    assert list(zip(words.digits.tolist(), words.decimals.tolist(), strict=True)) == [
        (0, 0),
        (10250, 3),
        (-5, 1),
        (5, 0),
        (0, 0),
    ]
    assert [b"g0 x +1 0.2 50 y-.5 z5. f-0"[a:b] for a, b in zip(words.start, words.end, strict=True)] == [
        b"g0",
        b"x +1 0.2 50",
        b"y-.5",
        b"z5.",
        b"f-0",
    ]


def test_decimals_beyond_what_is_kept_are_left_out():
    """As JavaScript prints them: 20 decimals, and more; of those that are kept each is right."""
    text = "G21 G90\nG1 X10.09627459187944600000 Y-0.0000000000000000000125 Z-334.18879400000000000001 F9\n"
    program = read_program(text.encode(), "a")
    words = program.words
    for letter, wanted in {"X": "10.096274591879446", "Y": "0", "Z": "-334.188794"}.items():
        word = words.letter.tobytes().decode().index(letter)
        found = Decimal(int(words.digits[word])).scaleb(-int(words.decimals[word]))
        assert abs(found - Decimal(wanted)) < Decimal("2e-15")
        assert words.value[word] == pytest.approx(float(wanted), rel=2e-16, abs=1e-15)
    assert not program.notes
    places = program.motions.end[0] * 1e3
    assert places.tolist() == pytest.approx([10.096274591879446, 0.0, -334.188794], abs=1e-12)


def test_long_numbers_are_kept_exactly():
    zeros = "0" * 5000
    text = f"G21 G90\nG1 X1234567890.123456789 Y-{zeros}.{zeros} Z-{zeros}1.25 F100\n"
    words = read_program(text.encode(), "a").words
    found = dict(
        zip(
            words.letter.tobytes().decode(),
            zip(words.digits.tolist(), words.decimals.tolist(), strict=True),
            strict=True,
        )
    )
    assert found["X"] == (1234567890123456789, 9)
    assert found["Y"] == (0, 5000)
    assert found["Z"] == (-125, 2)
    rows = np.array([3, 4])
    assert words.digits_of(rows).tolist() == words.take(rows).digits.tolist() == [1234567890123456789, 0]


@pytest.mark.parametrize(
    "change", ["/G41 D1 G1 X0 Y0", "o1 if [#1]\nG41 D1\no1 endif", "G[40+#1] D1\nG90 G21 G17 G94 G54"]
)
def test_where_nobody_knows_whether_the_cutter_is_beside_its_contour_nothing_moves(change: str) -> None:
    text = f"G21 G90 G17 G40\nG0 X-10 Y-10\nG1 Z-1 F100\n{change}\nG1 X0 Y30\nX30\nA5 X20\nG40\nG1 X1 Y1\nX9\n"
    for contours in (False, True):
        language = find_dialect("linuxcnc").language
        program = read_program(text.encode(), "a.ngc", language=language.contoured() if contours else language)
        lines = text.splitlines()
        first, free = lines.index("G1 X0 Y30"), lines.index("G1 X1 Y1")
        block = program.motions.block
        assert not ((block >= first) & (block < free)).any()
        assert (block > free).any()


BODY = "G41 D1 G1 X9\nX20\n"


@pytest.mark.parametrize(
    ("body", "known"),
    [
        (BODY + "G40 X40\n", True),
        ("o1 if [#1]\n" + BODY + "o1 endif\nG40 X40\n", True),
        (BODY, False),
        (BODY + "o1 if [#1]\nG40 X40\no1 endif\n", False),
        (BODY + "o1 if [#1]\no100 return\no1 endif\nG40 X40\n", False),
        (BODY + "o1 while [#1]\nG40 X40\no1 endwhile\n", False),
    ],
)
def test_a_subprogram_that_ends_its_contour_leaves_none_behind(body: str, known: bool) -> None:
    """Neither its definition, which runs nothing, nor its call, whose other words are said anew."""
    again = "G1 X60 F100\nX5\n"
    text = f"G21 G90 G17\no100 sub\n{body}o100 endsub\nG0 X0 Y0\n{again}o100 call\nG0 X1 Y1\n{again}M2\n"
    block = read_program(text.encode(), "a.ngc").motions.block
    assert block.size == (6 if known else 0)


def test_a_call_in_a_contour_may_end_it() -> None:
    text = (
        "G21 G90 G17\no100 sub\nG41 D1\nG40\no100 endsub\nG0 X0 Y0\nG41 D1 G1 X9 F100\no100 call\nG1 X9 F100\nX3\nM2\n"
    )
    contours = find_dialect("linuxcnc").language.contoured()
    block = read_program(text.encode(), "a.ngc", language=contours).motions.block
    assert block.tolist() == [5, 6]


@pytest.mark.parametrize("word", ["G84.2", "G77", "G184", "G-810", "G1.05"])
def test_a_g_word_that_nobody_knows_may_be_a_cycle_that_lasts(word):
    program = read(f"G1 X5 Y5 Z5\n{word} X10 Y10\nX20 Y20 Z1\nX30\nG1 X40 Y5\nX50\n")
    np.testing.assert_array_equal(program.motions.end[2:] * 1e3, [[40, 5, np.nan], [50, 5, np.nan]])
    assert np.isnan(program.motions.start[2]).all()


def test_a_motion_beside_a_g_word_that_nobody_knows_lasts():
    program = read("G1 X5 Y5 Z5\nG187 G0 P2\nX20 Y20 Z1\n")
    assert (program.modal_after(3).motion, ends(program)[-1]) == ("G0", [20, 20, 1])


def test_the_work_offset_behind_a_g_word_that_nobody_knows_may_be_any():
    """So the next G54 moves the frame, and behind it only what is told again is known."""
    program = read("G54\nG0 X5 Y5 Z5\nG154 P1\nG0 X20 Y20 Z1\nG54\nG1 X30\nX40 Y2\n")
    assert [block for kind, block, _ in kinds(program) if kind == "frame"] == [2, 6]
    np.testing.assert_array_equal(program.motions.start[-2:] * 1e3, [[np.nan] * 3, [30, np.nan, np.nan]])


@pytest.mark.parametrize("call", ["M98 P#1", "X5 ,R2 M98 P3", "#1=5 M98 P3"])
def test_a_call_may_leave_any_mode_whatever_else_stands_on_its_line(call):
    program = read(f"G1 X1\n{call}\nX20 Y20 Z1\nX5\n")
    assert len(ends(program)) == 1


def test_the_axes_of_a_mirror_s_end_are_no_places():
    program = read("G1 X1\nG51.1 X0\nX20\nG50.1 X0\nX30 Y5\n")
    assert ends(program)[-1][:2] == [30, 5]
    assert np.isnan(program.motions.start[-1]).all()
