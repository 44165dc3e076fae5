"""Sizes of the contour error of a command in many scenarios; those that differ in their beginning share the rest.

On which side of its backlash an axis stood does not matter any more once it was taken up: where table and motor of a
short run are those of the full run of another side, the rest of that run counts for both.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.simulate.assess import run_scenarios
from ph_post.simulate.contour import Nominal, first_counted
from ph_post.simulate.machine import simulate
from ph_post.types import Array, Command, Machine, Run, Scenario

MOST: Final = 0.95
"""Part of the time at which the error is within its percentile that is kept."""

HEAD: Final = 8
"""The short run has one of so many rows."""

LEAST: Final = 4000
"""Rows below which all runs are full."""

MET: Final = 50
"""Rows at the end of the short run in which it is the full one."""

SAME: Final = 1e-11
"""Positions [m] that are the same."""


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
    first = first_counted(command, machine)
    rows = len(command.t) // HEAD if len(command.t) >= LEAST else 0
    leaders = tuple({_apart_from_sides(one): one for one in reversed(tried)}.values())

    def lead(scenario: Scenario) -> tuple[Array, Array]:
        run = simulate(command, machine, scenario)
        return nominal.nearest(run.executed, command.s).error, _end(run, rows)

    full = dict(zip(map(_apart_from_sides, leaders), run_scenarios(lead, leaders), strict=True))
    head = _head(command, rows)

    def follow(scenario: Scenario) -> Sizes:
        error, end = full[_apart_from_sides(scenario)]
        if scenario in leaders:
            return sizes_of(error[first:])
        if rows:
            run = simulate(head, machine, scenario)
            if np.abs(_end(run, rows) - end).max() <= SAME:
                begin = nominal.nearest(run.executed, head.s).error
                return sizes_of(np.concatenate([begin, error[rows:]])[first:])
        return sizes_of(lead(scenario)[0][first:])

    return run_scenarios(follow, tried)


def _apart_from_sides(scenario: Scenario) -> Scenario:
    """Leave out where axes stand at first."""
    return replace(scenario, flank=None, opposite=())


def _end(run: Run, rows: int) -> Array:
    """Places of tables and motors in the last of so many rows [m]."""
    last = slice(max(rows - MET, 0), rows)
    return np.concatenate([run.executed[last], run.motor[last]])


def _head(command: Command, rows: int) -> Command:
    """Return the first rows of a command."""
    columns = ("t", "segment", "xi", "s", "position", "feed", "window", "offset", "jogged")
    cut = {name: None if (value := getattr(command, name)) is None else value[:rows] for name in columns}
    return replace(command, **cut)
