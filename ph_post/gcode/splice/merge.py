"""Two sets of changes to one program made one."""

from __future__ import annotations

from itertools import groupby

from ph_post.errors import InputError
from ph_post.gcode.splice.record import Dip, Edits, Stop
from ph_post.types import sealed


def merge(a: Edits, b: Edits) -> Edits:
    """Return the changes of both; stops at the same place become one.

    Raises
    ------
    InputError
        Where both shift one axis for good, or both tell the feed of one stretch.
    """
    shared = sorted(set(a.amplitude) & set(b.amplitude))
    if shared:
        raise InputError("merge", f"both shift axis {shared[0]}", expected="axes apart", got=shared[0])
    return Edits(
        offset=a.offset if a.offset is b.offset and not a.offset.any() else sealed(a.offset + b.offset),
        stops=_merged_stops((*a.stops, *b.stops)),
        dips=_merged_dips((*a.dips, *b.dips)),
        amplitude={**a.amplitude, **b.amplitude},
        pulse={
            axis: max(a.pulse.get(axis, 0.0), b.pulse.get(axis, 0.0)) for axis in sorted({*a.pulse, *b.pulse})
        },
        warnings=tuple(dict.fromkeys((*a.warnings, *b.warnings))),
    )


def _place(stop: Stop) -> tuple[int, float]:
    return stop.motion, stop.share


def _merged_stops(stops: tuple[Stop, ...]) -> tuple[Stop, ...]:
    """Order stops by place; the shifts of those at one place follow one another."""
    joined = []
    for (motion, share), group in groupby(sorted(stops, key=_place), key=_place):
        found = list(group)
        joined.append(
            Stop(
                motion=motion, share=share, pause=max(one.pause for one in found),
                shifts=tuple(shift for one in found for shift in one.shifts),
            )
        )  # fmt: skip
    return tuple(joined)


def _merged_dips(dips: tuple[Dip, ...]) -> tuple[Dip, ...]:
    ordered = sorted(dips, key=lambda dip: (int(dip.motion[0]), float(dip.share[0])))
    ends = [(int(dip.motion[-1]), float(dip.share[-1])) for dip in ordered]
    starts = [(int(dip.motion[0]), float(dip.share[0])) for dip in ordered]
    for end, start in zip(ends[:-1], starts[1:], strict=True):
        if start < end and sum(start) < sum(end):
            raise InputError("merge", f"two feeds for one stretch of motion {start[0]}", expected="one")
    return tuple(ordered)
