"""A sample of the random and the damaged programs of `tests/long/fuzz.py`; `fuzz.json` sums up what was run last."""

from __future__ import annotations

import pytest
from long.fuzz import TRIALS, described
from support.corpus import NCFILES

DRAWN = [
    pytest.param(kind, number, marks=[pytest.mark.slow] * (number % 20 > 0))
    for kind in TRIALS
    for number in range(0, 100, 2)
]
"""One in two hundred of each; of the ordinary tests' one in ten no two that follow each other are of one dialect."""

DRAWN += [pytest.param("lines", number, marks=pytest.mark.slow) for number in (200020, 200071, 202041, 204163)]
DRAWN += [pytest.param("readings", 305120)]
"""What was refused, as the check found something between two chains that leaving both alone mends, and a crossing with
a part of no length, whose feed was none."""


@pytest.mark.parametrize(("kind", "number"), DRAWN)
def test_nothing_goes_wrong_but_what_is_said_in_one_line(kind: str, number: int) -> None:
    if kind == "lines" and not NCFILES.exists():
        pytest.skip("the numbers are drawn where Debian's linuxcnc-uspace is installed, with its programs among them")
    tried = TRIALS[kind](number)
    assert not tried.faults, described(tried)
