"""Reading a program of 200,000 lines against LinuxCNC's interpreter, and the memory that it takes.

pytest tests/bench/test_bench_reader.py -s
"""

from __future__ import annotations

import random
import resource
import subprocess
import sys
import time
from pathlib import Path

from support.canon import RS274, needs_rs274

LINES = 200_000
MEMORY = 20
"""Times the file's size that reading may take."""
READ = """
import resource, sys, time
from pathlib import Path
from ph_post.gcode.read import read_program
read_program(b"G21 G90 F100\\nG0 X0 Y0\\nG1 X1\\nG2 X2 I0.5\\nM2\\n", "small")
data = Path(sys.argv[1]).read_bytes()
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
start = time.process_time()
program = read_program(data, "large")
print(time.process_time() - start, (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024)
assert program.motions.block.size == int(sys.argv[2])
"""


def write_program(file: Path) -> None:
    """Lines of four words each, all different."""
    draw = random.Random(1)
    lines = ["G21 G90 G17"]
    for _ in range(LINES):
        x, y, z = (draw.uniform(-99.0, 99.0) for _ in range(3))
        lines.append(f"G1 X{x:.4f} Y{y:.4f} Z{z:.4f} F{draw.randint(100, 999)}")
    file.write_text("\n".join([*lines, "M2", ""]), encoding="utf-8")


@needs_rs274
def test_a_program_is_read_faster_than_linuxcnc_interprets_it(tmp_path: Path) -> None:
    file = tmp_path / "large.ngc"
    write_program(file)
    line = [sys.executable, "-c", READ, str(file), str(LINES)]
    seconds, size = map(float, subprocess.run(line, capture_output=True, check=True, text=True).stdout.split())
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    start = time.perf_counter()
    subprocess.run([str(RS274), "-g", str(file)], capture_output=True, check=True, cwd=tmp_path)
    wall = time.perf_counter() - start
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    theirs = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    times = size / file.stat().st_size
    told = f"read {seconds:.2f} s, rs274 {theirs:.2f} s ({wall:.2f} s by the clock), {times:.1f} times the file"
    sys.stdout.write(told + "\n")
    assert seconds < theirs
    assert times < MEMORY
