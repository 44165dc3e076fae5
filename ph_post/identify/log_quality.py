"""The quality of a log before anything is fitted to it: resolution, noise, start-up, delay and faults."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Final, Literal, NamedTuple

import numpy as np

from ph_post.drive.cascade import way_of_motor
from ph_post.files.check import counted
from ph_post.identify import noise
from ph_post.identify.between import interpolation_error, parts_between, refined
from ph_post.identify.linear_drive import (
    find_shift,
    linear_position,
    linear_response,
    servo_memory,
    settling_time,
    taken_up,
)
from ph_post.identify.noise import Repeat, find_repeats
from ph_post.types import Array, Axis, Log, Machine, Servo
from ph_post.types.diagnosis import Channel, ChannelQuality, LogQuality, recorded_channels
from ph_post.units import MICROMETRE, MM, MS

ON_GRID: Final = 0.97
"""Part of the steps between neighbouring values that must be whole numbers of the quantum."""

OFF: Final = 0.08
"""Part of a quantum by which a step may miss a whole number and still count as one."""

VISIBLE: Final = 0.1
"""Quantum against noise below which a grid adds nothing: a hundredth of q²/12 of the noise's square."""

FEW: Final = 4
"""Fewer different values than this show no grid."""


def find_quantum(reading: Array, rounding: float) -> float:
    """Find the quantum of a reading.

    A file with so many decimals lays a grid of its own over that of the encoder, which need not be a multiple
    of it: values closer than the rounding are taken as one before the finer search is made.

    Parameters
    ----------
    reading : Array, shape (n,)
        NaN where a sample is missing.
    rounding : float
        Last decimal of the file, at a guess; in the unit of the reading.

    Returns
    -------
    float
        0 where there is no grid.
    """
    values = np.unique(reading[np.isfinite(reading)])
    if values.size < 2:
        return 0.0
    coarse = _spacing(_merged(values, 1.2 * rounding), 1.2 * rounding)
    if coarse > 6.0 * rounding:
        return coarse
    scale = float(np.max(np.abs(values)))
    return _spacing(_merged(values, 8.0 * np.finfo(np.float64).eps * scale), 0.0)


def visible_quantum(quantum: float, noise: float) -> float:
    """Quantum as far as it shows against the noise, else 0."""
    return quantum if quantum > VISIBLE * noise else 0.0


def _merged(values: Array, closer: float) -> Array:
    """Mean of each cluster of sorted values that lie closer together than that; none if a cluster is wide."""
    starts = np.flatnonzero(np.concatenate(([True], np.diff(values) > closer)))
    ends = np.concatenate((starts[1:], [values.size])) - 1
    if np.any(values[ends] - values[starts] > 2.0 * closer):
        return np.empty(0)
    counts = ends - starts + 1
    return np.asarray(np.add.reduceat(values, starts) / counts, dtype=np.float64)


def _spacing(values: Array, blur: float) -> float:
    """Greatest common step of sorted values, each off by up to `blur`; 0 where they have none."""
    steps = np.diff(values)
    if steps.size == 0:
        return 0.0
    smallest = float(np.min(steps))
    quantum = float(np.mean(steps[steps <= 1.5 * smallest + blur]))
    if steps.size + 1 < FEW:
        return quantum if np.ptp(steps) <= 0.02 * quantum else 0.0
    for longest in (5.0, 20.0, 80.0, np.inf):  # the better it is known the longer a step may be
        tried = steps[steps <= longest * smallest]
        whole = np.round(tried / quantum)
        on = np.abs(tried - whole * quantum) <= OFF * quantum + blur
        if np.mean(on) < ON_GRID:
            return 0.0
        quantum = float(np.sum(tried[on]) / np.sum(whole[on]))
    return quantum


TAKE_UP: Final = 0.5 * MM
"""Travel after which a flank is taken up, whatever the gap that the file knows of [m]."""

LARGEST_START: Final = 0.2
"""Part of a log that the start-up may take at most."""

COARSE: Final = 0.02 * MM
"""Quantum above which a reading may be too coarse to show anything [m]."""

GRID_NOISE: Final = 1.1 / math.sqrt(12.0)
"""Least noise of a reading on a grid, by its quantum: that of even rounding and a tenth more.

The error of rounding repeats with the motion, so that repeats do not see all of it, and it is not even where
the motion keeps step with the grid.
"""

ROUNDING: Final = {"act": 1e-6 * MM, "motor": 1e-6 * MM, "force": 1e-6}
"""Last decimal that files usually have, by channel [m, or the effort's unit]."""

WANDERS: Final = 3.0
"""Times the sample to sample noise from which an axis is taken to move while it should stand."""

UNLIKE: Final = 10.0
"""Times the sample to sample noise up to which what differs between repeats is noise."""

SAID_BETWEEN: Final = 0.5
"""Part of a reading's noise from which the command between rows is said to be a part of it."""

IN_MS: Final = 0.25
"""Period [s] from which on the times of a log may count milliseconds: drives are recorded 4 times a ms at most."""

SAMPLES_A_MEMORY: Final = 2.0
"""Samples that a servo time constant needs so that its answer can be seen."""


NoiseFrom = Literal["repeats", "stationary stretches", "differences"]


class ChannelReading(NamedTuple):
    """One recorded channel of one axis."""

    axis: str
    channel: Channel
    values: Array


def examine(log: Log, machine: Machine) -> LogQuality:
    """Find out what a log can show.

    Parameters
    ----------
    log : Log
    machine : Machine
        With a drive for every axis of the log; its b and c give what the command alone explains.

    Returns
    -------
    LogQuality
        With `faults` where the log can show nothing.
    """
    first = first_settled(log, machine, 0, log.t.size)
    readings = tuple(list_readings(log))
    repeats = _settled_repeats(log, machine, first)
    channels: list[ChannelQuality] = []
    for reading in readings:  # an effort comes behind the positions
        moved = {one.axis for one in channels if one.unrepeated is not None}
        answers = reading.channel == "force" and reading.axis in moved
        channels.append(_channel(log, machine, reading, repeats, first, answers=answers))
    return LogQuality(
        period=log.period,
        jitter=log.jitter,
        first=first,
        channels=tuple(channels),
        faults=tuple(_faults(log, machine, readings, channels, first)),
        notes=tuple(_notes(log, readings, channels, repeats, machine)),
    )


def list_readings(log: Log) -> Iterator[ChannelReading]:
    """Yield the channels that were recorded, by axis."""
    for name, axis in log.axes.items():
        for channel, values in recorded_channels(axis).items():
            yield ChannelReading(name, channel, values)


def first_settled(log: Log, machine: Machine, start: int, stop: int) -> int:
    """First sample, counted from `start`, behind the start-up of a stretch, but no more than a part of it."""
    return min(settled_after(log, machine, start, stop), math.floor(LARGEST_START * (stop - start)))


def settled_after(log: Log, machine: Machine, start: int, stop: int) -> int:
    """Count the samples from `start` on after which servo and flanks have settled."""
    behind = 0.0
    for name, axis in log.axes.items():
        if name not in machine.axes:
            continue
        drive = machine.axes[name]
        travel = max(TAKE_UP, 2.0 * drive.gap.lost_motion)
        flank = taken_up(axis.command[start:stop], travel) * log.period
        behind = max(behind, settling_time(drive), flank + 3.0 * servo_memory(drive.servo) * (flank > 0.0))
    return math.ceil(behind / log.period)


def _settled_repeats(log: Log, machine: Machine, first: int) -> tuple[Repeat, ...]:
    """Repeats of which both runs have forgotten how they began."""
    commands = np.array([axis.command for axis in log.axes.values()])
    found = []
    for repeat in find_repeats(commands, log.period, _tolerance(log, machine)):
        settle = max(first_settled(log, machine, repeat.start, repeat.stop), _memory(log, machine))
        start = max(repeat.start + settle, first + math.ceil(repeat.lag))
        if repeat.start == math.ceil(repeat.lag):
            start = first + repeat.start  # the first run is the beginning of the log
        if repeat.stop - start >= 0.25 / log.period:
            found.append(repeat._replace(start=start))
    return tuple(found)


def _memory(log: Log, machine: Machine) -> int:
    """Count the samples after which the slowest axis has settled."""
    times = [settling_time(machine.axes[name]) for name in log.axes if name in machine.axes]
    return math.ceil(max(times, default=0.0) / log.period)


def _tolerance(log: Log, machine: Machine) -> float:
    """Most difference of two commands that are the same [m]: far below the noise of the readings."""
    found = [
        noise.noise_of_differences(one.values - linear_position(log, machine, one.axis))
        for one in list_readings(log)
        if one.channel != "force"
    ]
    return 0.3 * min((value for value in found if value is not None), default=0.0)


def _channel(
    log: Log, machine: Machine, reading: ChannelReading, repeats: tuple[Repeat, ...], first: int, *, answers: bool
) -> ChannelQuality:
    """Quality of one channel; an effort `answers` what moves the position besides the command, which is no noise."""
    values = reading.values
    # What other axes do may move this one: still is where all of them are.
    steps = [np.abs(np.diff(axis.command, prepend=axis.command[:1])) for axis in log.axes.values()]
    travelled = np.cumsum(np.sum(steps, axis=0))
    position = reading.channel != "force"
    smooth = linear_position(log, machine, reading.axis)
    fast = noise.noise_of_differences((values - smooth if position else values)[first:]) or 0.0
    quantum = find_quantum(values, ROUNDING[reading.channel])
    source: NoiseFrom
    size, source = noise.noise_of_repeats(values, repeats, log.period), "repeats"
    most = UNLIKE * max(fast, GRID_NOISE * quantum)
    unrepeated = size if size is not None and (answers or size > most > 0.0) else None
    if unrepeated is not None:
        size = None if answers else most
    still = noise.noise_of_standstill(values, travelled, _memory(log, machine), log.period)
    # An axis that hums while it should stand, or wanders in the gap of its loop, moves: that is no noise.
    drive = machine.axes.get(reading.axis)
    wanders = still is not None and still > WANDERS * fast
    wanders = wanders and (
        (drive is not None and drive.loop.encloses_backlash)
        or noise.oscillates(values, travelled, _memory(log, machine))
    )
    # What differs between repeats may be the other axes' doing, so that the smaller of the two counts.
    if still is not None and not wanders and (size is None or still < size):
        size, source = still, "stationary stretches"
    if size is None:
        size, source = fast, "differences"
    size = math.hypot(size, _between(log, drive, reading))
    quantum = visible_quantum(quantum, max(size, fast))
    return ChannelQuality(
        axis=reading.axis,
        channel=reading.channel,
        resolution=quantum,
        noise=max(size, GRID_NOISE * quantum),
        noise_from=source,
        missing=int(np.count_nonzero(np.isnan(values if log.counted is None else values[log.counted]))),
        shift=find_shift(log, machine, reading.axis, values, first) if position else None,
        unrepeated=unrepeated,
    )


def _between(log: Log, drive: Axis | None, reading: ChannelReading) -> float:
    """Return what the command may do between its rows to a reading, root mean square [m or the effort's unit]."""
    if drive is None:
        return 0.0
    command = log.axes[reading.axis].command
    if reading.channel == "force":
        return _effort_between(command, drive.servo, reading.values, log.period)
    answer = linear_response(interpolation_error(command, log.period), drive.servo, log.period)
    return math.sqrt(float(np.mean(answer**2)))


EFFORT_ORDERS: Final = (2.0, 4.0)
"""By how much the error of an effort falls at least, and at most, where the period is halved."""


def _effort_between(command: Array, servo: Servo, effort: Array, period: float) -> float:
    """Return the same of an effort: rows of the command are left out, and less comes of it as it did before."""
    if parts_between(period) == 1 or servo.b == 0.0:
        return 0.0
    whole = _moving_effort(command, servo, period)
    off = []
    for every in (2, 4):
        coarse = _moving_effort(command[::every], servo, every * period)
        off.append(math.sqrt(float(np.mean((whole[::every][: coarse.size] - coarse) ** 2))))
    known = np.isfinite(effort)
    gain = float(whole[known] @ effort[known]) / max(float(whole[known] @ whole[known]), 1e-300)
    return abs(gain) * off[0] / min(max(off[1] / max(off[0], 1e-300), EFFORT_ORDERS[0]), EFFORT_ORDERS[1])


def _moving_effort(command: Array, servo: Servo, period: float) -> Array:
    """Return what a motion takes, F/K, shape (n,) [m]: inertia and damping, without friction."""
    parts = parts_between(period)
    fine = period / parts
    speed = np.gradient(way_of_motor(servo, refined(command - command[0], parts), fine), fine)
    return np.asarray(servo.b * np.gradient(speed, fine) + servo.damping * speed)[::parts]


def _faults(
    log: Log,
    machine: Machine,
    readings: tuple[ChannelReading, ...],
    channels: Sequence[ChannelQuality],
    first: int,
) -> Iterator[str]:
    """Yield why the log can show nothing at all."""
    if not any(np.ptp(axis.command) > 0.0 for axis in log.axes.values()):
        yield "no axis is commanded to move"
    if not readings:
        yield "the log holds commands but no reading of any axis"
        return
    if all(np.isnan(r.values).all() or np.nanmax(r.values) == np.nanmin(r.values) for r in readings):
        yield "no reading changes from the first sample to the last: nothing was measured"
        return
    yield from _too_short(log, machine)
    coarse = [
        _coarse(log, machine, reading, quality.resolution, first)
        for reading, quality in zip(readings, channels, strict=True)
        if reading.channel != "force"
    ]
    if coarse and all(coarse):
        yield from (sentence for sentence in coarse if sentence)


def _too_short(log: Log, machine: Machine) -> Iterator[str]:
    """Yield a sentence where a servo has no time to settle, or too few samples to be seen."""
    for name in log.axes:
        if name not in machine.axes:
            continue
        needed, memory = settling_time(machine.axes[name]), servo_memory(machine.axes[name].servo)
        if log.t.size * log.period <= needed:
            yield (
                f"the log lasts {log.t.size * log.period:.3g} s; the servo of {name} needs {needed:.3g} s "
                "to forget how it started"
            )
        if 0.0 < memory < log.period / SAMPLES_A_MEMORY:
            counts = "; if t counts milliseconds, --column t=t:ms" if log.period >= IN_MS else ""
            yield (
                f"samples are {log.period / MS:.4g} ms apart; the servo of {name} answers within "
                f"{memory / MS:.3g} ms and its motion between samples is not seen{counts}"
            )


def _coarse(log: Log, machine: Machine, reading: ChannelReading, quantum: float, first: int) -> str | None:
    """Say that a reading is too coarse: it is off what the command explains by no more than its grid."""
    drive = machine.axes.get(reading.axis)
    gap = 0.0 if drive is None else drive.gap.lost_motion
    if quantum <= max(COARSE, gap):
        return None
    apart = (reading.values - linear_position(log, machine, reading.axis))[first:]
    apart = apart[np.isfinite(apart)]
    off = float(np.std(apart)) if apart.size else 0.0
    if off > quantum:
        return None
    side = f"{reading.axis}_{reading.channel}"
    return (
        f"{side} reads in steps of {quantum / MM:.3g} mm and is {off / MM:.3g} mm rms off what the command "
        f"alone explains: a reading in steps of {quantum / MM:.3g} mm cannot show backlash or friction"
    )


def _notes(
    log: Log,
    readings: tuple[ChannelReading, ...],
    channels: Sequence[ChannelQuality],
    repeats: tuple[Repeat, ...],
    machine: Machine,
) -> Iterator[str]:
    """Yield what else a person should know."""
    if log.windows:
        held = sum(stop - start for start, stop in log.windows)
        places = ", ".join(f"{start:.4g}" for start, _ in log.windows)
        yield (
            f"of the long log {held:.3g} s count, in {counted(len(log.windows), 'window')} that show most of its"
            f" speeds, reversals and places: from {places} s on"
        )
    if log.jitter > 0.1 * log.period:
        yield f"samples are up to {log.jitter / MS:.3g} ms off a constant period of {log.period / MS:.3g} ms"
    if log.missing:
        yield f"{log.missing} of {log.t.size} rows are missing"
    if repeats:
        length = sum(repeat.stop - repeat.start for repeat in repeats) * log.period
        yield (
            f"the same motion was run again after {repeats[0].lag * log.period:.6g} s; the noise is what "
            f"differs between the runs, compared over {length:.3g} s"
        )
    for reading, quality in zip(readings, channels, strict=True):
        yield from _channel_notes(reading, quality, log, machine)


def _channel_notes(reading: ChannelReading, quality: ChannelQuality, log: Log, machine: Machine) -> Iterator[str]:
    """Yield what a person should know about one channel."""
    side = f"{reading.axis}_{reading.channel}"
    between = _between(log, machine.axes.get(reading.axis), reading)
    unit, of = ("", 1.0) if reading.channel == "force" else (" µm", MICROMETRE)
    if between > SAID_BETWEEN * quality.noise:
        yield (
            f"{side}: rows are {log.period / MS:.3g} ms apart, which is long for this drive: what its command does in"
            f" between is known to {between / of:.2g}{unit} of the reading, and counts as noise"
        )
    if quality.missing:
        yield f"{side}: {quality.missing} of {log.t.size} samples are missing"
    if quality.unrepeated is not None:
        yield (
            f"{side}: runs of the same motion differ by {quality.unrepeated / of:.3g}{unit} rms, far more than"
            " the reading changes from sample to sample: something does not repeat, which is not taken for noise"
        )
    if quality.noise_from == "differences" and quality.unrepeated is None:
        yield f"{side}: no motion is repeated and none stands still, a slow wander of the reading is not seen"
    if quality.shift is not None and abs(quality.shift) > 0.1 * log.period:
        late = "late" if quality.shift > 0.0 else "early"
        yield f"{side} is {abs(quality.shift) / MS:.3g} ms {late}, beyond what the drive explains"
