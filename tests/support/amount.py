"""How much is tried at random: all of it where the slow tests are asked for, a part of it otherwise."""

from __future__ import annotations

import os
from collections.abc import Hashable, Iterable, Sequence
from typing import Any

import numpy as np
import pytest

SLOW = pytest.mark.slow

ALL = "PH_POST_ALL_TESTS"
"""Environment variable that asks for the slow tests too, as `.ci/run` does."""

PART = 4
"""Of so many random examples one is tried where nobody asks for all."""

FEWEST = 8
"""Examples that are tried always, where there are as many."""


def examples(count: int) -> int:
    """How many of `count` random examples to try."""
    return count if os.environ.get(ALL) else max(count // PART, min(count, FEWEST))


def thinned(cases: Iterable[Any], every: int) -> list[Any]:
    """Cases of a parametrized test of which one in `every` is tried always, the others with the slow tests."""
    found = []
    for number, case in enumerate(cases):
        values, name = case if isinstance(case, tuple) else (case,), None
        if hasattr(case, "marks"):  # pytest.param
            values, name = case.values, case.id
        found.append(pytest.param(*values, id=name, marks=SLOW if number % every else ()))
    return found


def sample(kinds: Sequence[Hashable], each: int) -> list[int]:
    """Numbers of some cases of each kind, drawn once for all, where tests/long tries every case.

    `kinds` names the kind of every case in turn.
    """
    by_kind: dict[Hashable, list[int]] = {}
    for number, kind in enumerate(kinds):
        by_kind.setdefault(kind, []).append(number)
    rng = np.random.default_rng(len(kinds))
    return sorted(int(number) for one in by_kind.values() for number in rng.choice(one, each, replace=False))
