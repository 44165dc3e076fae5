"""Programs of paths on a machine of the tests' own: every axis begins on the side that the plan counts on."""

from __future__ import annotations

import re
from itertools import pairwise, product

import numpy as np
import pytest
from msgspec.structs import replace
from support.motions import make_path
from support.two_masses import Nominal, body_of, settling, table_of

import ph_post as ph
from ph_post.files.path import read_path
from ph_post.files.storage import or_shipped
from ph_post.gcode.program import RAPID
from ph_post.geometry.curves import Arc, Line
from ph_post.geometry.track import Track

MM = 1e-3
PERIOD = 1e-3


def lines(*points):
    return [Line(np.array([a, b]) * MM) for a, b in pairwise(points)]


def arc(start, end, center, turn):
    return Arc(np.array(start) * MM, np.array(end) * MM, np.array(center) * MM, turn)


SLOT = [
    *lines((-15, -6), (15, -6)),
    arc((15, -6), (15, 6), (15, 0), "ccw"),
    *lines((15, 6), (-15, 6)),
    arc((-15, 6), (-15, -6), (-15, 0), "ccw"),
]
"""X moves first, and Y rests."""

TALL = [
    *lines((6, -15), (6, 15)),
    arc((6, 15), (-6, 15), (0, 15), "ccw"),
    *lines((-6, 15), (-6, -15)),
    arc((-6, -15), (6, -15), (0, -15), "ccw"),
]
"""Y moves first, and X rests."""

PATHS = {
    "pocket": None,
    "oval": None,
    "slot": (SLOT, True),
    "slot backwards": ([*lines((15, -6), (-15, -6)), *lines((-15, -6), (-15, 6), (15, 6), (15, -6))], True),
    "tall": (TALL, True),
    "square": (lines((0, 0), (20, 0), (20, 20), (0, 20), (0, 0)), True),
    "square clockwise": (lines((0, 0), (0, 20), (20, 20), (20, 0), (0, 0)), True),
    "open": (lines((0, 0), (20, 0), (20, 20), (10, 20), (10, 5), (30, 5)), False),
    "after a rapid": (lines((0, 0), (5, 5), (5, 25), (25, 25), (25, 5), (5, 5)), False),
    "after a rapid along X": (lines((0, 0), (5, 0), (25, 0), (25, -20), (5, -20), (5, 0)), False),
    "step": (lines((0, 0, 0), (20, 0, 0), (20, 0, 2), (20, 10, 2), (0, 10, 1), (0, 0, 0)), True),
    "hill": (lines((0, 0, 0), (20, 5, 3), (40, 0, 0), (40, -10, 1)), False),
    "ring": ([arc((12, 0), (12, 0), (0, 0), "cw")], True),
}


RAPIDS = {"after a rapid": (0,), "after a rapid along X": (0,)}
"""Segments that are rapid: the cut begins where they end, and the approach lies before them."""


def path_named(name):
    curves = PATHS[name]
    if curves is None:
        return read_path(or_shipped("paths", name))
    return make_path(curves[0], feed=0.012, closed=curves[1], rapid=RAPIDS.get(name, ()))


def largest_errors(result, track, side):
    """Largest distance of the table from the path [m] while the program cuts; the axes stand on `side` at first.

    The second one counts the program's own approach and retreat too, beside the path or their own lines. Only how the
    controller moves the axes is the package's, and which line that belongs to.
    """
    axes, machine, after = track.path.axes, result.machine, result.after
    lines = after.program.data.decode().split("\n")
    modes, taken, left = [""], [False], 0
    for line in lines:
        words = line.split()
        modes.append(next((word for word in words if word in ("G61", "G64")), modes[-1]))
        left = int(words[1]) if line.startswith("(ph-post: +") and "approach" in line else left - 1
        taken.append(left >= 0)
    block = after.program.motions.block[np.maximum(after.command.segment, 0)] + 1
    moves = after.program.motions.kind[np.maximum(after.command.segment, 0)] != RAPID
    cuts, own = moves & (np.array(modes)[block] == "G64"), moves & ~np.array(taken)[block]
    columns = [after.command.axes.index(axis) for axis in axes]
    bodies = [body_of(machine.axes[axis]) for axis in axes]
    table = np.stack(
        [
            table_of(body, column, PERIOD, one, column[0] - one * 0.5 * body.gap)
            for body, column, one in zip(bodies, after.command.position[:, columns].T, side, strict=True)
        ],
        axis=1,
    )
    counted = np.arange(len(table)) >= settling(bodies) / PERIOD
    s = np.linspace(0.0, track.length, 200_001)
    away = Nominal(track.derivatives(*track.locate(s))[0]).distance(table)
    beside = away.copy()
    for start, end in straight_moves(after.original.data.decode(), axes):
        way = np.linspace(start, end, 2001)
        beside = np.minimum(beside, Nominal(way).distance(table))
    return away[cuts & counted].max(), beside[own & counted].max()


def straight_moves(text, axes):
    """Ends [m] of the straight moves that are not rapid under G61: approach and retreat."""
    at, exact, found = dict.fromkeys(axes, 0.0), False, []
    for line in text.split("\n"):
        words = re.sub(r"\(.*?\)", "", line).split()
        exact = "G61" in words or (exact and "G64" not in words)
        values = {word[0]: 1e-3 * float(word[1:]) for word in words if word[0] in axes}
        start, at = at, at | values
        if exact and "G1" in words and values:
            found.append(([start[axis] for axis in axes], [at[axis] for axis in axes]))
    return found


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("name", "machine"), list(product(PATHS, ("router", "stepper"))))
def test_the_program_is_as_good_as_it_says_whatever_side_the_axes_stood_on(name: str, machine: str) -> None:
    path = path_named(name)
    drives = replace(ph.read_machine(machine), dialect="linuxcnc", servo_period=PERIOD)
    result = ph.compensate(path, drives, output="program", max_slowdown=0.5, effort=0.05)
    sides = product((1, -1), repeat=len(path.axes))
    cut, all_moves = np.array([largest_errors(result, Track(path), side) for side in sides]).max(axis=0)
    assert 0.9 * cut - 1e-6 <= result.after.error.max <= 1.1 * max(cut, all_moves) + 1e-6
