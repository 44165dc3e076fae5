"""The descent of a fit, on rows that are known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ph_post.diagnose.fit import CLOSE, _descend
from ph_post.diagnose.hypotheses.base import HypothesisNumber
from ph_post.types import Array


class Straight:
    """Rows that are linear in the unknowns."""

    def __init__(self, slopes: Array, wanted: Array) -> None:
        self.slopes, self.wanted = slopes, wanted

    def __call__(self, unknowns: Array) -> Array:
        return self.slopes @ unknowns - self.wanted

    beside = __call__


def test_a_fit_goes_on_where_a_bound_cuts_its_first_step() -> None:
    """Of two unknowns that all but do the same a step leads far out; with one of them cut it is worse than none."""
    common, own = np.ones(50), np.cos(np.arange(50.0))
    rows = Straight(np.column_stack([common, common + 0.2 * own]), common + 2.0 * own)
    numbers = [HypothesisNumber(name="off", low=-far, high=far, scale=0.3) for far in (50.0, 3.0)]
    found, _ = _descend(rows, numbers, {}, np.zeros(2), 12, CLOSE)  # type: ignore[arg-type]
    best = lsq_linear(rows.slopes, rows.wanted, bounds=([-50.0, -3.0], [50.0, 3.0]))
    assert np.sum(rows(np.zeros(2)) ** 2) > 2.4 * best.cost
    assert np.sum(rows(found) ** 2) == pytest.approx(2.0 * best.cost, rel=0.01)
