"""Arc length as a function of u, by panels on which it is a polynomial.

Where the speed is a polynomial (lines, arcs, PH curves) one panel a piece holds the exact integral. Elsewhere
the speed is interpolated at Gauss-Legendre nodes, and a panel is cut until the Legendre coefficients of the
interpolant have died away: in the middle, or where the speed all but vanishes, for at a cusp it is analytic
only on each side. All panels of a round are handled together.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np
from numpy.polynomial import legendre

from ph_post.errors import SolveError
from ph_post.geometry import bernstein
from ph_post.geometry.piece import Group, Piece
from ph_post.types import Array, IntArray, frozen

NODES: Final = 24
"""Nodes a panel. Fewer cost more panels, more cost longer polynomials in every row."""

TAIL: Final = 1e-12
"""Last Legendre coefficients of the speed that end the cutting, relative to the piece's mean speed.

What is left out of the arc length is smaller by about 100: by 2 * NODES from integrating, and by the decay.
"""

SPREAD: Final = 16.0
"""Sum of the power coefficients' sizes, relative to the length, above which a panel is cut: lost digits."""

MAX_ROUNDS: Final = 60
"""Halvings before the quadrature gives up; a kink of the speed that is not met exactly takes about 25."""

LOW: Final = 0.1
"""A node with this part of the panel's largest speed makes it worth looking for the minimum."""

EDGE: Final = 2.0**-10
"""A minimum nearer than this to the end of its panel is left to the halving."""

MINIMUM_STEPS: Final = 12
"""Gauss-Newton converges quadratically on a cusp; near one, any place close to the minimum will do."""


class Panels(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Panels ordered by piece and place: u in [first, last] of `piece`, x in [-1, 1] along it.

    `power`, shape (k, panels), are the coefficients in powers of x of the arc length from the panel's
    beginning [m]; `length` is its value at x = 1.
    """

    piece: IntArray
    first: Array
    last: Array
    power: Array
    length: Array


class _Work(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Panels of one family: `forms` (k, channels, degree + 1) are Bernstein forms on the panel."""

    piece: IntArray
    first: Array
    last: Array
    forms: Array

    def take(self, which: Array | IntArray) -> _Work:
        return _Work(
            piece=self.piece[which], first=self.first[which], last=self.last[which], forms=self.forms[which]
        )


class _Family:
    """Speeds that are computed alike: exact forms, norms of hodographs, or norms over a denominator."""

    def __init__(self, forms: Array, *, exact: bool, rational: bool) -> None:
        self.exact = exact
        self.rational = rational
        degree = forms.shape[2] - 1
        self.nodes = min(degree + 1, NODES) if exact else NODES
        self.complete = exact and self.nodes > degree
        nodes, _ = legendre.leggauss(self.nodes)
        self.basis = bernstein.basis(degree, 0.5 * (nodes + 1.0)).T.copy()

    def speed(self, forms: Array) -> Array:
        """ds/du at the nodes, shape (panels, nodes)."""
        count, channels, size = forms.shape
        values = (forms.reshape(-1, size) @ self.basis).reshape(count, channels, self.nodes)
        if self.exact:
            return np.asarray(values[:, 0])
        vectors = values[:, :-1] if self.rational else values
        speed: Array = np.sqrt(np.einsum("pkn,pkn->pn", vectors, vectors))
        if self.rational:
            speed /= values[:, -1]
        return speed


def build_panels(pieces: tuple[Piece, ...], groups: tuple[Group, ...]) -> Panels:
    """Cut pieces into panels on which the arc length is a polynomial, to rounding.

    Raises
    ------
    SolveError
        The speed of a piece could not be resolved.
    """
    found = [part for family, work in _families(pieces, groups) for part in _resolve(family, work)]
    piece = np.concatenate([work.piece for work, _ in found])
    first = np.concatenate([work.first for work, _ in found])
    order = np.lexsort((first, piece))
    power = np.zeros((max(one.shape[1] for _, one in found), piece.size))
    column = 0
    for _, one in found:
        power[: one.shape[1], column : column + len(one)] = one.T
        column += len(one)
    power = np.ascontiguousarray(power[:, order])
    last = np.concatenate([work.last for work, _ in found])
    return Panels(
        piece=piece[order], first=first[order], last=last[order], power=power, length=power.sum(axis=0)
    )


def _families(pieces: tuple[Piece, ...], groups: tuple[Group, ...]) -> Iterator[tuple[_Family, _Work]]:
    """Sort pieces by how their speed is found, and start with one panel each."""
    exact: dict[int, list[int]] = {}
    for number, piece in enumerate(pieces):
        if piece.speed is not None:
            exact.setdefault(piece.speed.size, []).append(number)
    for members in exact.values():
        speeds = np.concatenate([pieces[number].speed for number in members])
        forms = speeds.reshape(len(members), 1, -1)
        yield _Family(forms, exact=True, rational=False), _start(np.array(members, dtype=np.int64), forms)
    known = {number for members in exact.values() for number in members}
    for group in groups:
        rest = np.array([number not in known for number in group.index.tolist()])
        if rest.any():
            rational = group.kind == "rational"
            control = group.control[rest].transpose(0, 2, 1)
            forms = _rational_forms(control) if rational else bernstein.derivative(control)
            family = _Family(forms, exact=False, rational=rational)
            yield family, _start(group.index[rest], forms)


def _start(index: IntArray, forms: Array) -> _Work:
    return _Work(piece=index, first=np.zeros(index.size), last=np.ones(index.size), forms=forms)


def _rational_forms(control: Array) -> Array:
    """Numerator P'w - Pw' and denominator w² of the hodograph, in one degree."""
    weight = control[:, -1:]
    # Seen from the first point, lest the difference cancel far from the origin.
    place = control[:, :-1] - weight * (control[:, :-1, :1] / weight[:, :, :1])
    numerator = bernstein.product(bernstein.derivative(place), weight)
    numerator -= bernstein.product(place, bernstein.derivative(weight))
    return np.concatenate([bernstein.elevate(numerator), bernstein.product(weight, weight)], axis=1)


def _resolve(family: _Family, work: _Work) -> Iterator[tuple[_Work, Array]]:
    """Cut until every panel is resolved; give panels and power coefficients of their arc length."""
    to_legendre, to_power = _transforms(family.nodes)
    total: Array | None = None
    rank = np.zeros(int(work.piece.max()) + 1, dtype=np.int64)
    rank[work.piece] = np.arange(work.piece.size)
    for _ in range(MAX_ROUNDS):
        speed = family.speed(work.forms)
        modes = speed @ to_legendre
        if total is None:
            total = modes[:, 0].copy()
        width = work.last - work.first
        tail = np.abs(modes[:, -3:]).max(axis=1) * width
        done = np.full(width.size, family.complete) | (tail <= TAIL * total[rank[work.piece]])
        power = (modes[done] @ to_power) * (0.5 * width[done, None])
        steady = np.abs(power).sum(axis=1) <= SPREAD * modes[done, 0] * width[done]
        done[np.flatnonzero(done)[~steady]] = False
        yield work.take(done), power[steady]
        if done.all():
            return
        work = _cut(family, work.take(~done), speed[~done])
    worst = int(work.piece[0])
    raise SolveError(
        f"the arc length of piece {worst} did not converge: panel {work.last[0] - work.first[0]:.3g}"
    )


def _cut(family: _Family, work: _Work, speed: Array) -> _Work:
    """Halve the panels, or cut them where the speed is nearly zero."""
    at = np.full(work.piece.size, 0.5)
    low = np.flatnonzero(speed.min(axis=1) < LOW * speed.max(axis=1))
    if low.size and not family.exact:
        vectors = work.forms[low, :-1] if family.rational else work.forms[low]
        nodes = 0.5 * (legendre.leggauss(family.nodes)[0] + 1.0)
        lowest = _minimum(vectors, nodes[speed[low].argmin(axis=1)])
        at[low] = np.where((lowest > EDGE) & (lowest < 1.0 - EDGE), lowest, 0.5)
    left, right = bernstein.subdivide(work.forms, at[:, None])
    middle = work.first + at * (work.last - work.first)
    return _Work(
        piece=np.concatenate([work.piece, work.piece]),
        first=np.concatenate([work.first, middle]),
        last=np.concatenate([middle, work.last]),
        forms=np.concatenate([left, right]),
    )


def _minimum(vectors: Array, u: Array) -> Array:
    """Where the length of a vector polynomial, shape (k, dim, degree + 1), is least, from nearby."""
    slopes = bernstein.derivative(vectors)
    for _ in range(MINIMUM_STEPS):
        value, slope = bernstein.evaluate(vectors, u[:, None]), bernstein.evaluate(slopes, u[:, None])
        steep = np.einsum("pk,pk->p", slope, slope)
        step = np.einsum("pk,pk->p", value, slope)
        u = np.clip(u - np.divide(step, steep, out=np.zeros_like(u), where=steep > 0.0), 0.0, 1.0)
    return u


@lru_cache(maxsize=64)
def _transforms(count: int) -> tuple[Array, Array]:
    """Matrices from values at Gauss nodes to Legendre coefficients, and on to powers of the integral."""
    nodes, weights = legendre.leggauss(count)
    degrees = np.arange(count)
    to_legendre = legendre.legvander(nodes, count - 1) * weights[:, None] * (degrees + 0.5)
    to_power = np.zeros((count, count + 1))
    for k in degrees:
        integral = legendre.leg2poly(legendre.legint(np.eye(count)[k], lbnd=-1.0))
        to_power[k, : integral.size] = integral
    return frozen(to_legendre), frozen(to_power)
