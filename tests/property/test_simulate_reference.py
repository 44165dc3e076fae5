"""The engine against an independent integration: random axes, loops, rules, commands and effects."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.amount import examples
from support.engine_cases import (
    Case,
    contacts,
    contacts_of,
    log_uniform,
    make_command,
    make_machine,
    random_axis,
    random_command,
    random_effects,
    reference,
)

from ph_post.simulate.machine import simulate
from ph_post.types import Feedback, Pickup

PERIOD = 2e-3
FIRST = 12
"""Contacts of a chattering axis that are compared: each multiplies a difference before it."""
INSTANT = 2e-5
"""[s], a hundredth of a sample: where bodies part and meet slowly, 1e-13 m of rounding is a long time."""

loops = st.sampled_from(["load", "load", "load", "motor", "none"])
rules = st.sampled_from(["standstill", "momentum", "contact"])
controllers = st.sampled_from(["P", "PI", "PID"])
commands = st.sampled_from(["sines", "trapezoids", "circle"])


def draw(
    seed: int, feedback: Feedback, pickup: Pickup, control: str, kind: str, with_effects: bool, seconds: float
) -> Case:
    rng = np.random.default_rng(seed)
    size = log_uniform(rng, 1e-3, 0.25)
    axis = random_axis(rng, feedback, pickup, "P" if feedback == "none" else control, size)
    if with_effects:
        axis = replace(axis, effects=tuple(random_effects(rng, axis, size)))
    t = PERIOD * np.arange(round(seconds / PERIOD) + 1)
    return Case(axis, random_command(rng, kind, size, t), PERIOD)


def check(case: Case) -> None:
    """Places within 1e-9 m, contacts in the same order at the same times."""
    run = simulate(make_command(case.command[:, None], case.period), make_machine([case.axis], case.period))
    expected = reference(case)
    theirs, ours = contacts(expected.events), contacts_of(run, "X")
    count = len(theirs) if len(theirs) <= FIRST else FIRST
    assert [kind for _, kind in ours[:count]] == [kind for _, kind in theirs[:count]]
    assert [t for t, _ in ours[:count]] == pytest.approx([t for t, _ in theirs[:count]], abs=INSTANT)
    end = len(case.command) if len(theirs) <= FIRST else int(theirs[FIRST][0] / case.period)
    assert run.executed[:end, 0] == pytest.approx(expected.table[:end], abs=1e-9)
    assert run.motor[:end, 0] == pytest.approx(expected.motor[:end], abs=1e-9)
    if len(theirs) <= FIRST:
        assert len(ours) == len(theirs)


@settings(max_examples=examples(30))
@given(st.integers(0, 2**32 - 1), loops, rules, controllers, commands)
def test_plain_axes(seed: int, feedback: Feedback, pickup: Pickup, control: str, kind: str) -> None:
    check(draw(seed, feedback, pickup, control, kind, with_effects=False, seconds=0.3))


@settings(max_examples=examples(30))
@given(st.integers(0, 2**32 - 1), loops, rules, controllers, commands)
def test_axes_with_effects(seed: int, feedback: Feedback, pickup: Pickup, control: str, kind: str) -> None:
    check(draw(seed, feedback, pickup, control, kind, with_effects=True, seconds=0.3))


@settings(max_examples=examples(20))
@given(st.integers(0, 2**32 - 1))
def test_ideal_steppers(seed: int) -> None:
    case = draw(seed, "none", "standstill", "P", "sines", with_effects=False, seconds=0.3)
    check(case._replace(axis=replace(case.axis, servo=replace(case.axis.servo, b=0.0, c=0.0))))
