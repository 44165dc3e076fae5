"""Decode JSON and TOML with exact numbers, and check them against typed records.

``0.1`` is one tenth and ``"9/8"`` nine eighths. A value that cannot be taken (NaN, a number beyond a double's
range, a key given twice) stands in the decoded data as a :class:`Refused`, so that the check of the types that
follows meets it at its place and can name its key. msgspec checks and names the place; the messages here add
what stands there and the nearest known key.
"""

from __future__ import annotations

import difflib
import json
import math
import re
import tomllib
import unicodedata
from collections.abc import Callable, Iterable, Sequence
from decimal import Decimal
from fractions import Fraction
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from ph_post.errors import InputError

MAX_DIGITS = 1000
"""Longest number taken, in characters; nobody writes more by hand and no program needs to."""

_PLAIN = 40
"""A number of this many characters and no exponent lies well inside a double's range."""

_SIZES = (1e-15, 1e15)
"""Numbers of a TOML file that are not 0, in size."""

_RATIONAL = re.compile(r"\s*([+-]?[0-9]+)(?:/([0-9]+))?\s*")


class Refused:
    """Stands in the place of a value that cannot be taken: the reason, and what was found."""

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


def parse_toml(text: str, name: str) -> dict[str, Any]:
    """Decode TOML, with :class:`Refused` in place of numbers that cannot be taken.

    Raises
    ------
    InputError
        ``name:line:column`` where the text is no TOML.
    """
    try:
        return tomllib.loads(text, parse_float=_toml_number)
    except ValueError as error:  # TOMLDecodeError, and an integer of thousands of digits
        message = str(error)
    except RecursionError:
        raise InputError(name, "brackets are nested too deeply") from None
    match = re.fullmatch(r"(.*) \(at (?:line (\d+), column (\d+)|end of document)\)", message, re.DOTALL)
    if match is None:
        raise InputError(name, f"not valid TOML: {message}")
    end = text.count("\n") + 1
    where = f"{name}:{match[2]}:{match[3]}" if match[2] else f"{name}:{end}"
    what = f"not valid TOML: {match[1][:1].lower()}{match[1][1:]}"
    raise InputError(where, what, got="" if match[2] else "the end of the file")


def _toml_number(text: str) -> float | Refused:
    value = float(text)
    if not math.isfinite(value):
        return Refused("not finite", "a finite number", text)
    if value == 0 or _SIZES[0] <= abs(value) <= _SIZES[1]:
        return value
    return Refused("number out of range", f"0, or {_SIZES[0]:g} to {_SIZES[1]:g} in size", quoted(text))


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
    """Return whether a double holds `value` with its full number of digits (zero does)."""
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


T = TypeVar("T")
Keys = tuple[str | int, ...]

_MESSAGE = re.compile(r"(?P<what>.*?)(?: - at `\$(?P<path>[^`]*)`)?", re.DOTALL)
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+)\]")
_WORDS: dict[type[inspect.Type], str] = {
    inspect.CustomType: "a number",
    inspect.StrType: "a string",
    inspect.BoolType: "true or false",
    inspect.StructType: "a table of keys",
    inspect.NoneType: "null",
    inspect.Type: "something else",
}
_NOT_IN_A_LINE = {"Cc", "Cs", "Zl", "Zp"}
_KEY = re.compile(r"Object (contains unknown|missing required) field `(.*)`", re.DOTALL)


def checked(raw: Any, record: type[T], name: str, prefix: Keys = ()) -> T:
    """Convert `raw` to `record`; `prefix` is where `raw` stands in the file.

    Raises
    ------
    InputError
        One line with the file's `name`, the key's path, what was expected and what was found.
    """
    try:
        return msgspec.convert(raw, record, dec_hook=_number)
    except msgspec.ValidationError as error:
        raise _refusal(str(error), raw, record, name, prefix) from None


def place(name: str, keys: Iterable[str | int]) -> str:
    """Write a place in a file.

    Examples
    --------
    >>> place("oval.json", ("segments", 3, "points"))
    'oval.json: segments[3].points'
    """
    path = "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in keys).lstrip(".")
    return f"{name}: {path}" if path else name


def one_of(known: Iterable[str], wrong: str | None = None) -> str:
    """Name the known word nearest to `wrong`, or list them all where none is near.

    Examples
    --------
    >>> one_of(["line", "arc", "bezier"], "beziere")
    'bezier'
    >>> one_of(["line", "arc", "bezier"], "helix")
    'one of line, arc, bezier'
    """
    words = list(known)
    if len(words) == 1:
        return words[0]
    near = difflib.get_close_matches(wrong or "", words, 1)
    return near[0] if near else f"one of {', '.join(words)}"


def shown(value: Any) -> str:
    """Show what stands in a file, on one line and never long."""
    if isinstance(value, str):
        return quoted(value)
    if isinstance(value, Refused):
        return value.got
    if isinstance(value, bool) or value is None:
        return {True: "true", False: "false", None: "null"}[value]
    if isinstance(value, Fraction):
        return f"{value.numerator / value.denominator:.12g}"
    if isinstance(value, list | tuple | dict):
        return "a table of keys" if isinstance(value, dict) else f"a list of {len(value)}"
    text = str(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _number(wanted: type, value: Any) -> Fraction:
    """Take a number of a path file; msgspec calls this for every field of type Fraction."""
    if type(value) is Fraction:
        return value
    if type(value) is int:
        return Fraction(value)
    exact = rational(value) if type(value) is str else None
    if isinstance(exact, Fraction):
        return exact
    raise ValueError(wanted.__name__)  # the words are found in _refusal


def _refusal(message: str, raw: Any, record: type, name: str, prefix: Keys) -> InputError:
    """Say in our words what msgspec found."""
    match = _MESSAGE.fullmatch(message)
    what, path = (match["what"], match["path"] or "") if match else (message, "")
    keys: Keys = tuple(key or int(number) for key, number in _STEP.findall(path))
    value, kind = _descend(raw, inspect.type_info(record), keys)
    where = place(name, prefix + keys)
    if isinstance(value, str) and isinstance(kind, inspect.CustomType):
        value = rational(value)
    if isinstance(value, Refused):
        return InputError(where, value.what, expected=value.expected, got=value.got)
    about_key = _KEY.fullmatch(what)
    if about_key is None:
        return InputError(where, _fault(kind, value), expected=_wanted(kind, value), got=shown(value))
    about, key = about_key.groups()
    if about == "contains unknown":
        return InputError(where, f"unknown key {quoted(key)}", expected=one_of(_fields(kind), key))
    return InputError(where, f"key {quoted(key)} is missing", expected=_wanted(_below(kind, key), None))


def _descend(value: Any, kind: inspect.Type, keys: Keys) -> tuple[Any, inspect.Type]:
    """Follow `keys` through the decoded value and, beside it, through its type."""
    kind = _settle(kind, value)
    for key in keys:
        value = value[key]
        kind = _settle(_below(kind, key), value)
    return value, kind


def _below(kind: inspect.Type, key: str | int) -> inspect.Type:
    """Type of one item of a list, of one key of a record, or of the tag that distinguishes records."""
    if isinstance(kind, inspect.ListType | inspect.VarTupleType):
        return kind.item_type
    if key in (fields := _fields(kind)):
        return fields[str(key)]
    records = kind.types if isinstance(kind, inspect.UnionType) else (kind,)
    return inspect.LiteralType(tuple(one.tag for one in records if isinstance(one, inspect.StructType)))


def _settle(kind: inspect.Type, value: Any) -> inspect.Type:
    """Choose among the records of a union by the tag in `value`; drop the null of an optional field."""
    if not isinstance(kind, inspect.UnionType):
        return kind
    kinds = [one for one in kind.types if not isinstance(one, inspect.NoneType)]
    for one in kinds:
        if isinstance(one, inspect.StructType) and isinstance(value, dict) and value.get(one.tag_field) == one.tag:
            return one
    return kinds[0] if len(kinds) == 1 else kind


def _fields(kind: inspect.Type) -> dict[str, inspect.Type]:
    """Keys of a record and their types, the tag that distinguishes it first."""
    if not isinstance(kind, inspect.StructType):
        return {}
    fields = {field.encode_name: field.type for field in kind.fields}
    return fields if kind.tag_field is None else {kind.tag_field: inspect.LiteralType((kind.tag,)), **fields}


def _fault(kind: inspect.Type, value: Any) -> str:
    """Name what is wrong with `value` where a `kind` should stand."""
    if isinstance(kind, inspect.LiteralType):
        return "unknown value"
    if isinstance(kind, inspect.ListType) and isinstance(value, list):
        return "wrong count"
    number = isinstance(value, int | float | Fraction) and not isinstance(value, bool)
    whole = isinstance(kind, inspect.IntType) and isinstance(value, int)
    if number and (whole or isinstance(kind, inspect.FloatType)):
        return "out of range"
    return "wrong type"


def _wanted(kind: inspect.Type, value: Any) -> str:
    """Say what a `kind` is."""
    match kind:
        case inspect.LiteralType(values=values):
            return one_of([str(one) for one in values], value if isinstance(value, str) else None)
        case inspect.IntType() | inspect.FloatType():
            return _bounded("a whole number" if isinstance(kind, inspect.IntType) else "a number", kind)
        case inspect.ListType(min_length=least) | inspect.VarTupleType(min_length=least):
            return f"a list of at least {least}" if least else "a list"
        case inspect.UnionType(types=types):
            return " or ".join(dict.fromkeys(_wanted(one, value) for one in types))
    return next(words for known, words in _WORDS.items() if isinstance(kind, known))


def _bounded(words: str, kind: inspect.IntType | inspect.FloatType) -> str:
    bounds = ((">", kind.gt), (">=", kind.ge), ("<", kind.lt), ("<=", kind.le))
    limits = " and ".join(f"{sign} {bound:g}" for sign, bound in bounds if bound is not None)
    return f"{words} {limits}" if limits else words


def one_line(text: str, name: str, keys: Keys) -> str:
    """Return `text`, which goes into headers and messages, if it is one line of valid characters.

    Raises
    ------
    InputError
        Where it holds a line end, another control character, or half of a surrogate pair.
    """
    wrong = next((letter for letter in text if unicodedata.category(letter) in _NOT_IN_A_LINE), None)
    if wrong is None:
        return text
    got = f"character U+{ord(wrong):04X}"
    raise InputError(place(name, keys), "text cannot be written on one line", expected="printable text", got=got)


def counted(number: int, one: str, many: str = "") -> str:
    """Return '1 line', '2 lines': the number and the noun in singular or plural.

    Examples
    --------
    >>> counted(1, "stop"), counted(2, "stop"), counted(3, "stop on the way", "stops on the way")
    ('1 stop', '2 stops', '3 stops on the way')
    """
    return f"{number} {one if number == 1 else many or one + 's'}"


def in_words(names: Sequence[str]) -> str:
    """Join names as a sentence does.

    Examples
    --------
    >>> in_words(["X"]), in_words(["X", "Y"]), in_words(["X", "Y", "Z"])
    ('X', 'X and Y', 'X, Y and Z')
    """
    *first, last = names
    return f"{', '.join(first)} and {last}" if first else last
