"""What is told of a record that was made with a known friction: where, on what evidence, what is left."""

from __future__ import annotations

import re
from functools import cache

import numpy as np
import pytest
from msgspec.structs import replace
from numpy.typing import NDArray
from scipy.io import matlab
from support.diagnoses import COULOMB as FOUND
from support.engine_cases import make_axis, make_machine
from support.residuals import MM, NOISE, PERIOD, UM, B, C, moved, servo, sweeps, white

from ph_post.diagnose.explanations import diagnosis_notes, explain, locate_residuals, propose_experiment
from ph_post.diagnose.findings import AxisDiagnosis, fit_chosen_model
from ph_post.diagnose.fit import base_model, fit_model, residuals_of
from ph_post.diagnose.hypotheses.forces import COULOMB
from ph_post.diagnose.residual_places import spectral_line
from ph_post.diagnose.search import with_part
from ph_post.diagnose.selection import ModelChoice, PartConfidence
from ph_post.diagnose.sentences import best_phrase, phrase
from ph_post.identify.free_run import problem_of
from ph_post.identify.log_quality import examine
from ph_post.types import AxisLog, Log, Machine
from ph_post.types.diagnosis import LogQuality, ResidualPlace
from tests.support.measured import EMPS, needs_emps

Array = NDArray[np.float64]
FRICTION = 7.0 * UM
ORIGIN = 50.0 * UM


def rubbing() -> tuple[Log, Machine, LogQuality]:
    """Return a loop with friction, b x'' + c x' + x = X - F sign(x'); c 1.5 % above the file's."""
    command = sweeps(30.0, 0.02, 0.06)
    m = moved(command, 0.0 * command)
    reading = servo(command - FRICTION * np.sign(m.v)) + ORIGIN + white(command.size, NOISE, 3)
    log = Log(name="test", t=m.t, period=PERIOD, axes={"X": AxisLog(command=command, table=reading)})
    machine = make_machine([make_axis("motor", B, C / 1.015, 0.0)], PERIOD)
    return log, machine, examine(log, machine)


def with_friction(log: Log, machine: Machine, quality: LogQuality, start: float) -> AxisDiagnosis:
    problem = problem_of(log, "X", machine.axes["X"], quality)
    assert problem is not None
    base = base_model(problem)
    stages = (
        fit_model(problem, base, problem.fit),
        fit_model(problem, with_part(base, COULOMB, (start,)), problem.fit),
    )
    standing = PartConfidence(rivals=(), confidence=0.99)
    return fit_chosen_model(ModelChoice(problem=problem, stages=stages, standings=(standing,)))


@cache
def told() -> tuple[Log, Machine, LogQuality, AxisDiagnosis]:
    log, machine, quality = rubbing()
    return log, machine, quality, with_friction(log, machine, quality, 5.0 * UM)


def test_where_and_evidence_of_a_known_friction() -> None:
    log, machine, quality, outcome = told()
    (one,) = explain(log, machine, quality, (outcome,))
    assert one.where == {"coulomb_friction": "wherever X moves, by its direction"}
    first, second, last = one.evidence["coulomb_friction"]
    sizes = [float(size) for size in re.findall(r"([\d.]+) µm behind", first)]
    assert sizes == pytest.approx([7.0, 7.0], abs=0.05)
    assert "not quite so" not in first
    assert second == "neither a second position nor a force was recorded that could confirm it"
    assert last.startswith("without it the model is ")


def test_places_before_and_after() -> None:
    """Before, the lag by direction and what c lags more; afterwards nothing but noise."""
    log, machine, _, outcome = told()
    before = locate_residuals(
        log, machine, (outcome,), (residuals_of(outcome.choice.problem, base_model(outcome.choice.problem)),)
    )
    assert {"direction", "speed"} <= {place.by for place in before}
    assert locate_residuals(log, machine, (outcome,), (outcome.fitted.left,)) == ()


def test_the_axis_with_most_of_it_comes_first() -> None:
    log, machine, _, outcome = told()
    problem = outcome.choice.problem
    other = replace(
        outcome,
        choice=replace(outcome.choice, problem=replace(problem, axis=make_axis("motor", B, C, 0.0, name="Y"))),
    )
    both = replace(log, axes={**log.axes, "Y": log.axes["X"]})
    drives = replace(machine, axes={**machine.axes, "Y": machine.axes["X"]})
    wave = np.sign(np.gradient(problem.command))
    found = locate_residuals(both, drives, (outcome, other), ({"act": 1.0 * UM * wave}, {"act": 2.0 * UM * wave}))
    assert found[0].axis == "Y"
    assert found[-1].axis == "X"


def test_notes_tell_base_values_origins_and_what_could_not_show() -> None:
    log, _, _, outcome = told()
    base, origin, barred = diagnosis_notes(log, (outcome,), (), "named")
    (by,) = re.fullmatch(
        r"base values of X by the log: c is ([\d.]+) % larger, within the 2 % of the file", base
    ).groups()  # type: ignore[union-attr]
    assert float(by) == pytest.approx(1.5, abs=0.05)
    listed = "readings with another origin than the command, which was left free: X_act by "
    assert origin.startswith(listed)
    assert float(origin.removeprefix(listed).removesuffix(" µm")) == pytest.approx(50.0, abs=0.1)
    assert barred.startswith("this log could not have shown: load offset (needs a force or current channel)")


def test_nothing_is_said_of_a_model_that_is_unknown() -> None:
    log, _, _, outcome = told()
    assert not any("base values" in note for note in diagnosis_notes(log, (outcome,), (), "unknown"))


def test_what_is_left_is_told_in_times_the_noise() -> None:
    log, _, _, outcome = told()
    more = outcome.fitted.left["act"] + 5.0 * UM * np.sin(100.0 * log.t)
    rest = replace(outcome, fitted=replace(outcome.fitted, left={"act": more}))
    place = ResidualPlace(axis="X", by="speed", share=0.5, value=0.1, sentence="half of it lies somewhere")
    first, *_ = diagnosis_notes(log, (rest,), (place,), "named")
    found = re.fullmatch(
        r"what is left of X_act, ([\d.]+) µm rms, is ([\d.]+) times its noise: half of it lies somewhere",
        first,
    )
    assert found is not None
    size = np.hypot(5.0 / np.sqrt(2.0), NOISE / UM)
    assert float(found[1]) == pytest.approx(size, abs=0.02)
    noise = outcome.choice.problem.observed[0].noise / UM
    assert float(found[2]) == pytest.approx(size / noise, rel=0.05)


def test_the_next_experiment() -> None:
    log, machine, _, _ = told()
    assert propose_experiment(log, machine, "named", (FOUND,)) is None
    doubtful = replace(FOUND, ambiguous_with=("backlash",))
    apart = propose_experiment(log, machine, "ambiguous", (FOUND, doubtful))
    assert apart is not None
    assert apart.name == "coulomb_friction_or_backlash_x"
    for verdict in ("unknown", "not-identifiable"):
        mix = propose_experiment(log, machine, verdict, ())
        assert mix is not None
        assert mix.name == "mix_x"


def test_no_experiment_where_nothing_may_move() -> None:
    log, machine, _, _ = told()
    still = replace(log, axes={"X": replace(log.axes["X"], command=0.0 * log.t)})
    assert propose_experiment(still, machine, "not-identifiable", ()) is None


def test_a_hum_has_its_frequency() -> None:
    t = PERIOD * np.arange(20_000)
    counted = t > 0.5
    hum = 2.0 * UM * np.sin(2.0 * np.pi * 49.7 * t + 0.3) + white(t.size, NOISE, 1)
    (place,) = spectral_line("X", hum, counted, NOISE, PERIOD)
    assert place.value == pytest.approx(49.7, abs=0.02)
    assert place.share == pytest.approx(1.0, abs=0.02)
    assert place.sentence.endswith("of the excess is at 49.7 Hz, whatever the axis does")
    assert list(spectral_line("X", white(t.size, NOISE, 1), counted, 0.5 * NOISE, PERIOD)) == []


EXCESS = "80 % of the excess"
PHRASES = {
    "within 40 ms after X reversals": (
        "reversal",
        0.04,
        "lies within 40 ms after X reversals, 12 % of the samples; equal both ways",
    ),
    "at speeds up to 10.6 mm/s": ("speed", 0.0106, "lies at speeds up to 10.6 mm/s, 39 % of the samples"),
    "at X -3 to 12.5 mm": ("position", 0.0, "lies where X is -3 mm to 12.5 mm, 9 % of the samples"),
    "everywhere in proportion to the speed of X": (
        "speed",
        1e-4,
        "is in proportion to the velocity: 0.386 ms behind the model",
    ),
    "everywhere in proportion to the speed of X, differently each way": (
        "speed",
        1e-4,
        "is in proportion to the velocity, differently each way: 1 ms times it to plus",
    ),
    "everywhere in proportion to the position of Y": (
        "position of Y",
        1e-4,
        "is in proportion to the position of Y: 0.741 µm per mm",
    ),
    "all along X, again and again every 5 mm": ("period", 5.0 * MM, "repeats every 5 mm of travel"),
    "everywhere, by the same amount": ("offset", 1e-6, "is an offset of 1 µm, always there"),
}


@pytest.mark.parametrize("words", PHRASES)
def test_places_in_a_phrase(words: str) -> None:
    by, value, sentence = PHRASES[words]
    place = ResidualPlace(axis="X", by=by, share=0.8, value=value, sentence=f"{EXCESS} {sentence}")
    assert phrase(place) == words


def test_the_phrase_is_of_what_the_effect_does_not_of_when_it_happened() -> None:
    lies, goes = (
        "lies from 1 s to 2 s, 4 % of the samples",
        "is in proportion to the acceleration: 1 µm per m/s²",
    )
    when = ResidualPlace(axis="X", by="time", share=0.9, value=1.0, sentence=f"{EXCESS} {lies}")
    how = ResidualPlace(axis="X", by="acceleration", share=0.4, value=1e-6, sentence=f"{EXCESS} {goes}")
    words = best_phrase("elastic_windup", "X", (when, how), {})
    assert words == "everywhere in proportion to the acceleration of X"
    assert best_phrase("elastic_windup", "X", (when,), {}) == "where X accelerates"
    assert best_phrase("somebody's own effect", "X", (), {}) == "in X"


@needs_emps
def test_the_measured_drive() -> None:
    """Published: friction of 20.39 N, a force that changes sign with it; K = 1.3707 N/µm makes it 14.9 µm."""
    data = matlab.loadmat(str(EMPS))
    t, command, motor, volts = (np.ravel(data[key]).astype(np.float64) for key in ("t", "qg", "qm", "vir"))
    axis = AxisLog(command=command, motor=motor, effort=35.15 * volts, effort_unit="N")
    log = Log(name="emps", t=t, period=PERIOD, axes={"X": axis})
    machine = make_machine([make_axis("motor", 95.1 / 1.3707e6, 6.39e-3, 0.0)], PERIOD)
    quality = examine(log, machine)
    outcome = with_friction(log, machine, quality, 10.0 * UM)
    (one,) = explain(log, machine, quality, (outcome,))
    lags, force, _ = one.evidence["coulomb_friction"]
    sizes = [float(size) for size in re.findall(r"X_motor is ([\d.]+) µm behind at .*, ([\d.]+) µm behind", lags)[0]]
    assert sizes == pytest.approx([14.9, 14.9], rel=0.03)
    step = re.search(r"the force channel steps by ([\d.]+) N where X reverses", force)
    assert step is not None
    assert float(step[1]) == pytest.approx(2.0 * 20.39, rel=0.03)
