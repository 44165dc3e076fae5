"""Fanuc programs read: what their own words mean, and what of them is named."""

from __future__ import annotations

from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from support.editing import compensate

from ph_post.dialects.fanuc.reader import read_fanuc
from ph_post.dialects.reading import read_as
from ph_post.drive.machinefile import read_machine
from ph_post.edit.undo import undo
from ph_post.gcode.program import ARC, LINE, NURBS, RAPID
from ph_post.units import MM, MM_PER_MIN

HEAD = "%\nO1234 (PART)\nG21\nG17 G90 G94 G40 G49 G80\nG54\nG0 X0. Y0. Z0.\nG1 X10. Y10. F500.\n"
LINES = HEAD.count("\n")
TAIL = "M30\n%\n"
INCREMENTS = "lengths without a decimal point count 1e-3 mm or 1e-4 inch (fanuc+calculator: 1)"


def read(body: str, **more: bool):
    return read_fanuc((HEAD + body + TAIL).encode(), "a.nc", **more)


def ends(program) -> list[list[float]]:
    """Ends of the motions behind the head [mm]."""
    return (program.motions.end[2:] / MM).round(9).tolist()


@pytest.mark.parametrize(
    "body",
    [
        "G05.1 Q1\nG1 X20. Y10.\nG05.1 Q0\n",
        "G5.1Q1R5\nX20.\n",
        "G05 P10000\nG1 X20.\nG05 P0\n",
        "G08 P1\nG1 X20.\nG08 P0\n",
        "G22 X1. Y1. Z1. I0. J0. K0.\nG1 X20.\n",
        "<POCKET>\nG1 X20.\n",
        ":77\nG1 X20.\n",
        "n10 g1 x20. (fast)\n",
        "G1 X20.;\n",
        "G4 P500\nG1 X20.\n",
        "M6 T2\nG0 X20. Y10. Z0.\n",
        "X20\n".replace("20", "20."),
    ],
)
def test_words_that_move_nothing_are_seen_through(body: str) -> None:
    program = read(body)
    assert program.notes == ()
    assert ends(program)[-1] == [20.0, 10.0, 0.0]
    assert program.data.decode() == HEAD + body + TAIL


@pytest.mark.parametrize(
    ("body", "told"),
    [
        ("G1 X20000 Y10.\n", (1, 4, f"{INCREMENTS}: X20000")),
        ("G1 X-\t2000 Y10.\n", (1, 4, f"{INCREMENTS}: X- 2000")),
        ("G1 X20. Y-5\nX30000\nX-40\n", (1, 9, f"{INCREMENTS}: Y-5")),
        ("G3 X10. Y10. I5000 J0.\n", (1, 14, f"{INCREMENTS}: I5000")),
        ("G92 X1000\n", (1, 5, f"{INCREMENTS}: X1000")),
        ("G4 X2\n", (1, 4, "dwell without a decimal point: X2")),
        ("G2 X20. Y10. I5. J0. P2\n", (1, 22, "word that no other on the line uses: P2")),
        ("#101=20.\n", (1, 1, "parameter: #101=20.")),
        ("G1 X#101\n", (1, 4, "value that is computed: X#101")),
        ("G1 X[10.+5.]\n", (1, 4, "value that is computed: X[10.+5.]")),
        ("G65 P9010 A1.\n", (1, 1, "call of a macro or subprogram: G65 P9010 A1.")),
        ("M98 P1000\n", (1, 1, "subprogram: M98")),
        ("M198 P1000\n", (1, 1, "call of a macro or subprogram: M198 P1000")),
        ("IF [#1 GT 5] THEN #2=1\n", (1, 1, "macro statement: IF [#1 GT 5] THEN #2=1")),
        ("WHILE [#1 LT 5] DO1\nG1 X5.\nEND1\n", (1, 1, "loop of a macro")),
        ("G1 X20. ,R3.\n", (1, 1, "word of one controller, or of more digits than are kept: G1 X20. ,R3.")),
        ("G28 U0. V0. W0.\nG1 U5.\n", (2, 4, "axis other than X, Y and Z: U5.")),
        ("G54.1 P3\n", (1, 1, "unknown G word: G54.1")),
        ("G68.2 X0. Y0. Z0. I0. J45. K0.\n", (1, 1, "tilted plane: G68.2")),
        ("G12.1\n", (1, 1, "polar interpolation: G12.1")),
        ("G7.1 C50.\n", (1, 1, "cylindrical interpolation: G7.1")),
        ("G02.2 X0. Y0. I1. J1. R2.\n", (1, 1, "involute: G02.2")),
        ("G41 D1 X20.\n", (1, 1, "cutter compensation: G41")),
        ("G81 X20. Z-5. R2. F100.\n", (1, 1, "canned cycle: G81")),
    ],
)
def test_what_is_not_understood_is_named_at_its_place(body: str, told: tuple[int, int, str]) -> None:
    note = next(iter(read(body).notes))
    assert (note.first - LINES + 1, note.column, note.what) == told


@pytest.mark.parametrize(
    "body", ["G28 U0.\n", "#101=20.\n", "G65 P9010\n", "G12.1\n", "G68.2 I0. J45. K0.\n", "G2 X20. Y10. I5. J0. P2\n"]
)
def test_nothing_is_known_of_the_position_behind_what_is_not_understood(body: str) -> None:
    program = read(body + "G21 G17 G90 G94 G1 Y30. F100.\n")
    behind = program.motions.start[program.motions.block >= LINES + 1]
    assert np.isnan(behind[:, 0]).all()


@pytest.mark.parametrize(
    ("dialect", "units", "step"), [("fanuc", "G21", 1e-3), ("fanuc+isc", "G21", 1e-4), ("fanuc", "G20", 25.4e-4)]
)
def test_numbers_without_a_point_count_in_the_increments_of_the_control(dialect, units, step) -> None:
    body = f"{units}\nG0 X0 Y0\nG1 X20000 Y5. F100.\nG91 X-5000\nG90 G2 X15000 I0 J2500\n"
    program = read_as(dialect, (HEAD + body + TAIL).encode(), "a.nc")
    counts = "1e-4 mm or 1e-5 inch" if "isc" in dialect else "1e-3 mm or 1e-4 inch"
    said = [note.what.partition(" (")[0] for note in program.notes]
    assert said == [f"lengths without a decimal point count {counts}"]
    point = 25.4 if units == "G20" else 1.0
    expected = [[0, 0], [20000 * step, 5 * point], [15000 * step, 5 * point], [15000 * step, 5 * point]]
    np.testing.assert_allclose(program.motions.end[-4:, :2] * 1e3, expected, rtol=1e-12)
    np.testing.assert_allclose(program.motions.center[-1] * 1e3, [15000 * step, 5 * point + 2500 * step], rtol=1e-12)


def test_the_last_of_two_measures_holds_beside_a_reference() -> None:
    program = read("G91 G28 Z0. G90\nG0 X5. Y6.\nG1 X7. F100.\n")
    assert program.notes == ()
    assert (program.motions.end[-2:, :2] / MM).round(9).tolist() == [[5.0, 6.0], [7.0, 6.0]]


SMALL = "G1 X25 Y-27.5\nX12.5\nX-3 Y2.\nX30. Y10.\nX12.\nX30.\n"


def test_nobody_knows_whether_small_numbers_without_a_point_are_millimetres() -> None:
    """As people write them who mean mm: on a control that counts in increments they would be nothing."""
    program = read(SMALL)
    assert [(note.first - LINES + 1, note.what.partition(" (")[0]) for note in program.notes] == [
        (1, "lengths without a decimal point are mm or 0.001 mm, as the control is set: none of them is changed")
    ]
    ends = (program.motions.end[2:, 0] / MM).round(9)
    assert ends[-4:].tolist() == [12.5, 30.0, 12.0, 30.0]
    assert not np.isin(ends, [25.0, 0.025, -3.0, -0.003]).any()


@pytest.mark.parametrize("lost", [0.05, 0.2])
def test_no_line_with_such_a_number_is_changed_whatever_it_means(lost: float) -> None:
    machine = read_machine("stepper")
    axes = {name: replace(axis, gap=axis.gap.with_lost_motion(lost * MM)) for name, axis in machine.axes.items()}
    data = (HEAD + SMALL + TAIL).encode()
    made = compensate(data, replace(machine, axes=axes, dialect="fanuc"), dialect="fanuc")
    kept = [line for line in made.text.splitlines() if line in (b"G1 X25 Y-27.5", b"X-3 Y2.")]
    assert len(kept) == 2
    assert len(made.text.splitlines()) > len(data.splitlines()) + 10
    assert undo(made.text, "a.nc") == data


def test_a_compensated_program_is_read_as_its_original_was() -> None:
    """The line with the large number is another there, and small ones alone are left."""
    body = "G1 X20000 Y10.\nY-5\nX19000 Y-6.\nX20000\nY15.\nX12.5\n"
    machine = replace(read_machine("stepper"), dialect="fanuc")
    made = compensate((HEAD + body + TAIL).encode(), machine, dialect="fanuc")
    found = read_as("fanuc", made.text, "b.nc")
    assert not np.isnan(found.motions.end[2:, :2]).any()
    small = HEAD + "G1 X500\n" + TAIL
    note = next(line for line in made.text.decode().splitlines() if "DECIMAL POINT COUNT" in line)
    ends = [read_as("fanuc", text.encode(), "b.nc").motions.end[-1, 0] for text in (small, f"{note}\n{small}")]
    np.testing.assert_array_equal(ends, [0.01, 0.0005])


def test_numbers_without_a_point_are_millimetres_where_the_dialect_says_so() -> None:
    program = read_as("fanuc+calculator", (HEAD + "G1 X20 Y5\n" + TAIL).encode(), "a.nc")
    assert program.notes == ()
    assert ends(program) == [[20.0, 5.0, 0.0]]


def test_a_zero_needs_no_point() -> None:
    assert ends(read("G1 X0 Y0\n")) == [[0.0, 0.0, 0.0]]


def test_dwells_are_seconds_whatever_their_letter() -> None:
    program = read("G4 P1500\nG4 X1.5\nG04 U.25\nG4 X3\n")
    words = program.words
    rows = (words.letter == ord("P")) & (words.block >= LINES)
    assert words.value[rows][:3].tolist() == [1.5, 1.5, 0.25]
    assert np.isnan(words.value[rows][3])


def test_a_jump_back_makes_a_loop_of_what_lies_between() -> None:
    program = read("N20 G1 X20.\nG1 X30.\nIF [#1 LT 3] GOTO 20\nG21 G90 G94 G17\nG0 X0. Y0. Z0.\nG1 X1.\n")
    assert [(note.first - LINES, note.last - LINES, note.what) for note in program.notes] == [(0, 2, "jump of a macro")]
    assert program.motions.block[2:].tolist() == [LINES + 4, LINES + 5]


def test_an_end_that_leads_back_makes_a_loop() -> None:
    again = read("N20 G1 X20.\nG1 X30.\nM99 P20\n")
    assert (LINES, LINES + 2, "jump of a macro") in {(note.first, note.last, note.what) for note in again.notes}
    assert again.motions.block.max() < LINES
    # The line of a caller is not there, and what the subprogram cuts is the same for all of them.
    assert read("N20 G1 X20.\nG1 X30.\nM99 P900\n").motions.block.max() >= LINES


@pytest.mark.parametrize("target", ["90", "#100"])
def test_a_jump_nobody_knows_where_to_leaves_every_line_as_it_is(target: str) -> None:
    program = read(f"G1 X20.\nIF [#1 LT 3] GOTO {target}\nG1 X0.\n")
    reason = f"jump in line {LINES + 2} to a line that is not known: IF [#1 LT 3] GOTO {target}"
    assert {note.what for note in program.notes} == {reason}
    assert program.motions.block.size == 0


def test_the_motion_mode_behind_an_unknown_curve_is_not_the_one_before_it() -> None:
    program = read("G2.2 X0. Y0. I1. J1. R2.\nX30. Y30.\nG1 X40. Y40.\n")
    assert program.motions.block[2:].tolist() == [LINES + 2]


def spline(points: list[str], knots: list[str], order: int = 4, feed: str = "250.") -> str:
    """Blocks of a G06.2; a point is `X.. Y.. R..`."""
    lines = [f"K{knot} {point}" for knot, point in zip(knots, points, strict=False)]
    lines[0] = f"G06.2 P{order} {lines[0]} F{feed}"
    return "\n".join([*lines, *(f"K{knot}" for knot in knots[len(points) :]), ""])


def de_boor(points: list[list[Fraction]], knots: list[Fraction], order: int, t: Fraction) -> list[Fraction]:
    """Point of a NURBS in exact numbers; points are (x, y, weight)."""
    degree = order - 1
    span = max(k for k in range(degree, len(points)) if knots[k] <= t and knots[k] < knots[k + 1])
    rows = [[x * w, y * w, w] for x, y, w in points[span - degree : span + 1]]
    for r in range(1, degree + 1):
        for j in range(degree, r - 1, -1):
            low, high = knots[span - degree + j], knots[span + 1 + j - r]
            share = (t - low) / (high - low)
            rows[j] = [(1 - share) * a + share * b for a, b in zip(rows[j - 1], rows[j], strict=True)]
    x, y, w = rows[degree]
    return [x / w, y / w]


@pytest.mark.parametrize("order", [3, 4])
def test_a_nurbs_is_the_curve_of_its_points_knots_and_weights(order: int) -> None:
    points = [
        ("10.", "10.", "1."),
        ("11.", "12.", "2."),
        ("13.", "-2.", "1."),
        ("15.", "1.", "1.5"),
        ("16.", "0.", "0.75"),
        ("20.", "3.", "1."),
    ]
    inner = {3: ["0.5", "1.25", "1.25"], 4: ["0.5", "1.25"]}[order]
    knots = ["0."] * order + inner + ["2."] * order
    texts = [f"X{x} Y{y} R{w}" for x, y, w in points]
    program = read(spline(texts, knots, order) + "G1 X30. Y3.\n")
    motions = program.motions
    rows = np.flatnonzero(motions.kind == NURBS)
    assert program.notes == ()
    assert (motions.feed[rows] / MM_PER_MIN).tolist() == pytest.approx([250.0] * rows.size)
    exact = [[Fraction(number) for number in point] for point in points]
    numbers = [Fraction(knot) for knot in knots]
    spans = [(a, b) for a, b in pairwise(numbers) if a < b]
    assert rows.size == len(spans)
    for row, (low, high) in zip(rows.tolist(), spans, strict=True):
        size, control, weights = motions.nurbs[row]
        assert size == order
        for share in (Fraction(0), Fraction(1, 7), Fraction(2, 3), Fraction(999, 1000)):
            expected = de_boor(exact, numbers, order, low + share * (high - low))
            n, u = order - 1, float(share)
            basis = (
                np.array(
                    [np.prod([(n - i) / (i + 1) for i in range(k)]) * u**k * (1 - u) ** (n - k) for k in range(order)]
                )
                * weights
            )
            found = basis @ control[:, :2] / basis.sum() / MM
            assert np.allclose(found, [float(value) for value in expected], rtol=0.0, atol=1e-11)
    assert np.array_equal(motions.end[rows[:-1]], motions.start[rows[1:]])
    assert motions.kind[-1] == LINE
    assert np.allclose(motions.start[-1, :2] / MM, [20.0, 3.0], rtol=0.0, atol=1e-9)


@pytest.mark.parametrize(
    ("body", "told"),
    [
        (spline(["X10. Y10.", "X11. Y12.", "X13. Y2."], ["0."] * 4 + ["1."] * 4), "NURBS that is not whole"),
        (
            spline(["X10. Y10.", "X11. Y12.", "X13. Y2.", "X14. Y1."], ["0."] * 3 + ["1."] * 5),
            "NURBS whose knots fall, or do not stand as often as its order at both ends",
        ),
        (
            spline(["X10. Y10.", "X11. Y12.", "X13. Y2.", "X14. Y1."], ["0."] * 4 + ["1"] * 4),
            "number without a decimal point in a NURBS: 1",
        ),
        (
            spline(["X10. Y10.", "X11. Y12. R0.", "X13. Y2.", "X14. Y1."], ["0."] * 4 + ["1."] * 4),
            "NURBS with a weight that is not positive",
        ),
        (
            spline(["X10. Y10.", "X11. Y12."], ["0."] * 5 + ["1."] * 5, 5),
            "NURBS of an order that is none: P5",
        ),
        (
            "G91\n" + spline(["X0. Y0.", "X1. Y2.", "X3. Y2.", "X4. Y1."], ["0."] * 4 + ["1."] * 4),
            "NURBS in incremental positions: G06.2 under G91",
        ),
    ],
)
def test_a_nurbs_that_the_control_would_refuse_is_named(body: str, told: str) -> None:
    program = read(body + "G1 X30. Y3.\n")
    assert [note.what for note in program.notes] == [told]
    assert not (program.motions.kind == NURBS).any()
    assert np.isnan(program.motions.feed[-1]), "its F stays in force, and was not read"


def test_a_move_without_knots_in_nurbs_mode_is_not_taken_for_a_straight_one() -> None:
    body = spline(["X10. Y10.", "X11. Y12.", "X13. Y2.", "X14. Y1."], ["0."] * 4 + ["1."] * 4)
    program = read(body + "X30. Y3.\nG1 X40. Y3.\n")
    assert program.notes[0].what == "NURBS that is not whole"
    assert program.motions.block[2:].tolist() == [LINES + 9]


PART = (
    b"%\nO1234 (SLOT)\nG21\nG17 G90 G94 G40 G49 G80\nG54\nG05.1 Q1\nG0 Z5.\nG0 X20. Y0\nG1 Z0 F300\n"
    b"G3 X20. Y0. I-20. J0. F1200\nG1 X25. Y0\nG4 P500\nG2 X-25. Y0. R25.\nG1 X0. Y0.\nG05.1 Q0\n"
    b"G0 Z5.\nM30\n%\n"
)


@pytest.mark.slow
@pytest.mark.parametrize("part", [PART, PART.replace(b"G0 Z5.\nM30", b"M30")], ids=["retracted", "ends in the cut"])
@pytest.mark.thinned(4)
def test_splicing_writes_points_milliseconds_and_capitals_and_can_be_undone(part: bytes) -> None:
    found = compensate(part, read_machine("stepper"), dialect="fanuc").text
    assert undo(found, "a.nc") == part
    original = set(part.splitlines())
    added = [line.decode() for line in found.splitlines() if line not in original]
    # Axes rest for 10 ms where they are brought back behind the last cut; on the fly nothing rests.
    assert any(line.startswith("G4 P10") for line in added) == (b"G0 Z5.\nM30" not in part)
    for line in added:
        assert line == line.upper()
        bare = line.split("(")[0]
        for word in bare.split():
            assert word[0] not in "XYZIJKR" or "." in word or word[1:] == "0", line
    program = read_as("fanuc", found, "a.nc")
    assert program.notes == ()
    assert (program.motions.kind == ARC).sum() >= 3


def test_a_jump_to_a_number_of_5000_digits_is_named() -> None:
    (note,) = read_as("fanuc", b"O1\nG21 G1 X1. F100.\nGOTO" + 5000 * b"1" + b"\nM30\n", "a.nc").notes
    assert "jump in line 3 to a line that is not known" in note.what


CONTOUR = "G1 X10. Y0.\nX20. Y10.\nX10. Y20.\nX0. Y10.\nX10. Y0.\n"


@pytest.mark.parametrize("measure", ["", "G90 ", "G91 "])
def test_a_subprogram_that_leaves_g90_and_g91_to_its_caller_moves_nobody_knows_where(measure: str) -> None:
    """M98 keeps modes: the same lines are places for one caller and increments for another."""
    program = read_fanuc(f"O5001\nF500.\n{measure}{CONTOUR}M99\n".encode(), "a.nc")
    told = [note.what for note in program.notes if "G90 or G91" in note.what]
    assert bool(told) == (measure == "")
    assert np.isnan(program.motions.end).all() == (measure == "")


def test_a_main_program_without_g90_begins_as_the_control_does() -> None:
    program = read_fanuc(f"O1\nF500.\n{CONTOUR}M30\nO5001\n{CONTOUR}M99\n".encode(), "a.nc")
    assert (program.motions.end[:, :2] / MM).round(9).tolist() == [[10, 0], [20, 10], [10, 20], [0, 10], [10, 0]]


def test_a_subprogram_is_compensated_from_where_it_says_g90_on() -> None:
    """Its first lines, whose places nobody knows, stay as they are."""
    text = f"O5001\n{CONTOUR}G90\nG1 X0. Y0. F500.\n{CONTOUR}M99\n"
    changed = compensate(text.encode(), read_machine("stepper"), dialect="fanuc").text.decode()
    assert CONTOUR + "G90" in changed
    assert "CROSSING" in changed.partition("G90")[2]


def test_a_division_is_no_block_delete() -> None:
    """It sets a variable and moves nothing; one by zero is named as that."""
    program = read("#1=#2/4\n#3 = [ 1 / 0 ]\nG1 X20.\n")
    assert [note.what for note in program.notes] == ["parameter: #1=#2/4", "division by zero: #3 = [ 1 / 0 ]"]
    assert ends(program) == [[20.0, 10.0, 0.0]]


def test_the_units_outlast_a_call_but_no_other_mode() -> None:
    """B-64484EN: G20 and G21 must not be switched in a program. Nobody knows whether F is one a minute or a turn."""
    program = read("M98 P7\nX1.\nG90 G17 G1 X2. Y3. F5.\nX4.\n")
    assert [note.what.partition(":")[0] for note in program.notes] == [
        "subprogram",
        "motion under modes that something not understood may have changed",
    ]
    assert ends(program)[-1][:2] == [4.0, 3.0]
    assert np.isnan(program.motions.feed[2:]).all()


def test_units_that_no_line_has_said_are_not_known_behind_a_call() -> None:
    program = read_fanuc(b"O1\nM98 P7\nG90 G17 G1 X2. Y3. F5.\nM30\n", "a.nc")
    assert program.motions.kind.size == 0


def test_f_may_be_an_inverse_time_behind_a_call_where_the_program_has_such() -> None:
    program = read("M98 P7\nG90 G17 G1 X2. Y3. F5.\nG93\n")
    assert "something not understood" in program.notes[1].what


def test_g80_leads_back_to_the_straight_motion_before_the_cycle() -> None:
    """Cycles are group 09 (B-64484EN-2, "G code list")."""
    program = read("G0 Z5.\nG98 G81 X20. Z-5. R2. F100.\nX3.\nG80\nZ9.\nG1 X1. Y2.\nG82 X3. Z-1. R2. P9\nG80\nX5.\n")
    assert [note.what.partition(":")[0] for note in program.notes] == ["canned cycle", "canned cycle"]
    assert program.motions.kind.tolist()[3:] == [RAPID, LINE, LINE]
    lost = read("G98 G81 X20. Z-5. R2. F100.\nM98 P1\nG80\nG90 Z9.\n")
    assert "something not understood" in lost.notes[-1].what
    switched = read("G0 Z5.\nG98 G81 X20. Z-5. R2. F100.\n/G80\nX9.\n")
    assert "something not understood" in switched.notes[-1].what


def test_the_second_of_two_tools_is_the_one_that_comes_next() -> None:
    """Mazak's EIA programs name both; the first one is in the spindle then, and the modes are what they were."""
    program = read("G90 G0 X1. Y1.\nT01T02M06(DRILL)\nG1 X2. Y2. F100.\nX3.\n")
    assert not program.notes
    assert "not understood" not in [one.kind for one in program.breaks]
    assert (program.modal[-1].tool, ends(program)[-1][:2]) == (1.0, [3.0, 2.0])


def test_a_lathe_s_threads_end_in_a_chamfer_or_not_without_a_move() -> None:
    body = "G50 S1000\nG96 S100\nG0 X20. Z1.\nM23\nG1 Z-5. F0.1\nM24\nX24.\n"
    assert "not understood" not in [one.kind for one in read(body, lathe=True).breaks]
    mill = read("G90 G0 X20. Z1.\nM23\nG1 Y5. F100.\n")
    assert "not understood" in [one.kind for one in mill.breaks]


def test_a_turret_turns_once_where_m6_stands_beside_its_t() -> None:
    program = read("T0707 M06\nG0 X20. Z1.\nG1 Z-5. F0.1\n", lathe=True)
    assert [one.kind for one in program.breaks] == ["beginning", "frame", "tool change", "end"]
    assert not [note for note in program.notes if "two words" in note.what]


def test_the_end_of_polar_coordinates_is_no_axis_word_s() -> None:
    """G15 stands beside G52, whose words they are; beside a move X is a place as before."""
    program = read("G15 G52 X0. Y0.\nG0 X20. Y1.\n")
    assert not [note for note in program.notes if "G15" in note.what]


@pytest.mark.parametrize(
    ("line", "known"),
    [
        ("G92.1 X0 Y0 Z0", [None, None, None]),
        ("G92.1 X0", [None, 10.0, 0.0]),
        ("G50.3 P0", [None, None, None]),
        ("G10 L20 P2 X500.", [None, 10.0, 0.0]),
        ("G10 L20 P48 X500. Z1.", [None, 10.0, None]),
    ],
)
def test_another_zero_moves_nothing_and_forgets_the_axes_that_it_names(line: str, known: list[float | None]) -> None:
    program = read(f"{line}\nG0 X20. Y20. Z20.\n")
    assert program.notes == ()
    assert program.motions.block[2:].tolist() == [LINES + 1]
    np.testing.assert_array_equal(program.motions.start[2] / MM, [np.nan if one is None else one for one in known])
    assert [(one.kind, one.block) for one in program.breaks][-2] == ("frame", LINES)


@pytest.mark.parametrize(
    ("begin", "end", "name"),
    [
        ("G101 X0.", "G100 X0.", "mirror image: G101"),
        ("G107 C50.", "G107 C0", "cylindrical interpolation: G107"),
        ("G234 H1", "G49", "tool centre point control: G234"),
        ("G254", "G255", "dynamic work offset: G254"),
        ("G268 X0. Y0. Z0. B90.", "G269", "tilted plane: G268"),
    ],
)
def test_what_moves_in_another_frame_is_passed_through_up_to_its_end(begin: str, end: str, name: str) -> None:
    program = read(f"{begin}\nG1 X20. Y5.\nX30.\n{end}\nG0 X1. Y2. Z3.\nX4.\n")
    assert program.motions.block[2:].tolist() == [LINES + 4, LINES + 5]
    assert np.isnan(program.motions.start[2]).all()
    assert name in [note.what for note in program.notes]


def test_polar_interpolation_of_lathes_is_no_word_of_mills() -> None:
    body = "G112\nG1 X60. C0. F100.\nX40.\nG113\nG0 X50. Z5.\nX40.\n"
    assert read(body, lathe=True).motions.block[2:].tolist() == [LINES + 4, LINES + 5]
    assert "unknown G word: G112" in [note.what for note in read(body.replace(" C0.", "")).notes]


def test_on_its_second_spindle_a_lathe_s_z_is_mirrored() -> None:
    body = "G14\nG0 X40. Z2.\nG1 Z-5. F0.1\nG15\nG0 X50. Z5.\nX40.\n"
    assert read(body, lathe=True).motions.block[2:].tolist() == [LINES + 4, LINES + 5]
    assert "secondary spindle: G14" in [note.what for note in read(body, lathe=True).notes]
    assert "unknown G word: G14" in [note.what for note in read(body).notes]


@pytest.mark.parametrize(
    ("line", "cycle"), [("G95 Z-10. F1.", True), ("G95 C30. F1.", True), ("G1 G95 Z-10. F0.1", False), ("G95", False)]
)
def test_beside_a_place_g95_is_a_cycle_of_a_lathe_s_live_tools(line: str, cycle: bool) -> None:
    data = f"G99\nG0 X40. Z2.\n{line}\nX30.\nG0 X50. Z5.\n".encode()
    program = read_fanuc(data, "a.nc", lathe=True)
    assert ("tapping cycle: G95" in [note.what for note in program.notes]) == cycle
    assert ({2, 3} & {*program.motions.block.tolist()} == set()) == cycle


def test_a_frame_lasts_within_another_and_a_mirror_up_to_its_last_axis() -> None:
    program = read("G101 X0\nG101 Y0\nG100 X0\nG1 X5. Y5. Z5.\nG100 Y0\nG0 X1. Y2. Z3.\n")
    assert program.motions.block[2:].tolist() == [LINES + 5]
    program = read("G254\nG68 X0. Y0. R45.\nX5. Y5.\nG69\nG1 X5. Y5. Z5.\nG255\nG0 X1. Y2. Z3.\n")
    assert program.motions.block[2:].tolist() == [LINES + 6]


@pytest.mark.parametrize("word", ["G100", "G255", "G269"])
def test_the_end_of_a_frame_that_has_not_begun_is_another_machine_s_word(word: str) -> None:
    """G100 changes the tool on Brother's machines."""
    program = read(f"{word} X20. Y5.\nX30.\nG0 X1.\n")
    assert program.notes[0].what == f"unknown G word: {word}"
    assert program.motions.block[2:].tolist() == [LINES + 2]


@pytest.mark.parametrize("word", ["G72.1 P2000 L3 X0. Y0. R90.", "G72.2 P2000 L3 I10. J0."])
def test_a_figure_that_is_copied_is_that_of_a_subprogram(word: str) -> None:
    program = read(f"{word}\nG1 X20. Y5.\nX30.\n")
    assert program.notes[0].what == f"call of a macro or subprogram: {word}"
    assert program.motions.block.size == 2


@pytest.mark.parametrize("line", ["G81 X5. Z-5. R2. K3 F100.", "G81 X5. Z-5. R2. F100.\nX7. K2"])
def test_how_often_a_cycle_is_repeated_is_no_length(line: str) -> None:
    told = [note.what for note in read(f"{line}\nG80\nG1 X2000 Y5.\n").notes if INCREMENTS in note.what]
    assert told == [f"{INCREMENTS}: X2000"]
    assert not [note for note in read(f"{line}\nG80\n").notes if INCREMENTS in note.what]


@pytest.mark.parametrize("corner", ["X20. ,R3.", "X20. ,C2.", "X20. , R1. F300. (ROUND)"])
def test_the_move_behind_a_corner_is_passed_through_with_it(corner: str) -> None:
    """The control makes the corner of both, and of what stands between."""
    program = read(f"{corner}\nM8\nG4 X1.\n/Y25.\nY30. (NEXT);\nX1. Y2. Z3.\nX4.\n")
    assert program.motions.block[2:].tolist() == [LINES + 5, LINES + 6]
    assert np.isnan(program.motions.start[2]).all()
    told = [(note.first - LINES, note.last - LINES) for note in program.notes if "behind a rounded" in note.what]
    assert told == [(3, 4)]


@pytest.mark.parametrize(
    ("line", "word"),
    [
        ("Z-2. C1.", "C1."),
        ("G1 X40. C-1. F0.2", "C-1."),
        ("U4. R1.", "R1."),
        ("X40. K2.", "K2."),
        ("W-4. I-2.", "I-2."),
        ("X38. A135.", "A135."),
        ("A135.", "A135."),
    ],
)
def test_a_corner_of_a_lathe_needs_no_comma(line: str, word: str) -> None:
    program = read(f"{line}\nZ-20.\nX60. Z-25.\nX61.\n", lathe=True)
    assert program.motions.block[2:].tolist() == [LINES + 2, LINES + 3]
    assert np.isnan(program.motions.start[2]).all()
    assert f"chamfer, corner or angle of a drawing: {word}" in [note.what for note in program.notes]


@pytest.mark.parametrize("line", ["G0 X40. C90.", "G2 X14. Z-2. R2.", "G3 X14. Z-2. I0. K-2.", "C90."])
def test_no_corner_is_made_beside_a_rapid_or_an_arc_or_by_a_spindle_that_turns(line: str) -> None:
    program = read(f"{line}\nG1 Z-20. F0.2\n", lathe=True)
    assert program.motions.block[-1] == LINES + 1
    assert not [note for note in program.notes if "corner" in note.what]


MILL = "G91\nX-30. ,R3.\nY40.\nX20. ,C2.\nY-20.\nX-40.\nX30.\nX-20.\nG90\nG0 Z50.\n"
TURN = "G50 S2500\nG96 S200\nG0 X20. Z2.\nG1 Z-20. C1. F0.2\nX50.\nZ-15.\nX60. C1.\nZ-30.\nX40.\nZ-50.\nX45.\n"


@pytest.mark.parametrize(
    ("body", "pairs"),
    [
        (MILL, ["X-30. ,R3.\nY40.\n", "X20. ,C2.\nY-20.\n"]),
        (TURN, ["G1 Z-20. C1. F0.2\nX50.\n", "X60. C1.\nZ-30.\n"]),
        ("X50.\nX20.\nG92.1 X0 Y0 Z0\nG0 X10. Y10.\nG1 X50.\nX10.\n", ["\nG92.1 X0 Y0 Z0\n"]),
        (
            "G84.2 X10. Y10. Z-5. R2. F500.\nX30.\nX20. Y30.\nX5. Y5.\nG80\n",
            ["R2. F500.\nX30.\nX20. Y30.\nX5. Y5.\nG80"],
        ),
    ],
    ids=["corners", "corners of a lathe", "zero", "cycle"],
)
def test_nothing_is_changed_or_put_between_where_the_control_needs_the_lines_as_they_are(
    body: str, pairs: list[str]
) -> None:
    data = (HEAD + body + TAIL).encode()
    made = compensate(data, replace(read_machine("stepper"), dialect="fanuc"), dialect="fanuc").text
    assert len(made.splitlines()) > len(data.splitlines()) + 5
    for pair in pairs:
        assert pair.encode() in made
    assert undo(made, "a.nc") == data


SUB = "O2000\nG41 D1 G1 X9. F100.\nX20.\n{}M99\n"
HEAD_AND_CUTS = ("O1\nG21 G17 G90 G40 G94\nG0 X0. Y0. Z5.\n", "G90 G0 X1. Y1.\nG1 X60. F100.\nX5.\n")


@pytest.mark.parametrize(
    ("between", "sub", "known"),
    [
        ("M98 P2000\n", SUB.format("G40 X40.\n"), 3),
        ("M98 P2000\n", SUB.format(""), 0),
        ("M98 P2000\n", SUB.format("/G40 X40.\n"), 0),
        ("M98 P2000\nG40\n", SUB.format(""), 3),
        ("WHILE[#1LT3]DO1\nG41 D1\nEND1\n", "", 0),
        ("IF[#1EQ1]GOTO10\nG41 D1 X5.\nN10\n", "", 0),
    ],
)
def test_behind_a_call_the_cutter_is_beside_a_contour_where_it_may_be(between: str, sub: str, known: int) -> None:
    head, cuts = HEAD_AND_CUTS
    text = f"{head}{between}{cuts}M30\n{sub}"
    first = (head + between).count("\n")
    assert (read_fanuc(text.encode(), "a.nc").motions.block >= first).sum() == known


def test_a_subprogram_begins_on_whichever_side_the_cutter_is() -> None:
    body = "G90 G0 X1. Y1.\nG1 X60. F100.\nX5.\n"
    main = "O1000\nG90 G54\nG41 D1 G1 X0. F100.\nM98 P2000\nG40 X9.\nM30\n"
    assert not read_fanuc(f"O2000\n{body}M99\n{main}".encode(), "a.nc").motions.block.size
    assert read_fanuc(f"O2000\nG40\n{body}M99\n{main}".encode(), "a.nc").motions.block.size == 3
    assert read_fanuc(f"O2000\n{body}M99\n{main.replace('G41', 'G49')}".encode(), "a.nc").motions.block.size >= 3


SAFE = "G90 G21 G17 G94 G40 G49 G69 G80 G54\nG0 X0. Y0.\nG1 X10. F100.\nX20.\n"


@pytest.mark.parametrize(
    ("begins", "ends"),
    [
        ("IF[#1EQ1]GOTO10\nG51.1 X0.\nN10 G0 Z5.\n", "G50.1 X0.\n"),
        ("WHILE[#1LT3]DO1\nG101 X0.\nEND1\n", "G100 X0.\n"),
        ("IF[#1EQ1]GOTO10\nG16\nN10 G0 Z5.\n", "G15\n"),
        ("G268 X0. Y0. Z0. I0. J45. K0.\n", "G269\n"),
        ("G12.1\n", "G13.1\n"),
        ("G07.1 C50.\n", "G07.1 C0\n"),
    ],
)
def test_a_frame_lasts_to_the_word_that_ends_it(begins: str, ends: str) -> None:
    """Neither a loop nor a jump over its begin hides it, nor does the G69 of a safe line end it."""
    for body, known in ((begins + SAFE, 0), (begins + ends + SAFE, 3)):
        first = (HEAD_AND_CUTS[0] + body).count("\n") - 3
        assert (read_fanuc(f"{HEAD_AND_CUTS[0]}{body}M30\n".encode(), "a.nc").motions.block >= first).sum() == known


@pytest.mark.parametrize("word", ["G103 P1", "G187 P1", "G187 P3 E0.05", "G62"])
def test_settings_of_the_look_ahead_leave_the_motion(word: str) -> None:
    assert read(f"G1 X5. F100.\n{word}\nX20.\n").motions.block[-1] == HEAD.count("\n") + 2


def test_the_digits_of_a_sequence_number_have_no_limit() -> None:
    """Python reads no number of 5,000 digits."""
    shape = "N0{0} G0 X10.\nG1 Z-5.\nN2 X20.\n"
    for number in ("1", "9" * 5000):
        program = read_fanuc(
            f"G71 U1. R.5\nG71 P{number} Q2 U.4 W.1 F.2\n{shape.format(number)}".encode(), "a.nc", lathe=True
        )
        assert any(note.what == "shape of a turning cycle" and note.first == 2 for note in program.notes)
