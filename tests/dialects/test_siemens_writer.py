"""SINUMERIK programs: circles that are the path's, feeds that are the profile, words of the manual."""

from __future__ import annotations

import re
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import mpmath
import pytest
from support.plans import make_machine, make_path, make_plan
from support.sinumerik import Block, read_blocks

from ph_post.cli.main import main
from ph_post.dialects.siemens.dialect import DIALECT
from ph_post.geometry.curves import Arc, Line
from ph_post.geometry.ph import PH
from ph_post.geometry.track import Track
from ph_post.post.program import make_program

ROOT = Path(__file__).resolve().parents[2]
MACHINE = ROOT / "tests" / "golden" / "machine.toml"

WORDS = frozenset(
    # Programming Manual Fundamentals: tables of G groups and addresses.
    (
        "G0",
        "G1",
        "G2",
        "G3",
        "G4",
        "G17",
        "G18",
        "G19",
        "G40",
        "G54",
        "G60",
        "G90",
        "G94",
        "G641",
        "G710",
        "M30",
        "X",
        "Y",
        "Z",
        "I",
        "J",
        "F",
        "ADIS",
        # Programming Manual Job Planning: polynomial interpolation, feedrate response, path reference, and
        # block compression.
        "POLY",
        "PO",
        "PL",
        "FPO",
        "FNORM",
        "SPATH",
        "COMPOF",
    )
)


@pytest.fixture(autouse=True)
def _fifty_digits() -> None:
    mpmath.mp.dps = 50


def _program(path: str, folder: Path, *arguments: str) -> str:
    output = folder / f"{path}.mpf"
    files = [str(ROOT / "paths" / f"{path}.json"), "-m", str(MACHINE), "-o", str(output)]
    assert main(["convert", *files, "--dialect", "siemens", "--strategy", "suppress", *arguments]) == 0
    return output.read_text()


def _cuts(text: str) -> list[Block]:
    """Blocks behind the approach."""
    approach = len(list(read_blocks(text[: text.index("G641")])))
    return list(read_blocks(text))[approach:]


@pytest.mark.parametrize(("path", "radius"), [("circle", 250), ("pocket", None)])
def test_arcs_meet_their_circles(path: str, radius: int | None, tmp_path: Path) -> None:
    arcs = [block for block in _cuts(_program(path, tmp_path)) if block.center is not None]
    assert arcs
    for block in arcs:
        assert block.center is not None
        ends = [
            mpmath.sqrt(sum((Fraction(place[a] - block.center[a]) ** 2 for a in "XY"), Fraction(0)))
            for place in (block.start, block.end)
        ]
        assert abs(ends[0] - ends[1]) < 2e-10
        assert radius is None or abs(ends[0] - radius) < 2e-10


def _dip(cruise: float, low: float, t_star: float) -> Callable[[mpmath.mpf], mpmath.mpf]:
    """Feed [mm/min] at a way [mm] from the middle of the paper's profile of degree 10, in closed form."""
    v, half = mpmath.mpf(cruise) * 60000, mpmath.mpf(t_star) / 60
    factors = [mpmath.mpf(1)] * 4 + [mpmath.mpf(low)] * 3 + [mpmath.mpf(1)] * 4

    speed = [mpmath.mpf(0)] * 11
    for k, c in enumerate(factors):
        for j in range(11 - k):
            speed[k + j] += v * c * mpmath.binomial(10, k) * mpmath.binomial(10 - k, j) * (-1) ** j
    way = [mpmath.mpf(0), *(2 * half * c / (k + 1) for k, c in enumerate(speed))]
    whole = sum(way)

    def at(s: mpmath.mpf) -> mpmath.mpf:
        if abs(s) >= whole / 2:
            return v
        tau = mpmath.findroot(
            lambda x: mpmath.polyval(way[::-1], x) - whole / 2 - s, (0, 1), solver="anderson", tol=1e-24
        )
        return mpmath.polyval(speed[::-1], tau)

    return at


CURVES = {
    "quintic": [PH([0, 0], [[0.2, 0.02], [0.16, -0.2], [0.05, 0.24]])],
    "arc": [Arc([0.02, 0], [-0.02, 0], [0, 0], "ccw")],
    "line": [Line([[0, 0], [0.05, 0.01]])],
}


@pytest.mark.parametrize("low", [0.9, 0.2, -0.5])
@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.thinned(6)
def test_feeds_follow_the_profile(curve: str, low: float) -> None:
    """Cubics over the way of the blocks that were written, against the profile itself; -0.5 goes to 2 %."""
    mpmath.mp.dps = 25
    path = make_path(CURVES[curve])
    track = Track(path)
    middle, cruise, t_star = 0.5 * track.length, 0.02, 0.06
    plan = make_plan(track, speed=cruise, dips=[(middle, low, t_star)], machine=make_machine())
    blocks = _cuts(make_program(plan, track, DIALECT).text)
    at = _dip(cruise, low, t_star)
    s, worst, changing, nearest = mpmath.mpf(-1000 * middle), mpmath.mpf(0), 0, mpmath.inf
    for block in blocks:
        length = block.length()
        assert block.feed is not None
        if abs(s + length / 2) < 2:
            changing += len(block.feed) > 1
            for k in range(9):
                share = mpmath.mpf(k) / 8
                wanted = at(s + share * length)
                worst = max(worst, abs(block.feed_at(share) / wanted - 1))
                nearest = min(nearest, wanted)
        s += length
    assert abs(s - 1000 * middle) < 1e-6
    assert changing >= 2
    assert worst < 1e-3
    assert nearest < 1200 * (1 - 0.6 * (1 - low))


def test_a_rest_is_left_to_the_controller() -> None:
    """No cubic of the way leaves a rest: the blocks beside it, 4 ms at most, keep the feed of the next."""
    track = Track(make_path(CURVES["quintic"]))
    plan = make_plan(track, stops=[0.5 * track.length], machine=make_machine())
    blocks = _cuts(make_program(plan, track, DIALECT).text)
    flat = [k for k, block in enumerate(blocks) if block.feed is not None and len(block.feed) == 1]
    held = [k for k in flat if blocks[k].feed == [1200]]
    beside = [k for k in flat if k not in held]
    assert len(beside) == 4
    for k in beside:
        block = blocks[k]
        assert block.feed is not None
        assert block.length() / block.feed[0] * 60 <= 0.004
    for before, after in pairwise(blocks):
        assert before.feed is not None
        assert after.feed is not None
        if len(after.feed) > 1:
            assert sum(before.feed) == after.feed[0]


@pytest.mark.slow
def test_every_word_is_in_the_manual(tmp_path: Path) -> None:
    """Addresses and words outside comments, of programs with all kinds of blocks."""
    found = set()
    for path in ("pocket", "spatial", "butterfly"):
        text = _program(path, tmp_path)
        code = "\n".join(line.split(";")[0] for line in text.splitlines())
        found |= set(re.findall(r"[GM]\d+|[A-Z]{2,}|(?<![A-Z])[A-FH-LN-Z](?=[-=\d.\]])", code))
        assert max(map(len, text.splitlines())) < DIALECT.syntax.max_line
        assert text.isascii()
    assert found <= WORDS
