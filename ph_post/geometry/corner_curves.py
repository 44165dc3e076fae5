"""Curves that replace the sharp corner between two sides: Pythagorean-hodograph quintics of continuous curvature.

In the plane of the corner, as complex numbers, a planar PH quintic has r' = w² with w quadratic, so that six real
numbers are free: as many as two tangents, two curvatures and the way from one end to the other ask for. With w₀, w₁, w₂
the Bernstein coefficients of w, the curvatures at the ends are

    κ₀ = 4 Im(w̄₀ w₁) / |w₀|⁴,    κ₁ = 4 Im(w̄₁ w₂) / |w₂|⁴.

Between straight sides both vanish, so w₁ is parallel to w₀ and to w₂: it is zero [1]_. Let the corner turn by 2φ, and
c = cos φ, s = sin φ, |w₀|² = |w₂|² = σ. The curve begins and ends σ (6c + 1) / (30 c) from the corner, and passes it at
the distance σ s (3c + 8) / (240 c). That is in its middle, where the curvature has its one maximum,
16 s / (σ cos⁴(φ/2)).

References
----------
.. [1] Farouki, Construction of rounded corners with Pythagorean-hodograph curves, Computer Aided Geometric Design 31
   (2014) 127-139.
"""

from __future__ import annotations

import cmath
import math
from typing import Final

import msgspec
import numpy as np

from ph_post.geometry.ph import PH, absolute_rotation
from ph_post.types import Array

STEPS: Final = 30
"""Newton steps at most for the speeds at the ends; five are usual."""

EXACT: Final = 1e-13
"""Part of the distance between the ends by which a curve may miss the second one."""

UNEVEN: Final = 4.0
"""How many times as large as between straight sides the speed at an end may be, or as small."""

MORE_TURN_RAD: Final = 0.25
"""How much more a curve may turn in all than its ends do [rad]: where it turns more it does not pass smoothly."""

FLAT: Final = 1e-9
"""Part of the distance between the ends by which they may lie outside of one plane with their tangents."""


class CurveEnd(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Place [m], unit tangent and d²r/ds² [1/m] of a side where a curve leaves or meets it, each of shape (dim,)."""

    place: Array
    tangent: Array
    bend: Array


def reach_of_deviation(angle: float, deviation: float) -> float:
    """Return how far from a corner of straight sides a curve begins and ends that passes it at a distance.

    Parameters
    ----------
    angle : float
        By which the corner turns [rad], between 0 and π.
    deviation : float
        Distance of the curve from the corner [m].

    Returns
    -------
    float
        Distance from the corner along either side [m].

    Examples
    --------
    >>> round(reach_of_deviation(math.pi / 2, 1.0), 6)
    5.860274
    """
    c, s = math.cos(0.5 * angle), math.sin(0.5 * angle)
    return 8.0 * deviation * (6.0 * c + 1.0) / (s * (3.0 * c + 8.0))


def corner_curve(first: CurveEnd, last: CurveEnd) -> PH | None:
    """Return the PH quintic between two ends that has their tangents and curvatures.

    Parameters
    ----------
    first, last : CurveEnd
        On the sides of a corner that turns by less than π.

    Returns
    -------
    PH or None
        None where the ends do not lie in one plane, or no such curve leads from one to the other without detours.

    Examples
    --------
    >>> none = np.zeros(2)
    >>> x, y = np.array([1.0, 0.0]), np.array([0.0, 1.0])
    >>> curve = corner_curve(
    ...     CurveEnd(place=-x, tangent=x, bend=none), CurveEnd(place=y, tangent=y, bend=none)
    ... )
    >>> curve.derivatives(1.0, 0).round(12).tolist()
    [[[0.0, 1.0]]]
    """
    frame = _frame(first.tangent, last.tangent)
    if frame is None:
        return None
    across = last.place - first.place
    vectors = np.stack([across, last.tangent, first.bend, last.bend])
    inside = vectors @ frame[:2].T
    sizes = np.array([1.0, np.linalg.norm(across), np.sum(across**2), np.sum(across**2)])
    left = np.linalg.norm(vectors - inside @ frame[:2], axis=1) * sizes
    if np.any(left > FLAT * np.linalg.norm(across)):
        return None
    way, turned, bend0, bend1 = (complex(x, y) for x, y in inside.tolist())
    w = _preimage(way, turned, bend0.imag, (turned.conjugate() * bend1).imag)
    if w is None:
        return None
    if first.place.size == 2:
        flipped = bool(np.linalg.det(frame) < 0.0)
        turn = cmath.sqrt(complex(*first.tangent.tolist()))
        plane = [turn * (one.conjugate() if flipped else one) for one in w]
        return PH(first.place, [[one.real, one.imag] for one in plane])
    return PH(first.place, _in_space(frame, w))


def _frame(t0: Array, t1: Array) -> Array | None:
    """Return as rows the first tangent, across it the way in which the path turns, and in space the normal of both."""
    across = t1 - (t1 @ t0) * t0
    size = float(np.linalg.norm(across))
    if size < FLAT:
        return None
    second = across / size
    return np.stack([t0, second] if t0.size == 2 else [t0, second, np.cross(t0, second)])


def _preimage(way: complex, turned: complex, bend0: float, bend1: float) -> tuple[complex, complex, complex] | None:
    """Find w with r' = w² from 0 to `way`, begun along 1 with the curvature `bend0`, ended along `turned`."""
    half = cmath.sqrt(turned)
    sine, cosine = half.imag, half.real
    even = math.sqrt(abs(way) / (0.4 * cosine + 1.0 / 15.0))
    speeds = np.full(2, even)
    for _ in range(STEPS):
        a, b = speeds.tolist()
        y = 0.25 * bend0 * a**3
        w0, w1, w2 = complex(a), complex((0.25 * bend1 * b**3 + y * cosine) / sine, y), b * half
        missed = (w0 * w0 + w0 * w1 + (2.0 * w1 * w1 + w0 * w2) / 3.0 + w1 * w2 + w2 * w2) / 5.0 - way
        if abs(missed) <= EXACT * abs(way):
            rotation = absolute_rotation((w0, w1, w2))
            return (w0, w1, w2) if rotation <= 2.0 * abs(cmath.phase(half)) + MORE_TURN_RAD else None
        to_w1 = 0.75 * bend0 * a * a * complex(cosine / sine, 1.0), complex(0.75 * bend1 * b * b / sine)
        middle = (w0 + 4.0 / 3.0 * w1 + w2) / 5.0
        by_a = (2.0 * w0 + w1 + w2 / 3.0) / 5.0 + middle * to_w1[0]
        by_b = (w0 / 3.0 + w1 + 2.0 * w2) / 5.0 * half + middle * to_w1[1]
        area = (by_a.conjugate() * by_b).imag
        if area == 0.0:
            return None
        speeds -= np.array([(missed.conjugate() * by_b).imag, -(missed.conjugate() * by_a).imag]) / area
        if not np.all((speeds > even / UNEVEN) & (speeds < even * UNEVEN)):
            return None
    return None


def _in_space(frame: Array, w: tuple[complex, complex, complex]) -> Array:
    """Return the preimage (3, 4) of a curve in the plane of a frame's first rows: Q (u + v k), Q the frame's turn."""
    q0, q1, q2, q3 = _quaternion(frame.T)
    rows = [(one.real, one.imag) for one in w]
    return np.array([(q0 * u - q3 * v, q1 * u + q2 * v, q2 * u - q1 * v, q3 * u + q0 * v) for u, v in rows])


def _quaternion(rotation: Array) -> tuple[float, float, float, float]:
    """Return the unit quaternion of a rotation matrix, from its largest component: no difference of like numbers."""
    r = rotation
    squares = np.array(
        [
            1.0 + r[0, 0] + r[1, 1] + r[2, 2],
            1.0 + r[0, 0] - r[1, 1] - r[2, 2],
            1.0 - r[0, 0] + r[1, 1] - r[2, 2],
            1.0 - r[0, 0] - r[1, 1] + r[2, 2],
        ]
    )
    table = np.array(
        [
            [squares[0], r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]],
            [r[2, 1] - r[1, 2], squares[1], r[1, 0] + r[0, 1], r[0, 2] + r[2, 0]],
            [r[0, 2] - r[2, 0], r[1, 0] + r[0, 1], squares[2], r[2, 1] + r[1, 2]],
            [r[1, 0] - r[0, 1], r[0, 2] + r[2, 0], r[2, 1] + r[1, 2], squares[3]],
        ]
    )
    row = table[int(np.argmax(squares))]
    w, x, y, z = (row / np.linalg.norm(row)).tolist()
    return w, x, y, z
