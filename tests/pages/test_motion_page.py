"""The page of a path in a real browser: what it tells where one points, and what hand and keys do."""

import csv
import json
import re

import numpy as np
import pytest
from support.browser import Shown, numbers_after

from ph_post.cli.main import main
from ph_post.files.path import read_path
from ph_post.files.storage import shipped
from ph_post.geometry.track import Track

HOW = ("oval", "-m", "mill", "--strategy", "suppress")
PICTURES = ("#plane", "#error", "#feed")


@pytest.fixture(scope="module")
def files(browser, tmp_path_factory):
    """Return the page, and the same two motions from other commands."""
    folder = tmp_path_factory.mktemp("page")
    page = folder / "oval.html"
    assert main(["report", *HOW, "-o", str(page)]) == 0
    runs = []
    for strategy in ("none", "suppress"):
        log, table = folder / f"{strategy}.csv", folder / f"{strategy}_table.csv"
        assert main(["simulate", *HOW[:3], "--strategy", strategy, "--log", str(log)]) == 0
        assert main(["convert", *HOW[:3], "--strategy", strategy, "--table", str(table)]) == 0
        runs.append({**columns(log), **{name: one for name, one in columns(table).items() if name in "s feed"}})
    return page, runs


def columns(file):
    rows = [row for row in csv.reader(file.read_text().splitlines()) if row and not row[0].startswith("#")]
    return dict(zip(rows[0], np.array(rows[1:], dtype=float).T, strict=True))


@pytest.fixture(scope="module")
def module_page(browser, files):
    shown = Shown(browser, files[0])
    yield shown
    shown.require_quiet()
    shown.close()


@pytest.fixture
def oval(module_page):
    """Show the page as it is at first."""
    yield module_page
    module_page.page.reload()
    module_page.settle()


@pytest.fixture(scope="module")
def outline():
    """Fine points of the path [mm]: their places along it, and where they are."""
    track = Track(read_path(str(shipped("paths", "oval"))))
    s = np.linspace(0.0, track.length, 400_001)
    return 1e3 * s, 1e3 * track.derivatives(*track.locate(s))[0]


def told_of(text, run):
    """Return error [µm], half of its last digit, its side, feed [mm/min] and time [s] that are told of a run."""
    found = re.search(rf"{run}: error (<?[\d.]+) µm( left| right|), feed ([\d.]+) mm/min, at ([\d.]+) s", text)
    error, side, feed, t = found.groups()
    if error.startswith("<"):
        return 0.0, 0.005, side.strip(), float(feed), float(t)
    half = 0.5 * 10.0 ** -len(error.partition(".")[2])
    return float(error), half, side.strip(), float(feed), float(t)


def test_it_needs_no_network_and_has_nothing_to_complain_about(module_page):
    module_page.require_quiet()
    assert len(module_page.asked) == 1
    assert module_page.page.title() == "ph-post report oval of PH quintics"


@pytest.mark.parametrize("share", [0.13, 0.36, 0.61, 0.9])
@pytest.mark.parametrize("picture", ["#error", "#feed"])
def test_a_chart_tells_the_numbers_of_the_nearest_point(oval, files, outline, picture, share):
    oval.middle(picture)
    x = oval.pixel(picture, "x", share * 250.0)
    box = oval.page.locator(picture).bounding_box()
    text = oval.point_at(x, box["y"] + 0.4 * box["height"])
    s, at_x, at_y = numbers_after(text, "s", "X", "Y")
    assert s == pytest.approx(share * 250.0, abs=0.1)
    points = outline[1]
    for name, run in zip(("original", "compensated"), files[1], strict=True):
        error, half, side, feed, t = told_of(text, name)
        row = round(t / 1e-3)
        away = np.array([run["X_act"][row], run["Y_act"][row]]) - points
        nearest = int(np.argmin(np.hypot(*away.T)))
        ahead = points[nearest + 1] - points[nearest - 1]
        to_left = (ahead[0] * away[nearest][1] - ahead[1] * away[nearest][0]) / np.hypot(*ahead)
        assert error == pytest.approx(1e3 * abs(to_left), abs=2e-3 + half)
        if error > 0.01:
            assert side == ("left" if to_left > 0.0 else "right")
        assert feed == pytest.approx(run["feed"][row], abs=0.06)
        assert run["s"][row] == pytest.approx(s, abs=0.05)
    # The place that is told is that of the path next to the table.
    assert np.hypot(*(points - [at_x, at_y]).T).min() < 2e-3


def test_the_path_tells_the_numbers_of_the_nearest_point(oval, outline):
    oval.middle("#plane")
    oval.page.locator("#mag").fill("0")
    oval.settle()
    places, points = outline
    for wanted in (40.0, 90.0, 200.0):
        at = points[np.searchsorted(places, wanted)]
        x, y = (oval.pixel("#plane", axis, value) for axis, value in zip("xy", at, strict=True))
        s, told_x, told_y = numbers_after(oval.point_at(x, y), "s", "X", "Y")
        assert [told_x, told_y] == pytest.approx(at, abs=0.25)
        assert s == pytest.approx(wanted, abs=1.0)


def test_the_error_is_drawn_magnified_normal_to_the_path(oval, files, outline):
    _, points = outline
    words = oval.page.locator("label:has(#mag) output").inner_text()
    factor = float(words)
    oval.page.get_by_role("button", name="compensated").click()
    oval.settle()
    numbers = np.array(re.findall(r"-?[\d.]+", oval.drawn("#plane .run0")[-1]), dtype=float).reshape(-1, 2)
    box = oval.page.locator("#plane").bounding_box()
    drawn = np.stack(
        [
            [oval.value("#plane", "x", box["x"] + x) for x in numbers[::40, 0]],
            [oval.value("#plane", "y", box["y"] + y) for y in numbers[::40, 1]],
        ],
        axis=1,
    )
    executed = np.stack([files[1][0]["X_act"], files[1][0]["Y_act"]], axis=1)[30::10]
    feet = np.array([points[np.argmin(np.hypot(*(points - one).T))] for one in executed])
    expected = feet + factor * (executed - feet)
    off = [np.hypot(*(expected - one).T).min() for one in drawn]
    # The expected places are 0.2 mm apart, and a pixel is about as much.
    assert max(off) < 0.4


def test_wheel_drag_and_double_click_move_the_axes(oval):
    before = oval.ticks("#plane", "x")
    x, y = oval.middle("#plane")
    oval.page.mouse.move(x, y)
    oval.page.mouse.wheel(0, -600)
    oval.settle()
    nearer = oval.ticks("#plane", "x")
    assert max(nearer) - min(nearer) < 0.6 * (max(before) - min(before))
    middle = oval.value("#plane", "x", x)
    oval.page.mouse.down()
    oval.page.mouse.move(x + 60, y, steps=3)
    oval.page.mouse.up()
    oval.settle()
    assert oval.value("#plane", "x", x + 60) == pytest.approx(middle, abs=0.02)
    oval.page.mouse.dblclick(x, y)
    oval.settle()
    assert oval.ticks("#plane", "x") == before


def test_charts_are_zoomed_together_and_by_keys(oval):
    before = [oval.ticks(picture, "x") for picture in ("#error", "#feed")]
    values = [list(one) for one in before]
    oval.middle("#feed")
    oval.page.locator("#feed").focus()
    for _ in range(4):
        oval.page.keyboard.press("+")
    oval.settle()
    nearer = [list(oval.ticks(picture, "x")) for picture in ("#error", "#feed")]
    assert nearer[0] == nearer[1] != values[0]
    assert max(nearer[0]) < 200.0
    assert min(nearer[0]) > 50.0
    # What lies beyond is faint in the path.
    assert oval.count("#plane .run0") == 2
    oval.page.keyboard.press("Shift+ArrowRight")
    oval.settle()
    assert list(oval.ticks("#error", "x")) != nearer[0]
    oval.page.keyboard.press("0")
    oval.settle()
    assert [oval.ticks(picture, "x") for picture in ("#error", "#feed")] == before


def test_arrows_walk_along_the_path(oval):
    oval.page.locator("#error").focus()
    told = []
    for _ in range(12):
        oval.page.keyboard.press("ArrowRight")
        oval.settle()
        told.append(numbers_after(oval.page.locator("#tip").inner_text(), "s")[0])
    assert np.all(np.diff(told) > 0.0)
    assert told[-1] == pytest.approx(12 * 2.517, abs=0.5)
    assert oval.count("tr.lit") == 1  # 30 mm is in the window of #0
    oval.page.keyboard.press("Escape")
    assert not oval.page.locator("#tip").is_visible()


def test_buttons_show_and_hide(oval):
    for name, selector, count in (
        ("original", ".run0", 3),
        ("compensated", ".run1", 3),
        ("windows", "rect.window, path.window", 12),
        ("reversals", "circle.point", 4),
    ):
        button = oval.page.get_by_role("button", name=name, exact=True)
        assert (button.get_attribute("aria-pressed"), oval.count(selector)) == ("true", count)
        button.click()
        oval.settle()
        assert (button.get_attribute("aria-pressed"), oval.count(selector)) == ("false", 0)
        button.click()
        oval.settle()
        assert oval.count(selector) == count


def test_the_slider_magnifies_the_error_and_not_the_path(oval):
    path, run = oval.drawn("#plane .path"), oval.drawn("#plane .run0")
    oval.page.locator("#mag").fill("3")
    oval.settle()
    assert oval.page.locator("label:has(#mag) output").inner_text() == "1000"
    assert oval.drawn("#plane .path") == path
    assert oval.drawn("#plane .run0") != run


def test_rows_and_windows_light_each_other_up(oval):
    oval.page.locator("tr.go").nth(1).hover()
    assert [oval.count(f"{picture} .lit") for picture in PICTURES] == [1, 1, 1]
    oval.middle("#feed")
    box = oval.page.locator("#feed").bounding_box()
    text = oval.point_at(oval.pixel("#feed", "x", 152.9), box["y"] + 40)
    assert "in the window of #2 (X min): suppress" in text
    assert oval.page.locator("tr.lit").get_attribute("data-index") == "2"
    oval.point_at(oval.pixel("#feed", "x", 120.0), box["y"] + 40)
    assert oval.count("tr.lit") == 0


def test_a_row_takes_all_pictures_to_its_window(oval):
    oval.page.locator("tr.go").nth(3).focus()
    oval.page.keyboard.press("Enter")
    oval.settle()
    ticks = list(oval.ticks("#error", "x"))
    assert min(ticks) > 190.0
    assert max(ticks) < 240.0
    y = list(oval.ticks("#plane", "y"))
    assert min(y) < -33.0
    assert max(y) < -15.0


def test_the_table_is_the_one_of_inspect_and_can_be_sorted(oval, capsys):
    assert main(["inspect", *HOW[:3], "--json"]) == 0
    points = json.loads(capsys.readouterr().out)["turning_points"]
    rows = [one.inner_text().split("\t") for one in oval.page.locator("tr.go").all()]
    for row, point in zip(rows, points, strict=True):
        assert row[0] == f"#{point['index']}"
        assert float(row[1]) == pytest.approx(point["s"], abs=6e-4)
        assert float(row[2 if point["axis"] == "X" else 3]) == pytest.approx(point["position"], abs=6e-4)
        assert row[4] == f"{point['axis']} {point['sense']}, smooth"
        assert float(row[5]) == pytest.approx(point["window"]["half_length"], abs=6e-4)
        assert float(row[8]) == pytest.approx(1e3 * point["backlash"]["duration"], abs=6e-3)
    oval.page.get_by_role("button", name="standstill ms").click()
    held = [float(one.inner_text().split("\t")[8]) for one in oval.page.locator("tr.go").all()]
    assert held == sorted(held)
    oval.page.get_by_role("button", name="standstill ms").click()
    assert oval.page.locator("tr.go").first.inner_text()[:2] in ("#1", "#3")


def test_pictures_are_named_and_reached_by_keys(oval):
    for picture in PICTURES:
        one = oval.page.locator(picture)
        assert one.get_attribute("role") == "img"
        assert len(one.get_attribute("aria-label")) > 10
        assert one.get_attribute("tabindex") == "0"
    assert oval.page.evaluate("document.documentElement.lang") == "en"
    assert all(one.inner_text().strip() for one in oval.page.locator("button").all())


def test_dark_print_and_phone(browser, files):
    def paper(shown):
        return sum(
            map(
                int,
                re.findall(r"\d+", shown.page.evaluate("getComputedStyle(document.body).backgroundColor")),
            )
        )

    light, dark = Shown(browser, files[0]), Shown(browser, files[0], color_scheme="dark")
    phone = Shown(browser, files[0], width=390, height=844, has_touch=True)
    assert paper(light) > 700
    assert paper(dark) < 150
    dark.page.emulate_media(media="print")
    assert paper(dark) > 700
    assert not dark.page.locator(".bar.hand").first.is_visible()
    dark.page.set_viewport_size({"width": 720, "height": 1000})  # a sheet of A4
    dark.settle()
    assert dark.page.evaluate("document.documentElement.scrollWidth") <= 720
    assert phone.page.evaluate("document.documentElement.scrollWidth") <= 390
    x, y = phone.middle("#feed")
    phone.page.touchscreen.tap(x, y)
    assert "feed" in phone.page.locator("#tip").inner_text()
    for shown in (light, dark, phone):
        shown.require_quiet()
        shown.close()


def test_without_scripts_it_is_told_in_words(browser, files):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto(files[0].as_uri())
    text = page.locator("noscript").inner_text()
    assert "backlash error" in text
    assert "suppress" in text
    context.close()
