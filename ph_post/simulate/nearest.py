"""Compiled search for the nearest place of a path of cubic cells.

A search goes through the tree of capsules and looks only into cells that could be nearer than the best place
known: it finds the nearest place of the whole path, whatever the path does. It leaves behind a clearance,
a bound of the distance to everything outside a few neighbouring cells. As the motion goes on, other places
come nearer by no more than it has moved; while they cannot be nearest, it is enough to follow the minimum
along the neighbours, which is the only one there where the squared distance is convex.
"""

from __future__ import annotations

import math

import numpy as np

from ph_post.compiling import compiled, lean
from ph_post.simulate.cells import BEND, LENGTH, REACH, TANGENT, WIDE_BEND, WIDE_REACH, Cells, S
from ph_post.types import Array, IntArray

NEWTON_STEPS = 12
"""Newton's method on a convex cell takes 2 or 3; what needs more is bracketed."""

BRACKET_STEPS = 80
"""Bisection alone would take 53."""

SURE = 1e-8
"""Step in w after which Newton's method leaves only rounding."""

PARTS = 8
"""Parts of a cell searched one by one where the distance may have several minima in it.

Only at distances near the radius of curvature or beyond. A minimum that two of the parts hid would be less
than about 2e-11 m nearer than what is found, as the cell itself is cubic to 1e-11 m.
"""

CONVEX = 0.5
"""Distance over the radius of curvature below which a cell or a window is surely convex."""

DEPTH = 64
"""Of the stack: one more than the tree's levels."""


@compiled
def find_nearest(position: Array, hint: Array, first: int, cells: Cells) -> tuple[Array, Array]:
    """Signed distance [m] and arc length [m] of the nearest place, row by row.

    Parameters
    ----------
    position : Array, shape (n, 2 or 3)
        [m].
    hint : Array, shape (n,)
        Arc length of the point commanded [m]: of places equally near the nearest to it counts.
    first : int
        Cell to begin with.
    cells : Cells

    Returns
    -------
    error, s : Array, shape (n,)
    """
    count, spatial = position.shape[0], position.shape[1] > 2
    error, place = np.empty(count), np.empty(count)
    table, window, capsule, nodes, loop, tie = cells
    stack, bounds = np.empty(DEPTH, dtype=np.int64), np.empty(DEPTH)
    cell = home = first
    anchor_x = anchor_y = anchor_z = 0.0
    clear = -math.inf
    for row in range(count):
        x, y = position[row, 0], position[row, 1]
        z = position[row, 2] if spatial else 0.0
        cell, w, distance = _walk(x, y, z, cell, window[home, 0], window[home, 1], table)
        moved = math.sqrt((x - anchor_x) ** 2 + (y - anchor_y) ** 2 + (z - anchor_z) ** 2)
        convex = (distance + table[home, WIDE_REACH]) * table[home, WIDE_BEND] < CONVEX
        if not (convex and distance + tie + moved < clear):
            cell, w, distance = _search(
                x, y, z, hint[row], cell, w, distance, table, capsule, nodes, loop, tie, stack, bounds
            )
            home, anchor_x, anchor_y, anchor_z = cell, x, y, z
            clear = _clearance(x, y, z, window[cell, 0], window[cell, 1], capsule, nodes, stack, bounds)
        place[row] = table[cell, S] + w * table[cell, LENGTH]
        error[row] = distance if _is_left(x, y, cell, w, table, loop) else -distance
    return error, place


@lean
def _walk(x: float, y: float, z: float, cell: int, low: int, high: int, table: Array) -> tuple[int, float, float]:
    """Go down to a minimum inside a window of cells that join smoothly: cell, w in it, and distance."""
    w, distance = _foot(x, y, z, cell, 0.5, table)
    while (w == 1.0 and cell < high) or (w == 0.0 and cell > low):
        step = 1 if w == 1.0 else -1
        next_w, nearer = _foot(x, y, z, cell + step, 1.0 - w, table)
        if not nearer < distance:
            break
        cell, w, distance = cell + step, next_w, nearer
    return cell, w, distance


@lean
def _clearance(
    x: float,
    y: float,
    z: float,
    low: int,
    high: int,
    capsule: Array,
    nodes: IntArray,
    stack: IntArray,
    bounds: Array,
) -> float:
    """Lower bound of the distance to all cells outside low … high."""
    clear, top = math.inf, 1
    stack[0], bounds[0] = capsule.shape[0] - 1, 0.0
    while top > 0:
        top -= 1
        node = stack[top]
        distance = math.sqrt(bounds[top]) - capsule[node, 7]
        if (low <= nodes[node, 2] and nodes[node, 3] <= high) or not distance < clear:
            continue
        if nodes[node, 0] < 0:
            clear = distance
        else:
            top = _descend(x, y, z, node, clear, capsule, nodes, stack, bounds, top)
    return clear


@lean
def _search(
    x: float,
    y: float,
    z: float,
    hint: float,
    guess: int,
    guess_w: float,
    distance: float,
    table: Array,
    capsule: Array,
    nodes: IntArray,
    loop: float,
    tie: float,
    stack: IntArray,
    bounds: Array,
) -> tuple[int, float, float]:
    """Nearest cell, w in it, and distance, no farther than a guess."""
    best, best_w, leaves, top = guess, guess_w, table.shape[0], 1
    stack[0], bounds[0] = capsule.shape[0] - 1, 0.0
    while top > 0:
        top -= 1
        node = stack[top]
        limit = distance + tie + capsule[node, 7]
        if not bounds[top] < limit * limit:
            continue
        if node >= leaves:
            top = _descend(x, y, z, node, distance + tie, capsule, nodes, stack, bounds, top)
        elif node != guess:
            w, d = _foot(x, y, z, node, _chord(x, y, z, node, capsule)[1], table)
            if _prefers(table, loop, tie, hint, node, w, d, best, best_w, distance):
                best, best_w, distance = node, w, d
    return best, best_w, distance


@lean
def _descend(
    x: float,
    y: float,
    z: float,
    node: int,
    within: float,
    capsule: Array,
    nodes: IntArray,
    stack: IntArray,
    bounds: Array,
    top: int,
) -> int:
    """Push those nodes that may hold something near enough, the nearer one last."""
    left, right = nodes[node, 0], nodes[node, 1]
    square, far_square = _chord(x, y, z, left, capsule)[0], math.inf
    if right >= 0:
        far_square = _chord(x, y, z, right, capsule)[0]
    if far_square < square:
        left, right, square, far_square = right, left, far_square, square
    limit = within + capsule[right, 7]
    if far_square < limit * limit:
        stack[top], bounds[top] = right, far_square
        top += 1
    limit = within + capsule[left, 7]
    if square < limit * limit:
        stack[top], bounds[top] = left, square
        top += 1
    return top


@lean
def _chord(x: float, y: float, z: float, node: int, capsule: Array) -> tuple[float, float]:
    """Squared distance from a capsule's chord, and where on the chord."""
    x, y, z = x - capsule[node, 0], y - capsule[node, 1], z - capsule[node, 2]
    a, b, c = capsule[node, 3], capsule[node, 4], capsule[node, 5]
    w = min(max((x * a + y * b + z * c) * capsule[node, 6], 0.0), 1.0)
    x, y, z = x - w * a, y - w * b, z - w * c
    return x * x + y * y + z * z, w


@lean
def _prefers(
    table: Array,
    loop: float,
    tie: float,
    hint: float,
    cell: int,
    w: float,
    distance: float,
    best: int,
    best_w: float,
    least: float,
) -> bool:
    """Return whether another place is nearer, or as near and nearer to the hint.

    Within one minimum only the distance counts: about it, places √(2 d tie) apart are equally near.
    """
    if not abs(distance - least) <= tie:
        return distance < least
    s = table[cell, S] + w * table[cell, LENGTH]
    best_s = table[best, S] + best_w * table[best, LENGTH]
    apart = _along(s, best_s, loop)
    if apart * apart <= 16.0 * tie * (least + tie):
        return distance < least
    return _along(s, hint, loop) < _along(best_s, hint, loop)


@lean
def _along(a: float, b: float, loop: float) -> float:
    """Distance along the path, the short way round a closed one."""
    apart = abs(a - b)
    return min(apart, abs(loop - apart))


@lean
def _slope(x: float, y: float, z: float, w: float, cell: int, table: Array) -> tuple[float, float, float]:
    """Half the squared distance from the cubic at w: its two derivatives, and the squared distance."""
    x = table[cell, 0] - x + w * (table[cell, 3] + w * (table[cell, 6] + w * table[cell, 9]))
    y = table[cell, 1] - y + w * (table[cell, 4] + w * (table[cell, 7] + w * table[cell, 10]))
    z = table[cell, 2] - z + w * (table[cell, 5] + w * (table[cell, 8] + w * table[cell, 11]))
    a = table[cell, 3] + w * (2.0 * table[cell, 6] + 3.0 * w * table[cell, 9])
    b = table[cell, 4] + w * (2.0 * table[cell, 7] + 3.0 * w * table[cell, 10])
    c = table[cell, 5] + w * (2.0 * table[cell, 8] + 3.0 * w * table[cell, 11])
    second = a * a + b * b + c * c
    second += x * (2.0 * table[cell, 6] + 6.0 * w * table[cell, 9])
    second += y * (2.0 * table[cell, 7] + 6.0 * w * table[cell, 10])
    second += z * (2.0 * table[cell, 8] + 6.0 * w * table[cell, 11])
    return x * a + y * b + z * c, second, x * x + y * y + z * z


@lean
def _foot(x: float, y: float, z: float, cell: int, w: float, table: Array) -> tuple[float, float]:
    """Return the closest point of a cell, w and distance, beginning at `w`."""
    first, second, square = _slope(x, y, z, w, cell, table)
    # On a cell the distance grows by `reach` at most. Below half the radius of curvature it is convex.
    if not (math.sqrt(square) + table[cell, REACH]) * table[cell, BEND] < CONVEX:
        return _foot_in_parts(x, y, z, cell, table)
    for _ in range(NEWTON_STEPS):
        new = min(max(w - first / second, 0.0), 1.0)
        step, w = abs(new - w), new
        if step > 0.0:
            first, second, square = _slope(x, y, z, w, cell, table)
        if step < SURE:
            return w, math.sqrt(square)
    return _foot_in_parts(x, y, z, cell, table)


@lean
def _foot_in_parts(x: float, y: float, z: float, cell: int, table: Array) -> tuple[float, float]:
    """Return the closest point of a cell, of all the minima that its parts hold."""
    slope, _, least = _slope(x, y, z, 0.0, cell, table)
    best = 0.0
    for part in range(1, PARTS + 1):
        w = part / PARTS
        next_slope, _, square = _slope(x, y, z, w, cell, table)
        if square < least:
            best, least = w, square
        if slope < 0.0 < next_slope:
            w, square = _bracketed(x, y, z, (part - 1) / PARTS, w, cell, table)
            if square < least:
                best, least = w, square
        slope = next_slope
    return best, math.sqrt(least)


@lean
def _bracketed(x: float, y: float, z: float, low: float, high: float, cell: int, table: Array) -> tuple[float, float]:
    """Minimum between two slopes of opposite sign, w and squared distance: Newton's method, or bisection."""
    w = 0.5 * (low + high)
    first, second, square = _slope(x, y, z, w, cell, table)
    for _ in range(BRACKET_STEPS):
        if first < 0.0:
            low = w
        else:
            high = w
        new = w - first / second if second > 0.0 else low
        if not low < new < high:
            new = 0.5 * (low + high)
        step, w = abs(new - w), new
        first, second, square = _slope(x, y, z, w, cell, table)
        if step < SURE * SURE or first == 0.0:
            break
    return w, square


@lean
def _is_left(x: float, y: float, cell: int, w: float, table: Array, loop: float) -> bool:
    """Return whether (x, y) is to the left of the direction of travel, or straight ahead or behind.

    Where two cells meet the direction is the bisector: right of it is right of both, around a corner too.
    """
    u = table[cell, 3] + w * (2.0 * table[cell, 6] + 3.0 * w * table[cell, 9])
    v = table[cell, 4] + w * (2.0 * table[cell, 7] + 3.0 * w * table[cell, 10])
    if w <= 0.0 or w >= 1.0:
        end, count = int(w), table.shape[0]
        u, v = table[cell, TANGENT + 3 * end], table[cell, TANGENT + 3 * end + 1]
        neighbour = cell + 2 * end - 1
        if loop < math.inf:
            neighbour = (neighbour + count) % count
        if 0 <= neighbour < count:
            u += table[neighbour, TANGENT + 3 - 3 * end]
            v += table[neighbour, TANGENT + 4 - 3 * end]
    x -= table[cell, 0] + w * (table[cell, 3] + w * (table[cell, 6] + w * table[cell, 9]))
    y -= table[cell, 1] + w * (table[cell, 4] + w * (table[cell, 7] + w * table[cell, 10]))
    left: bool = u * y - v * x >= 0.0
    return left
