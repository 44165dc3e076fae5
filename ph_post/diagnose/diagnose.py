"""From a record and a machine file to what is missing from that machine.

Axis by axis: the free run of the file's model, hypotheses added one after the other as long as they explain
what they were not fitted to, and a verdict over all of them.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.findings import Outcome, better_axis, findings_of, settle_outcome
from ph_post.diagnose.fit import base_model, left_of
from ph_post.diagnose.model import Problem, problem_of
from ph_post.diagnose.quality import examine
from ph_post.diagnose.record import Channel, Diagnosis, Finding, GapStep, Quality, Trail, Verdict
from ph_post.diagnose.score import has_structure
from ph_post.diagnose.select import choose
from ph_post.diagnose.telling import locate_left, next_of, notes_of, tell
from ph_post.types import Array, BoolArray, Log, Machine

FRICTION: Final = frozenset(("coulomb_friction", "stribeck_friction"))
"""What no record of a position of unknown side can tell apart from backlash."""

LEFT: Final = 2.0
"""Times the noise above which what is left at the end is looked at."""

EXPLAINED: Final = 0.92
"""Part of the excess that the names must explain together where more than that is left."""


def quiet(_words: str) -> None:
    """Say nothing."""


def diagnose(log: Log, machine: Machine, stage: Callable[[str], None] = quiet) -> Diagnosis:
    """Find what is missing from a machine file, as a record shows it.

    Parameters
    ----------
    log : Log
    machine : Machine
        With a drive for every axis of the log.
    stage : callable, optional
        Told what is being done.

    Returns
    -------
    Diagnosis
    """
    stage("looking at the record")
    quality = examine(log, machine)
    problems = [
        problem
        for name in log.axes
        if (problem := problem_of(log, name, machine.axes[name], quality)) is not None
    ]
    if quality.faults or not problems:
        return _blind(log, machine, quality)
    with ThreadPoolExecutor(max_workers=os.cpu_count()) as pool:
        outcomes = list(pool.map(lambda one: settle_outcome(choose(one, stage)), problems))
    stage("telling")
    return _tell(log, machine, quality, outcomes)


def _blind(log: Log, machine: Machine, quality: Quality) -> Diagnosis:
    """Tell that a record can show nothing."""
    if not quality.faults:
        quality = replace(quality, faults=("no axis that has a reading moves in this record",))
    floor = _pooled([one.noise for one in quality.channels if one.channel != "force"])
    return Diagnosis(
        verdict="not-identifiable", findings=(), noise_floor=floor, steps=(), quality=quality, places=(),
        remaining=(), trails=(), machine=machine,
        next_experiment=next_of(log, machine, "not-identifiable", ()),
    )  # fmt: skip


def _pooled(noise: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(noise)))) if noise else 0.0


def _floor(outcomes: Sequence[Outcome]) -> float:
    """Noise of all position channels together."""
    seen = [one for outcome in outcomes for one in outcome.choice.problem.observed]
    return _pooled([one.noise for one in seen if one.channel != "force"])


def _tell(log: Log, machine: Machine, quality: Quality, outcomes: Sequence[Outcome]) -> Diagnosis:
    findings: list[Finding] = []
    for outcome, told in zip(outcomes, tell(log, machine, quality, outcomes), strict=True):
        findings += findings_of(outcome, told.where, told.evidence)
    findings = [_unknown_side(log, one) for one in findings]
    before = [_as_it_is(outcome) for outcome in outcomes]
    steps = _steps(outcomes, before)
    floor = _floor(outcomes)
    verdict = _verdict(outcomes, findings, floor, steps)
    if verdict == "unknown":
        findings, steps = [], steps[:1]
    axes = dict(machine.axes)
    for name in log.axes:
        axes[name] = better_axis(axes[name], tuple(one for one in findings if one.axis == name))
    better = replace(machine, axes=axes) if findings else machine
    places = locate_left(log, machine, outcomes, before)
    remaining = locate_left(log, machine, outcomes, [one.fitted.left for one in outcomes]) if findings else ()
    return Diagnosis(
        verdict=verdict, findings=tuple(findings), noise_floor=floor, steps=steps,
        quality=quality, places=places, remaining=remaining, trails=_trails(outcomes, before, verdict),
        machine=better, next_experiment=next_of(log, machine, verdict, findings, places),
        notes=notes_of(log, outcomes, remaining, verdict),
    )  # fmt: skip


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


def _position_squares(outcome: Outcome, left: Mapping[Channel, Array], use: BoolArray) -> tuple[float, int]:
    """Sum of squares and count of the position channels of an axis."""
    total, count = 0.0, 0
    for one in outcome.choice.problem.observed:
        if one.channel != "force":
            here = use & one.ok
            total += float(np.sum(left[one.channel][here] ** 2))
            count += int(np.count_nonzero(here))
    return total, count


def _steps(outcomes: Sequence[Outcome], before: Sequence[Mapping[Channel, Array]]) -> tuple[GapStep, ...]:
    """Pool the gap over the axes: the file as it is, then one effect after the other."""
    steps = [_step(None, outcomes, before)]
    # With the first effect every axis is told with its base values refitted within their priors.
    at = [outcome.choice.stages[0].left for outcome in outcomes]
    for number, outcome in enumerate(outcomes):
        for count, part in enumerate(outcome.choice.fitted.model.parts, 1):
            at[number] = outcome.choice.stages[count].left
            label = f"{part.hypothesis.name}:{outcome.choice.problem.axis.name}"
            steps.append(_step(label, outcomes, at))
    return tuple(steps)


def _as_it_is(outcome: Outcome) -> dict[Channel, Array]:
    """Residuals of the file as it is; its origin is held where the final model's is."""
    problem, final = outcome.choice.problem, outcome.fitted.model
    return left_of(problem, replace(base_model(problem), origin_free=final.origin_free))


def _step(added: str | None, outcomes: Sequence[Outcome], at: Sequence[Mapping[Channel, Array]]) -> GapStep:
    rms = []
    for kind in ("fit", "held"):
        sums = [
            _position_squares(outcome, left, getattr(outcome.choice.problem, kind))
            for outcome, left in zip(outcomes, at, strict=True)
        ]
        rms.append(float(np.sqrt(sum(one for one, _ in sums) / max(sum(n for _, n in sums), 1))))
    return GapStep(added=added, fit_rms=rms[0], holdout_rms=rms[1])


def _verdict(
    outcomes: Sequence[Outcome], findings: Sequence[Finding], noise: float, steps: Sequence[GapStep]
) -> Verdict:
    excess = steps[0].holdout_rms ** 2 - noise**2
    left = steps[-1].holdout_rms ** 2 - noise**2
    much = steps[-1].holdout_rms > LEFT * noise
    if findings:
        if much and left > (1.0 - EXPLAINED) * excess:
            return "unknown"
        return "ambiguous" if any(one.ambiguous_with for one in findings) else "named"
    structured = any(has_structure(one.choice.problem, one.fitted) for one in outcomes)
    return "unknown" if structured else "nothing-missing"


def _trails(
    outcomes: Sequence[Outcome], at_first: Sequence[Mapping[Channel, Array]], verdict: Verdict
) -> tuple[Trail, ...]:
    trails = []
    for outcome, before in zip(outcomes, at_first, strict=True):
        problem: Problem = outcome.choice.problem
        after = before if verdict == "unknown" else outcome.fitted.left
        trails += [
            Trail(
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
