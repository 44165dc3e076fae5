"""A job posted through the real FreeCAD, without a screen, in one run of it."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from ph_post.api.freecad import install, macro_folders
from ph_post.drive.machinefile import read_machine
from ph_post.edit.undo import original_of
from ph_post.gcode.read import read_program
from ph_post.verify.verify import verify

ROOT = Path(__file__).parents[2]
JOB = ROOT / "tests" / "support" / "freecad_job.py"
COMMAND = shutil.which("freecadcmd")

pytestmark = [
    pytest.mark.skipif(COMMAND is None, reason="FreeCAD is not installed here (apt-get install freecad-python3)"),
    pytest.mark.slow,
]

PLAIN, LINES, CURVES, GRBL = "plain.ngc", "lines.ngc", "curves.ngc", "grbl.ngc"
ARGUMENTS = "--machine=router --max-slowdown=1 --effort=0.05 --no-header"
REFUSED = {
    "no machine": ("backlash", "--no-header", "no machine; expected --machine=FILE.toml, or a shipped one"),
    "missing machine": ("backlash", "--machine=none.toml", "ph-post: none.toml: no such file"),
    "no ph-post": ("backlash", "--machine=router --ph-post=/none/ph-post", "--ph-post: no program"),
    "unknown argument": ("backlash", "--machine=router --frobnicate=3", "No such option '--frobnicate'"),
    "unknown post": ("backlash", "--machine=router --post=none", "--post=none: FreeCAD has no such"),
    "their argument": ("backlash", "--machine=router --post=linuxcnc --precision", "expected one argument"),
    "their dialect": ("backlash", "--machine=stepper --post=linuxcnc --strict", "ph-post: program:"),
}
"""Arguments that cannot be served, and the line that FreeCAD shows."""

POSTED = 4
"""Programs before those."""


@pytest.fixture(scope="module")
def posted(tmp_path_factory):
    """Everything that the tests look at, posted by one FreeCAD."""
    folder = tmp_path_factory.mktemp("freecad")
    ph_post = folder / "ph-post"
    start = f"import sys\nsys.path.insert(0, {str(ROOT)!r})\n"
    (folder / "start.py").write_text(f"{start}from ph_post.cli.main import main\nsys.exit(main())\n")
    ph_post.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{folder}/start.py" "$@"\n')
    ph_post.chmod(0o755)
    install(str(folder))
    (folder / "kept.ngc").write_text("what was there\n")
    posts = [
        ("linuxcnc", "--no-header", PLAIN),
        ("backlash", f"{ARGUMENTS} --no-curves", LINES),
        ("backlash", ARGUMENTS, CURVES),
        ("backlash", "--machine=stepper --max-slowdown=1 --effort=0.05 --no-header --translate_drill", GRBL),
        *((post, arguments, "kept.ngc") for post, arguments, _ in REFUSED.values()),
    ]
    environment = {
        "PATH": os.environ["PATH"],
        "HOME": str(folder),
        "PH_POST": str(ph_post),
        "OPENBLAS_NUM_THREADS": "1",
        "PH_JOB_POSTS": json.dumps([(post, words, str(folder / name)) for post, words, name in posts]),
        "PH_JOB_FOLDER": str(folder),
        "PH_JOB_REPORT": str(folder / "report.json"),
    }
    assert COMMAND is not None
    run = subprocess.run(
        [COMMAND, str(JOB)],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        env=environment,
        check=False,
        timeout=300,
    )
    assert (folder / "report.json").exists(), run.stdout[-2000:] + run.stderr[-2000:]
    return folder, json.loads((folder / "report.json").read_text()), run.stdout + run.stderr


def program(posted, name):
    return read_program((posted[0] / name).read_bytes(), name)


def moves(text, words):
    return [line for line in text.splitlines() if re.match(rf"({words})\s", line)]


def test_all_programs_are_posted(posted):
    assert posted[1]["said"][:POSTED] == [""] * POSTED


def test_without_curves_only_what_is_declared_differs_from_what_freecad_posts(posted):
    verdict = verify(program(posted, PLAIN), program(posted, LINES), tolerance=5e-6, machine=read_machine("router"))
    assert verdict.ok, verdict.failures


def test_with_curves_only_what_is_declared_differs_from_the_program_with_curves(posted):
    after = program(posted, CURVES)
    verdict = verify(original_of(after), after, tolerance=5e-6, machine=read_machine("router"))
    assert verdict.ok, verdict.failures


@pytest.mark.parametrize("name", [LINES, CURVES])
def test_every_axis_is_shifted_where_it_reverses(posted, name):
    """The outline alone, begun on the right, reverses X once and Y twice a round, the spline Y twice."""
    text = (posted[0] / name).read_text()
    marks = "".join(line for line in text.splitlines() if line.startswith("(ph-post: +"))
    assert len(re.findall(r"\bX[+-]", marks)) >= 2
    assert len(re.findall(r"\bY[+-]", marks)) >= 4
    assert all(f"(ph-post: offset {axis} " in text for axis in "XYZ")


@pytest.mark.parametrize("name", [PLAIN, LINES, CURVES])
def test_tools_spindle_coolant_cycles_offsets_feeds_and_comments_survive(posted, name):
    text = (posted[0] / name).read_text()
    lines = [line.strip() for line in text.splitlines()]
    assert [line for line in lines if line.startswith("M6")] == ["M6 T1", "M6 T2"]
    assert [line for line in lines if line.startswith("M3")] == ["M3 S8000", "M3 S3000"]
    assert [line for line in lines if line in ("M8", "M9")] == ["M8", "M9"]
    assert {"G55", "(begin operation: Engraving)", "(Outline)"} <= set(lines)
    assert len(moves(text, "G8[1-3]")) == 2
    assert len(moves(text, "G2|G3")) >= 3
    assert float(re.search(r"^G8[1-3] .*F([\d.]+)", text, re.MULTILINE).group(1)) == 90.0
    feeds = {float(feed) for line in moves(text, "G2|G3|G5") for feed in re.findall(r"F([\d.]+)", line)}
    assert feeds == {600.0}


def test_the_spline_reaches_the_program_as_a_spline(posted):
    """FreeCAD's own places on it are on the cubics that the program names, to the last written digit."""
    text = original_of(program(posted, CURVES)).data.decode()
    sampled = moves((posted[0] / PLAIN).read_text(), "G1")
    cubics = np.concatenate(list(cubics_of(text)))
    places = np.array(posted[1]["spline"])
    assert to_polyline(places, cubics) < 2e-5
    assert 3 <= len(moves(text, "G5")) < len(sampled) / 5


def test_a_grbl_machine_gets_what_freecads_grbl_post_processor_writes_and_no_word_that_grbl_refuses(posted):
    after = program(posted, GRBL)
    verdict = verify(original_of(after), after, tolerance=5e-6, machine=read_machine("stepper"))
    assert verdict.ok, verdict.failures
    text = after.data.decode()
    assert "(ph-post: offset X 0.03 mm)" in text
    assert not moves(text, "G5|G8[1-3]|G64|M0?6")


def cubics_of(text):
    """Places on every G5 by de Casteljau's rule, written for this test; shape (n, 2) each."""
    u = np.linspace(0.0, 1.0, 4001)[:, None]
    at = np.zeros(2)
    for line in text.splitlines():
        found = dict(re.findall(r"([A-Z])(-?[\d.]+)", line)) if line.startswith("G") else {}
        word = {letter: float(value) for letter, value in found.items()}
        end = np.array([word.get("X", at[0]), word.get("Y", at[1])])
        if word.get("G") == 5.0:
            points = [at, at + np.array([word["I"], word["J"]]), end + np.array([word["P"], word["Q"]]), end]
            rows = [np.broadcast_to(point, (len(u), 2)) for point in points]
            while len(rows) > 1:
                rows = [a + u * (b - a) for a, b in pairwise(rows)]
            yield rows[0]
        if word.get("G") in (0.0, 1.0, 2.0, 3.0, 5.0):
            at = end


def to_polyline(places, line):
    """Largest distance of places from a dense polyline [mm]."""
    start, way = line[:-1], np.diff(line, axis=0)
    size = np.maximum((way * way).sum(axis=1), 1e-30)
    worst = 0.0
    for place in places:
        u = np.clip(((place - start) * way).sum(axis=1) / size, 0.0, 1.0)
        worst = max(worst, float(np.linalg.norm(start + u[:, None] * way - place, axis=1).min()))
    return worst


@pytest.mark.parametrize("case", REFUSED)
def test_what_cannot_be_done_is_told_in_freecad_and_writes_nothing(posted, case):
    said = posted[1]["said"][POSTED + list(REFUSED).index(case)]
    assert REFUSED[case][2] in said
    assert "Traceback" not in said
    assert len(said.splitlines()) <= 3
    assert (posted[0] / "kept.ngc").read_text() == "what was there\n"
    assert not list(posted[0].glob(".backlash-*"))


def test_the_report_view_shows_the_warnings(posted):
    assert "backlash: warning: axes X, Y, Z count on friction" in posted[2]


def test_freecad_is_asked_where_its_macros_are(tmp_path):
    found = macro_folders({"PATH": os.environ["PATH"], "HOME": str(tmp_path)})
    assert found[0] == tmp_path / ".local" / "share" / "FreeCAD" / "Macro"
