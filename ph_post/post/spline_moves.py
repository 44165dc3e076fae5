"""Write cubic splines in place of straight moves that sample a curve, where the controller plays them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import numpy as np

from ph_post.dialects.base import CubicAbility, Dialect
from ph_post.errors import SolveError
from ph_post.gcode.blocks import read_shape
from ph_post.gcode.polynomials import cubic_control, cut_cubics
from ph_post.geometry.bernstein import elevate, evaluate
from ph_post.geometry.curves import Bezier
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.piecewise import Piece, PieceSet
from ph_post.geometry.track import Track
from ph_post.post.options import CHORD_TOLERANCE
from ph_post.post.tracing import CurveTrace, Move, StraightRun, TracedMove, find_runs, find_traces, place_on
from ph_post.types import Array, IntArray
from ph_post.units import MICROMETRE, MM

CLOSE: Final = 0.2 * MICROMETRE
"""Largest distance of a cubic from the rational or higher-degree curve it stands for [m], part of a G5's tolerance."""

_HALVINGS: Final = 12
_PROBES: Final = np.array([0.25, 0.5, 0.75])


def cubic_track(curve: Nurbs) -> Track:
    """Return a plane curve as a track of cubics: exactly up to degree 3, else within `CLOSE`.

    Raises
    ------
    SolveError
        Where 4096 cubics a piece do not come so close.
    """
    return Track.from_curves([Bezier(control) for piece in curve.pieces for control in _cubics(piece)])


def _cubics(piece: Piece) -> Array:
    degree = piece.control.shape[0] - 1
    if piece.kind != "polynomial" or degree > 3:
        return _interpolated(piece)
    control = piece.control.T
    return (control if degree == 3 else elevate(control, 3 - degree)).T[np.newaxis]


def _interpolated(piece: Piece) -> Array:
    """Cubics with the piece's places and derivatives at their ends, shape (m, 4, 2)."""
    for halvings in range(_HALVINGS + 1):
        control, error = _hermite(PieceSet([piece]), 1 << halvings)
        if error <= CLOSE:
            return control
    raise SolveError(f"a curve cannot be written in cubics; residual {error:.3g} m")


def _hermite(pieces: PieceSet, count: int) -> tuple[Array, float]:
    """`count` cubics at equal steps of u, and the largest distance at equal parameters [m]."""
    u = np.arange(count + 1) / count
    place, slope = pieces.derivatives(np.zeros(count + 1, dtype=np.int64), u, 1)
    lead = slope / (3 * count)
    control = np.stack([place[:-1], place[:-1] + lead[:-1], place[1:] - lead[1:], place[1:]], axis=1)
    at = (u[:-1, np.newaxis] + _PROBES / count).ravel()
    true = pieces.derivatives(np.zeros(at.size, dtype=np.int64), at, 0)[0].reshape(count, _PROBES.size, -1)
    found = np.stack([evaluate(control.transpose(0, 2, 1), probe) for probe in _PROBES], axis=1)
    return control, float(np.linalg.norm(found - true, axis=-1).max())


_LEAST: Final = 1e-9
"""Parts of a piece that are narrower in u are rounding."""


def trace_moves(
    moves: Sequence[Move], tracks: Sequence[Track], dialect: Dialect, period: float, tolerance: float
) -> tuple[list[Move], int]:
    """Write cubic splines where straight moves follow a curve.

    Only moves of one height and one feed whose ends lie on the curve, in its order, are replaced; a spline
    begins and ends where they did. What the controller would not play within a micrometre, or not fast
    enough, stays straight, through the points that were there.

    Parameters
    ----------
    moves : sequence of Move
    tracks : sequence of Track
        The curves that the moves may have been sampled from, as cubics.
    dialect : Dialect
    period : float
        The controller's servo period [s]: it breaks a spline into moves, none shorter than that.
    tolerance : float
        Largest distance of a straight move from the curve [m].

    Returns
    -------
    list of Move, int
        The moves, and the number of splines among them.
    """
    if (ability := dialect.abilities.cubic) is None or not tracks:
        return list(moves), 0
    done, kept, count = list[Move](), 0, 0
    for run in find_runs(moves):
        for trace in find_traces(run.points, tracks, tolerance):
            least = ability.pieces * period * run.feed
            steps = _steps(tracks[trace.curve], trace, run, ability, least)
            splines = sum(step.inner is not None for step in steps)
            if not splines:
                continue
            first = run.first + trace.first
            done += moves[kept:first]
            done += _written(steps, run.points[trace.first], moves[first].words, run.feed)
            kept, count = run.first + trace.last, count + splines
    return [*done, *moves[kept:]], count


def _steps(track: Track, trace: CurveTrace, run: StraightRun, ability: CubicAbility, least: float) -> list[TracedMove]:
    """Cut a trace into splines and straight moves."""
    shape = read_shape(track, arcs=False, splines=True)
    piece, u0, u1 = _cut_at_pieces(trace)
    parts = cut_cubics(
        shape,
        ability.deviation,
        piece,
        track.arc_length(piece, u0),
        track.arc_length(piece, u1),
        least=np.full(piece.size, least),
        tolerance=CHORD_TOLERANCE,
    )
    control = cubic_control(shape, piece[parts.run], parts.u0, parts.u1)
    ends = piece[parts.run][:, np.newaxis] + np.stack([parts.u0, parts.u1], axis=1)
    steps = [
        step
        for row in range(parts.run.size)
        for step in _part(track, trace, run, control[row], ends[row].tolist(), bool(parts.smooth[row]))
    ]
    return [*steps[:-1], TracedMove(end=run.points[trace.last], inner=steps[-1].inner)]


def _part(
    track: Track, trace: CurveTrace, run: StraightRun, control: Array, at: Sequence[float], smooth: bool
) -> Iterator[TracedMove]:
    """Yield one spline, or the points of the run on this part and its end."""
    end = place_on(track, np.array([at[1]]))[0]
    if smooth:
        yield TracedMove(end=end, inner=control[1:3])
        return
    low, high = min(at) + _LEAST, max(at) - _LEAST
    for index in np.flatnonzero((trace.at > low) & (trace.at < high)):
        yield TracedMove(end=run.points[trace.first + index])
    yield TracedMove(end=end)


def _cut_at_pieces(trace: CurveTrace) -> tuple[IntArray, Array, Array]:
    """Pieces that a trace runs over, in its order, and from where to where on each."""
    low, high = float(trace.at.min()), float(trace.at.max())
    inner = np.arange(np.floor(low) + 1, np.ceil(high))
    marks = np.concatenate([[low], inner[(inner > low + _LEAST) & (inner < high - _LEAST)], [high]])
    piece = np.floor(0.5 * (marks[:-1] + marks[1:]))
    u0, u1 = np.clip(marks[:-1] - piece, 0.0, 1.0), np.clip(marks[1:] - piece, 0.0, 1.0)
    if trace.at[0] > trace.at[-1]:
        piece, u0, u1 = piece[::-1], u1[::-1], u0[::-1]
    return piece.astype(np.int64), u0, u1


def _written(steps: Sequence[TracedMove], start: Array, words: dict[str, float], feed: float) -> Iterator[Move]:
    """Yield moves in mm and mm/s; straight ones keep the height word of those that they stand for."""
    height = {"Z": words["Z"]} if "Z" in words else {}
    for step in steps:
        end = {"X": float(step.end[0] / MM), "Y": float(step.end[1] / MM)}
        if step.inner is None:
            yield Move("G1", {**end, **height, "F": feed / MM})
        else:
            lead, tail = (step.inner[0] - start) / MM, (step.inner[1] - step.end) / MM
            inner = {"I": float(lead[0]), "J": float(lead[1]), "P": float(tail[0]), "Q": float(tail[1])}
            yield Move("G5", {**end, **inner, "F": feed / MM})
        start = step.end
