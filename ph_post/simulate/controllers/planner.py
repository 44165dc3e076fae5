"""LinuxCNC's planner as a model: corners, and speeds at the joints; `planner_cycles.py` runs every servo period.

The rules are those of its trajectory planner in version 2.9. A corner is passed at the speed that changes no
axis' velocity by more than a tenth of its acceleration in one period, or rounded by an arc, or blended: the
next leg starts while this one slows down; whichever is fastest. The end of a queue is approached with half
the acceleration. In arcs half of the acceleration is left for the direction of travel where the other part is
needed towards the centre. A leg takes at least one period. As each leg comes, speeds are looked at again from the
last one back, but not beyond five legs that cannot be passed faster.
"""

from __future__ import annotations

import math

import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.simulate.controllers.legs import (
    ACROSS,
    ALONG,
    ASKED,
    BLEND,
    CAN,
    DRAINS,
    EXACT,
    EXTENT,
    FIRST,
    LEAD,
    ORIGIN,
    PAUSE,
    PUSH,
    RADIUS,
    RAPID,
    RISE,
    SECOND,
    SHARE0,
    SHARE1,
    STOP,
    SWEEP,
    TANGENT,
    TOLERANCE,
)
from ph_post.types import Array

KINK = 0.1
"""Share of an axis' acceleration that the change of direction at a joint may take in one period."""

REVERSAL = (2.0 * math.pi / 180.0) ** 2
"""Squared length of the sum of two unit tangents below which a corner is a reversal, with a stop."""

DEPTH = 50
"""Legs that are looked ahead."""

PEAKS = 4
"""Looking ahead ends behind so many legs, and one, that are left at the largest speed which their ends allow."""

GAP_CYCLES = 4.0
"""A line that is left with fewer periods between two rounded corners becomes part of the second."""

LEFT_OF_ARC = 1.0 - 1e-6
"""Part of an arc that the rounding at its end may take, of what that at its beginning leaves."""

LEAST_CYCLES = 1.02
"""Periods that a leg takes at least where it is passed at speed."""

QUARTER = 0.25
"""Share of a leg's length up to which its corner may be rounded where no tolerance is given."""

OFF_TANGENT = 1e-6
"""Largest distance of an arc from its tangent where a rounding ends [m]; roundings are reckoned with tangents."""

LEAST_SPEED = 1e-11
LEAST_TIME = 1e-12
LEAST_ARC = 1e-9
LEAST_ANGLE = 1e-6

LINE, ARC, ROUNDING = 0.0, 1.0, 2.0
"""Kind of a leg; a rounding is an arc that the planner put into a corner."""

# Columns of the working table, a row a leg: what it is, and how far it has come.
KIND, ACC, MOST, SPEED, LENGTH, END, FINAL, KINK_SPEED, LESS, LESS_BEFORE, BLENDS, RATIO, NOMINAL = range(13)
DONE, V, CYCLE, SPLIT, TERM_V, REMOVE, LATCHED, SLOWING, BLEND_V, RAMP, ACTIVE, PEAK = range(13, 25)
COLUMNS = 25


@lean
def tangent_of(legs: Array, row: int, at_end: bool, out: Array) -> None:
    """Put the unit tangent of a leg at one of its ends into `out`."""
    if legs[row, RADIUS] == 0.0:
        for k in range(3):
            out[k] = legs[row, FIRST + k]
        return
    angle = legs[row, SWEEP] if at_end else 0.0
    turn = 1.0 if legs[row, SWEEP] > 0.0 else -1.0
    c, s = math.cos(angle), math.sin(angle)
    way = legs[row, EXTENT] - legs[row, LEAD]
    norm = 0.0
    for k in range(3):
        out[k] = (
            legs[row, RADIUS] * abs(legs[row, SWEEP]) * turn * (c * legs[row, SECOND + k] - s * legs[row, FIRST + k])
        )
        out[k] += legs[row, RISE + k]
        norm += out[k] * out[k]
    norm = math.sqrt(norm) if way > 0.0 else 1.0
    for k in range(3):
        out[k] /= norm


@lean
def _acceleration(table: Array, row: int) -> float:
    """Acceleration along a leg, with what corners and blends take of it."""
    scale = 1.0 - max(table[row, LESS], table[row, LESS_BEFORE])
    if table[row, BLENDS] > 0.0 or table[row, END] == BLEND:
        scale *= 0.5
    found: float = table[row, ACC] * scale
    return found


@lean
def along(table: Array, row: int) -> float:
    """Acceleration in the direction of travel."""
    return _acceleration(table, row) * (table[row, RATIO] if table[row, KIND] != LINE else 1.0)


@lean
def _finish(legs: Array, table: Array, row: int, period: float) -> None:
    """Fix a leg whose length will not change any more."""
    table[row, MOST] = min(table[row, MOST], table[row, LENGTH] / period)
    if table[row, KIND] != ARC:
        return
    bound = _acceleration(table, row)
    way2 = legs[row, EXTENT] ** 2
    flat = legs[row, RADIUS] * abs(legs[row, SWEEP])
    effective = legs[row, RADIUS] * (way2 / max(flat * flat, 1e-300))
    needed = table[row, MOST] ** 2 / max(effective, 1e-300)
    if needed > ACROSS * bound:
        table[row, MOST] = math.sqrt(ACROSS * bound * effective)
        table[row, RATIO] = ALONG
    else:
        table[row, RATIO] = math.sqrt(max(1.0 - (needed / bound) ** 2, 0.0))


@lean
def _kink(one: Array, two: Array, speed: float, push: float, period: float, limits: Array) -> float:
    """Largest share of an axis' acceleration that a corner takes in one period at some speed."""
    worst = 0.0
    for k in range(3):
        worst = max(worst, abs(two[k] - one[k]) * (speed / period + push) / limits[k, 1])
    return worst


@lean
def blend_speeds(legs: Array, table: Array, row: int, one: Array, two: Array, part: float) -> tuple[float, float]:
    """Speed below which a leg lets the next one start, and the speed that passes the corner then.

    `part` of each leg's length counts.
    """
    acc_this, acc_next = along(table, row), along(table, row + 1)
    reach_this = min(math.sqrt(acc_this * part * table[row, LENGTH]), table[row, SPEED], table[row, MOST])
    reach_next = min(math.sqrt(acc_next * part * table[row + 1, LENGTH]), table[row + 1, SPEED], table[row + 1, MOST])
    longest = min(table[row, LENGTH] / reach_this, table[row + 1, LENGTH] / reach_next)
    time = min(longest, max(reach_this / acc_this, reach_next / acc_next))
    this, after = min(reach_this, time * acc_this), min(reach_next, time * acc_next)
    dot = min(max(one[0] * two[0] + one[1] * two[1] + one[2] * two[2], -1.0), 1.0)
    theta = 0.5 * math.acos(-dot)
    if legs[row, TOLERANCE] > 0.0 and math.cos(theta) > 1e-3:
        bound = 2.0 * math.sqrt(acc_this * legs[row, TOLERANCE] / math.cos(theta))
        this, after = min(this, bound), min(after, bound)
    return this, 0.5 * math.sin(theta) * (this + after)


@lean
def _copy(moves: Array, source: int, legs: Array, row: int) -> None:
    for k in range(moves.shape[1]):
        legs[row, k] = moves[source, k]


@lean
def _enter(legs: Array, table: Array, row: int, period: float) -> None:
    """Begin the row of the working table of a leg that enters the queue."""
    for k in range(COLUMNS):
        table[row, k] = 0.0
    table[row, KIND] = ARC if legs[row, RADIUS] > 0.0 else LINE
    table[row, ACC], table[row, SPEED] = legs[row, PUSH], legs[row, ASKED]
    table[row, LENGTH] = table[row, NOMINAL] = legs[row, EXTENT]
    table[row, MOST] = min(legs[row, CAN], legs[row, EXTENT] / period)
    table[row, END] = BLEND
    if legs[row, TOLERANCE] < 0.0:
        table[row, END] = EXACT if legs[row, TOLERANCE] > -2.0 else STOP
    table[row, KINK_SPEED], table[row, RATIO], table[row, CYCLE] = -1.0, ALONG, period


@lean
def _cross(one: Array, two: Array, out: Array) -> None:
    """Put the vector product into `out`."""
    out[0] = one[1] * two[2] - one[2] * two[1]
    out[1] = one[2] * two[0] - one[0] * two[2]
    out[2] = one[0] * two[1] - one[1] * two[0]


@inner
def _least_extent(one: Array, two: Array, limits: Array, column: int) -> float:
    """Smallest limit of the axes in the plane of two directions."""
    normal = np.empty(3)
    _cross(one, two, normal)
    size = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    least = math.inf
    for k in range(3):
        inside = math.sqrt(max(1.0 - (normal[k] / size) ** 2, 0.0))
        least = min(least, limits[k, column] / max(inside, 1e-12))
    return least


@lean
def _rounding(
    legs: Array, table: Array, row: int, one: Array, two: Array, limits: Array
) -> tuple[float, float, float, float]:
    """Arc that rounds the corner between two legs: radius, cut off either leg, speed and acceleration.

    A radius of zero where there is none.
    """
    dot = min(max(one[0] * two[0] + one[1] * two[1] + one[2] * two[2], -1.0), 1.0)
    theta = 0.5 * math.acos(-dot)
    if theta < LEAST_ANGLE or 0.5 * math.pi - theta < LEAST_ANGLE:
        return 0.0, 0.0, 0.0, 0.0
    if not (_turns_in_plane(legs, row, one, two) and _turns_in_plane(legs, row + 1, one, two)):
        return 0.0, 0.0, 0.0, 0.0
    phi = math.pi - 2.0 * theta
    push = _least_extent(one, two, limits, 1)
    allowed = QUARTER * min(table[row, NOMINAL], table[row + 1, NOMINAL])
    for k in (row, row + 1):
        if legs[k, TOLERANCE] > 0.0:
            allowed = min(allowed, legs[k, TOLERANCE])
    # Of an arc something is left: one without length has no direction.
    left = table[row, LENGTH] * (LEFT_OF_ARC if legs[row, RADIUS] > 0.0 else 1.0)
    longest = min(left, 0.5 * table[row, NOMINAL], 0.5 * table[row + 1, LENGTH])
    for k in (row, row + 1):
        if legs[k, RADIUS] > 0.0:
            longest = min(longest, math.sqrt(2.0 * legs[k, RADIUS] * OFF_TANGENT))
    way = min(longest, math.cos(theta) * allowed / (1.0 - math.sin(theta)))
    radius = math.tan(theta) * way
    fast = max(min(table[row, SPEED], table[row, MOST]), min(table[row + 1, SPEED], table[row + 1, MOST]))
    speed = min(math.sqrt(ACROSS * push * radius), fast, _least_extent(one, two, limits, 0))
    time = 2.0 * min(math.sqrt(push * way), speed) / push
    radius = max(speed * speed / (ACROSS * push), min(time * speed / phi, radius))
    cut = radius / math.tan(theta)
    if radius * phi < LEAST_ARC:
        return 0.0, 0.0, 0.0, 0.0
    return radius, cut, speed, push


@inner
def _turns_in_plane(legs: Array, row: int, one: Array, two: Array) -> bool:
    """Return whether a leg lies in the plane of two directions."""
    if legs[row, RADIUS] == 0.0:
        return True
    normal, axis, across = np.empty(3), np.empty(3), np.empty(3)
    _cross(one, two, normal)
    _cross(legs[row, FIRST : FIRST + 3], legs[row, SECOND : SECOND + 3], axis)
    _cross(normal, axis, across)
    size = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    return math.sqrt(across[0] ** 2 + across[1] ** 2 + across[2] ** 2) < LEAST_ANGLE * size


@inner
def _round(
    legs: Array,
    table: Array,
    row: int,
    arc: tuple[float, float, float, float],
    tangents: Array,
    period: float,
) -> int:
    """Put a rounding between a leg and the one behind it; the number of the latter then."""
    radius, cut, speed, push = arc
    one, two = tangents[0], tangents[1]
    dot = min(max(one[0] * two[0] + one[1] * two[1] + one[2] * two[2], -1.0), 1.0)
    sweep = math.pi - math.acos(-dot)
    _copy(legs, row + 1, legs, row + 2)
    _enter(legs, table, row + 2, period)
    _copy(legs, row, legs, row + 1)
    corner = np.empty(3)
    for k in range(3):
        corner[k] = place_of(legs, row, legs[row, EXTENT], k)
    legs[row, EXTENT] -= cut
    if legs[row, RADIUS] > 0.0:
        legs[row, SWEEP] *= legs[row, EXTENT] / (legs[row, EXTENT] + cut)
        for k in range(3):
            legs[row, RISE + k] *= legs[row, EXTENT] / (legs[row, EXTENT] + cut)
    _cut_beginning(legs, row + 2, cut)
    table[row + 2, LENGTH] = legs[row + 2, EXTENT]
    size = math.sqrt(max(1.0 - dot * dot, 1e-300))
    for k in range(3):
        inward = (two[k] - dot * one[k]) / size
        legs[row + 1, ORIGIN + k] = corner[k] - cut * one[k] + radius * inward
        legs[row + 1, FIRST + k] = -inward
        legs[row + 1, SECOND + k] = one[k]
        legs[row + 1, RISE + k] = 0.0
    legs[row + 1, RADIUS], legs[row + 1, SWEEP] = radius, sweep
    legs[row + 1, EXTENT], legs[row + 1, LEAD] = radius * sweep, 0.0
    legs[row + 1, ASKED] = max(min(table[row, SPEED], table[row, MOST]), legs[row + 2, ASKED])
    legs[row + 1, CAN], legs[row + 1, PUSH] = speed, push
    legs[row + 1, PAUSE], legs[row + 1, DRAINS] = 0.0, 0.0
    legs[row + 1, SHARE0] = legs[row + 1, SHARE1] = legs[row, SHARE1]
    _enter(legs, table, row + 1, period)
    table[row + 1, KIND], table[row + 1, END] = ROUNDING, TANGENT
    table[row, LENGTH], table[row, END] = legs[row, EXTENT], TANGENT
    table[row, KINK_SPEED], table[row, LESS] = -1.0, 0.0
    nominal = table[row, NOMINAL]
    _finish(legs, table, row, period)
    table[row, NOMINAL] = nominal
    if table[row, KIND] == LINE and legs[row, EXTENT] < GAP_CYCLES * period * speed:
        return _swallow(legs, table, row)
    return row + 2


@lean
def _cut_beginning(legs: Array, row: int, cut: float) -> None:
    """Take a piece off the beginning of a leg."""
    length = legs[row, EXTENT]
    if legs[row, RADIUS] == 0.0:
        for k in range(3):
            legs[row, ORIGIN + k] += cut * legs[row, FIRST + k]
    else:
        angle = legs[row, SWEEP] * cut / length
        c, s = math.cos(angle), math.sin(angle)
        for k in range(3):
            first, second = legs[row, FIRST + k], legs[row, SECOND + k]
            legs[row, FIRST + k], legs[row, SECOND + k] = c * first + s * second, c * second - s * first
            legs[row, ORIGIN + k] += legs[row, RISE + k] * cut / length
            legs[row, RISE + k] *= 1.0 - cut / length
        legs[row, SWEEP] -= angle
    legs[row, EXTENT] = length - cut


@lean
def _swallow(legs: Array, table: Array, row: int) -> int:
    """Make what is left of a line the beginning of the rounding behind it; the number of the leg after it."""
    lead = legs[row, EXTENT]
    before = table[row, BLENDS]
    less = table[row, LESS_BEFORE]
    pause, drains, share0 = legs[row, PAUSE], legs[row, DRAINS], legs[row, SHARE0]
    for target in (row, row + 1):
        _copy(legs, target + 1, legs, target)
        for k in range(COLUMNS):
            table[target, k] = table[target + 1, k]
    legs[row, LEAD], legs[row, EXTENT] = lead, legs[row, EXTENT] + lead
    legs[row, PAUSE], legs[row, DRAINS], legs[row, SHARE0] = pause, drains, share0
    table[row, LENGTH] = table[row, NOMINAL] = legs[row, EXTENT]
    table[row, BLENDS], table[row, LESS_BEFORE] = before, less
    return row + 1


@lean
def place_of(legs: Array, row: int, s: float, k: int) -> float:
    """Coordinate k of the point of a leg at s from its beginning."""
    place: float
    radius = legs[row, RADIUS]
    if radius == 0.0:
        place = legs[row, ORIGIN + k] + s * legs[row, FIRST + k]
        return place
    lead = legs[row, LEAD]
    if s < lead:
        place = legs[row, ORIGIN + k] + radius * legs[row, FIRST + k] + (s - lead) * legs[row, SECOND + k]
        return place
    part = (s - lead) / (legs[row, EXTENT] - lead)
    angle = legs[row, SWEEP] * part
    turned = math.cos(angle) * legs[row, FIRST + k] + math.sin(angle) * legs[row, SECOND + k]
    place = legs[row, ORIGIN + k] + radius * turned + part * legs[row, RISE + k]
    return place


@lean
def _join(legs: Array, table: Array, row: int, tangents: Array, limits: Array, period: float) -> int:
    """Decide how a leg ends, now that the next one is known; the number of the latter then."""
    after = row + 1
    if table[row, END] == STOP or legs[row, RAPID] != legs[after, RAPID]:
        table[row, END] = STOP
        _finish(legs, table, row, period)
        return after
    one, two = tangents[0], tangents[1]
    tangent_of(legs, row, True, one)
    tangent_of(legs, after, False, two)
    if (one[0] + two[0]) ** 2 + (one[1] + two[1]) ** 2 + (one[2] + two[2]) ** 2 < REVERSAL:
        table[row, END] = STOP
        _finish(legs, table, row, period)
        return after
    slower = min(table[row, SPEED], table[row, MOST], table[after, SPEED], table[after, MOST])
    kink = _kink(one, two, slower, table[after, ACC], period, limits)
    if table[row, KIND] != LINE or table[after, KIND] != LINE:
        kink /= ALONG
    less, passes = min(kink, KINK), slower * min(1.0, KINK / max(kink, 1e-300))
    table[row, LESS], table[after, LESS_BEFORE] = max(less, table[row, LESS]), less
    table[row, KINK_SPEED] = passes
    if kink < KINK:
        table[row, END] = TANGENT
        _finish(legs, table, row, period)
        return after
    if table[row, END] == EXACT:
        _finish(legs, table, row, period)
        return after
    arc = _rounding(legs, table, row, one, two, limits)
    blended = 0.5 * blend_speeds(legs, table, row, one, two, 0.5)[1]
    rounded = 0.0
    if arc[0] > 0.0:
        rounded = min(arc[2], arc[0] * (math.pi - 2.0 * math.atan2(arc[0], arc[1])) / period)
    if rounded > blended and rounded > passes:
        table[after, LESS_BEFORE] = 0.0
        return _round(legs, table, row, arc, tangents, period)
    if passes > blended:
        table[row, END] = TANGENT
    else:
        table[row, END], table[row, KINK_SPEED], table[row, LESS] = BLEND, -1.0, 0.0
        table[after, LESS_BEFORE], table[after, BLENDS] = 0.0, 1.0
    _finish(legs, table, row, period)
    return after


@lean
def _look_ahead(table: Array, begin: int, end: int, period: float) -> None:
    """Raise the speeds at the ends of the legs of a queue that has just got its last one, as far as LinuxCNC goes.

    Back from the last leg it ends behind the fifth that could not be left faster, also where those before it could.
    """
    peaks, passed = 0, False
    for row in range(end - 1, max(end - 2 - DEPTH, begin), -1):
        before = row - 1
        if table[before, END] != TANGENT:
            if passed:
                return
            passed = True
            continue
        acc, bound = along(table, row), min(table[row, MOST], table[before, MOST])
        if table[before, KINK_SPEED] >= 0.0:
            bound = min(bound, table[before, KINK_SPEED])
        if row == end - 1:  # its length may yet change: only half of it counts
            table[before, FINAL] = min(math.sqrt(acc * table[row, LENGTH]), table[row, SPEED], bound)
            continue
        reached = math.sqrt(table[row, FINAL] ** 2 + 2.0 * acc * table[row, LENGTH])
        if reached >= bound:
            table[before, PEAK] = 1.0
        table[before, FINAL] = min(reached, bound)
        table[row, MOST] = min(table[row, MOST], table[row, LENGTH] / (LEAST_CYCLES * period))
        peaks += 1 if table[row, PEAK] > 0.0 else 0
        if peaks > PEAKS:
            return


@compiled
def plan_legs(moves: Array, legs: Array, table: Array, limits: Array, period: float) -> int:
    """Fill the planner's queue with the moves of a program; the number of legs that come of them.

    Parameters
    ----------
    moves : Legs
        Lines and arcs as programmed.
    legs : Legs
        Room for twice as many, filled.
    table : Array, shape (2 n, COLUMNS)
        Room for the working table, filled.
    limits : Array, shape (3, 2)
        Velocity [m/s] and acceleration [m/s²] of the axes.
    period : float
        [s]

    Returns
    -------
    int
    """
    count, begin = 0, 0
    tangents = np.empty((2, 3))
    for source in range(moves.shape[0]):
        if moves[source, DRAINS] > 0.0:
            begin = count
        _copy(moves, source, legs, count)
        _enter(legs, table, count, period)
        if count > begin:
            count = _join(legs, table, count - 1, tangents, limits, period)
        count += 1
        _look_ahead(table, begin, count, period)
    return count
