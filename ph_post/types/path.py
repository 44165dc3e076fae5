"""Records of a toolpath: its segments, turning points and windows."""

from __future__ import annotations

from typing import Literal, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray

from ph_post.types.arrays import Array

Sense = Literal["max", "min"]
TurningKind = Literal["smooth", "corner", "dwell", "cusp"]
WindowLimit = Literal["deviation", "neighbour", "end", "corner"]


class Curve(Protocol):
    """Interface of a segment's curve; implemented in :mod:`ph_post.geometry`."""

    @property
    def dimension(self) -> int:
        """2 or 3."""

    @property
    def domain(self) -> tuple[float, float]:
        """Range of the parameter xi, as the path file has it."""

    def derivatives(self, xi: Array, order: int = 0) -> Array:
        """Values and derivatives with respect to xi, shape (order + 1, n, dimension) [m]."""


class Segment(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One segment of a path; `feed` [m/s] overrides the path's. One that is `rounded` replaces a sharp corner."""

    curve: Curve
    feed: float | None = None
    rapid: bool = False
    rounded: bool = False


class Path(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """An analytic toolpath. `feed` in m/s; `digest` is the hash of the bytes it was read from.

    `remarks` say what was changed of it since then, a sentence each. `lines` are the arc lengths [m] at which
    motions of the part program end that it was read from, their numbers, and the lines (from 0) of all motions of it.
    """

    name: str
    source: str
    axes: tuple[str, ...]
    feed: float
    closed: bool
    segments: tuple[Segment, ...]
    digest: str = ""
    remarks: tuple[str, ...] = ()
    lines: tuple[Array, NDArray[np.int32], NDArray[np.int32]] | None = None


class TurningPoint(msgspec.Struct, frozen=True, kw_only=True, eq=False, gc=False):
    """Turning point: a place of the path where one axis reverses.

    `segment`, `xi` as the contract counts them (a joint belongs to the earlier segment, at its end; the
    seam of a closed path to segment 0, start). `position` [m] of that axis, `s` [m] along the path.
    `curvature` [1/m] (signed in the plane, Eq. 2), its arc-length derivatives [1/m²], [1/m³] and
    `torsion` [1/m] are None at corners and cusps. `normal` is the component along the axis of the unit
    principal normal (x'' = |curvature| * normal), so that the axis swings with amplitude
    |normal / curvature| on the osculating circle. A `dwell` takes them from the outgoing side.
    """

    index: int
    kind: TurningKind
    segment: int
    xi: float
    axis: str
    sense: Sense
    position: float
    s: float
    curvature: float | None = None
    curvature_dot: float | None = None
    curvature_ddot: float | None = None
    torsion: float | None = None
    normal: float | None = None


class Window(msgspec.Struct, frozen=True, kw_only=True, gc=False):
    """The osculating-circle window [s - half_length, s + half_length] of a turning point [m].

    `estimate` is Eq. (6) [m], infinite on a circle. `contact_order` is 2, 3, or more where both terms
    of (6) vanish. `limited_by` is None where nothing bounds the window. `members` are the indices of the
    turning points that share this window, its own included. `notes` say what was shortened or merged.
    """

    turning_point: int
    s: float
    half_length: float
    limited_by: WindowLimit | None
    estimate: float
    contact_order: int
    members: tuple[int, ...]
    notes: tuple[str, ...] = ()
