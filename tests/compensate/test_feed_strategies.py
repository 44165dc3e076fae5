"""The strategies dwell, retrograde and linear: what they ask for, what comes of it, and what they say."""

from __future__ import annotations

import json
import math
from itertools import pairwise

import numpy as np
import pytest
from click.testing import CliRunner
from support.interpreter import run
from support.motions import MM, assert_continuous, circle, look, make_machine, make_path
from support.plans import make_plan as plan_by_hand

from ph_post.analysis.path_analysis import Analysis
from ph_post.cli.main import cli
from ph_post.compensate import profile, shapes
from ph_post.compensate.motion import cycle_time, place_and_feed, sample
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.strategies.base import PlanningTask, ProfileRequest, StrategyResult
from ph_post.compensate.violations import check_command
from ph_post.dialects.registry import find_dialect
from ph_post.errors import InputError
from ph_post.geometry.curves import Arc
from ph_post.post.program import make_program
from ph_post.report.views import profile_view
from ph_post.types import Phase, Plan, ProfileShape

RADIUS, FEED = 0.05, 0.02


def ring(**machine) -> Analysis:
    return look(circle(RADIUS, FEED), make_machine(**machine))


def planned(analysis: Analysis, strategy: str, **options) -> Plan:
    return make_plan(analysis, PlanOptions(strategy=strategy, **{"max_slowdown": 1.0} | options))


def told(plan: Plan, words: str) -> bool:
    return any(words in warning for warning in plan.warnings)


def holds(plan: Plan) -> list[Phase]:
    return [phase for phase in plan.phases if phase.window >= 0 and not np.any(phase.speed)]


def test_the_tool_stands_at_every_turning_point_for_the_backlash_interval() -> None:
    analysis = ring()
    plan = planned(analysis, "dwell")
    assert plan.profiles[0] is None  # the motion begins there
    for hold, point in zip(holds(plan), analysis.turning_points[1:], strict=True):
        assert hold.s == pytest.approx(point.s, abs=1e-15)
        assert hold.duration == pytest.approx(analysis.intervals[point.index].duration, rel=1e-12)
    assert_continuous(plan, analysis.track.length)
    command = sample(plan, analysis.track, 1e-3)
    assert check_command(command, plan.machine) == ()
    still = command.feed == 0.0
    assert still.sum() * 1e-3 == pytest.approx(sum(hold.duration for hold in holds(plan)), abs=5e-3)
    assert np.ptp(command.position[still & (command.window == 1)], axis=0).max() == 0.0


def test_stops_take_half_of_their_ramps_and_their_hold_longer() -> None:
    plan = planned(ring(), "dwell", start="moving")
    extra = 0.0
    for found in plan.profiles:
        down, hold, up = (piece.share * 2.0 * found.t_star for piece in found.shape.pieces)
        extra += hold + 0.5 * (down + up)
        assert found.s_star == pytest.approx(0.25 * FEED * (down + up), rel=1e-12)
    assert cycle_time(plan.phases) - cycle_time(plan.nominal) == pytest.approx(extra, rel=1e-9)


def test_ramps_leave_half_of_the_limits_to_the_bend() -> None:
    analysis = ring(jerk=4.0)
    plan = planned(analysis, "dwell")
    found = plan.profiles[1]
    ramp = found.shape.pieces[0].share * 2.0 * found.t_star
    # The second derivative of I_τ(4, 4) is at most 420 x² (1 - x)² (1 - 2x) at 1 - 2x = 1/√5.
    peak = 420.0 * (0.25 * 0.8) ** 2 / math.sqrt(5.0)
    assert FEED * peak / ramp**2 == pytest.approx(0.5 * 4.0, rel=1e-9)
    assert found.ratio == 0.0
    command = sample(plan, analysis.track, 1e-3)
    assert 0.45 * 4.0 < np.abs(np.diff(command.position, 3, axis=0)).max() / 1e-9 <= 4.0


def test_the_user_may_say_how_long_a_stop_lasts() -> None:
    analysis = ring()
    plan = planned(analysis, "dwell", t_star=0.4)
    for found in plan.profiles[1:]:
        assert found.t_star == pytest.approx(0.4, rel=1e-9)
    durations = [hold.duration for hold in holds(plan)]
    expected = [interval.duration for interval in analysis.intervals[1:]]
    assert durations == pytest.approx(expected, rel=1e-9)


def test_a_stop_on_the_seam_is_held_where_the_motion_begins() -> None:
    """It ends where it has come to rest on the seam, and begins with the whole hold."""
    analysis = ring()
    plan = planned(analysis, "dwell", start="moving")
    first, last = plan.phases[0], plan.phases[-1]
    assert first.window == last.window == 0
    assert not np.any(first.speed)
    assert [last.speed[0], last.speed[-1]] == [FEED, 0.0]
    assert first.duration == pytest.approx(analysis.intervals[0].duration, rel=1e-9)
    assert first.s == 0.0
    # The mean of Bernstein coefficients is the mean of the speed.
    way = last.duration * float(np.mean(last.speed))
    assert last.s + way == pytest.approx(analysis.track.length, abs=1e-14)
    assert_continuous(plan, analysis.track.length)
    assert check_command(sample(plan, analysis.track, 1e-3), plan.machine) == ()


@pytest.mark.parametrize("before", [1.0, 0.4, -0.4])
def test_a_seam_beside_the_turning_point_cuts_a_ramp(before: float) -> None:
    angle = -before * MM / RADIUS
    start = RADIUS * np.array([math.cos(angle), math.sin(angle)])
    arcs = [Arc(start, -start, np.zeros(2), "ccw"), Arc(-start, start, np.zeros(2), "ccw")]
    analysis = look(make_path(arcs, FEED, closed=True), make_machine())
    plan = planned(analysis, "dwell", start="moving", t_star=0.3)
    assert plan.phases[0].window == plan.phases[-1].window >= 0
    point = next(p for p in analysis.turning_points if min(p.s, analysis.track.length - p.s) < 2 * MM)
    hold = next(one for one in holds(plan) if one.window == plan.phases[0].window)
    assert hold.s == pytest.approx(point.s, abs=1e-14)
    assert plan.phases[0].speed[0] == pytest.approx(plan.phases[-1].speed[-1], rel=1e-12)
    assert_continuous(plan, analysis.track.length)
    assert check_command(sample(plan, analysis.track, 1e-3), plan.machine) == ()


@pytest.mark.parametrize("dialect", ["linuxcnc", "grbl"])
@pytest.mark.parametrize("start", ["rest", "moving"])
def test_a_program_stops_at_the_turning_points_waits_and_goes_on(dialect: str, start: str) -> None:
    analysis = ring()
    plan = planned(analysis, "dwell", start=start)
    program = make_program(plan, analysis.track, find_dialect(dialect))
    moves = run(program.text).moves[-program.moves :]
    ends = np.cumsum([move.duration for move in moves])
    assert ends[-1] == pytest.approx(cycle_time(plan.phases), rel=1e-3)
    dwells = [k for k, move in enumerate(moves) if move.word == "G4"]
    quantum = find_dialect(dialect).numbers.quantum / MM
    for k, hold in zip(dwells, holds(plan), strict=True):
        exact = analysis.track.derivatives(*analysis.track.locate(np.array([hold.s])), 0)[0, 0] / MM
        assert np.abs(moves[k].end[:2] - exact).max() <= 0.5001 * quantum
        # With it the time in which the tool is a fraction of a decimal away from there.
        assert hold.duration * (1.0 - 1e-5) <= moves[k].duration
        early = moves[k].duration - hold.duration
        s, _ = place_and_feed(plan.phases, np.array([hold.start - early]))
        assert abs(hold.s - s[0]) <= 0.51 * quantum * MM
        assert ends[k] == pytest.approx(hold.start + hold.duration, rel=1e-3)
    for k in dwells:
        for near in (k - 1, k + 1):
            if 0 <= near < len(moves):
                assert moves[near].feed < 0.05 * FEED * 60.0 / MM


def test_coarse_decimals_keep_the_time() -> None:
    # The same at 3 decimals, where tens of milliseconds of a ramp are less than one.
    analysis = ring()
    plan = planned(analysis, "dwell", t_star=0.5)
    program = make_program(plan, analysis.track, find_dialect("grbl"))
    moves = run(program.text).moves[-program.moves :]
    assert sum(m.duration for m in moves) == pytest.approx(cycle_time(plan.phases), rel=1e-3)


def test_what_a_stop_cannot_do_is_said() -> None:
    assert told(planned(ring(), "dwell"), "a stop does not take up all backlash of X and Y")
    for feedback in ("motor", "none"):
        for strategy in ("dwell", "linear", "retrograde"):
            plan = planned(ring(feedback=feedback), strategy, allow_retrograde=True)
            assert any(plan.profiles)
            assert told(plan, "axes X, Y have no scale on the table")
            assert told(plan, "modulated feed does not shrink that")
            assert not told(plan, "standing still")


def test_limits_make_a_shallow_dip_of_a_stop() -> None:
    analysis = ring(jerk=4.0)
    plan = planned(analysis, "dwell", t_star=0.12)
    for found in plan.profiles[1:]:
        assert 0.0 < found.ratio < 1.0
        assert len(found.shape.pieces) == 3
    assert told(plan, "softened for the limits of the axes: lowest V/V_c = ")
    assert check_command(sample(plan, analysis.track, 1e-3), plan.machine) == ()
    least = planned(ring(), "dwell", min_feed=0.4 * FEED)
    assert [found.ratio for found in least.profiles[1:]] == pytest.approx([0.4] * 3, rel=1e-6)


def test_retrograde_goes_back() -> None:
    analysis = ring()
    plan = planned(analysis, "retrograde", allow_retrograde=True)
    command = sample(plan, analysis.track, 1e-3)
    # Within half a period of the lowest place, where V'' = 160 · 1.3 in units of the duration.
    assert command.feed.min() == pytest.approx(-0.3 * FEED, rel=1e-2)
    assert check_command(command, plan.machine) == ()
    for found in plan.profiles[1:]:
        assert found.coefficients.tolist() == pytest.approx([1] * 5 + [1 - 1.3 * 256 / 63] + [1] * 5)
        point = analysis.turning_points[analysis.windows[found.window].turning_point]
        assert found.t_star == pytest.approx(4.0 * analysis.intervals[point.index].duration, rel=1e-12)
    deeper = planned(analysis, "retrograde", allow_retrograde=True, ratio=-0.4)
    assert [found.ratio for found in deeper.profiles[1:]] == pytest.approx([-0.4] * 3)


def test_the_straight_dip() -> None:
    analysis = ring(jerk=1e4)
    plan = planned(analysis, "linear", ratio=0.4)
    for found in plan.profiles[1:]:
        assert [piece.coefficients.tolist() for piece in found.shape.pieces] == [[1.0, 0.4], [0.4, 1.0]]
        assert found.ratio == 0.4
        phases = [phase for phase in plan.phases if phase.window == found.window]
        assert phases[1].s == pytest.approx(analysis.windows[found.window].s, abs=1e-15)
        assert [phase.duration for phase in phases] == pytest.approx([found.t_star] * 2, rel=1e-15)
    assert planned(analysis, "linear").profiles[1].ratio == 0.25


@pytest.mark.parametrize(
    ("strategy", "options", "words"),
    [
        ("retrograde", {}, r"--strategy: retrograde makes the feed negative; expected --allow-retrograde"),
        ("retrograde", {"allow_retrograde": True, "ratio": 0.2}, "--ratio: nothing retrograde"),
        (
            "retrograde",
            {"allow_retrograde": True, "coefficients": (1, 1, 1, 1, 1)},
            "--coefficients: nothing retrograde",
        ),
        ("dwell", {"ratio": 0.2}, "--ratio: strategy dwell does not take it; expected no --"),
        ("dwell", {"degree": 6}, "--degree: strategy dwell does not take it; expected no --"),
        (
            "linear",
            {"coefficients": (1, 1, 0, 1, 1)},
            "--coefficients: strategy linear does not take it",
        ),
        ("linear", {"ratio": -0.2}, "--ratio: the feed would become negative"),
    ],
)
def test_options_that_do_not_fit(strategy: str, options: dict, words: str) -> None:
    with pytest.raises(InputError, match=words):
        planned(ring(), strategy, **options)


class Wanted:
    """A strategy that wants one shape everywhere."""

    name = "wanted"
    summary = "for the test"
    feedbacks = frozenset({"load"})

    def __init__(self, shape: ProfileShape, turn: float, t_star: float) -> None:
        self.request = ProfileRequest(shape=shape, turn=turn, t_star=t_star)

    def profiles(self, task: PlanningTask) -> StrategyResult:
        return StrategyResult(requests=tuple(self.request for _ in task.windows))


def with_wish(monkeypatch: pytest.MonkeyPatch, shape: ProfileShape, turn: float, start: str = "rest") -> Plan:
    strategy = Wanted(shape, turn, 0.15)
    entry = type("Entry", (), {"name": "wanted", "load": lambda _: strategy})()
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: [entry])
    return planned(ring(), "wanted", start=start)


@pytest.mark.parametrize("start", ["rest", "moving"])
def test_a_hold_stands_at_the_turning_point_however_long_the_ramps(monkeypatch: pytest.MonkeyPatch, start: str) -> None:
    shape = profile.plateau(3.0, 1.0, 1.5, 0.0, 3)
    plan = with_wish(monkeypatch, shape, shapes.share_of_way(shape, 3.5 / 5.5), start)
    places = {point.index: point.s for point in plan.turning_points}
    found = [one for one in plan.profiles if one is not None]
    assert len(found) == (4 if start == "moving" else 3)
    length = ring().track.length
    for hold in holds(plan):
        place = places[plan.windows[hold.window].turning_point]
        assert hold.s % length == pytest.approx(place, abs=1e-13) or hold.s == pytest.approx(length)
    assert_continuous(plan, length)
    for one in found[1:]:
        first = next(phase for phase in plan.phases if phase.window == one.window)
        assert first.s == pytest.approx(plan.windows[one.window].s - 2.0 / 3.0 * 2.0 * one.s_star, abs=1e-14)
        assert one.turn == pytest.approx(2.0 / 3.0)


def test_without_a_word_the_turning_point_lies_in_the_middle_of_the_way(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # Eq. (29): s runs from -s_star to s_star also where the coefficients are not symmetric.
    plan = with_wish(monkeypatch, shapes.single([1.0, 1.0, 0.2, 0.9, 0.6, 1.0, 1.0]), 0.5)
    for one in plan.profiles[1:]:
        phase = next(phase for phase in plan.phases if phase.window == one.window)
        s, _ = place_and_feed(plan.phases, np.array([phase.start, phase.start + phase.duration]))
        centre = plan.windows[one.window].s
        np.testing.assert_allclose(s - centre, [-one.s_star, one.s_star], rtol=0.0, atol=1e-14)


def test_views_list_the_pieces() -> None:
    plan = planned(ring(), "dwell")
    view = profile_view(plan.profiles[1])
    assert view["coefficients"] is None
    assert view["degree"] is None
    assert [piece["coefficients"] for piece in view["pieces"]] == [
        [1.0] * 4 + [0.0] * 4,
        [0.0],
        [0.0] * 4 + [1.0] * 4,
    ]
    assert math.fsum(piece["share"] for piece in view["pieces"]) == pytest.approx(1.0, abs=1e-15)
    plain = profile_view(plan_by_hand(ring().track, speed=FEED, dips=[(0.1, 0.3, 0.2)]).profiles[0])
    assert plain["coefficients"] == plain["pieces"][0]["coefficients"]
    assert (plain["degree"], plain["turn"], plain["pieces"][0]["share"]) == (10, 0.5, 1.0)


@pytest.mark.parametrize("strategy", ["dwell", "linear", "retrograde"])
@pytest.mark.thinned(4)
def test_the_command_line_knows_them(strategy: str, tmp_path) -> None:
    target = tmp_path / "part.ngc"
    allowed = ["--allow-retrograde"] if strategy == "retrograde" else []
    words = ["convert", "oval", "-m", "mill", "--strategy", strategy, *allowed, "--json", "-o", str(target)]
    result = CliRunner().invoke(cli, words)
    assert result.exit_code == 0, result.output
    view = json.loads(result.stdout)
    assert view["strategy"] == strategy
    assert any(window["strategy"] == strategy for window in view["windows"])
    code = target.read_text().splitlines()
    assert (sum(line.startswith("G4 ") for line in code) > 0) == (strategy == "dwell")
    for before, line, after in zip(code, code[1:], code[2:], strict=False):
        if line.startswith("G4 "):
            assert before.startswith("G1 ")
            assert after.startswith("G1 ")


def test_steps_of_a_stop_grow_smoothly() -> None:
    # Deceleration into the hold and acceleration out of it mirror each other in time.
    plan = planned(ring(), "dwell")
    for one, hold in pairwise(plan.phases):
        if hold in holds(plan):
            after = plan.phases[plan.phases.index(hold) + 1]
            np.testing.assert_array_equal(one.speed, after.speed[::-1])
            assert one.duration == pytest.approx(after.duration, rel=1e-14)
