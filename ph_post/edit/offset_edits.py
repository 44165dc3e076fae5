"""Plan backlash offsets of axes behind their loop, and choose the reversals that are worth their time."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from itertools import groupby
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.compensate.offsets import may_shift
from ph_post.compensate.plan_warnings import friction_warnings, round_up, varying_backlash_warnings
from ph_post.dialects.base import Dialect
from ph_post.edit.beams import BeamGuard, run_beside
from ph_post.edit.crossing_search import APPROACH, CrossingSearch
from ph_post.edit.crossings import COARSER
from ph_post.edit.edits import EditOptions, Edits, join_stops
from ph_post.edit.positions import approach_again, find_restarts, position_from, resting_places
from ph_post.edit.preconditions import (
    blocked_chains,
    cutting_feed,
    double_compensation,
    program_units,
    warn_blocked,
    warn_climbing,
    warn_unknown,
    why_indivisible,
    why_not_editable,
    written_offsets,
)
from ph_post.edit.reversals import (
    CARRIED,
    CHAIN,
    FIRST,
    MOTION,
    SHARE,
    SHARE0,
    SIGN,
    chain_spans,
    find_reversals,
    motion_view,
)
from ph_post.errors import InputError
from ph_post.gcode.motion_parts import places_along
from ph_post.gcode.paths import line_words
from ph_post.gcode.program import AXES, RAPID, PartProgram
from ph_post.simulate.controllers.run import moved_axes
from ph_post.types import Array, Axis, BoolArray, Machine, frozen, sealed
from ph_post.units import MM


def motion_times(program: PartProgram, machine: Machine) -> Array:
    """Time of every motion at its feed [s], shape (m,), ramps and corners left out."""
    motions = program.motions
    with np.errstate(invalid="ignore", divide="ignore"):
        way = np.nan_to_num(np.abs(motions.end - motions.start))
        length = np.diff(places_along(motions))
        rapid = np.zeros(length.size)
        for column, name in enumerate(AXES):
            if name in machine.axes:
                rapid = np.maximum(rapid, way[:, column] / machine.axes[name].limits.velocity)
        cut = np.where(motions.duration > 0.0, motions.duration, length / motions.feed)
        return np.nan_to_num(np.where(motions.kind == RAPID, rapid, cut), posinf=0.0)


SPARE: Final = 3e-3
"""Part of a program's time that does not count as slower."""

LITTLE: Final = 0.01
"""Where less slowdown [part of the time] is allowed nothing is spent on lines for a restart."""

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
    sides : dict
        Offsets of an axis that moves to minus, and to plus, by axis [m].
    chains : BoolArray, shape (c,)
        Chains of the program that may be shifted.
    options : EditOptions
    left : sequence of tuple
        First motion, and the one behind the last, of stretches in which no axis is shifted: each is a chain of its own
        here, and so is what is before and behind it.
    """

    def __init__(
        self,
        program: PartProgram,
        machine: Machine,
        dialect: Dialect,
        amplitude: dict[str, float],
        sides: dict[str, tuple[float, float]],
        chains: BoolArray,
        options: EditOptions,
        left: Sequence[tuple[int, int]] = (),
    ) -> None:
        self.program, self.machine, self.dialect = program, machine, dialect
        self.amplitude, self.sides = amplitude, sides
        self.times = motion_times(program, machine)
        whole, _ = chain_spans(program.motions)
        ends = [place for span in left for place in span if place < program.motions.kind.size]
        self.low = np.unique(np.append(whole, np.array(ends, dtype=np.int64)))
        self.high = np.append(self.low[1:], program.motions.kind.size)
        self.chain_times = np.add.reduceat(self.times, self.low)
        opened = chains[np.searchsorted(whole, self.low, side="right") - 1]
        opened &= np.logical_or.reduceat(program.motions.kind != RAPID, self.low)
        opened &= ~np.isin(self.low, [begin for begin, _ in left])
        self.open = {name: opened.copy() for name in amplitude}
        self._view = motion_view(program.motions)
        self._feed = np.nan_to_num(cutting_feed(program, self.times))
        # No less than what the numbers of the program can say of the backlash.
        self._overshoot = {
            name: APPROACH * (plus - minus) if options.overshoot is None else max(options.overshoot, plus - minus)
            for name, (minus, plus) in sides.items()
        }
        self._from = -options.position_from
        self._places = [resting_places(program.motions, axis) if self._from else [] for axis in range(2)]
        restarts = find_restarts(program, self.times, late=options.max_slowdown >= LITTLE)
        chain = np.searchsorted(self.low, [one.first for one in restarts], side="right") - 1
        self._restarts = [replace(one, chain=number) for one, number in zip(restarts, chain.tolist(), strict=True)]
        self.crossings = CrossingSearch(
            program,
            machine,
            dialect,
            sides,
            self._feed,
            self.low,
            self._overshoot,
            self._restarts,
            part_side=options.part_side,
        )
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
        if axis < 2:
            rows = approach_again(self._from_one_side(rows, axis), self._restarts, axis)
        return self._closed(rows, axis)

    def _from_one_side(self, rows: Array, axis: int) -> Array:
        if not self._from:
            return rows
        motions, name = self.program.motions, AXES[axis]
        own = np.searchsorted(self.low, [first for first, _ in self._places[axis]], side="right") - 1
        places = [
            place for place, chain in zip(self._places[axis], own.tolist(), strict=True) if self.open[name][chain]
        ]
        return position_from(rows, places, motions, self.low, axis, self._from, self._overshoot[name])

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

    def cost(self, changes: dict[str, Array], coarser: float = 1.0) -> float:
        """Return the time that changes cost [s], with errors of crossings up to a multiple of the least."""
        return self.crossings.cost(changes, coarser)

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
            found |= self._unknown_sides(name, rows)
        return found

    def _unknown_sides(self, name: str, rows: Array) -> bool:
        """Give up chains in which a cut from an unknown place ends where an axis is to be shifted first."""
        motions, found = self.program.motions, False
        if 0.0 not in self.sides[name]:
            # Half of the backlash to either side is no worse than the plain program, whichever side it is.
            return False
        first = np.append(True, np.diff(rows[:, CHAIN]) != 0.0)[: len(rows)]
        for row in rows[first & (rows[:, SIGN] != 0.0)]:
            begin, chain = int(row[FIRST]), int(row[CHAIN])
            cuts = motions.kind[begin] != RAPID and row[SHARE0] == 1.0
            if cuts and np.isnan(motions.start[begin, AXES.index(name)]) and self.open[name][chain]:
                self.give_up(name, chain, f"the motion in line {motions.block[begin] + 1} leaves it on an unknown side")
                found = True
        return found


def affordable_reversals(search: ReversalSearch, options: EditOptions) -> tuple[dict[str, Array], float, list[str]]:
    """Find the changes that keep within the allowed slowdown.

    The dead band begins with the tolerance, and crossings with their least error. Where that costs too much, crossings
    may be coarser; then the dead band is raised, up to half the lost motion of each axis; where that is not enough,
    axes are not compensated in whole chains, beginning with those that cost most for their time.

    Returns
    -------
    changes : dict
        By axis, rows as of :func:`~ph_post.edit.reversals.find_reversals`.
    coarser : float
        Largest error of crossings as a multiple of the least.
    warnings : list of str
    """
    # Ramps and rapids take longer than the motions at their feeds.
    total = max(float(search.times.sum()), options.cycle, 1e-9)
    # What the planner takes is known to a few thousandths.
    allowed = (options.max_slowdown + SPARE) * total
    found = _search_raised(search, options, 0.0)
    while search.unsplit(found):
        found = _search_raised(search, options, 0.0)
    every = search.cost(found)
    for coarser in (1.0, *COARSER):
        if search.cost(found, coarser) <= allowed:
            return found, coarser, search.warnings
    _drop_costly_chains(search, options, allowed)
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        kept = search.cost(_search_raised(search, options, middle), COARSER[-1]) <= allowed
        low, high = (low, middle) if kept else (middle, high)
    found = _search_raised(search, options, high)
    widest = max(_bands(search, options, high).values())
    said = [
        f"moves below {widest / MM:.4g} mm are ignored to keep within --max-slowdown:"
        f" --max-slowdown {round_up(every / total):g} would compensate all above {options.tolerance / MM:g} mm"
    ]
    return found, COARSER[-1], [*search.warnings, *(said if any(len(rows) for rows in found.values()) else [])]


def _drop_costly_chains(search: ReversalSearch, options: EditOptions, allowed: float) -> None:
    """Leave axes uncompensated in whole chains until the widest dead band keeps within the time allowed."""
    found = _search_raised(search, options, 1.0)
    total = search.cost(found, COARSER[-1])
    if total <= allowed:
        return
    need = round_up(total / max(float(search.times.sum()), options.cycle, 1e-9))
    pairs = []
    for name, rows in found.items():
        for chain in np.unique(rows[:, CHAIN]).astype(np.int64).tolist():
            own = search.cost({name: rows[rows[:, CHAIN] == chain]}, COARSER[-1])
            pairs.append((own / max(float(search.chain_times[chain]), 1e-9), own, name, chain))
    for _, own, name, chain in sorted(pairs, reverse=True):
        if total <= allowed:
            return
        search.give_up(name, chain, f"its crossings would cost {own:.2g} s; --max-slowdown {need:g} would allow them")
        total -= own


def _search_raised(search: ReversalSearch, options: EditOptions, raised: float) -> dict[str, Array]:
    return search.changes(_bands(search, options, raised))


def _bands(search: ReversalSearch, options: EditOptions, raised: float) -> dict[str, float]:
    """Dead bands by axis [m]: `raised` from the tolerance (0) to half the lost motion (1)."""
    return {
        name: options.tolerance + raised * max(half - options.tolerance, 0.0) for name, half in search.amplitude.items()
    }


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
    sides = {axis.name: written_offsets(axis, dialect, units) for axis in axes}
    amplitude = {name: max(map(abs, pair)) for name, pair in sides.items()}
    blocked = blocked_chains(program)
    _check_overshoot(axes, options)
    beam = BeamGuard(program, machine)
    runs, unmarked = beam.runs(), frozenset[int]()
    for number in range(ROUNDS):
        left = [runs[run] for run in sorted(unmarked)]
        chains = _open_chains(program, blocked, options.left)
        search = ReversalSearch(program, machine, dialect, amplitude, sides, chains, options, left)
        changes, coarser, said_of_time = affordable_reversals(search, options)
        crossings, stops, pulse, offset, burnt = search.crossings.plan(changes, coarser)
        if not burnt:
            break
        found = {run_beside(runs, motion) for motion in burnt}
        unmarked |= found if number + 2 < ROUNDS and not found <= unmarked else set(range(len(runs)))
    shifted = {one.axis for one in crossings} | {shift.axis for stop in stops for shift in stop.shifts}
    shifted |= {name for name in amplitude if offset[:, AXES.index(name)].any()}
    used = {name: size for name, size in amplitude.items() if name in shifted}
    edits = Edits(
        offset=sealed(offset),
        stops=tuple(join_stops(list(found)) for _, found in groupby(stops, lambda one: (one.motion, one.share))),
        crossings=crossings,
        amplitude=used,
        followed=tuple(name for name in amplitude if len(changes[name])),
        one_sided={name: 1 if sides[name][0] == 0.0 else -1 for name in used if 0.0 in sides[name]},
        pulse=pulse,
    )
    warnings = [*said, *warn_blocked(program, blocked), *warn_unknown(program, amplitude), *said_of_time]
    warnings += beam.warn_left([runs[run] for run in sorted(unmarked)])
    if edits.amplitude:
        own = double_compensation(program, dialect, machine)
        warnings += [
            *friction_warnings(edits.amplitude, beam.tool, climbs=False),
            *(warn_climbing(program) if beam.tool == "cutter" else ()),
            *own,
            *dialect.notices.cautions,
        ]
    return replace(edits, warnings=tuple(warnings))


def _check_overshoot(axes: list[Axis], options: EditOptions) -> None:
    for axis in axes:
        if options.overshoot is not None and options.overshoot < axis.gap.lost_motion:
            raise InputError(
                "--overshoot",
                f"less than the lost motion of {axis.name}",
                expected=f">= {axis.gap.lost_motion / MM:g} mm",
                got=f"{options.overshoot / MM:g} mm",
            )


ROUNDS: Final = 6
"""Plans that are made before nothing is shifted wherever a beam is on."""


def _open_chains(program: PartProgram, blocked: dict[str, BoolArray], left: Collection[int]) -> BoolArray:
    """Mask of the chains that cut and may be shifted (c,)."""
    low, _ = chain_spans(program.motions)
    cuts = np.logical_or.reduceat(program.motions.kind != RAPID, low)
    cuts &= ~np.isin(program.motions.chain[low], list(left))
    for marks in blocked.values():
        cuts &= ~marks
    return np.asarray(cuts)
