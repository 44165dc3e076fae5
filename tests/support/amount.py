"""How much is tried at random: all of it where every case is asked for, a part of it otherwise."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Hashable, Sequence

import numpy as np

ALL = "PH_POST_ALL_TESTS"
"""Environment variable that asks for the slow tests too, as `.ci/run` does."""

EVERY = "every"
"""Its value that asks for every case too of which `.ci/run` tries a part."""

DRAW = "PH_POST_DRAW"
"""Environment variable by which slow tests are drawn; `.ci/run` takes the commit, so that the next one tries others."""

PART = 4
"""Of so many random examples one is tried where nobody asks for every one."""

FEWEST = 8
"""Examples that are tried always, where there are as many."""


def examples(count: int) -> int:
    """How many of `count` random examples to try."""
    part = 1 if os.environ.get(ALL) == EVERY else PART
    return max(count // part, min(count, FEWEST))


def is_drawn(name: str, of: int) -> bool:
    """Whether a test is the one of so many that is tried where nobody asks for every one."""
    lot = hashlib.sha256(f"{os.environ.get(DRAW, '')} {name}".encode()).digest()
    return int.from_bytes(lot) % of == 0


def sample(kinds: Sequence[Hashable], each: int) -> list[int]:
    """Numbers of some cases of each kind, drawn once for all, where tests/long tries every case.

    `kinds` names the kind of every case in turn.
    """
    by_kind: dict[Hashable, list[int]] = {}
    for number, kind in enumerate(kinds):
        by_kind.setdefault(kind, []).append(number)
    rng = np.random.default_rng(len(kinds))
    return sorted(int(number) for one in by_kind.values() for number in rng.choice(one, each, replace=False))
