"""Plan backlash offsets of axes behind their loop, and choose the reversals that are worth their time."""

from __future__ import annotations

from itertools import pairwise
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.compensate.offsets import DWELL, PART, corner_pause, make_jog, may_shift
from ph_post.compensate.plan_warnings import friction_warnings, round_up, varying_backlash_warnings
from ph_post.dialects.base import Dialect
from ph_post.edit.edits import EditOptions, Edits, OffsetShift, StopEdit, merge_edits
from ph_post.edit.preconditions import (
    blocked_chains,
    cutting_feed,
    double_compensation,
    half_lost_motion,
    program_units,
    warn_blocked,
    warn_unknown,
    why_indivisible,
    why_not_editable,
)
from ph_post.edit.reversals import CARRIED, CHAIN, MOTION, PASSED, SHARE, SIGN, chain_spans, find_reversals, motion_view
from ph_post.gcode.motion_parts import arc_lengths
from ph_post.gcode.paths import line_words
from ph_post.gcode.program import ARC, AXES, CUBIC, RAPID, PartProgram
from ph_post.simulate.controllers.run import moved_axes
from ph_post.types import Array, Axis, BoolArray, Machine, frozen, sealed
from ph_post.units import MM


def motion_times(program: PartProgram, machine: Machine) -> Array:
    """Time of every motion at its feed [s], shape (m,), ramps and corners left out."""
    motions = program.motions
    with np.errstate(invalid="ignore", divide="ignore"):
        way = np.nan_to_num(np.abs(motions.end - motions.start))
        length = np.sqrt((way * way).sum(axis=1))
        arcs = np.flatnonzero(motions.kind == ARC)
        length[arcs] = arc_lengths(motions, arcs)
        for k in np.flatnonzero(motions.kind == CUBIC).tolist():
            way_k = np.diff(np.nan_to_num(motions.control[k]), axis=0)
            length[k] = np.sqrt((way_k**2).sum(axis=1)).sum()
        rapid = np.zeros(length.size)
        for column, name in enumerate(AXES):
            if name in machine.axes:
                rapid = np.maximum(rapid, way[:, column] / machine.axes[name].limits.velocity)
        cut = np.where(motions.duration > 0.0, motions.duration, length / motions.feed)
        return np.nan_to_num(np.where(motions.kind == RAPID, rapid, cut), posinf=0.0)


def least_acceleration(machine: Machine) -> float:
    """Return the acceleration [m/s²] at which the path can stop in any direction."""
    return PART * min(axis.limits.acceleration for axis in machine.axes.values())


def jog_dwells(axis: Axis, rows: Array) -> Array:
    """Return the dwells [s] of the jogs of one axis: longer where the path stands anyway, as in corners."""
    return np.where(rows[:, PASSED] == 0.0, corner_pause(axis), DWELL)


def stop_cost(changes: dict[str, Array], travel: dict[str, float], machine: Machine) -> float:
    """Time [s] that the changes of all axes cost.

    A stop takes the path's speed away and gives it back, each of which costs half of the time that it takes;
    it begins with a dwell, and every jog ends with one. Axes that change at the same place share the stop.
    """
    jogs, places, speeds, rests = 0.0, [], [], []
    for name, rows in changes.items():
        stopped = rows[rows[:, CARRIED] == 0.0]
        axis = machine.axes[name]
        jogs += len(stopped) * make_jog(axis, travel[name], 0.0).duration
        rests.append(jog_dwells(axis, stopped))
        places.append(stopped[:, [MOTION, SHARE]])
        speeds.append(stopped[:, PASSED])
    if not places:
        return 0.0
    _, kept = np.unique(np.concatenate(places), axis=0, return_index=True)
    rest = np.concatenate(rests)
    braking = np.concatenate(speeds)[kept].sum() / least_acceleration(machine)
    return float(jogs + rest.sum() + rest[kept].sum() + braking)


_HALVINGS: Final = 6
"""Halvings of the range of the dead band, down to a sixtieth of it."""


class ReversalSearch:
    """Search for the offset changes of all axes by dead band; keeps what all searches share.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    dialect : Dialect
    amplitude : dict
        Offset by axis [m].
    chains : BoolArray, shape (c,)
        Chains that may be shifted.
    """

    def __init__(
        self,
        program: PartProgram,
        machine: Machine,
        dialect: Dialect,
        amplitude: dict[str, float],
        chains: BoolArray,
    ) -> None:
        self.program, self.machine, self.dialect = program, machine, dialect
        self.amplitude = amplitude
        self.times = motion_times(program, machine)
        self.low, self.high = chain_spans(program.motions)
        self.chain_times = np.add.reduceat(self.times, self.low)
        self.open = {name: chains.copy() for name in amplitude}
        self._view = motion_view(program.motions)
        self._feed = np.nan_to_num(cutting_feed(program, self.times))
        self.warnings: list[str] = []

    def changes(self, band: dict[str, float]) -> dict[str, Array]:
        """Find the changes of every axis, and those to no offset at the ends of chains; rows as of `find_reversals`."""
        return {name: self._one(name, width) for name, width in band.items()}

    def _one(self, name: str, band: float) -> Array:
        axis = AXES.index(name)
        rows = find_reversals(
            self._view,
            axis,
            self._feed,
            self.program.motions.exact,
            self.low,
            self.high,
            self.open[name],
            np.full(self.low.size, band),
        )
        return self._closed(rows, axis)

    def _closed(self, rows: Array, axis: int) -> Array:
        """Add the change to no offset at the end of every chain that has changes.

        The last rapid of the axis takes the offset back where nothing cuts after it; else a stop behind the
        last motion does.
        """
        motions = self.program.motions
        ends = []
        for chain in np.unique(rows[:, CHAIN]).astype(np.int64).tolist():
            low, high = int(self.low[chain]), int(self.high[chain])
            last = low + int(np.flatnonzero(motions.kind[low:high] != RAPID)[-1])
            after = np.flatnonzero(motions.start[last + 1 : high, axis] != motions.end[last + 1 : high, axis])
            rapid = after.size > 0
            motion = last + 1 + int(after[-1]) if rapid else high - 1
            row = np.zeros(rows.shape[1])
            row[[MOTION, SHARE, SIGN, CARRIED, CHAIN]] = motion, 1.0, 0.0, rapid, chain
            ends.append(row)
        if not ends:
            return rows
        every = np.concatenate([rows, ends])
        # A stable sort: of two changes in one rapid the one to none comes last.
        return np.asarray(every[np.argsort(every[:, CHAIN], kind="stable")])

    def cost(self, changes: dict[str, Array]) -> float:
        """Return the time that changes cost [s]."""
        travel = {name: 2.0 * size for name, size in self.amplitude.items()}
        return stop_cost(changes, travel, self.machine)

    def give_up(self, name: str, chain: int, why: str) -> None:
        """Leave an axis uncompensated in a chain, and warn."""
        self.open[name][chain] = False
        block = self.program.motions.block
        where = line_words(int(block[self.low[chain]]), int(block[self.high[chain] - 1]))
        self.warnings.append(f"axis {name} not compensated in {where}: {why}")

    def unsplit(self, changes: dict[str, Array]) -> bool:
        """Give up chains in which a motion cannot be divided at a reversal; return true where there was one."""
        found = False
        for name, rows in changes.items():
            inside = rows[(rows[:, SHARE] > 0.0) & (rows[:, SHARE] < 1.0)]
            for motion, share, chain in inside[:, [MOTION, SHARE, CHAIN]].tolist():
                why = why_indivisible(self.program, self.dialect, int(motion), share)
                if why and self.open[name][int(chain)]:
                    self.give_up(name, int(chain), why)
                    found = True
        return found


def affordable_reversals(search: ReversalSearch, options: EditOptions) -> tuple[dict[str, Array], list[str]]:
    """Find the changes that keep within the allowed slowdown.

    The dead band begins with the tolerance. Where the stops cost too much it is raised, up to half the lost
    motion of each axis; where that is not enough, axes are not compensated in whole chains, beginning with those
    that cost most for their time.

    Returns
    -------
    changes : dict
        By axis, rows as of :func:`~ph_post.edit.reversals.find_reversals`.
    warnings : list of str
    """
    allowed = options.max_slowdown * float(search.times.sum())
    found = _search_raised(search, options, 0.0)
    while search.unsplit(found):
        found = _search_raised(search, options, 0.0)
    every = search.cost(found)
    if every <= allowed:
        return found, search.warnings
    _drop_costly_chains(search, options, allowed)
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        kept = search.cost(_search_raised(search, options, middle)) <= allowed
        low, high = (low, middle) if kept else (middle, high)
    found = _search_raised(search, options, high)
    widest = max(_bands(search, options, high).values())
    need = round_up(every / max(float(search.times.sum()), 1e-9))
    said = [
        f"moves below {widest / MM:.4g} mm are ignored to keep within --max-slowdown:"
        f" --max-slowdown {need:g} would compensate all above {options.tolerance / MM:g} mm"
    ]
    return found, [*search.warnings, *(said if any(len(rows) for rows in found.values()) else [])]


def _drop_costly_chains(search: ReversalSearch, options: EditOptions, allowed: float) -> None:
    """Leave axes uncompensated in whole chains until the widest dead band keeps within the time allowed."""
    found = _search_raised(search, options, 1.0)
    total = search.cost(found)
    if total <= allowed:
        return
    need = round_up(total / max(float(search.times.sum()), 1e-9))
    pairs = []
    for name, rows in found.items():
        for chain in np.unique(rows[:, CHAIN]).astype(np.int64).tolist():
            own = search.cost({name: rows[rows[:, CHAIN] == chain]})
            pairs.append((own / max(float(search.chain_times[chain]), 1e-9), own, name, chain))
    for _, own, name, chain in sorted(pairs, reverse=True):
        if total <= allowed:
            return
        search.give_up(name, chain, f"its stops would cost {own:.3g} s; --max-slowdown {need:g} would allow them")
        total -= own


def _search_raised(search: ReversalSearch, options: EditOptions, raised: float) -> dict[str, Array]:
    return search.changes(_bands(search, options, raised))


def _bands(search: ReversalSearch, options: EditOptions, raised: float) -> dict[str, float]:
    """Dead bands by axis [m]: `raised` from the tolerance (0) to half the lost motion (1)."""
    return {
        name: options.tolerance + raised * max(half - options.tolerance, 0.0) for name, half in search.amplitude.items()
    }


APPROACH: Final = 3.0
"""Distance before its place from which an axis approaches where its side of the backlash is not known, in
halves of the lost motion: with the half that is added this is twice the lost motion."""


def plan_offsets(program: PartProgram, machine: Machine, dialect: Dialect, options: EditOptions) -> Edits:
    """Plan the offsets of all axes whose backlash is outside the loop.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    dialect : Dialect
        Offsets are rounded to its decimals.
    options : EditOptions

    Returns
    -------
    Edits
        With stops, but no dips; `warnings` name what is not compensated.

    Raises
    ------
    InputError
        Where the dialect's decimals are too few for an axis.
    """
    said = tuple(varying_backlash_warnings(machine.axes[name] for name in moved_axes(program)))
    nothing = Edits(offset=frozen(np.zeros((program.motions.kind.size, 3))), warnings=said)
    axes = [machine.axes[name] for name in AXES if name in machine.axes and may_shift(machine.axes[name])]
    if not axes or program.motions.kind.size == 0:
        return nothing
    troubles = why_not_editable(program)
    if troubles:
        said += tuple(f"program not compensated: {trouble}" for trouble in troubles)
        return Edits(offset=nothing.offset, warnings=said)
    units = program_units(program)[0]
    amplitude = {axis.name: half_lost_motion(axis, dialect, units) for axis in axes}
    blocked = blocked_chains(program)
    search = ReversalSearch(program, machine, dialect, amplitude, _open_chains(program, blocked))
    changes, said_of_time = affordable_reversals(search, options)
    offset, edits = np.zeros(nothing.offset.shape), nothing
    for name, rows in changes.items():
        column = offset[:, AXES.index(name)]
        starts = np.append(rows[:, MOTION], column.size).astype(np.int64).tolist()
        for (low, high), sign in zip(pairwise(starts), rows[:, SIGN].tolist(), strict=True):
            column[low:high] = sign * amplitude[name]
        if column.any():
            found = _edits_of(program, machine.axes[name], amplitude[name], rows, nothing.offset)
            edits = merge_edits(edits, found)
    warnings = [*said, *warn_blocked(program, blocked), *warn_unknown(program, amplitude), *said_of_time]
    if edits.amplitude:
        own = double_compensation(program, dialect)
        warnings += [*friction_warnings(edits.amplitude), *own, *dialect.notices.cautions]
    return replace(edits, offset=sealed(offset), warnings=tuple(warnings))


def _open_chains(program: PartProgram, blocked: dict[str, BoolArray]) -> BoolArray:
    """Mask of the chains that cut and may be shifted (c,)."""
    low, _ = chain_spans(program.motions)
    cuts = np.logical_or.reduceat(program.motions.kind != RAPID, low)
    for marks in blocked.values():
        cuts &= ~marks
    return np.asarray(cuts)


def _edits_of(program: PartProgram, axis: Axis, amplitude: float, rows: Array, nothing: Array) -> Edits:
    """Turn the changes of one axis into stops; the last change of every chain is to none."""
    stops, approached = _stops(program, axis, amplitude, rows)
    return Edits(
        offset=nothing,
        stops=stops,
        amplitude={axis.name: amplitude},
        pulse={axis.name: APPROACH * amplitude} if approached else {},
    )


def _stops(program: PartProgram, axis: Axis, amplitude: float, rows: Array) -> tuple[tuple[StopEdit, ...], bool]:
    """Make stops of reversals; the second value is true where the axis approaches from beyond its backlash.

    At the first reversal of a chain the axis may be on either side of its backlash. Behind a rapid, so in the
    air, it approaches its place from beyond the backlash.
    """
    before = np.append(0.0, rows[:-1, SIGN])
    first = np.append(True, np.diff(rows[:, CHAIN]) != 0.0)
    before[first] = 0.0
    steps = rows[:, SIGN] - before
    rapid = (program.motions.kind[rows[:, MOTION].astype(np.int64)] == RAPID) & (rows[:, SHARE] == 1.0)
    approaches = first & rapid
    made = np.flatnonzero((rows[:, CARRIED] == 0.0) & (steps != 0.0))
    velocity = {size: make_jog(axis, size * amplitude, 0.0).velocity for size in (1.0, 2.0, APPROACH, APPROACH + 1.0)}
    stops = []
    for n, rest in zip(made.tolist(), jog_dwells(axis, rows[made]), strict=True):
        ways = (-APPROACH * steps[n], (APPROACH + 1.0) * steps[n]) if approaches[n] else (steps[n],)
        shifts = tuple(
            OffsetShift(
                axis=axis.name,
                travel=float(way) * amplitude,
                velocity=velocity[abs(float(way))],
                pause=float(rest),
            )
            for way in ways
        )
        stops.append(
            StopEdit(motion=int(rows[n, MOTION]), share=float(rows[n, SHARE]), pause=float(rest), shifts=shifts)
        )
    return tuple(stops), bool(approaches[made].any())
