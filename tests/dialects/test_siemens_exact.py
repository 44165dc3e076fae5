"""Every shipped path on every shipped machine: POLY is the path to 1e-9 mm, FPO the planned feed to 0.1 %."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.amount import sample
from support.exact_paths import Piece, exact_pieces
from support.planned import Planned
from support.siemens_exact import Cut, Walk, cuts_of, follow

from ph_post.analysis.path_analysis import analyse
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.dialects.reading import read_as
from ph_post.dialects.siemens.dialect import DIALECT
from ph_post.drive.machinefile import read_machine
from ph_post.files.path import read_path
from ph_post.gcode.curves import curves_of
from ph_post.geometry.track import Track
from ph_post.post.moves import read_jogs
from ph_post.post.program import make_program
from ph_post.types import Plan
from ph_post.units import MM

ROOT = Path(__file__).resolve().parents[2]
PATHS = sorted((ROOT / "paths").glob("*.json"))
MACHINES = sorted((ROOT / "samples" / "machines").glob("*.toml"))
STRATEGIES = ("none", "suppress", "linear", "dwell", "auto")

FAST = {
    ("butterfly", "paper", "none"),
    ("oval", "mill", "dwell"),
    ("spatial", "router", "suppress"),
    ("figure1", "stepper", "linear"),
    ("circle", "paper", "dwell"),
    ("pocket", "old_mill", "linear"),
    ("inflection", "router", "none"),
}
"""Tried whenever tests run: each path once, the butterfly where ramps end just beside joints of it."""

MOVED = {path: set(read_path(str(path)).axes) for path in PATHS}
DRIVEN = {machine: set(read_machine(str(machine)).axes) for machine in MACHINES}
PAIRS = [(path, machine) for path in PATHS for machine in MACHINES if MOVED[path] <= DRIVEN[machine]]
"""tests/long tries them all, with every strategy."""

DRAWN = sample([path for path, _ in PAIRS], 1)
"""Numbers of those whose program of `auto` the slow tests try."""

TOLERANCE = 1e-9
"""[mm]"""

FOLLOWS = 1e-3

BESIDE_REST = 8.0
"""Servo periods; or 0.1 µm, where slow dips take longer for that."""


def _cases() -> list:
    found = []
    for number, (path, machine) in enumerate(PAIRS):
        for strategy in STRATEGIES:
            names = path.stem, machine.stem, strategy
            if names in FAST:
                found.append(pytest.param(path, machine, strategy, id="-".join(names)))
            elif strategy == "auto" and number in DRAWN:
                found.append(pytest.param(path, machine, strategy, id="-".join(names), marks=pytest.mark.slow))
    return found


def _plan(path: Path, machine: Path, strategy: str) -> Plan:
    found = analyse(read_path(str(path)), read_machine(str(machine)), 0.005 * MM)
    return make_plan(found, PlanOptions(strategy=strategy, carrier="program", effort=0.02))


@pytest.mark.parametrize(("path", "machine", "strategy"), _cases())
@pytest.mark.thinned(12)
def test_program_is_the_path_and_the_plan(path: Path, machine: Path, strategy: str) -> None:
    compare_program(path, machine, strategy)


def compare_program(path: Path, machine: Path, strategy: str) -> None:
    """Compare the program of a path with the exact path, and with the feed that was planned."""
    plan = _plan(path, machine, strategy)
    program = make_program(plan, Track(plan.path), DIALECT)
    axes, pieces = exact_pieces(path)
    cuts = cuts_of(program.text, axes, pieces[0].first)
    walk = _walked(cuts, axes, pieces)
    assert walk.worst <= TOLERANCE
    assert _own_reading(program.text, walk) <= TOLERANCE
    followed = follow(cuts, axes, Planned(read_jogs(plan).phases))
    assert followed.changing > 0
    assert followed.worst <= FOLLOWS
    for duration, length in followed.beside:
        assert duration <= BESIDE_REST * plan.machine.servo_period or length <= 1.001e-4
    assert not [one for one in program.warnings if "off the planned feed" in one]


def _walked(cuts: list[Cut], axes: list[str], pieces: list[Piece]) -> Walk:
    walk = Walk(axes, pieces)
    simple = all(piece.center is not None or len(piece.above[0]) == 2 for piece in pieces)
    for cut in cuts:
        if cut.block.word == "POLY":
            walk.polynomial(cut)
        else:
            assert simple
            walk.worst = max(walk.worst, _off_simple(cut, axes, pieces))
    if not simple:
        walk.finish()
    return walk


def _off_simple(cut: Cut, axes: list[str], pieces: list[Piece]) -> float:
    """How far the ends of a line, or those and the centre of an arc, are off the nearest simple piece."""
    offset = np.array([float(c) for c in cut.offset])
    ends = np.array([[float(place[axis]) for axis in axes] for place in (cut.block.start, cut.block.end)])
    found = []
    for piece in pieces:
        if piece.center is not None:
            center = np.array([float(c) for c in piece.center])
            off = np.abs(np.hypot(*(ends - offset - center).T) - float(piece.radius))
            if cut.block.center is not None:
                own = np.array([float(cut.block.center[axis]) for axis in axes])
                off = np.append(off, np.abs(own - offset - center))
            else:
                off = np.append(off, np.hypot(*np.diff(ends, axis=0)[0]) ** 2 / (8 * float(piece.radius)))
            found.append(off.max())
        elif cut.block.center is None:
            first = np.array([float(row[0]) for row in piece.above])
            along = np.array([float(row[1]) for row in piece.above])
            along /= np.hypot(*along)
            found.append(np.abs((ends - offset - first) @ [-along[1], along[0]]).max())
    return float(min(found))


def _own_reading(text: str, walk: Walk) -> float:
    """Largest distance of the package's own reading of POLY from the exact path [mm]."""
    program = read_as("siemens", text.encode(), "part.mpf")
    assert not program.notes
    motions = program.motions
    columns = tuple("XYZ".index(axis) for axis in walk.axes)
    worst, u = 0.0, np.linspace(0.0, 1.0, 5)
    for line, (part, offset) in walk.parts.items():
        rows = np.flatnonzero(motions.block == line)
        assert rows.size
        points = np.concatenate(
            [curve.derivatives(u)[0] / MM for row in rows.tolist() for curve in curves_of(motions, row, columns)]
        )
        worst = max(worst, _distance(points - [float(c) for c in offset], part))
    return worst


def _distance(points: np.ndarray, part: Piece) -> float:
    """Largest distance of points from the piece they are near."""
    above = [np.polynomial.Polynomial([float(c) for c in row]) for row in part.above]
    below = np.polynomial.Polynomial([float(c) for c in part.below])

    def at(u: np.ndarray) -> np.ndarray:
        return np.column_stack([row(u) for row in above]) / below(u)[:, None]

    def slope(u: np.ndarray) -> np.ndarray:
        bend = (below.deriv()(u) / below(u))[:, None] * at(u)
        return np.column_stack([row.deriv()(u) for row in above]) / below(u)[:, None] - bend

    grid = np.linspace(0.0, 1.0, 129)
    near = ((points[:, None, :] - at(grid)) ** 2).sum(axis=2).argmin(axis=1)
    u = grid[near]
    for _ in range(8):
        tangent = slope(u)
        u = u + ((points - at(u)) * tangent).sum(axis=1) / (tangent**2).sum(axis=1)
    return float(np.sqrt(((points - at(u)) ** 2).sum(axis=1)).max())
