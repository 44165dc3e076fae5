"""Read logs, check that they belong to a machine and a program, and take missing commands from the program."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.errors import InputError
from ph_post.files.check import quoted
from ph_post.files.log import LogFile, read_log_file
from ph_post.files.storage import SourceBytes
from ph_post.gcode.program import PartProgram
from ph_post.identify.logsigns import require_order
from ph_post.simulate.controllers.run import run_program
from ph_post.types import Array, AxisLog, Command, Log, Machine, sealed
from ph_post.units import MM

FAR: Final = 100 * MM
"""A reading that is so far from its command is that of something else."""

OFF_PATH: Final = 1 * MM
"""A command of the program is nowhere so far from its path."""

MOVES: Final = 1 * MM
"""An axis that travels less says nothing about what belongs together."""

ALIKE: Final = 0.5
"""Least correlation of a reading with its command."""

CERTAIN: Final = 0.9
"""Correlation of a reading with its command from which its scale is known."""

UNIT: Final = 10.0
"""No drive travels so many times less or more than commanded."""

LATEST: Final = 0.1
"""A reading is looked for so late behind its command [s]."""

MOST_POINTS: Final = 5e6
"""Points that stand for a program's path at most, about."""

AROUND: Final = 0.25
"""Part of the log that may lie before the program's path is reached and after it is left."""

Where = Callable[[int], str]


def read_log(
    source: str | os.PathLike[str] | SourceBytes,
    *,
    columns: Sequence[str] = (),
    sides: Mapping[str, str] | None = None,
    program: PartProgram | None = None,
    machine: Machine | None = None,
) -> Log:
    """Read a log: CSV, a ``.mat``, ``.npz`` or ``.parquet`` file, or what LinuxCNC's ``halsampler`` wrote.

    Columns are `t` [s]; `X_cmd`, `X_act` (at the table) and `X_motor` [mm]; `X_force` [N] or `X_current` [A];
    and those of Y and Z. A file without a header has its columns numbered from 1; whole numbers that count up
    in the first of them are the numbers of the samples.

    Parameters
    ----------
    source : str, path or SourceBytes
        ``-`` is standard input; what was read already is taken as it is.
    columns : sequence of str
        Mappings ``NAME=SOURCE[*FACTOR]:UNIT``, such as ``X_act=qm:m``; they go before the file's own names.
    sides : mapping of str to str, optional
        By axis where `X_act` was read, "table", "motor" or "unknown"; goes before the remark ``X_act.side``.
    program : PartProgram, optional
        The program that ran, which gives the commands that the log lacks and must fit those that it has.
    machine : Machine, optional
        The machine that was logged: refuses axes that it does not have; its servo period is the period of
        rows without a time.

    Returns
    -------
    Log
        SI units, at one constant period; samples that are missing are NaN in the readings.

    Raises
    ------
    InputError
        One line naming file and line, what was expected and what was found.
    """
    return fit_program(read_log_file(source, columns=columns, sides=sides, machine=machine), program, machine)


def fit_program(file: LogFile, program: PartProgram | None, machine: Machine | None) -> Log:
    """Take the commands that a log lacks from the program, and refuse what does not belong together.

    Raises
    ------
    InputError
        Where commands are missing and nothing gives them, or program or readings do not fit the commands.
    """
    log, lacking = file.log, file.lacking
    if lacking and (program is None or machine is None):
        raise InputError(
            file.sheet.header,
            f"column {quoted(f'{lacking[0]}_cmd')} is missing",
            expected=f"it, a mapping such as --column {lacking[0]}_cmd=SOURCE:mm, or the program that ran"
            + ("" if machine is not None else " and the machine"),
            got=file.sheet.listed,
        )
    if program is not None and machine is not None:
        if len(lacking) < len(log.axes):
            log = _require_program(log, program, machine, file.samples.where)
        if lacking:
            log = _fill_commands(log, lacking, program, machine, file.sheet.name)
    elif program is not None:
        words = f"without a machine the commands cannot be compared with {program.name}"
        log = replace(log, warnings=(*log.warnings, words))
    _require_readings(log, file.samples.where)
    said = require_order(log, file.sheet.header)
    return replace(log, warnings=(*log.warnings, *said)) if said else log


def _require_readings(log: Log, where: Where) -> None:
    """Refuse readings that are not those of their commands.

    Raises
    ------
    InputError
        With the axis and the line of the worst sample.
    """
    for name, axis in log.axes.items():
        for column, reading in _readings(name, axis):
            if not np.isfinite(reading).any():
                raise InputError(where(0), f"{column} has no sample at all", expected="readings in mm")
            apart = np.abs(reading - axis.command)
            worst = int(np.nanargmax(apart))
            if apart[worst] > FAR:
                raise InputError(
                    where(worst),
                    f"{column} is far from {name}_cmd: another unit, zero or program?",
                    expected=f"at most {FAR / MM:g} mm",
                    got=f"{apart[worst] / MM:.6g} mm",
                )
            fault = _unlike(axis.command, reading, log.period)
            if fault is not None:
                _require_own(log, name, column, reading, where)
                raise InputError(
                    where(worst),
                    f"{column} {fault[0]} {name}_cmd: {fault[1]}",
                    expected=fault[2],
                    got=f"{fault[3]}, and {apart[worst] / MM:.6g} mm at the worst sample",
                )


def _require_own(log: Log, name: str, column: str, reading: Array, where: Where) -> None:
    """Refuse a reading that is another axis'.

    Raises
    ------
    InputError
    """
    for other, axis in log.axes.items():
        if (
            other != name
            and np.ptp(axis.command) >= MOVES
            and _likeness(axis.command, reading, log.period)[0] > CERTAIN
        ):
            twin = f"{other}_{column.partition('_')[2]}"
            raise InputError(
                where(0),
                f"{column} follows {other}_cmd, not {name}_cmd: the axes are swapped",
                expected=f"--column {column}={twin} --column {twin}={column}",
            )


def _require_program(log: Log, program: PartProgram, machine: Machine, where: Where) -> Log:
    """Refuse commands that leave the path of a program; a warning names what lies before and after it.

    Raises
    ------
    InputError
        With the line.
    """
    names = [name for name, axis in log.axes.items() if not np.isnan(axis.command[0])]
    command = run_program(program, machine)
    apart = _apart(log, names, command, program)
    near = np.flatnonzero(apart <= OFF_PATH)
    first, last = (int(near[0]), int(near[-1])) if near.size else (0, apart.size - 1)
    outside = first + apart.size - 1 - last
    inside = slice(0, apart.size) if outside > AROUND * apart.size else slice(first, last + 1)
    worst = inside.start + int(np.argmax(apart[inside]))
    if apart[worst] > OFF_PATH:
        raise InputError(
            where(worst),
            f"the commands leave the path of {program.name}: is it a log of this program?",
            expected=f"within {OFF_PATH / MM:g} mm, in the program's coordinates",
            got=f"{apart[worst] / MM:.6g} mm",
        )
    if not outside:
        return log
    words = f"{outside} samples before and after the path of {program.name} are not of this program"
    return replace(log, warnings=(*log.warnings, words))


def _fill_commands(log: Log, lacking: Sequence[str], program: PartProgram, machine: Machine, file: str) -> Log:
    """Take commands from the program, at the time that fits the log best.

    Commands that were recorded give the time exactly. Where none was, readings are compared with the command
    as late as the servo makes it, c of Eq. (9).

    Raises
    ------
    InputError
        Where the program does not fit.
    """
    command = run_program(program, machine)
    pairs = _pairs(log, command, machine)
    start = _best_start(pairs, command, log)
    made = {name: _at(command, name, log.t - log.t[0] - start) for name in lacking}
    misfit = math.sqrt(float(np.mean([_misfit(pair, command, log, start) ** 2 for pair in pairs])))
    gaps = max(machine.axes[name].gap.lost_motion for name in log.axes)
    if misfit > OFF_PATH + gaps:
        raise InputError(
            file,
            f"the log does not follow {program.name}: is it a log of this program, and of this machine?",
            expected=f"within {(OFF_PATH + gaps) / MM:g} mm (root mean square)",
            got=f"{misfit / MM:.6g} mm",
        )
    axes = {name: replace(axis, command=made.get(name, axis.command)) for name, axis in log.axes.items()}
    words = (
        f"{', '.join(f'{name}_cmd' for name in lacking)}: from {program.name}, which begins {start:.6g} s "
        f"after the log by the best fit ({misfit / MM:.3g} mm rms)"
    )
    if len(lacking) == len(log.axes):
        words += "; a delay of the readings cannot be seen"
    return replace(log, axes=axes, warnings=(*log.warnings, words))


def _readings(name: str, axis: AxisLog) -> Iterator[tuple[str, Array]]:
    for side, reading in (("act", axis.table), ("motor", axis.motor)):
        if reading is not None:
            yield f"{name}_{side}", reading


def _whole(reading: Array) -> Array:
    """Fill in missing samples along lines."""
    there = np.isfinite(reading)
    if there.all():
        return reading
    rows = np.arange(reading.size)
    return np.interp(rows, rows[there], reading[there])


def _unlike(command: Array, reading: Array, period: float) -> tuple[str, str, str, str] | None:
    """Say in what a reading does not follow its command, None where it does, or where either hardly moves.

    A drive may be late; its reading may have steps, drift and noise, and stand still altogether.
    """
    travel, read = float(np.ptp(command)), float(np.nanmax(reading) - np.nanmin(reading))
    if travel < MOVES or read == 0.0:
        return None
    most, least = _likeness(command, reading, period)
    if most < ALIKE and read >= travel / UNIT:
        does = "runs against" if least < -ALIKE else "does not follow"
        got = f"{least if least < -ALIKE else most:.2f}"
        return does, "is it the same axis, program and sign?", f"a correlation of at least {ALIKE:g}", got
    if most > CERTAIN and not travel / UNIT <= read <= travel * UNIT:
        got = f"{read / MM:.6g} mm"
        return "has another scale than", "is it in another unit?", f"a travel of {travel / MM:.6g} mm", got
    return None


def _likeness(command: Array, reading: Array, period: float) -> tuple[float, float]:
    """Return the largest and the least correlation over the delays that a drive may have."""
    from scipy.signal import correlate

    one, other = command - command.mean(), _whole(reading)
    other = other - other.mean()
    late = min(round(LATEST / period), command.size // 4)
    both = correlate(other, one, mode="full", method="fft")[command.size - 1 :][: late + 1]
    sizes = both / math.sqrt(float(one @ one) * float(other @ other))
    return float(sizes.max()), float(sizes.min())


def _apart(log: Log, names: Sequence[str], command: Command, program: PartProgram) -> Array:
    """Return the distance of each command from the program's path, in the recorded axes [m], shape (n,).

    That is where a model of its controller leads, which rounds corners as the program's path mode allows, or
    where its straight motions are.
    """
    from scipy.spatial import cKDTree

    columns = [command.axes.index(name) for name in names]
    ends = np.hstack([program.motions.start[:, columns], program.motions.end[:, columns]])
    straight = ends[~np.isnan(ends).any(axis=1) & (program.motions.kind <= 1)].reshape(-1, 2, len(names))
    chain = command.position[:, columns]
    lines = np.concatenate([np.stack([chain[:-1], chain[1:]], axis=1), straight])
    tree = cKDTree(np.unique(_dense(lines), axis=0))
    wanted = np.column_stack([log.axes[name].command for name in names])
    return np.asarray(tree.query(wanted)[0])


def _dense(lines: Array) -> Array:
    """Points on lines, shape (n, 2, dimension), so close that the distance to them is off by little."""
    way = lines[:, 1] - lines[:, 0]
    length = np.sqrt((way * way).sum(axis=1))
    apart = max(0.1 * OFF_PATH, float(length.sum()) / MOST_POINTS)
    parts = np.maximum(np.ceil(length / apart), 1.0).astype(np.int64)
    line = np.repeat(np.arange(len(lines)), parts)
    share = (np.arange(line.size) - np.repeat(np.cumsum(parts) - parts, parts)) / parts[line]
    return np.vstack([lines[line, 0] + share[:, None] * way[line], lines[:, 1]])


def _at(command: Command, name: str, t: Array) -> Array:
    """Return the positions of an axis at times since the program began; it stands before and after that."""
    return sealed(np.interp(t, command.t - command.t[0], command.position[:, command.axes.index(name)]))


Pair = tuple[str, Array, float]
"""An axis, what was recorded of it and how late that is behind the command [s]."""


def _pairs(log: Log, command: Command, machine: Machine) -> list[Pair]:
    """Pair commands that were recorded and move with those of the program; or else readings, all of them."""
    commanded = [(name, axis.command, 0.0) for name, axis in log.axes.items() if name in command.axes]
    commanded = [pair for pair in commanded if np.ptp(pair[1]) > MOVES]  # NaN where it was not recorded
    return commanded or [
        (name, reading, machine.axes[name].servo.c)
        for name, axis in log.axes.items()
        for _, reading in _readings(name, axis)
        if np.isfinite(reading).any()
    ]


def _best_start(pairs: Sequence[Pair], command: Command, log: Log) -> float:
    """Find when the program begins [s] after the log does: the least sum of squares, by samples first."""
    from scipy.optimize import minimize_scalar
    from scipy.signal import correlate

    rows, program = log.t.size, math.ceil((command.t[-1] - command.t[0]) / log.period)
    squares = np.zeros(program + rows + 1)
    for name, recorded, late in pairs:
        there = np.isfinite(recorded)
        middle = float(np.mean(recorded[there]))
        made = _at(command, name, log.period * np.arange(-rows, program + rows) - late) - middle
        weighed = np.where(there, recorded - middle, 0.0)
        squares += correlate(made**2, there.astype(np.float64), mode="valid", method="fft")
        squares -= 2.0 * correlate(made, weighed, mode="valid", method="fft")
    first = log.period * (rows - int(np.argmin(squares)))
    found = minimize_scalar(
        lambda start: sum(_misfit(pair, command, log, start) ** 2 for pair in pairs),
        bounds=(first - log.period, first + log.period),
        method="bounded",
        options={"xatol": 1e-4 * log.period},
    )
    return float(found.x)


def _misfit(pair: Pair, command: Command, log: Log, start: float) -> float:
    """Root mean square of what was recorded less what the program makes of it [m]."""
    name, recorded, late = pair
    off = recorded - _at(command, name, log.t - log.t[0] - start - late)
    return math.sqrt(float(np.nanmean(off * off)))
