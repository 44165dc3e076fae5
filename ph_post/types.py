"""The records that flow through the program: frozen, keyword-only, SI units, arrays float64 and read-only.

Everything between reading and writing maps these values to values (see the code map in README.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Literal, Protocol, TypeVar

import msgspec
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]

Sealed = TypeVar("Sealed", bound=NDArray[Any])

Sense = Literal["max", "min"]
TurningKind = Literal["smooth", "corner", "dwell", "cusp"]
WindowLimit = Literal["deviation", "neighbour", "end", "corner"]
Feedback = Literal["load", "motor", "none"]
Flank = Literal["+", "-", "unknown"]
Pickup = Literal["standstill", "momentum", "contact"]
EventKind = Literal["opens", "picks up", "falls back", "sticks", "slips", "saturates", "recovers", "chatters"]


def frozen(values: Any) -> Array:
    """Return `values` as a read-only float64 array (records hold no other)."""
    return sealed(np.array(values, dtype=np.float64))


def sealed(array: Sealed) -> Sealed:
    """Return an array that nobody else holds, from now on read-only: :func:`frozen` without a copy."""
    array.setflags(write=False)
    return array


class Curve(Protocol):
    """What a segment's curve offers to those who read paths; implemented in :mod:`ph_post.geometry`."""

    @property
    def dimension(self) -> int:
        """2 or 3."""

    @property
    def domain(self) -> tuple[float, float]:
        """Range of the parameter xi, as the path file has it."""

    def derivatives(self, xi: Array, order: int = 0) -> Array:
        """Values and derivatives with respect to xi, shape (order + 1, n, dimension) [m]."""


class Segment(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """One segment of a path; `feed` [m/s] overrides the path's."""

    curve: Curve
    feed: float | None = None
    rapid: bool = False


class Path(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """An analytic toolpath. `feed` in m/s; `digest` is the hash of the bytes it was read from."""

    name: str
    source: str
    axes: tuple[str, ...]
    feed: float
    closed: bool
    segments: tuple[Segment, ...]
    digest: str = ""


class Servo(msgspec.Struct, frozen=True, kw_only=True):
    """Closed loop of one axis: b [s²] and c [s] of Eq. (9), and the PI/PID gains relative to k_p.

    `stiffness` [N/m] is the force on the table that a P loop answers with a position error of one metre,
    k_p k_a k_t N / r; None where the file does not tell it.
    """

    b: float
    c: float
    ki_over_kp: float = 0.0
    kd_over_kp: float = 0.0
    stiffness: float | None = None


class Gap(msgspec.Struct, frozen=True, kw_only=True):
    """Backlash of one axis.

    `lost_motion` [m] is what a dial indicator shows, r Δθ_m / N. The other fields are None where a
    `motor` or `none` axis does not need them: `motor_angle` Δθ_m [rad], `gear_ratio` N,
    `travel_per_rad` r [m/rad], `inertia_fraction` η, `beta` 1/τ [1/s].
    """

    lost_motion: float
    motor_angle: float | None = None
    gear_ratio: float | None = None
    travel_per_rad: float | None = None
    inertia_fraction: float | None = None
    beta: float | None = None
    pickup: Pickup | None = None
    initial_flank: Flank = "unknown"


class Limits(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of one axis [m/s, m/s², m/s³, rad/s²]; `motor_acceleration` is None where not given."""

    velocity: float
    acceleration: float
    jerk: float
    motor_acceleration: float | None = None


class EffectSetting(msgspec.Struct, frozen=True, kw_only=True):
    """A physical effect switched on in the machine file: its name and its parameters, as they stand there."""

    name: str
    parameters: Mapping[str, Any]


class Uncertainty(msgspec.Struct, frozen=True, kw_only=True):
    """Relative uncertainties of one axis' drive parameters."""

    backlash: float = 0.2
    beta: float = 0.2
    gain: float = 0.2


class Axis(msgspec.Struct, frozen=True, kw_only=True):
    """One axis of a machine: its drive and its limits."""

    name: str
    feedback: Feedback
    servo: Servo
    gap: Gap
    limits: Limits
    uncertainty: Uncertainty = Uncertainty()
    effects: tuple[EffectSetting, ...] = ()


class Machine(msgspec.Struct, frozen=True, kw_only=True):
    """A machine: axes by name, controller dialect and servo period [s]."""

    name: str
    dialect: str
    servo_period: float
    axes: Mapping[str, Axis]
    digest: str = ""


class TurningPoint(msgspec.Struct, frozen=True, kw_only=True, eq=False, gc=False):
    """Where one axis reverses.

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


class Piece(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Part of a shape: its `share` of the duration, and V_k / V_c in Bernstein form on that part."""

    share: float
    coefficients: Array


class Shape(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """V / V_c of a feed profile over its duration: pieces one after the other, whose shares add up to 1.

    A shape of one piece is Eq. (26). A piece of nothing but zeros is a hold: the path stands still. See
    :mod:`ph_post.compensate.profile` for how shapes are made and what they do.
    """

    pieces: tuple[Piece, ...]


class FeedProfile(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The feedrate modulation of one window: a shape on [-t_star, t_star].

    `cruise` V_c [m/s]; `s_star` [m], half the way it takes, from Eq. (27); `turn` the share of that way that
    lies before the turning point, the middle in Eq. (29). `ratio` is V(½)/V_c as emitted, of several pieces
    the lowest V/V_c. `strategy` names what was chosen where a strategy chooses among others; `notes` say
    where it was softened, shortened or left out.
    """

    window: int
    shape: Shape
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
        """How long it takes [s]: two ramps, and between them what they leave at full velocity."""
        way, ramp = abs(self.travel), self.velocity / self.acceleration
        if way <= self.velocity * ramp:
            return 2.0 * math.sqrt(way / self.acceleration)
        return way / self.velocity + ramp

    @property
    def end(self) -> float:
        """When it is over [s]."""
        return self.start + self.duration


class Plan(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What will be commanded: phases one after the other from s = 0 to the path's end.

    `nominal` are the phases without any profile, for comparison. `profiles` holds one entry a window,
    None where nothing is modulated there. `crossings` are the path modifications, in the order of time, jogs
    where the plan becomes a part program; `bias` [m] is by axis the lasting offset with which the motion
    begins. `inverse_dynamics` says whether the command leads the path by what the servo lags behind. `flanks`
    has the side (1, -1) on which each axis was pushed before a motion that runs through the seam of a closed
    path; empty for others.
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
    bias: Mapping[str, float] = {}
    inverse_dynamics: bool = False
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


class Scenario(msgspec.Struct, frozen=True, kw_only=True):
    """One of the machines that a machine file leaves possible.

    `pickup` and `flank` stand in place of what the file leaves open (None: standstill, and the flank "+");
    `gap`, `beta` and `gain` are factors on the file's values. A gap of 0 is the machine without backlash.
    """

    pickup: Pickup | None = None
    flank: Literal["+", "-"] | None = None
    gap: float = 1.0
    beta: float = 1.0
    gain: float = 1.0


class Event(msgspec.Struct, frozen=True, kw_only=True):
    """What happened inside an axis at `t` [s].

    The gap `opens`; the motor `picks up` the table on the other flank, or `falls back` on the old one; the
    table `sticks` and `slips` where there is friction; the motor's torque `saturates` and `recovers`; an axis
    `chatters` where more happens within a sample than is followed.
    """

    t: float
    axis: str
    kind: EventKind


class Run(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A simulated motion, one row a sample, SI units.

    `commanded`, `executed` and `motor` [m], shape (n, dimension): `executed` is the table, `motor` the
    motor's side in units of the table; they differ by at most half the gap, referred to its middle. `s` [m]
    is where on the path the command stands.
    """

    axes: tuple[str, ...]
    period: float
    scenario: Scenario
    t: Array
    s: Array
    commanded: Array
    executed: Array
    motor: Array
    events: tuple[Event, ...]


class Capabilities(msgspec.Struct, frozen=True, kw_only=True):
    """What a dialect can carry."""

    arcs: bool
    cubic_splines: bool
    inverse_time: bool
    decimals: int
    max_line: int
    blending: bool
    """Whether a path-blending word (G64) is understood."""
    dwells: bool = True
    """Whether the axes stand still in a G4, so that a short move between two of them is not blended away."""
    polynomial_degree: int = 1
    """Highest degree of a block that is a polynomial, or a quotient of two, of each axis; 1 where there is
    none but the straight move."""
    feed_degree: int = 0
    """Highest degree of the feed of one block as a polynomial of the way; 0 where a block has one feed."""


LogSide = Literal["table", "unknown"]
EffortUnit = Literal["N", "A"]


class AxisLog(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """What was recorded of one axis, a value a sample, shape (n,); NaN where a sample is missing.

    `command` [m], never NaN; `table` [m] (`_act`) and `motor` [m] (`_motor`, in units of the table); `effort`
    in `effort_unit`, the force on the table or the motor's current. None where there is no such column.
    `side` is "unknown" where nobody knows whether `table` was read at the table or at the motor.
    """

    command: Array
    table: Array | None = None
    motor: Array | None = None
    effort: Array | None = None
    effort_unit: EffortUnit = "N"
    side: LogSide = "table"


class Log(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A measured or simulated record at a constant period [s]; `t` [s] begins where the record does.

    `remarks` are its ``# key: value`` lines; `digest` is the hash of the bytes it was read from; `jitter` [s]
    is the largest departure of a sample from the constant period, `missing` how many rows were filled in as
    missing; `warnings` say what the reader had to do.
    """

    name: str
    t: Array
    period: float
    axes: Mapping[str, AxisLog]
    digest: str = ""
    jitter: float = 0.0
    missing: int = 0
    remarks: Mapping[str, str] = {}
    warnings: tuple[str, ...] = ()
