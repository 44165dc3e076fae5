"""What a user should know about a program before it runs."""

from __future__ import annotations

import numpy as np

from ph_post.gcode.dialect import Dialect
from ph_post.gcode.feedpieces import FOLLOWS
from ph_post.gcode.options import ProgramOptions
from ph_post.gcode.record import Moves
from ph_post.types import Array, IntArray, Plan
from ph_post.units import MS

_LATE = 1e-3
"""A program that the controller's servo period makes longer by less than this part is as good as planned."""


def plan_warnings(plan: Plan, options: ProgramOptions, moves: Moves) -> tuple[str, ...]:
    """Warnings about what the program leaves to the user and to the controller."""
    warnings = []
    if "Z" not in plan.path.axes and options.depth is None:
        warnings.append(
            "no Z word is written, as neither --safe-z nor --depth is given: the tool keeps its height"
        )
    if moves.rapid.any() and options.depth is None:
        hint = "" if "Z" in plan.path.axes else ": --safe-z and --depth lift the tool there"
        warnings.append(f"rapid segments run as the path has them, no lift, and no new approach{hint}")
    if plan.phases and (plan.phases[0].speed[0] != 0.0 or plan.phases[-1].speed[-1] != 0.0):
        warnings.append(
            "the plan begins or ends at speed, which the controller reaches and leaves in its own time"
        )
    return tuple(warnings)


def controller_warnings(
    plan: Plan, dialect: Dialect, options: ProgramOptions, moves: Moves, sizes: IntArray
) -> tuple[str, ...]:
    """Warnings about what the controller will not be able to follow; `sizes` are the bytes of each move."""
    warnings = []
    period = plan.machine.servo_period
    missing = np.where(moves.rapid == 0, np.maximum(period - moves.duration, 0.0), 0.0)
    if missing.sum() > _LATE * moves.duration.sum():
        warnings.append(
            f"{int((missing > 0.0).sum())} of {moves.kind.size} blocks are shorter than the servo period of"
            f" {period / MS:g} ms and cost {missing.sum():.3g} s: try a larger --chord-tolerance"
        )
    rate = _stream_rate(dialect.stream_window, moves.duration, sizes)
    if dialect.stream_rate is not None and rate > dialect.stream_rate:
        warnings.append(
            f"in places the controller needs {rate:.0f} bytes a second and gets {dialect.stream_rate:.0f}:"
            " try a longer --block-time or a larger --chord-tolerance"
        )
    coarse = [off for off in moves.off.values() if off > FOLLOWS]
    if coarse:
        warnings.append(
            f"{len(coarse)} of {len(moves.off)} blocks with a changing feed are off the planned feed by up to"
            f" {100.0 * max(coarse):.2g} percent: the servo period lets them be no shorter, or another feed"
            " is in force before them"
        )
    if options.feed_mode == "inverse-time" and not dialect.inverse_time_arcs:
        warnings.append(f"no G2 and G3 are written, as {dialect.name} does not keep their time under G93")
    return tuple(warnings)


def _stream_rate(window: int, duration: Array, sizes: IntArray) -> float:
    """Most bytes a second over so many moves one after the other."""
    held = np.ones(min(window, duration.size))
    return float((np.convolve(sizes, held, "valid") / np.convolve(duration, held, "valid")).max())
