"""JSON whose numbers are kept exactly as they are written: ``0.1`` is one tenth, and ``"9/8"`` nine eighths.

What cannot be taken (NaN, a number beyond a double's range, a key given twice) stands in the decoded value as
a :class:`Refused`, so that the check of the types that follows meets it at its place and can name its key.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable
from decimal import Decimal
from fractions import Fraction
from typing import Any

from ph_post.errors import InputError

MAX_DIGITS = 1000
"""Longest number taken, in characters; nobody writes more by hand and no program needs to."""

_PLAIN = 40
"""A number of this many characters and no exponent lies well inside a double's range."""

_RATIONAL = re.compile(r"\s*([+-]?[0-9]+)(?:/([0-9]+))?\s*")


class Refused:
    """What stands in the place of something that cannot be taken: the reason, and what was found."""

    def __init__(self, what: str, expected: str, got: str) -> None:
        self.what = what
        self.expected = expected
        self.got = got


def loads(text: str, name: str, number: Callable[[str], Any] | None = None) -> Any:
    """Decode JSON with non-integers as Fraction and :class:`Refused` where something cannot be taken.

    Parameters
    ----------
    text, name : str
        The text, and what a refusal calls it.
    number : callable, optional
        What makes a value of the text of a non-integer, in place of Fraction.

    Raises
    ------
    InputError
        ``name:line:column`` where the text is no JSON.

    Examples
    --------
    >>> loads('{"feed": 0.1}', "a.json")
    {'feed': Fraction(1, 10)}
    """
    try:
        return json.loads(
            text,
            parse_float=number or _decimal,
            parse_int=_integer,
            parse_constant=lambda word: Refused("not a number", "a finite number", word),
            object_pairs_hook=_object,
        )
    except json.JSONDecodeError as error:
        raise _syntax_error(error, name) from None
    except RecursionError:
        raise InputError(name, "brackets are nested too deeply") from None


def rational(text: str) -> Fraction | Refused:
    """Read an exact rational string.

    Examples
    --------
    >>> rational("9/8")
    Fraction(9, 8)
    """
    match = _RATIONAL.fullmatch(text) if len(text) <= MAX_DIGITS else None
    if match is None:
        return Refused("not a number", 'a number, or a rational string such as "9/8"', quoted(text))
    below = int(match[2] or 1)
    if below == 0:
        return Refused("division by zero", "a denominator other than 0", quoted(text))
    value = Fraction(int(match[1]), below)
    return value if fits(value) else _out_of_range(quoted(text))


def fits(value: Fraction) -> bool:
    """Whether a double holds `value` with its full number of digits (zero does)."""
    try:
        size = abs(value.numerator / value.denominator)
    except OverflowError:
        return False
    return value == 0 or size >= 2.0**-1022


def quoted(text: str, width: int = 40) -> str:
    """Show a string in a message: quoted, cut where it is long, escaped where it would not print."""
    short = text if len(text) <= width else text[: width - 3] + "..."
    return json.dumps(short, ensure_ascii=not short.isprintable())


def _decimal(text: str) -> Fraction | Refused:
    if len(text) > MAX_DIGITS:
        return _out_of_range(f"{len(text)} characters")
    if len(text) > _PLAIN or "e" in text or "E" in text:
        size = float(text)  # looked at first: the exact value of 1e-999999999 would fill the memory
        if math.isinf(size) or (abs(size) < 2.0**-1022 and re.match(r"[^eE]*[1-9]", text)):
            return _out_of_range(text[:_PLAIN])
        if size == 0:
            return Fraction(0)
    return Fraction(Decimal(text))


def _integer(text: str) -> int | Refused:
    if len(text) > MAX_DIGITS:
        return _out_of_range(f"{len(text)} digits")
    value = int(text)
    return value if len(text) <= _PLAIN or fits(Fraction(value)) else _out_of_range(f"{len(text)} digits")


def _out_of_range(got: str) -> Refused:
    return Refused("number out of range", "0, or 1e-308 to 1e308 in size", got)


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any] | Refused:
    made = dict(pairs)
    if len(made) == len(pairs):
        return made
    seen: set[str] = set()
    for key, _ in pairs:
        if key in seen:
            break
        seen.add(key)
    return Refused(f"key {quoted(key)} is given twice", "each key once", "")


def _syntax_error(error: json.JSONDecodeError, name: str) -> InputError:
    where = f"{name}:{error.lineno}:{error.colno}"
    rest = error.doc[error.pos :].split("\n")[0].strip()
    got = quoted(rest, 20) if rest else "the end of the line" if error.doc[error.pos :].strip() else "the end"
    expecting, _, wanted = error.msg.partition("Expecting ")
    if not expecting:
        return InputError(where, "not valid JSON", expected=wanted, got=got)
    return InputError(where, f"not valid JSON: {error.msg[:1].lower()}{error.msg[1:]}", got=got)
