"""A part program as the lines and arcs that its controller's planner gets, with the stops between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ph_post.gcode.controller.legs import Legs, make_legs
from ph_post.gcode.controller.linking import linked_ends
from ph_post.gcode.controller.splines import with_splines
from ph_post.gcode.reader.record import ARC, AXES, LINE, PLANE_AXES, RAPID, PartProgram
from ph_post.types import Array, BoolArray, IntArray, Limits, Machine

SHORTEST: Final = 1e-15
"""Moves up to this [m] are none."""

STOPS_BEFORE: Final = (3, 4, 5, 6, 7, 8, 9, 19, 61, 66)
"""M words that wait until the axes stand, and are carried out before the motion on their line."""

STOPS_AFTER: Final = (0, 1, 2, 30, 60)
"""M words that are carried out behind the motion on their line."""


def limits_of(machine: Machine) -> tuple[Limits, Limits, Limits]:
    """Limits of X, Y and Z; an axis that the machine has not has those of its fastest."""
    fastest = max((axis.limits for axis in machine.axes.values()), key=lambda one: one.velocity)
    x, y, z = (machine.axes[name].limits if name in machine.axes else fastest for name in AXES)
    return x, y, z


def limit_table(machine: Machine) -> Array:
    """Velocity [m/s] and acceleration [m/s²] of X, Y and Z, shape (3, 2)."""
    return np.array([(one.velocity, one.acceleration) for one in limits_of(machine)])


def moves_of(program: PartProgram, limits: Array) -> Legs:
    """List the moves that the planner gets of a program: those that have a length, flat ones linked.

    Parameters
    ----------
    program : PartProgram
    limits : Array, shape (3, 2)
        Of :func:`limit_table`.
    """
    return _with_length(_linked(programmed(program, limits), program, limits))


def moved_axes(program: PartProgram) -> tuple[str, ...]:
    """Name the axes that a program moves, or sends somewhere from where it does not know."""
    start, end = program.motions.start, program.motions.end
    moves = ((start != end) & ~np.isnan(end)).any(axis=0)
    for number, (first, second, _) in PLANE_AXES.items():
        turns = (program.motions.kind == ARC) & (program.motions.plane == number)
        moves[[first, second]] |= bool(turns.any())
    return tuple(name for name, does in zip(AXES, moves, strict=True) if does)


def programmed(program: PartProgram, limits: Array) -> Legs:
    """List the motions of a program as they are written: a leg each, several for a spline."""
    return with_splines(_written(program, limits), program, limits)


def _written(program: PartProgram, limits: Array) -> Legs:
    """Make one leg of every motion, a straight one of a spline."""
    start, end = _ends(program)
    legs = make_legs(len(start))
    legs.motion[:], legs.share1[:] = np.arange(len(start)), 1.0
    legs.rapid[:] = program.motions.kind == RAPID
    straight = program.motions.kind != ARC
    _put_lines(legs, straight, start, end, limits)
    _put_arcs(legs, np.flatnonzero(~straight), program, start, end, limits)
    _put_feeds(legs, program)
    legs.tolerance[:] = tolerances(program)
    _put_stops(legs, program)
    return legs


def _ends(program: PartProgram) -> tuple[Array, Array]:
    """Where motions begin and end [m]; what is not known at the beginning is the machine's origin."""
    start, end = program.motions.start, program.motions.end
    return np.nan_to_num(start), np.nan_to_num(end)


def _linked(legs: Legs, program: PartProgram, limits: Array) -> Legs:
    """Let the controller make one line of several."""
    start, end = _ends(program)
    motions = program.motions
    found = np.array([linking_of(state.path, state.units) for state in program.modal] or [0.0])
    linking = found[program.state[motions.block]] if motions.block.size else np.zeros(0)
    if not linking.any():
        return legs
    flat = _flat(legs, program, linking) * (1 + (legs.drains > 0.0))
    kept = linked_ends(start, end, linking, np.where(motions.duration > 0.0, legs.speed, motions.feed), flat)
    last = np.flatnonzero(kept)
    first = np.concatenate([[0], last[:-1] + 1])
    rows = (last > first) | (_flat(legs, program, linking)[last] == 1)
    joined = Legs(*(column[last].copy() for column in legs))
    lines = make_legs(last.size)
    everywhere = np.ones(last.size, dtype=bool)
    _put_lines(lines, everywhere, start[first], end[last], limits)
    for name in ("origin", "first", "length", "most", "push", "radius"):
        getattr(joined, name)[rows] = getattr(lines, name)[rows]
    joined.pause[:], joined.drains[:] = legs.pause[first], legs.drains[first]
    joined.speed[:] = np.where(rows, np.minimum(legs.speed[last], joined.most), joined.speed)
    return joined


def _flat(legs: Legs, program: PartProgram, linking: Array) -> IntArray:
    """Lines at feed, and arcs so flat that they are taken for lines: 1, others 0."""
    motions = program.motions
    height = legs.radius * (1.0 - np.cos(0.5 * motions.angle))
    arcs = (motions.kind == ARC) & (motions.plane == 17) & (np.abs(motions.angle) < math.pi)
    flat = (arcs & (height < linking)) | ((motions.kind == LINE) & (linking > 0.0))
    return np.asarray(flat, dtype=np.int64)


def _put_lines(legs: Legs, rows: BoolArray, start: Array, end: Array, limits: Array) -> None:
    way = end - start
    length = np.sqrt((way * way).sum(axis=1))
    whole = np.where(length > 0.0, length, 1.0)
    legs.origin[:], legs.length[:] = start, np.where(rows, length, 0.0)
    legs.first[:] = way / whole[:, None]
    legs.most[:], legs.push[:] = (_reach(way, length, limits[:, k]) for k in range(2))


def _reach(way: Array, length: Array, limit: Array) -> Array:
    """Largest speed or acceleration along a straight way, shape (n,)."""
    time = (np.abs(way) / limit).max(axis=1)
    return np.asarray(length / np.where(time > 0.0, time, 1.0))


def _put_arcs(
    legs: Legs, rows: IntArray, program: PartProgram, start: Array, end: Array, limits: Array
) -> None:
    """Write arcs and helices: half of what the worse axis of the plane can is theirs everywhere."""
    motions = program.motions
    for plane, (a, b, c) in PLANE_AXES.items():
        here = rows[motions.plane[rows] == plane]
        if here.size == 0:
            continue
        center, sweep = motions.center[here], motions.angle[here]
        ray = start[here][:, [a, b]] - center
        radius = np.hypot(ray[:, 0], ray[:, 1])
        rise = end[here][:, c] - start[here][:, c]
        for k, column in enumerate((a, b)):
            legs.origin[here, column] = center[:, k]
            legs.first[here, column] = ray[:, k] / radius
        legs.origin[here, c], legs.rise[here, c] = start[here][:, c], rise
        legs.first[here, c] = 0.0
        legs.second[here, a], legs.second[here, b] = -ray[:, 1] / radius, ray[:, 0] / radius
        legs.radius[here], legs.sweep[here] = radius, sweep
        flat = radius * np.abs(sweep)
        legs.length[here] = np.hypot(flat, rise)
        _put_arc_limits(legs, here, flat, end[here] - start[here], limits, (a, b))


def _put_arc_limits(
    legs: Legs, here: IntArray, flat: Array, way: Array, limits: Array, axes: Sequence[int]
) -> None:
    velocity, push = limits[list(axes)].min(axis=0)
    planar = np.minimum(np.sqrt(push * math.sqrt(0.75) * legs.radius[here]), velocity)
    slowest = np.maximum((np.abs(way) / limits[:, 0]).max(axis=1), flat / planar)
    weakest = np.maximum((np.abs(way) / limits[:, 1]).max(axis=1), flat / push)
    legs.most[here], legs.push[here] = legs.length[here] / slowest, legs.length[here] / weakest


def _put_feeds(legs: Legs, program: PartProgram) -> None:
    """Write the speeds asked for: those of F, of the time under G93, and all that the axes give in rapids."""
    motions = program.motions
    timed = motions.duration > 0.0
    feed = np.where(timed, legs.length / np.where(timed, motions.duration, 1.0), motions.feed)
    free = (legs.rapid == 1.0) | ~(feed > 0.0)
    legs.speed[:] = np.where(free, legs.most, np.minimum(feed, legs.most))


def tolerances(program: PartProgram) -> Array:
    """How far the corner behind each motion may be rounded [m]: as :func:`tolerance_of` says."""
    found = np.array([tolerance_of(state.path, state.units) for state in program.modal] or [0.0])
    if not program.motions.block.size:
        return np.zeros(0)
    return np.asarray(found[program.state[program.motions.block]])


def tolerance_of(path: str | None, units: float) -> float:
    """Read a path mode: the P of G64 [m], 0 where it has none or no mode is named, -1 for G61, -2 for G61.1.

    Examples
    --------
    >>> [tolerance_of(text, 1e-3) for text in ("G64 P0.01 Q0", "G61", "G61.1", None)]
    [1e-05, -1.0, -2.0, 0.0]
    """
    if path is not None and path.startswith("G61"):
        return -2.0 if path.startswith("G61.1") else -1.0
    return _number(path, "P") * units


def linking_of(path: str | None, units: float) -> float:
    """Read how far lines of one feed may leave what is made one of them [m]: Q of G64, or else its P."""
    if path is None or not path.startswith("G64"):
        return 0.0
    return _number(path, "Q" if "Q" in path else "P") * units


def _number(path: str | None, letter: str) -> float:
    for word in (path or "").split():
        if word.startswith(letter):
            return float(word[1:])
    return 0.0


def _put_stops(legs: Legs, program: PartProgram) -> None:
    """Mark the moves before which the planner runs dry, and how long the axes rest there."""
    words, block = program.words, program.motions.block
    letter, value = words.letter, words.value
    m_words = letter == ord("M")
    before = (letter == ord("S")) | (m_words & np.isin(value, STOPS_BEFORE))
    for rows, side in ((before, "left"), (m_words & np.isin(value, STOPS_AFTER), "right")):
        _drain(legs, np.searchsorted(block, words.block[rows], side=side))  # type: ignore[call-overload]
    _drain(legs, np.array([one.motion for one in program.breaks], dtype=np.int64))
    lines, seconds = program.dwells()
    at = np.searchsorted(block, lines, side="left")
    _drain(legs, at)
    inside = at < legs.pause.size
    np.add.at(legs.pause, at[inside], np.nan_to_num(seconds[inside]))


def _drain(legs: Legs, moves: IntArray) -> None:
    legs.drains[moves[moves < legs.drains.size]] = 1.0


def _with_length(legs: Legs) -> Legs:
    """Drop moves that go nowhere; the stops before them stand before the next."""
    kept = np.flatnonzero(legs.length > SHORTEST)
    if kept.size == legs.length.size:
        return legs
    owner = np.minimum(np.searchsorted(kept, np.arange(legs.length.size)), max(kept.size - 1, 0))
    pause, drains = np.zeros(kept.size), np.zeros(kept.size)
    if kept.size:
        inside = np.arange(legs.length.size) <= kept[-1]
        np.add.at(pause, owner[inside], legs.pause[inside])
        np.maximum.at(drains, owner[inside], legs.drains[inside])
    taken = Legs(*(column[kept] for column in legs))
    return taken._replace(pause=pause, drains=drains)
