"""Rehearse a program: a real LinuxCNC's commands through the drive model, beside what was planned."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.dialects.declaration import CHANGE_MARK, mark_text
from ph_post.dialects.planners import planner_of
from ph_post.drive.axes import referred_to_middle
from ph_post.files.table import log_content
from ph_post.gcode.program import AXES, PartProgram, runs
from ph_post.progress import Progress, no_progress
from ph_post.rehearse.linuxcnc import TIME_LIMIT, PlannerRecording, run_on_linuxcnc
from ph_post.simulate.assess import backlash_scenarios
from ph_post.simulate.contour import ContourError
from ph_post.simulate.controllers.cut_path import CutPath
from ph_post.simulate.controllers.deviation import (
    FollowedCut,
    ProgramError,
    cut_error,
    follow_cut,
    moving_axes,
    program_error,
)
from ph_post.simulate.controllers.gap_error import program_gap_error
from ph_post.simulate.controllers.moves import tolerances
from ph_post.simulate.controllers.run import run_program
from ph_post.simulate.controllers.unknown import rows_before, unknown_lines
from ph_post.types import Array, BoolArray, Command, Machine, RoundedPath, Scenario, frozen, sealed
from ph_post.version import package_version

OPERATOR: Final = (0, 1, 6, 60)
"""M words that wait for the operator; the wait is not compared."""

NEAR: Final = 0.1
"""Time [s] around a change of the program that counts as its window."""

GRID: Final = 5e-6
"""Speeds are compared at places so far apart [m]."""


JOINT: Final = 1e-6
"""A place that is no farther [m] behind a joint is at it: LinuxCNC's positions are rounded."""


class Execution(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Run of a program on a controller: its commands, and the error of the machine's table.

    `cut` is LinuxCNC's run beside the path, None of the model's.
    """

    command: Command
    error: ProgramError
    cut: FollowedCut | None = None

    @property
    def time(self) -> float:
        """Duration from rest to rest [s]."""
        return float(self.command.t[-1] - self.command.t[0])


class Rehearsal(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Result of rehearsing a `program` on a `machine`: LinuxCNC's run beside the plan's.

    `plan` is the model's run of the program, `real` LinuxCNC's; `before` LinuxCNC's run of the original and
    `backlash` that with LinuxCNC's own compensation of backlash, None where these were not asked for.
    `speed` (rms) and `speed_worst` are differences of the speed along the path from the plan's in the windows,
    relative to the feed there; `windows` is their number. `path` [m] is the largest distance of the commands
    from the path that the program declares, `allowed` [m] the largest that its path mode allows, None where
    that is not bounded. `gaps` are what backlash adds, before and after, and after if it is off by its uncertainty;
    None where the original was not run. `nominal` says whether the path is known from which errors are measured:
    a program made from a path may have shifted it.
    """

    program: PartProgram
    machine: Machine
    plan: Execution
    real: Execution
    before: Execution | None
    backlash: Execution | None
    speed: float
    speed_worst: float
    windows: int
    path: float
    allowed: float | None
    lockstep: bool
    gaps: tuple[ContourError | None, ContourError | None, ContourError | None] = (None, None, None)
    nominal: bool = True

    @property
    def warnings(self) -> tuple[str, ...]:
        """Another controller than LinuxCNC, lines that the plan lacks, and whether the error is not known."""
        name, notes = self.program.name, self.program.notes
        unknown = (
            f"{name}: offsets shift it from the path that it was made from, and so its error is not known; --against"
            " PLAIN with the program of `convert --strategy none` gives it"
        )
        other = (
            f"the machine's controller is {self.machine.dialect}: LinuxCNC has its own speeds in corners and on arcs,"
            " and so errors and times here are not those of that controller"
        )
        said = [] if isinstance(planner_of(self.machine), RoundedPath) else [other]
        said += [f"{name}:{note.first + 1}: {note.what}: run, and not in the plan" for note in notes]
        lost = unknown_lines(self.program)
        if lost:
            said.append(
                f"{name}: errors, path and speed are compared up to line {lost[0][0]}, as far as it is understood"
            )
        return tuple(said) if self.nominal else (*said, unknown)

    def log(self) -> bytes:
        """Return commanded and executed motion as a log (CSV)."""
        remarks = {
            "made by": f"ph-post {package_version()} rehearse",
            "program": f"{self.program.name}, sha256 {self.program.digest}",
            "machine": self.machine.name,
            "units": "s, mm; X_cmd is LinuxCNC's command, X_act the table, X_motor the motor's side",
        }
        return log_content(self.real.error.run, remarks)


def rehearse(
    program: PartProgram,
    machine: Machine,
    *,
    original: PartProgram | None = None,
    nominal: bool = True,
    backlash: bool = False,
    limit: float = TIME_LIMIT,
    progress: Progress = no_progress,
) -> Rehearsal:
    """Run a program on LinuxCNC, and compare what it does with the plan and with the original.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
        With a drive for every axis that the program moves.
    original : PartProgram, optional
        Program that `program` was made from; errors are measured from its path.
    nominal : bool, optional
        Whether the path of the original, or else that of `program`, is the nominal one.
    backlash : bool, optional
        Also run the original with LinuxCNC's own compensation of the machine's lost motion.
    limit : float, optional
        Time on the wall that each run may take [s].
    progress : Progress, optional
        Called with what is being done.

    Raises
    ------
    InputError
        Where LinuxCNC refuses a program.
    NotInstalledError
        Where there is no LinuxCNC.
    """
    target = program if original is None else original

    def execute(which: PartProgram, own: Mapping[str, float]) -> tuple[Execution, PlannerRecording]:
        progress(f"running {which.name} on LinuxCNC" + (" with its own compensation" if own else ""))
        recording = run_on_linuxcnc(which.data, which.name, machine, backlash=own, limit=limit, progress=progress)
        command = _of_motions(_without_waits(command_of(recording, machine), which), which, machine)
        # The controller's own compensation acts while the zero is taken too: it is that of the middle.
        referred = referred_to_middle(machine) if own else machine
        cut = follow_cut(command, referred, target, recorded=True, moved_by=which)
        return Execution(command=command, error=cut_error(cut), cut=cut), recording

    progress("planning")
    planned = run_program(program, machine, RoundedPath())
    plan = Execution(command=planned, error=program_error(planned, machine, target, moved_by=program))
    real, recording = execute(program, {})
    lost = {name: axis.gap.lost_motion for name, axis in machine.axes.items()}
    before = execute(target, {})[0] if original is not None else None
    own = execute(target, lost)[0] if backlash else None
    progress("comparing")
    path, (speed, worst, windows) = _path(program, machine, real.command, planned)
    return Rehearsal(
        program=program,
        machine=machine,
        plan=plan,
        real=real,
        before=before,
        backlash=own,
        speed=speed,
        speed_worst=worst,
        windows=windows,
        path=path,
        allowed=_allowed(program),
        lockstep=recording.lockstep,
        gaps=(None, None, None) if before is None else _gaps(before, real),
        nominal=nominal,
    )


def _gaps(before: Execution, real: Execution) -> tuple[ContourError | None, ContourError | None, ContourError | None]:
    """Return what backlash adds to LinuxCNC's runs of the original and of the program, and at worst to the latter."""

    def added(one: Execution, tried: Sequence[Scenario]) -> ContourError | None:
        return None if one.cut is None or before.cut is None else program_gap_error(one.cut, before.cut, tried)

    own = [added(one, (one.error.run.scenario,)) for one in (before, real)]
    return own[0], own[1], added(real, backlash_scenarios(real.error.scenarios))


def command_of(recording: PlannerRecording, machine: Machine) -> Command:
    """Convert LinuxCNC's commands to its joints into the form of a plan's command."""
    names = tuple(name for name in AXES if name in machine.axes)
    position = recording.motor[:, [AXES.index(name) for name in names]]
    return _command(position, names, recording.period)


def _command(position: Array, names: tuple[str, ...], period: float) -> Command:
    count = len(position)
    steps = np.sqrt((np.diff(position, axis=0, prepend=position[:1]) ** 2).sum(axis=1))
    return Command(
        axes=names,
        period=period,
        t=frozen(np.arange(count) * period),
        segment=np.zeros(count, dtype=np.int64),
        xi=sealed(np.zeros(count)),
        s=frozen(np.cumsum(steps)),
        position=frozen(position),
        feed=frozen(steps / period),
        window=np.full(count, -1, dtype=np.int64),
    )


def _without_waits(command: Command, program: PartProgram) -> Command:
    """Leave out the longest rests, one for every M word that waits for the operator."""
    words = program.words
    waits = int(((words.letter == ord("M")) & np.isin(words.value, OPERATOR)).sum())
    if not waits:
        return command
    begins, ends = runs(command.feed == 0.0)
    longest = np.argsort(begins - ends, kind="stable")[:waits]
    kept = np.ones(command.t.size, dtype=bool)
    for begin, end in zip(begins[longest], ends[longest], strict=True):
        kept[begin:end] = False
    return _command(command.position[kept], command.axes, command.period)


def _of_motions(command: Command, program: PartProgram, machine: Machine) -> Command:
    """Name the program's motion that every row belongs to: approaches are known by it, which do not cut."""
    path = CutPath(program, machine)
    leg, place = path.follow(moving_axes(command))
    # While it rests at a joint it is still at the motion before.
    leg = np.where((place <= path.starts[leg] + JOINT) & (leg > 0), leg - 1, leg)
    return replace(command, segment=path.legs.motion[leg].astype(np.int64))


def _path(
    program: PartProgram, machine: Machine, real: Command, plan: Command
) -> tuple[float, tuple[float, float, int]]:
    """Distance of the real commands from the program's path, and of their speeds from the plan's."""
    path = CutPath(program, machine)
    leg, place = path.follow(real)
    distance = path.command_distance(real, place)
    cuts = (path.legs.rapid[leg] == 0.0) & rows_before(program, path.legs.motion, path.starts, place)
    off = float(distance[cuts].max(initial=0.0))
    return off, _speeds(program, path, (real, place, cuts), (plan, path.follow(plan)[1]))


def _speeds(
    program: PartProgram, path: CutPath, real: tuple[Command, Array, BoolArray], plan: tuple[Command, Array]
) -> tuple[float, float, int]:
    """Compare the speed in the windows with the plan's: rms and largest, by feed, and their number."""
    where = np.arange(0.0, float(path.starts[-1]), GRID)
    leg = np.clip(np.searchsorted(path.starts, where, side="right") - 1, 0, path.legs.length.size - 1)
    changed = _windows(program, path)
    inside = changed[leg] & (path.legs.rapid[leg] == 0.0)
    inside &= rows_before(program, path.legs.motion, path.starts, where)
    if not inside.any():
        return 0.0, 0.0, 0
    off = _speed_at(real[0], real[1], where) - _speed_at(plan[0], plan[1], where)
    share = (off / path.legs.speed[leg])[inside]
    return float(np.sqrt(np.mean(share * share))), float(np.abs(share).max()), runs(inside)[0].size


def _speed_at(command: Command, place: Array, where: Array) -> Array:
    """Speed of a command at places along the program [m/s]."""
    forward = np.maximum.accumulate(place)
    middle = 0.5 * (forward[1:] + forward[:-1])
    moving = np.diff(forward, prepend=-1.0)[1:] > 0.0
    return np.interp(where, middle[moving], command.feed[1:][moving])


def _windows(program: PartProgram, path: CutPath) -> BoolArray:
    """Mask of the legs in and next to changed stretches; all where none is marked."""
    motion = path.legs.motion.astype(np.int64)
    block = program.motions.block[motion]
    changes = changed_blocks(program)
    if not changes.any():
        return np.ones(block.size, dtype=bool)
    marks = changes[block]
    return np.asarray(marks | np.roll(marks, 1) | np.roll(marks, -1))


def changed_blocks(program: PartProgram) -> BoolArray:
    """Mask of the blocks (b,) that stand in place of the original's, by the marks before them."""
    changed = np.zeros(program.blocks, dtype=bool)
    for found in CHANGE_MARK.finditer(program.data):
        line = int(np.searchsorted(program.lines, np.int32(found.start()), side="right")) - 1
        if not changed[line]:
            changed[line + 1 : line + 1 + int(mark_text(found)[0])] = True
    return changed


def _allowed(program: PartProgram) -> float | None:
    """Return the rounding of joints that the program's path modes allow [m]; None where it is not bounded."""
    cuts = program.motions.kind != 0
    found = tolerances(program)[cuts]
    if found.size == 0 or (found == 0.0).any():
        return None
    return float(max(found.max(), 0.0))
