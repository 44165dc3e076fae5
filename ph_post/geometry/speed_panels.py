"""Arc length of a piece as a function of u, by panels on which it is a polynomial.

Where the speed is a polynomial (lines, arcs, PH curves) one panel a piece holds the exact integral. Elsewhere
the speed is interpolated at Gauss-Legendre nodes, and a panel is cut until the Legendre coefficients of the
interpolant have died away: in the middle, or where the speed all but vanishes, for at a cusp it is analytic
only on each side. All panels of a round are handled together.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ph_post.errors import SolveError
from ph_post.geometry import bernstein
from ph_post.geometry.piecewise import Group, Piece, stacked
from ph_post.types import Array, IntArray, frozen


class SpeedFamily:
    """Pieces whose speeds are computed alike.

    Either the speed is a polynomial itself (`exact`: lines, arcs, PH curves), or it is the length of a
    polynomial hodograph, or that over a polynomial denominator (`rational`).

    Parameters
    ----------
    index : IntArray, shape (m,)
        Numbers of the pieces.
    forms : Array, shape (channels, degree + 1, m)
        Bernstein coefficients on the pieces: the speed, or the hodograph's components and its denominator.
        Pieces stand on the last axis, along which numpy is fast.
    exact, rational : bool
    most_nodes : int
        Gauss-Legendre nodes a panel, unless fewer resolve the speed completely.
    """

    def __init__(self, index: IntArray, forms: Array, *, exact: bool, rational: bool, most_nodes: int) -> None:
        self.index = index
        self.forms = forms
        self.exact = exact
        self.rational = rational
        degree = forms.shape[1] - 1
        self.node_count = min(degree + 1, most_nodes) if exact else most_nodes
        self.complete = exact and self.node_count > degree
        self.nodes = 0.5 * (legendre.leggauss(self.node_count)[0] + 1.0)
        self._basis = bernstein.basis(degree, self.nodes)
        # The unit matrix cut in half: halving a form is a product with these.
        left, right = bernstein.subdivide(np.eye(degree + 1))
        self.halves = left.T, right.T

    def speed(self, forms: Array) -> Array:
        """ds/du at the nodes of panels on which the family's functions have these forms, (nodes, panels)."""
        return self._norm(self._basis @ forms)

    def end_speed(self, forms: Array) -> Array:
        """ds/du at both ends of the same panels, (2, panels)."""
        return self._norm(forms[:, [0, -1]])

    def _norm(self, values: Array) -> Array:
        if self.exact:
            return np.asarray(values[0])
        vectors = values[:-1] if self.rational else values
        speed: Array = np.sqrt(np.einsum("knp,knp->np", vectors, vectors))
        if self.rational:
            speed /= values[-1]
        return speed

    def vectors(self, forms: Array) -> Array:
        """Pick those of the functions that are zero where the speed is."""
        return forms[:-1] if self.rational else forms


def sort_by_speed(pieces: Sequence[Piece], groups: Sequence[Group], most_nodes: int) -> tuple[SpeedFamily, ...]:
    """Sort pieces into families."""
    families = []
    exact: dict[int, dict[int, Array]] = {}
    for number, piece in enumerate(pieces):
        if piece.speed is not None:
            exact.setdefault(piece.speed.size, {})[number] = piece.speed
    known = np.zeros(len(pieces), dtype=np.bool_)
    for size, members in exact.items():
        index = np.array(list(members), dtype=np.int64)
        known[index] = True
        forms = stacked(members.values()).reshape(index.size, size).T[None]
        families.append(SpeedFamily(index, forms, exact=True, rational=False, most_nodes=most_nodes))
    for group in groups:
        rest = ~known[group.index]
        if rest.any():
            rational = group.kind == "rational"
            control = group.control[rest].transpose(2, 0, 1)
            forms = _rational_forms(control) if rational else bernstein.derivative(control)
            forms = np.ascontiguousarray(np.swapaxes(forms, 1, 2))
            index = group.index[rest]
            families.append(SpeedFamily(index, forms, exact=False, rational=rational, most_nodes=most_nodes))
    return tuple(families)


def _rational_forms(control: Array) -> Array:
    """Numerator P'w - Pw' and denominator w² of the hodograph, in one degree, coefficients last."""
    weight = control[-1:]
    # Seen from the first point, lest the difference cancel far from the origin.
    place = control[:-1] - weight * (control[:-1, :, :1] / weight[:, :, :1])
    numerator = bernstein.product(bernstein.derivative(place), weight)
    numerator -= bernstein.product(place, bernstein.derivative(weight))
    return np.concatenate([bernstein.elevate(numerator), bernstein.product(weight, weight)])


NODES: Final = 24
"""Nodes a panel. Fewer cost more panels, more cost longer polynomials in every row."""

TAIL: Final = 1e-12
"""Last Legendre coefficients of the speed that end the cutting, relative to the piece's mean speed.

What is left out of the arc length is smaller by about 100: by 2 * NODES from integrating, and by the decay.
"""

OWN_TAIL: Final = 3e-8
"""The same where only the integral over a panel is needed, relative to the panel's own mean speed.

Coefficients that have died away like this go on doing so; the quadrature misses only those beyond 2 * NODES.
Next to a cusp they do not: so this holds for panels on which the speed is nowhere low.
"""

SPREAD: Final = 16.0
"""Sum of the power coefficients' sizes, relative to the length, above which a panel is cut: lost digits.

It binds polynomial speeds of high degree only; where the Legendre coefficients die away, so do these.
"""

MAX_ROUNDS: Final = 60
"""Halvings before the quadrature gives up; a kink of the speed that is not met exactly takes about 25."""

LOW: Final = 0.1
"""A speed is low below this part of the largest on the panel; at a cusp that shows at some node or end."""

EDGE: Final = 2.0**-10
"""A minimum nearer than this to the end of its panel is left to the halving."""

MINIMUM_STEPS: Final = 6
"""Gauss-Newton converges quadratically on a cusp; elsewhere any place close to the minimum will do."""


class Panels(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Panels, those of a piece in order side by side: u in [first, last] of `piece`, x in [-1, 1] along it.

    `power`, shape (k, panels), are the coefficients in powers of x of the arc length from the panel's
    beginning [m]; `start` and `length` [m] are counted from the piece's beginning.
    """

    piece: IntArray
    first: Array
    last: Array
    start: Array
    length: Array
    power: Array


class _UnresolvedPanels(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Panels of one family in work: `row` in the family, `forms` are its functions on the panel."""

    row: IntArray
    first: Array
    last: Array
    forms: Array

    def take(self, which: IntArray) -> _UnresolvedPanels:
        return _UnresolvedPanels(
            row=self.row[which],
            first=self.first[which],
            last=self.last[which],
            forms=self.forms[:, :, which],
        )


def measure(family: SpeedFamily) -> Array:
    """Lengths [m] of a family's pieces: exact for polynomial speeds, elsewhere by quadrature.

    Raises
    ------
    SolveError
        The speed of a piece could not be resolved.
    """
    lengths = np.zeros(family.index.size)
    for work, modes in _rounds(family, np.arange(family.index.size), OWN_TAIL):
        lengths += np.bincount(work.row, modes[0] * (work.last - work.first), lengths.size)
    return lengths


def resolve(family: SpeedFamily, rows: IntArray) -> Panels:
    """Cut some of a family's pieces into panels on which the arc length is a polynomial, to rounding.

    Raises
    ------
    SolveError
        The speed of a piece could not be resolved.
    """
    _, to_power = _transforms(family.node_count)
    found = [
        (work, (to_power @ modes) * (0.5 * (work.last - work.first))) for work, modes in _rounds(family, rows, 0.0)
    ]
    piece = family.index[np.concatenate([work.row for work, _ in found])]
    first = np.concatenate([work.first for work, _ in found])
    last = np.concatenate([work.last for work, _ in found])
    order = np.lexsort((first, piece))
    power = np.concatenate([power for _, power in found], axis=1)[:, order]
    piece, length = piece[order], power.sum(axis=0)
    return Panels(
        piece=piece,
        first=first[order],
        last=last[order],
        start=_sums_before(piece, length),
        length=length,
        power=power,
    )


def join_panels(parts: Sequence[Panels]) -> Panels:
    """Put panels one after the other, the shorter polynomials filled with zeros."""
    terms = max((len(part.power) for part in parts), default=1)
    filled = [np.pad(part.power, ((0, terms - len(part.power)), (0, 0))) for part in parts]
    none = np.empty(0)
    return Panels(
        piece=np.concatenate([np.empty(0, dtype=np.int64), *(part.piece for part in parts)]),
        first=np.concatenate([none, *(part.first for part in parts)]),
        last=np.concatenate([none, *(part.last for part in parts)]),
        start=np.concatenate([none, *(part.start for part in parts)]),
        length=np.concatenate([none, *(part.length for part in parts)]),
        power=np.concatenate([np.empty((terms, 0)), *filled], axis=1),
    )


def _sums_before(piece: IntArray, length: Array) -> Array:
    """For every panel, the sum of the lengths before it in its piece."""
    sums = np.concatenate([[0.0], np.cumsum(length)])
    head = np.flatnonzero(np.diff(piece, prepend=-1))
    counts = np.diff(head, append=piece.size)
    start: Array = sums[:-1] - np.repeat(sums[head], counts)
    return start


def _rounds(family: SpeedFamily, rows: IntArray, own_tail: float) -> Iterator[tuple[_UnresolvedPanels, Array]]:
    """Cut until every panel is resolved; give panels and the Legendre coefficients of the speed on them."""
    to_legendre, to_power = _transforms(family.node_count)
    zero, one = np.zeros(rows.size), np.ones(rows.size)
    work = _UnresolvedPanels(row=rows, first=zero, last=one, forms=family.forms[:, :, rows])
    allowed = np.zeros(family.index.size)
    for turn in range(MAX_ROUNDS):
        speed = family.speed(work.forms)
        modes = to_legendre @ speed
        width = work.last - work.first
        if turn == 0:
            allowed[rows] = np.inf if family.complete else TAIL * modes[0]
        done = _settled(family, work, speed, modes, allowed[work.row], own_tail)
        if family.exact:
            spread = np.abs(to_power @ modes).sum(axis=0)
            done &= spread <= SPREAD * modes[0]
        yield work.take(np.flatnonzero(done)), modes[:, done]
        if done.all():
            return
        # The first halvings are made blindly: they are the rule, cusps are the exception.
        work = _cut(family, work.take(np.flatnonzero(~done)), speed[:, ~done] if turn > 1 else None)
    width = work.last - work.first
    number = family.index[work.row[0]]
    raise SolveError(f"arc length of piece {number}: not resolved on a panel of {width[0]:.3g}")


def _settled(
    family: SpeedFamily, work: _UnresolvedPanels, speed: Array, modes: Array, allowed: Array, own_tail: float
) -> NDArray[np.bool_]:
    """Tell on which panels the coefficients of the speed have died away."""
    tail = np.abs(modes[-3:]).max(axis=0)
    width = work.last - work.first
    done: NDArray[np.bool_] = tail * width <= allowed
    if family.complete:
        return done
    ends = family.end_speed(work.forms)
    # A cusp between an end and the next node shows nowhere else than at that end.
    # The rows are Legendre polynomials at -1 and 1.
    at_ends = np.stack([(-1.0) ** np.arange(family.node_count), np.ones(family.node_count)])
    missed = np.abs(at_ends @ modes - ends).max(axis=0)
    done &= missed * family.nodes[0] * width <= allowed
    if own_tail > 0.0:
        lowest = np.minimum(speed.min(axis=0), ends.min(axis=0))
        done |= (tail <= own_tail * modes[0]) & (lowest > LOW * speed.max(axis=0))
    return done


def _cut(family: SpeedFamily, work: _UnresolvedPanels, speed: Array | None) -> _UnresolvedPanels:
    """Halve the panels, or cut them where the `speed` at their nodes, if given, goes down to nearly zero."""
    left, right = (half @ work.forms for half in family.halves)
    middle = 0.5 * (work.first + work.last)
    if speed is not None and not family.exact:
        node = speed.argmin(axis=0)
        between = (node > 0) & (node < family.node_count - 1)
        low = np.flatnonzero(between & (speed.min(axis=0) < LOW * speed.max(axis=0)))
        forms = np.swapaxes(work.forms[:, :, low], 1, 2)
        lowest = _minimum(family.vectors(forms), family.nodes[node[low]])
        inside = (lowest > EDGE) & (lowest < 1.0 - EDGE)
        low, lowest = low[inside], lowest[inside]
        halves = bernstein.subdivide(forms[:, inside], lowest)
        left[:, :, low], right[:, :, low] = (np.swapaxes(half, 1, 2) for half in halves)
        middle[low] = work.first[low] + lowest * (work.last[low] - work.first[low])
    return _UnresolvedPanels(
        row=np.concatenate([work.row, work.row]),
        first=np.concatenate([work.first, middle]),
        last=np.concatenate([middle, work.last]),
        forms=np.concatenate([left, right], axis=2),
    )


def _minimum(vectors: Array, u: Array) -> Array:
    """Find from nearby where the length of a vector polynomial, shape (dim, k, degree + 1), is least."""
    slopes = bernstein.derivative(vectors)
    for _ in range(MINIMUM_STEPS):
        value, slope = bernstein.evaluate(vectors, u), bernstein.evaluate(slopes, u)
        steep, step = np.sum(slope * slope, axis=0), np.sum(value * slope, axis=0)
        u = np.clip(u - np.divide(step, steep, out=np.zeros_like(u), where=steep > 0.0), 0.0, 1.0)
    return u


@lru_cache(maxsize=64)
def _transforms(count: int) -> tuple[Array, Array]:
    """Matrices from values at Gauss nodes to Legendre coefficients, and on to powers of the integral."""
    nodes, weights = legendre.leggauss(count)
    degrees = np.arange(count)
    to_legendre = (legendre.legvander(nodes, count - 1) * weights[:, None] * (degrees + 0.5)).T
    to_power = np.zeros((count + 1, count))
    for k in degrees:
        integral = legendre.leg2poly(legendre.legint(np.eye(count)[k], lbnd=-1.0))
        to_power[: integral.size, k] = integral
    return frozen(to_legendre), frozen(to_power)
