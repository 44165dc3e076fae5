"""The judge of programs, on paths whose distances are plain to see."""

from __future__ import annotations

import numpy as np
import pytest

from .program_judge import Stretches, windows

BESIDE = "G21 G0 X0 Y0 Z5\nG1 X50 F600\nY0.05\nX0\nG0 Z9\n"
"""There and back, 0.05 mm apart."""


@pytest.mark.parametrize(("rows", "expected"), [(0, 0.04), (30, 0.01)])
def test_a_table_is_held_against_the_lines_on_which_it_may_be(rows: int, expected: float) -> None:
    """0.04 mm beside the line that it comes back on; on the way there only where it may be so late."""
    path = Stretches(BESIDE, np.zeros(3))
    cut = path.line_run[2]
    lines = np.repeat([2, 3, 4], 10)
    window = windows(BESIDE, path, lines, np.full(lines.size, cut), rows, 0.2)
    places = np.tile([25.0, 0.01, 5.0], (lines.size, 1))
    found = path.distances(places, np.full(lines.size, cut), window)
    np.testing.assert_allclose(found[20:], expected, atol=1e-12)
    np.testing.assert_allclose(found[:10], 0.01, atol=1e-12)
