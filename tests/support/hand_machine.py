"""A machine that a person measures by hand: play, squareness and scale, a dial, calipers and a ball bar.

It reads programs by a small interpreter of its own, which stops at M0, and knows nothing of ph_post. The table
hangs behind its command in its play, a stop operator by axis; what a dial or calipers show is where it is, not what
theory says of it. What the cutter leaves of a shape is found ray by ray from its path.
"""

from __future__ import annotations

import functools
import math
import re
from dataclasses import dataclass, field

import numpy as np

WORD = re.compile(r"([A-Z])\s*([+-]?(?:\d+\.?\d*|\.\d+))")
CHORD = 0.1
"""Way between two places of an arc [mm]."""

RAYS = np.radians(np.linspace(-6.0, 6.0, 25))
"""Directions in which a flat jaw looks for what is left, about its own [rad]."""


@dataclass
class Course:
    """A program as commanded: places [mm] (n, 3) where each move ends or an arc is sampled, and what it stops for."""

    places: np.ndarray
    stops: list[tuple[int, str]]


@functools.cache
def course(text: str) -> Course:
    """Follow a program in mm of G0 to G3; comments before an M0 are what it says there."""
    at, motion, words_before = np.zeros(3), "", []
    places, stops = [at.copy()], []
    for line in text.splitlines():
        said = re.findall(r"\(([^)]*)\)", line)
        words_before += said
        words = WORD.findall(re.sub(r"\([^)]*\)", "", line))
        codes = [f"{letter}{float(number):g}" for letter, number in words if letter in "GM"]
        if "M0" in codes:
            stops.append((len(places) - 1, " ".join(" ".join(words_before).split())))
        if not said:
            words_before = []
        if "G4" in codes:
            continue
        motion = next((code for code in codes if code in ("G0", "G1", "G2", "G3")), motion)
        numbers = {letter: float(number) for letter, number in words}
        target = np.array([numbers.get(axis, at[k]) for k, axis in enumerate("XYZ")])
        if motion in ("G2", "G3") and "I" in numbers:
            places += list(_arc(at, target, (numbers["I"], numbers.get("J", 0.0)), 1 if motion == "G3" else -1))
        elif not np.array_equal(target, at):
            places.append(target)
        at = target
    return Course(np.array(places), stops)


def _arc(at: np.ndarray, target: np.ndarray, offset: tuple[float, float], turn: int) -> np.ndarray:
    centre = at[:2] + offset
    radius = float(np.hypot(*offset))
    begin = math.atan2(-offset[1], -offset[0])
    end = math.atan2(*(target[:2] - centre)[::-1])
    sweep = (turn * (end - begin)) % math.tau or math.tau
    angles = begin + turn * sweep * np.linspace(0.0, 1.0, max(8, math.ceil(sweep * radius / CHORD)) + 1)[1:]
    points = np.column_stack([centre[0] + radius * np.cos(angles), centre[1] + radius * np.sin(angles)])
    return np.column_stack([points, np.full(len(points), target[2])])


@dataclass
class HandMachine:
    """A machine with errors [mm, rad]; `play` by axis is the whole width, `slope` its change per mm of travel."""

    play: dict[str, float]
    slope: dict[str, float] = field(default_factory=dict)
    squareness: float = 0.0
    scale: dict[str, float] = field(default_factory=dict)
    cutter: float = 6.0
    climb: float = 0.0

    def width(self, axis: str, place: np.ndarray) -> np.ndarray:
        return self.play.get(axis, 0.0) + self.slope.get(axis, 0.0) * place

    def table(self, places: np.ndarray) -> np.ndarray:
        """Where the table is while it is commanded to places, (n, 3) [mm]."""
        behind = places.copy()
        for column, axis in enumerate("XYZ"):
            commands, at, found = places[:, column], float(places[0, column]), []
            half = 0.5 * self.width(axis, commands)
            if not half.any():
                continue
            for low, high in zip((commands - half).tolist(), (commands + half).tolist(), strict=True):
                at = min(max(at, low), high)
                found.append(at)
            behind[:, column] = found
        found = behind * (1.0 + np.array([self.scale.get(axis, 0.0) for axis in "XYZ"]))
        found[:, 0] += self.squareness * behind[:, 1]
        return found

    def dial(self, text: str, axis: str, error: float, random: np.random.Generator, grain: float) -> list[list[float]]:
        """Readings of a dial at the stops of a program, row by row [mm]; it is zeroed where the program says so."""
        run = course(text)
        table = self.table(run.places)[:, "XYZ".index(axis)]
        zero, rows = 0.0, []
        for place, words in run.stops:
            if "set the indicator" in words:
                zero = table[place] + random.normal(0.0, error)
            if found := re.search(r"row (\d+), reading (\d+)", words):
                if found[2] == "1":
                    rows.append([])
                shown = table[place] - zero + random.normal(0.0, error)
                rows[-1].append(round(round(shown / grain) * grain, 5))
                assert (len(rows), len(rows[-1])) == (int(found[1]), int(found[2]))
        return rows

    def cut(self, text: str, centres: dict[str, tuple[float, float]]) -> dict[str, dict[str, float]]:
        """Widths of what the cutter leaves of each shape [mm]."""
        run = course(text)
        table = self.table(run.places)
        low = run.places[:, 2] < 0.0
        found = {}
        for shape, centre in centres.items():
            near = low & (np.abs(run.places[:, :2] - centre).max(axis=1) < self._reach(centres))
            way = _dense(table[:, :2] - centre, near)
            radius = 0.5 * self.cutter + (0.5 * self.climb if shape == "circle_cw" else 0.0)
            angles = {"x": 0.0, "y": 90.0} if "square" in shape else {f"d{n}": float(n) for n in (0, 45, 90, 135)}
            rays = RAYS if "circle" in shape else np.zeros(1)  # jaws lie against a straight edge, at its middle
            found[shape] = {name: _across(way, radius, math.radians(one), rays) for name, one in angles.items()}
        found["slot"] = {"width": self.cutter}
        return found

    @staticmethod
    def _reach(centres: dict[str, tuple[float, float]]) -> float:
        return 0.5 * abs(centres["circle_cw"][0] - centres["circle_ccw"][0])


def _dense(table: np.ndarray, used: np.ndarray) -> np.ndarray:
    """The way where the cutter is in the work, at most a chord between places."""
    piece = np.flatnonzero(used[1:] & used[:-1])
    ways = table[piece + 1] - table[piece]
    count = np.maximum(np.ceil(np.hypot(*ways.T) / CHORD), 1.0).astype(np.int64)
    own = np.repeat(np.arange(piece.size), count)
    share = (np.arange(own.size) - (np.cumsum(count) - count)[own]) / count[own]
    return np.unique(np.round(table[piece[own]] + share[:, None] * ways[own], 7), axis=0)


def _across(way: np.ndarray, radius: float, angle: float, rays: np.ndarray) -> float:
    """Distance between two flat jaws on both sides of what is left, the jaws across `angle`."""
    return sum(_support(way, radius, angle + side, rays) for side in (0.0, math.pi))


def _support(way: np.ndarray, radius: float, angle: float, rays: np.ndarray) -> float:
    near = way[way @ [math.cos(angle), math.sin(angle)] > 0.0]
    along = near @ np.array([np.cos(angle + rays), np.sin(angle + rays)])
    aside = np.sum(near**2, axis=1)[:, None] - along**2
    hit = (aside < radius**2) & (along > 0.0)
    left = np.where(hit, along - np.sqrt(np.maximum(radius**2 - aside, 0.0)), np.inf).min(axis=0)
    return float(np.max(left * np.cos(rays)))


def ball_bar(
    machine: HandMachine, radius: float, turn: int, count: int, lag: tuple[float, float], off: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Angles [degrees] and radii [mm] of one arc, of three turns the middle one; `lag` [mm] by axis."""
    angle = turn * np.linspace(-math.tau, math.tau, 2 * count * 20, endpoint=False)
    commands = np.zeros((angle.size, 3))
    commands[:, 0] = radius * np.cos(angle - turn * lag[0] / radius)
    commands[:, 1] = radius * np.sin(angle - turn * lag[1] / radius)
    table = machine.table(commands)
    rows = slice(count * 20, None, 20)
    return np.degrees(angle[rows]), np.hypot(table[rows, 0] - off[0], table[rows, 1] - off[1])
