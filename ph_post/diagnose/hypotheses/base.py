"""The hypothesis, and starting values read from a residual.

To add a hypothesis for your own effect, make a :class:`Hypothesis` and add it to the list of its module.
Its change of the plant is a pure function of plant and numbers; its starting values may use the residual.
:func:`effect_hypothesis` makes one whose numbers are those of a registered effect.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import msgspec
import numpy as np
from scipy import signal

from ph_post.compiling import compiled
from ph_post.drive.cascade import loop_polynomials
from ph_post.drive.command_filters import ComplexArray
from ph_post.drive.effects.registry import find_effect
from ph_post.drive.plant import Plant
from ph_post.identify.free_run import AxisProblem
from ph_post.types import Array, BoolArray
from ph_post.types.diagnosis import Channel

Residuals = Mapping[Channel, Array]
Numbers = tuple[float, ...]

MICRON: Final = 1e-6
"""Least length that differs from zero [m]."""


class HypothesisNumber(msgspec.Struct, frozen=True, kw_only=True):
    """One number of a hypothesis: its bounds, its natural `scale`, and whether the reading is linear in it.

    `linear` numbers start at what a straight fit to the residual gives; of a `logarithm` only the scale counts
    how far a slope reaches, not its size. What would be beyond `high` of a number that `ends` there is another effect.
    """

    name: str
    low: float
    high: float
    scale: float
    linear: bool = False
    logarithm: bool = False
    ends: bool = False


class LogReason(str):
    """A reason against a hypothesis that lies with the log: with other channels or motions it could show."""

    __slots__ = ()


def always(_problem: AxisProblem) -> str:
    """Find nothing against a hypothesis on any axis."""
    return ""


def nothing_taken(_filed: Plant, _fitted: Plant) -> Sequence[Numbers]:
    """Say of no base value that it takes what a hypothesis sizes."""
    return []


class Hypothesis(msgspec.Struct, frozen=True, kw_only=True):
    """A named effect that may be missing.

    Parameters
    ----------
    name : str
        Its name in the catalogue.
    variant : str
        Difference between two hypotheses of one name.
    numbers : tuple of HypothesisNumber
    apply : callable
        Plant and numbers to plant.
    starts : callable
        AxisProblem and residuals to numbers to start from; of a linear one the value is a size worth trying.
    values : callable
        Numbers to the values of the effect's parameters [SI], the leading one first.
    bars : callable
        Why it cannot act on an axis, or as a :class:`LogReason` cannot show in its log; empty where it can.
    within : tuple of str
        Names whose effect is a special case of this one, or as good as one where the log is poor.
    replaces : tuple of str
        Base values ("b", "c", "gap") that it sets free of their prior.
    taken : callable
        Plants of the file and of a fit to the numbers that those base values have taken in it.
    excludes : tuple of str
        Names beside which its numbers mean nothing, as both do the same.
    bare : callable, optional
        Numbers to those of what its name does not say, which have to explain less.
    beside : tuple of str
        Names one of which has to be there already; then it stands for the others of its name.
    """

    name: str
    numbers: tuple[HypothesisNumber, ...]
    apply: Callable[[Plant, Numbers], Plant]
    starts: Callable[[AxisProblem, Residuals], Sequence[Numbers]]
    values: Callable[[AxisProblem, Numbers], dict[str, float]]
    variant: str = ""
    bars: Callable[[AxisProblem], str] = always
    within: tuple[str, ...] = ()
    replaces: tuple[str, ...] = ()
    taken: Callable[[Plant, Plant], Sequence[Numbers]] = nothing_taken
    excludes: tuple[str, ...] = ()
    bare: Callable[[Numbers], Numbers] | None = None
    beside: tuple[str, ...] = ()

    @property
    def label(self) -> str:
        """Name and variant."""
        return f"{self.name}/{self.variant}" if self.variant else self.name


def effect_hypothesis(name: str, values: Callable[..., dict[str, float]], **fields: Any) -> Hypothesis:
    """Return the hypothesis of a registered effect.

    Parameters
    ----------
    name : str
        Of the effect.
    values : callable
        ``values(*numbers)``: the values of its parameters [SI], the leading one first.
    **fields
        The other fields of :class:`Hypothesis`.
    """
    return Hypothesis(
        name=name,
        apply=lambda plant, numbers: find_effect(name).apply(plant, values(*numbers)),
        values=lambda _problem, numbers: values(*numbers),
        **fields,
    )


BINS: Final = 2048
"""Bins of position over the travel."""

FINER: Final = 4
"""Zeros behind them, in their own lengths, so that a period falls near a line of the spectrum."""

LINES: Final = 300.0
"""Most periods that the travel is searched for."""

SHORTEST: Final = 3e-4
"""Shortest period looked for [m]."""


def position_residual(left: Residuals) -> Array:
    """Return the residual of the table's reading, or of the motor's where there is no other [m]."""
    return left["act"] if "act" in left else left["motor"]


def reversal_step(problem: AxisProblem, left: Residuals) -> float:
    """Mean of the residual against the direction of motion [m]: half of what reversals leave."""
    values = position_residual(left)
    moving = problem.counted & (np.abs(problem.speed) > 0.1 * np.max(np.abs(problem.speed)))
    if not moving.any():
        return 0.0
    return float(-np.mean((values - np.mean(values[moving]))[moving] * np.sign(problem.speed[moving])))


def predicted_position(problem: AxisProblem, left: Residuals) -> Array:
    """Return the reading of the table, or of the motor where there is no other, less its residual [m]."""
    channel: Channel = "act" if "act" in left else "motor"
    predicted: Array = problem.channel(channel).values - left[channel]
    return predicted


def force_periods(problem: AxisProblem, left: Residuals, most: int = 4) -> list[float]:
    """List the periods over position of a force that explains most of the residual [m].

    Each wave of force is passed through the loop, which shifts and shrinks it with the speed, and the share
    of the residual that it then explains is what counts.
    """
    plant, values = problem.plant, position_residual(left)
    place = predicted_position(problem, left)
    use = problem.counted & np.isfinite(place)
    span = float(np.ptp(place[use])) if use.any() else 0.0
    if plant.b == 0.0 or span <= 0.0:
        return []
    _, bottom, top = loop_polynomials(problem.axis.servo)
    top, bottom = signal.bilinear(top, bottom, fs=1.0 / problem.period)
    finest = min(1.0 / SHORTEST, LINES / span)
    lines = np.arange(1.0 / longest_period(problem), finest, 0.4 / span)
    if not lines.size:
        return []
    place = np.where(np.isfinite(place), place, 0.0)
    wave, onward = (np.exp(2j * np.pi * line * place) for line in (lines[0], 0.4 / span))
    order = max(top.size, bottom.size)
    top, bottom = (np.pad(one, (0, order - one.size)) / bottom[0] for one in (top, bottom))
    wanted = np.where(use, values - np.mean(values[use]), 0.0)
    products, fits = _answers(wave, onward, lines.size, top, bottom, use, wanted)
    # The square explained is g' G^-1 g, of two columns far from parallel.
    power = np.einsum("ki,kij,kj->k", fits, np.linalg.pinv(products, hermitian=True), fits)
    inner = power[1:-1]
    peaks = np.flatnonzero((inner >= power[:-2]) & (inner > power[2:])) + 1
    best = peaks[np.argsort(power[peaks])[::-1][:most]]
    return [float(1.0 / lines[k]) for k in best]


@compiled
def _answers(
    wave: ComplexArray, onward: ComplexArray, count: int, top: Array, bottom: Array, use: BoolArray, wanted: Array
) -> tuple[Array, Array]:
    """Return products (count, 2, 2) of what a loop answers to waves, in two phases, and those with what is wanted.

    Each wave (n,) is `onward` (n,) times the one before. `top` and `bottom` are the loop's, of one length, whose first
    number at the bottom is 1.
    """
    products, fits = np.zeros((count, 2, 2)), np.zeros((count, 2))
    kept = np.zeros(top.size, dtype=np.complex128)
    for line in range(count):
        kept[:] = 0.0
        ones, others, both, one, other = 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(wave.size):
            sent = wave[k]
            answer = top[0] * sent + kept[0]
            for j in range(1, top.size):
                kept[j - 1] = top[j] * sent + kept[j] - bottom[j] * answer
            wave[k] = sent * onward[k]
            if use[k]:
                ones += answer.real * answer.real
                others += answer.imag * answer.imag
                both += answer.real * answer.imag
                one += answer.real * wanted[k]
                other += answer.imag * wanted[k]
        products[line, 0, 0], products[line, 1, 1] = ones, others
        products[line, 0, 1] = products[line, 1, 0] = both
        fits[line, 0], fits[line, 1] = one, other
    return products, fits


def periods(problem: AxisProblem, left: Residuals, most: int = 3) -> list[float]:
    """List the periods over position that the residual holds most of [m], and the screw's own.

    By the position itself, not the command: at speed these are apart by more than a short period.
    """
    found: list[float] = []
    travel = problem.axis.gap.travel_per_rad
    if travel is not None:
        found.append(2.0 * np.pi * travel)
    values, place = position_residual(left), predicted_position(problem, left)
    use = problem.counted & np.isfinite(place)
    span = float(np.ptp(place[use])) if use.any() else 0.0
    if span > 0.0:
        found += _spectral_periods(place[use] - np.min(place[use]), values[use], span, most)
    return [period for period in found if SHORTEST <= period <= longest_period(problem)]


def longest_period(problem: AxisProblem) -> float:
    """Return the longest period that the travel still holds one and a half times [m]."""
    return float(np.ptp(problem.command)) / 1.5


def _spectral_periods(place: Array, values: Array, span: float, most: int) -> list[float]:
    bins = int(np.clip(2.0 * span / SHORTEST, 64, BINS))
    row = np.minimum((place / span * bins).astype(np.int64), bins - 1)
    counts = np.bincount(row, minlength=bins)
    sums = np.bincount(row, weights=values - np.mean(values), minlength=bins)
    means = np.divide(sums, counts, out=np.zeros(bins), where=counts > 0)
    power = np.abs(np.fft.rfft(means * np.sqrt(np.minimum(counts, 50.0)), FINER * bins)) ** 2
    power[: FINER // 2] = 0.0
    peaks = np.flatnonzero((power[1:-1] >= power[:-2]) & (power[1:-1] > power[2:])) + 1
    best = peaks[np.argsort(power[peaks])[::-1][:most]]
    return [float(FINER * span / k) for k in best]


def speeds(problem: AxisProblem) -> tuple[float, ...]:
    """Speeds at which the axis moves: quantiles of those above standstill [m/s]."""
    moving = np.abs(problem.speed[problem.counted])
    moving = moving[moving > 1e-3 * np.max(moving, initial=0.0)]
    if moving.size == 0:
        return (1e-3,)
    return tuple(float(v) for v in np.quantile(moving, (0.05, 0.25, 0.5)))


def middle(problem: AxisProblem) -> float:
    """Middle of the travel [m]."""
    return float(0.5 * (np.min(problem.command) + np.max(problem.command)))


def reach(problem: AxisProblem) -> float:
    """Half the travel [m]."""
    return float(0.5 * np.ptp(problem.command))
