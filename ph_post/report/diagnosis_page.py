"""Page of a diagnosis, and the statistics of residuals that it draws.

Residuals are reduced over time, by position, and by the time since the axis reversed.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.geometry.numeric import zigzag
from ph_post.quantities import with_error
from ph_post.report.diagnoses import channel_scale, diagnosis_lines, diagnosis_view
from ph_post.report.effect_words import finding_name, label_words
from ph_post.report.page import lowest_and_highest, make_page
from ph_post.types import Array, BoolArray, IntArray
from ph_post.types.diagnosis import Channel, ChannelQuality, Diagnosis, ResidualTrace
from ph_post.units import MICROMETRE, MM, MS

SLACK: Final = 1e-4
"""A move back that is no longer than this part of the travel is rounding, not a reversal."""

REACH: Final = 90.0
"""Percentile of the times between reversals up to which the residual is shown since the last."""

FEWEST: Final = 3
"""A mean of fewer samples is not shown."""


class Envelope(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Lowest and highest values of neighbours, (m,); NaN where all of them are missing.

    `t` [s] and `command` [m] are those of each group's first sample; `before` and `after` have shape (2, m).
    """

    t: Array
    command: Array
    before: Array
    after: Array


class ResidualProfile(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Residual over another variable, whose steps have their middles at `x`, (m,); NaN: too few samples."""

    x: Array
    before: Array
    after: Array


def envelope(trail: ResidualTrace, most: int) -> Envelope:
    """Return at most so many groups of neighbours, each with its lowest and highest residuals.

    A short peak stays as high as it is, however many samples stand for one. Groups without a reading are NaN.
    """
    step = max(1, -(-trail.t.size // most))
    firsts = np.arange(0, trail.t.size, step)
    there = has_reading(trail)
    return Envelope(
        t=trail.t[firsts],
        command=trail.command[firsts],
        before=lowest_and_highest(np.where(there, trail.before, np.nan), firsts),
        after=lowest_and_highest(np.where(there, trail.after, np.nan), firsts),
    )


def has_reading(trail: ResidualTrace) -> BoolArray:
    """Return which samples were read: the others, as those between windows of a long log, have residuals of 0."""
    return np.asarray(trail.counted | (trail.before != 0.0) | (trail.after != 0.0))


def reversals(command: Array) -> tuple[IntArray, IntArray]:
    """Return the samples at which a command turns back, and the senses it leaves with.

    Where it dwells it is the last sample. Sample 0 comes first, with the sense of the first motion; there is
    none where the command stands still.

    Examples
    --------
    >>> reversals(np.array([0.0, 1.0, 2.0, 2.0, 1.0]))
    (array([0, 3]), array([ 1, -1]))
    """
    return zigzag(command, SLACK * float(np.ptp(command)) if command.size else 0.0)


def by_position(trail: ResidualTrace, steps: int) -> dict[int, ResidualProfile]:
    """Return the mean residual by position of the command [m], for each direction of travel (+1, -1)."""
    starts, senses = reversals(trail.command)
    if starts.size == 0:
        return {}
    sense = np.repeat(senses, np.diff(np.append(starts, trail.t.size)))
    edges = np.linspace(float(trail.command.min()), float(trail.command.max()), steps + 1)
    return {way: _residual_profile(trail, trail.command, edges, sense == way) for way in (1, -1)}


def since_reversal(trail: ResidualTrace, steps: int) -> ResidualProfile | None:
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
    found = _residual_profile(squares, since, edges, turned)
    return msgspec.structs.replace(found, before=np.sqrt(found.before), after=np.sqrt(found.after))


def _residual_profile(trail: ResidualTrace, by: Array, edges: Array, chosen: BoolArray) -> ResidualProfile:
    """Return means over the steps between the edges, of those samples that are chosen and count."""
    wanted = chosen & trail.counted & (by <= edges[-1])
    steps = np.clip(np.searchsorted(edges, by, side="right") - 1, 0, edges.size - 2)
    before, after = (
        _means(values, steps, wanted & np.isfinite(values), edges.size - 1) for values in (trail.before, trail.after)
    )
    return ResidualProfile(x=0.5 * (edges[:-1] + edges[1:]), before=before, after=after)


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


POINTS: Final = 6000
"""Groups of neighbouring samples that a residual is drawn with over time: 10 ms each in a minute."""

STEPS: Final = 100
"""Steps of position, and of the time since a reversal."""

DIGITS: Final = 5
"""Significant digits of values that are only drawn."""


def diagnosis_page(
    diagnosis: Diagnosis, name: str = "", efforts: Mapping[str, str] | None = None, remarks: str = ""
) -> str:
    """Return the page.

    Parameters
    ----------
    diagnosis : Diagnosis
    name : str
        The log's.
    efforts : mapping, optional
        Units of the force channels by axis, see :func:`~ph_post.report.diagnoses.effort_units`.
    remarks : str
        More text under the verdict.
    """
    efforts = efforts or {}
    data = {
        **diagnosis_view(diagnosis, efforts),
        "log": name,
        "machine": diagnosis.machine.name,
        "remarks": remarks,
        "labels": [step.added and label_words(step.added) for step in diagnosis.steps],
        "titles": [finding_name(one) for one in diagnosis.findings],
        "rivals": [[label_words(name, one.axis) for name in one.ambiguous_with] for one in diagnosis.findings],
        "estimates": [
            {key: with_error(value.value, value.stderr) for key, value in one.parameters.items()}
            for one in diagnosis.findings
        ],
        "trails": list(_trails(diagnosis, efforts)),
    }
    title = f"ph-post diagnose {name}".rstrip()
    return make_page("diagnosis", title, data, diagnosis_lines(diagnosis, efforts))


def residual_scale(axis: str, channel: Channel, efforts: Mapping[str, str]) -> tuple[str, float]:
    """Return the unit that a residual is drawn in, and its size in the units of the log."""
    unit, size = channel_scale(axis, channel, efforts)
    return ("µm", MICROMETRE) if channel != "force" else (unit, size)


def channel_noise(trail: ResidualTrace, diagnosis: Diagnosis) -> float:
    """Return the noise of a trail's channel, NaN where it is not known."""
    known: list[ChannelQuality] = [
        one for one in diagnosis.quality.channels if (one.axis, one.channel) == (trail.axis, trail.channel)
    ]
    return known[0].noise if known else math.nan


def _trails(diagnosis: Diagnosis, efforts: Mapping[str, str]) -> Iterator[dict[str, Any]]:
    """Yield what is drawn of each channel, and of the difference of both sides of an axis, which knows no servo."""
    channels = {(one.axis, one.channel): one for one in diagnosis.trails}
    for trail in diagnosis.trails:
        unit, size = residual_scale(trail.axis, trail.channel, efforts)
        noise = channel_noise(trail, diagnosis)
        yield _trail(trail, f"{trail.axis}_{trail.channel}", unit, size, noise)
        other = channels.get((trail.axis, "motor"))
        if trail.channel == "act" and other is not None:
            apart = replace(
                other,
                before=other.before - trail.before,
                after=other.after - trail.after,
                counted=other.counted & trail.counted,
            )
            both = math.hypot(noise, channel_noise(other, diagnosis))
            yield _trail(apart, f"{trail.axis}_motor − {trail.axis}_act", unit, size, both)


def _trail(trail: ResidualTrace, name: str, unit: str, size: float, noise: float) -> dict[str, Any]:
    """Return what is drawn of residuals: in their unit, times in s, positions in mm."""
    drawn = envelope(trail, POINTS)
    return {
        "name": name,
        "axis": trail.axis,
        "unit": unit,
        "noise": noise / size if math.isfinite(noise) else None,
        "t": _numbers(drawn.t, 1.0, 7),
        "end": float(trail.t[-1]) if trail.t.size else 0.0,
        "command": _numbers(drawn.command, MM),
        "before": [_numbers(one, size) for one in drawn.before],
        "after": [_numbers(one, size) for one in drawn.after],
        "rms": _sizes(trail, size),
        "left_out": [_span(trail, one) for one in stretches(~trail.counted)],
        "held_out": [_span(trail, one) for one in stretches(trail.held_out & trail.counted)],
        "position": {str(way): _drawn(one, MM, size) for way, one in by_position(trail, STEPS).items()},
        "reversal": _drawn(since_reversal(trail, STEPS), MS, size),
    }


def _sizes(trail: ResidualTrace, size: float) -> dict[str, Any]:
    """Root mean squares before and after, over what was fitted and what was held out."""
    held = trail.held_out & trail.counted
    fitted = trail.counted & ~trail.held_out
    sizes = {
        "fitted": [root_mean_square(one, fitted) for one in (trail.before, trail.after)],
        "held_out": [root_mean_square(one, held) for one in (trail.before, trail.after)],
    }
    return {name: [one / size if math.isfinite(one) else None for one in pair] for name, pair in sizes.items()}


def _span(trail: ResidualTrace, stretch: tuple[int, int]) -> list[float]:
    """Return begin and end of a stretch [s]."""
    return [float(f"{trail.t[k]:.7g}") for k in stretch]


def _drawn(profile: ResidualProfile | None, across: float, size: float) -> dict[str, Any] | None:
    if profile is None:
        return None
    return {
        "x": _numbers(profile.x, across),
        "before": _numbers(profile.before, size),
        "after": _numbers(profile.after, size),
    }


def _numbers(values: Array, size: float, digits: int = DIGITS) -> list[float | None]:
    """Return values in their unit, as short as a drawing needs them; what is missing is None."""
    kept = np.isfinite(values).tolist()
    scaled = (values / size).tolist()
    return [float(f"{one:.{digits}g}") if there else None for one, there in zip(scaled, kept, strict=True)]
