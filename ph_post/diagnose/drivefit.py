"""Least squares of the free run by the numbers of the base drive, nothing known of them beforehand."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final, NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace
from scipy.optimize import least_squares

from ph_post.diagnose.fit import inflation, mean_square, weights_of
from ph_post.diagnose.model import Problem, residuals
from ph_post.diagnose.record import Channel
from ph_post.drive.plant import Plant
from ph_post.types import Array, BoolArray
from ph_post.units import MICROMETRE

STEP: Final = 1e-3
"""Differences, of a logarithm, or of a length or its scale."""

FAR: Final = math.log(50.0)
"""By how much a number may leave where it starts, as a logarithm."""

MOST: Final = 5e-3
"""Widest gap and largest friction [m]."""

DAMPED: Final = 0.98
"""Largest part of the axis' damping that the motor may have: the load keeps some."""


class Knob(NamedTuple):
    """One number of a plant while it is fitted: how it is read and set, its bounds and its natural size."""

    name: str
    read: Callable[[Plant], float]
    turn: Callable[[Plant, float], Plant]
    low: float
    high: float
    scale: float


def knob_of(name: str, plant: Plant) -> Knob:
    """Return the knob of `b`, `c`, `eta`, `beta` (logarithms), `gap` or `friction` (micrometres)."""
    if name == "gap":
        return Knob(name, lambda p: p.gap / MICROMETRE, _wide, 0.0, MOST / MICROMETRE, 1.0)
    if name == "friction":
        return Knob(name, lambda p: p.coulomb_plus / MICROMETRE, _dry, 0.0, MOST / MICROMETRE, 1.0)
    start = math.log(getattr(plant, name))
    high = start + FAR
    if name == "eta":
        high = min(high, math.log(0.99))
    elif name == "beta":
        high = max(min(high, math.log(DAMPED * plant.c / (plant.b * plant.eta))), start + 0.1)
    return Knob(name, partial(_logarithm, name), partial(_set, name), start - FAR, high, 1.0)


def _logarithm(name: str, plant: Plant) -> float:
    return math.log(getattr(plant, name))


def _set(name: str, plant: Plant, value: float) -> Plant:
    return replace(plant, **{name: math.exp(value)})


def _wide(plant: Plant, value: float) -> Plant:
    return replace(plant, gap=value * MICROMETRE)


def _dry(plant: Plant, value: float) -> Plant:
    return replace(plant, coulomb_plus=value * MICROMETRE, coulomb_minus=value * MICROMETRE)


class DriveFit(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A plant at its best.

    `jacobian` (rows, names) is that of the weighted residuals by the knobs of `names`; `left` (n,) is what
    the free run leaves by channel, `worth` how many samples count as one, as they are not independent.
    """

    problem: Problem
    plant: Plant
    names: tuple[str, ...]
    left: Mapping[Channel, Array]
    jacobian: Array
    worth: float


def whole(problem: Problem) -> Problem:
    """Return a problem in which every sample that counts is fitted."""
    counted = problem.counted
    return replace(problem, fit=counted, held=np.zeros_like(counted))


def left_by(problem: Problem, plant: Plant) -> dict[Channel, Array]:
    """Residuals of a plant; origins and gains of the effort fit best."""
    return residuals(problem, plant, True)


def rows_of(problem: Problem, left: Mapping[Channel, Array], weights: Mapping[Channel, float]) -> Array:
    """Weighted residuals of the samples that are fitted, one channel after the other."""
    parts = [left[one.channel][problem.fit & one.ok] * weights[one.channel] for one in problem.observed]
    return np.concatenate(parts)


def position_rms(problem: Problem, left: Mapping[Channel, Array], use: BoolArray) -> float:
    """Root mean square that is left of the positions [m]."""
    squares = [
        left[one.channel][use & one.ok] ** 2 for one in problem.observed if one.channel != "force"
    ]  # fmt: skip
    return math.sqrt(float(np.mean(np.concatenate(squares))))


def fit_drive(problem: Problem, plant: Plant, names: Sequence[str], rounds: int = 3) -> DriveFit:
    """Fit numbers of a plant to the samples of `problem.fit`.

    Parameters
    ----------
    problem : Problem
    plant : Plant
        To start from; what is not named stays.
    names : sequence of str
        See :func:`knob_of`.
    rounds : int
        How often the channels are weighed anew by what is left of them.
    """
    for _ in range(rounds):
        before = _values(plant, names)
        plant = _fit_once(problem, plant, names)
        if np.allclose(_values(plant, names), before, rtol=0.0, atol=1e-7):
            break
    return tangent(problem, plant, names)


def _values(plant: Plant, names: Sequence[str]) -> Array:
    return np.array([knob_of(name, plant).read(plant) for name in names])


def _fit_once(problem: Problem, plant: Plant, names: Sequence[str]) -> Plant:
    knobs = [knob_of(name, plant) for name in names]
    weights = weights_of(problem, left_by(problem, plant), problem.fit)

    def rows(unknowns: Array) -> Array:
        return rows_of(problem, left_by(problem, turned(plant, knobs, unknowns)), weights)

    low, high = np.array([one.low for one in knobs]), np.array([one.high for one in knobs])
    start = np.clip(_values(plant, names), low + 1e-6, high - 1e-6)
    found = least_squares(
        rows, start, bounds=(low, high), jac=partial(_slopes, rows, knobs),
        x_scale=np.maximum(np.where(np.array(names) == "gap", np.abs(start), 1.0), 1.0),
        max_nfev=25, ftol=1e-10, xtol=1e-8, gtol=1e-10,
    )  # fmt: skip
    return turned(plant, knobs, found.x)


def turned(plant: Plant, knobs: Sequence[Knob], unknowns: Array) -> Plant:
    """Return a plant with its knobs set."""
    for knob, value in zip(knobs, unknowns, strict=True):
        plant = knob.turn(plant, float(value))
    return plant


def _slopes(rows: Callable[[Array], Array], knobs: Sequence[Knob], unknowns: Array) -> Array:
    """Central differences, one-sided where a bound is near."""
    columns = []
    for k, knob in enumerate(knobs):
        size = abs(unknowns[k]) if knob.name in ("gap", "friction") else knob.scale
        step = STEP * max(size, knob.scale)
        above, below = unknowns.copy(), unknowns.copy()
        above[k] = min(unknowns[k] + step, knob.high)
        below[k] = max(unknowns[k] - step, knob.low)
        columns.append((rows(above) - rows(below)) / (above[k] - below[k]))
    return np.stack(columns, axis=1)


def tangent(problem: Problem, plant: Plant, names: Sequence[str]) -> DriveFit:
    """Return the sensitivities of a plant as it is by some of its numbers."""
    knobs = [knob_of(name, plant) for name in names]
    left = left_by(problem, plant)
    weights = weights_of(problem, left, problem.fit)

    def rows(unknowns: Array) -> Array:
        return rows_of(problem, left_by(problem, turned(plant, knobs, unknowns)), weights)

    jacobian = _slopes(rows, knobs, _values(plant, names)) if names else np.zeros((0, 0))
    return DriveFit(
        problem=problem, plant=plant, names=tuple(names), left=left, jacobian=jacobian,
        worth=inflation(problem, left, problem.fit),
    )  # fmt: skip


def held_out_gain(problem: Problem, better: DriveFit, plain: DriveFit) -> float:
    """By how many nats, of independent samples, a fit explains better what neither was fitted to."""
    total = 0.0
    for one in problem.observed:
        here = problem.held & one.ok
        ratio = mean_square(plain.left[one.channel], here) / mean_square(better.left[one.channel], here)
        total += 0.5 * np.count_nonzero(here) * math.log(ratio)
    return total / better.worth
