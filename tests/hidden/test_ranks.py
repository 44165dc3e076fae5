"""The rank test: what physics says that a record cannot tell, and what it can."""

from __future__ import annotations

import numpy as np
import pytest

from tests.support.cascade_records import moves
from tests.support.plants.draw import draw_case
from tests.support.plants.ranks import ALIKE, alike, tell_apart
from tests.support.plants.score import SHORTEST_TOLD


@pytest.mark.parametrize(
    ("hidden", "channels", "seed", "other", "same"),
    [
        # Friction by speed adds to c, and nothing else.
        ("viscous_friction", ("act",), 0, "servo_mismatch", True),
        # Dry friction holds the motor back, a play behind it does not.
        ("coulomb_friction", ("act", "motor"), 0, "backlash", False),
        # A weight shifts the origin, which nobody knows.
        ("load_offset", ("act",), 0, "nothing", True),
        # With the force it does not.
        ("load_offset", ("act", "force"), 0, "nothing", False),
        ("scale_error", ("act",), 0, "coulomb_friction", False),
    ],
)
@pytest.mark.thinned(4)
def test_names_are_alike_where_physics_says_so(
    hidden: str, channels: tuple[str, ...], seed: int, other: str, same: bool
) -> None:
    apart = tell_apart(draw_case([hidden], channels, "motor", seed), (other,))[hidden]
    assert (other in alike(apart)) is same


def test_what_takes_no_more_than_the_constants_do_is_not_like_the_truth() -> None:
    assert alike({"nothing": 20.0, "backlash": 19.0, "servo_mismatch": 1.0}) == {"servo_mismatch"}
    assert alike({"nothing": 1e6, "backlash": 0.9 * ALIKE, "scale_error": 1e4}) == {"backlash"}
    assert "nothing" in alike({"nothing": 4.0})


GAINS = {"kv": 40.0, "wv": 250.0, "rate": 80.0, "fed": 0.95}
ROW, NOISE = 1e-3, 3e-7
"""Time from row to row [s], and the noise of both readings together [m]."""


def filter_over_delay(length: float, *, straight: bool) -> float:
    """Log likelihood by which a moving average explains a cascade's log better than a delay of half its length.

    K_v, ω_v and 1/T_n may be off by 2 %, the feed-forward by 0.5 %, the delay by anything. What the drive makes of the
    command between rows is a smooth curve, steps, or straight lines, which spread it by 0 to ROW²/6, or known to be
    `straight`. The standard deviation is the root of twice as much.
    """
    command = np.tile(moves(), 2)
    s = 2j * np.pi * np.fft.rfftfreq(command.size, ROW)
    sent = np.fft.rfft(command)

    def read(late: float = 0.0, average: float = 0.0, spread: float = 0.0, **off: float) -> np.ndarray:
        kv, wv, rate, fed = (GAINS[name] * (1.0 + off.get(name, 0.0)) for name in GAINS)
        sums = s + rate
        loop = sums * (1.0 + fed * s / kv) / (s**3 / (wv * kv) + sums * (1.0 + s / kv))
        window = np.sinc(average * s.imag / (2.0 * np.pi)) * np.exp(-0.5 * average * s)
        filled = np.sinc(0.5 * ROW * s.imag / np.pi) ** 2 * (1.0 + 0.5 * spread * s**2)
        return np.fft.irfft(loop * window * filled * np.exp(-late * s) * sent, command.size) / NOISE

    here = read(average=length)
    errors = {"kv": 0.02, "wv": 0.02, "rate": 0.02, "fed": 0.005} | ({} if straight else {"spread": ROW**2 / 12.0})
    slopes = [read(average=length, **{name: 0.01 * error}) - here for name, error in errors.items()]
    slopes = np.column_stack([100.0 * np.array(slopes).T, (read(late=1e-6, average=length) - here) / 1e-3])
    known = np.eye(len(errors), len(errors) + 1)
    apart = np.concatenate([read(late=0.5 * length) - here, np.zeros(len(errors))])
    both = np.vstack([slopes, known])
    left = apart - both @ np.linalg.lstsq(both, apart, rcond=None)[0]
    return 0.5 * float(left @ left)


def test_short_filters_are_told_from_delays_by_what_is_taken_for_granted_between_rows() -> None:
    """A name needs 5 nats. The user's guide has these numbers."""
    told = {1.2: 0.58, 1.6: 1.84, 2.4: 9.3, 3.2: 29.3}
    assert {length: filter_over_delay(1e-3 * length, straight=False) for length in told} == pytest.approx(
        told, rel=0.01
    )
    assert filter_over_delay(2.4e-3, straight=True) > 2.0 * told[2.4]
    assert filter_over_delay(SHORTEST_TOLD["moving_average"], straight=False) == pytest.approx(5.0, rel=0.02)
