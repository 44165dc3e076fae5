"""Translate lines of Siemens programs into words of RS274, one by one, with the modes that they set."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from copy import copy
from decimal import Decimal
from typing import Final

from msgspec.structs import replace

from ph_post.dialects.reading import FORGOTTEN, NOT_UNDERSTOOD, Remark
from ph_post.dialects.siemens import words as tables
from ph_post.dialects.siemens.parameters import evaluate
from ph_post.dialects.siemens.table import SiemensRows
from ph_post.dialects.siemens.words import (
    CircleWords,
    Extras,
    FeedProfileWords,
    PolynomialWords,
    Word,
    read_words,
    without_comment,
)
from ph_post.expand.sinumerik import SYNCHRONIZED, definitions
from ph_post.gcode.program import AXES, CENTERS
from ph_post.gcode.read import shortened

_LEADING: Final = re.compile(r"[ \t]*(/\d?)?[ \t]*(?::\d+|N\d+)?[ \t]*(?:[A-Z_]\w+[ \t]*:(?!=)[ \t]*)?", re.IGNORECASE)
"""Block delete, number and label of a line."""

_PARAMETER: Final = re.compile(r"R\d+|R\[.*\]")
_QUIET: Final = re.compile(r"[NTDSHM]\d*|ACC\[.*\]")
_CENTERS: Final = tuple(CENTERS.values())
_TOOL_CHANGE: Final = 6
_SPEEDS: Final = frozenset("ST")
_UNKNOWN_FEEDS: Final = frozenset(("F", "FZ"))
"""Feeds that a line leaves in force although nobody knows their number: computed, or for a tooth."""

_TANGENTIAL: Final = "CT"
_ROUNDINGS: Final = frozenset(("RND", "CHF", "CHR", "RNDM"))
"""Corners that are rounded or chamfered: behind the block, with RNDM behind all."""

_KNOWN: Final = frozenset((*tables.MOTIONS, "POLY", "CIP", ""))
_ISO_END: Final = re.compile(r"G\s*0*290(?!\d)", re.IGNORECASE)
_ISO_FRAMES: Final = re.compile(r"G\s*0*(?:7\.1|12\.1|16|43\.[45]|51|68|107|112)(?!\d)", re.IGNORECASE)
"""Words of ISO mode that turn, scale or mirror, or make places polar or those of a cylinder."""
_PROGRAM_END: Final = re.compile(r"[^/(]*?(?<![A-Z_])M0*(?:2|30)(?!\d)", re.IGNORECASE)
_UNSURE: Final = "?"
"""In the place of a motion word where it may be one or another."""

_ELSEWHERE: Final = frozenset(("G53", "G153", "G500", "G54", "G55", "G56", "G57", "G70", "G71", "G700", "G710"))
"""G words behind which the places of axes have other numbers."""

_SHAPES: Final = frozenset((*AXES, *_CENTERS, "I1", "J1", "K1", "", "PL", "CR", "TURN"))
"""Names that shape a motion; the empty one is a denominator."""


class SiemensModes:
    """Modes in force: `motion` G0 to G3, POLY, CIP or another word, measures, and whether F comes linearly.

    `feeds` is the word of what F is, and with `mixed` (G70) it is in the control's own units.

    `at` are the places of the axes that are known, and `parameters` the R parameters; with `rounded` corners are
    rounded until RNDM=0, and with `cut` the corner before the next motion is. `frames` are the words that have moved
    or turned the frame. `modal_call` is what is lost behind each block that moves, by the subprogram called there;
    empty where none is. With `iso` words are those of another language (G291).

    Where nobody knows them `absolute` and `linear` are None, `motion` is `_UNSURE` and `feeds` is empty.
    """

    def __init__(self) -> None:
        self.motion = ""
        self.absolute: bool | None = True
        self.linear: bool | None = False
        self.modal_call = ""
        self.mixed = False
        self.feeds = "G94"
        self.iso = False
        self.rounded = False
        self.cut = False
        self.frames: set[str] = set()
        self.at: dict[str, Decimal] = {}
        self.parameters: dict[str, Decimal] = {}
        self.names: set[str] = set()

    def is_parameter(self, name: str) -> bool:
        """Return whether a name is that of an R parameter, or of a variable that the program defines."""
        return name in self.names or _PARAMETER.fullmatch(name) is not None

    def copy(self) -> SiemensModes:
        """Return the modes as they are now."""
        found = copy(self)
        found.frames, found.at, found.parameters = {*self.frames}, {**self.at}, {**self.parameters}
        return found

    def may_be(self, other: SiemensModes) -> None:
        """Keep of the modes what is the same in others that may be in force as well."""
        self.motion = self.motion if self.motion == other.motion else _UNSURE
        self.absolute = self.absolute if self.absolute == other.absolute else None
        self.linear = self.linear if self.linear == other.linear else None
        self.feeds = self.feeds if self.feeds == other.feeds else ""
        self.modal_call = _worse(self.modal_call, other.modal_call)
        self.iso |= other.iso
        self.mixed |= other.mixed
        self.rounded |= other.rounded
        self.cut |= other.cut
        self.frames |= other.frames
        self.at = dict(self.at.items() & other.at.items())
        self.parameters = dict(self.parameters.items() & other.parameters.items())


class Translator:
    """Lines one after the other; `extras` is what is found beside them.

    A line with something that is not understood is passed through and named, and the position is unknown
    behind it. `rows` are the words of all lines, `motions` the motion word in force behind each where RS274 has
    another; `moves` are lines that move, and `tangents` those of them from which a tangential one goes on, so that
    nothing may be put between. `diameters` are what the words of diameters are in RS274. With `computes` parameters are
    worked out, which holds where lines run in their order. `resting` are M words of the machine that move nothing.
    """

    def __init__(
        self,
        *,
        computes: bool = True,
        forced: Mapping[int, str] = {},
        diameters: Mapping[str, str] = tables.DIAMETERS,
        resting: frozenset[int] = frozenset(),
    ) -> None:
        self.extras = Extras(polynomials={}, circles={}, profiles={}, remarks={})
        self.modes = SiemensModes()
        self.rows = SiemensRows()
        self.motions: dict[int, str] = {}
        self.moves: list[int] = []
        self.tangents: set[int] = set()
        self._slashed: set[int] = set()
        self.diameters, self.resting = diameters, tables.QUIET_M | resting
        self._computes, self._forced = computes, forced

    def translate(self, number: int, text: str, base: int) -> str:
        """Return the RS274 line of a line, whose first byte is at `base`; one with a slash may run or not."""
        slash = _LEADING.match(without_comment(text))
        if slash is None or not slash[1]:
            return self._translated(number, text, base)
        before = self.modes.copy()
        self._slashed.add(number)
        found = self._translated(number, text, base)
        self.modes.may_be(before)
        return found

    def moves_before(self) -> list[int]:
        """Return the lines of which one is the move before: the last, and where that may not run the one before it."""
        last = next((k for k in range(len(self.moves) - 1, -1, -1) if self.moves[k] not in self._slashed), 0)
        return self.moves[last:]

    def _translated(self, number: int, text: str, base: int) -> str:
        if text.lstrip().startswith("%"):
            return ""
        if self.modes.iso:
            return self._pass_iso(number, text, base)
        bare = without_comment(text)
        leading = _LEADING.match(bare)
        if SYNCHRONIZED.match(bare, leading.end() if leading else 0):
            # It belongs to the next block that moves, which has to stay the next one.
            self.modes.cut = True
            return self.passed(number, f"synchronized action: {bare.strip()}", 1, NOT_UNDERSTOOD)
        defined = definitions(bare[leading.end() if leading else 0 :].strip())
        if defined:
            self._define(defined)
            return ""
        line, skip = self._words_of(text)
        if line is None:
            return self.passed(number, without_comment(text).strip(), 1, NOT_UNDERSTOOD)
        words = self._computed(line)
        dwell, absolute = any(g_word(word) == "G4" for word in words), self.modes.absolute
        found = skip + self._line(number, words) if words else ""
        absolute = next((g_word(one) == "G90" for one in reversed(words) if g_word(one) in ("G90", "G91")), absolute)
        if words:
            self.rows.add(number, base, words, dwell=dwell, absolute=absolute is not False)
        if self.modes.motion not in tables.MOTIONS:
            self.motions[number] = self.modes.motion.replace(_UNSURE, "")
        return found

    def pass_unread(self, number: int, text: str, base: int, what: str) -> str:
        """Pass a line through that may run more than once, or not at all; its words are kept."""
        words, _ = self._words_of(text)
        if words:
            self.rows.add(number, base, words, dwell=False, absolute=True)
        if not without_comment(text).strip():
            return ""
        return self.passed(number, what, 1, " ".join([*self._take_lasting(words or []), NOT_UNDERSTOOD]))

    def _take_lasting(self, words: Sequence[Word]) -> list[str]:
        """Take in what words may leave in force, and return the RS274 words of it; none of them ends anything.

        No mode is known behind such a line until another says it; but none says that the frame is as it was, that
        corners stay, or that no subprogram is called.
        """
        parts = []
        for place, word in enumerate(words):
            frame = frame_of(word)
            if word.name in tables.DIAMETERS:
                parts.append(tables.UNREAD_MEASURE)
            elif frame is not None and not (frame[0] in tables.CLEARING and len(words) == 1):
                self.modes.frames.add(frame[0])
                parts += ["G68"] if frame[1] == "G68" else []
            elif word.name == "MCALL" and words[place + 1 :]:
                self.modes.modal_call = _worse(self.modes.modal_call, _lost_behind(words[place + 1]))
            elif word.name in _ROUNDINGS:
                self.modes.cut = True
                self.modes.rounded |= word.name == "RNDM" and _is_on(word)
            elif word.name in tables.COURSES and tables.COURSES[word.name] != self.modes.linear:
                self.modes.linear = None
            elif g_word(word) == "G291":
                self.modes.iso = True
        return parts

    def _pass_iso(self, number: int, text: str, base: int) -> str:
        """Pass a line of the control's ISO mode through: that ends with G290, what it makes of the frame does not."""
        found = self.pass_unread(number, text, base, "ISO mode (G291)")
        line = without_comment(text)
        self.modes.iso = _ISO_END.search(line) is None
        if _ISO_FRAMES.search(line):
            self.modes.frames.add("G291")
            found = f"G68 {found}"
        return f"M2 {found}" if _PROGRAM_END.match(line) else found

    @staticmethod
    def _words_of(text: str) -> tuple[list[Word] | None, str]:
        line = without_comment(text)
        leading = _LEADING.match(line)
        start = leading.end() if leading else 0
        return read_words(" " * start + line[start:]), "/" if leading and leading[1] else ""

    def _computed(self, words: list[Word]) -> list[Word]:
        """Return words with numbers in the place of what follows from parameters that are known before the line."""
        if not self._computes or all(word.kind != "computed" for word in words):
            return words
        known = self.modes.parameters
        fresh = {word.name for word in words if self.modes.is_parameter(word.name)}
        found = []
        for word in words:
            other = {name: value for name, value in known.items() if name == word.name or name not in fresh}
            value = evaluate(word.text.partition("=")[2], other) if word.kind == "computed" else None
            number = word if value is None else replace(word, kind="number", values=(format(value, "f"),))
            found.append(number)
        return found

    def _line(self, number: int, words: list[Word]) -> str:
        first = words[0]
        modal = next((place for place, word in enumerate(words) if word.name == "MCALL"), None)
        if modal is not None:
            called = words[modal + 1 :]
            self.modes.modal_call = _lost_behind(called[0]) if called else ""
            return self._read_and_passed(number, words[:modal], words[modal].column, "modal subprogram call")
        if first.name in tables.DECLARATIONS or any(g_word(word) in tables.LIMITS for word in words):
            return ""
        if first.name == "RET":
            return "M2"
        if self.modes.modal_call:
            what = "block with a modal subprogram call"
            return self._read_and_passed(number, words, first.column, what, self.modes.modal_call)
        if number in self._forced:
            return self._read_and_passed(number, words, first.column, self._forced[number])
        return _Line(self, number, words).text()

    def _read_and_passed(self, number: int, words: list[Word], column: int, what: str, lost: str = FORGOTTEN) -> str:
        """Pass a line through whose words are understood; it loses at least what `lost` says."""
        line = _Line(self, number, words)
        line.text()
        line.lost = NOT_UNDERSTOOD if lost == NOT_UNDERSTOOD else line.lost
        return line.passed(column, what)

    def _define(self, defined: Sequence[tuple[str, str, str | None]]) -> None:
        """Take the variables that a line defines, with their values where these are known."""
        for name, kind, value in defined:
            self.modes.names.add(name)
            number = Decimal(0) if value is None else evaluate(value, self.modes.parameters)
            self.modes.parameters.pop(name, None)
            if number is not None and self._computes and (kind == "REAL" or number == number.to_integral_value()):
                self.modes.parameters[name] = number

    def passed(self, number: int, what: str, column: int, text: str) -> str:
        """Name what is not understood on a line, and return what stands for it."""
        self.modes.at.clear()
        if text.endswith(NOT_UNDERSTOOD):
            self.modes.parameters.clear()
            self.modes.absolute, self.modes.feeds = None, ""
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
        self.machine = any(g_word(word) in _ELSEWHERE or word.name == "SUPA" for word in words)
        self.ends: dict[str, Decimal] = {}
        self.unknown: Word | None = None
        self.unsure = ""
        self.lost = FORGOTTEN

    def text(self) -> str:
        """Return the line."""
        for word in self.words:
            self._take(word)
        if self.dwell:
            return self._dwell()
        if self.home or self.machine:
            self.modes.at.clear()
        if not self.home:
            self._shape()
        if self.unknown is not None:
            return self.passed(self.unknown.column, self.unsure or self._name_of(self.unknown))
        self.modes.at |= self.ends
        return " ".join(part for part in self.parts if part)

    def _name_of(self, word: Word) -> str:
        """Name what is not understood: a lone name that is no word of the language calls a subprogram."""
        text = word.text.strip()
        if word.name == "L" and word.kind == "number":
            return f"missing subprogram: {text}"
        alone = word is self.words[0] and all(one.name == "P" for one in self.words[1:])
        if alone and self.lost == NOT_UNDERSTOOD and word.kind in ("keyword", "call") and not word.name.startswith("$"):
            return f"unknown word or subprogram: {text}"
        return text

    def passed(self, column: int, what: str) -> str:
        """Pass the line through; the modes and the feed that it sets are taken in all the same."""
        modes = [part for part in self.parts if part[:1] in "GMF"]
        for found in (self.of.extras.polynomials, self.of.extras.circles, self.of.extras.profiles):
            found.pop(self.number, None)
        text = " ".join([*(part for part in modes if part), self.lost])
        return self.of.passed(self.number, what, column, text)

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
        plain = word.kind == "number" and not word.function
        if plain and (word.name in self.modes.names or re.fullmatch(r"R\d+", word.name)):
            self.modes.parameters[word.name] = Decimal(word.values[0])
        elif self.modes.is_parameter(word.name):
            if word.name in self.modes.parameters:
                del self.modes.parameters[word.name]
            elif "[" in word.name:
                self.modes.parameters.clear()
            self.of.extras.remarks[self.number] = Remark(
                what=shortened(f"parameter: {word.text.strip()}"), column=word.column
            )
        elif plain and word.name in _SPEEDS:
            self.parts.append(f"{word.name}{word.values[0]}")
        elif word.name in _ROUNDINGS:
            self._round(word)
        elif word.name not in tables.QUIET_NAMES and not _QUIET.fullmatch(word.name):
            modal = word.name in ("L", "G") or word.name.startswith(("$", "G["))
            frame = frame_of(word)
            if frame is not None:
                self.modes.frames.add(frame[0])
                self.parts.append(frame[1])
            if word.name in _UNKNOWN_FEEDS and not self.dwell:
                self.parts.append("F#1")
                # Under G93 each block needs its own F, and under FLIN the next one begins with this feed.
                modal = self.modes.linear is not False or "G93" in {self.modes.feeds, *map(g_word, self.words)}
            if not (self.home and re.fullmatch(r"[A-Z]\d", word.name)):
                self._refuse(word, NOT_UNDERSTOOD if modal else FORGOTTEN)

    def _round(self, word: Word) -> None:
        """Note that the corner behind this block is rounded or chamfered, or with RNDM all from here on are."""
        if word.name == "RNDM":
            self.modes.rounded = _is_on(word)
        else:
            self.modes.cut = True
            self._refuse(word)

    def _g(self, word: Word) -> None:
        code = g_word(word)
        if code in ("G90", "G91"):
            self.modes.absolute = code == "G90"
            self.parts.append(code)
        elif code in tables.FRAMES:
            self._to_frame(word, tables.FRAMES[code])
        elif code in tables.G_WORDS:
            self.modes.motion = code if code in tables.MOTIONS else self.modes.motion
            self.parts.append(tables.G_WORDS[code] + self._rounding(code))
            self._units(code)
        elif re.fullmatch(r"G5\d\d", code):
            self.parts.append("G59.2")
            self._refuse(word)
        elif code == "G291":
            self.modes.iso = True
            self._refuse(word, NOT_UNDERSTOOD)
        elif code != "G4":
            self.modes.motion = code
            self._refuse(word, NOT_UNDERSTOOD)

    def _units(self, code: str) -> None:
        """Take F for unknown, as one a turn is, where lengths are inches and the control's setting says what F is.

        G70 and G71 do not change the units of F, G700 and G710 do (Programming Manual, Fundamentals, "Inch or metric
        dimensions"); as most controls count in mm, F under G71 is in mm.
        """
        if code in tables.FEEDS:
            self.modes.feeds = tables.G_WORDS[code]
        elif code not in tables.LENGTHS or (code == "G70") == self.modes.mixed:
            return
        else:
            self.modes.mixed = code == "G70"
        if code in tables.LENGTHS:
            self.parts.append(self.modes.feeds)
        if self.modes.mixed and self.modes.feeds == "G94":
            self.parts[-1] = "G95"

    def _rounding(self, code: str) -> str:
        """Return how far from a corner a path mode rounds it, as far as the line says."""
        near = next((word for word in self.words if word.name == "ADIS" and word.kind == "number"), None)
        return f" P{near.values[0]}" if near is not None and code.startswith("G64") and len(code) > len("G64") else ""

    def _m(self, word: Word) -> None:
        code = float(word.values[0])
        if code in tables.ENDS:
            self.parts.append("M2")
        elif code in tables.M_WORDS:
            self.parts.append(f"M{code:g}")
            if code == _TOOL_CHANGE:
                self.modes.at.clear()
        elif code not in self.of.resting:
            self._refuse(word)

    def _keyword(self, word: Word) -> None:
        name = word.name
        if name in ("POLY", "CIP"):
            self.modes.motion = name
            self.parts.append("G1")
        elif name in tables.COURSES:
            self.modes.linear = tables.COURSES[name]
        elif name == "SUPA":
            self.parts.append("G53")
        elif name in self.of.diameters:
            self.parts.append(self.of.diameters[name])
        elif name in tables.FRAMES:
            self._to_frame(word, tables.FRAMES[name])
        elif name in tables.OTHER_MOTIONS:
            self.modes.motion = name
            self._refuse(word)
        elif name not in tables.QUIET:
            self._refuse(word, NOT_UNDERSTOOD)

    def _call(self, word: Word) -> None:
        group = re.sub(r"\s", "", word.text.upper())
        if group == "CYCLE800()":
            self._to_basic_position(word)
        elif word.name in tables.FRAMES:
            self._to_frame(word, tables.FRAMES[word.name])
        elif word.name not in tables.QUIET_CALLS and group not in ("FGROUP()", "FGROUP(X,Y,Z)"):
            self._refuse(word, _lost_behind(word))

    def _to_frame(self, word: Word, code: str) -> None:
        """Note that the frame is another: a word that begins the program's own one anew turns no other one back."""
        own = self.modes.frames <= tables.PROGRAMMABLE
        alone = len(self.words) == 1 and word.name in tables.CLEARING
        self.parts.append("G69" if own and alone else code if own or code != "G69" else "")
        if not (own and alone):
            self.modes.frames.add(word.name)
        self._refuse(word)

    def _to_basic_position(self, word: Word) -> None:
        """Note that no plane is swivelled: CYCLE800 without values takes back the frames that it has set."""
        self.modes.frames.discard(word.name)
        self.parts.append("" if self.modes.frames else "G69")
        self._refuse(word)

    def _feed(self, word: Word) -> None:
        """Take F, the end of what changes within the block, and keep its course beside it."""
        if self.dwell:
            self.named["F"] = word
            return
        if self.modes.linear is None:
            self.parts.append("F#1")
            self._refuse(word)
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
        first = next(iter(self.named.values()))
        cut, self.modes.cut = self.modes.cut, any(word.name in _ROUNDINGS for word in self.words)
        if self.unknown is None and (self.modes.motion == _UNSURE or None in (self.modes.absolute, self.modes.linear)):
            self.unsure = "motion under unknown modes"
            self._refuse(first)
        if self.modes.motion not in _KNOWN or self.modes.rounded or cut:
            self._refuse(first)
        if self.modes.motion == _TANGENTIAL:
            self.of.tangents.update(self.of.moves_before())
        self.of.moves.append(self.number)
        if self.modes.absolute is None:
            return
        start = dict(self.modes.at)
        self.parts = [one for one in self.parts if one not in ("G90", "G91")]
        self.parts.insert(0, "G90" if self.modes.absolute else "G91")
        for name, word in ends.items():
            self._end(name, word)
        if self.modes.motion in ("G2", "G3"):
            self._arc(start)
        elif self.modes.motion == "CIP":
            self._circle()
        elif self.modes.motion == "POLY":
            self._polynomial(ends)

    def _end(self, name: str, word: Word) -> None:
        """Add the end of an axis, in the measure that is in force."""
        absolute, value = self.modes.absolute is True, Decimal(word.values[0])
        kind = word.function if word.function in ("AC", "IC") else "AC" if absolute else "IC"
        base = self.modes.at.get(name)
        if kind == "IC" and base is not None:
            self.ends[name] = base + value
        elif kind == "AC":
            self.ends[name] = value
        else:
            self.modes.at.pop(name, None)
        if (absolute and name not in self.ends) or (not absolute and kind == "AC"):
            self._refuse(word)
        else:
            found = self.ends[name] if absolute else value
            if word.function == "IC" and absolute:
                word = self._exchange(word, found)
            self.parts.append(f"{name}{format(found, 'f')}")

    def _exchange(self, word: Word, value: Decimal) -> Word:
        """Put a word with a value in the place of another one, for the table of words."""
        made = replace(word, values=(format(value, "f"),), function="")
        self.words[self.words.index(word)] = made
        return made

    def _arc(self, start: Mapping[str, Decimal]) -> None:
        centers = {name: self.named[name] for name in _CENTERS if name in self.named}
        for name, word in centers.items():
            value = Decimal(word.values[0])
            if word.function == "AC":
                base = start.get(AXES[_CENTERS.index(name)])
                if base is None:
                    self._refuse(word)
                    return
                value -= base
            self.parts.append(f"{name}{format(value, 'f')}")
        if len({word.function == "AC" for word in centers.values()}) > 1:
            self._refuse(next(iter(centers.values())))
        if "CR" in self.named:
            self.parts.append(f"R{self.named['CR'].values[0]}")
        if "TURN" in self.named:
            self.parts.append(f"P{int(Decimal(self.named['TURN'].values[0])) + 1}")

    def _circle(self) -> None:
        points = {name[0]: word for name, word in self.named.items() if name in ("I1", "J1", "K1")}
        own = "AC" if self.modes.absolute else "IC"
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


def _worse(one: str, other: str) -> str:
    """Return that of two things lost behind a modal call which leaves less known."""
    return max(one, other, key=("", FORGOTTEN, NOT_UNDERSTOOD).index)


def _is_on(word: Word) -> bool:
    """Return whether an RNDM may round corners."""
    return word.kind != "number" or float(word.values[0]) != 0.0


def frame_of(word: Word) -> tuple[str, str] | None:
    """Return the name of what makes the frame another, and its RS274 word; None of words that do not.

    A variable that only moves it is none: that the place is not known behind it is all of that.

    Examples
    --------
    >>> [frame_of(word) for word in read_words("ROT RPL=5 $P_UIFR[1,Z,RT]=0 $P_PFRAME=CROT(Z,5) CYCLE800()")]
    [('ROT', 'G68'), None, None, ('$P_PFRAME', 'G68'), None]
    """
    name, text = g_word(word) or word.name.partition("[")[0], re.sub(r"\s", "", word.text.upper())
    if name in tables.FRAMES and text != "CYCLE800()":
        return name, tables.FRAMES[name]
    turns = tables.FRAME_VARIABLE.fullmatch(name) is not None and tables.MOVED_ONLY.search(text) is None
    return (name, "G68") if turns else None


def _lost_behind(called: Word) -> str:
    """Return what is lost behind a call: a cycle of the control leaves modes and parameters as they were."""
    return FORGOTTEN if tables.CYCLES.fullmatch(called.name) else NOT_UNDERSTOOD


def g_word(word: Word) -> str:
    """Name a G word without leading zeros; empty for others."""
    if word.kind != "number" or word.name != "G" or word.function:
        return ""
    return f"G{float(word.values[0]):g}"
