"""Machines, commands and their effects as the library takes them, and the same as the reference does."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ph_post.types import Axis, Command, EffectSetting, Feedback, Gap, Limits, Machine, Pickup, Run, Servo

from .reference_machine import Drive, Motion, simulate_axis

MM = 1e-3
MS = 1e-3
MEETINGS = {"picks up", "falls back"}
SAME_TIME = 1e-9
"""[s] by which a flank that is only touched counts as not met."""
SHALLOW = 1e-4
"""[s] below which an opening that falls back is left out: the gap hardly opened, and rounding decides."""

PERIOD = 2e-3
T = PERIOD * np.arange(251)
WAVES = 0.02 * np.sin(7.0 * T) + 0.006 * np.sin(23.0 * T)
"""A command [m] that turns back now and then, and hardly ever comes by the same place at the same speed."""
ACROSS = 0.015 * np.cos(9.0 * T)
"""One for a second axis."""
SOFT = {"b": 4e-4, "c": 0.02, "gap": 4e-4, "eta": 0.4, "beta": 4.0}
"""A drive that follows slowly, and a gap [m] that is wide for it."""


class Case(NamedTuple):
    """One axis, its command, and how the reference is to start."""

    axis: Axis
    command: NDArray[np.float64]
    period: float


def make_axis(
    feedback: Feedback,
    b: float,
    c: float,
    gap: float,
    *,
    eta: float = 0.5,
    beta: float = 0.0,
    ki: float = 0.0,
    kd: float = 0.0,
    pickup: Pickup = "standstill",
    flank: int = 1,
    effects: Sequence[EffectSetting] = (),
    name: str = "X",
) -> Axis:
    """An axis with that gap [m]; its limits play no part."""
    return Axis(
        name=name,
        feedback=feedback,
        servo=Servo(b=b, c=c, ki_over_kp=ki, kd_over_kp=kd),
        gap=Gap(
            lost_motion=gap,
            motor_angle=1000.0 * gap,
            gear_ratio=2.0,
            travel_per_rad=2e-3,
            inertia_fraction=eta,
            beta=beta,
            pickup=pickup,
            initial_flank="+" if flank > 0 else "-",
        ),
        limits=Limits(velocity=1.0, acceleration=10.0, jerk=1e3),
        effects=tuple(effects),
    )


def effect(name: str, **parameters: float) -> EffectSetting:
    return EffectSetting(name=name, parameters=parameters)


def make_machine(axes: Iterable[Axis], period: float) -> Machine:
    return Machine(name="random", dialect="linuxcnc", servo_period=period, axes={axis.name: axis for axis in axes})


def make_command(position: ArrayLike, period: float, moving: bool = False) -> Command:
    """Samples of shape (n, axes) as a command; only `position` and the first `feed` matter."""
    place = np.array(position, dtype=np.float64)
    n = len(place)
    feed = np.zeros(n)
    feed[0] = 1.0 if moving else 0.0
    zeros = np.zeros(n)
    whole = np.zeros(n, dtype=np.int64)
    return Command(
        axes=("X", "Y", "Z")[: place.shape[1]],
        period=period,
        t=period * np.arange(n),
        segment=whole,
        xi=zeros,
        s=zeros,
        position=place,
        feed=feed,
        window=whole - 1,
    )


def drive_of(axis: Axis) -> Drive:
    """The reference's drive for an axis, its effects by their keys in the machine file."""
    servo, gap = axis.servo, axis.gap
    found: dict[str, Any] = {
        "b": servo.b,
        "c": servo.c,
        "ki": servo.ki_over_kp,
        "kd": servo.kd_over_kp,
        "gap": gap.lost_motion,
        "feedback": axis.feedback,
        "rule": gap.pickup,
        "eta": gap.inertia_fraction,
        "beta": gap.beta,
    }
    for setting in axis.effects:
        found |= _of_effect(setting.name, setting.parameters, found)
    return Drive(**found)


def _of_effect(name: str, given: Any, found: dict[str, Any]) -> dict[str, Any]:
    """What one effect changes; forces are in mm of following error."""
    both = found.get("coulomb", (0.0, 0.0))
    dry = given.get("following_error_mm", 0.0) * MM
    match name:
        case "coulomb_friction":
            return {"coulomb": (both[0] + dry, both[1] + dry)}
        case "stribeck_friction":
            return {
                "coulomb": (both[0] + dry, both[1] + dry),
                "static": given["static_following_error_mm"] * MM - dry,
                "stribeck_speed": given["stribeck_velocity_mm_s"] * MM,
            }
        case "engagement_impact":
            rule = "momentum" if found["rule"] == "standstill" else found["rule"]
            return {"rule": rule, "kept": given["kept"]}
        case "viscous_friction" | "friction_asymmetry":
            plus, minus = found.get("viscous", (0.0, 0.0))
            same = given.get("following_error_s", 0.0)
            more, other = (given.get(f"{way}_following_error_s", same) for way in ("plus", "minus"))
            load = found.get("load", 0.0) - 0.5 * (more - other) * given.get("even_at_mm_s", 0.0) * MM
            return {"viscous": (plus + more, minus + other), "load": load}
        case "cogging" | "position_dependent_backlash":
            return _of_place(name, given, found)
    key, unit, ours = {
        "load_offset": ("following_error_mm", MM, "load"),
        "torque_saturation": ("following_error_mm", MM, "saturation"),
        "transport_delay": ("delay_ms", MS, "delay"),
    }[name]
    return {ours: given[key] * unit}


def _of_place(name: str, given: Any, found: dict[str, Any]) -> dict[str, Any]:
    """What acts by the place of motor or table."""
    if name == "position_dependent_backlash":
        return {"wider": lambda x: _wider(x, given)}
    wave = (given["following_error_mm"] * MM, given["period_mm"] * MM, math.radians(given["phase_deg"]))
    return {"waves": (*found.get("waves", ()), wave)}


def _wider(x: float, given: Any) -> float:
    """Slope and bump of a gap, from millimetres."""
    mm = x / MM
    off = (mm - given["centre_mm"]) / given["width_mm"]
    sloping = given["slope_mm_per_mm"] * (mm - given["reference_mm"])
    return MM * (sloping + given["bump_mm"] * math.exp(-(off**2) / 2.0))


def reference(case: Case, speed: float = 0.0, refine: int = 3) -> Motion:
    """Run a case with the reference, started as the engine says it starts.

    An integrator holds what steady motion needs; the motor's side of a loop that does not see the table lags
    by c times the speed.
    """
    drive = drive_of(case.axis)
    start = float(case.command[0])
    if drive.feedback != "load" and not drive.ki:
        start -= drive.c * speed
    return simulate_axis(
        drive,
        case.command,
        case.period,
        flank=(int(np.sign(speed)) or _flank(case.axis)),
        position=start,
        speed=speed,
        integral=(drive.c * speed + drive.load) / drive.ki if drive.ki else 0.0,
        refine=refine,
    )


def _flank(axis: Axis) -> int:
    return -1 if axis.gap.initial_flank == "-" else 1


def contacts(events: Iterable[tuple[float, str]]) -> list[tuple[float, str]]:
    """Openings and meetings of flanks, without touches and openings that last no time.

    Where such a touch of the other flank is left out, the next meeting is named from the flank before.
    """
    found: list[tuple[float, str]] = []
    crossed = False
    for t, kind in events:
        if kind == "opens" and found and found[-1][1] in MEETINGS and t - found[-1][0] < SAME_TIME:
            crossed ^= found.pop()[1] == "picks up"
        elif kind == "opens":
            found.append((t, kind))
        elif kind == "falls back" and not crossed and found and t - found[-1][0] < SHALLOW:
            found.pop()
        elif kind in MEETINGS:
            other = "falls back" if kind == "picks up" else "picks up"
            found.append((t, other if crossed else kind))
            crossed = False
    return found


def contacts_of(run: Run, axis: str) -> list[tuple[float, str]]:
    return contacts((event.t, event.kind) for event in run.events if event.axis == axis)


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return math.exp(rng.uniform(math.log(low), math.log(high)))


def random_command(rng: np.random.Generator, kind: str, size: float, t: NDArray[np.float64]) -> NDArray[np.float64]:
    """Sums of sines, trapezoids with dwells, or a coordinate of a circle; up to `size` [m]."""
    match kind:
        case "sines":
            parts = [
                rng.uniform(0.1, 1.0) / k * np.sin(k * log_uniform(rng, 1.0, 25.0) * t + rng.uniform(0.0, 6.0))
                for k in (1, 2, 3)
            ]
            return size * 0.5 * np.sum(parts, axis=0)
        case "trapezoids":
            knots = np.sort(rng.uniform(0.0, t[-1], 8))
            return np.interp(t, knots, np.repeat(rng.uniform(-size, size, 4), 2))
        case "circle":
            return size * np.cos(log_uniform(rng, 1.0, 15.0) * t + rng.uniform(0.0, 6.0))
    raise AssertionError(kind)


def random_axis(rng: np.random.Generator, feedback: Feedback, pickup: Pickup, control: str, size: float) -> Axis:
    """A plausible drive: natural frequency, damping, motor's part, and a gap small beside the motion."""
    natural, damping = log_uniform(rng, 15.0, 150.0), log_uniform(rng, 0.1, 3.0)
    b, c = natural**-2, 2.0 * damping / natural
    eta = rng.uniform(0.1, 0.9)
    return make_axis(
        feedback,
        b,
        c,
        size * log_uniform(rng, 1e-4, 0.1),
        eta=eta,
        beta=rng.uniform(0.0, 0.9) * c / b / eta,
        ki=rng.uniform(0.01, 0.3) * c / b if control in {"PI", "PID"} else 0.0,
        kd=rng.uniform(0.1, 1.0) * c if control == "PID" else 0.0,
        pickup=pickup,
        flank=int(rng.choice([1, -1])),
    )


def random_effects(rng: np.random.Generator, axis: Axis, size: float) -> list[EffectSetting]:
    """A few effects of sizes that matter."""
    dry = size / MM * log_uniform(rng, 1e-4, 2e-2)
    every = [
        effect("coulomb_friction", following_error_mm=dry),
        effect("viscous_friction", following_error_s=axis.servo.c * rng.uniform(0.0, 0.5)),
        effect("load_offset", following_error_mm=size / MM * rng.uniform(-0.03, 0.03)),
        effect("transport_delay", delay_ms=2.0 * float(rng.integers(1, 9))),
    ]
    if axis.feedback != "none":
        every.append(effect("torque_saturation", following_error_mm=size / MM * log_uniform(rng, 0.05, 1.0)))
    if axis.feedback == "load":
        every.append(effect("engagement_impact", kept=rng.uniform(0.1, 1.0)))
    return [one for one in every if rng.random() < 0.4]
