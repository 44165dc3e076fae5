"""The percentile of errors by which plans are judged, against numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from ph_post.api import guard


@pytest.mark.parametrize("size", [1, 2, 3, 19, 20, 21, 41, 1000])
def test_the_percentile_is_numpys_to_the_bit(size: int) -> None:
    draw = np.random.default_rng(size)
    for values in (draw.random(size), np.round(draw.random(size), 1), 1e-6 * draw.standard_normal(size)):
        assert guard.percentile(values) == np.quantile(values, 0.95)


@pytest.mark.parametrize(("largest", "rms", "worse"), [(90.5, 16.1, set()), (90.5, 22.7, {0}), (108.7, 16.1, {0})])
def test_it_may_grow_in_a_section_where_both_others_fall(largest: float, rms: float, worse: set[int]) -> None:
    """A corner that was far off comes nearer, and stays behind for longer; in [µm]."""
    before = np.array([[108.7, 22.7, 35.4, 36.5], [296.8, 24.0, 35.4, 35.4]])
    after = np.array([[largest, rms, 43.2, 45.0], [99.9, 11.9, 24.1, 25.8]])
    assert guard._worse_sections(1e-6 * before, 1e-6 * after) == worse
