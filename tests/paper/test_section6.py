"""Sections 5.3 and 6 of the paper: its simulation, numbers and figures; and the whole machine's answer."""

from __future__ import annotations

import math

import numpy as np
import pytest
from msgspec.structs import replace
from scipy.integrate import solve_ivp
from support.drives import AMPLITUDE, OMEGA, PAPER_GAP, PAPER_SERVO, axis

from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError, SolveError
from ph_post.report import paper_figures
from ph_post.report.paper import (
    error_in_papers_mode,
    error_on_whole_machine,
    positions_along,
    run_in_papers_mode,
    section_6_profile,
)
from ph_post.simulate.paper_mode import radial_deviation, radial_error, simulate_turning_point
from ph_post.types import Servo

B, C_LOOP, GAIN, BETA, GAP = 0.0005, 0.005, 25.0 / (0.35 * 0.0005), 1.0, 0.125664
T_STAR = 0.5


def angle(ratio: float, t: float) -> float:
    """Θ(t) of Eq. (29) for n = 10 and f of section 6, the integral of V written out by hand.

    V/V_c = 1 - (1 - f) 252 τ⁵ (1 - τ)⁵, whose integral from ½ is elementary.
    """
    f = (256.0 * ratio - 193.0) / 63.0
    tau = (min(max(t, -T_STAR), T_STAR) + T_STAR) / (2.0 * T_STAR)
    z = tau - 0.5  # τ(1 - τ) = ¼ - z²
    powers = (math.comb(5, k) * 0.25 ** (5 - k) * (-z * z) ** k * z / (2 * k + 1) for k in range(6))
    inside = 2.0 * T_STAR * (z - (1.0 - f) * 252.0 * math.fsum(powers))
    return OMEGA * (inside + t - min(max(t, -T_STAR), T_STAR))


def command(ratio: float, t: float) -> tuple[float, float]:
    """Eq. (30)."""
    theta = angle(ratio, t)
    return AMPLITUDE * (math.cos(theta) - 1.0), AMPLITUDE * math.sin(theta)


def integrate(rate, start, end, state, times, event=None):
    """Integrate over [start, end]."""
    return solve_ivp(
        rate,
        (start, end),
        state,
        method="DOP853",
        rtol=1e-11,
        atol=1e-14,
        t_eval=times,
        events=event,
        max_step=0.01,
    )


def reference(ratio: float, times: np.ndarray, pickup: float | None = None) -> tuple[np.ndarray, float, float]:
    """Section 5.3 by scipy: x, y at `times`; the Δt of Eq. (32), and its growth per metre of x_i.

    x is picked up at Δt, or else at `pickup`. An error δ of x_i turns the motor by C δ Δt²/2 at Δt.
    """

    def loops(t, z):
        X, Y = command(ratio, t)
        return [z[1], (X - z[0] - C_LOOP * z[1]) / B, z[3], (Y - z[2] - C_LOOP * z[3]) / B]

    def motor(t, z):
        return [GAIN * (command(ratio, t)[0] - x_i) - BETA * z[0], z[0]]

    def crosses(_t, z):
        return abs(z[1]) - GAP

    crosses.terminal = True
    first = float(times[0])
    V_c, start = AMPLITUDE * OMEGA, angle(ratio, first)
    X, Y = command(ratio, first)
    until = times[times <= 0.0]
    before = integrate(loops, first, 0.0, [X, -V_c * math.sin(start), Y, V_c * math.cos(start)], until)
    x_i = before.y[0, -1]
    crossing = integrate(motor, 0.0, 2.0, [0.0, 0.0], None, crosses)
    duration = float(crossing.t_events[0][0])
    sensitivity = GAIN * duration**2 / 2.0 / abs(float(crossing.y_events[0][0][0]))
    closes = duration if pickup is None else pickup
    between = times[(times > 0.0) & (times < closes)]
    after = times[times >= closes]
    whole = integrate(loops, 0.0, float(times[-1]), before.y[:, -1], np.concatenate([between, after]))
    free = integrate(loops, closes, float(times[-1]), [x_i, 0.0, 0.0, 0.0], after)
    x = np.concatenate([before.y[0], np.full(between.size, x_i), free.y[0]])
    return np.stack([x, np.concatenate([before.y[2], whole.y[2]])], axis=1), duration, sensitivity


@pytest.mark.parametrize("ratio", [1.0, 0.25, -0.4])
def test_section_5_3_against_scipy(ratio: float) -> None:
    """Only the command's chords over δt differ: X'' δt²/8, and twice that where the loop overshoots.

    X'' is at most max |V'| + V²/ρ_0; V' of the profile is steepest in its flanks.
    """
    run = run_in_papers_mode(ratio)
    expected, duration, sensitivity = reference(ratio, run.t, run.pickup)
    feed = np.gradient([AMPLITUDE * angle(ratio, t) for t in np.linspace(-0.6, 0.6, 2401)], 0.0005)
    bend = np.abs(np.gradient(feed, 0.0005)).max() + feed.max() ** 2 / AMPLITUDE
    chord = bend * 0.001**2 / 8.0
    assert np.abs(run.executed - expected).max() <= 2.0 * chord
    assert run.commanded == pytest.approx(np.array([command(ratio, t) for t in run.t.tolist()]), abs=1e-14)
    assert run.duration == pytest.approx(duration, abs=2.0 * chord * sensitivity)
    assert 0.0 <= run.pickup - run.duration < 0.001
    assert run.pickup == pytest.approx(round(run.pickup, 3), abs=1e-12)


def test_without_steps_the_error_is_one_percent_less() -> None:
    """What δt does in section 6: the pick-up waits for the next sample."""
    run = run_in_papers_mode(1.0)
    exact, _, _ = reference(1.0, run.t)
    inside = np.abs(run.t) <= T_STAR
    largest = np.abs(np.hypot(exact[inside, 0] + AMPLITUDE, exact[inside, 1]) / AMPLITUDE - 1.0).max()
    stepped = radial_error(run.t, run.executed, AMPLITUDE, T_STAR).max
    assert 1.005 < stepped / largest < 1.015


@pytest.mark.parametrize(
    ("ratio", "largest", "rms"),
    [(1.0, 2.19e-3, 6.17e-4), (0.25, 1.36e-3, 3.86e-4), (-0.4, 2.0e-4, None), (-0.45, 2.7e-4, None)],
)
def test_errors_of_figure_11(ratio: float, largest: float, rms: float | None) -> None:
    error = error_in_papers_mode(ratio)
    assert error.max == pytest.approx(largest, rel=0.02)
    if rms is not None:
        assert error.rms == pytest.approx(rms, rel=0.02)


@pytest.mark.parametrize(
    ("ratio", "largest"),
    [(1.0, 2.19e-3), (0.25, 1.36e-3), (-0.3, 1.05e-3), (-0.4, 2.09e-3), (-0.45, 2.76e-3)],
)
def test_the_whole_machine_takes_the_retrograde_gain_away(ratio: float, largest: float) -> None:
    """Where the gap opens at every reversal of either axis, for the same command and the same drives."""
    assert error_on_whole_machine(ratio).max == pytest.approx(largest, rel=0.03)


def test_shape_of_figure_11() -> None:
    """As section 6 tells it: a shallow minimum near 0.25, a deep one near -0.45, and worse beyond 1."""
    ratios = [-0.45, -0.15, 0.0, 0.25, 0.6, 1.0, 1.4]
    rms = {ratio: error_in_papers_mode(ratio).rms for ratio in ratios}
    assert rms[0.25] < min(rms[0.0], rms[0.6]) < rms[1.0] < rms[1.4]
    assert rms[-0.45] < 0.4 * rms[0.25] < rms[-0.15]


def test_the_axes_start_on_the_path() -> None:
    """ERRATA: x(-T_star) = ρ_0 (1 - cos Θ_star) is printed; Eq. (30) has the other sign."""
    run = run_in_papers_mode(0.25)
    assert run.executed[0] == pytest.approx((-AMPLITUDE, -AMPLITUDE), abs=1e-15)
    assert run.commanded[0] == pytest.approx((-AMPLITUDE, -AMPLITUDE), abs=1e-15)


def test_only_x_stands_and_only_once() -> None:
    run = run_in_papers_mode(1.0)
    still = np.flatnonzero(np.diff(run.executed[:, 0]) == 0.0)
    assert run.t[still[[0, -1]]] == pytest.approx((0.0, run.pickup - 0.001), abs=1e-12)
    assert np.array_equal(still, np.arange(still[0], still[-1] + 1))


def test_a_closed_gap_leaves_the_servo_lag_alone() -> None:
    closed = axis(gap=replace(PAPER_GAP, lost_motion=0.0, motor_angle=0.0))
    given = section_6_profile(1.0)
    run = simulate_turning_point(closed, positions_along(given), given.cruise * np.array([1.0, 0.0]), 3.0)
    assert (run.duration, run.pickup) == (0.0, 0.0)
    settled = np.abs(run.t) <= T_STAR
    # steady motion of amplitude |p, q| on both axes: a circle, larger by the loop's resonance alone
    steady = 1.0 / math.hypot(1.0 - B * OMEGA**2, C_LOOP * OMEGA) - 1.0
    assert radial_deviation(run.executed[settled], AMPLITUDE) == pytest.approx(steady, abs=1e-7)


def test_what_the_papers_mode_refuses() -> None:
    positions, speed = positions_along(section_6_profile(1.0)), np.array([0.13, 0.0])
    with pytest.raises(InputError, match=r"axes\.X\.control: the paper's mode knows no integrator"):
        simulate_turning_point(axis(servo=Servo(b=B, c=C_LOOP, ki_over_kp=1.0)), positions, speed, 3.0)
    wide = axis(gap=replace(PAPER_GAP, lost_motion=0.5, motor_angle=1e5))
    with pytest.raises(SolveError, match="does not cross the backlash"):
        simulate_turning_point(wide, positions, speed, 3.0)


def line(figure, label: str, panel: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Data of a curve."""
    found = next(curve for curve in figure.axes[panel].lines if curve.get_label() == label)
    return np.asarray(found.get_xdata()), np.asarray(found.get_ydata())


def test_figure_5_stands_for_the_printed_time() -> None:
    figure = paper_figures.draw_figure_5()
    t, x = line(figure, "backlash")
    assert t[-1] - t[0] == pytest.approx(0.118743, abs=1e-6)
    assert t[0] == pytest.approx(3.005001, abs=1e-6)
    assert np.all(x == x[0])
    commanded = line(figure, "commanded")
    assert commanded[1] == pytest.approx(AMPLITUDE * np.sin(OMEGA * commanded[0]), abs=1e-15)
    colours = {curve.get_label(): curve.get_color() for curve in figure.axes[0].lines}
    assert (colours["commanded"], colours["executed"], colours["backlash"]) == ("red", "blue", "cyan")


def test_figure_6_magnifies_the_radial_error() -> None:
    """At pick-up the commanded circle has fallen a (1 - cos Ω(lag + Δt)) behind the standing x."""
    x, y = line(paper_figures.draw_figure_6(), "backlash")
    run_x, run_y = 0.25003341707, -AMPLITUDE * math.sin(OMEGA * 0.118743)
    error = math.hypot(run_x, run_y) - AMPLITUDE
    assert math.hypot(x[-1], y[-1]) - AMPLITUDE == pytest.approx(25.0 * error, rel=5e-3)
    assert math.atan2(y[-1], x[-1]) == pytest.approx(math.atan2(run_y, run_x), rel=5e-3)


def test_figure_7_falls_with_the_time_between_reversals() -> None:
    (curve,) = paper_figures.draw_figure_7().axes[0].lines
    periods, travel = np.asarray(curve.get_xdata()), np.asarray(curve.get_ydata())
    assert np.all(np.diff(travel) < 0.0)
    # V Δt of the example, T = 6 s, but for the bend of the circle
    assert np.interp(6.0, periods, travel) == pytest.approx(math.pi * AMPLITUDE / 6.0 * 0.118743, rel=1e-3)


def test_figure_8_has_the_printed_minima() -> None:
    for colour, lowest in (("blue", (5.0 - 3.0 * 1.5) / 8.0), ("red", (193.0 - 63.0 * 2.8) / 256.0)):
        curve = next(c for c in paper_figures.draw_figure_8().axes[0].lines if c.get_color() == colour)
        assert min(curve.get_ydata()) == pytest.approx(lowest, abs=1e-12)


def test_figures_9_and_10_show_the_three_depths() -> None:
    figure = paper_figures.draw_figure_9()
    spread = []
    for panel in range(3):
        x, y = line(figure, "executed, error x 25", panel)
        spread.append(np.abs(np.hypot(x + AMPLITUDE, y) - AMPLITUDE).max() / 25.0 / AMPLITUDE)
    assert spread[0] == pytest.approx(2.19e-3, rel=0.02)
    assert spread[1] == pytest.approx(1.36e-3, rel=0.02)
    assert spread[2] < spread[0] / 5.0  # "barely noticeable at the scale of the plot"
    _, y = line(paper_figures.draw_figure_10(), "commanded")
    assert np.diff(y).min() < 0.0 < np.diff(y).max()  # back and forth


def test_figure_11_has_both_modes(monkeypatch) -> None:
    monkeypatch.setattr(paper_figures, "RATIOS", np.array([-0.4, 1.0]))
    left, right = paper_figures.draw_figure_11().axes
    assert left.lines[0].get_ydata() == pytest.approx([2.0e-4, 2.19e-3], rel=0.02)
    assert right.lines[0].get_ydata() == pytest.approx([2.09e-3, 2.19e-3], rel=0.03)
    assert [curve.get_color() for curve in left.lines[:2]] == ["red", "blue"]


def test_the_shipped_machine_is_the_papers() -> None:
    shipped = read_machine("paper").axes["X"]
    assert shipped.servo == PAPER_SERVO
    assert shipped.gap.motor_angle == GAP
