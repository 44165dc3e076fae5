"""Cubic pieces as G5 moves, where the controller's own rendering of them can be trusted."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import numpy as np

from ph_post.gcode.shape import Shape
from ph_post.geometry.bernstein import elevate, subdivide
from ph_post.types import Array, BoolArray, IntArray

_HALVINGS = 8
"""A cubic is halved at most so often in search of parts that can be G5; the rest becomes chords."""


class CubicParts(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Parts of runs on cubic pieces, in the order of travel, arrays of shape (n,).

    `run` the number of the run a part belongs to, `u0`, `u1` its ends on the piece, `s0`, `s1` on the track
    [m], `smooth` whether it can be a G5.
    """

    run: IntArray
    u0: Array
    u1: Array
    s0: Array
    s1: Array
    smooth: BoolArray


def cut_cubics(
    shape: Shape,
    deviation: Callable[[Array], Array],
    piece: IntArray,
    s0: Array,
    s1: Array,
    *,
    least: Array,
    tolerance: float,
) -> CubicParts:
    """Cut runs on cubic pieces into what can be G5 and what cannot, halving what cannot.

    Parameters
    ----------
    shape : Shape
    deviation : callable
        How far the controller's rendering leaves cubics, see :class:`ph_post.gcode.dialect.Dialect`.
    piece, s0, s1 : arrays, shape (m,)
        The runs: their pieces and their ends on the track [m], in the order of travel.
    least : Array, shape (m,)
        Shortest G5 [m]: the controller breaks it into several moves, which it must have the time for.
    tolerance : float
        How far the controller's rendering may leave the curve [m].
    """
    run = np.arange(piece.size)
    u0, u1 = shape.local(piece, s0), shape.local(piece, s1)
    parts = CubicParts(run=run, u0=u0, u1=u1, s0=s0, s1=s1, smooth=np.zeros(run.size, dtype=bool))
    done = []
    for halvings in range(_HALVINGS + 1):
        length = np.abs(parts.s1 - parts.s0)
        smooth = length >= least[parts.run]
        control = cubic_control(shape, piece[parts.run[smooth]], parts.u0[smooth], parts.u1[smooth])
        smooth[smooth] = deviation(control) <= tolerance
        parts = msgspec.structs.replace(parts, smooth=smooth)
        halve = ~smooth & (length >= 2.0 * least[parts.run]) & (halvings < _HALVINGS)
        done.append(_rows(parts, np.flatnonzero(~halve)))
        parts = _halves(shape, piece, _rows(parts, np.flatnonzero(halve)))
    return _in_order(done)


def _rows(parts: CubicParts, rows: IntArray) -> CubicParts:
    return CubicParts(**{name: getattr(parts, name)[rows] for name in CubicParts.__struct_fields__})


def _halves(shape: Shape, piece: IntArray, parts: CubicParts) -> CubicParts:
    u = 0.5 * (parts.u0 + parts.u1)
    s = shape.track.arc_length(piece[parts.run], u)
    return CubicParts(
        run=np.tile(parts.run, 2),
        u0=np.concatenate([parts.u0, u]),
        u1=np.concatenate([u, parts.u1]),
        s0=np.concatenate([parts.s0, s]),
        s1=np.concatenate([s, parts.s1]),
        smooth=np.tile(parts.smooth, 2),
    )


def _in_order(groups: list[CubicParts]) -> CubicParts:
    """Put parts in the order of travel, and join neighbours that cannot be G5."""
    names = CubicParts.__struct_fields__
    parts = CubicParts(**{name: np.concatenate([getattr(one, name) for one in groups]) for name in names})
    parts = _rows(parts, np.lexsort((np.where(parts.s1 >= parts.s0, parts.s0, -parts.s0), parts.run)))
    run, smooth = parts.run, parts.smooth
    first = np.append(True, smooth[1:] | smooth[:-1] | (run[1:] != run[:-1]))
    last = np.append(first[1:], True)
    head, tail = _rows(parts, np.flatnonzero(first)), _rows(parts, np.flatnonzero(last))
    return msgspec.structs.replace(head, u1=tail.u1, s1=tail.s1)


def cubic_control(shape: Shape, piece: IntArray, u0: Array, u1: Array) -> Array:
    """Control points of parts of polynomial pieces of degree <= 3, as cubics.

    Parameters
    ----------
    shape : Shape
    piece : IntArray, shape (n,)
    u0, u1 : Array, shape (n,)
        u1 < u0 runs a part backwards.

    Returns
    -------
    Array, shape (n, 4, 2)
    """
    which, row = np.unique(piece, return_inverse=True)
    nets = [shape.track.pieces[number].control.T for number in which]
    cubics = [net if net.shape[1] == 4 else elevate(net, 4 - net.shape[1]) for net in nets]
    low, high = np.minimum(u0, u1)[:, None], np.maximum(u0, u1)[:, None]
    right = subdivide(np.reshape(cubics, (-1, 2, 4))[row], low)[1]
    # `high` as seen from [low, 1]; nothing is left to see where low = 1, but then high is 1 too
    at = np.divide(high - low, 1.0 - low, out=np.ones_like(high), where=low < 1.0)
    part = np.swapaxes(subdivide(right, at)[0], 1, 2)
    return np.asarray(np.where((u1 < u0)[:, None, None], part[:, ::-1], part))
