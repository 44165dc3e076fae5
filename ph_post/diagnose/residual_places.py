"""Locate the residual of one axis: split it by time, travel, direction, speed, position and frequency.

A residual is reading minus model; its excess is its mean square less that of the noise. A rule ("follows
the velocity") counts by its prediction of the half of the log that it was not fitted to, a stretch ("within
60 ms after reversals") by its share of the excess against its share of the samples. Splits no better than
chance are ignored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final, Literal, NamedTuple

import numpy as np

from ph_post.diagnose import sentences
from ph_post.diagnose.residual_features import (
    Excess,
    best_period,
    bins_of,
    by_rotation,
    drift,
    excess_of,
    follows,
    is_structured,
    share_of,
    solve,
    window_from_zero,
    window_within,
)
from ph_post.diagnose.sentences import percent
from ph_post.identify.linear_drive import AxisMotion, halves, motion_of
from ph_post.types import Array, Axis, BoolArray, Log, Machine
from ph_post.types.diagnosis import ResidualPlace

LEAST: Final = 0.25
"""Share of the excess from which a line of the spectrum is named."""

WIDE: Final = 3
"""Rows of the spectrum to either side that belong to a line: those of a Hann window."""


def spectral_line(
    axis: str, residual: Array, counted: BoolArray, noise: float, period: float
) -> Iterator[ResidualPlace]:
    """Yield the strongest line of a residual's spectrum, where it holds much of the excess over the noise.

    Parameters
    ----------
    axis : str
    residual : Array, shape (n,)
        Reading minus model [m].
    counted : BoolArray, shape (n,)
    noise : float
        Root mean square of what is no excess [m].
    period : float
        Sampling period [s].
    """
    rows = np.flatnonzero(counted)
    if rows.size < 64:
        return
    values = np.where(counted, residual, 0.0)[rows[0] : rows[-1] + 1]
    values = (values - np.mean(values)) * np.hanning(values.size)
    power = np.abs(np.fft.rfft(values)) ** 2
    at = int(np.argmax(power))
    near = power[max(at - WIDE, 0) : at + WIDE + 1]
    square = float(np.mean(residual[counted] ** 2))
    excess = square - noise**2
    if at <= WIDE or excess <= 0.0 or not np.any(power > 0.0):
        return
    share = min(float(np.sum(near) / np.sum(power)) * square / excess, 1.0)
    if share < LEAST:
        return
    rows_of = np.arange(at - WIDE, at - WIDE + near.size)
    hertz = float(np.sum(rows_of * near) / np.sum(near)) / (values.size * period)
    sentence = f"{percent(share)} of the excess is at {hertz:.3g} Hz, whatever the axis does"
    yield ResidualPlace(axis=axis, by="frequency", share=share, value=hertz, sentence=sentence)


WORTH: Final = 0.05
"""A rule that predicts less than this share of the excess is not worth a sentence."""

CLEAR: Final = 0.2
"""Least difference of a stretch's share of the excess and its share of the samples."""

NUMBER: Final = 0.01
"""Cost of each number of a rule where two rules explain the same."""

BINS: Final = 40
"""Bins over position, speed and time in which a stretch is looked for."""


Constant = Literal["beside", "counted", "none"]
"""A constant beside a rule does not count, or is part of the rule, or there is none."""


class ResidualSamples(NamedTuple):
    """Samples that the splits look at: the counted samples of the residual and of the motion, and the axis."""

    name: str
    excess: Excess
    motion: AxisMotion
    noise: float
    drive: Axis | None


class RankedPlace(NamedTuple):
    """A place and by how much it says more than chance."""

    worth: float
    place: ResidualPlace


def locate(
    log: Log, axis: str, residual: Array, counted: BoolArray, noise: float, machine: Machine
) -> tuple[ResidualPlace, ...]:
    """Find where the residual of one axis lies.

    Parameters
    ----------
    log : Log
    axis : str
    residual : Array, shape (n,)
        Reading minus model [m].
    counted : BoolArray, shape (n,)
        Samples that count; those without a reading never do.
    noise : float
        Its root mean square without any excess [m].
    machine : Machine
        Its linear drives give when the axis reverses.

    Returns
    -------
    tuple of ResidualPlace
        That first which says most: the largest share beyond what chance would give. None where the residual
        is noise.
    """
    counted = counted & np.isfinite(residual)
    if not is_structured(residual, counted, noise)[0]:
        return ()
    motion = motion_of(log, machine, axis)
    excess = excess_of(residual[counted], halves(motion)[counted], noise)
    scene = ResidualSamples(axis, excess, _counted(motion, counted), noise, machine.axes.get(axis))
    found = [one for split in SPLITS for one in split(scene)]
    return tuple(one.place for one in sorted(found, key=lambda one: -one.worth))


def _counted(motion: AxisMotion, counted: BoolArray) -> AxisMotion:
    """Take the counted samples of a motion."""
    others = {name: values[counted] for name, values in motion.others.items()}
    rest = {key: values[counted] for key, values in motion._asdict().items() if key != "others"}
    return AxisMotion(**rest, others=others)


def _rule(
    scene: ResidualSamples, by: str, columns: Array, value: float, text: str, constant: Constant = "beside"
) -> Iterator[RankedPlace]:
    """Yield a rule if it foretells enough beyond a constant; `text` says what the share does."""
    share = beyond = follows(scene.excess, columns)
    if beyond < WORTH:
        return
    if constant == "counted":
        columns = np.column_stack((columns, np.ones(columns.shape[0])))
    if constant != "beside":
        share = follows(scene.excess, columns, constant=False)
    worth = share - NUMBER * columns.shape[1]
    if share >= WORTH:
        yield _found(scene, worth, by, share, value, f"{sentences.percent(share)} of the excess {text}")


def _found(scene: ResidualSamples, worth: float, by: str, share: float, value: float, sentence: str) -> RankedPlace:
    """Make a place and what it is worth."""
    return RankedPlace(worth, ResidualPlace(axis=scene.name, by=by, share=share, value=value, sentence=sentence))


def _reversal(scene: ResidualSamples) -> Iterator[RankedPlace]:
    """By time and by travel since the last reversal."""
    motion, excess = scene.motion, scene.excess
    ways = (("reversal", motion.since, motion.until), ("travel", motion.travel, motion.left))
    for by, since, left in ways:
        if not np.any(np.isfinite(since)):
            return
        window = window_from_zero(excess, since)
        before = share_of(excess, left < window.high)
        worth = window.share - max(window.chance, before) - NUMBER * (by == "travel")
        if worth < CLEAR or window.share < 2.0 * window.chance:
            continue
        text = sentences.after_reversals(by, scene.name, window, excess.residual, motion, scene.noise)
        yield _found(scene, worth, by, window.share, window.high, text)


def _offset(scene: ResidualSamples) -> Iterator[RankedPlace]:
    """By what is there all the time."""
    share = follows(scene.excess, np.ones((scene.excess.residual.size, 1)), constant=False)
    mean = float(np.mean(scene.excess.residual))
    if share >= WORTH:
        text = f"{sentences.percent(share)} of the excess is an offset of {sentences.length(mean)}, always there"
        yield _found(scene, share - NUMBER, "offset", share, mean, text)


def _direction(scene: ResidualSamples) -> Iterator[RankedPlace]:
    """By the sign of the velocity."""
    direction = scene.motion.direction.astype(np.float64)
    if np.ptp(direction) == 0.0:
        return
    half = float(_fit(scene, direction[:, None])[0])
    text = f"goes with the direction of motion, {sentences.length(half)} while moving to plus, opposite to minus"
    yield from _rule(scene, "direction", direction[:, None], half, text)


def _speed(scene: ResidualSamples) -> Iterator[RankedPlace]:
    """By velocity: in proportion to it, each direction by itself, or within a range of speeds."""
    v = scene.motion.velocity
    if np.ptp(v) == 0.0:
        return
    both = np.column_stack((v, np.abs(v)))
    alone = follows(scene.excess, v[:, None], constant=False)
    if follows(scene.excess, both, constant=False) - alone > 0.02:
        odd, even = (float(value) for value in solve(both, scene.excess.residual))
        plus, minus = odd + even, odd - even
        value = plus if abs(plus) > abs(minus) else minus
        yield from _rule(scene, "speed", both, value, sentences.two_speeds(plus, minus), "none")
    else:
        value = float(_fit(scene, v[:, None])[0])
        yield from _rule(scene, "speed", v[:, None], value, sentences.one_speed(value))
    number, edges = bins_of(np.abs(v), BINS)
    window = window_within(scene.excess, number, edges)
    if window.share - window.chance > CLEAR:
        text = sentences.stretch(window, "at speeds", sentences.velocity)
        yield _found(scene, window.share - window.chance - 0.05, "speed", window.share, window.high, text)


def _acceleration(scene: ResidualSamples) -> Iterator[RankedPlace]:
    """By acceleration."""
    a = scene.motion.acceleration
    if np.ptp(a) > 0.0:
        value = float(_fit(scene, a[:, None])[0])
        yield from _rule(scene, "acceleration", a[:, None], value, sentences.acceleration(value))


def _position(scene: ResidualSamples) -> Iterator[RankedPlace]:
    """By position: in proportion to that of this axis or of another, or within a stretch of it."""
    for name, x in {scene.name: scene.motion.position, **scene.motion.others}.items():
        if np.ptp(x) == 0.0:
            continue
        slope = float(_fit(scene, x[:, None])[0])
        by = "position" if name == scene.name else f"position of {name}"
        yield from _rule(scene, by, x[:, None], slope, sentences.proportion(name, slope), "counted")
    x = scene.motion.position
    if np.ptp(x) == 0.0:
        return
    number, edges = bins_of(x, BINS)
    window = window_within(scene.excess, number, edges)
    if window.share - window.chance > CLEAR:
        middle = 0.5 * (window.low + window.high)
        text = sentences.stretch(window, f"where {scene.name} is", sentences.place)
        yield _found(scene, window.share - window.chance, "position", window.share, middle, text)


def _period(scene: ResidualSamples) -> Iterator[RankedPlace]:
    """By position, over and over."""
    x = scene.motion.position
    every = np.ones(x.size, dtype=np.bool_)
    found = best_period(scene.excess.residual, x, every)
    if found is None:
        return
    angle = 2.0 * np.pi * x / found.period
    columns = np.column_stack((np.sin(angle), np.cos(angle)))
    ways = [_amplitude(scene, columns, scene.motion.direction == way) for way in (1, -1)]
    text = sentences.periodic(found, ways, scene.drive)
    yield from _rule(scene, "period", columns, found.period, text)


def _time(scene: ResidualSamples) -> Iterator[RankedPlace]:
    """By time: a drift, or a stretch of the log."""
    t = scene.motion.t
    found = drift(scene.excess.residual, t, np.ones(t.size, dtype=np.bool_))
    u = (t - t[0]) / (t[-1] - t[0])
    text = sentences.drifts(found, float(t[-1] - t[0]))
    yield from _rule(scene, "time", np.column_stack((u, u**2, u**3)), found.change, text, "counted")
    number, edges = bins_of(t, BINS)
    window = window_within(scene.excess, number, edges, across=False)
    if window.share - window.chance > 2.0 * CLEAR:
        text = sentences.stretch(window, "from", sentences.instant)
        yield _found(scene, window.share - window.chance - 0.1, "time", window.share, window.low, text)


def _rotation(scene: ResidualSamples) -> Iterator[RankedPlace]:
    """By the direction of rotation, where the path bends both ways."""
    turn = scene.motion.turn
    sides = by_rotation(scene.excess.residual, scene.motion, np.ones(turn.size, dtype=np.bool_))
    if sides is None:
        return
    way = -1 if sides[0] > sides[1] else 1
    share, chance = share_of(scene.excess, turn == way), float(np.mean(turn == way))
    if share - chance > CLEAR:
        text = sentences.rotation(share, chance, sides)
        ratio = sides[0] / sides[1] if sides[1] > 0.0 else np.inf
        yield _found(scene, share - chance, "rotation", min(share, 1.0), ratio, text)


def _fit(scene: ResidualSamples, columns: Array) -> Array:
    """Coefficients of columns beside a constant, on all samples."""
    full = np.column_stack((columns, np.ones(columns.shape[0])))
    return solve(full, scene.excess.residual)[:-1]


def _amplitude(scene: ResidualSamples, columns: Array, inside: BoolArray) -> float:
    """Amplitude of a sine while moving in one direction [m]; NaN where it hardly does."""
    if np.mean(inside) < 0.1:
        return float("nan")
    full = np.column_stack((columns[inside], np.ones(np.count_nonzero(inside))))
    return float(np.hypot(*solve(full, scene.excess.residual[inside])[:2]))


SPLITS: Final[tuple[Callable[[ResidualSamples], Iterator[RankedPlace]], ...]] = (
    _reversal,
    _offset,
    _direction,
    _speed,
    _acceleration,
    _position,
    _period,
    _time,
    _rotation,
)
