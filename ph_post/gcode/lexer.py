"""Split text into words: one compiled pass, which keeps the place of every word.

Blanks may stand inside words (``X 1 0 . 5``), as RS274/NGC allows.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ph_post.compiling import compiled, lean

PARAMETER, EXPRESSION, O_WORD, POLAR, DELETE, OTHER, SYSTEM, KEEPS = 1, 2, 4, 8, 16, 32, 64, 128
"""What stands on a line beside plain words: bits of its trait. `OTHER`: a word with a comma or a dollar sign,
or a number that is too long to be kept exactly; `SYSTEM`: a line for the controller itself, which begins
with ``$``, and beside that `KEEPS`: it leaves all modes as they are (``$@``), `OTHER`: nobody knows what it does
(nothing stands behind the ``$``), both: it sets them to what they are at the beginning (``$=``), or `DELETE`: whether
it obeys the words behind a :data:`DOUBTED`."""

DOUBTED = 1
"""Byte with which readers begin a line of words that the controller may obey or not."""

(
    NO_NUMBER,
    BAD_CHARACTER,
    OPEN_COMMENT,
    CLOSED_COMMENT,
    BRACKET,
    EXPONENT,
    NO_LETTER,
    AFTER_PERCENT,
    CHECKSUM,
    FULL,
    BYTE_ORDER,
    TEXT,
    SENDERS_WORD,
) = range(1, 14)
"""Faults of a line. `FULL`: there is no room for more words; `BYTE_ORDER`: the file begins with the mark of its
encoding; `TEXT`: from a ``#`` on that begins no parameter; `SENDERS_WORD`: ``%wait``, at which bCNC waits until the
machine rests, and sends the controller nothing."""

FAULT, QUIET = 100, 200
"""What is added to a fault where a line is passed through: `QUIET` where no controller can obey it."""

_POWERS = 10.0 ** np.arange(23)
"""Powers of ten that are exact."""
_LARGEST = 922337203685477579
"""Ten times this and a digit still is a 64-bit number."""
_SURE = 18
"""Numbers of so many digits are 64-bit ones, whatever they are."""


@compiled
def split_lines(data: Any) -> Any:
    """Places at which lines begin, and after the last one the end of `data` (n,), shape (lines + 1,)."""
    count = 0
    for i in range(data.size):
        if data[i] == 10 or (data[i] == 13 and not (i + 1 < data.size and data[i + 1] == 10)):
            count += 1
    if data.size and data[-1] != 10 and data[-1] != 13:
        count += 1
    lines = np.empty(count + 1, np.int32)
    lines[0] = 0
    at = 0
    for i in range(data.size):
        if data[i] == 10 or (data[i] == 13 and not (i + 1 < data.size and data[i + 1] == 10)):
            at += 1
            lines[at] = i + 1
    lines[count] = data.size
    return lines


@compiled
def count_letters(data: Any, everywhere: bool) -> Any:
    """Count the letters outside comments, or `everywhere`: then no fewer than there are words."""
    count, opens = 0, 0
    for c in data:  # so simple that several bytes are looked at together
        count += 65 <= (c & 0xDF) <= 90
        opens += c in (40, 59)
    if everywhere or opens == 0:
        return count
    count, closer = 0, 0
    for c in data:
        if closer:
            if c == closer or c in (10, 13):
                closer = 0
        elif c == 40:
            closer = 41
        elif c == 59:
            closer = 10
        elif 65 <= (c & 0xDF) <= 90:
            count += 1
    return count


@lean
def _is_letter(c: Any) -> Any:
    return 65 <= c <= 90 or 97 <= c <= 122


@lean
def _is_numeric(c: Any) -> Any:
    return 48 <= c <= 57 or c == 46


@lean
def _skip_blanks(data: Any, i: Any, end: Any) -> Any:
    while i < end and (data[i] == 32 or data[i] == 9):
        i += 1
    return i


@lean
def _read_number(data: Any, i: int, end: int) -> Any:
    """Read a number with blanks inside: its end, digits, decimals, -1 where it has none, -2 if too long.

    Decimals that a 64-bit number has no room for are left out, as any controller does.
    """
    sign, point, digits, decimals, after, seen = 1, False, np.int64(0), 0, i, False
    i = _skip_blanks(data, i, end)
    if i < end and (data[i] == 43 or data[i] == 45):
        sign = -1 if data[i] == 45 else 1
        i += 1
    long = False
    while i < end:
        c = data[i]
        if 48 <= c <= 57:
            seen, after = True, i + 1
            if digits > _LARGEST:
                long |= not point
            else:
                digits = 10 * digits + (np.int64(c) - 48)
                decimals += point
        elif c == 46 and not point:
            point, after = True, i + 1
        elif c not in (32, 9):
            break
        i += 1
    if not seen:
        decimals = -1
    elif long:
        decimals = -2
    return after, sign * digits, decimals


@lean
def _close_bracket(data: Any, i: int, end: int) -> Any:
    """Place behind the bracket that closes the one at `i`, -1 where the line has none."""
    depth = 0
    while i < end:
        depth += int(data[i] == 91) - int(data[i] == 93)
        i += 1
        if depth == 0:
            return i
    return -1


@lean
def _skip_expression(data: Any, i: int, end: int) -> Any:
    """Place behind a parameter, a bracket or a function; -1 where it is not whole."""
    while i < end:
        c = data[i]
        if c == 91:
            i = _close_bracket(data, i, end)
            follow = _skip_blanks(data, i, end)
            if i < 0 or follow >= end or data[follow] != 47:
                return i
            i = follow + 1  # ATAN[..]/[..]
        elif c == 60:
            while i < end and data[i] != 62:
                i += 1
            return i + 1 if i < end else -1
        elif _is_numeric(c):
            return _read_number(data, i, end)[0]
        elif c in (43, 45, 35, 32, 9) or _is_letter(c):
            i += 1
        else:
            return -1
    return -1


@lean
def _is_expression(data: Any, i: int, end: int) -> Any:
    """Return True if something that has to be computed begins at `i`, and no plain number."""
    i = _skip_blanks(data, i, end)
    if i >= end:
        return False
    if data[i] == 43 or data[i] == 45:
        i = _skip_blanks(data, i + 1, end)
        return i < end and not _is_numeric(data[i]) and (data[i] in (35, 91, 43, 45) or _is_letter(data[i]))
    if data[i] == 35 or data[i] == 91:
        return True
    first = i
    while i < end and _is_letter(data[i]):
        i += 1
    i_after = _skip_blanks(data, i, end)
    return i > first + 1 and i_after < end and data[i_after] == 91


@lean
def _skip_comments(data: Any, i: Any, end: Any) -> Any:
    """Place behind blanks and comments, and the place of a comment that does not end, or -1."""
    while i < end:
        c = data[i]
        if c == 59:
            return end, -1
        if c == 40:
            start = i
            while i < end and data[i] != 41:
                i += 1
            if i == end:
                return end, start
        elif c not in (32, 9):
            break
        i += 1
    return i, -1


@lean
def _is_keyword(data: Any, i: int, end: int) -> Any:
    """Return True if a word of letters stands at `i`: two letters in a row."""
    i = _skip_blanks(data, i, end)
    return i + 1 < end and _is_letter(data[i]) and _is_letter(data[i + 1])


@lean
def _read_word(data: Any, i: int, end: int) -> Any:
    """Read the word whose letter is at `i`: its end, digits and decimals, its trait, why it is refused."""
    number = i + 1 < end and _is_numeric(data[i + 1])
    if data[i] in (79, 111):
        after, count, places = _read_number(data, i + 1, end)
        plain = places == 0 and not _is_keyword(data, after, end)
        return after if plain else end, count, 0 if plain else -1, 0 if plain else O_WORD, 0
    if not number and _is_expression(data, i + 1, end):
        after = _skip_expression(data, _skip_blanks(data, i + 1, end), end)
        return after, 0, -1, EXPRESSION, BRACKET if after < 0 else 0
    after, count, places = _read_number(data, i + 1, end)
    return after, count, places, OTHER if places == -2 else 0, NO_NUMBER if places == -1 else 0


@lean
def _is_exponent(data: Any, i: int, end: int, before: int) -> Any:
    """Return True if an E directly behind the number of a word with the letter `before` may be its exponent."""
    whole = before in (71, 77, 78, 79, 84, 0)  # M66E0: G, M, N, O and T have none
    if whole or data[i] & 0xDF != 69 or not _is_numeric(data[i - 1]):
        return False
    return i + 1 < end and (48 <= data[i + 1] <= 57 or data[i + 1] == 43 or data[i + 1] == 45)


@lean
def _is_text(data: Any, i: int, end: int, alone: Any) -> Any:
    """Return True if a ``#`` begins no parameter; `alone` at the head of a line, where one has to be set."""
    after = _skip_blanks(data, i + 1, end)
    if after >= end or not (_is_letter(data[after]) or data[after] == 60 or data[after] in (35, 91)):
        if after >= end or not 48 <= data[after] <= 57:
            return True
    elif _is_letter(data[after]):
        while after < end and _is_letter(data[after]):
            after += 1
        after = _skip_blanks(data, after, end)
        if after >= end or data[after] != 91:
            return True
    if not alone:
        return False
    behind = _skip_expression(data, i, end)
    behind = _skip_blanks(data, behind, end) if behind > 0 else end
    return behind >= end or data[behind] != 61


@lean
def _skip_other(data: Any, i: int, end: int, alone: Any) -> Any:  # noqa: PLR0911
    """Pass over what is neither word nor comment: the place behind it, its trait and why it is refused."""
    c = data[i]
    if c == 47:
        i += 1
        return i + (i < end and 48 <= data[i] <= 57), DELETE, 0
    if c == 35 and _is_text(data, i, end, alone):
        return end, 0, TEXT
    if c == 35:
        i = _skip_expression(data, i, end)
        i = _skip_blanks(data, i, end) if i > 0 else end
        if i >= end or data[i] != 61:
            return i, PARAMETER, BAD_CHARACTER
        i = _skip_blanks(data, i + 1, end)
        if _is_expression(data, i, end):
            i = _skip_expression(data, i, end)
            return i, PARAMETER, BRACKET if i < 0 else 0
        after, _, places = _read_number(data, i, end)
        return after, PARAMETER, NO_NUMBER if places == -1 else 0
    if c in (64, 94):
        after, _, places = _read_number(data, i + 1, end)
        if _is_expression(data, i + 1, end):
            after, places = _skip_expression(data, _skip_blanks(data, i + 1, end), end), 0
        return after, POLAR, BRACKET if after < 0 else NO_NUMBER if places == -1 else 0
    if c == 36 or (c == 44 and i + 1 < end and _is_letter(data[i + 1])):
        after, _, places = _read_number(data, i + (1 if c == 36 else 2), end)
        return after, OTHER, NO_NUMBER if places == -1 else 0
    if c == 42:
        after, _, places = _read_number(data, i + 1, end)
        rest, _ = _skip_comments(data, after, end)
        return end, 0, 0 if places == 0 and rest == end else CHECKSUM
    if c == 41:
        return i, 0, CLOSED_COMMENT
    return i, 0, NO_LETTER if _is_numeric(c) or c in (43, 45) else BAD_CHARACTER


@lean
def _is_nested(data: Any, first: int, end: int) -> Any:
    """Return True if a line holds nothing but comments, of which one stands in another."""
    depth, deepest = 0, 0
    for i in range(first, end):
        c = data[i]
        depth += int(c == 40) - int(c == 41)
        deepest = max(deepest, depth)
        if depth < 0 or (depth == 0 and c not in (32, 9, 41)):
            return False
    return deepest > 1


@lean
def _is_prose(data: Any, first: int, end: int) -> Any:
    """Return True if a line has a word of three letters, and nothing that a controller could count, compute or call."""
    letters = longest = 0
    for i in range(first, end):
        c = data[i]
        letters = letters + 1 if _is_letter(c) else 0
        longest = max(longest, letters)
        # Digits, control characters, and # $ % * , < = @ [ ^ _
        if _is_numeric(c) or (c < 32 and c != 9) or c in (35, 36, 37, 42, 44, 60, 61, 64, 91, 94, 95):
            return False
    return longest > 2


@lean
def _read_line(data: Any, first: Any, end: Any, row: int, block: int, out: Any) -> Any:
    """Read one line: the row after its words, its trait, its first fault, and where.

    Behind a fault the words are read on: somebody may obey them. To the fault `FAULT` or `QUIET` is added.
    """
    blocks, letters, starts, ends, values, decimals = out
    i, open_at = _skip_comments(data, first, end)
    trait, begin, fault, where, named = 0, row, 0, first, False
    while i < end and open_at < 0:
        at = i
        if _is_letter(data[i]):
            if row == letters.size:
                return row, trait, FULL, i
            if _is_exponent(data, i, end, letters[row - 1] if row > begin else 0):
                i, found, why = i + 1, 0, EXPONENT
            else:
                i, count, places, found, why = _read_word(data, i, end)
                blocks[row], letters[row], starts[row], ends[row] = block, data[at] & 0xDF, at, i
                values[row] = np.nan if places < 0 else count / _power(places)
                decimals[row] = max(places, -1)
                row += why == 0
                named = named or why != 0 or data[at] & 0xDF != 78
        elif data[i] == 36 and row == begin:
            behind = data[i + 1] if i + 1 < end else 32
            kept = KEEPS if behind == 64 else KEEPS | OTHER if behind == 61 else OTHER if behind == 32 else 0
            i, found, why = end, SYSTEM | kept, 0
        elif data[i] == DOUBTED and row == begin:
            i, found, why = i + 1, SYSTEM | DELETE, 0
        else:
            i, found, why = _skip_other(data, i, end, row == begin and fault == 0)
            named = named or found != 0
        trait |= found
        if why:
            fault, where = (fault, where) if fault else (why, at)
            i = end if why == TEXT else at + 1
        i, open_at = _skip_comments(data, i, end)
    if open_at >= 0:
        fault, where, named = (fault, where, True) if fault else (OPEN_COMMENT, open_at, True)
    if fault and _is_nested(data, first, end):
        row, trait, fault, named = begin, 0, CLOSED_COMMENT, False
    if fault:
        trait &= ~O_WORD
        named = named and not (fault in (NO_NUMBER, BAD_CHARACTER) and _is_prose(data, first, end))
        fault += FAULT if named else QUIET
    return row, trait, fault, where


@lean
def _read_plain(data: Any, i: Any, end: Any, row: int, block: int, out: Any) -> Any:
    """Read a line of nothing but words with plain numbers, as most are: the row after them, -1 of every other line.

    Those, and lines for whose words there is no room, are left to :func:`_read_line`.
    """
    blocks, letters, starts, ends, values, decimals = out
    i = _skip_blanks(data, i, end)
    if i == end:
        return -1
    while i < end:
        letter, at = data[i] & 0xDF, i
        # O opens statements, E may be an exponent
        if not _is_letter(data[i]) or letter in (79, 69) or row == letters.size:
            return -1
        i += 1
        negative = i < end and data[i] == 45
        i += negative
        first, digits, places = i, np.int64(0), -1
        while i < end and (48 <= data[i] <= 57 or (data[i] == 46 and places < 0)):
            if data[i] == 46:
                places = i + 1
            else:
                digits = 10 * digits + (np.int64(data[i]) - 48)
            i += 1
        count = i - first - (places >= 0)
        if count == 0 or count > _SURE:
            return -1
        places = i - places if places >= 0 else 0
        blocks[row], letters[row], starts[row], ends[row] = block, letter, at, i
        values[row] = (-digits if negative else digits) / _POWERS[places]
        decimals[row] = places
        row += 1
        after = i
        i = _skip_blanks(data, i, end)
        if i > after and i < end and not _is_letter(data[i]):  # blanks may stand within numbers
            return -1
    return row


@lean
def _power(places: int) -> Any:
    return _POWERS[places] if places < _POWERS.size else 10.0**places


@lean
def _is_wait(data: Any, at: Any, end: Any) -> bool:
    """Return True if ``%wait`` stands at a place, and nothing but comments behind it."""
    if at + 5 > end or data[at] != 37:
        return False
    w, a, i, t = data[at + 1] | 0x20, data[at + 2] | 0x20, data[at + 3] | 0x20, data[at + 4] | 0x20
    if w != 119 or a != 97 or i != 105 or t != 116:
        return False
    rest, _ = _skip_comments(data, at + 5, end)
    return bool(rest >= end)


@compiled
def lex(data: Any, lines: Any, out: Any, traits: Any, whys: Any, spots: Any) -> Any:
    """Read all words: their number, and the line behind them; -1 for that where there is no more room.

    `out` are the columns block, letter, start, end, value and decimals. Reading ends at the closing ``%``, which has
    its line for itself (LinuxCNC, G-code overview). `whys` (n,) gets the faults of lines, with `FAULT` or `QUIET`, and
    `spots` (n,) their places, from 1.
    """
    row, opened = 0, False
    for block in range(lines.size - 1):
        first, end = np.int64(lines[block]), np.int64(lines[block + 1])
        if block == 0 and end >= 3 and data[0] == 0xEF and data[1] == 0xBB and data[2] == 0xBF:
            whys[0], spots[0], first = QUIET + BYTE_ORDER, 1, np.int64(3)
        while end > first and (data[end - 1] == 10 or data[end - 1] == 13):
            end -= 1
        plain = _read_plain(data, first, end, row, block, out)
        if plain >= 0:
            row, opened = plain, True
            continue
        at, _ = _skip_comments(data, first, end)
        if _is_wait(data, at, end):
            whys[block], spots[block] = QUIET + SENDERS_WORD, at + 1
            continue
        if at < end and data[at] == 37:
            rest = _skip_blanks(data, at + 1, end)
            if opened and rest < end:
                # Somebody may obey it; it ends no program.
                whys[block], spots[block] = FAULT + AFTER_PERCENT, rest + 1
                continue
            if opened:
                return row, block
            rest, _ = _skip_comments(data, rest, end)
            if rest < end:
                whys[block], spots[block] = QUIET + AFTER_PERCENT, rest + 1
            opened = True
            continue
        known = row
        row, trait, why, where = _read_line(data, first, end, row, block, out)
        if why == FULL:
            return row, -1
        traits[block] = trait
        if why:
            whys[block], spots[block] = why, where + 1
        # Text that is no program may stand before its first percent sign.
        opened = opened or (row > known and why == 0)
    return row, lines.size - 1
