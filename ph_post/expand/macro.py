"""Variables, expressions and lines of Fanuc's custom macro B.

Fanuc, Operator's manual of the series 0i-F and 30i (B-64604EN, B-63944EN), "Custom macro". A variable that is empty
counts as 0 in sums, and as nothing in a word.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import ClassVar, Final

import msgspec

from ph_post.expand.expressions import Functions, Levels, Parser, Value
from ph_post.expand.faults import ExpandError, NotExpandableError
from ph_post.expand.values import Store

LOCAL: Final = 33
"""Variables 1 to 33 belong to the macro."""

ARGUMENTS: Final = {
    **dict(zip("abcijkdefhm", (1, 2, 3, 4, 5, 6, 7, 8, 9, 11, 13), strict=True)),
    **dict(zip("qrstuvwxyz", range(17, 27), strict=True)),
}
"""Variables of the words of G65 (argument specification I)."""

_LENGTHS: Final = "abcijkqruvwxyz"
_WHOLE: Final = "gmnopthdsl"
_CLOSE: Final = 1e-6


class FanucNumbers(msgspec.Struct, frozen=True, kw_only=True):
    """How a control counts: decimals of a mm in its increments, and whether a length without a point is in units.

    `clearance` [mm] is how far G73 and G83 back off (parameters 5114 and 5115), None where nobody says; `lathe` says
    that it is the control of a lathe; `doubtful` that nobody knows whether such a length is in units.
    """

    decimals: int = 3
    calculator: bool = False
    doubtful: bool = False
    clearance: float | None = None
    lathe: bool = False


COUNTED: Final = "lengths without a decimal point count in increments"
"""What the head of a compensated program says where that is so: its lines with such lengths may be others."""
SMALL: Final = 1000
"""Lengths without a decimal point that are below this many increments are doubtful where all of a program are."""
_PLACES: Final = re.compile(rb"G0*4(?!\d)[^\r\n]*|[XYZUVWIJR][ \t]*(?:[-+][ \t]*)?0*([1-9]\d*)(?![\d.])")
"""The digits of a length; what stands beside a dwell is none."""


def is_doubtful(data: bytes, bare: bytes) -> bool:
    r"""Return whether nobody knows from a program what its lengths without a decimal point count in.

    A setting of the control makes them increments or mm (parameter 3401, bit 0). Where all of them are so small that
    nothing of it moves by a millimetre in increments, whoever wrote it most likely meant mm.

    Parameters
    ----------
    data, bare : bytes
        The program, and the same in capitals without its comments.

    Examples
    --------
    >>> [is_doubtful(text, text) for text in (b"G1 X25 Y-27.5", b"G1 X25000 Y-500", b"G1 X25.\nG4 X2")]
    [True, False, False]
    """
    digits = [len(found[1]) for found in _PLACES.finditer(bare) if found[1]]
    return bool(digits) and max(digits) < len(str(SMALL)) and COUNTED.encode().upper() not in data.upper()


class Empty(float):
    """The value of an empty variable."""

    def __neg__(self) -> Empty:
        return self


EMPTY: Final = Empty(0.0)


class MacroStore(Store):
    """The variables of Fanuc; what only the control knows is NaN."""

    def __init__(self) -> None:
        super().__init__(lambda _: None, lambda _: math.nan)

    def number(self, index: float) -> float:
        """Return a variable."""
        key = self.index_of(index)
        if key == 0:
            return EMPTY
        if key <= LOCAL:
            return self.frame.numbers.get(key, math.nan if self._lost else EMPTY)
        found = self.numbers.get(key, math.nan)
        if math.isnan(found):
            self.doubt = f"#{key}"
        return found

    def index_of(self, value: float) -> int:
        """Return the number of a variable."""
        if math.isnan(value):
            raise NotExpandableError(f"a variable whose number is not known: {self.doubt}")
        key = round(value)
        if abs(value - key) > 1e-4 or key < 0 or LOCAL < key < 100:
            raise ExpandError("there is no such variable", expected="#1 to #33, or from #100 on", got=f"#{value:g}")
        return key

    def put(self, key: int | str, value: float) -> None:
        """Give a variable a value."""
        assert isinstance(key, int)
        if key == 0:
            raise ExpandError("#0 is always empty")
        if key >= 1000:
            raise NotExpandableError(f"the program sets #{key}, which belongs to the control")
        space = self.frame.numbers if key <= LOCAL else self.numbers
        had, space[key] = space.get(key), value
        if had is None or had != value or isinstance(had, Empty) != isinstance(value, Empty):
            self.version += 1


def _compared(compare: Callable[[float, float], bool], *, empty: bool | None = None) -> Callable[[float, float], float]:
    def decide(left: float, right: float) -> float:
        if math.isnan(left) or math.isnan(right):
            return math.nan
        if empty is not None and isinstance(left, Empty) != isinstance(right, Empty):
            return float(not empty)
        if 0.0 < abs(left - right) < _CLOSE:
            raise NotExpandableError("a condition of two numbers that are equal but for rounding")
        return float(compare(left, right))

    return decide


def _bits(operation: Callable[[int, int], int]) -> Callable[[float, float], float]:
    def apply(left: float, right: float) -> float:
        if math.isnan(left) or math.isnan(right):
            return math.nan
        return float(operation(round(left), round(right)))

    return apply


def _modulo(left: float, right: float) -> float:
    if round(right) == 0:
        raise ExpandError("division by zero")
    return math.fmod(round(left), round(right))


def _rounded_in_word(_: float) -> float:
    raise NotExpandableError("ROUND in a word, which rounds to the control's increment")


_BITS: Final = {"or": _bits(lambda a, b: a | b), "xor": _bits(lambda a, b: a ^ b)}


class MacroParser(Parser):
    """Reads values of custom macros."""

    levels: ClassVar[Levels] = (
        {
            "eq": _compared(lambda a, b: a == b, empty=True),
            "ne": _compared(lambda a, b: a != b, empty=False),
            "ge": _compared(lambda a, b: a >= b),
            "gt": _compared(lambda a, b: a > b),
            "le": _compared(lambda a, b: a <= b),
            "lt": _compared(lambda a, b: a < b),
        },
        {"+": Parser.levels[2]["+"], "-": Parser.levels[2]["-"], **_BITS},
        {"*": Parser.levels[3]["*"], "/": Parser.levels[3]["/"], "mod": _modulo, "and": _bits(lambda a, b: a & b)},
    )
    functions: ClassVar[Functions] = {
        **{name: Parser.functions[name] for name in ("abs", "acos", "asin", "cos", "exp", "ln", "sin", "sqrt", "tan")},
        "round": Parser.functions["round"],
        "fix": lambda x: float(math.trunc(x)),
        "fup": lambda x: float(math.floor(x) if x < 0.0 else math.ceil(x)),
    }


class WordParser(MacroParser):
    """Reads values of words."""

    functions: ClassVar[Functions] = {**MacroParser.functions, "round": _rounded_in_word}


class MacroLine(msgspec.Struct, frozen=True, kw_only=True):
    """A line of a Fanuc program.

    `parts` are its text, with a letter and a value where a number is computed; `plain` its words that are not.
    `order` is "", "set", "goto", "then", "while" or "end"; `condition`, `value` and `index` belong to it, and `number`
    is that of a loop. `label` is its N word, `program` its O word.
    """

    text: str
    parts: tuple[str | tuple[str, Value], ...] = ()
    plain: tuple[tuple[str, str], ...] = ()
    order: str = ""
    condition: Value | None = None
    value: Value | None = None
    index: Value | None = None
    number: int = 0
    label: int = -1
    program: int = -1
    computed: bool = False
    optional: bool = False
    fault: ExpandError | None = None


COMMENT: Final = re.compile(r"\([^)]*\)?")
_LITERAL: Final = re.compile(r"[a-z,]*[a-z]([+-]?(?:\d+\.?\d*|\.\d+))?")
_BEHIND: Final = re.compile(r"(?<=[\d.])/[1-9]?(?=[a-z])")
"""A slash within a block, from which on the control's switch leaves it out (B-64484EN, "Optional block skip")."""
_LABEL: Final = re.compile(r"n(\d+)")
_PROGRAM: Final = re.compile(r"[o:](\d+)")


def read_macro_line(text: str) -> MacroLine:
    """Read a line of a Fanuc program."""
    bare = re.sub(r"\s+", "", COMMENT.sub("", text)).lower()
    bare = bare.lstrip(")") and bare  # what closes a comment in which another one stood
    optional, bare = bare.startswith("/"), bare.lstrip("/")
    if _BEHIND.search(bare) and not {"[", "#"} & set(bare):
        # What is behind it runs or not, and so what the line comes to is not known.
        optional, bare = True, _BEHIND.sub("", bare)
    program = _PROGRAM.match(bare)
    if program:
        return MacroLine(text=text, program=int(program[1]))
    label = _LABEL.match(bare)
    body = bare[label.end() :] if label else bare
    found = int(label[1]) if label else -1
    try:
        line = _read_body(text, body)
    except ExpandError as error:
        line = MacroLine(text=text, fault=error)
    except RecursionError:
        line = MacroLine(text=text, fault=ExpandError("brackets within brackets are too deep"))
    return msgspec.structs.replace(line, label=found, optional=optional)


def _read_body(text: str, body: str) -> MacroLine:
    parser = MacroParser(body)
    if body.startswith("#"):
        index, value = _assignment(parser)
        return MacroLine(text=text, order="set", index=index, value=value, computed=True)
    if body.startswith("goto"):
        parser.at = 4
        return MacroLine(text=text, order="goto", value=parser.value()[0], computed=True)
    if body.startswith("if"):
        return _read_if(text, parser)
    if body.startswith("while"):
        parser.at = 5
        condition = parser.expression()
        parser.take("do")
        return MacroLine(text=text, order="while", condition=condition, number=_digits(parser), computed=True)
    if body.startswith("end") and body[3:].isdecimal():
        return MacroLine(text=text, order="end", number=int(body[3:]), computed=True)
    return _read_words(text, body)


def _digits(parser: Parser) -> int:
    if not parser.text[parser.at :].isdecimal():
        raise ExpandError("the loop has no number", expected="DO1 to DO3", got=parser.text[parser.at :][:20])
    return int(parser.text[parser.at :])


def _assignment(parser: Parser) -> tuple[Value, Value]:
    parser.take("#")
    index = parser.value()[0]
    parser.take("=")
    value, whole = _sum(parser)
    if not whole:
        raise ExpandError("the assignment is not whole", got=parser.text[parser.at :][:20])
    return index, value


def _sum(parser: Parser) -> tuple[Value, bool]:
    """Read the right side of an assignment, which needs no brackets."""
    inner = type(parser)(f"[{parser.text[parser.at :]}]")
    value = inner.expression()
    return value, inner.at == len(inner.text)


def _read_if(text: str, parser: Parser) -> MacroLine:
    parser.at = 2
    condition = parser.expression()
    if parser.peek(4) == "goto":
        parser.at += 4
        return MacroLine(text=text, order="goto", condition=condition, value=parser.value()[0], computed=True)
    parser.take("then")
    index, value = _assignment(parser)
    return MacroLine(text=text, order="then", condition=condition, index=index, value=value, computed=True)


def _read_words(text: str, body: str) -> MacroLine:
    parser = WordParser(body)
    parts: list[str | tuple[str, Value]] = []
    plain: list[tuple[str, str]] = []
    while parser.at < len(body):
        literal = _LITERAL.match(body, parser.at)
        if literal is None:
            if body[parser.at] in "%;,":
                return MacroLine(text=text)
            raise ExpandError("the line cannot be read", got=body[parser.at :][:20])
        letter = body[literal.end() - 1] if literal[1] is None else literal[0][: -len(literal[1])][-1:]
        parser.at = literal.end()
        if literal[1] is None and parser.peek() and parser.peek() in "#[+-":
            parts.append((literal[0], parser.value()[0]))
            continue
        parts.append(literal[0])
        plain.append((letter, literal[1] or ""))
    computed = any(not isinstance(part, str) for part in parts)
    return MacroLine(text=text, parts=tuple(parts), plain=tuple(plain), computed=computed)


def word_text(letters: str, value: float, decimals: int) -> str:
    """Write a word whose number was computed; an empty variable leaves it out.

    Examples
    --------
    >>> word_text("x", 12.0, 3), word_text("g", 1.0, 3), word_text("x", EMPTY, 3), word_text("f", 0.12345, 3)
    ('X12.', 'G1', '', 'F0.12345')
    """
    if isinstance(value, Empty):
        return ""
    letter = letters[-1]
    if letter in _WHOLE:
        if abs(value - round(value, 1 if letter == "g" else 0)) > 1e-6:
            raise ExpandError(f"{letter.upper()} has to be a whole number", got=f"{value:g}")
        return f"{letters.upper()}{round(value, 1):g}"
    places = decimals if letter in _LENGTHS else 5
    text = f"{value:.{places}f}".rstrip("0")
    return letters.upper() + ("0." if text in ("-0.", "0.") else text)


def plain_value(letters: str, number: str, numbers: FanucNumbers, units: int) -> float:
    """Return the value of a word that is no expression, NaN where it counts in increments of unknown `units` or size.

    Examples
    --------
    >>> plain_value("x", "1500", FanucNumbers(), 210), plain_value("x", "1.5", FanucNumbers(), 0)
    (1.5, 1.5)
    """
    value = float(number or "nan")
    if letters[-1] not in _LENGTHS or "." in number or value == 0.0 or numbers.calculator:
        return value
    if units == 0 or numbers.doubtful:
        return math.nan
    return value * 10.0 ** -(numbers.decimals + (1 if units == 200 and letters[-1] not in "abc" else 0))


def argument(letter: str, number: str) -> float:
    """Return the value of a plain word of G65.

    Raises
    ------
    NotExpandableError
        Where a length has no decimal point: what it counts in depends on the control.
    """
    if letter in _LENGTHS and "." not in number and float(number) != 0.0:
        raise NotExpandableError(f"a value of G65 without a decimal point: {letter.upper()}{number}")
    return float(number)
