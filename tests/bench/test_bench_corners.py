"""A plan of a polygon of 500 lines with rounded corners, 1,000 segments, against the time that may be waited for."""

import sys
import time

import numpy as np
from support.motions import look, make_path

from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.drive.machinefile import read_machine
from ph_post.geometry.corner_rounding import round_sharp_corners
from ph_post.geometry.curves import Line

LINES = 500
LONGEST = 10.0


def polygon(count: int) -> list[Line]:
    """Chords of a circle of 200 mm radius that are off by 2 % at random."""
    rng, t = np.random.default_rng(5), np.linspace(0.0, 2.0 * np.pi, count + 1)
    radius = 0.2 * (1.0 + 0.02 * rng.uniform(-1.0, 1.0, t.size))
    points = np.stack([radius * np.cos(t), radius * np.sin(t)], axis=1)
    return [Line(points[k : k + 2]) for k in range(count)]


def planning_time(count: int) -> tuple[int, float]:
    """Segments; and the lesser of the time that passes and that of the processor, so that other jobs do not count."""
    path = round_sharp_corners(make_path(polygon(count), 0.03), 5e-5).path
    analysis = look(path, read_machine("mill"))
    start = time.perf_counter(), time.process_time()
    make_plan(analysis, PlanOptions(strategy="none"))
    return len(path.segments), min(time.perf_counter() - start[0], time.process_time() - start[1])


def test_a_thousand_segments_with_rounded_corners_are_planned_in_time() -> None:
    planning_time(5)
    segments, seconds = planning_time(LINES)
    sys.stdout.write(f"\n{segments} segments with rounded corners: {seconds:.2f} s\n")
    assert segments >= 1.9 * LINES
    assert seconds <= LONGEST
