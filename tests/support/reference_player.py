"""Programs as an independent reference reads and executes them: a few G words, arcs, and a table with backlash.

Nothing of this comes from the package. Lengths are in mm, feeds in mm/min, angles in radians.
"""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from .ideal_play import dragged

PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
BEGINS = ((-37.1, 51.3, 30.7), (61.3, -44.2, 30.7))
"""Where the machine happens to stand when a program begins [mm]."""

STEP = 0.02
"""Distance of the samples of a motion [mm]; the extreme of an arc of 2 mm radius is then missed by 25 nm at most."""


FEW = 40
"""Of so many moves each is looked at."""

NEAR = 10
"""Samples of a longer path that are looked at."""


@dataclass(frozen=True)
class Move:
    """A motion: `mode` 0 to 3, ends (3,), `line` number from 1, `feed` [mm/min], centre and sweep of an arc.

    An arc whose end is at another radius than its start is a spiral, as of LinuxCNC, or has the radius of its start, as
    of Grbl. Its radius is `said` by R [mm], 0 by a centre.
    """

    mode: int
    start: np.ndarray
    end: np.ndarray
    line: int
    feed: float
    plane: tuple[int, int, int] = (0, 1, 2)
    center: tuple[float, float] = (0.0, 0.0)
    sweep: float = 0.0
    spiral: bool = False
    said: float = 0.0

    @property
    def length(self) -> float:
        a, b, c = self.plane
        if self.mode < 2:
            return float(np.linalg.norm(self.end - self.start))
        radius = math.hypot(self.start[a] - self.center[0], self.start[b] - self.center[1])
        return math.hypot(radius * self.sweep, self.end[c] - self.start[c])

    def at(self, share: np.ndarray) -> np.ndarray:
        """Points at shares of the motion, shape (n, 3)."""
        points = self.start + share[:, None] * (self.end - self.start)
        if self.mode >= 2:
            a, b, _ = self.plane
            x, y = self.start[a] - self.center[0], self.start[b] - self.center[1]
            turned = math.atan2(y, x) + share * self.sweep
            first = math.hypot(x, y)
            last = math.hypot(*(self.end[[a, b]] - self.center)) if self.spiral else first
            radius = first + share * (last - first)
            points[:, a] = self.center[0] + radius * np.cos(turned)
            points[:, b] = self.center[1] + radius * np.sin(turned)
        return points

    def tangent(self, last: bool) -> np.ndarray:
        """Direction of travel at the end or the start, of length 1."""
        way = self.end - self.start
        if self.mode >= 2:
            a, b, c = self.plane
            x, y = (self.end if last else self.start)[[a, b]] - np.array(self.center)
            turn = math.copysign(1.0, self.sweep)
            way = np.zeros(3)
            way[a], way[b], way[c] = -turn * y, turn * x, (self.end[c] - self.start[c]) / abs(self.sweep)
        return way / np.linalg.norm(way)


def interpret(
    text: str,
    begin: tuple[float, ...] = BEGINS[0],
    *,
    spiral: bool = False,
    released: tuple[float, ...] | None = None,
    own_center: bool = True,
) -> list[Move]:
    """Read the motions of a program that begins at a place [mm], with arcs that are a `spiral` or not.

    Their centres are from their starts, `own_center`, or places, where no line says which.

    Where motors are let go (M18, M84) X and Y are pushed by hand to the place where they were `released`, if that is
    given. A drilling cycle is a hole: down from R, and up to R again, or with G98 to where it came from.
    """
    unit, absolute, inverse, plane, mode, feed = 1.0, True, False, 17, None, 0.0
    at, moves = np.array(begin), []
    drills, retracts = False, True
    hole: dict[str, float] = {}
    for number, raw in enumerate(text.splitlines(), 1):
        line = re.sub(r"\([^)]*\)|;.*|^/.*", "", raw).upper().replace(" ", "")
        words = re.findall(r"([A-Z])([-+]?\d*\.?\d*)", line)
        codes = [round(10 * float(value)) for letter, value in words if letter == "G"]
        value = {letter: float(size) for letter, size in words if letter not in "GMN"}
        for code in codes:
            unit = {200: 25.4, 210: 1.0}.get(code, unit)
            absolute = {900: True, 910: False}.get(code, absolute)
            own_center = {901: False, 911: True}.get(code, own_center)
            inverse = {930: True, 940: False}.get(code, inverse)
            plane = code // 10 if code in (170, 180, 190) else plane
            mode = code // 10 if code in (0, 10, 20, 30) else mode
            retracts = {980: True, 990: False}.get(code, retracts)
            drills = code in (730, 810, 820, 830, 850, 860, 890) or (drills and code not in (0, 10, 20, 30, 800))
        feed = value.get("F", feed)
        if (100 in codes and value.get("L") == 20.0 and not moves) or 920 in codes:
            # Where the machine stands gets the coordinates that are said.
            at = np.array([unit * value[letter] if letter in value else at[k] for k, letter in enumerate("XYZ")])
        if released is not None and {("M", "18"), ("M", "84")} & set(words):
            at = np.append(released[:2], at[2])
        if (
            40 in codes
            or 280 in codes
            or 100 in codes
            or 920 in codes
            or mode is None
            or not set("XYZIJKR") & set(value)
        ):
            continue
        if drills:
            hole |= {letter: value[letter] for letter in "ZR" if letter in value}
            across = [
                unit * value[letter] + (0.0 if absolute else at[k]) if letter in value else at[k]
                for k, letter in enumerate("XY")
            ]
            clear = unit * hole["R"] + (0.0 if absolute else at[2])
            depths = clear, unit * hole["Z"] + (0.0 if absolute else clear)
            moves += _hole(at, across, depths, number, unit * feed, retracts=retracts)
            at = moves[-1].end
            continue
        end = at.copy()
        for axis, letter in enumerate("XYZ"):
            if letter in value:
                end[axis] = unit * value[letter] + (0.0 if absolute else at[axis])
        move = Move(mode, at, end, number, unit * feed, spiral=spiral)
        if mode >= 2:
            move = _arc(move, PLANES[plane], value, unit, own_center)
        if inverse and mode > 0:
            move = Move(**{**vars(move), "feed": move.length * feed})
        moves.append(move)
        at = end
    return moves


def _hole(
    at: np.ndarray, across: list[float], depths: tuple[float, float], number: int, feed: float, *, retracts: bool
) -> list[Move]:
    """Moves of a drilling cycle from a place: `across` at R or higher, down to its bottom at the feed, and up."""
    clear, bottom = depths
    high = max(at[2], clear)
    ends = [(0, [*at[:2], high]), (0, [*across, high]), (0, [*across, clear]), (1, [*across, bottom])]
    ends.append((0, [*across, high if retracts else clear]))
    begins = [at, *(np.array(end) for _, end in ends)]
    return [Move(mode, begin, np.array(end), number, feed) for begin, (mode, end) in zip(begins, ends, strict=False)]


def up_to_refused(text: str, *, own_center: bool = True) -> tuple[str, str]:
    """Return a program up to the first arc that Grbl 1.1 refuses, and that line; all of it, and no line, without one.

    Behind an error a sender stops. By `gc_execute_line` of its gcode.c an arc ends no more than 5 um, or a thousandth
    of its radius, beyond the circle on which it begins, and never half a millimetre, and its chord is no longer than
    two of the radius that is said.
    """
    lines = text.splitlines(keepends=True)
    for move in interpret(text, own_center=own_center):
        if move.mode > 1:
            start, end = (place[list(move.plane[:2])] for place in (move.start, move.end))
            first, off = math.dist(start, move.center), abs(math.dist(end, move.center) - math.dist(start, move.center))
            refused = off > 0.005 and (off > 0.5 or off > 0.001 * first)
            if refused or (move.said and math.dist(start, end) > 2.0 * move.said * (1.0 + 1e-6)):
                return "".join(lines[: move.line - 1]), lines[move.line - 1]
    return text, ""


def _arc(move: Move, plane: tuple[int, int, int], value: dict[str, float], unit: float, own: bool) -> Move:
    a, b, _ = plane
    start, end = move.start[[a, b]], move.end[[a, b]]
    turn = 1.0 if move.mode == 3 else -1.0
    if "R" in value:
        radius, way = unit * value["R"], end - start
        half = math.hypot(*way) / 2
        side = turn * math.copysign(1.0, radius) * math.sqrt(max(radius * radius - half * half, 0.0)) / (2 * half)
        center = (start + end) / 2 + side * np.array([-way[1], way[0]])
    else:
        center = unit * np.array([value.get("IJK"[axis], 0.0) for axis in (a, b)]) + (start if own else 0.0)
    first, last = start - center, end - center
    sweep = (math.atan2(last[1], last[0]) - math.atan2(first[1], first[0])) * turn % (2 * math.pi)
    if np.allclose(start, end, rtol=0.0, atol=1e-9):
        sweep = 2 * math.pi
    said = abs(unit * value.get("R", 0.0))
    whole = {**vars(move), "plane": plane, "center": tuple(center), "sweep": turn * sweep, "said": said}
    return Move(**whole)


@dataclass(frozen=True)
class Run:
    """Samples of all motions: motor positions (n, 3), and the index of the motion of each."""

    motor: np.ndarray
    owner: np.ndarray


def run(moves: list[Move], step: float = STEP) -> Run:
    """Execute motions exactly."""
    rows, owner = [], []
    for k, move in enumerate(moves):
        count = max(2, math.ceil(move.length / step) + 1)
        rows.append(move.at(np.linspace(0.0, 1.0, count)))
        owner.append(np.full(count, k))
    return Run(np.concatenate(rows), np.concatenate(owner))


def play(motor: np.ndarray, gap: float, side: float) -> np.ndarray:
    """Table of one axis, held by friction within a backlash `gap`, which begins at the part `side`, -1 to 1, of it."""
    return dragged(motor, gap / 2, motor[0] + side * gap / 2)


def tables(motor: np.ndarray, gaps: tuple[float, ...], zero: tuple[int, ...]) -> list[np.ndarray]:
    """Tables (n, 3) for all combinations of the sides on which the axes begin; of one without backlash both are one.

    `zero` of an axis is the direction from which its zero was taken, 0 for the middle of its backlash.
    """
    axes = [
        [play(motor[:, axis], gap, side) + zero[axis] * gap / 2 for side in ((-1, 1) if gap else (0,))]
        for axis, gap in enumerate(gaps)
    ]
    return [np.stack(columns, axis=1) for columns in itertools.product(*axes)]


def distance(points: np.ndarray, path: list[Move]) -> np.ndarray:
    """Distance of points (n, 3) from the nearest of straight lines, arcs and helices.

    Of a path of many moves those of the nearest samples are looked at.
    """
    least, path = np.full(len(points), np.inf), [move for move in path if move.length > 0.0]
    if len(path) <= FEW:
        for move in path:
            least = np.minimum(least, _to_move(points, move))
        return least
    sampled = run(path, 0.1)
    near = sampled.owner[cKDTree(sampled.motor).query(points, NEAR)[1]]
    # Every pair of a move and a point near it, once, by the number of the move.
    move, row = np.divmod(np.unique(near * len(points) + np.arange(len(points))[:, None]), len(points))
    straight = np.array([one.mode < 2 for one in path])[move]
    start, end = (np.array([getattr(one, name) for one in path])[move[straight]] for name in ("start", "end"))
    np.minimum.at(least, row[straight], _to_lines(points[row[straight]], start, end))
    move, row = move[~straight], row[~straight]
    for own in np.split(np.arange(move.size), np.flatnonzero(np.diff(move)) + 1) if move.size else ():
        least[row[own]] = np.minimum(least[row[own]], _to_arc(points[row[own]], path[move[own[0]]]))
    return least


def _to_move(points: np.ndarray, move: Move) -> np.ndarray:
    return _to_lines(points, move.start, move.end) if move.mode < 2 else _to_arc(points, move)


def _to_lines(points: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Distances of points (n, 3) from a line, or from one each."""
    way, from_start = end - start, points - start
    share = np.sum(from_start * way, axis=-1) / np.maximum(np.sum(way * way, axis=-1), 1e-30)
    return np.linalg.norm(from_start - np.clip(share, 0.0, 1.0)[:, None] * way, axis=1)


def _to_arc(points: np.ndarray, move: Move) -> np.ndarray:
    """In a plane by the angle about the centre; on a helix by Newton's method from there, on the nearest turn."""
    a, b, c = move.plane
    x, y = move.start[a] - move.center[0], move.start[b] - move.center[1]
    radius, rise = math.hypot(x, y), move.end[c] - move.start[c]
    turned = np.arctan2(points[:, b] - move.center[1], points[:, a] - move.center[0]) - math.atan2(y, x)
    share = np.mod(turned / move.sweep, 2 * math.pi / abs(move.sweep))
    if rise:
        away = np.hypot(points[:, a] - move.center[0], points[:, b] - move.center[1])
        first = math.atan2(y, x)
        angle = np.arctan2(points[:, b] - move.center[1], points[:, a] - move.center[0])
        for _ in range(8):
            lag = first + share * move.sweep - angle
            slope = radius * away * move.sweep * np.sin(lag) + rise * (move.start[c] + share * rise - points[:, c])
            bend = radius * away * move.sweep**2 * np.cos(lag) + rise**2
            share = share - slope / bend
    ends = np.minimum(*(np.linalg.norm(points - end, axis=1) for end in (move.start, move.end)))
    inside = (share >= 0.0) & (share <= 1.0)
    foot = move.at(np.clip(share, 0.0, 1.0))
    return np.where(inside, np.minimum(ends, np.linalg.norm(points - foot, axis=1)), ends)
