"""What a line of a program costs, as processor time: convert as a command, stage by stage, and in memory.

Each figure is that of many lines less that of few, by the difference of their numbers, so that starts do not count. The
programs run for longer than is simulated, and the short ones are not simulated either. docs/pipelines.md has the table,
with LinuxCNC's rs274 beside it, and ArcWelder, which is timed where it is on the PATH.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from bench.test_bench_program import Clock, spline_program
from support.corpus import stepper

from ph_post.dialects.registry import find_dialect
from ph_post.edit.edits import EditOptions
from ph_post.edit.offset_edits import plan_offsets
from ph_post.edit.write import apply_edits, declare
from ph_post.gcode.read import read_program
from ph_post.verify.verify import verify

RS274 = shutil.which("rs274")
ARC_WELDER = shutil.which("ArcWelder")
MANY, FEW = 200_000, 16
REPEATS = 2
"""Runs of which the least counts."""

MOST = {"these without verifying": 1.0, "all of these": 1.5, "`ph-post convert`": 4.0}
"""So many times as long as in rs274 takes a line at most that has a word for each axis and F."""

MEMORY = 10.0
"""So many bytes a byte of such a program may take beside what the command takes for few lines."""


class Cost(NamedTuple):
    """Processor time of a process with its threads [s], and its largest memory [bytes]."""

    time: float
    memory: float


ASKED = """
import sys
from ph_post.cli.main import main
try:
    main(sys.argv[1:])
finally:
    print(open("/proc/self/status", encoding="ascii").read(), file=sys.stderr)
"""
"""A process says itself what it took at most: its parent's memory counts as its own to whoever waits for it."""


def run(folder: Path, *command: str) -> Cost:
    times, peaks = [], [math.inf]
    for _ in range(REPEATS):
        with (folder / "out").open("wb") as out, (folder / "said").open("wb") as said:
            home = {**os.environ, "HOME": str(folder)}
            process = subprocess.Popen(command, stdout=out, stderr=said, env=home)
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        text = (folder / "said").read_text(errors="replace")
        assert process.returncode == 0, text
        times.append(used.ru_utime + used.ru_stime)
        peaks += [1024.0 * int(peak) for peak in re.findall(r"VmHWM:\s*(\d+)", text)]
    return Cost(min(times), min(peaks))


def stages(data: bytes) -> dict[str, float]:
    """Processor time of each stage [s]."""
    machine, dialect, options = stepper(), find_dialect("grbl"), EditOptions()
    stage = Clock(time.process_time)
    program = read_program(data, "program")
    stage("reading")
    edits = plan_offsets(program, machine, dialect, options)
    stage("choosing and planning")
    declaration = declare(program, edits, machine, dialect, options, options_digest="0" * 64)
    output = apply_edits(program, edits, dialect, declaration)
    stage("writing")
    assert verify(program, read_program(output, "output"), tolerance=options.tolerance).ok
    stage("verifying")
    return stage.stages


def spirals(lines: int) -> bytes:
    """Write a spiral of short G1 moves with X and Y alone: a reversal every 157 lines."""
    t = 0.01 * np.arange(lines)
    radius = 20.0 + 10.0 * np.sin(0.013 * t)
    rows = zip((radius * np.cos(t)).tolist(), (radius * np.sin(t)).tolist(), strict=True)
    text = "\n".join(f"G1 X{x:.4f} Y{y:.4f}" for x, y in rows)
    return f"G21 G90 G17 G94\nG0 X20 Y0 Z5\nG1 Z-1 F200\nF150\n{text}\nG0 Z5\nM2\n".encode()


def extruding(program: bytes) -> bytes:
    """Give every line that moves X an E word, without which ArcWelder copies it."""
    lines = program.decode().splitlines()
    fed = (f"{line} E{0.01 * count:.2f}" if line.startswith("G1 X") else line for count, line in enumerate(lines))
    return ("\n".join(fed) + "\n").encode()


class Costs(NamedTuple):
    """What a line of a program costs [s], by what is done with it; memory by byte, and what a start takes."""

    by_name: dict[str, float]
    memory: float
    start: Cost


def costs(folder: Path, program: Callable[[int], bytes]) -> Costs:
    files = {lines: folder / f"{lines}.ngc" for lines in (FEW, MANY)}
    for lines, file in files.items():
        file.write_bytes(program(lines))

    def convert(lines: int) -> Cost:
        output = ["-o", str(folder / "converted.ngc"), "--force", "--no-simulation"]
        return run(folder, sys.executable, "-c", ASKED, "convert", str(files[lines]), "-m", "stepper", *output)

    def weld(lines: int) -> Cost:
        printed = folder / f"{lines}.gcode"
        printed.write_bytes(extruding(files[lines].read_bytes()))
        return run(folder, str(ARC_WELDER), str(printed), str(folder / "welded.gcode"))

    def more(work: Callable[[int], Cost]) -> float:
        return work(MANY).time - work(FEW).time

    ours = [convert(lines) for lines in (FEW, MANY)]
    few, many = (stages(files[lines].read_bytes()) for lines in (FEW, MANY))
    own = {name: many[name] - few[name] for name in many}
    found = {
        "`rs274 -g`": more(partial(interpret, folder, files)),
        **({"ArcWelder": more(weld)} if ARC_WELDER else {}),
        **own,
        "these without verifying": sum(own.values()) - own["verifying"],
        "all of these": sum(own.values()),
        "`ph-post convert`": ours[1].time - ours[0].time,
    }
    memory = (ours[1].memory - ours[0].memory) / files[MANY].stat().st_size
    return Costs({name: time / (MANY - FEW) for name, time in found.items()}, memory, ours[0])


def interpret(folder: Path, files: Mapping[int, Path], lines: int) -> Cost:
    return run(folder, str(RS274), "-g", str(files[lines]))


@pytest.mark.skipif(RS274 is None, reason="LinuxCNC's rs274 is not installed")
def test_what_a_line_costs(tmp_path):
    stages(spline_program(2000))
    found = [costs(tmp_path, program) for program in (spline_program, spirals)]
    sys.stdout.write("\n| a line of a program | X Y Z F [µs] | times `rs274 -g` | X Y [µs] | times `rs274 -g` |\n")
    sys.stdout.write("|---|---|---|---|---|\n")
    for name in found[0].by_name:
        times = [one.by_name[name] for one in found]
        ratios = [time / one.by_name["`rs274 -g`"] for time, one in zip(times, found, strict=True)]
        cells = [f"{1e6 * time:.1f} | {ratio:.1f}" for time, ratio in zip(times, ratios, strict=True)]
        sys.stdout.write(f"| {name} | {' | '.join(cells)} |\n")
    for one in found:
        sys.stdout.write(
            f"start {one.start.time:.2f} s, {one.start.memory / 2**20:.0f} MiB; {one.memory:.0f} bytes a byte\n"
        )
    wide = found[0]
    for name, most in MOST.items():
        assert wide.by_name[name] <= most * wide.by_name["`rs274 -g`"], name
    for one in found:
        assert one.memory <= MEMORY
