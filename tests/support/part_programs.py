"""Random part programs in the manners that CAM programs have, and what a machine with play makes of them."""

from __future__ import annotations

import math
import random

import numpy as np
from scipy.spatial import cKDTree

from ph_post.gcode.program import ARC, CUBIC, PLANE_AXES, PartProgram
from ph_post.types import Array, IntArray

from .ideal_play import dragged

LONG = 4.0
"""Chords so many times as long as most are few, and each is looked at from everywhere."""


class _Writer:
    """Writes moves in one manner, drawn once for a program."""

    def __init__(self, rng: random.Random) -> None:
        self.rng = rng
        self.inch = rng.random() < 0.2
        self.incremental = rng.random() < 0.3
        self.center_absolute = rng.random() < 0.2 and not self.incremental
        self.radius = rng.random() < 0.3
        self.modal = rng.random() < 0.5
        self.blank = rng.choice([" ", " ", ""])
        self.decimals = 4 if self.inch else 3
        self.fixed = rng.random() < 0.5
        self.end = rng.choice(["\n", "\n", "\r\n"])
        self.lower = rng.random() < 0.2
        self.numbered = rng.random() < 0.2
        self.timed = rng.random() < 0.15
        self.plane = rng.choice([17, 17, 17, 18, 19])
        self.at = [0, 0, 0]
        self.lines: list[str] = []
        self.mode = ""

    def number(self, count: int) -> str:
        text = f"{count / 10**self.decimals:.{self.decimals}f}"
        if self.fixed:
            return text
        text = text.rstrip("0").rstrip(".") or "0"
        return self.rng.choice([text, text, text.replace("0.", ".") if text.startswith("0.") else text])

    def line(self, *words: str) -> None:
        text = self.blank.join(word for word in words if word)
        text = text.lower() if self.lower else text
        number = f"N{10 * len(self.lines)} " if self.numbered and "%" not in text else ""
        self.lines.append(number + text)

    def word(self, name: str) -> str:
        if self.modal and self.mode == name:
            return ""
        self.mode = name
        return name

    def coordinates(self, to: list[int], whole: bool = False) -> list[str]:
        words = []
        for axis, name in enumerate("XYZ"):
            if to[axis] != self.at[axis] or whole:
                count = to[axis] - self.at[axis] if self.incremental else to[axis]
                words.append(name + self.number(count))
        return words

    def feed(self, length: float) -> str:
        if self.timed:
            return f"F{max(600.0 * 10**self.decimals / max(length, 1.0), 0.1):.3f}"
        return f"F{self.rng.choice([300, 600, 600.5])}" if self.rng.random() < 0.4 else ""

    def straight(self, name: str, to: list[int]) -> None:
        words = self.coordinates(to)
        if words:
            feed = self.feed(math.dist(to, self.at)) if name == "G1" else ""
            self.line(self.word(name), *words, feed, self.rng.choice(["", "", "", "(remark X9)"]))
            self.at = to

    def arc(self, radius: int, first: int, sweep: int, rise: int) -> None:
        """Arc about a centre in the active plane, from and over whole multiples of 15 degrees."""
        a, b, c = PLANE_AXES[self.plane]
        center = [
            self.at[a] - round(radius * math.cos(math.radians(first))),
            self.at[b] - round(radius * math.sin(math.radians(first))),
        ]
        rays = [self.at[a] - center[0], self.at[b] - center[1]]
        angle = math.radians(sweep)
        to = list(self.at)
        if sweep % 360:
            to[a] = center[0] + round(rays[0] * math.cos(angle) - rays[1] * math.sin(angle))
            to[b] = center[1] + round(rays[0] * math.sin(angle) + rays[1] * math.cos(angle))
        to[c] += rise
        size = math.hypot(*rays)
        words = self.coordinates(to)
        letters = ["IJK"[a], "IJK"[b]]
        base = (0, 0) if self.center_absolute else (self.at[a], self.at[b])
        centers = [name + self.number(center[n] - base[n]) for n, name in enumerate(letters)]
        if self.radius and abs(sweep) < 170 and sweep % 360:
            # A radius that is not rounded: the arc's centre then is not off.
            centers = [f"R{size / 10**self.decimals:.9f}"]
        self.line(self.word("G3" if sweep > 0 else "G2"), *words, *centers, self.feed(size * abs(angle)))
        self.at = to


def random_program(rng: random.Random, *, moves: int = 14, tools: bool = True) -> bytes:
    """Write a random program in a manner of its own: units, modes, planes, decimals, line ends.

    Without `tools` there are no tool changes, after which positions are not known.
    """
    one = _Writer(rng)
    percent = rng.random() < 0.5
    if percent:
        one.lines.append("%")
    one.lines.append("(a random program, X1)")
    one.line(
        f"G{20 if one.inch else 21}",
        "G40",
        "G49",
        "G90",
        "G94",
        f"G{one.plane}",
        "G90.1" if one.center_absolute else "G91.1",
    )
    one.line(rng.choice(["G64 P0.01", "G61", "G64"]))
    unit = 10**one.decimals // (25 if one.inch else 1)
    home = [rng.randrange(-9, 9) * unit for _ in range(3)]
    one.line("G0", *(name + one.number(count) for name, count in zip("XYZ", home, strict=True)))
    one.at, one.mode = home, "G0"
    if one.incremental:
        one.line("G91")
    one.line("F600", rng.choice(["", "M3", "S100 M3"]))
    if one.timed:
        one.line("G93")
    for _ in range(rng.randrange(1, moves)):
        kind = rng.randrange(10)
        to = [count + rng.randrange(-5, 6) * unit // rng.choice([1, 1, 3]) for count in one.at]
        keep = rng.randrange(3)
        to[keep] = one.at[keep]
        if kind < 4:
            one.straight("G1", to)
        elif kind < 7:
            rise = rng.choice([0, 0, unit // 3])
            one.arc(
                rng.randrange(1, 9) * unit,
                15 * rng.randrange(24),
                rng.choice([-1, 1]) * 15 * rng.choice([2, 3, 6, 12, 18, 24, 24]),
                rise,
            )
        elif kind < 8:
            one.straight("G0", to)
        else:
            change = "M6 T1" if tools else "M7"
            one.line(rng.choice(["M8", "G4 P0.1", "(X5 Y6)", "M9", "S200", "G61", "", "M0", change, "M1"]))
    one.line(rng.choice(["M2", "M30", "M5 M9", "M2"]) if percent else "M2")
    if percent:
        one.lines.append("%")
    return (one.end.join(one.lines) + rng.choice(["", one.end])).encode()


def samples(program: PartProgram, count: int = 48) -> tuple[Array, IntArray]:
    """Points along all motions whose ends are known [m], shape (n, 3), and the motion of each."""
    motions, rows, owner = program.motions, [], []
    shares = np.linspace(0.0, 1.0, count + 1)[:, np.newaxis]
    for k in range(motions.kind.size):
        start, end = motions.start[k], motions.end[k]
        if np.isnan(end).any():
            continue
        if np.isnan(start).any():
            rows.append(end[np.newaxis])
            owner.append([k])
            continue
        points = start + shares * (end - start)
        if motions.kind[k] == ARC:
            a, b, _ = PLANE_AXES[int(motions.plane[k])]
            x, y = start[[a, b]] - motions.center[k]
            angles = np.arctan2(y, x) + shares[:, 0] * motions.angle[k]
            radius = np.hypot(x, y)
            points[:, a] = motions.center[k][0] + radius * np.cos(angles)
            points[:, b] = motions.center[k][1] + radius * np.sin(angles)
        elif motions.kind[k] == CUBIC:
            p, u = motions.control[k], shares
            points = (1 - u) ** 3 * p[0] + 3 * (1 - u) ** 2 * u * p[1] + 3 * (1 - u) * u**2 * p[2] + u**3 * p[3]
        rows.append(points)
        owner.append([k] * len(points))
    return np.concatenate([np.zeros((0, 3)), *rows]), np.array([k for group in owner for k in group], dtype=np.int64)


def played(motor: Array, gap: Array, flank: Array) -> Array:
    """Table of a machine with play and friction, whose motors stand at `motor` (n, 3) [m] in turn.

    `gap` (3,) [m] is the lost motion of each axis; `flank` (3,), +1 or -1, the side the table begins on.
    """
    half = 0.5 * gap
    columns = [dragged(motor[:, axis], half[axis], motor[0, axis] + half[axis] * flank[axis]) for axis in range(3)]
    return np.stack(columns, axis=1)


def distances(points: Array, path: Array) -> Array:
    """Distance of points (n, 3) from a polyline (m, 3), exactly: of its short chords only those count that are near."""
    start, way = path[:-1], np.diff(path, axis=0)
    half = 0.5 * np.linalg.norm(way, axis=1)
    long = half > LONG * np.median(half)
    found = cKDTree(path).query(points)[0]
    for chord in np.flatnonzero(long):
        found = np.minimum(found, _apart(points, start[chord], way[chord]))
    short = np.flatnonzero(~long)
    near = cKDTree((start + 0.5 * way)[short]).query_ball_point(points, found + half[short].max())
    row = np.repeat(np.arange(len(points)), [len(one) for one in near])
    chord = short[np.concatenate([*near]).astype(np.int64)]
    np.minimum.at(found, row, _apart(points[row], start[chord], way[chord]))
    return np.asarray(found)


def _apart(points: Array, start: Array, way: Array) -> Array:
    """Distance of points from a chord each, or all from one."""
    share = np.clip(((points - start) * way).sum(axis=-1) / np.maximum((way * way).sum(axis=-1), 1e-30), 0.0, 1.0)
    return np.asarray(np.linalg.norm(start + share[..., np.newaxis] * way - points, axis=-1))
