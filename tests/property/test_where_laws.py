"""Laws of the places of a residual, whatever it is."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.amount import examples
from support.residuals import NOISE, UM, Moved, decaying, irregular, white

from ph_post.diagnose.residual_places import locate
from ph_post.types.diagnosis import ResidualPlace

MOVED = cache(lambda: irregular(20.0))
SIZES = st.floats(-5.0, 5.0)


def residual_of(m: Moved, sizes: list[float], seed: int) -> np.ndarray:
    d, o, r, p = sizes
    parts = d * np.sign(m.v) + o + r * decaying(m.v, 0.03) + p * np.sin(m.x / 1.3e-3)
    return UM * parts + white(m.x.size, NOISE, seed)


def places(m: Moved, residual: np.ndarray, noise: float = NOISE) -> tuple[ResidualPlace, ...]:
    return locate(m.log, "X", residual, m.counted, noise, m.machine)


@settings(max_examples=examples(8))
@given(st.lists(SIZES, min_size=4, max_size=4), st.integers(0, 99), st.sampled_from([-1.0, 1e-3, 1e6]))
def test_places_do_not_depend_on_unit_or_sign(sizes: list[float], seed: int, factor: float) -> None:
    m = MOVED()
    residual = residual_of(m, sizes, seed)
    one, other = places(m, residual), places(m, factor * residual, abs(factor) * NOISE)
    assert [place.by for place in one] == [place.by for place in other]
    assert [place.share for place in one] == pytest.approx([place.share for place in other], abs=1e-6)


@settings(max_examples=examples(8))
@given(st.lists(SIZES, min_size=4, max_size=4), st.integers(0, 99))
def test_shares_are_shares(sizes: list[float], seed: int) -> None:
    m = MOVED()
    for place in places(m, residual_of(m, sizes, seed)):
        assert 0.05 <= place.share <= 1.0
        assert np.isfinite(place.value)
        assert "nan" not in place.sentence
