"""First crossings of functions whose shape is known."""

from __future__ import annotations

import numpy as np
import pytest

from ph_post.geometry.first_crossings import CLOSE, first_crossings
from ph_post.types import Array, IntArray


def test_powers_are_met_from_below() -> None:
    power = np.repeat([2.0, 3.0, 4.0, 6.0], 25)
    size = np.tile(np.geomspace(1e-6, 1e6, 25), 4)
    calls = 0

    def function(rows: IntArray, t: Array) -> Array:
        nonlocal calls
        calls += t.size
        return (size[rows, None] * t) ** power[rows, None]

    true = 1.0 / size
    extent, crossed = first_crossings(function, np.full(100, np.inf), 1.2 * true, 1.0)
    assert crossed.all()
    assert np.all(extent <= true)
    assert np.all((size * extent) ** power >= (1.0 - CLOSE) * (1.0 - 1e-12))
    assert calls < 6 * size.size


@pytest.mark.parametrize("off", [1e-6, 1e-2, 0.3, 3.0, 1e2, 1e6, np.inf])
def test_a_bad_guess_costs_steps_but_no_accuracy(off: float) -> None:
    extent, crossed = first_crossings(lambda _, t: t**3, np.array([10.0]), np.array([off]), 1.0)
    assert crossed.tolist() == [True]
    assert 1.0 - CLOSE < extent[0] <= 1.0


def test_what_is_not_crossed_ends_at_the_reach() -> None:
    reach = np.array([0.0, 0.5, 0.9])
    extent, crossed = first_crossings(lambda _, t: t**3, reach, np.array([1.0, 0.01, np.inf]), 1.0)
    assert extent.tolist() == reach.tolist()
    assert not crossed.any()


def test_zero_is_never_crossed() -> None:
    extent, crossed = first_crossings(lambda _, t: 0.0 * t, np.array([3.0]), np.array([np.inf]), 1e-9)
    assert (extent.tolist(), crossed.tolist()) == ([3.0], [False])


@pytest.mark.parametrize("height", [0.5, 0.97, 0.999, 1.001, 1.03, 1.5])
@pytest.mark.parametrize("place", [0.2, 0.45, 0.7, 0.93])
def test_the_first_of_several_crossings_counts(height: float, place: float) -> None:
    """A bump at `place`, besides t³ / 2: where it is higher than the level it ends the way."""

    def function(_: IntArray, t: Array) -> Array:
        bump = np.exp(-(((t - place) / 0.1) ** 2)) * (t > 0.0)  # zero at 0
        return 0.5 * t**3 + (height - 0.5 * place**3) * bump

    extent, crossed = first_crossings(function, np.array([2.0]), np.array([1.1]), 1.0, places=64)
    assert crossed.tolist() == [True]
    dense = function(np.array([0]), np.linspace(0.0, extent[0], 100_001))
    assert dense.max() <= 1.0
    assert dense[-1] >= 1.0 - CLOSE
    if height > 1.0:
        assert extent[0] < place + 1e-9


def test_a_jump_is_met_where_it_is() -> None:
    extent, crossed = first_crossings(lambda _, t: np.where(t > 0.3, 2.0, t**3), np.array([1.0]), np.array([0.9]), 1.0)
    assert crossed.tolist() == [True]
    assert extent[0] == pytest.approx(0.3, rel=1e-12)
    assert extent[0] <= 0.3
