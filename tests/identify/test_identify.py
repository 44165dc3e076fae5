"""Drives identified from records of hidden plants, whose equations are integrated by scipy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from ph_post.errors import InputError
from ph_post.identify.identify import identify
from ph_post.types import AxisLog, Log
from tests.support.identifying import Recorder, off, one_way, to_and_fro, truth
from tests.support.measured import EMPS, needs_emps
from tests.support.plants.axis import Hidden, Plant
from tests.support.plants.tracks import Track

PRODUCT = "lost_motion_times_inertia_fraction"
LOAD = Plant("load", 1.5e-4, 8e-3, gap=3e-5, eta=0.55, beta=8.0)
MOTOR = Plant("motor", 1.5e-4, 8e-3, gap=3e-5)

FINE = Plant("motor", 1.5e-5, 4e-3, gap=2e-5)
LADDER = to_and_fro(np.random.default_rng(1), 4)


def record(plant: Plant, *channels: str, seed: int = 1, track: Track | None = None, **how: object) -> Log:
    rng = np.random.default_rng(seed)
    track = to_and_fro(rng) if track is None else track
    return Recorder(channels, rng, **how).record(plant, track)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("plant", "channels", "names"),
    [
        (MOTOR, ("act", "motor"), {"b", "c", "lost_motion"}),
        (MOTOR, ("act",), {"b", "c", "lost_motion"}),
        (MOTOR, ("act", "motor", "force"), {"b", "c", "lost_motion", "servo_stiffness"}),
        (LOAD, ("act", "motor"), {"b", "c", "lost_motion", "inertia_fraction", "motor_time_constant"}),
    ],
)
@pytest.mark.thinned(8)
def test_a_drive_is_found_within_its_standard_errors(plant, channels, names) -> None:
    track = to_and_fro(np.random.default_rng(1), 8)
    drive = identify(record(plant, *channels, track=track), None, {"X": plant.feedback}).drives["X"]
    assert set(drive.parameters) == names
    true = truth(plant)
    for name, one in drive.parameters.items():
        assert abs(off(one, true[name])) < 3.0, name
        assert one.value == pytest.approx(true[name], rel=0.2 if name == "motor_time_constant" else 0.02), name
    assert drive.rms == pytest.approx(drive.noise, rel=0.1)
    assert drive.sensitivity.rank == len(drive.sensitivity.names)


@pytest.mark.slow
def test_standard_errors_are_calibrated_on_motor_loops() -> None:
    """Over 12 hidden motors the squared errors, in standard errors, follow their chi-square."""
    rng = np.random.default_rng(20)
    squares = []
    for seed in range(12):
        b = float(np.exp(rng.uniform(np.log(6e-5), np.log(4e-4))))
        damping = float(rng.uniform(0.8, 1.6) * np.sqrt(b))
        plant = Plant("motor", b, damping, gap=float(rng.uniform(1e-5, 6e-5)))
        log = record(plant, "act", "motor", seed=seed, track=to_and_fro(rng, 2), noise=2e-6)
        found = identify(log, None, {"X": "motor"}).drives["X"].parameters
        squares += [off(found[name], truth(plant)[name]) ** 2 for name in ("b", "c", "lost_motion")]
    low, high = stats.chi2.ppf([0.001, 0.999], len(squares))
    assert low < sum(squares) < high


@pytest.mark.slow
def test_standard_errors_are_calibrated_on_load_loops() -> None:
    """By turns with one side read and with both; the flank that an axis begins on is not told."""
    rng = np.random.default_rng(4)
    squares = []
    for seed in range(10):
        b = float(np.exp(rng.uniform(np.log(6e-5), np.log(4e-4))))
        plant = Plant(
            "load",
            b,
            float(rng.uniform(0.8, 1.6) * np.sqrt(b)),
            gap=float(rng.uniform(1e-5, 6e-5)),
            eta=float(rng.uniform(0.3, 0.7)),
            beta=float(rng.uniform(0.5, 5.0)),
            flank=int(rng.choice([-1, 1])),
        )
        channels = ("act", "motor") if seed % 2 else ("act",)
        log = record(plant, *channels, seed=seed, track=to_and_fro(rng), noise=2e-6)
        found = identify(log, None, {"X": "load"}).drives["X"].parameters
        told = {name: one for name, one in found.items() if one.stderr is not None}
        assert {"b", "c", "lost_motion" if seed % 2 else PRODUCT} <= set(told)
        squares += [off(one, truth(plant)[name]) ** 2 for name, one in told.items()]
    low, high = stats.chi2.ppf([0.001, 0.999], len(squares))
    assert low < sum(squares) < high


def test_positions_on_one_side_show_the_product_of_a_load_loop_only() -> None:
    plant = replace(LOAD, beta=2.0)
    found = identify(record(plant, "act"), None, {"X": "load"})
    drive = found.drives["X"]
    assert abs(off(drive.parameters[PRODUCT], truth(plant)[PRODUCT])) < 3.0
    assert drive.parameters[PRODUCT].value == pytest.approx(truth(plant)[PRODUCT], rel=0.02)
    assert drive.parameters["lost_motion"].stderr is None
    assert "inertia_fraction" not in drive.parameters
    assert drive.origins["inertia_fraction"] == "assumed"
    assert drive.sensitivity.rank == 3
    hidden = next(one for one in drive.sensitivity.weak if "gap" in one)
    assert set(hidden) == {"gap", "eta"}
    assert hidden["gap"] == pytest.approx(-hidden["eta"], rel=1e-2)
    assert any("positions on one side of a load loop show only Δθ_m/C" in note for note in found.sentences)
    assert any("the log does not show β" in note for note in found.sentences)


def test_no_gap_is_invented_and_its_bound_is_told() -> None:
    plant = Plant("motor", 1.5e-4, 8e-3)
    found = identify(record(plant, "act", "motor"), None, {"X": "motor"})
    gap = found.drives["X"].parameters["lost_motion"]
    assert gap.value == 0.0
    assert gap.stderr is not None
    assert 0.0 < gap.stderr < 1e-3
    assert any("the log shows no backlash above" in note for note in found.sentences)


@pytest.mark.slow
def test_friction_is_not_taken_for_play() -> None:
    plant = Plant("load", 1.5e-4, 8e-3, effects=(Hidden("coulomb_friction", {"force": 2e-5}),))
    found = identify(record(plant, "act", "motor"), None, {"X": "load"})
    assert "lost_motion" not in found.drives["X"].parameters
    assert found.machine.axes["X"].gap.lost_motion == 0.0
    assert any("friction of" in note and "better than backlash" in note for note in found.sentences)


@pytest.mark.slow
def test_friction_and_play_that_noise_makes_alike_are_said_to_be() -> None:
    found = identify(record(FINE, "act", noise=2e-5, track=LADDER), None, {"X": "motor"})
    assert "lost_motion" in found.drives["X"].parameters
    assert any("would separate them" in note for note in found.sentences)


def test_without_a_reversal_no_gap_shows() -> None:
    found = identify(record(LOAD, "act", "motor", track=one_way()), None, {"X": "load"})
    assert "lost_motion" not in found.drives["X"].parameters
    assert "X: the log shows no backlash: the axis does not reverse" in found.sentences


@pytest.mark.parametrize(
    ("channels", "side", "words"),
    [
        (("motor",), "table", "behind the motor's loop only a reading of the table shows it"),
        (("act",), "unknown", "the reading may be the motor's, where friction looks like backlash"),
    ],
)
@pytest.mark.thinned(4)
def test_a_side_that_shows_no_gap_says_so(channels, side, words) -> None:
    found = identify(record(MOTOR, *channels, side=side), None, {"X": "motor"})
    assert "lost_motion" not in found.drives["X"].parameters
    assert f"X: the log shows no backlash: {words}" in found.sentences


def test_slow_motion_does_not_show_b() -> None:
    track = Track().rest(0.2)
    for _ in range(2):
        track.move((0.01, 0.0), 0.012, 0.03).move((-0.01, 0.0), 0.012, 0.03)
    plant = Plant("motor", 2e-5, 8e-3)
    found = identify(record(plant, "motor", track=track, noise=2e-5), None, {"X": "motor"})
    drive = found.drives["X"]
    assert "b" not in drive.parameters
    assert drive.origins["b"] == "assumed"
    assert abs(off(drive.parameters["c"], plant.c)) < 3.0
    assert (
        "X: b cannot be identified: the accelerations in the log are too small; its value is assumed" in found.sentences
    )


@pytest.mark.parametrize("table_too", [False, True])
@pytest.mark.thinned(4)
def test_a_coast_down_gives_beta_of_what_moves(table_too: bool) -> None:
    """The motor runs out as an exponential; with the table on it the rate is another one and is only told."""
    track = to_and_fro(np.random.default_rng(2)).move((0.1, 0.0), 0.05, 1.0)
    track.end -= 1.0  # in the middle of the last move, where its speed is constant
    plant = Plant("load", 1.5e-4, 8e-3, gap=3e-5, eta=0.55, beta=3.0)
    recorder = Recorder(("act", "motor"), np.random.default_rng(3))
    found = identify(recorder.coasting(plant, track, 1.5, table_too), None, {"X": "load"})
    drive = found.drives["X"]
    tau = drive.parameters["motor_time_constant"]
    if table_too:
        assert tau.stderr is not None
        assert tau.stderr > 1e-3  # that of the crossing
        assert any("coasts down at 3" in note and "together" in note for note in found.sentences)
    else:
        assert tau.value == pytest.approx(1.0 / plant.beta, rel=1e-4)
        assert abs(off(tau, 1.0 / plant.beta)) < 3.0
    for name in ("b", "c", "lost_motion", "inertia_fraction"):
        assert abs(off(drive.parameters[name], truth(plant)[name])) < 3.0, name


@pytest.mark.slow
def test_the_loop_is_assumed_from_what_was_read() -> None:
    for plant, channels, why in (
        (MOTOR, ("motor",), "only the motor was read"),
        (MOTOR, ("act", "motor"), "the motor follows the command more closely than the table"),
        (LOAD, ("act", "motor"), "the table follows the command more closely than the motor"),
    ):
        found = identify(record(plant, *channels))
        assert found.machine.axes["X"].feedback == plant.feedback
        assert any(f'feedback "{plant.feedback}" is assumed: {why}' in note for note in found.sentences)


def test_an_ideal_stepper_has_neither_b_nor_c() -> None:
    command = to_and_fro(np.random.default_rng(1))
    t = np.arange(round(command.end / 1e-3) + 1) * 1e-3
    X = np.array([command.command(0)(at) for at in t.tolist()])
    noise = 3e-7 * np.random.default_rng(2).standard_normal(t.size)
    log = Log(name="stepper", t=t, period=1e-3, axes={"X": AxisLog(command=X, table=X + noise)})
    found = identify(log, None, {"X": "none"})
    assert (found.machine.axes["X"].servo.b, found.machine.axes["X"].servo.c) == (0.0, 0.0)


@pytest.mark.slow
def test_a_reading_that_leads_is_no_drive() -> None:
    short = Track().rest(0.1).move((0.004, 0.0), 0.04, 2.0).move((-0.004, 0.0), 0.04, 2.0).rest(0.1)
    log = record(MOTOR, "motor", track=short)
    axis = log.axes["X"]
    assert axis.motor is not None
    swapped = AxisLog(command=axis.motor, motor=axis.command)
    bad = Log(name="swapped", t=log.t, period=log.period, axes={"X": swapped})
    with pytest.raises(InputError, match="no reading that lags behind its command by its speed") as refusal:
        identify(bad, None, {"X": "motor"})
    assert str(refusal.value).startswith("swapped: X: ")


@pytest.mark.slow
@needs_emps
def test_the_measured_drive() -> None:
    """Published: mass 95.1 kg, K 1.3707 N/um, 203.5 N s/m of friction; a linear model misses about 7.2 um."""
    from scipy.io import loadmat

    data = loadmat(str(EMPS))
    t, command, motor, volts = (np.ravel(data[key]).astype(np.float64) for key in ("t", "qg", "qm", "vir"))
    axis = AxisLog(command=command, motor=motor, effort=35.15 * volts)
    drive = identify(Log(name="emps", t=t, period=1e-3, axes={"X": axis})).drives["X"]
    assert 6.5e-6 < drive.rms < 7.4e-6
    b, c, K = (drive.parameters[name] for name in ("b", "c", "servo_stiffness"))
    assert abs(off(b, 95.1 / 1.3707e6)) < 6.0  # friction that is not in the model pulls at it
    assert b.value == pytest.approx(95.1 / 1.3707e6, rel=0.15)
    assert c.value == pytest.approx(6.4e-3, rel=0.05)
    assert abs(off(K, 1370.7)) < 3.0
    assert any("the base model is incomplete" in note for note in drive.notes)
    assert "lost_motion" not in drive.parameters
