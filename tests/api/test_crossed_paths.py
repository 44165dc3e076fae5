"""Programs of paths that cross backlash on the fly, judged by a player of programs with equations of its own."""

from __future__ import annotations

import re

import numpy as np
import pytest
from msgspec.structs import replace
from support import reference_player as reference

import ph_post as ph
from ph_post.cli.main import main
from ph_post.files.storage import SourceBytes

MICROMETRE = 1e-6
REVERSALS = {"oval": (2, 2), "butterfly": (14, 17), "circle": (1, 2)}
"""Of X and Y, without those at which a path begins."""


@pytest.fixture(scope="module", params=["oval", "butterfly", "circle"])
def result(request):
    return ph.compensate(request.param, "stepper", max_slowdown=0.2)


def played(program: bytes, original: bytes, machine: ph.Machine) -> tuple[float, float]:
    """Largest distance [m] of the table from the original's cuts, and the one whose square is the mean over time.

    The motors follow at once, as those of this machine do. Moves count behind the approach: its lines are told by what
    marks them, and by the slow move onto the start.
    """
    lines = program.decode().split("\n")
    marks = [k for k, line in enumerate(lines, 1) if line.startswith("(ph-post: +") and "approach" in line]
    begins = marks[0] + int(lines[marks[0] - 1].split()[1]) + 1 if marks else 0
    moves, path = reference.interpret(program.decode()), reference.interpret(original.decode())
    begins = begins or next(move.line for move in moves if move.mode)
    motor = reference.run(moves)
    counts = np.bincount(motor.owner)
    time = np.array([move.length / max(move.feed, 1.0) for move in moves]) / counts
    cuts = np.array([move.mode > 0 and move.line > begins for move in moves])[motor.owner]
    weight = time[motor.owner][cuts] / time[motor.owner][cuts].sum()
    gaps = (*(1e3 * machine.axes[axis].gap.lost_motion for axis in "XY"), 0.0)  # Z is never moved
    found = []
    for table in reference.tables(motor.motor, gaps, (0, 0, 0)):
        away = reference.distance(table[cuts], [move for move in path if move.mode])
        found.append((away.max(), np.sqrt(weight @ away**2)))
    largest, rms = 1e-3 * np.array(found).max(axis=0)
    return float(largest), float(rms)


def undone(result) -> bytes:
    return ph.undo(SourceBytes(name="part.nc", stem="part", data=result.program()))


@pytest.mark.thinned(6)
def test_errors_before_and_after_are_those_of_a_reference_player(result):
    original = undone(result)
    # Grbl's chords leave an arc by 2 µm (its arc_tolerance), which the player's arcs do not.
    chords = 2.0 * MICROMETRE if b"G3" in original else 0.0
    for motion, program in ((result.before, original), (result.after, result.program())):
        largest, rms = played(program, original, result.machine)
        assert motion.error.max == pytest.approx(largest, rel=0.1, abs=MICROMETRE + chords)
        assert motion.error.rms == pytest.approx(rms, rel=0.1, abs=MICROMETRE + chords)
    assert result.after.error.max < 0.3 * result.before.error.max
    assert result.after.error.rms < 0.1 * result.before.error.rms


def test_the_time_is_kept_and_every_reversal_is_told(result, request):
    name = request.node.callspec.params["result"]
    assert result.after.time <= 1.205 * result.before.time
    rows = {row.axis: (row.compensated, row.all) for row in result.axis_reversals}
    assert rows == {axis: (count, count) for axis, count in zip("XY", REVERSALS[name], strict=True)}


def test_nothing_stops_and_undoing_gives_the_plain_program(result, request):
    name = request.node.callspec.params["result"]
    taken_back = result.program().index(b"X to 0")
    assert not re.search(rb"G4(?![0-9])", result.program()[:taken_back])
    plain = ph.compensate(name, "stepper", strategy="none")
    assert undone(result) == plain.program()


@pytest.mark.parametrize("strategy", ["fly", "takeup"])
def test_other_names_of_it_write_the_same_program(strategy):
    def lines(**how):
        text = ph.compensate("oval", "router", **how).program().decode()
        return [line for line in text.split("\n") if not line.startswith(("(ph-post: options", "(ph-post: undo"))]

    assert lines(strategy=strategy) == lines()


def test_it_is_what_the_plain_program_becomes_by_itself(tmp_path):
    plain = tmp_path / "oval of PH quintics"
    ph.compensate("oval", "router", strategy="none").write(plain)
    ph_result = ph.compensate("oval", "router")
    again = ph.compensate(ph.read_program(plain), "router")
    assert again.program() == ph_result.program()
    assert again.after.error == ph_result.after.error


@pytest.mark.slow
def test_a_loop_with_the_backlash_inside_beside_one_outside(tmp_path):
    mixed = ph.read_machine("router")
    # Made by hand, not read from a file.
    machine = replace(mixed, digest="", axes={**mixed.axes, "X": replace(ph.read_machine("mill").axes["X"], name="X")})
    result = ph.compensate("oval", machine, effort=0.05)
    assert result.after.error.max <= result.before.error.max * 1.01
    assert result.after.error.rms <= result.before.error.rms * 1.01
    assert result.after.time <= 1.105 * result.before.time
    plain, program = tmp_path / "plain.ngc", tmp_path / "crossed.ngc"
    plain.write_bytes(ph.compensate("oval", machine, strategy="none").program())
    program.write_bytes(result.program())
    assert ph.verify(plain, program, machine).ok


@pytest.mark.slow
def test_a_table_is_what_it_was(tmp_path, capsys):
    """With -o and --table each has its own way, and both lines of the result are there."""
    program, table = tmp_path / "oval.ngc", tmp_path / "oval.csv"
    assert main(["convert", "oval", "-m", "router", "-o", str(program), "--table", str(table), "--effort", "0.05"]) == 0
    said = capsys.readouterr().err
    alone = ph.compensate("oval", "router", output="table", effort=0.05)
    alone.write_table(tmp_path / "alone.csv")
    assert table.read_bytes() == (tmp_path / "alone.csv").read_bytes()
    assert len(re.findall(r"^(?:table|program): backlash error .* 4 of 4 reversals$", said, re.MULTILINE)) == 2
    assert "oval of PH quintics, program: compensated: X by ±0.060 mm, Y by ±0.040 mm" in said


def test_what_is_crossed_coarsely_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in part programs; here a thousandth of the error is taken for much."""
    monkeypatch.setattr("ph_post.edit.edits.LEFT", 1e-3)
    found = ph.compensate("oval", "stepper", max_slowdown=0.2)
    assert found.reversals.all == sum(REVERSALS["oval"])
    assert found.reversals.compensated < found.reversals.all
    assert "coarse, and leave more than a fifth" in found.not_compensated
