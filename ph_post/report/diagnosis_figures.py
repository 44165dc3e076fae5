"""Figures of diagnoses and identifications: the gap by step, and the residual of every channel."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Final

import numpy as np

from ph_post.api.measurements import LogIdentification
from ph_post.quantities import measured_words, micrometres
from ph_post.report.diagnosis_page import channel_noise, envelope, has_reading, residual_scale, stretches
from ph_post.report.effect_words import gap_words, label_words, verdict_sentences
from ph_post.report.figures import AFTER, MARK, WINDOW, legend_above, new_figure
from ph_post.types import Array
from ph_post.types.diagnosis import Diagnosis, Identification, ResidualTrace
from ph_post.units import MICROMETRE, MM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


POINTS: Final = 2000
"""Groups of neighbouring samples that a residual is drawn with."""

HELD_OUT: Final = "#d7dce4"

TITLE: Final = 3
"""Sentences of the verdict that stand above the picture."""


def draw_diagnosis(diagnosis: Diagnosis, efforts: Mapping[str, str] | None = None) -> Figure:
    """Draw the gap per step on top, and a residual a row below it.

    Parameters
    ----------
    diagnosis : Diagnosis
    efforts : mapping, optional
        Units of the force channels by axis, see :func:`~ph_post.report.diagnoses.effort_units`.
    """
    rows = len(diagnosis.trails)
    steps = max(len(diagnosis.steps), 1)
    figure = new_figure(10.0, 1.8 + 0.5 * steps + 2.2 * rows)
    figure.suptitle("\n".join(verdict_sentences(diagnosis)[:TITLE]), fontsize="medium", wrap=True)
    panels = figure.subplots(1 + rows, 1, squeeze=False, height_ratios=(0.5 + 0.5 * steps, *(2.2,) * rows))
    _draw_gap(panels[0, 0], diagnosis)
    for axes, trail in zip(panels[1:, 0], diagnosis.trails, strict=True):
        _draw_trail(axes, trail, diagnosis, efforts or {})
    if rows:
        panels[-1, 0].set(xlabel="t [s]")
    return figure


def _draw_gap(axes: Axes, diagnosis: Diagnosis) -> None:
    if not diagnosis.steps:
        axes.set_axis_off()
        axes.text(0.5, 0.5, gap_words(diagnosis), ha="center", va="center")
        return
    rows: Array = np.arange(len(diagnosis.steps), dtype=np.float64)
    for offset, colour, label, values in (
        (-0.2, WINDOW, "fitted", [step.fit_rms for step in diagnosis.steps]),
        (0.2, AFTER, "held out", [step.holdout_rms for step in diagnosis.steps]),
    ):
        bars = axes.barh(rows + offset, np.array(values) / MICROMETRE, 0.38, color=colour, label=label)
        axes.bar_label(bars, [f" {micrometres(value)}" for value in values], fontsize="small")
    if diagnosis.noise_floor > 0.0:
        axes.axvline(diagnosis.noise_floor / MICROMETRE, color=MARK, linestyle="--", linewidth=1.2, label="noise floor")
    names = [
        "original machine file" if step.added is None else f"+ {label_words(step.added)}" for step in diagnosis.steps
    ]
    axes.set_yticks(rows, names)
    axes.invert_yaxis()
    axes.margins(x=0.12)
    axes.set(xlabel="residual between log and model, rms [µm]")
    axes.legend(frameon=False, fontsize="small", loc="lower right")


def _draw_trail(axes: Axes, trail: ResidualTrace, diagnosis: Diagnosis, efforts: Mapping[str, str]) -> None:
    unit, size = residual_scale(trail.axis, trail.channel, efforts)
    drawn = envelope(trail, POINTS)
    for first, last in stretches(trail.held_out & trail.counted):
        axes.axvspan(trail.t[first], trail.t[last], color=HELD_OUT, linewidth=0.0, label="held out")
    pairs = [(drawn.before, WINDOW, "original machine file")]
    pairs += [(drawn.after, AFTER, "better machine file")] if len(diagnosis.steps) > 1 else []
    for (low, high), colour, label in pairs:
        # An edge keeps what is thinner than a line in the picture.
        axes.fill_between(drawn.t, low / size, high / size, color=colour, linewidth=0.7, label=label)
    finish_trail(axes, trail, channel_noise(trail, diagnosis), (unit, size))


def finish_trail(axes: Axes, trail: ResidualTrace, noise: float, unit: tuple[str, float]) -> None:
    """Draw the noise into a residual over time, and let what counts set the range.

    The start-up may be many times as large. `unit` is what the residual is drawn in: its name, and its size
    in the units of the log.
    """
    name, size = unit
    if math.isfinite(noise):
        for value in (noise, -noise):
            axes.axhline(value / size, color="black", linestyle=":", linewidth=0.9, label="noise")
    axes.set(ylabel=f"{trail.axis}_{trail.channel}: log - model [{name}]")
    legend_above(axes, columns=5)
    values = np.concatenate([trail.before[trail.counted], trail.after[trail.counted]]) / size
    values = values[np.isfinite(values)]
    if values.size and np.ptp(values) > 0.0:
        room = 0.15 * float(np.ptp(values))
        axes.set_ylim(float(values.min()) - room, float(values.max()) + room)
    if trail.t.size > 1:
        axes.set_xlim(float(trail.t[0]), float(trail.t[-1]))


def draw_identification(found: LogIdentification) -> Figure:
    """Draw log minus model for every reading of a position, with the noise and the command."""
    trails = list(found.residuals())
    figure = new_figure(10.0, 1.2 + 2.2 * max(len(trails), 1))
    panels = figure.subplots(max(len(trails), 1), 1, squeeze=False, sharex=True)[:, 0]
    for axes, (trail, noise) in zip(panels, trails, strict=False):
        _draw_remainder(axes, trail, noise)
    panels[-1].set(xlabel="t [s]")
    figure.suptitle("\n".join(_words(found)), fontsize="medium", wrap=True)
    return figure


def _words(found: Identification) -> Iterator[str]:
    """Name what was identified, a line an axis."""
    for axis, parameters in found.axes.items():
        words = (f"{name} {measured_words(one.value, one.stderr, one.unit)}" for name, one in parameters.items())
        yield f"{axis}: {', '.join(words)}"


def _draw_remainder(axes: Axes, trail: ResidualTrace, noise: float) -> None:
    drawn = envelope(trail, POINTS)
    low, high = drawn.after / MICROMETRE
    axes.fill_between(drawn.t, low, high, color=AFTER, linewidth=0.7, label="log - model")
    finish_trail(axes, trail, noise, ("µm", MICROMETRE))
    beside = axes.twinx()
    # Between windows of a long log nobody knows how it moved.
    beside.plot(trail.t, np.where(has_reading(trail), trail.command / MM, np.nan), color=MARK, linewidth=0.6, alpha=0.5)
    beside.set_ylabel(f"{trail.axis} commanded [mm]", color=MARK)
