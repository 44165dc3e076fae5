"""Options of a part program, and their checks."""

from __future__ import annotations

from typing import Literal

import msgspec
import numpy as np

from ph_post.errors import InputError
from ph_post.types import Path
from ph_post.units import MM, MS

FeedMode = Literal["per-minute", "inverse-time"]

CHORD_TOLERANCE = 1e-3 * MM
"""Default chord tolerance [m]: 1 µm, a fifth of the default window tolerance, finer than the differences that
the windows decide about; on a radius of 20 mm it gives chords of 0.4 mm."""

BLOCK_TIME = 5.0 * MS
"""Longest block in ramps and dips [s]. LinuxCNC follows a dip in blocks of 5 ms within 0.5 % of the feed, in
blocks of 20 ms within 3 %; at 115,200 baud a line of 40 characters takes 3.5 ms."""


class ProgramOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Options for writing a part program; lengths in m, times in s.

    Parameters
    ----------
    feed_mode : "per-minute" or "inverse-time"
        F words in mm/min (G94), or the inverse of each block's time in minutes (G93).
    chord_tolerance : float
        Largest distance of the path from a straight move.
    block_time : float
        Longest block in ramps and dips, not below the servo period.
    safe_z, depth : float or None
        Height at which the path is approached and left, and, for planar paths, at which it is cut.
    """

    feed_mode: FeedMode = "per-minute"
    chord_tolerance: float = CHORD_TOLERANCE
    block_time: float = BLOCK_TIME
    safe_z: float | None = None
    depth: float | None = None


def check_options(options: ProgramOptions, path: Path, servo_period: float) -> None:
    """Refuse options with which no program can be written; `servo_period` [s].

    Raises
    ------
    InputError
        With the option's name as the command line has it.
    """
    if not options.chord_tolerance > 0.0:
        raise _refusal("--chord-tolerance", "not positive", "> 0 mm", options.chord_tolerance / MM)
    check_block_time(options.block_time, servo_period)
    if "Z" in path.axes:
        _check_spatial(options, path)
    else:
        _check_planar(options)


def check_block_time(block_time: float, servo_period: float) -> None:
    """Refuse blocks [s] that are shorter than the servo period [s]; raises as :func:`check_options`."""
    if not block_time >= servo_period:
        raise _refusal("--block-time", "shorter than the servo period", f">= {servo_period / MS:g} ms", block_time / MS)


def _check_spatial(options: ProgramOptions, path: Path) -> None:
    if options.depth is not None:
        raise _refusal("--depth", "the path has its own Z", "no depth", options.depth / MM)
    if options.safe_z is None:
        return
    first, last = path.segments[0].curve, path.segments[-1].curve
    ends = [first.derivatives(np.array(first.domain[:1])), last.derivatives(np.array(last.domain[1:]))]
    highest = max(float(end[0, 0, path.axes.index("Z")]) for end in ends)
    if options.safe_z < highest:
        what, expected = "below an end of the path", f">= {highest / MM:g} mm"
        raise _refusal("--safe-z", what, expected, options.safe_z / MM)


def _check_planar(options: ProgramOptions) -> None:
    depth, safe = options.depth, options.safe_z
    if depth is not None and safe is None:
        raise _refusal("--depth", "a depth needs a height to come from", "--safe-z beside it", depth / MM)
    if depth is None and safe is not None:
        raise _refusal("--safe-z", "a safe height needs a depth to go to", "--depth beside it", safe / MM)
    if depth is not None and safe is not None and safe <= depth:
        raise _refusal("--safe-z", "not above the depth", f"> {depth / MM:g} mm", safe / MM)


def _refusal(option: str, what: str, expected: str, got: float) -> InputError:
    return InputError(option, what, expected=expected, got=f"{got:g}")
