"""The free run of an axis: the readings that a given plant would produce from the logged command.

The command is run from the first sample to the last and no reading is fed back: an error that a one-step
prediction would hide adds up here to the error seen on the part.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Final, NamedTuple, TypeVar
from weakref import WeakKeyDictionary

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.compiling import compiled, read_only
from ph_post.drive.command_filters import Arriving, filters_of
from ph_post.drive.effects.active import plant_of
from ph_post.drive.plant import TRUE_READING, Plant, read_table
from ph_post.identify.between import delayed, parts_between, refined
from ph_post.simulate.machine import NOMINAL_SCENARIO, AxisCommand, arrive, cutting_force, first_flank, run_plant
from ph_post.types import Array, Axis, AxisLog, BoolArray, Log, sealed
from ph_post.types.diagnosis import Channel, LogQuality, recorded_channels

BLOCKS: Final = (32, 128, 512)
"""Numbers of blocks that a log is cut into; by turns they are fitted and held out."""

SLIGHT: Final = 0.05
"""Excess, in squares of the noise a sample, up to which it does not matter where it lies."""

BOTH: Final = 0.15
"""Part of what is to be explained that the fitted blocks, and those held out, have to hold each."""

MOST_KEPT, LEAST_KEPT = 16, 2
"""Runs of a problem that are kept at most, and at least."""

SPACE: Final = 16_000_000
"""What they may take [bytes]."""

LOST: Final = 10.0
"""Positions [m] and speeds beyond which a plant that is tried has run away."""

MOVES: Final = 1e-5
"""An axis whose command spans less than this [m] does not move."""


class ObservedChannel(NamedTuple):
    """One recorded channel.

    `values` (n,), `ok` (n,) where it was recorded, and its `noise` in the same unit [m or of the effort].
    `step` is what it counts by, where rounding is its noise.
    """

    channel: Channel
    values: Array
    ok: BoolArray
    noise: float
    step: float = 0.0


class AxisProblem(msgspec.Struct, frozen=True, kw_only=True, eq=False, weakref=True):
    """One axis of a log, and the axis of the machine file that it should be.

    `others` are the positions of all other axes [m], `velocity` (n, axes) the commanded ones of all [m/s],
    of which this axis' is column `number`. `fine` is the command with `parts` steps from row to row, as the plant
    runs it. `fit` and `held` mark the samples that are fitted and held out.
    `side` is that of the table's readings; `at_motor` says that these are the motor's instead.
    """

    axis: Axis
    plant: Plant
    period: float
    t: Array
    command: Array
    others: Mapping[str, Array]
    velocity: Array
    number: int
    observed: tuple[ObservedChannel, ...]
    fit: BoolArray
    held: BoolArray
    side: str = "table"
    at_motor: bool = False
    effort_unit: str = "N"
    parts: int = 1
    fine: Array | None = None

    @property
    def counted(self) -> BoolArray:
        """Samples that count at all."""
        return self.fit | self.held

    @property
    def speed(self) -> Array:
        """Commanded speed of this axis [m/s]."""
        return np.asarray(self.velocity[:, self.number])

    def has(self, channel: Channel) -> bool:
        """Return whether a channel was recorded."""
        return any(one.channel == channel for one in self.observed)

    def channel(self, channel: Channel) -> ObservedChannel:
        """Return a channel that was recorded."""
        return next(one for one in self.observed if one.channel == channel)

    @property
    def positions(self) -> tuple[ObservedChannel, ...]:
        """Channels that read a position [m], the table's first."""
        return tuple(one for one in self.observed if one.channel != "force")

    @property
    def noise_floor(self) -> float:
        """Root mean square of the noise of all positions [m]."""
        return pooled_noise(one.noise for one in self.positions)


def pooled_noise(noise: Iterable[float]) -> float:
    """Return the root mean square of noise levels, 0 for none."""
    squares = [one * one for one in noise]
    return float(np.sqrt(np.mean(squares))) if squares else 0.0


def problem_of(log: Log, name: str, axis: Axis, quality: LogQuality) -> AxisProblem | None:
    """Return the problem of one axis; None where the log has no reading of it, or it does not move."""
    axis_log = log.axes[name]
    found = {one.channel: one for one in quality.channels if one.axis == name}
    observed = tuple(
        ObservedChannel(channel, values, np.isfinite(values), found[channel].noise, found[channel].count)
        for channel, values in recorded_channels(axis_log).items()
        if channel in found
    )
    positions = any(one.channel != "force" for one in observed)
    if not positions or np.ptp(axis_log.command) < MOVES:
        return None
    names = tuple(log.axes)
    commands = np.stack([log.axes[one].command for one in names], axis=1)
    fit, held = _split(log.t.size, quality.first)
    if log.counted is not None:
        fit, held = fit & log.counted, held & log.counted
    return AxisProblem(
        axis=axis,
        plant=plant_of(axis, NOMINAL_SCENARIO),
        period=log.period,
        t=log.t,
        command=axis_log.command,
        others={one: _place(log.axes[one]) for one in names if one != name},
        velocity=np.gradient(commands, log.period, axis=0),
        number=names.index(name),
        observed=observed,
        fit=fit,
        held=held,
        side=axis_log.side,
        effort_unit=axis_log.effort_unit,
        parts=parts_between(log.period),
        fine=refined(axis_log.command, parts_between(log.period)),
    )


def _place(axis: AxisLog) -> Array:
    """Return the position of an axis as it was read, or as it was commanded where no reading is."""
    read = axis.table if axis.table is not None else axis.motor
    return axis.command if read is None else np.where(np.isfinite(read), read, axis.command)


def _split(size: int, first: int, blocks: int = BLOCKS[0]) -> tuple[BoolArray, BoolArray]:
    """Deal the blocks out by the Thue-Morse sequence, which keeps in step with no period of the motion."""
    number = np.minimum((np.arange(size) - first) * blocks // max(size - first, 1), blocks - 1)
    odd = np.array([k.bit_count() % 2 for k in range(blocks)], dtype=bool)[number]
    behind = np.arange(size) >= first
    return behind & ~odd, behind & odd


def split_evenly(problem: AxisProblem, left: Mapping[Channel, Array]) -> AxisProblem:
    """Deal the samples out in finer blocks where most of what is left lies in one half: a rare event.

    Parameters
    ----------
    problem : AxisProblem
    left : mapping
        What a model leaves of each channel (n,).
    """
    first = int(np.argmax(problem.counted))
    halves = [_split(problem.t.size, first, blocks) for blocks in BLOCKS]
    splits = [(fit & problem.counted, held & problem.counted) for fit, held in halves]
    shares = [_least_share(problem, left, fit, held) for fit, held in splits]
    chosen = next((k for k, share in enumerate(shares) if share > BOTH), int(np.argmax(shares)))
    return replace(problem, fit=splits[chosen][0], held=splits[chosen][1])


def _least_share(problem: AxisProblem, left: Mapping[Channel, Array], fit: BoolArray, held: BoolArray) -> float:
    """Return the part of the excess over the noise, of the channel with most, in the half that has less."""
    halves = np.array(
        [[_excess(left[one.channel][half & one.ok] / one.noise) for half in (fit, held)] for one in problem.observed]
    )
    most = halves[np.argmax(halves.sum(axis=1))]
    return float(most.min() / most.sum()) if most.sum() > SLIGHT * problem.t.size else 1.0


def _excess(left: Array) -> float:
    """Sum of squares beyond that of noise, of what is left in parts of the noise."""
    return max(float(np.sum(left * left)) - left.size, 0.0)


def predict(problem: AxisProblem, plant: Plant) -> dict[Channel, Array]:
    """Run the command of the log on a plant.

    Returns
    -------
    dict
        `act` and `motor` [m] by channel, and as `force` the columns (n, 2) that make up the effort
        K (u - c_e v): what the loops give (:func:`ph_post.drive.hybrid.given_by`) [m], and the speed [m/s] at the
        loop's own side. In a cascade what is electronic is in u, so that u alone makes it up, (n, 1).
    """
    parts = problem.parts
    period = problem.period / parts
    table, motor, given = _run(problem, plant, asked=problem.has("force"))
    found: dict[Channel, Array] = {}
    for one in problem.observed:
        if one.channel == "act":
            read = delayed(motor if problem.at_motor else table, plant.reading_delay / period)[::parts]
            found["act"] = read_table(plant, problem.t, read, problem.others)
        elif one.channel == "motor":
            found["motor"] = motor[::parts]
        else:
            columns = [given]
            if plant.cascade is None:
                columns.append(np.gradient(plant.loop.closed_over(table, motor), period))
            found["force"] = np.stack(columns, axis=1)[::parts]
    return found


def efforts(problem: AxisProblem, plant: Plant) -> Array:
    """Return what the loops of a plant give on the command of the log, F/K, shape (n,) [m]."""
    return _run(problem, plant, asked=True)[2][:: problem.parts]


Key = TypeVar("Key")
Value = TypeVar("Value")

Motion = tuple[Array, Array, Array]
"""Table and motor [m], and what the loops give [m] where that was asked for, else (0,)."""


class _Kept:
    """Runs of a problem that were made last: what only changes a reading moves the axis as before."""

    def __init__(self, problem: AxisProblem) -> None:
        steps = problem.t.size * problem.parts
        self._many = max(min(MOST_KEPT, SPACE // (24 * steps)), LEAST_KEPT)
        self._runs: dict[tuple[Plant, bool], Motion] = {}
        self._sent: dict[tuple[object, ...], tuple[AxisCommand, Arriving]] = {}

    def run(self, key: tuple[Plant, bool], make: Callable[[], Motion]) -> Motion:
        """Return a run that was made already, or make it."""
        return _kept_or_made(self._runs, key, make, self._many)

    def sent(
        self, key: tuple[object, ...], make: Callable[[], tuple[AxisCommand, Arriving]]
    ) -> tuple[AxisCommand, Arriving]:
        """Return a command, and how it reaches the loop, that was made already, or make it."""
        return _kept_or_made(self._sent, key, make, LEAST_KEPT)


_KEPT: Final[WeakKeyDictionary[AxisProblem, _Kept]] = WeakKeyDictionary()


def _kept_or_made(kept: dict[Key, Value], key: Key, make: Callable[[], Value], many: int) -> Value:
    """Return what is kept, or make it, and let go of what was not asked for longest."""
    found = kept.pop(key, None)
    if found is None:
        found = make()
    kept[key] = found
    while len(kept) > many:
        del kept[next(iter(kept))]
    return found


def _run(problem: AxisProblem, plant: Plant, *, asked: bool) -> Motion:
    """Run table, motor and, if asked for, what the loops give at every step, before any delay of a reading."""
    kept = _KEPT.get(problem)
    if kept is None:
        kept = _KEPT[problem] = _Kept(problem)
    plant = replace(plant, reading=TRUE_READING, reading_delay=0.0)
    return kept.run((plant, asked), lambda: _moved(problem, plant, kept, asked=asked))


def _moved(problem: AxisProblem, plant: Plant, kept: _Kept, *, asked: bool) -> Motion:
    period = problem.period / problem.parts
    filters = () if plant.cascade is None else filters_of(plant.cascade)
    trace, arrived = kept.sent((plant.command_delay, *filters), lambda: _sent(problem, plant))
    if plant.cutting:
        resists = cutting_force(plant, _between_rows(problem.velocity, problem.parts), problem.number)
        trace = trace._replace(force=resists)
    given = np.empty(trace.position.size if asked else 0)
    plant = replace(plant, command_delay=0.0)
    flank = first_flank(problem.axis, NOMINAL_SCENARIO)
    table, motor, _ = run_plant(trace, plant, flank, period, given, arrived)
    return sealed(table), sealed(motor), sealed(given)


def _sent(problem: AxisProblem, plant: Plant) -> tuple[AxisCommand, Arriving]:
    """Return the command that a plant is sent, and how it reaches the loop."""
    period = problem.period / problem.parts
    command = delayed(problem.command if problem.fine is None else problem.fine, plant.command_delay / period)
    start = float(np.median(problem.speed[:3]))
    trace = AxisCommand(command, float(command[0]), start if abs(start) * period > 1e-9 else 0.0)
    return trace, arrive(trace, replace(plant, command_delay=0.0), period)


def _between_rows(values: Array, parts: int) -> Array:
    """Return values (n, axes) at every step from row to row, along straight lines."""
    if parts == 1:
        return values
    rows = np.arange(values.shape[0], dtype=np.float64)
    places = np.arange((values.shape[0] - 1) * parts + 1) / parts
    return np.stack([np.interp(places, rows, column) for column in values.T], axis=1)


def with_known_side(problem: AxisProblem) -> AxisProblem:
    """Decide where a position of unknown side was read: at the motor where the file's model says so.

    What is wrong by speed or acceleration speaks for neither side: it is a drive that is not quite the file's.
    """
    if problem.side != "unknown" or not problem.has("act"):
        return problem
    use = problem.counted & problem.channel("act").ok
    by_drive = np.stack([np.ones(problem.t.size), problem.speed, np.gradient(problem.speed, problem.period)], axis=1)
    basis = np.linalg.svd(by_drive[use] / np.maximum(np.abs(by_drive[use]).max(axis=0), 1e-12), full_matrices=False)[0]
    motor = replace(problem, at_motor=True)
    left = [residuals(one, one.plant, True)["act"][use] for one in (problem, motor)]
    table_off, motor_off = (np.sum((one - basis @ (basis.T @ one)) ** 2) for one in left)
    return motor if motor_off < table_off else problem


def residuals(problem: AxisProblem, plant: Plant, origin_free: bool = True) -> dict[Channel, Array]:
    """Return reading minus model by channel (n,) [m or the effort's unit], 0 where nothing was recorded.

    The origin of a position, where that is free, and the gains of the effort are those that fit best.
    """
    # A model that is tried may run away: what it predicts is then infinite, or nothing.
    with np.errstate(over="ignore", invalid="ignore"):
        predicted = predict(problem, plant)
    found: dict[Channel, Array] = {}
    for one in problem.observed:
        use = problem.fit & one.ok
        columns = [_bounded(read_only(column)) for column in np.atleast_2d(predicted[one.channel].T)]
        if one.channel == "force":
            both = np.stack(columns, axis=1)
            gains = np.linalg.lstsq(both[use], one.values[use], rcond=None)[0]
            left = one.values - both @ gains
        else:
            left = one.values - columns[0]
            if origin_free:
                left -= np.mean(left[use])
        found[one.channel] = left if one.ok.all() else np.where(one.ok, left, 0.0)
    return found


@compiled
def _bounded(values: Array) -> Array:
    """Return what a model predicts: one that runs away predicts what is infinite, or nothing."""
    found = np.empty(values.size)
    for k in range(values.size):
        found[k] = LOST if math.isnan(values[k]) else min(max(values[k], -LOST), LOST)
    return found


PRIOR: Final = 0.02
"""Relative standard error of a base value where nothing else is said."""

WHITE: Final = 256
"""Samples over which what is left is averaged to see how far it is from white noise."""


def mean_square(values: Array, use: BoolArray) -> float:
    """Mean square of the samples in use, at least the smallest number that has a logarithm."""
    return max(float(np.mean(values[use] ** 2)), 1e-300)


def correlation_inflation(problem: AxisProblem, left: Mapping[Channel, Array], use: BoolArray) -> float:
    """Return samples per independent sample: the residual's variance over windows."""
    values = (left[one.channel][use & one.ok] for one in problem.observed)
    return max((samples_per_independent(one, WHITE) for one in values if one.size >= 2 * WHITE), default=1.0)


def samples_per_independent(values: Array, window: int) -> float:
    """Return how many samples count as one: the variance of means over `window` samples; at least 1."""
    whole = values[: values.size // window * window].reshape(-1, window)
    spread = max(float(np.mean(values * values)), 1e-300)
    return max(1.0, float(window * np.mean(whole.mean(axis=1) ** 2)) / spread)


def weights_of(problem: AxisProblem, left: Mapping[Channel, Array], use: BoolArray) -> dict[Channel, float]:
    """One over what each channel leaves, but no more than one over its noise."""
    return {
        one.channel: 1.0 / max(np.sqrt(mean_square(left[one.channel], use & one.ok)), one.noise, 1e-12)
        for one in problem.observed
    }


def weighted_residuals(
    problem: AxisProblem, left: Mapping[Channel, Array], weights: Mapping[Channel, float], use: BoolArray
) -> Array:
    """Return the weighted residuals (rows,) of the samples in use, one channel after the other."""
    return np.concatenate([left[one.channel][use & one.ok] * weights[one.channel] for one in problem.observed])
