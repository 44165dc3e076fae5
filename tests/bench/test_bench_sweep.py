"""10,000 pairs of β and C in one call, against the scalar solution called for each of a sample of them."""

from __future__ import annotations

import math
import sys
import time

import numpy as np

from ph_post.drive.machinefile import read_machine
from ph_post.drive.steady_state import find_orbit, steady_intervals, with_motor

AIM = 10
SAMPLE = 20


def test_a_grid_is_solved_many_times_faster_than_pair_by_pair() -> None:
    axis = read_machine("paper").axes["X"]
    swing = (0.25, math.pi / 6.0)
    beta, gain = np.linspace(0.5, 2.0, 100), np.linspace(1e5, 2e5, 100)
    steady_intervals(axis.servo, axis.gap, *swing, beta[:2], gain[:2])
    find_orbit(axis.servo, axis.gap, *swing)  # both warm
    start = time.perf_counter()
    steady_intervals(axis.servo, axis.gap, *swing, beta, gain)
    ours = (time.perf_counter() - start) / (beta.size * gain.size)
    start = time.perf_counter()
    for one in gain[:SAMPLE].tolist():
        find_orbit(axis.servo, with_motor(axis.servo, axis.gap, 1.0, one), *swing)
    theirs = (time.perf_counter() - start) / SAMPLE
    figures = f"{ours * 1e6:.1f} us a pair, {theirs * 1e6:.0f} us pair by pair"
    sys.stderr.write(f"\n{figures}: {theirs / ours:.0f} times faster\n")
    assert theirs / ours > AIM
