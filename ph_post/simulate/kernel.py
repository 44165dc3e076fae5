"""The compiled engine: exact steps of linear modes, and the instants at which one mode gives way to another.

A step of any length is a sum of steps of h/2^k, whose matrices are made beforehand; so the instant at which a
guard changes sign is found by bisection with exact states, without exponentials and without an iteration
that could fail. The stepped matrix is D = exp(A t) - 1, so that short steps lose nothing.
"""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np

from ph_post.compiling import compiled, inner, lean
from ph_post.drive.automaton import STATES, WIDTH
from ph_post.types import Array, BoolArray, IntArray

LEVELS: Final = 30
"""Halvings of the sampling period: an instant is known to h/2^30."""

FINE: Final = 5
"""Halvings down to which a sample is looked at where a guard may dip below zero and come back."""

FORCED: Final = 3
"""Most halvings of a sample for friction that the speed changes: it is taken as linear over each part."""

STRAIGHT: Final = 1e-11
"""Error of such a force, F/K [m], up to which a sample is not halved for it."""

TURN: Final = 0.1
"""Radians of a cogging wave over which its parabola is as good as the wave: wrong by 1e-5 of its size."""

MOST_CHANGES: Final = 100
"""Changes of mode within one sample after which the rest of it is run without guards, and said to chatter."""

CHATTERS: Final = -1
"""The mode that stands in the log for that."""

BEND: Final = 4.0 / 27.0
"""Largest value on [0, 1] of the cubic with slope 1 at one end, and else 0 there and at the other."""

SETTLED: Final = 60
"""Most rounds in which the table is found behind a gap, as in :mod:`ph_post.drive.plant`."""


Column = IntEnum(
    "Column",
    "TABLE TABLE_SPEED MOTOR MOTOR_SPEED INTEGRAL CURRENT COMMAND COMMAND_RATE ONE G G_RATE Q Q_RATE HALF_GAP "
    "FED FED_RATE F F_RATE",
    start=0,
)
"""Columns of a row: states and inputs as :mod:`ph_post.drive.automaton` has them, and F, the part of g from outside."""

COLUMNS: Final = len(Column)

STRETCH: Final = 64
"""Samples at most whose guards are looked at together."""

FAST: Final = 6.5
"""Times the speed over which Stribeck friction dies out beyond which nothing is left of it: exp(-42) is 4e-19."""

SHORT: Final = 8
"""Samples of the first stretch of a mode: what is run behind the end of a mode is run in vain."""

END_OF_COMMAND, END_OF_FORCE, END_OF_FED = COLUMNS, COLUMNS + 1, COLUMNS + 2
"""Rows of a stretch behind those of the columns: the inputs at the ends of its samples."""

TABLE, PLAY, SPRING = 0, 1, 2
"""The body that holds motor and table a gap apart while they touch: the table, the motor, or either."""


@lean
def _square(d: Array, into: Array) -> None:
    """Square D; its rows of the inputs, each of which only runs on by the next, have no square."""
    into[:] = 0.0
    for i in range(STATES):
        for j in range(WIDTH):
            total = 0.0
            for k in range(STATES):
                total += d[i, k] * d[k, j]
            into[i, j] = total
        for k in range(STATES, WIDTH - 1):
            into[i, k + 1] += d[i, k] * d[k, k + 1]


@compiled
def step_tables(rates: Array, period: float) -> Array:
    """Return D = exp(A h/2^k) - 1, its rows of the states, shape (modes, LEVELS + 1, STATES, WIDTH).

    From a short series at the shortest step by doubling, D(2t) = D(t)² + 2 D(t), which does not cancel.
    """
    modes = rates.shape[0]
    tables = np.empty((modes, LEVELS + 1, STATES, WIDTH))
    d, once = np.empty((WIDTH, WIDTH)), np.empty((WIDTH, WIDTH))
    for mode in range(modes):
        short = period / 2.0**LEVELS
        for i in range(WIDTH):
            for j in range(WIDTH):
                d[i, j] = rates[mode, i, j] * short
        _square(d, once)
        for i in range(WIDTH):
            for j in range(WIDTH):
                d[i, j] += 0.5 * once[i, j]
        for level in range(LEVELS, -1, -1):
            for i in range(STATES):
                for j in range(WIDTH):
                    tables[mode, level, i, j] = d[i, j]
            _square(d, once)
            for i in range(WIDTH):
                for j in range(WIDTH):
                    d[i, j] = once[i, j] + 2.0 * d[i, j]
    return tables


@compiled
def places_of(rows: Array) -> IntArray:
    """Return the numbers of the columns of each row that are not 0, in order, and -1 behind them."""
    found = np.full(rows.shape, -1, dtype=np.int64)
    for mode in range(rows.shape[0]):
        for number in range(rows.shape[1]):
            count = 0
            for column in range(rows.shape[2]):
                if rows[mode, number, column] != 0.0:
                    found[mode, number, count] = column
                    count += 1
    return found


@compiled
def used_columns(tables: Array, active: BoolArray) -> IntArray:
    """Return which columns the steps of each mode need, in order and with -1 behind: shape (modes, WIDTH + 1).

    Those are columns of :func:`step_tables` that are not 0, of states and of inputs that are `active` (WIDTH,).
    """
    used = np.full((tables.shape[0], WIDTH + 1), -1, dtype=np.int64)
    for mode in range(tables.shape[0]):
        count = 0
        for column in range(WIDTH):
            if not active[column]:
                continue
            filled = False
            for level in range(LEVELS + 1):
                for i in range(STATES):
                    filled = filled or tables[mode, level, i, column] != 0.0
            if filled:
                used[mode, count] = column
                count += 1
    return used


@lean
def stribeck(speed: float, direction: int, static: float, scale: float) -> float:
    """Return what friction has more than Coulomb's while slipping at a speed, F/K [m]."""
    if direction == 0 or static == 0.0 or scale == 0.0:
        return 0.0
    ratio = speed / scale
    return direction * static * math.exp(-ratio * ratio)


@lean
def cogging(motor: float, waves: Array) -> float:
    """Return what resists the motor by its place, F/K [m]: amplitude, wave number and phase a row."""
    total = 0.0
    for k in range(waves.shape[0]):
        total += waves[k, 0] * math.sin(waves[k, 1] * motor + waves[k, 2])
    return total


@lean
def half_gap(table: float, gap: Array) -> float:
    """Return half the gap at a place of the table [m]: size, slope, reference, bump, centre and width."""
    whole = gap[0] + gap[1] * (table - gap[2])
    if gap[3] != 0.0:
        off = (table - gap[4]) / gap[5]
        whole += gap[3] * math.exp(-0.5 * off * off)
    return float(0.5 * max(whole, 0.0))


class ModeTables(NamedTuple):
    """The modes of one axis as the engine takes them, see :class:`~ph_post.drive.hybrid.Automaton`.

    `tables` are those of :func:`step_tables`, `slopes` the guards' rates of change; `static` [m] and `scale`
    [m/s] those of :func:`stribeck`, `waves` (waves, 3) those of :func:`cogging`. `gap` (6,) is that of
    :func:`half_gap`, (0,) where it is the same everywhere; `holds` and `contacts` (modes,) say how the two
    sides are placed then. `used` are the columns of :func:`used_columns`, `guarded` and `sloped` those of each guard
    and its slope that are not 0, in order and with -1 behind;
    `level` is into how many parts at most, as a power of 2, a sample is cut where forces of the state act.
    """

    tables: Array
    counts: IntArray
    guards: Array
    guarded: IntArray
    slopes: Array
    sloped: IntArray
    noise: Array
    targets: IntArray
    resets: Array
    directions: IntArray
    moving: int
    static: float
    scale: float
    waves: Array
    gap: Array
    holds: int
    contacts: IntArray
    used: IntArray
    level: int


@lean
def _step(table: Array, y: Array, length: float, into: Array, used: IntArray) -> None:
    """Advance state and inputs by `length` [s], of which `table` is D and `used` its columns."""
    # An index without a sign is taken as it is, others are looked at for counting from the end: here and below.
    x, v, m, w = y[Column.TABLE], y[Column.TABLE_SPEED], y[Column.MOTOR], y[Column.MOTOR_SPEED]
    integral, current = y[Column.INTEGRAL], y[Column.CURRENT]
    for j in used:
        if j < 0:
            break
        column = np.uint64(j)
        value = y[column]
        x += table[0, column] * value
        v += table[1, column] * value
        m += table[2, column] * value
        w += table[3, column] * value
        integral += table[4, column] * value
        current += table[5, column] * value
    into[Column.TABLE], into[Column.TABLE_SPEED], into[Column.MOTOR], into[Column.MOTOR_SPEED] = x, v, m, w
    into[Column.INTEGRAL], into[Column.CURRENT] = integral, current
    into[Column.ONE], into[Column.HALF_GAP] = 1.0, y[Column.HALF_GAP]
    into[Column.COMMAND] = y[Column.COMMAND] + length * y[Column.COMMAND_RATE]
    into[Column.COMMAND_RATE] = y[Column.COMMAND_RATE]
    into[Column.G] = y[Column.G] + length * y[Column.G_RATE]
    into[Column.G_RATE] = y[Column.G_RATE]
    into[Column.Q] = y[Column.Q] + length * y[Column.Q_RATE]
    into[Column.Q_RATE] = y[Column.Q_RATE]
    into[Column.FED] = y[Column.FED] + length * y[Column.FED_RATE]
    into[Column.FED_RATE] = y[Column.FED_RATE]
    into[Column.F] = y[Column.F] + length * y[Column.F_RATE]
    into[Column.F_RATE] = y[Column.F_RATE]


@lean
def _stepped(table: Array, y: Array, state: int, used: IntArray) -> float:
    """Return one state after a step as :func:`_step` makes it."""
    total = y[state]
    for j in used:
        if j < 0:
            break
        column = np.uint64(j)
        total += table[state, column] * y[column]
    return float(total)


@lean
def _value(rows: Array, places: IntArray, mode: int, number: int, y: Array) -> float:
    """Return the value at a state of a row of the guards or of their slopes, of whose columns few are not 0."""
    total = 0.0
    for j in places[mode, number]:
        if j < 0:
            break
        column = np.uint64(j)
        total += rows[mode, number, column] * y[column]
    return total


@lean
def _first_broken(guards: Array, places: IntArray, noise: Array, count: int, mode: int, y: Array) -> int:
    """Return the first of a mode's guards that does not hold, or -1."""
    for number in range(count):
        if _value(guards, places, mode, number, y) < -noise[mode, number]:
            return number
    return -1


@lean
def _broken(modes: ModeTables, mode: int, y: Array) -> int:
    """Return the first guard of a mode that does not hold, or -1."""
    return _first_broken(modes.guards, modes.guarded, modes.noise, modes.counts[mode], mode, y)


@lean
def _least(before: float, after: float, falls: float, rises: float) -> float:
    """Return the least value on [0, 1] of the cubic with these values and slopes at 0 and 1."""
    third = 2.0 * (before - after) + falls + rises
    second = 3.0 * (after - before) - 2.0 * falls - rises
    root = second * second - 3.0 * third * falls
    least = min(before, after)
    if root <= 0.0:
        return least
    # Where the slope is zero and grows, in the form that does not cancel.
    root = math.sqrt(root)
    if second > 0.0:
        place = -falls / (second + root)
    elif third != 0.0:
        place = (root - second) / (3.0 * third)
    else:
        return least
    if place <= 0.0 or place >= 1.0:
        return least
    return min(least, before + place * (falls + place * (second + place * third)))


@lean
def _may_dip(
    guards: Array,
    guarded: IntArray,
    slopes: Array,
    sloped: IntArray,
    noise: Array,
    count: int,
    mode: int,
    y: Array,
    after: Array,
    length: float,
) -> bool:
    """Return whether a guard breaks at an end or between both, going by the cubic through them."""
    for number in range(count):
        before = _value(guards, guarded, mode, number, y)
        last = _value(guards, guarded, mode, number, after)
        falls = length * _value(slopes, sloped, mode, number, y)
        rises = length * _value(slopes, sloped, mode, number, after)
        room = min(before, last) + noise[mode, number]
        # A slope of one at an end bends the cubic by no more than that: most guards are far away.
        if room >= BEND * (max(-falls, 0.0) + max(rises, 0.0)):
            continue
        if _least(before, last, falls, rises) < -noise[mode, number]:
            return True
    return False


@lean
def _is_forced(modes: ModeTables) -> bool:
    """Return whether a force of the state acts that is not linear in it."""
    return modes.static != 0.0 or modes.waves.shape[0] > 0


@lean
def _glides(modes: ModeTables, y: Array) -> bool:
    """Return whether no such force acts where the state is, and the gap is the same everywhere."""
    if modes.gap.size > 0 or modes.waves.shape[0] > 0:
        return False
    return modes.static == 0.0 or abs(y[modes.moving]) > FAST * modes.scale


@lean
def _set_force(
    y: Array,
    moving: int,
    direction: int,
    static: float,
    scale: float,
    waves: Array,
    step: Array,
    length: float,
    used: IntArray,
) -> None:
    """Let g and q run linearly over a step.

    A step that holds them shows where it ends. g runs from its value to that one; q, which the place gives,
    along the line with the mean and the first moment of the parabola through its values at both ends and in
    the middle.
    """
    waved, first = waves.shape[0] > 0, 0.0
    y[Column.G] = stribeck(y[moving], direction, static, scale) + y[Column.F]
    y[Column.G_RATE] = 0.0
    if waved:
        first = cogging(y[Column.MOTOR], waves)
        y[Column.Q], y[Column.Q_RATE] = first, 0.0
        motor = _stepped(step, y, Column.MOTOR, used)
        slower = y[Column.MOTOR_SPEED] - _stepped(step, y, Column.MOTOR_SPEED, used)
        middle = cogging(0.5 * (y[Column.MOTOR] + motor) + 0.125 * length * slower, waves)
        last = cogging(motor, waves)
    ahead = stribeck(_stepped(step, y, moving, used), direction, static, scale) if static != 0.0 else 0.0
    y[Column.G_RATE] = (ahead + (y[Column.F] + length * y[Column.F_RATE]) - y[Column.G]) / length
    if waved:
        y[Column.Q] = (first + 4.0 * middle + last) / 6.0 - 0.5 * (last - first)
        y[Column.Q_RATE] = (last - first) / length


@lean
def _halvings(y: Array, trial: Array, modes: ModeTables, direction: int, length: float) -> int:
    """Return into how many parts, as a power of 2, a sample is cut whose forces were linear in `trial`, its end.

    Of friction that the speed changes count the bend between both ends, and how far it is at the end from what a step
    with held forces foretold: either is a quarter in half the time. Of cogging counts how far its waves turn.
    """
    level, static = 0, modes.static
    if static != 0.0:
        speed, last = y[modes.moving], trial[modes.moving]
        foretold = y[Column.G] + length * y[Column.G_RATE] - y[Column.F] - length * y[Column.F_RATE]
        off = abs(stribeck(last, direction, static, modes.scale) - foretold)
        ratio = min(abs(speed), abs(last)) / modes.scale if speed * last > 0.0 else 0.0
        square, change = ratio * ratio, (last - speed) / modes.scale
        most = 0.25 * static * change * change
        if most > STRAIGHT:
            # Half the second derivative of exp(-r²), which falls from r² = 3/2 on.
            off = max(off, most * ((2.0 * square - 1.0) * math.exp(-square) if square > 1.5 else 1.0))
        while off > STRAIGHT and level < modes.level:
            level, off = level + 1, 0.25 * off
    turn = 0.0
    for k in range(modes.waves.shape[0]):
        turn = max(turn, abs(modes.waves[k, 1] * (trial[Column.MOTOR] - y[Column.MOTOR])))
    while turn > TURN * (1 << level) and level < modes.level:
        level += 1
    return level


@lean
def _attempt(y: Array, trial: Array, mode: int, modes: ModeTables, step: Array, length: float) -> int:
    """Take a step into `trial`, and return the guard that does not hold behind it, or -1."""
    if _is_forced(modes):
        _set_force(
            y,
            modes.moving,
            modes.directions[mode],
            modes.static,
            modes.scale,
            modes.waves,
            step,
            length,
            modes.used[mode],
        )
    _step(step, y, length, trial, modes.used[mode])
    return _broken(modes, mode, trial)


@lean
def _follow(modes: ModeTables, mode: int, y: Array) -> None:
    """Keep motor and table, while they touch, half the gap apart that is at the table's place."""
    contact = modes.contacts[mode]
    if contact == 0:
        return
    if modes.holds == PLAY:
        x = y[Column.MOTOR]
        for _ in range(SETTLED):
            before, x = x, y[Column.MOTOR] - contact * half_gap(x, modes.gap)
            if x == before:
                break
        y[Column.TABLE] = x
    y[Column.HALF_GAP] = half_gap(y[Column.TABLE], modes.gap)
    if modes.holds == TABLE:
        y[Column.MOTOR] = y[Column.TABLE] + contact * y[Column.HALF_GAP]


@lean
def _accept(y: Array, trial: Array) -> None:
    for i in range(COLUMNS):
        y[i] = trial[i]


@lean
def _close_in(
    y: Array, trial: Array, mode: int, modes: ModeTables, level: int, period: float, number: int
) -> tuple[int, int]:
    """Advance to the instant at which a guard breaks within a step of h/2^level, by bisection.

    Returns
    -------
    number : int
        The guard.
    units : int
        How far that was, in h/2^LEVELS.
    """
    units = 1
    for finer in range(level + 1, LEVELS + 1):
        found = _attempt(y, trial, mode, modes, modes.tables[mode, finer], period / (1 << finer))
        if found < 0:
            _accept(y, trial)
            units += 1 << (LEVELS - finer)
        else:
            number = found
    _attempt(y, trial, mode, modes, modes.tables[mode, LEVELS], period / (1 << LEVELS))
    _accept(y, trial)
    return number, units


@lean
def _change(y: Array, trial: Array, mode: int, modes: ModeTables, number: int) -> int:
    """Reset the state where a guard ends a mode, and return the mode it goes on in."""
    if modes.gap.size > 0 and modes.holds != SPRING:
        _follow(modes, mode, y)
    for i in range(STATES):
        total = 0.0
        for j in range(WIDTH):
            total += modes.resets[mode, number, i, j] * y[j]
        trial[i] = total
    for i in range(STATES):
        y[i] = trial[i]
    speed = y[modes.moving]
    which = 0 if speed > 0.0 else (1 if speed < 0.0 else 2)
    return int(modes.targets[mode, number, which])


@inner
def _note(instants: Array, log: IntArray, count: int, t: float, before: int, after: int) -> tuple[Array, IntArray, int]:
    """Write a change of mode down, in logs of twice the length where they are full."""
    if count == instants.size:
        more, longer = np.empty(2 * count), np.empty((2 * count, 2), dtype=np.int64)
        for i in range(count):
            more[i], longer[i, 0], longer[i, 1] = instants[i], log[i, 0], log[i, 1]
        instants, log = more, longer
    instants[count], log[count, 0], log[count, 1] = t, before, after
    return instants, log, count + 1


@lean
def _go_on(
    y: Array, trial: Array, mode: int, modes: ModeTables, left: int, period: float, heed: bool
) -> tuple[int, int]:
    """Take the longest step that the rest of a sample has room for, or go as far as the mode lasts.

    Returns
    -------
    number : int
        The guard that ended the mode, -1 where it goes on.
    units : int
        How far that was, in h/2^LEVELS.
    """
    whole = 1 << LEVELS
    level = modes.level
    while (whole >> level) > left:
        level += 1
    while True:
        length = period / (1 << level)
        number = _attempt(y, trial, mode, modes, modes.tables[mode, level], length)
        if heed and number >= 0:
            return _close_in(y, trial, mode, modes, level, period, number)
        if (
            not heed
            or level >= FINE
            or not _may_dip(
                modes.guards,
                modes.guarded,
                modes.slopes,
                modes.sloped,
                modes.noise,
                modes.counts[mode],
                mode,
                y,
                trial,
                length,
            )
        ):
            _accept(y, trial)
            return -1, whole >> level
        level += 1


@lean
def _begin(y: Array, command: Array, k: int, period: float) -> None:
    """Set the command for the sample that begins at k."""
    y[Column.COMMAND], y[Column.COMMAND_RATE] = command[k], (command[k + 1] - command[k]) / period


@lean
def _push(y: Array, force: Array, k: int, period: float) -> None:
    """Set the force from outside for the sample that begins at k."""
    y[Column.F], y[Column.F_RATE] = force[k], (force[k + 1] - force[k]) / period
    y[Column.G], y[Column.G_RATE] = y[Column.F], y[Column.F_RATE]


@lean
def _feed(y: Array, fed: Array, k: int, period: float) -> None:
    """Set the acceleration that is fed forward for the sample that begins at k."""
    y[Column.FED], y[Column.FED_RATE] = fed[k], (fed[k + 1] - fed[k]) / period


@lean
def _start_sample(y: Array, command: Array, force: Array, fed: Array, k: int, period: float) -> None:
    """Set all inputs for the sample that begins at k, where no force of the state acts."""
    _begin(y, command, k, period)
    y[Column.G], y[Column.G_RATE] = 0.0, 0.0
    if force.size > 0:
        _push(y, force, k, period)
    if fed.size > 0:
        _feed(y, fed, k, period)


@lean
def _write(y: Array, k: int, table: Array, motor: Array, states: Array) -> None:
    """Write down where all is at sample k."""
    table[k], motor[k] = y[Column.TABLE], y[Column.MOTOR]
    if states.shape[0] > 0:
        for i in range(STATES):
            states[k, i] = y[i]


@lean
def _cruise(
    y: Array,
    trial: Array,
    mode: int,
    modes: ModeTables,
    command: Array,
    period: float,
    force: Array,
    fed: Array,
    k: int,
    table: Array,
    motor: Array,
    states: Array,
) -> tuple[int, int]:
    """Go on from sample k in the longest steps that forces allow, as long as no guard breaks or may dip.

    Returns
    -------
    k : int
        The sample where that ends, begun already where something is left of it.
    left : int
        What is left of it, in h/2^LEVELS: 0 at the last sample, and where :func:`_glide` goes on.
    """
    whole = 1 << LEVELS
    forced, changing, pushed = _is_forced(modes), modes.gap.size > 0, force.size > 0
    first = k
    level, most, sample = 0, modes.level, modes.tables[mode, 0]
    step, length = sample, period
    guards, slopes, noise, count = modes.guards, modes.slopes, modes.noise, modes.counts[mode]
    guarded, sloped = modes.guarded, modes.sloped
    used, waves, static, scale = modes.used[mode], modes.waves, modes.static, modes.scale
    moving, direction = modes.moving, modes.directions[mode]
    while k < command.size - 1 and (k == first or not _glides(modes, y)):
        _begin(y, command, k, period)
        if pushed:
            _push(y, force, k, period)
        if fed.size > 0:
            _feed(y, fed, k, period)
        if most > 0:
            _set_force(y, moving, direction, static, scale, waves, sample, period, used)
            _step(sample, y, period, trial, used)
            level = _halvings(y, trial, modes, direction, period)
            step, length = modes.tables[mode, level], period / (1 << level)
        for part in range(1 << level):
            if level > 0 or most == 0:
                if forced:
                    _set_force(y, moving, direction, static, scale, waves, step, length, used)
                _step(step, y, length, trial, used)
            if _may_dip(guards, guarded, slopes, sloped, noise, count, mode, y, trial, length):
                return k, whole - part * (whole >> level)
            _accept(y, trial)
        k += 1
        if changing:
            _follow(modes, mode, y)
        _write(y, k, table, motor, states)
    return k, 0


@lean
def _set_inputs(command: Array, force: Array, fed: Array, k: int, size: int, period: float, path: Array) -> None:
    """Set the inputs of a stretch of so many samples that begins at sample k."""
    for s in range(size):
        rate = (command[k + s + 1] - command[k + s]) / period
        path[Column.COMMAND, s], path[Column.COMMAND_RATE, s], path[Column.ONE, s] = command[k + s], rate, 1.0
        path[END_OF_COMMAND, s] = command[k + s] + period * rate
    if force.size > 0:
        for s in range(size):
            rate = (force[k + s + 1] - force[k + s]) / period
            path[Column.G, s], path[Column.G_RATE, s] = force[k + s], rate
            path[END_OF_FORCE, s] = force[k + s] + period * rate
    if fed.size > 0:
        for s in range(size):
            rate = (fed[k + s + 1] - fed[k + s]) / period
            path[Column.FED, s], path[Column.FED_RATE, s] = fed[k + s], rate
            path[END_OF_FED, s] = fed[k + s] + period * rate


@lean
def _run_through(step: Array, path: Array, size: int, used: IntArray) -> None:
    """Advance the state through a stretch as :func:`_step` does."""
    for s in range(size):
        x, v, m, w = path[0, s], path[1, s], path[2, s], path[3, s]
        integral, current = path[4, s], path[5, s]
        for j in used:
            if j < 0:
                break
            column = np.uint64(j)
            value = path[column, s]
            x += step[0, column] * value
            v += step[1, column] * value
            m += step[2, column] * value
            w += step[3, column] * value
            integral += step[4, column] * value
            current += step[5, column] * value
        path[0, s + 1], path[1, s + 1], path[2, s + 1], path[3, s + 1] = x, v, m, w
        path[4, s + 1], path[5, s + 1] = integral, current


@lean
def _along(
    rows: Array, places: IntArray, mode: int, number: int, path: Array, size: int, later: int, into: Array
) -> None:
    """Put the value of a row, as :func:`_value` has it, at the beginnings of samples; at their ends if `later` is 1."""
    for s in range(size):
        into[s] = 0.0
    for j in places[mode, number]:
        if j < 0:
            break
        factor, row = rows[mode, number, j], j
        if later == 1 and j == Column.COMMAND:
            row = END_OF_COMMAND
        elif later == 1 and j == Column.G:
            row = END_OF_FORCE
        elif later == 1 and j == Column.FED:
            row = END_OF_FED
        shift = later if j < STATES else 0
        for s in range(size):
            into[s] += factor * path[row, s + shift]


@lean
def _first_dip(modes: ModeTables, mode: int, path: Array, size: int, length: float, four: Array) -> int:
    """Return the first sample of a stretch in which a guard may dip, see :func:`_may_dip`, or how many there are."""
    for number in range(modes.counts[mode]):
        noise = modes.noise[mode, number]
        for later in range(2):
            _along(modes.guards, modes.guarded, mode, number, path, size, later, four[later])
            _along(modes.slopes, modes.sloped, mode, number, path, size, later, four[2 + later])
        for s in range(size):
            falls, rises = length * four[2, s], length * four[3, s]
            room = min(four[0, s], four[1, s]) + noise
            four[4, s] = room - BEND * (max(-falls, 0.0) + max(rises, 0.0))
        for s in range(size):
            if four[4, s] >= 0.0:
                continue
            if _least(four[0, s], four[1, s], length * four[2, s], length * four[3, s]) < -noise:
                size = s
                break
    return size


@lean
def _fast_for(modes: ModeTables, path: Array, size: int) -> int:
    """Return for how many samples of a stretch nothing is left of Stribeck friction, see :func:`_glides`."""
    if modes.static != 0.0:
        for s in range(size):
            if abs(path[modes.moving, s + 1]) <= FAST * modes.scale:
                return s
    return size


@lean
def _glide(
    y: Array,
    mode: int,
    modes: ModeTables,
    command: Array,
    period: float,
    force: Array,
    fed: Array,
    k: int,
    table: Array,
    motor: Array,
    states: Array,
    path: Array,
    four: Array,
) -> tuple[int, int]:
    """Do what :func:`_cruise` does as long as no force of the state acts, and the gap is the same everywhere.

    All samples are whole steps then: stretches of them are run, each twice as long as the one before, and their guards
    are looked at together.
    """
    step, most, left = modes.tables[mode, 0], SHORT, 0
    while k < command.size - 1 and left == 0:
        size = min(most, command.size - 1 - k)
        for i in range(STATES):
            path[i, 0] = y[i]
        _set_inputs(command, force, fed, k, size, period, path)
        _run_through(step, path, size, modes.used[mode])
        until = _first_dip(modes, mode, path, size, period, four)
        fast = _fast_for(modes, path, until)
        for s in range(1, fast + 1):
            table[k + s], motor[k + s] = path[Column.TABLE, s], path[Column.MOTOR, s]
        if states.shape[0] > 0:
            for s in range(1, fast + 1):
                for i in range(STATES):
                    states[k + s, i] = path[i, s]
        for i in range(STATES):
            y[i] = path[i, fast]
        k += fast
        if fast < until:
            break
        if until < size:
            left = 1 << LEVELS
            _start_sample(y, command, force, fed, k, period)
        most = min(2 * most, STRETCH)
    return k, left


@compiled
def advance(
    command: Array,
    period: float,
    z: Array,
    mode: int,
    modes: ModeTables,
    force: Array,
    fed: Array,
    table: Array,
    motor: Array,
    states: Array,
) -> tuple[int, Array, IntArray]:
    """Run one axis through the samples of a command that is linear between them.

    Parameters
    ----------
    command : Array, shape (n,)
        X [m].
    period : float
        h [s].
    z : Array, shape (STATES,)
        State at the first sample; holds that at the last one afterwards.
    mode : int
    modes : ModeTables
    force : Array, shape (n,) or (0,)
        Further force on the body that feels friction, linear between samples, F/K [m]; (0,) is none.
    fed : Array, shape (n,) or (0,)
        Acceleration that a cascade feeds forward, linear between samples [m/s²]; (0,) is none.
    table, motor : Array, shape (n,)
        Receive x and m [m].
    states : Array, shape (n, STATES) or (0, STATES)
        Receives the states at the samples; (0, STATES) where nobody asks for them.

    Returns
    -------
    mode : int
    instants : Array, shape (changes,)
        Of the changes of mode, in samples.
    log : IntArray, shape (changes, 2)
        Mode before and after; CHATTERS where changes are no longer followed.
    """
    y, trial = np.zeros(COLUMNS), np.zeros(COLUMNS)
    instants, log, count = np.empty(64), np.empty((64, 2), dtype=np.int64), 0
    for i in range(STATES):
        y[i] = z[i]
    y[Column.ONE] = 1.0
    if modes.gap.size > 0:
        y[Column.HALF_GAP] = half_gap(y[Column.TABLE], modes.gap)
    whole = 1 << LEVELS
    _write(y, 0, table, motor, states)
    path, four = np.zeros((COLUMNS + 3, STRETCH + 1)), np.empty((5, STRETCH))
    k, glides = 0, _glides(modes, y)
    while k < command.size - 1:
        if glides:
            k, left = _glide(y, mode, modes, command, period, force, fed, k, table, motor, states, path, four)
        else:
            k, left = _cruise(y, trial, mode, modes, command, period, force, fed, k, table, motor, states)
        if left == 0:
            glides = not glides and _glides(modes, y)
            continue
        changes = 0
        while left > 0:
            heed = changes < MOST_CHANGES
            number = _broken(modes, mode, y) if heed else -1
            if number < 0:
                number, units = _go_on(y, trial, mode, modes, left, period, heed)
                left -= units
            if number >= 0:
                after = _change(y, trial, mode, modes, number)
                changes += 1
                said = after if changes < MOST_CHANGES else CHATTERS
                instants, log, count = _note(instants, log, count, k + 1.0 - left / whole, mode, said)
                mode = after
        if modes.gap.size > 0:
            _follow(modes, mode, y)
        k += 1
        _write(y, k, table, motor, states)
        glides = _glides(modes, y)
    for i in range(STATES):
        z[i] = y[i]
    return mode, instants[:count], log[:count]
