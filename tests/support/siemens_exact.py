"""How far a SINUMERIK program is off the path and the feeds that it was made from, in exact numbers."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import hypot

import mpmath
import msgspec
import numpy as np

from support.exact_paths import Piece, bernstein, minus, times
from support.planned import Planned
from support.sinumerik import Block, read_blocks

NODES, WEIGHTS = np.polynomial.legendre.leggauss(16)
PANELS = 64
FINE = 2**110
SAME = 1e-11
"""Places are one within this [m]: what the rounding of coordinates makes of the length of a program."""

SHARES = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, 33))
JOINT = 1e-9
"""A block that ends nearer than this to the end of a piece ends there [mm]."""


class Cut(msgspec.Struct, frozen=True, kw_only=True):
    """A block that moves along the path, with the offset carried there [mm]; `line` is its line's number."""

    block: Block
    line: int
    offset: list[Fraction]


def cuts_of(text: str, axes: Sequence[str], first: Sequence[Fraction]) -> list[Cut]:
    """Blocks on the path, which run under G641: without the jogs, which write the axis alone that they move.

    The offset is what the first of them is away from where the path begins, and then what jogs add to it.
    """
    found: list[Cut] = []
    offset, begun = [Fraction(0)] * len(axes), False
    lines = text.splitlines()
    moves = read_blocks(text)
    for number, line in enumerate(lines):
        words = line.split(";")[0].split()
        begun = words[0] == "G641" if words and words[0] in ("G60", "G641") else begun
        if not words or words[0] not in ("G0", "G1", "G2", "G3", "POLY"):
            continue
        block = next(moves)
        named = sum(word[0] in axes for word in words[1:])
        if not begun:
            continue
        if not found:
            offset = [block.start[axis] - place for axis, place in zip(axes, first, strict=True)]
        if words[0] == "G1" and named < len(axes):
            shift = [block.end[axis] - block.start[axis] for axis in axes]
            offset = [a + b for a, b in zip(offset, shift, strict=True)]
        else:
            found.append(Cut(block=block, line=number, offset=offset))
    return found


def foot(piece: Piece, point: Sequence[Fraction], guess: float) -> Fraction:
    """Parameter of a piece's point nearest to one that is close to it, to 33 digits, as a fraction."""
    with mpmath.workdps(50):
        u = mpmath.mpf(guess)
        above = [[_mp(c) for c in row] for row in piece.above]
        below, places = [_mp(c) for c in piece.below], [_mp(c) for c in point]
        for _ in range(40):
            under, bend = mpmath.polyval(below[::-1], u, derivative=1)
            off, slope = [], []
            for row, place in zip(above, places, strict=True):
                over, rise = mpmath.polyval(row[::-1], u, derivative=1)
                off.append(place - over / under)
                slope.append((rise * under - over * bend) / under**2)
            step = sum(a * b for a, b in zip(off, slope, strict=True)) / sum(b * b for b in slope)
            u += step
            if abs(step) < mpmath.mpf(10) ** -35:
                break
        return Fraction(int(mpmath.nint(u * FINE)), FINE)


def _mp(value: Fraction) -> mpmath.mpf:
    return mpmath.mpf(value.numerator) / value.denominator


def apart(block: Block, axes: Sequence[str], offset: Sequence[Fraction], part: Piece) -> float:
    """Bound for the distance of a block from a part of a piece at equal parameters, wherever those are [mm].

    The difference of two quotients in Bernstein form: its coefficients bound it everywhere.
    """
    square = 0.0
    for axis, shift, row in zip(axes, offset, part.above, strict=True):
        own = minus(block.above[axis], [shift * c for c in block.below])
        difference = minus(times(own, part.below), times(row, block.below))
        square += float(max(map(abs, bernstein(difference)))) ** 2
    return square**0.5 / float(min(bernstein(part.below)) * min(bernstein(block.below)))


class Walk:
    """Follows POLY blocks along the pieces of a path.

    `worst` is how far they are off it [mm], `parts` are by line the part of a piece that each is, and the
    offset carried there.
    """

    def __init__(self, axes: Sequence[str], pieces: Sequence[Piece]) -> None:
        self.axes, self.pieces = axes, pieces
        self.number, self.u = 0, Fraction(0)
        self.worst = 0.0
        self.parts: dict[int, tuple[Piece, list[Fraction]]] = {}

    def polynomial(self, cut: Cut) -> None:
        """A POLY block, which lies on one piece, from where the last one ended on it."""
        if self._left() < JOINT:
            self.number, self.u = self.number + 1, Fraction(0)
        piece = self.pieces[self.number]
        first, last = (self._point(cut, p) for p in (Fraction(0), Fraction(1)))
        low = foot(piece, first, float(self.u))
        assert abs(low - self.u) * _speed(piece, float(low)) < JOINT
        high = foot(piece, last, _ahead(piece, cut.block, self.axes, float(low)))
        assert low < high
        part = piece.part(low, high)
        self.parts[cut.line] = part, cut.offset
        self.worst = max(self.worst, apart(cut.block, self.axes, cut.offset, part))
        self.u = high
        assert self._left() > -JOINT

    def finish(self) -> None:
        """Nothing of the path is left."""
        assert self.number == len(self.pieces) - 1
        assert self._left() < JOINT

    def _left(self) -> float:
        return float(1 - self.u) * _speed(self.pieces[self.number], 1.0)

    def _point(self, cut: Cut, p: Fraction) -> list[Fraction]:
        place = dict(zip(cut.block.above, cut.block.at(p), strict=True))
        return [place[axis] - shift for axis, shift in zip(self.axes, cut.offset, strict=True)]


def _speed(piece: Piece, u: float) -> float:
    """Length of the derivative with respect to the parameter [mm]."""
    at = np.array([u])
    below, bend = _values(piece.below, at), _values(_slope(piece.below), at)
    square = [((_values(_slope(row), at) * below - _values(row, at) * bend) / below**2) ** 2 for row in piece.above]
    return float(np.sqrt(np.sum(square)))


def _ahead(piece: Piece, block: Block, axes: Sequence[str], low: float) -> float:
    """Parameter at which a piece has run as far from `low` as a block is long."""
    u = np.linspace(low, 1.0, 2001)
    s = _run(np.array([_values(row, u) for row in piece.above]) / _values(piece.below, u))
    p = np.linspace(0.0, 1.0, 65)
    length = _run(np.array([_values(block.above[axis], p) for axis in axes]) / _values(block.below, p))[-1]
    return float(np.interp(length, s, u))


def _run(points: np.ndarray) -> np.ndarray:
    return np.append(0.0, np.cumsum(np.sqrt((np.diff(points, axis=1) ** 2).sum(axis=0))))


def _values(row: Sequence[Fraction], u: np.ndarray) -> np.ndarray:
    return np.polyval([float(c) for c in reversed(row)], u)


def length_of(block: Block, axes: Sequence[str]) -> float:
    """Length of a block [mm], by quadrature; of arcs in closed form."""
    if block.center is not None:
        start, end = ([float(place[a] - block.center[a]) for a in "XY"] for place in (block.start, block.end))
        cross, dot = start[0] * end[1] - start[1] * end[0], start[0] * end[0] + start[1] * end[1]
        angle = (block.turn * np.arctan2(cross, dot)) % (2.0 * np.pi)
        return 0.5 * (hypot(*start) + hypot(*end)) * angle
    p = ((np.arange(PANELS)[:, None] + 0.5 + 0.5 * NODES) / PANELS).ravel()
    below, bend = _values(block.below, p), _values(_slope(block.below), p)
    square = np.zeros(p.size)
    for axis in axes:
        row = block.above[axis]
        square += ((_values(_slope(row), p) * below - _values(row, p) * bend) / below**2) ** 2
    return float((np.tile(WEIGHTS, PANELS) * np.sqrt(square)).sum() / (2 * PANELS))


def _slope(power: Sequence[Fraction]) -> list[Fraction]:
    return [k * c for k, c in enumerate(power)][1:] or [Fraction(0)]


def _at_rests(places: np.ndarray, rests: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Places, moved onto the rests that they are at, and which are at one."""
    if not rests.size:
        return places, np.zeros(places.size, dtype=bool)
    off = np.abs(places[:, None] - rests)
    near = off.argmin(axis=1)
    still = off.min(axis=1) <= SAME
    return np.where(still, rests[near], places), still


class Followed(msgspec.Struct, frozen=True, kw_only=True):
    """How the feeds of a program follow a plan.

    `worst` deviation as a part of the planned feed there, of blocks that are not beside a rest; `changing`
    number of those in which the feed changes; `beside` durations [s] and lengths [mm] of those beside a rest.
    """

    worst: float
    changing: int
    beside: list[tuple[float, float]]


def follow(cuts: Sequence[Cut], axes: Sequence[str], plan: Planned) -> Followed:
    """Compare feeds at equal places, at 33 of every block; each begins in feed where the one before ended."""
    length = np.array([length_of(cut.block, axes) for cut in cuts])
    ends = 1e-3 * np.cumsum(length)
    first, starts = _at_rests(np.append(0.0, ends[:-1]), plan.rests)
    last, stops = _at_rests(ends, plan.rests)
    begin, end = plan.times_at(first, late=True), plan.times_at(last, late=False)
    end[-1] = plan.end
    t = begin[:, None] + (end - begin)[:, None] * SHARES
    s, speed = 1e3 * plan.place(t), 6e4 * plan.speed(t)
    p = np.clip((s - s[:, :1]) / (s[:, -1:] - s[:, :1]), 0.0, 1.0)
    rests = starts | stops
    worst = 0.0
    for i in np.flatnonzero(~rests).tolist():
        feed = cuts[i].block.feed
        assert feed is not None
        worst = max(worst, float(np.abs(_values(feed, p[i]) / speed[i] - 1.0).max()))
    beside = [(float(end[i] - begin[i]), float(length[i])) for i in np.flatnonzero(rests).tolist()]
    return Followed(worst=worst, changing=int((~rests & (np.ptp(speed, axis=1) > 0)).sum()), beside=beside)
