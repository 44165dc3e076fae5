"""What is tried where nobody asks for all is a part of what is tried otherwise."""

from __future__ import annotations

import os

import pytest

from support.amount import ALL, DRAW, EVERY, examples, is_drawn, sample


@pytest.mark.thinned(4)
@pytest.mark.parametrize("number", range(9))
def test_of_cases_that_are_alike_some_are_tried_always(number: int, request: pytest.FixtureRequest) -> None:
    assert bool(request.node.get_closest_marker("slow")) == (number % 4 > 0)


@pytest.mark.thinned(4)
@pytest.mark.parametrize("number", range(9))
def test_of_cases_that_are_alike_twice_as_many_are_tried_where_not_every_one_is_asked_for(number: int) -> None:
    assert number % 2 == 0 or os.environ[ALL] == EVERY


def test_a_sample_has_some_of_every_kind_and_is_always_the_same() -> None:
    kinds = [number % 7 for number in range(100)]
    found = sample(kinds, 3)
    assert found == sorted(set(found)) == sample(kinds, 3)
    assert [sum(kinds[number] == kind for number in found) for kind in range(7)] == [3] * 7


@pytest.mark.parametrize(("asked", "tried"), [("", (25, 8, 5)), ("1", (25, 8, 5)), (EVERY, (100, 20, 5))])
def test_random_examples_are_more_where_every_one_is_asked_for(
    asked: str, tried: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(ALL, asked)
    assert tuple(examples(count) for count in (100, 20, 5)) == tried


def test_one_in_so_many_is_drawn_and_another_with_another_commit(monkeypatch: pytest.MonkeyPatch) -> None:
    drawn = []
    for commit in ("15286b73", "15286b73", "56a28b69"):
        monkeypatch.setenv(DRAW, commit)
        drawn.append({number for number in range(1000) if is_drawn(f"tests/hidden/test_named.py::{number}", 4)})
    first, same, other = drawn
    assert first == same
    assert 200 < len(first) < 300
    assert 200 < len(other) < 300
    assert 30 < len(first & other) < 100
