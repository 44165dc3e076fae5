"""A machine to begin with: that of the file, or a draft from the log alone."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace
from scipy.ndimage import gaussian_filter1d

from ph_post.errors import InputError
from ph_post.identify.direct_readings import FollowingLag, assumed_feedback, lag_of, loop_reading
from ph_post.types import LOOPS, USUAL_REFERENCE, Array, Axis, AxisLog, Feedback, Gap, Limits, Log, Loop, Machine, Servo

ASSUMED_ETA: Final = 0.5
"""The motor's part of the inertia where nobody says it."""

ASSUMED_BETA: Final = 1.0
"""The motor's own decay rate where nobody says it [1/s]."""

DIALECT: Final = "linuxcnc"

LIMIT_SMOOTHING: Final = 1.0
"""Standard deviation of the smoothing before a command is differentiated, samples."""


class Transmission(NamedTuple):
    """N and r [m/rad] of an axis, which no log of positions shows."""

    gear_ratio: float
    travel_per_rad: float


class StartingMachine(NamedTuple):
    """A machine to begin with, and what was assumed for it, by axis."""

    machine: Machine
    assumed: Mapping[str, tuple[str, ...]]
    lagless: Mapping[str, InputError] = {}
    """Why an axis is no single loop."""


def starting_machine(
    log: Log,
    machine: Machine | None,
    feedback: Mapping[str, Feedback],
    transmission: Mapping[str, Transmission],
) -> StartingMachine:
    """Return the machine of the file, or without one a draft from the log alone.

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
                    f"--feedback {name}={kind}",
                    "the machine file says another",
                    expected=said,
                    got=kind,
                )
        return StartingMachine(machine, {})
    axes, assumed = {}, {}
    lagless: dict[str, InputError] = {}
    for name, axis_log in log.axes.items():
        made = _starting_axis(log, name, axis_log, feedback.get(name), transmission.get(name), lagless)
        if made is not None:
            axes[name], assumed[name] = made
    if not axes:
        raise InputError(log.name, "no axis can be identified", expected="a reading of an axis that moves")
    return StartingMachine(
        Machine(name=log.name, dialect=DIALECT, servo_period=log.period, axes=axes), assumed, lagless
    )


def starting_lag(axis_log: AxisLog, loop: Loop, period: float) -> FollowingLag | None:
    """Return the following error's coefficients at the loop's side; None where the log does not show them."""
    reading = loop_reading(axis_log, loop)
    if reading is None or np.ptp(axis_log.command) == 0.0 or np.count_nonzero(np.isfinite(reading)) < 200:
        return None
    return lag_of(axis_log.command, reading, period)


def _starting_axis(
    log: Log,
    name: str,
    axis_log: AxisLog,
    feedback: Feedback | None,
    transmission: Transmission | None,
    lagless: dict[str, InputError],
) -> tuple[Axis, tuple[str, ...]] | None:
    """Draft one axis; None where the log has no reading of its motion."""
    if (axis_log.table is None and axis_log.motor is None) or np.ptp(axis_log.command) == 0.0:
        return None
    notes = []
    if feedback is None:
        feedback, why = assumed_feedback(axis_log, log.period)
        notes.append(f'feedback "{feedback}" is assumed: {why}; --feedback {name}=... says otherwise')
    try:
        servo = _starting_servo(log, name, axis_log, LOOPS[feedback])
    except InputError as error:  # a cascade with feed-forward does not lag
        lagless[name] = error
        servo = Servo(b=LAGLESS[0], c=LAGLESS[1])
    gap = Gap(lost_motion=0.0)
    if LOOPS[feedback].encloses_backlash:
        gap = replace(gap, inertia_fraction=ASSUMED_ETA, beta=ASSUMED_BETA)
    if transmission is not None:
        ratio, travel = transmission
        gap = replace(gap, motor_angle=0.0, gear_ratio=ratio, travel_per_rad=travel)
    axis = Axis(
        name=name,
        feedback=feedback,
        servo=servo,
        gap=gap,
        limits=_limits(log, axis_log),
        reference_direction=USUAL_REFERENCE[name],
    )
    return axis, tuple(notes)


def _starting_servo(log: Log, name: str, axis_log: AxisLog, loop: Loop) -> Servo:
    lag = starting_lag(axis_log, loop, log.period)
    if lag is not None and lag.c is not None:
        return Servo(b=lag.b or 0.25 * lag.c**2, c=lag.c)
    if not loop.has_controller:
        return Servo(b=0.0, c=0.0)
    raise InputError(
        f"{log.name}: {name}",
        "no reading that lags behind its command by its speed",
        expected="a drive as Eq. (9) has it, without feedforward, read for 0.2 s at least",
        got=_why_no_lag(loop_reading(axis_log, loop), lag),
    )


def _why_no_lag(reading: Array | None, lag: FollowingLag | None) -> str:
    """Say what there is in place of a lag."""
    if lag is None or reading is None:
        return "too few samples"
    return "a reading that stands still" if np.nanmax(reading) == np.nanmin(reading) else "no lag"


def _limits(log: Log, axis_log: AxisLog) -> Limits:
    """Return what the command reached, freed of the rounding of its digits."""
    velocity = _rate(gaussian_filter1d(axis_log.command, LIMIT_SMOOTHING), log.period)
    acceleration = _rate(velocity, log.period)
    jerk = _rate(acceleration, log.period)
    largest = (float(np.max(np.abs(one))) for one in (velocity, acceleration, jerk))
    reached = [max(float(f"{one:.3g}"), 1e-6) for one in largest]
    return Limits(velocity=reached[0], acceleration=reached[1], jerk=reached[2])


def _rate(values: Array, period: float) -> Array:
    return np.asarray(np.gradient(values, period))


LAGLESS: Final = (1e-4, 0.02)
"""b [s²] and c [s] of a loop that is taken for one whose log shows no lag, until it is a cascade."""
