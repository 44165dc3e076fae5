"""Page and figure of the comparison of two programs; the page is one file and needs no network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from ph_post.diff.compare import Comparison
from ph_post.diff.curves import ANGLE, ORDER, CurveTable
from ph_post.diff.paths import ComparedPaths, PathSamples
from ph_post.gcode.program import RAPID, PartProgram
from ph_post.geometry.closest import points_at
from ph_post.report.diffs import Programs, diff_summary, page_view
from ph_post.report.figures import TWO, draw_moves, legend_above, magnification, new_figure, steps_of
from ph_post.report.page import evenly, lowest_and_highest, make_page, numbers
from ph_post.types import Array, BoolArray
from ph_post.units import MICROMETRE, MM, MM_PER_MIN

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


POINTS: Final = 30_000
"""Points of a path that are drawn at most."""

STEPS: Final = 10_000
"""Steps of the feed that are drawn at most: of more, lowest and highest of neighbours."""


def diff_page(found: Comparison) -> str:
    """Return the page."""
    data = {
        **page_view(found),
        "path": path_points(found.travel.outlines[0], found.programs[0]),
        "off": [] if found.travel.sides is None else [places_off(found.travel, found.programs, k) for k in (0, 1)],
        "speed": [feed_steps(found.travel, found.programs, k) for k in (0, 1)],
    }
    return make_page("diff", "ph-post diff", data, diff_summary(found))


def path_points(outline: CurveTable, program: PartProgram) -> dict[str, Any]:
    """Points of the first path [mm], with the line of each and whether it is reached in a rapid move."""
    if len(outline.table) == 0:
        return {"x": [], "y": [], "z": [], "s": [], "line": [], "rapid": []}
    table = outline.table
    parts = np.maximum(1, np.ceil(np.abs(table[:, ANGLE]) / np.pi * 32)).astype(np.int64)
    parts = np.where(table[:, ORDER] > 0.0, 24, parts)
    piece = np.repeat(np.arange(len(table)), parts)
    first = np.cumsum(parts) - parts
    u = (np.arange(piece.size) - first[piece] + 1) / parts[piece]
    piece, u = np.append(0, piece), np.append(0.0, u)
    kept = evenly(piece.size, POINTS)
    points = points_at(outline.pieces, outline.control, piece[kept], u[kept])
    motion = outline.motion[piece[kept]]
    # Of splines the way is that of an even run through the parameter.
    ways = outline.s[piece[kept]] + u[kept] * np.diff(outline.s)[piece[kept]]
    return {
        **_columns(points),
        "s": numbers(ways / MM, 4),
        "line": (program.motions.block[motion] + 1).tolist(),
        "rapid": (program.motions.kind[motion] == RAPID).astype(int).tolist(),
    }


def _columns(points: Array, names: Sequence[str] = "xyz", decimals: int = 5) -> dict[str, Any]:
    return {name: numbers(points[:, k] / MM, decimals) for k, name in enumerate(names)}


def places_off(travel: ComparedPaths, programs: Programs, k: int) -> dict[str, Any]:
    """Where one path is not the other: the other's places [mm], and what is between, to be magnified."""
    assert travel.sides is not None
    side: PathSamples = travel.sides[k]
    kept = evenly(side.deviation.size, POINTS)
    stretch = np.repeat(np.arange(side.samples.stretch.size - 1), np.diff(side.samples.stretch))
    away = (side.samples.points - side.closest_points)[kept]
    motions, motion = programs[k].motions, side.motion(kept)
    return {
        **_columns(side.closest_points[kept]),
        **_columns(away, ("dx", "dy", "dz"), 7),
        "s": numbers((side.samples.ways if k == 0 else side.closest_ways)[kept] / MM, 4),
        "line": (motions.block[motion] + 1).tolist(),
        "rapid": (motions.kind[motion] == RAPID).astype(int).tolist(),
        "stretch": stretch[kept].tolist(),
    }


def feed_steps(travel: ComparedPaths, programs: Programs, k: int) -> dict[str, Any]:
    """Programmed feed along the first path [mm/min], as steps from one way to the next [mm]."""
    outline, motions = travel.outlines[k], programs[k].motions
    if motions.kind.size == 0:
        return {"s": [], "feed": []}
    with np.errstate(divide="ignore", invalid="ignore"):
        timed = outline.lengths() / motions.duration
    feed = np.where(motions.duration > 0.0, timed, motions.feed)
    feed = np.where((motions.kind == RAPID) | ~np.isfinite(feed), np.nan, feed)
    ways = _on_first(travel, outline.s[outline.first]) if k else outline.s[outline.first]
    starts, feed = _steps(ways, feed)
    return {
        "s": numbers(starts / MM, 4),
        "feed": numbers(feed / MM_PER_MIN, 3),
    }


def _on_first(travel: ComparedPaths, ways: Array) -> Array:
    """Ways along the second path as ways along the first, evenly where the paths differ [m]."""
    here = np.flatnonzero(travel.found >= 0)
    a, b = travel.outlines
    known_a = np.concatenate([[0.0], a.s[a.first[here]], a.s[a.first[here + 1]], [a.length]])
    there = travel.found[here]
    known_b = np.concatenate([[0.0], b.s[b.first[there]], b.s[b.first[there + 1]], [b.length]])
    order = np.lexsort((known_a, known_b))
    return np.asarray(np.interp(ways, known_b[order], known_a[order]))


def _steps(ways: Array, feed: Array) -> tuple[Array, Array]:
    """Return the ends of the steps, one more than feeds; many of them as lowest and highest of neighbours."""
    if feed.size <= STEPS:
        return ways, feed
    group = -(-feed.size // (STEPS // 2))
    firsts = np.arange(0, feed.size, group)
    starts = np.append(ways[firsts], ways[-1])
    middles = 0.5 * (starts[:-1] + starts[1:])
    edges = np.append(np.stack([starts[:-1], middles], axis=1).ravel(), ways[-1])
    return edges, lowest_and_highest(feed, firsts).T.ravel()


def draw_diff(found: Comparison) -> Figure:
    """Draw the tool path of A with B's deviations magnified, and deviation and feeds along A."""
    figure = new_figure(12.0, 5.6)
    panels = figure.subplot_mosaic([["path", "off"], ["path", "feed"]], width_ratios=(1.0, 1.2))
    path = path_points(found.travel.outlines[0], found.programs[0])
    off = [] if found.travel.sides is None else [places_off(found.travel, found.programs, k) for k in (0, 1)]
    _draw_path(panels["path"], path, off, found.max_deviation or 0.0)
    panels["off"].sharex(panels["feed"])
    for one, colour in zip(off, TWO, strict=False):
        away = np.linalg.norm(np.array([one["dx"], one["dy"], one["dz"]]), axis=0) * (MM / MICROMETRE)
        line = steps_of(np.array([one["s"], away]), _on_the_way(one["stretch"]))
        panels["off"].plot(*line, color=colour, linewidth=1.0)
    for k, (name, colour) in enumerate(zip("AB", TWO, strict=True)):
        steps = feed_steps(found.travel, found.programs, k)
        values = np.array([np.nan if one is None else one for one in steps["feed"]], dtype=np.float64)
        if values.size:
            panels["feed"].stairs(values, steps["s"], color=colour, baseline=None, label=name)
    panels["off"].set(ylabel="deviation [µm]")
    panels["feed"].set(xlabel="along A [mm]", ylabel="programmed feed [mm/min]")
    legend_above(panels["feed"])
    figure.suptitle("\n".join(diff_summary(found)), fontsize="medium", wrap=True)
    return figure


def _draw_path(axes: Axes, path: dict[str, Any], off: list[dict[str, Any]], most: float) -> None:
    places = np.array([path["x"], path["y"]], dtype=np.float64)
    rapid = np.array(path["rapid"], dtype=bool)
    draw_moves(axes, places, np.ones(rapid.size, dtype=bool), rapid, TWO[0], "A")
    extent = float(np.ptp(places, axis=1).max()) if places.size else 0.0
    factor = magnification(extent * MM, most)
    for one, colour in zip(off[1:], TWO[1:], strict=False):
        moved = np.array([one["x"], one["y"]]) + factor * np.array([one["dx"], one["dy"]])
        rapid = np.array(one["rapid"], dtype=bool)
        steps = _on_the_way(one["stretch"])
        draw_moves(axes, moved, steps, rapid, colour, f"B, deviation × {factor:g}")
    axes.set(xlabel="X [mm]", ylabel="Y [mm]")
    axes.set_aspect("equal", adjustable="datalim")
    legend_above(axes)


def _on_the_way(stretch: list[int]) -> BoolArray:
    """Return whether the steps of a line stay in one stretch."""
    return np.asarray(np.diff(stretch, prepend=-1) == 0)
