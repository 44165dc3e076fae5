"""The path of a cutter beside a contour, for any radius, and how far a table with backlash leaves it in a crossing.

A control moves the centre of the cutter beside lines and arcs. At an outer corner it goes round it on an arc of the
cutter's radius, at an inner one as far as to where both pieces meet, which shortens them. A crossing on an arc divides
it into nearly tangential pieces: of its corners, too, some are outer and some inner ones, so that the cutter crosses
beside where the contour does, by half of its radius times the angle of the crossing. This module works out that path
itself, for every radius that a contour may have.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.edit.edits import CrossingEdit
from ph_post.gcode.program import ARC, Motions
from ph_post.types import Array

PLACES: Final = 0.5 - 0.5 * np.cos(np.linspace(0.0, math.pi, 33))
"""Shares of a piece at which the table is looked at, close together where pieces meet."""

RADII: Final = 9
"""Cutters that are looked at, from one of no radius to the largest."""

LEAST_KEPT: Final = 0.5
"""Part of a piece that the corners at its ends leave at least."""

CHORDS: Final = (0.25, 4.0)
"""Shortest and longest chord that is tried, in √(R g) of an arc's radius R and a backlash g, the length at which
half of the backlash is as much as the arc leaves the chord, four times over."""

TRIED: Final = 14

SPAN: Final = 2.0
"""Angle of the arc on which they are tried [rad]."""

QUARTER: Final = 0.25
"""Part of that arc on either side that a chord has at most."""

NEARLY: Final = 1e-9
"""Shares of a piece that are none."""

STRAIGHT: Final = 1e-7
"""Angles [rad] that are no corner."""

TANGENT: Final = 0.01
"""Turns [rad] of less than this are of pieces that touch: LinuxCNC holds them for one, too."""

STEPS: Final = 20
"""Steps by which it is found where two pieces meet."""

MEETS: Final = 1e-12
"""Distance of two places that are one [m]."""


class ContourPiece(msgspec.Struct, frozen=True, eq=False):
    """A line or an arc in a plane, of an `angle` [rad] about its `center`, 0 for a line; places (2,) [m]."""

    start: Array
    end: Array
    center: Array
    angle: float = 0.0

    @property
    def length(self) -> float:
        """Its length [m]."""
        if self.angle:
            return abs(self.angle) * float(np.linalg.norm(self.start - self.center))
        return float(np.linalg.norm(self.end - self.start))

    def at(self, shares: Array) -> Array:
        """Return places at shares of it (n,), shape (n, 2)."""
        if not self.angle:
            return np.asarray(self.start + shares[:, None] * (self.end - self.start))
        away = self.start - self.center
        turned = shares * self.angle
        return np.asarray(self.center + np.outer(np.cos(turned), away) + np.outer(np.sin(turned), _left(away)))

    def direction(self, share: float) -> Array:
        """Return its direction at a share of it, shape (2,)."""
        if not self.angle:
            return np.asarray((self.end - self.start) / max(self.length, MEETS))
        away = self.at(np.array([share]))[0] - self.center
        return np.asarray(math.copysign(1.0, self.angle) * _left(away) / np.linalg.norm(away))

    def part(self, low: float, high: float, shift: Array) -> ContourPiece:
        """Return the part between two shares, shifted."""
        ends = self.at(np.array([low, high])) + shift
        return ContourPiece(ends[0], ends[1], self.center + shift, self.angle * (high - low))

    def beside(self, left: float) -> ContourPiece | None:
        """Return the piece that lies beside it, so far to its `left` [m]; None where that is beyond an arc's centre."""
        if not self.angle:
            shift = left * _left(self.direction(0.0))
            return ContourPiece(self.start + shift, self.end + shift, self.center)
        radius = float(np.linalg.norm(self.start - self.center))
        factor = 1.0 - math.copysign(left / radius, left * self.angle)
        if factor <= 0.0:
            return None
        ends = [self.center + factor * (one - self.center) for one in (self.start, self.end)]
        return ContourPiece(ends[0], ends[1], self.center, self.angle)

    def distances(self, points: Array) -> Array:
        """Return the distances [m] of points (n, 2) from it."""
        ends = np.minimum(*(np.linalg.norm(points - one, axis=1) for one in (self.start, self.end)))
        if not self.angle:
            way, length = self.end - self.start, max(self.length, MEETS)
            beside = np.abs((points - self.start) @ _left(way)) / length
            share = (points - self.start) @ way / length**2
        else:
            first, away = self.start - self.center, points - self.center
            beside = np.abs(np.linalg.norm(away, axis=1) - np.linalg.norm(first))
            turned = np.arctan2(away @ _left(first), away @ first) * math.copysign(1.0, self.angle)
            share = np.mod(turned, 2.0 * math.pi) / abs(self.angle)
        return np.asarray(np.where((share >= 0.0) & (share <= 1.0), np.minimum(ends, beside), ends))


def cutter_path(pieces: Sequence[ContourPiece], left: float) -> tuple[list[ContourPiece], float] | None:
    """Return the path of a cutter beside pieces, its radius [m] to their `left`, or to their right where negative.

    Returns
    -------
    pieces : list of ContourPiece
        With those round outer corners.
    kept : float
        Part that is left at least of one of them between inner corners.

    None where the cutter does not fit into an arc, or where two pieces do not meet.
    """
    beside = [piece.beside(left) for piece in pieces]
    own = [one for one in beside if one is not None]
    if len(own) < len(beside):
        return None
    low, high = [0.0] * len(own), [1.0] * len(own)
    corners: dict[int, ContourPiece] = {}
    for n in range(len(own) - 1):
        into, out = pieces[n].direction(1.0), pieces[n + 1].direction(0.0)
        turn = math.atan2(into[0] * out[1] - into[1] * out[0], float(into @ out))
        if abs(turn) <= STRAIGHT or left == 0.0:
            continue
        if turn * left > 0.0:
            met = _meeting(own[n], own[n + 1], abs(left) * math.tan(0.5 * abs(turn)), abs(turn))
            if met is None:
                return None
            high[n], low[n + 1] = met
        else:
            about = pieces[n].end
            corners[n] = ContourPiece(about + left * _left(into), about + left * _left(out), about, turn)
    kept = min(end - begin for begin, end in zip(low, high, strict=True))
    if kept <= 0.0:
        return None
    found: list[ContourPiece] = []
    for n, one in enumerate(own):
        found.append(one.part(low[n], high[n], np.zeros(2)))
        found += [corners[n]] if n in corners else []
    return found, kept


def _left(way: Array) -> Array:
    return np.array([-way[1], way[0]])


def _meeting(one: ContourPiece, other: ContourPiece, shorter: float, turn: float) -> tuple[float, float] | None:
    """Return the shares at which two pieces meet, the first near its end, the other near its start."""
    size = np.array([one.length, other.length])
    if size.min() <= MEETS:
        return None
    at = np.array([1.0, 0.0]) + shorter * np.array([-1.0, 1.0]) / size
    if turn < TANGENT:
        # Whether pieces that touch meet is a matter of their rounding.
        return float(at[0]), float(at[1])
    for _ in range(STEPS):
        apart = one.at(at[:1])[0] - other.at(at[1:])[0]
        if float(np.linalg.norm(apart)) < MEETS:
            return float(at[0]), float(at[1])
        ways = np.column_stack([one.direction(at[0]) * size[0], -other.direction(at[1]) * size[1]])
        if abs(np.linalg.det(ways)) < MEETS * size.prod():
            return None
        at = at - np.linalg.solve(ways, apart)
    return None


def crossing_error(
    plain: Sequence[ContourPiece],
    crossed: Sequence[ContourPiece],
    left: float,
    column: int,
    offsets: tuple[Array, Array],
) -> tuple[float, float]:
    """Return how far a table leaves the cutter's path [m], and what is left of the shortest piece beside its own.

    Parameters
    ----------
    plain, crossed : sequences of ContourPiece
        Without the crossing, and with it.
    left : float
        Radius of the cutter [m], on the left; negative on the right.
    column : int
        Axis that crosses its backlash.
    offsets : tuple of Array, shape (2,)
        Of both axes before the crossing, and behind it [m].

    Returns
    -------
    error, kept : float
        Infinite, and 0, where the cutter does not fit.
    """
    nominal, made = cutter_path(plain, left), cutter_path(crossed, left)
    if nominal is None or made is None:
        return math.inf, 0.0
    motor = np.concatenate([piece.at(PLACES) for piece in made[0]])
    before, after = offsets
    table = motor - before
    low, high = sorted((float(before[column]), float(after[column])))
    held = float(table[0, column])
    for row, place in enumerate(motor[:, column].tolist()):
        held = min(max(held, place - high), place - low)
        table[row, column] = held
    return float(np.min([piece.distances(table) for piece in nominal[0]], axis=0).max()), made[1]


def crossing_worst(
    plain: Sequence[ContourPiece],
    crossed: Sequence[ContourPiece],
    side: int,
    column: int,
    offsets: tuple[Array, Array],
    largest: float,
) -> float:
    """Return the largest error [m] of a crossing for all cutters up to a radius; infinite where one is in its way.

    That is where less than half of a piece would be left: how controls judge what they cannot reach differs.
    """
    worst = 0.0
    for radius in np.linspace(0.0, largest, RADII).tolist():
        error, kept = crossing_error(plain, crossed, side * radius, column, offsets)
        if kept < LEAST_KEPT:
            return math.inf
        worst = max(worst, error)
    return worst


def safe_chord(radius: float, inner: bool, gap: float, largest: float, allowed: float) -> float:
    """Return how long a chord on an arc is on which all cutters cross their backlash best [m], 0 for none.

    Parameters
    ----------
    radius : float
        Of the arc [m].
    inner : bool
        Whether the cutter is on the side of its centre.
    gap : float
        The backlash [m].
    largest : float
        Largest radius of a cutter [m].
    allowed : float
        Largest error [m].
    """
    side, center = (1 if inner else -1), np.array([0.0, radius])
    away = radius * np.array([math.sin(0.5 * SPAN), -math.cos(0.5 * SPAN)])
    plain = [ContourPiece(center + away * np.array([-1.0, 1.0]), center + away, center, SPAN)]
    before = np.array([0.0, -0.5 * gap])
    best, found = allowed, 0.0
    for length in (math.sqrt(radius * gap) * np.geomspace(*CHORDS, TRIED)).tolist():
        half = 0.5 * length / (radius * SPAN)
        if half > QUARTER:
            break
        ends = plain[0].at(np.array([0.5 - half, 0.5 + half]))
        crossed = [
            plain[0].part(0.0, 0.5 - half, before),
            ContourPiece(ends[0] + before, ends[1] - before, center),
            plain[0].part(0.5 + half, 1.0, -before),
        ]
        error = crossing_worst(plain, crossed, side, 1, (before, -before), largest)
        if error < best:
            best, found = error, length
    return found


def crossing_fits(
    motions: Motions,
    crossing: CrossingEdit,
    around: tuple[float, float],
    before: Array,
    side: int,
    column: int,
    largest: float,
) -> float:
    """Return the largest error [m] of a crossing on a contour for all cutters up to a radius; infinite for none.

    Parameters
    ----------
    motions : Motions
    crossing : CrossingEdit
    around : tuple of float
        Between which places, as the number of a motion and a share of it, the contour is the crossing's own.
    before : Array, shape (2,)
        Offset of both axes ahead of it [m].
    side : int
        1 for a cutter on the left.
    column : int
        The crossing's axis.
    largest : float
        Largest radius of a cutter [m].
    """
    first, last = math.floor(around[0]), math.ceil(around[1]) - 1
    plain, shares = [], []
    for k in range(first, last + 1):
        shares.append((max(around[0] - k, 0.0), min(around[1] - k, 1.0)))
        arc = motions.kind[k] == ARC
        whole = ContourPiece(
            motions.start[k, :2],
            motions.end[k, :2],
            motions.center[k] if arc else np.zeros(2),
            float(motions.angle[k]) if arc else 0.0,
        )
        plain.append(whole.part(*shares[-1], np.zeros(2)))
    crossed: list[ContourPiece] = []
    shift, at = before, plain[0].start + before
    parts = iter([*crossing.parts, None])
    part = next(parts)
    for k, piece in enumerate(plain, start=first):
        (begin, end), low = shares[k - first], 0.0

        def own(share: float, begin: float = begin, end: float = end) -> float:
            return (share - begin) / (end - begin)

        while part is not None and part.motion == k:
            if own(part.low) > low + NEARLY:
                crossed.append(piece.part(low, own(part.low), shift))
                at = crossed[-1].end
            low, shift = own(part.high), part.added[:2]
            there = piece.part(own(part.low), low, shift)
            crossed.append(ContourPiece(at, there.end, np.zeros(2)) if part.line else there)
            at, part = there.end, next(parts)
        if low < 1.0 - NEARLY:
            crossed.append(piece.part(low, 1.0, shift))
            at = crossed[-1].end
    return crossing_worst(plain, crossed, side, column, (before, shift), largest)
