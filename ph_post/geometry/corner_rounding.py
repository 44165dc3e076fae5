"""Replace the sharp corners of a path by smooth curves within a tolerance, so that it can be run without stopping."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.geometry.bernstein import restrict
from ph_post.geometry.corner_curves import CurveEnd, corner_curve, reach_of_deviation
from ph_post.geometry.curves import Arc, Bezier, Composite, Line
from ph_post.geometry.joints import SHARP_CORNER_RAD, Joints, find_joints
from ph_post.geometry.numeric import polyline_distances
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.ph import PH
from ph_post.geometry.piecewise import Piece, PiecewiseCurve, polynomial_piece
from ph_post.geometry.track import Track
from ph_post.types import Array, Curve, Path, Segment, frozen

TURNS_BACK_RAD: Final = math.radians(175.0)
"""Angle from which a corner stays sharp: the curve around it would be as short as the tolerance, and as tight."""

FAIR: Final = 0.49
"""Part of a side that a curve may take at either of its ends, and more only of what the other one leaves."""

ROUGH: Final = 1.0 - 2e-3
"""Part of the tolerance that is aimed at between curved sides, where distances are taken at samples."""

ATTEMPTS: Final = 8
"""Sizes of a curve between curved sides that are tried."""

SAMPLES: Final = 129
"""Samples of a curve, and of each of the sides that it replaces."""

LEAST_REACH: Final = 1e-7
"""Shortest way [m] on a side that a curve may replace: beyond it places differ by more than their rounding."""


class CornerAt(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A sharp corner of a path, and what became of it.

    `place` (dim,) [m], `segment` the number of the segment that ends there, `angle` [rad] by which the path turns,
    `deviation` [m] the largest distance between the path and the curve, 0 where the corner stays sharp. `why` says why
    it does, or why the deviation is smaller than the tolerance.
    """

    place: Array
    segment: int
    angle: float
    deviation: float = 0.0
    why: str = ""


class CornerRounding(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A path with its corners rounded, and what became of each of them, in their order."""

    path: Path
    corners: tuple[CornerAt, ...]


class _Curve(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A curve around a corner, which begins and ends `reach` [m] from it, and leaves the sides by `deviation` [m]."""

    curve: PH
    reach: float
    deviation: float


def round_sharp_corners(path: Path, tolerance: float) -> CornerRounding:
    """Round the sharp corners of a path by PH quintics that meet its sides with their tangents and curvatures.

    Neither the path nor the curve has a point farther than the tolerance from the other. Where the sides are too short
    for that, the largest curve is taken that leaves half of each to the next corner. Corners stay sharp beside rapids,
    at the seam of a closed path, where the path turns back on itself, and where no such curve is found between curved
    sides.

    Parameters
    ----------
    path : Path
    tolerance : float
        Largest distance [m].

    Returns
    -------
    CornerRounding

    Examples
    --------
    >>> sides = [Line([[0, 0], [1, 0]]), Line([[1, 0], [1, 2]])]
    >>> found = round_sharp_corners(Track.from_curves(sides).path, 1e-3)
    >>> [one.curve.kind for one in found.path.segments], [round(one.deviation, 12) for one in found.corners]
    (['line', 'ph', 'line'], [0.001])
    """
    track = Track(path)
    joints = find_joints(track)
    sharp = joints.angle > SHARP_CORNER_RAD
    numbers = np.flatnonzero(sharp & (joints.after != 0)).tolist()
    if not numbers:
        return CornerRounding(path=path, corners=())
    rounder = _Rounder(track, joints, tolerance)
    whys = {k: rounder.reason(k) for k in numbers}
    reaches = rounder.reaches([k for k in numbers if not whys[k]])
    curves: dict[int, _Curve] = {}
    for k, reach in reaches.items():
        found = rounder.curve(k, reach)
        if isinstance(found, str):
            whys[k] = found
        else:
            curves[k] = found
            if found.deviation < 0.9 * tolerance:
                whys[k] = "its sides are short" if found.reach > 0.99 * reach else "no larger curve was found"
    corners = [
        CornerAt(
            place=frozen(rounder.corner(k)),
            segment=int(track.segment[joints.before[k]]),
            angle=float(joints.angle[k]),
            deviation=curves[k].deviation if k in curves else 0.0,
            why=whys[k],
        )
        for k in numbers
    ]
    return CornerRounding(path=_with_curves(track, joints, curves), corners=tuple(corners))


class _Rounder:
    """Finds the curves around the corners of one path."""

    def __init__(self, track: Track, joints: Joints, tolerance: float) -> None:
        self.track, self.joints, self.tolerance = track, joints, tolerance
        self._lengths = np.diff(track.starts)

    def corner(self, k: int) -> Array:
        """Return the place of a joint [m], shape (dim,)."""
        last = np.array([self.joints.before[k]])
        place: Array = self.track.derivatives(last, np.ones(1))[0, 0]
        return place

    def reason(self, k: int) -> str:
        """Say why a corner has to stay sharp, nothing where it need not."""
        segments = self.track.segment[[self.joints.before[k], self.joints.after[k]]]
        if any(self.track.path.segments[number].rapid for number in segments.tolist()):
            return "a rapid begins or ends there"
        if self.joints.angle[k] > TURNS_BACK_RAD:
            return "the path turns back on itself"
        return ""

    def reaches(self, corners: Sequence[int]) -> dict[int, float]:
        """Return how far each curve may reach along its sides [m]: as wanted, or what both of its sides have left."""
        wanted = {k: reach_of_deviation(float(self.joints.angle[k]), self.tolerance) for k in corners}
        at_start = {int(self.joints.after[k]): wanted[k] for k in corners}
        at_end = {int(self.joints.before[k]): wanted[k] for k in corners}

        def room(piece: int, other: float) -> float:
            length = float(self._lengths[piece])
            return max(FAIR * length, 2.0 * FAIR * length - other)

        return {
            k: min(
                reach,
                room(int(self.joints.before[k]), at_start.get(int(self.joints.before[k]), 0.0)),
                room(int(self.joints.after[k]), at_end.get(int(self.joints.after[k]), 0.0)),
            )
            for k, reach in wanted.items()
        }

    def curve(self, k: int, reach: float) -> _Curve | str:
        """Return the curve around a corner that reaches as far as it may within the tolerance, or why there is none."""
        if reach < LEAST_REACH:
            return "its sides are too short"
        if self._is_straight(int(self.joints.before[k])) and self._is_straight(int(self.joints.after[k])):
            curve = corner_curve(*self._ends(k, reach))
            share = reach / reach_of_deviation(float(self.joints.angle[k]), self.tolerance)
            none = "no curve of continuous curvature fits between its sides"
            return (
                none if curve is None else _Curve(curve=curve, reach=reach, deviation=self.tolerance * min(share, 1.0))
            )
        return self._between_curves(k, reach)

    def _between_curves(self, k: int, most: float) -> _Curve | str:
        """Try sizes until one is within the tolerance; sizes and deviations are nearly in proportion."""
        reach, best = most, None
        for _ in range(ATTEMPTS):
            curve = corner_curve(*self._ends(k, reach))
            if curve is None:
                if best is not None:
                    break
                reach *= 0.5
                continue
            off = self._deviation(k, reach, curve)
            if off <= self.tolerance * ROUGH and (best is None or reach > best.reach):
                best = _Curve(curve=curve, reach=reach, deviation=off)
            if best is not None and (best.deviation > 0.95 * self.tolerance or best.reach >= 0.999 * most):
                break
            reach = min(most, reach * ROUGH * self.tolerance / off)
            if reach < LEAST_REACH:
                break
        return best if best is not None else "no curve of continuous curvature was found between its sides"

    def _is_straight(self, piece: int) -> bool:
        one = self.track.pieces[piece]
        return one.kind == "polynomial" and len(one.control) == 2

    def _ends(self, k: int, reach: float) -> tuple[CurveEnd, CurveEnd]:
        """Return where a curve of some reach leaves the side before a corner, and meets the one behind it."""
        place = float(self.joints.s[k])
        pieces = self.joints.before[k], self.joints.after[k]
        found = []
        for piece, s in zip(pieces, (place - reach, place + reach), strict=True):
            jet = self.track.arc_derivatives(np.array([piece]), self._parameter(int(piece), s), 2)[:, 0]
            bend = np.zeros_like(jet[2]) if self._is_straight(int(piece)) else jet[2]
            found.append(CurveEnd(place=jet[0], tangent=jet[1] / np.linalg.norm(jet[1]), bend=bend))
        return found[0], found[1]

    def _parameter(self, piece: int, s: float | Array) -> Array:
        """Parameters of places [m] on a piece, shape (n,); what rounding has put on a neighbour is put back."""
        number, u = self.track.locate(np.atleast_1d(s))
        return np.where(number < piece, 0.0, np.where(number > piece, 1.0, u))

    def _deviation(self, k: int, reach: float, curve: PH) -> float:
        """Largest distance [m] between a curve and what it replaces, from either to the other."""
        place = float(self.joints.s[k])
        points = curve.derivatives(np.linspace(0.0, 1.0, SAMPLES))[0]
        sides = []
        for piece, first, last in (
            (int(self.joints.before[k]), place - reach, place),
            (int(self.joints.after[k]), place, place + reach),
        ):
            u = self._parameter(piece, np.linspace(first, last, SAMPLES))
            sides.append(self.track.derivatives(np.full(SAMPLES, piece), u)[0])
        to_sides = np.minimum(*(polyline_distances(points, side) for side in sides))
        return float(max(to_sides.max(), *(polyline_distances(side, points).max() for side in sides)))


def _with_curves(track: Track, joints: Joints, curves: dict[int, _Curve]) -> Path:
    """Cut the sides at the ends of curves, and put these between them, each at the lower feed of both."""
    begin = {int(joints.after[k]): (k, one) for k, one in curves.items()}
    end = {int(joints.before[k]): (k, one) for k, one in curves.items()}
    segments: list[Segment] = []
    firsts = np.flatnonzero(np.diff(track.segment, prepend=-1)).tolist()
    for number, (first, behind) in enumerate(zip(firsts, [*firsts[1:], len(track.pieces)], strict=True)):
        own = track.path.segments[number]
        starts = sorted({first, *(piece for piece in range(first, behind) if piece in begin)})
        for start, stop in zip(starts, [*starts[1:], behind], strict=True):
            low, high = begin.get(start), end.get(stop - 1)
            whole = len(starts) == 1 and low is None and high is None
            low_u = _cut(track, joints, low, start, 1.0) if low else 0.0
            high_u = _cut(track, joints, high, stop - 1, -1.0) if high else 1.0
            parts = [own.curve] if whole else _portion(own.curve, track.pieces[start:stop], low_u, high_u)
            segments += [msgspec.structs.replace(own, curve=part) for part in parts]
            if high is not None:
                next_one = track.path.segments[int(track.segment[joints.after[high[0]]])]
                segments.append(Segment(curve=high[1].curve, feed=_slower(track.path, own, next_one), rounded=True))
    return msgspec.structs.replace(track.path, segments=tuple(segments))


def _cut(track: Track, joints: Joints, at: tuple[int, _Curve], piece: int, sense: float) -> float:
    """Parameter of a piece at which a curve leaves or meets it."""
    number, u = track.locate(np.array([float(joints.s[at[0]]) + sense * at[1].reach]))
    return float(u[0]) if int(number[0]) == piece else 0.5 - 0.5 * sense


def _slower(path: Path, first: Segment, second: Segment) -> float | None:
    """Lower feed of two segments [m/s]; None where both have the path's."""
    if first.feed is None and second.feed is None:
        return None
    return min(path.feed if one.feed is None else one.feed for one in (first, second))


def _portion(curve: Curve, pieces: Sequence[Piece], low: float, high: float) -> list[PiecewiseCurve]:
    """Return the part of a curve on some of its pieces, from `low` on the first to `high` on the last of them."""
    single = len(pieces) == 1
    if isinstance(curve, Arc):
        center, radius, first, sweep = curve.center, curve.radius, curve.first_angle, curve.sweep
        ends = []
        for u in (low, high):
            point = center.copy()
            point[:2] += radius * np.array([math.cos(first + sweep * u), math.sin(first + sweep * u)])
            ends.append(point)
        return [Arc(ends[0], ends[1], center, curve.turn)]
    if isinstance(curve, PH):
        # r' of the part is shorter as its parameter is.
        preimage = math.sqrt(high - low) * restrict(curve.preimage.T, low, high)
        return [PH(curve.derivatives(low)[0, 0], np.ascontiguousarray(preimage.T))]
    cut = [(piece, low if k == 0 else 0.0, high if k == len(pieces) - 1 else 1.0) for k, piece in enumerate(pieces)]
    controls = [frozen(np.ascontiguousarray(restrict(piece.control.T, u0, u1).T)) for piece, u0, u1 in cut]
    if pieces[0].kind == "rational":
        return [_rational(control) for control in controls]
    if single:
        return [Line(controls[0]) if isinstance(curve, Line) else Bezier(controls[0])]
    at = [(piece.xi0 + u0 * (piece.xi1 - piece.xi0), piece.xi0 + u1 * (piece.xi1 - piece.xi0)) for piece, u0, u1 in cut]
    return [Composite([polynomial_piece(one, *xi) for one, xi in zip(controls, at, strict=True)])]


def _rational(control: Array) -> Nurbs:
    """Rational Bézier curve of homogeneous control points."""
    degree = len(control) - 1
    knots = np.repeat([0.0, 1.0], degree + 1)
    return Nurbs(degree, knots, control[:, :-1] / control[:, -1:], control[:, -1])
