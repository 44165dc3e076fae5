"""Behind lines that are passed through nothing is measured until places and sides of the axes are known again."""

import json
import re

import numpy as np
import pytest
from msgspec.structs import replace
from support.corpus import stepper
from support.corpus_judge import Judged, compare

import ph_post as ph
from ph_post.api.compensation import compensated
from ph_post.api.options import CompensateOptions
from ph_post.cli.main import main
from ph_post.dialects.reading import read_as
from ph_post.drive.machinefile import read_machine
from ph_post.files.storage import SourceBytes
from ph_post.gcode.read import read_program
from ph_post.progress import no_progress
from ph_post.report.motion_page import motion_lines
from ph_post.simulate.controllers.deviation import program_error
from ph_post.simulate.controllers.run import run_program
from ph_post.simulate.controllers.unknown import known_ends, unknown_lines, unknown_motions
from ph_post.units import MM_PER_MIN

ROUTER = read_machine("router")
SQUARE = ["G0 X0 Y0", "G1 Z-1 F300", "G1 X20 F1200", "G1 Y20", "G1 X0", "G1 Y0", "G0 Z5"]
CYCLE = ["G98 G81 X5 Y5 Z-3 R2 F100", "X15", "X15 Y15", "G80"]
OFFSET = ["G41 D1", "G1 X30 Y0 F1200", "Y20", "X10", "Y0", "G40"]
LINES = ["G21 G90 G94 G64 P0.01", "G0 X0 Y0 Z5", *SQUARE, *CYCLE, *SQUARE, *OFFSET, *SQUARE, "M2", ""]
PROGRAM = read_program("\n".join(LINES).encode(), "cycles.ngc")
DIALECTS = ("linuxcnc", "grbl")


def line_of(motion):
    return int(PROGRAM.motions.block[motion]) + 1


def test_the_stretch_reaches_to_the_words_that_say_where_every_axis_is():
    """The cycle stands on lines 10 to 12; X and Y are known behind line 14, Z behind line 15; likewise below."""
    assert [line_of(k) for k in np.flatnonzero(unknown_motions(PROGRAM))] == [14, 15, 27, 28]
    assert unknown_lines(PROGRAM) == ((9, 14), (20, 27))


def test_a_tool_change_leaves_the_place_open_and_the_beginning_does_not():
    changed = read_program("\n".join(["G21 G90 G94 G54", *SQUARE, "M6 T2", *SQUARE, ""]).encode(), "changed")
    assert np.flatnonzero(unknown_motions(changed)).tolist() == [7, 8]


def test_a_program_that_is_understood_has_no_such_stretch():
    plain = read_program("\n".join(["G21 G90 G94", "G1 X5 F600", "X0", *SQUARE, "M0", *SQUARE, ""]).encode(), "plain")
    assert not unknown_motions(plain).any()
    assert unknown_lines(plain) == ()


@pytest.mark.parametrize("dialect", DIALECTS)
def test_no_axis_jumps_to_the_machine_origin(dialect):
    machine = replace(ROUTER, dialect=dialect)
    command = run_program(PROGRAM, machine)
    fastest = max(axis.limits.velocity for axis in machine.axes.values())
    steps = np.abs(np.diff(command.position, axis=0)).max()
    assert steps <= fastest * machine.servo_period * (1.0 + 1e-9)
    start, end = known_ends(PROGRAM)
    assert (start[1:] == end[:-1]).all()


@pytest.mark.parametrize("dialect", DIALECTS)
def test_no_number_is_given_until_every_axis_that_cuts_has_moved_through_its_backlash(dialect):
    machine = replace(ROUTER, dialect=dialect)
    found = program_error(run_program(PROGRAM, machine), machine, PROGRAM)
    lines = {line_of(k) for k in np.unique(found.motion[found.counted])}
    # Y stands on an unknown side along line 16, the first cut in X, and begins to move on line 17.
    assert lines >= {4, 5, 6, 7, 8, 17, 18, 19, 30, 31, 32}
    assert not lines & {14, 15, 16, 27, 28, 29}


def test_of_a_real_run_only_what_comes_before_the_first_stretch_counts():
    """A stand-in for a controller that runs the cycle, too: behind the first part it is anywhere."""
    command = run_program(PROGRAM, ROUTER)
    found = program_error(command, ROUTER, PROGRAM, recorded=True)
    lines = {line_of(k) for k in np.unique(found.motion[found.counted])}
    assert lines == {4, 5, 6, 7, 8}
    after = np.flatnonzero(found.counted)[-1] + 1000
    away = command.position.copy()
    away[after:, 0] += 0.02 * np.sin(np.linspace(0.0, 60.0, len(away) - after))
    moved = program_error(replace(command, position=away), ROUTER, PROGRAM, recorded=True)
    assert moved.error.max == pytest.approx(found.error.max, rel=1e-6)


def test_the_numbers_are_those_of_the_parts_that_are_understood():
    """The square cut alone, from both sides, has the errors that the same square has behind a cycle, no larger ones."""
    alone = read_program("\n".join(["G21 G90 G94 G64 P0.01", "G0 X0 Y0 Z5", *SQUARE, "M2", ""]).encode(), "alone")
    whole, part = (program_error(run_program(one, ROUTER), ROUTER, one) for one in (PROGRAM, alone))
    assert whole.error_worst.max <= part.error_worst.max * (1.0 + 1e-6)


@pytest.mark.slow
def test_the_page_draws_nothing_there_and_says_which_lines_these_are(tmp_path):
    (tmp_path / "cycles.ngc").write_text("\n".join(LINES))
    out = tmp_path / "page.html"
    plot = tmp_path / "plot.png"
    assert main(["report", str(tmp_path / "cycles.ngc"), "-m", "router", "-o", str(out), "--plot", str(plot)]) == 0
    page = out.read_text(encoding="utf-8")
    (text,) = re.findall(r"^const D = (.*);$", page, re.MULTILINE)
    data = json.loads(text)
    told = [note for note in data["notes"] if "not known" in note]
    assert told == ["lines 10 to 15: where the axes are is not known; nothing is drawn, and no number is given"]
    assert len(data["path"]["unknown"]) == 1
    # A machine that carries offsets has the contour shifted, which is what the page can draw.
    assert "lines 22 to 25: the contour is drawn; the tool goes beside it by its radius" in data["notes"]
    for run in data["runs"]:
        s = np.array(run["s"])
        hidden = np.zeros(s.size, dtype=bool)
        for low, high in data["path"]["unknown"]:
            hidden |= (s > low) & (s < high)
        assert hidden.any()
        assert all(run["feed"][k] is None for k in np.flatnonzero(hidden))
        assert not any(run["counted"][k] for k in np.flatnonzero(hidden))
        fastest = max(axis.limits.velocity for axis in ROUTER.axes.values()) / MM_PER_MIN
        assert max(one for one in run["feed"] if one is not None) <= fastest * (1.0 + 1e-6)


def test_the_lines_for_readers_without_scripts_say_it_too():
    from ph_post.report.traces import program_picture

    result = ph.compensate(PROGRAM, ROUTER)
    picture = program_picture(result.edited, ROUTER, "auto", result.places)
    said = motion_lines(picture)
    assert [sum(words in line for line in said) for words in ("nothing is drawn", "the contour is drawn")] == [1, 1]


def test_behind_a_line_that_led_elsewhere_the_way_is_not_known() -> None:
    blocks = ["L X+0 Y+0 Z+0 R0 F100", "L X+10", "FL PR+5 PA+30", "L X+0 Y+0 Z+0", "L X+5"]
    text = "\n".join(["BEGIN PGM A MM", *blocks, "END PGM A MM", ""])
    assert unknown_motions(read_as("heidenhain", text.encode(), "a.h")).tolist() == [False, False, True, False]


def without_z(cuts: int) -> str:
    """A laser's program: strokes that end where a way through the air passes them, and never a word of Z."""
    lines = ["G21 G90", "G1 F3000", "G1 X10.8 Y5.3", "M3 S100", "G4 P0.1", "G1 F200", "G1 X11.2 Y5.6", "M5 S0"]
    for x in (10.75 - 2.0 * k for k in range(cuts)):
        strokes = (
            [f"X{x:g} Y5.37", f"X{x:g} Y5.03"],
            [f"X{x - 1.03:g} Y5.37", f"X{x - 0.34:g} Y5.37", f"X{x:g} Y4.69"],
        )
        for begin, *stroke in strokes:
            lines += [
                "G1 F3000",
                f"G1 {begin}",
                "M3 S100",
                "G4 P0.1",
                "G1 F200",
                *(f"G1 {one}" for one in stroke),
                "M5 S0",
            ]
    return "\n".join([*lines, "M2", ""])


def test_a_place_is_kept_where_an_axis_is_never_named() -> None:
    """It was lost to the way through the air, and 610 µm were measured where the table is on its path."""
    text = without_z(4).encode()
    source = SourceBytes(name="a.nc", stem="a", data=text)
    made = compensated(source, stepper("grbl"), CompensateOptions(max_slowdown=0.5), "program", no_progress)
    assert all(row.compensated == row.all > 5 for row in made.axis_reversals)
    judged = compare(Judged("compensated", 1, 1), "grbl", text, made.program())
    assert judged.rms is not None
    assert judged.rms[0] > 0.01
    assert judged.rms[1] < 0.2 * judged.rms[0]  # it counts the way through the air, too
    assert made.after.error.max < 1e-9
