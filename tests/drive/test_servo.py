"""Free and harmonic response of the loop: the third-order loop's two ways, ringing, stability."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
from support.paper_equations import damping_case

from ph_post.drive.servo import free_response, is_stable, propagate, rates, ringing
from ph_post.types import Servo

EPS = 2.0**-52
TIMES = (0.0, 1e-6, 0.003, 0.05, 0.4, 3.0)


def exact_propagation(servo: Servo, t: float) -> np.ndarray:
    """exp(A t) by mpmath at 40 digits, unscaled."""
    b, c, ki, kd = map(mp.mpf, (servo.b, servo.c, servo.ki_over_kp, servo.kd_over_kp))
    rows = [[0, 1, 0], [-1 / b, -(c + kd) / b, ki / b], [-1, 0, 0]]
    if servo.ki_over_kp == 0.0:
        rows = [row[:2] for row in rows[:2]]
    with mp.workdps(40):
        size = mp.expm(mp.matrix(rows) * mp.mpf(t), method="taylor")
        return np.array(size.tolist(), dtype=np.float64)


def units(servo: Servo) -> np.ndarray:
    """Units of E's entries: speeds in 1/√b of places, ∫e in √b of them."""
    unit = np.array([1.0, 1.0 / math.sqrt(servo.b), math.sqrt(servo.b)])
    size = 2 if servo.ki_over_kp == 0.0 else 3
    return unit[:size, np.newaxis] / unit[np.newaxis, :size]


@pytest.mark.parametrize(
    "servo",
    [
        Servo(b=0.0005, c=0.005),
        Servo(b=0.0005, c=0.2),
        Servo(b=2.0**-10, c=2.0**-4),
        Servo(b=2.0**-10, c=2.0**-4 * (1.0 + 2.0**-50)),
        Servo(b=2.0**-10, c=2.0**-4 * (1.0 - 2.0**-50)),
        Servo(b=2.0**-10, c=2.0**-4 - 0.01, kd_over_kp=0.01),
    ],
)
def test_free_response_of_the_second_order(servo: Servo) -> None:
    ours = free_response(servo, TIMES)
    for t, matrix in zip(TIMES, ours, strict=True):
        # λt and γt are known to an ulp; with their decay that is worth no more than a few ulps of 1.
        assert np.all(np.abs(matrix - exact_propagation(servo, t)) <= 16 * EPS * units(servo))


@pytest.mark.parametrize(
    "servo",
    [
        Servo(b=0.0005, c=0.005, ki_over_kp=2.0, kd_over_kp=0.01),
        Servo(b=0.0005, c=0.1, ki_over_kp=5.0),
        Servo(b=0.0005, c=0.005, ki_over_kp=1e-9),
        Servo(b=1.0 / 27.0, c=1.0 / 3.0, ki_over_kp=1.0),  # (s/3 + 1)³: a triple root
    ],
)
def test_free_response_of_the_third_order(servo: Servo) -> None:
    ours = propagate(servo, TIMES)
    for t, matrix in zip(TIMES, ours, strict=True):
        # The modes' condition number is below 1e3; expm at the triple root is scaled and squared a few times.
        assert np.all(np.abs(matrix - exact_propagation(servo, t)) <= 1e3 * 8 * EPS * units(servo))


def test_third_order_by_modes_and_by_exponential_agree() -> None:
    servo = Servo(b=0.0005, c=0.02, ki_over_kp=2.0)
    difference = propagate(servo, TIMES, condition=0.0) - propagate(servo, TIMES)
    assert np.abs(difference / units(servo)).max() < 1e3 * 8 * EPS


def test_damping_case_is_exact() -> None:
    critical = Servo(b=2.0**-10, c=2.0**-4)
    assert damping_case(critical) == "critical"
    assert damping_case(Servo(b=2.0**-10, c=math.nextafter(2.0**-4, 1.0))) == "over"
    assert damping_case(Servo(b=2.0**-10, c=math.nextafter(2.0**-4, 0.0))) == "under"


def test_slow_rate_keeps_its_digits() -> None:
    """γ - λ of a heavily damped loop is nearly 1/c; as a difference it would have none left."""
    slow = rates(Servo(b=1e-12, c=1.0)).slow
    assert slow == pytest.approx(1.0 + 1e-12, rel=4 * EPS)


def test_ringing_of_both_orders() -> None:
    frequency, decay = ringing(Servo(b=0.0005, c=0.005))
    assert (frequency, decay) == pytest.approx((44.440972, 5.0), rel=1e-7)
    assert ringing(Servo(b=0.0005, c=0.005, ki_over_kp=1e-9)) == pytest.approx((frequency, decay), rel=1e-8)
    assert ringing(Servo(b=0.0005, c=0.2)) == (0.0, pytest.approx(rates(Servo(b=0.0005, c=0.2)).slow))


def test_stability_is_routhos() -> None:
    for servo in (Servo(b=0.0005, c=0.005, ki_over_kp=9.9), Servo(b=0.0005, c=0.005, ki_over_kp=10.1)):
        roots = np.roots([servo.b, servo.c, 1.0, servo.ki_over_kp])
        assert is_stable(servo) == bool(roots.real.max() < 0.0)
    assert not is_stable(Servo(b=0.0005, c=0.0))
