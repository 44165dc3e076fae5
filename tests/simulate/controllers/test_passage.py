"""When and how fast a program passes its places: from rest to rest by hand, and about a corner."""

from __future__ import annotations

import math

import numpy as np
import pytest
from support.corpus import stepper

from ph_post.dialects.reading import read_as
from ph_post.simulate.controllers.run import planned_passage


@pytest.mark.parametrize("dialect", ["grbl", "marlin"])
def test_a_line_from_rest_to_rest(dialect: str) -> None:
    machine = stepper(dialect)
    push, feed = machine.axes["X"].limits.acceleration, 0.03
    passage = planned_passage(read_as(dialect, b"G21\nG90\nG0 X0 Y0\nG1 X100 F1800\n", "part.gcode"), machine)
    ramp, lasts = feed**2 / (2.0 * push), 0.1 / feed + feed / push
    assert ramp < 0.04
    places = np.array([0.0, 0.3 * ramp, ramp, 0.05, 0.1 - 0.3 * ramp])
    time, speed = passage.at(places)
    early = math.sqrt(2.0 * 0.3 * ramp / push)
    by_hand = [0.0, early, feed / push, 0.5 * lasts, lasts - early]
    assert time - time[0] == pytest.approx(by_hand, abs=1e-9)
    assert speed == pytest.approx([0.0, early * push, feed, feed, early * push], abs=1e-9)


def test_a_right_angle_and_the_ramps_beside_it() -> None:
    machine = stepper("grbl")
    push = np.array([machine.axes[name].limits.acceleration for name in "XY"])
    passage = planned_passage(read_as("grbl", b"G21\nG90\nG0 X0 Y0\nG1 X50 F6000\nY50\n", "part.nc"), machine)
    time, speed = passage.at(np.array([0.049, 0.05, 0.051]))
    # Grbl's rule: v^2 = a d sin(t/2) / (1 - sin(t/2)), d = 0.01 mm, and a along the bisector by the slower axis.
    half = math.sqrt(0.5)
    corner = math.sqrt(push.min() / half * 1e-5 * half / (1.0 - half))
    beside = np.sqrt(corner**2 + 2.0 * push * 1e-3)
    assert speed == pytest.approx([beside[0], corner, beside[1]], rel=1e-6)
    assert np.diff(time) == pytest.approx((beside - corner) / push, rel=1e-6)
