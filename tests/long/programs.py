"""Random part programs on random machines: is what a compensated program says of itself what a machine does?

Each is compensated with several times allowed. Held against a table of the tests' own (:mod:`support.program_judge`):
the errors, which may not be above the plain program's, the claims before and after, the time, and how many of the
reversals of smooth work are compensated.

    python -m tests.long.programs --first 0 --count 300 --out tests/long/programs.json
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections import Counter
from collections.abc import Sequence
from pathlib import Path as File
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(File(__file__).parents[1]))

from support.program_judge import Measured, Played, Stretches, gaps_of, lag_of, measure, played, settled_time, tail_of
from support.random_cuts import RandomCut, random_cut

import ph_post as ph

SEED = 1515
PROGRAMS = 300
ALLOWED = (0.0, 0.01, 0.02, 0.05, 0.1)

CLOSE, ABSOLUTE = 0.1, 1e-6
"""Part, and length [m], by which a claim may be off."""

WORSE = 1.01
"""Ratio of the plain error up to which an error is no worse."""

RESOLVED = 1e-7
"""Errors [m] that rounding to the decimals of a program does not tell apart."""

OVER = 0.005
"""Part of the plain time by which the time allowed may be exceeded."""


class Judged(NamedTuple):
    """A program with one time allowed: what it claims and does; lengths in m, times in s."""

    number: int
    kind: str
    machine: str
    allowed: float
    claims: tuple[tuple[str, float, float], ...]
    found: tuple[float, float, float]
    plain: tuple[float, float, float]
    time: float
    plain_time: float
    reversals: tuple[int, int]
    smooth: bool
    left: tuple[str, ...]

    @property
    def off(self) -> list[str]:
        """Names of the claims that are off."""
        return [name for name, said, true in self.claims if abs(said - true) > max(CLOSE * true, ABSOLUTE)]

    @property
    def in_time(self) -> bool:
        """Whether the time allowed is kept."""
        return self.time <= self.plain_time * (1.0 + self.allowed + OVER)

    @property
    def no_worse(self) -> bool:
        """Whether no error is larger than that of the plain program."""
        return all(one <= WORSE * other + RESOLVED for one, other in zip(self.found, self.plain, strict=True))

    @property
    def good(self) -> bool:
        """Whether all holds."""
        return self.in_time and self.no_worse and not self.off


def judge(job: RandomCut, allowed: Sequence[float] = ALLOWED) -> list[Judged]:
    """Compensate a program with each time allowed, and judge it."""
    found: list[Judged] = []
    with tempfile.TemporaryDirectory() as folder:
        file = File(folder) / "part.ngc"
        file.write_text(job.text, encoding="utf-8")
        path = Stretches(job.text, gaps_of(job.machine), tail_of(job.machine))
        plain, before = None, None
        measured: dict[str, Measured] = {}
        for share in allowed:
            result = ph.compensate(file, job.machine, max_slowdown=share)
            if plain is None or before is None:
                plain = _played(result.before, job.text, path, job.machine)
                before = measured[job.text] = measure(plain, path, job.machine)
            text = result.program().decode()
            if text not in measured:
                # With more time allowed a program is often the same.
                measured[text] = measure(_played(result.after, text, path, job.machine, plain), path, job.machine)
            found.append(_judged(job, share, result, before, measured[text]))
    return found


def _played(motion: Any, text: str, path: Stretches, machine: Any, plain: Played | None = None) -> Played:
    block = motion.program.motions.block
    lines = np.where(motion.command.segment < 0, 0, block[np.maximum(motion.command.segment, 0)] + 1)
    return played(text, path, motion.command, lines, gaps_of(machine), settled_time(machine), lag_of(machine), plain)


def _judged(job: RandomCut, share: float, result: Any, before: Measured, after: Measured) -> Judged:
    claims = []
    for when, motion, own in (("before", result.before, before), ("after", result.after, after)):
        for what, said, true in (
            ("error", motion.error, own.all_pair),
            ("error_gap", motion.error_gap, own.gap_pair),
        ):
            if said is not None:
                claims += [(f"{what} {when} max", said.max, true[0]), (f"{what} {when} rms", said.rms, true[1])]
    axis = job.machine.axes["X"]
    rows = result.axis_reversals
    return Judged(
        number=job.number,
        kind=job.kind,
        machine=f"{job.machine.dialect}/{axis.feedback}" + (f" {1e3 * axis.servo.c:g} ms" if axis.servo.c else ""),
        allowed=share,
        claims=tuple(claims),
        found=tuple(after.all),
        plain=tuple(before.all),
        time=result.after.time,
        plain_time=result.before.time,
        reversals=(sum(row.compensated for row in rows), sum(row.all for row in rows)),
        smooth=job.smooth,
        left=tuple(result.planned.warnings),
    )


def described(one: Judged) -> str:
    """Say in a line what was found."""
    sizes = ["/".join(f"{1e6 * size:.2f}" for size in sizes) for sizes in (one.found, one.plain)]
    off = [f"{name} {1e6 * said:.2f} for {1e6 * true:.2f}" for name, said, true in one.claims if name in one.off]
    return (
        f"{one.number} {one.kind} [{one.machine}] {one.allowed:g} allowed: {sizes[0]}, plain {sizes[1]} µm; "
        f"{one.plain_time:.3f} -> {one.time:.3f} s; {one.reversals[0]} of {one.reversals[1]}"
        f"{'' if one.in_time else ', TIME'}{'' if one.no_worse else ', WORSE'}"
        f"{', CLAIM ' if off else ''}{'; '.join(off)}"
    )


def summary(judged: Sequence[Judged]) -> dict[str, Any]:
    """Counts of what was judged and of what held, and the numbers of those in which it did not."""
    loose = [one for one in judged if one.smooth and one.allowed == max(ALLOWED)]
    done, every = (sum(one.reversals[k] for one in loose) for k in (0, 1))
    gained = [one for one in judged if one.allowed == max(ALLOWED)]
    return {
        "programs": len({one.number for one in judged}),
        "judged": len(judged),
        "work": dict(sorted(Counter(one.kind for one in gained).items())),
        "machines": dict(sorted(Counter(one.machine for one in gained).items())),
        "rms at least halved with the most time": sum(one.found[1] <= 0.5 * one.plain[1] for one in gained),
        "reversals of smooth work compensated with the most time": [done, every],
        "over time": [(one.number, one.allowed) for one in judged if not one.in_time],
        "worse than plain": [(one.number, one.allowed) for one in judged if not one.no_worse],
        "claims off": [(one.number, one.allowed, one.off) for one in judged if one.off],
    }


def main() -> None:
    """Judge many programs, and write the summary."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--first", type=int, default=0)
    asked.add_argument("--count", type=int, default=PROGRAMS)
    asked.add_argument("--step", type=int, default=1)
    asked.add_argument("--allowed", type=float, nargs="+", default=ALLOWED)
    asked.add_argument("--rows", type=File, help="file to which every judgement is added, a line of JSON each")
    asked.add_argument("--out", type=File)
    given = asked.parse_args()
    judged: list[Judged] = []
    for number in range(given.first, given.first + given.count, given.step):
        for one in judge(random_cut(number), given.allowed):
            judged.append(one)
            sys.stdout.write(f"{'ok ' if one.good else 'BAD'} {described(one)}\n")
            sys.stdout.flush()
            if given.rows:
                with given.rows.open("a", encoding="utf-8") as file:
                    file.write(json.dumps(one._asdict()) + "\n")
    asked_for = {"first": given.first, "count": given.count, "step": given.step, "allowed": list(given.allowed)}
    text = json.dumps({"seed": SEED, **asked_for, **summary(judged)}, indent=1) + "\n"
    sys.stdout.write(text)
    if given.out:
        given.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
