"""What can be had at a reversal of an axis with its backlash inside the loop: worst case against time, by free shapes.

One axis turns back on a circle. The path slows down to a rest and goes on, which adds a time; to the exact inverse of
the drive without backlash a free shape is added, a cubic B-spline in time, or two smooth steps of the motor and a push.
The largest error over all pick-up rules (or one that is known), with backlash, gain and β up to 20 % off, is made small
by an evolution strategy. The machine is that of the tests, two masses in small steps, and none of it is the planner's.

    python -m tests.long.frontier --seed 16 --out tests/long/frontier.json
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from itertools import product
from pathlib import Path as File
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

sys.path.insert(0, str(File(__file__).parents[1]))

from support.two_masses import Body, table_of

Floats = NDArray[np.float64]

RULES = ("standstill", "momentum", "contact")
COEFFICIENTS = 22
"""Free numbers of the shape."""

STEPS = 8
"""Numbers of a shape of two steps and a push."""

TRIED = 2
"""Starts from which a search begins."""

OFF = 0.2
"""Part by which backlash, gain and β may be off."""

SHARES = 0.25, 0.95
"""Least and largest part of the added time that the ramps take."""


class Reversal(NamedTuple):
    """A reversal on a circle of the `radius` [m] at a `feed` [m/s], and the drive of the axis; limits in SI.

    `period` [s] is that of the rows of the command, `before` [s] the time of the motion ahead of the added time.
    """

    name: str
    body: Body
    radius: float
    feed: float
    limits: tuple[float, float, float]
    period: float
    before: float
    times: tuple[float, ...]


def drive(b: float, c: float, gap: float, eta: float, beta: float) -> Body:
    """An axis with its backlash inside a P loop."""
    return Body(feedback="load", b=b, c=c, ki=0.0, kd=0.0, gap=gap, eta=eta, beta=beta, rule=0)


CASES = (
    Reversal(
        name="circle, paper",
        body=drive(0.0005, 0.005, 0.125664 / 25.0, 0.35, 1.0),
        radius=0.25,
        feed=0.1308997,
        limits=(0.5, 5.0, 100.0),
        period=8e-3,
        before=0.7,
        times=(0.15, 0.3, 0.6, 1.2),
    ),
    Reversal(
        name="oval, mill",
        body=drive(0.000225, 0.030, 45e-6, 0.5, 2.0),
        radius=0.030,
        feed=0.020,
        limits=(0.1, 0.6, 15.0),
        period=2e-3,
        before=0.25,
        times=(0.08, 0.16, 0.32, 0.64),
    ),
)


def smooth(u: Floats) -> Floats:
    """A step from 0 to 1 with four derivatives that vanish at both ends."""
    u = np.clip(u, 0.0, 1.0)
    return np.asarray(u**5 * (126.0 + u * (-420.0 + u * (540.0 + u * (-315.0 + u * 70.0)))))


class Task:
    """The search for one shape: a reversal, the time that it may add [s], and what the axis may be."""

    def __init__(self, case: Reversal, added: float, rules: Sequence[str]) -> None:
        self.case, self.added, self.rules = case, added, rules

    def bodies(self, *, all_corners: bool) -> list[Body]:
        """Axes on which the shape is tried: the ones that decide, and those of all corners."""
        one, found = self.case.body, []
        corners = [*product((1.0 - OFF, 1.0 + OFF), repeat=3)]
        deciding = [(1.0, 1.0, 1.0), (1.0 - OFF, 1.0 + OFF, 1.0), (1.0 + OFF, 1.0 - OFF, 1.0)]
        for rule in self.rules:
            for gap, gain, beta in [*deciding, *(corners if all_corners else [])]:
                found.append(
                    one._replace(rule=RULES.index(rule), gap=gap * one.gap, eta=one.eta / gain, beta=beta * one.beta)
                )
        return found

    def motion(self, share: float) -> tuple[Floats, Floats, Floats, tuple[float, float]]:
        """Times, places of the axis and the exact lead [s, m, m]; and when the shape may begin and end."""
        case, ramp = self.case, share * self.added
        hold = self.added - ramp
        end = 2.0 * case.before + 2.0 * ramp + hold
        fine = case.period / 8.0
        t = np.arange(0.0, end, fine)
        slow = smooth((t - case.before) / ramp) - smooth((t - case.before - ramp - hold) / ramp)
        way = np.concatenate([[0.0], np.cumsum(0.5 * (2.0 - slow[1:] - slow[:-1]))]) * case.feed * fine
        way -= np.interp(case.before + ramp + 0.5 * hold, t, way)
        place = case.radius * (np.cos(way / case.radius) - 1.0)
        speed = np.gradient(place, fine, edge_order=2)
        lead = case.body.c * speed + case.body.b * np.gradient(speed, fine, edge_order=2)
        rows = slice(None, None, 8)
        return t[rows], place[rows], lead[rows], (case.before, case.before + 2.0 * ramp + hold)

    def command(self, x: Floats) -> tuple[Floats, Floats, Floats]:
        """Times, places of the axis, and the command with the shape of the numbers x."""
        low, high = SHARES
        share = low + (high - low) * 0.5 * (1.0 + np.tanh(x[0]))
        t, place, lead, (begin, end) = self.motion(float(share))
        if x.size == STEPS:
            return t, place, place + lead + self.steps(x, t, begin, end)
        reach = 0.5 * self.added
        knots = np.linspace(begin - 0.3 * reach, end + reach, COEFFICIENTS + 4)
        unit = 8.0 * self.case.body.eta * self.case.body.b * self.case.body.gap / self.added**2
        added = BSpline(knots, unit * x[1:], 3, extrapolate=False)(t)
        return t, place, place + lead + np.nan_to_num(added)

    def steps(self, x: Floats, t: Floats, begin: float, end: float) -> Floats:
        """Two steps of the motor's way through the backlash and a push, of seven numbers behind the first of x."""
        body, span = self.case.body, end - begin
        start, first, one, second, other, push, last = x[1:].tolist()
        starts = begin + 0.5 * span * (1.0 + np.tanh(start))
        first, second, last = (max(0.5 * span * np.exp(log), 8.0 * self.case.period) for log in (first, second, last))
        way = one * smooth((t - starts) / first) + other * smooth((t - starts - 0.8 * first) / second)
        rate = np.gradient(-body.gap * way, self.case.period)
        added = body.eta * body.b * (np.gradient(rate, self.case.period) + body.beta * rate)
        since = (t - starts - 0.8 * first - second) / last
        unit = 8.0 * body.eta * body.b * body.gap / self.added**2
        return np.asarray(added - push * unit * (smooth(4.0 * since) - smooth(4.0 * since - 3.0)))

    def errors(self, x: Floats, bodies: Sequence[Body]) -> Floats:
        """Largest distance from the path on each axis [m]."""
        _, place, command = self.command(x)
        slope = (place[1] - place[0]) / self.case.period
        normal = 1.0 + place / self.case.radius
        found = []
        for body in bodies:
            table = table_of(body, command, self.case.period, 1, float(place[0]), float(slope))
            found.append(float(np.abs((table - place) * normal).max()))
        return np.array(found)

    def over(self, x: Floats) -> float:
        """How far the command breaks a limit, as a part of it."""
        rows = self.command(x)[2]
        most = 0.0
        for order, limit in enumerate(self.case.limits, 1):
            rate = np.abs(np.diff(rows, order)).max() / self.case.period**order
            most = max(most, float(rate) / limit - 1.0)
        return most


def evolve(
    cost: Callable[[Floats], float], start: Floats, step: float, rounds: int, random: np.random.Generator
) -> tuple[Floats, float]:
    """Find a minimum by the evolution strategy with covariance (Hansen, The CMA Evolution Strategy, 2016)."""
    size = start.size
    many = 4 + int(3 * np.log(size))
    half = many // 2
    weights = np.log(half + 0.5) - np.log(np.arange(1, half + 1))
    weights /= weights.sum()
    mass = 1.0 / (weights**2).sum()
    fade_path, fade_step = 4.0 / (size + 4.0), (mass + 2.0) / (size + mass + 5.0)
    one = 2.0 / ((size + 1.3) ** 2 + mass)
    rest = min(1.0 - one, 2.0 * (mass - 2.0 + 1.0 / mass) / ((size + 2.0) ** 2 + mass))
    damping = 1.0 + fade_step + 2.0 * max(0.0, np.sqrt((mass - 1.0) / (size + 1.0)) - 1.0)
    expected = np.sqrt(size) * (1.0 - 1.0 / (4.0 * size) + 1.0 / (21.0 * size**2))
    mean, covariance, path, steps = start.copy(), np.eye(size), np.zeros(size), np.zeros(size)
    best, least = start.copy(), cost(start)
    for _ in range(rounds):
        values, vectors = np.linalg.eigh(covariance)
        root = np.sqrt(np.maximum(values, 1e-20))
        drawn = (vectors * root) @ random.standard_normal((size, many))
        tried = mean[:, None] + step * drawn
        costs = np.array([cost(one_try) for one_try in tried.T])
        order = np.argsort(costs)[:half]
        if costs[order[0]] < least:
            best, least = tried[:, order[0]].copy(), float(costs[order[0]])
        move = drawn[:, order] @ weights
        mean = mean + step * move
        steps = (1.0 - fade_step) * steps + np.sqrt(fade_step * (2.0 - fade_step) * mass) * (
            vectors @ ((vectors.T @ move) / root)
        )
        near = np.linalg.norm(steps) < (1.4 + 2.0 / (size + 1.0)) * expected
        path = (1.0 - fade_path) * path + near * np.sqrt(fade_path * (2.0 - fade_path) * mass) * move
        covariance = (1.0 - one - rest) * covariance + one * np.outer(path, path)
        covariance += rest * (drawn[:, order] * weights) @ drawn[:, order].T
        step *= float(np.exp(fade_step / damping * (np.linalg.norm(steps) / expected - 1.0)))
    return best, least


def starts(task: Task) -> list[Floats]:
    """Where searches begin: a rest alone, and crossings of 0.85 of the backlash early and all through the rest."""
    found = [np.zeros(COEFFICIENTS + 1)]
    body = task.case.body
    knots = np.linspace(0.0, 1.0, COEFFICIENTS + 4)
    u = np.linspace(knots[3], knots[-4], 400)
    for low, high in ((0.2, 0.5), (0.2, 0.75)):
        way = -0.85 * body.gap * smooth((u - low) / (high - low))
        span = task.added * 2.0
        rate = np.gradient(way, u) / span
        wanted = body.eta * body.b * (np.gradient(rate, u) / span + body.beta * rate)
        unit = 8.0 * body.eta * body.b * body.gap / task.added**2
        rows = BSpline.design_matrix(u, knots, 3).toarray()
        found.append(np.append(0.0, np.linalg.lstsq(rows, wanted / unit, rcond=None)[0]))
    return found


def step_starts() -> list[Floats]:
    """Where searches by steps begin."""
    return [
        np.array([share, start, -0.5, one, -0.5, other, push, 0.0])
        for share in (-0.7, 0.3)
        for start in (-0.6, -0.2)
        for one, other in ((0.5, 0.3), (0.8, 0.1), (0.0, 0.0))
        for push in (0.0, 1.0)
    ]


def searched(task: Task, rounds: int, seed: int, *, by_steps: bool = False) -> tuple[Floats, float]:
    """Return the best shape and its largest error on all axes [m], free or by two steps and a push."""
    random = np.random.default_rng(seed)
    deciding, corners = task.bodies(all_corners=False), task.bodies(all_corners=True)

    def cost(x: Floats) -> float:
        over = task.over(x)
        most = float(task.errors(x, deciding).max())
        return most * (1.0 + 10.0 * max(over, 0.0))

    promising = sorted(step_starts() if by_steps else starts(task), key=cost)[:TRIED]
    tries = [evolve(cost, start, 0.4, rounds, random) for start in promising]
    best = min(tries, key=lambda one: one[1])[0]
    best, _ = evolve(
        lambda x: float(task.errors(x, corners).max()) * (1.0 + 10.0 * max(task.over(x), 0.0)),
        best,
        0.05,
        rounds // 4,
        random,
    )
    return best, float(task.errors(best, corners).max())


def plain(case: Reversal, rules: Sequence[str]) -> tuple[float, float]:
    """Largest error without and with the lead, at full feed [m]."""
    task = Task(case, 1e-3, rules)
    t = np.arange(0.0, 2.0 * case.before, case.period)
    way = (t - case.before) * case.feed / case.radius
    place = case.radius * (np.cos(way) - 1.0)
    turn = case.feed / case.radius
    speed, bend = -case.feed * np.sin(way), -case.radius * turn**2 * np.cos(way)
    found = []
    for led in (0.0, 1.0):
        command = place + led * (case.body.c * speed + case.body.b * bend)
        most = 0.0
        for body in task.bodies(all_corners=True):
            start = float(place[0] - (1.0 - led) * body.c * speed[0])
            table = table_of(body, command, case.period, 1, start, float(speed[0]))
            most = max(most, float(np.abs((table - place)[t.size // 8 :] * np.cos(way)[t.size // 8 :]).max()))
        found.append(most)
    return found[0], found[1]


def hunting(case: Reversal, rule: str) -> float:
    """Amplitude [m] with which a table at rest, a hundredth of the backlash off, hunts after a while by itself."""
    body = case.body._replace(rule=RULES.index(rule))
    t = np.arange(0.0, 180.0 * body.b**0.5, case.period)
    last = table_of(body, np.zeros(t.size), case.period, 1, 0.01 * body.gap)[3 * t.size // 4 :]
    return float(0.5 * (last.max() - last.min()))


def rows_of(case: Reversal, seed: int, rounds: int) -> Iterator[dict[str, Any]]:
    """Summaries of a case: what it is without a shape, at rest, and at every time, by all rules and by one."""
    without, led = plain(case, RULES)
    rest = {rule: round(1e6 * hunting(case, rule), 3) for rule in RULES}
    yield {"case": case.name, "untouched_um": 1e6 * without, "led_um": 1e6 * led, "hunting_um": rest}
    known = case.times[2]
    tasks = [(added, RULES, False) for added in case.times] + [(known, (rule,), False) for rule in RULES]
    for added, rules, by_steps in [*tasks, *((added, RULES, True) for added in case.times[1:3])]:
        task = Task(case, added, rules)
        shape, most = searched(task, rounds // 2 if by_steps else rounds, seed, by_steps=by_steps)
        yield {
            "case": case.name,
            "added_s": added,
            "rules": list(rules),
            "by_steps": by_steps,
            "worst_um": round(1e6 * most, 4),
            "over": round(task.over(shape), 4),
            "shape": np.round(shape, 4).tolist(),
        }


def main() -> None:
    """Search all cases, or one, and write the summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=16)
    parser.add_argument("--rounds", type=int, default=80)
    parser.add_argument("--case", type=int, default=None, help="number of a case, in place of all")
    parser.add_argument("--out", type=File, required=True)
    chosen = parser.parse_args()
    rows: list[dict[str, Any]] = []
    for number, case in enumerate(CASES):
        if chosen.case in (None, number):
            for row in rows_of(case, chosen.seed, chosen.rounds):
                rows.append(row)
                summary = {"seed": chosen.seed, "rounds": chosen.rounds, "rows": rows}
                chosen.out.write_text(json.dumps(summary, indent=1) + "\n")


if __name__ == "__main__":
    main()
