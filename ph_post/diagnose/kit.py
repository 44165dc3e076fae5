"""Test programs that make show what a machine file should know: circles, ladders, sweeps, stops."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

from msgspec.structs import replace

from ph_post.diagnose import kitparts as parts
from ph_post.diagnose.kitdraft import Draft
from ph_post.diagnose.kitground import Ground
from ph_post.diagnose.kitlayout import lay_out
from ph_post.diagnose.kitprogram import experiment
from ph_post.diagnose.record import Experiment
from ph_post.errors import InputError
from ph_post.types import Machine
from ph_post.units import MINUTE

WARM_UP: Final = 10.0 * MINUTE
"""How long the run takes that warms the screws [s]."""


LONGEST: Final = 120.0 * MINUTE
"""Longest of such runs [s]."""


def calibration_kit(
    machine: Machine,
    *,
    axes: Sequence[str] = (),
    centre: Sequence[float] = (),
    travel: Sequence[float] = (),
    radius: float | None = None,
    feeds: Sequence[float] = (),
    warm_up: float = WARM_UP,
) -> tuple[Experiment, ...]:
    """Write the test programs of a machine, the one that holds a little of everything first. SI units.

    Parameters
    ----------
    machine : Machine
    axes : sequence of str, optional
        Axes to move; all but Z where none are named: a Z that nobody asked for could meet the table.
    centre : sequence of float, optional
        Middle of the room, by axis [m]; 0.
    travel : sequence of float, optional
        Room of the axes from end to end [m], one for all or one each; 100 mm.
    radius : float, optional
        Of the circles [m]; 0.3 of the room.
    feeds : sequence of float, optional
        Of the circles [m/s]; three up to 0.8 of what speed, acceleration and jerk allow.
    warm_up : float, optional
        How long the run takes that warms the screws [s].

    Raises
    ------
    InputError
        Where the machine lacks an axis, the circles leave the room, or a feed is beyond the machine.
    """
    ground = lay_out(machine, axes, centre, travel, radius, feeds)
    if not (math.isfinite(warm_up) and 0.0 < warm_up <= LONGEST):
        raise InputError(
            "--warm-up",
            "no time for a run",
            expected="minutes, above 0 up to 120",
            got=f"{warm_up / MINUTE:g}",
        )
    return (
        _whole(ground),
        *(one for axis in ground.axes for one in _of_axis(ground, axis)),
        *(one for pair in ground.pairs for one in _of_pair(ground, pair)),
        _warm(ground, warm_up),
    )


def _whole(ground: Ground) -> Experiment:
    why = "a little of everything in one record: steps, sweeps, speeds, circles and diagonals"
    return experiment(ground, "mix", why, lambda draft: parts.mix(draft, ground.axes))


def _of_axis(ground: Ground, axis: str) -> list[Experiment]:
    """Programs that move one axis, and no other."""
    small = axis.lower()
    ground = replace(ground, spans={axis: ground.spans[axis]})
    return [
        experiment(
            ground, f"ladder_{small}", f"steps of {axis} from 0.01 to 10 mm to either side: gap and friction",
            lambda draft: _between(draft, lambda: parts.ladder(draft, axis)),
        ),
        experiment(
            ground, f"sweep_{small}",
            f"all of {axis} slowly and faster, and reversals along it: screw, scale, gap by position",
            lambda draft: _between(
                draft, lambda: parts.sweeps(draft, axis), lambda: parts.places(draft, axis, 7)
            ),
        ),
        experiment(
            ground, f"speed_{small}", f"{axis} at speeds from a crawl up, both ways: friction by speed",
            lambda draft: _between(draft, lambda: parts.speeds(draft, axis)), ("act", "force"),
        ),
        experiment(
            ground, f"fast_{small}",
            f"{axis} with all acceleration, and stops: servo, wind-up, saturation, delay",
            lambda draft: _between(draft, lambda: parts.fast(draft, axis), lambda: parts.stops(draft, axis)),
        ),
    ]  # fmt: skip


def _of_pair(ground: Ground, pair: tuple[str, str]) -> list[Experiment]:
    """Programs that move two axes at a time."""
    ground = replace(ground, spans={axis: ground.spans[axis] for axis in pair})
    small, names = "".join(pair).lower(), f"{pair[0]} and {pair[1]}"
    return [
        experiment(
            ground, f"circles_{small}",
            f"circles in {names} at several feeds both ways: gap, servo mismatch, delay, pick-up",
            lambda draft: _between(
                draft, lambda: parts.circles(draft, pair, ground.feeds, ground.radius),
                lambda: parts.small_circles(draft, pair),
            ),
        ),
        experiment(
            ground, f"diagonals_{small}", f"both diagonals of {names}, to and fro: squareness beside scale",
            lambda draft: _between(draft, lambda: parts.diagonals(draft, pair)), gauge=True,
        ),
    ]  # fmt: skip


def _warm(ground: Ground, seconds: float) -> Experiment:
    """Let the screws grow, and look at the same way again and again."""

    def write(draft: Draft) -> None:
        def look() -> None:
            for axis in ground.axes:
                parts.sweeps(draft, axis, (ground.slow(axis, 0.25 * parts.SLOW_SWEEP),))

        parts.standstill(draft)
        parts.warm_up(draft, ground.axes, seconds, look)

    why = "a long run from cold with the same sweeps again and again: growth by warmth, beside scale"
    return experiment(ground, "warm_up", why, write, gauge=True)


def _between(draft: Draft, *motions: Callable[[], None]) -> None:
    """Stand still before, between and after, for the noise floor."""
    parts.standstill(draft)
    for motion in motions:
        motion()
        parts.standstill(draft)
