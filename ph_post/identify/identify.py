"""Identify the drive parameters of the base model: b, c, lost motion and, on load loops, η and β.

No parameter is assumed beforehand except as a starting value. A parameter that the log does not show keeps
the value of the machine file, and the result says so; see :mod:`ph_post.identify.estimates`. Without a
machine file the starting machine is made from the log alone.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np
from msgspec.structs import replace
from threadpoolctl import threadpool_limits

from ph_post.drive.plant import Plant
from ph_post.errors import InputError
from ph_post.identify.cascade_fit import (
    CLEAN,
    MUCH,
    CascadeFit,
    cascaded_axis,
    finest_noise,
    fit_cascade,
    is_better,
    leaves_much,
    with_backlash,
)
from ph_post.identify.direct_readings import CoastDown, find_coast_downs, pooled_rate
from ph_post.identify.drive_fit import (
    BacklashVerdict,
    DriveFit,
    decide_backlash,
    fit_drive,
    fitted_with,
    position_rms,
    tangent,
    why_backlash_hidden,
    with_all_samples,
)
from ph_post.identify.estimates import (
    LEAST_UNCERTAINTY,
    AssessedFit,
    AxisFit,
    estimate_drive,
    identified_axis,
    shown_names,
)
from ph_post.identify.excerpt import excerpt
from ph_post.identify.free_run import PRIOR, AxisProblem, problem_of, residuals, with_known_side
from ph_post.identify.linear_drive import servo_memory, settling_time
from ph_post.identify.log_quality import examine
from ph_post.identify.machinefile import require_writable
from ph_post.identify.starting_machine import StartingMachine, Transmission, starting_lag, starting_machine
from ph_post.progress import Progress, no_progress
from ph_post.types import Axis, AxisLog, Feedback, Log, Machine
from ph_post.types.diagnosis import Identification, IdentifiedDrive, LogQuality

GIVE_UP: Final = ("beta", "eta", "b", "c")
"""Order in which numbers that the log does not show are fixed: those known best from elsewhere first."""

ASSUMED: Final = {"b": 1.0, "c": 1.0, "eta": 0.5, "beta": 1.5}
"""Standard errors of the logarithms of what is assumed because nobody said it."""


def identify(
    log: Log,
    machine: Machine | None = None,
    feedback: Mapping[str, Feedback] | None = None,
    transmission: Mapping[str, Transmission] | None = None,
    for_file: bool = False,
    progress: Progress = no_progress,
) -> Identification:
    """Identify the drives in a log.

    Parameters
    ----------
    log : Log
    machine : Machine, optional
        Gives limits, controller, effects, and what the log does not show.
    feedback : mapping, optional
        Where the loop of an axis closes, by axis; without a machine, for what is not in it, it is assumed
        from which sides were read.
    transmission : mapping, optional
        N and r by axis, where there is no machine.
    for_file : bool, optional
        Refuse before the fit what a new machine file would lack.
    progress : Progress, optional
        Called with what is being done.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        Where the log shows no parameter at all, or contradicts what was given.
    """
    progress("checking the log")
    draft = starting_machine(log, machine, feedback or {}, transmission or {})
    log = excerpt(log, draft.machine)
    quality = examine(log, _nearer(log, draft.machine))
    if quality.faults:
        raise InputError(log.name, f"the log shows no parameter: {quality.faults[0]}")
    if for_file and machine is None:
        require_writable(draft.machine, log.name)
    drives: dict[str, IdentifiedDrive] = {}
    axes = dict(draft.machine.axes)
    for name, axis_log in log.axes.items():
        problem = problem_of(log, name, axes[name], quality) if name in axes else None
        if problem is None:
            continue
        if machine is not None:
            problem = with_known_side(problem)
        progress(f"identifying {name}")
        with threadpool_limits(limits=1, user_api="blas"):  # matrices of few columns
            drives[name], axes[name] = _identify_axis(problem, axis_log, quality, draft, machine is not None)
    if not any(drive.parameters for drive in drives.values()):
        raise InputError(log.name, "the log shows no parameter", expected="an axis that moves and is read")
    notes = [f"{name}: nothing was identified, no reading of it moves" for name in axes if name not in drives]
    return Identification(drives=drives, machine=replace(draft.machine, axes=axes), notes=(*quality.notes, *notes))


def _nearer(log: Log, machine: Machine) -> Machine:
    """Return the machine with the lags that the log has: a file may be far from what was recorded."""
    axes = dict(machine.axes)
    for name, axis_log in log.axes.items():
        axis = axes.get(name)
        if axis is None or axis.servo.cascade is not None:
            continue
        lag = starting_lag(axis_log, axis.loop, log.period)
        if lag is None or lag.c is None or axis.servo.b == 0.0 or axis.servo.ki_over_kp:
            continue
        axes[name] = replace(axis, servo=replace(axis.servo, b=lag.b or 0.25 * lag.c**2, c=lag.c))
    return replace(machine, axes=axes)


def _identify_axis(
    problem: AxisProblem, axis_log: AxisLog, quality: LogQuality, draft: StartingMachine, from_file: bool
) -> tuple[IdentifiedDrive, Axis]:
    axis = problem.axis
    coasts = _coast_downs(problem, axis_log, quality)
    problem = _without(problem, coasts)
    notes, why = draft.assumed.get(axis.name, ()), draft.lagless.get(axis.name)
    if why is not None or axis.servo.cascade is not None:
        cascade = _cascade(problem, axis_log, None)
        if cascade is None or (why is not None and cascade.held_out > MOSTLY * finest_noise(problem)):
            raise why or InputError(axis.name, "no cascade that settles fits the log", expected="gains near the file's")
        return cascaded_axis(problem, cascade, from_file, notes)
    base = fit_drive(problem, _start(problem, axis_log), _base_names(problem.plant))
    much = leaves_much(problem, base.left)
    hidden = why_backlash_hidden(problem, axis_log)
    if much and hidden and not axis.loop.encloses_backlash:
        cascade = _cascade(problem, axis_log, base)
        if cascade is not None:
            return cascaded_axis(problem, cascade, from_file, notes)
        much = False
    verdict = BacklashVerdict(None, None, (hidden,)) if hidden else decide_backlash(problem, base)
    free = [one for one in coasts if not one.coupled]
    plant = base.plant if verdict.fit is None else verdict.fit.plant
    if free:
        plant = replace(plant, beta=pooled_rate(free)[0])
    if verdict.fit is None:
        plant = replace(plant, gap=_kept_gap(axis, verdict))
    counted = with_all_samples(problem)
    names = _all_names(problem.plant, verdict, bool(free))
    settled = AxisFit(
        problem=counted,
        axis_log=axis_log,
        settling=_settle(counted, plant, names, _known(axis, from_file)),
        verdict=verdict,
        coasts=tuple(coasts),
        from_file=from_file,
        notes=notes,
        repeats=quality.repeats(axis.name),
    )
    if much and leaves_much(counted, settled.settling.fit.left):
        cascade = _cascade(problem, axis_log, base if verdict.fit is None else verdict.fit)
        if cascade is not None:
            return cascaded_axis(problem, cascade, from_file, notes)
    drive = estimate_drive(settled)
    return drive, identified_axis(settled, drive)


MOSTLY: Final = 20.0
"""Times the noise that a cascade may leave where nothing else is known of the drive."""


def _cascade(problem: AxisProblem, axis_log: AxisLog, single: DriveFit | None) -> CascadeFit | None:
    """Fit a cascade; None where it predicts the held-out samples no better than a single loop, be it with friction.

    Where such a loop leaves noise alone none is fitted: that takes most of the time of an answer.
    """
    rubbing = None if single is None else _single_with_friction(problem, axis_log, single)
    if rubbing is not None and MUCH * position_rms(problem, rubbing.left, problem.held) <= finest_noise(problem):
        return None
    base = fit_cascade(problem)
    found = None if base is None else with_backlash(problem, base, axis_log)
    if found is None or single is None or rubbing is None:
        return found
    if not is_better(problem, found.fit, single):
        return None
    # No friction looks like a cascade down to the noise.
    if "friction" not in found.fit.names and found.held_out <= CLEAN * finest_noise(problem):
        return found
    return found if is_better(problem, found.fit, rubbing) else None


def _single_with_friction(problem: AxisProblem, axis_log: AxisLog, single: DriveFit) -> DriveFit:
    """Fit a single loop with friction, and with backlash too where the log can show it."""
    rubbing = fitted_with(problem, single, "friction")
    if "gap" in rubbing.names or why_backlash_hidden(problem, axis_log):
        return rubbing
    return fitted_with(problem, rubbing, "gap")


def _coast_downs(problem: AxisProblem, axis_log: AxisLog, quality: LogQuality) -> list[CoastDown]:
    if not quality.repeats(problem.axis.name):  # what moves it besides the command looks like one
        return []
    noise = {one.channel: one.noise for one in quality.channels if one.axis == problem.axis.name}
    position = noise.get("motor", noise.get("act", 0.0))
    memory = servo_memory(problem.axis.servo)
    return find_coast_downs(axis_log, problem.period, position, noise.get("force", 0.0), memory)


def _without(problem: AxisProblem, coasts: list[CoastDown]) -> AxisProblem:
    """Leave out the stretches in which the loop is not closed, and what it needs to settle after them."""
    driven = np.ones(problem.t.size, dtype=np.bool_)
    settle = math.ceil(settling_time(problem.axis) / problem.period)
    for one in coasts:
        driven[one.start : one.stop + settle] = False
    if not np.any(driven & problem.counted):
        raise InputError(
            problem.axis.name,
            "the log holds nothing but a coast-down",
            expected="a motion under control beside it",
        )
    return replace(problem, fit=problem.fit & driven, held=problem.held & driven)


def _start(problem: AxisProblem, axis_log: AxisLog) -> Plant:
    """Return the plant without a gap, with b and c of the file or of the plain lag, whichever fit better."""
    plant = replace(problem.plant, gap=0.0)
    lag = starting_lag(axis_log, plant.loop, problem.period)
    if plant.b == 0.0 or lag is None or lag.c is None:
        return plant
    other = replace(plant, b=lag.b or plant.b, c=lag.c)
    return min((plant, other), key=lambda one: position_rms(problem, residuals(problem, one), problem.fit))


def _base_names(plant: Plant) -> tuple[str, ...]:
    return ("b", "c") if plant.b > 0.0 else ()


def _kept_gap(axis: Axis, verdict: BacklashVerdict) -> float:
    """Return the file's gap unless the log contradicts it."""
    said = axis.gap.lost_motion
    return 0.0 if verdict.bound is not None and said > verdict.bound else said


def _all_names(plant: Plant, verdict: BacklashVerdict, beta_known: bool) -> tuple[str, ...]:
    """Return the numbers that act on a log: those of a gap only where there is one."""
    names = _base_names(plant)
    if verdict.fit is None:
        return names
    if not plant.loop.encloses_backlash:
        return (*names, "gap")
    return (*names, "gap", "eta") if beta_known else (*names, "gap", "eta", "beta")


def _settle(problem: AxisProblem, plant: Plant, names: tuple[str, ...], known: Mapping[str, float]) -> AssessedFit:
    """Fit what shows and hold the rest, until what shows remains the same.

    What is held is let go, as far as it is not known beforehand: what that changes is uncertain, and what
    shows then is fitted.
    """
    start = plant
    shown = tuple(name for name in names if name in ("b", "c", "gap"))
    for last in (False, False, True):
        plant = _bounded(fit_drive(problem, plant, shown).plant)
        held = {name: known[name] for name in names if name not in shown}
        loose = fit_drive(problem, plant, names, priors=held) if held else tangent(problem, plant, names)
        now = shown_names(loose, GIVE_UP)
        if now == shown or last:
            break
        still = {name: getattr(start, name) for name in names if name not in now and name != "gap"}
        plant, shown = replace(loose.plant, **still), now
    return AssessedFit(shown, tangent(problem, plant, names), loose, held)


def _known(axis: Axis, from_file: bool) -> Mapping[str, float]:
    """Return how well the numbers are known before the log, as relative standard errors."""
    if not from_file:
        return ASSUMED
    said = {"b": PRIOR, "c": PRIOR, "eta": axis.uncertainty.gain, "beta": axis.uncertainty.beta}
    return {name: max(error, LEAST_UNCERTAINTY) for name, error in said.items()}


def _bounded(plant: Plant) -> Plant:
    """Keep what the motor alone loses below what the whole axis does."""
    if plant.beta * plant.eta * plant.b <= plant.c:
        return plant
    return replace(plant, beta=plant.c / (plant.eta * plant.b))
