"""Shapes of several pieces: how smooth they are, how far and how long they go, and where they are cut."""

from __future__ import annotations

import math
from fractions import Fraction
from itertools import pairwise

import numpy as np
import pytest
from scipy.integrate import fixed_quad, quad
from scipy.optimize import minimize_scalar
from scipy.special import betainc

from ph_post.compensate import profile, shapes
from ph_post.types import FeedProfile, ProfileShape

EPS = 2.0**-52
ORDERS = range(6)


def end_derivatives(coefficients: np.ndarray, order: int) -> tuple[list[Fraction], list[Fraction]]:
    """Derivatives up to the order at both ends of [0, 1], exactly: n! / (n - r)! times a difference."""
    row = [Fraction(float(c)) for c in coefficients]
    n = len(row) - 1
    first, last = [], []
    for r in range(order + 1):
        factor = math.perm(n, r)
        first.append(factor * row[0] if row else Fraction(0))
        last.append(factor * row[-1] if row else Fraction(0))
        row = [b - a for a, b in pairwise(row)]
    return first, last


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("floor", [0.0, 0.25, -0.125])
def test_junctions_are_continuous_to_the_order_and_no_further(order: int, floor: float) -> None:
    shape = profile.plateau(3.0, 1.0, 2.0, floor, order)
    pieces = [np.ones(1), *(piece.coefficients for piece in shape.pieces), np.ones(1)]
    durations = [Fraction(1), Fraction(3), Fraction(1), Fraction(2), Fraction(1)]
    ends = [end_derivatives(piece, order + 1) for piece in pieces]
    for (_, before), (after, _), (old, new) in zip(ends, ends[1:], pairwise(durations), strict=False):
        left = [value / old**r for r, value in enumerate(before)]
        right = [value / new**r for r, value in enumerate(after)]
        assert left[: order + 1] == right[: order + 1]
        assert left[order + 1] != right[order + 1]


@pytest.mark.parametrize("order", ORDERS)
def test_ramps_are_incomplete_beta_functions(order: int) -> None:
    # The polynomial of degree 2k + 1 whose first k derivatives vanish at both ends is I_τ(k + 1, k + 1).
    shape = profile.plateau(0.5, 0.125, 0.25, 0.25, order)
    tau = np.linspace(0.0, 1.0, 141)
    down = betainc(order + 1, order + 1, np.clip(tau * 0.875 / 0.5, 0.0, 1.0))
    up = betainc(order + 1, order + 1, np.clip((tau * 0.875 - 0.625) / 0.25, 0.0, 1.0))
    expected = 1.0 - 0.75 * (down - up)
    np.testing.assert_allclose(shapes.value(shape, tau), expected, rtol=0.0, atol=64 * EPS)
    rate = (shapes.value(shape, tau + 1e-6) - shapes.value(shape, tau - 1e-6)) / 2e-6
    # Central differences err by h² V''' / 6, and by rounding over h; straight ramps have corners.
    if order >= 2:
        np.testing.assert_allclose(shapes.slope(shape, tau)[1:-1], rate[1:-1], rtol=0.0, atol=1e-8)


@pytest.mark.parametrize(("down", "hold", "up", "floor"), [(3, 1, 2, 0), (1, 0, 1, 0.25), (1, 7, 4, -0.125)])
def test_mean_and_way_in_closed_form(down: int, hold: int, up: int, floor: float) -> None:
    total = Fraction(down + hold + up)
    f = Fraction(floor)
    ways = [down * (1 + f) / 2 / total, hold * f / total, up * (1 + f) / 2 / total]
    for order in ORDERS:
        shape = profile.plateau(down, hold, up, floor, order)
        assert math.fsum(piece.share for piece in shape.pieces) == pytest.approx(1.0, abs=EPS)
        assert len(shape.pieces) == (3 if hold else 2)
        assert shapes.mean(shape) == pytest.approx(float(sum(ways)), rel=4 * EPS)
        ends = np.array([0.0, down / total, (down + hold) / total, 1.0], dtype=float)
        expected = [0.0, float(ways[0]), float(ways[0] + ways[1]), float(sum(ways))]
        np.testing.assert_allclose(shapes.way(shape, ends), expected, rtol=0.0, atol=8 * EPS)
        middle = float((down + Fraction(hold, 2)) / total)
        share = float((ways[0] + ways[1] / 2) / sum(ways))
        assert shapes.share_of_way(shape, middle) == pytest.approx(share, rel=16 * EPS)


def test_stop_and_dip_are_special_cases() -> None:
    whole, parts = profile.stop(2.0, 1.0, 3), profile.plateau(2.0, 1.0, 2.0, 0.0, 3)
    for one, other in zip(whole.pieces, parts.pieces, strict=True):
        assert one.share == other.share
        assert one.coefficients.tolist() == other.coefficients.tolist()
    assert [piece.coefficients.tolist() for piece in whole.pieces] == [
        [1, 1, 1, 1, 0, 0, 0, 0],
        [0],
        [0, 0, 0, 0, 1, 1, 1, 1],
    ]
    assert shapes.lowest(whole) == 0.0
    assert shapes.is_non_negative(whole)
    assert shapes.extremes(profile.plateau(1.0, 1.0, 1.0, -0.25, 2)) == (-0.25, 1.0)
    assert [piece.coefficients.tolist() for piece in profile.plateau(1.0, 0.0, 1.0, 0.25, 0).pieces] == [
        [1, 0.25],
        [0.25, 1],
    ]
    (only,) = profile.dip(0.25, 10).pieces
    assert only.share == 1.0
    assert only.coefficients.tolist() == profile.coefficients_from_ratio(0.25, 10).tolist()


@pytest.mark.parametrize("order", [1, 2, 3, 5])
def test_ramps_last_as_long_as_the_limits_ask(order: int) -> None:
    # The steepest place of I_τ, and of its derivative, by search.
    def density(x: float) -> float:
        return (x * (1.0 - x)) ** order

    whole = quad(density, 0.0, 1.0, epsabs=0.0, epsrel=1e-13)[0]

    def bend(x: float) -> float:
        return order * (x * (1.0 - x)) ** (order - 1) * (1.0 - 2.0 * x)

    top = minimize_scalar(lambda x: -bend(x), bounds=(0.0, 0.5), method="bounded", options={"xatol": 1e-10})
    # For k = 1 the bend is largest at the very end, which the search only comes near to.
    bent = max(-top.fun, bend(0.0)) / whole
    steep = density(0.5) / whole
    assert profile.ramp_duration(0.3, 2.0, math.inf, order) == pytest.approx(0.3 * steep / 2.0, rel=1e-12)
    assert profile.ramp_duration(0.3, math.inf, 2.0, order) == pytest.approx(math.sqrt(0.3 * bent / 2.0), rel=1e-12)


def test_softening_scales_every_piece() -> None:
    shape = shapes.soften(profile.stop(1.0, 1.0, 2), 0.25)
    assert [piece.share for piece in shape.pieces] == pytest.approx([1 / 3] * 3)
    assert shapes.reported_ratio(shape) == 0.25
    assert shape.pieces[0].coefficients.tolist() == [1, 1, 1, 0.25, 0.25, 0.25]


@pytest.mark.parametrize("share", [0.1, 0.5, 0.625, 0.9])
def test_the_cut_at_a_share_of_the_way(share: float) -> None:
    shape = profile.plateau(5.0, 2.0, 3.0, 0.25, 3)
    first, second = shapes.split(shape, share, 1e-12)
    tau = shapes_time(shape, share)
    assert shapes.mean(first) * tau == pytest.approx(share * shapes.mean(shape), rel=1e-14)
    assert shapes.mean(second) * (1.0 - tau) == pytest.approx((1.0 - share) * shapes.mean(shape), rel=1e-14)
    at = np.linspace(0.0, 1.0, 41)
    np.testing.assert_allclose(shapes.value(first, at), shapes.value(shape, tau * at), atol=1e-13)
    np.testing.assert_allclose(shapes.value(second, at), shapes.value(shape, tau + (1.0 - tau) * at), atol=1e-13)


def shapes_time(shape: ProfileShape, share: float) -> float:
    """Instant at which that share of the way is covered, by bisection of a numerical integral."""
    low, high = 0.0, 1.0
    whole = way_by_quad(shape, 1.0)
    for _ in range(60):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if way_by_quad(shape, middle) < share * whole else (low, middle)
    return high


def way_by_quad(shape: ProfileShape, tau: float) -> float:
    """Gauss's rule with 8 points, exact for the degree 7 of every piece."""
    edges = [0.0, *np.cumsum([piece.share for piece in shape.pieces])[:-1].tolist(), 1.0]
    parts = [(a, min(b, tau)) for a, b in pairwise(edges) if a < tau]
    return math.fsum(fixed_quad(lambda x: shapes.value(shape, x), a, b, n=8)[0] for a, b in parts)


def test_a_hold_stays_whole_in_the_second_part() -> None:
    shape = profile.stop(2.0, 1.0, 3)
    for nudge in (-1e-14, 0.0, 1e-14):
        first, second = shapes.split(shape, 0.5 + nudge, 1e-12)
        assert len(first.pieces) == 1
        assert [first.pieces[0].coefficients[0], first.pieces[0].coefficients[-1]] == [1.0, 0.0]
        assert len(second.pieces) == 2
        assert second.pieces[0].coefficients.tolist() == [0.0]
        assert second.pieces[0].share == pytest.approx(1.0 / 3.0, rel=1e-14)
    assert len(shapes.split(shape, 0.4, 1e-12)[0].pieces) == 1


def test_a_turning_point_that_is_not_in_the_middle_of_the_way() -> None:
    shape = profile.plateau(3.0, 2.0, 1.0, 0.0, 3)
    turn = shapes.share_of_way(shape, 4.0 / 6.0)
    assert turn == pytest.approx(0.75, rel=4 * EPS)
    s_star = shapes.half_length(shape, 0.1, 0.3)
    given = FeedProfile(window=0, shape=shape, cruise=0.1, t_star=0.3, s_star=s_star, ratio=0.0, turn=turn)
    assert given.coefficients is None
    # 0.3 s of ramp at half the feed, 0.2 s at the turning point, 0.1 s of ramp, and constant feed.
    t = np.array([-0.5, -0.3, 0.0, 0.1, 0.2, 0.3, 0.4])
    expected = [-0.035, -0.015, 0.0, 0.0, 0.0, 0.005, 0.015]
    np.testing.assert_allclose(profile.travelled(given, t), expected, rtol=0.0, atol=1e-16)
    np.testing.assert_allclose(profile.feed(given, t), [0.1, 0.1, 0.0, 0.0, 0.0, 0.1, 0.1], atol=1e-16)
    middle = profile.acceleration(given, np.array([-0.15]))[0]
    assert middle == pytest.approx(-0.1 * 35.0 / 16.0 / 0.3, rel=1e-13)
    lead = profile.lead_duration(given, 0.25, 0.2)
    assert profile.commanded_angle(given, 0.25, np.array([-lead])) == pytest.approx([-0.2], rel=1e-13)
