"""Changes written into programs: changes, modal words, splits, feed dips, and lines that stay as they are."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from msgspec.structs import replace
from support.canon import needs_rs274, run_rs274
from support.editing import Compensated, compensate, with_edits
from support.part_programs import distances, samples
from support.reference_player import interpret

from ph_post.dialects.reading import read_as
from ph_post.drive.machinefile import read_machine
from ph_post.edit.edits import CrossingEdit, CrossingPart, DipEdit, Edits, OffsetShift, StopEdit, runs_of
from ph_post.edit.preconditions import why_not_editable
from ph_post.edit.undo import undo
from ph_post.errors import InputError
from ph_post.gcode.program import RAPID
from ph_post.gcode.read import read_program
from ph_post.verify.verify import verify

MM = 1e-3
STEPPER = read_machine("stepper")
START = "G21 G90 G17 F600\nG0 X0 Y0\n"


def lines(found: Compensated) -> list[str]:
    """Lines of a result without its comments."""
    return [one for one in found.text.decode().splitlines() if not one.startswith(("(ph-post", "(  "))]


def changed(text: str, *, dialect: str = "linuxcnc", **edits: object) -> Compensated:
    """Write changes that are told on motions."""
    program = read_program(text.encode(), "part.ngc")
    offset = np.zeros((program.motions.kind.size, 3))
    found = with_edits(program, Edits(**{"runs": runs_of(offset), **edits}), STEPPER, dialect)
    assert not edits or undo(found.text, "part.ngc") == program.data
    return found


def dip(motion: list[int], share: list[float], duration: list[float]) -> DipEdit:
    return DipEdit(motion=np.array(motion), share=np.array(share), duration=np.array(duration))


def pulse(motion: int, share: float, size: float = 0.01 * MM) -> StopEdit:
    out = OffsetShift(axis="X", travel=size, velocity=0.004, pause=0.02)
    back = OffsetShift(axis="X", travel=-size, velocity=0.004, pause=0.02)
    return StopEdit(motion=motion, share=share, pause=0.01, shifts=(out, back))


def test_without_changes_the_bytes_are_the_same() -> None:
    text = "%\r\n o1 (x)\r\n g0x1\r\n\r\n%\r\n"
    assert changed(text).text == text.encode()


def test_a_pulse_behind_a_line() -> None:
    found = changed(START + "G1 X10\nY5\nM2\n", stops=(pulse(1, 1.0),))
    assert lines(found)[3:-1] == [
        "G4 P0.01",
        "G1 X10.01 F240",
        "G4 P0.02",
        "G1 X10",
        "G4 P0.02",
        "F600",
        "Y5",
    ]


def crossing(sign: int, low: float, high: float) -> CrossingEdit:
    """A crossing of X on the second motion in one block, to 10 µm on the side of its new direction."""
    added = np.array([0.01 * MM * sign, 0.0, 0.0])
    part = CrossingPart(motion=1, low=low, high=high, line=True, added=added, feed=None)
    return CrossingEdit(axis="X", sign=sign, parts=(part,), length=0.0, error=0.0)


@pytest.mark.parametrize("apart", [0.0, 1e-9, 1e-5, 2e-5])
def test_no_arc_beside_a_crossing_ends_where_it_begins(apart: float) -> None:
    """Rounded to the last decimal it would be a full circle: one of 0.15 mm, with a turn of 0.093 mm, was refused."""
    text = START.replace("Y0", "Y0 Z0") + "G2 X2 Y0 Z-1 I1\nG1 Z5\nM2\n"
    crossings = (crossing(1, apart, 0.2), crossing(-1, 0.5, 0.7), crossing(1, 0.7 + apart, 1.0 - apart))
    offset = np.array([[0.0, 0.0, 0.0], [0.01 * MM, 0.0, 0.0], [0.01 * MM, 0.0, 0.0]])
    found = changed(text, crossings=crossings, runs=runs_of(offset))
    arcs = [move for move in interpret(found.text.decode()) if move.mode > 1]
    assert len(arcs) == 1
    for end, share in ((arcs[0].start, 0.2), (arcs[0].end, 0.5)):
        place = (1.01 - math.cos(share * math.pi), math.sin(share * math.pi), -share)
        assert end == pytest.approx(place, abs=2e-4)


def test_a_rest_changes_nothing_else() -> None:
    rest = StopEdit(motion=1, share=1.0, pause=0.25, shifts=())
    found = changed(START + "G2 X10 I5\nX20 I5\nM2\n", stops=(rest,))
    assert lines(found)[2:] == ["G2 X10 I5", "G4 P0.25", "X20 I5", "M2"]


def test_shifts_that_are_no_whole_steps_come_back() -> None:
    shifts = tuple(
        OffsetShift(axis="X", travel=travel * 1e-7, velocity=0.004, pause=0.0) for travel in (0.6, 0.6, 0.6, -1.8)
    )
    found = changed(START + "G1 X10\nM2\n", stops=(StopEdit(motion=1, share=1.0, pause=0.0, shifts=shifts),))
    assert [line.split()[1] for line in lines(found)[3:-2]] == [
        "X10.0001",
        "X10.0001",
        "X10.0002",
        "X10",
    ]


def test_f_is_what_it_was() -> None:
    text = "G21 G90 F123.4567\nG0 X0 Y0\nG1 X10\nY5\nM2\n"
    found = changed(text, stops=(pulse(1, 1.0), pulse(2, 0.5)))
    result = read_program(found.text, "result.ngc")
    assert result.feed_word[-2] == 123.4567
    cuts = [line for line in lines(found) if line.startswith(("G1 Y", "Y"))]
    assert cuts == ["Y2.5F123.4567", "G1 Y5 F123.4567"]


@pytest.mark.parametrize(
    ("mode", "line", "expected"),
    [("G2 X10 I5", "X20 I5", "G2 X20 I5"), ("G3 X10 R9", "N7 X20R9", "N7 G3 X20R9")],
)
def test_a_line_that_relies_on_the_mode_is_told_it(mode: str, line: str, expected: str) -> None:
    found = changed(f"{START}{mode}\n(a remark)\nM8\n{line}\nM2\n", stops=(pulse(1, 1.0),))
    assert expected in [one.replace("N7 G3 X", "N7 G3 X") for one in lines(found)]
    result = read_program(found.text, "result.ngc")
    assert result.motions.angle[-1] == pytest.approx(
        read_program(f"{START}{mode}\n{line}\nM2\n".encode(), "part.ngc").motions.angle[-1]
    )


def test_a_rapid_that_relies_on_the_mode_stays_one() -> None:
    found = changed("G21 G90 F600\nG0 X0 Y0\nX5\nY5\nM2\n", stops=(pulse(1, 1.0),))
    assert lines(found)[-3:] == ["G0", "Y5", "M2"]
    assert read_program(found.text, "result.ngc").motions.kind[-1] == RAPID


def test_the_program_s_end_stays_behind_the_jog() -> None:
    found = changed("G21 G90 F600\nG0 X0 Y0\nN5 G1 X5 M9 M2 (end)\n", stops=(pulse(1, 1.0),))
    assert lines(found)[2] == "N5 G1 X5 M9  (end)"
    assert lines(found)[-2:] == ["F600", "M2"]


def test_words_of_a_divided_block_are_executed_once_and_in_order() -> None:
    found = changed("G21 G90\nG0 X0 Y0\nN5 G1 X8 F600 M8 S9 M0 (half)\nM2\n", stops=(pulse(1, 0.5),))
    text = lines(found)
    assert text[2] == "N5 G1 X4 F600 M8 S9  (half)"
    assert text[-3:] == ["G1 X8 F600", "M0", "M2"]
    for word in ("M8", "S9", "M0", "N5"):
        assert "\n".join(text).count(word) == 1


@pytest.mark.parametrize("share", [0.125, 0.37, 0.5, 0.9])
@pytest.mark.parametrize(
    "motion",
    [
        "G1 X7 Y3.3 Z1",
        "G2 X10 Y0 I5 J0",
        "G3 I-4 J3",
        "G3 X6 Y2 Z-4 R5",
        "G3 X6 Y2 R-5",
        "G2 X0 Y0 Z5 I3 J1 P3",
        "G5 X10 Y4 I3 J3 P-2 Q5",
        "G5.1 X10 Y0 I4 J4",
    ],
)
@pytest.mark.parametrize("before", ["", "G91\n", "G90.1\n"])
@pytest.mark.thinned(4)
def test_a_divided_motion_goes_the_same_way(motion: str, share: float, before: str) -> None:
    text = f"G21 G90 G17 F600\nG0 X0 Y0 Z0\n{before}{motion}\nG90\nG1 X0 Y0\nM2\n"
    found = changed(text, stops=(pulse(1, share),))
    path, _ = samples(found.program, 400)
    result, owner = samples(read_program(found.text, "result.ngc"), 40)
    motions = read_program(found.text, "result.ngc").motions
    jogs = np.isclose(np.linalg.norm(motions.end - motions.start, axis=1), 0.01 * MM, rtol=1e-4)
    # Three coordinates are rounded to a tenth of a micrometre.
    assert distances(result[~jogs[owner]], path).max() < np.sqrt(3.0) * 0.5e-7 + _chord(path)
    assert motions.end[-2] == pytest.approx(found.program.motions.end[-2], abs=1e-9)


def _chord(path: np.ndarray) -> float:
    """How far chords of so many samples may be off on these curves."""
    return float(np.square(np.linalg.norm(np.diff(path, axis=0), axis=1)).max() / (8 * 2 * MM))


def test_parts_under_g93_share_its_time() -> None:
    found = changed("G21 G90 G93\nG0 X0 Y0\nG1 X10 F10\nM2\n", stops=(pulse(1, 0.25),))
    durations = read_program(found.text, "result.ngc").motions.duration
    # 6 s in parts of a quarter and three; each jog of 0.01 mm takes 2.5 ms at 4 mm/s.
    assert durations[1:] == pytest.approx([1.5, 2.5e-3, 2.5e-3, 4.5], rel=1e-6)


def test_jogs_under_g91_are_steps() -> None:
    found = changed("G21 G91 F600\nG0 X1\nG1 X10\nG1 Y5\nM2\n", stops=(pulse(1, 1.0),))
    assert [line for line in lines(found) if line.startswith("G1 X")] == [
        "G1 X10",
        "G1 X0.01 F240",
        "G1 X-0.01",
    ]


def test_a_dip_keeps_its_times_and_leaves_the_rest() -> None:
    text = START + "G1 X10\nY10 (on)\nX5\nM2\n"
    found = changed(text, dips=(dip([1, 1, 1, 2, 2], [0.8, 0.9, 1.0, 0.1, 0.2], [0.2, 0.3, 0.3, 0.2]),))
    assert lines(found)[2:-2] == [
        "G1 X8",
        "G1 X9 F300",
        "G1 X10 F200",
        "Y1 (on)",
        "G1 Y2 F300",
        "G1 Y10 F600",
    ]
    assert lines(found)[-2:] == ["X5", "M2"]


def test_a_dip_over_a_joint_shares_its_time_by_length() -> None:
    found = changed(START + "G1 X10\nG2 X20 I5\nM2\n", dips=(dip([1, 2], [0.5, 0.5], [2.0]),))
    result = read_program(found.text, "result.ngc").motions
    arc = 5.0 * np.pi / 2
    assert result.feed[2:4] * 2.0 / MM == pytest.approx(5.0 + arc, rel=1e-6)
    assert result.feed[[1, 4]] == pytest.approx(10.0 * MM)


def test_a_stop_inside_a_dip() -> None:
    found = changed(START + "G1 X10\nM2\n", dips=(dip([1, 1], [0.2, 0.8], [1.2]),), stops=(pulse(1, 0.5),))
    feeds = [round(feed / MM, 6) for feed in read_program(found.text, "result.ngc").motions.feed.tolist()]
    assert feeds == [0.0, 10.0, 5.0, 4.0, 4.0, 5.0, 10.0]


def test_dips_leave_exact_stops_only_where_they_are() -> None:
    text = "G21 G90 F600 G61.1\nG0 X0 Y0\nG1 X10\nX20\nM2\n"
    found = changed(text, dips=(dip([1, 1], [0.2, 0.8], [1.2]),))
    exact = read_program(found.text, "result.ngc").motions.exact.tolist()
    assert exact == [1, 1, 0, 1, 1]
    assert "G64 P0.001 Q0" in lines(found)
    with pytest.raises(InputError, match=r"part\.ngc:3: grbl cannot leave exact-stop mode"):
        changed(text.replace("61.1", "61"), dialect="grbl", dips=(dip([1, 1], [0.2, 0.8], [1.2]),))


def test_the_tolerance_of_a_dip_is_in_the_program_s_unit() -> None:
    found = changed("G20 G90 F60 G61\nG0 X0 Y0\nG1 X10\nM2\n", dips=(dip([1, 1], [0.2, 0.8], [8.0]),))
    assert "G64 P0.000039 Q0" in lines(found)


def test_places_within_a_rounding_of_an_end_are_moved_there() -> None:
    found = changed(START + "G3 X0 Y0 I-10\nM2\n", stops=(pulse(1, 1e-9), pulse(1, 1.0 - 1e-9)))
    assert len([line for line in lines(found) if line.startswith("G3")]) == 1


def test_a_lasting_change_at_a_place_that_is_moved_to_the_end() -> None:
    offset = np.array([[0.0, 0.0, 0.0], [0.02, 0.0, 0.0], [0.0, 0.0, 0.0]]) * MM
    shift = OffsetShift(axis="X", travel=0.02 * MM, velocity=0.004, pause=0.02)
    stop = StopEdit(motion=1, share=1.0 - 1e-9, pause=0.01, shifts=(shift,))
    found = changed("G0 X9 Y0\nG1 X5 Y5 F60\nG0 X0\nM2\n", runs=runs_of(offset), stops=(stop,))
    assert lines(found)[1:4] == ["G1 X5 Y5 F60", "G4 P0.01", "G1 X5.02 F240"]


def test_a_rapid_that_carries_a_change_between_two_stops() -> None:
    # Y is shifted before the rapid, which takes X from none to -0.02 mm; then X goes to +0.02 mm.
    offset = np.array([[0.0, 0.0, 0.0], [0.02, -0.01, 0.0], [0.0, 0.0, 0.0]]) * MM
    y = OffsetShift(axis="Y", travel=-0.01 * MM, velocity=0.004, pause=0.02)
    x = OffsetShift(axis="X", travel=0.04 * MM, velocity=0.004, pause=0.02)
    stops = (
        StopEdit(motion=1, share=0.0, pause=0.01, shifts=(y,)),
        StopEdit(motion=1, share=1.0, pause=0.01, shifts=(x,)),
    )
    found = changed("G0 X9 Y0\nG0 X5 Y5\nG0 X0 Y0\nM2\n", runs=runs_of(offset), stops=stops)
    moves = [line for line in lines(found) if line.startswith("G")]
    assert moves[1:] == [
        "G4 P0.01",
        "G1 Y-0.01 F240",
        "G4 P0.02",
        "G0 X4.98 Y4.99",
        "G4 P0.01",
        "G1 X5.02 F240",
        "G4 P0.02",
        "G0 X0 Y0",
    ]


def test_a_rapid_is_not_divided() -> None:
    with pytest.raises(InputError, match=r"part\.ngc:2: a rapid cannot be divided"):
        changed("G0 X0 Y0\nG0 X5\nG1 X6 F60\nM2\n", stops=(pulse(1, 0.5),))


def test_what_follows_from_an_unknown_place_is_not_written() -> None:
    with pytest.raises(InputError, match=r"part\.ngc:3: a place inside a motion that begins where Z"):
        changed("G0 X0 Y0\nF600\nG2 X10 Z-2 I5 J0\nM2\n", stops=(pulse(1, 0.5),))


def test_terse_dialects_are_written_tersely() -> None:
    found = changed("G21G90F600\nG0X0Y0\nG1X10\nM2\n", dialect="grbl", stops=(pulse(1, 0.5),))
    assert "G1X5.01F240" in lines(found)
    assert max(len(line) for line in found.text.decode().splitlines()) <= 70


def test_many_shifts_at_one_place_are_told_in_a_line_that_is_not_too_long() -> None:
    text = "".join(f"G3 X0 Y0 I{n + 5} J{n}\n" for n in range(4))
    found = compensate((START + text + "M2\n").encode(), STEPPER, dialect="grbl")
    assert max(len(line) for line in found.text.decode().splitlines()) <= 70


def test_a_line_that_comes_out_too_long_is_refused() -> None:
    text = START + "G1X10" + " " * 62 + "F60\nX0\nM2\n"
    with pytest.raises(InputError, match="a line comes out too long for grbl"):
        compensate(text.encode(), STEPPER, dialect="grbl")


@needs_rs274
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_no_line_comes_out_longer_than_linuxcnc_reads(end: str) -> None:
    written = 0
    for size in range(244, 254 - len(end)):
        text = (START + f"G1 X10 F60 ({'c' * (size - 13)})\nX0\nM2\n").replace("\n", end)
        assert run_rs274(text).refusal == ""
        try:
            found = compensate(text.encode(), STEPPER, dialect="linuxcnc")
        except InputError:
            continue
        assert run_rs274(found.text.decode()).refusal == ""
        written += 1
    assert written >= 3


@pytest.mark.parametrize("dialect", ["grbl", "marlin"])
def test_a_comment_that_firmware_throws_away_makes_no_line_too_long(dialect: str) -> None:
    # Both keep the characters outside comments alone (protocol.c of Grbl 1.1, queue.cpp of Marlin 2).
    text = START + "G1 X10 F600 ;" + "x" * (57 if dialect == "grbl" else 67) + "\nG1 X0\nG1 X5\n"
    found = compensate(text.encode(), STEPPER, dialect=dialect).text.decode().splitlines()
    long = [line for line in found if "xxx" in line]
    assert [len(line) > (70 if dialect == "grbl" else 80) for line in long] == [True]
    assert long[0].partition(";")[0].strip() != "G1 X10 F600"


def test_a_comment_that_makes_a_new_line_too_long_stands_before_it() -> None:
    text = START + "G2 X10 Y0 I5 J0 (" + "x" * 50 + ")\nX0\nM2\n"
    written = compensate(text.encode(), STEPPER, dialect="grbl").text.decode().splitlines()
    place = written.index("(" + "x" * 50 + ")")
    assert written[place + 1].startswith("G2 X")
    assert max(map(len, written)) <= 70


def test_a_line_may_grow_whose_comment_makes_it_longer_than_the_controller_s_line() -> None:
    text = START + "G1X10 ;" + "x" * 90 + "\nX0\nM2\n"
    assert "G1X10.03 ;" in compensate(text.encode(), STEPPER, dialect="grbl").text.decode()


def test_a_last_line_without_an_end_is_no_longer_for_that() -> None:
    text = START + "G1X10\nX0\nM2\n" + "-" * 99
    assert compensate(text.encode(), STEPPER, dialect="grbl").text.decode().count("-" * 99 + "\n") == 1


def test_numbers_of_a_float_s_digits_are_shifted_and_come_back() -> None:
    text = START + "G1 X5 Y0.15000000000000002\nX0.30000000000000004 Y-0.1\nX5\nM2\n"
    found = compensate(text.encode(), STEPPER)
    assert "X5.03 Y0.190000000" in found.text.decode()
    assert undo(found.text, "part.ngc") == text.encode()
    assert verify(found.program, read_program(found.text, "part.ngc"), tolerance=1e-6).failures == ()


def test_a_place_of_more_steps_than_can_be_counted_is_refused() -> None:
    text = START + "G1 X5.123456789\nX0\nX10000000000\nX0\nM2\n"
    with pytest.raises(InputError, match=r"part\.ngc:\d+: a place that has too many digits to be written"):
        compensate(text.encode(), STEPPER)


def test_numbers_keep_their_manner() -> None:
    text = START + "X+.5\nX 1 0.\nX-0.010\nX007.5\nX-.01\nX.0\nX20\nx+0.00\nG1 X10.00000\nM2\n"
    found = compensate(text.encode(), STEPPER)
    words = [line for line in lines(found) if re.match(r"(?i)X|G1 X10.0.000", line)]
    assert words == [
        "X+.53",
        "X10.03",
        "X-0.040",
        "X007.53",
        "X-.04",
        "X.03",
        "X20.03",
        "x-0.03",
        "G1 X10.03000",
    ]
    assert undo(found.text, "part.ngc") == text.encode()


def test_words_in_comments_and_deleted_blocks_stay() -> None:
    text = START + "G1 X10 (X10 Y3) ; X5\n; X7\n/X3\nX0\nM2\n"
    found = compensate(text.encode(), STEPPER)
    assert "G1 X10.03 (X10 Y3) ; X5" in lines(found)
    assert {"; X7", "/X3"} <= set(lines(found))
    # Before the block that may be skipped the axis is where the program has it, and the feed is the program's.
    place = lines(found).index("; X7")
    last = [line for line in lines(found)[:place] if "X" in line][-1]
    assert re.fullmatch(r"G1 X10 F\d+\.?\d*", last)
    assert lines(found)[place - 1] == "F600"


@pytest.mark.parametrize("remark", [" ; ", ";\t", " ; round "])
@pytest.mark.parametrize(
    ("dialect", "round_"), [("grbl", "G3 X20 Y0 I-20"), ("marlin", "G3 X20 Y0 I-20"), ("linuxcnc", "G1 X0\nX20 Y9")]
)
def test_blanks_that_end_a_comment_stay(dialect: str, round_: str, remark: str) -> None:
    text = f"G21\nG90\nG1 X0 Y0 F600\nG1 X20 Y0{remark}\n" + "".join(f"{one}{remark}\n" for one in round_.splitlines())
    text += f"G1 X5{remark}\nG1 X30{remark}\n"
    found = compensate(text.encode(), STEPPER, dialect=dialect)
    assert found.text.count(f"{remark}\n".encode()) == text.count(f"{remark}\n")
    assert b"crossing" in found.text
    after = read_as(dialect, found.text, "part.ngc")
    assert verify(found.program, after, tolerance=5e-6, machine=STEPPER).failures == ()


def test_axes_beside_x_y_and_z_move_in_units_too() -> None:
    program = read_program(b"G21 G90 F60\nG0 X0 U0\nG1 X5\nG20\nU1\nG21\nX1\nM2\n", "part.ngc")
    assert why_not_editable(program) == ["it moves in mm and in inches"]


def test_what_is_in_other_units_carries_no_offset() -> None:
    program = read_program(b"G21 G90 F60\nG0 X0\nG1 X5\nG20\nX1\nM2\n", "part.ngc")
    offset = np.full((3, 3), 0.01 * MM)
    with pytest.raises(InputError, match="in both mm and inches"):
        with_edits(program, Edits(runs=runs_of(offset)), STEPPER, "linuxcnc")


def test_feeds_of_few_decimals_are_rounded_down() -> None:
    """A jog of 0.004 inches at 8.4182 inches a minute was written with F8.42, which the check refuses as too fast."""
    text = "%\nO1\nG20 G90 G17 G94\n" + "".join(
        f"G0 X{n % 2} Y{n % 3} Z0.2\nG1 Z-0.01 F3.\nX1.1458 F10.\nX1.1927 Y{n % 3 + 0.1}\nZ0.2\n" for n in range(4)
    )
    axes = {name: replace(axis, gap=axis.gap.with_lost_motion(5e-5)) for name, axis in STEPPER.axes.items()}
    found = compensate((text + "M30\n%\n").encode(), replace(STEPPER, dialect="fanuc", axes=axes), dialect="fanuc")
    written = found.text.decode()
    alone, together = (
        {float(one) for one in re.findall(words + r" F([.\d]+)", written)} - {3.0, 10.0}
        for words in (r"G1 [XY][-.\d]+", r"G1 X[-.\d]+ Y[-.\d]+ Z[-.\d]+")
    )

    def most(name, way):
        """Largest feed of a move of an axis: half of its way is run up, and half down."""
        return math.sqrt(axes[name].limits.acceleration * way * 25.4e-3 / 2.0) / 25.4e-3 * 60.0

    assert alone == {math.floor(100.0 * most(*one)) / 100.0 for one in (("X", 0.004), ("X", 0.002), ("Y", 0.004))}
    # All are taken back in one move beside a cut, as fast as Z can be on its way, which is twice that of X and Y.
    assert together == {math.floor(100.0 * math.sqrt(1.5) * math.sqrt(2.0) * most("Z", 0.002)) / 100.0}
