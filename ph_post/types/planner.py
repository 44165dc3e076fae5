"""Records of a controller's planner: whether it rounds corners, how fast it passes them, what arcs become.

A dialect has a planner with the defaults of its firmware; a machine file states what differs on the machine.
"""

from __future__ import annotations

from typing import Final

import msgspec
import numpy as np

from ph_post.types.arrays import Array

_ROUNDING: Final = 1e-6
"""A time that is longer than whole steps by no more than this part of one is rounding."""


class PlannerSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Settings of a planner that a machine file states, None where it does not. SI units.

    `junction_deviation`, `arc_tolerance`, `arc_resolution`, `arc_segment`, `path_tolerance` [m];
    `square_corner_velocity`, `jerk` [m/s]; `max_accel_to_decel` [m/s²]; `dwell_step` [s].
    """

    junction_deviation: float | None = None
    arc_tolerance: float | None = None
    square_corner_velocity: float | None = None
    arc_resolution: float | None = None
    max_accel_to_decel: float | None = None
    jerk: float | None = None
    arc_segment: float | None = None
    path_tolerance: float | None = None
    dwell_step: float | None = None

    def given(self) -> dict[str, float]:
        """Return what is stated, by name."""
        return {name: value for name in self.__struct_fields__ if (value := getattr(self, name)) is not None}


class GrblCorner(msgspec.Struct, frozen=True, kw_only=True):
    """Corner rule of Grbl: v² = a δ sin(θ/2) / (1 − sin(θ/2)), θ the angle between the blocks, δ the `deviation` [m].

    a is what the axes can in the direction in which the velocity changes. A corner with cos θ below −0.999999 is
    straight, one above 0.999999 a reversal, where the axes stop.
    """

    deviation: float


class MarlinCorner(msgspec.Struct, frozen=True, kw_only=True):
    """Corner rule of Marlin's junction deviation: as :class:`GrblCorner`, with three differences.

    Straight is no exception; a is at most that of the block behind the corner; and behind a corner of less than
    45° a block shorter than 1 mm counts as an arc of its length and the corner's angle.
    """

    deviation: float


class JerkCorner(msgspec.Struct, frozen=True, kw_only=True):
    """Corner rule of Marlin's classic jerk: no axis changes its velocity by more than its `jerk` [m/s] (X, Y, Z)."""

    jerk: tuple[float, float, float]


class KlipperCorner(msgspec.Struct, frozen=True, kw_only=True):
    """Corner rule of Klipper.

    A corner of 90° is passed at `velocity` [m/s], others by the junction deviation that follows from that, none
    faster than an arc between the middles of both blocks allows. `accel_to_decel` [m/s²] bounds the speed that a
    block may reach if it has to slow down again; None for half of the acceleration.
    """

    velocity: float
    accel_to_decel: float | None = None


class GrblChords(msgspec.Struct, frozen=True, kw_only=True):
    """Arcs become chords that are off by at most about `tolerance` [m]."""

    tolerance: float


class KlipperChords(msgspec.Struct, frozen=True, kw_only=True):
    """Arcs become chords over at least `length` [m] of them, their rise included."""

    length: float


class MarlinChords(msgspec.Struct, frozen=True, kw_only=True):
    """Arcs become chords over `longest` [m] of them, at least `per_turn` a turn, but for chords below `shortest` [m].

    Lengths are those in the plane of the arc.
    """

    longest: float
    shortest: float
    per_turn: int


class ExactPath(msgspec.Struct, frozen=True, kw_only=True):
    """A planner that follows the path exactly, arcs as chords, and slows down at corners.

    Parameters
    ----------
    corner : GrblCorner, MarlinCorner, JerkCorner or KlipperCorner
        Speed at which a corner is passed.
    chords : GrblChords, KlipperChords or MarlinChords
        What an arc becomes.
    blocks : int or None
        Blocks that are looked ahead behind the one under way; None where there is no bound.
    rapid_feed : float or None
        Where G0 moves at F, as G1 does: the feed before the first F [m/s]. None where G0 is as fast as the axes.
    shared_limits : bool
        Whether X and Y have one limit of speed and acceleration, which then bounds the motion along the path.
    least_feed : float
        No block is slower [m/s] because of its F.
    dwell_step : float
        A dwell is rounded up to whole steps of this time [s]; 0 where it is as long as it says.
    """

    corner: GrblCorner | MarlinCorner | JerkCorner | KlipperCorner
    chords: GrblChords | KlipperChords | MarlinChords
    blocks: int | None = None
    rapid_feed: float | None = None
    shared_limits: bool = False
    least_feed: float = 0.0
    dwell_step: float = 0.0

    def dwell(self, seconds: Array) -> Array:
        """Return how long the controller waits [s] where a program says `seconds`."""
        return rounded_up(seconds, self.dwell_step)


class RoundedPath(msgspec.Struct, frozen=True, kw_only=True):
    """A planner that rounds corners, as LinuxCNC's.

    `tolerance` [m] is how far where a program says nothing, 0 for as far as it likes; with `bounded` no farther
    under G64 without P too. `dwell_step` [s] as :class:`ExactPath`.
    """

    tolerance: float = 0.0
    bounded: bool = False
    dwell_step: float = 0.0

    def dwell(self, seconds: Array) -> Array:
        """Return how long the controller waits [s] where a program says `seconds`."""
        return rounded_up(seconds, self.dwell_step)


ControllerPlanner = ExactPath | RoundedPath


def rounded_up(seconds: Array, step: float) -> Array:
    """Round times [s] up to whole steps [s]; a step of 0 leaves them as they are.

    Examples
    --------
    >>> times = np.array([0.02, 0.1])
    >>> rounded_up(times, 0.05).tolist(), rounded_up(times, 0.0).tolist()
    ([0.05, 0.1], [0.02, 0.1])
    """
    return step * np.maximum(np.ceil(seconds / step - _ROUNDING), 0.0) if step > 0.0 else seconds
