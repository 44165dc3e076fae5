"""A little G-code interpreter for tests, written from the controllers' manuals and from nothing in ph_post.

It knows G0 to G5, G17 to G19, G21, G40, G49, G54, G61, G64, G80, G90, G91.1, G93, G94 and M2, and refuses
everything else. Lengths in mm, times in s.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field

import numpy as np

WORD = re.compile(r"([A-Z])(-?\d+(?:\.\d+)?)")
GROUPS = {
    "motion": {"G0", "G1", "G2", "G3", "G5", "G80"},
    "plane": {"G17", "G18", "G19"},
    "units": {"G21"},
    "distance": {"G90"},
    "arc distance": {"G91.1"},
    "feed": {"G93", "G94"},
    "compensation": {"G40"},
    "tool length": {"G49"},
    "offset": {"G54"},
    "path": {"G61", "G64"},
}
PLANES = {"G17": ("X", "Y"), "G18": ("Z", "X"), "G19": ("Y", "Z")}
OFFSETS = {"X": "I", "Y": "J", "Z": "K"}


@dataclass
class Move:
    """One move, ready to be sampled."""

    word: str
    line: int
    start: np.ndarray
    end: np.ndarray
    duration: float
    length: float
    feed: float | None
    exact: bool
    center: np.ndarray | None = None
    angle: float = 0.0
    axes: tuple[int, int] = (0, 1)
    control: np.ndarray | None = None

    def points(self, count: int) -> np.ndarray:
        """Points along the move, both ends included, at equal steps of its parameter."""
        u = np.linspace(0.0, 1.0, count + 1)[:, None]
        points = self.start + u * (self.end - self.start)
        if self.center is not None:
            a, b = self.axes
            radius = self.start[[a, b]] - self.center
            turn = self.angle * u[:, 0]
            points[:, a] = self.center[0] + np.cos(turn) * radius[0] - np.sin(turn) * radius[1]
            points[:, b] = self.center[1] + np.sin(turn) * radius[0] + np.cos(turn) * radius[1]
        if self.control is not None:
            c = self.control
            points[:, :2] = (1 - u) ** 3 * c[0] + 3 * u * (1 - u) ** 2 * c[1] + 3 * u**2 * (1 - u) * c[2] + u**3 * c[3]
        return points


@dataclass
class Run:
    """What a program does: its moves in order, and the modal state at its beginning and end."""

    moves: list[Move] = field(default_factory=list)
    opening: dict[str, str] = field(default_factory=dict)
    state: dict[str, str] = field(default_factory=dict)
    feed: float | None = None
    ended: bool = False


class GCodeError(Exception):
    """A program that a controller would refuse."""


def run(text: str, *, start: tuple[float, float, float] = (0.0, 0.0, 0.0), max_line: int = 255) -> Run:
    """Interpret a program that begins with the tool at `start`."""
    result = Run()
    at = np.array(start, dtype=float)
    for number, line in enumerate(text.split("\n"), 1):
        if len(line) > max_line:
            raise GCodeError(f"line {number} is too long")
        words = _words(line, number)
        if words and result.ended:
            raise GCodeError(f"line {number} follows the end")
        if ("M", "2") in words and len(words) == 1:
            result.ended = True
        elif words:
            at = _block(result, words, at, number)
        if not result.opening:
            result.opening = dict(result.state)
    return result


def _words(line: str, number: int) -> list[tuple[str, str]]:
    code = re.sub(r"\([^()]*\)", "", line).replace(" ", "")
    words = WORD.findall(code)
    if "".join(letter + value for letter, value in words) != code:
        raise GCodeError(f"line {number}: cannot read {line!r}")
    values = [letter for letter, _ in words if letter != "G"]
    if len(values) != len(set(values)):
        raise GCodeError(f"line {number}: a word stands twice")
    return words


def _block(result: Run, words: list[tuple[str, str]], at: np.ndarray, number: int) -> np.ndarray:
    state = result.state
    gees = ["G" + value for letter, value in words if letter == "G"]
    values = {letter: float(value) for letter, value in words if letter != "G"}
    for gee in set(gees) - {"G4"}:
        _set_mode(result, gee, number)
    given = "F" in values
    if given:
        result.feed = values.pop("F")
        if not result.feed > 0:
            raise GCodeError(f"line {number}: F {result.feed}")
    if "G4" in gees:
        result.moves.append(Move("G4", number, at, at, values["P"], 0.0, None, True))
        return at
    if {"G61", "G64"} & set(gees) or not values:
        return at
    move = _move(state, values, at, number)
    if move.word != "G0":
        if result.feed is None or (state["feed"] == "G93" and not given):
            raise GCodeError(f"line {number}: no F")
        move.feed = result.feed
        move.duration = 60.0 / move.feed if state["feed"] == "G93" else 60.0 * move.length / move.feed
    move.exact = state.get("path") == "G61"
    result.moves.append(move)
    return move.end


def _set_mode(result: Run, gee: str, number: int) -> None:
    group = next((name for name, members in GROUPS.items() if gee in members), None)
    if group is None:
        raise GCodeError(f"line {number}: {gee}")
    if group == "feed" and gee != result.state.get("feed"):
        result.feed = None
    result.state[group] = gee


def _move(state: dict[str, str], values: dict[str, float], at: np.ndarray, line: int) -> Move:
    word = state["motion"]
    for key in ("units", "distance", "plane", "feed"):
        if key not in state:
            raise GCodeError(f"line {line}: moves before the {key} is set")
    end = at.copy()
    for axis, letter in enumerate("XYZ"):
        end[axis] = values.get(letter, end[axis])
    extra = set(values) - set("XYZ")
    move = Move(word, line, at.copy(), end, 0.0, float(np.linalg.norm(end - at)), None, False)
    if word in ("G0", "G1"):
        if extra:
            raise GCodeError(f"line {line}: {extra} with {word}")
    elif word in ("G2", "G3"):
        _arc(move, state["plane"], values, extra, line)
    elif word == "G5":
        if extra != set("IJPQ") or state["plane"] != "G17" or state["feed"] == "G93":
            raise GCodeError(f"line {line}: G5 with {extra} in {state['plane']} {state['feed']}")
        near, far = (
            at[:2] + np.array([values["I"], values["J"]]),
            end[:2] + np.array([values["P"], values["Q"]]),
        )
        move.control = np.array([at[:2], near, far, end[:2]])
        points = move.points(2000)
        move.length = float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
    else:
        raise GCodeError(f"line {line}: no motion mode")
    return move


def _arc(move: Move, plane: str, values: dict[str, float], extra: set[str], line: int) -> None:
    first, second = PLANES[plane]
    if extra != {OFFSETS[first], OFFSETS[second]}:
        raise GCodeError(f"line {line}: {extra} in {plane}")
    a, b = "XYZ".index(first), "XYZ".index(second)
    start, end = move.start[[a, b]], move.end[[a, b]]
    center = start + np.array([values[OFFSETS[first]], values[OFFSETS[second]]])
    r0, r1 = np.linalg.norm(start - center), np.linalg.norm(end - center)
    if abs(r0 - r1) > 0.002 or min(r0, r1) < 0.002:
        raise GCodeError(f"line {line}: radii {r0} and {r1}")
    sense = 1.0 if move.word == "G3" else -1.0
    angles = [math.atan2(*(p - center)[::-1]) for p in (start, end)]
    angle = sense * (angles[1] - angles[0]) % (2 * math.pi)
    if angle == 0.0:
        angle = 2 * math.pi
    move.center, move.angle, move.axes = center, sense * angle, (a, b)
    across = [axis for axis in range(3) if axis not in (a, b)]
    move.length = math.hypot(0.5 * (r0 + r1) * angle, float((move.end - move.start)[across[0]]))
