"""The experiment of section 6: a profile through a turning point, in the paper's mode and honestly.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 6.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from ph_post.compensate import profile, shapes
from ph_post.io.machinefile import read_machine
from ph_post.report.example import AMPLITUDE, OMEGA
from ph_post.simulate.machine import simulate
from ph_post.simulate.paper_mode import (
    STEP,
    PaperRun,
    RadialError,
    radial_error,
    simulate_turning_point,
)
from ph_post.types import Array, Command, FeedProfile, Run, frozen

DEGREE: Final = 10
T_STAR: Final = 0.5
"""t_star [s]."""

LEAD: Final = 0.5 * math.pi
"""Θ_star [rad]."""


def section_6_profile(ratio: float) -> FeedProfile:
    """Return the profile of section 6 of [1]_ with that V(½)/V_c."""
    shape, cruise = profile.dip(ratio, DEGREE), AMPLITUDE * OMEGA
    return FeedProfile(
        window=0, shape=shape, cruise=cruise, t_star=T_STAR,
        s_star=shapes.half_length(shape, cruise, T_STAR), ratio=ratio,
    )  # fmt: skip


def positions_along(given: FeedProfile) -> Callable[[Array], Array]:
    """X, Y [m] of Eq. (30) of [1]_ as function of time, shape (n, 2)."""
    return lambda t: np.stack(profile.commanded_position(given, AMPLITUDE, t), axis=1)


def run_in_papers_mode(ratio: float) -> PaperRun:
    """Simulate as section 5.3 of [1]_ does."""
    given = section_6_profile(ratio)
    speed = given.cruise * np.array([math.sin(LEAD), math.cos(LEAD)])
    lead = profile.lead_duration(given, AMPLITUDE, LEAD)
    axis = read_machine("paper").axes["X"]
    return simulate_turning_point(axis, positions_along(given), speed, lead)


def run_honestly(ratio: float) -> Run:
    """Simulate the whole machine on the same command: every reversal of either axis opens its gap."""
    given = section_6_profile(ratio)
    count = math.floor(profile.lead_duration(given, AMPLITUDE, LEAD) / STEP)
    t: Array = STEP * np.arange(-count, count + 1.0)
    nowhere = np.zeros(t.size, dtype=np.int64)
    command = Command(
        axes=("X", "Y"), period=STEP, t=frozen(t), segment=nowhere, xi=frozen(np.zeros(t.size)),
        s=frozen(profile.travelled(given, t)), position=frozen(positions_along(given)(t)),
        feed=frozen(profile.feed(given, t)), window=nowhere,
    )  # fmt: skip
    return simulate(command, read_machine("paper"))


def error_in_papers_mode(ratio: float) -> RadialError:
    """Return the fractional radial error over [-t_star, t_star], in the paper's mode."""
    run = run_in_papers_mode(ratio)
    return radial_error(run.t, run.executed, AMPLITUDE, T_STAR)


def error_honestly(ratio: float) -> RadialError:
    """Return the same of the whole machine."""
    run = run_honestly(ratio)
    return radial_error(run.t, run.executed, AMPLITUDE, T_STAR)
