"""Turning points of a path.

An axis reverses where a stretch on which it rises and one on which it falls follow each other, with or
without a standstill between them. So an inflectional tangent is no turning point, a joint counts once, and a
corner counts where an axis changes its direction in it.
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.geometry import frenet
from ph_post.geometry.joints import SHARP_CORNER_RAD, joint_angles
from ph_post.geometry.reversals import (
    STILL,
    Reversals,
    StationaryPoints,
    find_reversals,
    find_stationary_points,
)
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, IntArray, TurningPoint, take

CANCELS: Final = 1e-11
"""A derivative of the curvature this small beside the terms it is the difference of is zero: an extremum."""


class _Shape(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Curvature, its arc-length derivatives, torsion and principal normal of some places, where `regular`."""

    regular: BoolArray
    curvature: Array
    curvature_dot: Array
    curvature_ddot: Array
    torsion: Array
    normal: Array


def find_turning_points(track: Track) -> tuple[TurningPoint, ...]:
    """Find every reversal of every axis of a path, ordered along it.

    Smooth ones are odd roots of a coordinate's derivative, or lie in a joint. At a `corner` the path turns by
    more than SHARP_CORNER_RAD, at a `cusp` its parametric speed vanishes; neither has an osculating circle.
    A `dwell` is where an axis that stood still moves back.

    Parameters
    ----------
    track : Track

    Returns
    -------
    tuple of TurningPoint

    Examples
    --------
    >>> from ph_post.geometry.curves import Bezier
    >>> curve = Bezier([[0.0, 0.0], [0.01, 0.02], [0.02, 0.0]])
    >>> [(p.axis, p.sense, p.xi, p.position) for p in find_turning_points(Track.from_curves([curve]))]
    [('Y', 'max', 0.5, 0.01)]
    """
    return turning_points(track, find_stationary_points(track))


def turning_points(track: Track, turns: StationaryPoints) -> tuple[TurningPoint, ...]:
    """Make the turning points of a path, given where its coordinates turn inside the pieces."""
    found = find_reversals(track, turns)
    if found.axis.size == 0:
        return ()
    sharp = np.zeros(len(track.pieces), dtype=bool)
    at_joint = found.u == 0.0
    if at_joint.any():
        angle = joint_angles(track)
        # Joint k lies before piece k + 1, the seam before piece 0; an open path's ends are no joints.
        sharp[(np.arange(angle.size) + 1) % sharp.size] = angle > SHARP_CORNER_RAD
    corner = at_joint & sharp[found.piece]
    return _records(track, found, corner, _shapes(track, found, corner))


def _shapes(track: Track, found: Reversals, corner: BoolArray) -> _Shape:
    """Curvature and what belongs to it: in a joint of its earlier side, after a dwell of the outgoing one.

    Where the speed vanishes on that side of a joint, the other one answers.
    """
    earlier = (found.u == 0.0) & ~found.dwell
    shape = _shape(track.derivatives(*_side(track, found, earlier), 4))
    other = np.flatnonzero((found.u == 0.0) & ~corner & ~shape.regular)
    if other.size:
        second = _shape(track.derivatives(*_side(track, take(found, other), ~earlier[other]), 4))
        for name in _Shape.__struct_fields__:
            getattr(shape, name)[other] = getattr(second, name)
    shape.regular[corner] = False
    return shape


def _side(track: Track, found: Reversals, earlier: BoolArray) -> tuple[IntArray, Array]:
    """Piece and u of the reversals, where `earlier` at the end of the piece before the joint."""
    piece = np.where(earlier, (found.piece - 1) % len(track.pieces), found.piece)
    return piece, np.where(earlier, 1.0, found.u)


def _shape(d: Array) -> _Shape:
    """Differential geometry from derivatives with respect to u, shape (5, n, dim)."""
    count, dimension = d.shape[1:]
    sizes = np.sqrt(np.einsum("knj,knj->kn", d, d))
    # The path turns on a radius of about σ² / |r''|: below STILL that is a cusp to any machine.
    regular = sizes[1] ** 2 > STILL * sizes[2]
    shape = _Shape(
        regular=regular,
        curvature=np.zeros(count),
        curvature_dot=np.zeros(count),
        curvature_ddot=np.zeros(count),
        torsion=np.zeros(count),
        normal=np.zeros((count, dimension)),
    )
    good = np.flatnonzero(regular)
    d, sizes = d[:, good], sizes[:, good]
    kappa, kappa_dot, kappa_ddot = frenet.curvatures(d)
    tau = frenet.torsion(d)
    m2, m3, m4 = (sizes[k] / sizes[1] ** k for k in (2, 3, 4))
    cubic, quartic = CANCELS * (m3 + 3.0 * m2**2), CANCELS * (m4 + 10.0 * m2 * m3 + 15.0 * m2**3)
    shape.curvature[good] = kappa + 0.0  # no negative zero
    shape.curvature_dot[good] = np.where(np.abs(kappa_dot) > cubic, kappa_dot, 0.0)
    shape.curvature_ddot[good] = np.where(np.abs(kappa_ddot) > quartic, kappa_ddot, 0.0)
    shape.torsion[good] = np.where(np.abs(kappa * tau) > cubic, tau, 0.0)
    shape.normal[good] = frenet.normal(d)
    return shape


def _records(track: Track, found: Reversals, corner: BoolArray, shape: _Shape) -> tuple[TurningPoint, ...]:
    """Make the records."""
    seam = (found.u == 0.0) & (found.piece == 0)
    segments, xis = track.to_xi(*_side(track, found, (found.u == 0.0) & ~seam))
    kinds = np.select([found.dwell, corner, ~shape.regular], ["dwell", "corner", "cusp"], "smooth")
    normal = shape.normal[np.arange(found.axis.size), found.axis]
    geometry = [shape.curvature, shape.curvature_dot, shape.curvature_ddot, shape.torsion, normal]
    columns: list[list[float | None]] = [column.tolist() for column in geometry]
    for row in np.flatnonzero(~shape.regular).tolist():
        for column in columns:
            column[row] = None
    points = [
        TurningPoint(
            index=index,
            kind=kind,
            segment=segment,
            xi=xi,
            axis=axis,
            sense=sense,
            position=position,
            s=s,
            curvature=kappa,
            curvature_dot=kappa_dot,
            curvature_ddot=kappa_ddot,
            torsion=tau,
            normal=n,
        )
        for index, kind, segment, xi, axis, sense, position, s, kappa, kappa_dot, kappa_ddot, tau, n in zip(
            range(found.axis.size),
            kinds.tolist(),
            segments.tolist(),
            xis.tolist(),
            np.array(track.path.axes)[found.axis].tolist(),
            np.where(found.rising, "min", "max").tolist(),
            found.position.tolist(),
            found.s.tolist(),
            *columns,
            strict=True,
        )
    ]
    return tuple(points)
