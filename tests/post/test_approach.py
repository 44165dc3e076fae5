"""Programs of paths on a machine of the tests' own: every axis begins on the side that the plan counts on."""

from __future__ import annotations

from itertools import pairwise, product

import numpy as np
import pytest
from msgspec.structs import replace
from support.commanded import largest_errors
from support.motions import make_path

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


RAPIDS = {"after a rapid": (0,), "after a rapid along X": (0,)}
"""Segments that are rapid: the cut begins where they end, and the approach lies before them."""


def path_named(name):
    curves = PATHS[name]
    if curves is None:
        return read_path(or_shipped("paths", name))
    return make_path(curves[0], feed=0.012, closed=curves[1], rapid=RAPIDS.get(name, ()))


CASES = list(product(PATHS, ("router", "stepper")))


@pytest.mark.thinned(12)
@pytest.mark.parametrize(("name", "machine"), CASES[::5])
def test_the_program_is_as_good_as_it_says_whatever_side_the_axes_stood_on(name: str, machine: str) -> None:
    """A third of them; all in tests/long."""
    is_as_good_as_it_says(name, machine)


def is_as_good_as_it_says(name: str, machine: str) -> None:
    path = path_named(name)
    drives = replace(ph.read_machine(machine), dialect="linuxcnc", servo_period=PERIOD)
    result = ph.compensate(path, drives, output="program", max_slowdown=0.5, effort=0.05)
    sides = product((1, -1), repeat=len(path.axes))
    cut, all_moves = np.array([largest_errors(result, Track(path), side) for side in sides]).max(axis=0)
    assert 0.9 * cut - 1e-6 <= result.after.error.max <= 1.1 * max(cut, all_moves) + 1e-6
