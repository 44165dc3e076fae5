"""Which names a record cannot tell apart, by the plants' own sensitivities.

A hidden effect leaves a signature in the recorded channels. Each other name is given its free numbers, the
axis' b and c their 2 % of freedom and every position channel its zero. What they cannot take of it, squared
and in noise floors, is what tells them apart. Below :data:`ALIKE` no honest answer names just one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from tests.support.plants.axis import Hidden, Plant
from tests.support.plants.cases import Case, Truth
from tests.support.plants.courses import pace
from tests.support.plants.readings import NAMES, Floats, Observer, Readings
from tests.support.plants.rivals import Rival, Scene, rivals

ALIKE = 50.0
"""Sum of squares, in noise floors, below which two names are alike: seven standard deviations of a number
that is known exactly, of which little is left where part of a record is held out."""

PRIOR = 0.02
"""Standard error of b and c."""

PROMISING = 0.6
"""Share of the signature that may be left after a straight line's guess for a rival to be tried further."""

ROUNDS = 5
STEP = 0.05


def without(plant: Plant, base: Plant, name: str) -> Plant:
    """A plant with one of its effects taken away."""
    if name == "backlash":
        return replace(plant, gap=base.gap)
    if name == "servo_mismatch":
        return replace(plant, b=base.b, c=base.c)
    if name == "engagement_impact":
        return replace(plant, kept=0.0)
    return replace(plant, effects=tuple(each for each in plant.effects if each.name != name))


class _Signature:
    """One effect of a case against all that it could be taken for."""

    def __init__(self, case: Case, truth: Truth, observer: Observer) -> None:
        self.case, self.observer, self.axis = case, observer, NAMES.index(truth.axis)
        self.base = without(case.plants[self.axis], case.bases[self.axis], truth.name)
        # Of an unknown side the reading may be the motor's; the table's is what the names are tried on.
        self.wanted = list(case.floors)
        self.plain = self.observe(self.base)
        self.signature = self.observe(case.plants[self.axis]) - self.plain
        self.nuisances = np.column_stack([
            (self.observe(self.off(self.base, *shift)) - self.plain) for shift in ((1.0, 0.0), (0.0, 1.0))
        ])  # fmt: skip
        paces = [pace(case.track, axis) for axis in range(len(case.plants))]
        size = float(np.sqrt(np.mean(self.signature**2)) * np.mean(list(case.floors.values())))
        self.scene = Scene(
            size=max(size, 1e-8),
            pace=paces[self.axis],
            other=paces[1 - self.axis] if len(paces) > 1 else None,
            duration=case.track.end,
            peak=float(np.max(np.abs(observer.motion(self.base, self.axis).drive))),
            reading_seen=any(name.endswith("_act") for name in self.wanted),
            truth=self.hidden(truth),
        )

    def hidden(self, truth: Truth) -> Hidden | None:
        return self.case.plants[self.axis].effect(truth.name)

    @staticmethod
    def off(plant: Plant, b: float, c: float) -> Plant:
        """A plant whose b and c are so many standard errors away."""
        return replace(plant, b=plant.b * (1.0 + PRIOR * b), c=plant.c * (1.0 + PRIOR * c))

    def observe(self, plant: Plant) -> Floats:
        """All recorded channels in noise floors, those of position about their mean."""
        plants = list(self.case.plants)
        plants[self.axis] = plant
        return whitened(self.observer(plants), self.case.floors)

    def left(self, columns: Floats, wanted: Floats, at: Floats) -> tuple[Floats, float]:
        """Least squares with the prior's two rows below: a step, and the sum of squares that is left."""
        free = columns.shape[1] - 2
        tail = np.hstack([np.zeros((2, free)), np.eye(2)])
        target = np.concatenate([wanted, -at])
        step, *_ = np.linalg.lstsq(np.vstack([columns, tail]), target, rcond=1e-12)
        rest = target - np.vstack([columns, tail]) @ step
        return step, float(rest @ rest)

    def nothing(self) -> float:
        return self.left(self.nuisances, self.signature, np.zeros(2))[1]

    def against(self, rival: Rival) -> float:
        """What a rival leaves of the signature: Gauss-Newton, as far as it is worth the while."""
        start = np.asarray(rival.start)
        begun = self.observe(rival.make(self.base, start)) - self.plain
        columns = [begun / start[0]] if len(start) == 1 else self.slopes(rival, start, begun, np.zeros(2))
        offset = np.zeros_like(begun) if len(start) == 1 else begun - np.column_stack(columns) @ start
        whole = float(self.signature @ self.signature)
        step, best = self.left(
            np.column_stack([*columns, self.nuisances]), self.signature - offset, np.zeros(2)
        )
        if best > PROMISING * whole:
            return best
        free, off = step[:-2], step[-2:]
        reached = np.inf
        for _ in range(ROUNDS):
            model = self.observe(rival.make(self.off(self.base, *off), free)) - self.plain
            rest = self.signature - model
            now = float(rest @ rest + off @ off)
            if now > 0.8 * reached:
                return min(now, reached)
            reached = now
            if now < 0.1 * ALIKE:
                return now
            columns = self.slopes(rival, free, model, off)
            step, _ = self.left(np.column_stack([*columns, self.nuisances]), rest, off)
            free, off = free + step[:-2], off + step[-2:]
        return reached

    def slopes(self, rival: Rival, free: Floats, model: Floats, off: Floats) -> list[Floats]:
        found = []
        for k in range(len(free)):
            moved = free.copy()
            by = STEP * max(abs(free[k]), 0.2)
            moved[k] += by
            plant = rival.make(self.off(self.base, *off), moved)
            found.append((self.observe(plant) - self.plain - model) / by)
        return found


def whitened(readings: Readings, floors: Mapping[str, float]) -> Floats:
    parts = []
    for name, floor in floors.items():
        values = readings[name]
        parts.append((values if name.endswith("_force") else values - np.mean(values)) / floor)
    return np.concatenate(parts)


def tell_apart(case: Case, names: Sequence[str] = ()) -> dict[str, dict[str, float]]:
    """By hidden effect and by other name: the sum of squares, in noise floors, that tells them apart.

    "nothing" stands for the axis' constants and zeros alone. Names that no rival of this axis has are absent:
    they cannot be meant.
    """
    found: dict[str, dict[str, float]] = {}
    for truth in case.truths:
        observer = Observer(case.track)
        signature = _Signature(case, truth, observer)
        rests = found.setdefault(truth.name, {"nothing": signature.nothing()})
        for rival in rivals(signature.base, signature.scene):
            if rival.name != truth.name and (not names or rival.name in names):
                rests[rival.name] = min(signature.against(rival), rests.get(rival.name, np.inf))
    return found


def alike(apart: Mapping[str, float]) -> set[str]:
    """Names that a record cannot tell from the truth."""
    return {name for name, rest in apart.items() if rest < ALIKE}


def distinguishable(case: Case) -> set[str]:
    """Names that look like one of the hidden effects; empty where each can be told."""
    return set().union(*(alike(apart) for apart in tell_apart(case).values()))
