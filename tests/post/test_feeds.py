"""Where blocks end whose feed is a cubic: at joints of the path, and never within a servo period of them."""

from __future__ import annotations

import re
from fractions import Fraction
from itertools import pairwise

import msgspec
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.planned import Planned
from support.plans import make_machine, make_path, make_plan
from support.siemens_exact import Followed, cuts_of, follow, length_of

from ph_post.compensate.motion import MotionLaw
from ph_post.dialects.siemens.dialect import DIALECT
from ph_post.geometry.curves import Arc, Line
from ph_post.geometry.track import Track
from ph_post.post.feeds import thinned
from ph_post.post.program import Program, make_program
from ph_post.types import Phase, frozen

PERIOD = 1e-3
FAST, SLOW = 0.02, 0.01
JOINT = 0.03
CURVES = [Line([[0, 0], [JOINT, 0]]), Arc([JOINT, 0], [0.05, 0.02], [JOINT, 0.02], "ccw")]
SMOOTH, SHARP = (FAST, FAST, FAST, SLOW, SLOW, SLOW), (FAST, SLOW)


def _program(past: float, speed: tuple[float, ...], duration: float = 0.05) -> tuple[Program, Followed, list[float]]:
    """A ramp down that ends `past` [m] behind the joint; with the durations of its blocks [s]."""
    track = Track(make_path(CURVES))
    way = duration * float(np.mean(speed))
    first = JOINT + past - way
    rows = [
        (first / FAST, 0.0, (FAST,)),
        (duration, first, speed),
        ((track.length - first - way) / SLOW, first + way, (SLOW,)),
    ]
    start, phases = 0.0, []
    for time, s, coefficients in rows:
        phases.append(Phase(start=start, duration=time, s=s, speed=frozen(coefficients), window=-1))
        start += time
    plan = make_plan(track, moving=True, machine=make_machine(period=PERIOD))
    program = make_program(msgspec.structs.replace(plan, phases=tuple(phases)), track, DIALECT)
    planned, cuts = Planned(phases), cuts_of(program.text, ("X", "Y"), [Fraction(0), Fraction(0)])
    ends = np.cumsum([1e-3 * length_of(cut.block, ("X", "Y")) for cut in cuts])
    times = [0.0, *planned.times_at(ends, late=False).tolist()]
    return program, follow(cuts, ("X", "Y"), planned), [b - a for a, b in pairwise(times)]


@pytest.mark.parametrize("past", [-8e-6, -4e-6, -1e-12, 0.0, 1e-12, 4e-6, 8e-6, 3e-5])
def test_a_smooth_ramp_that_ends_beside_a_joint_is_followed(past: float) -> None:
    """0.4 ms before it, or behind it, cubics run on into the steady feed, or it into them."""
    program, followed, durations = _program(past, SMOOTH)
    assert followed.worst <= 1e-3
    assert followed.changing >= 3
    assert min(durations) >= PERIOD * (1.0 - 1e-6)
    assert not [one for one in program.warnings if "planned feed" in one]


def test_a_kink_within_a_servo_period_of_a_joint_is_warned_of() -> None:
    """The joint has to be met, and no cubic has a kink: what is left is said, as large as it is."""
    program, followed, durations = _program(4e-6, SHARP, 0.02)
    assert min(durations) >= PERIOD * (1.0 - 1e-6)
    assert followed.worst > 1e-3
    (said,) = [one for one in program.warnings if "off the planned feed" in one]
    percent = re.search(r"up to ([\d.]+) percent", said)
    assert percent is not None
    assert float(percent[1]) == pytest.approx(100.0 * followed.worst, rel=0.1)


def test_a_kink_farther_away_ends_a_block() -> None:
    assert _program(3e-5, SHARP, 0.02)[1].worst <= 1e-3


@pytest.mark.parametrize(("lowest", "follows"), [(0.0, True), (1e-9, True), (1e-6, False), (1e-4, True)])
def test_a_dip_that_nearly_stops_ends_a_block_at_its_bottom(lowest: float, follows: bool) -> None:
    """No feed falls to zero; where it grows 44-fold in a servo period, what no cubic follows is said."""
    bowl = tuple(FAST * (lowest + (1.0 - lowest) * one) for one in (1.0, -1.0, 1.0))
    way = [FAST, 0.3 * float(np.mean(bowl)), FAST]
    track = Track(make_path([Line([[0, 0], [sum(way), 0]])]))
    phases = (
        Phase(start=0.0, duration=1.0, s=0.0, speed=frozen([FAST]), window=-1),
        Phase(start=1.0, duration=0.3, s=way[0], speed=frozen(bowl), window=-1),
        Phase(start=1.3, duration=1.0, s=way[0] + way[1], speed=frozen([FAST]), window=-1),
    )
    plan = make_plan(track, moving=True, machine=make_machine(period=PERIOD))
    program = make_program(msgspec.structs.replace(plan, phases=phases), track, DIALECT)
    cuts = cuts_of(program.text, ("X", "Y"), [Fraction(0), Fraction(0)])
    share = np.linspace(0.0, 1.0, 201)
    for cut in cuts:
        assert cut.block.feed is not None
        assert np.polyval([float(c) for c in reversed(cut.block.feed)], share).min() > 0.0
    said = [one for one in program.warnings if "off the planned feed" in one]
    assert bool(said) != follows
    if lowest != 1e-9:
        assert (follow(cuts, ("X", "Y"), Planned(phases)).worst <= 1e-3) == follows


MOTION = MotionLaw.from_phases([Phase(start=0.0, duration=1.0, s=0.0, speed=frozen(SMOOTH), window=-1)])
INSTANTS = st.lists(st.integers(min_value=1, max_value=9999), max_size=12, unique=True)


@given(fixed=INSTANTS, free=INSTANTS)
def test_free_marks_keep_away_from_their_neighbours(fixed: list[int], free: list[int]) -> None:
    """In units of 0.1 ms, the least distance being 100; those that are fixed stay, no others are made up."""
    kept = sorted({0, 10000, *fixed})
    marks = thinned(MOTION, [one / 1e4 for one in kept], [one / 1e4 for one in free], 0.01)
    counts = [round(one * 1e4) for one in marks]
    assert counts == sorted(set(counts))
    assert set(kept) <= set(counts)
    for a, b in pairwise(counts):
        assert b - a >= 100 or {a, b} <= set(kept)
    for one in set(counts) - set(kept) - set(free):
        assert {one - 200, one + 200} & set(kept)
