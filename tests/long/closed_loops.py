"""Random cascades with friction and backlash: the executed error by a person's file, and by the one from a diagnosis.

The machines, their logs and what they execute are the tests' own (:mod:`tests.support.closed_loops`). The person's file
has the gains as the drive has them, and neither backlash nor friction. Where it is said which acceleration holds the
tables on their sides, that is tried as well.

    python -m tests.long.closed_loops --seeds 4 --work FOLDER --out tests/long/closed_loops.json
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from tests.support.closed_loops import SHAPES, Executed, Machine, advised, diagnosed, draw_machine, of_program, of_table

LOOPS = ("motor", "load")
UM = 1e6


def told(one: Executed) -> str:
    """Largest and rms error, and the time."""
    return f"{UM * one.largest:.1f}/{UM * one.rms:.2f} um, {one.time:.2f} s"


def compared(machine: Machine, folder: Path) -> Iterator[tuple[str, dict[str, str]]]:
    """Yield of every shape, as table and as program, what the files give."""
    wrong, better = diagnosed(machine, folder)
    for shape in SHAPES:
        for output, play in (("table", of_table), ("program", of_program)):
            first, found = (play(folder, shape, file, machine.true) for file in (wrong, better))
            rows = {"wrong file": told(first), "better file": told(found)}
            if output == "program":
                rows["better file, --lead-program"] = told(of_program(folder, shape, better, machine.true, lead=True))
            slower = advised(better, found.warnings)
            if slower is not None:
                rows["better file, with the accelerations that it says"] = told(
                    play(folder, shape, slower, machine.true)
                )
            yield f"{shape}, {output}", rows


def main() -> None:
    """Compare the files of many machines, and write what was found."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 3])
    asked.add_argument("--work", type=Path, required=True, help="folder of the logs and machine files")
    asked.add_argument("--out", type=Path)
    given = asked.parse_args()
    results: dict[str, Any] = {}
    for seed in given.seeds:
        for loop in LOOPS:
            machine = draw_machine(seed, loop)
            folder = given.work / f"{loop}{seed}"
            folder.mkdir(parents=True, exist_ok=True)
            drive = machine.true[0].drive
            assert drive is not None
            own = {
                "K_v [1/s]": round(drive.kv, 1),
                "speed fed forward": drive.velocity,
                "backlash [um]": ", ".join(f"{UM * one.gap:.1f}" for one in machine.true),
                "friction [m/s2]": ", ".join(f"{one.effects[0]['force'] / one.b:.2f}" for one in machine.true),
            }
            results[f"{loop} {seed}"] = own
            for what, rows in compared(machine, folder):
                own[what] = rows
                sys.stdout.write(f"{loop} {seed} {what} {rows}\n")
                sys.stdout.flush()
            if given.out:
                given.out.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
