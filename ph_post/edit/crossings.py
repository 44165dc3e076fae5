"""Crossings of the backlash on the fly: where they begin and end, and how fast the path passes.

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
how far the axis is from its turning point is read off the path.

With the loop closed at the motor, the motor follows the command with the lag c. A command that crosses in t, goes
beyond by the part k of the backlash and comes back in t has the motor arrive at 2 t exactly where b = 0 and
k = 1/(exp(t/c) - 1); the table waits for 2 t in place of at most t + c ln(g/r), after which r of a plain crossing is
left.
"""

from __future__ import annotations

import math
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.compiling import compiled, inner
from ph_post.edit.edits import CrossingEdit, CrossingPart
from ph_post.edit.reversals import motion_view
from ph_post.gcode.program import ARC, AXES, CUBIC, LINE, Motions
from ph_post.types import Array, Axis, BoolArray
from ph_post.units import MM

ERROR: Final = 1.1e-3 * MM
"""Largest error [m] that a crossing is given where the time allows it: what rounding to micrometres leaves, twice."""

TIGHT: Final = 5.0 * MM
"""Below this radius of curvature [m] more error is allowed, up to :data:`TIGHTER` times, as the path slows down far."""

TIGHTER: Final = 1.7

COARSER: Final = (2.0, 4.0)
"""Multiples of :data:`ERROR` that are tried where the time allowed is too short."""

BEYOND: Final = 0.4
"""Part of the backlash by which a crossing goes beyond: with the feed held there the error is no larger than the plain
program's."""

SHORT_LAG: Final = 1e-3
"""Lags below this [s] are those of a stepper."""

TRIALS: Final = 60
"""Durations of a crossing that are tried behind a lag."""

RESIDUE: Final = 0.5e-3 * MM
"""Rest of a crossing [m] at which it counts as done where the motor lags behind."""

SHORTEST: Final = 0.02 * MM
"""Blocks of crossings are no shorter [m]; one that would be is moved to the end of the motion beside it."""

LOOSER: Final = 1.3
"""A crossing may have so many times its error where that spares a block too short for the controller."""

NEARBY: Final = 1.5 * SHORTEST
"""A crossing whose blocks have to be short begins and ends on a joint of the program that is so near [m]."""

KINK: Final = math.cos(math.radians(20.0))
"""In a corner sharper than this the shift is a move of its own, as the path is slow there anyway."""

OUTER: Final = (2.0 + math.sqrt(2.0)) / 2.0
"""A balanced crossing begins and ends at this many times the half length of its chord."""

LEAD: Final = 0.5 * (OUTER - 1.0)
"""Straight blocks before and behind a crossing with lag last this part of it."""

SETTLING: Final = 4.0
"""So many time constants c behind a corner the motor has arrived, within 2 % of its way."""

FASTER: Final = 2e-3
"""Feeds that differ by less than this part are the same."""

CAUTIOUS: Final = 0.9
"""Part of the way that a motor has more than the path by which the feed is raised: lengths are approximate."""

FREELY: Final = 1.1
"""Feed of the blocks of a crossing in steps beside its mean speed: their joints are what slows the path down."""

HELD: Final = 0.8
"""Part of the least time of blocks in steps that is left where they were moved to the ends of motions."""

BLOCKS: Final = 0.85
"""Part of the window that the blocks of a crossing in steps take at most."""

LONE: Final = 0.75
"""Part of the wait that the motor's block lasts where there is room for no more than one."""

SAMPLES: Final = 33
"""Places of a crossing at which its error is read off."""

NOTHING: Final = 1e-12
"""Places along the program that differ by no more [m] are the same."""

SAME_SHARE: Final = 1e-9
"""Shares of a motion that differ by no more are the same."""


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
        if axis == plane[k, 0]:
            return float(center[k, 0] + math.hypot(x, y) * math.cos(turned))
        return float(center[k, 1] + math.hypot(x, y) * math.sin(turned))
    if kind[k] == CUBIC:
        p, v = control[row[k], :, axis], 1.0 - share
        return float(v**3 * p[0] + 3 * v * v * share * p[1] + 3 * v * share**2 * p[2] + share**3 * p[3])
    return float(start[k, axis] + share * (end[k, axis] - start[k, axis]))


@inner
def _depth(view: Any, along: Any, axis: int, sign: float, level: float, low: float, high: float) -> float:
    """Return how far the axis is from its turning point at the farther of two places [m]; never negative."""
    one = (_coordinate(view, along, low, axis) - level) * sign
    other = (_coordinate(view, along, high, axis) - level) * sign
    return max(one, other, 0.0)


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
"""Kinds of crossings: the table leaves the path towards the centre of curvature, by half to both sides, or outward."""

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
    feed: Any,
    error: Any,
    kind: Any,
    push: Any,
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
    wait, feed, error : Array, shape (n,)
        Time of the crossing [s], speed of the path [m/s], largest error [m].
    kind : array, shape (n,)
        :data:`OUTWARD` or :data:`INWARD` where the table is to be on that side of the path if there is room, else 0.
    push : Array, shape (n,)
        Acceleration [m/s²] with which the motor comes down to the speed that its axis has at the end of the window,
        which takes it less time than to come to rest; infinite where that does not count.

    Returns
    -------
    Array, shape (n, 5)
        Begin and end of the window, speed [m/s], error [m], and the kind: :data:`INWARD`, :data:`BALANCED` or
        :data:`OUTWARD`; a speed of 0 where no window keeps the error.
    """
    found = np.zeros((axis.size, 5))
    for n in range(axis.size):
        level = _coordinate(view, along, rest[n, 0], axis[n])
        lasts = rest[n, 1] - rest[n, 0]
        low, high, allowed = 0.0, feed[n], error[n]
        for step in range(HALVINGS + 1):
            speed = high if step == 0 else 0.5 * (low + high)
            more = max(0.5 * (speed * wait[n] - lasts), 0.0)
            begin, finish = rest[n, 0] - more, rest[n, 1] + more
            inside = begin >= bound[n, 0] and finish <= bound[n, 1]
            deep = _depth(view, along, axis[n], float(sign[n]), level, begin, finish) if inside else math.inf
            if 0.0 < deep < math.inf and more > 0.0 and push[n] < math.inf:
                sooner = 2.0 * deep / more * speed / push[n]
                more = max(0.5 * (speed * max(wait[n] - sooner, SOONEST * wait[n]) - lasts), 0.0)
                begin, finish = rest[n, 0] - more, rest[n, 1] + more
                deep = _depth(view, along, axis[n], float(sign[n]), level, begin, finish)
            out = (OUTER - 1.0) * more
            room = more > 0.0 and begin - out >= bound[n, 0] and finish + out <= bound[n, 1]
            if step == 0 and 0.0 < deep < math.inf:
                radius = (finish - begin) ** 2 / (8.0 * deep)
                allowed *= min(max(TIGHT / radius, 1.0), TIGHTER)
            outside = more > 0.0 and begin - more >= bound[n, 0] and finish + more <= bound[n, 1]
            how = INWARD if not room or deep <= 0.5 * allowed or kind[n] == INWARD else BALANCED
            how = OUTWARD if kind[n] == OUTWARD and outside else how
            e = 0.5 * deep if how == BALANCED else deep
            if e <= allowed:
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
    the motor's speed changes in `steps` joints to its largest, and in as many back, over `span` [s], fewer where one
    of the blocks would last less than `least` [s].
    """

    first: float
    wait: float
    beyond: float = 0.0
    steps: int = 1
    span: float = 0.0
    least: float = 0.0


def stair(up: int, down: int, travel: float, before: float, after: float) -> tuple[Array, Array]:
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
    places, travelled : Array, shape (up + down,)
        From 0 to 1, and from 0 to `travel`.

    Examples
    --------
    >>> places, travelled = stair(2, 2, 1.0, 0.0, 0.0)
    >>> places.round(3).tolist(), travelled.round(3).tolist()
    ([0.0, 0.333, 0.667, 1.0], [0.0, 0.25, 0.75, 1.0])
    """
    p, q = 1.0 / up, 1.0 / down
    half = 0.5 * (p * before + q * after + travel * (4.0 - p - q))
    rest = travel * ((2.0 - p) * before + (2.0 - q) * after) - (1.0 - p) * before**2 - (1.0 - q) * after**2
    fastest = 0.5 * (half + math.sqrt(max(half * half - 2.0 * rest, 0.0)))
    rise, fall = p * (fastest - before), q * (fastest - after)
    pieces = np.array([rise] * (up - 1) + [0.5 * (rise + fall)] + [fall] * (down - 1))
    steps = np.append(np.arange(1 - up, 1) * rise, np.arange(1, down) * -fall)
    pieces /= pieces.sum()
    return np.append(0.0, np.cumsum(pieces)), np.append(0.0, np.cumsum(pieces * (fastest + steps)))


def crossing_shape(axis: Axis, first: float, rounding: float) -> CrossingShape:
    """Return the shortest crossing of an axis' backlash.

    The motor's way is that of the command through 1/(b s² + c s + 1). Of the crossings that change the offset in
    `first` or longer, and come back from beyond in as long, the shortest is taken that leaves no more than
    :data:`RESIDUE`, goes no more beyond than :data:`BEYOND`, and turns no more sharply than one in `first`.

    Parameters
    ----------
    axis : Axis
        With lost motion.
    first : float
        Time of the change that limits and controller allow [s].
    rounding : float
        Time for which the table waits longer as the controller rounds the joints [s].
    """
    servo = axis.servo
    if servo.c < SHORT_LAG:
        return CrossingShape(first=first, wait=first + rounding)
    from scipy.signal import lsim

    lost = axis.gap.lost_motion
    system = ([1.0], [servo.b, servo.c, 1.0]) if servo.b > 0.0 else ([1.0], [servo.c, 1.0])
    for part in np.geomspace(max(first, 0.5 * servo.c), max(first, 0.5 * servo.c) + 8.0 * servo.c, TRIALS):
        t = np.linspace(0.0, 2.0 * part + 6.0 * servo.c, 4 * TRIALS)
        out, back = (lsim(system, np.clip((t - begin) / part, 0.0, 1.0), t)[1] for begin in (0.0, part))
        behind = t >= 2.0 * part
        rest, way = 1.0 - out[behind], (out - back)[behind]
        beyond = float(np.clip((rest * way).sum() / max((way * way).sum(), 1e-30), 0.0, BEYOND))
        if np.abs(rest - beyond * way).max() * lost <= RESIDUE and part >= (1.0 + 2.0 * beyond) * first:
            break
    return CrossingShape(first=float(part), wait=2.0 * float(part) + rounding, beyond=beyond)


def _stretch(begin: float, ends: Array, start: Array, points: Array) -> float:
    """Return how much longer the motor's way is than the path's, where it is least on the parts of a block."""
    ways = np.linalg.norm(np.diff(points, axis=0, prepend=start[None, :]), axis=1)
    return 1.0 + CAUTIOUS * max(float((ways / np.diff(ends, prepend=begin)).min()) - 1.0, 0.0)


class CrossingPlace(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A reversal to be crossed: where it is along the program [m], and what happens there.

    `column` the axis and `sign` its new direction; `rest` the places between which it rests, `chosen` the best place in
    it; `bound` the places that the crossing may not leave; `before` and `after` the offsets [m] of all axes, shape
    (3,); `shape` of the crossing; `lag` [s]; `feed` the speed of the path [m/s]; `calm` where the axis rests long
    enough, with `blend` [m] at either end of the rest where the controller may round its corners.
    """

    column: int
    sign: int
    rest: tuple[float, float]
    chosen: float
    bound: tuple[float, float]
    before: Array
    after: Array
    shape: CrossingShape
    lag: float
    feed: float
    calm: bool
    blend: float = 0.0


class _Knots(msgspec.Struct, kw_only=True, eq=False):
    """Places of a crossing in order, what is added to the path there, and how each part is passed.

    `line` says of the part that ends at a knot whether it is a straight block; `speed` [m/s] the path's there.
    On the parts that end at the knots `crosses` the motor crosses the backlash.
    """

    s: list[float]
    added: list[Array]
    line: list[bool]
    speed: list[float]
    crosses: range = range(0)


class CrossingPlanner:
    """Plans the crossings of a program.

    Parameters
    ----------
    motions : Motions
    along : Array, shape (m + 1,)
        Of :func:`~ph_post.gcode.motion_parts.places_along`.
    divisible : BoolArray, shape (m,)
        Motions that may be divided: crossings lie on them alone.
    least : float
        Blocks last at least this long [s] at the feed of the path, where that does not cost too much.
    """

    def __init__(self, motions: Motions, along: Array, divisible: BoolArray, least: float) -> None:
        self._motions, self._along, self._divisible, self._least = motions, along, divisible, least
        self._view = motion_view(motions)

    def plan(self, spot: CrossingPlace, window: Array) -> CrossingEdit | None:
        """Return the crossing at a reversal; None where it does not fit.

        Parameters
        ----------
        spot : CrossingPlace
        window : Array, shape (5,)
            Of :func:`find_windows`.
        """
        long = spot.feed * self._least
        found = self._planned(spot, window, long, spot.shape.steps)
        if long <= SHORTEST or (found is not None and found.error <= ERROR):
            return found
        # A block that the controller has to slow down for costs less than a crossing in the wrong place.
        outside = min(long, NEARBY) if found is None and spot.shape.steps > 1 else 0.0
        finer = self._planned(spot, window, SHORTEST, 1, outside)
        return found if finer is None or (found is not None and found.error <= LOOSER * finer.error) else finer

    def _planned(
        self, spot: CrossingPlace, window: Array, least: float, most: int, outside: float = 0.0
    ) -> CrossingEdit | None:
        """Plan a crossing in `most` steps or in one; blocks no shorter than `least` [m], `outside` [m] at its ends."""
        if spot.calm:
            return self._made(self._in_rest(spot), spot, least, least)
        if window[2] == 0.0:
            return None
        for steps in dict.fromkeys((most, 1)):
            made = self._made(self._around(spot, window, steps), spot, least, max(least, outside))
            if made is not None:
                return made
        return None

    def _made(self, knots: _Knots | None, spot: CrossingPlace, least: float, outside: float) -> CrossingEdit | None:
        if knots is None or not self._snap(knots, spot, max(least, SHORTEST), max(outside, SHORTEST)):
            return None
        if len(knots.crosses) > 1 and (np.diff(knots.s) / knots.speed[1:]).min() < HELD * spot.shape.least:
            return None
        points = points_along(self._view, self._along, np.array(knots.s)) + np.array(knots.added)
        error = self._error(knots, points, spot)
        # What goes beyond shows to a motor without lag alone.
        own = spot.shape.beyond if not spot.calm else 0.0
        if error > (0.25 + own) * abs(float(spot.after[spot.column] - spot.before[spot.column])):
            return None
        parts = self._parts(knots, points)
        if not all(self._divisible[part.motion] for part in parts):
            return None
        return CrossingEdit(
            axis=AXES[spot.column], sign=spot.sign, parts=parts, length=knots.s[-1] - knots.s[0], error=error
        )

    def _error(self, knots: _Knots, points: Array, spot: CrossingPlace) -> float:
        """Return the largest distance [m] from the path of a table that waits while its motor is in the backlash."""
        s = np.unique(np.concatenate([np.linspace(knots.s[0], knots.s[-1], SAMPLES), knots.s]))
        path = points_along(self._view, self._along, s)
        column = spot.column
        motor = path + np.array([np.interp(s, knots.s, added) for added in np.array(knots.added).T]).T
        for n in range(1, len(knots.s)):
            straight = (s >= knots.s[n - 1]) & (s <= knots.s[n]) & knots.line[n]
            share = (s[straight] - knots.s[n - 1]) / (knots.s[n] - knots.s[n - 1])
            motor[straight] = points[n - 1] + share[:, None] * (points[n] - points[n - 1])
        carried = np.where(np.arange(len(AXES)) == column, 0.0, spot.before)
        table = motor - carried
        offsets = sorted((float(spot.before[column]), float(spot.after[column])))
        at = motor[0, column] - spot.before[column]
        for n in range(s.size):
            at = min(max(at, motor[n, column] - offsets[1]), motor[n, column] - offsets[0])
            table[n, column] = at
        tangent = np.gradient(path, s, axis=0)
        tangent /= np.maximum(np.linalg.norm(tangent, axis=1), 1e-12)[:, None]
        off = table - path
        across = off - (off * tangent).sum(axis=1)[:, None] * tangent
        return float(np.linalg.norm(across, axis=1).max())

    def _in_rest(self, spot: CrossingPlace) -> _Knots | None:
        """Cross while the axis rests anyway: on a straight stretch of the rest, and no slower."""
        run = spot.feed * spot.shape.first
        settle, tail = SETTLING * spot.lag * spot.feed, spot.feed * (spot.shape.wait - spot.shape.first)
        low = max(spot.rest[0] + max(settle, spot.blend), spot.bound[0])
        high = min(spot.rest[1] - max(tail, spot.blend), spot.bound[1])
        begin = min(max(spot.chosen, low), high - run)
        if begin < low - 1e-12:
            return None
        finish = min(begin + 2.0 * run, high)
        begin, finish = self._on_line(begin, finish, high, run)
        if finish <= begin:
            return None
        return _Knots(
            s=[begin, finish],
            added=[spot.before, spot.after],
            line=[False, True],
            speed=[spot.feed, spot.feed],
            crosses=range(1, 2),
        )

    def _on_line(self, begin: float, finish: float, high: float, run: float) -> tuple[float, float]:
        """Move a stretch of a rest on to the first straight motion with room for it; an empty one where none has."""
        k = self._motion_at(begin)
        while k < self._motions.kind.size and self._along[k] < high:
            low, end = max(begin, float(self._along[k])), min(high, float(self._along[k + 1]))
            if self._motions.kind[k] == LINE and end - low >= run - NOTHING:
                return low, min(low + (finish - begin), end)
            k += 1
        return 0.0, 0.0

    def _around(self, spot: CrossingPlace, window: Array, steps: int) -> _Knots:
        """Cross while the path is near the turning point, slower where need be."""
        begin, finish, speed, error, kind = window.tolist()
        if spot.shape.beyond > 0.0:
            first = begin + spot.lag * speed
            half = first + spot.shape.first * speed
            peak = spot.after + spot.shape.beyond * (spot.after - spot.before)
            # On tangents, as controllers pass a joint of two straight blocks faster than one with an arc.
            lead = LEAD * (finish - begin)
            bulge = np.zeros(3)
            bulge[spot.column] = -spot.sign * (2.0 if kind == BALANCED else 1.0) * error * (2.0 * LEAD) ** 2
            return _Knots(
                s=[first - lead, first, half, half + spot.shape.first * speed, half + spot.shape.first * speed + lead],
                added=[spot.before, spot.before + bulge, peak, spot.after + bulge, spot.after],
                line=[False, True, True, True, True],
                speed=[spot.feed, speed, speed, speed, spot.feed],
            )
        # The table waits longer than the motor's blocks last where the controller rounds their ends.
        lasts = spot.shape.span * speed if steps > 1 else max(spot.shape.first, LONE * spot.shape.wait) * speed
        if steps > 1:
            lasts = min(lasts, BLOCKS * (finish - begin))
        ahead = max(0.5 * (finish - begin - max(lasts, SHORTEST)), 0.0)
        first, last = begin + ahead, finish - ahead
        knots = _Knots(s=[first, last], added=[spot.before, spot.after], line=[False, True], speed=[spot.feed, speed])
        if kind in (BALANCED, OUTWARD):
            longer = OUTER - 1.0 if kind == BALANCED else 1.0
            out = longer * 0.5 * max(finish - begin - (spot.rest[1] - spot.rest[0]), 0.0)
            bulge = np.zeros(3)
            # The tangent goes on to the block's end.
            bulge[spot.column] = -spot.sign * error * ((out + ahead) / out) ** 2
            knots = _Knots(
                s=[begin - out, first, last, finish + out],
                added=[spot.before, spot.before + bulge, spot.after + bulge, spot.after],
                line=[False, True, True, True],
                speed=[spot.feed, spot.feed, speed, spot.feed],
            )
        return self._in_steps(knots, spot, steps)

    def _in_steps(self, knots: _Knots, spot: CrossingPlace, steps: int) -> _Knots:
        """Put a broken line, as of :func:`stair`, in place of the block in the middle of a crossing."""
        middle = len(knots.s) // 2
        knots.crosses = range(middle, middle + 1)
        if steps == 1:
            return knots
        column, turn = spot.column, float(spot.sign)
        first, last = knots.s[middle - 1], knots.s[middle]
        outer = [first - SHORTEST, last + SHORTEST] if middle == 1 else [knots.s[0], knots.s[-1]]
        added = np.array([knots.added[0], knots.added[middle - 1], knots.added[middle], knots.added[-1]])[:, column]
        s = np.array([outer[0], first, last, outer[1]])
        motor = points_along(self._view, self._along, s)[:, column] + added
        before, slope, after = (turn * np.diff(motor) / np.diff(s)).tolist()
        least = max(spot.shape.least * knots.speed[middle], SHORTEST) / (last - first)
        up = down = steps
        share, travelled = stair(up, down, slope, before, after)
        while min(up, down) > 0 and max(up, down) > 1 and np.diff(share).min() < least:
            if down > 1 and (up == 1 or share[1] > share[-1] - share[-2]):
                down -= 1
            else:
                up -= 1
            share, travelled = stair(up, down, slope, before, after)
        places = (first + share * (last - first))[1:-1]
        way = (
            motor[1]
            + turn * travelled[1:-1] * (last - first)
            - points_along(self._view, self._along, places)[:, column]
        )
        between = [np.where(np.arange(len(AXES)) == column, x, knots.added[middle]) for x in way.tolist()]
        speed = min(FREELY * knots.speed[middle], knots.speed[0])
        knots.s[middle:middle] = places.tolist()
        knots.added[middle:middle] = between
        knots.line[middle:middle] = [True] * len(between)
        knots.speed[middle : middle + 1] = [speed] * (len(between) + 1)
        knots.crosses = range(middle, middle + up + down - 1)
        return knots

    def _motion_at(self, s: float) -> int:
        k = int(np.searchsorted(self._along, s, side="right")) - 1
        return min(max(k, 0), self._motions.kind.size - 1)

    def _locate(self, s: float) -> tuple[int, float]:
        """Return motion and share of a place; at a joint the end of the one before it."""
        k = int(np.searchsorted(self._along, s, side="left")) - 1
        k = min(max(k, 0), self._motions.kind.size - 1)
        low, high = float(self._along[k]), float(self._along[k + 1])
        return k, (s - low) / (high - low) if high > low else 1.0

    def _snapped(self, s: float, down: bool, least: float) -> float:
        """Move a place to an end of its motion where a part would be too short, or where it may not be divided."""
        k, share = self._locate(s)
        low, high = float(self._along[k]), float(self._along[k + 1])
        if not self._divisible[k] and 0.0 < share < 1.0:
            return low if down else high
        if s - low < min(least, 0.5 * (high - low)):
            return low
        return high if high - s < least else s

    def _snap(self, knots: _Knots, spot: CrossingPlace, least: float, outside: float) -> bool:
        """Move knots where motions may be divided; return whether the crossing still fits."""
        count = len(knots.s)
        room = [outside if n in (0, count - 1) else least for n in range(count)]
        knots.s = [self._snapped(one, 2 * n < count, room[n]) for n, one in enumerate(knots.s)]
        inside = knots.s[0] > spot.bound[0] - outside and knots.s[-1] < spot.bound[1] + outside
        return inside and bool(np.all(np.diff(knots.s) > 0.5 * SHORTEST))

    def _parts(self, knots: _Knots, points: Array) -> tuple[CrossingPart, ...]:
        """Cut a crossing at the ends of motions; their ends are shifted onto its blocks."""
        s = knots.s
        parts: list[CrossingPart] = []
        for n in range(1, len(s)):
            first, last = np.searchsorted(self._along, (s[n - 1] + NOTHING, s[n] - NOTHING)).tolist()
            ends = np.append(self._along[first:last], s[n])
            path = points_along(self._view, self._along, ends)
            if knots.line[n]:
                share = (ends - s[n - 1]) / (s[n] - s[n - 1])
                added = points[n - 1] + share[:, None] * (points[n] - points[n - 1]) - path
            else:
                added = np.tile(knots.added[n], (ends.size, 1))
            stretched = _stretch(s[n - 1], ends, points[n - 1], path + added) if n in knots.crosses else 1.0
            low = s[n - 1]
            for end, extra in zip(ends.tolist(), added, strict=True):
                parts.append(self._part(low, end, extra, knots.speed[n], stretched, line=knots.line[n]))
                low = end
        return tuple(parts)

    def _part(
        self, low: float, high: float, added: Array, speed: float, stretched: float, *, line: bool
    ) -> CrossingPart:
        k, end = self._locate(high)
        begin = (low - float(self._along[k])) / (float(self._along[k + 1]) - float(self._along[k]))
        timed = float(self._motions.duration[k])
        own = (self._along[k + 1] - self._along[k]) / timed if timed > 0.0 else float(self._motions.feed[k])
        # The table is never faster than the motion's own feed, also where the crossing begins on a slower one.
        speed = min(speed, own) * stretched if own > 0.0 else speed * stretched
        return CrossingPart(
            motion=k,
            low=0.0 if begin < SAME_SHARE else begin,
            high=1.0 if end > 1.0 - SAME_SHARE else end,
            line=line,
            added=added,
            feed=speed if line or abs(speed - own) > FASTER * own else None,
        )
