"""Alignment of long sequences: what belongs together is equal, rises, and is as much as can be."""

import random

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ph_post.diff.alignment import align, gaps_of, hash_columns

SEQUENCES = st.lists(st.integers(0, 6), max_size=30)


def common(a, b):
    """Length of the longest common subsequence, from its definition."""
    row = [0] * (len(b) + 1)
    for x in a:
        before = row[:]
        for j, y in enumerate(b):
            row[j + 1] = before[j] + 1 if x == y else max(before[j + 1], row[j])
    return row[-1]


def keys(values):
    return np.array(values, dtype=np.int64)


def require_alignment(a, b, found):
    here = np.flatnonzero(found >= 0)
    assert (np.diff(found[here]) > 0).all()
    assert (a[here] == b[found[here]]).all()


@given(SEQUENCES, SEQUENCES)
def test_short_sequences_get_the_longest_common_subsequence(a, b):
    found = align(keys(a), keys(b))
    require_alignment(keys(a), keys(b), found)
    assert np.count_nonzero(found >= 0) == common(a, b)


def test_a_long_program_with_scattered_changes_keeps_all_that_is_equal():
    rng = random.Random(5)
    a = [rng.randrange(10**9) for _ in range(50_000)]
    b, kept = [], 0
    for value in a:
        what = rng.random()
        if what < 0.02:
            continue
        b.append(value if what > 0.04 else -1 - len(b))
        kept += what > 0.04
        if what > 0.99:
            b.append(-1 - len(b))
    found = align(keys(a), keys(b))
    require_alignment(keys(a), keys(b), found)
    assert np.count_nonzero(found >= 0) == kept


def test_repeated_passes_are_told_apart_by_their_neighbours():
    one = [k % 7 for k in range(400)]
    a = [value for number in range(10) for value in (*one, 100 + number)]
    b = [*a[:1203], 999, *a[1203:]]
    found = align(keys(a), keys(b))
    require_alignment(keys(a), keys(b), found)
    assert np.count_nonzero(found >= 0) == len(a)


def test_a_moved_stretch_is_missing_at_one_place_only():
    a = list(range(3000))
    b = a[1000:2000] + a[:1000] + a[2000:]
    found = align(keys(a), keys(b))
    require_alignment(keys(a), keys(b), found)
    assert np.count_nonzero(found >= 0) == 2000


@pytest.mark.parametrize("sizes", [(0, 0), (0, 3), (3, 0)])
def test_nothing_belongs_to_nothing(sizes):
    found = align(keys(range(sizes[0])), keys(range(sizes[1])))
    assert (found == -1).all()
    assert gaps_of(found, sizes[1]).tolist() == ([[0, sizes[0], 0, sizes[1]]] if any(sizes) else [])


def test_gaps_and_counterparts_make_up_both_sequences():
    a, b = keys([1, 2, 3, 4, 5, 6]), keys([2, 7, 3, 4, 6, 8])
    found = align(a, b)
    gaps = gaps_of(found, b.size)
    assert sum(row[1] - row[0] for row in gaps) + np.count_nonzero(found >= 0) == a.size
    assert sum(row[3] - row[2] for row in gaps) + np.count_nonzero(found >= 0) == b.size


def test_rows_with_a_negative_zero_are_equal():
    first, second = hash_columns(np.array([0.0, -0.0]), np.array([1, 1]))
    assert first == second
