"""Simulate a command on the machine: every axis as the hybrid automaton of its drive, with cutting forces.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, sections 3.3 and 5.3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from msgspec.structs import replace

from ph_post.compiling import read_only
from ph_post.drive.automaton import STATES, Key, Zone
from ph_post.drive.command_filters import Arriving, arriving
from ph_post.drive.effects.active import plant_of
from ph_post.drive.hybrid import Automaton, build_automaton, given_by
from ph_post.drive.plant import (
    TRUE_READING,
    Plant,
    coast,
    delayed,
    force_on,
    gap_at,
    read_table,
    referred_table,
    table_behind,
)
from ph_post.simulate import kernel
from ph_post.simulate.slow import NO_STATES, SlowAxis, level_for, modes_of, used_columns
from ph_post.types import Array, Axis, Command, Event, EventKind, IntArray, Machine, Run, Scenario, sealed

STANDSTILL: Final = 1e-9
"""Feeds up to this [m/s] are rounding: nothing is cut."""


def cutting_force(plant: Plant, velocity: Array, number: int) -> Array:
    """Return what resists one axis while the tool cuts, F/K [m].

    Along the path that is F (|v|/v_0)^k, and the axis has its component of it, times v_i/|v|; at a
    standstill there is none. Rapids and cuts are not distinguished: a rapid cuts too.

    Parameters
    ----------
    plant : Plant
        Of which only `cutting` counts: F [m], v_0 [m/s] and k of each force.
    velocity : Array, shape (n, dim)
        Of all axes of the path [m/s].
    number : int
        Column of the axis.

    Returns
    -------
    Array, shape (n,)

    Examples
    --------
    >>> plant = Plant(feedback="load", b=5e-4, c=5e-3, cutting=((1e-5, 0.01, 1.0),))
    >>> cutting_force(plant, np.array([[0.0, 0.0], [0.03, 0.04], [-0.06, 0.08]]), 0)
    array([ 0.e+00,  3.e-05, -6.e-05])
    """
    speed = np.linalg.norm(velocity, axis=1)
    cuts = speed > STANDSTILL
    feed = np.where(cuts, speed, 1.0)
    along = np.zeros(speed.size)
    for force, at, exponent in plant.cutting:
        along += force * (feed / at) ** exponent
    return np.asarray(np.where(cuts, along * velocity[:, number] / feed, 0.0))


def path_velocity(command: Command) -> Array:
    """Return the velocity of the path's points (n, dim) [m/s] by central differences of a command's rows.

    What the command has beyond the path (a gap that is crossed, a lead) is no motion of the tool.
    """
    path = command.position if command.offset is None else command.position - command.offset
    if len(path) == 1:
        return np.zeros_like(path)
    return np.asarray(np.gradient(path, command.period, axis=0))


AT_REST: Final = 1e-12
"""Speeds at the first sample up to this [m/s] are none."""

NO_FORCE: Final = np.zeros(0)

NOMINAL_SCENARIO: Final = Scenario()
"""The machine file's own values, with standstill and the side "+" where it leaves them open."""

_FORWARD: Final = np.array([-25.0, 48.0, -36.0, 16.0, -3.0]) / 12.0
"""First derivative at the first of five equidistant samples, of fourth order."""


def simulate(command: Command, machine: Machine, scenario: Scenario = NOMINAL_SCENARIO) -> Run:
    """Run a command on a machine.

    Between rows the command is linear. An axis that moves at the first row starts on the path with the
    path's speed, engaged in the direction of its motion; one that rests there starts on the flank that
    machine file or scenario say. What cuts does so by the path as it is commanded, rapids included: by how
    much an axis is late makes no difference to that force.

    Parameters
    ----------
    command : Command
    machine : Machine
        With a drive for every axis of the command.
    scenario : Scenario, optional
        Which of the machines that the file leaves possible.

    Returns
    -------
    Run
        `executed` is what is read of the tables (:func:`ph_post.drive.plant.read_table`), the time counted
        from the first row on.
    """
    return Runs(command, machine).of(scenario)


KEPT: Final = 2
"""Runs of an axis that are kept at least for the next scenarios, which differ in the sides of the axes."""

SPACE: Final = 16_000_000
"""What runs that are kept for those who measure the same scenarios otherwise may take [bytes]."""


class Runs:
    """Runs of one command in several scenarios; an axis that is alike in some of them runs once.

    Parameters
    ----------
    command : Command
    machine : Machine
        As of :func:`simulate`.
    """

    def __init__(self, command: Command, machine: Machine) -> None:
        self._command, self._machine = command, machine
        many = SPACE // (2 * command.t.nbytes)
        self._run_axis = lru_cache(maxsize=many)(self._axis)
        # Of a long command the tables alone are kept: few ask for the motors.
        self._table = lru_cache(maxsize=max(KEPT * len(command.axes), many))(lambda *key: self._run_axis(*key)[0])

    def of(self, scenario: Scenario) -> Run:
        """Run a machine; see :func:`simulate`."""
        command = self._command
        axes = [self._run_axis(*key) for key in self._keys(scenario)]
        events = [event for name, one in zip(command.axes, axes, strict=True) for event in list_events(one[2], name)]
        return Run(
            axes=command.axes,
            period=command.period,
            scenario=scenario,
            t=command.t,
            s=command.s,
            commanded=command.position,
            executed=sealed(np.stack(self._read(scenario, [table for table, _, _ in axes]), axis=1)),
            motor=sealed(np.stack([motor for _, motor, _ in axes], axis=1)),
            events=tuple(sorted(events, key=lambda event: (event.t, event.axis))),
        )

    def tables(self, scenario: Scenario) -> list[Array]:
        """Return the columns (n,) of what a run has as `executed` [m], alone; those of axes that are alike are one."""
        return self._read(scenario, [self._table(*key) for key in self._keys(scenario)])

    def forget(self) -> None:
        """Let go of the runs that are kept, where they take much."""
        if KEPT * self._command.t.nbytes > SPACE:
            self._run_axis.cache_clear()
            self._table.cache_clear()

    def _keys(self, scenario: Scenario) -> Iterator[tuple[int, Plant, int]]:
        """Yield number, plant and first flank of every axis."""
        command, drives = self._command, self._machine.axes
        for number, name in enumerate(command.axes):
            flank = command.flanks.get(name) or first_flank(drives[name], scenario)
            yield number, plant_of(drives[name], scenario), flank

    def _read(self, scenario: Scenario, axes: Sequence[Array]) -> list[Array]:
        """Return what is read of the tables, each (n,) [m]."""
        command = self._command
        tables = dict(zip(command.axes, axes, strict=True))
        since = command.t - command.t[0]
        plants = (plant_of(self._machine.axes[name], scenario) for name in tables)
        return [read_table(plant, since, tables[name], tables) for name, plant in zip(tables, plants, strict=True)]

    def _axis(self, number: int, plant: Plant, flank: int) -> AxisRun:
        trace = axis_command(self._command, number)
        if plant.cutting:
            trace = trace._replace(force=cutting_force(plant, path_velocity(self._command), number))
        table, motor, changes = run_plant(trace, plant, flank, self._command.period)
        return sealed(table), sealed(motor), changes


class AxisCommand(NamedTuple):
    """The command of one axis.

    `position` (n,) [m], place and speed of the path at the beginning, and when that is [s]; `force` (n,) is
    what else resists the body that feels friction, linear between samples, F/K [m].
    """

    position: Array
    place: float
    speed: float
    begin: float = 0.0
    force: Array | None = None


class Changes(NamedTuple):
    """The modes by number, the first of a run, and when (n,) [s] which gave way to which (n, 2)."""

    keys: tuple[Key, ...]
    first: int
    t: Array
    log: IntArray


AxisRun = tuple[Array, Array, Changes]
"""Table and motor of one axis (n,) [m], and the changes of its mode."""


def axis_command(command: Command, number: int) -> AxisCommand:
    """Take one axis out of a command."""
    position = np.ascontiguousarray(command.position[:, number])
    path = position[:5] if command.offset is None else position[:5] - command.offset[:5, number]
    speed = 0.0
    if command.feed[0] != 0.0 and path.size == _FORWARD.size:
        speed = float(_FORWARD @ path) / command.period
    speed = 0.0 if abs(speed) <= AT_REST else speed
    return AxisCommand(position, float(path[0]), speed, float(command.t[0]))


def first_flank(axis: Axis, scenario: Scenario) -> int:
    """Flank on which an axis stands before its first motion."""
    known = axis.gap.initial_flank
    if known != "unknown":
        return 1 if known == "+" else -1
    side = -1 if scenario.flank == "-" else 1
    return -side if axis.name in scenario.opposite else side


def arrive(trace: AxisCommand, plant: Plant, period: float) -> Arriving:
    """Return the command of an axis as it reaches the loop of a plant: late, and filtered."""
    sent = delayed(trace.position, plant.command_delay / period)
    return Arriving(sent, NO_FORCE) if plant.cascade is None else arriving(plant.cascade, sent, trace.speed, period)


def run_plant(
    trace: AxisCommand,
    plant: Plant,
    flank: int,
    period: float,
    given: Array = NO_FORCE,
    arrived: Arriving | None = None,
) -> tuple[Array, Array, Changes]:
    """Run one plant that stands on `flank` (1, -1) if it does not move: table and motor [m], and changes.

    The table is where it is, referred to the side where its zero was taken; not what screw or scale make its reading.
    `given` (n,), where it has room, receives what the loops give: :func:`ph_post.drive.hybrid.given_by`. `arrived` is
    what :func:`arrive` says, where that is known.
    """
    linear = replace(plant, forces=(), cutting=(), reading=TRUE_READING, slows=math.inf)
    automaton = build_automaton(linear)
    sent, fed = arrive(trace, plant, period) if arrived is None else arrived
    command, fed = read_only(sent), read_only(fed)
    z, first = _start(trace._replace(position=command), plant, automaton, flank)
    table, motor = np.empty(command.size), np.empty(command.size)
    states = np.empty((command.size, STATES)) if given.size else NO_STATES
    force = read_only(NO_FORCE if trace.force is None else trace.force)
    if plant.forces:
        axis = SlowAxis(plant, command, period, trace.begin, force, fed)
        instants, log = axis.run(z, first, table, motor, states)
    else:
        modes = modes_of(linear, period)
        if force.size:
            modes = modes._replace(used=used_columns(linear, modes.tables, pushed=True))
        if (level := level_for(linear, command)) != modes.level:
            modes = modes._replace(level=level)
        _, instants, log = kernel.advance(command, period, z, first, modes, force, fed, table, motor, states)
    if given.size:
        given[:] = given_by(linear, command, fed, states, period)
    if plant.slows < math.inf:
        table = coast(motor, plant.gap, plant.slows, period)
    changes = Changes(automaton.keys, first, trace.begin + instants * period, log)
    return delayed(referred_table(plant, table), plant.reading_delay / period), motor, changes


def _start(trace: AxisCommand, plant: Plant, automaton: Automaton, flank: int) -> tuple[Array, int]:
    """State and mode at the first sample.

    The table of a `load` loop starts on the path; the motor of the others where its servo lags behind the
    command in steady motion. An integrator starts with what steady motion needs.
    """
    direction = int(np.sign(trace.speed))
    flank = direction or flank
    if not any(key[0] == flank for key in automaton.keys):
        flank = automaton.keys[0][0]  # the load keeps a play on that one
    z = np.zeros(STATES)
    if plant.loop.encloses_backlash:
        z[0], z[1], z[3] = trace.place, trace.speed, trace.speed
        z[2] = z[0] + 0.5 * flank * gap_at(plant, z[0])
    else:
        z[2] = trace.position[0] - _steady_lag(plant, trace.speed)
        z[3] = trace.speed
        z[0] = table_behind(plant, z[2], flank)
        z[1] = trace.speed if plant.windup_frequency else 0.0
    cascade, error = plant.cascade, 0
    rate = plant.ki if cascade is None else cascade.integral_rate
    if rate or cascade is not None:
        force = force_on(plant, trace.begin, trace.place, trace.speed, direction)
        force += 0.0 if trace.force is None else float(trace.force[0])
        force += sum(size * math.sin(math.tau * z[2] / wave + phase) for size, wave, phase in plant.cogging)
        holding = plant.c * trace.speed + plant.load + force
        z[4] = holding / rate if rate else 0.0
        z[5] = holding if cascade is not None and cascade.current_time else 0.0
    if cascade is not None and cascade.deadband:
        off = trace.position[0] - plant.loop.closed_over(z[0], z[2])
        error = int(np.sign(off)) if abs(off) > cascade.deadband else 0
    return z, automaton.keys.index((flank, direction, Zone(error=error).number))


def _steady_lag(plant: Plant, speed: float) -> float:
    """Following error of a motor at a steady speed, without friction [m]."""
    cascade = plant.cascade
    if cascade is None:
        return plant.c * speed * (plant.ki == 0.0)
    late = (1.0 - cascade.velocity_feedforward) * speed / cascade.position_gain
    late += plant.c * speed * (cascade.integral_rate == 0.0)
    return late + cascade.deadband * float(np.sign(late))


def list_events(changes: Changes, name: str) -> list[Event]:
    """Put the changes of mode into words; modes that last no time are passed over."""
    events: list[Event] = []
    keys, first, t, log = changes
    flank = keys[first][0]
    row = 0
    while row < len(log):
        last = row
        while last + 1 < len(log) and t[last + 1] == t[row] and log[last, 1] != kernel.CHATTERS:
            last += 1
        before, after = keys[log[row, 0]], keys[log[last, 1]]
        kinds: list[EventKind] = ["chatters"]
        if log[last, 1] != kernel.CHATTERS:
            kinds = _kinds(before, after, flank)
            flank = after[0] or before[0] or flank
        events += [Event(t=float(t[row]), axis=name, kind=kind) for kind in kinds]
        row = last + 1
    return events


def _kinds(before: Key, after: Key, flank: int) -> list[EventKind]:
    """Name a change of mode; `flank` is the one touched last."""
    kinds: list[EventKind] = []
    if before[0] and not after[0]:
        kinds.append("opens")
    elif after[0] and not before[0]:
        kinds.append("falls back" if after[0] == flank else "picks up")
    elif before[1] and not after[1]:
        kinds.append("sticks")
    elif after[1] and not before[1]:
        kinds.append("slips")
    if Zone.of(before[2]).torque != Zone.of(after[2]).torque:
        kinds.append("saturates" if Zone.of(after[2]).torque else "recovers")
    return kinds
