"""Fit of a cascade to a log, where a single loop leaves more than it: by what is predicted on held-out samples.

Fitted are K_v, ω_v and T_n, the weight of the velocity feed-forward and the dead time of the command, then the backlash
as with a single loop. A current loop and filters of the command hide in the dead time, as far as a log shows no more.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.drive.cascade import is_stable
from ph_post.drive.plant import Plant
from ph_post.identify.drive_fit import (
    BacklashVerdict,
    DriveFit,
    decide_backlash,
    fit_drive,
    position_rms,
    smallest_visible_backlash,
    tangent,
    why_backlash_hidden,
    with_all_samples,
)
from ph_post.identify.free_run import AxisProblem, residuals
from ph_post.types import Array, Axis, AxisLog, Cascade, Servo
from ph_post.types.diagnosis import Channel, Estimate, IdentifiedDrive, Origin, Sensitivity
from ph_post.units import MICROMETRE, MM, MS, PERCENT

GAINS: Final = ("position_gain", "velocity_gain", "integral_rate", "velocity_feedforward", "dead_time")
"""What is fitted of a cascade, by the names of its fields."""

POSITION_GAINS: Final = (15.0, 30.0, 60.0, 120.0)
"""K_v that are tried first [1/s]."""

WEIGHTS: Final = (0.0, 0.7, 0.95, 1.0)
"""Weights of the feed-forward that are tried first."""

QUICKER: Final = 5.0
"""ω_v that is tried first, in units of K_v."""

RATES: Final = (0.7, 2.5)
"""1 / T_n that are tried first, in units of K_v."""

STARTS: Final = 3
"""Starts of which the fit goes on."""

CLEAN: Final = 1.5
"""Times the noise that a complete model may leave."""

BETTER: Final = 0.35
"""Part of what a single loop leaves of held-out samples that a cascade may leave at most."""

MUCH: Final = 0.7
"""Part of it that a cascade has to stay below, however little noise there is."""

VAGUE: Final = 0.25
"""Relative standard error above which a number is not separate from others."""


class CascadeFit(NamedTuple):
    """A fitted cascade: on the fitted half, with its verdict on backlash, and what it leaves of the other half [m]."""

    fit: DriveFit
    verdict: BacklashVerdict
    held_out: float


def finest_noise(problem: AxisProblem) -> float:
    """Return the noise of the positions [m] by their fourth differences, or the noise floor where that is less.

    Nothing that a drive does shows in these at 1 kHz; what repeats badly is no noise here.
    """
    squares = []
    for one in problem.positions:
        bends = np.abs(np.diff(one.values[one.ok], 4))
        squares.append((float(np.median(bends)) / (0.6745 * math.sqrt(70.0))) ** 2)
    return min(math.sqrt(float(np.mean(squares))), problem.noise_floor)


def leaves_much(problem: AxisProblem, left: Mapping[Channel, Array]) -> bool:
    """Whether what a single loop leaves asks for a cascade.

    Not where the file says of the loop that it is PI or PID, or how the axis rubs.
    """
    plant = problem.plant
    if not plant.loop.has_controller or plant.ki or plant.kd or problem.axis.effects or plant.b == 0.0:
        return False
    return position_rms(problem, left, problem.counted) > CLEAN * finest_noise(problem)


def fit_cascade(problem: AxisProblem) -> DriveFit | None:
    """Fit a cascade without backlash to the fitted half of an axis; None where nothing that settles was found."""
    bare = replace(problem.plant, gap=0.0, ki=0.0, kd=0.0)
    tried = [_with_gains(bare, *one) for one in product(POSITION_GAINS, WEIGHTS, RATES)]
    if bare.cascade is not None:
        tried.insert(0, bare)
    tried.sort(key=lambda one: position_rms(problem, residuals(problem, one), problem.fit))
    fits = [fit_drive(problem, one, GAINS, rounds=2) for one in tried[:STARTS]]
    base = min(fits, key=lambda one: position_rms(problem, one.left, problem.fit))
    return base if _settles(base.plant) else None


def with_backlash(problem: AxisProblem, base: DriveFit, axis_log: AxisLog) -> CascadeFit | None:
    """Decide on backlash behind or in a fitted cascade, its gains held; None where it then does not settle."""
    hidden = why_backlash_hidden(problem, axis_log)
    verdict, best = BacklashVerdict(None, None, (hidden,)), base
    if not hidden:
        verdict = decide_backlash(problem, tangent(problem, base.plant, ()))
        if verdict.fit is not None:
            best = fit_drive(problem, verdict.fit.plant, (*GAINS, "gap"), rounds=2)
            verdict = verdict._replace(fit=best)
        elif verdict.bound is not None:
            verdict = verdict._replace(bound=smallest_visible_backlash(problem, base))
    if not _settles(best.plant):
        return None
    return CascadeFit(best, verdict, position_rms(problem, best.left, problem.held))


def is_better(problem: AxisProblem, cascade: DriveFit, single: DriveFit) -> bool:
    """Whether a cascade predicts the held-out samples so much better than a single loop that it is the structure."""
    left, other = (position_rms(one.problem, one.left, problem.held) for one in (cascade, single))
    return left <= max(CLEAN * finest_noise(problem), BETTER * other) and left < MUCH * other


def _with_gains(plant: Plant, gain: float, weight: float, rate: float) -> Plant:
    cascade = Cascade(
        position_gain=gain,
        velocity_gain=QUICKER * gain,
        integral_rate=rate * gain,
        velocity_feedforward=weight,
        dead_time=0.5 * MS,
    )
    b = 1.0 / (cascade.velocity_gain * gain)
    own = min(plant.eta, 1.0) * b * plant.beta if plant.loop.encloses_backlash else 0.0
    return replace(plant, cascade=cascade, b=b, c=own)


def _servo(plant: Plant, stiffness: float | None) -> Servo:
    assert plant.cascade is not None
    return Servo(b=plant.b, c=plant.c + 1.0 / plant.cascade.position_gain, stiffness=stiffness, cascade=plant.cascade)


def _settles(plant: Plant) -> bool:
    return is_stable(_servo(plant, None))


def cascaded_axis(
    problem: AxisProblem, found: CascadeFit, from_file: bool, notes: Sequence[str]
) -> tuple[IdentifiedDrive, Axis]:
    """Fit a cascade to all samples, and return its estimates and the axis with them, rounded as they are written."""
    counted = with_all_samples(problem)
    names = found.fit.names
    plant = fit_drive(counted, found.fit.plant, names).plant
    best = tangent(counted, plant, names)
    spread, sensitivity = _spread(best)
    parameters = _estimates(plant, names, spread)
    said = [*notes, "a cascade predicts the held-out samples better than a single loop", *found.verdict.notes]
    vague = [name for name in GAINS if spread[names.index(name)] > VAGUE and name != "dead_time"]
    if vague:
        words = " and ".join(one.replace("_", " ") for one in vague)
        said.append(f"{words} cannot be told apart by this log, their effect on the path is")
    if found.verdict.fit is None and found.verdict.bound is not None:
        said.append(f"the log shows no backlash above {found.verdict.bound / MICROMETRE:.2g} µm")
    if "gap" in names and plant.loop.encloses_backlash:
        said.append(f"the lost motion is given for inertia_fraction = {plant.eta:.4g}")
    rms = position_rms(counted, best.left, counted.counted)
    if rms > CLEAN * problem.noise_floor:
        said.append(
            f"the free run misses the readings by {rms / MICROMETRE:.3g} µm rms, their noise is "
            f"{problem.noise_floor / MICROMETRE:.2g} µm: something is missing"
        )
    axis = _axis_with(problem.axis, plant, parameters, "gap" in names or found.verdict.bound is not None)
    rest: Origin = "file" if from_file else "assumed"
    kept = ["lost_motion"]
    if plant.loop.encloses_backlash:
        kept += ["inertia_fraction", "motor_time_constant"]
    origins: dict[str, Origin] = dict.fromkeys((name for name in kept if name not in parameters), rest)
    origins |= dict.fromkeys(parameters, "record")
    drive = IdentifiedDrive(
        parameters=parameters,
        origins=origins,
        rms=rms,
        noise=problem.noise_floor,
        sensitivity=sensitivity,
        notes=tuple(said),
    )
    return drive, axis


def _spread(fit: DriveFit) -> tuple[Array, Sensitivity]:
    """Return standard errors of the numbers as they are fitted, and how well the log shows them."""
    columns = fit.jacobian / math.sqrt(fit.worth)
    _, values, directions = np.linalg.svd(columns, full_matrices=False)
    inverse = np.divide(1.0, values, out=np.full_like(values, 1e9), where=values > 1e-9)
    spread = np.sqrt(np.sum((directions.T * inverse) ** 2, axis=1))
    shown = values * VAGUE > 1.0
    weak = tuple(
        {name: float(part) for name, part in zip(fit.names, row, strict=True) if abs(part) >= 0.3}
        for row in directions[~shown]
    )
    return spread, Sensitivity(
        names=fit.names,
        singular_values=tuple(float(one) for one in values),
        rank=int(np.count_nonzero(shown)),
        weak=weak,
    )


def _estimates(plant: Plant, names: Sequence[str], spread: Array) -> dict[str, Estimate]:
    """Return the numbers in the units of a machine file."""
    cascade = plant.cascade
    assert cascade is not None
    error = dict(zip(names, spread.tolist(), strict=True))
    time = 1.0 / cascade.integral_rate / MS
    found = {
        "position_gain": Estimate(
            value=cascade.position_gain, stderr=cascade.position_gain * error["position_gain"], unit="1/s"
        ),
        "velocity_gain": Estimate(
            value=cascade.velocity_gain, stderr=cascade.velocity_gain * error["velocity_gain"], unit="1/s"
        ),
        "velocity_integral_time": Estimate(value=time, stderr=time * error["integral_rate"], unit="ms"),
        "velocity_feedforward": Estimate(
            value=cascade.velocity_feedforward / PERCENT, stderr=error["velocity_feedforward"] / PERCENT, unit="%"
        ),
        "dead_time": Estimate(value=round(cascade.dead_time / MS, 6), stderr=error["dead_time"], unit="ms"),
    }
    if "gap" in names:
        found["lost_motion"] = Estimate(value=plant.gap / MM, stderr=error["gap"] * MICROMETRE / MM, unit="mm")
    return found


KEYS: Final = {
    "position_gain": "control.position_gain_per_s",
    "velocity_gain": "control.velocity_gain_per_s",
    "velocity_integral_time": "control.velocity_integral_time_ms",
    "velocity_feedforward": "control.velocity_feedforward_percent",
    "dead_time": "control.dead_time_ms",
}
"""Keys of the machine file by the names of parameters."""


def cascade_values(cascade: Cascade) -> dict[str, float]:
    """Return the numbers of a cascade that :data:`KEYS` write, as they are written.

    Examples
    --------
    >>> cascade_values(Cascade(position_gain=40.0, velocity_gain=200.0, integral_rate=50.0))["velocity_integral_time"]
    20.0
    """
    values = {
        "position_gain": cascade.position_gain,
        "velocity_gain": cascade.velocity_gain,
        "velocity_integral_time": 1.0 / cascade.integral_rate / MS if cascade.integral_rate else None,
        "velocity_feedforward": cascade.velocity_feedforward / PERCENT,
        "dead_time": cascade.dead_time / MS,
    }
    return {name: float(f"{value:.7g}") for name, value in values.items() if value is not None}


def _axis_with(axis: Axis, plant: Plant, parameters: dict[str, Estimate], gap_known: bool) -> Axis:
    """Return the axis with what was identified, as the machine file will say it."""
    cascade = plant.cascade
    assert cascade is not None
    values = {name: float(f"{one.value:.7g}") for name, one in parameters.items()}
    cascade = replace(
        cascade,
        position_gain=values["position_gain"],
        velocity_gain=values["velocity_gain"],
        integral_rate=1.0 / (values["velocity_integral_time"] * MS),
        velocity_feedforward=values["velocity_feedforward"] * PERCENT,
        dead_time=values["dead_time"] * MS,
    )
    b = 1.0 / (cascade.velocity_gain * cascade.position_gain)
    gap = axis.gap
    damping = 0.0 if gap.beta is None else (gap.inertia_fraction or 1.0) * b * gap.beta
    if "lost_motion" in values or gap_known:
        gap = gap.with_lost_motion(values.get("lost_motion", 0.0) * MM)
    servo = Servo(b=b, c=damping + 1.0 / cascade.position_gain, stiffness=axis.servo.stiffness, cascade=cascade)
    limits = replace(axis.limits, motor_acceleration=None) if axis.loop.encloses_backlash else axis.limits
    return replace(axis, servo=servo, gap=gap, limits=limits)
