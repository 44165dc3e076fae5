"""Read programs in Siemens language in translation, as far as their motion goes.

The words are documented in :mod:`ph_post.dialects.siemens.dialect`. Computed values (R parameters, expressions,
system variables), cycles, subprograms, splines through points, and frames are passed through and named; a
program that jumps is refused, as its motion does not follow from the order of its lines.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from ph_post.dialects.reading import FORGOTTEN, NOT_UNDERSTOOD, Remark, line_error, read_translated, text_of
from ph_post.dialects.siemens import words as tables
from ph_post.dialects.siemens.motions import with_extras
from ph_post.dialects.siemens.words import (
    CircleWords,
    Extras,
    FeedProfileWords,
    PolynomialWords,
    Word,
    read_words,
    without_comment,
)
from ph_post.errors import InputError
from ph_post.gcode.program import AXES, CENTERS, PartProgram, PlaceArray
from ph_post.gcode.read import shortened
from ph_post.gcode.words import lines_of

_LEADING: Final = re.compile(r"[ \t]*(/\d?)?[ \t]*(?::\d+|N\d+)?[ \t]*(?:[A-Z_]\w+[ \t]*:(?!=)[ \t]*)?", re.IGNORECASE)
"""Block delete, number and label of a line."""

_PARAMETER: Final = re.compile(r"R\d+|R\[.*\]")
_QUIET: Final = re.compile(r"[NTDSHM]\d*|ACC\[.*\]")
_CENTERS: Final = tuple(CENTERS.values())
_SHAPES: Final = frozenset((*AXES, *_CENTERS, "I1", "J1", "K1", "", "PL", "CR", "TURN"))
"""Names that shape a motion; the empty one is a denominator."""


class SiemensModes:
    """Modes in force: `motion` G0 to G3, POLY, CIP or "other", measures, and whether F comes linearly."""

    def __init__(self) -> None:
        self.motion = ""
        self.absolute = True
        self.arcs_absolute = False
        self.linear = False
        self.modal_call = False


class Translator:
    """Lines one after the other; `extras` is what is found beside them.

    A line with something that is not understood is passed through and named, and the position is unknown
    behind it.
    """

    def __init__(self) -> None:
        self.extras = Extras(polynomials={}, circles={}, profiles={}, remarks={})
        self.modes = SiemensModes()

    def translate(self, number: int, text: str) -> str:
        """Return the RS274 line of a line."""
        if text.lstrip().startswith("%"):
            return ""
        line = without_comment(text)
        leading = _LEADING.match(line)
        start = leading.end() if leading else 0
        words = read_words(" " * start + line[start:])
        if words is None:
            return self.passed(number, line.strip(), 1, NOT_UNDERSTOOD)
        if not words:
            return ""
        skip = "/" if leading and leading[1] else ""
        return skip + self._line(number, words)

    def _line(self, number: int, words: list[Word]) -> str:
        first = words[0]
        if first.name == "MCALL":
            self.modes.modal_call = len(words) > 1
            return self.passed(number, "modal subprogram call", first.column, FORGOTTEN)
        if self.modes.modal_call:
            return self.passed(number, "block with a modal subprogram call", first.column, FORGOTTEN)
        if first.name in tables.DECLARATIONS or any(g_word(word) in tables.LIMITS for word in words):
            return ""
        return "M2" if first.name == "RET" else _Line(self, number, words).text()

    def passed(self, number: int, what: str, column: int, text: str) -> str:
        """Name what is not understood on a line, and return what stands for it."""
        self.extras.remarks[number] = Remark(what=shortened(what), column=column)
        return text


class _Line:
    """One line in the making: `parts` are its RS274 words, `named` what shapes its motion."""

    def __init__(self, of: Translator, number: int, words: list[Word]) -> None:
        self.of, self.modes, self.number, self.words = of, of.modes, number, words
        self.parts: list[str] = []
        self.named: dict[str, Word] = {}
        self.dwell = any(g_word(word) == "G4" for word in words)
        self.home = any(g_word(word) in ("G74", "G75") for word in words)
        self.unknown: Word | None = None
        self.lost = FORGOTTEN

    def text(self) -> str:
        """Return the line."""
        for word in self.words:
            self._take(word)
        if self.dwell:
            return self._dwell()
        if not self.home:
            self._shape()
        if self.unknown is not None:
            return self._passed(self.unknown)
        return " ".join(part for part in self.parts if part)

    def _passed(self, word: Word) -> str:
        """Pass the line through; the modes and the feed that it sets are taken in all the same."""
        modes = [part for part in self.parts if part[:1] in "GMF"]
        for found in (self.of.extras.polynomials, self.of.extras.circles, self.of.extras.profiles):
            found.pop(self.number, None)
        text = " ".join([*(part for part in modes if part), self.lost])
        return self.of.passed(self.number, word.text.strip(), word.column, text)

    def _refuse(self, word: Word, lost: str = FORGOTTEN) -> None:
        self.unknown = self.unknown or word
        self.lost = lost if self.lost == FORGOTTEN else self.lost

    def _take(self, word: Word) -> None:
        name, plain = word.name, word.kind == "number" and not word.function
        if plain and name == "G":
            self._g(word)
        elif plain and name == "M":
            self._m(word)
        elif word.kind == "number" and name in _SHAPES:
            self.named[name] = word
        elif word.kind == "number" and name == "F":
            self._feed(word)
        elif word.kind == "keyword":
            self._keyword(word)
        elif word.kind == "call":
            self._call(word)
        else:
            self._assigned(word)

    def _assigned(self, word: Word) -> None:
        """Take values of parameters, tools, spindles and tolerances, which move nothing; refuse others."""
        if _PARAMETER.fullmatch(word.name):
            self.of.passed(self.number, f"parameter: {word.text.strip()}", word.column, "")
        elif word.name not in tables.QUIET_NAMES and not _QUIET.fullmatch(word.name):
            modal = word.name in ("F", "L", "RNDM") or word.name.startswith("$")
            if not (self.home and re.fullmatch(r"[A-Z]\d", word.name)):
                self._refuse(word, NOT_UNDERSTOOD if modal else FORGOTTEN)

    def _g(self, word: Word) -> None:
        code = g_word(word)
        if code in ("G90", "G91"):
            self.modes.absolute = code == "G90"
            self.parts.append(code)
        elif code in tables.FRAMES:
            self._to_frame(word, tables.FRAMES[code])
        elif code in tables.G_WORDS:
            self.modes.motion = code if code in tables.MOTIONS else self.modes.motion
            self.parts.append(tables.G_WORDS[code])
        elif re.fullmatch(r"G5\d\d", code):
            self.parts.append("G59.2")
            self._refuse(word)
        elif code != "G4":
            self.modes.motion = "other"
            self._refuse(word, NOT_UNDERSTOOD)

    def _m(self, word: Word) -> None:
        code = float(word.values[0])
        if code in tables.ENDS:
            self.parts.append("M2")
        elif code in tables.M_WORDS:
            self.parts.append(f"M{code:g}")
        elif code not in tables.QUIET_M:
            self._refuse(word)

    def _keyword(self, word: Word) -> None:
        name = word.name
        if name in ("POLY", "CIP"):
            self.modes.motion = name
            self.parts.append("G1")
        elif name in ("FNORM", "FLIN"):
            self.modes.linear = name == "FLIN"
        elif name == "SUPA":
            self.parts.append("G53")
        elif name in tables.DIAMETERS:
            self.parts.append(tables.DIAMETERS[name])
        elif name in tables.FRAMES:
            self._to_frame(word, tables.FRAMES[name])
        elif name in tables.OTHER_MOTIONS:
            self.modes.motion = "other"
            self._refuse(word)
        elif name not in tables.QUIET:
            self._refuse(word, NOT_UNDERSTOOD)

    def _call(self, word: Word) -> None:
        group = re.sub(r"\s", "", word.text.upper())
        if word.name in tables.FRAMES:
            self._to_frame(word, tables.FRAMES[word.name])
        elif word.name not in tables.QUIET_CALLS and group not in ("FGROUP()", "FGROUP(X,Y,Z)"):
            self._refuse(word, FORGOTTEN if word.name.startswith(tables.CYCLES) else NOT_UNDERSTOOD)

    def _to_frame(self, word: Word, code: str) -> None:
        self.parts.append(code)
        self._refuse(word)

    def _feed(self, word: Word) -> None:
        """Take F, the end of what changes within the block, and keep its course beside it."""
        if self.dwell:
            self.named["F"] = word
            return
        values = [*map(float, word.values), 0.0, 0.0]
        if word.function == "FPO":
            self.of.extras.profiles[self.number] = FeedProfileWords(end=values[0], quad=values[1], cub=values[2])
        elif self.modes.linear:
            self.of.extras.profiles[self.number] = FeedProfileWords(end=values[0])
        self.parts.append(f"F{word.values[0]}")

    def _dwell(self) -> str:
        """G4 F is a time; that of G4 S, turns of the spindle, is not known, but moves nothing either."""
        time = self.named.get("F")
        return f"G4 P{time.values[0] if time else 0}"

    def _shape(self) -> None:
        """Add the words of the motion."""
        ends = {name: self.named[name] for name in AXES if name in self.named}
        if not ends and not any(name in self.named for name in (*_CENTERS, "")):
            return
        if self.modes.motion == "other":
            self._refuse(next(iter(self.named.values())))
        absolute = self._measure(list(ends.values()))
        self.parts += [f"{name}{word.values[0]}" for name, word in ends.items()]
        if self.modes.motion in ("G2", "G3"):
            self._arc()
        elif self.modes.motion == "CIP":
            self._circle(absolute)
        elif self.modes.motion == "POLY":
            self._polynomial(ends)

    def _measure(self, ends: list[Word]) -> bool:
        """Write G90 or G91 on every line that moves, as it is for its axes: they have to agree."""
        own = "AC" if self.modes.absolute else "IC"
        kinds = {word.function if word.function in ("AC", "IC") else own for word in ends}
        if len(kinds) > 1:
            self._refuse(ends[0])
        absolute = kinds != {"IC"} if kinds else self.modes.absolute
        self.parts = ["G90" if absolute else "G91", *(one for one in self.parts if one not in ("G90", "G91"))]
        return absolute

    def _arc(self) -> None:
        centers = {name: self.named[name] for name in _CENTERS if name in self.named}
        kinds = {word.function == "AC" for word in centers.values()}
        if len(kinds) > 1:
            self._refuse(next(iter(centers.values())))
        absolute = kinds == {True}
        if centers and absolute != self.modes.arcs_absolute:
            self.modes.arcs_absolute = absolute
            self.parts.append("G90.1" if absolute else "G91.1")
        self.parts += [f"{name}{word.values[0]}" for name, word in centers.items()]
        if "CR" in self.named:
            self.parts.append(f"R{self.named['CR'].values[0]}")
        if "TURN" in self.named:
            self.parts.append(f"P{int(float(self.named['TURN'].values[0])) + 1}")

    def _circle(self, absolute: bool) -> None:
        points = {name[0]: word for name, word in self.named.items() if name in ("I1", "J1", "K1")}
        own = "AC" if absolute else "IC"
        kinds = {word.function or own for word in points.values()}
        if len(kinds) != 1:
            self._refuse(self.words[0])
            return
        point = {AXES[_CENTERS.index(name)]: float(word.values[0]) for name, word in points.items()}
        self.of.extras.circles[self.number] = CircleWords(point=point, absolute=kinds == {"AC"})

    def _polynomial(self, ends: Mapping[str, Word]) -> None:
        given = {name: tuple(map(float, word.values[1:])) for name, word in ends.items()}
        below = tuple(map(float, self.named[""].values)) if "" in self.named else ()
        length = float(self.named["PL"].values[0]) if "PL" in self.named else 1.0
        most = max((len(values) for values in (*given.values(), below[1:])), default=0)
        if most > 4 or not length > 0.0:
            self._refuse(next(iter(self.named.values())))
        elif most or below:
            self.of.extras.polynomials[self.number] = PolynomialWords(axes=given, below=below, length=length)


def g_word(word: Word) -> str:
    """Name a G word without leading zeros; empty for others."""
    if word.kind != "number" or word.name != "G" or word.function:
        return ""
    return f"G{float(word.values[0]):g}"


_JUMP: Final = re.compile(r"\b(GOTO[BFCS]?|CASE|REPEATB?|UNTIL|CALL|PCALL|EXTCALL)\b", re.IGNORECASE)
_OPENS: Final = re.compile(r"^\s*(?:N\d+\s*)?(IF|WHILE|FOR|LOOP)\b", re.IGNORECASE)
_CLOSES: Final = re.compile(r"^\s*(?:N\d+\s*)?(ENDIF|ENDWHILE|ENDFOR|ENDLOOP)\b", re.IGNORECASE)
_STRING: Final = re.compile(r'"[^"]*"')


def read_siemens(data: bytes, name: str) -> PartProgram:
    r"""Read a program in Siemens language.

    Parameters
    ----------
    data, name
        As for :func:`ph_post.gcode.read.read_program`.

    Raises
    ------
    InputError
        As there, and for jumps, circles in space, and feeds or denominators that are not positive.

    Examples
    --------
    >>> program = read_siemens(b"G0 X0 Y0\nPOLY PO[X]=(1) PO[Y]=(1,1) F60\nM30\n", "a.mpf")
    >>> program.motions.nurbs[1][1][:, :2].tolist()
    [[0.0, 0.0], [0.0005, 0.0], [0.001, 0.001]]
    """
    lines = lines_of(data, name)
    translator = Translator()
    texts = _translated(data, lines, name, translator)
    program = read_translated(data, lines, name, texts, translator.extras.remarks, in_place=False)
    return with_extras(program, translator.extras)


def _translated(data: bytes, lines: PlaceArray, name: str, translator: Translator) -> list[bytes]:
    """Translate all lines; what stands between IF, WHILE, FOR, LOOP and their ends is passed through."""
    texts: list[bytes] = []
    depth, opened = 0, ""
    for number in range(lines.size - 1):
        text = text_of(data, lines, number).decode("latin-1")
        bare = _STRING.sub('""', without_comment(text))
        jump = _JUMP.search(bare)
        if jump is not None:
            wanted = "a program that runs line by line"
            raise line_error(data, lines, name, number, "jump or call", wanted, jump[0])
        found = _OPENS.match(bare)
        opened = found[1].upper() if found and not depth else opened
        depth += found is not None
        if depth:
            texts.append(translator.passed(number, opened, 1, NOT_UNDERSTOOD).encode())
        else:
            texts.append(translator.translate(number, text).encode("latin-1"))
        depth = max(0, depth - (_CLOSES.match(bare) is not None))
    if depth:
        raise InputError(name, f"{opened} without its end", expected=f"END{opened}", got="the end of the file")
    return texts
