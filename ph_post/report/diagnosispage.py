"""A page that shows a diagnosis: one file with its data, its drawing and no network."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from ph_post.diagnose.record import Channel, ChannelQuality, Diagnosis, Trail
from ph_post.report.diagnoses import (
    channel_scale,
    diagnosis_lines,
    diagnosis_view,
)
from ph_post.report.findingwords import finding_name, label_words, number_words
from ph_post.report.page import make_page
from ph_post.report.residuals import (
    Profile,
    by_position,
    envelope,
    root_mean_square,
    since_reversal,
    stretches,
)
from ph_post.types import Array
from ph_post.units import MICROMETRE, MM, MS

POINTS: Final = 6000
"""Groups of neighbouring samples that a residual is drawn with over time: 10 ms each in a minute."""

STEPS: Final = 100
"""Steps of position, and of the time since a reversal."""

DIGITS: Final = 5
"""Significant digits of what is only drawn."""


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
        What else stands under the verdict.
    """
    efforts = efforts or {}
    data = {
        **diagnosis_view(diagnosis, efforts),
        "log": name,
        "machine": diagnosis.machine.name,
        "remarks": remarks,
        "labels": [step.added and label_words(step.added) for step in diagnosis.steps],
        "titles": [finding_name(one) for one in diagnosis.findings],
        "rivals": [
            [label_words(name, one.axis) for name in one.ambiguous_with] for one in diagnosis.findings
        ],
        "estimates": [
            {key: number_words(value) for key, value in one.parameters.items()} for one in diagnosis.findings
        ],
        "trails": [_trail(one, diagnosis, efforts) for one in diagnosis.trails],
    }
    title = f"ph-post diagnose {name}".rstrip()
    return make_page("diagnosis", title, data, diagnosis_lines(diagnosis, efforts))


def residual_scale(axis: str, channel: Channel, efforts: Mapping[str, str]) -> tuple[str, float]:
    """Return the unit that a residual is drawn in, and its size in the record's units."""
    unit, size = channel_scale(axis, channel, efforts)
    return ("µm", MICROMETRE) if channel != "force" else (unit, size)


def channel_noise(trail: Trail, diagnosis: Diagnosis) -> float:
    """Return the noise of a trail's channel, NaN where nothing is known of it."""
    known: list[ChannelQuality] = [
        one for one in diagnosis.quality.channels if (one.axis, one.channel) == (trail.axis, trail.channel)
    ]
    return known[0].noise if known else math.nan


def _trail(trail: Trail, diagnosis: Diagnosis, efforts: Mapping[str, str]) -> dict[str, Any]:
    """Return what is drawn of one channel: residuals in its unit, times in s, positions in mm."""
    unit, size = residual_scale(trail.axis, trail.channel, efforts)
    drawn = envelope(trail, POINTS)
    noise = channel_noise(trail, diagnosis)
    return {
        "name": f"{trail.axis}_{trail.channel}",
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


def _sizes(trail: Trail, size: float) -> dict[str, Any]:
    """Root mean squares before and after, over what was fitted and what was held out."""
    held = trail.held_out & trail.counted
    fitted = trail.counted & ~trail.held_out
    sizes = {
        "fitted": [root_mean_square(one, fitted) for one in (trail.before, trail.after)],
        "held_out": [root_mean_square(one, held) for one in (trail.before, trail.after)],
    }
    return {
        name: [one / size if math.isfinite(one) else None for one in pair] for name, pair in sizes.items()
    }


def _span(trail: Trail, stretch: tuple[int, int]) -> list[float]:
    """Return begin and end of a stretch [s]."""
    return [float(f"{trail.t[k]:.7g}") for k in stretch]


def _drawn(profile: Profile | None, across: float, size: float) -> dict[str, Any] | None:
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
