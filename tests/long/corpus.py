"""The whole corpus, compensated and played: what becomes of each program, and the rates over all.

    python -m tests.long.corpus --out tests/long/corpus.json --manifest tests/corpus/manifest.json

The manifest says of each program what must come out, which the ordinary tests hold a sample against; the summary has
the rates. Programs of LinuxCNC are taken from where it is installed.

Programs that are not ours to keep are judged in the same way: ``--listed`` names a JSON file with rows of a file's
name, from where the list stands, and its dialect. The summary then has what became of each.
"""

from __future__ import annotations

import argparse
import json
import platform
import signal
import sys
import traceback
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path as File
from typing import Any

sys.path.insert(0, str(File(__file__).parents[1]))

from support.corpus import FAMILIES, Entry, whole
from support.corpus_judge import FOLLOWED, GAP, SHOWS, Judged, judge

FIVE = 5.0
"""Times by which the rms is to fall."""

MOST_TIME = 1.1005
"""Times by which a program may last longer: a tenth is allowed, and kept to 0.05 % of its time."""

RESOLVED = 1e-4
"""Part of an error within which two are the same: places are sampled."""

LONGEST = 300
"""Time [s] in which a program is judged."""

LEAST = 1e-6
"""Errors that are smaller [mm] are none."""


def expectation(judged: Judged) -> dict[str, Any]:
    """Return the part of a finding that the manifest holds."""
    counts = ("reversals", "compensated", "followed")
    return {"outcome": judged.outcome} | {name: getattr(judged, name) for name in counts}


def rates(found: dict[str, Judged]) -> dict[str, Any]:
    """Return the rates over programs, as counts beside what they are of."""
    rows = list(found.values())
    moving = [row for row in rows if row.reversals]
    played = [row for row in rows if row.rms is not None and row.shown]
    timed = [row for row in rows if row.time is not None and row.time[0] > 0.0]
    return {
        "programs": len(rows),
        "origins": dict(sorted(Counter(name.partition("/")[0] for name in found).items())),
        "refused": sum(row.outcome == "refused" for row in rows),
        "expanded": sum(row.outcome == "expanded" for row in rows),
        "compensated": [sum(row.compensated > 0 for row in moving), len(moving)],
        "reversals": [sum(row.compensated for row in moving), sum(row.reversals for row in moving)],
        "followed": [sum(row.followed for row in played), sum(row.shown for row in played)],
        "rms_five_times_down": _fallen(played, lambda row: row.rms),
        "p95_five_times_down": _fallen(played, lambda row: row.p95),
        "within_ten_percent_of_time": [sum(b <= MOST_TIME * a for a, b in (row.time for row in timed)), len(timed)],
        "restored": [sum(row.restored for row in rows), len(rows)],
        "worse": sorted(name for name, row in found.items() if row.rms is not None and _worse(row.rms)),
        "rms_less_than_five_times_down": sorted(
            name for name, row in found.items() if row in played and not _five_times_down(row.rms)
        ),
        "reversals_left": {
            name: row.reversals - row.compensated for name, row in found.items() if row.compensated < row.reversals
        },
    }


def _five_times_down(pair: Any) -> bool:
    before, after = pair
    return bool(FIVE * after <= max(before, LEAST))


def _worse(pair: Any) -> bool:
    before, after = pair
    return bool(after > before + max(LEAST, RESOLVED * before))


def _fallen(rows: Iterable[Judged], of: Any) -> list[int]:
    pairs = [of(row) for row in rows]
    return [sum(map(_five_times_down, pairs)), len(pairs)]


def listed(file: File) -> list[Entry]:
    """Programs that a list names."""
    rows = json.loads(file.read_text())
    return [Entry(name, file.parent / name, dialect) for name, dialect, *_ in rows]


def judge_in_time(entry: Entry) -> Judged:
    """Judge a program; one that takes too long, or stops with a traceback, has that as its outcome."""
    signal.alarm(LONGEST)
    try:
        return judge(entry)
    except TimeoutError:
        return Judged("not done in time")
    except Exception:
        return Judged("traceback", reason=traceback.format_exc())
    finally:
        signal.alarm(0)


def judge_all(entries: list[Entry], jobs: int) -> dict[str, Judged]:
    """Judge programs in processes side by side, and say each as it is done."""
    found: dict[str, Judged] = {}
    with ProcessPoolExecutor(jobs, initializer=signal.signal, initargs=(signal.SIGALRM, _out_of_time)) as pool:
        names = {pool.submit(judge_in_time, entry): entry.name for entry in entries}
        for done in as_completed(names):
            name = names[done]
            found[name] = done.result()
            print(name, *found[name], flush=True)  # noqa: T201
    return found


def _out_of_time(*_: object) -> None:
    raise TimeoutError


def main() -> None:
    """Judge every program, and write manifest and summary."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=File, required=True)
    which = parser.add_mutually_exclusive_group(required=True)
    which.add_argument("--manifest", type=File)
    which.add_argument("--listed", type=File)
    parser.add_argument("--only", default="", help="programs whose names begin so; the others keep their entries")
    parser.add_argument("--jobs", type=int, default=1)
    asked = parser.parse_args()
    programs = listed(asked.listed) if asked.listed else whole()
    found = judge_all([entry for entry in programs if entry.name.startswith(asked.only)], asked.jobs)
    setting = {"machine": f"stepper, {GAP} mm on X, Y and Z", "shown_mm": SHOWS, "followed_part": FOLLOWED}
    if asked.listed:
        each = {name: one._asdict() for name, one in sorted(found.items())}
        asked.out.write_text(json.dumps(setting | rates(found) | {"each": each}, indent=1) + "\n")
        return
    entries = json.loads(asked.manifest.read_text()) if asked.only else {}
    entries |= {name: expectation(one) for name, one in found.items()}
    lines = [f"{json.dumps(name)}: {json.dumps(one)}" for name, one in sorted(entries.items())]
    asked.manifest.write_text("{\n" + ",\n".join(lines) + "\n}\n")
    if not asked.only:
        setting |= {"families": FAMILIES, "seed": 1515, "python": platform.python_version()}
        asked.out.write_text(json.dumps(setting | rates(found), indent=1) + "\n")


if __name__ == "__main__":
    main()
