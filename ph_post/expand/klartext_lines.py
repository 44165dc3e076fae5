"""Blocks, parameters and expressions of Heidenhain's conversational language."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import ClassVar, Final

import msgspec

from ph_post.expand.expressions import Functions, Levels, Parser, Value, applied
from ph_post.expand.faults import ExpandError
from ph_post.expand.values import UNKNOWN, NumberStore
from ph_post.expand.writing import number_text

NUMBER: Final = r"[-+]?(?:\d+[.,]?\d*|[.,]\d+)"
"""A number as it is written, with a point or a comma."""

ENDS: Final = re.compile(r"(?<![A-Z\d])M\s*0*(?:2|30)(?!\d)|^END\s+PGM")
"""The end of a program, in the words of a block."""

IN_INCHES: Final = re.compile(r"BEGIN\s+PGM\b.*\bIN(?:CH\b|$)")

OWN_FEED: Final = re.compile(r"(?<![A-Z])M\s*(?:103|128)\s*F\s*\S+")
"""F behind M103 is a share of the feed, and behind M128 that of the moves by which rotary axes are followed (iTNC 530,
User's Manual, Conversational, 11)."""
SIDE: Final = re.compile(r"(?<![A-Z])R([0LR])(?![\w.,])")
"""The cutter's side, in the words of a block."""

_LEAD: Final = re.compile(r"\s*(?:\d+(?=\s|$|/))?\s*(/?)\s*")
_KINDS: Final = {"": 0, "L": 1, "R": 2}
_KIND: Final = 10_000
_GIVEN: Final = (100, 199)
"""Parameters that the control fills."""
_PARAMETER: Final = re.compile(r"q([lr]?)(\d+)")
_DIVIDED: Final = Parser.levels[3]["/"]


def parameter_of(name: str) -> int:
    """Return the key of a parameter: Q, QL and QR count apart.

    Examples
    --------
    >>> parameter_of("Q5"), parameter_of("QL5")
    (5, 10005)

    Raises
    ------
    ExpandError
        Where no control has such a parameter.
    """
    letters = name.rstrip("0123456789")
    number = int(name[len(letters) :])
    if number >= _KIND:
        raise ExpandError("no such parameter", expected="Q0 to Q1999", got=name[:20])
    return _KINDS[letters[1:]] * _KIND + number


def tnc_value(text: str) -> float:
    """Return what a text says as a number; NaN where it is none, as the point behind an abbreviated name.

    Examples
    --------
    >>> tnc_value("-2,5"), tnc_value(".")
    (-2.5, nan)
    """
    return float(text.replace(",", ".")) if re.fullmatch(NUMBER, text) else math.nan


def tnc_number(value: float, decimals: int, *, sign: bool) -> str:
    """Write a number, with its sign where the language has one.

    Examples
    --------
    >>> tnc_number(2.5, 4, sign=True), tnc_number(-0.00001, 4, sign=True), tnc_number(200.0, 4, sign=False)
    ('+2.5', '+0', '200')
    """
    text = number_text(value, decimals)
    return text if text.startswith("-") or not sign else f"+{text}"


class KlartextBlock(msgspec.Struct, frozen=True, kw_only=True):
    """A block: its lines from `first` (from 0) on, its words in capitals without number, slash and comments.

    `lead` is what stands before the words; a line that ends in ``~`` goes on in the next one.
    """

    first: int
    lines: list[str]
    words: str
    lead: str
    slash: bool

    def with_words(self, text: str) -> list[str]:
        """Return the block with other words, on one line, or each value of a cycle on its own; with its comments."""
        comments = [line.partition(";")[2].replace("~", "").strip() for line in self.lines]
        values = [text] if len(self.lines) == 1 else re.split(r"\s+(?=Q\d+\s*=)", text)
        rows = [f"{self.lead}{values[0]}", *(f"  {one}" for one in values[1:])]
        if len(rows) == len(comments):
            rows = [f"{row} ; {comment}" if comment else row for row, comment in zip(rows, comments, strict=True)]
        return [f"{row} ~" for row in rows[:-1]] + rows[-1:]


def read_blocks(texts: Sequence[str]) -> list[KlartextBlock]:
    """Put lines together to blocks."""
    blocks: list[KlartextBlock] = []
    at = 0
    while at < len(texts):
        last = at
        while last + 1 < len(texts) and (texts[last].rstrip().endswith("~") or _goes_on(texts, at, last + 1)):
            last += 1
        lines = list(texts[at : last + 1])
        lead = _LEAD.match(lines[0])
        assert lead is not None
        bare = [line.partition(";")[0].replace("~", " ") for line in [lines[0][lead.end() :], *lines[1:]]]
        words = " ".join(" ".join(bare).upper().split())
        blocks.append(KlartextBlock(first=at, lines=lines, words=words, lead=lead[0], slash=bool(lead[1])))
        at = last + 1
    return blocks


def _goes_on(texts: Sequence[str], first: int, at: int) -> bool:
    """Return whether a line without a number has a value of the cycle that a numbered line begins."""
    head = re.match(r"\s*\d+\s+CYCL\s+DEF\s+\d+(?!\.)\b", texts[first], re.IGNORECASE)
    return head is not None and re.match(r"\s*Q\d{3,4}\s*=", texts[at], re.IGNORECASE) is not None


class KlartextStore(NumberStore):
    """Q parameters; what the program did not set, and what the control fills, is NaN."""

    def number(self, index: float) -> float:
        """Return a parameter by its key."""
        key = round(index)
        found = UNKNOWN if _GIVEN[0] <= key <= _GIVEN[1] else self.numbers.get(key, UNKNOWN)
        if math.isnan(found):
            kind = next(letters for letters, number in _KINDS.items() if number == key // _KIND)
            self.doubt = f"Q{kind}{key % _KIND}"
        return found

    def forget_one(self, key: int) -> None:
        """Forget a parameter."""
        self.put(key, UNKNOWN)


def _rest(left: float, right: float) -> float:
    if right == 0.0:
        raise ExpandError("division by zero")
    # Nobody says what the rest of a negative number is.
    return math.fmod(left, right) if left >= 0.0 and right > 0.0 else UNKNOWN


def _power(left: float, right: float) -> float:
    if left == 0.0 and right == 0.0:
        raise ExpandError("0 to the power of 0")
    return Parser.levels[4]["**"](left, right)


def _angle(opposite: float, adjacent: float) -> float:
    return math.degrees(math.atan2(opposite, adjacent)) % 360.0


def _log(value: float) -> float:
    if value <= 0.0:
        raise ExpandError("the logarithm of a number that is not above 0")
    return math.log10(value)


class KlartextParser(Parser):
    """Reads the formulas of the control, whose functions have no brackets, and the words of FN 1 to FN 13."""

    levels: ClassVar[Levels] = (
        Parser.levels[2],
        {"*": lambda a, b: a * b, "/": _DIVIDED, "div": _DIVIDED, "%": _rest, "len": math.hypot, "ang": _angle},
        {"^": _power},
    )
    functions: ClassVar[Functions] = {
        **{name: Parser.functions[name] for name in ("sin", "cos", "tan", "asin", "acos", "sqrt", "abs", "exp", "ln")},
        "atan": lambda x: math.degrees(math.atan(x)),
        "sq": lambda x: x * x,
        "log": _log,
        "neg": lambda x: -x,
        "int": lambda x: float(math.trunc(x)),
        "frac": lambda x: math.fmod(x, 1.0),
        # Of 0 it is 1 on some controls, and 0 on others.
        "sgn": lambda x: math.copysign(1.0, x) if x else UNKNOWN,
    }

    def _computed(self) -> Value:
        found = _PARAMETER.match(self.text, self.at)
        if found is not None:
            self.at = found.end()
            key = parameter_of(found[0].upper())
            return lambda store: store.number(key)
        if self.text.startswith("pi", self.at):
            self.at += len("pi")
            return lambda _: math.pi
        return super()._computed()

    def _function(self, name: str) -> Value:
        word = next((name[:k] for k in range(len(name), 1, -1) if name[:k] in self.functions), "")
        if not word:
            raise ExpandError("there is no such function", got=name)
        self.at += len(word)
        return applied(self.functions[word], self.value()[0])


def value_of(text: str, store: KlartextStore) -> float:
    """Return the value of a formula, NaN where it has what is not known here.

    Examples
    --------
    >>> store = KlartextStore()
    >>> store.put(5, 3.0)
    >>> value_of("SQRT ( Q5 + 13 ) * -2", store), value_of("+4 DIV +Q5", store) * 3
    (-8.0, 4.0)
    """
    bare = re.sub(r"\s+", "", text).replace(",", ".").replace("(", "[").replace(")", "]").lower()
    parser = KlartextParser(f"[{bare}]")
    try:
        value = parser.expression()
    except ExpandError:
        value = None
    if value is None or parser.at != len(parser.text):
        store.doubt = text.strip()[:40]
        return UNKNOWN
    return value(store)
