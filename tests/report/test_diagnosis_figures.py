"""The picture of a diagnosis shows the numbers that it is made of."""

import numpy as np
import pytest
from msgspec.structs import replace
from support.diagnoses import diagnosis, each_verdict, trail

from ph_post.report.diagnosis_figures import draw_diagnosis
from ph_post.report.figures import write_figure


def test_the_bars_are_the_steps_in_micrometres():
    figure = draw_diagnosis(diagnosis(), {"X": "N"})
    gap = figure.axes[0]
    assert [bar.get_width() for bar in gap.patches] == pytest.approx([7.2, 1.9, 8.0, 3.0])
    assert [text.get_text() for text in gap.get_yticklabels()] == [
        "original machine file",
        "+ Coulomb friction (X)",
    ]
    assert gap.lines[0].get_xdata()[0] == pytest.approx(0.2)
    said, remains = figure.get_suptitle().split("\n")
    assert said == "Coulomb friction is missing from X: 20.4 ± 0.1 N."
    assert remains == "3.00 µm rms remain, 15.0 times the noise floor."


def test_a_row_a_channel_in_its_unit():
    figure = draw_diagnosis(diagnosis(), {"X": "N"})
    assert [axes.get_ylabel() for axes in figure.axes[1:]] == [
        "X_act: log - model [µm]",
        "X_force: log - model [N]",
    ]
    before, after = figure.axes[1].collections[-2:]
    raw = trail()
    assert before.get_paths()[0].vertices[:, 1].max() == pytest.approx(1e6 * raw.before.max())
    assert after.get_paths()[0].vertices[:, 1].min() == pytest.approx(1e6 * raw.after.min())


def test_the_start_does_not_set_the_scale():
    made = trail()
    before = np.where(made.counted, made.before, 1.0)
    figure = draw_diagnosis(diagnosis(trails=(replace(made, before=before),)))
    assert figure.axes[1].get_ylim()[1] < 20.0


@pytest.mark.parametrize("verdict", ["named", "nothing-missing", "ambiguous", "unknown", "not-identifiable"])
@pytest.mark.thinned(6)
def test_every_verdict_has_a_picture(verdict):
    picture = write_figure(draw_diagnosis(each_verdict()[verdict]), "diagnosis.png")
    assert picture.startswith(b"\x89PNG")


def test_where_no_gap_was_measured_none_is_drawn():
    gap = draw_diagnosis(each_verdict()["not-identifiable"]).axes[0]
    assert not gap.axison
    assert [text.get_text() for text in gap.texts] == ["the residual was not measured"]
