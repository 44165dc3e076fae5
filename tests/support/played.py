"""A part program played by the tests' own hand: its words, its moves, and where the motors are at every instant.

It knows what programs of paths hold for LinuxCNC: G0 to G3 and G5, G4 in seconds, incremental centres, millimetres,
feed per minute. Every move runs at its feed from end to end.
"""

from __future__ import annotations

import math
import re
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

WORD = re.compile(r"([A-Z])([-+]?[0-9]*\.?[0-9]+)")

RAPID = 0.04
"""Speed of rapids [m/s]: any will do, as only where they end matters."""


class Played(NamedTuple):
    """Places of the motors [m], shape (n, axes), at every period; `cut` says which rows lie behind the approach."""

    position: Floats
    cut: NDArray[np.bool_]


def play_program(text: str, axes: str, period: float, start: Floats) -> Played:
    """Run a program from `start` [m]; what runs under G64 is the cut, what runs under G61 the approach and the end."""
    at, feed, motion = dict(zip(axes, start.tolist(), strict=True)), RAPID, "G0"
    rows, cut = [np.array([start])], [np.zeros(1, dtype=bool)]
    cutting, left = False, 0.0
    for line in text.split("\n"):
        words = WORD.findall(re.sub(r"\(.*?\)|;.*", "", line))
        values = {letter: float(number) for letter, number in words if letter != "G"}
        codes = [f"G{float(number):g}" for letter, number in words if letter == "G"]
        feed = values["F"] * 1e-3 / 60.0 if "F" in values else feed
        motion = next((code for code in codes if code in ("G0", "G1", "G2", "G3", "G5")), motion)
        cutting = "G64" in codes or (cutting and "G61" not in codes)
        here = np.array([at[axis] for axis in axes])
        if "G4" in codes:
            curve, duration = _curve("G1", here, here, {})[0], values["P"]
        elif any(axis in values for axis in axes):
            at |= {axis: values[axis] * 1e-3 for axis in axes if axis in values}
            there = np.array([at[axis] for axis in axes])
            curve, length = _curve(motion, here, there, values)
            duration = length / (RAPID if motion == "G0" else feed)
        else:
            continue
        t = np.arange(period - left, duration, period)
        left = duration - float(t[-1]) if t.size else left + duration
        if t.size:
            rows.append(curve(t / duration))
            cut.append(np.full(t.size, cutting))
    end = np.array([[at[axis] for axis in axes]])
    return Played(np.vstack([*rows, end]), np.concatenate([*cut, [False]]))


def _curve(motion: str, here: Floats, there: Floats, values: dict[str, float]):  # type: ignore[no-untyped-def]
    """Points of a move by its share, and its length [m]."""
    if motion in ("G0", "G1"):
        return lambda u: here + u[:, None] * (there - here), float(np.linalg.norm(there - here))
    if motion == "G5":
        return _spline(here, there, values)
    centre = here[:2] + 1e-3 * np.array([values.get("I", 0.0), values.get("J", 0.0)])
    first, last = here[:2] - centre, there[:2] - centre
    begin = math.atan2(first[1], first[0])
    turn = math.atan2(last[1], last[0]) - begin
    way = 1.0 if motion == "G3" else -1.0
    turn = way * (way * turn % math.tau or math.tau)
    radius = math.hypot(*first)

    def points(u: Floats) -> Floats:
        angle = begin + turn * u
        flat = centre + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        return np.hstack([flat, here[2:] + u[:, None] * (there[2:] - here[2:])])

    return points, math.hypot(radius * turn, float(np.linalg.norm((there - here)[2:])))


def _spline(here: Floats, there: Floats, values: dict[str, float]):  # type: ignore[no-untyped-def]
    """A cubic by its control points, run at equal steps of its length."""
    first = here[:2] + 1e-3 * np.array([values["I"], values["J"]])
    second = there[:2] + 1e-3 * np.array([values["P"], values["Q"]])
    u = np.linspace(0.0, 1.0, 257)
    weights = ((1.0 - u) ** 3, 3.0 * u * (1.0 - u) ** 2, 3.0 * u**2 * (1.0 - u), u**3)
    curve = sum(w[:, None] * p for w, p in zip(weights, (here[:2], first, second, there[:2]), strict=True))
    way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(curve, axis=0), axis=1)))

    def points(share: Floats) -> Floats:
        flat = np.stack([np.interp(share * way[-1], way, column) for column in curve.T], axis=1)
        return np.hstack([flat, here[2:] + share[:, None] * (there[2:] - here[2:])])

    return points, float(way[-1])
