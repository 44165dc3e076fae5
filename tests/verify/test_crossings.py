"""Crossings on the fly: programs of many kinds hold, and every kind of damage to them is found.

The programs come from a generator of the tests (support.crossed), which shares no code with the writer.
"""

import re
from dataclasses import replace
from functools import cache
from hashlib import sha256

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.crossed import crossed
from support.crossed_jobs import GOOD, circle
from support.followed import table_deviation

from ph_post.dialects.declaration import declared_language
from ph_post.drive.machinefile import read_machine
from ph_post.errors import InputError
from ph_post.gcode.read import read_program
from ph_post.units import MM
from ph_post.verify.play import follow_play
from ph_post.verify.verify import verify

TOLERANCE = 0.005 * MM


@cache
def pair(name):
    """Original and compensated program of a good job, as text."""
    return tuple(data.decode("latin-1") for data in crossed(GOOD[name]()))


def judged(original, compensated, machine=None):
    language = declared_language(compensated.encode("latin-1"))
    programs = (
        read_program(text.encode("latin-1"), name, language=language)
        for name, text in (("original", original), ("compensated", compensated))
    )
    return verify(*programs, tolerance=TOLERANCE, machine=machine)


def kinds(verdict):
    return {failure.kind for failure in verdict.failures}


@pytest.mark.parametrize("name", GOOD)
@pytest.mark.thinned(12)
def test_good_programs_hold(name):
    original, compensated = pair(name)
    verdict = judged(original, compensated)
    assert [failure.sentence() for failure in verdict.failures] == []
    assert verdict.checked["crossings"] == len(GOOD[name]().crossings)


ARC, BLOCK = "G3 X20.0239 Y-0.175 I-0.2 J19.9989 F1200\n", "G1 X0.225 Y-19.9739 F1209.3\n"
EDGE = "G1 X3.625 Y0.025 F802.7\n"
MARK = "+9 -1 crossing Y+, crossing X-, crossing Y-, crossing X+"
FACT = "(ph-post: 4 crossings, up to 0.4000 mm long, within 0.0011 mm)"

DAMAGE = {
    # Blocks of crossings
    "end of a crossing off": ("circle", "G1 X0.225 Y-19.9739", "G1 X0.225 Y-19.9639", "path"),
    "crossing of the wrong sign": ("circle", "G1 X0.225 Y-19.9739", "G1 X0.225 Y-20.0239", "path"),
    "crossing half as far": ("circle", "G1 X19.9739 Y0.225", "G1 X19.9989 Y0.225", "path"),
    "crossing twice as far": ("circle", "G1 X19.9739 Y0.225", "G1 X19.9239 Y0.225", "path"),
    "crossing of another axis": ("edges", "G1 X3.625 Y0.025", "G1 X3.675 Y-0.025", "crossing"),
    "crossing elsewhere along the path": ("circle", "G1 X19.9739 Y0.225", "G1 X19.9739 Y0.325", "refused"),
    "crossing longer than declared on an edge": ("edges", "G1 X3.625 Y0.025", "G1 X3.675 Y0.025", "crossing"),
    "crossing lost": ("edges", EDGE, "", "lines"),
    "crossing lost and not counted": (
        "edges",
        f"+3 -1 crossing Y+)\nG1 X3.025\n{EDGE}",
        "+2 -1 crossing Y+)\nG1 X3.025\n",
        "crossing",
    ),
    "change shorter than its lines": ("circle", "+9 -1", "+8 -1", "lines"),
    "crossing twice": ("circle", BLOCK, 2 * BLOCK, "lines"),
    "crossing and arc swapped": ("circle", BLOCK + ARC, ARC + BLOCK, "refused"),
    "crossing and line swapped": ("edges", EDGE + "G1 X20.025 F800\n", "G1 X20.025 F800\n" + EDGE, "path"),
    "crossing as a rapid": ("circle", "G1 X0.225 Y-19.9739 F1209.3", "G0 X0.225 Y-19.9739 F1209.3", "path"),
    "crossing dives": ("circle", "G1 X0.225 Y-19.9739", "G1 X0.225 Y-19.9739 Z-1.5", "path"),
    "bulge to the wrong side": ("balanced", "G1 X-0.175 Y-20.0244", "G1 X-0.175 Y-20.0194", "path"),
    "bulge too large": ("balanced", "G1 X20.0244 Y-0.175", "G1 X20.0344 Y-0.175", "path"),
    "end of a shifted line off": ("short lines", "G1 X14.9731 Y0.1414", "G1 X14.9631 Y0.1414", "path"),
    "corner crossed too far": ("two axes in a corner", "G1 X9.975 F300", "G1 X9.965 F300", "path"),
    "corner crossed the wrong way": ("two axes in a corner", "G1 X9.975 F300", "G1 X10.075 F300", "path"),
    "corner not crossed": ("two axes in a corner", "G1 X9.975 F300", "G1 X10.025 F300", "path"),
    "edge crossed beside its end": ("edges", "G1 X0.025 Y8.375", "G1 X0.035 Y8.375", "path"),
    "helix does not sink in a crossing": ("helix", "Z-1.2532 F", "Z-1.2432 F", "path"),
    "inches off by their last digits": ("inches", "G1 X0.145 Y0.001", "G1 X0.145 Y0.0008", "offset"),
    "relative crossing off": ("relative", "G1 X0.4 Y0.05", "G1 X0.4 Y0.06", "offset"),
    # Feeds
    "feed of a crossing above the motor's way": ("circle", BLOCK, BLOCK.replace("1209.3", "1219.3"), "feed"),
    "feed of an arc above the original's": ("circle", ARC, ARC.replace("F1200", "F1300"), "feed"),
    "time of a crossing too short": (
        "inverse time",
        "G1 X0.225 Y-19.9739 F2999.9",
        "G1 X0.225 Y-19.9739 F3999.9",
        "feed",
    ),
    "F not restored": (
        "edges",
        "G1 X3.625 Y0.025 F802.7\nG1 X20.025 F800",
        "G1 X3.625 Y0.025 F802.7\nG1 X20.025",
        "feed",
    ),
    # Arcs beside crossings
    "sense of an arc reversed": ("circle", ARC, ARC.replace("G3", "G2"), "path"),
    "centre of an arc off": ("circle", ARC, ARC.replace("J19.9989", "J19.9889"), "path"),
    "arc became a line": ("circle", ARC, "G1 X20.0239 Y-0.175 F1200\n", "path"),
    "plane changed": ("G19", "G19 G94", "G17 G94", "refused"),
    "end of the change off": ("circle", "G3 X-14.1171 Y-14.1671 I19.9989", "G3 X-14.1271 Y-14.1671 I19.9989", "offset"),
    "end of the change without its offset": (
        "circle",
        "G3 X-14.1171 Y-14.1671 I19.9989",
        "G3 X-14.1421 Y-14.1671 I19.9989",
        "path",
    ),
    # Header and marks
    "number of crossings is wrong": ("circle", "4 crossings", "3 crossings", "count"),
    "crossings not declared": ("circle", FACT + "\n", "", "count"),
    "crossings declared twice": ("circle", FACT, FACT + "\n" + FACT, "header"),
    "crossing longer than declared": ("circle", "up to 0.4000", "up to 0.3000", "crossing"),
    "error larger than declared": ("wide", "within 0.0051", "within 0.0021", "path"),
    "error declared too large": ("circle", "within 0.0011", "within 0.0111", "crossing"),
    "error declared without sense": ("circle", "within 0.0011", "within 1.0011", "crossing"),
    "mark names another axis": ("circle", "crossing Y+, ", "crossing Z+, ", "crossing"),
    "mark names another direction": ("on reversal", "crossing X+, ", "crossing X-, ", "crossing"),
    "mark names one crossing too few": ("circle", "crossing Y+, ", "", "crossing"),
    "mark names one crossing too many": ("circle", "crossing Y+, ", "crossing Y+, crossing Z-, ", "crossing"),
    "mark names none": ("circle", MARK, "+9 -1 turns", "path"),
    "offset is another one": ("circle", "offset X 0.025000", "offset X 0.035000", "offset"),
    "offset is to one side": ("circle", "offset X 0.025000", "offset X +0.025000", "path"),
    "one-sided offset is to both sides": ("G18", "offset Z +0.050000", "offset Z 0.050000", "path"),
    "one-sided offset is to the other side": ("G18", "offset Z +0.050000", "offset Z -0.050000", "path"),
    # Words
    "spindle stopped in a crossing": ("circle", BLOCK, BLOCK.replace("\n", " M5\n"), "command"),
    "spindle speed in a crossing": ("circle", BLOCK, BLOCK.replace("\n", " S500\n"), "command"),
    "tool in a crossing": ("circle", BLOCK, BLOCK.replace("\n", " T3\n"), "command"),
    "offset number in a crossing": ("circle", BLOCK, BLOCK.replace("\n", " D3\n"), "command"),
    "dwell in a crossing": ("circle", f"{MARK})\n", f"{MARK.replace('+9', '+10')})\nG4 P0.2\n", "dwell"),
    "coolant lost beside a crossing": ("commands", "M8 G3 X20.024", "G3 X20.024", "command"),
    "coolant switched behind the crossing": (
        "commands",
        "M8 G3 X20.024 Y-0.2 I0 J20 F1000 (half)\nG1 X19.974 Y0.2 F1007.7\n",
        "G3 X20.024 Y-0.2 I0 J20 F1000 (half)\nM8 G1 X19.974 Y0.2 F1007.7\n",
        "command",
    ),
    "comment lost beside a crossing": ("commands", " (half)", "", "comment"),
    "relative mode left on": (
        "circle",
        "G3 X-14.1171 Y-14.1671 I19.9989",
        "G91 G3 X-14.1171 Y-14.1671 I19.9989",
        "refused",
    ),
    "inches left on": ("circle", BLOCK, "G20 " + BLOCK, "state"),
    "extruder ahead": ("extruder", "E4.66761", "E4.86761", "command"),
    "extruder behind": ("extruder", "E1.58239", "E1.38239", "command"),
    "extrusion lost": ("extruder", " E4.66761", "", "command"),
    "extrusion ends elsewhere": ("extruder", "F1200 E12.50000", "F1200 E12.40000", "command"),
    # Approach
    "approach shorter than the backlash": ("approach", "G0 X-14.2021", "G0 X-14.1571", "pulse"),
    "approach from the wrong side": ("approach", "G0 X-14.2021", "G0 X-14.0421", "pulse"),
    "approach to a place without offset": ("approach", "G1 X-14.1171 F500", "G1 X-14.1421 F500", "pulse"),
    "approach beside its place": ("approach", "G1 X-14.1171 F500", "G1 X-14.1071 F500", "path"),
    "approach farther than declared": ("approach", "take-up X 0.06", "take-up X 0.03", "path"),
}


def damaged(name, old, new):
    extra = {"wide": wide, "on reversal": GOOD["full circles on a reversal"]}
    original, text = (one.decode("latin-1") for one in crossed(extra[name]())) if name in extra else pair(name)
    assert text.count(old) == 1, text
    return original, text.replace(old, new)


def wide():
    """A circle with a crossing that is longer than it should be."""
    job = circle()
    return replace(job, crossings=[replace(one, low=one.low - 0.25, high=one.high + 0.25) for one in job.crossings])


@pytest.mark.parametrize("name", DAMAGE)
def test_damage_is_found(name):
    job, old, new, kind = DAMAGE[name]
    if kind == "refused":
        with pytest.raises(InputError, match=r"compensated:\d+"):
            judged(*damaged(job, old, new))
        return
    verdict = judged(*damaged(job, old, new))
    assert kind in kinds(verdict), [failure.sentence() for failure in verdict.failures]
    named = [failure for failure in verdict.failures if failure.kind == kind]
    assert all(failure.compensated is not None or failure.original is not None for failure in named)


BENCH = """name = "bench"
[controller]
dialect = "linuxcnc"
servo_period_ms = 1.0
"""

BENCH_AXIS = """[axes.{axis}]
feedback = "none"
b = 0.0
c = 0.0
lost_motion_mm = {lost}
reference_direction = "{side}"
max_velocity_mm_s = 100
max_acceleration_mm_s2 = 1000
max_jerk_mm_s3 = 50000
"""


def bench(tmp_path, **axes):
    """A machine with the lost motion and the side of each axis' zero."""
    lines = [BENCH_AXIS.format(axis=axis, lost=lost, side=side) for axis, (lost, side) in axes.items()]
    file = tmp_path / "bench.toml"
    file.write_text(BENCH + "".join(lines))
    return read_machine(str(file))


def on(machine, name):
    original, text = pair(name)
    return original, text.replace("bench, sha256 0123456789abcdef", f"bench, sha256 {machine.digest[:16]}")


@pytest.mark.parametrize(
    ("axes", "kind"),
    [
        ({"X": (0.05, "both"), "Z": (0.05, "-")}, None),
        ({"X": (0.05, "both"), "Z": (0.05, "+")}, "machine"),
        ({"X": (0.05, "both"), "Z": (0.05, "both")}, "machine"),
        ({"X": (0.05, "both"), "Z": (0.06, "-")}, "machine"),
        ({"X": (0.06, "both"), "Z": (0.05, "-")}, "machine"),
        ({"X": (0.05, "both")}, "machine"),
    ],
)
def test_one_sided_offsets_are_held_to_the_machine(tmp_path, axes, kind):
    machine = bench(tmp_path, **axes)
    found = kinds(judged(*on(machine, "G18"), machine))
    assert kind in found if kind else not found


def test_the_move_across_a_corner_keeps_the_limits_of_its_axis(tmp_path):
    """0.05 mm from rest to rest at 1000 mm/s²: at most 7.07 mm/s, 424 mm/min."""
    machine = bench(tmp_path, X=(0.05, "both"), Y=(0.05, "both"))
    original, text = on(machine, "two axes in a corner")
    assert judged(original, text, machine).ok
    assert judged(original, text.replace("G1 X9.975 F300", "G1 X9.975 F424"), machine).ok
    verdict = judged(original, text.replace("G1 X9.975 F300", "G1 X9.975 F426"), machine)
    assert "limits" in kinds(verdict)


def in_one_move(text):
    """The program with its two axes in a corner, which cross in one move."""
    joined = re.sub(r"G1 X9\.975 F300\nG1 Y7\.975(?: F\S+)?\n", "G1 X9.975 Y7.975 F424\n", text)
    assert joined != text
    return re.sub(r"\+(\d+) (-\d+ crossing X)", lambda found: f"+{int(found[1]) - 1} {found[2]}", joined)


def test_two_axes_may_cross_in_one_move(tmp_path):
    """Each has its part in the feed: √2 times 424 mm/min together."""
    machine = bench(tmp_path, X=(0.05, "both"), Y=(0.05, "both"))
    original, text = on(machine, "two axes in a corner")
    one = in_one_move(text)
    verdict = judged(original, one, machine)
    assert verdict.ok
    assert verdict.checked["crossings"] == 2
    assert judged(original, one.replace("Y7.975 F424", "Y7.975 F599"), machine).ok
    assert "limits" in kinds(judged(original, one.replace("Y7.975 F424", "Y7.975 F602"), machine))
    for wrong in ("Y7.965", "Y8.025", "Y8.075"):
        assert not judged(original, one.replace("Y7.975 F424", f"{wrong} F424"), machine).ok


def test_no_crossing_lies_under_cutter_compensation():
    original, text = pair("edges")
    digest = re.search("original sha256 ([0-9a-f]+)", text)[1]
    inside = original.replace("G17 G94", "G17 G94 G41 D1")
    new = text.replace("G17 G94", "G17 G94 G41 D1").replace(digest, sha256(inside.encode()).hexdigest())
    assert "crossing" in kinds(judged(inside, new))


def test_commands_at_a_joint_stay_in_the_crossing_over_it():
    original, text = (one.decode() for one in crossed(GOOD["full circles on a reversal"]()))
    digest = re.search("original sha256 ([0-9a-f]+)", text)[1]
    joint, other = "G3 X20 Y0 I-20 J0\n", "G1 X19.974 Y0.2"
    old = original.replace(joint, "M8 " + joint)
    text = text.replace(digest, sha256(old.encode()).hexdigest())
    lines = text.splitlines(keepends=True)
    at = next(n for n, line in enumerate(lines) if line.startswith(other))
    found = {}
    for n in range(at - 2, at + 3):
        found[n - at] = judged(old, "".join([*lines[:n], "M8 " + lines[n], *lines[n + 1 :]])).ok
    # On the block of the crossing or behind it the coolant comes on within the crossing.
    assert found == {-2: False, -1: False, 0: True, 1: True, 2: False}


ZIGZAG = """G21 G90 G17 G94
G0 X0 Y0 Z0
G1 X20 Y10 F800
G1 X10 Y20
G1 X20 Y30
G1 X30
G1 X40 Y25
G0 X0 Y0 Z0
M2
"""

STOPPED = """(ph-post 0.3.0 compensated this program)
(ph-post: original sha256 {digest})
(ph-post: machine bench, sha256 0123456789abcdef)
(ph-post: options sha256 fedcba9876543210)
(ph-post: offset X 0.025 mm)
(ph-post: offset Y 0.025 mm)
(ph-post: 2 stops, 0 dips)
(ph-post: 1 crossings, up to 0.6000 mm long, within 0.0002 mm)
(ph-post: dwell 0.1 s, decimals 4, chord tolerance 0.001 mm, block time 5 ms)
G21 G90 G17 G94
G0 X0.025 Y0.025 Z0
G1 X20.025 Y10.025 F800
(ph-post: +11 -3 X-, X+, crossing Y-)
G4 P0.1
G1 X19.975 F300
G4 P0.1
G1 X9.975 Y20.025 F800
G4 P0.1
G1 X10.025 F300
G4 P0.1
G1 X20.025 Y30.025 F800
G1 X24.025
G1 X24.625 Y29.975 F802.7
G1 X30.025 F800
G1 X40.025 Y24.975
G0 X0 Y0 Z0
M2
"""


def test_stops_of_an_axis_there_and_back_stand_in_one_change_with_a_crossing_of_another():
    """At the end of the change X carries what it carried at its beginning, and yet it crosses twice in it."""
    text = STOPPED.format(digest=sha256(ZIGZAG.encode()).hexdigest())
    both = (-0.025, 0.025)
    assert table_deviation(ZIGZAG, text, {"X": both, "Y": both}, 1.0) < 0.0002 + SAMPLING
    verdict = judged(ZIGZAG, text)
    assert [failure.sentence() for failure in verdict.failures] == []
    assert verdict.checked["crossings"] == 1
    for old, new in (
        ("G1 X19.975 F300", "G1 X20.005 F300"),
        ("G1 X10.025 F300", "G1 X10.005 F300"),
        ("G1 X9.975 Y20.025", "G1 X10.025 Y20.025"),
        ("X-, X+, crossing Y-", "X-, crossing X+, crossing Y-"),
    ):
        assert not judged(ZIGZAG, text.replace(old, new)).ok, new


PRINTED = """G21
G90
M83
G0 X0 Y0 Z0
G1 X20 Y10 F800 E1
G1 X10 Y20 E1
G1 X20 Y30 E1
G1 E0.8
G1 X30 E0.5
G1 X30.4 Y29.8 E-0.8
G0 X0 Y0 Z0
"""

PRINTED_STOPPED = """; ph-post 0.3.0 compensated this program
; ph-post: original sha256 {digest}
; ph-post: machine bench, sha256 0123456789abcdef
; ph-post: options sha256 fedcba9876543210
; ph-post: dialect klipper
; ph-post: offset X 0.025 mm
; ph-post: offset Y 0.025 mm
; ph-post: 2 stops, 0 dips
; ph-post: 1 crossings, up to 0.6000 mm long, within 0.0002 mm
; ph-post: dwell 0.1 s, decimals 4, chord tolerance 0.001 mm, block time 5 ms
G21
G90
M83
G0 X0.025 Y0.025 Z0
G1 X20.025 Y10.025 F800 E1
; ph-post: +12 -5 X-, X+, crossing Y-
G4 P100
G1 X19.975 F300
G4 P100
G1 X9.975 Y20.025 F800 E1
G4 P100
G1 X10.025 F300
G4 P100
G1 X20.025 Y30.025 F800 E1
G1 E0.8
G1 X29.425 E0.47
G1 X30.025 Y29.975 F802.7 E0.03
G1 X30.425 Y29.775 F800 E-0.8
G0 X0 Y0 Z0
"""


def test_filament_brought_forward_in_place_stays_between_its_motions():
    """A printer brings it forward between two motions of a change, and draws it back from the end of a crossing on."""
    text = PRINTED_STOPPED.format(digest=sha256(PRINTED.encode()).hexdigest())
    assert [failure.sentence() for failure in judged(PRINTED, text).failures] == []
    for old, new in (
        ("F800 E1\nG1 E0.8\nG1 X29.425 E0.47", "F800 E1.8\nG1 X29.425 E0.47"),
        ("G1 E0.8\nG1 X29.425 E0.47", "G1 X29.425 E1.27"),
        ("E0.47", "E0.45"),
        ("F802.7 E0.03", "F802.7 E0.04"),
        ("F802.7 E0.03", "F802.7 E0.02"),
    ):
        assert text.count(old) == 1
        wrong = text.replace(old, new).replace("+12", f"+{12 + new.count(chr(10)) - old.count(chr(10))}")
        assert "command" in kinds(judged(PRINTED, wrong)), new


FELT = 0.03
"""A place that is changed by more than this [mm] is outside every tolerance."""

MARKED = re.compile(r"(?:\(|; )ph-post: \+(\d+) -\d+ .*crossing")
PLACES = [name for name in GOOD if name != "short lines"]
"""In the middle of a crossing in several blocks the motor may be anywhere in the backlash."""

SINGLE = ("corners", "corners, relative", "two axes in a corner", "approach")
"""The order and the feed of single axes at rest do not matter."""


BEARABLE = 0.004
"""The declared distance of every program here, with the tolerance [mm]."""


SAMPLING = 6e-4
"""Samples of the path are 1 µm apart: a point between two of them seems half as far from it [mm]."""


def strays(name, original, text):
    """Return how far the table leaves the original's path, by the tests' own interpreter [mm].

    The moves of an approach are in the air, as if they were rapids.
    """
    job = GOOD[name]()
    text = re.sub(r"(approach\)\nG0 .*\n)G1 (.*)\nG1 ", r"\1G0 \2\nG0 ", text)
    return table_deviation(original, text, job.sides, job.style.unit)


@pytest.mark.parametrize("name", GOOD)
def test_what_the_generator_declares_is_true(name):
    original, text = pair(name)
    declared = re.search(r"within ([\d.]+) mm", text)
    assert strays(name, original, text) <= float(declared[1]) + SAMPLING


def changed_lines(text):
    """Numbers of the lines in changes that name a crossing."""
    found, lines = [], text.splitlines(keepends=True)
    for n, line in enumerate(lines):
        if mark := MARKED.match(line):
            found += range(n + 1, n + 1 + int(mark[1]))
    return lines, found


def holds(original, lines):
    try:
        return judged(original, "".join(lines)).ok
    except InputError:
        return False


@given(name=st.sampled_from(PLACES), pick=st.randoms(use_true_random=False))
def test_no_digit_of_a_crossing_can_be_changed_unseen(name, pick):
    original, text = pair(name)
    lines, inside = changed_lines(text)
    n = pick.choice(inside)
    words = list(re.finditer(r"([XYZIJK])(-?[\d.]+)", lines[n].partition("(")[0]))
    if not words:
        return
    word = pick.choice(words)
    at = pick.choice([k for k in range(*word.span(2)) if lines[n][k].isdigit()])
    damage = lines[n][:at] + pick.choice([d for d in "0123456789" if d != lines[n][at]]) + lines[n][at + 1 :]
    number = re.compile(r"-?[\d.]+").match(damage, word.start(2))
    unit = 25.4 if "G20" in text else 1.0
    if abs(float(number[0]) - float(word[2])) * unit < FELT:
        return
    damaged_lines = [*lines[:n], damage, *lines[n + 1 :]]
    if holds(original, damaged_lines):
        # A crossing that begins or ends a little elsewhere may be as good.
        assert strays(name, original, "".join(damaged_lines)) < BEARABLE, (lines[n], damage)


@given(name=st.sampled_from([name for name in PLACES if name not in SINGLE]), pick=st.randoms(use_true_random=False))
def test_no_feed_beside_a_crossing_can_be_raised_unseen(name, pick):
    original, text = pair(name)
    lines, inside = changed_lines(text)
    n = pick.choice([n for n in inside if re.search(r"[GXYZ].*F", lines[n])])
    word = re.search(r"F([\d.]+)", lines[n])
    raised = float(word[1]) * pick.uniform(1.02, 3.0)
    damage = lines[n].replace(word[0], f"F{raised:.6f}")
    still = not re.search(r"[XYZ]", lines[n]) or lines[n].startswith("G1 Z-14.0921")
    assert still or not holds(original, [*lines[:n], damage, *lines[n + 1 :]]), (lines[n], damage)


@given(
    name=st.sampled_from([name for name in PLACES if name not in (*SINGLE, "balanced")]),
    pick=st.randoms(use_true_random=False),
    kind=st.sampled_from(["lost", "lost and counted", "twice", "swapped"]),
)
def test_no_line_of_a_crossing_can_be_lost_doubled_or_moved_unseen(name, pick, kind):
    original, text = pair(name)
    lines, inside = changed_lines(text)
    n = pick.choice(inside)
    before, behind = lines[:n], lines[n + 1 :]
    if kind == "swapped":
        if n + 1 not in inside or behind[0] == lines[n]:
            return
        damage = [*before, behind[0], lines[n], *behind[1:]]
    elif kind == "twice":
        damage = [*before, lines[n], lines[n], *behind]
    else:
        damage = [*before, *behind]
    if kind == "lost and counted":
        mark = max(k for k in range(n) if MARKED.match(lines[k]))
        count = int(MARKED.match(lines[mark])[1])
        damage[mark] = lines[mark].replace(f"+{count} ", f"+{count - 1} ", 1)
    assert not holds(original, damage), (kind, lines[n])


def test_a_rapid_before_an_approach_may_stand_outside_its_change():
    original, text = pair("approach")
    mark, rapid = "(ph-post: +3 -1 X, Y approach)\n", "G0 X-14.2021 Y-14.0821 Z0\n"
    apart = text.replace(mark + rapid, rapid + mark.replace("+3 -1", "+2 -0"))
    assert judged(original, apart).ok
    far = judged(original, apart.replace("G0 X-14.2021", "G0 X-14.3021"))
    assert "offset" in kinds(far)
    short = judged(original, apart.replace("G0 X-14.2021", "G0 X-14.1571"))
    assert "pulse" in kinds(short)


@pytest.mark.parametrize(("ahead", "turned"), [(0.0, 1), (0.001, 1), (0.02, 0)])
def test_a_motor_that_came_back_a_little_is_on_its_side(ahead, turned):
    """Behind the lowest point of an arc Z is 1 µm off its side: what crosses the rest of its backlash is a crossing.

    The table stands still until the motor has come to the other side, by the play operator of the tests.
    """
    sides = np.array([[[0.0, 0.0], [0.0, 0.0], [0.0, 0.05]]]) * MM
    motor = np.array([[0.0, 0.0, -0.6], [1.0, 0.0, -0.6 + 0.05 - ahead], [1.0, 0.0, -0.5]]) * MM
    way = follow_play(motor, np.array([0, 3]), sides, np.array([[0.0, 0.0, ahead]]) * MM, np.array([1e-4 * MM]))
    assert way.turned[:, 2].tolist() == [0, turned, 0]
    assert way.points[way.place, 2] == pytest.approx(np.array([-0.6 - ahead, -0.6 - ahead, -0.55]) * MM)
