"""A sample of the random part programs of `tests/long/programs.py`; `programs.json` sums up what was run last."""

from __future__ import annotations

import os

import pytest
from long.programs import ALLOWED, PROGRAMS, described, judge
from support.amount import ALL, sample
from support.random_cuts import NAMES, random_cut

KINDS = [NAMES[number % len(NAMES)] for number in range(PROGRAMS)]
NUMBERS = sample(KINDS, 1)

KNOWN_OFF = {115, 276}
"""Not yet right, by what backlash causes alone: they claim 46.0 µm in place of 51.3, and 14.0 in place of 12.2."""


@pytest.mark.parametrize("number", NUMBERS)
def test_no_program_is_worse_or_slower_than_allowed_and_every_claim_is_true(number: int) -> None:
    for one in judge(random_cut(number), ALLOWED[::2] if os.environ.get(ALL) else ALLOWED[::4]):
        assert one.in_time, described(one)
        assert one.no_worse, described(one)
        off = [name for name in one.off if number not in KNOWN_OFF or "gap" not in name]
        assert not off, described(one)
