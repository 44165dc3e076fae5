"""The exact interpolator: rows on the path, at the arc length and feed that the plan has."""

import math

import mpmath as mp
import numpy as np
import pytest
from support.motions import circle, look, make_machine, make_path

from ph_post.compensate.motion import MotionLaw, cycle_time, place_and_feed, sample
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.geometry.curves import Bezier, Line
from ph_post.geometry.ph import PH
from ph_post.types import Command, Phase, Plan, frozen

EPS = 2.0**-52
NANOMETRE_MM = 1e-12
"""1e-9 mm in metres."""


def sampled(path, options=None, period: float = 1e-3) -> tuple[Command, Plan]:
    analysis = look(path, make_machine(period=period))
    plan = make_plan(analysis, options or PlanOptions(strategy="suppress"))
    return sample(plan, analysis.track, period), plan


def exact_motion(plan: Plan, t: float) -> tuple[mp.mpf, mp.mpf]:
    """Arc length and speed at `t` from the plan's records, in 40 digits, by Eqs. (26) and (28)."""
    phase = next(p for p in reversed(plan.phases) if p.start <= t)
    n = phase.speed.size - 1
    tau = min((mp.mpf(t) - mp.mpf(phase.start)) / mp.mpf(phase.duration), mp.mpf(1))
    V = [mp.mpf(float(v)) for v in phase.speed]
    S = [mp.fsum(V[:k]) / (n + 1) for k in range(n + 2)]
    speed = mp.fsum(v * mp.binomial(n, k) * (1 - tau) ** (n - k) * tau**k for k, v in enumerate(V))
    way = mp.fsum(v * mp.binomial(n + 1, k) * (1 - tau) ** (n + 1 - k) * tau**k for k, v in enumerate(S))
    return mp.mpf(phase.s) + mp.mpf(phase.duration) * way, speed


def test_feed_and_arc_length_are_those_of_the_profile() -> None:
    command, plan = sampled(circle(0.05, feed=0.05), PlanOptions(strategy="suppress", start="moving"))
    assert (command.window >= 0).any()
    with mp.workdps(40):
        for k in range(0, command.t.size, 37):
            s, speed = exact_motion(plan, float(command.t[k]))
            # Time is right to an ulp of its size, which the speed turns into a length.
            assert command.s[k] == pytest.approx(float(s), rel=8 * EPS, abs=8 * EPS * command.t[k] * 0.05)
            assert command.feed[k] == pytest.approx(float(speed), rel=1e-9)
    near = np.abs(command.s - 0.05 * math.pi / 2) < 1e-4
    assert command.feed[near].min() == pytest.approx(0.25 * 0.05, rel=1e-3)


def test_the_place_at_one_instant_is_that_of_the_exact_motion() -> None:
    _, plan = sampled(circle(0.05, feed=0.05), PlanOptions(strategy="suppress", start="moving"))
    motion = MotionLaw.from_phases(plan.phases)
    t = np.concatenate([np.linspace(-0.1, motion.end + 0.1, 97), motion.start])
    assert [motion.place_at(one) for one in t.tolist()] == motion.place_and_feed(t)[0].tolist()
    with mp.workdps(40):
        for one in t[(t > 0.0) & (t < motion.end)].tolist():
            exact = float(exact_motion(plan, one)[0])
            assert motion.place_at(one) == pytest.approx(exact, rel=8 * EPS, abs=8 * EPS * one * 0.05)


def test_positions_on_a_circle() -> None:
    command, _ = sampled(circle(0.05, feed=0.05))
    angle = command.s / 0.05
    exact = 0.05 * np.column_stack([np.cos(angle), np.sin(angle)])
    assert np.abs(command.position - exact).max() < NANOMETRE_MM
    assert np.abs(np.linalg.norm(command.position, axis=1) - 0.05).max() < NANOMETRE_MM


def test_positions_on_a_ph_curve_by_its_polynomials() -> None:
    # r' = w² with w = (1 - ξ) + (1/2 + i) ξ, so that s = ∫|w|² and r = ∫w² are cubics known in closed form.
    curve = PH([0.0, 0.0], np.array([[0.2, 0.0], [0.1, 0.2]]))
    command, _ = sampled(make_path([curve], feed=0.02))
    w0, dw = 0.2 + 0.0j, -0.1 + 0.2j
    xi = command.xi
    r = w0**2 * xi + w0 * dw * xi**2 + dw**2 * xi**3 / 3
    s = abs(w0) ** 2 * xi + (w0 * dw.conjugate()).real * xi**2 + abs(dw) ** 2 * xi**3 / 3
    assert np.abs(command.position - np.column_stack([r.real, r.imag])).max() < NANOMETRE_MM
    assert np.abs(command.s - s).max() < NANOMETRE_MM


def test_positions_on_a_quintic_against_quadrature() -> None:
    points = np.array([(0, 0), (10, 15), (25, 20), (30, -10), (40, 0), (45, 10)]) * 1e-3
    command, _ = sampled(make_path([Bezier(points)], feed=0.02))
    with mp.workdps(20):
        n = len(points) - 1

        def hodograph(xi: mp.mpf, axis: int) -> mp.mpf:
            return n * mp.fsum(
                mp.binomial(n - 1, k)
                * (1 - xi) ** (n - 1 - k)
                * xi**k
                * mp.mpf(float(points[k + 1, axis] - points[k, axis]))
                for k in range(n)
            )

        for k in range(500, command.t.size, 1100):
            xi = mp.mpf(float(command.xi[k]))
            s = mp.quad(lambda x: mp.hypot(hodograph(x, 0), hodograph(x, 1)), mp.linspace(0, xi, 5))
            assert abs(float(s) - command.s[k]) < NANOMETRE_MM
            for axis in (0, 1):
                x = mp.quad(lambda y, axis=axis: hodograph(y, axis), [0, xi])
                assert abs(float(x) - command.position[k, axis]) < NANOMETRE_MM


def test_rows_come_every_period_and_end_at_rest_at_the_end() -> None:
    command, plan = sampled(make_path([Line([(0.0, 0.0), (0.03, 0.0)]), Line([(0.03, 0.0), (0.03, 0.01)])]))
    assert command.t.tolist() == [k * 1e-3 for k in range(command.t.size)]
    end = cycle_time(plan.phases)
    assert end <= command.t[-1] < end + 1e-3
    assert command.position[-1].tolist() == [0.03, 0.01]
    assert (command.feed[0], command.feed[-1]) == (0.0, 0.0)
    assert (command.segment[0], command.segment[-1]) == (0, 1)
    assert (command.xi[0], command.xi[-1]) == (0.0, 1.0)
    assert np.all(np.diff(command.s) >= 0.0)
    assert np.all(command.feed >= 0.0)


def test_a_moving_plan_ends_with_its_last_whole_period() -> None:
    options = PlanOptions(strategy="none", start="moving")
    # 31 mm at 20 mm/s are 1550 periods; a little more is one row the same.
    for length, rows in ((0.031, 1551), (0.031 + 1.9e-5, 1551), (0.031 + 2.1e-5, 1552)):
        command, _ = sampled(make_path([Line([(0.0, 0.0), (length, 0.0)])]), options)
        assert command.t.size == rows
        assert np.all(command.feed == 0.02)
        assert command.s[-1] == pytest.approx(0.02 * (rows - 1) * 1e-3, rel=4 * EPS)


def test_windows_are_marked_where_the_feed_is_modulated() -> None:
    command, plan = sampled(circle(0.05, feed=0.05), PlanOptions(strategy="suppress", start="moving"))
    for number, profile in enumerate(plan.profiles):
        assert profile is not None
        mine = command.window == number
        distance = np.abs(command.s[mine] - plan.windows[number].s)
        distance = np.minimum(distance, 0.1 * math.pi - distance)
        assert distance.max() <= profile.s_star * (1.0 + 1e-12)
        assert command.feed[mine].min() < 0.3 * profile.cruise
    outside = command.window == -1
    assert command.feed[outside] == pytest.approx(0.05, rel=1e-9)


def test_place_and_feed_of_mixed_phases() -> None:
    phases = [
        Phase(start=0.0, duration=2.0, s=0.0, speed=frozen([0.0, 1.0])),
        Phase(start=2.0, duration=1.0, s=1.0, speed=frozen([1.0])),
        Phase(start=3.0, duration=1.0, s=2.0, speed=frozen([1.0, 1.0, -1.0, -1.0])),
    ]
    s, feed = place_and_feed(phases, np.array([3.5, 1.0, 2.25, 4.0, 9.0, -1.0]))
    # Unsorted instants; beyond the ends what holds there.
    assert s.tolist() == [2.3125, 0.25, 1.25, 2.0, 2.0, 0.0]
    assert feed.tolist() == [0.0, 0.5, 1.0, -1.0, -1.0, 0.0]


def test_phases_survive_the_way_through_a_motion() -> None:
    _, plan = sampled(circle(0.05, feed=0.05))
    again = MotionLaw.from_phases(plan.phases).phases()
    for one, other in zip(plan.phases, again, strict=True):
        assert (one.duration, one.s, one.window) == (other.duration, other.s, other.window)
        assert one.start == pytest.approx(other.start, rel=1e-15)
        assert one.speed.tolist() == other.speed.tolist()
