"""Osculating circles of a path by arc length, and how far the path is from them.

A circle has two sides: the path before the point of contact and the path after it. Where the curvature jumps,
each side has a circle of its own.
"""

from __future__ import annotations

import msgspec
import numpy as np

from ph_post.geometry.stationary import STILL
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, IntArray


class Circles(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Osculating circles by arc length: `point` r, `tangent` dr/ds, `bend` d²r/ds² [1/m], shape (n, dim)."""

    point: Array
    tangent: Array
    bend: Array

    def take(self, which: IntArray) -> Circles:
        """Choose some of them."""
        return Circles(point=self.point[which], tangent=self.tangent[which], bend=self.bend[which])

    def at(self, s: Array) -> Array:
        """Points at arc lengths `s` [m], shape (n, k), from where they touch; shape (n, k, dim) [m]."""
        half = 0.5 * np.sqrt(np.einsum("nd,nd->n", self.bend, self.bend))[:, None] * s
        # r + t sin(κs)/κ + n (1 - cos(κs))/κ, in a form that holds for κ = 0.
        chord = s * np.divide(np.sin(half), half, out=np.ones_like(half), where=half != 0.0)
        along, across = chord * np.cos(half), 0.5 * chord**2
        points = np.empty((*s.shape, self.point.shape[1]))
        for axis in range(points.shape[2]):
            points[..., axis] = along * self.tangent[:, axis, None] + across * self.bend[:, axis, None]
            points[..., axis] += self.point[:, axis, None]
        return points


def touching_circles(track: Track, s: Array, xi: Array) -> Circles:
    """Osculating circles of the path before all places, and then those of the path after them.

    A side on which the parametric speed vanishes borrows the other's.

    Parameters
    ----------
    track : Track
    s, xi : Array, shape (n,)
        Places, by arc length [m] and, exactly, by their segments' parameter.
    """
    count = len(track.pieces)
    piece = np.clip(np.searchsorted(track.starts, s, side="right") - 1, 0, count - 1)
    joint = np.flatnonzero(track.starts[piece] == s)
    u = np.clip((xi - track.xi0[piece]) / (track.xi1[piece] - track.xi0[piece]), 0.0, 1.0)
    u[joint] = 0.0
    after, regular = _circles(track, piece, u)
    both = after.take(np.tile(np.arange(s.size), 2))
    if joint.size:
        before, fine = _circles(track, (piece[joint] - 1) % count, np.ones(joint.size))
        _assign(both, joint[fine], before.take(np.flatnonzero(fine)))
        lost = np.flatnonzero(~regular[joint])
        _assign(both, s.size + joint[lost], before.take(lost))
    return both


def _circles(track: Track, piece: IntArray, u: Array) -> tuple[Circles, BoolArray]:
    """Osculating circles, and where there is one: where the parametric speed does not vanish."""
    point, d1, d2 = track.derivatives(piece, u, 2)
    square = np.einsum("nd,nd->n", d1, d1)
    regular: BoolArray = square > STILL * np.sqrt(np.einsum("nd,nd->n", d2, d2))
    square = np.where(regular, square, 1.0)[:, None]
    tangent = d1 / np.sqrt(square)
    bend = (d2 - np.einsum("nd,nd->n", d2, tangent)[:, None] * tangent) / square
    return Circles(point=point, tangent=tangent, bend=bend), regular


def _assign(circles: Circles, where: IntArray, values: Circles) -> None:
    for name in Circles.__struct_fields__:
        getattr(circles, name)[where] = getattr(values, name)


class Sides(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Both sides of n places, first all sides before, then all after: circles, `s` [m], directions (±1)."""

    track: Track
    circles: Circles
    s: Array
    direction: Array

    def deviation(self, side: IntArray, distance: Array) -> Array:
        """|r(s) - c(s)| [m] at distances (n, k) outward on the given sides (n,), shape (n, k)."""
        offset = self.direction[side, None] * distance
        s = self.s[side, None] + offset
        if self.track.closed:
            s = s % self.track.length
        piece, u = self.track.locate(s.ravel())
        gap = self.track.derivatives(piece, u)[0].reshape(*s.shape, -1)
        gap -= self.circles.take(side).at(offset)
        deviation: Array = np.sqrt(np.einsum("nkd,nkd->nk", gap, gap))
        return deviation

    def deviation_at(self, number: IntArray, piece: IntArray, u: Array) -> tuple[Array, Array]:
        """Distances (n,) from the places numbered `number` and |r(s) - c(s)| there [m].

        Pieces of a closed path are counted on beyond its ends, as by :func:`unrolled_piece`.
        """
        track = self.track
        turn, piece = np.divmod(piece, len(track.pieces))
        offset = track.arc_length(piece, u) + turn * track.length - self.s[number]
        side = number + np.where(offset > 0.0, self.s.size // 2, 0)
        gap = track.derivatives(piece, u)[0] - self.circles.take(side).at(offset[:, None])[:, 0]
        return offset, np.sqrt(np.einsum("nd,nd->n", gap, gap))


def sides_of(track: Track, s: Array, xi: Array) -> Sides:
    """Both sides of some places; see :func:`touching_circles`."""
    circles = touching_circles(track, s, xi)
    return Sides(track=track, circles=circles, s=np.tile(s, 2), direction=np.repeat([-1.0, 1.0], s.size))


def unrolled_piece(track: Track, s: Array) -> IntArray:
    """Piece at arc length `s` [m]; on a closed path counted on beyond its ends, elsewhere clipped."""
    turn = np.floor(s / track.length).astype(np.int64) if track.closed else np.zeros(s.size, dtype=np.int64)
    piece: IntArray = np.searchsorted(track.starts[1:-1], s - turn * track.length, side="right")
    return piece + turn * len(track.pieces)
