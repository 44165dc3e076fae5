"""Any NURBS as cubic Bézier pieces, which is what a G5 carries."""

from __future__ import annotations

from typing import Final

import numpy as np

from ph_post.errors import SolveError
from ph_post.geometry.bernstein import elevate, evaluate
from ph_post.geometry.curves import Bezier
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.piece import Piece, PieceSet
from ph_post.geometry.track import Track
from ph_post.types import Array
from ph_post.units import MICROMETRE

CLOSE: Final = 0.2 * MICROMETRE
"""How far a cubic may leave a rational curve or one of higher degree [m], a part of what a G5 is allowed."""

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
