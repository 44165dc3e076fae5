"""What a beam at constant power (M3) burns in the corners of random contours, by a model that shares no code.

Grbl's published rule gives the speeds; the motor is followed in steps of a tenth of a millisecond, and the table behind
it with its backlash. What a place gets is the time for which the table is near it with the beam on.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial import cKDTree
from support import firmware_planners as grbl
from support.editing import compensate, with_edits
from support.reference_player import BEGINS, Move, interpret, play

from ph_post.dialects.reading import read_as
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.edit.edits import EditOptions
from ph_post.edit.offset_edits import plan_offsets
from ph_post.edit.preconditions import reckoned_feeds
from ph_post.simulate.controllers.run import PlannedRun
from ph_post.types import Machine

GAP = 0.06
"""Backlash of X and Y [mm]."""

RATE, PUSH, DEVIATION = (40.0, 40.0, 10.0), (250.0, 200.0, 100.0), 0.01
"""Limits of the stepper router [mm/s, mm/s²], and Grbl's own $11 [mm]."""

STEP, WAY = 1e-4, 2e-3
"""Of time [s], and of the way at full speed [mm], the longer of both."""

ADDED, LONGER = 0.5, 2.0
"""What a crossing may add within one backlash of a corner, beside what a corner gets in which the path stops; and how
many times as long it may be burnt."""


DULL = 2.5
"""How many times as long a dull corner may be burnt, in which the joints of a crossing slow the path down."""


def machine() -> Machine:
    found = replace(read_machine("stepper"), dialect="grbl")
    gaps = {name: replace(axis.gap, lost_motion=GAP * 1e-3) for name, axis in found.axes.items()}
    return replace(found, axes={name: replace(axis, gap=gaps[name]) for name, axis in found.axes.items()})


def contours(seed: int, feed: float) -> str:
    """Closed contours of lines and arcs, long and short, sharp and dull, and a line there and back."""
    rng = np.random.default_rng(seed)
    lines = ["G21 G90", "M3 S0"]
    for n in range(3):
        centre = np.array([20.0 + 40.0 * n, 30.0])
        count = int(rng.integers(3, 9))
        angles = np.sort(rng.uniform(0.0, math.tau, count))
        places = centre + rng.uniform(1.0, 12.0, count)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
        places = np.vstack([places, places[0]]).round(3)
        lines += [f"G0 X{places[0, 0]} Y{places[0, 1]}"]
        lines += ["G1 S800"]
        for one, (x, y) in pairwise(places):
            bent, far = rng.random() < 0.3, math.dist(one, (x, y))
            arc = f" R{far * rng.uniform(0.55, 3.0):.4f}" if bent and far > 0.5 else ""
            lines += [f"G{rng.integers(2, 4) if arc else 1} X{x} Y{y}{arc} F{feed:g}"]
        lines += ["G1 S0"]
    x, y, far = *rng.uniform(0.0, 60.0, 2).round(3), rng.uniform(-9.0, 9.0, 2).round(3)
    lines += [f"G0 X{x} Y{y}", f"G1 X{x + far[0]:.3f} Y{y + far[1]:.3f} S800 F{feed:g}", f"G1 X{x} Y{y}"]
    return "\n".join([*lines, "M5", "G0 X0 Y0", "M2", ""])


def facets(seed: int, feed: float) -> str:
    """Closed outlines of lines, each of which turns by the same 8 to 50 degrees."""
    rng = np.random.default_rng(seed)
    lines = ["G21 G90", "M3 S0"]
    for n in range(3):
        centre, size, sides = np.array([20.0 + 40.0 * n, 30.0]), rng.uniform(3.0, 12.0, 2), int(rng.integers(7, 46))
        angles = np.linspace(0.0, math.tau, sides + 1) + rng.uniform(0.0, math.tau)
        places = (centre + size * np.stack([np.cos(angles), np.sin(angles)], axis=1)).round(3)
        lines += [f"G0 X{places[0, 0]} Y{places[0, 1]}", "G1 S800"]
        lines += [f"G1 X{x:.3f} Y{y:.3f} F{feed:g}" for x, y in places[1:]]
        lines += ["G1 S0"]
    return "\n".join([*lines, "M5", "G0 X0 Y0", "M2", ""])


def burnt(text: str) -> tuple[list[Move], np.ndarray, np.ndarray]:
    """Motions with the beam on; where the motor is while it is on, and how long it is there [s]."""
    settings = grbl.Settings(RATE, PUSH, deviation=DEVIATION, buffer=15)
    lit, motor, lasts = [], [], []
    power, words = 0.0, {}
    for number, line in enumerate(text.splitlines(), 1):
        found = re.search(r"S([\d.]+)", re.sub(r"\(.*", "", line))
        power = words[number] = float(found[1]) if found else power
    moves = [move for move in interpret(text, BEGINS[0]) if move.length > 0.0]
    chords = [(move, *ends) for move in moves for ends in pairwise(move.at(np.linspace(0.0, 1.0, _chords(move) + 1)))]
    blocks = [
        grbl.block(start, end, 1e6 if move.mode == 0 else move.feed / 60.0, settings) for move, start, end in chords
    ]
    speeds = [float(one) for one in grbl.entry_speeds(blocks, settings)]
    for (move, start, end), block, first, last in zip(chords, blocks, speeds, [*speeds[1:], 0.0], strict=True):
        way, push = float(block.length), float(block.acceleration)
        top = min(float(block.speed), math.sqrt((first**2 + last**2) / 2.0 + push * way))
        times = [(top - first) / push, (way - (2.0 * top**2 - first**2 - last**2) / 2.0 / push) / top]
        times.append((top - last) / push)
        whole = sum(times)
        t = np.linspace(0.0, whole, max(2, math.ceil(whole / max(STEP, WAY / top))) + 1)[1:]
        up, flat = np.minimum(t, times[0]), np.clip(t - times[0], 0.0, times[1])
        down = np.clip(t - times[0] - times[1], 0.0, None)
        s = first * up + push * up**2 / 2.0 + top * flat + top * down - push * down**2 / 2.0
        motor.append(start + np.clip(s / way, 0.0, 1.0)[:, None] * (end - start))
        on = move.mode > 0 and words[move.line] > 0.0
        lasts.append(np.full(t.size, whole / t.size if on else 0.0))
        if on and (not lit or lit[-1] is not move):
            lit.append(move)
    return lit, np.concatenate(motor), np.concatenate(lasts)


def _chords(move: Move) -> int:
    if move.mode < 2:
        return 1
    return grbl.grbl_chords(float(np.linalg.norm(move.start[:2] - np.array(move.center))), abs(move.sweep), "0.002")


def near(places: list[np.ndarray], points: np.ndarray, lasts: np.ndarray) -> list[float]:
    """How long the points are within one backlash of each place [s]."""
    lit = lasts > 0.0
    found = cKDTree(points[lit]).query_ball_point(places, GAP) if places else []
    return [float(lasts[lit][some].sum()) for some in found]


def stopped(one: Move, other: Move) -> float:
    """How long a machine without backlash is within one backlash of a corner in which it stops [s]."""
    whole = 0.0
    ends = ((one.at(np.array([1.0 - 1e-4, 1.0])), one.feed), (other.at(np.array([0.0, 1e-4])), other.feed))
    for way, feed in ((np.diff(places, axis=0)[0], rate / 60.0) for places, rate in ends):
        unit = np.abs(way) / np.linalg.norm(way)
        push = min(most / part for most, part in zip(PUSH, unit, strict=True) if part > 0.0)
        ramp = feed**2 / (2.0 * push)
        whole += math.sqrt(2.0 * GAP / push) if ramp > GAP else feed / push + (GAP - ramp) / feed
    return whole


def corners(text: str, made: str) -> Iterator[tuple[Move, Move, float, float]]:
    """Lines before and behind each corner with the beam on, and how long it is burnt before and after [s]."""
    path, motor, lasts = burnt(text)
    _, driven, stays = burnt(made)
    table = np.stack([*(play(driven[:, axis], GAP, 0.0) for axis in (0, 1)), driven[:, 2]], axis=1)
    met = [(one, other) for one, other in pairwise(path) if np.array_equal(one.end, other.start)]
    places = [one.end for one, _ in met]
    for (one, other), before, after in zip(met, near(places, motor, lasts), near(places, table, stays), strict=True):
        yield one, other, before, after


@pytest.mark.parametrize("feed", [30.0, 100.0, 300.0, 800.0, 1500.0, 2400.0])
@pytest.mark.thinned(4)
def test_no_corner_is_burnt_much_longer(feed: float) -> None:
    left = 0
    for seed in range(6):
        text = contours(seed, feed)
        found = compensate(text.encode(), machine(), dialect="grbl", max_slowdown=0.5)
        left += any("would burn a dot" in one for one in found.edits.warnings)
        for one, other, before, after in corners(text, found.text.decode()):
            assert after <= LONGER * before
            assert after - before <= ADDED * stopped(one, other)
            if feed == 30.0:
                assert after < 1.135 * before
    assert left <= 1


@pytest.mark.parametrize("feed", [300.0, 1000.0, 2400.0])
def test_outlines_of_facets_are_compensated_whole_and_burnt_little(feed: float) -> None:
    """The path is slow in every dull corner: a crossing that is as slow there is no reason to leave the cut."""
    for seed in range(4, 7):
        text = facets(seed, feed)
        found = compensate(text.encode(), replace(machine(), tool="laser"), dialect="grbl", max_slowdown=0.5)
        assert not any("would burn a dot" in one for one in found.edits.warnings)
        for one, other, before, after in corners(text, found.text.decode()):
            assert after <= DULL * before
            assert after - before <= ADDED * stopped(one, other)


@pytest.mark.parametrize("feed", [1000.0, 2400.0])
def test_tips_in_which_both_axes_turn_are_crossed_and_burnt_little(feed: float) -> None:
    """Both motors cross at once, from rest and on into the cut, as fast as they get on their way."""
    back = ""
    for n, (x, y) in enumerate([(0.98, 0.2), (0.2, 0.98), (0.9, 0.43), (0.99, 0.1)], 1):
        there, ends = f"G1 X{20 * n + 7} Y17 F{feed:g}\n", f"G1 X{20 * n + 7 - 9.8 * x:.3f} Y{17 - 9.8 * y:.3f}\n"
        back += f"G0 X{20 * n} Y10\nG1 S800\n{there}{ends}G1 S0\n"
    text = f"G21 G90\nM3 S0\n{back}M5\nG0 X0 Y0\nM2\n"
    found = compensate(text.encode(), replace(machine(), tool="laser"), dialect="grbl", max_slowdown=0.5)
    assert not any("would burn a dot" in one for one in found.edits.warnings)
    met = list(corners(text, found.text.decode()))
    assert len(met) == 4
    for one, other, before, after in met:
        assert before < after <= LONGER * before
        assert after - before <= ADDED * stopped(one, other)


@pytest.mark.parametrize("feed", [300.0, 2400.0])
def test_s_that_is_said_again_in_each_line_stops_nothing(feed: float) -> None:
    """Grbl waits where S changes alone; programs that say it in each line are burnt, and last, as those that do not."""
    text = facets(4, feed)
    again = re.sub(r"^(G1 X.*)(?<!S800)$", r"\1 S800", text, flags=re.MULTILINE)
    assert again.count("S800") > 2 * text.count("S800")
    times = [PlannedRun(read_as("grbl", program.encode(), "a"), machine()).time for program in (text, again)]
    assert times[0] == times[1]
    one, other = (
        compensate(program.encode(), replace(machine(), tool="laser"), dialect="grbl", max_slowdown=0.5)
        for program in (text, again)
    )
    assert not any("would burn a dot" in said for said in other.edits.warnings)
    assert len(other.edits.crossings) == len(one.edits.crossings) > 9
    bare = [re.sub(r"^\(.*\n| ?S800", "", made.text.decode(), flags=re.MULTILINE) for made in (one, other)]
    assert bare[0] == bare[1]
    for before, after in zip(corners(text, one.text.decode()), corners(again, other.text.decode()), strict=True):
        assert after[3] == pytest.approx(before[3])


@pytest.mark.parametrize("feed", [30.0, 300.0, 2400.0])
def test_no_corner_is_burnt_much_longer_at_whatever_feed_is_in_force(feed: float) -> None:
    made, beside = 0, f"G21 G90\nF{feed:g}\n"
    for seed in range(2):
        text = re.sub(r" F\d+", "", contours(seed, feed))
        program = read_as("grbl", text.encode(), "part.nc")
        reckoned = reckoned_feeds(program, machine())
        edits = plan_offsets(reckoned, machine(), find_dialect("grbl"), EditOptions(max_slowdown=0.5))
        written = with_edits(program, edits, machine(), "grbl").text.decode()
        assert "F" not in re.sub(r"\(.*", "", written)
        made += len(edits.crossings)
        for _, _, before, after in corners(beside + text, beside + written):
            assert after <= LONGER * before
    assert made > 4


def test_the_time_in_a_corner_in_which_the_path_stops() -> None:
    lines = interpret("G21 G90\nG0 X0 Y0\nG1 X10 Y0 F2400\nG1 X20 Y0\n", BEGINS[0])[-2:]
    assert stopped(*lines) == pytest.approx(0.044, abs=0.0005)
