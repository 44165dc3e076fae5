"""The path of a program, made ready to measure from, and where along it a command is in every row.

A program runs over itself, so that the nearest place of all says little: the commanded place is followed
from row to row, and the distance is taken to the stretch of path a little before and behind it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from ph_post.drive.axes import gaps_of
from ph_post.drive.cascade import response_time
from ph_post.errors import InputError
from ph_post.gcode.program import AXES, RAPID, PartProgram
from ph_post.gcode.working import working_motions
from ph_post.geometry.closest import (
    EXTENT,
    FIRST,
    NO_CONTROL,
    ORIGIN,
    RADIUS,
    RISE,
    SECOND,
    SWEEP,
    closest_on,
    closest_within,
    follow_path,
    make_pieces,
    pieces_at,
    points_at,
)
from ph_post.simulate.contour import settling_time
from ph_post.simulate.controllers.counterparts import Counterparts, approaches, counterparts
from ph_post.simulate.controllers.exact_path import steps_of
from ph_post.simulate.controllers.legs import Legs
from ph_post.simulate.controllers.moves import limit_table, programmed
from ph_post.simulate.controllers.unknown import with_one_zero
from ph_post.types import Array, BoolArray, Command, IntArray, Machine, Run


def pieces_of(legs: Legs) -> Array:
    """Return the lines and arcs of legs as a table of pieces."""
    pieces = make_pieces(legs.length.size)
    for column, vectors in ((ORIGIN, legs.origin), (FIRST, legs.first), (SECOND, legs.second), (RISE, legs.rise)):
        pieces[:, column : column + 3] = vectors
    pieces[:, RADIUS], pieces[:, SWEEP], pieces[:, EXTENT] = legs.radius, legs.sweep, legs.length
    return pieces


SLACK: Final = 1e-4
"""Distance [m] before and behind a place that always belongs to it."""

GAPS: Final = 2.0
"""So many times the largest gap may a command be off the path, and its place off the way travelled."""

WIDE: Final = 0.02
"""Distance from the way travelled within which a place is sought where a corner is cut [m]."""

BEGINS: Final = 20e-6
"""A cut has begun farther than this [m] behind a rapid: controllers blend it with what comes before."""


class CutPath:
    """The path of a program, made ready to measure from.

    Parameters
    ----------
    program : PartProgram
    machine : Machine

    Attributes
    ----------
    program : PartProgram
        The same, with all of its places from its first zero.
    renames : bool
        Whether the program itself has other zeros in between.
    works : BoolArray, shape (motions,)
        Motions that are no rapids, with the beam or the extruder on.

    Raises
    ------
    InputError
        Where the program has no motion.
    """

    def __init__(self, program: PartProgram, machine: Machine) -> None:
        written, program = program, with_one_zero(program)
        legs = programmed(program, limit_table(machine))
        kept = np.flatnonzero(legs.length > 0.0)
        if kept.size == 0:
            raise InputError(program.name, "the program moves nothing that is understood")
        self.legs = Legs(*(np.ascontiguousarray(column[kept]) for column in legs))
        self.starts = np.concatenate([[0.0], np.cumsum(self.legs.length)])
        self._first_leg = np.searchsorted(self.legs.motion, np.arange(program.motions.kind.size + 1))
        self._pieces = pieces_of(self.legs)
        self._machine = machine
        self.works = working_motions(program, machine.tool).on & (program.motions.kind != RAPID)
        self.program = program
        self.renames = program is not written

    def follow(self, command: Command, known: Counterparts | None = None) -> tuple[IntArray, Array]:
        """Leg of every row of a command, and its place along the program [m].

        Where it is `known` what the motions stand for that its `segment` numbers, none loses its place: in a sharp
        corner, where the command is shifted, the way back may be as near as the way on.
        """
        position = self.in_space(command.axes, command.position)
        reach = self._reach(command.axes, command.position)
        low = np.zeros(len(position))
        if known is not None:
            motion = np.maximum(command.segment, 0)
            # Rows of a rounded corner are all of one motion, however many it cuts short.
            rounded = 0.5 * WIDE + np.diff(command.s, prepend=0.0)
            low = self.joint_places(known.first[motion]) - reach
            low += np.maximum(_least_ways(command, position, known, reach), -rounded)
        return follow_path(self._pieces, self.starts, position, low, reach, WIDE)

    def closest_on_motions(self, position: Array, place: Array, first: IntArray, end: IntArray) -> Array:
        """Return the places (n,) along the program [m] where motions of it are closest to positions (n, 3) [m].

        From `first` to before `end` (n,) there may be none: then it is the joint there. Of turns of a circle it is the
        one next to a `place` (n,) [m].
        """
        low, high = self._first_leg[first], self._first_leg[end]
        return closest_on(self._pieces, self.starts, position, place, low, high)[1]

    def joint_places(self, motion: IntArray) -> Array:
        """Places (n,) along the program [m] where motions (n,) of it begin."""
        return np.asarray(self.starts[self._first_leg[motion]])

    def counterparts(self, program: PartProgram, command: Command) -> Counterparts | None:
        """Return which motions of this program those of another stand for that moves a command."""
        return counterparts(with_one_zero(program), self.program, self._gaps_by_name(command))

    def _gaps_by_name(self, command: Command) -> dict[str, float]:
        return dict(zip(command.axes, self.gaps(command).tolist(), strict=True))

    def gaps(self, command: Command) -> Array:
        """Return the largest backlash of each axis of a command [m]."""
        return self._gaps(command.axes, command.position)

    def _gaps(self, axes: Sequence[str], position: Array) -> Array:
        pairs = zip(axes, position.T, strict=True)
        return np.array([float(gaps_of(self._machine.axes[name], column).max()) for name, column in pairs])

    def _reach(self, axes: Sequence[str], position: Array) -> float:
        """Return how far before and behind a place of the path what belongs to it may be [m]."""
        return SLACK + GAPS * float(self._gaps(axes, position).max())

    def cuts(self, leg: IntArray, place: Array, command: Command, moved_by: PartProgram | None) -> BoolArray:
        """Return in which rows the tool cuts, from the leg of every row and its place [m].

        Neither do motions with the beam or the extruder off.
        Rapids of the program that the command is `moved_by` do not cut, whichever place is next to them. Behind a
        rapid an axis may be moved onto its side of the backlash before the cut begins: that is in the air.
        """
        works = self.works[self.legs.motion.astype(np.int64)] & (self.legs.rapid == 0.0)
        # Nothing is blended with a cut with which a program begins: it begins where the table stands. Of one in steps
        # from wherever that is, no error is known there.
        first = int(self.legs.motion[0])
        placed = self.program.modal_after(int(self.program.motions.block[first])).absolute
        behind_rest = np.append(first > 0 or not placed, ~works[:-1])[leg]
        # Up to there a table is where it happened to stand, in whichever line an axis comes to its side.
        begun = np.where((leg == 0) & placed, max(BEGINS, float(self.gaps(command).max())), BEGINS)
        begins = behind_rest & (place <= self.starts[leg] + begun)
        cuts = works[leg] & ~begins
        if moved_by is not None and moved_by.motions.kind.size:
            number = np.maximum(command.segment, 0)
            gaps = self._gaps_by_name(command)
            works = working_motions(moved_by, self._machine.tool).on & (moved_by.motions.kind != RAPID)
            cuts &= works[number] & ~approaches(moved_by, gaps)[number]
        return np.asarray(cuts)

    def command_distance(self, command: Command, place: Array) -> Array:
        """Return the distance of a command itself from the path in every row [m]."""
        position = self.in_space(command.axes, command.position)
        return closest_within(self._pieces, self.starts, position, place, np.full(len(position), SLACK))[0]

    def closest_points(self, run: Run, place: Array) -> tuple[Array, Array]:
        """Return the distance of the table from the path in every row of a run [m], and the places along it [m]."""
        return self.closest_to(run.axes, run.executed, place, self.reach(run.axes, run.commanded, run.period))

    def closest_to(self, axes: Sequence[str], table: Array, place: Array, reach: Array) -> tuple[Array, Array]:
        """As :meth:`closest_points`, of tables (n, axes) [m] at most `reach` (n,) [m] behind or before a place."""
        return closest_within(self._pieces, self.starts, self.in_space(axes, table), place, np.ascontiguousarray(reach))

    def reach(self, axes: Sequence[str], commanded: Array, period: float) -> Array:
        """Return how far the table may be before and behind the place of each row of a command (n, axes) [m]."""
        # In a corner an offset puts the command's place onto the next line earlier.
        reach, lag = self._reach(axes, commanded), self._lag(axes, commanded, period)
        return np.broadcast_to(reach, lag.shape) if lag.strides == (0,) else reach + lag

    def points(self, place: Array, axes: Sequence[str] = AXES) -> Array:
        """Points at places (n,) along the program [m], shape (n, axes) [m]."""
        leg = pieces_at(self.starts, place)
        way = np.clip(place - self.starts[leg], 0.0, self.legs.length[leg])
        found = points_at(self._pieces, NO_CONTROL, leg, way)
        return np.asarray(found[:, [AXES.index(name) for name in axes]])

    def place_of(self, motion: IntArray, share: Array) -> Array:
        """Places along the program [m] of shares (0 to 1) of its motions, each of shape (n,)."""
        legs = self.legs
        known = np.stack([legs.motion + legs.share0, legs.motion + legs.share1], axis=1).ravel()
        places = np.stack([self.starts[:-1], self.starts[1:]], axis=1).ravel()
        return np.asarray(np.interp(motion + share, known, places))

    def _lag(self, axes: Sequence[str], commanded: Array, period: float) -> Array:
        """Return the distance that the table may be behind the command in every row [m]."""
        late = 2.0 * max(response_time(self._machine.axes[name].servo) for name in axes)
        if late == 0.0:
            return np.broadcast_to(0.0, len(commanded))
        rows = 1 + math.ceil((late + settling_time(self._machine, axes)) / period)
        fastest = np.concatenate([[0.0], steps_of(commanded)])
        width = 1
        while width < rows:
            # The largest of so many rows up to each.
            step = min(width, rows - width)
            fastest[step:] = np.maximum(fastest[step:], fastest[:-step])
            width += step
        return late / period * fastest

    def in_space(self, axes: Sequence[str], values: Array) -> Array:
        """Fill in the axes (n, 3) that values (n, axes) [m] have not, which stand where the program begins."""
        if tuple(axes) == AXES:
            return np.ascontiguousarray(values)
        full = np.empty((len(values), len(AXES)))
        begin = self.legs.origin[0] + self.legs.radius[0] * self.legs.first[0]
        full[:] = begin
        for number, name in enumerate(axes):
            full[:, AXES.index(name)] = values[:, number]
        return full


def _least_ways(command: Command, position: Array, known: Counterparts, reach: float) -> Array:
    """Return how far every row (n,) is behind where its motion begins, at least, −inf where that is not known [m].

    A cut that begins where its motion does goes on along the path as far as it has come, but for its offset. What was
    only added between two motions goes nowhere along it.
    """
    segment, motions = np.maximum(command.segment, 0), known.program.motions
    fresh = np.append(True, np.diff(segment) != 0)
    begin, own = np.flatnonzero(fresh), np.cumsum(fresh) - 1
    motion = segment[begin]
    # An axis that the program never names does not move.
    late = np.linalg.norm(np.nan_to_num(position[begin] - motions.start[motion]), axis=1)
    follows = (motions.kind[motion] != RAPID) & (known.end > known.first)[motion] & (late <= reach)
    return np.asarray(np.where(follows[own], command.s - command.s[begin][own] - late[own], -np.inf))
