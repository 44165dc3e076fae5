"""Read what a person answers: numbers with the units of the shop, words of a choice, per axis or for all.

An :class:`AnswerKind` reads a value; whatever it cannot be is one :class:`ph_post.errors.InputError`.
"""

from __future__ import annotations

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, Final, NamedTuple

from ph_post.errors import InputError
from ph_post.units import MINUTE, lengths_in

_NUMBER: Final = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_UNIT: Final = r"[^\W\d_][\w²^/]*|\""
_BETWEEN: Final = re.compile(r"\s*;\s*|,\s+|\s+")
_NAMED: Final = re.compile(r"([A-Za-z]+)\s*=\s*")
_SHOWN: Final = 60

_MM: Final = lengths_in("mm", ("mm", "um", "cm", "m", "inch", "mil"))
_INCH: Final = _MM["inch"]

LENGTH_UNITS: Final = {
    "mm": _MM["mm"],
    "um": _MM["um"],
    "µm": _MM["um"],
    "cm": _MM["cm"],
    "in": _INCH,
    "inch": _INCH,
    '"': _INCH,
    "thou": _MM["mil"],
    "mil": _MM["mil"],
}
"""Units of a length in mm."""

SPEED_UNITS: Final = {
    "mm/s": 1.0,
    "mm/sec": 1.0,
    "mm/min": 1.0 / MINUTE,
    "m/min": _MM["m"] / MINUTE,
    "m/s": _MM["m"],
    "in/s": _INCH,
    "in/min": _INCH / MINUTE,
    "ipm": _INCH / MINUTE,
}
"""Units of a speed in mm/s."""

ACCELERATION_UNITS: Final = {
    f"{unit}/s{power}": size
    for unit, size in (("mm", 1.0), ("m", _MM["m"]), ("in", _INCH))
    for power in ("2", "²", "^2")
} | {"g": 9806.65}
"""Units of an acceleration in mm/s²."""


TIME_UNITS: Final = {"us": 1e-3, "ms": 1.0, "s": 1e3}
"""Units of a time in ms."""

RATE_UNITS: Final = {"hz": 1e3, "khz": 1.0}
"""Units of a rate: its inverse in ms times the rate."""


class AnswerKind(ABC):
    """A kind of answer: `pattern` finds one in a line, `read` takes it, `words` say what is expected."""

    pattern: re.Pattern[str]
    words: str

    @abstractmethod
    def read(self, text: str, where: str) -> Any:
        """Return the value of a text that `pattern` has found; raises InputError."""

    def one(self, text: str, where: str) -> Any:
        """Return the value of a whole line.

        Raises
        ------
        InputError
            Where it is no such value, or there is something beside it.
        """
        match = self.pattern.fullmatch(text.strip())
        if match is None:
            raise self.refusal(text, where)
        return self.read(text.strip(), where)

    def refusal(self, text: str, where: str) -> InputError:
        """Say that this is no such value."""
        what = "a comma between digits can mean two things" if re.search(r"\d,\d", text) else "not understood"
        point = " (a decimal point; values apart by blanks)" if "comma" in what else ""
        return InputError(where, what, expected=self.words + point, got=_shown(text))


class Quantity(AnswerKind):
    """A number with a unit.

    Parameters
    ----------
    noun : str
        ``a length``.
    units : mapping
        Factor to the unit of the value, by name; `inverse` are those that count the other way: the value is
        the factor divided by the number.
    bare : str or None
        Unit of a number without one; None where it has to be given.
    low, high : float
        Bounds of what is no slip, in the unit of the value, whose name is `unit`.

    Examples
    --------
    >>> Quantity("a length", LENGTH_UNITS, "mm", "mm", 0.0, 10.0).one("0.002in", "lost_motion")
    0.0508
    """

    def __init__(
        self,
        noun: str,
        units: Mapping[str, float],
        bare: str | None,
        unit: str,
        low: float,
        high: float,
        inverse: Mapping[str, float] | None = None,
    ) -> None:
        self.units, self.inverse, self.bare, self.unit = units, inverse or {}, bare, unit
        self.low, self.high = low, high
        self.pattern = re.compile(rf"({_NUMBER})\s*({_UNIT})?")
        given = "" if bare else f" with its unit, such as 10{unit}"
        self.words = f"{noun}{given} from {low:g} to {high:g} {unit}"

    def read(self, text: str, where: str) -> float:
        """Return the number in the unit of the value."""
        match = self.pattern.fullmatch(text)
        assert match is not None
        number, unit = float(match[1]), (match[2] or self.bare or "").lower()
        if unit in self.inverse:
            value = self.inverse[unit] / number if number else 0.0
        elif unit in self.units:
            value = number * self.units[unit]
        else:
            what = f"no unit {_shown(match[2])} here" if match[2] else "the unit is missing"
            known = ", ".join((*self.units, *self.inverse))
            raise InputError(where, what, expected=f"one of {known}", got=_shown(text))
        if not self.low <= value <= self.high:
            raise InputError(where, "out of range", expected=self.words, got=_shown(text))
        return value or 0.0  # no -0.0


class Gain(Quantity):
    """A gain of a loop in 1/s: ``40/s``, ``2.4 m/min/mm``, and where `hertz` says so ``60 Hz``.

    Examples
    --------
    >>> Gain("a gain").one("2.4m/min/mm", "position_gain")
    40.0
    """

    def __init__(self, noun: str, hertz: bool = False) -> None:
        units = {"/s": 1.0, "1/s": 1.0, "m/min/mm": 1e3 / MINUTE} | ({"hz": math.tau} if hertz else {})
        bare = "/s" if hertz else None  # K_v of 2.4 is m/min/mm at Siemens and Heidenhain
        super().__init__(noun, units, bare, "/s", 0.1, 1e5)
        self.pattern = re.compile(rf"({_NUMBER})\s*(1?/s|m/min/mm|hz)?", re.IGNORECASE)


MOST_WEIGHT: Final = 2.0
"""Numbers up to this may be a weight where percent are asked for."""


class Percentage(Quantity):
    """A part in percent: ``95 %``, ``95``; up to 2 with its sign alone, as it may be a weight where 1 is 100 %."""

    def __init__(self, noun: str, high: float) -> None:
        super().__init__(noun, {"%": 1.0}, "%", "%", 0.0, high)
        self.pattern = re.compile(rf"({_NUMBER})\s*(%)?")

    def read(self, text: str, where: str) -> float:
        """Return the number in percent."""
        value = super().read(text, where)
        if 0.0 < value <= MOST_WEIGHT and "%" not in text:
            raise InputError(
                where, "a weight or percent?", expected=f"{100.0 * value:g}% or {value:g}%", got=_shown(text)
            )
        return value


class Ratio(AnswerKind):
    """A number, or two with a colon or a stroke: ``2``, ``2:1``, ``40/20``."""

    pattern = re.compile(rf"({_NUMBER})(?:\s*[:/]\s*({_NUMBER}))?")
    words = "a ratio from 0.001 to 1000, such as 2 or 40:20"

    def read(self, text: str, where: str) -> float:
        """Return the first over the second."""
        match = self.pattern.fullmatch(text)
        assert match is not None
        over, under = float(match[1]), float(match[2] or 1)
        if not under or not 1e-3 <= over / under <= 1e3:
            raise InputError(where, "out of range", expected=self.words, got=_shown(text))
        return over / under


class ServoLag(AnswerKind):
    """c [s] as a following error at a speed, ``0.4 at 1000``, or as a gain, ``40/s``; None for ``?``."""

    pattern = re.compile(
        rf"\?|({_NUMBER})\s*(?:/\s*s|1/s)|({_NUMBER}\s*(?:{_UNIT})?)\s*(?:at|@)\s*({_NUMBER}\s*(?:{_UNIT})?)"
    )
    words = "a following error at a feed, such as 0.4 at 1000 [mm, mm/min], a gain such as 40/s, or ?"
    _ERROR: Final = Quantity("a following error", LENGTH_UNITS, "mm", "mm", 1e-5, 100.0)
    _FEED: Final = Quantity("a feed", SPEED_UNITS, "mm/min", "mm/s", 1e-2, 1e4)
    _GAINS: Final = (1.0, 1e4)

    def read(self, text: str, where: str) -> float | None:
        """Return c = e / v, or 1 over the gain."""
        match = self.pattern.fullmatch(text)
        assert match is not None
        if text == "?":
            return None
        if match[1] is not None:
            gain = float(match[1])
        else:
            gain = self._FEED.one(match[3], where) / self._ERROR.one(match[2], where)
        if not self._GAINS[0] <= gain <= self._GAINS[1]:
            expected = "speed / error, the position gain, from {:g}/s to {:g}/s".format(*self._GAINS)
            raise InputError(where, "out of range", expected=expected, got=f"{_shown(text)} = {gain:.4g}/s")
        return 1.0 / gain


class WordChoice(AnswerKind):
    """One of some words; `aliases` are what else people call them."""

    pattern = re.compile(r"[^\W_][\w.-]*")

    def __init__(self, known: Sequence[str], aliases: Mapping[str, str] | None = None) -> None:
        self.known, self.aliases = tuple(known), aliases or {}
        self.words = f"one of {', '.join(self.known)}"

    def read(self, text: str, where: str) -> str:
        """Return the word by its proper name."""
        word = self.aliases.get(text.lower(), text.lower())
        if word not in self.known:
            raise InputError(where, "no such choice", expected=self.words, got=_shown(text))
        return word


class TextLine(AnswerKind):
    """A line of text."""

    pattern = re.compile(r".+", re.DOTALL)
    words = "a line of at most 100 characters"

    def read(self, text: str, where: str) -> str:
        """Return the line as it is."""
        if len(text) > 100 or not text.isprintable():
            raise InputError(where, "no name", expected=self.words, got=_shown(text))
        return text


class Axes(AnswerKind):
    """Axes of a machine: ``XYZ``, ``X, Y``."""

    pattern = re.compile(r".+", re.DOTALL)
    words = "one to three of X, Y, Z"

    def read(self, text: str, where: str) -> tuple[str, ...]:
        """Return their names in the order X, Y, Z."""
        letters = re.sub(r"[\s,;]+", "", text.upper())
        if not letters or not set(letters) <= set("XYZ") or len(set(letters)) != len(letters):
            raise InputError(where, "no such axes", expected=self.words, got=_shown(text))
        return tuple(sorted(letters))


class _AxisAnswer(NamedTuple):
    """What one axis has in a line; no axis where the line does not name it."""

    axis: str | None
    text: str


def by_axis(kind: AnswerKind, text: str, axes: Sequence[str], where: str) -> dict[str, Any]:
    """Read a line that has one value for all axes, one each in their order, or ``X=... Y=...``.

    Raises
    ------
    InputError
        Where a value is bad, an axis is missing, unknown or named twice, or the count is wrong.

    Examples
    --------
    >>> length = Quantity("a length", LENGTH_UNITS, "mm", "mm", 0.0, 10.0)
    >>> by_axis(length, "0.03 0.002in", ("X", "Y"), "lost_motion")
    {'X': 0.03, 'Y': 0.0508}
    >>> by_axis(length, "y=1, x=2", ("X", "Y"), "lost_motion")
    {'X': 2.0, 'Y': 1.0}
    """
    parts = _parts(kind, text.strip(), where)
    if parts[0].axis is not None:
        named = {part.axis: part.text for part in parts}
        if len(named) != len(parts) or set(named) != set(axes):
            got = ", ".join(str(part.axis) for part in parts)
            raise InputError(where, "other axes", expected=f"each of {', '.join(axes)} once", got=got)
        return {axis: kind.one(named[axis], where) for axis in axes}
    if len(parts) not in (1, len(axes)):
        many = f"one value, or one for each of {', '.join(axes)}" if len(axes) > 1 else "one value"
        raise InputError(where, "wrong count", expected=many, got=f"{len(parts)} values")
    values = [kind.read(part.text, where) for part in parts]
    return dict(zip(axes, values * len(axes) if len(values) == 1 else values, strict=True))


def _parts(kind: AnswerKind, text: str, where: str) -> list[_AxisAnswer]:
    """Cut a line into its values."""
    if "=" in text:
        names = list(_NAMED.finditer(text))
        if not names or names[0].start() > 0:
            raise kind.refusal(text, where)
        ends = [name.start() for name in names[1:]] + [len(text)]
        return [
            _AxisAnswer(name[1].upper(), text[name.end() : end].strip(" ,;\t"))
            for name, end in zip(names, ends, strict=True)
        ]
    parts, place = [], 0
    while True:
        value = kind.pattern.match(text, place)
        if value is None:
            raise kind.refusal(text, where)
        parts.append(_AxisAnswer(None, value[0].strip()))
        place = len(text[: value.end()].rstrip())
        if place == len(text):
            return parts
        between = _BETWEEN.match(text, place)
        if between is None:
            raise kind.refusal(text, where)
        place = between.end()


def _shown(text: str | None) -> str:
    """Quote an answer, on one line and never long."""
    line = repr(text or "")
    return line if len(line) <= _SHOWN else f"{line[:_SHOWN]}..."
