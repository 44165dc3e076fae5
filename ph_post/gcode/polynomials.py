"""Parts of pieces as polynomials of a parameter that runs from 0 to 1 over a block.

A polynomial piece is written by its power coefficients, a rational one as a quotient: coefficients of the
numerators and of the denominator they share, which is 1 at the beginning of the block.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from ph_post.gcode.format import to_grid
from ph_post.gcode.record import Blocks
from ph_post.gcode.shape import POLYNOMIAL, Shape
from ph_post.geometry.bernstein import subdivide, to_power
from ph_post.types import Array, IntArray
from ph_post.units import MM

DENOMINATOR_DECIMALS: Final = 14
"""Decimals of the coefficients of denominators, which are about 1: half of the last one moves a point at
1000 mm by 5e-12 mm."""


def polynomial_words(
    blocks: Blocks, shape: Shape, piece: IntArray, offset: Array, decimals: int
) -> dict[int, IntArray]:
    """Coefficients of all blocks that are polynomials, by their number.

    Parameters
    ----------
    blocks : Blocks
    shape : Shape
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
    u0, u1 = shape.local(of, blocks.s0[rows]), shape.local(of, blocks.s1[rows])
    found: dict[int, IntArray] = {}
    for row, number, low, high in zip(rows.tolist(), of.tolist(), u0.tolist(), u1.tolist(), strict=True):
        one = shape.track.pieces[number]
        part = restricted(one.control.T, low, high)
        if one.kind == "rational":
            found[row] = _quotient(part, offset[row], decimals)
        else:
            found[row] = to_grid(to_power(part)[:, 2:], decimals)
    return found


def restricted(net: Array, u0: float, u1: float) -> Array:
    """Bernstein coefficients on the part from `u0` to `u1`, backwards where `u1` is the smaller one.

    Examples
    --------
    >>> restricted(np.array([[0.0, 0.0, 1.0]]), 1.0, 0.5).tolist()
    [[1.0, 0.5, 0.25]]
    """
    low, high = min(u0, u1), max(u0, u1)
    right = subdivide(net, low)[1] if low > 0.0 else net
    part = subdivide(right, (high - low) / (1.0 - low))[0] if high < 1.0 else right
    return part if u0 <= u1 else part[..., ::-1]


def _quotient(net: Array, offset: Array, decimals: int) -> IntArray:
    """Numerators and denominator of homogeneous coefficients (w P, w), the weight at the start being 1."""
    scaled = net / net[-1, 0]
    scaled[:-1] += offset[:, None] * scaled[-1]
    power = to_power(scaled)
    above = to_grid(power[:-1, 2:], decimals)
    below = to_grid(np.append(scaled[-1, -1], power[-1, 2:]) * MM, DENOMINATOR_DECIMALS)
    return np.vstack([np.pad(above, ((0, 0), (1, 0))), below])
