"""Where a program's axes are behind lines that were passed through, and what is known of the motion there.

What a canned cycle or cutter compensation does is not understood, and a tool change or another work offset moves
the axes or their zero: where the axes are behind it, only the next words say. Up to there nothing can be measured
or drawn, and behind it only once each axis has moved by more than its backlash, as nobody knows from which side it
came.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.bounds import in_parts
from ph_post.gcode.program import ARC, Motions, PartProgram, plane_columns
from ph_post.types import Array, BoolArray, IntArray

_PASSED: Final = "not understood"
"""Kind of the break behind a line that was passed through."""
_APART: Final = 1e-9
"""Places that differ by less [m] are the same."""


_ORIGIN: Final = np.zeros(3)


def known_ends(program: PartProgram, begin: Array = _ORIGIN) -> tuple[Array, Array]:
    """Return starts and ends of motions (n, 3) [m]; where a coordinate is not known, the one known last.

    At the beginning that is the machine's origin, or the place (3,) [m] where the motions `begin`.
    """
    motions = program.motions
    if not (np.isnan(motions.start).any() or np.isnan(motions.end).any()):
        return motions.start, motions.end
    places = np.stack([motions.start, motions.end], axis=1).reshape(-1, 3)
    for column, first in zip(places.T, begin, strict=True):
        unknown = np.isnan(column)
        known = np.flatnonzero(~unknown)
        last = np.searchsorted(known, np.flatnonzero(unknown)) - 1
        column[unknown] = np.where(last >= 0, column[known[last]], first) if known.size else first
    pairs = places.reshape(-1, 2, 3)
    return np.ascontiguousarray(pairs[:, 0]), np.ascontiguousarray(pairs[:, 1])


def with_one_zero(program: PartProgram) -> PartProgram:
    r"""Return a program whose places are all from the zero of its first motion, where G92 and such move it in between.

    The axes stand still while a zero is moved: a command that follows its places would jump. Where a place is not known
    before and behind, the zero is taken for the one before.

    Examples
    --------
    >>> from ph_post.gcode.read import read_program
    >>> found = with_one_zero(read_program(b"G21 G90 G94\nG1 X10 Y0 F600\nG92 X0\nX5\nM2\n", "two zeros"))
    >>> found.motions.end[:, 0].tolist()
    [0.01, 0.015]
    """
    motions = program.motions
    count = motions.kind.size
    if not any((np.abs(_jumps(motions, part)) > _APART).any() for part in in_parts(count)):
        return program
    zero = np.cumsum(_jumps(motions, slice(0, count)), axis=0)
    planes = plane_columns(motions.plane)[:, :2]
    arcs = (motions.kind == ARC)[:, None]
    moved = replace(
        motions,
        start=motions.start - zero,
        end=motions.end - zero,
        center=motions.center - np.where(arcs, np.take_along_axis(zero, planes.astype(np.int64), axis=1), 0.0),
        control={k: points - zero[k] for k, points in motions.control.items()},
        nurbs={k: (order, points - zero[k], weights) for k, (order, points, weights) in motions.nurbs.items()},
    )
    return replace(program, motions=moved)


def _jumps(motions: Motions, part: slice) -> Array:
    """Return how far the places of a part of the motions begin from where those before them end (n, 3) [m]."""
    begin = motions.start[part]
    before = motions.end[max(part.start - 1, 0) : part.start + len(begin) - 1]
    found = begin - (before if part.start else np.concatenate([begin[:1], before]))
    return np.nan_to_num(found, copy=False)


def unknown_motions(program: PartProgram) -> BoolArray:
    r"""Find the motions (n,) behind such lines, of which it is not known where they begin.

    So are those behind a line that was passed through and led elsewhere by a way that is not known.

    Examples
    --------
    >>> from ph_post.gcode.read import read_program
    >>> lines = b"G21 G90 G94\nG0 X0 Y0 Z5\nG1 X9 F600\nG81 X1 Y1 Z-3 R2\nG80\nG0 X0 Y0\nG1 X9\nZ0\nX0\nM2\n"
    >>> unknown_motions(read_program(lines, "cycle")).tolist()
    [False, False, True, True, True, False]
    """
    motions = program.motions
    if not motions.chain.size:
        return np.zeros(0, dtype=np.bool_)
    open_start, before = np.isnan(motions.start), np.zeros(motions.start.shape, dtype=np.bool_)
    before[1:] = np.maximum.accumulate(~np.isnan(motions.end), axis=0)[:-1]
    found = np.asarray((open_start & before).any(axis=1))
    for one in program.breaks:
        if one.kind == _PASSED and 0 < one.motion < found.size:
            jump = motions.start[one.motion] - motions.end[one.motion - 1]
            found[one.motion] |= bool((np.abs(jump) > _APART).any())
    return found


def unknown_lines(program: PartProgram) -> tuple[tuple[int, int], ...]:
    """Return the first and the last line (from 0) of stretches in which it is not known where the axes are."""
    motions = program.motions
    found = []
    for number in np.unique(motions.chain[unknown_motions(program)]).tolist():
        rows = np.flatnonzero((motions.chain == number) & unknown_motions(program))
        begins = [one.block for one in program.breaks if one.motion <= rows[0]]
        found.append((max(begins), int(motions.block[rows[-1]])))
    return tuple(found)


def rows_before(program: PartProgram, motion: Array, starts: Array, place: Array) -> BoolArray:
    """Find the rows of a real controller's run before the first stretch that is not understood, which it runs too.

    Parameters
    ----------
    program : PartProgram
    motion, starts : Array, shape (legs,) and (legs + 1,)
        Motion of each leg of its path, and where the legs begin and the last one ends [m].
    place : Array, shape (rows,)
        Where each row belongs along the path [m].
    """
    before = np.ones(place.size, dtype=np.bool_)
    legs = np.flatnonzero(unknown_motions(program)[motion.astype(np.int64)])
    if legs.size:
        reached = np.flatnonzero(place >= starts[legs[0]] - NEAR)
        before[reached[0] if reached.size else place.size :] = False
    return before


NEAR: Final = 1e-4
"""Distance [m] from the end of what is known within which a run counts as having come there."""


def known_rows(program: PartProgram, motion: IntArray, position: Array, cuts: BoolArray, gaps: Array) -> BoolArray:
    """Find the rows of a command whose place, and the sides of the axes that cut there, are known.

    Parameters
    ----------
    program : PartProgram
        Whose path it is.
    motion : IntArray, shape (rows,)
        The program's motion that each row belongs to.
    position : Array, shape (rows, axes)
        Of the command [m].
    cuts : BoolArray, shape (rows,)
        Rows that are no rapid motion.
    gaps : Array, shape (axes,)
        Largest backlash of each axis [m].

    Returns
    -------
    BoolArray, shape (rows,)
    """
    unknown = unknown_motions(program)
    known = np.ones(motion.size, dtype=np.bool_)
    if not unknown.any():
        return known
    chain = program.motions.chain[motion]
    for number in np.unique(program.motions.chain[unknown]).tolist():
        rows = np.flatnonzero(chain == number)
        lost = np.flatnonzero(unknown[motion[rows]])
        begin = int(lost[-1]) + 1 if lost.size else 0
        known[rows[:begin]] = False
        known[rows[begin:]] = _taken_up(position[rows[begin:]], cuts[rows[begin:]], gaps)
    return known


def _taken_up(position: Array, cuts: BoolArray, gaps: Array) -> BoolArray:
    """Find the rows by which every axis that moves while it cuts has moved by more than its backlash."""
    if not cuts.any():
        return np.ones(len(position), dtype=np.bool_)
    way = np.maximum.accumulate(position, axis=0) - np.minimum.accumulate(position, axis=0)
    moves = np.ptp(position[cuts], axis=0) > gaps
    return np.asarray(((way > gaps) | ~moves).all(axis=1))
