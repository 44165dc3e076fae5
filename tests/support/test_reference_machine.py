"""The reference simulation of the tests against closed forms and elementary mechanics."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from support.drives import AMPLITUDE, OMEGA, Printed
from support.reference_machine import Drive, Motion, simulate_axis

PAPER = {"b": 5e-4, "c": 5e-3, "N": 25.0, "r": 1.0, "eta": 0.35, "tau": 1.0, "motor_gap": 0.125664}
PAPER_DRIVE = Drive.from_constants(**PAPER)
SOFT = {"b": 4e-4, "c": 0.05, "gap": 1e-3, "eta": 0.4, "beta": 2.0}


def swing(period: float, end: float, drive: Drive = PAPER_DRIVE) -> Motion:
    """The harmonic motion of section 4.2."""
    t = period * np.arange(round(end / period) + 1)
    return simulate_axis(drive, AMPLITUDE * np.sin(OMEGA * t), period, speed=AMPLITUDE * OMEGA)


def near_a_reversal(start: float, x: mp.mpf, v: mp.mpf, drive: Drive, sign: int) -> tuple[Motion, float]:
    """The harmonic motion from `start` on with a period so short that its chords do not show.

    Chords of a sine are smaller than it by (Ωh)²/12 in the mean, which is added to the amplitude.
    """
    period = 1e-4
    t = start + period * np.arange(4001)
    command = sign * AMPLITUDE * (1.0 + (OMEGA * period) ** 2 / 12.0) * np.sin(OMEGA * t)
    return simulate_axis(drive, command, period, position=float(x), speed=float(v)), period


def from_zero(t: float) -> tuple[mp.mpf, mp.mpf]:
    """Position and speed under Eq. (8) at `t` from x = 0, ẋ = aΩ."""
    exact = Printed(5e-4, 5e-3, 1.0, 1.0, AMPLITUDE, OMEGA)
    root = mp.mpc(-exact.gamma, exact.lam)
    # Re[k exp(root t)] has to make up for -g at t = 0.
    k_real = exact.g(0)
    k_imag = -(AMPLITUDE * OMEGA + exact.g_dot(0) - root.real * k_real) / root.imag
    free = mp.mpc(k_real, k_imag) * mp.exp(root * t)
    return free.real - exact.g(t), (root * free).real - exact.g_dot(t)


def test_first_reversal_of_the_worked_example() -> None:
    run, _ = near_a_reversal(2.8, *from_zero(2.8), PAPER_DRIVE, 1)
    assert [event.kind for event in run.events] == ["opens", "picks up"]
    assert run.events[0].t - 0.2 == pytest.approx(0.005000546, abs=5e-10)


def test_settled_reversal_of_the_worked_example() -> None:
    """From the motion of Eq. (19) after a settled pick-up, 200 ms before the next turning point."""
    with mp.workdps(40):
        printed = Printed(5e-4, 5e-3, 25.0 / (0.35 * 5e-4), 1.0, AMPLITUDE, OMEGA)
        t_i, x_i, duration = printed.settled(0.125664, (3.005, 0.25, 0.1187))
        x, v, _ = printed.motion(t_i + duration, x_i, mp.mpf("8.8"))
        exact = -printed.motion(t_i + 6 + duration, -x_i, mp.mpf("9.2"))[0]
    run, period = near_a_reversal(8.8, -x, -v, PAPER_DRIVE, -1)
    opens, closes = run.times("opens", "picks up")
    assert opens - 0.2 == pytest.approx(0.005000674, abs=5e-10)
    assert closes - opens == pytest.approx(0.11874297, abs=5e-9)
    assert run.table[round(0.3 / period)] == pytest.approx(0.25003341707, abs=5e-12)
    # And after it the motion of Eq. (19) with the opposite sign.
    assert run.table[-1] == pytest.approx(float(exact), abs=1e-10)


@pytest.mark.slow
def test_whole_swing_settles() -> None:
    """From the start through three reversals; the chords of 2 ms move a reversal by less than 1 µs."""
    run = swing(2e-3, 15.2)
    opens, closes = np.array(run.times("opens")), np.array(run.times("picks up"))
    assert opens - [3.0, 9.0, 15.0] == pytest.approx([0.005000546, 0.005000674, 0.005000674], abs=1e-6)
    assert closes - opens == pytest.approx([0.118743] * 3, abs=2e-6)


def test_contact_parts_before_the_turning_point() -> None:
    """The flanks of the worked example part 62 ms before the turning point, where T is zero."""
    run = swing(2e-3, 3.2, Drive.from_constants(**PAPER, rule="contact"))
    assert run.events[0].kind == "opens"
    assert run.events[0].t - 3.0 == pytest.approx(-0.062, abs=5e-4)


def test_contact_is_the_limit_of_a_stiff_mesh() -> None:
    """Two bodies with a stiff, damped mesh instead of rigid flanks: the same opening and pick-up."""
    d = Drive(**SOFT, rule="contact")
    motor, table = d.eta * d.b, (1.0 - d.eta) * d.b
    stiff, damp = 4e5, 200.0

    def force(y: np.ndarray) -> float:
        deep = abs(y[2] - y[0]) - 0.5 * d.gap
        side = math.copysign(1.0, y[2] - y[0])
        return 0.0 if deep <= 0.0 else side * max(stiff * deep + side * damp * (y[3] - y[1]), 0.0)

    def rate(t: float, y: np.ndarray) -> list[float]:
        u, T = 0.01 * math.sin(8.0 * t) - y[0], force(y)
        return [
            y[1],
            (T - (d.c - d.eta * d.beta * d.b) * y[1]) / table,
            y[3],
            (u - T) / motor - d.beta * y[3],
        ]

    period, end = 1e-3, 0.4
    t = period * np.arange(round(end / period) + 1)
    stiff_run = solve_ivp(
        rate,
        (0.0, end),
        [0.0, 0.0, 0.5 * d.gap, 0.0],
        method="LSODA",
        t_eval=t,
        rtol=1e-9,
        atol=1e-12,
        max_step=2e-4,
    )
    run = simulate_axis(d, 0.01 * np.sin(8.0 * t), period)
    assert [event.kind for event in run.events] == ["opens", "picks up"]
    # The mesh yields by u / stiff, 1e-8 m, and takes damp / stiff = 0.5 ms to do so.
    assert run.table == pytest.approx(stiff_run.y[0], abs=5e-6)
    assert run.motor == pytest.approx(stiff_run.y[2], abs=5e-6)


@pytest.mark.parametrize("rule", ["standstill", "momentum", "contact"])
def test_cutting_the_steps_finer_changes_nothing(rule: str) -> None:
    t = 2e-3 * np.arange(401)
    command = 0.01 * np.sin(9.0 * t) + 0.004 * np.sin(23.0 * t)
    drive = Drive(**SOFT, rule=rule, ki=1.0, kd=0.01, coulomb=(1e-4, 2e-4), delay=0.7e-3)
    coarse, fine = (simulate_axis(drive, command, 2e-3, refine=refine) for refine in (1, 3))
    assert [event.kind for event in coarse.events] == [event.kind for event in fine.events]
    assert coarse.table == pytest.approx(fine.table, abs=1e-11)


def test_motor_that_turns_back_meets_the_old_flank() -> None:
    """A command that turns twice within the time the motor needs for the gap."""
    t = 2e-3 * np.arange(401)
    command = np.interp(t, [0.0, 0.3, 0.35, 0.4, 0.8], [0.0, 0.015, 0.012, 0.015, 0.03])
    drive = Drive(**{**SOFT, "gap": 2e-2})
    run = simulate_axis(drive, command, 2e-3)
    assert [event.kind for event in run.events][:2] == ["opens", "falls back"]
    opened, closed = run.events[0].t, run.events[1].t
    inside = (t > opened) & (t < closed)
    assert np.ptp(run.table[inside]) == 0.0
    assert np.all(run.motor[inside] - run.table[inside] < 1e-2)


def test_momentum_starts_with_the_motors_part() -> None:
    """v = η w after a plastic pick-up: table speed just after, motor speed just before."""
    still, kept = (swing(2e-3, 3.2, Drive.from_constants(**PAPER, rule=rule)) for rule in ("standstill", "momentum"))
    assert still.events[1] == kept.events[1]
    k = math.floor(kept.events[1].t / 2e-3)
    w = (kept.motor[k] - kept.motor[k - 1]) / 2e-3
    v = (kept.table[k + 2] - kept.table[k + 1]) / 2e-3
    assert v / w == pytest.approx(0.35, rel=0.15)  # both change within the samples
    assert abs(still.table[k + 2] - still.table[k + 1]) < 0.5 * abs(v) * 2e-3


def test_friction_holds_until_the_error_exceeds_it() -> None:
    """A ramp of 10 mm/s: the table slips when the command is ahead by F, and not before."""
    t = 1e-3 * np.arange(801)
    drive = Drive(**{**SOFT, "gap": 0.0}, coulomb=(5e-4, 5e-4), static=3e-4)
    run = simulate_axis(drive, 0.01 * t, 1e-3)
    assert run.events[0].kind == "slips"
    assert run.events[0].t == pytest.approx(0.08, abs=1e-12)
    # Moving steadily it follows by c v + F.
    assert 0.01 * t[-1] - run.table[-1] == pytest.approx(0.05 * 0.01 + 5e-4, abs=1e-8)


def test_table_slides_to_rest_in_the_gap_under_friction() -> None:
    """(1 - η) b v̇ = -F - c' v: the table stops after ln(1 + c' v / F) (1 - η) b / c'."""
    drive = Drive(b=4e-4, c=0.05, gap=0.2, eta=0.4, beta=2.0, rule="contact", coulomb=(1e-3, 1e-3))
    run = simulate_axis(drive, np.full(20, -0.05), 1e-3, position=0.0, speed=0.1)
    assert [event.kind for event in run.events] == ["opens", "sticks"]
    assert run.events[0].t == 0.0
    damping = 0.05 - 0.4 * 2.0 * 4e-4
    constant = 0.6 * 4e-4 / damping
    assert run.events[1].t == pytest.approx(constant * math.log1p(damping * 0.1 / 1e-3), abs=1e-11)
    way = constant * (0.1 - 1e-3 / damping * math.log1p(damping * 0.1 / 1e-3))
    assert run.table[-1] == pytest.approx(way, abs=1e-12)


@pytest.mark.slow
def test_load_is_held_by_an_error() -> None:
    """With nothing commanded the table sinks until the controller holds the load; PI takes it all out."""
    rest = np.zeros(1501)
    sunk = simulate_axis(Drive(**SOFT, load=2e-4), rest, 1e-3)
    assert sunk.table[-1] == pytest.approx(-2e-4, abs=1e-10)
    assert sunk.events == []
    held = simulate_axis(Drive(**SOFT, load=2e-4, ki=5.0), np.zeros(4001), 1e-3)
    assert held.table[-1] == pytest.approx(0.0, abs=1e-9)


def test_load_pulls_the_table_across_the_gap_behind_the_motor() -> None:
    """A load towards minus keeps the table on the flank from which it hangs: the gap never opens."""
    t = 2e-3 * np.arange(401)
    run = simulate_axis(Drive(**SOFT, load=5e-3, rule="contact"), 0.01 * np.sin(9.0 * t), 2e-3)
    assert run.events == []
    free = simulate_axis(Drive(**SOFT, rule="contact"), 0.01 * np.sin(9.0 * t), 2e-3)
    assert len(free.events) > 3


def test_saturated_motor_accelerates_as_it_can() -> None:
    """b v̇ + c v = U from rest."""
    command = np.full(101, 0.5)
    command[0] = 0.0
    t = 1e-3 * np.arange(101)
    run = simulate_axis(Drive(b=4e-4, c=0.05, gap=0.0, saturation=1e-3), command, 1e-3)
    # The first millisecond ramps up to 0.5 m: the limit is reached within 2 µs.
    ideal = 1e-3 / 0.05 * (t - 4e-4 / 0.05 * -np.expm1(-0.05 / 4e-4 * t))
    assert run.table == pytest.approx(ideal, abs=5e-8)


@pytest.mark.parametrize("feedback", ["load", "motor"])
def test_delay_shifts_the_command(feedback: str) -> None:
    t = 2e-3 * np.arange(201)
    command = 0.01 * np.sin(9.0 * t)
    late = simulate_axis(Drive(**SOFT, feedback=feedback, delay=10e-3), command, 2e-3)
    shifted = simulate_axis(Drive(**SOFT, feedback=feedback), np.concatenate([np.zeros(5), command]), 2e-3)
    assert late.table == pytest.approx(shifted.table[:-5], abs=1e-12)


def play(motor: np.ndarray, half: float, flank: int) -> np.ndarray:
    """The play operator: the table is moved only by a flank."""
    x = [motor[0] - flank * half]
    for m in motor[1:]:
        x.append(min(max(x[-1], m - half), m + half))
    return np.array(x)


def test_motor_loop_is_a_servo_and_a_play() -> None:
    t = 1e-3 * np.arange(801)
    command = 0.01 * np.sin(9.0 * t)
    drive = Drive(**SOFT, feedback="motor")
    run = simulate_axis(drive, command, 1e-3, flank=-1)
    rigid = simulate_axis(Drive(**{**SOFT, "gap": 0.0}), command, 1e-3)
    assert run.motor == pytest.approx(rigid.table, abs=1e-12)
    dense = np.interp(np.linspace(0.0, 0.8, 80_001), t, run.motor)
    # Chords of the motor's motion miss its extremes by h²/8 times its acceleration, 1 m/s².
    assert run.table == pytest.approx(play(dense, 5e-4, -1)[::100], abs=2e-7)
    assert [event.kind for event in run.events][:3] == ["opens", "picks up", "opens"]


def test_stepper_is_a_play() -> None:
    t = 5e-3 * np.arange(201)
    command = 0.003 * np.sin(9.0 * t) + 0.001 * np.sin(31.0 * t)
    drive = Drive(b=0.0, c=0.0, gap=1e-3, feedback="none")
    run = simulate_axis(drive, command, 5e-3)
    assert np.all(run.motor == command)
    assert run.table == pytest.approx(play(command, 5e-4, 1), abs=1e-15)
