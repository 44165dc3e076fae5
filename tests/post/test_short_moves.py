"""Feeds that a person reads and moves that a machine can make, beside the program without any of that."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import ph_post as ph
from ph_post.api import path_compensation
from ph_post.post import moves
from tests.support import interpreter
from tests.support.ideal_play import distances

GOLDEN = Path(__file__).resolve().parents[1] / "golden"


def written(case: str, **how: object) -> interpreter.Run:
    folder = GOLDEN / case
    own = folder / "machine.toml"
    machine = own if own.exists() else GOLDEN / "machine.toml"
    return interpreter.run(ph.compensate(folder / "path.json", machine, **how).program().decode())


def cuts(run: interpreter.Run) -> list[interpreter.Move]:
    return [move for move in run.moves if move.word not in ("G0", "G4")]


def sampled(run: interpreter.Run) -> np.ndarray:
    return np.concatenate([move.points(max(2, int(move.length / 5e-3)))[1:] for move in cuts(run)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "how"),
    [
        ("ring_jogs", {"strategy": "takeup", "max_slowdown": 0.5, "block_time": 1e-3}),
        ("slot_linuxcnc", {"strategy": "suppress", "block_time": 1e-3}),
    ],
)
@pytest.mark.thinned(4)
def test_path_and_time_are_those_of_the_unrounded_program(
    monkeypatch: pytest.MonkeyPatch, case: str, how: dict[str, object]
) -> None:
    # With stops, as for languages whose programs are not changed by lines.
    monkeypatch.setattr(path_compensation, "crosses_on_the_fly", lambda *_: False)
    rounded = written(case, **how)
    monkeypatch.setattr(moves, "FEED_DIGITS", 12)
    monkeypatch.setattr(moves, "LEAST_MOVE", 0.0)
    exact = written(case, **how)
    assert min(move.length for move in cuts(exact)) < 1e-3
    assert min(move.length for move in cuts(rounded)) > 0.9e-3
    feeds = {move.feed for move in cuts(rounded)}
    assert all(feed is not None and feed == float(f"{feed:.5e}") for feed in feeds)
    assert min(feeds) > 2.0 * min(move.feed for move in cuts(exact))
    a, b = (sum(move.duration for move in run.moves) for run in (exact, rounded))
    assert b == pytest.approx(a, rel=2e-4)
    there, back = sampled(exact), sampled(rounded)
    # Where a closed path ends beside its approach, the nearest sample may be one of the approach.
    assert max(distances(back, there).max(), distances(there, back).max()) < 3e-4
