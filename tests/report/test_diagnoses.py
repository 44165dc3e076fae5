"""What is told about a diagnosis: the interface's JSON object, and lines that a machinist understands."""

import json
import math

import msgspec
import pytest
from msgspec.structs import replace
from support.diagnoses import BOTH_WAYS, COULOMB, LADDER, LOAD, STEPS, diagnosis, each_verdict

from ph_post.drive.effects.registry import CATALOGUE
from ph_post.report.diagnoses import diagnosis_lines, diagnosis_view
from ph_post.report.effect_words import estimate_words, finding_sentence, label_words, verdict_sentences
from ph_post.types.diagnosis import DroppedName, Estimate, ResidualStep

VERDICTS = ("named", "nothing-missing", "ambiguous", "unknown", "not-identifiable")


class EstimateObject(msgspec.Struct, forbid_unknown_fields=True):
    """INTERFACE §6, by hand: what every other program may rely on."""

    value: float | None
    stderr: float | None
    unit: str


class EffectObject(msgspec.Struct):
    name: str
    axis: str
    parameters: dict[str, EstimateObject]
    where: str
    confidence: float | None
    ambiguous_with: list[str]


class StepObject(msgspec.Struct, forbid_unknown_fields=True):
    added: str | None
    fit_rms: float | None
    holdout_rms: float | None


class GapObject(msgspec.Struct, forbid_unknown_fields=True):
    unit: str
    noise_floor: float | None
    steps: list[StepObject]


class ExperimentObject(msgspec.Struct, forbid_unknown_fields=True):
    name: str
    why: str
    record: list[str]
    program: str


class DiagnosisObject(msgspec.Struct):
    verdict: str
    effects: list[EffectObject]
    gap: GapObject
    next_experiment: ExperimentObject | None


def refuse(name):
    raise AssertionError(f"{name} in JSON")


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_view_is_the_interfaces_object(verdict):
    view = diagnosis_view(each_verdict()[verdict], {"X": "N"})
    json.loads(json.dumps(view), parse_constant=refuse)
    held = msgspec.convert(view, DiagnosisObject)
    assert held.verdict == verdict
    assert held.gap.unit == "mm"


def test_the_view_holds_the_interfaces_numbers():
    view = diagnosis_view(diagnosis(next_experiment=LADDER), {"X": "N"})
    (effect,) = view["effects"]
    assert effect["name"] == "coulomb_friction"
    assert effect["parameters"] == {"force": {"value": 20.4123, "stderr": 0.1, "unit": "N"}}
    assert effect["evidence"] == list(COULOMB.evidence)
    assert view["gap"]["noise_floor"] == pytest.approx(0.0002, rel=1e-12)
    assert [step["added"] for step in view["gap"]["steps"]] == [None, "coulomb_friction:X"]
    assert view["gap"]["steps"][0]["fit_rms"] == pytest.approx(0.0072, rel=1e-12)
    assert view["gap"]["steps"][1]["holdout_rms"] == pytest.approx(0.0030, rel=1e-12)
    assert view["next_experiment"]["record"] == ["X_cmd", "X_act", "X_motor"]
    act, force = view["quality"]["channels"]
    assert (act["unit"], act["resolution"], act["missing"], act["shift"]) == (
        "mm",
        pytest.approx(1e-4),
        3,
        2e-3,
    )
    assert (force["unit"], force["noise"], force["shift"]) == ("N", 0.5, None)
    assert view["places"][1]["sentence"] == "82 % of the excess lies within 40 ms after X reversals"
    assert view["places"][1]["value_si"] == 0.04


def test_what_is_not_finite_is_null():
    broken = diagnosis(
        findings=(replace(LOAD, parameters={"force": Estimate(value=math.nan, stderr=math.inf, unit="N")}),),
        noise_floor=math.nan,
        steps=(ResidualStep(added=None, fit_rms=math.nan, holdout_rms=math.inf),),
    )
    view = diagnosis_view(broken)
    json.loads(json.dumps(view), parse_constant=refuse)
    assert view["effects"][0]["parameters"]["force"] == {"value": None, "stderr": None, "unit": "N"}
    assert view["effects"][0]["confidence"] is None
    assert view["gap"] == {
        "unit": "mm",
        "noise_floor": None,
        "steps": [{"added": None, "fit_rms": None, "holdout_rms": None}],
    }
    assert diagnosis_lines(broken)


@pytest.mark.parametrize(
    ("verdict", "first"),
    [
        (
            "named",
            [
                "Coulomb friction is missing from X: 20.4 ± 0.1 N.",
                "A constant load is missing from X: -3.17 N.",
                "3.00 µm rms remain, 15.0 times the noise floor.",
            ],
        ),
        (
            "nothing-missing",
            [
                "Nothing is missing: machine file and log differ by no more than the noise of the log "
                "(residual 0.22 µm rms on held-out data, 1.1 times the noise floor of 0.20 µm)."
            ],
        ),
        (
            "ambiguous",
            ["This log cannot separate: Coulomb friction (X), or backlash (X); run reversal ladder to separate them."],
        ),
        (
            "unknown",
            [
                "No known effect explains it: residual 8.00 µm rms on held-out data, 40.0 "
                "times the noise floor of 0.20 µm. 82 % of the excess lies within 40 ms after X reversals."
            ],
        ),
        (
            "not-identifiable",
            ["This log cannot show it: X_act moves in steps of 1 mm, and no effect is as large."],
        ),
    ],
)
def test_the_verdict_comes_first_in_plain_sentences(verdict, first):
    made = each_verdict()[verdict]
    assert verdict_sentences(made) == first
    assert diagnosis_lines(made)[: len(first)] == first


def test_what_is_certain_is_told_beside_what_is_not():
    made = each_verdict()["ambiguous"]
    told = verdict_sentences(replace(made, findings=(LOAD, *made.findings)))
    assert told[0] == "A constant load is missing from X: -3.17 N."
    assert told[1].startswith("This log cannot separate: Coulomb friction (X), or backlash")
    assert len(told) == 2


def test_what_remains_and_what_was_dropped_is_said():
    why = "in quick motion the log shows 1.7 times as much of it as all in all"
    dropped = (DroppedName(name="servo_mismatch", axis="Y", why=why),)
    made = replace(each_verdict()["named"], remaining=(BOTH_WAYS,), dropped=dropped)
    said = verdict_sentences(made)
    assert said[-2].startswith("3.00 µm rms remain, 15.0 times the noise floor, mostly of X: ")
    assert said[-1] == f"Dropped: {label_words('servo_mismatch:Y')}, as {why}."
    assert diagnosis_view(made)["dropped"] == [{"name": "servo_mismatch", "axis": "Y", "why": why}]


def test_what_was_found_is_told_beside_what_no_name_explains():
    told = verdict_sentences(diagnosis(verdict="unknown"))
    assert told[0] == "Coulomb friction is missing from X: 20.4 ± 0.1 N."
    assert told[1].startswith("No known effect explains the rest: residual 3.00 µm rms")


def test_a_rival_on_another_axis_is_named_with_its_axis():
    told = verdict_sentences(
        diagnosis(verdict="ambiguous", findings=(replace(COULOMB, ambiguous_with=("squareness:Y",)),), steps=STEPS[:1])
    )
    assert told == ["This log cannot separate: Coulomb friction (X), or a squareness error (Y)."]


def test_the_lines_hold_quality_places_gap_parameters_and_evidence():
    text = "\n".join(diagnosis_lines(each_verdict()["named"], {"X": "N"}))
    for words in (
        "The log: a sample every 1 ms (jitter up to 0.02 ms); the first 0.35 s are ignored",
        "  X_act: noise 0.2 µm (from repeats), steps of 0.1 µm, 3 missing, 2 ms late",
        "  X_force: noise 0.5 N (from differences)",
        "Where machine file and log differ by more than noise, the excess:\n"
        "  82 % of the excess lies within 40 ms after X reversals\n",
        "Residual between log and model, rms (noise floor 0.20 µm):",
        "Coulomb friction (X): within 40 ms after X reversals, 99 % sure\n  force = 20.4 ± 0.1 N\n  evidence: the lag",
        "A constant load (X): everywhere\n  force = -3.17 N (standard error unknown)",
        "-o FILE writes the better machine file",
    ):
        assert words in text
    assert "equal in both directions" not in text  # 1 % of the excess is nowhere
    rows = [line.split() for line in text.splitlines() if line.rstrip().endswith(("40.0", "15.0"))]
    assert [row[-3:] for row in rows] == [["7.20", "8.00", "40.0"], ["1.90", "3.00", "15.0"]]


def test_what_is_to_be_run_next_is_said_with_what_to_record():
    lines = diagnosis_lines(each_verdict()["ambiguous"])
    at = lines.index(f"Next: run reversal ladder: {LADDER.why}")
    assert lines[at + 1] == "  log X_cmd, X_act, X_motor; --next FILE writes the program"
    assert not any("-o" in line for line in lines)  # nothing was added


def test_places_come_largest_first_whatever_their_order():
    larger = replace(diagnosis().places[1], share=0.9, sentence="larger")
    lines = diagnosis_lines(diagnosis(places=(*diagnosis().places, larger)))
    at = lines.index("Where machine file and log differ by more than noise, the excess:")
    assert lines[at + 1 : at + 3] == ["  larger", "  82 % of the excess lies within 40 ms after X reversals"]


def test_what_keeps_a_record_from_showing_anything_is_said_once():
    made = each_verdict()["not-identifiable"]
    assert "\n".join(diagnosis_lines(made)).count("no effect is as large") == 1


def test_without_a_noise_floor_nothing_is_told_in_its_multiples():
    lines = diagnosis_lines(diagnosis(noise_floor=0.0, steps=STEPS))
    assert any(line.rstrip().endswith("8.00              -") for line in lines)
    assert not any("times the noise floor of" in line for line in lines)


@pytest.mark.parametrize(
    ("value", "stderr", "unit", "words"),
    [
        (20.4123, 0.1, "N", "20.4 ± 0.1 N"),
        (20.4123, 0.14, "N", "20.41 ± 0.14 N"),
        (0.0312345, 0.0013, "mm", "0.0312 ± 0.0013 mm"),
        (31234.5, 250.0, "N", "31230 ± 250 N"),
        (5.12e-4, 1.0e-5, "s²", "0.00051 ± 0.00001 s²"),
        (2.3456e-5, 1.2e-6, "1", "2.35e-05 ± 1.2e-06"),
        (3.0, 0.0, "mm", "3 mm"),
        (-3.17, None, "N", "-3.17 N"),
        (0.0, 0.02, "", "0.00 ± 0.02"),
    ],
)
def test_numbers_end_where_their_standard_error_does(value, stderr, unit, words):
    assert estimate_words(Estimate(value=value, stderr=stderr, unit=unit)) == words


def test_every_effect_of_the_interface_has_a_sentence_of_its_own():
    sentences = {finding_sentence(replace(COULOMB, name=name)) for name in CATALOGUE}
    assert len(sentences) == len(CATALOGUE)
    assert not [sentence for sentence in sentences if "_" in sentence]
    assert finding_sentence(replace(COULOMB, name="servo_mismatch")) == (
        "The servo of X differs from the file: force = 20.4 ± 0.1 N."
    )
    # An effect that somebody added is told by its own name.
    assert label_words("lubricant_film:Y") == "lubricant film (Y)"


def test_a_machine_with_one_of_several_rivals_is_said_to_assume_it():
    made = replace(each_verdict()["ambiguous"], steps=STEPS)
    assert "The better machine file assumes the first effect of each doubtful set." in diagnosis_lines(made)
    assert "assumes" not in "\n".join(diagnosis_lines(diagnosis()))


def test_options_that_were_given_are_not_recommended():
    made = diagnosis(next_experiment=LADDER)
    recommended = "\n".join(diagnosis_lines(made))
    assert "--next FILE" in recommended
    assert "-o FILE" in recommended
    quiet = "\n".join(diagnosis_lines(made, given=("-o", "--next")))
    assert "--next" not in quiet
    assert "-o" not in quiet


def test_a_record_without_noise_is_told_in_few_digits():
    exact = replace(COULOMB, parameters={"force": Estimate(value=0.02, stderr=2.8e-11, unit="mm")})
    steps = (STEPS[0], ResidualStep(added="coulomb_friction:X", fit_rms=2e-16, holdout_rms=3e-16))
    lines = diagnosis_lines(diagnosis(findings=(exact,), noise_floor=1e-16, steps=steps))
    assert lines[0] == "Coulomb friction is missing from X: 0.02000 ± 0.00001 mm of following error."
    (first,) = (line for line in lines if line.strip().startswith("original machine file"))
    assert first.split()[-3:] == ["7.20", "8.00", "8e+10"]
    (last,) = (line for line in lines if line.strip().startswith("+ Coulomb friction (X)"))
    assert last.split()[-3:] == ["<0.01", "<0.01", "3.0"]
