"""Crossings without a stop in tables, judged by an axis with ideal backlash of the test's own."""

from __future__ import annotations

import numpy as np
import pytest

import ph_post as ph
from ph_post.errors import InputError


def behind(motor: np.ndarray, lost: float, table: float) -> np.ndarray:
    """Positions of a table that its motor pushes from either side of its backlash, at first at `table`."""
    found = np.empty_like(motor)
    for row, x in enumerate(motor):
        table = min(max(table, x - 0.5 * lost), x + 0.5 * lost)
        found[row] = table
    return found


@pytest.fixture(scope="module")
def circle():
    return ph.compensate("circle", "stepper", output="table", strategy="fly", effort=0.1)


@pytest.mark.parametrize("sides", [(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)])
def test_the_table_stays_on_the_circle_and_never_stops(circle, sides):
    command = circle.table()
    machine, on_path = circle.machine, command.t >= 0.0
    lost = [machine.axes[name].gap.lost_motion for name in command.axes]
    table = [
        behind(column, gap, column[0] + side * gap)
        for column, gap, side in zip(command.position.T, lost, sides, strict=True)
    ]
    away = np.abs(np.hypot(*table) - 0.25)[on_path]
    # Untouched it is half of the larger backlash off, 40 µm.
    assert away.max() < 2e-6
    assert circle.after.error.max == pytest.approx(away.max(), rel=0.02)
    moving = (command.t > 1.0) & (command.t < command.t[-1] - 1.0)
    assert command.feed[moving].min() > 0.19 * command.feed.max()
    assert circle.before.error.max == pytest.approx(40e-6, rel=0.02)


def test_programs_that_cannot_be_edited_and_loops_with_the_backlash_inside_are_refused():
    with pytest.raises(InputError, match="programs of siemens cannot be changed by lines, and cross backlash at stops"):
        ph.compensate("oval", "stepper", dialect="siemens", strategy="fly").program()
    with pytest.raises(InputError, match="fly does not compensate axes with these feedback loops"):
        ph.compensate("circle", "mill", output="table", strategy="fly")
