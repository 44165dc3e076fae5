"""Backlash intervals over grids of β and C: against mpmath, against the scalar solution, and their files."""

from __future__ import annotations

import itertools
import json
import math
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest
from msgspec.structs import replace
from support.drives import AMPLITUDE, OMEGA, PAPER_GAP, PAPER_SERVO, Printed, axis
from support.front_door import run

from ph_post.drive import roots as closing
from ph_post.drive.backlash import motor_gap
from ph_post.drive.free_motor import ANGLE, SPEED, free_motor_response, free_motor_responses
from ph_post.drive.intervalfile import interval_content, read_intervals
from ph_post.drive.intervals import backlash_interval, look_up, tabulate
from ph_post.drive.machinefile import read_machine
from ph_post.drive.roots import close_brackets
from ph_post.drive.steady_state import find_orbit, steady_intervals, with_motor
from ph_post.errors import InputError, SolveError
from ph_post.types import Cascade, Gap, Servo

EPS = 2.0**-52
CIRCLE = str(Path(__file__).resolve().parents[2] / "paths" / "circle.json")


def test_responses_are_the_scalar_ones_on_every_branch() -> None:
    """Across y = 3 and w = 2, where the scalar code changes its recurrence."""
    beta = np.array([0.0, 1e-12, 0.3, 0.999, 1.0, 1.501, 30.0, 1e6])
    t = np.array([0.0, 1e-9, 0.01, 0.5, 1.9999, 2.0001, 3.0, 3.1416])
    for order in (SPEED, ANGLE):
        ours = free_motor_responses(order, beta[:, np.newaxis], t)
        for i, j in itertools.product(range(beta.size), range(t.size)):
            one = free_motor_response(order, float(beta[i]), 1.0, float(t[j]))
            for grid, value in zip(ours, one, strict=True):
                assert np.broadcast_to(grid, (beta.size, t.size))[i, j] == pytest.approx(value, rel=1e-13)


@pytest.mark.parametrize(("beta", "gain"), [(0.5, 5e4), (1.0, 1e6), (40.0, 142857.0), (3.0, 2e4)])
def test_durations_are_roots_of_the_printed_equations(beta: float, gain: float) -> None:
    """(19)-(22) at 50 digits, for some β and C of one grid."""
    betas, gains = np.array([0.5, 1.0, 3.0, 40.0]), np.array([2e4, 5e4, 142857.0, 1e6])
    grid = steady_intervals(PAPER_SERVO, PAPER_GAP, AMPLITUDE, OMEGA, betas, gains)
    i, j = betas.tolist().index(beta), gains.tolist().index(gain)
    with mp.workdps(50):
        reference = Printed(PAPER_SERVO.b, PAPER_SERVO.c, gain, beta, AMPLITUDE, OMEGA)
        half = mp.pi / reference.W / 2
        guess = (float(half + grid.lag[i, j]), grid.position[i, j], grid.duration[i, j])
        t_i, x_i, dt = reference.settled(0.125664, guess)
    assert grid.duration[i, j] == pytest.approx(float(dt), rel=16 * EPS)
    assert grid.lag[i, j] == pytest.approx(float(t_i - half), rel=64 * EPS)
    assert grid.position[i, j] == pytest.approx(float(x_i), rel=8 * EPS)


@pytest.mark.parametrize(
    ("servo", "amplitude", "omega"),
    [
        (PAPER_SERVO, AMPLITUDE, OMEGA),
        (Servo(b=0.0005, c=0.1, kd_over_kp=0.01), 0.005, 2.6),
        (Servo(b=0.0005, c=0.005, ki_over_kp=2.0), AMPLITUDE, OMEGA),
        (Servo(b=0.0005, c=0.005, ki_over_kp=2.0, kd_over_kp=0.01), 0.05, 3.0),
    ],
)
def test_grid_is_the_scalar_solution_pair_by_pair(servo: Servo, amplitude: float, omega: float) -> None:
    """Also in where there is no orbit: slow motors do not cross the gap within half a period."""
    betas, gains = np.array([0.0, 0.7, 30.0, 1e4]), np.geomspace(10.0, 1e7, 13)
    grid = steady_intervals(servo, PAPER_GAP, amplitude, omega, betas, gains)
    missing = 0
    for i, j in itertools.product(range(betas.size), range(gains.size)):
        gap = with_motor(servo, PAPER_GAP, float(betas[i]), float(gains[j]))
        orbit, _ = find_orbit(servo, gap, amplitude, omega)
        assert (orbit is None) == np.isnan(grid.duration[i, j])
        missing += orbit is None
        if orbit is not None:
            assert grid.duration[i, j] == pytest.approx(orbit.duration, rel=1e-13)
            assert grid.lag[i, j] == pytest.approx(orbit.lag, rel=1e-12)
            assert grid.position[i, j] == pytest.approx(orbit.position, rel=1e-13)
    assert 0 < missing < grid.duration.size


def test_no_gap_takes_no_time_and_a_useless_loop_has_no_orbit() -> None:
    grids = (np.array([0.0, 1.0]), np.array([1e4, 1e5]))
    closed = replace(PAPER_GAP, lost_motion=0.0, motor_angle=0.0)
    assert np.all(steady_intervals(PAPER_SERVO, closed, AMPLITUDE, OMEGA, *grids).duration == 0.0)
    unstable = Servo(b=0.0005, c=0.005, ki_over_kp=20.0)
    assert np.all(np.isnan(steady_intervals(unstable, PAPER_GAP, AMPLITUDE, OMEGA, *grids).duration))


def test_brackets_close_to_rounding_or_are_refused(monkeypatch) -> None:
    wanted = np.array([1e-9, 0.3, 1.0, 7.0])
    roots = close_brackets(lambda x, root: x**4 - root**4, np.zeros(4), np.full(4, 10.0), wanted)
    assert roots == pytest.approx(wanted, rel=8 * EPS)
    monkeypatch.setattr(closing, "STEPS", 3)
    low, high = np.array([0.0, 0.0, 0.0, 7.0]), np.full(4, 10.0)
    with pytest.raises(SolveError, match="3 of 4 roots did not close in 3 steps"):
        close_brackets(lambda x, root: np.sinh(x) - np.sinh(root), low, high, wanted)


def test_a_cascade_is_refused_with_what_takes_it() -> None:
    cascade = Cascade(position_gain=40.0, velocity_gain=250.0)
    machine = read_machine("paper")
    machine = replace(machine, axes={"X": replace(machine.axes["X"], servo=Servo(b=1e-4, c=0.025, cascade=cascade))})
    with pytest.raises(InputError, match=r"axes.X.control.structure: no table .*convert.* need no table"):
        tabulate(machine, ("X",), *(np.array([0.1]),) * 4)


def table_of(gap: Gap = PAPER_GAP, radius=(0.2, 0.25, 0.3), feed=(0.12, 0.13, 0.14)):
    machine = read_machine("paper")
    machine = replace(machine, axes={"X": axis(gap=gap), "Y": axis(gap=gap)})
    betas, gains = np.linspace(0.5, 2.0, 7), np.geomspace(1e5, 2e5, 8)
    return tabulate(machine, ("X",), np.array(radius), np.array(feed), betas, gains)


def test_a_node_is_looked_up_as_it_was_solved() -> None:
    table = table_of()
    motor = with_motor(PAPER_SERVO, PAPER_GAP, float(table.beta[2]), float(table.gain[5]))
    found, note = look_up(table, axis(gap=motor), 0.25, 0.13 / 0.25)
    solved, _ = backlash_interval(axis(gap=motor), 0.25, 0.13 / 0.25)
    assert note == ""
    assert found.duration == pytest.approx(solved.duration, rel=1e-12)
    assert found.lag == pytest.approx(solved.lag, rel=1e-12)
    assert found.position == pytest.approx(solved.position, rel=1e-12)


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.thinned(4)
def test_between_the_nodes_the_table_is_near_the_solution(seed: int) -> None:
    """Steps of 10 % in C and 20 % in the radius: ln Δt bends little, its error falls with their square."""
    rng = np.random.default_rng(seed)
    radius, feed, beta = rng.uniform(0.2, 0.3), rng.uniform(0.12, 0.14), rng.uniform(0.5, 2.0)
    motor = with_motor(PAPER_SERVO, PAPER_GAP, beta, rng.uniform(1e5, 2e5))
    found, _ = look_up(table_of(), axis(gap=motor), radius, feed / radius)
    solved, _ = backlash_interval(axis(gap=motor), radius, feed / radius)
    assert found.duration == pytest.approx(solved.duration, rel=2e-3)
    assert found.position == pytest.approx(solved.position, rel=1e-5)


def test_a_table_refuses_what_it_was_not_made_for() -> None:
    table = table_of()
    with pytest.raises(InputError, match=r"outside the table's radius; expected 200 to 300 mm; got 400 mm"):
        look_up(table, axis(), 0.4, 0.3)
    with pytest.raises(InputError, match="outside the table's beta"):
        look_up(table, axis(gap=with_motor(PAPER_SERVO, PAPER_GAP, 9.0, 1.5e5)), 0.25, 0.52)
    with pytest.raises(InputError, match=r"outside the table's C; expected 100000 to 200000 rad"):
        look_up(table, axis(gap=with_motor(PAPER_SERVO, PAPER_GAP, 1.0, 1e6)), 0.25, 0.52)
    with pytest.raises(InputError, match=r"another machine .*axes.X.c; expected 0.006; got 0.005"):
        look_up(table, axis(servo=Servo(b=0.0005, c=0.006)), 0.25, 0.52)
    wide = replace(PAPER_GAP, motor_angle=0.2, lost_motion=0.008)
    with pytest.raises(InputError, match=r"backlash_motor_rad; expected 0.2; got 0.125664"):
        look_up(table, axis(gap=wide), 0.25, 0.52)
    with pytest.raises(InputError, match="does not hold axis Y; expected Y; got X"):
        look_up(table, replace(axis(), name="Y"), 0.25, 0.52)


def test_a_place_without_an_orbit_says_so() -> None:
    motor = with_motor(PAPER_SERVO, PAPER_GAP, 1.0, 1.5e5)
    found, note = look_up(table_of(radius=(1e-4, 0.25)), axis(gap=motor), 1e-4, 1300.0)
    assert found is None
    assert "no interval" in note


def test_files_hold_the_table_to_the_last_digit(tmp_path: Path) -> None:
    table = table_of()
    file = tmp_path / "table.json"
    file.write_text(interval_content(table, file.name), encoding="utf-8")
    back = read_intervals(file)
    assert (back.machine, back.digest, back.name) == (table.machine, table.digest, str(file))
    assert np.array_equal(back.axes[0].duration, table.axes[0].duration)
    assert back.axes[0].servo == PAPER_SERVO
    assert np.array_equal(back.gain, table.gain)
    rows = interval_content(table, "table.csv").splitlines()
    assert rows[2].startswith("axis,radius_mm,feed_mm_min,beta_per_s,C_rad_per_m_s2,duration_s")
    assert len(rows) == 3 + table.axes[0].duration.size
    assert float(rows[3].split(",")[5]) == table.axes[0].duration.flat[0]
    with pytest.raises(InputError, match="unknown kind of interval table"):
        interval_content(table, "table.xls")


def test_sweep_has_the_contracts_keys_and_the_papers_number(capsys) -> None:
    """The paper's C by its own formula, N / (η r b)."""
    gain = 25.0 / (0.35 * 0.0005)
    status, out, err = run(capsys, "sweep", "-m", "paper", "--beta", "0,1", "--gain", f"1e5,{gain},1e-3", "--json")
    assert (status, err) == (0, "")
    view = json.loads(out)
    assert view["beta"] == [0.0, 1.0]
    assert view["C"] == [1e-3, 1e5, gain]
    assert view["duration"][1][2] == pytest.approx(0.11874297, abs=5e-9)
    assert [row[0] for row in view["duration"]] == [None, None]
    assert [table["axis"] for table in view["tables"]] == ["X", "Y"]
    assert view["tables"][0]["radius"] == pytest.approx(250.0, rel=1e-14)


QUICK = ("--effort", "0.01")
"""The search is not what these are about: both ways it is the same."""


@pytest.mark.slow
def test_convert_by_table_is_convert_by_solution(capsys, tmp_path: Path) -> None:
    table = str(tmp_path / "oval.json")
    grids = ("--beta", "1,2,3", "--gain", "1e7:4e7:40:log")
    assert run(capsys, "sweep", "oval", "-m", "mill", *grids, "-o", table) == (0, "", f"wrote {table}\n")
    plan = ("convert", "oval", "-m", "mill", *QUICK, "--json")
    solved = json.loads(run(capsys, *plan)[1])
    looked_up = json.loads(run(capsys, *plan, "--interval-table", table)[1])
    pairs = zip(solved["windows"], looked_up["windows"], strict=True)
    for one, other in pairs:
        assert other["backlash"]["duration"] == pytest.approx(one["backlash"]["duration"], rel=1e-5)
        assert other["profile"]["t_star"] == pytest.approx(one["profile"]["t_star"], rel=1e-5)


@pytest.mark.slow
def test_loops_closed_elsewhere_need_no_table(capsys, tmp_path: Path) -> None:
    """The router's gap lies behind its loops: no β or C in it, so it is solved as ever."""
    table = tmp_path / "paper.json"
    assert run(capsys, "sweep", "-m", "paper", "--beta", "1", "--gain", "1e5", "-o", str(table))[0] == 0
    plan = ("convert", "oval", "-m", "router", *QUICK, "--json")
    assert run(capsys, *plan, "--interval-table", str(table)) == run(capsys, *plan)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--beta", "", "--gain", "1"), "'--beta': expected low:high:count"),
        (("--beta", "-1:1:3", "--gain", "1"), "'--beta': expected numbers 0 or more; got -1"),
        (("--beta", "1", "--gain", "0:1:3"), "'--gain': expected numbers above 0; got 0"),
        (("--beta", "1", "--gain", "1:2:0"), "got '1:2:0'"),
        (("--beta", "1", "--gain", "0:2:4:log"), "got '0:2:4:log'"),
        (("--beta", "1", "--gain", "nan"), "above 0; got nan"),
        (("--beta", "1,1", "--gain", "1"), "expected each number once"),
        (("--beta", "1:2:1500", "--gain", "1:2:1500"), "expected at most 2000000 intervals"),
        (("--beta", "1", "--gain", "1", "--axis", "Q"), "paper: no axis Q; expected X or Y; got Q"),
        (("--beta", "1", "--gain", "1", "--radius", "5"), "--radius needs --feed"),
        (("--beta", "1", "--gain", "1", "--feed", "5"), "--feed needs --radius"),
        (("--beta", "1", "--gain", "1", "-o", "x.xls"), "unknown kind of interval table"),
        (("--beta", "1"), "Missing option '--gain'"),
    ],
)
def test_bad_requests_are_one_line_and_exit_2(capsys, monkeypatch, tmp_path, arguments, words) -> None:
    monkeypatch.chdir(tmp_path)
    status, out, err = run(capsys, "sweep", "-m", "paper", *arguments)
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert words in err
    assert list(tmp_path.iterdir()) == []


def test_machines_without_such_an_axis_are_refused(capsys) -> None:
    grids = ("--beta", "1", "--gain", "1")
    assert run(capsys, "sweep", "-m", "stepper", *grids) == (
        2,
        "",
        'ph-post: stepper: no interval of this machine depends on β or C; expected an axis with feedback "load"\n',
    )
    status, _, err = run(capsys, "sweep", "-m", "router", "--axis", "X", *grids)
    assert (status, err.count("\n")) == (2, 1)


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda text: text[: len(text) // 2], "not valid JSON"),
        (lambda text: text.replace('"beta"', '"betta"'), 'key "beta" is missing'),
        (lambda text: text.replace("0.125664", "-0.125664"), "axes.X.backlash_motor_rad: out of range"),
        (lambda text: text.replace("ph-post-interval-table", "ph-post-path"), "format: unknown value"),
        (lambda text: changed(text, beta=[]), "beta: the grid is empty"),
        (lambda text: changed(text, beta=[2, 1]), "beta: the grid is not ascending"),
        (lambda text: changed(text, C=[1e5, 1.5e5, 1.6e5]), "tables[0].lag: wrong count"),
        (lambda text: changed(text, tables=[]), "tables: the circles of axis X do not fill the grid"),
        (lambda text: text.replace('"lag"', '"lags"'), 'key "lag" is missing'),
        (lambda text: changed(text, C=[1e5, math.inf]), "not a number"),
    ],
)
def test_bad_tables_are_one_line_and_exit_2(capsys, tmp_path: Path, edit, words) -> None:
    table = tmp_path / "table.json"
    assert run(capsys, "sweep", "-m", "paper", "--beta", "1,2", "--gain", "1e5,2e5", "-o", str(table))[0] == 0
    table.write_text(edit(table.read_text(encoding="utf-8")), encoding="utf-8")
    status, out, err = run(capsys, "convert", CIRCLE, "-m", "paper", "--interval-table", str(table), "--json")
    assert (status, out, err.count("\n")) == (2, "", 1)
    assert words in err


def changed(text: str, **keys) -> str:
    return json.dumps({**json.loads(text), **keys})


def test_a_csv_table_is_not_read_back(capsys, tmp_path: Path) -> None:
    table = tmp_path / "table.csv"
    assert run(capsys, "sweep", "-m", "paper", "--beta", "1", "--gain", "1e5", "-o", str(table))[0] == 0
    status, _, err = run(capsys, "convert", CIRCLE, "-m", "paper", "--interval-table", str(table))
    assert (status, err.count("\n")) == (2, 1)
    assert "expected JSON, as sweep -o TABLE.json writes" in err


def test_the_gap_itself_is_kept() -> None:
    """Another C at the same Δθ_m and b is another η, and nothing else."""
    other = with_motor(PAPER_SERVO, PAPER_GAP, 2.0, 7e4)
    assert motor_gap(other) == motor_gap(PAPER_GAP)
    assert other.gear_ratio / (other.inertia_fraction * other.travel_per_rad * PAPER_SERVO.b) == pytest.approx(7e4)
