"""Windows of a program: what a plan does at its turning points, told as changes to the program's motions.

Axes behind their loop are not planned here but where a strategy modulates nothing but the feed: their lasting
offsets are :mod:`ph_post.gcode.splice.lasting`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.analysis import Analysis, analyse
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.strategies.base import silent
from ph_post.gcode.options import BLOCK_TIME
from ph_post.gcode.paths.build import line_words
from ph_post.gcode.paths.record import ProgramPath
from ph_post.gcode.reader.record import PartProgram
from ph_post.gcode.splice.record import Dip, Edits, Stop
from ph_post.gcode.splice.standing import blocked_chains, program_troubles
from ph_post.gcode.splice.view import chain_spans
from ph_post.gcode.splice.windowedits import LeftAlone, window_edits
from ph_post.types import Machine, Path, Plan, frozen

OFFSETS: Final = frozenset(("auto", "takeup"))
"""Strategies that give axes behind their loop a lasting offset; all others modulate the feed."""


class WindowPlan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The plan of one path of a program, on the machine it was planned for."""

    path: ProgramPath
    analysis: Analysis
    plan: Plan


class WindowEdits(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What the windows of a program change, and the plans that say why: one a path that was planned."""

    edits: Edits
    plans: tuple[WindowPlan, ...]


def plan_windows(
    program: PartProgram,
    paths: Sequence[ProgramPath],
    machine: Machine,
    options: PlanOptions,
    tolerance: float,
    tell: Callable[[str], None] = silent,
    block_time: float = BLOCK_TIME,
) -> WindowEdits:
    """Plan the windows of a program, and tell them as changes to its motions.

    A full stop of the plan becomes a stop at its turning point, with what axes are shifted out and back; the
    controller ramps to it by itself. A dip becomes blocks of a known time each. Where nothing is modulated,
    nothing is changed. Rapids are left alone.

    Parameters
    ----------
    program : PartProgram
    paths : sequence of ProgramPath
        Of :func:`ph_post.gcode.paths.build.paths_of`.
    machine : Machine
    options : PlanOptions
        The strategy and its bounds. A search is shared out among paths by their length.
    tolerance : float
        ε of the windows [m].
    tell : callable, optional
        Told what a long search is at.
    block_time : float, optional
        Longest block of a dip [s].

    Returns
    -------
    WindowEdits
        `edits.warnings` name what was left alone.
    """
    edits = Edits(offset=frozen(np.zeros((program.motions.kind.size, 3))))
    troubles = program_troubles(program)
    if troubles:
        words = tuple(f"no window of the program is changed: {trouble}" for trouble in troubles)
        return WindowEdits(edits=replace(edits, warnings=words), plans=())
    reasons = _reasons(program)
    wanted = [(one, planned_machine(machine, one.path, options)) for one in paths]
    worth = [(one, drives) for one, drives in wanted if _has_gap(drives, one.path)]
    total = sum(float(one.s[-1]) for one, _ in worth if one.chain not in reasons)
    stops: list[Stop] = []
    dips: list[Dip] = []
    plans: list[WindowPlan] = []
    said: list[str] = []
    for one, drives in worth:
        where = line_words(*program.motions.block[one.motion[[0, -1]]].tolist())
        if one.chain in reasons:
            said.append(f"{where}: windows left alone: {reasons[one.chain]}")
            continue
        chosen = _own_options(options, float(one.s[-1]) / total)
        made = _planned(one, drives, chosen, tolerance, _telling(tell, where))
        found = window_edits(program.motions, one, made.plan, block_time)
        stops += found.stops
        dips += found.dips
        plans.append(made)
        said += [f"{where}: {word}" for word in made.plan.warnings]
        said += [_words(program, made, left) for left in found.left]
    edits = replace(
        edits, stops=tuple(stops), dips=tuple(dips), pulse=_pulses(stops), warnings=tuple(dict.fromkeys(said))
    )
    return WindowEdits(edits=edits, plans=tuple(plans))


def _telling(tell: Callable[[str], None], where: str) -> Callable[[str], None]:
    return lambda text: tell(f"{where}: {text}")


def planned_machine(machine: Machine, path: Path, options: PlanOptions) -> Machine:
    """Return the machine to plan windows for.

    Where lasting offsets take care of the axes behind their loop, those of the path have no gap any more.
    """
    if options.feed_only or options.strategy not in OFFSETS:
        return machine
    axes = {
        name: axis if axis.feedback == "load" or name not in path.axes
        else replace(axis, gap=replace(axis.gap, lost_motion=0.0))
        for name, axis in machine.axes.items()
    }  # fmt: skip
    return replace(machine, axes=axes)


def _has_gap(machine: Machine, path: Path) -> bool:
    return any(machine.axes[name].gap.lost_motion > 0.0 for name in path.axes)


def _own_options(options: PlanOptions, share: float) -> PlanOptions:
    """Options for one path: begun and ended at rest, and searched with its share of the effort."""
    return replace(
        options, carrier="program", start="rest", inverse_dynamics=False, effort=options.effort * share
    )


def _planned(
    path: ProgramPath, machine: Machine, options: PlanOptions, tolerance: float, tell: Callable[[str], None]
) -> WindowPlan:
    tell("locating turning points, windows and backlash intervals")
    analysis = analyse(path.path, machine, tolerance)
    tell("planning")
    return WindowPlan(path=path, analysis=analysis, plan=make_plan(analysis, options, tell))


def _reasons(program: PartProgram) -> dict[int, str]:
    """Why chains cannot be changed, by their number."""
    low, _ = chain_spans(program.motions)
    number = program.motions.chain[low]
    return {
        int(number[k]): why for why, marks in blocked_chains(program).items() for k in np.flatnonzero(marks)
    }


def _pulses(stops: Sequence[Stop]) -> Mapping[str, float]:
    """Largest shift of each axis."""
    largest: dict[str, float] = {}
    for stop in stops:
        for shift in stop.shifts:
            largest[shift.axis] = max(largest.get(shift.axis, 0.0), abs(shift.travel))
    return largest


def _words(program: PartProgram, made: WindowPlan, left: LeftAlone) -> str:
    points = [made.plan.turning_points[k] for k in made.plan.windows[left.window].members]
    axes = " and ".join(dict.fromkeys(point.axis for point in points))
    return f"line {program.motions.block[left.motion] + 1}: {axes} turns: left alone: {left.why}"
