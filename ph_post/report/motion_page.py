"""Page of a motion before and after compensation: path, error, feed and reversals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from msgspec.structs import replace

from ph_post.compensate.strategies.registry import PLAIN
from ph_post.drive.axes import has_backlash
from ph_post.quantities import NOTHING, micrometres, millimetres
from ph_post.report.page import evenly, make_page, numbers, rows_to_draw
from ph_post.report.result_line import ResultSummary, off_words, result_lines
from ph_post.report.tables import format_table
from ph_post.report.traces import DrawnMotion, Mark, Picture
from ph_post.report.views import View, error_view, machine_table
from ph_post.simulate.assess import scenario_words
from ph_post.simulate.contour import ContourError, TurningError
from ph_post.types import IntArray
from ph_post.units import MICROMETRE, MM, MM_PER_MIN
from ph_post.version import package_version

ROWS: Final = 10_000
"""Rows that a motion is drawn with at most, apart from those that show the error of a turning point."""

LENGTHS: Final = 5
"""Decimals of places [mm]: also of the whole length, so that no place lies behind it."""

MARKS: Final = 2_000
"""Turning points that are listed at most: of more, those with the largest errors."""


def motion_page(picture: Picture) -> str:
    """Return the page."""
    picture, left_out = _listed(picture)
    title = f"ph-post report {picture.name}"
    return make_page("motion", title, motion_view(picture, left_out), motion_lines(picture))


def motion_view(picture: Picture, notes: Sequence[str]) -> View:
    """Return the page's data: lengths in mm, errors in µm, feeds in mm/min, times in s; more `notes` last."""
    kept = [_rows(picture, trace) for trace in picture.traces]
    return {
        "name": picture.name,
        "kind": picture.kind,
        "axes": list(picture.axes),
        "length": round(picture.length / MM, LENGTHS),
        "strategy": picture.strategy,
        "version": package_version(),
        "summary": motion_summary(picture),
        "result": _result(picture.summary),
        "windowed": picture.windowed,
        "machine": machine_table(picture.machine, picture.axes),
        "warnings": [*result_lines(picture.summary)[:-1], *picture.warnings],
        "notes": [*_side_words(picture), *picture.notes, *_thinned(picture, kept), *notes],
        "path": _path(picture, kept),
        "points": [_point(picture, number) for number in range(len(picture.marks))],
        "runs": [_run(picture, trace, rows) for trace, rows in zip(picture.traces, kept, strict=True)],
    }


def motion_summary(picture: Picture) -> str:
    """Summarize a motion in a sentence, the line that every command ends with."""
    return f"{picture.name}: {result_lines(picture.summary)[-1]}"


def _result(found: ResultSummary) -> View:
    """Return what the line of result has for the page's tiles: errors in µm, and how far off the backlash may be."""
    before, after = found.error_gap
    known = before is not None and after is not None
    return {
        "before": _sizes(before) if known else None,
        "after": _sizes(after) if known else None,
        "worst": None if found.error_gap_worst is None else found.error_gap_worst.max / MICROMETRE,
        "spread": off_words(found.uncertainty),
        "reversals": None if found.reversals is None else found.reversals._asdict(),
        "axes": list(found.axes),
    }


def _side_words(picture: Picture) -> list[str]:
    """Say how far the table is to the left and to the right of the path, where an error has a side."""
    path = "the path, in its plane" if "Z" in picture.axes else "the path"
    return [
        f"{name}: at most {micrometres(side[0])} µm to the left and {micrometres(side[1])} µm to the right of {path}"
        for name, side in zip(("original", "compensated"), picture.summary.sides, strict=True)
        if side is not None and any(side)
    ][: len(picture.traces)]


def _sizes(error: ContourError | None) -> View | None:
    return None if error is None else {"max": error.max / MICROMETRE, "rms": error.rms / MICROMETRE}


def motion_lines(picture: Picture) -> list[str]:
    """Return the summary, the reversals and the warnings as lines, for a reader without scripts."""
    header = ("#", "axis", "sense", "s mm", "strategy", *(f"{one.name} µm" for one in picture.traces))
    rows = [
        (
            str(mark.view["index"]),
            mark.view["axis"],
            mark.view["sense"],
            millimetres(mark.s),
            _done(picture, mark),
            *(_cell(one.turning[k]) for one in picture.traces),
        )
        for k, mark in enumerate(picture.marks)
    ]
    table = [format_table(header, rows)] if rows else ["no axis reverses"]
    warnings = (*picture.notes, *(f"warning: {text}" for text in picture.warnings))
    return [*result_lines(picture.summary)[:-1], motion_summary(picture), *table, *warnings]


def _done(picture: Picture, mark: Mark) -> str:
    """Say what is done at a turning point: an axis without backlash has nothing to be compensated."""
    axis = picture.machine.axes.get(mark.view["axis"])
    if mark.view["strategy"] != PLAIN:
        return str(mark.view["strategy"])
    return "not compensated" if axis is None or has_backlash(axis) else "no backlash"


def _cell(error: TurningError | None) -> str:
    return NOTHING if error is None else micrometres(error.max)


def _listed(picture: Picture) -> tuple[Picture, list[str]]:
    """List the reversals with the largest errors where there are too many, with a note."""
    count = len(picture.marks)
    if count <= MARKS:
        return picture, []
    sizes = [[0.0 if one is None else one.max for one in trace.turning] for trace in picture.traces]
    worst = np.max(np.array(sizes), axis=0)
    kept = np.sort(np.argsort(-worst, kind="stable")[:MARKS]).tolist()
    traces = tuple(replace(trace, turning=tuple(trace.turning[k] for k in kept)) for trace in picture.traces)
    words = f"of {count} reversals the {MARKS} with the largest errors are listed and marked"
    return replace(picture, marks=tuple(picture.marks[k] for k in kept), traces=traces), [words]


def _rows(picture: Picture, trace: DrawnMotion) -> IntArray:
    """Choose the rows that are drawn: those with the error that the table lists are always among them."""
    listed = np.array([one.extreme for one in trace.turning if one is not None])
    largest = [] if trace.size is None else [np.flatnonzero(trace.counted & (np.abs(trace.error) == trace.size.max))]
    always = np.flatnonzero(np.isin(trace.error, listed) & trace.counted)
    every = np.concatenate([always[: 2 * ROWS], *largest])
    return rows_to_draw(trace.error, trace.feed, picture.inside(trace.s), every, ROWS)


def _thinned(picture: Picture, kept: Sequence[IntArray]) -> list[str]:
    return [
        f"{trace.name}: {rows.size} of {trace.t.size} samples are drawn, closer at reversals; the largest and "
        "smallest errors and feeds are among them, and lines between them are straight"
        for trace, rows in zip(picture.traces, kept, strict=True)
        if rows.size < trace.t.size
    ]


def _path(picture: Picture, kept: Sequence[IntArray]) -> View:
    """Points of the path [mm] at the places that are drawn, and its rapid stretches."""
    drawn = [trace.s[rows] for trace, rows in zip(picture.traces, kept, strict=True)]
    marks = [np.array([mark.s, *(mark.window or ())]) for mark in picture.marks]
    thinned = [one[evenly(one.size, ROWS)] for one in (np.unique(np.concatenate(drawn)), picture.joints)]
    fine = np.concatenate([*thinned, *marks])
    s = np.unique(np.clip(fine, 0.0, picture.length).round(9))
    points = picture.points(s)
    return {
        "s": numbers(s / MM, LENGTHS),
        **{name: numbers(points[:, k] / MM, LENGTHS) for k, name in enumerate("xyz"[: len(picture.axes)])},
        "rapid": [[begin / MM, end / MM] for begin, end in picture.rapids[:ROWS]],
        "unknown": [[begin / MM, end / MM] for begin, end in picture.unknown],
        "closed": picture.closed,
    }


def _run(picture: Picture, trace: DrawnMotion, rows: IntArray) -> View:
    names = "xyz"[: len(picture.axes)]
    worst = None if trace.worst_scenario is None else scenario_words(trace.worst_scenario)
    return {
        "name": trace.name,
        "time": trace.time,
        "error": error_view(trace.size),
        "worst": error_view(trace.worst),
        "worst_words": worst,
        "assumed": scenario_words(trace.run.scenario),
        "samples": trace.t.size,
        "t": numbers(trace.t[rows], 6),
        "s": numbers(trace.s[rows] / MM, LENGTHS),
        "feed": numbers(np.where(picture.known(trace.s[rows]), trace.feed[rows] / MM_PER_MIN, np.nan), 3),
        "e": numbers(trace.error[rows] / MICROMETRE, 4),
        **{name: numbers(trace.foot[rows, k] / MM, LENGTHS) for k, name in enumerate(names)},
        **{f"d{name}": numbers(trace.away[rows, k] / MM, 7) for k, name in enumerate(names)},
        "counted": trace.counted[rows].astype(int).tolist(),
        "line": None if trace.line is None else trace.line[rows].tolist(),
    }


def _point(picture: Picture, number: int) -> View:
    mark: Mark = picture.marks[number]
    view = mark.view
    backlash = view["backlash"]
    return {
        **{key: view[key] for key in ("index", "kind", "axis", "sense", "strategy", "ratio")},
        "done": _done(picture, mark),
        "line": view.get("line"),
        "s": mark.s / MM,
        "at": [x / MM for x in mark.point],
        "window": None if mark.window is None or not picture.windowed else [end / MM for end in mark.window],
        "half": None if view["window"] is None else view["window"]["half_length"],
        "limited_by": None if view["window"] is None else view["window"]["limited_by"],
        "lag": None if backlash is None else 1e3 * backlash["lag"],
        "duration": None if backlash is None else 1e3 * backlash["duration"],
        "errors": [_turning(trace.turning[number]) for trace in picture.traces],
        "notes": list(dict.fromkeys([*(_said(view) if picture.windowed else []), *view["notes"]])),
    }


def _said(view: View) -> list[str]:
    window = [] if view["window"] is None else view["window"]["notes"]
    return [*([view["note"]] if view["note"] else []), *window]


def _turning(error: TurningError | None) -> float | None:
    return None if error is None else error.max / MICROMETRE
