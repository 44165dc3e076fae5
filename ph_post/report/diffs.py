"""Text and JSON of the comparison of two programs, and of the verdict of ``verify``."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import click
import msgspec

from ph_post.diff.blocks import BlockChange, CommandChange, lines_of
from ph_post.diff.compare import Comparison, Deviation, PredictedErrors
from ph_post.diff.feeds import FeedChange, Timing
from ph_post.diff.paths import Span
from ph_post.files.check import counted
from ph_post.gcode.program import PartProgram
from ph_post.quantities import NOTHING, micrometres, millimetres, seconds
from ph_post.report.result_line import ResultSummary, declared_axes, result_lines
from ph_post.report.tables import format_table
from ph_post.report.views import View, error_view
from ph_post.units import MM, MM_PER_MIN
from ph_post.verify.verdict import Verdict

SHOWN: Final = 12
"""Rows of a table, and lines of a group of blocks, that are shown; JSON and HTML have all."""

Programs = tuple[PartProgram, PartProgram]


def diff_view(found: Comparison) -> View:
    """Return what ``diff --json`` prints; lines count from 1, lengths in mm, feeds in mm/min, times in s."""
    a, b = found.timing
    return {
        "same": found.same,
        "identical": found.identical,
        "tolerance": found.tolerance / MM,
        "files": [_file_view(found, k) for k in (0, 1)],
        "blocks": [_block_view(one, found.programs) for one in found.blocks],
        "geometry": {
            "max_deviation": None if found.max_deviation is None else found.max_deviation / MM,
            "without_declared": None if found.undone is None else found.undone / MM,
            "stretches": [_deviation_view(one) for one in found.deviations],
        },
        "feed": {"stretches": [_feed_view(one) for one in found.feeds]},
        "time": {
            "a": _timing_view(a),
            "b": _timing_view(b),
            "stretches": [
                {"a": _span(one.a), "b": _span(one.b), "time_a": one.time_a, "time_b": one.time_b}
                for one in found.times
            ],
        },
        "orders": [{"what": one.what, "a": _line(one.a), "b": _line(one.b)} for one in found.orders],
        **_predicted_view(found.predicted),
        "result_line": next(iter(diff_result(found)[-1:]), None),
        "notes": list(found.notes),
    }


def _predicted_view(found: PredictedErrors | None) -> View:
    if found is None:
        return {"error": None, "error_gap": None}
    (a, b), (gap_a, gap_b) = found.errors, found.gaps
    gap = {"a": error_view(gap_a), "b": error_view(gap_b), "b_worst": error_view(found.gap_worst)}
    return {"error": {"a": error_view(a), "b": error_view(b)}, "error_gap": gap}


def diff_result(found: Comparison) -> list[str]:
    """Return the line of the result, from A to B; nothing where no errors were predicted."""
    if found.predicted is None:
        return []
    a, b = found.timing
    summary = ResultSummary(
        time=(a.total, b.total),
        error=found.predicted.errors,
        error_gap=found.predicted.gaps,
        error_gap_worst=found.predicted.gap_worst,
        uncertainty=found.predicted.uncertainty,
        axes=declared_axes(found.programs[1]),
    )
    return result_lines(summary)


def _file_view(found: Comparison, k: int) -> View:
    program = found.programs[k]
    return {
        "name": program.name,
        "sha256": program.digest,
        "lines": program.blocks,
        "motions": int(program.motions.block.size),
        "length": found.travel.outlines[k].length / MM,
        "declares": list(found.declared[k]),
    }


def _line(block: int | None) -> int | None:
    return None if block is None else block + 1


def _span(span: Span) -> list[int] | None:
    """Return first and last line, None where there is none."""
    return None if span[1] < span[0] else [span[0] + 1, span[1] + 1]


def _block_view(one: BlockChange, programs: Programs) -> View:
    return {
        "kind": one.kind,
        "a": _span(one.a),
        "b": _span(one.b),
        "text_a": lines_of(programs[0], one.a),
        "text_b": lines_of(programs[1], one.b),
    }


def _deviation_view(one: Deviation) -> View:
    return {
        "a": _span(one.a),
        "b": _span(one.b),
        "s_a": [s / MM for s in one.s_a],
        "s_b": [s / MM for s in one.s_b],
        "deviation": one.amount / MM,
        "where": {"on": "ab"[one.worst], "line": one.block + 1},
        "position": [x / MM for x in one.where],
    }


def _feed_view(one: FeedChange) -> View:
    return {
        "a": _span(one.a),
        "b": _span(one.b),
        "s_a": [s / MM for s in one.s_a],
        "feed_a": _feeds(one.feed_a),
        "feed_b": _feeds(one.feed_b),
        "ratio": None if one.ratio is None else list(one.ratio),
    }


def _feeds(feeds: tuple[float, float] | None) -> list[float] | None:
    return None if feeds is None else [feed / MM_PER_MIN for feed in feeds]


def _timing_view(one: Timing) -> View:
    return {
        "total": one.total,
        "cutting": one.cutting,
        "rapids": one.rapids,
        "dwells": one.dwells,
        "model": one.model,
    }


def print_diff(found: Comparison) -> None:
    """Print what differs: first in short, then blocks, path, feed, time and the rest."""
    for line in diff_summary(found):
        click.secho(line, bold=True)
    for name, declared in zip("AB", found.declared, strict=True):
        for words in declared:
            click.echo(f"{name}: {words}")
    _print_blocks(found)
    _print_path(found)
    _print_feeds(found.feeds)
    _print_times(found)
    _print_orders(found.orders)
    _print_errors(found.predicted)
    for line in diff_result(found):
        click.echo(line)


def diff_summary(found: Comparison) -> list[str]:
    """Say in one line what differs; with a machine, the predicted errors come first."""
    a, b = found.programs
    if found.identical:
        return [f"{a.name} and {b.name} are identical"]
    if found.same:
        written = sum(1 for one in found.blocks if one.kind == "writing")
        how = "only the spelling differs" if written == len(found.blocks) else "other words, the same motion"
        return [f"{a.name} and {b.name} do the same: {how}"]
    telling = [one for one in found.blocks if one.kind != "writing"]
    parts = [
        _error_words(found),
        _path_words(found),
        _some(len(telling), "changed group of blocks", "changed groups of blocks"),
        _some(len(found.feeds), "stretch with another feed", "stretches with another feed"),
        _some(len(found.orders), "other command", "other commands"),
    ]
    return [f"{a.name} and {b.name} differ: " + ", ".join(part for part in parts if part)]


def _some(number: int, one: str, many: str) -> str:
    return counted(number, one, many) if number else ""


def _error_words(found: Comparison) -> str:
    if found.predicted is None:
        return ""
    a, b = (None if one is None else one.max for one in found.predicted.errors)
    return f"largest error {micrometres(a)} µm for A, {micrometres(b)} µm for B"


def _path_words(found: Comparison) -> str:
    if found.max_deviation is None:
        return "one of them has no motion" if len(found.travel.gaps) else ""
    if not found.deviations:
        return "the same tool path"
    return f"tool paths up to {_distance(found.max_deviation)} apart"


def _distance(length: float) -> str:
    """Write a distance of paths with its unit: errors are of µm, paths of two parts are mm apart."""
    return f"{millimetres(length)} mm" if length >= MM else f"{micrometres(length)} µm"


def _print_blocks(found: Comparison) -> None:
    """Print the blocks that differ, coloured as by ``diff -u``; count those that only spell it differently."""
    telling = [one for one in found.blocks if one.kind != "writing"]
    for one in telling[:SHOWN]:
        click.secho(f"@@ {_where(one.a)} | {_where(one.b)} @@", fg="cyan")
        for k, sign, colour in ((0, "-", "red"), (1, "+", "green")):
            for text in _few(lines_of(found.programs[k], (one.a, one.b)[k])):
                click.secho(f"{sign}{text}", fg=colour)
    _say_rest(len(telling) - SHOWN, "groups of blocks")
    written = len(found.blocks) - len(telling)
    if written:
        click.echo(f"{counted(written, 'group')} of blocks differ in comments, blanks or spelling only")


def _few(lines: Sequence[str]) -> list[str]:
    """Return the lines that are shown, and how many more there are."""
    if len(lines) <= SHOWN:
        return list(lines)
    return [*lines[: SHOWN - 1], f"... {len(lines) - SHOWN + 1} more"]


def _where(span: Span) -> str:
    if span[1] < span[0]:
        return f"before {span[0] + 1}"
    return f"{span[0] + 1}" if span[0] == span[1] else f"{span[0] + 1}-{span[1] + 1}"


def _say_rest(number: int, what: str) -> None:
    if number > 0:
        click.echo(f"and {number} more {what}; --json and --html have all")


def _print_path(found: Comparison) -> None:
    if found.undone is not None:
        click.echo(f"without the declared compensation the tool paths are {_distance(found.undone)} apart")
    if not found.deviations:
        return
    click.secho("tool path, where it deviates (places in mm):", bold=True)
    worst = sorted(found.deviations, key=lambda one: -one.amount)[:SHOWN]
    rows = [
        (
            _where(one.a),
            _where(one.b),
            *map(millimetres, one.s_a),
            micrometres(one.amount),
            f"{'AB'[one.worst]}:{one.block + 1}",
            *map(millimetres, one.where),
        )
        for one in sorted(worst, key=lambda one: one.s_a)
    ]
    _print_table(("lines of A", "lines of B", "from s", "to s", "deviation µm", "at line", "X", "Y", "Z"), rows)
    _say_rest(len(found.deviations) - SHOWN, "stretches, all closer")


def _print_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    click.echo(format_table(header, rows))


def _print_feeds(feeds: Sequence[FeedChange]) -> None:
    if not feeds:
        return
    click.secho("feed, where it differs (mm/min):", bold=True)
    rows = [
        (
            _where(one.a),
            _where(one.b),
            *map(millimetres, one.s_a),
            _between(_feeds(one.feed_a)),
            _between(_feeds(one.feed_b)),
            _between(None if one.ratio is None else list(one.ratio)),
        )
        for one in feeds[:SHOWN]
    ]
    _print_table(("lines of A", "lines of B", "from s", "to s", "A", "B", "ratio"), rows)
    _say_rest(len(feeds) - SHOWN, "stretches")


def _between(values: Sequence[float] | None) -> str:
    if values is None:
        return NOTHING
    low, high = (f"{value:.4g}" for value in values)
    return low if low == high else f"{low} to {high}"


def _print_times(found: Comparison) -> None:
    a, b = found.timing
    if not found.times:
        return
    click.secho(f"time: {seconds(a.total)} s for A, {seconds(b.total)} s for B ({time_words(a)})", bold=True)
    worst = sorted(found.times, key=lambda one: -abs(one.time_b - one.time_a))[:SHOWN]
    rows = [
        (
            _where(one.a),
            _where(one.b),
            seconds(one.time_a),
            seconds(one.time_b),
            f"{one.time_b - one.time_a:+.3f}",
        )
        for one in sorted(worst, key=lambda one: (one.a, one.b))
    ]
    _print_table(("lines of A", "lines of B", "A s", "B s", "B - A s"), rows)
    _say_rest(len(found.times) - SHOWN, "stretches, with smaller changes")


def time_words(timing: Timing) -> str:
    """Name the model of the times."""
    if timing.model == "controller":
        return "by the model of the controller"
    rapids = "rapid moves ignored" if timing.rapids is None else "rapid moves at the speed of the machine"
    return f"length over feed, {rapids}, no ramps"


def _print_orders(orders: Sequence[CommandChange]) -> None:
    if not orders:
        return
    click.secho("other commands:", bold=True)
    for one in orders[:SHOWN]:
        if one.b is None:
            click.secho(f"- A:{_line(one.a)}: {one.what}", fg="red")
        elif one.a is None:
            click.secho(f"+ B:{_line(one.b)}: {one.what}", fg="green")
        else:
            click.secho(f"! A:{_line(one.a)}, B:{_line(one.b)}: {one.what}", fg="yellow")
    _say_rest(len(orders) - SHOWN, "commands")


def _print_errors(found: PredictedErrors | None) -> None:
    if found is None:
        return
    click.secho("predicted contour error, from the path of A or of the original that is declared:", bold=True)
    rows = [
        (name, NOTHING, NOTHING) if one is None else (name, micrometres(one.max), micrometres(one.rms))
        for name, one in zip("AB", found.errors, strict=True)
    ]
    _print_table(("", "max µm", "rms µm"), rows)


def page_view(found: Comparison) -> dict[str, Any]:
    """Return the data of the page without its pictures."""
    return {**diff_view(found), "summary": diff_summary(found)}


FAILURES_SHOWN = 20
"""Failures that are listed as text at most."""


CHECKED: Final[Mapping[str, str]] = {
    "states": "modal states",
    "breaks": "tool changes and their like",
    "jogs": "moves of one axis",
    "changes": "marked changes",
    "stretches": "replaced stretches",
    "feeds": "feed words",
    "led": "led stretches",
}
"""What a verdict counts, where a person needs more words than its key."""


def verdict_lines(verdict: Verdict) -> list[str]:
    """List the failures, and what was checked."""
    looked = ", ".join(f"{number} {CHECKED.get(name, name)}" for name, number in verdict.checked.items() if number)
    seen = f"checked: {looked or 'the header'}"
    if verdict.ok:
        return ["ok: only the declared changes were made", seen]
    lines = [failure.sentence() for failure in verdict.failures[:FAILURES_SHOWN]]
    if verdict.found > len(lines):
        lines.append(f"and {verdict.found - len(lines)} more")
    return [*lines, f"failed: {counted(verdict.found, 'failure')}", seen]


def verdict_view(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict as a JSON object."""
    return {
        "ok": verdict.ok,
        "failures": [msgspec.to_builtins(failure) for failure in verdict.failures],
        "found": verdict.found,
        "checked": dict(verdict.checked),
    }
