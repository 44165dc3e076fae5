"""The search at a turning point, on designs whose errors are known in closed form."""

from __future__ import annotations

from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from ph_post.analysis.path_analysis import analyse
from ph_post.compensate.families import DesignFamily, ReversalCase
from ph_post.compensate.motion import cycle_time
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.compensate.search import DesignBounds, DesignSearch, TriedDesign
from ph_post.compensate.shapes import single
from ph_post.compensate.time_shares import allocate
from ph_post.compensate.trial import Design, Surroundings, TrialResult
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.files.storage import or_shipped
from ph_post.gcode.paths import paths_of
from ph_post.gcode.read import read_program

PLAIN = np.array([1e-4, 1.5e-4, 0.8e-4])
"""Errors of the plain motion [m]: as the file has it, and in two other cases."""

PLACE = Surroundings(s=0.5, cruise=0.1, room=1.0, before=1.0, behind=1.0, flanks={"X": 1})
SHAPE = single([1.0, 1.0, 0.0, 1.0, 1.0])


def case(budget: float = 0.2) -> ReversalCase:
    return ReversalCase(place=PLACE, budget=budget, reversing=(), shortest={}, lead=False)


class Known:
    """In place of a trial: a bowl over (t*, turn) whose lowest point is known."""

    def __init__(self, optimum: tuple[float, float], floor: float = 0.02, worse: float = 0.0) -> None:
        self.optimum, self.floor, self.worse = np.array(optimum), floor, worse

    def run(self, design: Design) -> TrialResult:
        error = PLAIN.copy()
        if design.shape is not None:
            away = np.array([design.t_star, design.turn]) - self.optimum
            error = PLAIN * (self.floor + float(away @ away))
            error[2] += self.worse
        return outcome(error, longer=0.0 if design.shape is None else design.t_star)


def outcome(error: np.ndarray, longer: float = 0.1, use: float = 0.5, slowest: float = 0.02) -> TrialResult:
    return TrialResult(error=error, rms=0.5 * error, use=use, longer=longer, slowest=slowest)


def bowl() -> DesignFamily:
    def make(x: np.ndarray, _case: ReversalCase) -> Design:
        return Design(shape=SHAPE, t_star=float(x[0]), turn=float(x[1]))

    low, high = np.array([0.01, 0.1]), np.array([1.0, 0.9])
    return DesignFamily(name="bowl", low=low, high=high, seeds=(np.array([0.15, 0.5]),), make=make)


def search(trial: Any, budget: float = 0.2, nominal: int = 1, **bounds: Any) -> DesignSearch:
    return DesignSearch(trial, case(budget), DesignBounds(**{"slowest": 0.0} | bounds), nominal)


def test_a_search_finds_a_known_optimum() -> None:
    best = search(Known((0.11, 0.62))).explore([bowl()], 120)[-1]
    np.testing.assert_allclose([best.design.t_star, best.design.turn], [0.11, 0.62], atol=0.02)
    assert best.outcome.error.max() <= 0.0205 * PLAIN.max()


def test_a_search_stays_within_its_time() -> None:
    best = search(Known((0.5, 0.5)), budget=0.2).explore([bowl()], 120)[-1]
    assert best.longer <= 0.2 * (1.0 + 1e-9)
    assert best.longer >= 0.19


def test_what_is_worse_in_any_case_is_no_candidate() -> None:
    assert search(Known((0.11, 0.62), worse=1e-4)).explore([bowl()], 120) == []


@pytest.mark.parametrize(
    ("change", "bounds"),
    [
        ({"use": 1.01}, {}),
        ({"longer": 0.21}, {}),
        ({"slowest": 0.01}, {"slowest": 0.015}),
        ({"slowest": -0.01}, {}),
    ],
)
def test_what_breaks_a_bound_is_no_candidate(change: dict, bounds: dict) -> None:
    class Fixed:
        def run(self, design: Design) -> TrialResult:
            return outcome(PLAIN) if design.shape is None else outcome(0.5 * PLAIN, **change)

    class Allowed:
        def run(self, design: Design) -> TrialResult:
            return outcome(PLAIN) if design.shape is None else outcome(0.5 * PLAIN)

    assert search(Allowed()).look(bowl(), np.array([0.1, 0.5]), 0.2).allowed
    assert not search(Fixed(), **bounds).look(bowl(), np.array([0.1, 0.5]), 0.2).allowed


def test_no_score_prefers_what_is_worse_in_every_case() -> None:
    rng = np.random.default_rng(7)
    for _ in range(500):
        less = PLAIN * rng.uniform(0.0, 1.0, 3)
        more = less + PLAIN * rng.uniform(0.0, 0.5, 3)
        answers = iter([outcome(PLAIN), outcome(less), outcome(more)])
        looks = search(SimpleNamespace(run=lambda _design, answers=answers: next(answers)))
        first, second = (looks.look(bowl(), np.array([0.1, 0.5]), 0.2) for _ in range(2))
        assert first.score <= second.score
        assert first.merit <= second.merit


def test_candidates_are_each_better_than_all_that_are_quicker() -> None:
    looks = search(Known((0.12, 0.5)))
    found = looks.explore([bowl()], 120)
    longer, merit = np.array([one.longer for one in found]), np.array([one.merit for one in found])
    assert np.all(np.diff(longer) >= 0.0)
    assert np.all(np.diff(merit) < 0.0)
    best = min(one.merit for one in looks.tried if one.allowed)
    assert merit[-1] <= best / 0.97


def found(longer: float, merit: float) -> TriedDesign:
    done = outcome(np.array([merit]), longer=longer)
    return TriedDesign(
        family=bowl(),
        x=np.zeros(2),
        budget=1.0,
        design=Design(),
        outcome=done,
        side=0.0,
        score=0.0,
        merit=merit,
        allowed=True,
    )


def test_time_is_shared_out_as_well_as_by_trying_all_ways() -> None:
    rng = np.random.default_rng(8)
    for _ in range(200):
        windows = []
        for _ in range(int(rng.integers(1, 5))):
            count = int(rng.integers(1, 5))
            times, merits = np.sort(rng.uniform(0.0, 1.0, count)), np.sort(rng.uniform(0.0, 1.0, count))[::-1]
            windows.append([found(*pair) for pair in zip(times, merits, strict=True)])
        least = sum(own[0].longer for own in windows)
        time = least + float(rng.uniform(0.0, 2.0))
        picked = allocate(windows, time)
        assert sum(one.longer for one in picked) <= time
        ways = [way for way in product(*windows) if sum(one.longer for one in way) <= time]
        best = min(max(one.merit for one in way) for way in ways)
        assert max(one.merit for one in picked) == best


SNAKE = "G21 G90 G17\nG0 X0 Y0\nG1 X40 F1000\n" + "".join(
    f"G3 Y{20 + 40 * k} X40 I0 J10\nG1 X0\nG2 X0 Y{40 + 40 * k} I0 J10\nG1 X40\n" for k in range(3)
)
"""Six half circles; X turns in the middle of each, at places that are all alike."""


def test_where_nothing_helped_no_place_that_is_alike_is_searched(monkeypatch: pytest.MonkeyPatch) -> None:
    (path,) = paths_of(read_program(SNAKE.encode(), "snake.ngc"))
    analysis = analyse(path.path, read_machine("mill"), 5e-6)
    searched: list[float] = []

    def nothing(search: DesignSearch, *_: Any) -> list[TriedDesign]:
        searched.append(search.case.place.room)
        return []

    monkeypatch.setattr(DesignSearch, "explore", nothing)
    make_plan(analysis, PlanOptions(strategy="takeup", carrier="program", effort=0.01))
    assert len(analysis.windows) >= 6
    # each place that is searched has more room than those before
    assert 1 <= len(searched) <= 2
    assert searched == sorted(searched)


@pytest.mark.parametrize(("allowed", "most"), [(0.02, 0.32), (0.1, 1.0), (5.0, 1.0)])
@pytest.mark.thinned(4)
def test_no_longer_stop_is_tried_than_any_machine_needs(
    allowed: float, most: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of what may be added, `allowed` seconds are a window's; the last are 16 times of it where nothing was found."""
    (path,) = paths_of(read_program(SNAKE.encode(), "snake.ngc"))
    analysis = analyse(path.path, read_machine("mill"), 5e-6)
    plain = make_plan(analysis, PlanOptions(strategy="none"))
    budgets: list[float] = []

    def look(_: DesignSearch, family: DesignFamily, x: np.ndarray, budget: float) -> SimpleNamespace:
        budgets.append(budget)
        return SimpleNamespace(family=family, x=x, budget=budget, score=0.0, allowed=False)

    monkeypatch.setattr(DesignSearch, "look", look)
    monkeypatch.setattr(DesignSearch, "_refine", lambda *_: None)
    slowdown = allowed * len(analysis.windows) / cycle_time(plain.phases)
    make_plan(analysis, PlanOptions(strategy="takeup", carrier="program", max_slowdown=slowdown))
    assert max(budgets) == pytest.approx(most, rel=0.2)
    assert most == 1.0 or max(budgets) > 10.0 * min(budgets)


@pytest.mark.parametrize("effort", [0.01, 0.1])
@pytest.mark.thinned(2)
def test_windows_in_which_other_axes_turn_back_are_searched_once_a_kind(
    effort: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    analysis = analyse(read_path(or_shipped("paths", "butterfly")), read_machine("mill"), 5e-6)
    kinds: list[tuple[str, ...]] = []

    def nothing(search: DesignSearch, *_: Any) -> list[TriedDesign]:
        kinds.append(tuple(axis.name for axis, _ in search.case.reversing))
        return []

    monkeypatch.setattr(DesignSearch, "explore", nothing)
    monkeypatch.setattr(DesignSearch, "prolong", nothing)
    make_plan(analysis, PlanOptions(strategy="takeup", carrier="program", effort=effort))
    assert set(kinds) == {("X",), ("Y",)}
    searched = len(kinds)
    assert searched < len(analysis.windows)
    # The first is tried in more time, too, as nothing was found.
    assert effort > 0.01 or searched == 3
