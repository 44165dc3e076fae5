"""How far two tool paths are apart: against what plane geometry says."""

import math

import numpy as np
import pytest
from msgspec.structs import replace
from support.outlines import MM, Tool

from ph_post.diff.curves import curve_table
from ph_post.diff.paths import compare_paths, refine_deviations
from ph_post.gcode.program import LINE, NURBS, feed_runs
from ph_post.gcode.read import read_program

SQUARE = ((10, 0), (10, 10), (0, 10), (0, 0))


def apart(a, b):
    """Largest distance of either path from the other [mm]."""
    travel = compare_paths(curve_table(a.motions()), curve_table(b.motions()))
    found = []
    for number, side in enumerate(travel.sides):
        rows = np.array([int(np.argmax(side.deviation))] if side.deviation.size else [], dtype=np.int64)
        deviation, _ = refine_deviations(travel, number, rows)
        found.append(float(deviation.max(initial=0.0)) / MM)
    return tuple(found)


def square(corners=SQUARE):
    tool = Tool()
    for x, y in corners:
        tool.line(x, y)
    return tool


def test_equal_paths_have_no_gap():
    travel = compare_paths(curve_table(square().motions()), curve_table(square().motions()))
    assert travel.gaps.size == 0
    assert travel.found.tolist() == [0, 1, 2, 3]


def test_a_line_that_is_cut_in_three_is_the_same_path():
    cut = square(((3, 0), (7.5, 0), (10, 0), *SQUARE[1:]))
    assert apart(square(), cut) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_a_corner_that_moved_is_off_by_its_distance_from_the_old_path():
    a, b = apart(square(), square(((10, 0), (10, 10.3), (0, 10), (0, 0))))
    assert b == pytest.approx(0.3, abs=1e-9)
    # The new path runs through the old corner, but not through what comes next to it.
    assert 0.29 < a < 0.3


def test_a_detour_is_compared_with_where_it_left():
    away = square(((10, 0), (10, 4), (10, 3), (10, 4), (10, 10), (0, 10), (0, 0)))
    # It runs back along the path by 1 mm. A walk along both keeps within half of that at best, and where a
    # point belongs is slack by 0.4 of its distance.
    assert 0.29 < max(apart(square(), away)) < 1.0


def test_a_detour_to_another_part_of_the_path_is_not_hidden_by_its_nearness():
    # From (10, 5) straight across to (0, 5), which lies on the path, and back.
    lost = square(((10, 0), (10, 5), (0, 5), (10, 5), (10, 10), (0, 10), (0, 0)))
    assert max(apart(square(), lost)) == pytest.approx(10.0, abs=0.5)


def test_a_missing_side_is_found():
    assert max(apart(square(), square(((10, 0), (0, 10), (0, 0))))) == pytest.approx(math.sqrt(50), rel=1e-6)


def test_another_order_is_another_path():
    assert max(apart(square(), square(SQUARE[2::-1] + SQUARE[3:]))) > 5.0


def test_chords_are_off_by_their_height():
    circle, chords, n = Tool((20, 0, 0)), Tool((20, 0, 0)), 72
    circle.arc(20, 0, -20, 0, 360)
    for k in range(1, n + 1):
        chords.line(20 * math.cos(math.tau * k / n), 20 * math.sin(math.tau * k / n))
    assert apart(circle, chords) == pytest.approx((20 * (1 - math.cos(math.pi / n)),) * 2, rel=1e-4)


def test_a_shifted_arc_is_off_by_the_shift_across_it():
    a = Tool((20, 0, 0)).arc(0, 20, -20, 0, 90)
    b = Tool((20, 0, 0)).line(20.025, 0).arc(0.025, 20, -20, 0, 90)
    assert apart(a, b)[0] == pytest.approx(0.025, abs=1e-5)
    assert apart(a, b)[1] == pytest.approx(0.025, abs=1e-5)


def test_an_arc_cut_at_its_quadrants_is_the_same_arc():
    a = Tool((20, 0, 0)).arc(0, -20, -20, 0, 270)
    b = Tool((20, 0, 0)).arc(0, 20, -20, 0, 90).arc(-20, 0, 0, -20, 90).arc(0, -20, 20, 0, 90)
    assert apart(a, b) == pytest.approx((0.0, 0.0), abs=1e-9)


def test_a_cubic_is_measured_as_a_curve():
    """A straight cubic with its middle 1 mm aside: 3/4 of what its two inner points are off."""
    a = Tool().line(30, 0)
    b = Tool().cubic((10, 4), (20, 4), (30, 0))
    assert apart(a, b) == pytest.approx((3.0, 3.0), abs=1e-3)
    assert curve_table(b.motions()).length == pytest.approx(1e-3 * _cubic_length(), rel=1e-9)


@pytest.mark.parametrize(
    "text", ["G5 X5 Y5 I1 J1 P1 Q1", "G5.2 P1 L3\nX1 Y1 P1\nX2 Y0 P1\nX3 Y1 P1\nG5.3"], ids=["cubic", "nurbs"]
)
def test_a_spline_may_lie_at_an_unknown_height(text):
    read = read_program(f"G21 G90\nG0 X0 Y0\nF100\n{text}\nM2\n".encode(), "part.ngc")
    outline = curve_table(read.motions)
    assert np.isfinite(outline.table).all()
    assert outline.length > 3e-3


def _cubic_length():
    u = np.linspace(0.0, 1.0, 200_001)
    return float(np.hypot(np.diff(30.0 * u), np.diff(12.0 * u * (1.0 - u))).sum())


def test_a_nurbs_of_the_second_order_is_its_polygon():
    polygon = square()
    motions = Tool().line(0, 0).motions()
    points = np.array([(0, 0, 0), *((x, y, 0) for x, y in SQUARE)]) * MM
    nurbs = replace(motions, kind=np.array([NURBS]), nurbs={0: (2, points, np.ones(5))})
    travel = compare_paths(curve_table(polygon.motions()), curve_table(nurbs))
    assert max(side.deviation.max() for side in travel.sides) < 1e-12
    assert curve_table(nurbs).length == pytest.approx(0.04)


def test_heights_count():
    a, b = Tool().line(10, 0, 0), Tool().line(10, 0, 0.5)
    assert apart(a, b)[1] == pytest.approx(0.5, abs=1e-9)


def test_an_unknown_height_is_the_first_that_is_told():
    motions = Tool().line(10, 0, 0).line(20, 0, -1).motions()
    start, end = motions.start.copy(), motions.end.copy()
    start[:, 2], end[0, 2] = np.nan, np.nan
    outline = curve_table(replace(motions, start=start, end=end))
    assert outline.table[:, 2].tolist() == [-MM, -MM]
    assert outline.length == pytest.approx(20 * MM)


def test_a_path_of_another_sampling_is_measured_all_along():
    """A hundred turns of a spiral: sampled coarsely, it is off by at most the height of a chord."""
    fine, coarse = Tool((1, 0, 0)), Tool((1, 0, 0))
    for tool, steps in ((fine, 360), (coarse, 36)):
        for k in range(1, 20 * steps + 1):
            turn = math.tau * k / steps
            radius = 1 + turn / math.tau
            tool.line(radius * math.cos(turn), radius * math.sin(turn))
    worst = 21 * (1 - math.cos(math.pi / 36))
    assert max(apart(fine, coarse)) == pytest.approx(worst, rel=0.05)


def test_nothing_cannot_be_compared():
    empty = replace(Tool().line(1, 0).motions(), **_rows_of_nothing())
    travel = compare_paths(curve_table(empty), curve_table(square().motions()))
    assert travel.sides is None
    assert travel.gaps.tolist() == [[0, 0, 0, 4]]


def _rows_of_nothing():
    motions = Tool().line(1, 0).motions()
    names = ("block", "kind", "chain", "start", "end", "plane", "center", "angle", "duration")
    return {"feeds": feed_runs(motions.feed[:0]), **{name: getattr(motions, name)[:0] for name in names}}


def test_kinds_of_motions_are_told_apart_from_what_they_cut():
    a, b = square().motions(), square().motions()
    assert (a.kind == LINE).all()
    b = replace(b, feeds=feed_runs(2.0 * b.feed))
    assert compare_paths(curve_table(a), curve_table(b)).gaps.size == 0


def test_a_program_that_repeats_itself_is_not_led_astray_by_one_equal_move():
    """Three equal passes, every line of the second program shifted but for one of the third pass."""
    a, b = Tool(), Tool()
    for number in range(3):
        for x, y in SQUARE:
            a.line(x, y)
            own = number == 2 and y == 10
            b.line(x + (0.0 if own else 0.025), y)
    for one, other in ((a, b), (b, a)):
        assert max(apart(one, other)) < 0.03


def test_motions_without_a_length_tell_no_place():
    a = Tool().line(10, 0).line(10, 0).line(20, 0)
    b = Tool().line(10, 0).line(20, 0).line(20, 0)
    assert apart(a, b) == pytest.approx((0.0, 0.0), abs=1e-12)
