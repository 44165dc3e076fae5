"""Feed dips at turning points: where they go, how deep they are, and what is said where they do not fit."""

import math

import msgspec
import numpy as np
import pytest
from support.motions import MM, circle, look, make_machine, make_path

from ph_post.analysis.path_analysis import Analysis
from ph_post.compensate import profile, shapes
from ph_post.compensate.motion import cycle_time, place_and_feed, sample
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.strategies import registry
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult
from ph_post.compensate.violations import check_command
from ph_post.errors import InputError
from ph_post.geometry.curves import Arc
from ph_post.geometry.nurbs import Nurbs
from ph_post.types import Gap, Plan

RADIUS, FEED = 0.05, 0.02
MOVING = PlanOptions(strategy="suppress", start="moving")


def ring(feed: float = FEED, **machine) -> Analysis:
    return look(circle(RADIUS, feed), make_machine(**machine))


def durations(analysis: Analysis) -> list[float]:
    return [0.0 if interval is None else interval.duration for interval in analysis.intervals]


def dips(plan: Plan) -> list[float | None]:
    return [None if found is None else found.ratio for found in plan.profiles]


def told(plan: Plan, words: str) -> bool:
    return any(words in warning for warning in plan.warnings)


def test_defaults_are_a_quarter_of_the_feed_degree_ten_and_four_intervals() -> None:
    analysis = ring()
    plan = make_plan(analysis, MOVING)
    assert [found.coefficients.size for found in plan.profiles] == [11] * 4
    for found, duration in zip(plan.profiles, durations(analysis), strict=True):
        assert found.ratio == pytest.approx(0.25, rel=1e-14)
        assert found.cruise == FEED
        assert found.t_star == pytest.approx(4.0 * duration, rel=1e-12)
        # Eq. (27), and inside the window.
        assert found.s_star == pytest.approx(shapes.half_length(found.shape, FEED, found.t_star), rel=1e-12)
        assert found.s_star < analysis.windows[found.window].half_length
    # Each dip takes (n + 1) / (n + f) times as long as constant feed does.
    f = profile.middle_factor(0.25, 10)
    extra = sum(2.0 * found.t_star * (1.0 - (10.0 + f) / 11.0) for found in plan.profiles)
    assert cycle_time(plan.phases) - cycle_time(plan.nominal) == pytest.approx(extra, rel=1e-9)
    assert plan.warnings == ()


def test_the_dip_stands_where_the_axis_turns() -> None:
    analysis = ring()
    plan = make_plan(analysis, PlanOptions(strategy="suppress"))
    for point, found in zip(analysis.turning_points[1:], plan.profiles[1:], strict=True):
        phase = next(p for p in plan.phases if p.window == found.window)
        middle = phase.start + 0.5 * phase.duration
        s, feed = place_and_feed(plan.phases, np.array([middle]))
        assert s[0] == pytest.approx(point.s, abs=1e-12)
        assert feed[0] == pytest.approx(0.25 * FEED, rel=1e-12)
        ends = place_and_feed(plan.phases, np.array([phase.start, phase.start + phase.duration]))[0]
        assert ends == pytest.approx([point.s - found.s_star, point.s + found.s_star], abs=1e-12)


def test_strategy_none_adds_nothing() -> None:
    plan = make_plan(ring(), PlanOptions(strategy="none"))
    assert dips(plan) == [None] * 4
    assert cycle_time(plan.phases) == cycle_time(plan.nominal)
    assert plan.warnings == ()


def test_seam_at_rest_is_left_alone_with_a_word() -> None:
    plan = make_plan(ring(), PlanOptions(strategy="suppress"))
    assert dips(plan)[0] is None
    assert dips(plan)[1:] == pytest.approx([0.25] * 3)
    assert told(plan, "turning point #0: left alone: the motion stops here")


def test_seam_of_a_moving_loop_is_split_in_two() -> None:
    plan = make_plan(ring(), MOVING)
    first, last = plan.phases[0], plan.phases[-1]
    assert first.window == last.window == 0
    found = plan.profiles[0]
    assert first.duration == pytest.approx(found.t_star, rel=1e-12)
    assert last.duration == pytest.approx(found.t_star, rel=1e-12)
    # The halves of a symmetric profile mirror each other, and meet at the bottom of the dip.
    assert first.speed == pytest.approx(last.speed[::-1], rel=1e-12)
    assert first.speed[0] == pytest.approx(0.25 * FEED, rel=1e-12)
    command = sample(plan, ring().track, 1e-3)
    assert command.feed[0] == pytest.approx(0.25 * FEED, rel=1e-12)


def test_a_seam_beside_the_turning_point_cuts_the_profile_where_it_lies() -> None:
    # A loop of two arcs whose seam is 1 mm before a turning point.
    angle = -1.0 * MM / RADIUS
    start = RADIUS * np.array([math.cos(angle), math.sin(angle)])
    arcs = [Arc(start, -start, np.zeros(2), "ccw"), Arc(-start, start, np.zeros(2), "ccw")]
    analysis = look(make_path(arcs, FEED, closed=True), make_machine())
    plan = make_plan(analysis, MOVING)
    number = plan.phases[0].window
    assert number == plan.phases[-1].window >= 0
    found = plan.profiles[number]
    assert plan.phases[-1].s == pytest.approx(analysis.track.length + 1.0 * MM - found.s_star, abs=1e-12)
    s, feed = place_and_feed(plan.phases, np.linspace(0.0, plan.phases[0].duration, 2001))
    assert s[np.argmin(feed)] == pytest.approx(1.0 * MM, abs=1e-5)
    # The nearest of 2001 instants is within 1/4000 of the duration, where V'' / V = 160 in a dip to 1/4.
    assert feed.min() == pytest.approx(0.25 * FEED, rel=1e-5)
    assert plan.phases[0].speed[0] == pytest.approx(plan.phases[-1].speed[-1], rel=1e-12)


def test_own_duration_ratio_and_degree() -> None:
    options = PlanOptions(strategy="suppress", start="moving", ratio=0.4, degree=6, t_star=0.3)
    plan = make_plan(ring(), options)
    for found in plan.profiles:
        assert found.coefficients.size == 7
        assert found.t_star == pytest.approx(0.3, rel=1e-9)
        assert found.ratio == pytest.approx(0.4, rel=1e-12)


def test_own_coefficients() -> None:
    values = (1.0, 1.0, 0.5, 0.0, 0.5, 1.0, 1.0)
    plan = make_plan(ring(), PlanOptions(strategy="suppress", start="moving", coefficients=values))
    for found in plan.profiles:
        assert found.coefficients.tolist() == list(values)


def test_own_duration_may_leave_the_window_and_it_is_said() -> None:
    # Half a NURBS ellipse-like arch: its windows at 0.1 µm are short.
    curve = Nurbs(2, [0, 0, 0, 1, 1, 1], [(0, 0), (0.03, 0.06), (0.06, 0)])
    analysis = look(make_path([curve], FEED), make_machine(), tolerance=1e-7)
    window = analysis.windows[0]
    plan = make_plan(analysis, PlanOptions(strategy="suppress", t_star=0.6))
    found = plan.profiles[0]
    assert found.s_star > window.half_length
    assert any("longer than the window" in note for note in found.notes)
    assert told(plan, "longer than the window")


def test_the_window_bounds_the_default_and_a_short_one_is_noted() -> None:
    curve = Nurbs(2, [0, 0, 0, 1, 1, 1], [(0, 0), (0.03, 0.06), (0.06, 0)])
    analysis = look(make_path([curve], FEED), make_machine(jerk=1e4, acceleration=50.0), tolerance=1e-10)
    plan = make_plan(analysis, PlanOptions(strategy="suppress"))
    found = plan.profiles[0]
    assert found.s_star == analysis.windows[0].half_length
    assert found.t_star < durations(analysis)[0]
    assert told(plan, "less than the backlash interval")


def test_cycle_time_bounds_the_depth_unless_the_user_chose_it() -> None:
    analysis = ring()
    plan = make_plan(analysis, PlanOptions(strategy="suppress", start="moving", max_slowdown=0.01))
    growth = cycle_time(plan.phases) / cycle_time(plan.nominal)
    assert growth == pytest.approx(1.01, rel=1e-6)
    assert growth <= 1.01 * (1.0 + 1e-9)
    assert len({round(ratio, 9) for ratio in dips(plan)}) == 1
    assert 0.25 < dips(plan)[0] < 1.0
    assert told(plan, "softened for a cycle time at most 1 % longer: V(1/2)/V_c = ")
    free = make_plan(analysis, PlanOptions(strategy="suppress", start="moving", max_slowdown=0.01, ratio=0.25))
    assert cycle_time(free.phases) > 1.01 * cycle_time(free.nominal)
    none = make_plan(analysis, PlanOptions(strategy="suppress", start="moving", max_slowdown=0.0))
    assert dips(none) == [None] * 4
    assert cycle_time(none.phases) == pytest.approx(cycle_time(none.nominal), rel=1e-12)
    assert told(none, "nothing worth having is left by a cycle time at most 0 % longer")


def test_least_feed() -> None:
    analysis = ring()
    plan = make_plan(analysis, PlanOptions(strategy="suppress", start="moving", min_feed=0.6 * FEED))
    assert dips(plan) == pytest.approx([0.6] * 4, rel=1e-6)
    feed = place_and_feed(plan.phases, np.linspace(0.0, cycle_time(plan.phases), 20001))[1]
    assert feed.min() >= 0.6 * FEED * (1.0 - 1e-12)
    assert told(plan, "softened for the least feed")
    none = make_plan(analysis, PlanOptions(strategy="suppress", start="moving", min_feed=FEED))
    assert dips(none) == [None] * 4
    assert told(none, "nothing worth having is left by the least feed")


def test_retrograde_only_where_allowed() -> None:
    with pytest.raises(InputError, match=r"--ratio: the feed would become negative; expected V >= 0"):
        make_plan(ring(), PlanOptions(strategy="suppress", ratio=-0.4))
    analysis = ring()
    plan = make_plan(analysis, PlanOptions(strategy="suppress", ratio=-0.4, allow_retrograde=True))
    command = sample(plan, analysis.track, 1e-3)
    assert command.feed.min() == pytest.approx(-0.4 * FEED, rel=1e-3)
    assert (np.diff(command.s) < 0.0).any()
    assert check_command(command, plan.machine) == ()
    # On the seam the motion would have to begin backwards.
    moving = make_plan(analysis, PlanOptions(strategy="suppress", start="moving", ratio=-0.4, allow_retrograde=True))
    assert dips(moving)[0] is None
    assert told(moving, "turning point #0: left alone: the feed would become negative on the seam")


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (PlanOptions(strategy="suppress", degree=5), "--degree: not a degree"),
        (
            PlanOptions(strategy="suppress", coefficients=(1, 1, -2, 1, 1)),
            "--coefficients: the feed would become negative",
        ),
        (PlanOptions(strategy="suppress", coefficients=(1, 1, 0, 1, 1), ratio=0.3), "given twice"),
        (
            PlanOptions(strategy="suppress", coefficients=(1, 1, 0, 1, 1), degree=6),
            "of another degree; expected 4; got 6",
        ),
        (PlanOptions(strategy="suppress", ratio=-2.0, allow_retrograde=True), "would not get through"),
        (
            PlanOptions(strategy="dance"),
            "no such strategy; expected auto or dwell or fly or linear or none or retrograde or step or suppress"
            " or takeup",
        ),
    ],
)
def test_options_that_contradict_each_other(options: PlanOptions, words: str) -> None:
    with pytest.raises(InputError, match=words.replace("(", r"\(")):
        make_plan(ring(), options)


def test_limits_soften_a_profile_or_leave_it_out() -> None:
    hard = make_plan(ring(), MOVING)
    analysis = ring(jerk=2.0)
    soft = make_plan(analysis, MOVING)
    assert all(0.25 < ratio < 1.0 for ratio in dips(soft))
    assert told(soft, "softened for the limits of the axes: V(1/2)/V_c = ")
    command = sample(soft, analysis.track, 1e-3)
    assert check_command(command, soft.machine) == ()
    # As deep as the limit lets it: what a dip asks of the tangential axis is nearly all of it.
    jerk = np.abs(np.diff(command.position, 3, axis=0)).max() / 1e-9
    assert 0.9 * 2.0 < jerk <= 2.0
    none = make_plan(ring(jerk=0.05), MOVING)
    assert dips(none) == [None] * 4
    assert told(none, "every profile worth having breaks a limit of the axes")
    assert cycle_time(hard.phases) > cycle_time(soft.phases) > cycle_time(none.phases)


def test_a_ramp_from_rest_shortens_a_profile_or_leaves_no_room() -> None:
    # A quarter circle and on: the turning point comes `before` mm after the start from rest.
    def arch(before: float) -> Plan:
        angle = math.pi / 2 - before * MM / 0.02
        start = 0.02 * np.array([math.cos(angle), math.sin(angle)])
        arc = Arc(start, np.array([-0.02, 0.0]), np.zeros(2), "ccw")
        return make_plan(
            look(make_path([arc], FEED), make_machine(jerk=20.0)), PlanOptions(strategy="suppress", t_star=0.1)
        )

    far, near, nearer, none = arch(15.0), arch(1.8), arch(1.2), arch(0.05)
    assert far.profiles[0].t_star == pytest.approx(0.1, rel=1e-9)
    assert 0.0 < near.profiles[0].s_star < far.profiles[0].s_star
    assert told(near, "profile shortened from ")
    assert told(nearer, " in place of 100 ms")
    for plan in (far, near, nearer, none):
        assert plan.phases[0].speed[0] == 0.0
    assert none.profiles[0] is None or none.profiles[0].s_star < 0.05 * MM


def test_an_axis_without_a_gap_is_left_alone() -> None:
    none = Gap(lost_motion=0.0, motor_angle=0.0, gear_ratio=1.0, travel_per_rad=1e-3, inertia_fraction=0.5, beta=1.0)
    plan = make_plan(ring(gap=none), MOVING)
    assert dips(plan) == [None] * 4
    assert told(plan, "turning points #0, #2: left alone: no backlash on X")


def test_open_loops_are_warned_of_the_offset_that_stays() -> None:
    for feedback in ("motor", "none"):
        plan = make_plan(ring(feedback=feedback), MOVING)
        assert any(ratio is not None for ratio in dips(plan))
        assert told(plan, "axes X, Y have no scale on the table")
        assert told(plan, "modulated feed does not shrink that")
    assert not told(make_plan(ring(), MOVING), "no scale")


def test_a_plan_needs_a_machine() -> None:
    analysis = msgspec.structs.replace(ring(), machine=None)
    with pytest.raises(InputError, match="needs a machine"):
        make_plan(analysis, PlanOptions(strategy="suppress"))


class Halve:
    """A strategy as somebody else might write it."""

    name = "halve"
    summary = "half the feed in every window"
    feedbacks = frozenset({"load"})

    def profiles(self, task: PlanningTask) -> StrategyResult:
        half = profile.dip(0.5, 4)
        return StrategyResult(
            requests=tuple(ProfileRequest(shape=half) for _ in task.windows), warnings=("mind the gap",)
        )


class Entry:
    name = "halve"

    def __init__(self, what: object) -> None:
        self.what = what

    def load(self) -> object:
        return self.what


def test_a_strategy_of_somebody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: [Entry(Halve())])
    names = ("auto", "dwell", "fly", "halve", "linear", "none", "retrograde", "step", "suppress", "takeup")
    assert registry.strategy_names() == names
    analysis = ring(jerk=1e4)
    plan = make_plan(analysis, PlanOptions(strategy="halve", start="moving", max_slowdown=1.0))
    assert plan.strategy == "halve"
    assert dips(plan) == pytest.approx([0.5] * 4)
    assert plan.warnings[0] == "mind the gap"
    # Without a duration of its own a wish takes the whole window.
    assert [found.s_star for found in plan.profiles] == pytest.approx([w.half_length for w in analysis.windows])


def test_what_is_no_strategy_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: [Entry("a string")])
    with pytest.raises(InputError, match="is no strategy; expected a Strategy; got str"):
        registry.find_strategy("halve")
