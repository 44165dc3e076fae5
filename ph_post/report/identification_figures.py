"""The picture of an identification: what the machine that was found leaves of the record."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ph_post.diagnose.fit import base_model, left_of
from ph_post.diagnose.identification import Identification
from ph_post.diagnose.model import problem_of
from ph_post.diagnose.quality import examine
from ph_post.diagnose.record import Trail
from ph_post.report.diagnosisfigures import finish_trail
from ph_post.report.figures import AFTER, MARK, new_figure
from ph_post.report.findingwords import number_words
from ph_post.report.residuals import envelope
from ph_post.types import Log
from ph_post.units import MICROMETRE, MM

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

POINTS = 2000
"""Groups of neighbouring samples that are drawn."""


def draw_identification(found: Identification, log: Log) -> Figure:
    """Draw record less model for every reading of a position, with the noise and the command."""
    trails = list(_trails(found, log))
    figure = new_figure(10.0, 1.2 + 2.2 * max(len(trails), 1))
    panels = figure.subplots(max(len(trails), 1), 1, squeeze=False, sharex=True)[:, 0]
    for axes, (trail, noise) in zip(panels, trails, strict=False):
        _draw_trail(axes, trail, noise)
    panels[-1].set(xlabel="t [s]")
    figure.suptitle("\n".join(_words(found)), fontsize="medium", wrap=True)
    return figure


def _words(found: Identification) -> Iterator[str]:
    """Name what was identified, a line an axis."""
    for axis, parameters in found.axes.items():
        known = ((name, *number_words(one), one.unit) for name, one in parameters.items())
        told = [
            f"{name} {value}{'' if error is None else f' ± {error}'} {unit}"
            for name, value, error, unit in known
        ]
        yield f"{axis}: {', '.join(told)}"


def _trails(found: Identification, log: Log) -> Iterator[tuple[Trail, float]]:
    """Run the machine that was found on the recorded command, and return what it leaves, with the noise."""
    quality = examine(log, found.machine)
    for name in found.drives:
        problem = problem_of(log, name, found.machine.axes[name], quality)
        if problem is None:
            continue
        left = left_of(problem, base_model(problem))
        for one in problem.observed:
            if one.channel != "force":
                counted = problem.counted & one.ok
                trail = Trail(
                    axis=name, channel=one.channel, t=problem.t, command=problem.command,
                    before=left[one.channel], after=left[one.channel], counted=counted,
                    held_out=np.zeros_like(counted),
                )  # fmt: skip
                yield trail, one.noise


def _draw_trail(axes: Axes, trail: Trail, noise: float) -> None:
    drawn = envelope(trail, POINTS)
    low, high = drawn.after / MICROMETRE
    axes.fill_between(drawn.t, low, high, color=AFTER, linewidth=0.7, label="record - model")
    finish_trail(axes, trail, noise, ("µm", MICROMETRE))
    beside = axes.twinx()
    beside.plot(trail.t, trail.command / MM, color=MARK, linewidth=0.6, alpha=0.5)
    beside.set_ylabel(f"{trail.axis} commanded [mm]", color=MARK)
