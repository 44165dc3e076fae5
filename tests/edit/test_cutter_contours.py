"""Contours with cutter compensation, shifted in place: the tool's path is LinuxCNC's, the table a play operator's."""

from __future__ import annotations

import random
import re
import shutil

import pytest
from support.corpus import TOOLS, stepper
from support.corpus_judge import GAP, played_places, table_of
from support.cutter_outlines import outline
from support.ideal_play import distances

from ph_post.api.compensation import compensated, undo
from ph_post.api.options import CompensateOptions
from ph_post.dialects.reading import read_as
from ph_post.files.storage import SourceBytes
from ph_post.progress import no_progress
from ph_post.units import MM
from ph_post.verify.verify import verify

NOTE = re.compile(rb"note cutter compensation holds for radii up to ([\d.]+) mm", re.IGNORECASE)
FANUC = """%
O1011
G21 G17 G90 G40 G54
G00 X-20. Y-20. Z5.
G01 Z-2. F150.
G41 D01 X0. Y-10. F300.
Y30.
X40.
Y0.
X-10.
G40 X-20. Y-20.
G00 Z5.
M30
%
"""


def changed(text, dialect="linuxcnc", ending=".ngc"):
    source = SourceBytes(name=f"a{ending}", stem="a", data=text.encode())
    return compensated(source, stepper(dialect), CompensateOptions(tool_table=TOOLS), "program", no_progress)


def verdict(text, made, dialect, ending):
    """What the checker says of two texts that it reads by itself."""
    programs = (read_as(dialect, data, f"a{ending}") for data in (text.encode(), made))
    return verify(*programs, tolerance=0.005 * MM, machine=stepper(dialect))


def errors(text, made):
    """Largest error [mm] of the table while the tool cuts, of the plain program and of another."""
    path, cuts = played_places("linuxcnc", text.encode())
    found = []
    for data in (text.encode(), made):
        motor, cutting = played_places("linuxcnc", data)
        low = cutting & (motor[:, 2] < -1.0 + 1e-6)
        behind = [table_of(motor, side, "XYZ")[low] for side in (-1.0, 1.0)]
        found.append(max(distances(one, path[cuts]).max() for one in behind))
    return found


@pytest.mark.skipif(shutil.which("rs274") is None, reason="needs LinuxCNC's interpreter")
@pytest.mark.parametrize("seed", [0, 2])
def test_the_table_follows_the_cutters_path(seed):
    """Whatever the radius up to the one that the head names, and nothing is written where it would not."""
    text, radius = outline(random.Random(seed))
    made = changed(text).program()
    note = NOTE.search(made)
    if note is None:
        assert b"G41.1" in made or b"G42.1" in made
        assert text.partition("G1 Z-1 F200\n")[2].partition("G40")[0].encode() in made
        return
    assert radius <= float(note[1])
    plain, left = errors(text, made)
    assert plain > 0.4 * GAP
    assert left < 0.004
    assert undo(SourceBytes(name="a.ngc", stem="a", data=made)) == text.encode()
    assert verdict(text, made, "linuxcnc", ".ngc").ok


def test_a_contour_of_fanuc_is_shifted_and_keeps_its_words():
    made = changed(FANUC, "fanuc", ".nc").program()
    assert float(NOTE.search(made)[1]) == 20.0
    lines = made.decode().splitlines()
    begin, end = (next(k for k, line in enumerate(lines) if word in line) for word in ("G41 D01", "G40 X"))
    inside = [line for line in lines[begin : end + 1] if not line.startswith("(")]
    assert inside[0] == "G41 D01 X0.025 Y-9.975 F300."
    assert inside[-1] == "G40 X-20.025 Y-20.025"
    assert all(re.fullmatch(r"(?:G1 )?(?:X[-\d.]+)? ?(?:Y[-\d.]+)?(?: F[\d.]+)?", line) for line in inside[1:-1])
    assert verdict(FANUC, made, "fanuc", ".nc").ok


@pytest.mark.parametrize(
    ("words", "why"),
    [
        (("X40.", "G02 X40. Y30. R20.\nG01"), "an axis turns in it where it rests along no straight line"),
        (("Y0.", "Y0.\nM08"), "it holds other words than of its moves"),
        (("G41 D01 X0. Y-10.", "G41 D01 X-19. Y-10."), "its directions would hold for cutters of a radius up to 1 mm"),
        (("G40 X-20.", "G40 G00 Z5.\nX-20."), "where it begins and ends is not known"),
        (("X40.", "G04 P100\nX40."), "it holds other words than of its moves"),
    ],
)
def test_what_depends_on_the_radius_is_left_and_named(words, why):
    text = FANUC.replace(*words)
    assert text != FANUC
    result = changed(text, "fanuc", ".nc")
    assert any("cutter compensation, left as it is: " + why in one for one in result.warnings)
    stretch = text[text.index("G41") : text.index("G40", text.index("G41"))]
    assert stretch.encode() in result.program()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (r"Y15\.9\d+\n", "Y14.1\n"),
        (r"G1 X39\.9\d+ Y13\.9\d+ (F[\d.]+)", r"G1 X39.975 Y13.975 \1\nG4 P10"),
    ],
)
def test_a_steep_line_or_a_dwell_on_the_contour_is_a_failure(old, new):
    made = changed(FANUC, "fanuc", ".nc").program().decode()
    damaged = re.sub(old, new, made, count=1)
    assert damaged != made
    assert not verdict(FANUC, damaged.encode(), "fanuc", ".nc").ok


OTHERS = {
    "siemens": (
        ".mpf",
        "N10 G17 G54 G71 G90\nN20 G0 X-20 Y-20 Z5\nN30 G1 Z-1 F200\nN40 G42 G1 Y0 X-10 F600\nN50 X30\nN60 Y40\n"
        "N70 X0\nN80 Y-10\nN90 G40 X-20 Y-20\nN110 G0 Z5\nN120 M30\n",
    ),
    "heidenhain": (
        ".h",
        "0 BEGIN PGM A MM\n1 L X-20 Y-20 Z+5 R0 FMAX\n2 L Z-1 F200\n3 L X-10 Y+0 RR F600\n4 L X+30\n5 L Y+40\n"
        "6 L X+0\n7 L Y-10\n8 L X-20 Y-20 R0\n9 L Z+5 FMAX\n10 END PGM A MM\n",
    ),
    "heidenhain-iso": (
        ".i",
        "%A G71 *\nN10 G00 G40 G90 Z+5 *\nN20 X-20 Y-20 *\nN30 G01 Z-1 F200 *\nN40 G42 X-10 Y+0 F600 *\nN50 X+30 *\n"
        "N60 Y+40 *\nN70 X+0 *\nN80 Y-10 *\nN90 G40 X-20 Y-20 *\nN100 G00 Z+5 M2 *\nN99 %A G71 *\n",
    ),
}


@pytest.mark.parametrize("dialect", OTHERS)
def test_other_languages_have_the_same_contour_on_the_right(dialect):
    """The tool comes on from below, by 20 mm less its radius, and leaves to the left, by as much: from Y 0, and X 0."""
    ending, text = OTHERS[dialect]
    made = changed(text, dialect, ending).program()
    assert float(NOTE.search(made)[1]) == 20.0
    assert verdict(text, made, dialect, ending).ok
