"""Residuals whose place is known: it comes first, with its number, and noise has none."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from itertools import product
from typing import NamedTuple

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from support.residuals import (
    MM,
    NOISE,
    UM,
    Moved,
    circles,
    decaying,
    irregular,
    moved,
    servo,
    sines,
    sweeps,
    to_and_fro,
    wander,
    white,
)

from ph_post.diagnose.residual_places import locate
from ph_post.identify.linear_drive import motion_of
from ph_post.types.diagnosis import ResidualPlace

Array = NDArray[np.float64]
MOTIONS = {"to and fro": cache(to_and_fro), "irregular": cache(irregular)}


def places(m: Moved, residual: Array, seed: int = 1) -> tuple[ResidualPlace, ...]:
    return locate(m.log, "X", residual + white(m.x.size, NOISE, seed), m.counted, NOISE, m.machine)


class Case(NamedTuple):
    by: str
    value: float
    residual: Callable[[Moved], Array]
    phrases: tuple[str, ...]
    share: float = 0.95
    rel: float = 0.03


CASES = {
    "behind reversals": Case(
        # 2 x 2 µm that die out: above the mean for about ln(...) time constants
        "reversal",
        0.045,
        lambda m: 2.0 * UM * decaying(m.v, 0.02),
        ("after X reversals", "equal in both directions", "independent of position"),
        share=0.85,
        rel=0.35,
    ),
    "by direction": Case(
        "direction",
        2.0 * UM,
        lambda m: 2.0 * UM * np.sign(m.v),
        ("µm while moving to plus, opposite to minus",),
    ),
    "by velocity": Case("speed", 1e-4, lambda m: 1e-4 * m.v, ("ms ahead of the model",)),
    "by velocity to minus": Case(
        "speed",
        1e-4,
        lambda m: np.where(m.v < 0.0, 1e-4 * m.v, 0.0),
        ("differently each way", "ms times it to plus, 0.1 ms to minus"),
    ),
    "by acceleration": Case("acceleration", 2e-5, lambda m: 2e-5 * m.a, ("20 µm per m/s²",)),
    "by position, periodic": Case(
        "period",
        5.0 * MM,
        lambda m: 2.0 * UM * np.sin(2.0 * np.pi * m.x / (5.0 * MM) + 1.0),
        ("repeats every ", "equal in both directions"),
        rel=0.001,
    ),
    "by position, linear": Case("position", 2e-4, lambda m: 2e-4 * (m.x - 0.02), ("of X: 0.2 µm per mm",)),
    "by position, local": Case(
        "position",
        10.0 * MM,
        lambda m: 2.0 * UM * np.exp(-0.5 * ((m.x - 10.0 * MM) / (2.0 * MM)) ** 2),
        ("where X is",),
        share=0.9,
        rel=0.1,
    ),
    "by the other axis": Case("position of Y", -2e-4, lambda m: -2e-4 * m.y, ("of Y: -0.2 µm per mm",)),
    "by time, a drift": Case(
        "time",
        8.0 * UM * (1.0 - math.exp(-3.0)),
        lambda m: 8.0 * UM * (1.0 - np.exp(-m.t / 20.0)),
        ("drift over time",),
        rel=0.03,
    ),
    "by time, once": Case(
        "time",
        20.0,
        lambda m: 3.0 * UM * ((m.t > 20.0) & (m.t < 22.0)) * np.sin(300.0 * m.t),
        ("from 19.7 s to 22.6",),
        rel=0.05,
    ),
    "always": Case("offset", -1.5 * UM, lambda m: np.full(m.x.size, -1.5 * UM), ("an offset of -1.5",)),
}


# The other way round in the other motion: so each of them, and each motion, is among one in two.
@pytest.mark.parametrize(
    ("name", "motion"), [*product(CASES, list(MOTIONS)[:1]), *product(reversed(CASES), list(MOTIONS)[1:])]
)
@pytest.mark.thinned(16)
def test_a_known_place_comes_first(name: str, motion: str) -> None:
    case, m = CASES[name], MOTIONS[motion]()
    first, *_ = places(m, case.residual(m))
    assert first.axis == "X"
    assert first.by == case.by
    assert first.value == pytest.approx(case.value, rel=case.rel)
    assert case.share <= first.share <= 1.0
    assert first.sentence.startswith(f"{100.0 * first.share:.0f} % of the excess ")
    for phrase in case.phrases:
        assert phrase in first.sentence


def test_the_share_of_two_causes_is_split_between_them() -> None:
    """3 µm by direction and 4 µm by a sine over position: mean squares 9 and 8."""
    m = to_and_fro()
    found = {place.by: place for place in places(m, 3.0 * UM * np.sign(m.v) + 4.0 * UM * np.sin(m.x / MM))}
    assert found["direction"].share == pytest.approx(9.0 / 17.0, abs=0.02)
    assert found["period"].share == pytest.approx(8.0 / 17.0, abs=0.02)
    assert found["period"].value == pytest.approx(2.0 * np.pi * MM, rel=2e-3)


@pytest.mark.slow
def test_reversals_that_differ_by_direction_and_place() -> None:
    m = to_and_fro()
    up = places(m, 2.0 * UM * np.where(m.v > 0.0, decaying(m.v, 0.02), 0.0))[0]
    assert up.by == "reversal"
    assert "µm towards plus, " in up.sentence
    n = irregular()
    grows = places(n, (n.x + 60.0 * MM) / (40.0 * MM) * 2.0 * UM * decaying(n.v, 0.02))
    (reversal,) = (place for place in grows if place.by == "reversal")
    assert "growing with the position" in reversal.sentence


def test_what_grows_with_the_feed_says_so() -> None:
    m = to_and_fro()
    feed = np.where(m.t < 30.0, 1.0, 3.0)
    first = places(m, feed * UM * decaying(m.v, 0.02))[0]
    assert first.by == "reversal"
    assert "as the feed to the power" in first.sentence
    assert "the same at all feeds" in places(m, 2.0 * UM * decaying(m.v, 0.02))[0].sentence


def test_the_direction_of_rotation() -> None:
    m = circles()
    angle = np.arctan2(m.y, m.x)
    clockwise = (m.t // 3.0).astype(np.int64) % 2 == 1
    first = places(m, 2.0 * UM * clockwise * np.sin(8.0 * angle))[0]
    assert first.by == "rotation"
    assert first.share > 0.95
    assert first.value == pytest.approx(math.hypot(math.sqrt(2.0) * UM, NOISE) / NOISE, rel=0.1)
    assert "where the path runs clockwise" in first.sentence


def test_what_comes_before_and_behind_reversals_alike_is_not_behind_them() -> None:
    m = to_and_fro()
    near = np.exp(-0.5 * (m.v / (5.0 * MM)) ** 2)
    assert all(place.by not in {"reversal", "travel"} for place in places(m, 5.0 * UM * near)[:1])


@pytest.mark.parametrize("motion", MOTIONS)
def test_noise_has_no_place(motion: str) -> None:
    m = MOTIONS[motion]()
    for seed in range(20):
        assert places(m, np.zeros(m.x.size), seed) == ()


@pytest.mark.parametrize("motion", MOTIONS)
def test_a_wander_that_goes_with_nothing_is_not_explained(motion: str) -> None:
    m = MOTIONS[motion]()
    for seed in range(6):
        found = places(m, wander(m.x.size, UM, seed, 1.0, 10.0), seed)
        assert all(place.share < 0.15 for place in found), [place.sentence for place in found]


def test_missing_samples_do_no_harm() -> None:
    m = to_and_fro()
    residual = 2.0 * UM * np.sign(m.v)
    residual[5000:9000] = np.nan
    residual[::101] = np.nan
    first = places(m, residual)[0]
    assert (first.by, first.share) == ("direction", pytest.approx(1.0, abs=0.01))


def test_an_axis_that_stands_still_can_still_drift() -> None:
    m = moved(np.zeros(20_000), sines(20.0, 3))
    (first, *_) = places(m, 5.0 * UM * m.t / 20.0)
    assert first.by == "time"
    assert first.value == pytest.approx(5.0 * UM, rel=0.03)


def test_the_screw_is_named_where_its_lead_is_known() -> None:
    m = to_and_fro()
    drive = m.machine.axes["X"]
    screw = replace(drive, gap=replace(drive.gap, travel_per_rad=10.0 * MM / (2.0 * np.pi)))
    machine = replace(m.machine, axes={**m.machine.axes, "X": screw})
    residual = 2.0 * UM * np.sin(2.0 * np.pi * m.x / (5.0 * MM)) + white(m.x.size, NOISE, 1)
    first = locate(m.log, "X", residual, m.counted, NOISE, machine)[0]
    assert "2 times a turn of the screw (lead 10 mm)" in first.sentence


def test_time_and_travel_since_a_reversal() -> None:
    """A command of straight strokes: the drive turns after the command does, and counts from there."""
    m = moved(sweeps(10.0, 0.02), np.zeros(10_000))
    motion = motion_of(m.log, m.machine, "X")
    x = servo(m.log.axes["X"].command)
    turns = np.flatnonzero(np.diff(np.sign(np.gradient(x))[100:])) + 101
    assert motion.stroke[-1] == turns.size
    assert np.isinf(motion.since[: turns[0] - 2]).all()
    at = turns[1] + 700
    assert motion.since[at] == pytest.approx(0.7, abs=3e-3)
    assert motion.travel[at] == pytest.approx(abs(x[at] - x[turns[1]]), abs=1e-6)
    assert motion.until[at] == pytest.approx((turns[2] - at) * 1e-3, abs=3e-3)
    assert motion.left[at] == pytest.approx(abs(x[turns[2]] - x[at]), abs=1e-6)


def test_the_way_round() -> None:
    m = circles(12.0)
    turn = motion_of(m.log, m.machine, "X").turn
    assert np.mean(turn[500:2900]) == pytest.approx(1.0, abs=0.01)
    assert np.mean(turn[3500:5900]) == pytest.approx(-1.0, abs=0.01)
    np.testing.assert_array_equal(turn, motion_of(m.log, m.machine, "Y").turn)
