"""LinuxCNC's own interpreter as a reference: the canonical calls of ``rs274 -g``, beside the reader's."""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import tempfile
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest

from ph_post.gcode.program import ARC, CUBIC, LINE, NURBS, PLANE_AXES, RAPID, PartProgram

RS274 = shutil.which("rs274")
needs_rs274 = pytest.mark.skipif(RS274 is None, reason="LinuxCNC's rs274 is not installed")
CALL = re.compile(r"\s*\d+ N(\S+)\s+(\w+)\((.*)\)")
UNITS = {"CANON_UNITS_MM": 1e-3, "CANON_UNITS_INCHES": 0.0254}
PLANES = {"CANON_PLANE_XY": 17, "CANON_PLANE_XZ": 18, "CANON_PLANE_YZ": 19}
KINDS = {"STRAIGHT_TRAVERSE": RAPID, "STRAIGHT_FEED": LINE, "ARC_FEED": ARC, "NURBS_FEED": NURBS}
ELSEWHERE = re.compile(rb"(?i)g\s*(28|30|53|38\.\d)(?![\d.])")
"""Words whose motion is not told: home, machine coordinates, probing."""
ROUNDING = 0.6e-4
"""rs274 writes four decimals."""


@dataclass
class Call:
    """A motion as rs274 tells it: numbers in its units."""

    line: int
    kind: int
    numbers: list[float]
    units: float
    plane: int
    feed: float


@dataclass
class Canon:
    """What rs274 made of a program: its motions, and what it refused it for."""

    moves: list[Call] = field(default_factory=list)
    calls: list[tuple[int, str, str]] = field(default_factory=list)
    refusal: str = ""


def number_lines(text: str) -> str:
    """Give every line its number (from 0) as its N word, so that rs274 tells where a call comes from."""
    return "\n".join(
        f"N{number} {line}" if line and line[0] not in "%/;" else line for number, line in enumerate(text.split("\n"))
    )


def run_rs274(text: str) -> Canon:
    """Canonical calls of a program, by line where :func:`number_lines` numbered them."""
    done = _run(text)
    canon = Canon()
    errors = [line for line in done.stderr.splitlines() if line != "executing"]
    canon.refusal = "\n".join(errors)
    assert errors or done.returncode == 0, f"rs274 ended with {done.returncode}"
    units, plane, feed = 1e-3, 17, 0.0
    for match in map(CALL.match, done.stdout.splitlines()):
        if match is None:
            continue
        line = int(match[1]) if match[1].isdigit() else -1
        name, text = match[2], match[3]
        canon.calls.append((line, name, text))
        if name == "USE_LENGTH_UNITS":
            units = UNITS[text]
        elif name == "SELECT_PLANE":
            plane = PLANES[text]
        elif name == "SET_FEED_RATE":
            feed = float(text)
        elif name in KINDS:
            numbers = [float(n) for n in text.split(",")] if name != "NURBS_FEED" else []
            canon.moves.append(Call(line, KINDS[name], numbers, units, plane, feed))
    return canon


def _run(text: str) -> subprocess.CompletedProcess[str]:
    with tempfile.TemporaryDirectory() as folder:
        file, table = Path(folder, "program.ngc"), Path(folder, "tool.tbl")
        file.write_text(text, encoding="utf-8", newline="")
        table.write_text("".join(f"T{n} P{n} Z{n} D0\n" for n in range(1, 101)), encoding="utf-8")
        line = [str(RS274), "-t", str(table), "-g", str(file)]
        # It keeps its tools in a file in the home folder, which runs side by side would share.
        home = {**os.environ, "HOME": folder}
        return subprocess.run(line, capture_output=True, text=True, check=False, cwd=folder, env=home, timeout=60)


def assert_agrees(program: PartProgram, canon: Canon) -> None:
    """Every motion of the reader is rs274's, and rs274 has no other outside of what was passed through."""
    motions = program.motions
    passed = {block for note in program.notes for block in range(note.first, note.last + 1)}
    passed |= {block for block in range(program.blocks) if ELSEWHERE.search(program.text(block))}
    moves = [move for move in canon.moves if move.line not in passed and not _is_bare(program, move)]
    lines = [int(block) for block in motions.block]
    found = [move.line for move in moves]
    assert found == lines, f"rs274 moves on lines {found}, the reader on {lines}"
    for row, move in enumerate(moves):
        _assert_same(program, row, move)


def _is_bare(program: PartProgram, move: Call) -> bool:
    """Whether a G1 or G0 stands without axis words: rs274 calls that a motion of no length."""
    letters = {chr(program.words.letter[k]) for k in program.words_of(move.line)}
    return move.kind in (RAPID, LINE) and not letters & set("XYZ")


def _assert_same(program: PartProgram, row: int, move: Call) -> None:
    motions = program.motions
    kind = int(motions.kind[row])
    assert (NURBS if kind == CUBIC else kind) == move.kind, program.text(move.line)
    if kind in (CUBIC, NURBS):
        return
    end = np.array(move.numbers[:3])
    if kind == ARC:
        first, second, third = PLANE_AXES[move.plane]
        assert motions.plane[row] == move.plane
        end = np.empty(3)
        end[[first, second, third]] = [move.numbers[0], move.numbers[1], move.numbers[5]]
        _close(motions.center[row], np.array(move.numbers[2:4]) * move.units, move)
        sense = math.copysign(1.0, motions.angle[row])
        assert sense * math.ceil(abs(motions.angle[row]) / math.tau - 1e-9) == move.numbers[4]
    _close(motions.end[row], end * move.units, move)
    if kind != RAPID and motions.duration[row] == 0.0 and not math.isnan(motions.feed[row]):
        assert motions.feed[row] == pytest.approx(move.feed * move.units / 60.0, abs=1e-7, rel=1e-9)


def _close(found: np.ndarray, expected: np.ndarray, move: Call) -> None:
    known = ~np.isnan(found)
    np.testing.assert_allclose(found[known], expected[known], atol=ROUNDING * move.units, rtol=1e-12, err_msg=str(move))
