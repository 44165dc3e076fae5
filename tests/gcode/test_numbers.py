"""Numbers and comments, against exact decimal arithmetic."""

from __future__ import annotations

from decimal import ROUND_HALF_EVEN, Decimal
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ph_post.gcode.numbers import ALLOWED, Comments, comment_lines, decimal_text, significant_text, to_counts


@given(st.integers(-(10**13), 10**13), st.integers(3, 6))
def test_a_count_is_written_exactly_and_as_short_as_it_goes(count: int, decimals: int) -> None:
    text = decimal_text(count, decimals)
    assert Decimal(text) == Decimal(count).scaleb(-decimals)
    assert "e" not in text
    assert text != "-0"
    assert "." not in text or text[-1] not in "0."


@given(st.floats(-5.0, 5.0), st.integers(3, 6))
def test_lengths_go_to_the_nearest_count(metres: float, decimals: int) -> None:
    exact = Fraction(metres) * 1000 * 10**decimals
    # one rounding in each of the two multiplications, besides that to the grid
    assert abs(exact - int(to_counts([metres], decimals)[0])) <= Fraction(1, 2) + abs(exact) * Fraction(3, 2**53)


@given(st.floats(1e-6, 1e9), st.integers(3, 9))
def test_significant_digits_keep_the_value(value: float, digits: int) -> None:
    text = significant_text(value, digits)
    assert abs(Decimal(text) - Decimal(value)) <= Decimal(value) * Decimal(10) ** (1 - digits) / 2
    assert set(text) <= set("0123456789.")
    expected = Decimal(value).quantize(Decimal(1).scaleb(Decimal(text).as_tuple().exponent), ROUND_HALF_EVEN)
    assert Decimal(text) == expected


@pytest.mark.parametrize("width", [20, 70, 255])
def test_comments_hold_nothing_a_controller_obeys(width: int) -> None:
    words = "ein Öl (2nd) 50% of; it! ~?\x18\n%" * 5
    for line in comment_lines(words, width):
        assert len(line) <= min(width, 100)
        assert line[0] == "("
        assert line[-1] == ")"
        assert set(line[1:-1]) <= ALLOWED


def test_comments_keep_plain_words() -> None:
    assert Comments().text("oval, 12.5 x 3/8 a_b-c:d=e*f+g") == "oval, 12.5 x 3/8 a_b-c:d=e*f+g"
