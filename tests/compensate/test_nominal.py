"""The plain feed plan: against closed forms, and where it slows down or stops."""

import math

import numpy as np
import pytest
from support.motions import MM, assert_continuous, circle, look, make_machine, make_path, worst_use

from ph_post.compensate.motion import cycle_time, place_and_feed, sample
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.violations import check_command
from ph_post.geometry.curves import Arc, Bezier, Line, Polynomial
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.ph import PH
from ph_post.types import Plan

PLAIN = PlanOptions(strategy="none")
MOVING = PlanOptions(strategy="none", start="moving")
UNUSED = 3e-3
"""The planner leaves 2e-3 of each limit; the rest is for rounding."""


def plan_for(path, machine, options=PLAIN) -> Plan:
    return make_plan(look(path, machine), options)


def line(length: float, feed: float = 0.02):
    return make_path([Line([(0.0, 0.0), (length, 0.0)])], feed)


def feed_at(plan: Plan, s: float) -> float:
    """Feed where the motion passes `s`, by bisection over time."""
    low, high = 0.0, cycle_time(plan.phases)
    for _ in range(100):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if place_and_feed(plan.phases, np.array([middle]))[0][0] < s else (low, middle)
    return float(place_and_feed(plan.phases, np.array([low]))[1][0])


@pytest.mark.parametrize(("length", "acceleration", "jerk"), [(0.05, 5.0, 100.0), (0.05, 0.2, 100.0), (0.05, 0.5, 1.0)])
def test_a_line_from_rest_to_rest_takes_the_least_time(length: float, acceleration: float, jerk: float) -> None:
    # A ramp of duration T takes v T / 2: in all D / v + T, T = 2 √(v / j), or v / a + a / j with a reached.
    plan = plan_for(line(length), make_machine(acceleration=acceleration, jerk=jerk))

    def least(part: float) -> float:
        a, j, v = part * acceleration, part * jerk, 0.02
        return length / v + (2.0 * math.sqrt(v / j) if v * j <= a * a else v / a + a / j)

    assert least(1.0) < cycle_time(plan.phases) < least(1.0 - UNUSED)
    assert_continuous(plan, look(plan.path, plan.machine).track.length)
    assert plan.warnings == ()


def test_a_line_too_short_for_its_feed() -> None:
    # Four phases of full jerk: D = 2 j (T / 4)³, whatever the feed.
    plan = plan_for(line(1e-5, feed=0.3), make_machine(jerk=100.0))
    least = 4.0 * (1e-5 / 2.0 / 100.0) ** (1.0 / 3.0)
    assert least < cycle_time(plan.phases) < least * (1.0 - UNUSED) ** (-1.0 / 3.0)


def test_sharp_corners_stop_the_motion() -> None:
    path = make_path([Line([(0.0, 0.0), (0.03, 0.0)]), Line([(0.03, 0.0), (0.03, 0.02)])])
    rest, moving = plan_for(path, make_machine()), plan_for(path, make_machine(), MOVING)
    for plan in (rest, moving):
        assert feed_at(plan, 0.03) == pytest.approx(0.0, abs=1e-9)
        assert_continuous(plan, look(plan.path, plan.machine).track.length)
    assert rest.warnings == ()
    assert moving.warnings == ("the motion stops at a sharp corner (30 mm)",)
    assert rest.phases[0].speed[0] == rest.phases[-1].speed[-1] == 0.0
    assert moving.phases[0].speed[0] == moving.phases[-1].speed[-1] == 0.02


def test_moving_holds_the_feed_from_end_to_end() -> None:
    # The paper's case.
    plan = plan_for(circle(0.25, feed=0.25 * math.pi / 3), make_machine(), MOVING)
    assert len(plan.phases) == 1
    assert cycle_time(plan.phases) == pytest.approx(6.0, rel=1e-14)
    assert plan.warnings == ()


def test_feed_of_a_segment_is_reached_before_it_begins() -> None:
    path = make_path([Line([(k * 0.02, 0.0), ((k + 1) * 0.02, 0.0)]) for k in range(3)], feeds={1: 0.005})
    plan = plan_for(path, make_machine())
    s, feed = place_and_feed(plan.phases, np.linspace(0.0, cycle_time(plan.phases), 5001))
    assert feed.max() == 0.02
    assert feed[(s >= 0.02) & (s <= 0.04)].max() <= 0.005 * (1.0 + 1e-12)
    assert feed_at(plan, 0.03) == 0.005
    assert_continuous(plan, look(plan.path, plan.machine).track.length)


def test_rapid_segments_begin_and_end_at_rest_and_go_as_fast_as_the_axes() -> None:
    path = make_path([Line([(k * 0.2, 0.0), ((k + 1) * 0.2, 0.0)]) for k in range(3)], rapid=[1])
    plan = plan_for(path, make_machine(velocity=0.1))
    assert feed_at(plan, 0.2) == pytest.approx(0.0, abs=1e-9)
    assert feed_at(plan, 0.4) == pytest.approx(0.0, abs=1e-9)
    assert 0.099 < feed_at(plan, 0.3) < 0.1
    moving = plan_for(path, make_machine(velocity=0.1), MOVING)
    assert moving.warnings == ("the motion stops at 2 ends of rapid segments (200 mm, 400 mm)",)


def test_a_rapid_segment_at_the_end_of_a_path_is_not_entered_at_full_speed() -> None:
    path = make_path([Line([(k * 0.2, 0.0), ((k + 1) * 0.2, 0.0)]) for k in range(2)], rapid=[0])
    plan = plan_for(path, make_machine(), MOVING)
    assert (plan.phases[0].speed[0], plan.phases[-1].speed[-1]) == (0.0, 0.02)


def test_curvature_lowers_the_feed_and_it_is_said() -> None:
    # Normal acceleration v² / ρ on a circle of 1 mm: the feed of 0.2 m/s would ask for 40 m/s².
    plan = plan_for(circle(1 * MM, feed=0.2), make_machine(acceleration=1.0, jerk=1000.0), MOVING)
    feed = place_and_feed(plan.phases, np.linspace(0.0, cycle_time(plan.phases), 999))[1]
    # At most what all of the acceleration allows in the direction where one axis has to give it all.
    assert 0.6 * math.sqrt(1.0 * 1e-3) < feed.min() < feed.max() < math.sqrt(math.sqrt(2.0) * 1.0 * 1e-3)
    assert len(plan.warnings) == 1
    assert "the limits of the axes keep the feed below the programmed one at one place" in plan.warnings[0]


def test_an_axis_slower_than_the_feed_lowers_it() -> None:
    plan = plan_for(line(0.2, feed=0.2), make_machine(velocity=0.1))
    assert 0.099 < place_and_feed(plan.phases, np.array([1.0]))[1][0] < 0.1


def test_a_jump_of_the_curvature_lowers_the_feed_at_the_joint_only() -> None:
    # A line runs into an arc of 5 mm: v² / ρ must not jump by more than about J dt = 0.1 m/s² in a period.
    radius = 5 * MM
    arc = Arc(np.array([0.03, 0.0]), np.array([0.03 + radius, radius]), np.array([0.03, radius]), "ccw")
    path = make_path([Line([(0.0, 0.0), (0.03, 0.0)]), arc], feed=0.05)
    plan = plan_for(path, make_machine(acceleration=5.0, jerk=100.0))
    at_joint = feed_at(plan, 0.03)
    # The step shows in the sampled jerk as ¾ v² / (ρ dt) at most, and half of the limit is given to it.
    assert at_joint == pytest.approx(math.sqrt(0.5 * 100.0 * 1e-3 * radius / 0.75), rel=UNUSED)
    assert feed_at(plan, 0.025) == pytest.approx(0.05, rel=1e-12)
    assert feed_at(plan, 0.03 + 0.5 * math.pi * radius / 2) > 1.5 * at_joint


def test_a_kink_too_small_for_a_corner_is_passed_slowly_enough() -> None:
    kink = 9e-4
    end = (0.03 + 0.03 * math.cos(kink), 0.03 * math.sin(kink))
    path = make_path([Line([(0.0, 0.0), (0.03, 0.0)]), Line([(0.03, 0.0), end])], feed=0.2)
    machine = make_machine()
    analysis = look(path, machine)
    plan = make_plan(analysis, PLAIN)
    # v |Δt| / dt² stays below the jerk limit.
    assert 0.0 < feed_at(plan, 0.03) * kink / 1e-6 < 100.0
    assert check_command(sample(plan, analysis.track, 1e-3), machine) == ()


@pytest.mark.parametrize("d", [0.0, 1e-7, 1e-5, 1e-3, 1e-2])
def test_cusps_and_near_cusps(d: float) -> None:
    # (t², t³ + d t): a cusp for d = 0, a hairpin of radius d² / 2 else.
    path = make_path([Polynomial([[0.0, 0.0, 0.02], [0.0, d * 0.02, 0.0, 0.02]], (-1.0, 1.0))], feed=0.05)
    machine = make_machine()
    analysis = look(path, machine)
    plan = make_plan(analysis, PLAIN)
    assert_continuous(plan, look(plan.path, plan.machine).track.length)
    command = sample(plan, analysis.track, 1e-3)
    assert check_command(command, machine) == ()
    middle = feed_at(plan, analysis.track.length / 2)
    assert middle == pytest.approx(0.0, abs=1e-9) if d == 0.0 else middle > 0.0
    # Nothing crawls: 29 mm at 50 mm/s and a stop take about a second.
    assert cycle_time(plan.phases) < 1.5


def test_control_points_that_coincide_at_an_end_do_not_stop_a_straight_line() -> None:
    # Drawing programs write lines as cubics with coincident ends; the parametric speed vanishes there.
    curves = [Bezier([(k * 0.006, k * 0.008)] * 2 + [((k + 1) * 0.006, (k + 1) * 0.008)] * 2) for k in range(3)]
    plan = plan_for(make_path(curves), make_machine())
    assert feed_at(plan, 0.01) == pytest.approx(0.02, rel=1e-9)
    straight = plan_for(make_path([Line([(0.0, 0.0), (0.018, 0.024)])]), make_machine())
    assert cycle_time(plan.phases) == pytest.approx(cycle_time(straight.phases), rel=1e-9)


def test_infinite_curvature_at_a_joint_stops_and_is_said() -> None:
    # (t², t³): its curvature is infinite where it begins.
    half = Polynomial([[0.01, 0.0, 0.02], [0.0, 0.0, 0.0, 0.02]], (0.0, 1.0))
    path = make_path([Line([(0.0, 0.0), (0.01, 0.0)]), half])
    for options in (PLAIN, MOVING):
        plan = plan_for(path, make_machine(), options)
        assert feed_at(plan, 0.01) == pytest.approx(0.0, abs=1e-9)
        assert plan.warnings[0] == "the motion stops at a place of infinite curvature (10 mm)"


@pytest.mark.parametrize("options", [PLAIN, MOVING])
def test_every_kind_of_curve_keeps_the_limits_on_the_samples(options: PlanOptions) -> None:
    curves = [
        Nurbs(2, [0, 0, 0, 1, 1, 1], [(0, 0), (0.01, 0), (0.01, 0.01)], [1, 0.7, 1]),
        PH([0.0, 0.0], np.array([[0.1, 0.0], [0.1, 0.05], [0.05, 0.1]])),
        Bezier([(0, 0), (0.01, 0.02), (0.02, -0.02), (0.03, 0)]),
        Arc(np.array([0.01, 0.0]), np.array([0.01, 0.0]), np.zeros(2), "cw"),
    ]
    for curve in curves:
        for feed in (0.01, 1.0):
            machine = make_machine()
            analysis = look(make_path([curve], feed), machine)
            plan = make_plan(analysis, options)
            command = sample(plan, analysis.track, 1e-3)
            assert check_command(command, machine) == ()
            assert max(worst_use(command, machine)) <= 1.0
            assert_continuous(plan, look(plan.path, plan.machine).track.length)


def test_no_axis_is_idle_all_the_time_when_the_limits_bind() -> None:
    """A plan that keeps limits by crawling would be useless: somewhere a limit is used nearly fully."""
    rng = np.random.default_rng(4)
    for _ in range(5):
        machine = make_machine(velocity=0.1)
        analysis = look(make_path([Bezier(rng.uniform(-0.1, 0.1, (6, 2)))], feed=1.0), machine)
        command = sample(make_plan(analysis, PLAIN), analysis.track, 1e-3)
        assert 0.9 < max(worst_use(command, machine)) <= 1.0


def test_a_plan_is_the_same_each_time() -> None:
    path = make_path([Bezier([(0, 0), (0.01, 0.02), (0.02, -0.02), (0.03, 0)])], feed=0.2)
    one, other = (plan_for(path, make_machine()) for _ in range(2))
    assert [(p.start, p.duration, p.s, p.speed.tolist()) for p in one.phases] == [
        (p.start, p.duration, p.s, p.speed.tolist()) for p in other.phases
    ]
