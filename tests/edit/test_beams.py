"""Reversals with a laser, a torch or an extruder on, held to what a beam burns and a nozzle lays down.

The reference reads the programs itself. What a beam burns in a block is exact: at a power of S times speed over F (M4)
it is S times the block's length over F, however the speed changes; at constant power (M3) it is S times the time, which
for a block at F that no corner slows down is the same.
"""

from __future__ import annotations

import itertools
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from msgspec.structs import replace
from support.corpus import Entry
from support.corpus import stepper as router
from support.corpus_judge import judge, played_places, table_of
from support.editing import Compensated, compensate
from support.ideal_play import Polyline
from support.reference_player import BEGINS, Move, distance, interpret, run, tables

from ph_post.dialects.reading import read_as
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.edit.edits import EditOptions
from ph_post.edit.extrusion import filament_of, with_filament
from ph_post.edit.offset_edits import plan_offsets
from ph_post.gcode.read import read_program
from ph_post.gcode.working import tool_in_words, working_motions
from ph_post.types import Machine
from ph_post.verify.verify import verify

GAPS = (0.06, 0.08, 0.0)
"""Backlash of the stepper router in X and Y [mm]; these programs do not move its Z."""

SQUARE = "G1 X50 Y10 S800 F1500\nG1 X50 Y40\nG1 X10 Y40\nG1 X10 Y10\n"
DIAMOND = "G1 X20 Y20 S800 F1500\nG1 X10 Y30\nG1 X0 Y20\nG1 X10 Y10\n"
ROUND = "G2 X10 Y10 I12 J0 S800 F1500\nG2 X10 Y10 I12 J0\n"
SMALL = "G2 X10 Y10 I3 J0 S800 F1500\nG2 X10 Y10 I3 J0\n"
CUTS = {"square": SQUARE, "diamond": DIAMOND, "round": ROUND, "small": SMALL}


def laser(cut: str, mode: str, end: str = "M5\n") -> str:
    return f"G21 G90\n{mode} S0\nG0 X10 Y10\n{cut}{end}G0 X0 Y0\nM2\n"


def stepper(tool: str | None = None, dialect: str = "grbl") -> Machine:
    return replace(read_machine("stepper"), tool=tool, dialect=dialect)


def compensated(text: str, machine: Machine) -> Compensated:
    """A program compensated, and found right by the checker."""
    found = compensate(text.encode(), machine, dialect=machine.dialect, max_slowdown=0.5)
    after = read_program(found.text, "after", language=found.program.language)
    if found.text != text.encode():
        verdict = verify(found.program, after, tolerance=5e-6, machine=machine)
        assert verdict.ok, verdict.failures
    return found


def made(text: str, machine: Machine) -> str:
    return compensated(text, machine).text.decode()


@dataclass(frozen=True)
class Lit:
    """A motion with the beam on: its line, S, F, and whether the power follows the speed."""

    move: Move
    power: float
    follows: bool


def lit(text: str) -> Iterator[Lit]:
    """Motions with the beam on, in Grbl's laser mode."""
    moves = {move.line: move for move in interpret(text, BEGINS[0])}
    spindle, power = "M5", 0.0
    for number, raw in enumerate(text.splitlines(), 1):
        line = re.sub(r"\([^)]*\)|;.*", "", raw).upper()
        for word in re.findall(r"M0?[345](?!\d)", line):
            spindle = word.replace("0", "")
        power = float(found[1]) if (found := re.search(r"S([\d.]+)", line)) else power
        if spindle != "M5" and power > 0.0 and number in moves and moves[number].mode > 0:
            yield Lit(moves[number], power, spindle == "M4")


def dwells_while_lit(text: str) -> list[int]:
    """Lines with a dwell while M3 S.. is on, or before the next line that moves with the beam on."""
    spindle, power, found = "M5", 0.0, []
    for number, raw in enumerate(text.splitlines(), 1):
        line = re.sub(r"\([^)]*\)|;.*", "", raw).upper()
        for word in re.findall(r"M0?[345](?!\d)", line):
            spindle = word.replace("0", "")
        power = float(seen[1]) if (seen := re.search(r"S([\d.]+)", line)) else power
        if spindle != "M5" and power > 0.0 and re.search(r"G0?4(?!\d)", line):
            found.append(number)
    return found


def error(original: str, changed: str) -> tuple[float, float]:
    """Largest and rms distance of the table from the original while the beam is on [mm], wherever it began."""
    path = [one.move for one in lit(original)]
    lines = {one.move.line for one in lit(changed)}
    most, mean = 0.0, 0.0
    for begin in BEGINS:
        moves = interpret(changed, begin)
        done = run(moves)
        on = np.array([move.line in lines for move in moves])[done.owner]
        for table in tables(done.motor, GAPS, (0, 0, 0)):
            off = distance(table[on], path)
            most, mean = max(most, float(off.max())), max(mean, float(np.sqrt((off * off).mean())))
    return most, mean


@pytest.mark.parametrize("mode", ["M3", "M4"])
@pytest.mark.parametrize("cut", CUTS, ids=str)
def test_no_beam_stands_or_is_slowed_down(cut: str, mode: str) -> None:
    text = laser(CUTS[cut], mode)
    changed = made(text, stepper())
    assert dwells_while_lit(changed) == []
    for one in lit(changed):
        way = one.move.end - one.move.start
        alone = np.count_nonzero(np.abs(way) > 1e-9) == 1 and np.linalg.norm(way) < 0.2
        # No axis moves alone in these corners at constant power; where it follows the speed one does so at F itself.
        assert not alone or (one.follows and one.move.feed == 1500.0)
        assert one.move.feed > 0.997 * 1500.0


@pytest.mark.parametrize("mode", ["M3", "M4"])
@pytest.mark.parametrize("cut", CUTS, ids=str)
def test_what_is_burnt_along_the_cut_is_what_it_was(cut: str, mode: str) -> None:
    text = laser(CUTS[cut], mode)
    before, after = (
        [one.power * one.move.length / one.move.feed for one in lit(one)] for one in (text, made(text, stepper()))
    )
    # Each of at most eight crossings adds no more than its own backlash, along which the table stands.
    assert abs(sum(after) - sum(before)) < 8 * 800.0 * 0.08 / 1500.0
    assert abs(sum(after) / sum(before) - 1.0) < 0.006


@pytest.mark.parametrize(("cut", "mode"), [(cut, mode) for cut in CUTS for mode in ("M3", "M4") if cut != "diamond"])
def test_a_beam_s_part_is_better(cut: str, mode: str) -> None:
    text = laser(CUTS[cut], mode)
    most, mean = error(text, made(text, stepper()))
    plain, plain_mean = error(text, text)
    assert plain > 0.029
    assert mean < plain_mean / 5.0
    # v² g / 4 a R, of a crossing at full speed on the radius of 3 mm, in Y; micrometres elsewhere.
    small = 25.0**2 * 0.08 / (4.0 * 200.0 * 3.0)
    assert most < (1.3 * small if cut == "small" else 0.0025)
    assert most < 0.6 * plain


def test_a_sharp_corner_is_crossed_at_a_power_that_follows_and_behind_it_at_constant_power() -> None:
    follows, constant = laser(DIAMOND, "M4"), laser(DIAMOND, "M3")
    assert error(follows, made(follows, stepper()))[0] < 1e-3
    changed = made(constant, stepper())
    assert dwells_while_lit(changed) == []
    (plain, plain_mean), (most, mean) = error(constant, constant), error(constant, changed)
    assert mean < plain_mean / 4.0
    assert most < 0.7 * plain
    # Every crossing goes on along the path, by at least as much as it goes across, and no slower.
    for one in lit(changed):
        assert np.count_nonzero(np.abs(one.move.end - one.move.start) > 0.05) == 2
        assert one.move.feed >= 1500.0


def test_a_slow_curve_of_short_lines_is_crossed_beside_the_joint_where_the_axis_turns() -> None:
    """At 100 mm/min the motor crosses within 22 µm: less than a part of a line on either side of the joint takes."""
    angles = np.linspace(0.0, 2.0 * np.pi, 250)
    lines = "".join(f"G1 X{10.0 - 6.0 * np.cos(a):.4f} Y{20.0 + 6.0 * np.sin(a):.4f}\n" for a in angles)
    text = f"G21 G90\nG0 X4 Y20\nM3 S800\nF100\n{lines}M5\nG0 X0 Y0\nM2\n"
    found = compensated(text, stepper("laser"))
    changed = found.text.decode()
    assert not [one for one in found.edits.warnings if "burn a dot" in one]
    assert changed.count("crossing") >= 3
    assert error(text, changed)[1] < error(text, text)[1] / 5.0


BLUNT = "G1 X30 Y14 S800 F1500\nG1 X40 Y10.4 S700\nG1 X40 Y40\nG1 X10 Y10\n"
"""Y turns in a blunt corner, which is passed fast, and where the power changes: it would have to do so from a stop."""


def test_one_cut_is_left_and_the_others_are_not() -> None:
    text = laser(BLUNT + "G1 S0\nG0 X60 Y10\n" + SQUARE.replace("X50", "X90").replace("X10", "X60"), "M3")
    found = compensated(text, stepper())
    changed = found.text.decode()
    (said,) = [one for one in found.edits.warnings if "would burn a dot in a sharp corner" in one]
    assert said.endswith('; tool = "pen" in the machine file says that it is a pen, which burns nothing')
    (said,) = [one for one in compensated(text, stepper("laser")).edits.warnings if "would burn a dot" in one]
    assert "a pen" not in said
    assert BLUNT in changed
    assert "crossing X-" in changed
    assert error(text, changed)[1] < 0.8 * error(text, text)[1]
    assert error(text, changed)[0] <= error(text, text)[0] * (1.0 + 1e-9)


@pytest.mark.parametrize(
    ("singly", "rounds", "kept"),
    [(3, 8, (True, False, True)), (0, 8, (True, False, False)), (0, 2, (False, False, False))],
)
def test_where_each_plan_marks_another_cut_all_is_left_from_the_first_one_on(
    singly: int, rounds: int, kept: tuple[bool, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A print of six hours had a new bead marked in each plan, and of 78,000 changes 6,000 were left."""
    monkeypatch.setattr("ph_post.edit.offset_edits.SINGLY", singly)
    monkeypatch.setattr("ph_post.edit.offset_edits.BEAM_ROUNDS", rounds)
    before, behind = (SQUARE.replace("X50", f"X{x + 30}").replace("X10", f"X{x}") for x in (60, 110))
    text = laser(f"G1 S0\nG0 X60 Y10\n{before}G1 S0\nG0 X10 Y10\n{BLUNT}G1 S0\nG0 X110 Y10\n{behind}", "M3")
    found = compensated(text, stepper())
    changed = found.text.decode()
    assert tuple(cut not in changed for cut in (before, BLUNT, behind)) == kept
    assert [one for one in found.edits.warnings if "would burn a dot in a sharp corner" in one]


def test_an_axis_that_turns_where_the_beam_is_switched_off_is_shifted_behind_that() -> None:
    """Pieces that end in a corner, with the same place said twice, as a CAM for Grbl writes them: no rapids between."""
    cuts = "M3 S800\n{}\nM5 S0\n"
    first, second = "G1 X10 Y30 F1500\nG1 X40 Y42\nG1 X40 Y42", "G1 X12 Y45 F1500\nG1 X9 Y70"
    text = f"G21 G90\nG1 X20 Y10 F1500\n{cuts.format(first)}G1 X30 Y20\n{cuts.format(second)}G0 X0 Y0\nM2\n"
    found = compensated(text, stepper("laser"))
    changed = found.text.decode()
    assert not [one for one in found.edits.warnings if "burn a dot" in one]
    assert dwells_while_lit(changed) == []
    for one in lit(changed):
        assert np.linalg.norm(one.move.end - one.move.start) > 0.1 or one.move.length == 0.0
    assert re.search(r"M5 S0\n\(ph-post: [^)]*X-", changed)


def test_rows_to_and_fro_with_m4_are_shifted_behind_m5() -> None:
    """No faster than the axis can be there: as fast as the cut it may be with the beam on alone."""
    rows = "".join(f"M4\nG1 X{(40, 10)[n % 2]}\nM5\nG1 Y{10.2 + 0.2 * n:.1f}\n" for n in range(6))
    text = f"G21 G90\nG1 X10 Y10 F1000 S100\n{rows}M2\n"
    changed = made(text, stepper("laser"))
    assert re.search(r"M5\n\(ph-post: [^)]*X-", changed)
    assert error(text, changed)[1] < error(text, text)[1] / 5.0
    assert dwells_while_lit(changed) == []


def test_axes_come_to_their_sides_before_the_beam_is_switched_on_at_the_same_place() -> None:
    """Scripts write every line with its beginning, before M3 and behind it: the axes rest there in both."""
    places, text = ["X16 Y24", "X53 Y40", "X59 Y17", "X34 Y16", "X19 Y22"], "G21 G90\n"
    for place, following in itertools.pairwise(places):
        text += f"G1 {place} F3000\nM3 S1000\nG1 {place} F3000\nG1 {following} F2000\nM5\n"
    found = compensated(text + "M2\n", stepper())
    changed = found.text.decode()
    assert not [one for one in found.edits.warnings if "burn a dot" in one]
    assert dwells_while_lit(changed) == []
    assert error(text, changed)[1] < error(text, text)[1] / 20.0


def test_a_last_arc_is_divided_and_its_axis_comes_back_with_the_beam_off() -> None:
    """Crossed within the motion behind which the beam is switched off, and shifted again behind that."""
    arcs = "M3 S800\nG4 P0.1\nF600\nG2 X{1} Y{0} I10 J0\nG2 X{0} Y{0} I-10 J0\nG4 P0\nM5 S0\nG1 F3000\n"
    text = (
        "G21 G90\nF3000\n"
        + "".join(f"G1 X{at} Y{at}\n{arcs.format(at, at + 20)}" for at in (10, 34))
        + "G1 X0 Y0\nM2\n"
    )
    found = compensated(text, stepper("laser"))
    changed = found.text.decode()
    assert not [one for one in found.edits.warnings if "burn a dot" in one]
    assert len(dwells_while_lit(changed)) == len(dwells_while_lit(text))
    assert re.search(r"crossing [XY][+-]\)\nG2 [^M]*G4 P0\nM5 S0\n\(ph-post: [^)]*[XY][+-]", changed)
    assert error(text, changed)[1] < error(text, text)[1] / 5.0


def test_an_edge_of_short_lines_is_an_edge() -> None:
    """X crosses on the way along it, as on one line: none of its parts has room for that."""
    edge = "".join(f"G1 X20 Y{0.1 * k:.1f}\n" for k in range(1, 41))
    text = f"G21 G90\nG0 X0 Y0\nM3 S800\nG1 X20 Y0 F800\n{edge}G1 X0 Y8\nM5\nG0 X0 Y0\nM2\n"
    found = compensated(text, stepper("laser"))
    changed = found.text.decode()
    assert not [one for one in found.edits.warnings if "burn a dot" in one]
    assert "crossing X-" in changed
    assert error(text, changed)[1] < error(text, text)[1] / 20.0


@pytest.mark.parametrize("end", ["M5\n", "G1 S0\nM5\n"])
def test_offsets_are_taken_back_with_the_beam_off(end: str) -> None:
    text = f"G21 G90\nM3 S0\nG0 X10 Y10\n{SQUARE}{end}M2\n"
    changed = made(text, stepper())
    assert "X to 0" in changed
    assert dwells_while_lit(changed) == []
    assert changed.index("M5\n") < changed.index("X to 0") or "S0" in end


def test_nothing_is_shifted_where_the_beam_is_never_off() -> None:
    text = f"G21 G90\nM3 S800\nG0 X10 Y10\n{SQUARE}M2\n"
    found = compensated(text, stepper("laser"))
    assert found.text == text.encode()


TORCH = "G21 G90\nG0 X0 Y0\nM3 S1\nG4 P0.5\n{cut}M5\nG0 X0 Y0\nM2\n"


@pytest.mark.parametrize("cut", ["square", "round", "diamond"])
def test_a_torch_never_rests(cut: str) -> None:
    text = TORCH.format(cut=CUTS[cut].replace(" S800", "").replace("G2 X10 Y10 I12", "G2 X0 Y0 I12"))
    found = compensated(text, stepper("plasma"))
    changed = found.text.decode()
    # The pierce delay is the program's own.
    assert changed.count("G4") == 1
    assert not re.search(
        r"^G1[XY][-\d.]+F?[\d.]*$", changed[changed.index("M3 S1") : changed.index("M5")], re.MULTILINE
    )
    assert changed != text


def printed(points: list[tuple[float, float]], relative: bool, per_mm: float = 0.033) -> str:
    """A perimeter of straight lines as slicers write it, with retraction."""
    lines = [
        "G21",
        "G90",
        "M83" if relative else "M82",
        "G92 E0",
        "G0 X{:.4f} Y{:.4f} F9000".format(*points[0]),
        "G1 E2 F2400",
    ]
    at = 2.0
    for one, other in itertools.pairwise(points):
        more = round(per_mm * math.dist(one, other), 5)
        at += more
        lines.append(f"G1 X{other[0]:.4f} Y{other[1]:.4f} E{more if relative else at:.5f} F1800")
    lines += [f"G1 E{-2.0 if relative else at - 2.0:.5f} F2400", "G0 X0 Y0 F9000"]
    return "\n".join(lines) + "\n"


BOX = [(20.0, 20.0), (60.0, 20.0), (60.0, 60.0), (20.0, 60.0), (20.0, 20.0)]
RING = [(40.0 + 20.0 * math.cos(0.1 * n + 1.0), 40.0 + 20.0 * math.sin(0.1 * n + 1.0)) for n in range(63)]
SHAPES = {"box": BOX, "ring": RING}


def laid(text: str, relative: bool) -> list[tuple[np.ndarray, float]]:
    """Ends of the lines that move, and what has come out of the nozzle until there [mm of filament]."""
    at, place, total, found = 0.0, np.zeros(2), 0.0, []
    for raw in text.splitlines():
        line = raw.partition(";")[0]
        words = dict(re.findall(r"([A-Z])([-+]?[\d.]+)", line))
        if line.startswith("G92"):
            at = float(words["E"])
        elif words.get("G") in ("0", "1", "2", "3"):
            place = np.array([float(words.get("X", place[0])), float(words.get("Y", place[1]))])
            if "E" in words:
                step = float(words["E"]) if relative else float(words["E"]) - at
                at, total = float(words["E"]), total + step
            found.append((place.copy(), total))
    return found


@pytest.mark.parametrize("dialect", ["marlin", "klipper"])
@pytest.mark.parametrize("relative", [True, False], ids=["M83", "M82"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.thinned(16)
def test_filament_goes_with_the_original_way(shape: str, relative: bool, dialect: str) -> None:
    points = SHAPES[shape]
    text = printed(points, relative)
    changed = made(text, stepper(dialect=dialect))
    assert "crossing X-" in changed
    assert "crossing Y-" in changed
    assert laid(changed, relative)[-1][1] == pytest.approx(laid(text, relative)[-1][1], abs=1e-9)
    corners = np.array(points)
    along = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1)))
    behind = 0.0
    amounts = laid(changed, relative)
    for place, amount in amounts[2:-2]:
        # The place along the perimeter, no earlier than the last one.
        share = np.linspace(0.0, 1.0, 4001)
        best, apart = behind, math.inf
        for n in range(len(corners) - 1):
            spots = corners[n] + share[:, None] * (corners[n + 1] - corners[n])
            far = np.linalg.norm(spots - place, axis=1)
            way = along[n] + share * (along[n + 1] - along[n])
            far[(way < behind - 0.1) | (way > behind + 41.0)] = math.inf
            if far.min() < apart:
                apart, best = float(far.min()), float(way[far.argmin()])
        behind = best
        if amount > 2.0:
            assert amount - 2.0 == pytest.approx(0.033 * best, abs=0.033 * 0.15)


@pytest.mark.parametrize("relative", [True, False], ids=["M83", "M82"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_a_bead_has_no_dwell_and_no_travel(shape: str, relative: bool) -> None:
    text = printed(SHAPES[shape], relative)
    changed = made(text, stepper(dialect="klipper"))
    lines = [line for line in changed.splitlines() if not line.startswith(";")]
    beads = [n for n, line in enumerate(lines) if re.match(r"G1 [XY].*E", line)]
    between = lines[beads[0] : beads[-1] + 1]
    assert not [line for line in between if line.startswith("G4")]
    assert [line for line in between if re.match(r"G1 [XY]", line) and " E" not in line] == []
    # Behind the last bead the filament is pulled back before anything rests.
    assert lines[beads[-1] + 1].startswith("G1 E")


@pytest.mark.parametrize("relative", [True, False], ids=["M83", "M82"])
@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_a_print_that_begins_with_a_bead_has_its_axes_led_onto_their_first_sides(shape: str, relative: bool) -> None:
    """Each once, where it begins to move, while the path stands there: no rapid led to the first place."""
    whole = printed(SHAPES[shape], relative).splitlines(keepends=True)
    begin = "G92 X{:.4f} Y{:.4f} E0\n".format(*SHAPES[shape][0])
    text = "".join([*whole[:3], begin, *whole[6:]])
    found = judge(Entry("print", Path("print.gcode"), "marlin", text))
    assert found.compensated == found.reversals > 1
    assert found.followed == found.shown > 1
    assert found.rms is not None
    # Until X has moved through its backlash it is where nobody knows.
    assert 5.0 * found.rms[1] < found.rms[0]
    assert found.rms[0] > 0.01
    lines = made(text, stepper(dialect="marlin")).splitlines()
    rests = [n for n, line in enumerate(lines) if line.startswith("G4")]
    assert 2 <= len(rests) <= 6
    crossings = [n for n, line in enumerate(lines) if line.startswith("; ph-post: +") and "crossing" in line]
    assert rests[-1] < crossings[-1]


@pytest.mark.parametrize("pulled", ["G1 E-1 F300\n", "", "G1 X-10 E-1\n"], ids=["in place", "not", "wiped"])
def test_a_print_whose_last_bead_goes_on_into_a_way_out_that_pulls_back_is_compensated(pulled: str) -> None:
    """G91 takes the nozzle away there, and behind the homing the next move pulls back too: it may rest before."""
    bead = printed(RING, relative=False).splitlines(keepends=True)[:-2]
    text = "".join([*bead, "G91\n", pulled, "G1 Z0.5 E-5 X-20 Y-20 F9000\nG28 X0 Y0\nM84\nG90\nM82\nG1 Z25 E-1 F900\n"])
    found = judge(Entry("print", Path("print.gcode"), "marlin", text))
    assert found.outcome == "compensated"
    assert found.followed == found.shown
    assert found.shown >= 4


def test_before_a_wipe_behind_a_word_that_nobody_knows_the_nozzle_may_rest() -> None:
    """All that is carried is taken back at the end of the bead, as behind the word no place is known."""
    bead = printed(RING, relative=True).splitlines(keepends=True)[:-2]
    text = "".join([*bead, "M625\nG1 X-10 E-1\nG28 X0 Y0\nM84\n"])
    found = judge(Entry("print", Path("print.gcode"), "marlin", text))
    assert found.outcome == "compensated"
    assert found.compensated == found.reversals >= 4
    assert found.followed == found.shown


@pytest.mark.parametrize("left", [frozenset(), frozenset(range(50))], ids=["none", "all"])
def test_where_there_is_no_time_at_all_nothing_of_a_print_is_compensated(left: frozenset[int]) -> None:
    """Nor where every section was left before."""
    dialect = find_dialect("marlin")
    program = read_program(printed(BOX, relative=True).encode(), "a.gcode", language=dialect.language)
    edits = plan_offsets(program, router("marlin"), dialect, EditOptions(max_slowdown=-1.0, in_parts=True, left=left))
    assert edits.empty
    assert edits.short


def test_ways_through_the_air_carry_the_changes_of_a_print() -> None:
    """Beads to plus, each begun above the last one: X turns at both ends of a way back, and Z hops."""
    beads = "".join(
        f"G1 Z0.6 F6000\nG1 X10 Y{y} F9000\nG1 Z0.2 F6000\nG1 E1 F2400\nG1 X60 Y{y + 0.2:g} E2 F1800\nG1 E-1 F2400\n"
        for y in range(20, 30)
    )
    text = f"G28\nG90\nM83\nG92 E0\nG1 Z0.2 F6000\nG1 X10 Y19 F9000\nG1 X60 E2 F1800\nG1 E-1 F2400\n{beads}"
    changed = compensate(text.encode(), router("marlin"), dialect="marlin", max_slowdown=0.1).text
    marks = [line for line in changed.decode().splitlines() if line.startswith("; ph-post: +")]
    behind = [line for line in marks if "Z" not in line]
    # X comes back before each bead; Y and Z turn nowhere or in the air.
    assert 10 <= len(behind) <= 12
    assert len(marks) <= 13
    motor, cuts = played_places("marlin", changed)
    path = played_places("marlin", text.encode())[0]
    for side in (-1.0, 1.0):
        table = table_of(motor, side, "XYZ")
        assert Polyline(path).distances(table[cuts]).max() < 0.003


def test_behind_a_tool_change_a_line_of_prime_lies_where_it_should() -> None:
    """Y is told its place there once, by a way through the air: it comes to that from beyond its backlash."""
    prime = "G1 Z0.3 F900\nG1 X50 Y-2 F9000\nG1 X200 E15 F1500\nG1 X100 E10\n"
    print_ = printed(BOX, relative=True).partition("G92 E0\n")[2]
    text = f"G28\nG90\nM83\nT1\n{prime}T1\n{print_}T1\n{print_}"
    changed = compensate(text.encode(), router("marlin"), dialect="marlin", max_slowdown=2.0).text
    motor, cuts = played_places("marlin", changed)
    low = cuts & (motor[:, 1] < 0.0)
    assert low.sum() > 1000
    for side in (-1.0, 1.0):
        assert np.abs(table_of(motor, side, "XYZ")[low, 1] + 2.0).max() < 1e-3


@pytest.mark.parametrize("photographed", [True, False], ids=["macro", "none"])
def test_a_layer_to_which_z_comes_from_a_macro_is_as_high_as_those_to_which_it_hops(photographed: bool) -> None:
    """The second layer alone is reached by no hop, and where the nozzle comes from only the macro knows."""
    frame = "TIMELAPSE_TAKE_FRAME\n" if photographed else ""
    bead = "".join("G1 X{:g} Y{:g} E0.5\n".format(*place) for place in itertools.product((10, 40), (20, 30), repeat=1))
    hop = "G1 E-1 F2400\nG1 Z{up:g} F6000\nG1 X40 Y40 F6000\nG1 Z{down:g}\nG1 E1 F2400\nG1 F1500\n"
    text = "G21\nG90\nM83\nG92 E0\n"
    for layer in range(1, 5):
        height = 0.2 * layer
        hops = "" if layer == 2 else hop.format(up=height + 0.4, down=height)
        text += f"{frame}G1 Z{height:g} F6000\nG1 X10 Y10\nG1 F1500\n{bead}{hops}{bead}"
    changed = compensate(text.encode(), router("klipper"), dialect="klipper", max_slowdown=2.0).text
    motor, cuts = played_places("klipper", changed)
    on = cuts & (motor[:, 2] > 0.1)
    heights = 0.2 * np.arange(1, 5)
    for side in (-1.0, 1.0):
        table = table_of(motor, side, "XYZ")[on, 2]
        assert np.abs(table[:, None] - heights).min(axis=1).max() < 1e-3
        assert {int(np.abs(heights - z).argmin()) for z in table} == {0, 1, 2, 3}


@pytest.mark.parametrize(
    ("modes", "certain"),
    [
        ("M82\n", True),
        ("M83\n", True),
        ("G90\nM83\n", True),
        ("M82\nG90\n", True),
        ("M83\nG90\n", False),
        ("M82\nG91\n", False),
        ("M83\nG91\n", True),
        ("", False),
        ("M83\nSTART_PRINT\n", False),
        ("M83\nTIMELAPSE_TAKE_FRAME\n", True),
        ("M83\nTIMELAPSE_TAKE_FRAME\nSTART_PRINT\n", False),
        ("M83\nG92 X0\n", True),
        (f"M83\nG{5000 * '0'}1 X1 E{5000 * '1'} F900\n", True),
    ],
    ids=range(13),
)
def test_the_mode_of_e_is_certain_or_nothing_is_divided(modes: str, certain: bool) -> None:
    text = f"G90\n{modes}G92 E0\nG1 X10 E1 F900\nG1 X0 E2\n"
    program = read_program(text.encode(), "a.gcode", language=find_dialect("klipper").language)
    assert bool(filament_of(program)) == certain


@pytest.mark.parametrize(("dialect", "divided"), [("marlin", True), ("klipper", False)])
def test_marlin_s_words_leave_the_mode_of_e(dialect: str, divided: bool) -> None:
    text = "G90\nM83\nG29\nT0\nG92 E0\nG1 X10 E1 F900\n"
    program = read_program(text.encode(), "a.gcode", language=find_dialect(dialect).language)
    assert bool(filament_of(program)) == divided


@pytest.mark.parametrize(
    ("first", "step", "head", "certain"),
    [
        (100.0, 0.3, "", True),
        (100.0, 0.3, "M83\n", True),  # as it says
        (0.0, 0.3, "", False),  # as steps 30 beads of 10 mm would have 5 mm of filament each
        (100.0, 0.0, "", False),  # nothing, or 100 mm for 10 mm
        (100.0, -0.3, "", False),
    ],
    ids=["spool", "named", "short", "constant", "back"],
)
def test_e_words_that_as_steps_would_push_out_a_spool_are_places(
    first: float, step: float, head: str, certain: bool
) -> None:
    beads = "".join(f"G1 X{n % 2 * 10} Y{n * 0.4:.1f} E{first + n * step:.2f} F900\n" for n in range(30))
    text = f"G90\n{head}G92 E{first}\n{beads}G91\nG1 X1 E-2\nG90\nG1 X20 E{first + 31 * step}\n"
    program = read_program(text.encode(), "a.gcode", language=find_dialect("marlin").language)
    found = filament_of(program)
    bead = program.text(12).decode()
    assert (12 in found) == certain
    if certain:
        steps = "M83" in head
        number = float(bead.partition("E")[2].split()[0])
        half = 0.5 * number if steps else number - 0.5 * step
        assert float(with_filament(program, 12, bead, 0.0, 0.5).partition("E")[2].split()[0]) == pytest.approx(half)


def started(words: list[str]) -> str:
    """A print behind a macro, in lines of 10 mm, and so near to X 100 that as steps they leave any machine."""
    lines = [f"G1 X{100 + n % 2 * 10} Y100 E{word}\n" for n, word in enumerate(words)]
    return "G90\nM83\nSTART_PRINT\nG1 F900\nG92 E0\n" + "".join(lines)


@pytest.mark.parametrize(
    ("words", "half"),
    [
        ([f"{0.3 + n % 7 * 0.02:.2f}" for n in range(400)], 0.15),  # steps
        (["0.30"] * 400, 0.15),
        ([f"{0.3 * (n + 1):.2f}" for n in range(400)], 0.15),  # places: as steps 24 m of filament for 4 m
        (["0.30"] * 15, None),  # too few lines to leave any machine
        ([f"{0.3 * (n + 1) - n % 3 * 0.4:.2f}" for n in range(400)], None),  # drawn back, on the way, every third time
        (["0"] * 400, None),
    ],
    ids=["steps", "even steps", "places", "few", "wiped", "nothing"],
)
def test_what_e_words_are_behind_a_macro_is_what_they_show(words: list[str], half: float | None) -> None:
    program = read_program(started(words).encode(), "a.gcode", language=find_dialect("klipper").language)
    found = filament_of(program)
    first = 5
    if half is None:
        assert not found
        return
    assert sorted(found) == list(range(first, first + len(words)))
    assert found[first].word(0.0, 0.5) == f"E{half}"
    relative = words[1] != "0.60"
    assert {one.relative for one in found.values()} == {relative}


def test_ways_through_the_air_may_name_the_place_of_the_filament() -> None:
    """As KISSlicer writes them; the program names neither M82 nor M83."""
    beads = "".join(f"G1 X0 Y{n} E{100 + n} F6000\nG1 X9 Y{n} E{101 + n} F900\n" for n in range(30))
    program = read_program(f"G90\n{beads}".encode(), "a.gcode", language=find_dialect("marlin").language)
    assert filament_of(program)[30].word(0.0, 0.5) == "E114.5"


def test_where_e_is_behind_words_that_are_not_understood_is_not_known() -> None:
    text = "G90\nM82\nG92 E0\nG1 X10 E1 F900\nT1\nG1 X0 Y0 F900\nG1 X10 E3\nG1 X0 E4\n"
    program = read_program(text.encode(), "a.gcode", language=find_dialect("marlin").language)
    assert sorted(filament_of(program)) == [3, 7]


@pytest.mark.parametrize(
    ("before", "words", "half"),
    [
        ("M83\nG1 X1 E9\rM82\rG92 E0\n", "E1", 0.5),  # a lone carriage return ends a line
        ("M82\nG1 X1 E9\nM117 E\rG92 E0\r", "E1", 0.5),
        ("M83\nM 82\nG 92 E0\n", "E1", 0.5),
        ("M82\nG92 E3\n", "E5", 4.0),
        ("M82\nG92 E5 E0\n", "E1", None),
        ("M82\nG1 X1 E5 E0\n", "E1", None),
        ("M83\n", "E1 E2", None),
        ("M83\n", "E1E-05", None),
        ("M83\n", "E1e-05", None),
        ("M83\nM106 S255 M82\n", "E1", None),
        ("M83\nG92 E0 M82\n", "E1", None),
        ("M83\nG1 X2 E1 M82\n", "E1", None),
        ("M83\nM106 S255 M82\nM83\n", "E1", 0.5),
        ("M83\nM600 ; M82\n", "E1", 0.5),
        ("M83\nM121\n", "E1", 0.5),
        ("M83\nM120\nM82\nM121\n", "E1", None),
    ],
    ids=range(16),
)
def test_what_a_line_extrudes_is_what_firmware_takes_or_is_not_divided(
    before: str, words: str, half: float | None
) -> None:
    text = f"G90\n{before}G1 X10 {words} F900\n"
    program = read_program(text.encode(), "a.gcode", language=find_dialect("marlin").language)
    found = filament_of(program)
    line = program.blocks - 1
    assert (line in found) == (half is not None)
    if half is not None:
        assert float(found[line].word(0.0, 0.5)[1:]) == pytest.approx(half)


@pytest.mark.parametrize("words", ["G92 E0\nM117 done 5\n", "G92 E0\nM203 E120\n", "M117 x\rG92 E0\r", "G 92 E0\n"])
def test_texts_and_limits_place_no_filament(words: str) -> None:
    """E of a text, of a limit and of a line behind a lone carriage return is what firmware takes it for."""
    arc = "G0 X40 Y20 F9000\nG3 X20 Y20 I-10 J0 E1.5 F1800\nG3 X40 Y20 I10 J0 E3\n"
    text = f"G21\nG90\nM82\nG92 E0\nG0 X40 Y20 Z0.2 F9000\n{6 * (words + arc)}"
    changed = made(text, stepper(dialect="marlin"))
    assert changed.count("crossing") > 12
    plain = re.sub("G 92", "G92", changed)
    assert laid(plain, relative=False)[-1][1] == pytest.approx(18.0, abs=1e-9)
    # Nothing goes back in between.
    amounts = [amount for _, amount in laid(plain, relative=False)]
    assert amounts == sorted(amounts)


@pytest.mark.parametrize("dialect", ["marlin", "klipper"])
@pytest.mark.parametrize("every", [1, 2])
def test_a_bead_under_g0_is_one_as_under_g1(every: int, dialect: str) -> None:
    """It was taken for a way through the air, in which an axis may be anywhere: a wall was 83 µm off in place of 58."""
    beads = [n for n, line in enumerate(printed(BOX, relative=True).splitlines()) if re.match("G1 X.*E", line)]
    lines = printed([*BOX, *BOX[1:], *BOX[1:]], relative=True).splitlines()
    fast = [line.replace("G1", "G0") if n >= beads[0] and n % every == 0 else line for n, line in enumerate(lines)]
    found = [made("\n".join([*some, ""]), stepper(dialect=dialect)) for some in (lines, fast)]
    plain, other = ([line.replace("G0", "G1") for line in text.splitlines() if line[0] == "G"] for text in found)
    assert other == plain
    assert len(other) > len(lines)


def test_no_line_is_changed_where_klipper_reads_on_behind_a_carriage_return() -> None:
    text = printed(RING, relative=True)
    assert made(text, stepper(dialect="klipper")) != text
    for lone in ("M83\rG92 E0\n", "; a\rG91\n"):
        other = text.replace("M83\nG92 E0\n", lone)
        assert other != text
        assert made(other, stepper(dialect="klipper")) == other


def test_what_works_where() -> None:
    text = "G21 G90\nM3 S0\nG0 X1\nG1 X2 S5 F900\nG0 X3\nG1 X4\nM5\nG1 X5\nM4 S5\nG1 X6\nM2\n"
    program = read_program(text.encode(), "a.ngc")
    assert tool_in_words(program) == ("laser", 3)
    found = working_motions(program, None)
    assert found.on.tolist() == [False, True, False, True, False, True]
    assert found.burns.tolist() == [False, True, True, True, False, False]
    assert found.follows.tolist() == [False, False, False, False, False, True]
    assert working_motions(program, "plasma").on.tolist() == [False, True, True, True, False, True]
    assert working_motions(program, "cutter").on.tolist() == [False, True, False, True, True, True]


def test_a_move_with_no_filament_is_none_of_an_extruder() -> None:
    text = "G21\nG91\nG1 X9 E1.5 F300\nG1 X-9 Y1 E0\nG1 X9 E.05\nG1 X-9 Y1 E0.000\nG1 X9 E-0.1\nG1 X1 E10\n"
    found = working_motions(read_as("marlin", text.encode(), "a.gcode"), None)
    assert found.tool == "extruder"
    assert found.on.tolist() == [True, False, True, False, True, True]


@pytest.mark.parametrize(
    "text",
    [
        "M3 S9000\nG0 X0 Y0 Z5\nG1 Z-1 F100\nG1 X9 S8000\nM2\n",
        "T1 M6\nM3 S9000\nG1 X9 F100\nM5\nM3\nG1 X0\nM2\n",
        "M6\nM3 S9000\nG1 X9 F100\nM5\nM3\nG1 X0\nM2\n",
        "S9000 M3\nG1 X9 F100\nM5\nM2\n",
        "M3 (pen down)\nG1 X9 F100\nM5 (pen up)\nG0 X0\nM3 (pen down)\nG1 Y9\nM5\nM2\n",
        "M5 S30 ; lift the Pen\nG0 X1\nM3 S90 ; down\nG1 X9 F100\nM3\nG1 X0\nM2\n",
        "M5\nG0 X1\nM3 S90\nG4 P0.2\nG1 X9 F100\nM5\nG4 P0.2\nG0 X0\nM3 S90\nG4 P0.2\nG1 Y9\nM5\nM2\n",
        "M3 S45\nG4 P0.3\nG0 X1\nM3 S72\nG4 P0.3\nG1 X9 F100\nM3 S45 G4 P0.3\nG0 X0\nM3 S72\nG4 P.3\nG1 Y9\nM2\n",
    ],
)
def test_a_mill_or_a_pen_is_not_taken_for_a_laser(text: str) -> None:
    assert tool_in_words(read_program(("G21 G90\n" + text).encode(), "a.ngc")) is None


def test_a_laser_beside_a_comment_on_something_else_is_one() -> None:
    text = "G21 G90\n(open)\nM3 (expensive)\nG1 X9 F100\nM5\nG0 X0\nM3\nG1 Y9\nM2 (no pen)\n"
    assert tool_in_words(read_program(text.encode(), "a.ngc")) == ("laser", 2)


@pytest.mark.parametrize(
    "lines",
    [
        ("M3 S90\nG4 P0.2", "M5"),  # it burns a hole to begin with
        ("G4 P0.2\nM3 S90", "G4 P0.2\nM5"),
        ("M3 S90", "M5\nG4 P0.2"),
        ("M3 S90\nG4 P0.001", "M5\nG4 P0.001"),
        ("M3 S90", "M3 S90"),
    ],
)
def test_a_beam_for_which_nothing_waits_each_time_is_a_laser(lines: tuple[str, str]) -> None:
    on, off = lines
    text = f"G21 G90\nM5\nG0 X1\n{on}\nG1 X9 F100\n{off}\nG0 X0\n{on}\nG1 Y9\n{off}\nG0 X5\nM2\n"
    assert tool_in_words(read_program(text.encode(), "a.ngc"))[0] == "laser"


@pytest.mark.parametrize(("wait", "tool"), [("G4 P0.2\n", None), ("", "pen")], ids=["by its waits", "by the file"])
@pytest.mark.parametrize("levels", [("M3 S90", "M5"), ("M3 S72", "M3 S45")])
def test_a_pen_that_a_servo_lets_down_crosses_in_sharp_corners(
    levels: tuple[str, str], wait: str, tool: str | None
) -> None:
    """A laser would burn dots there: its crossings come before and behind the corners, and leave 2 µm rms."""
    down, up = (f"{one}\n{wait}" for one in levels)
    shape = "G1 X11 Y10.4 F3000\nX10.1 Y10.8\nX11.2 Y11.4\nX10.2 Y11.6\nX10 Y10\n"
    text = f"G21 G90\n{up}G0 X10 Y10\n{down}{shape}{up}G0 X40 Y10\n{down}{shape}{up}G0 X0 Y0\nM2\n"
    path, left = interpret(text, BEGINS[0]), []
    for one in (text, made(text, stepper(tool))):
        orders = [levels.index(line) if line in levels else None for line in one.split("\n")]
        drawing = [order == 0 for order in itertools.accumulate(orders, lambda old, new: old if new is None else new)]
        moves = interpret(one, BEGINS[0])
        motion = run(moves)
        drawn = np.array([drawing[move.line - 1] for move in moves])[motion.owner]
        away = [distance(table[drawn], path) for table in tables(motion.motor, GAPS, (0, 0, 0))]
        left.append(max(math.sqrt(float((one**2).mean())) for one in away))
    assert left[0] > 0.02
    assert left[1] < 1e-6


@pytest.mark.parametrize(("mode", "feed"), [("G94", "F900000"), ("G93", "F90000")])
def test_a_feed_beyond_all_machines_is_what_they_make_of_it(mode: str, feed: str) -> None:
    """A plotter's program asks for 15 m/s and more, of which its axes make 40 mm/s: the table follows all the same."""
    turns = "".join(f"G1 X{12 + 9 * (k % 2)} Y{10 + 7 * k + 4 * (k % 3)} {feed}\n" for k in range(12))
    text = f"G21 G90 {mode}\nG0 X10 Y10\nM3 (pen down)\n{turns}G2 I5 J2 {feed}\nM5 (pen up)\nM2\n"
    path, left = interpret(text, BEGINS[0]), []
    for one in (text, made(text, stepper())):
        moves, down = interpret(one, BEGINS[0]), one[: one.index("M3")].count("\n")
        motion = run(moves)
        cuts = np.array([move.mode > 0 and move.line > down for move in moves])[motion.owner]
        away = [distance(table[cuts], path) for table in tables(motion.motor, GAPS, (0, 0, 0))]
        left.append(max(math.sqrt(float((one**2).mean())) for one in away))
    assert left[1] <= 0.2 * left[0]


LIGHTBURN = """; LightBurn 1.4.00
G00 G17 G40 G21 G54
G90
{mode}
M8
G0 X10Y10
G1 X50S850F1500
G1 Y40
G1 X10
G1 Y10
G0 X80Y25
G3 X80 Y25 I-10 J0
M9
G1S0
M5
G90
G0X0Y0
M2
"""
"""As LightBurn writes it: S stays on in rapids, which are dark in laser mode."""


@pytest.mark.parametrize("mode", ["M3", "M4"])
def test_axes_come_to_their_sides_in_rapids_where_s_stays_on(mode: str) -> None:
    text = LIGHTBURN.format(mode=mode)
    changed = made(text, stepper())
    assert error(text, changed)[0] < 0.003
    assert error(text, changed)[1] < error(text, text)[1] / 20.0
    assert dwells_while_lit(changed) == []
    for one in lit(changed):
        way = one.move.end - one.move.start
        assert np.linalg.norm(way) > 0.1
        assert one.move.feed > 0.997 * 1500.0


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("\nG0X10.03\n", "\n"),
        ("\nG0X10.03\n", "\nG0X10.02\n"),
        ("\nG0X10.03\n", "\nG0X10.03\nG0X10.04\n"),
        ("\nG0Y10.04\n", "\nG0Y10.04X10.1\n"),
        ("\nG0Y10.04\n", "\nG1Y10.04F240\nG0Y10.04\n"),
        ("\nG0X79.97\n", "\n"),
        ("\nG0X79.97\n", "\nG0X79.91\n"),
        ("G0 X9.91Y9.88", "G0 X10.03Y9.88"),
    ],
)
def test_damage_to_such_rapids_is_seen(old: str, new: str) -> None:
    machine = stepper()
    found = compensated(LIGHTBURN.format(mode="M4"), machine)
    text = found.text.decode()
    assert old in text
    after = read_program(text.replace(old, new, 1).encode(), "damaged")
    assert not verify(found.program, after, tolerance=5e-6, machine=machine).ok


@pytest.mark.parametrize(
    ("text", "machine"),
    [
        (laser(SQUARE, "M4"), stepper()),
        (TORCH.format(cut=SQUARE.replace(" S800", "")), stepper("plasma")),
        (printed(BOX, relative=True), stepper(dialect="klipper")),
    ],
    ids=["laser", "plasma", "extruder"],
)
def test_nothing_speaks_of_cutters_where_none_cuts(text: str, machine: Machine) -> None:
    found = compensated(text, machine)
    said = " ".join((*found.edits.warnings, found.text.decode())).lower()
    assert "friction" in said
    for word in ("climb", "cutter", "mill", "plunge", "against the cut"):
        assert word not in said


def test_where_a_stop_burns_a_coarser_crossing_has_to_do() -> None:
    """A facet turns by 19 degrees at 58 mm/s: what a crossing leaves there is no reason to leave all behind it."""
    cut = "G1 X12.5 Y9 S800 F3500\nG1 X12.4 Y9.6\nG1 X12.5 Y10.2\nG1 X12.8 Y10.7\nG1 X14 Y20\n"
    text = laser(cut, "M3").replace("G0 X10 Y10", "G0 X20 Y5")
    found = compensated(text, stepper())
    assert not any("would burn" in said for said in found.edits.warnings)
    path = [move for move in interpret(text, BEGINS[0]) if move.mode]
    errors = []
    for one in (text, found.text.decode()):
        done = run(interpret(one, BEGINS[0]))
        cuts = np.isin(done.owner, [n for n, move in enumerate(interpret(one, BEGINS[0])) if move.mode])
        off = [distance(table[cuts], path) for table in tables(done.motor, GAPS, (0, 0, 0))]
        errors.append(max(float(np.sqrt((one * one).mean())) for one in off))
    assert 5.0 * errors[1] < errors[0], errors


def test_the_last_rapid_takes_the_offsets_back_though_only_z_moves_in_it() -> None:
    """Rapids that name all axes, as robots' post-processors write them: a stop behind the last would burn in M3."""
    text = (
        "G21 G40 G80 G90\nG64 P0.01\nS2000\nG0 X50 Y-25 Z55\nG0 X50 Y-25 Z50\nM3\n"
        "G1 X50 Y25 Z50 F2000\nG1 X75 Y25 Z50\nG1 X75 Y-25 Z50\nG1 X50 Y-25 Z50\nM5\nG0 X50 Y-25 Z55\n"
        "G0 X50 Y0 Z55\nG0 X50 Y0 Z50\nM3\nG2 X75 Y0 Z50 I12.5 J0\nG2 X50 Y0 Z50 I-12.5 J0\nG0 X50 Y0 Z55\nM30\n"
    )
    found = judge(Entry("cut", Path("cut.ngc"), "linuxcnc", text))
    assert found.compensated == found.reversals > 5
    assert found.followed == found.shown > 5
    assert found.rms is not None
    assert found.rms[1] < 0.05 * found.rms[0]
