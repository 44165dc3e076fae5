"""Write the lead of the servos into a part program: chords of a table's command in place of the program's cuts.

A table leads the path by what the servos lag behind it (:mod:`ph_post.compensate.offsets`). Here the same command, with
all that its plan adds to the path, is cut into chords, and these replace the lines of the cut, from rest to rest. The
lead counts on the time at which the controller goes along them: it holds at 100 % feed override.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.analysis.path_analysis import Analysis, analyse
from ph_post.api.results import ProgramMotion
from ph_post.compensate.friction import gentlest_approach
from ph_post.compensate.offsets import APPROACH_FEED, LOST_MOTIONS, command_of, lead_in, make_jog, may_shift
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.dialects.base import Dialect
from ph_post.edit.lead_edits import Approach, LeadStretch, why_not_led
from ph_post.edit.preconditions import why_blocked, why_not_editable
from ph_post.edit.reversals import section_spans
from ph_post.edit.window_plans import WindowPlan
from ph_post.errors import InputError, PhPostError
from ph_post.files.check import in_words
from ph_post.gcode.paths import ProgramPath, paths_of
from ph_post.gcode.program import AXES, LINE, RAPID, PartProgram, feed_runs
from ph_post.geometry.piecewise import MEETS
from ph_post.geometry.track import Track
from ph_post.progress import Progress, no_progress, prefixed
from ph_post.simulate.assess import is_nominal, run_scenarios
from ph_post.simulate.contour import ContourError
from ph_post.types import Array, IntArray, Machine, Plan, Scenario
from ph_post.units import MICROMETRE

OVERRIDES: Final = (0.5, 1.0, 1.2)
"""Feed overrides at which what the lead does is simulated."""

CHORD_BLOCKS: Final = 4.0
"""Longest duration of a chord, in durations of the blocks of ramps and dips."""

REST: Final = 8.0
"""How long the path rests before it is led, in units of the servo's √b: a lag of the approach falls to some 0.3 %."""

SHARE: Final = 0.5
"""Part of the time allowed that these rests may take; where they take more there are none."""


class OverrideError(msgspec.Struct, frozen=True, kw_only=True):
    """Contour error of a program at a feed override, by all causes, for the worst initial sides [m].

    `override` is a factor on the F words; `before` is that of the original, `after` that of the led program.
    """

    override: float
    before: ContourError
    after: ContourError


class LeadPlan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Stretches of a program with the lead, the plans that they are from, and words about what is not led.

    `free` are the stretches without what crosses backlash, and `reach` [m] is how far the command leaves the path at
    most.
    """

    stretches: tuple[LeadStretch, ...]
    free: tuple[LeadStretch, ...]
    plans: tuple[WindowPlan, ...]
    warnings: tuple[str, ...]
    reach: float = 0.0

    @property
    def holds(self) -> str:
        """Return what whoever runs the program has to know."""
        first = {one.first for one in self.stretches}
        leads = any(one.plan.inverse_dynamics for one in self.plans if int(one.path.motion[0]) in first)
        return HOLDS if leads else CHORDS_HOLD

    def leaving(self, sections: frozenset[int], low: IntArray) -> LeadPlan:
        """Return the plan without the stretches of some sections, which begin at the motions `low`."""
        kept, free = (
            tuple(one for one in some if int(np.searchsorted(low, one.first, side="right")) - 1 not in sections)
            for some in (self.stretches, self.free)
        )
        return replace(self, stretches=kept, free=free)


def require_lead(machine: Machine, dialect: Dialect, axes: Sequence[str]) -> None:
    """Refuse a lead that a controller cannot take, or that the machine file does not give.

    Raises
    ------
    InputError
    """
    option = "--lead-program"
    foreign = dialect.language.read is not None and dialect.language.name
    if foreign:
        raise InputError(
            option,
            f"programs of {dialect.name} cannot take a lead: chords are written in words of RS274 alone",
            expected="--table, or a dialect of RS274",
            got=dialect.name,
        )
    lags = [name for name in axes if machine.axes[name].servo.b > 0.0 or machine.axes[name].servo.c > 0.0]
    if not lags:
        names = in_words(axes)
        raise InputError(
            option,
            f"the machine file gives {names} no lag that could be led",
            expected="b and c of the axes, as `ph-post identify` measures them",
            got="b = c = 0",
        )


def plan_lead(
    program: PartProgram,
    machine: Machine,
    options: PlanOptions,
    tolerance: float,
    time: float,
    path: tuple[ProgramPath, Analysis] | None = None,
    progress: Progress = no_progress,
) -> LeadPlan:
    """Plan the cuts of a program as tables are planned, with the lead.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    options : PlanOptions
        Effort is shared out among the paths of the program by their lengths.
    tolerance : float
        ε of the windows [m].
    time : float
        That of the program [s], 0 where it is not known.
    path : ProgramPath and Analysis, optional
        Path of which the program was made.
    progress : callable, optional

    Returns
    -------
    LeadPlan
    """
    troubles = why_not_editable(program)
    if troubles:
        return LeadPlan(stretches=(), free=(), plans=(), warnings=tuple(f"not led: {trouble}" for trouble in troubles))
    paths = [path[0]] if path is not None else list(paths_of(program))
    wanted, said = _wanted(program, paths)
    count = sum(1 if _after_rapid(program, int(one.motion[0])) is None else 2 for one in wanted)
    pause = REST * max((machine.axes[name].servo.b for one in paths for name in one.path.axes), default=0.0) ** 0.5
    cost = count * pause
    pause = pause if cost <= SHARE * options.max_slowdown * time else 0.0
    spare = cost / time if pause > 0.0 else 0.0
    whole = sum(float(one.s[-1]) for one in wanted)
    found = LeadPlan(stretches=(), free=(), plans=(), warnings=())
    for one in wanted:
        where = program.line_words(*program.motions.block[one.motion[[0, -1]]].tolist())
        report = prefixed(progress, where)
        own = replace(
            options,
            start="rest",
            carrier="table",
            inverse_dynamics=True,
            allow_retrograde=False,
            pushes_first=False,
            effort=options.effort * float(one.s[-1]) / whole,
            max_slowdown=max(options.max_slowdown - spare, 0.0),
        )
        analysis = path[1] if path is not None and one is path[0] else analyse(one.path, machine, tolerance)
        report("planning")
        try:
            plan = make_plan(analysis, own, report)
        except PhPostError as error:
            said.append(f"{where} not led: {error}")
            continue
        if not plan.inverse_dynamics:
            changes = plan.crossings or any(plan.bias.values()) or plan.phases != plan.nominal
            said.append(f"{where}: {NO_LEAD if changes else NOTHING_LED}")
            if not changes:
                continue
        made = WindowPlan(path=one, analysis=analysis, plan=plan)
        words = (word for word in plan.warnings if not word.startswith("the table begins"))
        said += [word if len(wanted) == 1 else f"{where}: {word}" for word in words]
        found = _joined(found, _stretch(program, made, pause))
    return replace(found, warnings=tuple(dict.fromkeys(said)))


def _wanted(program: PartProgram, paths: Sequence[ProgramPath]) -> tuple[list[ProgramPath], list[str]]:
    """Cuts that can be led, each between rapids a path of its own, and words about the others."""
    reasons, said = why_blocked(program), []
    wanted = []
    for one in paths:
        for first, last in _cuts(program, one):
            low, high = one.motion[[first, last]].tolist()
            why = reasons.get(one.chain, "") or why_not_led(program, low, high)
            if why:
                said.append(f"{program.line_words(*program.motions.block[[low, high]].tolist())} not led: {why}")
            else:
                wanted.append(_part(one, first, last))
    return wanted, said


def _part(path: ProgramPath, first: int, last: int) -> ProgramPath:
    """Return the part of a path that a cut is, from its first to its last row; the path itself where that is all."""
    if (first, last) == (0, path.motion.size - 1):
        return path
    track = Track(path.path)
    begin, end = path.s[first] - MEETS, path.s[last + 1] - MEETS
    segments = np.unique(track.segment[(track.starts[:-1] >= begin) & (track.starts[:-1] < end)]).tolist()
    return replace(
        path,
        path=replace(path.path, segments=tuple(path.path.segments[n] for n in segments), closed=False),
        motion=path.motion[first : last + 1],
        s=path.s[first : last + 2] - path.s[first],
        cubics={row - first: curve for row, curve in path.cubics.items() if first <= row <= last},
    )


def _stretch(program: PartProgram, made: WindowPlan, pause: float) -> LeadPlan:
    """Return the stretch of a cut, as it was planned."""
    path, plan, track = made.path, made.plan, made.analysis.track
    period = plan.machine.servo_period
    command = bare = command_of(plan, track, period)
    if plan.crossings or any(plan.bias.values()):
        bare = command_of(replace(plan, crossings=(), bias={}), track, period)
    reach = 0.0 if command.offset is None else float(np.linalg.norm(command.offset, axis=1).max())
    first = int(path.motion[0])
    stretch = LeadStretch(
        first=first,
        last=int(path.motion[-1]),
        axes=path.path.axes,
        t=command.t,
        position=command.position,
        pause=pause,
        after_rapid=_after_rapid(program, first),
    )
    free = (replace(stretch, position=bare.position),)
    ways = _approaches(program, plan, stretch)
    if ways:
        moved = command_of(_approached(plan, ways), track, period)
        stretch = replace(stretch, position=moved.position, approaches=ways)
        reach = max(reach, math.hypot(*(max(abs(way.beyond), abs(way.offset)) for way in ways)))
    return LeadPlan(stretches=(stretch,), free=free, plans=(made,), warnings=(), reach=reach)


def _approached(plan: Plan, ways: Sequence[Approach]) -> Plan:
    """Return a plan whose axes are on their sides when it begins, and push against their friction there."""
    offsets = {way.axis: way.offset for way in ways}
    crossings = tuple(one for one in plan.crossings if one.axis not in offsets or one.start >= _begins(plan))
    friction, left = list(plan.friction), set(offsets)
    for number, one in enumerate(friction):
        if one.axis in left and one.before == 0:
            friction[number] = replace(one, start=-(one.release + one.hold + one.take))
        left.discard(one.axis)
    return replace(plan, crossings=crossings, bias={**plan.bias, **offsets}, friction=tuple(friction))


def _begins(plan: Plan) -> float:
    """Return when the path of a plan begins [s], behind what brings axes onto their sides."""
    return lead_in(plan.phases, plan.crossings)


def _approaches(program: PartProgram, plan: Plan, stretch: LeadStretch) -> tuple[Approach, ...]:
    """Return how axes come onto their sides in the air; none where the first line behind the rapid is no move there."""
    motions, first = program.motions, stretch.first
    begin = first if stretch.after_rapid is None else stretch.after_rapid
    between, low = slice(begin, max(first, begin + 1)), section_spans(motions)[0]
    in_air = begin > 0 and motions.kind[begin - 1] == RAPID and (motions.kind[between] == LINE).all()
    if not in_air or (low[low > begin] <= first).any() or why_not_led(program, begin, stretch.last):
        return ()
    rests = ~(motions.end[between] != motions.start[between]).any(axis=0)
    found = []
    for name in stretch.axes:
        axis = plan.machine.axes[name]
        own = [one for one in plan.crossings if one.axis == name and one.start < _begins(plan)]
        if not own or not rests[AXES.index(name)] or not may_shift(axis):
            continue
        offset = plan.bias.get(name, 0.0) + sum(one.travel for one in own)
        way = math.copysign(LOST_MOTIONS * axis.gap.lost_motion, own[-1].travel)
        speed = make_jog(axis, way, 0.0, min(APPROACH_FEED, gentlest_approach(axis))).velocity
        found.append(Approach(axis=name, beyond=offset - way, offset=offset, speed=speed))
    return tuple(found)


def _after_rapid(program: PartProgram, first: int) -> int | None:
    """Return the motion behind a rapid from which others lead to the motion `first`; None where none of them moves."""
    motions = program.motions
    rapids = np.flatnonzero(motions.kind[:first] == RAPID)
    behind = int(rapids[-1]) + 1 if rapids.size else 0
    moves = (motions.start[behind:first] != motions.end[behind:first]) & ~np.isnan(motions.end[behind:first])
    return behind if moves.any() else None


def _joined(one: LeadPlan, other: LeadPlan) -> LeadPlan:
    return LeadPlan(
        stretches=(*one.stretches, *other.stretches),
        free=(*one.free, *other.free),
        plans=(*one.plans, *other.plans),
        warnings=(),
        reach=max(one.reach, other.reach),
    )


def _cuts(program: PartProgram, path: ProgramPath) -> list[tuple[int, int]]:
    """Rows of the first and the last motion of every cut between rapids."""
    cuts = program.motions.kind[path.motion] != RAPID
    edges = np.flatnonzero(np.diff(np.concatenate([[False], cuts, [False]])))
    return [(first, end - 1) for first, end in edges.reshape(-1, 2).tolist()]


def overridden(program: PartProgram, factor: float) -> PartProgram:
    """Return a program whose cuts run at a feed override; rapids and dwells keep their times."""
    motions = program.motions
    return replace(
        program, motions=replace(motions, feeds=feed_runs(motions.feed * factor), duration=motions.duration / factor)
    )


def override_errors(original: PartProgram, led: PartProgram, machine: Machine) -> tuple[OverrideError, ...]:
    """Simulate the original and the led program at feed overrides, under the planner of the controller.

    Parameters
    ----------
    original, led : PartProgram
    machine : Machine

    Returns
    -------
    tuple of OverrideError
        For each of :data:`OVERRIDES`.
    """
    found = []
    for factor in OVERRIDES:
        before, after = (
            _error(ProgramMotion(overridden(one, factor), original, machine, "program")) for one in (original, led)
        )
        found.append(OverrideError(override=factor, before=before, after=after))
    return tuple(found)


def _error(motion: ProgramMotion) -> ContourError:
    cut = motion.cut

    def distance(scenario: Scenario) -> Array:
        own = cut.counted_distances(scenario)
        return np.array([own.max(initial=0.0), np.sqrt((own * own).mean()) if own.size else 0.0])

    tried = [one for one in cut.scenarios() if is_nominal(one)]
    sizes: Array = np.max(run_scenarios(distance, tried), axis=0)
    return ContourError(max=float(sizes[0]), rms=float(sizes[1]))


NO_LEAD: Final = "neither lag nor friction is led, as the part is better so: the chords cross backlash alone"

NOTHING_LED: Final = "not led: nothing that was tried makes the part better"

HOLDS: Final = "the lead holds at 100 percent feed override"
"""What whoever runs a program with the lead has to know."""

CHORDS_HOLD: Final = "the chords without a lead hold at 100 percent feed override"
"""The same where no stretch leads anything."""


def lead_note(errors: Sequence[OverrideError], holds: str = HOLDS) -> str:
    """Say at which feed override a lead `holds`, and by how much it errs at others; for the head of the program.

    Examples
    --------
    >>> lead_note([OverrideError(override=1.2, before=ContourError(max=4e-5, rms=2e-5),
    ...     after=ContourError(max=1e-5, rms=5e-6))])
    'the lead holds at 100 percent feed override, largest/rms error at 120 percent 10/5 um, of the original 40/20 um'
    """
    parts = [
        f"at {100.0 * one.override:.0f} percent {_size(one.after)} um, of the original {_size(one.before)} um"
        for one in errors
    ]
    return f"{holds}, largest/rms error {', '.join(parts)}" if parts else holds


def _size(error: ContourError) -> str:
    return f"{error.max / MICROMETRE:.3g}/{error.rms / MICROMETRE:.3g}"
