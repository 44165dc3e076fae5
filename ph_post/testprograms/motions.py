"""Motions that make an effect visible; each writes its part of a test program and returns to the centre."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from ph_post.testprograms.builder import ARC_SHARE, CRAWL, TOP_SHARE, ProgramBuilder, arc_speed
from ph_post.units import MINUTE, MM

STEPS: Final = tuple(step * MM for step in (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0))
"""Rungs of a reversal ladder [m]: from below any backlash worth the name to above all of them."""

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
"""Number of places along an axis at which it reverses."""


def circles(
    builder: ProgramBuilder, pair: tuple[str, str], feeds: Sequence[float], radius: float, turns: int = 2
) -> None:
    """Go around at every feed, counterclockwise and clockwise; of two turns the first settles."""
    builder.say(f"circles in {pair[0]} and {pair[1]}, each feed counterclockwise, then clockwise")
    for feed in feeds:
        for turn in (1, -1):
            builder.circle(pair, radius, turn, feed, turns)
    builder.home()


def small_circles(builder: ProgramBuilder, pair: tuple[str, str]) -> None:
    """Go around one small radius with accelerations from a little to as much as arcs may have."""
    volume = builder.volume
    radius = min(SHORT, volume.radius)
    builder.say("small circles with more and more acceleration")
    for share in ACCELERATIONS:
        speed = TOP_SHARE * arc_speed(volume.machine, pair, radius, share)
        for turn in (1, -1):
            builder.circle(pair, radius, turn, speed, turns=3)
    builder.home()


def ladder(builder: ProgramBuilder, axis: str, steps: Sequence[float] = STEPS, *, back: bool = True) -> None:
    """Step to either side and back, with a rest behind each: small to large, and then `back`."""
    volume = builder.volume
    centre, speed = volume.centre(axis), min(20.0 * MM, TOP_SHARE * volume.top(axis))
    rungs = [step for step in steps if step <= volume.half(axis)]
    builder.say(f"reversal ladder of {axis}")
    for step in [*rungs, *(reversed(rungs) if back else ())]:
        for place in (centre + step, centre, centre - step, centre):
            builder.line({axis: place}, speed)
            builder.dwell(volume.settle)


def places(builder: ProgramBuilder, axis: str, count: int = PLACES) -> None:
    """Turn an axis round at places along its room, to and fro twice at each."""
    volume = builder.volume
    low, _ = volume.spans[axis]
    swing = min(2.0 * MM, volume.half(axis) / count)
    speed, way = TOP_SHARE * volume.top(axis), 2.0 * volume.half(axis) - swing
    builder.say(f"{axis} is turned round at {count} places along its way")
    for k in range(count):
        place = low + way * k / (count - 1)
        builder.line({axis: place}, speed)
        for _ in range(2):
            for target in (place + swing, place):
                builder.line({axis: target}, min(speed, 20.0 * MM))
                builder.dwell(volume.settle)
    builder.home()


def sweeps(builder: ProgramBuilder, axis: str, feeds: Sequence[float] = ()) -> None:
    """Go over the whole room, to and fro at each feed; without `feeds` at one slow and one much faster."""
    volume = builder.volume
    slow = volume.slow(axis, SLOW_SWEEP)
    low, high = volume.spans[axis]
    builder.say(f"sweeps of {axis} over all of its way, to and fro")
    builder.line({axis: low}, TOP_SHARE * volume.top(axis))
    builder.dwell(volume.settle)
    for feed in feeds or (slow, min(PERIODS_APART * slow, TOP_SHARE * volume.top(axis))):
        for target in (high, low):
            builder.line({axis: target}, feed)
            builder.dwell(volume.settle)
    builder.home()


def speeds(builder: ProgramBuilder, axis: str, count: int = 8, stroke: float = STROKE_TIME) -> None:
    """Make strokes to and fro at constant speeds, from a crawl to nearly all there is, equal in ratio."""
    volume = builder.volume
    top = TOP_SHARE * volume.top(axis)
    low = min(CRAWL, 0.1 * top)
    builder.say(f"strokes of {axis} at {count} speeds, to and fro")
    for k in range(count):
        speed = low * (top / low) ** (k / (count - 1))
        reach = min(volume.half(axis), 0.5 * stroke * speed)
        for off in (reach, -reach, reach, -reach):
            builder.line({axis: volume.centre(axis) + off}, speed)
        builder.dwell(volume.settle)
    builder.home()


def diagonals(builder: ProgramBuilder, pair: tuple[str, str], times: int = 2) -> None:
    """Go along both diagonals of the largest square, to and fro: an angle makes one longer."""
    volume = builder.volume
    half = min(volume.half(axis) for axis in pair)
    speed = min(2.0 * half / 5.0, TOP_SHARE * volume.top(*pair))
    first, second = (volume.centre(axis) for axis in pair)
    builder.say(f"both diagonals of {pair[0]} and {pair[1]}, to and fro")
    for sign in (1.0, -1.0):
        for end in (-1.0, *times * (1.0, -1.0)):
            place = (first + end * half, second + sign * end * half)
            builder.line(dict(zip(pair, place, strict=True)), speed)
            builder.dwell(volume.settle)
        builder.home()


def fast(builder: ProgramBuilder, axis: str, shares: Sequence[float] = (1.0, 0.5, 0.2, 0.1)) -> None:
    """Make strokes at the greatest speed, long and short: the controller takes all acceleration it may."""
    volume = builder.volume
    centre, speed = volume.centre(axis), volume.top(axis)
    builder.say(f"strokes of {axis} at full speed and acceleration")
    for share in shares:
        reach = share * volume.half(axis)
        for _ in range(2):
            builder.line({axis: centre + reach}, speed)
            builder.line({axis: centre - reach}, speed)
        builder.dwell(volume.settle)
    builder.home()


def stops(builder: ProgramBuilder, axis: str) -> None:
    """Come to a standstill out of several speeds, from both sides, and stay: how the loop comes to rest."""
    volume = builder.volume
    centre, top = volume.centre(axis), TOP_SHARE * volume.top(axis)
    builder.say(f"{axis} stops out of several speeds, and rests")
    for share in (0.1, 0.3, 1.0):
        for side in (1.0, -1.0):
            builder.line({axis: centre - side * 0.8 * volume.half(axis)}, top)
            builder.dwell(volume.settle)
            builder.line({axis: centre}, share * top)
            builder.dwell(1.0 + volume.settle)


def standstill(builder: ProgramBuilder) -> None:
    """Stand still for 3 s: what is read then is noise."""
    builder.say("standstill for 3 s")
    builder.dwell(3.0)


def warm_up(builder: ProgramBuilder, axes: Sequence[str], seconds: float, sweep: Callable[[], None]) -> None:
    """Run the axes warm, and `sweep` at the beginning, every two minutes and at the end."""
    volume = builder.volume
    speed = 0.5 * volume.top(*axes)
    end = builder.seconds + seconds
    sweep()
    while builder.seconds < end:
        until = min(builder.seconds + 2.0 * MINUTE, end)
        builder.say("strokes that warm the screws")
        while builder.seconds < until:
            for side in (0.9, -0.9):
                builder.line({axis: volume.centre(axis) + side * volume.half(axis) for axis in axes}, speed)
        builder.home()
        builder.dwell(1.0)
        sweep()


def mix(builder: ProgramBuilder, axes: Sequence[str]) -> None:
    """Put everything into one program, as a first look at a machine needs."""
    volume = builder.volume
    standstill(builder)
    for axis in axes:
        ladder(builder, axis, FEW_STEPS, back=False)
        places(builder, axis, 3)
        sweeps(builder, axis, (volume.slow(axis, 0.25 * SLOW_SWEEP),))
        speeds(builder, axis, 4, STROKE_TIME / 3.0)
        fast(builder, axis, (1.0, 0.1))
    for pair in volume.pairs:
        if set(pair) <= set(axes):
            circles(builder, pair, volume.feeds, volume.radius, turns=1)
            diagonals(builder, pair, times=1)
    standstill(builder)


Part = Callable[[ProgramBuilder, str], None]
"""Writes motions about an axis, with another one where that is needed and there."""


def _in_the_plane(of_pair: Callable[[ProgramBuilder, tuple[str, str]], None], alone: Part) -> Part:
    """Take the axis with the next one, or do without where it is the only one."""

    def part(builder: ProgramBuilder, axis: str) -> None:
        pair = next((pair for pair in builder.volume.pairs if axis in pair), None)
        if pair is None:
            alone(builder, axis)
        else:
            of_pair(builder, pair)

    return part


def _rungs(builder: ProgramBuilder, axis: str) -> None:
    """Climb a ladder with the steps that every feed makes in a fifth of a second, beside usual ones."""
    own = [0.2 * feed for feed in builder.volume.feeds]
    ladder(builder, axis, sorted({*FEW_STEPS, *own}))


def _warmer(builder: ProgramBuilder, axis: str) -> None:
    slow = builder.volume.slow(axis, 0.5 * SLOW_SWEEP)
    warm_up(builder, (axis,), 10.0 * MINUTE, lambda: sweeps(builder, axis, (slow,)))


def _all_circles(builder: ProgramBuilder, pair: tuple[str, str]) -> None:
    circles(builder, pair, builder.volume.feeds, builder.volume.radius)


PARTS: Final[Mapping[str, Part]] = {
    "standstill": lambda builder, _axis: standstill(builder),
    "ladder": _rungs,
    "places": places,
    "sweeps": sweeps,
    "speeds": speeds,
    "circles": _in_the_plane(_all_circles, lambda builder, axis: sweeps(builder, axis, builder.volume.feeds)),
    "small circles": _in_the_plane(small_circles, fast),
    "diagonals": _in_the_plane(diagonals, sweeps),
    "fast": fast,
    "stops": stops,
    "warm-up": _warmer,
    "mix": lambda builder, _axis: mix(builder, builder.volume.axes),
}
"""Every motion by what it is called in the table of experiments."""
