"""Random part programs in every language, plain ones and ones that compute, each beside what it comes to.

The work is that of `random_cuts`. A program that computes runs a stretch in increments several times, by a loop, a
repeat or a subprogram of its language, and takes a number from a parameter.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from support.random_cuts import NAMES, Cut, Random, random_work

GRID = 1e-3
"""Of all numbers [mm]."""


class RandomText(NamedTuple):
    """A program of a dialect, and `plain`, one without loops and parameters that does the same."""

    number: int
    dialect: str
    kind: str
    text: str
    plain: str


class _Language:
    """RS274/NGC as the controllers have in common what is written here."""

    flat = False
    parameter = ""
    head: tuple[str, ...] = ("G21 G90 G17 G94",)
    tail: tuple[str, ...] = ("M2",)

    def __init__(self, rng: Random) -> None:
        self.rng, self.relative, self.plane = rng, False, 17

    def number(self, value: float) -> str:
        """A coordinate [mm]."""
        text = f"{value:.3f}".rstrip("0").rstrip(".")
        return "0" if text == "-0" else text

    def relative_mode(self) -> list[str]:
        """Count in increments from here on."""
        self.relative = True
        return ["G91"]

    def block(self, cut: Cut, at: Sequence[float], first: str = "") -> list[str]:
        """Lines of a move from `at`; `first` stands for the number of its first word."""
        words = [f"G{cut.plane}"] if cut.center is not None and cut.plane != self.plane else []
        self.plane = cut.plane if words else self.plane
        words += [f"G{cut.code}", *self.places("XYZ", cut.end, at, first)]
        words += [] if cut.center is None else self.center(cut, at)
        return [" ".join([*words, *([f"F{cut.feed:g}"] if cut.code else [])])]

    def places(self, names: str, end: Sequence[float], at: Sequence[float], first: str = "") -> list[str]:
        """Words of the axes that move."""
        found = []
        for name, one, before in zip(names, end, at, strict=True):
            if one != before:
                value = self.number(one - (before if self.relative else 0.0))
                found.append(name + (first if first and not found else value))
        return found

    def center(self, cut: Cut, at: Sequence[float]) -> list[str]:
        """Words of the centre of an arc."""
        assert cut.center is not None
        axes = {17: "XY", 18: "XZ", 19: "YZ"}[cut.plane]
        rows = [("IJK"["XYZ".index(name)], "XYZ".index(name)) for name in axes]
        return [letter + self.number(cut.center[axis] - at[axis]) for letter, axis in rows]

    def let(self, value: float) -> tuple[str, str]:
        """A line that sets a parameter, and what a word with `value` has in place of its number."""
        if not self.parameter:
            return "", self.number(value)
        part, rest = self.parted(value)
        return f"{self.parameter}={self.number(part)}", f"[{self.parameter}+{self.number(rest)}]".replace("+-", "-")

    def parted(self, value: float) -> tuple[float, float]:
        """Two numbers whose sum is `value`, the first of few digits."""
        part = round(float(self.rng.uniform(-9.0, 9.0)), 3)
        return part, value - part

    def repeat(self, lines: list[str], times: int) -> tuple[list[str], list[str]]:
        """Lines that run some lines several times, and those behind the end of the program."""
        return lines * times, []

    def program(self, lines: list[str], behind: list[str]) -> str:
        """The whole text."""
        return "\n".join([*self.head, *lines, *self.tail, *behind, ""])


class _LinuxCNC(_Language):
    parameter = "#7"

    def repeat(self, lines: list[str], times: int) -> tuple[list[str], list[str]]:
        kind = int(self.rng.integers(3))
        if kind == 0:
            return [f"o1 repeat [{times}]", *lines, "o1 endrepeat"], []
        if kind == 1:
            return ["#1=0", f"o1 while [#1 lt {times}]", *lines, "#1=[#1+1]", "o1 endwhile"], []
        return ["o1 sub", *lines, "o1 endsub", *times * ["o1 call"]], []


class _Fanuc(_Language):
    parameter = "#101"
    head = ("%", "O0100", "G21 G90 G17 G94 G40")
    tail = ("M30",)

    def number(self, value: float) -> str:
        text = f"{value:.3f}".rstrip("0")
        return "0." if text in ("-0.", "0.") else text

    def repeat(self, lines: list[str], times: int) -> tuple[list[str], list[str]]:
        kind = int(self.rng.integers(3))
        if kind == 0:
            return ["#100=0", f"WHILE[#100LT{times}]DO1", *lines, "#100=#100+1", "END1"], []
        if kind == 1:
            return [f"M98 P200 L{times}"], ["O0200", *lines, "M99"]
        return ["#100=0", "N5 #100=#100+1", *lines, f"IF[#100LT{times}]GOTO5"], []

    def program(self, lines: list[str], behind: list[str]) -> str:
        return super().program(lines, [*behind, "%"])


class _Printer(_Language):
    flat = True
    head = ("G21", "G90")
    tail = ()


class _Siemens(_Language):
    flat = True
    head = ("G71 G90 G17 G94",)
    tail = ("M30",)

    def let(self, value: float) -> tuple[str, str]:
        part, rest = self.parted(value)
        return f"R7={self.number(part)}", f"=R7+{self.number(rest)}".replace("+-", "-")

    def center(self, cut: Cut, at: Sequence[float]) -> list[str]:
        assert cut.center is not None
        if not self.relative and self.rng.random() < 0.3:
            return [f"{letter}=AC({self.number(cut.center[axis])})" for axis, letter in enumerate("IJ")]
        return super().center(cut, at)

    def repeat(self, lines: list[str], times: int) -> tuple[list[str], list[str]]:
        kind = int(self.rng.integers(3))
        if kind == 1 and times > 1:
            return ["AGAIN:", *lines, "ENDLABEL:", f"REPEAT AGAIN P={times - 1}"], []
        if kind <= 1:  # a label that nothing repeats computes nothing
            return [f"FOR R1=1 TO {times}", *lines, "ENDFOR"], []
        return ["R1=0", f"WHILE R1<{times}", *lines, "R1=R1+1", "ENDWHILE"], []


class _Klartext(_Language):
    flat = True

    def number(self, value: float) -> str:
        text = super().number(value)
        return text if text.startswith("-") else f"+{text}"

    def relative_mode(self) -> list[str]:
        self.relative = True
        return []

    def let(self, value: float) -> tuple[str, str]:
        part, rest = self.parted(value)
        return f"Q1 = {self.number(part)} + {rest:.3f}".replace("+ -", "- "), "+Q1"

    def places(self, names: str, end: Sequence[float], at: Sequence[float], first: str = "") -> list[str]:
        found = super().places(names, end, at, first)
        return [f"I{word}" for word in found] if self.relative else found

    def block(self, cut: Cut, at: Sequence[float], first: str = "") -> list[str]:
        feed = f"F{cut.feed:g}" if cut.code else "FMAX"
        if cut.center is None:
            return [" ".join(["L", *self.places("XYZ", cut.end, at, first), "R0", feed])]
        sense = "DR+" if cut.code == 3 else "DR-"
        places = [
            self.number(one - (begin if self.relative else 0.0)) for one, begin in zip(cut.center, at, strict=True)
        ]
        step = "I" if self.relative else ""
        pole = f"CC {step}X{places[0]} {step}Y{places[1]}"
        if cut.end[2] != at[2]:
            turn = "IPA+360" if cut.code == 3 else "IPA-360"
            return [pole, f"CP {turn} {self.places('Z', cut.end[2:], at[2:])[0]} {sense} {feed}"]
        ends = [
            f"{step}{name}{self.number(cut.end[n] - (at[n] if self.relative else 0.0))}" for n, name in enumerate("XY")
        ]
        return [pole, " ".join(["C", *ends, sense, feed])]

    def repeat(self, lines: list[str], times: int) -> tuple[list[str], list[str]]:
        if self.rng.random() < 0.5:
            return ["LBL 1", *lines, *([f"CALL LBL 1 REP {times - 1}"] if times > 1 else [])], []
        return times * ["CALL LBL 1"], ["LBL 1", *lines, "LBL 0"]

    def program(self, lines: list[str], behind: list[str]) -> str:
        blocks = ["BEGIN PGM A MM", "TOOL CALL 1 Z S1000", *lines, "M30", *behind, "END PGM A MM"]
        return "".join(f"{number} {block}\n" for number, block in enumerate(blocks))


class _Iso(_Klartext):
    def block(self, cut: Cut, at: Sequence[float], first: str = "") -> list[str]:
        words = " ".join(self.places("XYZ", cut.end, at))
        if cut.center is None:
            return [f"G0{cut.code} {words}" + (f" F{cut.feed:g}" if cut.code else "")]
        pole = f"I{self.number(cut.center[0])} J{self.number(cut.center[1])}"
        ends = " ".join(f"{name}{self.number(cut.end[n])}" for n, name in enumerate("XY"))
        return [pole, f"G0{cut.code} {ends} F{cut.feed:g}"]

    def program(self, lines: list[str], behind: list[str]) -> str:
        blocks = ["G30 G17 X-40 Y-40 Z-20", "G31 G90 X+40 Y+40 Z+0", "T5 G17 S3000", "G40 G90", *lines, "M30"]
        rows = [f"N{10 * number + 10} {block} *" for number, block in enumerate(blocks)]
        return "\n".join(["%PLATE G71 *", *rows, "N99999999 %PLATE G71 *", ""])


LANGUAGES: dict[str, type[_Language]] = {
    "linuxcnc": _LinuxCNC,
    "grbl": _LinuxCNC,
    "grblhal": _LinuxCNC,
    "marlin": _Printer,
    "klipper": _Printer,
    "fanuc": _Fanuc,
    "siemens": _Siemens,
    "heidenhain": _Klartext,
    "heidenhain-iso": _Iso,
}
"""Languages by dialect."""

ENDINGS = {"siemens": ".mpf", "heidenhain": ".h", "heidenhain-iso": ".i"}
"""Endings of files; others have `.nc`."""

WITHOUT = ("marlin", "klipper", "heidenhain-iso")
"""Languages of which nothing is written out."""


def random_text(number: int) -> RandomText:
    """Program of a number."""
    rng = np.random.default_rng([1809, number])
    dialect = list(LANGUAGES)[number % len(LANGUAGES)]
    language = LANGUAGES[dialect]
    names = [name for name in NAMES if not (dialect == "heidenhain-iso" and name in ("helix", "mixed"))]
    kind = str(rng.choice(names))
    cuts = random_work(rng, kind, GRID, flat=language.flat)
    if dialect not in WITHOUT and rng.random() < 0.5:
        # Subprograms of Heidenhain's run once where nothing calls them: there is nothing to write out.
        seed, times = int(rng.integers(1 << 30)), int(rng.integers(1 + dialect.startswith("heidenhain"), 4))
        text, plain = (
            _computed(language(np.random.default_rng(seed)), cuts, times, kept=kept) for kept in (True, False)
        )
        return RandomText(number, dialect, f"{kind} computed", text, plain)
    one = language(rng)
    lines, at = [], (math.nan,) * 3
    for row, cut in enumerate(cuts):
        lines += one.block(cut, at)
        at = cut.end
        if row == 0 and dialect not in ("heidenhain", "heidenhain-iso") and rng.random() < 0.3:
            lines += one.relative_mode()
    text = one.program(lines, [])
    return RandomText(number, dialect, kind, text, text)


def _computed(one: _Language, cuts: Sequence[Cut], times: int, *, kept: bool) -> str:
    """A program whose cuts, but for the first, run several times; without loops and parameters unless they are kept."""
    head = [*one.block(cuts[0], (math.nan,) * 3), *one.relative_mode()]
    lines: list[str] = []
    at = cuts[0].end
    taken = int(one.rng.integers(1, max(len(cuts), 2)))
    for row, cut in enumerate(cuts[1:], 1):
        first = ""
        step = next((end - begin for end, begin in zip(cut.end, at, strict=True) if end != begin), None)
        if row == taken and step is not None and (cut.center is None or isinstance(one, _LinuxCNC | _Fanuc | _Siemens)):
            line, word = one.let(step)
            if kept:
                lines.append(line)
                first = word
        lines += one.block(cut, at, first)
        at = cut.end
    if one.plane != 17:
        lines.append("G17")
    body, behind = one.repeat(lines, times)
    return one.program([*head, *body], behind) if kept else one.program([*head, *times * lines], [])
