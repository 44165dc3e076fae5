"""What a test program does, found by the little interpreter of these tests: motions, reversals, circles."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from support.interpreter import Move, Run, run

CIRCLE_POINTS = 360


@dataclass(frozen=True)
class Circle:
    """One arc: plane word, sense (+1 as G3), radius [mm], feed [mm/min], turns."""

    axes: tuple[int, int]
    sense: int
    radius: float
    feed: float


class Drive:
    """A program interpreted from where it says that it begins."""

    def __init__(self, text: str, start: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> None:
        self.run: Run = run(text, start=start)
        self.start = np.array(start)
        self.moves: list[Move] = self.run.moves
        self.points = np.concatenate([one.points(CIRCLE_POINTS if one.center is not None else 1) for one in self.moves])

    @property
    def end(self) -> np.ndarray:
        return self.moves[-1].end

    @property
    def circles(self) -> list[Circle]:
        return [
            Circle(
                tuple(sorted(one.axes)),
                (1 if one.word == "G3" else -1),
                float(np.linalg.norm(one.start[list(one.axes)] - one.center)),
                one.feed,
            )
            for one in self.moves
            if one.center is not None
        ]

    @property
    def seconds(self) -> float:
        return sum(one.duration for one in self.moves)

    def places(self, axis: int) -> list[float]:
        """Where an axis turns round [mm], in order."""
        steps = np.diff(self.points[:, axis])
        rows = np.flatnonzero(np.abs(steps) > 1e-9)
        turns = np.flatnonzero(np.diff(np.sign(steps[rows])) != 0.0)
        return [float(self.points[rows[k] + 1, axis]) for k in turns]

    def strokes(self, axis: int) -> list[tuple[float, float]]:
        """Straight moves of this axis alone: signed length [mm] and feed [mm/min]."""
        alone = [one for one in self.moves if one.word == "G1" and one.center is None and self._only(one, axis)]
        return [(float(one.end[axis] - one.start[axis]), one.feed) for one in alone]

    def rests(self) -> list[float]:
        """Dwells [s]."""
        return [one.duration for one in self.moves if one.word == "G4"]

    def _only(self, one: Move, axis: int) -> bool:
        moved = np.abs(one.end - one.start) > 1e-9
        return bool(moved[axis]) and moved.sum() == 1
