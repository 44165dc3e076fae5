"""Steps that several commands share: reading, analysing, and writing a plan as a program."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

import click
import msgspec

from ph_post.analysis.path_analysis import Analysis, IntervalSource, analyse
from ph_post.compensate.options import PlanOptions, PlanOutput
from ph_post.dialects.registry import find_dialect
from ph_post.drive.axes import check_axes
from ph_post.drive.effects.active import ignored_effects, unmoved_axes
from ph_post.drive.intervalfile import read_intervals
from ph_post.drive.intervals import IntervalTable, backlash_interval, look_up
from ph_post.drive.machinefile import read_machine
from ph_post.edit.inputs import read_input
from ph_post.files.storage import SourceBytes, or_shipped, read_raw
from ph_post.progress import Progress
from ph_post.types import Axis, BacklashInterval, Machine, Path
from ph_post.units import MM, MM_PER_MIN

BASELINES: Final = frozenset(("none", "linear", "step"))
"""Strategies that stand for what machines do today, and so do without inverse dynamics."""


def load(
    source: str | SourceBytes, machine: str | None, feed: float | None = None, dialect: str | None = None
) -> tuple[Path, Machine | None]:
    """Read a path file or a part program, and a machine file.

    The command line's feed [mm/min] and dialect are taken in place of theirs; moves of a program keep their
    own feeds. What a program has that its path does not show is said on standard error.

    Raises
    ------
    InputError
        Where a file is bad, or the machine has no drive for an axis of the path.
    """
    raw = source if isinstance(source, SourceBytes) else read_raw(or_shipped("paths", source))
    drives = None if machine is None else read_drives(machine, dialect)
    path, warnings = read_input(raw, drives, dialect)
    for warning in warnings:
        click.echo(f"warning: {warning}", err=True)
    if feed is not None:
        path = msgspec.structs.replace(path, feed=feed * MM_PER_MIN)
    if drives is None:
        return path, None
    check_axes(path.axes, "path", drives, str(machine))
    return path, drives


def read_drives(machine: str, dialect: str | None) -> Machine:
    """Read a machine file; the command line's dialect, where there is one, is taken in place of its own.

    Raises
    ------
    InputError
        Where the file is bad, or nobody has registered the dialect: the option's, or that of the file.
    """
    drives = read_machine(machine)
    if dialect is not None:
        find_dialect(dialect, "--dialect")
        return msgspec.structs.replace(drives, dialect=dialect)
    find_dialect(drives.dialect, f"{machine}: controller.dialect")
    return drives


def load_and_analyse(
    source: str | SourceBytes,
    machine: str | None,
    tolerance: float,
    progress: Progress,
    *,
    feed: float | None = None,
    dialect: str | None = None,
    intervals: str | None = None,
) -> Analysis:
    """Read, then analyse with windows of ε = `tolerance` [mm].

    `intervals` names a table in which backlash intervals are looked up in place of solving for them.
    """
    progress("reading")
    path, drives = load(source, machine, feed, dialect)
    solve = backlash_interval if intervals is None else _look_up_in(read_intervals(intervals))
    progress("locating turning points, windows and backlash intervals")
    return analyse(path, drives, tolerance * MM, solve)


def _look_up_in(table: IntervalTable) -> IntervalSource:
    """Look up what a table can hold; the gap of a loop that is not closed over the table knows no β and C."""

    def solve(axis: Axis, amplitude: float, omega: float) -> tuple[BacklashInterval | None, str]:
        source = partial(look_up, table) if axis.loop.encloses_backlash else backlash_interval
        return source(axis, amplitude, omega)

    return solve


def plan_options(how: Mapping[str, Any], carrier: PlanOutput = "table") -> PlanOptions:
    """Gather what :func:`ph_post.cli.options.planning` and `strategy` ask for, in SI.

    Only a table can lead the path by what the servos lag behind it.
    """
    lead = carrier == "table" and how["strategy"] not in BASELINES and not how["no_inverse_dynamics"]
    chosen = ("strategy", "start", "ratio", "degree", "t_star", "coefficients")
    return PlanOptions(
        **{name: how[name] for name in chosen},
        allow_retrograde=how["allow_retrograde"],
        min_feed=None if how["min_feed"] is None else how["min_feed"] * MM_PER_MIN,
        max_slowdown=how["max_slowdown"],
        inverse_dynamics=lead,
        feed_only=how["feed_only"],
        carrier=carrier,
        effort=how["effort"],
    )


def effect_warnings(machine: Machine, axes: Sequence[str]) -> list[str]:
    """Say which effects of a machine file are named there and do not act, each once, and which in part."""
    return [
        f"axis {name}: the effect {effect} of the machine file does not act in the simulation"
        for name in axes
        for effect in dict.fromkeys(ignored_effects(machine.axes[name]))
    ] + [
        f"axis {name}: its squareness to {other} does not show, because nothing moves {other}"
        for name in axes
        for other in unmoved_axes(machine.axes[name], axes)
    ]
