"""Friction led: the share of a command that friction and a load take, by the direction of motion.

Where an axis moves with speed v, its motor overcomes F sign(v) + d v + L beside b ẍ + c ẋ, all of it as the position
error that makes a P loop give that force, F/K. So the command leads the path by as much. At a reversal F sign(v) jumps;
the command cannot, and the motor has to cross its backlash before it can push the other way. While the table rests,
friction holds it whatever the motor does within F. So the share is changed there in three steps: from F to a small
part of F in the new direction (release), which carries the motor through the backlash (hold) slowly enough that
it does not knock the table on, and then to F (take).
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from typing import Final

import msgspec
import numpy as np

from ph_post.drive.cascade import offset_of_force
from ph_post.drive.effects.active import plant_of
from ph_post.drive.plant import friction_brakes
from ph_post.types import Array, Axis, Cascade, FrictionChange, Machine, Scenario

PART: Final = 0.9
"""Part of an axis' limits that a change of the friction's share takes at most: the axis rests meanwhile, or nearly."""

BESIDE: Final = 0.3
"""The same where the command crosses the backlash at the same time, behind the loop, with most of the limits."""

TRIES: Final = 6
"""Times that a step is lengthened at most."""

STARTS: Final = np.array([0.0, 0.25, 0.5, 0.75])
"""Parts of a period at which it may begin behind a row."""

AROUND: Final = 10.0
"""Periods before and behind a step in which the command is looked at."""

PEAKS: Final = (2.0, 8.0, 32.0)
"""Largest first, second and third derivative of :func:`step`."""

STILL: Final = 0.2e-6
"""Within so far [m] of where an axis turns back it counts as at rest, and shorter ways back as none."""

HELD: Final = 0.2
"""Part of the friction with which the motor is brought through the backlash where nothing else is asked for."""


SPREADS: Final = 2.5
"""Times its uncertainty by which friction may be less, for a plan that leads it to be no worse than the plain one."""

MISSING: Final = (0.25, 0.5)
"""Parts of the friction that are the least and the largest of that: it changes from day to day, whatever a log knew of
it, and half of it is missing where the machine file does not say how sure it is."""

RUN_ON: Final = 0.05
"""Part of its backlash by which a table may run on where its motor stops behind an approach."""


class Friction(msgspec.Struct, frozen=True, kw_only=True):
    """Friction and load of an axis, as position errors.

    `plus` and `minus` [m] are Coulomb friction while moving up and down, both positive; `static` [m] is what there is
    more of it at rest, which dies out as exp(-(v/`speed`)²) [m/s]; `viscous_plus` and `viscous_minus` [s] add to c;
    `load` [m] pushes towards minus.
    """

    plus: float = 0.0
    minus: float = 0.0
    static: float = 0.0
    speed: float = 0.0
    viscous_plus: float = 0.0
    viscous_minus: float = 0.0
    load: float = 0.0

    @property
    def turns(self) -> bool:
        """True where a part of it turns round with the motion."""
        return max(self.plus, self.minus) > 0.0 or self.viscous_plus != self.viscous_minus

    @property
    def size(self) -> float:
        """Largest share that turns round at a reversal [m]."""
        return max(self.plus, self.minus) + (self.static if self.speed else 0.0)


class FrictionLead(msgspec.Struct, frozen=True, kw_only=True):
    """The friction that a command leads.

    `axes` have friction; `part` of it is led, of a load all. `initial` is the direction (1, -1, 0) by axis in which
    the friction is led at first, and `changes` are those of the direction.
    """

    axes: Mapping[str, Friction] = {}
    part: float = 1.0
    initial: Mapping[str, int] = {}
    changes: tuple[FrictionChange, ...] = ()

    def share(self, name: str, speed: Array, t: Array) -> Array:
        """Share of the command of an axis that moves at `speed` [m/s] at the times `t` [s]: [m], shape (n,)."""
        friction = self.axes.get(name)
        if friction is None:
            return np.zeros(t.size)
        own = [one for one in self.changes if one.axis == name]
        turned = level(own, self.initial.get(name, own[0].before if own else 0), t)
        return friction.load + self.part * friction_share(friction, turned, speed)


def friction_of(axis: Axis) -> Friction | None:
    """Return what an axis has of friction and load; None where it has neither, or no controller leads it.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> friction_of(read_machine("mill").axes["X"]) is None
    True
    >>> round(1e6 * friction_of(read_machine("old_mill").axes["X"]).plus, 6)
    40.0
    """
    if not axis.effects or not axis.loop.has_controller:
        return None
    plant = plant_of(axis, Scenario())
    found = Friction(
        plus=plant.coulomb_plus,
        minus=plant.coulomb_minus,
        static=plant.static,
        speed=plant.stribeck_speed,
        viscous_plus=plant.viscous_plus,
        viscous_minus=plant.viscous_minus,
        load=plant.load,
    )
    return None if found == Friction(speed=found.speed) else found


def friction_of_machine(machine: Machine, axes: Sequence[str]) -> dict[str, Friction]:
    """Return the friction of the axes that have some."""
    found = {name: friction_of(machine.axes[name]) for name in axes}
    return {name: one for name, one in found.items() if one is not None}


def gentlest_approach(axis: Axis) -> float:
    """Return the speed [m/s] from which its friction stops a table that nothing pushes any more, before it runs on.

    It stops within :data:`RUN_ON` of its backlash. Infinite where the friction is not known. Where it is small and a
    motor brakes harder, the table flies through its backlash, onto the other side.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> gentlest_approach(read_machine("router").axes["X"])
    inf
    >>> round(gentlest_approach(read_machine("old_mill").axes["X"]), 4)
    0.001
    """
    return math.sqrt(2.0 * RUN_ON * axis.gap.lost_motion * friction_brakes(plant_of(axis, Scenario())))


def braked(axis: Axis) -> float:
    """Return the deceleration [m/s²] by which friction stops a table of an axis that runs on in its backlash.

    Infinite where the axis never brakes harder: where the file has no friction, or enough.
    """
    slows = friction_brakes(plant_of(axis, Scenario()))
    return slows if slows < axis.limits.acceleration else math.inf


def little_friction(axes: Iterable[Axis]) -> float:
    """Return the part of the friction of axes with which a plan that leads it may be no worse than the plain program.

    Of axes with different uncertainties the largest counts, as all have the same factor.

    Examples
    --------
    >>> from ph_post.drive.machinefile import read_machine
    >>> little_friction(read_machine("old_mill").axes.values())
    0.5
    """
    spread = max(axis.uncertainty.friction for axis in axes)
    return 1.0 - min(max(SPREADS * spread, MISSING[0]), MISSING[1])


def friction_share(friction: Friction, turned: Array, speed: Array) -> Array:
    """Position error [m] that friction takes of an axis at `speed` [m/s], shape (n,).

    `turned` (n,) says which way it is led, 1 to plus and -1 to minus.

    Examples
    --------
    >>> dry = Friction(plus=3e-5, minus=3e-5, viscous_plus=1e-3, viscous_minus=1e-3)
    >>> np.round(1e6 * friction_share(dry, np.array([1.0, 0.0, -1.0]), np.array([0.01, 0.0, -0.02])), 6).tolist()
    [40.0, 0.0, -50.0]
    """
    dry = np.where(turned >= 0.0, friction.plus, friction.minus)
    if friction.static and friction.speed:
        dry = dry + friction.static * np.exp(-((speed / friction.speed) ** 2))
    both = 0.5 * (friction.viscous_plus + friction.viscous_minus)
    other = 0.5 * (friction.viscous_plus - friction.viscous_minus)
    return np.asarray(turned * dry + (both + other * turned) * speed)


def step(u: Array) -> Array:
    """Rise from 0 to 1 over u in [0, 1] with a third derivative of one size, 32: the quickest under a limit of jerk.

    Examples
    --------
    >>> step(np.array([-1.0, 0.25, 0.5, 0.75, 2.0])).round(6).tolist()
    [0.0, 0.083333, 0.5, 0.916667, 1.0]
    """
    within = np.clip(u, 0.0, 1.0)
    near = np.minimum(within, 1.0 - within)
    on = near - 0.25
    low = np.where(on < 0.0, 16.0 / 3.0 * near**3, 1.0 / 12.0 + on + 4.0 * on**2 - 16.0 / 3.0 * on**3)
    return np.asarray(np.where(within > 0.5, 1.0 - low, low))


def level(changes: Sequence[FrictionChange], initial: float, t: Array) -> Array:
    """Return which way friction is led at the times `t` [s], from 1 (to plus) to -1, shape (n,)."""
    found = np.full(t.size, float(initial))
    for one in changes:
        held = one.held * one.after
        _add_rise(found, t, one.start, one.release, held - one.before)
        _add_rise(found, t, one.start + one.release + one.hold, one.take, one.after - held)
    return found


def _add_rise(found: Array, t: Array, start: float, duration: float, size: float) -> None:
    """Add a step at `start`; before it there is nothing, and behind it its size is all that is left."""
    if size == 0.0:
        return
    begin, end = np.searchsorted(t, [start, start + duration]).tolist()
    if duration > 0.0:
        found[begin:end] += size * step((t[begin:end] - start) / duration)
    found[end:] += size


def shortest_step(axis: Axis, size: float, period: float, *, alone: bool = False) -> float:
    """Least duration [s] in which a share of the command may change by `size` [m] within the axis' limits.

    Behind the loop the axis may cross its backlash meanwhile, if the step is not `alone`.
    """
    part = PART if alone or axis.loop.encloses_backlash or not axis.gap.lost_motion else BESIDE
    limits = (axis.limits.velocity, axis.limits.acceleration, axis.limits.jerk)
    least = [
        (abs(size) * peak / (part * bound)) ** (1.0 / order)
        for order, (peak, bound) in enumerate(zip(PEAKS, limits, strict=True), start=1)
    ]
    duration = float(max(4.0 * period, *least))
    if axis.servo.cascade is None or size == 0.0:
        return duration
    return _led(axis.servo.cascade, tuple(part * bound for bound in limits), abs(size), duration, period)


@lru_cache(maxsize=1024)
def _led(cascade: Cascade, limits: tuple[float, ...], size: float, duration: float, period: float) -> float:
    """Lengthen a step of a share to what the command of a cascade keeps limits of velocity, acceleration and jerk with.

    It has more than the share: what the current loop and filters of the command would take of it.
    """
    early = cascade.dead_time + cascade.moving_average + cascade.exponential
    for _ in range(TRIES):
        t = np.arange(-early - AROUND * period, duration + AROUND * period, period)
        commands = [offset_of_force(cascade, size * step((t - late) / duration), period) for late in STARTS * period]
        used = max(
            (float(np.max(np.abs(np.diff(commands, order)))) / period**order / bound) ** (1.0 / order)
            for order, bound in enumerate(limits, start=1)
        )
        if used <= 1.0:
            break
        duration *= used
    return duration


def crossing_time(axis: Axis, size: float) -> float:
    """Time [s] that a motor without losses takes through its backlash under a position error of `size` [m]."""
    if not axis.loop.encloses_backlash or size <= 0.0:
        return 0.0
    inertia = (axis.gap.inertia_fraction or 0.0) * axis.servo.b
    return math.sqrt(2.0 * inertia * axis.gap.lost_motion / size)


def direct_change(
    axis: Axis, friction: Friction, before: int, after: int, middle: float, period: float
) -> FrictionChange:
    """Change the direction in which friction is led in one step around an instant [s], as quickly as limits allow."""
    duration = shortest_step(axis, (after - before) * friction.size, period)
    return FrictionChange(
        axis=axis.name, start=middle - 0.5 * duration, release=duration, held=1.0, before=before, after=after
    )


def held_change(axis: Axis, friction: Friction, before: int, after: int, held: float, period: float) -> FrictionChange:
    """Change it in three steps from 0 s on, as quickly as limits and the backlash allow."""
    return FrictionChange(
        axis=axis.name,
        start=0.0,
        release=shortest_step(axis, (held * after - before) * friction.size, period),
        hold=crossing_time(axis, held * friction.size),
        take=shortest_step(axis, (1.0 - held) * friction.size, period),
        held=held,
        before=before,
        after=after,
    )
