"""Find the straight moves of a CAM program that were sampled from a curve, and their places on it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.geometry.track import Track
from ph_post.types import Array, IntArray, frozen
from ph_post.units import MICROMETRE, MM


class Move(msgspec.Struct, frozen=True, array_like=True):
    """A command of the CAM program: its name, such as G1, and its words, lengths in mm and F in mm/s."""

    name: str
    words: dict[str, float]


class StraightRun(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Straight moves in one plane at one feed, one behind the other.

    `first` is the index of the first move, `points` (n + 1, 2) [m] are their ends, `feed` in m/s.
    """

    first: int
    points: Array
    feed: float


class CurveTrace(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Moves of a run that lie on a curve.

    `curve` is the curve's number, `first` and `last` are points of the run; `at` are their places on the
    curve, shape (last - first + 1,): number of the piece plus its u. They rise or fall throughout.
    """

    curve: int
    first: int
    last: int
    at: Array


class TracedMove(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A written move: where it ends, shape (2,) [m]; of a spline the middle control points (2, 2) [m]."""

    end: Array
    inner: Array | None = None


ON_CURVE: Final = 0.5 * MICROMETRE
"""Largest distance [m] of a point that counts as taken from the curve: CAM programs keep doubles."""

FEWEST: Final = 2
"""Fewest moves that are worth a curve."""

_SAMPLES: Final = 32
"""Places a cubic piece that are looked at to begin with."""

_STEPS: Final = 12
"""Newton's method: what has not converged by then is no closest point."""

_INSIDE: Final = np.linspace(0.0, 1.0, 9)[1:-1]
"""Places between two points at which the curve is held against the chord."""

_TRIES: Final = 2
"""Places on the curve that are tried for the next point, nearest first."""


def find_traces(points: Array, tracks: Sequence[Track], tolerance: float) -> list[CurveTrace]:
    """Find the stretches of a polyline whose points lie on a curve, in order, and whose chords stay near it.

    Parameters
    ----------
    points : Array, shape (n + 1, 2)
        The polyline [m].
    tracks : sequence of Track
        The curves, as cubics.
    tolerance : float
        Largest distance of a chord from its part of the curve [m].
    """
    near = [_places_of(points, track) for track in tracks]
    found, begin = [], 0
    while begin < len(points) - FEWEST:
        best = max(
            (_longest(points, track, near[k], begin, k, tolerance) for k, track in enumerate(tracks)),
            key=lambda trace: trace.last,
            default=None,
        )
        if best is not None and best.last - best.first >= FEWEST:
            found.append(best)
            begin = best.last
        else:
            begin += 1
    return found


def place_on(track: Track, at: Array) -> Array:
    """Return places on a track, shape (n, 2)."""
    piece = np.clip(np.floor(at).astype(np.int64), 0, len(track.pieces) - 1)
    places: Array = track.derivatives(piece, at - piece, 0)[0]
    return places


def _longest(points: Array, track: Track, near: list[Array], begin: int, curve: int, tolerance: float) -> CurveTrace:
    """Return the longest trace from one point on, either way along the curve; maybe of no move at all."""
    best = CurveTrace(curve=curve, first=begin, last=begin, at=np.empty(0))
    for start in near[begin]:
        for way in (1, -1):
            at = [float(start)]
            while begin + len(at) < len(points):
                after = _next(points, track, near, begin + len(at) - 1, at[-1], way, tolerance)
                if after is None:
                    break
                at.append(after)
            if len(at) - 1 > best.last - best.first:
                best = CurveTrace(curve=curve, first=begin, last=begin + len(at) - 1, at=np.array(at))
    return best


def _next(
    points: Array, track: Track, near: list[Array], index: int, at: float, way: int, tolerance: float
) -> float | None:
    """Return the place of the next point, None where the curve does not go there."""
    ahead = sorted((way * (float(place) - at), float(place)) for place in near[index + 1])
    for distance, place in [one for one in ahead if one[0] > 0.0][:_TRIES]:
        between = place_on(track, at + way * distance * _INSIDE)
        if _along(points[index], points[index + 1], between, tolerance):
            return place
    return None


def _along(start: Array, end: Array, between: Array, tolerance: float) -> bool:
    """Return true where places advance from `start` to `end` within the tolerance [m] of the chord."""
    chord = end - start
    length = float(np.hypot(*chord))
    forward = chord / length
    along = (between - start) @ forward
    across = (between - start) @ np.array([-forward[1], forward[0]])
    rising = np.diff(np.concatenate([[0.0], along, [length]])) > 0.0
    return bool(rising.all() and np.abs(across).max() <= tolerance)


def _places_of(points: Array, track: Track) -> list[Array]:
    """Places of a track at which each point lies on it, in ascending order; mostly none, one or two."""
    count = len(track.pieces)
    at = np.arange(count * _SAMPLES + 1) / _SAMPLES
    samples = place_on(track, at)
    reach = float(np.linalg.norm(np.diff(samples, axis=0), axis=1).max()) + ON_CURVE
    point, sample = _near(points, samples, reach)
    place = _refined(points[point], track, np.clip(at[sample], 0.0, count))
    apart = np.linalg.norm(place_on(track, place) - points[point], axis=1)
    point, place = point[apart <= ON_CURVE], place[apart <= ON_CURVE]
    # One place is reached from several samples, but for the last digits
    return [np.unique(np.round(place[point == index], 9)) for index in range(len(points))]


def _near(points: Array, samples: Array, reach: float) -> tuple[IntArray, IntArray]:
    """Return the pairs of a point and a sample that are no farther apart than `reach`."""
    from scipy.spatial import cKDTree

    inside = np.flatnonzero(
        ((points >= samples.min(axis=0) - reach) & (points <= samples.max(axis=0) + reach)).all(axis=1)
    )
    near = cKDTree(points[inside]).sparse_distance_matrix(cKDTree(samples), reach, output_type="coo_matrix")
    return inside[near.row].astype(np.int64), near.col.astype(np.int64)


def _refined(points: Array, track: Track, at: Array) -> Array:
    """Newton's method for the place of each point, kept on the piece where it began."""
    piece = np.clip(np.floor(at), 0, len(track.pieces) - 1)
    u = at - piece
    for _ in range(_STEPS):
        value, slope, bend = track.derivatives(piece.astype(np.int64), u, 2)
        off = value - points
        first = (off * slope).sum(axis=1)
        second = (slope * slope).sum(axis=1) + (off * bend).sum(axis=1)
        step = np.divide(first, second, out=np.zeros_like(first), where=second > 0.0)
        u = np.clip(u - step, 0.0, 1.0)
    return np.asarray(piece + u)


_SAME: Final = 1e-6
"""Lengths in mm that differ by less are one."""

_RAPIDS: Final = {"G0", "G00"}
_LINES: Final = {"G1", "G01"}
_ARCS: Final = {"G2", "G02", "G3", "G03"}
_STILL: Final = {"M3", "M03", "M4", "M04", "M5", "M05", "M7", "M07", "M8", "M08", "M9", "M09"}
"""Spindle and coolant: the tool stays where it is."""

_COMMENTS: Final = ("(", ";")

_PLAIN: Final = frozenset("XYZF")


class _Tool(msgspec.Struct):
    """Position of the tool [mm], None where unknown, and feed [mm/s]."""

    x: float | None = None
    y: float | None = None
    z: float | None = None
    feed: float | None = None

    def go(self, words: dict[str, float]) -> None:
        self.x, self.y = words.get("X", self.x), words.get("Y", self.y)
        self.z, self.feed = words.get("Z", self.z), words.get("F", self.feed)

    def forget(self) -> None:
        self.x = self.y = self.z = None


def find_runs(moves: Sequence[Move]) -> list[StraightRun]:
    """Find all runs of two or more straight moves at constant height and feed.

    Whatever is not known to leave the tool where it is ends a run, and makes its place unknown; behind a G91
    nothing is looked for.
    """
    return [run for run in _all_runs(moves) if len(run.points) > 2]


def _all_runs(moves: Sequence[Move]) -> Iterator[StraightRun]:
    tool, first, points = _Tool(), 0, list[tuple[float, float]]()
    for index, move in enumerate(moves):
        if move.name == "G91":
            break
        goes_on = bool(points) and _cuts_on(move, tool) and move.words.get("F", tool.feed) == tool.feed
        if points and not goes_on:
            yield _run(first, points, tool.feed)
            points = []
        if not goes_on and _cuts_on(move, tool):
            assert tool.x is not None
            assert tool.y is not None
            first, points = index, [(tool.x, tool.y)]
        _follow(move, tool)
        if points:
            assert tool.x is not None
            assert tool.y is not None
            points.append((tool.x, tool.y))
    if points:
        yield _run(first, points, tool.feed)


def _run(first: int, points: list[tuple[float, float]], feed: float | None) -> StraightRun:
    return StraightRun(first=first, points=frozen(np.array(points) * MM), feed=(feed or 0.0) * MM)


def _cuts_on(move: Move, tool: _Tool) -> bool:
    """Return true for a straight move to another place at the tool's height."""
    words = move.words
    if move.name not in _LINES or not words.keys() <= _PLAIN or tool.x is None or tool.y is None:
        return False
    if not words.get("F", tool.feed):
        return False
    level = "Z" not in words or (tool.z is not None and abs(words["Z"] - tool.z) <= _SAME)
    moved = max(abs(words.get("X", tool.x) - tool.x), abs(words.get("Y", tool.y) - tool.y))
    return level and moved > _SAME


def _follow(move: Move, tool: _Tool) -> None:
    if move.name in _RAPIDS:
        tool.go({letter: value for letter, value in move.words.items() if letter != "F"})
    elif move.name in _LINES or move.name in _ARCS:
        tool.go(move.words)
    elif move.name not in _STILL and not move.name.startswith(_COMMENTS):
        tool.forget()
