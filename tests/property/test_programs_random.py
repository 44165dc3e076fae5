"""A sample of the random part programs of `tests/long/programs.py`; `programs.json` sums up what was run last."""

from __future__ import annotations

import pytest
from long.programs import ALLOWED, PROGRAMS, described, judge
from support.amount import sample
from support.random_cuts import NAMES, random_cut

KINDS = [NAMES[number % len(NAMES)] for number in range(PROGRAMS)]
NUMBERS = sample(KINDS, 1)[::-1]


@pytest.mark.parametrize("number", NUMBERS)
@pytest.mark.thinned(10)
def test_no_program_is_worse_or_slower_than_allowed_and_every_claim_is_true(number: int) -> None:
    for one in judge(random_cut(number), ALLOWED[::4]):
        assert one.in_time, described(one)
        assert one.no_worse, described(one)
        assert not one.off, described(one)
