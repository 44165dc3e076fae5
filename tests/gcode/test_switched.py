"""Lines with a slash, which run or not by a switch: what is known behind them holds in both readings."""

import random
import re

import numpy as np
import pytest
from support.reference_player import BEGINS, interpret

from ph_post.dialects.reading import read_as
from ph_post.gcode.program import PartProgram
from ph_post.gcode.read import read_program
from ph_post.units import MM

HEAD = "G21 G17 G90 G94 F600.\nG0 X0. Y0. Z5.\n"
WORDS = (
    *("G1 X4.", "G0 Y3.", "Y-2. Z1.", "G0", "X7.", "G1 Z-1. F100.", "M8", "S900 M3"),
    *("G28 Z0.", "G17", "G4 P2", "X3. Y4.", "M1"),
)


def places(program: PartProgram) -> dict[int, np.ndarray]:
    """Ends of the motions [mm] by line from 1, NaN where they are not known."""
    motions = program.motions
    return {int(block) + 1: end / MM for block, end in zip(motions.block, motions.end, strict=True)}


def check(program: PartProgram, *readings: str) -> int:
    """Check that each place that is known is the same in all readings, from any begin; return how many are."""
    known = 0
    for text in readings:
        for begin in BEGINS:
            at = {move.line: move.end for move in interpret(text, begin)}
            for line, end in places(program).items():
                named = ~np.isnan(end)
                known += int(named.sum())
                assert np.allclose(end[named], at[line][named], atol=1e-9), (line, text)
    return known


@pytest.mark.parametrize(
    ("body", "known"),
    [
        ("/M8\nX1.\n", [1.0, 0.0, 5.0]),
        ("/S900 M3\n/2 M5\nX1.\n", [1.0, 0.0, 5.0]),
        ("/G1 X9.\nG1 Y1.\n", [np.nan, 1.0, 5.0]),
        ("/X9. Y2.\nG1 Z1.\n", [np.nan, np.nan, 1.0]),
        ("/G28 G91 Z0.\nG90 G0 X1.\n", [1.0, 0.0, np.nan]),
        ("/G54\nG0 X1.\n", [1.0, np.nan, np.nan]),
        ("/T2 M6\nG0 X1.\n", [1.0, np.nan, np.nan]),
        ("/G28\nG0 X1.\n", [1.0, np.nan, np.nan]),
        ("/M55\nG0 X1.\n", [1.0, np.nan, np.nan]),
        ("/G92 X0.\nG0 Y1.\n", [np.nan, 1.0, np.nan]),
        ("/G53 G0 Z0.\nG0 Y1.\n", [np.nan, 1.0, np.nan]),
        ("/X#1\nG0 Y1.\n", [np.nan, 1.0, np.nan]),
        ("/U1.\nG0 Y1.\n", [np.nan, 1.0, np.nan]),
        ("G68 X0 Y0 R30.\n/X9.\nG69\nG0 Y1.\n", [np.nan, 1.0, np.nan]),
    ],
)
def test_axes_stay_where_both_readings_leave_them(body: str, known: list[float]) -> None:
    found = list(places(read_program((HEAD + body + "M30\n").encode(), "a.ngc")).values())
    assert np.array_equal(found[-1], known, equal_nan=True)


def test_a_call_with_a_slash_may_leave_any_mode() -> None:
    program = read_program((HEAD + "/M98 P1\nG1 X1.\nM30\n").encode(), "a.ngc")
    assert [note.what.partition(":")[0] for note in program.notes] == [
        "block delete",
        "motion under modes that something not understood may have changed",
    ]


@pytest.mark.parametrize("seed", range(60))
def test_what_is_known_holds_in_both_readings(seed: int) -> None:
    picked = random.Random(seed)
    lines = [("/" if picked.random() < 0.3 else "") + picked.choice(WORDS) for _ in range(25)]
    # One reading says the modes anew, so that the other's are known again.
    lines = [line for one in lines for line in (one, *(["G90 G1 F50."] if picked.random() < 0.3 else []))]
    text = HEAD + "\n".join(lines) + "\nM30\n"
    program = read_program(text.encode(), "a.ngc")
    check(program, re.sub(r"(?m)^/.*$", "", text), text.replace("/", ""))


@pytest.mark.parametrize("tail", ["/M8", "/ M08", "/2M9", "/M8 M1"])
def test_what_stands_before_a_slash_within_a_block_runs_in_any_case(tail: str) -> None:
    """B-64484EN, "Optional block skip"."""
    text = f"O1\n{HEAD}G1 X3. Z2.{tail}\nY4.\nG91 Z-1.{tail}\nX1.\nM30\n"
    program = read_as("fanuc", text.encode(), "a.nc")
    assert [note.what for note in program.notes] == [f"block delete: {tail.strip()}"] * 2
    assert check(program, re.sub(r"/.*", "", text), text.replace(tail, "")) > 20
    assert places(program)[7].tolist() == [4.0, 4.0, 1.0]


@pytest.mark.parametrize("tail", ["/M14", "/G1 Y9.", "/M98 P5"])
def test_of_what_else_stands_behind_it_nothing_is_known(tail: str) -> None:
    text = f"O1\n{HEAD}G0 X3. Z2.{tail}\nG90 G0 Y4.\nM30\n"
    program = read_as("fanuc", text.encode(), "a.nc")
    assert np.isnan(places(program)[5][0])
