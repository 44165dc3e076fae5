"""What backlash adds to the deviation of a command from the path of a program."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.compiling import compiled
from ph_post.gcode.program import AXES, PartProgram
from ph_post.geometry.bands import Band
from ph_post.simulate.assess import AlikeRows, run_scenarios
from ph_post.simulate.contour import ContourError, contour_error
from ph_post.simulate.controllers.counterparts import Counterparts
from ph_post.simulate.controllers.cut_path import SLACK
from ph_post.simulate.controllers.deviation import FollowedCut
from ph_post.simulate.controllers.exact_path import steps_of
from ph_post.simulate.machine import simulate
from ph_post.types import Array, Command, IntArray, Machine, Scenario

FASTER: Final = 1.02
"""The original is run at most so many times as fast as it runs by itself, or as the command where that is faster."""

JOINT: Final = 1e-6
"""A command no farther than this [m] before a place is at it: what is written is rounded."""

GAPS: Final = 4.0
"""So many times the largest gap may a table be before or behind a motion without backlash."""


def program_gap_error(
    cut: FollowedCut, plain: FollowedCut, tried: Sequence[Scenario], *, led: bool = False, behind: int = -1
) -> ContourError | None:
    """Return the largest error in some scenarios that backlash causes.

    It is the distance of the table from the way that the table takes without any backlash where motors go the same way
    without the offsets that cross it. Where controllers round joints, what lies between that and the way of the exact
    path at the same pace adds nothing. A program that declares this original carries offsets that follow from where its
    lines end and those of the original. Of any other nothing is known: there it is the way of the original, run as fast
    as the command goes along the path. Where the lead of the servos is in a program, a table that is nearer to the path
    than to that way has no more of it than its distance from the path.

    Parameters
    ----------
    cut : FollowedCut
        The command beside the original's path.
    plain : FollowedCut
        That of the original, beside the same path; `cut` itself where that is the original.
    tried : sequence of Scenario
        See :func:`ph_post.simulate.assess.backlash_scenarios`.
    led : bool
        Whether `plain` is the same program without what crosses backlash, both with the lead of the servos.
    behind : int
        Only what is cut behind this motion of the original counts.

    Returns
    -------
    ContourError or None
        None where nothing is cut.
    """
    machine, rows = cut.machine, np.flatnonzero(cut.counted & (cut.motion > behind))
    if rows.size == 0:
        return None
    if plain is cut and not led:
        ways = cut.command, _on_path(cut, cut.place)
    else:
        ways = (None if led else _without_offsets(cut, plain)) or _as_fast(cut, plain)
    bands = {one: _band(ways, rows, machine, one, _reach(cut)) for one in dict.fromkeys(map(_without_gap, tried))}

    def added(scenario: Scenario) -> ContourError | None:
        table = cut.runs.tables(scenario)
        found = bands[_without_gap(scenario)].errors([column[rows] for column in table])
        return contour_error(np.minimum(found, cut.distances.errors(table)[rows]) if led else found)

    return max(run_scenarios(added, tried), key=lambda error: -1.0 if error is None else error.max)


def _without_gap(scenario: Scenario) -> Scenario:
    return replace(scenario.without_backlash, flank=None, opposite=())


def _band(ways: Sequence[Command], rows: IntArray, machine: Machine, scenario: Scenario, reach: float) -> AlikeRows:
    """Return the distances of tables in some rows from what lies between the ways without backlash."""
    one, other = (_in_space(simulate(way, machine, scenario).executed) for way in ways)
    band = Band(one, other)
    return AlikeRows(lambda table, chosen: band.distances(_in_space(table), rows[chosen], reach))


def _reach(cut: FollowedCut) -> float:
    return SLACK + GAPS * float(cut.path.gaps(cut.command).max())


def _without_offsets(cut: FollowedCut, plain: FollowedCut) -> tuple[Command, Command] | None:
    """Return a command without the offsets that its program declares, and that of the exact path at the same pace.

    A line that is not changed carries what it begins and ends with. In a changed stretch a crossing leaves the path:
    there they go the original's way and the path, as far as the command goes its own.
    """
    path, command, known = cut.path, cut.command, cut.known
    if known is None or plain.known is None:
        return None
    last = np.flatnonzero(np.diff(known.stretch, append=-1))
    offset = _ends(known.program, last + 1) - _ends(path.program, known.end[last])
    offset = np.concatenate([np.zeros((1, len(AXES))), np.nan_to_num(offset)])
    motion = np.maximum(command.segment, 0)
    own, share, place = _passed(cut, known)
    free = _way_of(cut) - (1.0 - share[:, None]) * offset[own] - share[:, None] * offset[own + 1]
    kept = ~known.changed[motion]
    low, high = known.first[motion], np.maximum(known.first[motion], known.end[motion])
    place[kept] = path.closest_on_motions(free[kept], cut.place[kept], low[kept], high[kept])
    theirs = np.maximum.accumulate(_passed(plain, plain.known)[2])
    free[~kept] = _at_rows(_way_of(plain), _rows_at(theirs, place[~kept]))
    return _along(cut, free), _on_path(cut, place)


def _passed(cut: FollowedCut, known: Counterparts) -> tuple[IntArray, Array, Array]:
    """Stretch of each row (n,), the share of its way that is passed, and the place that is as far along the path [m].

    What is closest to a command leaps where that cuts a corner, but rows of a corner that is cut far are all of one of
    its motions: its stretch ends, and the one beside it begins, so far from the joint. What only shifts an axis behind
    a rest at the end of the path is no part of the way: the motion without backlash has arrived.
    """
    motion = np.maximum(cut.command.segment, 0)
    own = np.maximum.accumulate(known.stretch[motion])
    first, last = (np.clip(np.searchsorted(own, own, side=side) - 1, 0, own.size - 1) for side in ("left", "right"))
    low, high = (cut.path.joint_places(one[motion]) for one in (known.first, np.maximum(known.first, known.end)))
    reach, begins, ends = _reach(cut), cut.place[first], cut.place[last]
    low = np.where(np.abs(begins - low) > reach, begins, low)
    high = np.maximum(np.where(np.abs(ends - high) > reach, ends, high), low)
    steps = np.diff(_way_along(_way_of(cut)), prepend=0.0)
    arrived = np.minimum.accumulate(cut.place[::-1])[::-1] >= high - JOINT
    rests = np.cumsum(arrived & (steps == 0.0))
    way = np.cumsum(np.where(rests > rests[first], 0.0, steps))
    share = np.divide(way - way[first], way[last] - way[first], out=np.ones_like(way), where=way[last] > way[first])
    return own, share, (1.0 - share) * low + share * high


def _ends(program: PartProgram, count: IntArray) -> Array:
    """Places (n, 3) [m] at the ends of the first motions (n,) of a program, NaN before the first."""
    ends = np.concatenate([np.full((1, len(AXES)), np.nan), program.motions.end])
    return np.asarray(ends[count])


def _in_space(table: Array) -> Array:
    """Fill in axes (n, 3) [m] that stand still."""
    return np.concatenate([table, np.zeros((len(table), len(AXES) - table.shape[1]))], axis=1)


def _as_fast(cut: FollowedCut, plain: FollowedCut) -> tuple[Command, Command]:
    """Return commands that go along the original's way, and along the exact path, as fast as the command of a cut."""
    way = _way_of(plain)
    known, place = np.maximum.accumulate(plain.place), np.maximum.accumulate(cut.place)
    row = _keep_pace(
        _rows_at(known, place - _reach(cut)),
        _rows_at(known, place + JOINT),
        _way_along(way),
        np.diff(_way_along(_way_of(cut)), prepend=0.0),
        cut.command.period / plain.command.period,
    )
    return _along(cut, _at_rows(way, row)), _on_path(cut, np.interp(row, np.arange(known.size), plain.place))


def _along(cut: FollowedCut, way: Array) -> Command:
    """Return the command of a cut with other positions (n, 3) [m]."""
    columns = [AXES.index(name) for name in cut.command.axes]
    return replace(cut.command, position=np.ascontiguousarray(way[:, columns]))


def _on_path(cut: FollowedCut, place: Array) -> Command:
    """Return the command of a cut at places (n,) along the path [m]."""
    return replace(cut.command, position=np.ascontiguousarray(cut.path.points(place, cut.command.axes)))


def _way_of(cut: FollowedCut) -> Array:
    """Positions (m, 3) [m] of a command."""
    return cut.path.in_space(cut.command.axes, cut.command.position)


def _at_rows(way: Array, row: Array) -> Array:
    """Places (n, 3) [m] of a way (m, 3) at rows (n,), or between two of them."""
    return np.stack([np.interp(row, np.arange(len(way)), column) for column in way.T], axis=1)


def _way_along(position: Array) -> Array:
    return np.concatenate([[0.0], np.cumsum(steps_of(position))])


def _rows_at(known: Array, place: Array) -> Array:
    """Last row (n,), a fraction between two of them, in which a rising place (m,) is no more than others (n,)."""
    before = np.clip(np.searchsorted(known, place, side="right") - 1, 0, known.size - 1)
    step = known[np.minimum(before + 1, known.size - 1)] - known[before]
    share = np.divide(place - known[before], step, out=np.zeros_like(place), where=step > 0.0)
    return np.asarray(before + np.clip(share, 0.0, 1.0))


@compiled
def _keep_pace(earliest: Array, latest: Array, way: Array, step: Array, period: float) -> Array:
    """Rows (n,) of the original at which a motion is that follows another along its path, and never leaps.

    Where a command that carries offsets is beside a corner, the nearest place of the path leaps; a motion that did
    would be another than that of a machine.

    Parameters
    ----------
    earliest, latest : Array, shape (n,)
        Rows of the original at places as far behind the command as is allowed, and at those where it is.
    way : Array, shape (m,)
        Way of the original up to each of its rows [m].
    step : Array, shape (n,)
        Way of the command in each row [m].
    period : float
        That of the command by that of the original.
    """
    rows = np.empty(latest.size)
    last, row = way.size - 1, 0.0
    for k in range(latest.size):
        if k > 0:
            before = min(int(row), last - 1)
            here = way[before] + (row - before) * (way[before + 1] - way[before])
            there, at = here + FASTER * step[k], before
            while at < last - 1 and way[at + 1] < there:
                at += 1
            along = row
            if there > here and way[at + 1] > way[at]:
                along = at + min((there - way[at]) / (way[at + 1] - way[at]), 1.0)
            row = max(row, earliest[k], min(max(row + FASTER * period, along), latest[k]))
        rows[k] = row
    return rows
