"""Taylor interpolators: the order of their error, and that the exact interpolator has none."""

import numpy as np
import pytest
from support.motions import circle, look, make_machine, make_path
from support.taylor import feed_error, taylor_sample

from ph_post.compensate.motion import sample
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.errors import SolveError
from ph_post.geometry.curves import Bezier, Line

QUINTIC = Bezier(np.array([(0, 0), (10, 15), (25, 20), (30, -10), (40, 0), (45, 10)]) * 1e-3)


def planned(path, options: PlanOptions):
    analysis = look(path, make_machine())
    return analysis.track, make_plan(analysis, options)


def observed_order(errors: list[float]) -> float:
    """Exponent p of error ~ T^p for halved periods."""
    return float(-np.polyfit(np.arange(len(errors)), np.log2(errors), 1)[0])


@pytest.mark.parametrize("start", ["rest", "moving"])
@pytest.mark.parametrize(("order", "expected"), [(1, 1), (2, 2)])
@pytest.mark.thinned(6)
def test_feed_error_falls_with_the_period_as_the_order_says(order: int, expected: int, start: str) -> None:
    track, plan = planned(make_path([QUINTIC], feed=0.04), PlanOptions(strategy="none", start=start))
    errors = []
    for period in (8e-3, 4e-3, 2e-3, 1e-3):
        command = taylor_sample(plan, track, period, order)
        errors.append(float(np.abs(feed_error(command, plan)).max()))
    assert observed_order(errors) == pytest.approx(expected, abs=0.25)


def test_the_exact_interpolator_has_no_feed_error() -> None:
    track, plan = planned(make_path([QUINTIC], feed=0.04), PlanOptions(strategy="none", start="moving"))
    exact = np.abs(feed_error(sample(plan, track, 1e-3), plan)).max()
    first = np.abs(feed_error(taylor_sample(plan, track, 1e-3, 1), plan)).max()
    second = np.abs(feed_error(taylor_sample(plan, track, 1e-3, 2), plan)).max()
    # Two places of a rounding of the path's length each, over a period.
    assert exact <= 16 * 2.0**-52 * track.length / 1e-3
    assert first > 10.0 * second > 1e3 * exact


def test_a_dip_is_followed_too() -> None:
    track, plan = planned(circle(0.05, feed=0.05), PlanOptions(strategy="suppress", start="moving"))
    command = taylor_sample(plan, track, 1e-3, 2)
    assert command.feed.min() < 0.3 * 0.05
    # On a circle σ is constant; what is left out is V'' T² / 6, a sixth of the feed's second difference.
    left_out = np.abs(np.diff(command.feed, 2)).max() / 6.0
    assert np.abs(feed_error(command, plan)).max() == pytest.approx(left_out, rel=0.05)
    # Without the second term V' T / 2 is missing.
    left_out = np.abs(np.diff(command.feed)).max() / 2.0
    first = taylor_sample(plan, track, 1e-3, 1)
    assert np.abs(feed_error(first, plan)).max() == pytest.approx(left_out, rel=0.05)


def test_what_is_left_of_a_step_goes_on_in_the_next_piece() -> None:
    lines = [Line([(k * 0.013, 0.0), ((k + 1) * 0.013, 0.0)]) for k in range(3)]
    track, plan = planned(make_path(lines), PlanOptions(strategy="none", start="moving"))
    command = taylor_sample(plan, track, 1e-3, 1)
    assert command.position[:, 0] == pytest.approx(0.02 * command.t, rel=1e-12)
    assert np.unique(command.segment).tolist() == [0, 1, 2]


def test_no_expansion_where_the_parametric_speed_vanishes() -> None:
    curve = Bezier([(0.0, 0.0), (0.0, 0.0), (0.01, 0.0)])
    track, plan = planned(make_path([curve]), PlanOptions(strategy="none"))
    with pytest.raises(SolveError, match="parametric speed vanishes"):
        taylor_sample(plan, track, 1e-3, 1)
