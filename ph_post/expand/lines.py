"""Lines of a program that may compute: words, settings of parameters, and O words."""

from __future__ import annotations

import re
from typing import Final

import msgspec

from ph_post.expand.expressions import Parser, Value
from ph_post.expand.faults import ExpandError

KEYWORDS: Final = (
    *("endsub", "endwhile", "endrepeat", "endif", "elseif", "else", "sub", "call", "do", "while", "repeat", "if"),
    *("break", "continue", "return"),
)
"""Words behind an O word, the longer ones first where one begins as another."""

PROGRAM: Final = "program"
"""The keyword of an O number alone: a program's name, or a subprogram of M98."""

_PARTS: Final = re.compile(r"\(([^)]*)(?:\)|$)|(;.*)")
_ACTIVE: Final = re.compile(r"\s*(?:msg,|debug,|print,|log|probeopen|probeclose|abort,|py)", re.IGNORECASE)
_ENDLESS: Final = re.compile(r"[0-9]{1000}")
_FLOW: Final = re.compile(r"^\s*/?\s*(?:[nN][\s\d.]*)?[oO]")


class LineWord(msgspec.Struct, frozen=True, kw_only=True):
    """A word: its letter, its number, and how it is computed where it is not plain."""

    letter: str
    plain: float | None
    value: Value


class Setting(msgspec.Struct, frozen=True, kw_only=True):
    """A parameter that a line sets: its name, or how its number is computed, and its value."""

    name: str = ""
    index: Value | None = None
    value: Value


class Flow(msgspec.Struct, frozen=True, kw_only=True):
    """An O word: what it does, its label (or how that is computed), and values behind it."""

    keyword: str
    label: str = ""
    index: Value | None = None
    values: tuple[Value, ...] = ()


class ProgramLine(msgspec.Struct, frozen=True, kw_only=True):
    """A line: its text without its end, what stands on it, and its comments.

    `computed` says that something has to be worked out; `fault` why it cannot be read, which matters where it
    runs.
    """

    text: str
    words: tuple[LineWord, ...] = ()
    settings: tuple[Setting, ...] = ()
    flow: Flow | None = None
    comments: tuple[str, ...] = ()
    optional: bool = False
    computed: bool = False
    percent: bool = False
    fault: ExpandError | None = None

    @property
    def active(self) -> tuple[str, ...]:
        """Comments that are orders, such as ``(MSG, …)``."""
        return tuple(one for one in self.comments if _ACTIVE.match(one)) if self.comments else ()


def has_flow(text: str) -> bool:
    """Return whether a line begins with an O word."""
    return _FLOW.match(text) is not None


def read_line(text: str) -> ProgramLine:
    """Read a line of RS274/NGC as LinuxCNC has it."""
    comments = tuple(found[1] for found in _PARTS.finditer(text) if found[1] is not None)
    bare = re.sub(r"\s+", "", _PARTS.sub("", text)).lower()
    bare = bare.lstrip(")") and bare  # what closes a comment in which another one stood
    if bare.startswith("%"):
        return ProgramLine(text=text, percent=True, comments=comments)
    optional = bare.startswith("/")
    parser = Parser(bare.lstrip("/"))
    words: list[LineWord] = []
    settings: list[Setting] = []
    try:
        flow = _read_items(parser, words, settings)
    except ExpandError as error:
        return ProgramLine(text=text, comments=comments, optional=optional, fault=error)
    except RecursionError:
        return ProgramLine(text=text, fault=ExpandError("brackets within brackets are too deep"))
    computed = bool(settings) or any(word.plain is None or word.letter in "@^" for word in words)
    return ProgramLine(
        text=text,
        words=tuple(words),
        settings=tuple(settings),
        flow=flow,
        comments=comments,
        optional=optional,
        computed=computed,
    )


def _read_items(parser: Parser, words: list[LineWord], settings: list[Setting]) -> Flow | None:
    while parser.at < len(parser.text):
        letter = parser.peek()
        if letter == "o":
            return _read_flow(parser)
        parser.at += 1
        if letter == "#":
            settings.append(_read_setting(parser))
        elif letter.isascii() and (letter.isalpha() or letter in "@^$"):
            value, plain = parser.value()
            if letter != "n":
                words.append(LineWord(letter=letter, plain=plain, value=value))
        else:
            raise ExpandError("the line cannot be read", got=parser.text[parser.at - 1 :][:20])
    return None


def _read_setting(parser: Parser) -> Setting:
    name, index = "", None
    if parser.peek() == "<":
        name = parser.name()
    else:
        index = parser.value()[0]
    parser.take("=")
    return Setting(name=name, index=index, value=parser.value()[0])


def _read_flow(parser: Parser) -> Flow:
    parser.at += 1
    label, index = "", None
    if parser.peek() == "<":
        label = parser.name()
    else:
        value, plain = parser.value()
        if plain is None:
            index = value
        else:
            label = str(round(plain))
    if parser.at == len(parser.text):
        return Flow(keyword=PROGRAM, label=label, index=index)
    word = next((one for one in KEYWORDS if parser.text.startswith(one, parser.at)), "")
    if not word:
        raise ExpandError("behind the O word stands what is no order", got=parser.text[parser.at :][:20])
    parser.at += len(word)
    values = []
    while parser.peek() == "[":
        values.append(parser.expression())
    if parser.at < len(parser.text):
        raise ExpandError("behind the O word stands what does not belong to it", got=parser.text[parser.at :][:20])
    if word in ("while", "repeat", "if", "elseif") and len(values) != 1:
        raise ExpandError(f"{word} needs a condition in brackets")
    return Flow(keyword=word, label=label, index=index, values=tuple(values))


class Source:
    """A file: its lines, read when they are first asked for.

    Parameters
    ----------
    name : str
    text : str

    Raises
    ------
    ExpandError
        Where a line has a number that no controller has room for.
    """

    def __init__(self, name: str, text: str) -> None:
        self.name = name
        # Only these end a line for a controller; a file may be cut within any other.
        self.texts = re.split(r"\r\n|\n|\r", text)
        if self.texts and not self.texts[-1]:
            self.texts.pop()
        if _ENDLESS.search(text):
            line = next(number for number, one in enumerate(self.texts, 1) if _ENDLESS.search(one))
            raise ExpandError("a number is too long", expected="fewer than 1000 digits").at(name, line)
        self._lines: dict[int, ProgramLine] = {}
        self._flows: list[int] | None = None

    def line(self, index: int) -> ProgramLine:
        """Return a line (from 0)."""
        found = self._lines.get(index)
        if found is None:
            found = self._lines[index] = read_line(self.texts[index])
        return found

    @property
    def flows(self) -> list[int]:
        """The lines with O words that could be read."""
        if self._flows is None:
            marked = [index for index, text in enumerate(self.texts) if has_flow(text)]
            self._flows = [index for index in marked if self.line(index).flow is not None]
        return self._flows

    def find(self, label: str, keywords: tuple[str, ...], start: int, step: int = 1) -> int:
        """Return the next line with one of these O words of that label, from `start` on; -1 where there is none."""
        flows = [k for k in self.flows if (start <= k if step > 0 else k <= start)]
        for index in flows[::step]:
            flow = self.line(index).flow
            if flow is not None and flow.keyword in keywords and flow.label == label:
                return index
        return -1
