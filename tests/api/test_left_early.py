"""Errors left in lines at feed that only go to the first cut, through the air, judged by a table with play."""

import json
import math
import re
from itertools import pairwise

import pytest

from ph_post.cli.main import main

PLAY = {"X": 0.06, "Y": 0.08}
"""Backlash of the shipped stepper router [mm]."""

AIR = (
    "G21\nG90\nG1 Z5 F600\nG1 X10 Y10 F1200\nG1 Z-1 F300\nG1 X50 F600\nG1 Y50\nG1 X10\nG1 Y10\nG1 Z5\n"
    "G1 X0 Y0 F1200\nM2\n"
)
CORNERS = [(10, 10), (50, 10), (50, 50), (10, 50), (10, 10), (0, 0)]


def table(text, sides):
    """Places (x, y) of the table behind each line that moves it, of axes that begin on sides of their backlash."""
    at, found = {}, []
    for line in text.splitlines():
        words = re.findall(r"([XY])(-?[\d.]+)", re.sub(r"\(.*?\)|;.*", "", line))
        for letter, number in words:
            half, motor = PLAY[letter] / 2, float(number)
            was = at.get(letter, motor + sides[letter] * half)
            at[letter] = min(max(was, motor - half), motor + half)
        if words and len(at) == len(PLAY):
            found.append((at["X"], at["Y"]))
    return found


def off(place):
    """Distance of a place from the square, and from the way back from it."""
    sizes = []
    for (ax, ay), (bx, by) in pairwise(CORNERS):
        way = (bx - ax, by - ay)
        share = ((place[0] - ax) * way[0] + (place[1] - ay) * way[1]) / (way[0] ** 2 + way[1] ** 2)
        share = min(max(share, 0.0), 1.0)
        sizes.append(math.dist(place, (ax + share * way[0], ay + share * way[1])))
    return min(sizes)


@pytest.fixture
def said(tmp_path, capsys):
    file, out = tmp_path / "part.gcode", tmp_path / "out.gcode"

    def run(text):
        file.write_text(text)
        assert main(["convert", str(file), "-m", "stepper", "-o", str(out), "--json"]) == 0
        return json.loads(capsys.readouterr().out), out.read_text()

    return run


def test_an_error_left_on_the_way_to_the_first_cut_is_named_with_what_is_cut_behind_it(said):
    view, text = said(AIR)
    assert view["reversals"]["compensated"] == view["reversals"]["all"] > 2
    before, after = view["error_gap"]["before"]["max"], view["error_gap"]["after"]["max"]
    assert after == pytest.approx(before, rel=0.02)
    early = view["error_early"]
    assert early["line"] == 5
    words = re.search(r"the largest is left up to line (\d+), .*?; ([\d.]+) µm max behind it;", view["result_line"])
    assert int(words[1]) == 5
    assert float(words[2]) == pytest.approx(1e3 * early["behind"]["max"], abs=0.06)
    # Places before the axes have come onto their sides, as line 4 ends, and behind them.
    first, ours, plain = [], [], []
    for sides in [{"X": x, "Y": y} for x in (1, -1) for y in (1, -1)]:
        head = text.index("Z-1")
        places = [table(part, sides) for part in (text[:head], text, AIR)]
        first.append(math.dist(places[0][0], CORNERS[0]))
        ours.append(max(map(off, places[1][len(places[0]) :])))
        plain.append(max(map(off, places[2][1:])))
    assert max(first) == pytest.approx(after, abs=1e-3)
    assert max(ours) <= early["behind"]["max"] + 5e-4 < 0.1 * max(plain)


def test_nothing_is_named_where_rapids_go_to_the_first_cut(said):
    view, _ = said(AIR.replace("G1 Z5 F600\nG1 X10 Y10 F1200", "G0 Z5\nG0 X10 Y10"))
    assert view["error_gap"]["after"]["max"] < 0.2 * view["error_gap"]["before"]["max"]
    assert view["error_early"] is None
    assert "the largest is left" not in view["result_line"]


def test_a_page_says_the_same(tmp_path, said, capsys):
    line = said(AIR)[0]["result_line"]
    arguments = ["report", str(tmp_path / "part.gcode"), "-m", "stepper", "-o", str(tmp_path / "page.html"), "--json"]
    assert main(arguments) == 0
    assert json.loads(capsys.readouterr().out)["result_line"] == line
