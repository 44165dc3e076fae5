"""An excerpt of a long log: the windows in which most is seen, joined by smooth motions that nobody reads.

A fit costs as much as the log is long, and an hour shows hardly more than the half minute that holds every
speed, acceleration, place and reversal, and what the file's drive explains worst. Windows are added one by one,
each the one that shows most of what those before it show least. Between two of them the command goes over in
one smooth motion, so that a model still runs freely from end to end; what lies there, and what a model needs to
forget it, has no readings and counts for nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.identify.between import parts_between
from ph_post.identify.linear_drive import directions, linear_position, servo_memory, settling_time
from ph_post.identify.log_quality import settled_after
from ph_post.types import Array, AxisLog, BoolArray, IntArray, Log, Machine, sealed
from ph_post.units import MS

MOST: Final = 30_000
"""Samples of a log that is taken whole at most."""

KEPT: Final = 2.0 / 3.0
"""Part of these that an excerpt has, about: it is what shows most, and a fit takes as long as it has samples."""

SHORTEST: Final = 3.0
"""Shortest window [s]."""

WINDOWS: Final = 12
"""Windows of an excerpt at most: those of slow samples are longer."""

STARTS: Final = 6.0
"""Times as long as a model takes to settle that a window is at least."""

FINEST: Final = 1.0 * MS
"""Samples closer together than that hardly any drive needs, and of a log that has too many every second, third, … is
taken [s]. Those that are left tell short filters of the command from delays."""

A_MEMORY: Final = 4.0
"""Samples that a servo time constant keeps all the same."""

CELLS: Final = 4
"""Places a window's length at which one may begin."""

LEVELS: Final = 6
"""Steps by factors of 2 below the largest into which speeds, accelerations and residuals are sorted."""

PLACES: Final = 12
"""Parts of an axis' travel, and of the log's time."""

A_REVERSAL: Final = 0.3
"""What a reversal is worth, in seconds of any other motion."""

QUICKER: Final = 1.2
"""Speed and acceleration of the motion between windows, at most, by the largest of the log."""


A_REST: Final = 1.0
"""What is kept of a rest with which a log begins or ends, at least [s]."""

WANDERS: Final = 1.5
"""Times the spread that its differences tell which a reading's may have where it rests."""

SLOPE: Final = 6
"""Samples from which the speed at the end of a window is taken."""


class LogWindow(NamedTuple):
    """Samples from `start` to before `stop` of a log."""

    start: int
    stop: int


def excerpt(log: Log, machine: Machine, most: int = MOST) -> Log:
    """Return what of a log is worth a fit: all of a short one, windows of a long one.

    Parameters
    ----------
    log : Log
    machine : Machine
        Its drives say how long a model needs to settle; of its axes what they explain worst is looked for.
    most : int
        Samples up to which a log is taken whole; an excerpt has about two thirds of so many.

    Returns
    -------
    Log
        With `windows`, where it is an excerpt. Long rests at both ends are left out of any log: they show
        nothing, and would be a part of all shares and spreads.
    """
    log = _without_rests(log, machine)
    most = min(most, 2 * most // parts_between(log.period))
    if log.t.size <= most:
        return log
    step = min(_every(log, machine), math.ceil(log.t.size / most))
    if step > 1:
        log = _thinned(log, step)
    if log.t.size <= most:
        return replace(log, windows=((float(log.t[0]), float(log.t[-1]) + log.period),))
    return _joined(log, machine, _chosen(log, machine, math.ceil(KEPT * most)))


def _without_rests(log: Log, machine: Machine) -> Log:
    """Return the log without its ends in which nothing is commanded and no reading wanders."""
    moves = np.flatnonzero(np.any([np.diff(axis.command) != 0.0 for axis in log.axes.values()], axis=0))
    if moves.size == 0:
        return log
    kept = math.ceil(max(A_REST, _longest_settling(log, machine)) / log.period)
    start, stop = max(int(moves[0]) - kept, 0), min(int(moves[-1]) + 2 + kept, log.t.size)
    # Half of what is kept is looked at, too: what goes on there has not come to rest.
    if not _rest(log, slice(0, start + kept // 2)):
        start = 0
    if not _rest(log, slice(stop - kept // 2, None)):
        stop = log.t.size
    if stop - start == log.t.size:
        return log
    axes = {name: _of(axis, lambda values: values[start:stop]) for name, axis in log.axes.items()}
    return replace(log, t=sealed(log.t[start:stop]), axes=axes)


def _rest(log: Log, where: slice) -> bool:
    """Whether no reading does more there than a noise from sample to sample: none coasts, creeps or grows."""
    for axis in log.axes.values():
        for reading in (axis.table, axis.motor, axis.effort):
            values = reading[where] if reading is not None else np.empty(0)
            values = values[np.isfinite(values)]
            # From the first one on, as the spread of what stands still elsewhere is not quite 0.
            if values.size > 1 and np.std(values - values[0]) > WANDERS * np.std(np.diff(values)) / math.sqrt(2.0):
                return False
    return True


def _longest_settling(log: Log, machine: Machine) -> float:
    return max((settling_time(machine.axes[name]) for name in log.axes if name in machine.axes), default=0.0)


def _every(log: Log, machine: Machine) -> int:
    """Return the number of samples of which one is enough."""
    memories = [servo_memory(machine.axes[name].servo) for name in log.axes if name in machine.axes]
    period = min([FINEST, *(memory / A_MEMORY for memory in memories if memory > 0.0)])
    return max(int(period / log.period + 1e-6), 1)


def _thinned(log: Log, step: int) -> Log:
    """Return every so many samples."""
    axes = {name: _of(axis, lambda values: values[::step]) for name, axis in log.axes.items()}
    return replace(log, t=sealed(log.t[::step]), period=log.period * step, axes=axes)


def _of(axis: AxisLog, take: Callable[[Array], Array]) -> AxisLog:
    """Return an axis of which every column is taken alike."""
    parts = {name: getattr(axis, name) for name in ("command", "table", "motor", "effort")}
    return replace(axis, **{name: None if part is None else sealed(take(part)) for name, part in parts.items()})


def _chosen(log: Log, machine: Machine, most: int) -> list[LogWindow]:
    """Choose windows, in the order of time, those that touch as one."""
    settling = _longest_settling(log, machine)
    size = max(SHORTEST, STARTS * settling, most * log.period / WINDOWS) / log.period
    cell = max(math.ceil(size / CELLS), 1)
    cells = log.t.size // cell
    if cells < CELLS:
        return [LogWindow(0, log.t.size)]
    shown = _shown(log, machine, cell, cells)
    windows = np.apply_along_axis(np.convolve, 0, shown, np.ones(CELLS), mode="valid")
    free = np.ones(windows.shape[0], dtype=np.bool_)
    total = np.zeros(shown.shape[1])
    picked: list[int] = []
    while free.any() and (len(picked) + 1) * cell * CELLS <= most:
        # What was seen for a cell's length or two adds little more.
        gains = np.where(free, np.sum(np.exp(-total) - np.exp(-total - windows), axis=1), -1.0)
        best = int(np.argmax(gains))
        picked.append(best)
        total += windows[best]
        free[max(best - CELLS + 1, 0) : best + CELLS] = False
    found: list[LogWindow] = []
    for k in sorted(picked):
        if found and found[-1].stop == k * cell:
            found[-1] = LogWindow(found[-1].start, (k + CELLS) * cell)
        else:
            found.append(LogWindow(k * cell, (k + CELLS) * cell))
    return found


def _shown(log: Log, machine: Machine, cell: int, cells: int) -> Array:
    """Return how long each cell shows each thing, in lengths of a cell, (cells, things)."""
    rows = cell * cells
    number = np.arange(rows) // cell
    found: list[Array] = [np.eye(PLACES)[np.arange(cells) * PLACES // cells]]
    for kinds, count in _kinds(log, machine):
        held = np.bincount(number * (count + 1) + kinds[:rows] + 1, minlength=cells * (count + 1))
        found.append(held.reshape(cells, count + 1)[:, 1:] / cell)
    for name, axis in log.axes.items():
        way = directions(np.gradient(linear_position(log, machine, name)))[:rows]
        turns = np.flatnonzero(np.diff(way) * way[:-1])
        if np.ptp(axis.command) > 0.0:
            worth = A_REVERSAL / (cell * log.period)
            found.append(np.asarray(worth * np.bincount(turns // cell, minlength=cells)[:, None]))
    return np.concatenate(found, axis=1)


def _kinds(log: Log, machine: Machine) -> Iterator[tuple[IntArray, int]]:
    """Yield what each sample (n,) shows, -1 nothing, and of how many kinds it may be."""
    moves = np.any([np.diff(axis.command, prepend=axis.command[:1]) != 0.0 for axis in log.axes.values()], axis=0)
    yield np.where(moves, -1, 0), 1
    for name, axis in log.axes.items():
        span = float(np.ptp(axis.command))
        if span == 0.0:
            continue
        place = linear_position(log, machine, name)
        speed = np.gradient(place)
        yield np.where(speed > 0.0, 1, 0) * LEVELS + _level(speed), 2 * LEVELS
        yield _level(np.gradient(speed)), LEVELS
        yield np.clip((axis.command - axis.command.min()) / span * PLACES, 0, PLACES - 1).astype(np.int64), PLACES
        for reading in (axis.table, axis.motor):
            if reading is not None:
                apart = reading - place
                apart = np.where(np.isfinite(apart), apart, np.nanmedian(apart))
                yield _level(apart - np.median(apart)), LEVELS


def _level(values: Array) -> IntArray:
    """Sort sizes by factors of 2 below the largest but for one in ten thousand; -1 what is smaller."""
    sizes = np.abs(values)
    largest = float(np.quantile(sizes, 0.9999))
    if largest == 0.0:
        return np.full(sizes.size, -1, dtype=np.int64)
    with np.errstate(divide="ignore"):
        below = np.floor(np.log2(largest / np.minimum(np.maximum(sizes, 1e-300), largest)))
    return np.where(below < LEVELS, below, -1).astype(np.int64)


def _joined(log: Log, machine: Machine, windows: Sequence[LogWindow]) -> Log:
    """Lay windows one behind the other, with motions between them that have no readings."""
    if len(windows) == 1 and windows[0] == LogWindow(0, log.t.size):
        return log
    fastest = {name: _fastest(axis.command) for name, axis in log.axes.items()}
    pieces: dict[str, list[Array]] = {name: [] for name in log.axes}
    times: list[Array] = []
    counted: list[BoolArray] = []
    for k, window in enumerate(windows):
        here = slice(window.start, window.stop)
        if k:
            before = slice(windows[k - 1].start, windows[k - 1].stop)
            ends = {name: (axis.command[before], axis.command[here]) for name, axis in log.axes.items()}
            bridges = _bridges(ends, fastest)
            size = next(iter(bridges.values())).size
            for name, bridge in bridges.items():
                pieces[name].append(bridge)
            times.append(np.linspace(log.t[before][-1], log.t[window.start], size + 2)[1:-1])
            counted.append(np.zeros(size, dtype=np.bool_))
        for name, axis in log.axes.items():
            pieces[name].append(axis.command[here])
        times.append(log.t[here])
        lead = settled_after(log, machine, *window) if k else 0
        counted.append(np.arange(window.stop - window.start) >= lead)
    use = np.concatenate(counted)
    rows = np.concatenate([np.arange(*window) for window in windows])
    at = np.flatnonzero(_recorded(counted))
    axes = {
        name: replace(
            _of(axis, lambda values: _laid(values[rows], at, use)), command=sealed(np.concatenate(pieces[name]))
        )
        for name, axis in log.axes.items()
    }
    seconds = tuple((float(log.t[one.start]), float(log.t[one.stop - 1]) + log.period) for one in windows)
    return replace(log, t=sealed(np.concatenate(times)), axes=axes, counted=sealed(use), windows=seconds)


def _recorded(counted: Sequence[BoolArray]) -> BoolArray:
    """Return which rows are of windows rather than between them."""
    return np.concatenate([np.full(one.size, k % 2 == 0) for k, one in enumerate(counted)])


def _laid(values: Array, at: IntArray, use: BoolArray) -> Array:
    """Lay readings on the rows of the windows, NaN where they do not count."""
    spread = np.full(use.size, np.nan)
    spread[at] = values
    spread[~use] = np.nan
    return spread


def _fastest(command: Array) -> tuple[float, float]:
    """Return the largest speed and acceleration of a command, per sample."""
    speed = np.diff(command)
    return float(np.max(np.abs(speed))), float(np.max(np.abs(np.diff(speed))))


def _bridges(ends: Mapping[str, tuple[Array, Array]], fastest: Mapping[str, tuple[float, float]]) -> dict[str, Array]:
    """Return the commands of all axes from the end of one window to the beginning of the next."""
    size = 32
    while True:
        bridges = {name: _bridge(*both, size) for name, both in ends.items()}
        if size > MOST or all(_calm(bridges[name], *fastest[name]) for name in ends):
            return bridges
        size = math.ceil(1.3 * size)


def _bridge(before: Array, behind: Array, size: int) -> Array:
    """Return a motion of so many samples that keeps place and speed at both ends."""
    span = size + 1.0
    p, q = before[-1], behind[0]
    v, w = span * _slope(before[-SLOPE:]), span * _slope(behind[:SLOPE])
    u = np.arange(1, size + 1) / span
    # The quintic whose acceleration is 0 at both ends.
    rest = np.linalg.solve(
        [[1.0, 1.0, 1.0], [3.0, 4.0, 5.0], [6.0, 12.0, 20.0]],
        [q - p - v, w - v, 0.0],
    )
    return np.asarray(p + u * (v + u * u * (rest[0] + u * (rest[1] + u * rest[2]))))


def _slope(values: Array) -> float:
    """Return the slope of the straight line through values, per sample: rounding hides that of two."""
    at = np.arange(values.size) - 0.5 * (values.size - 1)
    return float(at @ values / (at @ at))


def _calm(bridge: Array, speed: float, acceleration: float) -> bool:
    """Return whether a motion between windows is no quicker than the log."""
    steps = np.diff(bridge)
    return bool(np.max(np.abs(steps)) <= QUICKER * speed and np.max(np.abs(np.diff(steps))) <= QUICKER * acceleration)
