"""Tangents and curvatures at the ends of pieces, degenerate ends included.

Seen from an end P_0, let P_k be the first control point that lies elsewhere: the piece sets out along
a = P_k - P_0, like C(d, k) (w_k / w_0) a t^k. If P_j is the first that leaves this line, it bends away like
C(d, j) (w_j / w_0) P_j⊥ t^j, which is a curvature where j = 2k, infinite where j < 2k, and none where j > 2k.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.geometry.piece import Group, PieceSet
from ph_post.types import Array, IntArray

DEGENERATE: Final = 1e-8
"""Control points nearer than this part of the piece's size are one.

Told apart, they would govern a stretch of the square of this part, which is below rounding.
"""


def tangents(pieces: PieceSet, end: int) -> Array:
    """Compute unit tangents in the sense of the motion at end 0 or 1 of every piece, shape (pieces, dim)."""
    result = np.empty((len(pieces.pieces), pieces.dimension))
    for group in pieces.groups:
        result[group.index] = _arc_direction(group, end) if group.kind == "arc" else _first_ray(group, end)
    result /= np.sqrt(np.einsum("nd,nd->n", result, result))[:, None]
    return result


def _first_ray(group: Group, end: int) -> Array:
    """Direction of the motion, from or to the first control point that is not the end point."""
    control = (
        group.control if group.kind == "polynomial" else group.control[..., :-1] / group.control[..., -1:]
    )
    net = np.ascontiguousarray(
        control.transpose(1, 2, 0)
    )  # the pieces' number last: fast sums and comparisons
    rays = net[1:] - net[0] if end == 0 else net[-2::-1] - net[-1]
    squares = np.einsum("kdn,kdn->kn", rays, rays)
    first = np.argmax(squares > DEGENERATE**2 * squares.max(axis=0), axis=0)
    direction: Array = rays[0].T.copy()
    later = np.flatnonzero(first)
    direction[later] = rays[first[later], :, later]
    # Seen into the piece; at its last end the motion is the other way.
    return direction if end == 0 else -direction


def curvatures(pieces: PieceSet, end: int) -> Array:
    """Compute d²r/ds² [1/m] at end 0 or 1 of every piece, shape (pieces, dim), infinite where it grows so."""
    result = np.empty((len(pieces.pieces), pieces.dimension))
    for group in pieces.groups:
        bend = _arc_bend(group, end) if group.kind == "arc" else _bend(group, end)
        result[group.index] = bend
    return result


def _rays(group: Group, end: int) -> tuple[Array, Array]:
    """Control points seen from the end point, shape (d, m, dim), and weights w_0 … w_d, shape (d + 1, m)."""
    control = (group.control if end == 0 else group.control[:, ::-1]).transpose(1, 0, 2)
    if group.kind == "polynomial":
        return control[1:] - control[0], np.ones(control.shape[:2])
    points = control[..., :-1] / control[..., -1:]
    return points[1:] - points[0], control[..., -1]


def _first_away(rays: Array) -> IntArray:
    """Index of the first ray that is not zero."""
    squares = np.einsum("jnk,jnk->jn", rays, rays)
    first: IntArray = np.argmax(squares > DEGENERATE**2 * squares.max(axis=0), axis=0)
    return first


def _bend(group: Group, end: int) -> Array:
    rays, weights = _rays(group, end)
    first, degree = _first_away(rays), group.degree
    bend = np.zeros(rays.shape[1:])
    for k in np.unique(first).tolist():
        rows = np.flatnonzero(first == k)
        order = k + 1
        near = rays[: min(2 * order, degree), rows]
        size = np.linalg.norm(near[k], axis=1)[:, None]
        along = near[k] / size
        across = near - np.sum(near * along, axis=2, keepdims=True) * along
        if 2 * order <= degree:
            scale = 2.0 * math.comb(degree, 2 * order) / math.comb(degree, order) ** 2
            w = weights[:, rows, None]
            bend[rows] = scale * w[2 * order] * w[0] / (w[order] * size) ** 2 * across[2 * order - 1]
        early = np.linalg.norm(across[order : 2 * order - 1], axis=2) > DEGENERATE * size[:, 0]
        bend[rows[early.any(axis=0)]] = np.inf
    return bend


def _arc_direction(group: Group, end: int) -> Array:
    first, sweep = group.control[:, 1, 1], group.control[:, 2, 0]
    angle = first + end * sweep
    direction = np.zeros_like(group.control[:, 0])
    direction[:, 0], direction[:, 1] = -np.sin(angle) * sweep, np.cos(angle) * sweep
    return direction


def _arc_bend(group: Group, end: int) -> Array:
    radius, angle = group.control[:, 1, 0], group.control[:, 1, 1] + end * group.control[:, 2, 0]
    bend = np.zeros_like(group.control[:, 0])
    bend[:, 0], bend[:, 1] = -np.cos(angle) / radius, -np.sin(angle) / radius
    return bend
