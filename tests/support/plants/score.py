"""What a diagnosis made of a case, as a record to keep, and many of them counted."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from tests.support.plants.axis import Plant
from tests.support.plants.cases import Case, Truth
from tests.support.plants.draw import LEAST
from tests.support.plants.ranks import alike
from tests.support.plants.trials import Trial

if TYPE_CHECKING:
    from ph_post.types import Log, Machine

Result = dict[str, Any]

NEAR = 0.10
"""Relative error of a leading parameter that counts as found."""

QUIET = 1.3
"""Held-out rms over the noise floor that counts as explained."""

SHORTEST_TOLD = {"moving_average": 2.05e-3, "exponential_filter": 2.05e-3 / math.sqrt(12.0)}
"""Filters [s] of the same variance below which 5 nats, a name's least, do not tell them from a delay by a row each ms.

The rank test, whose plants know what the drive makes of its command between rows, does not see that.
"""

UNSIDED = frozenset({"backlash", "coulomb_friction", "stribeck_friction"})
"""What no position of unknown side can tell apart: the rank test takes such a reading for the table's, where
a diagnosis must not."""

SCREW = 2.0 * 2.0 * math.pi / 5e-3
"""N / r [1/m] of the machine files' gear and screw."""


def handed_in(case: Case, folder: Path) -> tuple[Log, Machine]:
    """Read the texts of a case, as a person's."""
    from ph_post.drive.machinefile import read_machine
    from ph_post.identify.logprogram import read_log

    (folder / "record.csv").write_text(case.log)
    (folder / "machine.toml").write_text(case.machine)
    machine = read_machine(folder / "machine.toml")
    return read_log(folder / "record.csv", machine=machine), machine


def left_by_identify(case: Case, with_file: bool) -> list[float]:
    """Root mean square that the identified machine leaves of the positions of each axis, in their true noise."""
    from ph_post.identify.identify import identify

    with TemporaryDirectory() as folder:
        log, machine = handed_in(case, Path(folder))
        drives = identify(log, machine if with_file else None).drives
    left = []
    for name, drive in drives.items():
        floors = [floor for key, floor in case.floors.items() if key[0] == name and not key.endswith("_force")]
        left.append(drive.rms / math.sqrt(sum(floor**2 for floor in floors) / len(floors)))
    return left


def judge(trial: Trial, case: Case) -> Result:
    """Hand the texts of a case to the diagnosis, as a person would, and keep what it says."""
    from ph_post.diagnose.diagnose import diagnose

    begun = time.monotonic()
    with TemporaryDirectory() as folder:
        log, machine = handed_in(case, Path(folder))
        said = diagnose(log, machine)
    findings = [
        {
            "name": each.name,
            "axis": each.axis,
            "ambiguous_with": list(each.ambiguous_with),
            "parameters": {name: [one.value, one.stderr, one.unit] for name, one in each.parameters.items()},
        }
        for each in said.findings
    ]
    last = said.steps[-1].holdout_rms if said.steps else None
    return {
        "key": trial.key,
        "kind": trial.kind,
        "effects": list(trial.effects),
        "channels": "+".join(trial.channels),
        "feedback": trial.feedback,
        "seed": trial.seed,
        "truths": [
            {
                "name": t.name,
                "axis": t.axis,
                "parameter": t.parameter,
                "value": t.value,
                "ratio": t.ratio,
                "found": found_value(t, findings, case),
            }
            for t in case.truths
        ],
        "apart": {},
        "verdict": said.verdict,
        "findings": findings,
        "noise_floor": said.noise_floor,
        "holdout": last,
        "steps": [[s.added, s.fit_rms, s.holdout_rms] for s in said.steps],
        "seconds": round(time.monotonic() - begun, 1),
    }


def metric(value: float, unit: str, plant: Plant) -> float:
    """A value in SI, forces as F/K [m]; NaN where the unit is not known."""
    K = plant.stiffness
    sizes = {
        "": 1.0,
        "1": 1.0,
        "1/s": 1.0,
        "%": 1e-2,
        "mm/mm": 1.0,
        "m/m": 1.0,
        "s": 1.0,
        "s²": 1.0,
        "rad": 1.0,
        "mm": 1e-3,
        "um": 1e-6,
        "µm": 1e-6,
        "ms": 1e-3,
        "deg": math.pi / 180.0,
        "Hz": 2.0 * math.pi,
        "N": 1.0 / K,
        "N s/mm": 1e3 / K,
        "N·s/mm": 1e3 / K,
        "N m": SCREW / K,
        "rad/s²": plant.eta * plant.b / SCREW,
        "mm/s": 1e-3,
        "mm/min": 1e-3 / 60.0,
    }
    return value * sizes.get(unit, math.nan)


def found_value(truth: Truth, findings: Sequence[Mapping[str, Any]], case: Case) -> float | None:
    """The leading parameter as it was found, in the truth's unit; None where its name was not."""
    plant = case.files[case.axes.index(truth.axis)]
    for finding in findings:
        if finding["name"] != truth.name or finding["axis"] != truth.axis:
            continue
        told = finding["parameters"]
        values = {name: metric(value, unit, plant) for name, (value, _, unit) in told.items()}
        if truth.name == "friction_asymmetry" and {"plus", "minus"} <= set(values):
            return values["plus"] - values["minus"]
        if truth.parameter in values:
            return values[truth.parameter]
        return next(iter(values.values()), None)
    return None


def names_of(result: Result) -> set[tuple[str, str]]:
    return {(each["name"], each["axis"]) for each in result["findings"]}


def mentioned(result: Result) -> set[str]:
    """Every name that the answer holds, ambiguous ones too."""
    names = {each["name"] for each in result["findings"]}
    for each in result["findings"]:
        names |= {other.split(":")[0] for other in each["ambiguous_with"]}
    return names


def class_of(result: Result) -> str:
    """What a case counts as: "clear", "alike" or "faint" by the rank test, or its kind."""
    if result["kind"] in ("nothing", "outside"):
        return str(result["kind"])
    if any(truth["ratio"] < LEAST for truth in result["truths"]):
        return "faint"
    look = [alike(apart) for apart in result["apart"].values()]
    if any("nothing" in names for names in look):
        return "faint"
    unsided = result["channels"] == "unknown" and not UNSIDED.isdisjoint(result["effects"])
    short = any(truth["value"] < SHORTEST_TOLD.get(truth["parameter"], 0.0) for truth in result["truths"])
    return "alike" if unsided or short or any(look) else "clear"


def answered(result: Result) -> str:
    """In a word what the answer was worth."""
    if "error" in result:
        return "error"
    verdict = result["verdict"]
    if result["kind"] == "nothing":
        return "right" if verdict == "nothing-missing" else "invented" if result["findings"] else verdict
    if result["kind"] == "outside":
        return "right" if verdict == "unknown" else verdict
    truths = {(truth["name"], truth["axis"]) for truth in result["truths"]}
    if verdict == "named":
        found = names_of(result)
        return "right" if found == truths else "more" if found > truths else "part" if found & truths else "wrong"
    if verdict == "ambiguous":
        return "ambiguous" if {name for name, _ in truths} <= mentioned(result) else "ambiguous, not with it"
    return str(verdict)


def near(result: Result) -> bool:
    """Whether every leading parameter lies within 10 % of the truth."""
    return all(
        truth["found"] is not None and abs(truth["found"] - truth["value"]) <= NEAR * max(abs(truth["value"]), 1e-300)
        for truth in result["truths"]
    )


def quiet(result: Result) -> bool:
    return bool(result.get("holdout") and result["holdout"] <= QUIET * result["noise_floor"])


def _good(result: Result) -> bool:
    word = answered(result)
    return word == "right" or (class_of(result) == "alike" and word == "ambiguous")


FRICTIONS = ("coulomb_friction", "stribeck_friction")


def sized(result: Result) -> bool:
    """Whether the hidden effect is among the names, and its size is near, with a rival beside it or without."""
    return answered(result) in ("right", "ambiguous") and near(result)


def named(result: Result) -> bool:
    """Whether the hidden effect is the name; of a position of unknown side whether it is one of both."""
    word = answered(result)
    return word == "right" or (word == "ambiguous" and class_of(result) == "alike")


def shares(results: Iterable[Result]) -> dict[str, list[float]]:
    """What of what is asked of cascades holds: how many, of how many, and Wilson's interval of 95 % [%]."""
    results = list(results)
    clear = [r for r in results if r["kind"] == "single" and class_of(r) in ("clear", "alike")]
    of = {
        "gaps sized": [sized(r) for r in clear if r["effects"] == ["backlash"]],
        "friction named": [named(r) for r in clear if r["effects"][0] in FRICTIONS],
        "filters named": [named(r) for r in clear if r["effects"] == ["command_filter"]],
        "filters named, or with a delay": [
            answered(r) in ("right", "ambiguous") for r in clear if r["effects"] == ["command_filter"]
        ],
        "clean without a name": [not r["findings"] for r in results if r["kind"] == "nothing"],
        "outsiders unknown": [answered(r) == "right" for r in results if r["kind"] == "outside"],
        "no wrong name without doubt": [not wrong(r) for r in results],
    }
    return {name: [sum(hits), len(hits), *wilson(sum(hits), len(hits))] for name, hits in of.items() if hits}


def wrong(result: Result) -> bool:
    """Whether the answer holds a name that is not hidden, and no word of doubt."""
    truths = {(truth["name"], truth["axis"]) for truth in result["truths"]}
    return result.get("verdict") == "named" and not names_of(result) <= (
        truths if result["kind"] in ("single", "pair") else set()
    )


def wilson(hits: int, of: int) -> tuple[float, float]:
    """Share that 95 % of such counts bear, least and most [%]: E. B. Wilson, J. Am. Stat. Assoc. 22, 209 (1927)."""
    z, share = 1.96, hits / of
    half = z * math.sqrt(share * (1.0 - share) / of + z * z / (4.0 * of * of))
    low, high = (100.0 * (share + z * z / (2.0 * of) + side * half) / (1.0 + z * z / of) for side in (-1.0, 1.0))
    return round(low, 1), round(high, 1)


def summary(results: Iterable[Result]) -> str:
    """Tables in Markdown: what became of every kind of case, then of every effect."""
    results = list(results)
    heads = ["of", "cases", "right", "within 10 %", "held-out ≤ 1.3 floors", "otherwise"]
    kinds = _table("class", heads, results, lambda r: f"{r['kind']}, {class_of(r)}" if r["truths"] else class_of(r))
    clear = [r for r in results if r["kind"] == "single"]
    by_name = _table("effect", heads, clear, lambda r: f"{r['effects'][0]}, {class_of(r)}")
    by_set = _table("recorded", heads, clear, lambda r: f"{r['channels']}, {r['feedback']}, {class_of(r)}")
    return "\n".join([*kinds, "", *by_name, "", *by_set, ""])


def _table(title: str, heads: Sequence[str], results: Iterable[Result], group: Callable[[Result], str]) -> list[str]:
    groups: dict[str, list[Result]] = defaultdict(list)
    for result in results:
        groups[group(result)].append(result)
    lines = [f"| {' | '.join([title, *heads[1:]])} |", "|" + "---|" * len(heads)]
    for name, members in sorted(groups.items()):
        good = [r for r in members if _good(r)]
        named = [r for r in members if answered(r) == "right" and r["truths"] and r["kind"] != "outside"]
        words: dict[str, int] = defaultdict(int)
        for result in members:
            if not _good(result):
                words[answered(result)] += 1
        rest = ", ".join(f"{word} {count}" for word, count in sorted(words.items(), key=lambda w: -w[1]))
        close = _share([r for r in named if near(r)], named)
        calm = _share([r for r in named if quiet(r)], named)
        lines.append(f"| {name} | {len(members)} | {_share(good, members)} | {close} | {calm} | {rest} |")
    return lines


def _share(part: Sequence[Any], whole: Sequence[Any]) -> str:
    return f"{100.0 * len(part) / len(whole):.0f} %" if whole else ""
