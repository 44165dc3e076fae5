"""`auto` on a path of a hundred reversals with scales on the table: at most 20 s on two cores."""

import sys
import time

import numpy as np
from support.motions import make_path, zigzag

from ph_post.analysis.path_analysis import analyse
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.drive.machinefile import read_machine
from ph_post.geometry.curves import Arc, Line

LIMIT = 20.0
WINDOWS = 100
TURNS = 62
"""Corners of a zigzag with as many windows."""


def snake(vary: bool):
    """Half circles joined by lines: one reversal of X in each, at radii that are the same or not."""
    rng, y, curves = np.random.default_rng(5), 0.0, []
    for k in range(WINDOWS):
        r = float(rng.uniform(1e-3, 4e-3)) if vary else 2e-3
        x0, x1 = (0.0, 8e-3) if k % 2 == 0 else (8e-3, 0.0)
        curves.append(Line([(x0, y), (x1, y)]))
        ends = np.array([x1, y]), np.array([x1, y + 2.0 * r])
        curves.append(Arc(*ends, np.array([x1, y + r]), "ccw" if k % 2 == 0 else "cw"))
        y += 2.0 * r
    return make_path(curves, feed=0.02)


def planning_time(path) -> float:
    """The lesser of the time that passes and that of the processor, so that other jobs do not count."""
    analysis = analyse(path, read_machine("mill"), 5e-6)
    assert len(analysis.windows) >= WINDOWS
    start = time.perf_counter(), time.process_time()
    make_plan(analysis, PlanOptions(strategy="auto", inverse_dynamics=True))
    return min(time.perf_counter() - start[0], time.process_time() - start[1])


def test_a_hundred_windows_are_planned_in_time():
    paths = snake(vary=False), snake(vary=True), make_path(zigzag(TURNS, 1), feed=0.02)
    alike, unlike, zigzags = (planning_time(path) for path in paths)
    sys.stdout.write(f"\n{WINDOWS} windows: alike {alike:.1f} s, unlike {unlike:.1f} s, zigzag {zigzags:.1f} s\n")
    assert max(alike, unlike, zigzags) <= LIMIT
