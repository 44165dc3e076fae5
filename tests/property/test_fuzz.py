"""A sample of the random and the damaged programs of `tests/long/fuzz.py`; `fuzz.json` sums up what was run last."""

from __future__ import annotations

import itertools
import random
import time

import pytest
from long.fuzz import TRIALS, Damaged, described, read_and_expanded
from support.corpus import NCFILES

DRAWN = [
    pytest.param(kind, number, marks=[pytest.mark.slow] * (number % 20 > 0))
    for kind in TRIALS
    for number in range(0, 100, 2)
]
"""One in two hundred of each; of the ordinary tests' one in ten no two that follow each other are of one dialect."""

DRAWN += [pytest.param("lines", number, marks=pytest.mark.slow) for number in (200020, 200071, 202041, 204163)]
"""What was refused, as the check found something between two chains that leaving both alone mends, and a crossing with
a part of no length, whose feed was none."""

DRAWN += [pytest.param("readings", number) for number in (305120, 308971)]
"""A number that no double holds; and a comment of 65,000 characters, searched for a number in as many ways."""


@pytest.mark.parametrize(("kind", "number"), DRAWN)
def test_nothing_goes_wrong_but_what_is_said_in_one_line(kind: str, number: int) -> None:
    if kind == "lines" and not NCFILES.exists():
        pytest.skip("the numbers are drawn where Debian's linuxcnc-uspace is installed, with its programs among them")
    tried = TRIALS[kind](number)
    assert not tried.faults, described(tried)


HEADS = {
    "fanuc": "%\nO1\nG21 G90 G54\nG0 X0. Y0. Z5.\n",
    "siemens": "G71 G90\nG0 X0 Y0 Z5\n",
    "heidenhain": "BEGIN PGM A MM\nL X+0 Y+0 R0 FMAX M3\n",
    "heidenhain-iso": "%A G71 *\nN10 G00 G90 X+0 Y+0*\n",
    "linuxcnc": "G21 G90\nG0 X0 Y0\n",
    "grbl": "G21 G90\nG0 X0 Y0\n",
    "marlin": "G21\nG90\nG0 X0 Y0\n",
    "klipper": "G21\nG90\nG0 X0 Y0\n",
}
LEADS = ("X", "CYCL DEF", "#1", "O", "(", "F", "IF")
RUNS = [*((fill, 6_000) for fill in " -(0=["), (";", 60_000)]
"""Characters, and how many of them: a line of more than 16,384 is refused at once, but for a comment."""


@pytest.mark.parametrize("dialect", HEADS)
def test_a_line_with_a_run_of_one_character_is_read_in_time(dialect: str) -> None:
    """A pattern that may read a run in as many ways as it has characters takes a minute for a comment."""
    begun = time.process_time()
    for lead, (fill, count) in itertools.product(LEADS, RUNS):
        text = f"{HEADS[dialect]}{lead}{fill * count}!\nG1 X10. F200\nM30\n"
        _, faults = read_and_expanded(Damaged(dialect, "a", text, text.encode(), 1, random.Random(0)))
        assert not faults, (lead, fill)
    assert time.process_time() - begun < 30.0
