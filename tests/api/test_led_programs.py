"""Programs with the lead of the servos, played by the tests' own hand on the tests' own axes of two masses."""

from __future__ import annotations

import re
from itertools import pairwise, product

import numpy as np
import pytest
from msgspec.structs import replace
from support.played import play_program
from support.streams import without_progress
from support.two_masses import body_of, table_of

import ph_post as ph
from ph_post.api import led_programs
from ph_post.api.compensated_program import ProgramRequest
from ph_post.api.lead_work import LeadWork
from ph_post.api.led_programs import overridden
from ph_post.cli.main import main
from ph_post.compensate.options import PlanOptions
from ph_post.compensate.plan import make_plan
from ph_post.dialects.declaration import read_declaration
from ph_post.dialects.registry import find_dialect
from ph_post.drive.machinefile import read_machine
from ph_post.edit.edits import EditOptions
from ph_post.edit.lead_edits import chord_ends, why_not_led
from ph_post.edit.undo import undo
from ph_post.gcode.read import read_program
from ph_post.progress import no_progress
from ph_post.verify.verify import verify

RADIUS = 0.02
CIRCLE = """G21 G90 G91.1 G17 G94 G61
G0 X20 Y0
(the cut)
G64 P0.001
G3 X20 Y0 I-20 J0 F1200
G61
G0 X40
M2
"""
PERIOD = 1e-3
LED = {"strategy": "none", "lead_program": True, "max_slowdown": 0.1}


@pytest.fixture(scope="module")
def led():
    """The circle for the mill, with the lead alone."""
    return ph.compensate(read_program(CIRCLE.encode(), "circle.ngc"), read_machine("mill"), **LED)


def errors(text: str, factor: float = 1.0) -> np.ndarray:
    """Distance from the circle at a feed override [m], for sides and rules, behind the first tenth of a turn."""
    machine, found = read_machine("mill"), []
    words = re.sub(r"F([0-9.]+)", lambda match: f"F{float(match[1]) * factor:.6f}", text)
    played = play_program(words, "XY", PERIOD, np.array([RADIUS, 0.0]))
    for sides, rule in product(((1, 1), (-1, 1)), ("standstill", "contact")):
        table = np.stack(
            [
                table_of(body_of(machine.axes[name], rule), column, PERIOD, side, float(column[0]))
                for name, column, side in zip("XY", played.position.T, sides, strict=True)
            ],
            axis=1,
        )
        behind = np.cumsum(played.cut) > 0.1 * played.cut.sum()
        found.append(np.abs(np.hypot(*table[played.cut & behind].T) - RADIUS))
    return np.max(found, axis=0)


@pytest.mark.slow
def test_the_lead_takes_the_lag_out_of_a_circle(led):
    plain, after = errors(CIRCLE), errors(led.program().decode())
    assert plain.max() > 35e-6
    # What is left is backlash, which the lead alone does not cross, and the steps of speed between chords.
    assert after.max() < 0.4 * plain.max()
    assert np.sqrt((after**2).mean()) < 0.12 * np.sqrt((plain**2).mean())


def test_cubics_are_led_as_arcs_are_and_turns_are_left():
    """The same circle of four G5, which leave it by 5.5 µm at most."""
    k = 20.0 * 4.0 / 3.0 * (np.sqrt(2.0) - 1.0)
    corners = [(20.0, 0.0), (0.0, 20.0), (-20.0, 0.0), (0.0, -20.0), (20.0, 0.0)]
    lines = []
    for (x, y), (u, v) in pairwise(corners):
        handles = f"I{-k * y / 20:.6f} J{k * x / 20:.6f} P{k * v / 20:.6f} Q{-k * u / 20:.6f}"
        lines.append(f"G5 {handles} X{u:g} Y{v:g} F1200")
    text = CIRCLE.replace("G3 X20 Y0 I-20 J0 F1200", "\n".join(lines))
    led = ph.compensate(read_program(text.encode(), "circle.ngc"), read_machine("mill"), **LED)
    after = led.program().decode()
    assert read_declaration(after.encode()).led == 1
    assert not re.search(r"^G5", after, re.MULTILINE)
    assert errors(after).max() < 0.4 * errors(CIRCLE).max() + 5.5e-6
    assert ph.undo(read_program(after.encode(), "circle.ngc")) == text.encode()
    twice = CIRCLE.replace("J0 F1200", "J0 P2 F1200")
    assert why_not_led(read_program(twice.encode(), "circle.ngc"), 1, 1) == "line 5 is more than a move"


def test_what_is_said_of_other_overrides_is_what_other_means_find(led):
    said = {one.override: one.after for one in led.edited.overrides}
    assert list(said) == [0.5, 1.0, 1.2]
    for factor in (0.5, 1.2):
        found = errors(led.program().decode(), factor)
        rms = float(np.sqrt((found**2).mean()))
        assert rms == pytest.approx(said[factor].rms, rel=0.25)
        assert rms > 2.5 * said[1.0].rms


def test_head_and_warning_say_that_it_holds_at_100_percent(led):
    words = "the lead holds at 100 percent feed override, largest/rms error at 50 percent"
    assert any(one.startswith(words) for one in led.warnings)
    assert any(one.startswith(words) for one in read_declaration(led.program()).notes)


def test_it_is_verified_and_undone_and_stays_as_it_is(led):
    original = read_program(CIRCLE.encode(), "circle.ngc")
    after = read_program(led.program(), "circle.ngc")
    assert ph.undo(after) == CIRCLE.encode()
    verdict = verify(original, after, tolerance=5e-6, machine=read_machine("mill"))
    assert verdict.ok
    assert verdict.checked["led"] == 1
    again = ph.compensate(after, read_machine("mill"), **LED)
    assert again.already_compensated
    assert again.program() == led.program()
    assert b"(the cut)" in led.program()


def damaged(led, change) -> str:
    """The first failure of the program after a change of its text."""
    text = change(led.program().decode())
    original = read_program(CIRCLE.encode(), "circle.ngc")
    verdict = verify(original, read_program(text.encode(), "c.ngc"), tolerance=5e-6, machine=read_machine("mill"))
    assert not verdict.ok
    return " ".join(one.what for one in verdict.failures)


def test_the_checker_sees_a_chord_that_leaves_the_path(led):
    chords = [line for line in led.program().decode().split("\n") if re.match(r"X\S+ Y\S+ F", line)]
    middle = chords[len(chords) // 2]
    out = re.sub(r"X(\S+)", lambda match: f"X{float(match[1]) + 1.5:.4f}", middle)
    assert "farther than declared" in damaged(led, lambda text: text.replace(middle, out))


def test_the_checker_sees_another_end(led):
    last = re.findall(r"\n[XY].* F[0-9.]+(?=\nG64)", led.program().decode())[0]
    assert "elsewhere" in damaged(led, lambda text: text.replace(last, f"\nX20.001{last[last.index(' F') :]}"))


def test_the_checker_sees_a_move_too_fast_for_an_axis(led):
    def faster(text: str) -> str:
        return re.sub(r"F1[12]\d\d\.\d+", "F60000", text, count=1)

    assert "faster than" in damaged(led, faster)


def test_the_checker_counts_what_is_led(led):
    assert "not as many" in damaged(led, lambda text: text.replace("1 stretches led", "2 stretches led"))


def test_chords_stay_within_their_tolerance():
    angle = np.linspace(0.0, 3.0, 700)
    rows = np.column_stack([0.005 * np.cos(angle), 0.005 * np.sin(angle)])
    ends = chord_ends(rows, 2, 40, 1e-6)
    assert ends[0] == 0
    assert ends[-1] == len(rows) - 1
    assert np.diff(ends).max() > 5
    for low, high in pairwise(ends):
        way = (rows[high] - rows[low]) / np.linalg.norm(rows[high] - rows[low])
        beside = rows[low : high + 1] - rows[low]
        assert np.abs(beside[:, 0] * way[1] - beside[:, 1] * way[0]).max() <= 1e-6


def test_an_override_scales_feeds_and_no_rapids():
    program = read_program(CIRCLE.encode(), "circle.ngc")
    slow = overridden(program, 0.5)
    assert slow.motions.feed[1] == pytest.approx(0.5 * program.motions.feed[1])
    assert (slow.motions.kind == program.motions.kind).all()


REFUSED = {
    "heidenhain": ("mill", "programs of heidenhain cannot take a lead: chords are written in words of RS274 alone"),
    "siemens": ("mill", "programs of siemens cannot take a lead: chords are written in words of RS274 alone"),
    "heidenhain-iso": ("mill", "programs of heidenhain-iso cannot take a lead: "),
    "grbl": ("stepper", "the machine file gives X and Y no lag that could be led; expected b and c of the axes"),
}


@pytest.mark.parametrize("dialect", REFUSED)
def test_a_lead_that_cannot_be_is_refused_in_one_line(dialect, capsys, tmp_path):
    machine, words = REFUSED[dialect]
    out = tmp_path / "out.ngc"
    assert main(["convert", "circle", "-m", machine, "--dialect", dialect, "--lead-program", "-o", str(out)]) == 2
    said = without_progress(capsys.readouterr().err)
    assert said.startswith(f"ph-post: --lead-program: {words}")
    assert said.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize("other", ["--feed-only", "--no-inverse-dynamics"])
def test_a_lead_and_none_is_refused(other, capsys, tmp_path):
    out = tmp_path / "out.ngc"
    assert main(["convert", "circle", "-m", "mill", "--lead-program", other, "-o", str(out)]) == 2
    said = without_progress(capsys.readouterr().err)
    assert said.startswith(f"ph-post: --lead-program writes the lead, and {other} leaves it out")


def test_a_line_that_is_no_move_keeps_its_cut_without_a_lead():
    text = CIRCLE.replace("G3 X20 Y0 I-20 J0 F1200\n", "G3 X-20 Y0 I-20 J0 F1200\nM8\nG3 X20 Y0 I20 J0\n")
    found = ph.compensate(read_program(text.encode(), "circle.ngc"), replace(read_machine("mill")), **LED)
    assert found.unchanged
    assert any("is no move" in one for one in found.warnings)


SQUARE = """G21 G90 G17 G94 G64 P0.002
G0 X0 Y0
G1 X20 F900
Y20
G2 X0 Y0 I-10 J-10
M2
"""


@pytest.mark.parametrize(("machine", "led"), [("mill", True), ("router", False)])
@pytest.mark.thinned(4)
def test_the_best_of_lead_and_backlash_is_written(machine: str, led: bool) -> None:
    program = read_program(SQUARE.encode(), "square.ngc")
    found = ph.compensate(program, machine, lead_program=True, effort=0.02)
    assert ("stretches led" in found.program().decode()) is led
    assert any("no lead is written" in one for one in found.warnings) is not led
    assert found.after.error.max < 0.5 * found.before.error.max
    assert found.after.error.rms < 0.2 * found.before.error.rms
    again = ph.compensate(read_program(found.program(), "square.ngc"), machine, lead_program=True, effort=0.02)
    assert again.program() == found.program()
    assert ph.undo(read_program(found.program(), "square.ngc")) == SQUARE.encode()


def test_a_stretch_that_leads_nothing_is_not_said_to_lead(monkeypatch, tmp_path, capsys):
    """The plan of a table may leave lag and friction, and do nothing but cross backlash."""
    program, router = read_program(CIRCLE.encode(), "circle.ngc"), read_machine("router")

    def planned(analysis, options, progress):
        return make_plan(analysis, replace(options, inverse_dynamics=False), progress)

    monkeypatch.setattr(led_programs, "make_plan", planned)
    request = ProgramRequest(
        plan=PlanOptions(strategy="fly", max_slowdown=0.3), edit=EditOptions(max_slowdown=0.3), lead=True
    )
    found = LeadWork(program, router, find_dialect(router.dialect), request, no_progress).made(None)
    assert found.declaration.led == 1
    assert any(
        one.startswith("the chords without a lead hold at 100 percent feed override, ") for one in found.warnings
    )
    assert any(one.startswith("line 5: neither lag nor friction is led") for one in found.warnings)
    assert not any("the lead holds" in one for one in found.warnings)
    assert "(ph-post: note the chords without a lead hold at 100 percent" in found.after.data.decode()
    # The command's own words, of the program that it finds made already as of the one that it makes.
    monkeypatch.setattr("ph_post.api.program_compensation.compensate_program", lambda *_: found)
    (tmp_path / "circle.ngc").write_bytes(CIRCLE.encode())
    assert main(["convert", str(tmp_path / "circle.ngc"), "-m", "router", "-o", str(tmp_path / "led.ngc")]) == 0
    said = capsys.readouterr().err
    assert "chords without a lead, which cross backlash, written into 1 stretch" in said
    assert "lead of the servos" not in said
    assert "error with lag" not in said


@pytest.mark.slow
@pytest.mark.parametrize(("before", "led"), [("G1 X10 Y0 F300", True), ("G91\nG0 X0 Y0\nG1 Z-1 F300", False)])
def test_no_place_is_written_for_an_axis_whose_place_nobody_knows(before: str, led: bool) -> None:
    """What does not move Z needs none; where an increment moves it, the checker would refuse the whole program."""
    text = f"G21 G90 G17 G94 G64 P0.002\nG0 X10 Y0\n{before}\nG3 {'X10 Y0' if led else ''} I-10 J0 F1200\nM2\n"
    part = read_program(text.encode(), "circle")
    data = ph.compensate(part, "router", lead_program=True, effort=0.02, max_slowdown=0.2).program()
    assert (b" lead)" in data) == led
    assert before.encode() in data
    assert undo(data, "circle") == text.encode()
