"""How long the tool stands or creeps on the contour, counted by the rows of the table; and its bound."""

from __future__ import annotations

import numpy as np
import pytest

import ph_post as ph
from ph_post.errors import InputError

FEED = 0.02
"""Feed of the oval [m/s]."""


def standing(rows) -> float:
    """Time [s] in which the way of a period is below 2 % of the feed's, the beginning and the end left out."""
    way = np.abs(np.diff(rows.s)) / rows.period
    slow = way < 0.02 * FEED
    inner = np.flatnonzero(~slow)
    return float(rows.period * slow[inner[0] : inner[-1]].sum())


def oval(**options):
    return ph.compensate("oval", "mill", output="table", effort=0.05, **options)


@pytest.mark.slow
def test_what_is_counted_is_what_the_rows_show() -> None:
    found = oval()
    counted = sum(one.time for one in found.after.standstills)
    assert counted > 0.1
    assert counted == pytest.approx(standing(found.table()), abs=0.001 * (1 + 4 * len(found.after.standstills)))
    assert not found.before.standstills
    (said,) = [word for word in found.warnings if "stands or creeps" in word]
    assert f"for {counted:.3g} s (0 s before)" in said


@pytest.mark.parametrize("most", [0.0, 0.25])
@pytest.mark.thinned(4)
def test_the_bound_is_kept_and_what_is_left_is_no_worse(most: float) -> None:
    found = oval(max_standstill=most)
    assert standing(found.table()) <= most + 0.01
    assert found.after.error.max <= found.before.error.max
    assert found.after.error.rms <= found.before.error.rms


def test_a_strategy_that_stands_and_a_bound_that_forbids_it_contradict_each_other() -> None:
    with pytest.raises(InputError, match=r"--max-standstill: strategy dwell stands or creeps .* got 0.1 s"):
        oval(strategy="dwell", max_standstill=0.1)
    with pytest.raises(InputError, match=r"--max-standstill: out of range; expected a finite number >= 0; got -1"):
        oval(max_standstill=-1)
