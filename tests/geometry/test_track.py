"""The track: arc length over many pieces, derivatives with respect to it, and one-sided tangents."""

import math
from fractions import Fraction

import mpmath
import numpy as np
import pytest

from ph_post.errors import InputError
from ph_post.geometry import bernstein
from ph_post.geometry.curves import Arc, Bezier, Line, Polynomial
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.ph import PH
from ph_post.geometry.track import Track
from ph_post.types import Path, Segment

EPS = np.finfo(float).eps
MIXED = [
    Line([[0, 0], [1, 0]]),
    Arc([1, 0], [1, 2], [1, 1], "ccw"),
    PH([1, 2], [[1, 0.5], [0.3, -1], [0.2, 0.1]]),
    Bezier([[0.5, 1], [0, 2], [0, 1], [-1, 0]]),
    Nurbs(2, [0, 0, 0, 1, 2, 2, 2], [[-1, 0], [0, -1], [1, -1], [2, 2]], [1, 2, 1, 0.5]),
    Polynomial([[2, 1], [2, 0, -1]], (0, 1.5)),
]


@pytest.fixture(scope="module")
def mixed():
    return Track.from_curves(MIXED)


def rows(track, count=200):
    s = np.linspace(0, track.length, count)
    return (s, *track.locate(s))


def test_pieces_are_numbered_along_the_path(mixed):
    assert mixed.segment.tolist() == [0, 1, 2, 3, 4, 4, 5]
    assert [piece.kind for piece in mixed.pieces] == [
        "polynomial",
        "arc",
        *["polynomial"] * 2,
        *["rational"] * 2,
        "polynomial",
    ]
    assert mixed.xi0.tolist() == [0, 0, 0, 0, 0, 1, 0]
    assert mixed.xi1.tolist() == [1, 1, 1, 1, 1, 2, 1.5]
    assert mixed.dimension == 2
    assert not mixed.closed


def test_groups_hold_every_piece_once(mixed):
    assert sorted(np.concatenate([group.index for group in mixed.groups]).tolist()) == list(range(7))
    for group in mixed.groups:
        for row, number in enumerate(group.index.tolist()):
            assert group.control[row].tolist() == mixed.pieces[number].control.tolist()
            assert (group.kind, group.degree) == (mixed.pieces[number].kind, group.control.shape[1] - 1)


def test_starts_are_the_sums_of_the_lengths(mixed):
    lengths = [curve.length for curve in MIXED]
    spline = MIXED[4].arc_length(1.0)[0]
    lengths[4:5] = [spline, lengths[4] - spline]
    assert mixed.starts == pytest.approx(np.cumsum([0, *lengths]), rel=1e-13)
    assert mixed.length == mixed.starts[-1]


def test_locate_and_back(mixed):
    s, piece, u = rows(mixed, 5000)
    assert np.abs(mixed.arc_length(piece, u) - s).max() <= 4 * EPS * mixed.length
    assert np.all(np.diff(piece + u) >= 0)


def test_rows_in_any_order(mixed):
    s, piece, u = rows(mixed)
    order = np.random.default_rng(0).permutation(s.size)
    again = mixed.locate(s[order])
    assert again[0].tolist() == piece[order].tolist()
    assert again[1] == pytest.approx(u[order], abs=8 * EPS)


def test_joints_belong_to_the_later_piece_and_the_ends_are_exact(mixed):
    piece, u = mixed.locate(mixed.starts)
    assert piece.tolist() == [0, 1, 2, 3, 4, 5, 6, 6]
    assert u.tolist() == [0] * 7 + [1]
    piece, u = mixed.locate(np.array([-1.0, mixed.length + 1.0]))
    assert (piece.tolist(), u.tolist()) == ([0, 6], [0, 1])
    assert mixed.arc_length(np.arange(7), np.ones(7)) == pytest.approx(mixed.starts[1:], rel=1e-13)


def test_no_rows_at_all(mixed):
    piece, u = mixed.locate(np.empty(0))
    assert piece.size == u.size == 0
    assert mixed.derivatives(piece, u, 2).shape == (3, 0, 2)
    assert mixed.arc_length(piece, u).size == 0


def test_values_are_those_of_the_curves(mixed):
    _, piece, u = rows(mixed)
    segment, xi = mixed.to_xi(piece, u)
    found = mixed.derivatives(piece, u, 4)
    for number, curve in enumerate(MIXED):
        mine = segment == number
        exact = curve.derivatives(xi[mine], 4)
        width = np.array([one.xi1 - one.xi0 for one in mixed.pieces])[piece[mine]]
        for order in range(5):
            scale = max(1.0, np.abs(exact[order]).max())
            assert found[order, mine] == pytest.approx(exact[order] * width[:, None] ** order, abs=1e-12 * scale)


def test_to_xi_reaches_the_end_exactly():
    track = Track.from_curves([Polynomial([[0, 1], [0, 2]], (0.1, 0.7))])
    segment, xi = track.to_xi(np.array([0, 0]), np.array([0.0, 1.0]))
    assert (segment.tolist(), xi.tolist()) == ([0, 0], [0.1, 0.7])


def arc_derivatives_by_series(power, at, order):
    """d^k r / ds^k of a polynomial curve by reverting the series of s(u), in mpmath."""
    local = [mpmath.taylor(lambda x, p=p: mpmath.polyval(p[::-1], x), at, order + 1) for p in power]
    slope = [[(k + 1) * c for k, c in enumerate(axis[1:])] for axis in local]
    square = [sum(a[i] * a[k - i] for a in slope for i in range(k + 1)) for k in range(order + 1)]
    speed = [mpmath.sqrt(square[0])]
    for k in range(1, order + 1):
        speed.append((square[k] - sum(speed[i] * speed[k - i] for i in range(1, k))) / (2 * speed[0]))
    s = [mpmath.mpf(0), *(c / (k + 1) for k, c in enumerate(speed))]
    # u(s) by Newton on truncated series
    u = [mpmath.mpf(0), 1 / s[1]] + [mpmath.mpf(0)] * (order - 1)

    def compose(outer, inner):
        result = [mpmath.mpf(0)] * (order + 1)
        for c in reversed(outer[: order + 1]):
            result = [sum(result[i] * inner[k - i] for i in range(k + 1)) for k in range(order + 1)]
            result[0] += c
        return result

    for k in range(2, order + 1):
        u[k] = -compose(s, u)[k] / s[1]
    return [[float(c * mpmath.factorial(k)) for k, c in enumerate(compose(axis, u))] for axis in local]


@pytest.mark.parametrize("dim", [2, 3])
def test_arc_derivatives_by_reverting_a_series(dim):
    power = np.random.default_rng(dim).normal(size=(dim, 6))
    track = Track.from_curves([Polynomial(power.tolist())])
    for at in (0.0, 0.4, 1.0):
        found = track.arc_derivatives(np.array([0]), np.array([at]), 4)[:, 0]
        with mpmath.workdps(40):
            exact = np.array(arc_derivatives_by_series([[mpmath.mpf(x) for x in p] for p in power], at, 4)).T
        size = np.abs(exact).max(axis=1, keepdims=True)
        assert found / size == pytest.approx(exact / size, abs=1e-12)


def test_arc_derivatives_of_a_circle():
    track = Track.from_curves([Arc([2, 0], [2, 0], [0, 0], "ccw")], closed=True)
    s = np.linspace(0, track.length, 50)
    found = track.arc_derivatives(*track.locate(s), 4)
    for order in range(5):
        exact = 2 * (0.5j) ** order * np.exp(0.5j * s)
        assert found[order] == pytest.approx(np.stack([exact.real, exact.imag], axis=1), abs=32 * EPS)


def test_order_zero_and_one_only(mixed):
    _, piece, u = rows(mixed, 20)
    assert mixed.arc_derivatives(piece, u, 0).tolist() == mixed.derivatives(piece, u, 0).tolist()
    assert np.linalg.norm(mixed.arc_derivatives(piece, u, 1)[1], axis=1) == pytest.approx(1, abs=8 * EPS)


def test_tangents_are_those_of_the_ends(mixed):
    first, last = mixed.tangents()
    numbers = np.arange(7)
    assert first == pytest.approx(mixed.arc_derivatives(numbers, np.zeros(7), 1)[1], abs=1e-14)
    assert last == pytest.approx(mixed.arc_derivatives(numbers, np.ones(7), 1)[1], abs=1e-14)


def test_end_curvatures_are_those_of_the_ends(mixed):
    numbers = np.arange(7)
    for found, u in zip(mixed.end_curvatures(), (np.zeros(7), np.ones(7)), strict=True):
        exact = mixed.arc_derivatives(numbers, u, 2)[2]
        assert found == pytest.approx(exact, abs=1e-12 * np.abs(exact).max())


@pytest.mark.parametrize("weights", [None, [1.0, 2.0, 0.5, 3.0, 1.0]])
@pytest.mark.parametrize("repeated", [1, 2, 3])
def test_tangents_at_repeated_control_points(weights, repeated):
    """The first derivative that does not vanish gives the direction."""
    points = [[0, 0]] * repeated + [[3, 4], [1, 1], [-2, 0], [5, 5]][: 5 - repeated]
    curve = Nurbs(4, [0] * 5 + [1] * 5, points, weights)
    track = Track.from_curves([curve])
    assert track.tangents()[0][0] == pytest.approx([0.6, 0.8], abs=4 * EPS)
    order = repeated
    derivative = track.derivatives(np.array([0]), np.array([0.0]), order)[order, 0]
    assert derivative / np.linalg.norm(derivative) == pytest.approx([0.6, 0.8], abs=8 * EPS)


def test_tangents_at_repeated_last_points_look_ahead():
    track = Track.from_curves([Bezier([[0, 0], [1, 1], [4, 0], [4, 0]])])
    assert track.tangents()[1][0] == pytest.approx(np.array([3, -1]) / math.sqrt(10), abs=4 * EPS)


def test_points_that_differ_by_rounding_only_are_repeated():
    track = Track.from_curves([Bezier([[1, 1], [1 + 4 * EPS, 1 - 4 * EPS], [4, 5], [6, 5]])])
    assert track.tangents()[0][0] == pytest.approx([0.6, 0.8], abs=4 * EPS)


def test_a_retracted_handle_bends_infinitely_and_a_straight_line_does_not():
    # r = 3 t² (1, 1) + …: the curvature grows like s^(-1/2).
    assert np.all(np.isinf(Track.from_curves([Bezier([[0, 0], [0, 0], [1, 1], [2, 0]])]).end_curvatures()[0]))
    straight = Track.from_curves([Bezier([[0, 0], [0, 0], [1, 1], [1, 1]])])
    assert [bend.tolist() for bend in straight.end_curvatures()] == [[[0, 0]], [[0, 0]]]


def test_the_curvature_at_a_degenerate_end_is_the_limit():
    # r = (t², t⁴): the parabola y = x² run from rest, whose curvature is 2 at its beginning.
    curve = Polynomial([[0, 0, 1], [0, 0, 0, 0, 1]])
    assert Track.from_curves([curve]).end_curvatures()[0][0] == pytest.approx([0, 2], abs=32 * EPS)
    # the same as a rational curve
    weights = [Fraction(1), Fraction(2), Fraction(3), Fraction(1), Fraction(2)]
    points = [[0, 0], [0, 0], [1, 0], [2, 0], [3, 5]]
    rational = Nurbs(4, [0] * 5 + [1] * 5, points, [float(w) for w in weights])
    bend = Track.from_curves([rational]).end_curvatures()[0][0]
    with mpmath.workdps(60):

        def place(t):
            b = [mpmath.binomial(4, k) * t**k * (1 - t) ** (4 - k) * float(w) for k, w in enumerate(weights)]
            return [mpmath.fdot(b, column) / mpmath.fsum(b) for column in zip(*points, strict=True)]

        x, y = place(mpmath.mpf(10) ** -12)
        assert bend == pytest.approx([0, float(2 * y / x**2)], rel=1e-9)


def test_one_segment_may_be_fast_and_another_slow():
    path = Path(
        name="p",
        source="",
        axes=("X", "Y"),
        feed=1.0,
        closed=True,
        segments=(Segment(curve=MIXED[0], feed=2.0), Segment(curve=Line([[1, 0], [0, 0]]), rapid=True)),
    )
    track = Track(path)
    assert track.closed
    assert track.path is path
    assert track.length == 2.0


def test_space():
    track = Track.from_curves([Line([[0, 0, 0], [0, 0, 1]]), Arc([0, 0, 1], [2, 0, 1], [1, 0, 1], "cw")])
    piece, u = track.locate(np.array([0.5, 1 + math.pi / 2]))
    assert track.derivatives(piece, u)[0] == pytest.approx(np.array([[0, 0, 0.5], [1, 1, 1]]), abs=8 * EPS)


class Foreign:
    dimension = 2
    domain = (0.0, 1.0)

    def derivatives(self, xi, order=0):
        return bernstein.evaluate(np.zeros((2, 2)), xi)


def test_a_foreign_curve_is_refused():
    with pytest.raises(InputError, match=r"without pieces; expected a curve of ph_post\.geometry\.curves"):
        Track.from_curves([Foreign()])
