"""Where a table with backlash goes under a program: a small interpreter and a play operator on fine samples.

It shares no code with the package, and knows what the programs of support.crossed use.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache

import numpy as np
from scipy.spatial import cKDTree

PLANES = {17: (0, 1, 2), 18: (2, 0, 1), 19: (1, 2, 0)}
WORD = re.compile(r"([A-Z])\s*([-+]?(?:\d+\.?\d*|\.\d+))")


@lru_cache(maxsize=64)
def sampled(text: str, spacing: float) -> tuple[np.ndarray, np.ndarray]:
    """Points of a program [mm], and true for those of cutting moves."""
    at, mode, plane, unit, absolute, centers = np.zeros(3), 0, 17, 1.0, True, False
    points, cuts = [at.copy()[None]], [np.array([False])]
    for line in text.splitlines():
        words = WORD.findall(re.sub(r"\([^)]*\)|;.*", "", line))
        values = dict(words)
        for code in [float(value) for letter, value in words if letter == "G"]:
            mode = int(code) if code in (0, 1, 2, 3) else mode
            plane = int(code) if code in PLANES else plane
            unit = {20.0: 25.4, 21.0: 1.0}.get(code, unit)
            absolute = {90.0: True, 91.0: False}.get(code, absolute)
            centers = centers or code == 90.1
        if not any(letter in "XYZIJKR" for letter in values):
            continue
        end = at.copy()
        for a, letter in enumerate("XYZ"):
            if letter in values:
                end[a] = float(values[letter]) * unit + (0.0 if absolute else at[a])
        way = _line(at, end, spacing) if mode < 2 else _arc(at, end, values, (mode, plane, unit, centers), spacing)
        points.append(way)
        cuts.append(np.full(len(way), mode > 0))
        at = end
    return np.concatenate(points), np.concatenate(cuts)


def _line(at, end, spacing):
    count = max(1, math.ceil(np.linalg.norm(end - at) / spacing))
    return at + np.arange(1, count + 1)[:, None] / count * (end - at)


def _arc(at, end, values, modes, spacing):
    mode, plane, unit, centers = modes
    a, b, c = PLANES[plane]
    turn = 1 if mode == 3 else -1
    if "R" in values:
        size, chord = float(values["R"]) * unit, math.dist((at[a], at[b]), (end[a], end[b]))
        height = math.sqrt(max(size**2 - 0.25 * chord**2, 0.0)) * turn * math.copysign(1.0, size)
        middle = 0.5 * (at + end)
        x, y = middle[a] - height * (end[b] - at[b]) / chord, middle[b] + height * (end[a] - at[a]) / chord
    else:
        x, y = (float(values.get("IJK"[axis], 0.0)) * unit + (0.0 if centers else at[axis]) for axis in (a, b))
    one, radius = math.atan2(at[b] - y, at[a] - x), math.hypot(at[b] - y, at[a] - x)
    last = math.hypot(end[b] - y, end[a] - x)
    angle = (math.atan2(end[b] - y, end[a] - x) - one) * turn % (2 * math.pi)
    angle = (angle if angle > 1e-9 else 2 * math.pi) * turn
    count = max(1, math.ceil(radius * abs(angle) / spacing))
    share = np.arange(1, count + 1) / count
    way = np.zeros((count, 3))
    size = radius + share * (last - radius)
    way[:, a], way[:, b] = x + size * np.cos(one + share * angle), y + size * np.sin(one + share * angle)
    way[:, c] = at[c] + share * (end[c] - at[c])
    way[-1] = end
    return way


def table_deviation(original: str, compensated: str, sides: dict[str, tuple[float, float]], unit: float) -> float:
    """Largest distance [mm] of the table from the original's path while it cuts.

    Where the first cut begins the shift of an axis says on which side of its backlash it is.
    """
    return float(_tree(original).query(_table(original, compensated, sides, unit, 0.003))[0].max())


def strayed(
    original: str, compensated: str, damaged: str, sides: dict[str, tuple[float, float]], unit: float = 1.0
) -> float:
    """Largest distance [mm] from the original's path where damage takes the table elsewhere than it went before."""
    before, way = (_table(original, text, sides, unit, ELSEWHERE) for text in (compensated, damaged))
    away = _tree(original).query(way)[0]
    return float(away[cKDTree(before).query(way)[0] > ELSEWHERE].max(initial=0.0))


ELSEWHERE = 0.001
"""Places that are farther apart are others [mm]."""


def _table(original, compensated, sides, unit, spacing):
    """Places of the table while it cuts [mm]."""
    path, cuts = sampled(original, 0.001)
    motor, own = sampled(compensated, spacing)
    first = int(np.argmax(own)) - 1
    start = path[int(np.argmax(cuts)) - 1]
    table = motor.copy()
    for axis, (minus, plus) in sides.items():
        a = "XYZ".index(axis)
        at = motor[first, a] - min(max(motor[first, a] - start[a], minus * unit), plus * unit)
        out = table[:, a]
        low, high = motor[:, a] - plus * unit, motor[:, a] - minus * unit
        for n in range(first, len(out)):
            at = min(max(at, low[n]), high[n])
            out[n] = at
    return table[own]


@lru_cache(maxsize=32)
def _tree(original: str) -> cKDTree:
    path, cuts = sampled(original, 0.001)
    cuts = cuts | np.append(cuts[1:], False)
    return cKDTree(path[cuts])
