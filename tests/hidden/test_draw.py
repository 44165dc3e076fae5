"""Hidden plants at random: repeatable, readable, and without their labels."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.support.plants.cases import load, save
from tests.support.plants.draw import LEAST, MOST, draw_case
from tests.support.plants.sizes import LEADING, OUTSIDE
from tests.support.plants.trials import nothings, outsiders, pairs, shows, singles

EVERY = ("act", "motor", "force")


def test_the_same_seed_draws_the_same_case() -> None:
    first, again = (draw_case(["coulomb_friction"], EVERY, "motor", 3) for _ in range(2))
    other = draw_case(["coulomb_friction"], EVERY, "motor", 4)
    assert first.log == again.log
    assert first.machine == again.machine
    assert first.log != other.log


@pytest.mark.parametrize("name", ["coulomb_friction", "backlash", "squareness", "transport_delay"])
@pytest.mark.thinned(4)
def test_an_effect_shows_and_is_named_nowhere(name: str) -> None:
    case = draw_case([name], EVERY, "motor", 1)
    assert LEAST <= case.ratio <= MOST
    text = case.log.split("\n0.000", 1)[0] + case.machine
    assert not [other for other in (*LEADING, *OUTSIDE) if other in text]


@pytest.mark.parametrize("seed", [13200, 13201])
@pytest.mark.thinned(2)
def test_a_gain_that_is_off_hides_no_friction_beside_it(seed: int) -> None:
    """What brakes an axis is η b β of the whole, whatever its gains: else two effects are hidden, and found."""
    case = draw_case(["servo_mismatch"], EVERY, "cascade-load", seed)
    for plant in case.plants:
        assert plant.drive is not None
        assert plant.c - 1.0 / plant.drive.kv == pytest.approx(plant.eta * plant.beta * plant.b, rel=1e-9)


def test_the_noise_is_what_the_case_says() -> None:
    """In the rest at the beginning nothing moves, so that all that is left is the sensor."""
    case = draw_case([], EVERY, "motor", 5)
    rest = slice(0, 390)
    for name, floor in case.floors.items():
        assert float(np.std(case.readings[name][rest])) == pytest.approx(floor, rel=0.2)


def test_a_case_survives_its_file(tmp_path: Path) -> None:
    case = draw_case(["squareness"], ("act",), "load", 2)
    save(case, tmp_path / "case.npz")
    again = load(tmp_path / "case.npz")
    assert again.log == case.log
    assert again.machine == case.machine
    assert again.plants == case.plants
    assert again.truths == case.truths
    assert again.track.stretches == case.track.stretches


def test_every_effect_is_tried_ten_times_with_every_channel_set_that_can_show_it() -> None:
    trials = list(singles(10))
    assert len({trial.key for trial in trials}) == len(trials)
    assert {trial.effects[0] for trial in trials} == set(LEADING)
    assert len(list(nothings(300))) == 300
    assert {trial.effects[0] for trial in outsiders(16)} == set(OUTSIDE)
    assert all(len(trial.effects) == 2 for trial in pairs(40))


@pytest.mark.parametrize(
    ("name", "channels", "feedback", "expected"),
    [
        ("backlash", ("motor",), "motor", False),
        ("backlash", ("motor",), "load", True),
        ("cyclic_error", ("motor", "force"), "load", False),
        ("engagement_impact", ("act",), "motor", False),
        ("coulomb_friction", ("motor",), "motor", True),
    ],
)
def test_what_a_record_can_show_at_all(name: str, channels: tuple[str, ...], feedback: str, expected: bool) -> None:
    assert shows(name, channels, feedback) is expected
