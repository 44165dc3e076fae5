"""Numbers of the paper, and the experiment of its section 6, computed and compared.

The example is X = a sin Ωt. Section 6 is computed in the paper's mode, and on the whole machine, whose gaps
open at every reversal of either axis.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z; the figures beyond those printed there are computed from its equations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, Final

import msgspec
import numpy as np

from ph_post.analysis.path_analysis import Analysis, analyse
from ph_post.compensate import profile, shapes
from ph_post.compensate.profile import coefficients_from_ratio, middle_factor, traversal_factor
from ph_post.compensate.shapes import middle_ratio, single
from ph_post.drive.backlash import gap_constant
from ph_post.drive.harmonic import phase_constants
from ph_post.drive.machinefile import read_machine
from ph_post.drive.servo import discriminant, rates
from ph_post.drive.steady_state import first_reversal, steady_interval
from ph_post.errors import SolveError
from ph_post.files.path import read_path
from ph_post.files.storage import shipped
from ph_post.simulate.machine import simulate
from ph_post.simulate.paper_mode import STEP, PaperRun, RadialError, radial_error, simulate_turning_point
from ph_post.types import Array, Command, FeedProfile, Run, Window, frozen

AMPLITUDE: Final = 0.25
"""a [m], and ρ_0 in section 6."""

BETWEEN_REVERSALS: Final = 6.0
"""T [s]."""

OMEGA: Final = math.pi / BETWEEN_REVERSALS
"""Ω [1/s]; V_c = aΩ in section 6."""


DEGREE: Final = 10
T_STAR: Final = 0.5
"""t_star [s]."""

LEAD: Final = 0.5 * math.pi
"""Θ_star [rad]."""


def section_6_profile(ratio: float) -> FeedProfile:
    """Return the profile of section 6 of [1]_ with that V(½)/V_c."""
    shape, cruise = profile.dip(ratio, DEGREE), AMPLITUDE * OMEGA
    return FeedProfile(
        window=0,
        shape=shape,
        cruise=cruise,
        t_star=T_STAR,
        s_star=shapes.half_length(shape, cruise, T_STAR),
        ratio=ratio,
    )


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


def run_on_whole_machine(ratio: float) -> Run:
    """Simulate the whole machine on the same command: every reversal of either axis opens its gap."""
    given = section_6_profile(ratio)
    count = math.floor(profile.lead_duration(given, AMPLITUDE, LEAD) / STEP)
    t: Array = STEP * np.arange(-count, count + 1.0)
    nowhere = np.zeros(t.size, dtype=np.int64)
    command = Command(
        axes=("X", "Y"),
        period=STEP,
        t=frozen(t),
        segment=nowhere,
        xi=frozen(np.zeros(t.size)),
        s=frozen(profile.travelled(given, t)),
        position=frozen(positions_along(given)(t)),
        feed=frozen(profile.feed(given, t)),
        window=nowhere,
    )
    return simulate(command, read_machine("paper"))


def error_in_papers_mode(ratio: float) -> RadialError:
    """Return the fractional radial error over [-t_star, t_star], in the paper's mode."""
    run = run_in_papers_mode(ratio)
    return radial_error(run.t, run.executed, AMPLITUDE, T_STAR)


def error_on_whole_machine(ratio: float) -> RadialError:
    """Return the same of the whole machine."""
    run = run_on_whole_machine(ratio)
    return radial_error(run.t, run.executed, AMPLITUDE, T_STAR)


FIGURE_1_TOLERANCE: Final = {"X": 1e-6, "Y": 1e-5}
"""ε of the vertical (X) and the horizontal (Y) turning point in Figure 2 [m]."""

WHOLE_MACHINE_RATIOS: Final = (1.0, 0.25, -0.3, -0.4, -0.45)
WHOLE_MACHINE_ERRORS: Final = ("2.19e-3", "1.36e-3", "1.05e-3", "2.09e-3", "2.76e-3")
"""V(½)/V_c, and max of e where each reversal of either axis opens its gap: computed beforehand by another
simulation, in steps of 1 ms. The retrograde gain of the paper is gone."""


class PaperNumber(msgspec.Struct, frozen=True, kw_only=True):
    """A number of the paper: where it stands, what it is, what comes out, and the digits expected.

    The digits are those printed, those of a printed formula evaluated exactly, or more digits of the
    same computed beforehand. `within` is the relative difference that simulations in steps of 1 ms, each with
    its own way of placing events between them, may have; without it all digits count.
    """

    where: str
    name: str
    value: float
    reference: str
    within: float | None = None

    @property
    def error(self) -> float:
        """Computed less expected."""
        return self.value - float(self.reference)

    @property
    def agrees(self) -> bool:
        """Return whether the value, rounded to the digits expected, is the number expected, or within its bound."""
        if self.within is not None:
            return abs(self.error) <= self.within * abs(float(self.reference))
        mantissa, _, exponent = self.reference.partition("e")
        digit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
        return abs(self.error) <= 0.5 * digit * (1.0 + 1e-9)

    @property
    def verdict(self) -> str:
        """In a word."""
        bound = "" if self.within is None else f" within {self.within:.0%}"
        return f"agrees{bound}" if self.agrees else "DIFFERS"


def paper_numbers() -> tuple[PaperNumber, ...]:
    """Compute every number."""
    return (
        *_drive_numbers(),
        *_interval_numbers(),
        *_profile_numbers(),
        *_figure_1_numbers(),
        *_simulated_numbers(),
    )


def number_view(number: PaperNumber) -> dict[str, Any]:
    """Return a number as ``paper --json`` shows it."""
    return {
        "where": number.where,
        "name": number.name,
        "value": number.value,
        "reference": number.reference,
        "error": number.error,
        "agrees": number.agrees,
    }


def _drive_numbers() -> Iterator[PaperNumber]:
    axis = read_machine("paper").axes["X"]
    gamma, lam = rates(axis.servo)[:2]
    p, q, phi = phase_constants(axis.servo, axis.gap.beta or 0.0, OMEGA)
    for name, value, reference in (
        ("Δ = c² - 4b [s²]", discriminant(axis.servo), "-0.001975"),
        ("γ [1/s]", gamma, "5"),
        ("λ [1/s]", lam, "44.440972"),
        ("C [rad/(m s²)]", gap_constant(axis), "1.428571e5"),
        ("Ω [rad/s]", OMEGA, "0.523599"),
        ("p", p, "-1.000130"),
        ("q", q, "0.002619"),
        ("φ [rad]", phi, "1.088448"),
    ):
        yield PaperNumber(where="§4.2", name=name, value=value, reference=reference)


def _interval_numbers() -> Iterator[PaperNumber]:
    axis = read_machine("paper").axes["X"]
    first = first_reversal(axis.servo, axis.gap, AMPLITUDE, OMEGA)
    settled = steady_interval(axis.servo, axis.gap, AMPLITUDE, OMEGA)
    if settled is None:
        raise SolveError("the paper's example has no settled orbit")
    for name, value, reference in (
        ("lag of the first reversal [s]", first.lag, "0.005000546"),
        ("lag, settled [s]", settled.lag, "0.005000674"),
        ("lag, settled, as printed [s]", settled.lag, "0.005001"),
        ("x at standstill, settled [m]", settled.position, "0.25003341707"),
        ("Δt, settled [s]", settled.duration, "0.11874297"),
        ("Δt, as printed [s]", settled.duration, "0.118743"),
    ):
        yield PaperNumber(where="§4.2", name=name, value=value, reference=reference)


def _profile_numbers() -> Iterator[PaperNumber]:
    for degree, f, reference in ((4, -1.5, "0.0625"), (10, -2.8, "0.06484375")):
        ratio = middle_ratio(single(_with_middle(degree, f)))
        yield PaperNumber(where="§5.1", name=f"V(½)/V_c at n = {degree}, f = {f:g}", value=ratio, reference=reference)
    factor = middle_factor(0.25, 10)
    yield PaperNumber(where="§6", name="f for V(½)/V_c = 0.25, n = 10", value=factor, reference="-2.04761905")
    time = traversal_factor(factor, 10)
    yield PaperNumber(where="§5.1", name="window time factor (n+1)/(n+f)", value=time, reference="1.38323353")


def _with_middle(degree: int, factor: float) -> Any:
    coefficients = coefficients_from_ratio(1.0, degree).copy()
    coefficients[degree // 2] = factor
    return coefficients


def figure_1_analysis() -> Analysis:
    """Analyse the shipped quintic of Figure 1."""
    return analyse(read_path(shipped("paths", "figure1")), None, FIGURE_1_TOLERANCE["Y"])


def figure_1_windows() -> tuple[Window, ...]:
    """Windows of the vertical and the horizontal turning point, each with the ε of Figure 2."""
    path = read_path(shipped("paths", "figure1"))
    windows = []
    for axis, tolerance in FIGURE_1_TOLERANCE.items():
        analysis = analyse(path, None, tolerance)
        own = {point.index for point in analysis.turning_points if point.axis == axis}
        windows += [window for window in analysis.windows if window.turning_point in own]
    return tuple(windows)


def _figure_1_numbers() -> Iterator[PaperNumber]:
    vertical, horizontal = figure_1_windows()
    for name, window, reference in (("vertical", vertical, "0.2411"), ("horizontal", horizontal, "0.2033")):
        text = f"2|s| of Eq. (6), {name} turning point"
        yield PaperNumber(where="Figure 2", name=text, value=2.0 * window.estimate, reference=reference)


def _simulated_numbers() -> Iterator[PaperNumber]:
    """Compute errors of Figure 11, in the paper's mode and on the whole machine."""
    for ratio, largest, rms in (
        (1.0, "2.19e-3", "6.17e-4"),
        (0.25, "1.36e-3", "3.86e-4"),
        (-0.4, "2.0e-4", None),
        (-0.45, "2.7e-4", None),
    ):
        error = error_in_papers_mode(ratio)
        for word, value, reference in (("max", error.max, largest), ("rms", error.rms, rms)):
            if reference is not None:
                yield _simulated(f"{word} of e at V(½)/V_c = {ratio:g}", value, reference, 0.02)
    for ratio, largest in zip(WHOLE_MACHINE_RATIOS, WHOLE_MACHINE_ERRORS, strict=True):
        name = f"max of e at V(½)/V_c = {ratio:g}, whole machine"
        yield _simulated(name, error_on_whole_machine(ratio).max, largest, 0.03)


def _simulated(name: str, value: float, reference: str, within: float) -> PaperNumber:
    return PaperNumber(where="§6", name=name, value=value, reference=reference, within=within)
