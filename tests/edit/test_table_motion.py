"""Tables that wait while their motor is in the backlash, beside the same worked out with NumPy."""

import numpy as np
import pytest

from ph_post.edit.crossing_shapes import points_along
from ph_post.edit.reversals import motion_view
from ph_post.edit.table_motion import follow_table
from ph_post.gcode.motion_parts import places_along
from ph_post.gcode.read import read_program

SAMPLES = 41
TEXT = b"G21 G90 G17 F600\nG0 X0 Y0 Z0\nG1 X10 Y2\nG3 X6 Y6 I-4\nG1 X2 Y7\nG2 X0 Y9 I2 J1.5\nM2\n"


def waits(motor, low, high, held):
    """Where the table of an axis is while its motor goes on: within the backlash it stays."""
    places = []
    for place in motor:
        held = min(max(held, place - high), place - low)
        places.append(held)
    return places


@pytest.mark.parametrize("seed", range(30))
def test_the_table_waits_in_the_backlash(seed):
    rng = np.random.default_rng(seed)
    motions = read_program(TEXT, "a.ngc").motions
    along, view = places_along(motions), motion_view(motions)
    knots = np.sort(rng.uniform(0.1, 0.9, rng.integers(2, 7))) * along[-1]
    added = rng.normal(0.0, 3e-5, (knots.size, 3))
    line = rng.random(knots.size) < 0.5
    points = points_along(view, along, knots) + added
    column, before = int(rng.integers(2)), rng.normal(0.0, 2e-5, 3)
    after = -before[column]
    s, path, table, error, ahead = follow_table(view, along, knots, added, line, points, column, before, after, SAMPLES)
    np.testing.assert_array_equal(s, np.unique([*np.linspace(knots[0], knots[-1], SAMPLES), *knots]))
    np.testing.assert_array_equal(path, points_along(view, along, s))
    motor = path + np.stack([np.interp(s, knots, one) for one in added.T], axis=1)
    for n in np.flatnonzero(line[1:]) + 1:
        inside = (s >= knots[n - 1]) & (s <= knots[n])
        share = (s[inside] - knots[n - 1]) / (knots[n] - knots[n - 1])
        motor[inside] = points[n - 1] + share[:, None] * (points[n] - points[n - 1])
    expected = motor - before
    low, high = sorted((before[column], after))
    expected[:, column] = waits(motor[:, column], low, high, motor[0, column] - before[column])
    np.testing.assert_allclose(table, expected, rtol=0.0, atol=1e-15)
    tangent = np.gradient(path, s, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    off = table - path
    along_it = (off * tangent).sum(axis=1)
    assert error == pytest.approx(np.linalg.norm(off - along_it[:, None] * tangent, axis=1).max(), rel=1e-9)
    bend = (off * np.gradient(tangent, s, axis=0)).sum(axis=1)
    np.testing.assert_allclose(ahead, along_it / (1.0 - bend), rtol=1e-9, atol=1e-15)
