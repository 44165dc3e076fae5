"""Ramps between two speeds, against their differential equation and against closed forms."""

import mpmath as mp
import numpy as np
import pytest

from ph_post.compensate import speed_ramps

EPS = 2.0**-52


def cases(count: int = 200) -> tuple[np.ndarray, ...]:
    rng = np.random.default_rng(5)
    v0, v1 = 10.0 ** rng.uniform(-6, 0, (2, count)) * rng.integers(0, 2, (2, count))
    a, j = 10.0 ** rng.uniform(-2, 2, count), 10.0 ** rng.uniform(-1, 4, count)
    return v0, v1, a, j


def integrate(durations: np.ndarray, speeds: np.ndarray) -> mp.mpf:
    """Path of phases: the mean of the Bernstein coefficients times the duration, in 30 digits."""
    with mp.workdps(30):
        return mp.fsum(mp.mpf(float(t)) * mp.fsum(map(float, v)) / 3 for t, v in zip(durations, speeds, strict=True))


def test_a_ramp_takes_the_least_time_that_its_limits_allow() -> None:
    # Pontryagin: full jerk up, full acceleration, full jerk down; 2 √(Δv / j) without the middle part.
    assert speed_ramps.ramp_time(np.array(0.0), np.array(1.0), np.array(10.0), np.array(4.0)) == 1.0
    assert speed_ramps.ramp_time(np.array(0.0), np.array(1.0), np.array(1.0), np.array(4.0)) == 1.25


def test_phases_keep_the_limits_and_take_the_distance() -> None:
    v0, v1, a, j = cases()
    rng = np.random.default_rng(6)
    distance = speed_ramps.ramp_distance(v0, v1, a, j) * (1.0 + 10.0 ** rng.uniform(-9, 2, v0.size)) + 1e-6
    ceiling = np.maximum(v0, v1) + 10.0 ** rng.uniform(-6, 1, v0.size)
    peak = speed_ramps.peak_speed(v0, v1, ceiling, distance, a, j)
    assert np.all((peak >= np.maximum(v0, v1)) & (peak <= ceiling))
    durations, speeds = speed_ramps.curve_phases(v0, peak, v1, distance, a, j)
    # Neighbouring phases meet in speed and acceleration; an end of zero acceleration is V0 = V1.
    np.testing.assert_allclose(speeds[:, 1:, 0], speeds[:, :-1, 2], rtol=0.0, atol=4 * EPS * ceiling.max())
    assert np.all(speeds[:, 0, 0] == v0)
    assert np.all(speeds[:, 0, 1] == v0)
    assert np.all(speeds[:, -1, 1:] == v1[:, None])
    safe = np.where(durations > 0.0, durations, np.inf)
    slope = 2.0 * np.diff(speeds, axis=2) / safe[..., None]
    jerk = 2.0 * np.diff(speeds, 2, axis=2)[..., 0] / safe**2
    # The differences of nearly equal speeds keep an absolute error of an ulp of the speed.
    error = 8 * EPS * peak[:, None] / safe
    # Ramps that lack a billionth of the distance are run faster by as much.
    assert np.all(np.abs(slope).max(axis=2) <= a[:, None] * (1 + 2e-9) + error)
    assert np.all(np.abs(jerk) <= j[:, None] * (1 + 3e-9) + error / safe)
    for k in range(0, v0.size, 10):
        assert abs(integrate(durations[k], speeds[k]) - mp.mpf(float(distance[k]))) <= 32 * EPS * distance[k]


def test_the_peak_is_the_highest_that_fits() -> None:
    v0, v1, a, j = cases()
    distance = speed_ramps.ramp_distance(v0, v1, a, j) * 1.5 + 1e-5
    peak = speed_ramps.peak_speed(v0, v1, np.full(v0.size, 1e6), distance, a, j)
    taken = speed_ramps.ramp_distance(v0, peak, a, j) + speed_ramps.ramp_distance(peak, v1, a, j)
    assert np.all(np.abs(taken - distance) <= 1e-9 * distance)


@pytest.mark.parametrize(("a", "j"), [(1e9, 3.0), (0.7, 1e9), (2.0, 50.0)])
@pytest.mark.parametrize("v", [0.0, 1e-9, 0.02, 3.0])
@pytest.mark.parametrize("distance", [1e-9, 1e-3, 2.0])
def test_reachable_is_the_inverse_of_the_ramp(a: float, j: float, v: float, distance: float) -> None:
    with mp.workdps(40):
        A, J, V = mp.mpf(a), mp.mpf(j), mp.mpf(v)

        def left(x: mp.mpf) -> mp.mpf:
            time = 2 * mp.sqrt(x / J) if x * J <= A * A else x / A + A / J
            return (V + x / 2) * time - mp.mpf(distance)

        high = mp.mpf(1)
        while left(high) < 0:
            high *= 2
        exact = V + mp.findroot(left, (mp.mpf(0), high), solver="anderson", tol=1e-60, maxsteps=400)
    found = speed_ramps.reachable(v, distance, a, j)
    # The change of speed, not the speed, is what is given away by 1e-14.
    assert found <= float(exact) + EPS * v
    assert found == pytest.approx(float(exact), rel=4 * EPS, abs=3e-14 * float(exact - V))


@pytest.mark.parametrize(("v0", "v1", "a", "j"), [(0.0, 1.0, 1.0, 4.0), (0.3, 0.9, 5.0, 2.0), (0.0, 1e-3, 1.0, 50.0)])
def test_state_on_a_ramp_against_its_own_phases(v0: float, v1: float, a: float, j: float) -> None:
    one = np.ones(1)
    length = speed_ramps.ramp_distance(v0 * one, v1 * one, a * one, j * one)
    durations, speeds = speed_ramps.curve_phases(v0 * one, v1 * one, v1 * one, length, a * one, j * one)
    start = 0.0
    for time, (low, middle, high) in zip(durations[0][:3], speeds[0][:3], strict=True):
        for tau in (0.0, 0.3, 0.5, 0.9):
            way = time * (low * tau + (middle - low) * tau**2 + (low - 2 * middle + high) * tau**3 / 3)
            speed = low + 2 * (middle - low) * tau + (low - 2 * middle + high) * tau**2
            slope = 2 * ((middle - low) + (low - 2 * middle + high) * tau) / time if time else 0.0
            if time:
                found = speed_ramps.state_on_ramp(v0 * one, v1 * one, (start + way) * one, a * one, j * one)
                # From rest v ~ x^(2/3) and a ~ x^(1/3): a rounding of x shows more than once in them.
                assert float(found[0][0]) == pytest.approx(speed, rel=1e-12, abs=1e-12 * v1)
                assert float(found[1][0]) == pytest.approx(slope, rel=1e-7, abs=1e-7 * a)
        start += time * (low + middle + high) / 3
