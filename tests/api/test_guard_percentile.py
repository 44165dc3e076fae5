"""The percentile of errors by which plans are judged, against numpy's."""

from __future__ import annotations

import numpy as np
import pytest

from ph_post.api.guard import percentile


@pytest.mark.parametrize("size", [1, 2, 3, 19, 20, 21, 41, 1000])
def testpercentile_is_numpys_to_the_bit(size: int) -> None:
    draw = np.random.default_rng(size)
    for values in (draw.random(size), np.round(draw.random(size), 1), 1e-6 * draw.standard_normal(size)):
        assert percentile(values) == np.quantile(values, 0.95)
