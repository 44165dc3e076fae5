"""The dead zone of an axis' gears: motor and table while they do not touch.

Holds the constants of the gap, the free motions of motor and table, Eq. (17) by quadrature, and the backlash
interval under a feed that changes with time (Eq. 32) by integration.

References
----------
.. [1] doi:10.1007/s00170-021-08515-z, sections 3.2 to 3.4 and 5.3.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Final, Literal

import numpy as np

from ph_post.errors import InputError, SolveError
from ph_post.types import Array, Axis, BacklashInterval, Gap, Servo


def gap_constant(axis: Axis) -> float:
    """C = N/(η r b) [rad/(m s²)]: the motor's acceleration in the gap for each metre of error.

    Implements the second part of the line after Eq. (16) of [1]_.

    Raises
    ------
    InputError
        Where the gap has no N, r or η (an axis with feedback `motor` or `none` needs none).
    """
    return motor_gain(axis.servo, axis.gap, axis.name)


def motor_gain(servo: Servo, gap: Gap, name: str = "") -> float:
    """C of :func:`gap_constant` for a loop and a gap; `name` is the axis named in an error."""
    fields = (gap.gear_ratio, gap.travel_per_rad, gap.inertia_fraction)
    if fields[0] is None or fields[1] is None or fields[2] is None:
        raise InputError(
            f"axes.{name}" if name else "gap",
            "backlash inside the loop needs more than its size",
            expected="gear_ratio, travel_per_rad and inertia_fraction",
        )
    return fields[0] / (fields[2] * fields[1] * servo.b)


def motor_gap(gap: Gap) -> float:
    """Δθ_m [rad], from the lost motion r Δθ_m / N where only that is given."""
    if gap.motor_angle is not None:
        return gap.motor_angle
    if gap.gear_ratio is None or gap.travel_per_rad is None:
        raise InputError("gap", "the motor's angle in the backlash is not known", expected="motor_angle or gear_ratio")
    return gap.lost_motion * gap.gear_ratio / gap.travel_per_rad


STIFF: Final = 1e3
"""Horizon in motor time constants 1/β above which an implicit method is taken."""

TOLERANCE: Final = {"DOP853": 1e-12, "Radau": 1e-9}
"""Relative tolerance of a step; Radau's order is lower, and below this it would take for ever."""

ABSOLUTE: Final = 1e-14
"""Absolute tolerance, of the gap and of the speed that crosses it over the horizon."""

STEPS: Final = 64
"""Steps taken over the horizon at least, so that no part of X(t) is stepped over."""

POLISHING: Final = 3
"""Newton steps on Δt, each with the motor integrated up to it: the interpolant inside a step that finds the
crossing is of lower order than the steps themselves."""

OUTSIDE: Final = "the backlash lies outside this axis' loop, and the motor does not wait in it"
NOT_TAKEN_UP: Final = "the motor does not cross the backlash in the time looked at"
TURNS_BACK: Final = "the motor comes back to the side it has left before it has crossed the backlash"

Method = Literal["DOP853", "Radau"]


class _FreeMotor:
    """Eq. (32) for one gap: state (speed less the differential part, angle, ∫e), in gaps and seconds."""

    def __init__(self, axis: Axis, position: Callable[[Array], Array], x_i: float, integral: float) -> None:
        self.position = position
        self.x_i = x_i
        self.unit = motor_gap(axis.gap)
        self.gain = gap_constant(axis) / self.unit
        self.beta = axis.gap.beta or 0.0
        self.ki, self.kd = axis.servo.ki_over_kp, axis.servo.kd_over_kp
        self.start = np.array([0.0, 0.0, integral])
        self.origin = self.at(0.0)

    def at(self, t: float) -> float:
        """X(t) [m]."""
        return float(self.position(np.array([t]))[0])

    def speed(self, t: float, state: Array) -> float:
        """ω_m in gaps/s: k_d/k_p Ẋ is integrated by itself, so that no derivative of X is needed."""
        return float(state[0] + self.gain * self.kd * (self.at(t) - self.origin))

    def rate(self, t: float, state: Array) -> Array:
        """Right-hand side of Eq. (32) of [1]_, extended to PI and PID."""
        error = self.at(t) - self.x_i
        speed = self.speed(t, state)
        return np.array([self.gain * (error + self.ki * state[2]) - self.beta * speed, speed, error])

    def sense(self, horizon: float) -> int:
        """σ of Eq. (15): the sign of the drive when it first has one; 0 if never."""
        times = np.linspace(0.0, horizon, STEPS + 1)
        moved = self.position(times) - self.x_i
        drive = moved + self.ki * self.start[2] + self.kd * np.gradient(moved, times)
        signs = np.sign(drive[drive != 0.0])
        return int(signs[0]) if signs.size else 0


def modulated_interval(
    axis: Axis, position: Callable[[Array], Array], x_i: float, horizon: float, integral: float = 0.0
) -> tuple[BacklashInterval | None, str]:
    """Return the backlash interval of a gap that opens at t = 0 under any commanded motion.

    Implements Eq. (32) of [1]_ with θ_m(0) = ω_m(0) = 0 and the condition |θ_m(Δt)| = Δθ_m, for P, PI and
    PID.

    Parameters
    ----------
    axis : Axis
        With feedback `load`.
    position : callable
        X(t) [m] for an array of times, shape (n,), continuous on [0, horizon].
    x_i : float
        Where the axis stands [m], in the same coordinates.
    horizon : float
        Time looked at [s].
    integral : float
        ∫e when the gap opens [m s], for PI and PID.

    Returns
    -------
    interval : BacklashInterval or None
        `lag` is 0: time is counted from the opening.
    note : str
        Why there is none; empty otherwise.
    """
    if not axis.loop.encloses_backlash:
        return None, OUTSIDE
    if motor_gap(axis.gap) == 0.0:
        return BacklashInterval(lag=0.0, duration=0.0, position=x_i), ""
    motor = _FreeMotor(axis, position, x_i, integral)
    sense = motor.sense(horizon)
    if sense == 0:
        return None, NOT_TAKEN_UP
    method: Method = "DOP853" if motor.beta * horizon < STIFF else "Radau"
    crossing = _crossing(motor, sense, horizon, method)
    if isinstance(crossing, str):
        return None, crossing
    duration, residual = _polish(motor, sense, crossing, horizon, method)
    return BacklashInterval(lag=0.0, duration=duration, position=x_i, residual=residual * motor.unit), ""


class _Flank:
    """Event that ends a run: the motor passes `place` gaps along its sense, moving in `direction`."""

    terminal = True

    def __init__(self, sense: int, place: float, direction: float) -> None:
        self.sense, self.place, self.direction = sense, place, direction

    def __call__(self, _t: float, state: Array) -> float:
        return float(self.sense * state[1] - self.place)


def _integrate(
    motor: _FreeMotor, end: float, horizon: float, method: Method, events: tuple[_Flank, ...] = ()
) -> tuple[Array, tuple[Array, ...]]:
    """State at `end` (or at the event that stopped it), and the times of each event."""
    from scipy.integrate import solve_ivp

    length = 1.0 / motor.gain / horizon  # an integral of the error worth one gap over the horizon
    run = solve_ivp(
        motor.rate,
        (0.0, end),
        motor.start,
        method=method,
        events=events or None,
        max_step=horizon / STEPS,
        rtol=TOLERANCE[method],
        atol=ABSOLUTE * np.array([1.0 / horizon, 1.0, length]),
    )
    if not run.success:
        raise SolveError(f"the motor's motion in the gap could not be integrated: {run.message}")
    return run.y[:, -1], tuple(run.t_events or ())


def _crossing(motor: _FreeMotor, sense: int, horizon: float, method: Method) -> float | str:
    """When the motor reaches the other flank [s], or why it does not."""
    other, left = _Flank(sense, 1.0, 1.0), _Flank(sense, 0.0, -1.0)
    _, (reached, returned) = _integrate(motor, horizon, horizon, method, (other, left))
    if reached.size:
        return float(reached[0])
    return TURNS_BACK if returned.size else NOT_TAKEN_UP


def _polish(motor: _FreeMotor, sense: int, duration: float, horizon: float, method: Method) -> tuple[float, float]:
    """Δt by Newton's method on the motor's angle, and the residual [gaps] left of it."""
    residual = 0.0
    for _ in range(POLISHING):
        state, _events = _integrate(motor, duration, horizon, method)
        residual = sense * float(state[1]) - 1.0
        speed = sense * motor.speed(duration, state)
        step = residual / speed if speed > 0.0 else 0.0
        if abs(step) <= sys.float_info.epsilon * duration:
            break
        duration -= step
    return duration, sense * residual
