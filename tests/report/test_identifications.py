"""What is told of identified parameters: the interface's object, and a table."""

import json
import math

from ph_post.report.diagnoses import identification_lines, identification_view, unshown_words
from ph_post.types.diagnosis import Estimate

AXES = {
    "X": {
        "b": Estimate(value=1.562e-4, stderr=2e-6, unit="s²"),
        "lost_motion": Estimate(value=0.0301, stderr=0.0004, unit="mm"),
    },
    "Y": {"c": Estimate(value=0.03, stderr=None, unit="s")},
}
NOTE = "X: beta and C are not told apart by positions alone"


def test_the_view_has_parameters_by_axis_with_standard_errors():
    view = json.loads(json.dumps(identification_view(AXES, [NOTE]), allow_nan=False))
    assert view["axes"]["X"]["lost_motion"] == {"value": 0.0301, "stderr": 0.0004, "unit": "mm"}
    assert view["axes"]["Y"]["c"] == {"value": 0.03, "stderr": None, "unit": "s"}
    assert view["notes"] == [NOTE]


def test_what_is_not_finite_is_null():
    view = identification_view({"X": {"c": Estimate(value=math.nan, stderr=math.inf, unit="s")}})
    assert view["axes"]["X"]["c"] == {"value": None, "stderr": None, "unit": "s"}


def test_the_table_has_a_line_a_parameter():
    lines = identification_lines(AXES, [NOTE])
    assert [line.split() for line in lines[1:4]] == [
        ["X", "b", "0.000156", "±", "2e-06", "s²"],
        ["X", "lost_motion", "0.0301", "±", "0.0004", "mm"],
        ["Y", "c", "0.03", "unknown", "s"],
    ]
    assert lines[4:] == [f"note: {NOTE}"]


def test_a_record_that_shows_nothing_says_so():
    assert identification_lines({}) == ["This log shows no parameter."]


def test_a_gain_that_is_less_than_its_error_is_not_shown():
    # Of a log of one constant speed a machine file was written with K_v = 335 +- 18932 1/s, without a word.
    slow = {
        "position_gain": Estimate(value=335.0, stderr=18932.0, unit="1/s"),
        "velocity_gain": Estimate(value=6527.0, stderr=248386.0, unit="1/s"),
        "dead_time": Estimate(value=0.0004, stderr=0.36, unit="ms"),
    }
    (said,) = unshown_words({"Z": slow, **AXES})
    assert said.startswith("this log does not show position gain and velocity gain of Z, which may be anything")
    assert unshown_words(AXES) == ()
    assert unshown_words({"X": {"c": Estimate(value=math.nan, stderr=math.inf, unit="s")}})
