"""Comments at the head of a program, and warnings to its user; the same bytes for the same input."""

from __future__ import annotations

import re
from typing import Final

import numpy as np

from ph_post.compensate.layout import rest_at
from ph_post.compensate.motion import cycle_time
from ph_post.dialects.base import Dialect
from ph_post.gcode.blocks import Moves
from ph_post.post.feeds import FOLLOWS
from ph_post.post.moves import read_jogs
from ph_post.post.options import ProgramOptions
from ph_post.types import Array, IntArray, Plan
from ph_post.units import MM, MM_PER_MIN, MS
from ph_post.version import package_version

_DIGEST = 16
"""So many hexadecimal digits of an input's hash: enough to distinguish inputs."""


def header_lines(plan: Plan, dialect: Dialect, options: ProgramOptions) -> list[str]:
    """Return comment lines: inputs and their hashes, the method, and what the program takes for granted."""
    remarks = [
        *_origin(plan),
        *_manner(plan, dialect, options),
        *(_window(plan, number) for number in range(len(plan.windows))),
        *_offsets(plan),
        *_assumptions(plan, dialect, options),
    ]
    return [line for remark in remarks for line in dialect.comment(remark)]


def _origin(plan: Plan) -> list[str]:
    path, machine = plan.path, plan.machine
    return [
        f"ph-post {package_version()}, strategy {plan.strategy}",
        *(
            f"{kind} {one.name}" + (f", sha256 {one.digest[:_DIGEST]}" if one.digest else "")
            for kind, one in (("path", path), ("machine", machine))
        ),
    ]


def _manner(plan: Plan, dialect: Dialect, options: ProgramOptions) -> list[str]:
    feed = "inverse time, F in 1/min" if options.feed_mode == "inverse-time" else "F in mm/min"
    chord, block = options.chord_tolerance / MM, options.block_time / MS
    rounding = "" if dialect.syntax.path_mode is None else f", joints rounded by at most {chord:g} mm more"
    dips = f"blocks of at most {block:g} ms in ramps and dips"
    if dialect.abilities.feed_degree:
        part = 100.0 * FOLLOWS
        dips = f"feed in ramps and dips within {part:g} percent but for the last milliseconds beside a stop"
    return [
        f"dialect {dialect.name}, lengths in mm, {feed}",
        f"planned time {cycle_time(plan.nominal):.4f} s without feed dips,"
        f" {cycle_time(read_jogs(plan).phases):.4f} s with them",
        f"chords within {chord:g} mm of the path{rounding}, {dips}",
    ]


def _window(plan: Plan, number: int) -> str:
    window, profile = plan.windows[number], plan.profiles[number]
    point = plan.turning_points[window.turning_point]
    place = f"segment {point.segment}, s {window.s / MM:.3f} mm, {point.axis} {point.sense}"
    if profile is None:
        what = "feed kept" if rest_at(plan.phases, window.s) is None else "a stop"
        return f"window {number}: {place}, {what}"
    high = profile.cruise / MM_PER_MIN
    low = profile.ratio * high
    return f"window {number}: {place}, feed {high:.6g} to {low:.6g} mm/min, t* {profile.t_star:.4f} s"


_SIDES: Final = {0: "towards the side it moves to", 1: "while it moves to minus", -1: "while it moves to plus"}
"""Where an offset is carried, by the side to which positions are referred."""


SHIFTED: Final = re.compile(rb"axis [XYZ] (carries an offset of|goes out by up to) ", re.IGNORECASE)
"""What the head of a program says whose blocks are not on the path that it was made from."""


def is_shifted(data: bytes) -> bool:
    """Return whether a program made from a path says that it leaves the path to cross backlash."""
    return SHIFTED.search(data) is not None


NO_OFFSET: Final = 1e-9
"""Offsets [m] smaller than this are rounding."""


def _offsets(plan: Plan) -> list[str]:
    """Say by how much which axes leave the path, and how they come to it."""
    found = read_jogs(plan)
    jogs, facts = found.jogs, []
    for axis, first in zip(plan.path.axes, found.first.tolist(), strict=True):
        own = [jog for jog in jogs if jog.axis == axis]
        size = max((abs(jog.travel) for jog in own), default=0.0) / MM
        if own and not plan.machine.axes[axis].loop.encloses_backlash:
            side = plan.machine.axes[axis].reference_side
            where = _SIDES[side]
            facts.append(
                f"axis {axis} carries an offset of {size / (1.0 if side else 2.0):g} mm from the path {where},"
                f" changed at {len(own)} stops by a G1 between dwells, and taken back at the end"
            )
        elif abs(first) > NO_OFFSET:
            facts.append(
                f"axis {axis} carries an offset of {first / MM:g} mm from the path all along, taken back at the end"
            )
        elif own:
            facts.append(
                f"axis {axis} goes out by up to {size:.4g} mm and back at {len(own) // 2} stops, by a G1"
                " between dwells each"
            )
    if jogs:
        steepest = max(jog.acceleration for jog in jogs) / MM
        facts.append(f"these G1 are planned with straight ramps of up to {steepest:g} mm/s2 and no limit of jerk")
    return facts


def _assumptions(plan: Plan, dialect: Dialect, options: ProgramOptions) -> list[str]:
    """Say what has to hold for the program to do what it was planned for."""
    facts = [*dialect.assumed, *dialect.notices.remarks(plan.machine.own_correction)]
    if dialect.syntax.path_mode is not None:
        facts.append("the path mode of the last cut stays in force after the program")
    if "Z" in plan.path.axes:
        facts.append("Z is approached from above, whatever its first motion")
    if options.safe_z is not None:
        facts.append(f"safe height Z {options.safe_z / MM:g} mm")
    elif "Z" in plan.path.axes:
        facts.append("no safe height: the approach begins at the height at which the tool stands")
    else:
        facts.append("no Z word: the tool stays at the height at which it stands")
    return facts


_LATE = 1e-3
"""A program that the controller's servo period makes longer by less than this part is as good as planned."""


def plan_warnings(plan: Plan, options: ProgramOptions, moves: Moves) -> tuple[str, ...]:
    """Return warnings about what the program leaves to the user and to the controller."""
    warnings = []
    if "Z" not in plan.path.axes and options.depth is None:
        warnings.append("no Z word is written, as neither --safe-z nor --depth is given: the tool keeps its height")
    if moves.rapid.any() and options.depth is None:
        hint = "" if "Z" in plan.path.axes else ": --safe-z and --depth lift the tool there"
        warnings.append(f"rapid segments run as the path has them, no lift, and no new approach{hint}")
    if plan.phases and (plan.phases[0].speed[0] != 0.0 or plan.phases[-1].speed[-1] != 0.0):
        warnings.append("the plan begins or ends at speed, which the controller reaches and leaves in its own time")
    return tuple(warnings)


def controller_warnings(
    plan: Plan, dialect: Dialect, options: ProgramOptions, moves: Moves, sizes: IntArray
) -> tuple[str, ...]:
    """Return warnings of moves that the controller cannot follow; `sizes` are the bytes of each move."""
    warnings = []
    period = plan.machine.servo_period
    missing = np.where(moves.rapid == 0, np.maximum(period - moves.duration, 0.0), 0.0)
    if missing.sum() > _LATE * moves.duration.sum():
        warnings.append(
            f"{int((missing > 0.0).sum())} of {moves.kind.size} blocks are shorter than the servo period of"
            f" {period / MS:g} ms and cost {missing.sum():.3g} s: try a larger --chord-tolerance"
        )
    stream = dialect.abilities.stream
    if stream is not None and (rate := _stream_rate(stream.window, moves.duration, sizes)) > stream.rate:
        warnings.append(
            f"in places the controller needs {rate:.0f} bytes a second and gets {stream.rate:.0f}:"
            " try a longer --block-time or a larger --chord-tolerance"
        )
    coarse = [off for off in moves.off.values() if off > FOLLOWS]
    if coarse:
        warnings.append(
            f"{len(coarse)} of {len(moves.off)} blocks with a changing feed are off the planned feed by up to"
            f" {100.0 * max(coarse):.2g} percent: the servo period lets them be no shorter, or another feed"
            " is in force before them"
        )
    if options.feed_mode == "inverse-time" and "arc" not in dialect.abilities.inverse_time:
        warnings.append(f"no G2 and G3 are written, as {dialect.name} does not keep their time under G93")
    return tuple(warnings)


def _stream_rate(window: int, duration: Array, sizes: IntArray) -> float:
    """Most bytes a second over so many moves one after the other."""
    held = np.ones(min(window, duration.size))
    return float((np.convolve(sizes, held, "valid") / np.convolve(duration, held, "valid")).max())
