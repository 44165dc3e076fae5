"""Families of designs that a part program can carry: a full stop, and jogs between dwells.

See :mod:`ph_post.compensate.families` for what families are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.compensate.families import ORDER, Case, Family
from ph_post.compensate.jogs import DWELL, LEAST, carries_offset, make_jog, whole_jog
from ph_post.compensate.profile import stop
from ph_post.compensate.trial import Design
from ph_post.types import Array, Axis, Jog

SHORTEST_RAMP: Final = 1e-3
"""Least part of the budget that a ramp takes; the limits forbid ramps as short as that anyway."""


def make_stop(x: Array, case: Case) -> Design:
    """Stop and jog: x = (share of ramps, part of the budget, share of the pause before, travel, time out).

    What the jogs and their least dwells leave of the budget goes to the ramps and to pauses before and behind
    them. Axes jog one after the other. Behind its loop an axis jogs by the gap, once; inside it, by `travel`
    gaps out and back, and stays out for part of the time in which the motor crosses the gap meanwhile.
    """
    share, part, before, travel, out = (float(value) for value in x)
    jogs, least = _sequence(case.reversing, travel, out)
    spare = max(part * case.budget - least, 0.0)
    ramp = max(share * spare, SHORTEST_RAMP * case.budget)
    pause = (1.0 - share) * spare
    hold = least + pause
    begin = -0.5 * hold + before * pause
    placed = tuple(msgspec.structs.replace(jog, start=jog.start + begin) for jog in jogs)
    return Design(shape=stop(ramp, hold, ORDER), t_star=ramp + 0.5 * hold, crossings=placed)


def make_jog_stop(x: Array, case: Case) -> Design:
    """Stop and jog axes behind their loops: the first three of `make_stop`."""
    return make_stop(np.concatenate([x, [0.0, 0.0]]), case)


def jogs_last(reversing: Sequence[tuple[Axis, int]]) -> float:
    """How long axes behind their loops take to jog by their gaps one after the other, dwells included [s]."""
    return _sequence(reversing, 0.0, 0.0)[1]


def _sequence(reversing: Sequence[tuple[Axis, int]], travel: float, out: float) -> tuple[list[Jog], float]:
    """Jogs of all axes with their dwells, from 0 on, and how long that takes [s]."""
    jogs: list[Jog] = []
    t = DWELL
    for axis, direction in reversing:
        if axis.feedback == "load":
            way = max(travel * axis.gap.lost_motion, LEAST)
            there = make_jog(axis, way * direction, t)
            turn = there.end + max(DWELL, out * _time_to_cross(axis, way) - there.duration)
            jogs += [there, msgspec.structs.replace(there, start=turn, travel=-there.travel)]
        elif carries_offset(axis):
            jogs.append(whole_jog(axis, direction, t))
        t = jogs[-1].end + DWELL if jogs else t
    return jogs, t


def _time_to_cross(axis: Axis, error: float) -> float:
    """How long a motor without losses takes through its gap under a position error [m], in seconds."""
    inertia = (axis.gap.inertia_fraction or 0.0) * axis.servo.b
    return math.sqrt(2.0 * inertia * axis.gap.lost_motion / error)


JOG: Final = Family(
    name="takeup", make=make_jog_stop, low=np.array([0.1, 0.2, 0.0]), high=np.array([1.0, 1.0, 1.0]),
    seeds=(np.array([1.0, 1.0, 0.0]), np.array([0.7, 1.0, 0.2]), np.array([0.4, 1.0, 0.1])),
)  # fmt: skip

PULSE: Final = Family(
    name="takeup", make=make_stop,
    low=np.array([0.1, 0.2, 0.0, 0.002, 0.0]), high=np.array([1.0, 1.0, 1.0, 2.0, 1.5]),
    seeds=tuple(
        np.array([share, 1.0, 0.2, travel, out])
        for share in (0.5, 0.8)
        for out in (0.8, 1.0)
        for travel in (0.01, 0.02, 0.05, 0.1, 0.3, 1.0)
    ),
)  # fmt: skip
