"""What a record can show: grids, noise floors, repeats, start-up, shifts and faults whose truth is known."""

from __future__ import annotations

import math
import sys

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy import io as matlab
from scipy import signal
from scipy.integrate import solve_ivp
from support.engine_cases import make_axis, make_machine
from support.linear_response import response

from ph_post.diagnose.residual_features import is_structured
from ph_post.diagnose.residual_places import locate
from ph_post.identify.linear_drive import linear_response
from ph_post.identify.log_quality import examine, find_quantum
from ph_post.identify.noise import find_repeats
from ph_post.types import AxisLog, Log, Machine, Servo
from ph_post.types.diagnosis import LogQuality
from tests.support.measured import EMPS, needs_emps

Array = NDArray[np.float64]
PERIOD = 1e-3
B, C = 7e-5, 6.4e-3
MM = 1e-3
UM = 1e-6


def machine(*names: str, gap: float = 0.0) -> Machine:
    return make_machine([make_axis("motor", B, C, gap, name=name) for name in names or ("X",)], PERIOD)


def record(command: Array, reading: Array | None, period: float = PERIOD, **other: Array) -> Log:
    axes = {"X": AxisLog(command=command, table=reading)}
    axes |= {name: AxisLog(command=values) for name, values in other.items()}
    return Log(name="test", t=period * np.arange(command.size), period=period, axes=axes)


def servo(command: Array, period: float = PERIOD) -> Array:
    """The linear loop as this test has it: state space, first order hold."""
    a = np.array([[0.0, 1.0], [-1.0 / B, -C / B]])
    return response((a, [[0.0], [1.0 / B]], [[1.0, 0.0]], 0.0), command, period * np.arange(command.size))


def sweeps(seconds: float, seed: int = 0, period: float = PERIOD) -> Array:
    """A smooth motion that never comes again: sines of frequencies that go together nowhere."""
    rng = np.random.default_rng(seed)
    t = period * np.arange(round(seconds / period))
    total = np.zeros(t.size)
    for frequency in rng.uniform(0.05, 0.4, 6) * math.sqrt(2.0):
        total += 8.0 * MM * np.sin(2.0 * np.pi * frequency * t + rng.uniform(0.0, 6.0))
    return total - total[0]


def wander(n: int, size: float, seed: int = 1, period: float = PERIOD, corner: float = 8.0) -> Array:
    """Noise below some hertz, of that root mean square."""
    b, a = signal.butter(2, 2.0 * corner * period)
    slow = signal.lfilter(b, a, np.random.default_rng(seed).standard_normal(n))
    return np.asarray(size * slow / np.std(slow), dtype=np.float64)


def white(n: int, size: float, seed: int = 2) -> Array:
    return size * np.random.default_rng(seed).standard_normal(n)


def only(quality: LogQuality) -> tuple[float, float, str]:
    (channel,) = quality.channels
    return channel.resolution, channel.noise, channel.noise_from


def test_the_linear_response_solves_the_differential_equation() -> None:
    command = 0.01 * np.sin(8.0 * PERIOD * np.arange(1500)) ** 2
    ki, kd = 3.0, 1e-3

    def slope(t: float, z: Array) -> list[float]:
        u, du = 0.01 * math.sin(8.0 * t) ** 2, 0.08 * math.sin(16.0 * t)
        error = u - z[0]
        return [z[1], (error + ki * z[2] + kd * (du - z[1]) - C * z[1]) / B, error]

    t = PERIOD * np.arange(1500)
    reference = solve_ivp(slope, (0.0, t[-1]), [0.0, 0.0, 0.0], t_eval=t, rtol=1e-10, atol=1e-13).y[0]
    found = linear_response(command, Servo(b=B, c=C, ki_over_kp=ki, kd_over_kp=kd), PERIOD)
    # the command is linear between samples here and smooth there: u'' h²/8 apart at most
    assert np.max(np.abs(found - reference)) < 1.28 * PERIOD**2 / 8.0


def test_an_ideal_stepper_follows_at_once() -> None:
    command = sweeps(1.0)
    np.testing.assert_array_equal(linear_response(command, Servo(b=0.0, c=0.0), PERIOD), command)


@pytest.mark.parametrize("quantum", [0.05 * UM, 0.0508 * UM, 1.0 * UM, 4.8828125 * UM, 1.0 * MM])
@pytest.mark.parametrize("noise", [0.0, 0.5, 3.0])
def test_a_grid_is_found_through_the_decimals_of_a_file(quantum: float, noise: float) -> None:
    values = sweeps(20.0) + white(20_000, noise * quantum)
    written = np.round(np.round(values / quantum) * quantum, 9)  # six decimals of a millimetre
    assert find_quantum(written, 1e-9) == pytest.approx(quantum, rel=2e-3)


def test_a_reading_without_a_grid_has_none() -> None:
    assert find_quantum(sweeps(5.0) + white(5000, UM), 1e-9) == 0.0
    assert find_quantum(sweeps(5.0), 1e-9) == 0.0


def test_the_decimals_of_a_file_alone_are_no_grid_that_shows() -> None:
    values = np.round(servo(sweeps(20.0)) + white(20_000, 0.2 * UM), 9)
    resolution, noise, source = only(examine(record(sweeps(20.0), values), machine()))
    assert resolution == 0.0
    assert source == "differences"
    assert noise == pytest.approx(0.2 * UM, rel=0.05)


def test_a_grid_counts_to_the_noise() -> None:
    command = sweeps(20.0)
    values = 5.0 * UM * np.round(servo(command) / (5.0 * UM))
    resolution, noise, _ = only(examine(record(command, values), machine()))
    assert resolution == pytest.approx(5.0 * UM)
    assert noise == pytest.approx(5.0 * UM / math.sqrt(12.0), rel=0.15)


@pytest.mark.parametrize("quantum", [1.0, 5.0, 20.0])
@pytest.mark.parametrize("noise", [0.0, 0.1, 0.5])
@pytest.mark.parametrize("cycle", [4.0, 3.3337])
@pytest.mark.thinned(8)
def test_rounding_that_repeats_with_the_motion_is_noise_all_the_same(
    quantum: float, noise: float, cycle: float
) -> None:
    """What a true model leaves of such a record is no structure."""
    command = 0.02 * np.sin(2.0 * np.pi * PERIOD * np.arange(20_000) / cycle)
    true = servo(command)
    reading = quantum * UM * np.round((true + white(true.size, noise * quantum * UM)) / (quantum * UM))
    quality = examine(record(command, reading), machine())
    assert quality.channels[0].noise_from == "repeats"
    counted = np.arange(true.size) >= quality.first
    assert not is_structured(reading - true, counted, quality.channels[0].noise)[0]


@pytest.mark.parametrize("cycle", [4.0, 2.0 * math.pi / 1.37])
def test_repeats_see_the_wander_that_differences_miss(cycle: float) -> None:
    """Also where the motion comes again between two samples; friction and gap repeat and are no noise."""
    t = PERIOD * np.arange(30_000)
    command = 0.02 * np.sin(2.0 * np.pi * t / cycle)
    lag = servo(command - 15.0 * UM * np.sign(np.cos(2.0 * np.pi * t / cycle)))
    reading = lag + wander(t.size, 2.0 * UM) + white(t.size, 0.3 * UM)
    quality = examine(record(command, reading), machine())
    _, noise, source = only(quality)
    assert source == "repeats"
    assert noise == pytest.approx(math.hypot(2.0, 0.3) * UM, rel=0.12)
    assert any(f"again after {cycle:.6g} s" in note for note in quality.notes)


def test_heat_that_grows_from_run_to_run_is_no_noise() -> None:
    t = PERIOD * np.arange(40_000)
    command = 0.02 * np.sin(2.0 * np.pi * t / 5.0)
    reading = servo(command) + 30.0 * UM * (1.0 - np.exp(-t / 15.0)) + white(t.size, 0.3 * UM)
    _, noise, source = only(examine(record(command, reading), machine()))
    assert source == "repeats"
    assert noise == pytest.approx(0.3 * UM, rel=0.1)


def test_a_motion_of_one_axis_repeats_only_if_the_others_do_too() -> None:
    t = PERIOD * np.arange(12_000)
    x, y = 0.02 * np.sin(2.0 * np.pi * t / 3.0), sweeps(12.0, seed=5)
    assert sum(r.stop - r.start for r in find_repeats(x[None, :], PERIOD, 0.0)) == 9000
    assert find_repeats(np.array([x, y]), PERIOD, 0.0) == ()


@pytest.mark.parametrize("beyond", [-10.4, -0.5, 3.4])
def test_a_lag_of_all_of_a_log_is_no_repeat(monkeypatch: pytest.MonkeyPatch, beyond: float) -> None:
    """A lag is refined by where two parts of the log are near each other; that may lead out of it."""
    x = np.cumsum(np.sin(np.arange(3000.0) ** 1.3 / 3000.0)) * 1e-5
    noise = sys.modules[find_repeats.__module__]
    monkeypatch.setattr(noise, "_candidates", lambda _commands, _least: [x.size + beyond])
    assert find_repeats(x[None, :], PERIOD, 0.0) == ()


def test_a_program_that_is_run_twice_among_other_motions_repeats() -> None:
    def there_and_back(seconds: float, seed: int) -> Array:
        motion = sweeps(seconds, seed)
        return motion * np.sin(np.pi * np.arange(motion.size) / motion.size) ** 2

    piece = there_and_back(3.0, 6)
    parts = (there_and_back(4.0, 7), piece, there_and_back(2.5, 8), piece, there_and_back(2.0, 9))
    (found,) = find_repeats(np.concatenate(parts)[None, :], PERIOD, 0.0)
    assert found.lag == pytest.approx(5500.0)
    assert found.start == pytest.approx(9500, abs=60)  # each begins slowly: nearly the same for a while
    assert found.stop == pytest.approx(12_500, abs=60)


def stepwise(seconds: float) -> Array:
    """Ever other moves, and half a second of standstill behind each."""
    rng = np.random.default_rng(3)
    n = round(seconds / PERIOD)
    parts, place = [], 0.0
    while sum(part.size for part in parts) < n:
        travel, steps = rng.uniform(-10.0, 10.0) * MM, int(rng.integers(200, 700))
        move = place + travel * 0.5 * (1.0 - np.cos(np.pi * np.arange(1, steps + 1) / steps))
        place = float(move[-1])
        parts += [move, np.full(500, place)]
    return np.concatenate(parts)[:n]


def test_standstill_sees_the_wander_too() -> None:
    command = stepwise(40.0)
    reading = servo(command) + wander(command.size, 2.0 * UM, corner=20.0) + white(command.size, 0.3 * UM)
    _, noise, source = only(examine(record(command, reading), machine()))
    assert source == "stationary stretches"
    assert noise == pytest.approx(math.hypot(2.0, 0.3) * UM, rel=0.15)


def test_creep_of_an_axis_held_by_friction_is_no_noise() -> None:
    command = stepwise(40.0)
    creep = signal.lfilter([1.0 / 400.0], [1.0, 1.0 / 400.0 - 1.0], command)  # 0.4 s
    reading = servo(command) + 0.01 * (creep - command) + white(command.size, 0.3 * UM)
    _, noise, _ = only(examine(record(command, reading), machine()))
    assert noise == pytest.approx(0.3 * UM, rel=0.1)


def test_reversals_do_not_count_as_noise_of_differences() -> None:
    command = sweeps(30.0, seed=9)
    reading = servo(command - 20.0 * UM * np.sign(np.gradient(command))) + white(command.size, 0.2 * UM)
    _, noise, source = only(examine(record(command, reading), machine()))
    assert source == "differences"
    assert noise == pytest.approx(0.2 * UM, rel=0.1)


def test_the_start_up_lasts_ten_time_constants_and_until_the_flank_is_taken_up() -> None:
    command = sweeps(20.0)
    quality = examine(record(command, servo(command)), machine())
    assert quality.first == math.ceil(10.0 * 2.0 * B / C / PERIOD)
    slow = np.concatenate((np.zeros(1000), 1.0 * MM * np.arange(19_000) * PERIOD))  # 1 mm/s from 1 s on
    quality = examine(record(slow, servo(slow)), machine())
    assert quality.first == pytest.approx(1500 + 3.0 * 2.0 * B / C / PERIOD, abs=2)
    quality = examine(record(slow, servo(slow)), machine(gap=5.0 * MM))
    assert quality.first == 4000, "a fifth of the record at most"


@pytest.mark.parametrize("late", [0.0, 1.3e-3, -0.8e-3, 5e-3])
def test_a_reading_that_is_late_is_told_from_a_slow_drive(late: float) -> None:
    t = PERIOD * np.arange(20_000)
    command = 0.01 * np.sin(9.0 * t) * np.sin(0.7 * t) + 0.003 * np.sin(31.0 * t) * np.sin(0.9 * t)
    reading = np.interp(t - late, t, servo(command)) + white(t.size, 0.2 * UM)
    (channel,) = examine(record(command, reading), machine()).channels
    assert channel.shift == pytest.approx(late, abs=5e-5)


def test_a_drive_that_is_slower_than_its_file_is_not_late() -> None:
    command = sweeps(20.0)
    reading = linear_response(command, Servo(b=B, c=1.02 * C), PERIOD) + white(command.size, 0.2 * UM)
    (channel,) = examine(record(command, reading), machine()).channels
    assert channel.shift in {0.0, None}


def test_where_a_delay_looks_like_something_else_none_is_told() -> None:
    """One sine tells no delay from a slow drive, one speed none from an offset."""
    t = PERIOD * np.arange(20_000)
    for command in (0.005 * np.sin(19.0 * t), 0.01 * t):
        late = np.interp(t - 2e-3, t, servo(command)) + white(t.size, 0.2 * UM)
        (channel,) = examine(record(command, late), machine()).channels
        assert channel.shift is None


@pytest.mark.parametrize("side", ["friction", "play"])
def test_friction_and_play_are_no_delay(side: str) -> None:
    t = PERIOD * np.arange(20_000)
    triangle = 0.02 * (2.0 / np.pi) * np.arcsin(np.sin(2.0 * np.pi * t / 4.7773))
    command = np.asarray(signal.lfilter(np.ones(60) / 60.0, [1.0], triangle), dtype=np.float64)
    if side == "friction":
        reading = servo(command - 15.0 * UM * np.sign(np.gradient(command)))
    else:
        table = servo(command)
        reading, flank = np.empty(t.size), 0.0
        for row, place in enumerate(table):
            flank = min(max(flank, place - 15.0 * UM), place + 15.0 * UM)
            reading[row] = flank
    (channel,) = examine(record(command, reading + white(t.size, 0.2 * UM)), machine()).channels
    assert channel.shift in {0.0, None}


def test_missing_samples_are_counted_and_harmless() -> None:
    command = sweeps(20.0)
    reading = servo(command) + white(command.size, 0.2 * UM)
    reading[5000:5040] = np.nan
    reading[::997] = np.nan
    quality = examine(replace(record(command, reading), missing=40, jitter=2e-4), machine())
    assert quality.channels[0].missing == np.count_nonzero(np.isnan(reading))
    assert quality.channels[0].noise == pytest.approx(0.2 * UM, rel=0.05)
    assert quality.notes[:3] == (
        "samples are up to 0.2 ms off a constant period of 1 ms",
        "40 of 20000 rows are missing",
        "X_act: 61 of 20000 samples are missing",
    )
    assert quality.faults == ()


def faults(log: Log, gap: float = 0.0) -> tuple[str, ...]:
    return examine(log, machine(gap=gap)).faults


def test_records_that_can_show_nothing_say_why() -> None:
    command, still = sweeps(10.0), np.zeros(10_000)
    assert faults(record(still, white(10_000, UM))) == ("no axis is commanded to move",)
    assert faults(record(command, None)) == ("the log holds commands but no reading of any axis",)
    constant = ("no reading changes from the first sample to the last: nothing was measured",)
    assert faults(record(command, still)) == constant
    assert faults(record(command, np.full(10_000, np.nan))) == constant
    assert faults(record(command[:200], servo(command)[:200])) == (
        "the log lasts 0.2 s; the servo of X needs 0.219 s to forget how it started",
    )


def test_a_slow_recorder_sees_nothing_of_a_fast_servo() -> None:
    command = sweeps(100.0, period=0.1)
    (fault,) = faults(record(command, command, period=0.1))
    assert fault == (
        "samples are 100 ms apart; the servo of X answers within 21.9 ms and its motion between samples is not seen"
    )


def test_a_grid_of_a_millimetre_cannot_show_backlash() -> None:
    command = sweeps(30.0)
    reading = MM * np.round(servo(command - 15.0 * UM * np.sign(np.gradient(command))) / MM)
    (fault,) = faults(record(command, reading), gap=0.03 * MM)
    assert fault.startswith("X_act reads in steps of 1 mm and is 0.288 mm rms off what the command alone ")
    assert fault.endswith("a reading in steps of 1 mm cannot show backlash or friction")


def test_a_coarse_grid_shows_what_is_larger_than_it() -> None:
    command = sweeps(30.0)
    fine = 5.0 * UM * np.round(servo(command) / (5.0 * UM))
    assert faults(record(command, fine)) == ()
    away = 0.1 * MM * np.round(servo(command - 0.3 * MM * np.sign(np.gradient(command))) / (0.1 * MM))
    assert faults(record(command, away)) == ()


@pytest.mark.parametrize("n", [2, 3, 10, 40, 300])
@pytest.mark.parametrize("steps", [0.0, 1e-5])
def test_short_empty_and_broken_records_trip_nothing(n: int, steps: float) -> None:
    rng = np.random.default_rng(n)
    command = steps * np.arange(n)
    holes = np.where(rng.random(n) < 0.5, np.nan, command)
    drives = (machine(), make_machine([make_axis("none", 0.0, 0.0, 0.0)], PERIOD), machine("Z"))
    for reading in (None, command, np.full(n, np.nan), command + white(n, UM), holes):
        for drive in drives:
            log = record(command, reading)
            quality = examine(log, drive)
            assert all(np.isfinite(channel.noise) for channel in quality.channels)
            assert 0 <= quality.first <= n // 5
            residual = np.zeros(n) if reading is None else reading
            for noise in (0.0, UM):
                found = locate(log, "X", residual, np.ones(n, dtype=np.bool_), noise, drive)
                assert all(math.isfinite(place.value) for place in found)


@needs_emps
def test_the_measured_drive() -> None:
    """Four runs of one motion: they differ by far less than models of this drive miss, and by a wander."""
    data = matlab.loadmat(str(EMPS))
    t, command, motor, volts = (np.ravel(data[key]).astype(np.float64) for key in ("t", "qg", "qm", "vir"))
    log = Log(
        name="emps",
        t=t,
        period=PERIOD,
        axes={"X": AxisLog(command=command, motor=motor, effort=35.15 * volts)},
    )
    drive = make_machine([make_axis("motor", 95.1 / 1.3707e6, 6.39e-3, 0.0)], PERIOD)
    quality = examine(log, drive)
    position, force = quality.channels
    assert position.resolution == pytest.approx(0.05 * UM, rel=1e-3)
    assert position.noise_from == force.noise_from == "repeats"
    assert position.noise == pytest.approx(0.18 * UM, rel=0.05)
    assert force.noise == pytest.approx(0.33, rel=0.05)
    assert position.shift == 0.0
    assert 0.2 <= quality.first * PERIOD <= 0.25
    assert quality.faults == ()


def test_a_stop_in_one_of_two_runs_is_no_noise() -> None:
    rng = np.random.default_rng(2)
    once = sweeps(20.0)
    command = np.concatenate([once, once])
    reading = servo(command) + 0.3 * UM * rng.standard_normal(command.size)
    reading[26_000:29_000] += 60.0 * UM
    (quality,) = examine(record(command, reading), machine()).channels
    assert quality.noise_from == "repeats"
    assert quality.noise == pytest.approx(0.3 * UM, rel=0.1)
    assert quality.unrepeated is None


def test_runs_that_differ_everywhere_are_said_and_are_no_noise() -> None:
    rng = np.random.default_rng(2)
    once = sweeps(20.0)
    command = np.concatenate([once, once])
    reading = servo(command) + 0.3 * UM * rng.standard_normal(command.size) + wander(command.size, 60.0 * UM)
    quality = examine(record(command, reading), machine())
    (channel,) = quality.channels
    assert channel.noise < 12.0 * 0.3 * UM
    assert channel.unrepeated == pytest.approx(60.0 * UM, rel=0.3)
    assert any("something does not repeat" in note for note in quality.notes)
