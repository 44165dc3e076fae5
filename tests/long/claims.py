"""Random paths on random machines: is what a plan says of itself what a machine of the tests' own does?

Of every pair the motion of a table and of a program is planned, and the plain one beside it. Both run on axes of two
masses or plays (:mod:`support.two_masses`), on every combination of initial sides and every pick-up rule that the
machine leaves open. Held against that: the error that is claimed, the time that is allowed, and the plain motion.

    python -m tests.long.claims --seed 2026 --count 300 --out tests/long/claims.json
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from itertools import product
from pathlib import Path as File
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace
from numpy.typing import NDArray

sys.path.insert(0, str(File(__file__).parents[1]))

from support.motions import look
from support.played import play_program
from support.random_jobs import random_job
from support.two_masses import Nominal, body_of, settling, table_of

from ph_post.analysis.path_analysis import Analysis
from ph_post.compensate.offsets import command_of, plan_time
from ph_post.compensate.plan import make_plan
from ph_post.dialects.registry import find_dialect
from ph_post.errors import PhPostError
from ph_post.post.program import make_program
from ph_post.simulate import assess, contour
from ph_post.types import Command, Machine, Plan

Floats = NDArray[np.float64]

EFFORT = 0.05
"""Part of the usual search: what must hold may not rest on a long one."""

POINTS = 100_001
"""Points of the path between which it counts as straight."""

CLOSE, ABSOLUTE = 0.1, 1e-6
"""Part, and length [m], by which a claim may be off."""

WORSE = 1.01
"""Ratio of the plain error up to which the error of a plan is no worse."""

RESOLVED = 2e-8
"""Errors [m] that the small steps of the simulation do not tell apart."""

BASELINES = ("linear", "step", "none")
"""Strategies that are planned without inverse dynamics."""

OTHERS = ("dwell", "suppress", "retrograde", "linear", "takeup", "step")
"""Strategies of which each pair has one timed."""

OVER = 0.005
"""Part of the plain time by which the allowed time may be exceeded, beside the rows' own period."""


class Sizes(NamedTuple):
    """Largest error, root mean square and 95th percentile [m], each the worst of all sides and rules."""

    max: float
    rms: float
    most: float


class Judged(NamedTuple):
    """One motion of one pair: what it claims, what it does, what the plain one does, and what it takes."""

    number: int
    kind: str
    machine: str
    output: str
    strategy: str
    allowed: float
    claimed: float
    written: float
    found: Sizes
    plain: Sizes
    time: float
    plain_time: float
    period: float
    changed: bool

    @property
    def true(self) -> bool:
        """Whether the claim is the error that is found, in the rows and in the words of a program."""
        return all(
            abs(self.claimed - found) <= max(CLOSE * found, ABSOLUTE) for found in (self.found.max, self.written)
        )

    @property
    def in_time(self) -> bool:
        """Whether the time allowed is kept."""
        return Timed(self.time, self.plain_time, self.allowed, self.period).in_time

    @property
    def no_worse(self) -> bool:
        """Whether no error is larger than that of the plain motion."""
        return all(one <= WORSE * other + RESOLVED for one, other in zip(self.found, self.plain, strict=True))


def run_table(command: Command, machine: Machine, track: Any, *, gap: float = 1.0, friction: float = 1.0) -> Sizes:
    """Sizes of the error of a command on the tests' own machine, of whose gap and friction there may be other parts."""
    path = command.position if command.offset is None else command.position - command.offset
    tangent = track.arc_derivatives(*track.locate(command.s[:1]), 1)[1, 0] if command.feed[0] else 0.0
    speed = np.asarray(tangent * command.feed[0] * np.ones(len(command.axes)))
    speed[np.abs(speed) < 1e-9] = 0.0
    moving = (command.s != 0.0) | (command.feed != 0.0)
    first = command.t[max(int(np.argmax(moving)) - 1, 0)] - command.t[0]
    axes = [machine.axes[name] for name in command.axes]
    counted = np.arange(len(command.t)) >= np.ceil((first + settling(map(body_of, axes))) / command.period - 1e-6)
    known = {name: side for name, side in command.flanks.items() if side}
    parts = (gap, friction)
    return _sizes(axes, command.position, path[0], speed, known, command.period, counted, track, parts)


def run_text(text: str, machine: Machine, track: Any) -> tuple[Sizes, float]:
    """Sizes of the error of a program's own words, and how long its cut takes [s]."""
    names = track.path.axes
    axes = [machine.axes[name] for name in names]
    period = machine.servo_period
    start = track.derivatives(*track.locate(np.zeros(1)))[0][0]
    played = play_program(text, "".join(names), period, start)
    cut = np.flatnonzero(played.cut)
    counted = played.cut & (np.arange(played.cut.size) >= cut[0] + settling(map(body_of, axes)) / period)
    still = np.zeros(len(names))
    return _sizes(axes, played.position, start, still, {}, period, counted, track), cut.size * period


def _sizes(
    axes: Sequence[Any],
    position: Floats,
    start: Floats,
    speed: Floats,
    known: Mapping[str, int],
    period: float,
    counted: NDArray[np.bool_],
    track: Any,
    parts: tuple[float, float] = (1.0, 1.0),
) -> Sizes:
    """Worst sizes over every combination of open sides, and every open rule."""
    nominal = Nominal(track.derivatives(*track.locate(np.linspace(0.0, track.length, POINTS)))[0])
    open_rule = any(axis.feedback == "load" and axis.gap.pickup is None for axis in axes)
    worst = Sizes(0.0, 0.0, 0.0)
    for rule in ("standstill", "momentum", "contact") if open_rule else ("standstill",):
        columns = []
        for axis, own, place, pace in zip(axes, position.T, start.tolist(), speed.tolist(), strict=True):
            side = known.get(axis.name) or {"+": 1, "-": -1}.get(axis.gap.initial_flank)
            sides = (side,) if side or pace else (1, -1)
            begin = place if axis.feedback == "load" else float(own[0])
            columns.append([table_of(body_of(axis, rule, *parts), own, period, one or 1, begin, pace) for one in sides])
        for chosen in product(*columns):
            error = nominal.distance(np.stack(chosen, axis=1)[counted])
            if error.size:
                sizes = (error.max(), np.sqrt(np.mean(error**2)), np.quantile(error, 0.95))
                worst = Sizes(*(max(float(a), b) for a, b in zip(sizes, worst, strict=True)))
    return worst


def planned(number: int, output: str, strategy: str) -> tuple[Analysis, Plan, Plan, Any] | None:
    """Plans of one pair, by a strategy and plain, and the options; None where the strategy refuses the job."""
    job = random_job(number)
    lead = job.options.inverse_dynamics and output == "table" and strategy not in BASELINES
    start = job.options.start if output == "table" else "rest"
    options = replace(job.options, strategy=strategy, carrier=output, effort=EFFORT, start=start, inverse_dynamics=lead)
    analysis = look(job.path, job.machine)
    try:
        plan = make_plan(analysis, options)
    except PhPostError:
        return None
    return analysis, plan, make_plan(analysis, replace(options, strategy="none", inverse_dynamics=False)), options


class Timed(NamedTuple):
    """Times of a plan and of the plain one [s], the part by which it may be longer, and the rows' period [s]."""

    time: float
    plain_time: float
    allowed: float
    period: float

    @property
    def in_time(self) -> bool:
        """Whether the time allowed is kept."""
        return self.time <= self.plain_time * (1.0 + self.allowed + OVER) + 2.0 * self.period


def timed(number: int, output: str, strategy: str) -> Timed | None:
    """Time of one pair by a strategy; None where that refuses the job."""
    found = planned(number, output, strategy)
    if found is None:
        return None
    _, plan, plain, options = found
    return Timed(plan_time(plan), plan_time(plain), options.max_slowdown, plan.machine.servo_period)


def judge(number: int, output: str, strategy: str = "auto") -> Judged | None:
    """Plan one pair and judge it; None where the strategy refuses the job."""
    found = planned(number, output, strategy)
    return None if found is None else _judged(number, random_job(number).kind, *found)


def _judged(number: int, kind: str, analysis: Analysis, plan: Plan, plain: Plan, options: Any) -> Judged:
    machine, track = plan.machine, analysis.track
    commands = [command_of(one, track, machine.servo_period) for one in (plan, plain)]
    error = assess.assess(commands[0], machine, contour.Nominal(track)).error
    found, before = (run_table(one, machine, track) for one in commands)
    written, time_taken, plain_time = found.max, plan_time(plan), plan_time(plain)
    if options.writes_program:
        texts = [make_program(one, track, find_dialect("linuxcnc")).text for one in (plan, plain)]
        (sizes, time_taken), (_, plain_time) = (run_text(text, machine, track) for text in texts)
        written = sizes.max
    return Judged(
        number=number,
        kind=kind,
        machine=" ".join(machine.axes[name].feedback for name in plan.path.axes),
        output=options.carrier,
        strategy=options.strategy,
        allowed=options.max_slowdown,
        claimed=0.0 if error is None else error.max,
        written=written,
        found=found,
        plain=before,
        time=time_taken,
        plain_time=plain_time,
        period=machine.servo_period,
        changed=len(commands[0].t) != len(commands[1].t) or bool((commands[0].position != commands[1].position).any()),
    )


def summary(judged: Sequence[Judged]) -> dict[str, Any]:
    """Counts of what was judged and of what held, and the numbers of those in which it did not."""
    loops = Counter("+".join(sorted(set(one.machine.split()))) for one in judged)
    return {
        "judged": len(judged),
        "outputs": dict(Counter(one.output for one in judged)),
        "machines": dict(sorted(loops.items())),
        "paths": dict(sorted(Counter(one.kind for one in judged).items())),
        "changed": sum(one.changed for one in judged),
        "largest error at least halved": sum(one.found.max <= 0.5 * one.plain.max for one in judged),
        "claims off": [(one.number, one.output) for one in judged if not one.true],
        "over time": [(one.number, one.output, one.strategy) for one in judged if not one.in_time],
        "worse than plain": [(one.number, one.output) for one in judged if not one.no_worse],
    }


def main() -> None:
    """Judge many pairs, and write the summary."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seed", type=int, default=2026, help="number of the first pair")
    asked.add_argument("--count", type=int, default=300)
    asked.add_argument("--minutes", type=float, default=1e9, help="stop after so many")
    asked.add_argument("--out", type=File)
    given = asked.parse_args()
    judged: list[Judged] = []
    late: list[tuple[int, str, str]] = []
    end = time.monotonic() + 60.0 * given.minutes
    for number in range(given.seed, given.seed + given.count):
        if time.monotonic() > end:
            break
        for output in ("table", "program"):
            other = OTHERS[number % len(OTHERS)]
            quick = timed(number, output, other)
            if quick is not None and not quick.in_time:
                late.append((number, output, other))
            found = judge(number, output)
            if found is not None:
                judged.append(found)
                good = found.true and found.in_time and found.no_worse
                sys.stdout.write(f"{'ok ' if good else 'BAD'} {described(found)}\n")
    counts = {
        "seed": given.seed,
        "pairs": len({one.number for one in judged}),
        **summary(judged),
        "other strategies over time": late,
    }
    text = json.dumps(counts, indent=1) + "\n"
    sys.stdout.write(text)
    if given.out:
        given.out.write_text(text, encoding="utf-8")


def described(one: Judged) -> str:
    """Say in a line what was found."""
    um = [f"{1e6 * size:.2f}" for size in (one.claimed, *one.found, *one.plain, one.written)]
    return (
        f"{one.number} {one.output} {one.kind} [{one.machine}] claimed {um[0]}, found {'/'.join(um[1:4])}, "
        f"plain {'/'.join(um[4:7])}, written {um[7]} µm; {one.plain_time:.3f} -> {one.time:.3f} s, "
        f"{one.allowed:g} allowed"
        f"{'' if one.true else ', CLAIM'}{'' if one.in_time else ', TIME'}{'' if one.no_worse else ', WORSE'}"
    )


if __name__ == "__main__":
    main()
