"""What is traced: moves as a CAM program has them, runs of straight ones, and where these lie on a curve."""

from __future__ import annotations

import msgspec

from ph_post.types import Array


class Move(msgspec.Struct, frozen=True, array_like=True):
    """A command of the CAM program: its name, such as G1, and its words, lengths in mm and F in mm/s."""

    name: str
    words: dict[str, float]


class Run(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Straight moves in one plane at one feed, one behind the other.

    `first` is the index of the first move, `points` (n + 1, 2) [m] are their ends, `feed` in m/s.
    """

    first: int
    points: Array
    feed: float


class Trace(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Moves of a run that lie on a curve.

    `curve` is the curve's number, `first` and `last` are points of the run; `at` are their places on the
    curve, shape (last - first + 1,): number of the piece plus its u. They rise or fall throughout.
    """

    curve: int
    first: int
    last: int
    at: Array


class Step(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A written move: where it ends, shape (2,) [m]; of a spline the middle control points (2, 2) [m]."""

    end: Array
    inner: Array | None = None
