"""The search for the changes of direction that are worth their time."""

from __future__ import annotations

from typing import Final

import numpy as np

from ph_post.compensate.words import upwards
from ph_post.gcode.dialect import Dialect
from ph_post.gcode.paths.build import line_words
from ph_post.gcode.reader.record import RAPID, CodeArray, PartProgram
from ph_post.gcode.splice.cost import motion_times, stop_cost
from ph_post.gcode.splice.directions import CARRIED, CHAIN, MOTION, SHARE, SIGN, find_changes
from ph_post.gcode.splice.dividing import why_whole
from ph_post.gcode.splice.options import SpliceOptions
from ph_post.gcode.splice.standing import cutting_feed
from ph_post.gcode.splice.view import chain_spans, motion_view
from ph_post.types import Array, BoolArray, Machine
from ph_post.units import MM

_HALVINGS: Final = 6
"""So often the range of the dead band is halved: to a sixtieth of it."""


class Search:
    """Finds the changes of all axes for dead bands, with what all searches have in common kept.

    Parameters
    ----------
    program : PartProgram
    machine : Machine
    dialect : Dialect
    amplitude : dict
        Lasting offset by axis [m].
    chains : BoolArray, shape (c,)
        Which chains may be shifted.
    """

    def __init__(
        self, program: PartProgram, machine: Machine, dialect: Dialect, amplitude: dict[str, float],
        chains: BoolArray,
    ) -> None:  # fmt: skip
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
        """Find the changes of every axis, with those to none at the ends of chains; as in `directions`."""
        return {name: self._one(name, width) for name, width in band.items()}

    def _one(self, name: str, band: float) -> Array:
        axis = "XYZ".index(name)
        rows = find_changes(
            self._view, axis, self._feed, self.program.motions.exact, self.low, self.high, self.open[name],
            np.full(self.low.size, band),
        )  # fmt: skip
        return self._closed(rows, axis)

    def _closed(self, rows: Array, axis: int) -> Array:
        """Add the change to none at the end of every chain that has changes.

        The last rapid of the axis takes the offset back where nothing cuts after it; else a stop behind the
        last motion does.
        """
        motions = self.program.motions
        ends = []
        for chain in np.unique(rows[:, CHAIN]).astype(np.int64).tolist():
            low, high = int(self.low[chain]), int(self.high[chain])
            last = _last_cut(motions.kind, low, high)
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
        """Time that changes cost [s]."""
        travel = {name: 2.0 * size for name, size in self.amplitude.items()}
        return stop_cost(changes, travel, self.machine)

    def give_up(self, name: str, chain: int, why: str) -> None:
        """Leave an axis alone in a chain, and say so."""
        self.open[name][chain] = False
        block = self.program.motions.block
        where = line_words(int(block[self.low[chain]]), int(block[self.high[chain] - 1]))
        self.warnings.append(f"axis {name} carries no lasting offset in {where}: {why}")

    def unsplit(self, changes: dict[str, Array]) -> bool:
        """Give up where a motion cannot be divided at a change; whether there was any such place."""
        found = False
        for name, rows in changes.items():
            inside = rows[(rows[:, SHARE] > 0.0) & (rows[:, SHARE] < 1.0)]
            for motion, share, chain in inside[:, [MOTION, SHARE, CHAIN]].tolist():
                why = why_whole(self.program, self.dialect, int(motion), share)
                if why and self.open[name][int(chain)]:
                    self.give_up(name, int(chain), why)
                    found = True
        return found


def affordable(search: Search, options: SpliceOptions) -> tuple[dict[str, Array], list[str]]:
    """Find the changes that keep within the time allowed.

    The dead band begins with the tolerance. Where the stops cost too much it is raised, up to half the lost
    motion of each axis; where that is not enough axes are left alone in whole chains, those first that cost
    most for their time.

    Returns
    -------
    changes : dict
        By axis, rows as in `directions`.
    warnings : list of str
    """
    allowed = options.max_slowdown * float(search.times.sum())
    found = _changes(search, options, 0.0)
    while search.unsplit(found):
        found = _changes(search, options, 0.0)
    every = search.cost(found)
    if every <= allowed:
        return found, search.warnings
    _shed(search, options, allowed)
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        kept = search.cost(_changes(search, options, middle)) <= allowed
        low, high = (low, middle) if kept else (middle, high)
    found = _changes(search, options, high)
    widest = max(_bands(search, options, high).values())
    need = upwards(every / max(float(search.times.sum()), 1e-9))
    said = [
        f"excursions of up to {widest / MM:.4g} mm are not followed, to keep within the time allowed:"
        f" --max-slowdown {need:g} would follow all above {options.tolerance / MM:g} mm"
    ]
    return found, [*search.warnings, *(said if any(len(rows) for rows in found.values()) else [])]


def _shed(search: Search, options: SpliceOptions, allowed: float) -> None:
    """Leave axes alone in whole chains until the widest dead band keeps within the time allowed."""
    found = _changes(search, options, 1.0)
    total = search.cost(found)
    if total <= allowed:
        return
    need = upwards(total / max(float(search.times.sum()), 1e-9))
    pairs = []
    for name, rows in found.items():
        for chain in np.unique(rows[:, CHAIN]).astype(np.int64).tolist():
            own = search.cost({name: rows[rows[:, CHAIN] == chain]})
            pairs.append((own / max(float(search.chain_times[chain]), 1e-9), own, name, chain))
    for _, own, name, chain in sorted(pairs, reverse=True):
        if total <= allowed:
            return
        search.give_up(
            name, chain, f"its stops would cost {own:.3g} s; --max-slowdown {need:g} would allow them"
        )
        total -= own


def _changes(search: Search, options: SpliceOptions, raised: float) -> dict[str, Array]:
    return search.changes(_bands(search, options, raised))


def _bands(search: Search, options: SpliceOptions, raised: float) -> dict[str, float]:
    """Dead bands by axis [m]: `raised` from the tolerance (0) to half the lost motion (1)."""
    return {
        name: options.tolerance + raised * max(half - options.tolerance, 0.0)
        for name, half in search.amplitude.items()
    }


def _last_cut(kind: CodeArray, low: int, high: int) -> int:
    """Return the last motion of a chain that is no rapid; a chain that is looked at has one."""
    return low + int(np.flatnonzero(kind[low:high] != RAPID)[-1])
