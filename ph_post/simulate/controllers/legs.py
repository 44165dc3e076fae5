"""The planner's queue: one row a leg, a line or an arc with the limits along it; splines as pairs of arcs.

LinuxCNC plays a spline as pairs of arcs between places at equal steps of the parameter.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from ph_post.gcode.curves import curves_of
from ph_post.gcode.program import CUBIC, NURBS, Motions, PartProgram
from ph_post.types import Array

STOP, TANGENT, BLEND, EXACT = range(4)
"""Ends of a leg: at rest; at speed, in the direction of the next; slowing down while the next one starts; at
rest but where the next one goes on in its direction."""


class Legs(NamedTuple):
    """Legs of a program, n of them, in the order of travel. SI units.

    `origin`, `first`, `second`, `rise` (n, 3): a line is origin + s first, and an arc of `radius` > 0 is
    origin + radius (cos(a) first + sin(a) second) + rise s / length, with a = sweep s / length. `lead` is how
    much of an arc's length is a line before it. `speed` is what F asks for, `most` what the axes can, `push`
    the acceleration that they can; `rapid` is 1 for G0. `tolerance` is how far the corner at the end may be
    rounded, 0 where that is not said, -1 where the end is to be reached (G61), -2 where it stops (G61.1).
    `motion` is the program's motion it is part of, from `share0` to `share1` of it; of linked moves it is the
    last, and those before are shares of it below 0. `pause` [s] and `drains` (0 or 1) say whether the planner's
    queue runs empty before it, and how long the axes rest then.
    """

    origin: Array
    first: Array
    second: Array
    rise: Array
    radius: Array
    sweep: Array
    length: Array
    lead: Array
    speed: Array
    most: Array
    push: Array
    rapid: Array
    tolerance: Array
    motion: Array
    share0: Array
    share1: Array
    pause: Array
    drains: Array


# Columns of a table of legs; the first four are vectors.
ORIGIN, FIRST, SECOND, RISE = range(0, 12, 3)
RADIUS, SWEEP, EXTENT, LEAD, ASKED, CAN, PUSH, RAPID, TOLERANCE, MOTION, SHARE0, SHARE1, PAUSE, DRAINS = range(12, 26)

SHORTEST: Final = 1e-15
"""Moves up to this [m] are none."""

VECTORS = 4
"""The first so many columns are vectors."""


def make_legs(count: int) -> Legs:
    """Return so many empty rows."""
    vectors = [np.zeros((count, 3)) for _ in range(VECTORS)]
    return Legs(*vectors, *(np.zeros(count) for _ in Legs._fields[VECTORS:]))


def table_of(legs: Legs) -> Array:
    """Put legs into one table, shape (n, 26): columns in the order of the fields."""
    return np.column_stack(list(legs))


ALONG: Final = 0.5
"""Share of the acceleration that is kept for the direction of travel in an arc."""

ACROSS: Final = math.sqrt(0.75)
"""Part of the acceleration that is left towards the centre then."""

CUBIC_SPANS: Final = 16
"""Pairs of arcs for one cubic."""

NURBS_SPANS: Final = 4
"""Pairs of arcs for every control point."""

STRAIGHT: Final = 1e-9
"""Height over length of an arc that is a line."""

Arc2 = tuple[Array, Array, Array]
"""Beginning, unit tangent there, and end."""


def with_splines(legs: Legs, program: PartProgram, limits: Array) -> Legs:
    """Put arcs in place of the splines, which have a straight leg each so far."""
    motions = program.motions
    rows = np.flatnonzero(np.isin(motions.kind[legs.motion.astype(np.int64)], (CUBIC, NURBS)))
    if rows.size == 0:
        return legs
    parts, done = [], 0
    for row in rows.tolist():
        parts.append(_rows(legs, slice(done, row)))
        parts.append(_spline(legs, row, motions, limits))
        done = row + 1
    parts.append(_rows(legs, slice(done, None)))
    return Legs(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _rows(legs: Legs, rows: slice) -> Legs:
    return Legs(*(column[rows] for column in legs))


def _spline(legs: Legs, row: int, motions: Motions, limits: Array) -> Legs:
    """Legs of one spline, in the XY plane at the height at which it begins."""
    number = int(legs.motion[row])
    arcs = _arcs(motions, number)
    found = make_legs(len(arcs))
    for name in ("tolerance", "motion", "rapid"):
        getattr(found, name)[:] = getattr(legs, name)[row]
    found.pause[0], found.drains[0] = legs.pause[row], legs.drains[row]
    edges = np.linspace(0.0, 1.0, len(arcs) + 1)
    found.share0[:], found.share1[:] = edges[:-1], edges[1:]
    for k, arc in enumerate(arcs):
        _put(found, k, arc)
    found.origin[:, 2] = legs.origin[row, 2]
    _put_limits(found, limits[:2].min(axis=0))
    asked = motions.feeds.at(number)
    found.speed[:] = np.minimum(found.most, asked) if asked > 0.0 else found.most
    return found


def _arcs(motions: Motions, number: int) -> list[Arc2]:
    """Pairs of arcs that LinuxCNC makes of a spline."""
    curve = curves_of(motions, number, (0, 1))[0]
    cubic = motions.kind[number] == CUBIC
    spans = CUBIC_SPANS if cubic else NURBS_SPANS * len(motions.nurbs[number][1])
    places = np.linspace(*curve.domain, spans + 1)
    point, tangent = curve.derivatives(places, 1)
    tangent = _directions(point, tangent)
    found: list[Arc2] = []
    for p, t, q, u in zip(point[:-1], tangent[:-1], point[1:], tangent[1:], strict=True):
        joint, along = _joint(p, q, t, u)
        found += [(p, t, joint), (joint, along, q)]
    return found


def _directions(point: Array, tangent: Array) -> Array:
    """Return unit tangents; where the curve has none, the direction to the places beside it."""
    size = np.linalg.norm(tangent, axis=1)
    chords = np.gradient(point, axis=0)
    found = np.where(size[:, None] > 0.0, tangent, chords)
    return np.asarray(found / np.linalg.norm(found, axis=1)[:, None])


def _joint(p: Array, q: Array, t: Array, u: Array) -> tuple[Array, Array]:
    """Return the point where the two arcs of a pair meet, and their direction there; both reach equally far."""
    way = p - q
    c = float(way @ way)
    b = 2.0 * float(way @ (t + u))
    a = 2.0 * (float(t @ u) - 1.0)
    below = math.sqrt(max(b * b - 4.0 * a * c, 0.0)) - b
    reach = 2.0 * c / below if below > 0.0 else 0.0
    one, two = p + reach * t, q - reach * u
    return 0.5 * (one + two), (two - one) / float(np.linalg.norm(two - one))


def _put(legs: Legs, row: int, arc: Arc2) -> None:
    begin, tangent, end = arc
    chord = end - begin
    normal = np.array([-tangent[1], tangent[0]])
    height, size = float(chord @ normal), float(np.linalg.norm(chord))
    if abs(height) <= STRAIGHT * size:
        legs.origin[row, :2], legs.first[row, :2], legs.length[row] = begin, chord / size, size
        return
    radius = size * size / (2.0 * height)
    ray = -normal * math.copysign(1.0, radius)
    legs.origin[row, :2], legs.first[row, :2] = begin + radius * normal, ray
    legs.second[row, :2] = -ray[1], ray[0]
    legs.radius[row], legs.sweep[row] = abs(radius), 2.0 * math.atan2(height, float(chord @ tangent))
    legs.length[row] = legs.radius[row] * abs(legs.sweep[row])


def _put_limits(legs: Legs, limits: Array) -> None:
    """Let the worse axis of the plane bound speed and acceleration."""
    velocity, push = limits
    bend = np.where(legs.radius > 0.0, legs.radius, np.inf)
    legs.most[:] = np.minimum(np.sqrt(push * ACROSS * bend), velocity)
    legs.push[:] = push
