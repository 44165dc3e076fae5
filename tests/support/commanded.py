"""Errors of programs of paths on a machine of the tests' own, whose motors a model of the controller moves."""

from __future__ import annotations

import re

import numpy as np

from ph_post.gcode.program import RAPID
from support.two_masses import Nominal, body_of, settling, table_of


def largest_errors(result, track, side, rule="standstill"):
    """Largest distance of the table from the path [m] while the program cuts; the axes stand on `side` at first.

    The second one counts the program's own approach and retreat too, beside the path or their own lines. Only how the
    controller moves the axes is the package's, and which line that belongs to.
    """
    axes, machine, after = track.path.axes, result.machine, result.after
    period = machine.servo_period
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
    bodies = [body_of(machine.axes[axis], rule) for axis in axes]
    table = np.stack(
        [
            table_of(body, column, period, one, column[0] - one * 0.5 * body.gap)
            for body, column, one in zip(bodies, after.command.position[:, columns].T, side, strict=True)
        ],
        axis=1,
    )
    counted = np.arange(len(table)) >= settling(bodies) / period
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
