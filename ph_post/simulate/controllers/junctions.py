"""Speed at which a controller passes the joint between two straight blocks, without a program to run."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from ph_post.dialects.planners import planner_of
from ph_post.simulate.controllers.chords import limits_along
from ph_post.simulate.controllers.corner_rules import corner_rule, corner_speeds
from ph_post.simulate.controllers.legs import ACROSS
from ph_post.simulate.controllers.moves import limit_table
from ph_post.simulate.controllers.planner import KINK, QUARTER, REVERSAL
from ph_post.types import Array, ExactPath, Machine

BLENDING: Final = 0.5
"""Share of the acceleration that LinuxCNC keeps for a block that may be blended with the next."""

SAFE: Final = 0.9
"""Share of the speed of a rounded corner that is counted on."""


def junction_speed(
    machine: Machine,
    before: Array,
    after: Array,
    before_length: Array | float,
    after_length: Array | float,
    *,
    feed: Array | float = math.inf,
    tolerance: float | None = None,
) -> Array:
    """Return the speed at which a machine's controller passes joints between straight blocks.

    It is the bound of the joint itself: whether blocks are long enough to reach it, and to slow down to it, is
    not looked at. Of a planner that follows the path exactly it is its rule. LinuxCNC passes a joint at the speed
    that changes no axis' velocity by more than a tenth of its acceleration in one period, rounds it by an arc, or
    blends it, whichever is fastest; that of its blends is on the safe side.

    Parameters
    ----------
    machine : Machine
        Gives the controller, and the limits of the axes.
    before, after : Array, shape (..., 3)
        Unit vectors in X, Y and Z along the blocks before and behind the joints.
    before_length, after_length : Array or float, shape (...)
        Lengths of the blocks [m].
    feed : Array or float, optional
        Speed that is programmed on both blocks [m/s].
    tolerance : float, optional
        Rounding that the path mode allows [m], 0 for G64 without P, -1 for G61, -2 for G61.1; by default the
        controller's own. Planners that follow the path exactly pass it over.

    Returns
    -------
    Array, shape (...)
        [m/s]

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> x, y = np.eye(3)[:2]
    >>> round(float(junction_speed(read_machine("stepper"), x, y, 0.01, 0.01)), 5)
    0.00261
    """
    shape = np.broadcast_shapes(np.shape(before)[:-1], np.shape(after)[:-1], np.shape(before_length), np.shape(feed))
    one, two = (np.broadcast_to(value, (*shape, 3)).reshape(-1, 3) for value in (before, after))
    lengths = [np.broadcast_to(value, shape).ravel() for value in (before_length, after_length)]
    limits, planner = limit_table(machine), planner_of(machine)
    asked = np.broadcast_to(feed, shape).ravel()
    if isinstance(planner, ExactPath):
        found = _exact(planner, limits, (one, two), (lengths[0], lengths[1]), asked)
    else:
        allowed = planner.tolerance if tolerance is None else tolerance
        found = _rounded(allowed, limits, (one, two), (lengths[0], lengths[1]), asked, machine.servo_period)
    return np.asarray(found.reshape(shape))


Pair = tuple[Array, Array]
"""Of the blocks before and behind joints."""


def _exact(planner: ExactPath, limits: Array, units: Pair, lengths: Pair, feed: Array) -> Array:
    unit = np.ascontiguousarray(np.stack(units, axis=1).reshape(-1, 3))
    length = np.stack(lengths, axis=1).ravel()
    fast, push = limits_along(unit, limits, shared=planner.shared_limits)
    speed = np.minimum(np.repeat(np.maximum(feed, planner.least_feed), 2), fast)
    joined = np.arange(length.size) % 2 == 1
    rule, numbers = corner_rule(planner, float(limits[:2, 1].min()))
    most = np.ascontiguousarray(limits[:, 1])
    return np.sqrt(corner_speeds(rule, numbers, unit, length, speed, push, most, joined)[1::2])


def _rounded(allowed: float, limits: Array, units: Pair, lengths: Pair, feed: Array, period: float) -> Array:
    """LinuxCNC's rules for lines, as :mod:`ph_post.simulate.controllers.planner` has them."""
    one, two = units
    if allowed < -1.0:
        return np.zeros(feed.size)
    (fast1, push1), (fast2, push2) = (limits_along(unit, limits) for unit in units)
    speed1 = np.minimum(np.minimum(feed, fast1), lengths[0] / period)
    speed2 = np.minimum(np.minimum(feed, fast2), lengths[1] / period)
    slower = np.minimum(speed1, speed2)
    kink = (np.abs(two - one) * (slower / period + push2)[:, None] / limits[:, 1]).max(axis=1)
    passed = slower * np.minimum(1.0, KINK / np.maximum(kink, 1e-300))
    if allowed >= 0.0:
        blended = _blended(allowed, (one, two), (push1, push2), lengths, (speed1, speed2))
        arced = _arced(allowed, limits, (one, two), lengths, np.maximum(speed1, speed2))
        passed = np.maximum(passed, SAFE * np.minimum(np.maximum(blended, arced), slower))
    return np.asarray(np.where(((one + two) ** 2).sum(axis=1) < REVERSAL, 0.0, passed))


def _blended(allowed: float, units: Pair, push: Pair, lengths: Pair, speeds: Pair) -> Array:
    """Return the speed in the middle of a blend: the next line starts while the one before slows down."""
    acc = BLENDING * push[0], BLENDING * push[1]
    reach = [np.minimum(np.sqrt(a * 0.5 * length), v) for a, length, v in zip(acc, lengths, speeds, strict=True)]
    time = np.minimum(lengths[0] / reach[0], lengths[1] / reach[1])
    time = np.minimum(time, np.maximum(reach[0] / acc[0], reach[1] / acc[1]))
    half = 0.5 * np.arccos(np.clip(-(units[0] * units[1]).sum(axis=1), -1.0, 1.0))
    bound = np.full(half.size, math.inf)
    if allowed > 0.0:
        bound = 2.0 * np.sqrt(acc[0] * allowed / np.maximum(np.cos(half), 1e-3))
    both = sum(np.minimum(np.minimum(v, time * a), bound) for v, a in zip(reach, acc, strict=True))
    return np.asarray(0.25 * np.sin(half) * both)


def _arced(allowed: float, limits: Array, units: Pair, lengths: Pair, fastest: Array) -> Array:
    """Return the speed on the arc that rounds a corner."""
    one, two = units
    half = 0.5 * np.arccos(np.clip(-(one * two).sum(axis=1), -1.0, 1.0))
    normal = np.cross(one, two)
    size = np.sqrt((normal * normal).sum(axis=1))[:, None]
    inside = np.sqrt(np.maximum(1.0 - (normal / np.where(size > 0.0, size, 1.0)) ** 2, 1e-24))
    fast, push = (limits[:, column] / inside for column in (0, 1))
    shorter = np.minimum(*lengths)
    off = QUARTER * shorter if allowed == 0.0 else np.minimum(QUARTER * shorter, allowed)
    sine = np.minimum(np.sin(half), 1.0 - 1e-12)
    cut = np.minimum(0.5 * shorter, np.cos(half) * off / (1.0 - sine))
    radius = np.tan(half) * cut
    speed = np.minimum(np.sqrt(ACROSS * push.min(axis=1) * radius), np.minimum(fast.min(axis=1), fastest))
    return np.asarray(np.where(size[:, 0] > 0.0, speed, fastest))
