"""A residual in few numbers, to be drawn: over time, by position, by the time since the axis turned back."""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.diagnose.record import Trail
from ph_post.report.thinning import lowest_and_highest
from ph_post.types import Array, BoolArray, IntArray

SLACK: Final = 1e-4
"""A way back that is no longer than this part of the travel is rounding, and no reversal."""

REACH: Final = 90.0
"""Percentile of the times between reversals up to which the residual is told by the time since the last."""

FEWEST: Final = 3
"""A mean of fewer samples is not told."""


class Envelope(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Lowest and highest values of neighbours, (m,); NaN where all of them are missing.

    `t` [s] and `command` [m] are those of each group's first sample; `before` and `after` have shape (2, m).
    """

    t: Array
    command: Array
    before: Array
    after: Array


class Profile(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What a residual is by another variable, whose steps have their middles at `x`, (m,); NaN: too few."""

    x: Array
    before: Array
    after: Array


def envelope(trail: Trail, most: int) -> Envelope:
    """Return at most so many groups of neighbours, each with its lowest and highest residuals.

    A short peak stays as high as it is, however many samples stand for one.
    """
    step = max(1, -(-trail.t.size // most))
    firsts = np.arange(0, trail.t.size, step)
    return Envelope(
        t=trail.t[firsts], command=trail.command[firsts],
        before=lowest_and_highest(trail.before, firsts), after=lowest_and_highest(trail.after, firsts),
    )  # fmt: skip


def reversals(command: Array) -> tuple[IntArray, IntArray]:
    """Return the samples at which a command turns back, and the senses it leaves with.

    Where it dwells it is the last sample. Sample 0 comes first, with the sense of the first motion; there is
    none where the command stands still.

    Examples
    --------
    >>> reversals(np.array([0.0, 1.0, 2.0, 2.0, 1.0]))
    (array([0, 3]), array([ 1, -1]))
    """
    slack = SLACK * float(np.ptp(command)) if command.size else 0.0
    found, senses = [0], [0]
    extreme = 0
    # A zigzag: the farthest sample so far becomes a reversal when the command is back from it by the slack.
    values = command.tolist()
    for k, place in enumerate(values):
        way = place - values[extreme]
        if senses[-1] == 0 and abs(way) > slack:
            senses[-1] = 1 if way > 0.0 else -1
            extreme = k
        elif senses[-1] * way >= 0.0:
            extreme = k if senses[-1] else extreme
        elif abs(way) > slack:
            found.append(extreme)
            senses.append(-senses[-1])
            extreme = k
    if senses[0] == 0:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    return np.array(found), np.array(senses)


def by_position(trail: Trail, steps: int) -> dict[int, Profile]:
    """Return the mean residual by position of the command [m], for each direction of travel (+1, -1)."""
    starts, senses = reversals(trail.command)
    if starts.size == 0:
        return {}
    sense = np.repeat(senses, np.diff(np.append(starts, trail.t.size)))
    edges = np.linspace(float(trail.command.min()), float(trail.command.max()), steps + 1)
    return {way: _profile(trail, trail.command, edges, sense == way) for way in (1, -1)}


def since_reversal(trail: Trail, steps: int) -> Profile | None:
    """Return the root mean square of the residual by the time since the command turned back [s]."""
    starts, _ = reversals(trail.command)
    if starts.size < 2:
        return None
    lengths = np.diff(np.append(starts, trail.t.size))
    since = trail.t - np.repeat(trail.t[starts], lengths)
    turned = np.arange(trail.t.size) >= starts[1]
    reach = float(np.percentile(since[[*(starts[2:] - 1), trail.t.size - 1]], REACH))
    if reach <= 0.0:
        return None
    edges = np.linspace(0.0, reach, steps + 1)
    squares = msgspec.structs.replace(trail, before=trail.before**2, after=trail.after**2)
    found = _profile(squares, since, edges, turned)
    return msgspec.structs.replace(found, before=np.sqrt(found.before), after=np.sqrt(found.after))


def _profile(trail: Trail, by: Array, edges: Array, chosen: BoolArray) -> Profile:
    """Return means over the steps between the edges, of those samples that are chosen and count."""
    wanted = chosen & trail.counted & (by <= edges[-1])
    steps = np.clip(np.searchsorted(edges, by, side="right") - 1, 0, edges.size - 2)
    before, after = (
        _means(values, steps, wanted & np.isfinite(values), edges.size - 1)
        for values in (trail.before, trail.after)
    )
    return Profile(x=0.5 * (edges[:-1] + edges[1:]), before=before, after=after)


def _means(values: Array, steps: IntArray, wanted: BoolArray, count: int) -> Array:
    numbers = np.bincount(steps[wanted], minlength=count)
    sums = np.bincount(steps[wanted], weights=values[wanted], minlength=count)
    return np.where(numbers >= FEWEST, sums / np.maximum(numbers, 1), np.nan)


def root_mean_square(values: Array, chosen: BoolArray) -> float:
    """Return the root mean square of what is chosen and not missing, NaN where nothing is."""
    kept = values[chosen & np.isfinite(values)]
    return float(np.sqrt(np.mean(kept**2))) if kept.size else float("nan")


def stretches(chosen: BoolArray) -> list[tuple[int, int]]:
    """Return the first and last samples of stretches that are chosen.

    Examples
    --------
    >>> stretches(np.array([True, True, False, True]))
    [(0, 1), (3, 3)]
    """
    padded = np.concatenate([[False], chosen, [False]]).astype(np.int8)
    firsts, ends = np.flatnonzero(np.diff(padded) == 1), np.flatnonzero(np.diff(padded) == -1)
    return [(int(first), int(end) - 1) for first, end in zip(firsts, ends, strict=True)]
