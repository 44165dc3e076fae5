"""Programs of lathes, which tell X in diameters: offsets are twice as large in their words."""

import re
from pathlib import Path as File

import numpy as np
import pytest
from support.corpus import Entry, stepper
from support.corpus_judge import Judged, compare, judge
from support.ideal_play import distances
from support.lathe_player import LathePlayer
from support.reference_player import play

from ph_post.api.compensation import compensated, undo
from ph_post.api.options import CompensateOptions
from ph_post.dialects.reading import read_as
from ph_post.dialects.registry import find_dialect
from ph_post.errors import InputError
from ph_post.files.storage import SourceBytes
from ph_post.progress import no_progress
from ph_post.verify.verify import verify

GAP = 0.05
HEAD = "%\nO2003\nG00 G18 G21 G40 G99\nG50 S2500\nG96 S200 M03\nT0101\n"
PROFILE = (
    "G00 X50. Z5.\nG00 X20. Z2.\nG01 Z-5. F0.1\nG02 X30. Z-10. R5.\nG01 X36.123\nZ-12.\nG03 X30. Z-15. R3.\nG01 Z-18.\n"
    "G02 X40. Z-23. I5. K0.\nG01 X46.\nZ-20.\nX60.\nG00 X60. Z5.\nM30\n%\n"
)
SHAPE = (
    "G00 X62. Z4.\nG71 U1.5 R0.5\n"
    "G71 P10 Q20 U0.4 W0.1 F0.2\nN10 G00 X10.\nG01 W-15. F0.1\nU10. W-10.\nG02 U10. W-5. R5.\n"
    "N20 G01 X58.\nG70 P10 Q20\nG00 X62. Z4.\nG90 X50. Z-20. F0.2\nX45.\nX40.\nG00 X70. Z5.\nM30\n%\n"
)


def way_of(text):
    """Places of the tool (n, 2) [mm] in radii, and whether it cuts there, each 0.02 mm."""
    points, cuts, at = [], [], None
    for kind, *numbers in LathePlayer().play(text):
        if kind not in (0, 1, 2, 3):
            continue
        end = np.array(numbers[:2])
        if at is not None and kind < 2:
            count = max(2, int(np.ceil(np.linalg.norm(end - at) / 0.02)))
            found = at + np.linspace(0.0, 1.0, count + 1)[1:, None] * (end - at)
        elif at is not None:
            center = np.array(numbers[2:])
            one, other = at - center, end - center
            begin, last = (np.arctan2(way[0], way[1]) for way in (one, other))
            sweep = (last - begin) % (2.0 * np.pi) if kind == 3 else -((begin - last) % (2.0 * np.pi))
            angle = begin + sweep * np.linspace(0.0, 1.0, 401)[1:]
            size = np.linspace(np.linalg.norm(one), np.linalg.norm(other), 401)[1:]
            found = center + np.column_stack([size * np.sin(angle), size * np.cos(angle)])
        else:
            found = end[None]
        points.append(found)
        cuts.append(np.full(len(found), kind > 0))
        at = end
    return np.concatenate(points), np.concatenate(cuts)


def errors_of(before, after):
    """Rms [mm] of the table behind ideal play from the way of the original, worst of both sides, deep in the work."""
    path, cut = way_of(before)
    path = path[cut | np.append(cut[1:], False)]
    found = []
    for text in (before, after):
        motor, cuts = way_of(text)
        # Away from where the tool comes to its side of the backlash.
        cuts = cuts & (motor[:, 1] < 1.5) & (motor[:, 0] < 28.9)
        worst = 0.0
        for side in (-1.0, 1.0):
            table = np.column_stack([play(motor[:, 0], GAP, side), play(motor[:, 1], GAP, side) - 0.5 * GAP])
            away = distances(
                np.column_stack([table[cuts], np.zeros(cuts.sum())]), np.column_stack([path, 0 * path[:, 0]])
            )
            worst = max(worst, float(np.sqrt((away**2).mean())))
        found.append(worst)
    return found


def made_of(text, dialect="fanuc"):
    source = SourceBytes(name="a.nc", stem="a", data=text.encode())
    result = compensated(source, stepper(dialect), CompensateOptions(expand=True), "program", no_progress)
    return result, result.program().decode()


def no_comments(text):
    return re.sub(r"\([^)\n]*\)\n?", "", text)


@pytest.mark.parametrize("part", [PROFILE, SHAPE])
def test_the_table_follows_the_profile(part):
    result, after = made_of(HEAD + part)
    before, found = errors_of(HEAD + part, no_comments(after))
    assert before > 0.012
    assert found < 0.2 * before
    assert undo(SourceBytes(name="a.nc", stem="a", data=after.encode())) == (HEAD + part).encode()
    assert all(row.compensated == row.all > 0 for row in result.axis_reversals)


def test_the_shape_of_a_cycle_is_left_as_it_is():
    _, after = made_of(HEAD + SHAPE)
    assert SHAPE[SHAPE.index("G71 P") : SHAPE.index("G70")] in after


def test_a_cycle_behind_an_arc_gets_no_word_of_its_motion():
    cycle = "G71 P10 Q20 U0.4 W0.1 F0.2\n"
    text = (HEAD + SHAPE).replace("G00 X70. Z5.", f"G01 X38. Z-22.\nG02 X44. Z-25. R3.\n{cycle}G01 X50.")
    _, after = made_of(text)
    assert no_comments(after).count(cycle) == text.count(cycle)


def test_an_offset_is_twice_as_large_in_its_words():
    _, after = made_of(HEAD + PROFILE)
    assert "(PH-POST: OFFSET X 0.025 MM)" in after
    assert "G02 X30.05 Z-10. R5." in after
    original = read_as("fanuc", (HEAD + PROFILE).encode(), "a.nc")
    for text, passed in ((after, True), (after.replace("G02 X30.05", "G02 X30.025"), False)):
        verdict = verify(original, read_as("fanuc", text.encode(), "b.nc"), tolerance=1e-5, machine=stepper("fanuc"))
        assert verdict.ok is passed


@pytest.mark.parametrize("head", [HEAD.replace(" G99", ""), "%\nO3\nG21 G40\nT0101\nG97 S1200 M3\n"])
def test_no_feed_is_written_where_it_is_one_a_turn(head):
    """A lathe begins with feeds a turn: 212 of them would be a crash."""
    result, after = made_of(head + PROFILE)
    written = {float(found) for found in re.findall(r"F([\d.]+)", no_comments(after))}
    assert written == {0.1}
    assert sum(row.compensated for row in result.axis_reversals) > 0
    before, found = errors_of(HEAD + PROFILE, no_comments(after))
    assert found < 0.2 * before


STANDING = {
    "fanuc": (HEAD, "M30\n%\n"),
    "linuxcnc": ("G21 G18 G90 G95 G7 G61\nG97 S500 M3\n", "M2\n"),
    "siemens": ("G71 G18 G90 DIAMON\nG95 S900 M3\n", "M30\n"),
}


@pytest.mark.parametrize("dialect", STANDING)
@pytest.mark.parametrize("away", ["M5\nG0 X80.\n", "G0 X80. M5\nX90.\n", "M5\n", "G0 X80.\nM5\nG0 X90.\n"])
def test_nothing_is_moved_at_a_feed_a_turn_while_the_spindle_stands(dialect, away):
    """The control would wait for the spindle, for ever."""
    head, end = STANDING[dialect]
    cuts = "G0 X60. Z5.\nG0 X20. Z2.\nG1 Z-5. F0.1\nX30.\nZ-10.\nX26.\nZ-15.\nZ-12.\nX60.\n"
    text = head + cuts + away + end
    source = SourceBytes(name="a.nc", stem="a", data=text.encode())
    result = compensated(source, stepper(dialect), CompensateOptions(), "program", no_progress)
    made = re.sub(r"\(.*?\)|;.*", "", result.program().decode())
    assert all(row.compensated == row.all > 0 for row in result.axis_reversals)
    mode, turns, at = "", False, {}
    for line in made.splitlines():
        words = re.findall(r"([A-Z])([-\d.]+)", line)
        codes = {f"{letter}{float(number):g}" for letter, number in words}
        mode = next(iter(codes & {"G0", "G1"}), mode)
        turns = (turns or "M3" in codes) and "M5" not in codes
        moves = [letter for letter, _ in words if letter in "XZ"]
        at |= {letter: float(number) for letter, number in words if letter in "XZ"}
        assert not moves or mode == "G0" or turns, line
    assert at["Z"] == -12.0


def test_a_dialect_says_what_no_word_of_a_program_says():
    text = "%\nO1\nG21 G98 G40\nG0 X50. Z2.\nG1 Z-5. F100.\nG2 X60. Z-10. R5.\nM30\n%\n"
    ends = [
        read_as(dialect, text.encode(), "a.nc").motions.end[-1].tolist()[::2] for dialect in ("fanuc", "fanuc+lathe")
    ]
    assert ends == [[0.06, -0.01], [0.03, -0.01]]
    assert read_as("fanuc+lathe", text.encode(), "a.nc").motions.kind.size == 3


TURNED = (
    "G0 X50 Z5\nG0 X20 Z2\nG1 Z-5 {feed}\nG2 X30 Z-10 {radius}\nG1 X36\nZ-12\nG3 X30 Z-15 I0 K-3\nG1 Z-18\n"
    "G2 X40 Z-23 I5 K0\nG1 X46\nZ-20\nX60\nG0 X60 Z5\nM30\n"
)
LINUXCNC = "G21 G18 G90 G94 G7\n" + TURNED.format(feed="F300", radius="R5")
SIEMENS = "G71 G18 G90 DIAMON\nG95 S900 M3\n" + TURNED.format(feed="F0.1", radius="CR=5")


@pytest.mark.parametrize(("dialect", "text"), [("linuxcnc", LINUXCNC), ("siemens", SIEMENS)])
def test_words_that_tell_diameters_are_read(dialect, text):
    """By the controller's own interpreter where it is here, or a player of the tests' own."""
    source = SourceBytes(name="a.nc", stem="a", data=text.encode())
    result = compensated(source, stepper(dialect), CompensateOptions(), "program", no_progress)
    made = result.program()
    assert b" X30.05 Z-10 " in made
    judged = compare(Judged("compensated", 1, 1), dialect, text.encode(), made)
    assert judged.rms is not None
    assert judged.rms[0] > 0.01
    assert judged.rms[1] < 0.2 * judged.rms[0]
    assert undo(SourceBytes(name="a.nc", stem="a", data=made)) == text.encode()


@pytest.mark.parametrize(
    "text", [LINUXCNC.replace("Z-12", "Z-12 G8"), "G21 G18 G90 G94\nG0 X50\nG7\n" + LINUXCNC.partition("\n")[2]]
)
def test_a_program_that_changes_its_measure_is_followed_in_radii_alone(text):
    program = read_as("linuxcnc", text.encode(), "a.ngc")
    assert not program.language.diameters
    assert any("diameter" in note.what for note in program.notes)


@pytest.mark.parametrize("odd", ["DIAM90", "DIAMON\nG0 X9 Z9\nG2 X40 Z-20 I=AC(20) K=AC(-20)"])
def test_what_is_a_diameter_in_part_is_left_as_it_is(odd):
    assert not read_as("siemens", SIEMENS.replace("DIAMON", odd).encode(), "a.mpf").motions.kind.size


def test_a_path_is_not_written_for_a_lathe():
    with pytest.raises(InputError, match=r"fanuc\+lathe writes no paths"):
        find_dialect("fanuc+lathe").syntax.opening("G18")


TOOLS_IN_TURN = (
    "%\nO7\nG28 U0 W0\nT0101\nG97 S800 M3\nG0 X0. Z5.\nG1 Z-20. F100.\nG0 Z5.\nG28 U0 W0\n"
    "T0202\nG0 X40. Z2.\nG1 Z-30. F120.\nX50.\nZ-34.\nX46.\nG0 X60. Z2.\nG28 U0 W0\nM30\n%\n"
)
"""A drill on the axis, and a tool that turns; nothing but T, G28 U and the missing Y says that this is a lathe."""


def test_a_lathe_is_known_by_its_tools_and_a_drill_comes_to_its_axis_from_a_known_side():
    found = judge(Entry("tools", File(), "fanuc", TOOLS_IN_TURN))
    assert found.outcome == "compensated"
    assert found.followed == found.shown == 2
    assert 20.0 * found.rms[1] < found.rms[0]
    assert read_as("fanuc", TOOLS_IN_TURN.encode(), "a.nc").motions.end[:, 0].max() == pytest.approx(0.03)
    mill = TOOLS_IN_TURN.replace("X40.", "X40. Y0.").encode()
    assert read_as("fanuc", mill, "a.nc").motions.end[:, 0].max() == pytest.approx(0.06)


def test_a_lathe_that_is_known_by_its_slow_feeds_stays_one_with_the_feeds_of_crossings():
    """Its arcs are in G18, which nothing says: read as a mill's they could not be understood."""
    cuts = "G01 X8. F1.9\nX-0.4\nG00 X9. Z-1.\nG01 X4.\nZ-4.\nG03 X6. Z-5. I0 K-1.\nG01 Z-6.\nX9. Z-5.\n"
    text = f"O0001\nG98\nT0202.0\nG00 X20. Z5.\nG00 X10. Z0\n{cuts}G00 X20.\nZ5.\nM30\n"
    source = SourceBytes(name="a.nc", stem="a", data=text.encode())
    made = compensated(source, stepper("fanuc"), CompensateOptions(), "program", no_progress).program()
    found = compare(Judged("compensated"), "fanuc", text.encode(), made)
    assert found.followed == found.shown > 2
    assert 5.0 * found.rms[1] < found.rms[0]
    assert max(map(float, re.findall(r"F([.\d]+)", made.decode()))) > 100.0
    assert made.count(b"(PH-POST: NOTE HOLDS FOR A LATHE, WHERE X IS A DIAMETER)") == 1
    assert read_as("fanuc", made, "a.nc").language.diameters
    source = SourceBytes(name="a.nc", stem="a", data=made)
    assert compensated(source, stepper("fanuc"), CompensateOptions(), "program", no_progress).program() == made
