"""grblHAL: what its splines do to a curve, and programs in its words."""

from __future__ import annotations

import re

import numpy as np
import pytest
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
    before, across, behind, back = re.findall(r"^(G5 .*|G1 X.* Y.*)$", found, re.MULTILINE)
    first = dict(re.findall(r"([XYIJPQ])([-\d.]+)", before))
    # The part up to u begins with u of the first leg and ends with u of a third of the derivative there.
    control, u = np.array([[0.0, 0.0], [20.0, 10.0], [20.0, 20.0], [0.0, 30.0]]), float(first["I"]) / 20.0
    one, two, three = np.diff(control, axis=0)
    last = u * ((1.0 - u) ** 2 * one + 2.0 * u * (1.0 - u) * two + u * u * three)
    assert 0.4 < u < 0.5
    numbers = [float(first[letter]) for letter in "IJPQXY"]
    shifted = _at(control, np.array([u]))[0] + [0.03, 0.04]
    assert numbers == pytest.approx([*(u * one), *-last, *shifted], abs=2e-4)
    assert across.startswith(f"G1 X{float(first['X']) - 0.06:.4f} Y{30.08 - float(first['Y']):.3f}")
    assert behind == f"G5 X-0.03 Y30.04 I{first['P']} J{-float(first['Q'])} P{first['I']} Q-{first['J']} F600"
    assert back.startswith("G1 X0 Y30 F")
    assert max(map(len, found.splitlines())) <= DIALECT.syntax.max_line
    grbl = compensate(text, read_machine("stepper"), dialect="grbl")
    assert "no G5" in grbl.edits.warnings[0]
