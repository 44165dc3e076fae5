"""The moves that a controller gets of a part program: legs with limits, feeds, dwells and stops, and linked lines.

LinuxCNC's NaiveCAM makes one line of lines of one feed that are within a tolerance of it, and takes flat arcs in
the XY plane for lines, too. A feed on every line, or ``Q0``, keeps it from linking.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ph_post.compiling import compiled, lean
from ph_post.gcode.program import ARC, AXES, LINE, PLANE_AXES, RAPID, PartProgram
from ph_post.simulate.controllers.legs import ACROSS, SHORTEST, Legs, make_legs, with_splines
from ph_post.simulate.controllers.unknown import known_ends
from ph_post.types import Array, BoolArray, IntArray, Limits, Machine, RoundedPath, unwritten

MOST_LINKED = 101
"""Lines that become one at most."""

LEAST_WAY: Final = 1e-9
"""Way [m] that a move has at least where lines are told apart that became one."""


@compiled
def linked_ends(starts: Array, ends: Array, linking: Array, feed: Array, flat: IntArray) -> IntArray:
    """Find the moves at whose end a line ends that the planner gets.

    Parameters
    ----------
    starts, ends : Array, shape (n, 3)
        Of the moves of the program [m].
    linking : Array, shape (n,)
        How far each may leave the line it becomes part of [m]; 0 where nothing is linked.
    feed : Array, shape (n,)
        What F says [m/s]; only equal ones are linked.
    flat : IntArray, shape (n,)
        1 for the lines, and the arcs that are taken for lines; 2 for those behind a stop.

    Returns
    -------
    IntArray, shape (n,)
        1 where the planner gets a move, 0 where it only gets it together with the next.
    """
    count = linking.size
    kept = np.ones(count, dtype=np.int64)
    first = 0
    for row in range(1, count):
        joins = flat[row] == 1 and flat[row - 1] > 0 and row - first < MOST_LINKED
        joins = joins and linking[row] > 0.0 and linking[row] == linking[row - 1] and feed[row] == feed[row - 1]
        if joins and _is_near(starts[first], ends, first, row, linking[row]):
            kept[row - 1] = 0
        else:
            first = row
    return kept


@lean
def _is_near(start: Array, ends: Array, first: int, last: int, tolerance: float) -> bool:
    """Return whether the ends of moves are within a tolerance of the line from `start` to the end of the last."""
    square = 0.0
    for k in range(3):
        square += (ends[last, k] - start[k]) ** 2
    if square == 0.0:
        return False
    for row in range(first, last):
        part, off = 0.0, 0.0
        for k in range(3):
            part += (ends[last, k] - start[k]) * (ends[row, k] - start[k]) / square
        part = min(max(part, 0.0), 1.0)
        for k in range(3):
            off += (ends[row, k] - start[k] - part * (ends[last, k] - start[k])) ** 2
        if off > tolerance * tolerance:
            return False
    return True


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


def moves_of(program: PartProgram, limits: Array, planner: RoundedPath | None = None) -> Legs:
    """List the moves that LinuxCNC's planner gets of a program: those that have a length, flat ones linked.

    Parameters
    ----------
    program : PartProgram
    limits : Array, shape (3, 2)
        Of :func:`limit_table`.
    planner : RoundedPath, optional

    Returns
    -------
    Legs
    """
    legs = programmed(program, limits)
    if planner is not None:
        legs.tolerance[:] = tolerances(program, planner)[legs.motion.astype(np.int64)]
        legs.pause[:] = planner.dwell(legs.pause)
    return _with_length(_linked(legs, program, limits, 0.0 if planner is None else planner.tolerance))


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
    return with_splines(written_legs(program, limits), program, limits)


def written_legs(program: PartProgram, limits: Array) -> Legs:
    """Make one leg of every motion of a program, a straight one of a spline; `limits` of :func:`limit_table`."""
    legs = bare_legs(program, limits, *known_ends(program))
    legs.tolerance[:] = tolerances(program)
    legs.pause[:], legs.drains[:] = stops_before(program)
    return legs


def bare_legs(program: PartProgram, limits: Array, start: Array, end: Array) -> Legs:
    """Make the legs of motions from starts to ends (n, 3) [m], without tolerances and stops."""
    legs = make_legs(len(start))
    legs.motion[:], legs.share1[:] = np.arange(len(start)), 1.0
    legs.rapid[:] = program.motions.kind == RAPID
    straight = program.motions.kind != ARC
    _put_lines(legs, straight, start, end, limits)
    _put_arcs(legs, np.flatnonzero(~straight), program, start, end, limits)
    _put_feeds(legs, program)
    return legs


def _linked(legs: Legs, program: PartProgram, limits: Array, otherwise: float) -> Legs:
    """Let the controller make one line of several; within `otherwise` [m] where no path mode is named."""
    start, end = known_ends(program)
    motions, linking = program.motions, linkings(program, otherwise)
    # Splines are many legs each: lines beside them are taken as they are.
    if not linking.any() or len(legs.motion) != len(motions.kind):
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
    # The moves before the last are shares of it below 0.
    ways = _ways(start, end)
    joined.share0[:] = (ways[first] - ways[last]) / (ways[last + 1] - ways[last])
    joined.pause[:], joined.drains[:] = legs.pause[first], legs.drains[first]
    # What F asks for is not the last move's own speed: one that goes nowhere has none.
    asked = np.where(motions.duration[last] > 0.0, legs.speed[last], motions.feeds.of(last))
    free = (legs.rapid[last] == 1.0) | ~(asked > 0.0)
    joined.speed[:] = np.where(rows, np.where(free, joined.most, np.minimum(asked, joined.most)), joined.speed)
    return joined


def _ways(start: Array, end: Array) -> Array:
    """Ways (n + 1,) [m] from the beginning to the end of each move, from places (n, 3) to others."""
    return np.concatenate([[0.0], np.cumsum(np.maximum(np.sqrt(((end - start) ** 2).sum(axis=1)), LEAST_WAY))])


def own_moves(program: PartProgram, motion: IntArray, share: Array) -> tuple[IntArray, Array]:
    """Find the moves (m,) that rows of linked ones belong to, and their shares (m,) of these."""
    linked = np.flatnonzero(share < 0.0)
    if not linked.size:
        return motion, share
    ways, last = _ways(*known_ends(program)), motion[linked]
    way = ways[last] + share[linked] * (ways[last + 1] - ways[last])
    own = np.searchsorted(ways, way, side="right") - 1
    motion[linked], share[linked] = own, (way - ways[own]) / (ways[own + 1] - ways[own])
    return motion, share


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
    for column, limit in ((legs.most, limits[:, 0]), (legs.push, limits[:, 1])):
        time = (np.abs(way) / limit).max(axis=1)
        column[:] = length / np.where(time > 0.0, time, 1.0)


def _put_arcs(legs: Legs, rows: IntArray, program: PartProgram, start: Array, end: Array, limits: Array) -> None:
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


def _put_arc_limits(legs: Legs, here: IntArray, flat: Array, way: Array, limits: Array, axes: Sequence[int]) -> None:
    velocity, push = limits[list(axes)].min(axis=0)
    planar = np.minimum(np.sqrt(push * ACROSS * legs.radius[here]), velocity)
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


_UNBOUNDED: Final = RoundedPath()


def tolerances(program: PartProgram, planner: RoundedPath = _UNBOUNDED) -> Array:
    """Return the rounding allowed at the corner behind each motion [m], see :func:`tolerance_of`.

    Where the program names no path mode, it is that of the planner.
    """
    own = {None, "G64"} if planner.bounded else {None}
    modes = [
        planner.tolerance if state.path in own else tolerance_of(state.path, state.units) for state in program.modal
    ]
    found = np.array(modes or [planner.tolerance])
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


def linkings(program: PartProgram, otherwise: float) -> Array:
    """Return :func:`linking_of` for each motion [m], (m,); `otherwise` [m] where the program names no path mode."""
    within = [otherwise if state.path is None else linking_of(state.path, state.units) for state in program.modal]
    found = np.array(within or [0.0])
    return np.asarray(found[program.state[program.motions.block]]) if program.motions.block.size else np.zeros(0)


def _number(path: str | None, letter: str) -> float:
    for word in (path or "").split():
        if word.startswith(letter):
            return float(word[1:])
    return 0.0


def waits_for_speed(program: PartProgram, *, exact: bool) -> BoolArray:
    """Return a mask of the commands of a program (k,) at which the axes wait for the speed of the spindle.

    On an `exact` path they do where an S changes it (Grbl's `gcode.c`, "Set spindle speed"): each line of a laser's
    program may say it again.
    """
    words = program.commands
    found = np.asarray(words.letter == ord("S"))
    if exact:
        rows = np.flatnonzero(found & (words.block > 0))
        speeds = np.array([np.nan if one.speed is None else one.speed for one in program.modal])
        found[rows] = speeds[program.state[words.block[rows] - 1]] != words.value[rows]
    return found


def stops_before(program: PartProgram, *, exact: bool = False) -> tuple[Array, Array]:
    """Return how long the axes rest before each motion [s], and 1 where the planner runs dry before it, 0 elsewhere."""
    words, block = program.commands, program.motions.block
    pause, drains = unwritten(block.size), unwritten(block.size)
    letter, value = words.letter, words.value
    m_words = letter == ord("M")
    before = waits_for_speed(program, exact=exact) | (m_words & np.isin(value, STOPS_BEFORE))
    for rows, side in ((before, "left"), (m_words & np.isin(value, STOPS_AFTER), "right")):
        _drain(drains, np.searchsorted(block, words.block[rows], side=side))  # type: ignore[call-overload]
    _drain(drains, np.array([one.motion for one in program.breaks], dtype=np.int64))
    lines, seconds = program.dwells()
    lines, seconds = np.append(lines, [*program.rests]), np.append(seconds, [*program.rests.values()])
    at = np.searchsorted(block, lines, side="left")
    _drain(drains, at)
    inside = at < pause.size
    np.add.at(pause, at[inside], np.nan_to_num(seconds[inside]))
    return pause, drains


def _drain(drains: Array, moves: IntArray) -> None:
    drains[moves[moves < drains.size]] = 1.0


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
