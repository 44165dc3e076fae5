"""Curves of single motions: arcs in any plane, helices, cubics and NURBS."""

from __future__ import annotations

import math
from typing import Final, Literal

import numpy as np

from ph_post.gcode.reader.record import ARC, CUBIC, NURBS, PLANE_AXES, Motions
from ph_post.geometry.base import MEETS, PiecewiseCurve, polynomial_piece
from ph_post.geometry.composite import Composite
from ph_post.geometry.curves import Arc, Bezier, Line, Nurbs
from ph_post.types import Array, frozen

SPAN: Final = 0.25
"""Angle [rad] of one quintic of a helix: it leaves the helix by its radius times 5e-9, the sixth power of
the angle over 6! 2^6, and 1 nm on a radius of 200 mm."""

MOVED: Final = 2.0
"""How many times the difference of its radii the centre of an arc may be moved, along the chord, so that
they agree; where that is not enough, nearly a full turn, the radius changes along the arc."""


def curves_of(motions: Motions, number: int, columns: tuple[int, ...]) -> list[PiecewiseCurve]:
    """Curves of one motion that goes somewhere, in the axes whose columns are named.

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
