"""Tabulate backlash intervals off line."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from typing import Final

import numpy as np
from msgspec.structs import asdict

from ph_post.analysis.path_analysis import swings
from ph_post.analysis.turning_points import find_turning_points
from ph_post.api.inputs import Job, Source, any_machine, path_of_job, raw_job
from ph_post.bounds import MOST_INTERVALS
from ph_post.dialects.registry import find_dialect
from ph_post.drive.axes import check_axes
from ph_post.drive.intervalfile import interval_content
from ph_post.drive.intervals import IntervalTable, tabulate
from ph_post.errors import InputError, OptionsError
from ph_post.files.storage import read_raw, shipped, write_atomically
from ph_post.geometry.track import Track
from ph_post.progress import Progress, no_progress
from ph_post.types import Array, Machine

DEFAULT_PATH: Final = "circle"
"""The shipped path whose circle is taken where none is named: the one of the paper's example."""


class SweptIntervals(IntervalTable, frozen=True, kw_only=True, eq=False):
    """Backlash intervals over grids of β and C, as :func:`sweep` returns them.

    `warnings` say what of a part program is not in the path whose circles were taken.
    """

    warnings: tuple[str, ...] = ()

    def write(self, target: Source) -> None:
        """Write a table that compensate's `interval_table` takes, .json or .csv; ``-`` is CSV on standard output.

        Raises
        ------
        InputError
            Where the ending is another.
        """
        write_atomically({os.fspath(target): interval_content(self, os.fspath(target))})


def sweep(
    machine: Machine | Source,
    beta: Sequence[float],
    gain: Sequence[float],
    *,
    job: Job | None = None,
    radius: Sequence[float] | None = None,
    feed: Sequence[float] | None = None,
    axes: Sequence[str] = (),
    progress: Progress = no_progress,
) -> SweptIntervals:
    """Work out how long backlash holds an axis, over grids of β and C.

    Implements the off-line tables of section 5.3 of [1]_. The circles are those of the turning points of a
    path, every radius at every feed that occurs; or those of `radius` and `feed`; or else the circle of the
    paper's example.

    Parameters
    ----------
    machine : Machine, str or path
    beta : sequence of float, shape (n,)
        β, the motor's own decay rate [1/s], ascending.
    gain : sequence of float, shape (m,)
        C = N/(η r b), the motor's acceleration in the gap by metre of error [rad/(m s²)], ascending.
    job : Path, PartProgram, str or path, optional
        Path whose circles are taken.
    radius : sequence of float, optional
        Radii of the circles [m], ascending; needs `feed`.
    feed : sequence of float, optional
        Feeds along the circles [m/s], ascending; with a job one feed, in place of the path's.
    axes : sequence of str, optional
        Axes to tabulate; by default all whose interval depends on β and C.
    progress : callable, optional
        Called with the name of every stage.

    Returns
    -------
    SweptIntervals

    Raises
    ------
    InputError
        Where an input is bad, no axis depends on β and C, or the table would have more than
        :data:`~ph_post.bounds.MOST_INTERVALS` intervals.

    References
    ----------
    .. [1] Real-time compensation of backlash positional errors in CNC machines by localized feedrate
       modulation, Int. J. Adv. Manuf. Technol. 119 (2022), doi:10.1007/s00170-021-08515-z.

    Examples
    --------
    >>> import ph_post as ph
    >>> table = ph.sweep("paper", [1.0], [1e5, 2e5])
    >>> table.axes[0].duration.shape
    (1, 1, 1, 2)
    """
    progress("reading")
    drives, name = any_machine(machine)
    chosen = _tabulated_axes(drives, axes, name)
    warnings: tuple[str, ...] = ()
    if radius is not None:
        if job is not None or feed is None:
            raise OptionsError("--radius needs --feed, and no path beside it")
        radii, feeds = np.array(radius), np.array(feed)
    else:
        if feed is not None and (job is None or len(feed) > 1):
            raise OptionsError("--feed needs --radius, or a path and then one feed")
        find_dialect(drives.dialect, f"{name}: controller.dialect")
        raw = read_raw(shipped("paths", DEFAULT_PATH)) if job is None else raw_job(job)
        path, warnings = path_of_job(raw, drives, feed=None if feed is None else feed[0])
        check_axes(path.axes, "path", drives, name)
        found = swings(path, [point for point in find_turning_points(Track(path)) if point.axis in chosen])
        if not found:
            raise InputError(path.name, f"no axis of {', '.join(chosen)} reverses smoothly on this path")
        radii, feeds = _distinct([a for a, _ in found]), _distinct([a * omega for a, omega in found])
    counts = (len(chosen), len(radii), len(feeds), len(beta), len(gain))
    if math.prod(counts) > MOST_INTERVALS:
        size = f"{' x '.join(map(str, counts))} = {math.prod(counts)}"
        raise OptionsError(f"expected at most {MOST_INTERVALS} intervals; got {size}")
    progress("solving for the backlash intervals")
    table = tabulate(drives, chosen, radii, feeds, np.array(beta), np.array(gain))
    return SweptIntervals(**asdict(table), warnings=warnings)


def _tabulated_axes(drives: Machine, wanted: Sequence[str], machine: str) -> list[str]:
    """Return the axes asked for, or all whose interval depends on β and C."""
    closed = [name for name, axis in drives.axes.items() if axis.loop.encloses_backlash]
    for name in wanted:
        if name not in drives.axes:
            raise InputError(machine, f"no axis {name}", expected=" or ".join(drives.axes), got=name)
        if name not in closed:
            raise InputError(
                f"{machine}: axes.{name}",
                "the interval of this axis depends on neither β nor C",
                expected='feedback "load"',
                got=f'"{drives.axes[name].feedback}"',
            )
    if not closed:
        raise InputError(
            machine, "no interval of this machine depends on β or C", expected='an axis with feedback "load"'
        )
    return list(dict.fromkeys(wanted)) or closed


def _distinct(values: list[float]) -> Array:
    """Return values ascending, each once but for rounding."""
    ascending = np.sort(values)
    distinct: Array = ascending[np.append(True, np.diff(ascending) > 1e-9 * ascending[1:])]
    return distinct
