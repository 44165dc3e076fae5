"""Little interpreters of Fanuc's and Heidenhain's languages, from their manuals and from nothing in ph_post.

They know what this package writes, word by word, and refuse everything else. Lengths in mm, times in s. The
word lists are those of FANUC B-64484EN and B-63324EN/03 (G06.2), of the HEIDENHAIN TNC 320 User's Manuals
(conversational 3/2014, ISO 10/2017) and iTNC 530 User's Manual, ISO programming (340 49x-02).
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from .interpreter import Move, Run

PLANES = {"G17": "XY", "G18": "ZX", "G19": "YZ"}
OFFSETS = {"X": "I", "Y": "J", "Z": "K"}

FANUC = {
    "G0",
    "G1",
    "G2",
    "G3",
    "G4",
    "G6.2",
    "G17",
    "G18",
    "G19",
    "G21",
    "G40",
    "G49",
    "G54",
    "G80",
    "G90",
    "G93",
    "G94",
    "G5.1",
    "M30",
}
ALONE = {"G21", "G5.1"}
"""Words that stand in blocks of their own."""


class LanguageError(AssertionError):
    """A line that the control would not take."""


class Reader:
    """Where the tool stands, and the moves that took it there."""

    def __init__(self) -> None:
        self.run = Run()
        self.at = np.zeros(3)
        self.feed: float | None = None
        self.dwells: list[float] = []

    def go(self, word: str, line: int, target: dict[str, float], plane: str = "XY", **more) -> None:
        """Add a move; an arc has its absolute `center` and says whether it turns `left`."""
        end = self.at.copy()
        for axis, value in target.items():
            end["XYZ".index(axis)] = value
        a, b = ("XYZ".index(axis) for axis in plane)
        center, angle, length = more.get("center"), 0.0, float(np.linalg.norm(end - self.at))
        if center is not None:
            center = np.array(center)
            before, after = self.at[[a, b]] - center, end[[a, b]] - center
            if abs(np.linalg.norm(before) - np.linalg.norm(after)) > 0.005:
                raise LanguageError(f"line {line}: radii differ")
            angle = math.atan2(after[1], after[0]) - math.atan2(before[1], before[0])
            angle = angle % math.tau or math.tau
            angle = angle if more["left"] else angle - math.tau if angle < math.tau else -math.tau
            length = abs(angle) * float(np.linalg.norm(before))
        cut = word != "rapid"
        if cut and self.feed is None:
            raise LanguageError(f"line {line}: no feed")
        duration = length / self.feed * 60.0 if cut and self.feed else 0.0
        self.run.moves.append(
            Move(
                word=word,
                line=line,
                start=self.at,
                end=end,
                duration=duration,
                length=length,
                feed=self.feed if cut else None,
                exact=False,
                center=center,
                angle=angle,
                axes=(a, b),
                control=more.get("control"),
            )
        )
        self.at = end


def number(text: str, line: int, *, decimals: int, point: bool = False, sign: bool = False) -> float:
    """Read a number as it has to stand there."""
    pattern = rf"{'[-+]' if sign else '-?'}\d+(?:\.\d{{0,{decimals}}})?"
    if not re.fullmatch(pattern, text) or (point and "." not in text):
        raise LanguageError(f"line {line}: the number {text!r}")
    return float(text)


class Fanuc(Reader):
    """Fanuc's state."""

    def __init__(self, decimals: int) -> None:
        super().__init__()
        self.decimals, self.plane, self.motion = decimals, "XY", ""
        self.nurbs: list[tuple[float, list[float] | None]] = []

    def block(self, line: int, raw: str) -> None:
        """Carry out one block."""
        if not raw.isascii() or raw != raw.upper() or len(raw) > 100:
            raise LanguageError(f"line {line}: {raw!r}")
        body = re.sub(r"\([A-Z0-9 .,:=+\-*/_]*\)", "", raw).split()
        codes = [word for word in body if word[0] in "GM"]
        if not set(codes) <= FANUC or (ALONE & set(codes) and len(codes) > 1):
            raise LanguageError(f"line {line}: {codes}")
        given = {word[0]: word[1:] for word in body if word[0] not in "GM"}
        values = {
            letter: number(value, line, decimals=6 if letter == "F" else self.decimals, point=letter not in "PQ")
            for letter, value in given.items()
        }
        self.plane = next((PLANES[code] for code in codes if code in PLANES), self.plane)
        self.feed = values.get("F", self.feed)
        if "G4" in codes:
            self.dwells.append(int(given["P"]) / 1000.0)
            return
        motions = ("G0", "G1", "G2", "G3", "G6.2")
        self.motion = next((code for code in codes if code in motions), self.motion)
        self.move(line, values)

    def move(self, line: int, values: dict[str, float]) -> None:
        """Move where a block says."""
        target = {axis: values[axis] for axis in "XYZ" if axis in values}
        if self.motion == "G6.2" and "K" in values:
            self.nurbs.append((values["K"], [target["X"], target["Y"]] if target else None))
            if len(self.nurbs) == 8:
                _cubic(self, line, self.nurbs)
                self.nurbs = []
            return
        if not target:
            return
        if self.nurbs or self.motion == "G6.2":
            raise LanguageError(f"line {line}: the knots of a NURBS are missing")
        more = {}
        if self.motion in ("G2", "G3"):
            offsets = [values.get(OFFSETS[axis], 0.0) for axis in self.plane]
            start = [self.at["XYZ".index(axis)] for axis in self.plane]
            more = {"center": np.add(start, offsets), "left": self.motion == "G3"}
        self.go("rapid" if self.motion == "G0" else self.motion, line, target, self.plane, **more)


def run_fanuc(text: str, *, decimals: int = 3) -> Reader:
    """Run a Fanuc program."""
    lines = text.split("\n")
    if lines[0] != "%" or lines[-2:] != ["%", ""] or not re.fullmatch(r"O\d{4}", lines[1]):
        raise LanguageError("no tape frame")
    if "M30" not in lines[-3]:
        raise LanguageError("no end")
    reader = Fanuc(decimals)
    for line, raw in enumerate(lines[2:-2], 3):
        reader.block(line, raw)
    return reader


def _cubic(reader: Reader, line: int, nurbs: list) -> None:
    """Four points and eight knots, of which the first and the last four are equal: a cubic Bézier curve."""
    knots, points = [one[0] for one in nurbs], [one[1] for one in nurbs]
    if knots != [0.0] * 4 + [1.0] * 4 or None in points[:4] or points[4:] != [None] * 4:
        raise LanguageError(f"line {line}: no cubic")
    control = np.array(points[:4])
    if not np.array_equal(control[0], reader.at[:2]):
        raise LanguageError(f"line {line}: PS1009, the first point is not where the tool stands")
    reader.go("G6.2", line, {"X": control[3, 0], "Y": control[3, 1]}, control=control)


def _framed(text: str, first: str, last: str) -> Iterator[tuple[int, str]]:
    """Lines of a Heidenhain program, numbered from 1, between a head (a pattern) and an end of its name."""
    lines = text.split("\n")
    head = re.fullmatch(first, lines[0])
    if head is None or lines[-2] != last.format(number=len(lines) - 2, name=head[1]) or lines[-1]:
        raise LanguageError("no frame")
    return enumerate(lines[1:-2], 1)


def run_klartext(text: str) -> Reader:
    """Run a conversational program."""
    reader, pole = Reader(), None
    for line, raw in _framed(text, r"0 BEGIN PGM ([A-Z0-9_]{1,16}) MM", "{number} END PGM {name} MM"):
        count, _, block = raw.partition(" ")
        if count != str(line):
            raise LanguageError(f"block {line}: its number is {count}")
        words = block.split()
        if words[0] == ";" or re.fullmatch(r"CYCL DEF (9\.0 DWELL TIME|32\.0 TOLERANCE|32\.1( T[\d.]+)?)|M30", block):
            continue
        if (dwell := re.fullmatch(r"CYCL DEF 9\.1 DWELL ([\d.]+)", block)) is not None:
            reader.dwells.append(number(dwell[1], line, decimals=3))
            continue
        target = {w[0]: number(w[1:], line, decimals=4, sign=True) for w in words[1:] if w[0] in "XYZ"}
        rest = [word for word in words[1:] if word[0] not in "XYZ"]
        feeds = [word for word in rest if re.fullmatch(r"F[\d.]+", word)]
        if feeds:
            reader.feed = number(feeds[0][1:], line, decimals=3)
        rest = [word for word in rest if word not in feeds]
        if words[0] == "CC" and set(target) == {"X", "Y"} and not rest:
            pole = [target["X"], target["Y"]]
        elif words[0] == "C" and pole is not None and rest in (["DR+"], ["DR-"]):
            reader.go("C", line, target, center=pole, left=rest == ["DR+"])
        elif words[0] == "L" and rest in (["R0"], ["R0", "FMAX"]):
            reader.go("rapid" if "FMAX" in rest else "L", line, target)
        else:
            raise LanguageError(f"block {line}: {block}")
    return reader


def run_tnc_iso(text: str) -> Reader:
    """Run an ISO program."""
    reader, pole = Reader(), None
    for line, raw in _framed(text, r"%([A-Z0-9_]{1,16}) G71 \*", "N99999999 %{name} G71 *"):
        if re.fullmatch(rf"N{10 * line} ;.*", raw):
            continue
        block = re.fullmatch(rf"N{10 * line} (.*) \*", raw)
        if block is None:
            raise LanguageError(f"block {line}: {raw}")
        words = block[1].split()
        if block[1] in ("G90 G40", "M30") or re.fullmatch(r"G62( T[\d.]+)?", block[1]):
            continue
        values = {w[0]: w[1:] for w in words}
        places = {k: number(v, line, decimals=4, sign=True) for k, v in values.items() if k in "XYZIJ"}
        if not {*values} <= {*"GXYZIJF"}:
            raise LanguageError(f"block {line}: {raw}")
        if words[0] == "G04":
            reader.dwells.append(number(values["F"], line, decimals=3))
            continue
        if "F" in values:
            reader.feed = number(values["F"], line, decimals=3)
        if set(values) == {"I", "J"}:
            pole = [places["I"], places["J"]]
        elif words[0] in ("G02", "G03") and pole is not None:
            reader.go(words[0], line, places, center=pole, left=words[0] == "G03")
        elif words[0] in ("G00", "G01"):
            reader.go("rapid" if words[0] == "G00" else "G01", line, places)
        else:
            raise LanguageError(f"block {line}: {raw}")
    return reader
