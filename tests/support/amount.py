"""How much is tried at random: all of it where the slow tests are asked for, a part of it otherwise."""

from __future__ import annotations

import os

ALL = "PH_POST_ALL_TESTS"
"""Environment variable that asks for the slow tests too, as `.ci/run` does."""

PART = 4
"""Of so many random examples one is tried where nobody asks for all."""

FEWEST = 8
"""Examples that are tried always, where there are as many."""


def examples(count: int) -> int:
    """How many of `count` random examples to try."""
    return count if os.environ.get(ALL) else max(count // PART, min(count, FEWEST))
