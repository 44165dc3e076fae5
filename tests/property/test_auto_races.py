"""On random paths and machines `auto` is as good as the best single strategy in the time, and never above `none`."""

from __future__ import annotations

import pytest
from long.races import AS_GOOD, JOBS, RESOLVED, SEED, race
from support.amount import sample
from support.random_jobs import KINDS

pytestmark = pytest.mark.drawn(4)

PAIRS = JOBS
"""tests/long tries them all."""


@pytest.mark.slow
@pytest.mark.parametrize("number", sample([number % len(KINDS) for number in range(PAIRS)], 1))
@pytest.mark.thinned(8)
def test_auto_is_as_good_as_the_best_single_strategy(number: int) -> None:
    is_not_beaten(number)


@pytest.mark.slow
@pytest.mark.parametrize(("number", "seed"), [(3, 77), (22, 77)])
def test_auto_is_as_good_where_it_once_was_not(number: int, seed: int) -> None:
    """Where all is little beside the plain error, and where none of the first few plans can be proven."""
    is_not_beaten(number, seed)


def is_not_beaten(number: int, seed: int = SEED) -> None:
    """Try a job: `auto` beside all others, by the worst case."""
    raced = race(number, seed)
    assert not raced.worse, (number, raced.found, raced.plain)
    worst = raced.found[:, 0].max()
    for strategy, others in raced.singles.items():
        best = others[:, 0].max()
        assert worst <= AS_GOOD * best + RESOLVED, (number, strategy, worst, best)
