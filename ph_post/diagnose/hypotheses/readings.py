"""Hypotheses about the readings: scale, screw, temperature, squareness and delay."""

from __future__ import annotations

import math
from typing import Final

from msgspec.structs import replace

from ph_post.diagnose.hypotheses.base import (
    MICRON,
    Hypothesis,
    HypothesisNumber,
    LogReason,
    Numbers,
    Residuals,
    effect_hypothesis,
    longest_period,
    periods,
)
from ph_post.diagnose.hypotheses.forces import wave_hypothesis
from ph_post.identify.free_run import AxisProblem
from ph_post.types import MACHINE_AXES

MOST_ERROR: Final = 5e-3
"""Largest error of a reading tried [m]."""

SLOWEST: Final = 20.0
"""Longest time constant of a drift, in lengths of the log; beyond that it is a straight line."""

SHORTEST_DRIFT: Final = 2.0
"""Shortest time constant of a drift [s]: heat moves no machine faster."""

LONGEST_DELAY: Final = 0.1
"""[s]"""


def _needs_table(problem: AxisProblem) -> str:
    return "" if problem.has("act") else LogReason("needs a reading of the table")


SCALE = effect_hypothesis(
    "scale_error",
    lambda error: {"error": error},
    numbers=(HypothesisNumber(name="error", low=-0.1, high=0.1, scale=1e-5, linear=True),),
    starts=lambda _problem, _left: [(1e-4,)],
    bars=_needs_table,
)


def _drifts(problem: AxisProblem, _left: Residuals) -> list[Numbers]:
    length = float(problem.t[-1] - problem.t[0])
    tried = (max(share * length, SHORTEST_DRIFT) for share in (0.15, 0.5, 2.0))
    return [(10.0 * MICRON, math.log(constant)) for constant in tried]


THERMAL = effect_hypothesis(
    "thermal_growth",
    lambda growth, time: {"growth": growth, "time_constant": math.exp(time)},
    numbers=(
        HypothesisNumber(name="growth", low=-MOST_ERROR, high=MOST_ERROR, scale=MICRON, linear=True),
        HypothesisNumber(name="time", low=math.log(SHORTEST_DRIFT), high=math.log(1e5), scale=0.1, logarithm=True),
    ),
    starts=_drifts,
    bars=_needs_table,
)


def _squareness(other: str) -> Hypothesis:
    choice = float(MACHINE_AXES.index(other))

    def bars(problem: AxisProblem) -> str:
        return _needs_table(problem) if other in problem.others else f"{other} is not in the log"

    return effect_hypothesis(
        "squareness",
        lambda angle: {"angle": angle, "other": choice},
        variant=other,
        numbers=(HypothesisNumber(name="angle", low=-0.1, high=0.1, scale=1e-5, linear=True),),
        starts=lambda _problem, _left: [(1e-4,)],
        bars=bars,
    )


def _delay(where: float) -> Hypothesis:
    return effect_hypothesis(
        "transport_delay",
        lambda delay: {"delay": delay, "where": where},
        variant=("command", "reading")[int(where)],
        numbers=(HypothesisNumber(name="delay", low=0.0, high=LONGEST_DELAY, scale=1e-4, linear=True),),
        starts=lambda _problem, _left: [(1e-3,)],
    )


def _loop_reads_late(problem: AxisProblem) -> str:
    if not problem.plant.loop.has_controller:
        return "an open loop reads nothing"
    return _needs_table(problem)


LATE_COMMAND = _delay(0.0)
LATE_READING = replace(_delay(1.0), bars=_loop_reads_late)

SQUARENESS: Final = tuple(_squareness(other) for other in MACHINE_AXES)


def reading_hypotheses(problem: AxisProblem) -> tuple[Hypothesis, ...]:
    """Hypotheses about what is read of one axis."""
    cycles = wave_hypothesis("cyclic_error", "amplitude", MOST_ERROR, longest_period(problem), periods, _needs_table)
    return (cycles, SCALE, THERMAL, *SQUARENESS, LATE_COMMAND, LATE_READING)
