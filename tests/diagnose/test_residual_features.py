"""What is more than noise: how often white noise is taken for it, and how small it may be."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ph_post.diagnose.residual_features import coloured, is_structured

ALL = np.ones(10_000, dtype=np.bool_)


@pytest.mark.parametrize("quantum", [0.0, 0.5, 1.0, 2.0])
@pytest.mark.parametrize("size", [300, pytest.param(3000, marks=pytest.mark.slow)])
@pytest.mark.thinned(6)
def test_white_noise_on_a_grid_is_no_structure(quantum: float, size: int) -> None:
    rng = np.random.default_rng(round(10.0 * quantum) + size)
    found = colours = 0
    for _ in range(600):
        values = rng.standard_normal(size)
        values = quantum * np.round(values / quantum) if quantum else values
        noise = math.sqrt(1.0 + quantum**2 / 12.0)
        found += is_structured(values, ALL[:size], noise)[0]
        colours += coloured(values)
    assert found < 3
    assert colours < 3


@pytest.mark.parametrize("frequency", [2e-4, 1e-3, 0.013, 0.2])
@pytest.mark.parametrize("train", [False, True])
def test_half_the_noise_is_seen(frequency: float, train: bool) -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        wave = np.sin(2.0 * np.pi * frequency * np.arange(10_000) + rng.uniform(0.0, 6.0))
        added = 0.5 * (np.sign(wave) if train else wave)
        structured, size = is_structured(added + rng.standard_normal(10_000), ALL, 1.0)
        assert structured
        assert size == pytest.approx(math.sqrt(np.mean(added**2)), abs=0.12)


def test_noise_that_is_a_little_larger_than_thought_is_no_structure() -> None:
    values = np.random.default_rng(1).standard_normal(10_000)
    assert not is_structured(values, ALL, 0.8)[0]
    structured, size = is_structured(values, ALL, 0.5)
    assert structured, "twice is more than that"
    assert size == pytest.approx(math.sqrt(3.0), rel=0.03)


def test_colour_below_the_noise_is_no_structure() -> None:
    """A model that fits as well as the record repeats itself, whatever the spectrum of that is."""
    slow = np.cumsum(np.random.default_rng(2).standard_normal(10_000))
    slow /= np.sqrt(np.mean(slow**2))
    assert coloured(slow)
    assert not is_structured(slow, ALL, 1.0)[0]


def test_an_offset_is_structure() -> None:
    values = 0.4 + np.random.default_rng(3).standard_normal(10_000)
    assert is_structured(values, ALL, 1.0)[0]


def test_only_counted_samples_count() -> None:
    values = np.random.default_rng(4).standard_normal(10_000)
    values[2000:3000] += 50.0
    values[4000] = np.nan
    counted = ALL.copy()
    counted[2000:3000] = False
    assert not is_structured(values, counted, 1.0)[0]
    assert is_structured(values, ALL, 1.0)[0]
    assert is_structured(values, ALL & False, 1.0) == (False, 0.0)


def test_without_noise_all_that_is_left_is_structure() -> None:
    assert is_structured(1e-9 * np.ones(100), ALL[:100], 0.0) == (True, math.inf)
    assert is_structured(np.zeros(100), ALL[:100], 0.0) == (False, 0.0)
