"""Error that play alone causes on a machine whose motors follow every command at once.

A motor goes along a program's exact path; the table, held by friction, moves only where the motor pushes it. The
motions come from `interpreter.py`, the distances from a search tree of scipy: nothing is shared with ph_post.
"""

from __future__ import annotations

from itertools import pairwise

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


def dragged(motor: np.ndarray, half: float, begin: float) -> np.ndarray:
    """Places of a table that one motor takes along, which stands at `begin`; `half` the backlash is on either side.

    From turn to turn of the motor the table stands until a side of the backlash comes to it.
    """
    found = np.empty_like(motor)
    found[0] = min(max(begin, motor[0] - half), motor[0] + half)
    rises = np.diff(motor) >= 0.0
    turns = (np.flatnonzero(rises[1:] != rises[:-1]) + 1).tolist()
    for first, last in pairwise([0, *turns, rises.size]):
        way, at = motor[first + 1 : last + 1], found[first]
        up = rises[first:last].all()
        found[first + 1 : last + 1] = np.maximum(at, way - half) if up else np.minimum(at, way + half)
    return found


def table(motor: np.ndarray, backlash: dict[str, float], sides: dict[str, float]) -> np.ndarray:
    """Table positions [mm] behind play (full width, by axis) that begins with the motor on given sides."""
    found = motor.copy()
    for column, name in enumerate("XYZ"):
        half = 0.5 * backlash.get(name, 0.0)
        if half == 0.0:
            continue
        found[:, column] = dragged(motor[:, column], half, motor[0, column] - sides[name] * half)
    return found


class Polyline:
    """The polyline through points, from which distances are asked for.

    The nearest point may be one of another pass, or of a short cut beside a long one whose points are far apart. So of
    all pieces those are looked at whose middle is no farther away than what was found and half of their length. Which
    are path and not a way through the air is told by `joined`, one of each piece. Where it is not told, pieces that are
    much longer than most are air: they count where they begin at the nearest point.
    """

    def __init__(self, path: np.ndarray, joined: np.ndarray | None = None) -> None:
        self._path, self._points, self._joined = path, cKDTree(path), joined
        lengths = np.linalg.norm(np.diff(path, axis=0), axis=1)
        if joined is None:
            joined = lengths <= min(lengths.max(), AIR * float(np.quantile(lengths, MOST)))
        pieces = np.flatnonzero(joined)
        # Of passes over the same way one is enough.
        ways = np.round(np.stack([path[:-1], path[1:]], axis=1)[pieces] / ON).reshape(-1, 2 * path.shape[1])
        pieces = pieces[np.unique(ways, axis=0, return_index=True)[1]]
        # Of pieces of about the same length few are near enough.
        size = np.ceil(np.log2(np.maximum(lengths[pieces], ON)))
        alike = (pieces[size == one] for one in np.unique(size))
        self._alike = [(own, cKDTree(0.5 * (path[own] + path[own + 1])), 0.5 * lengths[own].max()) for own in alike]

    def distances(self, places: np.ndarray) -> np.ndarray:
        """Return the distances [mm] of places."""
        path, (found, nearest) = self._path, self._points.query(places)
        if self._joined is None:
            found = np.minimum(_from_piece(places, path, nearest - 1), _from_piece(places, path, nearest))
        for pieces, tree, half in self._alike:
            _come_nearer(found, places, path, pieces, tree, half)
        return found


def distances(places: np.ndarray, path: np.ndarray) -> np.ndarray:
    """Distances [mm] of places from the polyline through points."""
    return Polyline(path).distances(places)


def _come_nearer(
    found: np.ndarray, places: np.ndarray, path: np.ndarray, pieces: np.ndarray, tree: cKDTree, half: float
) -> None:
    """Lower distances found [mm] to those from pieces of a polyline that are no longer than twice a half length."""
    rows, looked, most = np.flatnonzero(found > ON), 0, 4
    while rows.size and looked < len(pieces):
        most = min(most, len(pieces))
        left = []
        for some in np.array_split(rows, rows.size * most // 1_000_000 + 1):
            away, which = tree.query(places[some], np.arange(looked + 1, most + 1))
            row, rank = np.nonzero(away <= found[some, None] + half)
            np.minimum.at(found, some[row], _from_piece(places[some[row]], path, pieces[which[row, rank]]))
            left.append(some[(away[:, -1] <= found[some] + half) & (found[some] > ON)])
        rows, looked, most = np.concatenate(left), most, 4 * most


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
