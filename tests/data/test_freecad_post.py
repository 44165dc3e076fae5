"""The file that FreeCAD loads, in stubs of both its interfaces, with a ph-post that keeps notes."""

from __future__ import annotations

import ast
import json
import os
import sys
from types import SimpleNamespace

import pytest
from support.stub_freecad import FAKE, POST, Command, Postable, Toolpath, load_post

SPLINE = [
    ["G0", {"X": 0.0, "Y": 0.0}],
    ["G5", {"X": 4.0, "Y": 0.0, "I": 1.0, "J": 1.0, "P": -1.0, "Q": 1.0, "F": 10.0}],
]


class Vector:
    def __init__(self, x, y):
        self.x, self.y = x, y


class Curve:
    """A quadratic with the methods of a Part.BSplineCurve."""

    TypeId, Degree, FirstParameter, LastParameter = "Part::GeomBSplineCurve", 2, 0.0, 1.0

    def __init__(self, periodic=False):
        self.periodic = periodic

    def copy(self):
        return Curve(self.periodic)

    def isPeriodic(self):
        return self.periodic

    def setNotPeriodic(self):
        self.periodic = False

    def getKnots(self):
        assert not self.periodic
        return [0.0, 1.0]

    def getMultiplicities(self):
        return [3, 3]

    def getPoles(self):
        return [Vector(0, 0), Vector(2, 2), Vector(4, 0)]

    def getWeights(self):
        return [1.0, 1.0, 1.0]


class Edge:
    FirstParameter, LastParameter = 0.0, 1.0

    def __init__(self, curve=None, height=0.0):
        self.Curve, self.BoundBox = curve or Curve(), SimpleNamespace(ZLength=height)

    def toNurbs(self):
        return SimpleNamespace(Edges=[self])


def operation(label="Engraving", **more):
    lines = [Command("G1", {"X": float(x), "F": 10.0}) for x in range(1, 5)]
    return SimpleNamespace(
        Label=label,
        Name=label,
        InList=[],
        Path=Toolpath([Command("G0", {"X": 0.0, "Y": 0.0}), *lines]),
        **more,
    )


def shape(*edges):
    return SimpleNamespace(Shape=SimpleNamespace(Edges=list(edges)))


@pytest.fixture
def ph_post(tmp_path, monkeypatch):
    """A ph-post in a folder with a blank in its name, and what it was told."""
    folder = tmp_path / "a shop"
    folder.mkdir()
    (folder / "fake.py").write_text(FAKE)
    command = folder / "ph-post"
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{folder}/fake.py" "$@"\n')
    command.chmod(0o755)
    answers(folder, [None])
    monkeypatch.setenv("PH_POST", str(command))
    monkeypatch.setenv("PYTHONHOME", os.fspath(tmp_path / "FreeCAD's own Python"))
    return folder


def answers(folder, operations, post="linuxcnc"):
    splines = sum(name == "G5" for moves in operations if moves for name, _ in moves)
    told = {"dialect": "linuxcnc", "post": post, "operations": operations, "splines": splines}
    (folder / "answer.json").write_text(json.dumps(told))


def calls(folder):
    return [json.loads(line) for line in (folder / "calls.jsonl").read_text().splitlines()]


def test_the_file_is_python_that_every_freecad_since_0_20_reads():
    ast.parse(POST.read_text(), feature_version=(3, 8))


def test_0_20_posts_with_freecads_own_and_compensates(ph_post, tmp_path, monkeypatch):
    post, console = load_post(monkeypatch, "0.20")
    out = tmp_path / "part.ngc"
    text = post.export([operation()], str(out), "--machine=mill.toml --no-header --max-slowdown 0.2 --strict")
    assert text.splitlines()[:3] == [
        "(compensated)",
        "(linuxcnc --no-show-editor --no-header)",
        "(begin Engraving)",
    ]
    assert "G1 X4.000 F600.000" in text
    assert out.read_text() == text
    asked, told = calls(ph_post)
    assert asked["words"] == ["freecad", "--trace", "-", "-m", "mill.toml"]
    assert told["words"] == [
        "convert",
        "-",
        "-m",
        "mill.toml",
        "--max-slowdown",
        "0.2",
        "--strict",
        "-o",
        "-",
    ]
    assert not told["leaked"]
    assert console.warnings == ["backlash: warning: mind the gap\n"]
    assert "backlash: program: 2 stops\n" in console.messages


def test_a_dash_writes_no_file(ph_post, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    post, _ = load_post(monkeypatch, "0.20")
    assert post.export([operation()], "-", "-m mill").startswith("(compensated)")
    assert [path.name for path in tmp_path.iterdir()] == ["a shop"]


SOLID = SimpleNamespace(Shape=SimpleNamespace(getElement=lambda _name: shape(Edge()).Shape))
JOB = SimpleNamespace(Model=SimpleNamespace(Group=[shape(Edge())]))


@pytest.mark.parametrize(
    "thing",
    [
        operation(BaseShapes=[shape(Edge())]),
        operation(Base=[(SOLID, ("Edge1",))]),
        operation(Base=operation("below", BaseShapes=[shape(Edge(Curve(periodic=True)))])),
        SimpleNamespace(
            **{
                **vars(operation()),
                "InList": [SimpleNamespace(InList=[JOB])],
            }
        ),
    ],
    ids=["shapes", "edges", "dressup", "model"],
)
def test_curves_of_the_operation_reach_ph_post_and_its_splines_the_program(thing, ph_post, monkeypatch):
    post, _ = load_post(monkeypatch, "0.20")
    answers(ph_post, [SPLINE])
    before = [command.Name for command in thing.Path.Commands]
    text = post.export([thing], "-", "--machine=mill")
    asked = json.loads(calls(ph_post)[0]["text"])["operations"][0]
    wanted = {
        "degree": 2,
        "knots": [0.0] * 3 + [1.0] * 3,
        "points": [[0, 0], [2, 2], [4, 0]],
        "weights": [1.0] * 3,
    }
    assert asked["curves"] == [wanted]
    assert [name for name, _ in asked["moves"]] == before
    assert "G5 X4.000 Y0.000 I1.000 J1.000 P-1.000 Q1.000 F600.000" in text
    assert "(linuxcnc --no-show-editor --precision=5)" in text
    assert [command.Name for command in thing.Path.Commands] == before, "the document stays as it is"


@pytest.mark.parametrize(
    ("arguments", "thing"),
    [
        ("--no-curves", operation(BaseShapes=[shape(Edge())])),
        ("--axis-modal", operation(BaseShapes=[shape(Edge())])),
        ("", operation(BaseShapes=[shape(Edge(height=1.0))])),
        ("", operation(BaseShapes=[shape(Edge(SimpleNamespace(TypeId="Part::GeomCircle")))])),
    ],
    ids=["not wanted", "words may be left out", "not flat", "a circle"],
)
def test_no_curves_are_asked_for(arguments, thing, ph_post, monkeypatch):
    post, _ = load_post(monkeypatch, "0.20")
    post.export([thing], "-", f"--machine=mill {arguments}")
    assert not json.loads(calls(ph_post)[0]["text"])["operations"][0].get("curves")


def test_a_post_processor_that_loses_splines_gets_the_straight_moves(ph_post, monkeypatch):
    post, console = load_post(monkeypatch, "0.20")
    answers(ph_post, [SPLINE])

    def without_splines(self, name, words=None):
        self.Name, self.Parameters = "(G5)" if name == "G5" else name, dict(words or {})

    monkeypatch.setattr("support.stub_freecad.Command.__init__", without_splines)
    text = post.export([operation(BaseShapes=[shape(Edge())])], "-", "--machine=mill")
    assert "G1 X4.000 F600.000" in text
    assert "G5" not in text
    assert console.warnings[0] == "backlash: linuxcnc cannot write G5; splines stay sampled\n"


REFUSED = {
    "no machine": ("", "no machine; expected --machine=FILE.toml, or a shipped one, in the job's arguments"),
    "no value": ("--machine --strict", "--machine: no value; expected --machine=... in the job's arguments"),
    "open quotes": ("--machine='mill", "the job's arguments: no closing quotation; got --machine='mill"),
    "editor": (
        "-m mill --show-editor",
        "--show-editor: the editor would show the program as it is before compensation",
    ),
    "itself": (
        "-m mill --post=backlash",
        "--post=backlash: this post-processor itself; expected another one",
    ),
    "no such post": ("-m mill --post=none", "--post=none: FreeCAD has no such post-processor"),
    "it exits": (
        "-m mill --post=linuxcnc --precision=4 --preamble",
        "FreeCAD's post-processor linuxcnc: linuxcnc: error: argument --preamble: expected one argument",
    ),
    "it is mute": ("-m mill --post=mute", "FreeCAD's post-processor mute: it wrote nothing"),
    "no ph-post": ("-m mill --ph-post=/none/x", "--ph-post: no program of that name; got /none/x"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_done_is_raised_in_one_line_and_nothing_written(case, ph_post, tmp_path, monkeypatch):
    post, _ = load_post(monkeypatch, "0.20")

    def with_a_preamble(self, name):
        self.name, self.tooltipArgs = name, "--no-header --precision PRECISION --preamble PREAMBLE"

    monkeypatch.setattr("support.stub_freecad.Script.__init__", with_a_preamble)
    out = tmp_path / "part.ngc"
    out.write_text("what was there")
    arguments, line = REFUSED[case]
    with pytest.raises(post.BacklashError) as refusal:
        post.export([operation()], str(out), arguments)
    assert str(refusal.value) == line
    assert out.read_text() == "what was there"


def test_what_ph_post_refuses_is_raised_with_its_line_and_place(ph_post, tmp_path, monkeypatch):
    post, _ = load_post(monkeypatch, "0.20")
    (ph_post / "refusal").write_text("ph-post: stdin:3:1: unknown word\n    Q7\n    ^^\n")
    with pytest.raises(post.BacklashError) as refusal:
        post.export([operation()], str(tmp_path / "part.ngc"), "--machine=mill")
    assert str(refusal.value) == "ph-post: program:3:1: unknown word\n    Q7\n    ^^"
    assert not (tmp_path / "part.ngc").exists()


def test_a_file_that_cannot_be_written_is_told(ph_post, tmp_path, monkeypatch):
    post, _ = load_post(monkeypatch, "0.20")
    with pytest.raises(post.BacklashError, match=r"none/part\.ngc: cannot be written; got No such file"):
        post.export([operation()], str(tmp_path / "none" / "part.ngc"), "--machine=mill")


def test_a_dialect_without_a_post_processor_asks_for_one(ph_post, monkeypatch):
    post, _ = load_post(monkeypatch, "0.20")
    answers(ph_post, [None], post=None)
    with pytest.raises(post.BacklashError, match=r"has no post-processor for the dialect linuxcnc; expected --post"):
        post.export([operation()], "-", "--machine=mill")
    assert "(grbl " in post.export([operation()], "-", "--machine=mill --post=grbl")


def test_backslashes_and_blanks_in_paths_are_kept(ph_post, monkeypatch):
    post, _ = load_post(monkeypatch, "0.20")
    options = post.read_arguments(r'"--machine=C:\my shop\mill.toml" --post grbl')
    assert (options.machine, options.post) == (r"C:\my shop\mill.toml", "grbl")


def test_ph_post_is_found_in_this_order(ph_post, tmp_path, monkeypatch):
    post, _ = load_post(monkeypatch, "0.20")
    installed, by_hand = tmp_path / "installed", tmp_path / "by_hand"
    for file in (installed, by_hand):
        file.write_text("#!/bin/sh\n")
        file.chmod(0o755)
    monkeypatch.setattr(post, "INSTALLED", f"{installed} -m ph_post")
    monkeypatch.setenv("PATH", str(ph_post))
    assert post.find_ph_post(str(by_hand)) == [str(by_hand)]
    assert post.find_ph_post() == [str(ph_post / "ph-post")]
    monkeypatch.delenv("PH_POST")
    assert post.find_ph_post() == [str(installed), "-m", "ph_post"]
    monkeypatch.setattr(post, "INSTALLED", "")
    assert post.find_ph_post() == [str(ph_post / "ph-post")]
    monkeypatch.setenv("PATH", str(tmp_path / "none"))
    with pytest.raises(post.BacklashError, match="ph-post was not found; expected it on the path, in PH_POST"):
        post.find_ph_post()


def job_of(*sections, arguments="--machine=mill --no-header", machine=None):
    return SimpleNamespace(PostProcessorArgs=arguments, sections=sections, Machine=machine)


def postable(label="Engraving", **more):
    source = operation(label, **more)
    return Postable(item_type="operation", label=label, path=source.Path, source=source)


def test_1_x_gets_sections_with_their_programs(ph_post, monkeypatch):
    post, _ = load_post(monkeypatch, "1.x")
    answers(ph_post, [None, SPLINE])
    drawn = postable("Drawn", BaseShapes=[shape(Edge())])
    job = job_of(("1", [operation("Outline")]), ("2", [drawn]))
    found = post.Backlash(job).export()
    assert [name for name, _ in found] == ["1", "2"]
    assert found[0][1].startswith(
        "(compensated)\n(linuxcnc --no-show-editor --no-header --precision=5)\n(begin Outline)"
    )
    assert "G5 X4.000" in found[1][1]
    assert job.PostProcessorArgs == "--machine=mill --no-header", "the document stays as it is"
    assert [command.Name for command in drawn.path.Commands] == ["G0", *["G1"] * 4]


def test_a_script_in_1_x_gets_the_arguments_of_its_own_help(ph_post, monkeypatch):
    post, _ = load_post(monkeypatch, "1.x")
    job = job_of(("allitems", [operation()]), arguments="-m mill --post=script --no-tlo --strict")
    found = post.Backlash(job).export()
    assert found[0][1].splitlines()[1] == "(--no-tlo)"
    assert "--strict" in calls(ph_post)[1]["words"]


def test_1_x_finds_the_class_by_the_name_of_the_file(ph_post, monkeypatch):
    post, _ = load_post(monkeypatch, "1.x")
    assert getattr(post, POST.stem.removesuffix("_post").title()) is post.Backlash
    assert post.POST_TYPE == "machine"


def test_selected_operations_arrive_as_a_dictionary(ph_post, monkeypatch):
    post, _ = load_post(monkeypatch, "1.x")
    job = job_of(("allitems", [operation()]))
    found = post.Backlash({"job": job, "operations": []}).export()
    assert found[0][1].startswith("(compensated)")


@pytest.mark.parametrize(("name", "preamble"), [("linuxcnc", "G17 G90"), ("grbl", "G90 G21"), ("grbl", "G0 Z50")])
def test_export2_has_the_machines_own_settings_and_the_arguments_from_its_property(
    name, preamble, ph_post, monkeypatch
):
    """A preamble that the user wrote stays; else it is that of the post-processor that writes."""
    post, _ = load_post(monkeypatch, "1.x")
    properties = {"backlash_arguments": f"--machine=mill --post={name} --strict"}
    if preamble == "G0 Z50":
        properties["preamble"] = preamble
    job = job_of(("allitems", [postable()]), arguments="", machine=SimpleNamespace(postprocessor_properties=properties))
    found = post.Backlash(job).export2()
    assert [section for section, _ in found] == ["allitems"]
    assert found[0][1].splitlines()[:2] == ["(compensated)", f"({preamble})"]
    assert calls(ph_post)[1]["words"] == ["convert", "-", "-m", "mill", "--strict", "-o", "-"]


def test_export2_tells_where_its_dialog_was_cancelled(ph_post, monkeypatch):
    post, _ = load_post(monkeypatch, "1.x")
    backlash = post.Backlash(job_of(("allitems", [postable()])))
    backlash.cancelled = True
    assert backlash.export2() is None


def test_export2_without_a_machine_for_ph_post_raises(ph_post, monkeypatch):
    post, _ = load_post(monkeypatch, "1.x")
    machine = SimpleNamespace(postprocessor_properties={})
    with pytest.raises(post.BacklashError, match="no machine; expected --machine"):
        post.Backlash(job_of(("allitems", []), arguments="", machine=machine)).export2()
