"""Motions that make an effect visible; each writes its part of a test program and returns to the centre."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from ph_post.testprograms.builder import ARC_SHARE, CRAWL, TOP_SHARE, ProgramBuilder, arc_speed
from ph_post.units import MINUTE, MM

STEPS: Final = tuple(step * MM for step in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0))
"""Rungs of a reversal ladder [m]: from below any gap worth the name to above all of them."""

FEW_STEPS: Final = tuple(step * MM for step in (0.02, 0.1, 0.5, 2.0, 10.0))

SLOW_SWEEP: Final = 20.0
"""Time of the slowest sweep over the whole room [s]: enough samples within every turn of a screw."""

PERIODS_APART: Final = 8.0
"""The fast sweep is so many times as fast: a force that repeats with the travel is filtered by the loop
otherwise at either feed, an error of the screw is not."""

STROKE_TIME: Final = 3.0
"""Time of one stroke [s] where friction is to be seen by speed."""

SHORT: Final = 5.0 * MM
"""Radius of small circles [m]: high accelerations at speeds that the axes have."""

ACCELERATIONS: Final = (0.02, 0.1, 0.25, ARC_SHARE)
"""Accelerations of the ladder, as shares of the limit."""

PLACES: Final = 5
"""Where along an axis it is turned round."""


def circles(
    draft: ProgramBuilder, pair: tuple[str, str], feeds: Sequence[float], radius: float, turns: int = 2
) -> None:
    """Go around at every feed, counterclockwise and clockwise; of two turns the first settles."""
    draft.say(f"circles in {pair[0]} and {pair[1]}, each feed counterclockwise, then clockwise")
    for feed in feeds:
        for turn in (1, -1):
            draft.circle(pair, radius, turn, feed, turns)
    draft.home()


def small_circles(draft: ProgramBuilder, pair: tuple[str, str]) -> None:
    """Go around one small radius with accelerations from a little to as much as arcs may have."""
    ground = draft.ground
    radius = min(SHORT, ground.radius)
    draft.say("small circles with more and more acceleration")
    for share in ACCELERATIONS:
        speed = TOP_SHARE * arc_speed(ground.machine, pair, radius, share)
        for turn in (1, -1):
            draft.circle(pair, radius, turn, speed, turns=3)
    draft.home()


def ladder(draft: ProgramBuilder, axis: str, steps: Sequence[float] = STEPS, *, back: bool = True) -> None:
    """Step to either side and back, with a rest behind each: small to large, and then `back`."""
    ground = draft.ground
    centre, speed = ground.centre(axis), min(20.0 * MM, TOP_SHARE * ground.top(axis))
    rungs = [step for step in steps if step <= ground.half(axis)]
    draft.say(f"reversal ladder of {axis}")
    for step in [*rungs, *(reversed(rungs) if back else ())]:
        for place in (centre + step, centre, centre - step, centre):
            draft.line({axis: place}, speed)
            draft.dwell(ground.settle)


def places(draft: ProgramBuilder, axis: str, count: int = PLACES) -> None:
    """Turn an axis round at places along its room, to and fro twice at each."""
    ground = draft.ground
    low, _ = ground.spans[axis]
    swing = min(2.0 * MM, ground.half(axis) / count)
    speed, way = TOP_SHARE * ground.top(axis), 2.0 * ground.half(axis) - swing
    draft.say(f"{axis} is turned round at {count} places along its way")
    for k in range(count):
        place = low + way * k / (count - 1)
        draft.line({axis: place}, speed)
        for _ in range(2):
            for target in (place + swing, place):
                draft.line({axis: target}, min(speed, 20.0 * MM))
                draft.dwell(ground.settle)
    draft.home()


def sweeps(draft: ProgramBuilder, axis: str, feeds: Sequence[float] = ()) -> None:
    """Go over the whole room, to and fro at each feed; without `feeds` at one slow and one much faster."""
    ground = draft.ground
    slow = ground.slow(axis, SLOW_SWEEP)
    low, high = ground.spans[axis]
    draft.say(f"sweeps of {axis} over all of its way, to and fro")
    draft.line({axis: low}, TOP_SHARE * ground.top(axis))
    draft.dwell(ground.settle)
    for feed in feeds or (slow, min(PERIODS_APART * slow, TOP_SHARE * ground.top(axis))):
        for target in (high, low):
            draft.line({axis: target}, feed)
            draft.dwell(ground.settle)
    draft.home()


def speeds(draft: ProgramBuilder, axis: str, count: int = 8, stroke: float = STROKE_TIME) -> None:
    """Make strokes to and fro at constant speeds, from a crawl to nearly all there is, equal in ratio."""
    ground = draft.ground
    top = TOP_SHARE * ground.top(axis)
    low = min(CRAWL, 0.1 * top)
    draft.say(f"strokes of {axis} at {count} speeds, to and fro")
    for k in range(count):
        speed = low * (top / low) ** (k / (count - 1))
        reach = min(ground.half(axis), 0.5 * stroke * speed)
        for off in (reach, -reach, reach, -reach):
            draft.line({axis: ground.centre(axis) + off}, speed)
        draft.dwell(ground.settle)
    draft.home()


def diagonals(draft: ProgramBuilder, pair: tuple[str, str], times: int = 2) -> None:
    """Go along both diagonals of the largest square, to and fro: an angle tells them apart."""
    ground = draft.ground
    half = min(ground.half(axis) for axis in pair)
    speed = min(2.0 * half / 5.0, TOP_SHARE * ground.top(*pair))
    first, second = (ground.centre(axis) for axis in pair)
    draft.say(f"both diagonals of {pair[0]} and {pair[1]}, to and fro")
    for sign in (1.0, -1.0):
        for end in (-1.0, *times * (1.0, -1.0)):
            place = (first + end * half, second + sign * end * half)
            draft.line(dict(zip(pair, place, strict=True)), speed)
            draft.dwell(ground.settle)
        draft.home()


def fast(draft: ProgramBuilder, axis: str, shares: Sequence[float] = (1.0, 0.5, 0.2, 0.1)) -> None:
    """Make strokes at the greatest speed, long and short: the controller takes all acceleration it may."""
    ground = draft.ground
    centre, speed = ground.centre(axis), ground.top(axis)
    draft.say(f"strokes of {axis} at full speed and acceleration")
    for share in shares:
        reach = share * ground.half(axis)
        for _ in range(2):
            draft.line({axis: centre + reach}, speed)
            draft.line({axis: centre - reach}, speed)
        draft.dwell(ground.settle)
    draft.home()


def stops(draft: ProgramBuilder, axis: str) -> None:
    """Come to a standstill out of several speeds, from both sides, and stay: how the loop comes to rest."""
    ground = draft.ground
    centre, top = ground.centre(axis), TOP_SHARE * ground.top(axis)
    draft.say(f"{axis} stops out of several speeds, and rests")
    for share in (0.1, 0.3, 1.0):
        for side in (1.0, -1.0):
            draft.line({axis: centre - side * 0.8 * ground.half(axis)}, top)
            draft.dwell(ground.settle)
            draft.line({axis: centre}, share * top)
            draft.dwell(1.0 + ground.settle)


def standstill(draft: ProgramBuilder, seconds: float = 3.0) -> None:
    """Stand still: what is read then is noise."""
    draft.say(f"standstill for {seconds:g} s")
    draft.dwell(seconds)


def warm_up(draft: ProgramBuilder, axes: Sequence[str], seconds: float, sweep: Callable[[], None]) -> None:
    """Run the axes warm, and `sweep` at the beginning, every two minutes and at the end."""
    ground = draft.ground
    speed = 0.5 * ground.top(*axes)
    end = draft.seconds + seconds
    sweep()
    while draft.seconds < end:
        until = min(draft.seconds + 2.0 * MINUTE, end)
        draft.say("strokes that warm the screws")
        while draft.seconds < until:
            for side in (0.9, -0.9):
                draft.line({axis: ground.centre(axis) + side * ground.half(axis) for axis in axes}, speed)
        draft.home()
        draft.dwell(1.0)
        sweep()


def mix(draft: ProgramBuilder, axes: Sequence[str]) -> None:
    """Put everything into one record: what a first look at a machine needs."""
    ground = draft.ground
    standstill(draft)
    for axis in axes:
        ladder(draft, axis, FEW_STEPS, back=False)
        places(draft, axis, 3)
        sweeps(draft, axis, (ground.slow(axis, 0.25 * SLOW_SWEEP),))
        speeds(draft, axis, 4, STROKE_TIME / 3.0)
        fast(draft, axis, (1.0, 0.1))
    for pair in ground.pairs:
        if set(pair) <= set(axes):
            circles(draft, pair, ground.feeds, ground.radius, turns=1)
            diagonals(draft, pair, times=1)
    standstill(draft)


Part = Callable[[ProgramBuilder, str], None]
"""Writes motions about an axis, with another one where that is needed and there."""


def _in_the_plane(of_pair: Callable[[ProgramBuilder, tuple[str, str]], None], alone: Part) -> Part:
    """Take the axis with the next one, or do without where it is the only one."""

    def part(draft: ProgramBuilder, axis: str) -> None:
        pair = next((pair for pair in draft.ground.pairs if axis in pair), None)
        if pair is None:
            alone(draft, axis)
        else:
            of_pair(draft, pair)

    return part


def _rungs(draft: ProgramBuilder, axis: str) -> None:
    """Climb a ladder with the steps that every feed makes in a fifth of a second, beside usual ones."""
    own = [0.2 * feed for feed in draft.ground.feeds]
    ladder(draft, axis, sorted({*FEW_STEPS, *own}))


def _warmer(draft: ProgramBuilder, axis: str) -> None:
    slow = draft.ground.slow(axis, 0.5 * SLOW_SWEEP)
    warm_up(draft, (axis,), 10.0 * MINUTE, lambda: sweeps(draft, axis, (slow,)))


def _all_circles(draft: ProgramBuilder, pair: tuple[str, str]) -> None:
    circles(draft, pair, draft.ground.feeds, draft.ground.radius)


PARTS: Final[Mapping[str, Part]] = {
    "standstill": lambda draft, _axis: standstill(draft),
    "ladder": _rungs,
    "places": places,
    "sweeps": sweeps,
    "speeds": speeds,
    "circles": _in_the_plane(_all_circles, lambda draft, axis: sweeps(draft, axis, draft.ground.feeds)),
    "small circles": _in_the_plane(small_circles, fast),
    "diagonals": _in_the_plane(diagonals, sweeps),
    "fast": fast,
    "stops": stops,
    "warm-up": _warmer,
    "mix": lambda draft, _axis: mix(draft, draft.ground.axes),
}
"""Every motion by what it is called in the table of experiments."""
