"""Reversals of one axis along the motions of a program, by its directions of motion."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.gcode.program import ARC, CUBIC, LINE, RAPID, Motions, chain_heads, plane_columns
from ph_post.types import IntArray

NEAR: Final = 1e-7
"""A turning point inside a motion counts as the motion's end where the axis goes no farther beyond it [m]: a stop
a tenth of a micrometre of travel away would leave very short arcs."""

SAME: Final = 1e-9
"""Positions that differ by no more [m] are the same: the axis rests."""

MOTION, SHARE, SIGN, CARRIED, PASSED, CHAIN, FIRST, SHARE0, LAST, SHARE1, BEYOND = range(11)
"""Columns of a change: the motion, the share of it, the new direction, 1 where a rapid carries the change itself,
the speed of the path there [m/s], the chain; and the stretch in which the axis rests, from a share of its first
motion to a share of its last, the same place where it turns at once; 1 where it comes to its place from beyond."""

COLUMNS: Final = 11


@lean
def _tangent(view: Any, k: int, last: bool, out: Any) -> None:
    """Direction of travel at the start or the end of a motion, not normalised."""
    kind, start, end, plane, center, angle, row, control = view
    if kind[k] == ARC:
        a, b, c = plane[k, 0], plane[k, 1], plane[k, 2]
        point = end if last else start
        turn = 1.0 if angle[k] > 0.0 else -1.0
        out[a] = -turn * (point[k, b] - center[k, 1])
        out[b] = turn * (point[k, a] - center[k, 0])
        out[c] = (end[k, c] - start[k, c]) / abs(angle[k])
    elif kind[k] == CUBIC:
        for axis in range(3):
            first, second = (3, 2) if last else (1, 0)
            out[axis] = control[row[k], first, axis] - control[row[k], second, axis]
            if out[axis] == 0.0:
                out[axis] = 1e-3 * (end[k, axis] - start[k, axis])
    else:
        for axis in range(3):
            out[axis] = end[k, axis] - start[k, axis]
    for axis in range(3):
        if math.isnan(out[axis]):
            out[axis] = 0.0


@inner
def _passing(view: Any, feed: Any, exact: Any, k: int, high: int) -> float:
    """Speed of the path at the end of motion `k` [m/s]: the lower feed, reduced by the corner."""
    kind = view[0]
    if k + 1 >= high or exact[k] == 1 or kind[k] == RAPID or kind[k + 1] == RAPID:
        return 0.0
    into, out = np.zeros(3), np.zeros(3)
    _tangent(view, k, True, into)
    _tangent(view, k + 1, False, out)
    before, after, both = 0.0, 0.0, 0.0
    for axis in range(3):  # whole arrays take long to compile
        before += into[axis] * into[axis]
        after += out[axis] * out[axis]
        both += into[axis] * out[axis]
    size = math.sqrt(before * after)
    if size == 0.0:
        return 0.0
    return float(min(feed[k], feed[k + 1]) * max(both / size, 0.0))


@lean
def _turns(view: Any, axis: int, k: int, shares: Any, places: Any) -> int:
    """Shares and positions at which an axis turns inside a motion; their number."""
    kind, start, end, plane, center, angle, row, control = view
    found = 0
    if kind[k] == CUBIC:
        p = control[row[k], :, axis]
        a = p[3] - 3.0 * p[2] + 3.0 * p[1] - p[0]
        b = 2.0 * (p[2] - 2.0 * p[1] + p[0])
        c = p[1] - p[0]
        root = b * b - 4.0 * a * c
        if root <= 0.0:
            return 0
        q = -0.5 * (b + math.copysign(math.sqrt(root), b))
        first = q / a if a != 0.0 else -1.0
        second = c / q if q != 0.0 else -1.0
        for u in (min(first, second), max(first, second)):
            if 0.0 < u < 1.0:
                v = 1.0 - u
                shares[found] = u
                places[found] = v**3 * p[0] + 3.0 * v * v * u * p[1] + 3.0 * v * u * u * p[2] + u**3 * p[3]
                found += 1
    elif kind[k] == ARC and axis != plane[k, 2]:
        side = 0 if axis == plane[k, 0] else 1
        x = start[k, plane[k, 0]] - center[k, 0]
        y = start[k, plane[k, 1]] - center[k, 1]
        radius, theta, sweep = math.hypot(x, y), math.atan2(y, x), angle[k]
        # Ends whose radii differ by their rounding are on one spiral.
        last_radius = math.hypot(end[k, plane[k, 0]] - center[k, 0], end[k, plane[k, 1]] - center[k, 1])
        if math.isnan(radius + last_radius) or sweep == 0.0:
            return 0
        # The axis is extreme where the angle is a whole number of half turns, the second axis' a quarter on.
        first = (theta - side * 0.5 * math.pi) / math.pi
        last = first + sweep / math.pi
        n = math.floor(first) + 1.0 if sweep > 0.0 else math.ceil(first) - 1.0
        step = 1.0 if sweep > 0.0 else -1.0
        while (n - last) * step < 0.0 and found < shares.size:
            share = (n - first) * math.pi / sweep
            there = radius + share * (last_radius - radius)
            shares[found] = share
            places[found] = center[k, side] + (there if n % 2.0 == 0.0 else -there)
            found += 1
            n += step
    return found


@lean
def _room(view: Any, low: int, high: int) -> int:
    """Return the largest number of turning points that one motion can have."""
    most, angle = 4, view[5]
    for k in range(low, high):
        most = max(most, int(abs(angle[k]) / math.pi) + 4)
    return most


@inner
def _grown(rows: Any, count: int) -> Any:
    if count < rows.shape[0]:
        return rows
    larger = np.empty((2 * rows.shape[0], rows.shape[1]))
    for row in range(count):
        for column in range(COLUMNS):
            larger[row, column] = rows[row, column]
    return larger


@lean
def _write_reversal(view: Any, feed: Any, exact: Any, span: Any, start: Any, known: bool, sign: int, row: Any) -> None:
    """Record the best place for a change of direction between two places at which the axis rests.

    `span` is (first motion, its share, last motion, its share, end of the chain), `start` the chain's first place. A
    rapid that takes the axis away carries the change, but where the side is not `known` on which it rests while the
    tool cuts. Else it is made behind a rapid, before the tool goes down, or where the path stands or is slowest, the
    first of equals. An axis whose side is not known has turned by no more than the dead band: it rests from `start` on.
    """
    k0, share0, k1, share1, high = span
    inside = 0.0 < share0 < 1.0
    if not known:
        k0, share0 = start
    row[SIGN], row[CARRIED], row[PASSED], row[BEYOND] = sign, 0.0, 0.0, 0.0
    row[FIRST], row[SHARE0], row[LAST], row[SHARE1] = k0, share0, k1, share1
    leaves = k1 + 1 if share1 == 1.0 else k1
    cuts = False
    for k in range(k0 + (share0 == 1.0), leaves):
        cuts = cuts or view[0][k] != RAPID
    if leaves < high and view[0][leaves] == RAPID and (known or inside or not cuts):
        row[MOTION], row[SHARE], row[CARRIED] = leaves, 1.0, 1.0
        return
    row[MOTION], row[SHARE] = k0, share0
    if share0 == 0.0:
        # At the beginning of a chain: behind the first rapid, if there is one before the axis moves.
        for k in range(k0, k1 + (share1 == 1.0)):
            if view[0][k] == RAPID:
                row[MOTION], row[SHARE] = k, 1.0
                return
        return
    if share0 < 1.0:
        row[PASSED] = feed[k0]
        return
    least = math.inf
    for k in range(k0, k1 + 1):
        # Where the path stands, rather in the air than at the end of a cut.
        passed = _passing(view, feed, exact, k, high) if view[0][k] != RAPID else -1.0
        if passed < least:
            least = passed
            row[MOTION], row[PASSED] = k, max(passed, 0.0)


@lean
def _nodes(view: Any, axis: int, k: int, fresh: bool, shares: Any, places: Any) -> int:
    """Shares and positions of a motion's places: the start if it is `fresh`, turning points, the end."""
    start, end = view[1][k, axis], view[2][k, axis]
    if math.isnan(end):
        return 0
    count = 0
    if fresh and not math.isnan(start):
        shares[0], places[0] = 0.0, start
        count = 1
    first, found = count, _turns(view, axis, k, shares[count:], places[count:])
    for n in range(first, first + found):
        begins = n == first and abs(places[n] - start) < NEAR
        ends = n == first + found - 1 and abs(places[n] - end) < NEAR
        if not (begins or ends):
            shares[count], places[count] = shares[n], places[n]
            count += 1
    shares[count], places[count] = 1.0, end
    return count + 1


@lean
def _put(spot: Any, x: float, k: int, share: float) -> None:
    spot[0], spot[1], spot[2], spot[3], spot[4] = x, k, share, k, share


@lean
def _visit(spot: Any, x: float, k: int, share: float, band: float, sign: int) -> int:
    """Follow the extremes to a new place; the new direction where the axis has turned, 0 elsewhere.

    `spot` has of the lowest and of the highest position: itself, where the axis came to it, and where it was
    seen there last.
    """
    for side in range(2):
        beyond = (x - spot[side, 0]) * (1.0 if side == 1 else -1.0)
        if beyond > SAME:
            _put(spot[side], x, k, share)
        elif abs(beyond) <= SAME:
            spot[side, 3], spot[side, 4] = k, share
    if sign != -1 and spot[1, 0] - x > band:
        return -1
    if sign != 1 and x - spot[0, 0] > band:
        return 1
    return 0


@compiled
def find_reversals(view: Any, axis: int, feed: Any, exact: Any, low: Any, high: Any, active: Any, band: Any) -> Any:
    """Find the reversals of an axis by more than a dead band, chain by chain.

    Parameters
    ----------
    view : tuple
        Columns of the motions: `kind` (m,), `start` (m, 3), `end` (m, 3), `plane` (m, 3) as axis numbers,
        `center` (m, 2), `angle` (m,), `row` (m,) into `control` (c, 4, 3).
    axis : int
    feed, exact : arrays, shape (m,)
    low, high : arrays, shape (c,)
        First motion of every chain, and the motion behind its last.
    active : bool array, shape (c,)
        Chains in which reversals are sought.
    band : Array, shape (c,)
        Dead band of each chain [m].

    Returns
    -------
    Array, shape (n, 11)
        Changes in order; columns as named in this module. The first of a chain gives its first direction.
    """
    kind, end = view[0], view[2]
    rows, count = np.empty((64, COLUMNS)), 0
    spot = np.zeros((2, 5))
    for chain in range(low.size):
        if not active[chain]:
            continue
        room = _room(view, low[chain], high[chain])
        shares, places = np.empty(room), np.empty(room)
        fresh, sign, start = True, 0, (0, 0.0)
        for k in range(low[chain], high[chain]):
            # The short way for straight motions, of which there may be a million.
            if not fresh and (kind[k] == LINE or kind[k] == RAPID):
                nodes, shares[0], places[0] = 1, 1.0, end[k, axis]
                if math.isnan(places[0]):
                    continue
            else:
                nodes = _nodes(view, axis, k, fresh, shares, places)
            for node in range(nodes):
                x, share = places[node], shares[node]
                if fresh:
                    _put(spot[0], x, k, share)
                    _put(spot[1], x, k, share)
                    fresh, start = False, (k, share)
                    continue
                turned = _visit(spot, x, k, share, band[chain], sign)
                if turned == 0:
                    continue
                known = sign != 0
                rows, sign, old = _grown(rows, count), turned, spot[(1 - turned) // 2]
                span = (int(old[1]), old[2], int(old[3]), old[4], high[chain])
                _write_reversal(view, feed, exact, span, start, known, turned, rows[count])
                rows[count, CHAIN] = chain
                count += 1
                _put(spot[0], x, k, share)
                _put(spot[1], x, k, share)
    return rows[:count]


def motion_view(motions: Motions) -> tuple[Any, ...]:
    """Return `kind`, `start`, `end`, `plane` (m, 3), `center`, `angle`, `row` and `control` (c, 4, 3)."""
    row = np.full(motions.kind.size, -1, dtype=np.int32)
    cubics = sorted(motions.control)
    row[cubics] = np.arange(len(cubics))
    control = np.array([motions.control[k] for k in cubics]).reshape(-1, 4, 3)
    plane = plane_columns(motions.plane)
    return motions.kind, motions.start, motions.end, plane, motions.center, motions.angle, row, control


def chain_spans(motions: Motions) -> tuple[IntArray, IntArray]:
    """Return the first motion of every chain, and the motion behind its last; both (c,)."""
    places = np.flatnonzero(np.append(chain_heads(motions.chain), True))
    return places[:-1], places[1:]


def section_spans(motions: Motions) -> tuple[IntArray, IntArray]:
    """Return the first motion of every section, and the motion behind its last; both (s,).

    A section is a part of a chain in which offsets can be left alone for themselves: rapids, and the cuts up to the
    next rapid. Rapids behind the last cut of a chain belong to its last section.
    """
    count = motions.chain.size
    if count == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    cuts = motions.kind != RAPID
    heads = chain_heads(motions.chain)
    ends = np.append(np.flatnonzero(heads)[1:], count)[np.cumsum(heads) - 1]
    cuts_until = np.append(0, np.cumsum(cuts))
    begins = ~cuts & np.append(False, cuts[:-1]) & (cuts_until[ends] > cuts_until[:-1])
    low = np.flatnonzero(heads | begins)
    return low, np.append(low[1:], count)
