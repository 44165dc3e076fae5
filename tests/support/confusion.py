"""The confusion matrix: what ``diagnose`` makes of hidden effects, case by case, and counted.

Run from the project's root: ``python -m tests.support.confusion --help``.
"""

from __future__ import annotations

import json
import os
import platform
import random
import time
import traceback
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import click

from ph_post.errors import InputError
from tests.support.plants.cases import Case, thinned
from tests.support.plants.draw import CHANNEL_SETS
from tests.support.plants.ranks import tell_apart
from tests.support.plants.score import Result, answered, class_of, judge, left_by_identify, near, shares, summary
from tests.support.plants.sizes import LEADING
from tests.support.plants.trials import LOOPS, SINGLE_LOOPS, Trial, nothings, outsiders, pairs, singles


def draw_one(trial: Trial, folder: Path) -> str:
    """Put a case into the folder; says what went wrong, nothing where nothing did."""
    try:
        trial.case(folder)
    except Exception:
        return f"{trial.key}: {traceback.format_exc()}"
    return ""


def each(work: Any, trials: Iterable[Trial], jobs: int, *more: Any) -> Iterator[tuple[Trial, Any]]:
    """Work on every trial, in this process or in several, in the order in which they are done."""
    if jobs == 1:
        yield from ((trial, work(trial, *more)) for trial in trials)
        return
    with ProcessPoolExecutor(jobs) as pool:
        waiting = {pool.submit(work, trial, *more): trial for trial in trials}
        for done in as_completed(waiting):
            yield waiting[done], done.result()


@click.group()
def main() -> None:
    """Draw hidden plants, diagnose them, count the verdicts."""


def _listing(command: Any) -> Any:
    """Options that say which trials."""
    for option in (
        click.option("--seeds", default=0, help="Seeds for each effect, channel set and loop."),
        click.option("--first", default=0, help="Seed to begin with; others are fresh cases."),
        click.option("--effect", "effects", multiple=True, type=click.Choice(list(LEADING))),
        click.option("--channels", "sets", multiple=True, help="act, act+motor, unknown, ... ; default all."),
        click.option("--loop", "loops", multiple=True, type=click.Choice(LOOPS)),
        click.option("--nothing", default=0, help="Logs in which nothing is hidden."),
        click.option("--outside", default=0, help="Logs with an effect outside of the catalogue."),
        click.option("--pairs", "pair_count", default=0, help="Logs with two effects."),
        click.option(
            "--sample",
            default=0,
            help="Only so many of these, drawn at random; more are these and others.",
        ),
        click.option("--cache", type=click.Path(path_type=Path), required=True, help="Folder of drawn cases."),
        click.option("--jobs", default=1),
    ):
        command = option(command)
    return command


def _trials(
    seeds: int,
    first: int,
    effects: Any,
    sets: Any,
    loops: Any,
    nothing: int,
    outside: int,
    pair_count: int,
    sample: int,
) -> list[Trial]:
    chosen = [tuple(each.split("+")) for each in sets] or list(CHANNEL_SETS)
    some = loops or SINGLE_LOOPS
    trials = [
        *nothings(nothing, some, first),
        *singles(seeds, effects or tuple(LEADING), chosen, loops or LOOPS, first),
        *outsiders(outside, some, first),
        *pairs(pair_count, some, first),
    ]
    if sample:
        random.Random(0).shuffle(trials)
    return trials[: sample or None]


@main.command()
@_listing
def draw(cache: Path, jobs: int, **which: Any) -> None:
    """Fill the cache."""
    trials = _trials(**which)
    begun = time.monotonic()
    for count, (trial, wrong) in enumerate(each(draw_one, trials, jobs, cache), 1):
        click.echo(f"{count}/{len(trials)} {time.monotonic() - begun:.0f} s {trial.key} {wrong}")


def judge_one(trial: Trial, folder: Path, ranked: bool, every: int) -> Result:
    """Diagnose a case, of every so many rows; an error is a result too."""
    try:
        case = trial.case(folder)
        result = judge(trial, thinned(case, every))
        if ranked and trial.kind in ("single", "pair"):
            result["apart"] = rank(trial, case, folder)
    except Exception:
        return {
            "key": trial.key,
            "kind": trial.kind,
            "effects": list(trial.effects),
            "seed": trial.seed,
            "channels": "+".join(trial.channels),
            "feedback": trial.feedback,
            "truths": [],
            "apart": {},
            "findings": [],
            "error": traceback.format_exc(),
        }
    return result


def rank(trial: Trial, case: Case, folder: Path) -> dict[str, dict[str, float]]:
    """The rank test's numbers, kept beside the case."""
    kept = folder / f"{trial.key}.rank.json"
    if kept.exists():
        return dict(json.loads(kept.read_text()))
    found = tell_apart(case)
    beside = kept.with_suffix(".part")
    beside.write_text(json.dumps(found))
    beside.replace(kept)
    return found


def rank_one(trial: Trial, folder: Path) -> str:
    try:
        rank(trial, trial.case(folder), folder)
    except Exception:
        return f"{trial.key}: {traceback.format_exc()}"
    return ""


@main.command("rank")
@_listing
def rank_all(cache: Path, jobs: int, **which: Any) -> None:
    """Run the rank test alone, and keep its numbers in the cache."""
    for count, (trial, wrong) in enumerate(each(rank_one, _trials(**which), jobs, cache), 1):
        click.echo(f"{count} {trial.key} {wrong}")


def read_results(path: Path) -> dict[str, Result]:
    """Results by key; the last of a key counts."""
    if not path.exists():
        return {}
    lines = [json.loads(line) for line in path.read_text().splitlines() if line.strip()]
    return {result["key"]: result for result in lines}


@main.command()
@_listing
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="Results, JSON lines.")
@click.option("--rank/--no-rank", "ranked", default=True, help="Ask the rank test about each case too.")
@click.option("--every", default=1, help="Only every so many rows of the logs, which have 1000 a second.")
@click.option("--again", is_flag=True, help="Also what the results hold already.")
def run(cache: Path, jobs: int, out: Path, ranked: bool, every: int, again: bool, **which: Any) -> None:
    """Diagnose cases and add to the results; what is there already is left alone."""
    known = {} if again else read_results(out)
    trials = [trial for trial in _trials(**which) if trial.key not in known or "error" in known[trial.key]]
    begun = time.monotonic()
    with out.open("a") as results:
        for count, (trial, result) in enumerate(each(judge_one, trials, jobs, cache, ranked, every), 1):
            results.write(json.dumps(result) + "\n")
            results.flush()
            said = [f"{found['name']}:{found['axis']}" for found in result["findings"]]
            seconds = time.monotonic() - begun
            word = answered(result)
            click.echo(f"{count}/{len(trials)} {seconds:.0f} s {trial.key}: {word} {' '.join(said)}")
    click.echo(summary(read_results(out).values()))


def identify_one(trial: Trial, folder: Path, with_file: bool) -> dict[str, Any]:
    """Identify the axes of a case; where nothing can be, why."""
    told: dict[str, Any] = {"key": trial.key}
    try:
        return told | {"left": left_by_identify(trial.case(folder), with_file)}
    except InputError as refusal:
        return told | {"refused": str(refusal)}
    except Exception:
        return told | {"error": traceback.format_exc()}


@main.command()
@_listing
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="Results, JSON lines.")
@click.option("--with-file/--without-file", default=True, help="Whether there is a machine file to begin with.")
def identify(cache: Path, jobs: int, out: Path, with_file: bool, **which: Any) -> None:
    """Identify the axes of cases: what is left of the positions, in their noise."""
    trials = [trial for trial in _trials(**which) if trial.key not in read_results(out)]
    with out.open("a") as results:
        for trial, told in each(identify_one, trials, jobs, cache, with_file):
            results.write(json.dumps(told) + "\n")
            results.flush()
            click.echo(f"{trial.key}: {told}")


@main.command()
@click.argument("results", type=click.Path(path_type=Path, exists=True))
@click.option("--cache", type=click.Path(path_type=Path), help="Take the rank test's numbers from here.")
def tell(results: Path, cache: Path | None) -> None:
    """Print the tables of results."""
    known = read_results(results)
    for key, result in known.items():
        kept = None if cache is None else cache / f"{key}.rank.json"
        if kept is not None and kept.exists():
            result["apart"] = json.loads(kept.read_text())
    click.echo(summary(known.values()))


@main.command()
@click.argument("results", type=click.Path(path_type=Path, exists=True))
@click.option("-o", "--out", type=click.Path(path_type=Path), required=True, help="Summary, JSON.")
def count(results: Path, out: Path) -> None:
    """Write how many of each kind were answered how, and which were not right."""
    known = read_results(results)
    words: dict[str, Counter[str]] = defaultdict(Counter)
    for result in known.values():
        words[class_of(result) if result["kind"] == "single" else result["kind"]][answered(result)] += 1
    matrix: dict[str, dict[str, Counter[str]]] = defaultdict(lambda: defaultdict(Counter))
    cells: Counter[tuple[str, str]] = Counter()
    for result in known.values():
        if result["kind"] == "single":
            (effect,), loop = result["effects"], result["feedback"].partition("-")[0]
            matrix[effect]["cascade" if loop == "cascade" else "P loop"][answered(result)] += 1
            cells[effect, result["channels"]] += 1
    good = [r for r in known.values() if answered(r) == "right" and r["kind"] in ("single", "pair")]
    seeds = [result["seed"] for result in known.values()]
    told = {
        "cases": len(known),
        "seeds": [min(seeds), max(seeds)],
        "machine": f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}",
        "answers": {kind: dict(counted.most_common()) for kind, counted in sorted(words.items())},
        "answers by effect": {
            effect: {loop: dict(counted.most_common()) for loop, counted in sorted(loops.items())}
            for effect, loops in sorted(matrix.items())
        },
        "logs of an effect on a set of channels, at least": min(cells.values(), default=0),
        "right, within 10 %": [sum(map(near, good)), len(good)],
        "how many, of how many, percent by Wilson's interval of 95 %": shares(known.values()),
        "not right": {key: answered(r) for key, r in sorted(known.items()) if answered(r) != "right"},
    }
    out.write_text(json.dumps(told, indent=1) + "\n")


if __name__ == "__main__":
    main()
