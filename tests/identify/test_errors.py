"""Standard errors under residuals that go together: how often their intervals hold the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from ph_post.identify.errors import BLOCKS, block_covariance, rounding_of
from ph_post.identify.free_run import ObservedChannel

N, TRIALS = 6000, 400
NUMBER = np.arange(N) * BLOCKS // N


def coverage(memory: float, prior: float | None = None) -> list[float]:
    """How often one standard error holds the truth, of a level, a wave and a rare event; residuals remember so long."""
    rng = np.random.default_rng(11)
    t = np.arange(N)
    rare = np.where((t // 300) % 5 == 2, np.sin(t / 40.0), 0.0)
    columns = np.stack([np.ones(N), np.sin(t / 150.0), rare], axis=1)
    keeps = np.exp(-1.0 / memory) if memory else 0.0
    held = np.zeros(3)
    for _ in range(TRIALS):
        noise = signal.lfilter([np.sqrt(1.0 - keeps**2)], [1.0, -keeps], rng.standard_normal(N + 500))[500:]
        rows = np.zeros((0, 3)) if prior is None else np.eye(3)[:1] / prior
        truth = np.zeros(3) if prior is None else np.array([prior * rng.standard_normal(), 0.0, 0.0])
        # Least squares of rows that are reading minus model: the model's slope is minus the column.
        whole = np.vstack([-columns, rows])
        reading = columns @ truth + noise
        found = np.linalg.lstsq(whole, np.concatenate([-reading, np.zeros(rows.shape[0])]), rcond=None)[0]
        left = reading - columns @ found
        size = np.std(left)
        spread = block_covariance(-columns / size, left / size, NUMBER, rows)
        held += np.abs(found - truth) <= np.sqrt(np.diag(spread))
    return list(held / TRIALS)


@pytest.mark.parametrize("memory", [0.0, 5.0, 25.0])
@pytest.mark.thinned(8)
def test_one_standard_error_holds_the_truth_in_60_to_75_of_100(memory: float) -> None:
    assert all(0.60 <= one <= 0.75 for one in coverage(memory))


def test_what_is_known_beforehand_counts_as_much_as_it_is_sure() -> None:
    assert all(0.60 <= one <= 0.75 for one in coverage(25.0, prior=0.05))


def test_rounding_that_repeats_does_not_average_out() -> None:
    """A step between two places, read in counts of 1, to which an axis comes back twenty times."""
    rng = np.random.default_rng(2)
    high, moving = np.arange(N) // 150 % 2 == 1, np.arange(N) % 150 < 40
    held, trials = 0, 300
    for _ in range(trials):
        step, zero = rng.uniform(3.0, 8.0), rng.uniform()
        reading = np.floor(high * step + zero + moving * rng.uniform(0.0, 5.0, N))
        columns = np.stack([np.ones(N), high], axis=1)[~moving]
        found = np.linalg.lstsq(columns, reading[~moving], rcond=None)[0]
        channel = ObservedChannel("act", reading, np.ones(N, dtype=bool), 0.3, 1.0)
        rounded = rounding_of(channel, np.where(moving, 1.0, 0.0), ~moving)
        left = reading[~moving] - columns @ found
        spread = block_covariance(-columns, left, NUMBER[~moving], rounded=[rounded])
        held += abs(found[1] - step) <= np.sqrt(spread[1, 1])
    assert 0.60 * trials <= held <= 0.75 * trials


def test_what_does_not_show_is_not_known() -> None:
    columns = np.stack([np.ones(N), np.zeros(N)], axis=1)
    spread = block_covariance(columns, np.random.default_rng(1).standard_normal(N), NUMBER)
    assert spread[0, 0] == pytest.approx(1.0 / N, rel=0.6)
    assert spread[1, 1] > 1e12
