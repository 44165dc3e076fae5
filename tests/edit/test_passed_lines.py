"""Programs with lines that are passed through: compensated around them, and every byte of them as it was."""

import numpy as np
import pytest
from msgspec.structs import replace
from support.corpus import compensated, stepper
from support.corpus_judge import Judged, compare
from support.reference_player import BEGINS, interpret

from ph_post.api.compensation import compensated as outcome
from ph_post.api.options import CompensateOptions
from ph_post.api.outcomes import passed_through
from ph_post.dialects.reading import read_as
from ph_post.dialects.registry import find_dialect
from ph_post.edit.undo import undo
from ph_post.files.storage import SourceBytes
from ph_post.gcode.read import read_program
from ph_post.progress import no_progress
from ph_post.types import Servo
from ph_post.verify.verify import verify

CIRCLE = "G1 Z-1\nG3 X20 Y0 I-20\nG0 Z5\n"
CUTS = f"G21 G90 G17 G94 F600\nG64 P0.005 Q0\nG0 X20 Y0 Z5\n{CIRCLE}"
MORE = f"G0 X20 Y0\n{CIRCLE}"
MACHINE = stepper()
LINUXCNC = find_dialect("linuxcnc")

DEFECTS = {
    "text": "# G1 X99",
    "no-filament": "G00 E0",
    "text-behind": "G0 X9 # there",
    "bare-letters": "G28 X Y",
    "bracket": "G0 X9 )",
    "brackets": "(a (b) c)",
    "open": "G0 X9 (open",
    "twice": "G0 X1 X9",
    "groups": "G0 G1 X9 Y3",
    "name": "HOME_ALL",
    "unknown": "M150 P3",
    "clamp": "M10",
    "macro": "G65 P9010\nG21 G90 G17 G94 G91.1 G64 P0.005 Q0 G0\nF600",
    "arc": "G2 X9 Y9 I1",
    "home": "G91 G28 Z0\nG90",
    "length": "G43 H2",
    "offset": "G10 L2 P1 X3",
    "preset": "G92 X3",
    "rotary": "G0 A90",
    "broken-mode": "G91 &\nG90 G0",
}


def job(defect):
    before = f"{CUTS}{defect}\n{MORE}M2\n"
    return before.encode(), compensated(read_program(before.encode(), "a.ngc"), MACHINE, LINUXCNC)


def hold(before, after):
    """Demand the laws of every change: checked, undone to the byte, and nothing to do in a second run."""
    one, other = read_program(before, "a.ngc"), read_program(after, "b.ngc")
    assert verify(one, other, tolerance=5e-6, machine=MACHINE).failures == ()
    assert undo(after, "b.ngc") == before
    assert compensated(other, MACHINE, LINUXCNC) == after


@pytest.mark.parametrize("name", DEFECTS)
@pytest.mark.thinned(4)
def test_a_defect_leaves_the_rest_to_be_compensated_and_is_not_touched(name):
    before, after = job(DEFECTS[name])
    passed, rest = (after.split(DEFECTS[name].encode() + b"\n", 1)) if DEFECTS[name].encode() in after else (b"", b"")
    assert passed.count(b"(ph-post: +") >= 1, name
    assert rest.count(b"(ph-post: +") >= 1, name
    hold(before, after)


INCHES = "G20 G90 G17 G94 F20\nG64 P0.0002 Q0\n" + 2 * "G0 X0.8 Y0 Z0.2\nG1 Z-0.04\nG3 X0.8 Y0 I-0.8\nG0 Z0.2\n"


@pytest.mark.parametrize(
    "behind", ["G0 X0 Y0 Z30\n", "G0 X9 Y0\nG1 Z-1 F500\nG2 X9 Y0 I-9\nG0 Z30\n"], ids=["rapid", "cut"]
)
def test_what_is_not_in_the_units_of_most_cuts_stays_as_it_is(behind):
    """By the tests' own interpreters the cuts in inches are compensated; what follows G21 is the original."""
    before = f"{INCHES}G21\n{behind}M2\n".encode()
    after = compensated(read_program(before, "a.ngc"), MACHINE, LINUXCNC)
    assert f"\nG21\n{behind}M2\n".encode() in after
    hold(before, after)
    one, other = (data.split(b"\nG21\n")[0] + b"\nM2\n" for data in (before, after))
    found = compare(Judged("compensated"), "linuxcnc", one, other)
    assert found.shown >= 8
    assert found.followed == found.shown
    assert found.rms[1] < found.rms[0] / 20
    # Where the units change the motors are where the original has them.
    ends = [interpret(data.decode(), BEGINS[0])[-1].end for data in (one, other)]
    np.testing.assert_allclose(*ends, atol=1e-9)


def test_increments_alone_are_compensated():
    before = b"G21 G91 G17 G94 F600\nG64 P0.005 Q0\nG0 X1 Y1 Z1\nG1 Z-2\nG2 I20\nG1 X-9\nG3 X-20 Y20 J20\nG0 Z2\nM2\n"
    after = compensated(read_program(before, "a.ngc"), MACHINE, LINUXCNC)
    assert after.count(b"(ph-post: +") >= 2
    assert b"G90 " not in after
    hold(before, after)


def test_a_byte_order_mark_stays_the_first_of_all():
    before = b"\xef\xbb\xbf(part)\n" + f"{CUTS}M2\n".encode()
    after = compensated(read_program(before, "a.ngc"), MACHINE, LINUXCNC)
    assert after != before
    assert after.startswith(b"\xef\xbb\xbf(part)\n(ph-post ")
    hold(before, after)


def test_a_beginning_behind_cuts_is_not_where_the_head_goes():
    cuts = "G1 X20. F600\nG3 X20. Y20. I0. J10.\nG1 X0.\nG3 X0. Y0. I0. J-10.\n"
    head = "O1\nG21 G90 G17 G94\n"
    before = f"{head}G0 X0. Y0. Z5.\nG1 Z-1. F200\n{2 * cuts}G0 Z5.\n0 BEGIN PGM A MM\nM30\n".encode()
    after = compensated(read_as("fanuc", before, "a.nc"), MACHINE, find_dialect("fanuc"))
    assert after.startswith(b"O1\n(PH-POST ")
    assert after.count(b"(PH-POST: +") >= 2
    assert undo(after, "b.nc") == before


def test_text_behind_a_percent_sign_stays_before_the_head():
    before = f"% O77 SO\n{CUTS}M30\n%\nO78\n{MORE}M30\n%\n".encode()
    after = compensated(read_program(before, "a.ngc"), MACHINE, LINUXCNC)
    assert after.startswith(b"% O77 SO\n(ph-post ")
    assert f"%\nO78\n{MORE}M30\n%\n".encode() in after
    hold(before, after)


def test_a_program_with_checksums_is_left_alone():
    before = "".join(f"N{n} {line}*57\n" for n, line in enumerate(f"{CUTS}M2".splitlines())).encode()
    assert compensated(read_program(before, "a.ngc"), MACHINE, LINUXCNC) == before


@pytest.mark.parametrize("mode", ["G94", "S1000 M3 G95 F0.2"])
def test_where_the_feed_is_not_known_new_lines_have_the_one_in_force(mode):
    before = f"{CUTS.replace('G94 F600', mode)}M2\n".encode()
    after = compensated(read_program(before, "a.ngc"), MACHINE, LINUXCNC)
    assert after.count(b"crossing") > 1
    own = [line for line in after.splitlines() if not line.startswith(b"(")]
    assert sum(b"F" in line for line in own) == before.count(b"F0.2")
    hold(before, after)


def test_motors_that_lag_are_left_alone_where_the_feed_is_not_known():
    before = (CUTS.replace("F600", "") + "M2\n").encode()
    axes = {name: replace(axis, servo=Servo(b=1e-5, c=0.01)) for name, axis in MACHINE.axes.items()}
    assert compensated(read_program(before, "a.ngc"), replace(MACHINE, axes=axes), LINUXCNC) == before


def test_a_feed_mode_that_changes_between_a_rapid_and_its_cut_leaves_an_unknown_feed_alone():
    before = (CUTS.replace("G1 Z-1", "G95 F0.2\nG1 Z-1") + "M2\n").encode()
    assert compensated(read_program(before, "a.ngc"), MACHINE, LINUXCNC) == before


@pytest.mark.parametrize(("word", "place"), [("M150 P3", True), ("M199", True), ("M212", False)])
def test_a_program_beside_linuxcnc_leaves_the_place_known_and_the_side_not(word, place):
    """M100 to M199 run a file; of other words a remap may move anything. No offset lasts through either."""
    text = (
        f"G21 G90 G17 F600\nG64 P0.01\nG0 X0 Y0 Z5\n{word}\nG1 Z-1\nG1 X20 Y0\nG3 X20 Y20 J10\nG1 X0\nG3 X0 Y0 J-10\n"
    )
    text += "G1 X20\nG0 Z5\nM2\n"
    before = text.encode()
    program = read_as("linuxcnc", before, "a.ngc")
    assert [one.block + 1 for one in program.breaks if one.kind == "not understood"] == [4]
    assert np.isnan(program.motions.start[1]).any() != place
    after = compensated(program, MACHINE, LINUXCNC)
    carried = interpret(after.decode().split(word)[0], BEGINS[0])[-1].end
    assert carried == pytest.approx([0.0, 0.0, 5.0])
    judged = compare(Judged("compensated"), "linuxcnc", before, after)
    assert judged.shown >= 4
    assert (judged.followed == judged.shown) == place
    assert (5.0 * judged.rms[1] < judged.rms[0]) == place
    hold_as("linuxcnc", before, after)


def hold_as(dialect, before, after):
    """As of :func:`hold`, read as of a dialect."""
    one, other = read_as(dialect, before, "a.ngc"), read_as(dialect, after, "b.ngc")
    assert verify(one, other, tolerance=5e-6, machine=MACHINE).failures == ()
    assert undo(after, "b.ngc") == before
    assert compensated(other, MACHINE, LINUXCNC) == after


@pytest.mark.parametrize("before", ["G0 Z7\nG3 I3 F3000\nG\n", "G0 Z.5\nGX1 Y0\nG3 I3 J3 F3000\nG\n"])
def test_a_circle_that_nobody_placed_stays_as_it_is(before):
    program = read_as("grblhal", before.encode(), "a.nc")
    assert compensated(program, stepper("grblhal"), find_dialect("grblhal")) == before.encode()


@pytest.mark.parametrize("word", ["M428", "M429", "M430"])
def test_what_is_cut_under_switched_kinematics_is_left_alone(word):
    """Behind a table that has turned by 90 degrees a motion along X reverses another joint."""
    cuts = "G1 Z-1\nG1 X20 Y0\nG3 X20 Y20 J10\nG1 X0\nG3 X0 Y0 J-10\nG1 X20\nG0 Z5\n"
    head = "G21 G90 G17 F600\nG64 P0.01\nG0 X0 Y0 Z5\n"
    before = f"{head}{cuts}{word}\nG1 C90\nG0 X0 Y0\n{cuts}M2\n".encode()
    after = compensated(read_as("linuxcnc", before, "a.ngc"), MACHINE, LINUXCNC)
    assert after != before
    begin, (_, end) = before.index(word.encode()), after.split(word.encode())
    assert end.startswith(before[begin + 4 :])  # behind it what --undo needs
    hold_as("linuxcnc", before, after)


@pytest.mark.parametrize(
    ("dialect", "word"), [("linuxcnc", "M103"), ("grbl", "M81"), ("fanuc", "M81"), ("siemens", "M81")]
)
def test_an_offset_lasts_over_an_m_word_of_which_the_machine_file_says_that_it_moves_nothing(dialect, word):
    """In the midst of a contour that would have to be left for it; what is written says so to whoever checks it."""
    units, end = ("G71", "M30") if dialect == "siemens" else ("G21", "M30")
    cut = f"G1 X30. Y10.\n{word}\nX10. Y20.\nX0. Y5.\nX0. Y0.\n"
    before = f"{units} G90 G17 G94\nG0 X0. Y0. Z5.\nG1 Z-1. F600.\n{cut}G0 Z5.\n{end}\n".encode()
    told = f"{dialect}+{word.lower()}"
    source = SourceBytes(name="a", stem="a", data=before)
    (said,) = passed_through(read_as(dialect, before, "a"), dialect)
    assert f'dialect = "{told}" in the machine file says that {word} moves nothing' in said
    found = outcome(source, stepper(told), CompensateOptions(), "program", no_progress)
    after = found.program()
    before_it = after[: after.index(f"\n{word}\n".encode())].upper()
    assert b"X TO 0" not in before_it
    assert b"Y TO 0" not in before_it
    assert undo(after, "a") == before
    read = [read_as(told, data, "a") for data in (before, after)]
    assert verify(*read, tolerance=5e-6, machine=stepper(told)).failures == ()
