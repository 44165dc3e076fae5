"""Every circle, feed, acceleration, backlash and lag on a real LinuxCNC, and pockets, curves and an engraving.

A table of the tests' own follows the joint commands behind its backlash, and behind a modelled drive. Compared are the
plain program, LinuxCNC's own BACKLASH, stops with a dwell at each reversal, and crossings on the fly.

    python -m tests.long.crossings --out tests/long/crossings.json

With `--short` it takes some ten minutes; `crossings.json` is of such a run.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.real_cuts import Cut, Measured, bench, measure, program, stopping

import ph_post as ph
from ph_post.gcode.read import read_program
from ph_post.rehearse.linuxcnc import run_on_linuxcnc
from ph_post.types import Machine

EXCESS = (1.5, 3.0)
"""What a crossing may cost beyond the controller's own path [µm], and where radii are 2 mm and less."""

TIGHT = ("engraving", "spline")
"""Shapes with such radii: 0.9 mm."""


def tight(cut: Cut) -> bool:
    return cut.shape in TIGHT or cut.radius == 2.0


SLOWER = 0.25
"""Time that is allowed, as a part: circles of 2 mm at 3000 mm/min are slow at all reversals."""


class Setting(NamedTuple):
    """Lost motion [mm], acceleration of the axes [mm/s²], and lag of the motors [s]."""

    lost: float
    push: float
    lag: float = 0.0


CUTS = (
    *(
        Cut("circle", feed, left, radius)
        for radius in (2, 5, 20, 100)
        for feed in (600, 1200, 3000)
        for left in (True, False)
    ),
    *(
        Cut(shape, feed, left)
        for shape in ("pocket", "ellipse", "spline", "engraving")
        for feed in (600, 1200, 3000)
        for left in (True, False)
    ),
)
SETTINGS = [
    Setting(lost, push, lag) for push in (500, 2000) for lost in (0.02, 0.05, 0.1) for lag in (0.0, 0.01, 0.025)
]


def machine_of(setting: Setting) -> Machine:
    return bench(setting.lost, setting.push, setting.lag)


def compensated(text: bytes, setting: Setting) -> bytes:
    return ph.compensate(read_program(text, "cuts.ngc"), machine_of(setting), max_slowdown=SLOWER).program()


def recorded(text: bytes, setting: Setting, own: bool = False) -> np.ndarray:
    """Run a program; the commands of the joints, with LinuxCNC's `own` compensation where that is asked for."""
    backlash = dict.fromkeys("XY", setting.lost * 1e-3) if own else None
    found = run_on_linuxcnc(text, "cuts", machine_of(setting), backlash=backlash)
    return np.asarray(found.motor if own else found.position)


def least_time(cut: Cut, setting: Setting, error: float) -> float:
    """Least time [s] that a crossing at a circle's quadrant loses for an error [µm]: a dip like a V.

    With the full acceleration a, while the table waits for T = 2 √(g/a) and the path goes 4 √(R e), balanced.
    """
    speed, radius = min(cut.feed / 60.0, math.sqrt(math.sqrt(0.75) * setting.push * cut.radius)), cut.radius
    wait = 2.0 * math.sqrt(setting.lost / setting.push)
    mean = 4.0 / wait * math.sqrt(radius * error * 1e-3)
    if mean >= speed:
        return 0.0
    lowest = mean - 0.25 * setting.push * wait
    if speed - lowest > 0.5 * setting.push * wait:
        return (speed - lowest) ** 2 / (setting.push * speed)
    return wait * (1.0 - mean / speed)


def judged(cut: Cut, setting: Setting, kinds: dict[str, Measured]) -> dict[str, Any]:
    own, plain, crossed = kinds["own"], kinds["plain"], kinds["crossed"]
    excess = crossed.largest - own.largest
    allowed = EXCESS[tight(cut)]
    more = crossed.time - plain.time
    found = {
        **cut._asdict(),
        **setting._asdict(),
        **{name: [round(x, 3) for x in one] for name, one in kinds.items()},
        "excess": round(excess, 2),
        "exact": excess <= allowed,
        "slower": round(more / plain.time, 4),
    }
    if cut.shape == "circle" and not setting.lag:
        threshold = (cut.feed / 60.0) ** 2 * setting.lost / (4.0 * setting.push * cut.radius) * 1e3
        least = 4.0 * least_time(cut, setting, max(excess, 0.05))
        found["dips"] = threshold > allowed
        found["least"] = round(least / plain.time, 4)
        found["quick"] = more <= (1.3 * least if threshold > allowed else 0.02 * plain.time) + 1e-3
    return found


def every(settings: list[Setting], cuts: tuple[Cut, ...]) -> list[dict[str, Any]]:
    text, rows = program(cuts), []
    plain = {push: recorded(text, Setting(0.05, push)) for push in {one.push for one in settings}}
    theirs: dict[tuple[float, float], np.ndarray] = {}
    for setting in settings:
        key = setting.lost, setting.push
        if key not in theirs:
            theirs[key] = recorded(text, setting, own=True)
        try:
            crossed = recorded(compensated(text, setting), setting)
        except Exception as error:
            sys.stderr.write(f"{setting}: {error}\n")
            continue
        kinds = {
            "own": measure(plain[setting.push], cuts, 0.0, setting.lag),
            "plain": measure(plain[setting.push], cuts, setting.lost, setting.lag),
            "backlash": measure(theirs[key], cuts, setting.lost, setting.lag),
            "crossed": measure(crossed, cuts, setting.lost, setting.lag),
        }
        for number, cut in enumerate(cuts):
            rows.append(judged(cut, setting, {name: found[number] for name, found in kinds.items()}))
        sys.stderr.write(f"{setting}\n")
    return rows


def takes_long(cut: Cut) -> bool:
    return (cut.feed < 3000 and cut.radius == 100) or (cut.feed < 1200 and cut.shape != "circle")


def stopped(setting: Setting, cuts: tuple[Cut, ...]) -> list[dict[str, Any]]:
    """Measure circles with a stop at each reversal."""
    found = []
    for cut in cuts:
        one = measure(recorded(stopping(cut, setting.lost), setting), [cut], setting.lost)[0]
        found.append({**cut._asdict(), **setting._asdict(), "stops": [round(x, 3) for x in one]})
    return found


def summary(rows: list[dict[str, Any]]) -> dict[str, Any]:
    def of(part: list[dict[str, Any]]) -> dict[str, Any]:
        quick = [row for row in part if "quick" in row]
        smooth, dips = ([row for row in quick if row["dips"] is which] for which in (False, True))
        return {
            "cuts": len(part),
            "exact": sum(row["exact"] for row in part),
            "largest excess": max((row["excess"] for row in part), default=0.0),
            "median excess": float(np.median([row["excess"] for row in part])) if part else 0.0,
            "without a dip": len(smooth),
            "of them within 2 %": sum(row["quick"] for row in smooth),
            "with a dip": len(dips),
            "of them within 1.3 of the least": sum(row["quick"] for row in dips),
            "median of time lost beside the least": round(
                float(np.median([row["slower"] / max(row["least"], 1e-4) for row in dips])), 2
            )
            if dips
            else None,
        }

    groups: dict[str, Any] = {"all": of(rows)}
    for shape in sorted({row["shape"] for row in rows}):
        for lag in sorted({row["lag"] for row in rows}):
            groups[f"{shape}, lag {1e3 * lag:g} ms"] = of(
                [row for row in rows if (row["shape"], row["lag"]) == (shape, lag)]
            )
    return groups


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--settings", type=int, nargs="*", help="numbers from 0; all without")
    parser.add_argument("--short", action="store_true", help="without R 100 and shapes at low feeds")
    asked = parser.parse_args()
    settings = [one for number, one in enumerate(SETTINGS) if asked.settings is None or number in asked.settings]
    rows = every(settings, tuple(cut for cut in CUTS if not (asked.short and takes_long(cut))))
    table = tuple(cut for cut in CUTS if cut.shape == "circle" and cut.left and cut.feed > 600 and cut.radius < 100)
    stops = stopped(Setting(0.05, 500), table)
    lines = ",\n  ".join(json.dumps(row) for row in rows)
    text = json.dumps({"summary": summary(rows), "stops": stops}, indent=1)[:-2]
    asked.out.write_text(f'{text},\n "rows": [\n  {lines}\n ]\n}}\n')
    sys.stdout.write(json.dumps(summary(rows)["all"], indent=1) + "\n")


if __name__ == "__main__":
    main()
