"""What a diagnosis made of a case, as a record to keep, and many of them counted."""

from __future__ import annotations

import math
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from tests.support.plants.axis import Plant
from tests.support.plants.cases import Case, Truth
from tests.support.plants.draw import LEAST
from tests.support.plants.ranks import alike
from tests.support.plants.trials import Trial

Result = dict[str, Any]

NEAR = 0.10
"""Relative error of a leading parameter that counts as found."""

QUIET = 1.3
"""Held-out rms over the noise floor that counts as explained."""

UNSIDED = frozenset({"backlash", "coulomb_friction", "stribeck_friction"})
"""What no position of unknown side can tell apart: the rank test takes such a reading for the table's, where
a diagnosis must not."""

SCREW = 2.0 * 2.0 * math.pi / 5e-3
"""N / r [1/m] of the machine files' gear and screw."""


def judge(trial: Trial, case: Case) -> Result:
    """Hand the texts of a case to the diagnosis, as a person would, and keep what it says."""
    from ph_post.diagnose.diagnose import diagnose
    from ph_post.drive.machinefile import read_machine
    from ph_post.identify.logprogram import read_log

    begun = time.monotonic()
    with TemporaryDirectory() as folder:
        (Path(folder) / "record.csv").write_text(case.log)
        (Path(folder) / "machine.toml").write_text(case.machine)
        machine = read_machine(Path(folder) / "machine.toml")
        said = diagnose(read_log(Path(folder) / "record.csv", machine=machine), machine)
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
    return "alike" if unsided or any(look) else "clear"


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
