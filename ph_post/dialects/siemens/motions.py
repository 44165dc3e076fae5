"""Put polynomials, circles through a point and changing feeds into motions that were read as straight."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.dialects.reading import motion_rows
from ph_post.dialects.siemens.words import CircleWords, Extras, FeedProfileWords, PolynomialWords
from ph_post.gcode.arcs import swept_angle
from ph_post.gcode.blocks import Feed
from ph_post.gcode.curves import curves_of
from ph_post.gcode.motion_parts import place
from ph_post.gcode.program import ARC, AXES, LINE, NURBS, PLANE_AXES, RAPID, Motions, NurbsData, PartProgram, feed_runs
from ph_post.geometry.bernstein import from_power, restrict
from ph_post.geometry.piecewise import MEETS
from ph_post.types import Array, IntArray, sealed
from ph_post.units import MINUTE, MS

_MOST_PARTS: Final = 64
"""Most parts of a motion whose feed changes; each part has one feed."""

_LONGEST_PART: Final = 5.0 * MS
"""Longest part of a motion whose feed changes [s]."""

_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(8)


def with_extras(program: PartProgram, extras: Extras) -> tuple[PartProgram, dict[int, str]]:
    """Return a program with its polynomials, circles and changing feeds.

    The lines are returned too, with the reason, that are not to be followed: a denominator or a feed is not positive,
    a feed changes from an unknown one or on an unknown way, or a circle leaves its plane.
    """
    motions, refused = _with_curves(program, extras)
    found, more = _with_profiles(replace(program, motions=motions), extras.profiles)
    return found, refused | more


def _with_curves(program: PartProgram, extras: Extras) -> tuple[Motions, dict[int, str]]:
    motions = program.motions
    kind, center, angle = motions.kind.copy(), motions.center.copy(), motions.angle.copy()
    nurbs, refused = dict(motions.nurbs), {}
    for line, row in motion_rows(motions, extras.polynomials):
        units = program.modal_after(line).units
        found = _bezier(motions, row, extras.polynomials[line], units)
        if found is not None:
            if not (found[2] > 0.0).all():
                refused[line] = _named(program, line, "denominator with a zero")
            kind[row], nurbs[row] = NURBS, found
    for line, row in motion_rows(motions, extras.circles):
        units = program.modal_after(line).units
        swept = _through(motions, row, extras.circles[line], units)
        if swept is None:
            refused[line] = _named(program, line, "circle in space, or from an unknown position")
            continue
        kind[row] = ARC
        center[row], angle[row] = swept
    return replace(motions, kind=sealed(kind), center=sealed(center), angle=sealed(angle), nurbs=nurbs), refused


def _named(program: PartProgram, line: int, what: str) -> str:
    return f"{what}: {program.text(line).decode('utf-8', 'replace').strip()}"


def _bezier(motions: Motions, row: int, given: PolynomialWords, units: float) -> NurbsData | None:
    """Control points and weights of a POLY block; None where it begins nobody knows where."""
    start, end = motions.start[row], motions.end[row]
    if any(np.isnan(start[AXES.index(name)]) for name in given.axes):
        return None
    size = max(2, *(len(values) + 2 for values in given.axes.values()), len(given.below) + 1)
    domain = (0.0, given.length)
    below = np.ones(size)
    if given.below:
        below = from_power(_power(1.0, given.below[0], given.below[1:], given.length, size), domain)
    above = np.outer(start, below)
    for name, values in given.axes.items():
        axis = AXES.index(name)
        scaled = tuple(units * value for value in values)
        last = float(end[axis] * below[-1])
        above[axis] = from_power(_power(float(start[axis]), last, scaled, given.length, size), domain)
    return size, (above / below).T, below


def _power(first: float, last: float, values: tuple[float, ...], length: float, size: int) -> Array:
    """Power coefficients of given ends and coefficients from the second on."""
    power = np.zeros(size)
    power[0], power[2 : 2 + len(values)] = first, values
    power[1] = (last - first - float(power[2:] @ length ** np.arange(2, size))) / length
    return power


def _through(motions: Motions, row: int, given: CircleWords, units: float) -> tuple[Array, float] | None:
    """Centre and angle of a circle through a point; None where there is none in the plane."""
    start, end = motions.start[row], motions.end[row]
    point = start.copy()
    for name, value in given.point.items():
        axis = AXES.index(name)
        point[axis] = units * value + (0.0 if given.absolute else start[axis])
    first, second, third = PLANE_AXES[int(motions.plane[row])]
    a, b, c = (one[[first, second]] for one in (start, point, end))
    off = np.abs([point[third] - start[third], end[third] - start[third]])
    if (off > MEETS).any() or np.isnan([*a, *b, *c]).any():
        return None
    across = 2.0 * float(np.linalg.det(np.stack([b - a, c - a])))
    if abs(across) <= MEETS * float(np.linalg.norm(c - a) + np.linalg.norm(b - a)):
        return None
    p, q = float((b - a) @ (b - a)), float((c - a) @ (c - a))
    middle = a + np.array([p * (c - a)[1] - q * (b - a)[1], q * (b - a)[0] - p * (c - a)[0]]) / across
    turned = float(swept_angle(a - middle, c - middle))
    return middle, turned if across > 0.0 else turned - math.tau


class _Parts(msgspec.Struct, frozen=True, kw_only=True):
    """A motion in parts: shares at their ends, and the feed of each [m/s]."""

    edges: Array
    feeds: Array


def _with_profiles(
    program: PartProgram, profiles: Mapping[int, FeedProfileWords]
) -> tuple[PartProgram, dict[int, str]]:
    """Divide motions whose feed changes into parts of one feed, so that all parts take their time."""
    motions = program.motions
    divided: dict[int, _Parts] = {}
    refused: dict[int, str] = {}
    for line, row in motion_rows(motions, profiles):
        if line > 0 and motions.kind[row] != RAPID and not math.isnan(motions.feeds.at(row)):
            speed = program.modal_after(line).units / MINUTE
            before = program.feed_after(line - 1) * speed
            found = None if np.isnan(before) else _parts(motions, row, before, profiles[line], speed)
            if found is None:
                refused[line] = _named(program, line, "feed of an unknown course")
            else:
                if not (found.feeds > 0.0).all():
                    refused[line] = _named(program, line, "feed that falls to zero")
                divided[row] = found
    if not divided:
        return program, refused
    counts = np.ones(motions.kind.size, dtype=np.int64)
    for row, parts in divided.items():
        counts[row] = parts.feeds.size
    first = np.concatenate([[0], np.cumsum(counts)])
    breaks = tuple(replace(one, motion=int(first[one.motion])) for one in program.breaks)
    return replace(program, motions=_expanded(motions, divided, first), breaks=breaks), refused


def _parts(motions: Motions, row: int, before: float, profile: FeedProfileWords, speed: float) -> _Parts | None:
    feed = Feed(start=before, end=speed * profile.end, quad=speed * profile.quad, cub=speed * profile.cub)
    start, end = motions.start[row], motions.end[row]
    if (np.isnan(start) != np.isnan(end)).any() or np.isnan(end - start).all():
        return None
    if not (feed.at(np.linspace(0.0, 1.0, 65)) > 0.0).all():
        return _Parts(edges=np.array([0.0, 1.0]), feeds=np.zeros(1))
    if motions.kind[row] == LINE and np.linalg.norm(np.nan_to_num(end - start)) <= MEETS:
        # The feed has changed when it comes to the next block, and nothing has moved.
        return _Parts(edges=np.array([0.0, 1.0]), feeds=np.array([feed.end]))
    length = sum(curve.length for curve in curves_of(motions, row, (0, 1, 2)))
    times = _times(feed, np.linspace(0.0, 1.0, _MOST_PARTS + 1)) * length
    count = int(np.clip(math.ceil(times.sum() / _LONGEST_PART - 1e-9), 1, _MOST_PARTS))
    edges = np.linspace(0.0, 1.0, count + 1)
    return _Parts(edges=edges, feeds=np.diff(edges) / _times(feed, edges))


def _times(feed: Feed, edges: Array) -> Array:
    """∫ dp / feed between neighbouring edges."""
    half, middle = 0.5 * np.diff(edges), 0.5 * (edges[1:] + edges[:-1])
    places = middle[:, None] + half[:, None] * _NODES
    return np.asarray(half * ((1.0 / feed.at(places)) @ _WEIGHTS))


def _expanded(motions: Motions, divided: Mapping[int, _Parts], first: IntArray) -> Motions:
    source = np.repeat(np.arange(motions.kind.size), np.diff(first))
    columns = {
        name: getattr(motions, name)[source].copy()
        for name in Motions.__struct_fields__
        if name not in ("feeds", "control", "nurbs")
    }
    feed = np.array(motions.feeds.of(source))
    nurbs = {int(first[row]): one for row, one in motions.nurbs.items() if row not in divided}
    for row, parts in divided.items():
        rows = slice(int(first[row]), int(first[row + 1]))
        feed[rows] = parts.feeds
        if motions.kind[row] == NURBS:
            pieces = _pieces(motions, row, parts.edges)
            nurbs |= zip(range(rows.start, rows.stop), pieces, strict=True)
            inner = [control[-1] for _, control, _ in pieces[:-1]]
        else:
            inner = [place(motions, row, share) for share in parts.edges[1:-1].tolist()]
        if motions.kind[row] == ARC:
            columns["angle"][rows] = motions.angle[row] * np.diff(parts.edges)
        points = np.array([motions.start[row], *inner, motions.end[row]])
        columns["start"][rows], columns["end"][rows] = points[:-1], points[1:]
    control = {int(first[row]): one for row, one in motions.control.items()}
    whole = {name: sealed(column) for name, column in columns.items()}
    return Motions(**whole, feeds=feed_runs(feed), control=control, nurbs=nurbs)


def _pieces(motions: Motions, row: int, edges: Array) -> list[NurbsData]:
    """Cut a polynomial or rational curve at shares of its length."""
    order, control, weights = motions.nurbs[row]
    (curve,) = curves_of(motions, row, (0, 1, 2))
    places = curve.parameter(edges * curve.length)
    places[0], places[-1] = 0.0, 1.0
    net = np.vstack([(control * weights[:, None]).T, weights])
    found = []
    for low, high in zip(places[:-1].tolist(), places[1:].tolist(), strict=True):
        part = restrict(net, low, high)
        found.append((order, (part[:-1] / part[-1]).T, part[-1]))
    return found
