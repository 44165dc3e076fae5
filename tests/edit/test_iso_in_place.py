"""ISO programs of Heidenhain changed in place, against an interpreter and a play operator of the tests' own."""

from __future__ import annotations

import random
import re

import pytest
from support.in_place import ISO

from ph_post.edit.undo import undo
from ph_post.gcode.read import reread
from ph_post.verify.verify import verify


def contour(seed: int) -> str:
    """Return straight moves, half circles by centre and by radius, and rapids, most without a word of their mode."""
    rng = random.Random(seed)
    blocks, mode = ["T5 G17 S3000", "G00 G40 G90 X+0 Y+0 Z+5 M3", "G01 Z-1 F300"], "G01 "
    for k in range(12):
        x, y, wanted = rng.randint(-20, 20) * 1.5, 40.0 + 30 * k, rng.choice(["G01 ", "G01 ", "G02 ", "R", "G00 "])
        if wanted == "G00 ":
            blocks += ["G00 Z+5", f"X{x:+g} Y{y:+g}", "G01 Z-1", f"Y{y - 10:+g}", f"X{x + 8:+g} M8", f"X{x:+g} Y{y:+g}"]
            mode = "G01 "
            continue
        word = "" if wanted == mode and rng.random() < 0.7 else wanted
        if wanted == "G01 ":
            blocks += [f"{word}X{x:+g} F{rng.choice([600, 900])}", f"Y{y:+g}"]
        elif wanted == "G02 ":
            blocks += [f"G01 X{x:+g} Y{y - 12:+g}", f"I{x:+g} J{y - 6:+g}", f"G02 X{x:+g} Y{y:+g}"]
        else:
            blocks += [f"G01 X{x:+g} Y{y - 12:+g}", f"G03 X{x + 6:+g} Y{y - 6:+g} R+6", f"X{x:+g} Y{y:+g} R+6"]
            wanted = "G03 "
        mode = wanted
    blocks += ["G01 X+0", "G00 Z+5 M30"]
    lines = [f"N{10 * number} {block} *" for number, block in enumerate(blocks, 1)]
    return "\n".join(["%A G71 *", *lines, "N99999999 %A G71 *", ""])


@pytest.mark.parametrize("seed", range(4))
def test_random_contours_are_followed(seed: int) -> None:
    text = contour(seed)
    one = ISO.compensate(text.encode())
    found = one.text.decode()
    assert one.program.notes == ()
    assert len(one.edits.crossings) > 3
    for side in (-1.0, 1.0):
        assert ISO.away(found, ISO.run(text), side).max() < 0.0045
    assert ISO.run(found).functions == ISO.run(text).functions
    assert verify(one.program, reread(one.program, one.text), tolerance=5e-6, machine=ISO.machine).ok
    assert undo(one.text, "a.i") == text.encode()
    shape = re.compile(r"(?:N\d+ )?(?:G\d\d|[XYZIJRFMTS][-+.\d]+| )+\*|(?:N99999999 )?%A G71 \*|;.*")
    assert [line for line in found.splitlines() if not shape.fullmatch(line)] == []


def test_moves_by_the_mode_of_a_line_that_is_passed_through_keep_their_bytes() -> None:
    blocks = ["G01 X+0 Y+0 Z-1 F300", "X+9", "X+0", "G00 X+5 M99", "X+6", "X+2", "G01 X+7", "X+3", "N99999999 %A G71"]
    text = "".join(f"{block} *\n" for block in ["%A G71", *blocks])
    found = ISO.compensate(text.encode())
    assert "\nG00 X+5 M99 *\nX+6 *\nX+2 *\n" in found.text.decode()
    assert verify(found.program, reread(found.program, found.text), tolerance=5e-6, machine=ISO.machine).ok
