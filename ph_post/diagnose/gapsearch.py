"""Whether a record shows a gap: by samples that it was not fitted to, and against friction in its place."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.drivefit import DriveFit, fit_drive, held_out_gain, left_by, rows_of
from ph_post.diagnose.fit import weights_of
from ph_post.diagnose.model import Problem
from ph_post.drive.plant import Plant
from ph_post.types import AxisLog
from ph_post.units import MICROMETRE

EARNS: Final = 5.0
"""Nats on held-out samples that a gap must bring."""

TRIED: Final = (2e-6, 8e-6, 25e-6, 70e-6, 200e-6, 600e-6)
"""Gaps and frictions that are tried first [m]."""

BOUND: Final = 9.0
"""Rise of the sum of squares at which a gap would have shown, at three standard errors."""

GRID: Final = 1e-7 * 1.4 ** np.arange(28)
"""Gaps among which the smallest that would show is sought [m]."""

RESTS: Final = 1e-3
"""Speeds below this part of the largest one have no direction."""


class GapVerdict(NamedTuple):
    """What a record says of the gap.

    `fit` has the gap where it earns its place; where it does not, `bound` [m] is the smallest that would have
    shown, None where any could hide. `notes` say what cannot be told.
    """

    fit: DriveFit | None
    bound: float | None
    notes: tuple[str, ...] = ()


def why_hidden(problem: Problem, record: AxisLog) -> str:
    """Return why a record cannot show a gap, empty where it can."""
    speed = problem.speed[problem.counted]
    directions = np.sign(speed[np.abs(speed) > RESTS * np.max(np.abs(speed), initial=0.0)])
    if not np.any(np.diff(directions)):
        return "the gap does not show: no reversal"
    if problem.plant.feedback == "load":
        return ""
    if record.table is None:
        return "the gap does not show: behind the motor's loop only a reading of the table shows it"
    if record.side == "unknown":
        return "the gap does not show: the reading may be the motor's, and friction looks like play there"
    return ""


def judge_gap(problem: Problem, base: DriveFit) -> GapVerdict:
    """Fit a gap, and friction in its place, and compare them on what was held out."""
    gapped = _fitted_with(problem, base, "gap")
    gain = held_out_gain(problem, gapped, base)
    if gain < EARNS or gapped.plant.gap <= 0.0:
        return GapVerdict(None, smallest_shown(problem, base))
    if base.plant.coulomb_plus > 0.0:
        return GapVerdict(gapped, None)
    rival = _fitted_with(problem, base, "friction")
    ahead = held_out_gain(problem, rival, gapped)
    size = rival.plant.coulomb_plus / MICROMETRE
    if ahead > EARNS:
        words = (
            f"friction of {size:.3g} µm of following error explains the record better than play; the gap is "
            "not identified, and b and c are those of a drive without friction: ph-post diagnose names it"
        )
        return GapVerdict(None, None, (words,))
    if ahead > -EARNS:
        words = (
            f"friction of {size:.3g} µm of following error explains the record as well as the lost motion: "
            "they are not told apart; the motor's side or its force would do it"
        )
        return GapVerdict(gapped, None, (words,))
    return GapVerdict(gapped, None)


def _fitted_with(problem: Problem, base: DriveFit, name: str) -> DriveFit:
    """Fit the base numbers and one more, from the best of the sizes tried."""
    weights = weights_of(problem, base.left, problem.fit)

    def cost(plant: Plant) -> float:
        return float(np.sum(rows_of(problem, left_by(problem, plant), weights) ** 2))

    tried = sorted((_with(base.plant, name, size) for size in TRIED), key=cost)
    fits = [fit_drive(problem, start, (*base.names, name)) for start in tried[:2]]
    return min(fits, key=lambda one: cost(one.plant))


def _with(plant: Plant, name: str, size: float) -> Plant:
    if name == "gap":
        return replace(plant, gap=size)
    return replace(plant, coulomb_plus=size, coulomb_minus=size)


def smallest_shown(problem: Problem, base: DriveFit, sizes: Sequence[float] = tuple(GRID)) -> float | None:
    """Return the smallest gap that the record contradicts, whatever b and c are; None where it does none."""
    weights = weights_of(problem, base.left, problem.fit)
    here = rows_of(problem, base.left, weights)
    frame = np.linalg.qr(base.jacobian)[0] if base.names else np.zeros((here.size, 0))
    for size in sizes:
        there = rows_of(problem, left_by(problem, replace(base.plant, gap=float(size))), weights)
        change = there - here
        change -= frame @ (frame.T @ change)
        if float(change @ change + 2.0 * here @ change) > BOUND * base.worth:
            return float(size)
    return None
