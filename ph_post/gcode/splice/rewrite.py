"""Numbers of words rewritten where they stand, in exact decimal arithmetic, and text put together again.

How a number is written besides its value is its style, four bit fields: decimals, whether it has a point,
whether it has a leading plus, and how many digits it has before the point at least (0 for ``.5``). A number
that no style tells, as ``1 0`` or ``-0``, is odd.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ph_post.simulate.compiling import compiled, inner

_POINT: Final = 32
_PLUS: Final = 64
_WIDTH: Final = 128
DECIMALS: Final = _POINT - 1
"""Mask of the decimals in a style."""

LONGEST: Final = 48
"""No number comes out longer than this."""


@inner
def _compose(digits: int, style: int, out: Any, at: int) -> int:
    """Write a number, digits / 10^decimals, in a style to `out` from `at` on; the place behind it."""
    decimals, width = style & 31, style >> 7
    if digits < 0:
        out[at], at = 45, at + 1
    elif style & 64:
        out[at], at = 43, at + 1
    rest, count = abs(digits), 1
    power = np.int64(10)
    while rest // power > 0 and count < 19:
        power, count = power * 10 if count < 18 else power, count + 1
    whole = max(count - decimals, 0)
    lead = max(whole, width) if width > 0 else whole
    size = lead + decimals
    point = 1 if decimals > 0 or style & 32 else 0
    # From the last digit to the first.
    place = at + size + point - 1
    for n in range(size):
        if n == decimals and point:
            out[place], place = 46, place - 1
        out[place], place = 48 + rest % 10, place - 1
        rest //= 10
    if point and size == decimals:
        out[at] = 46
    return at + size + point


@compiled
def read_styles(data: Any, start: Any, end: Any, digits: Any, decimals: Any) -> Any:
    """Tell the style of the numbers of words, and which are odd; arrays of shape (n,)."""
    style, odd = np.empty(start.size, np.int64), np.zeros(start.size, np.uint8)
    text = np.empty(LONGEST + 64, np.uint8)
    for n in range(start.size):
        plus, point, before = 0, 0, 0
        for i in range(start[n] + 1, end[n]):
            if data[i] == 43:
                plus = 1
            elif data[i] == 46:
                point = 1
            elif 48 <= data[i] <= 57 and point == 0:
                before += 1
        natural, whole = 1, abs(digits[n])
        for _ in range(decimals[n]):
            whole //= 10
        zero = whole == 0
        while whole > 9:
            natural, whole = natural + 1, whole // 10
        width = 1 if before == natural else before
        if zero and before == 0:
            width = 0
        style[n] = min(decimals[n], 31) + 32 * point + 64 * plus + 128 * min(width, 31)
        size = _compose(digits[n], style[n], text, 0)
        odd[n] = size != end[n] - start[n] - 1
        if not odd[n]:
            for i in range(size):
                if text[i] != data[start[n] + 1 + i]:
                    odd[n] = 1
                    break
    return style, odd


@compiled
def write_numbers(digits: Any, style: Any) -> Any:
    """Write numbers one after the other: the text, and where each begins (n + 1,)."""
    pool, starts = np.empty(LONGEST * digits.size + LONGEST, np.uint8), np.zeros(digits.size + 1, np.int64)
    for n in range(digits.size):
        starts[n + 1] = _compose(digits[n], style[n], pool, starts[n])
    return pool[: starts[-1]].copy(), starts


@compiled
def assemble(data: Any, start: Any, end: Any, pool: Any, first: Any, last: Any) -> Any:
    """Put other bytes in place of spans of a text.

    Parameters
    ----------
    data : uint8 array
    start, end : int arrays, shape (n,)
        The spans, in order and apart.
    pool : uint8 array
    first, last : int arrays, shape (n,)
        What stands in `pool` for each of them.
    """
    out = np.empty(data.size + (last - first).sum() - (end - start).sum(), np.uint8)
    at, done = 0, 0
    for n in range(start.size):
        for i in range(done, start[n]):
            out[at], at = data[i], at + 1
        for i in range(first[n], last[n]):
            out[at], at = pool[i], at + 1
        done = end[n]
    for i in range(done, data.size):
        out[at], at = data[i], at + 1
    return out
