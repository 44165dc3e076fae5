"""The page of a diagnosis: one file that needs nothing else, with every number in it."""

import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest
from msgspec.structs import replace
from support.diagnoses import COULOMB, LADDER, diagnosis, each_verdict, trail

from ph_post.report.diagnoses import diagnosis_lines, diagnosis_view
from ph_post.report.diagnosis_page import POINTS, diagnosis_page

VOID = {"meta", "br", "hr", "img", "input", "link"}


class Nesting(HTMLParser):
    """Keeps the open tags, and what would be fetched."""

    def __init__(self, text):
        super().__init__()
        self.open, self.seen, self.fetched = [], [], []
        self.feed(text)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.seen.append(tag)
        self.fetched += [value for name, value in attrs if name in ("src", "href", "action", "data")]
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def data_of(page):
    (text,) = re.findall(r"^const D = (.*);$", page, re.MULTILINE)
    return json.loads(text)


@pytest.mark.parametrize("verdict", ["named", "nothing-missing", "ambiguous", "unknown", "not-identifiable"])
def test_the_page_is_whole_and_needs_no_network(verdict):
    page = diagnosis_page(each_verdict()[verdict], "run.csv", {"X": "N"})
    nesting = Nesting(page)
    assert nesting.open == []
    assert nesting.seen.count("script") == nesting.seen.count("svg") == 1
    assert nesting.fetched == []
    assert "http:" not in page
    assert "https:" not in page
    assert "@import" not in page
    assert "url(" not in page.replace("url(#${clip})", "")
    # A reader without scripts is told the same in words.
    assert diagnosis_lines(each_verdict()[verdict], {"X": "N"})[0].replace("'", "&#x27;") in page


def test_the_page_holds_the_view_and_its_words():
    made = diagnosis(next_experiment=LADDER)
    data = data_of(diagnosis_page(made, "run.csv", {"X": "N"}))
    view = diagnosis_view(made, {"X": "N"})
    assert {key: data[key] for key in view} == view
    assert data["log"] == "run.csv"
    assert data["machine"] == "retrofitted mill with scales"
    assert data["labels"] == [None, "Coulomb friction (X)"]
    assert data["estimates"] == [{"force": ["20.4", "0.1"]}]
    rivals = data_of(diagnosis_page(each_verdict()["ambiguous"]))["rivals"]
    assert rivals == [["backlash (X)"], ["Coulomb friction (X)"]]


def test_nothing_from_a_file_is_taken_for_the_pages_own():
    evil = "</script><script>alert(1)</script><!--LINES-->/*DATA*/null &amp; \u2028"
    made = diagnosis(
        findings=(replace(COULOMB, where=evil, evidence=(evil,)),),
        next_experiment=replace(LADDER, name=evil, program=evil),
        notes=(evil,),
    )
    page = diagnosis_page(made, evil)
    nesting = Nesting(page)
    assert (nesting.seen.count("script"), nesting.open) == (1, [])
    data = data_of(page)
    assert (data["log"], data["notes"], data["effects"][0]["where"]) == (evil, [evil], evil)
    assert data["next_experiment"]["program"] == evil


def test_residuals_are_told_in_the_units_of_the_shop():
    made = diagnosis(trails=(trail(20_000), trail(20_000, channel="force", axis="Y")))
    act, force = data_of(diagnosis_page(made, "", {"Y": "A"}))["trails"]
    assert (act["name"], act["unit"], act["noise"]) == ("X_act", "µm", pytest.approx(0.2))
    assert (force["name"], force["unit"], force["noise"]) == ("Y_force", "A", None)
    raw = made.trails[0]
    kept = raw.counted & ~raw.held_out
    assert act["rms"]["fitted"][0] == pytest.approx(1e6 * np.sqrt(np.mean(raw.before[kept] ** 2)))
    assert act["rms"]["held_out"][1] == pytest.approx(1e6 * np.sqrt(np.mean(raw.after[raw.held_out] ** 2)))
    assert max(act["before"][1]) == pytest.approx(1e6 * raw.before.max(), rel=1e-4)
    assert min(force["after"][0]) == pytest.approx(made.trails[1].after.min(), rel=1e-4)
    assert max(act["command"]) == pytest.approx(50.0, rel=1e-4)
    assert act["left_out"] == [[0.0, 0.349]]
    assert act["held_out"] == [[start + 0.001, start + 0.999] for start in (3, 7, 11, 15, 19)]
    assert act["reversal"]["before"][0] == pytest.approx(9.1, abs=0.2)  # 10 µm that decay within 50 ms
    assert act["reversal"]["x"][-1] == pytest.approx(994.005, rel=1e-5)  # ms
    assert act["position"]["1"]["x"][-1] == pytest.approx(49.5)  # mm


def test_the_difference_of_both_sides_is_drawn():
    table, motor = trail(4000), trail(4000, channel="motor")
    motor = replace(motor, before=0.5 * motor.before, after=motor.after - 1e-6)
    made = data_of(diagnosis_page(diagnosis(trails=(table, motor))))["trails"]
    assert [one["name"] for one in made] == ["X_act", "X_motor − X_act", "X_motor"]
    before = 1e6 * np.sqrt(np.mean((motor.before - table.before)[table.held_out & table.counted] ** 2))
    assert made[1]["rms"]["held_out"] == pytest.approx([before, 1.0])
    assert made[1]["unit"] == "µm"


def test_a_minute_at_1_khz_stays_a_small_file():
    page = diagnosis_page(diagnosis(trails=(trail(60_000), trail(60_000, axis="Y"))))
    assert len(page) < 1_000_000
    assert len(data_of(page)["trails"][0]["t"]) == POINTS


def test_what_is_missing_from_a_record_is_null_in_the_page():
    gone = trail(100)
    nothing = np.full(100, np.nan)
    page = diagnosis_page(diagnosis(trails=(replace(gone, before=nothing, after=nothing),)))
    (found,) = data_of(page)["trails"]
    assert set(found["before"][0]) == {None}
    assert found["rms"] == {"fitted": [None, None], "held_out": [None, None]}


def test_the_page_is_the_same_for_the_same_diagnosis():
    assert diagnosis_page(diagnosis()) == diagnosis_page(diagnosis())
