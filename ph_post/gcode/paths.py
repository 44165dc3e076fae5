"""Paths of a part program: one for each chain that cuts, with the place of each motion on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import PurePath
from typing import Final

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.gcode.assembly import assemble
from ph_post.gcode.motion_parts import chord_lengths
from ph_post.gcode.program import (
    ARC,
    AXES,
    CUBIC,
    NURBS,
    PLANE_AXES,
    RAPID,
    Motions,
    PartProgram,
    PlaceArray,
    chain_heads,
    in_a_row,
)
from ph_post.geometry.piecewise import MEETS, PiecewiseCurve
from ph_post.types import Array, BoolArray, IntArray, Path
from ph_post.units import MM


class ProgramPath(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The path of one chain of a program, and where on it each motion is.

    `motion` (k,) are the numbers of the chain's motions that go anywhere, in order; `s` (k + 1,) [m] the arc
    length of the path at the beginning of each, and at the end of the last. Where moves were fitted, that is
    the place on the curve nearest to the end of the move. `cubics` are the curves of G5 and G5.1 by row: of
    those a share is a part of the parameter, of other motions one of the length (of arcs the angle).
    `warnings` say what of the chain was left out.
    """

    path: Path
    chain: int
    motion: PlaceArray
    s: Array
    cubics: Mapping[int, PiecewiseCurve] = {}
    warnings: tuple[str, ...] = ()

    def to_motions(self, s: Array) -> tuple[IntArray, Array]:
        """Return the motions at arc lengths `s` [m], shape (n,), and the share (0 to 1) of each.

        At a joint the earlier motion answers, with share 1.
        """
        s = np.clip(np.asarray(s, dtype=np.float64), self.s[0], self.s[-1])
        row = np.clip(np.searchsorted(self.s, s - MEETS, side="right") - 1, 0, self.motion.size - 1)
        share = (s - self.s[row]) / (self.s[row + 1] - self.s[row])
        near = np.abs(s - self.s[row + 1]) <= MEETS
        share = np.where(near, 1.0, np.clip(share, 0.0, 1.0))
        for number, curve in self._on_cubics(row):
            on = (row == number) & ~near
            share[on] = curve.parameter(share[on] * curve.length)
        return self.motion[row].astype(np.int64), share

    def to_path(self, motion: IntArray, share: Array) -> Array:
        """Return the arc lengths [m] of shares of motions; of a motion that goes nowhere, the end of the one before."""
        row = np.searchsorted(self.motion, motion.astype(self.motion.dtype))
        found = (row < self.motion.size) & (self.motion[np.minimum(row, self.motion.size - 1)] == motion)
        share = np.array(share, dtype=np.float64)
        for number, curve in self._on_cubics(row):
            on = row == number
            share[on] = curve.arc_length(share[on]) / curve.length
        low, high = self.s[row], self.s[np.minimum(row + 1, self.motion.size)]
        return np.where(found, low + share * (high - low), low)

    def _on_cubics(self, row: IntArray) -> list[tuple[int, PiecewiseCurve]]:
        """Curves of those rows that are cubics."""
        return [(number, self.cubics[number]) for number in sorted(set(self.cubics) & set(row.tolist()))]


FIT_TOLERANCE: Final = 1e-3 * MM
"""How far vertices may be off a fitted curve [m] where the user names nothing: programs of three decimals
round each coordinate by half of it."""


def paths_of(program: PartProgram, tolerance: float = FIT_TOLERANCE) -> tuple[ProgramPath, ...]:
    """Read the path of every chain of a program that cuts anything.

    Arcs, cubics and NURBS are exact; runs of short straight moves are fitted; rapids are straight rapid
    segments. A path has the axes that move, and begins where their positions are known.

    Parameters
    ----------
    program : PartProgram
    tolerance : float
        How far the ends of straight moves may be off a fitted curve [m].

    Returns
    -------
    tuple of ProgramPath
        In the order of the program; without those that :func:`chains_without_feed` names.
    """
    found = []
    for chain, every in _chains(program.motions):
        rows, warnings = _known(program, every)
        cuts = (program.motions.kind[_goes(program.motions, rows)] != RAPID).any()
        if cuts and not _lacks_feed(program.motions, rows):
            found.append(_path(program, chain, rows, tolerance, warnings))
    return tuple(found)


def chains_without_feed(program: PartProgram) -> tuple[str, ...]:
    """Name the chains whose motion is known but not its speed: they have no path."""
    motions = program.motions
    return tuple(
        f"{program.name}:{program.line_number(motions.block[rows[0]])}: from here on the feed is not known (G95, or no"
        " F): left as it is"
        for _, rows in _chains(motions)
        if _lacks_feed(motions, rows)
    )


def main_path(program: PartProgram) -> tuple[ProgramPath, tuple[str, ...]]:
    """Return the longest path of a program, and words about what it does not show.

    Raises
    ------
    InputError
        Where the program cuts nothing whose path and feed are known.
    """
    paths = paths_of(program)
    words = chains_without_feed(program)
    if not paths:
        got = words[0] if words else "no such motion"
        raise InputError(program.name, "no path", expected="motions G1, G2, G3 or G5 with a feed", got=got)
    longest = max(paths, key=lambda one: float(one.s[-1]))
    others = [
        f"{program.line_words(first, last)}: a path of its own, {one.s[-1] / MM:.6g} mm, which is not shown"
        for one in paths
        if one is not longest
        for first, last in [program.motions.block[one.motion[[0, -1]]].tolist()]
    ]
    return longest, (*longest.warnings, *others, *words)


SHOWN: Final = 3
"""Places that a warning names."""


def places_words(program: PartProgram, spans: Sequence[tuple[int, int]]) -> str:
    r"""Name the first few of some stretches of lines, each from its first to its last one, and count the others.

    Examples
    --------
    >>> from ph_post.gcode.read import read_program
    >>> places_words(read_program(b"G1\n" * 12, "a.ngc"), [(2, 2), (4, 6), (8, 9), (11, 11)])
    'line 3, lines 5 to 7, lines 9 to 10 and 1 more place'
    """
    left = len(spans) - SHOWN
    more = f" and {left} more place{'s' if left > 1 else ''}" if left > 0 else ""
    return ", ".join(program.line_words(*one) for one in spans[:SHOWN]) + more


def _chains(motions: Motions) -> list[tuple[int, PlaceArray]]:
    """Chains and their motions; a chain's motions follow each other."""
    if motions.chain.size == 0:
        return []
    heads = np.flatnonzero(chain_heads(motions.chain))
    parts = np.split(np.arange(motions.chain.size, dtype=np.int32), heads[1:])
    return [(int(motions.chain[rows[0]]), rows) for rows in parts]


def _known(program: PartProgram, rows: PlaceArray) -> tuple[PlaceArray, tuple[str, ...]]:
    """Leave out the motions before the axes that move are all known, or those from where the last of them is.

    A plotter's program may name Z at its end alone: the path is what it draws before.
    """
    motions = program.motions
    own = in_a_row(rows)
    start, end = motions.start[own], motions.end[own]
    moves = ~(start == end).all(axis=0) & ~np.isnan(end[-1])
    unknown = np.flatnonzero(np.isnan(start[:, moves]).any(axis=1))
    if not unknown.size:
        return rows, ()
    kept = rows[unknown[-1] + 1 :]
    late = moves & np.isnan(start[unknown[-1]])
    before = int(np.argmax(~np.isnan(end[:, late]).all(axis=1)))
    if before > kept.size:
        found, said = _known(program, rows[:before])
        return found, (*said, *_left_out(program, rows[before:], "all axes are placed there alone"))
    return kept, _left_out(program, rows[: unknown[-1] + 1], "where the axes are is not known yet")


def _left_out(program: PartProgram, rows: PlaceArray, why: str) -> tuple[str, ...]:
    """Say that motions are not in a path, where any of them cuts."""
    motions = program.motions
    if (motions.kind[rows] == RAPID).all():
        return ()
    return (f"{program.line_words(*motions.block[rows[[0, -1]]].tolist())}: {why}: left out of the path",)


def _goes(motions: Motions, rows: PlaceArray) -> PlaceArray:
    """Return the motions that go somewhere."""
    own = in_a_row(rows)
    apart = chord_lengths(motions, own) > MEETS
    kind = motions.kind[own]
    bent = (kind == CUBIC) | (kind == NURBS) | ((kind == ARC) & (motions.angle[own] != 0.0))
    goes = apart | bent
    return rows if goes.all() else np.asarray(rows[goes])


def without_feed(program: PartProgram) -> BoolArray:
    """Mask of the motions (m,) that cut at a feed that is not known: with G95, or where no F was given yet."""
    return _without_feed(program.motions, slice(None))


def _without_feed(motions: Motions, rows: PlaceArray | slice) -> BoolArray:
    if not np.isnan(motions.feeds.value).any():
        return np.zeros(motions.kind[rows].size, dtype=np.bool_)
    known = (motions.kind[rows] == RAPID) | (motions.duration[rows] > 0.0)
    return np.asarray(~known & np.isnan(motions.feeds.of(rows)))


def _lacks_feed(motions: Motions, rows: PlaceArray) -> bool:
    return bool(_without_feed(motions, in_a_row(rows)).any())


def _columns(motions: Motions, rows: PlaceArray) -> tuple[int, ...]:
    """Columns of the axes that move, at least two."""
    own = in_a_row(rows)
    moving = (motions.start[own] != motions.end[own]) & ~np.isnan(motions.end[own])
    found = set(np.flatnonzero(moving.any(axis=0)).tolist())
    if np.isin(motions.kind[own], (CUBIC, NURBS)).any():
        found |= {0, 1}
    for plane in set(motions.plane[rows[motions.kind[rows] == ARC]].tolist()):
        found |= {*PLANE_AXES[plane][:2]}
    for axis in (0, 1, 2):
        if len(found) < 2:
            found.add(axis)
    return tuple(sorted(found))


def _path(
    program: PartProgram, chain: int, rows: PlaceArray, tolerance: float, warnings: tuple[str, ...]
) -> ProgramPath:
    motions = program.motions
    rows = _goes(motions, rows)
    columns = _columns(motions, rows)
    segments, s, cubics = assemble(motions, rows, columns, tolerance)
    feeds = [one.feed for one in segments if one.feed is not None]
    path = Path(
        name=PurePath(program.name).stem,
        source="part program",
        axes=tuple(AXES[column] for column in columns),
        feed=max(feeds),
        closed=False,
        segments=segments,
        digest=program.digest,
        lines=(s[1:], rows, motions.block),
    )
    return ProgramPath(path=path, chain=chain, motion=rows, s=s, cubics=cubics, warnings=warnings)
