"""Least-squares fit of the base drive to a log, and the decision whether the log shows backlash.

Backlash is accepted by its gain on held-out samples, and compared with friction in its place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import lru_cache, partial
from typing import Final, NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace
from scipy.optimize import least_squares

from ph_post.drive.plant import Plant, base_value, with_base_value
from ph_post.identify.free_run import (
    AxisProblem,
    correlation_inflation,
    mean_square,
    residuals,
    weighted_residuals,
    weights_of,
)
from ph_post.types import Array, AxisLog, BoolArray, Cascade
from ph_post.types.diagnosis import Channel
from ph_post.units import MICROMETRE, MS

STEP: Final = 1e-3
"""Differences, of a logarithm, or of a length or its scale."""

CLOSE: Final = 1e-7
"""Relative change of cost or numbers at which a fit ends that is compared with others on held-out samples: a
thousandth of a nat on ten thousand samples."""

FINE: Final = 1e-9
"""The same of a fit to all samples."""

SAME: Final = 1e-5
"""Change of a logarithm, or of a length [µm], below which a fit is not begun anew with other weights."""

FAR: Final = math.log(50.0)
"""Most change of a number from its start, as a logarithm."""

MOST: Final = 5e-3
"""Widest gap and largest friction [m]."""

QUICKEST: Final = 0.05
"""Shortest b/c, 1/ω_v or delay of a current loop in a fit, in periods of the log: shorter ones look alike, and
take ever longer to run."""

LONGEST_INTEGRAL: Final = 100.0
"""Longest T_n of a velocity loop in a fit [s], and in a machine file: longer ones look alike."""

DAMPED: Final = 0.98
"""Largest part of the axis' damping that the motor may have: the load keeps some."""


LENGTHS: Final = {"gap": ("gap",), "friction": ("coulomb_plus", "coulomb_minus")}
"""Free numbers that are lengths, and the fields of the plant that they set."""


MAY_BE_NONE: Final[Mapping[str, tuple[float, float, float]]] = {
    "velocity_feedforward": (1.0, 0.0, 2.0),
    "acceleration_feedforward": (1.0, 0.0, 2.0),
    "acceleration_lead": (MS, -50.0, 50.0),
    "current_time": (MS, 0.0, 20.0),
    "dead_time": (MS, -0.3, 50.0),
    "moving_average": (MS, 0.0, 200.0),
    "exponential": (MS, 0.0, 100.0),
}
"""Numbers of a cascade that may be 0: the unit in which they are fitted, and their bounds in it.

Readings may be sampled before their commands, which makes a dead time negative.
"""


class FreeNumber(NamedTuple):
    """One number of a plant while it is fitted: how it is read and set, and its bounds."""

    name: str
    read: Callable[[Plant], float]
    put: Callable[[Plant, float], Plant]
    low: float
    high: float


def free_number(name: str, plant: Plant) -> FreeNumber:
    """Return the free number `b`, `c`, `eta`, `beta` (logarithms), `gap` or `friction` (micrometres).

    Of a cascade its gains (logarithms), and what may be 0, in the units of :data:`MAY_BE_NONE`.
    """
    if name in Cascade.__struct_fields__:
        return _cascade_number(name, plant)
    if name in LENGTHS:
        fields = LENGTHS[name]
        return FreeNumber(
            name,
            lambda p: getattr(p, fields[0]) / MICROMETRE,
            lambda p, value: replace(p, **dict.fromkeys(fields, value * MICROMETRE)),
            0.0,
            MOST / MICROMETRE,
        )
    start = math.log(getattr(plant, name))
    high = start + FAR
    if name == "eta":
        high = min(high, math.log(0.99))
    elif name == "beta":
        high = max(min(high, math.log(DAMPED * plant.c / (plant.b * plant.eta))), start + 0.1)
    return FreeNumber(name, partial(_logarithm, name), partial(_set, name), start - FAR, high)


def _cascade_number(name: str, plant: Plant) -> FreeNumber:
    """Return a number of a cascade."""

    def read(p: Plant) -> float:
        return base_value(p, name)

    def put(p: Plant, value: float) -> Plant:
        return with_base_value(p, name, value)

    if name in MAY_BE_NONE:
        unit, low, high = MAY_BE_NONE[name]
        return FreeNumber(name, lambda p: read(p) / unit, lambda p, value: put(p, value * unit), low, high)
    start = math.log(read(plant))
    return FreeNumber(
        name, lambda p: math.log(read(p)), lambda p, value: put(p, math.exp(value)), start - FAR, start + FAR
    )


def _logarithm(name: str, plant: Plant) -> float:
    return math.log(getattr(plant, name))


def _set(name: str, plant: Plant, value: float) -> Plant:
    return replace(plant, **{name: math.exp(value)})


class DriveFit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A plant at its best.

    `jacobian` (rows, names) is that of the weighted residuals by the numbers of `names`; `left` (n,) is what
    the free run leaves by channel, `worth` how many samples count as one, as they are not independent.
    """

    problem: AxisProblem
    plant: Plant
    names: tuple[str, ...]
    left: Mapping[Channel, Array]
    jacobian: Array
    worth: float


class DrivePrior(NamedTuple):
    """Prior knowledge of a plant: its numbers, and relative standard errors of some of them."""

    plant: Plant
    errors: Mapping[str, float]

    def rows(self, there: Plant) -> Array:
        """Return by how many standard errors another plant is off."""
        return np.array(
            [(_logarithm(name, there) - _logarithm(name, self.plant)) / error for name, error in self.errors.items()]
        )


def with_all_samples(problem: AxisProblem) -> AxisProblem:
    """Return a problem in which every sample that counts is fitted."""
    counted = problem.counted
    return replace(problem, fit=counted, held=np.zeros_like(counted))


def position_rms(problem: AxisProblem, left: Mapping[Channel, Array], use: BoolArray) -> float:
    """Root mean square that is left of the positions [m]."""
    squares = [left[one.channel][use & one.ok] ** 2 for one in problem.positions]
    return math.sqrt(float(np.mean(np.concatenate(squares))))


def fit_drive(
    problem: AxisProblem,
    plant: Plant,
    names: Sequence[str],
    rounds: int = 3,
    priors: Mapping[str, float] = {},
) -> DriveFit:
    """Fit numbers of a plant to the samples of `problem.fit`.

    Where others are held out to compare fits by, no closer than that asks for.

    Parameters
    ----------
    problem : AxisProblem
    plant : Plant
        To start from; what is not named stays.
    names : sequence of str
        See :func:`free_number`.
    rounds : int
        How often the channels are weighed anew by what is left of them.
    priors : mapping, optional
        Numbers of the plant to start from that are known beforehand, and their relative standard errors.
    """
    known, compared = DrivePrior(plant, priors), bool(problem.held.any())
    if names and rounds > 1 and not compared:
        plant = _fit_once(problem, plant, names, known, rough=True)
    for _ in range(rounds if names else 0):
        before = _values(plant, names)
        plant = _fit_once(problem, plant, names, known, rough=compared)
        if np.allclose(_values(plant, names), before, rtol=0.0, atol=SAME):
            break
    return tangent(problem, plant, names)


def _values(plant: Plant, names: Sequence[str]) -> Array:
    return np.array([free_number(name, plant).read(plant) for name in names])


def _fit_once(problem: AxisProblem, plant: Plant, names: Sequence[str], known: DrivePrior, *, rough: bool) -> Plant:
    numbers = [_slowed(free_number(name, plant), plant, problem.period) for name in names]
    weights = weights_of(problem, residuals(problem, plant), problem.fit)

    @lru_cache(maxsize=1)  # slopes begin where a step ended
    def made(unknowns: tuple[float, ...]) -> Array:
        there = with_numbers(plant, numbers, unknowns)
        return np.concatenate(
            [weighted_residuals(problem, residuals(problem, there), weights, problem.fit), known.rows(there)]
        )

    def rows(unknowns: Array) -> Array:
        return made(tuple(map(float, unknowns)))

    low, high = np.array([one.low for one in numbers]), np.array([one.high for one in numbers])
    start = np.clip(_values(plant, names), low + 1e-6, high - 1e-6)
    found = least_squares(
        rows,
        start,
        bounds=(low, high),
        jac=partial(_slopes, rows, numbers, rough),
        x_scale=np.maximum(np.where(np.array(names) == "gap", np.abs(start), 1.0), 1.0),
        max_nfev=25,
        ftol=CLOSE if rough else FINE,
        xtol=CLOSE,
        gtol=1e-10,
    )
    return with_numbers(plant, numbers, found.x)


def _slowed(number: FreeNumber, plant: Plant, period: float) -> FreeNumber:
    """Keep a loop from becoming quicker, or its integrator slower, than any that a log tells apart."""
    shortest, here = QUICKEST * period, number.read(plant)
    if number.name == "b":
        return number._replace(low=max(number.low, min(here, math.log(shortest * plant.c))))
    if number.name == "velocity_gain":
        return number._replace(high=min(number.high, max(here, -math.log(shortest))))
    if number.name == "integral_rate":
        return number._replace(low=max(number.low, min(here, -math.log(LONGEST_INTEGRAL))))
    if number.name == "current_time":
        return number._replace(low=max(number.low, shortest / MS))
    return number


def with_numbers(plant: Plant, numbers: Sequence[FreeNumber], unknowns: Iterable[float]) -> Plant:
    """Return a plant with its free numbers set."""
    for number, value in zip(numbers, unknowns, strict=True):
        plant = number.put(plant, float(value))
    return plant


def _slopes(rows: Callable[[Array], Array], numbers: Sequence[FreeNumber], one_sided: bool, unknowns: Array) -> Array:
    """Central differences, or one-sided ones away from a bound; those are so where a bound is near too."""
    here, columns = rows(unknowns) if one_sided else np.zeros(0), []
    for k, number in enumerate(numbers):
        step = STEP * (max(abs(unknowns[k]), 1.0) if number.name in LENGTHS else 1.0)
        above, below = unknowns.copy(), unknowns.copy()
        above[k] = min(unknowns[k] + step, number.high)
        below[k] = max(unknowns[k] - step, number.low)
        if not one_sided:
            columns.append((rows(above) - rows(below)) / (above[k] - below[k]))
        elif above[k] > unknowns[k]:
            columns.append((rows(above) - here) / (above[k] - unknowns[k]))
        else:
            columns.append((here - rows(below)) / (unknowns[k] - below[k]))
    return np.stack(columns, axis=1)


def tangent(problem: AxisProblem, plant: Plant, names: Sequence[str]) -> DriveFit:
    """Return the sensitivities of a plant as it is by some of its numbers."""
    numbers = [free_number(name, plant) for name in names]
    left = residuals(problem, plant)
    weights = weights_of(problem, left, problem.fit)

    def rows(unknowns: Array) -> Array:
        return weighted_residuals(
            problem, residuals(problem, with_numbers(plant, numbers, unknowns)), weights, problem.fit
        )

    compared = bool(problem.held.any())
    jacobian = _slopes(rows, numbers, compared, _values(plant, names)) if names else np.zeros((0, 0))
    return DriveFit(
        problem=problem,
        plant=plant,
        names=tuple(names),
        left=left,
        jacobian=jacobian,
        worth=correlation_inflation(problem, left, problem.fit),
    )


def held_out_gain(problem: AxisProblem, better: DriveFit, plain: DriveFit) -> float:
    """Return by how many nats, of independent samples, a fit explains the held-out samples better."""
    total = 0.0
    for one in problem.observed:
        here = problem.held & one.ok
        ratio = mean_square(plain.left[one.channel], here) / mean_square(better.left[one.channel], here)
        total += 0.5 * np.count_nonzero(here) * math.log(ratio)
    return total / better.worth


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


class BacklashVerdict(NamedTuple):
    """Verdict of a log on the backlash.

    `fit` has the gap where it earns its place; where it does not, `bound` [m] is the smallest that would have
    shown, None where any could hide. `notes` say what the log does not show.
    """

    fit: DriveFit | None
    bound: float | None
    notes: tuple[str, ...] = ()


def why_backlash_hidden(problem: AxisProblem, axis_log: AxisLog) -> str:
    """Return why a log cannot show backlash, empty where it can."""
    speed = problem.speed[problem.counted]
    directions = np.sign(speed[np.abs(speed) > RESTS * np.max(np.abs(speed), initial=0.0)])
    if not np.any(np.diff(directions)):
        return "the log shows no backlash: the axis does not reverse"
    if problem.plant.loop.encloses_backlash:
        return ""
    if axis_log.table is None:
        return "the log shows no backlash: behind the motor's loop only a reading of the table shows it"
    if axis_log.side == "unknown":
        return "the log shows no backlash: the reading may be the motor's, where friction looks like backlash"
    return ""


def decide_backlash(problem: AxisProblem, base: DriveFit) -> BacklashVerdict:
    """Fit a gap, and friction in its place, and compare them on what was held out."""
    gapped = fitted_with(problem, base, "gap")
    shows = held_out_gain(problem, gapped, base) >= EARNS and gapped.plant.gap > 0.0
    plain = BacklashVerdict(gapped, None) if shows else BacklashVerdict(None, smallest_visible_backlash(problem, base))
    if base.plant.coulomb_plus > 0.0:
        return plain
    rival = fitted_with(problem, base, "friction")
    size = f"friction of {rival.plant.coulomb_plus / MICROMETRE:.3g} µm of following error"
    ahead = held_out_gain(problem, rival, gapped if shows else base)
    if ahead > EARNS:
        words = (
            f"{size} explains the log better than backlash; the backlash is not identified, and b and c are"
            " those of a drive without friction: run ph-post diagnose to name the effect"
        )
        return BacklashVerdict(None, None, (words,))
    if shows and ahead > -EARNS:
        words = (
            f"{size} explains the log as well as the lost motion; a log of the motor's side or of its force"
            " would separate them"
        )
        return BacklashVerdict(gapped, None, (words,))
    return plain


def fitted_with(problem: AxisProblem, base: DriveFit, name: str) -> DriveFit:
    """Fit the base numbers and one more, `gap` or `friction`, from the best of the sizes tried."""
    weights = weights_of(problem, base.left, problem.fit)

    def cost(plant: Plant) -> float:
        return float(np.sum(weighted_residuals(problem, residuals(problem, plant), weights, problem.fit) ** 2))

    tried = sorted((_with(base.plant, name, size) for size in TRIED), key=cost)
    fits = [fit_drive(problem, start, (*base.names, name)) for start in tried[:2]]
    return min(fits, key=lambda one: cost(one.plant))


def _with(plant: Plant, name: str, size: float) -> Plant:
    if name == "gap":
        return replace(plant, gap=size)
    return replace(plant, coulomb_plus=size, coulomb_minus=size)


def smallest_visible_backlash(
    problem: AxisProblem, base: DriveFit, sizes: Sequence[float] = tuple(GRID)
) -> float | None:
    """Return the smallest gap that the log contradicts, whatever b and c are; None where it does none."""
    weights = weights_of(problem, base.left, problem.fit)
    here = weighted_residuals(problem, base.left, weights, problem.fit)
    frame = np.linalg.qr(base.jacobian)[0] if base.names else np.zeros((here.size, 0))
    for size in sizes:
        there = weighted_residuals(
            problem, residuals(problem, replace(base.plant, gap=float(size))), weights, problem.fit
        )
        change = there - here
        change -= frame @ (frame.T @ change)
        if float(change @ change + 2.0 * here @ change) > BOUND * base.worth:
            return float(size)
    return None
