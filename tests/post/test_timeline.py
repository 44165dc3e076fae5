"""Spans of a plan, against exact roots and sums."""

from __future__ import annotations

import numpy as np
import pytest
import sympy

from ph_post.compensate.motion import MotionLaw
from ph_post.post.timeline import find_spans, sign_changes, time_at
from ph_post.types import Phase, frozen


def chain(*parts: tuple[float, list[float], int]) -> list[Phase]:
    """Phases one after the other from (duration, coefficients, window)."""
    phases, t, s = [], 0.0, 0.0
    for duration, speed, window in parts:
        phases.append(Phase(start=t, duration=duration, s=s, speed=frozen(speed), window=window))
        t += duration
        s += duration * sum(speed) / len(speed)
    return phases


@pytest.mark.parametrize(
    "speed",
    [
        [1, 1, -3, 1, 1],
        [1, 1, 1, 1, -2, -2, -2, 1, 1, 1, 1],
        [2, -1, 4, -7, 3],
        [1, -1, 1],  # (1 - 2u)²: touches zero and does not cross
        [0, 0, 1, 1],
        [-1, -2, 5],
    ],
)
def test_sign_changes_are_the_roots_of_odd_order(speed: list[int]) -> None:
    u = sympy.Symbol("u")
    n = len(speed) - 1
    power = sum(c * sympy.binomial(n, k) * u**k * (1 - u) ** (n - k) for k, c in enumerate(speed))
    roots = sympy.Poly(power, u).real_roots(multiple=False)
    expected = sorted(float(root.evalf(30)) for root, times in roots if times % 2 and 0 < root < 1)
    found = sign_changes(np.array(speed, dtype=float))
    # the root of p moves by rounding / |p'|; these slopes are all above 1
    assert found == pytest.approx(expected, abs=1e-14)


def test_neighbours_of_one_character_are_joined() -> None:
    phases = chain(
        (0.1, [0, 1], -1),
        (0.2, [1, 2], -1),
        (1.0, [2], -1),
        (1.0, [2, 2], 3),
        (0.1, [2, 1, 2], 3),
        (0.1, [2, 0], -1),
        (0.1, [0, 2], -1),
        (0.5, [0], -1),
        (0.5, [0, 0], -1),
    )
    spans = find_spans(phases)
    kinds = [(span.kind, round(span.end, 12), span.rests) for span in spans]
    assert kinds == [
        ("ramp", 0.3, False),
        ("steady", 2.3, False),
        ("ramp", 2.4, False),
        ("ramp", 2.5, True),
        ("ramp", 2.6, False),
        ("dwell", 3.6, False),
    ]
    assert [span.window for span in spans] == [-1, -1, 3, -1, -1, -1]


def test_spans_turn_where_the_speed_changes_sign() -> None:
    phases = chain((2.0, [1.0, -3.0, 1.0], 0))
    there, back, on = find_spans(phases)
    # 1 - 8 u (1 - u) vanishes at 1/2 ± 1/√8
    assert there.end == pytest.approx(2.0 * (0.5 - 8**-0.5), rel=1e-14)
    assert back.end == pytest.approx(2.0 * (0.5 + 8**-0.5), rel=1e-14)
    assert (there.rests, back.rests, on.rests) == (True, True, False)
    assert there.speed > 0 > back.speed
    u = sympy.Symbol("u")
    way = 2 * sympy.integrate(1 - 8 * u * (1 - u), (u, 0, sympy.Rational(1, 2) - 1 / sympy.sqrt(8)))
    assert there.s1 == pytest.approx(float(way), rel=1e-14)


def test_times_at_places() -> None:
    phases = chain((1.0, [0.0, 2.0], -1), (2.0, [2.0], -1))
    ramp, steady = find_spans(phases)
    motion = MotionLaw.from_phases(phases)
    assert time_at(motion, ramp, 0.25) == pytest.approx(0.5, rel=1e-15)  # s = t²
    assert time_at(motion, steady, 2.0) == pytest.approx(1.5, rel=1e-15)
    backwards = chain((1.0, [0.0, -2.0], -1))
    assert time_at(MotionLaw.from_phases(backwards), find_spans(backwards)[0], -0.25) == pytest.approx(0.5, rel=1e-15)
