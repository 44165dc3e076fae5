"""Contour error: the distance of the executed motion from the nominal path."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import msgspec
import numpy as np

from ph_post.compiling import read_only
from ph_post.drive.cascade import time_constant as servo_time
from ph_post.errors import InputError
from ph_post.geometry.track import Track
from ph_post.simulate.cells import EPS, cut_path, make_cells
from ph_post.simulate.nearest import find_nearest
from ph_post.types import Array, Command, IntArray, Machine, TurningPoint

TOLERANCE: Final = 1e-11
"""Largest distance of the search's cubics from the path [m]: a thousandth of the simulation's tolerance."""

SETTLING: Final = 5.0
"""Servo time constants after which a run counts: what the start left has fallen to exp(-5)."""


class Nearest(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The place of the path nearest to each position.

    `error` (n,) is the signed distance [m], `s` (n,) the arc length of that place [m]. Near the path that is
    good to about 1e-9 m; towards a centre of curvature more and more places are almost equally near.
    """

    error: Array
    s: Array


class ContourError(msgspec.Struct, frozen=True, kw_only=True):
    """Largest |e| and root mean square [m]."""

    max: float
    rms: float


class TurningError(msgspec.Struct, frozen=True, kw_only=True):
    """Contour error around one turning point [m]; `extreme` is the largest, with its sign."""

    turning_point: int
    extreme: float
    max: float
    rms: float


class Nominal:
    """A path made ready for the search of nearest places.

    Parameters
    ----------
    track : Track
    tolerance : float, optional
        Largest deviation of the cubic cells in arc length from the path [m]; where the coordinates are so
        large that they are not known as well, some of their rounding steps.

    Attributes
    ----------
    dimension : int
        2 or 3.
    length : float
        Arc length [m].
    closed : bool
        Whether the path is run as a loop.
    deviation : float
        The deviation found at points between the ends of the cells [m]. It is within the tolerance unless the
        path would need more cells than memory should hold (about 25 m of arcs of 1 mm radius).

    Examples
    --------
    >>> from ph_post.geometry.curves import Line
    >>> nominal = Nominal(Track.from_curves([Line([[0, 0], [2, 0]])]))
    >>> near = nominal.nearest(np.array([[0.5, 0.25], [1.0, -0.125], [2.0, 0.0]]), np.array([0.5, 1.0, 1.5]))
    >>> near.error.tolist(), near.s.tolist()
    ([0.25, -0.125, 0.0], [0.5, 1.0, 2.0])
    """

    def __init__(self, track: Track, tolerance: float = TOLERANCE) -> None:
        self.length = track.length
        self.closed = track.closed
        self.dimension = track.dimension
        self._track = track
        begins = track.derivatives(np.arange(len(track.pieces)), np.zeros(len(track.pieces)))
        tolerance = max(tolerance, 16.0 * EPS * (self.length + float(np.abs(begins).max())))
        stretches, self.deviation = cut_path(track, tolerance)
        loop = self.length if self.closed else math.inf
        # Two passes along one line are each as far from it as the tolerance allows.
        self._cells = make_cells(stretches, loop, 2.0 * max(tolerance, self.deviation))
        self._starts = stretches.s0

    @property
    def cells(self) -> int:
        """Number of cubic cells."""
        return self._starts.size

    def nearest(self, position: Array, hint: Array) -> Nearest:
        """Distance to the nearest point of the path, whichever part of it that is on.

        Parameters
        ----------
        position : Array, shape (n, dimension)
            Executed positions [m].
        hint : Array, shape (n,)
            Arc length of the points commanded [m]. It decides between places that are equally near, where the
            path runs over itself.

        Returns
        -------
        Nearest
            The error is positive to the left of the direction of travel t, where z x t points, in the plane
            of the first two axes; in a corner, left of the bisector. Straight ahead of an open end counts as
            left. In space the size is the distance in space, and only the sign is taken from the view along
            the third axis: an error along that axis alone, or a path that runs along it, has no side, and
            its sign is arbitrary. Both ends of a closed path are one place, with either arc length.

        Raises
        ------
        InputError
            The shapes do not fit, or a position is not finite.
        """
        self._require(position, hint)
        if hint.size == 0:
            return Nearest(error=np.zeros(0), s=np.zeros(0))
        first = int(np.searchsorted(self._starts, hint[0], side="right")) - 1
        error, s = find_nearest(read_only(position), read_only(hint), max(first, 0), self._cells)
        return Nearest(error=error, s=s)

    def places(self, s: Array) -> Array:
        """Points of the path at arc lengths (n,) [m], shape (n, dimension) [m]."""
        points: Array = self._track.derivatives(*self._track.locate(np.clip(s, 0.0, self.length)))[0]
        return points

    def _require(self, position: Array, hint: Array) -> None:
        expected = (hint.size, self.dimension)
        if position.shape != expected:
            raise InputError("", "wrong shape of positions", expected=f"{expected}", got=f"{position.shape}")
        if not (np.isfinite(position).all() and np.isfinite(hint).all()):
            raise InputError("", "a position is not finite", expected="finite numbers", got="NaN or infinity")


def time_constant(machine: Machine, axes: Sequence[str]) -> float:
    """Servo time constant 2b/c of the slowest of `axes` [s]; 0 for ideal steppers."""
    return max(servo_time(machine.axes[name].servo) for name in axes)


def settling_time(machine: Machine, axes: Sequence[str]) -> float:
    """Five of the time constants of `axes` [s], see :func:`time_constant`."""
    return SETTLING * time_constant(machine, axes)


def first_counted(command: Command, machine: Machine) -> int:
    """Find the first row that the contour error counts; the number of rows where there is none.

    That is after :func:`settling_time` of motion along the path. Rows before it that stand at the beginning
    (s = 0, feed 0: moves of approach, and the rest before a start at rest) are no motion along the path.
    """
    moving = (command.s != 0.0) | (command.feed != 0.0)
    begin = max(int(np.argmax(moving)) - 1, 0) if moving.any() else moving.size - 1
    end = command.t[begin] + settling_time(machine, command.axes)
    # The times of rows are rounded products.
    return int(np.searchsorted(command.t, end - 1e-6 * command.period))


def contour_error(error: Array) -> ContourError | None:
    """Largest and root mean square of a signed error (n,) [m]; None where there are no rows."""
    if error.size == 0:
        return None
    largest = max(float(error.max()), -float(error.min()))
    return ContourError(max=largest, rms=math.sqrt(float(error @ error) / error.size))


def turning_errors(
    error: Array, s: Array, turning_points: Sequence[TurningPoint], loop: float | None = None
) -> tuple[TurningError | None, ...]:
    """Contour error of the rows whose commanded place is nearer to a turning point than to any other.

    Parameters
    ----------
    error, s : Array, shape (n,)
        Signed error and arc length of the points commanded [m].
    turning_points : sequence of TurningPoint
        Those at one place share their rows.
    loop : float, optional
        Length of a closed path whose motion runs over the seam [m]: rows before it then belong to turning
        points behind it, and the other way round. A motion that begins and ends at rest does not.

    Returns
    -------
    tuple of TurningError or None
        One for each turning point; None where it has no rows.
    """
    if not turning_points:
        return ()
    places, which = np.unique([point.s for point in turning_points], return_inverse=True)
    owner = _owners(s, places, loop)
    count = np.bincount(owner, minlength=places.size)
    square = np.bincount(owner, weights=error * error, minlength=places.size)
    extreme = _extremes(error, owner, places.size)
    return tuple(
        None
        if count[place] == 0
        else TurningError(
            turning_point=point.index,
            extreme=float(extreme[place]),
            max=abs(float(extreme[place])),
            rms=math.sqrt(square[place] / count[place]),
        )
        for point, place in zip(turning_points, which.tolist(), strict=True)
    )


def _extremes(error: Array, owner: IntArray, count: int) -> Array:
    """Largest |e| with its sign, by owner."""
    top, bottom = np.full(count, -np.inf), np.full(count, np.inf)
    np.maximum.at(top, owner, error)
    np.minimum.at(bottom, owner, error)
    return np.where(top >= -bottom, top, bottom)


def _owners(s: Array, places: Array, loop: float | None) -> IntArray:
    """Index of the nearest of the places, which ascend."""
    middles = 0.5 * (places[:-1] + places[1:])
    if loop is not None:
        # The loop counts from the middle between the last place and the first.
        begin = 0.5 * (places[-1] - loop + places[0])
        s = begin + np.mod(s - begin, loop)
    owner: IntArray = np.searchsorted(middles, s, side="right")
    return owner
