"""Fit a model of one axis to its log: least squares of the free run, with the file's values as priors.

Each channel is weighted by the residual it still leaves, so that the likelihood is that of residuals of
unknown size: nats = -n/2 log(mean square), summed over channels.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.diagnose.hypotheses.base import Hypothesis, HypothesisNumber, Numbers
from ph_post.drive.plant import Plant, base_value, with_base_value
from ph_post.identify.cascade_numbers import CASCADE_NUMBERS, FITTED
from ph_post.identify.errors import fit_covariance
from ph_post.identify.free_run import (
    PRIOR,
    AxisProblem,
    mean_square,
    residuals,
    weighted_residuals,
    weights_of,
)
from ph_post.types import Array, BoolArray
from ph_post.types.diagnosis import Channel

REACH: Final = 3.0
"""Standard errors within which a base value may still be what the file says."""

STEP: Final = 1e-3
"""Finite differences, of a number's size or scale."""

LOG_STEP: Final = 0.02
"""The same of a logarithm, of its scale: a thousandth of the logarithm of a period would be whole waves."""

SAME: Final = 0.03
"""Relative change of the channels' weights below which a fit is not begun anew with them."""

CLOSE: Final = 1e-5
"""Relative change of cost or unknowns at which a fit ends: a tenth of a nat on ten thousand samples."""

FIRST: Final = 1e-4
"""The same of a fit that is only looked at."""

DAMPING: Final = 1e-3
"""Damping of the first step of a fit, in squares of what each unknown does."""


KEPT: Final = 3
"""Places whose residuals a fit keeps: where it stands, and those that it tried last."""


LEAST: Final = {"dead_time": 2e-5}
"""Least standard error of base values that may be 0: command and reading are not sampled at the same instant [s]."""

OF_A_ROW: Final = 0.01
"""The same in parts of the time from row to row: what is laid between rows of a slow log may be so much late."""


SETTINGS: Final = {"velocity_feedforward": 0.005}
"""Relative standard error of base values that are typed in and not measured: what a drive makes of them."""


class Prior(msgspec.Struct, frozen=True, kw_only=True):
    """A base value of the file: the field of the plant, its relative standard error, and the `least` error [SI]."""

    field: str
    error: float = PRIOR
    least: float = 0.0

    def moved(self, value: float, off: float) -> float:
        """Return a value that is off by so many standard errors."""
        return value + self.least * off if self.least > self.error * value else value * (1.0 + self.error * off)


class ModelPart(msgspec.Struct, frozen=True, kw_only=True):
    """A hypothesis in a model, and its numbers."""

    hypothesis: Hypothesis
    numbers: Numbers


class Model(msgspec.Struct, frozen=True, kw_only=True):
    """The plant of the file, its base values off by so many standard errors, and what was added to it."""

    priors: tuple[Prior, ...]
    off: Numbers
    parts: tuple[ModelPart, ...] = ()
    origin_free: bool = True

    @property
    def free(self) -> tuple[int, ...]:
        """Indices of the priors that hold: those that no part replaces."""
        gone = {field for part in self.parts for field in part.hypothesis.replaces}
        return tuple(k for k, prior in enumerate(self.priors) if prior.field not in gone)


class FittedModel(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A model at its best, and what it leaves.

    `left` (n,) by channel [m or the effort's unit]; `jacobian` (rows, unknowns) of the weighted residuals,
    with a row a prior; `unknowns` are the numbers in its columns.
    """

    model: Model
    left: Mapping[Channel, Array]
    jacobian: Array
    unknowns: Array


def plant_at(problem: AxisProblem, model: Model) -> Plant:
    """Return the plant that a model describes."""
    plant = problem.plant
    held = set(model.free)
    for k, prior in enumerate(model.priors):
        if k in held:
            value = prior.moved(base_value(plant, prior.field), model.off[k])
            plant = with_base_value(plant, prior.field, value)
    for part in model.parts:
        plant = part.hypothesis.apply(plant, part.numbers)
    return plant


def base_model(problem: AxisProblem) -> Model:
    """Return the model of the file as it is; what does not show on this loop has no prior."""
    plant = problem.plant
    gains = [CASCADE_NUMBERS[name].field for name in FITTED]
    fields = ["b", "c"] if plant.cascade is None else [*gains, "c"]
    if plant.gap > 0.0:
        fields += ["gap", "eta", "beta"] if plant.loop.encloses_backlash else ["gap"]
    least = {field: max(error, OF_A_ROW * problem.period) for field, error in LEAST.items()}
    priors = tuple(
        Prior(field=field, error=SETTINGS.get(field, PRIOR), least=least.get(field, 0.0))
        for field in fields
        if base_value(plant, field) > 0.0 or field in LEAST
    )
    return Model(priors=priors, off=(0.0,) * len(priors))


def log_likelihood(problem: AxisProblem, left: Mapping[Channel, Array], use: BoolArray) -> float:
    """Return the log likelihood [nats] of residuals (n,) by channel on the samples in use, shape (n,)."""
    total = 0.0
    for one in problem.observed:
        here = use & one.ok
        total -= 0.5 * np.count_nonzero(here) * np.log(mean_square(left[one.channel], here))
    return float(total)


def residuals_of(problem: AxisProblem, model: Model) -> dict[Channel, Array]:
    """Return the residuals (n,) of a model by channel [m or the effort's unit]."""
    return residuals(problem, plant_at(problem, model), model.origin_free)


def _numbers(model: Model) -> list[HypothesisNumber]:
    z = HypothesisNumber(name="off", low=-REACH, high=REACH, scale=0.3)
    return [z] * len(model.free) + [one for part in model.parts for one in part.hypothesis.numbers]


def pack(model: Model) -> Array:
    """Return the unknowns of a model in one row."""
    return np.array([model.off[k] for k in model.free] + [x for part in model.parts for x in part.numbers])


def unpack(model: Model, unknowns: Array) -> Model:
    """Return a model with its unknowns as given."""
    free = model.free
    off = list(model.off)
    for k, value in zip(free, unknowns[: len(free)], strict=True):
        off[k] = float(value)
    parts, at = [], len(free)
    for part in model.parts:
        count = len(part.numbers)
        parts.append(replace(part, numbers=tuple(float(x) for x in unknowns[at : at + count])))
        at += count
    return replace(model, off=tuple(off), parts=tuple(parts))


def weighted_rows(
    problem: AxisProblem, model: Model, weights: Mapping[Channel, float], use: BoolArray, unknowns: Array
) -> Array:
    """Return the weighted residuals of the samples in use, and a row a prior; shape (rows,)."""
    there = unpack(model, unknowns)
    left = residuals_of(problem, there)
    return np.concatenate([weighted_residuals(problem, left, weights, use), unknowns[: len(model.free)]])


class _Rows:
    """Weighted rows of a model as a function of its unknowns; the residuals of the last few places are kept.

    A fit begins where its weights were made, its slopes where a step ended, and its next round where it ended itself.
    """

    def __init__(
        self, problem: AxisProblem, model: Model, use: BoolArray, weights: Mapping[Channel, float] | None = None
    ) -> None:
        self._problem, self._model, self._use = problem, model, use
        self._known: dict[bytes, dict[Channel, Array]] = {}
        self.weights: Mapping[Channel, float] = {} if weights is None else weights

    def left(self, unknowns: Array) -> dict[Channel, Array]:
        """Return the residuals (n,) by channel."""
        key = unknowns.tobytes()
        if key not in self._known:
            if len(self._known) == KEPT:
                del self._known[next(iter(self._known))]
            self._known[key] = residuals_of(self._problem, unpack(self._model, unknowns))
        return self._known[key]

    def __call__(self, unknowns: Array) -> Array:
        return self._weighted(self.left(unknowns), unknowns)

    def beside(self, unknowns: Array) -> Array:
        """Return the rows of a place that nothing goes on from."""
        return weighted_rows(self._problem, self._model, self.weights, self._use, unknowns)

    def _weighted(self, left: Mapping[Channel, Array], unknowns: Array) -> Array:
        rows = weighted_residuals(self._problem, left, self.weights, self._use)
        return np.concatenate([rows, unknowns[: len(self._model.free)]])

    def weigh(self, weights: Mapping[Channel, float]) -> Array:
        """Take other weights, and return by what that multiplies each row."""
        ratios = [
            np.full(np.count_nonzero(self._use & one.ok), weights[one.channel] / self.weights[one.channel])
            for one in self._problem.observed
        ]
        self.weights = weights
        return np.concatenate([*ratios, np.ones(len(self._model.free))])


def _slopes(rows: _Rows, numbers: list[HypothesisNumber], known: Mapping[int, Array], unknowns: Array) -> Array:
    """Forward differences, away from the bounds; of some unknowns the columns may be known."""
    here = rows(unknowns)
    columns = np.empty((here.size, unknowns.size), order="F")
    for k, number in enumerate(numbers):
        if k in known:
            columns[:, k] = known[k]
            continue
        size = number.scale if number.logarithm else max(abs(unknowns[k]), number.scale)
        step = (LOG_STEP if number.logarithm else STEP) * size
        if unknowns[k] + step > number.high:
            step = -step
        there = unknowns.copy()
        there[k] += step
        columns[:, k] = (rows.beside(there) - here) / step
    return columns


def _descend(
    rows: _Rows,
    numbers: list[HypothesisNumber],
    known: Mapping[int, Array],
    start: Array,
    steps: int,
    close: float,
    first: Array | None = None,
) -> tuple[Array, Array]:
    """Go down from a start by damped Gauss-Newton steps: unknowns where that ends, and slopes there or a step before.

    `first` are the slopes of the start, where they are known.

    The rows are many and the unknowns few: each set of slopes is brought to a triangle once, of which every step is
    worked out. An unknown at its bound that would leave stays there. A step that a bound cuts may promise less than
    nothing; a shorter one does not.
    """
    low, high = np.array([one.low for one in numbers]), np.array([one.high for one in numbers])
    scale = np.array([one.scale for one in numbers])
    at = np.clip(start, low, high)
    here, slopes = rows(at), _slopes(rows, numbers, known, at) if first is None else first
    square, damping, harder = float(here @ here), DAMPING, 2.0
    q, triangle = _triangle(slopes * scale, here)
    for _ in range(steps - 1):
        down = -(triangle.T @ q)
        free = ~(((at <= low) & (down < 0.0)) | ((at >= high) & (down > 0.0)))
        step = _damped_step(triangle[:, free], q, damping)
        there = at.copy()
        there[free] = np.clip(at[free] + scale[free] * step, low[free], high[free])
        moved = (there - at) / scale
        after = q + triangle @ moved
        promised = float(q @ q - after @ after)
        new = rows(there)
        gained = square - float(new @ new)
        still = float(np.linalg.norm(moved)) < close * (close + float(np.linalg.norm(at / scale)))
        if gained > 0.0:
            ends = still or (gained < close * square and gained > 0.25 * promised)
            at, here, square = there, new, square - gained
            damping *= max(1.0 / 3.0, 1.0 - (2.0 * gained / max(promised, gained) - 1.0) ** 3)
            harder = 2.0
            if ends:  # too near where the slopes are from for others to be worth their runs
                break
            slopes = _slopes(rows, numbers, known, at)
            q, triangle = _triangle(slopes * scale, here)
        elif still or 0.0 <= promised <= close * close * square:
            break
        else:
            damping *= harder
            harder *= 2.0
    return at, slopes


def _triangle(slopes: Array, here: Array) -> tuple[Array, Array]:
    """Return residuals (k,) and slopes (k, k) with the products of these (n,) and (n, k), which steps depend on."""
    both = np.column_stack([slopes, here])
    found = np.asarray(np.linalg.qr(both, mode="r"))[: slopes.shape[1]]
    return found[:, -1], found[:, :-1]


def _damped_step(slopes: Array, here: Array, damping: float) -> Array:
    """Return the least-squares step of so many unknowns, held back in proportion to what each does (Marquardt)."""
    sizes = np.sqrt(damping) * np.maximum(np.linalg.norm(slopes, axis=0), 1e-12)
    rows = np.vstack([slopes, np.diag(sizes)])
    return np.asarray(np.linalg.lstsq(rows, -np.concatenate([here, np.zeros(sizes.size)]), rcond=None)[0])


def fit_model(
    problem: AxisProblem, model: Model, use: BoolArray, rounds: int = 2, evaluations: int = 12
) -> FittedModel:
    """Fit the unknowns of a model on the samples in use, by damped Gauss-Newton steps.

    Parameters
    ----------
    problem : AxisProblem
    model : Model
        With the numbers to start from.
    use : BoolArray, shape (n,)
    rounds : int
        How often the channels are weighed anew by what is left of them.
    evaluations : int
        Most steps of a round.
    """
    numbers = _numbers(model)
    unknowns = np.clip(pack(model), [one.low for one in numbers], [one.high for one in numbers])
    rows = _Rows(problem, model, use)
    jacobian, first = np.zeros((0, unknowns.size)), None
    rows.weights = weights_of(problem, rows.left(unknowns), use)
    for _ in range(rounds if unknowns.size else 0):
        unknowns, jacobian = _descend(rows, numbers, {}, unknowns, evaluations, CLOSE, first)
        before, weights = rows.weights, weights_of(problem, rows.left(unknowns), use)
        if all(abs(weights[one] / before[one] - 1.0) < SAME for one in weights):
            break
        first = jacobian * rows.weigh(weights)[:, None]
    left = rows.left(unknowns)
    return FittedModel(model=unpack(model, unknowns), left=left, jacobian=jacobian, unknowns=unknowns)


def fit_briefly(
    problem: AxisProblem,
    model: Model,
    weights: Mapping[Channel, float],
    known: Mapping[int, Array],
    steps: int,
) -> FittedModel:
    """Fit a model for a few steps only, most of whose slopes are taken from the model that it grew from.

    Parameters
    ----------
    problem : AxisProblem
    model : Model
        With the numbers to start from.
    weights : mapping
        Of the channels, as the known slopes have them.
    known : mapping of int to Array, shape (rows,)
        Slopes by unknown.
    steps : int
    """
    rows = _Rows(problem, model, problem.fit, weights)
    unknowns, jacobian = _descend(rows, _numbers(model), known, pack(model), steps, FIRST)
    there, left = unpack(model, unknowns), rows.left(unknowns)
    return FittedModel(model=there, left=left, jacobian=jacobian, unknowns=unknowns)


def covariance(problem: AxisProblem, fitted: FittedModel, use: BoolArray) -> Array:
    """Return the covariance of the unknowns (k, k), of residuals that go together within blocks of time."""
    priors = fitted.jacobian.shape[0] - len(fitted.model.free)
    return fit_covariance(problem, fitted.left, fitted.jacobian[:priors], fitted.jacobian[priors:], use)
