"""Pages of two programs, of a diagnosis, and of what is out of the ordinary, in a real browser."""

import json
import re

import numpy as np
import pytest
from support.browser import Shown, numbers_after
from support.diagnoses import diagnosis, each_verdict

from ph_post.cli.main import main
from ph_post.report.diagnosis_page import diagnosis_page
from ph_post.types.diagnosis import ResidualStep

OLD = "G21 G90 G94\nG0 X0 Y0\nG1 X40 F600\nG3 X40 Y20 J10\nG1 X0\nG3 X0 Y0 J-10\nM2\n"
NEW = OLD.replace("G1 X40 F600", "G1 X20 Y0.05 F600\nX40 Y0 F300")


def show(browser, folder, text, **context):
    file = folder / "page.html"
    file.write_text(text, encoding="utf-8")
    return Shown(browser, file, **context)


@pytest.fixture(scope="module")
def both(browser, tmp_path_factory):
    folder = tmp_path_factory.mktemp("both")
    for name, text in (("old.ngc", OLD), ("new.ngc", NEW)):
        (folder / name).write_text(text)
    page = folder / "both.html"
    assert main(["report", str(folder / "old.ngc"), str(folder / "new.ngc"), "-o", str(page)]) == 0
    shown = Shown(browser, page)
    yield shown
    shown.require_quiet()
    shown.close()


def test_two_programs_are_told_where_one_points(both):
    x, y = (both.pixel("#path", axis, value) for axis, value in (("x", 50.0), ("y", 10.0)))
    text = both.point_at(x, y)
    assert "A line 4, s 55.708 mm" in text  # 40 mm, and a quarter of the circle of 10 mm
    assert numbers_after(text, "X", "Y") == pytest.approx([50.0, 10.0], abs=0.6)
    both.page.locator("#dev").scroll_into_view_if_needed()
    box = both.page.locator("#dev").bounding_box()
    text = both.point_at(both.pixel("#dev", "x", 20.0), box["y"] + 30)
    assert numbers_after(text, "s") == pytest.approx([20.0], abs=0.1)
    assert numbers_after(text, "B off by") == pytest.approx([50.0], abs=1.0)  # µm
    box = both.page.locator("#feed").bounding_box()
    text = both.point_at(both.pixel("#feed", "x", 30.0), box["y"] + 30)
    assert re.findall(r"[AB] F \d+", text) == ["A F 600", "B F 300"]


def test_two_programs_are_zoomed_and_seen_from_three_sides(both):
    before = both.ticks("#dev", "x")
    both.page.locator("tr.go").first.click()
    both.settle()
    assert both.ticks("#dev", "x") != before
    both.page.get_by_role("button", name="all").click()
    both.settle()
    assert both.ticks("#dev", "x") == before
    flat = both.drawn("#path .path")
    both.page.get_by_role("button", name="XZ").click()
    both.settle()
    assert both.drawn("#path .path") != flat
    both.page.get_by_role("button", name="XY").click()
    both.settle()
    assert both.drawn("#path .path") == flat


def test_a_diagnosis_is_told_where_one_points_and_is_zoomed(browser, tmp_path):
    shown = show(browser, tmp_path, diagnosis_page(diagnosis(), "run.csv"))
    shown.page.locator("svg.time").first.scroll_into_view_if_needed()
    box = shown.page.locator("svg.time").first.bounding_box()
    text = shown.point_at(box["x"] + 0.5 * box["width"], box["y"] + 80)
    assert re.match(r"[\d.]+ s, X commanded -?[\d.]+ mm\nbefore .* µm\nafter .* µm", text)
    before = shown.page.locator("svg.time text.x").all_text_contents()
    shown.page.mouse.wheel(0, -500)
    shown.settle()
    assert shown.page.locator("svg.time text.x").all_text_contents() != before
    shown.page.get_by_role("button", name="all").click()
    shown.settle()
    assert shown.page.locator("svg.time text.x").all_text_contents() == before
    shown.require_quiet()
    shown.close()


def test_the_names_of_steps_end_before_their_bars(browser, tmp_path):
    # "+ other servo parameters than in the file (X)" ran into its bars.
    steps = [ResidualStep(added=added, fit_rms=7e-6, holdout_rms=8e-6) for added in (None, "servo_mismatch:X")]
    shown = show(browser, tmp_path, diagnosis_page(diagnosis(steps=tuple(steps)), "run.csv"))
    ends, begin = shown.page.evaluate(
        """() => {
            const svg = document.querySelector("svg:has(rect)");
            const names = [...svg.querySelectorAll("text.ink")].map(one => one.getBoundingClientRect().right);
            return [names, svg.querySelector("rect").getBoundingClientRect().left];
        }"""
    )
    assert len(ends) == 2
    assert max(ends) < begin
    shown.close()


@pytest.mark.parametrize("verdict", ["named", "nothing-missing", "ambiguous", "unknown", "not-identifiable"])
@pytest.mark.parametrize("width", [390, 1300])
@pytest.mark.thinned(4)
def test_every_verdict_is_shown_on_every_screen(browser, tmp_path, verdict, width):
    shown = show(browser, tmp_path, diagnosis_page(each_verdict()[verdict], "run.csv"), width=width)
    assert shown.page.locator("h1").first.inner_text()
    assert shown.page.evaluate("document.documentElement.scrollWidth") <= width
    shown.require_quiet()
    shown.close()


def line(name="line"):
    return {
        "format": "ph-post-path",
        "version": 1,
        "name": name,
        "source": "a test",
        "units": "mm",
        "axes": ["X", "Y"],
        "feed": 1200,
        "closed": False,
        "segments": [{"type": "line", "points": [[0, 0], [30, 10]]}],
    }


def page_of(browser, folder, path, *more):
    source, page = folder / "in.json", folder / "out.html"
    source.write_text(json.dumps(path))
    assert main(["report", str(source), "-m", "mill", "-o", str(page), *more]) == 0
    return Shown(browser, page)


def test_a_path_without_a_window_is_shown(browser, tmp_path):
    shown = page_of(browser, tmp_path, line())
    assert "No axis reverses" in shown.page.locator("main").inner_text()
    assert "no axis with backlash reverses" in shown.page.locator("h1").inner_text()
    assert shown.count("tr.go") == 0
    box = shown.page.locator("#feed").bounding_box()
    assert "original: error" in shown.point_at(box["x"] + 200, box["y"] + 60)
    shown.page.mouse.wheel(0, -300)
    shown.settle()
    shown.require_quiet()
    shown.close()


def test_names_are_shown_as_they_are(browser, tmp_path):
    name = "</script><b onclick=alert(1)>&amp;\"'<!--@@data@@-->"
    shown = page_of(browser, tmp_path, line(name))
    assert shown.page.locator("h1").inner_text().startswith("</script><b onclick=alert(1)>&amp;\"'<!--@@data@@-->")
    assert shown.count("script") == 1
    assert shown.count("b[onclick]") == 0
    shown.require_quiet()
    shown.close()


def test_a_program_of_one_axis_is_shown(browser, tmp_path):
    source, page = tmp_path / "fro.ngc", tmp_path / "fro.html"
    source.write_text("G21 G90 G94\nG0 X0\nG1 X20 F600\nX0\nX20\nM2\n")
    assert main(["report", str(source), "-m", "old_mill", "--strategy", "none", "-o", str(page)]) == 0
    shown = Shown(browser, page)
    rows = [one.inner_text().split("\t") for one in shown.page.locator("tr.go").all()]
    assert [(row[1], row[2]) for row in rows] == [("3", "20.000"), ("4", "40.000")]
    x = shown.pixel("#feed", "x", 30.0)
    box = shown.page.locator("#feed").bounding_box()
    text = shown.point_at(x, box["y"] + 60)
    assert "line 4" in text
    assert numbers_after(text, "s", "X", "feed") == pytest.approx([30.0, 10.0, 600.0], abs=0.5)  # the table lags
    shown.require_quiet()
    shown.close()


@pytest.mark.parametrize(
    ("picture", "more"), [("#plane", ("-m", "old_mill", "--strategy", "none")), ("#path", ("other.ngc",))]
)
def test_a_rapid_between_two_cuts_is_not_drawn_as_a_cut(browser, tmp_path, monkeypatch, picture, more):
    monkeypatch.chdir(tmp_path)
    text = "G21 G90 G94\nG0 X0 Y0\nG1 X10 F600\nG0 X20\nG1 X30\nY5\nM2\n"
    (tmp_path / "part.ngc").write_text(text)
    (tmp_path / "other.ngc").write_text(text.replace("Y5", "Y6"))
    assert main(["report", "part.ngc", *more, "-o", "page.html"]) == 0
    shown = Shown(browser, tmp_path / "page.html")
    (cuts,) = (one for one in shown.drawn(f"{picture} .path:not([stroke-dasharray])") if one)
    assert cuts.count("M") == 2
    (rapids,) = (one for one in shown.drawn(f"{picture} .path[stroke-dasharray]") if one)
    ends = [[float(x) for x in re.findall(r"[ML]([\d.]+) ", one)] for one in (cuts, rapids)]
    # 10 of 30 mm in the middle.
    assert ends[1][-1] - ends[1][-2 if picture == "#path" else 0] == pytest.approx(np.ptp(ends[0]) / 3, abs=2)
    shown.require_quiet()
    shown.close()


FAR = """G21 G90 G94 G61
G0 X-203.1234567 Y-151.7654321 Z50
G0 X30 Y0 Z5
G1 Z-1 F200
G3 X30 Y0 I-30 J0 F900
G0 Z5
G0 X-5 Y10
G1 Z-2 F200
G0 Z5
G0 X-203.1234567 Y-151.7654321
M2
"""


def test_a_page_of_steppers_is_framed_on_the_cut_and_has_the_figures_of_the_line(browser, tmp_path, capsys):
    source, page = tmp_path / "far.ngc", tmp_path / "far.html"
    source.write_text(FAR)
    assert main(["report", str(source), "-m", "stepper", "-o", str(page), "--json"]) == 0
    view = json.loads(capsys.readouterr().out)
    shown = Shown(browser, page)
    ticks = shown.ticks("#plane", "x")
    assert -60.0 < min(ticks) < -20.0
    assert 20.0 < max(ticks) < 60.0
    tiles = [one.inner_text().split("\n") for one in shown.page.locator(".tile").all()]
    before, after = tiles[0][1].split(" → ")
    assert float(before) == pytest.approx(1e3 * view["error_gap"]["before"]["max"], rel=0.01)
    # Two digits are shown below 1 µm.
    assert float(after) == pytest.approx(1e3 * view["error_gap"]["after"]["max"], rel=0.01, abs=0.0051)
    assert float(tiles[2][1]) == pytest.approx(1e3 * view["error_gap"]["after_worst"]["max"], rel=0.01)
    assert tiles[4][1] == f"{view['reversals']['compensated']} of {view['reversals']['all']}"
    # Nothing dips in a window, and no motor lags.
    assert shown.page.get_by_role("button", name="windows").count() == 0
    assert shown.page.get_by_role("button", name="lag ms").count() == 0
    # Ways there and back are rapids to their ends, though places are rounded.
    (cuts,) = (one for one in shown.drawn("#plane .path:not([stroke-dasharray])") if one)
    assert cuts.count("M") == 2  # the circle and the hole
    # The hole is where the table stands in it, before and after.
    holes = [float(one.get_attribute("cx")) for one in shown.page.locator("#plane .hole").all()]
    assert len(holes) == 2
    assert abs(holes[0] - holes[1]) > 2.0
    shown.require_quiet()
    shown.close()
