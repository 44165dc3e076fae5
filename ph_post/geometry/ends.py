"""Tangents and curvatures at the ends of pieces, degenerate ends included.

Measured from its end and into the piece, a curve is r = r_0 + a t^k + …, k the order of the first derivative
that does not vanish: the direction is a. With b t^j the first term that departs from a's direction, the
distance along a is |a| t^k, so that the curve bends there like b⊥ (s/|a|)^(j/k): its curvature is
2 b⊥ / |a|² where j = 2k, infinite where j < 2k and zero where j > 2k.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.geometry.piece import Group, PieceSet, divide
from ph_post.types import Array, BoolArray

DEGENERATE: Final = 1e-8
"""A Taylor coefficient below this part of the largest one vanishes.

The stretch on which it would have its say is shorter than the square of this part of the piece.
"""


def tangents(pieces: PieceSet, end: int) -> Array:
    """Compute unit tangents in the sense of the motion at end 0 or 1 of every piece, shape (pieces, dim)."""
    result = np.empty((len(pieces.pieces), pieces.dimension))
    for group in pieces.groups:
        direction, plain = _first_step(group, end)
        rest = np.flatnonzero(~plain)
        if rest.size:
            part = Group(
                kind=group.kind, degree=group.degree, index=group.index[rest], control=group.control[rest]
            )
            terms = _taylor(part, end)
            direction[rest] = terms[_first_order(terms), np.arange(rest.size)]
        size = np.sqrt(np.einsum("nk,nk->n", direction, direction))[:, None]
        # Seen into the piece; at its last end the motion is the other way.
        result[group.index] = direction / size * (1.0 if end == 0 else -1.0)
    return result


def _first_step(group: Group, end: int) -> tuple[Array, BoolArray]:
    """First step of every control polygon, and where it is plainly the direction.

    No Taylor coefficient is larger than 3^d times the longest step, so that most need not be computed.
    """
    dimension = group.control.shape[2] - (group.kind == "rational")
    if group.kind != "polynomial":
        return np.zeros((group.index.size, dimension)), np.zeros(group.index.size, dtype=bool)
    # The pieces' number last: sums and comparisons then run along contiguous memory.
    steps = np.diff(np.ascontiguousarray(group.control.transpose(1, 2, 0)), axis=0)
    first = steps[0] if end == 0 else -steps[-1]
    largest = 3.0**group.degree * math.sqrt(dimension) * np.abs(steps).max(axis=(0, 1))
    return first.T.copy(), np.abs(first).max(axis=0) > DEGENERATE * largest


def curvatures(pieces: PieceSet, end: int) -> Array:
    """Compute d²r/ds² [1/m] at end 0 or 1 of every piece, shape (pieces, dim), infinite where it grows so."""
    result = np.zeros((len(pieces.pieces), pieces.dimension))
    for group in pieces.groups:
        terms = _taylor(group, end)
        order = _first_order(terms)
        rows = np.arange(order.size)
        direction = terms[order, rows]
        size = np.linalg.norm(direction, axis=1)
        along = direction / size[:, None]
        across = terms - np.einsum("jnk,nk->jn", terms, along)[..., None] * along
        second = np.minimum(2 * order, len(terms) - 1)
        bend = np.where((2 * order == second)[:, None], 2.0 * across[second, rows] / size[:, None] ** 2, 0.0)
        bend[_bends_early(across, order, size)] = np.inf
        result[group.index] = bend
    return result


def _bends_early(across: Array, order: Array, size: Array) -> Array:
    """Whether a term between the orders k and 2k departs from the direction."""
    j = np.arange(len(across))[:, None]
    between = (j > order) & (j < 2 * order)
    early: Array = np.any(between & (np.linalg.norm(across, axis=2) > DEGENERATE * size), axis=0)
    return early


def _first_order(terms: Array) -> Array:
    """Order of the first term that does not vanish, of those from 1 on."""
    sizes = np.linalg.norm(terms[1:], axis=2)
    order: Array = 1 + np.argmax(sizes > DEGENERATE * sizes.max(axis=0), axis=0)
    return order


def _taylor(group: Group, end: int) -> Array:
    """Taylor coefficients from an end into the pieces, shape (orders, n, dim)."""
    control = group.control if end == 0 else group.control[:, ::-1]
    if group.kind == "arc":
        return _arc_taylor(group.control, end)
    if group.kind == "polynomial":
        return _forward(control, group.degree)
    # Twice the degree: P / w has terms without end, and the curvature needs them up to 2k.
    terms = _forward(control, 2 * group.degree)
    factorials = np.array([math.factorial(k) for k in range(len(terms))], dtype=np.float64)[:, None, None]
    quotient: Array = divide(terms * factorials) / factorials
    return quotient


def _forward(control: Array, orders: int) -> Array:
    """Taylor coefficients C(d, k) Δ^k P_0 of Bernstein forms, shape (orders + 1, n, channels)."""
    degree = control.shape[1] - 1
    terms = np.zeros((orders + 1, control.shape[0], control.shape[2]))
    for k in range(degree + 1):
        terms[k] = math.comb(degree, k) * np.diff(control[:, : k + 1], n=k, axis=1)[:, 0]
    return terms


def _arc_taylor(control: Array, end: int) -> Array:
    radius, first, sweep = control[:, 1, 0], control[:, 1, 1], control[:, 2, 0]
    angle, sweep = (first, sweep) if end == 0 else (first + sweep, -sweep)
    terms = np.zeros((3, *control[:, 0].shape))
    radial = np.stack([np.cos(angle), np.sin(angle)], axis=1) * radius[:, None]
    terms[0, :, :2] = control[:, 0, :2] + radial
    terms[1, :, 0], terms[1, :, 1] = -radial[:, 1] * sweep, radial[:, 0] * sweep
    terms[2, :, :2] = -0.5 * radial * sweep[:, None] ** 2
    return terms
