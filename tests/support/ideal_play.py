"""Error that play alone causes on a machine whose motors follow every command at once.

A motor goes along a program's exact path; the table, held by friction, moves only where the motor pushes it. The
motions come from `interpreter.py`, the distances from a search tree of scipy: nothing is shared with ph_post.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from . import interpreter

STEP = 1e-2
"""Distance of the samples on the path [mm]; a distance of the table that is found is too large by a part of it."""

ON = 1e-7
"""Places that are as near [mm] are on the path."""

MOST, AIR = 0.95, 4.0
"""A piece of a path is no more than `AIR` times as long as the part `MOST` of all."""


def samples(text: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places along a program's exact path [mm], the time that each takes [s], and whether the tool cuts there."""
    points, time, cuts = [], [], []
    for move in interpreter.run(text).moves:
        count = max(2, int(np.ceil(move.length / STEP)) if move.word != "G0" else 2)
        points.append(move.points(count)[1:])
        time.append(np.full(count, move.duration / count))
        cuts.append(np.full(count, move.word != "G0"))
    return np.concatenate(points), np.concatenate(time), np.concatenate(cuts)


def table(motor: np.ndarray, backlash: dict[str, float], sides: dict[str, float]) -> np.ndarray:
    """Table positions [mm] behind play (full width, by axis) that begins with the motor on given sides."""
    found = motor.copy()
    for column, name in enumerate("XYZ"):
        half = 0.5 * backlash.get(name, 0.0)
        if half == 0.0:
            continue
        behind = motor[0, column] - sides[name] * half
        for row, ahead in enumerate(motor[:, column].tolist()):
            behind = min(max(behind, ahead - half), ahead + half)
            found[row, column] = behind
    return found


def distances(places: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Distances [mm] of places from the polyline through points.

    The nearest point may be one of another pass, or of a short cut beside a long one whose points are far apart. So of
    all points that the nearest piece may begin at, both pieces are looked at. Pieces that are much longer than most are
    no path but a way through the air: they count where they begin at the nearest point.
    """
    tree, lengths = cKDTree(path), np.linalg.norm(np.diff(path, axis=0), axis=1)
    nearest = tree.query(places)[1]
    found = np.minimum(_from_piece(places, path, nearest - 1), _from_piece(places, path, nearest))
    reach = 0.5 * min(lengths.max(), AIR * float(np.quantile(lengths, MOST)))
    off = np.flatnonzero(found > ON)
    for rows in np.array_split(off, len(off) // 5000 + 1):
        near = tree.query_ball_point(places[rows], found[rows] + reach)
        owner = np.repeat(rows, [len(some) for some in near])
        point = np.concatenate([np.array(some, dtype=np.int64) for some in near]) if len(rows) else rows
        for low in (point - 1, point):
            some = lengths[np.clip(low, 0, len(lengths) - 1)] <= 2.0 * reach
            np.minimum.at(found, owner[some], _from_piece(places[owner[some]], path, low[some]))
    return found


def _from_piece(places: np.ndarray, path: np.ndarray, low: np.ndarray) -> np.ndarray:
    """Distances [mm] of places from the pieces of a polyline that begin at points, one each."""
    low = np.clip(low, 0, len(path) - 2)
    begin, way = path[low], path[low + 1] - path[low]
    square = np.maximum((way * way).sum(axis=1), 1e-30)
    share = np.clip(((places - begin) * way).sum(axis=1) / square, 0.0, 1.0)
    return np.asarray(np.linalg.norm(places - begin - share[:, None] * way, axis=1))


def play_error(
    program: str, original: str, backlash: dict[str, float], sides: dict[str, float], below: float = np.inf
) -> tuple[float, float]:
    """Largest and rms distance [mm] of the table from the original's path while the tool cuts, below a height [mm]."""
    path, _, cuts = samples(original)
    motor, time, cutting = samples(program)
    cutting &= motor[:, 2] < below
    away = distances(table(motor, backlash, sides), path[cuts])[cutting]
    weight = time[cutting] / time[cutting].sum()
    return float(away.max()), float(np.sqrt(weight @ (away * away)))
