"""Contours with cutter compensation, shifted in place: the tool's path is LinuxCNC's, the table a play operator's."""

from __future__ import annotations

import random
import re
import shutil
from functools import cache

import pytest
from support.canon import needs_rs274
from support.canon_player import canon_moves
from support.corpus import stepper
from support.corpus_judge import GAP, _sampled, played_places, table_of
from support.cutter_outlines import FANUC, outline
from support.ideal_play import distances

from ph_post.api.compensation import compensated, undo
from ph_post.api.options import CompensateOptions
from ph_post.dialects.reading import read_as
from ph_post.files.storage import SourceBytes
from ph_post.progress import no_progress
from ph_post.units import MM
from ph_post.verify.verify import verify

NOTE = re.compile(rb"note cutter compensation holds for radii up to ([\d.]+) mm", re.IGNORECASE)


@cache
def changed(text, dialect="linuxcnc", ending=".ngc"):
    source = SourceBytes(name=f"a{ending}", stem="a", data=text.encode())
    return compensated(source, stepper(dialect), CompensateOptions(), "program", no_progress)


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
        (("X40.", "X20. Y50.\nX40. Y30."), "an axis turns in it where it rests along no straight line, and on no arc"),
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


LATHE = """%
O2004
G00 G18 G21 G40 G80 G99
G50 S2500
G96 S300 M03
T0202
G00 X40. Z2.5
M08
G00 G42 X-1.6 Z2.5
G01 Z0. F0.1
X20.
X22. Z-1.
Z-24.
G02 X25. Z-25.5 R1.5
G01 X30.
G03 X33. Z-27. R1.5
G01 Z-52.
X40.
G00 G40 Z2.5
G00 X60. Z20.
M30
%
"""


def in_radii(text):
    """The same for LinuxCNC, in radii, as far as the programs here use it."""
    text = re.sub(r"X(-?[\d.]+)", lambda found: f"X{0.5 * float(found[1]):.6f}", re.sub(r"\([^)]*\)", "", text))
    text = re.sub(r"G99|G50 S2500|G96 S300|O2004|%", "", text)
    return text.replace("T0202", "T2 M6\nG43\nF100").replace("F0.1", "F100")


def nose_errors(text, made, radius, orientation):
    """Largest error [mm] of the nose's path from where it is on the part, of the plain program and of another."""
    tools = f"T2 P2 D{2.0 * radius} Q{orientation}\n"
    begins = ((30.0, 0.0, 40.0), (31.0, 0.0, 41.0))
    found = [_sampled([canon_moves(in_radii(one), begin, tools) for begin in begins]) for one in (text, made)]
    path, cuts = found[0]
    errors = []
    for motor, cutting in found:
        low = cutting & (motor[:, 2] < 0.5) & (motor[:, 0] < 19.5)
        behind = [table_of(motor, side, "XZ")[low] for side in (-1.0, 1.0)]
        errors.append(max(distances(one, path[cuts]).max() for one in behind))
    return errors


def turned(rng):
    """Profile of a shaft, some with necks that go back in X, cut from its face on."""
    x, z, lines = 0.0, 0.0, []

    def go(dx, dz, arc=""):
        nonlocal x, z
        x, z = x + dx, z - dz
        lines.append(f"{arc or 'G01'} X{2.0 * x:.3f} Z{z:.3f}" + (f" R{max(abs(dx), dz):.3f}" if arc else ""))

    go(rng.uniform(4.0, 6.0), 0.0)
    while x < 15.0 and len(lines) < 14:
        kind = rng.choice(("length", "shoulder", "taper", "round", "fillet", "neck"))
        size = rng.uniform(1.5, 3.0)
        go(0.0, rng.uniform(3.0, 8.0))
        if kind == "shoulder":
            go(size, 0.0)
        elif kind == "taper":
            go(0.4 * size, size)
        elif kind == "round":
            go(size, size, "G03")
        elif kind == "fillet":
            go(size, size, "G02")
        elif kind == "neck":
            go(-0.4 * size, 2.0 * size)
            go(0.0, rng.uniform(4.0, 8.0))
            go(0.4 * size, 2.0 * size)
    begin = LATHE.index("X20.")
    return LATHE[:begin] + "\n".join(lines) + f"\n{rng.choice(('G00', 'G01'))} X40.\n" + LATHE[LATHE.index("G00 G40") :]


@needs_rs274
@pytest.mark.parametrize("seed", range(8))
@pytest.mark.thinned(2)
def test_random_profiles_are_followed_by_the_nose(seed):
    rng = random.Random(seed)
    text = turned(rng)
    made = changed(text, "fanuc", ".nc").program().decode()
    found = NOTE.search(made.encode())
    assert found is not None
    radius = rng.uniform(0.2, 1.0) * min(float(found[1]), 1.2)
    errors = nose_errors(text, made, radius, rng.choice([1, 2, 3, 4, 6, 8, 9]))
    assert errors[1] < 0.003 < errors[0]
    assert verdict(text, made.encode(), "fanuc", ".nc").ok


@pytest.fixture(scope="module")
def lathe_part():
    return changed(LATHE, "fanuc", ".nc")


@needs_rs274
@pytest.mark.parametrize("orientation", [1, 2, 3, 4, 6, 8, 9])
@pytest.mark.parametrize("radius", [0.2, 0.8])
def test_the_nose_of_a_lathes_tool_follows_for_every_orientation(lathe_part, radius, orientation):
    result = lathe_part
    made = result.program().decode()
    assert all(row.compensated == row.all for row in result.axis_reversals)
    assert radius <= float(NOTE.search(made.encode())[1])
    errors = nose_errors(LATHE, made, radius, orientation)
    assert errors[0] > 0.9 * 0.5 * GAP
    assert errors[1] < 0.002
    assert verdict(LATHE, made.encode(), "fanuc", ".nc").ok
    assert undo(SourceBytes(name="a.nc", stem="a", data=made.encode())) == LATHE.encode()
