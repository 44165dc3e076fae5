"""R parameters and variables as far as their values follow from the lines before: sums and products of numbers."""

from __future__ import annotations

import re
from decimal import ROUND_HALF_EVEN, Decimal, DecimalException
from typing import Final

_TOKEN: Final = re.compile(r"\s*(?:([A-Z_]\w+)|(\d+\.?\d*|\.\d+)|([-+*/()]))", re.IGNORECASE)
_STEP: Final = Decimal("1e-9")
"""Quotients are rounded to this."""

_MOST: Final = 100
"""Numbers and signs of an expression that is worked out."""


def evaluate(text: str, known: dict[str, Decimal]) -> Decimal | None:
    """Return the value of an expression; None where it has anything but numbers, known parameters and + - * /.

    Examples
    --------
    >>> evaluate("R1+2*(3-R2)/4", {"R1": Decimal(10), "R2": Decimal(1)}), evaluate("SIN(30)", {})
    (Decimal('11'), None)
    """
    tokens: list[str] = []
    place, text = 0, text.rstrip()
    while place < len(text):
        found = _TOKEN.match(text, place)
        if found is None:
            return None
        tokens.append(found[0].strip().upper())
        place = found.end()
    if len(tokens) > _MOST:
        return None
    try:
        value, rest = _sum(tokens, known)
        if rest:
            return None
        exact = value.as_tuple().exponent
        whole = value if isinstance(exact, int) and exact >= -9 else value.quantize(_STEP, rounding=ROUND_HALF_EVEN)
        return whole.normalize() + 0
    except (DecimalException, LookupError):
        return None


def _sum(tokens: list[str], known: dict[str, Decimal]) -> tuple[Decimal, list[str]]:
    value, tokens = _product(tokens, known)
    while tokens and tokens[0] in ("+", "-"):
        other, rest = _product(tokens[1:], known)
        value = value + other if tokens[0] == "+" else value - other
        tokens = rest
    return value, tokens


def _product(tokens: list[str], known: dict[str, Decimal]) -> tuple[Decimal, list[str]]:
    value, tokens = _factor(tokens, known)
    while tokens and tokens[0] in ("*", "/"):
        other, rest = _factor(tokens[1:], known)
        value = value * other if tokens[0] == "*" else value / other
        tokens = rest
    return value, tokens


def _factor(tokens: list[str], known: dict[str, Decimal]) -> tuple[Decimal, list[str]]:
    first, rest = tokens[0], tokens[1:]
    if first in ("-", "+"):
        value, rest = _factor(rest, known)
        return (-value if first == "-" else value), rest
    if first == "(":
        value, rest = _sum(rest, known)
        return value, rest[{")": 1}[rest[0]] :]
    return (known[first] if first[0] == "_" or first[0].isalpha() else Decimal(first)), rest
