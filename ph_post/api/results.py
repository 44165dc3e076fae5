"""Results of the functions of :mod:`ph_post`; what costs a simulation is worked out when it is first asked for."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Collection, Iterable, Sequence
from functools import cached_property
from typing import Final, NamedTuple

import msgspec
import numpy as np

from ph_post.analysis.path_analysis import Analysis
from ph_post.bounds import LONGEST_SIMULATED
from ph_post.compensate.comparison import strategy_at
from ph_post.compensate.offsets import command_of, plan_time
from ph_post.compensate.standstill import Standstill, standstills
from ph_post.compensate.strategies.registry import PLAIN
from ph_post.drive.axes import has_backlash
from ph_post.gcode.program import PartProgram
from ph_post.geometry.numeric import runs
from ph_post.geometry.piecewise import MEETS
from ph_post.geometry.track import Track
from ph_post.progress import Progress, no_progress
from ph_post.simulate.assess import Assessment, assess, backlash_scenarios, gap_error
from ph_post.simulate.contour import ContourError, Nominal
from ph_post.simulate.controllers.deviation import (
    FollowedCut,
    ProgramError,
    cut_error,
    follow_cut,
    left_of_path,
)
from ph_post.simulate.controllers.gap_error import program_gap_error
from ph_post.simulate.controllers.run import PlannedRun
from ph_post.types import Array, Command, Machine, Plan, Scenario


class ReversalCount(NamedTuple):
    """Numbers of compensated reversals and of all."""

    compensated: int
    all: int


class AxisReversals(msgspec.Struct, frozen=True, kw_only=True):
    """Numbers of reversals of one axis with backlash.

    `cut` counts those that are not compensated and behind which the tool cuts.
    """

    axis: str
    compensated: int
    all: int
    cut: int

    def with_more(self, other: AxisReversals) -> AxisReversals:
        """Return the numbers of these and of others of the axis."""
        compensated, every = self.compensated + other.compensated, self.all + other.all
        return AxisReversals(axis=self.axis, compensated=compensated, all=every, cut=self.cut + other.cut)


def count_reversals(found: Iterable[tuple[str, bool, bool]], machine: Machine) -> tuple[AxisReversals, ...]:
    """Count reversals by axis, those of axes without backlash left out.

    Parameters
    ----------
    found : iterable of (str, bool, bool)
        The axis that reverses, whether it is compensated, and whether the tool cuts behind it.
    machine : Machine
    """
    rows: dict[str, list[tuple[bool, bool]]] = {}
    for axis, done, cuts in found:
        if has_backlash(machine.axes[axis]):
            rows.setdefault(axis, []).append((done, cuts))
    return tuple(
        AxisReversals(
            axis=axis,
            compensated=sum(done for done, _ in one),
            all=len(one),
            cut=sum(cuts and not done for done, cuts in one),
        )
        for axis, one in sorted(rows.items())
    )


def plan_reversals(track: Track, plan: Plan, done: Collection[int] | None = None) -> tuple[AxisReversals, ...]:
    """Count the reversals of a plan by axis; none is at the rest with which a motion begins or ends.

    Parameters
    ----------
    track : Track
        That of its path.
    plan : Plan
    done : collection of int, optional
        Numbers of the turning points that are compensated, in place of those of the plan.
    """
    rests = bool(plan.phases) and plan.phases[0].speed[0] == 0.0
    points = [one for one in plan.turning_points if not rests or MEETS < one.s < track.length - MEETS]
    behind = np.array([point.s for point in points]) + MEETS
    behind = np.where(behind > track.length, behind - track.length if track.closed else track.length, behind)
    segments = track.segment[track.locate(behind)[0]].tolist()
    cuts = [not plan.path.segments[segment].rapid for segment in segments]
    if done is None:
        done = {point.index for point in points if strategy_at(plan, point) != PLAIN}
    rows = ((point.axis, point.index in done, cut) for point, cut in zip(points, cuts, strict=True))
    return count_reversals(rows, plan.machine)


AXES_WITH_SIDES: Final = 2
"""A path of so many axes has a left and a right."""


def _largest_sides(left: Array) -> tuple[float, float]:
    return float(max(left.max(initial=0.0), 0.0)), float(max(-left.min(initial=0.0), 0.0))


class AssessedMotion:
    """A motion with its errors on every machine that the file leaves possible."""

    __slots__ = ()

    @property
    @abstractmethod
    def assessment(self) -> Assessment | ProgramError | None:
        """Result of the motion on every machine that the file leaves possible; None where it is not simulated."""

    @property
    def error(self) -> ContourError | None:
        """Contour error at the values of the machine file, by all causes [m]."""
        return None if self.assessment is None else self.assessment.error

    @property
    def error_worst(self) -> ContourError | None:
        """Contour error by all causes on the worst machine that the file leaves possible [m]."""
        return None if self.assessment is None else self.assessment.error_worst


class MotionResult(AssessedMotion, ABC):
    """A motion of the machine, before or after compensation: its time, and how far it leaves the path.

    An error has the largest value `max` and the root mean square `rms` [m], and is None where the motion is
    over before its error counts. Errors are simulated when they are first asked for.
    """

    @property
    @abstractmethod
    def time(self) -> float:
        """Duration of the motion [s]."""

    @property
    @abstractmethod
    def error_gap(self) -> ContourError | None:
        """Contour error that backlash causes: what it adds to the same run without any [m]."""

    @property
    @abstractmethod
    def error_gap_worst(self) -> ContourError | None:
        """Largest contour error that backlash causes if it is off by its uncertainty [m]."""

    @property
    def sides(self) -> tuple[float, float] | None:
        """Largest distance of the table to the left and to the right of the path [m], by all causes.

        Seen along the path, in the run to which `error` belongs; None where an error has no side, or none counts.
        """
        return None

    @property
    def standstills(self) -> tuple[Standstill, ...]:
        """Places at which the tool stands or creeps on the contour of a path, and how long [m, s]."""
        return ()

    def __repr__(self) -> str:
        return f"{type(self).__name__}(time={self.time:.6g})"


class PlannedMotion(MotionResult):
    """The motion of a plan along its path.

    Parameters
    ----------
    analysis : Analysis
    plan : Plan
    """

    def __init__(self, analysis: Analysis, plan: Plan) -> None:
        self.analysis, self.plan = analysis, plan

    @property
    def time(self) -> float:
        """Duration of the motion [s]."""
        return plan_time(self.plan)

    @cached_property
    def standstills(self) -> tuple[Standstill, ...]:
        """Places at which the tool stands or creeps, below 2 % of the feed, and how long [m, s]."""
        return standstills(self.plan, self.analysis.track)

    @cached_property
    def command(self) -> Command:
        """Command of the axes in every servo period."""
        return command_of(self.plan, self.analysis.track, self.plan.machine.servo_period)

    @cached_property
    def assessment(self) -> Assessment:
        """Result of the motion on every machine that the file leaves possible."""
        nominal = Nominal(self.analysis.track)
        return assess(self.command, self.plan.machine, nominal, self.analysis.turning_points)

    @cached_property
    def error_gap(self) -> ContourError | None:
        """Contour error that backlash causes at the values of the machine file [m]."""
        if self._plain is self.command:
            return self.assessment.error_gap
        return self._gap_error((self.assessment.run.scenario,))

    @cached_property
    def error_gap_worst(self) -> ContourError | None:
        """Largest contour error that backlash causes if it is off by its uncertainty [m]."""
        return self._gap_error(backlash_scenarios(self.assessment.scenarios))

    @cached_property
    def sides(self) -> tuple[float, float] | None:
        """Largest distance to the left and to the right of the path [m]; None in space."""
        found = self.assessment
        if found.error is None or len(found.run.axes) != AXES_WITH_SIDES:
            return None
        return _largest_sides(found.nearest.error[found.first :])

    def _gap_error(self, tried: Sequence[Scenario]) -> ContourError | None:
        return gap_error(self.command, self.plan.machine, Nominal(self.analysis.track), tried, self._plain)

    @cached_property
    def _plain(self) -> Command:
        """The same rows without the crossings of the gap."""
        if not (self.plan.crossings or any(self.plan.bias.values())):
            return self.command
        plan = msgspec.structs.replace(self.plan, crossings=(), bias={})
        return command_of(plan, self.analysis.track, self.plan.machine.servo_period)


class ProgramMotion(MotionResult):
    """The motion of a part program on a model of its controller, measured against the path of the original.

    Parameters
    ----------
    program, original : PartProgram
    machine : Machine
    name : str
        Name of the motion, for the progress.
    progress : callable, optional
    plain : ProgramMotion, optional
        The motion of the original; left out where it is this one.
    led : bool, optional
        True where the lead of the servos is in the program: `plain` is then the motion of the same program without what
        crosses backlash, None where that is not known, and with it what backlash adds.
    """

    def __init__(
        self,
        program: PartProgram,
        original: PartProgram,
        machine: Machine,
        name: str,
        progress: Progress = no_progress,
        plain: ProgramMotion | None = None,
        *,
        led: bool = False,
    ) -> None:
        self.program, self.original, self.machine = program, original, machine
        self._name, self._progress = name, progress
        self._plain = self if plain is None else plain
        self._led, self._known = led, not led or plain is not None
        self._planned: PlannedRun | None = None

    @cached_property
    def time(self) -> float:
        """Duration of the motion, from rest to rest [s]."""
        planned = self._take_plan(LONGEST_SIMULATED)
        found = planned.time
        if found is None or found <= LONGEST_SIMULATED:
            self._planned = planned
        if found is not None:
            return found
        duration = float(self.command.t[-1])
        if duration > LONGEST_SIMULATED:
            del self.command  # nobody asks for its rows
        return duration

    @cached_property
    def command(self) -> Command:
        """Command of the controller in every servo period."""
        return self._take_plan().command(meet_turns=True)

    def _take_plan(self, longest: float = math.inf) -> PlannedRun:
        """Return the plan, which is kept only until there are rows: it is as large as the program.

        No more of it than its time takes where the motion takes longer [s]: nobody asks for its rows.
        """
        planned, self._planned = self._planned, None
        if planned is None:
            self._progress(f"running the {self._name} on a model of the controller")
            planned = PlannedRun(self.program, self.machine, longest=longest)
            self.program.source.let_go()
        return planned

    @cached_property
    def cut(self) -> FollowedCut:
        """The command beside the original's path."""
        return follow_cut(self.command, self.machine, self.original, moved_by=self.program)

    @cached_property
    def assessment(self) -> ProgramError | None:
        """Error of the motion on every machine that the file leaves possible.

        None where the program runs longer than `LONGEST_SIMULATED`.
        """
        if self.time > LONGEST_SIMULATED:
            return None
        return cut_error(self.cut)

    @cached_property
    def error_gap(self) -> ContourError | None:
        """Contour error that backlash causes at the values of the machine file [m]."""
        if self.assessment is None or not self._known:
            return None
        return self._gap_error((self.assessment.run.scenario,))

    @cached_property
    def error_gap_worst(self) -> ContourError | None:
        """Largest contour error that backlash causes if it is off by its uncertainty [m]."""
        if self.assessment is None or not self._known:
            return None
        return self._gap_error(backlash_scenarios(self.assessment.scenarios))

    @cached_property
    def sides(self) -> tuple[float, float] | None:
        """Largest distance to the left and to the right of the path [m], in the plane in force."""
        found = self.assessment
        if found is None or found.error is None:
            return None
        return _largest_sides(left_of_path(found, self.cut.path, self.original)[found.counted])

    @cached_property
    def uncounted_lines(self) -> tuple[tuple[int, int], ...]:
        """First and last lines (from 0) of cuts without a known error: places or sides of axes are not known there."""
        if self.assessment is None:
            return ()
        block = self.original.motions.block
        return tuple((int(block[run[0]]), int(block[run[-1]])) for run in runs(self.cut.unknown))

    def last_motion_off(self, size: float) -> int:
        """Return the last motion of the original with a larger error [m], at the machine file's values; -1 for none."""
        found = self.assessment
        rows = np.zeros(0, np.int64) if found is None else np.flatnonzero(found.counted & (found.distance > size))
        return -1 if found is None or not rows.size else int(found.motion[rows].max())

    def error_gap_behind(self, motion: int) -> ContourError | None:
        """Return the contour error that backlash causes behind a motion of the original [m]; None where none is cut."""
        if self.assessment is None or not self._known:
            return None
        return self._gap_error((self.assessment.run.scenario,), motion)

    def _gap_error(self, tried: Sequence[Scenario], behind: int = -1) -> ContourError | None:
        return program_gap_error(self.cut, self._plain.cut, tried, led=self._led, behind=behind)
