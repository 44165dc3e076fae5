"""Deviation of a command from the path of a program, on every machine that a machine file leaves possible."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.gcode.program import AXES, PartProgram, plane_columns
from ph_post.simulate.assess import AlikeRows, decisive, resting_axes, run_scenarios, scenarios
from ph_post.simulate.contour import ContourError, contour_error, settling_time
from ph_post.simulate.controllers.counterparts import Counterparts
from ph_post.simulate.controllers.cut_path import CutPath
from ph_post.simulate.controllers.moves import moved_axes
from ph_post.simulate.controllers.unknown import known_rows, rows_before, unknown_motions
from ph_post.simulate.machine import Runs
from ph_post.types import Array, BoolArray, Command, IntArray, Machine, Run, Scenario


class ProgramError(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Deviation of a command from the path of a program while the tool cuts, as `assess` measures it on a path.

    `errors` one a scenario, None where nothing is cut. `error` the largest at the file's values, with its
    `run` and, a row each, the `distance` of the table from the path [m] and whether it is `counted`: rapids
    are not, nor is the beginning, for five servo time constants, nor what follows lines that were passed
    through until the places and sides of the axes are known. `error_worst` is the largest of all, in the
    scenario `worst`. `motion` is the number of the program's motion that every row belongs to, `place` how
    far along the program [m].
    """

    scenarios: tuple[Scenario, ...]
    errors: tuple[ContourError | None, ...]
    error: ContourError | None
    error_worst: ContourError | None
    worst: Scenario
    run: Run
    distance: Array
    counted: BoolArray
    motion: IntArray
    place: Array


class FollowedCut(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A command beside the path of a program: where it is in every row, and whether the error counts there.

    `command` has the axes that move. `motion` is the number of the program's motion that every row belongs to,
    `place` how far along the program [m], `counted` the rows of :class:`ProgramError`. `unknown` are motions that cut,
    of which most is not counted, as the places or sides of the axes are not known. `known` is what the motions
    stand for that its `segment` numbers, None where it numbers none, or that is not known. `runs` are those of
    the command, `distances` those of their tables from the path, and `errors` what was found of them.
    """

    command: Command
    machine: Machine
    path: CutPath
    motion: IntArray
    place: Array
    counted: BoolArray
    unknown: IntArray
    known: Counterparts | None = None
    runs: Runs
    distances: AlikeRows
    errors: dict[Scenario, ContourError | None] = {}

    def counted_distances(self, scenario: Scenario) -> Array:
        """Run a machine, and return the distance of its table from the path in the rows that count [m]."""
        found = self.distances.errors(self.runs.tables(scenario))[self.counted]
        self.errors[scenario] = contour_error(found)
        return found

    def error(self, scenario: Scenario) -> ContourError | None:
        """Return the error in a scenario, None where nothing is cut; found once, whatever was asked for first."""
        if scenario not in self.errors:
            self.counted_distances(scenario)
        return self.errors[scenario]

    def simulate(self, scenario: Scenario) -> tuple[Run, Array]:
        """Run a machine, and return the distance of its table from the path in every row [m]."""
        return self.runs.of(scenario), self.distances.errors(self.runs.tables(scenario))

    def forget(self) -> None:
        """Let go of what later scenarios would be compared with, where that takes much."""
        self.runs.forget()
        self.distances.forget()

    def scenarios(self) -> tuple[Scenario, ...]:
        """Return what the machine file leaves open."""
        return scenarios(self.machine, self.command.axes, resting_axes(self.command))


def follow_cut(
    command: Command,
    machine: Machine,
    program: PartProgram,
    *,
    recorded: bool = False,
    moved_by: PartProgram | None = None,
) -> FollowedCut:
    """Follow a command along the path of a program; parameters as of :func:`program_error`."""
    # An axis that is sent to where the model's happens to stand already came there by nobody knows which way.
    command = moving_axes(command, moved_axes(program))
    path = CutPath(program, machine)
    known = None if moved_by is None else path.counterparts(moved_by, command)
    leg, place = path.follow(command, known)
    motion, cuts = path.legs.motion[leg].astype(np.int64), path.cuts(leg, place, command, moved_by)
    counted = cuts & (command.t >= settling_time(machine, command.axes))
    sure = known_rows(program, motion, command.position, cuts, path.gaps(command))
    counted &= sure
    if recorded:
        counted &= rows_before(program, path.legs.motion, path.starts, place)
    reach = path.reach(command.axes, command.position, command.period)
    return FollowedCut(
        command=command,
        machine=machine,
        path=path,
        motion=motion,
        place=place,
        counted=counted,
        unknown=_unknown_cuts(path.works & unknown_motions(program), motion[cuts], sure[cuts]),
        known=known,
        runs=Runs(command, machine),
        distances=AlikeRows(lambda table, rows: path.closest_to(command.axes, table, place[rows], reach[rows])[0]),
    )


def _unknown_cuts(lost: BoolArray, motion: IntArray, sure: BoolArray) -> IntArray:
    """Return motions that cut and are `lost` (m,), or of whose rows (n,) most are not `sure` (n,)."""
    if not sure.all():
        unsure, rows = (np.bincount(one, minlength=lost.size) for one in (motion[~sure], motion))
        lost = lost | (2 * unsure > rows)
    return np.flatnonzero(lost)


def program_error(
    command: Command,
    machine: Machine,
    program: PartProgram,
    *,
    recorded: bool = False,
    moved_by: PartProgram | None = None,
) -> ProgramError:
    """Simulate a command in every scenario, and measure how far the table leaves a program's path.

    Parameters
    ----------
    command : Command
        Of this program as it is, or compensated; from a model or a real controller.
    machine : Machine
    program : PartProgram
        The program that says where the path is.
    recorded : bool, optional
        Whether it is of a real controller, which also runs what is not understood: only what is before that counts.
    moved_by : PartProgram, optional
        The program that made the command, where its `segment` numbers the motions of that.

    Returns
    -------
    ProgramError
    """
    return cut_error(follow_cut(command, machine, program, recorded=recorded, moved_by=moved_by))


def cut_error(cut: FollowedCut, tried: Sequence[Scenario] = ()) -> ProgramError:
    """Measure as :func:`program_error`, along a path that was followed already; `tried` are other scenarios."""
    tried = tuple(tried) or cut.scenarios()
    errors = run_scenarios(cut.error, tried)
    decides, worst = decisive(errors, tried)
    run, distance = cut.simulate(tried[decides])
    return ProgramError(
        scenarios=tried,
        errors=errors,
        error=errors[decides],
        error_worst=errors[worst],
        worst=tried[worst],
        run=run,
        distance=distance,
        counted=cut.counted,
        motion=cut.motion,
        place=cut.place,
    )


ALONG: Final = 1e-6
"""Distance [m] of the two places by which a path's direction is read off."""

UPRIGHT: Final = 0.01
"""Part of its length below which the way of a path in its plane has no side."""


def left_of_path(found: ProgramError, path: CutPath, program: PartProgram) -> Array:
    """Return how far the table is to the left of the path in every row [m], to the right of it below 0.

    Left is seen along the path in the plane in force (G17 to G19), as G41 has it; moves out of the plane have no side.

    Parameters
    ----------
    found : ProgramError
    path : CutPath
    program : PartProgram
        The program that says where the path is.
    """
    _, place = path.closest_points(found.run, found.place)
    executed = np.zeros((place.size, len(AXES)))
    foot = path.points(place)
    # The way is that of the command's own place: the point nearest to the table may lie on a move beside it.
    way = path.points(found.place + ALONG) - path.points(found.place - ALONG)
    for axis, name in enumerate(AXES):
        own = name in found.run.axes
        executed[:, axis] = found.run.executed[:, found.run.axes.index(name)] if own else foot[:, axis]
    rows, columns = np.arange(place.size), plane_columns(program.motions.plane[found.motion])
    (off_a, off_b), (way_a, way_b) = (
        [vectors[rows, columns[:, k]] for k in (0, 1)] for vectors in (executed - foot, way)
    )
    length = np.hypot(way_a, way_b)
    sided = length > UPRIGHT * ALONG
    return np.asarray(np.where(sided, way_a * off_b - way_b * off_a, 0.0) / np.where(sided, length, 1.0))


def moving_axes(command: Command, sent: Collection[str] = ()) -> Command:
    """Leave out the axes that stand still all the time and are not `sent` anywhere; at least one stays."""
    ways = np.ptp(command.position, axis=0)
    moves = [number for number, name in enumerate(command.axes) if name in sent or ways[number] > 0.0] or [0]
    if len(moves) == len(command.axes):
        return command
    axes = tuple(command.axes[number] for number in moves)
    return replace(command, axes=axes, position=np.ascontiguousarray(command.position[:, moves]))
