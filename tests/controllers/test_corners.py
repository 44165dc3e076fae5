"""Corners on a real LinuxCNC: exact and rounded programs of a path beside the controller's own path modes."""

from __future__ import annotations

import pytest
from support.corner_runs import JERK, drawn_program, judged, planned_program, planned_rows, rates, run
from support.rehearsing import HERE, WHY_NOT

pytestmark = [pytest.mark.skipif(not HERE, reason=WHY_NOT), pytest.mark.slow]

WITHIN = 0.02
"""Tolerance [mm]."""

WRITTEN = 2.0
"""What chords and rounded joints of a program may add [µm]: its head says so."""


@pytest.mark.parametrize(("angle", "feed"), [(90.0, 1200.0), (90.0, 3000.0), (135.0, 1200.0)])
@pytest.mark.thinned(8)
def test_rounded_corners_stay_within_the_tolerance_and_are_as_quick_as_the_controllers_own(
    angle: float, feed: float
) -> None:
    straight = run(drawn_program(0.0, feed, "G61.1"))
    stop = judged(run(drawn_program(angle, feed, "G61.1")), straight, angle)
    own = judged(run(drawn_program(angle, feed, f"G64 P{WITHIN}")), straight, angle)
    written = judged(run(planned_program(angle, feed, WITHIN)), run(planned_program(0.0, feed, None)), angle)
    line = planned_rows(0.0, feed, None)
    exact = judged(planned_rows(angle, feed, None), line, angle)
    rows = planned_rows(angle, feed, WITHIN)
    rounded = judged(rows, line, angle)
    assert max(stop.off, exact.off, exact.passed) < 0.1
    assert rounded.off <= 1e3 * WITHIN
    assert rounded.passed <= 1e3 * WITHIN + 0.2, "samples beside the corner"
    assert written.off <= 1e3 * WITHIN, "the contour on the controller"
    assert written.passed <= 1e3 * WITHIN + WRITTEN
    assert rounded.lost < 0.75 * exact.lost
    assert rounded.lost <= own.lost, "with a twelfth of the controller's jerk"
    assert rates(rows)[1] <= JERK
    assert own.passed == pytest.approx(1e3 * WITHIN, abs=0.5), "the controller's tolerance is the same"
