"""Crossings on the fly on a real LinuxCNC, with backlash of the test's own behind its joint commands.

What the controller's own path does to the original, without backlash behind the same drive, is taken off: beyond it a
crossing may cost 1.5 µm, 3 µm where the radius is 2 mm. `tests/long/crossings.py` tries all circles, feeds,
accelerations, backlashes and lags, and many shapes.
"""

from __future__ import annotations

import functools

import numpy as np
import pytest
from long.crossings import EXCESS, Setting, compensated, least_time, recorded, tight
from support.real_cuts import Cut, Measured, measure, program
from support.rehearsing import HERE, WHY_NOT

pytestmark = [pytest.mark.skipif(not HERE, reason=WHY_NOT), pytest.mark.slow]

SMALL = (
    Cut("circle", 1200, True, 20),
    Cut("circle", 3000, True, 20),
    Cut("circle", 1200, False, 5),
    Cut("circle", 1200, True, 2),
    Cut("pocket", 1200, True),
    Cut("ellipse", 1200, False),
    Cut("engraving", 1200, True),
)
WIDE = (Cut("circle", 3000, False, 100), Cut("circle", 600, True, 5), Cut("spline", 1200, True))
# The whole circle is slower than its parts would be, which shows where motors lag.
FAST = (Cut("circle", 3000, True, 5), Cut("circle", 600, False, 20))

# Joints of a crossing that LinuxCNC slows down at show in these most.
LAGGING = (Cut("circle", 600, True, 5), Cut("circle", 1200, False, 20), Cut("ellipse", 1200, True))

JOBS = [
    (SMALL, Setting(0.05, 500.0)),
    (WIDE, Setting(0.1, 2000.0)),
    (SMALL[:1], Setting(0.05, 500.0, 0.010)),
    (LAGGING, Setting(0.1, 2000.0, 0.010)),
    (SMALL[:1], Setting(0.05, 500.0, 0.025)),
    (FAST, Setting(0.05, 500.0, 0.025)),
]


@functools.cache
def run(cuts: tuple[Cut, ...], setting: Setting, how: str) -> np.ndarray:
    text = program(cuts)
    if how == "crossed":
        text = compensated(text, setting)
    return recorded(text, setting, how == "backlash")


def measured(cuts: tuple[Cut, ...], setting: Setting, how: str, lost: float) -> list[Measured]:
    # What the controller commands of the plain program, with its own compensation too, is the same behind any lag.
    commanded = setting if how == "crossed" else setting._replace(lag=0.0)
    return measure(run(cuts, commanded, how), cuts, lost, setting.lag)


@pytest.mark.parametrize(
    ("cuts", "setting"), JOBS, ids=["small", "wide", "lag of 10 ms", "lag and 0.1 mm", "lag of 25 ms", "fast"]
)
@pytest.mark.thinned(4)
def test_a_crossing_costs_a_micrometre_or_two(cuts: tuple[Cut, ...], setting: Setting) -> None:
    own = measured(cuts, setting, "plain", 0.0)
    plain = measured(cuts, setting, "plain", setting.lost)
    theirs = measured(cuts, setting, "backlash", setting.lost)
    done = measured(cuts, setting, "crossed", setting.lost)
    for cut, path, before, controller, after in zip(cuts, own, plain, theirs, done, strict=True):
        assert before.largest > 450.0 * setting.lost, "there is something to compensate"
        assert after.largest <= path.largest + EXCESS[tight(cut)], cut
        assert after.rms <= path.rms + 0.5, cut
        assert after.largest < 0.6 * controller.largest + 0.5 * path.largest, (cut, "better than the controller's own")
        if cut.shape == "circle" and not setting.lag:
            least = 4.0 * least_time(cut, setting, max(after.largest - path.largest, 0.05))
            assert after.time - before.time <= max(0.02 * before.time, 1.3 * least), cut
