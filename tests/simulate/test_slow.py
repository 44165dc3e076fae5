"""Forces that are Python functions, against an integration written here."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from support.engine_cases import effect, make_axis, make_command, make_machine

from ph_post.drive.effects.base import Effect, Parameter, Values
from ph_post.drive.effects.registry import find_effect
from ph_post.drive.plant import Force, Plant
from ph_post.simulate import slow
from ph_post.simulate.machine import simulate
from ph_post.types import Axis, EffectSetting, Pickup, Run

PERIOD = 2e-3
T = PERIOD * np.arange(201)
WAVES = 0.02 * np.sin(7.0 * T) + 0.006 * np.sin(23.0 * T)
B, C, ETA, BETA, GAP = 4e-4, 0.02, 0.4, 4.0, 4e-4
SOFT = {"b": B, "c": C, "eta": ETA, "beta": BETA}
TINY = 1e-15
"""By which an event function begins off zero where a mode begins on it."""


def cogging(_t: float, x: float, _v: float, _direction: float) -> float:
    return 2e-4 * math.sin(2.0 * math.pi * x / 5e-3)


def cubic(_t: float, _x: float, v: float, _direction: float) -> float:
    return 0.2 * v**3


def shaker(t: float, _x: float, _v: float, _direction: float) -> float:
    return 3e-4 * math.cos(180.0 * t)


def ramp(t: float, _x: float, _v: float, _direction: float) -> float:
    return 1e-3 * t


def even(_t: float, _x: float, _v: float, _direction: float) -> float:
    return 1e-4


FORCES: dict[str, Force] = {"cogging": cogging, "cubic": cubic, "shaker": shaker, "ramp": ramp, "even": even}
SMOOTH = ("cogging", "cubic", "shaker")


def add_force(plant: Plant, values: Values) -> Plant:
    return replace(plant, forces=(*plant.forces, list(FORCES.values())[int(values["which"])]))


PLUGGED = Effect(
    name="plugged",
    kind="force",
    summary="one of the forces here",
    source="this test",
    parameters=(Parameter(name="which", gives="which", meaning="its name", choices=tuple(FORCES)),),
    apply=add_force,
)


class Entry(NamedTuple):
    name: str
    what: object

    def load(self) -> object:
        return self.what


@pytest.fixture(autouse=True)
def _registered(monkeypatch: pytest.MonkeyPatch) -> None:
    points = [Entry("plugged", PLUGGED)]
    monkeypatch.setattr("ph_post.registry.entry_points", lambda group: points if group == "ph_post.effects" else [])
    assert find_effect("plugged") is PLUGGED


def plugged(*names: str) -> list[EffectSetting]:
    return [EffectSetting(name="plugged", parameters={"which": name}) for name in names]


def run(axis: Axis, position: NDArray[np.float64] = WAVES, period: float = PERIOD, begin: float = 0.0) -> Run:
    command = make_command(position[:, None], period)
    return simulate(replace(command, t=command.t + begin), make_machine([axis], period))


def event(function: Callable[..., float], terminal: bool = True) -> Any:
    function.terminal, function.direction = terminal, -1  # type: ignore[attr-defined]
    return function


class Integrated(NamedTuple):
    """Table and motor at the samples [m], and the contacts between them."""

    table: NDArray[np.float64]
    motor: NDArray[np.float64]
    events: list[tuple[float, str]]


@cache
def one_body(force: Force, begin: float = 0.0) -> tuple[NDArray[np.float64], list[float]]:
    """An axis without a gap: its places at the samples, and the places at which it turns round, in order."""
    y, places, turns = np.array([WAVES[0], 0.0]), [WAVES[0]], [WAVES[0]]
    for k, (X0, X1) in enumerate(pairwise(WAVES)):

        def rate(t: float, y: Any, X0: float = X0, X1: float = X1, start: float = T[k]) -> list[float]:
            u = X0 + (X1 - X0) * (t - start) / PERIOD - y[0]
            return [y[1], (u - C * y[1] - force(begin + t, y[0], y[1], np.sign(y[1]))) / B]

        found = solve_ivp(
            rate,
            (T[k], T[k + 1]),
            y,
            method="DOP853",
            rtol=1e-11,
            atol=1e-15,
            events=[lambda t, y: y[1]] if k else None,
        )
        turns += [at[0] for at in found.y_events[0]] if k else []
        y = found.y[:, -1]
        places.append(y[0])
        turns.append(y[0])
    return np.array(places), turns


def two_bodies(force: Force, rule: Pickup) -> Integrated:
    """A loop over the table with a gap, whose table rests while the gap is open (the force is none there)."""
    flank, y, rest, events = 1, np.array([WAVES[0], 0.0]), 0.0, []
    table, motor = [WAVES[0]], [WAVES[0] + 0.5 * GAP]
    for k in range(T.size - 1):
        t = T[k]
        while True:

            def u(t: float, x: float, k: int = k) -> float:
                return float(WAVES[k] + (WAVES[k + 1] - WAVES[k]) * (t - T[k]) / PERIOD - x)

            def engaged(t: float, y: Any) -> list[float]:
                return [y[1], (u(t, y[0]) - C * y[1] - force(t, y[0], y[1], np.sign(y[1]))) / B]

            def opened(t: float, y: Any, rest: float = rest) -> list[float]:
                return [y[1], u(t, rest) / (ETA * B) - BETA * y[1]]

            stops = [event(lambda t, y, flank=flank: flank * y[1] + TINY)]
            meets = [event(lambda t, y, s=s, rest=rest: 0.5 * GAP + TINY - s * (y[0] - rest)) for s in (1, -1)]
            found = solve_ivp(
                engaged if flank else opened,
                (t, T[k + 1]),
                y,
                method="DOP853",
                rtol=1e-12,
                atol=1e-16,
                events=stops if flank else meets,
            )
            t, y = found.t[-1], found.y[:, -1]
            if found.status == 0:
                break
            if flank:
                rest, left, y, flank = y[0], flank, np.array([y[0] + flank * 0.5 * GAP, 0.0]), 0
                events.append((t, "opens"))
            else:
                flank = 1 if y[0] > rest else -1
                events.append((t, "falls back" if flank == left else "picks up"))
                y = np.array([rest, ETA * y[1] if rule == "momentum" else 0.0])
        table.append(y[0] if flank else rest)
        motor.append(y[0] + flank * 0.5 * GAP)
    return Integrated(np.array(table), np.array(motor), events)


@pytest.mark.slow
@pytest.mark.parametrize("name", SMOOTH)
@pytest.mark.thinned(4)
def test_a_force_on_an_axis_without_a_gap(name: str) -> None:
    """Closer than what a part of a sample may be wrong by."""
    found = run(make_axis("load", gap=0.0, **SOFT, effects=plugged(name)))
    expected, _ = one_body(FORCES[name])
    assert found.executed[:, 0] == pytest.approx(expected, abs=slow.NEGLIGIBLE)
    without = run(make_axis("load", gap=0.0, **SOFT))
    assert np.abs(found.executed - without.executed).max() > 1e-5


@pytest.mark.slow
def test_forces_add_up_and_count_time_as_the_command_does() -> None:
    found = run(make_axis("load", gap=0.0, **SOFT, effects=plugged("shaker", "cubic")), begin=7.3)
    expected, _ = one_body(lambda *given: shaker(*given) + cubic(*given), begin=7.3)
    assert found.executed[:, 0] == pytest.approx(expected, abs=slow.NEGLIGIBLE)


@pytest.mark.slow
def test_a_force_on_the_motor_before_a_gap_outside_the_loop() -> None:
    """The table is the play operator's, which goes from turn to turn of the motor."""
    found = run(make_axis("motor", gap=GAP, **SOFT, effects=plugged("cogging")))
    expected, turns = one_body(cogging)
    x = WAVES[0] - 0.5 * GAP
    ends = []
    for place in turns:
        x = min(max(x, place - 0.5 * GAP), place + 0.5 * GAP)
        ends.append(x)
    at_samples = np.flatnonzero(np.isin(turns, expected))
    assert found.motor[:, 0] == pytest.approx(expected, abs=slow.NEGLIGIBLE)
    assert found.executed[:, 0] == pytest.approx(np.array(ends)[at_samples], abs=slow.NEGLIGIBLE)


@pytest.mark.parametrize("rule", ["standstill", "momentum"])
@pytest.mark.thinned(4)
def test_a_force_and_a_gap_inside_the_loop(rule: Pickup) -> None:
    """Also where a pick-up makes the force jump within a sample."""
    found = run(make_axis("load", gap=GAP, **SOFT, pickup=rule, effects=plugged("cubic")))
    expected = two_bodies(cubic, rule)
    contacts = [one for one in found.events if one.kind in {"opens", "picks up", "falls back"}]
    assert len(contacts) > 4
    assert [one.kind for one in contacts] == [kind for _, kind in expected.events]
    assert [one.t for one in contacts] == pytest.approx([t for t, _ in expected.events], abs=1e-7)
    assert found.executed[:, 0] == pytest.approx(expected.table, abs=2e-9)
    assert found.motor[:, 0] == pytest.approx(expected.motor, abs=2e-9)


@pytest.mark.parametrize("name", SMOOTH)
def test_without_halving_the_error_is_of_second_order(monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.setattr(slow, "NEGLIGIBLE", math.inf)
    expected, _ = one_body(FORCES[name])
    errors = []
    for parts in (1, 2, 4, 8):
        t = PERIOD / parts * np.arange((T.size - 1) * parts + 1)
        found = run(make_axis("load", gap=0.0, **SOFT, effects=plugged(name)), np.interp(t, T, WAVES), PERIOD / parts)
        errors.append(np.abs(found.executed[::parts, 0] - expected).max())
    assert np.log2(np.divide(errors[:-1], errors[1:])) == pytest.approx([2.0] * 3, abs=0.15)


def test_friction_holds_until_a_force_exceeds_it() -> None:
    """1 mm/s of force against 0.05 mm of friction: the table leaves after 0.05 s, towards minus."""
    friction = effect("coulomb_friction", following_error_mm=0.05)
    axis = make_axis("load", gap=0.0, **SOFT, effects=[friction, *plugged("ramp")])
    found = run(axis, np.zeros(51))
    assert [one.kind for one in found.events] == ["slips"]
    assert found.events[0].t == pytest.approx(0.05, abs=1e-7)
    assert np.all(found.executed[: round(0.05 / PERIOD)] == 0.0)
    assert found.executed[-1, 0] < -1e-6


def test_an_integrator_begins_with_what_the_force_needs() -> None:
    """Steady motion through a force that does not change goes on as it began."""
    t = PERIOD * np.arange(101)
    axis = make_axis("load", gap=0.0, **SOFT, ki=2.0, effects=plugged("even"))
    command = replace(make_command(0.05 * t[:, None], PERIOD, moving=True), t=t)
    found = simulate(command, make_machine([axis], PERIOD))
    assert found.executed[:, 0] == pytest.approx(0.05 * t, abs=1e-12)
