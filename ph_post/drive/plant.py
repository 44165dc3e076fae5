"""The physical constants of one axis in the units of its table: what the simulator runs and effects change.

Everything on the motor's side is scaled to the table, m = r θ_m / N, and every force to the position error
that would hold it in a P loop, F/K. With that N, r and the gains drop out of section 3 of [1]_: engaged, the
axis obeys b ẍ + c ẋ = u with the controller's output u = e + (k_i/k_p) ∫e + (k_d/k_p) ė; in the gap, the
motor η b (m̈ + β ṁ) = u (Eq. 16) and the table (1 - η) b ẍ + (c - η β b) ẋ = 0 (section 3.3).

References
----------
.. [1] doi:10.1007/s00170-021-08515-z.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import msgspec

from ph_post.types import Axis, Feedback, Pickup, Scenario

Force = Callable[[float, float, float, float], float]
"""A force that resists motion, F/K [m].

A function of t [s] (that of the command's rows), of position [m] and speed [m/s] of the body that feels
friction, the table of a `load` loop and the motor of the others, and of the direction (1, -1; 0 at rest) that
it moves in.
"""


class Reading(msgspec.Struct, frozen=True, kw_only=True):
    """What stands between the table and its reading, outside of the loop.

    Parameters
    ----------
    cycles : tuple of (amplitude, period, phase)
        A sin(2π x/p + φ) of screw or scale [m, m, rad].
    scale : float
        Reading for each metre too much.
    growths : tuple of (growth, time constant)
        Thermal growth, from the beginning of the motion on [m, s].
    others : tuple of (axis, angle)
        Position of another axis that is read along [rad].
    """

    cycles: tuple[tuple[float, float, float], ...] = ()
    scale: float = 0.0
    growths: tuple[tuple[float, float], ...] = ()
    others: tuple[tuple[str, float], ...] = ()


class Widening(msgspec.Struct, frozen=True, kw_only=True):
    """By how much the gap at x is wider than elsewhere: slope (x - reference) and a bump, all in metres.

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
    eta, beta : float
        The motor's part of the inertia, and its own decay rate [1/s]; used with feedback `load` only.
    gap : float
        Lost motion [m].
    widening : Widening, optional
        What the gap has beyond that from place to place; see :func:`ph_post.drive.widening.gap_at`.
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
        :func:`ph_post.simulate.cutting.cutting_force`.
    command_delay, reading_delay : float
        [s].
    reading : Reading
        What the table's reading has beyond its position; see :func:`ph_post.drive.reading.read_table`.
    forces : tuple of callables
        Further forces; an axis that has any runs in the slow engine.
    """

    feedback: Feedback
    b: float
    c: float
    ki: float = 0.0
    kd: float = 0.0
    eta: float = 0.5
    beta: float = 0.0
    gap: float = 0.0
    widening: Widening | None = None
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
    reading: Reading = Reading()
    forces: tuple[Force, ...] = ()


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
        c=axis.servo.c,
        ki=axis.servo.ki_over_kp,
        kd=axis.servo.kd_over_kp,
        eta=min(eta / scenario.gain, 1.0),
        beta=(gap.beta or 0.0) * scenario.beta,
        gap=gap.lost_motion * scenario.gap,
        pickup=gap.pickup or scenario.pickup or "standstill",
    )
