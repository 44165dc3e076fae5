"""The motion of every servo period: the legs that :mod:`ph_post.simulate.controllers.planner` has planned are run.

A leg takes the step that ends it at the speed which the next one begins with; a blend runs two at a time.
"""

from __future__ import annotations

import math

import numpy as np

from ph_post.compiling import compiled, lean
from ph_post.simulate.controllers.legs import BLEND, DRAINS, EXACT, MOTION, RAPID, SHARE0, SHARE1, STOP, TANGENT
from ph_post.simulate.controllers.planner import (
    ACTIVE,
    CYCLE,
    DONE,
    END,
    FINAL,
    LATCHED,
    LEAST_SPEED,
    LEAST_TIME,
    LENGTH,
    MOST,
    RAMP,
    REMOVE,
    SLOWING,
    SPEED,
    SPLIT,
    TERM_V,
    V,
    along,
    blend_speeds,
    place_of,
    tangent_of,
)
from ph_post.types import Array, IntArray

RAMP_TIME = 0.01
"""Legs shorter than this [s] change their speed evenly from end to end."""

LEAST_LENGTH = 1e-15
"""[m]: what is left at the end of a leg counts as nothing."""


@lean
def _final_speed(table: Array, row: int, after: int) -> float:
    """Speed with which a leg is to end."""
    if table[row, END] != TANGENT or after < 0:
        return 0.0
    bound = min(table[row, SPEED], table[row, MOST], table[after, SPEED], table[after, MOST])
    final: float = min(table[row, FINAL], bound)
    return final


@lean
def _towards(table: Array, row: int, after: int) -> tuple[float, float]:
    """Acceleration of a leg in the next step, and the speed it is after."""
    left = table[row, LENGTH] - table[row, DONE]
    speed, final, most = table[row, V], _final_speed(table, row, after), along(table, row)
    step = table[row, CYCLE]
    if table[row, RAMP] > 0.0 and table[row, END] == TANGENT and final >= LEAST_SPEED:
        mean = 0.5 * (speed + final)
        time = max(left / mean, 1e-16) if mean > LEAST_SPEED else 1e-16
        return min(max((final - speed) / time, -most), most), final
    half = 0.5 * most * step
    inside = final * final + most * (2.0 * left - speed * step) + half * half
    reachable = -half + (math.sqrt(inside) if inside > half * half else 0.0)
    asked = min(table[row, SPEED], table[row, MOST])
    aim = min(max(reachable, -asked), asked)
    return min(max((aim - speed) / max(step, LEAST_TIME), -most), most), reachable


@lean
def _step(table: Array, row: int, after: int, period: float) -> None:
    """Take a leg one step on, and see whether it will end within the next period."""
    acc, wanted = _towards(table, row, after)
    speed, step = table[row, V], table[row, CYCLE]
    new = speed + acc * step
    if new < 0.0:
        new = 0.0
        if table[row, LENGTH] - table[row, DONE] < speed * step:
            table[row, DONE] = table[row, LENGTH]
    else:
        table[row, DONE] = min(max(table[row, DONE] + 0.5 * (new + speed) * step, 0.0), table[row, LENGTH])
    table[row, V] = new
    table[row, SLOWING] = 1.0 if abs(wanted - new) < LEAST_SPEED and acc < 0.0 else 0.0
    _see_end(table, row, after, period)


@lean
def _see_end(table: Array, row: int, after: int, period: float) -> None:
    """Mark a leg that will end within the next period, with the time and the speed it ends with."""
    table[row, CYCLE] = period
    left, speed = table[row, LENGTH] - table[row, DONE], table[row, V]
    if left <= LEAST_LENGTH:
        table[row, DONE] = table[row, LENGTH]
        table[row, SPLIT], table[row, CYCLE], table[row, TERM_V] = 1.0, 0.0, speed
        if table[row, END] in (STOP, EXACT):
            table[row, REMOVE] = 1.0
        return
    if table[row, END] in (STOP, EXACT):
        return
    final = _final_speed(table, row, after)
    mean = 0.5 * (speed + final)
    time = 0.5 * LEAST_TIME
    if mean > LEAST_SPEED:
        time = max(time, left / mean)
    elif left > mean * period:
        return
    most = along(table, row)
    acc = (final - speed) / time
    if abs(acc) > most:
        acc = math.copysign(most, acc)
        inside = (speed / acc) ** 2 + 2.0 / acc * left
        if inside < 0.0:
            return
        root = math.sqrt(inside) if inside >= LEAST_TIME * LEAST_TIME else 0.0
        time = -speed / acc + (root if acc > 0.0 else -root)
        final = speed + time * acc
    if time < LEAST_TIME:
        table[row, DONE] = table[row, LENGTH]
        time = 0.0
    if time < period:
        table[row, SPLIT], table[row, CYCLE], table[row, TERM_V] = 1.0, time, final


@lean
def _activate(table: Array, row: int, rapid: float) -> None:
    """Choose how a leg changes its speed when it begins: evenly where it is short."""
    table[row, ACTIVE] = 1.0
    table[row, LATCHED] = table[row, SLOWING] = 0.0
    aim = table[row, V] + min(table[row, FINAL], table[row, SPEED], table[row, MOST])
    left = 2.0 * (table[row, LENGTH] - table[row, DONE])
    if rapid == 0.0 and table[row, END] == TANGENT and left < RAMP_TIME * aim:
        table[row, RAMP] = 1.0


@lean
def _cycle(legs: Array, table: Array, row: int, end: int, tangents: Array, period: float) -> int:
    """Run the planner for one period; the leg that is active then."""
    after = row + 1 if row + 1 < end else -1
    if table[row, ACTIVE] == 0.0:
        _activate(table, row, legs[row, RAPID])
    if table[row, SPLIT] > 0.0 and table[row, REMOVE] == 0.0:
        used = table[row, CYCLE]
        table[row, DONE], table[row, REMOVE] = table[row, LENGTH], 1.0
        if after >= 0:
            if table[row, END] == TANGENT:
                table[after, CYCLE], table[after, V] = period - used, table[row, TERM_V]
            _step(table, after, after + 1 if after + 1 < end else -1, period)
    elif table[row, REMOVE] == 0.0:
        table[row, CYCLE] = period
        _step(table, row, after, period)
        if after >= 0 and table[row, END] == BLEND:
            tangent_of(legs, row, True, tangents[0])
            tangent_of(legs, after, False, tangents[1])
            bound = blend_speeds(legs, table, row, tangents[0], tangents[1], 1.0)[0]
            if table[row, SLOWING] > 0.0 and table[row, V] < bound:
                table[row, LATCHED] = 1.0
            if table[row, LATCHED] > 0.0:
                _step(table, after, -1, period)
    return row + 1 if table[row, REMOVE] > 0.0 else row


@compiled
def run_legs(
    legs: Array,
    table: Array,
    count: int,
    period: float,
    rests: IntArray,
    row0: int,
    state: Array,
    place: Array,
    motion: IntArray,
    share: Array,
) -> tuple[int, int]:
    """Run the planner's queue, a row a period.

    Parameters
    ----------
    legs, table : of :func:`plan_legs`
    count : int
        Number of legs.
    period : float
    rests : IntArray, shape (count,)
        Periods for which the axes rest before each leg.
    row0 : int
        Leg to go on with.
    state : Array, shape (5,)
        Where the axes are (3), periods of rest that are done, and the last motion.
    place, motion, share : Array, shape (room, 3) and (room,)
        Filled: position [m], motion, and how much of it is done.

    Returns
    -------
    leg, rows : int
        The leg to go on with, `count` where all are done, and the rows that were filled.
    """
    room, filled, row = motion.size, 0, row0
    tangents = np.empty((2, 3))
    at = np.empty(3)
    while row < count and filled < room:
        if rests[row] > state[3]:
            state[3] += 1.0
            for k in range(3):
                place[filled, k] = state[k]
            motion[filled], share[filled] = int(state[4]), 1.0
            filled += 1
            continue
        end = row + 1
        while end < count and legs[end, DRAINS] == 0.0 and end < row + 3:
            end += 1
        new = _cycle(legs, table, row, end, tangents, period)
        for k in range(3):
            at[k] = place_of(legs, row, table[row, DONE], k)
            if row + 1 < end and table[row + 1, DONE] > 0.0:
                at[k] += place_of(legs, row + 1, table[row + 1, DONE], k) - place_of(legs, row + 1, 0.0, k)
        for k in range(3):
            place[filled, k] = state[k] = at[k]
        lead = row + 1 if row + 1 < end and table[row + 1, DONE] > 0.0 and new > row else row
        part = table[lead, DONE] / table[lead, LENGTH]
        motion[filled] = int(legs[lead, MOTION])
        share[filled] = legs[lead, SHARE0] + part * (legs[lead, SHARE1] - legs[lead, SHARE0])
        state[4] = motion[filled]
        filled += 1
        if new > row:
            state[3] = 0.0
            row = new
    return row, filled
