"""Curves of single motions (arcs in any plane, helices, cubics, NURBS), and small corners between them rounded.

CAM programs join arcs and lines that are not quite tangent, by as much as some hundredths of a radian. A
planner of sharp corners would rest there; no controller does. The path is known to a tolerance only, and
within it the corner is a smooth bend.
"""

from __future__ import annotations

import math
from typing import Final, Literal

import msgspec
import numpy as np

from ph_post.gcode.program import ARC, CUBIC, NURBS, PLANE_AXES, Motions
from ph_post.geometry.bernstein import subdivide
from ph_post.geometry.curves import Arc, Bezier, Composite, Line
from ph_post.geometry.joints import SHARP_CORNER_RAD, Joints, find_joints
from ph_post.geometry.nurbs import Nurbs
from ph_post.geometry.piecewise import MEETS, Piece, PiecewiseCurve, polynomial_piece
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, Curve, IntArray, Segment, frozen

SPAN: Final = 0.25
"""Angle [rad] of one quintic of a helix: it leaves the helix by its radius times 5e-9, the sixth power of
the angle over 6! 2^6, and 1 nm on a radius of 200 mm."""

MOVED: Final = 2.0
"""How many times the difference of its radii the centre of an arc may be moved, along the chord, so that
they agree; where that is not enough, nearly a full turn, the radius changes along the arc."""


def curves_of(motions: Motions, number: int, columns: tuple[int, ...]) -> list[PiecewiseCurve]:
    """Return the curves of one motion that goes somewhere, in the axes whose columns are named.

    Arcs are exact where they lie in the plane of the path's first two axes, cubics and NURBS always; helices
    and arcs in other planes are quintics (see SPAN). An axis that is nowhere known does not move, and is
    taken to be at zero.
    """
    kind = int(motions.kind[number])
    if kind == CUBIC:
        return [Bezier(np.nan_to_num(motions.control[number][:, columns]))]
    if kind == NURBS:
        order, control, weights = motions.nurbs[number]
        return [Nurbs(order - 1, _knots(order, len(control)), np.nan_to_num(control[:, columns]), weights)]
    if kind == ARC:
        return _arc(motions, number, columns)
    return [Line(np.nan_to_num([motions.start[number, columns], motions.end[number, columns]]))]


def _knots(order: int, count: int) -> Array:
    """Clamped and uniform, as LinuxCNC evaluates G5.2."""
    inner = np.arange(count - order + 2, dtype=np.float64)
    return np.concatenate([np.zeros(order - 1), inner, np.full(order - 1, inner[-1])])


def _arc(motions: Motions, number: int, columns: tuple[int, ...]) -> list[PiecewiseCurve]:
    first, second, _ = PLANE_AXES[int(motions.plane[number])]
    start, end = (np.nan_to_num(place[number, columns]) for place in (motions.start, motions.end))
    angle = float(motions.angle[number])
    flat = set(columns[:2]) == {first, second} and float(np.abs((end - start)[2:]).sum()) == 0.0
    center = _center(motions, number) if flat else None
    if center is None:
        return [_helix(motions, number, columns)]
    place = {first: center[0], second: center[1]}
    middle = start.copy()
    middle[:2] = [place[axis] for axis in columns[:2]]
    counted = angle if columns[:2] == (first, second) else -angle
    turn: Literal["ccw", "cw"] = "ccw" if counted > 0.0 else "cw"
    closed = float(np.linalg.norm(end - start)) <= MEETS
    rounds = round(abs(angle) / math.tau) if closed else math.floor(abs(angle) / math.tau)
    whole: list[PiecewiseCurve] = [Arc(start, start, middle, turn) for _ in range(rounds)]
    return whole if closed else [*whole, Arc(start, end, middle, turn)]


def _center(motions: Motions, number: int) -> Array | None:
    """Centre from which both ends are equally far, None where the given one is not near to such a place."""
    first, second, _ = PLANE_AXES[int(motions.plane[number])]
    start, end = motions.start[number, [first, second]], motions.end[number, [first, second]]
    center, chord = motions.center[number], end - start
    size = float(np.linalg.norm(chord))
    if size <= MEETS:
        return np.asarray(center)
    along = chord / size
    off = float(along @ (0.5 * (start + end) - center))
    radii = abs(float(np.linalg.norm(start - center) - np.linalg.norm(end - center)))
    return np.asarray(center + off * along) if abs(off) <= MOVED * radii + MEETS else None


def _helix(motions: Motions, number: int, columns: tuple[int, ...]) -> Composite:
    """Quintics with the places, first and second derivatives of a helix whose radius may change."""
    first, second, third = PLANE_AXES[int(motions.plane[number])]
    start, end = np.nan_to_num(motions.start[number]), np.nan_to_num(motions.end[number])
    center, angle = motions.center[number], float(motions.angle[number])
    ray, last = start[[first, second]] - center, end[[first, second]] - center
    radius, grows = math.hypot(*ray), math.hypot(*last) - math.hypot(*ray)
    count = max(1, math.ceil(abs(angle) / SPAN))
    share = np.linspace(0.0, 1.0, count + 1)
    turned = np.exp(1j * (math.atan2(ray[1], ray[0]) + angle * share))
    rate = 1j * angle
    flat = (radius + grows * share) * turned
    slope = (grows + rate * (radius + grows * share)) * turned
    bend = (2.0 * rate * grows + rate * rate * (radius + grows * share)) * turned
    jet = np.zeros((3, count + 1, 3))
    for order, values in enumerate((flat + complex(*center), slope, bend)):
        jet[order, :, first], jet[order, :, second] = values.real, values.imag
    jet[0, :, third] = start[third] + (end - start)[third] * share
    jet[1, :, third] = (end - start)[third]
    control = _quintics(jet[:, :, columns], 1.0 / count)
    control[0, 0], control[-1, -1] = start[list(columns)], end[list(columns)]
    return Composite([polynomial_piece(frozen(one), share[k], share[k + 1]) for k, one in enumerate(control)])


def _quintics(jet: Array, step: float) -> Array:
    """Control points (m, 6, dim) with the jets (3, m + 1, dim) of place, first and second derivative."""
    first, second = step / 5.0 * jet[1], step * step / 20.0 * jet[2]
    before = [jet[0], jet[0] + first, jet[0] + 2.0 * first + second]
    after = [jet[0] - 2.0 * first + second, jet[0] - first, jet[0]]
    return np.stack([*(one[:-1] for one in before), *(one[1:] for one in after)], axis=1)


SMALL_CORNER_RAD: Final = 0.1
"""Angle [rad] up to which a corner is rounded. At 10 mm/s the speed of an axis changes there by 1 mm/s at
most, which a drive does in one or two periods of a controller."""

SHARE: Final = 0.25
"""Part of the motions and pieces on either side that a bend takes at most."""


class Rounded(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Segments with the bends between them, and the new arc lengths [m] of the places asked for."""

    segments: tuple[Segment, ...]
    s: Array


def round_corners(track: Track, s: Array, marked: BoolArray, tolerance: float) -> Rounded:
    """Round small corners between segments.

    A bend is a quintic that has the tangents and curvatures of both sides at its ends, equally far before and
    behind the corner. A corner of angle θ lies θ d / 4 at most off a bend of half length d, a jump Δ of the
    curvature moves it by no more than Δ d² / 16.

    Parameters
    ----------
    track : Track
    s : Array, shape (k,)
        Arc lengths of ends of motions [m], in order, both ends of the path among them.
    marked : BoolArray, shape (segments,)
        Segments that may be shortened; of these, arcs and composites are.
    tolerance : float
        How far a bend may be off the corner [m].

    Returns
    -------
    Rounded
    """
    joints = find_joints(track)
    half = _half_lengths(track, joints, s, marked, tolerance)
    chosen = np.flatnonzero(half > 0.0)
    if not chosen.size:
        return Rounded(segments=track.path.segments, s=s)
    bends = [_bend(track, float(joints.s[k]), float(half[k])) for k in chosen.tolist()]
    segments = _with_bends(track, track.segment[joints.before[chosen]], half[chosen], bends)
    shorter = 2.0 * half[chosen] - np.array([bend.length for bend in bends])
    corner = joints.s[chosen]
    before = np.concatenate([[0.0], np.cumsum(shorter)])
    passed, reached = (np.searchsorted(corner, s + off) for off in (-MEETS, MEETS))
    return Rounded(segments=segments, s=s - 0.5 * (before[passed] + before[reached]))


def _half_lengths(track: Track, joints: Joints, s: Array, marked: BoolArray, tolerance: float) -> Array:
    """Half lengths of bends [m] by joint, 0 where there is none."""
    before, after = track.segment[joints.before], track.segment[joints.after]
    known = marked & np.array([isinstance(one.curve, Arc | Composite) for one in track.path.segments])
    small = (joints.angle > SHARP_CORNER_RAD) & (joints.angle <= SMALL_CORNER_RAD)
    right = small & (before != after) & known[before] & known[after]
    half = np.zeros(joints.s.size)
    for k in np.flatnonzero(right).tolist():
        place = float(joints.s[k])
        low, high = np.searchsorted(s, [place - MEETS, place + MEETS])
        if not 0 < low < high < s.size:
            continue
        jump = float(np.linalg.norm(joints.curvature_jump[k]))
        pieces = np.diff(track.starts)[[joints.before[k], joints.after[k]]]
        room = SHARE * min(place - float(s[low - 1]), float(s[high]) - place, float(pieces.min()))
        half[k] = min(room, 2.0 * tolerance / float(joints.angle[k]), np.sqrt(8.0 * tolerance / max(jump, 1.0)))
    # What is shorter is a point, of which no curve is made.
    return np.where(half > 2.0 * MEETS, half, 0.0)


def _bend(track: Track, s: float, half: float) -> Composite:
    """Quintic from `half` [m] before a place to as far behind it."""
    jet = track.arc_derivatives(*track.locate(np.array([s - half, s + half])), 2)
    chord = float(np.linalg.norm(jet[0, 1] - jet[0, 0]))
    return Composite([polynomial_piece(frozen(_quintics(jet, chord)[0]), 0.0, 1.0)])


def _with_bends(track: Track, number: IntArray, half: Array, bends: list[Composite]) -> tuple[Segment, ...]:
    """Shorten segments for the bends behind those of some numbers, and put these between them."""
    segments = list(track.path.segments)
    behind: dict[int, list[Segment]] = {}
    for k, size, bend in zip(number.tolist(), half.tolist(), bends, strict=True):
        here, there = segments[k], segments[k + 1]
        behind[k] = _shared(bend, here, there)
        (piece,) = bend.pieces
        segments[k] = msgspec.structs.replace(here, curve=_shortened(here.curve, size, piece.control[0], 1))
        segments[k + 1] = msgspec.structs.replace(there, curve=_shortened(there.curve, size, piece.control[-1], 0))
    return tuple(one for k, own in enumerate(segments) for one in (own, *behind.get(k, ())))


def _shared(bend: Composite, here: Segment, there: Segment) -> list[Segment]:
    """Bend in the feed of its neighbours, a half each where they differ."""
    if here.feed == there.feed:
        return [msgspec.structs.replace(here, curve=bend)]
    halves = subdivide(bend.pieces[0].control.T)
    return [
        msgspec.structs.replace(
            own, curve=Composite([polynomial_piece(frozen(np.ascontiguousarray(control.T)), 0.0, 1.0)])
        )
        for own, control in zip((here, there), halves, strict=True)
    ]


def _shortened(curve: Curve, size: float, place: Array, end: int) -> Curve:
    """Take `size` [m] off a curve at its beginning (0) or end (1), so that it begins or ends at a place."""
    if isinstance(curve, Arc):
        ends = (curve.start, place) if end else (place, curve.end)
        return Arc(*ends, curve.center, curve.turn)
    if not isinstance(curve, Composite):
        raise TypeError(f"cannot shorten {type(curve).__name__}")
    pieces = list(curve.pieces)
    k = -1 if end else 0
    pieces[k] = _cut(curve, pieces[k], size, end)
    return Composite(pieces)


def _cut(curve: Composite, piece: Piece, size: float, end: int) -> Piece:
    where = curve.length - size if end else size
    xi = float(curve.parameter(where)[0])
    at = (xi - piece.xi0) / (piece.xi1 - piece.xi0)
    control = frozen(np.ascontiguousarray(subdivide(piece.control.T, at)[1 - end].T))
    low, high = (piece.xi0, xi) if end else (xi, piece.xi1)
    return polynomial_piece(control, low, high)
