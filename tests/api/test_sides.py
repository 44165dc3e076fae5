"""How far tables are to the left and right of a program's path, against one that the tests' own player drags along."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from support.reference_player import BEGINS, interpret, run, tables

import ph_post as ph

CHORDS = 2.2e-6
"""Grbl draws arcs in chords [m] that are inside them by 2 µm at most."""

TEXT = "G21 G90 G17\nG0 Z5\nG0 X20 Y0\nG1 Z-1 F300\nG{0} X20 Y0 I-20 J0 F1200\nG{0} X20 Y0 I-20 J0\nG0 Z5\nM2\n"


def reference(text: str) -> list[tuple[float, float]]:
    """Largest distance outside and inside the circle [m], of a table from each combination of sides."""
    moves = interpret(text, BEGINS[0])
    done = run(moves, 0.01)
    turning = np.array([move.mode >= 2 for move in moves])[done.owner]
    # X and Y of the stepper router lose 60 and 80 µm.
    off = [np.hypot(*one[turning, :2].T) - 20.0 for one in tables(done.motor, (0.06, 0.08, 0.0), (0, 0, 0))]
    return [(1e-3 * float(one.max()), 1e-3 * float(-one.min())) for one in off]


@pytest.mark.parametrize("code", [2, 3])
@pytest.mark.thinned(2)
def test_left_and_right_are_those_of_the_player(tmp_path: Path, code: int) -> None:
    file = tmp_path / "circle.nc"
    file.write_text(TEXT.format(code))
    for side in (None, "left", "right"):
        result = ph.compensate(file, "stepper", part_side=side)
        for motion, text in ((result.before, file.read_text()), (result.after, result.program().decode())):
            # They are those of the run to which the error belongs, whichever side that begins on.
            found = motion.sides if code == 2 else motion.sides[::-1]
            assert any(found == pytest.approx(one, abs=CHORDS) for one in reference(text))
            assert max(found) <= motion.error.max + 1e-9


def test_the_line_says_how_far_the_table_cuts_into_the_part(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from ph_post.cli.main import main

    file, out = tmp_path / "circle.nc", tmp_path / "out.nc"
    file.write_text(TEXT.format(2))
    assert main(["convert", str(file), "-m", "stepper", "-o", str(out), "--part-side", "left"]) == 0
    assert "; into the part 37 → <0.1 µm; " in capsys.readouterr().err.splitlines()[-1]
    assert "the part is on the left of the path" in out.read_text()
    with pytest.raises(ph.InputError, match=r"--part-side: unknown; expected left or right; got up"):
        ph.compensate(file, "stepper", part_side="up")
