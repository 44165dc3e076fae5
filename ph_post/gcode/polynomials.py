"""Parts of cubic, polynomial and rational pieces as blocks.

Cubics become G5 where the controller's own rendering of them can be trusted. A polynomial piece is written by
its power coefficients for a parameter that runs from 0 to 1 over a block, a rational one as a quotient: the
coefficients of the numerators and of the denominator they share, which is 1 at the beginning of the block.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import msgspec
import numpy as np

from ph_post.gcode.blocks import POLYNOMIAL, Blocks, TrackShape
from ph_post.gcode.numbers import to_counts
from ph_post.geometry.bernstein import elevate, restrict, to_power
from ph_post.types import Array, BoolArray, IntArray, join_rows, take
from ph_post.units import MM

DENOMINATOR_DECIMALS: Final = 14
"""Decimals of the coefficients of denominators, which are about 1: half of the last one moves a point at
1000 mm by 5e-12 mm."""


def polynomial_words(
    blocks: Blocks, shape: TrackShape, piece: IntArray, offset: Array, decimals: int
) -> dict[int, IntArray]:
    """Return the coefficients of all blocks that are polynomials, by their number.

    Parameters
    ----------
    blocks : Blocks
    shape : TrackShape
    piece : IntArray, shape (n,)
        Piece on which each block lies.
    offset : Array, shape (n, dim)
        What is carried beside the path [m].
    decimals : int
        Of a millimetre.

    Returns
    -------
    dict
        By block: whole numbers of the last decimal, shape (dim, degree - 1), coefficients of p², p³, …; the
        constant and the linear one follow from the ends, so that blocks meet whatever was rounded. Of a
        rational piece there is one row more, the denominator's: its value at p = 1, then its coefficients of
        p², p³, … in units of 1e-14, and the rows of the numerators begin with a zero for the former.
    """
    rows = np.flatnonzero(blocks.kind == POLYNOMIAL)
    of = piece[rows]
    u0, u1 = shape.parameter_on(of, blocks.s0[rows]), shape.parameter_on(of, blocks.s1[rows])
    found: dict[int, IntArray] = {}
    for row, number, low, high in zip(rows.tolist(), of.tolist(), u0.tolist(), u1.tolist(), strict=True):
        one = shape.track.pieces[number]
        part = restrict(one.control.T, low, high)
        if one.kind == "rational":
            found[row] = _quotient(part, offset[row], decimals)
        else:
            found[row] = to_counts(to_power(part)[:, 2:], decimals)
    return found


def _quotient(net: Array, offset: Array, decimals: int) -> IntArray:
    """Numerators and denominator of homogeneous coefficients (w P, w), the weight at the start being 1."""
    scaled = net / net[-1, 0]
    scaled[:-1] += offset[:, None] * scaled[-1]
    power = to_power(scaled)
    above = to_counts(power[:-1, 2:], decimals)
    below = to_counts(np.append(scaled[-1, -1], power[-1, 2:]) * MM, DENOMINATOR_DECIMALS)
    return np.vstack([np.pad(above, ((0, 0), (1, 0))), below])


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
    shape: TrackShape,
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
    shape : TrackShape
    deviation : callable
        How far the controller's rendering leaves cubics, see :class:`ph_post.dialects.base.CubicAbility`.
    piece, s0, s1 : arrays, shape (m,)
        The runs: their pieces and their ends on the track [m], in the order of travel.
    least : Array, shape (m,)
        Shortest G5 [m]: the controller breaks it into several moves, which it must have the time for.
    tolerance : float
        How far the controller's rendering may leave the curve [m].
    """
    run = np.arange(piece.size)
    u0, u1 = shape.parameter_on(piece, s0), shape.parameter_on(piece, s1)
    parts = CubicParts(run=run, u0=u0, u1=u1, s0=s0, s1=s1, smooth=np.zeros(run.size, dtype=bool))
    done = []
    for halvings in range(_HALVINGS + 1):
        length = np.abs(parts.s1 - parts.s0)
        smooth = length >= least[parts.run]
        control = cubic_control(shape, piece[parts.run[smooth]], parts.u0[smooth], parts.u1[smooth])
        smooth[smooth] = deviation(control) <= tolerance
        parts = msgspec.structs.replace(parts, smooth=smooth)
        halve = ~smooth & (length >= 2.0 * least[parts.run]) & (halvings < _HALVINGS)
        done.append(take(parts, ~halve))
        parts = _halves(shape, piece, take(parts, halve))
    return _in_order(done)


def _halves(shape: TrackShape, piece: IntArray, parts: CubicParts) -> CubicParts:
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
    parts = join_rows(groups)
    parts = take(parts, np.lexsort((np.where(parts.s1 >= parts.s0, parts.s0, -parts.s0), parts.run)))
    run, smooth = parts.run, parts.smooth
    first = np.append(True, smooth[1:] | smooth[:-1] | (run[1:] != run[:-1]))
    last = np.append(first[1:], True)
    head, tail = take(parts, first), take(parts, last)
    return msgspec.structs.replace(head, u1=tail.u1, s1=tail.s1)


def cubic_control(shape: TrackShape, piece: IntArray, u0: Array, u1: Array) -> Array:
    """Control points of parts of polynomial pieces of degree <= 3, as cubics.

    Parameters
    ----------
    shape : TrackShape
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
    return np.swapaxes(restrict(np.reshape(cubics, (-1, 2, 4))[row], u0[:, None], u1[:, None]), 1, 2)
