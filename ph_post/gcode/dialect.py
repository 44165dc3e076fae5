"""What a controller dialect is: a record of what it can carry, and functions that write its own words."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import msgspec

from ph_post.gcode.reader.record import PartProgram
from ph_post.types import Array, Capabilities

_PLANES = {"G17": ("X", "Y"), "G18": ("Z", "X"), "G19": ("Y", "Z")}
"""First and second axis of each plane, as controllers count the sense of G2 and G3."""


class Dialect(msgspec.Struct, frozen=True, kw_only=True):
    """A controller dialect; to add one: a file with such a record, an entry point in ``ph_post.dialects``.

    Parameters
    ----------
    name : str
        As machine files and ``--dialect`` write it.
    capabilities : Capabilities
        `decimals` are those of lengths in mm.
    feed_digits : int
        Significant digits of F words and dwells.
    terse : bool
        No blanks, no motion word and no coordinate that repeats the last one: for serial lines.
    opening : callable
        ``opening(plane) -> lines``: the modal state the program relies on; `plane` is G17, G18 or G19.
    closing : tuple of str
        Last lines of the program.
    inverse_time_arcs, inverse_time_splines : bool
        Whether G2 and G3, and G5, keep their time under G93.
    path_mode : callable or None
        ``path_mode(tolerance) -> line``: the controller may round joints by `tolerance` [m], or has to
        reach every end point where `tolerance` is None. None where the dialect has no such words.
    spline_deviation : callable or None
        ``spline_deviation(control)``: how far the controller's own rendering of cubic Béziers leaves them
        [m], from shape (m, 4, 2) [m] to (m,); infinite where writing one would not be safe.
    spline_pieces : int
        Number of moves into which the controller breaks one cubic.
    stream_rate : float or None
        Bytes a second that the controller is fed with while it runs, None where it reads a file.
    stream_window : int
        Number of moves that it holds in store.
    front : callable or None
        ``front(data, name) -> program``: reads a part program of this dialect, every byte kept; None where
        :func:`ph_post.gcode.reader.read.read_program` does.
    variants : mapping of str to callable
        What a machine may have besides, by the word behind a plus sign (``fanuc+nurbs``):
        ``variant(dialect) -> dialect`` with it.
    """

    name: str
    capabilities: Capabilities
    feed_digits: int
    terse: bool
    opening: Callable[[str], tuple[str, ...]]
    closing: tuple[str, ...]
    inverse_time_arcs: bool = True
    inverse_time_splines: bool = False
    path_mode: Callable[[float | None], str] | None = None
    spline_deviation: Callable[[Array], Array] | None = None
    spline_pieces: int = 1
    stream_rate: float | None = None
    stream_window: int = 1
    front: Callable[[bytes, str], PartProgram] | None = None
    variants: Mapping[str, Callable[[Dialect], Dialect]] = {}


def metric_opening(plane: str) -> tuple[str, ...]:
    """Open a program in mm, absolute and per minute, nothing compensated: words that RS274 dialects share."""
    return (f"G21 {plane} G90 G91.1 G94 G40 G49 G54 G80",)


def plane_of(axes: Sequence[str]) -> tuple[str, int]:
    """Word of the plane of the first two axes, and +1 or -1 as their order is the plane's or not.

    Examples
    --------
    >>> plane_of(("X", "Y")), plane_of(("X", "Z"))
    (('G17', 1), ('G18', -1))
    """
    pair = tuple(axes[:2])
    word = next(word for word, plane in _PLANES.items() if set(pair) == set(plane))
    return word, 1 if pair == _PLANES[word] else -1
