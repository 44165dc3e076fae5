"""Share the time that a job may take out among its turning points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from ph_post.compensate.search import TriedDesign

LEAST_TIME: Final = 1e-6
"""Time [s] that a design takes at least where gains are weighed by it."""


def allocate(
    candidates: Sequence[Sequence[TriedDesign]], time: float, alone: Sequence[float] = ()
) -> list[TriedDesign | None]:
    """Pick a candidate for every window, or none, so that the worst is as good as the time allows.

    Parameters
    ----------
    candidates : sequence of sequence of TriedDesign
        Of every window, by the time they add: each better than those before it.
    time : float
        What may be added in all [s].
    alone : sequence of float, optional
        Merits [m] of windows that are left alone; infinite, as by default, where none may be that has candidates.

    Returns
    -------
    list of TriedDesign or None
        The quickest ones that reach the best common merit that the time allows; where a window cannot reach
        it, its best. Where time is short, windows that are better alone than that are left alone; what time is left
        goes to those that gain most by it.
    """
    merits = list(alone) or [math.inf] * len(candidates)
    better = [[one for one in own if one.merit < merit] for own, merit in zip(candidates, merits, strict=True)]

    def quickest(bound: float) -> list[TriedDesign | None]:
        return [
            None if not own or merit <= bound else next((one for one in own if one.merit <= bound), own[-1])
            for own, merit in zip(better, merits, strict=True)
        ]

    def taken(picks: Sequence[TriedDesign | None]) -> float:
        return sum(one.longer for one in picks if one is not None)

    bounds = sorted({one.merit for own in better for one in own} | {merit for merit in merits if merit < math.inf})
    if not bounds:
        return [None] * len(candidates)
    low, high = 0, len(bounds) - 1
    while low < high:
        middle = (low + high) // 2
        if taken(quickest(bounds[middle])) <= time:
            high = middle
        else:
            low = middle + 1
    picks = quickest(bounds[low])
    spare = time - taken(picks)
    rest = [(number, one) for number, own in enumerate(better) if picks[number] is None for one in own]
    for number, one in sorted(
        rest,
        key=lambda pair: (merits[pair[0]] ** 2 - pair[1].merit ** 2) / max(pair[1].longer, LEAST_TIME),
        reverse=True,
    ):
        if picks[number] is None and one.longer <= spare:
            picks[number], spare = one, spare - one.longer
    return picks
