"""Sizes of the contour error of a command in many scenarios; what is alike in some of them is run and measured once."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from ph_post.simulate.assess import AlikeRows, run_scenarios
from ph_post.simulate.contour import Nominal, first_counted
from ph_post.simulate.machine import Runs
from ph_post.types import Array, Command, Machine, Scenario

MOST: Final = 0.95
"""Part of the time at which the error is within its percentile that is kept."""


class Sizes(NamedTuple):
    """Largest size of an error, its root mean square and 95th percentile [m], and the row of the largest."""

    max: float
    rms: float
    most: float
    row: int


def sizes_of(error: Array) -> Sizes:
    """Return the sizes of an error (n,) [m]; none where no rows count."""
    if error.size == 0:
        return Sizes(0.0, 0.0, 0.0, 0)
    size = np.abs(error)
    row = int(np.argmax(size))
    return Sizes(float(size[row]), float(np.sqrt(np.mean(size * size))), float(np.quantile(size, MOST)), row)


def measure_sizes(command: Command, machine: Machine, nominal: Nominal, tried: Sequence[Scenario]) -> tuple[Sizes, ...]:
    """Sizes of the error in some scenarios, of the rows that count.

    Parameters
    ----------
    command : Command
    machine : Machine
    nominal : Nominal
        The path.
    tried : sequence of Scenario

    Returns
    -------
    tuple of Sizes
        Of each scenario.
    """
    first, runs = first_counted(command, machine), Runs(command, machine)
    alike = AlikeRows(lambda table, rows: nominal.nearest(table, command.s[rows]).error)
    return run_scenarios(lambda one: sizes_of(alike.errors(runs.of(one).executed)[first:]), tried)
