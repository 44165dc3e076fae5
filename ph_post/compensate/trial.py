"""Try a design at one turning point: the motion around it, on every machine that the file leaves possible.

A design is tried alone, at the feed it would be laid into, from steady motion before it to steady motion
behind it. The whole program with all its designs is simulated afterwards, by :mod:`ph_post.compensate.prove`.
The surroundings of a window are the feed there, the path that may be used, and the direction every axis comes
from.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Final

import msgspec
import numpy as np

from ph_post.analysis.path_analysis import Analysis
from ph_post.compensate import profile as profiles
from ph_post.compensate import shapes
from ph_post.compensate.friction import Friction, FrictionLead
from ph_post.compensate.limit_curve import axis_limits
from ph_post.compensate.motion import STEADY, FeedAlong
from ph_post.compensate.offsets import Offsets, add_offsets, path_derivatives
from ph_post.compensate.violations import asked_of_motor, usage
from ph_post.drive.axes import lasting_offset
from ph_post.drive.effects.active import plant_of
from ph_post.drive.plant import TRUE_READING, Plant, read_table
from ph_post.geometry.track import Track
from ph_post.simulate.contour import Nominal, time_constant
from ph_post.simulate.machine import AxisCommand, cutting_force, path_velocity, run_plant
from ph_post.types import (
    Array,
    Command,
    Crossing,
    FeedProfile,
    FrictionChange,
    Jog,
    Machine,
    ProfileShape,
    Scenario,
    TurningPoint,
    Window,
    frozen,
)

REACH = 5.0
"""Time on either side that is looked at, at the feed of the place [s]."""

SAME_TURN = 1e-9
"""Reversals and stops less than this [m] apart along the path are at one place."""

SIDEWAYS = 1e-9
"""An axis whose part of the tangent is less than this does not move at a place."""


class Surroundings(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The surroundings of a window.

    `s` [m] is the turning point's, `cruise` [m/s] the feed of the plain plan there. `room` [m] is half the
    way to the next window, as far as the feed is steady: what a profile may take on either side. `before`
    and `behind` [m] are the path that is run at about that feed. `flanks` has the direction (1, -1) in which
    each axis moved before.
    """

    s: float
    cruise: float
    room: float
    before: float
    behind: float
    flanks: Mapping[str, int]


def find_surroundings(analysis: Analysis, feed: FeedAlong, looped: bool) -> tuple[Surroundings | None, ...]:
    """Look around every window; None where the motion begins, ends or rests."""
    windows = analysis.windows
    length = analysis.track.length
    rooms = half_distances([window.s for window in windows], length, looped)
    found: list[Surroundings | None] = []
    for window, half in zip(windows, rooms, strict=True):
        cruise = feed.at(window.s)
        sides = feed.steady_sides(window.s, REACH * cruise, STEADY * cruise) if cruise > 0.0 else (0.0, 0.0)
        if min(*sides, half) <= 0.0:
            found.append(None)
            continue
        flanks = {name: _flank(analysis, window, k) for k, name in enumerate(analysis.path.axes)}
        room = min(*sides, half)
        cruise = feed.lowest(window.s, room)
        found.append(
            Surroundings(s=window.s, cruise=cruise, room=room, before=sides[0], behind=sides[1], flanks=flanks)
        )
    return tuple(found)


def half_distances(places: Sequence[float], length: float, looped: bool) -> list[float]:
    """Half the distance from every place to the nearest other one [m]; the places ascend."""
    s = frozen(places)
    if s.size == 0 or (s.size == 1 and not looped):
        return [np.inf] * s.size
    gap = np.diff(np.concatenate([[s[-1] - length], s, [s[0] + length]]))
    if not looped:
        gap[[0, -1]] = np.inf
    rooms: list[float] = (0.5 * np.minimum(gap[:-1], gap[1:])).tolist()
    return rooms


def flanks_before(analysis: Analysis) -> dict[str, int]:
    """Side on which each axis was pushed before the beginning of a path that is run as a loop."""
    names = analysis.path.axes
    seam = {point.axis: point for point in analysis.turning_points if point.s <= SAME_TURN}
    return {
        name: came_from(seam[name]) if name in seam else direction_at(analysis.track, 0.0, number)
        for number, name in enumerate(names)
    }


def _flank(analysis: Analysis, window: Window, number: int) -> int:
    """Direction in which an axis moved before a window's turning point."""
    name = analysis.path.axes[number]
    own = [point for index in window.members if (point := analysis.turning_points[index]).axis == name]
    return came_from(own[0]) if own else direction_at(analysis.track, window.s, number)


def came_from(point: TurningPoint) -> int:
    """Direction in which the axis of a turning point moved before it: up to a maximum, down to a minimum."""
    return 1 if point.sense == "max" else -1


def direction_at(track: Track, s: float, number: int) -> int:
    """Direction (1, -1) in which an axis moves at a place; 0 where it does not."""
    tangent = track.arc_derivatives(*track.locate(np.array([s])), 1)[1, 0, number]
    return 0 if abs(tangent) < SIDEWAYS else int(np.sign(tangent))


LEAD: Final = 4.0
"""Servo time constants 2b/c of steady motion before a profile, the first half of which does not count."""

TAIL: Final = 5.0
"""Servo time constants of steady motion behind a profile: what it left rings out."""

LEAST: Final = 32
"""Samples of lead and tail at least."""

FULL_STOP: Final = 0.99
"""Part of the limits that a stop for jogs may take: softened for the rest of the path it would be no stop."""

EMPTY: Final[Mapping[str, Friction]] = MappingProxyType({})
"""No axis with friction."""

CONSTANT: Final = shapes.single([1.0])
"""No modulation."""


class Design(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """A change of the motion at a turning point: a profile, and crossings counted from its middle [s].

    `friction` are changes of the direction in which friction is led, counted likewise. `shape` None is the plain
    motion. `turn` is the share of the profile's way before the turning point. With `stop` the plain motion itself is
    to rest there.
    """

    shape: ProfileShape | None = None
    t_star: float = 0.0
    turn: float = 0.5
    crossings: tuple[Crossing | Jog, ...] = ()
    friction: tuple[FrictionChange, ...] = ()
    lead: bool = False
    stop: bool = False


class TrialResult(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The result of a design: `error` (scenarios,) is the largest contour error [m], `rms` likewise.

    `use` is the largest part of a limit that the command takes, `longer` the time it adds [s], and `slowest`
    the least speed [m/s].
    """

    error: Array
    rms: Array
    use: float
    longer: float
    slowest: float


class Trial:
    """One turning point, and the machines on which designs are tried there.

    Parameters
    ----------
    nominal : Nominal
        The path, ready for the search of nearest places.
    track : Track
    place : Surroundings
    machine : Machine
    scenarios : sequence of Scenario
    sized : Machine
        By which lasting offsets are sized.
    friction : mapping of str to Friction, optional
        By axis what designs with inverse dynamics lead.
    """

    def __init__(
        self,
        nominal: Nominal,
        track: Track,
        place: Surroundings,
        machine: Machine,
        scenarios: Sequence[Scenario],
        sized: Machine,
        friction: Mapping[str, Friction] = EMPTY,
    ) -> None:
        self.nominal, self.track, self.place = nominal, track, place
        self.machine, self.scenarios, self.sized = machine, tuple(scenarios), sized
        self.friction = friction
        self.axes, self.period = track.path.axes, machine.servo_period
        self.limits = axis_limits(self.axes, machine, self.period)
        self.constant = time_constant(machine, self.axes)
        self._plants = [[plant_of(machine.axes[name], one) for name in self.axes] for one in self.scenarios]

    @property
    def rows(self) -> int:
        """Samples of a plain motion: a measure of the work."""
        return int((LEAD + TAIL) * self.constant / self.period) + 2 * LEAST

    def run(self, design: Design) -> TrialResult:
        """Simulate a design in every scenario."""
        steady, command, speed = self._command(design)
        counted, most = (int(0.5 * duration / self.period) for duration in steady)
        path = command.position[0] if command.offset is None else command.position[0] - command.offset[0]
        traces = [
            AxisCommand(np.ascontiguousarray(column), float(place), float(pace))
            for column, place, pace in zip(command.position.T, path, speed[0], strict=True)
        ]
        velocity = path_velocity(command)
        errors = [self._error(traces, velocity, command.s, plants)[counted:] for plants in self._plants]
        shape = design.shape
        return TrialResult(
            error=np.array([np.abs(error).max() for error in errors]),
            rms=np.array([np.sqrt(np.mean(error * error)) for error in errors]),
            use=self._use(command, slice(counted, len(command.t) - most)),
            longer=0.0 if shape is None else 2.0 * design.t_star * (1.0 - shapes.mean(shape)),
            slowest=self.place.cruise * (1.0 if shape is None else shapes.lowest(shape)),
        )

    def _command(self, design: Design) -> tuple[tuple[float, float], Command, Array]:
        """Return times before and behind all that happens [s], the command, and the speed of the path (n, dim)."""
        profile = self._profile(design)
        place, way = self.place, 2.0 * profile.s_star
        events = (*design.crossings, *design.friction)
        early = max(max((-one.start for one in events), default=0.0) - profile.t_star, 0.0)
        late = max(max((one.end for one in events), default=0.0) - profile.t_star, 0.0)
        lead = self._cut(LEAD, place.before - way * profile.turn, early)
        tail = self._cut(TAIL, place.behind - way * (1.0 - profile.turn))
        steady = max(lead - early, 0.0), max(tail - late, 0.0)
        rows = max(round((lead + 2.0 * profile.t_star + tail) / self.period), LEAST) + 1
        t = np.arange(rows, dtype=np.float64) * self.period
        since: Array = t - (lead + profile.t_star)
        s = place.s + profiles.travelled(profile, since)
        s = np.mod(s, self.track.length) if self.track.closed else np.clip(s, 0.0, self.track.length)
        zero = np.zeros(rows, dtype=np.int64)
        plain = Command(
            axes=self.axes,
            period=self.period,
            t=t,
            segment=zero,
            xi=s,
            s=s,
            position=self.track.derivatives(*self.track.locate(s))[0],
            feed=profiles.feed(profile, since),
            window=zero,
        )
        speed, acceleration = path_derivatives(plain, self.track, profiles.acceleration(profile, since))
        middle = lead + profile.t_star
        crossings = [msgspec.structs.replace(one, start=one.start + middle) for one in design.crossings]
        if not crossings and not design.lead:
            return steady, plain, speed
        bias: dict[str, float] = {}
        if crossings:
            axes = ((name, self.sized.axes[name]) for name in self.axes)
            # The lasting offset of each axis before the turning point.
            bias = {
                name: lasting_offset(axis, self.place.flanks[name])
                for name, axis in axes
                if not axis.loop.encloses_backlash
            }
        friction = FrictionLead(
            axes=self.friction,
            initial=self.place.flanks,
            changes=tuple(msgspec.structs.replace(one, start=one.start + middle) for one in design.friction),
        )
        offset = Offsets(crossings=tuple(crossings), bias=bias, lead=design.lead, fade=False, friction=friction)
        led = add_offsets(plain, speed, acceleration, self.machine, offset)
        return steady, led, speed

    def _profile(self, design: Design) -> FeedProfile:
        """Lay the shape at the cruising feed; without one, a profile of constant feed."""
        shape = design.shape or CONSTANT
        t_star = design.t_star or LEAST * self.period
        way = shapes.half_length(shape, self.place.cruise, t_star)
        return FeedProfile(
            window=0,
            shape=shape,
            cruise=self.place.cruise,
            t_star=t_star,
            s_star=way,
            ratio=0.0,
            turn=design.turn,
        )

    def _cut(self, constants: float, room: float, early: float = 0.0) -> float:
        """Duration of lead or tail [s], as long as wanted where the path has room for it.

        Something begins `early` [s] before the profile.
        """
        wanted = max(constants * self.constant, LEAST * self.period) + early
        return max(min(wanted, room / self.place.cruise), 0.0)

    def _error(self, traces: Sequence[AxisCommand], velocity: Array, s: Array, plants: Sequence[Plant]) -> Array:
        """Signed contour error with the plants of one scenario, shape (n,) [m]."""
        tables: dict[str, Array] = {}
        for number, (name, plant) in enumerate(zip(self.axes, plants, strict=True)):
            trace = traces[number]
            if plant.cutting:
                trace = trace._replace(force=cutting_force(plant, velocity, number))
            tables[name] = run_plant(trace, plant, self.place.flanks[name], self.period)[0]
        return self.nominal.nearest(self._read(plants, tables), s).error

    def _read(self, plants: Sequence[Plant], tables: Mapping[str, Array]) -> Array:
        """Return what is read of the tables, shape (n, dim) [m], as cold as when the motion begins."""
        if all(plant.reading == TRUE_READING for plant in plants):
            return np.stack(list(tables.values()), axis=1)
        cold = np.zeros(len(next(iter(tables.values()))))
        pairs = zip(plants, tables.items(), strict=True)
        return np.stack([read_table(one, cold, table, tables) for one, (_, table) in pairs], axis=1)

    def _use(self, command: Command, counted: slice) -> float:
        """Largest part of a limit that a command takes; jogs keep theirs, as the path rests meanwhile.

        Only some rows are `counted`: what leads the path does not know the motion before and behind them all.
        """
        jogged = command.jogged
        position = (command.position if jogged is None else command.position - jogged)[counted]
        use = max(float(usage(position, self.limits, order, 0.0).max()) for order in (1, 2, 3))
        return max(use if jogged is None else use / FULL_STOP, self._motor_use(command))

    def _motor_use(self, command: Command) -> float:
        """Largest part of the motors' acceleration that what is added to the path asks for."""
        parts = [0.0]
        for number, name in enumerate(self.axes):
            axis = self.machine.axes[name]
            if axis.limits.motor_acceleration is not None:
                asked = asked_of_motor(command, axis, number)
                parts.append(float(asked.max()) / axis.limits.motor_acceleration)
        return max(parts)
