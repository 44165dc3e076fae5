"""What is tried where nobody asks for all is a part of what is tried otherwise."""

from __future__ import annotations

import pytest

from support.amount import sample, thinned


def test_thinning_leaves_no_case_out() -> None:
    cases = [(1, "a"), "b", pytest.param(3, "c", id="named")]
    found = thinned(cases * 3, 4)
    assert [one.values for one in found] == [(1, "a"), ("b",), (3, "c")] * 3
    assert [one.id for one in found] == [None, None, "named"] * 3
    assert [bool(one.marks) for one in found] == [number % 4 > 0 for number in range(9)]


def test_a_sample_has_some_of_every_kind_and_is_always_the_same() -> None:
    kinds = [number % 7 for number in range(100)]
    found = sample(kinds, 3)
    assert found == sorted(set(found)) == sample(kinds, 3)
    assert [sum(kinds[number] == kind for number in found) for kind in range(7)] == [3] * 7
