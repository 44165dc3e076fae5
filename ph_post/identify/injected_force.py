"""Forces that a drive gives without its loop asking for them: test pulses, torque from another program.

A P loop asks for K (cmd - reading) less what its velocity gain takes, whatever the axis carries. What an effort was
recorded beyond that was given from elsewhere, and moves the axis as F/K more of command would.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from msgspec.structs import replace
from scipy.ndimage import gaussian_filter1d

from ph_post.types import Array, Axis, AxisLog, Log, Machine
from ph_post.types.diagnosis import LogQuality
from ph_post.units import MICROMETRE

EXPLAINS: Final = 0.5
"""Part of what runs of the same motion differ by that such a force moves the axis by at least."""

SMOOTHING: Final = 1.0
"""Width of the Gaussian that smooths a reading whose speed and acceleration are taken [rows]."""

LAG: Final = 60
"""Rows over which differences are taken: what is switched on and off is seen in few of them."""

ROUNDS: Final = 20
LITTLE: Final = 1e-4
"""Rounds of weighing of a fit by absolute values, and the part of the greatest that counts as nothing."""


def with_injected_forces(log: Log, machine: Machine, quality: LogQuality) -> tuple[Log, tuple[str, ...]]:
    """Return a log with such forces in its commands, as F/K, and a sentence for each.

    Only where runs of the same motion differ: whatever a loop does that the file does not know repeats with the motion.

    Parameters
    ----------
    log : Log
    machine : Machine
    quality : LogQuality
        Of the same log.

    Returns
    -------
    tuple of Log and tuple of str
        The log itself, and no sentence, where there is no such force.
    """
    axes, said = dict(log.axes), []
    for one in quality.channels:
        axis, axis_log = machine.axes[one.axis], log.axes[one.axis]
        if one.unrepeated is None or one.channel != axis.loop.own_channel:
            continue
        force = injected_force(axis_log, axis, log.period)
        if force is None or axis.servo.stiffness is None:
            continue
        if np.std(force) < EXPLAINS * axis.servo.stiffness * one.unrepeated:
            continue
        # A drive gives from row to row what it begins with; a command runs on in between.
        meant = 0.5 * (force + np.concatenate([force[:1], force[:-1]]))
        shift = meant / axis.servo.stiffness
        axes[one.axis] = replace(axis_log, command=axis_log.command + shift, effort=axis_log.effort + (meant - force))
        low, high = np.percentile(force, (5.0, 95.0))
        said.append(
            f"{one.axis}: the drive gave a force that its loop did not ask for, from {low:.3g} to {high:.3g} N by"
            f" {one.axis}_force. It moves the axis by up to {np.ptp(shift) / MICROMETRE:.3g} µm, does not repeat with"
            " the motion, and is taken as known"
        )
    return (replace(log, axes=axes), tuple(said)) if said else (log, ())


def injected_force(axis_log: AxisLog, axis: Axis, period: float) -> Array | None:
    """Return what an effort was beyond what its P loop asked for, shape (n,) [N].

    F - K e + D (v - T v'), with K of the file, and D and the time T by which the drive reads its speed late as they
    fit best.

    Parameters
    ----------
    axis_log : AxisLog
    axis : Axis
    period : float
        [s].

    Returns
    -------
    Array or None
        None where reading, effort or ``servo_stiffness_n_per_mm`` is not known, or the loop is another one.
    """
    servo = axis.servo
    reading = axis.loop.closed_over(axis_log.table, axis_log.motor)
    if reading is None or axis_log.effort is None or axis_log.effort_unit != "N" or servo.stiffness is None:
        return None
    if servo.cascade is not None or servo.ki_over_kp or servo.kd_over_kp:
        return None
    beyond = axis_log.effort - servo.stiffness * (axis_log.command - reading)
    known = np.isfinite(beyond)
    speed = np.gradient(gaussian_filter1d(np.where(known, reading, axis_log.command), SMOOTHING), period)
    columns = np.stack([speed, np.gradient(speed, period)], axis=1)
    ends = known[LAG:] & known[:-LAG]
    differences = (columns[LAG:] - columns[:-LAG])[ends], (beyond[LAG:] - beyond[:-LAG])[ends]
    return np.where(known, beyond - columns @ _least_absolute(*differences), 0.0)


def _least_absolute(columns: Array, values: Array) -> Array:
    """Return the factors (k,) of columns (n, k) that leave the least sum of absolute values."""
    weights = np.ones(values.size)
    for _ in range(ROUNDS):
        factors = np.linalg.lstsq(columns * weights[:, None], values * weights, rcond=None)[0]
        left = np.abs(values - columns @ factors)
        weights = 1.0 / np.sqrt(np.maximum(left, LITTLE * np.max(left)))
    return np.asarray(factors)
