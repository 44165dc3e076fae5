"""The shapes of crossings on the fly: where they begin and end, how long they last, and how fast the path passes.

An axis that turns back is nearly at rest for a moment. Meanwhile its motor crosses the backlash g, the path goes on,
and the table waits. In the time T that the crossing takes the path covers v T. A chord from the place v T/2 before the
reversal to the place v T/2 behind it, on which the offset changes from one side to the other, leaves the table
(v T)²/8 R towards the centre of curvature at most (one-sided). With the table out of the path by e at both ends of the
chord it is e within the path at the reversal: half as much (balanced), e = (v T)²/16 R over the half length
h = 2 √(R e); the table leaves the path, and comes back to it, on tangents, which touch it (2 + √2) √(R e) before and
behind the reversal. Where the part lies on the side of the centre, a crossing that leaves it proud bulges by all of
(v T)²/8 R and is on the path at the reversal (outward): its tangents touch 2 h before and behind. Where it lies on the
other side, the one-sided crossing leaves it proud. Where e is more than is allowed the path slows down to
v_c = (4/T) √(R e), of which the others than the balanced one have the √2nd part. R is not needed here:
how far the axis is from its turning point is read off the path. Behind a lag :mod:`ph_post.edit.lagging_crossings` says
what T is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import accumulate, pairwise, product
from operator import mul, truediv
from typing import Any, Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.compiling import compiled, inner, lean, read_only
from ph_post.dialects.planners import planner_of
from ph_post.drive.cascade import response_time
from ph_post.edit.lagging_crossings import SHORT_LAG, CrossingArcs, fastest_arcs, out_and_back
from ph_post.gcode.motion_parts import places_along
from ph_post.gcode.program import ARC, AXES, CUBIC, PartProgram, plane_columns
from ph_post.simulate.controllers.junctions import junction_speed
from ph_post.simulate.controllers.legs import ACROSS
from ph_post.simulate.controllers.moves import limit_table
from ph_post.types import Array, Axis, ExactPath, Machine
from ph_post.units import MM

TIGHT: Final = 5.0 * MM
"""Below this radius of curvature [m] more error is allowed, up to :data:`TIGHTER` times, as the path slows down far."""

TIGHTER: Final = 1.7

OUTER: Final = (2.0 + math.sqrt(2.0)) / 2.0
"""A balanced crossing begins and ends at this many times the half length of its chord."""

RAMPS: Final = math.sqrt(2.0)
"""A controller that rounds the joints of a crossing in t with the axis' acceleration a takes g/(a t) for each; with
t = √(2 g/a) the table waits for 1.8 √(g/a), and no joint is sharper than the controller passes."""

ROUNDED: Final = 1.0
"""Part of that rounding for which the table waits beyond t (seen on LinuxCNC)."""

STEPS: Final = 3
"""Steps in which a motor's slope changes where a controller rounds the joints: of smaller kinks it takes more speed."""

TURNING: Final = 0.75
"""Part of an axis' acceleration that it takes across the path in rounded joints: LinuxCNC gives √3/2 of it."""

WAITING: Final = 2.4
"""Time in √(g/a) for which the table waits in a crossing in steps, 2 √(g/a) being the least (seen on LinuxCNC)."""

SHARP: Final = 1.5
"""A joint of a crossing that is so many times sharper than a controller of an exact path passes at speed is divided."""

FASTER: Final = 1.02
"""More blocks are worth this at least, as a factor of the speed."""

LINE_TIME: Final = 2e-3
"""Time [s] that a block lasts at least where more of them spare a sharp joint: what a line of 23 characters takes on a
serial line of 115,200 baud."""

LEAST_PERIODS: Final = 2.0
"""Servo periods that a block of a crossing in steps takes at least at the mean speed of the crossing."""

LONGER: Final = 1.1
"""So many times as long as one out and back a crossing in arcs may be: its joints do not slow the path down."""

LEAST_WAY: Final = 0.25
LONGEST_WAY: Final = 400.0
WAYS: Final = 200
"""Lengths of a crossing that are tried, in lost motions."""

SHARPER: Final = 1.2
"""The joints of a crossing are sharper than its own direction by this, as the path comes in on a tangent."""

LONG: Final = 0.01
"""Length of the block before a crossing [m]."""

_LEAST_PART: Final = 1e-12
"""An axis that has a smaller part in a motion has none."""

AT_SPEED: Final = 0.98
"""Part of the feed that counts as full."""


@inner
def _coordinate(view: Any, along: Any, s: float, axis: int) -> float:
    """Position of an axis at a place along the program [m]."""
    kind, start, end, plane, center, angle, row, control = view
    k = min(max(int(np.searchsorted(along, s, side="right")) - 1, 0), int(kind.size) - 1)
    length = along[k + 1] - along[k]
    share = min(max((s - along[k]) / length, 0.0), 1.0) if length > 0.0 else 0.0
    if kind[k] == ARC and axis != plane[k, 2]:
        x = start[k, plane[k, 0]] - center[k, 0]
        y = start[k, plane[k, 1]] - center[k, 1]
        turned = math.atan2(y, x) + share * angle[k]
        # Ends whose radii differ by their rounding are on one spiral.
        last = math.hypot(end[k, plane[k, 0]] - center[k, 0], end[k, plane[k, 1]] - center[k, 1])
        radius = (1.0 - share) * math.hypot(x, y) + share * last
        if axis == plane[k, 0]:
            return float(center[k, 0] + radius * math.cos(turned))
        return float(center[k, 1] + radius * math.sin(turned))
    if kind[k] == CUBIC:
        p, v = control[row[k], :, axis], 1.0 - share
        return float(v**3 * p[0] + 3 * v * v * share * p[1] + 3 * v * share**2 * p[2] + share**3 * p[3])
    return float(start[k, axis] + share * (end[k, axis] - start[k, axis]))


ASIDE: Final = 0.25
"""Part of its length by which a window is moved at most."""

UNEVEN: Final = 0.05
"""Part by which the axis is farther from its turning point at one end of a window than at the other, and it stays."""

SAMPLED: Final = 0.15
"""Angle [rad] at the point at which an axis turns that lines of a sampled curve have at most."""

LEVELLINGS: Final = 12
"""Halvings by which the place is found where both are the same."""


@lean
def _window(
    view: Any, along: Any, axis: int, sign: float, rest: Any, bound: Any, more: float
) -> tuple[float, float, float]:
    """Return the window that reaches beyond a rest by `more` to both sides, and how far the axis is at its ends [m].

    The depth is infinite where the window leaves its bounds. Where a curve is sampled in lines its turning point lies
    beside the point at which the lines turn: the window is moved until the axis is as far at both of its ends.
    """
    begin, finish = rest[0] - more, rest[1] + more
    if begin < bound[0] or finish > bound[1]:
        return begin, finish, math.inf
    level = _coordinate(view, along, rest[0], axis)
    one = (_coordinate(view, along, begin, axis) - level) * sign
    other = (_coordinate(view, along, finish, axis) - level) * sign
    bent = one + other > SAMPLED * more
    if more > 0.0 and not bent and abs(other - one) > UNEVEN * max(one, other):
        least = max(-ASIDE * (finish - begin), bound[0] - begin)
        most = min(ASIDE * (finish - begin), bound[1] - finish)
        for _ in range(LEVELLINGS):
            shift = 0.5 * (least + most)
            one = (_coordinate(view, along, begin + shift, axis) - level) * sign
            other = (_coordinate(view, along, finish + shift, axis) - level) * sign
            if other > one:
                most = shift
            else:
                least = shift
        begin, finish = begin + shift, finish + shift
    return begin, finish, max(one, other, 0.0)


@compiled
def points_along(view: Any, along: Any, s: Any) -> Any:
    """Return the points of a program at places along it (n,) [m], shape (n, 3) [m]; 0 where an axis is not known."""
    points = np.empty((s.size, 3))
    for n in range(s.size):
        for axis in range(3):
            x = _coordinate(view, along, s[n], axis)
            points[n, axis] = 0.0 if math.isnan(x) else x
    return points


INWARD: Final = 3
BALANCED: Final = 1
OUTWARD: Final = 2
BEHIND: Final = 4
CHORD: Final = 5
"""Kinds of crossings: the table leaves the path towards the centre of curvature, by half to both sides, or outward; or
it waits on the straight line behind a corner, or on a chord of a contour with cutter compensation."""

SOONEST: Final = 0.7
"""Part of a crossing's time that is left at least where the axis moves already at its end."""

HALVINGS: Final = 40
"""Halvings of the speed by which the fastest one within the error is found."""


@compiled
def find_windows(
    view: Any,
    along: Any,
    axis: Any,
    sign: Any,
    rest: Any,
    bound: Any,
    wait: Any,
    late: Any,
    feed: Any,
    error: Any,
    most: Any,
    kind: Any,
    push: Any,
    tied: Any,
) -> Any:
    """Find the window of every crossing: the stretch in which the table waits, and the speed of the path there.

    Parameters
    ----------
    view : tuple
        Of :func:`~ph_post.edit.reversals.motion_view`.
    along : Array, shape (m + 1,)
        Of :func:`~ph_post.gcode.motion_parts.places_along`.
    axis, sign : arrays, shape (n,)
        Axis that turns, and its new direction.
    rest : Array, shape (n, 2)
        Places between which it rests, the same where it turns at once.
    bound : Array, shape (n, 2)
        Places that the crossing may not leave.
    wait, late, feed, error, most : Array, shape (n,)
        Time of the crossing [s], and how much later a command that goes beyond begins and ends [s]; speed of the path
        [m/s], largest error [m], and the largest one where the path is sharply curved [m].
    kind : array, shape (n,)
        :data:`OUTWARD` or :data:`INWARD` where the table is to be on that side of the path if there is room,
        :data:`BALANCED` where it is to be on both, and 0 where the inner one alone will do if that is exact enough.
    push : Array, shape (n,)
        Acceleration [m/s²] with which the motor comes down to the speed that its axis has at the end of the window,
        which takes it less time than to come to rest; infinite where that does not count.
    tied : array, shape (n,)
        Whether the table has to leave the path and to come back to it on tangents.

    Returns
    -------
    Array, shape (n, 5)
        Begin and end of the window, speed [m/s], error [m], and the kind: :data:`INWARD`, :data:`BALANCED` or
        :data:`OUTWARD`; a speed of 0 where no window keeps the error.
    """
    found = np.zeros((axis.size, 5))
    for n in range(axis.size):
        lasts = rest[n, 1] - rest[n, 0]
        low, high, allowed = 0.0, feed[n], min(error[n], most[n])
        for step in range(HALVINGS + 1):
            speed = high if step == 0 else 0.5 * (low + high)
            more = max(0.5 * (speed * wait[n] - lasts), 0.0)
            begin, finish, deep = _window(view, along, axis[n], float(sign[n]), rest[n], bound[n], more)
            if 0.0 < deep < math.inf and more > 0.0 and push[n] < math.inf:
                sooner = 2.0 * deep / more * speed / push[n]
                more = max(0.5 * (speed * max(wait[n] - sooner, SOONEST * wait[n]) - lasts), 0.0)
                begin, finish, deep = _window(view, along, axis[n], float(sign[n]), rest[n], bound[n], more)
            out = (OUTER - 1.0) * more
            behind = finish + out + late[n] * speed
            fits = begin - out >= bound[n, 0] and behind <= bound[n, 1]
            room = more > 0.0 and fits
            if step == 0 and 0.0 < deep < math.inf:
                radius = (finish - begin) ** 2 / (8.0 * deep)
                allowed = min(allowed * min(max(TIGHT / radius, 1.0), TIGHTER), most[n])
            outside = more > 0.0 and begin - more >= bound[n, 0] and finish + more <= bound[n, 1]
            flat = deep <= 0.5 * allowed and kind[n] != BALANCED
            how = INWARD if not room or flat or kind[n] == INWARD else BALANCED
            how = OUTWARD if kind[n] == OUTWARD and outside else how
            e = 0.5 * deep if how == BALANCED else deep
            if e <= allowed and (fits or (late[n] == 0.0 and not tied[n])):
                low = speed
                found[n, 0], found[n, 1], found[n, 2] = begin, finish, speed
                found[n, 3], found[n, 4] = e, how
                if step == 0:
                    break
            else:
                high = speed
    return found


class CrossingShape(msgspec.Struct, frozen=True, kw_only=True):
    """The course of a crossing in time: the offset changes in `first` [s], and the table waits for `wait` [s].

    Behind a loop with lag the offset goes beyond its new value by the part `beyond` of its change, and comes back until
    the end of `wait`, so that the motor, which follows late, has arrived then. Where the controller rounds the joints,
    the motor's speed changes in `steps` joints to its largest, and in as many back, each over `ramp` [s], fewer where
    one of the blocks would last less than `least` [s], in `fewest` where the controller looks ahead through no more;
    `push` [m/s²] is the acceleration of the axis then. Where the motor lags as well, it crosses in `arcs`. Where the
    path is exact a joint is passed the slower the sharper it is: `turn` is the product of both that the controller
    allows [rad m/s], infinite where that is not asked.
    """

    first: float
    wait: float
    beyond: float = 0.0
    steps: int = 1
    ramp: float = 0.0
    least: float = 0.0
    fewest: int = 1
    push: float = 0.0
    turn: float = math.inf
    arcs: CrossingArcs | None = None

    def span(self, steps: int) -> float:
        """Time between the first and the last joint of a crossing in steps [s]."""
        return (2.0 - 1.0 / steps) * self.ramp


def stair(up: int, down: int, travel: float, before: float, after: float) -> tuple[list[float], list[float]]:
    """Return the corners of the broken line by which a motor crosses, its slope changing in equal steps.

    From the slope `before` in `up` equal steps to the largest, and in `down` equal ones to `after`. The pieces are in
    proportion to the changes of slope at their ends, so that the acceleration is the same all along where each joint
    is rounded as far as the middles of the pieces beside it.

    Parameters
    ----------
    up, down : int
    travel : float
        Of the motor [m] over a stretch of 1 m.
    before, after : float
        Slopes of the motor's way ahead of the stretch and behind it.

    Returns
    -------
    places, travelled : list of up + down floats
        From 0 to 1, and from 0 to `travel`.

    Examples
    --------
    >>> places, travelled = stair(2, 2, 1.0, 0.0, 0.0)
    >>> [round(place, 3) for place in places], [round(way, 3) for way in travelled]
    ([0.0, 0.333, 0.667, 1.0], [0.0, 0.25, 0.75, 1.0])
    """
    p, q = 1.0 / up, 1.0 / down
    half = 0.5 * (p * before + q * after + travel * (4.0 - p - q))
    rest = travel * ((2.0 - p) * before + (2.0 - q) * after) - (1.0 - p) * before**2 - (1.0 - q) * after**2
    fastest = 0.5 * (half + math.sqrt(max(half * half - 2.0 * rest, 0.0)))
    rise, fall = p * (fastest - before), q * (fastest - after)
    pieces = [rise] * (up - 1) + [0.5 * (rise + fall)] + [fall] * (down - 1)
    slopes = [fastest + step * rise for step in range(1 - up, 1)] + [fastest - step * fall for step in range(1, down)]
    *_, whole = accumulate(pieces)
    # With one slope all along nothing changes at the joints: the pieces are as long as each other.
    pieces = [piece / whole for piece in pieces] if whole != 0.0 else [1.0 / len(pieces)] * len(pieces)
    return [0.0, *accumulate(pieces)], [0.0, *accumulate(map(mul, pieces, slopes))]


def fastest_stair(
    slopes: Sequence[float], length: float, turn: float, time: float, shortest: float
) -> tuple[list[float], list[float], float]:
    """Return the :func:`stair` of up to :data:`STEPS` steps that an exact path's controller passes fastest.

    Parameters
    ----------
    slopes : (float, float, float)
        Of the motor's way ahead of the stretch, along it, and behind it.
    length : float
        Of the stretch [m].
    turn : float
        Product of speed and angle that the controller allows at a joint [rad m/s].
    time, shortest : float
        How long a block lasts at least [s], and how long it is [m].

    Returns
    -------
    places, travelled : list of float
        As of :func:`stair`.
    speed : float
        [m/s].
    """
    before, slope, after = slopes
    found = None
    for up, down in sorted(product(range(1, STEPS + 1), repeat=2), key=sum):
        places, travelled = stair(up, down, slope, before, after)
        pieces = [end - begin for begin, end in pairwise(places)]
        if up + down > 2 and min(pieces) * length < shortest:
            continue
        ways = [end - begin for begin, end in pairwise(travelled)]
        bends = [abs(b - a) for a, b in pairwise([before, *map(truediv, ways, pieces), after])]
        speed = min(turn / max(*bends, _LEAST_PART), min(pieces) * length / time)
        if found is None or speed > FASTER * found[2]:
            found = places, travelled, speed
    assert found is not None
    return found


def crossing_shape(axis: Axis, first: float, rounding: float) -> CrossingShape:
    """Return the shortest crossing of an axis' backlash.

    The motor's way is that of the command through 1/(b s² + c s + 1), or through its cascade. Of the crossings that
    change the offset in `first` or longer, and come back from beyond in as long, the shortest is taken that leaves no
    more than :data:`RESIDUE`, goes no more beyond than :data:`BEYOND`, and turns no more sharply than one in `first`.

    Parameters
    ----------
    axis : Axis
        With lost motion.
    first : float
        Time of the change that limits and controller allow [s].
    rounding : float
        Time for which the table waits longer as the controller rounds the joints [s].
    """
    lag = response_time(axis.servo)
    if lag < SHORT_LAG:
        return CrossingShape(first=first, wait=first + rounding)
    part, beyond = out_and_back(axis.servo, axis.gap.lost_motion, first)
    return CrossingShape(first=part, wait=2.0 * part + rounding, beyond=beyond)


def shortest_time(machine: Machine, axis: Axis, feed: float) -> tuple[float, float]:
    """Return the shortest time of a crossing that a controller's planner passes at speed, and how long it rounds [s].

    Parameters
    ----------
    machine : Machine
    axis : Axis
        That crosses its backlash, at a right angle to the path.
    feed : float
        Of the path [m/s].
    """
    lost, push = axis.gap.lost_motion, axis.limits.acceleration
    if not isinstance(planner_of(machine), ExactPath):
        first = RAMPS * math.sqrt(lost / push)
        return first, ROUNDED * lost / (push * first)
    way = np.geomspace(LEAST_WAY * lost, LONGEST_WAY * lost, WAYS)
    column = AXES.index(axis.name)
    before, after = np.zeros((WAYS, 3)), np.zeros((WAYS, 3))
    before[:, 1 if column == 0 else 0] = 1.0
    after[:, 1 if column == 0 else 0], after[:, column] = way, SHARPER * lost
    after /= np.linalg.norm(after, axis=1)[:, None]
    passed = junction_speed(machine, before, after, LONG, way, feed=feed) >= AT_SPEED * feed
    if not passed.any():
        return math.inf, 0.0
    return float(way[np.argmax(passed)]) / feed, 0.0


def fastest_in_arcs(program: PartProgram, machine: Machine) -> Array:
    """Return the speed that LinuxCNC keeps to in each motion for its acceleration across it [m/s], shape (m,)."""
    motions = program.motions
    found = np.full(motions.kind.size, math.inf)
    arcs = np.flatnonzero(motions.kind == ARC)
    if arcs.size:
        planes = plane_columns(motions.plane[arcs])[:, :2]
        radius = np.linalg.norm(np.take_along_axis(motions.start[arcs], planes, 1) - motions.center[arcs], axis=1)
        push = limit_table(machine)[planes, 1].min(axis=1)
        found[arcs] = np.sqrt(ACROSS * push * np.nan_to_num(radius, nan=math.inf))
    return found


def fastest_along(program: PartProgram, machine: Machine) -> Array:
    """Return the speed beyond which no axis goes in each motion, whatever feed is asked for [m/s], shape (m,).

    In arcs it is that of the faster axis that turns.
    """
    motions = program.motions
    limits = read_only(limit_table(machine)[:, 0])
    arcs = np.flatnonzero(motions.kind == ARC)
    turning = plane_columns(motions.plane[arcs])[:, :2]
    length = np.maximum(np.diff(places_along(motions)), 1e-12)
    found: Array = _fastest_on_chords(read_only(motions.start), read_only(motions.end), length, limits)
    part = np.nan_to_num(np.abs(motions.end[arcs] - motions.start[arcs])) / length[arcs, None]
    np.put_along_axis(part, turning.astype(np.int64), 0.0, axis=1)
    found[arcs] = (limits / np.maximum(part, _LEAST_PART)).min(axis=1)
    found[arcs] = np.minimum(found[arcs], limits[turning].max(axis=1))
    return found


@compiled
def _fastest_on_chords(start: Any, end: Any, length: Any, limits: Any) -> Any:
    """Return the speed along each motion at which an axis is at its limit, as of straight ones [m/s], shape (m,)."""
    found = np.full(length.size, np.inf)
    for n in range(length.size):
        for axis in range(3):
            part = abs(end[n, axis] - start[n, axis]) / length[n]
            part = part if part > _LEAST_PART else _LEAST_PART
            found[n] = min(found[n], limits[axis] / part)
    return found


def shape_in_steps(shape: CrossingShape, axis: Axis, period: float, tolerance: float) -> CrossingShape:
    """Return a crossing in :data:`STEPS` steps where its blocks last long enough for two or more, behind a lag in arcs.

    Parameters
    ----------
    shape : CrossingShape
    axis : Axis
    period : float
        Of the servo [s].
    tolerance : float
        To which the controller rounds corners [m]: n steps need g/(8 n²).
    """
    lost, push = axis.gap.lost_motion, axis.limits.acceleration
    ramp, least = math.sqrt(lost / (TURNING * push)), LEAST_PERIODS * period
    if shape.beyond > 0.0:
        arcs = fastest_arcs(axis.servo, lost, TURNING * push, LONGER * shape.wait, shape.beyond)
        if arcs is None:
            return shape
        arcs = replace(arcs, ramp=math.sqrt(8.0 * tolerance * arcs.way / lost))
        return replace(shape, wait=arcs.wait, beyond=arcs.beyond, steps=STEPS, least=least, arcs=arcs)
    steps = min(STEPS, int(ramp / least))
    if steps < 2 or shape.first > RAMPS * math.sqrt(lost / push):
        return shape
    wait = WAITING * math.sqrt(lost / push)
    fewest = min(max(math.ceil(math.sqrt(lost / (8.0 * tolerance))), 2), steps)
    return replace(shape, wait=wait, steps=steps, fewest=fewest, ramp=ramp, least=least, push=push)
