"""Measure a machine: identify its drives, diagnose missing effects, write test programs."""

from __future__ import annotations

import os
from abc import abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from typing import get_args

import numpy as np
from msgspec.structs import asdict

from ph_post.api.inputs import Source, any_machine, machine_text, read_log, source_of
from ph_post.api.options import require_word
from ph_post.diagnose import diagnose as diagnosing
from ph_post.diagnose.fit import base_model, residuals_of
from ph_post.errors import OptionsError
from ph_post.files.log import require_axes
from ph_post.files.storage import SourceText, write_atomically
from ph_post.identify import identify as identifying
from ph_post.identify.excerpt import excerpt
from ph_post.identify.free_run import problem_of
from ph_post.identify.log_quality import examine
from ph_post.identify.machinefile import diagnosed_machine, identified_machine
from ph_post.identify.starting_machine import Transmission
from ph_post.progress import Progress, no_progress
from ph_post.testprograms.gauges import gauge_kit
from ph_post.testprograms.kit import WARM_UP, calibration_kit
from ph_post.types import MACHINE_AXES, Feedback, Log, Machine
from ph_post.types.diagnosis import Diagnosis, Experiment, Identification, ResidualTrace
from ph_post.units import LEAD, MM


class MachineFileResult:
    """A result that a machine file takes up."""

    __slots__ = ()

    @abstractmethod
    def machine_file(self) -> str:
        """Return the machine file."""

    def write(self, target: Source) -> None:
        """Write :meth:`machine_file`; ``-`` is standard output."""
        write_atomically({os.fspath(target): self.machine_file()})


class LogIdentification(Identification, MachineFileResult, frozen=True, kw_only=True):
    """An identification with its `log`, and the machine file that it began with, None where there was none."""

    log: Log
    source: SourceText | None = None

    def machine_file(self) -> str:
        """Return the machine file with the identified numbers; without a file to begin with, a new one.

        Raises
        ------
        InputError
            Where a new file would need a number that neither the log nor the caller gave.
        """
        return identified_machine(self.source, self, self.log)

    def residuals(self) -> Iterator[tuple[ResidualTrace, float]]:
        """Run the identified machine on the logged command, and yield each residual with its noise [m].

        Positions alone; `before` and `after` of a trace are the same.
        """
        log = excerpt(self.log, self.machine)
        quality = examine(log, self.machine)
        for name in self.drives:
            problem = problem_of(log, name, self.machine.axes[name], quality)
            if problem is None:
                continue
            left = residuals_of(problem, base_model(problem))
            for one in problem.observed:
                if one.channel != "force":
                    counted = problem.counted & one.ok
                    trace = ResidualTrace(
                        axis=name,
                        channel=one.channel,
                        t=problem.t,
                        command=problem.command,
                        before=left[one.channel],
                        after=left[one.channel],
                        counted=counted,
                        held_out=np.zeros_like(counted),
                    )
                    yield trace, one.noise


class LogDiagnosis(Diagnosis, MachineFileResult, frozen=True, kw_only=True, eq=False):
    """A diagnosis with its `log`, and the machine file that it began with, None where it was made by hand."""

    log: Log
    source: SourceText | None = None

    def machine_file(self) -> str:
        """Return the machine file with what was found added to it.

        Raises
        ------
        InputError
            Where the machine was not read from a file.
        """
        return diagnosed_machine(source_of(self.machine, self.source, "found"), self, self.log)


def identify(
    log: Log | Source,
    machine: Machine | Source | None = None,
    *,
    feedback: Feedback | Mapping[str, Feedback] | None = None,
    gear_ratio: float | None = None,
    screw_lead: float | None = None,
    for_file: bool = False,
    progress: Progress = no_progress,
) -> LogIdentification:
    r"""Identify b, c and the backlash of every axis of a log, with standard errors.

    Parameters
    ----------
    log : Log, str or path
    machine : Machine, str or path, optional
        Gives limits, controller, effects, and what the log does not show.
    feedback : {"load", "motor", "none"} or mapping by axis, optional
        Where the loop closes, without a machine; by default it is assumed from which sides were read.
    gear_ratio : float, optional
        Turns of the motor a turn of the screw, N, of all axes; goes with `screw_lead`, without a machine.
    screw_lead : float, optional
        Lead of the screw [m], of all axes.
    for_file : bool, optional
        Refuse before the fit what :meth:`LogIdentification.machine_file` would refuse behind it.
    progress : callable, optional
        Called with the name of every stage.

    Returns
    -------
    LogIdentification
        `axes` are the parameters by axis, `machine` the machine that they make.

    Raises
    ------
    InputError
        Where the log shows no parameter at all, or contradicts what was given.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import ph_post as ph
    >>> run = ph.simulate("circle", "router")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "run.csv")
    ...     run.write_log(file)
    ...     log = ph.read_log(file)
    >>> found = ph.identify(log, "router")
    >>> round(found.axes["X"]["lost_motion"].value, 3), found.axes["X"]["lost_motion"].unit
    (0.12, 'mm')
    """
    drives, source = (None, None) if machine is None else measured_machine_of(machine)
    transmission = _transmission(drives, gear_ratio, screw_lead)
    record = _log_of(log, drives)
    loops = dict.fromkeys(record.axes, feedback) if isinstance(feedback, str) else dict(feedback or {})
    for kind in loops.values():
        require_word("feedback", kind, get_args(Feedback))
    loops = {name: kind for name, kind in loops.items() if name in record.axes}
    found = identifying.identify(record, drives, loops, transmission, for_file, progress)
    return LogIdentification(**asdict(found), log=record, source=source)


def _transmission(drives: Machine | None, ratio: float | None, lead: float | None) -> dict[str, Transmission] | None:
    """Return N and r of all axes; None where neither is given."""
    if ratio is None and lead is None:
        return None
    if drives is not None:
        given = "--gear-ratio" if lead is None else "--screw-lead"
        raise OptionsError(f"with -m the machine file gives gear ratio and lead; got {given}")
    if ratio is None or lead is None:
        raise OptionsError("--gear-ratio and --screw-lead go together; got one of them")
    return dict.fromkeys(MACHINE_AXES, Transmission(ratio, lead / MM * LEAD))


def diagnose(log: Log | Source, machine: Machine | Source, *, progress: Progress = no_progress) -> LogDiagnosis:
    r"""Find where a log parts from the simulation, and which physical effect the machine file lacks.

    Parameters
    ----------
    log : Log, str or path
    machine : Machine, str or path
        With a drive for every axis of the log.
    progress : callable, optional
        Called with the name of every stage.

    Returns
    -------
    LogDiagnosis
        `verdict` is "named", "nothing-missing", "ambiguous", "unknown" or "not-identifiable".

    Raises
    ------
    InputError
        Where an input is bad, or the log belongs to another machine.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> import ph_post as ph
    >>> rows = "".join(f"{k / 1000},0.0,0.0,0.0,0.0\n" for k in range(400))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder, "run.csv")
    ...     _ = file.write_text("t,X_cmd,X_motor,Y_cmd,Y_motor\n" + rows)
    ...     ph.diagnose(file, "router").verdict
    'not-identifiable'
    """
    drives, source = measured_machine_of(machine)
    record = _log_of(log, drives)
    found = diagnosing.diagnose(record, drives, progress)
    return LogDiagnosis(**asdict(found), log=record, source=source)


def measured_machine_of(machine: Machine | Source) -> tuple[Machine, SourceText | None]:
    """Return a machine and the text of its file, None where it has none."""
    drives, _ = any_machine(machine)
    return drives, machine_text(drives)


def _log_of(log: Log | Source, machine: Machine | None) -> Log:
    """Return a log, read where it is only named, which has no axis that the machine lacks."""
    if not isinstance(log, Log):
        return read_log(log, machine=machine)
    require_axes(tuple(log.axes), machine, log.name)
    return log


def calibrate(
    machine: Machine | Source,
    *,
    axes: Sequence[str] = (),
    centre: Sequence[float] = (),
    travel: Sequence[float] = (),
    radius: float | None = None,
    feeds: Sequence[float] = (),
    warm_up: float = WARM_UP,
    without_log: bool = False,
    swing: float | None = None,
    repeats: int | None = None,
    tool: float | None = None,
    size: float | None = None,
    depth: float | None = None,
) -> tuple[Experiment, ...]:
    """Write test programs that show what a machine file should know, by a log or by readings taken by hand.

    Parameters
    ----------
    machine : Machine, str or path
        Its dialect and limits are those of the programs.
    axes : sequence of str, optional
        Axes to move; by default all but Z.
    centre : sequence of float, optional
        Middle of the room in work coordinates, a number an axis [m]; 0 by default.
    travel : sequence of float, optional
        Room around it from end to end [m]: one number, or one an axis; 0.1 by default.
    radius : float, optional
        Radius of the circles [m]; 0.3 of the smallest travel by default.
    feeds : sequence of float, optional
        Feeds of the circles [m/s]; three by default, up to 0.8 of the machine's highest.
    warm_up : float, optional
        Duration of the run that warms the screws [s].
    without_log : bool, optional
        Write the programs for a dial indicator, and with `tool` the test cut for calipers; :func:`measure` takes
        their readings. `feeds` are then the one or two of the dial. The rest is for them alone.
    swing : float, optional
        Way by which the table goes beyond a place and comes back [m]; 0.0005.
    repeats : int, optional
        How often each place is read from either side; 2.
    tool : float, optional
        Diameter of the cutter [m].
    size : float, optional
        Of the circles and squares of the test cut [m]; what the travel allows, up to 0.06.
    depth : float, optional
        Of the test cut [m]; 0.002.

    Returns
    -------
    tuple of Experiment
        The `program` of each, what to `record` with it, and `why`.

    Raises
    ------
    InputError
        Where the machine file is bad, or the room, radius or feeds cannot be had.

    Examples
    --------
    >>> import ph_post as ph
    >>> kit = ph.calibrate("mill", centre=(0.15, 0.08), travel=[0.12])
    >>> kit[0].name, kit[0].why
    ('mix', 'a little of everything in one log: steps, sweeps, speeds, circles and diagonals')
    """
    drives, _ = any_machine(machine)
    by_hand = {"swing": swing, "repeats": repeats, "tool": tool, "size": size, "depth": depth}
    if not without_log:
        if given := [f"--{name}" for name, value in by_hand.items() if value is not None]:
            raise OptionsError(f"{', '.join(given)} needs --without-log")
        return calibration_kit(
            drives, axes=axes, centre=centre, travel=travel, feeds=feeds, radius=radius, warm_up=warm_up
        )
    if radius is not None or warm_up != WARM_UP:
        raise OptionsError("--radius and --warm-up are for programs with a log; got --without-log")
    return gauge_kit(
        drives,
        axes=axes,
        centre=centre,
        travel=travel,
        feeds=feeds,
        swing=swing,
        repeats=repeats,
        tool=tool,
        size=size,
        depth=depth,
    ).programs
