"""The machine that an identification begins with: that of the file, or one made of the record alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace
from scipy.ndimage import gaussian_filter1d

from ph_post.diagnose.startvalues import Lag, assumed_feedback, lag_of, loop_reading
from ph_post.errors import InputError
from ph_post.types import Array, Axis, AxisLog, Feedback, Gap, Limits, Log, Machine, Servo

ETA: Final = 0.5
"""The motor's part of the inertia where nobody says it."""

BETA: Final = 1.0
"""The motor's own decay rate where nobody says it [1/s]."""

DIALECT: Final = "linuxcnc"

SMOOTH: Final = 2.0
"""Standard deviation of the smoothing before a command is differentiated, samples."""


class Transmission(NamedTuple):
    """N and r [m/rad] of an axis, which no record of positions shows."""

    gear_ratio: float
    travel_per_rad: float


class Draft(NamedTuple):
    """A machine to begin with, and what was assumed for it, by axis."""

    machine: Machine
    assumed: Mapping[str, tuple[str, ...]]


def draft_machine(
    log: Log,
    machine: Machine | None,
    feedback: Mapping[str, Feedback],
    transmission: Mapping[str, Transmission],
) -> Draft:
    """Return the machine of the file, or for want of one what the record alone tells.

    Raises
    ------
    InputError
        Where a reading does not follow its command, or the file says another feedback.
    """
    if machine is not None:
        for name, kind in feedback.items():
            if name in machine.axes and machine.axes[name].feedback != kind:
                said = machine.axes[name].feedback
                raise InputError(
                    f"--feedback {name}={kind}", "the machine file says another",
                    expected=said, got=kind,
                )  # fmt: skip
        return Draft(machine, {})
    axes, assumed = {}, {}
    for name, record in log.axes.items():
        made = _axis(log, name, record, feedback.get(name), transmission.get(name))
        if made is not None:
            axes[name], assumed[name] = made
    if not axes:
        raise InputError(log.name, "no axis can be identified", expected="a reading of an axis that moves")
    return Draft(Machine(name=log.name, dialect=DIALECT, servo_period=log.period, axes=axes), assumed)


def start_lag(record: AxisLog, feedback: Feedback, period: float) -> Lag | None:
    """Return the following error's coefficients at the loop's side; None where nothing tells them."""
    reading = loop_reading(record, feedback)
    if reading is None or np.ptp(record.command) == 0.0 or np.count_nonzero(np.isfinite(reading)) < 200:
        return None
    return lag_of(record.command, reading, period)


def _axis(
    log: Log, name: str, record: AxisLog, feedback: Feedback | None, transmission: Transmission | None
) -> tuple[Axis, tuple[str, ...]] | None:
    """Draft one axis; None where the record has no reading of its motion."""
    if (record.table is None and record.motor is None) or np.ptp(record.command) == 0.0:
        return None
    notes = []
    if feedback is None:
        feedback, why = assumed_feedback(record, log.period)
        notes.append(f'feedback "{feedback}" is assumed: {why}; --feedback {name}=... says otherwise')
    servo = _servo(log, name, record, feedback)
    gap = Gap(lost_motion=0.0)
    if feedback == "load":
        gap = replace(gap, inertia_fraction=ETA, beta=BETA)
    if transmission is not None:
        ratio, travel = transmission
        gap = replace(gap, motor_angle=0.0, gear_ratio=ratio, travel_per_rad=travel)
    return Axis(name=name, feedback=feedback, servo=servo, gap=gap, limits=_limits(log, record)), tuple(notes)


def _servo(log: Log, name: str, record: AxisLog, feedback: Feedback) -> Servo:
    lag = start_lag(record, feedback, log.period)
    if lag is not None and lag.c is not None:
        return Servo(b=lag.b or 0.25 * lag.c**2, c=lag.c)
    if feedback == "none":
        return Servo(b=0.0, c=0.0)
    raise InputError(
        f"{log.name}: {name}", "no reading that lags behind its command by its speed",
        expected="a drive as Eq. (9) has it, without feedforward, read for 0.2 s at least",
        got="no lag" if lag is not None else "too few samples",
    )  # fmt: skip


def _limits(log: Log, record: AxisLog) -> Limits:
    """Return what the command reached, freed of the rounding of its digits."""
    velocity = _rate(gaussian_filter1d(record.command, SMOOTH), log.period)
    acceleration = _rate(velocity, log.period)
    jerk = _rate(acceleration, log.period)
    largest = (float(np.max(np.abs(one))) for one in (velocity, acceleration, jerk))
    reached = [max(float(f"{one:.3g}"), 1e-6) for one in largest]
    return Limits(velocity=reached[0], acceleration=reached[1], jerk=reached[2])


def _rate(values: Array, period: float) -> Array:
    return np.asarray(np.gradient(values, period))
