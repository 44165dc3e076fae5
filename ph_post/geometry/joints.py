"""Tangents and curvatures at the ends of pieces, and the joints between pieces.

A joint is where one piece ends and the next begins; the seam of a closed path is the last one.

Seen from an end P_0, let P_k be the first control point that lies elsewhere: the piece sets out along
a = P_k - P_0, like C(d, k) (w_k / w_0) a t^k. If P_j is the first that leaves this line, it bends away like
C(d, j) (w_j / w_0) P_j⊥ t^j, which is a curvature where j = 2k, infinite where j < 2k, and none where j > 2k.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import msgspec
import numpy as np

from ph_post.geometry.piecewise import Group, PieceSet
from ph_post.types import Array, IntArray

if TYPE_CHECKING:
    from ph_post.geometry.track import Track


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
    control = group.control if group.kind == "polynomial" else group.control[..., :-1] / group.control[..., -1:]
    net = np.ascontiguousarray(control.transpose(1, 2, 0))  # the pieces' number last: fast sums and comparisons
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


SHARP_CORNER_RAD: Final = 1e-3
"""Angle above which a joint is a sharp corner, where the motion stops [rad].

Segments that should be tangent come from files with six or so digits: end points rounded to 1e-6 mm turn a
short chord of 1 mm by 1e-6 rad, and arcs fitted by CAD programs meet to about 1e-4 rad. Running through an
angle of 1e-3 rad at 100 mm/s asks for a velocity step of 0.1 mm/s, less than stopping is worth.
"""


class Joints(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Joints in the order of the path, the seam of a closed one last.

    `before`, `after` (n,) are piece numbers, `s` (n,) [m] their place (the seam's is the path's length),
    `angle` (n,) [rad] the angle between the tangents. `tangent_jump` (n, dim) and `curvature_jump` (n, dim)
    [1/m] are what dr/ds and d²r/ds² gain, infinite where the curvature is on either side.
    """

    before: IntArray
    after: IntArray
    s: Array
    angle: Array
    tangent_jump: Array
    curvature_jump: Array

    @property
    def sharp(self) -> IntArray:
        """Numbers of the joints that are sharp corners."""
        return np.flatnonzero(self.angle > SHARP_CORNER_RAD)


def find_joints(track: Track) -> Joints:
    """Compare every piece's end with the beginning of the next."""
    before, after = _neighbours(track)
    (first, last), (first_bend, last_bend) = track.tangents(), track.end_curvatures()
    bent, bend = last_bend[before], first_bend[after]
    infinite = ~(np.isfinite(bent) & np.isfinite(bend))
    curvature_jump = np.where(infinite, np.inf, np.where(infinite, 0.0, bend) - np.where(infinite, 0.0, bent))
    return Joints(
        before=before,
        after=after,
        s=track.starts[before + 1],
        angle=_angle(last[before], first[after]),
        tangent_jump=first[after] - last[before],
        curvature_jump=curvature_jump,
    )


def joint_angles(track: Track) -> Array:
    """Angles between the tangents [rad], the joints' only property that is wanted often."""
    before, after = _neighbours(track)
    first, last = track.tangents()
    return _angle(last[before], first[after])


def _neighbours(track: Track) -> tuple[IntArray, IntArray]:
    count = len(track.pieces)
    before = np.arange(count if track.closed else count - 1)
    return before, (before + 1) % count


def _angle(t0: Array, t1: Array) -> Array:
    """Half the angle has the sine |t1 - t0| / 2 and the cosine |t1 + t0| / 2: accurate at 0 and at π."""
    difference, total = t1 - t0, t1 + t0
    sine, cosine = (np.sqrt(np.einsum("nk,nk->n", v, v)) for v in (difference, total))
    angle: Array = 2.0 * np.arctan2(sine, cosine)
    return angle


def find_stops(track: Track) -> tuple[Array, Array, Array]:
    """Arc lengths [m] inside the path at which the motion has to stop.

    Returns
    -------
    corners, cusps, rapids : Array
        Sharp corners; joints at which the curvature is infinite; ends of rapid segments. Cusps inside pieces
        are turning points and known from there.
    """
    joints = find_joints(track)
    inside = joints.after != 0 if track.closed else np.ones(joints.s.size, dtype=bool)
    sharp = joints.angle > SHARP_CORNER_RAD
    infinite = ~np.all(np.isfinite(joints.curvature_jump), axis=1)
    rapid = np.array([segment.rapid for segment in track.path.segments])[track.segment]
    change = track.segment[joints.before] != track.segment[joints.after]
    ends = change & (rapid[joints.before] | rapid[joints.after])
    return joints.s[inside & sharp], joints.s[inside & infinite & ~sharp], joints.s[inside & ends & ~sharp]
