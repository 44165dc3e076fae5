"""grblHAL: what its splines do to a curve, and programs in its words."""

from __future__ import annotations

import numpy as np
from support.editing import compensate

from ph_post.dialects.grblhal import DIALECT, spline_deviation
from ph_post.drive.machinefile import read_machine


def test_the_deviation_of_a_parabola_is_exact() -> None:
    # x = u, y = u²: chords over a fifth of the parameter are off by 2 · 0.2² / 8 in the middle.
    control = np.array([[[0.0, 0.0], [1 / 3, 0.0], [2 / 3, 1 / 3], [1.0, 1.0]]])
    assert np.allclose(spline_deviation(control), 0.01, rtol=1e-12)


def test_the_deviation_bounds_that_of_chords_of_any_step_grblhal_takes() -> None:
    controls = np.random.default_rng(3).normal(size=(50, 4, 2))
    bound = spline_deviation(controls)
    for steps in (5, 7, 10):
        knots = np.linspace(0.0, 1.0, steps + 1)
        for control, most in zip(controls, bound, strict=True):
            inner = (knots[:-1, None] + np.linspace(0.0, 1.0, 9) / steps).ravel()
            chords = np.stack([np.interp(inner, knots, axis) for axis in _at(control, knots).T], axis=1)
            assert np.linalg.norm(_at(control, inner) - chords, axis=1).max() <= most


def _at(control: np.ndarray, u: np.ndarray) -> np.ndarray:
    v = 1.0 - u
    return np.stack([v**3, 3 * v * v * u, 3 * v * u * u, u**3], axis=1) @ control


def test_a_spline_is_divided_where_an_axis_turns() -> None:
    text = b"G21 G90 G17 F600\nG0 X0 Y0\nG5 X0 Y30 I20 J10 P20 Q-10\nM2\n"
    found = compensate(text, read_machine("stepper"), dialect="grblhal").text.decode()
    assert "G5 X15.03 Y15.04 I10 J5 P0 Q-5" in found
    assert "G5 X-0.03 Y30.04 I0 J5 P10 Q-5 F600" in found
    assert max(map(len, found.splitlines())) <= DIALECT.syntax.max_line
    grbl = compensate(text, read_machine("stepper"), dialect="grbl")
    assert "no G5" in grbl.edits.warnings[0]
