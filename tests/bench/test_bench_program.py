"""Programs of many lines: read, searched, spliced and written, against LinuxCNC's own interpreter."""

from __future__ import annotations

import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import pytest
from support.corpus import stepper

from ph_post.dialects.registry import find_dialect
from ph_post.diff.compare import compare_programs
from ph_post.edit.edits import EditOptions
from ph_post.edit.offset_edits import plan_offsets
from ph_post.edit.write import apply_edits, declare
from ph_post.gcode.paths import paths_of
from ph_post.gcode.read import read_program
from ph_post.verify.verify import verify

RS274 = shutil.which("rs274")
LINES, MILLION = 200_000, 1_000_000
REPEATS = 3
"""Runs of which the fastest counts."""

PLAIN, JUDGED = 1.0, 5.0
"""So many times as long as rs274 takes, at most: to compensate, and with fitting and verify."""

MEMORY = 20.0
"""So many times as large as the file the memory may be."""

COMPARING = 20.0
"""So many times as long as reading both the comparison of two programs may take."""


def spline_program(lines: int, shift: float = 0.0) -> bytes:
    """Write a wave around a ring as short G1 moves, each with an F word: a reversal every few dozen lines."""
    t = np.linspace(0.0, 400.0 * math.pi * lines / LINES, lines)
    radius = 40.0 + 10.0 * np.sin(0.146 * t)
    columns = (60.0 + radius * np.cos(t) + shift, 60.0 + radius * np.sin(t), -5.0 * t / t[-1])
    rows = [
        f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f} F600" for x, y, z in zip(*(column.tolist() for column in columns), strict=True)
    ]
    return "\n".join(["G21 G90 G17 G94 G64 P0.01", "G0 X100 Y60 Z5", *rows, "M2", ""]).encode()


class Clock:
    """How long the stages of one run take [s], by a timer of Python's."""

    def __init__(self, timer: Callable[[], float] = time.perf_counter) -> None:
        self.stages: dict[str, float] = {}
        self._timer = timer
        self._begin = timer()

    def __call__(self, stage: str) -> None:
        now = self._timer()
        self.stages[stage] = now - self._begin
        self._begin = now

    def words(self) -> str:
        return ", ".join(f"{stage} {seconds:.2f} s" for stage, seconds in self.stages.items())


def compensate(data: bytes, judge: bool = False) -> tuple[bytes, Clock]:
    """Read, search, splice and write; with fitting and the judge on request."""
    clock, machine, dialect, options = Clock(), stepper(), find_dialect("linuxcnc"), EditOptions()
    program = read_program(data, "program")
    clock("read")
    if judge:
        paths_of(program)
        clock("fit")
    edits = plan_offsets(program, machine, dialect, options)
    clock("search")
    declaration = declare(program, edits, machine, dialect, options, options_digest="0" * 64)
    output = apply_edits(program, edits, dialect, declaration)
    clock("write")
    if judge:
        assert verify(program, read_program(output, "output"), tolerance=options.tolerance).ok
        clock("verify")
    return output, clock


def fastest(data: bytes, judge: bool) -> Clock:
    compensate(spline_program(2000), judge)
    clocks = [compensate(data, judge)[1] for _ in range(REPEATS)]
    return min(clocks, key=lambda clock: sum(clock.stages.values()))


def interpreted(data: bytes, folder) -> float:
    """Time of ``rs274 -g`` [s], the fastest of some runs."""
    file = folder / "program.ngc"
    file.write_bytes(data)
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        with (folder / "out").open("wb") as out:
            subprocess.run(
                [str(RS274), "-g", str(file)],
                stdout=out,
                stderr=subprocess.DEVNULL,
                check=True,
                env={**os.environ, "HOME": str(folder)},
            )
        times.append(time.perf_counter() - start)
    return min(times)


@pytest.mark.skipif(RS274 is None, reason="LinuxCNC's rs274 is not installed")
@pytest.mark.parametrize(("judge", "within"), [(False, PLAIN), (True, JUDGED)])
def test_a_long_program_against_rs274(tmp_path, judge, within):
    data = spline_program(LINES)
    theirs, ours = interpreted(data, tmp_path), fastest(data, judge)
    total = sum(ours.stages.values())
    sys.stdout.write(
        f"\n{LINES} lines, {len(data) / 1e6:.1f} MB: rs274 -g {theirs:.2f} s, ph-post {total:.2f} s "
        f"({ours.words()}): {total / theirs:.2f} times\n"
    )
    assert total <= within * theirs


def status(name: str) -> int:
    """One number of this process' status [bytes]."""
    rows = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
    return 1024 * next(int(row.split()[1]) for row in rows if row.startswith(name))


def peak_of(file: str, judge: bool) -> float:
    """Peak memory that compensating a program adds to this process, in which all is compiled [bytes]."""
    compensate(spline_program(2000), judge)
    data = Path(file).read_bytes()
    Path("/proc/self/clear_refs").write_text("5", encoding="ascii")
    before = status("VmRSS")
    compensate(data, judge)
    return status("VmHWM") - before


@pytest.mark.skipif(not Path("/proc/self/clear_refs").exists(), reason="only Linux tells a peak from here on")
@pytest.mark.parametrize(("lines", "judge"), [(LINES, False), (LINES, True), (MILLION, False)])
def test_memory_of_long_programs(tmp_path, lines, judge):
    file = tmp_path / "program.ngc"
    file.write_bytes(spline_program(lines))
    size = file.stat().st_size
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        added = pool.submit(peak_of, str(file), judge).result()
    sys.stdout.write(
        f"\n{lines} lines{' with fitting and verify' if judge else ''}: {added / 2**20:.0f} MiB for a file "
        f"of {size / 2**20:.1f} MiB: {added / size:.1f} times\n"
    )
    assert added <= MEMORY * size


@pytest.mark.parametrize("shift", [0.0, 0.025])
def test_comparing_long_programs(shift):
    first = spline_program(LINES)
    second = spline_program(LINES, shift).replace(b"Y60.0", b"Y60.1")
    compare_programs(*(read_program(spline_program(500, by), "p") for by in (0.0, 0.01)))
    start = time.perf_counter()
    programs = [read_program(data, "p") for data in (first, second)]
    reading = time.perf_counter() - start
    found = compare_programs(*programs)
    comparing = time.perf_counter() - start - reading
    sys.stdout.write(
        f"\ntwo programs of {LINES} lines: read in {reading:.2f} s, compared in {comparing:.2f} s, "
        f"{len(found.deviations)} stretches, {len(found.blocks)} groups of blocks\n"
    )
    assert not found.same
    assert comparing <= COMPARING * reading
