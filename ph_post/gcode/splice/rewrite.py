"""Numbers of words rewritten where they stand, in exact decimal arithmetic, and text put together again.

How a number is written besides its value is its style, four bit fields: decimals (5 bits), whether it has a
point, whether it has a leading plus, and how many digits it has before the point at least (0 for ``.5``). A
number that no style tells, as ``1 0`` or ``-0``, is odd.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from ph_post.simulate.compiling import compiled, inner

MOST_DECIMALS: Final = 15
"""Numbers with more decimals than this are not shifted."""

LONGEST: Final = 48
"""No number comes out longer than this."""


@inner
def _compose(digits: Any, style: Any, out: Any, at: Any) -> Any:
    """Write a number, digits / 10^decimals, in a style to `out` from `at` on; the place behind it."""
    decimals, width = style & 31, style >> 7
    if digits < 0:
        out[at], at = 45, at + 1
    elif style & 64:
        out[at], at = 43, at + 1
    rest, count = np.uint64(abs(digits)), 1
    power = np.uint64(10)
    while rest >= power and count < 19:
        power, count = power * np.uint64(10), count + 1
    whole = max(count - decimals, 0)
    lead = max(whole, width) if width > 0 else whole
    size = lead + decimals
    point = 1 if decimals > 0 or style & 32 else 0
    # From the last digit to the first.
    place = at + size + point - 1
    for n in range(size):
        if n == decimals and point:
            out[place], place = 46, place - 1
        tenth = rest // np.uint64(10)
        out[place], place = np.uint64(48) + (rest - tenth * np.uint64(10)), place - 1
        rest = tenth
    if point and size == decimals:
        out[at] = 46
    return at + size + point


@inner
def _read_style(data: Any, start: Any, end: Any, digits: Any, decimals: Any) -> Any:
    """Tell the style of a word's number, and whether it is odd: with blanks, or a minus before zero."""
    plus, point, before, leading = 0, 0, 0, 0
    odd = digits == 0 and data[start + 1] == 45
    for i in range(start + 1, end):
        c = data[i]
        if 48 <= c <= 57:
            if point == 0:
                leading = 1 if before == 0 and c == 48 else leading
                before += 1
        elif c == 46:
            point = 1
        elif c == 43:
            plus = 1
        elif c != 45:
            odd = True
    width = before if before > 1 and leading else min(before, 1)
    odd = odd or width > 31
    return decimals | 32 * point | 64 * plus | min(width, 31) << 7, odd


@compiled
def shift_numbers(data: Any, columns: Any, word: Any, number: Any, table: Any) -> Any:
    """Add offsets to the numbers of words.

    Parameters
    ----------
    data : uint8 array
    columns : tuple
        `start`, `end`, `digits` and `decimals` of all words.
    word : int array, shape (n,)
        The words that change.
    number : int array, shape (n,)
        Row of `table` that is added to each.
    table : int array, shape (k, 2)
        Steps, and the decimals of a step.

    Returns
    -------
    pool, bounds : uint8 array, int array (n + 1,)
        New text, and where that of each number begins.
    style, odd : uint16 array, uint8 array, shape (n,)
        How the numbers stood there.
    """
    start, end, digits, decimals = columns
    count = word.size
    pool, bounds = np.empty(LONGEST * count + LONGEST, np.uint8), np.zeros(count + 1, np.int64)
    style, odd = np.empty(count, np.uint16), np.zeros(count, np.uint8)
    for n in range(count):
        w, steps, places = word[n], table[number[n], 0], table[number[n], 1]
        own = np.int64(decimals[w])
        manner, strange = _read_style(data, np.int64(start[w]), np.int64(end[w]), digits[w], own)
        style[n], odd[n] = manner, strange
        wide = max(own, places)
        value = digits[w] * _power(wide - own) + steps * _power(wide - places)
        bounds[n + 1] = _compose(value, (manner >> 5 << 5) | wide, pool, bounds[n])
    return pool[: bounds[-1]].copy(), bounds, style, odd


@inner
def _power(places: Any) -> Any:
    power = np.int64(1)
    for _ in range(places):
        power *= 10
    return power


@compiled
def unshift_numbers(digits: Any, decimals: Any, word: Any, number: Any, table: Any, style: Any) -> Any:
    """Take offsets back: text and bounds as in :func:`shift_numbers`, and how many numbers do not fit."""
    count, wrong = word.size, 0
    pool, bounds = np.empty(LONGEST * count + LONGEST, np.uint8), np.zeros(count + 1, np.int64)
    for n in range(count):
        w, steps, places = word[n], table[number[n], 0], table[number[n], 1]
        manner, own = np.int64(style[n]), np.int64(decimals[w])
        less = own - (manner & 31)
        if own < places or less < 0:
            wrong += 1
            continue
        value, power = digits[w] - steps * _power(own - places), _power(less)
        wrong += value % power != 0
        bounds[n + 1] = _compose(value // power, manner, pool, bounds[n])
    return pool[: bounds[-1]].copy(), bounds, wrong


@compiled
def assemble(data: Any, start: Any, end: Any, pool: Any, bounds: Any, lines: Any, text: Any) -> Any:
    """Put numbers and lines in the place of others.

    Parameters
    ----------
    data : uint8 array
    start, end : int arrays, shape (n,)
        Spans of numbers, in order; those inside a span of lines are passed over.
    pool, bounds : uint8 array, int array (n + 1,)
        What stands in their place.
    lines : int array, shape (k, 4)
        Spans of lines, in order: start, end, and the start and end of what stands in their place in `text`.
    text : uint8 array
    """
    out = np.empty(data.size + pool.size + text.size, np.uint8)
    at, done, n = 0, np.int64(0), 0
    for k in range(lines.shape[0] + 1):
        until = lines[k, 0] if k < lines.shape[0] else data.size
        while n < start.size and start[n] < until:
            if start[n] >= done:
                at = _copy(data, done, np.int64(start[n]), out, at)
                at = _copy(pool, bounds[n], bounds[n + 1], out, at)
                done = np.int64(end[n])
            n += 1
        at = _copy(data, done, until, out, at)
        done = until
        if k < lines.shape[0]:
            at = _copy(text, lines[k, 2], lines[k, 3], out, at)
            done = lines[k, 1]
    return out[:at]


@inner
def _copy(source: Any, low: Any, high: Any, out: Any, at: Any) -> Any:
    for i in range(low, high):
        out[at], at = source[i], at + 1
    return at
