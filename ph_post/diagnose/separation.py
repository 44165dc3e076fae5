"""Which numbers of a drive a record tells apart: singular values of its whitened sensitivities.

The numbers are taken by their logarithms, so that columns compare and a direction is a product of powers: of
(ln η, ln gap) the direction (1, -1) leaves η times the gap as it is. Rows are residuals over their size, and
as many of them as are independent; one over a singular value is then a relative standard error.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.drivefit import DriveFit, left_by, rows_of
from ph_post.diagnose.fit import weights_of
from ph_post.diagnose.identification import Sensitivity
from ph_post.diagnose.model import Problem
from ph_post.types import Array
from ph_post.units import MICROMETRE

TELLS: Final = 0.25
"""Relative standard error up to which a number is known at all."""

SHARE: Final = 0.3
"""Part of a direction from which on a number belongs to it."""


def scaled(fit: DriveFit) -> Array:
    """Return the whitened sensitivities by the logarithms of the numbers, (rows, names)."""
    sizes = [fit.plant.gap / MICROMETRE if name == "gap" else 1.0 for name in fit.names]
    return np.asarray(fit.jacobian * np.array(sizes) / math.sqrt(fit.worth))


def relative_errors(fit: DriveFit, names: Sequence[str]) -> dict[str, float]:
    """Return relative standard errors of some numbers while the others hold; infinite where nothing tells."""
    columns = scaled(fit)[:, [fit.names.index(name) for name in names]]
    spread = spread_of(columns)
    return {name: math.sqrt(spread[k, k]) for k, name in enumerate(names)}


def spread_of(columns: Array) -> Array:
    """Covariance of the logarithms; what shows in no row has an infinite variance."""
    _, values, directions = np.linalg.svd(columns, full_matrices=False)
    inverse = np.divide(1.0, values, out=np.full_like(values, 1e9), where=values > 1e-9)
    return np.asarray((directions.T * inverse**2) @ directions)


def sensitivity_of(fit: DriveFit) -> Sensitivity:
    """Return rank, singular values and the directions that do not show."""
    _, values, directions = np.linalg.svd(scaled(fit), full_matrices=False)
    shown = values * TELLS > 1.0
    weak = tuple(
        {name: float(part) for name, part in zip(fit.names, direction, strict=True) if abs(part) >= SHARE}
        for direction in directions[~shown]
    )
    return Sensitivity(
        names=fit.names, singular_values=tuple(float(one) for one in values),
        rank=int(np.count_nonzero(shown)), weak=weak,
    )  # fmt: skip


def shown_names(fit: DriveFit, give_up: Sequence[str]) -> tuple[str, ...]:
    """Return the numbers that a record shows, if the others are what they are in the plant.

    Parameters
    ----------
    fit : DriveFit
        With the sensitivities by all of them.
    give_up : sequence of str
        What is held first where it is not known; what is not in it is never held.
    """
    names = list(fit.names)
    for name in give_up:
        if name in names and relative_errors(fit, names)[name] > TELLS:
            names.remove(name)
    return tuple(names)


def smoothed(problem: Problem) -> Problem:
    """Return a problem whose command, linear between its samples, is on average that of a smooth curve.

    The chord of a curve lies by ẍ h²/12 on the inside of it, in the mean over a period h. The record does not
    tell which of the two the drive was given.
    """
    command = problem.command
    bend = np.zeros_like(command)
    bend[1:-1] = np.diff(command, 2)
    return replace(problem, command=command - bend / 12.0)


def between_samples(fit: DriveFit, names: Sequence[str]) -> dict[str, float]:
    """By how much numbers would come out otherwise, relative, had the command been smooth between samples."""
    if not names:
        return {}
    problem = fit.problem
    weights = weights_of(problem, fit.left, problem.fit)
    change = rows_of(problem, left_by(smoothed(problem), fit.plant), weights)
    change -= rows_of(problem, fit.left, weights)
    sizes = [fit.plant.gap / MICROMETRE if name == "gap" else 1.0 for name in fit.names]
    columns = (fit.jacobian * np.array(sizes))[:, [fit.names.index(name) for name in names]]
    moved = -np.linalg.lstsq(columns, change, rcond=None)[0]
    return dict(zip(names, map(float, moved), strict=True))
