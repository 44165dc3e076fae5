"""Every case of which other tests try a sample; from a quarter of an hour on a core: `pytest tests/long`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tests.analysis import test_osculating as osculating
from tests.controllers import test_expansion as expansion
from tests.dialects import test_siemens_exact as siemens_exact
from tests.hidden import test_named as named
from tests.identify import test_hand_measurements as by_hand
from tests.post import test_approach as approach
from tests.property import test_auto_races as auto_races
from tests.property import test_auto_random as auto_random
from tests.property import test_limits as limits
from tests.property import test_turning_reference as turning_reference
from tests.support.canon import needs_rs274

BATCHES = 20


@pytest.mark.parametrize("batch", range(BATCHES))
def test_auto_is_never_worse_than_none_and_keeps_what_it_promises(batch: int) -> None:
    for number in range(batch, auto_random.PAIRS, BATCHES):
        auto_random.keeps_its_promises(number)


@pytest.mark.parametrize("batch", range(BATCHES))
def test_no_single_strategy_beats_auto(batch: int) -> None:
    for number in range(batch, auto_races.PAIRS, BATCHES):
        auto_races.is_not_beaten(number)


def test_no_sample_breaks_a_limit() -> None:
    assert sum(map(limits.try_dip, range(limits.PAIRS))) > 300


def test_no_sample_breaks_a_limit_where_the_path_stands_still(monkeypatch: pytest.MonkeyPatch) -> None:
    numbers = range(limits.PAIRS_WITH_HOLDS)
    assert sum(limits.try_stop(number, monkeypatch) for number in numbers) > 40


@pytest.mark.parametrize(("name", "channels", "feedback", "seed"), named.SINGLES)
def test_one_hidden_effect_is_named_and_sized(name: str, channels: str, feedback: str, seed: int) -> None:
    named.is_named_and_sized(name, channels, feedback, seed)


@pytest.mark.parametrize(("name", "machine"), approach.CASES)
def test_the_program_is_as_good_as_it_says_whatever_side_the_axes_stood_on(name: str, machine: str) -> None:
    approach.is_as_good_as_it_says(name, machine)


@pytest.mark.parametrize("strategy", siemens_exact.STRATEGIES)
@pytest.mark.parametrize(("path", "machine"), siemens_exact.PAIRS, ids=lambda file: file.stem)
def test_siemens_program_is_the_path_and_the_plan(path: Path, machine: Path, strategy: str) -> None:
    siemens_exact.compare_program(path, machine, strategy)


@pytest.mark.parametrize("honest", [by_hand.dial_is_honest, by_hand.cut_is_honest, by_hand.both_are_honest])
def test_two_hundred_machines_measured_by_hand(honest: Callable[[Path, int], None], tmp_path: Path) -> None:
    honest(tmp_path, 200)


def test_a_hundred_machines_measured_by_a_ball_bar(tmp_path: Path) -> None:
    by_hand.bars_are_honest(tmp_path, 100)


def test_a_thousand_random_paths_turn_where_exact_arithmetic_says() -> None:
    turning_reference.are_as_computed_exactly(1000)


def test_windows_on_a_thousand_random_curves() -> None:
    osculating.are_within_tolerance(1000, windows=1300, by_deviation=1000)


@needs_rs274
@pytest.mark.parametrize("file", expansion.SHIPPED, ids=expansion.named_by_folder)
def test_every_shipped_program_comes_to_the_same_calls(file: Path) -> None:
    expansion.comes_to_the_same_calls(file)
