"""The confusion matrix: what ``diagnose`` makes of hidden effects, case by case, and counted.

Run from the project's root: ``python -m tests.support.confusion --help``.
"""

from __future__ import annotations

import time
import traceback
from collections.abc import Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

import click

from tests.support.plants.draw import CHANNEL_SETS
from tests.support.plants.sizes import LEADING
from tests.support.plants.trials import LOOPS, Trial, nothings, outsiders, pairs, singles


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
        click.option("--effect", "effects", multiple=True, type=click.Choice(list(LEADING))),
        click.option("--channels", "sets", multiple=True, help="act, act+motor, unknown, ... ; default all."),
        click.option("--loop", "loops", multiple=True, type=click.Choice(LOOPS)),
        click.option("--nothing", default=0, help="Logs in which nothing is hidden."),
        click.option("--outside", default=0, help="Logs with an effect outside of the catalogue."),
        click.option("--pairs", "pair_count", default=0, help="Logs with two effects."),
        click.option(
            "--cache", type=click.Path(path_type=Path), required=True, help="Folder of drawn cases."
        ),
        click.option("--jobs", default=1),
    ):
        command = option(command)
    return command


def _trials(
    seeds: int, effects: Any, sets: Any, loops: Any, nothing: int, outside: int, pair_count: int
) -> list[Trial]:
    chosen = [tuple(each.split("+")) for each in sets] or list(CHANNEL_SETS)
    return [
        *nothings(nothing),
        *singles(seeds, effects or tuple(LEADING), chosen, loops or LOOPS),
        *outsiders(outside),
        *pairs(pair_count),
    ]


@main.command()
@_listing
def draw(cache: Path, jobs: int, **which: Any) -> None:
    """Fill the cache."""
    trials = _trials(**which)
    begun = time.monotonic()
    for count, (trial, wrong) in enumerate(each(draw_one, trials, jobs, cache), 1):
        click.echo(f"{count}/{len(trials)} {time.monotonic() - begun:.0f} s {trial.key} {wrong}")


if __name__ == "__main__":
    main()
