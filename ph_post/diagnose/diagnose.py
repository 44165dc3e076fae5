"""Find the effects that a machine file lacks, from a log.

For each axis: the free run of the file's model, effects added one after the other as long as they explain
held-out samples, and one verdict over all axes.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np
from msgspec.structs import replace
from threadpoolctl import threadpool_limits

from ph_post.bounds import threads
from ph_post.diagnose.explanations import diagnosis_notes, explain, locate_residuals, propose_experiment
from ph_post.diagnose.findings import AxisDiagnosis, findings_of, fit_chosen_model, improved_axis
from ph_post.diagnose.fit import base_model, residuals_of
from ph_post.diagnose.search import has_structure
from ph_post.diagnose.selection import choose
from ph_post.identify.excerpt import excerpt
from ph_post.identify.free_run import AxisProblem, pooled_noise, problem_of
from ph_post.identify.injected_force import with_injected_forces
from ph_post.identify.log_quality import examine
from ph_post.progress import Progress, no_progress, prefixed
from ph_post.types import Array, BoolArray, Log, Machine
from ph_post.types.diagnosis import (
    Channel,
    Diagnosis,
    Finding,
    LogQuality,
    ResidualStep,
    ResidualTrace,
    Verdict,
)

FRICTION: Final = frozenset(("coulomb_friction", "stribeck_friction"))
"""Effects that a position of unknown side cannot separate from backlash."""

EXPLAINED: Final = 0.5
"""Part of the residual that may be left where forces that the loops did not ask for are taken as known."""

RUNS: Final = 1000
"""Free runs that a search of one axis takes the time of, about."""

SHORT: Final = 5.0
"""Time up to which nobody needs to know how long a search takes [s]."""


def diagnose(log: Log, machine: Machine, progress: Progress = no_progress) -> Diagnosis:
    """Find what is missing from a machine file, as a log shows it.

    Parameters
    ----------
    log : Log
    machine : Machine
        With a drive for every axis of the log.
    progress : Progress, optional
        Called with what is being done.

    Returns
    -------
    Diagnosis
    """
    progress("checking the log")
    log = excerpt(log, machine)
    quality = examine(log, machine)
    found = _diagnose(log, machine, quality, progress)
    if found.verdict != "unknown":
        return found
    moved, said = with_injected_forces(log, machine, quality)
    if not said:
        return found
    progress("taking a force as known that the loops did not ask for")
    quality = examine(moved, machine)
    quality = replace(quality, notes=(*said, *quality.notes))
    again = _diagnose(moved, machine, quality, progress)
    return again if again.steps and again.steps[0].holdout_rms < EXPLAINED * found.steps[0].holdout_rms else found


def _diagnose(log: Log, machine: Machine, quality: LogQuality, progress: Progress) -> Diagnosis:
    """Find what is missing from a machine file, as a log of known quality shows it."""
    problems = [
        problem for name in log.axes if (problem := problem_of(log, name, machine.axes[name], quality)) is not None
    ]
    if quality.faults or not problems:
        return _not_identifiable(log, machine, quality)
    # Matrices of few columns: where the axes go side by side, threads within them wait for each other.
    with threadpool_limits(limits=1, user_api="blas"), ThreadPoolExecutor(max_workers=threads()) as pool:
        seconds = _expected(problems)
        search = progress if seconds < SHORT else prefixed(progress, f"about {float(f'{seconds:.1g}'):.0f} s in all")
        outcomes = list(pool.map(lambda one: fit_chosen_model(choose(one, search), _early(one, quality)), problems))
    progress("explaining")
    return _assemble(log, machine, quality, outcomes)


def _early(problem: AxisProblem, quality: LogQuality) -> float:
    """Return by how much all positions of an axis are earlier than its drive in the file [s]."""
    shifts = [one.shift for one in quality.channels if one.axis == problem.axis.name and one.shift is not None]
    return -max(shifts, default=0.0)


def _expected(problems: Sequence[AxisProblem]) -> float:
    """Return about how long a search takes [s]: so many free runs, of which one is timed."""
    residuals_of(problems[0], base_model(problems[0]))  # the first is compiled
    begin = time.perf_counter()
    residuals_of(problems[0], base_model(problems[0]))
    one = time.perf_counter() - begin
    return one * RUNS * max(len(problems) / threads(), 1.0)


def _not_identifiable(log: Log, machine: Machine, quality: LogQuality) -> Diagnosis:
    """Return the diagnosis of a log that can show nothing."""
    if not quality.faults:
        quality = replace(quality, faults=("no axis with a reading moves in this log",))
    floor = pooled_noise(one.noise for one in quality.channels if one.channel != "force")
    return Diagnosis(
        verdict="not-identifiable",
        findings=(),
        noise_floor=floor,
        steps=(),
        quality=quality,
        places=(),
        remaining=(),
        trails=(),
        machine=machine,
        next_experiment=propose_experiment(log, machine, "not-identifiable", ()),
    )


def _assemble(log: Log, machine: Machine, quality: LogQuality, outcomes: Sequence[AxisDiagnosis]) -> Diagnosis:
    findings: list[Finding] = []
    for outcome, explanation in zip(outcomes, explain(log, machine, quality, outcomes), strict=True):
        findings += findings_of(outcome, explanation.where, explanation.evidence)
    findings = [_unknown_side(log, one) for one in findings]
    before = [_file_residuals(outcome) for outcome in outcomes]
    steps = _steps(outcomes, before)
    floor = pooled_noise(one.noise for outcome in outcomes for one in outcome.problem.positions)
    verdict = _verdict(outcomes, findings)
    if verdict == "unknown":
        steps = steps[:1]
    axes = dict(machine.axes)
    for name in log.axes:
        axes[name] = improved_axis(axes[name], tuple(one for one in findings if one.axis == name))
    better = replace(machine, axes=axes) if findings else machine
    places = locate_residuals(log, machine, outcomes, before)
    remaining = locate_residuals(log, machine, outcomes, [one.fitted.left for one in outcomes]) if findings else ()
    return Diagnosis(
        verdict=verdict,
        findings=tuple(findings),
        noise_floor=floor,
        steps=steps,
        quality=quality,
        places=places,
        remaining=remaining,
        trails=_trails(outcomes, before, verdict),
        machine=better,
        next_experiment=propose_experiment(log, machine, verdict, findings, places),
        notes=diagnosis_notes(log, outcomes, remaining, verdict),
        dropped=tuple(name for one in outcomes for name in one.dropped),
    )


def _unknown_side(log: Log, finding: Finding) -> Finding:
    """Say of friction and backlash in a position of unknown side that either may be the other."""
    if log.axes[finding.axis].side != "unknown":
        return finding
    rival = ""
    if finding.name in FRICTION:
        rival = "backlash"
    elif finding.name == "backlash":
        rival = "coulomb_friction"
    if not rival or rival in finding.ambiguous_with:
        return finding
    return replace(finding, ambiguous_with=(*finding.ambiguous_with, rival), confidence=0.5)


def _position_squares(outcome: AxisDiagnosis, left: Mapping[Channel, Array], use: BoolArray) -> tuple[float, int]:
    """Sum of squares and count of the position channels of an axis."""
    total, count = 0.0, 0
    for one in outcome.problem.positions:
        here = use & one.ok
        total += float(np.sum(left[one.channel][here] ** 2))
        count += int(np.count_nonzero(here))
    return total, count


def _steps(outcomes: Sequence[AxisDiagnosis], before: Sequence[Mapping[Channel, Array]]) -> tuple[ResidualStep, ...]:
    """Pool the residuals of the axes: the file as it is, then one effect after the other."""
    steps = [_step(None, outcomes, before)]
    # With the first effect every axis counts with its base values refitted within their priors.
    at = [outcome.choice.stages[0].left for outcome in outcomes]
    for number, outcome in enumerate(outcomes):
        for count, part in enumerate(outcome.choice.fitted.model.parts, 1):
            at[number] = outcome.choice.stages[count].left
            label = f"{part.hypothesis.name}:{outcome.problem.axis.name}"
            steps.append(_step(label, outcomes, at))
        if outcome.sides is not None:
            at[number] = outcome.fitted.left
            label = f"backlash:{outcome.problem.axis.name}"
            if all(step.added != label for step in steps):
                steps.append(_step(label, outcomes, at))
    return tuple(steps)


def _file_residuals(outcome: AxisDiagnosis) -> dict[Channel, Array]:
    """Residuals of the file as it is; its origin is held where the final model's is."""
    problem, final = outcome.problem, outcome.fitted.model
    return residuals_of(problem, replace(base_model(problem), origin_free=final.origin_free))


def _step(added: str | None, outcomes: Sequence[AxisDiagnosis], at: Sequence[Mapping[Channel, Array]]) -> ResidualStep:
    rms = []
    for kind in ("fit", "held"):
        sums = [
            _position_squares(outcome, left, getattr(outcome.problem, kind))
            for outcome, left in zip(outcomes, at, strict=True)
        ]
        rms.append(float(np.sqrt(sum(one for one, _ in sums) / max(sum(n for _, n in sums), 1))))
    return ResidualStep(added=added, fit_rms=rms[0], holdout_rms=rms[1])


def _verdict(outcomes: Sequence[AxisDiagnosis], findings: Sequence[Finding]) -> Verdict:
    if findings:
        return "ambiguous" if any(one.ambiguous_with for one in findings) else "named"
    structured = any(has_structure(one.problem, one.fitted) for one in outcomes)
    return "unknown" if structured else "nothing-missing"


def _trails(
    outcomes: Sequence[AxisDiagnosis], at_first: Sequence[Mapping[Channel, Array]], verdict: Verdict
) -> tuple[ResidualTrace, ...]:
    trails = []
    for outcome, before in zip(outcomes, at_first, strict=True):
        problem = outcome.problem
        after = before if verdict == "unknown" else outcome.fitted.left
        trails += [
            ResidualTrace(
                axis=problem.axis.name,
                channel=one.channel,
                t=problem.t,
                command=problem.command,
                before=before[one.channel],
                after=after[one.channel],
                counted=problem.counted & one.ok,
                held_out=problem.held & one.ok,
            )
            for one in problem.observed
        ]
    return tuple(trails)
