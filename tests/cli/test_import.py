"""`ph-post import` as other programs see it, from the drawing to the compensated program."""

import io
import json
import sys
from pathlib import Path

import pytest
from support import front_door
from support.drawings import dxf, entity, imported, lwpolyline, point, sampled
from support.streams import without_progress

from ph_post.cli.import_ import UNIT_NAMES
from ph_post.cli.main import main
from ph_post.files.drawing.shapes import MAX_BYTES, MAX_ENTITIES, UNITS
from ph_post.files.path import read_path

DRAWINGS = Path(__file__).resolve().parents[2] / "samples" / "drawings"
PLATE, BADGE = str(DRAWINGS / "plate.dxf"), str(DRAWINGS / "badge.svg")
LINE = entity("LINE", point((1, 2)), point((11, 2), 11))


def run(capsys, *arguments):
    return front_door.run(capsys, "import", *arguments)


@pytest.mark.parametrize("drawing", [PLATE, BADGE])
def test_a_sample_becomes_its_golden_path(drawing, capsys):
    golden = DRAWINGS / f"{Path(drawing).stem}.json"
    status, out, _ = run(capsys, drawing, "--feed", "800")
    assert status == 0
    mine, theirs = json.loads(out), json.loads(golden.read_text())
    assert mine.keys() == theirs.keys()
    for ours, expected in zip(mine["segments"], theirs["segments"], strict=True):
        assert ours.keys() == expected.keys()
        assert flat(ours) == pytest.approx(flat(expected), abs=1e-12)
        assert ours["type"] == expected["type"]


def flat(value):
    if isinstance(value, dict):
        return [number for one in value.values() for number in flat(one)]
    if isinstance(value, list):
        return [number for one in value for number in flat(one)]
    return [value] if isinstance(value, int | float) else []


def test_json_tells_contours_gaps_and_what_was_left_out(capsys, tmp_path):
    target = tmp_path / "plate.json"
    status, out, err = run(capsys, PLATE, "-o", str(target), "--json")
    view = json.loads(out)
    assert status == 0
    assert [(one["layer"], one["closed"], one["segments"]) for one in view["contours"]][:3] == [
        ("OUTLINE", True, 8),
        ("POCKET", True, 1),
        ("GROOVE", True, 2),
    ]
    assert view["extents"] == pytest.approx([pytest.approx([0, 0, 0]), pytest.approx([100, 60, 0])])
    assert view["left_out"] == {"TEXT": 1}
    assert view["gaps"] == {"closed": 0, "largest": 0.0, "moved": 0.0, "bridged": 0, "forks": 0}
    assert view["length"] == pytest.approx(sum(one["length"] for one in view["contours"]))
    assert "warning: left out: 1 TEXT\n" in err
    assert "the feed is 1000 mm/min" in err
    assert len(read_path(target).segments) == view["segments"] + 6
    assert run(capsys, PLATE, "--json")[1].startswith('{\n "name": "plate"')
    assert run(capsys, PLATE, "--json", "-o", "-")[0] == 2


def test_list_shows_layers_entities_and_extents(capsys):
    status, out, _ = run(capsys, PLATE, "--list")
    assert status == 0
    assert out.splitlines()[0] == "DXF drawing in mm"
    assert any(row.split()[:4] == ["GROOVE", "20", "to", "80"] for row in out.splitlines())
    assert out.endswith("not taken: 1 TEXT\n")
    view = json.loads(run(capsys, BADGE, "--list", "--json")[1])
    assert (view["format"], view["units"]) == ("SVG", "mm")
    assert [layer["name"] for layer in view["layers"]] == ["frame", "heart"]
    assert view["layers"][0]["extents"] == [pytest.approx([2, 2, 0]), pytest.approx([78, 58, 0])]
    assert run(capsys, PLATE, "--list", "-o", "x.json")[0] == 2


def test_layers_scale_feed_and_origin(tmp_path):
    path = imported(
        main,
        PLATE,
        tmp_path,
        "--layer",
        "HOLES",
        "--layer",
        "OUTLINE",
        "--scale",
        "1/2",
        "--feed",
        "600",
        "--origin",
        "corner",
        "--order",
        "drawn",
    )
    assert path.feed == pytest.approx(0.01)
    kinds = [segment.curve.kind for segment in path.segments if not segment.rapid]
    assert kinds == ["arc", "line", "nurbs", "line"] + ["line", "arc"] * 4
    points = sampled(path)
    assert points.min(axis=(0, 1)) == pytest.approx([0, 0], abs=1e-12)
    assert points.max(axis=(0, 1)) == pytest.approx([50, 30], abs=1e-12)
    outline = imported(main, PLATE, tmp_path, "--layer", "OUTLINE", "--closed", "--origin", "center")
    assert outline.closed
    assert sampled(outline).max(axis=(0, 1)) == pytest.approx([50, 30], abs=1e-12)
    moved = imported(main, PLATE, tmp_path, "--layer", "OUTLINE", "--origin", "10,-5")
    assert sampled(moved)[0][0] == pytest.approx([0, 5])


def test_what_is_open_where_closed_is_needed_is_named_with_its_ends(capsys, tmp_path):
    file = tmp_path / "a.dxf"
    file.write_text(dxf(lwpolyline([(0, 0, 0), (10, 0, 0), (10, 5, 0), (0, 0.02, 0)], closed=False)))
    status, _, err = run(capsys, str(file), "--closed", "-o", str(tmp_path / "a.json"))
    assert status == 2
    assert err == (
        f"ph-post: {file}: layer 0: 1 of 1 contours are open; expected ends within --join 0.01 mm; "
        "got ends at (0, 0) and (0, 0.02) mm, 0.02 mm apart\n"
    )
    assert not (tmp_path / "a.json").exists()
    path = imported(main, file, tmp_path, "--closed", "--join", "0.05")
    assert path.closed
    assert "1 gap up to 0.02 mm closed (--join 0.05 mm); no point moved by more than 0.01 mm" in capsys.readouterr().err


def test_what_is_drawn_twice_and_rapids_are_warned_of(capsys, tmp_path):
    """Drawn the other way, or a circle begun elsewhere, it is the same cut."""
    file = tmp_path / "a.dxf"
    there, back = [(50, 0, 0), (60, 5, 0)], [(60, 5, 0), (50, 0, 0)]
    round_ = [(30, 0, 1), (20, 0, 1)]
    circle = entity("CIRCLE", point((25, 0)), (40, 5))
    file.write_text(dxf(lwpolyline(there, closed=False), lwpolyline(back, closed=False), circle, circle))
    _, _, err = run(capsys, str(file), "-o", str(tmp_path / "a.json"))
    assert "warning: 2 curves coincide with others and are cut twice\n" in err
    assert "between the contours: give convert --safe-z and --depth" in err
    file.write_text(dxf(lwpolyline(round_, closed=True)))
    _, _, err = run(capsys, str(file), "-o", str(tmp_path / "a.json"))
    assert "on others" not in err
    assert "rapid" not in err


@pytest.mark.parametrize("command", [["convert", "-m", "mill"], ["inspect"], ["report", "-m", "mill"]])
def test_a_drawing_in_place_of_a_path_is_told_to_be_imported(command, capsys):
    assert main([*command, PLATE]) == 2
    said = without_progress(capsys.readouterr().err)
    wanted = "a path file, such as ph-post import makes of it"
    assert said == f"ph-post: {PLATE}: this is a drawing; expected {wanted}\n"


def test_a_layer_that_is_not_there_and_strictness_are_told(capsys):
    status, _, err = run(capsys, PLATE, "--layer", "CUT")
    assert (status, err) == (
        2,
        f"ph-post: {PLATE}: nothing is drawn on layer 'CUT'; expected one of GROOVE, HOLES, NOTES, OUTLINE, POCKET\n",
    )
    status, _, err = run(capsys, PLATE, "--strict")
    assert status == 2
    assert err.endswith("some of the drawing cannot be taken, and --strict is given; got 1 TEXT\n")
    for wrong in (
        ("--scale", "0"),
        ("--feed", "-1"),
        ("--origin", "1"),
        ("--scale", "1/0"),
        ("--feed", "nan"),
    ):
        assert run(capsys, PLATE, *wrong)[0] == 2


def test_a_drawing_in_inches_keeps_its_numbers(capsys, monkeypatch):
    text = dxf(entity("LINE", point((0.1, 0)), point((0.7, 0.3), 11)), units=1)
    monkeypatch.setattr(sys, "stdin", io.TextIOWrapper(io.BytesIO(text.encode())))
    status, out, _ = run(capsys, "-", "--feed", "600")
    made = json.loads(out)
    assert (status, made["units"], made["name"]) == (0, "inch", "stdin")
    assert made["segments"][0]["points"] == [[0.1, 0], [0.7, 0.3]]
    assert made["feed"] == "3000/127"


def test_heights_are_kept_where_that_is_asked_for(tmp_path, capsys):
    file = tmp_path / "a.dxf"
    file.write_text(dxf(entity("LINE", point((0, 0, 1)), point((10, 0, 5), 11))))
    path = imported(main, file, tmp_path, "--axes", "XYZ")
    assert path.axes == ("X", "Y", "Z")
    assert sampled(path)[0][[0, -1]].tolist() == [[0, 0, 1], [10, 0, 5]]
    file.write_text(dxf(entity("LINE", point((0, 0, 3)), point((10, 0, 3), 11))))
    assert imported(main, file, tmp_path).axes == ("X", "Y")
    assert "lies at a height of 3 mm" in capsys.readouterr().err


def test_what_is_too_large_is_refused_at_once(capsys, tmp_path):
    file = tmp_path / "huge.dxf"
    with file.open("wb") as sparse:
        sparse.truncate(2**30)
    status, _, err = run(capsys, str(file))
    assert (status, err) == (
        2,
        f"ph-post: {file}: the drawing is too large; expected at most {MAX_BYTES >> 20} MB; got 1024 MB\n",
    )
    file.write_text(dxf().replace("0\nEOF", "0\nLINE\n" * (5 * MAX_ENTITIES) + "0\nEOF"))
    status, _, err = run(capsys, str(file))
    assert status == 2
    assert "the drawing is too large; expected at most 500000 records" in err


def test_a_drawing_goes_through_to_a_compensated_program(capsys, tmp_path):
    path, program = tmp_path / "outline.json", tmp_path / "outline.ngc"
    assert run(capsys, PLATE, "--layer", "OUTLINE", "--feed", "800", "-o", str(path))[0] == 0
    assert main(["inspect", str(path), "-m", "router", "--json"]) == 0
    points = json.loads(capsys.readouterr().out)["turning_points"]
    assert {point["axis"] for point in points} == {"X", "Y"}
    assert main(["convert", str(path), "-m", "router", "--strategy", "suppress", "-o", str(program)]) == 0
    assert "G2" in program.read_text()


def test_the_option_takes_every_unit_there_is():
    assert set(UNIT_NAMES) == set(UNITS)
