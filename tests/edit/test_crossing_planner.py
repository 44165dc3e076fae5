"""One crossing at one place, without a program around it that has time for others."""

import numpy as np
import pytest

from ph_post.edit.crossing_shapes import BALANCED, OUTWARD, CrossingShape
from ph_post.edit.crossings import CrossingPlace, CrossingPlanner
from ph_post.gcode.motion_parts import places_along
from ph_post.gcode.read import read_program

LOST = 5e-5


@pytest.mark.parametrize("kind", [BALANCED, OUTWARD])
def test_a_rest_that_has_just_the_room_is_enough(kind: int) -> None:
    """A bore's last turn is level and left by an arc: the window of the crossing is the rest between the two."""
    text = b"G21 G90 G17\nG0 X0 Y0 Z0\nG1 X1 Z-0.5 F300\nX1.159\nX1.2 Z-0.49\nX1.24 Z-0.45\nX1.26 Z-0.4\nM2\n"
    motions = read_program(text, "a.ngc").motions
    along = places_along(motions)
    low, high = float(along[2]), float(along[3])
    shape = CrossingShape(
        first=0.0316, wait=0.0537, beyond=0.0, steps=3, ramp=0.0258, least=0.004, fewest=2, push=0.1, arcs=None
    )
    spot = CrossingPlace(
        column=2,
        sign=1,
        rest=(low, high),
        chosen=low,
        bound=(low, high),
        before=np.zeros(3),
        after=np.array([0.0, 0.0, LOST]),
        shape=shape,
        lag=0.0,
        feed=0.005,
        calm=False,
    )
    planner = CrossingPlanner(motions, along, np.ones(motions.kind.size, dtype=bool), 0.004)
    made = planner.plan(spot, np.array([low, high, 0.00296, 0.0, float(kind)]))
    assert made is not None
    assert {part.motion for part in made.parts} == {2}
    assert made.error < 1e-9


def test_a_crossing_does_not_leave_out_a_corner_of_the_path() -> None:
    """An arc of a print goes on from a line nearly across it, and the table of blocks about the corner is held before.

    No place of it was farther from the path than 24.1 µm, but the corner was 26.8 µm from the table: 25 µm are allowed.
    """
    text = b"G21 G90 G17\nG1 X106.768 Y112.459 Z1 F2400\nY109.958\nG3 X107.615 Y110.064 I0.289 J1.128\nM2\n"
    motions = read_program(text, "a.ngc").motions
    along = places_along(motions)
    at = float(along[2]) + 2.9206e-4
    spot = CrossingPlace(
        column=1,
        sign=1,
        rest=(at, at),
        chosen=at,
        bound=(at - 1.57e-3, float(along[3])),
        before=np.array([0.5 * LOST, -0.5 * LOST, 0.0]),
        after=np.array([0.5 * LOST, 0.5 * LOST, 0.0]),
        shape=CrossingShape(first=0.03162, wait=0.03162, least=0.002, turn=0.0019),
        lag=0.0,
        feed=0.04,
        calm=False,
    )
    planner = CrossingPlanner(motions, along, np.ones(motions.kind.size, dtype=bool), 0.004, 1e-7)
    assert planner.plan(spot, np.array([at - 2.593e-4, at + 2.592e-4, 0.0164, 1.4375e-5, float(BALANCED)])) is None
