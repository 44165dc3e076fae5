"""Records of a plan: backlash intervals, motion in time, feed profiles, crossings, jogs, the sampled command."""

from __future__ import annotations

import math
from collections.abc import Mapping

import msgspec

from ph_post.types.arrays import Array, IntArray
from ph_post.types.machine import Machine
from ph_post.types.path import Path, TurningPoint, Window


class BacklashInterval(msgspec.Struct, frozen=True, kw_only=True):
    """One backlash interval.

    `lag` [s] of the reversal behind the command's, `duration` Δt [s], `position` x_i [m] at which the axis
    stands (about the centre of its swing), `residual` of Eq. (21) [rad] (0 where a closed form holds).
    """

    lag: float
    duration: float
    position: float
    residual: float = 0.0


class Phase(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A stretch of time [start, start + duration] [s] with the speed along the path [m/s] in Bernstein form.

    `speed` are the coefficients V_0 … V_n of Eq. (26) in τ = (t - start) / duration; `s` [m] is the place on
    the path at its start. `window` is the index of the window it modulates, -1 outside.
    """

    start: float
    duration: float
    s: float
    speed: Array
    window: int = -1


class ProfilePiece(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Part of a shape: its `share` of the duration, and V_k / V_c in Bernstein form on that part."""

    share: float
    coefficients: Array


class ProfileShape(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """V / V_c of a feed profile over its duration: pieces one after the other, whose shares add up to 1.

    A shape of one piece is Eq. (26). A piece of nothing but zeros is a hold: the path stands still. See
    :mod:`ph_post.compensate.profile` for how shapes are made and what they do.
    """

    pieces: tuple[ProfilePiece, ...]


class FeedProfile(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The feedrate modulation of one window: a shape on [-t_star, t_star].

    `cruise` V_c [m/s]; `s_star` [m], half the way it takes, from Eq. (27); `turn` the share of that way that
    lies before the turning point, the middle in Eq. (29). `ratio` is V(½)/V_c as emitted, of several pieces
    the lowest V/V_c. `strategy` names what was chosen where a strategy chooses among others; `notes` say
    where it was softened, shortened or left out.
    """

    window: int
    shape: ProfileShape
    cruise: float
    t_star: float
    s_star: float
    ratio: float
    turn: float = 0.5
    strategy: str = ""
    notes: tuple[str, ...] = ()

    @property
    def coefficients(self) -> Array | None:
        """V_k / V_c of Eq. (26), None where the shape has several pieces."""
        return self.shape.pieces[0].coefficients if len(self.shape.pieces) == 1 else None


class Crossing(msgspec.Struct, frozen=True, kw_only=True):
    """A commanded crossing of the gap of one axis.

    From `start` [s] on, for `duration` [s], the motor travels `travel` [m], signed, as a polynomial whose
    derivatives up to `order` vanish at both ends. On a `load` axis it travels inside the gap while the table
    stands; behind the loop of the others the travel is a lasting offset of the command. Then `push` [m],
    signed, is added to the command for `push_duration` [s], which brings the motor to the flank if the gap
    is wider than expected. `window` is the index of the window it belongs to, -1 where it belongs to none.
    """

    axis: str
    start: float
    duration: float
    travel: float
    order: int = 3
    push: float = 0.0
    push_duration: float = 0.0
    window: int = -1

    @property
    def end(self) -> float:
        """When it is over, push included [s]."""
        return self.start + self.duration + self.push_duration


class Jog(msgspec.Struct, frozen=True, kw_only=True):
    """A crossing that a part program can carry: one short move of one axis while the path stands still.

    From `start` [s] on the axis is commanded by `travel` [m], signed, farther than the path, and stays there.
    The controller runs it with straight ramps at `acceleration` [m/s²], no faster than `velocity` [m/s],
    which is the F word; its jerk is the controller's own. `window` is the index of the window it belongs to,
    -1 where it belongs to none.
    """

    axis: str
    start: float
    travel: float
    velocity: float
    acceleration: float
    window: int = -1

    @property
    def duration(self) -> float:
        """Duration [s]: two ramps, and between them the rest of the way at full velocity."""
        way, ramp = abs(self.travel), self.velocity / self.acceleration
        if way <= self.velocity * ramp:
            return 2.0 * math.sqrt(way / self.acceleration)
        return way / self.velocity + ramp

    @property
    def end(self) -> float:
        """When it is over [s]."""
        return self.start + self.duration


class FrictionChange(msgspec.Struct, frozen=True, kw_only=True):
    """A change of the direction in which a command leads the friction of one axis, at a reversal.

    From `start` [s] on its share of the command goes in `release` [s] from that of the direction `before` (1, -1, 0
    where none was led) to the part `held` of that of `after`, stays there for `hold` [s], and goes to all of it in
    `take` [s]. `window` is the index of the window it belongs to, -1 where it belongs to none.
    """

    axis: str
    start: float
    release: float
    before: int
    after: int
    hold: float = 0.0
    take: float = 0.0
    held: float = 1.0
    window: int = -1

    @property
    def duration(self) -> float:
        """Duration [s]."""
        return self.release + self.hold + self.take

    @property
    def end(self) -> float:
        """When it is over [s]."""
        return self.start + self.duration


class Plan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Planned motion: phases one after the other from s = 0 to the path's end.

    `nominal` are the phases without any profile, for comparison. `profiles` holds one entry a window,
    None where nothing is modulated there. `crossings` are the path modifications, in the order of time, jogs
    where the plan becomes a part program, made by the strategy `crosses_by` where no profile names one, or else
    by `strategy`; `bias` [m] is by axis the lasting offset with which the motion
    begins. `inverse_dynamics` says whether the command leads the path by what the servo lags behind, `lead` by which
    part of it through a window of `lead_width` times the usual one, and `friction_part` how much of the axes' friction
    it leads then, whose direction turns by `friction`.
    `flanks`
    has the side (1, -1) on which each axis was pushed before a motion that runs through the seam of a closed path,
    and that on which a program's approach leaves it; empty for others.
    """

    path: Path
    machine: Machine
    strategy: str
    turning_points: tuple[TurningPoint, ...]
    windows: tuple[Window, ...]
    intervals: tuple[BacklashInterval | None, ...]
    profiles: tuple[FeedProfile | None, ...]
    nominal: tuple[Phase, ...]
    phases: tuple[Phase, ...]
    crossings: tuple[Crossing | Jog, ...] = ()
    crosses_by: str = ""
    bias: Mapping[str, float] = {}
    inverse_dynamics: bool = False
    friction_part: float = 0.0
    friction: tuple[FrictionChange, ...] = ()
    lead: float = 1.0
    lead_width: float = 1.0
    flanks: Mapping[str, int] = {}
    warnings: tuple[str, ...] = ()


class Command(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Sampled motion, one row a servo period: everything downstream of the plan reads only this.

    `t` [s], `segment`, `xi`, `s` [m], `position` [m] shape (n, dimension), `feed` [m/s] signed along the
    path, `window` index or -1. `offset` [m], of the shape of `position`, is what a strategy added to the
    point of the path; None where that is nothing. `jogged` [m] is the part of it that moves as the controller
    moves its axes, without a limit of jerk; None where there is none. `flanks` are those of the plan.
    """

    axes: tuple[str, ...]
    period: float
    t: Array
    segment: IntArray
    xi: Array
    s: Array
    position: Array
    feed: Array
    window: IntArray
    offset: Array | None = None
    flanks: Mapping[str, int] = {}
    jogged: Array | None = None
