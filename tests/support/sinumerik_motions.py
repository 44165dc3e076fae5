"""Motions of a SINUMERIK program, by a small interpreter of its own: words to dense places of the motors [mm].

It follows G0 to G3 with I, J, K, AC, IC, CR and TURN, CIP, G17 to G19, G70 and G71 with G700 and G710, G90 and G91,
DIAMON and DIAMOF, R parameters that are set by numbers, and passes over everything else. Nothing is shared with
ph_post.
"""

from __future__ import annotations

import math
import re

import numpy as np

STEP = 1e-2
"""Distance of places on a path [mm]."""

_PLANES = {17: [0, 1, 2], 18: [2, 0, 1], 19: [1, 2, 0]}

_WORD = re.compile(
    r"(CIP|POLY|[A-Z]+SPLINE)(?![A-Z0-9])"
    r"|(CR|TURN|[IJK]1(?=\s*=)|R\d+|[A-Z])\s*=?\s*(AC|IC)?\s*\(?\s*([-+]?\d*\.?\d+|R\d+)\s*\)?"
)


class Played:
    """Places (n, 3), whether each is reached while the tool cuts, and the time [s] that dwells and feeds take."""

    def __init__(self) -> None:
        self.at = np.zeros(3)
        self.points: list[np.ndarray] = [self.at[None]]
        self.cuts: list[np.ndarray] = [np.zeros(1, dtype=bool)]
        self.seconds = 0.0

    @property
    def path(self) -> np.ndarray:
        return np.concatenate(self.points)

    @property
    def cutting(self) -> np.ndarray:
        return np.concatenate(self.cuts)


class Run(Played):
    """A program of SINUMERIK, played."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self._mode, self._absolute, self._feed = "G0", True, 1000.0
        self._plane, self._diameters = _PLANES[17], False
        self._unit = 1.0
        self._known: dict[str, float] = {}
        for line in text.splitlines():
            bare = re.sub(r'"[^"]*"', "", line).split(";")[0].strip()
            if not bare.startswith("%"):
                self._line(re.sub(r"^N\d+\s*", "", bare))

    def _line(self, line: str) -> None:
        if re.match(r"(?:M?CALL|CYCLE|MSG|TRANS|A?ROT|DEF|G4\b|SPOS|MCALL)", line):
            found = re.match(r"G4\s*F\s*([\d.]+)", line)
            self.seconds += float(found[1]) if found else 0.0
            return
        for said in re.findall(r"DIAM(ON|OF)", line):
            self._diameters = said == "ON"
        line = re.sub(r"DIAM(ON|OF)", "", line)
        ends: dict[int, float] = {}
        words: dict[str, tuple[str, float]] = {}
        for measure in re.findall(r"G(7[01]0?)(?!\d)", line):
            self._unit = 25.4 if measure in ("70", "700") else 1.0
        for keyword, name, kind, number in _WORD.findall(line):
            if keyword:
                self._mode = keyword
                continue
            value = self._known[number] if number[0] == "R" else float(number)
            if name == "G":
                self._mode = f"G{value:g}" if value in (0, 1, 2, 3) else self._mode
                self._plane = _PLANES.get(int(value), self._plane)
                self._absolute = {90: True, 91: False}.get(int(value), self._absolute)
            elif re.fullmatch(r"R\d+", name):
                self._known[name] = value
            elif name in ("X", "Y", "Z"):
                axis = "XYZ".index(name)
                value *= self._unit * (0.5 if name == "X" and self._diameters else 1.0)
                absolute = kind == "AC" or (self._absolute and kind != "IC")
                ends[axis] = value if absolute else self.at[axis] + value
            elif name == "F":
                self._feed = value
            else:
                words[name] = kind, value * (1.0 if name == "TURN" else self._unit)
        if ends or (self._mode in ("G2", "G3") and words.keys() & {"I", "J", "K"}):
            self._move(ends, words)

    def _move(self, ends: dict[int, float], words: dict[str, tuple[str, float]]) -> None:
        begin, end = self.at, self.at.copy()
        for axis, value in ends.items():
            end[axis] = value
        if self._mode in ("G2", "G3", "CIP"):
            one, other, across = self._plane
            center, angle = self._circle(begin[self._plane], end[self._plane], words)
            radius = np.hypot(begin[one] - center[0], begin[other] - center[1])
            count = max(2, math.ceil(radius * abs(angle) / STEP))
            share = np.linspace(0.0, 1.0, count + 1)[1:]
            turned = math.atan2(begin[other] - center[1], begin[one] - center[0]) + angle * share
            places = np.empty((count, 3))
            places[:, one], places[:, other] = center[0] + radius * np.cos(turned), center[1] + radius * np.sin(turned)
            places[:, across] = begin[across] + share * (end[across] - begin[across])
            places[-1] = end
        else:
            count = max(2, math.ceil(float(np.linalg.norm(end - begin)) / STEP))
            places = begin + np.linspace(0.0, 1.0, count + 1)[1:, None] * (end - begin)
        self.points.append(places)
        self.cuts.append(np.full(len(places), self._mode != "G0"))
        way = np.linalg.norm(np.diff(np.vstack([begin, places]), axis=0), axis=1).sum()
        self.seconds += 60.0 * way / (self._feed if self._mode != "G0" else 6000.0)
        self.at = end

    def _circle(self, begin, end, words) -> tuple[np.ndarray, float]:
        a, b = begin[:2], end[:2]
        if self._mode == "CIP":
            names = ["IJK"[axis] + "1" for axis in self._plane[:2]]
            kinds = words[names[0]][0], words[names[1]][0]
            given = np.array([words[name][1] for name in names])
            away = [kind == "IC" or (not kind and not self._absolute) for kind in kinds]
            middle = given + np.where(away, a, 0.0)
            rows = np.array([middle - a, b - a])
            right = 0.5 * (np.array([middle @ middle, b @ b]) - a @ a)
            center = np.linalg.solve(rows, right)
            first, last = (turn(a - center, point - center) for point in (middle, b))
            return center, last if first < last else last - math.tau
        left = self._mode == "G3"
        if "CR" in words:
            radius = words["CR"][1]
            half = 0.5 * np.linalg.norm(b - a)
            away = math.sqrt(max(radius * radius - half * half, 0.0)) * (1 if (radius > 0) == left else -1)
            across = np.array([-(b - a)[1], (b - a)[0]]) / (2.0 * half)
            center = 0.5 * (a + b) + away * across
        else:
            center = a.copy()
            for axis, name in enumerate("IJK"[axis] for axis in self._plane[:2]):
                kind, value = words.get(name, ("", 0.0))
                center[axis] = value if kind == "AC" else a[axis] + value
        angle = turn(a - center, b - center)
        if np.allclose(a, b, atol=1e-9):
            angle = 0.0
        angle = (angle or math.tau) if left else (angle - math.tau)
        more = math.tau * words.get("TURN", ("", 0.0))[1]
        return center, angle + (more if left else -more)


def turn(one: np.ndarray, other: np.ndarray) -> float:
    """Angle from one direction to another, to the left, from 0 to 2 pi."""
    found = math.atan2(one[0] * other[1] - one[1] * other[0], one @ other) % math.tau
    return 0.0 if not 1e-7 < found < math.tau - 1e-7 else found
