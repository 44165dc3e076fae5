"""Drive parameters of the base model from a record: b, c, the gap and, on load loops, η and β.

Nothing is known of a number beforehand but where the search begins. What the record does not show is held at
what the machine file says, and said; see :mod:`ph_post.diagnose.separation`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.coastdown import CoastDown, find_coast_downs, pooled
from ph_post.diagnose.draftmachine import Draft, Transmission, draft_machine, start_lag
from ph_post.diagnose.drivefit import DriveFit, fit_drive, position_rms, tangent, whole
from ph_post.diagnose.gapsearch import GapVerdict, judge_gap, why_hidden
from ph_post.diagnose.identification import Drive, Identification
from ph_post.diagnose.identifyaxis import Settled, identified_axis, told_drive
from ph_post.diagnose.model import Problem, problem_of
from ph_post.diagnose.quality import examine
from ph_post.diagnose.record import Quality
from ph_post.diagnose.response import servo_memory, settling_time
from ph_post.diagnose.separation import between_samples, sensitivity_of, shown_names
from ph_post.drive.plant import Plant
from ph_post.errors import InputError
from ph_post.types import Axis, AxisLog, Feedback, Log, Machine

GIVE_UP: Final = ("beta", "eta", "b", "c")
"""What is held first where it does not show: the more is known of it from elsewhere, the earlier."""

ROUNDS: Final = 3
"""How often the fit is begun anew by what it shows."""


def quiet(_words: str) -> None:
    """Say nothing."""


def identify(
    log: Log,
    machine: Machine | None = None,
    feedback: Mapping[str, Feedback] | None = None,
    transmission: Mapping[str, Transmission] | None = None,
    stage: Callable[[str], None] = quiet,
) -> Identification:
    """Identify the drives of a record.

    Parameters
    ----------
    log : Log
    machine : Machine, optional
        Gives limits, controller, effects, and what the record does not show.
    feedback : mapping, optional
        Where the loop of an axis closes, by axis; without a machine, for what is not in it, it is assumed
        from which sides were read.
    transmission : mapping, optional
        N and r by axis, where there is no machine.
    stage : callable, optional
        Told what is being done.

    Returns
    -------
    Identification

    Raises
    ------
    InputError
        Where the record shows no parameter at all, or contradicts what was given.
    """
    stage("looking at the record")
    draft = draft_machine(log, machine, feedback or {}, transmission or {})
    quality = examine(log, draft.machine)
    if quality.faults:
        raise InputError(log.name, f"the record shows no parameter: {quality.faults[0]}")
    drives: dict[str, Drive] = {}
    axes = dict(draft.machine.axes)
    for name, record in log.axes.items():
        problem = problem_of(log, name, axes[name], quality) if name in axes else None
        if problem is None:
            continue
        stage(f"identifying {name}")
        drives[name], axes[name] = _identify_axis(
            problem, record, quality, draft, machine is not None
        )  # fmt: skip
    if not any(drive.parameters for drive in drives.values()):
        raise InputError(log.name, "the record shows no parameter", expected="an axis that moves and is read")
    notes = [f"{name}: nothing was identified, no reading of it moves" for name in axes if name not in drives]
    return Identification(
        drives=drives, machine=replace(draft.machine, axes=axes), notes=(*quality.notes, *notes)
    )  # fmt: skip


def _identify_axis(
    problem: Problem, record: AxisLog, quality: Quality, draft: Draft, from_file: bool
) -> tuple[Drive, Axis]:
    axis = problem.axis
    coasts = _coast_downs(problem, record, quality)
    problem = _without(problem, coasts)
    base = fit_drive(problem, _start(problem, record), _base_names(problem.plant))
    hidden = why_hidden(problem, record)
    verdict = GapVerdict(None, None, (hidden,)) if hidden else judge_gap(problem, base)
    free = [one for one in coasts if not one.coupled]
    plant = base.plant if verdict.fit is None else verdict.fit.plant
    if free:
        plant = replace(plant, beta=pooled(free)[0])
    if verdict.fit is None:
        plant = replace(plant, gap=_kept_gap(axis, verdict))
    full = _all_names(problem.plant, verdict, bool(free))
    shown, fit = _settle(whole(problem), plant, full)
    settled = Settled(
        problem=whole(problem), record=record, fit=fit, shown=shown, between=between_samples(fit, shown),
        verdict=verdict, coasts=tuple(coasts), sensitivity=sensitivity_of(fit), from_file=from_file,
        rms=position_rms(problem, fit.left, problem.counted), notes=draft.assumed.get(axis.name, ()),
    )  # fmt: skip
    drive = told_drive(settled)
    return drive, identified_axis(settled, drive)


def _coast_downs(problem: Problem, record: AxisLog, quality: Quality) -> list[CoastDown]:
    noise = {one.channel: one.noise for one in quality.channels if one.axis == problem.axis.name}
    position = noise.get("motor", noise.get("act", 0.0))
    memory = servo_memory(problem.axis.servo)
    return find_coast_downs(record, problem.period, position, noise.get("force", 0.0), memory)


def _without(problem: Problem, coasts: list[CoastDown]) -> Problem:
    """Leave out the stretches in which the loop is not closed, and what it needs to settle after them."""
    driven = np.ones(problem.t.size, dtype=np.bool_)
    settle = math.ceil(settling_time(problem.axis) / problem.period)
    for one in coasts:
        driven[max(one.start - settle, 0) : one.stop + settle] = False
    if not np.any(driven & problem.counted):
        raise InputError(
            problem.axis.name, "the record holds a coast-down and nothing else",
            expected="a motion under control beside it",
        )  # fmt: skip
    return replace(problem, fit=problem.fit & driven, held=problem.held & driven)


def _start(problem: Problem, record: AxisLog) -> Plant:
    """Return the plant without a gap, with b and c of the file or of the plain lag, whichever fit better."""
    plant = replace(problem.plant, gap=0.0)
    lag = start_lag(record, plant.feedback, problem.period)
    if plant.b == 0.0 or lag is None or lag.c is None:
        return plant
    other = replace(plant, b=lag.b or plant.b, c=lag.c)
    return min((plant, other), key=lambda one: _rms(problem, one))


def _rms(problem: Problem, plant: Plant) -> float:
    return position_rms(problem, tangent(problem, plant, ()).left, problem.fit)


def _base_names(plant: Plant) -> tuple[str, ...]:
    return ("b", "c") if plant.b > 0.0 else ()


def _kept_gap(axis: Axis, verdict: GapVerdict) -> float:
    """Return the file's gap unless the record contradicts it."""
    said = axis.gap.lost_motion
    return 0.0 if verdict.bound is not None and said > verdict.bound else said


def _all_names(plant: Plant, verdict: GapVerdict, beta_known: bool) -> tuple[str, ...]:
    """Return the numbers that act on a record: those of a gap only where there is one."""
    names = _base_names(plant)
    if verdict.fit is None:
        return names
    if plant.feedback != "load":
        return (*names, "gap")
    return (*names, "gap", "eta") if beta_known else (*names, "gap", "eta", "beta")


def _settle(problem: Problem, plant: Plant, names: tuple[str, ...]) -> tuple[tuple[str, ...], DriveFit]:
    """Fit what shows and hold the rest, until what shows remains the same.

    Returns
    -------
    tuple
        Names of what shows, and the sensitivities by all of the names.
    """
    shown = tuple(name for name in names if name in ("b", "c", "gap"))
    for _ in range(ROUNDS):
        plant = _bounded(fit_drive(problem, plant, shown).plant)
        fit = tangent(problem, plant, names)
        now = shown_names(fit, GIVE_UP)
        if now == shown:
            break
        shown = now
    return shown, fit


def _bounded(plant: Plant) -> Plant:
    """Keep what the motor alone loses below what the whole axis does."""
    if plant.beta * plant.eta * plant.b <= plant.c:
        return plant
    return replace(plant, beta=plant.c / (plant.eta * plant.b))
