"""The summary of the search for free shapes: what it says of a shape is what the shape does."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests.long.frontier import CASES, RULES, Task, evolve, hunting

SUMMARY = json.loads(Path(__file__).with_name("frontier.json").read_text())
SHAPES = [row for row in SUMMARY["rows"] if "shape" in row]
BY_NAME = {case.name: case for case in CASES}


@pytest.mark.parametrize("number", range(len(SHAPES)))
def test_a_shape_is_as_good_as_its_summary_says(number: int) -> None:
    row = SHAPES[number]
    task = Task(BY_NAME[row["case"]], row["added_s"], row["rules"])
    shape = np.array(row["shape"])
    assert task.over(shape) <= 0.0
    # Some of the machines that were tried: the worst of all is in the summary.
    found = task.errors(shape, task.bodies(all_corners=False))
    assert 0.3e-6 * row["worst_um"] <= found.max() <= 1.001e-6 * row["worst_um"]


def test_what_hunts_at_rest_is_in_the_summary() -> None:
    for row in SUMMARY["rows"]:
        for rule, size in row.get("hunting_um", {}).items():
            assert hunting(BY_NAME[row["case"]], rule) == pytest.approx(1e-6 * size, rel=1e-3, abs=1e-9)


def test_the_evolution_strategy_finds_a_valley() -> None:
    def valley(x: np.ndarray) -> float:
        return float(100.0 * (x[1] - x[0] ** 2) ** 2 + (1.0 - x[0]) ** 2 + (x[2] + 0.5) ** 2)

    best, least = evolve(valley, np.array([-1.0, 1.0, 1.0]), 0.4, 150, np.random.default_rng(1))
    assert least < 1e-8
    np.testing.assert_allclose(best, [1.0, 1.0, -0.5], atol=1e-3)


def test_cases_are_those_of_the_machine_files() -> None:
    from ph_post.drive.machinefile import read_machine

    for case, name, axis in zip(CASES, ("paper", "mill"), ("X", "Y"), strict=True):
        one = read_machine(name).axes[axis]
        known = (one.servo.b, one.servo.c, one.gap.lost_motion, one.gap.inertia_fraction, one.gap.beta)
        assert known == pytest.approx(case.body[1:3] + case.body[5:8], rel=1e-6)
        limits = (one.limits.velocity, one.limits.acceleration, one.limits.jerk)
        assert limits == pytest.approx(case.limits)
    assert RULES == ("standstill", "momentum", "contact")
