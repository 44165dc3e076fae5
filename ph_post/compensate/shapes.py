"""Shapes of feed profiles: mean, length, extremes, softening and cutting in two.

A shape is V / V_c, the feed relative to the one around the profile, over τ in [0, 1], in Bernstein form.
:mod:`ph_post.compensate.profile` makes shapes.

References
----------
.. [1] Real-time compensation of backlash positional errors in CNC machines by localized feedrate
   modulation, Int. J. Adv. Manuf. Technol. 119 (2022), doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate

import msgspec
import numpy as np
from numpy.typing import ArrayLike

from ph_post.geometry.bernstein import evaluate, integrate, lowest_value, subdivide, value_rounding
from ph_post.geometry.numeric import bisect
from ph_post.types import Array, IntArray, ProfilePiece, ProfileShape, frozen


def single(coefficients: ArrayLike) -> ProfileShape:
    """Eq. (26) of [1]_ with these V_k / V_c, as a shape of one piece."""
    return ProfileShape(pieces=(ProfilePiece(share=1.0, coefficients=frozen(coefficients)),))


def soften(shape: ProfileShape, amount: float) -> ProfileShape:
    """Move a shape towards constant feed: 0 leaves it, 1 gives V = V_c."""
    if amount == 0.0:
        return shape

    def softened(piece: ProfilePiece) -> ProfilePiece:
        values = 1.0 - (1.0 - amount) * (1.0 - piece.coefficients)
        return msgspec.structs.replace(piece, coefficients=frozen(values))

    return ProfileShape(pieces=tuple(map(softened, shape.pieces)))


def mean(shape: ProfileShape) -> float:
    """Mean of V / V_c over the profile; of one piece the sum of the coefficients over n + 1."""
    return math.fsum(_ways(shape))


def _ways(shape: ProfileShape) -> list[float]:
    """Way of every piece, in units of V_c times the whole duration."""
    return [piece.share * (math.fsum(piece.coefficients) / piece.coefficients.size) for piece in shape.pieces]


def value(shape: ProfileShape, tau: Array) -> Array:
    """V / V_c at `tau` (n,) in [0, 1]; at a junction that of the later piece."""
    number, local = _located(shape, tau)
    values = np.empty(local.size)
    for k, piece in enumerate(shape.pieces):
        here = number == k
        values[here] = evaluate(piece.coefficients, local[here])
    return values


def slope(shape: ProfileShape, tau: Array) -> Array:
    """Return the derivative of V / V_c with respect to τ, by Eq. (25) of [1]_."""
    number, local = _located(shape, tau)
    values = np.zeros(local.size)
    for k, piece in enumerate(shape.pieces):
        n, here = piece.coefficients.size - 1, number == k
        if n > 0:
            values[here] = evaluate(n * np.diff(piece.coefficients), local[here]) / piece.share
    return values


def way(shape: ProfileShape, tau: Array) -> Array:
    """∫ V / V_c from 0 to `tau` (n,)."""
    number, local = _located(shape, tau)
    begins = [0.0, *accumulate(_ways(shape))]
    values = np.empty(local.size)
    for k, piece in enumerate(shape.pieces):
        here = number == k
        inside = evaluate(distance_coefficients(piece.coefficients), local[here])
        values[here] = begins[k] + piece.share * inside
    return values


def share_of_way(shape: ProfileShape, tau: float) -> float:
    """Share of a shape's way that lies before the instant τ.

    Examples
    --------
    >>> share_of_way(single([0.0, 1.0]), 0.5)
    0.25
    """
    return float(way(shape, np.array([tau]))[0]) / mean(shape)


def _located(shape: ProfileShape, tau: Array) -> tuple[IntArray, Array]:
    """ProfilePiece at every instant, and the instant on its own [0, 1]."""
    shares = np.array([piece.share for piece in shape.pieces])
    begins = np.concatenate([[0.0], np.cumsum(shares)[:-1]])
    number = np.clip(np.searchsorted(begins, tau, side="right") - 1, 0, shares.size - 1)
    return number, np.clip((tau - begins[number]) / shares[number], 0.0, 1.0)


def middle_ratio(shape: ProfileShape) -> float:
    """V(½) / V_c."""
    return float(value(shape, np.array([0.5]))[0])


def reported_ratio(shape: ProfileShape) -> float:
    """Depth of a shape: V(½) / V_c of one piece, the lowest V / V_c of several."""
    return middle_ratio(shape) if len(shape.pieces) == 1 else lowest(shape)


def half_length(shape: ProfileShape, cruise: float, t_star: float) -> float:
    """s_star [m], half the length of path that a profile takes.

    Implements Eq. (27) of [1]_.

    Examples
    --------
    >>> half_length(single([1.0, 1.0, -1.5, 1.0, 1.0]), cruise=0.1, t_star=2.0)
    0.1
    """
    return mean(shape) * cruise * t_star


def half_duration(shape: ProfileShape, cruise: float, s_star: float) -> float:
    """t_star [s] for a given s_star [m]: Eq. (27) of [1]_ the other way round."""
    return s_star / (mean(shape) * cruise)


def distance_coefficients(coefficients: Array) -> Array:
    """S_0 … S_{n+1} of S(τ) = ∫ V dτ over one piece, which vanishes at τ = 0.

    Implements Eq. (28) of [1]_.
    """
    # ERRATA: Eq. (28) prints (1 - τ)^(n-k); a basis of degree n + 1 has the exponent n + 1 - k.
    return integrate(coefficients)


def split(shape: ProfileShape, share: float, slack: float) -> tuple[ProfileShape, ProfileShape]:
    """Cut a shape where it has covered that `share` of its way, in (0, 1).

    A hold that begins within `slack` of there stays whole, in the second part. Only for V >= 0 there is one
    such place.
    """
    ways = _ways(shape)
    whole, before = math.fsum(ways), 0.0
    for number, (piece, covered) in enumerate(zip(shape.pieces, ways, strict=True)):
        hold = not np.any(piece.coefficients)
        if hold and abs(before - share * whole) <= slack * whole:
            return _cut(shape, number, 0.0)
        if before + covered > (share + slack) * whole:
            break
        before += covered
    way_left = (share * whole - before) / shape.pieces[number].share
    way_so_far = distance_coefficients(shape.pieces[number].coefficients)
    low, high = bisect(lambda tau: float(evaluate(way_so_far, tau)) < way_left, 0.0, 1.0)
    return _cut(shape, number, 0.5 * (low + high))


def _cut(shape: ProfileShape, number: int, tau: float) -> tuple[ProfileShape, ProfileShape]:
    """Cut piece `number` at `tau` of its own; what has no duration is left out."""
    piece = shape.pieces[number]
    left, right = subdivide(piece.coefficients, tau)
    first = [*shape.pieces[:number], ProfilePiece(share=tau * piece.share, coefficients=frozen(left))]
    rest = [
        ProfilePiece(share=(1.0 - tau) * piece.share, coefficients=frozen(right)),
        *shape.pieces[number + 1 :],
    ]
    return _whole(first), _whole(rest)


def _whole(pieces: Sequence[ProfilePiece]) -> ProfileShape:
    """Make a shape of pieces whose shares do not add up to 1."""
    total = math.fsum(piece.share for piece in pieces)
    kept = (piece for piece in pieces if piece.share > 0.0)
    return ProfileShape(pieces=tuple(msgspec.structs.replace(piece, share=piece.share / total) for piece in kept))


def lowest(shape: ProfileShape) -> float:
    """Smallest value of V / V_c, to rounding.

    Examples
    --------
    >>> lowest(single([1.0, 1.0, -1.0, 1.0, 1.0]))
    0.25
    """
    return min(lowest_value(piece.coefficients) for piece in shape.pieces)


def extremes(shape: ProfileShape) -> tuple[float, float]:
    """Smallest and largest value of V / V_c, to rounding.

    Examples
    --------
    >>> extremes(single([1.0, 1.0, -1.0, 1.0, 1.0]))
    (0.25, 1.0)
    """
    return lowest(shape), -min(lowest_value(-piece.coefficients) for piece in shape.pieces)


def is_non_negative(shape: ProfileShape) -> bool:
    """Return whether V >= 0 on the whole profile, but for rounding in the last digits.

    A look at the coefficients alone would be too strict: V_{n/2} may be far below 0 while V is not.
    """
    return lowest(shape) >= -rounding(shape)


def rounding(shape: ProfileShape) -> float:
    """Bound of the rounding error of a value of V / V_c."""
    return max(value_rounding(piece.coefficients) for piece in shape.pieces)
