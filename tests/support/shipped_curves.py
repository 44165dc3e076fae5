"""Points of the shipped path files, from their definitions alone, in mm."""

from __future__ import annotations

import json
import math
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial
from scipy.interpolate import BSpline
from scipy.spatial import cKDTree

PATHS = Path(__file__).resolve().parents[2] / "paths"
SCALE = {"mm": 1.0, "m": 1000.0}
DENSE = 40_001


def dense_points(name: str) -> np.ndarray:
    """Points along a shipped path, many on every segment, shape (n, dim)."""
    path = json.loads((PATHS / f"{name}.json").read_text())
    scale = SCALE[path["units"]]
    rows = [_SEGMENTS[one["type"]](one, path["axes"], np.linspace(0.0, 1.0, DENSE)) for one in path["segments"]]
    return np.concatenate(rows) * scale


def distance(points: np.ndarray, curve: np.ndarray) -> np.ndarray:
    """Distance of points from the polygon of a dense curve."""
    near = cKDTree(curve).query(points, k=3)[1]
    best = np.full(len(points), np.inf)
    for column in near.T:
        for step in (-1, 1):
            a, b = curve[column], curve[np.clip(column + step, 0, len(curve) - 1)]
            along = b - a
            square = np.maximum((along * along).sum(1), 1e-300)
            foot = np.clip(((points - a) * along).sum(1) / square, 0.0, 1.0)
            best = np.minimum(best, np.linalg.norm(points - a - foot[:, None] * along, axis=1))
    return best


def _floats(rows: Any) -> np.ndarray:
    return np.array([[float(Fraction(str(value))) for value in row] for row in rows])


def _line(one: dict, axes: list, u: np.ndarray) -> np.ndarray:
    a, b = _floats(one["points"])
    return a + u[:, None] * (b - a)


def _arc(one: dict, axes: list, u: np.ndarray) -> np.ndarray:
    start, end, center = _floats([one["start"], one["end"], one["center"]])
    first = math.atan2(*(start - center)[::-1])
    sweep = (math.atan2(*(end - center)[::-1]) - first) % math.tau or math.tau
    if one["turn"] == "cw" and not np.array_equal(start, end):
        sweep -= math.tau
    angle = first + sweep * u
    return center + np.hypot(*(start - center)) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _bezier(one: dict, axes: list, u: np.ndarray) -> np.ndarray:
    points = _floats(one["points"])
    n = len(points) - 1
    basis = np.stack([math.comb(n, k) * u**k * (1 - u) ** (n - k) for k in range(n + 1)], axis=1)
    return basis @ points


def _polynomial(one: dict, axes: list, u: np.ndarray) -> np.ndarray:
    low, high = _floats([one.get("domain", [0, 1])])[0]
    rows = [Polynomial(_floats([one["coefficients"][axis]])[0]) for axis in axes]
    return np.stack([row(low + (high - low) * u) for row in rows], axis=1)


def _ph(one: dict, axes: list, u: np.ndarray) -> np.ndarray:
    parts = [_power(column) for column in _floats(one["preimage"]).T]
    if len(parts) == 2:
        a, b = parts
        slopes = [a * a - b * b, 2 * a * b]
    else:
        a, b, p, q = parts
        slopes = [a * a + b * b - p * p - q * q, 2 * (a * q + b * p), 2 * (b * q - a * p)]
    start = _floats([one["start"]])[0]
    return np.stack([begin + slope.integ()(u) for begin, slope in zip(start, slopes, strict=True)], axis=1)


def _power(values: np.ndarray) -> Polynomial:
    n = len(values) - 1
    t = Polynomial([0.0, 1.0])
    return sum((math.comb(n, k) * v * t**k * (1 - t) ** (n - k) for k, v in enumerate(values)), Polynomial([0.0]))


def _nurbs(one: dict, axes: list, u: np.ndarray) -> np.ndarray:
    knots, degree = _floats([one["knots"]])[0], one["degree"]
    points = _floats(one["points"])
    weights = _floats([one.get("weights") or [1] * len(points)])[0]
    t = knots[degree] + u * (knots[len(points)] - knots[degree])
    lifted = np.column_stack([points * weights[:, None], weights])
    values = BSpline(knots, lifted, degree)(t)
    return values[:, :-1] / values[:, -1:]


_SEGMENTS = {
    "line": _line,
    "arc": _arc,
    "bezier": _bezier,
    "polynomial": _polynomial,
    "ph": _ph,
    "nurbs": _nurbs,
}
