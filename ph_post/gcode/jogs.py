"""Jogs and the lasting offsets between them: what a program adds to the coordinates of the path.

An arc whose points are all shifted is still an arc; and an offset changes only where the path stands still,
between two dwells, so that no move spans a change and no blending can swallow one.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.gcode.dialect import Dialect
from ph_post.gcode.record import DWELL, JOG, Blocks
from ph_post.types import Array, Jog, Phase, Plan
from ph_post.units import MM

FINEST = 20
"""Steps of a dialect's last decimal in the smallest jog that is written: rounding then takes 5 % at most."""


class Carried(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What is added to blocks: `offset` (n + 1, dim) [m] at the start and at the end of each.

    `feed` (n,) [m/s] is the speed that jogs are given, 0 for all other blocks.
    """

    offset: Array
    feed: Array


class Jogs(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The jogs of a plan that are written, in the order of time, and the `phases` in which they lie.

    `first` (dim,) [m] is the offset with which the path begins. What a plan begins with to come onto it is
    left out: it is the program's approach.
    """

    phases: tuple[Phase, ...]
    jogs: tuple[Jog, ...]
    first: Array


def read_jogs(plan: Plan) -> Jogs:
    """Take the jogs out of a plan; a plan for a table has none, and its path is written as it is."""
    axes = plan.path.axes
    jogs = tuple(one for one in plan.crossings if isinstance(one, Jog))
    first = np.array([plan.bias.get(axis, 0.0) if jogs else 0.0 for axis in axes])
    seats = [jog for jog in jogs if jog.start == 0.0]
    if not seats:
        return Jogs(phases=plan.phases, jogs=jogs, first=first)
    for jog in seats:
        first[axes.index(jog.axis)] += jog.travel
    past = plan.phases[0].duration
    return Jogs(
        phases=tuple(msgspec.structs.replace(one, start=one.start - past) for one in plan.phases[1:]),
        jogs=tuple(msgspec.structs.replace(one, start=one.start - past) for one in jogs[len(seats) :]),
        first=first,
    )


def check_jogs(jogs: Sequence[Jog], dialect: Dialect) -> None:
    """Refuse jogs that a dialect cannot carry.

    Raises
    ------
    InputError
        Where its decimals are too few for them, or the axes do not stand still in its dwells.
    """
    if not jogs:
        return
    if not dialect.capabilities.dwells:
        what = f"the dialect {dialect.name} has no dwell in which the axes stand still, as an offset needs it"
        raise InputError("--dialect", what, expected="another dialect, or --feed-only", got=dialect.name)
    least = FINEST * MM * 10.0**-dialect.capabilities.decimals
    smallest = min(jogs, key=lambda jog: abs(jog.travel))
    if abs(smallest.travel) < least:
        raise InputError(
            "--dialect", f"the decimals of {dialect.name} are too few for an offset of axis {smallest.axis}",
            expected=f">= {least / MM:g} mm", got=f"{abs(smallest.travel) / MM:.3g} mm",
        )  # fmt: skip


def with_jogs(blocks: Blocks, found: Jogs, axes: Sequence[str]) -> tuple[Blocks, Carried]:
    """Cut dwells at the jogs in them, and tell the offset that is carried at every end of a block."""
    begins = np.array([jog.start for jog in found.jogs])
    ends = np.array([jog.end for jog in found.jogs])
    rows: list[tuple[int, float, float, int]] = []
    for number, (kind, start, end) in enumerate(
        zip(blocks.kind.tolist(), blocks.start.tolist(), blocks.end.tolist(), strict=True)
    ):
        inside = np.flatnonzero((begins >= start) & (ends <= end)).tolist() if kind == DWELL else []
        edges = [start, *(edge for jog in inside for edge in (begins[jog], ends[jog])), end]
        jogs = [which for jog in inside for which in (-1, jog)] + [-1]
        rows += [(number, a, b, jog) for (a, b), jog in zip(pairwise(edges), jogs, strict=True)]
    source = np.array([row[0] for row in rows])
    which = np.array([row[3] for row in rows])
    names = Blocks.__struct_fields__
    cut = msgspec.structs.replace(
        Blocks(**{name: getattr(blocks, name)[source] for name in names}),
        start=np.array([row[1] for row in rows]), end=np.array([row[2] for row in rows]),
        kind=np.where(which >= 0, JOG, blocks.kind[source]),
    )  # fmt: skip
    return cut, _carried(found, which.tolist(), axes)


def _carried(found: Jogs, which: Sequence[int], axes: Sequence[str]) -> Carried:
    """Add the jogs up; `which` is the number of the jog that a block is, -1 for others."""
    missing = sorted(set(range(len(found.jogs))) - set(which))
    if missing:
        jog = found.jogs[missing[0]]
        what = f"the jog of axis {jog.axis} does not lie in a rest of the path"
        raise InputError("plan", what, expected="a plan made for a program", got=f"{jog.start:.6g} s")
    offset, feed = np.tile(found.first, (len(which) + 1, 1)), np.zeros(len(which))
    for row, number in enumerate(which):
        if number >= 0:
            jog = found.jogs[number]
            offset[row + 1 :, axes.index(jog.axis)] += jog.travel
            feed[row] = jog.velocity
    # What is out and back again leaves nothing but rounding.
    return Carried(offset=np.where(np.abs(offset) < _NOTHING, 0.0, offset), feed=feed)


_NOTHING = 1e-12
"""Offsets [m] smaller than this are rounding."""
