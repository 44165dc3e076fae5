"""Contours of loose curves: what is joined, how far it moves, its direction and order."""

import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support.amount import examples

from ph_post.files.drawing import shapes
from ph_post.files.drawing.chains import SAME, gap_of, in_order, join
from ph_post.files.drawing.convert import extents_of
from ph_post.files.drawing.shapes import Subpath, backwards, transformed

JOIN = 0.01


def run(*parts, layer="0"):
    return Subpath(shapes=parts, layer=layer, name="")


def points_of(shape, count=65):
    from ph_post.files.drawing.convert import _curve

    curve = _curve(shape)
    low, high = curve.domain
    return curve.derivatives(np.linspace(low, high, count))[0] * 1e3


def lines(*corners):
    return [run(shapes.line(a, b)) for a, b in pairwise(corners)]


def gaps(contour):
    pairs = list(pairwise(contour.shapes))
    return [gap_of(a, b) for a, b in [*pairs, *([(contour.shapes[-1], contour.shapes[0])] if contour.closed else [])]]


def test_loose_sides_in_any_order_and_direction_become_one_square_run_as_the_first():
    side = lines((0, 0), (10, 0), (10, 10), (0, 10), (0, 0))
    loose = [side[2], run(backwards(side[0].shapes[0])), side[3], run(backwards(side[1].shapes[0]))]
    (contour,) = join(loose, JOIN, SAME).contours
    assert contour.closed
    corners = [tuple(shape.start[:2]) for shape in contour.shapes]
    assert corners == [(10, 10), (0, 10), (0, 0), (10, 0)]


def test_a_chain_is_found_from_its_middle():
    (contour,) = join([*lines((5, 0), (6, 1)), *lines((6, 1), (8, 0)), *lines((0, 0), (5, 0))], JOIN, SAME).contours
    assert [shape.start[0] for shape in contour.shapes] == [0, 5, 6]


offset = st.tuples(st.floats(-0.004, 0.004), st.floats(-0.004, 0.004))


@settings(max_examples=examples(40), deadline=None)
@given(
    offsets=st.lists(offset, min_size=12, max_size=12),
    kinds=st.lists(st.sampled_from("labn"), min_size=6, max_size=6),
)
def test_gaps_close_and_nothing_moves_by_more_than_the_tolerance(offsets, kinds):
    corners = [(30 * math.cos(a), 20 * math.sin(a)) for a in np.arange(6) * math.tau / 6]
    before = []
    for k, kind in enumerate(kinds):
        a = np.add(corners[k], offsets[2 * k])
        b = np.add(corners[(k + 1) % 6], offsets[2 * k + 1])
        middle = 1.2 * (a + b) / 2
        made = {
            "l": shapes.line(a, b),
            "a": shapes.bulged(a, b, 0.4),
            "b": shapes.bezier([a, middle, b]),
            "n": shapes.nurbs([0, 0, 0, 1, 1, 1], [a, middle, b], [1, 0.7, 1]),
        }
        before.append(made[kind])
    joining = join([run(shape) for shape in before], 0.0125, SAME)
    (contour,) = joining.contours
    assert contour.closed
    assert max(gaps(contour)) <= SAME
    assert joining.moved <= joining.largest_gap <= 0.0125
    kept = [shape for shape in contour.shapes if not (shape.kind == "line" and shapes.reach(shape) < 0.0125)]
    assert len(kept) == 6
    for shape in kept:
        reference = min(before, key=lambda other: np.linalg.norm(other.start - shape.start))
        assert shape.kind == reference.kind
        moved = np.linalg.norm(points_of(shape) - points_of(reference), axis=1)
        assert moved.max() <= 0.0125 + 1e-9


def test_an_arc_stays_where_a_line_can_move_to_it():
    arc = shapes.arc((10, 0), (0, 10), (0, 0), "ccw")
    joining = join([run(arc), run(shapes.line((0.003, 10.004), (-20, 10)))], JOIN, SAME)
    (contour,) = joining.contours
    assert np.array_equal(contour.shapes[0].points, arc.points)
    assert contour.shapes[1].start.tolist() == [0, 10, 0]
    assert (joining.gaps, joining.largest_gap) == (1, pytest.approx(0.005))


def test_ends_farther_apart_than_the_tolerance_stay_apart():
    joining = join([*lines((0, 0), (1, 0)), *lines((1.011, 0), (2, 0))], JOIN, SAME)
    assert (len(joining.contours), joining.gaps) == (2, 0)


def test_a_fork_goes_straight_on_and_is_counted():
    cross = [*lines((-5, 0), (0, 0)), *lines((0, -5), (0, 0)), *lines((0, 0), (5, 0)), *lines((0, 0), (0, 5))]
    joining = join(cross, JOIN, SAME)
    ways = [(*c.shapes[0].start[:2], *c.shapes[-1].end[:2]) for c in joining.contours]
    assert ways == [(-5, 0, 5, 0), (0, -5, 0, 5)]
    assert joining.forks == 1


def test_a_near_circle_is_closed_and_short_curves_are_no_loops():
    (ring,) = join([run(shapes.bezier([(0, 0), (9, 9), (-9, 9), (0.004, 0)]))], JOIN, SAME).contours
    assert ring.closed
    assert np.array_equal(ring.shapes[0].start, ring.shapes[0].end)
    (speck,) = join(lines((0, 0), (0.004, 0)), JOIN, SAME).contours
    assert not speck.closed


def test_contours_of_a_layer_follow_the_nearest_start():
    loose = [run(shapes.line((x, 0), (x + 1, 0)), layer=layer) for x, layer in ((9, "A"), (1, "B"), (4, "A"), (7, "B"))]
    contours = join(loose, JOIN, SAME).contours

    def starts(*wish):
        return [float(contour.shapes[0].start[0]) for contour in in_order(contours, *wish)]

    assert starts((), True) == [4, 9, 7, 1]
    assert starts(("B",), True) == [1, 7, 9, 4]
    assert starts((), False) == [9, 4, 1, 7]


@settings(max_examples=examples(30), deadline=None)
@given(
    turn=st.floats(0, 7),
    sx=st.floats(0.1, 3),
    sy=st.floats(-3, -0.1),
    first=st.floats(-4, 4),
    sweep=st.floats(0.1, 6.2),
)
@example(turn=0.0, sx=0.1, sy=-0.1, first=0.0, sweep=1.0)
def test_maps_and_turning_round_keep_the_curve(turn, sx, sy, first, sweep):
    matrix = np.eye(4)
    c, s = math.cos(turn), math.sin(turn)
    matrix[:2, :2] = np.array([[c, -s], [s, c]]) @ np.diag([sx, sy])
    matrix[:2, 3] = 3, -4
    for shape in (
        shapes.unit_arc(first, sweep),
        shapes.unit_arc(first, -sweep),
        shapes.bulged((0, 0), (5, 1), 5e-6),
    ):
        found = transformed(shape, matrix)
        mapped = points_of(found)
        # An arc and the rational curve that it is run at different paces.
        bends = shape.kind == "arc" and found.kind != "arc"
        reference = points_of(shapes.as_nurbs(shape) if bends else shape)
        assert mapped == pytest.approx(reference @ matrix[:3, :3].T + matrix[:3, 3], abs=1e-9)
        assert points_of(backwards(found)) == pytest.approx(mapped[::-1], abs=1e-9)


def test_extents_are_where_the_curves_turn():
    box = extents_of(
        [
            shapes.arc((3, 4), (-3, 4), (0, 0), "ccw"),
            shapes.bezier([(0, 0), (0, -4), (6, -4), (6, 0)]),
            shapes.transformed(shapes.unit_arc(0, math.tau), np.diag([7.0, 2.0, 1.0, 1.0])),
        ]
    )
    assert box == pytest.approx(np.array([(-7, -3, 0), (7, 5, 0)]), abs=1e-12)
