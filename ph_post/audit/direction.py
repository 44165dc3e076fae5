"""Whether an axis that carries the offset of one direction moves that way, but for small excursions."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ph_post.audit.case import Case
from ph_post.audit.outline import outline
from ph_post.audit.pairing import Pairing
from ph_post.gcode.reader.record import ARC, AXES, CUBIC, NURBS, Motions, plane_columns
from ph_post.simulate.compiling import compiled, inner
from ph_post.types import Array, IntArray
from ph_post.units import MM

_SPARE = 1.01
"""Excursions may be longer than the dead band by this factor: rounding of the places where an axis turns."""

_SAGITTA = 1e-3 * MM
"""Splines are followed in chords that leave them by no more than this [m]."""

SignArray = NDArray[np.int8]

_SKIP = -1
"""The chain of a jog."""


def check_direction(case: Case, pairing: Pairing) -> None:
    """Demand that no axis moves back farther than the dead band under the offset of its other direction.

    The dead band is the tolerance, or the offset itself where that is more: to follow an excursion that is
    smaller than the lost motion is nobody's duty.
    """
    motions = case.compensated.motions
    curves = np.isin(motions.kind, (CUBIC, NURBS))
    lines = outline(motions, np.flatnonzero(curves), _SAGITTA)
    first = np.zeros(motions.kind.size + 1, dtype=np.int32)
    first[1:][curves] = np.diff(lines.first)
    np.cumsum(first, out=first)
    chain = np.where(pairing.jog, _SKIP, motions.chain)
    for name, amount in case.declared.offsets.items():
        axis, band = AXES.index(name), max(case.band, amount.metres)
        sign = np.rint(pairing.after[:, axis] / amount.metres).astype(np.int8)
        ends = (motions.start[:, axis], motions.end[:, axis])
        shift = (pairing.before[:, axis], pairing.after[:, axis])
        places = np.ascontiguousarray(lines.points[:, axis])
        excursion = _excursions(sign, chain, ends, shift, _swings(motions, axis), (places, first))
        over = excursion > _SPARE * band
        for motion in np.flatnonzero(over & ~np.append(False, over)[:-1]).tolist():
            case.findings.add(
                "direction", f"{name} moves back under the offset of its other direction",
                original=_original_line(case, pairing, motion), compensated=int(motions.block[motion]),
                expected=f"<= {band / MM:.6g} mm", got=f"{excursion[motion] / MM:.6g} mm",
            )  # fmt: skip


def _original_line(case: Case, pairing: Pairing, motion: int) -> int | None:
    place = int(np.searchsorted(pairing.new, motion))
    if place < pairing.new.size and pairing.new[place] == motion:
        return int(case.original.motions.block[pairing.old[place]])
    return None


def _swings(motions: Motions, axis: int) -> tuple[Array, Array, Array, Array]:
    """Tell how arcs swing an axis: middle [m], radius [m], where they begin and how far they go.

    The last two in half turns from where the axis is farthest; radius 0 where the axis does not swing.
    """
    # Zeros that nothing is written to take no memory.
    middle, radius, begin, sweep = (np.zeros(motions.kind.size) for _ in range(4))
    arcs = np.flatnonzero(motions.kind == ARC)
    columns = plane_columns(motions.plane[arcs])
    spoke = np.take_along_axis(motions.start[arcs], columns[:, :2], axis=1) - motions.center[arcs]
    second = columns[:, 1] == axis
    middle[arcs] = motions.center[arcs, second.astype(np.int64)]
    radius[arcs] = np.nan_to_num(np.where(columns[:, 2] != axis, np.hypot(*spoke.T), 0.0))
    begin[arcs] = np.arctan2(spoke[:, 1], spoke[:, 0]) / math.pi - 0.5 * second
    sweep[arcs] = motions.angle[arcs] / math.pi
    return middle, radius, begin, sweep


@inner
def _visit(x: float, spot: Any) -> None:
    """Follow the axis to a place: `spot` has the farthest one so far, and the longest way back from it."""
    spot[0] = max(spot[0], x)
    spot[1] = max(spot[1], spot[0] - x)


@inner
def _visit_turns(k: int, sign: int, shift: float, swings: Any, spot: Any) -> None:
    """Visit the places inside an arc at which the axis turns, in order."""
    middle, radius, begin, sweep = swings
    step = 1.0 if sweep[k] > 0.0 else -1.0
    n = math.floor(begin[k]) + 1.0 if sweep[k] > 0.0 else math.ceil(begin[k]) - 1.0
    while (n - begin[k] - sweep[k]) * step < 0.0:
        _visit(sign * (middle[k] - shift + (radius[k] if n % 2.0 == 0.0 else -radius[k])), spot)
        n += step


@compiled
def _excursions(sign: SignArray, chain: IntArray, ends: Any, shift: Any, swings: Any, curve: Any) -> Array:
    """Longest way back [m] under one offset that each motion adds to, 0 where the axis carries none.

    Parameters
    ----------
    sign : ndarray, shape (k,)
        Direction whose offset the axis carries at the end of each motion, 0 for none.
    chain : ndarray, shape (k,)
        Number of the chain, ``_SKIP`` for jogs.
    ends, shift : tuple of ndarray, shape (k,)
        Position at start and end [m], and what is added there.
    swings : tuple of ndarray, shape (k,)
        Middle, radius, begin and sweep of arcs.
    curve : tuple
        Positions along splines [m], and where those of each motion begin (k + 1,).
    """
    out, spot = np.zeros(sign.size), np.zeros(2)
    places, first = curve
    latest, its_chain = 0, _SKIP
    for k in range(sign.size):
        if chain[k] == _SKIP:
            continue
        if sign[k] == 0 or np.isnan(ends[0][k]) or np.isnan(ends[1][k]):
            latest = 0
            continue
        if sign[k] != latest or chain[k] != its_chain:
            spot[0], latest, its_chain = -math.inf, sign[k], chain[k]
        spot[1] = 0.0
        _visit(sign[k] * (ends[0][k] - shift[0][k]), spot)
        if swings[1][k] > 0.0:
            _visit_turns(k, sign[k], shift[1][k], swings, spot)
        for n in range(first[k], first[k + 1]):
            _visit(sign[k] * (places[n] - shift[1][k]), spot)
        _visit(sign[k] * (ends[1][k] - shift[1][k]), spot)
        out[k] = spot[1]
    return out
