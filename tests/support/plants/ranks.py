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
from tests.support.plants.responses import Added, Ground
from tests.support.plants.rivals import Rival, Scene, rivals

ALIKE = 50.0
"""Sum of squares, in noise floors, below which two names are alike: seven standard deviations of a number
that is known exactly, of which little is left where part of a record is held out."""

UNSEEN = 9.0
"""Below this b and c may take it within their prior: three standard errors."""

PRIOR = 0.02
"""Standard error of b and c."""

PROMISING = 0.35
"""Share of the signature that a linear answer may leave for the rival's plant to be tried."""

ROUNDS = 6

LIKE_CONSTANTS = ("servo_mismatch", "viscous_friction", "friction_asymmetry")
NOTHING = Rival("nothing", lambda plant, free: plant, (), lambda ground: [])

CONTAINED = {"coulomb_friction": ("stribeck_friction",), "viscous_friction": ("friction_asymmetry",)}
"""Names that hold another one as a special case: the simpler one is the right answer, and can be told."""


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
        self.nuisances = np.column_stack(
            [(self.observe(self.off(self.base, *shift)) - self.plain) for shift in ((1.0, 0.0), (0.0, 1.0))]
        )
        others = [observer.motion(each, i).table for i, each in enumerate(case.plants) if i != self.axis]
        self.ground = Ground(
            self.base,
            observer.motion(self.base, self.axis),
            case.track,
            self.axis,
            others[0] if others else None,
        )
        paces = [pace(case.track, axis) for axis in range(len(case.plants))]
        size = float(np.sqrt(np.mean(self.signature**2)) * np.mean(list(case.floors.values())))
        self.whole = float(self.signature @ self.signature)
        self.bare = self.left(self.nuisances, self.signature, np.zeros(2))[1]
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

    def columns(self, rival: Rival) -> tuple[list[Floats], Floats]:
        """What a rival's numbers add each, and the numbers at which nothing is added yet."""
        if rival.columns is not None:
            return [self.whiten(each) for each in rival.columns(self.ground)], np.zeros(len(rival.start))
        start = np.asarray(rival.start)
        begun = self.observe(rival.make(self.base, start)) - self.plain
        return [begun / start[0]], np.zeros(1)

    def whiten(self, added: Added) -> Floats:
        name = NAMES[self.axis]
        still = np.zeros(len(self.ground.motion.t))
        told = {key: added.get(key[2:], still) if key[0] == name else still for key in self.case.floors}
        return whitened(told, self.case.floors)

    def worth(self, rival: Rival) -> float:
        """What a linear answer may leave at most for a plant to be tried: less than b and c leave alone."""
        if rival.name in LIKE_CONSTANTS or rival is NOTHING:
            return PROMISING * self.whole
        return min(PROMISING * self.whole, 0.8 * self.bare)

    def against(self, rival: Rival) -> float:
        """What a rival leaves of the signature: by its linear answer, and by the plant where that is little.

        The plant's own steps keep the linear answer as their slope: one run a step.
        """
        columns, free = self.columns(rival)
        # Beside a free b and c, or what acts just as they do, their own freedom says nothing.
        nuisances = self.nuisances * (rival.name not in LIKE_CONSTANTS)
        slopes = np.column_stack([*columns, nuisances])
        off, rest, reached = np.zeros(2), self.signature, np.inf
        for step in range(ROUNDS):
            by, left = self.left(slopes, rest, off)
            if step == 0 and left > self.worth(rival):
                return left
            free, off = free + by[:-2], off + by[-2:]
            rest = self.signature - (self.observe(rival.make(self.off(self.base, *off), free)) - self.plain)
            now = float(rest @ rest + off @ off)
            if now > 0.9 * reached or now < 0.1 * ALIKE:
                return min(now, reached)
            reached = now
        return reached


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
        rests = found.setdefault(truth.name, {"nothing": signature.against(NOTHING)})
        for rival in rivals(signature.base, signature.scene):
            if rival.name == truth.name or rival.name in CONTAINED.get(truth.name, ()):
                continue
            if not names or rival.name in names:
                rests[rival.name] = min(signature.against(rival), rests.get(rival.name, np.inf))
    return found


def alike(apart: Mapping[str, float]) -> set[str]:
    """Names that a record cannot tell from the truth; "nothing" where it does not show.

    A name that takes no more than b and c take alone is not like the truth, only as good as none.
    """
    bare = apart.get("nothing", np.inf)
    names = {name for name, rest in apart.items() if rest < min(ALIKE, 0.5 * bare)}
    return names | ({"nothing"} if bare < UNSEEN else set())
