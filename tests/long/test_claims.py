"""A sample of the random pairs of `claims.py`, whose full run is summed up in `claims.json`."""

from __future__ import annotations

import os

import pytest
from long.claims import described, judge, timed
from support.amount import ALL

FIRST = 2026
PAIRS = 12
PART = 3


@pytest.mark.slow
@pytest.mark.parametrize("output", ["table", "program"])
@pytest.mark.parametrize("number", range(FIRST, FIRST + PAIRS, 1 if os.environ.get(ALL) else PART))
def test_what_a_plan_says_is_what_a_machine_does(number: int, output: str) -> None:
    found = judge(number, output)
    if found is None:
        return
    assert found.true, described(found)
    assert found.in_time, described(found)
    assert found.no_worse, described(found)


@pytest.mark.slow
@pytest.mark.parametrize("strategy", ["dwell", "suppress", "retrograde", "linear", "takeup", "step"])
def test_every_strategy_keeps_the_time(strategy: str) -> None:
    for number in range(FIRST, FIRST + PAIRS, 1 if os.environ.get(ALL) else PART):
        for output in ("table", "program"):
            found = timed(number, output, strategy)
            assert found is None or found.in_time, (number, output, found)
