"""Moves of a program as LinuxCNC's own interpreter tells them: cycles, loops, compensated cutters and splines too."""

from __future__ import annotations

import math
import re
import shutil
from collections.abc import Iterator
from functools import lru_cache

import numpy as np

from .interpreted import interpret_in_full
from .reference_player import Move

MM = 25.4
"""Its calls are in inches."""

PLANES = {1: (0, 1, 2), 2: (1, 2, 0), 3: (2, 0, 1)}
"""Axes by the number of the canonical plane: XY, YZ, ZX."""

_FIRST = re.compile(r"\A\s*%[^\n]*\n")
"""A line with nothing but a percent sign, with which a program may begin."""


_SWITCHED = re.compile(r"^(?:[^\n(;]|\([^\n)]*\))*?M[ \t]*0*([345])(?![\d.]).*\n?", re.MULTILINE | re.IGNORECASE)
"""Lines that switch the spindle, with M3, M4 or M5 outside of text."""

CUTS = 1
"""Number, instead of a line's, of the moves in which the spindle turns, where a program switches it on and off."""

_DELETED = re.compile(r"^[ \t]*/.*$", re.MULTILINE)
"""Lines that are left out where the switch of the machine is on, as it is here."""


@lru_cache(maxsize=8)
def canon_moves(text: str, begin: tuple[float, float, float], tools: str) -> list[Move] | None:
    """Moves of the motors from a place [mm] where the machine happens to stand; None where LinuxCNC refuses.

    A program that does not say where it ends is run to its end all the same. Their lines are not known: `CUTS` and 0
    stand for them where the spindle turns and where it stands, 0 if it is not both switched on and off.
    """
    if shutil.which("rs274") is None:
        return None
    text = _SWITCHED.sub(_marked, _DELETED.sub("", text))
    head = _FIRST.match(text)
    at = head.end() if head else 0
    goes = f"G21 G90 G0 X{begin[0]} Y{begin[1]} Z{begin[2]}\n"
    found = interpret_in_full(f"{text[:at]}{goes}{text[at:]}\nM2\n".encode(), tools)
    return None if found.refusal or not found.full else _moves(found.full)[1:]


def _marked(line: re.Match[str]) -> str:
    """Say before a line what it does to the spindle: its motion comes behind that."""
    return f"(spindle {'on' if line[1] in '34' else 'off'})\n{line[0]}"


def _with_spindle(calls: list[list]) -> Iterator[tuple[list, int]]:
    """Yield calls with `CUTS` where the spindle turns, else 0; nobody knows of those before the first order."""
    switched = len({name for name, *_ in calls if name.startswith("spindle ")}) > 1
    turns = switched
    for call in calls:
        turns = call[0] == "spindle on" if switched and call[0].startswith("spindle ") else turns
        yield call, CUTS if turns else 0


def _moves(calls: list[list]) -> list[Move]:
    """Return the moves of calls in mm, in the coordinates of the motors."""
    moves: list[Move] = []
    at = work = shift = tool = np.zeros(3)
    turned, plane, feed = 0.0, PLANES[1], 0.0

    def place(point: np.ndarray) -> np.ndarray:
        x, y, z = point + shift
        cos, sin = math.cos(turned), math.sin(turned)
        return MM * (np.array([cos * x - sin * y, sin * x + cos * y, z]) + work + tool)

    for (name, *numbers), line in _with_spindle(calls):
        if name == "set_plane":
            plane = PLANES[numbers[0]]
        elif name == "set_xy_rotation":
            turned = math.radians(numbers[0])
        elif name == "set_g5x_offset":
            work = np.array(numbers[1:4])
        elif name == "set_g92_offset":
            shift = np.array(numbers[:3])
        elif name == "tool_offset":
            tool = np.array(numbers[:3])
        elif name == "set_feed_rate":
            feed = MM * numbers[0]
        elif name in ("straight_traverse", "straight_feed", "straight_probe", "rigid_tap"):
            end = place(np.array(numbers[:3]))
            moves.append(Move(int(name not in ("straight_traverse", "straight_probe")), at, end, line, feed))
            if name == "rigid_tap":
                moves.append(Move(1, end, at, line, feed))
                continue
            at = end
        elif name == "arc_feed":
            a, b, c = plane
            point, center = np.zeros(3), np.zeros(3)
            point[[a, b, c]] = numbers[0], numbers[1], numbers[5]
            center[[a, b]] = numbers[2:4]
            end, middle, turns = place(point), place(center), int(numbers[4])
            first, last = (math.atan2(one[b] - middle[b], one[a] - middle[a]) for one in (at, end))
            way = math.copysign(1.0, turns)
            sweep = (last - first) * way % (2.0 * math.pi)
            sweep = 2.0 * math.pi if sweep < 1e-9 or sweep > 2.0 * math.pi - 1e-9 else sweep
            sweep += 2.0 * math.pi * (abs(turns) - 1)
            center = (middle[a], middle[b])
            moves.append(Move(2 if turns < 0 else 3, at, end, line, feed, plane, center, way * sweep, spiral=True))
            at = end
    return moves
