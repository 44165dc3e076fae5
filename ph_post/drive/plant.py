"""The physical constants of one axis in the units of its table, its gap profile, reading and following error.

Everything on the motor's side is scaled to the table, m = r θ_m / N, and every force to the position error
that would hold it in a P loop, F/K. With that N, r and the gains drop out of section 3 of [1]_: engaged, the
axis obeys b ẍ + c ẋ = u with the controller's output u = e + (k_i/k_p) ∫e + (k_d/k_p) ė; in the gap, the
motor η b (m̈ + β ṁ) = u (Eq. 16) and the table (1 - η) b ẍ + (c - η β b) ẋ = 0 (section 3.3).

Screw, scale and growth lie outside of the loop: the parts of an independent gauge's reading add up, each of
the true position, so that their order in the machine file makes no difference.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, section 3.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

import msgspec
import numpy as np
from msgspec.structs import replace

from ph_post.compiling import compiled
from ph_post.types import LOOPS, Array, Axis, Cascade, Feedback, Loop, Pickup, Scenario

Force = Callable[[float, float, float, float], float]
"""A force that resists motion, F/K [m].

A function of t [s] (that of the command's rows), of position [m] and speed [m/s] of the body that feels
friction, the table of a `load` loop and the motor of the others, and of the direction (1, -1; 0 at rest) that
it moves in.
"""


class TableReading(msgspec.Struct, frozen=True, kw_only=True):
    """What stands between the table and its reading, outside of the loop.

    Parameters
    ----------
    cycles : tuple of (amplitude, period, phase)
        A sin(2π x/p + φ) of screw or scale [m, m, rad].
    scale : float
        Excess of the reading for each metre of travel.
    growths : tuple of (growth, time constant)
        Thermal growth, from the beginning of the motion on [m, s].
    others : tuple of (axis, angle)
        Position of another axis that is read along [rad].
    """

    cycles: tuple[tuple[float, float, float], ...] = ()
    scale: float = 0.0
    growths: tuple[tuple[float, float], ...] = ()
    others: tuple[tuple[str, float], ...] = ()


class GapProfile(msgspec.Struct, frozen=True, kw_only=True):
    """The local excess of the gap at x: slope (x - reference) and a Gaussian bump, all in metres.

    The bump is bump exp(-((x - centre)/width)²/2).
    """

    slope: float = 0.0
    reference: float = 0.0
    bump: float = 0.0
    centre: float = 0.0
    width: float = 1.0


class Plant(msgspec.Struct, frozen=True, kw_only=True):
    """One axis with its effects.

    Parameters
    ----------
    feedback : {"load", "motor", "none"}
    b, c : float
        Eq. (9): [s²], [s]. Both 0 for an ideal stepper.
    ki, kd : float
        k_i/k_p [1/s], k_d/k_p [s].
    cascade : Cascade, optional
        In place of these; c is then the axis' own damping alone.
    eta, beta : float
        The motor's part of the inertia, and its own decay rate [1/s]; used with feedback `load` only.
    gap : float
        Lost motion [m].
    widening : GapProfile, optional
        What the gap has beyond that from place to place; see :func:`ph_post.drive.plant.gap_at`.
    reference : int
        Side of the gap to which the table's position is referred (1, -1), 0 for the middle; see
        :func:`ph_post.drive.plant.referred_table`.
    pickup : {"standstill", "momentum", "contact"}
    kept : float
        Part of the plastic impact's momentum that survives a pick-up under `momentum` and `contact`.
    coulomb_plus, coulomb_minus : float
        Friction while moving up and down, F/K [m], both positive.
    static : float
        What friction has more than that at rest, F/K [m].
    stribeck_speed : float
        Speed over which the static part dies out as exp(-(v/v_s)²) [m/s]; 0: at once.
    viscous_plus, viscous_minus : float
        Added to c while moving up and down [s].
    load : float
        Constant force on the table towards minus, F/K [m].
    windup_frequency, windup_damping : float
        Table against a locked motor [rad/s], and damping ratio; frequency 0 is a rigid drive.
    saturation : float
        Largest |u| that the motor can give [m].
    cogging : tuple of (amplitude, period, phase)
        Forces A sin(2π m/p + φ) that resist the motor by its place m, F/K [m, m, rad].
    cutting : tuple of (force, feed, exponent)
        Forces that resist the motion along the path, F/K [m], at a feed [m/s]; see
        :func:`ph_post.simulate.machine.cutting_force`.
    command_delay, reading_delay : float
        [s].
    reading : TableReading
        Errors of the table's reading: cyclic, scale, thermal, other axes; see :func:`ph_post.drive.plant.read_table`.
    slows : float
        Deceleration by which friction slows a table down that nothing pushes in its backlash [m/s²], where the loop
        does not enclose that; infinite where it stays at once.
    forces : tuple of callables
        Further forces; an axis that has any runs in the slow engine.
    """

    feedback: Feedback
    b: float
    c: float
    ki: float = 0.0
    kd: float = 0.0
    cascade: Cascade | None = None
    eta: float = 0.5
    beta: float = 0.0
    gap: float = 0.0
    widening: GapProfile | None = None
    reference: int = 0
    pickup: Pickup = "standstill"
    kept: float = 1.0
    coulomb_plus: float = 0.0
    coulomb_minus: float = 0.0
    static: float = 0.0
    stribeck_speed: float = 0.0
    viscous_plus: float = 0.0
    viscous_minus: float = 0.0
    load: float = 0.0
    windup_frequency: float = 0.0
    windup_damping: float = 0.0
    saturation: float = math.inf
    cogging: tuple[tuple[float, float, float], ...] = ()
    cutting: tuple[tuple[float, float, float], ...] = ()
    command_delay: float = 0.0
    reading_delay: float = 0.0
    reading: TableReading = TableReading()
    slows: float = math.inf
    forces: tuple[Force, ...] = ()

    @property
    def loop(self) -> Loop:
        """The loop by the name that `feedback` gives it."""
        return LOOPS[self.feedback]


def base_value(plant: Plant, name: str) -> float:
    """Return a number of a plant, or of its cascade, by the name of its field."""
    return float(getattr(plant if name in Plant.__struct_fields__ else plant.cascade, name))


def with_base_value(plant: Plant, name: str, value: float) -> Plant:
    """Return a plant with another number of its own, or of its cascade: b follows the gains, and the damping b.

    Examples
    --------
    >>> plant = Plant(feedback="motor", b=1e-4, c=1e-3, cascade=Cascade(position_gain=50.0, velocity_gain=200.0))
    >>> with_base_value(plant, "position_gain", 25.0).b
    0.0002
    """
    if name in Plant.__struct_fields__:
        return replace(plant, **{name: value})
    assert plant.cascade is not None
    cascade = replace(plant.cascade, **{name: value})
    b = 1.0 / (cascade.velocity_gain * cascade.position_gain)
    return replace(plant, cascade=cascade, b=b, c=plant.c * (b / plant.b))


def force_on(plant: Plant, t: float, position: float, speed: float, direction: int) -> float:
    """Return what the `forces` of a plant add up to, F/K [m]."""
    return sum(force(t, position, speed, direction) for force in plant.forces)


def base_plant(axis: Axis, scenario: Scenario) -> Plant:
    """Return an axis without effects as a scenario has it: its gap, β and C multiplied by its factors.

    C = N/(η r b) multiplies the motor's acceleration in the gap; in the units of the table that is 1/(η b),
    so that another C at the same b is another η.
    """
    gap = axis.gap
    eta = 0.5 if gap.inertia_fraction is None else gap.inertia_fraction
    return Plant(
        feedback=axis.feedback,
        b=axis.servo.b,
        c=axis.servo.damping,
        ki=axis.servo.ki_over_kp,
        kd=axis.servo.kd_over_kp,
        cascade=axis.servo.cascade,
        eta=min(eta / scenario.gain, 1.0),
        beta=(gap.beta or 0.0) * scenario.beta,
        gap=gap.lost_motion * scenario.gap_factor(axis.uncertainty.backlash),
        reference=axis.reference_side,
        pickup=gap.pickup or scenario.pickup or "standstill",
    )


def friction_brakes(plant: Plant) -> float:
    """Return the deceleration [m/s²] by which all of its friction stops an axis; infinite where none is known.

    Examples
    --------
    >>> friction_brakes(Plant(feedback="motor", b=1e-4, c=1e-3, coulomb_plus=6e-6, coulomb_minus=8e-6))
    0.06
    """
    known = plant.b > 0.0 and max(plant.coulomb_plus, plant.coulomb_minus) + plant.static > 0.0
    return min(plant.coulomb_plus, plant.coulomb_minus) / plant.b or math.inf if known else math.inf


def delayed(values: Array, samples: float) -> Array:
    """Values as they were so many samples before, linear in between; before the first there is the first.

    A negative number of samples looks ahead: behind the last there is the last.

    Examples
    --------
    >>> delayed(np.array([0.0, 1.0, 2.0]), 0.5)
    array([0. , 0.5, 1.5])
    """
    if samples == 0.0:
        return values
    rows = np.arange(values.size, dtype=np.float64)
    return np.interp(rows - samples, rows, values)


TRUE_READING = TableReading()
"""The reading of a table that is read as it stands."""


def read_table(plant: Plant, t: Array, table: Array, others: Mapping[str, Array]) -> Array:
    """Return what is read of a table, x (1 + ε) + Σ A sin(2π x/p + φ) + Σ G (1 - exp(-t/τ)) + Σ α y.

    Parameters
    ----------
    plant : Plant
        Of which only `reading` counts; its delay is that of :func:`ph_post.simulate.machine.run_plant`.
    t : Array, shape (n,)
        Time since the beginning of the motion [s].
    table : Array, shape (n,)
        x, where the table is [m].
    others : mapping of str to Array, shape (n,)
        y, where the tables of other axes are [m]. An axis that is not among them counts as 0.

    Returns
    -------
    Array, shape (n,)
        [m]; `table` itself where nothing is set.

    Examples
    --------
    >>> from ph_post.drive.plant import Plant, TableReading
    >>> plant = Plant(feedback="load", b=5e-4, c=5e-3, reading=TableReading(scale=1e-3, others=(("Y", 2e-3),)))
    >>> read_table(plant, np.zeros(1), np.array([0.5]), {"Y": np.array([0.25])})
    array([0.501])
    """
    reading = plant.reading
    if reading == TRUE_READING:
        return table
    wrong = reading.scale * table
    for amplitude, period, phase in reading.cycles:
        wrong = wrong + amplitude * np.sin(2.0 * np.pi * table / period + phase)
    for growth, time_constant in reading.growths:
        wrong = wrong - growth * np.expm1(-t / time_constant)
    for name, angle in reading.others:
        if name in others:
            wrong = wrong + angle * others[name]
    return table + wrong


TABLE_ROUNDS: Final = 60
"""Most rounds in which the table is found behind a gap: each brings it nearer by half at least."""


def gap_at(plant: Plant, table: Array) -> Array:
    """Return the gap [m] at places of the table [m], gap + slope (x - reference) + the bump, never below 0.

    Examples
    --------
    >>> from ph_post.drive.plant import Plant, GapProfile
    >>> worn = GapProfile(bump=2e-5, centre=0.1, width=0.05)
    >>> plant = Plant(feedback="motor", b=5e-4, c=5e-3, gap=3e-5, widening=worn)
    >>> [round(float(gap), 9) for gap in gap_at(plant, np.array([0.1, 0.15, 9.0]))]
    [5e-05, 4.2131e-05, 3e-05]
    """
    worn = plant.widening
    if worn is None:
        return np.full(np.shape(table), plant.gap)
    off = (table - worn.centre) / worn.width
    wider = worn.slope * (table - worn.reference) + worn.bump * np.exp(-0.5 * off * off)
    return np.asarray(np.maximum(plant.gap + wider, 0.0))


def scale_profile(worn: GapProfile, factor: float) -> GapProfile | None:
    """Multiply what a gap has from place to place; None where nothing is left of it."""
    if factor == 0.0:
        return None
    return replace(worn, slope=worn.slope * factor, bump=worn.bump * factor)


def table_behind(plant: Plant, motor: Array, flank: int) -> Array:
    """Return where the table is [m] that a motor at m [m] touches on flank f (1, -1): x = m - f gap(x)/2."""
    table = np.asarray(motor, dtype=np.float64)
    if plant.widening is None:
        return np.asarray(table - 0.5 * flank * plant.gap)
    for _ in range(TABLE_ROUNDS):
        before, table = table, motor - 0.5 * flank * gap_at(plant, table)
        if np.array_equal(before, table):
            break
    return table


@compiled
def coast(motor: Array, gap: float, slows: float, period: float) -> Array:
    """Return the place of a table (n,) in a gap behind a motor (n,), from its middle on.

    Where nothing pushes the table, friction slows it down by `slows` [m/s²], at once where that is infinite; where it
    meets a side of the gap it goes on with the motor.

    Examples
    --------
    >>> coast(np.array([0.0, 2.0, 4.0, 3.0, 1.0]), 2.0, np.inf, 1.0)
    array([0., 1., 3., 3., 2.])
    >>> coast(np.array([0.0, 2.0, 4.0, 4.0, 4.0]), 2.0, 0.5, 1.0)
    array([0. , 1. , 3. , 4.5, 5. ])
    """
    half, at, speed = 0.5 * gap, motor[0], 0.0
    found = np.empty_like(motor)
    for k in range(motor.size):
        speed = max(speed - slows * period, 0.0) if speed > 0.0 else min(speed + slows * period, 0.0)
        at += speed * period
        if abs(at - motor[k]) > half:
            at = motor[k] + (half if at > motor[k] else -half)
            speed = (motor[k] - motor[k - 1]) / period if k else 0.0
        found[k] = at
    return found


def referred_table(plant: Plant, table: Array) -> Array:
    """Refer places x of the table [m], counted from the middle of the gap, to the side where its zero was taken.

    On side f (1, -1) the table stands at x = m - f gap(x)/2 behind its motor. The zero was taken there, so that the
    place is called m: x + f gap(x)/2.

    Examples
    --------
    >>> from ph_post.drive.plant import Plant
    >>> plant = Plant(feedback="motor", b=5e-4, c=5e-3, gap=4e-5, reference=-1)
    >>> [float(referred_table(plant, table_behind(plant, np.array([0.1]), flank))[0]) for flank in (-1, 1)]
    [0.1, 0.09996]
    """
    if not plant.reference:
        return table
    return table + 0.5 * plant.reference * (plant.gap if plant.widening is None else gap_at(plant, table))
