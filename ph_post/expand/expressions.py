"""Expressions of RS274/NGC and of Fanuc's custom macro, compiled to functions of the parameters.

The text has no blanks and no capitals. Angles are in degrees; true is 1, false 0; two numbers less than 1e-6 apart
are equal (LinuxCNC 2.9).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import ClassVar, Final

from ph_post.expand.faults import ExpandError
from ph_post.expand.values import LAST, Store

Value = Callable[[Store], float]
"""A value of the parameters."""

Levels = tuple[dict[str, Callable[[float, float], float]], ...]
"""Operations by precedence, the loosest first."""

Functions = dict[str, Callable[[float], float]]
"""Functions by name."""

EQUAL: Final = 1e-6

_NUMBER: Final = re.compile(r"[+-]?(?:\d+\.?\d*|\.\d+)")
_NAME: Final = re.compile(r"[a-z]+")


def _divide(left: float, right: float) -> float:
    if right == 0.0:
        raise ExpandError("division by zero")
    return left / right


def _modulo(left: float, right: float) -> float:
    if right == 0.0:
        raise ExpandError("division by zero")
    rest = math.fmod(left, right)
    return rest + abs(right) if rest < 0.0 else rest


def _power(left: float, right: float) -> float:
    if left < 0.0 and right % 1.0 > 0.0:
        raise ExpandError("a negative number to a power that is not whole")
    return _divide(1.0, 0.0) if left == 0.0 and right < 0.0 else left**right


def _known(compare: Callable[[float, float], bool]) -> Callable[[float, float], float]:
    def decide(left: float, right: float) -> float:
        return math.nan if math.isnan(left) or math.isnan(right) else float(compare(left, right))

    return decide


_LEVELS: Final[Levels] = (
    {
        "and": _known(lambda a, b: a != 0.0 and b != 0.0),
        "xor": _known(lambda a, b: (a != 0.0) != (b != 0.0)),
        "or": _known(lambda a, b: a != 0.0 or b != 0.0),
    },
    {
        "eq": _known(lambda a, b: abs(a - b) < EQUAL),
        "ne": _known(lambda a, b: abs(a - b) >= EQUAL),
        "ge": _known(lambda a, b: a >= b),
        "le": _known(lambda a, b: a <= b),
        "gt": _known(lambda a, b: a > b),
        "lt": _known(lambda a, b: a < b),
    },
    {"+": lambda a, b: a + b, "-": lambda a, b: a - b},
    {"*": lambda a, b: a * b, "/": _divide, "mod": _modulo},
    {"**": _power},
)
"""Operations, the loosest first; those of one level are worked out from left to right."""


def _of_domain(function: Callable[[float], float], low: float, high: float) -> Callable[[float], float]:
    def apply(value: float) -> float:
        if not low <= value <= high:
            raise ExpandError(f"{function.__name__.strip('_')} of a number outside of {low:g} to {high:g}")
        return function(value)

    return apply


def _asin(value: float) -> float:
    return math.degrees(math.asin(value))


def _acos(value: float) -> float:
    return math.degrees(math.acos(value))


def _ln(value: float) -> float:
    return math.log(value)


def _sqrt(value: float) -> float:
    return math.sqrt(value)


def _round(value: float) -> float:
    return float(math.trunc(value + (-0.5 if value < 0.0 else 0.5)))


_FUNCTIONS: Final[Functions] = {
    "abs": abs,
    "acos": _of_domain(_acos, -1.0, 1.0),
    "asin": _of_domain(_asin, -1.0, 1.0),
    "cos": lambda x: math.cos(x * math.pi / 180.0),
    "exp": math.exp,
    "fix": lambda x: float(math.floor(x)),
    "fup": lambda x: float(math.ceil(x)),
    "ln": _of_domain(_ln, 5e-324, math.inf),
    "round": _round,
    "sin": lambda x: math.sin(x * math.pi / 180.0),
    "sqrt": _of_domain(_sqrt, 0.0, math.inf),
    "tan": lambda x: math.tan(x * math.pi / 180.0),
}


class Parser:
    """Reads values of a text; `at` is the place that is read next.

    Parameters
    ----------
    text : str
        Without blanks, in small letters.
    at : int
    """

    levels: ClassVar[Levels] = _LEVELS
    functions: ClassVar[Functions] = _FUNCTIONS

    def __init__(self, text: str, at: int = 0) -> None:
        self.text, self.at = text, at

    def peek(self, length: int = 1) -> str:
        """Return what comes next."""
        return self.text[self.at : self.at + length]

    def take(self, text: str) -> None:
        """Pass over a text that has to stand here.

        Raises
        ------
        ExpandError
        """
        if not self.text.startswith(text, self.at):
            raise ExpandError("the expression is not whole", expected=text, got=self.text[self.at :][:20])
        self.at += len(text)

    def value(self) -> tuple[Value, float | None]:
        """Read a number, a parameter, an expression or a function: its function, and what it is if it is plain."""
        found = _NUMBER.match(self.text, self.at)
        if found:
            self.at = found.end()
            plain = float(found[0])
            return (lambda _: plain), plain
        return self._computed(), None

    def _computed(self) -> Value:
        first = self.peek()
        if first == "[":
            return self.expression()
        if first == "#":
            self.at += 1
            return self.parameter()
        if first and first in "+-":
            self.at += 1
            inner = self.value()[0]
            return inner if first == "+" else (lambda store: -inner(store))
        name = _NAME.match(self.text, self.at)
        if name:
            return self._function(name[0])
        raise ExpandError("there is no value", expected="a number, # or [", got=self.text[self.at :][:20])

    def parameter(self) -> Value:
        """Read a parameter behind its ``#``."""
        if self.peek() == "<":
            name = self.name()
            return lambda store: store.named(name)
        index, plain = self.value()
        if plain is not None:
            return lambda store: store.number(plain)
        return lambda store: store.number(index(store))

    def name(self) -> str:
        """Read a name between angle brackets."""
        end = self.text.find(">", self.at)
        if end < 0:
            raise ExpandError("the name does not end", expected=">")
        found, self.at = self.text[self.at + 1 : end], end + 1
        return found

    def _function(self, name: str) -> Value:
        for length in range(len(name), 1, -1):
            word = name[:length]
            if word in self.functions or word in ("atan", "exists"):
                self.at += length
                break
        else:
            raise ExpandError("there is no such function", got=name)
        if word == "exists":
            return self._exists()
        if word == "atan":
            return self._atan()
        return applied(self.functions[word], self.expression())

    def _atan(self) -> Value:
        above = self.expression()
        self.take("/")
        below = self.expression()

        def apply(store: Store) -> float:
            return math.degrees(math.atan2(above(store), below(store)))

        return apply

    def _exists(self) -> Value:
        self.take("[")
        self.take("#")
        if self.peek() != "<":
            index = self.value()[0]
            self.take("]")
            return lambda store: float(1 <= index(store) < LAST)
        name = self.name()
        self.take("]")
        return lambda store: float(store.exists(name))

    def expression(self) -> Value:
        """Read an expression in square brackets."""
        self.take("[")
        found = self._level(0)
        self.take("]")
        return found

    def _level(self, level: int) -> Value:
        if level == len(self.levels):
            return self.value()[0]
        left = self._level(level + 1)
        while True:
            word = next((one for one in self.levels[level] if self.text.startswith(one, self.at)), "")
            if not word or (word == "*" and self.peek(2) == "**"):
                return left
            self.at += len(word)
            left = _joined(left, self.levels[level][word], self._level(level + 1))


def _joined(left: Value, operation: Callable[[float, float], float], right: Value) -> Value:
    def apply(store: Store) -> float:
        return _finite(operation(left(store), right(store)))

    return apply


def applied(function: Callable[[float], float], inner: Value) -> Value:
    """Return the value of a function; what is not known stays so."""

    def apply(store: Store) -> float:
        value = inner(store)
        return value if math.isnan(value) else _finite(function(value))

    return apply


def _finite(value: float) -> float:
    if math.isinf(value):
        raise ExpandError("the number is beyond all bounds")
    return value
