"""What a motion costs, against cases told by hand."""

import math

import numpy as np
import pytest

from ph_post.analysis.path_analysis import analyse
from ph_post.compensate.comparison import cost_of, slowest_feed
from ph_post.compensate.offsets import command_of
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.files.storage import or_shipped

CUTTING = np.ones(9, dtype=np.bool_)


@pytest.mark.parametrize(
    ("feed", "lowest"),
    [
        ([0, 1, 2, 3, 3, 3, 2, 1, 0], 3),
        ([0, 1, 3, 2, 1, 2, 3, 1, 0], 1),
        ([0, 2, 3, 1, 0, 0, 1, 3, 0], 3),
        ([3, 3, 2, 3, 3, 3, 3, 3, 3], 2),
        ([3, 2, -1, -2, -1, 2, 3, 3, 3], -2),
        ([1, 2, 3, 4, 4, 4, 4, 4, 4], 1),
        ([0, 1, 2, 3, 4, 3, 2, 1, 0], 4),
    ],
)
def test_slowest_feed_leaves_out_standstills_and_their_ramps(feed, lowest):
    assert slowest_feed(np.array(feed, dtype=float), CUTTING) == lowest


def test_slowest_feed_leaves_out_what_is_no_cut():
    feed = np.array([4.0, 4.0, 1.0, 1.0, 4.0, 3.0, 4.0, 4.0, 4.0])
    cutting = feed != 1.0
    assert slowest_feed(feed, cutting) == 3.0
    assert slowest_feed(feed, np.zeros(9, dtype=np.bool_)) is None


def planned(path, machine, **options):
    analysis = analyse(read_path(or_shipped("paths", path)), read_machine(machine), 5e-6)
    plan = make_plan(analysis, PlanOptions(**{"strategy": "suppress", **options}))
    return cost_of(plan, command_of(plan, analysis.track, plan.machine.servo_period), analysis.track)


def test_the_circle_at_constant_feed():
    # V = 250 π / 6 mm/s on a radius of 250 mm: the axes swing with V²/ρ, sampled as its second difference.
    pace = planned("circle", "paper", strategy="none", start="moving")
    speed, radius, omega, h = 0.25 * math.pi / 6, 0.25, math.pi / 6, 1e-3
    assert pace.min_feed == pytest.approx(speed, rel=1e-9)
    assert (pace.standstill_time, pace.retrograde) == (0.0, False)
    assert pace.cycle_time == pytest.approx(12.0, rel=1e-9)
    assert pace.peak_acceleration == pytest.approx(2 * radius * (1 - math.cos(omega * h)) / h**2, rel=1e-6)


def test_ramps_from_and_to_rest_do_not_count_in_phases_of_their_own():
    # The feed is 1200 mm/min all along, and a dip goes no lower than it is allowed to; ramps pass every feed.
    assert planned("oval", "mill", strategy="none").min_feed == pytest.approx(0.02, rel=1e-9)
    dip = planned("oval", "mill", strategy="suppress", min_feed=0.015)
    assert dip.min_feed == pytest.approx(0.015, rel=1e-6)


def test_a_dip_a_stop_and_a_pass_backwards():
    speed = 0.25 * math.pi / 6
    given = {"start": "moving", "t_star": 0.5, "max_slowdown": 1.0}
    dip = planned("circle", "paper", strategy="suppress", ratio=0.4, **given)
    assert dip.min_feed == pytest.approx(0.4 * speed, rel=1e-9)
    back = planned("circle", "paper", strategy="suppress", ratio=-0.3, allow_retrograde=True, **given)
    assert back.min_feed == pytest.approx(-0.3 * speed, rel=1e-9)
    assert back.retrograde
    stop = planned("circle", "paper", strategy="dwell", start="moving", max_slowdown=1.0)
    assert stop.min_feed == pytest.approx(speed, rel=1e-9)
    # Four holds of the settled interval, 0.11874297 s (PAPER_NOTES).
    assert stop.standstill_time == pytest.approx(4 * 0.11874297, abs=1e-6)
