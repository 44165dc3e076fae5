"""The speed ds/du of many pieces at once, sorted by how it is found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import legendre

from ph_post.geometry import bernstein
from ph_post.geometry.piece import Group, Piece, stacked
from ph_post.types import Array, IntArray


class Family:
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

    def __init__(
        self, index: IntArray, forms: Array, *, exact: bool, rational: bool, most_nodes: int
    ) -> None:
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


def sort_by_speed(pieces: Sequence[Piece], groups: Sequence[Group], most_nodes: int) -> tuple[Family, ...]:
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
        families.append(Family(index, forms, exact=True, rational=False, most_nodes=most_nodes))
    for group in groups:
        rest = ~known[group.index]
        if rest.any():
            rational = group.kind == "rational"
            control = group.control[rest].transpose(2, 0, 1)
            forms = _rational_forms(control) if rational else bernstein.derivative(control)
            forms = np.ascontiguousarray(np.swapaxes(forms, 1, 2))
            index = group.index[rest]
            families.append(Family(index, forms, exact=False, rational=rational, most_nodes=most_nodes))
    return tuple(families)


def _rational_forms(control: Array) -> Array:
    """Numerator P'w - Pw' and denominator w² of the hodograph, in one degree, coefficients last."""
    weight = control[-1:]
    # Seen from the first point, lest the difference cancel far from the origin.
    place = control[:-1] - weight * (control[:-1, :, :1] / weight[:, :, :1])
    numerator = bernstein.product(bernstein.derivative(place), weight)
    numerator -= bernstein.product(place, bernstein.derivative(weight))
    return np.concatenate([bernstein.elevate(numerator), bernstein.product(weight, weight)])
