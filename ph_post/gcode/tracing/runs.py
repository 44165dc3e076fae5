"""Runs of straight cutting moves in a CAM program, absolute and in mm."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.gcode.tracing.record import Move, Run
from ph_post.types import frozen
from ph_post.units import MM

_SAME: Final = 1e-6
"""Lengths in mm that differ by less are one."""

_RAPIDS: Final = {"G0", "G00"}
_LINES: Final = {"G1", "G01"}
_ARCS: Final = {"G2", "G02", "G3", "G03"}
_STILL: Final = {"M3", "M03", "M4", "M04", "M5", "M05", "M7", "M07", "M8", "M08", "M9", "M09"}
"""Spindle and coolant: the tool stays where it is."""

_COMMENTS: Final = ("(", ";")

_PLAIN: Final = frozenset("XYZF")


class _Tool(msgspec.Struct):
    """Where the tool is [mm], None where that is not known, and the feed [mm/s]."""

    x: float | None = None
    y: float | None = None
    z: float | None = None
    feed: float | None = None

    def go(self, words: dict[str, float]) -> None:
        self.x, self.y = words.get("X", self.x), words.get("Y", self.y)
        self.z, self.feed = words.get("Z", self.z), words.get("F", self.feed)

    def forget(self) -> None:
        self.x = self.y = self.z = None


def find_runs(moves: Sequence[Move]) -> list[Run]:
    """Find all runs of two or more straight moves at constant height and feed.

    Whatever is not known to leave the tool where it is ends a run, and makes its place unknown; behind a G91
    nothing is looked for.
    """
    return [run for run in _all_runs(moves) if len(run.points) > 2]


def _all_runs(moves: Sequence[Move]) -> Iterator[Run]:
    tool, first, points = _Tool(), 0, list[tuple[float, float]]()
    for index, move in enumerate(moves):
        if move.name == "G91":
            break
        goes_on = bool(points) and _cuts_on(move, tool) and move.words.get("F", tool.feed) == tool.feed
        if points and not goes_on:
            yield _run(first, points, tool.feed)
            points = []
        if not goes_on and _cuts_on(move, tool):
            assert tool.x is not None
            assert tool.y is not None
            first, points = index, [(tool.x, tool.y)]
        _follow(move, tool)
        if points:
            assert tool.x is not None
            assert tool.y is not None
            points.append((tool.x, tool.y))
    if points:
        yield _run(first, points, tool.feed)


def _run(first: int, points: list[tuple[float, float]], feed: float | None) -> Run:
    return Run(first=first, points=frozen(np.array(points) * MM), feed=(feed or 0.0) * MM)


def _cuts_on(move: Move, tool: _Tool) -> bool:
    """Whether a move goes straight to another place at the height at which the tool is."""
    words = move.words
    if move.name not in _LINES or not words.keys() <= _PLAIN or tool.x is None or tool.y is None:
        return False
    if not words.get("F", tool.feed):
        return False
    level = "Z" not in words or (tool.z is not None and abs(words["Z"] - tool.z) <= _SAME)
    moved = max(abs(words.get("X", tool.x) - tool.x), abs(words.get("Y", tool.y) - tool.y))
    return level and moved > _SAME


def _follow(move: Move, tool: _Tool) -> None:
    if move.name in _RAPIDS:
        tool.go({letter: value for letter, value in move.words.items() if letter != "F"})
    elif move.name in _LINES or move.name in _ARCS:
        tool.go(move.words)
    elif move.name not in _STILL and not move.name.startswith(_COMMENTS):
        tool.forget()
