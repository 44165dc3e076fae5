"""Planners of Grbl and Marlin in 50 digits, from their published rules, block by block as a buffer is filled.

Nothing here is shared with ph_post. Lengths are in mm and times in s, as the firmware has them. `planner.c` of Grbl
1.1, `planner.cpp` of Marlin 2.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from mpmath import mp, mpf

mp.dps = 50


@dataclass
class Settings:
    """Limits of the axes, and one rule of corners."""

    rate: tuple
    acceleration: tuple
    deviation: object = None
    jerk: tuple | None = None
    marlin: bool = False
    buffer: int | None = None


@dataclass
class Block:
    """A straight block: its length, unit vector, speed and acceleration."""

    length: object
    unit: list
    speed: object
    acceleration: object


def block(start, end, feed, settings):
    way = [mpf(b) - mpf(a) for a, b in zip(start, end, strict=True)]
    length = mp.sqrt(sum(x * x for x in way))
    unit = [x / length for x in way]
    return Block(length, unit, min(mpf(feed), _along(settings.rate, unit)), _along(settings.acceleration, unit))


def _along(limits, unit):
    return min(mpf(limit) / abs(x) for limit, x in zip(limits, unit, strict=True) if x != 0)


def corner(one, two, settings):
    """Largest speed at the corner between two blocks."""
    bound = min(one.speed, two.speed)
    if settings.jerk is not None:
        return min(_jerk_corner(one, two, settings.jerk), bound)
    cos_theta = -sum(a * b for a, b in zip(one.unit, two.unit, strict=True))
    if cos_theta > mpf("0.999999"):
        return mpf(0)
    if cos_theta < mpf("-0.999999"):
        if not settings.marlin:
            return bound
        cos_theta = mpf("-0.999999")
    change = [b - a for a, b in zip(one.unit, two.unit, strict=True)]
    size = mp.sqrt(sum(x * x for x in change))
    push = _along(settings.acceleration, [x / size for x in change]) if size > 0 else two.acceleration
    if settings.marlin:
        push = min(push, two.acceleration)
    sin_half = mp.sqrt((1 - cos_theta) / 2)
    square = push * mpf(settings.deviation) * sin_half / (1 - sin_half)
    if settings.marlin and two.length < 1 and cos_theta < -mp.sqrt(mpf(1) / 2):
        square = min(square, two.length * push / (mp.pi - mp.acos(cos_theta)))
    return min(mp.sqrt(square), bound)


def _jerk_corner(one, two, jerk):
    """Marlin's classic jerk, as the comments of planner.cpp tell it: coasting or reversal, axis by axis."""
    if two.speed < one.speed:
        leave, shared = [two.speed * x for x in one.unit], two.speed
    else:
        leave, shared = [one.speed * x for x in one.unit], one.speed
    enter = [two.speed * x for x in two.unit]
    factor = mpf(1)
    for k in range(3):
        v_exit, v_entry = leave[k] * factor, enter[k] * factor
        if v_exit > v_entry:
            step = v_exit - v_entry if (v_entry > 0 or v_exit < 0) else max(v_exit, -v_entry)
        else:
            step = v_entry - v_exit if (v_entry < 0 or v_exit > 0) else max(-v_exit, v_entry)
        if step > jerk[k]:
            factor = factor * mpf(jerk[k]) / step
    shared = shared * factor
    safe = []
    for one_block in (one, two):
        speed = one_block.speed
        for k in range(3):
            part = abs(one_block.unit[k]) * speed
            if part > jerk[k]:
                speed = speed * mpf(jerk[k]) / part
        safe.append(speed)
    if min(safe) > shared * mpf("0.99"):
        return safe[1]
    return shared


def entry_speeds(blocks, settings):
    """Speeds at which blocks begin.

    When a block begins, the buffer holds it and as many behind it as there is room for: the speed at its end is
    the largest from which the last of them can still stop.
    """
    count = len(blocks)
    # Squares of speeds, of which a block adds as much to any.
    most = [mpf(0)] + [corner(a, b, settings) ** 2 for a, b in pairwise(blocks)]
    added = [2 * one.acceleration * one.length for one in blocks]
    squares = [mpf(0)]
    for k in range(count - 1):
        last = count if settings.buffer is None else min(count, k + settings.buffer)
        allowed = mpf(0)
        for j in range(last - 1, k, -1):
            allowed = min(most[j], allowed + added[j])
        squares.append(min(allowed, squares[k] + added[k]))
    return [mp.sqrt(square) for square in squares]


def run_time(blocks, speeds):
    """Time of blocks that begin at these speeds; the last ends at rest."""
    total = mpf(0)
    for one, first, last in zip(blocks, speeds, [*speeds[1:], mpf(0)], strict=True):
        a, length = one.acceleration, one.length
        top = min(one.speed, mp.sqrt((first**2 + last**2) / 2 + a * length))
        cruise = length - (2 * top**2 - first**2 - last**2) / (2 * a)
        total += (2 * top - first - last) / a + cruise / top
    return total


def grbl_chords(radius, angle, tolerance):
    """Chords of an arc in Grbl: `mc_arc`, one at least."""
    radius, tolerance = mpf(radius), mpf(tolerance)
    return max(int(mp.floor(abs(angle * radius) / 2 / mp.sqrt(tolerance * (2 * radius - tolerance)))), 1)


def marlin_chords(radius, angle, longest=1, shortest="0.1", per_turn=72):
    """Chords of an arc in Marlin: `plan_arc`."""
    flat, shortest = mpf(radius) * abs(angle), mpf(shortest)
    nominal = max(mp.floor(flat / longest), mp.ceil(per_turn * abs(angle) / (2 * mp.pi)))
    size = flat / nominal
    if size > longest:
        return int(mp.ceil(flat / longest))
    if size < shortest:
        return int(max(1, mp.floor(flat / shortest)))
    return int(nominal)
