"""Simulated motions: the motion of a plan or of an interpolator table, with its warnings."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import PurePath
from typing import Any

import click
import msgspec
from msgspec.structs import replace

from ph_post.analysis.path_analysis import Analysis
from ph_post.cli.job import effect_warnings, load_and_analyse, plan_options
from ph_post.compensate.comparison import describe_violation
from ph_post.compensate.offsets import command_of
from ph_post.compensate.plan import make_plan
from ph_post.compensate.violations import Violation, check_command
from ph_post.drive.axes import check_axes
from ph_post.drive.machinefile import read_machine
from ph_post.files.table import FORMATS, log_content, read_table, require_path
from ph_post.post.remarks import package_version
from ph_post.progress import Progress
from ph_post.report import simulations
from ph_post.simulate.assess import Assessment, assess, scenarios
from ph_post.simulate.contour import Nominal, settling_time
from ph_post.simulate.machine import simulate
from ph_post.types import Command, Flank, Machine, Pickup, Run, TurningPoint


class SimulationJob(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A command, the machine it runs on, and the path it belongs to, None where that is not known."""

    name: str
    command: Command
    machine: Machine
    analysis: Analysis | None
    warnings: tuple[str, ...] = ()

    @property
    def turning_points(self) -> tuple[TurningPoint, ...]:
        """Turning points of the path, none where it is not known."""
        return () if self.analysis is None else self.analysis.turning_points

    def on(self, pickup: Pickup | None, flank: Flank | None) -> SimulationJob:
        """Put a pick-up rule and a first flank, where given, in place of those of every axis."""
        axes = {}
        for name, axis in self.machine.axes.items():
            gap = replace(axis.gap, pickup=pickup or axis.gap.pickup, initial_flank=flank or axis.gap.initial_flank)
            axes[name] = replace(axis, gap=gap)
        return replace(self, machine=replace(self.machine, axes=axes))


def is_table(source: str) -> bool:
    """Tell an interpolator table from a path file, by its name."""
    return PurePath(source).suffix.lower() in FORMATS


def motion_of(
    source: str, machine: str, path_file: str | None, how: Mapping[str, Any], progress: Progress
) -> SimulationJob:
    """Read or plan what is to be simulated, with a warning for whatever the simulation will not show.

    Raises
    ------
    InputError
        For bad files, or a table of another path or of axes that path or machine do not have.
    """
    if is_table(source):
        motion = _of_table(source, machine, path_file, how, progress)
    else:
        motion = _of_path(source, machine, how, progress)
    return replace(motion, warnings=(*motion.warnings, *_caveats(motion.command, motion.machine)))


def _of_path(source: str, machine: str, how: Mapping[str, Any], progress: Progress) -> SimulationJob:
    analysis = load_and_analyse(source, machine, how["tolerance"], progress, feed=how["feed"], dialect=how["dialect"])
    progress("planning the feed")
    plan = make_plan(analysis, plan_options(how, how["carrier"]), progress)
    command = command_of(plan, analysis.track, plan.machine.servo_period)
    name = f"{analysis.path.name}, strategy {plan.strategy}"
    return SimulationJob(name=name, command=command, machine=plan.machine, analysis=analysis, warnings=plan.warnings)


def _of_table(
    source: str, machine: str, path_file: str | None, how: Mapping[str, Any], progress: Progress
) -> SimulationJob:
    progress("reading")
    command = read_table(source)
    name = PurePath(source).name
    if path_file is None:
        drives = read_machine(machine)
        check_axes(command.axes, "table", drives, machine)
        warning = "without --path the path is not known, and so no contour error"
        return SimulationJob(name=name, command=command, machine=drives, analysis=None, warnings=(warning,))
    analysis = load_and_analyse(
        path_file, machine, how["tolerance"], progress, feed=how["feed"], dialect=how["dialect"]
    )
    command = require_path(command, analysis.track, source)
    return SimulationJob(name=name, command=command, machine=drives_of(analysis), analysis=analysis)


def drives_of(analysis: Analysis) -> Machine:
    """Return the machine of an analysis that has one."""
    assert analysis.machine is not None
    return analysis.machine


def _caveats(command: Command, machine: Machine) -> Iterator[str]:
    """Say which effects do not act, and which limits the command breaks, the worst place of each."""
    yield from effect_warnings(machine, command.axes)
    worst: dict[tuple[str, str], Violation] = {}
    for broken in check_command(command, machine):
        known = worst.get((broken.axis, broken.quantity))
        if known is None or broken.value > known.value:
            worst[broken.axis, broken.quantity] = broken
    yield from (f"the command {describe_violation(broken)}" for broken in worst.values())


def run_motion(motion: SimulationJob) -> tuple[SimulationJob, Run, Assessment | None]:
    """Simulate a motion: the run that is told, and how far it leaves the path where that is known.

    The motion gets a warning where it is over before its error counts.
    """
    command, machine = motion.command, motion.machine
    if motion.analysis is None:
        return motion, simulate(command, machine, scenarios(machine, command.axes)[0]), None
    found = assess(command, machine, Nominal(motion.analysis.track), motion.turning_points)
    if found.error is None:
        seconds = settling_time(machine, command.axes)
        warning = f"the motion is over before its contour error counts, {seconds:.3g} s after its start"
        motion = replace(motion, warnings=(*motion.warnings, warning))
    return motion, found.run, found


def log_of(motion: SimulationJob, run: Run) -> bytes:
    """Return the log of a run, with what it is a log of."""
    digest = f", sha256 {motion.machine.digest}" if motion.machine.digest else ""
    remarks = {
        "made by": f"ph-post {package_version()} simulate",
        "motion": motion.name,
        "machine": motion.machine.name + digest,
        "assumed": simulations.scenario_words(run.scenario),
        "units": "s, mm; X_act is the table, X_motor the motor in units of the table",
    }
    if motion.analysis is not None:
        remarks["path"] = f"{motion.analysis.path.name}, sha256 {motion.analysis.path.digest}"
    return log_content(run, remarks)


def print_run(motion: SimulationJob, run: Run, assessment: Assessment | None) -> None:
    """Print what a machinist asks first: how far off, how much of it is the gap, and where."""
    click.echo(f"{motion.name} on {motion.machine.name}: {run.t[-1]:.3f} s, {run.t.size} samples")
    if assessment is not None:
        click.echo(simulations.error_table(assessment))
        if motion.turning_points:
            side = " (+ is left of the direction of travel)" if len(run.axes) == 2 else ""
            click.echo(f"around the turning points{side}:")
            click.echo(simulations.turning_table(assessment, motion.turning_points))
    for line in simulations.event_words(run.events):
        click.echo(line)
