"""Counting verdicts: what is right, what is near, and in which class a case is counted."""

from __future__ import annotations

import math
from typing import Any

import pytest

from tests.support.plants.axis import Plant
from tests.support.plants.score import answered, class_of, metric, near, quiet, shares, summary, wilson, wrong

TRUTH = {
    "name": "coulomb_friction",
    "axis": "X",
    "parameter": "force",
    "value": 5e-6,
    "ratio": 9.0,
    "found": 5.3e-6,
}


def result(**changed: Any) -> dict[str, Any]:
    plain = {
        "key": "k",
        "kind": "single",
        "effects": ["coulomb_friction"],
        "channels": "act",
        "feedback": "motor",
        "truths": [TRUTH],
        "apart": {"coulomb_friction": {"nothing": 1e5, "backlash": 1e4}},
        "verdict": "named",
        "findings": [{"name": "coulomb_friction", "axis": "X", "ambiguous_with": [], "parameters": {}}],
        "noise_floor": 2e-7,
        "holdout": 2.5e-7,
    }
    return plain | changed


def finding(name: str, axis: str = "X", *others: str) -> dict[str, Any]:
    return {"name": name, "axis": axis, "ambiguous_with": list(others), "parameters": {}}


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({}, "right"),
        ({"findings": [finding("coulomb_friction", "Y")]}, "wrong"),
        ({"findings": [finding("coulomb_friction"), finding("backlash")]}, "more"),
        ({"verdict": "ambiguous", "findings": [finding("backlash", "X", "coulomb_friction:X")]}, "ambiguous"),
        (
            {"verdict": "ambiguous", "findings": [finding("backlash", "X", "cogging")]},
            "ambiguous, not with it",
        ),
        ({"verdict": "unknown", "findings": []}, "unknown"),
        ({"kind": "nothing", "truths": []}, "invented"),
        ({"kind": "nothing", "truths": [], "verdict": "nothing-missing", "findings": []}, "right"),
        ({"kind": "outside", "verdict": "unknown", "findings": []}, "right"),
        ({"error": "fell over"}, "error"),
    ],
)
def test_an_answer_in_a_word(changed: dict[str, Any], word: str) -> None:
    assert answered(result(**changed)) == word


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({}, "clear"),
        ({"apart": {"coulomb_friction": {"nothing": 1e5, "backlash": 3.0}}}, "alike"),
        ({"apart": {"coulomb_friction": {"nothing": 3.0}}}, "faint"),
        ({"channels": "unknown"}, "alike"),
        ({"channels": "unknown", "effects": ["cogging"]}, "clear"),
        ({"truths": [TRUTH | {"ratio": 2.9}]}, "faint"),
        ({"truths": [TRUTH | {"parameter": "moving_average", "value": 2e-3}]}, "alike"),
        ({"truths": [TRUTH | {"parameter": "moving_average", "value": 2.1e-3}]}, "clear"),
        ({"truths": [TRUTH | {"parameter": "exponential_filter", "value": 6e-4}]}, "clear"),
        ({"kind": "nothing", "truths": []}, "nothing"),
    ],
)
def test_the_class_of_a_case(changed: dict[str, Any], name: str) -> None:
    assert class_of(result(**changed)) == name


def test_near_and_quiet() -> None:
    assert near(result())
    assert not near(result(truths=[TRUTH | {"found": 5.6e-6}]))
    assert not near(result(truths=[TRUTH | {"found": None}]))
    assert quiet(result())
    assert not quiet(result(holdout=2.7e-7))


def test_units_of_the_shop() -> None:
    plant = Plant("motor", 1e-4, 6e-3, stiffness=1e6)
    assert metric(5.0, "N", plant) == pytest.approx(5e-6)
    assert metric(0.005, "mm", plant) == pytest.approx(5e-6)
    assert metric(1.0, "N s/mm", plant) == pytest.approx(1e-3)
    assert metric(100.0, "Hz", plant) == pytest.approx(200.0 * math.pi)
    assert math.isnan(metric(1.0, "furlong", plant))


def test_tables_count() -> None:
    wrong = result(findings=[finding("backlash")])
    lines = summary([result(), result(), wrong]).splitlines()
    assert lines[2] == "| single, clear | 3 | 67 % | 100 % | 100 % | wrong 1 |"


def test_shares_of_what_is_asked() -> None:
    other = result(findings=[finding("backlash")])
    unsided = result(verdict="ambiguous", channels="unknown", findings=[finding("backlash", "X", "coulomb_friction")])
    clean = result(kind="nothing", truths=[], verdict="nothing-missing", findings=[])
    told = shares([result(), other, unsided, clean, clean | {"verdict": "unknown"}])
    assert told["friction named"][:2] == [2, 3]
    assert told["clean without a name"][:2] == [2, 2]
    assert told["no wrong name without doubt"][:2] == [4, 5]
    assert wrong(other)
    assert not wrong(unsided)
    assert wrong(result(kind="outside"))


def test_an_interval_of_wilson_is_that_of_his_equation() -> None:
    """Its ends are the shares that are 1.96 of their own standard deviations from what was counted."""
    for hits, of in ((0, 7), (3, 9), (40, 40)):
        for end in wilson(hits, of):
            share = end / 100.0
            spread = 1.96 * math.sqrt(share * (1.0 - share) / of)
            assert abs(hits / of - share) == pytest.approx(spread, abs=1.5e-3)
