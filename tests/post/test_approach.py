"""Programs of paths on a machine of the tests' own: every axis begins on the side that the plan counts on."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from msgspec.structs import replace
from support.motions import make_path
from support.played import play_program
from support.two_masses import Nominal, body_of, settling, table_of

import ph_post as ph
from ph_post.files.path import read_path
from ph_post.files.storage import or_shipped
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


RAPID = {"after a rapid": (0,), "after a rapid along X": (0,)}
"""Segments that are rapid: the cut begins where they end, and the approach lies before them."""


def path_named(name):
    curves = PATHS[name]
    if curves is None:
        return read_path(or_shipped("paths", name))
    return make_path(curves[0], feed=0.012, closed=curves[1], rapid=RAPID.get(name, ()))


def largest_error(text, track, machine, side):
    """Largest distance of the table from the path while the program cuts [m]; the axes stand on `side` at first."""
    axes = track.path.axes
    start = track.derivatives(*track.locate(np.zeros(1)))[0][0]  # where the path begins: no rapid moves an axis far
    played = play_program(text, "".join(axes), PERIOD, start)
    bodies = [body_of(machine.axes[axis]) for axis in axes]
    table = np.stack(
        [
            table_of(body, column, PERIOD, one, column[0] - one * 0.5 * body.gap)
            for body, column, one in zip(bodies, played.position.T, side, strict=True)
        ],
        axis=1,
    )
    s = np.linspace(0.0, track.length, 200_001)
    away = Nominal(track.derivatives(*track.locate(s))[0]).distance(table[played.cut])
    return away[round(settling(bodies) / PERIOD) :].max()


@pytest.mark.thinned(3)
@pytest.mark.parametrize(("name", "machine"), list(product(PATHS, ("router", "stepper"))))
def test_the_program_is_as_good_as_it_says_whatever_side_the_axes_stood_on(name: str, machine: str) -> None:
    path = path_named(name)
    drives = replace(ph.read_machine(machine), dialect="linuxcnc")
    result = ph.compensate(path, drives, output="program", max_slowdown=0.5, effort=0.05)
    text, track = result.program().decode(), Track(path)
    found = [largest_error(text, track, drives, side) for side in product((1, -1), repeat=len(path.axes))]
    claimed = result.after.error.max
    assert abs(max(found) - claimed) <= max(0.1 * claimed, 1e-6)
