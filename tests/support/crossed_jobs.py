"""Jobs of many kinds for the generator of programs with crossings on the fly."""

from __future__ import annotations

import math
from dataclasses import replace

from support.crossed import Crossing, Geometry, Job, Move, Style

PLAIN = Style()
OFFSET = 0.025
BOTH = (-OFFSET, OFFSET)
HALF = 0.2
"""Half a crossing's length on an arc of 20 mm."""

DIAGONAL = 14.1421


def _begins(moves: list[Move], k: int) -> float:
    return float(Geometry(moves).begins[k])


def circle(style: Style = PLAIN, *, lead: bool = False, words: str = "") -> Job:
    """A full circle from 225 degrees, counterclockwise, with both axes."""
    start = (-DIAGONAL, -DIAGONAL)
    moves = [
        Move((-30.0, 0.0, 0.0), "rapid"),
        Move((*start, 0.0), "rapid"),
        Move((*start, -1.0), feed=200.0),
        Move((*start, -1.0), "arc", 1200.0, (0.0, 0.0, 0.0), +1, behind=words),
        Move((*start, 5.0), "rapid"),
        Move((0.0, 0.0, 5.0), "rapid"),
    ]
    begin, quarter = _begins(moves, 3), math.hypot(*start) * math.pi / 2
    turns = (("Y", 1), ("X", -1), ("Y", -1), ("X", 1))
    bulge = HALF**2 / 20 / 4
    crossings = [
        Crossing(axis, sign, s - HALF, s + HALF, bulge if lead else 0.0, HALF * 0.71 if lead else 0.0)
        for n, (axis, sign) in enumerate(turns)
        for s in [begin + (n + 0.5) * quarter]
    ]
    shifts = {1: {"X": OFFSET, "Y": -OFFSET}, 5: {"X": 0.0, "Y": 0.0}}
    return Job(moves, {"X": BOTH, "Y": BOTH}, shifts, crossings, style)


def on_reversal(style: Style = PLAIN) -> Job:
    """Two full circles, one after the other, that begin where X turns; Y is not compensated."""
    moves = [
        Move((20.0, 0.0, 0.0), "rapid"),
        Move((20.0, 0.0, 0.0), "arc", 1000.0, (0.0, 0.0, 0.0), +1),
        Move((20.0, 0.0, 0.0), "arc", 1000.0, (0.0, 0.0, 0.0), +1),
        Move((0.0, 0.0, 0.0), "rapid"),
    ]
    begin, turn = _begins(moves, 1), 40.0 * math.pi
    places = [(1, begin + 0.5 * turn), (-1, begin + turn), (1, begin + 1.5 * turn)]
    crossings = [Crossing("X", sign, s - HALF, s + HALF) for sign, s in places]
    return Job(moves, {"X": BOTH}, {0: {"X": -OFFSET}, 3: {"X": 0.0}}, crossings, style)


def by_radius(style: Style = PLAIN) -> Job:
    """A half circle by its radius, which X turns in, and a line."""
    moves = [
        Move((0.0, -20.0, 0.0), "rapid"),
        Move((0.0, 20.0, 0.0), "arc", 1000.0, (0.0, 0.0, 0.0), +1, radius=True),
        Move((-10.0, 20.0, 0.0), feed=1000.0),
        Move((0.0, 0.0, 0.0), "rapid"),
    ]
    s = _begins(moves, 1) + 10.0 * math.pi
    return Job(moves, {"X": BOTH}, {0: {"X": OFFSET}, 3: {"X": 0.0}}, [Crossing("X", -1, s - HALF, s + HALF)], style)


def helix(style: Style = PLAIN) -> Job:
    """Two turns down, X and Y."""
    job = circle(style)
    moves = list(job.moves)
    moves[3] = replace(moves[3], end=(*moves[3].end[:2], -3.0))
    moves[4:] = [Move((*moves[3].end[:2], 5.0), "rapid"), Move((0.0, 0.0, 5.0), "rapid")]
    flat, long = Geometry(job.moves), Geometry(moves)
    begin = float(flat.begins[3])
    ratio = float((long.ends[3] - long.begins[3]) / (flat.ends[3] - begin))
    crossings = [
        replace(one, low=begin + (one.low - begin) * ratio, high=begin + (one.high - begin) * ratio)
        for one in job.crossings
    ]
    return replace(job, moves=moves, crossings=crossings)


def plane(number: int) -> Job:
    """A full circle in another plane, with an offset of X or Y and of Z to one side."""
    axes = {18: (2, 0), 19: (1, 2)}[number]
    start = [0.0, 0.0, 0.0]
    start[axes[0]] = start[axes[1]] = -DIAGONAL
    moves = [
        Move((0.0, 0.0 if number == 18 else -30.0, 10.0), "rapid"),
        Move((*start[:2], 10.0), "rapid"),
        Move((*start[:2], -DIAGONAL), feed=300.0),
        Move(tuple(start), "arc", 800.0, (0.0, 0.0, 0.0), +1, plane=number),
        Move((*start[:2], 10.0), "rapid"),
        Move((0.0, 0.0, 10.0), "rapid"),
    ]
    begin, quarter = _begins(moves, 3), math.hypot(DIAGONAL, DIAGONAL) * math.pi / 2
    first, second = ("XYZ"[a] for a in axes)
    # From 225 degrees: the second axis falls, and the first rises.
    turns = [(second, 1), (first, -1), (second, -1), (first, 1)]
    sides = {axis: (0.0, 2 * OFFSET) if axis == "Z" else BOTH for axis in (first, second)}
    crossings = [
        Crossing(axis, sign, s - HALF, s + HALF)
        for n, (axis, sign) in enumerate(turns)
        for s in [begin + (n + 0.5) * quarter]
    ]
    other = "X" if number == 18 else "Y"
    if number == 18:  # Z is the first axis: it rises from the start, after it was plunged
        crossings = [Crossing("Z", 1, begin, begin + 0.0), *crossings]
    shifts = {1: {other: -OFFSET if number == 18 else OFFSET}, 4: {"Z": 0.0}, 5: {other: 0.0}}
    return Job(moves, sides, shifts, crossings, Style(head=(f"G21 G90 G{number} G94",)))


def ellipse(count: int = 400, style: Style = PLAIN) -> Job:
    """An ellipse of short lines, from the bottom, whose X turns at its sides; its own points are shifted gradually."""
    angles = [2 * math.pi * n / count - math.pi / 2 for n in range(count + 1)]
    points = [(round(15 * math.cos(one), 4), round(9 * math.sin(one), 4), 0.0) for one in angles]
    moves = [
        Move(points[0], "rapid"),
        *(Move(point, feed=1500.0) for point in points[1:]),
        Move((0.0, 0.0, 0.0), "rapid"),
    ]
    way = Geometry(moves)
    crossings = []
    for sign, middle in ((-1, count // 4), (1, 3 * count // 4)):
        low, high = float(way.ends[middle - 1]), float(way.ends[middle + 1])
        crossings.append(Crossing("X", sign, low, high, steps=2))
    return Job(moves, {"X": BOTH}, {0: {"X": OFFSET}, len(moves) - 1: {"X": 0.0}}, crossings, style)


def pocket(style: Style = PLAIN, *, on_edges: bool = False, scale: float = 1.0) -> Job:
    """Two turns of a rectangle: crossings in its corners, by single axes, or on the edges behind them."""
    corners = [(20.0, 0.0), (20.0, 12.0), (0.0, 12.0), (0.0, 0.0)]
    corners = [(x * scale, y * scale) for x, y in corners]
    moves = [
        Move((0.0, 0.0, 0.0), "rapid"),
        *(Move((*corner, 0.0), feed=800.0 * scale) for _ in range(2) for corner in corners),
        Move((0.0, -5.0 * scale, 0.0), feed=800.0 * scale),
        Move((0.0, 0.0, 0.0), "rapid"),
    ]
    way, offset = Geometry(moves), OFFSET * scale
    # X turns along the second and the fourth edge, Y along the first and the third; the first begins with both known.
    turns = {2: ("X", -1), 3: ("Y", -1), 4: ("X", 1), 5: ("Y", 1), 6: ("X", -1), 7: ("Y", -1)}
    crossings = []
    for k, (axis, sign) in turns.items():
        begin = float(way.begins[k])
        low, high = (begin + 3.0 * scale, begin + 3.6 * scale) if on_edges else (begin, begin)
        crossings.append(Crossing(axis, sign, low, high))
    both = (-offset, offset)
    shifts = {0: {"X": offset, "Y": offset}, len(moves) - 1: {"X": 0.0, "Y": 0.0}}
    return Job(moves, {"X": both, "Y": both}, shifts, crossings, style)


def corner() -> Job:
    """A sharp corner in which both axes turn at once."""
    moves = [
        Move((0.0, 0.0, 0.0), "rapid"),
        Move((10.0, 8.0, 0.0), feed=700.0),
        Move((0.0, 6.0, 0.0), feed=700.0),
        Move((0.0, 0.0, 0.0), "rapid"),
    ]
    at = float(Geometry(moves).ends[1])
    crossings = [Crossing("X", -1, at, at), Crossing("Y", -1, at, at)]
    shifts = {0: {"X": OFFSET, "Y": OFFSET}, 3: {"X": 0.0, "Y": 0.0}}
    return Job(moves, {"X": BOTH, "Y": BOTH}, shifts, crossings)


def approached() -> Job:
    """A first use of both axes, wound up by the rapid."""
    return replace(
        circle(),
        approaches={1: {"X": -0.06, "Y": 0.06}},
        facts=("(ph-post: take-up X 0.06 mm)", "(ph-post: take-up Y 0.06 mm)"),
    )


def commands() -> Job:
    """Two arcs, with spindle, coolant, comment and dwell between and beside them."""
    moves = [
        Move((0.0, -20.0, 0.0), "rapid", lines=("T1 M6", "S8000 M3")),
        Move((DIAGONAL, DIAGONAL, 0.0), "arc", 1000.0, (0.0, 0.0, 0.0), +1, before="M8", behind="(half)"),
        Move((0.0, 20.0, 0.0), "arc", 1000.0, (0.0, 0.0, 0.0), +1, before="S9000"),
        Move((-20.0, 0.0, 0.0), "arc", 1000.0, (0.0, 0.0, 0.0), +1, lines=("M9", "G4 P0.5")),
        Move((0.0, -20.0, 0.0), "arc", 1000.0, (0.0, 0.0, 0.0), +1),
        Move((0.0, 0.0, 0.0), "rapid", lines=("M5",)),
    ]
    begin, quarter = _begins(moves, 1), 20.0 * math.pi / 2
    crossings = [
        Crossing("X", sign, s - HALF, s + HALF) for sign, s in ((-1, begin + quarter), (1, begin + 3 * quarter))
    ]
    return Job(moves, {"X": BOTH}, {0: {"X": OFFSET}, 5: {"X": 0.0}}, crossings)


def printed() -> Job:
    """A circle with an extruder, in the language of a printer."""
    job = circle(Style(head=("G21", "G90", "M82"), tail=(), dialect="klipper"))
    moves = list(job.moves)
    moves[3] = replace(moves[3], extruded=12.5)
    return replace(job, moves=moves)


INCHES = Style(head=("G20 G90 G17 G94",), unit=25.4, unit_name="inch", decimals=5)
RELATIVE = Style(head=("G21 G90 G17 G94", "G0 X0 Y0 Z0", "G91"), relative=True)
TIMED = Style(head=("G21 G90 G17 G93",), inverse=True)
CENTRES = Style(head=("G21 G90 G90.1 G17 G94",), centers=True)

GOOD = {
    "circle": circle,
    "balanced": lambda: circle(lead=True),
    "absolute centres": lambda: circle(CENTRES),
    "relative": lambda: circle(RELATIVE),
    "inverse time": lambda: circle(TIMED),
    "full circles on a reversal": on_reversal,
    "arc by radius": by_radius,
    "helix": helix,
    "G18": lambda: plane(18),
    "G19": lambda: plane(19),
    "short lines": ellipse,
    "corners": pocket,
    "corners, relative": lambda: pocket(RELATIVE),
    "edges": lambda: pocket(on_edges=True),
    "inches": lambda: pocket(INCHES, on_edges=True, scale=0.04),
    "two axes in a corner": corner,
    "approach": approached,
    "commands": commands,
    "extruder": printed,
}
