"""Ends of motions that nearly go on in one direction: the corner between them rounded, as controllers do.

CAM programs join arcs and lines that are not quite tangent, by as much as some hundredths of a radian. A
planner of sharp corners would rest there; no controller does. What it runs along is known no better than to a
tolerance, and within that the corner is a smooth bend.
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.geometry.base import polynomial_piece
from ph_post.geometry.bernstein import subdivide
from ph_post.geometry.composite import Composite
from ph_post.geometry.curves import Arc
from ph_post.geometry.joints import SHARP_CORNER_RAD, Joints, find_joints
from ph_post.geometry.piece import Piece
from ph_post.geometry.track import Track
from ph_post.types import Array, BoolArray, Curve, IntArray, Segment, frozen

SMALL_CORNER_RAD: Final = 0.1
"""Angle [rad] up to which a corner is rounded. At 10 mm/s the speed of an axis changes there by 1 mm/s at
most, which a drive does in one or two periods of a controller."""

SHARE: Final = 0.25
"""Part of the motions and pieces on either side that a bend takes at most."""

SAME_PLACE: Final = 1e-9
"""Arc lengths [m] that differ by less are one place."""


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
    passed, reached = (np.searchsorted(corner, s + off) for off in (-SAME_PLACE, SAME_PLACE))
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
        low, high = np.searchsorted(s, [place - SAME_PLACE, place + SAME_PLACE])
        if not 0 < low < high < s.size:
            continue
        jump = float(np.linalg.norm(joints.curvature_jump[k]))
        pieces = np.diff(track.starts)[[joints.before[k], joints.after[k]]]
        room = SHARE * min(place - float(s[low - 1]), float(s[high]) - place, float(pieces.min()))
        half[k] = min(
            room, 2.0 * tolerance / float(joints.angle[k]), np.sqrt(8.0 * tolerance / max(jump, 1.0))
        )
    return half


def _bend(track: Track, s: float, half: float) -> Composite:
    """Quintic from `half` [m] before a place to as far behind it."""
    jet = track.arc_derivatives(*track.locate(np.array([s - half, s + half])), 2)
    chord = float(np.linalg.norm(jet[0, 1] - jet[0, 0]))
    first, second = jet[1] * chord / 5.0, jet[2] * chord**2 / 20.0
    start, end = jet[0]
    control = frozen([
        start, start + first[0], start + 2.0 * first[0] + second[0],
        end - 2.0 * first[1] + second[1], end - first[1], end,
    ])  # fmt: skip
    return Composite([polynomial_piece(control, 0.0, 1.0)])


def _with_bends(track: Track, number: IntArray, half: Array, bends: list[Composite]) -> tuple[Segment, ...]:
    """Shorten segments for the bends behind those of some numbers, and put these between them."""
    segments = list(track.path.segments)
    behind: dict[int, list[Segment]] = {}
    for k, size, bend in zip(number.tolist(), half.tolist(), bends, strict=True):
        here, there = segments[k], segments[k + 1]
        behind[k] = _shared(bend, here, there)
        (piece,) = bend.pieces
        segments[k] = msgspec.structs.replace(here, curve=_shortened(here.curve, size, piece.control[0], 1))
        segments[k + 1] = msgspec.structs.replace(
            there, curve=_shortened(there.curve, size, piece.control[-1], 0)
        )
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
